//! Charts, as sets of blocks, packed into a picture.

use std::borrow::Cow;
use std::cmp::Reverse;
use std::ops::Range;

use fantex_bake::Progress;
use fantex_base::Random;
use rayon::prelude::*;

use crate::mask::{Mask, Run};

/// Where a chart lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Place {
    /// Column and row in blocks.
    pub(crate) at: [u32; 2],
    /// Quarter turns, 0 to 3: the first takes (x, y) to (height - y, x).
    pub(crate) turn: u8,
}

/// Of more masks than this only the first way around is tried, from where the last one of its size lies: small ones fit anyhow.
const MAX_TURNED: usize = 1_000;

/// Masks beside each other, about, in a strip of the square, which small ones fill strip by strip: so those that follow each other lie together,
/// and levels mix their colours, not those of a whole row.
const STRIP_MASKS: u32 = 8;

/// Tests of a run at 64 places after which a square is coarsened: a bound for charts that are tried at many places of a large picture, of
/// which hardly any is free. Some 240 long spirals in 2048 columns take a twelfth.
const MAX_TESTS: u64 = 1 << 24;

/// Squares of no more columns are not coarsened.
const MIN_COARSE_SIDE: u32 = 256;

/// The largest side, in blocks, of a square whose masks are kept in all four turns and packed in other orders than by size.
const MAX_ORDERED_SIDE: u32 = 2048;

/// Whether so many masks in a picture of so many columns and rows are worth a try in other orders than by size.
pub(crate) fn are_few(count: usize, [columns, rows]: [u32; 2]) -> bool {
    (2..=MAX_TURNED).contains(&count) && columns.max(rows) <= MAX_ORDERED_SIDE
}

/// Whether so many masks fill strips of the square, in the order that they are given where they are of one size.
pub(crate) fn has_strips(count: usize) -> bool {
    count > MAX_TURNED
}

/// What is to be packed.
pub(crate) struct Masks {
    masks: Vec<Mask>,
    /// Blocks of each.
    counts: Vec<u64>,
    /// Each in all four turns, where there are few; else none.
    pieces: Vec<Vec<Piece<'static>>>,
    /// Columns and rows of the picture.
    size: [u32; 2],
}

impl Masks {
    /// For a picture of so many columns and rows of blocks.
    pub(crate) fn new(masks: Vec<Mask>, size: [u32; 2]) -> Self {
        let counts = masks.iter().map(Mask::count).collect();
        let masks = Self { masks, counts, pieces: Vec::new(), size };
        if are_few(masks.masks.len(), size) && masks.may_fit() { masks.in_all_turns() } else { masks }
    }

    /// Few of them, for pictures of any size.
    pub(crate) fn few(masks: Vec<Mask>) -> Self {
        let counts = masks.iter().map(Mask::count).collect();
        Self { masks, counts, pieces: Vec::new(), size: [u32::MAX; 2] }.in_all_turns()
    }

    fn in_all_turns(self) -> Self {
        let all_turns = |mask: &Mask| (0..4).map(|turn| Piece::new(mask.turned(turn), turn)).collect();
        Self { pieces: self.masks.par_iter().map(all_turns).collect(), ..self }
    }

    /// Blocks of all of them.
    pub(crate) fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// False where they have more blocks than the picture.
    fn may_fit(&self) -> bool {
        self.count() <= area(self.size)
    }

    /// Columns and rows of the largest mask.
    pub(crate) fn largest(&self) -> [u32; 2] {
        let sizes = self.masks.iter().map(|mask| [mask.width, mask.height]);
        sizes.max_by_key(|&[width, height]| (width.max(height), width.min(height))).unwrap_or_default()
    }

    /// Columns and rows that they take where they lie.
    fn box_of(&self, places: &[Place]) -> [u32; 2] {
        let corners = (0..).zip(places).map(|(index, &place)| self.corner(index, place));
        corners.fold([0; 2], |all, corner| [all[0].max(corner[0]), all[1].max(corner[1])])
    }

    /// The first column and row behind one of them.
    fn corner(&self, index: usize, Place { at, turn }: Place) -> [u32; 2] {
        let mask = &self.masks[index];
        let [width, height] =
            if turn % 2 == 0 { [mask.width, mask.height] } else { [mask.height, mask.width] };
        [at[0] + width, at[1] + height]
    }

