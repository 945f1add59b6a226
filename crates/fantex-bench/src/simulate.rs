//! Replays camera paths against a [`Streamer`] with a modelled disk, without a graphics card.
//!
//! Demand and residency run as they do in the viewer; only reading is modelled, in simulated time. So figures of hits, bytes,
//! evictions and waiting are the same on every machine; those of processor time are measured.

use std::cmp::Reverse;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use fantex_base::Error;
use fantex_base::Random;
use fantex_store::{Asset, PageId, group_pages};
use fantex_stream::{
    CameraPath, CutWatch, FrameOptions, Geometry, LoadedParcel, Outline, Parcel, ParcelLoader, ParcelTexels,
    Streamer, StreamerOptions,
};

/// What a path is replayed with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulationOptions {
    /// The streamer.
    pub streamer: StreamerOptions,
    /// The disk.
    pub disk: DiskModel,
    /// Pixels of the picture.
    pub size: [u32; 2],
    /// Frames per second.
    pub frame_rate: f64,
    /// Bytes that may be uploaded per frame.
    pub upload_bytes: usize,
    /// Seconds that the camera stands still at the end of the path.
    pub rest_seconds: f64,
}

impl Default for SimulationOptions {
    /// 1280x720 at 60 frames per second, half a second of rest.
    fn default() -> Self {
        Self {
            streamer: StreamerOptions::default(),
            disk: DiskModel::default(),
            size: [1280, 720],
            frame_rate: 60.0,
            upload_bytes: 4 << 20,
            rest_seconds: 0.5,
        }
    }
}

/// What happened on a path. Its `Display` is one row under [`SimulationReport::HEADING`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimulationReport {
    /// Frames.
    pub frames: u64,
    /// Share of the needed parcels that were resident, mean over the frames.
    pub hit_rate: f64,
    /// Share of the visible tiles that were at their level, mean over the frames.
    pub complete_share: f64,
    /// Share of the frames in which every visible tile was at its level.
    pub complete_frames: f64,
    /// Bytes of texels handed over for upload.
    pub bytes: u64,
    /// Parcels asked for.
    pub requests: u64,
    /// Parcels that left.
    pub evictions: u64,
    /// The greatest share of the atlas in use.
    pub peak_occupancy: f64,
    /// The greatest bias, levels.
    pub peak_bias_levels: f32,
    /// After the beginning and each cut, seconds until the visible tiles were at the levels that the cut asked of them (see
    /// [`CutWatch`]); `None` where the next cut came first.
    pub seconds_to_sharp: Vec<Option<f64>>,
    /// Processor time of demand, per frame, ascending.
    pub demand_times: Vec<Duration>,
    /// Processor time of everything else, per frame, ascending.
    pub residency_times: Vec<Duration>,
    /// Whether nothing was on its way at the end.
    pub is_settled: bool,
}

impl SimulationReport {
    /// Names of the columns.
    pub const HEADING: &'static str = "frames  hits %  sharp %  sharp frames %     MB  requests  evictions  pool %  bias  to sharp ms  demand us p50/max  \
         residency us p50/max";

    /// The longest time to sharp; `None` if some view never was.
    pub fn slowest_to_sharp(&self) -> Option<f64> {
        self.seconds_to_sharp.iter().try_fold(0.0, |longest: f64, &seconds| Some(longest.max(seconds?)))
    }
}

impl fmt::Display for SimulationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let micros = |times: &[Duration]| {
            let at = |i: usize| times.get(i).map_or(0.0, |t| t.as_secs_f64() * 1e6);
            format!("{:.0}/{:.0}", at(times.len() / 2), at(times.len().saturating_sub(1)))
        };
        let sharp = self.slowest_to_sharp().map_or("never".to_owned(), |s| format!("{:.0}", s * 1e3));
        write!(
            f,
            "{:6} {:7.2} {:8.2} {:15.1} {:6.1} {:9} {:10} {:7.1} {:5.2} {:>12} {:>18} {:>21}",
            self.frames,
            100.0 * self.hit_rate,
            100.0 * self.complete_share,
            100.0 * self.complete_frames,
            self.bytes as f64 / 1e6,
            self.requests,
            self.evictions,
            100.0 * self.peak_occupancy,
            self.peak_bias_levels,
            sharp,
            micros(&self.demand_times),
            micros(&self.residency_times),
        )
    }
}

