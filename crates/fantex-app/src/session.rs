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

use fantex::base::{Error, Result, json_problem};
use fantex::paint::KindName;
use serde::Deserialize;

use crate::camera::{CameraMode, ViewPreset};
use crate::command::parse_keys;
use crate::display::{Overlay, ShadingView};
use crate::export::Preset;
use crate::paint::{
    AlphaShown, Answer, BrushSettings, ChannelSwitches, FillReach, GradientSettings, Material, PaintTool,
    PictureUse, StencilSettings, SymmetrySettings, TextureChoice, parse_hex,
};
use crate::settings::{Tab, read_limited};

/// Most bytes of a file that is read as a session.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Seconds that a picture may take.
const PICTURE_SECONDS: f64 = 120.0;

/// What the viewer is to do.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Session {
    /// Whether nobody looks at the window: frames that no picture is taken of are drawn in its middle rows only.
    #[serde(default)]
    pub is_unwatched: bool,
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
        keys: Vec<String>,
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
    Camera {
        /// The pinhole, world space.
        eye: [f64; 3],
        /// A point in the middle of the picture, world space.
        target: [f64; 3],
    },
    View(ViewPreset),
    Mode(CameraMode),
    Overlay(Overlay),
    Shading(ShadingView),
    Tab(Tab),
    /// Opens a file or address.
    Open(String),
    /// Whether how a model becomes an asset is asked, as where a user sits before it.
    Asks(bool),
    /// Exports the asset with a preset, and pictures of so many columns.
    Export {
        path: PathBuf,
        preset: Preset,
        side: u32,
    },
    /// Copies the asset.
    SaveCopy(PathBuf),
    /// Gives the asset that is painted on further channels.
    AddChannels(Vec<KindName>),
    /// Takes channels out of it, without asking.
    RemoveChannels(Vec<KindName>),
    /// What the materials of what is painted on make of the opacity.
    ShowAlpha(AlphaShown),
    /// Where the tool `opacity` brings the opacity, 0..1.
    OpacityTo(f32),
    /// Shows the height alone, or no longer.
    SeeHeight(bool),
    /// Waits until it is exported or copied, at most so many seconds.
    WaitExported(f64),
    /// Answers what is asked before a model is painted on.
    Answer(Answer),
    /// Changes a number of the look that is shown, by its key.
    LookNumber(String, f64),
    /// Copies a file of the session's folder over another one.
    #[cfg(feature = "test-steps")]
    Copy {
        from: PathBuf,
        to: PathBuf,
    },
    /// Chooses a picture of surroundings, `sky` or `studio`.
    Surroundings(String),
    /// Chooses the memory for texels, mebibytes.
    Pool(u32),
    /// Plays a camera path and waits for its end.
    Play(String),
    Screenshot {
        path: PathBuf,
        /// Width and height in pixels; those on the screen without.
        #[serde(default)]
        size: Option<[u32; 2]>,
    },
    WindowScreenshot {
        path: PathBuf,
    },
    /// Gives the window another size in points.
    Resize([f32; 2]),
    /// Hides the window as a symbol, or brings it back.
    Minimize(bool),
    /// Loses the GPU's device, as when a driver is replaced, and goes on in another window.
    #[cfg(feature = "test-steps")]
    LoseDevice,
    /// Fails unless a message with this text has been shown.
    #[cfg(feature = "test-steps")]
    ExpectMessage(String),
    PaintTool(PaintTool),
    /// Takes a brush; what is left out is as usual.
    Brush(BrushSettings),
    /// Takes the brush of this name from those that are kept.
    Preset(String),
    /// Lays this text with the next click of the tool `sticker`.
    Text(String),
    /// Takes a colour: `#d8452e`.
    Color(String),
    Channels(ChannelSwitches),
    Material(Material),
    Texture(TextureChoice),
    Stencil(StencilSettings),
    /// Lets the pointer move that picture (true), or paint again.
    AdjustStencil(bool),
    /// Makes that picture as large as the view allows.
    FitStencil,
    /// Projects that picture onto all that is seen.
    Project,
    Fill(FillReach),
    Gradient(GradientSettings),
    /// Lays this picture with the next click of the tool `sticker`.
    Picture(PathBuf),
    /// What that picture shows.
    PictureUse(PictureUse),
    Symmetry(SymmetrySettings),
    /// Draws with the first button through points of the scene.
    Stroke {
        /// 0..1 along the scene's sides; one point is a click.
        points: Vec<[f64; 2]>,
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
    Layer(LayerStep),
    /// Waits until something that takes long has done a part of its work, at most so many seconds.
    WaitWorking(f64),
    /// Waits until all that was asked for is painted, at most so many seconds.
    WaitPainted(f64),
    /// Waits until all is in the file, at most so many seconds.
    WaitSaved(f64),
    /// Fails unless there are so many layers and steps of the history.
    #[cfg(feature = "test-steps")]
    ExpectPainting {
        /// Layers over the base.
        #[serde(default)]
        layers: Option<usize>,
        /// Steps that can be undone.
        #[serde(default)]
        steps: Option<usize>,
    },
    /// Waits until there is a file, at most so many seconds.
    #[cfg(feature = "test-steps")]
    WaitFile {
        path: PathBuf,
        seconds: f64,
    },
    Quit,
}

