//! Two-part mappings (Bier and Sloan, 1986): placed intermediate surfaces, and how points of the object are joined to them.

use fantex_base::Aabb;
use glam::{Affine3A, EulerRot, Quat, Vec2, Vec3};

use super::shape::{foot_on_sphere, leave_sphere};
use super::{BoxMap, CylinderMap, HemisphereMap, Mapping, PlanarMap, SphereMap};
use crate::invalid_option::singular;
use crate::{Allowed, Eye, ShadingPoint, UvPoint};

// S-maps: texture coordinates of a placed intermediate surface.

/// An intermediate surface with its coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A plane.
    Plane(PlanarMap),
    /// The faces of a box.
    Box(BoxMap),
    /// The mantle of an upright cylinder.
    Cylinder(CylinderMap),
    /// Longitude and latitude.
    Sphere(SphereMap),
    /// Two hemispheres by stereographic projection.
    Hemispheres(HemisphereMap),
}

/// The names of the intermediate surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ShapeKind {
    /// [`PlanarMap`].
    Plane,
    /// [`BoxMap`].
    Box,
    /// [`CylinderMap`].
    Cylinder,
    /// [`SphereMap`].
    #[default]
    Sphere,
    /// [`HemisphereMap`].
    Hemispheres,
}

impl ShapeKind {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Plane, Self::Box, Self::Cylinder, Self::Sphere, Self::Hemispheres];

    /// The surface of this kind around `bounds`, y being up, with one image spread over it.
    pub fn fit(self, bounds: Aabb) -> Shape {
        match self {
            Self::Plane => Shape::Plane(PlanarMap::fit(bounds)),
            Self::Box => Shape::Box(BoxMap::fit(bounds)),
            Self::Cylinder => Shape::Cylinder(CylinderMap::fit(bounds)),
            Self::Sphere => Shape::Sphere(SphereMap::fit(bounds)),
            Self::Hemispheres => Shape::Hemispheres(HemisphereMap::fit(bounds)),
        }
    }
}

/// A point of an intermediate surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapePoint {
    /// Where it is.
    pub position: Vec3,
    /// The outward unit normal: on a box, it tells the faces apart.
    pub normal: Vec3,
}

impl Shape {
    /// The coordinates of the surface.
    pub fn mapping(&self) -> &dyn Mapping {
        match self {
            Self::Plane(map) => map,
            Self::Box(map) => map,
            Self::Cylinder(map) => map,
            Self::Sphere(map) => map,
            Self::Hemispheres(map) => map,
        }
    }

    /// The inverse: the point of the surface with these coordinates. Where several have them (the faces of a box, hemispheres
    /// that share the image), it is the one on the side to which `n` points.
    pub fn point(&self, uv: Vec2, n: Vec3) -> Vec3 {
        match self {
            Self::Plane(map) => map.point(uv),
            Self::Box(map) => map.point(uv, n),
            Self::Cylinder(map) => map.point(uv),
            Self::Sphere(map) => map.point(uv),
            Self::Hemispheres(map) => map.point(uv, n),
        }
    }

    /// Where the line from `origin` along `direction` leaves the surface for good, or, if it passes by, the point near
    /// which it does so: so the result is continuous in the ray (except for lines along a plane). `None` if there is no such
    /// point: a line along a plane, or no direction.
    pub fn leave(&self, origin: Vec3, direction: Vec3) -> Option<ShapePoint> {
        match self {
            Self::Plane(map) => map.leave(origin, direction),
            Self::Box(map) => map.leave(origin, direction),
            Self::Cylinder(map) => map.leave(origin, direction),
            Self::Sphere(map) => leave_sphere(map.center, map.radius, origin, direction),
            Self::Hemispheres(map) => map.leave(origin, direction),
        }
    }

    /// The point of the surface on whose normal `p` lies: the nearest one.
    pub fn foot(&self, p: Vec3) -> ShapePoint {
        match self {
            Self::Plane(map) => map.foot(p),
            Self::Box(map) => map.foot(p),
            Self::Cylinder(map) => map.foot(p),
            Self::Sphere(map) => foot_on_sphere(map.center, map.radius, p),
            Self::Hemispheres(map) => map.foot(p),
        }
    }

    /// A length that says how large the surface is.
    pub(super) fn size(&self) -> f32 {
        match self {
            Self::Plane(map) => map.u_gradient.length().recip(),
            Self::Box(map) => map.longest_edge(),
            Self::Cylinder(map) => map.radius,
            Self::Sphere(map) => map.radius,
            Self::Hemispheres(map) => map.radius,
        }
    }

    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        match self {
            Self::Plane(map) => map.check(),
            Self::Box(map) => map.check(),
            Self::Cylinder(map) => map.check(),
            Self::Sphere(map) => map.check(),
            Self::Hemispheres(map) => map.check(),
        }
    }
}

