//! The triangles of a covered mesh, as vertex buffers.
//!
//! Triangles whose three corners share one projected group are *plain*: indexed, with the tile coordinate as an ordinary
//! attribute. A vertex is shared by all plain triangles that agree on group and normal there. All others are *border*
//! triangles: three vertices each, with a coordinate pair and a group per corner; the vertex' number modulo three says which
//! barycentric coordinate is one.
//!
//! Vertex buffers, because software adapters read storage buffers lane by lane: vertices pulled from these take 1.2 to 1.4 times as long,
//! records of whole triangles found per fragment three times as long as an ordinary texture (`docs/benchmarks.md`).

use bytemuck::{Pod, Zeroable};
use fantex_cover::{Cover, Group, GroupKind};
use fantex_mesh::{AlphaMode, Mesh, OpposedTriangles};
use fantex_store::PAGE;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// A vertex of triangles that lie in one tile.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct PlainVertex {
    /// Mesh space.
    pub position: [f32; 3],
    /// On the unfolded octahedron, see [`from_octahedral`].
    pub normal: [i16; 2],
    /// Tile coordinates.
    pub uv: [f32; 2],
    /// The tile's group.
    pub group: u32,
}

/// A corner of a triangle that lies in several tiles, or in one that is unfolded.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct BorderVertex {
    /// Mesh space.
    pub position: [f32; 3],
    /// On the unfolded octahedron, see [`from_octahedral`].
    pub normal: [i16; 2],
    /// This corner's coordinates in the tiles of the groups at the triangle's corners 0, 1, 2.
    pub uv: [[f32; 2]; 3],
    /// These groups, the same at all three vertices.
    pub groups: [u32; 3],
}

/// Triangles per chunk. The largest buffer of one, 82 MB if all are border triangles, keeps below every common limit.
pub const CHUNK_TRIANGLES: usize = 1 << 19;

/// Some of the triangles, in buffers of bounded length.
#[derive(Debug, Default)]
pub struct GeometryChunk {
    /// Vertices of plain triangles.
    pub plain_vertices: Vec<PlainVertex>,
    /// Three per plain triangle.
    pub plain_indices: Vec<u32>,
    /// Three per border triangle.
    pub border_vertices: Vec<BorderVertex>,
    /// Triangles that are drawn alike, in order.
    pub runs: Vec<MaterialRun>,
}

/// Triangles of a chunk that are drawn alike.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaterialRun {
    /// Number of the material.
    pub material: u32,
    /// Whether any of their tiles is larger than a page.
    pub is_paged: bool,
    /// Whether they are opposed by others, and so are not seen from behind.
    pub is_opposed: bool,
    /// Their plain indices.
    pub plain: std::ops::Range<u32>,
    /// Their border vertices.
    pub border: std::ops::Range<u32>,
}

/// What vertex buffers are made from.
#[derive(Clone, Copy, Debug)]
pub struct GeometrySource<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Its cover.
    pub cover: &'a Cover,
    /// Unit normals, one per corner.
    pub normals: &'a [Vec3],
    /// Triangles that lie on others and face away from them.
    pub opposed: &'a OpposedTriangles,
}

impl<'a> GeometrySource<'a> {
    /// Numbers of the triangles that hide what lies behind them or are cut out, and of those that are blended; by material
    /// and what else is drawn apart, else in the mesh's order.
    pub fn order(&self) -> [Vec<u32>; 2] {
        let materials = &self.mesh.materials;
        let is_blended = |t: u32| {
            let material = materials.get(self.material(t) as usize);
            material.is_some_and(|m| m.alpha == AlphaMode::Blend)
        };
        let (blended, mut solid): (Vec<u32>, Vec<u32>) =
            (0..self.mesh.triangles.len() as u32).partition(|&t| is_blended(t));
        let is_uniform =
            materials.len() <= 1 && self.opposed.is_empty() && self.cover.groups.iter().all(|g| !is_paged(g));
        if !is_uniform {
            solid.par_sort_by_key(|&t| self.run_key(t));
        }
        [solid, blended]
    }

