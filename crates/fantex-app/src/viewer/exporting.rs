//! Exports and copies of the asset that is open.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::base::{Error, Result};

use crate::document::{OpenProgress, Place};
use crate::export::{ExportSettings, export};
use crate::job::{Job, JobState};
use crate::paint::{PaintCommand, SaveState};
use crate::viewer::{FileDialog, Request, Viewer};

/// What is to be exported, until it is written.
#[derive(Debug, Default)]
pub struct Exporting {
    pub settings: ExportSettings,
    work: Work,
}

#[derive(Debug, Default)]
enum Work {
    /// The user is choosing.
    #[default]
    Asked,
    /// Until what was painted is in the file.
    Waiting(PathBuf, What),
    Running(Arc<OpenProgress>, Job<Result<Vec<PathBuf>>>),
}

#[derive(Clone, Copy, Debug)]
enum What {
    Export,
    Copy,
}

impl Exporting {
    /// Whether the user has still to choose.
    pub fn is_asked(&self) -> bool {
        matches!(self.work, Work::Asked)
    }

    /// How much is done, 0..1.
    pub fn share(&self) -> f32 {
        match &self.work {
            Work::Running(progress, _) => progress.counted(),
            _ => 0.0,
        }
    }
}

impl Viewer {
    pub(super) fn ask_export(&mut self) {
        if self.can_export() && !self.is_writing() {
            self.exporting.get_or_insert_default();
        }
    }

    /// Whether there is an asset that can be exported or copied; of one at an address it is told why not.
    pub(super) fn can_export(&mut self) -> bool {
        let is_there = self.asset_path().is_some();
        if !is_there && self.document.as_ref().is_some_and(|document| document.asset().is_some()) {
            self.notices.warning("What lies at an address can only be looked at: download it first.");
        }
        is_there
    }

    /// Whether something is being written, which is told: one thing at a time is.
    fn is_writing(&mut self) -> bool {
        let is_writing = self.exporting.as_ref().is_some_and(|exporting| !exporting.is_asked());
        if is_writing {
            self.notices.warning("Something else is being written: wait for it, or cancel it.");
        }
        is_writing
    }

    /// Asks where to.
    pub fn choose_export(&mut self, settings: ExportSettings) {
        if self.is_writing() {
            return;
        }
        self.request(Request::Dialog(FileDialog::Export(settings.preset)));
        self.exporting = Some(Exporting { settings, work: Work::Asked });
    }

    /// Writes what was chosen.
    pub fn export_to(&mut self, path: PathBuf) {
        if self.is_writing() {
            return;
        }
        let settings = self.exporting.take().unwrap_or_default().settings;
        self.begin_export(Exporting { settings, work: Work::Waiting(path, What::Export) });
    }

    /// Writes the asset as it is to another file.
    pub fn copy_to(&mut self, path: PathBuf) {
        if self.is_writing() {
            return;
        }
        self.begin_export(Exporting { work: Work::Waiting(path, What::Copy), ..Exporting::default() });
    }

    fn begin_export(&mut self, exporting: Exporting) {
        if !self.can_export() {
            self.exporting = None;
            return;
        }
        self.paint_command(&PaintCommand::Save);
        self.exporting = Some(exporting);
        self.poll_export();
    }

    pub(super) fn cancel_export(&mut self) {
        if let Some(Exporting { work: Work::Running(progress, _), .. }) = self.exporting.take() {
            progress.cancel();
        }
    }

    /// The asset's file; none of addresses.
    pub fn asset_path(&self) -> Option<PathBuf> {
        let document = self.document.as_ref().filter(|document| document.asset().is_some())?;
        match &document.place {
            Place::File(path) => Some(path.clone()),
            Place::Url(_) => None,
        }
    }

    pub(super) fn poll_export(&mut self) {
        let Some(exporting) = &self.exporting else { return };
        match &exporting.work {
            Work::Asked => {}
            Work::Waiting(to, what) => {
                let is_saved = |painting: &crate::paint::Painting| {
                    !painting.is_busy() && painting.save == SaveState::Saved
                };
                if self.painting.as_ref().is_some_and(|painting| !is_saved(painting)) {
                    return;
                }
                let (to, what, settings) = (to.clone(), *what, exporting.settings.clone());
                self.exporting = None;
                let Some(from) = self.asset_path() else { return };
                let progress = Arc::new(OpenProgress::default());
                let for_thread = progress.clone();
                let work = move || match what {
                    What::Export => export(&from, &to, &settings, &*for_thread),
                    What::Copy => copy(&from, &to).map(|()| vec![to]),
                };
                match Job::spawn("export", self.waker(), work) {
                    Ok(job) => {
                        let settings = ExportSettings::default();
                        self.exporting = Some(Exporting { settings, work: Work::Running(progress, job) });
                    }
                    Err(error) => self.notices.error(format!("cannot start a thread to write: {error}")),
                }
            }
            Work::Running(_, job) => {
                let result = match job.poll() {
                    JobState::Running => return,
                    JobState::Done(result) => result,
                    JobState::Lost => {
                        Err(Error::unavailable("nothing was exported: the program failed on it"))
                    }
                };
                self.exporting = None;
                match result {
                    Ok(files) => self.notices.info(said(&files)),
                    Err(error) if error.is_cancelled() => {}
                    Err(error) => self.notices.error(error.to_string()),
                }
            }
        }
    }
}

fn said(files: &[PathBuf]) -> String {
    match files {
        [] => "Nothing was written.".into(),
        [one] => format!("Saved {}.", one.display()),
        [first, others @ ..] => format!("Saved {} and {} files beside it.", first.display(), others.len()),
    }
}

/// Nothing writes to the file meanwhile but the painter, who leaves what is committed as it is for a while: what is copied is checked
/// by its being opened.
fn copy(from: &Path, to: &Path) -> Result<()> {
    let is_same = || Some(std::fs::canonicalize(from).ok()? == std::fs::canonicalize(to).ok()?);
    if is_same() == Some(true) {
        return Err(Error::invalid(format!("{} is the asset itself: choose another name", to.display())));
    }
    let written = fantex::base::files::write_whole(to, true, |out| {
        let mut file = std::fs::File::open(from)?;
        std::io::copy(&mut file, out).map(drop)
    });
    written?;
    fantex::store::Asset::open(to).map(drop)
}
