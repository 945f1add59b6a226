//! Allocation of rectangles in the atlas: exact, in any order of allocation and release.
//!
//! Layers are cut into bins of 256x256 texels, the size of the largest page. A bin keeps one bit per 4x4 texels; a free
//! rectangle is found with shifts over 64 words. Pages of like size share bins, so that bins become free as a whole.
//!
//! Why not a shelf packer: pages come in all combinations of sides and leave one by one, and bins become free as a whole. In a full layer
//! 62 % of the texels are in use when a page finds no room, as with the shelves of `etagere` (`tests::against_shelves`).
//!
//! Which bins may have room, and which are for like pages, stand in sets of bits: an atlas may have two thousand bins, nearly all of
//! them full.

use fantex_store::PAGE;

use crate::{AtlasPlace, AtlasShape};

/// Texels along the side of a bit.
const UNIT: u32 = 4;
/// Bits along the side of a bin.
const SIDE: u32 = PAGE / UNIT;

#[derive(Clone, Debug)]
pub(crate) struct Packer {
    bins: Vec<Bin>,
    /// What a search looks at first, close together: the bits of a thousand bins do not stay in a near cache.
    states: Vec<BinState>,
    /// Bins along a layer's side.
    columns: u32,
    empty: BinSet,
    /// Per kind the bins that are not empty.
    of_kind: [BinSet; KINDS],
    /// Per size class the bins that may have room.
    open: Vec<BinSet>,
}

#[derive(Clone, Debug)]
struct Bin {
    /// Bit x of word y is set where the unit is used.
    rows: [u64; SIDE as usize],
}

#[derive(Clone, Copy, Debug)]
struct BinState {
    used: u16,
    /// Longest side, as a class, of the first page that came when the bin was empty.
    kind: u8,
    /// Size classes for which no room was found since something became free.
    full_for: u64,
}

const SIDE_CLASSES: u32 = 7;
/// Kinds of pages: the classes of the longest side.
pub(crate) const KINDS: usize = SIDE_CLASSES as usize;
const CLASSES: usize = (SIDE_CLASSES * SIDE_CLASSES) as usize;

/// Class of a side in units: its binary logarithm, rounded up.
fn side_class(units: u32) -> u32 {
    units.next_power_of_two().trailing_zeros()
}

/// The least units of a rectangle of a size class.
fn min_units(class: usize) -> u32 {
    let min_side = |class: u32| (1 << class >> 1) + 1;
    let class = class as u32;
    min_side(class % SIDE_CLASSES) * min_side(class / SIDE_CLASSES)
}

/// Bins in which a rectangle is looked for.
#[derive(Clone, Copy)]
enum Preference {
    /// Those of like pages first,
    Like,
    /// then empty ones,
    Empty,
    /// then any.
    Other,
}

impl Packer {
    pub(crate) fn new(shape: AtlasShape) -> Self {
        let columns = (shape.side / PAGE).max(1);
        let count = (columns * columns * shape.layers.clamp(1, 128)) as usize;
        Self {
            bins: vec![Bin { rows: [0; SIDE as usize] }; count],
            states: vec![BinState { used: 0, kind: 0, full_for: 0 }; count],
            columns,
            empty: BinSet::of_all(count),
            of_kind: std::array::from_fn(|_| BinSet::of_none(count)),
            open: vec![BinSet::of_all(count); CLASSES],
        }
    }

    /// The kind of a rectangle of texels: those of one kind share bins.
    pub(crate) fn kind_of([w, h]: [u32; 2]) -> usize {
        side_class(w.max(h).div_ceil(UNIT)) as usize
    }

    /// Room for a rectangle of texels with sides of at most 256, multiples of 4.
    pub(crate) fn take(&mut self, extent: [u32; 2]) -> Option<AtlasPlace> {
        let size = extent.map(|n| n.div_ceil(UNIT));
        let [w, h] = size.map(side_class);
        let class = (h * SIDE_CLASSES + w) as usize;
        let kind = w.max(h) as u8;
        for preference in [Preference::Like, Preference::Empty, Preference::Other] {
            let mut from = 0;
            while let Some(bin) = self.next_bin(preference, kind, class, from) {
                if let Some(at) = self.take_in(bin, size, class, kind) {
                    return Some(self.place(bin, at));
                }
                from = bin + 1;
            }
        }
        None
    }

