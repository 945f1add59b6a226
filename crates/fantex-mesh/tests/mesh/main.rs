//! Tests of the crate `fantex-mesh` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod clean;
mod common;
mod compressed;
mod displace;
mod files;
mod generate;
mod gltf_files;
mod hostile;
mod parts;
mod polygons;
mod readers;
mod simplify;
mod surface;
mod watched;
