//! Tests of the crate `fantex-paint` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod background;
mod common;
mod fills;
mod layers;
mod log;
mod normals;
mod painting;
mod regions;
mod speed;
mod tools;
mod views;
mod work;
