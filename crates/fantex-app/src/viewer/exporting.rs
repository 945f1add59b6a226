//! Exports and copies of the asset that is open.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};

use fantex::bake::Progress;
use fantex::base::{Error, ErrorKind, Result, counted};
use fantex::store::{Asset, Replacement};

use crate::document::{OpenProgress, Place};
use crate::export::{ExportSettings, Exported, export};
use crate::job::{Job, JobState};
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
    /// Until what was painted on it is in its file.
    Waiting(Task, Receiver<HandedOver>),
    Running(Task, Arc<OpenProgress>, Job<Result<Exported>>),
}

/// An asset whose file holds all that was painted on it, or why it does not.
pub type HandedOver = Result<Arc<Asset>, String>;

/// What is written.
#[derive(Clone, Debug)]
struct Task {
    from: PathBuf,
    to: PathBuf,
    what: What,
}

#[derive(Clone, Debug)]
enum What {
    Export(ExportSettings),
    Copy,
}

impl Exporting {
    /// Whether the user has still to choose.
    pub fn is_asked(&self) -> bool {
        matches!(self.work, Work::Asked)
    }

    /// What is being written.
    pub fn written_to(&self) -> Option<&Path> {
        match &self.work {
            Work::Asked => None,
            Work::Waiting(task, _) | Work::Running(task, ..) => Some(&task.to),
        }
    }

    /// How much is done, 0..1.
    pub fn share(&self) -> f32 {
        match &self.work {
            Work::Running(_, progress, _) => progress.counted(),
            _ => 0.0,
        }
    }
}

impl Viewer {
    pub(super) fn ask_export(&mut self) {
        if self.exportable().is_some() && !self.is_writing() {
            self.exporting.get_or_insert_default();
        }
    }

    pub(super) fn ask_copy(&mut self) {
        if let Some(from) = self.exportable() {
            self.request(Request::Dialog(FileDialog::SaveCopy(from)));
        }
    }

    /// The asset that can be exported or copied; of one at an address it is told why not.
    fn exportable(&mut self) -> Option<PathBuf> {
        let path = self.asset_path();
        if path.is_none() && self.document.as_ref().is_some_and(|document| document.asset().is_some()) {
            self.notices.warning("What lies at an address can only be looked at: download it first.");
        }
        path
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
        self.exporting = None;
        if let Some(from) = self.exportable() {
            self.request(Request::Dialog(FileDialog::Export(from, settings.clone())));
            self.exporting = Some(Exporting { settings, work: Work::Asked });
        }
    }

    /// Exports the asset that is open.
    pub fn export_to(&mut self, path: PathBuf, settings: ExportSettings) {
        if let Some(from) = self.exportable() {
            self.export_of(from, path, settings);
        }
    }

    /// Writes the asset that is open, as it is, to another file.
    pub fn copy_to(&mut self, path: PathBuf) {
        if let Some(from) = self.exportable() {
            self.copy_of(from, path);
        }
    }

    /// As [`export_to`](Self::export_to), of the asset that was open when it was asked where to.
    pub(super) fn export_of(&mut self, from: PathBuf, to: PathBuf, settings: ExportSettings) {
        self.write(Task { from, to, what: What::Export(settings) });
    }

    /// As [`copy_to`](Self::copy_to), of the asset that was open when it was asked where to.
    pub(super) fn copy_of(&mut self, from: PathBuf, to: PathBuf) {
        self.write(Task { from, to, what: What::Copy });
    }

    fn write(&mut self, task: Task) {
        if self.is_writing() {
            return;
        }
        self.exporting = None;
        if self.asset_path().as_ref() != Some(&task.from) {
            let [from, to] = [&task.from, &task.to].map(|path| path.display());
            return self.notices.warning(format!("{to} was not written: {from} is not open any more."));
        }
        match &mut self.painting {
            Some(painting) => {
                let handed = painting.hand_over();
                let settings = ExportSettings::default();
                self.exporting = Some(Exporting { settings, work: Work::Waiting(task, handed) });
                self.poll_export();
            }
            None => self.begin_writing(task, None),
        }
    }

    /// `asset`: what is written, where its painter has handed it over.
    fn begin_writing(&mut self, task: Task, asset: Option<Arc<Asset>>) {
        let progress = Arc::new(OpenProgress::default());
        let (Task { from, to, what }, for_thread) = (task.clone(), progress.clone());
        // Where nobody is asked, nobody can say so.
        let (told, asks) = (std::mem::take(&mut self.told_replaced), self.asks);
        let may_replace = move |path: &Path| !asks || told.iter().any(|told| told == path);
        let work = move || {
            let asset = asset.map_or_else(|| Asset::open(&from).map(Arc::new), Ok)?;
            match what {
                What::Export(settings) => export(&asset, &to, &settings, may_replace, &*for_thread),
                What::Copy => copy(&asset, &to, &*for_thread).map(|()| Exported::Written(vec![to])),
            }
        };
        match Job::spawn("export", self.waker(), work) {
            Ok(job) => {
                let settings = ExportSettings::default();
                self.exporting = Some(Exporting { settings, work: Work::Running(task, progress, job) });
            }
            Err(error) => self.notices.error(format!("cannot start a thread to write: {error}")),
        }
    }

