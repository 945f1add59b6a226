//! Steps: what a stroke or a change of the layers leaves behind it, coarser levels and the history included.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_store::{PageId, page_origin};
use rayon::prelude::*;

use super::levels::{CoarserLevels, Dirty, LevelJob, PageChange, dirty_levels, pages_read};
use super::painter::{Painter, StrokeSummary};
use super::rect::Rect;
use crate::history::flush_if_possible;
use crate::layers::{Layers, base_name, target_name};
use crate::{PaintError, Target};

/// Groups whose levels are worked on at a time.
const GROUP_BATCH: usize = 64;

/// Changed texels of level 0, group by group.
#[derive(Debug, Default)]
pub(crate) struct Changes(BTreeMap<u32, Dirty>);

impl Changes {
    /// Adds texels of a page, given relative to it.
    pub(crate) fn add(&mut self, id: PageId, rect: Rect) {
        let rect = rect.moved(page_origin(id.page));
        let known = self.0.entry(id.group).or_default().entry(id.page).or_insert(Rect::EMPTY);
        *known = known.union(rect);
    }
}

impl Painter {
    /// Ends the open stroke: shows it, computes coarser levels, and enters it into the history.
    pub fn end(&mut self) -> Result<StrokeSummary, PaintError> {
        self.show()?;
        let Some(mut stroke) = self.stroke.take() else { return Ok(StrokeSummary::default()) };
        let ids = stroke.pages.ids();
        let mut summary = StrokeSummary { dabs: stroke.dabs, pages: ids.len(), coarser_pages: 0 };
        self.begin_step(&stroke.label);
        let mut changes = Changes::default();
        for &id in &ids {
            let Some(mut page) = stroke.pages.take(id)? else { continue };
            changes.add(id, page.touched);
            if stroke.is_layered(&page) {
                let before = page.originals.pop().unwrap_or_default();
                // The base is kept from the moment on at which something lies over it.
                if before.is_empty() && stroke.target != Target::Base {
                    self.remember_new_base(id, &page.originals, &stroke.affected)?;
                }
                self.remember_attachment(&target_name(stroke.target, id), before)?;
            }
            for (&channel, before) in stroke.affected.iter().zip(page.originals) {
                let after = self.editor.read_page_raw(channel, id)?;
                self.remember(&PageChange { id, channel, before, after })?;
            }
        }
        summary.coarser_pages = self.finish_step(changes, &stroke.affected)?;
        Ok(summary)
    }

    /// Takes the last step back; false where there is none. An open stroke ends first.
    pub fn undo(&mut self) -> Result<bool, PaintError> {
        self.end()?;
        let done = self.history.undo(&mut self.editor)?;
        self.layers = Layers::load(&self.editor)?;
        Ok(done)
    }

    /// Does what was taken back last again; false where there is nothing.
    pub fn redo(&mut self) -> Result<bool, PaintError> {
        self.end()?;
        let done = self.history.redo(&mut self.editor)?;
        self.layers = Layers::load(&self.editor)?;
        Ok(done)
    }

    pub(crate) fn begin_step(&mut self, label: &str) {
        if self.options.history {
            self.history.begin(label, &mut self.editor);
        }
    }

    /// Computes the coarser levels of what has changed; returns how many pages that changes.
    pub(crate) fn finish_step(&mut self, changes: Changes, channels: &[usize]) -> Result<usize, PaintError> {
        let groups: Vec<(u32, Dirty)> = changes.0.into_iter().collect();
        let mut count = 0;
        for batch in groups.chunks(GROUP_BATCH) {
            count += self.update_levels(batch, channels)?;
        }
        if self.options.history {
            self.history.finish(&mut self.editor)?;
        }
        Ok(count)
    }

    fn update_levels(&mut self, groups: &[(u32, Dirty)], channels: &[usize]) -> Result<usize, PaintError> {
        let surface = Arc::clone(&self.surface);
        let jobs: Vec<(u32, Vec<Dirty>)> = groups
            .par_iter()
            .map(|(group, dirty)| (*group, dirty_levels(&surface, *group, dirty.clone())))
            .collect();
        let ids: Vec<PageId> =
            jobs.iter().flat_map(|(group, levels)| pages_read(&surface, *group, levels)).collect();
        let maps = self.maps.get(&surface, &ids, self.options.memory_bytes / 4);
        let maps: BTreeMap<_, _> = ids.into_iter().zip(maps).collect();
        let editor = &self.editor;
        let results: Vec<CoarserLevels> = jobs
            .par_iter()
            .map(|(group, levels)| {
                let mut result = CoarserLevels::default();
                for &channel in channels {
                    let job = LevelJob { surface: &surface, editor, group: *group, channel, maps: &maps };
                    job.run(levels, &mut result)?;
                }
                Ok(result)
            })
            .collect::<Result<_, PaintError>>()?;
        let mut count = 0;
        for ((group, _), result) in jobs.iter().zip(results) {
            count += result.pages.len();
            for change in result.pages {
                self.remember(&change)?;
                self.editor.replace(change.id, change.channel, change.after)?;
            }
            for (channel, mean) in result.means {
                let before = self.editor.mean(channel, *group);
                self.editor.set_mean(channel, *group, mean);
                // As it is stored, so that it comes back exactly.
                let after = self.editor.mean(channel, *group);
                if self.options.history {
                    self.history.add_mean(channel, *group, before, after);
                }
            }
        }
        Ok(count)
    }

    /// Enters a page's change into the history.
    pub(crate) fn remember(&mut self, change: &PageChange) -> Result<(), PaintError> {
        let PageChange { id, channel, before, after } = change;
        if self.options.history {
            self.history.add_page(*id, *channel, before, after, &mut self.editor)?;
        }
        self.relieve()
    }

    /// Changes an attachment of the layers and enters that into the history.
    pub(crate) fn attach(&mut self, name: &str, contents: Vec<u8>) -> Result<(), PaintError> {
        let before = self.editor.attachment(name)?.unwrap_or_default();
        self.editor.attach(name, contents)?;
        self.remember_attachment(name, before)
    }

    fn remember_attachment(&mut self, name: &str, before: Vec<u8>) -> Result<(), PaintError> {
        if self.options.history {
            let after = self.editor.attachment(name)?.unwrap_or_default();
            if before != after {
                self.history.add_attachment(name, before, after, &mut self.editor)?;
            }
        }
        self.relieve()
    }

    /// Enters into the history that the base of a page was put aside, if this stroke did so: then it is the page as it was.
    fn remember_new_base(
        &mut self,
        id: PageId,
        originals: &[Vec<u8>],
        affected: &[usize],
    ) -> Result<(), PaintError> {
        let name = base_name(id);
        let Some(base) = self.editor.attachment(&name)? else { return Ok(()) };
        let channels = self.editor.asset().channels().len();
        let mut page = Vec::with_capacity(base.len());
        for channel in 0..channels {
            match affected.iter().position(|&c| c == channel) {
                Some(index) => page.extend_from_slice(&originals[index]),
                None => page.extend(self.editor.read_page_raw(channel, id)?),
            }
        }
        if page == base { self.remember_attachment(&name, Vec::new()) } else { Ok(()) }
    }

    /// Moves changes from memory to the file where they exceed the budget.
    pub(crate) fn relieve(&mut self) -> Result<(), PaintError> {
        if self.editor.pending_bytes() > self.options.memory_bytes / 4 {
            self.disk_full = flush_if_possible(&mut self.editor)?;
        }
        Ok(())
    }
}
