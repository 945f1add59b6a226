//! Cleaning, seen from outside the crate.

mod common;
mod properties;
mod worst_cases;
