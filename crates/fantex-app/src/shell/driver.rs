//! Carries out the steps of a session: as keys and mouse where a user would use these, else directly.

use std::path::Path;

use eframe::egui::{self, Event, Key, Modifiers, PointerButton, Pos2, RawInput, ViewportCommand, pos2, vec2};
use fantex::base::Result;
use fantex::glam::DVec3;
use fantex::scene::Camera;

use crate::command::{Command, parse_keys};
use crate::export::ExportSettings;
use crate::light::Surroundings;
use crate::paint::{PaintCommand, SaveState, StickerKind, parse_hex};
use crate::session::{Act, SessionRunner, Situation, Step};
use crate::settings::StreamingSettings;
use crate::viewer::{PathState, PictureSize, Request, Viewer};

/// Frames over which a drag is spread.
const DRAG_FRAMES: u32 = 6;

/// Seconds after which it is looked again whether what takes its time is done.
const LOOK_SECONDS: f32 = 0.1;

/// A session at work.
pub(super) struct Driver {
    runner: SessionRunner,
    frame: u64,
    input: InputQueue,
    /// Nothing is done before work elsewhere is.
    is_waiting: bool,
}

/// Keys and mouse of the session.
#[derive(Debug, Default)]
struct InputQueue {
    /// Events for the next frames, in this order, one list per frame.
    coming: std::collections::VecDeque<Vec<Event>>,
    held: Vec<Key>,
    held_frames: u32,
    /// A stroke has left the button down.
    is_down: bool,
    /// Something was done in this frame, which is still to be seen.
    has_acted: bool,
}

impl Driver {
    pub(super) fn new(runner: SessionRunner) -> Self {
        Self { runner, frame: 0, input: InputQueue::default(), is_waiting: false }
    }

    /// Does what is next. Returns whether there is more to do.
    pub(super) fn step(
        &mut self,
        ctx: &egui::Context,
        viewer: &mut Viewer,
        is_sharp: bool,
        pictures_due: usize,
    ) -> Result<bool> {
        self.frame += 1;
        let situation = Situation {
            seconds: viewer.now(),
            frame: self.frame,
            is_opening: viewer.is_opening() || viewer.is_making_surroundings(),
            is_sharp,
            is_playing: matches!(viewer.path_state, PathState::Playing { .. }),
            is_acting: self.input.is_busy(),
            is_painting: viewer.painting.as_ref().is_some_and(|p| !p.is_told()) || self.input.is_busy(),
            is_working: viewer
                .painting
                .as_ref()
                .and_then(|painting| painting.work.as_ref())
                .is_some_and(|work| !work.is_undo && work.share > 0.0),
            is_exporting: viewer.exporting.as_ref().is_some_and(|exporting| !exporting.is_asked()),
            is_unsaved: viewer.painting.as_ref().is_some_and(|p| p.save != SaveState::Saved),
            painted: viewer.painting.as_ref().map_or([0; 2], |p| {
                let snapshot = &p.snapshot;
                [snapshot.layers.len(), snapshot.older + snapshot.done.len()]
            }),
            pictures_due: pictures_due + self.input.coming.len(),
            messages: viewer.notices.log().map(str::to_owned).collect(),
        };
        let act = self.runner.next(&situation)?;
        self.is_waiting = act == Act::Wait;
        match act {
            Act::NextFrame | Act::Wait => {}
            Act::End => return Ok(false),
            Act::Do(step) => self.act(ctx, viewer, step)?,
        }
        Ok(true)
    }

    /// Asks for the next frame. While the session waits, the processor's time is left to what it waits for.
    pub(super) fn wake(&self, ctx: &egui::Context) {
        match self.is_waiting {
            true => ctx.request_repaint_after_secs(LOOK_SECONDS),
            false => ctx.request_repaint(),
        }
    }

