//! The brush as the user sets it.

use std::path::PathBuf;
use std::sync::Arc;

use fantex_paint::{BlendMode, Brush, Jitter, PressureResponse, Size, Stamp};
use serde::{Deserialize, Serialize};

/// What a brush's size is measured in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SizeUnit {
    /// Pixels of the screen where the stroke begins.
    #[default]
    Pixels,
    /// Units of the model's file.
    World,
    /// Texels of the finest level.
    Texels,
}

impl SizeUnit {
    /// All units.
    pub const ALL: [Self; 3] = [Self::Pixels, Self::World, Self::Texels];

    /// Its name.
    pub fn label(self) -> &'static str {
        match self {
            Self::Pixels => "px",
            Self::World => "units",
            Self::Texels => "texels",
        }
    }
}

/// A brush.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BrushSettings {
    /// Its name among the presets.
    pub name: String,
    /// Diameter.
    pub size: f32,
    /// What that is measured in.
    pub unit: SizeUnit,
    /// Share of the radius that is full, 0..1.
    pub hardness: f32,
    /// Most that a stroke covers, 0..1.
    pub opacity: f32,
    /// What a dab adds, 0..1.
    pub flow: f32,
    /// Distance of dabs in diameters.
    pub spacing: f32,
    /// How far the brush lags behind the hand, 0..1.
    pub smoothing: f32,
    /// How it lies over what is there.
    pub blend: BlendMode,
    /// Random changes.
    pub jitter: Jitter,
    /// What pressure does.
    pub pressure: PressureResponse,
    /// Angle of the stamp, degrees.
    pub angle_degrees: f32,
    /// A picture that shapes the dab.
    pub stamp: Option<PathBuf>,
}

impl Default for BrushSettings {
    fn default() -> Self {
        Self {
            name: "Soft round".into(),
            size: 60.0,
            unit: SizeUnit::Pixels,
            hardness: 0.4,
            opacity: 1.0,
            flow: 0.7,
            spacing: 0.12,
            smoothing: 0.15,
            blend: BlendMode::Normal,
            jitter: Jitter::default(),
            pressure: PressureResponse { size: 0.0, flow: 0.6 },
            angle_degrees: 0.0,
            stamp: None,
        }
    }
}

impl BrushSettings {
    /// Least and most diameter.
    pub const SIZE: [f32; 2] = [1.0, 2000.0];

    /// The brush for the engine. `world_per_pixel` is the size of a pixel where the stroke begins.
    pub fn brush(&self, world_per_pixel: f64, stamp: Option<Arc<Stamp>>, seed: u64) -> Brush {
        Brush {
            size: match self.unit {
                SizeUnit::Pixels => Size::World((f64::from(self.size) * world_per_pixel) as f32),
                SizeUnit::World => Size::World(self.size),
                SizeUnit::Texels => Size::Texels(self.size),
            },
            hardness: self.hardness,
            opacity: self.opacity,
            flow: self.flow,
            spacing: self.spacing,
            smoothing: self.smoothing,
            angle: self.angle_degrees.to_radians(),
            follow_tilt: false,
            jitter: self.jitter,
            pressure: self.pressure,
            stamp,
            seed,
        }
    }

    /// Larger (positive) or smaller by steps of a tenth, at least one unit of pixels or texels.
    pub fn change_size(&mut self, steps: f32) {
        let changed = self.size * 1.12f32.powf(steps);
        self.size = match self.unit {
            SizeUnit::World => changed.max(1e-6),
            _ => changed.clamp(Self::SIZE[0], Self::SIZE[1]),
        };
    }

    /// Harder (positive) or softer, in tenths.
    pub fn change_hardness(&mut self, tenths: f32) {
        self.hardness = (self.hardness + 0.1 * tenths).clamp(0.0, 1.0);
    }
}

/// The name of a blend mode.
pub fn blend_label(mode: BlendMode) -> &'static str {
    match mode {
        BlendMode::Normal => "Normal",
        BlendMode::Multiply => "Multiply",
        BlendMode::Screen => "Screen",
        BlendMode::Overlay => "Overlay",
        BlendMode::Darken => "Darken",
        BlendMode::Lighten => "Lighten",
        BlendMode::ColorDodge => "Colour dodge",
        BlendMode::ColorBurn => "Colour burn",
        BlendMode::HardLight => "Hard light",
        BlendMode::SoftLight => "Soft light",
        BlendMode::Difference => "Difference",
        BlendMode::Exclusion => "Exclusion",
        BlendMode::Hue => "Hue",
        BlendMode::Saturation => "Saturation",
        BlendMode::Color => "Colour",
        BlendMode::Luminosity => "Luminosity",
        BlendMode::Add => "Add",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_become_world_units_where_the_stroke_begins() {
        let settings = BrushSettings { size: 50.0, ..BrushSettings::default() };
        assert_eq!(settings.brush(0.02, None, 0).size, Size::World(1.0));
        let settings = BrushSettings { unit: SizeUnit::Texels, ..settings };
        assert_eq!(settings.brush(0.02, None, 0).size, Size::Texels(50.0));
    }

    #[test]
    fn sizes_stay_within_bounds() {
        let mut settings = BrushSettings::default();
        settings.change_size(1000.0);
        assert_eq!(settings.size, BrushSettings::SIZE[1]);
        settings.change_size(-1000.0);
        assert_eq!(settings.size, BrushSettings::SIZE[0]);
        settings.change_hardness(20.0);
        assert_eq!(settings.hardness, 1.0);
    }
}
