//! What lies over the scene while something is painted on: the brush on the surface, the symmetry plane, where cloning copies from,
//! and whether all is saved.

use std::sync::Arc;

use eframe::egui::{
    Align2, Area, Color32, ColorImage, CornerRadius, CursorIcon, FontId, Frame, Id, Margin, Mesh, Order,
    Painter, Pos2, Rect, Response, RichText, Shape, Stroke, TextureHandle, TextureOptions, Ui, pos2, vec2,
};
use fantex::glam::{DVec2, DVec3};

use crate::command::Command;
use crate::paint::{
    Cursor, GradientEnd, GradientShape, PaintCommand, PaintSettings, PaintTool, PenPhase, PlacingOutline,
    Ring, SaveState, StencilPicture, StencilSettings, StencilUse, SymmetryKind, degrees_between,
    plane_outline,
};
use crate::panels::paint::brush::percent;
use crate::panels::widgets::{file_button, gauge, heading, number, row, segments};
use crate::theme;
use crate::viewer::{FileDialog, Request, SceneInput, Viewer};

/// What takes less long is not told of.
const SHOWN_AFTER_SECONDS: f64 = 0.3;

/// Lines are dark below and light above, so that they are seen on any ground.
const DARK: Color32 = Color32::from_rgba_premultiplied(0, 0, 0, 150);

