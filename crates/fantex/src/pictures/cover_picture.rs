//! The cover on the model: every group in its colour, the blend bands as mixed colours.

use fantex::cover::Cover;
use fantex::mesh::Mesh;
use fantex::render::{FlatShading, FlatSurface, Hit, Picture, RenderOptions};
use glam::Vec3;

use crate::error::CliError;
use crate::scene::{photograph, portrait};

/// Draws the cover with one colour per group.
pub(super) fn draw(
    mesh: &Mesh,
    cover: &Cover,
    colors: &[Vec3],
    options: &RenderOptions,
) -> Result<Picture, CliError> {
    let color = |hit: &Hit| {
        let groups = cover.corner_groups[hit.triangle];
        let weights = cover.weights(hit.triangle, hit.lambda);
        weights.iter().map(|(slot, weight)| colors[groups[slot] as usize] * weight).sum()
    };
    let surface = FlatSurface::new(mesh, FlatShading::Smooth, color);
    Ok(photograph(mesh, &surface, &portrait(mesh, options), options)?.picture)
}
