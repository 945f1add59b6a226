//! The surface as demand sees it: bounds of groups, of blocks of groups, of blocks of blocks.
//!
//! Groups are ordered along a space-filling curve over the surface, so consecutive ones are neighbours, and a tree needs no
//! pointers: block `b` holds groups `32 b ..`, the nodes above hold eight each. Memory: 116 bytes per group, 60 of them for reliefs.

use std::collections::HashMap;
use std::sync::Arc;

use super::bounds::{Bounds, LogDensities, group_bounds};
use super::group_triangles::GroupTriangles;
use super::paged::PagedTile;
use super::relief::Relief;
use crate::Geometry;
use crate::shape::TileShapes;

/// Groups of a block.
pub(crate) const BLOCK: usize = 32;
/// Children of a node.
pub(crate) const FAN_OUT: usize = 8;

/// What all views of a covered mesh share.
pub(crate) struct DemandSurface {
    pub(crate) geometry: Arc<dyn Geometry>,
    pub(crate) shapes: Arc<TileShapes>,
    pub(crate) groups: Vec<Bounds>,
    pub(crate) reliefs: Vec<Relief>,
    /// The groups' densities, close together.
    pub(crate) densities: Vec<LogDensities>,
    /// Blocks, then the nodes over them, up to a single one.
    pub(crate) nodes: Vec<Vec<Bounds>>,
    pub(crate) paged: HashMap<u32, PagedTile>,
    /// Per block whether a tile in it has several pages.
    pub(crate) has_paged: Vec<bool>,
}

impl DemandSurface {
    pub(crate) fn new(geometry: Arc<dyn Geometry>, shapes: Arc<TileShapes>) -> Self {
        let (mesh, cover) = (geometry.mesh(), geometry.cover());
        let count = mesh.triangles.len().min(cover.corner_groups.len());
        let triangles = GroupTriangles::new(cover, count);
        let (groups, reliefs) = group_bounds(mesh, cover, &triangles);
        let mut nodes = vec![groups.chunks(BLOCK).map(Bounds::around).collect::<Vec<_>>()];
        while nodes[nodes.len() - 1].len() > 1 {
            let next = nodes[nodes.len() - 1].chunks(FAN_OUT).map(Bounds::around).collect();
            nodes.push(next);
        }
        let paged: HashMap<u32, PagedTile> = (0..groups.len() as u32)
            .filter(|&g| shapes.of(g).is_paged())
            .map(|g| (g, PagedTile::new(g, triangles.of(g).to_vec())))
            .collect();
        let has_paged = (0..groups.len() as u32)
            .collect::<Vec<_>>()
            .chunks(BLOCK)
            .map(|block| block.iter().any(|g| paged.contains_key(g)))
            .collect();
        let densities = groups.iter().map(|bounds| bounds.density).collect();
        Self { geometry, shapes, groups, reliefs, densities, nodes, paged, has_paged }
    }

    /// Of a ball around everything, mesh units; zero where there is nothing.
    pub(crate) fn radius(&self) -> f32 {
        self.nodes.last().and_then(|root| root.first()).map_or(0.0, |root| root.sphere.radius)
    }
}
