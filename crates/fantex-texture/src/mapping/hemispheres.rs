//! Two hemispheres by stereographic projection.

use glam::{Vec2, Vec3};

use super::sphere::{foot_on_sphere, leave_sphere};
use super::{Bounds, Mapping, SurfacePoint};
use crate::{Allowed, InvalidOption};

/// How the discs of the two hemispheres lie in the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HemisphereLayout {
    /// Both show the disc that the image's edges touch.
    #[default]
    Shared,
    /// The upper one shows the disc in the left half, the lower one that in the right half.
    SideBySide,
}

/// The upper hemisphere (+y) projected from the lower pole onto the plane of the equator, the lower one from the upper pole.
///
/// The projection keeps angles. The two images break at the equator, nowhere else; at the poles the map is as regular as
/// anywhere. Seen from above, right is +x and down +z; seen from below, right is +x and down -z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HemisphereMap {
    /// Centre of the sphere.
    pub center: Vec3,
    /// Radius of the sphere: of importance where rays meet it.
    pub radius: f32,
    /// Where the discs lie.
    pub layout: HemisphereLayout,
}

impl HemisphereMap {
    /// The sphere around `bounds`, both halves with the same image.
    pub fn fit(bounds: Bounds) -> Self {
        let radius = 0.5 * bounds.extent().length();
        Self { center: bounds.center(), radius, layout: HemisphereLayout::Shared }
    }

    /// The point of the sphere with these coordinates: on the side of the equator to which `n` points where both halves share
    /// the image, on that of the disc otherwise.
    pub fn point(&self, uv: Vec2, n: Vec3) -> Vec3 {
        let is_upper = match self.layout {
            HemisphereLayout::Shared => n.y >= 0.0,
            HemisphereLayout::SideBySide => uv.x < 0.5,
        };
        let (center, size) = self.disc(is_upper);
        let q = (uv - center) / size;
        let scale = 1.0 / (1.0 + q.length_squared());
        let up = (1.0 - q.length_squared()) * scale;
        let side = side(is_upper);
        self.center + self.radius * Vec3::new(2.0 * q.x * scale, side * up, side * 2.0 * q.y * scale)
    }

    /// Where the disc's centre lies in the image, and its radii.
    fn disc(&self, is_upper: bool) -> (Vec2, Vec2) {
        match self.layout {
            HemisphereLayout::Shared => (Vec2::splat(0.5), Vec2::splat(0.5)),
            HemisphereLayout::SideBySide => {
                (Vec2::new(if is_upper { 0.25 } else { 0.75 }, 0.5), Vec2::new(0.25, 0.5))
            }
        }
    }

    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
        leave_sphere(self.center, self.radius, origin, direction)
    }

    pub(super) fn foot(&self, p: Vec3) -> SurfacePoint {
        foot_on_sphere(self.center, self.radius, p)
    }

    pub(super) fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a hemispheres mapping";
        Allowed::Finite.check(OWNER, "the centre", &self.center.to_array())?;
        Allowed::Positive.check(OWNER, "the radius", &[self.radius])
    }
}

fn side(is_upper: bool) -> f32 {
    if is_upper { 1.0 } else { -1.0 }
}

impl Mapping for HemisphereMap {
    fn uv(&self, p: Vec3, _n: Vec3) -> Vec2 {
        let local = p - self.center;
        let is_upper = local.y >= 0.0;
        let (center, size) = self.disc(is_upper);
        let reach = local.length() + local.y.abs();
        let q = Vec2::new(local.x, side(is_upper) * local.z) / reach;
        if reach > 0.0 { center + q * size } else { center }
    }

    fn uv_footprint(&self, p: Vec3, _n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let local = p - self.center;
        let is_upper = local.y >= 0.0;
        let (_, size) = self.disc(is_upper);
        let length = local.length();
        let reach = length + local.y.abs();
        if reach <= 0.0 {
            // At the centre every direction counts as one full image.
            return [2.0 * size; 2];
        }
        let side = side(is_upper);
        let q = Vec2::new(local.x, side * local.z) / reach;
        [dp_dx, dp_dy].map(|step| {
            let reach_step = local.dot(step) / length + side * step.y;
            let change = (Vec2::new(step.x, side * step.z) - q * reach_step) / reach;
            change.clamp(Vec2::splat(-2.0), Vec2::splat(2.0)) * size
        })
    }
}
