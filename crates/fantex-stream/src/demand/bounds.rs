//! What a camera sees of bounded pieces of surface: whether they are in the picture, and how wide a pixel is on them.
//!
//! A pixel whose ray has the direction `w` (cosine `c` to the line of sight) and meets the surface at distance `r` spans
//! there, on a plane that faces the ray, an ellipse with the axes `r c / f` and `r c^2 / f` (`f` = pixels per unit at depth
//! one). On a plane with normal `n` the shorter axis is no shorter, and the longer one at least `r c / f max(1, c / |n.w|)`.
//! Through the map to texels, whose singular values are `s <= t`, the shorter axis grows at least by `s`, and the longer one
//! becomes at least as long as itself times `s`, and as the shorter one times `t`: the ellipse holds a circle as wide as its
//! shorter axis. All bounds hold for every point in the sphere and every normal in the cone, so no look-up reads a finer level
//! than the one that follows from them.

use fantex_cover::{Cover, Group, GroupKind, GroupTriangles};
use fantex_mesh::Mesh;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::paged::{Densities, densities, piece_points};
use crate::StreamView;

/// Ratios of singular values of maps to tiles are seldom greater.
const MAX_STRETCH: f32 = 4.0;

/// How far the camera may move and turn until bounds are taken again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Slack {
    /// Mesh units.
    pub(crate) travel: f32,
    /// Radians.
    pub(crate) turn: f32,
}

/// Whether a piece is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Sight {
    /// Not at all, until the camera has moved or turned so far.
    Hidden(Slack),
    /// Perhaps in part.
    Partial,
    /// All of it: inside the picture, and no back is turned to the camera that would not be drawn.
    Whole,
}

/// A camera, prepared.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    eye: Vec3,
    forward: Vec3,
    /// Unit normals of the frustum's sides, inwards; all pass through the eye. The last one is the line of sight.
    planes: [Vec3; 5],
    /// Cosine between the line of sight and the rays through the picture's corners.
    corner_cos: f32,
    /// Width of a pixel at depth one.
    pixel: f32,
    inverse_anisotropy: f32,
}

impl Lens {
    pub(crate) fn new(view: &StreamView, max_anisotropy: f32) -> Self {
        let [x, y] = view.half_extent;
        let (right, up, forward) = (view.axes.x_axis, view.axes.y_axis, -view.axes.z_axis);
        let side = |reach: f32, out: Vec3| (forward * reach - out).normalize_or(forward);
        Self {
            eye: view.eye,
            forward,
            planes: [side(x, right), side(x, -right), side(y, up), side(y, -up), forward],
            corner_cos: (1.0 + x * x + y * y).sqrt().recip(),
            pixel: view.focal_pixels.recip(),
            inverse_anisotropy: max_anisotropy.max(1.0).recip(),
        }
    }

    /// Whether a sphere may be in the picture.
    pub(crate) fn may_see(&self, sphere: &Sphere) -> bool {
        let to_center = sphere.center - self.eye;
        self.planes.iter().all(|n| n.dot(to_center) >= -sphere.radius)
    }

    /// Distance of the nearest point of a sphere; negative inside.
    #[inline]
    pub(crate) fn gap(&self, sphere: &Sphere) -> f32 {
        self.eye.distance(sphere.center) - sphere.radius
    }

    /// Distance of the farthest point of a sphere, per unit of the nearest one's.
    #[inline]
    pub(crate) fn depth_ratio(&self, sphere: &Sphere) -> f32 {
        let distance = self.eye.distance(sphere.center);
        if distance > sphere.radius {
            (distance + sphere.radius) / (distance - sphere.radius)
        } else {
            f32::INFINITY
        }
    }

