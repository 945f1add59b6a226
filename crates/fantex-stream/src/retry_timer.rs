//! When what a network has lost is asked for again.

/// Seconds before the first attempt, and at most between two: each pause is twice the one before.
const PAUSE_SECONDS: [f32; 2] = [2.0, 60.0];

/// Tells when it is time to try again what failed for a reason that may pass.
#[derive(Clone, Debug)]
pub struct RetryTimer {
    pause: f32,
    left: f32,
    /// What was tried again has come.
    is_back: bool,
}

impl Default for RetryTimer {
    fn default() -> Self {
        Self { pause: PAUSE_SECONDS[0], left: PAUSE_SECONDS[0], is_back: false }
    }
}

impl RetryTimer {
    /// Whether it is time, so many seconds after it was asked last; in any case where something `is_back`.
    pub fn is_due(&mut self, elapsed_seconds: f32, is_back: bool) -> bool {
        self.left -= elapsed_seconds;
        self.is_back = is_back;
        is_back || self.left <= 0.0
    }

    /// When it was due, that was done: whether there was anything to try (`has_any`).
    pub fn tried(&mut self, has_any: bool) {
        let [first, longest] = PAUSE_SECONDS;
        self.pause = if has_any && !self.is_back { (2.0 * self.pause).min(longest) } else { first };
        self.left = self.pause;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_until_something_is_back() {
        let mut timer = RetryTimer::default();
        let mut wait = |is_back: bool, has_any: bool| {
            let seconds = 1 + (0..1000).take_while(|_| !timer.is_due(1.0, is_back)).count();
            timer.tried(has_any);
            seconds
        };
        let pauses: Vec<usize> = (0..8).map(|_| wait(false, true)).collect();
        assert_eq!(pauses, [2, 4, 8, 16, 32, 60, 60, 60]);
        assert_eq!([wait(true, true), wait(true, true), wait(false, false), wait(false, true)], [1, 1, 2, 2]);
    }
}
