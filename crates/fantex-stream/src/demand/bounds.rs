//! Bounds of pieces of surface: spheres, cones of normals, densities.

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use glam::Vec3;
use rayon::prelude::*;

use super::group_triangles::GroupTriangles;
use super::kites::{Densities, densities, piece_points};
use super::relief::Relief;

/// A ball around all points, mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sphere {
    pub(crate) center: Vec3,
    pub(crate) radius: f32,
}

/// All normals lie within an angle of the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NormalCone {
    /// Unit vector.
    pub(crate) axis: Vec3,
    /// Cosine of the angle; -1 where the normals share no half space.
    pub(crate) cos: f32,
    /// Whether the back is never seen.
    pub(crate) is_culled: bool,
}

/// What demand knows of a group, of a region of a tile or of many groups together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) sphere: Sphere,
    pub(crate) cone: NormalCone,
    /// The fewest texels per mesh unit.
    pub(crate) density: LogDensities,
}

/// Binary logarithms of lower bounds of the two singular values of maps from the surface to texels of level 0, per mesh unit;
/// infinite where there is no surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LogDensities {
    /// Of the smaller one: no direction on the surface has fewer texels.
    pub(crate) least: f32,
    /// Of the larger one: on every triangle some direction has as many.
    pub(crate) most: f32,
}

impl LogDensities {
    /// Of nothing.
    pub(crate) const NOTHING: Self = Self { least: f32::INFINITY, most: f32::INFINITY };

    fn min(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.min(other.most) }
    }
}

/// Gathers bounds in two passes: boxes and mean normals, then radii and angles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gathering {
    low: Vec3,
    high: Vec3,
    normals: Vec3,
    density: LogDensities,
    is_culled: bool,
}

impl Gathering {
    pub(crate) const EMPTY: Self = Self {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        normals: Vec3::ZERO,
        density: LogDensities::NOTHING,
        is_culled: true,
    };

    pub(crate) fn add_point(&mut self, p: Vec3) {
        (self.low, self.high) = (self.low.min(p), self.high.max(p));
    }

    pub(crate) fn add_facet(&mut self, normal: Vec3, densities: Densities, is_culled: bool) {
        let density = LogDensities { least: densities.least.log2(), most: densities.most.log2() };
        self.add_normals(normal, density, is_culled);
    }

    fn add_normals(&mut self, normals: Vec3, density: LogDensities, is_culled: bool) {
        self.normals += normals;
        self.density = self.density.min(density);
        self.is_culled &= is_culled;
    }

    /// The bounds as far as they are known: radius zero, a closed cone.
    pub(crate) fn begin(&self) -> Bounds {
        let center = if self.low.x <= self.high.x { 0.5 * (self.low + self.high) } else { Vec3::ZERO };
        Bounds {
            sphere: Sphere { center, radius: 0.0 },
            cone: NormalCone {
                axis: self.normals.normalize_or(Vec3::Z),
                cos: 1.0,
                is_culled: self.is_culled,
            },
            density: self.density,
        }
    }
}

impl Bounds {
    /// Of nothing.
    pub(crate) const NOTHING: Self = Self {
        sphere: Sphere { center: Vec3::ZERO, radius: 0.0 },
        cone: NormalCone { axis: Vec3::Z, cos: 1.0, is_culled: true },
        density: LogDensities::NOTHING,
    };

    pub(crate) fn widen_to_point(&mut self, p: Vec3) {
        self.sphere.radius = self.sphere.radius.max(self.sphere.center.distance(p));
    }

    pub(crate) fn widen_to_normal(&mut self, normal: Vec3) {
        self.cone.cos = self.cone.cos.min(self.cone.axis.dot(normal));
    }

    pub(crate) fn is_nothing(&self) -> bool {
        self.density == LogDensities::NOTHING
    }

    /// Around several, in order.
    pub(crate) fn around(parts: &[Self]) -> Self {
        let mut gathering = Gathering::EMPTY;
        for part in parts.iter().filter(|p| !p.is_nothing()) {
            gathering.add_point(part.sphere.center - part.sphere.radius);
            gathering.add_point(part.sphere.center + part.sphere.radius);
            gathering.add_normals(part.cone.axis, part.density, part.cone.is_culled);
        }
        if gathering.density == LogDensities::NOTHING {
            return Self::NOTHING;
        }
        let mut around = gathering.begin();
        for part in parts.iter().filter(|p| !p.is_nothing()) {
            let reach = around.sphere.center.distance(part.sphere.center) + part.sphere.radius;
            around.sphere.radius = around.sphere.radius.max(reach);
            let between = around.cone.axis.dot(part.cone.axis).clamp(-1.0, 1.0).acos();
            let angle = between + part.cone.cos.clamp(-1.0, 1.0).acos();
            let cos = if angle < std::f32::consts::PI { angle.cos() } else { -1.0 };
            around.cone.cos = around.cone.cos.min(cos);
        }
        around
    }
}

/// Bounds and reliefs of every group, in parallel; each group adds its triangles in order.
pub(crate) fn group_bounds(
    mesh: &Mesh,
    cover: &Cover,
    triangles: &GroupTriangles,
) -> (Vec<Bounds>, Vec<Relief>) {
    let groups = (0..cover.groups.len() as u32).into_par_iter().with_min_len(1 << 6);
    let bounds = |pieces: &mut Vec<Piece>, group| bounds_of(mesh, cover, group, triangles.of(group), pieces);
    groups.map_init(Vec::new, bounds).unzip()
}

/// What a group has of a triangle.
struct Piece {
    normal: Vec3,
    points: [Vec3; 12],
    count: usize,
}

/// Bounds of one group. `pieces` is scratch.
fn bounds_of(
    mesh: &Mesh,
    cover: &Cover,
    group: u32,
    triangles: &[u32],
    pieces: &mut Vec<Piece>,
) -> (Bounds, Relief) {
    pieces.clear();
    let mut gathering = Gathering::EMPTY;
    for t in triangles.iter().map(|&t| t as usize) {
        let corners = mesh.triangle_positions(t);
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let (points, count) = piece_points(corners, cover.corner_groups[t].map(|g| g == group), cover.delta);
        points[..count].iter().for_each(|&p| gathering.add_point(p));
        gathering.add_facet(normal, densities(mesh, cover, t, group), is_culled(mesh, t));
        pieces.push(Piece { normal, points, count });
    }
    let mut bounds = gathering.begin();
    for piece in pieces.iter() {
        piece.points[..piece.count].iter().for_each(|&p| bounds.widen_to_point(p));
        bounds.widen_to_normal(piece.normal);
    }
    let planes = pieces.iter().map(|piece| (piece.normal, piece.points[0]));
    let group = &cover.groups[group as usize];
    (bounds, Relief::new(group, bounds.sphere.center, bounds.cone.is_culled, planes))
}

/// Whether a triangle's back is never drawn.
pub(crate) fn is_culled(mesh: &Mesh, triangle: usize) -> bool {
    mesh.materials.get(mesh.material_of(triangle)).is_some_and(|material| !material.double_sided)
}
