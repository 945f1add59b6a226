//! A photograph at several sizes, in pages.
//!
//! Level `l` has a texel for every `2^l` by `2^l` pixels, so positions differ by exactly that factor; the last texels of a row or
//! column may stand for fewer. Levels finer than what is asked for are not kept. Colours are means in linear light, weighted
//! by alpha, which says how much of a texel is to be used: that of the image, if it has any, times that of its mask, if it has one.

use std::cell::RefCell;
use std::fs::File;
use std::io;
use std::ops::Deref;
use std::path::PathBuf;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, OnceLock};

use fantex_store::{read_exact_at, write_all_at};
use fantex_texture::color::{linear_from_srgb8_table, srgb8_from_linear};
use fantex_texture::filter::halved_row;
use fantex_texture::{Image, Samples};
use glam::{DVec2, Vec2, Vec4};
use half::f16;
use quick_cache::Weighter;
use quick_cache::sync::Cache;

use crate::view::Mask;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    /// Four bytes, colours sRGB-encoded: of images with 8 bits.
    Srgb8,
    /// Four half floats, linear: of all others.
    Half,
}

impl Encoding {
    fn bytes(self) -> usize {
        match self {
            Self::Srgb8 => 4,
            Self::Half => 8,
        }
    }

    /// The linear value of the texel that begins at a byte; white-black-transparent beyond the end.
    #[inline]
    fn decode(self, bytes: &[u8]) -> Vec4 {
        match (self, bytes) {
            (Self::Srgb8, &[r, g, b, a, ..]) => {
                let table = linear_from_srgb8_table();
                let [r, g, b] = [r, g, b].map(|c| table[usize::from(c)]);
                Vec4::new(r, g, b, f32::from(a) / 255.0)
            }
            (Self::Half, &[r0, r1, g0, g1, b0, b1, a0, a1, ..]) => {
                let [r, g, b, a] =
                    [[r0, r1], [g0, g1], [b0, b1], [a0, a1]].map(|c| f16::from_le_bytes(c).to_f32());
                Vec4::new(r, g, b, a)
            }
            _ => Vec4::ZERO,
        }
    }

    fn encode(self, value: Vec4, out: &mut Vec<u8>) {
        match self {
            Self::Srgb8 => {
                out.extend(value.truncate().to_array().map(srgb8_from_linear));
                out.push((value.w * 255.0 + 0.5) as u8);
            }
            Self::Half => out.extend(value.to_array().iter().flat_map(|&c| f16::from_f32(c).to_le_bytes())),
        }
    }
}

struct Texels {
    extent: [u32; 2],
    encoding: Encoding,
    bytes: Vec<u8>,
}

impl Texels {
    fn at(&self, x: u32, y: u32) -> Vec4 {
        let texel = y as usize * self.extent[0] as usize + x as usize;
        self.encoding.decode(&self.bytes[texel * self.encoding.bytes()..])
    }

    fn of(extent: [u32; 2], encoding: Encoding, value: impl Fn(u32, u32) -> Vec4) -> Self {
        let mut bytes = Vec::with_capacity(extent[0] as usize * extent[1] as usize * encoding.bytes());
        for y in 0..extent[1] {
            for x in 0..extent[0] {
                encoding.encode(value(x, y), &mut bytes);
            }
        }
        Self { extent, encoding, bytes }
    }

    /// Half as large: means of up to four texels.
    fn halved(extent: [u32; 2], encoding: Encoding, finer: impl Fn(u32, u32) -> Vec4) -> Self {
        let coarse = extent.map(|n| n.div_ceil(2));
        let mut bytes = Vec::with_capacity(coarse[0] as usize * coarse[1] as usize * encoding.bytes());
        let row = |y: u32| -> Vec<Vec4> {
            let columns = 0..if y < extent[1] { extent[0] } else { 0 };
            columns.map(|x| finer(x, y)).map(|value| (value.truncate() * value.w).extend(value.w)).collect()
        };
        for y in 0..coarse[1] {
            let (upper, lower) = (row(2 * y), row(2 * y + 1));
            let sums = halved_row(&upper, &lower, Vec4::ZERO, |four| four.into_iter().sum());
            let rows = (extent[1] - 2 * y).min(2);
            for (x, sum) in (0..).zip(sums) {
                encoding.encode(straight(sum, ((extent[0] - 2 * x).min(2) * rows) as f32), &mut bytes);
            }
        }
        Self { extent: coarse, encoding, bytes }
    }
}

