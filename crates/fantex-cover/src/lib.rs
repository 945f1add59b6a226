//! The cover of a mesh: partial fans, their groups, frames and tiles, and the texture function.

mod cover;

pub use cover::*;
