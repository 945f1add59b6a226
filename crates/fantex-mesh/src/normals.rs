//! Smooth shading normals for meshes that come without.

use std::ops::Deref;

use fantex_base::UnionFind;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::adjacency::Star;
use crate::{FanCorner, Fans, Mesh, SurfacePoint, VertexCorners, angle_between};

const BLOCK: usize = 1 << 12;
/// Blocks whose results wait to be put in place.
const BLOCKS_AT_ONCE: usize = 64;
/// Among more triangles at one edge than this, none are smoothed across it.
const MAX_SMOOTHED_AT_EDGE: usize = 16;

/// Where a mesh has no normals of its own, edges that bend less than this are shown smooth.
pub const CREASE_DEGREES: f32 = 60.0;

/// Unit normals of the smooth surface, one per corner of a mesh.
#[derive(Clone, Debug)]
pub struct CornerNormals(Vec<Vec3>);

impl CornerNormals {
    /// The [`shading_normals`] of a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        Self(shading_normals(mesh))
    }

    /// Those at the corners of a triangle.
    #[inline]
    pub fn of_triangle(&self, triangle: u32) -> [Vec3; 3] {
        let first = 3 * triangle as usize;
        [self.0[first], self.0[first + 1], self.0[first + 2]]
    }

    /// The interpolated unit normal at a point; the facet's where those of its corners cancel out.
    #[inline]
    pub fn at(&self, mesh: &Mesh, point: SurfacePoint) -> Vec3 {
        let normal = point.interpolate(self.of_triangle(point.triangle));
        normal.try_normalize().unwrap_or_else(|| point.facet_normal(mesh))
    }
}

impl Deref for CornerNormals {
    type Target = [Vec3];

    fn deref(&self) -> &[Vec3] {
        &self.0
    }
}

/// The unit normals, one per corner, that everything shades with: the mesh's own (a facet's where one is no direction), or
/// smooth ones with creases at [`CREASE_DEGREES`].
pub fn shading_normals(mesh: &Mesh) -> Vec<Vec3> {
    let own = &mesh.corners.normals;
    if own.len() != 3 * mesh.triangles.len() {
        return corner_normals(mesh, CREASE_DEGREES);
    }
    let checked = |(corner, &n): (usize, &Vec3)| {
        if n.is_finite() && n.length_squared() > 0.25 { n } else { mesh.facet_normal(corner / 3).as_vec3() }
    };
    own.par_iter().with_min_len(BLOCK).enumerate().map(checked).collect()
}

/// Whether the [`shading_normals`] of two corners at one vertex differ by more than 30 degrees, so that light jumps between them.
#[inline]
pub fn is_crease(normals: &[Vec3], corner: usize, other: usize) -> bool {
    const COSINE: f32 = 0.866_025_4;
    normals[corner].dot(normals[other]) < COSINE
}

/// The [`shading_normals`] without creases: around each vertex where they differ, their mean weighted by the triangles' angles there.
/// Across an edge of two triangles these are continuous. `None` where the shading normals are so already.
///
/// Vertices whose triangles are wound against each other, or whose normals cancel out, keep what they have.
pub fn creaseless_normals(mesh: &Mesh) -> Option<Vec<Vec3>> {
    let fans = Fans::of(&mesh.triangles, &VertexCorners::of(&mesh.triangles, mesh.positions.len()));
    let mut normals = shading_normals(mesh);
    let mut creased = false;
    for fan in 0..fans.len() {
        let corners = fans.corners(fan);
        let normal = |corner: &FanCorner| normals[corner.corner() as usize];
        let first = normal(&corners[0]);
        if corners.iter().any(|corner| corner.reversed() != corners[0].reversed())
            || corners.iter().all(|corner| normal(corner).distance_squared(first) < SAME_NORMAL)
        {
            continue;
        }
        let weighted = |corner: &FanCorner| normal(corner).as_dvec3() * corner_angle(mesh, corner.corner());
        let Some(mean) = corners.iter().map(weighted).sum::<DVec3>().try_normalize() else { continue };
        creased = true;
        corners.iter().for_each(|corner| normals[corner.corner() as usize] = mean.as_vec3());
    }
    creased.then_some(normals)
}