fn stroke_frames() -> u32 {
    2
}

/// Something done with layers. Where a layer is meant, it is the chosen one.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LayerStep {
    Add,
    /// A new layer of one colour or texture, hidden by its mask.
    AddFill,
    /// The same, without a mask.
    AddFillEverywhere,
    Refill,
    /// The layer of this name, or `base`.
    Select(String),
    /// Its mask.
    SelectMask(String),
    Rename(String),
    /// 0..1.
    Opacity(f32),
    Blend(fantex::paint::BlendMode),
    Show(bool),
    /// A mask that shows all (true) or hides all.
    AddMask(bool),
    /// From the model's shape.
    MakeMask(fantex::paint::MaskSource),
    InvertMask,
    RemoveMask,
    /// Whether the mask is seen instead of the base colour.
    SeeMask(bool),
    /// Towards the top (true) or the bottom.
    Move(bool),
    /// A copy above it.
    Duplicate,
    MergeDown,
    /// A new group with the layer.
    Group,
    Ungroup,
    MergeGroup,
    /// Lets a group blend as `pass_through`, or on its own (`isolated`).
    GroupKind(fantex::paint::GroupKind),
    /// Folds a group in the list, or unfolds it.
    Collapse(bool),
    /// Into the group of this name, on top.
    MoveInto(String),
    /// Above the layer of this name, into its group.
    MoveAbove(String),
    /// Below the layer of this name, into its group.
    MoveBelow(String),
    Delete,
}

