//! Coarse assets of a world: what several previews, or several finer coarse assets, show together.
//!
//! ```text
//!  previews of a run of sectors --join--> one surface --fewer triangles, outline as it is--> coarse mesh --bake from the surface--> coarse asset
//! ```

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use fantex_bake::{AssetSource, Progress, Source, SourceChannel, TexelPoint};
use fantex_base::Result;
use fantex_mesh::{Mesh, SurfacePoint, WorldFromMesh, shading_normals};
use fantex_store::{Asset, PageCache};
use glam::{Vec3, Vec4};

use crate::PreviewOptions;
use crate::joined::{FirstTriangles, JoinedMesh};
use crate::preview::write_coarse;

/// A position in a mesh space, to the last bit; both zeros are the same.
pub(crate) type Place = [u32; 3];

pub(crate) fn place(p: Vec3) -> Place {
    p.to_array().map(|x| (x + 0.0).to_bits())
}

/// Meshes with the same materials as one, with materials and shading normals. Vertices at the same place are one vertex.
pub(crate) fn joined<'m>(meshes: impl Iterator<Item = &'m Mesh>, space: WorldFromMesh) -> JoinedMesh {
    let mut joined = JoinedMesh::new(space);
    for mesh in meshes {
        joined.add(mesh);
        let Mesh { corners, triangle_materials, materials, .. } = &mut joined.mesh;
        corners.normals.extend(shading_normals(mesh));
        triangle_materials
            .extend((0..mesh.triangles.len()).map(|triangle| mesh.material_of(triangle) as u32));
        if materials.is_empty() {
            materials.clone_from(&mesh.materials);
        }
    }
    weld(&mut joined.mesh);
    joined
}

fn weld(mesh: &mut Mesh) {
    let (mut numbers, mut positions) = (HashMap::with_capacity(mesh.positions.len()), Vec::new());
    let number = |&p: &Vec3| {
        *numbers.entry(place(p)).or_insert_with(|| {
            positions.push(p);
            positions.len() as u32 - 1
        })
    };
    let numbers: Vec<u32> = mesh.positions.iter().map(number).collect();
    mesh.triangles.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
    mesh.positions = positions;
}

/// What several small assets show that lie side by side and have the same channels and materials: a surface and the source of its look.
pub(crate) struct FinerSurface {
    mesh: Mesh,
    firsts: FirstTriangles,
    sources: Vec<AssetSource>,
    channels: Vec<SourceChannel>,
}

impl FinerSurface {
    /// At least one asset. Decoded texels take at most `memory_bytes`.
    pub(crate) fn of(assets: &[Arc<Asset>], space: WorldFromMesh, memory_bytes: u64) -> Self {
        let JoinedMesh { mesh, firsts } = joined(assets.iter().map(|asset| asset.mesh()), space);
        let share = usize::try_from(memory_bytes / assets.len() as u64).unwrap_or(usize::MAX);
        let source = |asset: &Arc<Asset>| AssetSource::new(&PageCache::new(Arc::clone(asset), share));
        let sources: Vec<AssetSource> = assets.iter().map(source).collect();
        let channels = sources[0].channels();
        debug_assert!(sources.iter().all(|source| source.channels() == channels), "other channels");
        Self { mesh, firsts, sources, channels }
    }

    /// The surface.
    pub(crate) fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Its vertices at some places, ascending.
    pub(crate) fn vertices_at(&self, places: &HashSet<Place>) -> Vec<u32> {
        let vertices = (0u32..).zip(&self.mesh.positions);
        vertices.filter(|(_, p)| places.contains(&place(**p))).map(|(vertex, _)| vertex).collect()
    }

    /// Writes the asset of a coarser [mesh](crate::preview::coarse_mesh) that looks like this surface. Of `progress` only cancellation counts.
    ///
    /// # Errors
    /// As [`Preview::of`](crate::Preview::of); the file cannot be written, or is there.
    pub(crate) fn write_coarse(
        &self,
        coarse: &Mesh,
        options: &PreviewOptions,
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        write_coarse(coarse, (&self.mesh, self), options, path, progress).map(drop)
    }
}

impl Source for FinerSurface {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        // Mesh spaces differ in place and scale, not in direction.
        let (asset, triangle) = self.firsts.locate(point.at.triangle);
        let at = SurfacePoint { triangle, ..point.at };
        self.sources[asset].evaluate(&TexelPoint { at, ..*point }, values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_side_by_side_become_one() {
        let space = WorldFromMesh::default();
        let triangle = |x: f32| Mesh {
            positions: vec![Vec3::X * x, Vec3::X * (x + 0.25), Vec3::new(x, 0.5, -0.0)],
            triangles: vec![[0, 1, 2]],
            world_from_mesh: space,
            ..Mesh::default()
        };
        let mut moved = triangle(0.25);
        moved.move_to(WorldFromMesh { offset: glam::DVec3::ONE, scale: 4.0 });
        let meshes = [triangle(0.0), moved, triangle(0.5)];
        let JoinedMesh { mesh, firsts } = joined(meshes.iter(), space);
        assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 4], [3, 5, 6]]);
        assert_eq!(mesh.positions[3], Vec3::X * 0.5);
        assert_eq!((mesh.corners.normals.len(), mesh.triangle_materials.len()), (9, 3));
        assert_eq!([0, 1, 2].map(|triangle| firsts.locate(triangle)), [(0, 0), (1, 0), (2, 0)]);
    }
}
