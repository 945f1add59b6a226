//! The viewer's whole state and what changes it, without a window: panels show and edit it, the shell carries out what only a
//! window or a GPU can do.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::Modifiers;
use fantex::base::{Error, Result};
use fantex::glam::DVec2;
use fantex::paint::PaintOptions;
use fantex::scene::{Background, Camera, Lights};
use fantex::store::ChannelKind;
use fantex::stream::CameraPath;
use fantex::texture::{ColorSpace, Image, Samples};

use crate::camera::{
    CameraMode, CameraRig, FlyMotion, Ground, MeshGround, MoveInput, PathRecorder, SceneScale, ViewPreset,
    Walker, camera_of, load_path, save_path,
};
use crate::command::Command;
use crate::display::{DisplaySettings, ShadingView};
use crate::document::{Content, Document};
use crate::export::ExportSettings;
use crate::figures::{Graphs, StreamFigures};
use crate::job::{Job, JobState};
use crate::light::{MapKey, Surroundings, SurroundingsMap};
use crate::live::LiveLook;
use crate::notices::Notices;
use crate::pacing::Pacing;
use crate::paint::{PaintTool, Painting, PenEvent, StickerKind};
use crate::pen::PenReadings;
use crate::readout::Readout;
use crate::scene_view::{PrepareScene, SceneModel};
use crate::settings::{PanelSettings, Settings, StreamingSettings};

pub use exporting::{Exporting, HandedOver};
pub use keys::{BRUSH_KEY, KeyPhase};
pub use opening::{Asked, Opening};

/// Larger models get their tree of triangles only when somebody wants to walk.
const TREE_AT_ONCE_TRIANGLES: usize = 4_000_000;

/// A frame of the camera's motion is no longer than this, however long the last frame took.
const MAX_STEP_SECONDS: f64 = 0.1;

/// Calls for another frame from any thread.
pub type Wake = Arc<dyn Fn() + Send + Sync>;

/// What only the shell can do.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    Dialog(FileDialog),
    Picture {
        path: PathBuf,
        size: PictureSize,
    },
    WindowPicture(PathBuf),
    /// Lose the GPU's device, as when a driver is replaced.
    #[cfg(feature = "test-steps")]
    LoseDevice,
    Quit,
}

/// A file that is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileDialog {
    Open,
    Surroundings,
    /// A picture that shapes the brush.
    Stamp,
    /// A picture to lay onto the surface.
    Sticker,
    /// A picture to lay over the view.
    Stencil,
    /// A look to paint with.
    Look,
    LoadPath,
    SavePath,
    /// Where this asset is exported to.
    Export(PathBuf, ExportSettings),
    /// Where this asset is copied to.
    SaveCopy(PathBuf),
}

/// Ends of names of pictures.
pub const PICTURES: &[&str] = &["hdr", "exr", "png", "jpg", "jpeg", "tif", "tiff", "webp"];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureSize {
    /// So many times as wide and high as on the screen.
    Times(u32),
    Pixels([u32; 2]),
}

/// A camera path being played or recorded.
#[derive(Clone, Debug, Default)]
pub enum PathState {
    #[default]
    Still,
    Recording {
        /// When it began.
        since: f64,
        recorder: PathRecorder,
    },
    Playing {
        since: f64,
    },
}

/// Everything that a picture of the scene depends on, besides what is resident.
#[derive(Clone, Debug, PartialEq)]
struct PictureState {
    rig: CameraRig,
    size: [u32; 2],
    light: crate::light::LightSettings,
    map: Option<MapKey>,
    display: DisplaySettings,
    streaming: StreamingSettings,
}

/// What mouse and keys did in the scene in one frame. Lengths are in units of the scene's height.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneInput {
    /// Drag with the first button.
    pub drag: DVec2,
    /// Drag with another button.
    pub side_drag: DVec2,
    /// The part of that with the middle button.
    pub middle_drag: DVec2,
    /// What the pen (or the first button) did, in order.
    pub pen: Vec<PenEvent>,
    /// Keys that are held beside.
    pub modifiers: Modifiers,
    /// Whether the modifier that turns the sun is held.
    pub turns_sun: bool,
    /// Whether the key is held with which drags change the brush.
    pub adjusts_brush: bool,
    /// Notches of the wheel, away from the user positive.
    pub wheel: f64,
    /// Where the cursor is, 0..1 along the scene's sides.
    pub cursor: Option<DVec2>,
    pub is_double_click: bool,
    pub movement: MoveInput,
}

