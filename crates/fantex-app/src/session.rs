//! Sessions: steps in a file that drive the viewer as a user would, for tests and for pictures of it.
//!
//! ```json
//! { "steps": [
//!     { "wait_loaded": 60 },
//!     { "wait_sharp": 60 },
//!     { "screenshot": { "path": "lit.png" } },
//!     { "overlay": "groups" },
//!     { "key": "F1" },
//!     { "wait_frames": 3 },
//!     { "window_screenshot": { "path": "help.png" } },
//!     "quit"
//! ] }
//! ```
//!
//! Paths are relative to the session's file. A step that cannot be done ends the viewer with exit code 1.

use std::path::{Path, PathBuf};

use fantex::base::{Error, ErrorKind, Result};
use serde::Deserialize;

use crate::camera::{CameraMode, ViewPreset};
use crate::command::parse_keys;
use crate::display::{Overlay, ShadingView};
use crate::paint::{
    BrushSettings, ChannelSwitches, FillReach, Material, PaintTool, StencilSettings, SymmetrySettings,
    TextureChoice, parse_hex,
};
use crate::settings::Tab;

/// Most bytes of a file that is read as a session.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Seconds that a picture may take.
const PICTURE_SECONDS: f64 = 120.0;

/// What the viewer is to do.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Session {
    /// One after the other.
    pub steps: Vec<Step>,
}

/// One thing to do. Each waits until the pictures that earlier steps asked for are on the disk.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Step {
    /// Lets so many frames of the window go by.
    WaitFrames(u32),
    /// Waits until nothing is being opened any more, at most so many seconds.
    WaitLoaded(f64),
    /// Waits until all that is seen has its wanted level and the picture of it is shown, at most so many seconds.
    WaitSharp(f64),
    /// Presses a key: `F1`, `Ctrl+S`.
    Key(String),
    /// Holds keys for so many frames.
    Hold {
        /// Names of keys.
        keys: Vec<String>,
        /// Frames.
        frames: u32,
    },
    /// Drags in the scene, in shares of its height.
    Drag {
        /// To the right.
        x: f64,
        /// Downwards.
        y: f64,
        /// Names of held modifiers: `Ctrl`, `Shift`.
        #[serde(default)]
        with: Vec<String>,
    },
    /// Puts the camera somewhere.
    Camera {
        /// The pinhole, world space.
        eye: [f64; 3],
        /// A point in the middle of the picture, world space.
        target: [f64; 3],
    },
    /// Shows the whole model from a side.
    View(ViewPreset),
    /// Moves the camera in another way.
    Mode(CameraMode),
    /// Chooses an overlay.
    Overlay(Overlay),
    /// Chooses a view of the shading.
    Shading(ShadingView),
    /// Shows a page of the inspector.
    Tab(Tab),
    /// Opens a file or address.
    Open(String),
    /// Chooses a picture of surroundings, `sky` or `studio`.
    Surroundings(String),
    /// Chooses the memory for texels, mebibytes.
    Pool(u32),
    /// Plays a camera path and waits for its end.
    Play(String),
    /// Saves a picture of the scene.
    Screenshot {
        /// Where to.
        path: PathBuf,
        /// Width and height in pixels; those on the screen without.
        #[serde(default)]
        size: Option<[u32; 2]>,
    },
    /// Saves a picture of the whole window.
    WindowScreenshot {
        /// Where to.
        path: PathBuf,
    },
    /// Gives the window another size in points.
    Resize([f32; 2]),
    /// Hides the window as a symbol, or brings it back.
    Minimize(bool),
    /// Loses the GPU's device, as when a driver is replaced, and goes on in another window.
    LoseDevice,
    /// Fails unless a message with this text has been shown.
    ExpectMessage(String),
    /// Chooses a tool of the painter.
    PaintTool(PaintTool),
    /// Takes a brush; what is left out is as usual.
    Brush(BrushSettings),
    /// Lays this text with the next click of the tool `sticker`.
    Text(String),
    /// Takes a colour: `#d8452e`.
    Color(String),
    /// Says which channels are painted.
    Channels(ChannelSwitches),
    /// Says what is painted into the material's channels.
    Material(Material),
    /// Says what the base colour comes from.
    Texture(TextureChoice),
    /// Lays a picture over the view; what is left out is as usual.
    Stencil(StencilSettings),
    /// Lets the pointer move that picture (true), or paint again.
    AdjustStencil(bool),
    /// Makes that picture as large as the view allows.
    FitStencil,
    /// Projects that picture onto all that is seen.
    Project,
    /// Says how far fills go.
    Fill(FillReach),
    /// Lays this picture with the next click of the tool `sticker`.
    Picture(PathBuf),
    /// Chooses symmetry.
    Symmetry(SymmetrySettings),
    /// Draws with the first button through points of the scene.
    Stroke {
        /// 0..1 along the scene's sides; one point is a click.
        points: Vec<[f64; 2]>,
        /// Names of held modifiers.
        #[serde(default)]
        with: Vec<String>,
        /// Frames from one point to the next.
        #[serde(default = "stroke_frames")]
        frames: u32,
        /// Whether the button stays down at the end.
        #[serde(default)]
        holds: bool,
    },
    /// Lets the pointer rest at a point of the scene.
    Hover([f64; 2]),
    /// Does something with layers.
    Layer(LayerStep),
    /// Waits until something that takes long has done a part of its work, at most so many seconds.
    WaitWorking(f64),
    /// Waits until all that was asked for is painted, at most so many seconds.
    WaitPainted(f64),
    /// Waits until all is in the file, at most so many seconds.
    WaitSaved(f64),
    /// Fails unless there are so many layers and steps of the history.
    ExpectPainting {
        /// Layers over the base.
        #[serde(default)]
        layers: Option<usize>,
        /// Steps that can be undone.
        #[serde(default)]
        steps: Option<usize>,
    },
    /// Ends the viewer with exit code 0.
    Quit,
}

