//! The axes of the world in a corner of the scene: they show how the camera lies. A click on an end goes to the view from there, a drag
//! turns.

use eframe::egui::{
    Align2, Area, Color32, FontId, Id, Order, Rect, Response, Role, Sense, Stroke, Ui, Vec2, WidgetInfo, vec2,
};
use fantex::glam::{DVec2, DVec3};

use crate::camera::{CameraRig, ViewPreset};
use crate::theme;
use crate::viewer::{SceneInput, Viewer};

/// Side of the square that it takes, points.
const SIDE: f32 = 88.0;

/// From the corner of the scene.
const MARGIN: f32 = 10.0;

/// Of an end, and from the middle to it.
const RADIUS: f32 = 8.5;
const ARM: f32 = 0.5 * SIDE - RADIUS - 2.0;

/// An end of an axis.
struct End {
    direction: DVec3,
    /// The axis, 0..3.
    axis: usize,
    is_positive: bool,
    view: ViewPreset,
    name: &'static str,
}

static ENDS: [End; 6] = [
    end(DVec3::X, 0, ViewPreset::Right, "View from the right (+x)"),
    end(DVec3::NEG_X, 0, ViewPreset::Left, "View from the left (-x)"),
    end(DVec3::Y, 1, ViewPreset::Top, "View from above (+y)"),
    end(DVec3::NEG_Y, 1, ViewPreset::Bottom, "View from below (-y)"),
    end(DVec3::Z, 2, ViewPreset::Front, "View from the front (+z)"),
    end(DVec3::NEG_Z, 2, ViewPreset::Back, "View from behind (-z)"),
];

const fn end(direction: DVec3, axis: usize, view: ViewPreset, name: &'static str) -> End {
    let is_positive = direction.x + direction.y + direction.z > 0.0;
    End { direction, axis, is_positive, view, name }
}

/// The ends with where they are seen (to the right, upwards, towards the viewer; unit vectors), the farthest first.
fn seen_ends(rig: &CameraRig) -> [(&'static End, DVec3); 6] {
    let seen = rig.axes().transpose();
    let mut ends = ENDS.each_ref().map(|end| (end, seen * end.direction));
    ends.sort_by(|(_, a), (_, b)| a.z.total_cmp(&b.z));
    ends
}

/// Draws it into the lower right corner of the scene; drags on it are added to the input.
pub(super) fn show(ui: &Ui, viewer: &mut Viewer, rect: Rect, input: &mut SceneInput) {
    let is_small = rect.width() < 3.0 * SIDE || rect.height() < 3.0 * SIDE;
    if !viewer.settings.panels.has_gizmo || is_small {
        return;
    }
    let mut chosen = None;
    let corner = rect.right_bottom() - Vec2::splat(MARGIN);
    let area =
        Area::new(Id::unique("gizmo")).order(Order::Middle).fixed_pos(corner).pivot(Align2::RIGHT_BOTTOM);
    area.show(ui.ctx(), |ui| {
        let (square, response) = ui.allocate_exact_size(Vec2::splat(SIDE), Sense::drag());
        if response.contains_pointer() || response.dragged() {
            ui.painter().circle_filled(square.center(), 0.5 * SIDE, Color32::from_black_alpha(70));
        }
        turn(viewer, &response, rect.height(), input);
        for (end, seen) in seen_ends(&viewer.rig) {
            let at = square.center() + vec2(seen.x as f32, -seen.y as f32) * ARM;
            let place = Rect::from_center_size(at, Vec2::splat(2.0 * RADIUS));
            let response = ui.interact(place, Id::unique(("gizmo", end.name)), Sense::click());
            response.widget_info(|| WidgetInfo::labeled(Role::Button, true, end.name));
            draw(ui, end, seen.z as f32, square, &response);
            if response.on_hover_text(end.name).clicked() {
                chosen = Some(end.view);
            }
        }
    });
    if let Some(view) = chosen {
        viewer.show(view);
    }
}

/// A drag on it turns as one in the scene does; while something is painted on, as one with the right button.
fn turn(viewer: &Viewer, response: &Response, height: f32, input: &mut SceneInput) {
    if !response.dragged() || input.turns_sun {
        return;
    }
    let by = response.drag_delta() / height.max(1.0);
    let by = DVec2::new(f64::from(by.x), f64::from(by.y));
    if viewer.painting.is_some() {
        input.side_drag += by;
    } else {
        input.drag += by;
    }
}

/// `nearness`: -1 away from the viewer to 1 towards him.
fn draw(ui: &Ui, end: &End, nearness: f32, square: Rect, response: &Response) {
    let color = [theme::ERROR, theme::GOOD, theme::ACCENT][end.axis];
    let color = color.gamma_multiply(0.7 + 0.3 * nearness);
    let (painter, at) = (ui.painter(), response.rect.center());
    let edge = if response.hovered() { Stroke::new(2.0, theme::STRONG) } else { Stroke::new(1.5, color) };
    if end.is_positive {
        painter.line_segment([square.center(), at], Stroke::new(2.0, color));
        painter.circle(at, RADIUS - 1.0, color, edge);
        let letter = ["X", "Y", "Z"][end.axis];
        painter.text(at, Align2::CENTER_CENTER, letter, FontId::proportional(11.0), Color32::BLACK);
    } else {
        painter.circle(at, RADIUS - 1.0, Color32::from_black_alpha(120), edge);
    }
}
