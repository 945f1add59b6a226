//! A world on the GPU: what is near is whole and streamed, what is far is drawn by its preview, what is farther by coarse assets that stand for
//! several objects each, in a stated amount of memory.
//!
//! ```text
//!  World, view --choose_objects--> what each object is to show            (fantex_stream, no GPU)
//!                                     |  the most urgent first, a few at a time
//!                                     v
//!  threads, or tasks of a page: open, move into the world's space, bring to the device --> Preview | Whole | Coarse
//!                                     |
//!  Model: draws what is there; a preview until its object has its texels, a coarse asset until all of its parts are there
//! ```

mod drawing;
mod opening;
#[cfg(not(target_arch = "wasm32"))]
mod settling;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use fantex_base::Result;
use fantex_scene::{Camera, FilterOptions};
use fantex_store::io_cause;
use fantex_stream::read::is_transient;
use fantex_stream::{
    FrameOptions, ObjectDetail, PoolShares, RetryTimer, SharedWork, StreamStatistics, StreamView, ViewObject,
    World, choose_objects, root_objects, url_of,
};
use glam::Vec3;
use opening::{Opened, OpenedDetail, Opening, Order, What};

use crate::{FanModel, Gpu, ModelSpace, StreamedModel, max_anisotropy, stream_view};

/// Seconds after which an object takes its preview's place even if it lacks texels.
const MAX_FILLING_SECONDS: f32 = 3.0;

/// How much memory a world may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldOptions {
    /// Graphics memory for the texels of whole objects, bytes.
    pub pool_bytes: u64,
    /// Main and graphics memory for meshes and covers, for previews and coarse assets, bytes. What is being opened comes on top of both.
    pub geometry_bytes: u64,
    /// How textures will be filtered.
    pub filter: FilterOptions,
}

impl Default for WorldOptions {
    /// 64 MiB of texels, 384 MiB of geometry.
    fn default() -> Self {
        Self { pool_bytes: 64 << 20, geometry_bytes: 384 << 20, filter: FilterOptions::default() }
    }
}

/// What is there of a world.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WorldStatistics {
    /// Objects that are whole.
    pub whole: usize,
    /// Objects that are shown by their previews.
    pub previews: usize,
    /// Coarse assets that are shown, each for several objects.
    pub coarse: usize,
    /// Objects, previews and coarse assets that the view needs and that are not there.
    pub missing: usize,
    /// Triangles that are drawn.
    pub triangles: u64,
    /// Memory that is counted as taken by geometry, previews and coarse assets, bytes.
    pub geometry_bytes: u64,
    /// Bytes of texels that went to the graphics memory since the start, and parcels of them.
    pub uploaded: [u64; 2],
    /// Assets that could not be opened, and why.
    pub failed: Vec<(String, String)>,
}

/// A world whose objects come and go with the view.
pub struct StreamedWorld {
    world: Arc<World>,
    index: PathBuf,
    space: ModelSpace,
    /// Of the objects, then of the coarse assets.
    shapes: Vec<ViewObject>,
    /// The same.
    objects: Vec<Object>,
    /// Numbers of those that are part of no coarse asset.
    roots: Vec<usize>,
    options: WorldOptions,
    /// Whole objects among which the pool is divided.
    shares: PoolShares,
    opened: (Sender<Opened>, Receiver<Opened>),
    opening: Opening,
    statistics: WorldStatistics,
    /// What could not be opened for a reason that may pass: numbers, and whether the whole object was wanted.
    passing: Vec<(usize, bool)>,
    /// When that is tried again.
    retries: RetryTimer,
    /// Objects and coarse assets that are drawn, the nearest first.
    drawn: Vec<usize>,
    /// The same, ascending, and whether they are whole.
    shown: Vec<(usize, bool)>,
    /// Grows when other objects are drawn, or others are whole.
    revision: u64,
}

impl std::fmt::Debug for StreamedWorld {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StreamedWorld").field("index", &self.index).finish_non_exhaustive()
    }
}

/// What there is of an object, or of a coarse asset.
#[derive(Default)]
struct Object {
    /// Its preview, or the coarse asset.
    preview: Slot<FanModel>,
    whole: Slot<Whole>,
    /// The parts of the coarse asset are wanted in its place.
    is_divided: bool,
}

struct Whole {
    streamed: StreamedModel,
    /// Seconds for which it has been filled; none once it is shown.
    filling: Option<f32>,
    shares: u64,
}

#[derive(Default)]
enum Slot<T> {
    #[default]
    Absent,
    Opening,
    There(Box<T>),
    Failed,
}

impl<T> Slot<T> {
    fn get(&self) -> Option<&T> {
        if let Self::There(there) = self { Some(there) } else { None }
    }

