//! Pages are what they should be, whoever asks in which order.

use std::collections::BTreeSet;
use std::time::Duration;

use fantex_bake::BakeFormat;
use fantex_store::PageId;
use fantex_stream::read::{FaultyReader, FileReadOptions, ReadFaults, open_file_reader};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, Parcel, ParcelLoader};
use proptest::prelude::*;

use crate::asset::{all_parcels, baked, check_all, expected, expected_page, wait_for_all};

/// Budgets so small that every limit is met all the time.
fn tight() -> ClusterLoaderOptions {
    ClusterLoaderOptions {
        flight_bytes: 1,
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
        let baked = baked(format);
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
        for (page, texels) in crate::asset::load(&mut loader, &pages) {
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
        let arrived = crate::asset::load(&mut loader, &[parcel]);
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
    let arrived = crate::asset::wait_for_all(&mut loader, 0);
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
