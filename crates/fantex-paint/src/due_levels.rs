//! Coarser levels that come after the end of a stroke.
//!
//! ```text
//!  end of a stroke --> due, group by group --slices--> levels, means, their records: the step is whole
//!                               ^
//!             texels of a group are about to change: what is due there comes first
//! ```
//!
//! Whoever paints goes on at once. A step that owes levels is in the history, but not whole; what needs it whole (undo, redo, a commit,
//! changes of the layers) makes what is left first. The levels of a group are made of its own texels. As nobody changes these before,
//! the levels are the same bytes as if they had been made at once.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fantex_base::Result;
use fantex_store::PageId;

use crate::layers::{base_bytes, base_name};
use crate::levels::{CoarserLevels, Dirty, GROUP_BATCH, LevelWork};
use crate::steps::Changes;
use crate::{Painter, StrokeSummary};

/// Changed texels of level 0, times channels, whose levels are made in one slice: some milliseconds.
const SLICE_TEXELS: u64 = 1 << 16;

/// Most groups of a slice.
const SLICE_GROUPS: usize = 16;

/// Most steps that may owe levels: before there are more, the oldest is made whole.
const MAX_DUE_STEPS: usize = 8;

/// Coarser levels that a step owes.
#[derive(Debug)]
pub(crate) struct DueLevels {
    /// Its number in the history, where one is kept.
    step: Option<u64>,
    channels: Vec<usize>,
    /// A group is left out as soon as its levels are made.
    changes: Changes,
}

impl DueLevels {
    /// The groups of a slice.
    fn slice(&self) -> Vec<u32> {
        let mut texels = 0;
        let fits = |(_, dirty): &(&u32, &Dirty)| {
            let is_room = texels < SLICE_TEXELS;
            let sides = dirty.values().map(|rect| rect.extent().map(u64::from));
            texels += sides.map(|[x, y]| x * y).sum::<u64>() * self.channels.len() as u64;
            is_room
        };
        self.changes.groups.iter().take(SLICE_GROUPS).take_while(fits).map(|(&group, _)| group).collect()
    }

    /// As many groups as are worked on at a time.
    fn batch(&self) -> Vec<u32> {
        self.changes.groups.keys().take(GROUP_BATCH).copied().collect()
    }
}

impl Painter {
    /// Ends the open stroke: shows it, computes coarser levels, and enters it into the history.
    ///
    /// # Errors
    /// Pages cannot be read, encoded or written.
    pub fn end(&mut self) -> Result<StrokeSummary> {
        self.finish_levels()?;
        let mut summary = self.end_in_background()?;
        while let Some(groups) = self.due.front().map(DueLevels::batch) {
            summary.coarser_pages += self.make_due(0, &groups)?;
        }
        self.made.clear();
        Ok(summary)
    }

    /// As [`end`](Self::end), but coarser levels are left for later: for [`poll_levels`](Self::poll_levels). They are the same bytes as
    /// [`end`](Self::end)'s. The next stroke waits for those of the tiles that it paints on, and for no others; whatever needs all
    /// (undo, redo, a commit, changes of the layers) makes them first.
    ///
    /// # Errors
    /// As [`end`](Self::end).
    pub fn end_in_background(&mut self) -> Result<StrokeSummary> {
        let Some((summary, changes, channels)) = self.close_stroke()? else {
            return Ok(StrokeSummary::default());
        };
        let step = self.history.leave_open();
        self.due.push_back(DueLevels { step, channels, changes });
        while self.due.len() > MAX_DUE_STEPS {
            let oldest = self.due.front().map(DueLevels::batch);
            self.make_due(0, &oldest.unwrap_or_default())?;
        }
        Ok(summary)
    }

    /// Makes some of the coarser levels that are due, for some milliseconds. Returns the pages that have changed (none twice, channels
    /// together) once none is due any more; `None` as long as there are more.
    ///
    /// # Errors
    /// As [`end`](Self::end). Its step then goes without the rest of its levels.
    pub fn poll_levels(&mut self) -> Result<Option<Vec<PageId>>> {
        if let Some(groups) = self.due.front().map(DueLevels::slice) {
            self.make_due(0, &groups)?;
        }
        Ok(self.due.is_empty().then(|| self.take_made()))
    }

    /// Makes all coarser levels that are due, and returns the pages that have changed.
    ///
    /// # Errors
    /// As [`poll_levels`](Self::poll_levels).
    pub fn finish_levels(&mut self) -> Result<Vec<PageId>> {
        while let Some(groups) = self.due.front().map(DueLevels::batch) {
            self.make_due(0, &groups)?;
        }
        Ok(self.take_made())
    }

    fn take_made(&mut self) -> Vec<PageId> {
        std::mem::take(&mut self.made).into_iter().collect()
    }

    /// Makes the levels that are due in the groups of some pages: their texels are about to change.
    pub(crate) fn settle(&mut self, ids: &[PageId]) -> Result<()> {
        if self.due.is_empty() {
            return Ok(());
        }
        let groups: BTreeSet<u32> = ids.iter().map(|id| id.group).collect();
        let mut index = 0;
        while let Some(due) = self.due.get(index) {
            let is_due = |group: &u32| due.changes.groups.contains_key(group);
            let wanted: Vec<u32> = groups.iter().copied().filter(is_due).collect();
            let count = self.due.len();
            for batch in wanted.chunks(GROUP_BATCH) {
                self.make_due(index, batch)?;
            }
            // One that is whole now has left its place to the next one.
            if self.due.len() == count {
                index += 1;
            }
        }
        Ok(())
    }