    /// Whether a piece is seen by any camera within `slack` of this one.
    #[inline]
    pub(crate) fn sight(&self, bounds: &Bounds, slack: Slack) -> Sight {
        let Bounds { sphere, cone, .. } = bounds;
        if bounds.is_nothing() {
            return Sight::Hidden(Slack { travel: f32::INFINITY, turn: f32::INFINITY });
        }
        let to_center = sphere.center - self.eye;
        let distance = to_center.length();
        let reach = sphere.radius + slack.travel + (distance + sphere.radius) * slack.turn;
        let inside = self.planes.iter().map(|n| n.dot(to_center)).fold(f32::INFINITY, f32::min);
        if inside < -reach {
            let left = -inside - sphere.radius;
            let turn = 0.5 * left / (distance + sphere.radius);
            return Sight::Hidden(Slack { travel: 0.5 * left, turn });
        }
        if cone.is_culled && cone.cos > 0.0 {
            let sin = (1.0 - cone.cos * cone.cos).max(0.0).sqrt();
            let along = cone.axis.dot(to_center);
            // Every normal n in the cone and point p in the sphere: n.(p - eye) > 0.
            let behind = along - sin * distance - sphere.radius;
            if behind > 2.0 * slack.travel {
                return Sight::Hidden(Slack { travel: 0.5 * behind, turn: f32::INFINITY });
            }
            if along + sin * distance + sphere.radius > -2.0 * slack.travel {
                return Sight::Partial;
            }
        } else if cone.is_culled {
            return Sight::Partial;
        }
        if inside < reach { Sight::Partial } else { Sight::Whole }
    }

    /// A lower bound of the binary logarithm of the width, in texels, that decides levels: that of the pixel's shorter axis, or
    /// of the longer one divided by the greatest anisotropy, whichever is more. Holds for every camera within `slack` of this
    /// one.
    #[inline]
    pub(crate) fn log2_width(&self, bounds: &Bounds, relief: &Relief, slack: Slack) -> f32 {
        let pixel = self.pixel_on(bounds, slack);
        let log2_width = pixel.log2_width(bounds.density);
        if !self.uses_relief() {
            return log2_width;
        }
        log2_width.max(self.log2_width_in_tile(&pixel, bounds.sphere.center, relief, slack))
    }

    /// Whether [`Lens::log2_width_in_tile`] can tell more than the widths that [`Lens::pixel_on`] gives: it bounds the longer axis,
    /// which hardly counts where anisotropic look-ups honour much longer ones.
    #[inline]
    pub(crate) fn uses_relief(&self) -> bool {
        self.inverse_anisotropy > MAX_STRETCH.recip()
    }

    /// Another bound of the longer axis, from how a piece lies in its tile (see [`Relief`]). `pixel` is that of the piece or of
    /// one that holds it.
    #[inline]
    pub(crate) fn log2_width_in_tile(
        &self,
        pixel: &PixelWidth,
        center: Vec3,
        relief: &Relief,
        slack: Slack,
    ) -> f32 {
        let plane_distance = relief.plane_distance(center - self.eye, slack.travel);
        let slant = (pixel.least_depth / plane_distance.max(1e-3 * pixel.least_depth)).max(pixel.least_cos);
        let longer = self.pixel * pixel.least_depth * slant * self.inverse_anisotropy;
        longer.log2() + relief.log2_density
    }

