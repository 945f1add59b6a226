//! The painter: an asset that is being painted on.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use fantex_store::{AssetEditor, CommitSummary, EditOptions, PageCache, PageId};
use glam::Vec4;
use rayon::prelude::*;

use super::composite::composite;
use super::cover::{cover_page, fill_page, for_each_page, touched_pages};
use super::ink::{Ink, look_up};
use super::rect::Rect;
use super::stroke_page::{StrokePage, StrokePages};
use super::texel_page::{TexelPage, TexelPages};
use crate::dab::PlacedDab;
use crate::history::{History, flush_if_possible};
use crate::layers::{LayeredPage, Layers, ShownPage, target_name};
use crate::{Dab, Paint, PaintError, Surface, SurfacePoint, Target};

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
    pub(super) surface: Arc<Surface>,
    pub(crate) editor: AssetEditor,
    pub(super) options: PaintOptions,
    pub(super) maps: TexelPages,
    pub(crate) history: History,
    pub(crate) layers: Layers,
    pub(super) stroke: Option<OpenStroke>,
    pub(super) disk_full: bool,
}

/// A stroke that has begun.
#[derive(Debug)]
pub(super) struct OpenStroke {
    pub(super) label: String,
    pub(super) target: Target,
    pub(super) paint: Paint,
    /// What was seen before, for tools that ask for it.
    before: Option<PageCache>,
    /// Channels of the asset that it can change, ascending or as painted.
    pub(super) affected: Vec<usize>,
    pub(super) pages: StrokePages,
    pub(super) dabs: usize,
}

impl Painter {
    /// Opens an asset for painting.
    pub fn open(path: &Path, options: &PaintOptions) -> Result<Self, PaintError> {
        let editor = AssetEditor::open(path, &EditOptions::default())?;
        let history = History::load(&editor)?;
        let layers = Layers::load(&editor)?;
        let surface = Arc::new(Surface::of(editor.asset()));
        let options = options.clone();
        Ok(Self {
            surface,
            editor,
            options,
            maps: TexelPages::default(),
            history,
            layers,
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

    /// The pages, of all levels, that have changed since the last call; from the first call on they are remembered. For
    /// whoever shows the asset while it is painted on.
    pub fn take_replaced(&mut self) -> Vec<PageId> {
        self.editor.take_replaced()
    }

    /// Begins a stroke under all layers; one that is open ends first. `label` names it in the history.
    pub fn begin(&mut self, label: &str, paint: Paint) -> Result<(), PaintError> {
        self.begin_on(Target::Base, label, paint)
    }

    /// Begins a stroke on a layer, a mask or what lies under them; one that is open ends first.
    pub fn begin_on(&mut self, target: Target, label: &str, paint: Paint) -> Result<(), PaintError> {
        self.end()?;
        if let Target::Layer(id) | Target::Mask(id) = target
            && self.layers.find(id).is_none()
        {
            return Err(PaintError::NoLayer(id));
        }
        let count = self.editor.asset().channels().len();
        if let Some(wrong) = paint.channels.iter().find(|painted| painted.channel >= count) {
            return Err(PaintError::NoChannel { channel: wrong.channel, count });
        }
        let affected = match target {
            Target::Mask(_) => (0..count).collect(),
            _ => paint.channels.iter().map(|painted| painted.channel).collect(),
        };
        // What a tool reads must not change under it; a commit gives a state that stays.
        let before = if paint.tool.reads_surface() {
            self.commit()?;
            Some(PageCache::new(Arc::clone(self.editor.asset()), self.options.memory_bytes / 8))
        } else {
            None
        };
        let (label, pages) = (label.to_owned(), StrokePages::default());
        self.stroke = Some(OpenStroke { label, target, paint, before, affected, pages, dabs: 0 });
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
        add: impl Fn(&Surface, &TexelPage, &T, &mut StrokePage) + Sync,
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
                    page.originals = stroke.originals(&self.editor, id)?;
                }
                pages.push((id, page));
            }
            let (surface, editor, layers) = (&*self.surface, &self.editor, &self.layers);
            let stroke_now = &*stroke;
            let shown: Vec<ShownPage> = pages
                .par_iter()
                .zip(&maps)
                .map(|((id, page), map)| stroke_now.shown(surface, editor, layers, map, *id, page))
                .collect::<Result<_, _>>()?;
            for ((id, mut page), shown) in pages.into_iter().zip(shown) {
                for (&channel, bytes) in stroke.affected.iter().zip(shown.channels) {
                    self.editor.replace(id, channel, bytes)?;
                }
                for (name, contents) in shown.attachments {
                    self.editor.attach(&name, contents)?;
                }
                page.stale = Rect::EMPTY;
                stroke.pages.put(id, page, budget)?;
            }
            if self.editor.pending_bytes() > budget {
                self.disk_full = flush_if_possible(&mut self.editor)?;
            }
        }
        Ok(stale)
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

    /// The value of a channel at a point as it was last committed: **linear** RGBA. (An eyedropper; it commits first.)
    pub fn pick(&mut self, channel: usize, point: SurfacePoint) -> Result<Vec4, PaintError> {
        let count = self.editor.asset().channels().len();
        if channel >= count {
            return Err(PaintError::NoChannel { channel, count });
        }
        self.commit()?;
        let cache = PageCache::new(Arc::clone(self.editor.asset()), 1 << 20);
        Ok(look_up(&self.surface, &cache, channel, point))
    }

    /// Makes everything durable, an open stroke (without its coarser levels) included.
    pub fn commit(&mut self) -> Result<CommitSummary, PaintError> {
        self.show()?;
        let summary = self.editor.commit()?;
        self.disk_full = false;
        Ok(summary)
    }
}

impl OpenStroke {
    /// The bytes of a page before the stroke, per affected channel; where layers lie over it, also (last) the contents of
    /// the attachment that the stroke changes.
    fn originals(&self, editor: &AssetEditor, id: PageId) -> Result<Vec<Vec<u8>>, PaintError> {
        let channels = self.affected.iter().map(|&channel| editor.read_page_raw(channel, id));
        let mut originals = channels.collect::<Result<Vec<_>, _>>()?;
        let contents = editor.attachment(&target_name(self.target, id))?;
        if self.target != Target::Base || contents.is_some() {
            originals.push(contents.unwrap_or_default());
        }
        Ok(originals)
    }

    /// True where the page has layers, and the stroke changes one of their attachments.
    pub(super) fn is_layered(&self, page: &StrokePage) -> bool {
        page.originals.len() > self.affected.len()
    }

    fn shown(
        &self,
        surface: &Surface,
        editor: &AssetEditor,
        layers: &Layers,
        map: &TexelPage,
        id: PageId,
        page: &StrokePage,
    ) -> Result<ShownPage, PaintError> {
        let ink = &Ink { surface, paint: &self.paint, before: self.before.as_ref() };
        let (target, affected) = (self.target, self.affected.as_slice());
        if self.is_layered(page) {
            return LayeredPage { editor, layers, map, id, page, ink, target, affected }.show();
        }
        let shown = affected.iter().map(|&channel| editor.read_page_raw(channel, id));
        let channels = composite(editor.asset(), map, id, page, shown.collect::<Result<_, _>>()?, ink)?;
        Ok(ShownPage { channels, attachments: Vec::new() })
    }
}
