//! Steps: what a stroke or a change of the layers leaves behind it, coarser levels and the history included.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_store::{PageId, page_origin};

use super::level_work::{GROUP_BATCH, LevelResults, LevelWork, LevelsUnderway};
use super::levels::{Dirty, PageChange};
use super::painter::{OpenStroke, Painter, StrokeSummary};
use super::rect::Rect;
use super::stroke_page::StrokePage;
use crate::history::PageStep;
use crate::layers::{base_name, target_name};
use crate::log::{self, Portable, portable};
use crate::{PaintError, StrokeSettings, Target};

/// Pages of level 0, times channels, whose coarser levels are left to another thread; those of more are computed at once, part by
/// part, so that memory stays bounded.
const MOST_PAGES_IN_BACKGROUND: usize = 2048;

/// Changed texels of level 0, group by group.
#[derive(Clone, Debug, Default)]
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
        self.finish_levels()?;
        let Some((mut summary, changes, channels)) = self.close_stroke()? else {
            return Ok(StrokeSummary::default());
        };
        summary.coarser_pages = self.finish_step(changes, &channels)?;
        Ok(summary)
    }

    /// The same, but coarser levels are left to another thread: they (and the step in the history) are there once
    /// [`poll_levels`](Self::poll_levels) has said so. The results are the same bytes as [`end`](Self::end)'s. Whatever needs them
    /// (undo, redo, a commit, the end of the next stroke, changes of the layers) waits for them.
    pub fn end_in_background(&mut self) -> Result<StrokeSummary, PaintError> {
        self.finish_levels()?;
        let Some((mut summary, changes, channels)) = self.close_stroke()? else {
            return Ok(StrokeSummary::default());
        };
        let pages = summary.pages * channels.len().max(1);
        if pages > MOST_PAGES_IN_BACKGROUND {
            summary.coarser_pages = self.finish_step(changes, &channels)?;
            return Ok(summary);
        }
        match LevelsUnderway::start(Box::new(self.level_work(changes, &channels)), &self.level_maps) {
            Ok(underway) => self.levels = Some(underway),
            Err(work) => {
                let results = work.run(&mut self.maps)?;
                summary.coarser_pages = self.apply_levels(results)?.len();
                self.finish_history()?;
            }
        }
        Ok(summary)
    }

    /// Takes over coarser levels that are ready, and returns the pages that they change (none twice, channels together); `None`
    /// while they are still being computed.
    pub fn poll_levels(&mut self) -> Result<Option<Vec<PageId>>, PaintError> {
        let Some(underway) = self.levels.take() else { return Ok(Some(Vec::new())) };
        match underway.poll() {
            Ok(results) => self.take_over(results).map(Some),
            Err(underway) => {
                self.levels = Some(underway);
                Ok(None)
            }
        }
    }

    /// Waits for coarser levels that are being computed, and returns the pages that they change.
    pub fn finish_levels(&mut self) -> Result<Vec<PageId>, PaintError> {
        let Some(underway) = self.levels.take() else { return Ok(Vec::new()) };
        self.take_over(underway.wait())
    }

    fn take_over(&mut self, results: Result<LevelResults, PaintError>) -> Result<Vec<PageId>, PaintError> {
        let applied = results.and_then(|results| self.apply_levels(results));
        // What is there of the step can be undone in any case.
        self.finish_history()?;
        let mut ids = applied?;
        ids.dedup();
        Ok(ids)
    }

    /// Shows the open stroke for the last time and enters what it changed at level 0 into the history.
    fn close_stroke(&mut self) -> Result<Option<(StrokeSummary, Changes, Vec<usize>)>, PaintError> {
        self.show()?;
        let Some(mut stroke) = self.stroke.take() else { return Ok(None) };
        self.room.let_go();
        let ids = stroke.pages.ids();
        let summary = StrokeSummary { dabs: stroke.dabs, pages: ids.len(), coarser_pages: 0 };
        self.begin_step(&stroke.label);
        let mut changes = Changes::default();
        for &id in &ids {
            let Some(page) = stroke.pages.take(id)? else { continue };
            changes.add(id, page.touched);
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
    ) -> Result<(), PaintError> {
        if !self.options.history {
            return Ok(());
        }
        let mut change = PageStep { id, channels: Vec::new(), is_first_layered: false };
        if stroke.is_layered(&page) {
            let before = page.originals.pop().unwrap_or_default();
            change.is_first_layered = before.is_empty()
                && stroke.target != Target::Base
                && self.is_new_base(id, &page.originals, &stroke.affected)?;
            self.remember_attachment(&target_name(stroke.target, id), before)?;
        }
        for (&channel, before) in stroke.affected.iter().zip(page.originals) {
            change.channels.push((channel, before, self.editor.read_page_raw(channel, id)?));
        }
        self.history.add_page(change, &mut self.editor)
    }

    /// Enters a stroke into the log.
    pub(crate) fn log_stroke(&mut self, stroke: &OpenStroke) -> Result<(), PaintError> {
        let asset = self.editor.asset();
        let Portable { stroke: mut settings, files, .. } =
            portable(&self.surface, asset, &stroke.paint, stroke.recording.clone())?;
        settings.label.clone_from(&stroke.label);
        if let Target::Layer(id) | Target::Mask(id) = stroke.target {
            let name = self.layers.find(id).map(|layer| layer.name.clone()).unwrap_or_default();
            let layer = settings.layer.get_or_insert_default();
            (layer.id, layer.name, layer.mask) = (Some(id), name, matches!(stroke.target, Target::Mask(_)));
            // The layer itself has been logged when it was made.
            layer.fill = None;
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

    /// Enters settings into the log.
    pub(crate) fn log(&mut self, settings: &StrokeSettings) -> Result<(), PaintError> {
        let contents = serde_json::to_vec(settings).map_err(std::io::Error::other)?;
        let name = log::stroke_name(self.next_stroke);
        self.next_stroke += 1;
        self.attach(&name, contents)
    }

    /// Takes the last step back; false where there is none. An open stroke ends first.
    pub fn undo(&mut self) -> Result<bool, PaintError> {
        let is_started = self.start_undo()?;
        self.finish_work()?;
        Ok(is_started)
    }

    /// Does what was taken back last again; false where there is nothing.
    pub fn redo(&mut self) -> Result<bool, PaintError> {
        let is_started = self.start_redo()?;
        self.finish_work()?;
        Ok(is_started)
    }

    pub(crate) fn begin_step(&mut self, label: &str) {
        if self.options.history {
            self.history.begin(label, &mut self.editor);
        }
    }

    /// Computes the coarser levels of what has changed; returns how many pages that changes.
    fn finish_step(&mut self, changes: Changes, channels: &[usize]) -> Result<usize, PaintError> {
        let count = self.finish_changes(changes, channels)?;
        self.finish_history()?;
        Ok(count)
    }

    /// The same, with more of the step to come.
    pub(crate) fn finish_changes(
        &mut self,
        changes: Changes,
        channels: &[usize],
    ) -> Result<usize, PaintError> {
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
            let results = work.run(&mut self.maps)?;
            count += self.apply_levels(results)?.len();
        }
        Ok(count)
    }

    fn level_work(&self, changes: Changes, channels: &[usize]) -> LevelWork {
        LevelWork {
            surface: Arc::clone(&self.surface),
            pages: self.editor.snapshot(),
            groups: changes.0.into_iter().collect(),
            channels: channels.to_vec(),
            budget_bytes: self.options.memory_bytes / 4,
        }
    }

    pub(crate) fn finish_history(&mut self) -> Result<(), PaintError> {
        if self.options.history { self.history.finish(&mut self.editor) } else { Ok(()) }
    }

    /// Puts coarser levels in their places; returns the pages, channel by channel.
    fn apply_levels(&mut self, results: LevelResults) -> Result<Vec<PageId>, PaintError> {
        let mut ids = Vec::new();
        for (group, result) in results {
            for change in result.pages {
                let PageChange { id, channel, before, after } = change;
                ids.push(id);
                let channels = vec![(channel, before, after.clone())];
                self.remember(PageStep { id, channels, is_first_layered: false })?;
                self.editor.replace(id, channel, after)?;
            }
            for (channel, mean) in result.means {
                let before = self.editor.mean(channel, group);
                self.editor.set_mean(channel, group, mean);
                // As it is stored, so that it comes back exactly.
                let after = self.editor.mean(channel, group);
                if self.options.history {
                    self.history.add_mean(channel, group, before, after);
                }
            }
        }
        Ok(ids)
    }

    /// Enters a page's change into the history.
    pub(crate) fn remember(&mut self, change: PageStep) -> Result<(), PaintError> {
        if self.options.history {
            self.history.add_page(change, &mut self.editor)?;
        }
        self.relieve()
    }

    /// Changes an attachment of the layers and enters that into the history.
    pub(crate) fn attach(&mut self, name: &str, contents: Vec<u8>) -> Result<(), PaintError> {
        let before = self.editor.attachment(name)?.unwrap_or_default();
        self.editor.attach(name, contents)?;
        self.remember_attachment(name, before)?;
        self.relieve()
    }

    fn remember_attachment(&mut self, name: &str, before: Vec<u8>) -> Result<(), PaintError> {
        if self.options.history {
            let after = self.editor.attachment(name)?.unwrap_or_default();
            if before != after {
                self.history.add_attachment(name, before, after, &mut self.editor)?;
            }
        }
        Ok(())
    }

    /// True where this stroke has put the base of a page aside: then it is the page as it was.
    fn is_new_base(&self, id: PageId, originals: &[Vec<u8>], affected: &[usize]) -> Result<bool, PaintError> {
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
    pub(crate) fn relieve(&mut self) -> Result<(), PaintError> {
        if self.editor.pending_bytes() > self.options.memory_bytes / 4 {
            // What another thread reads must stay where it is.
            self.finish_levels()?;
            self.room.relieve(&mut self.editor, self.options.memory_bytes / 4)?;
        }
        Ok(())
    }
}
