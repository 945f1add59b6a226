//! Everything that is drawn around and over the scene: functions that show the [`Viewer`] and edit its settings.
//!
//! ```text
//!  +------------------------------ bar ------------------------------+
//!  |                                         |             |         |
//!  |                  scene                  | live atlas  | inspec- |
//!  +----------- what is pointed at ----------+             | tor     |
//!  +---------------- graphs -----------------+-------------|         |
//!  +------------------------- status --------------------------------+
//! ```

use eframe::egui;
use eframe::egui::{
    Align2, Color32, Frame, Grid, Margin, Order, Panel, RichText, Stroke, TextureId, Ui, UiBuilder, Window,
    vec2,
};

use crate::command::{Command, GESTURES, PAINT_GESTURES, Section, shortcuts};
use crate::paint::{PaintCommand, paint_shortcuts};
use crate::settings::label_of;
use crate::theme;
use crate::viewer::{SceneInput, Viewer};

mod asked;
mod bar;
mod compare;
mod gizmo;
mod inspector;
mod live;
mod paint;
mod readout;
mod scene;
mod streaming;
mod widgets;

#[derive(Clone, Copy, Debug, Default)]
pub struct AtlasTexture {
    /// How egui knows it; none where there is no atlas.
    pub id: Option<TextureId>,
    /// Width and height of the atlas in texels.
    pub extent: [u32; 2],
    /// The channel that is shown, among those of the asset.
    pub channel: usize,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Textures {
    pub scene: Option<TextureId>,
    /// What the scene is compared with.
    pub kept: Option<TextureId>,
    pub atlas: AtlasTexture,
}

/// What the user did with the panels, besides editing settings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shown {
    pub input: SceneInput,
    /// Another channel of the atlas was chosen.
    pub atlas_channel: Option<usize>,
}

/// Draws the whole window. `seconds` is the time of the frame.
pub fn show(ui: &mut egui::Ui, viewer: &mut Viewer, textures: &Textures) -> Shown {
    let panels = viewer.settings.panels;
    Panel::top("bar").frame(bar_frame()).show(ui, |ui| bar::show(ui, viewer));
    Panel::bottom("status").frame(bar_frame()).show(ui, |ui| bar::show_status(ui, viewer));
    // While something is painted on, its own panels need the room.
    if panels.has_inspector && viewer.painting.is_none() {
        Panel::right("inspector").frame(panel_frame()).default_size(320.0).size_range(290.0..=480.0).show(
            ui,
            |ui| {
                if viewer.live.is_some() { live::numbers(ui, viewer) } else { inspector::show(ui, viewer) }
            },
        );
    }
    if panels.has_graphs {
        Panel::bottom("graphs")
            .frame(panel_frame())
            .exact_size(132.0)
            .resizable(false)
            .show(ui, |ui| streaming::show_graphs(ui, viewer));
    }
    let mut atlas_channel = None;
    if panels.has_atlas {
        // The scene keeps at least half of what is left.
        let widest = (ui.available_width() * 0.5).max(200.0);
        Panel::right("atlas")
            .frame(panel_frame())
            .default_size(340.0)
            .size_range(200.0..=widest)
            .show(ui, |ui| atlas_channel = streaming::show_atlas(ui, viewer, &textures.atlas));
    }
    if viewer.painting.is_some() {
        paint::show(ui, viewer);
    }
    let mut input = SceneInput::default();
    egui::CentralPanel::no_frame().show(ui, |ui| {
        let (scene, line) = readout::split(viewer, ui.max_rect());
        ui.scope_builder(UiBuilder::new().max_rect(scene), |ui| input = scene::show(ui, viewer, textures));
        viewer.point_at(input.cursor);
        if let Some(line) = line {
            readout::show(ui, viewer, line);
        }
    });
    if viewer.has_help {
        show_help(ui, viewer);
    }
    Shown { input, atlas_channel }
}

fn bar_frame() -> Frame {
    Frame::new().fill(theme::BAR).inner_margin(Margin::symmetric(10, 5))
}

fn panel_frame() -> Frame {
    Frame::new()
        .fill(theme::PANEL)
        .stroke(Stroke::new(1.0, Color32::TRANSPARENT))
        .inner_margin(Margin::symmetric(12, 10))
}

fn show_help(ui: &Ui, viewer: &mut Viewer) {
    let mut is_open = true;
    let screen = ui.ctx().content_rect();
    let is_painting = viewer.painting.is_some();
    let sheet = Window::new("Keys and mouse")
        .open(&mut is_open)
        .anchor(Align2::CENTER_CENTER, vec2(0.0, 0.0))
        .order(Order::Foreground)
        .collapsible(false)
        .resizable(false)
        .max_height(screen.height() - 80.0);
    sheet.show(ui.ctx(), |ui| {
        ui.horizontal_top(|ui| {
            ui.spacing_mut().interact_size.y = 16.0;
            if viewer.painting.is_some() {
                column(ui, 330.0, painting);
                ui.add_space(20.0);
            }
            if viewer.painting.is_none() {
                column(ui, 290.0, gestures);
            }
            ui.add_space(20.0);
            column(ui, 240.0, |ui| {
                keys(ui, Section::Camera, is_painting);
                keys(ui, Section::Panels, is_painting);
            });
            ui.add_space(20.0);
            column(ui, 290.0, |ui| {
                keys(ui, Section::File, is_painting);
                keys(ui, Section::Display, is_painting);
            });
        });
    });
    viewer.has_help &= is_open;
}

fn column(ui: &mut Ui, width: f32, add: impl FnOnce(&mut Ui)) {
    ui.vertical(|ui| {
        ui.set_width(width);
        add(ui);
    });
}

fn gestures(ui: &mut Ui) {
    for (title, rows) in GESTURES {
        table(ui, title, rows.iter().map(|&(keys, text)| (keys.to_owned(), text)));
    }
}

/// What painting has; the digits are among the gestures.
fn painting(ui: &mut Ui) {
    table(ui, "Pen and mouse", PAINT_GESTURES.iter().map(|&(keys, text)| (keys.to_owned(), text)));
    let is_digit = |command: &Command| {
        matches!(command, Command::Paint(PaintCommand::Opacity(_) | PaintCommand::Flow(_)))
    };
    let rows = paint_shortcuts().into_iter().filter(|s| !is_digit(&s.command)).map(|s| (s.keys(), s.text));
    table(ui, label_of(&Section::ALL, Section::Painting), rows);
}

fn keys(ui: &mut Ui, section: Section, is_painting: bool) {
    let is_taken = |s: &crate::command::Shortcut| {
        is_painting && paint_shortcuts().iter().any(|p| p.key == s.key && p.modifiers == s.modifiers)
    };
    let rows =
        shortcuts().into_iter().filter(|s| s.section == section && !is_taken(s)).map(|s| (s.keys(), s.text));
    table(ui, label_of(&Section::ALL, section), rows);
}

fn table(ui: &mut Ui, title: &str, rows: impl Iterator<Item = (String, &'static str)>) {
    ui.label(RichText::new(title).color(theme::STRONG));
    Grid::new(("help", title)).num_columns(2).spacing([12.0, 3.0]).min_col_width(84.0).show(ui, |ui| {
        for (keys, text) in rows {
            ui.label(RichText::new(keys).monospace().size(11.5).color(theme::ACCENT));
            ui.label(text);
            ui.end_row();
        }
    });
    ui.add_space(8.0);
}
