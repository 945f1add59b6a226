//! Coarser levels while a stroke is open: a model that is seen from afar shows these.

use std::collections::BTreeSet;

use fantex_base::Result;
use fantex_store::{PageId, page_origin};

use crate::Target;
use crate::history::PageStep;
use crate::levels::Dirty;
use crate::painter::Painter;

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
    /// are pages of level 0, by [`show`](Self::show).
    ///
    /// # Errors
    /// Pages cannot be read or encoded.
    pub fn preview(&mut self, shown: &[PageId]) -> Result<Vec<PreviewPage>> {
        let Some(stroke) = &self.stroke else { return Ok(Vec::new()) };
        let groups: BTreeSet<u32> = shown.iter().map(|id| id.group).collect();
        let finest = |group: u32| -> Dirty {
            let (surface, asset) = (&self.surface, self.editor.asset());
            let touched = stroke.pages.touched(group);
            let changed = touched.map(|(id, rect)| (id, stroke.changed(surface, asset, id, rect)));
            changed.map(|(id, rect)| (id.page, rect.moved(page_origin(id.page)))).collect()
        };
        let groups = groups.into_iter().map(|group| (group, finest(group))).collect();
        let is_base = stroke.target == Target::Base;
        let mut work = self.level_work(groups, &stroke.affected);
        if is_base {
            // Its coarser levels are those from before the stroke.
            work.layered.clear();
        }
        let mut pages = Vec::new();
        for (group, mut result) in work.run(&self.editor, false, &mut self.maps)? {
            for PageStep { id, channels, .. } in self.page_steps(group, &mut result)? {
                let preview = |(channel, _, bytes)| PreviewPage { id, channel, bytes };
                pages.extend(channels.into_iter().map(preview));
            }
        }
        Ok(pages)
    }
}
