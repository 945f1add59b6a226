//! How each fan is laid flat: projected along its best direction, or unfolded.

use fantex_mesh::unit_vector;
use glam::{DVec2, Vec2, Vec3, Vec3A, Vec3Swizzles};

use crate::cone::{Cone, narrowest_cone};
use crate::cost::error_at;
use crate::surface::{Ring, Surface};

/// Below this cosine between direction and worst normal a fan is rather unfolded: the projection would shrink a triangle
/// to less than a sixth of its length in one direction.
const UNFOLD_BELOW: f32 = 0.15;

/// Below this cosine a projection is numerically folded.
const FOLDED_BELOW: f32 = 1e-3;

/// How a fan is laid into the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layout {
    Projected,
    Unfolded,
}

/// How far a partial fan reaches from its centre in each direction, nearly: the ellipsoid of its spokes' second moments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    diagonal: Vec3,
    /// Of yz, zx, xy.
    mixed: Vec3,
}

impl Reach {
    pub(crate) fn of(spokes: &[Vec3]) -> Self {
        let (mut diagonal, mut mixed) = (Vec3::ZERO, Vec3::ZERO);
        for &spoke in spokes {
            diagonal += spoke * spoke;
            mixed += spoke.yzx() * spoke.zxy();
        }
        // A region ends half way along its spokes; of spokes all around, the mean square along an axis is half that of the longest.
        let scale = 0.5 / spokes.len() as f32;
        Self { diagonal: diagonal * scale, mixed: mixed * (2.0 * scale) }
    }

    /// Along three unit vectors. Given are the x, y and z of their squares, and of their products yz, zx, xy.
    #[inline]
    pub(crate) fn along_three(&self, [squares, products]: &[[Vec3A; 3]; 2]) -> Vec3A {
        let sum = |[x, y, z]: &[Vec3A; 3], v: Vec3| *x * v.x + *y * v.y + *z * v.z;
        let along = sum(squares, self.diagonal) + sum(products, self.mixed);
        let squared = along.max(Vec3A::ZERO);
        Vec3A::from(squared.to_array().map(f32::sqrt))
    }
}

/// The decision for one fan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FanShape {
    pub(crate) layout: Layout,
    /// Best direction and its smallest facing cosine.
    pub(crate) cone: Cone,
    /// A third of the area of the fan's triangles.
    pub(crate) area: f32,
    /// Mean normal.
    pub(crate) axis: Vec3,
    /// Length of its longest spoke, mesh units.
    pub(crate) longest_spoke: f32,
    /// True where no direction sees the whole fan from the front.
    pub(crate) folds: bool,
}

impl FanShape {
    /// Decides about a fan whose geometry is in `ring`.
    pub(crate) fn of(ring: &Ring, surface: &Surface<'_>, fan: usize) -> Self {
        let cone = narrowest_cone(&ring.normals);
        let projectable = cone.cos > FOLDED_BELOW && winds_once(ring, cone.axis);
        // What cannot be unfolded is a triangle with its double: one image serves both.
        let is_projected = projectable && cone.cos >= UNFOLD_BELOW || unfold(surface, fan).is_none();
        let layout = if is_projected { Layout::Projected } else { Layout::Unfolded };
        let facets = || ring.normals.iter().zip(&ring.areas);
        let sum: Vec3 = facets().map(|(&normal, &area)| normal * area).sum();
        let mean = sum.try_normalize().unwrap_or(cone.axis);
        let axis = if cone.cos > 0.95 {
            mean
        } else {
            crate::cost::direction(facets().map(|(&n, &a)| (n, a)), cone.axis)
        };
        let longest_spoke = ring.spokes.iter().map(|spoke| spoke.length_squared()).fold(0.0, f32::max).sqrt();
        Self { layout, cone, area: ring.area / 3.0, axis, longest_spoke, folds: !projectable }
    }
}

/// The error per area of a fan's projection along a direction (see [`error_at`]).
pub(crate) fn projection_error(ring: &Ring, direction: Vec3) -> f32 {
    let facets = ring.normals.iter().zip(&ring.areas);
    let error: f32 = facets.map(|(normal, area)| area * error_at(normal.dot(direction))).sum();
    if ring.area > 0.0 { error / ring.area } else { 1.0 }
}

/// True where the projected fan surrounds its centre at most once. All its triangles face the direction.
fn winds_once(ring: &Ring, direction: Vec3) -> bool {
    if ring.closed {
        let y_axis = direction.any_orthonormal_pair().1;
        // A counter-clockwise ring edge that passes the positive x axis begins below and ends on or above it.
        let below = |spoke: &Vec3| spoke.dot(y_axis) < 0.0;
        let mut was_below = below(&ring.spokes[0]);
        let mut passes = 0;
        for is_below in ring.spokes[1..].iter().map(below) {
            passes += u32::from(was_below & !is_below);
            was_below = is_below;
        }
        return passes <= 1;
    }
    opens(ring.spokes.iter().copied(), direction)
}

