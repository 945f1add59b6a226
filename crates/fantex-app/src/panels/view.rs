//! The page about camera and picture.

use eframe::egui::{DragValue, Ui};

use super::widgets::{NumberRow, choice, facts, heading, hint, row};
use crate::camera::{CameraMode, FlyMotion, ViewPreset};
use crate::command::Command;
use crate::display::DisplaySettings;
use crate::document::short_number;
use crate::viewer::{Tape, Viewer};

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    let mut commands = Vec::new();
    heading(ui, "Camera");
    camera(ui, viewer);
    heading(ui, "Show all");
    ui.add_enabled_ui(viewer.document.is_some(), |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            for preset in ViewPreset::ALL {
                if ui.button(preset.label()).clicked() {
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
        viewer.command(command, seconds);
    }
}

fn camera(ui: &mut Ui, viewer: &mut Viewer) {
    let eye_height = viewer.eye_height();
    let camera = &mut viewer.settings.camera;
    let degrees = NumberRow { name: "Opening angle", suffix: "°", decimals: 0, ..NumberRow::PLAIN };
    degrees.show(ui, &mut camera.fov_degrees, 10.0..=120.0);
    let speed = NumberRow { name: "Speed", suffix: "×", is_logarithmic: true, ..NumberRow::PLAIN };
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
    let point = |p: glam::DVec3| p.to_array().map(short_number).join(", ");
    facts(ui, "camera facts", [("At", point(viewer.rig.eye)), ("Looks at", point(viewer.rig.pivot()))]);
}

fn path(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let is_recording = matches!(viewer.tape, Tape::Recording { .. });
    let is_playing = matches!(viewer.tape, Tape::Playing { .. });
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
        Some(path) => hint(ui, &format!("{:.1} s, {} keys", path.seconds(), path.keys.len())),
        None => hint(ui, "Record the camera's way with R, play it with P."),
    }
}

fn picture(ui: &mut Ui, display: &mut DisplaySettings) {
    row(ui, "Anisotropy", |ui| {
        choice(ui, "anisotropy", &mut display.anisotropy, &DisplaySettings::ANISOTROPIES, |n| match n {
            1 => "Off (trilinear)".into(),
            n => format!("{n}×"),
        })
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
