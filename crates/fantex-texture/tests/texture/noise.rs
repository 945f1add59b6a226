//! Noise: statistics, derivatives, sums of octaves, waves.

use fantex_texture::noise::{
    Cellular, CellularMetric, Fractal, FractalKind, FractalNoise, Noise, NoiseFamily, cellular, cellular_all,
    gradient_noise, simplex_noise, white_noise,
};
use fantex_texture::{ShadingPoint, Sines, Texture, Wave};
use glam::{Vec3, Vec4};
use std::ops::Range;

use crate::common::shading_point;

/// Points spread evenly over a large cube around the origin: an additive recurrence.
fn points<const D: usize>(count: u32) -> impl Iterator<Item = [f32; D]> {
    const STEPS: [f64; 4] = [0.856_674_9, 0.733_891_9, 0.628_706_7, 0.538_597_3];
    (0..count)
        .map(|i| std::array::from_fn(|d| (((f64::from(i) + 0.5) * STEPS[d]).fract() * 96.0 - 48.0) as f32))
}

/// Asserts that the second of a pair is the derivative of the first.
fn check_derivatives<const D: usize>(noise: impl Fn([f32; D]) -> (f32, [f32; D])) {
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
fn check_range<const D: usize>(expected: Range<f32>, noise: impl Fn([f32; D]) -> f32) {
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

const FAMILIES: [(NoiseFamily, CellularMetric); 6] = [
    (NoiseFamily::Perlin, CellularMetric::Euclidean),
    (NoiseFamily::Simplex, CellularMetric::Euclidean),
    (NoiseFamily::Cellular, CellularMetric::Euclidean),
    (NoiseFamily::CellularBorders, CellularMetric::Manhattan),
    (NoiseFamily::CellularIds, CellularMetric::Chebyshev),
    (NoiseFamily::White, CellularMetric::Euclidean),
];

const KINDS: [FractalKind; 4] =
    [FractalKind::Single, FractalKind::Fbm, FractalKind::Turbulence, FractalKind::Ridged];

#[test]
fn white_noise_is_even_and_constant_in_a_cell() {
    let values: Vec<f32> = (0..10_000).map(|i| white_noise(3, [i as f32 - 5000.0, 0.5])).collect();
    let mean = values.iter().sum::<f32>() / 1e4;
    let variance = values.iter().map(|v| v * v).sum::<f32>() / 1e4;
    assert!(mean.abs() < 0.02 && (variance - 1.0 / 3.0).abs() < 0.02, "{mean} {variance}");
    assert_eq!(white_noise(3, [-0.9, 0.1]), white_noise(3, [-0.1, 0.9]));
    assert_ne!(white_noise(3, [-0.9, 0.1]), white_noise(3, [0.1, 0.1]));
}

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

#[test]
fn derivatives_on_simplices_are_those_of_the_value() {
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

#[test]
fn distances_are_ordered_and_change_gently() {
    for p in points::<4>(300) {
        let here = cellular(1, p, CellularMetric::Euclidean);
        let there = cellular(1, [p[0] + 1e-3, p[1], p[2], p[3]], CellularMetric::Euclidean);
        assert!(here.nearest <= here.second && here.nearest < 2.0);
        assert!((here.nearest - there.nearest).abs() < 1.1e-3);
    }
}

#[test]
fn fast_and_general_gradient_noise_are_one_pattern() {
    for p in points::<3>(5000) {
        let difference = NoiseFamily::Perlin.value(CellularMetric::default(), 7, p) - gradient_noise(7, p).0;
        assert!(difference.abs() < 1e-5, "{difference} at {p:?}");
    }
}

#[test]
fn sums_have_the_mean_they_state_and_wide_footprints_leave_it() {
    for (family, metric) in FAMILIES {
        for kind in KINDS {
            let noise = FractalNoise::with_metric(family, metric, kind, Fractal::octaves(4), 11);
            let count = 20_000;
            let mean =
                points::<3>(count).map(|p| f64::from(noise.value(p, 0.0))).sum::<f64>() / f64::from(count);
            assert!(
                (mean as f32 - noise.mean()).abs() < 0.02,
                "{family:?} {kind:?}: {mean} {}",
                noise.mean()
            );
            let calm = noise.value([0.3, 0.4, 0.5], 100.0);
            assert!((calm - noise.mean()).abs() < 1e-5, "{family:?} {kind:?}");
        }
    }
}

/// Points far apart, and points along lines so fine that neighbours share the cells of most octaves.
fn scattered_and_lined_up(count: u32) -> Vec<Vec3> {
    let lines = |i: u32| Vec3::new(0.003 * i as f32 - 0.9, 5.1 + (i / 64) as f32, 0.001 * i as f32);
    points::<3>(count).map(Vec3::from_array).chain((0..count).map(lines)).collect()
}

#[test]
fn sums_at_many_points_are_those_at_single_ones() {
    let places = scattered_and_lined_up(150);
    let widths: Vec<f32> = (0..places.len()).map(|i| 0.002 * i as f32).collect();
    for (family, metric) in FAMILIES {
        for kind in KINDS {
            let noise = FractalNoise::with_metric(family, metric, kind, Fractal::octaves(5), 3);
            let mut sums = vec![f32::NAN; places.len()];
            noise.values(&places, &widths, &mut sums);
            for ((p, &width), sum) in places.iter().zip(&widths).zip(&sums) {
                assert_eq!(*sum, noise.value(p.to_array(), width), "{family:?} {kind:?} at {p}");
            }
            let in_time: Vec<Vec4> = places.iter().map(|p| p.extend(0.3 * p.y)).collect();
            noise.values_4d(&in_time, &widths, &mut sums);
            for ((p, &width), sum) in in_time.iter().zip(&widths).zip(&sums) {
                assert_eq!(*sum, noise.value(p.to_array(), width), "{family:?} {kind:?} at {p}");
            }
        }
    }
}

#[test]
fn no_points_have_no_values() {
    for (family, metric) in FAMILIES {
        let noise = FractalNoise::with_metric(family, metric, FractalKind::Fbm, Fractal::octaves(5), 3);
        noise.values(&[], &[], &mut []);
        noise.values_4d(&[], &[], &mut []);
    }
    cellular_all(9, &[], CellularMetric::Euclidean, &mut []);
}

#[test]
fn sums_of_gradient_noise_at_many_points_are_those_at_single_ones() {
    let noise = Noise::new(5);
    let places = scattered_and_lined_up(200);
    // From points to footprints that leave nothing.
    let footprints: Vec<f32> = (0..places.len()).map(|i| (i % 7) as f32 * 0.15).collect();
    let mut sums = vec![f32::NAN; places.len()];
    for fractal in [1, 5, 20].map(Fractal::octaves) {
        for count in [1, 3, 4, 63, 64, 65, 400] {
            let (at, widths, sums) = (&places[..count], &footprints[..count], &mut sums[..count]);
            noise.fbm_all(at, fractal, widths, sums);
            (0..count).for_each(|i| assert_eq!(sums[i], noise.fbm(at[i], fractal, widths[i])));
        }
    }
}

#[test]
fn cells_at_many_points_are_those_at_single_ones() {
    let places = scattered_and_lined_up(20_000);
    let mut found = vec![Cellular::default(); places.len()];
    for metric in [CellularMetric::Euclidean, CellularMetric::Manhattan, CellularMetric::Chebyshev] {
        cellular_all(9, &places, metric, &mut found);
        for (p, found) in places.iter().zip(&found) {
            assert_eq!(*found, cellular(9, p.to_array(), metric), "{metric:?} at {p}");
        }
    }
}

#[test]
fn footprints_take_away_detail_steadily() {
    let noise = FractalNoise::new(NoiseFamily::Simplex, FractalKind::Fbm, Fractal::octaves(5), 2);
    let variance =
        |footprint: f32| points::<4>(4000).map(|p| noise.value(p, footprint).powi(2)).sum::<f32>() / 4000.0;
    let steps = [0.0, 0.03, 0.1, 0.3, 0.6].map(variance);
    assert!(steps.windows(2).all(|w| w[1] <= w[0] * 1.001), "{steps:?}");
}

#[test]
fn means_of_waves_over_a_footprint_equal_those_of_many_points() {
    let waves = points::<4>(12).map(|[x, y, z, w]| Wave {
        direction: Vec3::new(x, y, z),
        length: 0.3 + 0.1 * w.abs(),
        amplitude: 0.2,
        phase: f64::from(40.0 * w),
        speed: 0.0,
    });
    let sines = Sines { waves: waves.collect(), offset: 0.5 };
    let value = |position: Vec3, position_steps: [Vec3; 2]| {
        sines.evaluate(&ShadingPoint { position_steps, ..shading_point(position, Vec3::Z) }).x
    };
    let steps = [Vec3::new(0.1, 0.02, 0.0), Vec3::new(-0.03, 0.05, 0.08)];
    for p in points::<3>(20).map(Vec3::from) {
        let count = 64;
        let mut sum = 0.0;
        for i in 0..count * count {
            let [a, b] = [i % count, i / count].map(|n| (n as f32 + 0.5) / count as f32 - 0.5);
            sum += value(p + steps[0] * a + steps[1] * b, [Vec3::ZERO; 2]);
        }
        let mean = sum / (count * count) as f32;
        assert!((mean - value(p, steps)).abs() < 1e-3, "{p}");
    }
}

mod perlin3 {
    use fantex_texture::noise::{Fractal, Noise};
    use glam::Vec3;

    fn points() -> impl Iterator<Item = Vec3> {
        (0..200_000).map(|i| {
            let i = i as f32;
            Vec3::new(i * 0.754_877, i * 0.569_84, i * 0.430_159) % 97.0
        })
    }

    #[test]
    fn many_points_and_octaves_in_vectors_equal_single_points() {
        let noise = Noise::new(11);
        let points: Vec<Vec3> = points().take(1003).map(|p| p - 48.0).collect();
        let mut values = vec![0.0; points.len()];
        noise.values(&points, &mut values);
        for (&p, value) in points.iter().zip(values) {
            assert_eq!(noise.value(p), value, "{p}");
            // One octave after the other, by the scalar code.
            for octaves in [1, 3, 8, 9, 16] {
                let fractal = Fractal { octaves, lacunarity: 1.3, gain: 0.7 };
                let one_by_one: f32 = (0..octaves)
                    .fold((0.0, 1.0, 1.0), |(sum, frequency, amplitude), i| {
                        let octave = Noise::new(11_u32.wrapping_add(i.wrapping_mul(0x632b_e5ab)));
                        let q = p * frequency + Vec3::new(17.3, 5.9, 41.7) * i as f32;
                        (sum + amplitude * octave.value(q), frequency * 1.3, amplitude * 0.7)
                    })
                    .0;
                assert_eq!(noise.fbm(p, fractal, 0.0), one_by_one, "{octaves} octaves at {p}");
            }
        }
    }

    #[test]
    fn seeds_differ_and_lattice_points_are_zero() {
        let p = Vec3::new(0.3, 4.7, -2.2);
        assert_ne!(Noise::new(1).value(p), Noise::new(2).value(p));
        assert_eq!(Noise::new(1).value(Vec3::new(3.0, -8.0, 5.0)), 0.0);
        // Far outside there is no precision left, but nothing breaks.
        for far in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e30] {
            Noise::new(1).value(Vec3::splat(far));
        }
    }
}
