//! What the viewer does while something is painted on.

use glam::DVec2;

use super::{SceneInput, Viewer};
use crate::camera::Wish;
use crate::paint::{LayerAction, PaintCommand, SaveState, Viewpoint};

impl Viewer {
    /// Paints on what is open, or goes back to looking at it.
    pub(super) fn toggle_painting(&mut self, seconds: f64) {
        self.paints = !self.paints;
        if let Some(place) = self.document.as_ref().map(|document| document.place.clone()) {
            self.begin_opening(place, true, seconds);
        }
    }

    /// Something of the painter; nothing where nothing is painted on.
    pub fn paint_command(&mut self, command: &PaintCommand, seconds: f64) {
        let view = self.viewpoint();
        let Some(painting) = &mut self.painting else { return };
        match command {
            PaintCommand::Project => {
                painting.project(&mut self.settings.paint, &view, &mut self.notices, seconds);
            }
            command => painting.command(command, &mut self.settings.paint),
        }
    }

    /// What is done with layers.
    pub fn layer_action(&mut self, action: &LayerAction, seconds: f64) {
        if let Some(painting) = &mut self.painting
            && let Err(reason) = painting.layer_action(action, &self.settings.paint)
        {
            self.notices.warning(reason, seconds);
        }
    }

    /// From where the scene is seen.
    pub fn viewpoint(&self) -> Viewpoint {
        Viewpoint { rig: self.rig, pixels: self.scene_pixels }
    }

    /// Whether the window may close: not while something painted is not in the file, unless that is asked for again.
    pub fn may_close(&mut self, seconds: f64) -> bool {
        let Some(painting) = &self.painting else { return true };
        let SaveState::Failed(reason) = painting.save() else { return true };
        if std::mem::replace(&mut self.was_warned, true) {
            return true;
        }
        let text = format!("{reason} Close again to lose what is not saved.");
        self.notices.error(text, seconds);
        false
    }

    /// Where another file could not be opened, what was painted on is not open any more either.
    pub(super) fn leave_lost_painting(&mut self) {
        if self.painting.is_none()
            && self.document.as_ref().is_some_and(|document| document.exchange.is_some())
        {
            self.document = None;
            self.new_model = Some(None);
            self.forget_scene();
        }
    }

    /// Lets the pen paint; what is left of the input moves the camera.
    pub(super) fn paint(&mut self, input: &SceneInput, seconds: f64) -> SceneInput {
        let view = self.viewpoint();
        let mut left = input.clone();
        let Some(painting) = &mut self.painting else { return left };
        let settings = &mut self.settings.paint;
        if !input.turns_sun || painting.is_drawing() || painting.is_turning() {
            painting.pen(&input.pen, settings, &view, input.modifiers, &mut self.notices, seconds);
        }
        let turn = if painting.is_turning() { input.drag } else { DVec2::ZERO };
        let sun = if input.turns_sun && !painting.is_drawing() { input.drag } else { DVec2::ZERO };
        let (side, middle) = (input.side_drag - input.middle_drag, input.middle_drag);
        // Shift lets the right button do what the middle one does.
        let (turned, shifted) =
            if input.modifiers[0] { (DVec2::ZERO, side + middle) } else { (side, middle) };
        left.drag = turn + turned + sun;
        left.turns_sun = input.turns_sun && sun != DVec2::ZERO;
        left.side_drag = shifted;
        left.is_double_click = false;
        left.wish = Wish::default();
        left
    }
}
