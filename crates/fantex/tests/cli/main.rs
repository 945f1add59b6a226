//! The command line as scripts see it: exit codes, messages, JSON, files.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

mod bad_input;
mod export;
mod gallery;
mod interrupt;
mod looks;
mod paint;
mod photographs;
mod real_models;
mod round_trip;
mod support;
mod surroundings;
mod usage;
