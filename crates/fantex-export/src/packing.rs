//! Charts as sets of blocks, packed into a square.

use fantex_cover::{SPAN_SLACK, span};
use glam::Vec2;
use rayon::prelude::*;

/// Where a chart lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Place {
    /// Column and row in blocks.
    pub(crate) at: [u32; 2],
    /// Quarter turns, 0 to 3: the first takes (x, y) to (height - y, x).
    pub(crate) turn: u8,
}

/// A set of blocks in a small rectangle, one bit each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mask {
    pub(crate) width: u32,
    pub(crate) height: u32,
    words_per_row: usize,
    words: Vec<u64>,
}

impl Mask {
    fn empty(width: u32, height: u32) -> Self {
        let words_per_row = (width as usize).div_ceil(64);
        Self { width, height, words_per_row, words: vec![0; words_per_row * height as usize] }
    }

    /// The blocks within half a block of any triangle. Corners are in blocks and at least half a block inside the rectangle.
    pub(crate) fn around(width: u32, height: u32, triangles: impl Iterator<Item = [Vec2; 3]>) -> Self {
        let mut mask = Self::empty(width, height);
        triangles.for_each(|corners| mask.add(corners));
        mask
    }

    fn add(&mut self, corners: [Vec2; 3]) {
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c) - 0.5, a.max(b).max(c) + 0.5);
        let first = low.floor().max(Vec2::ZERO).as_uvec2();
        let last = high.floor().max(Vec2::ZERO).as_uvec2();
        for y in first.y..=last.y.min(self.height - 1) {
            // A block is asked for a square that reaches half a block beyond it on all sides.
            let Some([left, right]) =
                span(corners.map(|p| p.to_array()), y as f32 - 0.5 - SPAN_SLACK, y as f32 + 1.5 + SPAN_SLACK)
            else {
                continue;
            };
            let from = first.x.max((left - 2.5).max(0.0) as u32);
            let to = last.x.min(self.width - 1).min((right + 1.5).max(0.0) as u32);
            for x in from..=to {
                let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                if !self.contains(x, y) && touches_square(corners, middle, 1.0) {
                    self.insert(x, y);
                }
            }
        }
    }

    fn insert(&mut self, x: u32, y: u32) {
        self.words[y as usize * self.words_per_row + x as usize / 64] |= 1 << (x % 64);
    }

    pub(crate) fn contains(&self, x: u32, y: u32) -> bool {
        self.words[y as usize * self.words_per_row + x as usize / 64] >> (x % 64) & 1 == 1
    }

    /// The first column from `x` on whose block in row `y` is not in the set; none where all are.
    fn next_free(&self, x: u32, y: u32) -> Option<u32> {
        let row = &self.words[y as usize * self.words_per_row..][..self.words_per_row];
        let mut word = x as usize / 64;
        let mut taken = *row.get(word)? | ((1 << (x % 64)) - 1);
        while taken == u64::MAX {
            word += 1;
            taken = *row.get(word)?;
        }
        Some(64 * word as u32 + taken.trailing_ones()).filter(|&free| free < self.width)
    }

    fn count(&self) -> u64 {
        self.words.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    pub(crate) fn blocks(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.height)
            .flat_map(move |y| (0..self.width).map(move |x| [x, y]))
            .filter(|&[x, y]| self.contains(x, y))
    }

    /// The set after so many quarter turns.
    pub(crate) fn turned(&self, turn: u8) -> Self {
        if turn == 0 {
            return self.clone();
        }
        let (w, h) = (self.width, self.height);
        let [width, height] = if turn.is_multiple_of(2) { [w, h] } else { [h, w] };
        let mut turned = Self::empty(width, height);
        self.blocks().for_each(|[x, y]| match turn {
            1 => turned.insert(h - 1 - y, x),
            2 => turned.insert(w - 1 - x, h - 1 - y),
            _ => turned.insert(y, w - 1 - x),
        });
        turned
    }

    /// Whether in a row of `other`, moved to (x, y), inside `self`, a block is one of `self`'s; if so, the column to which it must be moved at
    /// least before that row may be free.
    fn collision(&self, other: &Mask, row: u32, x: u32, y: u32) -> Option<u32> {
        let (word, shift) = (x as usize / 64, x % 64);
        let own = &self.words[(y + row) as usize * self.words_per_row..][..self.words_per_row];
        let theirs = &other.words[row as usize * other.words_per_row..][..other.words_per_row];
        let last = (0..theirs.len()).rev().find_map(|i| {
            let spilled = if shift == 0 { 0 } else { theirs[i] >> (64 - shift) };
            let high = if spilled == 0 { 0 } else { own[word + i + 1] & spilled };
            let low = own[word + i] & theirs[i] << shift;
            let bit =
                |bits: u64, word: usize| (bits != 0).then(|| 64 * word as u32 + 63 - bits.leading_zeros());
            bit(high, word + i + 1).or_else(|| bit(low, word + i))
        })?;
        // The run of blocks that it is in must begin beyond it.
        Some(last + 1 - other.run_start(last - x, row))
    }

    /// Where the run of blocks begins that the one at (x, y) is in.
    fn run_start(&self, x: u32, y: u32) -> u32 {
        let row = &self.words[y as usize * self.words_per_row..][..self.words_per_row];
        let mut word = x as usize / 64;
        let mut missing = !row[word] & (u64::MAX >> (63 - x % 64));
        while missing == 0 && word > 0 {
            word -= 1;
            missing = !row[word];
        }
        if missing == 0 { 0 } else { 64 * word as u32 + 64 - missing.leading_zeros() }
    }

    /// Adds the blocks of `other`, moved to (x, y), inside `self`.
    fn stamp(&mut self, other: &Mask, x: u32, y: u32) {
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

// ---- Packing masks of blocks into a square.

/// Of more masks than this only the first way around is tried, from where the last one of its size lies: small ones fit anyhow.
const MAX_TURNED: usize = 1_000;

/// Where each mask lies in a square of `side` blocks; none where they do not fit. The largest goes first; what is large is asked in several
/// ways where there are few.
pub(crate) fn pack(masks: &[Mask], side: u32) -> Option<Vec<Place>> {
    let counts: Vec<u64> = masks.iter().map(Mask::count).collect();
    if counts.iter().sum::<u64>() > u64::from(side) * u64::from(side) {
        return None;
    }
    let sizes: [fn(&Mask, u64) -> u64; 3] = [
        |mask, _| u64::from(mask.width) * u64::from(mask.height),
        |_, count| count,
        |mask, _| u64::from(mask.width.max(mask.height)),
    ];
    let orders = if masks.len() <= MAX_TURNED { 0..3 } else { 1..2 };
    sizes[orders].par_iter().find_map_first(|size| {
        let mut order: Vec<usize> = (0..masks.len()).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse(size(&masks[i], counts[i])), i));
        pack_in_order(masks, &counts, &order, side)
    })
}

