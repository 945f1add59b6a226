//! Tests of the crate `fantex-render` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod common;
mod environment;
mod environment_pictures;
mod fan;
mod fan_batches;
mod goldens;
mod lighting_pictures;
mod look;
mod look_batches;
mod materials;
mod scene;
mod shadows;
mod speed;
mod visibility;