/// A picture of the scene that stays beside it: A, to the left of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kept {
    /// Where it was seen from.
    pub rig: CameraRig,
    /// Its size.
    pub pixels: [u32; 2],
    /// Where the line is, as a share of the scene's width.
    pub divider: f32,
}

#[derive(Default)]
pub struct Viewer {
    pub settings: Settings,
    pub document: Option<Document>,
    pub opening: Option<Opening>,
    pub exporting: Option<Exporting>,
    /// Files beside a model of which the user was told that exporting to its name again replaces them.
    told_replaced: Vec<PathBuf>,
    /// A look that is shown instead of a document.
    pub live: Option<LiveLook>,
    /// The model that looks are shown on, where they name none.
    pub look_model: Option<PathBuf>,
    /// What the user has to say before a model is opened.
    pub asked: Option<Asked>,
    /// Whether how a model becomes an asset is asked, and whether exports replace files beside them; else it becomes one as usual, and
    /// they do.
    pub asks: bool,
    pub rig: CameraRig,
    pub path: Option<CameraPath>,
    pub path_state: PathState,
    pub notices: Notices,
    /// Why the program is to end.
    pub failure: Option<String>,
    pub figures: StreamFigures,
    /// How often what could not be read was to be read again.
    pub retries: u64,
    pub graphs: Graphs,
    /// What the pointer is on.
    pub readout: Readout,
    pub pacing: Pacing,
    pub has_help: bool,
    pub painting: Option<Painting>,
    /// Whether what is opened is to be painted on.
    pub paints: bool,
    /// What waits until what is painted on is saved.
    departure: Option<leaving::Departure>,
    /// What was given up while it was opened, until its thread has ended.
    given_up: Vec<Opening>,
    /// A channel that is removed if the user says so.
    pub removal: Option<ChannelKind>,
    /// Memory for pages while painting, bytes.
    pub paint_memory_bytes: usize,
    pub brushes_file: Option<PathBuf>,
    /// Pressure of a tablet, from outside the window library.
    pub pen: PenReadings,
    /// What the scene is compared with.
    pub kept: Option<Kept>,
    /// The scene's size on the screen in pixels; zero while it is not shown.
    pub scene_pixels: [u32; 2],
    /// Pixels per point of the window; zero while the scene is not shown.
    pub pixels_per_point: f64,
    /// The scene's upper left corner in the window, points.
    pub scene_corner: [f32; 2],
    /// What draws.
    pub adapter: String,
    pub picture_folder: PathBuf,
    /// Pictures that were asked for and are not in their files yet.
    named_pictures: Vec<PathBuf>,
    /// The model in the graphics memory, until the shell takes it.
    pub new_model: Option<Option<SceneModel>>,
    /// A drag that changes the brush.
    brush_drag: Option<keys::BrushDrag>,
    /// All is shown when the brush's key is let go.
    frames_on_release: bool,
    warned: Option<leaving::Warned>,
    /// The shading to go back to when nothing is seen instead of the base colour any more.
    shading_before_alone: Option<ShadingView>,
    /// What was opened has not been framed yet with the panels that it brings.
    is_unframed: bool,
    requests: Vec<Request>,
    fly: FlyMotion,
    walker: Walker,
    /// What a walker stands on, once it is prepared.
    pub ground: Option<MeshGround>,
    ground_job: Option<Job<MeshGround>>,
    map: Option<SurroundingsMap>,
    map_job: Option<(MapKey, Job<Result<SurroundingsMap>>)>,
    /// Surroundings that could not be had, so that they are not tried in every frame.
    map_failed: Option<MapKey>,
    panels_before: Option<PanelSettings>,
    looks: Option<PictureState>,
    prepare: Option<PrepareScene>,
    /// The document on its way to another GPU.
    moving: Option<Job<Result<SceneModel>>>,
    wake: Option<Wake>,
}

