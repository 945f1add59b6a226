//! Tests of the crate `fantex-photos` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod cameras;
mod common;
mod laid_on;
