//! All back ends read what is there.

use std::collections::BTreeMap;
use std::io;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use fantex_bake::BakeFormat;
use fantex_store::{ByteSource, group_pages, io_cause};
use fantex_stream::read::{
    FileReadOptions, HttpSource, QueuedReader, ReadRequest, ReaderKind, RetryPolicy, http_reader,
    open_file_reader, ring_reader, threaded_reader,
};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, open_asset, open_preview};

use crate::{Baked, all_parcels, baked, check_all, load, with_preview};

/// A file of repeatable bytes, of a length that is a multiple of nothing.
fn some_file(folder: &Path) -> (std::path::PathBuf, Vec<u8>) {
    let path = folder.join("some.bytes");
    let bytes: Vec<u8> =
        (0..1_234_567u64).map(|i| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as u8).collect();
    std::fs::File::create(&path).unwrap().write_all(&bytes).unwrap();
    (path, bytes)
}

/// Reads many ranges at once, some beyond the end, and compares.
pub(crate) fn check_reader(reader: &mut dyn QueuedReader, bytes: &[u8]) {
    let length = bytes.len() as u64;
    let mut ranges = vec![(0, 0), (0, 1), (length - 1, 1), (length - 5000, 5000), (0, bytes.len())];
    ranges.extend([(length, 1), (length - 1, 2), (length + 5000, 10), (length - 4096, 8192)]);
    ranges.extend((0..300u64).map(|i| (i * 7919 % (length - 70_000), (i * 131 % 65_536) as usize)));
    for (token, &(offset, length)) in ranges.iter().enumerate() {
        reader.submit(ReadRequest { token: token as u64, offset, length });
    }
    let mut seen = BTreeMap::new();
    while seen.len() < ranges.len() {
        let completion = reader.wait(Some(Duration::from_secs(20))).expect("a read never completed");
        let (offset, count) = ranges[completion.token as usize];
        let expected = bytes.get(offset as usize..offset as usize + count);
        match (completion.result, expected) {
            (Ok(got), Some(expected)) => assert!(*got == *expected, "{offset} {count}"),
            (Err(error), None) => assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof, "{offset} {count}"),
            (got, expected) => {
                panic!("{offset} {count}: {:?}, {:?}", got.map(|b| b.len()), expected.is_some())
            }
        }
        assert!(seen.insert(completion.token, ()).is_none(), "{} came twice", completion.token);
    }
    assert!(reader.wait(Some(Duration::ZERO)).is_none());
}

#[test]
fn all_ways_read_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = some_file(folder.path());
    for depth in [1, 32] {
        for direct in [true, false] {
            for ring in [true, false] {
                let options = FileReadOptions { depth, direct, ring };
                let mut reader = open_file_reader(&path, &options).unwrap();
                eprintln!("{options:?}: {}", reader.info());
                assert_eq!(reader.info().depth, depth);
                assert!(ring || reader.info().kind == ReaderKind::Threads);
                check_reader(&mut *reader, &bytes);
                // Whoever paints on what is streamed finds it unread, and uses superseded room again.
                std::fs::File::open(&path).unwrap().try_lock().unwrap();
            }
        }
    }
}

#[test]
fn waiting_can_be_interrupted_and_limited() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = some_file(folder.path());
    let mut reader = open_file_reader(&path, &FileReadOptions::default()).unwrap();
    let waker = reader.waker();
    waker.wake();
    assert!(reader.wait(None).is_none());
    let begin = Instant::now();
    let thread = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(30));
        waker.wake();
    });
    assert!(reader.wait(Some(Duration::from_secs(60))).is_none());
    assert!(begin.elapsed() < Duration::from_secs(50));
    thread.join().unwrap();
    assert!(reader.wait(Some(Duration::from_millis(1))).is_none());
}

#[test]
fn cancelled_reads_never_complete_and_others_do() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = some_file(folder.path());
    for ring in [true, false] {
        let options = FileReadOptions { depth: 1, ring, ..FileReadOptions::default() };
        let mut reader = open_file_reader(&path, &options).unwrap();
        for token in 0..100 {
            reader.submit(ReadRequest { token, offset: 1000 * token, length: 60_000 });
        }
        let cancelled: Vec<bool> = (0..100).map(|token| reader.cancel(token)).collect();
        for _ in cancelled.iter().filter(|&&cancelled| !cancelled) {
            let completion = reader.wait(Some(Duration::from_secs(20))).unwrap();
            assert!(!cancelled[completion.token as usize]);
            let from = 1000 * completion.token as usize;
            assert_eq!(*completion.result.unwrap(), bytes[from..from + 60_000]);
        }
        assert!(reader.wait(Some(Duration::from_millis(20))).is_none());
    }
}

