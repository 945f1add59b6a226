//! The scene itself, and what lies over it: messages, progress, the welcome, the overlay's legend.

use eframe::egui::{
    self, Align, Align2, Area, Color32, CornerRadius, Frame, Id, Key, Layout, Margin, Order, PointerButton,
    Pos2, Rect, RichText, ScrollArea, Sense, Spinner, Stroke, Ui, UiBuilder, Vec2, pos2, vec2,
};
use fantex::glam::DVec2;

use super::bar::short_place;
use super::widgets::dot;
use super::{Textures, compare, gizmo, paint};
use crate::camera::MoveInput;
use crate::command::{Command, keys_of};
use crate::display::Overlay;
use crate::document::{Document, Stage};
use crate::notices::{Notice, Severity};
use crate::paint::{PenEvent, PenPhase};
use crate::pen::felt;
use crate::settings::label_of;
use crate::theme;
use crate::viewer::{BRUSH_KEY, SceneInput, Viewer};

/// Points of scrolling that count as one notch of the wheel.
const NOTCH_POINTS: f32 = 50.0;

/// Returns what the user did in the scene.
pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, textures: &Textures) -> SceneInput {
    let rect = ui.max_rect();
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    viewer.scene_pixels = pixels(rect.size(), ui.ctx().pixels_per_point());
    viewer.pixels_per_point = f64::from(ui.ctx().pixels_per_point());
    viewer.scene_corner = rect.min.into();
    ui.painter().rect_filled(rect, CornerRadius::ZERO, theme::WELL);
    let mut input = SceneInput::default();
    if viewer.live.is_some() {
        super::live::picture(ui, viewer, rect);
        input = scene_input(ui, &response, rect);
    } else if viewer.document.is_some() {
        if let Some(texture) = textures.scene {
            let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
            ui.painter().image(texture, rect, whole, Color32::WHITE);
        }
        compare::show(ui, viewer, rect, textures.kept);
        input = scene_input(ui, &response, rect);
        if viewer.painting.is_some() {
            input.pen = pen(ui, &response, rect, viewer);
            paint::adjust(ui, viewer, &response, rect, &mut input);
            paint::overlay(ui, viewer, rect, viewer.brush_origin().or(input.cursor));
        }
        legend(ui, viewer, rect);
        gizmo::show(ui, viewer, rect, &mut input);
    } else if viewer.opening.is_none() && viewer.asked.is_none() {
        welcome(ui, viewer, rect);
    }
    opening(ui, viewer, rect);
    super::asked::show(ui, viewer, rect);
    super::asked::exporting(ui, viewer, rect);
    super::asked::removal(ui, viewer, rect);
    drop_target(ui, rect);
    notices(ui, viewer, rect);
    input
}

/// Whole pixels of a size in points; zero where there is nothing to be seen.
fn pixels(size: Vec2, pixels_per_point: f32) -> [u32; 2] {
    let size = size * pixels_per_point;
    let is_seen = size.x >= 1.0 && size.y >= 1.0 && size.is_finite();
    if is_seen { [size.x, size.y].map(|n| n.round() as u32) } else { [0; 2] }
}