    /// Does a step; fails where it names what is not there.
    fn act(&mut self, ctx: &egui::Context, viewer: &mut Viewer, step: Step) -> Result<()> {
        match step {
            Step::Key(name) => self.input.press(&name),
            Step::Hold { keys, frames } => self.input.hold(&keys, frames),
            Step::Drag { x, y, with } => {
                let from = scene_point(ctx, viewer, [0.5; 2]);
                let height = viewer.scene_pixels[1] as f32 / ctx.pixels_per_point();
                self.input.stroke(
                    &[from, from + vec2(x as f32, y as f32) * height],
                    &with,
                    DRAG_FRAMES,
                    false,
                );
                self.input.coming.push_back(vec![Event::PointerGone]);
            }
            Step::Camera { eye, target } => viewer.set_camera(&Camera {
                eye: DVec3::from_array(eye),
                target: DVec3::from_array(target),
                up: DVec3::Y,
                fov_degrees: viewer.settings.camera.fov_degrees,
            }),
            Step::View(preset) => viewer.command(Command::View(preset)),
            Step::Mode(mode) => viewer.command(Command::Mode(mode)),
            Step::Overlay(overlay) => viewer.settings.display.overlay = overlay,
            Step::Shading(shading) => viewer.settings.display.shading = shading,
            Step::Tab(tab) => viewer.settings.panels.tab = tab,
            Step::Open(place) => viewer.open(&place),
            Step::LookNumber(key, value) => {
                if let Some(live) = &mut viewer.live
                    && let Some(index) = live.numbers.iter().position(|number| number.key.to_string() == key)
                {
                    live.set(index, value);
                }
            }
            #[cfg(feature = "test-steps")]
            Step::Copy { from, to } => {
                if let Err(error) = std::fs::copy(&from, &to) {
                    viewer.notices.error(format!("{}: {error}", from.display()));
                }
            }
            Step::Asks(asks) => viewer.asks = asks,
            Step::Export { path, preset, side } => {
                let points_down = preset.points_down();
                viewer.export_to(path, ExportSettings { preset, side: Some(side), points_down });
            }
            Step::SaveCopy(path) => viewer.copy_to(path),
            Step::AddChannels(kinds) => {
                viewer.add_channels(&kinds.iter().map(|kind| kind.0).collect::<Vec<_>>());
            }
            Step::RemoveChannels(kinds) => {
                viewer.remove_channels(&kinds.iter().map(|kind| kind.0).collect::<Vec<_>>());
            }
            Step::ShowAlpha(shown) => viewer.show_alpha(shown),
            Step::OpacityTo(to) => viewer.settings.paint.opacity_to = to.clamp(0.0, 1.0),
            Step::SeeHeight(is_seen) => viewer.see_height(is_seen),
            Step::Answer(answer) => viewer.answer(Some(answer)),
            Step::Surroundings(name) => {
                viewer.settings.light.surroundings = match name.as_str() {
                    "studio" => Surroundings::Studio,
                    "sky" => Surroundings::Sky,
                    file => Surroundings::File(file.into()),
                };
            }
            Step::Pool(mebibytes) => {
                let [least, most] = StreamingSettings::POOL_MIB;
                viewer.settings.streaming.pool_mib = mebibytes.clamp(least, most);
            }
            Step::Play(file) => {
                viewer.load_path(Path::new(&file));
                viewer.command(Command::TogglePlayback);
            }
            Step::Screenshot { path, size } => {
                remove_old(&path);
                let size = size.map_or(PictureSize::Times(1), PictureSize::Pixels);
                viewer.request(Request::Picture { path, size });
            }
            Step::WindowScreenshot { path } => {
                remove_old(&path);
                viewer.request(Request::WindowPicture(path));
            }
            Step::Resize(size) => ctx.send_viewport_cmd(ViewportCommand::InnerSize(size.into())),
            Step::Minimize(is_minimized) => ctx.send_viewport_cmd(ViewportCommand::Minimized(is_minimized)),
            Step::PaintTool(tool) => viewer.command(Command::Paint(PaintCommand::Tool(tool))),
            Step::Brush(brush) => viewer.settings.paint.brush = brush,
            Step::Preset(name) => viewer.take_preset(&name)?,
            Step::Text(text) => {
                viewer.settings.paint.sticker = StickerKind::Text;
                viewer.settings.paint.text = text;
            }
            Step::Color(text) => {
                let colors = &mut viewer.settings.paint.colors;
                colors.foreground = parse_hex(&text).unwrap_or(colors.foreground);
            }
            Step::Channels(channels) => viewer.settings.paint.channels = channels,
            Step::Material(material) => viewer.settings.paint.material = material,
            Step::Symmetry(symmetry) => viewer.settings.paint.symmetry = symmetry,
            Step::Stroke { points, with, frames, holds } => {
                let points = points.into_iter().map(|point| scene_point(ctx, viewer, point));
                self.input.stroke(&points.collect::<Vec<_>>(), &with, frames, holds);
            }
            Step::Hover(point) => {
                let at = scene_point(ctx, viewer, point);
                self.input.coming.push_back(vec![Event::PointerMoved(at)]);
            }
            Step::Layer(step) => viewer.layer_step(step)?,
            Step::Texture(texture) => viewer.settings.paint.texture = texture,
            Step::Stencil(stencil) => viewer.settings.paint.stencil = stencil,
            Step::AdjustStencil(is_adjusted) => {
                viewer.settings.paint.stencil.is_adjusted = is_adjusted;
            }
            Step::FitStencil => fit_stencil(viewer),
            Step::Project => viewer.command(Command::Paint(PaintCommand::Project)),
            Step::Fill(fill) => viewer.settings.paint.fill = fill,
            Step::Gradient(gradient) => viewer.settings.paint.gradient = gradient,
            Step::PictureUse(picture_use) => viewer.settings.paint.picture_use = picture_use,
            Step::Picture(path) => {
                viewer.settings.paint.sticker = StickerKind::Picture;
                viewer.settings.paint.picture = Some(path);
            }
            #[cfg(feature = "test-steps")]
            Step::LoseDevice => viewer.request(Request::LoseDevice),
            // The runner itself waits, compares and ends.
            #[cfg(feature = "test-steps")]
            Step::ExpectPainting { .. } | Step::ExpectMessage(_) | Step::WaitFile { .. } => {}
            Step::WaitFrames(_)
            | Step::WaitLoaded(_)
            | Step::WaitSharp(_)
            | Step::WaitWorking(_)
            | Step::WaitExported(_)
            | Step::WaitPainted(_)
            | Step::WaitSaved(_)
            | Step::Quit => {}
        }
        Ok(())
    }

