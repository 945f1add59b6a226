//! Panels of the painter: tools and brush at the left, colours, layers and history at the right, the cursor over the scene.
//!
//! ```text
//!  +------+---------+---------------------------+----------+
//!  | tool | brush   |                           | colour   |
//!  | strip| symmetry|     scene, cursor,        | channels |
//!  |      | presets |     symmetry plane        | layers   |
//!  |      |         |                           | history  |
//!  +------+---------+---------------------------+----------+
//! ```

mod brush;
mod color;
mod layers;
mod overlay;

pub(super) use overlay::{adjust, show as overlay};

use eframe::egui::scroll_area::ScrollBarVisibility;
use eframe::egui::{
    Button, Color32, CornerRadius, Id, Margin, Painter, Panel, Pos2, Rect, RichText, ScrollArea, Sense,
    Shape, Stroke, StrokeKind, Ui, Vec2, pos2, vec2,
};

use fantex::base::counted;
use fantex::paint::Symmetry;

use crate::command::{Command, keys_of};
use crate::paint::{PaintCommand, PaintTool, Snapshot, SymmetryKind};
use crate::panels::widgets::{decimals_of, heading, number, row, segments};
use crate::panels::{panel_frame, room_beside_scene};
use crate::theme;
use crate::viewer::Viewer;

/// Widths of the panels, points.
const BRUSH_POINTS: f32 = 268.0;
const LAYER_POINTS: f32 = 276.0;

/// What is left and right of the scene while something is painted on.
pub(crate) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    Panel::left("paint tools")
        .frame(panel_frame().inner_margin(Margin::symmetric(6, 8)))
        .exact_size(48.0)
        .resizable(false)
        .show(ui, |ui| {
            // Where it is too low the wheel moves it: there is no room for a bar.
            let area = ScrollArea::vertical().id_salt("paint tools").auto_shrink([false, false]);
            let area = area.scroll_bar_visibility(ScrollBarVisibility::AlwaysHidden);
            area.show(ui, |ui| tool_strip(ui, viewer));
        });
    let room = room_beside_scene(ui);
    let has_brush = viewer.settings.paint.has_brush_panel && room >= BRUSH_POINTS;
    let has_layers = viewer.settings.paint.has_layer_panel && room >= LAYER_POINTS;
    if has_brush && has_layers && room < BRUSH_POINTS + LAYER_POINTS {
        let panel = Panel::left("paint tabs").frame(panel_frame()).exact_size(LAYER_POINTS).resizable(false);
        panel.show(ui, |ui| one_of_both(ui, viewer));
        return;
    }
    if has_brush {
        let panel = Panel::left("paint brush").frame(panel_frame()).exact_size(BRUSH_POINTS).resizable(false);
        panel.show(ui, |ui| brush_panel(ui, viewer));
    }
    if has_layers {
        let panel =
            Panel::right("paint layers").frame(panel_frame()).exact_size(LAYER_POINTS).resizable(false);
        panel.show(ui, |ui| layer_panel(ui, viewer));
    }
}

/// Both panels in the place of one, where there is no room for two.
fn one_of_both(ui: &mut Ui, viewer: &mut Viewer) {
    let id = Id::unique("paint tab");
    let mut shows_layers = ui.data(|data| data.get_temp::<bool>(id)).unwrap_or(false);
    ui.horizontal(|ui| segments(ui, &mut shows_layers, &[(false, "Brush"), (true, "Layers")]));
    ui.data_mut(|data| data.insert_temp(id, shows_layers));
    ui.separator();
    if shows_layers { layer_panel(ui, viewer) } else { brush_panel(ui, viewer) }
}

fn brush_panel(ui: &mut Ui, viewer: &mut Viewer) {
    ScrollArea::vertical().id_salt("paint brush").auto_shrink([false, false]).show(ui, |ui| {
        ui.spacing_mut().slider_width = 72.0;
        brush::show(ui, viewer);
        symmetry(ui, viewer);
        overlay::stencil(ui, viewer);
        if viewer.settings.paint.tool.has_brush() {
            brush::presets(ui, viewer);
        }
    });
}

