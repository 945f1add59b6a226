//! Work that takes long on a large asset: filling, evaluating layers on all pages, taking back steps that changed them.
//!
//! ```text
//!  start --> Work --work_on(until)--> ... --> done, one step of the history
//!              |                       |
//!              |                 cancel_work: takes back what is done so far
//!            commit keeps it in the asset: whoever opens that next goes on
//! ```
//!
//! It is done in slices, group by group with all levels, so that a window can answer between them, show what is finished and
//! commit. Doing it at once (as [`Painter::edit_layers`] and [`Painter::undo`] do) takes the same slices to the end. Memory is bounded
//! by a slice. A commit in the middle holds texels, the records that undo them, and an attachment that says what is left.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use fantex_base::Result;
use fantex_store::{PageCache, PageId, page_extent};
use glam::Vec4;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::composite::look_up;
use crate::cover::{cover_texels, fill_page, for_each_page};
use crate::error::{damaged, encoded};
use crate::fill::{ColorSearch, Reached};
use crate::history::Direction;
use crate::kept_stroke::KeptStroke;
use crate::layers::{Layers, ShownPage, find_folders, keep_folders};
use crate::log::{self, logged_fill};
use crate::painter::{OpenStroke, sizes};
use crate::projection::see_through;
use crate::steps::Changes;
use crate::stroke_page::StrokePage;
use crate::texel_page::{Rect, TexelPage};
use crate::{ColorFill, FillArea, HistoryStep, Layer, Painter, StrokeSummary, Surface, Target};

pub(crate) const KEPT: &str = "history/unfinished";

#[derive(Debug)]
pub(crate) enum Work {
    /// A stroke fills.
    Fill(Box<FillWork>),
    /// Layers have changed.
    Flatten(FlattenWork),
    /// A step is taken back or done again.
    Step(StepWork),
}

/// How far work is.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkProgress {
    /// Its name in the history.
    pub label: String,
    /// 0..1.
    pub share: f32,
    /// Whether it takes something back.
    pub is_undo: bool,
}

/// As it is kept in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum Kept {
    Stroke(KeptStroke),
    Fill(KeptFill),
    Flatten(KeptFlatten),
    Step(StepWork),
}

impl Painter {
    /// Whether there is unfinished work. Strokes, steps and changes of layers finish it first.
    pub fn has_work(&self) -> bool {
        self.work.is_some()
    }

    /// How far it is; none where there is none.
    pub fn work_progress(&self) -> Option<WorkProgress> {
        let (label, share, is_undo) = match self.work.as_ref()? {
            Work::Fill(work) => (&work.stroke.label, work.slices.share(), false),
            Work::Flatten(work) => (&work.label, work.slices.share(), false),
            Work::Step(work) => (&work.step.label, work.share(), work.direction == Direction::Back),
        };
        Some(WorkProgress { label: label.clone(), share, is_undo })
    }

    /// Goes on until a moment (a slice more, at least one); true where nothing is left to do.
    ///
    /// # Errors
    /// A page cannot be read, evaluated or kept. What is left stays to be done.
    pub fn work_on(&mut self, until: Instant) -> Result<bool> {
        while let Some(work) = self.work.take() {
            match work {
                Work::Fill(work) => drop(self.fill_on(work)?),
                Work::Flatten(work) => self.flatten_on(work)?,
                Work::Step(work) => self.step_on(work)?,
            }
            if Instant::now() >= until {
                break;
            }
        }
        Ok(self.work.is_none())
    }

    /// Does all that is left.
    ///
    /// # Errors
    /// As [`work_on`](Self::work_on).
    pub fn finish_work(&mut self) -> Result<()> {
        while !self.work_on(Instant::now())? {}
        Ok(())
    }

    /// Gives the work up: what it has done so far is taken back, which is work, too.
    ///
    /// # Errors
    /// The history cannot be written.
    pub fn cancel_work(&mut self) -> Result<()> {
        match self.work.take() {
            Some(Work::Step(work)) => self.work = Some(Work::Step(work.turned_back())),
            // There is no way back but to the end and from there.
            work if !self.options.history => self.work = work,
            Some(Work::Fill(_) | Work::Flatten(_)) => self.take_back()?,
            None => {}
        }
        Ok(())
    }

