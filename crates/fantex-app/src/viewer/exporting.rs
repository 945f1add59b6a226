//! Exports and copies of the asset that is open.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::bake::Progress;
use fantex::base::files::temporary_file;
use fantex::base::{Error, Result};
use fantex::store::{Asset, Replacement};

use crate::document::{OpenProgress, Place};
use crate::export::{ExportSettings, export};
use crate::job::{Job, JobState};
use crate::paint::PaintCommand;
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
    /// Until what was painted on it is in the file.
    Waiting {
        from: PathBuf,
        to: PathBuf,
        what: What,
    },
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
        self.begin_export(path, What::Export, settings);
    }

    /// Writes the asset as it is to another file.
    pub fn copy_to(&mut self, path: PathBuf) {
        if self.is_writing() {
            return;
        }
        self.begin_export(path, What::Copy, ExportSettings::default());
    }

    fn begin_export(&mut self, to: PathBuf, what: What, settings: ExportSettings) {
        self.exporting = None;
        let Some(from) = self.can_export().then(|| self.asset_path()).flatten() else { return };
        self.paint_command(&PaintCommand::Save);
        self.exporting = Some(Exporting { settings, work: Work::Waiting { from, to, what } });
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
            Work::Waiting { from, to, .. } if self.asset_path().as_ref() != Some(from) => {
                let [from, to] = [from, to].map(|path| path.display());
                self.notices.warning(format!(
                    "{to} was not written: {from} was left before all that was painted on it was saved."
                ));
                self.exporting = None;
            }
            Work::Waiting { from, to, what } => {
                if self.painting.as_ref().is_some_and(|painting| !painting.is_saved()) {
                    return;
                }
                let (from, to, what) = (from.clone(), to.clone(), *what);
                let settings = exporting.settings.clone();
                self.exporting = None;
                let progress = Arc::new(OpenProgress::default());
                let for_thread = progress.clone();
                let work = move || match what {
                    What::Export => export(&from, &to, &settings, &*for_thread),
                    What::Copy => copy(&from, &to, &*for_thread).map(|()| vec![to]),
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

/// Bytes that are copied between two looks at whether the copy is still wanted.
const COPIED_AT_ONCE: usize = 1 << 20;

/// Copies an asset, which a painter may go on changing. As long as it is open for reading here, no space of the file that its generation or
/// a later one names is written again. The copy gets its name once all its checksums are right.
fn copy(from: &Path, to: &Path, progress: &dyn Progress) -> Result<()> {
    let is_same = || Some(std::fs::canonicalize(from).ok()? == std::fs::canonicalize(to).ok()?);
    if is_same() == Some(true) {
        return Err(Error::invalid(format!("{} is the asset itself: choose another name", to.display())));
    }
    let replacement = Replacement::begin(to, true)?;
    let asset = Asset::open(from)?;
    let failed = |source| Error::writing(to, source);
    let mut copied = temporary_file(to, "").map_err(failed)?;
    let length = asset.file_bytes();
    let mut buffer = vec![0; COPIED_AT_ONCE];
    let mut at = 0;
    loop {
        if progress.is_cancelled() {
            return Err(Error::cancelled("copying was cancelled"));
        }
        progress.report(at, 2 * length.max(at));
        let count = asset.source().read_at(&mut buffer, at).map_err(|source| Error::reading(from, source))?;
        if count == 0 {
            break;
        }
        copied.write_all(&buffer[..count]).map_err(failed)?;
        at += count as u64;
    }
    check_copy(copied.path(), progress).map_err(|error| {
        if error.is_cancelled() {
            return error;
        }
        let [from, to] = [from, to].map(Path::display);
        let sentence = format!("{to} was not written: what was read of {from} does not match its checksums");
        Error::damaged(sentence).with_source(error)
    })?;
    drop(asset);
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
