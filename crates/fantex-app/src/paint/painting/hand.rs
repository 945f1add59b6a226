//! The hand with the pen: strokes, lines, fills, stickers, picking.

use std::sync::Arc;

use fantex_paint::{
    BlendMode, ChannelPaint, Decal, LayerContent, Paint, PaintColor, Sample, Stamp, SurfacePoint, Target,
    Tool,
};
use fantex_store::ChannelKind;
use fantex_texture::Image;
use glam::Vec4;

use super::{Hand, Painting};
use crate::notices::Notices;
use crate::paint::pattern::pattern;
use crate::paint::pen::world_position;
use crate::paint::sticker::sticker;
use crate::paint::{
    Order, PaintSettings, PaintTool, PenEvent, PenPhase, StickerKind, StrokeStart, Viewpoint,
};

impl Painting {
    /// What the pen did in this frame. `is_line` and `is_pick`: Shift and Alt are held.
    pub fn pen(
        &mut self,
        events: &[PenEvent],
        settings: &mut PaintSettings,
        view: &Viewpoint,
        [is_line, is_pick]: [bool; 2],
        notices: &mut Notices,
        seconds: f64,
    ) {
        let mut samples = Vec::new();
        for event in events {
            let hit = view.hit(&self.surface, event.at);
            let sample = hit.map(|point| Sample { pressure: event.pressure, ..Sample::at(point) });
            match event.phase {
                PenPhase::Down => match sample {
                    None => self.hand = Hand::Turn,
                    Some(sample) if is_pick || settings.tool == PaintTool::Pick => {
                        self.pick(sample.point, settings, notices, seconds);
                    }
                    Some(sample) => self.touch(sample, settings, view, is_line, notices, seconds),
                },
                PenPhase::Move => {
                    if let Hand::Stroke(last) = &mut self.hand {
                        if let Some(sample) = sample {
                            samples.push(sample);
                            self.last = Some(sample.point);
                        } else if last.is_some() {
                            // It goes on where it comes back, without a line between.
                            self.thread.order(Order::Move(std::mem::take(&mut samples)));
                            self.thread.order(Order::Lift);
                        }
                        *last = sample;
                    }
                }
                PenPhase::Up => {
                    if let Hand::Stroke(last) = std::mem::take(&mut self.hand) {
                        self.thread.order(Order::Move(std::mem::take(&mut samples)));
                        self.thread.order(Order::End(last));
                    }
                }
            }
        }
        if !samples.is_empty() {
            self.thread.order(Order::Move(samples));
        }
    }

    fn pick(&mut self, point: SurfacePoint, settings: &PaintSettings, notices: &mut Notices, seconds: f64) {
        if settings.tool == PaintTool::Clone {
            self.source = Some(point);
            notices.info("Clone: drag now to copy from there.", seconds);
        } else {
            self.thread.order(Order::Pick(point));
        }
    }

