//! Tests of the texture crate from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod combine;
mod common;
mod comparisons;
mod conformance;
mod coordinates;
mod environments;
mod fast_paths;
mod files;
mod filters;
mod horizon;
mod looks;
mod many_points;
mod mappings;
mod pictures;
mod resizing;
mod solids;
mod speed;
mod surface_detail;
mod two_part;
mod volumes;
mod warps;