    /// One of them the first so many ways around, at the resolution of a packing.
    fn pieces(&self, index: usize, turns: u8, shift: u32) -> Vec<Piece<'_>> {
        if let Some(pieces) = self.pieces.get(index).filter(|_| shift == 0) {
            return pieces[..usize::from(turns)].iter().map(Piece::borrowed).collect();
        }
        let coarse = |turn: u8| {
            let mask = self.masks[index].turned(turn);
            let [width, height] = [mask.width, mask.height].map(|blocks| blocks.div_ceil(1 << shift));
            if shift == 0 { mask } else { mask.coarsened(shift, width, height) }
        };
        (0..turns).map(|turn| Piece::new(coarse(turn), turn)).collect()
    }

    /// As they lie in a packing, in their order.
    pub(crate) fn placed(self, places: &[Place]) -> Vec<Mask> {
        self.masks.iter().zip(places).map(|(mask, place)| mask.turned(place.turn)).collect()
    }
}

/// Sequences in which masks are packed: the large ones first, whatever large means; later those first for which there was no room.
pub(crate) struct Orders(Vec<(Vec<usize>, Random)>);

impl Orders {
    pub(crate) fn by_size(masks: &Masks) -> Self {
        let sizes: [fn(&Mask, u64) -> u64; 3] = [
            |mask, _| u64::from(mask.width) * u64::from(mask.height),
            |_, count| count,
            |mask, _| u64::from(mask.width.max(mask.height)),
        ];
        let used = if has_strips(masks.masks.len()) { 1..2 } else { 0..3 };
        let mut orders: Vec<(Vec<usize>, Random)> = Vec::new();
        for size in &sizes[used] {
            let mut order: Vec<usize> = (0..masks.masks.len()).collect();
            order.sort_by_key(|&i| (Reverse(size(&masks.masks[i], masks.counts[i])), i));
            // One that is there already would become the same packings.
            if orders.iter().all(|(known, _)| *known != order) {
                orders.push((order, Random::new(0)));
            }
        }
        Self(orders)
    }

    /// This one alone.
    pub(crate) fn only(order: Vec<usize>) -> Self {
        Self(vec![(order, Random::new(0))])
    }

    /// And this one.
    pub(crate) fn and(mut self, order: Vec<usize>) -> Self {
        self.0.push((order, Random::new(0)));
        self
    }
}

/// Blocks of a picture.
fn area([columns, rows]: [u32; 2]) -> u64 {
    u64::from(columns) * u64::from(rows)
}

/// Where each mask lies in the picture; none where they do not fit in any of the orders, each of which is changed and tried again so many
/// times unless `progress` is cancelled: what found no room comes earlier then, at a place by chance. What is large is asked in several turns
/// where there are few.
pub(crate) fn pack(
    masks: &Masks,
    orders: &mut Orders,
    changes: usize,
    progress: &dyn Progress,
) -> Option<Vec<Place>> {
    if !masks.may_fit() {
        return None;
    }
    let in_order = |(order, random): &mut (Vec<usize>, Random)| {
        let mut filled = Filled::none(order.len());
        // Rows hold a little more now and then.
        if has_strips(order.len()) {
            let mut packing = Packing { has_strips: true, ..Packing::new(masks.size, MAX_TESTS) };
            if packing.fill(masks, order, &mut filled).is_ok() {
                return Some(filled.places);
            }
            filled.kept = 0;
        }
        for change in 0..=changes {
            match Packing::new(masks.size, MAX_TESTS).fill(masks, order, &mut filled) {
                Ok(()) => return Some(filled.places),
                Err(number) if number > 0 && change < changes && !progress.is_cancelled() => {
                    filled.kept = filled.kept.min(bring_forward(order, number, random));
                }
                Err(_) => return None,
            }
        }
        None
    };
    // The others to their end, so that they are the same on any number of threads.
    let (first, others) = orders.0.split_first_mut()?;
    if let Some(places) = in_order(first) {
        return Some(places);
    }
    let packed: Vec<_> = others.par_iter_mut().map(in_order).collect();
    let (number, places) = (1..).zip(packed).find_map(|(number, places)| Some((number, places?)))?;
    // What fits one density is likely to fit the next.
    orders.0[..=number].rotate_right(1);
    Some(places)
}

