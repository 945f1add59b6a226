//! Sentences on models that were written.

use std::path::Path;

use fantex_base::{grouped, percent};
use fantex_export::ExportSummary;
use fantex_store::ChannelKind;

use super::counted;

/// Where fewer of the texels of an own packing lie on the surface, its pieces are narrow.
const NARROW_SHARE: f64 = 0.05;

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
    let output = output.display();
    if summary.density_share < 0.9 && !matches!(kind, ModelKind::Baked { side: Some(_) }) {
        let percent = 100.0 * summary.density_share;
        let side = summary.sizes.as_flattened().iter().max().copied().unwrap_or(0);
        let held = format!("{output}: {side} texels a side hold {percent:.0} % of");
        notes.push(match kind {
            ModelKind::Exported { .. } => {
                format!("{held} the asset's density; give a larger --size for all of it")
            }
            ModelKind::Baked { .. } => {
                format!("{held} the density that was asked for; an asset (.fan) holds all of it")
            }
        });
    }
    let is_atlas = !matches!(kind, ModelKind::Exported { fans: true, .. });
    if summary.charts > 0 && summary.used_share < NARROW_SHARE && is_atlas {
        let option = match kind {
            ModelKind::Baked { side: None } => "fewer --texels",
            _ => "a smaller --size",
        };
        notes.push(format!(
            "{output}: {} % of the texels lie on the surface: its pieces ({}) are long and narrow, and what keeps them apart takes the rest; \
             give {option} if that is too much",
            percent(summary.used_share),
            grouped(summary.charts as u64, ' ')
        ));
    }
    if summary.overlapping_share > 1e-3 {
        let percent = 100.0 * summary.overlapping_share;
        let how = match summary.charts {
            0 => "without '--uv source' every triangle has texels of its own",
            _ => "pieces overlap themselves there",
        };
        notes.push(format!(
            "{output}: {percent:.1} % of the used texels are claimed by several triangles, and one of these shows there; {how}"
        ));
    }
    if summary.points > 0 {
        let triangles = counted(summary.points as u64, "triangle");
        notes.push(match summary.charts {
            0 => format!(
                "{output}: {triangles} without area in the model's texture coordinates, each in one colour; without '--uv source' every \
                 triangle has texels of its own"
            ),
            _ => format!("{output}: {triangles} too small to have an area in the picture, each in one colour"),
        });
    }
    for (map, largest) in &summary.cut_off {
        notes.push(format!(
            "{output}: {} of up to {largest:.3} is cut off at 1 in PNG; .exr and .ktx2 hold it",
            map.name()
        ));
    }
    for channel in &summary.left_out {
        let (name, option) = match channel {
            ChannelKind::Displacement => ("heights", "displacement"),
            ChannelKind::Light => ("light map", "light"),
            ChannelKind::Anisotropy => {
                notes.push(format!("{output}: stretched highlights are left out"));
                continue;
            }
            _ => continue,
        };
        notes.push(match kind {
            ModelKind::Exported { fans: true, .. } => {
                format!("{output}: there is no sheet of the {name}; --channel {option} writes them in the layout of an atlas")
            }
            ModelKind::Exported { .. } => {
                format!("{output}: glTF has no place for the {name}; write them with --channel {option}")
            }
            ModelKind::Baked { .. } => format!(
                "{output}: glTF has no place for the {name}; bake an asset, and export them with --channel {option}"
            ),
        });
    }
    if let ModelKind::Exported { padding: Some(asked), .. } = kind
        && summary.charts > 0
        && summary.padding < asked
    {
        notes.push(format!(
            "{output}: a padding of {} instead of the {asked} asked for: it is at most a quarter of the side; give a larger --size for more",
            counted(u64::from(summary.padding), "texel")
        ));
    }
    notes
}
