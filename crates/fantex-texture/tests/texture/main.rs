//! Tests of the texture crate from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod combine;
mod common;
mod conformance;
mod coordinates;
mod environments;
mod filters;
mod images;
mod many_points;
mod mappings;
mod materials;
mod noise;
mod solids;
mod surface_detail;
mod two_part;
mod volumes;
mod warps;
