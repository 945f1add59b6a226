//! Steps: what a stroke or a change of the layers leaves behind it, coarser levels and the history included.

use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError};

use fantex_base::Result;
use fantex_store::{PageId, page_origin};

use crate::error::encoded;
use crate::history::PageStep;
use crate::layers::{base_bytes, base_name, page_name};
use crate::levels::{Dirty, GROUP_BATCH, LevelResults, LevelWork, LevelsUnderway};
use crate::log::{self, Portable, portable};
use crate::painter::OpenStroke;
use crate::stroke_page::StrokePage;
use crate::texel_page::Rect;
use crate::{Painter, StrokeSettings, StrokeSummary, Target};

/// Pages of level 0, times channels, whose coarser levels are left to another thread; those of more are computed at once, part by
/// part, so that memory stays bounded.
const MAX_PAGES_IN_BACKGROUND: usize = 2048;

/// Changed texels of level 0, group by group.
#[derive(Clone, Debug, Default)]
pub(crate) struct Changes {
    pub(crate) groups: BTreeMap<u32, Dirty>,
    /// What lies under the layers has changed.
    pub(crate) is_base: bool,
}

impl Changes {
    /// Adds texels of a page, given relative to it.
    pub(crate) fn add(&mut self, id: PageId, rect: Rect) {
        let rect = rect.moved(page_origin(id.page));
        let known = self.groups.entry(id.group).or_default().entry(id.page).or_insert(Rect::EMPTY);
        *known = known.union(rect);
    }
}

impl Painter {
    /// Ends the open stroke: shows it, computes coarser levels, and enters it into the history.
    ///
    /// # Errors
    /// Pages cannot be read, encoded or written.
    pub fn end(&mut self) -> Result<StrokeSummary> {
        self.end_stroke(false)
    }

    /// Drops the open stroke: everything is as it was before it, and there is no step in the history. Does nothing where none is open.
    ///
    /// # Errors
    /// What it was before cannot be read.
    pub fn abandon(&mut self) -> Result<()> {
        let Some(mut stroke) = self.stroke.take() else { return Ok(()) };
        self.room.let_go();
        for id in stroke.pages.ids() {
            let Some(mut page) = stroke.pages.take(id)? else { continue };
            // Never shown: nothing has changed.
            if page.originals.is_empty() {
                continue;
            }
            if stroke.is_layered(&page) {
                let before = page.originals.pop().unwrap_or_default();
                let is_new_base = before.is_empty()
                    && stroke.target != Target::Base
                    && self.is_new_base(id, &page.originals, &stroke.affected)?;
                let name = page_name(stroke.target, id);
                match before.is_empty() {
                    true => self.editor.detach(&name),
                    false => self.editor.attach(&name, before)?,
                }
                if is_new_base {
                    self.editor.detach(&base_name(id));
                }
            }
            for (&channel, before) in stroke.affected.iter().zip(page.originals) {
                self.editor.replace(id, channel, before)?;
            }
        }
        self.relieve()
    }

    /// As [`end`](Self::end), but coarser levels are left to another thread: they (and the step in the history) are there once
    /// [`poll_levels`](Self::poll_levels) has said so. The results are the same bytes as [`end`](Self::end)'s. Whatever needs them
    /// (undo, redo, a commit, the end of the next stroke, changes of the layers) waits for them.
    ///
    /// # Errors
    /// As [`end`](Self::end).
    pub fn end_in_background(&mut self) -> Result<StrokeSummary> {
        self.end_stroke(true)
    }

    fn end_stroke(&mut self, is_in_background: bool) -> Result<StrokeSummary> {
        self.finish_levels()?;
        let Some((mut summary, changes, channels)) = self.close_stroke()? else {
            return Ok(StrokeSummary::default());
        };
        let is_under_layers = changes.is_base && changes.groups.keys().any(|&g| self.keeps_base_levels(g));
        let is_small = summary.pages * channels.len().max(1) <= MAX_PAGES_IN_BACKGROUND;
        if is_in_background && is_small && !is_under_layers {
            let work = self.level_work(changes.clone(), &channels);
            // Nothing is under way: nobody holds them.
            let mut known = self.level_maps.lock().unwrap_or_else(PoisonError::into_inner);
            known.share(&self.maps, self.options.budget());
            drop(known);
            self.levels = LevelsUnderway::start(work, &self.level_maps);
        }
        if self.levels.is_none() {
            summary.coarser_pages = self.finish_changes(changes, &channels)?;
            self.history.finish(&mut self.editor)?;
        }
        Ok(summary)
    }

