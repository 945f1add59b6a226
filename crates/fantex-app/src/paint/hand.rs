//! The hand with the pen: strokes, lines, fills, stickers, picking.

use std::path::PathBuf;
use std::sync::Arc;

use eframe::egui::Modifiers;
use fantex::glam::{DVec2, Vec3, Vec4};
use fantex::paint::{
    BlendMode, Brush, ChannelPaint, ChannelSettings, ColorSettings, DecalSettings, FillSettings,
    LayerContent, LoadedFiles, Paint, PaintColor, PicturePlace, Sample, SampleSettings, Sight, Size, Stamp,
    StencilSettings, StrokeSettings, Surface, SurfacePoint, Target, TextSettings, Tool, ToolSettings, Where,
    groups_around,
};
use fantex::store::{Channel, ChannelKind};

use crate::notices::Notices;
use crate::paint::cursor::world_position;
use crate::paint::files::load_image;
use crate::paint::gradient::GradientDrag;
use crate::paint::painting::{ChosenStamp, Hand};
use crate::paint::placing::Placing;
use crate::paint::stencil::{projection_view, recorded_use};
use crate::paint::{
    ChosenTexture, ColorSource, FileState, LoadedFile, Order, PaintSettings, PaintTool, Painting, PenEvent,
    PenPhase, StickerKind, StrokeStart, Viewpoint,
};
use crate::settings::label_of;

/// A drag that is shorter, in shares of the scene's sides, is a click.
pub(super) const CLICK_SHARE: f64 = 0.006;

impl Painting {
    /// What the pen did in this frame. With Shift it draws lines, with Alt it picks.
    pub fn pen(
        &mut self,
        events: &[PenEvent],
        settings: &mut PaintSettings,
        view: &Viewpoint,
        modifiers: Modifiers,
        notices: &mut Notices,
    ) {
        self.follow_placing(settings, view, notices);
        // What a stroke has gone through since the last order.
        let mut samples = Vec::new();
        for event in events {
            // What was taken hold of is let go whatever is held by then.
            let has_grip = self.placing.as_ref().is_some_and(Placing::is_held);
            if (has_grip || !modifiers.alt) && self.pen_on_placing(event, settings, view) {
                self.follow_placing(settings, view, notices);
                continue;
            }
            let hit = view.hit(&self.surface, event.at);
            let sample = hit.map(|point| Sample { pressure: event.pressure, ..Sample::at(point) });
            match event.phase {
                PenPhase::Turn => self.hand = Hand::Turn,
                PenPhase::Down => self.pen_down(event.at, sample, settings, view, modifiers, notices),
                PenPhase::Move => match (self.hand, sample) {
                    (Hand::Wait, Some(sample)) => {
                        self.hand = Hand::Idle;
                        self.missed = None;
                        self.touch((sample, event.at), settings, view, false, notices);
                    }
                    (Hand::AltTurn(Some((_, down))), _) if (event.at - down).length() > CLICK_SHARE => {
                        self.hand = Hand::AltTurn(None);
                    }
                    (Hand::Stroke(last), _) => self.go_on(last, sample, &mut samples),
                    (Hand::Gradient(drag), _) => self.hand = Hand::Gradient(drag.moved(event.at)),
                    _ => {}
                },
                PenPhase::Up => match std::mem::take(&mut self.hand) {
                    Hand::Stroke(last) => {
                        self.thread.order(Order::Move(std::mem::take(&mut samples)));
                        self.thread.order(Order::End(last));
                    }
                    Hand::Gradient(drag) => self.lay_gradient(drag.moved(event.at), settings, view, notices),
                    Hand::AltTurn(Some((point, _))) => self.pick(point, settings, notices),
                    Hand::Wait => self.missed = Some(notices.now),
                    Hand::Idle | Hand::Turn | Hand::AltTurn(None) => {}
                },
            }
        }
        if !samples.is_empty() {
            self.thread.order(Order::Move(samples));
        }
    }

