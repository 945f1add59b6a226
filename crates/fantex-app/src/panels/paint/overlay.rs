//! What lies over the scene while something is painted on: the brush on the surface, the symmetry plane, where cloning copies from,
//! and whether all is saved.

use eframe::egui::{
    Align2, Area, Color32, CornerRadius, CursorIcon, FontId, Frame, Id, Margin, Order, Painter, Pos2, Rect,
    RichText, Shape, Stroke, Ui, pos2, vec2,
};
use glam::{DVec2, DVec3};

use super::stencil;
use crate::paint::{Cursor, PaintTool, Ring, SaveState, SymmetryKind, plane_outline};
use crate::panels::widgets::gauge;
use crate::theme;
use crate::viewer::Viewer;

/// What takes less long is not told of.
const SHOWN_AFTER_SECONDS: f64 = 0.3;

/// Lines are dark below and light above, so that they are seen on any ground.
const DARK: Color32 = Color32::from_rgba_premultiplied(0, 0, 0, 150);

pub(in crate::panels) fn show(ui: &Ui, viewer: &mut Viewer, rect: Rect, cursor: Option<DVec2>) {
    let (symmetry, view) = (viewer.settings.paint.symmetry, viewer.viewpoint());
    if viewer.painting.is_none() {
        return;
    }
    stencil::overlay(ui, viewer, rect);
    work(ui, viewer, rect);
    let Some(painting) = &mut viewer.painting else { return };
    let has_plane = symmetry.kind == SymmetryKind::Mirror && symmetry.shows_plane;
    let line =
        if has_plane { painting.section(symmetry.axis, symmetry.offset, &view).to_vec() } else { Vec::new() };
    let viewer = &*viewer;
    let Some(painting) = &viewer.painting else { return };
    let painter = ui.painter().with_clip_rect(rect);
    let place = |p: DVec2| rect.min + rect.size() * vec2(p.x as f32, p.y as f32);
    plane(&painter, viewer, &line, &place);
    if let Some(source) = painting.source().filter(|_| viewer.settings.paint.tool == PaintTool::Clone)
        && let Some(at) = view.project(source)
    {
        cross(&painter, place(at));
    }
    let settings = &viewer.settings.paint;
    let is_moved = settings.stencil.is_on && settings.stencil.is_adjusted;
    if let Some(at) = cursor.filter(|_| !is_moved)
        && let Some(found) = painting.cursor(settings, &view, at)
    {
        ui.ctx().set_cursor_icon(if settings.tool == PaintTool::Pick {
            CursorIcon::Crosshair
        } else {
            CursorIcon::None
        });
        rings(&painter, &found, settings.colors.foreground, &place);
    }
    saved(&painter, painting.save(), rect);
}

fn rings(painter: &Painter, cursor: &Cursor, [r, g, b]: [u8; 3], place: &impl Fn(DVec2) -> Pos2) {
    for (index, ring) in cursor.rings.iter().enumerate().rev() {
        let strength = match (index, ring.is_hidden) {
            (0, _) => 1.0,
            (_, false) => 0.75,
            (_, true) => 0.3,
        };
        outline(painter, ring, strength, place);
        let middle = place(ring.middle);
        if index == 0 {
            if let Some(tip) = ring.normal {
                line(painter, vec![middle, place(tip)], 1.2, strength);
            }
            painter.circle_filled(middle, 3.2, DARK);
            painter.circle_filled(middle, 2.2, Color32::from_rgb(r, g, b));
        }
    }
}

fn outline(painter: &Painter, ring: &Ring, strength: f32, place: &impl Fn(DVec2) -> Pos2) {
    let closed =
        |points: &[DVec2]| -> Vec<Pos2> { points.iter().chain(points.first()).map(|&p| place(p)).collect() };
    if ring.outline.len() > 2 {
        line(painter, closed(&ring.outline), 1.5, strength);
    }
    if ring.core.len() > 2 {
        let light = Color32::from_white_alpha((90.0 * strength) as u8);
        painter.add(Shape::line(closed(&ring.core), Stroke::new(1.0, light)));
    }
}

fn line(painter: &Painter, points: Vec<Pos2>, width: f32, strength: f32) {
    painter.add(Shape::line(points.clone(), Stroke::new(width + 1.8, DARK.gamma_multiply(strength))));
    painter.add(Shape::line(points, Stroke::new(width, Color32::WHITE.gamma_multiply(0.95 * strength))));
}

fn cross(painter: &Painter, at: Pos2) {
    for by in [vec2(8.0, 0.0), vec2(0.0, 8.0)] {
        line(painter, vec![at - by, at + by], 1.4, 1.0);
    }
    painter.circle_stroke(at, 6.0, Stroke::new(1.2, theme::ACCENT));
}

