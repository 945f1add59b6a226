//! A model's materials as functions on its surface, the glTF way.
//!
//! ```text
//! images --load--> MaterialTextures --the caller's filter--> texels --factors, vertex colours--> values
//!                  normals, tangents --TangentFrame-----------------------bend---------------> normal
//! ```
//!
//! Whoever evaluates a material chooses how its images are filtered (for a pixel, for the texel of a bake); what is made
//! of the texels is the same for all and stands here.

mod coverage;
mod evaluate;
mod load;
mod variance;

use std::sync::Arc;

use fantex_mesh::Mesh;
use glam::{Mat3, Vec2};

use crate::{ImageTexture, Wrap};

pub use coverage::{AlphaCoverage, preserve_coverage};
pub use evaluate::*;
pub use load::{MaterialImageError, MaterialLabel, load_material_textures};
pub use variance::*;

/// A material's textures; those whose texture coordinates the mesh lacks are left out.
#[derive(Clone, Debug, Default)]
pub struct MaterialTextures {
    /// sRGB colour, alpha.
    pub base_color: Option<TextureLayer>,
    /// Green = roughness, blue = metallic.
    pub metallic_roughness: Option<TextureLayer>,
    /// Tangent-space normal, 0..1.
    pub normal: Option<TextureLayer>,
    /// Red = occlusion.
    pub occlusion: Option<TextureLayer>,
    /// sRGB colour.
    pub emission: Option<TextureLayer>,
}

/// One use of an image.
#[derive(Clone, Debug)]
pub struct TextureLayer {
    /// Index into the mesh's `uv_sets`.
    pub uv_set: usize,
    /// From the corner's `(u, v, 1)` to the look-up.
    pub uv_transform: Mat3,
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// True where texels are to appear as squares when magnified.
    pub nearest: bool,
    /// The image with its levels; shared between materials.
    pub texture: Arc<ImageTexture>,
}

impl MaterialTextures {
    /// Those that there are.
    pub fn layers(&self) -> impl Iterator<Item = &TextureLayer> {
        let Self { base_color, metallic_roughness, normal, occlusion, emission } = self;
        [base_color, metallic_roughness, normal, occlusion, emission].into_iter().flatten()
    }
}

impl TextureLayer {
    /// The look-up coordinates at a triangle's corners.
    pub fn corner_uv(&self, mesh: &Mesh, triangle: usize) -> [Vec2; 3] {
        let set = &mesh.corners.uv_sets[self.uv_set];
        [0, 1, 2].map(|k| self.uv_transform.transform_point2(set[3 * triangle + k]))
    }
}
