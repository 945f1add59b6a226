//! What a commit keeps of a stroke that is open: a step of the history, in case nobody ends the stroke.

use std::collections::BTreeSet;

use fantex_base::Result;
use fantex_store::{PageId, page_extent, page_grid};
use serde::{Deserialize, Serialize};

use crate::error::{damaged, encoded};
use crate::painter::OpenStroke;
use crate::steps::Changes;
use crate::texel_page::Rect;
use crate::work::{KEPT, Kept};
use crate::{HistoryStep, Painter, Target};

/// As it is kept in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct KeptStroke {
    /// It is not among those that can be undone yet; none where no history is kept.
    pub(crate) step: Option<HistoryStep>,
    channels: Vec<usize>,
    is_base: bool,
    /// Group, column and row of the pages of level 0 that it has changed: their coarser levels are not made yet.
    pages: Vec<[u32; 3]>,
}

impl Painter {
    /// Keeps what the open stroke has done so far, instead of what was kept of it before.
    pub(crate) fn keep_stroke(&mut self) -> Result<()> {
        self.drop_kept_stroke();
        let Some(stroke) = self.stroke.take() else { return Ok(()) };
        let kept = self.record_so_far(&stroke);
        match kept {
            Ok(_) => self.history.take_up(None),
            Err(_) => self.history.drop_open(&mut self.editor),
        }
        self.stroke = Some(stroke);
        let bytes = encoded(&Kept::Stroke(kept?))?;
        self.editor.attach(KEPT, bytes)?;
        self.kept.push(KEPT.to_owned());
        Ok(())
    }

    fn record_so_far(&mut self, stroke: &OpenStroke) -> Result<KeptStroke> {
        if self.options.history {
            self.history.begin_beside(&stroke.label);
        }
        let mut pages = Vec::new();
        for id in stroke.pages.ids() {
            let Some(page) = stroke.pages.get(id)? else { continue };
            if !page.originals.is_empty() {
                pages.push([id.group, id.page[0], id.page[1]]);
            }
            self.remember_page(stroke, id, &page)?;
            self.relieve()?;
        }
        // It is logged once more, under the same number, when it ends.
        let number = self.next_stroke;
        let logged = self.log_stroke(stroke);
        self.next_stroke = number;
        self.kept.extend(logged?);
        let step = self.history.keep_open(&mut self.editor)?;
        self.kept.extend(step.iter().flat_map(HistoryStep::part_names));
        let (channels, is_base) = (stroke.affected.clone(), stroke.target == Target::Base);
        Ok(KeptStroke { step, channels, is_base, pages })
    }

    /// Drops what was kept of the open stroke: it has gone on.
    pub(crate) fn drop_kept_stroke(&mut self) {
        for name in std::mem::take(&mut self.kept) {
            self.editor.detach(&name);
        }
    }

    /// Ends a stroke that was open when the asset was last committed, as far as it had come.
    pub(crate) fn end_kept_stroke(&mut self, kept: KeptStroke) -> Result<()> {
        let KeptStroke { step, channels, is_base, pages } = kept;
        let asset = self.editor.asset();
        let mut changes = Changes { is_base, ..Changes::default() };
        let pages: BTreeSet<[u32; 3]> = pages.into_iter().collect();
        for [group, column, row] in pages {
            let extent = asset.cover().groups.get(group as usize).map(|group| group.level_extent(0));
            let is_there = |extent: &[u32; 2]| {
                let [columns, rows] = page_grid(*extent);
                column < columns && row < rows
            };
            let Some(extent) = extent.filter(is_there) else {
                return Err(damaged(asset, "history", "an open stroke is on pages that cannot be there"));
            };
            let page = [column, row];
            // What exactly has changed is not known any more.
            changes.add(PageId { group, level: 0, page }, Rect::of(page_extent(extent, page)));
        }
        channels.iter().try_for_each(|&channel| self.check_channel(channel))?;
        match step {
            Some(_) => self.history.forget_undone(&mut self.editor),
            // Earlier steps would not fit what nothing tells of.
            None => self.forget_history(),
        }
        self.history.take_up(step);
        // Texels that cannot be read keep nobody from opening the asset: its coarser levels stay as they are.
        self.finish_changes(changes, &channels).unwrap_or_default();
        self.history.finish(&mut self.editor)?;
        self.editor.detach(KEPT);
        Ok(())
    }
}
