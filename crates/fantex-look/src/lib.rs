//! The look of a model as its file says it.
//!
//! ```text
//! text --toml--> document with spans --check (schema)--> names --> Look
//! ```
//!
//! A [`LookFile`] is a TOML text that passed all checks which need nothing but the text: types, ranges, names, circles. It
//! holds the [`data::Look`], plain tables that are also the source of the JSON schema ([`look_schema`]). What the tables
//! mean is known elsewhere: `fantex-texture` makes textures and materials of them, the crate `fantex` scenes.

pub mod data;
mod file;
pub mod reference;

pub use file::{Key, LookError, LookFile, LookProblem, look_schema};
