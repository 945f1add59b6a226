//! Projection along a direction onto a placed plane.

use glam::{Quat, Vec2, Vec3};

use super::{Bounds, Mapping, SurfacePoint};
use crate::{Allowed, InvalidOption};

/// Orthogonal projection onto a plane: `u` and `v` are affine in the point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarMap {
    /// The point with `u = v = 0`.
    pub origin: Vec3,
    /// The gradient of `u`: direction and images per unit of length.
    pub u_gradient: Vec3,
    /// The gradient of `v`.
    pub v_gradient: Vec3,
}

impl PlanarMap {
    /// A plane that stands upright (image to the right = +x, image down = -y, seen from +z), turned by `rotation`, with the
    /// image's top left corner at `translation`. The image covers `scale` units of length and is repeated `repeat` times
    /// within them.
    pub fn placed(rotation: Quat, translation: Vec3, scale: Vec2, repeat: Vec2) -> Self {
        let per_unit = repeat / scale;
        Self {
            origin: translation,
            u_gradient: rotation * Vec3::X * per_unit.x,
            v_gradient: rotation * Vec3::NEG_Y * per_unit.y,
        }
    }

    /// The image over the front of `bounds`, projected along the shortest edge. Its right is the longest edge and its
    /// down the second one, except that y is always up where it is one of the two.
    pub fn fit(bounds: Bounds) -> Self {
        let extent = bounds.extent();
        let (min, max) = (bounds.min, bounds.max);
        if extent.z <= extent.x && extent.z <= extent.y {
            Self::from_corner(Vec3::new(min.x, max.y, max.z), Vec3::X / extent.x, Vec3::NEG_Y / extent.y)
        } else if extent.y <= extent.x {
            // From above: the image's top is the far side (-z).
            Self::from_corner(Vec3::new(min.x, max.y, min.z), Vec3::X / extent.x, Vec3::Z / extent.z)
        } else {
            Self::from_corner(Vec3::new(max.x, max.y, max.z), Vec3::NEG_Z / extent.z, Vec3::NEG_Y / extent.y)
        }
    }

    fn from_corner(origin: Vec3, u_gradient: Vec3, v_gradient: Vec3) -> Self {
        Self { origin, u_gradient, v_gradient }
    }

    /// The point of the plane through the origin with these coordinates.
    pub fn point(&self, uv: Vec2) -> Vec3 {
        // The dual basis: its first vector changes u by 1 and leaves v as it is.
        let across = self.u_gradient.cross(self.v_gradient);
        let dual_u = self.v_gradient.cross(across);
        let dual_v = across.cross(self.u_gradient);
        self.origin + (dual_u * uv.x + dual_v * uv.y) / across.length_squared()
    }

    /// The unit normal towards the viewer who sees the image unmirrored.
    fn normal(&self) -> Vec3 {
        self.v_gradient.cross(self.u_gradient).normalize_or_zero()
    }

    /// Where the line meets the plane; none for a line along it.
    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<SurfacePoint> {
        let normal = self.normal();
        let approach = normal.dot(direction);
        if approach.abs() <= 1e-6 * direction.length() {
            return None;
        }
        let position = origin + direction * (normal.dot(self.origin - origin) / approach);
        Some(SurfacePoint { position, normal })
    }

    /// The foot of the perpendicular.
    pub(super) fn foot(&self, p: Vec3) -> SurfacePoint {
        let normal = self.normal();
        SurfacePoint { position: p - normal * normal.dot(p - self.origin), normal }
    }

    pub(super) fn check(&self) -> Result<(), InvalidOption> {
        const OWNER: &str = "a plane mapping";
        Allowed::Finite.check(OWNER, "the origin", &self.origin.to_array())?;
        for gradient in [self.u_gradient, self.v_gradient] {
            Allowed::Finite.check(OWNER, "a gradient", &gradient.to_array())?;
        }
        let area = self.u_gradient.cross(self.v_gradient).length();
        if area <= 1e-6 * self.u_gradient.length() * self.v_gradient.length() {
            return Err(InvalidOption::Singular { owner: OWNER, field: "the pair of gradients" });
        }
        Ok(())
    }

    fn linear(&self, direction: Vec3) -> Vec2 {
        Vec2::new(self.u_gradient.dot(direction), self.v_gradient.dot(direction))
    }
}

impl Mapping for PlanarMap {
    fn uv(&self, p: Vec3, _n: Vec3) -> Vec2 {
        self.linear(p - self.origin)
    }

    fn uv_footprint(&self, _p: Vec3, _n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        [self.linear(dp_dx), self.linear(dp_dy)]
    }
}
