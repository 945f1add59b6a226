//! Progress of a long operation, and the wish to end it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Receives progress. Called from several threads.
pub trait Progress: Sync {
    /// `done` of `total` texels are finished.
    fn report(&self, done: u64, total: u64);

    /// True once the user wants to stop; the operation then ends soon and leaves nothing behind.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Neither shows nor stops anything.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn report(&self, _done: u64, _total: u64) {}
}

/// Adds up what threads have finished.
pub(crate) struct Meter<'a> {
    progress: &'a dyn Progress,
    done: AtomicU64,
    total: u64,
}

impl<'a> Meter<'a> {
    pub(crate) fn new(progress: &'a dyn Progress, total: u64) -> Self {
        Self { progress, done: AtomicU64::new(0), total }
    }

    pub(crate) fn add(&self, texels: u64) {
        let done = self.done.fetch_add(texels, Ordering::Relaxed) + texels;
        self.progress.report(done, self.total);
    }

    pub(crate) fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}
