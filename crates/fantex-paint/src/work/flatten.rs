//! Evaluating layers, after they have changed, on all pages that they show on.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use fantex_store::{PageId, page_extent};
use serde::{Deserialize, Serialize};

use super::{Afterwards, StepWork, Work, WorkProgress};
use crate::history::{Direction, HistoryStep};
use crate::layers::{find_folders, keep_folders};
use crate::tile_paint::{Changes, Rect};
use crate::{Layer, PaintError, Painter};

/// Pages that are flattened at a time: enough for all threads, and so few that a window can answer soon.
const BATCH: usize = 16;

/// Layers that are being flattened.
#[derive(Debug)]
pub(crate) struct FlattenWork {
    label: String,
    /// The layers before the change.
    before: Vec<Layer>,
    /// Groups that are left with their pages, the next one last.
    left: Vec<(u32, Vec<PageId>)>,
    /// The groups that are at work.
    current: Slice,
    /// Groups that were at work when it was last committed.
    interrupted: BTreeSet<u32>,
    pages: usize,
    pages_done: usize,
}

/// Some groups.
#[derive(Debug, Default)]
struct Slice {
    groups: Vec<u32>,
    /// The next one last.
    pages: Vec<PageId>,
    /// What has changed in them.
    changes: Changes,
}

/// The same in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Kept {
    label: String,
    /// None where no history is kept.
    pub(super) step: Option<HistoryStep>,
    before: Vec<Layer>,
    /// Groups that are left, in runs: the first one and how many.
    left: Vec<[u32; 2]>,
    /// Those of them whose finest level may be done in parts.
    current: Vec<u32>,
}

impl FlattenWork {
    /// All pages of level 0 that are to be flattened, ascending.
    pub(crate) fn new(label: &str, before: Vec<Layer>, pages: &[PageId]) -> Self {
        let mut groups: BTreeMap<u32, Vec<PageId>> = BTreeMap::new();
        for &id in pages {
            groups.entry(id.group).or_default().push(id);
        }
        Self {
            label: label.to_owned(),
            before,
            left: groups.into_iter().rev().collect(),
            current: Slice::default(),
            interrupted: BTreeSet::new(),
            pages: pages.len(),
            pages_done: 0,
        }
    }

    pub(super) fn progress(&self) -> WorkProgress {
        let share = self.pages_done as f32 / self.pages.max(1) as f32;
        WorkProgress { label: self.label.clone(), share, is_undo: false }
    }

    pub(super) fn prefer(&mut self, urgency: impl Fn(u32) -> f32) {
        self.left.sort_by_cached_key(|(group, _)| (ordered(urgency(*group)), std::cmp::Reverse(*group)));
    }

    pub(super) fn kept(&self, step: Option<HistoryStep>, asset: &Path) -> Kept {
        let mut before = self.before.clone();
        keep_folders(&mut before, asset);
        let left: BTreeSet<u32> =
            self.left.iter().map(|(group, _)| *group).chain(self.current.groups.iter().copied()).collect();
        let mut runs: Vec<[u32; 2]> = Vec::new();
        for group in left {
            match runs.last_mut() {
                Some([first, count]) if *first + *count == group => *count += 1,
                _ => runs.push([group, 1]),
            }
        }
        let mut current = self.current.groups.clone();
        current.extend(&self.interrupted);
        Kept { label: self.label.clone(), step, before, left: runs, current }
    }

    /// Some groups more, about a batch of pages.
    fn next_slice(&mut self) {
        let mut slice = Slice::default();
        while let Some((group, pages)) =
            self.left.pop_if(|(_, pages)| slice.pages.is_empty() || slice.pages.len() + pages.len() <= BATCH)
        {
            slice.groups.push(group);
            slice.pages.extend(pages);
        }
        slice.pages.reverse();
        self.current = slice;
    }
}

/// Floats in the order of numbers.
fn ordered(x: f32) -> i32 {
    let bits = x.to_bits() as i32;
    if bits < 0 { bits ^ i32::MAX } else { bits }
}

impl Painter {
    /// Flattens some pages, or ends the groups that are at work.
    pub(super) fn flatten_on(&mut self, mut work: FlattenWork) -> Result<(), PaintError> {
        if work.current.groups.is_empty() {
            work.next_slice();
        }
        if work.current.groups.is_empty() {
            return self.finish_history();
        }
        let from = work.current.pages.len().saturating_sub(BATCH);
        let ids: Vec<PageId> = work.current.pages[from..].iter().rev().copied().collect();
        let mut done = self.flatten_pages(&ids, &mut work.current.changes);
        if done.is_ok() {
            work.current.pages.truncate(from);
            work.pages_done += ids.len();
            for &id in ids.iter().filter(|id| work.interrupted.contains(&id.group)) {
                // Pages that were done then do not change any more, but their coarser levels may still have to.
                let group = &self.editor.asset().cover().groups[id.group as usize];
                let extent = page_extent(group.level_extent(0), id.page);
                work.current.changes.add(id, Rect { low: [0; 2], high: extent });
            }
            if work.current.pages.is_empty() {
                let Slice { groups, changes, .. } = std::mem::take(&mut work.current);
                work.interrupted.retain(|group| !groups.contains(group));
                let channels: Vec<usize> = (0..self.editor.asset().channels().len()).collect();
                done = self.finish_changes(changes, &channels).map(drop);
            }
        }
        self.work = Some(Work::Flatten(work));
        done
    }

    /// Takes back what is done so far.
    pub(super) fn give_up_flattening(&mut self, work: FlattenWork) -> Result<(), PaintError> {
        if !self.options.history {
            // There is no way back but to the end and from there.
            self.work = Some(Work::Flatten(work));
            return Ok(());
        }
        self.finish_history()?;
        if let Some(step) = self.history.next_step(Direction::Back).cloned() {
            self.work = Some(Work::Step(StepWork::then(step, Direction::Back, Afterwards::Forget)));
        }
        Ok(())
    }

    /// What was left of flattening when the asset was committed.
    pub(super) fn flatten_left(&self, kept: Kept) -> FlattenWork {
        let mut before = kept.before;
        find_folders(&mut before, self.editor.asset().path());
        let left: Vec<PageId> = self
            .pages_to_flatten(&before)
            .into_iter()
            .filter(|id| {
                let run = kept.left.partition_point(|[first, _]| *first <= id.group);
                run > 0 && id.group - kept.left[run - 1][0] < kept.left[run - 1][1]
            })
            .collect();
        let mut work = FlattenWork::new(&kept.label, before, &left);
        work.interrupted = kept.current.into_iter().collect();
        work
    }
}
