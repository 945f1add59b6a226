//! How noisy a light map is: standard errors of all its texels, summed so that the order does not matter.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// The noise of the texels that a light map's source has computed so far. Errors are standard errors, in units of the values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightMapNoise {
    /// Texels computed; where tiles overlap, points of the surface count more than once.
    pub texels: u64,
    /// Mean number of paths per texel.
    pub mean_samples: f64,
    /// Mean of the values, over texels and channels.
    pub mean_value: f64,
    /// Mean of the standard errors.
    pub mean_error: f64,
    /// 95 % of the standard errors are not above this (to a quarter of an octave).
    pub error_95: f64,
    /// The largest standard error (to a quarter of an octave).
    pub largest_error: f64,
}

/// Sums are whole multiples of this.
const UNIT: f64 = 1.0 / (1 << 24) as f64;
/// What a single texel adds is at most this.
const MOST: f64 = (1 << 14) as f64;
/// Buckets of a quarter of an octave.
const BUCKETS: usize = 160;
/// Upper end of the first bucket.
const FIRST: f64 = UNIT;

/// Gathers errors from many threads; whole numbers, so that the sums do not depend on the order.
#[derive(Debug)]
pub(super) struct NoiseMeter {
    texels: AtomicU64,
    samples: AtomicU64,
    values: AtomicU64,
    errors: AtomicU64,
    buckets: Vec<AtomicU64>,
}

impl Default for NoiseMeter {
    fn default() -> Self {
        let zero = || AtomicU64::new(0);
        let buckets = (0..BUCKETS).map(|_| zero()).collect();
        Self { texels: zero(), samples: zero(), values: zero(), errors: zero(), buckets }
    }
}

impl NoiseMeter {
    pub(super) fn add(&self, value: f32, error: f32, samples: u32) {
        let units = |x: f32| (f64::from(x).clamp(0.0, MOST) / UNIT).round() as u64;
        self.texels.fetch_add(1, Relaxed);
        self.samples.fetch_add(samples.into(), Relaxed);
        self.values.fetch_add(units(value), Relaxed);
        self.errors.fetch_add(units(error), Relaxed);
        self.buckets[bucket(error.into())].fetch_add(1, Relaxed);
    }

    pub(super) fn report(&self) -> LightMapNoise {
        let texels = self.texels.load(Relaxed);
        let mean = |sum: &AtomicU64| sum.load(Relaxed) as f64 / texels.max(1) as f64;
        let counts: Vec<u64> = self.buckets.iter().map(|b| b.load(Relaxed)).collect();
        let mut below = 0;
        let error_95 = counts.iter().position(|count| {
            below += count;
            below * 20 >= texels * 19
        });
        let largest = counts.iter().rposition(|&count| count > 0);
        LightMapNoise {
            texels,
            mean_samples: mean(&self.samples),
            mean_value: mean(&self.values) * UNIT,
            mean_error: mean(&self.errors) * UNIT,
            error_95: error_95.filter(|_| texels > 0).map_or(0.0, upper_end),
            largest_error: largest.map_or(0.0, upper_end),
        }
    }
}

/// The bucket of an error: the first for all that is below its end.
fn bucket(error: f64) -> usize {
    if error <= FIRST {
        return 0;
    }
    ((4.0 * (error / FIRST).log2()).ceil() as usize).min(BUCKETS - 1)
}

fn upper_end(bucket: usize) -> f64 {
    if bucket == 0 { 0.0 } else { FIRST * (bucket as f64 / 4.0).exp2() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_percentiles_are_those_of_the_errors() {
        let meter = NoiseMeter::default();
        assert_eq!(meter.report(), LightMapNoise::default());
        for i in 1..=1000_u32 {
            meter.add(2.0, i as f32 / 1000.0, 64 + i % 2);
        }
        let report = meter.report();
        assert_eq!(report.texels, 1000);
        assert!((report.mean_samples - 64.5).abs() < 1e-9 && (report.mean_value - 2.0).abs() < 1e-6);
        assert!((report.mean_error - 0.5005).abs() < 1e-4);
        assert!((0.95..0.95 * 1.19).contains(&report.error_95), "{}", report.error_95);
        assert!((1.0..1.2).contains(&report.largest_error), "{}", report.largest_error);
    }

    #[test]
    fn what_is_exact_has_no_error() {
        let meter = NoiseMeter::default();
        meter.add(1.0, 0.0, 4);
        assert_eq!((meter.report().error_95, meter.report().largest_error), (0.0, 0.0));
    }
}
