//! What every crate of fantex needs and none owns.
//!
//! | module | what |
//! |---|---|
//! | [`files!`] | files that travel in a program |
//! | [`error`] | one error type: a kind for programs, a sentence for people, the file and the place in it |
//! | [`aabb`] | axis-aligned boxes |
//! | [`bits()`] | sets of up to 64 numbers |
//! | [`mod@files`] | files that appear whole or not at all |
//! | [`input`] | files that others made: opening, what they may name, memory |
//! | [`json_problem()`] | what is wrong with a JSON file, in words |
//! | [`parameters!`] | structs of parameters with their defaults beside them, read from files |
//! | [`random`] | repeatable random numbers |
//! | [`srgb`] | the sRGB transfer curve, its tables, rounding to 8 and 16 bits |
//! | [`sweep`] | pairs of boxes that meet |
//! | [`text`] | counts and shares in messages, names in addresses, text in markup |
//! | [`union_find`] | disjoint sets |
//! | [`vector_level()`] | the vectors that the processor has |
//! | [`zstandard`] | unpacking of Zstandard frames |

pub mod aabb;
mod bits;
pub mod error;
pub mod files;
pub mod input;
mod json_problem;
mod parameters;
pub mod random;
pub mod srgb;
pub mod sweep;
pub mod text;
pub mod union_find;
mod vectors;
pub mod zstandard;

pub use aabb::Aabb;
pub use bits::bits;
pub use error::{Error, ErrorKind, Place, Result};
pub use input::{ReadLimits, ReadOptions};
pub use json_problem::json_problem;
pub use random::Random;
pub use text::{are, counted, grouped, markup_escaped, numbered, percent, uri_escaped, were};
pub use union_find::UnionFind;
pub use vectors::vector_level;

/// Files of the caller's folder as `(path in the workspace, content)`: `files!["gallery/": "bump.toml" "glow.toml"]`.
#[macro_export]
macro_rules! files {
    [$folder:literal: $($name:literal)*] => { &[$((concat!($folder, $name), include_bytes!($name))),*] };
}
