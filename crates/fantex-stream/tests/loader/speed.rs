//! What the disk can do, and what of it arrives.

use std::path::PathBuf;
use std::sync::Arc;

use fantex_bake::BakeFormat;
use fantex_store::Asset;
use fantex_stream::{
    ClusterLoaderOptions, DiskLoad, loaded_clusters, mean_cluster_bytes, plain_reads, queued_reads,
    unpacked_clusters,
};

use crate::asset::{bake_torus, baked};

/// Measures and prints all four speeds; returns MB/s of plain, queued, loaded, unpacked.
fn measure(asset: &Arc<Asset>, load: &DiskLoad) -> [f64; 4] {
    let block_bytes = mean_cluster_bytes(asset);
    let plain = plain_reads(asset.path(), block_bytes, load).unwrap();
    let queued = queued_reads(asset, load).unwrap();
    // Each cluster by itself, and none from the cache, as the plain loop reads.
    let options = ClusterLoaderOptions { cache_bytes: 0, merge_bytes: 0, ..ClusterLoaderOptions::default() };
    let (loaded, counts) = loaded_clusters(asset, &options, load).unwrap();
    let unpacked = unpacked_clusters(asset, load).unwrap();
    eprintln!("{}; blocks of {block_bytes} bytes", plain.reader.unwrap());
    for (name, speed) in [("plain", plain), ("queued", queued), ("loaded", loaded), ("unpacked", unpacked)] {
        assert!(speed.reads > 0 && speed.bytes > 0, "{name}");
        let ratio = speed.megabytes_per_second() / plain.megabytes_per_second();
        let (reads, megabytes) = (speed.reads_per_second(), speed.megabytes_per_second());
        eprintln!("{name:>9}: {reads:8.0} reads/s {megabytes:8.1} MB/s, {ratio:.2} of plain");
    }
    eprintln!("{counts:?}");
    [plain, queued, loaded, unpacked].map(|speed| speed.megabytes_per_second())
}

#[test]
fn all_speeds_are_measured() {
    let baked = baked(BakeFormat::Bc7);
    let load = DiskLoad { seconds: 0.05, depth: 8, seed: 1 };
    let [plain, queued, loaded, unpacked] = measure(&baked.asset, &load);
    assert!([plain, queued, loaded, unpacked].iter().all(|speed| speed.is_finite()));
}

/// On an asset that is given in `FANTEX_BENCH_ASSET`, or of some hundred megabytes, baked for it.
#[test]
#[ignore = "takes minutes; run it alone, on an idle machine"]
fn most_of_the_disks_speed_arrives() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let given = std::env::var_os("FANTEX_BENCH_ASSET").map(PathBuf::from);
    let path = given.unwrap_or_else(|| {
        let path = folder.path().join("large.fan");
        bake_torus(&path, BakeFormat::Bc7, 40_000_000);
        path
    });
    let asset = Arc::new(Asset::open(&path).unwrap());
    // Interleaved, so that what else the machine does hits all alike; the best of each counts.
    let mut best = [0.0f64; 4];
    for seed in 0..5 {
        let speeds = measure(&asset, &DiskLoad { seed, ..DiskLoad::default() });
        best.iter_mut().zip(speeds).for_each(|(best, speed)| *best = best.max(speed));
    }
    let [plain, queued, loaded, unpacked] = best;
    eprintln!("best MB/s: plain {plain:.0}, queued {queued:.0}, loaded {loaded:.0}, unpacked {unpacked:.0}");
    // What bounds is either the disk or the processor.
    assert!(loaded >= 0.8 * plain.min(unpacked), "{loaded} MB/s of {plain} and {unpacked}");
}