/// How an intermediate surface is moved from where it was fitted: scaled and turned about the pivot, then shifted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The point that scale and rotation leave in place.
    pub pivot: Vec3,
    /// Factors along the surface's own axes; not 0.
    pub scale: Vec3,
    /// Applied after the scale; of any length but 0.
    pub rotation: Quat,
    /// Applied last.
    pub translation: Vec3,
}

impl Default for Placement {
    /// Left where it is.
    fn default() -> Self {
        Self { pivot: Vec3::ZERO, scale: Vec3::ONE, rotation: Quat::IDENTITY, translation: Vec3::ZERO }
    }
}

impl Placement {
    /// The rotation by `degrees` about the x, then the y, then the z axis.
    pub fn rotation_from_degrees(degrees: Vec3) -> Quat {
        let [x, y, z] = degrees.to_array().map(f32::to_radians);
        Quat::from_euler(EulerRot::ZYX, z, y, x)
    }

    /// From the fitted surface's space to the object's.
    fn object_from_surface(&self) -> fantex_base::Result<Affine3A> {
        const OWNER: &str = "a mapping's placement";
        Allowed::Finite.check(OWNER, "the pivot", &self.pivot.to_array())?;
        Allowed::NotZero.check(OWNER, "the scale", &self.scale.to_array())?;
        Allowed::Finite.check(OWNER, "the rotation", &self.rotation.to_array())?;
        Allowed::Positive.check(OWNER, "the length of the rotation", &[self.rotation.length()])?;
        Allowed::Finite.check(OWNER, "the translation", &self.translation.to_array())?;
        let turned = Affine3A::from_scale_rotation_translation(
            self.scale,
            self.rotation.normalize(),
            self.pivot + self.translation,
        );
        Ok(turned * Affine3A::from_translation(-self.pivot))
    }
}

/// A placed intermediate surface: a mapping of the object's space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SMap {
    shape: Shape,
    object_from_surface: Affine3A,
    surface_from_object: Affine3A,
}

impl SMap {
    /// The shape, moved as `placement` says.
    ///
    /// # Errors
    /// A number of the shape or the placement is out of range.
    pub fn new(shape: Shape, placement: &Placement) -> fantex_base::Result<Self> {
        shape.check()?;
        let object_from_surface = placement.object_from_surface()?;
        let surface_from_object = object_from_surface.inverse();
        if !surface_from_object.is_finite() {
            return Err(singular("a mapping's placement", "the scale"));
        }
        Ok(Self { shape, object_from_surface, surface_from_object })
    }

    /// The surface in its own space.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    pub(super) fn local_point(&self, p: Vec3) -> Vec3 {
        self.surface_from_object.transform_point3(p)
    }

    pub(super) fn local_direction(&self, direction: Vec3) -> Vec3 {
        self.surface_from_object.transform_vector3(direction)
    }

    /// A normal of the object in the surface's own space, of any length.
    fn local_normal(&self, n: Vec3) -> Vec3 {
        Vec3::from(self.object_from_surface.matrix3.transpose() * glam::Vec3A::from(n))
    }

    /// The inverse: the point of the placed surface with these coordinates, on the side to which `n` points where several
    /// have them; see [`Shape::point`].
    pub fn point(&self, uv: Vec2, n: Vec3) -> Vec3 {
        self.object_from_surface.transform_point3(self.shape.point(uv, self.local_normal(n)))
    }
}

impl Mapping for SMap {
    fn uv(&self, p: Vec3, n: Vec3) -> Vec2 {
        self.shape.mapping().uv(self.local_point(p), self.local_normal(n))
    }

    fn uv_footprint(&self, p: Vec3, n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2] {
        let [dx, dy] = [dp_dx, dp_dy].map(|step| self.local_direction(step));
        self.shape.mapping().uv_footprint(self.local_point(p), self.local_normal(n), dx, dy)
    }
}

// O-maps: which point of the intermediate surface belongs to a point of the object.
//
// The four of Bier and Sloan, "Two-part texture mappings", 1986, seen from the object: a ray starts there, and where it leaves
// the intermediate surface, that surface's coordinates are the texture's.
//
// ```text
//   reflection        object normal      centroid           normal of the intermediate surface
//   ---x------        ------x----        ----x------        ------x-----
//     /  eye               /                /                     |
//    /  /                 / n              /                      |
//   p--'                 p                p                       p
//                                        /
//                                       c
// ```

