//! Steps: what a stroke or a change of the layers leaves behind it, coarser levels and the history included.

use std::collections::BTreeMap;

use fantex_base::{Error, Result};
use fantex_store::{PageId, page_origin};

use crate::error::encoded;
use crate::history::PageStep;
use crate::layers::{base_name, page_name};
use crate::levels::Dirty;
use crate::log::{self, Portable, portable};
use crate::painter::OpenStroke;
use crate::stroke_page::StrokePage;
use crate::texel_page::Rect;
use crate::{Painter, StrokeSettings, StrokeSummary, Target};

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
    /// Drops the open stroke: everything is as it was before it, and there is no step in the history. Does nothing where none is open.
    ///
    /// # Errors
    /// What it was before cannot be read: the stroke stays open.
    pub fn abandon(&mut self) -> Result<()> {
        let Some(stroke) = self.stroke.take() else { return Ok(()) };
        if let Err(error) = self.restore(&stroke) {
            self.stroke = Some(stroke);
            return Err(error);
        }
        self.room.let_go();
        self.drop_kept_stroke();
        self.relieve()
    }

    /// Brings what was there before a stroke.
    fn restore(&mut self, stroke: &OpenStroke) -> Result<()> {
        for id in stroke.pages.ids() {
            let Some(page) = stroke.pages.get(id)? else { continue };
            let is_layered = stroke.is_layered(&page);
            let mut originals = page.originals.clone();
            // Never shown: nothing has changed.
            if originals.is_empty() {
                continue;
            }
            if is_layered {
                let before = originals.pop().unwrap_or_default();
                let name = page_name(stroke.target, id);
                match before.is_empty() {
                    true => self.editor.detach(&name),
                    false => self.editor.attach(&name, before)?,
                }
                if page.puts_base_aside {
                    self.editor.detach(&base_name(id));
                }
            }
            for (&channel, before) in stroke.affected.iter().zip(originals) {
                self.editor.replace(id, channel, before)?;
            }
        }
        Ok(())
    }

    /// Shows the open stroke for the last time and enters what it changed at level 0 into the history. Where that fails the stroke
    /// stays open.
    pub(crate) fn close_stroke(&mut self) -> Result<Option<(StrokeSummary, Changes, Vec<usize>)>> {
        self.show()?;
        let Some(stroke) = self.stroke.take() else { return Ok(None) };
        let number = self.next_stroke;
        let changes = match self.record_stroke(&stroke) {
            Ok(changes) => changes,
            Err(error) => {
                self.reopen(stroke, number);
                return Err(error);
            }
        };
        self.add_damage(stroke.damage());
        self.room.let_go();
        let pages = stroke.pages.ids().len();
        let summary = StrokeSummary { dabs: stroke.dabs, pages, coarser_pages: 0 };
        Ok(Some((summary, changes, stroke.affected)))
    }

    /// Opens a stroke again that could not be entered into the history or, as this number, into the log.
    pub(crate) fn reopen(&mut self, stroke: OpenStroke, number: u64) {
        self.history.drop_open(&mut self.editor);
        self.editor.detach(&log::stroke_name(number));
        self.next_stroke = number;
        self.stroke = Some(stroke);
    }

    /// Enters a stroke into the history and the log; what it has changed.
    fn record_stroke(&mut self, stroke: &OpenStroke) -> Result<Changes> {
        self.drop_kept_stroke();
        self.begin_step(&stroke.label);
        let mut changes = Changes { is_base: stroke.target == Target::Base, ..Changes::default() };
        for id in stroke.pages.ids() {
            let Some(page) = stroke.pages.get(id)? else { continue };
            changes.add(id, stroke.changed(&self.surface, self.editor.asset(), id, page.touched));
            self.remember_page(stroke, id, &page)?;
            self.relieve()?;
        }
        self.log_stroke(stroke)?;
        Ok(changes)
    }

    /// Enters into the history what a stroke has changed on a page of level 0.
    pub(crate) fn remember_page(&mut self, stroke: &OpenStroke, id: PageId, page: &StrokePage) -> Result<()> {
        if !self.options.history {
            return Ok(());
        }
        let mut change = PageStep { id, channels: Vec::new(), is_first_layered: page.puts_base_aside };
        if let Some(before) = page.originals.get(stroke.affected.len()) {
            self.remember_attachment(&page_name(stroke.target, id), before.clone())?;
        }
        for (&channel, before) in stroke.affected.iter().zip(&page.originals) {
            change.channels.push((channel, before.clone(), self.editor.read_page_raw(channel, id)?));
        }
        self.history.add_page(change, &mut self.editor)
    }

    /// Logs a stroke; returns the names of the attachments that this makes.
    pub(crate) fn log_stroke(&mut self, stroke: &OpenStroke) -> Result<Vec<String>> {
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
        let mut names = Vec::new();
        for (name, contents) in files {
            // Names are hashes of contents.
            let name = log::file_name(&name);
            if !self.editor.has_attachment(&name) {
                self.attach(&name, contents)?;
                names.push(name);
            }
        }
        names.push(log::stroke_name(self.next_stroke));
        self.log(&settings)?;
        Ok(names)
    }

    /// # Errors
    /// There is no number for another stroke, or the asset cannot be changed.
    pub(crate) fn log(&mut self, settings: &StrokeSettings) -> Result<()> {
        if self.next_stroke >= log::MAX_STROKES {
            let (asset, last) = (self.editor.asset().path().display(), log::MAX_STROKES - 1);
            let sentence = format!(
                "the log of {asset} cannot take another stroke: numbers go up to {last}, which it has"
            );
            return Err(Error::too_large(sentence));
        }
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
        match self.options.history {
            true => self.history.begin(label, &mut self.editor),
            // Its steps would not fit what comes now.
            false => self.forget_history(),
        }
    }

    /// Forgets all steps, and what only they could bring back.
    pub(crate) fn forget_history(&mut self) {
        let had_steps = !self.history.done().is_empty() || !self.history.undone().is_empty();
        self.history.forget_all(&mut self.editor);
        if had_steps {
            self.drop_deleted();
        }
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

    /// Moves changes from memory to the file where they exceed the budget.
    pub(crate) fn relieve(&mut self) -> Result<()> {
        if self.editor.pending_bytes() > self.options.budget() {
            self.room.relieve(&mut self.editor, self.options.budget())?;
        }
        Ok(())
    }
}
