//! What the window does to what is painted on: orders of panels and keys, and the pen.

use fantex::base::{Error, Result};
use fantex::glam::DVec2;
use fantex::paint::{Layer, LayerPlace, Target};

use crate::camera::MoveInput;
use crate::display::ShadingView;
use crate::paint::{Alone, LayerAction, PaintCommand, PenEvent, PenPhase, Viewpoint};
use crate::session::LayerStep;
use crate::viewer::{SceneInput, Viewer};

impl Viewer {
    /// Something of the painter; nothing where nothing is painted on.
    pub fn paint_command(&mut self, command: &PaintCommand) {
        let view = self.viewpoint();
        let Some(painting) = &mut self.painting else { return };
        match command {
            PaintCommand::Project => {
                painting.project(&mut self.settings.paint, &view, &mut self.notices);
            }
            command => painting.command(command, &mut self.settings.paint),
        }
    }

    /// Takes a brush from those that are kept, by its name.
    ///
    /// # Errors
    /// There is none of this name.
    pub fn take_preset(&mut self, name: &str) -> Result<()> {
        let kept = self.painting.as_ref().map_or(&[][..], |painting| &painting.presets.brushes);
        let brush = kept.iter().find(|brush| brush.name == name);
        let none = || Error::not_found(format!("there is no brush named {name:?}"));
        self.settings.paint.brush = brush.ok_or_else(none)?.clone();
        Ok(())
    }

    pub fn layer_action(&mut self, action: &LayerAction) {
        if let Some(painting) = &mut self.painting
            && let Err(reason) = painting.layer_action(action, &self.settings.paint)
        {
            self.notices.warning(reason);
        }
        self.light_alone();
    }

    /// A layer's step of a session.
    ///
    /// # Errors
    /// There is no layer of the name that it says, or none is chosen.
    pub fn layer_step(&mut self, step: LayerStep) -> Result<()> {
        let Some(painting) = &self.painting else { return Ok(()) };
        let chosen = || {
            let none = || Error::not_found("no layer is chosen: the base is painted on");
            painting.layer().map(Layer::id).ok_or_else(none)
        };
        let find = |name: &str| {
            let none = || Error::not_found(format!("there is no layer named {name:?}"));
            painting.snapshot.layers.iter().find(|l| l.name == name).map(Layer::id).ok_or_else(none)
        };
        let action = match step {
            LayerStep::Add => LayerAction::Add,
            LayerStep::AddFill => LayerAction::AddFill(false),
            LayerStep::AddFillEverywhere => LayerAction::AddFill(true),
            LayerStep::Refill => LayerAction::Refill(chosen()?),
            LayerStep::Select(name) if name == "base" => LayerAction::Select(Target::Base),
            LayerStep::Select(name) => LayerAction::Select(Target::Layer(find(&name)?)),
            LayerStep::SelectMask(name) => LayerAction::Select(Target::Mask(find(&name)?)),
            LayerStep::Rename(name) => LayerAction::Rename(chosen()?, name),
            LayerStep::Opacity(opacity) => LayerAction::Opacity(chosen()?, opacity),
            LayerStep::Blend(mode) => LayerAction::Blend(chosen()?, mode),
            LayerStep::Show(is_shown) => LayerAction::Show(chosen()?, is_shown),
            LayerStep::AddMask(shows) => LayerAction::AddMask(chosen()?, shows),
            LayerStep::MakeMask(source) => LayerAction::MakeMask(chosen()?, Some(source)),
            LayerStep::InvertMask => LayerAction::InvertMask(chosen()?),
            LayerStep::RemoveMask => LayerAction::RemoveMask(chosen()?),
            LayerStep::SeeMask(is_seen) => LayerAction::SeeMask(is_seen.then(chosen).transpose()?),
            LayerStep::Duplicate => LayerAction::Duplicate(chosen()?),
            LayerStep::MergeDown => LayerAction::MergeDown(chosen()?),
            LayerStep::Move(is_up) => LayerAction::Move(chosen()?, is_up),
            LayerStep::Group => LayerAction::Group(chosen()?),
            LayerStep::Ungroup => LayerAction::Ungroup(chosen()?),
            LayerStep::MergeGroup => LayerAction::MergeGroup(chosen()?),
            LayerStep::GroupKind(kind) => LayerAction::GroupKind(chosen()?, kind),
            LayerStep::Collapse(is_collapsed) => LayerAction::Collapse(chosen()?, is_collapsed),
            LayerStep::MoveInto(name) => {
                LayerAction::MoveTo(chosen()?, LayerPlace::Into(find(&name)?), false)
            }
            LayerStep::MoveAbove(name) => {
                LayerAction::MoveTo(chosen()?, LayerPlace::Above(find(&name)?), false)
            }
            LayerStep::MoveBelow(name) => {
                LayerAction::MoveTo(chosen()?, LayerPlace::Below(find(&name)?), false)
            }
            LayerStep::Delete => LayerAction::Delete(chosen()?),
        };
        self.layer_action(&action);
        Ok(())
    }

