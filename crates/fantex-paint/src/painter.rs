//! From dabs to stored texels.
//!
//! ```text
//!  dabs --cover--> coverage per texel --composite--> pages of level 0 --levels--> coarser pages, means
//!          (kept for the whole stroke)  (from the bytes before the stroke)
//! ```
//!
//! Every tile that shows a point takes the same function of the surface at its texels, so tiles agree where they overlap
//! and the texture function stays as continuous as the stroke. Coverage is gathered over the stroke and applied to the texels as
//! they were before it: that is what caps a stroke at its opacity, and repeated showing costs no quality.

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;
use std::sync::Arc;

use fantex_base::{Error, Result, counted};
use fantex_store::{
    Asset, AssetEditor, ChannelKind, CommitSummary, Damage, EditOptions, PageCache, PageId, is_disk_full,
    page_extent,
};
use glam::Vec4;
use rayon::prelude::*;

use crate::composite::{ClonedDab, PaintContext, composite, look_up_now};
use crate::cover::{cover_page, cover_page_colored, touched_pages};
use crate::dab::{PlacedDab, share_of};
use crate::due_levels::DueLevels;
use crate::graph::FillTextures;
use crate::layer_groups::{COLLAPSED, load_collapsed};
use crate::layer_stack::LayerStack;
use crate::layers::{LayeredPage, Layers, ShownPage, base_name, page_name};
use crate::log::{self, LoadedFiles, Portable, Recording};
use crate::picture::PlacedDecal;
use crate::projection::see_through;
use crate::relief::Relief;
use crate::room::Room;
use crate::smudge::{LaidDown, PagesUnder, SmudgeBuffer, SmudgeDab, buffer_of};
use crate::stroke_page::{StrokePage, StrokePages};
use crate::texel_page::{Rect, TexelPage, TexelPages};
use crate::work::Work;
use crate::{
    BlendMode, Dab, Decal, History, Paint, PaintColor, StrokeSettings, Surface, SurfacePoint, Target, Tool,
};

// The painter: an asset that is being painted on.

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

