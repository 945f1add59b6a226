//! The environment of a picture on the command line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use fantex::render::{Background, EnvironmentLight};
use fantex::texture::environment::{EnvironmentMap, PrefilteredEnvironment, Sky};
use glam::Vec3;

use crate::error::CliError;

/// The name that stands for a computed sky instead of a file.
const COMPUTED_SKY: &str = "sky";

/// Side of the faces of a computed sky.
const SKY_SIDE: u32 = 512;

/// Options about surroundings.
#[derive(Args, Debug)]
pub(crate) struct SurroundingsArgs {
    /// Light and background from a picture of the surroundings (.hdr .exr .png ...): a panorama (2:1), a cube's cross (4:3
    /// or 3:4) or a strip of its faces (6:1, 1:6); or "sky" for a computed one with the sun at --light
    #[arg(long, value_name = "FILE|sky")]
    environment: Option<PathBuf>,
    /// Degrees by which the environment is turned to the left
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, requires = "environment", value_parser = finite)]
    environment_rotation: f32,
    /// Factor of the environment's light
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, requires = "environment", value_parser = not_negative)]
    environment_strength: f32,
    /// What is seen behind the model
    #[arg(long, value_enum, default_value_t, requires = "environment")]
    background: BackgroundArg,
    /// How much the environment is blurred behind the model, 0 to 1; its light and reflections stay as they are
    #[arg(long, value_name = "0..1", default_value_t = 0.0, requires = "environment", value_parser = share)]
    background_blur: f32,
}

/// What is seen behind the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum BackgroundArg {
    /// The environment
    #[default]
    Environment,
    /// A grey gradient, as without an environment
    Gradient,
    /// Nothing: the picture gets an alpha channel
    Transparent,
}

/// A text is no number in the range.
#[derive(Clone, Copy, Debug, thiserror::Error)]
enum NumberError {
    #[error("expected a finite number")]
    Finite,
    #[error("expected a finite number that is not negative")]
    Negative,
    #[error("expected a number from 0 to 1")]
    Share,
}

fn finite(text: &str) -> Result<f32, NumberError> {
    text.parse().ok().filter(|number: &f32| number.is_finite()).ok_or(NumberError::Finite)
}

fn not_negative(text: &str) -> Result<f32, NumberError> {
    finite(text).ok().filter(|&number| number >= 0.0).ok_or(NumberError::Negative)
}

fn share(text: &str) -> Result<f32, NumberError> {
    finite(text).ok().filter(|number| (0.0..=1.0).contains(number)).ok_or(NumberError::Share)
}

/// An environment, ready for lighting.
pub(crate) struct Surroundings {
    /// Its light.
    pub(crate) light: EnvironmentLight,
    /// Colour of the lamp that stands for the sun of a computed sky.
    pub(crate) sun: Option<Vec3>,
    background: BackgroundArg,
    blur: f32,
}

impl SurroundingsArgs {
    /// Reads or computes the environment that was asked for. `to_sun` is where a computed sky has its sun.
    pub(crate) fn load(&self, to_sun: Option<Vec3>) -> Result<Option<Surroundings>, CliError> {
        let Some(path) = &self.environment else { return Ok(None) };
        let (map, sun) = if path == Path::new(COMPUTED_SKY) {
            let sky = Sky { to_sun: to_sun.unwrap_or(Sky::default().to_sun), ..Sky::default() };
            // The disc would be seen, but also light the model a second time: the lamp stands for it.
            (sky.to_map(SKY_SIDE)?, Some(sky.sun_color()))
        } else {
            (EnvironmentMap::load(path)?, None)
        };
        let map = Arc::new(PrefilteredEnvironment::new(Arc::new(map)));
        let light = EnvironmentLight {
            map,
            strength: self.environment_strength,
            rotation_degrees: self.environment_rotation,
        };
        Ok(Some(Surroundings { light, sun, background: self.background, blur: self.background_blur }))
    }
}

impl Surroundings {
    /// What is seen behind the model.
    pub(crate) fn background(&self) -> Background {
        match self.background {
            BackgroundArg::Environment => Background::Environment { blur: self.blur },
            BackgroundArg::Gradient => Background::default(),
            BackgroundArg::Transparent => Background::Transparent,
        }
    }
}
