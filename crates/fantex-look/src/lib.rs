//! Looks: what textures drive on a model, and how it is shown.
//!
//! ```text
//! text --toml--> document with spans --check (schema)--> names --> Look
//!                                                                   | resolve, with a model
//!  a model's own materials --translate--> Look                      v
//!                                                      textures, LookMaterial
//! ```
//!
//! A [`LookFile`] is a TOML text that passed all checks which need nothing but the text: types, ranges, names, circles. It
//! holds the [`data::Look`], whose types are also the source of the JSON schema ([`look_schema`]). A [`Resolver`] loads its files, looks up
//! its names and fits it to a model. Lamps, camera and objects are left to whoever renders.

mod check;
pub mod data;
mod file;
pub mod problem;
pub mod reference;
mod resolve;
mod translate;

pub use check::{LookNumber, look_schema};
pub use file::{Key, LookFile};
pub use resolve::{LookImages, ResolveOptions, Resolver};
pub use translate::{TranslatedLook, look_of_model, materials_of_model};
