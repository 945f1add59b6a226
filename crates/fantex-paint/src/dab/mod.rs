//! Dabs: one touch of the brush, as a function on the surface.

mod chart;
mod region;

pub(crate) use chart::Chart;
pub use region::{Region, RegionTriangle};

use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::{Stamp, Surface, SurfacePoint};

/// One touch of the brush.
#[derive(Clone, Debug)]
pub struct Dab {
    /// Where.
    pub center: SurfacePoint,
    /// Mesh units along the surface.
    pub radius: f32,
    /// Share of the radius within which the dab is full, 0..1.
    pub hardness: f32,
    /// Coverage that it adds at its centre, 0..1.
    pub flow: f32,
    /// Of the stamp, radians, counter-clockwise on the surface.
    pub angle: f32,
    /// Width over length, above 0 up to 1: an ellipse that is the radius long, along the stamp's x axis. 1 is round.
    pub aspect: f32,
    /// Its picture, if any.
    pub stamp: Option<Arc<Stamp>>,
}

/// The flattest dab.
const LEAST_ASPECT: f32 = 0.05;

/// A dab with the part of the surface that it covers.
#[derive(Clone, Debug)]
pub(crate) struct PlacedDab {
    pub(crate) region: Region,
    dab: Dab,
    /// Mesh space.
    center: Vec3,
    /// The stamp's axes in the tangent plane, divided by the ellipse's radii.
    axes: [Vec3; 2],
    /// Distances at which the fall-off starts and ends.
    fade: [f32; 2],
}

impl PlacedDab {
    /// `texel`: the length of a texel in mesh units; even a hard brush fades over one and a half of them.
    pub(crate) fn new(surface: &Surface, dab: &Dab, texel: f32) -> Self {
        let radius = dab.radius.max(texel * 0.5);
        let end = radius + 0.75 * texel;
        let start = (radius * dab.hardness.clamp(0.0, 1.0)).min(end - 1.5 * texel).max(0.0);
        let normal = surface.outer_normal(dab.center.triangle);
        let (x, y) = tangent_axes(normal);
        let (sin, cos) = f64::from(dab.angle).sin_cos();
        let [along, across] =
            [x * cos + y * sin, y * cos - x * sin].map(|axis| (axis / f64::from(radius)).as_vec3());
        let axes = [along, across / dab.aspect.clamp(LEAST_ASPECT, 1.0)];
        Self {
            region: Region::grow(surface, dab.center, end),
            center: surface.position(dab.center).as_vec3(),
            axes,
            fade: [start, end],
            dab: dab.clone(),
        }
    }

    /// Distance along the surface at which it ends, mesh units.
    pub(crate) fn reach(&self) -> f32 {
        self.fade[1]
    }

    /// Coverage that the dab adds at a point of a triangle of its region, 0..1.
    #[inline]
    pub(crate) fn coverage(&self, triangle: &RegionTriangle, lambda: Vec3, position: Vec3) -> f32 {
        let [start, end] = self.fade;
        let distance = triangle.distance(lambda);
        if distance >= end {
            return 0.0;
        }
        let distance = if self.dab.aspect < 1.0 { self.stretched(distance, position) } else { distance };
        if distance >= end {
            return 0.0;
        }
        let s = ((distance - start) / (end - start)).max(0.0);
        let falloff = 1.0 - s * s * (3.0 - 2.0 * s);
        let stamp = self.dab.stamp.as_ref().map_or(1.0, |stamp| {
            let q = position - self.center;
            stamp.coverage(q.dot(self.axes[0]), q.dot(self.axes[1]))
        });
        self.dab.flow * falloff * stamp
    }
}

impl PlacedDab {
    /// A distance along the surface in the measure of an ellipse: longer across it.
    fn stretched(&self, distance: f32, position: Vec3) -> f32 {
        let q = position - self.center;
        let [along, across] = self.axes;
        let (x, y) = (q.dot(along), q.dot(across));
        // The same without the ellipse's shape.
        let round = x.hypot(y * self.dab.aspect.clamp(LEAST_ASPECT, 1.0));
        if round > 0.0 { distance * x.hypot(y) / round } else { distance }
    }
}

/// Two unit vectors orthogonal to a normal and to each other; the second is as upright (along y) as can be, so that stamps
/// stand upright on walls.
pub(crate) fn tangent_axes(normal: DVec3) -> (DVec3, DVec3) {
    let up = if normal.y.abs() < 0.999 { DVec3::Y } else { DVec3::NEG_Z };
    let x = up.cross(normal).normalize_or(DVec3::X);
    (x, normal.cross(x))
}
