//! Strokes from a file: the same picture on every run, on any number of threads, on any asset of the model.
//!
//! Samples are given by where they lie in the world, so a file fits any resolution, cover or repair of the model that it
//! was recorded on. The format is that of [`StrokeFile`], as JSON:
//!
//! ```json
//! {
//!   "version": 1,
//!   "strokes": [{
//!     "label": "red line",
//!     "brush": { "size": { "texels": 40 }, "hardness": 0.3, "opacity": 0.8, "flow": 0.5, "spacing": 0.1 },
//!     "tool": { "paint": "normal" },
//!     "channels": [{ "kind": "base_color", "color": { "srgb": [0.9, 0.1, 0.1] } }],
//!     "samples": [{ "at": { "position": [0.1, 0.2, 0.3] } }, { "at": { "position": [0.2, 0.2, 0.3] }, "pressure": 0.5 }]
//!   }]
//! }
//! ```

use std::cell::RefCell;
use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_base::{Error, Result, input, json_problem};
use fantex_store::ChannelKind;
use fantex_texture::{ColorSpace, Image, Samples};
use glam::{DVec3, Vec3};

use crate::error::malformed;
use crate::log::check_named;
use crate::stroke::mesh_length;
use crate::stroke_file::{color_of, names_of};
use crate::{
    Brush, ChannelPaint, ColorSettings, DEFAULT_FONT, Dab, DabSettings, Decal, FillArea, FillLayerSettings,
    GraphFill, GroupKind, Layer, LayerContent, LayerPlace, LayerSettings, LookSettings, Paint, Painter,
    Picture, Projection, SMUDGE_SPACING, Sample, SampleSettings, Sight, Size, Stamp, StencilBy, Stroke,
    StrokeFile, StrokeSettings, StrokeSummary, Surface, SurfacePoint, Target, TextureGraph, Tool,
    ToolSettings, Where, dabs_of, draw_text,
};

// Applying a stroke file.

/// What a replay did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReplaySummary {
    /// Strokes and fills.
    pub strokes: usize,
    /// Dabs of all strokes.
    pub dabs: usize,
    /// Pages of level 0 that changed, summed over the strokes.
    pub pages: usize,
    /// Samples whose rays met nothing; they were passed over.
    pub missed_samples: usize,
    /// Strokes of a log that could not be recorded and so are missing.
    pub unrecorded: usize,
    /// Characters of texts that their fonts lack, each once.
    pub missing_characters: String,
    /// Strokes that paint and change no texel: their numbers in the file, from 0, and labels.
    pub untouching: Vec<(usize, String)>,
}

impl StrokeFile {
    /// Reads a stroke file.
    ///
    /// # Errors
    /// The file cannot be read, is no stroke file of this version, or names files outside its folder.
    pub fn load(path: &Path) -> Result<Self> {
        let bytes = input::read(path)?;
        let file: Self = serde_json::from_slice(&bytes).map_err(|source| {
            let problem = json_problem(&bytes, &source);
            problem.context(format_args!("{} is not a stroke file", path.display())).with_path(path)
        })?;
        let version = file.version;
        let sentence =
            || format!("this program replays stroke files of version 1; the file has version {version}");
        if version != 1 {
            return Err(Error::unsupported(sentence()));
        }
        file.strokes.iter().try_for_each(|stroke| check_named(stroke, path))?;
        Ok(file)
    }
}

