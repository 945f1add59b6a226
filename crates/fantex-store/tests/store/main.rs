//! Tests of the crate `fantex-store` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod blocks;
mod cache;
mod common;
mod compact;
mod damage;
mod edit;
mod format;
mod killed;
mod sampler;
mod verify;
