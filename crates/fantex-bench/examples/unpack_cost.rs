//! What checking and unpacking clusters costs: the least time of many for every cluster of the given assets, of one thread.
//!
//! `cargo run --release -p fantex-bench --example unpack_cost -- ROUNDS FILE.fan...`
//!
//! The minimum hardly depends on what else the machine does, so that two versions of the code can be compared by turns.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::time::Instant;

use fantex_store::{Asset, ClusterId};

type AnyError = Box<dyn std::error::Error>;

fn main() -> Result<(), AnyError> {
    let mut arguments = std::env::args().skip(1);
    let rounds: u32 = arguments.next().ok_or("expected the number of rounds, then files")?.parse()?;
    for path in arguments {
        measure(Path::new(&path), rounds)?;
    }
    Ok(())
}

fn measure(path: &Path, rounds: u32) -> Result<(), AnyError> {
    let asset = Asset::open(path)?;
    let clusters: Vec<ClusterId> = asset.clusters().collect();
    let mut file = File::open(path)?;
    let (mut nanoseconds, mut stored_bytes, mut raw_bytes) = (0.0, 0.0, 0.0);
    let mut stored = Vec::new();
    for cluster in clusters {
        let range = asset.cluster_range(cluster);
        stored.resize((range.end - range.start) as usize, 0);
        file.seek(SeekFrom::Start(range.start))?;
        file.read_exact(&mut stored)?;
        let mut least = f64::INFINITY;
        for _ in 0..rounds {
            let begin = Instant::now();
            let pages = asset.unpack_cluster(cluster, &stored)?;
            least = least.min(begin.elapsed().as_nanos() as f64);
            drop(pages);
        }
        nanoseconds += least;
        stored_bytes += stored.len() as f64;
        raw_bytes += asset.cluster_page_bytes(cluster) as f64;
    }
    println!(
        "{}: {:.2} ns per stored byte, {:.0} MB/s of stored bytes, {:.0} MB/s of unpacked ones, stored {:.2} of {:.1} MB",
        path.display(),
        nanoseconds / stored_bytes,
        1e3 * stored_bytes / nanoseconds,
        1e3 * raw_bytes / nanoseconds,
        stored_bytes / raw_bytes,
        raw_bytes / 1e6,
    );
    Ok(())
}