    /// The pen touches the scene, and with a `sample` the model.
    fn pen_down(
        &mut self,
        at: DVec2,
        sample: Option<Sample>,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        modifiers: Modifiers,
        notices: &mut Notices,
    ) {
        if sample.is_some() {
            self.missed = None;
        }
        match sample {
            _ if modifiers.alt && settings.alt_turns => {
                self.hand = Hand::AltTurn(sample.map(|sample| (sample.point, at)));
            }
            None if settings.alt_turns && settings.tool.has_brush() => self.hand = Hand::Wait,
            None => {
                self.hand = Hand::Turn;
                self.missed = Some(notices.now);
            }
            Some(sample) if modifiers.alt || settings.tool == PaintTool::Pick => {
                self.pick(sample.point, settings, notices);
            }
            Some(sample) => self.touch((sample, at), settings, view, modifiers.shift, notices),
        }
    }

    /// A stroke goes on from its `last` sample; `samples` are those that are not ordered yet.
    fn go_on(&mut self, last: Option<Sample>, sample: Option<Sample>, samples: &mut Vec<Sample>) {
        if let Some(sample) = sample {
            samples.push(sample);
            self.last = Some(sample.point);
        } else if last.is_some() {
            // It goes on where it comes back, without a line between.
            self.thread.order(Order::Move(std::mem::take(samples)));
            self.thread.order(Order::Lift);
        }
        self.hand = Hand::Stroke(sample);
    }

    fn pick(&mut self, point: SurfacePoint, settings: &PaintSettings, notices: &mut Notices) {
        if settings.tool == PaintTool::Clone {
            self.source = Some(point);
            notices.info("Clone: drag now to copy from there.");
        } else {
            self.thread.order(Order::Pick(point));
        }
    }

    /// `at`: along the scene's sides.
    fn touch(
        &mut self,
        (sample, at): (Sample, DVec2),
        settings: &mut PaintSettings,
        view: &Viewpoint,
        is_line: bool,
        notices: &mut Notices,
    ) {
        if settings.tool == PaintTool::Sticker {
            if settings.texture.source == ColorSource::Color {
                settings.colors.used();
            }
            return self.place(sample.point, at, settings, view, notices);
        }
        if settings.tool == PaintTool::Gradient {
            // What cannot be painted is said before the drag.
            return match self.paint(sample.point, settings, view) {
                Ok(_) => self.hand = Hand::Gradient(GradientDrag::begun(sample.point, at)),
                Err(reason) => notices.warning(reason),
            };
        }
        let start = match self.start(sample.point, settings, view, notices) {
            Ok(start) => start,
            Err(reason) => return notices.warning(reason),
        };
        if settings.tool.has_color() && settings.texture.source == ColorSource::Color {
            settings.colors.used();
        }
        if settings.tool == PaintTool::Fill {
            return self.fill(start, sample.point, settings);
        }
        match self.last.filter(|_| is_line) {
            Some(from) => {
                self.thread.order(Order::Begin(start, Sample { point: from, ..sample }));
                self.thread.order(Order::End(Some(sample)));
            }
            None => {
                self.thread.order(Order::Begin(start, sample));
                self.hand = Hand::Stroke(Some(sample));
            }
        }
        self.last = Some(sample.point);
    }

    /// Fills from a point on, as far as the settings say.
    pub(super) fn fill(&self, mut start: Box<StrokeStart>, point: SurfacePoint, settings: &PaintSettings) {
        let fill = settings.fill.fill(settings.fill_degrees, settings.fill_tolerance);
        start.recorded.fill = Some(fill);
        start.recorded.samples = vec![sample_at(&self.surface, point)];
        self.thread.order(Order::Fill(start, Some(point), fill));
    }

    /// Projects the picture over the view onto all that is seen.
    pub fn project(&mut self, settings: &mut PaintSettings, view: &Viewpoint, notices: &mut Notices) {
        self.apply_placing();
        let before = (settings.tool, settings.stencil.is_on);
        (settings.tool, settings.stencil.is_on) = (PaintTool::Paint, true);
        // Nothing that it does depends on where it starts.
        let anywhere = SurfacePoint { triangle: 0, lambda: Vec3::X };
        let start = self.start(anywhere, settings, view, notices);
        (settings.tool, settings.stencil.is_on) = before;
        match start {
            Ok(_) if settings.stencil.image.is_none() => {
                notices.warning("There is no picture over the view: choose one first.");
            }
            Ok(mut start) => {
                start.label = "project".into();
                start.recorded.label.clone_from(&start.label);
                start.recorded.fill = Some(FillSettings::Whole);
                self.leave_stroke(Order::Fill(start, None, FillSettings::Whole));
            }
            Err(reason) => notices.warning(reason),
        }
    }