    /// Takes over coarser levels that are ready, and returns the pages that they change (none twice, channels together); `None`
    /// while they are still being computed.
    ///
    /// # Errors
    /// As [`end`](Self::end).
    pub fn poll_levels(&mut self) -> Result<Option<Vec<PageId>>> {
        let Some(underway) = &self.levels else { return Ok(Some(Vec::new())) };
        let Some(results) = underway.poll() else { return Ok(None) };
        self.levels = None;
        self.take_over(results).map(Some)
    }

    /// Waits for coarser levels that are being computed, and returns the pages that they change.
    ///
    /// # Errors
    /// As [`end`](Self::end).
    pub fn finish_levels(&mut self) -> Result<Vec<PageId>> {
        let Some(underway) = self.levels.take() else { return Ok(Vec::new()) };
        self.take_over(underway.wait())
    }

    fn take_over(&mut self, results: Result<LevelResults>) -> Result<Vec<PageId>> {
        let applied = results.and_then(|results| self.apply_levels(results));
        // What is there of the step can be undone in any case.
        self.history.finish(&mut self.editor)?;
        let mut ids = applied?;
        ids.dedup();
        Ok(ids)
    }

    /// Shows the open stroke for the last time and enters what it changed at level 0 into the history.
    fn close_stroke(&mut self) -> Result<Option<(StrokeSummary, Changes, Vec<usize>)>> {
        self.show()?;
        let Some(mut stroke) = self.stroke.take() else { return Ok(None) };
        self.room.let_go();
        let ids = stroke.pages.ids();
        let summary = StrokeSummary { dabs: stroke.dabs, pages: ids.len(), coarser_pages: 0 };
        self.begin_step(&stroke.label);
        let mut changes = Changes { is_base: stroke.target == Target::Base, ..Changes::default() };
        for &id in &ids {
            let Some(page) = stroke.pages.take(id)? else { continue };
            changes.add(id, stroke.changed(&self.surface, self.editor.asset(), id, page.touched));
            self.remember_page(&stroke, id, page)?;
            self.relieve()?;
        }
        self.log_stroke(&stroke)?;
        Ok(Some((summary, changes, stroke.affected)))
    }

    /// Enters into the history what a stroke has changed on a page of level 0.
    pub(crate) fn remember_page(
        &mut self,
        stroke: &OpenStroke,
        id: PageId,
        mut page: StrokePage,
    ) -> Result<()> {
        if !self.options.history {
            return Ok(());
        }
        let mut change = PageStep { id, channels: Vec::new(), is_first_layered: false };
        if stroke.is_layered(&page) {
            let before = page.originals.pop().unwrap_or_default();
            change.is_first_layered = before.is_empty()
                && stroke.target != Target::Base
                && self.is_new_base(id, &page.originals, &stroke.affected)?;
            self.remember_attachment(&page_name(stroke.target, id), before)?;
        }
        for (&channel, before) in stroke.affected.iter().zip(page.originals) {
            change.channels.push((channel, before, self.editor.read_page_raw(channel, id)?));
        }
        self.history.add_page(change, &mut self.editor)
    }

    pub(crate) fn log_stroke(&mut self, stroke: &OpenStroke) -> Result<()> {
        let asset = self.editor.asset();
        let Portable { stroke: mut settings, files, .. } =
            portable(&self.surface, asset, &stroke.paint, stroke.recording.clone())?;
        settings.label.clone_from(&stroke.label);
        if let Target::Layer(id) | Target::Mask(id) = stroke.target {
            let name = self.layers.find(id).map(|layer| layer.name.clone()).unwrap_or_default();
            let layer = settings.layer.get_or_insert_default();
            (layer.id, layer.name, layer.mask) = (Some(id), name, matches!(stroke.target, Target::Mask(_)));
            // The layer itself has been logged when it was made.
            (layer.fill, layer.group, layer.within) = (None, None, None);
        }
        for (name, contents) in files {
            // Names are hashes of contents.
            let name = log::file_name(&name);
            if !self.editor.has_attachment(&name) {
                self.attach(&name, contents)?;
            }
        }
        self.log(&settings)
    }

    pub(crate) fn log(&mut self, settings: &StrokeSettings) -> Result<()> {
        let contents = encoded(settings)?;
        let name = log::stroke_name(self.next_stroke);
        self.next_stroke += 1;
        self.attach(&name, contents)
    }

    /// Takes the last step back; false where there is none. An open stroke ends first.
    ///
    /// # Errors
    /// The history cannot be read, or the asset not be changed.
    pub fn undo(&mut self) -> Result<bool> {
        let is_started = self.start_undo()?;
        self.finish_work()?;
        Ok(is_started)
    }

