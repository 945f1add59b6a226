//! The streamer: demand, residency and a loader together, the prediction of the camera, and when a view is sharp after a cut.

use std::sync::Arc;
use std::time::Duration;

use fantex_base::Error;
use fantex_cover::Cover;
use fantex_mesh::Mesh;
use fantex_store::{Asset, PageId};
use glam::{Mat3, Quat, Vec2, Vec3};
use web_time::Instant;

use crate::demand::{Demand, DemandSurface, DemandWork};
use crate::residency::{COUNTED_LEVELS, FRAME_NANOSECONDS, FrameWork, ParcelCount, RequestLimits, Residency};
use crate::shape::TileShapes;
use crate::{
    AtlasShape, Detail, FrameChanges, Outline, PageTable, Parcel, ParcelLoader, RetryTimer, StreamView,
};

/// What a streamer is built with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamerOptions {
    /// Room for texels.
    pub atlas: AtlasShape,
    /// The greatest ratio of a pixel's axes on the surface that the renderer's filter honours; 1 for trilinear look-ups.
    pub max_anisotropy: f32,
    /// How much is on its way at a time.
    pub limits: RequestLimits,
    /// How far ahead of a moving camera parcels are fetched, seconds; 0 for not at all.
    pub look_ahead_seconds: f32,
    /// Work of a sixtieth of a second, in nanoseconds that things should take; see [`FrameWork`].
    pub frame_nanoseconds: u32,
}

impl Default for StreamerOptions {
    /// 64 Mi texels, anisotropy up to 16, a quarter of a second ahead, 6 ms of work.
    fn default() -> Self {
        Self {
            atlas: AtlasShape { side: 4096, layers: 4 },
            max_anisotropy: 16.0,
            limits: RequestLimits::default(),
            look_ahead_seconds: 0.25,
            frame_nanoseconds: FRAME_NANOSECONDS,
        }
    }
}

/// What holds for one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Bytes of texels that may be uploaded; exceeded by less than a parcel.
    pub upload_bytes: usize,
    /// Seconds since the last frame.
    pub elapsed_seconds: f32,
}

impl Default for FrameOptions {
    /// 4 MiB, a sixtieth of a second.
    fn default() -> Self {
        Self { upload_bytes: 4 << 20, elapsed_seconds: 1.0 / 60.0 }
    }
}

/// Decides what is in the atlas. Owned by the renderer's thread and called once per frame; reading happens in the loader's threads.
pub struct Streamer {
    geometry: Arc<dyn Geometry>,
    surface: DemandSurface,
    demand: Demand,
    predicted: Demand,
    residency: Residency,
    loader: Box<dyn ParcelLoader>,
    options: StreamerOptions,
    motion: Motion,
    changed: Vec<u32>,
    times: UpdateTimes,
    retries: RetryTimer,
}

/// Processor time of the last update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UpdateTimes {
    /// Finding the groups whose demand has changed.
    pub demand: Duration,
    /// The same for the predicted view.
    pub prediction: Duration,
    /// Everything else: wanting, requesting, placing.
    pub residency: Duration,
}

impl Streamer {
    /// Nothing is resident. Takes time linear in the mesh.
    pub fn new(geometry: Arc<dyn Geometry>, loader: Box<dyn ParcelLoader>, options: StreamerOptions) -> Self {
        let shapes = Arc::new(TileShapes::new(geometry.cover()));
        let table = PageTable::new(geometry.cover());
        let surface = DemandSurface::new(geometry.clone(), shapes.clone());
        Self {
            demand: Demand::new(&surface, options.max_anisotropy),
            predicted: Demand::new(&surface, options.max_anisotropy),
            residency: Residency::new(shapes, table, options.atlas, options.frame_nanoseconds),
            geometry,
            surface,
            loader,
            options,
            motion: Motion::default(),
            changed: Vec::new(),
            times: UpdateTimes::default(),
            retries: RetryTimer::default(),
        }
    }

