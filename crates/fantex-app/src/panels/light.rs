//! The page about light: sun, surroundings, background, tone.

use std::path::Path;

use eframe::egui::{ComboBox, Spinner, Ui};

use super::widgets::{NumberRow, choice, heading, hint, row};
use crate::command::Command;
use crate::display::{DisplaySettings, ToneChoice};
use crate::light::{BackgroundChoice, LightSettings, Surroundings};
use crate::viewer::Viewer;

const DEGREES: NumberRow<'static> = NumberRow { suffix: "°", decimals: 0, ..NumberRow::PLAIN };

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    heading(ui, "Sun");
    sun(ui, &mut viewer.settings.light);
    hint(ui, "Ctrl + drag in the scene turns the sun.");
    heading(ui, "Surroundings");
    let is_making = viewer.is_making_surroundings();
    let mut wants_file = false;
    surroundings(ui, &mut viewer.settings.light, is_making, &mut wants_file);
    heading(ui, "Background");
    background(ui, &mut viewer.settings.light);
    heading(ui, "Tone");
    tone(ui, &mut viewer.settings.display);
    ui.add_space(8.0);
    if ui.button("As at first").on_hover_text("Light and tone as they are at the first start").clicked() {
        viewer.settings.light = LightSettings::default();
        let usual = DisplaySettings::default();
        viewer.settings.display.exposure_stops = usual.exposure_stops;
        viewer.settings.display.tone = usual.tone;
    }
    if wants_file {
        viewer.command(Command::ChooseSurroundings, seconds);
    }
}

fn sun(ui: &mut Ui, light: &mut LightSettings) {
    row(ui, "Shines", |ui| ui.checkbox(&mut light.has_sun, ""));
    ui.add_enabled_ui(light.has_sun, |ui| {
        row(ui, "Shadows", |ui| ui.checkbox(&mut light.has_shadows, "").on_hover_text("X"));
        DEGREES.named("Direction").show(ui, &mut light.sun_azimuth, 0.0..=360.0);
        DEGREES.named("Height").show(ui, &mut light.sun_elevation, -90.0..=90.0);
        NumberRow::PLAIN.named("Strength").show(ui, &mut light.sun_strength, 0.0..=4.0);
    });
}

fn surroundings(ui: &mut Ui, light: &mut LightSettings, is_making: bool, wants_file: &mut bool) {
    row(ui, "From", |ui| {
        let list =
            ComboBox::from_id_salt("surroundings").width(150.0).selected_text(name(&light.surroundings));
        let list = list.show_ui(ui, |ui| {
            for one in [Surroundings::Studio, Surroundings::Sky] {
                let text = name(&one);
                ui.selectable_value(&mut light.surroundings, one, text);
            }
            if let file @ Surroundings::File(_) = &light.surroundings
                && ui.selectable_label(true, name(file)).clicked()
            {
                ui.close();
            }
            if ui.button("Picture…").clicked() {
                *wants_file = true;
                ui.close();
            }
        });
        if is_making {
            ui.add(Spinner::new().size(14.0));
        }
        list.response
    });
    NumberRow::PLAIN.named("Strength").show(ui, &mut light.surroundings_strength, 0.0..=4.0);
    ui.add_enabled_ui(light.surroundings != Surroundings::Studio, |ui| {
        DEGREES.named("Turned by").show(ui, &mut light.surroundings_rotation, -180.0..=180.0);
    });
}

fn name(surroundings: &Surroundings) -> String {
    match surroundings {
        Surroundings::Studio => "Studio".into(),
        Surroundings::Sky => "Computed sky".into(),
        Surroundings::File(path) => file_name(path),
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned())
}

fn background(ui: &mut Ui, light: &mut LightSettings) {
    row(ui, "Shows", |ui| {
        choice(ui, "background", &mut light.background, &BackgroundChoice::ALL, |b| b.label().into())
    });
    ui.add_enabled_ui(light.background == BackgroundChoice::Surroundings, |ui| {
        NumberRow::PLAIN.named("Blur").show(ui, &mut light.background_blur, 0.0..=1.0);
    });
    if light.background == BackgroundChoice::Surroundings && light.surroundings == Surroundings::Studio {
        hint(ui, "The studio has no picture: choose a sky or a picture above.");
    }
}

fn tone(ui: &mut Ui, display: &mut DisplaySettings) {
    let [least, most] = DisplaySettings::EXPOSURES;
    NumberRow { name: "Exposure", suffix: " EV", tip: "[ and ]", ..NumberRow::PLAIN }.show(
        ui,
        &mut display.exposure_stops,
        least..=most,
    );
    row(ui, "Curve", |ui| choice(ui, "tone", &mut display.tone, &ToneChoice::ALL, |t| t.label().into()));
}
