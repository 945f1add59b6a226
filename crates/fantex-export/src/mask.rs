//! Charts as sets of blocks, a bit each.

use std::ops::Range;

use fantex_cover::{SPAN_SLACK, span};
use glam::{UVec2, Vec2};

use crate::charts::NARROW;

/// A set of blocks in a small rectangle, one bit each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mask {
    pub(crate) width: u32,
    pub(crate) height: u32,
    words_per_row: usize,
    words: Vec<u64>,
}

impl Mask {
    pub(crate) fn empty(width: u32, height: u32) -> Self {
        let words_per_row = (width as usize).div_ceil(64);
        Self { width, height, words_per_row, words: vec![0; words_per_row * height as usize] }
    }

    /// The blocks within half a block of any triangle. Corners are in blocks and at least half a block inside the rectangle.
    pub(crate) fn around(width: u32, height: u32, triangles: impl Iterator<Item = [Vec2; 3]>) -> Self {
        let mut mask = Self::empty(width, height);
        triangles.for_each(|corners| mask.add(corners));
        mask
    }

    /// As [`around`](Self::around), of triangles that lie the same way up, from the sides of these that no other one has the other way around.
    pub(crate) fn within(width: u32, height: u32, border: impl Iterator<Item = [Vec2; 2]>) -> Self {
        let mut mask = Self::empty(width, height);
        // Where the border crosses the middles of rows, and whether it goes up there.
        let mut crossings: Vec<(u32, f32, i32)> = Vec::new();
        for [a, b] in border {
            mask.add([a, b, b]);
            let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
            // Middles from the upper end on, without the lower one.
            let row = |y: f32| (y + 0.5).floor().max(0.0) as u32;
            for y in row(low.y)..row(high.y).min(height) {
                let share = (y as f32 + 0.5 - low.y) / (high.y - low.y);
                crossings.push((y, low.x + share * (high.x - low.x), if a.y < b.y { 1 } else { -1 }));
            }
        }
        crossings.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut winding = 0;
        for pair in crossings.windows(2) {
            let [(y, from, step), (next, end, _)] = [pair[0], pair[1]];
            winding += step;
            let [from, end] = [from, end].map(|x| ((x + 0.5).floor().max(0.0) as u32).min(width));
            if winding != 0 && next == y && from < end {
                mask.insert_run(y, from..end);
            }
        }
        mask
    }

