//! Vertices as glTF wants them: one index for position, normal, tangent and texture coordinates.

use fantex_mesh::{Mesh, VertexCorners};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::layout::Layout;

/// The mesh with its layout, split where attributes differ.
#[derive(Clone, Debug, Default)]
pub(crate) struct Geometry {
    /// World units, relative to `translation`.
    pub(crate) positions: Vec<Vec3>,
    /// Unit.
    pub(crate) normals: Vec<Vec3>,
    /// Unit, handedness in w; empty where none are needed.
    pub(crate) tangents: Vec<Vec4>,
    /// Origin top left.
    pub(crate) uv: Vec<Vec2>,
    /// The triangles of each material that has some, counter-clockwise seen from outside.
    pub(crate) by_material: Vec<(usize, Vec<[u32; 3]>)>,
    /// Zero unless single precision is too coarse for the world's coordinates.
    pub(crate) translation: DVec3,
}

impl Geometry {
    /// `normals` has an entry per corner; `tangents` too, or is empty.
    pub(crate) fn new(mesh: &Mesh, layout: &Layout, normals: &[Vec3], tangents: &[Vec4]) -> Self {
        let world = |v: usize| mesh.world_from_mesh.point(mesh.positions[v]);
        let is_exact = (0..mesh.positions.len()).all(|v| world(v).as_vec3().as_dvec3() == world(v));
        let translation = if is_exact { DVec3::ZERO } else { mesh.world_from_mesh.offset };
        let mut geometry = Self { translation, ..Self::default() };
        let mut vertex_of_corner = vec![0; 3 * mesh.triangles.len()];
        let around = VertexCorners::of(&mesh.triangles, mesh.positions.len());
        let uv = |corner: usize| layout.uv[corner / 3][corner % 3];
        let attributes = |corner: usize| {
            let tangent = tangents.get(corner).copied().unwrap_or_default();
            let (n, t) = (normals[corner], uv(corner));
            [n.x, n.y, n.z, t.x, t.y, tangent.x, tangent.y, tangent.z, tangent.w].map(f32::to_bits)
        };
        let mut distinct: Vec<([u32; 9], u32)> = Vec::new();
        for v in 0..around.len() {
            distinct.clear();
            for &corner in around.at(v) {
                let corner = corner as usize;
                let own = attributes(corner);
                let known = distinct.iter().find(|(other, _)| *other == own).map(|d| d.1);
                vertex_of_corner[corner] = known.unwrap_or_else(|| {
                    let index = geometry.positions.len() as u32;
                    geometry.positions.push((world(v) - translation).as_vec3());
                    geometry.normals.push(normals[corner]);
                    geometry.tangents.extend(tangents.get(corner));
                    geometry.uv.push(uv(corner));
                    distinct.push((own, index));
                    index
                });
            }
        }
        for material in 0..mesh.materials.len().max(1) {
            let own = (0..mesh.triangles.len()).filter(|&t| mesh.material_of(t) == material);
            let triangles: Vec<[u32; 3]> =
                own.map(|t| [0, 1, 2].map(|k| vertex_of_corner[3 * t + k])).collect();
            if !triangles.is_empty() {
                geometry.by_material.push((material, triangles));
            }
        }
        geometry
    }

    /// Number of triangles.
    pub(crate) fn triangle_count(&self) -> usize {
        self.by_material.iter().map(|(_, triangles)| triangles.len()).sum()
    }

    /// The sections of the binary buffer, in order: positions, normals, tangents, texture coordinates, indices. None is
    /// empty but that of the tangents.
    pub(crate) fn section_bytes(&self) -> [u64; 5] {
        let vertices = self.positions.len() as u64;
        let tangents = self.tangents.len() as u64;
        [12 * vertices, 12 * vertices, 16 * tangents, 8 * vertices, 12 * self.triangle_count() as u64]
    }

    /// Writes the sections.
    pub(crate) fn write(&self, out: &mut impl std::io::Write) -> std::io::Result<()> {
        write_floats(self.positions.iter().map(Vec3::to_array), out)?;
        write_floats(self.normals.iter().map(Vec3::to_array), out)?;
        write_floats(self.tangents.iter().map(Vec4::to_array), out)?;
        write_floats(self.uv.iter().map(Vec2::to_array), out)?;
        let indices = self.by_material.iter().flat_map(|(_, triangles)| triangles.as_flattened());
        indices.copied().try_for_each(|i| out.write_all(&i.to_le_bytes()))
    }
}

fn write_floats<const N: usize>(
    vectors: impl Iterator<Item = [f32; N]>,
    out: &mut impl std::io::Write,
) -> std::io::Result<()> {
    vectors.flatten().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
