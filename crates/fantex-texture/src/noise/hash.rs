//! Random numbers of cells.

/// One round of an integer hash.
pub(super) fn absorb(hash: u32, coordinate: i32) -> u32 {
    let mixed = (hash ^ coordinate as u32).wrapping_add(0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    mixed ^ (mixed >> 15)
}

/// Spreads every bit of the hash over the upper bits.
pub(super) fn finish(hash: u32) -> u32 {
    let mixed = hash.wrapping_mul(0xc2b2_ae35);
    (mixed ^ (mixed >> 16)).wrapping_mul(0x27d4_eb2f)
}

/// A random 32-bit number of a cell.
pub(super) fn cell_hash<const D: usize>(seed: u32, cell: [i32; D]) -> u32 {
    finish(cell.iter().rev().fold(seed, |hash, &coordinate| absorb(hash, coordinate)))
}

/// A hash as a number in [0,1).
pub(super) fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / (1 << 24) as f32
}

/// The unit cell of a point and the point's offset inside.
pub(super) fn cell_and_offset<const D: usize>(p: [f32; D]) -> ([i32; D], [f32; D]) {
    let cell = p.map(|x| {
        let truncated = x as i32;
        truncated.saturating_sub(i32::from(x < truncated as f32))
    });
    (cell, std::array::from_fn(|d| p[d] - cell[d] as f32))
}

/// White noise: a random number between -1 and 1 for every unit cell, mean 0.
pub fn white_noise<const D: usize>(seed: u32, p: [f32; D]) -> f32 {
    2.0 * unit(cell_hash(seed, cell_and_offset(p).0)) - 1.0
}

/// Point `i` of a sequence that is spread over a cube of 64 cells.
pub(super) fn scattered_point(i: u32) -> [f32; 3] {
    std::array::from_fn(|d| 64.0 * unit(finish(absorb(absorb(0x51ed_270b, i as i32), d as i32))) - 32.0)
}

/// Gradient vectors of 2 dimensions lie at odd multiples of a sixteenth turn, of this length like those of space.
const SIXTEENTHS: [[f32; 2]; 4] = [
    [1.387_039_8, 0.275_899_38],
    [1.175_875_6, 0.785_694_96],
    [0.785_694_96, 1.175_875_6],
    [0.275_899_38, 1.387_039_8],
];

/// One of the gradient vectors of a dimension, picked by the upper bits of a hash: sixteen directions in the plane, the
/// twelve edges of a cube in space (K. Perlin, "Improving noise", 2002), the thirty-two edges of a tesseract in 4D.
pub(super) fn gradient_vector<const D: usize>(hash: u32) -> [f32; D] {
    let pick = |count: u64| ((u64::from(hash) * count) >> 32) as usize;
    let sign = |bits: usize, bit: usize| if bits >> bit & 1 == 0 { 1.0 } else { -1.0 };
    let mut vector = [0.0; 4];
    match D {
        2 => {
            let bits = pick(16);
            let [x, y] = SIXTEENTHS[bits >> 2];
            (vector[0], vector[1]) = (x * sign(bits, 0), y * sign(bits, 1));
        }
        _ => {
            // One coordinate is zero, the others are one with any sign.
            let signs = D - 1;
            let bits = pick((D as u64) << signs);
            let zero = D - 1 - (bits >> signs);
            let others = (0..D).filter(|&d| d != zero);
            others.enumerate().for_each(|(bit, d)| vector[d] = sign(bits, bit));
        }
    }
    std::array::from_fn(|d| vector[d])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_gradients<const D: usize>(count: usize) {
        let mut seen: Vec<[i32; D]> =
            (0..4096_u32).map(|i| gradient_vector::<D>(i << 20).map(|x| (x * 1e4).round() as i32)).collect();
        let sum = seen.iter().fold([0; D], |sum, v| std::array::from_fn(|d| sum[d] + v[d]));
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), count, "in {D} dimensions");
        assert!(sum.iter().all(|s| s.abs() < 400_000), "they point to all sides alike: {sum:?}");
    }

    #[test]
    fn gradients_point_to_all_sides() {
        check_gradients::<2>(16);
        check_gradients::<3>(12);
        check_gradients::<4>(32);
    }

    #[test]
    fn white_noise_is_even_and_constant_in_a_cell() {
        let values: Vec<f32> = (0..10_000).map(|i| white_noise(3, [i as f32 - 5000.0, 0.5])).collect();
        let mean = values.iter().sum::<f32>() / 1e4;
        let variance = values.iter().map(|v| v * v).sum::<f32>() / 1e4;
        assert!(mean.abs() < 0.02 && (variance - 1.0 / 3.0).abs() < 0.02, "{mean} {variance}");
        assert_eq!(white_noise(3, [-0.9, 0.1]), white_noise(3, [-0.1, 0.9]));
        assert_ne!(white_noise(3, [-0.9, 0.1]), white_noise(3, [0.1, 0.1]));
    }
}