impl PaintOptions {
    /// Bytes of each of the things that memory is for.
    pub(crate) fn budget(&self) -> usize {
        self.memory_bytes / 4
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

/// Share of the time of opening that reading the asset takes; the rest goes into its surface.
const OPENED_SHARE: f32 = 0.3;

/// An asset that is being painted on. Nothing is durable before [`commit`](Self::commit).
#[derive(Debug)]
pub struct Painter {
    pub(crate) surface: Arc<Surface>,
    pub(crate) editor: AssetEditor,
    pub(crate) options: PaintOptions,
    pub(crate) maps: TexelPages,
    pub(crate) history: History,
    pub(crate) layers: Layers,
    /// Groups that are folded in the list.
    pub(crate) collapsed: BTreeSet<u64>,
    /// The textures of the layers; made when they are needed.
    pub(crate) fills: FillTextures,
    pub(crate) stroke: Option<OpenStroke>,
    pub(crate) room: Room,
    /// Coarser levels that steps owe, those of the oldest first.
    pub(crate) due: VecDeque<DueLevels>,
    /// Coarser pages that have changed since that was last asked for.
    pub(crate) made: BTreeSet<PageId>,
    pub(crate) next_stroke: u64,
    /// Attachments that the last commit has kept of the open stroke.
    pub(crate) kept: Vec<String>,
    pub(crate) work: Option<Work>,
    /// What tools that read the surface could not read.
    damage: Damage,
}

#[derive(Debug)]
pub(crate) struct OpenStroke {
    pub(crate) label: String,
    pub(crate) target: Target,
    pub(crate) paint: Paint,
    /// What was seen before, for tools that ask for it.
    before: Option<PageCache>,
    /// What a smudge carries.
    buffers: Vec<SmudgeBuffer>,
    /// For the log.
    pub(crate) recording: Recording,
    /// Channels of the asset that it can change, ascending or as painted.
    pub(crate) affected: Vec<usize>,
    pub(crate) pages: StrokePages,
    pub(crate) dabs: usize,
}

impl Painter {
    /// Opens an asset for painting. There may be unfinished work in it (see [`has_work`](Self::has_work)).
    ///
    /// # Errors
    /// The asset cannot be read, is being edited elsewhere, or its history, layers or log are damaged.
    pub fn open(path: &Path, options: &PaintOptions) -> Result<Self> {
        Self::open_with_progress(path, options, &|_| {})
    }

    /// The same; `progress` is told the share that is done, 0..1, ascending.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with_progress(path: &Path, options: &PaintOptions, progress: &dyn Fn(f32)) -> Result<Self> {
        let editor = AssetEditor::open(path, &EditOptions::default())?;
        let history = History::load(&editor)?;
        let layers = Layers::load(&editor)?;
        let collapsed = load_collapsed(editor.attachment(COLLAPSED)?);
        progress(OPENED_SHARE);
        let (mesh, cover) = (editor.asset().shared_mesh(), editor.asset().shared_cover());
        let in_all = |share: f32| progress(OPENED_SHARE + (1.0 - OPENED_SHARE) * share);
        let surface = Arc::new(Surface::with_progress(mesh, cover, &in_all));
        let next_stroke = log::next_number(&editor)?;
        let options = options.clone();
        let mut painter = Self {
            surface,
            editor,
            options,
            maps: TexelPages::default(),
            history,
            layers,
            collapsed,
            fills: FillTextures::default(),
            stroke: None,
            room: Room::default(),
            due: VecDeque::new(),
            made: BTreeSet::new(),
            next_stroke,
            kept: Vec::new(),
            work: None,
            damage: Damage::default(),
        };
        painter.finish_adding()?;
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
    ///
    /// # Errors
    /// As [`begin_on`](Self::begin_on).
    pub fn begin(&mut self, label: &str, paint: Paint) -> Result<()> {
        self.begin_on(Target::Base, label, paint)
    }

    /// Begins a stroke on a layer, a mask or what lies under them; one that is open ends first.
    ///
    /// # Errors
    /// There is no such layer, mask or channel, or an open stroke cannot be ended.
    pub fn begin_on(&mut self, target: Target, label: &str, mut paint: Paint) -> Result<()> {
        self.finish_work()?;
        if self.stroke.is_some() {
            self.end()?;
        }
        if let Target::Layer(id) | Target::Mask(id) = target {
            let none = || Error::not_found(format!("there is no layer number {id} to paint on"));
            let layer = self.layers.find(id).ok_or_else(none)?;
            if target == Target::Layer(id) && layer.group_kind().is_some() {
                let name = &layer.name;
                let sentence =
                    format!("{name:?} is a group of layers: paint on a layer in it, or on its mask");
                return Err(Error::invalid(sentence));
            }
            if target == Target::Mask(id) && layer.mask.is_none() {
                let name = &layer.name;
                let sentence = format!("the layer {name:?} has no mask to paint on: give it one first");
                return Err(Error::not_found(sentence));
            }
        }
        paint.channels.iter().try_for_each(|painted| self.check_channel(painted.channel))?;
        self.check_tool(target, &paint)?;
        for painted in &mut paint.channels {
            if let PaintColor::Constant(color) = &mut painted.color {
                color.w = share_of(color.w);
            }
        }
        if !matches!(target, Target::Mask(_))
            && let Some(relief) = Relief::of(&self.surface, self.editor.asset())
        {
            relief.join(&mut paint);
        }
        let count = self.editor.asset().channels().len();
        self.fills.update(&self.surface, &self.layers)?;
        let affected = match target {
            Target::Mask(_) => (0..count).collect(),
            _ => paint.channels.iter().map(|painted| painted.channel).collect(),
        };
        let before = paint.tool.reads_surface().then(|| self.state_before()).transpose()?;
        let (label, pages, buffers) = (label.to_owned(), StrokePages::default(), Vec::new());
        let recording = Recording::Dabs(Vec::new(), None);
        self.stroke =
            Some(OpenStroke { label, target, paint, before, buffers, recording, affected, pages, dabs: 0 });
        Ok(())
    }

    /// Adds dabs to the open stroke, in order. Does nothing where none is open.
    ///
    /// # Errors
    /// The asset or the temporary file of the stroke cannot be read or written.
    pub fn dab(&mut self, dabs: &[Dab]) -> Result<()> {
        if let Some(stroke) = &mut self.stroke {
            stroke.recording.add_dabs(&self.surface, &stroke.paint.tool, dabs);
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
                touched_pages(surface, placed.iter()).into_iter().collect();
            if self.stroke.as_ref().is_some_and(|stroke| stroke.paint.tool.depends_on_copy()) {
                self.clone_copies(&touched, &placed)?;
            } else {
                self.cover(&touched, |surface, map, dabs: &Vec<u32>, page| {
                    cover_page(surface, map, dabs.iter().map(|&i| &placed[i as usize]), page);
                })?;
            }
            if let Some(stroke) = &mut self.stroke {
                stroke.dabs += batch.len();
            }
        }
        Ok(())
    }

    /// Dabs of a clone whose copies copy from different places: each lays down colours of its own.
    fn clone_copies(&mut self, touched: &[(PageId, Vec<u32>)], placed: &[PlacedDab]) -> Result<()> {
        let Some(stroke) = &self.stroke else { return Ok(()) };
        let surface = Arc::clone(&self.surface);
        let (paint, before) = (stroke.paint.clone(), stroke.before.clone());
        let context = PaintContext::new(&surface, self.editor.asset(), &paint, before.as_ref());
        let cloned: Vec<ClonedDab<'_>> =
            placed.iter().map(|dab| ClonedDab { dab, context: &context }).collect();
        let channels = paint.channels.len();
        self.cover(touched, |_, map, dabs: &Vec<u32>, page| {
            for &dab in dabs {
                cover_page_colored(map, &cloned[dab as usize], channels, page);
            }
        })
    }

    /// One dab of a smudge: it sees what those before have left.
    fn smudge(&mut self, dab: &Dab, strength: f32) -> Result<()> {
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        let (surface, budget) = (&*self.surface, self.options.budget());
        let buffer = buffer_of(&mut stroke.buffers, surface, dab);
        let placed = SmudgeDab::new(surface, dab, buffer.as_ref());
        // It picks up what lies beside the dab, too.
        let ids: Vec<PageId> = touched_pages(surface, std::iter::once(placed.region())).into_keys().collect();
        let maps = self.maps.get(surface, &ids, budget);
        let pages = stroke.pages.take_or_new(sizes(&ids, &maps))?;
        let mut pages: PagesUnder =
            pages.into_iter().zip(maps).map(|((id, page), map)| (id, (map, page))).collect();
        let context = PaintContext::new(surface, self.editor.asset(), &stroke.paint, stroke.before.as_ref());
        let buffer = placed.picked_up(buffer, strength, &context, &pages);
        let laid = LaidDown { dab: &placed, buffer: &buffer, surface };
        let channels = stroke.paint.channels.len();
        let paint = &stroke.paint;
        pages.par_iter_mut().for_each(|(_, (map, page))| {
            cover_page_colored(map, &laid, channels, page);
            see_through(surface, map, paint, page);
        });
        stroke.pages.put_all(pages.into_iter().map(|(id, (_, page))| (id, page)), budget)?;
        stroke.buffers.push(buffer);
        stroke.dabs += 1;
        Ok(())
    }

    /// Lays a picture onto the surface, as part of the open stroke. Does nothing where none is open.
    ///
    /// # Errors
    /// As [`dab`](Self::dab).
    pub fn decal(&mut self, decal: &Decal) -> Result<()> {
        let surface = Arc::clone(&self.surface);
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        stroke.recording.lose();
        let (paint, before) = (stroke.paint.clone(), stroke.before.clone());
        let context = PaintContext::new(&surface, self.editor.asset(), &paint, before.as_ref());
        let placed = PlacedDecal::new(&surface, decal, &context);
        let touched = touched_pages(&surface, std::iter::once(&placed));
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
    ///
    /// # Errors
    /// A file that the settings mention cannot be read.
    pub fn record(&mut self, settings: StrokeSettings, folder: &Path) -> Result<()> {
        self.record_loaded(settings, folder, &LoadedFiles::new())
    }

    /// As [`record`](Self::record), with files as they were when they were loaded to paint with: the log holds these, whatever lies there
    /// now.
    ///
    /// # Errors
    /// Another file that the settings mention cannot be read.
    pub fn record_loaded(
        &mut self,
        settings: StrokeSettings,
        folder: &Path,
        loaded: &LoadedFiles,
    ) -> Result<()> {
        if let Some(stroke) = &mut self.stroke {
            let asset = self.editor.asset().path();
            let portable = Portable::new(&self.surface, settings, folder, loaded, asset)?;
            stroke.recording = Recording::Settings(Box::new(portable));
        }
        Ok(())
    }

    /// Refuses strokes of opacity where there is none, and brushes that blend as only layers do.
    fn check_tool(&self, target: Target, paint: &Paint) -> Result<()> {
        if matches!(paint.tool, Tool::Paint(BlendMode::Erase)) {
            let sentence =
                "only layers blend as \"erase\": a brush erases with the tool \"erase\" or \"opacity\"";
            return Err(Error::invalid(sentence));
        }
        if !matches!(paint.tool, Tool::Opacity { .. }) {
            return Ok(());
        }
        if matches!(target, Target::Mask(_)) {
            let sentence = "a mask has no opacity to paint: paint it black or white instead";
            return Err(Error::invalid(sentence));
        }
        let channels = self.editor.asset().channels();
        match paint
            .channels
            .iter()
            .map(|painted| channels[painted.channel].kind)
            .find(|kind| *kind != ChannelKind::BaseColor)
        {
            Some(kind) => {
                let sentence =
                    format!("the channel {kind} has no opacity: only the base colour's can be painted");
                Err(Error::invalid(sentence))
            }
            None => Ok(()),
        }
    }

    pub(crate) fn check_channel(&self, channel: usize) -> Result<()> {
        let count = self.editor.asset().channels().len();
        let sentence =
            || format!("the asset has {}; there is no channel {channel} to paint", counted(count, "channel"));
        (channel < count).then_some(()).ok_or_else(|| Error::invalid(sentence()))
    }

    /// Lets `add` change the coverage of pages, in parallel.
    fn cover<T: Sync>(
        &mut self,
        touched: &[(PageId, T)],
        add: impl Fn(&Surface, &TexelPage, &T, &mut StrokePage) + Sync,
    ) -> Result<()> {
        let Some(stroke) = &mut self.stroke else { return Ok(()) };
        let budget = self.options.budget();
        for batch in touched.chunks(PAGE_BATCH) {
            let ids: Vec<PageId> = batch.iter().map(|(id, _)| *id).collect();
            let maps = self.maps.get(&self.surface, &ids, budget);
            let mut pages = stroke.pages.take_or_new(sizes(&ids, &maps))?;
            let surface = &*self.surface;
            let paint = &stroke.paint;
            pages.par_iter_mut().zip(batch).zip(&maps).for_each(|(((_, page), (_, with)), map)| {
                add(surface, map, with, page);
                see_through(surface, map, paint, page);
            });
            stroke.pages.put_all(pages, budget)?;
        }
        Ok(())
    }

    /// Brings the pages of level 0 up to date with the open stroke, and returns those that changed: for the next frame.
    ///
    /// # Errors
    /// Pages cannot be read or encoded.
    pub fn show(&mut self) -> Result<Vec<PageId>> {
        let Some(stroke) = &self.stroke else { return Ok(Vec::new()) };
        let stale = stroke.pages.stale();
        self.settle(&stale)?;
        let Some(stroke) = &mut self.stroke else { return Ok(Vec::new()) };
        let budget = self.options.budget();
        for ids in stale.chunks(PAGE_BATCH) {
            let maps = self.maps.get(&self.surface, ids, budget);
            let mut pages = stroke.pages.take_or_new(sizes(ids, &maps))?;
            let (surface, editor) = (&*self.surface, &self.editor);
            let layers = (&self.layers, &self.fills);
            let stroke_now = &*stroke;
            let show = |((id, page), map): (&mut (PageId, StrokePage), &Arc<TexelPage>)| {
                stroke_now.begin_page(editor, *id, page)?;
                stroke_now.shown(surface, editor, layers, map, *id, page)
            };
            let shown: Result<Vec<ShownPage>> = pages.par_iter_mut().zip(&maps).map(show).collect();
            let shown = shown.and_then(|shown| {
                pages.iter_mut().zip(shown).try_for_each(|((id, page), shown)| {
                    shown.put(&mut self.editor, *id, &stroke.affected)?;
                    page.stale = Rect::EMPTY;
                    Ok(())
                })
            });
            stroke.pages.put_all(pages, budget).and(shown)?;
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

    /// The texels that tools which read the surface (such as blur, clone, fills of a colour) could not read since the asset was opened, so that
    /// coarser ones stood in.
    pub fn damage(&self) -> &Damage {
        &self.damage
    }

    /// Takes over what was found through a cache that is used no more.
    pub(crate) fn add_damage(&mut self, found: Damage) {
        let Damage { pages, mut first } = found;
        let unnamed = pages - first.len() as u64;
        let known = &self.damage.first;
        first.retain(|(channel, page, _)| known.iter().all(|(c, p, _)| (c, p) != (channel, page)));
        self.damage.pages += unnamed + first.len() as u64;
        self.damage.first.extend(first);
    }

    /// What can be undone and redone.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The value of a channel at a point as it is seen now, an open stroke included once it is shown: **linear** RGBA. (An
    /// eyedropper.)
    ///
    /// # Errors
    /// There is no such channel, or pages cannot be read.
    pub fn pick(&mut self, channel: usize, point: SurfacePoint) -> Result<Vec4> {
        self.check_channel(channel)?;
        self.show()?;
        look_up_now(&self.surface, &self.editor, channel, point)
    }

    /// The same of all channels, in their order.
    ///
    /// # Errors
    /// Pages cannot be read.
    pub fn pick_all(&mut self, point: SurfacePoint) -> Result<Vec<Vec4>> {
        self.show()?;
        let channels = 0..self.editor.asset().channels().len();
        channels.map(|channel| look_up_now(&self.surface, &self.editor, channel, point)).collect()
    }

    /// Makes everything durable, unfinished work and an open stroke included: if nobody ends that, whoever opens the asset next finds
    /// what it has done so far as a step of the history.
    ///
    /// # Errors
    /// The file cannot be written (see [`is_disk_full`](fantex_store::is_disk_full)); all changes stay in memory then.
    pub fn commit(&mut self) -> Result<CommitSummary> {
        self.show()?;
        self.finish_levels()?;
        self.keep_work()?;
        self.room.commit(&mut self.editor)
    }

    /// Commits, and replaces the file by a copy without gaps where these are more than this [share](Asset::gap_share) of it; says whether.
    /// Needs room for the copy.
    ///
    /// # Errors
    /// As [`commit`](Self::commit), or the copy cannot be written: all is committed then, in the file as it is.
    pub fn close_gaps(&mut self, most: f64) -> Result<bool> {
        self.commit()?;
        let is_due = self.editor.asset().gap_share() > most;
        if is_due {
            self.editor.compact()?;
        }
        Ok(is_due)
    }

    /// As [`commit`](Self::commit) where the file was replaced or removed: all is in the file that is open, to be copied from
    /// [`asset`](AssetEditor::asset), and in no other one.
    ///
    /// # Errors
    /// As [`commit`](Self::commit).
    pub fn commit_detached(&mut self) -> Result<CommitSummary> {
        self.editor.set_detached(true);
        let committed = self.commit();
        self.editor.set_detached(false);
        committed
    }
}

impl OpenStroke {
    /// What it could not read of the state before it.
    pub(crate) fn damage(&self) -> Damage {
        self.before.as_ref().map_or_else(Damage::default, PageCache::damage)
    }

    /// Notes what a page is before the stroke, unless that is done: its bytes per affected channel; where layers lie over it, also
    /// (last) the contents of the attachment that the stroke changes.
    pub(crate) fn begin_page(&self, editor: &AssetEditor, id: PageId, page: &mut StrokePage) -> Result<()> {
        if !page.originals.is_empty() {
            return Ok(());
        }
        let channels = self.affected.iter().map(|&channel| editor.read_page_raw(channel, id));
        let mut originals = channels.collect::<Result<Vec<_>, _>>()?;
        let contents = editor.attachment(&page_name(self.target, id))?;
        if self.target != Target::Base || contents.is_some() {
            originals.push(contents.unwrap_or_default());
        }
        page.originals = originals;
        page.puts_base_aside = self.target != Target::Base && !editor.has_attachment(&base_name(id));
        Ok(())
    }

    /// The texels of a page that a stroke changes which covers some.
    pub(crate) fn changed(&self, surface: &Surface, asset: &Asset, id: PageId, covered: Rect) -> Rect {
        let is_relief = Relief::of(surface, asset)
            .is_some_and(|relief| [relief.height, relief.normal].iter().all(|c| self.affected.contains(c)));
        let extent = page_extent(surface.cover().groups[id.group as usize].extent, id.page);
        if is_relief { Relief::reach(covered, extent) } else { covered }
    }

    /// True where the page has layers, and the stroke changes one of their attachments.
    pub(crate) fn is_layered(&self, page: &StrokePage) -> bool {
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
    ) -> Result<ShownPage> {
        let context = &PaintContext::new(surface, editor.asset(), &self.paint, self.before.as_ref());
        let (target, affected) = (self.target, self.affected.as_slice());
        if self.is_layered(page) {
            let (rect, replaced) = (page.stale.blocks(), None);
            let stack = LayerStack { editor, layers, id, surface, map, fills, rect, replaced };
            return LayeredPage { stack, page, context, target, affected }.show();
        }
        let shown = affected.iter().map(|&channel| editor.read_page_raw(channel, id));
        let channels = composite(editor.asset(), map, id, page, shown.collect::<Result<_, _>>()?, context)?;
        Ok(ShownPage { channels, attachments: Vec::new() })
    }
}

/// Pages with their numbers of texels.
pub(crate) fn sizes(ids: &[PageId], maps: &[Arc<TexelPage>]) -> impl Iterator<Item = (PageId, usize)> {
    ids.iter().copied().zip(maps.iter().map(|map| map.block.texel_count()))
}

// The state before a stroke, for tools that read what is seen: it must not change under them.

impl Painter {
    /// The asset as it is seen now, to stay so while the stroke is open. A commit gives such a state. Where the disk is full
    /// the changes in memory are looked through instead, and nothing is written before the stroke ends.
    pub(crate) fn state_before(&mut self) -> Result<PageCache> {
        let budget = self.options.memory_bytes / 8;
        match self.commit() {
            Ok(_) => Ok(PageCache::new(Arc::clone(self.editor.asset()), budget)),
            Err(error) if is_disk_full(&error) => {
                self.room.hold();
                Ok(PageCache::of_snapshot(self.editor.snapshot(), budget))
            }
            Err(error) => Err(error),
        }
    }
}
