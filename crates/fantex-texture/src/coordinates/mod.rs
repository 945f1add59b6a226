//! From a shading point to what a texture is looked up by, always with the footprint.
//!
//! | look-up | coordinates | transformed by |
//! |---|---|---|
//! | images (and one-dimensional textures, images of one row) | [`Coordinates`] | [`TextureMatrix`] |
//! | cube and environment maps | [`Direction`] | [`SpaceMatrix`] |
//! | solids and volumes | position | [`SpaceMatrix`] |
//! | ramps | [`Parameter`] | scale and offset |

mod direction;
mod image_lookup;
mod parameter;
mod space_matrix;
mod texture_matrix;

use glam::{Vec2, Vec3, Vec4};

pub use direction::{Direction, DirectionPoint};
pub use image_lookup::ImageLookup;
pub use parameter::Parameter;
pub use space_matrix::{InSpace, SpaceMatrix, SpaceMatrixOptions, SpacePoint};
pub use texture_matrix::{TextureMatrix, TextureMatrixOptions};

use crate::{InvalidOption, Mapping, SMap, ShadingPoint, Texture, TriplanarMap, TwoPartMapping, UvPoint};

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
    ///
    /// The first number that is not.
    pub fn check(&self) -> Result<(), InvalidOption> {
        match self {
            // Placed surfaces and matrices have been checked when they were made.
            Self::Uv { .. } | Self::Surface(_) | Self::Projected(_) => Ok(()),
            Self::TwoPart(mapping) => mapping.check(),
            Self::Triplanar(map) => map.check(),
            Self::Parameter(parameter) => parameter.check(),
        }
    }

    /// Whether they depend on the eye.
    pub fn is_view_dependent(&self) -> bool {
        match self {
            Self::Uv { .. } | Self::Surface(_) | Self::Triplanar(_) | Self::Projected(_) => false,
            Self::TwoPart(mapping) => mapping.is_view_dependent(),
            Self::Parameter(parameter) => parameter.is_view_dependent(),
        }
    }

    /// Whether they change with time.
    pub fn is_animated(&self) -> bool {
        match self {
            Self::Uv { .. } | Self::Surface(_) | Self::TwoPart(_) | Self::Triplanar(_) => false,
            Self::Projected(matrix) => matrix.is_animated(),
            Self::Parameter(parameter) => parameter.is_animated(),
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
        }
    }
}

fn surface_point(map: &SMap, at: &ShadingPoint<'_>) -> UvPoint {
    let [dx, dy] = at.position_steps;
    UvPoint { uv: map.uv(at.position, at.normal), steps: map.uv_footprint(at.position, at.normal, dx, dy) }
}
