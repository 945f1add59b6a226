//! Pages of level 0 that work goes over, group by group.

use std::collections::BTreeMap;

use fantex_store::{PageId, page_extent};
use serde::{Deserialize, Serialize};

use crate::tile_paint::{Changes, Rect};
use crate::{PaintError, Painter, Surface};

/// Pages that are worked on at a time: enough for all threads, and so few that a window can answer soon.
const BATCH: usize = 16;

/// What is left of the pages, and what is at work: some groups with about a batch of pages, or one with more.
#[derive(Debug, Default)]
pub(super) struct Slices {
    /// Groups that are left with their pages, the next one last.
    left: Vec<(u32, Vec<PageId>)>,
    /// Groups that are at work.
    groups: Vec<u32>,
    /// Their pages.
    pages: Vec<PageId>,
    /// So many of these are done.
    done: usize,
    /// What has changed in them.
    pub(super) changes: Changes,
    /// All pages, and those that are done.
    all_pages: usize,
    all_done: usize,
}

/// The same in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Kept {
    /// Groups that are left, in runs: the first one and how many.
    left: Vec<[u32; 2]>,
    /// Groups that are at work.
    current: Vec<u32>,
    /// So many of their pages are done.
    done: usize,
}

impl Slices {
    /// All pages, ascending.
    pub(super) fn new(pages: &[PageId]) -> Self {
        let left = by_group(pages).into_iter().rev().collect();
        Self { left, all_pages: pages.len(), ..Self::default() }
    }

    /// What was left of the same pages when it was kept.
    pub(super) fn left(surface: &Surface, pages: &[PageId], kept: &Kept) -> Self {
        let mut groups = by_group(pages);
        let current: Vec<PageId> =
            kept.current.iter().flat_map(|group| groups.remove(group).unwrap_or_default()).collect();
        let is_left = |group: u32| {
            let run = kept.left.partition_point(|[first, _]| *first <= group);
            run > 0 && group - kept.left[run - 1][0] < kept.left[run - 1][1]
        };
        let left: Vec<_> = groups.into_iter().rev().filter(|(group, _)| is_left(*group)).collect();
        let done = kept.done.min(current.len());
        let mut changes = Changes::default();
        for &id in &current[..done] {
            // Their coarser levels are still to be computed. What exactly has changed is not known any more.
            let extent = surface.cover().groups[id.group as usize].level_extent(0);
            changes.add(id, Rect { low: [0; 2], high: page_extent(extent, id.page) });
        }
        let all_done =
            pages.len() - current.len() - left.iter().map(|(_, pages)| pages.len()).sum::<usize>() + done;
        let (groups, all_pages) = (kept.current.clone(), pages.len());
        Self { left, groups, pages: current, done, changes, all_pages, all_done }
    }

    pub(super) fn kept(&self) -> Kept {
        let mut left: Vec<u32> = self.left.iter().map(|(group, _)| *group).collect();
        left.sort_unstable();
        let mut runs: Vec<[u32; 2]> = Vec::new();
        for group in left {
            match runs.last_mut() {
                Some([first, count]) if *first + *count == group => *count += 1,
                _ => runs.push([group, 1]),
            }
        }
        Kept { left: runs, current: self.groups.clone(), done: self.done }
    }

    /// Share of the pages that is done.
    pub(super) fn share(&self) -> f32 {
        self.all_done as f32 / self.all_pages.max(1) as f32
    }

    /// Groups of less urgency come later.
    pub(super) fn prefer(&mut self, urgency: impl Fn(u32) -> f32) {
        self.left.sort_by_cached_key(|(group, _)| (ordered(urgency(*group)), std::cmp::Reverse(*group)));
    }

    /// The pages to be done now; none where all are done. (A slice whose pages are done but not its coarser levels gives an empty
    /// batch.)
    pub(super) fn batch(&mut self) -> Option<Vec<PageId>> {
        while self.groups.is_empty() || self.pages.len() < BATCH {
            let fits = |(_, pages): &mut (u32, Vec<PageId>)| {
                self.pages.is_empty() || self.pages.len() + pages.len() <= BATCH
            };
            // One that is under way is not added to.
            let Some((group, pages)) = (self.done == 0).then(|| self.left.pop_if(fits)).flatten() else {
                break;
            };
            self.groups.push(group);
            self.pages.extend(pages);
        }
        let to = self.pages.len().min(self.done + BATCH);
        (!self.groups.is_empty()).then(|| self.pages[self.done..to].to_vec())
    }

    /// A batch is done.
    fn add_done(&mut self, count: usize) {
        self.done += count;
        self.all_done += count;
    }

    /// The coarser levels of what is at work are done, too.
    fn end_groups(&mut self) {
        self.groups.clear();
        self.pages.clear();
        self.done = 0;
        self.changes = Changes::default();
    }
}

impl Painter {
    /// A batch is done; with the last one of its groups come their coarser levels: returns how many pages these are.
    pub(super) fn end_batch(
        &mut self,
        slices: &mut Slices,
        count: usize,
        channels: &[usize],
    ) -> Result<usize, PaintError> {
        slices.add_done(count);
        let mut coarser = 0;
        if slices.done == slices.pages.len() {
            coarser = self.finish_changes(slices.changes.clone(), channels)?;
            slices.end_groups();
        }
        Ok(coarser)
    }
}

fn by_group(pages: &[PageId]) -> BTreeMap<u32, Vec<PageId>> {
    let mut groups: BTreeMap<u32, Vec<PageId>> = BTreeMap::new();
    for &id in pages {
        groups.entry(id.group).or_default().push(id);
    }
    groups
}

/// Floats in the order of numbers.
fn ordered(x: f32) -> i32 {
    let bits = x.to_bits() as i32;
    if bits < 0 { bits ^ i32::MAX } else { bits }
}