fn scene_input(ui: &Ui, response: &egui::Response, rect: Rect) -> SceneInput {
    let height = f64::from(rect.height().max(1.0));
    let drag = |button: PointerButton| {
        let by = if response.dragged_by(button) { response.drag_delta() } else { Vec2::ZERO };
        DVec2::new(f64::from(by.x), f64::from(by.y)) / height
    };
    let cursor = response.hover_pos().map(|at| {
        let share = (at - rect.min) / rect.size();
        DVec2::new(f64::from(share.x), f64::from(share.y))
    });
    let primary = drag(PointerButton::Primary);
    let middle_drag = drag(PointerButton::Middle);
    let side_drag = drag(PointerButton::Secondary) + middle_drag;
    let is_double_click = response.double_clicked();
    // Keys that are typed into a field are not for the camera.
    let has_keys = !ui.ctx().text_edit_focused();
    ui.input(|i| {
        let held = |key: Key| f64::from(u8::from(has_keys && i.key_down(key) && !i.modifiers.command));
        SceneInput {
            drag: primary,
            side_drag,
            middle_drag,
            pen: Vec::new(),
            modifiers: i.modifiers,
            turns_sun: i.modifiers.command,
            adjusts_brush: held(BRUSH_KEY) > 0.0 && !i.modifiers.alt,
            // With Ctrl the wheel zooms, by a factor of e for each 200 points.
            wheel: if cursor.is_some() {
                f64::from((i.smooth_scroll_delta().y + 200.0 * i.zoom_delta().ln()) / NOTCH_POINTS)
            } else {
                0.0
            },
            cursor,
            is_double_click,
            movement: MoveInput {
                right: held(Key::D) - held(Key::A),
                up: held(Key::E) - held(Key::Q),
                forward: (held(Key::W) - held(Key::S)) + held(Key::ArrowUp) - held(Key::ArrowDown),
                fast: i.modifiers.shift,
            },
        }
    })
}

/// Whether the presses of the first button in this frame were on the scene, not on what lies over it or beside it, in order.
fn presses(ui: &Ui, response: &egui::Response, rect: Rect) -> Vec<bool> {
    let place = |event: &egui::Event| match event {
        egui::Event::PointerButton { pos, button: PointerButton::Primary, pressed: true, .. } => Some(*pos),
        _ => None,
    };
    let (places, last) = ui.input(|i| {
        let places: Vec<Pos2> = i.events.iter().filter_map(place).collect();
        (places, i.pointer.latest_pos())
    });
    let is_on_scene = |at: Pos2| {
        let is_on_top = ui.ctx().layer_id_at(at).is_none_or(|layer| layer == ui.layer_id());
        // Where the pointer still is, edges of panels are known, too.
        rect.contains(at) && is_on_top && (last != Some(at) || response.contains_pointer())
    };
    places.into_iter().map(is_on_scene).collect()
}

/// What the pen or the first button did in this frame, every move of it.
fn pen(ui: &Ui, response: &egui::Response, rect: Rect, viewer: &Viewer) -> Vec<PenEvent> {
    let mut presses = presses(ui, response, rect).into_iter();
    let pressure_id = Id::unique("pen pressure");
    let mut pressure = ui.data(|data| data.get_temp::<f32>(pressure_id)).unwrap_or(1.0);
    let share = |at: Pos2| {
        let share = (at - rect.min) / rect.size();
        DVec2::new(f64::from(share.x), f64::from(share.y))
    };
    let softness = viewer.settings.paint.pen_softness;
    // What is painted behind a kept picture would not be seen.
    let is_covered = |at: Pos2| viewer.kept.is_some_and(|kept| share(at).x < f64::from(kept.divider));
    let mut events = Vec::new();
    ui.input(|i| {
        let has_reading = |event: &&egui::Event| {
            matches!(event, egui::Event::PointerMoved(_) | egui::Event::PointerButton { pressed: true, .. })
        };
        let mut readings = viewer.pen.take(i.events.iter().filter(has_reading).count()).into_iter();
        // Where a touch was that the system has taken back: no button is let go, but of the touch that draws the pointer goes next.
        let mut cancelled = None;
        for event in &i.events {
            let taken_back = cancelled.take();
            let of_tablet = if has_reading(&event) { readings.next().flatten() } else { None };
            let (phase, at) = match event {
                egui::Event::Touch { force, phase, pos, .. } => {
                    cancelled = (*phase == egui::TouchPhase::Cancel).then_some(*pos);
                    let is_over = matches!(phase, egui::TouchPhase::End | egui::TouchPhase::Cancel);
                    pressure = if is_over { 1.0 } else { force.unwrap_or(1.0).clamp(0.0, 1.0) };
                    continue;
                }
                egui::Event::PointerButton { pos, button: PointerButton::Primary, pressed: true, .. } => {
                    if presses.next() != Some(true) {
                        continue;
                    }
                    (if is_covered(*pos) { PenPhase::Turn } else { PenPhase::Down }, *pos)
                }
                egui::Event::PointerButton { pos, button: PointerButton::Primary, .. } => {
                    (PenPhase::Up, *pos)
                }
                egui::Event::PointerMoved(pos) => (PenPhase::Move, *pos),
                egui::Event::PointerGone => match taken_back {
                    Some(pos) => (PenPhase::Up, pos),
                    None => continue,
                },
                _ => continue,
            };
            let pressure = felt(of_tablet.unwrap_or(pressure), softness);
            events.push(PenEvent { phase, at: share(at), pressure });
        }
    });
    ui.data_mut(|data| data.insert_temp(pressure_id, pressure));
    events
}

