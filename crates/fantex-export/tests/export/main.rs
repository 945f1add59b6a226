//! Exports as other programs see them.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

mod channels;
mod failures;
mod layouts;
mod models;
mod padding;
mod support;