/// Replays a path; parcels are whole rectangles.
pub fn simulate(
    geometry: Arc<dyn Geometry>,
    path: &CameraPath,
    options: &SimulationOptions,
) -> SimulationReport {
    simulate_with(geometry, path, options, Arc::new(|_| Outline::WHOLE))
}

/// Replays a path; `outlines` tells what of a parcel is stored.
pub fn simulate_with(
    geometry: Arc<dyn Geometry>,
    path: &CameraPath,
    options: &SimulationOptions,
    outlines: Outlines,
) -> SimulationReport {
    let clock = ModelClock::default();
    let loader = ModelLoader::new(geometry.clone(), options.disk, clock.clone()).with_outlines(outlines);
    let mut streamer = Streamer::new(geometry.clone(), Box::new(loader), options.streamer);
    let mut report = SimulationReport::default();
    let mut cuts = path.cuts_seconds().into_iter().peekable();
    let mut waiting: Option<(f64, CutWatch)> = None;
    let frames = ((path.duration_seconds() + options.rest_seconds) * options.frame_rate).ceil() as u64;
    let texel_bytes = options.disk.texel_bytes;
    for frame in 0..=frames {
        let seconds = frame as f64 / options.frame_rate;
        clock.set(seconds);
        while cuts.next_if(|&cut| cut <= seconds).is_some() {
            if waiting.replace((seconds, CutWatch::new())).is_some() {
                report.seconds_to_sharp.push(None);
            }
        }
        let camera = path.at(seconds);
        let view = camera.and_then(|c| c.view(&geometry.mesh().world_from_mesh, options.size));
        let elapsed_seconds = (1.0 / options.frame_rate) as f32;
        let changes = streamer
            .update(view.as_ref(), FrameOptions { upload_bytes: options.upload_bytes, elapsed_seconds });
        let figures = streamer.statistics();
        let texels = |extent: [u32; 2]| f64::from(extent[0]) * f64::from(extent[1]);
        report.bytes +=
            changes.uploads.iter().map(|u| texels(u.texels.extent) * texel_bytes).sum::<f64>() as u64;
        let needed = figures.needed.parcels.max(1);
        report.hit_rate += 1.0 - figures.missing as f64 / needed as f64;
        report.complete_share += figures.complete_share();
        report.complete_frames += f64::from(u8::from(figures.complete_groups == figures.visible_groups));
        report.peak_occupancy = report.peak_occupancy.max(figures.occupancy());
        report.peak_bias_levels = report.peak_bias_levels.max(figures.bias_levels);
        report.demand_times.push(figures.times.demand);
        report.residency_times.push(figures.times.residency + figures.times.prediction);
        if waiting.as_mut().is_some_and(|(_, watch)| watch.update(&streamer))
            && let Some((since, _)) = waiting.take()
        {
            report.seconds_to_sharp.push(Some(seconds - since));
        }
    }
    if waiting.is_some() {
        report.seconds_to_sharp.push(None);
    }
    let figures = streamer.statistics();
    report.frames = frames + 1;
    report.hit_rate /= report.frames as f64;
    report.complete_share /= report.frames as f64;
    report.complete_frames /= report.frames as f64;
    report.requests = figures.requests;
    report.evictions = figures.evictions;
    report.demand_times.sort_unstable();
    report.residency_times.sort_unstable();
    report.is_settled = streamer.is_settled();
    report
}

// A loader that reads nothing: it models the time that reading takes.