    fn touch(
        &mut self,
        sample: Sample,
        settings: &mut PaintSettings,
        view: &Viewpoint,
        is_line: bool,
        notices: &mut Notices,
        seconds: f64,
    ) {
        let paint = match self.paint(sample, settings, view) {
            Ok(paint) => paint,
            Err(reason) => return notices.warning(reason, seconds),
        };
        if settings.tool.has_color() {
            settings.colors.used();
        }
        let stamp = self.stamp(settings, notices, seconds);
        self.strokes += 1;
        let world_per_pixel = view.world_per_pixel(world_position(&self.surface, sample.point));
        let start = Box::new(StrokeStart {
            label: settings.tool.label().to_lowercase(),
            target: self.target,
            paint,
            brush: settings.brush.brush(world_per_pixel, stamp, self.strokes),
            symmetry: settings.symmetry.symmetry(self.bounds.center()),
        });
        if settings.tool == PaintTool::Fill {
            let fill = settings.fill.fill(settings.fill_degrees, settings.fill_tolerance);
            self.thread.order(Order::Fill(start, sample.point, fill));
            return;
        }
        if settings.tool == PaintTool::Sticker {
            let world = self.world_size(settings, view, sample.point);
            let at = world_position(&self.surface, sample.point);
            let is_behind = self.surface.facet_normal(sample.point.triangle).dot(view.rig.eye - at) < 0.0;
            let line = (world / self.surface.mesh().world_from_mesh.scale) as f32;
            match sticker(settings, sample.point, line, is_behind) {
                Ok(decal) => self.lay(start, decal, settings.sticker),
                Err(error) => notices.warning(error.to_string(), seconds),
            }
            return;
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

    /// Lays a sticker onto the surface.
    fn lay(&self, mut start: Box<StrokeStart>, decal: Decal, kind: StickerKind) {
        if kind == StickerKind::Picture {
            let kinds = |paint: &ChannelPaint| self.channels[paint.channel].kind == ChannelKind::BaseColor;
            for paint in start.paint.channels.iter_mut().filter(|paint| kinds(paint)) {
                paint.color = PaintColor::Image(decal.shape.clone());
            }
        }
        self.thread.order(Order::Lay(start, decal));
    }

    /// What a stroke that begins here does, or why it cannot.
    fn paint(
        &self,
        sample: Sample,
        settings: &PaintSettings,
        view: &Viewpoint,
    ) -> Result<Paint, &'static str> {
        let is_mask = matches!(self.target, Target::Mask(_));
        if let Some(layer) = self.layer() {
            if !layer.visible {
                return Err("The layer is hidden: show it to paint on it.");
            }
            if !is_mask && matches!(layer.content, LayerContent::Fill(_)) {
                return Err("A fill layer is painted through its mask: choose the mask.");
            }
        }
        let color = settings.colors.linear();
        let mut channels = settings.channels.paint(&self.channels, color, &settings.material);
        if is_mask {
            let grey = Vec4::new(color.x, color.y, color.z, 1.0);
            channels = vec![ChannelPaint { channel: 0, color: PaintColor::Constant(grey) }];
        }
        if let Some(name) = settings.pattern.as_deref().filter(|_| settings.tool.has_color() && !is_mask)
            && let Some(pattern) = pattern(name, &self.surface)
        {
            let colors = channels
                .iter_mut()
                .filter(|paint| self.channels[paint.channel].kind == ChannelKind::BaseColor);
            colors.for_each(|paint| paint.color = pattern.clone());
        }
        if channels.is_empty() {
            return Err("No channel is switched on: choose what the brush paints.");
        }
        let tool = match settings.tool {
            PaintTool::Erase if self.target == Target::Base => {
                return Err("There is nothing below the base to show: add a layer, paint and erase there.");
            }
            PaintTool::Erase => Tool::Erase,
            PaintTool::Blur => {
                let diameter = self.world_size(settings, view, sample.point);
                let scale = self.surface.mesh().world_from_mesh.scale;
                Tool::Blur { radius: settings.blur_radius.max(0.01) * (diameter / scale) as f32 }
            }
            PaintTool::Clone => {
                let Some(source) = self.source else {
                    return Err("Alt + click on the surface first: cloning copies from there.");
                };
                let offset = self.surface.position(source) - self.surface.position(sample.point);
                Tool::Clone { offset: offset.as_vec3(), reach: 0.1 }
            }
            PaintTool::Smudge => Tool::Smudge { strength: settings.smudge.clamp(0.0, 1.0) },
            PaintTool::Paint => Tool::Paint(settings.brush.blend),
            PaintTool::Fill | PaintTool::Sticker | PaintTool::Pick => Tool::Paint(BlendMode::Normal),
        };
        Ok(Paint { tool, opacity: settings.brush.opacity, channels })
    }

    /// The brush's picture; read once.
    fn stamp(
        &mut self,
        settings: &mut PaintSettings,
        notices: &mut Notices,
        seconds: f64,
    ) -> Option<Arc<Stamp>> {
        let path = settings.brush.stamp.clone()?;
        if let Some((known, stamp)) = &self.stamp
            && *known == path
        {
            return Some(stamp.clone());
        }
        match Image::load(&path) {
            Ok(image) => {
                let stamp = Arc::new(Stamp::new(&image));
                self.stamp = Some((path, stamp.clone()));
                Some(stamp)
            }
            Err(error) => {
                settings.brush.stamp = None;
                notices.error(error.to_string(), seconds);
                None
            }
        }
    }
}
