//! What pictures of models need beside a renderer: light from surroundings, and how much two of them differ.

mod comparison;
mod surroundings;

pub use comparison::{ModelPicture, ViewComparison};
pub use surroundings::Surroundings;
