//! The bias: how much coarser everything is wanted so that it fits.
//!
//! For every bias the texels that would be needed are known exactly from one walk over all groups ([`Histogram`]). The bias
//! rises at once to where the demand fits, and sinks only when a whole walk, spread over many frames, has shown that the
//! demand of the lower bias fits with room to spare. So a still camera comes to rest: what made the bias sink cannot make it
//! rise again.

use crate::demand::Demand;
use crate::shape::{Detail, TileShapes};

/// Share of the atlas that needed pages may take; the rest is lost between pages, or keeps what may be needed again.
const HIGH: f64 = 0.92;
/// Share of that up to which the bias sinks.
const LOW: f64 = 0.88;
/// Share of that to which a rising bias brings the demand.
const AIM: f64 = 0.95;
/// What a page that finds no room takes from the share.
const SQUEEZE: f64 = 0.97;
/// What a frame with a moving camera gives back.
const RELAX: f64 = 0.0005;
/// Groups looked at per frame while the bias waits to sink.
const WALK: usize = 1 << 15;

/// Texels by the bias from which on they are not needed.
#[derive(Clone, Debug)]
struct Histogram {
    texels: Vec<u64>,
}

impl Histogram {
    fn new() -> Self {
        Self { texels: vec![0; 256] }
    }

    fn add_group(&mut self, group: u32, demand: &Demand, shapes: &TileShapes) {
        let detail = demand.detail(group);
        if !detail.is_visible() {
            return;
        }
        let shape = shapes.of(group);
        let mut add = |detail: Detail, level: u32, texels: u64| {
            let until = shape.leaves(level).saturating_sub(detail.0);
            self.texels[usize::from(until)] += texels;
        };
        if shape.is_paged() {
            for page in demand.pages(group) {
                let id = shape.page(group, page.index);
                let [w, h] = shape.page_extent(id.level, id.page).map(u64::from);
                add(page.detail, id.level, w * h);
            }
        } else {
            for level in shape.wanted_level(detail)..shape.level_count() {
                add(detail, level, shape.texels(level));
            }
        }
    }

    /// The least bias with which at most `limit` texels are needed.
    fn bias_within(&self, limit: f64) -> u8 {
        // Texels in bin k are needed while the bias is below k.
        let mut needed = 0;
        for bias in (1..self.texels.len()).rev() {
            needed += self.texels[bias];
            if needed as f64 > limit {
                return bias as u8;
            }
        }
        0
    }
}

/// The bias and what it depends on.
#[derive(Clone, Debug)]
pub(crate) struct Pressure {
    bias: u8,
    /// Share of the atlas that turned out to be usable.
    usable: f64,
    walk: Histogram,
    /// The next group of the walk.
    next: usize,
}

impl Pressure {
    pub(crate) fn new() -> Self {
        Self { bias: 0, usable: 1.0, walk: Histogram::new(), next: 0 }
    }

    /// Steps of [`Detail`] by which everything is wanted coarser.
    pub(crate) fn bias(&self) -> u8 {
        self.bias
    }

    /// A needed page found no room: less must be needed.
    pub(crate) fn squeeze(&mut self) {
        self.usable = (self.usable * SQUEEZE).max(1e-3);
    }

    /// The camera moves, so what did not fit may fit now.
    pub(crate) fn relax(&mut self) {
        self.usable = (self.usable + RELAX).min(1.0);
    }

    fn limit(&self, atlas_texels: u64) -> f64 {
        atlas_texels as f64 * HIGH * self.usable
    }

    /// Adapts the bias; whether it is another one now, or everything should be wanted anew with the same.
    pub(crate) fn update(
        &mut self,
        needed_texels: u64,
        atlas_texels: u64,
        demand: &Demand,
        shapes: &TileShapes,
    ) -> bool {
        let limit = self.limit(atlas_texels);
        let count = shapes.group_count();
        if needed_texels as f64 > limit {
            let mut histogram = Histogram::new();
            (0..count as u32).for_each(|group| histogram.add_group(group, demand, shapes));
            self.bias = histogram.bias_within(AIM * limit).max(self.bias);
            self.begin_walk();
            return true;
        }
        if self.bias == 0 {
            return false;
        }
        let end = count.min(self.next + WALK);
        (self.next as u32..end as u32).for_each(|group| self.walk.add_group(group, demand, shapes));
        self.next = end;
        if end < count {
            return false;
        }
        let lower = self.walk.bias_within(LOW * limit);
        self.begin_walk();
        let sinks = lower < self.bias;
        self.bias = self.bias.min(lower);
        sinks
    }

    fn begin_walk(&mut self) {
        self.next = 0;
        self.walk.texels.fill(0);
    }
}
