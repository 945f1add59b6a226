//! The line below everything: what is open, what the camera does, how drawing goes.

use eframe::egui::{Align, Color32, Label, Layout, RichText, Ui};

use crate::camera::CameraMode;
use crate::document::bytes_text;
use crate::theme;
use crate::viewer::{Tape, Viewer};

/// Widths in points from which on the adapter is told, and the time of a frame.
const WIDTHS: [f32; 2] = [900.0, 640.0];

/// There is nothing to walk on.
const BESIDE_GROUND: &str = "No ground below the camera: orbit or fly until it is above the model";

/// The pen went down beside the model.
const MISSED: &str = "Beside the model: nothing is painted, dragging turns the view";

pub(super) fn show(ui: &mut Ui, viewer: &Viewer, seconds: f64) {
    let width = ui.available_width();
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            figures(ui, viewer, width);
            // What is left of the line, in the order in which it is read; the hint is cut where that is too little.
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let name = viewer
                    .document
                    .as_ref()
                    .map_or("Nothing is open".into(), |document| document.place.name());
                ui.add(Label::new(RichText::new(name).color(theme::TEXT)).truncate());
                if let Some((text, color)) = tape(viewer, seconds) {
                    ui.separator();
                    ui.label(RichText::new(text).color(color));
                }
                ui.separator();
                let (text, color) = hint(ui, viewer, seconds);
                ui.add(Label::new(RichText::new(text).color(color)).truncate());
            });
        });
    });
}

/// What the hand can do, or why what it did has done nothing.
fn hint(ui: &Ui, viewer: &Viewer, seconds: f64) -> (&'static str, Color32) {
    if let Some(left) = viewer.painting.as_ref().and_then(|painting| painting.missed_for(seconds)) {
        ui.ctx().request_repaint_after_secs(left as f32);
        return (MISSED, theme::WARNING);
    }
    if viewer.is_beside_ground() {
        return (BESIDE_GROUND, theme::WARNING);
    }
    (gesture(viewer), theme::FAINT)
}

fn gesture(viewer: &Viewer) -> &'static str {
    if viewer.painting.is_some() {
        return viewer.settings.paint.tool.hint();
    }
    if viewer.is_waiting_for_ground() {
        return "Preparing the ground to walk on …";
    }
    match viewer.settings.camera.mode {
        CameraMode::Orbit => "Drag turns, right drag shifts, wheel zooms",
        CameraMode::Fly => "W A S D and E Q fly, drag looks, wheel changes the speed",
        CameraMode::Walk => "W A S D walk, drag looks, Shift runs",
    }
}

fn tape(viewer: &Viewer, seconds: f64) -> Option<(String, Color32)> {
    match &viewer.tape {
        Tape::Still => None,
        Tape::Recording { since, .. } => Some((format!("Recording {:.1} s", seconds - since), theme::ERROR)),
        Tape::Playing { since } => {
            let length = viewer.path.as_ref().map_or(0.0, |path| path.seconds());
            Some((format!("Playing {:.1} of {length:.1} s", (seconds - since).min(length)), theme::GOOD))
        }
    }
}

/// From the right: in a narrow window, less of them.
fn figures(ui: &mut Ui, viewer: &Viewer, width: f32) {
    if !viewer.adapter.is_empty() && width >= WIDTHS[0] {
        ui.label(RichText::new(&viewer.adapter).color(theme::FAINT));
        ui.separator();
    }
    let has_asset = viewer.document.as_ref().is_some_and(|document| document.asset().is_some());
    if let Some(ms) = viewer.graphs.frame_ms.last().filter(|_| width >= WIDTHS[1]) {
        ui.label(format!("{ms:.1} ms"));
        if has_asset {
            ui.separator();
        }
    }
    if has_asset {
        let figures = &viewer.figures;
        ui.label(format!(
            "{} of {}",
            bytes_text(figures.used_bytes as f64),
            bytes_text(figures.pool_bytes as f64)
        ));
        ui.separator();
        let (text, color) = if !viewer.settings.streaming.is_running {
            ("Held".to_owned(), theme::WARNING)
        } else if figures.is_sharp() {
            ("Sharp".to_owned(), theme::GOOD)
        } else {
            (format!("{} parcels to come", figures.missing), theme::WARNING)
        };
        ui.label(RichText::new(text).color(color));
    }
}
