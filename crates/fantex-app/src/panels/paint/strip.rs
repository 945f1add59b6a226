//! The tool strip, with the two colours at its end.

use eframe::egui::{Color32, CornerRadius, Rect, Sense, Ui, vec2};

use super::icons;
use crate::command::{Command, keys_of};
use crate::paint::{PaintCommand, PaintTool};
use crate::theme;
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    ui.spacing_mut().item_spacing.y = 4.0;
    let mut chosen = None;
    for tool in PaintTool::ALL {
        let is_on = viewer.settings.paint.tool == tool;
        let (rect, response) = ui.allocate_exact_size(vec2(36.0, 36.0), Sense::click());
        let fill = match (is_on, response.hovered()) {
            (true, _) => Color32::from_rgb(0x2f, 0x5d, 0x82),
            (_, true) => Color32::from_rgb(0x35, 0x39, 0x41),
            _ => Color32::TRANSPARENT,
        };
        ui.painter().rect_filled(rect, CornerRadius::same(5), fill);
        let color = if is_on { theme::STRONG } else { theme::TEXT };
        icons::tool(ui.painter(), Rect::from_center_size(rect.center(), vec2(20.0, 20.0)), tool, color);
        let keys = keys_of(&Command::Paint(PaintCommand::Tool(tool))).unwrap_or_default();
        let name = format!("{} tool", tool.label());
        response.widget_info(|| {
            eframe::egui::WidgetInfo::selected(eframe::egui::Role::Button, true, is_on, &name)
        });
        if response.on_hover_text(format!("{} ({keys})\n{}", tool.label(), tool.hint())).clicked() {
            chosen = Some(tool);
        }
    }
    if let Some(tool) = chosen {
        viewer.paint_command(&PaintCommand::Tool(tool), seconds);
    }
    ui.add_space(10.0);
    swatches(ui, viewer, seconds);
}

/// Foreground over background.
fn swatches(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    let (rect, response) = ui.allocate_exact_size(vec2(36.0, 36.0), Sense::click());
    let colors = &viewer.settings.paint.colors;
    let back = Rect::from_min_size(rect.min + vec2(13.0, 13.0), vec2(23.0, 23.0));
    let front = Rect::from_min_size(rect.min, vec2(25.0, 25.0));
    icons::swatch(ui.painter(), back, colors.background, false);
    icons::swatch(ui.painter(), front, colors.foreground, false);
    if response.on_hover_text("Foreground and background; click or X swaps them").clicked() {
        viewer.paint_command(&PaintCommand::SwapColors, seconds);
    }
}