    /// What a stroke begins with, or why it cannot.
    pub(super) fn start(
        &mut self,
        point: SurfacePoint,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        notices: &mut Notices,
    ) -> Result<Box<StrokeStart>, String> {
        let (mut paint, sources) = self.paint(point, settings, view)?;
        let stamp = self.stamp(settings, notices);
        let mut files = LoadedFiles::new();
        files.extend(
            stamp.as_ref().and_then(|chosen| chosen.file.clone()).map(|file| (file.path, file.bytes)),
        );
        files.extend(sources.stencil.as_ref().map(|file| (file.path.clone(), Arc::clone(&file.bytes))));
        self.strokes += 1;
        let label = label_of(&PaintTool::ALL, settings.tool).to_lowercase();
        let mut recorded = recorded(&label, &paint, &self.channels, &sources, &self.surface);
        if settings.tool.has_brush() {
            recorded.brush.stamp.clone_from(&settings.brush.stamp);
            recorded.brush.tip = settings.brush.tip;
        }
        if let (ToolSettings::Clone { from }, Some(source)) = (&mut recorded.tool, self.source()) {
            *from = source.to_array();
        }
        if let Some(path) = settings.stencil.image.clone().filter(|_| paint.stencil.is_some()) {
            recorded.projection = Some(projection_view(view, settings.stencil.place));
            recorded.stencil =
                Some(StencilSettings { image: path, by: recorded_use(settings.stencil.paints) });
        }
        let world_per_pixel = view.world_per_pixel(world_position(&self.surface, point));
        let symmetry = settings.symmetry.symmetry(self.bounds.center());
        let brush = settings.brush.brush(world_per_pixel, self.strokes);
        let is_clone = settings.tool == PaintTool::Clone;
        if is_clone {
            // How far it looks for the surface depends on it.
            recorded.brush.size = brush.size;
        }
        if settings.brush.only_seen && settings.tool.has_brush() {
            let degrees = settings.brush.seen_degrees.clamp(1.0, 90.0);
            let camera =
                *recorded.projection.get_or_insert_with(|| projection_view(view, PicturePlace::default()));
            paint.sight = Sight::new(&self.surface, &camera, degrees, &symmetry).map(Arc::new);
            recorded.only_seen = Some(degrees);
        }
        if paint.sight.is_some() || is_clone || !settings.tool.has_brush() {
            recorded.symmetry = symmetry;
        }
        let target = self.target;
        let stamp = stamp.map(|chosen| chosen.stamp);
        Ok(Box::new(StrokeStart { label, target, paint, brush, stamp, symmetry, recorded, files }))
    }

    /// Lets the painter show a sticker on the surface.
    pub(super) fn lay(&self, mut start: Box<StrokeStart>, placing: &Placing, settings: &PaintSettings) {
        let decal = placing.decal().clone();
        let scale = self.surface.mesh().world_from_mesh.scale;
        let world = |length: f32| Size::World((f64::from(length) * scale) as f32);
        let (angle, mirrored) = (decal.angle.to_degrees(), decal.mirrored);
        start.recorded.samples = vec![sample_at(&self.surface, decal.center)];
        if settings.sticker == StickerKind::Text {
            let size = world(placing.line());
            let text = settings.text.clone();
            start.recorded.text = Some(TextSettings { text, font: None, size, angle, mirrored });
        } else {
            let is_mask = matches!(self.target, Target::Mask(_));
            let kind = if is_mask { ChannelKind::BaseColor } else { settings.picture_use.kind() };
            // Normals and heights lie where their picture is opaque.
            let shape = settings.picture.clone().filter(|_| kind == ChannelKind::BaseColor);
            start.recorded.decal = Some(DecalSettings { shape, size: world(decal.size), angle, mirrored });
            for (paint, recorded) in start.paint.channels.iter_mut().zip(&mut start.recorded.channels) {
                if self.channels[paint.channel].kind == kind {
                    paint.color = PaintColor::Image(decal.shape.clone());
                    recorded.color = ColorSettings::Image(settings.picture.clone().unwrap_or_default());
                }
            }
        }
        self.thread.order(Order::Place(start, decal, settings.sticker == StickerKind::Text));
    }

