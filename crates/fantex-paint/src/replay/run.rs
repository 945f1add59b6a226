//! Applying a stroke file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_store::ChannelKind;
use fantex_texture::{LoadImageError, UnknownSolid};

use super::file::{LayerSettings, StrokeFile, StrokeSettings, Where};
use super::prepare::{Preparation, Prepared};
use crate::{
    FillArea, GraphError, GraphFill, Layer, LayerContent, Paint, PaintError, Painter, Stroke, StrokeSummary,
    Surface, Target, TextError, dabs_of,
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
    /// A texture of a look that cannot be made.
    #[error("stroke {stroke}: {source}")]
    Graph {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Why.
        source: Box<GraphError>,
    },
    /// A text that cannot be drawn.
    #[error("stroke {stroke}: {source}")]
    Text {
        /// Number of the stroke, from 0.
        stroke: usize,
        /// Why.
        source: TextError,
    },
    /// A decal without a picture.
    #[error("stroke {stroke} lays a decal, but names no picture: give it a shape, or an image as colour")]
    NoPicture {
        /// Number of the stroke, from 0.
        stroke: usize,
    },
    /// A projection whose camera sees nothing.
    #[error(
        "stroke {stroke}: the camera of the projection must look somewhere, with its upright direction beside that, \
         through a lens of more than 0 and less than 180 degrees, or of more than 0 units"
    )]
    Camera {
        /// Number of the stroke, from 0.
        stroke: usize,
    },
    /// A stencil without a camera.
    #[error(
        "stroke {stroke} has a stencil, but no camera: add a projection, which says from where the stencil is seen"
    )]
    NoCamera {
        /// Number of the stroke, from 0.
        stroke: usize,
    },
    /// A picture that cannot be loaded.
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
    /// Strokes of a log that could not be recorded and so are missing.
    pub unrecorded: usize,
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

/// Applies all strokes of a file, one step of the history each. Commits nothing. `folder`: what paths in the file are relative
/// to.
pub fn replay(painter: &mut Painter, file: &StrokeFile, folder: &Path) -> Result<ReplaySummary, ReplayError> {
    let mut summary = ReplaySummary::default();
    // All are checked before the first one is applied.
    let mut prepared = Vec::with_capacity(file.strokes.len());
    for (index, settings) in file.strokes.iter().enumerate() {
        let preparation = Preparation { painter, stroke: index, settings, folder };
        prepared.push((settings, preparation.run(&mut summary.missed_samples)?));
    }
    for (settings, prepared) in prepared {
        if settings.unrecorded {
            summary.unrecorded += 1;
            continue;
        }
        let StrokeSummary { dabs, pages, .. } = apply(painter, settings, prepared, folder)?;
        summary.strokes += 1;
        summary.dabs += dabs;
        summary.pages += pages;
    }
    Ok(summary)
}

fn apply(
    painter: &mut Painter,
    settings: &StrokeSettings,
    prepared: Prepared,
    folder: &Path,
) -> Result<StrokeSummary, PaintError> {
    if let Some(layers) = &settings.set_layers {
        painter.set_layers(&settings.label, layers.clone())?;
        return Ok(StrokeSummary::default());
    }
    let Prepared { paint, stroke, decals, dabs, fill } = prepared;
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
) -> Result<Option<(Paint, FillArea)>, ReplayError> {
    let prepared = Preparation { painter, stroke: 0, settings, folder }.run(&mut 0)?;
    let area = area_of(painter.surface(), settings, &prepared.paint, &prepared.stroke);
    Ok(area.map(|area| (prepared.paint, area)))
}

/// The layer that a stroke names; made where there is none.
fn target_of(
    painter: &mut Painter,
    settings: &StrokeSettings,
    fill: Option<GraphFill>,
) -> Result<Target, PaintError> {
    let Some(LayerSettings { name, blend, opacity, id, mask, fill: filled }) = &settings.layer else {
        return Ok(Target::Base);
    };
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
        return Ok(target(first));
    }
    let mut layer = fill.map_or_else(|| Layer::painted(name), |fill| Layer::graph(name, fill));
    (layer.blend, layer.opacity) = (*blend, *opacity);
    layer.mask = filled.as_ref().and_then(|filled| filled.outside);
    if *mask {
        layer.mask = layer.mask.or(Some(0.0));
    }
    Ok(target(painter.add_layer(layer)?))
}
