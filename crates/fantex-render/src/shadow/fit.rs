//! Where a lamp's maps look.

use fantex_mesh::Mesh;
use glam::{DVec2, DVec3};

use crate::Surface;
use crate::lamp_view::{LampView, Spread};
use fantex_scene::{Lens, LightKind, Projector, SpotLight};

/// A view and the largest depth that it meets, mesh units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub(super) view: LampView,
    pub(super) far: f64,
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

/// The views of a lamp: one, or six for a lamp that shines to all sides.
pub(super) fn views(kind: &LightKind, mesh: &Mesh, surface: &dyn Surface) -> Vec<Fitted> {
    let placed = |p: DVec3| (p - mesh.world_from_mesh.offset) / mesh.world_from_mesh.scale;
    match kind {
        LightKind::Directional { to_light } => vec![parallel(-to_light.as_dvec3(), mesh, surface)],
        LightKind::Point { position, .. } => cube(placed(*position), mesh),
        LightKind::Spot(SpotLight { position, outer_degrees, .. })
            if *outer_degrees > WIDEST_CONE_DEGREES =>
        {
            cube(placed(*position), mesh)
        }
        LightKind::Spot(SpotLight { position, direction, outer_degrees, .. }) => {
            let half = DVec2::splat(f64::from(outer_degrees.max(0.1)).to_radians().tan() * 1.02);
            let (origin, forward) = (placed(*position), direction.as_dvec3());
            vec![with_far(LampView::new(origin, forward, DVec3::Y, half, Spread::Perspective), mesh)]
        }
        LightKind::Projector(projector) => vec![with_far(projector_view(projector, mesh), mesh)],
    }
}

/// The view through a projector's slide.
pub(crate) fn projector_view(projector: &Projector, mesh: &Mesh) -> LampView {
    let Projector { position, target, up, lens, aspect, .. } = projector;
    let frame = mesh.world_from_mesh;
    let (half_height, spread) = match lens {
        Lens::Perspective { fov_degrees } => ((fov_degrees * 0.5).to_radians().tan(), Spread::Perspective),
        Lens::Orthographic { height } => (0.5 * height / frame.scale, Spread::Parallel),
    };
    let half = DVec2::new(half_height * aspect, half_height);
    LampView::new((position - frame.offset) / frame.scale, target - position, *up, half, spread)
}

fn cube(origin: DVec3, mesh: &Mesh) -> Vec<Fitted> {
    let half = DVec2::splat(CUBE_HALF);
    let view = |[forward, up]: [DVec3; 2]| LampView::new(origin, forward, up, half, Spread::Perspective);
    CUBE.into_iter().map(|axes| with_far(view(axes), mesh)).collect()
}

fn with_far(view: LampView, mesh: &Mesh) -> Fitted {
    let depth = |p: &glam::Vec3| view.forward().dot(p.as_dvec3() - view.origin);
    Fitted { view, far: mesh.positions.iter().map(depth).fold(1e-6, f64::max) }
}

/// Parallel light through everything that casts shadows.
fn parallel(forward: DVec3, mesh: &Mesh, surface: &dyn Surface) -> Fitted {
    let probe = LampView::new(DVec3::ZERO, forward, DVec3::Y, DVec2::ONE, Spread::Parallel);
    let in_view = |p: &glam::Vec3| {
        let seen = probe.project(*p);
        seen.uv.extend(seen.depth)
    };
    let casters = (0..mesh.triangles.len()).filter(|&triangle| surface.casts_shadow(triangle));
    let corners = casters.flat_map(|triangle| mesh.triangle_positions(triangle)).map(|p| in_view(&p));
    let (low, high) =
        corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    if !(low.is_finite() && high.is_finite()) {
        return Fitted { view: probe, far: 1.0 };
    }
    let (middle, extent) = ((low + high) * 0.5, (high - low).max(DVec3::splat(1e-6)) * 1.01);
    let [right, up] = probe.sides();
    // In the probe's picture, u grows by a half per unit to the right and v by a half per unit downwards.
    let side = right * (2.0 * middle.x - 1.0) - up * (2.0 * middle.y - 1.0);
    let origin = side + probe.forward() * (middle.z - 0.5 * extent.z);
    Fitted {
        view: LampView::new(origin, forward, DVec3::Y, extent.truncate(), Spread::Parallel),
        far: extent.z,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FlatShading, FlatSurface};

    #[test]
    fn parallel_light_meets_the_whole_scene() {
        let positions: Vec<_> = [[0.9, 0.1, -0.3], [-0.2, 0.8, 0.4], [0.1, -0.5, 0.9], [-0.9, 0.0, 0.2]]
            .map(glam::Vec3::from_array)
            .to_vec();
        let triangles = vec![[0, 1, 2], [1, 2, 3]];
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |_| glam::Vec3::ONE);
        for forward in [DVec3::NEG_Y, DVec3::new(0.3, -1.0, 0.5), DVec3::X] {
            let Fitted { view, far } = parallel(forward, &mesh, &surface);
            let seen: Vec<_> = mesh.positions.iter().map(|&p| view.project(p)).collect();
            assert!(seen.iter().all(|s| s.depth > 0.0 && s.depth < far), "{seen:?}");
            assert!(seen.iter().all(|s| (s.uv - 0.5).abs().max_element() < 0.5), "{seen:?}");
            let widest = seen.iter().map(|s| (s.uv - 0.5).abs().max_element()).fold(0.0, f64::max);
            assert!(widest > 0.49, "the map is used to its border: {widest}");
        }
    }
}
