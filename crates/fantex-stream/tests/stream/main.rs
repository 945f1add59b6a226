//! Tests of the crate `fantex-stream` from outside. (Loaders and residency are tested in `fantex-bench`, with its faulty disks.)

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod demand;
mod drawing;
#[cfg(feature = "http")]
mod http;
mod retries;
mod values;
