//! Panels of the painter: tools, brush and history at the left, colours and layers at the right, the cursor over the scene.
//!
//! ```text
//!  +------+---------+---------------------------+----------+
//!  | tool | brush   |                           | colour   |
//!  | strip| symmetry|     scene, cursor,        | channels |
//!  |      | presets |     symmetry plane        | layers   |
//!  |      | history |                           |          |
//!  +------+---------+---------------------------+----------+
//! ```

mod brush;
mod color;
mod history;
mod icons;
mod layers;
mod overlay;
mod picker;
mod stencil;
mod strip;
mod symmetry;
mod texture;

use eframe::egui::{Margin, Panel, ScrollArea, Ui};

use super::panel_frame;
use crate::viewer::Viewer;

pub(super) use overlay::show as overlay;
pub(super) use stencil::adjust;

/// Widths of the panels, and what the scene keeps at least, points.
const BRUSH_POINTS: f32 = 268.0;
const LAYER_POINTS: f32 = 276.0;
const SCENE_POINTS: f32 = 150.0;

/// What is left and right of the scene while something is painted on.
pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    Panel::left("paint tools")
        .frame(panel_frame().inner_margin(Margin::symmetric(6, 8)))
        .exact_size(48.0)
        .resizable(false)
        .show(ui, |ui| strip::show(ui, viewer, seconds));
    // Where there is no room for both and a scene between them, the brush comes first.
    let width = ui.available_width() - SCENE_POINTS;
    let has_brush = viewer.settings.paint.has_brush_panel && width >= BRUSH_POINTS;
    let left = width - if has_brush { BRUSH_POINTS } else { 0.0 };
    let has_layers = viewer.settings.paint.has_layer_panel && left >= LAYER_POINTS;
    if has_brush {
        Panel::left("paint brush").frame(panel_frame()).exact_size(BRUSH_POINTS).resizable(false).show(
            ui,
            |ui| {
                ScrollArea::vertical().id_salt("paint brush").auto_shrink([false, false]).show(ui, |ui| {
                    ui.spacing_mut().slider_width = 72.0;
                    brush::show(ui, viewer, seconds);
                    symmetry::show(ui, viewer);
                    stencil::show(ui, viewer, seconds);
                    brush::presets(ui, viewer, seconds);
                    history::show(ui, viewer);
                });
            },
        );
    }
    if has_layers {
        Panel::right("paint layers").frame(panel_frame()).exact_size(LAYER_POINTS).resizable(false).show(
            ui,
            |ui| {
                ScrollArea::vertical().id_salt("paint layers").auto_shrink([false, false]).show(ui, |ui| {
                    ui.spacing_mut().slider_width = 84.0;
                    color::show(ui, viewer);
                    color::channels(ui, viewer);
                    layers::show(ui, viewer, seconds);
                });
            },
        );
    }
}