    fn get_mut(&mut self) -> Option<&mut T> {
        if let Self::There(there) = self { Some(there) } else { None }
    }

    /// Takes what was opened; nothing where it could not be.
    fn fill(&mut self, opened: Option<T>) {
        *self = opened.map_or(Self::Failed, |there| Self::There(Box::new(there)));
    }

    /// What could not be opened may be tried again.
    fn forgive(&mut self) {
        if let Self::Failed = self {
            *self = Self::Absent;
        }
    }

    fn empty(&mut self) {
        if let Self::There(_) = self {
            *self = Self::Absent;
        }
    }
}

impl StreamedWorld {
    /// Nothing is there. `index` is where the world was read, a path or an address.
    ///
    /// # Errors
    /// There is no object, or all lie in one point; coarse assets have [no parts that they can have](World::parts).
    pub fn new(index: &Path, world: Arc<World>, options: WorldOptions) -> Result<Self> {
        let space = world.space_to_show(index)?;
        let shapes = world.view_objects(&space)?;
        let boxes: Vec<_> = shapes[..world.objects.len()].iter().map(|shape| shape.bounds).collect();
        Ok(Self {
            index: index.to_owned(),
            space: ModelSpace::of_boxes(space, &boxes),
            objects: shapes.iter().map(|_| Object::default()).collect(),
            roots: root_objects(&shapes),
            shapes,
            world,
            options,
            shares: PoolShares::default(),
            opened: channel(),
            opening: Opening::default(),
            statistics: WorldStatistics::default(),
            passing: Vec::new(),
            retries: RetryTimer::default(),
            drawn: Vec::new(),
            shown: Vec::new(),
            revision: 0,
        })
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// What is there.
    pub fn statistics(&self) -> &WorldStatistics {
        &self.statistics
    }

    /// What the streamers of whole objects tell.
    pub fn streamers(&self) -> impl Iterator<Item = StreamStatistics> + '_ {
        self.objects.iter().filter_map(|object| Some(object.whole.get()?.streamed.streamer.statistics()))
    }

    /// Share of what the view needs that is there, 0 to 1: objects, their previews and coarse assets, and tiles of objects that are whole.
    pub fn complete_share(&self) -> f64 {
        let WorldStatistics { whole, previews, coarse, missing, .. } = &self.statistics;
        let small = previews + coarse;
        let there = whole + small;
        let objects = there as f64 / (there + missing).max(1) as f64;
        let tiles: f64 = self.streamers().map(|streamer| streamer.complete_share()).sum();
        objects * (tiles + small as f64) / (self.streamers().count() + small).max(1) as f64
    }

    /// What could not be opened or read: objects, and parts of those that are whole; and why the first of them could not be.
    pub fn damage(&self) -> (usize, Option<String>) {
        let wholes = || self.objects.iter().filter_map(|object| object.whole.get());
        let failed = &self.statistics.failed;
        let parts: usize = wholes().map(|whole| whole.streamed.streamer.damaged().count()).sum();
        let part = || wholes().find_map(|whole| whole.streamed.streamer.damaged().next());
        let first = failed.first().map(|(_, error)| error.clone());
        (failed.len() + parts, first.or_else(|| part().map(|(_, error)| error.to_string())))
    }

    /// Asks once more for what could not be opened or read.
    pub fn retry(&mut self) {
        self.statistics.failed.clear();
        self.passing.clear();
        for object in &mut self.objects {
            object.preview.forgive();
            object.whole.forgive();
            if let Some(whole) = object.whole.get_mut() {
                whole.streamed.streamer.retry_damaged();
            }
        }
    }

    /// Whether something that could not be opened or read will be asked for again without [`retry`](Self::retry), if frames go on.
    pub fn will_retry(&self) -> bool {
        !self.passing.is_empty() || self.streamers().any(|streamer| streamer.recoverable > 0)
    }

    /// Lets what failed for a reason that may pass be opened again, when it is time.
    fn retry_passing(&mut self, elapsed_seconds: f32) {
        if !self.retries.is_due(elapsed_seconds, false) {
            return;
        }
        let passing = std::mem::take(&mut self.passing);
        self.retries.tried(!passing.is_empty());
        for (index, is_whole) in passing {
            let asset = self.asset(index).to_owned();
            self.statistics.failed.retain(|(failed, _)| *failed != asset);
            let object = &mut self.objects[index];
            if is_whole { object.whole.forgive() } else { object.preview.forgive() }
        }
    }

    /// Graphics memory for the texels of whole objects, and how much of it is in use; bytes.
    pub fn texel_bytes(&self) -> [u64; 2] {
        let wholes = self.objects.iter().filter_map(|object| object.whole.get());
        wholes.fold([0; 2], |[all, used], Whole { streamed, .. }| {
            let bytes = streamed.model.texel_bytes();
            let share = streamed.streamer.statistics().occupancy();
            [all + bytes, used + (bytes as f64 * share) as u64]
        })
    }