/// How a point of the object is joined to the intermediate surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum OMap {
    /// Along the view ray, reflected. Without an eye, as if it looked along the normal.
    Reflection,
    /// Along the object's normal.
    ObjectNormal,
    /// From the centroid through the point.
    Centroid {
        /// The centroid, object space.
        center: Vec3,
    },
    /// Against the intermediate surface's normal, which runs through the point.
    #[default]
    SurfaceNormal,
}

/// An S-map and an O-map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoPartMapping {
    /// From the intermediate surface to the texture.
    pub s_map: SMap,
    /// From the object to the intermediate surface.
    pub o_map: OMap,
}

/// How far the hit point is followed for its derivative: this share of the surface's size (or of a radian), so that rounding
/// and curvature both cost about 1e-4 of the derivative.
const STEP: f32 = 5e-3;

/// No derivative of a coordinate is longer: beyond, any filter gives the mean of the whole image.
const MAX_CHANGE: f32 = 1e4;

impl TwoPartMapping {
    /// Whether all numbers are in range (those of the S-map are).
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> fantex_base::Result<()> {
        match self.o_map {
            OMap::Centroid { center } => {
                Allowed::Finite.check("a two-part mapping", "the centroid", &center.to_array())
            }
            OMap::Reflection | OMap::ObjectNormal | OMap::SurfaceNormal => Ok(()),
        }
    }

    /// Whether the coordinates depend on the eye.
    pub fn is_view_dependent(&self) -> bool {
        self.o_map == OMap::Reflection
    }

    /// The coordinates of a point, with their change along the footprint's edges.
    pub fn coordinates(&self, at: &ShadingPoint<'_>) -> UvPoint {
        let shape = self.s_map.shape();
        let (point, steps) = match self.o_map {
            // Along its normal, a surface's coordinates stay the same: they are those of the point itself.
            OMap::SurfaceNormal => {
                let position = self.s_map.local_point(at.position);
                let steps = at.position_steps.map(|step| self.s_map.local_direction(step));
                (ShapePoint { position, normal: shape.foot(position).normal }, steps)
            }
            _ => (self.hit(at.position, at.normal, at.eye), [0, 1].map(|edge| self.hit_step(at, edge))),
        };
        let mapping = shape.mapping();
        let uv = mapping.uv(point.position, point.normal);
        let steps = mapping.uv_footprint(point.position, point.normal, steps[0], steps[1]);
        UvPoint { uv, steps: steps.map(bounded) }
    }

    /// Where the ray reaches the intermediate surface, in its own space. If it does not, the nearest point of the surface.
    fn hit(&self, p: Vec3, n: Vec3, eye: Option<Eye<'_>>) -> ShapePoint {
        let shape = self.s_map.shape();
        let local = self.s_map.local_point(p);
        let (origin, direction) = match self.o_map {
            OMap::SurfaceNormal => return shape.foot(local),
            OMap::ObjectNormal => (local, n),
            OMap::Centroid { center } => (self.s_map.local_point(center), p - center),
            OMap::Reflection => (local, eye.map_or(n, |eye| eye.mirrored(n))),
        };
        let ray_end = shape.leave(origin, self.s_map.local_direction(direction));
        ray_end.unwrap_or_else(|| shape.foot(local))
    }

    /// The change of the hit point along an edge of the footprint: a central difference of positions, which (unlike
    /// coordinates) have no seam.
    fn hit_step(&self, at: &ShadingPoint<'_>, edge: usize) -> Vec3 {
        let (dp, dn) = (at.position_steps[edge], at.normal_steps[edge]);
        let moved = self.s_map.local_direction(dp).length() / self.s_map.shape().size();
        let length = moved.max(dn.length());
        if length.is_nan() || length <= 0.0 {
            return Vec3::ZERO;
        }
        let share = STEP / length;
        let beside = |side: f32| {
            let shift = 0.5 * side * share;
            let n = (at.normal + dn * shift).try_normalize().unwrap_or(at.normal);
            self.hit(at.position + dp * shift, n, at.eye).position
        };
        (beside(1.0) - beside(-1.0)) / share
    }
}

fn bounded(change: Vec2) -> Vec2 {
    if change.is_nan() {
        Vec2::splat(MAX_CHANGE)
    } else {
        change.clamp(Vec2::splat(-MAX_CHANGE), Vec2::splat(MAX_CHANGE))
    }
}
