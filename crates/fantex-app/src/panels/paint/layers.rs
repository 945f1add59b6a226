//! The layers, the one on top first, and what can be done with the chosen one.

use eframe::egui::{
    Align, Button, Color32, ColorImage, CornerRadius, CursorIcon, Id, Key, Label, Layout, Rect, Response,
    RichText, Sense, Shape, Slider, Stroke, StrokeKind, TextEdit, Ui, UiBuilder, WidgetInfo, accesskit, pos2,
    vec2,
};
use fantex::paint::{
    BlendMode, GroupKind, Layer, LayerContent, LayerPlace, MaskMeasure, MaskSource, Target, layer_below,
};

use crate::paint::{
    BLEND_MODES, LayerAction, LayerDrag, LayerRow, Painting, THUMBNAIL, drop_place, layer_rows,
};
use crate::panels::paint::brush::alpha_shown;
use crate::panels::widgets::{
    Itself, cached_texture, choice, decimals_of, heading, hint, is_held, number, row, segments,
};
use crate::settings::label_of;
use crate::theme;
use crate::viewer::Viewer;

/// Points of a line of the list, and of the pictures in it.
const ROW: f32 = 34.0;
const PICTURE: f32 = 28.0;

/// Points by which what lies in a group is moved to the right.
const INDENT: f32 = 14.0;

pub(crate) fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let Some(painting) = &mut viewer.painting else { return };
    let mut actions = Vec::new();
    heading(ui, "Layers");
    buttons(ui, painting, &mut actions);
    let layers = painting.layers_in_order();
    let dragged = painting.moving.as_ref().map(|moving| moving.id);
    let rows = layer_rows(&layers, &painting.snapshot.collapsed, dragged);
    let top = ui.cursor().top();
    for (row, layer) in &rows {
        layer_row(ui, painting, *row, layer, &mut actions);
    }
    let height = (ui.cursor().top() - top) / rows.len().max(1) as f32;
    let rows: Vec<LayerRow> = rows.into_iter().map(|(row, _)| row).collect();
    drag(ui, painting, &rows, (top, height), &mut actions);
    base_row(ui, painting, &mut actions);
    if let Some(layer) = painting.layer().cloned() {
        chosen(ui, painting, &layer, &mut actions);
        if layer.erases() {
            alpha_shown(ui, viewer);
        }
    } else if layers.is_empty() {
        hint(ui, "Paint goes onto the base. On a layer it can be erased, hidden and mixed later.");
    }
    for action in actions {
        viewer.layer_action(&action);
    }
}

/// Lets the layer that is being dragged change places with those it passes. `place`: where the list begins, and the height of a line.
fn drag(
    ui: &Ui,
    painting: &mut Painting,
    rows: &[LayerRow],
    (top, height): (f32, f32),
    actions: &mut Vec<LayerAction>,
) {
    let Some(moving) = &mut painting.moving else { return };
    if !ui.input(|i| i.pointer.primary_down()) {
        painting.moving = None;
        return;
    }
    ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    let Some(at) = ui.input(|i| i.pointer.interact_pos()) else { return };
    let row = ((at.y - top) / height.max(1.0)).max(0.0) as usize;
    let steps = ((at.x - moving.right) / INDENT) as i32;
    let Some(place) = drop_place(rows, moving.id, row, steps) else { return };
    moving.right = at.x;
    actions.push(LayerAction::MoveTo(moving.id, place, moving.place.is_some()));
    moving.place = Some(place);
    if let LayerPlace::Into(group) = place
        && painting.snapshot.collapsed.contains(&group)
    {
        actions.push(LayerAction::Collapse(group, false));
    }
}

