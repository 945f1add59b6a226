//! Points that fill the square evenly: the first two dimensions of Sobol's sequence (I. Sobol, "On the distribution of points
//! in a cube and the approximate evaluation of integrals", 1967), randomised.
//!
//! Every pair of dimensions of an integrand takes the same two dimensions, with the order of the points shuffled and the
//! points scrambled (A. Owen, "Randomly permuted (t,m,s)-nets and (t,s)-sequences", 1995) by hashes of the pair's number
//! (B. Burley, "Practical Hash-based Owen Scrambling", 2020). So any number of pairs is available, the first 2^m points of
//! each are stratified in every way that 2^m cells can be cut, and different pairs are independent.

/// One randomised copy of the sequence.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sequence {
    seed: u32,
}

impl Sequence {
    pub(super) fn new(seed: u32) -> Self {
        Self { seed: mixed(seed) }
    }

    /// Point `index` of a pair of dimensions, in 0..1 x 0..1.
    pub(super) fn pair(&self, index: u32, dimensions: u32) -> [f32; 2] {
        let seed = mixed(self.seed ^ mixed(dimensions.wrapping_add(0x9e37_79b9)));
        // Shuffling: a scrambling of the number itself, so that blocks of 2^m points stay blocks.
        let index = scrambled(index, seed);
        let x = scrambled(index.reverse_bits(), mixed(seed ^ 0x68bc_21eb));
        let y = scrambled(second_dimension(index), mixed(seed ^ 0x02e5_be93));
        [x, y].map(|bits| (bits >> 8) as f32 / (1 << 24) as f32)
    }
}

/// A hash of 32 bits whose every output bit depends on every input bit (C. Wellons, "Prospecting for Hash Functions", 2018).
pub(super) fn mixed(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}

/// Owen scrambling of a fraction's bits, the highest first: each bit is flipped or not depending on the bits above it. Works
/// on the reversed bits with a hash in which information moves upwards only (S. Laine and T. Karras, "Stratified Sampling
/// for Stochastic Transparency", 2011; constants of N. Vegdahl, "Building a Better LK Hash", 2021).
fn scrambled(fraction: u32, seed: u32) -> u32 {
    let mut x = fraction.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// The second dimension's fraction. Its generator matrix is Pascal's triangle modulo 2, whose entry at row r and column c is
/// one where c has all bits of r: a sum over supersets, done bit by bit of the position.
fn second_dimension(index: u32) -> u32 {
    let mut x = index;
    for (shift, kept) in
        [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0f0f_0f0f), (8, 0x00ff_00ff), (16, 0x0000_ffff)]
    {
        x ^= (x >> shift) & kept;
    }
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 2^m points, every cell of every cut of the square into 2^m equal boxes of sides 2^-k holds exactly one.
    #[test]
    fn points_are_stratified_in_every_way() {
        for seed in 0..20 {
            let sequence = Sequence::new(seed);
            for m in [0, 1, 4, 7, 10] {
                // Any aligned block of them.
                for first in [0, 3 << m] {
                    let points: Vec<[f32; 2]> =
                        (0..1 << m).map(|i| sequence.pair(first + i, seed + 5)).collect();
                    for k in 0..=m {
                        let mut held = vec![0; 1 << m];
                        for [x, y] in &points {
                            let column = (x * (1_u32 << k) as f32) as usize;
                            let row = (y * (1_u32 << (m - k)) as f32) as usize;
                            held[(row << k) | column] += 1;
                        }
                        assert!(held.iter().all(|&n| n == 1), "seed {seed}, {m} bits, {k} across");
                    }
                }
            }
        }
    }

    #[test]
    fn pairs_of_dimensions_are_independent() {
        let sequence = Sequence::new(7);
        let n = 1024;
        for (a, b) in [(0, 1), (1, 2), (5, 600)] {
            let mut correlation = [[0.0; 2]; 2];
            for i in 0..n {
                let (p, q) = (sequence.pair(i, a), sequence.pair(i, b));
                for (row, p) in correlation.iter_mut().zip(p) {
                    for (sum, q) in row.iter_mut().zip(q) {
                        *sum += f64::from(p - 0.5) * f64::from(q - 0.5) * 12.0 / f64::from(n);
                    }
                }
            }
            assert!(correlation.as_flattened().iter().all(|c| c.abs() < 0.1), "{correlation:?}");
        }
    }

    #[test]
    fn seeds_give_different_points() {
        let firsts: std::collections::BTreeSet<u32> =
            (0..1000).map(|seed| Sequence::new(seed).pair(0, 0)[0].to_bits()).collect();
        assert!(firsts.len() > 990);
    }
}