pub(in crate::panels) fn show(ui: &Ui, viewer: &mut Viewer, rect: Rect, cursor: Option<DVec2>) {
    let (symmetry, view) = (viewer.settings.paint.symmetry, viewer.viewpoint());
    if viewer.painting.is_none() {
        return;
    }
    stencil_overlay(ui, viewer, rect);
    work(ui, viewer, rect);
    let Some(painting) = &mut viewer.painting else { return };
    let has_plane = symmetry.kind == SymmetryKind::Mirror && symmetry.shows_plane;
    let mut line = Vec::new();
    if has_plane {
        let (parts, is_current) = painting.section(symmetry.axis, symmetry.offset, &view);
        line.extend_from_slice(parts);
        if !is_current {
            ui.ctx().request_repaint_after_secs(0.03);
        }
    }
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
    let gradient_line = painting.gradient_line();
    if let Some(ends) = gradient_line {
        gradient(&painter, ends.map(place), settings);
    }
    if let Some(outline) = painting.placing_outline(&view) {
        placing(&painter, &outline, &place);
    }
    let is_moved = settings.stencil.is_on && settings.stencil.is_adjusted;
    let has_handles = is_moved || painting.is_placing() || gradient_line.is_some();
    if let Some(at) = cursor.filter(|_| !has_handles)
        && let Some(found) = painting.cursor(settings, &view, at)
    {
        ui.ctx().set_cursor_icon(if settings.tool == PaintTool::Pick {
            CursorIcon::Crosshair
        } else {
            CursorIcon::None
        });
        rings(&painter, &found, settings.colors.foreground, &place);
    }
    saved(&painter, &painting.save, rect);
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

/// The drag of a gradient, with the colours of its ends.
fn gradient(painter: &Painter, [from, to]: [Pos2; 2], settings: &PaintSettings) {
    let color = |[r, g, b]: [u8; 3]| Color32::from_rgb(r, g, b);
    if settings.gradient.shape == GradientShape::Round {
        painter.circle_stroke(from, from.distance(to), Stroke::new(2.8, DARK.gamma_multiply(0.6)));
        painter.circle_stroke(from, from.distance(to), Stroke::new(1.0, Color32::from_white_alpha(150)));
    }
    line(painter, vec![from, to], 1.4, 1.0);
    let last = match settings.gradient.end {
        GradientEnd::Background => color(settings.colors.background),
        GradientEnd::Nothing => Color32::TRANSPARENT,
    };
    for (at, fill) in [(from, color(settings.colors.foreground)), (to, last)] {
        painter.circle(at, 7.0, DARK, Stroke::NONE);
        painter.circle(at, 5.5, fill, Stroke::new(1.4, Color32::WHITE));
    }
}

/// What is not applied yet: its outline, and the handles that scale and turn it.
fn placing(painter: &Painter, outline: &PlacingOutline, place: &impl Fn(DVec2) -> Pos2) {
    let closed = outline.outline.iter().chain(outline.outline.first()).map(|&at| place(at));
    let closed: Vec<Pos2> = closed.collect();
    painter.add(Shape::line(closed.clone(), Stroke::new(2.5, DARK)));
    painter.add(Shape::line(closed, Stroke::new(1.2, theme::ACCENT)));
    for at in outline.corners.iter().chain([&outline.knob]) {
        handle(painter, place(*at));
    }
}

fn handle(painter: &Painter, at: Pos2) {
    painter.circle(at, HANDLE, Color32::from_black_alpha(160), Stroke::new(1.5, theme::STRONG));
}

/// The mirror's plane, or the axis of radial symmetry.
fn plane(painter: &Painter, viewer: &Viewer, line: &[Vec<DVec3>], place: &impl Fn(DVec2) -> Pos2) {
    let symmetry = &viewer.settings.paint.symmetry;
    let Some(painting) = viewer.painting.as_ref().filter(|_| symmetry.shows_plane) else { return };
    let (bounds, view) = (&painting.bounds, viewer.viewpoint());
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
    let Some(work) = painting.work.clone() else { return ui.data_mut(|data| data.remove::<f64>(since)) };
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

// The picture over the view: what it is, where it lies, and the handles that move it.

/// Pixels of the picture on the screen, at most.
const MAX_PIXELS: u32 = 1024;

/// Radius of a handle, points.
const HANDLE: f32 = 7.0;

/// Points of scrolling that make the picture half as large again.
const SCROLL: f32 = 200.0;

/// Settings in the panel.
pub(crate) fn stencil(ui: &mut Ui, viewer: &mut Viewer) {
    let view_aspect = viewer.aspect();
    let stencil = &mut viewer.settings.paint.stencil;
    heading(ui, "Picture over the view");
    let mut command = None;
    let mut asks_file = false;
    ui.horizontal(|ui| {
        ui.checkbox(&mut stencil.is_on, "On").on_hover_text("N");
        asks_file = file_button(ui, stencil.image.as_deref(), "A picture to paint through").clicked();
    });
    if stencil.is_on && stencil.image.is_some() {
        row(ui, "Paints", |ui| {
            let inner = ui.horizontal(|ui| segments(ui, &mut stencil.paints, &StencilUse::ALL));
            inner.response.on_hover_text("Through its alpha or brightness, or with its colours")
        });
        percent(ui, "Seen", &mut stencil.opacity, "How much of it is seen over the scene");
        let height = number("Height", "", 2, "In heights of the view");
        let [least, most] = StencilSettings::HEIGHTS;
        height.logarithmic().show(ui, &mut stencil.place.height, least..=most);
        number("Angle", "°", 0, "").show(ui, &mut stencil.place.angle, -180.0..=180.0);
        let picture = viewer.painting.as_mut().and_then(|painting| painting.stencil(stencil).ok().flatten());
        ui.horizontal(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            if ui
                .selectable_label(stencil.is_adjusted, "Move")
                .on_hover_text("Drag, wheel and handles move it (Shift + N)")
                .clicked()
            {
                stencil.is_adjusted = !stencil.is_adjusted;
            }
            if ui.button("Fit").on_hover_text("As large as the view allows").clicked()
                && let Some(picture) = &picture
            {
                stencil.fit([picture.aspect(), view_aspect]);
            }
            if ui.button("Reset").on_hover_text("Upright, as high as the view").clicked() {
                stencil.reset();
            }
            if ui
                .selectable_label(stencil.place.mirrored, "Flip")
                .on_hover_text("Left and right change")
                .clicked()
            {
                stencil.place.mirrored = !stencil.place.mirrored;
            }
            if ui.button("Project").on_hover_text("Onto all that is seen, at once (Ctrl + J)").clicked() {
                command = Some(Command::Paint(PaintCommand::Project));
            }
        });
        if let Some(painting) = &mut viewer.painting
            && let Err(reason) = painting.stencil(&viewer.settings.paint.stencil)
        {
            ui.label(RichText::new(reason).small().color(theme::WARNING));
        }
    }
    if asks_file {
        viewer.request(Request::Dialog(FileDialog::Stencil));
    }
    if let Some(command) = command {
        viewer.command(command);
    }
}

/// Draws the picture over the scene, with handles while it is moved.
pub(in crate::panels) fn stencil_overlay(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
    let settings = viewer.settings.paint.stencil.clone();
    let Some(painting) = viewer.painting.as_mut().filter(|_| settings.is_on) else { return };
    let Ok(Some(picture)) = painting.stencil(&settings) else { return };
    let texture = texture(ui, &picture, settings.paints);
    let painter = ui.painter().with_clip_rect(rect);
    let corners = settings.corners(picture.aspect()).map(|corner| in_window(rect, corner));
    let mut mesh = Mesh::with_texture(texture.id());
    let tint = Color32::from_white_alpha((settings.opacity.clamp(0.0, 1.0) * 255.0) as u8);
    for (corner, (u, v)) in corners.iter().zip([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]) {
        let u = if settings.place.mirrored { 1.0 - u } else { u };
        mesh.vertices.push(eframe::egui::epaint::Vertex { pos: *corner, uv: pos2(u, v), color: tint });
    }
    mesh.add_triangle(0, 1, 2);
    mesh.add_triangle(0, 2, 3);
    painter.add(Shape::mesh(mesh));
    stencil_outline(&painter, corners, settings.is_adjusted);
    if settings.is_adjusted {
        for at in corners.into_iter().chain([turn_handle(rect, &settings, picture.aspect())]) {
            handle(&painter, at);
        }
    }
}

fn stencil_outline(painter: &Painter, corners: [Pos2; 4], is_strong: bool) {
    let closed: Vec<Pos2> = corners.into_iter().chain([corners[0]]).collect();
    let color = if is_strong { theme::ACCENT } else { theme::ACCENT.gamma_multiply(0.4) };
    painter.add(Shape::line(closed.clone(), Stroke::new(2.5, Color32::from_black_alpha(110))));
    painter.add(Shape::line(closed, Stroke::new(1.2, color)));
}

/// The picture as the screen shows it; made once.
fn texture(ui: &Ui, picture: &Arc<StencilPicture>, paints: StencilUse) -> TextureHandle {
    type Known = (Arc<StencilPicture>, StencilUse, TextureHandle);
    let id = Id::unique("stencil picture");
    let known = ui.data(|data| data.get_temp::<Known>(id));
    if let Some((_, _, texture)) = known.filter(|(of, use_, _)| Arc::ptr_eq(of, picture) && *use_ == paints) {
        return texture;
    }
    let (extent, pixels) = picture.pixels(MAX_PIXELS, paints);
    let pixels = pixels.into_iter().map(|[r, g, b, a]| Color32::from_rgba_unmultiplied(r, g, b, a));
    let image = ColorImage::new(extent, pixels.collect());
    let texture = ui.ctx().load_texture("stencil", image, TextureOptions::LINEAR);
    ui.data_mut(|data| data.insert_temp::<Known>(id, (picture.clone(), paints, texture.clone())));
    texture
}

/// A place of the view, in half heights from its middle and upwards positive, in the window.
fn in_window(rect: Rect, at: DVec2) -> Pos2 {
    rect.center() + vec2(at.x as f32, -at.y as f32) * (0.5 * rect.height())
}

/// The inverse of [`in_window`].
fn in_view(rect: Rect, at: Pos2) -> DVec2 {
    let q = (at - rect.center()) / (0.5 * rect.height().max(1.0));
    DVec2::new(f64::from(q.x), -f64::from(q.y))
}

/// The handle that turns: above the picture's upper side.
fn turn_handle(rect: Rect, settings: &StencilSettings, aspect: f64) -> Pos2 {
    let [a, b, ..] = settings.corners(aspect);
    let up = DVec2::from_angle(settings.place.angle.to_radians()).perp();
    in_window(rect, 0.5 * (a + b) + up * (50.0 / f64::from(rect.height().max(1.0))))
}

/// What a drag of the picture does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Grip {
    Move,
    Scale,
    Turn,
}