#[test]
fn what_is_not_there_is_an_error() {
    for ring in [true, false] {
        let options = FileReadOptions { ring, ..FileReadOptions::default() };
        let error = open_file_reader(Path::new("/nowhere/at.all"), &options).err().unwrap();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
    }
}

/// Files of /proc refuse direct I/O, and some memory file systems do.
#[test]
#[cfg(target_os = "linux")]
fn where_direct_reading_is_refused_reads_are_buffered() {
    let file = Path::new("/proc/version");
    let bytes = std::fs::read(file).unwrap();
    for ring in [true, false] {
        let options = FileReadOptions { ring, ..FileReadOptions::default() };
        let mut reader = open_file_reader(file, &options).unwrap();
        assert!(!reader.info().direct);
        reader.submit(ReadRequest { token: 5, offset: 3, length: 20 });
        assert_eq!(*reader.wait(None).unwrap().result.unwrap(), bytes[3..23]);
    }
    if !Path::new("/dev/shm").is_dir() {
        fantex_test::skip("no /dev/shm");
        return;
    }
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    let (path, bytes) = some_file(folder.path());
    let mut reader = open_file_reader(&path, &FileReadOptions::default()).unwrap();
    eprintln!("/dev/shm: {}", reader.info());
    check_reader(&mut *reader, &bytes);
    // A reader that was promised direct I/O and is refused it falls back, read by read, or says so when it opens.
    if let Ok(mut reader) = threaded_reader(&path, 4, true) {
        check_reader(&mut reader, &bytes);
    }
    if let Ok(mut reader) = ring_reader(&path, 4, true) {
        check_reader(&mut reader, &bytes);
    }
}

// Assets on a web server.

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
    // Four sections, each of which begins at a multiple of 8.
    let sections = ranges[1].1 + 1 - 8192;
    assert!((0..32).contains(&(sections - asset.head_bytes())), "{sections} of {}", asset.head_bytes());
    assert!(asset.mesh() == baked.asset.mesh() && asset.cover() == baked.asset.cover());
    let mut loader = ClusterLoader::open(Arc::clone(&asset), &quick()).unwrap();
    assert_eq!(loader.reader_info().kind, ReaderKind::Http);
    check_all(&mut loader, &baked.asset, true);
    let counts = loader.statistics();
    assert_eq!(server.ranges().len() as u64, 2 + counts.reads);
    assert!(counts.reads < counts.clusters_read, "{counts:?}");
}

