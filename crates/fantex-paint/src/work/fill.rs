//! Filling, page by page.
//!
//! Each page is painted once, from what was there before, so whoever takes up a fill must know exactly which pages are done. What it
//! paints is then read from the log of strokes; where that does not say it (what was seen before the fill is gone), the fill is
//! taken back instead.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use fantex_store::{PageCache, PageId};
use glam::Vec4;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::slices::{self, Slices};
use super::{Work, WorkProgress};
use crate::color_fill::{ColorSearch, Reached};
use crate::fill::FillArea;
use crate::history::HistoryStep;
use crate::layers::ShownPage;
use crate::log::logged_fill;
use crate::tile_paint::{
    OpenStroke, StrokePage, TexelPage, cover_texels, fill_page, for_each_page, look_up, see_through,
};
use crate::{ColorFill, PaintError, Painter, StrokeSummary, Surface, Target};

/// A stroke that fills.
#[derive(Debug)]
pub(crate) struct FillWork {
    stroke: OpenStroke,
    /// Its number in the log.
    logged: u64,
    area: Area,
    slices: Slices,
    summary: StrokeSummary,
}

/// The same in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Kept {
    label: String,
    /// None where no history is kept.
    pub(super) step: Option<HistoryStep>,
    target: Target,
    logged: u64,
    slices: slices::Kept,
}

/// What is covered.
#[derive(Debug)]
enum Area {
    Everything,
    /// Ascending.
    Triangles(Vec<u32>),
    /// Whatever looks like one of some values.
    Like {
        before: PageCache,
        channel: usize,
        values: Vec<Vec4>,
        fill: ColorFill,
    },
    /// Texels that were found.
    Reached(Vec<Reached>),
}

impl Area {
    /// Covers a page.
    fn cover(&self, surface: &Surface, map: &TexelPage, id: PageId, page: &mut StrokePage) {
        match self {
            Self::Everything => fill_page(map, |_| true, page),
            Self::Triangles(all) => fill_page(map, |t| all.binary_search(&t).is_ok(), page),
            Self::Like { before, channel, values, fill } => {
                for &start in values {
                    let search = ColorSearch { surface, before, channel: *channel, start, fill: *fill };
                    cover_texels(&search.coverage(map), map, page);
                }
            }
            Self::Reached(all) => {
                let coverage = all.iter().filter_map(|reached| reached.get(&id));
                coverage.for_each(|coverage| cover_texels(coverage, map, page));
            }
        }
    }

    /// The pages that may be covered.
    fn pages(&self, painter: &Painter) -> BTreeSet<PageId> {
        match self {
            Self::Everything | Self::Like { .. } => painter.all_pages().into_iter().collect(),
            Self::Triangles(triangles) => pages_of(&painter.surface, triangles),
            Self::Reached(all) => all.iter().flat_map(BTreeMap::keys).copied().collect(),
        }
    }
}

fn pages_of(surface: &Surface, triangles: &[u32]) -> BTreeSet<PageId> {
    let mut pages = BTreeSet::new();
    let mut last = None;
    for &triangle in triangles {
        for_each_page(surface, triangle, |id| {
            // Neighbours in the mesh mostly lie on the same page.
            if last.replace(id) != Some(id) {
                pages.insert(id);
            }
        });
    }
    pages
}

impl FillWork {
    pub(super) fn progress(&self) -> WorkProgress {
        WorkProgress { label: self.stroke.label.clone(), share: self.slices.share(), is_undo: false }
    }

    pub(super) fn prefer(&mut self, urgency: impl Fn(u32) -> f32) {
        self.slices.prefer(urgency);
    }

    pub(super) fn kept(&self, step: Option<HistoryStep>) -> Kept {
        let OpenStroke { label, target, .. } = &self.stroke;
        Kept { label: label.clone(), step, target: *target, logged: self.logged, slices: self.slices.kept() }
    }
}

impl Painter {
    /// Lets the open stroke, beside what its dabs have covered, cover an area, and ends it. Does nothing where none is open.
    ///
    /// # Errors
    ///
    /// A page cannot be read, painted or kept. What is left stays to be done.
    pub fn fill(&mut self, area: FillArea) -> Result<StrokeSummary, PaintError> {
        self.start_fill(area)?;
        let mut summary = StrokeSummary::default();
        while let Some(work) = self.work.take() {
            match work {
                Work::Fill(work) => summary = self.fill_on(work)?,
                other => {
                    self.work = Some(other);
                    break;
                }
            }
        }
        Ok(summary)
    }

    /// The same, but what is covered is left to [`work_on`](Self::work_on); the stroke is not open any more. Where the area is
    /// chosen by colour, commits first (unless the disk is full), so that what is compared is what is seen; it does not see the
    /// open stroke itself.
    ///
    /// # Errors
    ///
    /// There is no such channel, or the commit or the log fails: then the stroke is dropped.
    pub fn start_fill(&mut self, area: FillArea) -> Result<(), PaintError> {
        if self.stroke.is_none() {
            return Ok(());
        }
        let area = self.place_area(area);
        let Some(mut stroke) = self.stroke.take() else { return Ok(()) };
        let area = area.inspect_err(|_| self.room.let_go())?;
        stroke.recording.lose();
        let mut pages = area.pages(self);
        pages.extend(stroke.pages.ids());
        let pages: Vec<PageId> = pages.into_iter().collect();
        // Of the step before.
        self.finish_levels()?;
        self.begin_step(&stroke.label);
        let logged = self.next_stroke;
        self.log_stroke(&stroke)?;
        let (slices, summary) =
            (Slices::new(&pages), StrokeSummary { dabs: stroke.dabs, ..StrokeSummary::default() });
        self.work = Some(Work::Fill(Box::new(FillWork { stroke, logged, area, slices, summary })));
        Ok(())
    }

