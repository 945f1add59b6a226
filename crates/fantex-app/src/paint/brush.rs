//! The brush as the user sets it.

use std::path::{Path, PathBuf};

use fantex::base::{Error, ErrorKind, Result};
use fantex::paint::{BlendMode, Brush, Jitter, PressureResponse, Size, Stamp, Tip};
use serde::{Deserialize, Deserializer, Serialize};

use crate::settings::{continued, from_json, read_limited, set_aside, write_whole};

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
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Pixels, "px"), (Self::World, "units"), (Self::Texels, "texels")];
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BrushSettings {
    /// Its name among the presets.
    pub name: String,
    /// Diameter.
    #[serde(deserialize_with = "finite_size")]
    pub size: f32,
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
    pub blend: BlendMode,
    /// Whether dabs go on beyond small gaps of the mesh.
    pub across_gaps: bool,
    /// Whether only what the camera sees is painted.
    pub only_seen: bool,
    /// Of that, what faces the camera by at most so many degrees.
    pub seen_degrees: f32,
    pub jitter: Jitter,
    pub pressure: PressureResponse,
    /// Angle of tip or stamp, degrees.
    pub angle_degrees: f32,
    /// A shape of the dab that comes with the program; round without one.
    pub tip: Option<Tip>,
    /// A picture that shapes the dab instead.
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
            across_gaps: true,
            only_seen: false,
            seen_degrees: 85.0,
            jitter: Jitter::default(),
            pressure: PressureResponse { size: 0.0, flow: 0.6 },
            angle_degrees: 0.0,
            tip: None,
            stamp: None,
        }
    }
}

impl BrushSettings {
    /// Least and most diameter in pixels or texels.
    pub const SIZE: [f32; 2] = [1.0, 2000.0];

    /// Least and most diameter in units of the model's file.
    pub const WORLD_SIZE: [f32; 2] = [1e-6, 1e6];

    /// The brush for the engine. `world_per_pixel` is the size of a pixel where the stroke begins.
    pub fn brush(&self, world_per_pixel: f64, seed: u64) -> Brush {
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
            angle: self.angle_degrees,
            follow_tilt: false,
            across_gaps: self.across_gaps,
            jitter: self.jitter,
            pressure: self.pressure,
            stamp: self.stamp.clone(),
            tip: self.tip,
            seed,
        }
    }

    /// Larger (positive) or smaller by steps of a tenth, at least one unit of pixels or texels.
    pub fn change_size(&mut self, steps: f32) {
        self.scale_size(1.12f32.powf(steps));
    }

    /// So many times as large, within what a brush may be.
    pub fn scale_size(&mut self, factor: f32) {
        let [least, most] = if self.unit == SizeUnit::World { Self::WORLD_SIZE } else { Self::SIZE };
        self.size = (self.size * factor).clamp(least, most);
    }

    /// Harder (positive) or softer, in tenths.
    pub fn change_hardness(&mut self, tenths: f32) {
        self.hardness = (self.hardness + 0.1 * tenths).clamp(0.0, 1.0);
    }
}

/// Reads a diameter. JSON has no infinite numbers and holds `null` instead: that is read as the usual diameter.
fn finite_size<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<f32, D::Error> {
    let size = Option::<f32>::deserialize(from)?.filter(|size| size.is_finite());
    let [least, most] = BrushSettings::WORLD_SIZE;
    Ok(size.unwrap_or(BrushSettings::default().size).clamp(least, most))
}

/// Shapes of a dab.
pub const TIPS: [(Option<Tip>, &str); 13] = [
    (None, "Round"),
    (Some(Tip::Bristle), "Bristle"),
    (Some(Tip::Chalk), "Chalk"),
    (Some(Tip::Charcoal), "Charcoal"),
    (Some(Tip::Sponge), "Sponge"),
    (Some(Tip::Canvas), "Canvas"),
    (Some(Tip::Grain), "Grain"),
    (Some(Tip::Hatch), "Hatch"),
    (Some(Tip::Splatter), "Splatter"),
    (Some(Tip::Cloud), "Cloud"),
    (Some(Tip::Cracks), "Cracks"),
    (Some(Tip::Leaf), "Leaf"),
    (Some(Tip::Rake), "Rake"),
];

/// Of layers; brushes have all but erasing.
pub const BLEND_MODES: [(BlendMode, &str); 18] = [
    (BlendMode::Normal, "Normal"),
    (BlendMode::Multiply, "Multiply"),
    (BlendMode::Screen, "Screen"),
    (BlendMode::Overlay, "Overlay"),
    (BlendMode::Darken, "Darken"),
    (BlendMode::Lighten, "Lighten"),
    (BlendMode::ColorDodge, "Colour dodge"),
    (BlendMode::ColorBurn, "Colour burn"),
    (BlendMode::HardLight, "Hard light"),
    (BlendMode::SoftLight, "Soft light"),
    (BlendMode::Difference, "Difference"),
    (BlendMode::Exclusion, "Exclusion"),
    (BlendMode::Hue, "Hue"),
    (BlendMode::Saturation, "Saturation"),
    (BlendMode::Color, "Colour"),
    (BlendMode::Luminosity, "Luminosity"),
    (BlendMode::Add, "Add"),
    (BlendMode::Erase, "Erase"),
];