/// Brings what found no room to a place by chance before. Returns how many before that stay as they are.
fn bring_forward(order: &mut [usize], number: usize, random: &mut Random) -> usize {
    let first = random.below(number as u64) as usize;
    order[first..=number].rotate_right(1);
    first
}

/// Where masks lie in a picture.
struct Filled {
    places: Vec<Place>,
    /// So many, the first ones in the order, lie where they would in the next picture, too.
    kept: usize,
}

impl Filled {
    fn none(count: usize) -> Self {
        Self { places: vec![Place::default(); count], kept: 0 }
    }
}

/// Where masks lie in a box around them.
#[derive(Clone, Debug)]
pub(crate) struct Boxed {
    /// Columns and rows of the box.
    pub(crate) size: [u32; 2],
    pub(crate) places: Vec<Place>,
    /// The sequence in which they were packed.
    pub(crate) order: Vec<usize>,
}

impl Boxed {
    pub(crate) fn area(&self) -> u64 {
        area(self.size)
    }
}

/// A box is worth changing orders for while it gets smaller by this share.
const SHRUNK: f64 = 0.005;

/// The smallest box found around the masks in so many columns and at most so many rows; none where they do not fit. Each of the orders is
/// changed so many times before it is given up: what reaches below the smallest box so far comes earlier.
pub(crate) fn pack_tightly(
    masks: &Masks,
    [columns, rows]: [u32; 2],
    orders: Orders,
    changes: usize,
    progress: &dyn Progress,
) -> Option<Boxed> {
    let mut best: Option<Boxed> = None;
    for (mut order, mut random) in orders.0 {
        let (mut change, mut filled) = (0, Filled::none(order.len()));
        while change <= changes && !progress.is_cancelled() {
            let rows = match &best {
                Some(best) => (best.area() as f64 * (1.0 - SHRUNK) / f64::from(columns)) as u32,
                None => rows,
            };
            let reaches_below = |&i: &usize| masks.corner(i, filled.places[i])[1] > rows;
            let below = order[..filled.kept].iter().position(reaches_below);
            filled.kept = below.unwrap_or(filled.kept);
            match Packing::new([columns, rows], MAX_TESTS).fill(masks, &order, &mut filled) {
                Ok(()) => {
                    let places = filled.places.clone();
                    best = Some(Boxed { size: masks.box_of(&places), places, order: order.clone() });
                    change = 0;
                    continue;
                }
                Err(0) => break,
                Err(number) => {
                    filled.kept = filled.kept.min(bring_forward(&mut order, number, &mut random));
                }
            }
            change += 1;
        }
    }
    best
}

/// A mask turned so many times, at the resolution of a packing.
struct Piece<'a> {
    turn: u8,
    mask: Cow<'a, Mask>,
    /// Row and length of its longest run.
    longest: (u32, u32),
    /// The run that collided last comes first: it often does again.
    runs: Vec<Run>,
}

impl Piece<'_> {
    fn new(mask: Mask, turn: u8) -> Self {
        let (longest, runs) = (mask.longest_run(), mask.runs());
        Self { turn, mask: Cow::Owned(mask), longest, runs }
    }

    fn borrowed(&self) -> Piece<'_> {
        Piece { mask: Cow::Borrowed(&self.mask), runs: self.runs.clone(), ..*self }
    }
}

/// A picture that is filled mask by mask.
struct Packing {
    grid: Mask,
    /// The most free blocks beside each other in each row.
    gaps: Vec<u32>,
    /// A block of the grid stands for `1 << shift` blocks along each side.
    shift: u32,
    /// Tests of a run at 64 places, and those before the grid was coarsened last.
    tests: u64,
    earlier_tests: u64,
    /// Tests after which the grid is coarsened.
    max_tests: u64,
    /// Whether small masks fill strips, not rows.
    has_strips: bool,
}

impl Packing {
    fn new([columns, rows]: [u32; 2], max_tests: u64) -> Self {
        let (grid, gaps) = (Mask::empty(columns, rows), vec![columns; rows as usize]);
        Self { grid, gaps, shift: 0, tests: 0, earlier_tests: 0, max_tests, has_strips: false }
    }