    /// Ends the open step, and begins to take it back if there is something in it.
    pub(crate) fn take_back(&mut self) -> Result<()> {
        self.room.let_go();
        let open = self.history.open_number();
        self.history.finish(&mut self.editor)?;
        let last = self.history.next_step(Direction::Back);
        if let Some(step) = last.filter(|step| Some(step.id) == open).cloned() {
            self.work = Some(Work::Step(StepWork::new(step, Direction::Back, Afterwards::Forget)));
        }
        Ok(())
    }

    /// Does what is seen first: groups of less urgency come later.
    pub fn prefer_groups(&mut self, urgency: impl Fn(u32) -> f32) {
        match &mut self.work {
            Some(Work::Fill(work)) => work.slices.prefer(urgency),
            Some(Work::Flatten(work)) => work.slices.prefer(urgency),
            Some(Work::Step(_)) | None => {}
        }
    }

    pub(crate) fn keep_work(&mut self) -> Result<()> {
        let kept = match &self.work {
            None if self.stroke.is_some() => return self.keep_stroke(),
            None if self.editor.has_attachment(KEPT) => {
                self.editor.detach(KEPT);
                return Ok(());
            }
            None => return Ok(()),
            Some(Work::Fill(work)) => Kept::Fill(work.kept(self.history.keep_open(&mut self.editor)?)),
            Some(Work::Flatten(work)) => {
                let step = self.history.keep_open(&mut self.editor)?;
                Kept::Flatten(work.kept(step, self.editor.asset().path()))
            }
            Some(Work::Step(work)) => Kept::Step(work.clone()),
        };
        let bytes = encoded(&kept)?;
        self.editor.attach(KEPT, bytes)
    }

    /// Takes up what was left when the asset was last committed.
    pub(crate) fn take_up_work(&mut self) -> Result<()> {
        let Some(bytes) = self.editor.attachment(KEPT)? else { return Ok(()) };
        let kept: Kept = serde_json::from_slice(&bytes).map_err(|_| {
            damaged(self.editor.asset(), "history", "what was left to be done cannot be read")
        })?;
        self.check_kept(&kept)?;
        self.work = Some(match kept {
            Kept::Stroke(kept) => return self.end_kept_stroke(kept),
            Kept::Fill(kept) => {
                self.history.take_up(kept.step.clone());
                match self.fill_left(&kept) {
                    Ok(Some(work)) => Work::Fill(Box::new(work)),
                    // Nothing tells what it did.
                    Ok(None) | Err(_) if kept.step.is_none() => return Ok(()),
                    // It cannot go on, or a layer over it cannot be shown: that can be hidden or corrected once the asset is open.
                    Ok(None) | Err(_) => return self.take_back(),
                }
            }
            Kept::Flatten(kept) => {
                let are_read = self.fills.update(&self.surface, &self.layers);
                self.history.take_up(kept.step.clone());
                match (are_read, &kept.step) {
                    (Ok(()), _) => {}
                    // Where a texture cannot be read any more, layers are as they were before.
                    (Err(_), Some(_)) => return self.take_back(),
                    // Nothing tells how they were. All is evaluated when the layer is hidden or corrected.
                    (Err(_), None) => return Ok(()),
                }
                Work::Flatten(self.flatten_left(kept))
            }
            Kept::Step(work) => Work::Step(work),
        });
        Ok(())
    }

    /// Refuses steps that cannot have been kept.
    fn check_kept(&self, kept: &Kept) -> Result<()> {
        let history = &self.history;
        let can_be_there = match kept {
            Kept::Stroke(kept) => history.may_be_beside(kept.step.as_ref()),
            Kept::Fill(kept) => history.may_be_beside(kept.step.as_ref()),
            Kept::Flatten(kept) => history.may_be_beside(kept.step.as_ref()),
            Kept::Step(work) => {
                let known = history.done().iter().chain(history.undone());
                let mut same = known.filter(|step| step.id == work.step.id);
                work.left.end.max(work.count) <= work.step.parts
                    && same.any(|step| work.step.parts <= step.parts)
            }
        };
        match can_be_there {
            true => Ok(()),
            false => Err(damaged(self.editor.asset(), "history", "its unfinished step cannot be there")),
        }
    }

    /// Takes back the last step, or does the next one again; false where there is none.
    fn start_step(&mut self, direction: Direction) -> Result<bool> {
        self.finish_work()?;
        self.end()?;
        let Some(step) = self.history.next_step(direction).cloned() else { return Ok(false) };
        self.work = Some(Work::Step(StepWork::new(step, direction, Afterwards::Move)));
        Ok(true)
    }

