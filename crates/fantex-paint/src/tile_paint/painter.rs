//! The painter: an asset that is being painted on.

use std::path::Path;
use std::sync::{Arc, Mutex};

use fantex_store::{AssetEditor, ChannelKind, CommitSummary, EditOptions, PageCache, PageId};
use glam::Vec4;
use rayon::prelude::*;

use super::composite::composite;
use super::cover::{Patch, cover_page, cover_page_colored, touched_pages};
use super::ink::{Ink, look_up_now};
use super::level_work::LevelsUnderway;
use super::rect::Rect;
use super::room::Room;
use super::smudge::{Finger, LaidDown, PagesUnder, SmudgeDab, finger_of};
use super::stencil::see_through;
use super::stroke_page::{StrokePage, StrokePages};
use super::texel_page::{TexelPage, TexelPages};
use crate::dab::PlacedDab;
use crate::decal::PlacedDecal;
use crate::history::History;
use crate::layers::{FillTextures, LayeredPage, Layers, ShownPage, target_name};
use crate::log::{self, Portable, Recording};
use crate::work::Work;
use crate::{Dab, Decal, Paint, PaintError, StrokeSettings, Surface, SurfacePoint, Target, Tool};

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
    pub(crate) surface: Arc<Surface>,
    pub(crate) editor: AssetEditor,
    pub(crate) options: PaintOptions,
    pub(crate) maps: TexelPages,
    pub(crate) history: History,
    pub(crate) layers: Layers,
    /// The textures of the layers; made when they are needed.
    pub(crate) fills: FillTextures,
    pub(crate) stroke: Option<OpenStroke>,
    pub(crate) room: Room,
    /// Coarser levels that another thread computes, and its texel maps.
    pub(super) levels: Option<LevelsUnderway>,
    pub(super) level_maps: Arc<Mutex<TexelPages>>,
    /// The number of the next stroke in the log.
    pub(crate) next_stroke: u64,
    /// What takes long.
    pub(crate) work: Option<Work>,
}

/// A stroke that has begun.
#[derive(Debug)]
pub(crate) struct OpenStroke {
    pub(crate) label: String,
    pub(crate) target: Target,
    pub(crate) paint: Paint,
    /// What was seen before, for tools that ask for it.
    before: Option<PageCache>,
    /// What a smudge carries.
    fingers: Vec<Finger>,
    /// For the log.
    pub(crate) recording: Recording,
    /// Channels of the asset that it can change, ascending or as painted.
    pub(crate) affected: Vec<usize>,
    pub(crate) pages: StrokePages,
    pub(crate) dabs: usize,
}

impl Painter {
    /// Opens an asset for painting. There may be unfinished work in it (see [`has_work`](Self::has_work)).
    pub fn open(path: &Path, options: &PaintOptions) -> Result<Self, PaintError> {
        let editor = AssetEditor::open(path, &EditOptions::default())?;
        let history = History::load(&editor)?;
        let layers = Layers::load(&editor)?;
        let surface = Arc::new(Surface::of(editor.asset()));
        let next_stroke = log::next_number(&editor);
        let options = options.clone();
        let mut painter = Self {
            surface,
            editor,
            options,
            maps: TexelPages::default(),
            history,
            layers,
            fills: FillTextures::default(),
            stroke: None,
            room: Room::default(),
            levels: None,
            level_maps: Arc::default(),
            next_stroke,
            work: None,
        };
        painter.take_up_work()?;
        Ok(painter)
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
        self.finish_work()?;
        if self.stroke.is_some() {
            self.end()?;
        }
        if let Target::Layer(id) | Target::Mask(id) = target
            && self.layers.find(id).is_none()
        {
            return Err(PaintError::NoLayer(id));
        }
        paint.channels.iter().try_for_each(|painted| self.check_channel(painted.channel))?;
        let count = self.editor.asset().channels().len();
        self.fills.update(&self.surface, &self.layers)?;
        let affected = match target {
            Target::Mask(_) => (0..count).collect(),
            _ => paint.channels.iter().map(|painted| painted.channel).collect(),
        };
        let before = paint.tool.reads_surface().then(|| self.state_before()).transpose()?;
        let (label, pages, fingers) = (label.to_owned(), StrokePages::default(), Vec::new());
        let recording = Recording::Dabs(Vec::new(), None);
        self.stroke =
            Some(OpenStroke { label, target, paint, before, fingers, recording, affected, pages, dabs: 0 });
        Ok(())
    }

