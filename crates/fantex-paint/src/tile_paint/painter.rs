//! The painter: an asset that is being painted on.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use fantex_store::{AssetEditor, CommitSummary, EditOptions, PageId, page_origin};
use rayon::prelude::*;

use super::composite::composite;
use super::cover::{cover_page, fill_page, for_each_page, touched_pages};
use super::levels::{CoarserLevels, Dirty, LevelJob, PageChange, dirty_levels, pages_read};
use super::stroke_page::{StrokePage, StrokePages};
use super::texel_page::TexelPages;
use crate::dab::PlacedDab;
use crate::history::{History, flush_if_possible};
use crate::{Dab, Paint, PaintError, Surface};

/// How to paint.
#[derive(Clone, Debug)]
pub struct PaintOptions {
    /// Memory for pages, bytes: a stroke's coverage, texel maps, changes that are not yet in the file. (Mesh, adjacency and
    /// directory come on top.)
    pub memory_bytes: usize,
    /// Keep what undoes strokes in the asset.
    pub history: bool,
}

impl Default for PaintOptions {
    /// 512 MiB, with history.
    fn default() -> Self {
        Self { memory_bytes: 512 << 20, history: true }
    }
}

/// What a stroke did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StrokeSummary {
    /// Dabs.
    pub dabs: usize,
    /// Pages of level 0 that changed (all channels of a page count as one).
    pub pages: usize,
    /// Pages of coarser levels that changed, per channel.
    pub coarser_pages: usize,
}

/// Pages that are worked on at a time: bounds memory, and keeps all threads busy.
const PAGE_BATCH: usize = 64;

/// Dabs that are placed at a time.
const DAB_BATCH: usize = 128;

/// An asset that is being painted on. Nothing is durable before [`commit`](Self::commit).
#[derive(Debug)]
pub struct Painter {
    surface: Arc<Surface>,
    pub(crate) editor: AssetEditor,
    options: PaintOptions,
    maps: TexelPages,
    pub(crate) history: History,
    stroke: Option<OpenStroke>,
    disk_full: bool,
}

/// A stroke that has begun.
#[derive(Debug)]
struct OpenStroke {
    label: String,
    paint: Paint,
    pages: StrokePages,
    dabs: usize,
}

impl Painter {
    /// Opens an asset for painting.
    pub fn open(path: &Path, options: &PaintOptions) -> Result<Self, PaintError> {
        let editor = AssetEditor::open(path, &EditOptions::default())?;
        let history = History::load(&editor)?;
        let surface = Arc::new(Surface::of(editor.asset()));
        let options = options.clone();
        Ok(Self {
            surface,
            editor,
            options,
            maps: TexelPages::default(),
            history,
            stroke: None,
            disk_full: false,
        })
    }

    /// The surface.
    pub fn surface(&self) -> &Arc<Surface> {
        &self.surface
    }

    /// The asset with all changes, committed or not.
    pub fn editor(&self) -> &AssetEditor {
        &self.editor
    }

    /// Begins a stroke; one that is open ends first. `label` names it in the history.
    pub fn begin(&mut self, label: &str, paint: Paint) -> Result<(), PaintError> {
        self.end()?;
        let count = self.editor.asset().channels().len();
        if let Some(wrong) = paint.channels.iter().find(|painted| painted.channel >= count) {
            return Err(PaintError::NoChannel { channel: wrong.channel, count });
        }
        let (label, pages) = (label.to_owned(), StrokePages::default());
        self.stroke = Some(OpenStroke { label, paint, pages, dabs: 0 });
        Ok(())
    }

