//! A stroke on its way from settings to what the painter takes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_store::ChannelKind;
use fantex_texture::{ColorSpace, Image, Samples};
use glam::{DVec3, Vec3};

use super::ReplayError;
use super::color::color_of;
use super::file::{
    ColorSettings, DabSettings, FillLayerSettings, LookSettings, SampleSettings, StencilBy, StrokeSettings,
    ToolSettings, Where,
};
use crate::stroke::mesh_length;
use crate::{
    Brush, ChannelPaint, DEFAULT_FONT, Dab, Decal, GraphFill, Paint, Painter, Picture, Projection,
    ProjectionView, SMUDGE_SPACING, Sample, Size, Stamp, Stroke, Surface, SurfacePoint, TextureGraph, Tool,
    draw_text,
};

/// A stroke's settings beside what they are for.
pub(super) struct Preparation<'a> {
    pub(super) painter: &'a Painter,
    pub(super) stroke: usize,
    pub(super) settings: &'a StrokeSettings,
    pub(super) folder: &'a Path,
}

/// A stroke that can be applied.
pub(super) struct Prepared {
    pub(super) paint: Paint,
    pub(super) stroke: Stroke,
    pub(super) decals: Vec<Decal>,
    pub(super) dabs: Vec<Dab>,
    /// Of the layer that it makes or changes.
    pub(super) fill: Option<GraphFill>,
}

