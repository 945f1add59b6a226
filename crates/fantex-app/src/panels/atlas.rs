//! The live atlas: what of the texture lies in the graphics memory right now.

use eframe::egui::{Align, Color32, ComboBox, Image, Layout, RichText, Ui, load::SizedTexture, vec2};

use super::AtlasTexture;
use super::widgets::hint;
use crate::theme;
use crate::viewer::Viewer;

/// Returns the channel that was chosen, if another was.
pub(super) fn show(ui: &mut Ui, viewer: &Viewer, atlas: &AtlasTexture) -> Option<usize> {
    let mut chosen = None;
    ui.horizontal(|ui| {
        ui.label(RichText::new("Live atlas").color(theme::STRONG));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            chosen = channel(ui, viewer, atlas);
        });
    });
    ui.separator();
    let Some(id) = atlas.id else {
        hint(
            ui,
            match viewer.document {
                None => "Open an asset: its tiles appear here as they are streamed.",
                Some(_) => "Only assets (.fan) are streamed through an atlas.",
            },
        );
        return None;
    };
    let [width, height] = atlas.extent.map(|n| n.max(1) as f32);
    let room = ui.available_size() - vec2(0.0, 44.0);
    let scale = (room.x / width).min(room.y / height).max(0.0);
    let size = vec2(width, height) * scale;
    ui.add(Image::from_texture(SizedTexture::new(id, size)).bg_fill(Color32::BLACK));
    let figures = &viewer.figures;
    let used = format!(
        "{:.0} % in use, {} × {} texels",
        figures.occupancy() * 100.0,
        atlas.extent[0],
        atlas.extent[1]
    );
    ui.label(RichText::new(used).color(theme::TEXT));
    hint(ui, "Tiles of all levels share it; those that are not needed make room.");
    chosen
}

fn channel(ui: &mut Ui, viewer: &Viewer, atlas: &AtlasTexture) -> Option<usize> {
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
