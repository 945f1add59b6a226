//! Without threads: what a web page does, with tasks that are run between polls.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::future::{Future, poll_fn};
use std::io;
use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use fantex_bake::BakeFormat;
use fantex_store::BytesSource;
use fantex_stream::read::{
    Fetched, FetchedFile, ReadRequest, ReaderInfo, ReaderKind, RetryPolicy, Task, first_ranges, task_reader,
};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, Parcel, ParcelLoader, ParcelTexels, open_fetched};
use ruzstd::decoding::FrameDecoder;

use crate::{Baked, all_parcels, baked, expected, with_preview};

const INFO: ReaderInfo = ReaderInfo { kind: ReaderKind::Http, direct: false, depth: 6 };

/// Not ready the first `times` times that it is looked at.
async fn pause(times: u32) {
    let mut left = times;
    poll_fn(|_| {
        left = left.saturating_sub(1);
        if left == 0 { Poll::Ready(()) } else { Poll::Pending }
    })
    .await;
}

fn run_to_end<T>(future: impl Future<Output = T>) -> T {
    let mut future = Box::pin(future);
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return value;
        }
    }
}

/// Tasks that have not ended; each is looked at once per turn.
#[derive(Clone, Default)]
struct Tasks(Rc<RefCell<Vec<Task>>>);

impl Tasks {
    fn turn(&self) {
        let mut context = Context::from_waker(Waker::noop());
        self.0.borrow_mut().retain_mut(|task| task.as_mut().poll(&mut context).is_pending());
    }
}

/// The bytes of a range, or those up to the end.
fn part(file: &[u8], range: Range<u64>) -> &[u8] {
    &file[(range.start as usize).min(file.len())..(range.end as usize).min(file.len())]
}

fn load_all(loader: &mut ClusterLoader, tasks: &Tasks, parcels: &[Parcel]) -> BTreeMap<Parcel, ParcelTexels> {
    for (i, &parcel) in parcels.iter().enumerate() {
        loader.request(parcel, (i % 17) as f32);
    }
    let deadline = Instant::now() + fantex_test::PATIENCE;
    let mut arrived = BTreeMap::new();
    while loader.pending() > 0 {
        assert!(Instant::now() < deadline, "{:?}", loader.statistics());
        tasks.turn();
        for loaded in loader.poll(1 << 20) {
            assert!(arrived.insert(loaded.parcel, loaded.texels.unwrap()).is_none(), "twice");
        }
    }
    arrived
}

#[test]
fn an_asset_is_opened_and_loaded_without_a_thread() {
    let baked = baked(BakeFormat::Bc7);
    let file: Arc<[u8]> = std::fs::read(&baked.path).unwrap().into();
    let fetches = RefCell::new(Vec::new());
    let asset = run_to_end(open_fetched("http://a.org/torus.fan", async |range: Range<u64>| {
        pause(3).await;
        fetches.borrow_mut().push(range.clone());
        Ok(Fetched { bytes: part(&file, range).to_vec(), total: Some(file.len() as u64) })
    }));
    let asset = Arc::new(asset.unwrap());
    assert_eq!(asset.path().to_str(), Some("http://a.org/torus.fan"));
    assert_eq!(fetches.borrow()[0].start, 0);
    assert!(fetches.borrow().len() <= 2, "{fetches:?}");
    let ahead = first_ranges(&BytesSource::new("torus.fan", Arc::clone(&file))).unwrap();
    assert_eq!(ahead, *fetches.borrow());
    let fetched: u64 = fetches.borrow().iter().map(|range| range.end - range.start).sum();
    assert!(fetched < file.len() as u64 / 2, "{fetched} bytes fetched before any texel");

    let tasks = Tasks::default();
    // Every fifth read fails for now.
    let (reads, failures) = (Rc::new(Cell::new(0_u32)), Rc::new(Cell::new(0)));
    let spawned = tasks.clone();
    let reader = {
        let (reads, failures) = (reads.clone(), failures.clone());
        task_reader(
            INFO,
            move |task| spawned.0.borrow_mut().push(task),
            move |request: ReadRequest| {
                let (file, failures) = (file.clone(), failures.clone());
                reads.set(reads.get() + 1);
                let number = reads.get();
                async move {
                    pause(number % 4).await;
                    if number.is_multiple_of(5) {
                        failures.set(failures.get() + 1);
                        return Err(io::ErrorKind::ConnectionReset.into());
                    }
                    Ok(part(&file, request.offset..request.offset + request.length as u64).to_vec())
                }
            },
        )
    };
    let options = ClusterLoaderOptions {
        block_compressed: false,
        merge_bytes: 64 << 10,
        retry: Some(RetryPolicy { retries: 20, first_pause: Duration::from_micros(10) }),
        ..ClusterLoaderOptions::default()
    };
    // So short a slice that each poll carries out one order.
    let mut loader = ClusterLoader::without_threads(asset, Box::new(reader), &options, Duration::ZERO);
    let parcels = all_parcels(&baked.asset);
    let arrived = load_all(&mut loader, &tasks, &parcels);
    assert_eq!(arrived.len(), parcels.len());
    for (parcel, texels) in arrived {
        assert!(texels == expected(&baked.asset, parcel, false), "{parcel}");
    }
    assert!(failures.get() > 0 && loader.statistics().retries >= failures.get());
    drop(loader);
    tasks.turn();
    assert!(tasks.0.borrow().is_empty(), "lanes end with their reader");
}

