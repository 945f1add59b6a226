//! Detail levels, row by row.

/// Halves rows of values on and on: level `l + 1` is the mean of 2 x 2 texels of level `l`, in linear light. Rows of all
/// levels come out as soon as they are known; one row per level is kept.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    side: usize,
    /// The upper row of a pair, per level.
    waiting: Vec<Option<Vec<[f32; 4]>>>,
}

impl Pyramid {
    /// For a square picture; `side` is a power of two.
    pub(super) fn new(side: u32) -> Self {
        Self { side: side as usize, waiting: vec![None; level_count(side) as usize] }
    }

    /// Takes whole rows of level 0 and visits every row of every level that is complete, with its level.
    pub(super) fn push(&mut self, rows: &[[f32; 4]], mut visit: impl FnMut(usize, &[[f32; 4]])) {
        for row in rows.chunks_exact(self.side) {
            let mut row = row.to_vec();
            for level in 0..self.waiting.len() {
                visit(level, &row);
                match self.waiting[level].take() {
                    Some(upper) => row = halved(&upper, &row),
                    None => {
                        self.waiting[level] = Some(row);
                        break;
                    }
                }
            }
        }
    }
}

/// Levels down to one texel.
pub(super) fn level_count(side: u32) -> u32 {
    side.ilog2() + 1
}

fn halved(upper: &[[f32; 4]], lower: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
    pairs.map(|([a, b], [c, d])| std::array::from_fn(|k| 0.25 * (a[k] + b[k] + c[k] + d[k]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_levels_come_out_and_keep_the_mean() {
        let side = 8u32;
        let rows: Vec<[f32; 4]> = (0..64).map(|i| [i as f32, 1.0, 0.0, (i % 2) as f32]).collect();
        let mut pyramid = Pyramid::new(side);
        let mut levels = vec![Vec::new(); level_count(side) as usize];
        for band in rows.chunks(24) {
            pyramid.push(band, |level, row| levels[level].extend_from_slice(row));
        }
        assert_eq!(levels.iter().map(Vec::len).collect::<Vec<_>>(), [64, 16, 4, 1]);
        assert_eq!(levels[3][0], [31.5, 1.0, 0.0, 0.5]);
        assert_eq!(levels[1][5], [(18 + 19 + 26 + 27) as f32 / 4.0, 1.0, 0.0, 0.5]);
    }
}