    /// Brings everything up to date with a view; `None` (a picture without pixels) needs nothing, and what is resident
    /// stays. Never waits.
    pub fn update(&mut self, view: Option<&StreamView>, frame: FrameOptions) -> FrameChanges {
        let started = Instant::now();
        let loader = &mut *self.loader;
        let is_moving = self.motion.advance(view, frame.elapsed_seconds, self.surface.radius());
        self.residency.begin_frame(frame.elapsed_seconds, self.motion.is_cut);
        // Requests and cancels made since the last frame (changed texels) come before arrivals.
        self.residency.tell(loader);
        let mut changes = self.residency.arrive(frame.upload_bytes, loader);
        let is_remote = loader.is_remote();
        let arrived = Instant::now();
        self.changed.clear();
        self.demand.update(
            &mut self.surface,
            view,
            self.residency.work.bounding_nanoseconds(),
            &mut self.changed,
        );
        let demanded = Instant::now();
        self.residency.want(&self.changed, &self.demand);
        self.residency.adapt(&self.demand, is_moving);
        self.residency.request(&self.demand, None, &self.options.limits);
        let requested = Instant::now();
        self.look_ahead();
        if is_remote && self.retries.is_due(frame.elapsed_seconds, self.residency.take_recovery()) {
            self.retries.tried(self.residency.retry_passing());
        }
        let predicted = Instant::now();
        self.residency.tell(&mut *self.loader);
        changes.entries = self.residency.pool.take_changes();
        self.times = UpdateTimes {
            demand: demanded - arrived,
            prediction: predicted - requested,
            residency: (arrived - started) + (requested - demanded) + predicted.elapsed(),
        };
        changes
    }

    fn look_ahead(&mut self) {
        if self.options.look_ahead_seconds <= 0.0 {
            return;
        }
        let Some(view) = self.motion.predict(self.options.look_ahead_seconds) else {
            self.residency.expect_nothing();
            return;
        };
        if self.residency.queued() > 0 {
            return;
        }
        self.changed.clear();
        // The last prediction is taken over first.
        if !self.residency.has_unexpected() {
            let nanoseconds = self.residency.work.bounding_nanoseconds();
            self.predicted.update(&mut self.surface, Some(&view), nanoseconds, &mut self.changed);
        }
        self.residency.expect(&self.changed, &self.predicted);
        self.residency.request(&self.demand, Some(&self.predicted), &self.options.limits);
    }

    /// The mesh and cover that are streamed.
    pub fn geometry(&self) -> &Arc<dyn Geometry> {
        &self.geometry
    }

    /// The numbering of the entries in [`FrameChanges`].
    pub fn table(&self) -> &PageTable {
        &self.residency.pool.table
    }

    /// The atlas that places refer to.
    pub fn atlas(&self) -> AtlasShape {
        self.residency.pool.shape
    }

    /// Replaces the atlas by an empty one; the next update clears all entries.
    pub fn set_atlas(&mut self, atlas: AtlasShape) {
        self.options.atlas = atlas;
        self.residency.set_atlas(atlas, &self.demand);
    }

    /// The renderer's filter honours another ratio of a pixel's axes.
    pub fn set_max_anisotropy(&mut self, max_anisotropy: f32) {
        self.options.max_anisotropy = max_anisotropy;
        self.demand.set_max_anisotropy(max_anisotropy);
        self.predicted.set_max_anisotropy(max_anisotropy);
    }

    /// Another [work](StreamerOptions::frame_nanoseconds) of a sixtieth of a second, from the next update on.
    pub fn set_frame_nanoseconds(&mut self, nanoseconds: u32) {
        self.options.frame_nanoseconds = nanoseconds;
        self.residency.work.regular = nanoseconds;
    }

    /// What of that the last update has used; a little more than all where the last step was a long one.
    pub fn used_nanoseconds(&self) -> u32 {
        self.residency.work.used_nanoseconds()
    }

    /// What the atlas stores of a resident page: updates in place have no room for more.
    pub fn outline(&self, page: PageId) -> Outline {
        self.residency.outline(page)
    }

    /// The stored texels of these pages have changed: what is resident is read and uploaded again, in place, and what was
    /// damaged gets another chance.
    pub fn invalidate(&mut self, pages: &[PageId]) {
        self.residency.invalidate(pages, &self.demand);
    }

    /// Parcels that could not be loaded, with the reason; a coarser level stands in for them, and finer ones are resident without them. They are not
    /// asked for again, unless they come over a network and the reason may pass: then after 2, 4, 8 ... 60 seconds.
    pub fn damaged(&self) -> impl Iterator<Item = (&Parcel, &Error)> {
        self.residency.damaged.iter()
    }

    /// Asks for all damaged parcels once more.
    pub fn retry_damaged(&mut self) {
        self.residency.retry_damaged(&self.demand);
    }

    /// What a group needs in the current view, without the bias.
    pub fn detail(&self, group: u32) -> Detail {
        self.demand.detail(group)
    }

    /// The finest level that a group is to have, with the bias; `None` for none, as when it is out of sight.
    pub fn wanted_level(&self, group: u32) -> Option<u32> {
        self.residency.wanted_level(group)
    }

