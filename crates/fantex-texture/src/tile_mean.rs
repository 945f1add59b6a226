//! What stands for all of a tile where pixels are larger than it.

use fantex_mesh::AlphaMode;
use glam::{DVec3, DVec4, Vec4};

use crate::filter::TRANSPARENT_WEIGHT;
use crate::levels::Covered;

/// The mean of linear values, in double precision; of colours with coverage those of red, green and blue in proportion to alpha.
#[derive(Clone, Copy, Debug, Default)]
pub struct TexelMean {
    /// Red, green and blue by their weights; alpha.
    sum: DVec4,
    weight: f64,
    count: f64,
}

impl TexelMean {
    /// Adds a value whose alpha is no coverage.
    #[inline]
    pub fn add(&mut self, value: Vec4) {
        self.add_weighted(value, 1.0);
    }

    /// Adds a colour whose alpha is coverage; something counts of transparent ones, so that these alone have a mean, too.
    #[inline]
    pub fn add_covered(&mut self, value: Vec4) {
        self.add_weighted(value, value.w.max(0.0) + TRANSPARENT_WEIGHT);
    }

    #[inline]
    fn add_weighted(&mut self, value: Vec4, weight: f32) {
        self.sum += (value.truncate() * weight).extend(value.w).as_dvec4();
        self.weight += f64::from(weight);
        self.count += 1.0;
    }

    /// The mean; `None` where nothing was added.
    pub fn value(&self) -> Option<Vec4> {
        let mean = || self.sum / DVec3::splat(self.weight).extend(self.count);
        (self.count > 0.0).then(|| mean().as_vec4())
    }
}

/// The cut-out that takes most of the area of a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LargestCutOut {
    threshold: f32,
    /// Among the thresholds of the tile, in ascending order.
    number: usize,
}

/// How far the alpha of a mean lies from the threshold: half a step of 8 bits.
const OVER_THRESHOLD: f32 = 1.0 / 512.0;

impl LargestCutOut {
    /// Of parts of a surface with their areas; `None` where nothing is cut out, or what is blended takes more.
    pub fn of(parts: impl IntoIterator<Item = (AlphaMode, f64)>) -> Option<Self> {
        let (mut cut_outs, mut blended): (Vec<(f32, f64)>, f64) = (Vec::new(), 0.0);
        for (mode, area) in parts {
            match mode {
                AlphaMode::Opaque => {}
                AlphaMode::Blend => blended += area,
                AlphaMode::Mask(threshold) => {
                    match cut_outs.iter_mut().find(|(known, _)| known.total_cmp(&threshold).is_eq()) {
                        Some((_, sum)) => *sum += area,
                        None => cut_outs.push((threshold, area)),
                    }
                }
            }
        }
        let by_area = |a: &&(f32, f64), b: &&(f32, f64)| a.1.total_cmp(&b.1);
        let &(threshold, area) = cut_outs.iter().max_by(by_area)?;
        let number = cut_outs.iter().filter(|(other, _)| other.total_cmp(&threshold).is_lt()).count();
        (area >= blended).then_some(Self { threshold, number })
    }

    /// The alpha that the mean of a tile is given instead of the mean of its alpha. `group`: the tile's number.
    ///
    /// Look-ups blend from the last level to the mean as pixels grow from a quarter of the tile to all of it. With an alpha at the threshold,
    /// what passes on the last level passes until then. Of pixels larger than tiles, tiles are shown or not as wholes: as many of them as the
    /// share says that is there, evenly spread over the groups (the additive recurrence by the golden ratio).
    pub fn alpha_of_mean(&self, mean: f32, covered: &Covered, group: u32) -> f32 {
        match covered.0.get(self.number) {
            Some(&Some(covered)) if covered > 0.0 && covered < 1.0 => {
                let place = (1u32 << 31).wrapping_add(group.wrapping_mul(0x9e37_79b9));
                let is_shown = f64::from(place) < f64::from(covered) * f64::from(u32::MAX);
                let over = if is_shown { OVER_THRESHOLD } else { -OVER_THRESHOLD };
                (self.threshold + over).clamp(0.0, 1.0)
            }
            _ => mean,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_tiles_pass_as_is_there() {
        let mask = |threshold| AlphaMode::Mask(threshold);
        let parts = [(mask(0.5), 2.0), (mask(0.25), 1.0), (AlphaMode::Blend, 1.5), (mask(0.5), 0.5)];
        let cut_out = LargestCutOut::of(parts).unwrap();
        assert_eq!(cut_out, LargestCutOut { threshold: 0.5, number: 1 });
        for share in [0.03, 0.3, 0.8] {
            let covered = Covered(vec![Some(0.9), Some(share)]);
            let shown = (0..1000).filter(|&group| cut_out.alpha_of_mean(0.1, &covered, group) > 0.5).count();
            assert!((shown as f32 - 1000.0 * share).abs() < 4.0, "{share}: {shown}");
        }
        for all_or_nothing in [Some(0.0), Some(1.0), None] {
            assert_eq!(cut_out.alpha_of_mean(0.1, &Covered(vec![None, all_or_nothing]), 3), 0.1);
        }
        assert_eq!(LargestCutOut::of([(mask(0.5), 1.0), (AlphaMode::Blend, 1.5)]), None);
        assert_eq!(LargestCutOut::of([(AlphaMode::Opaque, 1.0)]), None);
    }

    #[test]
    fn what_is_transparent_has_no_say_in_colours() {
        let mut mean = TexelMean::default();
        assert_eq!(mean.value(), None);
        mean.add_covered(Vec4::new(1.0, 0.0, 0.0, 0.0));
        assert!(mean.value().unwrap().abs_diff_eq(Vec4::new(1.0, 0.0, 0.0, 0.0), 1e-6));
        mean.add_covered(Vec4::new(0.0, 0.5, 1.0, 0.5));
        assert!(mean.value().unwrap().abs_diff_eq(Vec4::new(0.0, 0.5, 1.0, 0.25), 1e-4));
    }
}