fn stroke_frames() -> u32 {
    2
}

/// Something done with layers. Where a layer is meant, it is the chosen one.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LayerStep {
    /// A new layer.
    Add,
    /// A new layer of one colour or texture, hidden by its mask.
    AddFill,
    /// The same, without a mask.
    AddFillEverywhere,
    /// A fill layer takes the colour or texture of now.
    Refill,
    /// The layer of this name, or `base`.
    Select(String),
    /// Its mask.
    SelectMask(String),
    /// Another name.
    Rename(String),
    /// 0..1.
    Opacity(f32),
    /// Another blend mode.
    Blend(fantex::paint::BlendMode),
    /// Shown or not.
    Show(bool),
    /// A mask that shows all (true) or hides all.
    AddMask(bool),
    /// Towards the top (true) or the bottom.
    Move(bool),
    /// Away with it.
    Delete,
}

impl Session {
    /// Reads a session.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is no session or names unknown keys.
    pub fn load(path: &Path) -> Result<Self> {
        let name = path.display();
        let failed = |source: std::io::Error| {
            let sentence = format!("cannot read the session {name}: {source}");
            Error::new(ErrorKind::Io, sentence).with_path(path).with_source(source)
        };
        if std::fs::metadata(path).map_err(failed)?.len() > MAX_FILE_BYTES {
            return Err(failed(std::io::ErrorKind::FileTooLarge.into()));
        }
        let text = std::fs::read(path).map_err(failed)?;
        let mut session: Self = serde_json::from_slice(&text).map_err(|source| {
            Error::malformed(format!("{name} is no session: {source}")).with_path(path).with_source(source)
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for (i, step) in session.steps.iter_mut().enumerate() {
            step.check(i + 1)?;
            step.resolve(folder);
        }
        Ok(session)
    }
}

/// A step, from 1, that cannot be done.
fn at_step(step: usize, reason: impl std::fmt::Display) -> Error {
    Error::invalid(format!("step {step}: {reason}"))
}

impl Step {
    fn check(&self, step: usize) -> Result<()> {
        let names: Vec<String> = match self {
            Self::Key(name) => vec![name.clone()],
            Self::Hold { keys, .. } => keys.clone(),
            Self::Color(text) if parse_hex(text).is_none() => {
                return Err(at_step(step, format!("'{text}' is no colour; one is written as #d8452e")));
            }
            Self::Drag { with, .. } | Self::Stroke { with, .. } => {
                with.iter().map(|name| format!("{name}+A")).collect()
            }
            _ => Vec::new(),
        };
        match names.into_iter().find(|name| parse_keys(name).is_none()) {
            Some(name) => {
                let help = "keys are named as on the help sheet, such as F1 or Ctrl+S";
                Err(at_step(step, format!("there is no key '{name}'; {help}")))
            }
            None => Ok(()),
        }
    }

    fn resolve(&mut self, folder: &Path) {
        match self {
            Self::Screenshot { path, .. } | Self::WindowScreenshot { path } | Self::Picture(path) => {
                *path = folder.join(&*path);
            }
            Self::Texture(TextureChoice { look: Some(path), .. })
            | Self::Stencil(StencilSettings { image: Some(path), .. }) => *path = folder.join(&*path),
            Self::Open(place) if !place.contains("://") => {
                *place = folder.join(&*place).to_string_lossy().into_owned();
            }
            Self::Play(place) => *place = folder.join(&*place).to_string_lossy().into_owned(),
            Self::Surroundings(place) if place != "sky" && place != "studio" => {
                *place = folder.join(&*place).to_string_lossy().into_owned();
            }
            _ => {}
        }
    }
}

/// What a session needs to know of the viewer.
#[derive(Clone, Debug, Default)]
pub struct Situation {
    /// Seconds since the start.
    pub seconds: f64,
    /// Frames of the window since the start.
    pub frame: u64,
    /// Whether something is being opened.
    pub is_opening: bool,
    /// Whether all that is seen has its wanted level, and the picture shows it.
    pub is_sharp: bool,
    /// Whether a camera path is being played.
    pub is_playing: bool,
    /// Whether the hands have something to do.
    pub are_hands_busy: bool,
    /// Whether a painter has something to do, or the hands have.
    pub is_painting: bool,
    /// Whether a painter has done a part of something that takes long.
    pub is_working: bool,
    /// Whether something is not in the file yet.
    pub is_unsaved: bool,
    /// Layers and steps of the history.
    pub painted: [usize; 2],
    /// Pictures that are not on the disk yet.
    pub pictures_due: usize,
    /// Messages that were shown since the start, oldest first.
    pub messages: Vec<String>,
    /// What failed of that which a step asked for.
    pub failure: Option<String>,
}

/// What the viewer shall do for a session now.
#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// A step that is done at once.
    Do(Step),
    /// Nothing, but the next frame is wanted.
    Wait,
    /// End with exit code 0.
    End,
}

/// A session under way.
#[derive(Debug)]
pub struct SessionRunner {
    steps: std::vec::IntoIter<Step>,
    /// Number of the current step, from 1.
    number: usize,
    wait: Option<Waiting>,
}

#[derive(Clone, Copy, Debug)]
struct Waiting {
    until: Until,
    since: f64,
}

#[derive(Clone, Copy, Debug)]
enum Until {
    Frame(u64),
    Loaded {
        seconds: f64,
    },
    /// And the frame before which the picture cannot be the wanted one.
    Sharp {
        seconds: f64,
        frame: u64,
    },
    /// The hand has drawn all of a stroke.
    Drawn {
        frame: u64,
    },
    Working {
        seconds: f64,
    },
    Painted {
        seconds: f64,
        frame: u64,
    },
    Saved {
        seconds: f64,
        frame: u64,
    },
    Picture,
    Played,
}

impl SessionRunner {
    /// At the first step.
    pub fn new(session: Session) -> Self {
        Self { steps: session.steps.into_iter(), number: 0, wait: None }
    }

