//! A colour by saturation and value in a square and hue beside it.

use eframe::egui::{
    Color32, CornerRadius, Mesh, Pos2, Rect, Sense, Shape, Stroke, StrokeKind, Ui, pos2, vec2,
};

use crate::theme;

/// Hue, saturation, value, each 0..1, of sRGB values.
pub(super) fn hsv_of(color: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = color.map(|c| f32::from(c) / 255.0);
    let (high, low) = (r.max(g).max(b), r.min(g).min(b));
    let range = high - low;
    let hue = if range == 0.0 {
        0.0
    } else if high == r {
        ((g - b) / range).rem_euclid(6.0)
    } else if high == g {
        (b - r) / range + 2.0
    } else {
        (r - g) / range + 4.0
    };
    [hue / 6.0, if high > 0.0 { range / high } else { 0.0 }, high]
}

/// The other way round.
pub(super) fn rgb_of([h, s, v]: [f32; 3]) -> [u8; 3] {
    let part = |n: f32| {
        let k = (n + 6.0 * h).rem_euclid(6.0);
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    [5.0, 3.0, 1.0].map(|n| (part(n) * 255.0).round() as u8)
}

fn color32([r, g, b]: [u8; 3]) -> Color32 {
    Color32::from_rgb(r, g, b)
}

/// Edits a colour. Hue and saturation of greys are remembered.
pub(super) fn show(ui: &mut Ui, color: &mut [u8; 3], height: f32) {
    let id = ui.scope_id().with("hsv");
    let known = ui.data(|data| data.get_temp::<[f32; 3]>(id)).filter(|&hsv| rgb_of(hsv) == *color);
    let mut hsv = known.unwrap_or_else(|| hsv_of(*color));
    ui.horizontal(|ui| {
        let width = (ui.available_width() - 26.0).max(60.0);
        square(ui, &mut hsv, vec2(width, height));
        hue_bar(ui, &mut hsv, vec2(18.0, height));
    });
    let edited = rgb_of(hsv);
    if edited != *color {
        *color = edited;
    }
    ui.data_mut(|data| data.insert_temp(id, hsv));
}

fn square(ui: &mut Ui, hsv: &mut [f32; 3], size: eframe::egui::Vec2) {
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    if let Some(at) = response.interact_pointer_pos() {
        let share = (at - rect.min) / rect.size();
        hsv[1] = share.x.clamp(0.0, 1.0);
        hsv[2] = 1.0 - share.y.clamp(0.0, 1.0);
    }
    let pure = color32(rgb_of([hsv[0], 1.0, 1.0]));
    let corners = [rect.left_top(), rect.right_top(), rect.right_bottom(), rect.left_bottom()];
    let clear = Color32::TRANSPARENT;
    ui.painter().add(quad(corners, [Color32::WHITE, pure, pure, Color32::WHITE]));
    ui.painter().add(quad(corners, [clear, clear, Color32::BLACK, Color32::BLACK]));
    frame(ui, rect);
    let knob = pos2(rect.left() + hsv[1] * rect.width(), rect.top() + (1.0 - hsv[2]) * rect.height());
    ui.painter().circle_filled(knob, 5.5, color32(rgb_of(*hsv)));
    ui.painter().circle_stroke(knob, 6.0, Stroke::new(2.0, Color32::BLACK));
    ui.painter().circle_stroke(knob, 6.0, Stroke::new(1.2, Color32::WHITE));
}

fn hue_bar(ui: &mut Ui, hsv: &mut [f32; 3], size: eframe::egui::Vec2) {
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    if let Some(at) = response.interact_pointer_pos() {
        hsv[0] = ((at.y - rect.top()) / rect.height()).clamp(0.0, 0.9999);
    }
    for part in 0..6 {
        let [from, to] = [part, part + 1].map(|n| n as f32 / 6.0);
        let [a, b] = [from, to].map(|h| color32(rgb_of([h, 1.0, 1.0])));
        let y = |t: f32| rect.top() + t * rect.height();
        let corners = [
            pos2(rect.left(), y(from)),
            pos2(rect.right(), y(from)),
            pos2(rect.right(), y(to)),
            pos2(rect.left(), y(to)),
        ];
        ui.painter().add(quad(corners, [a, a, b, b]));
    }
    frame(ui, rect);
    let y = rect.top() + hsv[0] * rect.height();
    let mark = Rect::from_center_size(pos2(rect.center().x, y), vec2(rect.width() + 4.0, 6.0));
    ui.painter().rect_stroke(
        mark,
        CornerRadius::same(2),
        Stroke::new(3.0, Color32::BLACK),
        StrokeKind::Middle,
    );
    ui.painter().rect_stroke(
        mark,
        CornerRadius::same(2),
        Stroke::new(1.5, Color32::WHITE),
        StrokeKind::Middle,
    );
}

fn frame(ui: &Ui, rect: Rect) {
    ui.painter().rect_stroke(rect, CornerRadius::same(2), Stroke::new(1.0, theme::LINE), StrokeKind::Outside);
}

/// A rectangle whose corners have colours of their own, from the upper left one clockwise.
fn quad(corners: [Pos2; 4], colors: [Color32; 4]) -> Shape {
    let mut mesh = Mesh::default();
    for (corner, color) in corners.into_iter().zip(colors) {
        mesh.colored_vertex(corner, color);
    }
    mesh.add_triangle(0, 1, 2);
    mesh.add_triangle(0, 2, 3);
    Shape::mesh(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_survive_the_way_through_hue_saturation_and_value() {
        for r in (0..=255).step_by(17) {
            for g in (0..=255).step_by(51) {
                for b in (0..=255).step_by(15) {
                    let color = [r, g, b].map(|c| c as u8);
                    assert_eq!(rgb_of(hsv_of(color)), color);
                }
            }
        }
        assert_eq!(rgb_of([1.0 / 3.0, 1.0, 1.0]), [0, 255, 0]);
    }
}
