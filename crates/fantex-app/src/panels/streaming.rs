//! The page about streaming: what is resident, what is coming, what is damaged.

use eframe::egui::{DragValue, Grid, RichText, Ui};

use super::widgets::{NumberRow, dot, facts, gauge, heading, hint, row};
use crate::document::{bytes_text, grouped};
use crate::figures::{DamagedPart, StreamFigures};
use crate::settings::StreamingSettings;
use crate::theme;
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    heading(ui, "Pool");
    settings(ui, &mut viewer.settings.streaming);
    if viewer.document.as_ref().is_none_or(|document| document.asset().is_none()) {
        return hint(ui, "Only assets (.fan) are streamed; a model lies whole in the graphics memory.");
    }
    show_figures(ui, &viewer.figures);
}

/// What streaming tells of an asset.
pub(super) fn show_figures(ui: &mut Ui, figures: &StreamFigures) {
    gauge(ui, figures.occupancy(), theme::ACCENT).on_hover_text("Share of the pool that holds tiles");
    let [width, height, layers] = figures.atlas;
    facts(
        ui,
        "pool facts",
        [
            (
                "In use",
                format!(
                    "{} of {}",
                    bytes_text(figures.used_bytes as f64),
                    bytes_text(figures.pool_bytes as f64)
                ),
            ),
            ("Atlas", format!("{width} × {height} texels, {layers} layers")),
        ],
    );
    heading(ui, "Now");
    facts(
        ui,
        "stream facts",
        [
            ("Wanted parcels there", format!("{:.1} %", figures.hit_rate() * 100.0)),
            ("To come", grouped(figures.missing)),
            ("Being read", grouped(figures.queue)),
            ("Level bias", format!("{:.2}", figures.bias)),
            (
                "Uploaded",
                format!(
                    "{} parcels, {}",
                    grouped(figures.uploaded_parcels),
                    bytes_text(figures.uploaded_bytes as f64)
                ),
            ),
            ("Evicted", format!("{} parcels", grouped(figures.evicted_parcels))),
        ],
    );
    heading(ui, "Resident per level");
    levels(ui, figures);
    heading(ui, "Damaged");
    damage(ui, figures);
}

fn settings(ui: &mut Ui, streaming: &mut StreamingSettings) {
    let [least, most] = StreamingSettings::POOL_MIB;
    let size = NumberRow {
        name: "Size",
        suffix: " MiB",
        decimals: 0,
        is_logarithmic: true,
        tip: "Graphics memory for texels; nothing beyond it is taken",
    };
    size.show(ui, &mut streaming.pool_mib, least..=most);
    let [least, most] = StreamingSettings::UPLOAD_KIB;
    row(ui, "Per frame", |ui| {
        let value = DragValue::new(&mut streaming.upload_kib).range(least..=most).speed(64).suffix(" KiB");
        ui.add(value).on_hover_text("Most texels that go to the graphics memory in one frame")
    });
    row(ui, "Loading", |ui| {
        ui.checkbox(&mut streaming.is_running, "on").on_hover_text("Off: what is there stays (L)")
    });
}

fn levels(ui: &mut Ui, figures: &StreamFigures) {
    if figures.levels.is_empty() {
        return hint(ui, "Nothing has been wanted yet.");
    }
    Grid::new("levels").num_columns(3).spacing([10.0, 4.0]).show(ui, |ui| {
        for (level, now) in figures.levels.iter().enumerate() {
            ui.horizontal(|ui| {
                dot(ui, theme::level_color(level));
                ui.label(level.to_string());
            });
            let share = if now.texels == 0 { 0.0 } else { now.resident as f32 / now.texels as f32 };
            ui.scope(|ui| {
                ui.set_width(110.0);
                gauge(ui, share, theme::level_color(level));
            });
            ui.label(format!("{:.1} % of {}", 100.0 * share, texels_text(now.texels)));
            ui.end_row();
        }
    });
}

/// `12.3 M texels`.
fn texels_text(texels: u64) -> String {
    let units = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match units.into_iter().find(|(size, _)| texels as f64 >= *size) {
        Some((size, unit)) => format!("{:.1} {unit} texels", texels as f64 / size),
        None => format!("{texels} texels"),
    }
}

fn damage(ui: &mut Ui, figures: &StreamFigures) {
    if figures.damaged_count == 0 {
        return hint(ui, "None: everything that was read was whole.");
    }
    let text = format!("{} could not be read; coarser levels stand in.", grouped(figures.damaged_count));
    ui.label(RichText::new(text).color(theme::WARNING));
    for DamagedPart { part, reason } in &figures.damaged {
        ui.label(RichText::new(part).color(theme::TEXT)).on_hover_text(reason);
    }
}
