//! Pages are what they should be, in whichever order they are requested.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Seek, SeekFrom, Write};
use std::time::{Duration, Instant};

use fantex_bake::BakeFormat;
use fantex_base::{Error, ErrorKind, Place};
use fantex_bench::faulty::{FaultyReader, ReadFaults};
use fantex_store::{ClusterId, PAGE, PageId};
use fantex_stream::read::{FileReadOptions, RetryPolicy, open_file_reader};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, Parcel, ParcelLoader, ParcelTexels};
use proptest::prelude::*;

use crate::{
    Baked, all_parcels, baked, baked_with, check_all, clusters, expected, expected_page, load, wait_for_all,
};

/// Budgets so small that every limit is met all the time.
fn tight() -> ClusterLoaderOptions {
    ClusterLoaderOptions {
        in_flight_bytes: 1,
        cache_bytes: 300 << 10,
        stored_cache_bytes: 0,
        ready_bytes: 1,
        worker_threads: 2,
        ..ClusterLoaderOptions::default()
    }
}

#[test]
fn every_page_is_that_of_the_asset() {
    for format in [BakeFormat::Bc7, BakeFormat::Bc1, BakeFormat::Rgba8, BakeFormat::Float] {
        let baked = baked_with(format, 400_000);
        let mut sides = baked.asset.cover().groups.iter().flat_map(|group| group.extent);
        assert!(sides.any(|side| side > PAGE), "no tile has several pages");
        for block_compressed in [true, false] {
            let options = ClusterLoaderOptions { block_compressed, ..ClusterLoaderOptions::default() };
            let mut loader = ClusterLoader::open(baked.asset.clone(), &options).unwrap();
            check_all(&mut loader, &baked.asset, block_compressed);
        }
    }
}

#[test]
fn budgets_that_hold_nothing_bring_all_parcels() {
    let baked = baked(BakeFormat::Bc7);
    for (cache_bytes, stored_cache_bytes) in [(0, 0), (300 << 10, 0), (0, 300 << 10), (300 << 10, 100 << 10)]
    {
        let options =
            ClusterLoaderOptions { cache_bytes, stored_cache_bytes, block_compressed: false, ..tight() };
        let mut loader = ClusterLoader::open(baked.asset.clone(), &options).unwrap();
        // Without any cache, each batch reads its cluster anew: a few pages of each will do.
        let pages: Vec<Parcel> = all_parcels(&baked.asset).into_iter().step_by(3).collect();
        for (page, texels) in crate::load(&mut loader, &pages) {
            assert!(texels.unwrap() == expected(&baked.asset, page, false), "{page}");
        }
    }
}

#[test]
fn a_page_that_tiles_share_comes_alone_when_it_is_asked_for_alone() {
    let baked = baked(BakeFormat::Bc7);
    let mut loader = ClusterLoader::open(baked.asset.clone(), &ClusterLoaderOptions::default()).unwrap();
    let pages = baked.asset.cover().groups.iter().enumerate();
    let last = pages.map(|(i, group)| (i as u32, group.level_count() - 1));
    let pages: Vec<PageId> = last.map(|(group, level)| PageId { group, level, page: [0, 0] }).collect();
    let parcels: Vec<Parcel> = pages.iter().copied().map(Parcel::Page).collect();
    for (&page, &parcel) in pages.iter().zip(&parcels) {
        let arrived = crate::load(&mut loader, &[parcel]);
        assert!(arrived[&parcel].as_ref().unwrap() == &expected_page(&baked.asset, page, true), "{page}");
    }
}

#[test]
fn pages_that_do_not_exist_arrive_as_errors_that_name_them() {
    let baked = baked(BakeFormat::Bc7);
    let mut loader = ClusterLoader::open(baked.asset.clone(), &ClusterLoaderOptions::default()).unwrap();
    let absent = PageId { group: 1 << 30, level: 0, page: [0, 0] };
    let absent_bundle = Parcel::Bundle { bundle: u32::MAX, step: 0 };
    loader.request(Parcel::Page(absent), 1.0);
    loader.request(absent_bundle, 0.5);
    loader.request(Parcel::Page(PageId { group: 0, level: 40, page: [0, 0] }), 2.0);
    loader.cancel(Parcel::Page(PageId { group: 0, level: 40, page: [0, 0] }));
    assert_eq!(loader.pending(), 2);
    let arrived = crate::wait_for_all(&mut loader, 0);
    assert_eq!([&arrived[0], &arrived[1]].map(|a| a.parcel), [Parcel::Page(absent), absent_bundle]);
    assert!(arrived[1].texels.is_err());
    let message = arrived[0].texels.as_ref().unwrap_err().to_string();
    assert!(message.contains("torus.fan") && message.contains("group 1073741824"), "{message}");
}