/// From a sum of colours times alpha.
fn straight(sum: Vec4, weight: f32) -> Vec4 {
    match sum.w > 0.0 {
        true => (sum.truncate() / sum.w).extend(sum.w / weight),
        false => Vec4::ZERO,
    }
}

#[derive(Debug)]
struct Level {
    extent: [u32; 2],
    columns: u32,
    /// Nothing where no surface is seen.
    pages: Vec<Option<Stored>>,
}

#[derive(Debug)]
pub(crate) struct Pyramid {
    /// Pixels of the photograph.
    pub(crate) size: [u32; 2],
    encoding: Encoding,
    /// The level that comes first in `levels`.
    finest: u32,
    levels: Vec<Level>,
}

/// A rectangle of pixels: low and high corner.
pub(crate) type PixelRect = [DVec2; 2];

/// Texels beside a page that look-ups around it may reach.
const REACH: f64 = 4.0;
/// Most probes of a look-up along a side of its footprint.
const MAX_PROBES: f32 = 16.0;

impl Pyramid {
    /// Cuts a photograph with its mask into pages, from the level `finest` on; only pages are kept that `is_seen` says something is seen in.
    pub(crate) fn new(
        image: Image,
        mask: Option<&Mask>,
        finest: u32,
        store: &PageStore,
        is_seen: impl Fn(PixelRect) -> bool,
    ) -> io::Result<Self> {
        let encoding = match image.samples {
            Samples::U8(_) => Encoding::Srgb8,
            _ => Encoding::Half,
        };
        let size = [image.width, image.height];
        let whole = size[0].max(size[1]).next_power_of_two().ilog2();
        let mut pyramid = Self { size, encoding, finest: finest.min(whole), levels: Vec::new() };
        let of_image = |x, y| {
            let mut value = Vec4::from(image.linear_texel(x, y));
            value.w *= mask.map_or(1.0, |mask| mask.share(x, y));
            let is_number = value.is_finite();
            if is_number { value.max(Vec4::ZERO).min(Vec4::splat(65_000.0)) } else { Vec4::ZERO }
        };
        let mut texels = match pyramid.finest {
            0 => Texels::of(size, encoding, of_image),
            _ => Texels::halved(size, encoding, of_image),
        };
        drop(image);
        let mut level = pyramid.finest.min(1);
        loop {
            if level >= pyramid.finest {
                pyramid.levels.push(Level::new(&texels, level, store, &is_seen)?);
            }
            if texels.extent == [1, 1] {
                return Ok(pyramid);
            }
            texels = Texels::halved(texels.extent, encoding, |x, y| texels.at(x, y));
            level += 1;
        }
    }

    /// The mean linear colour, and the mean of alpha, over a parallelogram around a position; both in pixels.
    pub(crate) fn mean(&self, reader: &PageReader<'_>, pixel: DVec2, sides: [Vec2; 2]) -> Vec4 {
        let [a, b] = sides.map(|side| side.length());
        let narrow = a.min(b).max(sides[0].perp_dot(sides[1]).abs() / a.max(b).max(f32::MIN_POSITIVE));
        // Two texels across the narrow side; beyond the most probes along the long one, coarser.
        let width = (0.5 * narrow).max(a.max(b) / MAX_PROBES).max(1e-6);
        let last = self.finest + self.levels.len() as u32 - 1;
        let level = width.log2().clamp(self.finest as f32, last as f32);
        let (fine, share) = (level as u32, level.fract());
        let probes = |side: f32| (side / width.max(1.0)).ceil().clamp(1.0, MAX_PROBES);
        let [columns, rows] = [probes(a), probes(b)];
        let mut sum = Vec4::ZERO;
        for row in 0..rows as u32 {
            for column in 0..columns as u32 {
                let along = (column as f32 + 0.5) / columns - 0.5;
                let down = (row as f32 + 0.5) / rows - 0.5;
                let at = pixel + (sides[0] * along + sides[1] * down).as_dvec2();
                let mut value = self.bilinear(reader, fine, at);
                if share > 0.0 {
                    value = value.lerp(self.bilinear(reader, fine + 1, at), share);
                }
                sum += value;
            }
        }
        straight(sum, columns * rows)
    }

