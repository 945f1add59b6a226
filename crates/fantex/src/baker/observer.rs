//! Who hears of a bake.

use std::fmt;
use std::sync::{Mutex, PoisonError};

use fantex_bake::Progress;

/// Who hears of a bake, and how much of the covering is done.
pub(super) struct Observer<'a> {
    pub(super) progress: &'a dyn Progress,
    /// Thousandths that were told of the covering, once it has begun.
    covered: Mutex<Option<u16>>,
}

impl fmt::Debug for Observer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("progress")
    }
}

impl<'a> Observer<'a> {
    pub(super) fn new(progress: &'a dyn Progress) -> Self {
        Self { progress, covered: Mutex::default() }
    }

    /// The same work with another observer.
    #[cfg(feature = "photos")]
    pub(super) fn followed_by<'b>(&self, progress: &'b dyn Progress) -> Observer<'b> {
        Observer { progress, covered: Mutex::new(self.covered()) }
    }

    /// Does what tells its share of the covering that is left, and asks whether to go on.
    pub(super) fn covering<T>(&self, work: impl FnOnce(&(dyn Fn(f32) -> bool + Sync)) -> T) -> T {
        let begun = f32::from(self.covered().unwrap_or(0)) / 1000.0;
        work(&|share| {
            let goes_on = !self.progress.is_cancelled();
            if goes_on {
                self.cover(begun + (1.0 - begun) * share);
            }
            goes_on
        })
    }

    /// Tells that there is no more to cover, if there was anything.
    pub(super) fn end_covering(&self) {
        if self.covered().is_some() {
            self.cover(1.0);
        }
    }

    fn covered(&self) -> Option<u16> {
        *self.covered.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells that so much is covered, 0 to 1, if that is more than before. Whoever comes while another thread tells does not wait for it.
    fn cover(&self, share: f32) {
        let thousandths = (1000.0 * share) as u16;
        let Ok(mut covered) = self.covered.try_lock() else { return };
        if Some(thousandths) > *covered {
            *covered = Some(thousandths);
            self.progress.prepare("covering", share);
        }
    }
}
