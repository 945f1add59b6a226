//! The line below everything: what is open, what the camera does, how drawing goes.

use eframe::egui::{Align, Layout, RichText, Ui};

use crate::camera::CameraMode;
use crate::document::bytes_text;
use crate::theme;
use crate::viewer::{Tape, Viewer};

pub(super) fn show(ui: &mut Ui, viewer: &Viewer, seconds: f64) {
    ui.horizontal(|ui| {
        let name =
            viewer.document.as_ref().map_or("Nothing is open".into(), |document| document.place.name());
        ui.label(RichText::new(name).color(theme::TEXT));
        ui.separator();
        ui.label(RichText::new(gesture(viewer)).color(theme::FAINT));
        if let Some((text, color)) = tape(viewer, seconds) {
            ui.separator();
            ui.label(RichText::new(text).color(color));
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| figures(ui, viewer));
    });
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

fn tape(viewer: &Viewer, seconds: f64) -> Option<(String, eframe::egui::Color32)> {
    match &viewer.tape {
        Tape::Still => None,
        Tape::Recording { since, .. } => Some((format!("Recording {:.1} s", seconds - since), theme::ERROR)),
        Tape::Playing { since } => {
            let length = viewer.path.as_ref().map_or(0.0, |path| path.seconds());
            Some((format!("Playing {:.1} of {length:.1} s", (seconds - since).min(length)), theme::GOOD))
        }
    }
}

/// From the right.
fn figures(ui: &mut Ui, viewer: &Viewer) {
    if !viewer.adapter.is_empty() {
        ui.label(RichText::new(&viewer.adapter).color(theme::FAINT));
        ui.separator();
    }
    if let Some(ms) = viewer.graphs.frame_ms.last() {
        ui.label(format!("{ms:.1} ms"));
    }
    if viewer.document.as_ref().is_some_and(|document| document.asset().is_some()) {
        let figures = &viewer.figures;
        ui.separator();
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
