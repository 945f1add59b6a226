//! Which bytes of the file are free.
//!
//! ```text
//!  used --superseded by commit r--> retired at r --reclaim--> free --allocate--> used
//!                    both header slots name generations >= r, and no reader an older one
//! ```

use std::collections::BTreeMap;
use std::ops::Range;

use crate::directory::ALIGNMENT;
use crate::header::HEADER_BYTES;

/// Free and superseded parts of the file, in multiples of [`ALIGNMENT`].
#[derive(Clone, Debug, Default)]
pub(super) struct Space {
    /// Start and end of what may be overwritten, apart from each other.
    free: BTreeMap<u64, u64>,
    /// What generations before the given one name.
    retired: Vec<(u64, Range<u64>)>,
    end: u64,
    /// Length that a header slot records: the file must not get shorter.
    floor: u64,
    /// What no commit changes: its blocks are never free, even where a superseded part shares one.
    fixed: Vec<Range<u64>>,
}

/// The aligned range that holds some bytes.
pub(super) fn padded(range: &Range<u64>) -> Range<u64> {
    range.start / ALIGNMENT * ALIGNMENT..range.end.next_multiple_of(ALIGNMENT)
}

/// Aligned ranges, ascending.
pub(super) fn padded_in_order(ranges: &[Range<u64>]) -> Vec<Range<u64>> {
    let mut padded: Vec<_> = ranges.iter().map(padded).collect();
    padded.sort_unstable_by_key(|range| range.start);
    padded
}

/// The aligned parts of a range that none of the ranges `fixed`, aligned and ascending, covers.
pub(super) fn without_fixed(range: &Range<u64>, fixed: &[Range<u64>]) -> Vec<Range<u64>> {
    let Range { mut start, end } = padded(range);
    let mut parts = Vec::new();
    for fixed in fixed {
        if start < fixed.start.min(end) {
            parts.push(start..fixed.start.min(end));
        }
        start = start.max(fixed.end);
    }
    if start < end {
        parts.push(start..end);
    }
    parts
}

impl Space {
    /// The space of a file of `length` bytes. `used`: what a header slot names; `fixed`: what of that no commit changes. All
    /// else may be in use by readers of generations before `generation`.
    pub(super) fn new(
        length: u64,
        fixed: &[Range<u64>],
        used: impl Iterator<Item = Range<u64>>,
        generation: u64,
    ) -> Self {
        let end = length.next_multiple_of(ALIGNMENT);
        let fixed = padded_in_order(fixed);
        let mut space = Self { end, floor: end, fixed, ..Self::default() };
        let mut used: Vec<_> = used.map(|range| padded(&range)).chain(space.fixed.iter().cloned()).collect();
        used.sort_unstable_by_key(|range| range.start);
        let mut at = HEADER_BYTES;
        for range in used {
            if at < range.start {
                space.retired.push((generation, at..range.start));
            }
            at = at.max(range.end);
        }
        if at < space.end {
            space.retired.push((generation, at..space.end));
        }
        space
    }

    /// The file's length if nothing more is written.
    pub(super) fn end(&self) -> u64 {
        self.end
    }

    pub(super) fn free_bytes(&self) -> u64 {
        self.free.iter().map(|(start, end)| end - start).sum()
    }

    /// True where [`reclaim`](Self::reclaim) would free something.
    pub(super) fn has_retired(&self, generation: u64) -> bool {
        self.retired.iter().any(|&(by, _)| by <= generation)
    }

    /// Takes the first free place of so many bytes, or one at the file's end.
    pub(super) fn allocate(&mut self, length: u64) -> u64 {
        let length = length.next_multiple_of(ALIGNMENT);
        if length == 0 {
            return self.end;
        }
        let fitting = self.free.iter().find(|(start, end)| *end - *start >= length);
        let Some((&start, &end)) = fitting else {
            let start = self.end;
            self.end += length;
            return start;
        };
        self.free.remove(&start);
        if start + length < end {
            self.free.insert(start + length, end);
        }
        start
    }

    /// Gives back what no committed generation names.
    pub(super) fn release(&mut self, range: &Range<u64>) {
        let Range { mut start, mut end } = padded(range);
        if start == end {
            return;
        }
        if let Some((&before, &before_end)) = self.free.range(..start).next_back()
            && before_end == start
        {
            self.free.remove(&before);
            start = before;
        }
        if let Some(after_end) = self.free.remove(&end) {
            end = after_end;
        }
        if end == self.end {
            self.end = start.max(self.floor);
            end = self.end;
        }
        if start < end {
            self.free.insert(start, end);
        }
    }

    /// From now on a header slot may record the length that the file has now.
    pub(super) fn keep_length(&mut self) {
        self.floor = self.end;
    }

    /// Marks what generations before `generation` name, and that one does not.
    pub(super) fn retire(&mut self, range: Range<u64>, generation: u64) {
        let parts = without_fixed(&range, &self.fixed);
        self.retired.extend(parts.into_iter().map(|part| (generation, part)));
    }

    /// Frees what only generations before `oldest` name.
    pub(super) fn reclaim(&mut self, oldest: u64) {
        let (free, kept) = std::mem::take(&mut self.retired).into_iter().partition(|&(by, _)| by <= oldest);
        self.retired = kept;
        let free: Vec<(u64, Range<u64>)> = free;
        free.iter().for_each(|(_, range)| self.release(range));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: u64 = ALIGNMENT;

    #[test]
    fn gaps_are_reused_after_they_were_reclaimed_only() {
        let mut space = Space::new(20 * A, &[], [2 * A..3 * A + 5, 6 * A..20 * A].into_iter(), 3);
        assert_eq!(space.allocate(1), 20 * A);
        space.reclaim(2);
        assert_eq!(space.free_bytes(), 0);
        space.reclaim(3);
        assert_eq!(space.free_bytes(), 2 * A);
        assert_eq!([space.allocate(A), space.allocate(A + 1), space.allocate(A)], [4 * A, 21 * A, 5 * A]);
    }

    #[test]
    fn blocks_that_fixed_parts_share_stay() {
        let fixed = [5 * A..6 * A + 1, 2 * A..3 * A + 9];
        let mut space = Space::new(9 * A, &fixed, std::iter::once(3 * A + 10..9 * A), 1);
        space.retire(3 * A + 10..9 * A, 2);
        space.reclaim(2);
        assert_eq!(space.free, BTreeMap::from([(4 * A, 5 * A), (7 * A, 9 * A)]));
    }

    #[test]
    fn neighbours_join_and_the_end_moves_back() {
        let mut space = Space::new(2 * A, &[], [].into_iter(), 1);
        let places: Vec<u64> = (0..4).map(|_| space.allocate(A)).collect();
        assert_eq!(places, [2 * A, 3 * A, 4 * A, 5 * A]);
        for i in [2, 0, 1] {
            space.release(&(places[i]..places[i] + 7));
        }
        assert_eq!((space.free_bytes(), space.end()), (3 * A, 6 * A));
        space.keep_length();
        space.release(&(5 * A..6 * A));
        assert_eq!(
            (space.free_bytes(), space.end()),
            (4 * A, 6 * A),
            "the file is never cut below a slot's length"
        );
        assert_eq!([space.allocate(3 * A), space.allocate(2 * A)], [2 * A, 6 * A]);
        space.release(&(6 * A..8 * A));
        assert_eq!((space.free_bytes(), space.end()), (A, 6 * A));
    }
}