    /// Begins to take the last step back; false where there is none. The work is to be done by [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// What is open cannot be ended.
    pub fn start_undo(&mut self) -> Result<bool> {
        self.start_step(Direction::Back)
    }

    /// Begins to do again what was taken back last; false where there is nothing. The work is to be done by
    /// [`work_on`](Self::work_on).
    ///
    /// # Errors
    /// What is open cannot be ended.
    pub fn start_redo(&mut self) -> Result<bool> {
        self.start_step(Direction::Forth)
    }
}

// Pages of level 0 that work goes over, group by group.

/// Pages that are worked on at a time: enough for all threads, and so few that a window can answer soon.
const BATCH: usize = 16;

/// What is left of the pages, and what is at work: some groups with about a batch of pages, or one with more.
#[derive(Debug, Default)]
pub(crate) struct Slices {
    /// Groups that are left with their pages, the next one last.
    left: Vec<(u32, Vec<PageId>)>,
    groups: Vec<u32>,
    pages: Vec<PageId>,
    /// So many of these are done.
    done: usize,
    pub(crate) changes: Changes,
    /// All pages, and those that are done.
    all_pages: usize,
    all_done: usize,
}

/// As it is kept in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct KeptSlices {
    /// Groups that are left, in runs: the first one and how many.
    left: Vec<[u32; 2]>,
    /// Groups that are at work.
    current: Vec<u32>,
    done: usize,
}

impl Slices {
    /// All pages, ascending.
    pub(crate) fn new(pages: &[PageId]) -> Self {
        let left = by_group(pages).into_iter().rev().collect();
        Self { left, all_pages: pages.len(), ..Self::default() }
    }

    /// What was left of the same pages when it was kept.
    pub(crate) fn left(surface: &Surface, pages: &[PageId], kept: &KeptSlices) -> Self {
        let mut groups = by_group(pages);
        let current: Vec<PageId> =
            kept.current.iter().flat_map(|group| groups.remove(group).unwrap_or_default()).collect();
        let is_left = |group: u32| {
            let run = kept.left.partition_point(|[first, _]| *first <= group);
            run > 0 && group - kept.left[run - 1][0] < kept.left[run - 1][1]
        };
        let left: Vec<_> = groups.into_iter().rev().filter(|(group, _)| is_left(*group)).collect();
        let done = kept.done.min(current.len());
        let mut changes = Changes::default();
        for &id in &current[..done] {
            // Their coarser levels are still to be computed. What exactly has changed is not known any more.
            let extent = surface.cover().groups[id.group as usize].level_extent(0);
            changes.add(id, Rect::of(page_extent(extent, id.page)));
        }
        let all_done =
            pages.len() - current.len() - left.iter().map(|(_, pages)| pages.len()).sum::<usize>() + done;
        let (groups, all_pages) = (kept.current.clone(), pages.len());
        Self { left, groups, pages: current, done, changes, all_pages, all_done }
    }

    pub(crate) fn kept(&self) -> KeptSlices {
        let mut left: Vec<u32> = self.left.iter().map(|(group, _)| *group).collect();
        left.sort_unstable();
        let mut runs: Vec<[u32; 2]> = Vec::new();
        for group in left {
            match runs.last_mut() {
                Some([first, count]) if *first + *count == group => *count += 1,
                _ => runs.push([group, 1]),
            }
        }
        KeptSlices { left: runs, current: self.groups.clone(), done: self.done }
    }

    pub(crate) fn share(&self) -> f32 {
        self.all_done as f32 / self.all_pages.max(1) as f32
    }

    /// Groups of less urgency come later.
    fn prefer(&mut self, urgency: impl Fn(u32) -> f32) {
        self.left.sort_by_cached_key(|(group, _)| (ordered(urgency(*group)), std::cmp::Reverse(*group)));
    }

    /// The pages to be done now; none where all are done. (A slice whose pages are done but not its coarser levels gives an empty
    /// batch.)
    pub(crate) fn batch(&mut self) -> Option<Vec<PageId>> {
        while self.groups.is_empty() || self.pages.len() < BATCH {
            let fits = |(_, pages): &mut (u32, Vec<PageId>)| {
                self.pages.is_empty() || self.pages.len() + pages.len() <= BATCH
            };
            // One that is under way is not added to.
            let Some((group, pages)) = (self.done == 0).then(|| self.left.pop_if(fits)).flatten() else {
                break;
            };
            self.groups.push(group);
            self.pages.extend(pages);
        }
        let to = self.pages.len().min(self.done + BATCH);
        (!self.groups.is_empty()).then(|| self.pages[self.done..to].to_vec())
    }
}

