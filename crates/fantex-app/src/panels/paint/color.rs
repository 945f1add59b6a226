//! Colours and channels.

use std::path::PathBuf;
use std::sync::Arc;

use eframe::egui::ecolor::{hsv_from_rgb, rgb_from_hsv};
use eframe::egui::{
    Align, Checkbox, Color32, ColorImage, CornerRadius, Layout, Mesh, Rect, Response, RichText, Sense, Shape,
    Stroke, StrokeKind, TextEdit, TextStyle, Ui, Vec2, pos2, vec2,
};
use fantex::store::ChannelKind;

use crate::display::ShadingView;
use crate::paint::{
    Alone, ColorSource, FileState, PALETTES, PaintSettings, SOLIDS, TextureChoice, channel_name,
    color_of_hex, parse_hex, text_hex,
};
use crate::panels::widgets::{
    Itself, cached_texture, file_button, framed_picture, named_choice, number, row, segments,
};
use crate::theme;
use crate::viewer::{FileDialog, Request, Viewer};

pub(crate) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    texture_choice(ui, viewer);
    let colors = &mut viewer.settings.paint.colors;
    picker(ui, &mut colors.foreground, 128.0);
    ui.horizontal(|ui| {
        let id = ui.scope_id().with("hex");
        let mut text =
            ui.data(|data| data.get_temp::<String>(id)).unwrap_or_else(|| text_hex(colors.foreground));
        let field = ui.add(TextEdit::singleline(&mut text).desired_width(66.0).font(TextStyle::Monospace));
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
            super::swatch(ui.painter(), rect, color, false);
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
    let names = PALETTES.iter().map(|(name, _)| *name).chain(["My own"]);
    let names: Vec<(usize, &str)> = names.enumerate().collect();
    ui.horizontal(|ui| named_choice(ui, "Palette", &mut colors.palette, &names));
    let shown = match PALETTES.get(colors.palette) {
        Some((_, all)) => all.map(color_of_hex).to_vec(),
        None => colors.own.clone(),
    };
    if let Some(color) = swatches(ui, &shown, colors.foreground) {
        colors.foreground = color;
    }
}

/// A name for those who cannot see the field.
pub(crate) fn name_field(field: &Response, name: &str) {
    field.ctx.accesskit_node_builder(field.id, |node| node.set_label(name));
}

/// Rows of small squares; returns the one that was clicked.
fn swatches(ui: &mut Ui, all: &[[u8; 3]], chosen: [u8; 3]) -> Option<[u8; 3]> {
    let mut clicked = None;
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing = vec2(4.0, 4.0);
        for &color in all {
            let (rect, response) = ui.allocate_exact_size(vec2(27.0, 18.0), Sense::click());
            super::swatch(ui.painter(), rect, color, color == chosen);
            if response.on_hover_text(text_hex(color)).clicked() {
                clicked = Some(color);
            }
        }
    });
    clicked
}