    /// Colours times alpha, and alpha.
    fn bilinear(&self, reader: &PageReader<'_>, level: u32, pixel: DVec2) -> Vec4 {
        let index = (level.max(self.finest) - self.finest) as usize;
        let Some(stored) = self.levels.get(index) else { return Vec4::ZERO };
        let at = pixel / f64::from(1_u32 << (self.finest + index as u32)) - 0.5;
        let last = stored.extent.map(|n| f64::from(n - 1));
        let at = at.clamp(DVec2::ZERO, DVec2::from(last));
        let (low, share) = (at.floor(), at.fract().as_vec2());
        let x = low.x as u32;
        let y = low.y as u32;
        let next = [(x + 1).min(stored.extent[0] - 1), (y + 1).min(stored.extent[1] - 1)];
        let [upper, lower] = if x / PAGE == next[0] / PAGE && y / PAGE == next[1] / PAGE {
            let Some(page) = stored.page([x, y]).and_then(|page| reader.page(page)) else {
                return Vec4::ZERO;
            };
            let value = |x, y| self.decode(&page, x, y);
            [[value(x, y), value(next[0], y)], [value(x, next[1]), value(next[0], next[1])]]
        } else {
            let value = |x, y| {
                let page = stored.page([x, y]).and_then(|page| reader.page(page));
                page.map_or(Vec4::ZERO, |page| self.decode(&page, x, y))
            };
            [[value(x, y), value(next[0], y)], [value(x, next[1]), value(next[0], next[1])]]
        };
        upper[0].lerp(upper[1], share.x).lerp(lower[0].lerp(lower[1], share.x), share.y)
    }

    /// A texel of a page, its colour multiplied with alpha.
    #[inline]
    fn decode(&self, page: &[u8], x: u32, y: u32) -> Vec4 {
        let texel = (y % PAGE * PAGE + x % PAGE) as usize;
        let value = self.encoding.decode(page.get(texel * self.encoding.bytes()..).unwrap_or_default());
        (value.truncate() * value.w).extend(value.w)
    }
}

impl Level {
    fn new(
        texels: &Texels,
        level: u32,
        store: &PageStore,
        is_seen: &impl Fn(PixelRect) -> bool,
    ) -> io::Result<Self> {
        let grid = texels.extent.map(|n| n.div_ceil(PAGE));
        let mut pages = Vec::with_capacity(grid[0] as usize * grid[1] as usize);
        let pixels = f64::from(1_u32 << level);
        for row in 0..grid[1] {
            for column in 0..grid[0] {
                let low = DVec2::new(f64::from(column * PAGE), f64::from(row * PAGE));
                let rect = [(low - REACH) * pixels, (low + f64::from(PAGE) + REACH) * pixels];
                pages.push(match is_seen(rect) {
                    true => Some(store.append(Self::cut(texels, [column * PAGE, row * PAGE]))?),
                    false => None,
                });
            }
        }
        Ok(Self { extent: texels.extent, columns: grid[0], pages })
    }

