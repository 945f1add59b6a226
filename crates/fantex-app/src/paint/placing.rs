//! A text or a picture that is not applied yet: it lies on the surface as it will, and is moved, turned and scaled by handles.

use std::sync::Arc;

use fantex::glam::{DVec2, DVec3};
use fantex::paint::{Decal, Surface, SurfacePoint, Target};
use fantex::store::ChannelKind;

use crate::notices::Notices;
use crate::paint::cursor::world_position;
use crate::paint::painting::Hand;
use crate::paint::texture::{StickerShape, sticker_shape};
use crate::paint::{
    ChannelSwitches, FileState, Order, PaintSettings, PaintTool, Painting, PenEvent, PenPhase, PictureUse,
    StickerKind, StrokeStart, Viewpoint, degrees_between,
};

/// Points from a handle within which it is taken.
const REACH: f64 = 14.0;

/// Points from the upper side to the handle that turns.
const KNOB: f64 = 34.0;

/// Points along a side of the outline.
const SIDE_POINTS: usize = 12;

/// What lies there before it is applied.
#[derive(Clone, Debug)]
pub(super) struct Placing {
    decal: Decal,
    /// Distance of a text's lines, or length of a picture's longer side, mesh units.
    line: f32,
    shape: StickerShape,
    /// With what, and from where, it is to be shown.
    settings: PaintSettings,
    view: Viewpoint,
    target: Target,
    grip: Option<Grip>,
    /// It has changed since it was shown last.
    is_stale: bool,
}

/// What a drag does, and where the pointer was last, along the scene's sides.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Grip {
    /// Moves; from the pointer to the middle.
    Move(DVec2),
    Scale(DVec2),
    Turn(DVec2),
}

/// Where it and its handles are seen, along the scene's sides.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacingOutline {
    pub middle: DVec2,
    /// Around the picture, from the upper left corner clockwise.
    pub outline: Vec<DVec2>,
    /// Handles that scale.
    pub corners: [DVec2; 4],
    /// The handle that turns.
    pub knob: DVec2,
}

impl Placing {
    /// None where a part of it lies behind the camera.
    fn outline(&self, surface: &Surface, view: &Viewpoint) -> Option<PlacingOutline> {
        let [right, up] = self.decal.axes(surface);
        let [columns, rows] = self.decal.shape.extent().map(|n| n as f64);
        let place = surface.mesh().world_from_mesh;
        let half = DVec2::new(columns, rows) / columns.max(rows) * (0.5 * f64::from(self.decal.size));
        let center = surface.position(self.decal.center);
        let seen = |at: DVec2| {
            let flat = center + right * (at.x * half.x) + up * (at.y * half.y);
            let found = surface.nearest(flat.as_vec3(), (0.6 * half.length()) as f32);
            let lain = found.map_or_else(|| place.point(flat.as_vec3()), |p| world_position(surface, p));
            view.project(lain)
        };
        let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, y)| DVec2::new(x, y));
        let along = |k: usize| {
            let (from, to) = (corners[k], corners[(k + 1) % 4]);
            (0..SIDE_POINTS).map(move |i| from.lerp(to, i as f64 / SIDE_POINTS as f64))
        };
        let outline = (0..4).flat_map(along).map(seen).collect::<Option<Vec<DVec2>>>()?;
        let middle = view.project(place.point(center.as_vec3()))?;
        let points = view.points();
        let top = outline[SIDE_POINTS / 2];
        let outward = ((top - middle) * points).normalize_or(DVec2::NEG_Y);
        let knob = top + outward * KNOB / points;
        Some(PlacingOutline {
            middle,
            corners: [0, 1, 2, 3].map(|k| outline[k * SIDE_POINTS]),
            outline,
            knob,
        })
    }
}

impl PlacingOutline {
    /// What is taken hold of at a place; none outside.
    fn grip(&self, at: DVec2, view: &Viewpoint) -> Option<Grip> {
        let points = view.points();
        let is_near = |handle: DVec2| ((handle - at) * points).length() <= REACH;
        if is_near(self.knob) {
            Some(Grip::Turn(at))
        } else if self.corners.into_iter().any(is_near) {
            Some(Grip::Scale(at))
        } else {
            self.contains(at).then_some(Grip::Move(self.middle - at))
        }
    }

