//! Where a lamp's shadow maps look.

use fantex_mesh::WorldFromMesh;
use glam::{DVec2, DVec3, Vec3};

use crate::{LampView, Lens, LightKind, Projector, SpotLight, Spread};

/// A view and the largest depth that it meets, mesh units.
#[derive(Clone, Copy, Debug)]
pub struct FittedView {
    /// Where the map looks.
    pub view: LampView,
    /// Largest depth of the scene.
    pub far: f64,
}

/// Forward and up of the six views of a point light: +x, -x, +y, -y, +z, -z.
const CUBE: [[DVec3; 2]; 6] = [
    [DVec3::X, DVec3::Y],
    [DVec3::NEG_X, DVec3::Y],
    [DVec3::Y, DVec3::Z],
    [DVec3::NEG_Y, DVec3::Z],
    [DVec3::Z, DVec3::Y],
    [DVec3::NEG_Z, DVec3::Y],
];

/// Half width of a cube's face at depth one: a little more than 45 degrees, so that filters need not look round corners.
const CUBE_HALF: f64 = 1.04;

/// Cones with a larger half angle than this are looked at through a cube.
const WIDEST_CONE_DEGREES: f32 = 70.0;

/// The views of a lamp: one, or six for a lamp that shines to all sides (in the order +x, -x, +y, -y, +z, -z). That of
/// parallel light is fitted to `casters`, the corners of everything that casts shadows; `points` are the whole mesh's. Mesh
/// space.
pub fn lamp_views(
    kind: &LightKind,
    space: &WorldFromMesh,
    points: &[Vec3],
    casters: impl Iterator<Item = Vec3>,
) -> Vec<FittedView> {
    let placed = |p: DVec3| (p - space.offset) / space.scale;
    match kind {
        LightKind::Directional { to_light } => vec![parallel(-to_light.as_dvec3(), casters)],
        LightKind::Point { position, .. } => cube(placed(*position), points),
        LightKind::Spot(SpotLight { position, outer_degrees, .. })
            if *outer_degrees > WIDEST_CONE_DEGREES =>
        {
            cube(placed(*position), points)
        }
        LightKind::Spot(SpotLight { position, direction, outer_degrees, .. }) => {
            let half = DVec2::splat(f64::from(outer_degrees.max(0.1)).to_radians().tan() * 1.02);
            let (origin, forward) = (placed(*position), direction.as_dvec3());
            vec![with_far(LampView::new(origin, forward, DVec3::Y, half, Spread::Perspective), points)]
        }
        LightKind::Projector(projector) => vec![with_far(projector_view(projector, space), points)],
    }
}

/// The view through a projector's slide.
pub fn projector_view(projector: &Projector, space: &WorldFromMesh) -> LampView {
    let Projector { position, target, up, lens, aspect, .. } = projector;
    let (half_height, spread) = match lens {
        Lens::Perspective { fov_degrees } => ((fov_degrees * 0.5).to_radians().tan(), Spread::Perspective),
        Lens::Orthographic { height } => (0.5 * height / space.scale, Spread::Parallel),
    };
    let half = DVec2::new(half_height * aspect, half_height);
    LampView::new((position - space.offset) / space.scale, target - position, *up, half, spread)
}

fn cube(origin: DVec3, points: &[Vec3]) -> Vec<FittedView> {
    let half = DVec2::splat(CUBE_HALF);
    let view = |[forward, up]: [DVec3; 2]| LampView::new(origin, forward, up, half, Spread::Perspective);
    CUBE.into_iter().map(|axes| with_far(view(axes), points)).collect()
}

fn with_far(view: LampView, points: &[Vec3]) -> FittedView {
    let depth = |p: &Vec3| view.forward().dot(p.as_dvec3() - view.origin);
    FittedView { view, far: points.iter().map(depth).fold(1e-6, f64::max) }
}

/// Parallel light through everything that casts shadows.
fn parallel(forward: DVec3, casters: impl Iterator<Item = Vec3>) -> FittedView {
    let probe = LampView::new(DVec3::ZERO, forward, DVec3::Y, DVec2::ONE, Spread::Parallel);
    let corners = casters.map(|p| {
        let seen = probe.project(p);
        seen.uv.extend(seen.depth)
    });
    let (low, high) =
        corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    if !(low.is_finite() && high.is_finite()) {
        return FittedView { view: probe, far: 1.0 };
    }
    let (middle, extent) = ((low + high) * 0.5, (high - low).max(DVec3::splat(1e-6)) * 1.01);
    let [right, up] = probe.sides();
    // In the probe's picture, u grows by a half per unit to the right and v by a half per unit downwards.
    let side = right * (2.0 * middle.x - 1.0) - up * (2.0 * middle.y - 1.0);
    let origin = side + probe.forward() * (middle.z - 0.5 * extent.z);
    FittedView {
        view: LampView::new(origin, forward, DVec3::Y, extent.truncate(), Spread::Parallel),
        far: extent.z,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_light_meets_the_whole_scene() {
        let positions: Vec<_> = [[0.9, 0.1, -0.3], [-0.2, 0.8, 0.4], [0.1, -0.5, 0.9], [-0.9, 0.0, 0.2]]
            .map(Vec3::from_array)
            .to_vec();
        for forward in [DVec3::NEG_Y, DVec3::new(0.3, -1.0, 0.5), DVec3::X] {
            let FittedView { view, far } = parallel(forward, positions.iter().copied());
            let seen: Vec<_> = positions.iter().map(|&p| view.project(p)).collect();
            assert!(seen.iter().all(|s| s.depth > 0.0 && s.depth < far), "{seen:?}");
            assert!(seen.iter().all(|s| (s.uv - 0.5).abs().max_element() < 0.5), "{seen:?}");
            let widest = seen.iter().map(|s| (s.uv - 0.5).abs().max_element()).fold(0.0, f64::max);
            assert!(widest > 0.49, "the map is used to its border: {widest}");
        }
    }
}
