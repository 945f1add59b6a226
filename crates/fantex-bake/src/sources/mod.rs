//! The sources that come with fantex.

mod sine;
mod vertex_color;

pub use sine::SineSource;
pub use vertex_color::{NoVertexColors, VertexColorSource};
