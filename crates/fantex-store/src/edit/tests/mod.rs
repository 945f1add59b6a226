//! Crashes, failures and readers.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

#[path = "../../../tests/store/common/mod.rs"]
mod common;
mod crash;
mod failing;
mod figures;
mod output;
mod readers;
mod script;
