//! Applying a stroke file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_store::ChannelKind;
use fantex_texture::color::linear_from_srgb;
use fantex_texture::{
    Bounds, Image, LoadImageError, ShadingPoint, Solid, SolidPoint, Texture, UnknownSolid, solid_by_name,
};
use glam::{DVec3, Vec3, Vec4};

use super::file::{
    ColorSettings, LayerSettings, SampleSettings, StrokeFile, StrokeSettings, ToolSettings, Where,
};
use crate::stroke::mesh_length;
use crate::{
    Brush, ChannelPaint, Layer, Paint, PaintColor, PaintError, Painter, Sample, Size, Stamp, Stroke,
    StrokeSummary, Surface, SurfacePoint, Target, Tool, dabs_of, fill_triangles,
};

/// A stroke file could not be applied.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// It cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is not a stroke file.
    #[error("{} is not a stroke file: {source}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// A later format.
    #[error("this program replays stroke files of version 1; the file has version {0}")]
    Version(u32),
    /// A channel that the asset lacks.
    #[error("stroke {stroke} paints the channel {kind:?}, which the asset does not have")]
    Channel {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// What it asks for.
        kind: ChannelKind,
    },
    /// A channel that is named twice.
    #[error("stroke {stroke} names the channel {kind:?} twice")]
    ChannelTwice {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Which.
        kind: ChannelKind,
    },
    /// A triangle that the mesh lacks, or barycentric coordinates that are none.
    #[error("sample {sample} of stroke {stroke} is no point of the surface: {place:?}")]
    Point {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Number of the sample, from 0.
        sample: usize,
        /// What it asks for.
        place: Where,
    },
    /// A number that is not finite, or a size that is not positive.
    #[error("stroke {stroke}: {what} must be {range}")]
    Number {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Which.
        what: &'static str,
        /// What is allowed.
        range: &'static str,
    },
    /// A solid that does not exist.
    #[error("stroke {stroke}: {source}")]
    Solid {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Which.
        source: UnknownSolid,
    },
    /// A stamp that cannot be loaded.
    #[error("stroke {stroke}: {source}")]
    Stamp {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Why.
        source: LoadImageError,
    },
    /// Painting failed.
    #[error(transparent)]
    Paint(#[from] PaintError),
}

/// What a replay did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplaySummary {
    /// Strokes and fills.
    pub strokes: usize,
    /// Dabs of all strokes.
    pub dabs: usize,
    /// Pages of level 0 that changed, summed over the strokes.
    pub pages: usize,
    /// Samples whose rays met nothing; they were passed over.
    pub missed_samples: usize,
}

impl StrokeFile {
    /// Reads a stroke file.
    pub fn load(path: &Path) -> Result<Self, ReplayError> {
        let bytes =
            std::fs::read(path).map_err(|source| ReplayError::Read { path: path.to_owned(), source })?;
        let file: Self = serde_json::from_slice(&bytes)
            .map_err(|source| ReplayError::Parse { path: path.to_owned(), source })?;
        if file.version == 1 { Ok(file) } else { Err(ReplayError::Version(file.version)) }
    }
}

/// Applies all strokes of a file, one step of the history each. Commits nothing. `folder`: what paths of stamps are relative to.
pub fn replay(painter: &mut Painter, file: &StrokeFile, folder: &Path) -> Result<ReplaySummary, ReplayError> {
    let mut summary = ReplaySummary::default();
    // All are checked before the first one is applied.
    let mut prepared = Vec::with_capacity(file.strokes.len());
    for (index, settings) in file.strokes.iter().enumerate() {
        let preparation = Preparation { painter, stroke: index, settings, folder };
        let stroke = preparation.stroke(&mut summary.missed_samples)?;
        prepared.push((settings, preparation.paint(&stroke)?, stroke));
    }
    for (settings, paint, stroke) in prepared {
        let StrokeSummary { dabs, pages, .. } = apply(painter, settings, paint, &stroke)?;
        summary.strokes += 1;
        summary.dabs += dabs;
        summary.pages += pages;
    }
    Ok(summary)
}

