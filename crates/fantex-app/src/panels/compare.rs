//! A kept picture beside the scene: A is left of a line that can be dragged, B is the scene as it is now.

use eframe::egui::{
    Align2, Area, Color32, CornerRadius, CursorIcon, FontId, Id, Order, Painter, Pos2, Rect, Sense, Shape,
    Stroke, TextureId, Ui, pos2, vec2,
};

use crate::theme;
use crate::viewer::Viewer;

/// Width of what can be taken hold of, points.
const GRIP: f32 = 12.0;

/// The line stays so far inside the scene, as a share of its width.
const MARGIN: f32 = 0.02;

/// Draws A over the scene in `rect`, and the line.
pub(super) fn show(ui: &Ui, viewer: &mut Viewer, rect: Rect, texture: Option<TextureId>) {
    let is_elsewhere = viewer.kept.is_some_and(|kept| kept.rig != viewer.rig);
    let (Some(kept), Some(texture)) = (&mut viewer.kept, texture) else { return };
    let at = pos2(rect.min.x + kept.divider * rect.width(), rect.min.y);
    let left = Rect::from_min_max(rect.min, pos2(at.x, rect.max.y));
    let [width, height] = kept.pixels.map(|n| n.max(1) as f32);
    // In a scene of another shape A is as high as B: fields of view are vertical.
    let whole = match kept.pixels == viewer.scene_pixels {
        true => rect,
        false => Rect::from_center_size(rect.center(), vec2(rect.height() * width / height, rect.height())),
    };
    let painter = ui.painter().with_clip_rect(left.intersect(ui.clip_rect()));
    painter.rect_filled(left, CornerRadius::ZERO, theme::WELL);
    painter.image(texture, whole, Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0)), Color32::WHITE);
    let grip = Area::new(Id::unique("compare")).order(Order::Middle).fixed_pos(at - vec2(0.5 * GRIP, 0.0));
    grip.show(ui.ctx(), |ui| {
        let (strip, response) = ui.allocate_exact_size(vec2(GRIP, rect.height()), Sense::drag());
        if let Some(pointer) = response.interact_pointer_pos().filter(|_| response.dragged()) {
            kept.divider = ((pointer.x - rect.min.x) / rect.width()).clamp(MARGIN, 1.0 - MARGIN);
        }
        response.on_hover_cursor(CursorIcon::ResizeHorizontal);
        let painter = ui.painter().with_clip_rect(rect);
        painter.vline(strip.center().x, strip.y_range(), Stroke::new(3.0, Color32::BLACK));
        painter.vline(strip.center().x, strip.y_range(), Stroke::new(1.0, Color32::WHITE));
        tag(&painter, at + vec2(-GRIP, 12.0), Align2::RIGHT_TOP, "A");
        tag(&painter, at + vec2(GRIP, 12.0), Align2::LEFT_TOP, "B");
    });
    if is_elsewhere {
        let tip = "A was kept from another view: goes there";
        let back = Area::new(Id::unique("view of A")).order(Order::Middle).pivot(Align2::RIGHT_TOP);
        back.fixed_pos(at + vec2(-GRIP, 40.0)).show(ui.ctx(), |ui| {
            if ui.button("View of A").on_hover_text(tip).clicked() {
                viewer.see_kept();
            }
        });
    }
}

fn tag(painter: &Painter, at: Pos2, align: Align2, text: &str) {
    let ground = painter.add(Shape::Noop);
    let rect = painter.text(at, align, text, FontId::proportional(14.0), theme::STRONG);
    painter
        .set(ground, Shape::rect_filled(rect.expand2(vec2(5.0, 2.0)), CornerRadius::same(4), theme::PANEL));
}