    /// By the number of sides that a ray from there crosses.
    fn contains(&self, at: DVec2) -> bool {
        let next = self.outline.iter().cycle().skip(1);
        let crossed = self.outline.iter().zip(next).filter(|(a, b)| {
            (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        crossed.count() % 2 == 1
    }
}

impl Painting {
    /// Where what is not applied yet is seen, with its handles; none where there is no such thing.
    pub fn placing_outline(&self, view: &Viewpoint) -> Option<PlacingOutline> {
        self.placing.as_ref()?.outline(&self.surface, view)
    }

    /// Whether a text or a picture lies there that is not applied yet.
    pub fn is_placing(&self) -> bool {
        self.placing.is_some()
    }

    /// Applies a text or a picture that lies there. False where there is none.
    pub fn apply_placing(&mut self) -> bool {
        self.show_as_seen();
        let Some(placing) = self.placing.take() else { return false };
        self.last = Some(placing.decal.center);
        self.thread.order(Order::Apply);
        true
    }

    /// Lets the painter show what lies there as the window does, where it is behind.
    fn show_as_seen(&mut self) {
        let Some(placing) = self.placing.as_ref().filter(|placing| placing.is_stale) else { return };
        let (mut settings, view) = (placing.settings.clone(), placing.view);
        let target = std::mem::replace(&mut self.target, placing.target);
        // What it would say was said when it was laid.
        self.show_placing(&mut settings, &view, &mut Notices::default());
        self.target = target;
    }

    /// Takes a text or a picture away that is not applied yet, or the drag of a gradient. False where there is none.
    pub fn drop_placing(&mut self) -> bool {
        if matches!(self.hand, Hand::Gradient(_)) {
            self.hand = Hand::Idle;
            return true;
        }
        let was_there = self.placing.take().is_some();
        if was_there {
            self.thread.order(Order::TakeAway);
        }
        was_there
    }

    /// Lets what is not applied follow the settings: text, picture, colours, size, angle. Another tool applies it. Once a frame.
    pub fn follow_placing(&mut self, settings: &mut PaintSettings, view: &Viewpoint, notices: &mut Notices) {
        let Some(placing) = &self.placing else { return };
        if settings.tool != PaintTool::Sticker || placing.target != self.target {
            self.apply_placing();
            return;
        }
        let shape = |of: &PaintSettings| (of.sticker, of.text.clone(), of.picture.clone(), of.picture_use);
        let is_other = shape(&placing.settings) != shape(settings);
        let made = is_other.then(|| self.sticker_shape(settings));
        let Some(placing) = &mut self.placing else { return };
        placing.view = *view;
        let before = &placing.settings;
        if *before != *settings {
            if before.brush.unit == settings.brush.unit && before.brush.size > 0.0 {
                placing.line *= settings.brush.size / before.brush.size;
            }
            placing.settings = settings.clone();
            placing.is_stale = true;
        }
        match made {
            None => {}
            Some(Ok(shape)) => {
                shape.note.iter().for_each(|note| notices.warning(note));
                placing.shape = shape;
            }
            Some(Err(reason)) => {
                placing.is_stale = false;
                // A text that is being written may be empty.
                if settings.sticker != StickerKind::Text {
                    notices.warning(reason);
                }
            }
        }
        if self.placing.as_ref().is_some_and(|placing| placing.is_stale) && !self.thread.is_busy() {
            self.show_placing(settings, view, notices);
        }
    }

    /// Puts a text or a picture at a point.
    pub(super) fn place(
        &mut self,
        point: SurfacePoint,
        at: DVec2,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        notices: &mut Notices,
    ) {
        let shape = self.sticker_channel(settings).and_then(|_| self.sticker_shape(settings));
        let shape = match shape {
            Ok(shape) => shape,
            Err(reason) => return notices.warning(reason),
        };
        shape.note.iter().for_each(|note| notices.warning(note));
        let world = self.world_size(settings, view, point);
        let line = (world / self.surface.mesh().world_from_mesh.scale) as f32;
        let middle = view.project(world_position(&self.surface, point)).unwrap_or(at);
        let decal = self.decal_at(point, line, &shape, settings, view);
        // One that is partly behind the camera cannot be moved.
        self.apply_placing();
        self.placing = Some(Placing {
            decal,
            line,
            shape,
            settings: settings.clone(),
            view: *view,
            target: self.target,
            grip: Some(Grip::Move(middle - at)),
            is_stale: true,
        });
        if !self.show_placing(settings, view, notices) {
            self.placing = None;
        }
    }

    /// The text or the picture that is chosen; a picture is read once and whenever its file has changed. Else why there is none.
    fn sticker_shape(&mut self, settings: &PaintSettings) -> Result<StickerShape, String> {
        let make = || sticker_shape(settings).map_err(|error| error.to_string());
        let picture = settings.picture.as_ref().filter(|_| settings.sticker == StickerKind::Picture);
        let Some(path) = picture else { return make() };
        let key = ((path.clone(), settings.picture_use), FileState::of(path));
        if let Some((known, made)) = &self.sticker
            && *known == key
        {
            return made.clone();
        }
        let made = make();
        self.sticker = Some((key, made.clone()));
        made
    }

    /// As it lies at a point, right for whoever looks from here.
    fn decal_at(
        &self,
        center: SurfacePoint,
        line: f32,
        shape: &StickerShape,
        settings: &PaintSettings,
        view: &Viewpoint,
    ) -> Decal {
        let at = world_position(&self.surface, center);
        let is_behind = self.surface.outer_normal(center.triangle).dot(view.rig.eye - at) < 0.0;
        // Surfaces are wound either way.
        let turn = if is_behind { -1.0 } else { 1.0 };
        let angle = turn * settings.sticker_degrees.to_radians();
        Decal {
            center,
            size: shape.lines * line,
            angle,
            shape: Arc::clone(&shape.picture),
            mirrored: is_behind,
            copy: 0,
        }
    }

    /// Lets the painter show it as it lies. False where it cannot, which is told.
    fn show_placing(
        &mut self,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        notices: &mut Notices,
    ) -> bool {
        let Some(mut placing) = self.placing.take() else { return false };
        placing.is_stale = false;
        let center = placing.decal.center;
        placing.decal = self.decal_at(center, placing.line, &placing.shape, settings, view);
        let start = self.sticker_start(center, settings, view, notices);
        let is_shown = start.is_ok();
        match start {
            Ok(mut start) => {
                start.files.extend(placing.shape.file.clone().map(|file| (file.path, file.bytes)));
                self.lay(start, &placing, settings);
            }
            Err(reason) => notices.warning(reason),
        }
        self.placing = Some(placing);
        is_shown
    }

    /// The channel that the sticker alone goes into: that of pictures that are normals or heights; none where it is laid in what the
    /// brush paints, else why it cannot be laid.
    fn sticker_channel(&self, settings: &PaintSettings) -> Result<Option<ChannelKind>, String> {
        let is_other = settings.sticker == StickerKind::Picture
            && settings.picture_use != PictureUse::Color
            && !matches!(self.target, Target::Mask(_));
        let kind = settings.picture_use.kind();
        if is_other && self.channels.iter().all(|channel| channel.kind != kind) {
            let name = if kind == ChannelKind::Normal { "normals" } else { "height" };
            return Err(format!("The asset has no {name}: Add channel gives it some."));
        }
        Ok(is_other.then_some(kind))
    }

    /// What a sticker begins with.
    fn sticker_start(
        &mut self,
        point: SurfacePoint,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        notices: &mut Notices,
    ) -> Result<Box<StrokeStart>, String> {
        let before = settings.channels;
        if let Some(kind) = self.sticker_channel(settings)? {
            settings.channels = ChannelSwitches::only(kind);
        }
        let start = self.start(point, settings, view, notices);
        settings.channels = before;
        start
    }

    /// What the pen does with what lies there. False where it does something else.
    pub(super) fn pen_on_placing(
        &mut self,
        event: &PenEvent,
        settings: &mut PaintSettings,
        view: &Viewpoint,
    ) -> bool {
        let Some(outline) = self.placing_outline(view) else { return false };
        let hit = view.hit(&self.surface, event.at);
        let Some(placing) = &mut self.placing else { return false };
        match event.phase {
            PenPhase::Turn => return false,
            PenPhase::Up => return placing.grip.take().is_some(),
            PenPhase::Down => {
                // Elsewhere on the surface it comes there.
                placing.grip = outline.grip(event.at, view).or_else(|| hit.map(|_| Grip::Move(DVec2::ZERO)));
                if placing.grip.is_none() {
                    return false;
                }
            }
            PenPhase::Move => {}
        }
        let Some(grip) = placing.grip else { return false };
        let pixels = DVec2::from(view.pixels.map(|n| f64::from(n.max(1))));
        let from_middle = |at: DVec2| (at - outline.middle) * pixels;
        match grip {
            Grip::Move(offset) => {
                if let Some(center) = view.hit(&self.surface, event.at + offset) {
                    placing.is_stale |= placing.decal.center != center;
                    placing.decal.center = center;
                }
            }
            Grip::Scale(last) => {
                let factor = from_middle(event.at).length().max(2.0) / from_middle(last).length().max(2.0);
                placing.line *= factor as f32;
                placing.grip = Some(Grip::Scale(event.at));
                // The brush is as large as the next one.
                settings.brush.scale_size(factor as f32);
                placing.settings.brush.size = settings.brush.size;
                placing.is_stale = true;
            }
            Grip::Turn(last) => {
                // Rows go downwards: to the left is counter-clockwise.
                let degrees = -degrees_between(from_middle(last), from_middle(event.at));
                let turned = settings.sticker_degrees + degrees as f32;
                settings.sticker_degrees = (turned + 180.0).rem_euclid(360.0) - 180.0;
                placing.settings.sticker_degrees = settings.sticker_degrees;
                placing.grip = Some(Grip::Turn(event.at));
                placing.is_stale = true;
            }
        }
        // Its outline follows at once; the painter when it is ready.
        let (center, line, shape) = (placing.decal.center, placing.line, placing.shape.clone());
        let decal = self.decal_at(center, line, &shape, settings, view);
        if let Some(placing) = &mut self.placing {
            placing.decal = decal;
        }
        true
    }

    /// World-space middle of what is not applied yet, and degrees and world length of its longer side.
    pub fn placing_place(&self) -> Option<(DVec3, f32, f64)> {
        let placing = self.placing.as_ref()?;
        let size = f64::from(placing.decal.size) * self.surface.mesh().world_from_mesh.scale;
        let at = world_position(&self.surface, placing.decal.center);
        Some((at, placing.settings.sticker_degrees, size))
    }
}

impl Placing {
    pub(super) fn decal(&self) -> &Decal {
        &self.decal
    }

    /// Whether the pointer has taken hold of it.
    pub(super) fn is_held(&self) -> bool {
        self.grip.is_some()
    }

    /// Distance of lines or length of a picture, mesh units.
    pub(super) fn line(&self) -> f32 {
        self.line
    }
}
