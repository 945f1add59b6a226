//! Unfolding a fan about its centre: radii are kept, angles are scaled so that a closed fan closes.

use glam::Vec2;

use crate::surface::Surface;

/// After scaling no triangle may span more than this angle at the centre, or it would degenerate (170 degrees).
const WIDEST_TRIANGLE: f32 = 2.967;

/// An open fan is not spread over more than this angle (300 degrees).
const WIDEST_OPEN_FAN: f32 = 5.236;

/// Planar coordinates of the centre (the origin) and the two ring vertices of each triangle, in the fan's order and
/// mesh units; `None` where a triangle is too wide to be unfolded (two triangles glued back to back, for example).
pub(crate) fn unfold(surface: &Surface<'_>, fan: usize) -> Option<Vec<[Vec2; 3]>> {
    let corners = surface.fans.corners(fan);
    let spans: Vec<[f32; 3]> = corners
        .iter()
        .map(|&c| {
            let [center, from, to] = surface.fan_triangle(c);
            let (from, to) = (from - center, to - center);
            [from.cross(to).length().atan2(from.dot(to)), from.length(), to.length()]
        })
        .collect();
    let total: f32 = spans.iter().map(|s| s[0]).sum();
    let closed = surface.fans.is_closed(fan);
    let factor = if closed { std::f32::consts::TAU / total } else { (WIDEST_OPEN_FAN / total).min(1.0) };
    if !factor.is_finite() || spans.iter().any(|s| s[0] * factor > WIDEST_TRIANGLE) {
        return None;
    }
    let mut angle = 0.0;
    let mut unfolded = Vec::with_capacity(corners.len());
    for (i, [span, from, to]) in spans.iter().enumerate() {
        let start = Vec2::from_angle(angle) * from;
        angle += span * factor;
        let last = closed && i + 1 == spans.len();
        let end = if last { Vec2::X } else { Vec2::from_angle(angle) };
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
