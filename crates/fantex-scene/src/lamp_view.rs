//! The scene as a lamp sees it: the projection of cookies and of shadow maps. Mesh space.

use fantex_mesh::WorldFromMesh;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, Vec2, Vec3};

use crate::camera::view_axes;
use crate::{Lens, LightKind, Projector, SpotLight};

/// A projection of mesh space onto the unit square of a lamp's picture (origin top left, v downwards).
#[derive(Clone, Copy, Debug)]
pub struct LampView {
    /// The pinhole; for a parallel projection a point of the plane of depth zero.
    pub origin: DVec3,
    /// Right, up and forward, unit vectors.
    axes: [DVec3; 3],
    /// Half the width and height of the picture: at depth one, or everywhere.
    half: DVec2,
    spread: Spread,
    /// Screen-homogeneous coordinates are `linear * (p - origin) + constant`.
    linear: DMat3,
    constant: DVec3,
}

/// Whether light leaves a point or is parallel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// It leaves a point.
    Perspective,
    /// It is parallel.
    Parallel,
}

/// A point in a lamp's picture.
#[derive(Clone, Copy, Debug)]
pub struct Projected {
    /// Position, `[0,1]` inside the picture; has no meaning at depths that are not positive.
    pub uv: DVec2,
    /// Divisor of the screen-homogeneous coordinates.
    pub w: f64,
    /// Distance along the axis, mesh units.
    pub depth: f64,
}

impl LampView {
    /// A view along `forward`; `half` as the field.
    pub fn new(origin: DVec3, forward: DVec3, up: DVec3, half: DVec2, spread: Spread) -> Self {
        let forward = forward.normalize_or(DVec3::NEG_Z);
        let to_eye = view_axes(-forward, up.normalize_or(DVec3::Y));
        let (right, up) = (to_eye.x_axis, to_eye.y_axis);
        let (x, y) = (right / (2.0 * half.x), -up / (2.0 * half.y));
        let (rows, constant) = match spread {
            Spread::Perspective => ([x + forward * 0.5, y + forward * 0.5, forward], DVec3::ZERO),
            Spread::Parallel => ([x, y, DVec3::ZERO], DVec3::new(0.5, 0.5, 1.0)),
        };
        let [row_x, row_y, row_w] = rows;
        let linear = DMat3::from_cols(row_x, row_y, row_w).transpose();
        Self { origin, axes: [right, up, forward], half, spread, linear, constant }
    }

    /// Along the axis, a unit vector.
    pub fn forward(&self) -> DVec3 {
        self.axes[2]
    }

    /// To the right and upwards in the picture, unit vectors.
    pub fn sides(&self) -> [DVec3; 2] {
        [self.axes[0], self.axes[1]]
    }

    /// Half the width and height of the picture: at depth one, or where light is parallel everywhere. Mesh units.
    pub fn half_extent(&self) -> DVec2 {
        self.half
    }

    /// Takes `(p_mesh, 1)` to `(u w, v w, w, depth)`; see [`Projected`].
    pub fn matrix(&self) -> DMat4 {
        let forward = self.forward();
        let column = |v: DVec3| (self.linear * v).extend(forward.dot(v));
        let moved = (self.constant - self.linear * self.origin).extend(-forward.dot(self.origin));
        DMat4::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z), moved)
    }

    /// Whether light leaves a point.
    pub fn spread(&self) -> Spread {
        self.spread
    }

    /// Screen-homogeneous coordinates `(u w, v w, w)`.
    pub fn homogeneous(&self, p_mesh: Vec3) -> DVec3 {
        self.linear * (p_mesh.as_dvec3() - self.origin) + self.constant
    }

    /// Where a point appears.
    pub fn project(&self, p_mesh: Vec3) -> Projected {
        let h = self.homogeneous(p_mesh);
        let depth = self.forward().dot(p_mesh.as_dvec3() - self.origin);
        Projected { uv: h.truncate() / h.z, w: h.z, depth }
    }

    /// How a point's picture moves with the point.
    pub fn step(&self, at: &Projected, step_mesh: Vec3) -> Vec2 {
        let h = self.linear * step_mesh.as_dvec3();
        ((h.truncate() - at.uv * h.z) / at.w).as_vec2()
    }

    /// Width and height of the picture at a depth, mesh units.
    pub fn extent_at(&self, depth: f64) -> DVec2 {
        match self.spread {
            Spread::Perspective => self.half * (2.0 * depth),
            Spread::Parallel => self.half * 2.0,
        }
    }

    /// Change of `1 / depth` (of the depth, where light is parallel) over the width and the height of the picture on the
    /// plane through `p` with the given normal. In these terms, depth is linear over the picture.
    pub fn plane_slope(&self, p: DVec3, normal: DVec3) -> DVec2 {
        let [right, up, forward] = self.axes;
        let along = DVec2::new(normal.dot(right), -normal.dot(up)) * self.half * 2.0;
        match self.spread {
            Spread::Perspective => along / normal.dot(p - self.origin),
            Spread::Parallel => -along / normal.dot(forward),
        }
    }
}

// Where a lamp's shadow maps look, and what they hold.

/// The near end of a view from a point as a share of the largest depth.
const NEAREST_SHARE: f64 = 1e-4;

/// A view and the largest depth that it meets, mesh units.
///
/// Its map holds how near surfaces are to the lamp: 1 at the near end, 0 at the far end of parallel light and infinitely far from a point.
/// What is nearer than 1 casts no shadow. On every plane nearness is linear over the map.
#[derive(Clone, Copy, Debug)]
pub struct FittedView {
    /// Where the map looks.
    pub view: LampView,
    /// Largest depth of the scene.
    pub far: f64,
}

