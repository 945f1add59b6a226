//! The surface that is painted on: who is whose neighbour, and which triangles a tile shows.

use std::sync::{Arc, OnceLock};

use fantex_cover::{Cover, GroupTriangles};
use fantex_mesh::{
    CornerNormals, Edges, Mesh, ObjectSpace, OpposedTriangles, RayHit, SurfacePoint, TriangleBvh, interpolate,
};
use fantex_store::Asset;
use glam::{DVec3, Vec3};

use crate::open_edges::OpenEdges;

/// No half-edge.
const NONE: u32 = u32::MAX;

/// A mesh and its cover with the adjacency that painting needs. Shared by threads; knows no texels.
pub struct Surface {
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
    bvh: TriangleBvh,
    /// Per half-edge `3 * triangle + k` (from corner `k` to `k + 1`) the half-edge on the other side, or `NONE`.
    opposite: Vec<u32>,
    triangles_of_groups: GroupTriangles,
    opposed: OpposedTriangles,
    /// The mesh is closed and wound so that its facets face inwards.
    is_inside_out: bool,
    /// Per corner; made when first asked for.
    normals: OnceLock<CornerNormals>,
    space: ObjectSpace,
    /// Made when first asked for.
    open_edges: OnceLock<OpenEdges>,
}

impl std::fmt::Debug for Surface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Surface").field("triangles", &self.mesh.triangles.len()).finish_non_exhaustive()
    }
}

impl Surface {
    /// Builds the adjacency of an asset's surface (about two seconds for a million triangles).
    pub fn of(asset: &Asset) -> Self {
        Self::new(asset.shared_mesh(), asset.shared_cover())
    }

    /// The same from its parts.
    pub fn new(mesh: Arc<Mesh>, cover: Arc<Cover>) -> Self {
        Self::with_progress(mesh, cover, &|_| {})
    }

