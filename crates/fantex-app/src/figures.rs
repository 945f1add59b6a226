//! What streaming and drawing tell about themselves, for panels and graphs.

use std::collections::VecDeque;

/// Frames that graphs show.
const SHOWN_FRAMES: usize = 240;

/// Most damaged parts that are listed.
pub const LISTED_DAMAGE: usize = 100;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelFigures {
    /// Texels in the atlas.
    pub resident: u64,
    pub texels: u64,
}

/// A page, or a level of a bundle of tiles, that could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedPart {
    /// Group, level and page, or tiles and level, in words.
    pub part: String,
    pub reason: String,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamFigures {
    /// Per detail level, the finest first.
    pub levels: Vec<LevelFigures>,
    pub pool_bytes: u64,
    pub used_bytes: u64,
    /// Sides of the atlas' layers in texels, and their number.
    pub atlas: [u32; 3],
    /// Levels by which everything is coarser than wanted, so that it fits.
    pub bias: f32,
    /// Wanted parcels that are not resident.
    pub missing: u64,
    pub wanted: u64,
    /// Parcels that are being read.
    pub queue: u64,
    /// Bytes that went to the graphics memory since the start.
    pub uploaded_bytes: u64,
    pub uploaded_parcels: u64,
    pub evicted_parcels: u64,
    pub damaged: Vec<DamagedPart>,
    pub damaged_count: u64,
    /// Of a world what there is of its objects.
    pub objects: Option<ObjectFigures>,
}

/// The objects and coarse assets of a world.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectFigures {
    pub whole: u64,
    /// Shown by their previews.
    pub previews: u64,
    /// Coarse assets that are shown, each for several objects.
    pub coarse: u64,
    /// Objects, previews and coarse assets to come.
    pub missing: u64,
    /// Drawn triangles.
    pub triangles: u64,
    /// Memory that their geometry counts for.
    pub geometry_bytes: u64,
    /// Names of objects that could not be opened, and why.
    pub failed: Vec<(String, String)>,
}

impl StreamFigures {
    /// Share of the wanted parcels that are resident, 0..1.
    pub fn hit_rate(&self) -> f32 {
        if self.wanted == 0 { 1.0 } else { 1.0 - self.missing as f32 / self.wanted as f32 }
    }

    /// Whether everything that is wanted is there.
    pub fn is_sharp(&self) -> bool {
        self.missing == 0 && self.objects.as_ref().is_none_or(|objects| objects.missing == 0)
    }

    /// Share of the pool that is in use, 0..1.
    pub fn occupancy(&self) -> f32 {
        if self.pool_bytes == 0 { 0.0 } else { self.used_bytes as f32 / self.pool_bytes as f32 }
    }
}

#[derive(Clone, Debug)]
pub struct Graphs {
    pub frame_ms: History,
    pub pool: History,
    pub queue: History,
    pub bandwidth: History,
    meter: RateMeter,
}

impl Default for Graphs {
    fn default() -> Self {
        let history = || History::new(SHOWN_FRAMES);
        Self {
            frame_ms: history(),
            pool: history(),
            queue: history(),
            bandwidth: history(),
            meter: RateMeter::default(),
        }
    }
}

impl Graphs {
    pub fn picture(&mut self, seconds: f64) {
        self.frame_ms.push((seconds * 1e3) as f32);
    }

    /// Streaming went on to a time in seconds.
    pub fn stream(&mut self, seconds: f64, now: &StreamFigures) {
        self.pool.push(now.occupancy());
        self.queue.push(now.queue as f32);
        self.bandwidth.push(self.meter.update(seconds, now.uploaded_bytes as f64) as f32);
    }

    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

/// The last values of a figure, oldest first.
#[derive(Clone, Debug)]
pub struct History {
    values: VecDeque<f32>,
    capacity: usize,
}

impl History {
    /// Keeps the last `capacity` (at least one) values.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { values: VecDeque::with_capacity(capacity), capacity }
    }

    /// Adds a value; anything but a finite number counts as zero.
    pub fn push(&mut self, value: f32) {
        if self.values.len() == self.capacity {
            self.values.pop_front();
        }
        self.values.push_back(if value.is_finite() { value } else { 0.0 });
    }

    /// The values, oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = f32> + ExactSizeIterator + '_ {
        self.values.iter().copied()
    }

    pub fn last(&self) -> Option<f32> {
        self.values.back().copied()
    }

    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// The value that a share (0..1) of the values does not exceed.
    pub fn percentile(&self, share: f32) -> Option<f32> {
        let mut sorted: Vec<f32> = self.iter().collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let rank = (share.clamp(0.0, 1.0) * sorted.len() as f32).ceil() as usize;
        Some(sorted[rank.saturating_sub(1).min(last)])
    }
}

/// Counts something per second, over the last second or so.
#[derive(Clone, Debug, Default)]
pub struct RateMeter {
    /// Time in seconds and count up to then.
    samples: VecDeque<(f64, f64)>,
}

impl RateMeter {
    /// Seconds over which the mean is taken.
    const WINDOW: f64 = 1.0;

    /// Tells how much there has been up to a time (seconds, ascending), and returns how much it is per second.
    pub fn update(&mut self, seconds: f64, total: f64) -> f64 {
        if self.samples.back().is_some_and(|&(_, before)| total < before) {
            // Counting has begun anew.
            self.samples.clear();
        }
        self.samples.push_back((seconds, total));
        while self.samples.len() > 2 && self.samples[1].0 <= seconds - Self::WINDOW {
            self.samples.pop_front();
        }
        let (first_seconds, first_total) = self.samples[0];
        let span = seconds - first_seconds;
        if span > 0.0 { (total - first_total) / span } else { 0.0 }
    }
}