    /// The texels of a page; what lies beyond the level is zero.
    fn cut(texels: &Texels, [left, top]: [u32; 2]) -> Vec<u8> {
        let size = texels.encoding.bytes();
        let mut page = vec![0; (PAGE * PAGE) as usize * size];
        let columns = (texels.extent[0] - left).min(PAGE) as usize * size;
        for (y, out) in (top..texels.extent[1]).zip(page.chunks_mut(PAGE as usize * size)) {
            let first = (y as usize * texels.extent[0] as usize + left as usize) * size;
            out[..columns].copy_from_slice(&texels.bytes[first..first + columns]);
        }
        page
    }

    fn page(&self, [x, y]: [u32; 2]) -> Option<&Stored> {
        self.pages[(y / PAGE * self.columns + x / PAGE) as usize].as_ref()
    }
}

/// The finest level that footprints so many pixels wide need.
pub(crate) fn level_for_width(pixels: f32) -> u32 {
    (0.5 * pixels).log2().clamp(0.0, 16.0) as u32
}

// ---- Pages of photographs: in memory as far as that is allowed, the others in a scratch file behind a cache.
//
// Photographs are decoded once, cut into square pages, and dropped. The first pages stay in memory; once these fill their share,
// later ones go to an unnamed file, and what is looked up of them is cached. So memory is bounded whatever the number of
// photographs, none is decoded twice, and it does not matter in which order tiles ask for them. Shared by all threads.

/// Side of a page in texels.
pub(crate) const PAGE: u32 = 64;

#[derive(Clone, Debug)]
pub(crate) enum Stored {
    Memory(Arc<[u8]>),
    File { offset: u64, bytes: u32 },
}

pub(crate) enum PageBytes<'a> {
    Lent(&'a [u8]),
    Shared(Arc<[u8]>),
}

impl Deref for PageBytes<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Lent(bytes) => bytes,
            Self::Shared(bytes) => bytes,
        }
    }
}

#[derive(Debug)]
pub(crate) struct PageStore {
    folder: PathBuf,
    /// Bytes of pages that may stay in memory for good, and how many do.
    pinned_limit: u64,
    pinned: AtomicU64,
    /// Made when it is needed.
    scratch: OnceLock<File>,
    end: AtomicU64,
    /// Pages of the scratch file by their offsets.
    cache: Cache<u64, Arc<[u8]>, Bytes>,
    failure: OnceLock<io::Error>,
}

#[derive(Clone, Debug)]
struct Bytes;

impl Weighter<u64, Arc<[u8]>> for Bytes {
    fn weight(&self, _: &u64, page: &Arc<[u8]>) -> u64 {
        page.len() as u64
    }
}

impl PageStore {
    /// A store whose pages take `memory_bytes` at most; what does not fit goes to a file in `folder`.
    pub(crate) fn new(memory_bytes: u64, folder: PathBuf) -> Self {
        let cached_bytes = memory_bytes / 4;
        let pages = cached_bytes / (PAGE * PAGE * 8) as u64 + 1;
        Self {
            folder,
            pinned_limit: cached_bytes * 3,
            pinned: AtomicU64::new(0),
            scratch: OnceLock::new(),
            end: AtomicU64::new(0),
            cache: Cache::with_weighter(pages as usize, cached_bytes, Bytes),
            failure: OnceLock::new(),
        }
    }

    pub(crate) fn append(&self, page: Vec<u8>) -> io::Result<Stored> {
        let length = page.len() as u64;
        if self.pinned.fetch_add(length, Relaxed) + length <= self.pinned_limit {
            return Ok(Stored::Memory(page.into()));
        }
        self.pinned.fetch_sub(length, Relaxed);
        let file = self.scratch_file()?;
        let offset = self.end.fetch_add(length, Relaxed);
        write_all_at(file, &page, offset)?;
        Ok(Stored::File { offset, bytes: page.len() as u32 })
    }

    fn scratch_file(&self) -> io::Result<&File> {
        if let Some(file) = self.scratch.get() {
            return Ok(file);
        }
        // Of two threads that come here at once, the file of one goes away: it has no name.
        let file = tempfile::tempfile_in(&self.folder)?;
        Ok(self.scratch.get_or_init(|| file))
    }

