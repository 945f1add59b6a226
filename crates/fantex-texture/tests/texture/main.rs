//! Tests of the texture crate from outside.

mod common;
mod comparisons;
mod environments;
mod files;
mod filters;
mod mappings;
mod solids;
mod speed;
