//! How fast the disk is, and how much of that arrives as pages.
//!
//! Four measurements, each of which adds one part to the one before, so that their ratios tell what bounds:
//!
//! 1. [`plain_reads`]: random direct reads of one size, nothing else: what the disk can do.
//! 2. [`queued_reads`]: random clusters through a [`QueuedReader`]: what its queue and its thread cost.
//! 3. [`loaded_clusters`]: random clusters through a [`ClusterLoader`]: checksums, unpacking, decoding, hand-over.
//! 4. [`unpacked_clusters`]: checksums and unpacking alone, from memory.

use std::cell::Cell;
use std::io;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use compio::buf::{BufResult, IntoInner, IoBuf};
use compio::io::AsyncReadAt;
use fantex_base::{Random, Result};
use fantex_store::{Asset, ByteSource, ClusterId, FileSource};
use rayon::prelude::*;

use crate::read::{
    BufferPool, FileReadOptions, QueuedReader, ReadRequest, ReaderInfo, open_file_reader, open_in_runtime,
    ring_runtime, takes_direct_io, threaded_reader,
};
use crate::{ClusterLoader, ClusterLoaderOptions, LoaderStatistics, Parcel, ParcelLoader};

/// Blocks of plain reads start at multiples of this.
const ALIGNMENT: u64 = 4096;

/// Stored bytes that [`unpacked_clusters`] keeps in memory.
const UNPACK_BYTES: u64 = 64 << 20;

/// What to measure with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskLoad {
    /// How long.
    pub seconds: f64,
    /// Reads in flight.
    pub depth: usize,
    /// Chooses the places.
    pub seed: u64,
}

impl Default for DiskLoad {
    /// Two seconds, 32 reads in flight.
    fn default() -> Self {
        Self { seconds: 2.0, depth: 32, seed: 0 }
    }
}

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiskSpeed {
    /// Reads (or clusters) that were completed.
    pub reads: u64,
    /// Stored bytes of those.
    pub bytes: u64,
    /// Time it took.
    pub seconds: f64,
    /// How they were read; none where nothing was.
    pub reader: Option<ReaderInfo>,
}

impl DiskSpeed {
    /// Reads (or clusters) per second.
    pub fn reads_per_second(&self) -> f64 {
        self.reads as f64 / self.seconds.max(1e-9)
    }

    /// Millions of stored bytes per second.
    pub fn megabytes_per_second(&self) -> f64 {
        self.bytes as f64 / self.seconds.max(1e-9) / 1e6
    }
}

/// The mean length of an asset's clusters, rounded up to what direct I/O reads: the block size to compare with.
pub fn mean_cluster_bytes(asset: &Asset) -> usize {
    let lengths = asset.clusters().map(|cluster| {
        let range = asset.cluster_range(cluster);
        (range.end - range.start).next_multiple_of(ALIGNMENT)
    });
    let (count, sum) = lengths.fold((0u64, 0u64), |(count, sum), length| (count + 1, sum + length));
    (sum / count.max(1)).next_multiple_of(ALIGNMENT).max(ALIGNMENT) as usize
}

/// Reads blocks at random places of a file, by direct I/O where possible, in a plain loop over the system's completion queue
/// (by threads where it has none).
///
/// # Errors
/// The file cannot be opened or read.
pub fn plain_reads(path: &Path, block_bytes: usize, load: &DiskLoad) -> io::Result<DiskSpeed> {
    let direct = takes_direct_io(path);
    let blocks = std::fs::metadata(path)?.len().saturating_sub(block_bytes as u64) / ALIGNMENT + 1;
    let Ok((runtime, kind)) = ring_runtime(load.depth) else {
        let mut reader = threaded_reader(path, load.depth, direct)?;
        return random_reads(&mut reader, load, |random| (ALIGNMENT * random.below(blocks), block_bytes));
    };
    let reader = Some(ReaderInfo { kind, direct, depth: load.depth });
    runtime.block_on(async {
        let file = Rc::new(open_in_runtime(path, direct).await?);
        let begin = Instant::now();
        let end = begin + Duration::from_secs_f64(load.seconds);
        let (reads, bytes) = (Rc::new(Cell::new(0)), Rc::new(Cell::new(0)));
        let lanes = (0..load.depth).map(|lane| {
            let (file, reads, bytes) = (Rc::clone(&file), Rc::clone(&reads), Rc::clone(&bytes));
            let mut random = Random::of_seeds([load.seed, lane as u64, 0]);
            compio::runtime::spawn(async move {
                let mut memory = BufferPool::new(0).take(block_bytes);
                let part = memory.start..memory.start + block_bytes;
                while Instant::now() < end {
                    let offset = ALIGNMENT * random.below(blocks);
                    let slice = std::mem::take(&mut memory.bytes).slice(part.clone());
                    let BufResult(count, slice) = file.read_at(slice, offset).await;
                    memory.bytes = slice.into_inner();
                    bytes.set(bytes.get() + count? as u64);
                    reads.set(reads.get() + 1);
                }
                Ok::<(), io::Error>(())
            })
        });
        let lanes: Vec<_> = lanes.collect();
        for lane in lanes {
            lane.await.unwrap_or_else(|_| Err(io::ErrorKind::Other.into()))?;
        }
        let seconds = begin.elapsed().as_secs_f64();
        Ok(DiskSpeed { reads: reads.get(), bytes: bytes.get(), seconds, reader })
    })
}

