//! The threads that unpack and decode.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use fantex_store::{ClusterId, ClusterPages, PageError, PageId, decode_plain, page_extent};

use super::Shared;
use super::board::Order;
use crate::read::ReadBuffer;
use crate::{AtlasFormat, PageTexels};

/// Works for a loader. See the [module](super).
pub(super) struct Worker {
    shared: Arc<Shared>,
}

impl Worker {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        Self { shared }
    }

    /// Works until the board is closed.
    pub(super) fn run(self) {
        loop {
            match self.shared.board.wait_for_order() {
                Order::Unpack(cluster, bytes, part) => self.unpack(cluster, bytes, part),
                Order::Decode(cluster, pages) => self.decode(cluster, &pages, true),
                Order::TellScheduler => {}
                Order::End => return,
            }
            // Flights may have ended, clusters may have to be read again.
            self.shared.scheduler.kick();
        }
    }

    fn unpack(&self, cluster: ClusterId, bytes: Arc<ReadBuffer>, part: Range<usize>) {
        let begin = Instant::now();
        let stored_bytes = part.len();
        let unpacked = self.shared.asset.unpack_cluster(cluster, &bytes[part]).map(Arc::new);
        drop(bytes);
        let mut board = self.shared.board.lock();
        let counts = board.counts();
        counts.unpack_seconds += begin.elapsed().as_secs_f64();
        if unpacked.is_ok() {
            counts.unpacked_bytes += self.shared.asset.cluster_page_bytes(cluster) as u64;
        }
        board.unpacked(cluster, stored_bytes, unpacked.as_ref().map_err(PageError::clone));
        drop(board);
        if let Ok(pages) = unpacked {
            // There is room for reads, and decoding may take a while.
            self.shared.scheduler.kick();
            self.decode(cluster, &pages, false);
        }
    }

    /// Decodes the pages that are wanted, as long as there is room for them.
    fn decode(&self, cluster: ClusterId, pages: &ClusterPages, is_hit: bool) {
        let mut decoded = Vec::new();
        let mut share = 0.0;
        let mut begin = Instant::now();
        loop {
            let mut board = self.shared.board.lock();
            let counts = board.counts();
            counts.unpack_seconds += begin.elapsed().as_secs_f64();
            counts.bytes_needed += (share * self.stored_bytes(cluster)) as u64;
            counts.cache_hits += if is_hit { decoded.len() as u64 } else { 0 };
            board.decoded(cluster, std::mem::take(&mut decoded));
            let batch = board.next_batch(cluster, |page| self.page_bytes(page));
            drop(board);
            if batch.is_empty() {
                return;
            }
            begin = Instant::now();
            let page_bytes: usize = batch.iter().map(|&page| self.stored_page_bytes(page)).sum();
            share = page_bytes as f64 / self.shared.asset.cluster_page_bytes(cluster).max(1) as f64;
            decoded = batch.into_iter().map(|page| (page, self.texels(pages, page))).collect();
        }
    }

    fn stored_bytes(&self, cluster: ClusterId) -> f64 {
        let range = self.shared.asset.cluster_range(cluster);
        (range.end - range.start) as f64
    }

    /// Columns and rows of a page that exists.
    fn extent(&self, page: PageId) -> [u32; 2] {
        let group = &self.shared.asset.cover().groups[page.group as usize];
        page_extent(group.level_extent(page.level), page.page)
    }

    /// Bytes of a page in the atlas' formats.
    fn page_bytes(&self, page: PageId) -> usize {
        let [columns, rows] = self.extent(page).map(|n| n as usize / 4);
        columns * rows * self.shared.formats.iter().map(|format| format.block_bytes()).sum::<usize>()
    }

    /// Bytes of a page in the formats in which it is stored.
    fn stored_page_bytes(&self, page: PageId) -> usize {
        let extent = self.extent(page);
        self.shared.asset.channels().iter().map(|channel| channel.format.bytes(extent)).sum()
    }

    fn texels(&self, pages: &ClusterPages, page: PageId) -> Result<PageTexels, PageError> {
        let asset = &self.shared.asset;
        let extent = self.extent(page);
        let channels = asset.channels().iter().zip(&self.shared.formats).enumerate();
        let channels = channels.map(|(index, (channel, format))| {
            let stored = asset.page_in(pages, index, page)?;
            if *format == AtlasFormat::of(channel.format, true) && *format != AtlasFormat::Rgba16F {
                return Ok(Arc::from(stored));
            }
            let plain = decode_plain(channel.format, channel.srgb, extent, stored);
            // The page's bytes are as many as its extent asks for, so this error does not happen.
            let no_such_page =
                |_| PageError::NoSuchPage { path: asset.path().to_owned(), channel: index, page };
            Ok(Arc::from(plain.map_err(no_such_page)?))
        });
        Ok(PageTexels { extent, channels: channels.collect::<Result<_, _>>()? })
    }
}