/// A disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskModel {
    /// From a request's start to its arrival, seconds.
    pub latency_seconds: f64,
    /// Bytes per second.
    pub bandwidth: f64,
    /// Requests that are worked on at a time.
    pub queue_depth: usize,
    /// Bytes of a texel, all channels together.
    pub texel_bytes: f64,
    /// Share of the parcels that can never be read, 0 to 1.
    pub damaged_share: f64,
}

impl Default for DiskModel {
    /// A solid-state disk: 0.1 ms, 1 GB/s, 64 requests; one byte per texel; nothing is damaged.
    fn default() -> Self {
        Self { latency_seconds: 1e-4, bandwidth: 1e9, queue_depth: 64, texel_bytes: 1.0, damaged_share: 0.0 }
    }
}

/// Simulated time of a [`ModelLoader`], shared with its driver.
#[derive(Clone, Debug, Default)]
pub struct ModelClock(Arc<AtomicU64>);

impl ModelClock {
    /// Seconds since the beginning.
    pub fn seconds(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }

    /// Sets the time.
    pub fn set(&self, seconds: f64) {
        self.0.store(seconds.to_bits(), Ordering::Relaxed);
    }
}

/// What of a parcel is stored.
pub type Outlines = Arc<dyn Fn(Parcel) -> Outline + Send + Sync>;

/// The outlines of an asset's parcels, all read at once.
///
/// # Errors
/// A page cannot be read.
pub fn outlines_of(asset: &Asset) -> Result<Outlines, Error> {
    let mut outlines = HashMap::new();
    for (index, group) in (0..).zip(&asset.cover().groups) {
        for page in group_pages(index, group) {
            let parcel = Parcel::of(group, page);
            if let Entry::Vacant(vacant) = outlines.entry(parcel) {
                let layout = parcel.layout(asset.cover());
                let stored_page = |channel, page| asset.read_page_raw(channel, page);
                vacant.insert(Outline::of_stored(&layout, asset.channels(), stored_page)?);
            }
        }
    }
    Ok(Arc::new(move |parcel| outlines.get(&parcel).cloned().unwrap_or_default()))
}

/// Order in which requests are served: the most urgent first, then as they came.
type Rank = (Reverse<u32>, u64);

/// A [`ParcelLoader`] whose parcels arrive when a modelled disk would have read them. All channels of a parcel come as one.
pub struct ModelLoader {
    geometry: Arc<dyn Geometry>,
    outlines: Outlines,
    disk: DiskModel,
    clock: ModelClock,
    ranks: BTreeMap<Parcel, Rank>,
    queue: BTreeMap<Rank, Parcel>,
    /// All that are being read or have arrived.
    begun: BTreeSet<Parcel>,
    /// Being read, with the time of arrival, ascending.
    reading: VecDeque<(f64, Parcel)>,
    arrived: VecDeque<Parcel>,
    /// When something was asked for last.
    asked_at: f64,
    /// When the disk has moved all bytes that it has begun to.
    idle_at: f64,
    requests: u64,
}

impl ModelLoader {
    /// The same with outlines.
    #[must_use]
    pub fn with_outlines(self, outlines: Outlines) -> Self {
        Self { outlines, ..self }
    }

    /// A loader of the parcels of a cover, all of them whole rectangles.
    pub fn new(geometry: Arc<dyn Geometry>, disk: DiskModel, clock: ModelClock) -> Self {
        Self {
            geometry,
            outlines: Arc::new(|_| Outline::WHOLE),
            disk,
            clock,
            ranks: BTreeMap::new(),
            queue: BTreeMap::new(),
            begun: BTreeSet::new(),
            reading: VecDeque::new(),
            arrived: VecDeque::new(),
            asked_at: 0.0,
            idle_at: 0.0,
            requests: 0,
        }
    }

    /// Two bytes that stand for a page. A parcel's texels begin with those of its pages, in the order of its layout.
    pub fn signature(page: PageId) -> [u8; 2] {
        let mut seed = u64::from(page.group) << 32 ^ u64::from(page.level) << 24;
        seed ^= u64::from(page.page[0]) << 12 ^ u64::from(page.page[1]);
        (Random::new(seed).next_u64() as u16).to_le_bytes()
    }

