//! What is read when, how much, and how it ends.

use std::time::{Duration, Instant};

use fantex_bake::BakeFormat;
use fantex_stream::read::{FaultyReader, FileReadOptions, ReadFaults, open_file_reader};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, Parcel, ParcelLoader};

use crate::asset::{Baked, all_parcels, baked, wait_for_all};

/// A loader over a slow disk, `depth` reads at a time.
fn slow_loader(
    baked: &Baked,
    depth: usize,
    delay: Duration,
    options: &ClusterLoaderOptions,
) -> ClusterLoader {
    let file = FileReadOptions { depth, ..FileReadOptions::default() };
    let reader = open_file_reader(&baked.path, &file).unwrap();
    let reader = FaultyReader::new(reader, ReadFaults { delay, ..ReadFaults::default() });
    ClusterLoader::with_reader(baked.asset.clone(), Box::new(reader), options).unwrap()
}

/// The first page of every cluster, alone.
fn one_page_per_cluster(baked: &Baked) -> Vec<Parcel> {
    baked.asset.clusters().map(|cluster| Parcel::Page(baked.asset.first_page_of(cluster))).collect()
}

#[test]
fn urgent_pages_come_first() {
    let baked = baked(BakeFormat::Bc7);
    let options =
        ClusterLoaderOptions { merge_bytes: 0, worker_threads: 1, ..ClusterLoaderOptions::default() };
    let mut loader = slow_loader(&baked, 1, Duration::from_millis(5), &options);
    let pages = one_page_per_cluster(&baked);
    assert!(pages.len() >= 8, "{} clusters", pages.len());
    for &page in &pages {
        loader.request(page, 0.0);
    }
    // Changed minds: the last becomes the most urgent.
    for (i, &page) in pages.iter().enumerate() {
        loader.request(page, i as f32);
    }
    let order: Vec<Parcel> = wait_for_all(&mut loader, 1).into_iter().map(|page| page.parcel).collect();
    // Up to three may have begun before their turn.
    let mut sorted: Vec<Parcel> = pages.into_iter().rev().collect();
    let mut early = 0;
    for page in order {
        let place = sorted.iter().position(|&other| other == page).unwrap();
        early += usize::from(place > 0);
        sorted.remove(place);
    }
    assert!(early <= 3, "{early} pages came before their turn");
}

#[test]
fn cancelled_clusters_are_not_read() {
    let baked = baked(BakeFormat::Bc7);
    let options = ClusterLoaderOptions { merge_bytes: 0, ..ClusterLoaderOptions::default() };
    let mut loader = slow_loader(&baked, 1, Duration::from_millis(20), &options);
    let pages = one_page_per_cluster(&baked);
    for &page in &pages {
        loader.request(page, 0.0);
    }
    for &page in &pages[1..] {
        loader.cancel(page);
    }
    assert_eq!(loader.pending(), 1);
    let arrived = wait_for_all(&mut loader, 1);
    assert_eq!((arrived.len(), arrived[0].parcel), (1, pages[0]));
    assert!(loader.statistics().clusters_read <= 3, "{:?}", loader.statistics());
}

#[test]
fn neighbours_are_read_together_and_clusters_are_kept() {
    let baked = baked(BakeFormat::Bc7);
    let mut loader = ClusterLoader::open(baked.asset.clone(), &ClusterLoaderOptions::default()).unwrap();
    let pages = all_parcels(&baked.asset);
    let even: Vec<Parcel> = pages.iter().copied().step_by(2).collect();
    let odd: Vec<Parcel> = pages.iter().copied().skip(1).step_by(2).collect();
    for &page in &even {
        loader.request(page, 1.0);
    }
    assert_eq!(wait_for_all(&mut loader, 1 << 20).len(), even.len());
    let first = loader.statistics();
    assert!(first.reads < first.clusters_read, "{first:?}");
    assert!(first.clusters_read as usize <= baked.asset.clusters().count());
    // The other pages lie in clusters that are at hand.
    for &page in &odd {
        loader.request(page, 1.0);
    }
    assert_eq!(wait_for_all(&mut loader, 1 << 20).len(), odd.len());
    let second = loader.statistics();
    let read_again = second.clusters_read - first.clusters_read;
    assert!(second.cache_hits > 0 && read_again < first.clusters_read / 2, "{second:?}");
    assert_eq!(second.parcels as usize, pages.len());
    // All pages are all that is stored.
    let stored: u64 =
        baked.asset.clusters().map(|id| baked.asset.cluster_range(id)).map(|r| r.end - r.start).sum();
    let share = second.bytes_needed as f64 / stored as f64;
    // A parcel of several clusters counts for the last of them, whose pages may pack better or worse than the others'.
    assert!((0.98..1.02).contains(&share), "{share}: {second:?}");
    assert!(second.bytes_read >= stored);
}