    /// The first bin from one on that may have room.
    fn next_bin(&self, preference: Preference, kind: u8, class: usize, from: usize) -> Option<usize> {
        let (open, like) = (&self.open[class].words, &self.of_kind[usize::from(kind)].words);
        let empty = &self.empty.words;
        let mut mask = u64::MAX << (from % 64);
        for word in from / 64..open.len() {
            let suitable = match preference {
                Preference::Like => like[word],
                Preference::Empty => empty[word],
                Preference::Other => !(like[word] | empty[word]),
            };
            let found = suitable & open[word] & mask;
            if found != 0 {
                return Some(64 * word + found.trailing_zeros() as usize);
            }
            mask = u64::MAX;
        }
        None
    }

    /// Room in the bin where a rectangle has been given back, the only one in which there may be any since
    /// [`Packer::take`] found none.
    pub(crate) fn take_where_freed(&mut self, extent: [u32; 2], freed: AtlasPlace) -> Option<AtlasPlace> {
        let size = extent.map(|n| n.div_ceil(UNIT));
        let [w, h] = size.map(side_class);
        let bin = self.bin_of(freed);
        let at = self.take_in(bin, size, (h * SIDE_CLASSES + w) as usize, w.max(h) as u8)?;
        Some(self.place(bin, at))
    }

    /// Room in a bin.
    fn take_in(&mut self, bin: usize, size: [u32; 2], class: usize, kind: u8) -> Option<[u32; 2]> {
        let state = &mut self.states[bin];
        let free = SIDE * SIDE - u32::from(state.used);
        if state.full_for >> class & 1 == 1 || size[0] * size[1] > free {
            if min_units(class) > free {
                self.close(bin, class);
            }
            return None;
        }
        let Some(at) = self.bins[bin].find(size) else {
            self.close(bin, class);
            return None;
        };
        if state.used == 0 {
            state.kind = kind;
            self.empty.set(bin, false);
            self.of_kind[usize::from(kind)].set(bin, true);
        }
        state.used += (size[0] * size[1]) as u16;
        self.bins[bin].mark(at, size, true);
        Some(at)
    }

    /// A bin has no room for a size class until something becomes free.
    fn close(&mut self, bin: usize, class: usize) {
        self.states[bin].full_for |= 1 << class;
        self.open[class].set(bin, false);
    }

    /// Gives the room of a rectangle back that [`Packer::take`] gave.
    pub(crate) fn release_place(&mut self, place: AtlasPlace, extent: [u32; 2]) {
        let bin = self.bin_of(place);
        let at = [place.x, place.y].map(|n| u32::from(n) % PAGE / UNIT);
        let size = extent.map(|n| n.div_ceil(UNIT));
        self.bins[bin].mark(at, size, false);
        let state = &mut self.states[bin];
        state.used -= (size[0] * size[1]) as u16;
        if state.used == 0 {
            self.of_kind[usize::from(state.kind)].set(bin, false);
            self.empty.set(bin, true);
        }
        let mut full_for = std::mem::take(&mut state.full_for);
        while full_for != 0 {
            self.open[full_for.trailing_zeros() as usize].set(bin, true);
            full_for &= full_for - 1;
        }
    }

    fn bin_of(&self, place: AtlasPlace) -> usize {
        let [column, row] = [place.x, place.y].map(|n| u32::from(n) / PAGE);
        ((u32::from(place.layer) * self.columns + row) * self.columns + column) as usize
    }

    fn place(&self, bin: usize, [x, y]: [u32; 2]) -> AtlasPlace {
        let bin = bin as u32;
        let (column, row) = (bin % self.columns, bin / self.columns % self.columns);
        AtlasPlace {
            layer: (bin / (self.columns * self.columns)) as u16,
            x: (column * PAGE + x * UNIT) as u16,
            y: (row * PAGE + y * UNIT) as u16,
        }
    }
}

#[derive(Clone, Debug)]
struct BinSet {
    words: Vec<u64>,
}

impl BinSet {
    fn of_none(count: usize) -> Self {
        Self { words: vec![0; count.div_ceil(64)] }
    }

    fn of_all(count: usize) -> Self {
        let mut all = Self::of_none(count);
        (0..count).for_each(|bin| all.set(bin, true));
        all
    }

