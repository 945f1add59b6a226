//! A cache of decoded pages within a memory budget.
//!
//! Who owns what:
//! - A [`PageCache`] is a handle; its clones share one [`Shared`], which owns the asset and two [`BoundedMap`]s: unpacked
//!   clusters (a quarter of the budget; neighbouring tiles come from the same cluster) and decoded pages (the rest).
//! - Entries are reference-counted. The map owns one reference until the clock hand evicts the entry; a [`Tile`] owns
//!   another one as long as it lives. So a page that is being sampled never vanishes, and memory beyond the budget is what
//!   tiles hold.
//! - On which thread: the thread that asks reads, unpacks and decodes. Others that want the same entry meanwhile wait for
//!   it; no map lock is held during that. Look-ups in a tile of one page touch no lock at all.

mod bounded_map;
mod tile;

use std::sync::{Arc, Mutex, PoisonError};

use bounded_map::BoundedMap;
use glam::Vec2;
use tile::{DecodedPage, Source};
pub use tile::{PageTexels, RATIO_DENOMINATOR, Tile};

use crate::layout::{ClusterPages, PageSize};
use crate::{Asset, EditorSnapshot, PageError, PageId};

/// Decoded pages of an asset, within a budget, shared by threads. Cloning shares the cache.
#[derive(Clone, Debug)]
pub struct PageCache {
    shared: Arc<Shared>,
}

/// Damaged pages that are kept by name.
const NAMED_DAMAGE: usize = 16;

type Loaded<T> = Result<Arc<T>, PageError>;

#[derive(Debug)]
struct Shared {
    asset: Arc<Asset>,
    /// Changes over the asset, where these are to be seen.
    snapshot: Option<EditorSnapshot>,
    clusters: BoundedMap<Loaded<ClusterPages>>,
    pages: BoundedMap<Loaded<DecodedPage>>,
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
        let clusters = BoundedMap::new(budget_bytes / 4);
        let pages = BoundedMap::new(budget_bytes - budget_bytes / 4);
        Self { shared: Arc::new(Shared { asset, snapshot, clusters, pages, damage: Mutex::default() }) }
    }

    /// The asset.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.shared.asset
    }

    /// A tile's level for look-ups. `level` beyond the tile's last is clamped to it. Where the stored tile is damaged, the
    /// next coarser level that is not (in the end the group's mean) takes its place and the damage is recorded. Panics
    /// where `channel` or `group` is out of range.
    pub fn tile(&self, channel: usize, group: u32, level: u32) -> Tile {
        let asset = &self.shared.asset;
        let extent = asset.cover().groups[group as usize].extent;
        let last = crate::layout::level_count(extent) - 1;
        for level in level.min(last)..=last {
            let size = PageSize::new(extent, level);
            if size.page_count() > 1 {
                let source = Source::Paged(self.clone(), Arc::default());
                return Tile { channel, group, level, extent: size.extent(), source };
            }
            let id = PageId { group, level, page: [0, 0] };
            if let Some(page) = self.page(channel, id) {
                return Tile { channel, group, level, extent: size.extent(), source: Source::Page(page) };
            }
        }
        let mean = asset.mean(channel, group);
        Tile { channel, group, level: last, extent: [1, 1], source: Source::Mean(mean) }
    }

    /// One bilinear look-up: `self.tile(channel, group, level).bilinear(uv)`.
    pub fn bilinear(&self, channel: usize, group: u32, level: u32, uv: Vec2) -> [f32; 4] {
        self.tile(channel, group, level).bilinear(uv)
    }

    /// What could not be read so far.
    pub fn damage(&self) -> Damage {
        let log = self.shared.damage.lock().unwrap_or_else(PoisonError::into_inner);
        Damage { pages: log.seen.len() as u64, first: log.first.clone() }
    }

    /// A decoded page, or none (and a record of it) where it is damaged. The page must exist.
    fn page(&self, channel: usize, id: PageId) -> Option<Arc<DecodedPage>> {
        let shared = &self.shared;
        let extent = shared.asset.cover().groups[id.group as usize].extent;
        let number = PageSize::new(extent, id.level).number(id.page)?;
        // 32 bits of group, 16 of page (at most 2^16 per level), 8 of level, 8 of channel.
        let key = (u64::from(id.group) << 32)
            | (u64::from(number) << 16)
            | (u64::from(id.level) << 8)
            | channel as u64;
        let load = || {
            let page = self.load_page(channel, id);
            let bytes = page.as_ref().map_or(64, |page| page.memory_bytes());
            (page, bytes)
        };
        match shared.pages.get_or_load(key, load) {
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

    fn cluster(&self, id: PageId) -> Loaded<ClusterPages> {
        let shared = &self.shared;
        let cluster_id = shared.asset.cluster_of(id)?;
        let key = (u64::from(cluster_id.level) << 32) | u64::from(cluster_id.index);
        shared.clusters.get_or_load(key, || {
            let cluster = shared.asset.read_cluster(cluster_id).map(Arc::new);
            let bytes = cluster.as_ref().map_or(64, |cluster| cluster.memory_bytes());
            (cluster, bytes)
        })
    }

    fn record(&self, channel: usize, id: PageId, error: &PageError) {
        let mut log = self.shared.damage.lock().unwrap_or_else(PoisonError::into_inner);
        if log.seen.insert((channel, id)) && log.first.len() < NAMED_DAMAGE {
            log.first.push((channel, id, error.to_string()));
        }
    }
}
