//! Where the samples of a pixel lie.

use glam::Vec2;

use crate::fixed::{FixedPoint, SUBPIXELS};

/// Most samples per pixel: coverage is a 64-bit mask.
pub const MAX_SAMPLES: u32 = 64;

/// Sample positions for 2, 4, 8 and 16 samples in sixteenths of a pixel from its centre: every row and column is hit
/// once, which gives near-horizontal and near-vertical edges as many steps as there are samples. These are the
/// standard multi-sampling patterns of Direct3D (functional specification, section 19.2).
const TWO: [[i32; 2]; 2] = [[4, 4], [-4, -4]];
const FOUR: [[i32; 2]; 4] = [[-2, -6], [6, -2], [-6, 2], [2, 6]];
const EIGHT: [[i32; 2]; 8] = [[1, -3], [-1, 3], [5, 1], [-3, -5], [-5, 5], [-7, -1], [3, 7], [7, -7]];
const SIXTEEN: [[i32; 2]; 16] = [
    [1, 1],
    [-1, -3],
    [-3, 2],
    [4, -1],
    [-5, -2],
    [2, 5],
    [5, 3],
    [3, -5],
    [-2, 6],
    [0, -7],
    [-4, -6],
    [-6, 4],
    [-8, 0],
    [7, -4],
    [6, 7],
    [-7, -8],
];

/// How many samples a box holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SamplesIn {
    None,
    /// The only one of a pixel, of patterns with one sample.
    One([i32; 2]),
    /// Of patterns with several samples also one.
    Several,
}

/// The sample positions of every pixel, in fixed point, as offsets from the pixel's top left corner.
#[derive(Clone, Debug)]
pub(crate) struct SamplePattern {
    offsets: Vec<[i32; 2]>,
}

impl SamplePattern {
    /// `count` positions, 1..=[`MAX_SAMPLES`]: the centre, a standard pattern, or the points of Roberts' R2 sequence.
    pub(crate) fn new(count: u32) -> Self {
        let from_sixteenths = |table: &[[i32; 2]]| {
            table.iter().map(|p| p.map(|c| SUBPIXELS / 2 + c * (SUBPIXELS / 16))).collect::<Vec<_>>()
        };
        let offsets = match count {
            1 => vec![[SUBPIXELS / 2; 2]],
            2 => from_sixteenths(&TWO),
            4 => from_sixteenths(&FOUR),
            8 => from_sixteenths(&EIGHT),
            16 => from_sixteenths(&SIXTEEN),
            n => (0..n).map(r2_point).collect(),
        };
        Self { offsets }
    }

    /// Offsets from the pixel's top left corner in fixed point, each coordinate in `0..SUBPIXELS`.
    pub(crate) fn offsets(&self) -> &[[i32; 2]] {
        &self.offsets
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.offsets.len()
    }

    /// The samples in a box (inclusive, fixed point).
    pub(crate) fn samples_in(&self, low: FixedPoint, high: FixedPoint) -> SamplesIn {
        // One sample of every pixel makes a lattice; the box holds a point of it if it does so along both axes.
        const PIXEL: u32 = SUBPIXELS.ilog2();
        let range = |i: usize, o: i32| (((low[i] - o - 1) >> PIXEL) + 1, (high[i] - o) >> PIXEL);
        if let &[[x, y]] = &self.offsets[..] {
            let (columns, rows) = (range(0, x), range(1, y));
            return if columns.0 > columns.1 || rows.0 > rows.1 {
                SamplesIn::None
            } else if columns.0 == columns.1 && rows.0 == rows.1 {
                SamplesIn::One([columns.0, rows.0])
            } else {
                SamplesIn::Several
            };
        }
        let holds = |i: usize, o: i32| range(i, o).0 <= range(i, o).1;
        let holds_any = self.offsets.iter().any(|o| holds(0, o[0]) && holds(1, o[1]));
        if holds_any { SamplesIn::Several } else { SamplesIn::None }
    }

    /// The mask with one bit per sample, all set.
    pub(crate) fn full_mask(&self) -> u64 {
        u64::MAX >> (64 - self.offsets.len())
    }

    /// Mean position of the samples in `mask` (not empty), in pixels from the pixel's top left corner.
    pub(crate) fn centroid(&self, mask: u64) -> Vec2 {
        let mut sum = [0; 2];
        for s in bits(mask) {
            sum[0] += self.offsets[s][0];
            sum[1] += self.offsets[s][1];
        }
        Vec2::new(sum[0] as f32, sum[1] as f32) / (SUBPIXELS as f32 * mask.count_ones() as f32)
    }
}

/// Point `i` of the additive recurrence on the plastic number (M. Roberts, "The Unreasonable Effectiveness of
/// Quasirandom Sequences", 2018), rounded to the sub-pixel grid.
fn r2_point(i: u32) -> [i32; 2] {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let step = [1.0 / PLASTIC, 1.0 / (PLASTIC * PLASTIC)];
    step.map(|a| ((0.5 + a * f64::from(i)).fract() * f64::from(SUBPIXELS)) as i32)
}

/// Indices of the set bits, ascending.
pub(crate) fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = (mask != 0).then(|| mask.trailing_zeros() as usize)?;
        mask &= mask - 1;
        Some(bit)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_distinct_inside_and_centred() {
        for count in 1..=MAX_SAMPLES {
            let pattern = SamplePattern::new(count);
            let mut seen = pattern.offsets().to_vec();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), count as usize, "{count} samples coincide");
            assert!(seen.iter().flatten().all(|c| (0..SUBPIXELS).contains(c)));
            let off = pattern.centroid(pattern.full_mask()) - Vec2::splat(0.5);
            assert!(off.length() < 0.5 / (count as f32).sqrt(), "{count}: centroid off by {off}");
        }
    }

    #[test]
    fn boxes_without_samples_are_known() {
        let pattern = SamplePattern::new(1);
        assert_eq!(pattern.samples_in([128, 128], [128, 128]), SamplesIn::One([0, 0]));
        assert_eq!(pattern.samples_in([129, 0], [255, 255]), SamplesIn::None);
        let between_columns = pattern.samples_in([-127, 0], [-1, 9000]);
        assert_eq!(between_columns, SamplesIn::None);
        assert_eq!(pattern.samples_in([-129, 0], [-1, 9000]), SamplesIn::Several);
        assert_eq!(pattern.samples_in([-129, 500], [-1, 700]), SamplesIn::One([-1, 2]));
        let over_a_pixels_corner = [[200, 200], [383, 383]];
        assert_eq!(pattern.samples_in(over_a_pixels_corner[0], over_a_pixels_corner[1]), SamplesIn::None);
        let eight = SamplePattern::new(8).samples_in(over_a_pixels_corner[0], over_a_pixels_corner[1]);
        assert_eq!(eight, SamplesIn::Several);
    }

    #[test]
    fn bits_are_listed_in_order() {
        assert_eq!(bits(0b1010_0001).collect::<Vec<_>>(), [0, 5, 7]);
        assert_eq!(bits(0).count(), 0);
        assert_eq!(bits(u64::MAX).count(), 64);
    }
}