    fn set(&mut self, bin: usize, is_in: bool) {
        let (word, bit) = (&mut self.words[bin / 64], 1 << (bin % 64));
        *word = if is_in { *word | bit } else { *word & !bit };
    }
}

impl Bin {
    /// The first free rectangle, row by row.
    fn find(&self, [w, h]: [u32; 2]) -> Option<[u32; 2]> {
        // Word y becomes the union of the rows y..y + h, by doubling.
        let mut used = self.rows;
        let mut span = 1;
        while span < h {
            let step = span.min(h - span) as usize;
            for y in 0..used.len() - step {
                used[y] |= used[y + step];
            }
            span += step as u32;
        }
        for y in 0..=SIDE - h {
            // Bit x stays where the units x..x + w are free.
            let mut free = !used[y as usize];
            let mut span = 1;
            while span < w && free != 0 {
                let step = span.min(w - span);
                free &= free >> step;
                span += step;
            }
            if free != 0 {
                return Some([free.trailing_zeros(), y]);
            }
        }
        None
    }

    fn mark(&mut self, [x, y]: [u32; 2], [w, h]: [u32; 2], is_used: bool) {
        let mask = (u64::MAX >> (SIDE - w)) << x;
        for row in &mut self.rows[y as usize..(y + h) as usize] {
            debug_assert_eq!(*row & mask, if is_used { 0 } else { mask });
            *row = if is_used { *row | mask } else { *row & !mask };
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{CleanOptions, clean, generate};

    use super::*;

    /// Page sizes as they occur: all levels of a cover's tiles.
    fn page_sizes() -> Vec<[u32; 2]> {
        let (mesh, _) = clean(generate::torus(160, 80), &CleanOptions::default()).unwrap();
        let budget = TexelBudget::Total(24 << 20);
        let options = CoverOptions { budget, tile: 128, ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        let levels = cover.groups.iter().flat_map(|g| (0..g.level_count()).map(|l| g.level_extent(l)));
        levels.filter(|e| e.iter().all(|&n| n <= 256)).collect()
    }

    /// Random pages come; when one finds no room, random ones leave until it does. The share of the atlas that is in use then, on average,
    /// and how often that is; the atlas is empty in the end.
    fn churn<A, P: Copy>(
        sizes: &[[u32; 2]],
        atlas: &mut A,
        take: fn(&mut A, [u32; 2]) -> Option<P>,
        release: fn(&mut A, P, [u32; 2]),
    ) -> (f64, u32) {
        let texels = |[w, h]: [u32; 2]| u64::from(w) * u64::from(h);
        let mut random = Random::new(7);
        let (mut resident, mut used, mut seen, mut fails) = (Vec::new(), 0, 0, 0);
        for _ in 0..20_000 {
            let size = sizes[random.below(sizes.len() as u64) as usize];
            let place = loop {
                if let Some(place) = take(atlas, size) {
                    break place;
                }
                (seen, fails) = (seen + used, fails + 1);
                let (place, left) = resident.swap_remove(random.below(resident.len() as u64) as usize);
                release(atlas, place, left);
                used -= texels(left);
            };
            resident.push((place, size));
            used += texels(size);
        }
        resident.into_iter().for_each(|(place, size)| release(atlas, place, size));
        (seen as f64 / f64::from(fails.max(1)) / f64::from(1024 * 1024), fails)
    }

    #[test]
    fn against_shelves() {
        let sizes = page_sizes();
        let mut packer = Packer::new(AtlasShape { side: 1024, layers: 1 });
        let bits = churn(&sizes, &mut packer, Packer::take, Packer::release_place);
        assert!((0..16).all(|_| packer.take([256, 256]).is_some()), "all room comes back");
        assert_eq!(packer.take([4, 4]), None);
        let options = etagere::AllocatorOptions { alignment: etagere::size2(4, 4), ..Default::default() };
        let mut shelves = etagere::AtlasAllocator::with_options(etagere::size2(1024, 1024), &options);
        let shelves = churn(
            &sizes,
            &mut shelves,
            |shelves, [w, h]| shelves.allocate(etagere::size2(w as i32, h as i32)).map(|a| a.id),
            |shelves, id, _| shelves.deallocate(id),
        );
        println!(
            "share in use when a page finds no room, evictions: bins of bits {bits:?}, shelves {shelves:?}"
        );
        assert!(bits.0 > 0.98 * shelves.0);
    }
}