impl Viewer {
    /// A viewer without a document. `prepare` brings a document to the graphics memory, on the thread that opens it; without,
    /// nothing is drawn.
    pub fn new(settings: Settings, prepare: Option<PrepareScene>, wake: Wake) -> Self {
        Self {
            rig: CameraRig { fov_degrees: settings.camera.fov_degrees, ..CameraRig::default() },
            fly: FlyMotion::new(settings.camera.fly_speed),
            settings,
            paint_memory_bytes: PaintOptions::default().memory_bytes,
            prepare,
            wake: Some(wake),
            ..Self::default()
        }
    }

    /// The frame's time in seconds.
    pub fn now(&self) -> f64 {
        self.notices.now
    }

    /// What the shell has to do, once each.
    pub fn take_requests(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.requests)
    }

    /// Whether the window is to close, once: hidden windows ask for nothing else.
    pub fn take_quit(&mut self) -> bool {
        let count = self.requests.len();
        self.requests.retain(|request| *request != Request::Quit);
        self.requests.len() < count
    }

    pub fn request(&mut self, request: Request) {
        self.requests.push(request);
    }

    /// The model's size, or that of nothing.
    pub fn scale(&self) -> SceneScale {
        let live = self.live.as_ref().map(|live| live.scale);
        live.or(self.document.as_ref().map(|document| document.scale)).unwrap_or_default()
    }

    /// Width by height of the scene on the screen.
    pub fn aspect(&self) -> f64 {
        let [width, height] = self.scene_pixels.map(|n| f64::from(n.max(1)));
        width / height
    }

    pub fn camera(&self) -> Camera {
        self.rig.camera()
    }

    pub fn lights(&self) -> Lights {
        self.settings.light.lights(self.map_in_use())
    }

    pub fn background(&self) -> Background {
        self.settings.light.background(self.map_in_use())
    }

    /// Whether shading, overlay and lines can be chosen: looks are drawn as they are.
    pub fn has_display(&self) -> bool {
        self.live.is_none()
    }

    /// Whether surroundings are being read or computed.
    pub fn is_making_surroundings(&self) -> bool {
        self.map_job.is_some()
    }

    /// Height of a walker's eyes in world units.
    pub fn eye_height(&self) -> f64 {
        self.settings.camera.eye_height.unwrap_or_else(|| self.scale().eye_height())
    }

    /// Whether the ground is being prepared.
    pub fn is_preparing_ground(&self) -> bool {
        self.ground_job.is_some()
    }

    /// Whether somebody wants to walk where no ground is below or above the camera.
    pub fn is_beside_ground(&self) -> bool {
        self.settings.camera.mode == CameraMode::Walk && self.walker.is_lost()
    }

    /// The map in use: that of the settings, or while the sun of a sky is moving the one before.
    fn map_in_use(&self) -> Option<&SurroundingsMap> {
        let wanted = self.settings.light.map_key()?;
        self.map.as_ref().filter(|map| {
            map.key == wanted || matches!((&map.key, &wanted), (MapKey::Sky(_), MapKey::Sky(_)))
        })
    }

    fn waker(&self) -> impl Fn() + Send + Sync + 'static {
        let wake = self.wake.clone();
        move || wake.iter().for_each(|wake| wake())
    }

    /// Shows nothing, whatever is lost by it but what can be saved.
    pub fn close(&mut self) {
        self.departure = None;
        self.cancel_opening();
        self.asked = None;
        self.removal = None;
        self.exporting.take_if(|exporting| exporting.is_asked());
        self.live = None;
        self.painting = None;
        self.document = None;
        self.new_model = Some(None);
        self.forget_scene();
    }

    fn forget_scene(&mut self) {
        self.moving = None;
        self.ground = None;
        self.ground_job = None;
        self.path_state = PathState::Still;
        self.figures = StreamFigures::default();
        self.graphs.clear();
        self.readout = Readout::default();
        self.walker.leave();
        self.fly.stop();
        self.pacing.changed();
    }

    /// Picks up what threads have done.
    pub fn poll(&mut self) {
        self.poll_moving();
        self.poll_opening();
        self.poll_ground();
        self.poll_map();
        self.poll_readout();
        let now = self.now();
        if let Some(camera) = self.live.as_mut().and_then(|live| live.poll(now)) {
            self.set_camera(&camera);
        }
        if let Some(live) = &mut self.live
            && std::mem::take(&mut live.is_overtaken)
        {
            let name = live.path().file_name().unwrap_or_default().to_string_lossy();
            self.notices.warning(format!(
                "{name} was changed by another program, and here: Save writes over it, Discard takes it."
            ));
        }
        if let Some(painting) = &mut self.painting {
            painting.poll(&mut self.settings.paint, &mut self.notices);
            if let (Some(asset), Some(document)) = (painting.newer.take(), &mut self.document) {
                document.content = Content::Asset(asset);
            }
        }
        self.poll_export();
        self.light_alone();
        self.poll_leaving();
    }

    /// Starts the tree of triangles where it is wanted and not there.
    fn want_ground(&mut self) {
        let Some(document) = &self.document else { return };
        let triangles = document.mesh().triangles.len();
        let is_wanted = triangles <= TREE_AT_ONCE_TRIANGLES || self.settings.camera.mode == CameraMode::Walk;
        if !is_wanted || self.ground.is_some() || self.ground_job.is_some() {
            return;
        }
        // Not the asset: a painter's must not be kept from reusing its space.
        let mesh = document.shared_mesh();
        match Job::spawn("ground", self.waker(), move || MeshGround::new(mesh)) {
            Ok(job) => self.ground_job = Some(job),
            Err(error) => self.notices.warning(format!("cannot start a thread for the ground: {error}")),
        }
    }

    fn poll_ground(&mut self) {
        match self.ground_job.as_ref().map(Job::poll) {
            None | Some(JobState::Running) => {}
            Some(JobState::Done(ground)) => {
                self.ground = Some(ground);
                self.ground_job = None;
            }
            Some(JobState::Lost) => {
                self.ground_job = None;
                self.notices.warning("Nobody can walk here: the ground could not be prepared.");
            }
        }
    }

    fn poll_map(&mut self) {
        if let Some((key, job)) = &self.map_job {
            match job.poll() {
                JobState::Running => return,
                JobState::Done(Ok(map)) => {
                    self.map = Some(map);
                    self.pacing.changed();
                }
                JobState::Done(Err(error)) => {
                    self.map_failed = Some(key.clone());
                    self.notices.error(error.to_string());
                }
                JobState::Lost => {
                    self.map_failed = Some(key.clone());
                    self.notices.error("The surroundings could not be made: the program failed on them.");
                }
            }
            self.map_job = None;
        }
        let Some(wanted) = self.settings.light.map_key() else { return };
        let is_there = self.map.as_ref().is_some_and(|map| map.key == wanted);
        if is_there || self.map_failed.as_ref() == Some(&wanted) {
            return;
        }
        let key = wanted.clone();
        match Job::spawn("surroundings", self.waker(), move || key.make()) {
            Ok(job) => self.map_job = Some((wanted, job)),
            Err(error) => {
                self.map_failed = Some(wanted);
                self.notices.warning(format!("cannot start a thread for the surroundings: {error}"));
            }
        }
    }

    pub fn show(&mut self, preset: ViewPreset) {
        if let Some(document) = &self.document {
            self.rig = preset.rig(document.mesh(), self.aspect());
            self.after_jump();
        }
    }

    /// Puts the camera somewhere.
    pub fn set_camera(&mut self, camera: &Camera) {
        let rig = CameraRig::of_camera(camera);
        if rig.is_sound() {
            self.is_unframed = false;
            self.rig = rig;
            self.after_jump();
        }
    }

    fn after_jump(&mut self) {
        self.settings.camera.fov_degrees = self.rig.fov_degrees;
        self.walker.leave();
        self.fly.stop();
    }

    pub fn command(&mut self, command: Command) {
        match command {
            Command::OpenDialog => self.request(Request::Dialog(FileDialog::Open)),
            Command::Open(text) => self.open(&text),
            Command::Reload => {
                if let Some(place) = self.document.as_ref().map(|document| document.place.clone()) {
                    self.begin_opening(place, true);
                }
            }
            Command::Close => self.ask_close(),
            Command::Cancel => self.cancel(),
            Command::Quit => self.request(Request::Quit),
            Command::Export => self.ask_export(),
            Command::SaveCopy => self.ask_copy(),
            Command::Save if self.live.is_some() => self.save_look(),
            Command::Save | Command::Screenshot => self.request_picture(1),
            Command::LargeScreenshot(times) => self.request_picture(times),
            Command::WindowScreenshot => {
                let path = self.next_picture(&format!("{}-window", self.stem()));
                self.request(Request::WindowPicture(path));
            }
            Command::FrameAll => {
                if let Some(camera) = self.live.as_ref().and_then(|live| live.camera) {
                    self.set_camera(&camera);
                }
                if let Some(document) = &self.document {
                    self.rig.frame_all(document.mesh(), self.aspect());
                    self.after_jump();
                }
            }
            Command::View(preset) => self.show(preset),
            Command::Mode(mode) => self.set_mode(mode),
            Command::StepOverlay(_) | Command::StepShading(_) | Command::ToggleWireframe
                if !self.has_display() => {}
            Command::StepOverlay(by) => self.settings.display.step_overlay(by),
            Command::StepShading(by) => self.settings.display.step_shading(by),
            Command::ToggleWireframe => toggle(&mut self.settings.display.has_wireframe),
            Command::ToggleShadows => toggle(&mut self.settings.light.has_shadows),
            Command::Compare => self.compare(),
            Command::Exposure(quarters) => self.settings.display.change_exposure(quarters as f32 * 0.25),
            Command::ToggleInspector => toggle(&mut self.settings.panels.has_inspector),
            Command::ToggleAtlas => toggle(&mut self.settings.panels.has_atlas),
            Command::ToggleGraphs => toggle(&mut self.settings.panels.has_graphs),
            Command::ToggleGizmo => toggle(&mut self.settings.panels.has_gizmo),
            Command::ToggleReadout => toggle(&mut self.settings.panels.has_readout),
            Command::ToggleAllPanels => self.toggle_all_panels(),
            Command::ToggleHelp => toggle(&mut self.has_help),
            Command::ToggleStreaming => toggle(&mut self.settings.streaming.is_running),
            Command::ToggleRecording => self.toggle_recording(),
            Command::TogglePlayback => self.toggle_playback(),
            Command::LoadPath => self.request(Request::Dialog(FileDialog::LoadPath)),
            Command::SavePath => match self.path.is_some() {
                true => self.request(Request::Dialog(FileDialog::SavePath)),
                false => self.notices.info("There is no camera path yet: press R to record one."),
            },
            Command::ChooseSurroundings => self.request(Request::Dialog(FileDialog::Surroundings)),
            Command::TogglePainting => self.toggle_painting(),
            Command::Paint(command) => self.paint_command(&command),
            Command::Light(preset) => self.settings.light = preset.light(&self.settings.light),
        }
    }

    fn compare(&mut self) {
        let kept = Kept { rig: self.rig, pixels: self.scene_pixels, divider: 0.5 };
        self.kept = (self.kept.is_none() && self.document.is_some()).then_some(kept);
    }

    /// Goes to where the kept picture was seen from.
    pub fn see_kept(&mut self) {
        if let Some(kept) = self.kept {
            self.rig = kept.rig;
            self.after_jump();
        }
    }

    /// The nearest thing that can be stopped.
    fn cancel(&mut self) {
        if self.has_help {
            self.has_help = false;
        } else if self.departure.is_some() {
            self.cancel_leaving();
        } else if self.opening.is_some() {
            self.cancel_opening();
        } else if self.exporting.is_some() {
            self.cancel_export();
        } else if self.removal.is_some() {
            self.removal = None;
        } else if self.asked.is_some() {
            self.answer(None);
        } else if !matches!(self.path_state, PathState::Still) {
            self.path_state = PathState::Still;
        } else if let Some(painting) = self.painting.as_ref().filter(|painting| painting.work.is_some()) {
            painting.give_up_work();
        } else if self.painting.as_mut().is_none_or(|painting| !painting.drop_placing()) {
            self.settings.paint.stencil.is_adjusted = false;
        }
    }

    fn set_mode(&mut self, mode: CameraMode) {
        self.settings.camera.mode = mode;
        self.walker.leave();
        self.fly.stop();
        self.want_ground();
    }

    fn toggle_all_panels(&mut self) {
        let panels = &mut self.settings.panels;
        let none = PanelSettings { tab: panels.tab, ..PanelSettings::NONE };
        match self.panels_before.take() {
            Some(before) if !(panels.has_inspector || panels.has_atlas || panels.has_graphs) => {
                *panels = before
            }
            // They were hidden when the program ended.
            None if *panels == none => {
                *panels = PanelSettings { tab: panels.tab, ..PanelSettings::default() }
            }
            _ => self.panels_before = Some(std::mem::replace(panels, none)),
        }
    }

    /// The name of what is shown, for titles.
    pub fn shown_name(&self) -> Option<String> {
        match &self.live {
            Some(live) => Some(live.path().file_name()?.to_string_lossy().into_owned()),
            None => self.document.as_ref().map(|document| document.place.name()),
        }
    }

    /// The same without extension, for names of pictures.
    pub fn stem(&self) -> String {
        let name = self.shown_name().map(PathBuf::from);
        name.and_then(|n| n.file_stem().map(|s| s.to_string_lossy().into_owned())).unwrap_or("fantex".into())
    }

    fn toggle_recording(&mut self) {
        self.path_state = match std::mem::replace(&mut self.path_state, PathState::Still) {
            PathState::Recording { since, recorder } => {
                self.path = recorder.finish(self.now() - since, &self.rig.camera());
                self.notices.info("The camera path was recorded: P plays it, the View page saves it.");
                PathState::Still
            }
            _ if self.document.is_some() => {
                self.notices.info("Recording the camera's path; R ends it.");
                PathState::Recording { since: self.now(), recorder: PathRecorder::default() }
            }
            _ => PathState::Still,
        };
    }

    fn toggle_playback(&mut self) {
        self.path_state = match (&self.path_state, &self.path) {
            (PathState::Playing { .. }, _) => PathState::Still,
            (_, Some(_)) => PathState::Playing { since: self.now() },
            (_, None) => {
                self.notices.info("There is no camera path yet: press R to record one.");
                PathState::Still
            }
        };
    }

    pub fn load_path(&mut self, file: &std::path::Path) {
        match load_path(file) {
            Ok(path) => {
                let text = format!(
                    "{}: {:.1} s of camera path; P plays it.",
                    file.display(),
                    path.duration_seconds()
                );
                self.path = Some(path);
                self.notices.info(text);
            }
            Err(error) => self.notices.error(error.to_string()),
        }
    }

    pub fn save_path(&mut self, file: &std::path::Path) {
        let Some(path) = &self.path else { return };
        match save_path(path, file) {
            Ok(()) => self.notices.info(format!("Saved {}.", file.display())),
            Err(error) => self.notices.error(error.to_string()),
        }
    }

    /// Takes a file that was dropped onto the window: a picture (see [`take_pasted`](Self::take_pasted)), or something to be opened.
    pub fn take_dropped(&mut self, path: PathBuf) {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
        if !extension.is_some_and(|extension| PICTURES.contains(&extension.as_str())) {
            return self.open_file(path);
        }
        self.take_picture(path);
    }

    /// Takes a picture of the clipboard, sRGB with straight alpha, as one that was dropped. It is kept as a PNG beside the settings, or with
    /// the system's temporary files where there are none.
    pub fn take_pasted(&mut self, [width, height]: [u32; 2], texels: Vec<u8>) {
        let beside = self.brushes_file.as_deref().and_then(Path::parent).map(Path::to_owned);
        let folder = beside.unwrap_or_else(|| std::env::temp_dir().join("fantex"));
        match save_pasted(&folder.join("pasted"), [width, height], texels) {
            Ok(path) => self.take_picture(path),
            Err(error) => self.notices.error(format!("The picture cannot be pasted: {error}")),
        }
    }

    /// A picture as sticker or over the view while something is painted on, else as surroundings.
    fn take_picture(&mut self, path: PathBuf) {
        let paint = &mut self.settings.paint;
        let dialog = match (&self.painting, paint.tool) {
            (None, _) => FileDialog::Surroundings,
            (Some(_), PaintTool::Sticker) => {
                paint.sticker = StickerKind::Picture;
                FileDialog::Sticker
            }
            (Some(_), _) => FileDialog::Stencil,
        };
        self.take_file(dialog, path);
    }

    /// Takes the file that was chosen in a dialog.
    pub fn take_file(&mut self, dialog: FileDialog, path: PathBuf) {
        if let Some(painting) = &mut self.painting {
            painting.forget_files();
        }
        let paint = &mut self.settings.paint;
        match dialog {
            FileDialog::Open => self.open_file(path),
            FileDialog::Surroundings => {
                // One that was chosen before is read again.
                let key = MapKey::File(path.clone());
                self.map.take_if(|map| map.key == key);
                self.map_failed = None;
                self.settings.light.surroundings = Surroundings::File(path);
            }
            FileDialog::Stamp => paint.brush.stamp = Some(path),
            FileDialog::Sticker => paint.picture = Some(path),
            FileDialog::Stencil => (paint.stencil.image, paint.stencil.is_on) = (Some(path), true),
            FileDialog::Look => paint.texture.look = Some(path),
            FileDialog::LoadPath => self.load_path(&path),
            FileDialog::SavePath => self.save_path(&path),
            FileDialog::Export(asset, settings) => self.export_of(asset, path, settings),
            FileDialog::SaveCopy(asset) => self.copy_of(asset, path),
        }
    }

    /// Moves camera and light as mouse and keys want. Returns whether something goes on moving by itself.
    pub fn navigate(&mut self, input: &SceneInput, step: f64) -> bool {
        if std::mem::take(&mut self.is_unframed) {
            self.show(ViewPreset::ThreeQuarter);
        }
        let input = &self.paint(input);
        let step = step.clamp(0.0, MAX_STEP_SECONDS);
        if input.turns_sun && input.drag != DVec2::ZERO {
            self.settings.light.has_sun = true;
            self.settings.light.drag_sun(input.drag);
        }
        if let PathState::Playing { since } = self.path_state {
            return self.play(self.now() - since);
        }
        let drag = if input.turns_sun { DVec2::ZERO } else { input.drag };
        self.rig.fov_degrees = self.settings.camera.fov_degrees;
        let goes_on = match self.settings.camera.mode {
            CameraMode::Orbit => {
                self.orbit(input, drag);
                false
            }
            CameraMode::Fly => self.fly(input, drag, step),
            CameraMode::Walk => self.walk(input, drag, step),
        };
        if let PathState::Recording { since, recorder } = &mut self.path_state {
            recorder.take(self.notices.now - *since, &self.rig.camera());
            return true;
        }
        goes_on
    }

    fn play(&mut self, at: f64) -> bool {
        let Some(path) = &self.path else {
            self.path_state = PathState::Still;
            return false;
        };
        let is_over = at >= path.duration_seconds();
        let camera = path.at(at).as_ref().map(camera_of);
        // Halfway between opposite views there may be none.
        if let Some(camera) = camera.filter(|camera| camera.defect().is_none()) {
            self.set_camera(&camera);
        }
        if is_over {
            self.path_state = PathState::Still;
        }
        !is_over
    }

    fn orbit(&mut self, input: &SceneInput, drag: DVec2) {
        let before = self.rig;
        if drag != DVec2::ZERO {
            self.rig.orbit(drag);
        }
        if input.side_drag != DVec2::ZERO {
            self.rig.pan(input.side_drag);
        }
        if let Some(cursor) = input.cursor {
            if input.wheel != 0.0 {
                let point = self.rig.point_under(cursor, self.aspect(), self.hit_under(cursor));
                self.rig.zoom_to(point, 0.85f64.powf(input.wheel), &self.scale());
            }
            if input.is_double_click
                && let Some(distance) = self.hit_under(cursor)
            {
                let point = self.rig.point_under(cursor, self.aspect(), Some(distance));
                self.rig.look_at(point);
            }
        }
        if !self.rig.is_sound() {
            self.rig = before;
        }
    }

    /// World units along the ray under the cursor to the model.
    pub fn hit_under(&self, cursor: DVec2) -> Option<f64> {
        let ray = self.rig.ray(cursor, self.aspect());
        Some(self.ground.as_ref()?.first(self.rig.eye, ray, f64::INFINITY)?.distance)
    }

    fn look(&mut self, drag: DVec2) {
        // As in games the line of sight follows the hand, faster through a wide lens.
        let turn = drag * (1.5 * self.rig.fov_degrees.to_radians());
        self.rig.look(-turn.x, -turn.y);
    }

    fn fly(&mut self, input: &SceneInput, drag: DVec2, step: f64) -> bool {
        let before = self.rig;
        self.look(drag + input.side_drag);
        self.fly.speed = self.settings.camera.fly_speed;
        self.fly.change_speed(input.wheel);
        self.settings.camera.fly_speed = self.fly.speed;
        let scale = self.scale();
        let goes_on = self.fly.step(&mut self.rig, &input.movement, &scale, step);
        let is_lost = (self.rig.eye - scale.center).length() > 1e3 * scale.diagonal;
        if is_lost || !self.rig.is_sound() {
            self.rig = before;
            self.fly.stop();
        }
        goes_on
    }

    fn walk(&mut self, input: &SceneInput, drag: DVec2, step: f64) -> bool {
        self.look(drag + input.side_drag);
        let camera = &mut self.settings.camera;
        camera.walk_speed = (camera.walk_speed * 1.2f64.powf(input.wheel)).clamp(0.1, 20.0);
        self.walker.speed = camera.walk_speed;
        let eye_height = self.eye_height();
        self.walker.eye_height = eye_height;
        let Some(ground) = &self.ground else { return self.ground_job.is_some() };
        self.walker.step(&mut self.rig, &input.movement, ground, step)
    }

    /// Compares with the last frame and tells the pacing what has changed.
    pub fn notice_changes(&mut self) {
        let looks = PictureState {
            rig: self.rig,
            size: self.scene_pixels,
            light: self.settings.light.clone(),
            map: self.map_in_use().map(|map| map.key.clone()),
            display: self.settings.display.clone(),
            streaming: self.settings.streaming,
        };
        if let Some(before) = &self.looks {
            let has_moved = before.rig != looks.rig
                || before.light != looks.light
                || before.display.exposure_stops != looks.display.exposure_stops;
            if has_moved {
                self.pacing.moved(self.notices.now);
            } else if *before != looks {
                self.pacing.changed();
            }
        } else {
            self.pacing.changed();
        }
        self.looks = Some(looks);
    }
}

/// Keeps a pasted picture under a name that its texels make: the same one is kept once.
fn save_pasted(folder: &Path, [width, height]: [u32; 2], texels: Vec<u8>) -> Result<PathBuf> {
    if texels.is_empty() || texels.len() as u64 != 4 * u64::from(width) * u64::from(height) {
        return Err(Error::invalid("its texels do not fit its size; copy it again"));
    }
    let mut hasher = DefaultHasher::new();
    (width, height, &texels).hash(&mut hasher);
    let path = folder.join(format!("{:016x}.png", hasher.finish()));
    if !path.exists() {
        std::fs::create_dir_all(folder).map_err(|source| Error::writing(folder, source))?;
        let (space, samples) = (ColorSpace::Srgb, Samples::U8(texels));
        Image { width, height, channels: 4, space, samples }.save(&path)?;
    }
    Ok(path)
}

fn toggle(switch: &mut bool) {
    *switch = !*switch;
}

mod channels;
mod exporting;
mod keys;
mod leaving;
mod opening;
mod painting;
mod pictures;
mod pointing;
