//! Assets that are not files, and clusters that somebody else reads.

use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::common::{block_channels, fan_cover, pages, plain_channels, sheet, write};
use fantex_store::{Asset, ByteSource, OpenError, PageError};

/// Bytes in memory that remember what was asked for.
#[derive(Debug, Default)]
struct Recorded {
    bytes: Mutex<Vec<u8>>,
    reads: Mutex<Vec<(u64, usize)>>,
}

impl ByteSource for Recorded {
    fn location(&self) -> &Path {
        Path::new("https://example.org/recorded.fan")
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.bytes.lock().unwrap().len() as u64)
    }

    fn read_at(&self, into: &mut [u8], offset: u64) -> io::Result<usize> {
        self.reads.lock().unwrap().push((offset, into.len()));
        let bytes = self.bytes.lock().unwrap();
        let from = (offset as usize).min(bytes.len());
        let count = into.len().min(bytes.len() - from);
        into[..count].copy_from_slice(&bytes[from..from + count]);
        Ok(count)
    }
}

fn recorded() -> Arc<Recorded> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.fan");
    let mesh = sheet(6);
    let cover = fan_cover(&mesh, |v| [[300, 8], [12, 4], [64, 64], [20, 280]][v % 4]);
    let channels = [block_channels(), plain_channels()].concat();
    write(&path, &mesh, &cover, &channels, 100).unwrap();
    Arc::new(Recorded { bytes: Mutex::new(std::fs::read(&path).unwrap()), ..Recorded::default() })
}

#[test]
fn two_reads_open_an_asset() {
    let source = recorded();
    let asset = Asset::open_source(source.clone()).unwrap();
    let reads = source.reads.lock().unwrap().clone();
    assert_eq!(reads.len(), 2, "{reads:?}");
    assert_eq!(reads[0], (0, 8192));
    assert_eq!(reads[1].0, 8192);
    let first_cluster = asset.clusters().map(|id| asset.cluster_range(id).start).min().unwrap();
    assert!(reads[1].0 + reads[1].1 as u64 <= first_cluster);
}

#[test]
fn clusters_read_by_others_hold_the_same_pages() {
    let source = recorded();
    let asset = Asset::open_source(source.clone()).unwrap();
    let bytes = source.bytes.lock().unwrap().clone();
    let mut seen = 0;
    for cluster in asset.clusters() {
        assert_eq!(asset.cluster_of(asset.first_page_of(cluster)).unwrap(), cluster);
        let range = asset.cluster_range(cluster);
        let stored = &bytes[range.start as usize..range.end as usize];
        let unpacked = asset.unpack_cluster(cluster, stored).unwrap();
        for page in pages(asset.cover()).filter(|&page| asset.cluster_of(page).unwrap() == cluster) {
            for channel in 0..asset.channels().len() {
                let raw = asset.read_page_raw(channel, page).unwrap();
                assert_eq!(asset.page_in(&unpacked, channel, page).unwrap(), raw);
            }
            seen += 1;
        }
        let foreign = pages(asset.cover()).find(|&page| asset.cluster_of(page).unwrap() != cluster).unwrap();
        assert!(matches!(asset.page_in(&unpacked, 0, foreign), Err(PageError::NoSuchPage { .. })));
        let mut damaged = stored.to_vec();
        damaged[0] ^= 1;
        let error = asset.unpack_cluster(cluster, &damaged).unwrap_err();
        assert!(error.to_string().contains("https://example.org/recorded.fan"), "{error}");
        assert!(asset.unpack_cluster(cluster, &stored[1..]).is_err());
    }
    assert_eq!(seen, pages(asset.cover()).count());
}

#[test]
fn messages_name_the_location() {
    let source = recorded();
    let length = source.bytes.lock().unwrap().len();
    source.bytes.lock().unwrap().truncate(length - 1);
    let error = Asset::open_source(source).unwrap_err();
    assert!(matches!(error, OpenError::Truncated { .. }));
    assert!(error.to_string().starts_with("https://example.org/recorded.fan is truncated"), "{error}");
}