    /// Bytes of pages in memory for good, and in the scratch file.
    pub(crate) fn bytes(&self) -> [u64; 2] {
        [self.pinned.load(Relaxed), self.end.load(Relaxed)]
    }

    /// The first page that could not be read. What was asked for then saw nothing.
    pub(crate) fn failure(&self) -> Option<&io::Error> {
        self.failure.get()
    }

    fn cached(&self, offset: u64, bytes: u32) -> Option<Arc<[u8]>> {
        let read = || {
            let mut page = vec![0; bytes as usize];
            let file = self.scratch.get().ok_or(io::ErrorKind::NotFound)?;
            read_exact_at(file, &mut page, offset)?;
            Ok(page.into())
        };
        let page = self.cache.get_or_insert_with(&offset, read);
        page.map_err(|error| self.failure.get_or_init(|| error)).ok()
    }
}

/// Pages that a reader has at hand without a lock.
const AT_HAND: usize = 64;

type AtHand = (u64, Arc<[u8]>);

/// Reads pages on one thread, and keeps the last ones at hand.
pub(crate) struct PageReader<'a> {
    store: &'a PageStore,
    at_hand: RefCell<Vec<Option<AtHand>>>,
}

impl<'a> PageReader<'a> {
    pub(crate) fn new(store: &'a PageStore) -> Self {
        Self { store, at_hand: RefCell::new(Vec::new()) }
    }