/// Each mask the way around in which it reaches down least, at the topmost, then leftmost free place. Where one of a size was placed, another
/// one of that size rarely finds a place before it, so each size goes through the square once.
fn pack_in_order(masks: &[Mask], counts: &[u64], order: &[usize], side: u32) -> Option<Vec<Place>> {
    let mut grid = Mask::empty(side, side);
    let mut places = vec![Place::default(); masks.len()];
    // Column and row from which on sizes look for a place.
    let mut starts = [[0, 0]; 64];
    for (number, &i) in order.iter().enumerate() {
        let turns = if number < MAX_TURNED { 4 } else { 1 };
        let turned: Vec<Mask> = (0..turns).map(|turn| masks[i].turned(turn)).collect();
        let start = &mut starts[counts[i].max(1).ilog2() as usize];
        let best = |from: [u32; 2], rows_end: u32| {
            let found = turned.iter().zip(0..).filter_map(|(mask, turn)| {
                find(&grid, mask, from, rows_end).map(|at| (at[1] + mask.height, at[0], Place { at, turn }))
            });
            found.min_by_key(|&(bottom, left, place)| (bottom, left, place.turn)).map(|found| found.2)
        };
        let place = best(*start, side).or_else(|| best([0, 0], start[1] + 1))?;
        *start = match number < MAX_TURNED {
            true => [0, start[1].max(place.at[1])],
            false => place.at,
        };
        grid.stamp(&turned[usize::from(place.turn)], place.at[0], place.at[1]);
        places[i] = place;
    }
    Some(places)
}