fn buttons(ui: &mut Ui, painting: &Painting, actions: &mut Vec<LayerAction>) {
    let chosen = painting.layer().map(Layer::id);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        // All of them in one line.
        ui.spacing_mut().button_padding.x = 5.0;
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
        ui.add_enabled_ui(chosen.is_some(), |ui| {
            if ui.button("Group").on_hover_text("Put the chosen layer into a group (Ctrl + G)").clicked() {
                actions.push(LayerAction::Group(chosen.unwrap_or_default()));
            }
        });
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

/// A line of the list: eye, pictures of what the layer and its mask hold (of a group a folder), name.
fn layer_row(
    ui: &mut Ui,
    painting: &mut Painting,
    row: LayerRow,
    layer: &Layer,
    actions: &mut Vec<LayerAction>,
) {
    let id = layer.id();
    let is_layer = painting.target == Target::Layer(id);
    let is_mask = painting.target == Target::Mask(id);
    let is_moving = painting.moving.as_ref().is_some_and(|moving| moving.id == id);
    frame_row(ui, is_layer || is_mask, is_moving, |ui| {
        let (rect, response) = ui.allocate_exact_size(vec2(20.0, PICTURE), Sense::click());
        super::eye(ui.painter(), rect, layer.visible, if layer.visible { theme::TEXT } else { theme::FAINT });
        if response.on_hover_text("Show or hide").clicked() {
            actions.push(LayerAction::Show(id, !layer.visible));
        }
        ui.add_space(INDENT * row.depth as f32);
        let held = if row.is_group {
            folder(ui, row, &layer.name, is_layer, actions)
        } else {
            picture(ui, painting, Target::Layer(id), is_layer, "What the layer holds")
        };
        if held.clicked() {
            actions.push(LayerAction::Select(Target::Layer(id)));
        }
        if layer.mask.is_some() {
            let tip = "Paint on the mask: white shows, black hides. Alt + click shows the mask alone";
            let held = picture(ui, painting, Target::Mask(id), is_mask, tip);
            named(&held, &format!("Mask of {}", layer.name));
            if held.clicked() {
                actions.push(LayerAction::Select(Target::Mask(id)));
                if ui.input(|i| i.modifiers.alt) {
                    actions.push(LayerAction::SeeMask((painting.seen_mask() != Some(id)).then_some(id)));
                }
            }
        }
        if rename(ui, painting, layer, actions) {
            return;
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let faded =
                if layer.opacity < 0.995 { format!("{:.0} %", layer.opacity * 100.0) } else { String::new() };
            let mode = match (layer.group_kind(), layer.blend) {
                (Some(GroupKind::PassThrough), _) | (None, BlendMode::Normal) => "",
                (_, mode) => label_of(&BLEND_MODES, mode),
            };
            ui.label(RichText::new(format!("{mode} {faded}").trim()).size(11.0).color(theme::FAINT));
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let color = if layer.visible { theme::STRONG } else { theme::FAINT };
                let response = name_label(ui, &layer.name, color);
                if response.double_clicked() {
                    painting.renaming = Some((id, layer.name.clone()));
                } else if response.clicked() {
                    actions.push(LayerAction::Select(Target::Layer(id)));
                } else if response.drag_started() {
                    let right = response.interact_pointer_pos().map_or(0.0, |at| at.x);
                    let layers = painting.snapshot.layers.clone();
                    painting.moving = Some(LayerDrag { id, layers, place: None, right });
                }
                response.context_menu(|ui| menu(ui, painting, layer, actions));
                let tip = "Double click renames, dragging moves (to the right or left into and out of groups), right click \
                           does more";
                response.on_hover_text(tip);
            });
        });
    });
}

/// What can be done with a layer.
fn menu(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    ui.set_min_width(170.0);
    if ui.button("Rename").clicked() {
        painting.renaming = Some((id, layer.name.clone()));
        ui.close();
    }
    let below = layer_below(&painting.snapshot.layers, id);
    let can_merge = layer.visible && below.is_some_and(|below| below.visible);
    let mut rows = vec![
        (true, "Duplicate", LayerAction::Duplicate(id)),
        (can_merge, "Merge down", LayerAction::MergeDown(id)),
        (true, "Delete", LayerAction::Delete(id)),
        (true, "Group", LayerAction::Group(id)),
    ];
    if layer.group_kind().is_some() {
        rows.push((true, "Ungroup", LayerAction::Ungroup(id)));
        rows.push((layer.visible, "Merge group", LayerAction::MergeGroup(id)));
    }
    if layer.mask.is_none() {
        rows.push((true, "Add white mask", LayerAction::AddMask(id, true)));
        rows.push((true, "Add black mask", LayerAction::AddMask(id, false)));
    } else {
        let is_seen = painting.seen_mask() == Some(id);
        let text = if is_seen { "See the picture again" } else { "See the mask alone" };
        rows.push((true, "Invert mask", LayerAction::InvertMask(id)));
        rows.push((true, text, LayerAction::SeeMask((!is_seen).then_some(id))));
        rows.push((true, "Remove mask", LayerAction::RemoveMask(id)));
    }
    for (is_enabled, text, action) in rows {
        if matches!(text, "Group" | "Add white mask" | "Invert mask") {
            ui.separator();
        }
        if ui.add_enabled(is_enabled, Button::new(text)).clicked() {
            actions.push(action);
            ui.close();
        }
    }
    ui.menu_button("Mask from", |ui| mask_menu(ui, painting, id, actions));
}