    /// What to do in this frame.
    ///
    /// # Errors
    ///
    /// A step failed or took too long.
    pub fn next(&mut self, now: &Situation) -> Result<Act> {
        if let Some(reason) = &now.failure {
            return Err(at_step(self.number, reason));
        }
        if let Some(wait) = self.wait {
            if !self.is_over(wait, now)? {
                return Ok(Act::Wait);
            }
            self.wait = None;
        }
        let Some(step) = self.steps.next() else { return Ok(Act::End) };
        self.number += 1;
        let wait = |until| Some(Waiting { until, since: now.seconds });
        self.wait = match &step {
            Step::Quit => return Ok(Act::End),
            Step::WaitFrames(frames) => wait(Until::Frame(now.frame + u64::from(*frames))),
            Step::WaitLoaded(seconds) => wait(Until::Loaded { seconds: *seconds }),
            Step::WaitSharp(seconds) => wait(Until::Sharp { seconds: *seconds, frame: now.frame + 3 }),
            Step::ExpectMessage(text) => {
                return match now.messages.iter().any(|message| message.contains(text)) {
                    true => Ok(Act::Wait),
                    false => {
                        let found = now.messages.join(" | ");
                        let reason = format!("no message says '{text}'; there are: {found}");
                        Err(at_step(self.number, reason))
                    }
                };
            }
            Step::WaitWorking(seconds) => wait(Until::Working { seconds: *seconds }),
            Step::WaitPainted(seconds) => wait(Until::Painted { seconds: *seconds, frame: now.frame + 2 }),
            Step::WaitSaved(seconds) => wait(Until::Saved { seconds: *seconds, frame: now.frame + 2 }),
            Step::ExpectPainting { layers, steps } => {
                let is_as_expected =
                    [layers, steps].into_iter().zip(now.painted).all(|(e, f)| e.is_none_or(|e| e == f));
                let [layers, steps] = now.painted;
                return match is_as_expected {
                    true => Ok(Act::Wait),
                    false => {
                        let reason = format!("there are {layers} layers and {steps} steps of the history");
                        Err(at_step(self.number, reason))
                    }
                };
            }
            Step::Screenshot { .. } | Step::WindowScreenshot { .. } => wait(Until::Picture),
            Step::Hold { frames, .. } => wait(Until::Frame(now.frame + u64::from(*frames))),
            Step::Play(_) => wait(Until::Played),
            Step::Stroke { .. } => wait(Until::Drawn { frame: now.frame + 2 }),
            // What it changes is there in the next frame.
            _ => wait(Until::Frame(now.frame + 2)),
        };
        match step {
            Step::WaitFrames(_)
            | Step::WaitLoaded(_)
            | Step::WaitSharp(_)
            | Step::WaitWorking(_)
            | Step::WaitPainted(_)
            | Step::WaitSaved(_) => Ok(Act::Wait),
            step => Ok(Act::Do(step)),
        }
    }

