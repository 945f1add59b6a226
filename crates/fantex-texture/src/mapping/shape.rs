//! Intermediate surfaces: plane, box, cylinder, sphere, two hemispheres. Each with its texture coordinates, their inverse, and where a ray leaves it.

use std::f32::consts::{PI, TAU};

use fantex_base::Aabb;
use glam::{Quat, Vec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Mapping, ShapePoint};
use crate::Allowed;
use crate::invalid_option::singular;

// Projection along a direction onto a placed plane.

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
    pub fn fit(bounds: Aabb) -> Self {
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
    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<ShapePoint> {
        let normal = self.normal();
        let approach = normal.dot(direction);
        if approach.abs() <= 1e-6 * direction.length() {
            return None;
        }
        let position = origin + direction * (normal.dot(self.origin - origin) / approach);
        Some(ShapePoint { position, normal })
    }

    /// The foot of the perpendicular.
    pub(super) fn foot(&self, p: Vec3) -> ShapePoint {
        let normal = self.normal();
        ShapePoint { position: p - normal * normal.dot(p - self.origin), normal }
    }

    pub(super) fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "a plane mapping";
        Allowed::Finite.check(OWNER, "the origin", &self.origin.to_array())?;
        for gradient in [self.u_gradient, self.v_gradient] {
            Allowed::Finite.check(OWNER, "a gradient", &gradient.to_array())?;
        }
        let area = self.u_gradient.cross(self.v_gradient).length();
        if area <= 1e-6 * self.u_gradient.length() * self.v_gradient.length() {
            return Err(singular(OWNER, "the pair of gradients"));
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

// The six faces of a bounding box.

/// Projection along the coordinate axis that is nearest to the normal.
///
/// On every face the longer of its two edges is `u` and the other `v`, both in units of the box's longest edge, so the
/// image keeps its proportions and one image covers the longest edge once. From outside, every face shows the image as it
/// is, not mirrored: upright where y is `v`, and lying on its left side (its right pointing to +y) where y is `u`; the image's
/// down is +z on the top and -z on the bottom (where z is `u`, its right is -z and +z).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxMap {
    bounds: Aabb,
    /// Images per unit of length.
    scale: f32,
    /// Axes (0 = x) from the longest to the shortest edge.
    order: [usize; 3],
}

/// How a face carries the image: per texture coordinate the axis of space (0 = x), and whether it runs backwards.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    axes: [usize; 2],
    backwards: [bool; 2],
}

impl BoxMap {
    /// The image once along the longest edge of `bounds`.
    pub fn fit(bounds: Aabb) -> Self {
        Self::repeated(bounds, 1.0)
    }

    /// The image `repeat` times along the longest edge of `bounds`.
    pub fn repeated(bounds: Aabb, repeat: f32) -> Self {
        let extent = bounds.extent();
        let mut order = [0, 1, 2];
        // Stable: equal edges keep the order x, y, z.
        order.sort_by(|&a, &b| extent[b].total_cmp(&extent[a]));
        Self { bounds, scale: repeat / extent.max_element(), order }
    }

    pub(super) fn longest_edge(&self) -> f32 {
        self.bounds.extent().max_element()
    }

    /// The face across which `n` points.
    fn face(&self, n: Vec3) -> Face {
        let size = n.abs();
        let across = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let [u, v] = match self.order.iter().position(|&axis| axis == across) {
            Some(0) => [self.order[1], self.order[2]],
            Some(1) => [self.order[0], self.order[2]],
            _ => [self.order[0], self.order[1]],
        };
        // Seen from outside, right cross down points into the solid.
        let is_cyclic = (u + 1) % 3 == v;
        let is_mirrored = is_cyclic == (n[across] >= 0.0);
        match [u, v] {
            [_, 1] => Face { axes: [u, v], backwards: [!is_mirrored, true] },
            [2, 0] => Face { axes: [u, v], backwards: [is_mirrored, false] },
            _ => Face { axes: [u, v], backwards: [false, is_mirrored] },
        }
    }

    /// Where `u` and `v` are 0 on a face (its third coordinate is that of the smallest corner).
    fn corner(&self, face: Face) -> Vec3 {
        let mut corner = self.bounds.min;
        for (axis, backwards) in face.axes.into_iter().zip(face.backwards) {
            corner[axis] = if backwards { self.bounds.max[axis] } else { self.bounds.min[axis] };
        }
        corner
    }