    /// Adds keys and mouse of the session to what the window tells.
    pub(super) fn inject(&mut self, raw_input: &mut RawInput) {
        self.input.inject(raw_input);
    }
}

/// A place of the scene, given along its sides, in the window.
fn scene_point(ctx: &egui::Context, viewer: &Viewer, [x, y]: [f64; 2]) -> Pos2 {
    let scale = ctx.pixels_per_point();
    let [width, height] = viewer.scene_pixels.map(|n| n as f32 / scale);
    let [left, top] = viewer.scene_corner;
    pos2(left + width * x as f32, top + height * y as f32)
}

fn fit_stencil(viewer: &mut Viewer) {
    let aspect = viewer.aspect();
    let stencil = &mut viewer.settings.paint.stencil;
    if let Some(Ok(Some(picture))) = viewer.painting.as_mut().map(|painting| painting.stencil(stencil)) {
        stencil.fit([picture.aspect(), aspect]);
    }
}

/// A picture of an earlier session must not pass for this one's.
fn remove_old(path: &Path) {
    std::fs::remove_file(path).ok();
}

impl InputQueue {
    fn press(&mut self, name: &str) {
        let Some((modifiers, key)) = parse_keys(name) else { return };
        self.coming.push_back(vec![key_event(key, true, modifiers)]);
        self.coming.push_back(vec![key_event(key, false, modifiers)]);
    }

    fn hold(&mut self, names: &[String], frames: u32) {
        let found = names.iter().filter_map(|name| parse_keys(name));
        self.held = found.map(|(_, key)| key).collect();
        // A key that is not let go would be held for ever.
        self.held_frames = frames.max(1);
        self.coming.push_back(self.held.iter().map(|&key| key_event(key, true, Modifiers::NONE)).collect());
    }

    /// Draws through points; the pointer rests at the last one, with the button down if it `holds`.
    fn stroke(&mut self, points: &[Pos2], with: &[String], frames: u32, holds: bool) {
        let (Some(&first), Some(&last)) = (points.first(), points.last()) else { return };
        let parsed = with.iter().filter_map(|name| parse_keys(&format!("{name}+A")));
        let modifiers = parsed.fold(Modifiers::NONE, |all, (one, _)| all | one);
        let button = |pos: Pos2, pressed: bool| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers,
        };
        self.coming.push_back(vec![Event::ModifiersChanged(modifiers), Event::PointerMoved(first)]);
        if !std::mem::replace(&mut self.is_down, holds) {
            self.coming.push_back(vec![button(first, true)]);
        }
        let frames = frames.max(1);
        for pair in points.windows(2) {
            for k in 1..=frames {
                // Pens tell more than once a frame.
                let share = |n: u32| (4 * (k - 1) + n) as f32 / (4 * frames) as f32;
                let moves = (1..=4).map(|n| Event::PointerMoved(pair[0] + (pair[1] - pair[0]) * share(n)));
                self.coming.push_back(moves.collect());
            }
        }
        if !holds {
            self.coming.push_back(vec![button(last, false), Event::ModifiersChanged(Modifiers::NONE)]);
        }
    }

    fn is_busy(&self) -> bool {
        self.has_acted || !self.coming.is_empty()
    }

    fn inject(&mut self, raw_input: &mut RawInput) {
        self.has_acted = !self.coming.is_empty();
        raw_input.events.extend(self.coming.pop_front().into_iter().flatten());
        if self.held_frames > 0 {
            self.held_frames -= 1;
            if self.held_frames == 0 {
                let released = self.held.drain(..).map(|key| key_event(key, false, Modifiers::NONE));
                raw_input.events.extend(released);
            }
        }
    }
}

fn key_event(key: Key, pressed: bool, modifiers: Modifiers) -> Event {
    Event::Key { key, physical_key: None, pressed, repeat: false, modifiers }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn held_keys_are_let_go() {
        for frames in [0, 1, 3] {
            let mut queue = InputQueue::default();
            queue.hold(&["W".to_owned()], frames);
            let mut input = RawInput::default();
            (0..frames.max(1)).for_each(|_| queue.inject(&mut input));
            let pressed = input.events.iter().map(|event| match event {
                Event::Key { pressed, .. } => *pressed,
                other => panic!("{other:?}"),
            });
            assert_eq!(pressed.collect::<Vec<_>>(), [true, false], "{frames} frames");
        }
    }
}