/// One step of a caller.
#[derive(Clone, Debug)]
enum Step {
    Request(prop::sample::Index, f32),
    RequestMany(prop::sample::Index, usize),
    Cancel(prop::sample::Index),
    CancelMany(prop::sample::Index, usize),
    Poll(usize),
    Pause,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let index = any::<prop::sample::Index>;
    let step = prop_oneof![
        3 => (index(), -10.0f32..10.0).prop_map(|(page, urgency)| Step::Request(page, urgency)),
        1 => (index(), 1..200usize).prop_map(|(page, count)| Step::RequestMany(page, count)),
        2 => index().prop_map(Step::Cancel),
        1 => (index(), 1..200usize).prop_map(|(page, count)| Step::CancelMany(page, count)),
        2 => (0..400_000usize).prop_map(Step::Poll),
        1 => Just(Step::Pause),
    ];
    prop::collection::vec(step, 1..200)
}

/// Plays steps against a set of the pages that are due. Nothing else may come, and all of it must (where `may_fail`, maybe as
/// an error: two bad reads in a row).
fn play(loader: &mut ClusterLoader, pages: &[Parcel], steps: &[Step], may_fail: bool) {
    let mut due = BTreeSet::new();
    let many = |index: &prop::sample::Index, count: usize| {
        let from = index.index(pages.len());
        from..(from + count).min(pages.len())
    };
    for step in steps {
        match step {
            Step::Request(index, urgency) => {
                loader.request(pages[index.index(pages.len())], *urgency);
                due.insert(pages[index.index(pages.len())]);
            }
            Step::RequestMany(index, count) => {
                for (i, &page) in pages[many(index, *count)].iter().enumerate() {
                    loader.request(page, (i % 5) as f32);
                    due.insert(page);
                }
            }
            Step::Cancel(index) => {
                loader.cancel(pages[index.index(pages.len())]);
                due.remove(&pages[index.index(pages.len())]);
            }
            Step::CancelMany(index, count) => {
                for page in &pages[many(index, *count)] {
                    loader.cancel(*page);
                    due.remove(page);
                }
            }
            Step::Poll(max_bytes) => {
                for page in loader.poll(*max_bytes) {
                    assert!(due.remove(&page.parcel), "({}) was not asked for", page.parcel);
                    assert!(may_fail || page.texels.is_ok());
                }
            }
            Step::Pause => std::thread::sleep(Duration::from_micros(300)),
        }
        assert_eq!(loader.pending(), due.len());
    }
    for page in wait_for_all(loader, 1 << 20) {
        assert!(due.remove(&page.parcel), "({}) was not asked for", page.parcel);
    }
    assert!(due.is_empty(), "{} pages were lost", due.len());
}

#[test]
fn no_sequence_of_requests_and_cancellations_loses_or_duplicates_a_parcel() {
    let baked = baked(BakeFormat::Bc7);
    let pages = all_parcels(&baked.asset);
    let faults = ReadFaults {
        seed: 7,
        error_probability: 0.05,
        corruption_probability: 0.02,
        delay: Duration::from_micros(200),
        ..ReadFaults::default()
    };
    let file = FileReadOptions { depth: 4, ..FileReadOptions::default() };
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig {
        cases: 100,
        // Each failure waits for its deadline.
        max_shrink_iters: 4,
        failure_persistence: None,
        ..ProptestConfig::default()
    });
    runner
        .run(&(steps(), any::<bool>()), |(steps, is_tight)| {
            let options = if is_tight { tight() } else { ClusterLoaderOptions::default() };
            let reader = open_file_reader(&baked.path, &file).unwrap();
            let reader = Box::new(FaultyReader::new(reader, faults));
            let retry =
                Some(fantex_stream::read::RetryPolicy { retries: 20, first_pause: Duration::from_nanos(1) });
            let options = ClusterLoaderOptions { retry, ..options };
            let mut loader = ClusterLoader::with_reader(baked.asset.clone(), reader, &options).unwrap();
            play(&mut loader, &pages, &steps, true);
            Ok(())
        })
        .unwrap();
    let loader = ClusterLoader::open(baked.asset.clone(), &tight()).unwrap();
    let loader = std::cell::RefCell::new(loader);
    runner
        .run(&steps(), |steps| {
            play(&mut loader.borrow_mut(), &pages, &steps, false);
            Ok(())
        })
        .unwrap();
}

