//! The CPU renderer.
