//! The line below the scene: what the pointer is on.

use eframe::egui::{Align, CornerRadius, Label, Layout, Rect, RichText, Ui, UiBuilder, vec2};

use crate::theme;
use crate::viewer::Viewer;

/// Its height, points.
const HEIGHT: f32 = 22.0;

/// What of a rectangle is the scene, and the line below it, where there is one.
pub(super) fn split(viewer: &Viewer, rect: Rect) -> (Rect, Option<Rect>) {
    if !viewer.has_readout() || rect.height() < 3.0 * HEIGHT {
        return (rect, None);
    }
    let (scene, line) = rect.split_top_bottom_at_y(rect.bottom() - HEIGHT);
    (scene, Some(line))
}

pub(super) fn show(ui: &mut Ui, viewer: &Viewer, rect: Rect) {
    ui.painter().rect_filled(rect, CornerRadius::ZERO, theme::BAR);
    let line =
        UiBuilder::new().max_rect(rect.shrink2(vec2(10.0, 1.0))).layout(Layout::left_to_right(Align::Center));
    ui.scope_builder(line, |ui| match viewer.readout_text() {
        Some((place, values)) => {
            ui.add(Label::new(RichText::new(place).color(theme::TEXT)).truncate());
            ui.add(Label::new(RichText::new(values).color(theme::FAINT)).truncate());
        }
        None => {
            ui.add(Label::new(RichText::new(hint(viewer)).color(theme::FAINT)).truncate());
        }
    });
}

/// What is said where the pointer is on nothing.
fn hint(viewer: &Viewer) -> &'static str {
    match (viewer.can_point(), viewer.is_preparing_ground()) {
        (true, _) => "Point at the model to see its tile, texel and values here",
        (false, true) => "Preparing the model to be pointed at …",
        (false, false) => {
            "Pointing at a model of this size needs the camera mode Walk once, which prepares it"
        }
    }
}
