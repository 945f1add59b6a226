//! A cache of decoded pages within a memory budget.

use std::sync::Arc;

use glam::Vec2;

use crate::{Asset, PageId};

/// Decoded pages of an asset, within a budget, shared by threads. Cloning shares the cache.
#[derive(Clone, Debug)]
pub struct PageCache {
    asset: Arc<Asset>,
}

impl PageCache {
    /// A cache that keeps at most about `budget_bytes` of pages.
    pub fn new(asset: Arc<Asset>, budget_bytes: usize) -> Self {
        let _ = budget_bytes;
        Self { asset }
    }

    /// The asset.
    pub fn asset(&self) -> &Arc<Asset> {
        &self.asset
    }

    /// A tile's level for look-ups. `level` beyond the tile's last is clamped to it. Where the stored tile is damaged, the
    /// next coarser level that is not (in the end the group's mean) takes its place and the damage is recorded. Panics
    /// where `channel` or `group` is out of range.
    pub fn tile(&self, channel: usize, group: u32, level: u32) -> Tile {
        let _ = (channel, group, level);
        todo!()
    }

    /// One bilinear look-up: `self.tile(channel, group, level).bilinear(uv)`.
    pub fn bilinear(&self, channel: usize, group: u32, level: u32, uv: Vec2) -> [f32; 4] {
        self.tile(channel, group, level).bilinear(uv)
    }

    /// What could not be read so far.
    pub fn damage(&self) -> Damage {
        todo!()
    }
}

/// Pages that could not be read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// Number of distinct pages (of any channel).
    pub pages: u64,
    /// The first few: channel, page, and what was wrong.
    pub first: Vec<(usize, PageId, String)>,
}

/// A tile's level, ready for look-ups from any thread. Holds its page alive (whatever the cache's budget); a tile of one
/// page is sampled without a lock.
#[derive(Clone, Debug)]
pub struct Tile {}

impl Tile {
    /// Columns and rows in texels.
    pub fn extent(&self) -> [u32; 2] {
        todo!()
    }

    /// The level it really is (coarser than asked for where that is damaged).
    pub fn level(&self) -> u32 {
        todo!()
    }

    /// Bilinear look-up at tile coordinates, clamped half a texel inside the tile; **linear** RGBA.
    pub fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        let _ = uv;
        todo!()
    }

    /// Texel at column x, row y (clamped to the tile); **linear** RGBA.
    pub fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        let _ = (x, y);
        todo!()
    }
}