    /// The point with these coordinates on the face across which `n` points.
    pub fn point(&self, uv: Vec2, n: Vec3) -> Vec3 {
        let face = self.face(n);
        let mut point = self.corner(face);
        for (k, axis) in face.axes.into_iter().enumerate() {
            let sign = if face.backwards[k] { -1.0 } else { 1.0 };
            point[axis] += sign * uv[k] / self.scale;
        }
        let across = 3 - face.axes[0] - face.axes[1];
        point[across] = if n[across] >= 0.0 { self.bounds.max[across] } else { self.bounds.min[across] };
        point
    }

    /// Where the line leaves the box (for lines that pass by: near where they pass), with the face's normal.
    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<ShapePoint> {
        let far = Vec3::select(direction.cmpgt(Vec3::ZERO), self.bounds.max, self.bounds.min);
        let along = Vec3::select(direction.cmpeq(Vec3::ZERO), Vec3::INFINITY, (far - origin) / direction);
        let axis = along.min_position();
        if !along[axis].is_finite() {
            return None;
        }
        let position = (origin + direction * along[axis]).max(self.bounds.min).min(self.bounds.max);
        Some(self.on_face(position, axis, direction[axis] > 0.0))
    }

    /// The foot of the perpendicular onto the nearest face.
    pub(super) fn foot(&self, p: Vec3) -> ShapePoint {
        let (above, below) = (self.bounds.max - p, p - self.bounds.min);
        let axis = above.min(below).min_position();
        let inside = p.max(self.bounds.min).min(self.bounds.max);
        self.on_face(inside, axis, above[axis] <= below[axis])
    }

    fn on_face(&self, mut position: Vec3, axis: usize, is_upper: bool) -> ShapePoint {
        position[axis] = if is_upper { self.bounds.max[axis] } else { self.bounds.min[axis] };
        let normal = if is_upper { Vec3::AXES[axis] } else { -Vec3::AXES[axis] };
        ShapePoint { position, normal }
    }

    pub(super) fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "a box mapping";
        Allowed::Finite.check(OWNER, "the smallest corner", &self.bounds.min.to_array())?;
        Allowed::Finite.check(OWNER, "the largest corner", &self.bounds.max.to_array())?;
        let edges = self.bounds.max - self.bounds.min;
        Allowed::NotNegative.check(OWNER, "an edge", &edges.to_array())?;
        Allowed::NotZero.check(OWNER, "the repeat", &[self.scale])
    }
}

impl Face {
    /// The change of the coordinates along a direction of space.
    fn linear(&self, direction: Vec3) -> Vec2 {
        let along = |k: usize| {
            let d = direction[self.axes[k]];
            if self.backwards[k] { -d } else { d }
        };
        Vec2::new(along(0), along(1))
    }
}

impl Mapping for BoxMap {
    fn uv(&self, p: Vec3, n: Vec3) -> Vec2 {
        let face = self.face(n);
        face.linear(p - self.corner(face)) * self.scale
    }

    fn uv_footprint(&self, _p: Vec3, n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let face = self.face(n);
        [dp_dx, dp_dy].map(|direction| face.linear(direction) * self.scale)
    }
}

// The mantle of an upright cylinder.

/// `(u, v) = (a r (theta - theta_0), d (h - h_0))`, theta about the y axis through `center`, seen from outside: u grows to
/// the right, v downwards (so `d` is negative). The seam is on the far side (-z) of a fitted cylinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CylinderMap {
    /// A point of the axis.
    pub center: Vec3,
    /// Radius `r`: with `a`, it says how many images go round.
    pub radius: f32,
    /// `a`, images per unit of length round the mantle.
    pub around: f32,
    /// `theta_0`, in radians: where `u` is 0.
    pub angle: f32,
    /// `d`, images per unit of height.
    pub along: f32,
    /// `h_0`, the height where `v` is 0.
    pub height: f32,
    /// The lowest and the highest point of the mantle. Where rays leave through the top or the bottom, its disc counts as
    /// folded up: the mantle's coordinates go on from the rim to the centre, and stay within bounds.
    pub ends: [f32; 2],
}

