//! Series of files, and what is left of one that was interrupted.

use std::path::{Path, PathBuf};

use fantex::Result;

use crate::context::{Context, Deferral};
use crate::text::{counted, grouped};

/// Files that a command writes one after the other into a folder. If it is interrupted, or one cannot be written, its last line counts those
/// that stay.
pub(crate) struct Series<'a> {
    context: &'a Context,
    folder: PathBuf,
    /// What a file is, in the singular.
    noun: &'static str,
    /// Of all files; `None` where it is not known before.
    count: Option<u64>,
    /// Files that stay.
    written: u64,
    /// Files that are removed unless the series is finished.
    unfinished: Option<Vec<PathBuf>>,
    /// Files can be removed only if Ctrl-C does not end the program at once.
    _deferral: Option<Deferral<'a>>,
}

impl<'a> Series<'a> {
    /// Files that are useful one by one: those of an unfinished series stay.
    pub(crate) fn of_files(
        context: &'a Context,
        folder: &Path,
        noun: &'static str,
        count: Option<u64>,
    ) -> Self {
        let folder = folder.to_owned();
        Self { context, folder, noun, count, written: 0, unfinished: None, _deferral: None }
    }

    /// Files that could be mistaken for the whole series: of an unfinished one those are removed that were not there before.
    pub(crate) fn all_or_none(context: &'a Context, folder: &Path, noun: &'static str, count: u64) -> Self {
        let mut series = Self::of_files(context, folder, noun, Some(count));
        series.unfinished = Some(Vec::new());
        series._deferral = Some(context.defer_interrupt());
        series
    }

    /// Writes a file by a function.
    pub(crate) fn write(&mut self, path: &Path, write: impl FnOnce() -> Result<()>) -> Result<()> {
        let context = self.context;
        let _deferral = context.defer_interrupt();
        let is_new = path.symlink_metadata().is_err();
        write().map_err(|error| match self.written {
            0 => error,
            _ => error.leaving(format!("finished before that: {}", self.remains())),
        })?;
        match &mut self.unfinished {
            Some(unfinished) if is_new => unfinished.push(path.to_owned()),
            _ => {
                self.written += 1;
                context.set_remains(self.remains());
            }
        }
        Ok(())
    }

    /// What an interruption or a failure leaves: `12 of 100 pictures in turn`.
    fn remains(&self) -> String {
        let files = match self.count {
            Some(count) => format!("{} of {}", grouped(self.written), counted(count, self.noun)),
            None => counted(self.written, self.noun),
        };
        format!("{files} in {}", self.folder.display())
    }

    /// All files are written.
    pub(crate) fn finish(mut self) {
        self.unfinished = None;
    }
}

impl Drop for Series<'_> {
    fn drop(&mut self) {
        for path in self.unfinished.take().into_iter().flatten() {
            std::fs::remove_file(path).unwrap_or_default();
        }
    }
}
