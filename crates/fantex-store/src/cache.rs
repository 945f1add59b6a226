//! A cache of decoded pages within a memory budget.
//!
//! Who owns what:
//! - A [`PageCache`] is a handle; its clones share one [`Shared`], which owns the asset and two [caches](Cache): unpacked
//!   clusters (a quarter of the budget; neighbouring tiles come from the same cluster) and decoded pages (the rest).
//! - Entries are reference-counted. The cache owns one reference until it evicts the entry; a [`Tile`] owns
//!   another one as long as it lives. So a page that is being sampled never vanishes, and memory beyond the budget is what
//!   tiles hold.
//! - On which thread: the thread that asks reads, unpacks and decodes. Others that want the same entry meanwhile wait for
//!   it; no lock is held during that. Look-ups in a tile of one page touch no lock at all.

use std::convert::Infallible;
use std::sync::{Arc, Mutex, PoisonError};

use fantex_base::srgb::{linear_from_srgb8_table, unit_from_u8_table};
use fantex_base::{Error, Result, input};
use fantex_texture::filter::TexelGrid;
use glam::Vec2;
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};

use crate::decode::{BC4_DENOMINATOR, StoredTexels, linear_from_stored};
use crate::layout::{ClusterPages, PAGE, PageSize};
use crate::{Asset, EditorSnapshot, PageId, TileId, TileSource, TileTexels};

/// Decoded pages of an asset, within a budget, shared by threads. Cloning shares the cache.
#[derive(Clone, Debug)]
pub struct PageCache {
    shared: Arc<Shared>,
}

/// Damaged pages that are kept by name.
const MAX_NAMED_DAMAGE: usize = 16;

/// Typical bytes of an entry, from which caches estimate how many there will be.
const CLUSTER_BYTES: usize = 256 << 10;
const PAGE_BYTES: usize = 16 << 10;

/// A part of a cache with a lock of its own is at least so large: a page of floats is 1 MiB, and what is larger than a part is not
/// kept.
const SHARD_BYTES: usize = 8 << 20;

type Loaded<T> = Result<Arc<T>>;

/// Bytes that entries take.
#[derive(Clone, Debug)]
struct MemoryBytes;

impl<T: MemorySize> Weighter<u64, Loaded<T>> for MemoryBytes {
    fn weight(&self, _: &u64, entry: &Loaded<T>) -> u64 {
        entry.as_ref().map_or(64, |entry| entry.memory_bytes() as u64)
    }
}

trait MemorySize {
    fn memory_bytes(&self) -> usize;
}

impl MemorySize for ClusterPages {
    fn memory_bytes(&self) -> usize {
        ClusterPages::memory_bytes(self)
    }
}

impl MemorySize for DecodedPage {
    fn memory_bytes(&self) -> usize {
        size_of::<Self>() + self.texels.memory_bytes()
    }
}

fn cache_of<T: MemorySize>(budget_bytes: usize, entry_bytes: usize) -> Cache<u64, Loaded<T>, MemoryBytes> {
    let options = OptionsBuilder::new()
        .estimated_items_capacity((budget_bytes / entry_bytes).max(64))
        .weight_capacity(budget_bytes as u64)
        .shards((budget_bytes / SHARD_BYTES).clamp(1, 16))
        .build();
    // What has no value is the capacity alone.
    let options = options.unwrap_or_else(|_| unreachable!("all capacities are set"));
    Cache::with_options(options, MemoryBytes, DefaultHashBuilder::default(), DefaultLifecycle::default())
}

/// An entry, loaded if it is not there. Others that want it meanwhile wait.
fn get_or_load<T: MemorySize>(
    cache: &Cache<u64, Loaded<T>, MemoryBytes>,
    key: u64,
    load: impl FnOnce() -> Loaded<T>,
) -> Loaded<T> {
    if let Some(known) = cache.get(&key) {
        return known;
    }
    cache.get_or_insert_with(&key, || Ok::<_, Infallible>(load())).unwrap_or_else(|never| match never {})
}

#[derive(Debug)]
struct Shared {
    asset: Arc<Asset>,
    /// Changes over the asset, where these are to be seen.
    snapshot: Option<EditorSnapshot>,
    clusters: Cache<u64, Loaded<ClusterPages>, MemoryBytes>,
    pages: Cache<u64, Loaded<DecodedPage>, MemoryBytes>,
    damage: Mutex<DamageLog>,
}

