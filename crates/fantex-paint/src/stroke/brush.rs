//! The brush: how an input becomes dabs.

use std::sync::Arc;

use crate::{Stamp, SurfacePoint};

/// A length on the surface.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Size {
    /// Nominal texels of level 0 (the cover's density).
    Texels(f32),
    /// World units.
    World(f32),
}

/// How far pressure goes into a property: 0 not at all, 1 proportionally.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PressureResponse {
    /// Of the radius.
    pub size: f32,
    /// Of the flow.
    pub flow: f32,
}

/// Random changes from dab to dab, drawn from the stroke's seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Jitter {
    /// Largest distance from the path, in radii, along the surface.
    pub position: f32,
    /// Largest share that the radius shrinks by, 0..1.
    pub size: f32,
    /// Largest share that the flow shrinks by, 0..1.
    pub flow: f32,
    /// Largest turn of the stamp, radians.
    pub angle: f32,
}

/// A brush.
#[derive(Clone, Debug)]
pub struct Brush {
    /// Diameter.
    pub size: Size,
    /// Share of the radius within which a dab is full, 0..1.
    pub hardness: f32,
    /// Most that a stroke covers, 0..1, however often it passes.
    pub opacity: f32,
    /// What each dab adds of what is missing to the opacity, 0..1.
    pub flow: f32,
    /// Distance of dabs in diameters.
    pub spacing: f32,
    /// 0: dabs follow the samples. Towards 1: they lag behind and cut corners.
    pub smoothing: f32,
    /// Angle of the stamp, radians, counter-clockwise; 0 is upright.
    pub angle: f32,
    /// Dabs follow a tilted pen: added to the angle is the direction that it leans to, and they become ellipses along it.
    pub follow_tilt: bool,
    /// Random changes.
    pub jitter: Jitter,
    /// What pressure does.
    pub pressure: PressureResponse,
    /// The picture of a dab; round without one.
    pub stamp: Option<Arc<Stamp>>,
    /// Of the jitter.
    pub seed: u64,
}

impl Default for Brush {
    /// Round, soft, 64 texels wide.
    fn default() -> Self {
        Self {
            size: Size::Texels(64.0),
            hardness: 0.5,
            opacity: 1.0,
            flow: 1.0,
            spacing: 0.1,
            smoothing: 0.0,
            angle: 0.0,
            follow_tilt: false,
            jitter: Jitter::default(),
            pressure: PressureResponse::default(),
            stamp: None,
            seed: 0,
        }
    }
}

/// Where the pen was at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// On the surface.
    pub point: SurfacePoint,
    /// 0..1.
    pub pressure: f32,
    /// Lean of the pen along the stamp's x and y axis, radians; zero upright.
    pub tilt: [f32; 2],
    /// Seconds since the stroke's start.
    pub time: f32,
}

impl Sample {
    /// Full pressure, upright.
    pub fn at(point: SurfacePoint) -> Self {
        Self { point, pressure: 1.0, tilt: [0.0; 2], time: 0.0 }
    }
}
