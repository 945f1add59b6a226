//! The bar above everything: menus, camera mode, what is shown.

use eframe::egui::{Align, Button, Layout, RichText, Ui};

use super::widgets::{named_choice, segments, switch};
use crate::camera::{CameraMode, ViewPreset};
use crate::command::{Command, keys_of};
use crate::display::{Overlay, ShadingView};
use crate::light_presets::LightPreset;
use crate::paint::PaintCommand;
use crate::theme;
use crate::viewer::Viewer;

/// A window of a painter that is narrower shows less in the bar.
const WIDE_POINTS: f32 = 1250.0;

/// Room for a choice and the switches after it.
const CHOICE_POINTS: f32 = 330.0;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    let mut commands = Vec::new();
    ui.horizontal(|ui| {
        ui.label(RichText::new("fantex").color(theme::STRONG).size(15.0));
        ui.add_space(4.0);
        menus(ui, viewer, &mut commands);
        ui.separator();
        let is_painting = viewer.painting.is_some();
        let mut paints = viewer.paints;
        ui.scope(|ui| {
            let label = |paints: bool| if paints { "Paint" } else { "Look" };
            if segments(ui, &mut paints, &[false, true], label) {
                commands.push(Command::TogglePainting);
            }
        });
        ui.separator();
        if is_painting {
            undo(ui, viewer, &mut commands);
            ui.separator();
        } else {
            let mut mode = viewer.settings.camera.mode;
            ui.scope(|ui| {
                if segments(ui, &mut mode, &CameraMode::ALL, CameraMode::label) {
                    commands.push(Command::Mode(mode));
                }
            });
            ui.separator();
        }
        choices(ui, viewer, &mut commands);
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| switches(ui, viewer, &mut commands));
    });
    for command in commands {
        viewer.command(command, seconds);
    }
}

/// One step back, one step forth.
fn undo(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let Some(painting) = &viewer.painting else { return };
    let snapshot = painting.snapshot();
    let has_done = !snapshot.done.is_empty() || snapshot.older > 0;
    let rows =
        [(has_done, "Undo", PaintCommand::Undo), (!snapshot.undone.is_empty(), "Redo", PaintCommand::Redo)];
    for (is_enabled, text, command) in rows {
        let command = Command::Paint(command);
        let tip = keys_of(&command).unwrap_or_default();
        if ui.add_enabled(is_enabled, Button::new(text)).on_hover_text(tip).clicked() {
            commands.push(command);
        }
    }
    let light = &viewer.settings.light;
    ui.menu_button("Light", |ui| {
        ui.set_min_width(150.0);
        for preset in LightPreset::ALL {
            if ui.selectable_label(preset.is_in(light), preset.label()).clicked() {
                commands.push(Command::Light(preset));
                ui.close();
            }
        }
    });
}

fn menus(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let has_document = viewer.document.is_some();
    ui.menu_button("File", |ui| {
        ui.set_min_width(220.0);
        item(ui, true, "Open…", Command::OpenDialog, commands);
        ui.add_enabled_ui(!viewer.settings.recent.is_empty(), |ui| {
            ui.menu_button("Open recent", |ui| {
                ui.set_min_width(260.0);
                for place in &viewer.settings.recent {
                    if ui.button(short_place(place)).on_hover_text(place).clicked() {
                        commands.push(Command::Open(place.clone()));
                        ui.close();
                    }
                }
            });
        });
        item(ui, has_document, "Open again", Command::Reload, commands);
        item(ui, has_document, "Close", Command::Close, commands);
        ui.separator();
        item(ui, has_document, "Save picture", Command::Screenshot, commands);
        item(ui, has_document, "Save large picture", Command::LargeScreenshot(4), commands);
        item(ui, true, "Save picture of the window", Command::WindowScreenshot, commands);
        ui.separator();
        item(ui, true, "Quit", Command::Quit, commands);
    });
    ui.menu_button("View", |ui| {
        ui.set_min_width(220.0);
        item(ui, has_document, "Show all", Command::FrameAll, commands);
        for preset in ViewPreset::ALL {
            item(ui, has_document, preset.label(), Command::View(preset), commands);
        }
        ui.separator();
        item(ui, has_document, "Record camera path", Command::ToggleRecording, commands);
        item(ui, viewer.path.is_some(), "Play camera path", Command::TogglePlayback, commands);
        item(ui, true, "Load camera path…", Command::LoadPath, commands);
        item(ui, viewer.path.is_some(), "Save camera path…", Command::SavePath, commands);
        ui.separator();
        item(ui, true, "Keys and mouse", Command::ToggleHelp, commands);
    });
}