    /// Adds dabs to the open stroke, in order. Does nothing where none is open.
    pub fn dab(&mut self, dabs: &[Dab]) -> Result<(), PaintError> {
        let texel = 1.0 / self.surface.cover().density;
        for batch in dabs.chunks(DAB_BATCH) {
            let surface = &*self.surface;
            let placed: Vec<PlacedDab> =
                batch.par_iter().map(|dab| PlacedDab::new(surface, dab, texel)).collect();
            let touched: Vec<(PageId, Vec<u32>)> = touched_pages(surface, &placed).into_iter().collect();
            self.cover(&touched, |surface, map, dabs: &Vec<u32>, page| {
                cover_page(surface, map, dabs.iter().map(|&i| &placed[i as usize]), page);
            })?;
            if let Some(stroke) = &mut self.stroke {
                stroke.dabs += batch.len();
            }
        }
        Ok(())
    }

    /// Covers triangles (ascending) fully. Does nothing where no stroke is open.
    pub fn fill(&mut self, triangles: &[u32]) -> Result<(), PaintError> {
        let mut touched: BTreeMap<PageId, ()> = BTreeMap::new();
        for &triangle in triangles {
            for_each_page(&self.surface, triangle, |id| {
                touched.insert(id, ());
            });
        }
        let touched: Vec<(PageId, ())> = touched.into_iter().collect();
        self.cover(&touched, |_, map, (), page| {
            fill_page(map, |t| triangles.binary_search(&t).is_ok(), page);
        })
    }

    /// Lets `add` change the coverage of pages, in parallel.
    fn cover<T: Sync>(
        &mut self,
        touched: &[(PageId, T)],
        add: impl Fn(&Surface, &super::texel_page::TexelPage, &T, &mut StrokePage) + Sync,
    ) -> Result<(), PaintError> {
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        let budget = self.options.memory_bytes / 4;
        for batch in touched.chunks(PAGE_BATCH) {
            let ids: Vec<PageId> = batch.iter().map(|(id, _)| *id).collect();
            let maps = self.maps.get(&self.surface, &ids, budget);
            let mut pages = Vec::with_capacity(batch.len());
            for (id, map) in ids.iter().zip(&maps) {
                let known = stroke.pages.take(*id)?;
                pages.push(known.unwrap_or_else(|| StrokePage::new(map.block.texel_count())));
            }
            let surface = &*self.surface;
            pages
                .par_iter_mut()
                .zip(batch)
                .zip(&maps)
                .for_each(|((page, (_, with)), map)| add(surface, map, with, page));
            for (id, page) in ids.into_iter().zip(pages) {
                if !page.touched.is_empty() {
                    stroke.pages.put(id, page, budget)?;
                }
            }
        }
        Ok(())
    }

    /// Brings the pages of level 0 up to date with the open stroke, and returns those that changed: for the next frame.
    pub fn show(&mut self) -> Result<Vec<PageId>, PaintError> {
        let Some(stroke) = &mut self.stroke else { return Ok(Vec::new()) };
        let stale = stroke.pages.stale();
        let budget = self.options.memory_bytes / 4;
        for ids in stale.chunks(PAGE_BATCH) {
            let maps = self.maps.get(&self.surface, ids, budget);
            let mut pages = Vec::with_capacity(ids.len());
            for &id in ids {
                let mut page = stroke.pages.take(id)?.unwrap_or_else(|| StrokePage::new(0));
                if page.originals.is_empty() {
                    let channels = stroke.paint.channels.iter();
                    let bytes = channels.map(|painted| self.editor.read_page_raw(painted.channel, id));
                    page.originals = bytes.collect::<Result<_, _>>()?;
                }
                pages.push((id, page));
            }
            let (surface, asset, paint) = (&*self.surface, self.editor.asset(), &stroke.paint);
            let shown: Vec<Vec<Vec<u8>>> = pages
                .par_iter()
                .zip(&maps)
                .map(|((id, page), map)| composite(surface, asset, map, *id, page, paint))
                .collect::<Result<_, _>>()?;
            for ((id, mut page), channels) in pages.into_iter().zip(shown) {
                for (painted, bytes) in stroke.paint.channels.iter().zip(channels) {
                    self.editor.replace(id, painted.channel, bytes)?;
                }
                page.is_stale = false;
                stroke.pages.put(id, page, budget)?;
            }
            if self.editor.pending_bytes() > budget {
                self.disk_full = flush_if_possible(&mut self.editor)?;
            }
        }
        Ok(stale)
    }