/// What is seen before anything is open.
fn welcome(ui: &mut Ui, viewer: &mut Viewer, rect: Rect) {
    let mut command = None;
    let card =
        Rect::from_center_size(rect.center(), vec2(420.0f32.min(rect.width()), 320.0f32.min(rect.height())));
    ui.scope_builder(UiBuilder::new().max_rect(card).layout(Layout::top_down(Align::Center)), |ui| {
        ui.add_space(24.0);
        ui.label(RichText::new("Drop a model or an asset here").size(20.0).color(theme::STRONG));
        ui.label(RichText::new(".glb  .gltf  .obj  .ply  .stl  .fan  .fanworld").color(theme::FAINT));
        ui.add_space(10.0);
        let keys = keys_of(false, &Command::OpenDialog).unwrap_or_default();
        let button = egui::Button::new("Open a file …")
            .shortcut_text(RichText::new(keys).color(theme::FAINT))
            .truncate();
        if ui.add_sized([190.0f32.min(ui.available_width()), 32.0], button).clicked() {
            command = Some(Command::OpenDialog);
        }
        if !viewer.settings.recent.is_empty() {
            ui.add_space(14.0);
            ui.label(RichText::new("Recent").color(theme::FAINT));
            for place in viewer.settings.recent.iter().take(5) {
                if ui.link(short_place(place)).on_hover_text(place).clicked() {
                    command = Some(Command::Open(place.clone()));
                }
            }
        }
    });
    if let Some(command) = command {
        viewer.command(command);
    }
}

/// How far opening is, and how to stop it.
fn opening(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let Some(opening) = &viewer.opening else { return };
    ui.ctx().request_repaint_after_secs(0.1);
    // What is there at once needs no card.
    if opening.seconds() < 0.15 {
        return;
    }
    let mut is_cancelled = false;
    Area::new(Id::unique("opening"))
        .order(Order::Middle)
        .fixed_pos(rect.center())
        .pivot(Align2::CENTER_CENTER)
        .show(ui.ctx(), |ui| {
            card().show(ui, |ui| {
                ui.set_width(320.0f32.min(rect.width() - 40.0));
                ui.horizontal(|ui| {
                    ui.add(Spinner::new().size(18.0));
                    ui.label(RichText::new(short_place(&opening.place().name())).color(theme::STRONG));
                });
                ui.horizontal(|ui| {
                    let share =
                        opening.share().map_or(String::new(), |share| format!(" {:.0} %", share * 100.0));
                    let text = format!(
                        "{} …{share} {:.0} s",
                        label_of(&Stage::ALL, opening.stage()),
                        opening.seconds()
                    );
                    ui.label(RichText::new(text).color(theme::FAINT));
                    ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                        is_cancelled = ui.button("Cancel").clicked();
                    });
                });
            });
        });
    if is_cancelled {
        viewer.cancel_opening();
    }
}

/// A frame that invites to let go of a file.
fn drop_target(ui: &Ui, rect: Rect) {
    if ui.input(|i| i.raw.hovered_files.is_empty()) {
        return;
    }
    let painter = ui.painter();
    painter.rect_filled(rect, CornerRadius::ZERO, Color32::from_black_alpha(120));
    let inner = rect.shrink(16.0);
    painter.rect_stroke(
        inner,
        CornerRadius::same(8),
        Stroke::new(2.0, theme::ACCENT),
        egui::StrokeKind::Inside,
    );
    painter.text(
        rect.center(),
        Align2::CENTER_CENTER,
        "Let go to open",
        egui::FontId::proportional(20.0),
        theme::STRONG,
    );
}

