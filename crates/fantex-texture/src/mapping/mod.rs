//! Closed-form mappings of space to texture coordinates: the S-maps of Bier and Sloan, "Two-part texture mappings", 1986,
//! and their O-maps.
//!
//! ```text
//! point of the object --O-map--> point of the intermediate surface --S-map--> texture coordinates
//! ```
//!
//! A mapping gives the coordinates of a point and their derivatives. The derivatives are analytic, so a footprint that lies
//! across a seam (where the angle of a cylinder jumps) is as small as its neighbours', and at a pole it is merely long.

mod shape;
mod triplanar;
mod two_part;

use std::str::FromStr;

use fantex_base::{Aabb, Error, Result};
use glam::{Vec2, Vec3};

pub use shape::{BoxMap, CylinderMap, HemisphereLayout, HemisphereMap, PlanarMap, SphereMap};
pub use triplanar::{TriplanarMap, TriplanarTap};
pub use two_part::{OMap, Placement, SMap, Shape, ShapeKind, ShapePoint, TwoPartMapping};

/// From a surface point to texture coordinates.
pub trait Mapping: Send + Sync {
    /// The coordinates of the point `p` with the surface normal `n` (of any length).
    fn uv(&self, p: Vec3, n: Vec3) -> Vec2;

    /// The change of the coordinates when the point moves by `dp_dx` and by `dp_dy`, to first order.
    fn uv_footprint(&self, p: Vec3, n: Vec3, dp_dx: Vec3, dp_dy: Vec3) -> [Vec2; 2];
}

/// The names by which the command line knows the mappings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MappingKind {
    /// [`PlanarMap`].
    Planar,
    /// [`BoxMap`].
    Box,
    /// [`CylinderMap`].
    Cylinder,
    /// [`SphereMap`].
    Sphere,
    /// [`TriplanarMap`].
    Triplanar,
}

impl MappingKind {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Planar, Self::Box, Self::Cylinder, Self::Sphere, Self::Triplanar];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planar => "planar",
            Self::Box => "box",
            Self::Cylinder => "cylinder",
            Self::Sphere => "sphere",
            Self::Triplanar => "triplanar",
        }
    }

    /// The mapping of this kind that spreads one image over `bounds`, y being up.
    pub fn fit(self, bounds: Aabb) -> AnyMapping {
        match self {
            Self::Planar => AnyMapping::Single(Box::new(PlanarMap::fit(bounds))),
            Self::Box => AnyMapping::Single(Box::new(BoxMap::fit(bounds))),
            Self::Cylinder => AnyMapping::Single(Box::new(CylinderMap::fit(bounds))),
            Self::Sphere => AnyMapping::Single(Box::new(SphereMap::fit(bounds))),
            Self::Triplanar => AnyMapping::Triplanar(TriplanarMap::fit(bounds)),
        }
    }
}

impl FromStr for MappingKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            Error::invalid(format!("'{name}' is no mapping; use planar, box, cylinder, sphere or triplanar"))
        })
    }
}

/// A mapping with one look-up per point, or the triplanar one with up to three.
pub enum AnyMapping {
    /// One look-up.
    Single(Box<dyn Mapping>),
    /// Three blended look-ups.
    Triplanar(TriplanarMap),
}

impl AnyMapping {
    /// The blended value of `look_up(uv, footprint)` at the point `p` with normal `n`; the footprint belongs to moves of
    /// the point by `dp_dx` and `dp_dy`.
    pub fn evaluate(
        &self,
        p: Vec3,
        n: Vec3,
        [dp_dx, dp_dy]: [Vec3; 2],
        mut look_up: impl FnMut(Vec2, [Vec2; 2]) -> [f32; 4],
    ) -> [f32; 4] {
        match self {
            Self::Single(map) => look_up(map.uv(p, n), map.uv_footprint(p, n, dp_dx, dp_dy)),
            Self::Triplanar(map) => map.evaluate(p, n, [dp_dx, dp_dy], look_up),
        }
    }
}