    /// Gives up what is being written.
    pub fn cancel_export(&mut self) {
        if let Some(Exporting { work: Work::Running(_, progress, _), .. }) = self.exporting.take() {
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
        let Some(exporting) = self.exporting.take() else { return };
        match exporting.work {
            Work::Asked => self.exporting = Some(exporting),
            Work::Waiting(task, handed) => match handed.try_recv() {
                Ok(Ok(asset)) => self.begin_writing(task, Some(asset)),
                Ok(Err(reason)) => {
                    self.notices.error(format!("{} was not written. {reason}", task.to.display()));
                }
                Err(TryRecvError::Empty) => {
                    self.exporting = Some(Exporting { work: Work::Waiting(task, handed), ..exporting });
                }
                Err(TryRecvError::Disconnected) => {
                    let [from, to] = [&task.from, &task.to].map(|path| path.display());
                    self.notices
                        .error(format!("{to} was not written: what was painted on {from} was not saved."));
                }
            },
            Work::Running(task, progress, job) => match job.poll() {
                JobState::Running => {
                    self.exporting =
                        Some(Exporting { work: Work::Running(task, progress, job), ..exporting });
                }
                JobState::Done(result) => self.take_written(&task, result),
                JobState::Lost => {
                    self.notices.error("Nothing was written: the program failed on it.");
                }
            },
        }
    }

    fn take_written(&mut self, task: &Task, result: Result<Exported>) {
        match result {
            Ok(Exported::Replaces(files)) => {
                let to = task.to.display();
                self.notices.warning(format!(
                    "{to} was not written: {} there already. Export to this name again to replace what is there.",
                    listed(&files)
                ));
                self.told_replaced = files;
                if let What::Export(settings) = &task.what {
                    self.exporting = Some(Exporting { settings: settings.clone(), work: Work::Asked });
                }
            }
            Ok(Exported::Written(files)) => {
                if let (What::Copy, Some(painting)) = (&task.what, &self.painting)
                    && self.asset_path().as_ref() == Some(&task.from)
                {
                    painting.take_copied();
                }
                self.notices.info(said(&files));
            }
            Err(error) if error.is_cancelled() => {}
            Err(error) => self.notices.error(error.to_string()),
        }
    }
}

/// `a.png is`, `a.png and 2 files more are`.
fn listed(files: &[PathBuf]) -> String {
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match files {
        [] => "nothing is".into(),
        [one] => format!("{} is", name(one)),
        [first, others @ ..] => {
            format!("{} and {} are", name(first), counted(others.len(), "more file"))
        }
    }
}

fn said(files: &[PathBuf]) -> String {
    match files {
        [] => "Nothing was written.".into(),
        [one] => format!("Saved {}.", one.display()),
        [first, others @ ..] => {
            format!("Saved {} and {} beside it.", first.display(), counted(others.len(), "file"))
        }
    }
}

/// Copies an asset without gaps, which a painter may go on changing. As long as it is open for reading here, no space of the file that its
/// generation or a later one names is written again. The copy gets its name once all its checksums are right.
fn copy(asset: &Asset, to: &Path, progress: &dyn Progress) -> Result<()> {
    let from = asset.path();
    let is_same = || Some(std::fs::canonicalize(from).ok()? == std::fs::canonicalize(to).ok()?);
    if is_same() == Some(true) {
        return Err(Error::invalid(format!("{} is the asset itself: choose another name", to.display())));
    }
    let replacement = Replacement::begin(to, true)?;
    let copied = asset.copy_without_gaps(to, &mut |done, total| {
        if progress.is_cancelled() {
            return Err(Error::cancelled("copying was cancelled"));
        }
        progress.report(done, 2 * total);
        Ok(())
    });
    let checked = copied.and_then(|copied| check_copy(copied.path(), progress).map(|()| copied));
    let copied = checked.map_err(|error| {
        if !matches!(error.kind(), ErrorKind::Damaged | ErrorKind::Malformed) {
            return error;
        }
        let [from, to] = [from, to].map(Path::display);
        let sentence = format!("{to} was not written: what was read of {from} does not match its checksums");
        Error::damaged(sentence).with_source(error)
    })?;
    replacement.finish(copied.into_temp_path())
}

/// Checks all texels and attachments of an asset against their checksums.
fn check_copy(path: &Path, progress: &dyn Progress) -> Result<()> {
    let asset = Asset::open(path)?;
    let clusters: Vec<_> = asset.clusters().collect();
    let total = clusters.len() as u64;
    for (done, &cluster) in (0u64..).zip(&clusters) {
        if progress.is_cancelled() {
            return Err(Error::cancelled("copying was cancelled"));
        }
        progress.report(total + done, 2 * total);
        let range = asset.cluster_range(cluster);
        let mut stored = vec![0; (range.end - range.start) as usize];
        let read = asset.source().read_exact_at(&mut stored, range.start);
        read.map_err(|source| asset.read_error(&range, Arc::new(source)))?;
        asset.unpack_cluster(cluster, &stored)?;
    }
    asset.attachment_names()?.into_iter().try_for_each(|name| asset.attachment(name).map(drop))
}