    /// Makes levels of some groups that a step owes; with the last ones it is whole. Returns how many pages that changes, per channel.
    fn make_due(&mut self, index: usize, groups: &[u32]) -> Result<usize> {
        let Some(due) = self.due.get_mut(index) else { return Ok(0) };
        let (step, channels, is_base) = (due.step, due.channels.clone(), due.changes.is_base);
        let taken = groups.iter().filter_map(|group| due.changes.groups.remove_entry(group)).collect();
        self.history.resume(step);
        let made = self.make_levels(taken, is_base, &channels);
        let due = &mut self.due[index];
        if made.is_err() {
            // What is there of the step can be undone in any case.
            due.changes.groups.clear();
        }
        if due.changes.groups.is_empty() {
            self.due.remove(index);
            self.history.finish(&mut self.editor)?;
        } else {
            self.history.leave_open();
        }
        let ids = made?;
        let count = ids.len();
        self.made.extend(ids);
        Ok(count)
    }

    /// Computes the coarser levels of what has changed; returns how many pages that changes, per channel. More of the step may come.
    pub(crate) fn finish_changes(&mut self, changes: Changes, channels: &[usize]) -> Result<usize> {
        let mut groups = changes.groups.into_iter();
        let mut count = 0;
        loop {
            // So many at a time that their results fit into memory.
            let batch: Vec<(u32, Dirty)> = groups.by_ref().take(GROUP_BATCH).collect();
            if batch.is_empty() {
                return Ok(count);
            }
            count += self.make_levels(batch, changes.is_base, channels)?.len();
        }
    }

    /// Computes the coarser levels of some groups and keeps them; returns the pages, one for each channel that changes. `is_base`: what
    /// lies under the layers has changed.
    fn make_levels(
        &mut self,
        groups: Vec<(u32, Dirty)>,
        is_base: bool,
        channels: &[usize],
    ) -> Result<Vec<PageId>> {
        if is_base {
            // Under layers that have had no effect so far, what is there is the base's.
            let is_aside = |(group, dirty): &&(u32, Dirty)| self.is_put_aside(*group, dirty);
            let aside: Vec<u32> = groups.iter().filter(is_aside).map(|(group, _)| *group).collect();
            aside.into_iter().try_for_each(|group| self.keep_means(group))?;
        }
        let is_under = |(group, _): &&(u32, Dirty)| is_base && self.keeps_base_levels(*group);
        let under: Vec<(u32, Dirty)> = groups.iter().filter(is_under).cloned().collect();
        let mut bases: BTreeMap<u32, CoarserLevels> = BTreeMap::new();
        if !under.is_empty() {
            let work = self.level_work(under, channels);
            bases.extend(work.run(&self.editor, true, &mut self.maps)?);
        }
        let work = self.level_work(groups, channels);
        let mut ids = Vec::new();
        for (group, result) in work.run(&self.editor, false, &mut self.maps)? {
            if let Some(base) = bases.remove(&group) {
                self.put_base_levels(group, base)?;
            }
            self.put_levels(group, result, &mut ids)?;
        }
        Ok(ids)
    }

    /// Whether the base of some changed page of level 0 has been put aside.
    fn is_put_aside(&self, group: u32, dirty: &Dirty) -> bool {
        let mut pages = dirty.keys().map(|&page| PageId { group, level: 0, page });
        pages.any(|id| self.editor.has_attachment(&base_name(id)))
    }

    pub(crate) fn level_work(&self, groups: Vec<(u32, Dirty)>, channels: &[usize]) -> LevelWork {
        let is_layered = |(group, dirty): &(u32, Dirty)| {
            (self.keeps_base_levels(*group) || self.is_put_aside(*group, dirty)).then_some(*group)
        };
        LevelWork {
            surface: Arc::clone(&self.surface),
            layered: groups.iter().filter_map(is_layered).collect(),
            groups,
            channels: channels.to_vec(),
            budget_bytes: self.options.budget(),
        }
    }

    /// Puts coarser levels of a group in their places.
    fn put_levels(&mut self, group: u32, mut result: CoarserLevels, ids: &mut Vec<PageId>) -> Result<()> {
        if result.is_layered {
            self.keep_means(group)?;
        }
        for step in self.page_steps(group, &mut result)? {
            let id = step.id;
            if step.is_first_layered {
                self.editor.attach(&base_name(id), base_bytes(&self.editor, id, None)?.concat())?;
            }
            for (channel, _, after) in &step.channels {
                ids.push(id);
                self.editor.replace(id, *channel, after.clone())?;
            }
            self.remember(step)?;
        }
        for (channel, mean) in result.means {
            let before = self.editor.mean(channel, group);
            self.editor.set_mean(channel, group, mean);
            // As it is stored, so that it comes back exactly.
            let after = self.editor.mean(channel, group);
            self.history.add_mean(channel, group, before, after);
        }
        Ok(())
    }
}