    /// Each mask the way around in which it reaches down least, at the topmost, then leftmost free place. Where one of a size was placed, another
    /// one of that size rarely finds a place before it, so each size goes through the square once. Small ones may do so strip by strip.
    ///
    /// Where that takes too many tests, the remaining masks lie at every second column and row, then at every fourth, and so on.
    ///
    /// What is kept in `filled` lies there already; afterwards it has all that was placed.
    ///
    /// # Errors
    /// The number in the order of the mask for which there is no place.
    fn fill(&mut self, masks: &Masks, order: &[usize], filled: &mut Filled) -> Result<(), usize> {
        let Filled { places, kept } = filled;
        // Column and row from which on sizes look for a place.
        let mut starts = [[0u32; 2]; 64];
        let class = |i: usize| masks.counts[i].max(1).ilog2() as usize;
        for &i in &order[..*kept] {
            let Place { at, turn } = places[i];
            self.grid.stamp(&masks.pieces[i][usize::from(turn)].mask, at[0], at[1]);
            let row = &mut starts[class(i)][1];
            *row = (*row).max(at[1]);
        }
        if *kept > 0 {
            self.find_gaps();
        }
        for (number, &i) in order.iter().enumerate().skip(*kept) {
            let turns = if number < MAX_TURNED { 4 } else { 1 };
            let class = class(i);
            let place = loop {
                let start = starts[class];
                let mut pieces = masks.pieces(i, turns, self.shift);
                let columns = match self.has_strips && number >= MAX_TURNED {
                    true => self.strip_columns(class),
                    false => self.grid.width,
                };
                let found = self.find_in_strips(&mut pieces, start, columns);
                if let Some(place) = found {
                    self.stamp(&pieces[usize::from(place.turn)].mask, place.at);
                    break place;
                }
                if !self.is_spent() {
                    return Err(number);
                }
                self.coarsen();
                *kept = 0;
                starts = starts.map(|start| start.map(|n| n / 2));
            };
            starts[class] = match number < MAX_TURNED {
                true => [0, starts[class][1].max(place.at[1])],
                false => place.at,
            };
            places[i] = Place { at: place.at.map(|n| n << self.shift), turn: place.turn };
            if self.shift == 0 && !masks.pieces.is_empty() {
                *kept = number + 1;
            }
        }
        Ok(())
    }

