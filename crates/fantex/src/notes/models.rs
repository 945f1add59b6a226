//! Sentences on models that were written.

use std::path::Path;

use fantex_base::{grouped, percent};
use fantex_export::ExportSummary;
use fantex_store::ChannelKind;

use super::counted;

/// Where fewer of the texels of an own packing lie on the surface, its pieces are narrow.
const NARROW_SHARE: f64 = 0.1;

/// How a model came about, which tells what to do about what it lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelKind {
    /// From an asset.
    Exported {
        /// With tiles of fans instead of an atlas.
        fans: bool,
        /// The padding that was asked for.
        padding: Option<u32>,
    },
    /// From a source.
    Baked {
        /// The side of the pictures that was asked for instead of a number of texels.
        side: Option<u32>,
    },
}

/// What is to be known of a model, or of pictures, at `output` beside [damage](crate::stand_in_note): what they lack, a sentence each, with
/// options of the command line.
pub fn model_notes(output: &Path, summary: &ExportSummary, kind: ModelKind) -> Vec<String> {
    let mut notes = Vec::new();
    notes.extend(density_note(summary, kind));
    notes.extend(narrow_note(summary, kind));
    notes.extend(overlap_note(summary));
    notes.extend(points_note(summary));
    notes.extend(summary.cut_off.iter().map(|(map, largest)| {
        format!("{} of up to {largest:.3} is cut off at 1 in PNG; .exr and .ktx2 hold it", map.name())
    }));
    notes.extend(summary.left_out.iter().filter_map(|&channel| left_out_note(channel, kind)));
    notes.extend(padding_note(summary, kind));
    notes.iter().map(|note| format!("{}: {note}", output.display())).collect()
}

/// Of pictures that hold less than the density.
fn density_note(summary: &ExportSummary, kind: ModelKind) -> Option<String> {
    let is_low = summary.density_share < 0.9;
    if !is_low || matches!(kind, ModelKind::Baked { side: Some(_) }) {
        return None;
    }
    let percent = 100.0 * summary.density_share;
    let side = summary.sizes.as_flattened().iter().max().copied().unwrap_or(0);
    let rest = match kind {
        ModelKind::Exported { .. } => "the asset's density; give a larger --size for all of it",
        ModelKind::Baked { .. } => "the density that was asked for; an asset (.fan) holds all of it",
    };
    Some(format!("{side} texels a side hold {percent:.0} % of {rest}"))
}

/// Of charts that leave most of the texels unused.
fn narrow_note(summary: &ExportSummary, kind: ModelKind) -> Option<String> {
    let is_narrow = summary.charts > 0 && summary.used_share < NARROW_SHARE;
    if !is_narrow || matches!(kind, ModelKind::Exported { fans: true, .. }) {
        return None;
    }
    let option = match kind {
        ModelKind::Baked { side: None } => "fewer --texels",
        _ => "a smaller --size",
    };
    Some(format!(
        "{} % of the texels lie on the surface: its pieces ({}) are long and narrow, and what lies between them takes the rest; give {option} \
         if that is too much",
        percent(summary.used_share),
        grouped(summary.charts as u64, ' ')
    ))
}

fn overlap_note(summary: &ExportSummary) -> Option<String> {
    let percent = 100.0 * summary.overlapping_share;
    let how = match summary.charts {
        0 => "without '--uv source' every triangle has texels of its own",
        _ => "pieces overlap themselves there",
    };
    (summary.overlapping_share > 1e-3).then(|| {
        format!("{percent:.1} % of the used texels are claimed by several triangles, and one of these shows there; {how}")
    })
}

/// Of triangles that are points in the picture.
fn points_note(summary: &ExportSummary) -> Option<String> {
    let triangles = counted(summary.points as u64, "triangle");
    (summary.points > 0).then(|| match summary.charts {
        0 => format!(
            "{triangles} without area in the model's texture coordinates, each in one colour; without '--uv source' every triangle has texels \
             of its own"
        ),
        _ => format!("{triangles} too small to have an area in the picture, each in one colour"),
    })
}

/// Of a channel for which the model's format has no place.
fn left_out_note(channel: ChannelKind, kind: ModelKind) -> Option<String> {
    let (name, option) = match channel {
        ChannelKind::Displacement => ("heights", "displacement"),
        ChannelKind::Light => ("light map", "light"),
        ChannelKind::Anisotropy => return Some("stretched highlights are left out".to_owned()),
        _ => return None,
    };
    Some(match kind {
        ModelKind::Exported { fans: true, .. } => {
            format!(
                "there is no sheet of the {name}; --channel {option} writes them in the layout of an atlas"
            )
        }
        ModelKind::Exported { .. } => {
            format!("glTF has no place for the {name}; write them with --channel {option}")
        }
        ModelKind::Baked { .. } => {
            format!(
                "glTF has no place for the {name}; bake an asset, and export them with --channel {option}"
            )
        }
    })
}

/// Of charts that lie closer together than was asked for.
fn padding_note(summary: &ExportSummary, kind: ModelKind) -> Option<String> {
    let ModelKind::Exported { padding: Some(asked), .. } = kind else { return None };
    let given = counted(u64::from(summary.padding), "texel");
    (summary.charts > 0 && summary.padding < asked).then(|| {
        format!("a padding of {given} instead of the {asked} asked for: it is at most a quarter of the side; give a larger --size for more")
    })
}
