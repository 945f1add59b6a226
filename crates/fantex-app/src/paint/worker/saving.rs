//! When what was painted is committed, and what becomes of it where that fails.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fantex::base::{Error, ErrorKind};
use fantex::store::is_disk_full;
use fantex::stream::{AtlasFormat, ClusterLoader, ClusterLoaderOptions};

use super::Worker;
use crate::paint::messages::{Report, SaveState};
use crate::viewer::HandedOver;

/// Between strokes, changes are committed after this delay.
const IDLE_COMMIT_DELAY: Duration = Duration::from_millis(700);

/// During strokes and long jobs, changes are committed after this delay, but not before ten times what the last commit took: each keeps the
/// whole stroke so far.
const MAX_COMMIT_DELAY: Duration = Duration::from_millis(1700);

/// Delay after a failed commit.
const RETRY_DELAY: Duration = Duration::from_secs(3);

/// After this many commits the loader is given a newer state of the file, so that the older one can be reclaimed.
const MAX_COMMITS_PER_LOADER: u32 = 20;

/// When to commit.
#[derive(Debug, Default)]
pub(super) struct Saving {
    /// When the oldest change was made that is not in the file.
    pub(super) changed: Option<Instant>,
    /// When a commit failed.
    pub(super) failed: Option<Instant>,
    /// Commits since the file was last opened for loading.
    commits: u32,
    /// How long the last one took.
    took: Duration,
}

impl Saving {
    /// When to commit, if nothing else happens.
    fn due(&self, is_drawing: bool) -> Option<Instant> {
        let changed = self.changed?;
        let due = changed + if is_drawing { MAX_COMMIT_DELAY.max(10 * self.took) } else { IDLE_COMMIT_DELAY };
        Some(self.failed.map_or(due, |failed| due.max(failed + RETRY_DELAY)))
    }
}

impl Worker {
    /// When to commit next, if nothing else happens.
    pub(super) fn save_due(&self) -> Option<Instant> {
        let may_save = !self.is_placing && self.painter.editor().has_changes();
        let due = self.saving.due(self.is_drawing()).filter(|_| may_save)?;
        // A commit would make all levels that are due at once.
        Some(if self.has_levels_due { due + MAX_COMMIT_DELAY } else { due })
    }

    pub(super) fn note_changes(&mut self) {
        // What may be taken away again is not to be saved.
        if self.is_placing {
            return;
        }
        if self.painter.editor().has_changes() || self.is_astray {
            if self.saving.changed.is_none() {
                self.saving.changed = Some(Instant::now());
                if self.saving.failed.is_none() {
                    self.tell(Report::Save(SaveState::Changed));
                }
            }
        } else if self.saving.changed.take().is_some() {
            self.saving.failed = None;
            self.tell(Report::Save(SaveState::Saved));
        }
    }

    pub(super) fn save(&mut self) {
        // Where it fails, that is told.
        self.try_save().unwrap_or_default();
    }

    /// # Errors
    /// What the user can do about it.
    fn try_save(&mut self) -> Result<(), String> {
        if !self.painter.editor().has_changes() {
            return Ok(());
        }
        if self.saving.failed.is_none() {
            self.tell(Report::Save(SaveState::Saving));
            (self.wake)();
        }
        let begun = Instant::now();
        match self.painter.commit() {
            Ok(_) => {
                let (commits, took) = (self.saving.commits + 1, begun.elapsed());
                self.saving = Saving { commits, took, ..Saving::default() };
                if self.saving.commits >= MAX_COMMITS_PER_LOADER && self.stroke.is_none() {
                    self.offer_newer();
                }
                self.is_astray = false;
                self.tell(Report::Save(SaveState::Saved));
                Ok(())
            }
            Err(error) => {
                self.saving.failed = Some(Instant::now());
                let problem = save_problem(&error, self.painter.editor().asset().path());
                self.tell(Report::Save(SaveState::Failed(problem.clone())));
                Err(problem)
            }
        }
    }

    /// The asset, with all that was painted in the file that is open. Where that has no name any more, it is not saved for all that.
    pub(super) fn hand_over(&mut self) -> HandedOver {
        if let Err(problem) = self.try_save() {
            if self.painter.editor().is_in_place() {
                return Err(problem);
            }
            self.painter.commit_detached().map_err(|error| error.to_string())?;
            self.is_astray = true;
        }
        Ok(self.painter.editor().asset().clone())
    }

    /// Lets pages be loaded from what is committed, so that the space of older states can be used again.
    fn offer_newer(&mut self) {
        let Some(formats) = self.exchange.formats() else { return };
        let asset = self.painter.editor().asset().clone();
        let stored = asset.channels().iter().map(|channel| AtlasFormat::of(channel.format, true));
        let block_compressed = stored.zip(&*formats).all(|(stored, &format)| stored == format);
        let options = ClusterLoaderOptions { block_compressed, ..ClusterLoaderOptions::default() };
        match ClusterLoader::open(asset.clone(), &options) {
            // For another device that has taken over meanwhile there is another one later.
            Ok(_) if self.exchange.formats().as_ref() != Some(&formats) => {}
            Ok(loader) => {
                self.saving.commits = 0;
                // What is seen alone looks different from any file.
                let differing = if self.seen_alone.is_some() { self.all_pages() } else { Vec::new() };
                self.exchange.offer(Box::new(loader), asset.clone(), &differing);
                self.tell(Report::Newer(asset));
            }
            Err(error) => self.tell(Report::Failed(error.to_string())),
        }
    }
}

/// What the user can do about it.
fn save_problem(error: &Error, path: &Path) -> String {
    if error.kind() == ErrorKind::Conflict {
        return format!("Not saved: {error}; save a copy to keep what you paint.");
    }
    if !is_disk_full(error) {
        return format!("Not saved: {error}");
    }
    let name = PathBuf::from(path.file_name().unwrap_or_default());
    format!(
        "The disk is full: what you paint stays in memory. Make room, and {} is saved by itself.",
        name.display()
    )
}
