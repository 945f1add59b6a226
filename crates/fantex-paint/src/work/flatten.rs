//! Evaluating layers, after they have changed, on all pages that they show on.

use std::path::Path;

use fantex_store::PageId;
use serde::{Deserialize, Serialize};

use super::slices::{self, Slices};
use super::{Work, WorkProgress};
use crate::history::HistoryStep;
use crate::layers::{find_folders, keep_folders};
use crate::{Layer, PaintError, Painter};

/// Layers that are being flattened.
#[derive(Debug)]
pub(crate) struct FlattenWork {
    label: String,
    /// The layers before the change.
    before: Vec<Layer>,
    pub(super) slices: Slices,
}

/// The same in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Kept {
    label: String,
    /// None where no history is kept.
    pub(super) step: Option<HistoryStep>,
    before: Vec<Layer>,
    slices: slices::Kept,
}

impl FlattenWork {
    /// All pages of level 0 that are to be flattened, ascending.
    pub(crate) fn new(label: &str, before: Vec<Layer>, pages: &[PageId]) -> Self {
        Self { label: label.to_owned(), before, slices: Slices::new(pages) }
    }

    pub(super) fn progress(&self) -> WorkProgress {
        WorkProgress { label: self.label.clone(), share: self.slices.share(), is_undo: false }
    }

    pub(super) fn kept(&self, step: Option<HistoryStep>, asset: &Path) -> Kept {
        let mut before = self.before.clone();
        keep_folders(&mut before, asset);
        Kept { label: self.label.clone(), step, before, slices: self.slices.kept() }
    }
}

impl Painter {
    /// Flattens some pages, or ends the groups that are at work.
    pub(super) fn flatten_on(&mut self, mut work: FlattenWork) -> Result<(), PaintError> {
        let Some(ids) = work.slices.batch() else { return self.finish_history() };
        let channels: Vec<usize> = (0..self.editor.asset().channels().len()).collect();
        let done = self
            .flatten_pages(&ids, &mut work.slices.changes)
            .and_then(|()| self.end_batch(&mut work.slices, ids.len(), &channels).map(drop));
        self.work = Some(Work::Flatten(work));
        done
    }

    /// What was left of flattening when the asset was committed.
    pub(super) fn flatten_left(&self, kept: Kept) -> FlattenWork {
        let mut before = kept.before;
        find_folders(&mut before, self.editor.asset().path());
        let pages = self.pages_to_flatten(&before);
        let slices = Slices::left(&self.surface, &pages, &kept.slices);
        FlattenWork { label: kept.label, before, slices }
    }
}