fn layer_panel(ui: &mut Ui, viewer: &mut Viewer) {
    ScrollArea::vertical().id_salt("paint layers").auto_shrink([false, false]).show(ui, |ui| {
        ui.spacing_mut().slider_width = 84.0;
        color::show(ui, viewer);
        color::channels(ui, viewer);
        layers::show(ui, viewer);
        history(ui, viewer);
    });
}

// The tool strip, with the two colours at its end.

fn tool_strip(ui: &mut Ui, viewer: &mut Viewer) {
    ui.spacing_mut().item_spacing.y = 4.0;
    let mut chosen = None;
    for (tool, label) in PaintTool::ALL {
        let is_on = viewer.settings.paint.tool == tool;
        let (rect, response) = ui.allocate_exact_size(vec2(36.0, 36.0), Sense::click());
        let fill = match (is_on, response.hovered()) {
            (true, _) => Color32::from_rgb(0x2f, 0x5d, 0x82),
            (_, true) => Color32::from_rgb(0x35, 0x39, 0x41),
            _ => Color32::TRANSPARENT,
        };
        ui.painter().rect_filled(rect, CornerRadius::same(5), fill);
        let color = if is_on { theme::STRONG } else { theme::TEXT };
        tool_icon(ui.painter(), Rect::from_center_size(rect.center(), vec2(20.0, 20.0)), tool, color);
        let keys = keys_of(true, &Command::Paint(PaintCommand::Tool(tool))).unwrap_or_default();
        let name = format!("{label} tool");
        response.widget_info(|| {
            eframe::egui::WidgetInfo::selected(eframe::egui::Role::Button, true, is_on, &name)
        });
        if response.on_hover_text(format!("{label} ({keys})\n{}", tool.hint())).clicked() {
            chosen = Some(tool);
        }
    }
    if let Some(tool) = chosen {
        viewer.paint_command(&PaintCommand::Tool(tool));
    }
    ui.add_space(10.0);
    swatches(ui, viewer);
}

/// Foreground over background.
fn swatches(ui: &mut Ui, viewer: &mut Viewer) {
    let (rect, response) = ui.allocate_exact_size(vec2(36.0, 36.0), Sense::click());
    let colors = &viewer.settings.paint.colors;
    let back = Rect::from_min_size(rect.min + vec2(13.0, 13.0), vec2(23.0, 23.0));
    let front = Rect::from_min_size(rect.min, vec2(25.0, 25.0));
    swatch(ui.painter(), back, colors.background, false);
    swatch(ui.painter(), front, colors.foreground, false);
    if response.on_hover_text("Foreground and background; click or X swaps them").clicked() {
        viewer.paint_command(&PaintCommand::SwapColors);
    }
}

// Signs of the tools, drawn with lines.

