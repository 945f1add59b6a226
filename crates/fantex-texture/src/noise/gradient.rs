//! K. Perlin, "Improving noise", 2002, for any number of dimensions: cubic cells with a random gradient at each corner, blended by
//! a quintic. The gradient is chosen by an integer hash instead of a permutation table.

use super::hash::{cell_and_offset, cell_hash, gradient_vector};

/// Smooth noise of 2, 3 or 4 dimensions, between about -1 and 1 with mean 0, and its derivative along each axis. It is 0
/// at every point with integer coordinates.
///
/// Four dimensions have one axis more to vary along, and are scaled so that their range is that of the others.
pub fn gradient_noise<const D: usize>(seed: u32, p: [f32; D]) -> (f32, [f32; D]) {
    const { assert!(2 <= D && D <= 4) };
    let (cell, t) = cell_and_offset(p);
    let fade = t.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let fade_slope = t.map(|t| 30.0 * t * t * (t * (t - 2.0) + 1.0));
    let (mut value, mut gradient) = (0.0, [0.0; D]);
    for corner in 0..1_usize << D {
        let upper = |d: usize| corner >> d & 1 == 1;
        let slope: [f32; D] = gradient_vector(cell_hash::<D>(
            seed,
            std::array::from_fn(|d| cell[d].wrapping_add(i32::from(upper(d)))),
        ));
        let height: f32 = (0..D).map(|d| slope[d] * (t[d] - f32::from(u8::from(upper(d))))).sum();
        let weight = |d: usize| if upper(d) { fade[d] } else { 1.0 - fade[d] };
        let weight_slope = |d: usize| if upper(d) { fade_slope[d] } else { -fade_slope[d] };
        let whole: f32 = (0..D).map(weight).product();
        value += whole * height;
        for (axis, sum) in gradient.iter_mut().enumerate() {
            let others: f32 = (0..D).filter(|&d| d != axis).map(weight).product();
            *sum += whole * slope[axis] + weight_slope(axis) * others * height;
        }
    }
    let scale = if D == 4 { 0.85 } else { 1.0 };
    (scale * value, gradient.map(|g| scale * g))
}

#[cfg(test)]
mod tests {
    use super::super::tests_common::{check_derivatives, check_range};
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_value() {
        check_derivatives::<2>(|p| gradient_noise(5, p));
        check_derivatives::<3>(|p| gradient_noise(5, p));
        check_derivatives::<4>(|p| gradient_noise(5, p));
    }

    #[test]
    fn the_range_is_about_one() {
        check_range::<2>(0.8..1.05, |p| gradient_noise(5, p).0);
        check_range::<3>(0.8..1.05, |p| gradient_noise(5, p).0);
        check_range::<4>(0.8..1.05, |p| gradient_noise(5, p).0);
    }

    #[test]
    fn lattice_points_are_zero() {
        assert_eq!(gradient_noise(1, [3.0, -8.0]).0, 0.0);
        assert_eq!(gradient_noise(1, [3.0, -8.0, 0.0, 77.0]).0, 0.0);
        assert!(gradient_noise(1, [f32::NAN, f32::INFINITY]).0.is_nan());
    }
}