impl Preparation<'_> {
    pub(super) fn run(&self, missed: &mut usize) -> Result<Prepared, ReplayError> {
        let stroke = self.stroke(missed)?;
        let dabs = self.dabs(&stroke.brush)?;
        let first = stroke.samples.first().map(|sample| sample.point).or(dabs.first().map(|dab| dab.center));
        let paint = self.paint(&stroke, first)?;
        let decals = self.decals(&stroke)?;
        let fill = self.settings.layer.as_ref().and_then(|layer| layer.fill.as_ref());
        let fill = fill.map(|fill| self.fill_layer(fill)).transpose()?;
        Ok(Prepared { paint, stroke, decals, dabs, fill })
    }

    fn channel(&self, kind: ChannelKind) -> Result<usize, ReplayError> {
        let channel = self.painter.editor().asset().channel_of_kind(kind);
        channel.ok_or(ReplayError::Channel { stroke: self.stroke, kind })
    }

    fn paint(&self, drawn: &Stroke, first: Option<SurfacePoint>) -> Result<Paint, ReplayError> {
        let stroke = self.stroke;
        let mut channels: Vec<ChannelPaint> = Vec::new();
        for settings in &self.settings.channels {
            let kind = ChannelKind::from(settings.kind);
            let channel = self.channel(kind)?;
            if channels.iter().any(|painted| painted.channel == channel) {
                return Err(ReplayError::ChannelTwice { stroke, kind });
            }
            channels.push(ChannelPaint { channel, color: color_of(self, kind, &settings.color)? });
        }
        let stencil = self.stencil()?;
        Ok(Paint { tool: self.tool(drawn, first)?, opacity: self.settings.brush.opacity, channels, stencil })
    }

    /// `first`: where the stroke begins.
    fn tool(&self, drawn: &Stroke, first: Option<SurfacePoint>) -> Result<Tool, ReplayError> {
        Ok(match self.settings.tool {
            ToolSettings::Paint(mode) => Tool::Paint(mode),
            ToolSettings::Erase => Tool::Erase,
            ToolSettings::Blur { radius } => Tool::Blur { radius: self.mesh_length(radius)? },
            ToolSettings::Smudge { strength } => {
                self.finite("the strength of a smudge", &[strength])?;
                Tool::Smudge { strength }
            }
            ToolSettings::Clone { from } => {
                let surface = self.painter.surface();
                let source = surface.mesh().world_from_mesh.inverse_point(DVec3::from(from));
                let start = first.map_or(source, |point| surface.position(point).as_vec3());
                self.finite("the source of a clone", &source.to_array())?;
                Tool::Clone { offset: source - start, reach: self.mesh_length(drawn.brush.size)? }
            }
        })
    }

    /// A picture of the stroke file's folder.
    pub(super) fn image(&self, path: &Path) -> Result<Image, ReplayError> {
        let image = Image::load(self.folder.join(path));
        image.map_err(|source| ReplayError::Stamp { stroke: self.stroke, source })
    }

    /// The same for a channel: where that holds no colour, fixed-point numbers are taken as they are.
    pub(super) fn image_for(&self, kind: ChannelKind, path: &Path) -> Result<Image, ReplayError> {
        let image = self.image(path)?;
        let is_color = matches!(kind, ChannelKind::BaseColor | ChannelKind::Emission | ChannelKind::Light);
        let stays = is_color || matches!(image.samples, Samples::F32(_));
        Ok(if stays { image } else { Image { space: ColorSpace::Linear, ..image } })
    }

    pub(super) fn graph(&self, look: &LookSettings) -> Result<TextureGraph, ReplayError> {
        let absolute = |folder: PathBuf| std::path::absolute(&folder).unwrap_or(folder);
        match look {
            LookSettings::File(path) => {
                let path = self.folder.join(path);
                let text = std::fs::read_to_string(&path);
                let text = text.map_err(|source| ReplayError::Read { path: path.clone(), source })?;
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                Ok(TextureGraph { look: text, folder: absolute(folder) })
            }
            LookSettings::Inline { text, folder } => {
                Ok(TextureGraph { look: text.clone(), folder: absolute(self.folder.join(folder)) })
            }
        }
    }

    fn fill_layer(&self, settings: &FillLayerSettings) -> Result<GraphFill, ReplayError> {
        let graph = self.graph(&settings.look)?;
        let mut textures = vec![None; self.painter.editor().asset().channels().len()];
        for texture in &settings.textures {
            let made = graph.texture(self.painter.surface(), &texture.texture);
            made.map_err(|source| ReplayError::Graph { stroke: self.stroke, source: Box::new(source) })?;
            textures[self.channel(texture.kind.into())?] = Some(texture.texture.clone());
        }
        Ok(GraphFill { graph, textures })
    }

    /// The projection of the stroke, with a picture.
    pub(super) fn projection(&self, picture: Arc<Picture>) -> Result<Option<Projection>, ReplayError> {
        let Some(settings) = self.settings.projection else { return Ok(None) };
        let [eye, target, up] = [settings.eye, settings.target, settings.up].map(DVec3::from);
        let view = ProjectionView { eye, target, up, lens: settings.lens, place: settings.place };
        let projection = Projection::new(self.painter.surface(), &view, picture);
        projection.map(Some).ok_or(ReplayError::Camera { stroke: self.stroke })
    }

    fn stencil(&self) -> Result<Option<Arc<Projection>>, ReplayError> {
        let Some(settings) = &self.settings.stencil else { return Ok(None) };
        let image = self.image(&settings.image)?;
        let picture = match settings.by {
            StencilBy::Shape => Picture::shape(&image),
            StencilBy::Alpha => Picture::new(&image),
        };
        let projection = self.projection(Arc::new(picture))?;
        projection.map(|p| Some(Arc::new(p))).ok_or(ReplayError::NoCamera { stroke: self.stroke })
    }

    fn decals(&self, drawn: &Stroke) -> Result<Vec<Decal>, ReplayError> {
        let (shape, size, angle, mirrored) = if let Some(decal) = &self.settings.decal {
            let shape = self.decal_shape(decal.shape.as_deref())?;
            (shape, self.mesh_length(decal.size)?, decal.angle, decal.mirrored)
        } else if let Some(text) = &self.settings.text {
            let font = text.font.as_ref().map(|path| {
                let path = self.folder.join(path);
                std::fs::read(&path).map_err(|source| ReplayError::Read { path, source })
            });
            let font = font.transpose()?;
            let drawn = draw_text(&text.text, font.as_deref().unwrap_or(DEFAULT_FONT));
            let drawn = drawn.map_err(|source| ReplayError::Text { stroke: self.stroke, source })?;
            (drawn.picture, self.mesh_length(text.size)? * drawn.lines, text.angle, text.mirrored)
        } else {
            return Ok(Vec::new());
        };
        self.finite("the size and angle of a decal", &[size, angle])?;
        let shape = Arc::new(shape);
        let surface = self.painter.surface();
        let angle = angle.to_radians();
        let readable = self.settings.text.is_some();
        let decals = drawn.samples.iter().flat_map(|sample| {
            let decal = Decal { center: sample.point, size, angle, shape: Arc::clone(&shape), mirrored };
            decal.copies(surface, &drawn.symmetry, readable)
        });
        Ok(decals.collect())
    }

    fn decal_shape(&self, path: Option<&Path>) -> Result<Picture, ReplayError> {
        if let Some(path) = path {
            return Ok(Picture::shape(&self.image(path)?));
        }
        let colors = self.settings.channels.iter().map(|channel| &channel.color);
        let image = colors.filter_map(|color| match color {
            ColorSettings::Image(path) => Some(path),
            _ => None,
        });
        let first = image.into_iter().next().ok_or(ReplayError::NoPicture { stroke: self.stroke })?;
        Ok(Picture::new(&self.image(first)?))
    }

    fn dabs(&self, brush: &Brush) -> Result<Vec<Dab>, ReplayError> {
        let scale = self.painter.surface().mesh().world_from_mesh.scale;
        let mut dabs = Vec::with_capacity(self.settings.dabs.len());
        for (index, dab) in self.settings.dabs.iter().enumerate() {
            let DabSettings { at, radius, hardness, flow, angle, aspect } = *dab;
            self.finite("a dab's numbers", &[radius, hardness, flow, angle, aspect])?;
            let radius = (f64::from(radius) / scale) as f32;
            let stamp = brush.stamp.clone();
            if let Some(center) = self.point(index, at)? {
                dabs.push(Dab { center, radius, hardness, flow, angle, aspect, stamp });
            }
        }
        Ok(dabs)
    }

    fn mesh_length(&self, size: Size) -> Result<f32, ReplayError> {
        let length = mesh_length(self.painter.surface(), size);
        self.finite("a length", &[length]).map(|()| length.max(0.0))
    }

    pub(super) fn finite(&self, what: &'static str, numbers: &[f32]) -> Result<(), ReplayError> {
        let range = "finite";
        let all = numbers.iter().all(|x| x.is_finite());
        if all { Ok(()) } else { Err(ReplayError::Number { stroke: self.stroke, what, range }) }
    }

    fn stroke(&self, missed: &mut usize) -> Result<Stroke, ReplayError> {
        let brush = self.brush()?;
        let mut samples = Vec::with_capacity(self.settings.samples.len());
        for (index, sample) in self.settings.samples.iter().enumerate() {
            self.finite("a sample's pressure and tilt", &[sample.pressure, sample.tilt[0], sample.tilt[1]])?;
            let SampleSettings { at, pressure, tilt, time } = *sample;
            match self.point(index, at)? {
                Some(point) => samples.push(Sample { point, pressure, tilt, time }),
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
        let stamp = settings.stamp.as_ref().map(|path| self.image(path)).transpose()?;
        let is_smudge = matches!(self.settings.tool, ToolSettings::Smudge { .. });
        let most = if is_smudge { SMUDGE_SPACING } else { f32::INFINITY };
        Ok(Brush {
            size: settings.size,
            hardness: settings.hardness,
            opacity: settings.opacity,
            flow: settings.flow,
            spacing: settings.spacing.min(most),
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
    fn point(&self, index: usize, place: Where) -> Result<Option<SurfacePoint>, ReplayError> {
        match (place, place_on(self.painter.surface(), place)) {
            (Where::Ray { direction, .. }, None) if DVec3::from(direction).try_normalize().is_some() => {
                Ok(None)
            }
            (_, None) => Err(ReplayError::Point { stroke: self.stroke, sample: index, place }),
            (_, point) => Ok(point),
        }
    }
}

/// The point of a surface that is meant; none where there is none.
pub(crate) fn place_on(surface: &Surface, place: Where) -> Option<SurfacePoint> {
    let mesh = surface.mesh();
    let mesh_point = |position: [f64; 3]| mesh.world_from_mesh.inverse_point(DVec3::from(position));
    match place {
        Where::Position(position) => surface.nearest(mesh_point(position), f32::INFINITY),
        Where::Surface { position, normal } => {
            surface.nearest_facing(mesh_point(position), Vec3::from(normal))
        }
        Where::Ray { origin, direction } => {
            let direction = DVec3::from(direction).try_normalize()?;
            surface.hit(mesh_point(origin), direction.as_vec3())
        }
        Where::Point { triangle, lambda } => {
            let lambda = Vec3::from(lambda);
            let is_point = lambda.min_element() >= 0.0 && (lambda.element_sum() - 1.0).abs() < 1e-3;
            let exists = (triangle as usize) < mesh.triangles.len();
            (is_point && exists).then_some(SurfacePoint { triangle, lambda })
        }
    }
}