/// Draws the sign of a tool into a square.
fn tool_icon(painter: &Painter, rect: Rect, tool: PaintTool, color: Color32) {
    let stroke = Stroke::new(1.7, color);
    // In a square of 20.
    let at = |x: f32, y: f32| rect.min + vec2(x, y) * (rect.width() / 20.0);
    match tool {
        PaintTool::Paint => {
            painter.line_segment([at(17.0, 2.5), at(9.5, 11.0)], Stroke::new(2.6, color));
            let tip = vec![at(8.2, 10.2), at(10.6, 12.4), at(8.4, 15.6), at(3.0, 17.4), at(5.0, 12.2)];
            painter.add(Shape::convex_polygon(tip, color, Stroke::NONE));
        }
        PaintTool::Erase => {
            let body = vec![at(7.5, 16.5), at(2.5, 11.5), at(11.0, 3.0), at(16.5, 8.5), at(8.5, 16.5)];
            painter.add(Shape::closed_line(body, stroke));
            painter.line_segment([at(6.6, 7.4), at(12.1, 12.9)], stroke);
            painter.line_segment([at(8.0, 17.3), at(17.5, 17.3)], stroke);
        }
        PaintTool::Opacity => {
            let radius = 7.0 * rect.width() / 20.0;
            painter.circle_stroke(rect.center(), radius, stroke);
            let half = (0..=12).map(|k| k as f32 / 12.0 * std::f32::consts::PI);
            let half = half.map(|a| rect.center() + vec2(a.sin(), a.cos()) * radius).collect();
            painter.add(Shape::convex_polygon(half, color, Stroke::NONE));
        }
        PaintTool::Fill => {
            let bucket = vec![at(3.0, 10.5), at(9.5, 4.0), at(16.0, 10.5), at(9.5, 17.0)];
            painter.add(Shape::closed_line(bucket, stroke));
            let paint = vec![at(3.6, 10.9), at(15.4, 10.9), at(9.5, 16.6)];
            painter.add(Shape::convex_polygon(paint, color, Stroke::NONE));
            painter.line_segment([at(9.5, 4.0), at(6.5, 1.5)], stroke);
            painter.circle_filled(at(17.6, 15.6), rect.width() * 0.07, color);
        }
        PaintTool::Gradient => {
            painter.rect_stroke(
                Rect::from_min_max(at(2.5, 4.5), at(17.5, 15.5)),
                CornerRadius::same(1),
                stroke,
                StrokeKind::Middle,
            );
            for (x, strength) in [(4.9, 1.0), (7.3, 0.75), (9.7, 0.5), (12.1, 0.3), (14.5, 0.12)] {
                let bar = Stroke::new(2.4 * rect.width() / 20.0, color.gamma_multiply(strength));
                painter.line_segment([at(x, 5.5), at(x, 14.5)], bar);
            }
        }
        PaintTool::Blur => {
            for (radius, strength) in [(7.4, 0.22), (5.0, 0.45), (2.6, 1.0)] {
                let radius = radius * rect.width() / 20.0;
                painter.circle_filled(rect.center(), radius, color.gamma_multiply(strength));
            }
        }
        PaintTool::Smudge => {
            let finger = vec![at(12.0, 2.5), at(17.0, 7.0), at(12.5, 12.5), at(7.5, 8.0)];
            painter.add(Shape::closed_line(finger, stroke));
            for (x, strength) in [(9.0, 1.0), (6.2, 0.6), (3.4, 0.3)] {
                let radius = 2.3 * rect.width() / 20.0;
                painter.circle_filled(at(x, 14.5 + 0.35 * (9.0 - x)), radius, color.gamma_multiply(strength));
            }
        }
        PaintTool::Sticker => {
            let wide = Stroke::new(2.4, color);
            painter.line_segment([at(4.0, 4.0), at(16.0, 4.0)], wide);
            painter.line_segment([at(10.0, 4.0), at(10.0, 16.5)], wide);
            painter.line_segment([at(7.2, 16.5), at(12.8, 16.5)], Stroke::new(1.6, color));
        }
        PaintTool::Clone => {
            painter.circle_stroke(at(6.8, 12.6), 4.6 * rect.width() / 20.0, stroke);
            painter.circle_filled(at(13.0, 7.2), 4.9 * rect.width() / 20.0, color);
        }
        PaintTool::Pick => {
            painter.line_segment([at(3.0, 17.0), at(11.0, 9.0)], Stroke::new(2.4, color));
            painter.line_segment([at(9.0, 6.6), at(13.4, 11.0)], stroke);
            painter.line_segment([at(12.0, 8.0), at(16.0, 4.0)], Stroke::new(4.4, color));
        }
    }
}

/// An eye, open or closed.
pub(crate) fn eye(painter: &Painter, rect: Rect, is_open: bool, color: Color32) {
    let c = rect.center();
    let half = vec2(7.0, if is_open { 4.2 } else { 2.6 });
    let arc = |up: f32| -> Vec<Pos2> {
        (0..=10)
            .map(|k| k as f32 / 10.0)
            .map(|t| {
                let bow = (t * std::f32::consts::PI).sin() * half.y * up;
                c + Vec2::new((2.0 * t - 1.0) * half.x, bow)
            })
            .collect()
    };
    let stroke = Stroke::new(1.3, color);
    painter.add(Shape::line(arc(1.0), stroke));
    if is_open {
        painter.add(Shape::line(arc(-1.0), stroke));
        painter.circle_filled(c, 2.1, color);
    }
}

