//! Coarser levels while a stroke is open: a model that is seen from afar shows these.

use std::collections::BTreeSet;
use std::sync::Arc;

use fantex_store::{PageId, page_origin};

use super::level_work::LevelWork;
use super::levels::Dirty;
use super::painter::Painter;
use crate::PaintError;

/// A page of a coarser level under an open stroke.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PreviewPage {
    /// Which.
    pub id: PageId,
    /// Which channel of the asset.
    pub channel: usize,
    /// As they are stored.
    pub bytes: Vec<u8>,
}

impl Painter {
    /// The coarser levels of tiles under the open stroke, as [`end`](Self::end) will leave them: to be shown, not kept. `shown`
    /// are pages of level 0, by [`show`](Self::show). Waits for levels of the stroke before.
    pub fn preview(&mut self, shown: &[PageId]) -> Result<Vec<PreviewPage>, PaintError> {
        self.finish_levels()?;
        let Some(stroke) = &self.stroke else { return Ok(Vec::new()) };
        let groups: BTreeSet<u32> = shown.iter().map(|id| id.group).collect();
        let finest = |group: u32| -> Dirty {
            let touched = stroke.pages.touched(group).into_iter();
            touched.map(|(id, rect)| (id.page, rect.moved(page_origin(id.page)))).collect()
        };
        let work = LevelWork {
            surface: Arc::clone(&self.surface),
            pages: self.editor.snapshot(),
            groups: groups.into_iter().map(|group| (group, finest(group))).collect(),
            channels: stroke.affected.clone(),
            budget_bytes: self.options.memory_bytes / 4,
        };
        let pages = work.run(&mut self.maps)?.into_iter().flat_map(|(_, result)| result.pages);
        Ok(pages.map(|page| PreviewPage { id: page.id, channel: page.channel, bytes: page.after }).collect())
    }
}
