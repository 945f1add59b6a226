//! The layers, the one on top first, and what can be done with the chosen one.

use eframe::egui::{
    Align, Button, Color32, CornerRadius, Key, Label, Layout, Response, RichText, Sense, Slider, TextEdit,
    Ui, UiBuilder, vec2,
};
use fantex::paint::{BlendMode, Layer, LayerContent, Target};

use crate::paint::{BLEND_MODES, LayerAction, Painting};
use crate::panels::widgets::{choice, heading, hint, row};
use crate::settings::label_of;
use crate::theme;
use crate::viewer::Viewer;

pub(crate) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &mut viewer.painting else { return };
    let mut actions = Vec::new();
    heading(ui, "Layers");
    buttons(ui, painting, &mut actions);
    let layers = painting.snapshot.layers.clone();
    for layer in layers.iter().rev() {
        layer_row(ui, painting, layer, &mut actions);
    }
    base_row(ui, painting.target == Target::Base, &mut actions);
    if let Some(layer) = painting.layer().cloned() {
        chosen(ui, painting, &layer, &mut actions);
    } else if layers.is_empty() {
        hint(ui, "Paint goes onto the base. On a layer it can be erased, hidden and mixed later.");
    }
    for action in actions {
        viewer.layer_action(&action);
    }
}

fn buttons(ui: &mut Ui, painting: &Painting, actions: &mut Vec<LayerAction>) {
    let chosen = painting.layer().map(Layer::id);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        if ui.button("Add").on_hover_text("An empty layer above the chosen one (Ctrl + Shift + N)").clicked()
        {
            actions.push(LayerAction::Add);
        }
        let menu = ui.menu_button("Add fill", |ui| {
            let choices = [
                (false, "Hidden: paint its mask white", "Its mask is black at first"),
                (true, "Everywhere", "Over the whole model, without a mask"),
            ];
            for (is_everywhere, text, tip) in choices {
                if ui.button(text).on_hover_text(tip).clicked() {
                    actions.push(LayerAction::AddFill(is_everywhere));
                    ui.close();
                }
            }
        });
        menu.response.on_hover_text("A layer of the current colour, pattern or look, and material");
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            ui.add_enabled_ui(chosen.is_some(), |ui| {
                let id = chosen.unwrap_or_default();
                if ui.button("Delete").on_hover_text("Delete the chosen layer").clicked() {
                    actions.push(LayerAction::Delete(id));
                }
                for (is_up, tip) in [(false, "Down"), (true, "Up")] {
                    let response = ui.add(Button::new("").min_size(vec2(24.0, 22.0)));
                    let color = if chosen.is_some() { theme::TEXT } else { theme::FAINT };
                    super::arrow(ui.painter(), response.rect, is_up, color);
                    if response.on_hover_text(tip).clicked() {
                        actions.push(LayerAction::Move(id, is_up));
                    }
                }
            });
        });
    });
}

/// A line of the list: eye, name, mask.
fn layer_row(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    let is_layer = painting.target == Target::Layer(id);
    let is_mask = painting.target == Target::Mask(id);
    frame_row(ui, is_layer || is_mask, |ui| {
        let (rect, response) = ui.allocate_exact_size(vec2(20.0, 22.0), Sense::click());
        super::eye(ui.painter(), rect, layer.visible, if layer.visible { theme::TEXT } else { theme::FAINT });
        if response.on_hover_text("Show or hide").clicked() {
            actions.push(LayerAction::Show(id, !layer.visible));
        }
        if rename(ui, painting, layer, actions) {
            return;
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            if layer.mask.is_some() {
                let text = RichText::new("Mask").size(11.0);
                if ui
                    .selectable_label(is_mask, text)
                    .on_hover_text("Paint on the mask: white shows, black hides")
                    .clicked()
                {
                    actions.push(LayerAction::Select(Target::Mask(id)));
                }
            }
            let faded =
                if layer.opacity < 0.995 { format!("{:.0} %", layer.opacity * 100.0) } else { String::new() };
            let mode =
                if layer.blend == BlendMode::Normal { "" } else { label_of(&BLEND_MODES, layer.blend) };
            ui.label(RichText::new(format!("{mode} {faded}").trim()).size(11.0).color(theme::FAINT));
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let color = if layer.visible { theme::STRONG } else { theme::FAINT };
                let response = name_label(ui, &layer.name, color).on_hover_text("Double click renames");
                if response.double_clicked() {
                    painting.renaming = Some((id, layer.name.clone()));
                } else if response.clicked() {
                    actions.push(LayerAction::Select(Target::Layer(id)));
                }
            });
        });
    });
}

/// The name while it is edited. False where it is not.
fn rename(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) -> bool {
    let Some((_, name)) = painting.renaming.as_mut().filter(|(id, _)| *id == layer.id()) else {
        return false;
    };
    let field = ui.add(TextEdit::singleline(name).desired_width(180.0));
    if field.lost_focus() {
        let is_kept =
            !ui.input(|i| i.key_pressed(Key::Escape)) && !name.trim().is_empty() && *name != layer.name;
        if is_kept {
            actions.push(LayerAction::Rename(layer.id(), name.trim().to_owned()));
        }
        painting.renaming = None;
    } else {
        field.request_focus();
    }
    true
}