    /// Whether the picture stays as it is until the view changes.
    pub fn is_settled(&self) -> bool {
        self.shares.is_settled()
            && self.opening.is_none()
            && self.statistics.missing == 0
            && self.objects.iter().filter_map(|object| object.whole.get()).all(|whole| {
                whole.filling.is_none()
                    && whole.streamed.streamer.is_settled()
                    && !whole.streamed.model.has_hidden_atlas()
            })
    }

    /// Gives it other memory, and another filter, from the next frame on.
    pub fn set_options(&mut self, options: WorldOptions) {
        let anisotropy = max_anisotropy(&options.filter);
        if anisotropy != max_anisotropy(&self.options.filter) {
            for whole in self.objects.iter_mut().filter_map(|object| object.whole.get_mut()) {
                whole.streamed.streamer.set_max_anisotropy(anisotropy);
            }
        }
        if options.pool_bytes != self.options.pool_bytes {
            // So that every pool is looked at again.
            self.objects
                .iter_mut()
                .filter_map(|object| object.whole.get_mut())
                .for_each(|whole| whole.shares = 0);
        }
        self.options = options;
    }

    /// Lets objects come and go, and streaming go on, for a frame from `camera` onto `size` pixels. Returns whether something has changed
    /// that may be seen.
    ///
    /// # Errors
    /// The device cannot hold the pools. Objects that cannot be opened are listed in the [statistics](Self::statistics).
    pub fn advance(
        &mut self,
        gpu: &Arc<Gpu>,
        camera: &Camera,
        size: [u32; 2],
        frame: FrameOptions,
    ) -> Result<bool> {
        self.take_opened();
        self.retry_passing(frame.elapsed_seconds);
        let view = stream_view(camera, size, &self.space);
        let shown: Vec<_> = self.objects.iter().map(Object::detail).collect();
        let budget_bytes = self.options.geometry_bytes;
        let choice = choose_objects(&self.shapes, &view, budget_bytes, &shown);
        let is_there = |index: usize, detail| self.objects[index].has(detail);
        let mut details = choice.details.clone();
        for index in choice.staying(&self.shapes, budget_bytes, is_there) {
            details[index] = ObjectDetail::Whole;
        }
        for ((object, shape), detail) in self.objects.iter_mut().zip(&self.shapes).zip(details) {
            if detail < ObjectDetail::Whole {
                object.whole.empty();
            }
            if detail < ObjectDetail::Preview {
                object.preview.empty();
            }
            object.is_divided = detail == ObjectDetail::Whole && !shape.parts.is_empty();
        }
        let missing = choice.order.iter().filter(|&&(index, detail)| self.lacks(index, detail)).copied();
        let missing: Vec<_> = missing.collect();
        self.statistics.missing = missing.len();
        self.statistics.geometry_bytes = choice.bytes;
        for (index, detail) in missing {
            if self.opening.is_full() {
                break;
            }
            self.open(gpu, index, detail);
        }
        let wholes = choice.order.iter().filter(|(_, detail)| *detail == ObjectDetail::Whole);
        self.shares.update(wholes.count() as u64, frame.elapsed_seconds);
        let mut has_changed = self.stream(gpu, &view, frame)?;
        has_changed |= self.order_drawn(view.eye);
        Ok(has_changed)
    }

    /// Lets the whole objects stream, the nearest first; together they do and upload what a frame may.
    fn stream(&mut self, gpu: &Gpu, view: &StreamView, frame: FrameOptions) -> Result<bool> {
        let mut has_changed = false;
        let shares = self.shares.count();
        let pool_bytes = self.options.pool_bytes / shares;
        let mut upload_bytes = frame.upload_bytes;
        let is_whole = |index: &usize| self.objects[*index].whole.get().is_some();
        let mut wholes: Vec<usize> = (0..self.objects.len()).filter(is_whole).collect();
        self.sort_by_distance(&mut wholes, view.eye);
        let mut work = SharedWork::new(wholes.len());
        for index in wholes {
            let Some(whole) = self.objects[index].whole.get_mut() else { continue };
            if whole.shares != shares {
                whole.streamed.set_budget(gpu, pool_bytes)?;
                whole.shares = shares;
            }
            whole.streamed.streamer.set_frame_nanoseconds(work.next_turn());
            let changes = whole.streamed.advance(gpu, Some(view), FrameOptions { upload_bytes, ..frame });
            work.spend(whole.streamed.streamer.used_nanoseconds());
            has_changed |= !(changes.uploads.is_empty() && changes.entries.is_empty());
            let uploaded: usize = changes.uploads.iter().map(|upload| upload.texels.bytes()).sum();
            upload_bytes = upload_bytes.saturating_sub(uploaded);
            let [bytes, parcels] = &mut self.statistics.uploaded;
            *bytes += uploaded as u64;
            *parcels += changes.uploads.len() as u64;
            if let Some(seconds) = &mut whole.filling {
                *seconds += frame.elapsed_seconds;
                if whole.streamed.streamer.is_settled() || *seconds > MAX_FILLING_SECONDS {
                    whole.filling = None;
                }
            }
        }
        Ok(has_changed)
    }

