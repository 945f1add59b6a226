//! What outlives a window and its GPU: where a device is lost, the next window goes on with it.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use eframe::egui;

use super::Arguments;
use super::dialogs::Dialogs;
use super::driver::Driver;
use super::pictures::PictureFiles;
use crate::session::{Session, SessionRunner};
use crate::settings::{Settings, SettingsError};
use crate::viewer::{Viewer, Wake};

/// A device that is lost more often than [`MOST_LOSSES`] in this time is given up.
const LOSSES_WITHIN: Duration = Duration::from_secs(60);

/// See [`LOSSES_WITHIN`].
const MOST_LOSSES: usize = 3;

/// What the program begins with.
pub(super) struct Start {
    pub(super) arguments: Arguments,
    pub(super) settings: Settings,
    pub(super) settings_file: Option<PathBuf>,
    pub(super) problem: Option<SettingsError>,
    pub(super) session: Option<Session>,
}

/// What outlives a window and its GPU.
pub(super) struct Workspace {
    pub(super) viewer: Viewer,
    pub(super) dialogs: Dialogs,
    pub(super) pictures: PictureFiles,
    pub(super) driver: Option<Driver>,
    /// Why the program ends, where it has failed.
    pub(super) failure: Option<String>,
    pub(super) settings_file: Option<PathBuf>,
    /// To be opened with the first window.
    pub(super) to_open: Option<String>,
    /// Why the last window's device is lost, if it is.
    pub(super) lost: Option<String>,
    /// When devices were lost.
    losses: Vec<Instant>,
    pub(super) open_window: OpenWindow,
    started: Instant,
}

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
            viewer.notices.warning(problem.to_string(), 0.0);
        }
        viewer.paints = start.arguments.paint;
        viewer.paint_memory_bytes = start.arguments.memory.unwrap_or(viewer.paint_memory_bytes);
        viewer.brushes_file = start.settings_file.as_ref().map(|file| file.with_file_name("brushes.json"));
        Self {
            viewer,
            dialogs: Dialogs::new(wake.clone()),
            pictures: PictureFiles::new(wake),
            driver: start.session.map(|session| Driver::new(SessionRunner::new(session))),
            failure: None,
            settings_file: start.settings_file,
            to_open: start.arguments.file,
            lost: None,
            losses: Vec::new(),
            open_window,
            started: Instant::now(),
        }
    }

    /// Seconds since the start. Not those of egui, whose time stands still while the window is hidden.
    pub(super) fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// The device is lost: the window ends, for another one to take its place.
    pub(super) fn lose(&mut self, reason: &str) {
        self.lost = Some(reason.to_owned());
        self.losses.push(Instant::now());
        self.pictures.forget_windows();
    }

    /// Whether another window is to go on, since the last one has lost its device and that does not happen all the time.
    pub(super) fn takes_another_window(&mut self) -> bool {
        self.losses.retain(|when| when.elapsed() < LOSSES_WITHIN);
        self.lost.is_some() && self.losses.len() <= MOST_LOSSES
    }

    /// Ends the session where it was, with nothing of the user's lost: waits for the last commit, and keeps the settings.
    pub(super) fn finish(&mut self) {
        self.viewer.painting = None;
        if let Some(file) = &self.settings_file
            && let Err(error) = self.viewer.settings.save(file)
        {
            eprintln!("fantex-app: {error}");
        }
    }
}