    fn add(&mut self, corners: [Vec2; 3]) {
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c) - 0.5, a.max(b).max(c) + 0.5);
        let first = low.floor().max(Vec2::ZERO).as_uvec2();
        let last = high.floor().max(Vec2::ZERO).as_uvec2().min(UVec2::new(self.width - 1, self.height - 1));
        let is_narrow = last.x < first.x + NARROW;
        for y in first.y..=last.y {
            let (mut from, end) = (first.x, last.x + 1);
            if is_narrow {
                self.add_touched(corners, y, from..end);
                continue;
            }
            let span_between = |top: f32, bottom: f32| span(corners.map(|p| p.to_array()), top, bottom);
            // A block is asked for a square that reaches half a block beyond it on all sides.
            let (top, bottom) = (y as f32 - 0.5 - SPAN_SLACK, y as f32 + 1.5 + SPAN_SLACK);
            let Some([left, right]) = span_between(top, bottom) else { continue };
            from = from.max((left - 2.5).max(0.0) as u32);
            let end = end.min((right + 2.5).max(0.0) as u32);
            // Blocks whose middles lie in the triangle need not be asked.
            let middle = y as f32 + 0.5;
            if let Some([left, right]) = span_between(middle, middle) {
                let inside =
                    ((left + 0.5).max(0.0) as u32).max(from)..((right + 0.5).max(0.0) as u32).min(end);
                if !inside.is_empty() {
                    self.insert_run(y, inside.clone());
                    self.add_touched(corners, y, from..inside.start);
                    from = inside.end;
                }
            }
            self.add_touched(corners, y, from..end);
        }
    }

    /// Adds the blocks of a run within half a block of a triangle.
    fn add_touched(&mut self, corners: [Vec2; 3], y: u32, run: Range<u32>) {
        for x in run {
            let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            if !self.contains(x, y) && touches_square(corners, middle, 1.0) {
                self.insert(x, y);
            }
        }
    }

    /// Adds all blocks of a run.
    fn insert_run(&mut self, y: u32, Range { start, end }: Range<u32>) {
        let row = y as usize * self.words_per_row;
        for word in start / 64..=(end - 1) / 64 {
            let from = start.saturating_sub(64 * word);
            let to = (end - 64 * word).min(64);
            self.words[row + word as usize] |= (u64::MAX << from) & (u64::MAX >> (64 - to));
        }
    }

    pub(crate) fn insert(&mut self, x: u32, y: u32) {
        self.words[y as usize * self.words_per_row + x as usize / 64] |= 1 << (x % 64);
    }

    pub(crate) fn contains(&self, x: u32, y: u32) -> bool {
        self.words[y as usize * self.words_per_row + x as usize / 64] >> (x % 64) & 1 == 1
    }

    fn row(&self, y: u32) -> &[u64] {
        &self.words[y as usize * self.words_per_row..][..self.words_per_row]
    }

    /// The first column from `x` on whose block in row `y` is in the set, or is not.
    fn next(&self, x: u32, y: u32, in_set: bool) -> Option<u32> {
        let flip = if in_set { 0 } else { u64::MAX };
        let row = self.row(y);
        let mut word = x as usize / 64;
        let mut bits = (*row.get(word)? ^ flip) & (u64::MAX << (x % 64));
        while bits == 0 {
            word += 1;
            bits = *row.get(word)? ^ flip;
        }
        Some(64 * word as u32 + bits.trailing_zeros()).filter(|&found| found < self.width)
    }

    pub(crate) fn count(&self) -> u64 {
        self.words.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// Row by row, from left to right.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.height).flat_map(move |y| {
            let words = self.row(y).iter().zip(0u32..);
            words.flat_map(move |(&word, i)| ones(word).map(move |bit| [64 * i + bit, y]))
        })
    }

    /// The set after so many quarter turns, the first of which takes (x, y) to (height - 1 - y, x).
    pub(crate) fn turned(&self, turn: u8) -> Self {
        match turn % 4 {
            0 => self.clone(),
            1 => self.transposed().mirrored(),
            2 => self.upside_down().mirrored(),
            _ => self.transposed().upside_down(),
        }
    }

    /// Rows become columns.
    fn transposed(&self) -> Self {
        let mut transposed = Self::empty(self.height, self.width);
        for top in (0..self.height).step_by(64) {
            for (left, word) in (0..self.width).step_by(64).zip(0..) {
                let mut square = [0; 64];
                for (bits, y) in square.iter_mut().zip(top..self.height) {
                    *bits = self.row(y)[word];
                }
                transpose(&mut square);
                for (bits, y) in square.into_iter().zip(left..self.width) {
                    transposed.words[y as usize * transposed.words_per_row + top as usize / 64] = bits;
                }
            }
        }
        transposed
    }

    /// Left and right change places.
    fn mirrored(mut self) -> Self {
        // What lies behind a row's last column is in front of the first one when bits are reversed.
        let behind = (64 * self.words_per_row) as u32 - self.width;
        for row in self.words.chunks_exact_mut(self.words_per_row.max(1)) {
            row.reverse();
            row.iter_mut().for_each(|word| *word = word.reverse_bits());
            for i in 0..row.len() {
                let next = row.get(i + 1).copied().unwrap_or(0);
                row[i] = if behind == 0 { row[i] } else { (row[i] >> behind) | (next << (64 - behind)) };
            }
        }
        self
    }

    /// The first row becomes the last one.
    fn upside_down(&self) -> Self {
        let rows = self.words.chunks_exact(self.words_per_row.max(1)).rev();
        Self { words: rows.flatten().copied().collect(), ..*self }
    }

    /// The squares of `1 << shift` blocks along each side that hold a block, in a rectangle of so many squares.
    pub(crate) fn coarsened(&self, shift: u32, width: u32, height: u32) -> Self {
        let mut coarse = Self::empty(width, height);
        let squares = self.blocks().map(|at| at.map(|n| n >> shift));
        squares.filter(|&[x, y]| x < width && y < height).for_each(|[x, y]| coarse.insert(x, y));
        coarse
    }

    /// All blocks as runs, in the order in which collisions are likely: long ones first, and far apart.
    pub(crate) fn runs(&self) -> Vec<Run> {
        let mut runs = Vec::new();
        for row in 0..self.height {
            let mut end = 0;
            while let Some(mut start) = self.next(end, row, true) {
                end = self.next(start, row, false).unwrap_or(self.width);
                while start < end {
                    let length = (end - start).min(MAX_RUN);
                    runs.push(Run { row, start, length });
                    start += length;
                }
            }
        }
        runs.sort_by_key(|run| (std::cmp::Reverse(run.length.ilog2()), run.row.reverse_bits()));
        runs
    }

    /// The first of the rows with the longest run of blocks, and that run's length.
    pub(crate) fn longest_run(&self) -> (u32, u32) {
        let longest = |row: u32| self.longest(row, true);
        (0..self.height).map(|row| (row, longest(row))).fold((0, 0), |a, b| if b.1 > a.1 { b } else { a })
    }

    /// The most blocks beside each other in a row that are not in the set.
    pub(crate) fn longest_gap(&self, row: u32) -> u32 {
        self.longest(row, false)
    }

    /// The most blocks beside each other in a row that are in the set, or are not.
    fn longest(&self, row: u32, in_set: bool) -> u32 {
        let (mut longest, mut end) = (0, 0);
        while let Some(start) = self.next(end, row, in_set) {
            end = self.next(start, row, !in_set).unwrap_or(self.width);
            longest = longest.max(end - start);
        }
        longest
    }

    /// 128 blocks of a row from a column on, a bit each, the first one lowest. None lie beyond the row.
    fn window(&self, x: u32, y: u32) -> u128 {
        let row = self.row(y);
        let word = |i: usize| u128::from(row.get(x as usize / 64 + i).copied().unwrap_or(0));
        let low = word(0) | (word(1) << 64);
        match x % 64 {
            0 => low,
            shift => (low >> shift) | (word(2) << (128 - shift)),
        }
    }

    /// The columns among the 64 from `x` on, a bit each, at which a run of a mask collides when the mask's rectangle begins there in row `y`.
    pub(crate) fn collisions(&self, run: Run, x: u32, y: u32) -> u64 {
        let mut taken = self.window(x + run.start, y + run.row);
        let mut length = 1;
        while 2 * length <= run.length {
            taken |= taken >> length;
            length *= 2;
        }
        taken |= taken >> (run.length - length);
        taken as u64
    }

    /// Adds the blocks of `other`, moved to (x, y), inside `self`.
    pub(crate) fn stamp(&mut self, other: &Mask, x: u32, y: u32) {
        let (word, shift) = (x as usize / 64, x % 64);
        for row in 0..other.height as usize {
            let own = &mut self.words[(y as usize + row) * self.words_per_row..][..self.words_per_row];
            let theirs = &other.words[row * other.words_per_row..][..other.words_per_row];
            for (i, &bits) in theirs.iter().enumerate() {
                own[word + i] |= bits << shift;
                let spilled = if shift == 0 { 0 } else { bits >> (64 - shift) };
                if spilled != 0 {
                    own[word + i + 1] |= spilled;
                }
            }
        }
    }
}