#[test]
fn memory_keeps_within_its_budgets_while_nobody_takes_pages() {
    let baked = baked(BakeFormat::Bc7);
    let options = ClusterLoaderOptions {
        flight_bytes: 400 << 10,
        cache_bytes: 600 << 10,
        stored_cache_bytes: 300 << 10,
        ready_bytes: 500 << 10,
        merge_bytes: 256 << 10,
        worker_threads: 2,
        block_compressed: false,
        ..ClusterLoaderOptions::default()
    };
    let mut loader = ClusterLoader::open(baked.asset.clone(), &options).unwrap();
    let pages = all_parcels(&baked.asset);
    for (i, &page) in pages.iter().enumerate() {
        loader.request(page, (i % 7) as f32);
    }
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_millis(400) {
        let now = loader.statistics();
        assert!(now.flight_bytes <= (400 << 10) + (300 << 10), "{now:?}");
        assert!(now.cache_bytes <= 600 << 10 && now.stored_cache_bytes <= 300 << 10, "{now:?}");
        // A batch per worker, and its last page.
        let parcel_bytes = 256 * 256 * 10;
        assert!(now.ready_bytes <= (500 << 10) + 2 * ((256 << 10) + parcel_bytes), "{now:?}");
        std::thread::yield_now();
    }
    assert!(loader.statistics().ready_bytes >= 500 << 10);
    assert_eq!(wait_for_all(&mut loader, 1 << 18).len(), pages.len());
}

#[test]
fn polls_keep_their_budget_but_never_starve() {
    let baked = baked(BakeFormat::Bc7);
    let mut loader = ClusterLoader::open(baked.asset.clone(), &ClusterLoaderOptions::default()).unwrap();
    let pages = all_parcels(&baked.asset);
    for &page in &pages {
        loader.request(page, 0.0);
    }
    while loader.statistics().ready_bytes < 1 << 20 {
        std::thread::sleep(Duration::from_micros(100));
    }
    for max_bytes in [0, 10_000, 200_000] {
        let arrived = loader.poll(max_bytes);
        let bytes: usize = arrived.iter().map(|page| page.texels.as_ref().unwrap().bytes()).sum();
        assert!(arrived.len() == 1 || bytes <= max_bytes, "{} pages, {bytes} bytes", arrived.len());
    }
}

#[cfg(target_os = "linux")]
fn thread_count() -> usize {
    std::fs::read_dir("/proc/self/task").unwrap().count()
}

#[test]
#[cfg(target_os = "linux")]
fn dropping_a_busy_loader_ends_its_threads() {
    let baked = baked(BakeFormat::Bc7);
    let before = thread_count();
    for ring in [true, false] {
        for _ in 0..5 {
            let file = FileReadOptions { ring, ..FileReadOptions::default() };
            let options = ClusterLoaderOptions { file, ..ClusterLoaderOptions::default() };
            let mut loader = ClusterLoader::open(baked.asset.clone(), &options).unwrap();
            assert!(thread_count() > before);
            for page in all_parcels(&baked.asset) {
                loader.request(page, 0.0);
            }
        }
        // A joined thread may still be listed for a moment.
        let deadline = Instant::now() + Duration::from_secs(10);
        while thread_count() > before {
            assert!(Instant::now() < deadline, "{} threads, {before} before", thread_count());
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
