//! The bar above everything: menus, camera mode, what is shown.

use eframe::egui::{Align, Button, Color32, FontId, Label, Layout, RichText, TextStyle, Ui};
use fantex::base::counted;

use crate::camera::{CameraMode, ViewPreset};
use crate::command::{Command, keys_of};
use crate::display::{Overlay, ShadingView};
use crate::document::Document;
use crate::light::LightPreset;
use crate::paint::PaintCommand;
use crate::panels::widgets::{named_choice, segments, switch};
use crate::settings::label_of;
use crate::text::bytes_text;
use crate::theme;
use crate::viewer::{PathState, Viewer};

/// A part of the bar that goes into the menu *More* where there is no room for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Camera modes; while something is painted on undo, redo and light.
    Modes,
    /// Inspector, or the painter's panels.
    Side,
    Shading,
    Graphs,
    Atlas,
    Overlay,
    Wireframe,
}

/// The most needed first.
const PARTS: [Part; 7] =
    [Part::Modes, Part::Side, Part::Shading, Part::Graphs, Part::Atlas, Part::Overlay, Part::Wireframe];

const MORE: &str = "More";

/// What a separator takes, and what is left free, points.
const SEPARATOR: f32 = 14.0;
const SPARE: f32 = 24.0;

/// Of the name of the program.
const TITLE_SIZE: f32 = 15.0;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let mut commands = Vec::new();
    ui.horizontal(|ui| {
        let parts = fitting(ui, viewer);
        ui.label(RichText::new("fantex").color(theme::STRONG).size(TITLE_SIZE));
        ui.add_space(4.0);
        menus(ui, viewer, &mut commands);
        ui.separator();
        let mut paints = viewer.paints;
        ui.scope(|ui| {
            if segments(ui, &mut paints, &[(false, "Look"), (true, "Paint")]) {
                commands.push(Command::TogglePainting);
            }
        });
        ui.separator();
        if parts.contains(&Part::Modes) {
            if viewer.painting.is_some() {
                undo(ui, viewer, &mut commands);
            } else {
                let mut mode = viewer.settings.camera.mode;
                ui.scope(|ui| {
                    if segments(ui, &mut mode, &CameraMode::ALL) {
                        commands.push(Command::Mode(mode));
                    }
                });
            }
            ui.separator();
        }
        choices(ui, viewer, &parts, &mut commands);
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            switches(ui, viewer, &parts, &mut commands);
        });
    });
    for command in commands {
        viewer.command(command);
    }
}

/// The parts that there is room for.
fn fitting(ui: &Ui, viewer: &Viewer) -> Vec<Part> {
    let text = |text: &str, size: f32| {
        let font = FontId::proportional(size);
        ui.painter().layout_no_wrap(text.to_owned(), font, theme::TEXT).size().x
    };
    let size = TextStyle::Button.resolve(ui.style()).size;
    let (padding, gap) = (ui.spacing().button_padding.x, ui.spacing().item_spacing.x);
    let button = |label: &str| text(label, size) + 2.0 * padding + gap;
    let list = |name: &str, chosen: &str| {
        let inner = text(chosen, size) + ui.spacing().icon_width + 2.0 * padding + gap;
        text(name, size) + gap + inner.max(ui.spacing().combo_width) + gap
    };
    let sum = |labels: &[&str]| labels.iter().map(|label| button(label)).sum::<f32>();
    let display = &viewer.settings.display;
    let is_painting = viewer.painting.is_some();
    let width = |part: &Part| match part {
        Part::Modes if is_painting => sum(&["Undo", "Redo", "Light"]) + SEPARATOR,
        Part::Modes => sum(&CameraMode::ALL.map(|(_, label)| label)) + SEPARATOR,
        Part::Side if is_painting => button("Panels"),
        Part::Side => button("Inspector"),
        Part::Shading => list("Shading", label_of(&ShadingView::ALL, display.shading)),
        Part::Overlay => list("Overlay", label_of(&Overlay::ALL, display.overlay)),
        Part::Graphs => button("Graphs"),
        Part::Atlas => button("Atlas"),
        Part::Wireframe => button("Wireframe"),
    };
    let always = text("fantex", TITLE_SIZE) + 4.0 + gap + sum(&["File", "View", "Look", "Paint", "?"]);
    let room = ui.available_width() - always - 2.0 * SEPARATOR - SPARE;
    if PARTS.iter().map(width).sum::<f32>() <= room {
        return PARTS.to_vec();
    }
    let mut left = room - button(MORE);
    let fits = |part: &&Part| {
        left -= width(part);
        left >= 0.0
    };
    PARTS.iter().take_while(fits).copied().collect()
}

