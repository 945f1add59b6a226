//! What streaming and drawing tell about themselves, for panels and graphs.

use crate::history::{History, RateMeter};

/// Frames that graphs show.
const SHOWN_FRAMES: usize = 240;

/// Most damaged parts that are listed.
pub const LISTED_DAMAGE: usize = 100;

/// What is resident of one detail level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelFigures {
    /// Texels in the atlas.
    pub resident: u64,
    /// Texels of the level.
    pub texels: u64,
}

/// A page, or a level of a bundle of tiles, that could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedPart {
    /// Group, level and page, or tiles and level, in words.
    pub part: String,
    /// Why.
    pub reason: String,
}

/// Streaming at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamFigures {
    /// Per detail level, the finest first.
    pub levels: Vec<LevelFigures>,
    /// Bytes of the pool.
    pub pool_bytes: u64,
    /// Bytes of it that are in use.
    pub used_bytes: u64,
    /// Sides of the atlas' layers in texels, and their number.
    pub atlas: [u32; 3],
    /// Levels by which everything is coarser than wanted, so that it fits.
    pub bias: f32,
    /// Wanted parcels that are not resident.
    pub missing: u64,
    /// Wanted parcels.
    pub wanted: u64,
    /// Parcels that are being read.
    pub queue: u64,
    /// Bytes that went to the graphics memory since the start.
    pub uploaded_bytes: u64,
    /// Parcels that went to the graphics memory since the start.
    pub uploaded_parcels: u64,
    /// Parcels that left it since the start.
    pub evicted_parcels: u64,
    /// What could not be read: the first of it.
    pub damaged: Vec<DamagedPart>,
    /// How many could not be read.
    pub damaged_count: u64,
}

impl StreamFigures {
    /// Share of the wanted parcels that are resident, 0..1.
    pub fn hit_rate(&self) -> f32 {
        if self.wanted == 0 { 1.0 } else { 1.0 - self.missing as f32 / self.wanted as f32 }
    }

    /// Whether everything that is wanted is there.
    pub fn is_sharp(&self) -> bool {
        self.missing == 0
    }

    /// Share of the pool that is in use, 0..1.
    pub fn occupancy(&self) -> f32 {
        if self.pool_bytes == 0 { 0.0 } else { self.used_bytes as f32 / self.pool_bytes as f32 }
    }
}

/// Figures over time.
#[derive(Clone, Debug)]
pub struct Graphs {
    /// Milliseconds of drawing per picture.
    pub frame_ms: History,
    /// Share of the pool in use, 0..1.
    pub pool: History,
    /// Parcels that are being read.
    pub queue: History,
    /// Bytes per second to the graphics memory.
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
    /// A picture of the scene was drawn.
    pub fn picture(&mut self, seconds: f64) {
        self.frame_ms.push((seconds * 1e3) as f32);
    }

    /// Streaming went on to a time in seconds.
    pub fn stream(&mut self, seconds: f64, now: &StreamFigures) {
        self.pool.push(now.occupancy());
        self.queue.push(now.queue as f32);
        self.bandwidth.push(self.meter.update(seconds, now.uploaded_bytes as f64) as f32);
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_shares() {
        let mut figures = StreamFigures::default();
        assert_eq!((figures.hit_rate(), figures.occupancy()), (1.0, 0.0));
        assert!(figures.is_sharp());
        figures = StreamFigures { wanted: 4, missing: 1, pool_bytes: 100, used_bytes: 25, ..figures };
        assert_eq!((figures.hit_rate(), figures.occupancy()), (0.75, 0.25));
        assert!(!figures.is_sharp());
    }

    #[test]
    fn bandwidth_is_per_second() {
        let mut graphs = Graphs::default();
        for i in 0..20 {
            let now = StreamFigures { uploaded_bytes: i * 1000, ..StreamFigures::default() };
            graphs.stream(i as f64 * 0.1, &now);
        }
        assert!((graphs.bandwidth.last().unwrap() - 10_000.0).abs() < 1.0);
    }
}
