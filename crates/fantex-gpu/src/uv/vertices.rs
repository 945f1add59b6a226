//! Vertices of a mesh with attributes per corner: corners that agree in everything are one vertex.

use fantex_mesh::Mesh;
use fantex_texture::material::{MaterialTextures, normal_map_tangents};
use glam::{Vec2, Vec3, Vec4};

use bytemuck::{Pod, Zeroable};

/// Sets of texture coordinates that materials can use.
pub(super) const MAX_UV_SETS: usize = 4;

/// Attributes of a vertex besides its position and texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Attributes {
    /// -1..1 as -32767..32767; the fourth is unused.
    normal: [i16; 4],
    /// With the handedness.
    tangent: [i16; 4],
    /// Linear RGBA, 0..1 as 0..65535.
    color: [u16; 4],
}

#[derive(Debug, Default)]
pub(super) struct Vertices {
    pub(super) positions: Vec<Vec3>,
    pub(super) attributes: Vec<Attributes>,
    /// Pairs of sets per vertex: none, one or two.
    pub(super) uv: Vec<[Vec2; 2]>,
    pub(super) uv_pairs: usize,
    /// One per triangle of the mesh, in its order.
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The sets of texture coordinates that textures use, ascending.
pub(super) fn used_uv_sets(textures: &[MaterialTextures]) -> Vec<usize> {
    let mut sets: Vec<usize> = textures.iter().flat_map(MaterialTextures::layers).map(|l| l.uv_set).collect();
    sets.sort_unstable();
    sets.dedup();
    sets
}

impl Vertices {
    /// Those of a mesh, of whose texture coordinates `uv_sets` (at most [`MAX_UV_SETS`]) are kept.
    pub(super) fn of_mesh(mesh: &Mesh, textures: &[MaterialTextures], uv_sets: &[usize]) -> Self {
        let normals = fantex_mesh::shading_normals(mesh);
        let tangents = normal_map_tangents(mesh, &normals, textures);
        let uv_pairs = uv_sets.len().div_ceil(2);
        let corner_uv = |corner: usize, pair: usize| {
            let of_set = |i: usize| mesh.corners.uv_sets.get(*uv_sets.get(i)?)?.get(corner).copied();
            [2 * pair, 2 * pair + 1].map(|i| of_set(i).unwrap_or_default())
        };
        let mut vertices = Self { uv_pairs, ..Self::default() };
        // Vertices that share a point of the mesh form a chain.
        const END: u32 = u32::MAX;
        let mut first = vec![END; mesh.positions.len()];
        let mut next: Vec<u32> = Vec::new();
        let mut uv = vec![[Vec2::ZERO; 2]; uv_pairs];
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            let corners = [0, 1, 2].map(|k| {
                let (point, corner) = (triangle[k] as usize, 3 * t + k);
                let tangent = tangents.get(corner).copied().unwrap_or(Vec4::X);
                let color = mesh.corners.colors.get(corner).copied().unwrap_or(Vec4::ONE);
                let attributes = Attributes {
                    normal: normals[corner].extend(0.0).to_array().map(snorm),
                    tangent: tangent.to_array().map(snorm),
                    color: color.to_array().map(unorm),
                };
                (0..uv_pairs).for_each(|pair| uv[pair] = corner_uv(corner, pair));
                let mut vertex = first[point];
                while vertex != END {
                    let own = &vertices.uv[vertex as usize * uv_pairs..][..uv_pairs];
                    if vertices.attributes[vertex as usize] == attributes && own == uv {
                        return vertex;
                    }
                    vertex = next[vertex as usize];
                }
                let vertex = vertices.positions.len() as u32;
                vertices.positions.push(mesh.positions[point]);
                vertices.attributes.push(attributes);
                vertices.uv.extend(&uv);
                next.push(first[point]);
                first[point] = vertex;
                vertex
            });
            vertices.triangles.push(corners);
        }
        vertices
    }
}

fn snorm(v: f32) -> i16 {
    (v.clamp(-1.0, 1.0) * 32767.0).round() as i16
}

fn unorm(v: f32) -> u16 {
    (v.clamp(0.0, 1.0) * 65535.0).round() as u16
}

#[cfg(test)]
mod tests {
    use fantex_mesh::CornerAttributes;

    use super::*;

    /// A square of two triangles with a corner whose texture coordinates differ.
    fn square(seam: bool) -> Mesh {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let triangles: Vec<[u32; 3]> = vec![[0, 1, 2], [0, 2, 3]];
        let mut uv: Vec<Vec2> =
            triangles.iter().flatten().map(|&v| positions[v as usize].truncate()).collect();
        if seam {
            uv[4] = Vec2::splat(0.25);
        }
        Mesh {
            positions,
            triangles,
            corners: CornerAttributes { uv_sets: vec![uv], ..CornerAttributes::default() },
            ..Mesh::default()
        }
    }

    #[test]
    fn corners_that_agree_are_one_vertex() {
        let count = |seam, sets: &[usize]| Vertices::of_mesh(&square(seam), &[], sets).positions.len();
        assert_eq!(count(false, &[0]), 4);
        assert_eq!(count(true, &[0]), 5);
        assert_eq!(count(true, &[]), 4, "coordinates that nobody uses are no difference");
    }

    #[test]
    fn vertices_have_what_their_corners_have() {
        let mesh = square(true);
        let vertices = Vertices::of_mesh(&mesh, &[], &[0]);
        for (t, triangle) in vertices.triangles.iter().enumerate() {
            for (k, &vertex) in triangle.iter().enumerate() {
                let vertex = vertex as usize;
                assert_eq!(vertices.positions[vertex], mesh.positions[mesh.triangles[t][k] as usize]);
                assert_eq!(vertices.uv[vertex][0], mesh.corners.uv_sets[0][3 * t + k]);
            }
        }
    }
}