impl Session {
    /// Reads a session.
    ///
    /// # Errors
    /// The file cannot be read, is no session or names unknown keys.
    pub fn load(path: &Path) -> Result<Self> {
        let name = path.display();
        let text = read_limited(path, MAX_FILE_BYTES, "the session")?;
        let mut session: Self = serde_json::from_slice(&text).map_err(|source| {
            json_problem(&text, &source).context(format_args!("{name} is no session")).with_path(path)
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for (i, step) in session.steps.iter_mut().enumerate() {
            step.check(i + 1).map_err(|error| error.in_file(path))?;
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
            Self::Screenshot { path, .. }
            | Self::WindowScreenshot { path }
            | Self::Picture(path)
            | Self::Export { path, .. }
            | Self::SaveCopy(path) => {
                *path = folder.join(&*path);
            }
            Self::Brush(BrushSettings { stamp: Some(path), .. })
            | Self::Texture(TextureChoice { look: Some(path), .. })
            | Self::Stencil(StencilSettings { image: Some(path), .. }) => *path = folder.join(&*path),
            #[cfg(feature = "test-steps")]
            Self::WaitFile { path, .. } => *path = folder.join(&*path),
            #[cfg(feature = "test-steps")]
            Self::Copy { from, to } => (*from, *to) = (folder.join(&*from), folder.join(&*to)),
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
    pub seconds: f64,
    /// Frames of the window since the start.
    pub frame: u64,
    pub is_opening: bool,
    /// Whether all that is seen has its wanted level, and the picture shows it.
    pub is_sharp: bool,
    pub is_playing: bool,
    /// Whether keys and mouse of the session are still at work.
    pub is_acting: bool,
    /// Whether a painter has something to do, or keys and mouse have.
    pub is_painting: bool,
    /// Whether a painter has done a part of something that takes long.
    pub is_working: bool,
    /// Whether something is being exported.
    pub is_exporting: bool,
    /// Whether something is not in the file yet.
    pub is_unsaved: bool,
    /// Layers and steps of the history.
    pub painted: [usize; 2],
    /// Pictures that are not on the disk yet.
    pub pictures_due: usize,
    /// Messages that were shown since the start, oldest first.
    pub messages: Vec<String>,
}

/// What the viewer shall do for a session now.
#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// A step that is done at once.
    Do(Step),
    /// Nothing, but the next frame is wanted.
    NextFrame,
    /// Nothing: what is waited for is done elsewhere, and takes its time.
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
    wait: Option<Wait>,
}

/// What is waited for, from a frame on and at most so many seconds.
#[derive(Clone, Debug)]
struct Wait {
    is_over: fn(&Situation) -> bool,
    /// A file that must be there, too.
    file: Option<PathBuf>,
    frame: u64,
    /// No frame need be drawn for it.
    is_patient: bool,
    since: f64,
    seconds: f64,
    /// What is said where it takes longer.
    problem: &'static str,
}

impl SessionRunner {
    /// At the first step.
    pub fn new(session: Session) -> Self {
        Self { steps: session.steps.into_iter(), number: 0, wait: None }
    }

    /// What to do in this frame.
    ///
    /// # Errors
    /// A step failed or took too long.
    pub fn next(&mut self, now: &Situation) -> Result<Act> {
        if let Some(wait) = &self.wait {
            if !wait.is_met(now) {
                if now.seconds - wait.since > wait.seconds {
                    let reason = format!("after {} s {}", wait.seconds, wait.problem);
                    return Err(at_step(self.number, reason));
                }
                let is_patient = wait.is_patient && now.frame >= wait.frame && !now.is_acting;
                return Ok(if is_patient { Act::Wait } else { Act::NextFrame });
            }
            self.wait = None;
        }
        let Some(step) = self.steps.next() else { return Ok(Act::End) };
        self.number += 1;
        match &step {
            Step::Quit => return Ok(Act::End),
            #[cfg(feature = "test-steps")]
            Step::ExpectMessage(_) | Step::ExpectPainting { .. } => {
                return match contradiction(&step, now) {
                    Some(reason) => Err(at_step(self.number, reason)),
                    None => Ok(Act::NextFrame),
                };
            }
            _ => {}
        }
        let wait = Wait::of(&step, now);
        let act = if wait.is_some() { Act::NextFrame } else { Act::Do(step.clone()) };
        self.wait = wait.or_else(|| Some(Wait::after(&step, now)));
        Ok(act)
    }
}

impl Wait {
    fn is_met(&self, now: &Situation) -> bool {
        let is_there = self.file.as_ref().is_none_or(|file| file.exists());
        now.frame >= self.frame && is_there && (self.is_over)(now)
    }

    /// So many frames.
    fn frames(count: u32, now: &Situation) -> Self {
        Self {
            is_over: |_| true,
            file: None,
            frame: now.frame + u64::from(count),
            is_patient: false,
            since: now.seconds,
            seconds: f64::INFINITY,
            problem: "",
        }
    }

    /// At least so many frames, and until something is over, for so many seconds at most.
    fn until(
        is_over: fn(&Situation) -> bool,
        frames: u32,
        (seconds, problem): (f64, &'static str),
        now: &Situation,
    ) -> Self {
        Self { is_over, is_patient: true, seconds, problem, ..Self::frames(frames, now) }
    }

    /// The same, while frames are drawn.
    fn with_frames(self) -> Self {
        Self { is_patient: false, ..self }
    }

    /// What a step is for that only waits; none of others.
    fn of(step: &Step, now: &Situation) -> Option<Self> {
        Some(match step {
            Step::WaitFrames(count) => Self::frames(*count, now),
            Step::WaitLoaded(seconds) => {
                Self::until(|now| !now.is_opening, 0, (*seconds, "the file was still being opened"), now)
            }
            // Before the third frame the picture cannot be the wanted one.
            Step::WaitSharp(seconds) => {
                let is_sharp = |now: &Situation| !now.is_opening && now.is_sharp;
                Self::until(is_sharp, 3, (*seconds, "the picture was not sharp"), now)
            }
            // It may be over soon.
            Step::WaitWorking(seconds) => {
                let problem = "nothing that takes long was under way";
                Self::until(|now| now.is_working, 0, (*seconds, problem), now).with_frames()
            }
            Step::WaitExported(seconds) => {
                Self::until(|now| !now.is_exporting, 0, (*seconds, "it was still being exported"), now)
            }
            Step::WaitPainted(seconds) => {
                let is_painted = |now: &Situation| !now.is_opening && !now.is_painting;
                Self::until(is_painted, 2, (*seconds, "the painter was still busy"), now)
            }
            Step::WaitSaved(seconds) => {
                let is_saved = |now: &Situation| !now.is_painting && !now.is_unsaved;
                Self::until(is_saved, 2, (*seconds, "not all was saved"), now)
            }
            #[cfg(feature = "test-steps")]
            Step::WaitFile { path, seconds } => {
                let file = Some(path.clone());
                Self { file, ..Self::until(|_| true, 0, (*seconds, "there was no such file"), now) }
            }
            _ => return None,
        })
    }

    /// What has to have happened after a step before the next one.
    fn after(step: &Step, now: &Situation) -> Self {
        const FOREVER: (f64, &str) = (f64::INFINITY, "");
        match step {
            // A picture of the window comes with a frame.
            Step::Screenshot { .. } | Step::WindowScreenshot { .. } => {
                let patience = (PICTURE_SECONDS, "the picture was not written");
                Self::until(|now| now.pictures_due == 0, 0, patience, now).with_frames()
            }
            Step::Hold { frames, .. } => Self::frames(*frames, now),
            Step::Play(_) => Self::until(|now| !now.is_playing, 0, FOREVER, now).with_frames(),
            Step::Drag { .. } | Step::Stroke { .. } => Self::until(|now| !now.is_acting, 2, FOREVER, now),
            // What it changes is there in the next frame.
            _ => Self::frames(2, now),
        }
    }
}

/// What is not as a step expects it; none where all is.
#[cfg(feature = "test-steps")]
fn contradiction(step: &Step, now: &Situation) -> Option<String> {
    match step {
        Step::ExpectMessage(text) => {
            let is_there = now.messages.iter().any(|message| message.contains(text));
            let found = now.messages.join(" | ");
            (!is_there).then(|| format!("no message says '{text}'; there are: {found}"))
        }
        Step::ExpectPainting { layers, steps } => {
            let [found_layers, found_steps] = now.painted;
            let is_other =
                layers.is_some_and(|n| n != found_layers) || steps.is_some_and(|n| n != found_steps);
            is_other
                .then(|| format!("there are {found_layers} layers and {found_steps} steps of the history"))
        }
        _ => None,
    }
}