    /// Whether something is wanted that neither is there nor has failed.
    fn lacks(&self, index: usize, detail: ObjectDetail) -> bool {
        let object = &self.objects[index];
        match detail {
            ObjectDetail::Absent => false,
            ObjectDetail::Preview => matches!(object.preview, Slot::Absent),
            ObjectDetail::Whole => matches!(object.whole, Slot::Absent),
        }
    }

    /// The name of an object's or a coarse asset's file in the index.
    fn asset(&self, index: usize) -> &str {
        match self.world.objects.get(index) {
            Some(object) => &object.asset,
            None => &self.world.coarse[index - self.world.objects.len()].asset,
        }
    }

    /// Begins to open an object, its preview, or a coarse asset, unless too many are being opened.
    fn open(&mut self, gpu: &Arc<Gpu>, index: usize, detail: ObjectDetail) {
        let is_whole = detail == ObjectDetail::Whole;
        let place = World::place_of(&self.index, self.asset(index));
        if !self.opening.may_add(is_whole, is_remote(&place)) {
            return;
        }
        let what = match is_whole {
            true => What::Whole,
            false if index < self.world.objects.len() => What::Preview,
            false => What::Coarse,
        };
        let order = Order {
            object: index,
            place,
            what,
            space: self.space.world_from_mesh,
            pool_bytes: self.options.pool_bytes / self.shares.count(),
        };
        opening::begin(gpu, order, self.opened.0.clone());
        *self.opening.count(is_whole) += 1;
        let object = &mut self.objects[index];
        match is_whole {
            true => object.whole = Slot::Opening,
            false => object.preview = Slot::Opening,
        }
    }

    /// Takes over what has been opened.
    fn take_opened(&mut self) {
        let anisotropy = max_anisotropy(&self.options.filter);
        while let Ok(Opened { object: index, result }) = self.opened.1.try_recv() {
            let is_whole = matches!(result, OpenedDetail::Whole(_));
            *self.opening.count(is_whole) -= 1;
            let object = &mut self.objects[index];
            let error = match result {
                OpenedDetail::Preview(preview) => {
                    let error = preview.as_ref().err().cloned();
                    object.preview.fill(preview.ok().map(|preview| {
                        let (model, surface) = *preview;
                        self.shapes[index].surface = surface;
                        model
                    }));
                    error
                }
                OpenedDetail::Whole(streamed) => {
                    let error = streamed.as_ref().err().cloned();
                    object.whole.fill(streamed.ok().map(|streamed| {
                        let mut streamed = *streamed;
                        streamed.streamer.set_max_anisotropy(anisotropy);
                        // Its pool may have been made for another number of objects.
                        Whole { streamed, filling: Some(0.0), shares: 0 }
                    }));
                    error
                }
            };
            if let Some(error) = error {
                let asset = self.asset(index).to_owned();
                let is_remote = is_remote(&World::place_of(&self.index, &asset));
                if is_remote && io_cause(&error).is_some_and(is_transient) {
                    self.passing.push((index, is_whole));
                }
                self.statistics.failed.push((asset, error.to_string()));
            }
        }
    }

    /// Sorts objects and coarse assets, the nearest first.
    fn sort_by_distance(&self, indices: &mut [usize], eye: Vec3) {
        // A distance costs hundreds of others. None is negative, so they have the order of their bits.
        indices.sort_by_cached_key(|&index| (self.shapes[index].distance(eye).to_bits(), index));
    }
}

/// Whether what lies there comes over a network.
fn is_remote(place: &Path) -> bool {
    // A page has no files.
    cfg!(target_arch = "wasm32") || url_of(place).is_some()
}

impl Object {
    fn has(&self, detail: ObjectDetail) -> bool {
        match detail {
            ObjectDetail::Absent => true,
            ObjectDetail::Preview => self.preview.get().is_some(),
            ObjectDetail::Whole => self.whole.get().is_some(),
        }
    }

    fn detail(&self) -> ObjectDetail {
        match (&self.whole, &self.preview) {
            _ if self.is_divided => ObjectDetail::Whole,
            (Slot::There(_) | Slot::Opening, _) => ObjectDetail::Whole,
            (_, Slot::There(_) | Slot::Opening) => ObjectDetail::Preview,
            _ => ObjectDetail::Absent,
        }
    }
}