/// Which channels are painted, with what, and which one is shown.
pub(crate) fn channels(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &viewer.painting else { return };
    let known: Vec<ChannelKind> = painting.channels.iter().map(|channel| channel.kind).collect();
    let missing: Vec<ChannelKind> = ADDED.into_iter().filter(|kind| !known.contains(kind)).collect();
    let (mut added, mut removed) = (None, None);
    ui.add_space(6.0);
    ui.horizontal(|ui| {
        ui.label(RichText::new("Channels").color(theme::STRONG).strong());
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            removed = kind_menu(
                ui,
                "Remove channel",
                &known,
                "Take a channel out of the asset, with what it holds",
            );
            if !missing.is_empty() {
                let tip = "Give the asset a further channel; it looks as before until that is painted";
                added = kind_menu(ui, "Add channel", &missing, tip);
            }
        });
    });
    let has_color = known.contains(&ChannelKind::BaseColor);
    let is_height_alone = painting.seen_alone == Some(Alone::Height);
    let (mut sees_height, mut chosen) = (is_height_alone, None);
    let paint = &mut viewer.settings.paint;
    for channel in &painting.channels {
        let Some(name) = switch_name(channel.kind) else { continue };
        let view = ShadingView::of_channel(channel.kind);
        let Some(is_painted) = paint.channels.of(channel.kind) else { continue };
        ui.horizontal(|ui| {
            ui.add(Checkbox::new(is_painted, name)).on_hover_text("Whether the brush paints it");
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                let text = RichText::new("Only").size(11.0);
                let tip = "Show this channel alone";
                match view {
                    Some(view) => {
                        let is_alone = viewer.settings.display.shading == view && !is_height_alone;
                        if ui.selectable_label(is_alone, text).on_hover_text(tip).clicked() {
                            chosen = Some(if is_alone { ShadingView::Lit } else { view });
                            sees_height = false;
                        }
                    }
                    // It is shown in the place of the base colour.
                    None if has_color => {
                        let tip = "Show the height alone: black is carved most, white raised most";
                        if ui.selectable_label(is_height_alone, text).on_hover_text(tip).clicked() {
                            sees_height = !is_height_alone;
                        }
                    }
                    None => {}
                }
            });
        });
        material(ui, channel.kind, paint);
    }
    if sees_height != is_height_alone {
        viewer.see_height(sees_height);
    }
    if let Some(shading) = chosen {
        viewer.settings.display.shading = shading;
    }
    if let Some(kind) = removed {
        viewer.ask_removal(kind);
    }
    if let Some(kind) = added {
        // Height is seen by the normals that follow it.
        let with_normals = [ChannelKind::Normal, ChannelKind::Displacement];
        viewer.add_channels(if kind == ChannelKind::Displacement {
            &with_normals
        } else {
            std::slice::from_ref(&kind)
        });
    }
}

/// Channels that can be added.
const ADDED: [ChannelKind; 5] = [
    ChannelKind::BaseColor,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Emission,
    ChannelKind::Normal,
    ChannelKind::Displacement,
];

/// A menu of channels; returns the one that was chosen.
fn kind_menu(ui: &mut Ui, text: &str, kinds: &[ChannelKind], tip: &str) -> Option<ChannelKind> {
    let mut chosen = None;
    let menu = ui.menu_button(RichText::new(text).size(11.0), |ui| {
        for &kind in kinds {
            if ui.button(channel_name(kind)).clicked() {
                chosen = Some(kind);
                ui.close();
            }
        }
    });
    menu.response.on_hover_text(tip);
    chosen
}

/// What is painted besides the colour.
fn material(ui: &mut Ui, kind: ChannelKind, paint: &mut PaintSettings) {
    if !paint.channels.of(kind).is_some_and(|is_painted| *is_painted) {
        return;
    }
    let components = &mut paint.channels.components;
    let material = &mut paint.material;
    let number = |name, tip| number(name, "", 2, tip);
    match kind {
        ChannelKind::OcclusionRoughnessMetallic => {
            let rows = [
                (1, "Roughness", &mut material.roughness),
                (2, "Metallic", &mut material.metallic),
                (0, "Occlusion", &mut material.occlusion),
            ];
            for (component, name, value) in rows {
                ui.horizontal(|ui| {
                    ui.add_space(8.0);
                    ui.spacing_mut().item_spacing.x = 4.0;
                    let switch = Checkbox::without_text(&mut components[component]);
                    name_field(&ui.add(switch).on_hover_text("Whether the brush changes it"), name);
                    ui.add_enabled_ui(components[component], |ui| {
                        ui.spacing_mut().slider_width = 74.0;
                        number(name, "").show(ui, value, 0.0..=1.0);
                    });
                });
            }
        }
        ChannelKind::Emission => {
            row(ui, "   Emission", |ui| ui.color_edit_button_srgb(&mut material.emission));
        }
        ChannelKind::Displacement => {
            let tip = "0.5 is level, more is raised, less is carved; the normals follow";
            number("   Height", tip).show(ui, &mut material.height, 0.0..=1.0);
        }
        ChannelKind::BaseColor | ChannelKind::Normal | ChannelKind::Light | ChannelKind::Anisotropy => {}
    }
}

