//! Where every triangle lies in which picture.

mod atlas;
mod mask;
mod model_uv;
mod pack;

use glam::Vec2;

pub(crate) use atlas::{AtlasRequest, atlas};
pub(crate) use model_uv::{model_uv, uv_of_asset, uv_of_model};

/// No chart.
pub(crate) const NOBODY: u32 = u32::MAX;

/// Texture coordinates of all triangles and the pictures they refer to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layout {
    /// Texture coordinates of each triangle's corners, origin top left, v downwards.
    pub(crate) uv: Vec<[Vec2; 3]>,
    /// The pictures.
    pub(crate) pages: Vec<Page>,
    /// Index into `pages` for every material; none where no triangle has it.
    pub(crate) page_of_material: Vec<Option<usize>>,
    /// True where coordinates go beyond 0..1 and the pictures repeat.
    pub(crate) repeats: bool,
    /// Charts of an own packing; 0 for the model's coordinates.
    pub(crate) charts: usize,
    /// Texels that an own packing keeps around charts: no foreign texel is read down to the level at which a texel covers
    /// this many. 0 for the model's coordinates.
    pub(crate) padding: u32,
    /// Mean texels per mesh unit over the surface.
    pub(crate) texels_per_unit: f32,
}

/// One square picture (of every map).
#[derive(Clone, Debug, Default)]
pub(crate) struct Page {
    /// Columns and rows, a power of two.
    pub(crate) side: u32,
    /// The triangles that lie in it.
    pub(crate) placed: Vec<Placed>,
    /// Blocks are squares of this many texels.
    pub(crate) block: u32,
    /// The chart that each block belongs to or `NOBODY`, row-major; empty where texels belong to whoever is nearest.
    pub(crate) owners: Vec<u32>,
}

/// A triangle in a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Index in the mesh.
    pub(crate) triangle: u32,
    /// Which chart's blocks it may use; 0 where there are no owners.
    pub(crate) chart: u32,
    /// Corners in texels, texel centres at half integers.
    pub(crate) corners: [Vec2; 3],
    /// True for a neighbour of the chart, which continues the surface into the padding and is not seen itself.
    pub(crate) is_beyond: bool,
}

impl Page {
    /// The chart that a texel belongs to: `NOBODY` in unused blocks, 0 where there are no owners.
    pub(crate) fn owner(&self, x: u32, y: u32) -> u32 {
        if self.owners.is_empty() {
            return 0;
        }
        let blocks = self.side / self.block;
        self.owners[(y / self.block * blocks + x / self.block) as usize]
    }
}