/// Applies all strokes of a file, one step of the history each. Commits what was there before where the file
/// adds channels, or its strokes read the surface (see [`StrokeFile::commits_between`]). `folder`: what paths in the file are relative to.
///
/// # Errors
/// A stroke is wrong or mentions what is not there: then nothing is painted. Or painting fails.
pub fn replay(painter: &mut Painter, file: &StrokeFile, folder: &Path) -> Result<ReplaySummary> {
    let mut summary = ReplaySummary::default();
    let kinds: Vec<ChannelKind> = file.add_channels.iter().map(|kind| kind.0).collect();
    painter.add_channels(&kinds)?;
    // All are checked before the first one is applied.
    let mut prepared = Vec::with_capacity(file.strokes.len());
    let (mut known, pictures) = (HashSet::new(), RefCell::default());
    for (index, settings) in file.strokes.iter().enumerate() {
        let preparation = Preparation { painter, stroke: index, settings, folder, pictures: &pictures };
        preparation.check_channels()?;
        let stroke = preparation.run(&mut summary.missed_samples)?;
        summary.missing_characters.extend(stroke.missing.chars().filter(|&c| known.insert(c)));
        prepared.push((settings, stroke));
    }
    // Those that are used last go with their strokes.
    drop(pictures);
    for (index, (settings, prepared)) in prepared.into_iter().enumerate() {
        if settings.unrecorded {
            summary.unrecorded += 1;
            continue;
        }
        let paints = settings.set_layers.is_none() && !settings.channels.is_empty();
        let StrokeSummary { dabs, pages, .. } = apply(painter, index, settings, prepared, folder)?;
        if paints && pages == 0 {
            summary.untouching.push((index, settings.label.clone()));
        }
        summary.strokes += 1;
        summary.dabs += dabs;
        summary.pages += pages;
    }
    Ok(summary)
}

/// `index`: of the stroke, for messages.
fn apply(
    painter: &mut Painter,
    index: usize,
    settings: &StrokeSettings,
    prepared: Prepared,
    folder: &Path,
) -> Result<StrokeSummary> {
    if let Some(layers) = &settings.set_layers {
        painter
            .set_layers(&settings.label, layers.clone(), &settings.layer_moves)
            .map_err(|error| error.context(format!("stroke {index}")))?;
        return Ok(StrokeSummary::default());
    }
    let Prepared { paint, stroke, decals, dabs, fill, .. } = prepared;
    let target = target_of(painter, settings, fill)?;
    if paint.channels.is_empty() {
        return Ok(StrokeSummary::default());
    }
    let surface = Arc::clone(painter.surface());
    let area = area_of(&surface, settings, &paint, &stroke);
    painter.begin_on(target, &settings.label, paint)?;
    painter.record(settings.clone(), folder)?;
    if let Some(area) = area {
        return painter.fill(area);
    }
    if !decals.is_empty() {
        decals.iter().try_for_each(|decal| painter.decal(decal))?;
    } else if settings.decal.is_none() && settings.text.is_none() {
        painter.dab(&dabs)?;
        painter.dab(&dabs_of(&surface, &stroke))?;
    }
    painter.end()
}

fn area_of(surface: &Surface, settings: &StrokeSettings, paint: &Paint, stroke: &Stroke) -> Option<FillArea> {
    let start = stroke.samples.first().map(|sample| sample.point);
    FillArea::of(surface, settings.fill?, paint, start, &stroke.symmetry)
}

/// What a stroke fills, and with what; none where it fills nothing.
pub(crate) fn prepare_fill(
    painter: &Painter,
    settings: &StrokeSettings,
    folder: &Path,
) -> Result<Option<(Paint, FillArea)>> {
    let pictures = RefCell::default();
    let prepared = Preparation { painter, stroke: 0, settings, folder, pictures: &pictures }.run(&mut 0)?;
    let area = area_of(painter.surface(), settings, &prepared.paint, &prepared.stroke);
    Ok(area.map(|area| (prepared.paint, area)))
}