    /// Adds dabs to the open stroke, in order. Does nothing where none is open.
    pub fn dab(&mut self, dabs: &[Dab]) -> Result<(), PaintError> {
        if let Some(stroke) = &mut self.stroke {
            stroke.recording.add_dabs(&self.surface, dabs);
        }
        if let Some(OpenStroke { paint: Paint { tool: Tool::Smudge { strength }, .. }, .. }) = self.stroke {
            return dabs.iter().try_for_each(|dab| self.smudge(dab, strength));
        }
        let texel = 1.0 / self.surface.cover().density;
        for batch in dabs.chunks(DAB_BATCH) {
            let surface = &*self.surface;
            let placed: Vec<PlacedDab> =
                batch.par_iter().map(|dab| PlacedDab::new(surface, dab, texel)).collect();
            let touched: Vec<(PageId, Vec<u32>)> =
                touched_pages(surface, placed.iter().map(|dab| &dab.region)).into_iter().collect();
            self.cover(&touched, |surface, map, dabs: &Vec<u32>, page| {
                cover_page(surface, map, dabs.iter().map(|&i| &placed[i as usize]), page);
            })?;
            if let Some(stroke) = &mut self.stroke {
                stroke.dabs += batch.len();
            }
        }
        Ok(())
    }

    /// One dab of a smudge: it sees what those before have left.
    fn smudge(&mut self, dab: &Dab, strength: f32) -> Result<(), PaintError> {
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        let (surface, budget) = (&*self.surface, self.options.memory_bytes / 4);
        let finger = finger_of(&mut stroke.fingers, surface, dab);
        let placed = SmudgeDab::new(surface, dab, finger.as_ref());
        let ids: Vec<PageId> = touched_pages(surface, std::iter::once(placed.region())).into_keys().collect();
        let maps = self.maps.get(surface, &ids, budget);
        let mut pages = PagesUnder::new();
        for (id, map) in ids.into_iter().zip(maps) {
            let known = stroke.pages.take(id)?;
            let page = known.unwrap_or_else(|| StrokePage::new(map.block.texel_count()));
            pages.insert(id, (map, page));
        }
        let normals = self.editor.asset().channel_of_kind(ChannelKind::Normal);
        let ink = Ink { surface, paint: &stroke.paint, before: stroke.before.as_ref(), normals };
        let finger = placed.picked_up(finger, strength, &ink, &pages);
        let laid = LaidDown { dab: &placed, finger: &finger, surface };
        let channels = stroke.paint.channels.len();
        let stencil = stroke.paint.stencil.as_deref();
        pages.par_iter_mut().for_each(|(_, (map, page))| {
            cover_page_colored(map, &laid, channels, page);
            stencil.into_iter().for_each(|stencil| see_through(surface, map, stencil, page));
        });
        for (id, (_, page)) in pages {
            if !page.touched.is_empty() {
                stroke.pages.put(id, page, budget)?;
            }
        }
        stroke.fingers.push(finger);
        stroke.dabs += 1;
        Ok(())
    }

    /// Lays a picture onto the surface, as part of the open stroke. Does nothing where none is open.
    pub fn decal(&mut self, decal: &Decal) -> Result<(), PaintError> {
        let surface = Arc::clone(&self.surface);
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        stroke.recording.lose();
        let paint = stroke.paint.clone();
        let before = stroke.before.clone();
        let normals = self.editor.asset().channel_of_kind(ChannelKind::Normal);
        let ink = Ink { surface: &surface, paint: &paint, before: before.as_ref(), normals };
        let placed = PlacedDecal::new(&surface, decal, &ink);
        let touched = touched_pages(&surface, std::iter::once(placed.region()));
        let touched: Vec<(PageId, ())> = touched.into_keys().map(|id| (id, ())).collect();
        let channels = paint.channels.len();
        self.cover(&touched, |_, map, (), page| cover_page_colored(map, &placed, channels, page))?;
        if let Some(stroke) = &mut self.stroke {
            stroke.dabs += 1;
        }
        Ok(())
    }

    /// Says in the terms of stroke files what the open stroke paints, for the log. `folder`: what its paths are relative to. To be
    /// called before anything is painted. Settings that say nothing about where it is painted (neither samples nor dabs) are
    /// completed by the dabs as they come. Without it, dabs of constant colours are logged one by one; fills, decals and colours that
    /// are textures are counted in the log, but cannot be replayed from it. Fails where a file that is mentioned cannot be read.
    pub fn record(&mut self, settings: StrokeSettings, folder: &Path) -> Result<(), PaintError> {
        if let Some(stroke) = &mut self.stroke {
            let asset = self.editor.asset().path();
            let portable = Portable::new(&self.surface, settings, folder, asset)?;
            stroke.recording = Recording::Settings(Box::new(portable));
        }
        Ok(())
    }