/// The name of the switch by which the brush paints a channel.
fn switch_name(kind: ChannelKind) -> Option<&'static str> {
    match kind {
        ChannelKind::BaseColor => Some("Base colour"),
        ChannelKind::Normal => Some("Normal (back to smooth)"),
        ChannelKind::OcclusionRoughnessMetallic => Some("Roughness, metallic"),
        ChannelKind::Emission => Some("Emission"),
        ChannelKind::Displacement => Some("Height"),
        ChannelKind::Light | ChannelKind::Anisotropy => None,
    }
}

// What the base colour comes from: the foreground, a pattern in space, a texture of a look.

/// Texels of the preview.
const PREVIEW: [usize; 2] = [124, 40];

fn texture_choice(ui: &mut Ui, viewer: &mut Viewer) {
    let choice = &mut viewer.settings.paint.texture;
    let sources = ui.horizontal(|ui| segments(ui, &mut choice.source, &ColorSource::ALL));
    sources.response.on_hover_text("What is painted with: a colour, a pattern in space, a texture of a look");
    let mut asks_file = false;
    match choice.source {
        ColorSource::Color => return,
        ColorSource::Solid => solid(ui, choice),
        ColorSource::Look => asks_file = look(ui, choice),
    }
    texture_preview(ui, viewer);
    if asks_file {
        viewer.request(Request::Dialog(FileDialog::Look));
    }
}

fn solid(ui: &mut Ui, choice: &mut TextureChoice) {
    let mut now = SOLIDS.into_iter().find(|name| *name == choice.solid).unwrap_or(SOLIDS[0]);
    let named = |name: &'static str| (name, format!("{}{}", name[..1].to_uppercase(), &name[1..]));
    ui.horizontal(|ui| named_choice(ui, "Pattern", &mut now, &SOLIDS.map(named)));
    if now != choice.solid {
        choice.solid = now.to_owned();
    }
    let scale = number("Scale", "", 2, "Size of the pattern; 1 fits the model");
    scale.logarithmic().show(ui, &mut choice.scale, 0.02..=10.0);
    let seed = number("Seed", "", 0, "Another seed is another piece");
    seed.show(ui, &mut choice.seed, 0..=99);
}

/// Returns whether another file is wanted.
fn look(ui: &mut Ui, choice: &mut TextureChoice) -> bool {
    let tip = "A look: a TOML file with textures";
    let is_asked = row(ui, "Look", |ui| file_button(ui, choice.look.as_deref(), tip)).clicked();
    let names = known_names(ui, choice);
    if !names.is_empty() {
        let places: Vec<(usize, &String)> = names.iter().enumerate().collect();
        let mut at = names.iter().position(|name| *name == choice.name).unwrap_or(0);
        ui.horizontal(|ui| named_choice(ui, "Texture", &mut at, &places));
        if choice.name != names[at] {
            choice.name.clone_from(&names[at]);
        }
    }
    is_asked
}

/// The names of the look's textures; read once, and whenever its file has changed.
fn known_names(ui: &Ui, choice: &TextureChoice) -> Vec<String> {
    let id = ui.scope_id().with("names of textures");
    type Key = (Option<PathBuf>, FileState);
    let known = ui.data(|data| data.get_temp::<(Key, Vec<String>)>(id));
    let key = (choice.look.clone(), choice.file_state());
    if let Some((_, names)) = known.filter(|(of, _)| *of == key) {
        return names;
    }
    // What is wrong with it is said by the preview.
    let graph = choice.graph().ok().flatten();
    let names = graph.and_then(|(graph, _)| graph.names().ok()).unwrap_or_default();
    ui.data_mut(|data| data.insert_temp(id, (key, names.clone())));
    names
}

/// A piece of the texture, or what is wrong with it.
fn texture_preview(ui: &mut Ui, viewer: &mut Viewer) {
    let choice = viewer.settings.paint.texture.clone();
    let Some(painting) = &mut viewer.painting else { return };
    let made = match painting.texture(&choice) {
        Ok(made) => made,
        Err(reason) => {
            ui.label(RichText::new(reason).small().color(theme::WARNING));
            return;
        }
    };
    let Some(made) = made else { return };
    let id = ui.scope_id().with("texture preview");
    let texture = cached_texture(ui, id, Itself(Arc::clone(&made.texture)), || {
        let pixels = made.preview(&painting.surface, PREVIEW);
        ColorImage::new(PREVIEW, pixels.into_iter().map(color32).collect())
    });
    let response = framed_picture(ui, &texture, 2.0 * vec2(PREVIEW[0] as f32, PREVIEW[1] as f32));
    response.on_hover_text("A slanting cut through the model's middle, as wide as the model");
}

