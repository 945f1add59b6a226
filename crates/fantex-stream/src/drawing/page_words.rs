//! The page table as shaders read it: a texture of a word per page.
//!
//! The word of a page says where it lies in the atlas. Where it is not resident and its tile has one page per level, the word
//! says where the finest coarser level lies that is, and how many levels coarser; zero says that there is none, so shaders
//! need not search. Pages of larger tiles have a word of their own only, zero where they are not resident.
//!
//! The words are kept in main memory, too: 4 bytes per page.
//!
//! Why a texture: software adapters read storage buffers lane by lane, but fetch texels of 32 bits for all lanes at once, and WebGL has
//! no storage buffers.

use std::ops::Range;

use fantex_cover::Cover;

use super::AtlasGrid;
use super::geometry::is_paged;
use crate::{PageTable, TableChange};

/// Columns of the texture, as a binary logarithm; also in `fan_lookup.wgsl`. Every device of WebGPU has textures as wide.
pub const PAGE_ROW_SHIFT: u32 = 12;

/// Where the number of levels stands in a word.
const COARSER_SHIFT: u32 = 24;

/// Texels between two runs of changes that are copied once more rather than made two copies.
const GAP: u32 = 64;

/// What is in the texture.
#[derive(Debug)]
pub struct PageWords {
    /// Per group the number of its first page, ascending; then the number of pages.
    firsts: Vec<u32>,
    /// Per group whether levels have several pages.
    is_paged: Vec<bool>,
    /// Per page.
    words: Vec<u32>,
}

impl PageWords {
    /// Nothing is resident.
    pub fn new(cover: &Cover, pages: &PageTable) -> Self {
        let groups = 0..cover.groups.len() as u32;
        Self {
            firsts: groups.map(|group| pages.first(group)).chain([pages.len() as u32]).collect(),
            is_paged: cover.groups.iter().map(is_paged).collect(),
            words: vec![0; pages.len()],
        }
    }

    /// Columns and rows of a texture for a number of pages.
    pub fn extent(pages: usize) -> [u32; 2] {
        [1 << PAGE_ROW_SHIFT, pages.div_ceil(1 << PAGE_ROW_SHIFT).max(1) as u32]
    }

    /// The words, one per page.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Takes over entries, ascending by index. Returns the pages whose words are others now (and some between them), ascending,
    /// each run within one row of the texture.
    pub fn change(&mut self, entries: &[TableChange], grid: AtlasGrid) -> Vec<Range<u32>> {
        let mut runs: Vec<Range<u32>> = Vec::new();
        let mut rest = entries;
        while let Some(&TableChange { index, .. }) = rest.first() {
            let group = self.firsts.partition_point(|&first| first <= index) - 1;
            let pages = self.firsts[group]..self.firsts[group + 1];
            let count = rest.iter().take_while(|change| change.index < pages.end).count();
            let (own, others) = rest.split_at(count);
            rest = others;
            for change in own {
                self.words[change.index as usize] = grid.word(change.entry);
            }
            let last = own[count - 1].index;
            let changed = if self.is_paged[group] {
                index..last + 1
            } else {
                self.chain(pages.start..last + 1, pages.end);
                pages.start..last + 1
            };
            match runs.last_mut().filter(|run| changed.start <= run.end + GAP) {
                Some(run) => run.end = changed.end,
                None => runs.push(changed),
            }
        }
        runs.into_iter().flat_map(rows).collect()
    }

    /// Hands coarser levels' words on to finer ones, from the last of `levels` down; the tile's levels end before `end`.
    fn chain(&mut self, levels: Range<u32>, end: u32) {
        for level in levels.rev().map(|level| level as usize) {
            let own = self.words[level];
            let is_resident = own != 0 && own >> COARSER_SHIFT & 0x7F == 0;
            if !is_resident {
                let next = if level + 1 < end as usize { self.words[level + 1] } else { 0 };
                self.words[level] = if next == 0 { 0 } else { next + (1 << COARSER_SHIFT) };
            }
        }
    }
}

