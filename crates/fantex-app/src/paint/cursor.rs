//! The pen in the scene: from places in the picture to points of the surface.

use fantex::glam::{DVec2, DVec3};
use fantex::paint::{Surface, SurfacePoint, Symmetry};

use crate::camera::CameraRig;

/// What the pen did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PenPhase {
    /// It touched.
    Down,
    /// It moved, touching.
    Move,
    /// It left.
    Up,
}

/// Something that the pen did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PenEvent {
    /// What.
    pub phase: PenPhase,
    /// Where, 0..1 along the scene's sides.
    pub at: DVec2,
    /// 0..1; 1 where the system does not tell.
    pub pressure: f32,
}

/// From where the scene is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The camera.
    pub rig: CameraRig,
    /// Width and height of the scene in pixels.
    pub pixels: [u32; 2],
}

impl Viewpoint {
    /// Width by height.
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

/// An outline in the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Ring {
    /// The middle, 0..1 along the scene's sides.
    pub middle: DVec2,
    /// A closed line around it.
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
    use std::sync::Arc;

    use fantex::cover::{CoverOptions, build_cover};
    use fantex::mesh::generate::torus;
    use fantex::mesh::{CleanOptions, clean};

    use super::*;
    use crate::camera::ViewPreset;

    #[test]
    fn what_a_ray_meets_is_seen_where_it_started() {
        let view = Viewpoint {
            rig: CameraRig { yaw: 0.4, pitch: -0.2, ..CameraRig::default() },
            pixels: [800, 500],
        };
        for at in [DVec2::new(0.5, 0.5), DVec2::new(0.1, 0.8), DVec2::new(0.95, 0.03)] {
            let point = view.rig.eye + 7.0 * view.rig.ray(at, view.aspect());
            assert!((view.project(point).unwrap() - at).length() < 1e-9);
        }
        assert_eq!(view.project(view.rig.eye - view.rig.forward()), None);
        let middle = view.rig.eye + 4.0 * view.rig.forward();
        let beside = middle + view.rig.axes().y_axis * view.world_per_pixel(middle);
        let moved = (view.project(beside).unwrap() - view.project(middle).unwrap()) * 500.0;
        assert!((moved.length() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn rings_lie_around_the_cursor_and_its_mirror_image() {
        let (mesh, _) = clean(torus(64, 32), &CleanOptions::default()).unwrap();
        let (cover, _) = build_cover(&mesh, &CoverOptions::default()).unwrap();
        let rig = ViewPreset::Top.rig(&mesh, 1.6);
        let surface = Surface::new(Arc::new(mesh), Arc::new(cover));
        let view = Viewpoint { rig, pixels: [800, 500] };
        // A torus seen from above: on its right side.
        let at = (0..100).map(|k| DVec2::new(0.5 + 0.005 * f64::from(k), 0.5));
        let (at, point) = at.filter_map(|at| Some((at, view.hit(&surface, at)?))).nth(10).unwrap();
        let world = world_position(&surface, point);
        let radius = 20.0 * view.world_per_pixel(world);
        let mirror = Symmetry::Mirror { axis: 0, offset: 0.0 };
        let cursor = Cursor::new(&surface, &view, point, radius, 0.5, &mirror);
        assert_eq!(cursor.rings.len(), 2);
        let ring = &cursor.rings[0];
        assert!((ring.middle - at).length() < 1e-3 && !ring.is_hidden);
        let pixels = |p: &DVec2| ((*p - ring.middle) * DVec2::new(800.0, 500.0)).length();
        assert!(ring.outline.iter().all(|p| (8.0..24.0).contains(&pixels(p))), "{:?}", ring.outline);
        let other = &cursor.rings[1];
        assert!((other.middle.x + ring.middle.x - 1.0).abs() < 1e-2, "{:?}", other.middle);
    }
}
