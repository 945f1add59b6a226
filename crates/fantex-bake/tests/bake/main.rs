//! Tests of the crate `fantex-bake` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod assets;
mod common;
mod hard_edges;
mod light;
mod parts;
mod sources;
mod texels;
mod transfer;