impl CylinderMap {
    /// The image once round and once from the top to the bottom of `bounds`; its middle faces +z.
    pub fn fit(bounds: Aabb) -> Self {
        let extent = bounds.extent();
        let radius = 0.5 * extent.x.max(extent.z);
        Self {
            center: bounds.center(),
            radius,
            around: 1.0 / (TAU * radius),
            angle: -0.5 * TAU,
            along: -1.0 / extent.y,
            height: bounds.max.y,
            ends: [bounds.max.y - extent.y, bounds.max.y],
        }
    }

    /// The point of the mantle with these coordinates.
    pub fn point(&self, uv: Vec2) -> Vec3 {
        let theta = uv.x / (self.around * self.radius) + self.angle;
        let (sin, cos) = theta.sin_cos();
        Vec3::new(
            self.center.x + self.radius * sin,
            uv.y / self.along + self.height,
            self.center.z + self.radius * cos,
        )
    }

    /// Where the line leaves the mantle, or the top or bottom, folded up. For lines that pass by, the point of the mantle that
    /// is nearest to the line's closest point.
    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<ShapePoint> {
        let local = origin - self.center;
        let a = direction.x * direction.x + direction.z * direction.z;
        let b = local.x * direction.x + local.z * direction.z;
        let c = local.x * local.x + local.z * local.z - self.radius * self.radius;
        let through_mantle = if a > 0.0 { (-b + (b * b - a * c).max(0.0).sqrt()) / a } else { f32::INFINITY };
        let end = if direction.y >= 0.0 { self.ends[1] } else { self.ends[0] };
        let through_end = if direction.y == 0.0 { f32::INFINITY } else { (end - origin.y) / direction.y };
        let along = through_mantle.min(through_end);
        if !along.is_finite() {
            return None;
        }
        let mut leaves = origin + direction * along;
        if through_end < through_mantle {
            let to_rim = self.radius - (leaves.x - self.center.x).hypot(leaves.z - self.center.z);
            leaves.y = end + to_rim.max(0.0).copysign(direction.y);
        }
        Some(self.foot(leaves))
    }

    /// The point of the endless mantle at the same azimuth and height.
    pub(super) fn foot(&self, p: Vec3) -> ShapePoint {
        let local = p - self.center;
        let normal = Vec3::new(local.x, 0.0, local.z).normalize_or(Vec3::Z);
        let axis = Vec3::new(self.center.x, p.y, self.center.z);
        ShapePoint { position: axis + normal * self.radius, normal }
    }

    pub(super) fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "a cylinder mapping";
        Allowed::Finite.check(OWNER, "the centre", &self.center.to_array())?;
        Allowed::Positive.check(OWNER, "the radius", &[self.radius])?;
        Allowed::NotZero.check(OWNER, "'around' (images per unit of length)", &[self.around])?;
        Allowed::Finite.check(OWNER, "the angle", &[self.angle])?;
        Allowed::NotZero.check(OWNER, "'along' (images per unit of height)", &[self.along])?;
        Allowed::Finite.check(OWNER, "the height", &[self.height])?;
        Allowed::Finite.check(OWNER, "the ends", &self.ends)?;
        Allowed::NotNegative.check(OWNER, "the height between the ends", &[self.ends[1] - self.ends[0]])
    }
}

impl Mapping for CylinderMap {
    fn uv(&self, p: Vec3, _n: Vec3) -> Vec2 {
        let local = p - self.center;
        let turn = (azimuth(local) - self.angle).rem_euclid(TAU);
        Vec2::new(self.around * self.radius * turn, self.along * (p.y - self.height))
    }

    fn uv_footprint(&self, p: Vec3, _n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let local = p - self.center;
        // d theta = (z dx - x dz) / (x^2 + z^2); on the axis itself every direction counts as one full image.
        let squared = local.x * local.x + local.z * local.z;
        [dp_dx, dp_dy].map(|direction| {
            let turn = local.z * direction.x - local.x * direction.z;
            let theta = if squared > 0.0 { turn / squared } else { TAU };
            let theta = theta.clamp(-TAU, TAU);
            Vec2::new(self.around * self.radius * theta, self.along * direction.y)
        })
    }
}

// Longitude and latitude.

/// Angle about the y axis, 0 at +z, growing towards +x (to the right, seen from outside), in (-pi, pi].
pub(super) fn azimuth(local: Vec3) -> f32 {
    local.x.atan2(local.z)
}