/// One step back, one step forth.
fn undo(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let Some(painting) = &viewer.painting else { return };
    let snapshot = &painting.snapshot;
    let has_done = !snapshot.done.is_empty() || snapshot.older > 0;
    let rows =
        [(has_done, "Undo", PaintCommand::Undo), (!snapshot.undone.is_empty(), "Redo", PaintCommand::Redo)];
    for (is_enabled, text, command) in rows {
        let command = Command::Paint(command);
        let tip = keys_of(true, &command).unwrap_or_default();
        if ui.add_enabled(is_enabled, Button::new(text)).on_hover_text(tip).clicked() {
            commands.push(command);
        }
    }
    let light = &viewer.settings.light;
    ui.menu_button("Light", |ui| {
        ui.set_min_width(150.0);
        for (preset, label) in LightPreset::ALL {
            if ui.selectable_label(preset.is_in(light), label).clicked() {
                commands.push(Command::Light(preset));
                ui.close();
            }
        }
    });
}

fn menus(ui: &mut Ui, viewer: &Viewer, commands: &mut Vec<Command>) {
    let has_document = viewer.document.is_some();
    let is_painting = viewer.painting.is_some();
    let has_scene = has_document || viewer.live.is_some();
    ui.menu_button("File", |ui| {
        ui.set_min_width(220.0);
        item(ui, (true, is_painting), "Open…", Command::OpenDialog, commands);
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
        item(ui, (has_document, is_painting), "Open again", Command::Reload, commands);
        item(ui, (has_scene, is_painting), "Close", Command::Close, commands);
        ui.separator();
        let is_asset = viewer.asset_path().is_some();
        item(ui, (is_asset, is_painting), "Save a copy…", Command::SaveCopy, commands);
        item(ui, (is_asset, is_painting), "Export…", Command::Export, commands);
        ui.separator();
        if let Some(live) = &viewer.live {
            item(ui, (live.is_changed(), is_painting), "Save the look", Command::Save, commands);
        }
        item(ui, (has_scene, is_painting), "Save picture", Command::Screenshot, commands);
        item(ui, (has_document, is_painting), "Save large picture", Command::LargeScreenshot(4), commands);
        item(ui, (true, is_painting), "Save picture of the window", Command::WindowScreenshot, commands);
        ui.separator();
        item(ui, (true, is_painting), "Quit", Command::Quit, commands);
    });
    ui.menu_button("View", |ui| {
        ui.set_min_width(220.0);
        item(ui, (has_scene, is_painting), "Show all", Command::FrameAll, commands);
        for (preset, label) in ViewPreset::ALL {
            item(ui, (has_document, is_painting), label, Command::View(preset), commands);
        }
        ui.separator();
        let text = if viewer.kept.is_some() { "Stop comparing" } else { "Keep picture to compare (A/B)" };
        item(ui, (has_document, is_painting), text, Command::Compare, commands);
        ui.separator();
        let panels = viewer.settings.panels;
        check(ui, panels.has_readout, "Tile and values under the pointer", Command::ToggleReadout, commands);
        check(ui, panels.has_gizmo, "Axes in the corner", Command::ToggleGizmo, commands);
        ui.separator();
        item(ui, (has_document, is_painting), "Record camera path", Command::ToggleRecording, commands);
        item(ui, (viewer.path.is_some(), is_painting), "Play camera path", Command::TogglePlayback, commands);
        item(ui, (true, is_painting), "Load camera path…", Command::LoadPath, commands);
        item(ui, (viewer.path.is_some(), is_painting), "Save camera path…", Command::SavePath, commands);
        ui.separator();
        item(ui, (true, is_painting), "Keys and mouse", Command::ToggleHelp, commands);
    });
}

/// A line of a menu with its key.
fn item(
    ui: &mut Ui,
    (is_enabled, is_painting): (bool, bool),
    text: &str,
    command: Command,
    commands: &mut Vec<Command>,
) {
    let keys = keys_of(is_painting, &command).unwrap_or_default();
    let button = Button::new(text).shortcut_text(RichText::new(keys).color(theme::FAINT));
    if ui.add_enabled(is_enabled, button).clicked() {
        commands.push(command);
        ui.close();
    }
}