/// What the overlay's colours mean, in the upper left corner.
fn legend(ui: &Ui, viewer: &Viewer, rect: Rect) {
    let overlay = viewer.settings.display.overlay;
    let is_streamed = viewer.document.as_ref().is_some_and(Document::is_streamed);
    if overlay == Overlay::None || !is_streamed || rect.width() < 240.0 {
        return;
    }
    let at = rect.min + vec2(12.0, 12.0);
    Area::new(Id::unique("legend")).order(Order::Middle).fixed_pos(at).interactable(false).show(
        ui.ctx(),
        |ui| {
            card().show(ui, |ui| {
                ui.set_max_width((rect.width() - 60.0).clamp(160.0, 260.0));
                ui.label(RichText::new(label_of(&Overlay::ALL, overlay)).color(theme::STRONG));
                if overlay == Overlay::Levels {
                    swatches(ui, viewer);
                }
                ui.label(RichText::new(overlay.meaning()).small().color(theme::FAINT));
            });
        },
    );
}

fn swatches(ui: &mut Ui, viewer: &Viewer) {
    let count = viewer.figures.levels.len().clamp(1, theme::COLORED_LEVELS);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        for level in 0..count {
            let (rect, _) = ui.allocate_exact_size(vec2(22.0, 16.0), Sense::hover());
            ui.painter().rect_filled(rect, CornerRadius::same(3), theme::level_color(level));
            let font = egui::FontId::proportional(10.5);
            ui.painter().text(rect.center(), Align2::CENTER_CENTER, level, font, Color32::BLACK);
        }
    });
}

/// Messages in the lower left corner, the newest at the bottom.
fn notices(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let shown: Vec<Notice> = viewer.notices.shown().cloned().collect();
    if shown.is_empty() {
        return;
    }
    if let Some(wake) = viewer.notices.wake_in() {
        ui.ctx().request_repaint_after_secs(wake as f32 + 0.01);
    }
    let at: Pos2 = rect.left_bottom() + vec2(12.0, -12.0);
    let mut dismissed = None;
    Area::new(Id::unique("notices")).order(Order::Middle).fixed_pos(at).pivot(Align2::LEFT_BOTTOM).show(
        ui.ctx(),
        |ui| {
            // Not what they took in the last frame: there may be more of them.
            ui.set_max_height((rect.height() - 24.0).max(20.0));
            ScrollArea::vertical().stick_to_bottom(true).show(ui, |ui| {
                for (i, notice) in shown.iter().enumerate() {
                    if notice_card(ui, notice, rect.width()) {
                        dismissed = Some(i);
                    }
                }
            });
        },
    );
    if let Some(i) = dismissed {
        viewer.notices.dismiss(i);
    }
}

/// Returns whether it is to go.
fn notice_card(ui: &mut Ui, notice: &Notice, width: f32) -> bool {
    let color = match notice.severity {
        Severity::Info => theme::ACCENT,
        Severity::Warning => theme::WARNING,
        Severity::Error => theme::ERROR,
    };
    let mut is_dismissed = false;
    card().stroke(Stroke::new(1.0, color.gamma_multiply(0.6))).show(ui, |ui| {
        ui.set_width((width - 60.0).clamp(60.0, 440.0));
        ui.with_layout(Layout::right_to_left(Align::Min), |ui| {
            is_dismissed = ui.small_button("×").on_hover_text("Dismiss").clicked();
            ui.with_layout(Layout::left_to_right(Align::Min), |ui| {
                dot(ui, color);
                ui.add(egui::Label::new(RichText::new(&notice.text).color(theme::TEXT)).wrap());
            });
        });
    });
    is_dismissed
}

pub(super) fn card() -> Frame {
    Frame::new()
        .fill(Color32::from_rgba_unmultiplied(0x1f, 0x22, 0x27, 0xe8))
        .stroke(Stroke::new(1.0, theme::LINE))
        .corner_radius(CornerRadius::same(6))
        .inner_margin(Margin::symmetric(12, 8))
}