/// Pages that could not be read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// Number of distinct pages, counted per channel.
    pub pages: u64,
    /// The first few: channel, page, and what was wrong.
    pub first: Vec<(usize, PageId, String)>,
}

#[derive(Debug, Default)]
struct DamageLog {
    seen: std::collections::BTreeSet<(usize, PageId)>,
    first: Vec<(usize, PageId, String)>,
}

impl PageCache {
    /// A cache that keeps about `budget_bytes` of pages.
    pub fn new(asset: Arc<Asset>, budget_bytes: usize) -> Self {
        Self::over(asset, None, budget_bytes)
    }

    /// The same of an asset as an editor had it at a moment, as long as the snapshot can be read. (Means of groups whose pages
    /// are damaged are the committed ones.)
    pub fn of_snapshot(snapshot: EditorSnapshot, budget_bytes: usize) -> Self {
        Self::over(Arc::clone(snapshot.asset()), Some(snapshot), budget_bytes)
    }

    fn over(asset: Arc<Asset>, snapshot: Option<EditorSnapshot>, budget_bytes: usize) -> Self {
        let budget_bytes = input::share_of_cache(budget_bytes as u64) as usize;
        let clusters = cache_of(budget_bytes / 4, CLUSTER_BYTES);
        let pages = cache_of(budget_bytes - budget_bytes / 4, PAGE_BYTES);
        Self { shared: Arc::new(Shared { asset, snapshot, clusters, pages, damage: Mutex::default() }) }
    }

    /// The asset.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.shared.asset
    }

    /// What could not be read so far.
    pub fn damage(&self) -> Damage {
        let log = self.shared.damage.lock().unwrap_or_else(PoisonError::into_inner);
        Damage { pages: log.seen.len() as u64, first: log.first.clone() }
    }

    /// A decoded page, or none (and a record of it) where it is damaged. The page must exist.
    fn page(&self, channel: usize, id: PageId) -> Option<Arc<DecodedPage>> {
        let [column, row] = id.page;
        // 32 bits of group, ten each of row and column (at most 1024 of each), five of level, seven of channel.
        let key = (u64::from(id.group) << 32)
            | (u64::from(row) << 22)
            | (u64::from(column) << 12)
            | (u64::from(id.level) << 7)
            | channel as u64;
        match get_or_load(&self.shared.pages, key, || self.load_page(channel, id)) {
            Ok(page) => Some(page),
            Err(error) => {
                self.record(channel, id, &error);
                None
            }
        }
    }

    fn load_page(&self, channel: usize, id: PageId) -> Loaded<DecodedPage> {
        let asset = &self.shared.asset;
        let extent = asset.page_extent(channel, id)?;
        let texels = match &self.shared.snapshot {
            Some(snapshot) => {
                asset.decode_page(channel, id, extent, &snapshot.read_page_raw(channel, id)?)?
            }
            None => {
                let cluster = self.cluster(id)?;
                asset.decode_page(channel, id, extent, asset.page_in(&cluster, channel, id)?)?
            }
        };
        Ok(Arc::new(DecodedPage::new(extent, texels, asset.channels()[channel].srgb)))
    }

    /// Reads texels of a page, linear, by their numbers row by row; none (and a record of it) where it is damaged. The page must exist.
    pub(crate) fn read_linear<R>(
        &self,
        channel: usize,
        id: PageId,
        read: impl FnOnce(&dyn Fn(usize) -> [f32; 4]) -> R,
    ) -> Option<R> {
        let page = self.page(channel, id)?;
        Some(read(&|texel| page.at(texel)))
    }

    /// The bytes of a page in the channel's format.
    pub(crate) fn page_bytes(&self, channel: usize, id: PageId) -> Result<Vec<u8>> {
        let shared = &self.shared;
        match &shared.snapshot {
            Some(snapshot) => snapshot.read_page_raw(channel, id),
            None => {
                let cluster = self.cluster(id)?;
                shared.asset.page_in(&cluster, channel, id).map(<[u8]>::to_vec)
            }
        }
    }

    fn cluster(&self, id: PageId) -> Loaded<ClusterPages> {
        let shared = &self.shared;
        let cluster_id = shared.asset.cluster_of(id)?;
        let key = (u64::from(cluster_id.level) << 32) | u64::from(cluster_id.index);
        get_or_load(&shared.clusters, key, || shared.asset.read_cluster(cluster_id).map(Arc::new))
    }

    fn record(&self, channel: usize, id: PageId, error: &Error) {
        let mut log = self.shared.damage.lock().unwrap_or_else(PoisonError::into_inner);
        if log.seen.insert((channel, id)) && log.first.len() < MAX_NAMED_DAMAGE {
            log.first.push((channel, id, error.to_string()));
        }
    }
}