    fn place_area(&mut self, area: FillArea) -> Result<Area, PaintError> {
        let (channel, starts, fill) = match area {
            FillArea::Everything => return Ok(Area::Everything),
            FillArea::Triangles(triangles) => return Ok(Area::Triangles(triangles)),
            FillArea::Color { channel, starts, fill } => (channel, starts, fill),
        };
        self.check_channel(channel)?;
        let before = self.state_before()?;
        let (surface, budget) = (&*self.surface, self.options.memory_bytes / 4);
        let values: Vec<Vec4> =
            starts.iter().map(|&start| look_up(surface, &before, channel, start)).collect();
        if !fill.connected {
            return Ok(Area::Like { before, channel, values, fill });
        }
        let maps = &mut self.maps;
        let reached = starts.iter().zip(values).map(|(&point, start)| {
            let search = ColorSearch { surface, before: &before, channel, start, fill };
            search.connected(point, |ids| {
                let ids: Vec<PageId> = ids.iter().copied().collect();
                maps.get(surface, &ids, budget)
            })
        });
        Ok(Area::Reached(reached.collect()))
    }

    /// Fills some pages, or ends the groups that are at work; returns what is done so far.
    pub(super) fn fill_on(&mut self, mut work: Box<FillWork>) -> Result<StrokeSummary, PaintError> {
        let Some(ids) = work.slices.batch() else {
            self.room.let_go();
            self.finish_history()?;
            return Ok(work.summary);
        };
        let filled = self.fill_pages(&mut work, &ids).and_then(|()| {
            let channels = work.stroke.affected.clone();
            work.summary.coarser_pages += self.end_batch(&mut work.slices, ids.len(), &channels)?;
            Ok(())
        });
        let summary = work.summary;
        self.work = Some(Work::Fill(work));
        filled?;
        self.relieve()?;
        Ok(summary)
    }

    /// All that can fail because of the asset comes before the first change: a page is painted once or not at all.
    fn fill_pages(&mut self, work: &mut FillWork, ids: &[PageId]) -> Result<(), PaintError> {
        let maps = self.maps.get(&self.surface, ids, self.options.memory_bytes / 4);
        let mut pages = Vec::with_capacity(ids.len());
        for (&id, map) in ids.iter().zip(maps) {
            let known = work.stroke.pages.take(id)?;
            pages.push((id, known.unwrap_or_else(|| StrokePage::new(map.block.texel_count())), map));
        }
        let (surface, area) = (&*self.surface, &work.area);
        let stencil = work.stroke.paint.stencil.as_deref();
        pages.par_iter_mut().for_each(|(id, page, map)| {
            area.cover(surface, map, *id, page);
            stencil.into_iter().for_each(|stencil| see_through(surface, map, stencil, page));
        });
        pages.retain(|(_, page, _)| !page.touched.is_empty());
        for (id, page, _) in &mut pages {
            if page.originals.is_empty() {
                page.originals = work.stroke.originals(&self.editor, *id)?;
            }
        }
        let (editor, layers, stroke) = (&self.editor, (&self.layers, &self.fills), &work.stroke);
        let shown_page = |(id, page, map): &(PageId, StrokePage, Arc<TexelPage>)| {
            // What dabs have covered may be all, and shown already.
            let is_shown = page.stale.is_empty();
            if is_shown {
                Ok(ShownPage::default())
            } else {
                stroke.shown(surface, editor, layers, map, *id, page)
            }
        };
        let shown: Vec<ShownPage> = pages.par_iter().map(shown_page).collect::<Result<_, PaintError>>()?;
        for ((id, page, _), shown) in pages.into_iter().zip(shown) {
            work.summary.pages += 1;
            work.slices.changes.add(id, page.touched);
            shown.put(&mut self.editor, id, &work.stroke.affected)?;
            self.remember_page(&work.stroke, id, page)?;
        }
        Ok(())
    }

    /// What was left of a fill when the asset was committed; none where it cannot go on.
    pub(super) fn fill_left(&mut self, kept: &Kept) -> Result<Option<FillWork>, PaintError> {
        let Some((paint, area)) = logged_fill(self, kept.logged) else { return Ok(None) };
        // What it compares or reads is not there any more.
        if paint.tool.reads_surface() || matches!(area, FillArea::Color { .. }) {
            return Ok(None);
        }
        self.begin_on(kept.target, &kept.label, paint)?;
        let area = self.place_area(area)?;
        let Some(stroke) = self.stroke.take() else { return Ok(None) };
        let pages: Vec<PageId> = area.pages(self).into_iter().collect();
        let slices = Slices::left(&self.surface, &pages, &kept.slices);
        let (logged, summary) = (kept.logged, StrokeSummary::default());
        Ok(Some(FillWork { stroke, logged, area, slices, summary }))
    }
}