/// True where the spokes of an open fan, one after the other, turn by less than a whole turn as seen along a direction that all triangles face.
pub(crate) fn opens(spokes: impl Iterator<Item = Vec3>, direction: Vec3) -> bool {
    let (x_axis, y_axis) = direction.any_orthonormal_pair();
    let mut flat = spokes.map(|v| DVec2::new(v.dot(x_axis).into(), v.dot(y_axis).into()));
    let Some(mut from) = flat.next() else { return true };
    let mut total = 0.0;
    for to in flat {
        total += libm::atan2(from.perp_dot(to), from.dot(to)).abs();
        from = to;
    }
    total < std::f64::consts::TAU
}

// Unfolding a fan about its centre: radii are kept, angles are scaled so that a closed fan closes. In double precision, as there may be very many.

/// No triangle spans more than this angle at the centre, or it would degenerate (170 degrees).
const MAX_TRIANGLE_ANGLE: f64 = 2.967;

/// Nor less than this, if there is room.
const MIN_TRIANGLE_ANGLE: f64 = 1e-3;

/// An open fan is not spread over more than this angle (300 degrees).
const MAX_OPEN_FAN_ANGLE: f64 = 5.236;

/// Planar coordinates of the centre (the origin) and the two ring vertices of each triangle, in the fan's order and
/// mesh units; `None` only for closed fans of two triangles, which coincide.
pub(crate) fn unfold(surface: &Surface<'_>, fan: usize) -> Option<Vec<[Vec2; 3]>> {
    let corners = surface.fans.corners(fan);
    let mut radii = Vec::with_capacity(corners.len());
    let mut angles = Vec::with_capacity(corners.len());
    for &corner in corners {
        let [center, from, to] = surface.fan_triangle(corner);
        let (from, to) = (from - center, to - center);
        radii.push([from.length(), to.length()]);
        angles.push(libm::atan2(from.cross(to).length().into(), from.dot(to).into()));
    }
    let closed = surface.fans.is_closed(fan);
    let total: f64 = angles.iter().sum();
    let target = if closed { std::f64::consts::TAU } else { total.min(MAX_OPEN_FAN_ANGLE) };
    spread(&mut angles, target, closed)?;
    let mut angle = 0.0f64;
    let mut unfolded = Vec::with_capacity(corners.len());
    for (i, (&[from, to], span)) in radii.iter().zip(&angles).enumerate() {
        let start = unit_vector(angle as f32) * from;
        angle += span;
        let last = closed && i + 1 == radii.len();
        let end = if last { Vec2::X } else { unit_vector(angle as f32) };
        unfolded.push([Vec2::ZERO, start, end * to]);
    }
    // Two triangles share each spoke; their coordinates of it must be equal to the last bit.
    for i in 1..unfolded.len() {
        unfolded[i][1] = unfolded[i - 1][2];
    }
    if closed && let Some(last) = unfolded.last().map(|u| u[2]) {
        unfolded[0][1] = last;
    }
    Some(unfolded)
}