/// Reads random clusters of an asset in a file, and does nothing with them.
///
/// # Errors
/// The file cannot be opened or read.
pub fn queued_reads(asset: &Asset, load: &DiskLoad) -> io::Result<DiskSpeed> {
    let options = FileReadOptions { depth: load.depth, ..FileReadOptions::default() };
    let mut reader = open_file_reader(asset.path(), &options)?;
    let clusters: Vec<ClusterId> = asset.clusters().collect();
    if clusters.is_empty() {
        return Ok(DiskSpeed { reads: 0, bytes: 0, seconds: 0.0, reader: Some(reader.info()) });
    }
    random_reads(&mut *reader, load, |random| {
        let range = asset.cluster_range(clusters[random.below(clusters.len() as u64) as usize]);
        (range.start, (range.end - range.start) as usize)
    })
}

/// Keeps a reader busy with reads of the given places and lengths.
fn random_reads(
    reader: &mut dyn QueuedReader,
    load: &DiskLoad,
    place: impl Fn(&mut Random) -> (u64, usize),
) -> io::Result<DiskSpeed> {
    let mut random = Random::of_seeds([load.seed, 0, 0]);
    let begin = Instant::now();
    let end = begin + Duration::from_secs_f64(load.seconds);
    let mut speed = DiskSpeed { reads: 0, bytes: 0, seconds: 0.0, reader: Some(reader.info()) };
    let (mut token, mut in_flight) = (0, 0);
    loop {
        while in_flight < load.depth + load.depth / 4 && Instant::now() < end {
            let (offset, length) = place(&mut random);
            reader.submit(ReadRequest { token, offset, length });
            token += 1;
            in_flight += 1;
        }
        if in_flight == 0 {
            break;
        }
        if let Some(completion) = reader.wait(None) {
            in_flight -= 1;
            speed.reads += 1;
            speed.bytes += completion.result?.len() as u64;
        }
    }
    speed.seconds = begin.elapsed().as_secs_f64();
    Ok(speed)
}

/// Loads random clusters, a parcel of each, through a loader. Counts stored bytes of clusters, and gives the loader's own counts
/// (among them the bytes of all texels in these clusters, which can be taken from it).
/// (Clusters that are still in its cache are not counted.)
///
/// # Errors
/// As [`ClusterLoader::open`].
pub fn loaded_clusters(
    asset: &Arc<Asset>,
    options: &ClusterLoaderOptions,
    load: &DiskLoad,
) -> Result<(DiskSpeed, LoaderStatistics)> {
    let mut options = options.clone();
    options.file.depth = load.depth;
    // What was read once counts once.
    options.stored_cache_bytes = 0;
    let mut loader = ClusterLoader::open(Arc::clone(asset), &options)?;
    let clusters: Vec<ClusterId> = asset.clusters().collect();
    // Enough to keep the reader busy between two polls, but not all clusters.
    let most_pending = (4 * load.depth).min(clusters.len() / 2);
    let mut random = Random::of_seeds([load.seed, 0, 0]);
    let begin = Instant::now();
    let end = begin + Duration::from_secs_f64(load.seconds);
    while Instant::now() < end {
        while loader.pending() < most_pending {
            let cluster = clusters[random.below(clusters.len() as u64) as usize];
            let page = asset.first_page_of(cluster);
            let parcel = Parcel::of(&asset.cover().groups[page.group as usize], page);
            loader.request(parcel, random.below(1 << 20) as f32);
        }
        if loader.poll(usize::MAX).is_empty() {
            // Once per millisecond, as a fast frame would: polling in a loop would take processor time from the workers.
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let seconds = begin.elapsed().as_secs_f64();
    let counts = loader.statistics();
    let speed = DiskSpeed {
        reads: counts.clusters_read,
        bytes: counts.cluster_bytes,
        seconds,
        reader: Some(loader.reader_info()),
    };
    Ok((speed, counts))
}

/// Checks and unpacks random clusters from memory, on all of the global pool's threads. Clusters that cannot be read are left out.
///
/// # Errors
/// The file cannot be opened or read.
pub fn unpacked_clusters(asset: &Asset, load: &DiskLoad) -> io::Result<DiskSpeed> {
    let clusters: Vec<ClusterId> = asset.clusters().collect();
    let mut random = Random::of_seeds([load.seed, 0, 0]);
    let source = FileSource::open(asset.path())?;
    let (mut stored, mut bytes) = (Vec::new(), 0);
    while bytes < UNPACK_BYTES && stored.len() < 4 * clusters.len() {
        let cluster = clusters[random.below(clusters.len() as u64) as usize];
        let range = asset.cluster_range(cluster);
        let mut memory = vec![0; (range.end - range.start) as usize];
        source.read_exact_at(&mut memory, range.start)?;
        bytes += memory.len() as u64;
        stored.push((cluster, memory));
    }
    let begin = Instant::now();
    let mut speed = DiskSpeed { reads: 0, bytes: 0, seconds: 0.0, reader: None };
    while begin.elapsed().as_secs_f64() < load.seconds && !stored.is_empty() {
        let unpack = |(cluster, bytes): &(ClusterId, Vec<u8>)| {
            asset.unpack_cluster(*cluster, bytes).map_or((0, 0), |_| (1, bytes.len() as u64))
        };
        let add = |a: (u64, u64), b: (u64, u64)| (a.0 + b.0, a.1 + b.1);
        let (count, bytes) = stored.par_iter().map(unpack).reduce(|| (0, 0), add);
        speed.reads += count;
        speed.bytes += bytes;
    }
    speed.seconds = begin.elapsed().as_secs_f64();
    Ok(speed)
}