    /// The same; `progress` is told the share that is done, 0..1, ascending.
    pub(crate) fn with_progress(mesh: Arc<Mesh>, cover: Arc<Cover>, progress: &dyn Fn(f32)) -> Self {
        let opposite = opposite_edges(&mesh);
        progress(0.35);
        let triangles_of_groups = GroupTriangles::of(&cover);
        progress(0.4);
        let bvh = TriangleBvh::new(&mesh);
        progress(0.85);
        let opposed = OpposedTriangles::of(&mesh.triangles);
        let (is_inside_out, normals) = (is_inside_out(&mesh), OnceLock::new());
        let space = ObjectSpace::of(&mesh);
        progress(1.0);
        let open_edges = OnceLock::new();
        Self {
            mesh,
            cover,
            bvh,
            opposite,
            triangles_of_groups,
            opposed,
            is_inside_out,
            normals,
            space,
            open_edges,
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The cover.
    pub fn cover(&self) -> &Cover {
        &self.cover
    }

    /// Where textures of space are evaluated.
    pub fn space(&self) -> &ObjectSpace {
        &self.space
    }

    /// Rays and nearest points.
    pub fn bvh(&self) -> &TriangleBvh {
        &self.bvh
    }

    /// The point nearest to a mesh-space position, at most so many mesh units away.
    pub fn nearest(&self, position: Vec3, max_distance: f32) -> Option<SurfacePoint> {
        self.bvh.nearest_point(position, max_distance).map(|found| found.point)
    }

    /// The point nearest to a mesh-space position whose triangle faces about the same way as `normal`: the nearest one where
    /// that does, else the nearer one of those before and behind it along the normal, else the nearest one after all.
    pub(crate) fn nearest_facing(&self, position: Vec3, normal: Vec3) -> Option<SurfacePoint> {
        let nearest = self.nearest(position, f32::INFINITY)?;
        let agrees = |point: &SurfacePoint| self.outer_normal(point.triangle).as_vec3().dot(normal) >= 0.0;
        if agrees(&nearest) {
            return Some(nearest);
        }
        let distance = |point: &SurfacePoint| self.position(*point).as_vec3().distance_squared(position);
        let along = [normal, -normal].map(|direction| self.hit(position, direction).filter(agrees));
        let found = along.into_iter().flatten().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        Some(found.unwrap_or(nearest))
    }

    /// The first point on a ray in mesh space; of two sides of a leaf that which is seen.
    pub fn hit(&self, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
        let is_seen = |hit: &RayHit| self.is_seen_from(hit.point.triangle, -direction);
        self.bvh.first_hit_where(origin, direction, f32::INFINITY, is_seen).map(|hit| hit.point)
    }

    /// Whether a triangle is seen by someone in that direction: all are but opposed ones from behind.
    pub(crate) fn is_seen_from(&self, triangle: u32, to_eye: Vec3) -> bool {
        !self.opposed.contains(triangle as usize) || self.facet_normal(triangle).dot(to_eye.as_dvec3()) >= 0.0
    }

    /// Mesh-space position of a point.
    pub fn position(&self, point: SurfacePoint) -> DVec3 {
        interpolate(self.corners(point.triangle), point.lambda.as_dvec3())
    }

    /// Unit normal of a triangle, by its winding; zero for one without area in double precision.
    pub fn facet_normal(&self, triangle: u32) -> DVec3 {
        self.mesh.facet_normal(triangle as usize)
    }

    /// The same on the side that is seen: outwards where the mesh is closed, whichever way it is wound.
    pub fn outer_normal(&self, triangle: u32) -> DVec3 {
        let normal = self.facet_normal(triangle);
        if self.is_inside_out { -normal } else { normal }
    }

    /// Unit normal of the smooth surface.
    pub(crate) fn normal(&self, point: SurfacePoint) -> Vec3 {
        self.normals().at(&self.mesh, point)
    }

    /// Unit normals of the smooth surface, per corner.
    pub(crate) fn normals(&self) -> &CornerNormals {
        self.normals.get_or_init(|| CornerNormals::of(&self.mesh))
    }

    /// Corner positions of a triangle, mesh space.
    pub(crate) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.mesh.triangle_positions(triangle as usize).map(|p| p.as_dvec3())
    }

    /// Vertices and positions of a triangle: a half-edge's start and end, and the corner opposite to it.
    pub(crate) fn turned(&self, half_edge: u32) -> [(u32, DVec3); 3] {
        let (triangle, k) = (half_edge / 3, half_edge as usize % 3);
        let (vertices, corners) = (self.mesh.triangles[triangle as usize], self.corners(triangle));
        [0, 1, 2].map(|i| (vertices[(k + i) % 3], corners[(k + i) % 3]))
    }

    /// The half-edge of the triangle that continues this one's across the edge.
    pub(crate) fn opposite(&self, half_edge: u32) -> Option<u32> {
        let other = self.opposite[half_edge as usize];
        (other != NONE).then_some(other)
    }

    /// The half-edges without an opposite that are at most `gap` mesh units away from such a one and whose triangles lead on,
    /// ascending: those that do not fold back.
    pub(crate) fn open_edges_near(&self, half_edge: u32, gap: f64) -> Vec<u32> {
        let open = self.open_edges.get_or_init(|| OpenEdges::of(self, &self.opposite));
        open.near(self, half_edge, gap)
    }

    /// Some triangle with a corner in a group.
    pub fn triangle_of_group(&self, group: u32) -> Option<u32> {
        self.triangles_of_group(group).first().copied()
    }

    /// The triangles with a corner in a group, ascending.
    pub(crate) fn triangles_of_group(&self, group: u32) -> &[u32] {
        self.triangles_of_groups.of_group(group)
    }
}

/// True where a mesh encloses a negative volume. Open meshes, whose facets do not balance, have no inside.
fn is_inside_out(mesh: &Mesh) -> bool {
    let (mut balance, mut area, mut volume) = (DVec3::ZERO, 0.0, 0.0);
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        let facet = (b - a).cross(c - a);
        balance += facet;
        area += facet.length();
        volume += a.dot(facet);
    }
    balance.length() < 0.05 * area && volume < 0.0
}

/// Pairs the half-edges of triangles that [continue](fantex_mesh::continued_by_angle) each other.
fn opposite_edges(mesh: &Mesh) -> Vec<u32> {
    let mut opposite = vec![NONE; 3 * mesh.triangles.len()];
    let edges = Edges::of(&mesh.triangles);
    for [first, second] in edges.iter().flat_map(|edge| edge.continued_by_angle(&mesh.positions)) {
        opposite[first as usize] = second;
        opposite[second as usize] = first;
    }
    opposite
}