/// The point's direction from `center`: `u` = longitude / 2 pi from the far side (-z) round to the right, `v` = angle from
/// the top (+y) / pi, each times `repeat`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereMap {
    /// Centre of the sphere.
    pub center: Vec3,
    /// Radius of the sphere: of importance where rays meet it.
    pub radius: f32,
    /// Images round the equator and from pole to pole.
    pub repeat: Vec2,
}

impl SphereMap {
    /// The image once over the sphere around the centre of `bounds`; its middle faces +z.
    pub fn fit(bounds: Aabb) -> Self {
        Self { center: bounds.center(), radius: 0.5 * bounds.extent().length(), repeat: Vec2::ONE }
    }

    /// The unit vector from the centre to the points with these coordinates.
    pub fn direction(&self, uv: Vec2) -> Vec3 {
        let (sin, cos) = (TAU * uv.x / self.repeat.x - PI).sin_cos();
        let (sin_polar, cos_polar) = (PI * uv.y / self.repeat.y).sin_cos();
        Vec3::new(sin_polar * sin, cos_polar, sin_polar * cos)
    }

    /// The point of the sphere with these coordinates.
    pub fn point(&self, uv: Vec2) -> Vec3 {
        self.center + self.direction(uv) * self.radius
    }

    pub(super) fn check(&self) -> fantex_base::Result<()> {
        const OWNER: &str = "a sphere mapping";
        Allowed::Finite.check(OWNER, "the centre", &self.center.to_array())?;
        Allowed::Positive.check(OWNER, "the radius", &[self.radius])?;
        Allowed::NotZero.check(OWNER, "the repeat", &self.repeat.to_array())
    }
}

/// Where the line leaves a sphere. For lines that pass by, the point that is nearest to the line.
pub(super) fn leave_sphere(center: Vec3, radius: f32, origin: Vec3, direction: Vec3) -> Option<ShapePoint> {
    let direction = direction.try_normalize()?;
    let local = origin - center;
    let b = local.dot(direction);
    let c = local.length_squared() - radius * radius;
    let along = -b + (b * b - c).max(0.0).sqrt();
    Some(foot_on_sphere(center, radius, origin + direction * along))
}

/// The nearest point of a sphere; the top for the centre.
pub(super) fn foot_on_sphere(center: Vec3, radius: f32, p: Vec3) -> ShapePoint {
    let normal = (p - center).normalize_or(Vec3::Y);
    ShapePoint { position: center + normal * radius, normal }
}

impl Mapping for SphereMap {
    fn uv(&self, p: Vec3, _n: Vec3) -> Vec2 {
        let local = p - self.center;
        let longitude = (azimuth(local) + PI).rem_euclid(TAU) / TAU;
        // atan2 is precise near the poles, where acos is not.
        let polar = local.x.hypot(local.z).atan2(local.y) / PI;
        Vec2::new(longitude, polar) * self.repeat
    }

    fn uv_footprint(&self, p: Vec3, _n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let local = p - self.center;
        let around2 = local.x * local.x + local.z * local.z;
        let around = around2.sqrt();
        let squared = around2 + local.y * local.y;
        [dp_dx, dp_dy].map(|direction| {
            let turn = local.z * direction.x - local.x * direction.z;
            let outward = local.x * direction.x + local.z * direction.z;
            // At a pole the longitude is undefined and next to it the footprint goes all round: at most one turn.
            let longitude = if around2 > 0.0 { (turn / around2).clamp(-TAU, TAU) } else { TAU };
            let polar = match (squared > 0.0, around > 0.0) {
                (true, true) => (outward / around * local.y - direction.y * around) / squared,
                (true, false) => direction.x.hypot(direction.z) / local.y.abs(),
                _ => 0.0,
            };
            Vec2::new(longitude / TAU, polar / PI) * self.repeat
        })
    }
}

// Two hemispheres by stereographic projection.

/// How the discs of the two hemispheres lie in the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
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
    pub fn fit(bounds: Aabb) -> Self {
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

    pub(super) fn leave(&self, origin: Vec3, direction: Vec3) -> Option<ShapePoint> {
        leave_sphere(self.center, self.radius, origin, direction)
    }

    pub(super) fn foot(&self, p: Vec3) -> ShapePoint {
        foot_on_sphere(self.center, self.radius, p)
    }

    pub(super) fn check(&self) -> fantex_base::Result<()> {
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