    /// Shows the height alone, or no longer.
    pub fn see_height(&mut self, is_seen: bool) {
        if let Some(painting) = &mut self.painting {
            painting.see_alone(is_seen.then_some(Alone::Height));
        }
        self.light_alone();
    }

    /// What is seen instead of the base colour is seen without light.
    pub(crate) fn light_alone(&mut self) {
        let is_seen = self.painting.as_ref().is_some_and(|painting| painting.seen_alone.is_some());
        let now = &mut self.settings.display.shading;
        match (is_seen, self.shading_before_alone) {
            (true, None) => {
                self.shading_before_alone = Some(std::mem::replace(now, ShadingView::BaseColor));
            }
            (false, Some(before)) => {
                *now = before;
                self.shading_before_alone = None;
            }
            _ => {}
        }
    }

    pub fn viewpoint(&self) -> Viewpoint {
        Viewpoint { rig: self.rig, pixels: self.scene_pixels, pixels_per_point: self.pixels_per_point }
    }

    /// Lets the pen paint; what is left of the input moves the camera.
    pub(super) fn paint(&mut self, input: &SceneInput) -> SceneInput {
        let pen = self.drag_brush(input);
        let view = self.viewpoint();
        let mut left = input.clone();
        let Some(painting) = &mut self.painting else { return left };
        let settings = &mut self.settings.paint;
        let is_for_pen = !input.turns_sun || painting.has_hand_down();
        // A button that is let go ends what it began, whatever is held.
        let pen: Vec<PenEvent> =
            pen.into_iter().filter(|event| is_for_pen || event.phase == PenPhase::Up).collect();
        painting.pen(&pen, settings, &view, input.modifiers, &mut self.notices);
        // With Ctrl wheel and right button are for the brush.
        if input.turns_sun && !painting.is_drawing() {
            settings.brush.change_size(input.wheel as f32);
            self.change_brush(input.side_drag - input.middle_drag);
            left.wheel = 0.0;
        }
        let Some(painting) = &self.painting else { return left };
        let turn = if painting.is_turning() { input.drag } else { DVec2::ZERO };
        let sun = if input.turns_sun && !painting.has_stroke_begun() { input.drag } else { DVec2::ZERO };
        let (mut side, middle) = (input.side_drag - input.middle_drag, input.middle_drag);
        if input.turns_sun {
            side = DVec2::ZERO;
        }
        // Shift lets the right button do what the middle one does.
        let (turned, shifted) =
            if input.modifiers.shift { (DVec2::ZERO, side + middle) } else { (side, middle) };
        left.drag = turn + turned + sun;
        left.turns_sun = input.turns_sun && sun != DVec2::ZERO;
        left.side_drag = shifted;
        left.is_double_click = false;
        left.movement = MoveInput::default();
        left
    }
}
