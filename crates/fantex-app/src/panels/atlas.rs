//! The live atlas: what of the texture lies in the graphics memory right now.

use eframe::egui::{Color32, ComboBox, Image, Layout, RichText, ScrollArea, Ui, load::SizedTexture, vec2};

use super::AtlasTextures;
use super::widgets::hint;
use crate::theme;
use crate::viewer::Viewer;

/// Returns the channel that was chosen, if another was.
pub(super) fn show(ui: &mut Ui, viewer: &Viewer, atlas: &AtlasTextures) -> Option<usize> {
    let mut chosen = None;
    ui.horizontal(|ui| {
        ui.label(RichText::new("Live atlas").color(theme::STRONG));
        ui.with_layout(Layout::right_to_left(eframe::egui::Align::Center), |ui| {
            chosen = channel(ui, viewer, atlas);
        });
    });
    ui.separator();
    if atlas.layers.is_empty() {
        hint(ui, match viewer.document {
            None => "Open an asset: its tiles appear here as they are streamed.",
            Some(_) => "Only assets (.fan) are streamed through an atlas.",
        });
        return None;
    }
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        let width = ui.available_width();
        for (layer, &id) in atlas.layers.iter().enumerate() {
            if atlas.layers.len() > 1 {
                hint(ui, &format!("Layer {} of {}", layer + 1, atlas.layers.len()));
            }
            let image = Image::from_texture(SizedTexture::new(id, vec2(width, width))).bg_fill(Color32::BLACK);
            ui.add(image).on_hover_text(format!("{0} × {0} texels", atlas.side));
        }
        hint(ui, "Tiles of all levels share it; those that are not needed make room.");
    });
    chosen
}

fn channel(ui: &mut Ui, viewer: &Viewer, atlas: &AtlasTextures) -> Option<usize> {
    let channels = viewer.document.as_ref().map(|document| &document.channels).filter(|all| all.len() > 1)?;
    let mut now = atlas.channel.min(channels.len() - 1);
    let before = now;
    let list = ComboBox::from_id_salt("atlas channel").selected_text(channels[now].kind).show_ui(ui, |ui| {
        for (i, channel) in channels.iter().enumerate() {
            ui.selectable_value(&mut now, i, channel.kind);
        }
    });
    list.response.on_hover_text("The channel that is shown");
    (now != before).then_some(now)
}
