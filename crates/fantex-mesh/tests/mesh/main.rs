//! Tests of the crate `fantex-mesh` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod common;
mod data_files;
mod displace;
mod fans;
mod gltf_files;
mod hostile;
mod load_speed;
mod obj_files;
mod ply_stl_files;
mod rays;
mod tangents;
mod written_files;
