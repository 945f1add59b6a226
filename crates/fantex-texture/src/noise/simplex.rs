//! Simplex noise: K. Perlin, "Noise hardware", 2001, as S. Gustavson explains it in "Simplex noise demystified", 2005.
//!
//! Space is cut into simplices instead of cubes: D + 1 corners count instead of 2^D, and no direction of the axes shows. Deviations:
//! the kernels end at the squared radius 1/2, where neighbouring simplices begin, so that value and derivatives are
//! continuous in all dimensions; gradients are chosen by an integer hash.

use super::hash::{cell_and_offset, cell_hash, gradient_vector};

/// One over the largest value of the sum of kernels, by dimension (searched numerically over all choices of gradients).
const SCALES: [f32; 5] = [0.0, 0.0, 70.29, 76.88, 62.79];

/// Squared radius of the kernels.
const RADIUS2: f32 = 0.5;

/// Smooth noise of 2, 3 or 4 dimensions, between -1 and 1 with mean 0, and its derivative along each axis.
pub fn simplex_noise<const D: usize>(seed: u32, p: [f32; D]) -> (f32, [f32; D]) {
    const { assert!(2 <= D && D <= 4) };
    let root = (D as f32 + 1.0).sqrt();
    let (skew, unskew) = ((root - 1.0) / D as f32, (1.0 - 1.0 / root) / D as f32);

    // The skewed cube that holds the point, and the point relative to the cube's first corner.
    let shift = skew * p.iter().sum::<f32>();
    let (cell, _) = cell_and_offset(p.map(|x| x + shift));
    let back = unskew * cell.iter().map(|&c| c as f32).sum::<f32>();
    let local: [f32; D] = std::array::from_fn(|d| p[d] - (cell[d] as f32 - back));

    // The simplex is walked from the first to the last corner of the cube, along the largest coordinate first.
    let rank: [usize; D] = std::array::from_fn(|d| {
        (0..D).filter(|&e| local[e] > local[d] || (local[e] == local[d] && e < d)).count()
    });
    let (mut value, mut gradient) = (0.0, [0.0; D]);
    for corner in 0..=D {
        let step: [i32; D] = std::array::from_fn(|d| i32::from(rank[d] < corner));
        let offset: [f32; D] = std::array::from_fn(|d| local[d] - step[d] as f32 + corner as f32 * unskew);
        let reach = RADIUS2 - offset.iter().map(|x| x * x).sum::<f32>();
        if reach <= 0.0 {
            continue;
        }
        let slope: [f32; D] =
            gradient_vector(cell_hash::<D>(seed, std::array::from_fn(|d| cell[d].wrapping_add(step[d]))));
        let height: f32 = (0..D).map(|d| slope[d] * offset[d]).sum();
        let (cubed, fourth) = (reach.powi(3), reach.powi(4));
        value += fourth * height;
        for d in 0..D {
            gradient[d] += fourth * slope[d] - 8.0 * cubed * height * offset[d];
        }
    }
    (SCALES[D] * value, gradient.map(|g| SCALES[D] * g))
}

#[cfg(test)]
mod tests {
    use super::super::tests_common::{check_derivatives, check_range, points};
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_value() {
        check_derivatives::<2>(|p| simplex_noise(5, p));
        check_derivatives::<3>(|p| simplex_noise(5, p));
        check_derivatives::<4>(|p| simplex_noise(5, p));
    }

    #[test]
    fn the_range_is_one() {
        check_range::<2>(0.9..1.0001, |p| simplex_noise(5, p).0);
        check_range::<3>(0.8..1.0001, |p| simplex_noise(5, p).0);
        check_range::<4>(0.7..1.0001, |p| simplex_noise(5, p).0);
    }

    #[test]
    fn neighbouring_simplices_agree() {
        for p in points::<3>(100_000) {
            let q = [p[0] + 1e-4, p[1] - 1e-4, p[2] + 1e-4];
            assert!((simplex_noise(2, p).0 - simplex_noise(2, q).0).abs() < 3e-3, "{p:?}");
        }
    }
}