// What is read when, how much, and how it ends.

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
    let mut loader = slow_loader(&baked, 1, Duration::from_millis(60), &options);
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
    let mut loader = slow_loader(&baked, 1, Duration::from_millis(200), &options);
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
        in_flight_bytes: 400 << 10,
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
    let mut ready = 0;
    while begin.elapsed() < Duration::from_millis(400) || ready < 500 << 10 {
        let now = loader.statistics();
        ready = now.ready_bytes;
        assert!(begin.elapsed() < fantex_test::PATIENCE, "{now:?}");
        assert!(now.in_flight_bytes <= (400 << 10) + (300 << 10), "{now:?}");
        assert!(now.cache_bytes <= 600 << 10 && now.stored_cache_bytes <= 300 << 10, "{now:?}");
        // A batch per worker, and its last page.
        let parcel_bytes = 256 * 256 * 10;
        assert!(now.ready_bytes <= (500 << 10) + 2 * ((256 << 10) + parcel_bytes), "{now:?}");
        std::thread::yield_now();
    }
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
        let deadline = Instant::now() + fantex_test::PATIENCE;
        while thread_count() > before {
            assert!(Instant::now() < deadline, "{} threads, {before} before", thread_count());
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

// Reads that fail, files that change underneath.

fn faulty_loader(baked: &Baked, faults: ReadFaults) -> ClusterLoader {
    let reader = open_file_reader(&baked.path, &FileReadOptions::default()).unwrap();
    let retry = Some(RetryPolicy { retries: 3, first_pause: Duration::from_micros(100) });
    // Many reads, so that some are hit.
    let options = ClusterLoaderOptions { merge_bytes: 0, retry, ..ClusterLoaderOptions::default() };
    let reader = Box::new(FaultyReader::new(reader, faults));
    ClusterLoader::with_reader(baked.asset.clone(), reader, &options).unwrap()
}

#[test]
fn rare_errors_are_not_noticed() {
    let baked = baked(BakeFormat::Bc7);
    let mut retries = 0;
    // Neighbours are read at once, so one load is few reads, and how many depends on time.
    for seed in 0..400 {
        let faults = ReadFaults { seed, error_probability: 0.01, ..ReadFaults::default() };
        let mut loader = faulty_loader(&baked, faults);
        check_all(&mut loader, &baked.asset, true);
        retries += loader.statistics().retries;
        assert_eq!(loader.statistics().parcels_failed, 0);
        if seed >= 5 && retries > 0 {
            return;
        }
    }
    panic!("not one read failed");
}

#[test]
fn errors_everywhere_name_file_and_place_and_end() {
    let baked = baked(BakeFormat::Bc7);
    let faults = ReadFaults { seed: 1, error_probability: 1.0, ..ReadFaults::default() };
    let mut loader = faulty_loader(&baked, faults);
    let pages = all_parcels(&baked.asset);
    for (page, texels) in load(&mut loader, &pages) {
        let error = texels.unwrap_err();
        let starts = clusters(&baked.asset, page).into_iter().map(|id| baked.asset.cluster_range(id).start);
        let starts: Vec<u64> = starts.collect();
        assert!(
            matches!(error.place(), Some(Place::Byte(offset)) if starts.contains(offset)),
            "{page}: {error}"
        );
        let message = error.to_string();
        assert!(message.contains("torus.fan") && message.contains("an injected fault"), "{message}");
    }
    let counts = loader.statistics();
    assert_eq!(counts.parcels_failed as usize, pages.len());
    // A cluster whose parcels have failed with another one is not tried again.
    assert!((counts.clusters_failed..=baked.asset.clusters().count() as u64).contains(&(counts.retries / 3)));
    // Asked for again, they are tried again.
    assert_eq!(load(&mut loader, &pages[..5]).len(), 5);
}

#[test]
fn corrupted_bytes_never_pass() {
    let baked = baked(BakeFormat::Bc7);
    for (probability, all_fail) in [(0.2, false), (1.0, true)] {
        let faults = ReadFaults { seed: 3, corruption_probability: probability, ..ReadFaults::default() };
        let mut loader = faulty_loader(&baked, faults);
        let arrived = load(&mut loader, &all_parcels(&baked.asset));
        for (page, texels) in arrived {
            match texels {
                Ok(texels) => assert!(!all_fail && texels == expected(&baked.asset, page, true), "{page}"),
                Err(error) => assert!(error.kind() == ErrorKind::Damaged, "{page}: {error}"),
            }
        }
        assert!(loader.statistics().retries > 0);
    }
}

#[test]
fn reads_that_end_early_are_errors() {
    let baked = baked(BakeFormat::Bc7);
    let mut loader =
        faulty_loader(&baked, ReadFaults { truncation_probability: 1.0, ..ReadFaults::default() });
    for texels in load(&mut loader, &all_parcels(&baked.asset)).into_values() {
        assert_eq!(texels.unwrap_err().kind(), ErrorKind::Io);
    }
    assert_eq!(loader.statistics().retries, 0);
}

#[test]
fn a_slow_disk_is_slow_and_no_more() {
    let baked = baked(BakeFormat::Bc7);
    let faults = ReadFaults {
        delay: Duration::from_millis(10),
        bytes_per_second: Some(20e6),
        ..ReadFaults::default()
    };
    let mut loader = faulty_loader(&baked, faults);
    let begin = Instant::now();
    check_all(&mut loader, &baked.asset, true);
    let least = loader.statistics().cluster_bytes as f64 / 20e6;
    assert!(begin.elapsed().as_secs_f64() >= least, "{:?}, {least}", begin.elapsed());
}

/// Pages before and after something happened to the file.
fn load_with_change(
    baked: &Baked,
    options: &ClusterLoaderOptions,
    change: impl FnOnce(),
) -> BTreeMap<Parcel, Result<ParcelTexels, Error>> {
    let mut loader = ClusterLoader::open(baked.asset.clone(), options).unwrap();
    change();
    load(&mut loader, &all_parcels(&baked.asset))
}

#[test]
fn a_file_truncated_underneath_loses_only_what_is_gone() {
    for (direct, ring) in [(true, true), (false, true), (true, false), (false, false)] {
        let baked = baked(BakeFormat::Bc7);
        let pages = all_parcels(&baked.asset);
        let whole: Vec<_> = pages.iter().map(|&page| expected(&baked.asset, page, true)).collect();
        // In the middle of a cluster, and not at a multiple of anything.
        let all: Vec<ClusterId> = baked.asset.clusters().collect();
        let middle = baked.asset.cluster_range(all[all.len() / 2]);
        let length = (middle.start + middle.end) / 2 + 1;
        let file = FileReadOptions { direct, ring, depth: 8 };
        let options = ClusterLoaderOptions { file, ..ClusterLoaderOptions::default() };
        let arrived = load_with_change(&baked, &options, || {
            std::fs::OpenOptions::new().write(true).open(&baked.path).unwrap().set_len(length).unwrap();
        });
        let (mut kept, mut lost) = (0, 0);
        for (page, whole) in pages.iter().zip(whole) {
            let ranges = clusters(&baked.asset, *page).into_iter().map(|id| baked.asset.cluster_range(id));
            let gone: Vec<u64> = ranges.filter(|range| range.end > length).map(|range| range.start).collect();
            match &arrived[page] {
                Ok(texels) => {
                    assert!(gone.is_empty() && *texels == whole, "{page}");
                    kept += 1;
                }
                Err(error) => {
                    let message = error.to_string();
                    let names = |start: &u64| message.contains(&format!("at byte {start} of"));
                    assert!(gone.iter().any(names), "{page}: {message}");
                    lost += 1;
                }
            }
        }
        assert!(kept > 0 && lost > 0, "{kept} {lost}");
    }
}

#[test]
fn a_file_overwritten_underneath_gives_errors_where_it_was() {
    let baked = baked(BakeFormat::Bc7);
    let pages = all_parcels(&baked.asset);
    let hit = *clusters(&baked.asset, pages[pages.len() / 3]).first().unwrap();
    let range = baked.asset.cluster_range(hit);
    let arrived = load_with_change(&baked, &ClusterLoaderOptions::default(), || {
        let mut file = std::fs::OpenOptions::new().write(true).open(&baked.path).unwrap();
        file.seek(SeekFrom::Start(range.start + 5)).unwrap();
        file.write_all(b"something else").unwrap();
    });
    for (page, texels) in arrived {
        let is_hit = clusters(&baked.asset, page).contains(&hit);
        assert_eq!(texels.is_err(), is_hit, "{page}");
        if let Err(error) = texels {
            assert!(error.place() == Some(&Place::Byte(range.start)), "{error}");
        }
    }
}

#[test]
fn a_file_removed_underneath_is_still_read() {
    let baked = baked(BakeFormat::Bc7);
    let page = all_parcels(&baked.asset)[0];
    let whole = expected(&baked.asset, page, true);
    let arrived = load_with_change(&baked, &ClusterLoaderOptions::default(), || {
        std::fs::remove_file(&baked.path).unwrap();
    });
    assert!(arrived[&page].as_ref().unwrap() == &whole);
    assert!(ClusterLoader::open(baked.asset.clone(), &ClusterLoaderOptions::default()).is_err());
    drop(baked.folder);
}