impl TileSource for PageCache {
    type Tile = Tile;

    /// `id.level` beyond the tile's last is clamped to it. Where the stored tile is damaged, the next coarser level that is not (in
    /// the end the group's mean) takes its place and the damage is recorded. Panics where `channel` or `id.group` is out of range.
    fn tile(&self, channel: usize, id: TileId) -> Tile {
        let asset = &self.shared.asset;
        let TileId { group, level } = id;
        let tile_extent = asset.cover().groups[group as usize].extent;
        let last = fantex_cover::level_count(tile_extent) - 1;
        for level in level.min(last)..=last {
            let (id, size) = (TileId { group, level }, PageSize::new(tile_extent, level));
            let extent = size.extent();
            if size.page_count() > 1 {
                return Tile { channel, id, extent, source: Source::Paged(self.clone(), Recent::default()) };
            }
            if let Some(page) = self.page(channel, PageId { group, level, page: [0, 0] }) {
                return Tile { channel, id, extent, source: Source::Page(page) };
            }
        }
        let source = Source::Mean(asset.mean(channel, group));
        Tile { channel, id: TileId { group, level: last }, extent: [1, 1], source }
    }

    fn tile_at_page(&self, channel: usize, id: TileId, page: [u32; 2]) -> Tile {
        let TileId { group, level } = id;
        let size = PageSize::new(self.shared.asset.cover().groups[group as usize].extent, level);
        if size.page_count() <= 1 {
            return self.tile(channel, id);
        }
        match self.page(channel, PageId { group, level, page }) {
            Some(texels) => {
                let source = Source::Part(texels, page.map(|n| n * PAGE));
                Tile { channel, id, extent: size.extent(), source }
            }
            None => self.tile(channel, id),
        }
    }

    /// Most look-ups touch one page only, which is asked for without a handle to the tile.
    #[inline]
    fn bilinear(&self, channel: usize, id: TileId, uv: Vec2) -> [f32; 4] {
        let TileId { group, level } = id;
        let size = PageSize::new(self.shared.asset.cover().groups[group as usize].extent, level);
        if size.extent()[0] > 0
            && let (Some(page), quad) = TexelQuad::new(uv, size.extent()).in_one_page()
            && let Some(page) = self.page(channel, PageId { group, level, page })
        {
            return page_bilinear(&page, &quad);
        }
        self.tile(channel, id).bilinear(uv)
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.shared.asset.mean(channel, group)
    }
}

/// A page, decoded, in the smallest form that keeps its values.
#[derive(Debug)]
struct DecodedPage {
    extent: [u32; 2],
    texels: StoredTexels,
    srgb: bool,
    /// Meaning of red, green and blue of 8-bit RGBA.
    linear_from_u8: &'static [f32; 256],
}

impl DecodedPage {
    fn new(extent: [u32; 2], mut texels: StoredTexels, srgb: bool) -> Self {
        if let (StoredTexels::Rgba32F(texels), true) = (&mut texels, srgb) {
            // Once here rather than at every look-up.
            for [r, g, b, _] in texels {
                (*r, *g, *b) = (linear_from_stored(*r), linear_from_stored(*g), linear_from_stored(*b));
            }
        }
        let linear_from_u8 = if srgb { linear_from_srgb8_table() } else { unit_from_u8_table() };
        Self { extent, texels, srgb, linear_from_u8 }
    }

    fn linear(&self, x: u32, y: u32) -> [f32; 4] {
        self.at((y * self.extent[0] + x) as usize)
    }

    #[inline]
    fn at(&self, index: usize) -> [f32; 4] {
        match &self.texels {
            StoredTexels::Rgba8(texels) => self.color(texels[index]),
            texels => texels.stored(index),
        }
    }

