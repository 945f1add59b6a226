//! All back ends read what is there.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use fantex_stream::read::{
    FileReadOptions, QueuedReader, ReadRequest, ReaderKind, RingReader, ThreadedReader, open_file_reader,
};

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
        eprintln!("SKIPPED: no /dev/shm");
        return;
    }
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    let (path, bytes) = some_file(folder.path());
    let mut reader = open_file_reader(&path, &FileReadOptions::default()).unwrap();
    eprintln!("/dev/shm: {}", reader.info());
    check_reader(&mut *reader, &bytes);
    // A reader that was promised direct I/O and is refused it falls back, read by read, or says so when it opens.
    if let Ok(mut reader) = ThreadedReader::open(&path, 4, true) {
        check_reader(&mut reader, &bytes);
    }
    if let Ok(mut reader) = RingReader::open(&path, 4, true) {
        check_reader(&mut reader, &bytes);
    }
}
