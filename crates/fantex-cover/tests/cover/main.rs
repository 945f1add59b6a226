//! Tests of the crate `fantex-cover` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod building;
mod common;
mod footprints;
mod meshes;
mod sheets;
mod texture_function;