    /// The finest level of which a group has something; `None` if it has only its mean.
    pub fn resident_level(&self, group: u32) -> Option<u32> {
        self.residency.resident_level(group)
    }

    /// The finest level from `level` on that a group has at a place of its tile (0..1 along the sides), so that it is drawn there; `None`
    /// where that is only its mean.
    pub fn drawn_level(&self, group: u32, level: u32, uv: Vec2) -> Option<u32> {
        self.residency.drawn_level(group, level, uv)
    }

    /// Whether the view needs a parcel that is not resident, and may become so.
    pub fn is_missing(&self, parcel: Parcel) -> bool {
        self.residency.is_missing(parcel)
    }

    /// All such parcels, bundles first, then ascending by group. Takes time linear in the number of groups.
    pub fn missing(&self) -> Vec<Parcel> {
        self.residency.all_missing()
    }

    /// Whether the view's demand, or another bias, has not been taken over for all groups yet.
    pub fn has_backlog(&self) -> bool {
        self.demand.is_behind() || self.residency.has_backlog()
    }

    /// Whether nothing is on its way or waits to be asked for: the picture stays as it is until the view changes.
    pub fn is_settled(&self) -> bool {
        !self.demand.is_behind() && self.residency.in_flight() == (0, 0) && self.residency.queued() == 0
    }

    /// Figures for graphs.
    pub fn statistics(&self) -> StreamStatistics {
        let recoverable = if self.loader.is_remote() { self.residency.passing().count() } else { 0 };
        let (work, times) = (self.demand.work, self.times);
        StreamStatistics { recoverable, work, times, ..self.residency.statistics() }
    }

    /// Panics where an invariant of what is resident, needed and on its way does not hold. Takes time linear in all parcels.
    pub fn sanity_check(&self) {
        self.residency.check();
    }
}

/// Figures of a streamer. Counters begin with the streamer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamStatistics {
    /// In the atlas, with the texels that are stored.
    pub resident: ParcelCount,
    /// The texels of whole tiles among them, per level, finest first.
    pub resident_texels_by_level: [u64; COUNTED_LEVELS],
    /// What the view needs, with the bias; texels of whole rectangles.
    pub needed: ParcelCount,
    /// Parcels of that which are not resident.
    pub missing: u64,
    /// Texels of the atlas.
    pub atlas_texels: u64,
    /// Parcels that left.
    pub evictions: u64,
    /// Parcels asked for and not arrived.
    pub requested: usize,
    /// Parcels arrived, not placed yet.
    pub waiting: usize,
    /// Groups whose demand has not been taken over (or that of a neighbour), and groups and bundles whose missing parcels have not
    /// been asked for.
    pub queued: usize,
    /// Parcels asked for.
    pub requests: u64,
    /// Bytes of texels handed over for upload.
    pub uploaded_bytes: u64,
    /// Levels by which everything is coarser than its pixels ask for, so that it fits.
    pub bias_levels: f32,
    /// Groups that need texels.
    pub visible_groups: u64,
    /// Groups of these that have all that they need; they are sharp where the bias is zero.
    pub complete_groups: u64,
    /// Parcels that could not be loaded.
    pub damaged: usize,
    /// Those of them that [`Streamer::update`] asks for again by itself when it is time.
    pub recoverable: usize,
    /// Bounding of the last update.
    pub work: DemandWork,
    /// Work of the last update by which it was limited.
    pub frame_work: FrameWork,
    /// Nanoseconds that the last update might spend on it.
    pub frame_limit: u32,
    /// Time of the last update.
    pub times: UpdateTimes,
}

impl StreamStatistics {
    /// Share of the atlas that is in use, 0 to 1.
    pub fn occupancy(&self) -> f64 {
        self.resident.texels as f64 / self.atlas_texels.max(1) as f64
    }

    /// Share of the visible tiles that are at their level, 0 to 1; 1 if none is visible.
    pub fn complete_share(&self) -> f64 {
        if self.visible_groups == 0 { 1.0 } else { self.complete_groups as f64 / self.visible_groups as f64 }
    }
}

#[derive(Debug, Default)]
struct Motion {
    view: Option<StreamView>,
    velocity: Option<Velocity>,
    is_steady: bool,
    is_cut: bool,
}

/// Way and turn per second: frames are of uneven length.
#[derive(Clone, Copy, Debug)]
struct Velocity {
    /// Mesh units per second.
    travel: Vec3,
    /// Axis times radians per second.
    turn: Vec3,
}

/// Maximum turn of a predicted camera, radians.
const MAX_PREDICTED_TURN: f32 = 0.5;

