//! Everything that is drawn around and over the scene: functions that show the [`Viewer`] and edit its settings.
//!
//! ```text
//!  +------------------------------ bar ------------------------------+
//!  |                                         |             |         |
//!  |                  scene                  | live atlas  | inspec- |
//!  |                                         |             | tor     |
//!  +---------------- graphs -----------------+-------------|         |
//!  +------------------------- status --------------------------------+
//! ```

mod atlas;
mod bar;
mod cover;
mod graphs;
mod help;
mod inspector;
mod light;
mod model;
mod paint;
mod scene;
mod status;
mod streaming;
mod view;
mod widgets;

use eframe::egui::{self, Color32, Frame, Margin, Panel, Stroke, TextureId};

use crate::theme;
use crate::viewer::{SceneInput, Viewer};

/// The picture of the scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneTexture {
    /// How egui knows it.
    pub id: TextureId,
}

/// The picture of the atlas.
#[derive(Clone, Copy, Debug, Default)]
pub struct AtlasTexture {
    /// How egui knows it; none where there is no atlas.
    pub id: Option<TextureId>,
    /// Width and height of the atlas in texels.
    pub extent: [u32; 2],
    /// The channel that is shown, among those of the asset.
    pub channel: usize,
}

/// What the panels are given besides the viewer's state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Textures {
    /// The scene, once it has been drawn.
    pub scene: Option<SceneTexture>,
    /// The atlas, where there is one.
    pub atlas: AtlasTexture,
}

/// What the user did with the panels, besides editing settings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shown {
    /// What was done in the scene.
    pub input: SceneInput,
    /// Another channel of the atlas was chosen.
    pub atlas_channel: Option<usize>,
}

/// Draws the whole window. `seconds` is the time of the frame.
pub fn show(ui: &mut egui::Ui, viewer: &mut Viewer, textures: &Textures, seconds: f64) -> Shown {
    let panels = viewer.settings.panels;
    Panel::top("bar").frame(bar_frame()).show(ui, |ui| bar::show(ui, viewer, seconds));
    Panel::bottom("status").frame(bar_frame()).show(ui, |ui| status::show(ui, viewer, seconds));
    // While something is painted on, its own panels need the room.
    if panels.has_inspector && viewer.painting.is_none() {
        Panel::right("inspector")
            .frame(panel_frame())
            .default_size(320.0)
            .size_range(290.0..=480.0)
            .show(ui, |ui| inspector::show(ui, viewer, seconds));
    }
    if panels.has_graphs {
        Panel::bottom("graphs")
            .frame(panel_frame())
            .exact_size(132.0)
            .resizable(false)
            .show(ui, |ui| graphs::show(ui, viewer));
    }
    let mut atlas_channel = None;
    if panels.has_atlas {
        // The scene keeps at least half of what is left.
        let widest = (ui.available_width() * 0.5).max(200.0);
        Panel::right("atlas")
            .frame(panel_frame())
            .default_size(340.0)
            .size_range(200.0..=widest)
            .show(ui, |ui| atlas_channel = atlas::show(ui, viewer, &textures.atlas));
    }
    if viewer.painting.is_some() {
        paint::show(ui, viewer, seconds);
    }
    let mut input = SceneInput::default();
    egui::CentralPanel::no_frame().show(ui, |ui| {
        input = scene::show(ui, viewer, textures.scene, seconds);
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

#[cfg(test)]
mod tests;