/// Squared distance of normals that are alike.
const SAME_NORMAL: f32 = 1e-8;

/// Unit normals per corner, averaged over the triangles around each vertex and weighted by their angle there (G. Thürmer
/// and C. Wüthrich, "Computing vertex normals from polygonal facets", 1998).
///
/// Only triangles that are connected around the vertex through soft edges are averaged: an edge is soft where the normals
/// of its triangles differ by at most `crease_degrees` (0 gives flat shading, 180 smooths everything that is connected).
/// Separate fans of a non-manifold vertex stay apart.
pub fn corner_normals(mesh: &Mesh, crease_degrees: f32) -> Vec<Vec3> {
    let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let faces: Vec<DVec3> =
        (0..mesh.triangles.len()).into_par_iter().with_min_len(BLOCK).map(|t| mesh.facet_normal(t)).collect();
    let softest = libm::cos(f64::from(crease_degrees).to_radians().min(std::f64::consts::PI)) - 1e-6;
    let block = |smoother: &mut Smoother, first: usize| {
        let mut normals = Vec::new();
        for v in first..corners.len().min(first + BLOCK) {
            smoother.vertex(mesh, &faces, softest, v, corners.at(v), &mut normals);
        }
        normals
    };
    let mut by_corner = vec![Vec3::ZERO; 3 * mesh.triangles.len()];
    for first in (0..corners.len()).step_by(BLOCKS_AT_ONCE * BLOCK) {
        let end = corners.len().min(first + BLOCKS_AT_ONCE * BLOCK);
        let starts: Vec<usize> = (first..end).step_by(BLOCK).collect();
        let blocks: Vec<Vec<Vec3>> = starts.into_par_iter().map_init(Smoother::default, block).collect();
        let in_row_order = (first..end).flat_map(|v| corners.at(v));
        for (&corner, normal) in in_row_order.zip(blocks.into_iter().flatten()) {
            by_corner[corner as usize] = normal;
        }
    }
    by_corner
}

#[derive(Default)]
struct Smoother {
    star: Star,
    /// The vertex' corners that are linked through soft edges.
    groups: UnionFind,
    sums: Vec<DVec3>,
}

impl Smoother {
    fn vertex(
        &mut self,
        mesh: &Mesh,
        faces: &[DVec3],
        softest: f64,
        vertex: usize,
        corners: &[u32],
        normals: &mut Vec<Vec3>,
    ) {
        let face = |slot: u32| faces[corners[slot as usize] as usize / 3];
        self.groups.reset(corners.len());
        self.star.gather(vertex as u32, corners, &mesh.triangles);
        for edge in self.star.edges().filter(|edge| edge.len() <= MAX_SMOOTHED_AT_EDGE) {
            for (i, a) in edge.slots().enumerate() {
                for b in edge.slots().skip(i + 1).filter(|&b| face(a).dot(face(b)) >= softest) {
                    self.groups.union(a, b);
                }
            }
        }
        self.sums.clear();
        self.sums.resize(corners.len(), DVec3::ZERO);
        for (slot, &corner) in corners.iter().enumerate() {
            let group = self.groups.find(slot as u32);
            self.sums[group as usize] += face(slot as u32) * corner_angle(mesh, corner);
        }
        for slot in 0..corners.len() as u32 {
            let group = self.groups.find(slot);
            let normal = self.sums[group as usize].try_normalize().unwrap_or(face(slot));
            normals.push(normal.as_vec3());
        }
    }
}

/// Angle of a triangle at one of its corners, radians.
pub fn corner_angle(mesh: &Mesh, corner: u32) -> f64 {
    let positions = mesh.triangle_positions(corner as usize / 3).map(|p| p.as_dvec3());
    let at = |k: u32| positions[((corner + k) % 3) as usize];
    angle_between(at(1) - at(0), at(2) - at(0))
}
