//! Tests of the texture crate from outside.

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
mod mappings;
mod pictures;
mod resizing;
mod solids;
mod speed;
mod two_part;
mod volumes;
mod warps;