fn apply(
    painter: &mut Painter,
    settings: &StrokeSettings,
    paint: Paint,
    stroke: &Stroke,
) -> Result<StrokeSummary, PaintError> {
    let target = target_of(painter, settings)?;
    painter.begin_on(target, &settings.label, paint)?;
    let surface = Arc::clone(painter.surface());
    match (settings.fill, stroke.samples.first()) {
        (Some(scope), Some(start)) => painter.fill(&fill_triangles(&surface, start.point, scope))?,
        _ => painter.dab(&dabs_of(&surface, stroke))?,
    }
    painter.end()
}

/// The layer that a stroke names; made where there is none.
fn target_of(painter: &mut Painter, settings: &StrokeSettings) -> Result<Target, PaintError> {
    let Some(LayerSettings { name, blend, opacity }) = &settings.layer else { return Ok(Target::Base) };
    if let Some(layer) = painter.layers().iter().find(|layer| layer.name == *name) {
        return Ok(Target::Layer(layer.id()));
    }
    let mut layer = Layer::painted(name);
    (layer.blend, layer.opacity) = (*blend, *opacity);
    Ok(Target::Layer(painter.add_layer(layer)?))
}

/// A stroke on its way from settings to what the painter takes.
struct Preparation<'a> {
    painter: &'a Painter,
    stroke: usize,
    settings: &'a StrokeSettings,
    folder: &'a Path,
}

