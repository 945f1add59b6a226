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

use fantex_cover::{Cover, Tap, TriangleTiles};
use fantex_mesh::SurfacePoint;
use fantex_texture::filter::{GRID_LOOK_UPS, GridLookUps, TexelGrid};
use glam::{Vec2, Vec4};

use super::lookup::TileLookup;
use super::{
    Footprint, SamplePoint, Sampler, SurfaceValues, TileSource, TileTexels, VALUE_KINDS, value_of_sum,
};
use crate::cache::TexelQuad;
use crate::{PAGE, TileId, page_extent};

/// Fewer points than this are sampled one by one.
const MIN_BATCH: usize = 4;

struct Entry {
    point: u32,
    tap: Tap,
}

/// A bilinear look-up in a tile.
struct Probe {
    entry: u32,
    /// Which one of the batch's pages.
    page: u32,
    /// Tile coordinates, and texels from the page's corner.
    uv: Vec2,
    place: Vec2,
    share: f32,
}

/// What an entry takes from the mean of its group.
struct MeanShare {
    entry: u32,
    share: f32,
}

/// What a tile's look-ups are read from.
struct PageName {
    tile: TileId,
    /// Columns and rows of the whole level.
    extent: [u32; 2],
    /// None for look-ups across the border of pages.
    page: Option<[u32; 2]>,
}

/// Pages of a batch, found again by their names. A name that displaces another in the table is only fetched twice.
struct PageNames {
    names: Vec<PageName>,
    /// One more than the index of the last page with this remainder; 0 without.
    table: [u32; 256],
}

impl PageName {
    fn page_extent(&self) -> [u32; 2] {
        self.page.map_or(self.extent, |page| page_extent(self.extent, page))
    }
}

impl PageNames {
    /// The page that a look-up is read from, and the place in it.
    fn find(&mut self, cover: &Cover, tile: TileId, uv: Vec2) -> (u32, Vec2) {
        let extent = cover.groups[tile.group as usize].level_extent(tile.level);
        let place = uv * Vec2::from(extent.map(|n| n as f32));
        let (page, corner) = if extent[0].max(extent[1]) <= PAGE {
            (Some([0; 2]), Vec2::ZERO)
        } else {
            let (page, _) = TexelQuad::new(uv, extent).in_one_page();
            (page, page.map_or(Vec2::ZERO, |page| Vec2::from(page.map(|n| (n * PAGE) as f32))))
        };
        (self.index(PageName { tile, extent, page }), place - corner)
    }

    fn index(&mut self, name: PageName) -> u32 {
        // Odd, so that the levels of neighbouring groups spread.
        let [column, row] = name.page.unwrap_or([PAGE; 2]);
        let place = name.tile.level + 11 * column + 101 * row;
        let number = name.tile.group.wrapping_mul(37).wrapping_add(place);
        let slot = (number % 256) as usize;
        if let Some(known) = self.table[slot].checked_sub(1)
            && let PageName { tile, page, .. } = self.names[known as usize]
            && (tile, page) == (name.tile, name.page)
        {
            return known;
        }
        self.names.push(name);
        self.table[slot] = self.names.len() as u32;
        self.names.len() as u32 - 1
    }
}

struct Plan {
    entries: Vec<Entry>,
    probes: Vec<Probe>,
    means: Vec<MeanShare>,
    pages: PageNames,
}