    /// Number of the current step, from 1.
    pub fn number(&self) -> usize {
        self.number
    }

    fn is_over(&self, wait: Waiting, now: &Situation) -> Result<bool> {
        let (is_over, seconds, what) = match wait.until {
            Until::Frame(frame) => (now.frame >= frame, f64::INFINITY, ""),
            Until::Loaded { seconds } => (!now.is_opening, seconds, "the file was still being opened"),
            Until::Sharp { seconds, frame } => {
                let is_sharp = now.frame >= frame && !now.is_opening && now.is_sharp;
                (is_sharp, seconds, "the picture was not sharp")
            }
            Until::Drawn { frame } => (now.frame >= frame && !now.are_hands_busy, f64::INFINITY, ""),
            Until::Working { seconds } => (now.is_working, seconds, "nothing that takes long was under way"),
            Until::Painted { seconds, frame } => (
                now.frame >= frame && !now.is_opening && !now.is_painting,
                seconds,
                "the painter was still busy",
            ),
            Until::Saved { seconds, frame } => {
                (now.frame >= frame && !now.is_painting && !now.is_unsaved, seconds, "not all was saved")
            }
            Until::Picture => (now.pictures_due == 0, PICTURE_SECONDS, "the picture was not written"),
            Until::Played => (!now.is_playing, f64::INFINITY, ""),
        };
        if !is_over && now.seconds - wait.since > seconds {
            return Err(at_step(self.number, format!("after {seconds} s {what}")));
        }
        Ok(is_over)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn session(text: &str) -> Result<Session> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("session.json");
        std::fs::write(&path, text).unwrap();
        Session::load(&path)
    }

