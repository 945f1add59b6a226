//! Which photographs count at a point, and how much.

/// A photograph counts at a point if its weight is more than this share of the largest one there.
pub(crate) const KEPT_SHARE: f32 = 0.1;

/// What a photograph counts at a point, if it does: its weight, and that beyond the share it must have. Both are continuous, so
/// photographs come and go without a step, and the best one always stays.
pub(crate) fn kept_weight(weight: f32, largest: f32) -> f32 {
    weight / largest * (weight / largest - KEPT_SHARE).max(0.0)
}

/// How sure it is that a point is seen at all, from the confidences of the photographs: 1 if one of them is sure.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Doubt(f32);

impl Doubt {
    /// Nobody has seen anything.
    pub(crate) const WHOLE: Self = Self(1.0);

    /// With another photograph of this confidence.
    pub(crate) fn less(self, confidence: f32) -> Self {
        Self(self.0 * (1.0 - confidence.clamp(0.0, 1.0)))
    }

    /// In 0..=1.
    pub(crate) fn confidence(self) -> f32 {
        1.0 - self.0
    }
}

/// The confidence from which on the fill of unseen surface does not count.
pub(crate) const SEEN_CONFIDENCE: f32 = 0.1;

/// The share of what was seen, beside what is filled in.
pub(crate) fn seen_share(confidence: f32) -> f32 {
    crate::view::smooth(f64::from(confidence / SEEN_CONFIDENCE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_continuous_and_the_best_stays() {
        let mut before = kept_weight(0.0, 1.0);
        for i in 0..=1000 {
            let now = kept_weight(i as f32 * 1e-3, 1.0);
            assert!(now >= before && now - before < 0.003);
            before = now;
        }
        assert_eq!(kept_weight(KEPT_SHARE, 1.0), 0.0);
        assert!(kept_weight(7.0, 7.0) > 0.89);
        assert_eq!(seen_share(0.0), 0.0);
        assert_eq!(seen_share(Doubt::WHOLE.less(0.3).less(0.0).confidence()), 1.0);
    }
}