    /// What a stroke that begins here does and what it is made of, or why it cannot.
    fn paint(
        &mut self,
        start: SurfacePoint,
        settings: &PaintSettings,
        view: &Viewpoint,
    ) -> Result<(Paint, PaintSources), String> {
        let is_mask = matches!(self.target, Target::Mask(_));
        self.check_layer(is_mask)?;
        let color = settings.colors.linear();
        let mut channels = settings.channels.paint(&self.channels, color, &settings.material);
        if is_mask {
            let grey = Vec4::new(color.x, color.y, color.z, 1.0);
            channels = vec![ChannelPaint::new(0, PaintColor::Constant(grey))];
        }
        let mut sources = PaintSources::default();
        let mut set_color = |color: &PaintColor, all: &[Channel]| {
            let colors =
                channels.iter_mut().filter(|paint| all[paint.channel].kind == ChannelKind::BaseColor);
            colors.for_each(|paint| paint.color = color.clone());
        };
        if settings.tool.has_color()
            && !is_mask
            && let Some(chosen) = self.texture(&settings.texture)?
        {
            set_color(&PaintColor::Texture(chosen.texture.clone()), &self.channels);
            sources.texture = Some(chosen);
        }
        let mut stencil = None;
        if let Some(picture) = self.stencil(&settings.stencil)? {
            let beside = || "The picture over the view cannot be projected from here.".to_owned();
            let found = picture.projections(&settings.stencil, &self.surface, view).ok_or_else(beside)?;
            stencil = Some(found.0);
            sources.stencil = Some(picture.file().clone());
            if let Some(colors) = found.1.filter(|_| settings.tool.has_color() && !is_mask) {
                set_color(&PaintColor::Projected(colors), &self.channels);
                sources.picture = Some(picture.path().to_owned());
            }
        }
        if settings.tool == PaintTool::Opacity {
            if is_mask {
                return Err("A mask has no opacity: paint it black or white.".into());
            }
            let Some(index) = self.channels.iter().position(|channel| channel.kind == ChannelKind::BaseColor)
            else {
                return Err(
                    "The asset has no base colour, which holds the opacity: Add channel gives it one.".into(),
                );
            };
            channels = vec![ChannelPaint::new(index, PaintColor::Constant(color))];
        }
        if channels.is_empty() {
            return Err("No channel is switched on: choose what the brush paints.".into());
        }
        let tool = self.tool(start, settings, view)?;
        Ok((Paint { tool, opacity: settings.brush.opacity, channels, stencil, sight: None }, sources))
    }

    /// Refuses, in a sentence, to paint on the chosen layer, or on its mask, as it is.
    fn check_layer(&self, is_mask: bool) -> Result<(), String> {
        let Some(layer) = self.layer() else { return Ok(()) };
        if !layer.visible {
            return Err("The layer is hidden: show it to paint on it.".into());
        }
        let around = groups_around(&self.snapshot.layers, layer.id());
        if self.snapshot.layers.iter().any(|group| around.contains(&group.id()) && !group.visible) {
            return Err("The layer's group is hidden: show it to paint on the layer.".into());
        }
        if !is_mask && layer.group_kind().is_some() {
            return Err("A group is chosen: choose a layer in it, or its mask, to paint on.".into());
        }
        if !is_mask && !matches!(layer.content, LayerContent::Painted) {
            let text = "A fill layer is painted through its mask: choose the mask, or add one.";
            return Err(text.into());
        }
        Ok(())
    }