impl Plan {
    fn new<S: TileSource>(
        sampler: &Sampler<S>,
        count: usize,
        point: impl Fn(usize) -> (SurfacePoint, Footprint),
    ) -> Self {
        let mut plan = Self {
            entries: Vec::with_capacity(count + count / 4),
            probes: Vec::with_capacity(2 * count),
            means: Vec::new(),
            pages: PageNames { names: Vec::with_capacity(64), table: [0; 256] },
        };
        // Where the triangle of several points in a row lies in its tiles.
        let mut of_triangle: Option<(u32, TriangleTiles)> = None;
        for index in 0..count {
            let (at, footprint) = point(index);
            let mut add = |tap| plan.add(sampler.cover(), index, tap, &sampler.lookup(&tap, footprint));
            let is_same = |other: u32| other == at.triangle;
            if !of_triangle.as_ref().is_some_and(|(known, _)| is_same(*known)) {
                let goes_on = index + 1 < count && is_same(point(index + 1).0.triangle);
                let tiles = || (at.triangle, sampler.cover().triangle_tiles(sampler.mesh(), at.triangle));
                of_triangle = goes_on.then(tiles);
            }
            match &of_triangle {
                Some((_, tiles)) => tiles.taps(at.lambda).for_each(&mut add),
                None => sampler.taps(at).for_each(&mut add),
            }
        }
        plan
    }

    fn add(&mut self, cover: &Cover, point: usize, tap: Tap, lookup: &TileLookup) {
        let entry = self.entries.len() as u32;
        self.entries.push(Entry { point: point as u32, tap });
        lookup.for_each_probe(|tile, uv, share| match tile {
            Some(id) => {
                let (page, place) = self.pages.find(cover, id, uv);
                self.probes.push(Probe { entry, page, uv, place, share });
            }
            None => self.means.push(MeanShare { entry, share }),
        });
    }
}

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
        let mut sums = vec![([Vec4::ZERO; VALUE_KINDS.len()], 0); points.len()];
        for (Entry { point, tap }, stored) in plan.entries.iter().zip(read) {
            let (sums, lookups) = &mut sums[*point as usize];
            let vertex_normal = points[*point as usize].vertex_normal;
            *lookups += channels;
            for (place, channel) in self.value_channels.iter().enumerate() {
                if channel.is_some() {
                    let value = self.in_mesh_space(VALUE_KINDS[place], stored[place], tap, vertex_normal);
                    sums[place] += value * tap.weight;
                }
            }
        }
        let values = sums.iter().zip(points);
        values.map(|((sums, lookups), at)| self.values_of_sums(sums, at.vertex_normal, *lookups)).collect()
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
        let mut values: Vec<_> =
            points.iter().map(|&(point, _)| (Vec4::ZERO, self.vertex_normal_for(kind, point))).collect();
        for (Entry { point, tap }, [stored]) in plan.entries.iter().zip(self.read(&plan, [Some(channel)])) {
            let (sum, vertex_normal) = &mut values[*point as usize];
            *sum += self.in_mesh_space(kind, stored, tap, *vertex_normal) * tap.weight;
        }
        values.into_iter().map(|(sum, vertex_normal)| value_of_sum(kind, sum, vertex_normal)).collect()
    }

    /// The stored values of every entry, zero where there is no channel.
    fn read<const CHANNELS: usize>(
        &self,
        plan: &Plan,
        channels: [Option<usize>; CHANNELS],
    ) -> Vec<[Vec4; CHANNELS]> {
        let mut sums = vec![[Vec4::ZERO; CHANNELS]; plan.entries.len()];
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
            look_ups.place(probes.iter().map(|p| (p.place, plan.pages.names[p.page as usize].page_extent())));
            for place in 0..CHANNELS {
                if channels[place].is_none() {
                    continue;
                }
                let colors = look_ups.sample(
                    |index| grids[place][probes[index].page as usize],
                    |index| tiles[place][probes[index].page as usize].bilinear(probes[index].uv),
                );
                for (probe, color) in probes.iter().zip(colors) {
                    sums[probe.entry as usize][place] += Vec4::from_array(*color) * probe.share;
                }
            }
        }
        for &MeanShare { entry, share } in &plan.means {
            let group = plan.entries[entry as usize].tap.group;
            for (sum, channel) in sums[entry as usize].iter_mut().zip(channels) {
                if let Some(channel) = channel {
                    *sum += Vec4::from_array(self.tiles.mean(channel, group)) * share;
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