/// The layer that a stroke names; made where there is none.
fn target_of(painter: &mut Painter, settings: &StrokeSettings, fill: Option<GraphFill>) -> Result<Target> {
    let Some(named) = &settings.layer else { return Ok(Target::Base) };
    let LayerSettings { name, id, mask, .. } = named;
    let target = |id| if *mask { Target::Mask(id) } else { Target::Layer(id) };
    let known = painter.layers().iter().filter(|layer| layer.name == *name);
    let known: Vec<u64> = known.map(Layer::id).collect();
    if let Some(&first) = known.iter().find(|known| Some(**known) == *id).or(known.first()) {
        if let Some(fill) = fill {
            // The graph has changed: the layer is evaluated anew.
            painter.edit_layers(&settings.label, |layers| {
                let changed = layers.iter_mut().filter(|layer| layer.id() == first);
                changed.for_each(|layer| layer.content = LayerContent::Graph(fill.clone()));
            })?;
        }
        if *mask {
            // Without a mask the layer shows everywhere.
            painter.edit_layers(&settings.label, |layers| {
                let masked = layers.iter_mut().filter(|layer| layer.id() == first);
                masked.for_each(|layer| layer.mask = layer.mask.or(Some(1.0)));
            })?;
        }
        return Ok(target(first));
    }
    let place = match &named.within {
        Some(group) => LayerPlace::Into(group_of_name(painter, group)?),
        None => LayerPlace::Top,
    };
    let number = painter.start_add_layer(new_layer(named, fill), place)?;
    painter.finish_work()?;
    Ok(target(number))
}

/// The layer that is made where there is none of the name.
fn new_layer(named: &LayerSettings, fill: Option<GraphFill>) -> Layer {
    let name = &named.name;
    let mut layer = match (named.group, fill) {
        (Some(kind), _) => Layer::group(name, kind),
        (None, Some(fill)) => Layer::graph(name, fill),
        (None, None) => Layer::painted(name),
    };
    (layer.blend, layer.opacity) = (named.blend, named.opacity);
    layer.mask = named.fill.as_ref().and_then(|filled| filled.outside);
    if named.mask {
        layer.mask = layer.mask.or(Some(0.0));
    }
    layer
}

/// The number of a group; made where there is none of the name.
fn group_of_name(painter: &mut Painter, name: &str) -> Result<u64> {
    let mut known = painter.layers().iter().filter(|layer| layer.name == name);
    if let Some(group) = known.clone().find(|layer| layer.group_kind().is_some()) {
        return Ok(group.id());
    }
    if known.next().is_some() {
        let sentence = format!("a layer is to be made within {name:?}, which is a layer and no group");
        return Err(Error::invalid(sentence));
    }
    painter.add_layer(Layer::group(name, GroupKind::PassThrough))
}

// A stroke on its way from settings to what the painter takes.

pub(crate) struct Preparation<'a> {
    pub(crate) painter: &'a Painter,
    pub(crate) stroke: usize,
    pub(crate) settings: &'a StrokeSettings,
    pub(crate) folder: &'a Path,
    pub(crate) pictures: &'a RefCell<Pictures>,
}

/// Pictures that strokes of one folder mention, each read once.
#[derive(Debug, Default)]
pub(crate) struct Pictures {
    pictures: BTreeMap<(PathBuf, PictureUse), Arc<Picture>>,
    stamps: BTreeMap<PathBuf, Arc<Stamp>>,
}

/// What of a picture counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum PictureUse {
    /// Its colours.
    Color,
    /// Its numbers as they are, where they are of fixed point.
    Numbers,
    /// Where it covers.
    Shape,
}

impl PictureUse {
    /// In a channel.
    pub(crate) fn of_kind(kind: ChannelKind) -> Self {
        match kind {
            ChannelKind::BaseColor | ChannelKind::Emission | ChannelKind::Light => Self::Color,
            _ => Self::Numbers,
        }
    }
}

pub(crate) struct Prepared {
    pub(crate) paint: Paint,
    pub(crate) stroke: Stroke,
    pub(crate) decals: Vec<Decal>,
    pub(crate) dabs: Vec<Dab>,
    /// Of the layer that it makes or changes.
    pub(crate) fill: Option<GraphFill>,
    /// Characters that the font of its text lacks.
    missing: String,
}