impl Painter {
    /// A batch is done; with the last one of its groups come their coarser levels: returns how many pages these are.
    fn end_batch(&mut self, slices: &mut Slices, count: usize, channels: &[usize]) -> Result<usize> {
        slices.done += count;
        slices.all_done += count;
        if slices.done < slices.pages.len() {
            return Ok(0);
        }
        let coarser = self.finish_changes(slices.changes.clone(), channels)?;
        (slices.done, slices.changes) = (0, Changes::default());
        slices.groups.clear();
        slices.pages.clear();
        Ok(coarser)
    }
}

fn by_group(pages: &[PageId]) -> BTreeMap<u32, Vec<PageId>> {
    let mut groups: BTreeMap<u32, Vec<PageId>> = BTreeMap::new();
    for &id in pages {
        groups.entry(id.group).or_default().push(id);
    }
    groups
}

/// Floats in the order of numbers.
fn ordered(x: f32) -> i32 {
    let bits = x.to_bits() as i32;
    if bits < 0 { bits ^ i32::MAX } else { bits }
}

// Filling, page by page.
//
// Each page is painted once, from what was there before, so whoever takes up a fill must know exactly which pages are done. What it
// paints is then read from the log of strokes; where that does not say it (what was seen before the fill is gone), the fill is
// taken back instead.

#[derive(Debug)]
pub(crate) struct FillWork {
    stroke: OpenStroke,
    /// Its number in the log.
    logged: u64,
    area: Area,
    slices: Slices,
    summary: StrokeSummary,
}

/// As it is kept in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct KeptFill {
    label: String,
    /// None where no history is kept.
    step: Option<HistoryStep>,
    target: Target,
    logged: u64,
    slices: KeptSlices,
}

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
    fn kept(&self, step: Option<HistoryStep>) -> KeptFill {
        let OpenStroke { label, target, .. } = &self.stroke;
        KeptFill {
            label: label.clone(),
            step,
            target: *target,
            logged: self.logged,
            slices: self.slices.kept(),
        }
    }
}

impl Painter {
    /// Lets the open stroke, beside what its dabs have covered, cover an area, and ends it. Does nothing where none is open.
    ///
    /// # Errors
    /// A page cannot be read, painted or kept. What is left stays to be done.
    pub fn fill(&mut self, area: FillArea) -> Result<StrokeSummary> {
        self.start_fill(area)?;
        let mut summary = StrokeSummary::default();
        while let Some(Work::Fill(work)) = self.work.take_if(|work| matches!(work, Work::Fill(_))) {
            summary = self.fill_on(work)?;
        }
        Ok(summary)
    }

    /// The same, but what is covered is left to [`work_on`](Self::work_on); the stroke is not open any more. Where the area is
    /// chosen by colour, commits first (unless the disk is full), so that what is compared is what is seen, what the open
    /// stroke has painted so far included.
    ///
    /// # Errors
    /// There is no such channel, or the commit or the log fails: then the stroke is [abandoned](Self::abandon).
    pub fn start_fill(&mut self, area: FillArea) -> Result<()> {
        if self.stroke.is_none() {
            return Ok(());
        }
        self.begin_fill(area).inspect_err(|_| {
            // Where its pages cannot be read it stays open, and whoever ends it is told.
            self.abandon().unwrap_or_default();
        })
    }

    /// Where that fails the stroke stays open.
    fn begin_fill(&mut self, area: FillArea) -> Result<()> {
        let area = self.place_area(area)?;
        // Of the step before.
        self.finish_levels()?;
        let Some(mut stroke) = self.stroke.take() else { return Ok(()) };
        self.drop_kept_stroke();
        stroke.recording.lose();
        let mut pages = area.pages(self);
        pages.extend(stroke.pages.ids());
        let pages: Vec<PageId> = pages.into_iter().collect();
        self.begin_step(&stroke.label);
        let logged = self.next_stroke;
        if let Err(error) = self.log_stroke(&stroke) {
            self.reopen(stroke, logged);
            return Err(error);
        }
        let (slices, summary) =
            (Slices::new(&pages), StrokeSummary { dabs: stroke.dabs, ..StrokeSummary::default() });
        self.work = Some(Work::Fill(Box::new(FillWork { stroke, logged, area, slices, summary })));
        Ok(())
    }

