//! The steps that were done: a click goes back to one, or forth.

use eframe::egui::{Button, RichText, ScrollArea, Ui, vec2};

use crate::panels::widgets::heading;
use crate::theme;
use crate::viewer::Viewer;

/// Steps in sight at a time.
const SHOWN: usize = 8;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &mut viewer.painting else { return };
    let snapshot = painting.snapshot();
    heading(ui, "History");
    let mut chosen = None;
    let height = SHOWN as f32 * 24.0;
    let list = ScrollArea::vertical().id_salt("history").max_height(height).auto_shrink([false, true]);
    list.stick_to_bottom(true).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = 1.0;
        let size = vec2(ui.available_width(), 22.0);
        let line =
            |ui: &mut Ui, is_on: bool, text: RichText| ui.add(Button::selectable(is_on, text).min_size(size));
        let first = if snapshot.older > 0 {
            format!("{} older steps", snapshot.older)
        } else {
            "As it was opened first".to_owned()
        };
        let is_first = snapshot.done.is_empty();
        if line(ui, is_first, RichText::new(first).color(theme::FAINT)).clicked() {
            chosen = Some(snapshot.older);
        }
        let count = snapshot.done.len();
        for (index, label) in snapshot.done.iter().enumerate() {
            let number = snapshot.older + index + 1;
            if line(ui, index + 1 == count, RichText::new(format!("{number}   {label}"))).clicked() {
                chosen = Some(number);
            }
        }
        for (index, label) in snapshot.undone.iter().rev().enumerate() {
            let number = snapshot.older + count + index + 1;
            let text = RichText::new(format!("{number}   {label}")).color(theme::FAINT).italics();
            if line(ui, false, text).on_hover_text("Taken back; a click does it again").clicked() {
                chosen = Some(number);
            }
        }
    });
    if let Some(number) = chosen {
        painting.go_to_step(number);
    }
}