impl Preparation<'_> {
    pub(crate) fn run(&self, missed: &mut usize) -> Result<Prepared> {
        self.settings.check().map_err(|error| self.of_stroke(error))?;
        let stroke = self.stroke(missed)?;
        let dabs = self.dabs(stroke.stamp.as_ref())?;
        let first = stroke.samples.first().map(|sample| sample.point).or(dabs.first().map(|dab| dab.center));
        let paint = self.paint(&stroke, first)?;
        let mut missing = String::new();
        let decals = self.decals(&stroke, &mut missing)?;
        let layer = self.settings.layer.as_ref();
        if layer.is_some_and(|layer| layer.fill.is_some() && layer.group.is_some()) {
            let sentence =
                "the layer has both `fill` and `group`: a group shows what lies in it and no textures";
            return Err(self.of_stroke(Error::invalid(sentence)));
        }
        let fill = layer.and_then(|layer| layer.fill.as_ref());
        let fill = fill.map(|fill| self.fill_layer(fill)).transpose()?;
        Ok(Prepared { paint, stroke, decals, dabs, fill, missing })
    }

    /// Refuses to paint into no channel. What only makes or changes layers needs none.
    fn check_channels(&self) -> Result<()> {
        let StrokeSettings { channels, samples, dabs, fill, decal, text, tool, .. } = self.settings;
        let is_without =
            self.settings.set_layers.is_none() && !self.settings.unrecorded && channels.is_empty();
        let has_places = !samples.is_empty() || !dabs.is_empty();
        let has_shape = fill.is_some() || decal.is_some() || text.is_some();
        if is_without && (has_places || has_shape || *tool != ToolSettings::default()) {
            return Err(Error::invalid(format!(
                "stroke {} names no channel, so nothing would be painted: give `channels`, as [{{\"kind\": \"base_color\"}}]",
                self.stroke
            )));
        }
        Ok(())
    }

    /// Names the stroke in an error.
    pub(crate) fn of_stroke(&self, error: Error) -> Error {
        error.context(format!("stroke {}", self.stroke))
    }

    fn channel(&self, kind: ChannelKind) -> Result<usize> {
        let channel = self.painter.editor().asset().channel_of_kind(kind);
        channel.ok_or_else(|| {
            let (name, option) = names_of(kind);
            let remedy = match option {
                Some(option) => format!(
                    "add it with \"add_channels\": [\"{name}\"] in the stroke file or with --add-channel {option}"
                ),
                None => "only a bake makes it".to_owned(),
            };
            let sentence = format!("paints the channel {name}, which the asset does not have: {remedy}");
            Error::not_found(format!("stroke {} {sentence}", self.stroke))
        })
    }

    fn paint(&self, drawn: &Stroke, first: Option<SurfacePoint>) -> Result<Paint> {
        let mut channels: Vec<ChannelPaint> = Vec::new();
        for settings in &self.settings.channels {
            let kind = settings.kind;
            let channel = self.channel(kind)?;
            if channels.iter().any(|painted| painted.channel == channel) {
                let (name, _) = names_of(kind);
                return Err(Error::invalid(format!("stroke {} names the channel {name} twice", self.stroke)));
            }
            let color = color_of(self, kind, &settings.color)?;
            channels.push(ChannelPaint { channel, color, components: settings.components });
        }
        let (stencil, sight) = (self.stencil()?, self.sight()?);
        let tool = self.tool(drawn, first)?;
        Ok(Paint { tool, opacity: self.settings.brush.opacity, channels, stencil, sight })
    }

    /// `first`: where the stroke begins.
    fn tool(&self, drawn: &Stroke, first: Option<SurfacePoint>) -> Result<Tool> {
        Ok(match self.settings.tool {
            ToolSettings::Paint(mode) => Tool::Paint(mode),
            ToolSettings::Erase => Tool::Erase,
            ToolSettings::Opacity(to) => {
                self.finite("an opacity", &[to])?;
                Tool::Opacity { to: to.clamp(0.0, 1.0) }
            }
            ToolSettings::Blur { radius } => {
                let (Size::Texels(length) | Size::World(length)) = radius;
                if length < 0.0 {
                    let sentence = format!("`tool.blur.radius` is {length}, but must be at least 0");
                    return Err(self.of_stroke(Error::malformed(sentence)));
                }
                Tool::Blur { radius: self.mesh_length(radius)? }
            }
            ToolSettings::Smudge { strength } => {
                self.finite("the strength of a smudge", &[strength])?;
                Tool::Smudge { strength }
            }
            ToolSettings::Clone { from } => {
                let surface = self.painter.surface();
                let source = surface.mesh().world_from_mesh.inverse_point(DVec3::from(from));
                let start = first.map_or(source, |point| surface.position(point).as_vec3());
                self.finite("the source of a clone", &source.to_array())?;
                self.mesh_length(drawn.brush.size)?;
                Tool::clone_of(surface, source, start, drawn.brush.size, drawn.symmetry)
            }
        })
    }

    fn image(&self, path: &Path) -> Result<Image> {
        let image = Image::load(self.folder.join(path));
        image.map_err(|source| self.of_stroke(malformed(source)))
    }

    pub(crate) fn picture(&self, path: &Path, used: PictureUse) -> Result<Arc<Picture>> {
        let key = (path.to_owned(), used);
        if let Some(known) = self.pictures.borrow().pictures.get(&key) {
            return Ok(Arc::clone(known));
        }
        let image = self.image(path)?;
        let picture = Arc::new(match used {
            PictureUse::Shape => Picture::shape(&image)?,
            PictureUse::Numbers if !matches!(image.samples, Samples::F32(_)) => {
                Picture::new(&Image { space: ColorSpace::Linear, ..image })?
            }
            PictureUse::Color | PictureUse::Numbers => Picture::new(&image)?,
        });
        self.pictures.borrow_mut().pictures.insert(key, Arc::clone(&picture));
        Ok(picture)
    }

    fn stamp(&self, path: &Path) -> Result<Arc<Stamp>> {
        if let Some(known) = self.pictures.borrow().stamps.get(path) {
            return Ok(Arc::clone(known));
        }
        let stamp = Arc::new(Stamp::new(&self.image(path)?)?);
        self.pictures.borrow_mut().stamps.insert(path.to_owned(), Arc::clone(&stamp));
        Ok(stamp)
    }

    pub(crate) fn graph(&self, look: &LookSettings) -> Result<TextureGraph> {
        let absolute = |folder: PathBuf| std::path::absolute(&folder).unwrap_or(folder);
        match look {
            LookSettings::File(path) => {
                let path = self.folder.join(path);
                let text = input::read_text(&path)?;
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                Ok(TextureGraph { look: text, folder: absolute(folder) })
            }
            LookSettings::Inline { text, folder } => {
                Ok(TextureGraph { look: text.clone(), folder: absolute(self.folder.join(folder)) })
            }
        }
    }

    fn fill_layer(&self, settings: &FillLayerSettings) -> Result<GraphFill> {
        let graph = self.graph(&settings.look)?;
        let mut textures = vec![None; self.painter.editor().asset().channels().len()];
        for texture in &settings.textures {
            let made = graph.texture(self.painter.surface(), &texture.texture);
            made.map_err(|error| self.of_stroke(error))?;
            textures[self.channel(texture.kind)?] = Some(texture.texture.clone());
        }
        Ok(GraphFill { graph, textures })
    }

    pub(crate) fn projection(&self, picture: Arc<Picture>) -> Result<Option<Projection>> {
        let Some(settings) = self.settings.projection else { return Ok(None) };
        let projection = Projection::new(self.painter.surface(), &settings, picture);
        projection.map(Some).ok_or_else(|| {
            self.of_stroke(Error::invalid(
                "the camera of the projection must look somewhere, with its upright direction beside that, through a \
                 lens of more than 0 and less than 180 degrees, or of more than 0 units",
            ))
        })
    }

    fn stencil(&self) -> Result<Option<Arc<Projection>>> {
        let Some(settings) = &self.settings.stencil else { return Ok(None) };
        let used = match settings.by {
            StencilBy::Shape => PictureUse::Shape,
            StencilBy::Alpha => PictureUse::Color,
        };
        let projection = self.projection(self.picture(&settings.image, used)?)?;
        projection.map(|p| Some(Arc::new(p))).ok_or_else(|| {
            Error::invalid(format!(
                "stroke {} has a stencil, but no camera: add a projection, which says from where the stencil is seen",
                self.stroke
            ))
        })
    }

    fn sight(&self) -> Result<Option<Arc<Sight>>> {
        let Some(degrees) = self.settings.only_seen else { return Ok(None) };
        let Some(camera) = &self.settings.projection else {
            return Err(self.of_stroke(Error::invalid(
                "only what is seen is painted, but there is no camera: add a projection, which says from where",
            )));
        };
        let sight = Sight::new(self.painter.surface(), camera, degrees, &self.settings.symmetry);
        sight.map(|sight| Some(Arc::new(sight))).ok_or_else(|| {
            self.of_stroke(Error::invalid(
                "only_seen must be above 0 and at most 90 degrees, and the camera of the projection look somewhere",
            ))
        })
    }

    /// `missing`: gets the characters that the font of a text lacks.
    fn decals(&self, drawn: &Stroke, missing: &mut String) -> Result<Vec<Decal>> {
        let (shape, size, angle, mirrored) = if let Some(decal) = &self.settings.decal {
            let shape = self.decal_shape(decal.shape.as_deref())?;
            (shape, self.mesh_length(decal.size)?, decal.angle, decal.mirrored)
        } else if let Some(text) = &self.settings.text {
            let font = text.font.as_ref().map(|path| input::read(&self.folder.join(path)));
            let font = font.transpose()?;
            let drawn = draw_text(&text.text, font.as_deref().unwrap_or(DEFAULT_FONT));
            let drawn = drawn.map_err(|error| self.of_stroke(error))?;
            *missing = drawn.missing;
            (Arc::new(drawn.picture), self.mesh_length(text.size)? * drawn.lines, text.angle, text.mirrored)
        } else {
            return Ok(Vec::new());
        };
        self.finite("the size and angle of a decal", &[size, angle])?;
        let surface = self.painter.surface();
        let angle = angle.to_radians();
        let readable = self.settings.text.is_some();
        let decals = drawn.samples.iter().flat_map(|sample| {
            let (center, shape) = (sample.point, Arc::clone(&shape));
            let decal = Decal { center, size, angle, shape, mirrored, copy: 0 };
            decal.copies(surface, &drawn.symmetry, readable)
        });
        Ok(decals.collect())
    }

    fn decal_shape(&self, path: Option<&Path>) -> Result<Arc<Picture>> {
        if let Some(path) = path {
            return self.picture(path, PictureUse::Shape);
        }
        let colors = self.settings.channels.iter().map(|channel| &channel.color);
        let image = colors.filter_map(|color| match color {
            ColorSettings::Image(path) => Some(path),
            _ => None,
        });
        let first = image.into_iter().next().ok_or_else(|| {
            Error::invalid(format!(
                "stroke {} lays a decal, but names no picture: give it a shape, or an image as colour",
                self.stroke
            ))
        })?;
        self.picture(first, PictureUse::Color)
    }

    fn dabs(&self, stamp: Option<&Arc<Stamp>>) -> Result<Vec<Dab>> {
        let scale = self.painter.surface().mesh().world_from_mesh.scale;
        let mut dabs = Vec::with_capacity(self.settings.dabs.len());
        for (index, dab) in self.settings.dabs.iter().enumerate() {
            let DabSettings { at, radius, hardness, flow, angle, mirrored, aspect, across_gaps, copy } = *dab;
            self.finite("a dab's numbers", &[radius, hardness, flow, angle, aspect])?;
            let radius = (f64::from(radius) / scale) as f32;
            let stamp = stamp.cloned();
            if let Some(center) = self.point(format_args!("dab {index}"), at)? {
                dabs.push(Dab {
                    center,
                    radius,
                    hardness,
                    flow,
                    angle,
                    mirrored,
                    aspect,
                    across_gaps,
                    stamp,
                    copy,
                });
            }
        }
        Ok(dabs)
    }

    fn mesh_length(&self, size: Size) -> Result<f32> {
        let length = mesh_length(self.painter.surface(), size);
        self.finite("a length", &[length]).map(|()| length.max(0.0))
    }

    pub(crate) fn finite(&self, what: &'static str, numbers: &[f32]) -> Result<()> {
        let all = numbers.iter().all(|x| x.is_finite());
        if all { Ok(()) } else { Err(self.of_stroke(Error::invalid(format!("{what} must be finite")))) }
    }

    fn share(&self, what: &'static str, number: f32) -> Result<()> {
        match (0.0..=1.0).contains(&number) {
            true => Ok(()),
            false => {
                Err(self.of_stroke(Error::invalid(format!("{what} is {number}; it must be from 0 to 1"))))
            }
        }
    }

    fn stroke(&self, missed: &mut usize) -> Result<Stroke> {
        let brush = self.brush()?;
        let stamp = match (&brush.stamp, brush.tip) {
            (Some(path), _) => Some(self.stamp(path)?),
            (None, tip) => tip.map(Stamp::of_tip).transpose()?.map(Arc::new),
        };
        let mut samples = Vec::with_capacity(self.settings.samples.len());
        for (index, sample) in self.settings.samples.iter().enumerate() {
            self.finite("a sample's pressure and tilt", &[sample.pressure, sample.tilt[0], sample.tilt[1]])?;
            let SampleSettings { at, pressure, tilt, time } = *sample;
            match self.point(format_args!("sample {index}"), at)? {
                Some(point) => samples.push(Sample { point, pressure, tilt, time }),
                None => *missed += 1,
            }
        }
        let StrokeSettings { line, symmetry, .. } = *self.settings;
        Ok(Stroke { brush, stamp, samples, line, symmetry })
    }

    fn brush(&self) -> Result<Brush> {
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
        self.share("the brush's hardness", settings.hardness)?;
        self.share("the brush's opacity", settings.opacity)?;
        self.share("the brush's flow", settings.flow)?;
        let positive = |x: f32| x.is_finite() && x > 0.0;
        if !positive(size) || !positive(settings.spacing) {
            return Err(self.of_stroke(Error::invalid("the brush's size and spacing must be above 0")));
        }
        let is_smudge = matches!(self.settings.tool, ToolSettings::Smudge { .. });
        let max_spacing = if is_smudge { SMUDGE_SPACING } else { f32::INFINITY };
        Ok(Brush { spacing: settings.spacing.min(max_spacing), ..settings.clone() })
    }

    /// None where a ray meets nothing. `what` has the place.
    fn point(&self, what: fmt::Arguments<'_>, place: Where) -> Result<Option<SurfacePoint>> {
        match (place, place_on(self.painter.surface(), place)) {
            (Where::Ray { direction, .. }, None) if DVec3::from(direction).try_normalize().is_some() => {
                Ok(None)
            }
            (_, None) => {
                let place = in_words(place, self.painter.surface().mesh().triangles.len());
                let sentence =
                    format!("{what} of stroke {} is no point of the surface: {place}", self.stroke);
                Err(Error::invalid(sentence))
            }
            (_, point) => Ok(point),
        }
    }
}

/// Why a place is not on a surface of so many triangles.
fn in_words(place: Where, triangles: usize) -> String {
    match place {
        Where::Position(position) => format!("no triangle is near the position {}", listed(&position)),
        Where::Surface { position, normal } => {
            format!("no triangle near the position {} faces along {}", listed(&position), listed(&normal))
        }
        Where::Ray { direction, .. } => {
            format!("the direction of its ray, {}, has no length", listed(&direction))
        }
        Where::Point { triangle, .. } if triangle as usize >= triangles => {
            format!("it names triangle {triangle}, but the mesh has {triangles}, counted from 0")
        }
        Where::Point { triangle, lambda } => format!(
            "its barycentric coordinates in triangle {triangle}, {}, must be at least 0 and add up to 1",
            listed(&lambda)
        ),
    }
}

fn listed<T: fmt::Display>(numbers: &[T]) -> String {
    numbers.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
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