/// What the mask of a layer can be made from.
fn mask_menu(ui: &mut Ui, painting: &Painting, id: u64, actions: &mut Vec<LayerAction>) {
    for (mut measure, text, tip) in MEASURES {
        if let MaskMeasure::Distance { to } = &mut measure {
            *to = painting.last_position().to_array();
        }
        if ui.button(text).on_hover_text(tip).clicked() {
            actions.push(LayerAction::MakeMask(id, Some(measure.source())));
            ui.close();
        }
    }
}

/// A group's folder, with a mark that folds and unfolds it.
fn folder(
    ui: &mut Ui,
    row: LayerRow,
    name: &str,
    is_chosen: bool,
    actions: &mut Vec<LayerAction>,
) -> Response {
    let (rect, mark) = ui.allocate_exact_size(vec2(14.0, PICTURE), Sense::click());
    named(&mark, &format!("{} {name}", if row.is_open { "Fold" } else { "Unfold" }));
    let (c, r) = (rect.center(), 4.0);
    let points = match row.is_open {
        true => [vec2(-r, -0.5 * r), vec2(r, -0.5 * r), vec2(0.0, 0.7 * r)],
        false => [vec2(-0.5 * r, -r), vec2(0.7 * r, 0.0), vec2(-0.5 * r, r)],
    };
    let points = points.map(|offset| c + offset).to_vec();
    ui.painter().add(Shape::convex_polygon(points, theme::TEXT, Stroke::NONE));
    if mark.on_hover_text("Fold or unfold the group").clicked() {
        actions.push(LayerAction::Collapse(row.id, row.is_open));
    }
    let (rect, response) = ui.allocate_exact_size(vec2(PICTURE, PICTURE), Sense::click());
    let color = if is_chosen { theme::ACCENT } else { theme::TEXT };
    let body = Rect::from_center_size(rect.center() + vec2(0.0, 1.5), vec2(20.0, 13.0));
    let tab = Rect::from_min_size(body.left_top() - vec2(0.0, 3.0), vec2(9.0, 4.0));
    ui.painter().rect_filled(tab, CornerRadius::same(1), color);
    ui.painter().rect_stroke(body, CornerRadius::same(2), Stroke::new(1.5, color), StrokeKind::Inside);
    response.on_hover_text("A group of layers")
}

/// A picture of what a layer or a mask holds.
fn picture(ui: &mut Ui, painting: &Painting, of: Target, is_chosen: bool, tip: &str) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(PICTURE, PICTURE), Sense::click());
    ui.painter().rect_filled(rect, CornerRadius::same(3), theme::PANEL);
    if let Some(known) = painting.thumbnails.get(&of) {
        let texture = cached_texture(ui, Id::unique(("layer", of)), Itself(known.clone()), || {
            let pixels = known.iter().map(|&[r, g, b, a]| Color32::from_rgba_unmultiplied(r, g, b, a));
            ColorImage::new([THUMBNAIL; 2], pixels.collect())
        });
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter().image(texture.id(), rect, whole, Color32::WHITE);
    }
    let edge = if is_chosen { Stroke::new(1.8, theme::ACCENT) } else { Stroke::new(1.0, theme::LINE) };
    ui.painter().rect_stroke(rect, CornerRadius::same(3), edge, StrokeKind::Inside);
    response.on_hover_text(tip)
}

