//! From a shading point to what a texture is looked up by, always with the footprint.
//!
//! | look-up | coordinates | transformed by |
//! |---|---|---|
//! | images (and one-dimensional textures, images of one row) | [`Coordinates`] | [`TextureMatrix`] |
//! | cube and environment maps | [`DirectionSource`](crate::environment::DirectionSource) | a rotation |
//! | solids and volumes | position | [`SpaceMatrix`] |
//! | ramps | [`Parameter`] | scale and offset |

mod image_lookup;
mod matrix;

use std::sync::Arc;

use fantex_base::Result;
use glam::{Vec2, Vec3, Vec4};

use crate::look::Slot;
use crate::{
    Allowed, Dependence, Mapping, SMap, ShadingPoint, Texture, TriplanarMap, TwoPartMapping, UvPoint,
};

pub use image_lookup::ImageLookup;
pub use matrix::{
    InPlace, InSpace, NormalAxes, Place, PlaceUnit, Projective, SpaceMatrix, SpacePoint, TextureMatrix,
    TextureMatrixOptions,
};

/// Two-dimensional texture coordinates of a shading point.
#[derive(Clone, Debug, PartialEq)]
pub enum Coordinates {
    /// Texture coordinates of the model. Without that set, `(0, 0)` everywhere.
    Uv {
        /// Which set, from 0.
        set: usize,
    },
    /// The coordinates of an intermediate surface, straight at the position.
    Surface(SMap),
    /// An S-map and an O-map.
    TwoPart(TwoPartMapping),
    /// Three projections, blended by the normal.
    Triplanar(TriplanarMap),
    /// The first two coordinates of the transformed position: with a projective matrix, what a slide projector at its eye
    /// would show (on both sides of objects, and behind it mirrored).
    Projected(SpaceMatrix),
    /// A number as `u`, and 1/2 as `v`: for images of one row.
    Parameter(Parameter),
    /// Red of two textures as `u` and `v`: a constant `v` for images of one row.
    Textures(TextureCoordinates),
}

/// Coordinates that are the red of two textures.
#[derive(Clone, Debug)]
pub struct TextureCoordinates {
    /// Of `u`.
    pub u: Slot,
    /// Of `v`.
    pub v: Slot,
}

impl PartialEq for TextureCoordinates {
    /// The same textures.
    fn eq(&self, other: &Self) -> bool {
        let same = |a: &Slot, b: &Slot| match (a, b) {
            (Slot::Constant(a), Slot::Constant(b)) => a == b,
            (Slot::Texture(a), Slot::Texture(b)) => Arc::ptr_eq(a, b),
            _ => false,
        };
        same(&self.u, &other.u) && same(&self.v, &other.v)
    }
}

impl TextureCoordinates {
    fn at(&self, at: &ShadingPoint<'_>) -> UvPoint {
        let uv = |at: &ShadingPoint<'_>| Vec2::new(self.u.evaluate(at).x, self.v.evaluate(at).x);
        let beside = |a: f32, b: f32| at.shifted(a, b, uv);
        let steps = [beside(0.5, 0.0) - beside(-0.5, 0.0), beside(0.0, 0.5) - beside(0.0, -0.5)];
        UvPoint { uv: uv(at), steps }
    }
}

impl Default for Coordinates {
    /// The model's first set.
    fn default() -> Self {
        Self::Uv { set: 0 }
    }
}

impl Coordinates {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> Result<()> {
        match self {
            // Placed surfaces and matrices have been checked when they were made.
            Self::Uv { .. } | Self::Surface(_) | Self::Projected(_) | Self::Textures(_) => Ok(()),
            Self::TwoPart(mapping) => mapping.check(),
            Self::Triplanar(map) => map.check(),
            Self::Parameter(parameter) => parameter.check(),
        }
    }

    /// Whether they depend on something besides positions and normals.
    pub fn depends_on(&self, what: Dependence) -> bool {
        match self {
            Self::Uv { set } => what == Dependence::Uv(*set),
            Self::Surface(_) | Self::Triplanar(_) => false,
            Self::TwoPart(mapping) => what == Dependence::Eye && mapping.is_view_dependent(),
            Self::Projected(matrix) => what == Dependence::Time && matrix.is_animated(),
            Self::Parameter(parameter) => parameter.depends_on(what),
            Self::Textures(TextureCoordinates { u, v }) => u.depends_on(what) || v.depends_on(what),
        }
    }

    /// The value of `look_up` at the coordinates: the blend of three for triplanar ones.
    pub fn evaluate(&self, at: &ShadingPoint<'_>, mut look_up: impl FnMut(&UvPoint) -> Vec4) -> Vec4 {
        match self {
            Self::Uv { set } => look_up(&at.uv.get(*set).copied().unwrap_or_default()),
            Self::Surface(map) => look_up(&surface_point(map, at)),
            Self::TwoPart(mapping) => look_up(&mapping.coordinates(at)),
            Self::Triplanar(map) => {
                let blend = map.evaluate(at.position, at.normal, at.position_steps, |uv, steps| {
                    look_up(&UvPoint { uv, steps }).to_array()
                });
                Vec4::from_array(blend)
            }
            Self::Projected(matrix) => {
                let SpacePoint { position, steps } = matrix.apply(at);
                look_up(&UvPoint { uv: position.truncate(), steps: steps.map(Vec3::truncate) })
            }
            Self::Parameter(parameter) => {
                let steps = parameter.steps(at).map(|step| Vec2::new(step, 0.0));
                look_up(&UvPoint { uv: Vec2::new(parameter.value(at), 0.5), steps })
            }
            Self::Textures(textures) => look_up(&textures.at(at)),
        }
    }
}