    pub(crate) fn check_channel(&self, channel: usize) -> Result<(), PaintError> {
        let count = self.editor.asset().channels().len();
        if channel < count { Ok(()) } else { Err(PaintError::NoChannel { channel, count }) }
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
            let stencil = stroke.paint.stencil.as_deref();
            pages.par_iter_mut().zip(batch).zip(&maps).for_each(|((page, (_, with)), map)| {
                add(surface, map, with, page);
                stencil.into_iter().for_each(|stencil| see_through(surface, map, stencil, page));
            });
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
        let Some(stroke) = &self.stroke else { return Ok(Vec::new()) };
        let stale = stroke.pages.stale();
        if stale.len() > PAGE_BATCH {
            // Memory may have to be relieved on the way, and what another thread reads must stay where it is.
            self.finish_levels()?;
        }
        let Some(stroke) = &mut self.stroke else { return Ok(Vec::new()) };
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
            let (surface, editor) = (&*self.surface, &self.editor);
            let layers = (&self.layers, &self.fills);
            let stroke_now = &*stroke;
            let shown: Vec<ShownPage> = pages
                .par_iter()
                .zip(&maps)
                .map(|((id, page), map)| stroke_now.shown(surface, editor, layers, map, *id, page))
                .collect::<Result<_, _>>()?;
            for ((id, mut page), shown) in pages.into_iter().zip(shown) {
                shown.put(&mut self.editor, id, &stroke.affected)?;
                page.stale = Rect::EMPTY;
                stroke.pages.put(id, page, budget)?;
            }
            if stale.len() > PAGE_BATCH {
                self.room.relieve(&mut self.editor, budget)?;
            }
        }
        self.relieve()?;
        Ok(stale)
    }

    /// Lets the asset's file grow to so many bytes at most; none lifts the limit. Beyond it the disk counts as full.
    pub fn limit_file(&mut self, bytes: Option<u64>) {
        self.editor.limit_file(bytes);
    }

    /// True where the disk had no room for changes when memory was last to be relieved: they stay in memory, nothing is
    /// lost, and [`commit`](Self::commit) will tell whether there is room again.
    pub fn is_disk_full(&self) -> bool {
        self.room.is_full()
    }

    /// What can be undone and redone.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The value of a channel at a point as it is seen now, an open stroke included once it is shown: **linear** RGBA. (An
    /// eyedropper.)
    pub fn pick(&mut self, channel: usize, point: SurfacePoint) -> Result<Vec4, PaintError> {
        self.check_channel(channel)?;
        self.show()?;
        look_up_now(&self.surface, &self.editor, channel, point)
    }

    /// The same of all channels, in their order.
    pub fn pick_all(&mut self, point: SurfacePoint) -> Result<Vec<Vec4>, PaintError> {
        self.show()?;
        let channels = 0..self.editor.asset().channels().len();
        channels.map(|channel| look_up_now(&self.surface, &self.editor, channel, point)).collect()
    }

    /// Makes everything durable, an open stroke (without its coarser levels) and unfinished work included.
    pub fn commit(&mut self) -> Result<CommitSummary, PaintError> {
        self.show()?;
        self.finish_levels()?;
        self.keep_work()?;
        self.room.commit(&mut self.editor)
    }
}

impl OpenStroke {
    /// The bytes of a page before the stroke, per affected channel; where layers lie over it, also (last) the contents of
    /// the attachment that the stroke changes.
    pub(crate) fn originals(&self, editor: &AssetEditor, id: PageId) -> Result<Vec<Vec<u8>>, PaintError> {
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

    /// The page with the stroke.
    pub(crate) fn shown(
        &self,
        surface: &Surface,
        editor: &AssetEditor,
        (layers, fills): (&Layers, &FillTextures),
        map: &TexelPage,
        id: PageId,
        page: &StrokePage,
    ) -> Result<ShownPage, PaintError> {
        let normals = editor.asset().channel_of_kind(ChannelKind::Normal);
        let ink = &Ink { surface, paint: &self.paint, before: self.before.as_ref(), normals };
        let (target, affected) = (self.target, self.affected.as_slice());
        if self.is_layered(page) {
            return LayeredPage { editor, layers, fills, map, id, page, ink, target, affected }.show();
        }
        let shown = affected.iter().map(|&channel| editor.read_page_raw(channel, id));
        let channels = composite(editor.asset(), map, id, page, shown.collect::<Result<_, _>>()?, ink)?;
        Ok(ShownPage { channels, attachments: Vec::new() })
    }
}