/// For those who hear the window, and for tests.
fn named(response: &Response, name: &str) {
    response.widget_info(|| WidgetInfo::labeled(accesskit::Role::Button, true, name));
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

fn base_row(ui: &mut Ui, painting: &Painting, actions: &mut Vec<LayerAction>) {
    let is_chosen = painting.target == Target::Base;
    frame_row(ui, is_chosen, false, |ui| {
        ui.add_space(28.0);
        let held = picture(ui, painting, Target::Base, is_chosen, "What was baked, under all layers");
        if name_label(ui, "Base", theme::STRONG).on_hover_text("What was baked, under all layers").clicked()
            || held.clicked()
        {
            actions.push(LayerAction::Select(Target::Base));
        }
    });
}

/// A name that can be clicked, over all the room that is left.
fn name_label(ui: &mut Ui, name: &str, color: Color32) -> Response {
    let (rect, response) =
        ui.allocate_exact_size(vec2(ui.available_width(), PICTURE), Sense::click_and_drag());
    let label = Label::new(RichText::new(name).color(color)).truncate().selectable(false);
    let layout = Layout::left_to_right(Align::Center);
    ui.scope_builder(UiBuilder::new().max_rect(rect).layout(layout), |ui| ui.add(label));
    response
}

fn frame_row(ui: &mut Ui, is_chosen: bool, is_moving: bool, add: impl FnOnce(&mut Ui)) {
    let size = vec2(ui.available_width(), ROW);
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let fill = match (is_moving, is_chosen) {
        (true, _) => Color32::from_rgb(0x3a, 0x5a, 0x78),
        (_, true) => Color32::from_rgb(0x2f, 0x46, 0x5c),
        _ => theme::WELL,
    };
    ui.painter().rect_filled(rect, CornerRadius::same(4), fill);
    let layout = Layout::left_to_right(Align::Center);
    ui.scope_builder(UiBuilder::new().max_rect(rect.shrink2(vec2(6.0, 2.0))).layout(layout), add);
    ui.add_space(-3.0);
}

/// Blending, opacity, mask and channels of the chosen layer.
fn chosen(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    ui.add_space(4.0);
    blending(ui, layer, actions);
    opacity(ui, painting, layer, actions);
    if matches!(layer.content, LayerContent::Fill(_) | LayerContent::Graph(_)) {
        ui.horizontal(|ui| {
            ui.label(RichText::new("Shows").color(theme::FAINT));
            let tip = "It shows the current colour, pattern or look, and material instead";
            if ui.small_button("Change").on_hover_text(tip).clicked() {
                actions.push(LayerAction::Refill(id));
            }
            ui.add(Label::new(fill_name(layer)).truncate());
        });
    }
    mask(ui, painting, layer, actions);
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

/// How much of a layer is seen. What is dragged or typed is one step of the history.
fn opacity(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    let faded = painting.fading.filter(|(of, _)| *of == id);
    let mut percent = 100.0 * faded.map_or(layer.opacity, |(_, opacity)| opacity);
    let response = row(ui, "Opacity", |ui| {
        ui.add(Slider::new(&mut percent, 0.0..=100.0).suffix(" %").fixed_decimals(0))
    });
    if response.changed() {
        painting.fading = Some((id, percent / 100.0));
    }
    if let Some((of, opacity)) = painting.fading.filter(|_| !is_held(ui)) {
        painting.fading = None;
        if of == id && opacity != layer.opacity {
            actions.push(LayerAction::Opacity(id, opacity));
        }
    }
}

/// How a layer, or a group as a whole, blends with what lies below it; a group may also let its members do so.
fn blending(ui: &mut Ui, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    let modes = BLEND_MODES.iter().map(|&(mode, name)| (Some(mode), name));
    let passes = layer.group_kind().map(|_| (None, "Pass through"));
    let modes: Vec<(Option<BlendMode>, &str)> = passes.into_iter().chain(modes).collect();
    let is_passing = layer.group_kind() == Some(GroupKind::PassThrough);
    let before = (!is_passing).then_some(layer.blend);
    let mut mode = before;
    row(ui, "Blend", |ui| choice(ui, "layer blend", &mut mode, &modes));
    if mode == before {
        return;
    }
    match (mode, layer.group_kind()) {
        (None, _) => actions.push(LayerAction::GroupKind(id, GroupKind::PassThrough)),
        (Some(mode), kind) => {
            if kind == Some(GroupKind::PassThrough) {
                actions.push(LayerAction::GroupKind(id, GroupKind::Isolated));
            }
            if mode != layer.blend {
                actions.push(LayerAction::Blend(id, mode));
            }
        }
    }
}

/// What masks are made from.
const MEASURES: [(MaskMeasure, &str, &str); 6] = [
    (MaskMeasure::Curvature { radius: 0.03 }, "Edges", "Edges that stick out, or hollows: by curvature"),
    (MaskMeasure::Occlusion { radius: 0.1 }, "Hidden places", "Where little light gets to: occlusion"),
    (MaskMeasure::Height { axis: 1 }, "Height", "By place along an axis"),
    (MaskMeasure::Distance { to: [0.0; 3] }, "Distance", "By distance from where the pen was last"),
    (MaskMeasure::Slope { axis: 1 }, "Slope", "By the angle to an axis: what lies flat or steep"),
    (MaskMeasure::Noise { scale: 0.15, seed: 1 }, "Noise", "Patches at random"),
];

/// The chosen layer's mask: what it is made from, and what is done with it.
fn mask(ui: &mut Ui, painting: &mut Painting, layer: &Layer, actions: &mut Vec<LayerAction>) {
    let id = layer.id();
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("Mask").color(theme::FAINT));
        if layer.mask.is_some() {
            if ui.small_button("Invert").on_hover_text("It hides where it showed").clicked() {
                actions.push(LayerAction::InvertMask(id));
            }
            let is_seen = painting.seen_mask() == Some(id);
            if ui
                .selectable_label(is_seen, RichText::new("Alone").size(11.0))
                .on_hover_text("See the mask alone (Alt + click on its picture)")
                .clicked()
            {
                actions.push(LayerAction::SeeMask((!is_seen).then_some(id)));
            }
            if ui.small_button("Remove").on_hover_text("The layer is shown everywhere again").clicked() {
                actions.push(LayerAction::RemoveMask(id));
            }
        } else {
            let choices = [
                ("Add white", true, "Shows all until it is painted black"),
                ("Add black", false, "Hides all until it is painted white"),
            ];
            for (text, shows, tip) in choices {
                if ui.small_button(text).on_hover_text(tip).clicked() {
                    actions.push(LayerAction::AddMask(id, shows));
                }
            }
        }
        let made = ui.menu_button(RichText::new("From …").size(11.0), |ui| {
            mask_menu(ui, painting, id, actions);
            if layer.mask_source.is_some() && ui.button("Only what is painted").clicked() {
                actions.push(LayerAction::MakeMask(id, None));
                ui.close();
            }
        });
        made.response.on_hover_text("Makes the mask from the model's shape; what is painted on it stays");
    });
    if let Some(source) = layer.mask_source {
        mask_source(ui, painting, id, source, actions);
    }
}