// Brushes that the user keeps, in a file of their own.

/// Most bytes of a file that is read as presets.
const MAX_FILE_BYTES: u64 = 4 << 20;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Presets {
    pub brushes: Vec<BrushSettings>,
    /// Names of the program's own brushes that were among them once: deleted ones do not come back.
    #[serde(default)]
    offered: Vec<String>,
}

impl Default for Presets {
    fn default() -> Self {
        Self { brushes: Vec::new(), offered: Vec::new() }.with_own()
    }
}

/// The program's own brushes.
fn own_brushes() -> Vec<BrushSettings> {
    let mut brushes = round_brushes();
    brushes.extend(textured_brushes());
    brushes
}

fn named(name: &str) -> BrushSettings {
    BrushSettings { name: name.into(), ..BrushSettings::default() }
}

fn round_brushes() -> Vec<BrushSettings> {
    let none = PressureResponse::default();
    vec![
        named("Soft round"),
        BrushSettings {
            hardness: 0.95,
            flow: 1.0,
            spacing: 0.08,
            pressure: PressureResponse { size: 0.5, flow: 0.0 },
            ..named("Hard round")
        },
        BrushSettings { hardness: 0.0, flow: 0.08, spacing: 0.06, size: 140.0, ..named("Airbrush") },
        BrushSettings {
            hardness: 0.9,
            flow: 1.0,
            size: 10.0,
            smoothing: 0.5,
            spacing: 0.1,
            pressure: PressureResponse { size: 0.8, flow: 0.0 },
            ..named("Ink pen")
        },
        BrushSettings {
            hardness: 0.8,
            size: 18.0,
            flow: 0.8,
            spacing: 0.9,
            jitter: Jitter { position: 3.0, size: 0.8, flow: 0.5, angle: 0.0 },
            pressure: none,
            ..named("Splatter")
        },
        BrushSettings {
            hardness: 0.5,
            flow: 0.35,
            spacing: 0.25,
            jitter: Jitter { position: 0.5, size: 0.5, flow: 0.6, angle: 0.0 },
            pressure: none,
            ..named("Dry bristle")
        },
    ]
}

fn textured_brushes() -> [BrushSettings; 12] {
    const ANY: f32 = std::f32::consts::PI;
    // Spacing, flow, and jitter of place, size and angle.
    let brush = |name: &str, tip: Tip, [spacing, flow]: [f32; 2], [position, size, angle]: [f32; 3]| {
        let jitter = Jitter { position, size, flow: 0.0, angle };
        // The tip alone says how far it covers.
        BrushSettings { tip: Some(tip), hardness: 1.0, size: 90.0, spacing, flow, jitter, ..named(name) }
    };
    [
        brush("Bristle", Tip::Bristle, [0.03, 0.35], [0.0; 3]),
        brush("Chalk", Tip::Chalk, [0.22, 0.8], [0.0, 0.0, ANY]),
        brush("Charcoal", Tip::Charcoal, [0.12, 0.6], [0.0, 0.0, 0.2]),
        brush("Sponge", Tip::Sponge, [0.6, 0.9], [0.3, 0.3, ANY]),
        brush("Canvas", Tip::Canvas, [0.5, 0.7], [0.0; 3]),
        brush("Grain", Tip::Grain, [0.2, 0.35], [0.1, 0.0, ANY]),
        brush("Hatching", Tip::Hatch, [0.5, 0.8], [0.0; 3]),
        brush("Ink drops", Tip::Splatter, [0.7, 1.0], [0.5, 0.5, ANY]),
        brush("Cloud", Tip::Cloud, [0.3, 0.25], [0.3, 0.4, ANY]),
        brush("Cracks", Tip::Cracks, [0.8, 0.9], [0.0, 0.0, ANY]),
        BrushSettings { size: 50.0, ..brush("Leaves", Tip::Leaf, [0.8, 1.0], [1.2, 0.5, ANY]) },
        brush("Grass", Tip::Rake, [0.03, 0.6], [0.0; 3]),
    ]
}

impl Presets {
    /// Reads presets; the usual ones where there is no file.
    ///
    /// # Errors
    /// There is a file that cannot be read. A damaged one is renamed.
    pub fn load(path: &Path) -> Result<Self> {
        let text = match read_limited(path, MAX_FILE_BYTES, "the brushes") {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(continued(error, "; there are the usual ones")),
        };
        let read = from_json::<Self>(&text).map(Self::with_own);
        read.map_err(|source| set_aside(path, "the brushes", source))
    }

    /// With those of the program's own brushes that were never among them.
    fn with_own(mut self) -> Self {
        for brush in own_brushes() {
            if self.offered.contains(&brush.name) {
                continue;
            }
            self.offered.push(brush.name.clone());
            if self.brushes.iter().all(|known| known.name != brush.name) {
                self.brushes.push(brush);
            }
        }
        self
    }

    /// Whether one of the program's own brushes was deleted.
    pub fn lacks_own(&self) -> bool {
        own_brushes().iter().any(|own| self.brushes.iter().all(|brush| brush.name != own.name))
    }

