//! Which photographs count at a point, and how much.

use glam::Vec3;

/// A photograph counts at a point if its weight is more than this share of the largest one there.
pub(crate) const KEPT_SHARE: f32 = 0.1;

/// What a photograph counts at a point, if it does: its weight, and that beyond the share it must have. Both are continuous, so
/// photographs come and go without a step, and the best one always stays.
fn kept_weight(weight: f32, largest: f32) -> f32 {
    weight / largest * (weight / largest - KEPT_SHARE).max(0.0)
}

/// How sure it is that a point is seen at all, 0..=1, from the confidences of the photographs: 1 if one of them is sure.
pub(crate) fn joint_confidence(confidences: impl Iterator<Item = f32>) -> f32 {
    1.0 - confidences.map(|confidence| 1.0 - confidence.clamp(0.0, 1.0)).product::<f32>()
}

/// The confidence from which on the fill of unseen surface does not count.
const SEEN_CONFIDENCE: f32 = 0.1;

/// What several photographs see of a point. Of one that a mask leaves out there, weight and confidence are as much less.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blend {
    /// Weight, above 0, and colour.
    seen: Vec<(f32, Vec3)>,
    largest: f32,
    confidence: f32,
}

impl Blend {
    /// Adds what one photograph sees.
    pub(crate) fn add(&mut self, weight: f32, color: Vec3, confidence: f32) {
        if weight > 0.0 {
            self.seen.push((weight, color));
            self.largest = self.largest.max(weight);
        }
        self.confidence = joint_confidence([self.confidence, confidence].into_iter());
    }

    /// Whether photographs of at most this weight change nothing, whatever they see.
    pub(crate) fn is_settled(&self, weight: f32) -> bool {
        weight <= self.largest * KEPT_SHARE && self.is_sure()
    }

    /// Whether the fill of unseen surface does not count.
    pub(crate) fn is_sure(&self) -> bool {
        self.confidence >= SEEN_CONFIDENCE
    }

    /// The share of what was seen, beside what is filled in.
    pub(crate) fn seen_share(&self) -> f32 {
        crate::view::smooth(f64::from(self.confidence / SEEN_CONFIDENCE))
    }

    /// The blended colour; none where nothing is seen.
    pub(crate) fn color(&self) -> Option<Vec3> {
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for &(weight, color) in &self.seen {
            let weight = kept_weight(weight, self.largest);
            sum += color * weight;
            total += weight;
        }
        (total > 0.0).then(|| sum / total)
    }
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
    }

    #[test]
    fn what_a_mask_leaves_out_of_the_best_another_one_shows() {
        // Photographs by their weight without masks, and how much of each is left.
        let blend = |masks: [f32; 2]| {
            let mut blend = Blend::default();
            for ((weight, color), mask) in [(1.0, Vec3::Y), (0.05, Vec3::X)].into_iter().zip(masks) {
                if !blend.is_settled(weight) {
                    blend.add(weight * mask, color, mask);
                }
            }
            blend
        };
        let [open, masked, none] = [[1.0, 1.0], [0.0, 1.0], [0.0, 0.0]].map(blend);
        assert_eq!((open.color(), open.seen.len(), open.seen_share()), (Some(Vec3::Y), 1, 1.0));
        assert_eq!((masked.color(), masked.seen_share()), (Some(Vec3::X), 1.0));
        assert_eq!((none.color(), none.seen_share()), (None, 0.0));
        // From one to the other without a step.
        let mut before = open.color().unwrap();
        for i in (0..=2000).rev() {
            let now = blend([i as f32 / 2000.0, 1.0]).color().unwrap();
            assert!(now.distance(before) < 0.05, "{i}: {before} {now}");
            before = now;
        }
    }
}