    /// The bytes of a page; nothing where it cannot be read ([`PageStore::failure`]).
    pub(crate) fn page<'p>(&self, stored: &'p Stored) -> Option<PageBytes<'p>> {
        let (offset, bytes) = match stored {
            Stored::Memory(bytes) => return Some(PageBytes::Lent(bytes)),
            Stored::File { offset, bytes } => (*offset, *bytes),
        };
        let mut at_hand = self.at_hand.borrow_mut();
        if at_hand.is_empty() {
            at_hand.resize(AT_HAND, None);
        }
        let place = &mut at_hand[(offset / u64::from(bytes.max(1)) % AT_HAND as u64) as usize];
        match place {
            Some((at, page)) if *at == offset => Some(PageBytes::Shared(page.clone())),
            place => {
                let page = self.store.cached(offset, bytes)?;
                *place = Some((offset, page.clone()));
                Some(PageBytes::Shared(page))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_texture::ColorSpace;

    use super::*;

    fn picture(size: [u32; 2], value: impl Fn(u32, u32) -> [f32; 4]) -> Image {
        let texels: Vec<[f32; 4]> =
            (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Image::from_linear_rgba(size[0], size[1], &texels)
    }

    #[test]
    fn ramps_are_read_exactly_at_every_level_and_across_pages() {
        let image = picture([300, 170], |x, y| [x as f32 / 300.0, y as f32 / 170.0, 0.5, 1.0]);
        let store = PageStore::new(100_000, std::env::temp_dir());
        let pyramid = Pyramid::new(image, None, 0, &store, |_| true).unwrap();
        let reader = PageReader::new(&store);
        for (i, width) in [0.5_f32, 1.0, 2.0, 3.0, 5.5, 9.0].into_iter().enumerate() {
            for k in 0..200_u32 {
                let at = DVec2::new(40.0 + f64::from(k) * 1.1, 40.0 + f64::from(k * 37 % 90));
                let turned = Vec2::from_angle(k as f32) * width;
                let mean = pyramid.mean(&reader, at, [turned, turned.perp()]);
                let expected = Vec4::new((at.x - 0.5) as f32 / 300.0, (at.y - 0.5) as f32 / 170.0, 0.5, 1.0);
                assert!((mean - expected).abs().max_element() < 2e-3, "{i} {k}: {mean} {expected}");
            }
        }
    }

    #[test]
    fn footprints_average_and_masks_hide() {
        // A fine checkerboard averages to grey, whatever the footprint; masked texels do not count.
        let image = picture([256, 256], |x, y| {
            let white = (x + y) % 2 == 0;
            let masked = x >= 128;
            if masked { [9.0, 9.0, 9.0, 0.0] } else { [f32::from(u8::from(white)); 4].map(|c| c) }
        });
        let mut image = image;
        if let Samples::F32(samples) = &mut image.samples {
            for (i, texel) in samples.chunks_mut(4).enumerate() {
                texel[3] = if i % 256 >= 128 { 0.0 } else { 1.0 };
            }
        }
        let store = PageStore::new(1 << 30, std::env::temp_dir());
        let pyramid = Pyramid::new(image, None, 0, &store, |_| true).unwrap();
        let reader = PageReader::new(&store);
        for width in [4.0, 8.0, 31.0] {
            let mean = pyramid.mean(&reader, DVec2::new(60.0, 120.0), [Vec2::X * width, Vec2::Y * width]);
            assert!((mean.x - 0.5).abs() < 0.05 && mean.w == 1.0, "{width}: {mean}");
        }
        let beside = pyramid.mean(&reader, DVec2::new(128.0, 128.0), [Vec2::X * 16.0, Vec2::Y * 16.0]);
        assert!((beside.w - 0.5).abs() < 0.05 && beside.x < 0.6, "{beside}");
        assert_eq!(pyramid.mean(&reader, DVec2::new(200.0, 100.0), [Vec2::X, Vec2::Y]), Vec4::ZERO);
    }

    #[test]
    fn finer_levels_and_unseen_pages_are_left_out() {
        let image = picture([256, 128], |x, _| [x as f32 / 256.0, 0.2, 0.3, 1.0]);
        let image = image.converted(fantex_texture::Depth::U8, ColorSpace::Srgb);
        let store = PageStore::new(1 << 30, std::env::temp_dir());
        let pyramid = Pyramid::new(image, None, 1, &store, |[low, _]| low.x < 100.0).unwrap();
        assert_eq!(pyramid.levels[0].extent, [128, 64]);
        assert_eq!(pyramid.levels.last().unwrap().extent, [1, 1]);
        let reader = PageReader::new(&store);
        let seen = pyramid.mean(&reader, DVec2::new(60.0, 60.0), [Vec2::X, Vec2::Y]);
        assert!((seen.x - 59.5 / 256.0).abs() < 0.01 && seen.w == 1.0, "{seen}");
        assert!(pyramid.levels[0].pages.iter().any(Option::is_none) || pyramid.levels[0].pages.len() == 2);
    }

    #[test]
    fn pages_come_back_from_memory_and_from_the_file() {
        let store = PageStore::new(64 << 10, std::env::temp_dir());
        let page = |i: u32| vec![(i % 251) as u8; 1024];
        let stored: Vec<Stored> = (0..300).map(|i| store.append(page(i)).unwrap()).collect();
        let [in_memory, in_file] = store.bytes();
        assert!(in_memory <= 48 << 10 && in_memory > 40 << 10);
        assert_eq!(in_memory + in_file, 300 * 1024);
        let reader = PageReader::new(&store);
        for step in [1, 7, 101] {
            for i in 0..300 {
                let i = i * step % 300;
                assert_eq!(*reader.page(&stored[i]).unwrap(), *page(i as u32), "{i}");
            }
        }
        let cached = store.cache.weight();
        assert!(cached <= 16 << 10, "the cache holds {cached} bytes");
        assert!(store.failure().is_none());
    }

    #[test]
    fn an_unreadable_page_is_a_failure_and_no_panic() {
        let store = PageStore::new(0, std::env::temp_dir());
        assert!(store.append(vec![1; 8]).is_ok());
        let beyond = Stored::File { offset: 1 << 20, bytes: 8 };
        assert!(PageReader::new(&store).page(&beyond).is_none());
        assert!(store.failure().is_some());
        let nowhere = PageStore::new(0, PathBuf::from("/nonexistent/folder"));
        assert!(nowhere.append(vec![1; 8]).is_err());
    }
}
