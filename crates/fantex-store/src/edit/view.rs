//! Reading through changes that are not committed.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::runs::LevelChanges;
use crate::layout::{ClusterPages, PageSize, TilePlace};
use crate::section::directory::{ClusterEntry, Directory};
use crate::{Asset, PageError, PageId, Texels};

/// Clusters that were unpacked last, by offset and checksum: neighbouring pages are mostly read together.
pub(super) type RecentClusters = VecDeque<([u64; 2], Arc<ClusterPages>)>;

/// Clusters that are kept unpacked, of 64 to 256 KiB mostly.
const RECENT_CLUSTERS: usize = 32;

/// An asset with changes.
pub(super) struct View<'a> {
    pub(super) asset: &'a Asset,
    pub(super) directory: &'a Directory,
    /// In memory, per level.
    pub(super) pages: &'a [LevelChanges],
    pub(super) recent: &'a Mutex<RecentClusters>,
}

impl View<'_> {
    pub(super) fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>, PageError> {
        self.asset.page_extent(channel, page)?;
        let place = place_of(self.asset, page)?;
        let change = self.pages[page.level as usize].get(&place);
        if let Some(bytes) = change.and_then(|change| change[channel].as_ref()) {
            return Ok(bytes.to_vec());
        }
        let level = &self.directory.levels[page.level as usize];
        let cluster = self.cluster(page.level, &level[cluster_of(level, place)])?;
        self.asset.page_in(&cluster, channel, page).map(<[u8]>::to_vec)
    }

    fn cluster(&self, level: u32, entry: &ClusterEntry) -> Result<Arc<ClusterPages>, PageError> {
        let key = [entry.offset, entry.checksum];
        let lock = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, cluster)) = lock().iter().find(|(known, _)| *known == key) {
            return Ok(Arc::clone(cluster));
        }
        let cluster = Arc::new(self.asset.read_entry(level, entry)?);
        let mut recent = lock();
        if recent.len() >= RECENT_CLUSTERS {
            recent.pop_front();
        }
        recent.push_back((key, Arc::clone(&cluster)));
        Ok(cluster)
    }
}

pub(super) fn place_of(asset: &Asset, page: PageId) -> Result<TilePlace, PageError> {
    let extent = asset.cover().groups.get(page.group as usize).map_or([0, 0], |g| g.extent);
    let number = PageSize::new(extent, page.level).number(page.page);
    let path = || asset.path().to_owned();
    let number = number.ok_or_else(|| PageError::NoSuchPage { path: path(), channel: 0, page })?;
    Ok(TilePlace { group: page.group, page: number })
}

/// Index of the cluster of a level that holds an existing page.
pub(super) fn cluster_of(level: &[ClusterEntry], place: TilePlace) -> usize {
    level.partition_point(|cluster| cluster.first <= place).saturating_sub(1)
}

/// All pages of an asset as an editor had them at a moment, for other threads. Later changes do not show in it. It can be read
/// until the editor next flushes or commits; after that, reading what was flushed before may fail.
#[derive(Debug)]
pub struct EditorSnapshot {
    pub(super) asset: Arc<Asset>,
    pub(super) directory: Arc<Directory>,
    pub(super) pages: Vec<LevelChanges>,
    pub(super) recent: Mutex<RecentClusters>,
}

impl EditorSnapshot {
    /// The committed state below the changes.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.asset
    }

    /// A page's bytes.
    ///
    /// # Errors
    ///
    /// There is no such page, or it cannot be read.
    pub fn read_page_raw(&self, channel: usize, page: PageId) -> Result<Vec<u8>, PageError> {
        let Self { asset, directory, pages, recent } = self;
        View { asset, directory, pages, recent }.read_page_raw(channel, page)
    }

    /// A page, decoded.
    ///
    /// # Errors
    ///
    /// As [`read_page_raw`](Self::read_page_raw).
    pub fn read_page(&self, channel: usize, page: PageId) -> Result<Texels, PageError> {
        let bytes = self.read_page_raw(channel, page)?;
        self.asset.decode_page_raw(channel, page, &bytes)
    }
}
