//! Tests of the texture crate from outside.

mod common;
mod filters;
mod mappings;
mod solids;
mod speed;
