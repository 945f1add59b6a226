//! Clusters in the order in which they lie in the file.

use std::ops::Range;

use fantex_store::{Asset, ClusterId};

/// All clusters by their offset.
#[derive(Debug)]
pub(super) struct FileOrder {
    /// Ascending by start.
    by_offset: Vec<(ClusterId, Range<u64>)>,
    /// Per level and cluster its place in `by_offset`.
    places: Vec<Vec<u32>>,
}

/// A read of one or more clusters that are neighbours in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ClusterRead {
    /// Bytes of the file.
    pub(super) range: Range<u64>,
    /// Clusters in it and their bytes of the file.
    pub(super) clusters: Vec<(ClusterId, Range<u64>)>,
}

impl FileOrder {
    pub(super) fn new(asset: &Asset) -> Self {
        Self::from_ranges(asset.clusters().map(|id| (id, asset.cluster_range(id))).collect())
    }

    /// `clusters`: level by level, ascending.
    fn from_ranges(clusters: Vec<(ClusterId, Range<u64>)>) -> Self {
        let levels = clusters.last().map_or(0, |(id, _)| id.level as usize + 1);
        let mut by_offset = clusters;
        by_offset.sort_by_key(|(id, range)| (range.start, *id));
        let mut places = vec![Vec::new(); levels];
        for (place, (id, _)) in by_offset.iter().enumerate() {
            let level: &mut Vec<u32> = &mut places[id.level as usize];
            let index = id.index as usize;
            level.resize(level.len().max(index + 1), 0);
            level[index] = place as u32;
        }
        Self { by_offset, places }
    }

    fn place(&self, id: ClusterId) -> usize {
        self.places[id.level as usize][id.index as usize] as usize
    }

    /// Where a cluster lies.
    pub(super) fn range(&self, id: ClusterId) -> Range<u64> {
        self.by_offset[self.place(id)].1.clone()
    }

    /// A read of one cluster and nothing else.
    pub(super) fn alone(&self, id: ClusterId) -> ClusterRead {
        let range = self.range(id);
        ClusterRead { range: range.clone(), clusters: vec![(id, range)] }
    }

    /// A read of a cluster and of its `wanted` neighbours on both sides, of at most `most_bytes`, with gaps of at most
    /// `gap_bytes`.
    pub(super) fn merged(
        &self,
        id: ClusterId,
        most_bytes: u64,
        gap_bytes: u64,
        wanted: impl Fn(ClusterId) -> bool,
    ) -> ClusterRead {
        let mut read = self.alone(id);
        let place = self.place(id);
        for (neighbour, range) in &self.by_offset[place + 1..] {
            if range.start > read.range.end.saturating_add(gap_bytes)
                || range.end - read.range.start > most_bytes
            {
                break;
            }
            if wanted(*neighbour) {
                read.range.end = read.range.end.max(range.end);
                read.clusters.push((*neighbour, range.clone()));
            }
        }
        for (neighbour, range) in self.by_offset[..place].iter().rev() {
            if range.end.saturating_add(gap_bytes) < read.range.start
                || read.range.end - range.start > most_bytes
            {
                break;
            }
            if wanted(*neighbour) && range.end <= read.range.end {
                read.range.start = range.start;
                read.clusters.push((*neighbour, range.clone()));
            }
        }
        read
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(level: u32, index: u32) -> ClusterId {
        ClusterId { level, index }
    }

    /// Two levels, interleaved: 0.0 1.0 0.1 0.2 (gap) 0.3
    fn order() -> FileOrder {
        FileOrder::from_ranges(vec![
            (id(0, 0), 4096..8000),
            (id(0, 1), 12288..20000),
            (id(0, 2), 20480..24576),
            (id(0, 3), 90112..90200),
            (id(1, 0), 8192..12000),
        ])
    }

    #[test]
    fn wanted_neighbours_are_read_together() {
        let order = order();
        let read = order.merged(id(0, 1), 1 << 20, 4096, |_| true);
        assert_eq!(read.range, 4096..24576);
        let ids: Vec<_> = read.clusters.iter().map(|(id, _)| *id).collect();
        assert_eq!(ids, [id(0, 1), id(0, 2), id(1, 0), id(0, 0)]);
    }

    #[test]
    fn reads_are_bounded_and_skip_what_is_not_wanted() {
        let order = order();
        assert_eq!(order.merged(id(0, 1), 13_000, 4096, |_| true).range, 12288..24576);
        // 1.0 is small enough to be read along.
        let read = order.merged(id(0, 1), 1 << 20, 5000, |other| other == id(0, 0));
        assert_eq!((read.range, read.clusters.len()), (4096..20000, 2));
        let read = order.merged(id(0, 1), 1 << 20, 1000, |other| other == id(0, 0));
        assert_eq!(read, order.alone(id(0, 1)));
        assert_eq!(order.merged(id(0, 3), 1 << 20, 4096, |_| true), order.alone(id(0, 3)));
    }
}