/// A line of a menu that is on or off.
fn check(ui: &mut Ui, is_on: bool, text: &str, command: Command, commands: &mut Vec<Command>) {
    let mut is_on = is_on;
    if ui.checkbox(&mut is_on, text).clicked() {
        commands.push(command);
        ui.close();
    }
}

fn choices(ui: &mut Ui, viewer: &mut Viewer, parts: &[Part], commands: &mut Vec<Command>) {
    let is_streamed = viewer.document.as_ref().is_some_and(Document::is_streamed);
    let has_display = viewer.has_display();
    let display = &mut viewer.settings.display;
    if parts.contains(&Part::Shading) {
        ui.add_enabled_ui(has_display, |ui| {
            named_choice(ui, "Shading", &mut display.shading, &ShadingView::ALL);
        });
    }
    if parts.contains(&Part::Overlay) {
        ui.add_enabled_ui(is_streamed, |ui| {
            named_choice(ui, "Overlay", &mut display.overlay, &Overlay::ALL);
        });
    }
    if parts.contains(&Part::Wireframe) {
        ui.add_enabled_ui(has_display, |ui| {
            if switch(ui, display.has_wireframe, "Wireframe", "Lines along all edges (Z)") {
                commands.push(Command::ToggleWireframe);
            }
        });
    }
}

/// Switches of what lies beside the scene: whether it is there, name, tip and command.
fn sides(viewer: &Viewer) -> [(Part, bool, &'static str, &'static str, Command); 3] {
    let panels = viewer.settings.panels;
    let paint = &viewer.settings.paint;
    let side = match viewer.painting {
        None => {
            let tip = "What the model is and how it is shown (I)";
            (Part::Side, panels.has_inspector, "Inspector", tip, Command::ToggleInspector)
        }
        Some(_) => {
            let is_shown = paint.has_brush_panel || paint.has_layer_panel;
            let command = Command::Paint(PaintCommand::TogglePanels);
            (Part::Side, is_shown, "Panels", "Brush, colours, layers (Tab)", command)
        }
    };
    let graphs = "Frame time, pool, queue, bandwidth (G)";
    let atlas = "The live atlas beside the scene (M)";
    [
        side,
        (Part::Graphs, panels.has_graphs, "Graphs", graphs, Command::ToggleGraphs),
        (Part::Atlas, panels.has_atlas, "Atlas", atlas, Command::ToggleAtlas),
    ]
}

/// From the right.
fn switches(ui: &mut Ui, viewer: &mut Viewer, parts: &[Part], commands: &mut Vec<Command>) {
    ui.spacing_mut().item_spacing.x = 4.0;
    if switch(ui, viewer.has_help, "?", "Keys and mouse (F1)") {
        commands.push(Command::ToggleHelp);
    }
    for (part, is_on, text, tip, command) in sides(viewer) {
        if parts.contains(&part) && switch(ui, is_on, text, tip) {
            commands.push(command);
        }
    }
    if parts.len() < PARTS.len() {
        ui.menu_button(MORE, |ui| more(ui, viewer, parts, commands));
    }
}

/// What the bar has no room for.
fn more(ui: &mut Ui, viewer: &mut Viewer, parts: &[Part], commands: &mut Vec<Command>) {
    ui.set_min_width(170.0);
    let lacks = |part| !parts.contains(&part);
    if lacks(Part::Modes) {
        if viewer.painting.is_some() {
            undo(ui, viewer, commands);
        } else {
            for (mode, label) in CameraMode::ALL {
                if ui.selectable_label(viewer.settings.camera.mode == mode, label).clicked() {
                    commands.push(Command::Mode(mode));
                    ui.close();
                }
            }
        }
        ui.separator();
    }
    for (part, is_on, text, _, command) in sides(viewer) {
        if lacks(part) {
            check(ui, is_on, text, command, commands);
        }
    }
    let is_streamed = viewer.document.as_ref().is_some_and(Document::is_streamed);
    let has_display = viewer.has_display();
    let display = &mut viewer.settings.display;
    if lacks(Part::Shading) {
        ui.add_enabled_ui(has_display, |ui| {
            ui.menu_button("Shading", |ui| one_of(ui, &mut display.shading, &ShadingView::ALL));
        });
    }
    if lacks(Part::Overlay) {
        ui.add_enabled_ui(is_streamed, |ui| {
            ui.menu_button("Overlay", |ui| one_of(ui, &mut display.overlay, &Overlay::ALL));
        });
    }
    if lacks(Part::Wireframe) {
        ui.add_enabled_ui(has_display, |ui| {
            check(ui, display.has_wireframe, "Wireframe", Command::ToggleWireframe, commands);
        });
    }
}

