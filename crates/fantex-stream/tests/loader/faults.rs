//! Reads that fail, files that change underneath.

use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::time::{Duration, Instant};

use fantex_bake::BakeFormat;
use fantex_store::{ClusterId, PageError};
use fantex_stream::read::{FaultyReader, FileReadOptions, ReadFaults, RetryPolicy, open_file_reader};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, Parcel, ParcelTexels};

use crate::asset::{Baked, all_parcels, baked, check_all, clusters, expected, load};

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
        assert!(matches!(&error, PageError::Io { offset, .. } if starts.contains(offset)), "{page}: {error}");
        let message = error.to_string();
        assert!(message.contains("torus.fan") && message.contains("an injected fault"), "{message}");
    }
    let counts = loader.statistics();
    assert_eq!(counts.parcels_failed as usize, pages.len());
    // A cluster whose parcels have failed with another one is tried no more.
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
                Err(error) => assert!(matches!(error, PageError::Checksum { .. }), "{page}: {error}"),
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
        assert!(matches!(texels, Err(PageError::Io { .. })));
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
) -> BTreeMap<Parcel, Result<ParcelTexels, PageError>> {
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
            assert!(matches!(error, PageError::Checksum { offset, .. } if offset == range.start), "{error}");
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