    /// What a stroke that begins here does to the texels, or why it cannot.
    fn tool(&self, start: SurfacePoint, settings: &PaintSettings, view: &Viewpoint) -> Result<Tool, String> {
        Ok(match settings.tool {
            PaintTool::Erase if self.target == Target::Base => {
                let text = "There is nothing below the base to show: add a layer, paint and erase there.";
                return Err(text.into());
            }
            PaintTool::Erase => Tool::Erase,
            PaintTool::Opacity => Tool::Opacity { to: settings.opacity_to.clamp(0.0, 1.0) },
            PaintTool::Blur => {
                let diameter = self.world_size(settings, view, start);
                let scale = self.surface.mesh().world_from_mesh.scale;
                Tool::Blur { radius: settings.blur_radius.max(0.01) * (diameter / scale) as f32 }
            }
            PaintTool::Clone => {
                let Some(source) = self.source else {
                    return Err("Alt + click on the surface first: cloning copies from there.".into());
                };
                let [from, to] = [source, start].map(|point| self.surface.position(point).as_vec3());
                let brush = Size::World(self.world_size(settings, view, start) as f32);
                let symmetry = settings.symmetry.symmetry(self.bounds.center());
                Tool::clone_of(&self.surface, from, to, brush, symmetry)
            }
            PaintTool::Smudge => Tool::Smudge { strength: settings.smudge.clamp(0.0, 1.0) },
            PaintTool::Paint => Tool::Paint(settings.brush.blend),
            PaintTool::Fill | PaintTool::Gradient | PaintTool::Sticker | PaintTool::Pick => {
                Tool::Paint(BlendMode::Normal)
            }
        })
    }

    /// What shapes the brush's dabs; made once and whenever its file has changed.
    fn stamp(&mut self, settings: &mut PaintSettings, notices: &mut Notices) -> Option<ChosenStamp> {
        let file = settings.brush.stamp.clone().map(|path| (FileState::of(&path), path));
        let wanted = (file.map(|(state, path)| (path, state)), settings.brush.tip);
        if let Some((known, stamp)) = &self.stamp
            && *known == wanted
        {
            return Some(stamp.clone());
        }
        let made = match &wanted {
            (Some((path, _)), _) => {
                load_image(path).and_then(|(file, image)| Ok((Stamp::new(&image)?, Some(file))))
            }
            (None, Some(tip)) => Stamp::of_tip(*tip).map(|stamp| (stamp, None)),
            (None, None) => return None,
        };
        match made {
            Ok((stamp, file)) => {
                let chosen = ChosenStamp { stamp: Arc::new(stamp), file };
                self.stamp = Some((wanted, chosen.clone()));
                Some(chosen)
            }
            Err(error) => {
                settings.brush.stamp = None;
                notices.error(error.to_string());
                None
            }
        }
    }
}

// What the hand does in the terms of stroke files, for the asset's log.

/// What a paint is made of, besides constants.
#[derive(Clone, Debug, Default)]
struct PaintSources {
    /// The texture of the base colour.
    texture: Option<ChosenTexture>,
    /// The picture of the base colour.
    picture: Option<PathBuf>,
    /// The picture over the view.
    stencil: Option<LoadedFile>,
}

/// A stroke that paints so; where it paints comes on top.
fn recorded(
    label: &str,
    paint: &Paint,
    channels: &[Channel],
    sources: &PaintSources,
    surface: &Surface,
) -> StrokeSettings {
    let color = |color: &PaintColor| match (color, &sources.texture, &sources.picture) {
        (PaintColor::Constant(color), _, _) => ColorSettings::Linear(color.to_array()),
        (PaintColor::Texture(_), Some(chosen), _) => {
            ColorSettings::Texture { look: chosen.look(), name: chosen.name.clone() }
        }
        (PaintColor::Image(_) | PaintColor::Projected(_), _, Some(path)) => {
            ColorSettings::Image(path.clone())
        }
        _ => ColorSettings::default(),
    };
    let settings = paint.channels.iter().map(|painted| ChannelSettings {
        kind: channels[painted.channel].kind,
        color: color(&painted.color),
        components: painted.components,
    });
    StrokeSettings {
        label: label.to_owned(),
        brush: Brush { opacity: paint.opacity, ..Brush::default() },
        // Where a clone copies from is added where it is known.
        tool: ToolSettings::of(&paint.tool, surface),
        channels: settings.collect(),
        ..StrokeSettings::default()
    }
}

/// A point as a sample.
fn sample_at(surface: &Surface, point: SurfacePoint) -> SampleSettings {
    // Made fit for other meshes when it is recorded.
    let at = Where::Position(world_position(surface, point).to_array());
    let is_exact = point.lambda.min_element() >= 0.0;
    let exact = Where::Point { triangle: point.triangle, lambda: point.lambda.to_array() };
    SampleSettings { at: if is_exact { exact } else { at }, pressure: 1.0, tilt: [0.0; 2], time: 0.0 }
}
