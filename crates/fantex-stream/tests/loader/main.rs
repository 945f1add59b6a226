//! Reading and loading of a baked asset: from files, from a server, and when things go wrong.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod asset;
mod faults;
mod http;
mod http_server;
mod pages;
mod readers;
mod scheduling;
mod speed;
mod streaming;