/// A small square in a colour, framed so that it is seen on any ground.
pub(crate) fn swatch(painter: &Painter, rect: Rect, [r, g, b]: [u8; 3], is_chosen: bool) {
    let radius = CornerRadius::same(3);
    painter.rect_filled(rect, radius, Color32::from_rgb(r, g, b));
    let frame = if is_chosen {
        Stroke::new(2.0, crate::theme::ACCENT)
    } else {
        Stroke::new(1.0, Color32::from_white_alpha(38))
    };
    painter.rect_stroke(rect, radius, frame, StrokeKind::Inside);
}

/// An arrow that points up or down.
pub(crate) fn arrow(painter: &Painter, rect: Rect, is_up: bool, color: Color32) {
    let c = rect.center();
    let s = if is_up { -1.0 } else { 1.0 };
    let points =
        vec![pos2(c.x - 4.0, c.y - 2.0 * s), pos2(c.x, c.y + 2.5 * s), pos2(c.x + 4.0, c.y - 2.0 * s)];
    painter.add(Shape::line(points, Stroke::new(1.6, color)));
}

// Symmetry of strokes.

pub(crate) fn symmetry(ui: &mut Ui, viewer: &mut Viewer) {
    let diagonal = viewer.scale().diagonal;
    let symmetry = &mut viewer.settings.paint.symmetry;
    heading(ui, "Symmetry");
    ui.horizontal(|ui| segments(ui, &mut symmetry.kind, &SymmetryKind::ALL));
    if symmetry.kind == SymmetryKind::Off {
        return;
    }
    row(ui, "Axis", |ui| {
        let axes = |ui: &mut Ui| segments(ui, &mut symmetry.axis, &[(0, "X"), (1, "Y"), (2, "Z")]);
        ui.horizontal(axes).response
    });
    match symmetry.kind {
        SymmetryKind::Mirror => {
            let half = 0.5 * diagonal;
            let offset = number("Offset", "", decimals_of(0.1 * diagonal), "From the model's middle");
            offset.show(ui, &mut symmetry.offset, -half..=half);
        }
        _ => {
            number("Copies", "", 0, "").logarithmic().show(ui, &mut symmetry.count, Symmetry::COPIES);
        }
    }
    ui.checkbox(&mut symmetry.shows_plane, "Show it in the scene");
}

// The steps that were done: a click goes back to one, or forth.

/// Height of a step in the list, and of the list, points.
const STEP: f32 = 22.0;
const HISTORY: f32 = 192.0;

pub(crate) fn history(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &mut viewer.painting else { return };
    let snapshot = &painting.snapshot;
    heading(ui, "History");
    let (done, undone) = (snapshot.done.len(), snapshot.undone.len());
    let mut chosen = None;
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 1.0;
        let list = ScrollArea::vertical().id_salt("history").max_height(HISTORY).auto_shrink([false, true]);
        // Those out of sight are not laid out: there may be many.
        list.stick_to_bottom(true).show_rows(ui, STEP, 1 + done + undone, |ui, rows| {
            for row in rows {
                let size = vec2(ui.available_width(), STEP);
                let button = Button::selectable(row == done, step_text(snapshot, row)).min_size(size);
                let response = ui.add(button);
                if response.clicked() {
                    chosen = Some(snapshot.older + row);
                }
                if row > done {
                    response.on_hover_text("Taken back; a click does it again");
                }
            }
        });
    });
    if let Some(number) = chosen {
        painting.go_to_step(number);
    }
}

/// A line of the history: what was there before all steps that are listed, those that were done, and those that were taken back.
fn step_text(snapshot: &Snapshot, row: usize) -> RichText {
    let Some(index) = row.checked_sub(1) else {
        let text = match snapshot.older {
            0 => "Original".to_owned(),
            count => counted(count, "older step").to_string(),
        };
        return RichText::new(text).color(theme::FAINT);
    };
    let number = snapshot.older + row;
    match snapshot.done.get(index) {
        Some(label) => RichText::new(format!("{number}   {label}")),
        None => {
            let label = snapshot.undone.iter().rev().nth(index - snapshot.done.len());
            let text = format!("{number}   {}", label.map_or("", String::as_str));
            RichText::new(text).color(theme::FAINT).italics()
        }
    }
}