fn base_row(ui: &mut Ui, is_chosen: bool, actions: &mut Vec<LayerAction>) {
    frame_row(ui, is_chosen, |ui| {
        ui.add_space(28.0);
        if name_label(ui, "Base", theme::STRONG).on_hover_text("What was baked, under all layers").clicked() {
            actions.push(LayerAction::Select(Target::Base));
        }
    });
}

/// A name that can be clicked, over all the room that is left.
fn name_label(ui: &mut Ui, name: &str, color: Color32) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 22.0), Sense::click());
    let label = Label::new(RichText::new(name).color(color)).truncate().selectable(false);
    let layout = Layout::left_to_right(Align::Center);
    ui.scope_builder(UiBuilder::new().max_rect(rect).layout(layout), |ui| ui.add(label));
    response
}

fn frame_row(ui: &mut Ui, is_chosen: bool, add: impl FnOnce(&mut Ui)) {
    let size = vec2(ui.available_width(), 26.0);
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let fill = if is_chosen { Color32::from_rgb(0x2f, 0x46, 0x5c) } else { theme::WELL };
    ui.painter().rect_filled(rect, CornerRadius::same(4), fill);
    let layout = Layout::left_to_right(Align::Center);
    ui.scope_builder(UiBuilder::new().max_rect(rect.shrink2(vec2(6.0, 2.0))).layout(layout), add);
    ui.add_space(-3.0);
}

/// Blending, opacity, mask and channels of the chosen layer.
fn chosen(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    ui.add_space(4.0);
    let mut mode = layer.blend;
    row(ui, "Blend", |ui| choice(ui, "layer blend", &mut mode, &BLEND_MODES));
    if mode != layer.blend {
        actions.push(LayerAction::Blend(id, mode));
    }
    let mut opacity =
        painting.fading.filter(|(of, _)| *of == id).map_or(layer.opacity, |(_, value)| value) * 100.0;
    let response = row(ui, "Opacity", |ui| {
        ui.add(Slider::new(&mut opacity, 0.0..=100.0).suffix(" %").fixed_decimals(0))
    });
    // One step of the history per drag, not one per frame.
    if response.dragged() {
        painting.fading = Some((id, opacity / 100.0));
    } else if response.drag_stopped() || response.changed() {
        painting.fading = None;
        actions.push(LayerAction::Opacity(id, opacity / 100.0));
    } else if painting.fading.is_some_and(|(of, value)| of != id || (value - layer.opacity).abs() < 1e-3) {
        painting.fading = None;
    }
    if !matches!(layer.content, LayerContent::Painted) {
        ui.horizontal(|ui| {
            ui.label(RichText::new("Shows").color(theme::FAINT));
            ui.label(fill_name(layer));
            let tip = "It shows the current colour, pattern or look, and material instead";
            if ui.small_button("Change").on_hover_text(tip).clicked() {
                actions.push(LayerAction::Refill(id));
            }
        });
    }
    ui.horizontal(|ui| {
        ui.label(RichText::new("Mask").color(theme::FAINT));
        if layer.mask.is_some() {
            if ui.small_button("Remove").on_hover_text("The layer is shown everywhere again").clicked() {
                actions.push(LayerAction::RemoveMask(id));
            }
        } else {
            for (text, shows) in [("Add white", true), ("Add black", false)] {
                let tip = if shows {
                    "Shows all until it is painted black"
                } else {
                    "Hides all until it is painted white"
                };
                if ui.small_button(text).on_hover_text(tip).clicked() {
                    actions.push(LayerAction::AddMask(id, shows));
                }
            }
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("Shows in").color(theme::FAINT));
        for (index, channel) in painting.channels.iter().enumerate() {
            let is_shown = layer.channels.get(index).copied().unwrap_or(true);
            if ui.selectable_label(is_shown, RichText::new(short_name(channel.kind)).size(11.0)).clicked() {
                actions.push(LayerAction::Channel(id, index, !is_shown));
            }
        }
    });
}

/// What a fill layer shows.
fn fill_name(layer: &Layer) -> String {
    let LayerContent::Graph(fill) = &layer.content else { return "a colour".into() };
    let name = fill.textures.iter().flatten().next().cloned().unwrap_or_default();
    let solid = fill.graph.look.lines().find_map(|line| line.strip_prefix("kind = "));
    if name == "pattern" { solid.unwrap_or("").trim_matches('"').to_owned() } else { name }
}

fn short_name(kind: fantex::store::ChannelKind) -> &'static str {
    use fantex::store::ChannelKind::{
        Anisotropy, BaseColor, Displacement, Emission, Light, Normal, OcclusionRoughnessMetallic,
    };
    match kind {
        BaseColor => "Colour",
        Normal => "Normal",
        OcclusionRoughnessMetallic => "Material",
        Emission => "Emission",
        Displacement => "Height",
        Light => "Light",
        Anisotropy => "Anisotropy",
    }
}
