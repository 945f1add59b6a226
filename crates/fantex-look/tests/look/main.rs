//! Tests of the crate `fantex-look` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod docs;
mod files;
mod resolve;
mod translate;
