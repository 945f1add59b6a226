//! Texture coordinates for a mesh, without an asset.

use fantex_bake::NoProgress;
use fantex_base::{Error, Result};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::Mesh;
use glam::Vec2;

use crate::ExportOptions;
use crate::layout::{AtlasRequest, atlas};

/// How a mesh is unwrapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnwrapOptions {
    /// Columns and rows of the square picture, a power of two.
    pub side: u32,
    /// Texels between charts, a power of two up to 16; as many as fit if it is not given.
    pub padding: Option<u32>,
}

impl Default for UnwrapOptions {
    /// 2048 texels a side.
    fn default() -> Self {
        Self { side: 2048, padding: None }
    }
}

/// Texture coordinates of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Unwrapped {
    /// Of each triangle's corners, 0..1, origin top left, v downwards.
    pub uv: Vec<[Vec2; 3]>,
    /// Pieces.
    pub charts: usize,
    /// Texels around every piece that are its own.
    pub padding: u32,
}

/// Cuts a mesh into few charts that see the surface at little stretch, and packs them into a square.
///
/// # Errors
/// An option is out of its range, or there are too many charts for the picture.
pub fn unwrap_mesh(mesh: &Mesh, options: &UnwrapOptions) -> Result<Unwrapped> {
    let UnwrapOptions { side, padding } = *options;
    let refused = |error: Error| error.context("cannot unwrap the mesh");
    ExportOptions { side: Some(side), padding, ..ExportOptions::default() }.check().map_err(refused)?;
    let texels = f64::from(side) * f64::from(side);
    let budget = TexelBudget::Total(texels as u64);
    let (cover, _) = build_cover(mesh, &CoverOptions { budget, ..CoverOptions::default() })?;
    let texels_per_unit = (texels / mesh.area()).sqrt() as f32;
    let request = AtlasRequest { texels_per_unit, side: Some(side), largest_side: side, padding };
    let layout = atlas(mesh, &cover, &request, &NoProgress).map_err(refused)?;
    Ok(Unwrapped { uv: layout.uv, charts: layout.charts, padding: layout.padding })
}
