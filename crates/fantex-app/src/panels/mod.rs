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
use eframe::egui::{Color32, Frame, Margin, Panel, Stroke, TextureId, UiBuilder};

use crate::theme;
use crate::viewer::{SceneInput, Viewer};

mod asked;
mod bar;
mod compare;
mod gizmo;
mod help;
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

/// The least width and the most of the inspector, and the least of the atlas, points. Where there is no room for that they are left out.
const INSPECTOR_POINTS: [f32; 2] = [290.0, 480.0];
const MIN_ATLAS_POINTS: f32 = 200.0;

/// What the scene keeps of the window's width at least.
const SCENE_SHARE: f32 = 0.4;

/// Points that panels may still take from the scene's width.
fn room_beside_scene(ui: &egui::Ui) -> f32 {
    ui.available_width() - SCENE_SHARE * ui.ctx().content_rect().width()
}

/// Draws the whole window. `seconds` is the time of the frame.
pub fn show(ui: &mut egui::Ui, viewer: &mut Viewer, textures: &Textures) -> Shown {
    let panels = viewer.settings.panels;
    Panel::top("bar").frame(bar_frame()).show(ui, |ui| bar::show(ui, viewer));
    Panel::bottom("status").frame(bar_frame()).show(ui, |ui| bar::show_status(ui, viewer));
    let room = room_beside_scene(ui);
    // While something is painted on, its own panels need the room.
    if panels.has_inspector && viewer.painting.is_none() && room >= INSPECTOR_POINTS[0] {
        let [least, most] = INSPECTOR_POINTS;
        let sizes = least..=most.min(room);
        Panel::right("inspector").frame(panel_frame()).default_size(320.0).size_range(sizes).show(ui, |ui| {
            if viewer.live.is_some() { live::numbers(ui, viewer) } else { inspector::show(ui, viewer) }
        });
    }
    if panels.has_graphs {
        Panel::bottom("graphs")
            .frame(panel_frame())
            .exact_size(132.0)
            .resizable(false)
            .show(ui, |ui| streaming::show_graphs(ui, viewer));
    }
    let mut atlas_channel = None;
    // The scene keeps at least half of what is left.
    let widest = room_beside_scene(ui).min(0.5 * ui.available_width());
    if panels.has_atlas && widest >= MIN_ATLAS_POINTS {
        Panel::right("atlas")
            .frame(panel_frame())
            .default_size(340.0)
            .size_range(MIN_ATLAS_POINTS..=widest)
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
        help::show(ui, viewer);
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