/// A camera that turns by more than this in one frame has jumped, radians.
const CUT_TURN: f32 = 0.2;
/// So has one that goes farther than this share of the mesh's radius. (Other jumps are seen by what they lack.)
const CUT_TRAVEL: f32 = 0.05;

/// Turns that differ by at most this, radians per second, count as equal.
const STEADY_TURN: f32 = 0.06;

impl Motion {
    /// Takes the next view, `seconds` after the last one; whether it differs from that.
    fn advance(&mut self, view: Option<&StreamView>, seconds: f32, mesh_radius: f32) -> bool {
        let last = std::mem::replace(&mut self.view, view.copied());
        let (Some(last), Some(view), true) = (last, view, seconds > 0.0) else {
            (self.velocity, self.is_steady, self.is_cut) = (None, false, view.is_some());
            return true;
        };
        let turn = Quat::from_mat3(&(view.axes * last.axes.transpose())).normalize().to_scaled_axis();
        // Of the two ways to turn the shorter one.
        let angle = turn.length();
        let shorter = if angle > std::f32::consts::PI { 1.0 - std::f32::consts::TAU / angle } else { 1.0 };
        let velocity = Velocity { travel: (view.eye - last.eye) / seconds, turn: turn * shorter / seconds };
        let is_moving = last != *view;
        self.is_cut =
            (turn * shorter).length() > CUT_TURN || last.eye.distance(view.eye) > CUT_TRAVEL * mesh_radius;
        // Steady motion continues nearly unchanged: neither a cut nor a trembling hand.
        self.is_steady = is_moving
            && self.velocity.is_some_and(|before| {
                before.travel.distance(velocity.travel) <= 0.5 * velocity.travel.length() + f32::EPSILON
                    && before.turn.distance(velocity.turn) <= 0.5 * velocity.turn.length() + STEADY_TURN
            });
        self.velocity = Some(velocity);
        is_moving
    }

    fn predict(&self, ahead_seconds: f32) -> Option<StreamView> {
        let (view, velocity) = (self.view?, self.velocity?);
        if !self.is_steady {
            return None;
        }
        let turn = (velocity.turn * ahead_seconds).clamp_length_max(MAX_PREDICTED_TURN);
        Some(StreamView {
            eye: view.eye + velocity.travel * ahead_seconds,
            axes: Mat3::from_quat(Quat::from_scaled_axis(turn)) * view.axes,
            ..view
        })
    }
}

// Where mesh and cover come from.

/// A covered mesh: an open asset, or one made for a test.
pub trait Geometry: Send + Sync {
    /// The mesh, mesh space.
    fn mesh(&self) -> &Mesh;

    /// Its cover.
    fn cover(&self) -> &Cover;
}

impl Geometry for Asset {
    fn mesh(&self) -> &Mesh {
        self.mesh()
    }

    fn cover(&self) -> &Cover {
        self.cover()
    }
}

/// A covered mesh without texels.
#[derive(Clone, Debug)]
pub struct CoveredMesh {
    /// The mesh.
    pub mesh: Mesh,
    /// Its cover.
    pub cover: Cover,
}

impl Geometry for CoveredMesh {
    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn cover(&self) -> &Cover {
        &self.cover
    }
}

// When a view is sharp after a cut.

/// Waits until what a view needed when the camera cut to it has come.
///
/// A camera that keeps moving after the cut needs other parcels in every frame, and one that becomes needed now is there in
/// the next frame at the earliest, unless it was foreseen. So a frame that lacks nothing at all may be far off although all that
/// the cut uncovered came at once. What is awaited is what the view lacked at the cut; what the camera has left behind
/// since then is no longer awaited, nor is what cannot be read.
#[derive(Clone, Debug, Default)]
pub struct CutWatch {
    awaited: Vec<Parcel>,
    is_known: bool,
}

impl CutWatch {
    /// To be updated from the cut's own frame on.
    pub fn new() -> Self {
        Self::default()
    }

    /// Looks at a streamer after its update; whether all visible tiles have the levels that the cut asked of them. Costs
    /// next to nothing per frame but one look at all groups: parcels are looked at until the first that is missing.
    pub fn update(&mut self, streamer: &Streamer) -> bool {
        if !self.is_known && !streamer.has_backlog() {
            self.awaited = streamer.missing();
            self.is_known = true;
        }
        while self.awaited.pop_if(|parcel| !streamer.is_missing(*parcel)).is_some() {}
        self.is_known && self.awaited.is_empty()
    }

    /// Parcels that are still awaited, and some that have come meanwhile.
    pub fn awaited(&self) -> &[Parcel] {
        &self.awaited
    }
}
