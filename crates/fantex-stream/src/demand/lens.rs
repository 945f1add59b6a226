//! What a camera sees of bounded pieces of surface: whether they are in the picture, and how wide a pixel is on them.
//!
//! A pixel whose ray has the direction `w` (cosine `c` to the line of sight) and meets the surface at distance `r` spans
//! there, on a plane that faces the ray, an ellipse with the axes `r c / f` and `r c^2 / f` (`f` = pixels per unit at depth
//! one). On a plane with normal `n` the shorter axis is no shorter, and the longer one at least `r c / f max(1, c / |n.w|)`.
//! Through the map to texels, whose singular values are `s <= t`, the shorter axis grows at least by `s`, and the longer one
//! becomes at least as long as itself times `s`, and as the shorter one times `t`: the ellipse holds a circle as wide as its
//! shorter axis. All bounds hold for every point in the sphere and every normal in the cone, so no look-up reads a finer level
//! than the one that follows from them.

use glam::Vec3;

use super::bounds::{Bounds, LogDensities, Sphere};
use super::relief::Relief;
use crate::StreamView;

/// Ratios of singular values of maps to tiles are seldom greater.
const MOST_STRETCH: f32 = 4.0;

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
        self.inverse_anisotropy > MOST_STRETCH.recip()
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
        longer.log2() + relief.log2_density()
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
