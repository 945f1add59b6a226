//! What outlives a window and its GPU: where a device is lost, the next window goes on with it.

use std::path::PathBuf;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use eframe::egui;
use eframe::egui::{ColorImage, Context, ScreenshotCallback, ViewportCommand};
use fantex::base::files::remove_temporaries;
use fantex::base::{Error, ErrorKind, ReadLimits, ReadOptions, Result};
use fantex::signals::on_end_request;
use fantex::texture::{ColorSpace, Image, Samples};
use rfd::AsyncFileDialog;

use crate::document::Place;
use crate::export::Preset;
use crate::job::{Job, JobState};
use crate::scene_view::lost_picture;
use crate::session::{Session, SessionRunner};
use crate::settings::Settings;
use crate::shell::Arguments;
use crate::shell::driver::Driver;
use crate::viewer::{FileDialog, PICTURES, Viewer, Wake};

/// A device that is lost more often than [`MAX_LOSSES`] in this time is given up.
const LOSSES_WITHIN: Duration = Duration::from_secs(60);

/// See [`LOSSES_WITHIN`].
const MAX_LOSSES: usize = 3;

pub(super) struct Start {
    pub(super) arguments: Arguments,
    pub(super) settings: Settings,
    pub(super) settings_file: Option<PathBuf>,
    pub(super) problem: Option<Error>,
    pub(super) session: Option<Session>,
}

/// What outlives a window and its GPU.
pub(super) struct Workspace {
    pub(super) viewer: Viewer,
    pub(super) dialogs: Dialogs,
    pub(super) pictures: PictureFiles,
    pub(super) driver: Option<Driver>,
    /// Whether nobody looks at the window while the session runs.
    pub(super) is_unwatched: bool,
    /// Why the program ends, where it has failed.
    pub(super) failure: Option<String>,
    /// The program ends, whatever the user is still to be told.
    pub(super) is_ending: bool,
    pub(super) settings_file: Option<PathBuf>,
    /// To be opened with the first window.
    pub(super) to_open: Option<Place>,
    /// Why the last window's device is lost, if it is.
    pub(super) lost: Option<String>,
    /// When devices were lost.
    losses: Vec<Instant>,
    pub(super) open_window: OpenWindow,
    end_requests: EndRequests,
    /// Those that were followed.
    ended: u32,
    started: Instant,
}

/// How often the program was asked to end from outside, by Ctrl-C or by the system.
#[derive(Clone, Debug, Default)]
struct EndRequests(Arc<AtomicU32>);

/// Who asks so often is obeyed at once: the window does not answer.
const MAX_END_REQUESTS: u32 = 3;

impl EndRequests {
    fn listen(&self, window: OpenWindow) {
        let requests = self.0.clone();
        let act = move || {
            if requests.fetch_add(1, Relaxed) + 1 >= MAX_END_REQUESTS {
                remove_temporaries();
                std::process::exit(EXIT_INTERRUPTED);
            }
            window.wake();
        };
        // Where nobody can listen, they end the program.
        on_end_request(act).unwrap_or_default();
    }
}

/// The exit code of a program that was interrupted: 128 + SIGINT.
const EXIT_INTERRUPTED: i32 = 130;

/// The window that is woken: the one that is open.
#[derive(Clone, Debug, Default)]
pub(super) struct OpenWindow(Arc<Mutex<Option<egui::Context>>>);

impl OpenWindow {
    /// From now on this one.
    pub(super) fn set(&self, context: &egui::Context) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(context.clone());
    }

    fn wake(&self) {
        // Not called under the lock: it may draw.
        let context = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(context) = context {
            context.request_repaint();
        }
    }
}

impl Workspace {
    pub(super) fn new(start: Start) -> Self {
        let open_window = OpenWindow::default();
        let for_wake = open_window.clone();
        let wake: Wake = Arc::new(move || for_wake.wake());
        let mut viewer = Viewer::new(start.settings, None, wake.clone());
        viewer.picture_folder = start.arguments.picture_folder();
        if let Some(problem) = start.problem {
            viewer.notices.warning(problem.to_string());
        }
        viewer.paints = start.arguments.paint;
        viewer.look_model.clone_from(&start.arguments.on);
        viewer.asks = start.session.is_none();
        let allow_outside = start.arguments.allow_outside;
        ReadLimits::new(ReadOptions { allow_outside, ..ReadOptions::default() }).make_default();
        viewer.paint_memory_bytes = start.arguments.memory.unwrap_or(viewer.paint_memory_bytes);
        // Without an X display there is nothing to listen to.
        #[cfg(target_os = "linux")]
        crate::pen::x11::listen(None, viewer.pen.clone()).ok();
        viewer.brushes_file = start.settings_file.as_ref().map(|file| file.with_file_name("brushes.json"));
        let end_requests = EndRequests::default();
        end_requests.listen(open_window.clone());
        Self {
            viewer,
            dialogs: Dialogs::new(wake.clone()),
            pictures: PictureFiles::new(wake),
            is_unwatched: start.session.as_ref().is_some_and(|session| session.is_unwatched),
            driver: start.session.map(|session| Driver::new(SessionRunner::new(session))),
            failure: None,
            is_ending: false,
            settings_file: start.settings_file,
            to_open: start.arguments.file.map(Place::parse),
            lost: None,
            losses: Vec::new(),
            open_window,
            end_requests,
            ended: 0,
            started: Instant::now(),
        }
    }