    #[inline]
    fn color(&self, [r, g, b, a]: [u8; 4]) -> [f32; 4] {
        let table = self.linear_from_u8;
        [
            table[usize::from(r)],
            table[usize::from(g)],
            table[usize::from(b)],
            unit_from_u8_table()[usize::from(a)],
        ]
    }
}

/// A tile's level, ready for look-ups from any thread. Holds its page alive (whatever the cache's budget); a tile of one
/// page is sampled without a lock.
#[derive(Clone, Debug)]
pub struct Tile {
    channel: usize,
    id: TileId,
    /// Columns and rows of the whole level.
    extent: [u32; 2],
    source: Source,
}

#[derive(Clone, Debug)]
enum Source {
    /// The level is one page.
    Page(Arc<DecodedPage>),
    /// One of its pages, which alone is looked at, and its upper left texel in the tile.
    Part(Arc<DecodedPage>, [u32; 2]),
    /// The level is cut into pages, fetched through the cache.
    Paged(PageCache, Recent),
    /// Nothing of the tile could be read.
    Mean([f32; 4]),
}

/// The page used last for each parity of column and row: the up to four pages of one look-up never displace each other. A copy of
/// a tile begins without.
#[derive(Debug, Default)]
struct Recent([Mutex<Option<RecentPage>>; 4]);

type RecentPage = ([u32; 2], Arc<DecodedPage>);

impl Clone for Recent {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// The four texels around a point, and how far it lies between them.
pub(crate) struct TexelQuad {
    columns: [u32; 2],
    rows: [u32; 2],
    fraction: Vec2,
}

impl TexelQuad {
    /// Texel centres lie at `(i + 0.5) / n`; the point is clamped to the rectangle that they span. NaN reads as 0.
    #[inline]
    pub(crate) fn new(uv: Vec2, extent: [u32; 2]) -> Self {
        let axis = |u: f32, n: u32| {
            let last = n - 1;
            let x = (u * n as f32 - 0.5).max(0.0).min(last as f32);
            let i = x as u32;
            ([i, (i + 1).min(last)], x - i as f32)
        };
        let (columns, fx) = axis(uv.x, extent[0]);
        let (rows, fy) = axis(uv.y, extent[1]);
        Self { columns, rows, fraction: Vec2::new(fx, fy) }
    }

    /// The page that all four lie in, and the same relative to it; none, and the same, across borders of pages.
    #[inline]
    pub(crate) fn in_one_page(self) -> (Option<[u32; 2]>, Self) {
        let [[x0, x1], [y0, y1]] = [self.columns, self.rows];
        if x0 / PAGE != x1 / PAGE || y0 / PAGE != y1 / PAGE {
            return (None, self);
        }
        let (columns, rows) = ([x0 % PAGE, x1 % PAGE], [y0 % PAGE, y1 % PAGE]);
        (Some([x0 / PAGE, y0 / PAGE]), Self { columns, rows, ..self })
    }

    /// The same relative to a page's upper left texel.
    fn in_page(self, corner: [u32; 2], extent: [u32; 2]) -> Self {
        let [[left, top], [right, bottom]] =
            [0, 1].map(|k| within([self.columns[k], self.rows[k]], corner, extent));
        Self { columns: [left, right], rows: [top, bottom], ..self }
    }

    fn blend(&self, texel: impl Fn(u32, u32) -> [f32; 4]) -> [f32; 4] {
        let [x0, x1] = self.columns;
        let [y0, y1] = self.rows;
        let (a, b, c, d) = (texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1));
        let Vec2 { x, y } = self.fraction;
        std::array::from_fn(|k| {
            let top = a[k] + x * (b[k] - a[k]);
            let bottom = c[k] + x * (d[k] - c[k]);
            top + y * (bottom - top)
        })
    }
}

/// A texel of a tile relative to a page's upper left one, held within the page.
fn within(texel: [u32; 2], corner: [u32; 2], extent: [u32; 2]) -> [u32; 2] {
    [0, 1].map(|k| texel[k].saturating_sub(corner[k]).min(extent[k] - 1))
}

impl TileTexels for Tile {
    /// `[1, 1]` for the mean of a tile that cannot be read at all.
    fn extent(&self) -> [u32; 2] {
        self.extent
    }