/// Bounds and measure of a mask that is made. A drag is one step of the history.
fn mask_source(
    ui: &mut Ui,
    painting: &mut Painting,
    id: u64,
    kept: MaskSource,
    actions: &mut Vec<LayerAction>,
) {
    let mut source = painting.shaping.filter(|(of, _)| *of == id).map_or(kept, |(_, source)| source);
    let before = source;
    let name =
        MEASURES.iter().find(|(by, ..)| std::mem::discriminant(by) == std::mem::discriminant(&source.by));
    hint(ui, name.map_or("", |(_, _, tip)| tip));
    number("Black at", "", 2, "Where the mask hides").show(ui, &mut source.from, 0.0..=1.0);
    number("White at", "", 2, "Where the mask shows").show(ui, &mut source.to, 0.0..=1.0);
    match &mut source.by {
        MaskMeasure::Curvature { radius } | MaskMeasure::Occlusion { radius } => {
            let reach = number("Reach", "", 3, "How far it looks around, in diagonals of the model");
            reach.logarithmic().show(ui, radius, 0.005..=0.5);
        }
        MaskMeasure::Distance { to } => {
            let bounds = &painting.bounds;
            let diagonal = bounds.size().length();
            let range = bounds.min.to_array().into_iter().zip(bounds.max.to_array());
            for ((name, value), (low, high)) in ["X", "Y", "Z"].into_iter().zip(to).zip(range) {
                number(name, "", decimals_of(0.1 * diagonal), "World units").show(ui, value, low..=high);
            }
        }
        MaskMeasure::Height { axis } | MaskMeasure::Slope { axis } => {
            row(ui, "Axis", |ui| {
                ui.horizontal(|ui| segments(ui, axis, &[(0, "X"), (1, "Y"), (2, "Z")])).response
            });
        }
        MaskMeasure::Noise { scale, seed } => {
            let size = number("Scale", "", 3, "Width of the patches, in diagonals of the model");
            size.logarithmic().show(ui, scale, 0.005..=1.0);
            number("Seed", "", 0, "Another seed is another pattern").show(ui, seed, 0..=99);
        }
    }
    if source != before {
        painting.shaping = Some((id, source));
    }
    if let Some((of, source)) = painting.shaping.filter(|_| !is_held(ui)) {
        painting.shaping = None;
        if of == id && source != kept {
            actions.push(LayerAction::MakeMask(id, Some(source)));
        }
    }
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
