//! A look that is being worked on: its numbers, and what is wrong with it.

use eframe::egui::{
    Align2, Area, Color32, ColorImage, CornerRadius, Id, Order, Rect, RichText, ScrollArea, Stroke, Ui, pos2,
    vec2,
};

use super::scene::card;
use super::widgets::{Itself, cached_texture, decimals_of, heading, hint, number};
use crate::live::{LiveLook, pixels};
use crate::theme;
use crate::viewer::Viewer;

/// The picture, as large as the scene.
pub(super) fn picture(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let (camera, size) = (viewer.camera(), viewer.scene_pixels);
    let Some(live) = &viewer.live else { return };
    live.show(&camera, size);
    if let Some(image) = &live.picture {
        let texture = cached_texture(ui, Id::unique("live look"), Itself(image.clone()), || {
            let colors = pixels(image).into_iter().map(|[r, g, b, _]| Color32::from_rgb(r, g, b));
            ColorImage::new([image.width as usize, image.height as usize], colors.collect())
        });
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    }
    // The file is looked at again.
    ui.ctx().request_repaint_after_secs(0.25);
    let Some(error) = live.error.clone() else { return };
    let area = Area::new(Id::unique("look error"))
        .order(Order::Middle)
        .fixed_pos(rect.left_top() + vec2(12.0, 12.0));
    area.pivot(Align2::LEFT_TOP).show(ui.ctx(), |ui| {
        card().stroke(Stroke::new(1.0, theme::ERROR)).corner_radius(CornerRadius::same(6)).show(ui, |ui| {
            ui.set_max_width((rect.width() - 60.0).clamp(60.0, 560.0));
            ui.label(RichText::new(error).color(theme::TEXT).monospace());
            hint(ui, "The picture shows the look as it was before.");
        });
    });
}

/// The numbers, by table.
pub(super) fn numbers(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(live) = &mut viewer.live else { return };
    let name = live.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
    ui.label(RichText::new(name).heading().color(theme::STRONG));
    hint(ui, "The picture follows the file. What is changed here is in the file once it is saved.");
    live.notes.iter().for_each(|note| hint(ui, note));
    let mut is_saved = false;
    ui.horizontal(|ui| {
        ui.add_enabled_ui(live.is_changed(), |ui| {
            let tip = "Write the numbers into the file (Ctrl + S)";
            is_saved = ui.button("Save").on_hover_text(tip).clicked();
            if ui.button("Discard").on_hover_text("The numbers of the file again").clicked() {
                live.discard();
            }
        });
    });
    let mut changed = None;
    ui.add_enabled_ui(live.error.is_none(), |ui| {
        ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
            let mut table = String::new();
            for index in 0..live.numbers.len() {
                let key = live.numbers[index].key.to_string();
                let (of, short) = split(&key);
                if of != table {
                    heading(ui, of);
                    of.clone_into(&mut table);
                }
                changed = changed.or(slider(ui, live, index, short, &key).map(|value| (index, value)));
            }
        });
    });
    if let Some((index, value)) = changed {
        live.set(index, value);
    }
    if is_saved {
        viewer.save_look();
    }
}

/// The table of a key, as `textures.bark`, and the rest.
fn split(key: &str) -> (&str, &str) {
    let mut dots = key.match_indices('.').map(|(at, _)| at);
    let first = dots.next();
    match (first, dots.next()) {
        (_, Some(second)) => (&key[..second], &key[second + 1..]),
        (Some(first), None) => (&key[..first], &key[first + 1..]),
        (None, None) => ("", key),
    }
}

/// Returns another value, where it was changed.
fn slider(ui: &mut Ui, live: &LiveLook, index: usize, name: &str, key: &str) -> Option<f64> {
    let one = &live.numbers[index];
    let size = live.originals.get(index).copied().unwrap_or(one.value).abs();
    // Without limits, up to some times what the file says.
    let reach = if size == 0.0 { 1.0 } else { 4.0 * size };
    let low = one.low.unwrap_or(-reach).max(if size == 0.0 { -1e4 } else { -reach.max(1.0) });
    let high = one.high.unwrap_or(low.max(0.0) + reach).min(low.max(0.0) + reach.max(1.0));
    let (low, high) = (low.min(one.value), high.max(one.value));
    let mut value = one.value;
    let decimals = if one.is_whole { 0 } else { decimals_of(high - low) };
    number(name, "", decimals, key).show(ui, &mut value, low..=high);
    let is_allowed = one.low.is_none_or(|low| value >= low) && one.high.is_none_or(|high| value <= high);
    (value != one.value && is_allowed).then_some(value)
}