impl Preparation<'_> {
    fn paint(&self, drawn: &Stroke) -> Result<Paint, ReplayError> {
        let stroke = self.stroke;
        let asset = self.painter.editor().asset();
        let mut channels: Vec<ChannelPaint> = Vec::new();
        for settings in &self.settings.channels {
            let kind = ChannelKind::from(settings.kind);
            let channel = asset.channel_of_kind(kind).ok_or(ReplayError::Channel { stroke, kind })?;
            if channels.iter().any(|painted| painted.channel == channel) {
                return Err(ReplayError::ChannelTwice { stroke, kind });
            }
            channels.push(ChannelPaint { channel, color: self.color(&settings.color)? });
        }
        let tool = match self.settings.tool {
            ToolSettings::Paint(mode) => Tool::Paint(mode),
            ToolSettings::Erase => Tool::Erase,
            ToolSettings::Blur { radius } => Tool::Blur { radius: self.mesh_length(radius)? },
            ToolSettings::Clone { from } => {
                let surface = self.painter.surface();
                let source = surface.mesh().world_from_mesh.inverse_point(DVec3::from(from));
                let start = drawn.samples.first().map_or(source, |s| surface.position(s.point).as_vec3());
                self.finite("the source of a clone", &source.to_array())?;
                Tool::Clone { offset: source - start, reach: self.mesh_length(drawn.brush.size)? }
            }
        };
        Ok(Paint { tool, opacity: self.settings.brush.opacity, channels })
    }

    fn color(&self, settings: &ColorSettings) -> Result<PaintColor, ReplayError> {
        let color = match settings {
            ColorSettings::Srgb(color) => Vec3::from(color.map(linear_from_srgb)).extend(1.0),
            ColorSettings::Linear(color) => Vec4::from(*color),
            ColorSettings::Solid { name, seed } => {
                let bounds = object_bounds(self.painter.surface());
                let solid = solid_by_name(name, bounds, *seed)
                    .map_err(|source| ReplayError::Solid { stroke: self.stroke, source })?;
                return Ok(PaintColor::Texture(Arc::new(NamedSolid(solid))));
            }
        };
        self.finite("a colour", &color.to_array())?;
        Ok(PaintColor::Constant(color))
    }

    fn mesh_length(&self, size: Size) -> Result<f32, ReplayError> {
        let length = mesh_length(self.painter.surface(), size);
        self.finite("a length", &[length]).map(|()| length.max(0.0))
    }

    fn finite(&self, what: &'static str, numbers: &[f32]) -> Result<(), ReplayError> {
        let range = "finite";
        let all = numbers.iter().all(|x| x.is_finite());
        if all { Ok(()) } else { Err(ReplayError::Number { stroke: self.stroke, what, range }) }
    }

    fn stroke(&self, missed: &mut usize) -> Result<Stroke, ReplayError> {
        let brush = self.brush()?;
        let mut samples = Vec::with_capacity(self.settings.samples.len());
        for (index, sample) in self.settings.samples.iter().enumerate() {
            self.finite("a sample's pressure and tilt", &[sample.pressure, sample.tilt[0], sample.tilt[1]])?;
            match self.point(index, sample)? {
                Some(point) => samples.push(Sample {
                    point,
                    pressure: sample.pressure,
                    tilt: sample.tilt,
                    time: sample.time,
                }),
                None => *missed += 1,
            }
        }
        Ok(Stroke { brush, samples, line: self.settings.line, symmetry: self.settings.symmetry })
    }

    fn brush(&self) -> Result<Brush, ReplayError> {
        let settings = &self.settings.brush;
        let size = match settings.size {
            Size::Texels(size) | Size::World(size) => size,
        };
        let numbers = [
            settings.hardness,
            settings.opacity,
            settings.flow,
            settings.smoothing,
            settings.angle,
            settings.jitter.position,
            settings.jitter.size,
            settings.jitter.flow,
            settings.jitter.angle,
            settings.pressure.size,
            settings.pressure.flow,
        ];
        self.finite("the brush's numbers", &numbers)?;
        let positive = |x: f32| x.is_finite() && x > 0.0;
        if !positive(size) || !positive(settings.spacing) {
            let (what, range) = ("the brush's size and spacing", "above 0");
            return Err(ReplayError::Number { stroke: self.stroke, what, range });
        }
        let stamp = settings.stamp.as_ref().map(|path| Image::load(self.folder.join(path))).transpose();
        let stamp = stamp.map_err(|source| ReplayError::Stamp { stroke: self.stroke, source })?;
        Ok(Brush {
            size: settings.size,
            hardness: settings.hardness,
            opacity: settings.opacity,
            flow: settings.flow,
            spacing: settings.spacing,
            smoothing: settings.smoothing,
            angle: settings.angle.to_radians(),
            follow_tilt: settings.follow_tilt,
            jitter: settings.jitter,
            pressure: settings.pressure,
            stamp: stamp.map(|image| Arc::new(Stamp::new(&image))),
            seed: settings.seed,
        })
    }

    /// None where a ray meets nothing.
    fn point(&self, index: usize, sample: &SampleSettings) -> Result<Option<SurfacePoint>, ReplayError> {
        let surface = self.painter.surface();
        let mesh = surface.mesh();
        let wrong = || ReplayError::Point { stroke: self.stroke, sample: index, place: sample.at };
        match sample.at {
            Where::Position(position) => {
                let position = mesh.world_from_mesh.inverse_point(DVec3::from(position));
                surface.nearest(position, f32::INFINITY).map(Some).ok_or_else(wrong)
            }
            Where::Ray { origin, direction } => {
                let origin = mesh.world_from_mesh.inverse_point(DVec3::from(origin));
                let direction = DVec3::from(direction).try_normalize().ok_or_else(wrong)?;
                Ok(surface.hit(origin, direction.as_vec3()))
            }
            Where::Point { triangle, lambda } => {
                let lambda = Vec3::from(lambda);
                let is_point = lambda.min_element() >= 0.0 && (lambda.element_sum() - 1.0).abs() < 1e-3;
                let exists = (triangle as usize) < mesh.triangles.len();
                if is_point && exists { Ok(Some(SurfacePoint { triangle, lambda })) } else { Err(wrong()) }
            }
        }
    }
}

/// A solid that was found by its name, as a texture.
struct NamedSolid(Box<dyn Solid>);

impl Texture for NamedSolid {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let point = SolidPoint { p: at.position, n: at.normal, footprint: at.width(), time: at.time };
        Vec4::from_array(self.0.color(&point))
    }
}

/// The model's bounds in object space.
fn object_bounds(surface: &Surface) -> Bounds {
    let mesh = surface.mesh();
    let scale = mesh.world_from_mesh.scale as f32;
    let positions = || mesh.positions.iter().map(|p| *p * scale);
    let min = positions().fold(Vec3::INFINITY, Vec3::min);
    let max = positions().fold(Vec3::NEG_INFINITY, Vec3::max);
    Bounds { min, max }
}