// A colour by saturation and value in a square and hue beside it.

/// Hue, saturation, value, each 0..1, of sRGB values.
fn hsv_of(color: [u8; 3]) -> [f32; 3] {
    hsv_from_rgb(color.map(|c| f32::from(c) / 255.0)).into()
}

fn rgb_of([h, s, v]: [f32; 3]) -> [u8; 3] {
    rgb_from_hsv((h, s, v)).map(|c| (c * 255.0).round() as u8)
}

fn color32([r, g, b]: [u8; 3]) -> Color32 {
    Color32::from_rgb(r, g, b)
}

/// Edits a colour. Hue and saturation of greys are remembered.
fn picker(ui: &mut Ui, color: &mut [u8; 3], height: f32) {
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

fn square(ui: &mut Ui, hsv: &mut [f32; 3], size: Vec2) {
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    if let Some(at) = response.interact_pointer_pos() {
        let share = (at - rect.min) / rect.size();
        hsv[1] = share.x.clamp(0.0, 1.0);
        hsv[2] = 1.0 - share.y.clamp(0.0, 1.0);
    }
    let pure = color32(rgb_of([hsv[0], 1.0, 1.0]));
    let clear = Color32::TRANSPARENT;
    ui.painter().add(quad(rect, [Color32::WHITE, pure, pure, Color32::WHITE]));
    ui.painter().add(quad(rect, [clear, clear, Color32::BLACK, Color32::BLACK]));
    frame(ui, rect);
    let knob = pos2(rect.left() + hsv[1] * rect.width(), rect.top() + (1.0 - hsv[2]) * rect.height());
    ui.painter().circle_filled(knob, 5.5, color32(rgb_of(*hsv)));
    ui.painter().circle_stroke(knob, 6.0, Stroke::new(2.0, Color32::BLACK));
    ui.painter().circle_stroke(knob, 6.0, Stroke::new(1.2, Color32::WHITE));
}

fn hue_bar(ui: &mut Ui, hsv: &mut [f32; 3], size: Vec2) {
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    if let Some(at) = response.interact_pointer_pos() {
        hsv[0] = ((at.y - rect.top()) / rect.height()).clamp(0.0, 0.9999);
    }
    for part in 0..6 {
        let [from, to] = [part, part + 1].map(|n| n as f32 / 6.0);
        let [a, b] = [from, to].map(|h| color32(rgb_of([h, 1.0, 1.0])));
        let y = |t: f32| rect.top() + t * rect.height();
        let part = Rect::from_x_y_ranges(rect.x_range(), y(from)..=y(to));
        ui.painter().add(quad(part, [a, a, b, b]));
    }
    frame(ui, rect);
    let y = rect.top() + hsv[0] * rect.height();
    let mark = Rect::from_center_size(pos2(rect.center().x, y), vec2(rect.width() + 4.0, 6.0));
    for (width, color) in [(3.0, Color32::BLACK), (1.5, Color32::WHITE)] {
        let stroke = Stroke::new(width, color);
        ui.painter().rect_stroke(mark, CornerRadius::same(2), stroke, StrokeKind::Middle);
    }
}

fn frame(ui: &Ui, rect: Rect) {
    ui.painter().rect_stroke(rect, CornerRadius::same(2), Stroke::new(1.0, theme::LINE), StrokeKind::Outside);
}

/// A rectangle whose corners have colours of their own, from the upper left one clockwise.
fn quad(rect: Rect, colors: [Color32; 4]) -> Shape {
    let corners = [rect.left_top(), rect.right_top(), rect.right_bottom(), rect.left_bottom()];
    let mut mesh = Mesh::default();
    corners.into_iter().zip(colors).for_each(|(corner, color)| mesh.colored_vertex(corner, color));
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
