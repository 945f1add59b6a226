//! Vertex arrays for a page: all triangles in one indexed geometry.
//!
//! Plain and border triangles (see [`fantex_stream::drawing`]) get the same attributes, so that one material may draw both: a plain triangle
//! is one that has the same tile at its three corners. They lie in runs of their own, for materials that do no more than they need.

use fantex_mesh::{Mesh, OpposedTriangles, WorldFromMesh, shading_normals};
use fantex_store::Asset;
use fantex_stream::drawing::{
    BorderVertex, GeometryChunk, GeometrySource, MaterialRun, PlainVertex, from_octahedral, is_paged,
};
use glam::{DVec3, Vec3};
use wasm_bindgen::prelude::*;

/// Greatest distance of a model from its file's origin, in radii, at which single precision still holds its coordinates.
const MAX_RADII_FROM_ORIGIN: f64 = 64.0;

/// Triangles of an asset as vertex arrays.
#[wasm_bindgen(getter_with_clone)]
#[derive(Clone, Debug, Default)]
pub struct FanGeometry {
    /// Three per vertex; the file's units, relative to the origin of [`ObjectSpace`].
    pub positions: Vec<f32>,
    /// Three per vertex, -32767 to 32767.
    pub normals: Vec<i16>,
    /// Four per vertex: places in the tiles of the triangle's corners 0 and 1.
    pub uv01: Vec<f32>,
    /// Two per vertex: the place in the tile of corner 2.
    pub uv2: Vec<f32>,
    /// Three per vertex: the groups at the triangle's corners.
    pub groups: Vec<u32>,
    /// Four per vertex: 255 at the number of its corner, else 0.
    pub corners: Vec<u8>,
    /// Three per triangle.
    pub indices: Vec<u32>,
    /// Six per run of triangles that are drawn alike: first index, number of indices, material, whether they are opposed by others, whether
    /// they lie in several tiles each, whether any of their tiles is larger than a page.
    pub runs: Vec<u32>,
    /// Whether any tile is larger than a page.
    pub is_paged: bool,
}

/// Where a mesh lies in the page's object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObjectSpace {
    pub(crate) object_from_mesh: WorldFromMesh,
    /// Of the object, in the file's coordinates.
    pub(crate) origin: DVec3,
}

impl ObjectSpace {
    /// The file's coordinates as they are, unless single precision is too coarse for them; then relative to the model's middle.
    pub(crate) fn of(mesh: &Mesh) -> Self {
        let space = mesh.world_from_mesh;
        let is_far = space.offset.length() > MAX_RADII_FROM_ORIGIN * space.scale;
        let origin = if is_far { space.offset } else { DVec3::ZERO };
        Self { object_from_mesh: WorldFromMesh { offset: space.offset - origin, ..space }, origin }
    }

    fn object_point(&self, mesh: [f32; 3]) -> [f32; 3] {
        self.object_from_mesh.point(Vec3::from(mesh)).as_vec3().to_array()
    }
}

impl FanGeometry {
    /// All triangles; those that are blended come last.
    pub(crate) fn new(asset: &Asset, space: &ObjectSpace) -> Self {
        let (mesh, cover) = (asset.mesh(), asset.cover());
        let normals = shading_normals(mesh);
        let opposed = OpposedTriangles::of(&mesh.triangles);
        let source = GeometrySource { mesh, cover, normals: &normals, opposed: &opposed };
        let mut geometry = Self { is_paged: cover.groups.iter().any(is_paged), ..Self::default() };
        for order in &source.order() {
            for chunk in source.chunks(order) {
                geometry.add(&chunk, space);
            }
        }
        geometry
    }

    fn add(&mut self, chunk: &GeometryChunk, space: &ObjectSpace) {
        let first_plain = self.vertices();
        for PlainVertex { position, normal, uv, group } in &chunk.plain_vertices {
            self.vertex(space.object_point(*position), *normal, [*uv; 3], [*group; 3], 0);
        }
        let first_border = self.vertices();
        for (BorderVertex { position, normal, uv, groups }, corner) in
            chunk.border_vertices.iter().zip([0, 1, 2].into_iter().cycle())
        {
            self.vertex(space.object_point(*position), *normal, *uv, *groups, corner);
        }
        for run in &chunk.runs {
            let first = self.indices.len() as u32;
            let plain = &chunk.plain_indices[run.plain.start as usize..run.plain.end as usize];
            self.indices.extend(plain.iter().map(|index| first_plain + index));
            self.run(first, run, false);
            let first = self.indices.len() as u32;
            self.indices.extend(run.border.clone().map(|vertex| first_border + vertex));
            self.run(first, run, true);
        }
    }

    fn vertices(&self) -> u32 {
        (self.positions.len() / 3) as u32
    }

    fn vertex(
        &mut self,
        position: [f32; 3],
        normal: [i16; 2],
        [uv0, uv1, uv2]: [[f32; 2]; 3],
        groups: [u32; 3],
        corner: usize,
    ) {
        self.positions.extend(position);
        self.normals.extend(from_octahedral(normal).to_array().map(|n| (n * 32767.0).round() as i16));
        self.uv01.extend([uv0[0], uv0[1], uv1[0], uv1[1]]);
        self.uv2.extend(uv2);
        self.groups.extend(groups);
        let mut corners = [0; 4];
        corners[corner] = 255;
        self.corners.extend(corners);
    }

    /// Indices from `first` on, if there are any; they join the run before where they are drawn like it.
    fn run(&mut self, first: u32, run: &MaterialRun, is_border: bool) {
        let count = self.indices.len() as u32 - first;
        if count == 0 {
            return;
        }
        let kind = [run.material, run.is_opposed.into(), is_border.into(), run.is_paged.into()];
        let last = self.runs.len().saturating_sub(6);
        match self.runs.get_mut(last..) {
            Some([_, before, rest @ ..]) if *rest == kind => *before += count,
            _ => self.runs.extend([first, count].into_iter().chain(kind)),
        }
    }
}