    /// Makes the chunks one after the other (so that no more than one is in memory beside its buffers) and hands them on.
    pub fn chunks(self, order: &'a [u32]) -> impl Iterator<Item = GeometryChunk> + 'a {
        let mut first_at = vec![0; self.mesh.positions.len()];
        order.chunks(CHUNK_TRIANGLES).map(move |triangles| self.chunk(triangles, &mut first_at))
    }

    fn chunk(&self, triangles: &[u32], first_at: &mut [u32]) -> GeometryChunk {
        let mut chunk = GeometryChunk::default();
        let mut sharing = Sharing { first_at, links: Vec::new() };
        for run in triangles.chunk_by(|&a, &b| self.run_key(a) == self.run_key(b)) {
            let (plain_first, border_first) = (chunk.plain_indices.len(), chunk.border_vertices.len());
            for &triangle in run {
                match self.plain_group(triangle as usize) {
                    Some(group) => {
                        let corners = self.plain_corners(triangle as usize, group);
                        let vertices = self.mesh.triangles[triangle as usize];
                        for (vertex, mesh_vertex) in corners.into_iter().zip(vertices) {
                            let index = sharing.index(&mut chunk.plain_vertices, mesh_vertex, vertex);
                            chunk.plain_indices.push(index);
                        }
                    }
                    None => chunk.border_vertices.extend(self.border_corners(triangle as usize)),
                }
            }
            let (material, is_opposed, is_paged) = self.run_key(run[0]);
            chunk.runs.push(MaterialRun {
                material,
                is_paged,
                is_opposed,
                plain: plain_first as u32..chunk.plain_indices.len() as u32,
                border: border_first as u32..chunk.border_vertices.len() as u32,
            });
        }
        chunk
    }

    /// Number of a triangle's material.
    pub fn material(&self, triangle: u32) -> u32 {
        self.mesh.material_of(triangle as usize) as u32
    }

    /// Material, whether it is opposed, and whether any tile is larger than a page.
    fn run_key(&self, triangle: u32) -> (u32, bool, bool) {
        let groups = self.cover.corner_groups[triangle as usize];
        let is_paged = groups.iter().any(|&g| is_paged(&self.cover.groups[g as usize]));
        (self.material(triangle), self.opposed.contains(triangle as usize), is_paged)
    }

    /// The projected group that all corners share, if there is one.
    fn plain_group(&self, triangle: usize) -> Option<u32> {
        let [a, b, c] = self.cover.corner_groups[triangle];
        let shared = a == b && b == c && self.cover.groups[a as usize].kind == GroupKind::Projected;
        shared.then_some(a)
    }

    fn plain_corners(&self, triangle: usize, group: u32) -> [PlainVertex; 3] {
        let uv = self.cover.tile_corners(self.mesh, triangle, 0);
        let positions = self.mesh.triangle_positions(triangle);
        std::array::from_fn(|k| PlainVertex {
            position: positions[k].to_array(),
            normal: octahedral(self.normals[3 * triangle + k]),
            uv: uv[k].to_array(),
            group,
        })
    }

    /// A triangle's corners as those of a border triangle.
    pub fn border_corners(&self, triangle: usize) -> [BorderVertex; 3] {
        let uv = [0, 1, 2].map(|slot| self.cover.tile_corners(self.mesh, triangle, slot));
        let positions = self.mesh.triangle_positions(triangle);
        std::array::from_fn(|k| BorderVertex {
            position: positions[k].to_array(),
            normal: octahedral(self.normals[3 * triangle + k]),
            uv: uv.map(|corners: [Vec2; 3]| corners[k].to_array()),
            groups: self.cover.corner_groups[triangle],
        })
    }
}

/// Whether a tile's finest level is cut into several pages.
pub fn is_paged(group: &Group) -> bool {
    group.extent[0].max(group.extent[1]) > PAGE
}

/// Finds vertices that are there already: per vertex of the mesh a list of those made from it. Nothing is ever cleared: an
/// entry counts only if the vertex that it names says that it was made from this vertex of the mesh (P. Briggs and
/// L. Torczon, "An Efficient Representation for Sparse Sets", 1993).
struct Sharing<'a> {
    first_at: &'a mut [u32],
    /// Per vertex made: the mesh's vertex, and the next one made from the same (or itself).
    links: Vec<[u32; 2]>,
}