    /// Begins a frame at a time, in seconds since the start. Not those of egui, whose time stands still while the window is hidden.
    pub(super) fn tick(&mut self) -> f64 {
        self.viewer.notices.now = self.started.elapsed().as_secs_f64();
        self.viewer.notices.now
    }

    /// Whether the program is asked to end from outside, once for each request.
    pub(super) fn is_asked_to_end(&mut self) -> bool {
        let asked = self.end_requests.0.load(Relaxed);
        std::mem::replace(&mut self.ended, asked) < asked
    }

    /// The device is lost: the window ends, for another one to take its place.
    pub(super) fn lose(&mut self, reason: &str) {
        self.lost = Some(reason.to_owned());
        self.losses.push(Instant::now());
        self.pictures.forget_windows();
        self.viewer.forget_pictures();
    }

    /// Whether another window is to go on, since the last one has lost its device and that does not happen all the time.
    pub(super) fn takes_another_window(&mut self) -> bool {
        self.losses.retain(|when| when.elapsed() < LOSSES_WITHIN);
        self.lost.is_some() && self.losses.len() <= MAX_LOSSES
    }

    /// Ends the session where it was, with nothing of the user's lost: waits for the last commit and for pictures, and keeps the settings.
    pub(super) fn finish(&mut self) {
        self.viewer.cancel_export();
        self.viewer.painting = None;
        for error in self.pictures.finish() {
            eprintln!("fantex-app: {error}");
        }
        if let Some(file) = &self.settings_file
            && let Err(error) = self.viewer.settings.save(file)
        {
            eprintln!("fantex-app: {error}");
        }
        // Of what is given up with the program.
        remove_temporaries();
    }
}

/// A dialog that is gone sooner was never shown.
const MIN_SHOWN: Duration = Duration::from_millis(250);

/// What came of a dialog.
pub(super) enum Answer {
    Chosen(PathBuf),
    Cancelled,
    /// This system shows no dialogs.
    NotShown,
}

pub(super) struct Dialogs {
    open: Vec<(FileDialog, Job<Answer>)>,
    wake: Wake,
}

const MODELS: &[&str] = &["glb", "gltf", "obj", "ply", "stl", "fan", "fanworld", "toml"];

impl Dialogs {
    pub(super) fn new(wake: Wake) -> Self {
        Self { open: Vec::new(), wake }
    }

    /// Shows a dialog; one of a kind at a time. `stem` is the start of suggested names.
    pub(super) fn ask(&mut self, dialog: FileDialog, stem: &str) {
        if self.open.iter().any(|(open, _)| *open == dialog) {
            return;
        }
        let (title, filter, extensions) = match &dialog {
            FileDialog::Open => ("Open a model or an asset", "Models and assets", MODELS),
            FileDialog::Surroundings => ("Choose surroundings", "Pictures", PICTURES),
            FileDialog::Sticker => ("Choose a picture", "Pictures", PICTURES),
            FileDialog::Stencil => ("Choose a picture over the view", "Pictures", PICTURES),
            FileDialog::Look => ("Choose a look", "Looks", &["toml"][..]),
            FileDialog::Stamp => ("Choose a stamp", "Pictures", PICTURES),
            FileDialog::LoadPath => ("Load a camera path", "Camera paths", &["json"][..]),
            FileDialog::SavePath => ("Save the camera path", "Camera paths", &["json"][..]),
            FileDialog::Export(_, settings) if settings.preset == Preset::Blender => {
                ("Export the asset", "glTF", &["gltf"][..])
            }
            FileDialog::Export(..) => ("Export the asset", "glTF", &["glb"][..]),
            FileDialog::SaveCopy(_) => ("Save a copy", "Assets", &["fan"][..]),
        };
        let window = AsyncFileDialog::new().set_title(title).add_filter(filter, extensions);
        let name = match &dialog {
            FileDialog::SavePath => Some(format!("{stem}-path.json")),
            FileDialog::Export(_, settings) => Some(format!("{stem}-export.{}", settings.preset.extension())),
            FileDialog::SaveCopy(_) => Some(format!("{stem}-copy.fan")),
            _ => None,
        };
        let work = move || {
            let begun = Instant::now();
            let handle = match name {
                Some(name) => pollster::block_on(window.set_file_name(name).save_file()),
                None => pollster::block_on(window.pick_file()),
            };
            match handle {
                Some(handle) => Answer::Chosen(handle.path().to_owned()),
                None if begun.elapsed() < MIN_SHOWN => Answer::NotShown,
                None => Answer::Cancelled,
            }
        };
        let wake = self.wake.clone();
        if let Ok(job) = Job::spawn("dialog", move || wake(), work) {
            self.open.push((dialog, job));
        }
    }

