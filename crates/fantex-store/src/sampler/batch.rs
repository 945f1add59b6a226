//! Many points at once.
//!
//! ```text
//!  points --> entries: a tile's share in a point's values, with its look-up
//!               --> probes: the bilinear look-ups in levels of tiles that it consists of; pages, each fetched once
//!                     --> blocks of probes through the vectors of `fantex_texture`, channel after channel
//!                           --> sums of entries --> values of points
//! ```
//!
//! Points beside each other look into the same few tiles: fetching a tile (a hash table behind a lock) is shared by them.

use fantex_mesh::SurfacePoint;
use fantex_texture::filter::{GRID_LOOK_UPS, GridLookUps, TexelGrid};
use glam::{Vec3, Vec4};

use super::lookup::TileLookup;
use super::plan::{Entry, MeanShare, PageName, Plan};
use super::{
    Footprint, SamplePoint, Sampler, SurfaceValues, TileSource, TileTexels, VALUE_KINDS, value_of_sum,
};
use crate::ChannelKind;

/// Fewer points than this are sampled one by one.
const MIN_BATCH: usize = 4;

impl<S: TileSource> Sampler<S> {
    /// As [`values`](Self::values) at many points.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn values_many(&self, points: &[SamplePoint]) -> Vec<SurfaceValues> {
        if points.len() < MIN_BATCH || !TileLookup::has_probes(self.filter.filter) {
            return points.iter().map(|at| self.values(at)).collect();
        }
        let plan = Plan::new(self, points.len(), |index| (points[index].point, points[index].footprint));
        let read = self.read(&plan, self.value_channels);
        let channels = self.value_channels.iter().flatten().count() as u32;
        let mut sums = vec![[Vec4::ZERO; VALUE_KINDS.len()]; points.len()];
        let vertex_normal = |point: usize| points[point].vertex_normal;
        for (place, kind) in VALUE_KINDS.into_iter().enumerate() {
            self.add_up(&plan.entries, kind, (&read[place], place), vertex_normal, &mut sums);
        }
        let mut lookups = vec![0; points.len()];
        plan.entries.iter().for_each(|entry| lookups[entry.point as usize] += channels);
        let sums = points.iter().zip(&sums).zip(lookups);
        sums.map(|((at, sums), lookups)| self.values_of_sums(sums, at.vertex_normal, lookups)).collect()
    }

    /// As [`sample_many`](Self::sample_many), of a channel given by its index.
    ///
    /// # Panics
    /// If there is no such channel or triangle.
    pub fn sample_channel_many(&self, channel: usize, points: &[(SurfacePoint, Footprint)]) -> Vec<Vec4> {
        if points.len() < MIN_BATCH || !TileLookup::has_probes(self.filter.filter) {
            let sample = |&(point, footprint): &_| self.sample_channel(channel, point, footprint);
            return points.iter().map(sample).collect();
        }
        let kind = self.channels[channel].kind;
        let plan = Plan::new(self, points.len(), |index| points[index]);
        let [read] = self.read(&plan, [Some(channel)]);
        let normals: Vec<_> = points.iter().map(|&(point, _)| self.vertex_normal_for(kind, point)).collect();
        let mut sums = vec![[Vec4::ZERO]; points.len()];
        self.add_up(&plan.entries, kind, (&read, 0), |point| normals[point], &mut sums);
        let values = sums.into_iter().zip(normals);
        values.map(|([sum], vertex_normal)| value_of_sum(kind, sum, vertex_normal)).collect()
    }

    /// Adds what is stored for the entries in a channel, weighted, to the sums of their points at a place.
    fn add_up<const CHANNELS: usize>(
        &self,
        entries: &[Entry],
        kind: ChannelKind,
        (stored, place): (&[Vec4], usize),
        vertex_normal: impl Fn(usize) -> Vec3,
        sums: &mut [[Vec4; CHANNELS]],
    ) {
        for (&Entry { point, group, weight }, &stored) in entries.iter().zip(stored) {
            let point = point as usize;
            let value = self.in_mesh_space(kind, stored, group, vertex_normal(point));
            sums[point][place] += value * weight;
        }
    }

    /// For each channel the stored values of every entry; nothing where there is no channel.
    fn read<const CHANNELS: usize>(
        &self,
        plan: &Plan,
        channels: [Option<usize>; CHANNELS],
    ) -> [Vec<Vec4>; CHANNELS] {
        let mut sums = channels.map(|channel| match channel {
            Some(_) => vec![Vec4::ZERO; plan.entries.len()],
            None => Vec::new(),
        });
        let tiles_of = |channel: Option<usize>| -> Vec<S::Tile> {
            let Some(channel) = channel else { return Vec::new() };
            let tile = |name: &PageName| match name.page {
                Some(page) => self.tiles.tile_at_page(channel, name.tile, page),
                None => self.tiles.tile(channel, name.tile),
            };
            plan.pages.names.iter().map(tile).collect()
        };
        let tiles = channels.map(tiles_of);
        let grids: [_; CHANNELS] = std::array::from_fn(|place| grids(plan, &tiles[place]));
        let mut look_ups = GridLookUps::default();
        for probes in plan.probes.chunks(GRID_LOOK_UPS) {
            look_ups.place(probes.iter().map(|p| (p.place, plan.pages.names[p.page as usize].page_extent)));
            for place in 0..CHANNELS {
                if channels[place].is_none() {
                    continue;
                }
                let colors = look_ups.sample(
                    |index| grids[place][probes[index].page as usize],
                    |index| tiles[place][probes[index].page as usize].bilinear(probes[index].uv),
                );
                for (probe, color) in probes.iter().zip(colors) {
                    sums[place][probe.entry as usize] += Vec4::from_array(*color) * probe.share;
                }
            }
        }
        for &MeanShare { entry, share } in &plan.means {
            let group = plan.entries[entry as usize].group;
            for (sums, channel) in sums.iter_mut().zip(channels) {
                if let Some(channel) = channel {
                    sums[entry as usize] += Vec4::from_array(self.tiles.mean(channel, group)) * share;
                }
            }
        }
        sums
    }
}

/// What vectors can read of a channel's tiles. (A tile that stands in for a damaged one has another extent.)
fn grids<'t, T: TileTexels>(plan: &Plan, tiles: &'t [T]) -> Vec<Option<TexelGrid<'t>>> {
    let grid = |(tile, name): (&'t T, &PageName)| tile.grid().filter(|_| tile.extent() == name.extent);
    tiles.iter().zip(&plan.pages.names).map(grid).collect()
}