/// Scales angles so that they sum up to `target` with none beyond the bounds; those of an open fan may sum up to less. `None` where
/// that is impossible.
fn spread(angles: &mut [f64], target: f64, closed: bool) -> Option<()> {
    let n = angles.len() as f64;
    if closed && n * MAX_TRIANGLE_ANGLE < target {
        return None;
    }
    let floor = MIN_TRIANGLE_ANGLE.min(0.5 * target / n);
    let at = |angle: f64, factor: f64| (angle * factor).clamp(floor, MAX_TRIANGLE_ANGLE);
    angles.iter_mut().for_each(|angle| *angle = if angle.is_finite() { angle.max(1e-6) } else { 1e-6 });
    let sum = |factor: f64| angles.iter().map(|&angle| at(angle, factor)).sum::<f64>();
    let plain = target / angles.iter().sum::<f64>();
    let mut factor = plain;
    if (sum(plain) - target).abs() > 1e-9 * target {
        // The sum grows with the factor: bisection on a scale of powers of two.
        let (mut low, mut high) = (plain * 1e-3, plain.max(1.0) * 4.0e6);
        for _ in 0..60 {
            factor = (low * high).sqrt();
            if sum(factor) < target { low = factor } else { high = factor }
        }
    }
    angles.iter_mut().for_each(|angle| *angle = at(*angle, factor));
    Some(())
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{Fans, Mesh, VertexCorners};
    use glam::Vec3;
    use proptest::prelude::*;

    use super::*;

    /// An umbrella around vertex 0; `closed` joins its end to its beginning.
    fn umbrella(ring: &[Vec3], closed: bool) -> Mesh {
        let n = ring.len() as u32;
        let mut positions = vec![Vec3::ZERO];
        positions.extend_from_slice(ring);
        let triangles = (0..if closed { n } else { n - 1 }).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
        Mesh { positions, triangles, ..Mesh::default() }
    }

    fn unfolded(mesh: &Mesh) -> Option<Vec<[Vec2; 3]>> {
        let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
        let surface = Surface::new(mesh, Fans::of(&mesh.triangles, &corners));
        let planar = unfold(&surface, 0)?;
        assert_eq!(planar.len(), surface.fans.corners(0).len());
        for (triangle, &corner) in planar.iter().zip(surface.fans.corners(0)) {
            let [center, from, to] = surface.fan_triangle(corner);
            assert_eq!(triangle[0], Vec2::ZERO);
            for (flat, p) in [(triangle[1], from), (triangle[2], to)] {
                let radius = (p - center).length();
                assert!((flat.length() - radius).abs() < 1e-5 * radius, "{} for {radius}", flat.length());
            }
            assert!(triangle[1].perp_dot(triangle[2]) > 0.0, "{triangle:?} is folded over");
        }
        Some(planar)
    }

    /// Radians.
    fn turn(planar: &[[Vec2; 3]]) -> f64 {
        let angles = planar.iter().map(|t| t.map(|p| p.as_dvec2()));
        angles.map(|[_, a, b]| f64::atan2(a.perp_dot(b), a.dot(b))).sum()
    }

    /// As many as there may be: no triangle is folded over, and none lies over the first ones.
    #[test]
    fn fans_of_many_triangles_close() {
        for n in [10_000u32, 100_000] {
            for (closed, turns) in [(true, 1.0), (false, 0.7), (false, 1.3)] {
                let point = |i: u32| {
                    let share = f64::from(i) / f64::from(if closed { n } else { n - 1 });
                    // Every second spoke is short; the surface is too steep to be projected.
                    let radius = if i.is_multiple_of(2) { 1.0 } else { 0.6 };
                    (DVec2::from_angle(share * turns * std::f64::consts::TAU) * radius)
                        .extend(5.0 * share)
                        .as_vec3()
                };
                let ring: Vec<Vec3> = (0..n).map(point).collect();
                let planar = unfolded(&umbrella(&ring, closed)).unwrap();
                let turn = turn(&planar);
                if closed {
                    assert!((turn - std::f64::consts::TAU).abs() < 1e-3, "{n}: {turn}");
                } else {
                    assert!(turn < MAX_OPEN_FAN_ANGLE + 1e-3, "{n}: {turn}");
                }
            }
        }
    }

    /// Narrow triangles count for as much as they turn, however many there are.
    #[test]
    fn spirals_of_many_triangles_wind_more_than_once() {
        for n in [100u32, 5_000, 60_000] {
            for (turns, expected) in [(0.95, true), (1.05, false), (1.2, false)] {
                let point = |i: u32| {
                    let share = f64::from(i) / f64::from(n - 1);
                    DVec2::from_angle(share * turns * std::f64::consts::TAU).extend(0.02 * share).as_vec3()
                };
                let mesh = umbrella(&(0..n).map(point).collect::<Vec<_>>(), false);
                let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
                let surface = Surface::new(&mesh, Fans::of(&mesh.triangles, &corners));
                let mut ring = Ring::default();
                ring.gather(&surface, 0);
                assert_eq!(winds_once(&ring, Vec3::Z), expected, "{n} triangles, {turns} turns");
            }
        }
    }

    #[test]
    fn a_flat_umbrella_stays_as_it_is() {
        let ring: Vec<Vec3> = (0..7).map(|i| Vec2::from_angle(i as f32 * 0.8).extend(0.0)).collect();
        let planar = unfolded(&umbrella(&ring, false)).unwrap();
        assert!((turn(&planar) - 4.8).abs() < 1e-5);
    }

    #[test]
    fn flattened_cones_wide_triangles_and_needles_are_unfolded() {
        unfolded(&umbrella(&[Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 1e-3)], true)).unwrap();
        unfolded(&umbrella(&[Vec3::X, Vec3::new(-1.0, 1e-3, 0.0)], false)).unwrap();
        let at = |degrees: f32| Vec2::from_angle(degrees.to_radians()).extend(0.1 * degrees.sin());
        for turns in [[172.6, 84.0, 56.0, 34.0, 5.0], [172.6, 172.0, 0.0, 0.0, 1e-4]] {
            let mut angle = 0.0;
            let ring = turns.map(|turn| {
                angle += turn;
                at(angle)
            });
            unfolded(&umbrella(&ring, true)).unwrap();
        }
    }

    proptest! {
        #[test]
        fn fans_close_share_their_spokes_and_keep_their_radii(
            ring in prop::collection::vec((0.1f32..2.0, -3.0f32..3.0), 4..30),
            closed in any::<bool>(),
        ) {
            let n = ring.len() as f32;
            let ring: Vec<Vec3> = ring
                .iter()
                .enumerate()
                .map(|(i, &(radius, height))| {
                    (radius * Vec2::from_angle(std::f32::consts::TAU * i as f32 / n)).extend(height)
                })
                .collect();
            if let Some(planar) = unfolded(&umbrella(&ring, closed)) {
                for pair in planar.windows(2) {
                    prop_assert_eq!(pair[0][2], pair[1][1]);
                }
                if closed {
                    prop_assert_eq!(planar[planar.len() - 1][2], planar[0][1]);
                    prop_assert!((turn(&planar) - std::f64::consts::TAU).abs() < 1e-4);
                } else {
                    prop_assert!(turn(&planar) < MAX_OPEN_FAN_ANGLE + 1e-4);
                }
            }
        }
    }
}