fn surface_point(map: &SMap, at: &ShadingPoint<'_>) -> UvPoint {
    let [dx, dy] = at.position_steps;
    UvPoint { uv: map.uv(at.position, at.normal), steps: map.uv_footprint(at.position, at.normal, dx, dy) }
}

// Single numbers of a surface point: the coordinates of one-dimensional textures.

/// A number that every surface point has. As a texture, it gives that number as red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parameter {
    /// The distance from the plane through `origin` across `direction`, in units of one over `direction`'s length. The
    /// height, for a direction upwards.
    Along {
        /// Where it is 0.
        origin: Vec3,
        /// In which direction it grows, by its length per unit; not 0.
        direction: Vec3,
    },
    /// The distance from a point, in units of length.
    Distance {
        /// The point.
        center: Vec3,
    },
    /// The distance from an axis.
    AxisDistance {
        /// A point of it.
        center: Vec3,
        /// Its direction; of any length but 0.
        direction: Vec3,
    },
    /// The angle between the normal and `up` in degrees: 0 on level ground, 90 on a wall, 180 under a ceiling.
    Slope {
        /// The upward direction; of any length but 0.
        up: Vec3,
    },
    /// The cosine between the normal and the direction to the eye, at least 0. Without an eye, 1.
    Facing,
    /// The first texture coordinate; 0 without that set.
    U {
        /// Which set, from 0.
        set: usize,
    },
    /// The second texture coordinate; 0 without that set.
    V {
        /// Which set, from 0.
        set: usize,
    },
    /// Seconds since the start of the animation.
    Time,
}

impl Default for Parameter {
    /// The height: y.
    fn default() -> Self {
        Self::Along { origin: Vec3::ZERO, direction: Vec3::Y }
    }
}

impl Parameter {
    /// Whether all numbers are in range.
    ///
    /// # Errors
    /// The first number that is not.
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Along { origin, direction } => {
                Allowed::Finite.check("a height", "the origin", &origin.to_array())?;
                Allowed::Finite.check("a height", "the direction", &direction.to_array())?;
                Allowed::Positive.check("a height", "the length of the direction", &[direction.length()])
            }
            Self::Distance { center } => {
                Allowed::Finite.check("a distance", "the centre", &center.to_array())
            }
            Self::AxisDistance { center, direction } => {
                Allowed::Finite.check("a distance", "the centre", &center.to_array())?;
                Allowed::Finite.check("a distance", "the axis", &direction.to_array())?;
                Allowed::Positive.check("a distance", "the length of the axis", &[direction.length()])
            }
            Self::Slope { up } => {
                Allowed::Finite.check("a slope", "the upward direction", &up.to_array())?;
                Allowed::Positive.check("a slope", "the length of the upward direction", &[up.length()])
            }
            Self::Facing | Self::U { .. } | Self::V { .. } | Self::Time => Ok(()),
        }
    }

    /// The number at a point.
    pub fn value(&self, at: &ShadingPoint<'_>) -> f32 {
        match *self {
            Self::Along { origin, direction } => direction.dot(at.position - origin),
            Self::Distance { center } => at.position.distance(center),
            Self::AxisDistance { center, direction } => {
                direction.normalize().cross(at.position - center).length()
            }
            // Unlike the arc cosine, precise on level ground, too.
            Self::Slope { up } => at.normal.cross(up).length().atan2(at.normal.dot(up)).to_degrees(),
            Self::Facing => at.eye.map_or(1.0, |eye| eye.cosine(at.normal).abs()),
            Self::U { set } => at.uv.get(set).map_or(0.0, |point| point.uv.x),
            Self::V { set } => at.uv.get(set).map_or(0.0, |point| point.uv.y),
            Self::Time => at.time,
        }
    }

    /// The change along the footprint's edges: for all that is not linear in the point, by central differences.
    pub fn steps(&self, at: &ShadingPoint<'_>) -> [f32; 2] {
        let of_set = |set: usize| at.uv.get(set).map_or([Vec2::ZERO; 2], |point| point.steps);
        match *self {
            Self::Along { direction, .. } => at.position_steps.map(|step| direction.dot(step)),
            Self::U { set } => of_set(set).map(|step| step.x),
            Self::V { set } => of_set(set).map(|step| step.y),
            Self::Time => [0.0; 2],
            Self::Distance { .. } | Self::AxisDistance { .. } | Self::Slope { .. } | Self::Facing => {
                let beside = |a: f32, b: f32| at.shifted(a, b, |point| self.value(point));
                [beside(0.5, 0.0) - beside(-0.5, 0.0), beside(0.0, 0.5) - beside(0.0, -0.5)]
            }
        }
    }
}

impl Texture for Parameter {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        Vec3::splat(self.value(at)).extend(1.0)
    }

    fn depends_on(&self, what: Dependence) -> bool {
        match *self {
            Self::U { set } | Self::V { set } => what == Dependence::Uv(set),
            Self::Facing => what == Dependence::Eye,
            Self::Time => what == Dependence::Time,
            Self::Along { .. } | Self::Distance { .. } | Self::AxisDistance { .. } | Self::Slope { .. } => {
                false
            }
        }
    }
}
