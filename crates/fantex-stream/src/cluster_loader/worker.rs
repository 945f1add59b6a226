//! The threads that unpack and decode.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use fantex_store::{ClusterId, ClusterPages, PageError, PageId, decode_plain, page_extent};

use super::Shared;
use super::board::Order;
use crate::read::ReadBuffer;
use crate::{AtlasFormat, Parcel, ParcelTexels, assemble};

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
                Order::Unpack(cluster, bytes, part) => self.unpack(cluster, bytes, part, true),
                Order::UnpackKept(cluster, bytes) => {
                    let all = 0..bytes.len();
                    self.unpack(cluster, bytes, all, false);
                }
                Order::Make(cluster, pages) => self.make(cluster, &pages, true),
                Order::TellScheduler => {}
                Order::End => return,
            }
            // Flights may have ended, clusters may have to be read again.
            self.shared.scheduler.kick();
        }
    }

    /// `is_read`: the bytes come from a read just now.
    fn unpack(&self, cluster: ClusterId, bytes: Arc<ReadBuffer>, part: Range<usize>, is_read: bool) {
        let begin = Instant::now();
        let stored_bytes = part.len();
        let unpacked = self.shared.asset.unpack_cluster(cluster, &bytes[part.clone()]).map(Arc::new);
        let is_kept = is_read && unpacked.is_ok() && stored_bytes <= self.shared.options.stored_cache_bytes;
        // Buffers of reads are large, and used again.
        let kept = is_kept.then(|| Arc::new(ReadBuffer::from(bytes[part].to_vec())));
        drop(bytes);
        let mut board = self.shared.board.lock();
        let counts = board.counts();
        counts.unpack_seconds += begin.elapsed().as_secs_f64();
        if unpacked.is_ok() {
            counts.unpacked_bytes += self.shared.asset.cluster_page_bytes(cluster) as u64;
        }
        if is_read {
            board.landed(cluster, stored_bytes, kept.as_ref());
        }
        board.unpacked(cluster, unpacked.as_ref().map_err(PageError::clone));
        drop(board);
        if let Ok(pages) = unpacked {
            // There is room for reads, and decoding may take a while.
            self.shared.scheduler.kick();
            self.make(cluster, &pages, !is_read);
        }
    }

    /// Makes the parcels that are wanted, as long as there is room for them.
    fn make(&self, cluster: ClusterId, pages: &Arc<ClusterPages>, is_hit: bool) {
        let mut made = Vec::new();
        let mut share = 0.0;
        let mut begin = Instant::now();
        loop {
            let mut board = self.shared.board.lock();
            let counts = board.counts();
            counts.unpack_seconds += begin.elapsed().as_secs_f64();
            counts.bytes_needed += (share * self.stored_bytes(cluster)) as u64;
            counts.cache_hits += if is_hit { made.len() as u64 } else { 0 };
            board.made(cluster, std::mem::take(&mut made));
            let batch = board.next_batch(cluster, pages, |parcel| self.parcel_bytes(parcel));
            drop(board);
            if batch.is_empty() {
                return;
            }
            begin = Instant::now();
            let stored: usize = batch.iter().map(|(parcel, _)| self.stored_parcel_bytes(*parcel)).sum();
            share = stored as f64 / self.shared.asset.cluster_page_bytes(cluster).max(1) as f64;
            made = batch.into_iter().map(|(parcel, from)| (parcel, self.texels(&from, parcel))).collect();
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

    /// Bytes of a parcel's pages in the atlas' formats.
    fn parcel_bytes(&self, parcel: Parcel) -> usize {
        let block_bytes: usize = self.shared.formats.iter().map(|format| format.block_bytes()).sum();
        let blocks = |page| self.extent(page).map(|n| n as usize / 4).into_iter().product::<usize>();
        parcel.pages(self.shared.asset.cover()).map(blocks).sum::<usize>() * block_bytes
    }

    /// Bytes of a parcel's pages in the formats in which they are stored.
    fn stored_parcel_bytes(&self, parcel: Parcel) -> usize {
        let bytes = |extent| -> usize {
            self.shared.asset.channels().iter().map(|channel| channel.format.bytes(extent)).sum()
        };
        parcel.pages(self.shared.asset.cover()).map(|page| bytes(self.extent(page))).sum()
    }

    /// A parcel's texels out of the clusters that hold its pages.
    fn texels(&self, from: &[Arc<ClusterPages>], parcel: Parcel) -> Result<ParcelTexels, PageError> {
        let Shared { asset, formats, .. } = &*self.shared;
        assemble(&parcel.layout(asset.cover()), formats, |index, page| {
            let (channel, format) = (&asset.channels()[index], formats[index]);
            let stored = asset.page_in_any(from, index, page)?;
            if format == AtlasFormat::of(channel.format, true) && format != AtlasFormat::Rgba16F {
                return Ok(Cow::Borrowed(stored));
            }
            let plain = decode_plain(channel.format, channel.srgb, self.extent(page), stored);
            // The page's bytes are as many as its extent asks for, so this error does not happen.
            let no_such_page =
                |_| PageError::NoSuchPage { path: asset.path().to_owned(), channel: index, page };
            Ok(Cow::Owned(plain.map_err(no_such_page)?))
        })
    }
}