    /// What was answered since the last call.
    pub(super) fn poll(&mut self) -> Vec<(FileDialog, Answer)> {
        let mut answers = Vec::new();
        self.open.retain(|(dialog, job)| {
            let answer = match job.poll() {
                JobState::Running => return true,
                JobState::Done(answer) => answer,
                JobState::Lost => Answer::NotShown,
            };
            answers.push((dialog.clone(), answer));
            false
        });
        answers
    }
}

/// What became of writing a picture.
type Written = Result<()>;

/// Writes pictures in the background.
pub(super) struct PictureFiles {
    jobs: Vec<(PathBuf, Job<Written>)>,
    windows: Receiver<(PathBuf, Image)>,
    window_sender: Sender<(PathBuf, Image)>,
    windows_due: usize,
    done: Vec<(PathBuf, Written)>,
    wake: Wake,
}

impl PictureFiles {
    pub(super) fn new(wake: Wake) -> Self {
        let (window_sender, windows) = channel();
        Self { jobs: Vec::new(), windows, window_sender, windows_due: 0, done: Vec::new(), wake }
    }

    /// Takes a picture of the whole window with the next frame.
    pub(super) fn take_window(&mut self, ctx: &Context, path: PathBuf) {
        let (sender, wake) = (self.window_sender.clone(), self.wake.clone());
        self.windows_due += 1;
        let callback = ScreenshotCallback::new(move |picture| {
            // The window may be closing: then nobody waits for it.
            sender.send((path, image_of(&picture))).ok();
            wake();
        });
        ctx.send_viewport_cmd(ViewportCommand::Screenshot(callback));
    }

    /// The window is gone: nobody will take pictures of it that are not taken yet.
    pub(super) fn forget_windows(&mut self) {
        (self.window_sender, self.windows) = channel();
        self.windows_due = 0;
    }

    /// Writes a picture.
    pub(super) fn save(&mut self, path: PathBuf, image: Result<Image>) {
        let (to, wake) = (path.clone(), self.wake.clone());
        let work = move || {
            if let Some(folder) = to.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                // Where this fails the picture's own error says more.
                std::fs::create_dir_all(folder).ok();
            }
            let saved = image?.save(&to);
            saved.map_err(|error| Error::new(ErrorKind::Io, error.to_string()).with_path(&to))
        };
        match Job::spawn("picture", move || wake(), work) {
            Ok(job) => self.jobs.push((path, job)),
            Err(_) => self.done.push((path.clone(), Err(lost_picture(&path)))),
        }
    }

    /// There is no such picture.
    pub(super) fn refuse(&mut self, path: PathBuf, error: Error) {
        self.done.push((path, Err(error)));
    }

    /// What has been written since the last call, or why not.
    pub(super) fn poll(&mut self) -> Vec<(PathBuf, Written)> {
        let arrived: Vec<_> = self.windows.try_iter().collect();
        for (path, image) in arrived {
            self.windows_due -= 1;
            self.save(path, Ok(image));
        }
        let done = &mut self.done;
        self.jobs.retain(|(path, job)| {
            let written = match job.poll() {
                JobState::Running => return true,
                JobState::Done(written) => written,
                JobState::Lost => Err(lost_picture(path)),
            };
            done.push((path.clone(), written));
            false
        });
        std::mem::take(done)
    }

    /// Waits for what is being written; returns what went wrong.
    fn finish(&mut self) -> Vec<Error> {
        let arrived: Vec<_> = self.windows.try_iter().collect();
        arrived.into_iter().for_each(|(path, image)| self.save(path, Ok(image)));
        let jobs = self.jobs.drain(..);
        let written = jobs.map(|(path, job)| job.wait().unwrap_or_else(|| Err(lost_picture(&path))));
        let done = self.done.drain(..).map(|(_, written)| written);
        done.chain(written).filter_map(Result::err).collect()
    }

    /// Whether a picture of the window is to be taken with the next frame.
    pub(super) fn is_window_due(&self) -> bool {
        self.windows_due > 0
    }

    /// Pictures that are not in their files yet.
    pub(super) fn due(&self) -> usize {
        self.jobs.len() + self.windows_due + self.done.len()
    }
}

/// The window's picture, without alpha.
fn image_of(picture: &ColorImage) -> Image {
    let [width, height] = picture.size.map(|n| n as u32);
    let samples = Samples::U8(picture.pixels.iter().flat_map(|c| [c.r(), c.g(), c.b()]).collect());
    Image { width, height, channels: 3, space: ColorSpace::Srgb, samples }
}
