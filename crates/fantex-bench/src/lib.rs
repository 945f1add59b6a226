//! What measures and tests fantex and is not shipped.
//!
//! - [`simulate`]: camera paths replayed against the streamer with a modelled disk; `examples/simulate_streaming.rs` prints a table.
//! - [`faulty`]: disks that are slow, lie or fail.
//! - `examples/`: benchmarks that print.
//! - `tests/`: residency and loader against these disks.

pub mod faulty;
pub mod simulate;
