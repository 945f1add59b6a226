//! The brush's outline, lying on the surface.

use fantex_paint::{Surface, SurfacePoint, Symmetry};
use glam::{DVec2, DVec3};

use super::Viewpoint;
use super::pen::world_position;

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

    use fantex_cover::{CoverOptions, build_cover};
    use fantex_mesh::generate::torus;
    use fantex_mesh::{CleanOptions, clean};

    use super::*;
    use crate::camera::ViewPreset;

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
