//! The picture over the view: what it is, where it lies, and the handles that move it.

use std::sync::Arc;

use eframe::egui::{
    Button, Color32, ColorImage, Id, Mesh, Painter, Pos2, Rect, Response, RichText, Shape, Stroke,
    TextureHandle, TextureOptions, Ui, pos2, vec2,
};
use glam::DVec2;

use crate::command::Command;
use crate::paint::{PaintCommand, StencilPicture, StencilSettings, StencilUse};
use crate::panels::widgets::{NumberRow, heading, row, segments};
use crate::theme;
use crate::viewer::{Request, SceneInput, Viewer};

use super::brush::percent;

/// Pixels of the picture on the screen, at most.
const MOST_PIXELS: u32 = 1024;

/// Radius of a handle, points.
const HANDLE: f32 = 7.0;

/// Points of scrolling that make the picture half as large again.
const SCROLL: f32 = 200.0;

/// Settings in the panel.
pub(super) fn show(ui: &mut Ui, viewer: &mut Viewer, seconds: f64) {
    let view_aspect = viewer.aspect();
    let stencil = &mut viewer.settings.paint.stencil;
    heading(ui, "Picture over the view");
    let mut command = None;
    let mut asks_file = false;
    ui.horizontal(|ui| {
        ui.checkbox(&mut stencil.is_on, "On").on_hover_text("N");
        let name = stencil.image.as_ref().and_then(|path| path.file_name());
        let name = name.map_or("Choose …".into(), |name| name.to_string_lossy().into_owned());
        asks_file =
            ui.add(Button::new(name).truncate()).on_hover_text("A picture to paint through").clicked();
    });
    if stencil.is_on && stencil.image.is_some() {
        row(ui, "Paints", |ui| {
            let inner =
                ui.horizontal(|ui| segments(ui, &mut stencil.paints, &StencilUse::ALL, StencilUse::label));
            inner.response.on_hover_text("Through its alpha or brightness, or with its colours")
        });
        percent(ui, "Seen", &mut stencil.opacity, "How much of it is seen over the scene");
        let height = NumberRow {
            name: "Height",
            decimals: 2,
            is_logarithmic: true,
            tip: "In heights of the view",
            ..NumberRow::PLAIN
        };
        height.show(ui, &mut stencil.place.height, 0.05..=5.0);
        let angle = NumberRow { name: "Angle", suffix: "°", decimals: 0, ..NumberRow::PLAIN };
        angle.show(ui, &mut stencil.place.angle, -180.0..=180.0);
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
        viewer.request(Request::StencilDialog);
    }
    if let Some(command) = command {
        viewer.command(command, seconds);
    }
}

/// Draws the picture over the scene, with handles while it is moved.
pub(in crate::panels) fn overlay(ui: &Ui, viewer: &mut Viewer, rect: Rect) {
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
    outline(&painter, corners, settings.is_adjusted);
    if settings.is_adjusted {
        for at in corners.into_iter().chain([stalk(rect, &settings, picture.aspect())]) {
            painter.circle(at, HANDLE, Color32::from_black_alpha(160), Stroke::new(1.5, theme::STRONG));
        }
    }
}

fn outline(painter: &Painter, corners: [Pos2; 4], is_strong: bool) {
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
    let (extent, pixels) = picture.pixels(MOST_PIXELS, paints);
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
fn stalk(rect: Rect, settings: &StencilSettings, aspect: f64) -> Pos2 {
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
    input.pen.clear();
    input.drag = DVec2::ZERO;
    let id = Id::unique("stencil grip");
    let near = |at: Pos2, place: Pos2| at.distance(place) <= 2.0 * HANDLE;
    if response.drag_started()
        && let Some(at) = ui.input(|i| i.pointer.press_origin())
    {
        let corners = settings.corners(picture.aspect()).map(|corner| in_window(rect, corner));
        let grip = if near(at, stalk(rect, settings, picture.aspect())) {
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
            Grip::Turn => settings.turn((from - middle).angle_to(to - middle).to_degrees()),
        }
    }
    if response.hovered() && input.wheel != 0.0 {
        settings.scale(1.5f64.powf(input.wheel * f64::from(50.0 / SCROLL)));
        input.wheel = 0.0;
    }
    response.clone().on_hover_cursor(eframe::egui::CursorIcon::Move);
}
