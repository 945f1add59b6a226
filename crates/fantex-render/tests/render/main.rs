//! Tests of the crate `fantex-render` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod common;
mod environment;
mod fan;
mod look;
mod materials;
mod memory;
mod scene;
mod visibility;
