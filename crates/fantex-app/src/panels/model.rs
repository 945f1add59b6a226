//! The page about the model.

use eframe::egui::{RichText, Ui};

use super::widgets::{document_facts, heading, hint};
use crate::theme;
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &Viewer) {
    let Some(document) = &viewer.document else {
        return hint(ui, "Open a model or an asset to see what it is made of.");
    };
    heading(ui, &document.place.name());
    ui.label(RichText::new(document.place.to_string()).small().color(theme::FAINT));
    ui.add_space(4.0);
    document_facts(ui, "model facts", &document.model_facts);
    heading(ui, "Report");
    if document.notes.is_empty() {
        hint(
            ui,
            match document.asset() {
                Some(_) => "An asset holds a cleaned mesh: there is nothing to report.",
                None => "The mesh is clean: nothing was dropped, welded or turned.",
            },
        );
    }
    for note in &document.notes {
        ui.horizontal_top(|ui| {
            ui.label(RichText::new("•").color(theme::FAINT));
            ui.add(eframe::egui::Label::new(note).wrap());
        });
    }
}
