//! What the tests of several families need.

use std::ops::Range;

/// Points spread evenly over a large cube around the origin: an additive recurrence.
pub(super) fn points<const D: usize>(count: u32) -> impl Iterator<Item = [f32; D]> {
    const STEPS: [f64; 4] = [0.856_674_9, 0.733_891_9, 0.628_706_7, 0.538_597_3];
    (0..count)
        .map(|i| std::array::from_fn(|d| (((f64::from(i) + 0.5) * STEPS[d]).fract() * 96.0 - 48.0) as f32))
}

/// Asserts that the second of a pair is the derivative of the first.
pub(super) fn check_derivatives<const D: usize>(noise: impl Fn([f32; D]) -> (f32, [f32; D])) {
    for p in points::<D>(2000) {
        let (_, gradient) = noise(p);
        for (d, derivative) in gradient.into_iter().enumerate() {
            let moved = |by: f32| noise(std::array::from_fn(|e| if e == d { p[e] + by } else { p[e] })).0;
            let slope = (moved(4e-3) - moved(-4e-3)) / 8e-3;
            assert!((slope - derivative).abs() < 1e-2, "{slope} against {derivative} at {p:?}");
        }
    }
}

/// Asserts that the mean is about 0 and that the largest magnitude lies in a range.
pub(super) fn check_range<const D: usize>(expected: Range<f32>, noise: impl Fn([f32; D]) -> f32) {
    let count = 200_000;
    let (mut mean, mut largest) = (0.0, 0.0_f32);
    for p in points::<D>(count) {
        let value = noise(p);
        mean += f64::from(value) / f64::from(count);
        largest = largest.max(value.abs());
    }
    assert!(
        mean.abs() < 0.004 && expected.contains(&largest),
        "mean {mean}, largest {largest} in {D} dimensions"
    );
}
