//! Many points at once.
//!
//! ```text
//!  points --> entries: a tile's share in a point's values
//!               --> blocks of them: levels, then probe after probe of all, the bilinear look-ups in levels that they consist of
//!                     --> pages, each fetched once --> texels --> sums of entries, channel after channel
//!                           --> values of points
//! ```
//!
//! Points beside each other look into the same few tiles: fetching a tile (a hash table behind a lock) is shared by them.

use std::cell::Cell;

use fantex_base::bits;
use fantex_mesh::{SurfacePoint, interpolate};
use fantex_texture::filter::{ColorSums, GridLookUps, GridPlaces};
use glam::{Vec2, Vec4};

use super::levels::{Depth, LevelBlock};
use super::lookup::TileLookup;
use super::pages::Pages;
use super::{Footprint, SamplePoint, Sampler, SurfaceValues, TileSource, VALUE_KINDS, value_of_sum};

/// Fewer points than this are sampled one by one.
const MIN_BATCH: usize = 4;

/// A tile's share in a point's values.
struct Entry {
    point: u32,
    group: u32,
    weight: f32,
}

/// What many points read, and what that is made with; kept for the next points.
#[derive(Default)]
struct Batch {
    entries: Vec<Entry>,
    /// Of every entry what is stored in each of the channels.
    stored: Vec<Vec4>,
    levels: LevelBlock,
    places: GridPlaces,
    look_ups: GridLookUps,
    sums: Vec<ColorSums>,
}

thread_local! {
    static BATCH: Cell<Option<Box<Batch>>> = const { Cell::new(None) };
}

impl<S: TileSource> Sampler<S> {
    /// As [`values`](Self::values) at many points.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn values_many(&self, points: &[SamplePoint]) -> Vec<SurfaceValues> {
        let mut values =
            self.read_values(points.len(), |index| (points[index].point, points[index].footprint));
        points.iter().map(|at| values.next(at)).collect()
    }

    /// Reads what is stored for so many points, given by their numbers; their values are made of it one after the other.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn read_values(
        &self,
        count: usize,
        point: impl Fn(usize) -> (SurfacePoint, Footprint),
    ) -> ManyValues<'_, S> {
        let mut values = ManyValues {
            sampler: self,
            channels: [(0, 0); VALUE_KINDS.len()],
            count: 0,
            batch: None,
            entry: 0,
            point: 0,
        };
        for (place, channel) in self.value_channels.iter().enumerate() {
            if let Some(channel) = *channel {
                values.channels[values.count] = (place, channel);
                values.count += 1;
            }
        }
        if self.reads_many(count) {
            let channels = values.channels.map(|(_, channel)| channel);
            values.batch = Some(self.read(&channels[..values.count], count, point));
        }
        values
    }

    /// As [`sample_many`](Self::sample_many), of a channel given by its index.
    ///
    /// # Panics
    /// If there is no such channel or triangle.
    pub fn sample_channel_many(&self, channel: usize, points: &[(SurfacePoint, Footprint)]) -> Vec<Vec4> {
        if !self.reads_many(points.len()) {
            let sample = |&(point, footprint): &_| self.sample_channel(channel, point, footprint);
            return points.iter().map(sample).collect();
        }
        let kind = self.channels[channel].kind;
        let batch = self.read(&[channel], points.len(), |index| points[index]);
        let normals: Vec<_> = points.iter().map(|&(point, _)| self.vertex_normal_for(kind, point)).collect();
        let mut sums = vec![Vec4::ZERO; points.len()];
        for (&Entry { point, group, weight }, &stored) in batch.entries.iter().zip(&batch.stored) {
            let point = point as usize;
            sums[point] += self.in_mesh_space(kind, stored, group, normals[point]) * weight;
        }
        batch.keep();
        let values = sums.into_iter().zip(normals);
        values.map(|(sum, vertex_normal)| value_of_sum(kind, sum, vertex_normal)).collect()
    }

    /// Whether so many points are read at once.
    fn reads_many(&self, count: usize) -> bool {
        count >= MIN_BATCH && TileLookup::has_probes(self.filter.filter)
    }

    /// What points read in some channels.
    fn read(
        &self,
        channels: &[usize],
        count: usize,
        point: impl Fn(usize) -> (SurfacePoint, Footprint),
    ) -> Box<Batch> {
        let mut batch = BATCH.take().unwrap_or_default();
        batch.entries.clear();
        batch.stored.clear();
        batch.sums.resize(channels.len(), ColorSums::ZERO);
        let mut pages = Pages::new(&self.tiles, channels);
        // Points that follow each other often lie in one triangle.
        let mut known = KnownTriangle { index: u32::MAX, corners: [None; 3] };
        for index in 0..count {
            let (at, footprint) = point(index);
            if at.triangle != known.index {
                known = KnownTriangle { index: at.triangle, corners: [None; 3] };
            }
            let triangle = at.index();
            for (slot, weight) in self.cover.weights(triangle, at.lambda).iter() {
                let corners = || self.cover.tile_corners(&self.mesh, triangle, slot);
                let corners = *known.corners[slot].get_or_insert_with(corners);
                if batch.levels.is_full() {
                    batch.read_block(self, &mut pages);
                }
                let group = self.cover.corner_groups[triangle][slot];
                let [dx, dy] = footprint.lambda_steps;
                let steps = [interpolate(corners, dx), interpolate(corners, dy)];
                let uv = interpolate(corners, at.lambda);
                batch.levels.push(group, &self.cover.groups[group as usize], uv, steps);
                batch.entries.push(Entry { point: index as u32, group, weight });
            }
        }
        batch.read_block(self, &mut pages);
        batch
    }
}

