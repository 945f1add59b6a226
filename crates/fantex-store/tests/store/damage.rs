//! No file, however damaged or crafted, makes the reader panic, allocate without bounds or return garbage.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_base::{Error, ErrorKind};
use fantex_store::{
    Asset, PageCache, TileId, TileSource, TileTexels, VerifyOptions, VerifyReport, verify_asset,
};
use fantex_test::fan_file::{seal, section, set_word, with_section};
use glam::Vec2;

use crate::common::{Dice, block_channels, fan_cover, pages, tetrahedron, write};

/// Counts the largest allocation of each thread.
struct Counting;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

#[expect(unsafe_code, reason = "an allocator is unsafe to implement; this one only counts and passes on")]
// SAFETY: all calls go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // Fails only while the thread ends.
        LARGEST.try_with(|largest| largest.set(largest.get().max(layout.size()))).unwrap_or_default();
        // SAFETY: the caller's promises are those that the system's allocator asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Far above what the small test file needs, far below what its patched counts claim.
const MAX_ALLOCATION: usize = 32 << 20;

/// A small asset: its path and bytes.
fn small_asset(folder: &Path) -> (PathBuf, Vec<u8>) {
    let path = folder.join("small.fan");
    let mesh = tetrahedron();
    let cover = fan_cover(&mesh, |v| [[8, 8], [12, 4], [4, 4], [20, 8]][v]);
    write(&path, &mesh, &cover, &block_channels(), 100).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (path, bytes)
}

/// Opens a file and reads all of it in every way. Fails the test where it panics or allocates too much.
fn use_all(path: &Path) -> Result<(Arc<Asset>, VerifyReport), Error> {
    LARGEST.set(0);
    let asset = Asset::open(path);
    assert!(LARGEST.get() < MAX_ALLOCATION, "{} bytes at once", LARGEST.get());
    let asset = Arc::new(asset?);
    assert!((0.0..=1.0).contains(&asset.gap_share()) && asset.used_bytes() > 0);
    let cache = PageCache::new(Arc::clone(&asset), 1 << 20);
    for id in pages(asset.cover()).take(64) {
        for channel in 0..asset.channels().len() {
            let read = asset.read_page(channel, id);
            assert!(read.is_ok() == asset.read_page_raw(channel, id).is_ok());
            let tile = TileId { group: id.group, level: id.level };
            let value = cache.tile(channel, tile).bilinear(Vec2::new(0.3, 0.7));
            assert!(value.iter().all(|x| x.is_finite()));
        }
    }
    let report = verify_asset(&asset, &VerifyOptions { memory_bytes: 1 << 20, ..VerifyOptions::default() });
    Ok((asset, report))
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    let cut = folder.path().join("cut.fan");
    assert!(Asset::open(&path).is_ok());
    std::fs::write(&cut, &bytes).unwrap();
    for length in (0..bytes.len()).rev() {
        std::fs::OpenOptions::new().write(true).open(&cut).unwrap().set_len(length as u64).unwrap();
        let error = Asset::open(&cut).unwrap_err();
        let expected = if length >= 256 { "is truncated" } else { "is not a .fan asset" };
        assert!(error.to_string().contains(expected), "{length} bytes: {error}");
    }
}

#[test]
fn flipped_bits_are_noticed_or_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    let (whole, report) = use_all(&path).unwrap();
    assert!(report.ok);
    let damaged_path = folder.path().join("damaged.fan");
    let mut random = Dice::new(0x5eed);
    let (mut refused, mut reported, mut harmless) = (0, 0, 0);
    for _ in 0..4000 {
        let mut damaged = bytes.clone();
        for _ in 0..=random.below(3) {
            damaged[random.below(bytes.len())] ^= 1 << random.below(8);
        }
        std::fs::write(&damaged_path, &damaged).unwrap();
        match use_all(&damaged_path) {
            Err(_) => refused += 1,
            Ok((_, report)) if !report.ok => reported += 1,
            Ok((asset, _)) => {
                harmless += 1;
                assert!(asset.mesh() == whole.mesh() && asset.cover() == whole.cover());
                for id in pages(whole.cover()) {
                    assert_eq!(asset.read_page(0, id).unwrap(), whole.read_page(0, id).unwrap());
                }
            }
        }
    }
    // Most of so small a file is padding up to multiples of 4096.
    assert!(refused > 0 && reported > 0 && harmless > 0, "{refused} {reported} {harmless}");
}

#[test]
fn a_file_with_an_appended_section_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    for index in 0..4 {
        std::fs::write(&path, with_section(&bytes, index, &section(&bytes, index))).unwrap();
        assert!(use_all(&path).unwrap().1.ok);
    }
}

