//! Tests of the crate `fantex-gpu` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod common;
mod fan;
mod faults;
mod pictures;
mod sampler;
mod sheets;
mod views;
