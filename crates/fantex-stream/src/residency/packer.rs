//! Allocation of outlines in the atlas: exact, in any order of allocation and release.
//!
//! Layers are cut into bins of 256x256 texels, the size of the largest page. A bin keeps one bit per 4x4 texels; room for a
//! rectangle, or for an [`Outline`], is found with shifts over 64 words. Outlines interlock: the gaps of one hold parts of others.
//! Pages of like size share bins, so that bins become free as a whole.
//!
//! Why not a shelf packer: pages come in all combinations of sides and leave one by one, and bins become free as a whole. When a page finds
//! no room, a layer holds at least as many stored texels as with the shelves of `etagere` (`tests::against_rectangles_and_shelves`).
//!
//! Which bins may have room, and which are for like pages, stand in sets of bits: an atlas may have two thousand bins, nearly all of
//! them full.

use fantex_store::PAGE;

use crate::{AtlasPlace, AtlasShape, Outline};

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
    full_for: u128,
}

const SIDE_CLASSES: u32 = 7;
/// Kinds of pages: the classes of the longest side.
pub(crate) const KINDS: usize = SIDE_CLASSES as usize;
/// Classes of rectangles; those of outlines with such bounds follow: where a rectangle found no room, an outline may, and an outline that found
/// none says little of rectangles.
const WHOLE_CLASSES: usize = (SIDE_CLASSES * SIDE_CLASSES) as usize;
const CLASSES: usize = 2 * WHOLE_CLASSES;

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

/// An outline in units, without what is empty around it.
struct Form {
    /// Where it begins in the rectangle.
    offset: [u32; 2],
    /// Columns and rows of its bounds; zero where nothing is stored.
    size: [u32; 2],
    /// Per row of the bounds the first unit, and the end; `None` where all are full.
    spans: Option<[[u8; 2]; SIDE as usize]>,
    units: u32,
    class: usize,
}

impl Form {
    fn new(extent: [u32; 2], outline: &Outline) -> Self {
        let mut form =
            Self { offset: [0; 2], size: extent.map(|n| n.div_ceil(UNIT)), spans: None, units: 0, class: 0 };
        if !outline.is_whole() {
            let mut spans = [[0; 2]; SIDE as usize];
            let (mut low, mut high, mut rows) = (SIDE, 0, 0..0);
            let filled = (0..).zip(outline.spans(extent)).filter(|(_, [first, end])| first < end);
            for (row, [first, end]) in filled {
                rows = if rows.is_empty() { row..row + 1 } else { rows.start..row + 1 };
                (low, high) = (low.min(first), high.max(end));
                spans[(row - rows.start) as usize] = [first as u8, end as u8];
                form.units += end - first;
            }
            let size = [high.saturating_sub(low), rows.end - rows.start];
            spans.iter_mut().flatten().for_each(|column| *column = column.saturating_sub(low as u8));
            (form.offset, form.size) = ([low.min(high), rows.start], size);
            form.spans = (form.units < size[0] * size[1]).then_some(spans);
        }
        let [w, h] = form.size.map(side_class);
        form.class = (h * SIDE_CLASSES + w) as usize;
        if form.spans.is_some() {
            form.class += WHOLE_CLASSES;
        } else {
            form.units = form.size[0] * form.size[1];
        }
        form
    }

