//! Figures over time, for graphs.

use std::collections::VecDeque;

/// The last values of a figure, oldest first.
#[derive(Clone, Debug)]
pub struct History {
    values: VecDeque<f32>,
    capacity: usize,
}

impl History {
    /// Keeps the last `capacity` (at least one) values.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { values: VecDeque::with_capacity(capacity), capacity }
    }

    /// Adds a value; anything but a finite number counts as zero.
    pub fn push(&mut self, value: f32) {
        if self.values.len() == self.capacity {
            self.values.pop_front();
        }
        self.values.push_back(if value.is_finite() { value } else { 0.0 });
    }

    /// The values, oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = f32> + ExactSizeIterator + '_ {
        self.values.iter().copied()
    }

    /// The newest value.
    pub fn last(&self) -> Option<f32> {
        self.values.back().copied()
    }

    /// How many values are kept at most.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.values.clear();
    }

    /// The value that a share (0..1) of the values does not exceed.
    pub fn percentile(&self, share: f32) -> Option<f32> {
        let mut sorted: Vec<f32> = self.iter().collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let rank = (share.clamp(0.0, 1.0) * sorted.len() as f32).ceil() as usize;
        Some(sorted[rank.saturating_sub(1).min(last)])
    }

    /// The greatest value.
    pub fn max(&self) -> Option<f32> {
        self.iter().reduce(f32::max)
    }
}

/// Counts something per second, over the last second or so.
#[derive(Clone, Debug, Default)]
pub struct RateMeter {
    /// Time in seconds and count up to then.
    samples: VecDeque<(f64, f64)>,
}

impl RateMeter {
    /// Seconds over which the mean is taken.
    const WINDOW: f64 = 1.0;

    /// Tells how much there has been up to a time (seconds, ascending), and returns how much it is per second.
    pub fn update(&mut self, seconds: f64, total: f64) -> f64 {
        if self.samples.back().is_some_and(|&(_, before)| total < before) {
            // Counting has begun anew.
            self.samples.clear();
        }
        self.samples.push_back((seconds, total));
        while self.samples.len() > 2 && self.samples[1].0 <= seconds - Self::WINDOW {
            self.samples.pop_front();
        }
        let (first_seconds, first_total) = self.samples[0];
        let span = seconds - first_seconds;
        if span > 0.0 { (total - first_total) / span } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_forget_the_oldest() {
        let mut history = History::new(3);
        for value in [9.0, 1.0, f32::NAN, 2.0] {
            history.push(value);
        }
        assert_eq!(history.iter().collect::<Vec<_>>(), [1.0, 0.0, 2.0]);
        assert_eq!((history.last(), history.max()), (Some(2.0), Some(2.0)));
    }

    #[test]
    fn percentiles_are_values_that_occurred() {
        let mut history = History::new(100);
        assert_eq!(history.percentile(0.5), None);
        (1..=100).for_each(|i| history.push(i as f32));
        assert_eq!(history.percentile(0.5), Some(50.0));
        assert_eq!(history.percentile(0.99), Some(99.0));
        assert_eq!(history.percentile(1.0), Some(100.0));
        assert_eq!(history.percentile(0.0), Some(1.0));
    }

    #[test]
    fn rates_are_means_over_a_second() {
        let mut meter = RateMeter::default();
        assert_eq!(meter.update(0.0, 0.0), 0.0);
        let mut rate = 0.0;
        for i in 1..=40 {
            rate = meter.update(f64::from(i) * 0.1, f64::from(i) * 5.0);
        }
        assert!((rate - 50.0).abs() < 1e-6, "{rate}");
        assert_eq!(meter.update(4.1, 0.0), 0.0, "a count that falls starts anew");
        for i in 1..=20 {
            rate = meter.update(4.1 + f64::from(i) * 0.1, 0.0);
        }
        assert_eq!(rate, 0.0);
    }
}