/// See "What is read, in which order" in docs/format.md.
#[test]
fn the_first_request_tells_where_everything_is() {
    let baked = baked(BakeFormat::Bc7);
    let preview_bytes = with_preview(&baked).bytes.len() as u64;
    let server = Server::start(std::fs::read(&baked.path).unwrap(), Manner::Ranges);
    let url = server.url();
    let length = |(first, last): (u64, u64)| last + 1 - first;

    // The header, which names the list of attachments; the list, which names the preview; the preview.
    let preview = open_preview(Path::new(&url)).unwrap().unwrap();
    for (index, group) in preview.cover().groups.iter().enumerate() {
        for page in group_pages(index as u32, group) {
            preview.read_page(0, page).unwrap();
        }
    }
    let ranges = server.ranges();
    assert_eq!(ranges.len(), 3, "{ranges:?}");
    assert_eq!(ranges[0], (0, 8191));
    let [list, stored] = [length(ranges[1]), length(ranges[2])];
    assert!(list < 200, "a list of one attachment: {list}");
    // It is packed already.
    assert!(stored < preview_bytes + preview_bytes / 100 + 200, "{stored} of {preview_bytes}");

    // The header, sections as they lie together, the list. A commit has written directory and list anew.
    let asset = open_asset(Path::new(&url)).unwrap();
    let ranges = server.ranges().split_off(3);
    assert_eq!(ranges[0], (0, 8191));
    assert_eq!(ranges[1].0, 8192);
    assert_eq!(length(*ranges.last().unwrap()), list);
    assert!((3..=4).contains(&ranges.len()), "{ranges:?}");
    let bytes: u64 = ranges.into_iter().map(length).sum();
    let most = 8192 + asset.head_bytes() + list + (64 << 10);
    assert!(bytes <= most && most < baked.asset.file_bytes() / 2, "{bytes}, {most}");
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
fn long_reads_are_made_over_several_connections() {
    let bytes: Vec<u8> = (0..18_u32 << 20).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let server = Server::start(bytes.clone(), Manner::Ranges);
    let source = HttpSource::new(&server.url(), 3);
    let mut read = vec![0; bytes.len()];
    source.read_exact_at(&mut read, 0).unwrap();
    assert!(read == bytes);
    // Beyond the end there is nothing.
    assert_eq!(source.read_at(&mut read, 10 << 20).unwrap(), 8 << 20);
    assert!(read[..8 << 20] == bytes[10 << 20..]);
}

#[test]
fn a_server_without_ranges_is_refused_with_a_reason() {
    let (_, server) = served(Manner::WholeFiles);
    let error = open_asset(Path::new(&server.url())).unwrap_err();
    assert_eq!(io_cause(&error).unwrap().kind(), io::ErrorKind::Unsupported);
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
fn what_a_server_sends_piece_by_piece_is_put_together() {
    let bytes: Vec<u8> = (0..200_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let server = Server::start(bytes.clone(), Manner::Short);
    let source = Arc::new(HttpSource::new(&server.url(), 2));
    let mut read = vec![0; 203_000];
    assert_eq!(source.read_at(&mut read[..], 0).unwrap(), 200_000);
    assert!(read[..200_000] == bytes);
    assert_eq!(source.read_at(&mut read[..7000], 40_000).unwrap(), 7000);
    assert!(read[..7000] == bytes[40_000..47_000]);
    assert_eq!(source.length().unwrap(), 200_000);
    check_reader(&mut http_reader(source, 2).unwrap(), &bytes);
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

#[test]
fn a_file_that_changes_on_the_server_is_opened_anew() {
    let (baked, server) = served(Manner::Changes);
    let source = HttpSource::new(&server.url(), 1);
    let mut bytes = [0; 64];
    source.read_exact_at(&mut bytes, 0).unwrap();
    source.read_exact_at(&mut bytes, 64).unwrap();
    let error = source.read_exact_at(&mut bytes, 128).unwrap_err();
    assert!(error.to_string().contains("has changed since it was opened"), "{error}");
    assert_eq!(server.ranges().len(), 3, "it was asked for again");
    let again = HttpSource::new(&server.url(), 1);
    again.read_exact_at(&mut bytes, 128).unwrap();
    assert_eq!(again.length().unwrap(), baked.asset.file_bytes());
    // Two requests open the asset, and its texels are of another version.
    let server = Server::start(std::fs::read(&baked.path).unwrap(), Manner::Changes);
    let asset = Arc::new(open_asset(Path::new(&server.url())).unwrap());
    let mut loader = ClusterLoader::open(asset, &quick()).unwrap();
    for texels in load(&mut loader, &all_parcels(&baked.asset)[..5]).into_values() {
        let error = texels.unwrap_err();
        assert!(error.to_string().contains("has changed since it was opened"), "{error}");
    }
}

#[test]
fn redirects_lead_to_web_addresses_only() {
    let (_, server) = served(Manner::Redirects);
    let error = open_asset(Path::new(&server.url())).unwrap_err();
    assert!(error.to_string().contains("redirects to file:///etc/passwd"), "{error}");
}

#[test]
fn a_server_that_dribbles_is_given_up() {
    let (_, server) = served(Manner::Dribbles);
    let source = HttpSource::with_request_time(&server.url(), 1, Duration::from_millis(200));
    let error = source.read_at(&mut [0; 4096], 0).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::TimedOut, "{error}");
}

// A web server of one file, written for these tests.

/// How the server behaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Manner {
    /// Answers ranges.
    Ranges,
    /// Knows no ranges.
    WholeFiles,
    /// Breaks every third connection in the middle of an answer.
    Drops,
    /// Answers every third request with "503 Service Unavailable".
    Busy,
    /// Has no such file.
    Nothing,
    /// Has another version of the file from the third request on.
    Changes,
    /// Sends everybody to a file of the reader's own system.
    Redirects,
    /// Sends a byte now and then.
    Dribbles,
    /// Sends 5000 bytes at most at once, and tells the file's length at its end only.
    Short,
}

struct Site {
    manner: Manner,
    bytes: Vec<u8>,
    ranges: Mutex<Vec<(u64, u64)>>,
    requests: AtomicU64,
    closed: AtomicBool,
}

/// Serves a file until it is dropped.
pub(crate) struct Server {
    site: Arc<Site>,
    port: u16,
    listener: Option<JoinHandle<()>>,
}

impl Server {
    pub(crate) fn start(bytes: Vec<u8>, manner: Manner) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let site = Arc::new(Site {
            manner,
            bytes,
            ranges: Mutex::default(),
            requests: AtomicU64::new(0),
            closed: AtomicBool::new(false),
        });
        let shared = Arc::clone(&site);
        let listener = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if shared.closed.load(Ordering::SeqCst) {
                    return;
                }
                let site = Arc::clone(&shared);
                // Ends when the client closes the connection.
                std::thread::spawn(move || site.serve(stream.unwrap()).unwrap_or_default());
            }
        });
        Self { site, port, listener: Some(listener) }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://127.0.0.1:{}/torus.fan", self.port)
    }

    /// First and last bytes that were asked for so far.
    pub(crate) fn ranges(&self) -> Vec<(u64, u64)> {
        self.site.ranges.lock().unwrap().clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.site.closed.store(true, Ordering::SeqCst);
        // One last connection, so that the listener looks.
        drop(TcpStream::connect(("127.0.0.1", self.port)));
        self.listener.take().unwrap().join().unwrap();
    }
}