/// See "What is read, in which order" in docs/format.md.
#[test]
fn a_page_asks_for_64_kib_first_then_for_the_preview_then_for_the_rest() {
    let baked = baked(BakeFormat::Bc7);
    let preview_bytes = with_preview(&baked).bytes.len() as u64;
    let file = std::fs::read(&baked.path).unwrap();
    let fetches = RefCell::new(Vec::new());
    let lengths =
        || fetches.borrow().iter().map(|range: &Range<u64>| range.end - range.start).collect::<Vec<_>>();
    let start = run_to_end(FetchedFile::start("http://a.org/torus.fan", async |range: Range<u64>| {
        fetches.borrow_mut().push(range.clone());
        Ok(Fetched { bytes: part(&file, range).to_vec(), total: Some(file.len() as u64) })
    }));
    let start = start.unwrap();
    assert_eq!(lengths(), [64 << 10]);
    let preview = run_to_end(start.preview()).unwrap().unwrap();
    assert!(preview.mesh().triangles.len() < baked.asset.mesh().triangles.len() / 2);
    let seen = lengths();
    let ahead = first_ranges(&BytesSource::new("torus.fan", file.clone())).unwrap();
    assert_eq!(ahead, *fetches.borrow());
    assert!(
        seen.len() <= 3 && seen[1..].iter().sum::<u64>() < preview_bytes + preview_bytes / 100 + 400,
        "{seen:?}"
    );
    let asset = run_to_end(start.asset()).unwrap();
    let all = lengths();
    let rest = &all[seen.len()..];
    // Sections as they lie together, but for what is there already.
    assert!(rest.len() <= 2 && rest.iter().sum::<u64>() <= asset.head_bytes() + (64 << 10), "{rest:?}");
}

/// In WebAssembly `fantex_base::zstandard` calls the decoder that is called here.
#[test]
fn the_decoder_of_web_pages_unpacks_every_cluster() {
    for format in [BakeFormat::Bc7, BakeFormat::Bc1, BakeFormat::Rgba8, BakeFormat::Float] {
        let Baked { path, asset, folder: _folder } = baked(format);
        let file = std::fs::read(path).unwrap();
        let mut decoder = FrameDecoder::new();
        let mut seconds = [0.0; 2];
        for cluster in asset.clusters() {
            let stored = part(&file, asset.cluster_range(cluster));
            let bytes = asset.cluster_page_bytes(cluster);
            let begin = Instant::now();
            let expected = zstd::bulk::decompress(stored, bytes).unwrap();
            let between = Instant::now();
            let mut unpacked = vec![0; bytes];
            assert_eq!(decoder.decode_all(stored, &mut unpacked).unwrap(), bytes);
            seconds[0] += (between - begin).as_secs_f64();
            seconds[1] += between.elapsed().as_secs_f64();
            assert!(unpacked == expected, "{cluster:?}");
        }
        println!("{format:?}: {:.1} times as long as the C library", seconds[1] / seconds[0]);
    }
}

#[test]
fn what_is_cancelled_does_not_come_and_a_short_answer_is_an_error() {
    let baked = baked(BakeFormat::Bc7);
    let tasks = Tasks::default();
    let spawned = tasks.clone();
    let reader = task_reader(
        INFO,
        move |task| spawned.0.borrow_mut().push(task),
        |request: ReadRequest| std::future::ready(Ok(vec![0; request.length / 2])),
    );
    let mut loader = ClusterLoader::without_threads(
        baked.asset.clone(),
        Box::new(reader),
        &ClusterLoaderOptions::default(),
        Duration::from_millis(1),
    );
    let parcels = all_parcels(&baked.asset);
    loader.request_all(&[(parcels[0], 1.0), (parcels[1], 2.0)]);
    loader.cancel(parcels[0]);
    let deadline = Instant::now() + fantex_test::PATIENCE;
    let mut arrived = Vec::new();
    while loader.pending() > 0 && Instant::now() < deadline {
        tasks.turn();
        arrived.extend(loader.poll(usize::MAX));
    }
    assert_eq!(arrived.len(), 1);
    assert_eq!(arrived[0].parcel, parcels[1]);
    assert!(arrived[0].texels.is_err());
}

#[test]
fn opening_says_what_went_wrong() {
    let baked = baked(BakeFormat::Bc7);
    let file = std::fs::read(&baked.path).unwrap();
    let open = |bytes: &[u8], error: Option<io::ErrorKind>| {
        let result = run_to_end(open_fetched("http://a.org/x.fan", async |range: Range<u64>| match error {
            Some(kind) => Err(kind.into()),
            None => Ok(Fetched { bytes: part(bytes, range).to_vec(), total: Some(bytes.len() as u64) }),
        }));
        result.unwrap_err().to_string()
    };
    assert!(open(b"<html>", None).contains("not a .fan asset"), "{}", open(b"<html>", None));
    assert!(open(&file[..file.len() / 2], None).contains("truncated"));
    assert!(open(&file[..9000], None).contains("truncated"));
    assert!(open(&file, Some(io::ErrorKind::NotFound)).contains("http://a.org/x.fan"));
    let mut damaged = file.clone();
    damaged[8200] ^= 1;
    assert!(open(&damaged, None).contains("checksum"));
    // A server that lies about how long the file is.
    let result = run_to_end(open_fetched("x.fan", async |range: Range<u64>| {
        Ok(Fetched { bytes: part(&file, range.start..range.end.min(9000)).to_vec(), total: None })
    }));
    assert!(result.unwrap_err().to_string().contains("less than was asked for"));
}
