//! Exports as other programs see them.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

mod fans;
mod models;
mod pictures;
mod sources;
mod support;
mod unwrapping;