impl FittedView {
    /// The depth of the near end, mesh units.
    pub fn near(&self) -> f64 {
        match self.view.spread {
            Spread::Perspective => self.far * NEAREST_SHARE,
            Spread::Parallel => 0.0,
        }
    }

    /// The nearness of a depth.
    pub fn nearness_of(&self, depth: f64) -> f64 {
        match self.view.spread {
            Spread::Perspective => self.near() / depth,
            Spread::Parallel => (self.far - depth) / self.far,
        }
    }

    /// The depth of a nearness.
    pub fn depth_of(&self, nearness: f64) -> f64 {
        match self.view.spread {
            Spread::Perspective => self.near() / nearness,
            Spread::Parallel => self.far * (1.0 - nearness),
        }
    }

    /// Change of the nearness per unit of depth towards the lamp.
    pub fn nearness_per_depth(&self, depth: f64) -> f64 {
        match self.view.spread {
            Spread::Perspective => self.near() / (depth * depth),
            Spread::Parallel => 1.0 / self.far,
        }
    }

    /// Change of the nearness over the width and the height of the map on the plane through `p` with the given normal.
    pub fn nearness_slope(&self, p: DVec3, normal: DVec3) -> DVec2 {
        let plane = self.view.plane_slope(p, normal);
        match self.view.spread {
            Spread::Perspective => plane * self.near(),
            Spread::Parallel => -plane / self.far,
        }
    }

    /// From mesh to clip space of the map, y upwards; depth there is the nearness.
    pub fn clip_from_mesh(&self) -> DMat4 {
        let matrix = self.view.matrix();
        let [u, v, w, depth] = [0, 1, 2, 3].map(|row| matrix.row(row));
        let z = match self.view.spread {
            Spread::Perspective => DVec4::W * self.near(),
            Spread::Parallel => w - depth / self.far,
        };
        DMat4::from_cols(u * 2.0 - w, w - v * 2.0, z, w).transpose()
    }
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
const MAX_CONE_DEGREES: f32 = 70.0;

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
        LightKind::Spot(SpotLight { position, outer_degrees, .. }) if *outer_degrees > MAX_CONE_DEGREES => {
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

/// The view through a projector's cookie.
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
    use fantex_base::Random;

    use super::*;

    fn views() -> [LampView; 2] {
        let (origin, forward) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-0.4, -0.5, -1.0));
        [Spread::Perspective, Spread::Parallel]
            .map(|spread| LampView::new(origin, forward, DVec3::Y, DVec2::new(0.8, 0.5), spread))
    }

    #[test]
    fn the_axis_is_the_middle_and_up_is_up() {
        for view in views() {
            let on_axis = (view.origin + view.forward() * 2.0).as_vec3();
            let seen = view.project(on_axis);
            assert!((seen.uv - 0.5).length() < 1e-6 && (seen.depth - 2.0).abs() < 1e-6, "{seen:?}");
            assert!(view.project(on_axis + Vec3::Y * 0.1).uv.y < 0.5);
            let corner = view.extent_at(2.0) * 0.5;
            let [right, up, _] = view.axes;
            let seen = view.project(on_axis + (right * corner.x - up * corner.y).as_vec3());
            assert!((seen.uv - 1.0).length() < 1e-6, "{seen:?}");
        }
    }

    /// Of the matrix that graphics cards are given, of depths, and over a plane.
    #[test]
    fn nearness_is_one_measure() {
        let mut random = Random::new(3);
        let mut point = || DVec3::from_array(std::array::from_fn(|_| 6.0 * random.unit() - 3.0));
        for view in views() {
            let fitted = FittedView { view, far: 9.0 };
            for _ in 0..200 {
                let (p, aside) = (point().as_vec3(), point().as_vec3());
                let seen = view.project(p);
                if seen.depth < 0.1 {
                    continue;
                }
                let nearness = fitted.nearness_of(seen.depth);
                let tolerance = 1e-9 * nearness.max(1.0);
                let clip = fitted.clip_from_mesh() * p.as_dvec3().extend(1.0);
                assert!((clip.z / clip.w - nearness).abs() < tolerance, "{clip} {nearness}");
                let uv = (clip.truncate().truncate() / clip.w * DVec2::new(0.5, -0.5)) + 0.5;
                assert!((uv - seen.uv).length() < 1e-9 * seen.uv.length().max(1.0), "{uv} {seen:?}");
                assert!((fitted.depth_of(nearness) - seen.depth).abs() < 1e-9 * seen.depth.max(1.0));
                let step = 1e-5 * seen.depth;
                let change = fitted.nearness_of(seen.depth - step) - nearness;
                let expected = fitted.nearness_per_depth(seen.depth) * step;
                assert!((change / expected - 1.0).abs() < 1e-3, "{change} {expected}");
                // A plane through both points.
                let normal = point().cross((aside - p).as_dvec3()).normalize();
                let there = view.project(aside);
                if there.depth < 0.1 {
                    continue;
                }
                let change = fitted.nearness_of(there.depth) - nearness;
                let expected = fitted.nearness_slope(p.as_dvec3(), normal) * (there.uv - seen.uv);
                let rounding = 1e-6 * expected.abs().element_sum();
                assert!((change - expected.element_sum()).abs() < rounding + 1e-9, "{change} {expected}");
            }
        }
    }

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