    /// Its rows: first unit, and end.
    fn rows(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.size[1] as usize).map(|row| match &self.spans {
            Some(spans) => spans[row].map(u32::from),
            None => [0, self.size[0]],
        })
    }

    fn kind(&self) -> u8 {
        side_class(self.size[0].max(self.size[1])) as u8
    }
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

    /// The kind of an outline in a rectangle of texels: those of one kind share bins.
    pub(crate) fn kind_of(extent: [u32; 2], outline: &Outline) -> usize {
        usize::from(Form::new(extent, outline).kind())
    }

    /// Room for an outline in a rectangle of texels with sides of at most 256, multiples of 4: where the rectangle's first texel
    /// comes to lie.
    pub(crate) fn take(&mut self, extent: [u32; 2], outline: &Outline) -> Option<AtlasPlace> {
        let form = Form::new(extent, outline);
        if form.units == 0 {
            return Some(AtlasPlace { layer: 0, x: 0, y: 0 });
        }
        for preference in [Preference::Like, Preference::Empty, Preference::Other] {
            let mut from = 0;
            while let Some(bin) = self.next_bin(preference, form.kind(), form.class, from) {
                if let Some(place) = self.take_in(bin, &form) {
                    return Some(place);
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

    /// Room in the bin where something has been given back, the only one in which there may be any since
    /// [`Packer::take`] found none.
    pub(crate) fn take_where_freed(
        &mut self,
        extent: [u32; 2],
        outline: &Outline,
        freed: FreedRoom,
    ) -> Option<AtlasPlace> {
        self.take_in(freed.bin, &Form::new(extent, outline))
    }

    /// Room in a bin.
    fn take_in(&mut self, bin: usize, form: &Form) -> Option<AtlasPlace> {
        let state = &mut self.states[bin];
        let free = SIDE * SIDE - u32::from(state.used);
        if state.full_for >> form.class & 1 == 1 || form.units > free {
            if form.spans.is_none() && min_units(form.class) > free {
                self.close(bin, form.class);
            }
            return None;
        }
        // The rectangle begins inside the layer, though not always inside the bin.
        let columns = self.columns as usize;
        let is_first = [bin.is_multiple_of(columns), (bin / columns).is_multiple_of(columns)];
        let least = [0, 1].map(|axis| if is_first[axis] { form.offset[axis] } else { 0 });
        let Some(at) = self.bins[bin].find(form, least) else {
            self.close(bin, form.class);
            return None;
        };
        if state.used == 0 {
            state.kind = form.kind();
            self.empty.set(bin, false);
            self.of_kind[usize::from(state.kind)].set(bin, true);
        }
        state.used += form.units as u16;
        self.bins[bin].mark(at, form, true);
        Some(self.place(bin, [0, 1].map(|axis| UNIT * at[axis]), form.offset))
    }

    /// A bin has no room for a size class until something becomes free.
    fn close(&mut self, bin: usize, class: usize) {
        self.states[bin].full_for |= 1 << class;
        self.open[class].set(bin, false);
    }

    /// Gives the room of an outline back that [`Packer::take`] gave.
    pub(crate) fn release_place(
        &mut self,
        place: AtlasPlace,
        extent: [u32; 2],
        outline: &Outline,
    ) -> Option<FreedRoom> {
        let form = Form::new(extent, outline);
        if form.units == 0 {
            return None;
        }
        let [x, y] = [u32::from(place.x) + UNIT * form.offset[0], u32::from(place.y) + UNIT * form.offset[1]];
        let bin = ((u32::from(place.layer) * self.columns + y / PAGE) * self.columns + x / PAGE) as usize;
        self.bins[bin].mark([x, y].map(|n| n % PAGE / UNIT), &form, false);
        let state = &mut self.states[bin];
        state.used -= form.units as u16;
        if state.used == 0 {
            self.of_kind[usize::from(state.kind)].set(bin, false);
            self.empty.set(bin, true);
        }
        let mut full_for = std::mem::take(&mut state.full_for);
        while full_for != 0 {
            self.open[full_for.trailing_zeros() as usize].set(bin, true);
            full_for &= full_for - 1;
        }
        Some(FreedRoom { bin })
    }

    /// Where a rectangle begins whose outline begins at texel `at` of a bin.
    fn place(&self, bin: usize, at: [u32; 2], offset: [u32; 2]) -> AtlasPlace {
        let bin = bin as u32;
        let first = [bin % self.columns, bin / self.columns % self.columns].map(|n| n * PAGE);
        let [x, y] = [0, 1].map(|axis| (first[axis] + at[axis] - UNIT * offset[axis]) as u16);
        AtlasPlace { layer: (bin / (self.columns * self.columns)) as u16, x, y }
    }
}

/// Where room has been given back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FreedRoom {
    bin: usize,
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
    /// The first free place, row by row, from least columns and rows on.
    fn find(&self, form: &Form, least: [u32; 2]) -> Option<[u32; 2]> {
        match &form.spans {
            Some(spans) => self.find_outline(form.size, &spans[..form.size[1] as usize], least),
            None => self.find_rectangle(form.size, least),
        }
    }

    fn find_rectangle(&self, [w, h]: [u32; 2], [least_x, least_y]: [u32; 2]) -> Option<[u32; 2]> {
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
        (least_y..=SIDE - h).find_map(|y| {
            // Bit x stays where the units x..x + w are free.
            let free = free_runs(!used[y as usize], w) & u64::MAX << least_x;
            (free != 0).then(|| [free.trailing_zeros(), y])
        })
    }

    fn find_outline(&self, [w, h]: [u32; 2], spans: &[[u8; 2]], least: [u32; 2]) -> Option<[u32; 2]> {
        let columns = u64::MAX >> (w - 1) & u64::MAX << least[0];
        (least[1]..=SIDE - h).find_map(|y| {
            // Bit x stays where the outline fits with its bounds at column x.
            let mut free = columns;
            for (&[first, end], &used) in spans.iter().zip(&self.rows[y as usize..]) {
                if first < end && used != 0 {
                    free &= free_runs(!used, u32::from(end - first)) >> first;
                    if free == 0 {
                        return None;
                    }
                }
            }
            (free != 0).then(|| [free.trailing_zeros(), y])
        })
    }

    fn mark(&mut self, [x, y]: [u32; 2], form: &Form, is_used: bool) {
        let rows = &mut self.rows[y as usize..(y + form.size[1]) as usize];
        for (row, [first, end]) in rows.iter_mut().zip(form.rows()).filter(|(_, [first, end])| first < end) {
            let mask = (u64::MAX >> (SIDE - (end - first))) << (x + first);
            debug_assert_eq!(*row & mask, if is_used { 0 } else { mask });
            *row = if is_used { *row | mask } else { *row & !mask };
        }
    }
}

/// Bit x stays where the bits x..x + length are set.
fn free_runs(mut free: u64, length: u32) -> u64 {
    let mut span = 1;
    while span < length && free != 0 {
        let step = span.min(length - span);
        free &= free >> step;
        span += step;
    }
    free
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use fantex_base::Random;
    use fantex_cover::{
        Cover, CoverOptions, Footprints, Frame, Group, GroupKind, TexelBlock, TexelBudget, TexelTriangle,
        build_cover,
    };
    use fantex_mesh::Mesh;
    use fantex_store::{group_pages, page_extent, page_grid, page_origin};
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::drawing::AtlasGrid;
    use crate::{AtlasFormat, BUNDLE_TILES, Parcel, SHARED_LEVELS};

    type Page = ([u32; 2], Outline);

    /// Pages as they occur: all levels of a cover's tiles, with what look-ups read of them.
    fn pages() -> Option<Vec<Page>> {
        let mesh = fantex_test::opened(&fantex_test::data("meshes/teapot.stl")?);
        let budget = TexelBudget::Total(8 << 20);
        let options = CoverOptions { budget, tile: 512, ..CoverOptions::default() };
        let (cover, _) = build_cover(&mesh, &options).unwrap();
        let mut triangles = vec![Vec::new(); cover.groups.len()];
        for (t, groups) in cover.corner_groups.iter().enumerate() {
            let firsts = (0..3).filter(|&k| !groups[..k].contains(&groups[k]));
            firsts.for_each(|k| triangles[groups[k] as usize].push(t));
        }
        let levels =
            (0..cover.groups.len()).flat_map(|g| (0..cover.groups[g].level_count()).map(move |l| (g, l)));
        let pages = levels
            .map(|(group, level)| read_outline(&mesh, &cover, group, level, &triangles[group]))
            .flat_map(|(extent, outline)| {
                let pages = page_grid(extent);
                let pages = (0..pages[1]).flat_map(move |y| (0..pages[0]).map(move |x| [x, y]));
                pages.map(move |page| {
                    let own = page_extent(extent, page);
                    (own, outline.part(extent, page_origin(page), own))
                })
            });
        Some(pages.collect())
    }

    /// The outline of the blocks that bilinear look-ups read in a level.
    fn read_outline(mesh: &Mesh, cover: &Cover, group: usize, level: u32, triangles: &[usize]) -> Page {
        let extent = cover.groups[group].level_extent(level);
        let [width, height] = extent.map(|n| n as i64);
        let texel_triangle = |&t: &usize| {
            let inside = cover.corner_groups[t].map(|g| g as usize == group);
            let slot = inside.iter().position(|&i| i)?;
            let corners =
                cover.tile_corners(mesh, t, slot).map(|uv| uv * Vec2::from(extent.map(|n| n as f32)));
            TexelTriangle::new(t as u32, inside, corners)
        };
        let triangles = triangles.iter().filter_map(texel_triangle).collect();
        let mut footprints = Footprints { triangles, ..Footprints::default() };
        footprints.cover(TexelBlock { origin: [0, 0], extent }, cover.delta);
        let mut spans = vec![[u8::MAX, 0]; extent[1] as usize / 4];
        for (at, _) in (0..).zip(&footprints.in_region).filter(|(_, is_in)| **is_in) {
            let [x, y] = [at % width, at / width];
            for band in (y - 1).max(0) / 4..=(y + 1).min(height - 1) / 4 {
                let span = &mut spans[band as usize];
                span[0] = span[0].min(((x - 1).max(0) / 4) as u8);
                span[1] = span[1].max(((x + 1).min(width - 1) / 4 + 1) as u8);
            }
        }
        spans.iter_mut().filter(|span| span[1] == 0).for_each(|span| *span = [0, 0]);
        (extent, Outline::new(extent, spans))
    }

    fn random_page(random: &mut Random) -> Page {
        let mut below = |n: u32| random.below(u64::from(n)) as u32;
        let most = [64, 24, 8][below(3) as usize];
        let [columns, bands] = [0; 2].map(|_| 1 + below(most));
        let extent = [4 * columns, 4 * bands];
        let style = below(4);
        let mut spans = Vec::new();
        for band in 0..bands {
            let [a, b] = [0; 2].map(|_| below(columns + 1) as u8);
            spans.push(match style {
                0 => [0, columns as u8],
                1 if band < bands / 3 => [0, 0],
                1 => [a.min(b), a.max(b)],
                2 => [0, ((band + 1) * columns / bands) as u8],
                _ => [(columns / 2) as u8, columns as u8],
            });
        }
        (extent, Outline::new(extent, spans))
    }

    #[test]
    fn outlines_are_apart_inside_the_atlas_and_all_room_comes_back() {
        let shape = AtlasShape { side: 512, layers: 2 };
        let mut packer = Packer::new(shape);
        let mut random = Random::new(3);
        let (mut used, mut resident) = (HashSet::new(), Vec::new());
        let units = |place: AtlasPlace, (extent, outline): &Page| {
            let [x, y] = [place.x, place.y].map(|n| u32::from(n) / 4);
            let spans = (y..).zip(outline.spans(*extent)).flat_map(|(row, [first, end])| {
                (first..end).map(move |column| [u32::from(place.layer), x + column, row])
            });
            spans.collect::<Vec<_>>()
        };
        for _ in 0..4000 {
            let page = random_page(&mut random);
            match packer.take(page.0, &page.1) {
                Some(place) => {
                    for unit in units(place, &page) {
                        assert!(
                            unit[0] < 2 && unit[1] < 128 && unit[2] < 128 && used.insert(unit),
                            "{place:?} {page:?}"
                        );
                    }
                    resident.push((place, page));
                }
                None => {
                    let (place, page) = resident.swap_remove(random.below(resident.len() as u64) as usize);
                    packer.release_place(place, page.0, &page.1);
                    units(place, &page).iter().for_each(|unit| assert!(used.remove(unit)));
                }
            }
            let taken: u32 = packer.states.iter().map(|state| u32::from(state.used)).sum();
            assert_eq!(taken as usize, used.len());
        }
        for (place, (extent, outline)) in resident {
            packer.release_place(place, extent, &outline);
        }
        assert!((0..8).all(|_| packer.take([256, 256], &Outline::WHOLE).is_some()), "all room comes back");
        assert_eq!(packer.take([4, 4], &Outline::WHOLE), None);
    }

    #[test]
    fn the_first_place_is_found_where_an_outline_fits() {
        let mut random = Random::new(5);
        let mut found = 0;
        for round in 0..400 {
            let mut bin = Bin { rows: [0; SIDE as usize] };
            for _ in 0..round % 40 {
                let (extent, outline) = random_page(&mut random);
                let form = Form::new(extent, &outline);
                if form.units > 0
                    && let Some(at) = bin.find(&form, [0, 0])
                {
                    bin.mark(at, &form, true);
                }
            }
            let (extent, outline) = random_page(&mut random);
            let form = Form::new(extent, &outline);
            if form.units == 0 {
                continue;
            }
            let least = [0; 2].map(|_| random.below(8) as u32);
            let fits = |x: u32, y: u32| {
                (y..).zip(form.rows()).all(|(row, [first, end])| {
                    (x + first..x + end).all(|column| bin.rows[row as usize] >> column & 1 == 0)
                })
            };
            let columns = least[0]..(SIDE + 1 - form.size[0]).max(least[0]);
            let mut rows = least[1]..SIDE + 1 - form.size[1];
            let naive = rows.find_map(|y| columns.clone().find(|&x| fits(x, y)).map(|x| [x, y]));
            assert_eq!(bin.find(&form, least), naive);
            found += usize::from(naive.is_some());
        }
        assert!(found > 100, "{found}");
    }

    /// Random pages come; when one finds no room, random ones leave until it does. The share of the atlas that holds stored texels then,
    /// the mean number of pages in it, and how often that is; the atlas is empty in the end.
    fn churn<A, P: Copy>(
        pages: &[Page],
        atlas: &mut A,
        take: impl Fn(&mut A, &Page) -> Option<P>,
        release: impl Fn(&mut A, P, &Page),
    ) -> (f64, f64, u32) {
        let texels = |page: &Page| page.1.texels(page.0);
        let mut random = Random::new(7);
        let (mut resident, mut used, mut seen, mut count, mut fails) = (Vec::new(), 0, 0, 0, 0);
        for _ in 0..20_000 {
            let page = &pages[random.below(pages.len() as u64) as usize];
            let place = loop {
                if let Some(place) = take(atlas, page) {
                    break place;
                }
                (seen, count, fails) = (seen + used, count + resident.len(), fails + 1);
                let (place, left): (P, &Page) =
                    resident.swap_remove(random.below(resident.len() as u64) as usize);
                release(atlas, place, left);
                used -= texels(left);
            };
            resident.push((place, page));
            used += texels(page);
        }
        resident.into_iter().for_each(|(place, page)| release(atlas, place, page));
        let fail_count = f64::from(fails.max(1));
        (seen as f64 / fail_count / f64::from(1024 * 1024), count as f64 / fail_count, fails)
    }

    /// A cover of no triangles with tiles of these extents.
    fn cover_of(extents: impl IntoIterator<Item = [u32; 2]>) -> Cover {
        let frame = Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X };
        let tile = |extent| Group {
            kind: GroupKind::Projected,
            frame,
            uv_scale: Vec2::ONE,
            uv_offset: Vec2::ZERO,
            extent,
        };
        Cover {
            delta: 0.25,
            density: 1.0,
            is_creased: false,
            hard_edges: None,
            is_paired_by_angle: false,
            corner_groups: Vec::new(),
            groups: extents.into_iter().map(tile).collect(),
            unfolded: Vec::new().into(),
        }
    }

    /// However much memory is allowed, an atlas has room for what the cover has, and not much more.
    #[test]
    fn shapes_for_covers_have_room_for_all_parcels() {
        let mut random = Random::new(3);
        let formats = [AtlasFormat::Bc7];
        for longest in [4, 8, 24, 64, 136, 260, 1100] {
            for count in [1, 7, 40] {
                let mut side = || 4 * (1 + random.below(longest / 4) as u32);
                let cover = cover_of((0..count).map(|_| [side(), side()]));
                let shape = AtlasGrid::shape_for(&cover, 1 << 30, &formats, 8192);
                let groups = cover.groups.len() as u32;
                let bundles = (0..SHARED_LEVELS).flat_map(|step| {
                    let count = groups.div_ceil(BUNDLE_TILES[step as usize]);
                    (0..count).map(move |bundle| Parcel::Bundle { bundle, step })
                });
                let pages = (0..groups).flat_map(|group| {
                    let tile = &cover.groups[group as usize];
                    let own = tile.level_count().saturating_sub(SHARED_LEVELS);
                    group_pages(group, tile).filter(move |page| page.level < own).map(Parcel::Page)
                });
                // The coarsest come first, as they do from a streamer.
                let mut extents: Vec<_> = bundles.chain(pages).map(|p| p.layout(&cover).extent).collect();
                extents.retain(|extent| extent[0] > 0);
                extents.sort_by_key(|[columns, rows]| columns * rows);
                let mut packer = Packer::new(shape);
                let needed: u64 = extents.iter().map(|&extent| Outline::WHOLE.texels(extent)).sum();
                assert!((needed as f64) < 0.92 * shape.texels() as f64, "{needed} of {shape:?}");
                assert!(shape.texels() < 7 * needed + (12 << 16), "{needed} of {shape:?}");
                assert!(extents.iter().all(|&extent| packer.take(extent, &Outline::WHOLE).is_some()));
            }
        }
        let cover = cover_of([[1024, 1024]; 64]);
        let shape = AtlasGrid::shape_for(&cover, 16 << 20, &formats, 8192);
        assert_eq!(shape, AtlasShape::within(16 << 20, &formats), "what is allowed is less");
    }

    #[test]
    fn against_rectangles_and_shelves() {
        let Some(pages) = pages() else { return };
        let [stored, all] = [0, 1]
            .map(|i| pages.iter().map(|(e, o)| [o.texels(*e), Outline::WHOLE.texels(*e)][i]).sum::<u64>());
        println!("{} pages, {:.3} of their texels stored", pages.len(), stored as f64 / all as f64);
        let mut packer = Packer::new(AtlasShape { side: 1024, layers: 1 });
        let outlines = churn(
            &pages,
            &mut packer,
            |packer, (extent, outline)| packer.take(*extent, outline),
            |packer, place, (extent, outline)| {
                packer.release_place(place, *extent, outline);
            },
        );
        assert!((0..16).all(|_| packer.take([256, 256], &Outline::WHOLE).is_some()), "all room comes back");
        let mut packer = Packer::new(AtlasShape { side: 1024, layers: 1 });
        let rectangles = churn(
            &pages,
            &mut packer,
            |packer, (extent, _)| packer.take(*extent, &Outline::WHOLE),
            |packer, place, (extent, _)| {
                packer.release_place(place, *extent, &Outline::WHOLE);
            },
        );
        let options = etagere::AllocatorOptions { alignment: etagere::size2(4, 4), ..Default::default() };
        let mut shelves = etagere::AtlasAllocator::with_options(etagere::size2(1024, 1024), &options);
        let shelves = churn(
            &pages,
            &mut shelves,
            |shelves, ([w, h], _)| shelves.allocate(etagere::size2(*w as i32, *h as i32)).map(|a| a.id),
            |shelves, id, _| shelves.deallocate(id),
        );
        println!(
            "share in use when a page finds no room, pages, evictions: outlines {outlines:?}, rectangles {rectangles:?}, \
             shelves {shelves:?}"
        );
        assert!(rectangles.0 > 0.98 * shelves.0 && outlines.1 > rectangles.1);
    }
}