/// A line of a menu with its key.
fn item(ui: &mut Ui, is_enabled: bool, text: &str, command: Command, commands: &mut Vec<Command>) {
    let keys = keys_of(&command).unwrap_or_default();
    let button = Button::new(text).shortcut_text(RichText::new(keys).color(theme::FAINT));
    if ui.add_enabled(is_enabled, button).clicked() {
        commands.push(command);
        ui.close();
    }
}

fn choices(ui: &mut Ui, viewer: &mut Viewer, commands: &mut Vec<Command>) {
    let is_asset = viewer.document.as_ref().is_some_and(|document| document.asset().is_some());
    let display = &mut viewer.settings.display;
    if ui.available_width() < CHOICE_POINTS {
        return;
    }
    // What looks into the engine is left out where painting needs the room.
    let is_narrow = viewer.painting.is_some() && ui.ctx().content_rect().width() < WIDE_POINTS;
    named_choice(ui, "Shading", &mut display.shading, &ShadingView::ALL, |s| s.label().into());
    if is_narrow {
        return;
    }
    ui.add_enabled_ui(is_asset, |ui| {
        named_choice(ui, "Overlay", &mut display.overlay, &Overlay::ALL, |o| o.label().into());
    });
    if switch(ui, display.has_wireframe, "Wireframe", "Lines along all edges (Z)") {
        commands.push(Command::ToggleWireframe);
    }
}

/// From the right.
fn switches(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let panels = viewer.settings.panels;
    ui.spacing_mut().item_spacing.x = 4.0;
    let settings = &viewer.settings.paint;
    let side = match viewer.painting {
        None => (
            panels.has_inspector,
            "Inspector",
            "What the model is and how it is shown (I)",
            Command::ToggleInspector,
        ),
        Some(_) => (
            settings.has_brush_panel || settings.has_layer_panel,
            "Panels",
            "Brush, colours, layers (Tab)",
            Command::Paint(PaintCommand::TogglePanels),
        ),
    };
    let rows: [(bool, &str, &str, Command); 4] = [
        (viewer.has_help, "?", "Keys and mouse (F1)", Command::ToggleHelp),
        side,
        (panels.has_graphs, "Graphs", "Frame time, pool, queue, bandwidth (G)", Command::ToggleGraphs),
        (panels.has_atlas, "Atlas", "The live atlas beside the scene (M)", Command::ToggleAtlas),
    ];
    let is_narrow = viewer.painting.is_some() && ui.ctx().content_rect().width() < WIDE_POINTS;
    let count = if is_narrow { 2 } else { rows.len() };
    for (is_on, text, tip, command) in rows.into_iter().take(count) {
        if switch(ui, is_on, text, tip) {
            commands.push(command);
        }
    }
}

/// The end of a long place.
pub(super) fn short_place(place: &str) -> String {
    const LONGEST: usize = 48;
    let count = place.chars().count();
    if count <= LONGEST {
        return place.to_owned();
    }
    let end: String = place.chars().skip(count - LONGEST + 1).collect();
    format!("…{end}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_places_keep_their_end() {
        let place = format!("/home/{}/bunny.fan", "deep/".repeat(30));
        let short = short_place(&place);
        assert!(short.ends_with("bunny.fan") && short.chars().count() == 48);
        assert_eq!(short_place("a.glb"), "a.glb");
    }
}