/// The parts of a run in rows of the texture.
fn rows(run: Range<u32>) -> impl Iterator<Item = Range<u32>> {
    (run.start >> PAGE_ROW_SHIFT..=(run.end - 1) >> PAGE_ROW_SHIFT)
        .map(move |row| run.start.max(row << PAGE_ROW_SHIFT)..run.end.min((row + 1) << PAGE_ROW_SHIFT))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AtlasPlace, AtlasShape, TableEntry};

    fn grid() -> AtlasGrid {
        AtlasGrid::new(AtlasShape { side: 1024, layers: 1 }, 16384)
    }

    fn words(firsts: &[u32], is_paged: &[bool]) -> PageWords {
        let pages = firsts[firsts.len() - 1] as usize;
        PageWords { firsts: firsts.to_vec(), is_paged: is_paged.to_vec(), words: vec![0; pages] }
    }

    fn resident(index: u32) -> TableChange {
        TableChange { index, entry: TableEntry::at(AtlasPlace { layer: 0, x: 4 * index as u16, y: 8 }) }
    }

    fn absent(index: u32) -> TableChange {
        TableChange { index, entry: TableEntry::ABSENT }
    }

    /// What the word of a page means: which page is found there.
    fn found(words: &PageWords, index: u32) -> Option<u32> {
        let word = words.words[index as usize];
        (word != 0).then(|| {
            assert_eq!(word >> 31, 1);
            let page = word & 0xFFF;
            assert_eq!(index + (word >> COARSER_SHIFT & 0x7F), page, "levels between them");
            page
        })
    }

    #[test]
    fn finer_levels_name_the_finest_coarser_one() {
        let mut words = words(&[0, 5, 10], &[false, false]);
        let all = |words: &PageWords| (0..10).map(|i| found(words, i)).collect::<Vec<_>>();
        assert_eq!(words.change(&[resident(4), resident(8)], grid()), std::slice::from_ref(&(0..9)));
        assert_eq!(all(&words), [&[Some(4); 5][..], &[Some(8); 4], &[None]].concat());
        assert_eq!(words.change(&[resident(1)], grid()), std::slice::from_ref(&(0..2)));
        assert_eq!(all(&words)[..5], [Some(1), Some(1), Some(4), Some(4), Some(4)]);
        // What was handed on is not taken for resident when it goes.
        words.change(&[absent(1), absent(4)], grid());
        assert_eq!(all(&words)[..5], [None; 5]);
        words.change(&[resident(0), resident(2)], grid());
        assert_eq!(all(&words)[..5], [Some(0), Some(2), Some(2), None, None]);
    }

    #[test]
    fn pages_of_large_tiles_stand_alone() {
        let mut words = words(&[0, 7], &[true]);
        assert_eq!(words.change(&[resident(2), resident(5)], grid()), std::slice::from_ref(&(2..6)));
        let own: Vec<_> = (0..7).map(|i| found(&words, i)).collect();
        assert_eq!(own, [None, None, Some(2), None, None, Some(5), None]);
    }

    #[test]
    fn runs_end_with_rows_and_join_over_small_gaps() {
        let row = 1 << PAGE_ROW_SHIFT;
        let firsts: Vec<u32> = (0..=3 * row / 4).map(|group| 4 * group).collect();
        let mut words = words(&firsts, &vec![false; firsts.len() - 1]);
        let runs = words.change(&[resident(3), resident(40), resident(1003), resident(row - 1)], grid());
        assert_eq!(runs, [0..41, 1000..1004, row - 4..row]);
        let runs = words.change(&[resident(row - 2), resident(row + 1)], grid());
        assert_eq!(runs, [row - 4..row, row..row + 2]);
        assert_eq!(PageWords::extent(3 * row as usize), [row, 3]);
        assert_eq!(PageWords::extent(0), [row, 1]);
    }
}