    /// The free place from a column and row on, or before them, in strips of so many columns, each from above.
    fn find_in_strips(&mut self, pieces: &mut [Piece<'_>], start: [u32; 2], columns: u32) -> Option<Place> {
        let Mask { width, height, .. } = self.grid;
        let current = start[0] / columns;
        let onwards = (current..width.div_ceil(columns)).map(|number| (number, number == current, height));
        let before = (0..=current)
            .map(|number| (number, false, if number == current { start[1] + 1 } else { height }));
        for (number, is_begun, rows_end) in onwards.chain(before) {
            let strip = number * columns..((number + 1) * columns).min(width);
            let from = if is_begun { start } else { [strip.start, 0] };
            let found = self.find(pieces, from, strip, rows_end);
            if found.is_some() || self.is_spent() {
                return found;
            }
        }
        None
    }

    /// Columns of the strips of a size, at the resolution of the grid.
    fn strip_columns(&self, class: usize) -> u32 {
        (STRIP_MASKS << (class / 2) >> self.shift).max(64)
    }

    /// The free place from a column and row on whose lower edge is topmost, then the leftmost one. It begins in one of some columns, and in a
    /// row before `rows_end`. None, too, where the tests are spent.
    fn find(
        &mut self,
        pieces: &mut [Piece<'_>],
        from: [u32; 2],
        columns: Range<u32>,
        rows_end: u32,
    ) -> Option<Place> {
        // All pieces go down in step, so that none is looked for below another one's place.
        for bottom in from[1] + 1..=self.grid.height {
            let mut best: Option<Place> = None;
            for piece in pieces.iter_mut() {
                let top = bottom.checked_sub(piece.mask.height);
                let Some(y) = top.filter(|y| (from[1]..rows_end).contains(y)) else { continue };
                let (row, length) = piece.longest;
                if self.gaps[(y + row) as usize] < length {
                    continue;
                }
                let first = if y == from[1] { from[0] } else { columns.start };
                if let Some(x) = self.find_in_row(piece, first..columns.end, y)
                    && best.is_none_or(|place| x < place.at[0])
                {
                    best = Some(Place { at: [x, y], turn: piece.turn });
                }
            }
            if best.is_some() || self.is_spent() {
                return best;
            }
        }
        None
    }

    /// The first free one of some columns.
    fn find_in_row(&mut self, piece: &mut Piece<'_>, columns: Range<u32>, y: u32) -> Option<u32> {
        let Range { start: from, end } = columns;
        let last = self.grid.width.checked_sub(piece.mask.width)?.min(end - 1);
        if from > last {
            return None;
        }
        (from / 64..=last / 64).find_map(|word| {
            let mut free = u64::MAX;
            if word == from / 64 {
                free &= u64::MAX << (from % 64);
            }
            if word == last / 64 {
                free &= u64::MAX >> (63 - last % 64);
            }
            for i in 0..piece.runs.len() {
                free &= !self.grid.collisions(piece.runs[i], 64 * word, y);
                self.tests += 1;
                if free == 0 {
                    piece.runs[..=i].rotate_right(1);
                    return None;
                }
            }
            (free != 0).then(|| 64 * word + free.trailing_zeros())
        })
    }

    fn stamp(&mut self, mask: &Mask, [x, y]: [u32; 2]) {
        self.grid.stamp(mask, x, y);
        for row in y..y + mask.height {
            self.gaps[row as usize] = self.grid.longest_gap(row);
        }
    }

    fn is_spent(&self) -> bool {
        self.tests - self.earlier_tests > self.max_tests && self.grid.width > MIN_COARSE_SIDE
    }

    fn coarsen(&mut self) {
        self.grid = self.grid.coarsened(1, self.grid.width / 2, self.grid.height / 2);
        self.find_gaps();
        self.shift += 1;
        self.earlier_tests = self.tests;
    }

    fn find_gaps(&mut self) {
        self.gaps.clear();
        self.gaps.extend((0..self.grid.height).map(|row| self.grid.longest_gap(row)));
    }
}

#[cfg(test)]
mod tests {
    use fantex_bake::NoProgress;
    use glam::Vec2;

    use super::*;

    fn scattered(random: &mut fantex_base::Random, max_side: u64) -> Mask {
        let [width, height] = [random.below(max_side), random.below(max_side)].map(|n| 1 + n as u32);
        let mut mask = Mask::empty(width, height);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            if random.unit() < 0.4 {
                mask.insert(x, y);
            }
        }
        mask.insert(0, 0);
        mask
    }

    #[test]
    fn masks_lie_at_the_first_free_place() {
        let mut random = fantex_base::Random::new(8);
        for _ in 0..20 {
            let mut packing = Packing::new([90; 2], MAX_TESTS);
            for _ in 0..40 {
                let mask = scattered(&mut random, 80);
                let is_free = |grid: &Mask, piece: &Mask, x: u32, y: u32| {
                    x + piece.width <= 90
                        && y + piece.height <= 90
                        && piece.blocks().all(|[i, j]| !grid.contains(x + i, y + j))
                };
                let from = [random.below(90) as u32, random.below(20) as u32];
                let rows_end = random.below(91) as u32;
                let mut expected = None;
                for turn in 0..4 {
                    let piece = mask.turned(turn);
                    let first = (from[1]..rows_end)
                        .flat_map(|y| (0..90).map(move |x| (y, x)))
                        .find(|&(y, x)| (y, x) >= (from[1], from[0]) && is_free(&packing.grid, &piece, x, y));
                    let key = first.map(|(y, x)| (y + piece.height, x, turn, y));
                    expected = [expected, key].into_iter().flatten().min();
                }
                let mut pieces = [0, 1, 2, 3].map(|turn| Piece::new(mask.turned(turn), turn));
                let found = packing.find(&mut pieces, from, 0..90, rows_end);
                let expected = expected.map(|(_, x, turn, y)| Place { at: [x, y], turn });
                assert_eq!(found, expected);
                if let Some(place) = found {
                    packing.stamp(&pieces[usize::from(place.turn)].mask, place.at);
                }
            }
        }
    }

    /// All masks lie inside the picture, and no two of them share a block.
    fn assert_apart(masks: &[Mask], places: &[Place], [columns, rows]: [u32; 2]) {
        let mut grid = Mask::empty(columns, rows);
        for (mask, place) in masks.iter().zip(places) {
            for [x, y] in mask.turned(place.turn).blocks() {
                let [x, y] = [x + place.at[0], y + place.at[1]];
                assert!(x < columns && y < rows && !grid.contains(x, y), "{place:?}: {x} {y}");
                grid.insert(x, y);
            }
        }
    }

    #[test]
    fn masks_of_a_coarsened_square_lie_apart() {
        let mut random = fantex_base::Random::new(5);
        let masks: Vec<Mask> = (0..60).map(|_| scattered(&mut random, 75)).collect();
        let masks = Masks::new(masks, [1024; 2]);
        let order: Vec<usize> = (0..60).collect();
        for max_tests in [0, 3_000, 30_000] {
            let mut packing = Packing::new([1024; 2], max_tests);
            let mut filled = Filled::none(60);
            packing.fill(&masks, &order, &mut filled).unwrap();
            assert_apart(&masks.masks, &filled.places, [1024; 2]);
            assert_eq!(packing.grid.width << packing.shift, 1024);
            if max_tests == 0 {
                assert_eq!(packing.grid.width, MIN_COARSE_SIDE);
            }
        }
    }

    /// A band two blocks wide, and half a block beyond on both sides, in two and a half turns of a spiral.
    fn spiral(radius: f32, phase: f32) -> Mask {
        let steps = 200u32;
        let point = |i: u32, width: f32| {
            let share = i as f32 / steps as f32;
            let out = Vec2::from_angle(phase + share * 2.5 * std::f32::consts::TAU);
            (0.15 + 0.85 * share) * radius * out + width * out + radius + 4.0
        };
        let bands = (0..steps).flat_map(|i| {
            let [a, b, c, d] = [point(i, -1.0), point(i + 1, -1.0), point(i + 1, 1.0), point(i, 1.0)];
            [[a, b, c], [a, c, d]]
        });
        let side = (2.0 * radius + 8.0).ceil() as u32;
        Mask::around(side, side, bands)
    }

    /// Whether they fit or not: half of what is asserted, and far from `MAX_TESTS`.
    #[test]
    fn long_curly_masks_take_a_bounded_number_of_tests() {
        for (radius, fits) in [(22.0, true), (40.0, false), (70.0, false)] {
            let masks: Vec<Mask> = (0..240)
                .map(|i| spiral(radius * (1.0 - 0.1 * (i % 7) as f32 / 7.0), 0.7 * i as f32))
                .collect();
            let masks = Masks::new(masks, [1024; 2]);
            let order: Vec<usize> = (0..240).collect();
            let mut packing = Packing::new([1024; 2], MAX_TESTS);
            let mut filled = Filled::none(240);
            let result = packing.fill(&masks, &order, &mut filled);
            assert!(packing.tests < 1 << 20, "radius {radius}: {} tests", packing.tests);
            assert!(result.is_ok() || !fits);
            if result.is_ok() {
                assert_apart(&masks.masks, &filled.places, [1024; 2]);
            }
        }
    }

    /// Whatever the orders become, masks lie apart, and what fits in one of the first orders still does.
    #[test]
    fn other_orders_fill_a_square_more() {
        let mut random = Random::new(2);
        let mut fuller = 0;
        for _ in 0..12 {
            let masks = (0..30).map(|_| {
                let [width, height] = [random.below(20), random.below(20)].map(|n| 4 + n as u32);
                rectangle(width, height)
            });
            let masks: Vec<Mask> = masks.collect();
            let least_side = |changes: usize| {
                let fits = |&side: &u32| {
                    let masks = Masks::new(masks.clone(), [side; 2]);
                    let places = pack(&masks, &mut Orders::by_size(&masks), changes, &NoProgress);
                    places.iter().for_each(|places| assert_apart(&masks.masks, places, [side; 2]));
                    places.is_some()
                };
                (60..200).find(fits).unwrap()
            };
            let [by_size, changed] = [0, 40].map(least_side);
            assert!(changed <= by_size);
            fuller += u32::from(changed < by_size);
        }
        assert!(fuller >= 8, "{fuller} of 12");
    }

    /// What is kept lies where it would come to lie again, and so does all that follows.
    #[test]
    fn masks_that_are_kept_lie_where_they_would() {
        let mut random = Random::new(6);
        let masks = Masks::few((0..40).map(|_| scattered(&mut random, 30)).collect());
        let mut order: Vec<usize> = (0..40).collect();
        let (mut filled, mut kept) = (Filled::none(40), 0);
        for _ in 0..30 {
            let mut anew = Filled::none(40);
            let expected = Packing::new([70; 2], MAX_TESTS).fill(&masks, &order, &mut anew);
            kept += filled.kept;
            assert_eq!(Packing::new([70; 2], MAX_TESTS).fill(&masks, &order, &mut filled), expected);
            let number = expected.unwrap_err();
            assert!((filled.kept, anew.kept) == (number, number));
            assert!(order[..number].iter().all(|&i| filled.places[i] == anew.places[i]));
            filled.kept = bring_forward(&mut order, number, &mut random);
        }
        assert!(kept > 0);
    }

    /// Rectangles and scattered blocks lie apart in their box, which other orders make smaller.
    #[test]
    fn masks_lie_apart_in_small_boxes() {
        let (mut random, mut areas) = (Random::new(11), [0; 2]);
        for round in 0..30 {
            let masks: Vec<Mask> = (0..1 + round)
                .map(|_| match random.unit() < 0.5 {
                    true => scattered(&mut random, 40),
                    false => rectangle(1 + random.below(30) as u32, 1 + random.below(30) as u32),
                })
                .collect();
            let masks = Masks::few(masks);
            let columns = 30 + random.below(100) as u32;
            let boxes = [0, 10].map(|changes| {
                let orders = Orders::by_size(&masks);
                pack_tightly(&masks, [columns, 2_000], orders, changes, &NoProgress)
            });
            // One that is longer than the columns fits turned, or not at all.
            let [Some(by_size), Some(changed)] = boxes else { continue };
            for boxed in [&by_size, &changed] {
                assert!(boxed.size[0] <= columns && boxed.size[1] <= 2_000);
                assert_apart(&masks.masks, &boxed.places, boxed.size);
            }
            areas = [areas[0] + by_size.area(), areas[1] + changed.area()];
        }
        assert!(areas[0] > 0 && 100 * areas[1] < 99 * areas[0], "{areas:?}");
    }

    fn packed(masks: &[Mask], side: u32) -> Option<Vec<Place>> {
        let masks = Masks::new(masks.to_vec(), [side; 2]);
        pack(&masks, &mut Orders::by_size(&masks), 0, &NoProgress)
    }

    /// A row of the square would hold 128 of them.
    #[test]
    fn small_masks_that_follow_each_other_lie_together() {
        let masks = vec![rectangle(4, 3); 8_000];
        let places = packed(&masks, 512).unwrap();
        assert_apart(&masks, &places, [512; 2]);
        let runs = places[MAX_TURNED..].chunks(32);
        let is_together = |run: &&[Place]| {
            (0..2).all(|i| {
                let at = || run.iter().map(|place| place.at[i]);
                at().max().unwrap() - at().min().unwrap() < 64
            })
        };
        let (all, together) = (runs.len(), runs.filter(is_together).count());
        assert!(10 * together > 9 * all, "{together} of {all}");
    }

    #[test]
    fn squares_that_fill_a_square_are_packed() {
        let masks = vec![rectangle(16, 16); 16];
        let places = packed(&masks, 64).unwrap();
        let mut sorted: Vec<[u32; 2]> = places.iter().map(|place| place.at).collect();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), 16);
        assert!(packed(&[masks, vec![rectangle(1, 1)]].concat(), 64).is_none());
    }

    #[test]
    fn a_small_piece_goes_into_the_hollow_of_a_large_one() {
        let mut frame = rectangle(10, 10);
        frame = {
            let mut hollow = Mask::empty(10, 10);
            frame
                .blocks()
                .filter(|&[x, y]| x < 2 || y < 2 || x > 7 || y > 7)
                .for_each(|[x, y]| hollow.insert(x, y));
            hollow
        };
        let places = packed(&[rectangle(6, 6), frame], 10).unwrap();
        assert_eq!(places.iter().map(|place| place.at).collect::<Vec<_>>(), [[2, 2], [0, 0]]);
    }

    #[test]
    fn pieces_are_turned_where_they_fit_better() {
        let places: [Place; 2] = packed(&[rectangle(8, 4), rectangle(4, 8)], 8).unwrap().try_into().unwrap();
        assert_eq!(places.map(|place| place.at), [[0, 0], [0, 4]]);
    }

    fn rectangle(width: u32, height: u32) -> Mask {
        let mut mask = Mask::empty(width, height);
        (0..height).for_each(|y| (0..width).for_each(|x| mask.insert(x, y)));
        mask
    }
}