/// Checksums are right, contents are not: what an attacker would make.
#[test]
fn crafted_sections_are_refused_or_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    let mut random = Dice::new(0xc4af7ed);
    let interesting = [
        0,
        1,
        2,
        3,
        5,
        0x7f,
        0x80,
        0xff,
        0xffff,
        0x7f80_0000,
        0x7fc0_0000,
        0x7fff_ffff,
        0x8000_0000,
        u32::MAX,
    ];
    for index in 0..4 {
        let raw = section(&bytes, index);
        let mut refused = 0;
        for _ in 0..1500 {
            let mut changed = raw.clone();
            for _ in 0..=random.below(2) {
                match random.below(4) {
                    0 => changed[random.below(raw.len())] = random.below(256) as u8,
                    1 => changed.truncate(random.below(raw.len()).max(8)),
                    _ => {
                        let at = random.below(raw.len()) & !3;
                        let value = interesting[random.below(interesting.len())].to_le_bytes();
                        for (byte, value) in changed.iter_mut().skip(at).zip(value) {
                            *byte = value;
                        }
                    }
                }
                changed.resize(raw.len().max(8).min(changed.len().max(8)), 0);
                if changed.len() < raw.len() {
                    break;
                }
            }
            std::fs::write(&path, with_section(&bytes, index, &changed)).unwrap();
            if use_all(&path).is_err() {
                refused += 1;
            }
        }
        assert!(refused > 100, "section {index}: {refused}");
    }
}

/// Every 32-bit word of every section, and every word of the header, set to the greatest values.
#[test]
fn huge_counts_allocate_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    for index in 0..4 {
        let raw = section(&bytes, index);
        for at in (0..raw.len() - 3).step_by(4).take(64) {
            for value in [u32::MAX, 1 << 30, 1 << 24] {
                let mut changed = raw.clone();
                changed[at..at + 4].copy_from_slice(&value.to_le_bytes());
                std::fs::write(&path, with_section(&bytes, index, &changed)).unwrap();
                // Words of texel means may be anything.
                drop(use_all(&path));
            }
        }
    }
    for at in (8..192).step_by(8) {
        for value in [u64::MAX, 1 << 63, 1 << 40, (1 << 32) - 1] {
            let mut changed = bytes.clone();
            for slot in [0, 4096] {
                set_word(&mut changed, slot + at, value);
            }
            seal(&mut changed);
            std::fs::write(&path, &changed).unwrap();
            let result = use_all(&path);
            // The generation may be anything; of attachments, which there are none of, only the list is damaged.
            assert_eq!(result.is_ok(), at == 16 || at >= 160, "word at {at}, {value:#x}");
        }
    }
}

/// A section that unpacks to a thousand times its size and more is refused as it is, and accepted as writers lengthen it.
#[test]
fn bombs_are_refused_but_honest_repetition_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    std::fs::write(&path, with_section(&bytes, 2, &vec![0; 1 << 28])).unwrap();
    let error = use_all(&path).unwrap_err();
    assert!(error.to_string().contains("its mesh section does not unpack to"), "{error}");

    // Triangles between the same few vertices: their differences repeat.
    let mut mesh = tetrahedron();
    mesh.triangles = mesh.triangles.repeat(400_000);
    let mut cover = fan_cover(&mesh, |_| [4, 4]);
    for group in &mut cover.groups {
        group.kind = fantex_cover::GroupKind::Projected;
    }
    cover.unfolded = fantex_cover::UnfoldedCorners::default();
    write(&path, &mesh, &cover, &block_channels(), 100).unwrap();
    let length = std::fs::metadata(&path).unwrap().len();
    assert!(length < 200_000, "{length} bytes: it did not pack as well as this test needs");
    assert_eq!(Asset::open(&path).unwrap().mesh(), &mesh);
}

fn open_error(path: &Path) -> Error {
    Asset::open(path).unwrap_err()
}

#[test]
fn other_files_are_named_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bytes) = small_asset(folder.path());
    std::fs::write(&path, vec![b'x'; 10_000]).unwrap();
    assert!(open_error(&path).to_string().contains("is not a .fan asset"));
    std::fs::write(&path, "").unwrap();
    assert!(open_error(&path).to_string().contains("is not a .fan asset"));
    assert_eq!(open_error(folder.path()).kind(), ErrorKind::Io);
    assert_eq!(open_error(&folder.path().join("no.fan")).kind(), ErrorKind::NotFound);
    let mut later = bytes;
    for slot in [0, 4096] {
        later[slot + 8] = 2;
    }
    seal(&mut later);
    std::fs::write(&path, &later).unwrap();
    let error = Asset::open(&path).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Unsupported);
    assert!(error.to_string().contains("small.fan has format version 2"), "{error}");
}
