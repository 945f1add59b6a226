//! The blocks of texels that a chart needs.

use glam::Vec2;

/// A set of blocks in a small rectangle, one bit each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Mask {
    /// Columns in blocks.
    pub(super) width: u32,
    /// Rows in blocks.
    pub(super) height: u32,
    words_per_row: usize,
    words: Vec<u64>,
}

impl Mask {
    /// No block of a rectangle.
    pub(super) fn empty(width: u32, height: u32) -> Self {
        let words_per_row = (width as usize).div_ceil(64);
        Self { width, height, words_per_row, words: vec![0; words_per_row * height as usize] }
    }

    /// The blocks within half a block of any triangle. Corners are in blocks and at least half a block inside the rectangle.
    pub(super) fn around(width: u32, height: u32, triangles: impl Iterator<Item = [Vec2; 3]>) -> Self {
        let mut mask = Self::empty(width, height);
        for corners in triangles {
            mask.add(corners);
        }
        mask
    }

    fn add(&mut self, corners: [Vec2; 3]) {
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c) - 0.5, a.max(b).max(c) + 0.5);
        let first = low.floor().max(Vec2::ZERO).as_uvec2();
        let last = high.floor().max(Vec2::ZERO).as_uvec2();
        for y in first.y..=last.y.min(self.height - 1) {
            for x in first.x..=last.x.min(self.width - 1) {
                let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                if !self.contains(x, y) && touches_square(corners, middle, 1.0) {
                    self.insert(x, y);
                }
            }
        }
    }

    pub(super) fn insert(&mut self, x: u32, y: u32) {
        self.words[y as usize * self.words_per_row + x as usize / 64] |= 1 << (x % 64);
    }

    pub(super) fn contains(&self, x: u32, y: u32) -> bool {
        self.words[y as usize * self.words_per_row + x as usize / 64] >> (x % 64) & 1 == 1
    }

    /// Number of blocks.
    pub(super) fn count(&self) -> u64 {
        self.words.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// All its blocks.
    pub(super) fn blocks(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..self.height)
            .flat_map(move |y| (0..self.width).map(move |x| [x, y]))
            .filter(|&[x, y]| self.contains(x, y))
    }

    /// Whether a block of `self` is one of `other`'s, moved to (x, y), inside `self`.
    pub(super) fn collides(&self, other: &Mask, x: u32, y: u32) -> bool {
        let (word, shift) = (x as usize / 64, x % 64);
        (0..other.height as usize).any(|row| {
            let own = &self.words[(y as usize + row) * self.words_per_row..][..self.words_per_row];
            let theirs = &other.words[row * other.words_per_row..][..other.words_per_row];
            theirs.iter().enumerate().any(|(i, &bits)| {
                let spilled = if shift == 0 { 0 } else { bits >> (64 - shift) };
                own[word + i] & bits << shift != 0 || spilled != 0 && own[word + i + 1] & spilled != 0
            })
        })
    }

    /// Adds the blocks of `other`, moved to (x, y), inside `self`.
    pub(super) fn stamp(&mut self, other: &Mask, x: u32, y: u32) {
        other.blocks().for_each(|[i, j]| self.insert(x + i, y + j));
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

    #[test]
    fn collisions_are_seen_across_words() {
        let mut grid = Mask::empty(200, 4);
        grid.insert(130, 2);
        let mut piece = Mask::empty(70, 2);
        piece.insert(69, 1);
        for x in 0..=130 {
            assert_eq!(grid.collides(&piece, x, 1), x + 69 == 130, "{x}");
        }
    }
}
