//! How each fan is laid flat: projected along its best direction, unfolded, or split.

use fantex_mesh::unit_vector;
use glam::{Vec2, Vec3};

use crate::cone::{Cone, narrowest_cone};
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
    /// Neither works: every triangle must go alone.
    Split,
}

/// The decision for one fan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FanShape {
    pub(crate) layout: Layout,
    /// Best direction and its smallest facing cosine.
    pub(crate) cone: Cone,
    /// A third of the area of the fan's triangles.
    pub(crate) area: f32,
    /// True where no direction sees the whole fan from the front.
    pub(crate) folds: bool,
}

impl FanShape {
    /// Decides about a fan whose geometry is in `ring`.
    pub(crate) fn of(ring: &Ring, surface: &Surface<'_>, fan: usize) -> Self {
        let cone = narrowest_cone(&ring.normals);
        let projectable = cone.cos > FOLDED_BELOW && winds_once(ring, cone.axis);
        let layout = if projectable && cone.cos >= UNFOLD_BELOW {
            Layout::Projected
        } else if unfold(surface, fan).is_some() {
            Layout::Unfolded
        } else if projectable {
            Layout::Projected
        } else {
            Layout::Split
        };
        Self { layout, cone, area: ring.area / 3.0, folds: !projectable }
    }
}

/// True where the projected fan surrounds its centre at most once. All its triangles face the direction.
fn winds_once(ring: &Ring, direction: Vec3) -> bool {
    let (x_axis, y_axis) = direction.any_orthonormal_pair();
    if ring.closed {
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
    let flat = |v: &Vec3| Vec2::new(v.dot(x_axis), v.dot(y_axis));
    let total: f32 = ring.spokes.windows(2).map(|pair| flat(&pair[0]).angle_to(flat(&pair[1])).abs()).sum();
    total < std::f32::consts::TAU
}

// Unfolding a fan about its centre: radii are kept, angles are scaled so that a closed fan closes.

/// After scaling no triangle may span more than this angle at the centre, or it would degenerate (170 degrees).
const MAX_TRIANGLE_ANGLE: f32 = 2.967;

/// An open fan is not spread over more than this angle (300 degrees).
const MAX_OPEN_FAN_ANGLE: f32 = 5.236;

/// Planar coordinates of the centre (the origin) and the two ring vertices of each triangle, in the fan's order and
/// mesh units; `None` where a triangle is too wide to be unfolded (a cone of three triangles pressed flat, for example).
pub(crate) fn unfold(surface: &Surface<'_>, fan: usize) -> Option<Vec<[Vec2; 3]>> {
    let corners = surface.fans.corners(fan);
    let spans: Vec<[f32; 3]> = corners
        .iter()
        .map(|&c| {
            let [center, from, to] = surface.fan_triangle(c);
            let (from, to) = (from - center, to - center);
            [libm::atan2f(from.cross(to).length(), from.dot(to)), from.length(), to.length()]
        })
        .collect();
    let total: f32 = spans.iter().map(|s| s[0]).sum();
    let closed = surface.fans.is_closed(fan);
    let factor = if closed { std::f32::consts::TAU / total } else { (MAX_OPEN_FAN_ANGLE / total).min(1.0) };
    if !factor.is_finite() || spans.iter().any(|s| s[0] * factor > MAX_TRIANGLE_ANGLE) {
        return None;
    }
    let mut angle = 0.0;
    let mut unfolded = Vec::with_capacity(corners.len());
    for (i, [span, from, to]) in spans.iter().enumerate() {
        let start = unit_vector(angle) * from;
        angle += span * factor;
        let last = closed && i + 1 == spans.len();
        let end = if last { Vec2::X } else { unit_vector(angle) };
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

    fn turn(planar: &[[Vec2; 3]]) -> f32 {
        planar.iter().map(|t| t[1].angle_to(t[2])).sum()
    }

    #[test]
    fn a_flat_umbrella_stays_as_it_is() {
        let ring: Vec<Vec3> = (0..7).map(|i| Vec2::from_angle(i as f32 * 0.8).extend(0.0)).collect();
        let planar = unfolded(&umbrella(&ring, false)).unwrap();
        assert!((turn(&planar) - 4.8).abs() < 1e-5);
    }

    #[test]
    fn flattened_cones_and_wide_triangles_cannot_be_unfolded() {
        assert!(unfolded(&umbrella(&[Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 1e-3)], true)).is_none());
        assert!(unfolded(&umbrella(&[Vec3::X, Vec3::new(-1.0, 1e-3, 0.0)], false)).is_none());
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
                    prop_assert!((turn(&planar) - std::f32::consts::TAU).abs() < 1e-4);
                } else {
                    prop_assert!(turn(&planar) < MAX_OPEN_FAN_ANGLE + 1e-4);
                }
            }
        }
    }
}