    /// Does what was taken back last again; false where there is nothing.
    ///
    /// # Errors
    /// As [`undo`](Self::undo).
    pub fn redo(&mut self) -> Result<bool> {
        let is_started = self.start_redo()?;
        self.finish_work()?;
        Ok(is_started)
    }

    pub(crate) fn begin_step(&mut self, label: &str) {
        if self.options.history {
            self.history.begin(label, &mut self.editor);
        }
    }

    /// Computes the coarser levels of what has changed; returns how many pages that changes. More of the step may come.
    pub(crate) fn finish_changes(&mut self, changes: Changes, channels: &[usize]) -> Result<usize> {
        if changes.is_base {
            self.finish_base_levels(&changes, channels)?;
        }
        let mut work = self.level_work(changes, channels);
        let mut groups = std::mem::take(&mut work.groups).into_iter();
        let mut count = 0;
        loop {
            // So many at a time that their results fit into memory.
            work.groups = groups.by_ref().take(GROUP_BATCH).collect();
            if work.groups.is_empty() {
                break;
            }
            work.pages = self.editor.snapshot();
            let results = work.run(None, &mut self.maps)?;
            count += self.apply_levels(results)?.len();
        }
        Ok(count)
    }

    pub(crate) fn level_work(&self, changes: Changes, channels: &[usize]) -> LevelWork {
        let is_layered = |(&group, dirty): (&u32, &Dirty)| {
            let is_kept = |page| self.editor.has_attachment(&base_name(PageId { group, level: 0, page }));
            let is_first_layered = || !changes.is_base && dirty.keys().copied().any(is_kept);
            (self.keeps_base_levels(group) || is_first_layered()).then_some(group)
        };
        LevelWork {
            surface: Arc::clone(&self.surface),
            pages: self.editor.snapshot(),
            layered: changes.groups.iter().filter_map(is_layered).collect(),
            groups: changes.groups.into_iter().collect(),
            channels: channels.to_vec(),
            budget_bytes: self.options.budget(),
        }
    }

    /// Puts coarser levels in their places; returns the pages, one for each channel that changes.
    fn apply_levels(&mut self, results: LevelResults) -> Result<Vec<PageId>> {
        let mut ids = Vec::new();
        for (group, mut result) in results {
            if result.is_layered {
                self.keep_means(group)?;
            }
            for step in self.page_steps(&mut result)? {
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
        }
        Ok(ids)
    }

    pub(crate) fn remember(&mut self, change: PageStep) -> Result<()> {
        self.history.add_page(change, &mut self.editor)?;
        self.relieve()
    }

    /// Changes an attachment of the layers and enters that into the history.
    pub(crate) fn attach(&mut self, name: &str, contents: Vec<u8>) -> Result<()> {
        let before = self.editor.attachment(name)?.unwrap_or_default();
        self.editor.attach(name, contents)?;
        self.remember_attachment(name, before)?;
        self.relieve()
    }

    /// Drops an attachment of the layers and enters that into the history.
    pub(crate) fn detach(&mut self, name: &str) -> Result<()> {
        let before = self.editor.attachment(name)?.unwrap_or_default();
        self.editor.detach(name);
        self.remember_attachment(name, before)?;
        self.relieve()
    }

    fn remember_attachment(&mut self, name: &str, before: Vec<u8>) -> Result<()> {
        if self.options.history {
            let after = self.editor.attachment(name)?.unwrap_or_default();
            if before != after {
                self.history.add_attachment(name, before, after, &mut self.editor)?;
            }
        }
        Ok(())
    }

    /// True where this stroke has put the base of a page aside: then it is the page as it was.
    fn is_new_base(&self, id: PageId, originals: &[Vec<u8>], affected: &[usize]) -> Result<bool> {
        let Some(base) = self.editor.attachment(&base_name(id))? else { return Ok(false) };
        let channels = self.editor.asset().channels().len();
        let mut page = Vec::with_capacity(base.len());
        for channel in 0..channels {
            match affected.iter().position(|&c| c == channel) {
                Some(index) => page.extend_from_slice(&originals[index]),
                None => page.extend(self.editor.read_page_raw(channel, id)?),
            }
        }
        Ok(page == base)
    }

    /// Moves changes from memory to the file where they exceed the budget.
    pub(crate) fn relieve(&mut self) -> Result<()> {
        if self.editor.pending_bytes() > self.options.budget() {
            // What another thread reads must stay where it is.
            self.finish_levels()?;
            self.room.relieve(&mut self.editor, self.options.budget())?;
        }
        Ok(())
    }
}