    /// Ends the open stroke: shows it, computes coarser levels, and enters it into the history.
    pub fn end(&mut self) -> Result<StrokeSummary, PaintError> {
        self.show()?;
        let Some(mut stroke) = self.stroke.take() else { return Ok(StrokeSummary::default()) };
        let ids = stroke.pages.ids();
        let mut summary = StrokeSummary { dabs: stroke.dabs, pages: ids.len(), coarser_pages: 0 };
        if self.options.history {
            self.history.begin(&stroke.label, &mut self.editor);
        }
        let mut dirty: BTreeMap<u32, Dirty> = BTreeMap::new();
        for &id in &ids {
            let Some(page) = stroke.pages.take(id)? else { continue };
            let rect = page.touched.moved(page_origin(id.page));
            dirty.entry(id.group).or_default().insert(id.page, rect);
            for (painted, before) in stroke.paint.channels.iter().zip(page.originals) {
                let after = self.editor.read_page_raw(painted.channel, id)?;
                self.remember(&PageChange { id, channel: painted.channel, before, after })?;
            }
        }
        let channels: Vec<usize> = stroke.paint.channels.iter().map(|painted| painted.channel).collect();
        let dirty: Vec<(u32, Dirty)> = dirty.into_iter().collect();
        for groups in dirty.chunks(PAGE_BATCH) {
            summary.coarser_pages += self.update_levels(groups, &channels)?;
        }
        if self.options.history {
            self.history.finish(&mut self.editor)?;
        }
        Ok(summary)
    }

    fn update_levels(&mut self, groups: &[(u32, Dirty)], channels: &[usize]) -> Result<usize, PaintError> {
        let surface = Arc::clone(&self.surface);
        let budget = self.options.memory_bytes / 4;
        let jobs: Vec<(u32, Vec<Dirty>)> = groups
            .par_iter()
            .map(|(group, dirty)| (*group, dirty_levels(&surface, *group, dirty.clone())))
            .collect();
        let ids: Vec<PageId> =
            jobs.iter().flat_map(|(group, levels)| pages_read(&surface, *group, levels)).collect();
        let maps = self.maps.get(&surface, &ids, budget);
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
                if self.options.history {
                    self.history.add_mean(channel, *group, self.editor.mean(channel, *group), mean);
                }
                self.editor.set_mean(channel, *group, mean);
            }
        }
        Ok(count)
    }

    fn remember(&mut self, change: &PageChange) -> Result<(), PaintError> {
        if self.options.history {
            self.history.add_page(
                change.id,
                change.channel,
                &change.before,
                &change.after,
                &mut self.editor,
            )?;
        }
        self.relieve()
    }

    /// Moves changes from memory to the file where they exceed the budget.
    fn relieve(&mut self) -> Result<(), PaintError> {
        if self.editor.pending_bytes() > self.options.memory_bytes / 4 {
            self.disk_full = flush_if_possible(&mut self.editor)?;
        }
        Ok(())
    }

    /// True where the disk had no room for changes when memory was last to be relieved: they stay in memory, nothing is
    /// lost, and [`commit`](Self::commit) will tell whether there is room again.
    pub fn is_disk_full(&self) -> bool {
        self.disk_full
    }

    /// What can be undone and redone.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Takes the last stroke back; false where there is none. An open stroke ends first.
    pub fn undo(&mut self) -> Result<bool, PaintError> {
        self.end()?;
        self.history.undo(&mut self.editor)
    }

    /// Does what was taken back last again; false where there is nothing.
    pub fn redo(&mut self) -> Result<bool, PaintError> {
        self.end()?;
        self.history.redo(&mut self.editor)
    }

    /// Makes everything durable, an open stroke (without its coarser levels) included.
    pub fn commit(&mut self) -> Result<CommitSummary, PaintError> {
        self.show()?;
        let summary = self.editor.commit()?;
        self.disk_full = false;
        Ok(summary)
    }
}
