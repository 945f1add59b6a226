//! Sentences on what was found in assets, and on models that were written.

#[cfg(feature = "export")]
mod models;

use std::fmt::Display;
use std::path::Path;

use fantex_base::{Error, grouped, numbered};
use fantex_cover::{Cover, CoverStats, MIN_EXTENT};
use fantex_store::{Damage, JUMP_BOUND, VerifyReport};

#[cfg(feature = "export")]
pub use models::{ModelKind, model_notes};

/// So many of the smallest tiles, with such a share of the texels, are worth a note.
const MANY_SMALLEST: u64 = 500;
const MUCH_IN_SMALLEST: f64 = 0.1;

/// What is to be known of a cover whose tiles are so small that the least that a tile has is much of the texels; none of one fan per tile,
/// where small tiles are what was asked for.
pub fn smallest_tiles_note(cover: &Cover, stats: &CoverStats) -> Option<String> {
    let side = MIN_EXTENT;
    let smallest = cover.groups.iter().filter(|group| group.extent == [side; 2]).count() as u64;
    let share = (u64::from(side * side) * smallest) as f64 / stats.texels as f64;
    let is_much = smallest >= MANY_SMALLEST && share > MUCH_IN_SMALLEST && stats.groups < stats.fans.total;
    is_much.then(|| {
        let tiles = counted(smallest, "tile");
        format!(
            "{:.0} % of the texels are in {tiles} of {side} x {side}, the least that a tile has: more texels, or a model without \
             pieces and details of that size, would be sharper",
            100.0 * share
        )
    })
}

/// What is to be known of an asset in which texels could not be read; none where all could.
pub fn damage_note(place: &Path, damage: &Damage) -> Option<String> {
    let (_, page, reason) = damage.first.first()?;
    Some(stand_in_note(place, damage.pages, format_args!("{page}: {reason}")))
}

/// What is to be known of an asset, or of a world, so many tiles of which could not be read; `first` is the first of them, and why.
pub fn stand_in_note(place: &Path, tiles: u64, first: impl Display) -> String {
    let tiles = counted(tiles, "damaged tile");
    format!("{}: coarser texels stand in for {tiles}; the first: {first}", place.display())
}

/// Why an asset did not pass.
pub fn not_verified(place: &Path, report: &VerifyReport) -> Error {
    let jump = report.continuity.largest_jump;
    let first = report.first_damage.first().map_or("", String::as_str);
    let reason = if report.damaged_tiles > 0 {
        format!("it has {}; the first: {first}", counted(report.damaged_tiles, "damaged tile"))
    } else if let Some(fault) = report.mesh_faults.first() {
        format!("its mesh breaks a rule of the format: {fault}")
    } else if report.damaged_headers > 0 {
        "one of its two headers is damaged; the other one still opens it".to_owned()
    } else if report.damaged_attachments > 0 {
        // Also where there is too little memory for them, or a server does not answer.
        let attachments = counted(report.damaged_attachments, "attachment");
        format!("{attachments} (layers, history) cannot be read; its texels are sound; the first: {first}")
    } else if report.continuity.needless_splits > 0 {
        let edges = counted(report.continuity.needless_splits, "edge");
        format!(
            "at {edges} the two triangles name different groups, so the texture may jump there; bake it again"
        )
    } else if jump > JUMP_BOUND {
        format!("its texture jumps by {jump:.1e} across an edge, more than the bound of {JUMP_BOUND:.0e}")
    } else {
        let texels = report.texels.as_ref();
        let count = texels.map_or(0, |texels| texels.contradictions + texels.empty_blocks);
        let first = texels.and_then(|texels| texels.first.first()).map_or("", String::as_str);
        format!("its detail levels contradict each other at {}; the first: {first}", counted(count, "texel"))
    };
    Error::damaged(format!("{} did not pass: {reason}", place.display()))
}

/// `69 451 tiles`.
pub(crate) fn counted(number: u64, noun: &str) -> String {
    format!("{} {}", grouped(number, ' '), numbered(number, noun))
}
