//! Colours and channels.

use eframe::egui::{Checkbox, Response, RichText, Sense, TextEdit, Ui, vec2};

use super::{icons, picker, texture};
use crate::display::ShadingView;
use crate::paint::{PALETTES, PaintSettings, parse_hex, text_hex};
use crate::panels::widgets::{NumberRow, heading, named_choice, row};

use crate::viewer::Viewer;
use fantex_store::ChannelKind;

pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    texture::show(ui, viewer);
    let colors = &mut viewer.settings.paint.colors;
    picker::show(ui, &mut colors.foreground, 128.0);
    ui.horizontal(|ui| {
        let id = ui.scope_id().with("hex");
        let mut text =
            ui.data(|data| data.get_temp::<String>(id)).unwrap_or_else(|| text_hex(colors.foreground));
        let field = ui.add(
            TextEdit::singleline(&mut text).desired_width(66.0).font(eframe::egui::TextStyle::Monospace),
        );
        name_field(&field, "Colour, hexadecimal");
        if field.has_focus() {
            ui.data_mut(|data| data.insert_temp(id, text.clone()));
        } else {
            ui.data_mut(|data| data.remove::<String>(id));
        }
        if field.changed()
            && let Some(color) = parse_hex(&text)
        {
            colors.foreground = color;
        }
        for color in [colors.foreground, colors.background] {
            let (rect, _) = ui.allocate_exact_size(vec2(26.0, 20.0), Sense::hover());
            icons::swatch(ui.painter(), rect, color, false);
        }
        if ui.small_button("X").on_hover_text("Swap foreground and background (X)").clicked() {
            colors.swap();
        }
        if ui.small_button("+").on_hover_text("Keep the colour in the palette of your own").clicked()
            && !colors.own.contains(&colors.foreground)
        {
            colors.own.push(colors.foreground);
            colors.palette = PALETTES.len();
        }
    });
    let recent = colors.recent.clone();
    if !recent.is_empty()
        && let Some(color) = swatches(ui, &recent[..recent.len().min(8)], colors.foreground)
    {
        colors.foreground = color;
    }
    let names: Vec<usize> = (0..=PALETTES.len()).collect();
    ui.horizontal(|ui| {
        named_choice(ui, "Palette", &mut colors.palette, &names, |n| {
            PALETTES.get(n).map_or("My own", |(name, _)| name).to_owned()
        });
    });
    let shown = PALETTES.get(colors.palette).map_or_else(|| colors.own.clone(), |(_, all)| all.to_vec());
    if let Some(color) = swatches(ui, &shown, colors.foreground) {
        colors.foreground = color;
    }
}

/// A name for those who cannot see the field.
pub(super) fn name_field(field: &Response, name: &str) {
    field.ctx.accesskit_node_builder(field.id, |node| node.set_label(name));
}

/// Rows of small squares; returns the one that was clicked.
fn swatches(ui: &mut Ui, all: &[[u8; 3]], chosen: [u8; 3]) -> Option<[u8; 3]> {
    let mut clicked = None;
    ui.spacing_mut().item_spacing = vec2(4.0, 4.0);
    ui.horizontal_wrapped(|ui| {
        for &color in all {
            let (rect, response) = ui.allocate_exact_size(vec2(27.0, 18.0), Sense::click());
            icons::swatch(ui.painter(), rect, color, color == chosen);
            if response.on_hover_text(text_hex(color)).clicked() {
                clicked = Some(color);
            }
        }
    });
    ui.spacing_mut().item_spacing = vec2(8.0, 6.0);
    clicked
}

/// Which channels are painted, with what, and which one is shown.
pub(super) fn channels(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &viewer.painting else { return };
    heading(ui, "Channels");
    let paint = &mut viewer.settings.paint;
    for channel in painting.channels() {
        let Some((name, view)) = name_and_view(channel.kind) else { continue };
        let Some(is_painted) = paint.channels.of(channel.kind) else { continue };
        ui.horizontal(|ui| {
            ui.add(Checkbox::new(is_painted, name)).on_hover_text("Whether the brush paints it");
            ui.with_layout(eframe::egui::Layout::right_to_left(eframe::egui::Align::Center), |ui| {
                let Some(view) = view else { return };
                let is_alone = viewer.settings.display.shading == view;
                let text = RichText::new("Only").size(11.0);
                if ui.selectable_label(is_alone, text).on_hover_text("Show this channel alone").clicked() {
                    viewer.settings.display.shading = if is_alone { ShadingView::Lit } else { view };
                }
            });
        });
        material(ui, channel.kind, paint);
    }
}

/// What is painted besides the colour.
fn material(ui: &mut Ui, kind: ChannelKind, paint: &mut PaintSettings) {
    if !paint.channels.paints(kind) {
        return;
    }
    let material = &mut paint.material;
    let number = |name| NumberRow { name, ..NumberRow::PLAIN };
    match kind {
        ChannelKind::OcclusionRoughnessMetallic => {
            number("   Roughness").show(ui, &mut material.roughness, 0.0..=1.0);
            number("   Metallic").show(ui, &mut material.metallic, 0.0..=1.0);
            number("   Occlusion").show(ui, &mut material.occlusion, 0.0..=1.0);
        }
        ChannelKind::Emission => {
            row(ui, "   Emission", |ui| ui.color_edit_button_srgb(&mut material.emission));
        }
        ChannelKind::Displacement => number("   Height").show(ui, &mut material.height, 0.0..=1.0),
        ChannelKind::BaseColor | ChannelKind::Normal | ChannelKind::Light | ChannelKind::Anisotropy => {}
    }
}

fn name_and_view(kind: ChannelKind) -> Option<(&'static str, Option<ShadingView>)> {
    match kind {
        ChannelKind::BaseColor => Some(("Base colour", Some(ShadingView::BaseColor))),
        ChannelKind::Normal => Some(("Normal (back to smooth)", Some(ShadingView::Normal))),
        ChannelKind::OcclusionRoughnessMetallic => {
            Some(("Roughness, metallic", Some(ShadingView::OcclusionRoughnessMetallic)))
        }
        ChannelKind::Emission => Some(("Emission", Some(ShadingView::Emission))),
        ChannelKind::Displacement => Some(("Displacement", None)),
        ChannelKind::Light | ChannelKind::Anisotropy => None,
    }
}