/// The places of a word's ones, ascending.
fn ones(mut word: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros();
        word &= word.wrapping_sub(1);
        (bit < 64).then_some(bit)
    })
}

/// Makes the rows of 64 x 64 bits, lowest bits first, its columns (H. S. Warren, "Hacker's Delight", 2nd edition, 2013, section 7-3).
fn transpose(rows: &mut [u64; 64]) {
    let mut width = 32;
    let mut low = u64::from(u32::MAX);
    while width > 0 {
        for i in (0..64).filter(|i| i & width == 0) {
            let changed = ((rows[i] >> width) ^ rows[i + width]) & low;
            rows[i + width] ^= changed;
            rows[i] ^= changed << width;
        }
        width /= 2;
        low ^= low << width;
    }
}

/// Neighbouring blocks of a row of a mask.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    row: u32,
    start: u32,
    /// At most `MAX_RUN`.
    length: u32,
}

/// 64 places of a run meet 127 blocks, which fit 128 bits.
const MAX_RUN: u32 = 64;

/// Whether a triangle meets an axis-parallel square of half side `half`: no side of either separates them.
fn touches_square(corners: [Vec2; 3], middle: Vec2, half: f32) -> bool {
    let q = corners.map(|c| c - middle);
    let (low, high) = (q[0].min(q[1]).min(q[2]), q[0].max(q[1]).max(q[2]));
    if low.max_element() > half || high.min_element() < -half {
        return false;
    }
    (0..3).all(|k| {
        let normal = (q[(k + 1) % 3] - q[k]).perp();
        let reach = half * (normal.x.abs() + normal.y.abs());
        let along = q.map(|p| p.dot(normal));
        along.iter().any(|&d| d <= reach) && along.iter().any(|&d| d >= -reach)
    })
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;

    use super::*;

    #[test]
    fn a_mask_holds_all_blocks_within_half_a_block() {
        let corners = [[0.6, 0.7], [7.2, 0.9], [1.3, 5.8]].map(Vec2::from);
        let mask = Mask::around(9, 8, std::iter::once(corners));
        for i in 0..=200 {
            for j in 0..=(200 - i) {
                let (s, t) = (i as f32 / 200.0, j as f32 / 200.0);
                let p = corners[0] * (1.0 - s - t) + corners[1] * s + corners[2] * t;
                for d in [[-0.5, -0.5], [0.49, -0.5], [-0.5, 0.49], [0.49, 0.49]] {
                    let block = (p + Vec2::from(d)).floor().as_uvec2();
                    assert!(mask.contains(block.x, block.y), "{p} {block}");
                }
            }
        }
        assert!(!mask.contains(8, 7) && !mask.contains(7, 5));
    }

    /// Rows are not looked at where a triangle is not: needles have the blocks that they touch all the same.
    #[test]
    fn a_mask_has_each_block_that_a_triangle_touches() {
        let mut random = Random::new(9);
        for round in 0..200 {
            let mut point = || Vec2::new(random.unit() as f32, random.unit() as f32) * 60.0 + 2.0;
            let [a, b, mut c] = [point(), point(), point()];
            if round % 2 == 0 {
                c = a.lerp(b, 0.7) + Vec2::new(0.003, -0.002);
            }
            let mask = Mask::around(64, 64, std::iter::once([a, b, c]));
            for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
                let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                assert_eq!(
                    mask.contains(x, y),
                    touches_square([a, b, c], middle, 1.0),
                    "{a} {b} {c}: {x} {y}"
                );
            }
        }
    }

    /// A wavy disc with a hole: its border tells as much as its triangles.
    #[test]
    fn a_border_tells_the_blocks_of_the_triangles_within() {
        for round in 0..8u8 {
            let scale = 3.0 + 9.0 * f32::from(round);
            let ring = |i: i32, j: i32| {
                let angle = (i % 90) as f32 / 90.0 * std::f32::consts::TAU;
                let radius = 0.3 + 0.15 * j as f32 + 0.05 * (7.0 * angle).sin() * j as f32;
                (Vec2::from_angle(angle) * radius + 1.2) * scale + 1.0
            };
            let cells = (0..90).flat_map(|i| (0..4).map(move |j| (i, j)));
            let triangles: Vec<[Vec2; 3]> = cells
                .flat_map(|(i, j)| {
                    let [a, b, c, d] = [ring(i, j), ring(i + 1, j), ring(i + 1, j + 1), ring(i, j + 1)];
                    [[a, b, c], [a, c, d]]
                })
                .collect();
            let border = (0..90).flat_map(|i| [[ring(i, 0), ring(i + 1, 0)], [ring(i + 1, 4), ring(i, 4)]]);
            let side = (2.5 * scale) as u32 + 3;
            let expected = Mask::around(side, side, triangles.into_iter());
            assert!(Mask::within(side, side, border) == expected, "scale {scale}");
        }
    }

    #[test]
    fn blocks_are_found_across_words() {
        let mut row = Mask::empty(150, 2);
        (3..140).for_each(|x| row.insert(x, 1));
        let found = [0, 2, 3, 64, 139, 140, 149].map(|x| row.next(x, 1, false));
        assert_eq!(found, [0, 2, 140, 140, 140, 140, 149].map(Some));
        assert_eq!([0, 3, 70, 139].map(|x| row.next(x, 1, true)), [3, 3, 70, 139].map(Some));
        assert_eq!((row.next(140, 1, true), row.next(0, 0, true)), (None, None));
        (140..150).for_each(|x| row.insert(x, 1));
        assert_eq!(row.longest_run(), (1, 147));
        assert_eq!([0, 1].map(|y| row.longest_gap(y)), [150, 3]);
        let ends = [row.next(100, 1, false), row.next(150, 0, false), row.next(149, 0, false)];
        assert_eq!(ends, [None, None, Some(149)]);
        assert!(row.blocks().eq((3..150).map(|x| [x, 1])));
    }

    #[test]
    fn runs_collide_where_one_of_their_blocks_does() {
        let mut random = Random::new(3);
        for _ in 0..500 {
            let (mut grid, mut piece) = (Mask::empty(330, 1), Mask::empty(1 + random.below(140) as u32, 1));
            for (mask, share) in [(&mut grid, 0.1), (&mut piece, 0.9)] {
                (0..mask.width).filter(|_| random.unit() < share).for_each(|x| mask.insert(x, 0));
            }
            let collides = |x: u32| (0..piece.width).any(|i| piece.contains(i, 0) && grid.contains(x + i, 0));
            let runs = piece.runs();
            for x in 0..=grid.width - piece.width {
                let all = runs.iter().fold(0, |all, &run| all | grid.collisions(run, x / 64 * 64, 0));
                assert_eq!(all >> (x % 64) & 1 == 1, collides(x), "{x}");
            }
        }
    }

    #[test]
    fn turned_masks_have_the_blocks_where_turns_take_them() {
        let mut random = Random::new(4);
        let sides = [1, 2, 31, 63, 64, 65, 127, 128, 129, 200];
        for (width, height) in sides.iter().flat_map(|&w| sides.map(|h| (w, h))) {
            let mut mask = Mask::empty(width, height);
            for _ in 0..1 + width * height / 3 {
                mask.insert(random.below(width.into()) as u32, random.below(height.into()) as u32);
            }
            for turn in 0..4 {
                let turned = mask.turned(turn);
                let sides = if turn % 2 == 0 { (width, height) } else { (height, width) };
                assert_eq!((turned.width, turned.height), sides);
                // Nothing lies beyond the rows either.
                assert_eq!(turned.count(), mask.count());
                assert!(mask.blocks().all(|[x, y]| match turn {
                    0 => turned.contains(x, y),
                    1 => turned.contains(height - 1 - y, x),
                    2 => turned.contains(width - 1 - x, height - 1 - y),
                    _ => turned.contains(y, width - 1 - x),
                }));
            }
        }
    }
}