    /// How wide a pixel is at least on a piece of surface. The same holds of everything within the piece.
    #[inline]
    pub(crate) fn pixel_on(&self, bounds: &Bounds, slack: Slack) -> PixelWidth {
        let Bounds { sphere, cone, .. } = bounds;
        let to_center = sphere.center - self.eye;
        let distance = to_center.length();
        let nearest = distance - sphere.radius - slack.travel;
        if nearest <= 0.0 {
            return PixelWidth::NONE;
        }
        let ray = to_center / distance;
        let spread = ((sphere.radius + slack.travel) / distance + slack.turn).min(1.0);
        let least_cos = narrowed_cos(self.forward.dot(ray), spread).clamp(self.corner_cos, 1.0);
        let shorter = nearest * self.pixel * least_cos * least_cos;
        // How squarely the surface may be seen.
        let cone_sin = (1.0 - cone.cos * cone.cos).max(0.0).sqrt();
        let spread_cos = (1.0 - spread * spread).max(0.0).sqrt();
        let (sin, cos) =
            (cone_sin * spread_cos + cone.cos * spread, cone.cos * spread_cos - cone_sin * spread);
        let facing = -cone.axis.dot(ray);
        let facing = if cone.is_culled { facing } else { facing.abs() }.clamp(-1.0, 1.0);
        let most_facing = if cos <= 0.0 || facing >= cos {
            1.0
        } else {
            facing * cos + (1.0 - facing * facing).sqrt() * sin.max(0.0)
        };
        let slant = (least_cos / most_facing.clamp(1e-3, 1.0)).max(1.0);
        let longer = nearest * self.pixel * least_cos * slant;
        // Maps that stretch by more than that are rare, and a bound that is not taken is none too high.
        let log2_most =
            if self.uses_relief() { (shorter * self.inverse_anisotropy).log2() } else { f32::NEG_INFINITY };
        let depth = self.forward.dot(to_center) - sphere.radius;
        let least_depth = depth - slack.travel - (distance + sphere.radius) * slack.turn;
        PixelWidth {
            log2_least: shorter.max(longer * self.inverse_anisotropy).log2(),
            log2_most,
            least_depth: least_depth.max(nearest * least_cos),
            least_cos,
        }
    }
}

/// Lower bounds of a pixel's width on the surface, mesh units, as binary logarithms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelWidth {
    /// Of what the smaller singular value of the map to texels multiplies.
    log2_least: f32,
    /// Of what the larger one does.
    log2_most: f32,
    /// Mesh units along the line of sight.
    least_depth: f32,
    /// Cosine of the greatest angle between a ray to the piece and the line of sight.
    least_cos: f32,
}

impl PixelWidth {
    /// The piece may touch the eye.
    const NONE: Self = Self {
        log2_least: f32::NEG_INFINITY,
        log2_most: f32::NEG_INFINITY,
        least_depth: 0.0,
        least_cos: 0.0,
    };

    /// The same in texels.
    #[inline]
    pub(crate) fn log2_width(self, densities: LogDensities) -> f32 {
        (self.log2_least + densities.least).max(self.log2_most + densities.most)
    }
}

/// The cosine of an angle that is wider by one whose sine is given.
#[inline]
fn narrowed_cos(cos: f32, sin_more: f32) -> f32 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    cos * (1.0 - sin_more * sin_more).max(0.0).sqrt() - sin * sin_more
}

// Bounds of pieces of surface: spheres, cones of normals, densities.

/// A ball around all points, mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sphere {
    pub(crate) center: Vec3,
    pub(crate) radius: f32,
}

/// All normals lie within an angle of the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NormalCone {
    /// Unit vector.
    pub(crate) axis: Vec3,
    /// Cosine of the angle; -1 where the normals share no half space.
    pub(crate) cos: f32,
    /// Whether the back is never seen.
    pub(crate) is_culled: bool,
}

/// What demand knows of a group, of a region of a tile or of many groups together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) sphere: Sphere,
    pub(crate) cone: NormalCone,
    /// The fewest texels per mesh unit.
    pub(crate) density: LogDensities,
}

/// Binary logarithms of lower bounds of the two singular values of maps from the surface to texels of level 0, per mesh unit;
/// infinite where there is no surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LogDensities {
    /// Of the smaller one: no direction on the surface has fewer texels.
    pub(crate) least: f32,
    /// Of the larger one: on every triangle some direction has as many.
    pub(crate) most: f32,
}

impl From<Densities> for LogDensities {
    fn from(densities: Densities) -> Self {
        Self { least: densities.least.log2(), most: densities.most.log2() }
    }
}

impl LogDensities {
    /// Of nothing.
    pub(crate) const NOTHING: Self = Self { least: f32::INFINITY, most: f32::INFINITY };

    fn min(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.min(other.most) }
    }
}

/// Gathers bounds in two passes: boxes and mean normals, then radii and angles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gathering {
    low: Vec3,
    high: Vec3,
    normals: Vec3,
    density: LogDensities,
    is_culled: bool,
}

