//! How a piece of surface slopes over the plane of its tile: what bounds the longer axis of pixels in projected tiles.
//!
//! A tile map projects along a direction `d` (unit). Where a ray `w` meets a triangle with normal `n`, a step `e` of the picture,
//! across the ray, moves the hit by `e - w (e.n)/(w.n)`, of which the tile sees the part across `d`. With the *plane vector*
//! `m = n / (n.d)` and unit vectors `u` across both `w` and `d`, and `v` across `w` and `u`, the step `u` moves the tile
//! coordinate by one along `u`, and somewhat along the other direction; the step `v` moves it by `1 / (m.w)` along that. So the
//! longer axis of the pixel's image is at least one and at least `1 / |m.w|`, whatever the triangle's density along its slope:
//! what a slope takes from the density it takes from the slant, too.
//!
//! And `m.(p - eye)` is the same for all points `p` of a triangle's plane. It is bounded over the triangles by an oriented box and an
//! ellipse around the plane vectors, and by how far the planes pass the piece's middle. Bounds of the rays' directions, which
//! cost most where large tiles are seen at a slant, are not needed.

use glam::{Vec2, Vec3};

use fantex_cover::{Group, GroupKind};

/// Slopes of a piece of surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Relief {
    /// The middle of the box around the plane vectors.
    middle: Vec3,
    /// Halves of its sides.
    axes: [Vec3; 2],
    /// How many times as large the ellipse with these axes must be to hold the plane vectors.
    roundness: f32,
    /// The middle of `m.(p - center)` over the triangles.
    offset: f32,
    /// Half the length of its range.
    offset_reach: f32,
    /// The length of the longest plane vector.
    longest: f32,
    /// Whether only triangles are drawn whose plane vector points towards the eye.
    is_culled: bool,
    /// Texels of level 0 per unit of length in the plane of the tile, along the axis that has fewer, as a binary logarithm.
    log2_density: f32,
}

/// Slopes steeper than this (the cosine to the tile's direction) are not told from vertical ones.
const LEAST_COS: f32 = 1e-3;

impl Relief {
    /// Nothing is known.
    pub(crate) const UNKNOWN: Self = Self {
        middle: Vec3::ZERO,
        axes: [Vec3::ZERO; 2],
        roundness: 0.0,
        offset: 0.0,
        offset_reach: 0.0,
        longest: 0.0,
        is_culled: false,
        log2_density: f32::NEG_INFINITY,
    };

    /// Of the triangles in a group's tile, each with its unit normal and a point of its plane; no back is drawn if `is_culled`.
    /// `center` is where [`Relief::plane_distance`] measures from.
    pub(crate) fn new(
        group: &Group,
        center: Vec3,
        is_culled: bool,
        triangles: impl Iterator<Item = (Vec3, Vec3)> + Clone,
    ) -> Self {
        if group.kind != GroupKind::Projected {
            return Self::UNKNOWN;
        }
        let direction = group.frame.direction;
        // Triangles without area have no pixels.
        let triangles = triangles.filter(|(normal, _)| *normal != Vec3::ZERO);
        let planes = triangles.clone().map(|(normal, point)| {
            let plane = normal / normal.dot(direction);
            let is_steep = normal.dot(direction).abs() < LEAST_COS;
            (if is_steep { Vec3::INFINITY } else { plane }, plane.dot(point - center))
        });
        // The part of a plane vector across the direction: minus the slope.
        let x_axis = group.frame.x_axis;
        let y_axis = group.frame.y_axis();
        let slope = |plane: Vec3| Vec2::new(plane.dot(x_axis), plane.dot(y_axis));
        let (mut count, mut sum, mut squares) = (0.0, Vec2::ZERO, [0.0; 3]);
        for (plane, _) in planes.clone() {
            if !plane.is_finite() {
                return Self::UNKNOWN;
            }
            let s = slope(plane);
            count += 1.0;
            sum += s;
            squares = [squares[0] + s.x * s.x, squares[1] + s.x * s.y, squares[2] + s.y * s.y];
        }
        if count == 0.0 {
            return Self::UNKNOWN;
        }
        let mean = sum / count;
        let [xx, xy, yy] = squares;
        let first = principal_axis(
            xx / count - mean.x * mean.x,
            xy / count - mean.x * mean.y,
            yy / count - mean.y * mean.y,
        );
        let turned = |plane: Vec3| {
            let s = slope(plane);
            Vec2::new(s.dot(first), s.dot(first.perp()))
        };
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        let (mut near, mut far, mut longest) = (f32::INFINITY, f32::NEG_INFINITY, 0.0f32);
        for (plane, offset) in planes.clone() {
            let s = turned(plane);
            (low, high) = (low.min(s), high.max(s));
            (near, far) = (near.min(offset), far.max(offset));
            longest = longest.max(plane.length());
        }
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let roundness = planes
            .map(|(plane, _)| ((turned(plane) - middle) / half.max(Vec2::splat(1e-9))).length())
            .fold(0.0, f32::max);
        let in_space = |s: Vec2| {
            let s = first * s.x + first.perp() * s.y;
            x_axis * s.x + y_axis * s.y
        };
        let texels = group.uv_scale * Vec2::from(group.extent.map(|n| n as f32));
        Self {
            middle: direction + in_space(middle),
            axes: [in_space(Vec2::new(half.x, 0.0)), in_space(Vec2::new(0.0, half.y))],
            roundness,
            offset: 0.5 * (near + far),
            offset_reach: 0.5 * (far - near),
            longest,
            is_culled: is_culled && triangles.clone().all(|(normal, _)| normal.dot(direction) > 0.0),
            log2_density: texels.abs().min_element().log2(),
        }
    }

    /// The greatest `|m.(p - eye)|` of a triangle that is seen by an eye that has the center at `to_center`, or is as far as `travel`
    /// from there; nothing or less if none is.
    #[inline]
    pub(crate) fn plane_distance(&self, to_center: Vec3, travel: f32) -> f32 {
        let middle = self.middle.dot(to_center) + self.offset;
        let middle = if self.is_culled { -middle } else { middle.abs() };
        let [a, b] = self.axes.map(|axis| axis.dot(to_center).abs());
        let spread = (a + b).min(self.roundness * (a * a + b * b).sqrt());
        middle + spread + self.offset_reach + self.longest * travel
    }

    /// Texels of level 0 per unit of length in the tile's plane, as a binary logarithm; negative infinity where nothing is known.
    #[inline]
    pub(crate) fn log2_density(&self) -> f32 {
        self.log2_density
    }
}

/// The direction in which a symmetric matrix stretches most, unit.
fn principal_axis(xx: f32, xy: f32, yy: f32) -> Vec2 {
    let half = 0.5 * (xx - yy);
    let root = half.hypot(xy);
    let axis = if half >= 0.0 { Vec2::new(half + root, xy) } else { Vec2::new(xy, root - half) };
    axis.normalize_or(Vec2::X)
}