    fn at(frame: u64) -> Situation {
        Situation { frame, seconds: frame as f64 / 10.0, ..Situation::default() }
    }

    #[test]
    fn every_step_has_its_text() {
        let text = r#"{"steps":[{"wait_frames":3},{"wait_loaded":5},{"wait_sharp":2.5},{"key":"Ctrl+S"},
            {"hold":{"keys":["W"],"frames":9}},{"drag":{"x":0.1,"y":0,"with":["Ctrl"]}},
            {"camera":{"eye":[1,2,3],"target":[0,0,0]}},{"view":"three_quarter"},{"mode":"walk"},
            {"overlay":"blend_bands"},{"shading":"base_color"},{"tab":"light"},{"open":"a.glb"},
            {"surroundings":"sky"},{"pool":16},{"play":"way.json"},{"screenshot":{"path":"a.png","size":[64,32]}},
            {"window_screenshot":{"path":"b.png"}},{"resize":[0,0]},{"minimize":true},{"expect_message":"x"},"quit"]}"#;
        let found = session(text).unwrap();
        assert_eq!(found.steps.len(), 22);
        let Step::Screenshot { path, .. } = &found.steps[16] else { panic!("{:?}", found.steps[16]) };
        assert!(path.is_absolute(), "paths are relative to the session: {}", path.display());
    }

    #[test]
    fn wrong_sessions_are_refused_in_a_sentence() {
        let message = |text| session(text).unwrap_err().to_string();
        assert!(message("{\"steps\":[{\"jump\":1}]}").contains("jump"));
        assert!(message("{\"steps\":[\"quit\",{\"key\":\"Hyper\"}]}").contains("step 2"));
        assert!(message("{").contains("no session"));
    }

    #[test]
    fn steps_wait_for_what_they_asked_for() {
        let text =
            r#"{"steps":[{"wait_frames":2},{"screenshot":{"path":"a.png"}},{"wait_sharp":60},"quit"]}"#;
        let mut runner = SessionRunner::new(session(text).unwrap());
        assert_eq!(runner.next(&at(0)).unwrap(), Act::Wait);
        assert_eq!(runner.next(&at(1)).unwrap(), Act::Wait);
        assert!(matches!(runner.next(&at(2)).unwrap(), Act::Do(Step::Screenshot { .. })));
        assert_eq!(runner.next(&Situation { pictures_due: 1, ..at(3) }).unwrap(), Act::Wait);
        assert_eq!(runner.next(&at(4)).unwrap(), Act::Wait);
        assert_eq!(
            runner.next(&Situation { is_sharp: true, ..at(5) }).unwrap(),
            Act::Wait,
            "of the frame before"
        );
        assert_eq!(runner.next(&Situation { is_sharp: true, ..at(8) }).unwrap(), Act::End);
    }

    #[test]
    fn waits_end() {
        let mut runner = SessionRunner::new(session(r#"{"steps":[{"wait_loaded":1}]}"#).unwrap());
        let opening = |frame| Situation { is_opening: true, ..at(frame) };
        assert_eq!(runner.next(&opening(0)).unwrap(), Act::Wait);
        assert_eq!(runner.next(&opening(10)).unwrap(), Act::Wait);
        let late = runner.next(&opening(11)).unwrap_err().to_string();
        assert!(late.contains("step 1") && late.contains("still being opened"), "{late}");
    }

    #[test]
    fn failures_and_missing_messages_end_a_session() {
        let mut runner = SessionRunner::new(session(r#"{"steps":[{"expect_message":"damaged"}]}"#).unwrap());
        let now = Situation { messages: vec!["all is well".into()], ..at(0) };
        assert!(runner.next(&now).unwrap_err().to_string().contains("all is well"));
        let mut runner = SessionRunner::new(session(r#"{"steps":["quit"]}"#).unwrap());
        let now = Situation { failure: Some("no room".into()), ..at(0) };
        assert!(runner.next(&now).unwrap_err().to_string().contains("no room"));
    }
}