impl Gathering {
    pub(crate) const EMPTY: Self = Self {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
        normals: Vec3::ZERO,
        density: LogDensities::NOTHING,
        is_culled: true,
    };

    pub(crate) fn add_point(&mut self, p: Vec3) {
        (self.low, self.high) = (self.low.min(p), self.high.max(p));
    }

    pub(crate) fn add_facet(&mut self, normal: Vec3, densities: Densities, is_culled: bool) {
        self.add_normals(normal, densities.into(), is_culled);
    }

    pub(crate) fn add_normals(&mut self, normals: Vec3, density: LogDensities, is_culled: bool) {
        self.normals += normals;
        self.density = self.density.min(density);
        self.is_culled &= is_culled;
    }

    /// The bounds as far as they are known: radius zero, a closed cone.
    pub(crate) fn begin(&self) -> Bounds {
        let center = if self.low.x <= self.high.x { 0.5 * (self.low + self.high) } else { Vec3::ZERO };
        Bounds {
            sphere: Sphere { center, radius: 0.0 },
            cone: NormalCone {
                axis: self.normals.normalize_or(Vec3::Z),
                cos: 1.0,
                is_culled: self.is_culled,
            },
            density: self.density,
        }
    }

    /// The bounds of these points, with these normals, which have been added; the points need not have been.
    pub(crate) fn finish(mut self, points: &[Vec3], normals: impl Iterator<Item = Vec3>) -> Bounds {
        points.iter().for_each(|&p| self.add_point(p));
        let mut bounds = self.begin();
        points.iter().for_each(|&p| bounds.widen_to_point(p));
        normals.for_each(|normal| bounds.widen_to_normal(normal));
        bounds
    }
}

impl Bounds {
    /// Of nothing.
    pub(crate) const NOTHING: Self = Self {
        sphere: Sphere { center: Vec3::ZERO, radius: 0.0 },
        cone: NormalCone { axis: Vec3::Z, cos: 1.0, is_culled: true },
        density: LogDensities::NOTHING,
    };

    pub(crate) fn widen_to_point(&mut self, p: Vec3) {
        self.sphere.radius = self.sphere.radius.max(self.sphere.center.distance(p));
    }

    pub(crate) fn widen_to_normal(&mut self, normal: Vec3) {
        self.cone.cos = self.cone.cos.min(self.cone.axis.dot(normal));
    }

    fn is_nothing(&self) -> bool {
        self.density == LogDensities::NOTHING
    }

    /// Around several, in order.
    pub(crate) fn around(parts: &[Self]) -> Self {
        let mut gathering = Gathering::EMPTY;
        for part in parts.iter().filter(|p| !p.is_nothing()) {
            gathering.add_point(part.sphere.center - part.sphere.radius);
            gathering.add_point(part.sphere.center + part.sphere.radius);
            gathering.add_normals(part.cone.axis, part.density, part.cone.is_culled);
        }
        if gathering.density == LogDensities::NOTHING {
            return Self::NOTHING;
        }
        let mut around = gathering.begin();
        for part in parts.iter().filter(|p| !p.is_nothing()) {
            let reach = around.sphere.center.distance(part.sphere.center) + part.sphere.radius;
            around.sphere.radius = around.sphere.radius.max(reach);
            let between = around.cone.axis.dot(part.cone.axis).clamp(-1.0, 1.0).acos();
            let angle = between + part.cone.cos.clamp(-1.0, 1.0).acos();
            let cos = if angle < std::f32::consts::PI { angle.cos() } else { -1.0 };
            around.cone.cos = around.cone.cos.min(cos);
        }
        around
    }
}