    /// Brings those of the program's own brushes back that were deleted.
    pub fn restore(&mut self) {
        self.offered.clear();
        *self = std::mem::take(self).with_own();
    }

    /// Writes them, whole or not at all.
    ///
    /// # Errors
    /// The operating system refuses, or the name of a stamp's file is no text.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_vec_pretty(self).map_err(|source| Error::writing(path, source.into()))?;
        write_whole(path, &text)
    }

    /// Keeps a brush under its name; one of that name is replaced.
    pub fn keep(&mut self, brush: &BrushSettings) {
        match self.brushes.iter_mut().find(|known| known.name == brush.name) {
            Some(known) => *known = brush.clone(),
            None => self.brushes.push(brush.clone()),
        }
    }
}

// A stroke of the brush on a sheet, for the brush panel.

/// Coverage 0..1 of a wave-like stroke on a sheet of `width` by `height` pixels, row by row. Pressure rises and falls. The brush is
/// shown at most so large that the wave can be seen.
pub fn preview_stroke(brush: &BrushSettings, width: usize, height: usize) -> Vec<f32> {
    let mut sheet = vec![0.0f32; width * height];
    let diameter = brush.size.clamp(2.0, 0.5 * height as f32);
    let margin = 0.5 * diameter + 6.0;
    let at = |t: f32| {
        let x = margin + t * (width as f32 - 2.0 * margin).max(1.0);
        let y =
            0.5 * height as f32 - (t * std::f32::consts::TAU).sin() * (0.5 * height as f32 - margin).max(0.0);
        [x, y]
    };
    let stamp = brush.tip.and_then(|tip| Stamp::of_tip(tip).ok());
    let mut random = 0x2545_f491_4f6c_dd1du64 ^ 1;
    let mut draw = || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random >> 40) as f32 / (1u64 << 24) as f32
    };
    let (mut t, mut due, mut last) = (0.0f32, 0.0f32, at(0.0));
    while t <= 1.0 {
        let here = at(t);
        due -= (here[0] - last[0]).hypot(here[1] - last[1]);
        last = here;
        if due <= 0.0 {
            let pressure = (t * std::f32::consts::PI).sin();
            let lowered = |response: f32| 1.0 - response.clamp(0.0, 1.0) * (1.0 - pressure);
            let [turn, out, smaller, fainter] = [draw(), draw(), draw(), draw()];
            let lean = if stamp.is_some() { 2.0 * draw() - 1.0 } else { 0.0 };
            let size = diameter * lowered(brush.pressure.size);
            let shift = brush.jitter.position * 0.5 * size * out;
            let (sin, cos) = (turn * std::f32::consts::TAU).sin_cos();
            let dab = Dab {
                center: [here[0] + shift * cos, here[1] + shift * sin],
                radius: 0.5 * size * (1.0 - brush.jitter.size.clamp(0.0, 1.0) * smaller),
                hardness: brush.hardness,
                flow: brush.flow
                    * lowered(brush.pressure.flow)
                    * (1.0 - brush.jitter.flow.clamp(0.0, 1.0) * fainter),
                angle: brush.angle_degrees.to_radians() + brush.jitter.angle * lean,
            };
            dab.add(stamp.as_ref(), &mut sheet, width, height);
            due += (brush.spacing * size).max(0.5);
        }
        t += 0.5 / width as f32;
    }
    sheet.iter_mut().for_each(|coverage| *coverage *= brush.opacity);
    sheet
}

struct Dab {
    center: [f32; 2],
    radius: f32,
    hardness: f32,
    flow: f32,
    /// Of the stamp, radians, counter-clockwise.
    angle: f32,
}

impl Dab {
    /// As on the surface: full within the hard part, then fading smoothly, and shaped by the stamp.
    fn add(&self, stamp: Option<&Stamp>, sheet: &mut [f32], width: usize, height: usize) {
        let (sin, cos) = self.angle.sin_cos();
        let end = self.radius.max(0.5) + 0.5;
        let start = (self.radius * self.hardness.clamp(0.0, 1.0)).min(end - 1.0).max(0.0);
        let range = |center: f32, most: usize| {
            ((center - end).max(0.0) as usize)..((center + end + 1.0).max(0.0) as usize).min(most)
        };
        for y in range(self.center[1], height) {
            for x in range(self.center[0], width) {
                let [right, up] = [x as f32 + 0.5 - self.center[0], self.center[1] - y as f32 - 0.5];
                let distance = right.hypot(up);
                if distance < end {
                    let s = ((distance - start) / (end - start)).max(0.0);
                    let shape = stamp.map_or(1.0, |stamp| {
                        let [along, across] = [right * cos + up * sin, up * cos - right * sin];
                        stamp.coverage(along / self.radius.max(0.5), across / self.radius.max(0.5))
                    });
                    let added = self.flow * (1.0 - s * s * (3.0 - 2.0 * s)) * shape;
                    let coverage = &mut sheet[y * width + x];
                    *coverage += added * (1.0 - *coverage);
                }
            }
        }
    }
}
