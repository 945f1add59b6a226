//! The inspector: pages about the model, its cover, streaming, light and view.

use std::path::Path;

use eframe::egui::{ComboBox, DragValue, RichText, ScrollArea, Spinner, Ui};

use crate::camera::{CameraMode, FlyMotion, ViewPreset};
use crate::command::Command;
use crate::display::{DisplaySettings, Overlay, TONE_MAPS};
use crate::light::{BackgroundChoice, LightSettings, Surroundings};
use crate::panels::streaming;
use crate::panels::widgets::{choice, document_facts, facts, heading, hint, number, row, segments};
use crate::settings::{Tab, label_of};
use crate::text::short_number;
use crate::theme;
use crate::viewer::{PathState, Viewer};

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    ui.horizontal(|ui| segments(ui, &mut viewer.settings.panels.tab, &Tab::ALL));
    ui.separator();
    let tab = viewer.settings.panels.tab;
    ScrollArea::vertical().id_salt(label_of(&Tab::ALL, tab)).auto_shrink([false, false]).show(ui, |ui| {
        match tab {
            Tab::Model => show_model(ui, viewer),
            Tab::Cover => show_cover(ui, viewer),
            Tab::Streaming => streaming::show(ui, viewer),
            Tab::Light => show_light(ui, viewer),
            Tab::View => show_view(ui, viewer),
        }
    });
}

fn show_model(ui: &mut Ui, viewer: &Viewer) {
    let Some(document) = &viewer.document else {
        return hint(ui, "Open a model or an asset to see what it is made of.");
    };
    heading(ui, &document.place.name());
    ui.label(RichText::new(document.place.to_string()).small().color(theme::FAINT));
    ui.add_space(4.0);
    document_facts(ui, "model facts", &document.model_facts);
    heading(ui, "Report");
    if document.notes.is_empty() {
        hint(
            ui,
            match document.is_streamed() {
                true => "An asset holds a cleaned mesh: there is nothing to report.",
                false => "The mesh is clean: nothing was dropped, welded or turned.",
            },
        );
    }
    for note in &document.notes {
        ui.horizontal_top(|ui| {
            ui.label(RichText::new("•").color(theme::FAINT));
            ui.add(eframe::egui::Label::new(note).wrap());
        });
    }
}

fn show_cover(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(document) = &viewer.document else {
        return hint(ui, "Open an asset to see how partial fans cover it.");
    };
    if document.is_streamed() && document.asset().is_none() {
        return hint(
            ui,
            "A world has many assets, each with a cover of its own. Open one of them to see it.",
        );
    }
    if document.asset().is_none() {
        return hint(
            ui,
            "A model has its own texture coordinates and no cover. 'fantex bake' makes an asset of it.",
        );
    }
    heading(ui, "Cover");
    document_facts(ui, "cover facts", &document.cover_facts);
    heading(ui, "Channels");
    facts(ui, "channels", document.channels.iter().map(|channel| (channel.kind, channel.format.clone())));
    heading(ui, "Overlay");
    let overlay = &mut viewer.settings.display.overlay;
    row(ui, "Shows", |ui| choice(ui, "overlay of the cover", overlay, &Overlay::ALL));
    hint(ui, overlay.meaning());
}

fn show_light(ui: &mut Ui, viewer: &mut Viewer) {
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
    if ui.button("Reset").on_hover_text("Light and tone as they are at the first start").clicked() {
        viewer.settings.light = LightSettings::default();
        let usual = DisplaySettings::default();
        viewer.settings.display.exposure_stops = usual.exposure_stops;
        viewer.settings.display.tone = usual.tone;
    }
    if wants_file {
        viewer.command(Command::ChooseSurroundings);
    }
}