    fn place_area(&mut self, area: FillArea) -> Result<Area> {
        let (channel, starts, fill) = match area {
            FillArea::Everything => return Ok(Area::Everything),
            FillArea::Triangles(triangles) => return Ok(Area::Triangles(triangles)),
            FillArea::Color { channel, starts, fill } => (channel, starts, fill),
        };
        self.check_channel(channel)?;
        let before = self.state_before()?;
        let (surface, budget) = (&*self.surface, self.options.budget());
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
        let reached = reached.collect();
        self.add_damage(before.damage());
        Ok(Area::Reached(reached))
    }

    /// Fills some pages, or ends the groups that are at work; returns what is done so far.
    fn fill_on(&mut self, mut work: Box<FillWork>) -> Result<StrokeSummary> {
        let Some(ids) = work.slices.batch() else {
            self.add_damage(work.stroke.damage());
            if let Area::Like { before, .. } = &work.area {
                self.add_damage(before.damage());
            }
            self.room.let_go();
            self.history.finish(&mut self.editor)?;
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

    /// All that can fail because of the asset comes before the first change: a page is painted once or not at all. What dabs have
    /// gathered stays as it is, so that it is still there where that fails.
    fn fill_pages(&mut self, work: &mut FillWork, ids: &[PageId]) -> Result<()> {
        let maps = self.maps.get(&self.surface, ids, self.options.budget());
        let with_dabs = |((id, texels), map): ((PageId, usize), &Arc<TexelPage>)| {
            let page = work.stroke.pages.get(id)?;
            let page = page.map_or_else(|| StrokePage::new(texels), Cow::into_owned);
            Ok((id, page, Arc::clone(map)))
        };
        let mut pages: Vec<(PageId, StrokePage, Arc<TexelPage>)> =
            sizes(ids, &maps).zip(&maps).map(with_dabs).collect::<Result<_>>()?;
        let (surface, area) = (&*self.surface, &work.area);
        let paint = &work.stroke.paint;
        pages.par_iter_mut().for_each(|(id, page, map)| {
            area.cover(surface, map, *id, page);
            see_through(surface, map, paint, page);
        });
        pages.retain(|(_, page, _)| !page.touched.is_empty());
        for (id, page, _) in &mut pages {
            work.stroke.begin_page(&self.editor, *id, page)?;
        }
        work.slices.changes.is_base = work.stroke.target == Target::Base;
        let (editor, layers, stroke) = (&self.editor, (&self.layers, &self.fills), &work.stroke);
        let shown_page = |(id, page, map): &(PageId, StrokePage, Arc<TexelPage>)| {
            if page.stale.is_empty() {
                // Nothing but what dabs have covered, which is shown already.
                return Ok(ShownPage::default());
            }
            stroke.shown(surface, editor, layers, map, *id, page)
        };
        let shown: Vec<ShownPage> = pages.par_iter().map(shown_page).collect::<Result<_>>()?;
        for ((id, page, _), shown) in pages.into_iter().zip(shown) {
            work.summary.pages += 1;
            let changed = work.stroke.changed(&self.surface, self.editor.asset(), id, page.touched);
            work.slices.changes.add(id, changed);
            shown.put(&mut self.editor, id, &work.stroke.affected)?;
            self.remember_page(&work.stroke, id, &page)?;
        }
        Ok(())
    }

    /// What was left of a fill when the asset was committed; none where it cannot go on.
    fn fill_left(&mut self, kept: &KeptFill) -> Result<Option<FillWork>> {
        let Some((paint, area)) = logged_fill(self, kept.logged) else { return Ok(None) };
        // What it compares or reads is not there any more.
        if paint.tool.reads_surface() || matches!(area, FillArea::Color { .. }) {
            return Ok(None);
        }
        let area = self.place_area(area)?;
        self.begin_on(kept.target, &kept.label, paint)?;
        let Some(stroke) = self.stroke.take() else { return Ok(None) };
        let pages: Vec<PageId> = area.pages(self).into_iter().collect();
        let slices = Slices::left(&self.surface, &pages, &kept.slices);
        let (logged, summary) = (kept.logged, StrokeSummary::default());
        Ok(Some(FillWork { stroke, logged, area, slices, summary }))
    }
}

// Evaluating layers, after they have changed, on all pages that they show on.

#[derive(Debug)]
pub(crate) struct FlattenWork {
    label: String,
    before: Vec<Layer>,
    pub(crate) slices: Slices,
}

/// As it is kept in an asset.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct KeptFlatten {
    label: String,
    /// None where no history is kept.
    step: Option<HistoryStep>,
    before: Vec<Layer>,
    slices: KeptSlices,
}

impl FlattenWork {
    /// All pages of level 0 that are to be flattened, ascending.
    pub(crate) fn new(label: &str, before: Vec<Layer>, pages: &[PageId]) -> Self {
        Self { label: label.to_owned(), before, slices: Slices::new(pages) }
    }

