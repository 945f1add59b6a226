//! Bounds of pieces of surface: spheres, cones of normals, densities.

use std::ops::Range;

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use glam::Vec3;
use rayon::prelude::*;

use super::kites::{Facet, facets};

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
    /// Binary logarithm of the fewest texels per mesh unit in any direction; infinite where there is no surface.
    pub(crate) log2_density: f32,
}

/// Gathers bounds in two passes: boxes and mean normals, then radii and angles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gathering {
    low: Vec3,
    high: Vec3,
    normals: Vec3,
    density: f32,
    is_culled: bool,
}

impl Gathering {
    pub(crate) const EMPTY: Self = Self {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        normals: Vec3::ZERO,
        density: f32::INFINITY,
        is_culled: true,
    };

    pub(crate) fn add_point(&mut self, p: Vec3) {
        (self.low, self.high) = (self.low.min(p), self.high.max(p));
    }

    pub(crate) fn add_facet(&mut self, normal: Vec3, least_density: f32, is_culled: bool) {
        self.normals += normal;
        self.density = self.density.min(least_density);
        self.is_culled &= is_culled;
    }

    fn join(&mut self, other: &Self) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
        self.add_facet(other.normals, other.density, other.is_culled);
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
            log2_density: self.density.log2(),
        }
    }
}

impl Bounds {
    /// Of nothing.
    pub(crate) const NOTHING: Self = Self {
        sphere: Sphere { center: Vec3::ZERO, radius: 0.0 },
        cone: NormalCone { axis: Vec3::Z, cos: 1.0, is_culled: true },
        log2_density: f32::INFINITY,
    };

    pub(crate) fn widen_to_point(&mut self, p: Vec3) {
        self.sphere.radius = self.sphere.radius.max(self.sphere.center.distance(p));
    }

    pub(crate) fn widen_to_normal(&mut self, normal: Vec3) {
        self.cone.cos = self.cone.cos.min(self.cone.axis.dot(normal));
    }

    pub(crate) fn is_nothing(&self) -> bool {
        self.log2_density == f32::INFINITY
    }

    /// Around several, in order.
    pub(crate) fn around(parts: &[Self]) -> Self {
        let mut gathering = Gathering::EMPTY;
        let mut density = f32::INFINITY;
        for part in parts.iter().filter(|p| !p.is_nothing()) {
            gathering.add_point(part.sphere.center - part.sphere.radius);
            gathering.add_point(part.sphere.center + part.sphere.radius);
            gathering.add_facet(part.cone.axis, f32::INFINITY, part.cone.is_culled);
            density = density.min(part.log2_density);
        }
        if density == f32::INFINITY {
            return Self::NOTHING;
        }
        let mut around = gathering.begin();
        around.log2_density = density;
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

/// Bounds of every group. Facets are looked at in parallel, run by run, and added in order.
pub(crate) fn group_bounds(mesh: &Mesh, cover: &Cover) -> Vec<Bounds> {
    let count = mesh.triangles.len().min(cover.corner_groups.len());
    let mut gathered = vec![Gathering::EMPTY; cover.groups.len()];
    for begin in (0..count).step_by(RUN) {
        let gather = |facet: Facet, t: usize| {
            let mut one = Gathering::EMPTY;
            points(&facet).for_each(|p| one.add_point(p));
            one.add_facet(facet.normal, facet.least_density(mesh, cover, t), is_culled(mesh, t));
            one
        };
        for (group, one) in in_order(mesh, cover, begin..count.min(begin + RUN), gather) {
            gathered[group as usize].join(&one);
        }
    }
    let mut bounds: Vec<Bounds> = gathered.iter().map(Gathering::begin).collect();
    for begin in (0..count).step_by(RUN) {
        let widen = |facet: Facet, _| {
            let mut one = bounds[facet.group as usize];
            points(&facet).for_each(|p| one.widen_to_point(p));
            one.widen_to_normal(facet.normal);
            (one.sphere.radius, one.cone.cos)
        };
        for (group, (radius, cos)) in in_order(mesh, cover, begin..count.min(begin + RUN), widen) {
            let bounds = &mut bounds[group as usize];
            bounds.sphere.radius = bounds.sphere.radius.max(radius);
            bounds.cone.cos = bounds.cone.cos.min(cos);
        }
    }
    bounds
}

/// Triangles whose facets are kept at a time.
const RUN: usize = 1 << 17;

/// What `of` says of every facet of some triangles, with the facet's group.
fn in_order<T: Send>(
    mesh: &Mesh,
    cover: &Cover,
    triangles: Range<usize>,
    of: impl Fn(Facet, usize) -> T + Sync,
) -> Vec<(u32, T)> {
    let of = &of;
    let parts: Vec<Vec<(u32, T)>> = triangles
        .into_par_iter()
        .with_min_len(1 << 12)
        .fold(Vec::new, |mut part, t| {
            part.extend(facets(mesh, cover, t).map(|facet| (facet.group, of(facet, t))));
            part
        })
        .collect();
    parts.into_iter().flatten().collect()
}

/// Corners of a facet's kites.
fn points(facet: &Facet) -> impl Iterator<Item = Vec3> {
    facet.kites.into_iter().flatten().flat_map(|kite| kite.points)
}

/// Whether a triangle's back is never drawn.
pub(crate) fn is_culled(mesh: &Mesh, triangle: usize) -> bool {
    mesh.materials.get(mesh.material_of(triangle)).is_some_and(|material| !material.double_sided)
}
