//! The page about the cover by partial fans.

use eframe::egui::Ui;

use super::widgets::{choice, document_facts, facts, heading, hint};
use crate::display::Overlay;
use crate::viewer::Viewer;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(document) = &viewer.document else {
        return hint(ui, "Open an asset to see how partial fans cover it.");
    };
    if document.asset().is_none() {
        return hint(
            ui,
            "A model has its own texture coordinates and no cover. 'fantex bake' makes an asset of it.",
        );
    }
    heading(ui, "Cover");
    document_facts(ui, "cover facts", &document.cover_facts);
    heading(ui, "Channels");
    facts(ui, "channels", document.channels.iter().map(|channel| (channel.kind, channel.format.clone())));
    heading(ui, "Overlay");
    let overlay = &mut viewer.settings.display.overlay;
    choice(ui, "overlay of the cover", overlay, &Overlay::ALL, |o| o.label().into());
    hint(ui, overlay.meaning());
}