/// A menu of which one line is chosen.
fn one_of<T: Copy + PartialEq>(ui: &mut Ui, value: &mut T, all: &[(T, &str)]) {
    for &(one, label) in all {
        if ui.selectable_value(value, one, label).clicked() {
            ui.close();
        }
    }
}

/// The end of a long place.
pub(super) fn short_place(place: &str) -> String {
    const MAX_CHARS: usize = 48;
    let count = place.chars().count();
    if count <= MAX_CHARS {
        return place.to_owned();
    }
    let end: String = place.chars().skip(count - MAX_CHARS + 1).collect();
    format!("…{end}")
}

/// Widths in points from which on the adapter is told, and the time of a frame.
const WIDTHS: [f32; 2] = [900.0, 640.0];

/// There is nothing to walk on.
const BESIDE_GROUND: &str = "No ground below the camera: orbit or fly until it is above the model";

/// The pen went down beside the model.
const MISSED: &str = "Beside the model: nothing is painted, dragging turns the view";
const MISSED_ALT: &str = "Beside the model: nothing is painted, Alt + drag turns the view";

pub(super) fn show_status(ui: &mut Ui, viewer: &Viewer) {
    let width = ui.available_width();
    ui.horizontal(|ui| {
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            figures(ui, viewer, width);
            // What is left of the line, in the order in which it is read; the hint is cut where that is too little.
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let name = viewer.shown_name().unwrap_or_else(|| "Nothing is open".into());
                ui.add(Label::new(RichText::new(name).color(theme::TEXT)).truncate());
                if let Some((text, color)) = path_state(viewer) {
                    ui.separator();
                    ui.label(RichText::new(text).color(color));
                }
                ui.separator();
                let (text, color) = hint(ui, viewer);
                ui.add(Label::new(RichText::new(text).color(color)).truncate());
            });
        });
    });
}

/// What the hand can do, or why what it did has done nothing.
fn hint(ui: &Ui, viewer: &Viewer) -> (&'static str, Color32) {
    if let Some(left) = viewer.painting.as_ref().and_then(|painting| painting.missed_for(viewer.now())) {
        ui.ctx().request_repaint_after_secs(left as f32);
        let is_alt = viewer.settings.paint.alt_turns && viewer.settings.paint.tool.has_brush();
        return (if is_alt { MISSED_ALT } else { MISSED }, theme::WARNING);
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
    match viewer.settings.camera.mode {
        CameraMode::Orbit => "Drag turns, right drag shifts, wheel zooms",
        CameraMode::Fly => "W A S D and E Q fly, drag looks, wheel changes the speed",
        CameraMode::Walk if viewer.is_preparing_ground() => "Preparing the ground to walk on …",
        CameraMode::Walk => "W A S D walk, drag looks, Shift runs",
    }
}

fn path_state(viewer: &Viewer) -> Option<(String, Color32)> {
    match &viewer.path_state {
        PathState::Still => None,
        PathState::Recording { since, .. } => {
            Some((format!("Recording {:.1} s", viewer.now() - since), theme::ERROR))
        }
        PathState::Playing { since } => {
            let length = viewer.path.as_ref().map_or(0.0, |path| path.duration_seconds());
            Some((format!("Playing {:.1} of {length:.1} s", (viewer.now() - since).min(length)), theme::GOOD))
        }
    }
}

/// From the right: in a narrow window, less of them.
fn figures(ui: &mut Ui, viewer: &Viewer, width: f32) {
    if !viewer.adapter.is_empty() && width >= WIDTHS[0] {
        ui.label(RichText::new(&viewer.adapter).color(theme::FAINT));
        ui.separator();
    }
    let is_streamed = viewer.document.as_ref().is_some_and(Document::is_streamed);
    if let Some(ms) = viewer.graphs.frame_ms.last().filter(|_| width >= WIDTHS[1]) {
        ui.label(format!("{ms:.1} ms"));
        if is_streamed {
            ui.separator();
        }
    }
    if is_streamed {
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
            let objects = figures.objects.as_ref().map_or(0, |objects| objects.missing);
            let text = match figures.missing {
                0 => format!("{} to come", counted(objects, "object")),
                parcels => format!("{} to come", counted(parcels, "parcel")),
            };
            (text, theme::WARNING)
        };
        ui.label(RichText::new(text).color(color));
    }
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