fn sun(ui: &mut Ui, light: &mut LightSettings) {
    row(ui, "Shines", |ui| ui.checkbox(&mut light.has_sun, ""));
    ui.add_enabled_ui(light.has_sun, |ui| {
        row(ui, "Shadows", |ui| ui.checkbox(&mut light.has_shadows, "").on_hover_text("X"));
        number("Direction", "°", 0, "").show(ui, &mut light.sun_azimuth, 0.0..=360.0);
        number("Height", "°", 0, "").show(ui, &mut light.sun_elevation, -90.0..=90.0);
        number("Strength", "", 2, "").show(ui, &mut light.sun_strength, 0.0..=4.0);
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
    number("Strength", "", 2, "").show(ui, &mut light.surroundings_strength, 0.0..=4.0);
    ui.add_enabled_ui(light.surroundings != Surroundings::Studio, |ui| {
        number("Turned by", "°", 0, "").show(ui, &mut light.surroundings_rotation, -180.0..=180.0);
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
    row(ui, "Shows", |ui| choice(ui, "background", &mut light.background, &BackgroundChoice::ALL));
    ui.add_enabled_ui(light.background == BackgroundChoice::Surroundings, |ui| {
        number("Blur", "", 2, "").show(ui, &mut light.background_blur, 0.0..=1.0);
    });
    if light.background == BackgroundChoice::Surroundings && light.surroundings == Surroundings::Studio {
        hint(ui, "The studio has no picture: choose a sky or a picture above.");
    }
}

fn tone(ui: &mut Ui, display: &mut DisplaySettings) {
    let [least, most] = DisplaySettings::EXPOSURES;
    let exposure = number("Exposure", " EV", 2, "[ and ]");
    exposure.show(ui, &mut display.exposure_stops, least..=most);
    row(ui, "Curve", |ui| choice(ui, "tone", &mut display.tone, &TONE_MAPS));
}

fn show_view(ui: &mut Ui, viewer: &mut Viewer) {
    let mut commands = Vec::new();
    heading(ui, "Camera");
    camera(ui, viewer);
    heading(ui, "Show all");
    ui.add_enabled_ui(viewer.document.is_some(), |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            for (preset, label) in ViewPreset::ALL {
                if ui.button(label).clicked() {
                    commands.push(Command::View(preset));
                }
            }
        });
    });
    heading(ui, "Camera path");
    path(ui, viewer, &mut commands);
    heading(ui, "Picture");
    picture(ui, &mut viewer.settings.display);
    for command in commands {
        viewer.command(command);
    }
}

fn camera(ui: &mut Ui, viewer: &mut Viewer) {
    let eye_height = viewer.eye_height();
    let camera = &mut viewer.settings.camera;
    let degrees = number("Field of view", "°", 0, "");
    degrees.show(ui, &mut camera.fov_degrees, 10.0..=120.0);
    let speed = number("Speed", "×", 2, "").logarithmic();
    match camera.mode {
        CameraMode::Orbit => {}
        CameraMode::Fly => {
            let [least, most] = FlyMotion::SPEEDS;
            speed.show(ui, &mut camera.fly_speed, least..=most);
        }
        CameraMode::Walk => {
            speed.show(ui, &mut camera.walk_speed, 0.1..=20.0);
            row(ui, "Eye height", |ui| {
                let mut height = eye_height;
                let value = DragValue::new(&mut height).range(1e-9..=1e9).speed(eye_height * 0.01);
                let response = ui.add(value).on_hover_text("World units");
                if response.changed() {
                    camera.eye_height = Some(height);
                }
                if camera.eye_height.is_some() && ui.small_button("by the model").clicked() {
                    camera.eye_height = None;
                }
                response
            });
        }
    }
    let point = |p: fantex::glam::DVec3| p.to_array().map(short_number).join(", ");
    facts(ui, "camera facts", [("At", point(viewer.rig.eye)), ("Looks at", point(viewer.rig.pivot()))]);
}

fn path(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let is_recording = matches!(viewer.path_state, PathState::Recording { .. });
    let is_playing = matches!(viewer.path_state, PathState::Playing { .. });
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let mut button = |ui: &mut Ui, is_enabled: bool, text: &str, command: Command| {
            if ui.add_enabled(is_enabled, eframe::egui::Button::new(text)).clicked() {
                commands.push(command);
            }
        };
        let has_document = viewer.document.is_some();
        button(
            ui,
            has_document,
            if is_recording { "End recording" } else { "Record" },
            Command::ToggleRecording,
        );
        button(ui, viewer.path.is_some(), if is_playing { "Stop" } else { "Play" }, Command::TogglePlayback);
        button(ui, true, "Load…", Command::LoadPath);
        button(ui, viewer.path.is_some(), "Save…", Command::SavePath);
    });
    match &viewer.path {
        Some(path) => hint(ui, &format!("{:.1} s, {} keys", path.duration_seconds(), path.keyframes.len())),
        None => hint(ui, "Record the camera's way with R, play it with P."),
    }
}

fn picture(ui: &mut Ui, display: &mut DisplaySettings) {
    row(ui, "Anisotropy", |ui| {
        choice(ui, "anisotropy", &mut display.anisotropy, &DisplaySettings::ANISOTROPIES)
    });
    row(ui, "Smooth edges", |ui| {
        let mut is_smooth = display.samples > 1;
        let response = ui.checkbox(&mut is_smooth, "4 samples");
        if response.changed() {
            display.samples = if is_smooth { 4 } else { 1 };
        }
        response
    });
    row(ui, "While moving", |ui| {
        ui.checkbox(&mut display.is_adaptive, "smaller if slow")
            .on_hover_text("Pictures are smaller while the camera moves and frames would take long")
    });
}