    fn kept(&self, step: Option<HistoryStep>, asset: &Path) -> KeptFlatten {
        let mut before = self.before.clone();
        keep_folders(&mut before, asset);
        KeptFlatten { label: self.label.clone(), step, before, slices: self.slices.kept() }
    }
}

impl Painter {
    /// Flattens some pages, or ends the groups that are at work.
    fn flatten_on(&mut self, mut work: FlattenWork) -> Result<()> {
        let Some(ids) = work.slices.batch() else { return self.history.finish(&mut self.editor) };
        let channels: Vec<usize> = (0..self.editor.asset().channels().len()).collect();
        let done = self
            .flatten_pages(&ids, &mut work.slices.changes)
            .and_then(|()| self.end_batch(&mut work.slices, ids.len(), &channels).map(drop));
        self.work = Some(Work::Flatten(work));
        done
    }

    /// What was left of flattening when the asset was committed.
    fn flatten_left(&self, kept: KeptFlatten) -> FlattenWork {
        let mut before = kept.before;
        find_folders(&mut before, self.editor.asset().path());
        let pages = self.pages_to_flatten(&before);
        let slices = Slices::left(&self.surface, &pages, &kept.slices);
        FlattenWork { label: kept.label, before, slices }
    }
}

// Taking a step back, or doing it again: part by part.

/// A step whose parts are being applied; so it is kept in an asset, too.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct StepWork {
    step: HistoryStep,
    direction: Direction,
    /// Parts that are left: forth from the first one, back from the last one.
    left: Range<u32>,
    /// How many there were.
    count: u32,
    afterwards: Afterwards,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Afterwards {
    /// It goes over to the steps that can be done again, or back to those that are done.
    Move,
    /// It stays where it is: moving it was given up.
    Stay,
    /// It is forgotten: what it did was given up.
    Forget,
}

impl StepWork {
    fn new(step: HistoryStep, direction: Direction, afterwards: Afterwards) -> Self {
        let count = step.parts;
        Self { step, direction, left: 0..count, count, afterwards }
    }

    /// The way back to where it started.
    fn turned_back(self) -> Self {
        if self.afterwards != Afterwards::Move {
            return self;
        }
        let done = match self.direction {
            Direction::Forth => 0..self.left.start,
            Direction::Back => self.left.end..self.count,
        };
        let (direction, count) = (self.direction.opposite(), done.len() as u32);
        Self { step: self.step, direction, left: done, count, afterwards: Afterwards::Stay }
    }

    fn share(&self) -> f32 {
        1.0 - self.left.len() as f32 / self.count.max(1) as f32
    }
}

impl Painter {
    fn step_on(&mut self, mut work: StepWork) -> Result<()> {
        let mut left = work.left.clone();
        let next = match work.direction {
            Direction::Forth => left.next(),
            Direction::Back => left.next_back(),
        };
        let Some(part) = next else { return self.end_step(work) };
        let applied = self.history.apply_part(&work.step, part, work.direction, &mut self.editor);
        if applied.is_ok() {
            work.left = left;
        }
        self.work = Some(Work::Step(work));
        applied?;
        self.relieve()
    }

    fn end_step(&mut self, work: StepWork) -> Result<()> {
        match work.afterwards {
            Afterwards::Move => self.history.move_step(work.direction, &mut self.editor)?,
            Afterwards::Stay => {}
            Afterwards::Forget => self.history.forget_last(&mut self.editor)?,
        }
        self.layers = Layers::load(&self.editor)?;
        // It may have brought back strokes of the log.
        self.next_stroke = self.next_stroke.max(log::next_number(&self.editor)?);
        Ok(())
    }
}
