//! Keys: most ask for something at once. While something is painted on, F waits: tapped it shows all, held in a drag it changes the
//! brush.

use eframe::egui::{Context, Event, FocusDirection, Key, Modifiers};
use fantex::glam::DVec2;

use crate::command::{Command, command_of};
use crate::paint::{PaintCommand, PenEvent, PenPhase};
use crate::viewer::{SceneInput, Viewer};

/// Held in a drag it changes the brush.
pub const BRUSH_KEY: Key = Key::F;

/// Steps of the brush's size over the scene's height, dragged; tenths of its hardness likewise.
const BRUSH_STEPS: f64 = 40.0;

/// See [`BRUSH_STEPS`].
const BRUSH_TENTHS: f64 = 20.0;

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyPhase {
    Pressed,
    /// Held for so long that it is pressed again.
    Repeated,
    Released,
}

/// A drag that changes the brush: where it began and where it is, 0..1 along the scene's sides.
#[derive(Clone, Copy, Debug)]
pub(super) struct BrushDrag {
    from: DVec2,
    at: DVec2,
}

impl Viewer {
    /// Does what the keys of this frame ask for.
    pub fn keys(&mut self, ctx: &Context) {
        let is_typing = ctx.text_edit_focused();
        let key_of = |event: &Event| match event {
            Event::Key { key, pressed, repeat, modifiers, .. } => {
                let phase = match (pressed, repeat) {
                    (false, _) => KeyPhase::Released,
                    (true, true) => KeyPhase::Repeated,
                    (true, false) => KeyPhase::Pressed,
                };
                Some((*key, *modifiers, phase))
            }
            _ => None,
        };
        let all: Vec<_> = ctx.input(|i| i.events.iter().filter_map(key_of).collect());
        for (key, modifiers, phase) in all {
            let is_tab = key == Key::Tab && phase != KeyPhase::Released && !is_typing;
            if is_tab && command_of(self.painting.is_some(), modifiers, key).is_some() {
                // It hides panels here and does not go from field to field.
                ctx.memory_mut(|memory| memory.move_focus(FocusDirection::None));
            }
            self.key(key, modifiers, phase, is_typing);
        }
    }

    /// Does what a key asks for. While something is typed it is meant for the text, but for saving, opening, exporting and quitting.
    pub fn key(&mut self, key: Key, modifiers: Modifiers, phase: KeyPhase, is_typing: bool) {
        if phase == KeyPhase::Released {
            if key == BRUSH_KEY && std::mem::take(&mut self.frames_on_release) {
                self.command(Command::FrameAll);
            }
            return;
        }
        let Some(command) = command_of(self.painting.is_some(), modifiers, key) else { return };
        let repeats = matches!(&command, Command::Paint(command) if command.repeats());
        if (is_typing && !is_beside_text(&command)) || (phase == KeyPhase::Repeated && !repeats) {
            return;
        }
        if key == BRUSH_KEY && command == Command::FrameAll && self.painting.is_some() {
            self.frames_on_release = true;
        } else {
            self.command(command);
        }
    }

    /// Where a drag that changes the brush began: there its outline stays.
    pub fn brush_origin(&self) -> Option<DVec2> {
        self.brush_drag.map(|drag| drag.from)
    }

    /// Changes the brush by drags with its key held; what is left is for the pen.
    pub(super) fn drag_brush(&mut self, input: &SceneInput) -> Vec<PenEvent> {
        let aspect = self.aspect();
        let is_free = self.painting.as_ref().is_some_and(|painting| !painting.has_hand_down());
        let mut left = Vec::new();
        for event in &input.pen {
            if matches!(event.phase, PenPhase::Down | PenPhase::Turn) {
                let begins = input.adjusts_brush && is_free;
                self.brush_drag = begins.then_some(BrushDrag { from: event.at, at: event.at });
                self.frames_on_release &= !begins;
            }
            let Some(drag) = &mut self.brush_drag else {
                left.push(*event);
                continue;
            };
            let by = (event.at - drag.at) * DVec2::new(aspect, 1.0);
            drag.at = event.at;
            self.change_brush(by);
            if event.phase == PenPhase::Up {
                self.brush_drag = None;
            }
        }
        left
    }

    /// Larger to the right, harder upwards; the way in units of the scene's height.
    pub(super) fn change_brush(&mut self, by: DVec2) {
        let brush = &mut self.settings.paint.brush;
        brush.change_size((BRUSH_STEPS * by.x) as f32);
        brush.change_hardness((-BRUSH_TENTHS * by.y) as f32);
    }
}

/// Whether a command has nothing to do with a text that is being typed.
fn is_beside_text(command: &Command) -> bool {
    matches!(
        command,
        Command::OpenDialog
            | Command::Quit
            | Command::Export
            | Command::SaveCopy
            | Command::Save
            | Command::Screenshot
            | Command::LargeScreenshot(_)
            | Command::WindowScreenshot
            | Command::Paint(PaintCommand::Save)
    )
}