/// Bounds and reliefs of every group, in parallel; each group adds its triangles in order.
pub(crate) fn group_bounds(
    mesh: &Mesh,
    cover: &Cover,
    triangles: &GroupTriangles,
) -> (Vec<Bounds>, Vec<Relief>) {
    let groups = (0..cover.groups.len() as u32).into_par_iter().with_min_len(1 << 6);
    let bounds =
        |pieces: &mut Vec<Piece>, group| bounds_of(mesh, cover, group, triangles.of_group(group), pieces);
    groups.map_init(Vec::new, bounds).unzip()
}

/// What a group has of a triangle.
struct Piece {
    normal: Vec3,
    points: [Vec3; 12],
    count: usize,
}

/// Bounds of one group. `pieces` is scratch.
fn bounds_of(
    mesh: &Mesh,
    cover: &Cover,
    group: u32,
    triangles: &[u32],
    pieces: &mut Vec<Piece>,
) -> (Bounds, Relief) {
    pieces.clear();
    let mut gathering = Gathering::EMPTY;
    for t in triangles.iter().map(|&t| t as usize) {
        let corners = mesh.triangle_positions(t);
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let (points, count) = piece_points(corners, cover.corner_groups[t].map(|g| g == group), cover.delta);
        points[..count].iter().for_each(|&p| gathering.add_point(p));
        gathering.add_facet(normal, densities(mesh, cover, t, group), is_culled(mesh, t));
        pieces.push(Piece { normal, points, count });
    }
    let mut bounds = gathering.begin();
    for piece in pieces.iter() {
        piece.points[..piece.count].iter().for_each(|&p| bounds.widen_to_point(p));
        bounds.widen_to_normal(piece.normal);
    }
    let planes = pieces.iter().map(|piece| (piece.normal, piece.points[0]));
    let group = &cover.groups[group as usize];
    (bounds, Relief::new(group, bounds.sphere.center, bounds.cone.is_culled, planes))
}

/// Whether a triangle's back is never drawn.
pub(crate) fn is_culled(mesh: &Mesh, triangle: usize) -> bool {
    mesh.materials.get(mesh.material_of(triangle)).is_some_and(|material| !material.double_sided)
}

// How a piece of surface slopes over the plane of its tile: what bounds the longer axis of pixels in projected tiles.
//
// A tile map projects along a direction `d` (unit). Where a ray `w` meets a triangle with normal `n`, a step `e` of the picture,
// across the ray, moves the hit by `e - w (e.n)/(w.n)`, of which the tile sees the part across `d`. With the *plane vector*
// `m = n / (n.d)` and unit vectors `u` across both `w` and `d`, and `v` across `w` and `u`, the step `u` moves the tile
// coordinate by one along `u`, and somewhat along the other direction; the step `v` moves it by `1 / (m.w)` along that. So the
// longer axis of the pixel's image is at least one and at least `1 / |m.w|`, whatever the triangle's density along its slope:
// what a slope takes from the density it takes from the slant, too.
//
// And `m.(p - eye)` is the same for all points `p` of a triangle's plane. It is bounded over the triangles by an oriented box and an
// ellipse around the plane vectors, and by how far the planes pass the piece's middle. Bounds of the rays' directions, which
// cost most where large tiles are seen at a slant, are not needed.

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
const MIN_COS: f32 = 1e-3;

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
            let is_steep = normal.dot(direction).abs() < MIN_COS;
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
    fn plane_distance(&self, to_center: Vec3, travel: f32) -> f32 {
        let middle = self.middle.dot(to_center) + self.offset;
        let middle = if self.is_culled { -middle } else { middle.abs() };
        let [a, b] = self.axes.map(|axis| axis.dot(to_center).abs());
        let spread = (a + b).min(self.roundness * (a * a + b * b).sqrt());
        middle + spread + self.offset_reach + self.longest * travel
    }
}

/// The direction in which a symmetric matrix stretches most, unit.
fn principal_axis(xx: f32, xy: f32, yy: f32) -> Vec2 {
    let half = 0.5 * (xx - yy);
    let root = half.hypot(xy);
    let axis = if half >= 0.0 { Vec2::new(half + root, xy) } else { Vec2::new(xy, root - half) };
    axis.normalize_or(Vec2::X)
}