    #[inline]
    fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        match &self.source {
            Source::Page(page) => page_bilinear(page, &TexelQuad::new(uv, self.extent)),
            Source::Part(page, corner) => {
                page_bilinear(page, &TexelQuad::new(uv, self.extent).in_page(*corner, page.extent))
            }
            Source::Paged(cache, recent) => self.paged_bilinear(cache, recent, uv),
            Source::Mean(mean) => *mean,
        }
    }

    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        let (x, y) = (x.min(self.extent[0] - 1), y.min(self.extent[1] - 1));
        match &self.source {
            Source::Page(page) => page.linear(x, y),
            Source::Part(page, corner) => {
                let [x, y] = within([x, y], *corner, page.extent);
                page.linear(x, y)
            }
            Source::Paged(cache, recent) => self.paged_texel(cache, recent, x, y).unwrap_or_else(|| {
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let uv = centre / Vec2::new(self.extent[0] as f32, self.extent[1] as f32);
                self.coarser(cache).bilinear(uv)
            }),
            Source::Mean(mean) => *mean,
        }
    }

    fn grid(&self) -> Option<TexelGrid<'_>> {
        let (Source::Page(page) | Source::Part(page, _)) = &self.source else { return None };
        match &page.texels {
            StoredTexels::Rgba8(texels) => Some(TexelGrid::Rgba8 { texels, is_srgb: page.srgb }),
            StoredTexels::RgRatio(texels) => Some(TexelGrid::Rg16 { texels, one: BC4_DENOMINATOR as u16 }),
            _ => None,
        }
    }
}

impl Tile {
    /// The level it really is (coarser than asked for where that is damaged).
    pub fn level(&self) -> u32 {
        self.id.level
    }

    /// Across page borders. A look-up that touches a damaged page is made in the coarser level as a whole.
    fn paged_bilinear(&self, cache: &PageCache, recent: &Recent, uv: Vec2) -> [f32; 4] {
        let (page, quad) = TexelQuad::new(uv, self.extent).in_one_page();
        let [[x0, x1], [y0, y1]] = [quad.columns, quad.rows];
        if let Some(page) = page {
            if let Some(page) = self.recent_page(cache, recent, page) {
                return page_bilinear(&page, &quad);
            }
        } else if let (Some(a), Some(b), Some(c), Some(d)) = (
            self.paged_texel(cache, recent, x0, y0),
            self.paged_texel(cache, recent, x1, y0),
            self.paged_texel(cache, recent, x0, y1),
            self.paged_texel(cache, recent, x1, y1),
        ) {
            return quad.blend(|x, y| match (x == x0, y == y0) {
                (true, true) => a,
                (false, true) => b,
                (true, false) => c,
                (false, false) => d,
            });
        }
        self.coarser(cache).bilinear(uv)
    }

    fn paged_texel(&self, cache: &PageCache, recent: &Recent, x: u32, y: u32) -> Option<[f32; 4]> {
        let page = self.recent_page(cache, recent, [x / PAGE, y / PAGE])?;
        Some(page.linear(x % PAGE, y % PAGE))
    }

    /// A page by column and row; none where it is damaged.
    fn recent_page(&self, cache: &PageCache, recent: &Recent, place: [u32; 2]) -> Option<Arc<DecodedPage>> {
        let slot = &recent.0[(place[0] % 2 + 2 * (place[1] % 2)) as usize];
        if let Some((held, page)) = &*slot.lock().unwrap_or_else(PoisonError::into_inner)
            && *held == place
        {
            return Some(Arc::clone(page));
        }
        let TileId { group, level } = self.id;
        let page = cache.page(self.channel, PageId { group, level, page: place })?;
        *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some((place, Arc::clone(&page)));
        Some(page)
    }

    /// The next level. (A paged level is never the last.)
    fn coarser(&self, cache: &PageCache) -> Tile {
        cache.tile(self.channel, TileId { level: self.id.level + 1, ..self.id })
    }
}

/// The common path: one page, its texels' form chosen once per look-up.
#[inline]
fn page_bilinear(page: &DecodedPage, quad: &TexelQuad) -> [f32; 4] {
    let width = page.extent[0];
    let index = |x: u32, y: u32| (y * width + x) as usize;
    match &page.texels {
        StoredTexels::Rgba8(texels) => quad.blend(|x, y| page.color(texels[index(x, y)])),
        StoredTexels::Rgba32F(texels) => quad.blend(|x, y| texels[index(x, y)]),
        _ => quad.blend(|x, y| page.at(index(x, y))),
    }
}
