//! Tests of the crate `fantex-scene` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod lights;
mod pictures;
mod views;
