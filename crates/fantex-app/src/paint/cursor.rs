//! The pen in the scene: from places in the picture to points of the surface.

use fantex::glam::{DVec2, DVec3};
use fantex::paint::{Surface, SurfacePoint, Symmetry};

use crate::camera::CameraRig;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PenPhase {
    Down,
    /// Down where something covers the scene: turns the view.
    Turn,
    /// It moved, touching.
    Move,
    Up,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PenEvent {
    pub phase: PenPhase,
    /// Where, 0..1 along the scene's sides.
    pub at: DVec2,
    /// 0..1; 1 where the system does not tell.
    pub pressure: f32,
}

/// From where the scene is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    pub rig: CameraRig,
    /// Width and height of the scene in pixels.
    pub pixels: [u32; 2],
    /// Pixels per point of the window: 1 on ordinary screens, 2 or more on dense ones. Less counts as 1.
    pub pixels_per_point: f64,
}

impl Viewpoint {
    /// Width and height of the scene in points.
    pub(super) fn points(&self) -> DVec2 {
        DVec2::from(self.pixels.map(|n| f64::from(n.max(1)))) / self.pixels_per_point.max(1.0)
    }

    pub fn aspect(&self) -> f64 {
        let [width, height] = self.pixels.map(|n| f64::from(n.max(1)));
        width / height
    }

    /// The first point of the surface under a place in the picture.
    pub fn hit(&self, surface: &Surface, at: DVec2) -> Option<SurfacePoint> {
        let place = surface.mesh().world_from_mesh;
        let ray = self.rig.ray(at, self.aspect());
        surface.hit(place.inverse_point(self.rig.eye), ray.as_vec3())
    }

    /// Where a point of world space is in the picture; none behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let seen = self.rig.axes().transpose() * (point - self.rig.eye);
        if seen.z > -1e-9 * self.rig.distance.max(1e-300) {
            return None;
        }
        let half = (self.rig.fov_degrees.to_radians() * 0.5).tan();
        let [x, y] = [seen.x / -seen.z / (half * self.aspect()), seen.y / -seen.z / half];
        Some(DVec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y))
    }

    /// World units that a pixel covers at a point.
    pub fn world_per_pixel(&self, point: DVec3) -> f64 {
        let depth = (point - self.rig.eye).dot(self.rig.forward()).max(1e-12);
        let half = (self.rig.fov_degrees.to_radians() * 0.5).tan();
        2.0 * half * depth / f64::from(self.pixels[1].max(1))
    }
}

/// Degrees from one direction to another, those from x to y positive; 0 where either has no length.
pub(crate) fn degrees_between(from: DVec2, to: DVec2) -> f64 {
    if from == DVec2::ZERO || to == DVec2::ZERO { 0.0 } else { from.angle_to(to).to_degrees() }
}

/// World-space position of a point of a surface.
pub(crate) fn world_position(surface: &Surface, point: SurfacePoint) -> DVec3 {
    surface.mesh().world_from_mesh.point(surface.position(point).as_vec3())
}

// The brush's outline, lying on the surface.

/// Points of an outline.
const POINTS: usize = 56;

/// Outlines of a brush and of its mirror images.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cursor {
    /// The brush itself first.
    pub rings: Vec<Ring>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// The middle, 0..1 along the scene's sides.
    pub middle: DVec2,
    pub outline: Vec<DVec2>,
    /// The part that is painted in full.
    pub core: Vec<DVec2>,
    /// The tip of a short normal on the middle.
    pub normal: Option<DVec2>,
    /// Whether it lies on the far side of the model.
    pub is_hidden: bool,
}

impl Cursor {
    /// The outlines of a brush of `radius` world units at a point and its copies.
    pub fn new(
        surface: &Surface,
        view: &Viewpoint,
        point: SurfacePoint,
        radius: f64,
        hardness: f32,
        symmetry: &Symmetry,
    ) -> Self {
        let reach = (radius / surface.mesh().world_from_mesh.scale) as f32;
        let places = symmetry.places(surface, point, reach);
        let rings =
            places.into_iter().flatten().filter_map(|place| ring(surface, view, place, radius, hardness));
        Self { rings: rings.collect() }
    }
}

fn ring(
    surface: &Surface,
    view: &Viewpoint,
    point: SurfacePoint,
    radius: f64,
    hardness: f32,
) -> Option<Ring> {
    let center = world_position(surface, point);
    let facet = surface.facet_normal(point.triangle);
    // As wide as the brush the surface may be rough: the mean of what is around says how the brush lies.
    let around =
        circle(center, facet, radius).into_iter().step_by(8).filter_map(|p| nearest(surface, p, radius));
    let sum = around.fold(facet, |sum, p| {
        let normal = surface.facet_normal(p.triangle);
        if normal.dot(facet) < 0.0 { sum } else { sum + normal }
    });
    let normal = sum.normalize_or(facet);
    let eye = (view.rig.eye - center).normalize_or(DVec3::Z);
    // Two-sided sheets are painted on the side that is seen.
    let is_hidden = !view.hit(surface, view.project(center)?).is_some_and(|first| {
        world_position(surface, first).distance(center) < 0.05 * radius.max(1e-9) + 1e-3 * view.rig.distance
    });
    let upright = if normal.dot(eye) < 0.0 && !is_hidden { -normal } else { normal };
    let line = |radius: f64| -> Vec<DVec2> {
        let lain = circle(center, normal, radius).into_iter().map(|p| match nearest(surface, p, radius) {
            Some(found) => world_position(surface, found),
            None => p,
        });
        lain.filter_map(|p| view.project(p)).collect()
    };
    Some(Ring {
        middle: view.project(center)?,
        outline: line(radius),
        core: if hardness > 0.02 && hardness < 0.98 {
            line(radius * f64::from(hardness))
        } else {
            Vec::new()
        },
        normal: view.project(center + upright * (0.55 * radius)),
        is_hidden,
    })
}

fn nearest(surface: &Surface, world: DVec3, radius: f64) -> Option<SurfacePoint> {
    let place = surface.mesh().world_from_mesh;
    surface.nearest(place.inverse_point(world), (0.6 * radius / place.scale) as f32)
}

/// Points of a circle in the plane orthogonal to a unit normal.
fn circle(center: DVec3, normal: DVec3, radius: f64) -> Vec<DVec3> {
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let turn = |k: usize| (std::f64::consts::TAU * k as f64 / POINTS as f64).sin_cos();
    (0..POINTS).map(turn).map(|(sin, cos)| center + radius * (cos * x + sin * y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pointer may be dragged over the middle of what it turns.
    #[test]
    fn directions_without_length_do_not_turn() {
        assert_eq!(degrees_between(DVec2::X, DVec2::Y), 90.0);
        for (from, to) in
            [(DVec2::ZERO, DVec2::NEG_ONE), (DVec2::NEG_ONE, DVec2::ZERO), (DVec2::ZERO, DVec2::ZERO)]
        {
            assert_eq!(degrees_between(from, to), 0.0, "{from} {to}");
        }
    }
}
