//! Assets on a web server.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use fantex_bake::BakeFormat;
use fantex_store::{ByteSource, OpenError};
use fantex_stream::read::{HttpSource, QueuedReader, ReaderKind, RetryPolicy, http_reader};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, open_asset};

use crate::asset::{Baked, all_parcels, baked, check_all, load};
use crate::http_server::{Manner, Server};
use crate::readers::check_reader;

fn served(manner: Manner) -> (Baked, Server) {
    let baked = baked(BakeFormat::Bc7);
    let server = Server::start(std::fs::read(&baked.path).unwrap(), manner);
    (baked, server)
}

/// Options that do not let a test wait for long.
fn quick() -> ClusterLoaderOptions {
    let retry = Some(RetryPolicy { retries: 8, first_pause: Duration::from_millis(1) });
    ClusterLoaderOptions { retry, ..ClusterLoaderOptions::default() }
}

#[test]
fn two_requests_open_an_asset_and_few_more_bring_its_pages() {
    let (baked, server) = served(Manner::Ranges);
    let asset = Arc::new(open_asset(Path::new(&server.url())).unwrap());
    let ranges = server.ranges();
    assert_eq!(ranges.len(), 2, "{ranges:?}");
    assert_eq!(ranges[0], (0, 8191));
    assert_eq!(ranges[1].0, 8192);
    assert!(asset.mesh() == baked.asset.mesh() && asset.cover() == baked.asset.cover());
    let mut loader = ClusterLoader::open(Arc::clone(&asset), &quick()).unwrap();
    assert_eq!(loader.reader_info().kind, ReaderKind::Http);
    check_all(&mut loader, &baked.asset, true);
    let counts = loader.statistics();
    assert_eq!(server.ranges().len() as u64, 2 + counts.reads);
    assert!(counts.reads < counts.clusters_read, "{counts:?}");
}

#[test]
fn ranges_of_a_server_are_read_like_those_of_a_file() {
    let bytes: Vec<u8> = (0..200_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let server = Server::start(bytes.clone(), Manner::Ranges);
    let source = Arc::new(HttpSource::new(&server.url(), 4));
    assert_eq!(source.length().unwrap(), 200_000);
    let mut reader = http_reader(source, 4).unwrap();
    assert_eq!(reader.info().to_string(), "HTTP, 4 connections");
    check_reader(&mut reader, &bytes);
}

#[test]
fn a_server_without_ranges_is_refused_with_a_reason() {
    let (_, server) = served(Manner::WholeFiles);
    let error = open_asset(Path::new(&server.url())).unwrap_err();
    assert!(matches!(&error, OpenError::Io { source, .. } if source.kind() == io::ErrorKind::Unsupported));
    let message = error.to_string();
    assert!(message.contains(&server.url()) && message.contains("range requests"), "{message}");
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let (_, server) = served(Manner::Nothing);
    let error = open_asset(Path::new(&server.url())).unwrap_err();
    let message = error.to_string();
    assert!(message.contains(&server.url()) && message.contains("404"), "{message}");
    assert_eq!(server.ranges().len(), 1, "a missing file was asked for again");
}

#[test]
fn broken_connections_and_busy_servers_are_asked_again() {
    for manner in [Manner::Drops, Manner::Busy] {
        let (baked, server) = served(manner);
        let asset = Arc::new(open_asset(Path::new(&server.url())).unwrap());
        let mut loader = ClusterLoader::open(asset, &quick()).unwrap();
        check_all(&mut loader, &baked.asset, true);
        assert!(loader.statistics().retries > 0, "{manner:?}");
    }
}

#[test]
fn a_server_that_goes_away_gives_errors_that_name_it() {
    let (baked, server) = served(Manner::Ranges);
    let url = server.url();
    let asset = Arc::new(open_asset(Path::new(&url)).unwrap());
    drop(server);
    let retry = Some(RetryPolicy { retries: 1, first_pause: Duration::from_millis(1) });
    let options = ClusterLoaderOptions { retry, ..ClusterLoaderOptions::default() };
    let mut loader = ClusterLoader::open(asset, &options).unwrap();
    for texels in load(&mut loader, &all_parcels(&baked.asset)[..20]).into_values() {
        let message = texels.unwrap_err().to_string();
        assert!(message.contains(&url), "{message}");
    }
}
