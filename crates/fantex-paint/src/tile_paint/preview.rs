//! Coarser levels while a stroke is open: a model that is seen from afar shows these.

use std::collections::{BTreeMap, BTreeSet};

use fantex_store::{PageId, page_origin};
use rayon::prelude::*;

use super::levels::{CoarserLevels, Dirty, LevelJob, dirty_levels, pages_read};
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
    /// are pages of level 0, by [`show`](Self::show).
    pub fn preview(&mut self, shown: &[PageId]) -> Result<Vec<PreviewPage>, PaintError> {
        let Some(stroke) = &self.stroke else { return Ok(Vec::new()) };
        let groups: BTreeSet<u32> = shown.iter().map(|id| id.group).collect();
        let mut jobs: Vec<(u32, Vec<Dirty>)> = Vec::with_capacity(groups.len());
        for group in groups {
            let mut finest = Dirty::new();
            for (id, touched) in stroke.pages.touched(group) {
                finest.insert(id.page, touched.moved(page_origin(id.page)));
            }
            jobs.push((group, dirty_levels(&self.surface, group, finest)));
        }
        let surface = &*self.surface;
        let ids: Vec<PageId> =
            jobs.iter().flat_map(|(group, levels)| pages_read(surface, *group, levels)).collect();
        let maps = self.maps.get(surface, &ids, self.options.memory_bytes / 4);
        let maps: BTreeMap<_, _> = ids.into_iter().zip(maps).collect();
        let (editor, affected) = (&self.editor, &stroke.affected);
        let results: Vec<CoarserLevels> = jobs
            .par_iter()
            .map(|(group, levels)| {
                let mut result = CoarserLevels::default();
                for &channel in affected {
                    let job = LevelJob { surface, editor, group: *group, channel, maps: &maps };
                    job.run(levels, &mut result)?;
                }
                Ok(result)
            })
            .collect::<Result<_, PaintError>>()?;
        let pages = results.into_iter().flat_map(|result| result.pages);
        Ok(pages.map(|page| PreviewPage { id: page.id, channel: page.channel, bytes: page.after }).collect())
    }
}
