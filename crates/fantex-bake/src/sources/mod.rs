//! The sources that come with fantex.

mod lit;
mod look;
mod mapped_image;
mod sine;
mod solid;
mod space;
mod uv;
mod vertex_color;

pub use lit::LitSource;
pub use look::{LookSource, LookSourceError, baked_materials};
pub use mapped_image::MappedImageSource;
pub use sine::SineSource;
pub use solid::SolidSource;
pub use space::WorldSpace;
pub use uv::UvSource;
pub use vertex_color::{NoVertexColors, VertexColorSource};