impl Site {
    /// Answers the requests of a connection, one after the other.
    fn serve(&self, stream: TcpStream) -> std::io::Result<()> {
        stream.set_nodelay(true)?;
        let mut input = BufReader::new(stream.try_clone()?);
        let mut output = stream;
        loop {
            let mut range = None;
            let mut line = String::new();
            if input.read_line(&mut line)? == 0 {
                return Ok(());
            }
            loop {
                line.clear();
                if input.read_line(&mut line)? == 0 || line == "\r\n" {
                    break;
                }
                let lower = line.trim().to_ascii_lowercase();
                if let Some(bytes) = lower.strip_prefix("range: bytes=") {
                    let (first, last) = bytes.split_once('-').unwrap();
                    range = Some((first.parse::<u64>().unwrap(), last.parse::<u64>().unwrap()));
                }
            }
            self.ranges.lock().unwrap().extend(range);
            let is_third = self.requests.fetch_add(1, Ordering::SeqCst) % 3 == 2;
            if self.closed.load(Ordering::SeqCst) || !self.answer(&mut output, range, is_third)? {
                return Ok(());
            }
        }
    }

    /// Answers one request. False where the connection ends with it.
    fn answer(
        &self,
        output: &mut TcpStream,
        range: Option<(u64, u64)>,
        is_third: bool,
    ) -> std::io::Result<bool> {
        let length = self.bytes.len() as u64;
        if self.manner == Manner::Nothing {
            output.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")?;
            return Ok(true);
        }
        if self.manner == Manner::Busy && is_third {
            output.write_all(b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n\r\n")?;
            return Ok(true);
        }
        if self.manner == Manner::Redirects {
            output.write_all(
                b"HTTP/1.1 302 Found\r\nLocation: file:///etc/passwd\r\nContent-Length: 0\r\n\r\n",
            )?;
            return Ok(true);
        }
        let Some((first, last)) = range.filter(|_| self.manner != Manner::WholeFiles) else {
            write!(output, "HTTP/1.1 200 OK\r\nContent-Length: {length}\r\n\r\n")?;
            output.write_all(&self.bytes)?;
            return Ok(true);
        };
        if first >= length {
            write!(
                output,
                "HTTP/1.1 416 Range Not Satisfiable\r\nContent-Range: bytes */{length}\r\nContent-Length: 0\r\n\r\n"
            )?;
            return Ok(true);
        }
        let most = if self.manner == Manner::Short { first + 4999 } else { last };
        let last = last.min(length - 1).min(most);
        let is_told = self.manner != Manner::Short || last + 1 == length;
        let told = if is_told { length.to_string() } else { "*".to_owned() };
        let body = &self.bytes[first as usize..=last as usize];
        write!(
            output,
            "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes {first}-{last}/{told}\r\nContent-Length: {}\r\n",
            body.len()
        )?;
        if self.manner == Manner::Changes {
            let is_later = self.requests.load(Ordering::SeqCst) > 2;
            write!(output, "ETag: \"{}\"\r\n", if is_later { "b" } else { "a" })?;
        }
        output.write_all(b"\r\n")?;
        if self.manner == Manner::Dribbles {
            for byte in body {
                output.write_all(&[*byte])?;
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        let drops = self.manner == Manner::Drops && is_third;
        output.write_all(if drops { &body[..body.len() / 2] } else { body })?;
        Ok(!drops)
    }
}