/// The mirror's plane, or the axis of radial symmetry.
fn plane(painter: &Painter, viewer: &Viewer, line: &[Vec<DVec3>], place: &impl Fn(DVec2) -> Pos2) {
    let symmetry = &viewer.settings.paint.symmetry;
    let Some(painting) = viewer.painting.as_ref().filter(|_| symmetry.shows_plane) else { return };
    let (bounds, view) = (painting.bounds(), viewer.viewpoint());
    let color = [theme::ERROR, theme::GOOD, theme::ACCENT][symmetry.axis.min(2)];
    match symmetry.kind {
        SymmetryKind::Off => {}
        SymmetryKind::Mirror => {
            let offset = bounds.center()[symmetry.axis.min(2)] + symmetry.offset;
            let corners = plane_outline(bounds, symmetry.axis, offset).map(|corner| view.project(corner));
            let Some(corners) = corners.into_iter().collect::<Option<Vec<DVec2>>>() else { return };
            let corners: Vec<Pos2> = corners.into_iter().map(place).collect();
            let edge = Stroke::new(1.0, color.gamma_multiply(0.55));
            painter.add(Shape::convex_polygon(corners, color.gamma_multiply(0.035), edge));
            for run in line {
                // Behind the camera nothing is seen.
                let points: Vec<Option<Pos2>> = run.iter().map(|&p| view.project(p).map(place)).collect();
                for part in points.split(Option::is_none) {
                    let part: Vec<Pos2> = part.iter().copied().flatten().collect();
                    painter.add(Shape::line(part.clone(), Stroke::new(3.0, DARK.gamma_multiply(0.6))));
                    painter.add(Shape::line(part, Stroke::new(1.6, color)));
                }
            }
        }
        SymmetryKind::Radial => {
            let axis = [DVec3::X, DVec3::Y, DVec3::Z][symmetry.axis.min(2)];
            let half = 0.6 * (bounds.max - bounds.min).length();
            let ends = [-half, half].map(|t| view.project(bounds.center() + t * axis));
            if let [Some(a), Some(b)] = ends {
                let dashes = Shape::dashed_line(&[place(a), place(b)], Stroke::new(1.4, color), 8.0, 5.0);
                painter.extend(dashes);
            }
        }
    }
}

/// How far something is that takes long, and how to stop it: below the saved sign.
fn work(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let view = viewer.viewpoint();
    let Some(painting) = &mut viewer.painting else { return };
    painting.look_from(&view);
    let since = Id::unique("painter's work since");
    let Some(work) = painting.work().cloned() else { return ui.data_mut(|data| data.remove::<f64>(since)) };
    // What is over at once needs no card.
    let now = ui.input(|i| i.time);
    if now - ui.data_mut(|data| *data.get_temp_mut_or(since, now)) < SHOWN_AFTER_SECONDS {
        return ui.ctx().request_repaint_after_secs(SHOWN_AFTER_SECONDS as f32);
    }
    let mut is_given_up = false;
    let at = rect.right_top() + vec2(-14.0, 44.0);
    Area::new(Id::unique("painter's work")).order(Order::Middle).fixed_pos(at).pivot(Align2::RIGHT_TOP).show(
        ui.ctx(),
        |ui| {
            let frame =
                Frame::new().fill(Color32::from_black_alpha(190)).corner_radius(CornerRadius::same(6));
            frame.inner_margin(Margin::symmetric(12, 8)).show(ui, |ui| {
                ui.set_width(190.0);
                ui.horizontal(|ui| {
                    let what = if work.is_undo { "Undo: " } else { "" };
                    let text = format!("{what}{} … {:.0} %", work.label, work.share * 100.0);
                    ui.label(RichText::new(text).color(theme::TEXT));
                    is_given_up = ui
                        .small_button("Stop")
                        .on_hover_text("Takes back what is done so far (Esc)")
                        .clicked();
                });
                gauge(ui, work.share, theme::ACCENT);
            });
        },
    );
    if is_given_up {
        painting.give_up_work();
    }
}

/// Whether what was painted is in the file, in the upper right corner.
fn saved(painter: &Painter, state: &SaveState, rect: Rect) {
    let (text, color) = match state {
        SaveState::Saved => ("Saved", theme::GOOD),
        SaveState::Changed | SaveState::Saving => ("Saving …", theme::WARNING),
        SaveState::Failed(_) => ("Not saved", theme::ERROR),
    };
    let at = rect.right_top() + vec2(-14.0, 12.0);
    let galley = painter.layout_no_wrap(text.to_owned(), FontId::proportional(12.0), theme::TEXT);
    let size = galley.size() + vec2(30.0, 8.0);
    let card = Rect::from_min_size(pos2(at.x - size.x, at.y), size);
    painter.rect_filled(card, size.y * 0.5, Color32::from_black_alpha(130));
    painter.circle_filled(card.left_center() + vec2(12.0, 0.0), 4.0, color);
    painter.text(
        card.left_center() + vec2(21.0, 0.0),
        Align2::LEFT_CENTER,
        text,
        FontId::proportional(12.0),
        theme::TEXT,
    );
}