impl Sharing<'_> {
    fn index(&mut self, made: &mut Vec<PlainVertex>, mesh_vertex: u32, vertex: PlainVertex) -> u32 {
        let new = made.len() as u32;
        let mut at = self.first_at[mesh_vertex as usize];
        let known = self.links.get(at as usize).is_some_and(|[of, _]| *of == mesh_vertex);
        if known {
            loop {
                let there = &made[at as usize];
                if there.group == vertex.group && there.normal == vertex.normal {
                    return at;
                }
                let [_, next] = self.links[at as usize];
                if next == at {
                    break;
                }
                at = next;
            }
        }
        let next = if known { self.first_at[mesh_vertex as usize] } else { new };
        self.links.push([mesh_vertex, next]);
        self.first_at[mesh_vertex as usize] = new;
        made.push(vertex);
        new
    }
}

/// A unit vector on the unfolded octahedron, each coordinate -1..1 in 16 bits (Z. Cigolle et al., "A Survey of Efficient
/// Representations for Independent Unit Vectors", 2014). The error is below 5e-5 radians.
fn octahedral(n: Vec3) -> [i16; 2] {
    let p = n.truncate() / (n.x.abs() + n.y.abs() + n.z.abs()).max(1e-12);
    let sign = |v: f32| if v < 0.0 { -1.0 } else { 1.0 };
    let folded =
        if n.z < 0.0 { Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y)) } else { p };
    folded.to_array().map(|v| (v.clamp(-1.0, 1.0) * 32767.0).round() as i16)
}

/// The unit vector of [`PlainVertex::normal`] and [`BorderVertex::normal`].
pub fn from_octahedral([x, y]: [i16; 2]) -> Vec3 {
    let [x, y] = [x, y].map(|v| f32::from(v) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let t = (-z).max(0.0);
    Vec3::new(x - t.copysign(x), y - t.copysign(y), z).normalize()
}

#[cfg(test)]
mod tests {
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{CleanOptions, clean, generate, shading_normals};

    use super::*;

    #[test]
    fn octahedral_normals_come_back() {
        for i in 0..2000 {
            let (a, z) = (i as f32 * 2.399_963, i as f32 / 999.5 - 1.0);
            let n = Vec3::new(a.cos(), a.sin(), 0.0) * (1.0 - z * z).max(0.0).sqrt() + Vec3::Z * z;
            assert!(from_octahedral(octahedral(n)).angle_between(n) < 6e-4, "{n}");
            assert!(from_octahedral(octahedral(n)).distance(n) < 7e-5, "{n}");
        }
    }

    #[test]
    fn every_triangle_is_drawn_once_with_its_own_corners() {
        let (mut mesh, _) = clean(generate::icosphere(4), &CleanOptions::default()).unwrap();
        mesh.materials = vec![mesh.materials.first().cloned().unwrap_or_default(); 3];
        mesh.triangle_materials = (0..mesh.triangles.len() as u32).map(|t| t / 7 % 3).collect();
        let options =
            CoverOptions { tile: 48, budget: TexelBudget::Total(1 << 18), ..CoverOptions::default() };
        let cover = build_cover(&mesh, &options).unwrap().0;
        let normals = shading_normals(&mesh);
        let opposed = OpposedTriangles::of(&mesh.triangles);
        let source = GeometrySource { mesh: &mesh, cover: &cover, normals: &normals, opposed: &opposed };
        let [order, blended] = source.order();
        assert!(blended.is_empty());
        let chunk = source.chunk(&order, &mut vec![0; mesh.positions.len()]);
        let (mut plain, mut border) = (chunk.plain_indices.chunks(3), chunk.border_vertices.chunks(3));
        for &t in &order {
            let positions = mesh.triangle_positions(t as usize).map(|p| p.to_array());
            let seen: Vec<_> = if source.plain_group(t as usize).is_some() {
                plain.next().unwrap().iter().map(|&i| chunk.plain_vertices[i as usize].position).collect()
            } else {
                border.next().unwrap().iter().map(|v| v.position).collect()
            };
            assert_eq!(seen, positions);
        }
        assert!(plain.next().is_none() && border.next().is_none());
        assert_eq!(chunk.runs.iter().map(|r| r.material).collect::<Vec<_>>(), [0, 1, 2]);
        // Shared: far fewer vertices than corners.
        assert!(chunk.plain_vertices.len() * 3 < chunk.plain_indices.len() * 2);
        assert!(!chunk.plain_indices.is_empty() && !chunk.border_vertices.is_empty());
    }
}
