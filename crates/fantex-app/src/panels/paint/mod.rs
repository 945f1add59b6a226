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

/// What is left and right of the scene while something is painted on.
pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    Panel::left("paint tools")
        .frame(panel_frame().inner_margin(Margin::symmetric(6, 8)))
        .exact_size(48.0)
        .resizable(false)
        .show(ui, |ui| strip::show(ui, viewer, seconds));
    if viewer.settings.paint.has_brush_panel {
        Panel::left("paint brush").frame(panel_frame()).exact_size(268.0).resizable(false).show(ui, |ui| {
            ScrollArea::vertical().id_salt("paint brush").auto_shrink([false, false]).show(ui, |ui| {
                ui.spacing_mut().slider_width = 72.0;
                brush::show(ui, viewer, seconds);
                symmetry::show(ui, viewer);
                stencil::show(ui, viewer, seconds);
                brush::presets(ui, viewer, seconds);
                history::show(ui, viewer);
            });
        });
    }
    if viewer.settings.paint.has_layer_panel {
        Panel::right("paint layers").frame(panel_frame()).exact_size(276.0).resizable(false).show(ui, |ui| {
            ScrollArea::vertical().id_salt("paint layers").auto_shrink([false, false]).show(ui, |ui| {
                ui.spacing_mut().slider_width = 84.0;
                color::show(ui, viewer);
                color::channels(ui, viewer);
                layers::show(ui, viewer, seconds);
            });
        });
    }
}
