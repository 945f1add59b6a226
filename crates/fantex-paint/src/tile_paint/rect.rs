//! Rectangles of texels.

/// Columns and rows `low..high`; empty where `high <= low`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    pub(crate) low: [u32; 2],
    pub(crate) high: [u32; 2],
}

impl Rect {
    pub(crate) const EMPTY: Self = Self { low: [u32::MAX; 2], high: [0; 2] };

    pub(crate) fn is_empty(&self) -> bool {
        self.low[0] >= self.high[0] || self.low[1] >= self.high[1]
    }

    pub(crate) fn add(&mut self, x: u32, y: u32) {
        *self = self.union(Self { low: [x, y], high: [x + 1, y + 1] });
    }

    pub(crate) fn union(self, other: Self) -> Self {
        if other.is_empty() {
            return self;
        }
        let low = [0, 1].map(|k| self.low[k].min(other.low[k]));
        Self { low, high: [0, 1].map(|k| self.high[k].max(other.high[k])) }
    }

    pub(crate) fn intersection(self, other: Self) -> Self {
        let low = [0, 1].map(|k| self.low[k].max(other.low[k]));
        Self { low, high: [0, 1].map(|k| self.high[k].min(other.high[k])) }
    }

    /// Grown to whole 4x4 blocks.
    pub(crate) fn blocks(self) -> Self {
        Self { low: self.low.map(|n| n / 4 * 4), high: self.high.map(|n| n.next_multiple_of(4)) }
    }

    pub(crate) fn moved(self, by: [u32; 2]) -> Self {
        let add = |corner: [u32; 2]| [corner[0] + by[0], corner[1] + by[1]];
        Self { low: add(self.low), high: add(self.high) }
    }

    /// Relative to a corner that does not lie beyond its own.
    pub(crate) fn relative_to(self, origin: [u32; 2]) -> Self {
        let subtract = |corner: [u32; 2]| [corner[0] - origin[0], corner[1] - origin[1]];
        Self { low: subtract(self.low), high: subtract(self.high) }
    }

    pub(crate) fn extent(&self) -> [u32; 2] {
        [0, 1].map(|k| self.high[k].saturating_sub(self.low[k]))
    }

    /// Columns and rows, row by row.
    pub(crate) fn texels(self) -> impl Iterator<Item = (u32, u32)> {
        (self.low[1]..self.high[1]).flat_map(move |y| (self.low[0]..self.high[0]).map(move |x| (x, y)))
    }
}