    /// Whether a parcel can never be read.
    pub fn is_damaged(parcel: Parcel, share: f64) -> bool {
        let seed = match parcel {
            Parcel::Bundle { bundle, step } => u64::from(bundle) << 32 ^ u64::from(step) ^ 0xB0,
            Parcel::Page(PageId { group, level, page }) => {
                let [x, y] = page.map(u64::from);
                u64::from(group) << 30 ^ u64::from(level) << 25 ^ x << 13 ^ y ^ 0xDA_3A6E
            }
        };
        Random::new(seed).unit() < share
    }

    /// Lets the disk work until now.
    fn advance(&mut self) {
        let now = self.clock.seconds();
        let mut free_at = self.asked_at;
        loop {
            while self.reading.len() < self.disk.queue_depth {
                let Some((_, parcel)) = self.queue.pop_first() else { break };
                self.ranks.remove(&parcel);
                self.begun.insert(parcel);
                self.idle_at = self.idle_at.max(free_at) + self.bytes(parcel) as f64 / self.disk.bandwidth;
                self.reading.push_back((self.idle_at + self.disk.latency_seconds, parcel));
            }
            match self.reading.front() {
                Some(&(arrival, parcel)) if arrival <= now => {
                    self.reading.pop_front();
                    self.arrived.push_back(parcel);
                    free_at = arrival.max(self.asked_at);
                }
                _ => return,
            }
        }
    }

    fn bytes(&self, parcel: Parcel) -> usize {
        let slots = parcel.layout(self.geometry.cover()).slots;
        let texels = slots.iter().map(|slot| f64::from(slot.extent[0]) * f64::from(slot.extent[1]));
        (texels.sum::<f64>() * self.disk.texel_bytes).ceil() as usize
    }

    fn load(&self, parcel: Parcel) -> LoadedParcel {
        if Self::is_damaged(parcel, self.disk.damaged_share) {
            let error = Error::damaged("model is damaged");
            return LoadedParcel { parcel, texels: Err(error) };
        }
        let layout = parcel.layout(self.geometry.cover());
        let mut signatures =
            layout.slots.iter().flat_map(|slot| Self::signature(slot.page)).collect::<Vec<_>>();
        signatures.resize(self.bytes(parcel).max(signatures.len()), 0);
        let channels = vec![Arc::from(signatures)];
        LoadedParcel {
            parcel,
            texels: Ok(ParcelTexels { extent: layout.extent, outline: (self.outlines)(parcel), channels }),
        }
    }
}

impl ParcelLoader for ModelLoader {
    fn request(&mut self, parcel: Parcel, urgency: f32) {
        if self.begun.contains(&parcel) {
            return;
        }
        self.asked_at = self.clock.seconds();
        // Finite numbers in the order of their bits, negative ones turned round.
        let bits = urgency.to_bits();
        let ordered = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
        self.requests += 1;
        let rank = (Reverse(ordered), self.requests);
        if let Some(last) = self.ranks.insert(parcel, rank) {
            self.queue.remove(&last);
        }
        self.queue.insert(rank, parcel);
    }

    fn cancel(&mut self, parcel: Parcel) {
        if let Some(rank) = self.ranks.remove(&parcel) {
            self.queue.remove(&rank);
        }
        if self.begun.remove(&parcel) {
            self.reading.retain(|&(_, reading)| reading != parcel);
            self.arrived.retain(|&arrived| arrived != parcel);
        }
    }

    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel> {
        self.advance();
        let mut bytes = 0;
        let mut loaded = Vec::new();
        while let Some(&parcel) = self.arrived.front() {
            bytes += self.bytes(parcel);
            if bytes > max_bytes && !loaded.is_empty() {
                break;
            }
            self.arrived.pop_front();
            self.begun.remove(&parcel);
            loaded.push(self.load(parcel));
        }
        loaded
    }

    fn pending(&self) -> usize {
        self.queue.len() + self.reading.len() + self.arrived.len()
    }
}