/// Lets the pointer move the picture instead of painting; what is left of the input is for the camera.
pub(in crate::panels) fn adjust(
    ui: &Ui,
    viewer: &mut Viewer,
    response: &Response,
    rect: Rect,
    input: &mut SceneInput,
) {
    let settings = &mut viewer.settings.paint.stencil;
    if !(settings.is_on && settings.is_adjusted) {
        return;
    }
    let Some(painting) = &mut viewer.painting else { return };
    let Ok(Some(picture)) = painting.stencil(settings) else { return };
    // What was begun before ends all the same.
    input.pen.retain(|event| event.phase == PenPhase::Up);
    input.drag = DVec2::ZERO;
    let id = Id::unique("stencil grip");
    let near = |at: Pos2, place: Pos2| at.distance(place) <= 2.0 * HANDLE;
    if response.drag_started()
        && let Some(at) = ui.input(|i| i.pointer.press_origin())
    {
        let corners = settings.corners(picture.aspect()).map(|corner| in_window(rect, corner));
        let grip = if near(at, turn_handle(rect, settings, picture.aspect())) {
            Grip::Turn
        } else if corners.into_iter().any(|corner| near(at, corner)) {
            Grip::Scale
        } else {
            Grip::Move
        };
        ui.data_mut(|data| data.insert_temp(id, grip));
    }
    let grip = ui.data(|data| data.get_temp::<Grip>(id));
    if response.dragged_by(eframe::egui::PointerButton::Primary)
        && let (Some(grip), Some(now)) = (grip, response.interact_pointer_pos())
    {
        let middle = DVec2::from(settings.place.center);
        let [from, to] = [in_view(rect, now - response.drag_delta()), in_view(rect, now)];
        match grip {
            Grip::Move => settings.shift(to - from),
            Grip::Scale => settings.scale((to - middle).length() / (from - middle).length().max(1e-3)),
            Grip::Turn => settings.turn(degrees_between(from - middle, to - middle)),
        }
    }
    if response.hovered() && input.wheel != 0.0 {
        settings.scale(1.5f64.powf(input.wheel * f64::from(50.0 / SCROLL)));
        input.wheel = 0.0;
    }
    response.clone().on_hover_cursor(eframe::egui::CursorIcon::Move);
}