/// Tile coordinates of a triangle's corners, by the corner whose group's tile it is.
struct KnownTriangle {
    index: u32,
    corners: [Option<[Vec2; 3]>; 3],
}

impl Batch {
    /// Reads the look-ups of the block, those of the last entries.
    fn read_block<S: TileSource>(&mut self, sampler: &Sampler<S>, pages: &mut Pages<'_, S>) {
        let Self { levels, places, look_ups, sums, stored, .. } = self;
        levels.choose(&sampler.filter);
        sums.fill(ColorSums::ZERO);
        let probes = levels.max_probes();
        for depth in [Depth::Fine, Depth::Coarse] {
            for number in 0..probes {
                levels.place(depth, number, places);
                if !find_pages(levels, depth, places, pages) {
                    break;
                }
                look_ups.locate(places);
                for (channel, sums) in sums.iter_mut().enumerate() {
                    for index in bits(look_ups.add(places, |page| pages.grid(page, channel), sums)) {
                        let color = pages.bilinear(places.grid[index], channel, levels.probe_uv(index));
                        sums.add(index, color.map(|number| number * places.share[index]));
                    }
                }
            }
        }
        for index in 0..levels.len() {
            let mean_share = levels.mean_share(index);
            for (channel, sums) in sums.iter().enumerate() {
                let mut value = Vec4::from_array(sums.at(index));
                if mean_share != 0.0 {
                    value += pages.mean(channel, levels.group(index)) * mean_share;
                }
                stored.push(value);
            }
        }
        levels.clear();
    }

    /// Keeps the memory for the next points.
    fn keep(self: Box<Self>) {
        BATCH.set(Some(self));
    }
}

/// Finds the pages of the probes that were placed last. False where nothing is read.
fn find_pages<S: TileSource>(
    levels: &LevelBlock,
    depth: Depth,
    places: &mut GridPlaces,
    pages: &mut Pages<'_, S>,
) -> bool {
    // Probes beside each other mostly lie in one page.
    let mut known = None;
    for index in 0..levels.len() {
        if places.share[index] == 0.0 {
            continue;
        }
        let (tile, extent) = levels.tile(depth, index);
        let page = levels.page(index);
        let number = match known {
            Some((known, number)) if known == (tile, page) => number,
            _ => pages.number(tile, extent, page),
        };
        known = Some(((tile, page), number));
        places.grid[index] = number;
    }
    known.is_some()
}

/// The values of many points, one after the other: see [`Sampler::read_values`].
pub struct ManyValues<'s, S: TileSource> {
    sampler: &'s Sampler<S>,
    /// Of the sampler's value channels those that are there, and how many.
    channels: [(usize, usize); VALUE_KINDS.len()],
    count: usize,
    /// None where points are sampled one by one.
    batch: Option<Box<Batch>>,
    /// The next entry, and the next point.
    entry: usize,
    point: u32,
}

impl<S: TileSource> std::fmt::Debug for ManyValues<'_, S> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ManyValues").field("point", &self.point).finish_non_exhaustive()
    }
}

impl<S: TileSource> ManyValues<'_, S> {
    /// The values of the next point, which is given once more; its vertex normal counts.
    #[inline]
    pub fn next(&mut self, at: &SamplePoint) -> SurfaceValues {
        let Some(batch) = &self.batch else { return self.sampler.values(at) };
        let (mut sums, mut lookups) = ([Vec4::ZERO; VALUE_KINDS.len()], 0);
        while let Some(&Entry { point, group, weight }) = batch.entries.get(self.entry)
            && point == self.point
        {
            let stored = &batch.stored[self.entry * self.count..][..self.count];
            for (&(place, _), &stored) in self.channels[..self.count].iter().zip(stored) {
                let value = self.sampler.in_mesh_space(VALUE_KINDS[place], stored, group, at.vertex_normal);
                sums[place] += value * weight;
            }
            lookups += self.count as u32;
            self.entry += 1;
        }
        self.point += 1;
        self.sampler.values_of_sums(&sums, at.vertex_normal, lookups)
    }
}

impl<S: TileSource> Drop for ManyValues<'_, S> {
    fn drop(&mut self) {
        if let Some(batch) = self.batch.take() {
            batch.keep();
        }
    }
}