/// The first free place from a column and row on whose upper row is before `rows_end`.
fn find(grid: &Mask, mask: &Mask, from: [u32; 2], rows_end: u32) -> Option<[u32; 2]> {
    let (columns, last_row) = (grid.width.checked_sub(mask.width)?, grid.height.checked_sub(mask.height)?);
    let first_column = (0..mask.width).find(|&x| mask.contains(x, 0)).unwrap_or(0);
    // The row that collided last, often does again.
    let mut hint = 0;
    (from[1]..rows_end.min(last_row + 1)).find_map(|y| {
        let mut x = if y == from[1] { from[0] } else { 0 };
        loop {
            // Whatever else collides, the first block of the mask needs a free one.
            x = grid.next_free(x + first_column, y)? - first_column;
            if x > columns {
                return None;
            }
            let rows = std::iter::once(hint).chain(0..mask.height);
            let collision = rows.into_iter().find_map(|row| Some((row, grid.collision(mask, row, x, y)?)));
            let Some((row, next)) = collision else { return Some([x, y]) };
            (hint, x) = (row, next);
        }
    })
}

#[cfg(test)]
mod tests {
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
        let mut random = fantex_base::Random::new(9);
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

    #[test]
    fn free_blocks_are_found_across_words() {
        let mut row = Mask::empty(150, 2);
        (3..140).for_each(|x| row.insert(x, 1));
        let found = [0, 2, 3, 64, 139, 140, 149].map(|x| row.next_free(x, 1));
        assert_eq!(found, [0, 2, 140, 140, 140, 140, 149].map(Some));
        (140..150).for_each(|x| row.insert(x, 1));
        assert_eq!(
            (row.next_free(100, 1), row.next_free(150, 0), row.next_free(149, 0)),
            (None, None, Some(149))
        );
    }

    #[test]
    fn collisions_are_seen_across_words() {
        let mut grid = Mask::empty(200, 4);
        grid.insert(130, 2);
        let mut piece = Mask::empty(70, 2);
        piece.insert(69, 1);
        for x in 0..=130 {
            let next = (x + 69 == 130).then_some(x + 1);
            assert_eq!(grid.collision(&piece, 1, x, 1), next, "{x}");
        }
    }

    /// A row is moved on by as much as it can be, and no more.
    #[test]
    fn rows_go_past_what_they_collide_with() {
        let mut random = fantex_base::Random::new(3);
        for _ in 0..2_000 {
            let (mut grid, mut piece) = (Mask::empty(230, 1), Mask::empty(1 + random.below(140) as u32, 1));
            for (mask, share) in [(&mut grid, 0.1), (&mut piece, 0.9)] {
                (0..mask.width).filter(|_| random.unit() < share).for_each(|x| mask.insert(x, 0));
            }
            let collides = |x: u32| (0..piece.width).any(|i| piece.contains(i, 0) && grid.contains(x + i, 0));
            for x in 0..=grid.width - piece.width {
                let next = grid.collision(&piece, 0, x, 0);
                assert_eq!(next.is_some(), collides(x));
                let skipped = x + 1..next.unwrap_or(x).min(grid.width - piece.width + 1);
                assert!(next.is_none_or(|next| next > x) && skipped.into_iter().all(collides));
            }
        }
    }

    #[test]
    fn squares_that_fill_a_square_are_packed() {
        let masks = vec![rectangle(16, 16); 16];
        let places = pack(&masks, 64).unwrap();
        let mut sorted: Vec<[u32; 2]> = places.iter().map(|place| place.at).collect();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), 16);
        assert!(pack(&[masks, vec![rectangle(1, 1)]].concat(), 64).is_none());
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
        let places = pack(&[rectangle(6, 6), frame], 10).unwrap();
        assert_eq!(places.iter().map(|place| place.at).collect::<Vec<_>>(), [[2, 2], [0, 0]]);
    }

    #[test]
    fn pieces_are_turned_where_they_fit_better() {
        let places: [Place; 2] = pack(&[rectangle(8, 4), rectangle(4, 8)], 8).unwrap().try_into().unwrap();
        assert_eq!(places.map(|place| place.at), [[0, 0], [0, 4]]);
    }

    fn rectangle(width: u32, height: u32) -> Mask {
        let mut mask = Mask::empty(width, height);
        (0..height).for_each(|y| (0..width).for_each(|x| mask.insert(x, y)));
        mask
    }
}
