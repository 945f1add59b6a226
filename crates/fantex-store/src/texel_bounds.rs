//! Between which values texels lie: what rounding, clamping, fitting and mixing leave open.
//!
//! A bake knows the values that it averages for coarser levels, a reader only what is stored of them. So each value is known within
//! bounds, and a mean lies between the means of the bounds.

use glam::{Vec3, Vec4};

use crate::{Channel, ChannelKind, TexelFormat};

/// Component by component, **linear**.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) low: Vec4,
    pub(crate) high: Vec4,
}

impl Bounds {
    /// Those of one or the other.
    pub(crate) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// No source gives more where what exceeds 1 is clamped when it is stored.
const BRIGHTEST: f32 = 16.0;

/// More than half a step of 8 bits: what rounding changes at most.
const ROUNDING: f32 = 0.75 / 255.0;

/// Alpha of BC7 from here on is that of opaque texels.
const BC7_OPAQUE: f32 = 0.98;

/// The share of a colour whose alpha is 0 (`fantex_texture::levels`), and more.
const TRANSPARENT_WEIGHT: f32 = 2e-6;

/// What the numbers of a channel say in a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoredValues {
    format: TexelFormat,
    is_srgb: bool,
    /// The values of texels of which nothing is known.
    pub(crate) unknown: Bounds,
    /// From here on a number may stand for a larger one, and from as near to 0 for a smaller one.
    full: f32,
    clamps_above: bool,
    clamps_below: bool,
    /// Colours are averaged by their alpha.
    has_coverage: bool,
    /// Of cut-outs, alpha is scaled by a factor that is not stored.
    is_cut_out: bool,
}

/// From this linear value on a texel may be clamped.
pub(crate) fn full_value(format: TexelFormat) -> f32 {
    if format.is_compressed() { 0.95 } else { 0.995 }
}

/// Whether sources may give more than 1 where the channel holds 1: lamps, and what they shine on.
pub(crate) fn may_exceed_one(channel: &Channel) -> bool {
    let is_bright =
        matches!(channel.kind, ChannelKind::BaseColor | ChannelKind::Emission | ChannelKind::Light);
    is_bright && channel.format != TexelFormat::Rgba32F
}

impl StoredValues {
    /// `exceeds_one`: texels nearby are clamped. `is_cut_out`: triangles of the tile are cut-outs.
    pub(crate) fn new(channel: &Channel, exceeds_one: bool, is_cut_out: bool) -> Self {
        let is_float = channel.format == TexelFormat::Rgba32F;
        let is_height = channel.kind == ChannelKind::Displacement;
        let (least, most) = if is_float {
            (f32::NEG_INFINITY, f32::INFINITY)
        } else if is_height {
            (-BRIGHTEST, BRIGHTEST)
        } else if exceeds_one {
            (0.0, BRIGHTEST)
        } else {
            (0.0, 1.0)
        };
        let unknown = Bounds { low: Vec3::splat(least).extend(0.0), high: Vec3::splat(most).extend(1.0) };
        let has_coverage = channel.kind == ChannelKind::BaseColor;
        Self {
            format: channel.format,
            is_srgb: channel.srgb,
            unknown,
            full: full_value(channel.format),
            clamps_above: !is_float && (is_height || exceeds_one),
            clamps_below: !is_float && is_height,
            has_coverage,
            is_cut_out: is_cut_out && has_coverage,
        }
    }

    /// Of a stored texel, given as linear RGBA.
    pub(crate) fn of_texel(&self, value: Vec4) -> Bounds {
        let Bounds { low: least, high: most } = self.unknown;
        let step = self.rounding(value);
        let mut low = (value - step).clamp(least, most);
        let mut high = (value + step).clamp(least, most);
        for k in 0..3 {
            if self.clamps_above && value[k] >= self.full {
                high[k] = most[k];
            }
            if self.clamps_below && value[k] <= 1.0 - self.full {
                low[k] = least[k];
            }
        }
        if self.is_transparent(value) {
            (low, high) = (least, most);
        }
        (low.w, high.w) = self.alpha(value.w);
        Bounds { low, high }
    }

    /// Whether a texel holds no colour: BC1 has black in its place.
    pub(crate) fn is_transparent(&self, value: Vec4) -> bool {
        self.format == TexelFormat::Bc1 && value.w < 0.5
    }

    /// The components of a texel that can be compared: the stored ones, without alpha of one bit and alpha that is scaled.
    pub(crate) fn compared(&self) -> usize {
        let count = self.format.channel_count();
        if count == 4 && (self.format == TexelFormat::Bc1 || self.is_cut_out) { 3 } else { count }
    }

    fn rounding(&self, value: Vec4) -> Vec4 {
        if self.format == TexelFormat::Rgba32F {
            return value.abs() * 1e-6;
        }
        if !self.is_srgb {
            return Vec4::splat(ROUNDING);
        }
        // The slope of the sRGB curve is nowhere more than this.
        let slope = |linear: f32| 0.1 + 2.3 * linear.max(0.0).sqrt();
        value.truncate().map(|linear| ROUNDING * slope(linear)).extend(ROUNDING)
    }

    fn alpha(&self, alpha: f32) -> (f32, f32) {
        match self.format {
            TexelFormat::Bc1 if alpha >= 0.5 => (0.5, 1.0),
            TexelFormat::Bc1 => (0.0, 0.5),
            TexelFormat::Bc7 if alpha >= BC7_OPAQUE => (1.0, 1.0),
            TexelFormat::Bc7 => (0.0, 1.0),
            // Rounded to 1, perhaps.
            TexelFormat::Rgba32F if alpha >= 1.0 => (1.0, 1.0),
            _ => ((alpha - ROUNDING).clamp(0.0, 1.0), (alpha + ROUNDING).clamp(0.0, 1.0)),
        }
    }

    /// Between which values the mean of some texels lies, of which one at least counts.
    pub(crate) fn mean(&self, parts: &[Part]) -> Bounds {
        let is_opaque = !self.is_cut_out && parts.iter().all(|part| part.bounds.low.w == 1.0);
        let is_plain = is_opaque || !self.has_coverage;
        if is_plain && parts.iter().all(|part| part.least == part.most) {
            let total: f32 = parts.iter().map(|part| part.most).sum();
            let mean = |of: fn(&Bounds) -> Vec4| {
                parts.iter().map(|part| of(&part.bounds) * (part.most / total)).sum::<Vec4>()
            };
            return Bounds { low: mean(|bounds| bounds.low), high: mean(|bounds| bounds.high) };
        }
        let mut bounds = self.unknown;
        for k in 0..4 {
            let mut weighted = [Weighted::default(); MAX_PARTS];
            let weighted = &mut weighted[..parts.len()];
            let mut greatest = |value: fn(&Bounds, usize) -> f32| {
                for (weighted, part) in weighted.iter_mut().zip(parts) {
                    let value = value(&part.bounds, k);
                    let [least, most] =
                        if k < 3 { self.color_weights(part) } else { [part.least, part.most] };
                    *weighted = Weighted { value, least, most };
                }
                greatest_mean(weighted)
            };
            bounds.high[k] = greatest(|bounds, k| bounds.high[k]);
            bounds.low[k] = -greatest(|bounds, k| -bounds.low[k]);
        }
        bounds
    }

    /// How much the colour of a texel counts, at least and at most.
    fn color_weights(&self, part: &Part) -> [f32; 2] {
        let [least, most] = if !self.has_coverage {
            [1.0; 2]
        } else if self.is_cut_out {
            [0.0, 1.0]
        } else {
            [part.bounds.low.w, part.bounds.high.w]
        };
        // Nothing counts less than a trace.
        let trace = if self.has_coverage { TRANSPARENT_WEIGHT } else { 0.0 };
        [part.least * least, part.most * (most + trace)]
    }
}

/// Finer texels under a coarser one, at most.
pub(crate) const MAX_PARTS: usize = 16;

/// A finer texel under a coarser one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub(crate) bounds: Bounds,
    /// The area that it has in the mean, at least: 0 where it may not count.
    pub(crate) least: f32,
    /// The same at most.
    pub(crate) most: f32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Weighted {
    value: f32,
    least: f32,
    most: f32,
}

/// The greatest mean of values whose weights are known within bounds; one weight at least may be positive.
fn greatest_mean(values: &mut [Weighted]) -> f32 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for part in values.iter().filter(|part| part.least > 0.0) {
        sum += part.least * part.value;
        weight += part.least;
    }
    // Values above the mean count as much as they may, others as little.
    values.sort_unstable_by(|a, b| b.value.total_cmp(&a.value));
    for part in values.iter() {
        if weight > 0.0 && part.value * weight <= sum {
            break;
        }
        let more = part.most - part.least;
        if more > 0.0 {
            sum += more * part.value;
            weight += more;
        }
    }
    sum / weight
}

/// Steps of [`unfitted`], each of which leaves open a third of what the one before did; and how far they look.
pub(crate) const FIT_STEPS: u32 = 6;

/// A texel of a rectangle of level 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FittedTexel {
    /// What is stored; none where nothing is.
    pub(crate) stored: Option<Bounds>,
    /// It may have a value of its own, which its neighbours are fitted to.
    pub(crate) may_count: bool,
}

/// The values that a level 0 was fitted to: bakes store `c - k d`, held near the neighbours' range, where `d` are the second differences of
/// the values `c` along both axes, or along those on which both neighbours have a value. `k` is an eighth at most, and none where nothing
/// is fitted.
///
/// So `(1 + 2k a) c - k (sum of the neighbours along a axes)` is stored where nothing is held, and `c` is a mean of what is stored and of the
/// neighbours. Where it is held from above, `c` is not more than what is stored, as that is held beyond `c` itself; from below, not less.
///
/// `texels`: row by row, so many columns. `is_end`: whether the tile ends at the left, right, upper and lower side.
pub(crate) fn unfitted(
    texels: &[FittedTexel],
    columns: usize,
    is_end: [bool; 4],
    unknown: Bounds,
) -> Vec<Bounds> {
    let rows = texels.len() / columns;
    let mut bounds = vec![unknown; texels.len()];
    for _ in 0..FIT_STEPS {
        let before = bounds.clone();
        for (texel, bounds) in bounds.iter_mut().enumerate() {
            let Some(stored) = texels[texel].stored else { continue };
            let (column, row) = (texel % columns, texel / columns);
            // None where there is no value, and the axis is left alone.
            let neighbour = |is_inside: bool, is_end: bool, at: usize| {
                if !is_inside {
                    (!is_end).then_some(unknown)
                } else {
                    texels[at].may_count.then(|| before[at])
                }
            };
            let [left_end, right_end, upper_end, lower_end] = is_end;
            let left = neighbour(column > 0, left_end, texel.wrapping_sub(1));
            let right = neighbour(column + 1 < columns, right_end, texel + 1);
            let upper = neighbour(row > 0, upper_end, texel.wrapping_sub(columns));
            let lower = neighbour(row + 1 < rows, lower_end, texel + columns);
            let across = left.zip(right).map(|(a, b)| [a.low + b.low, a.high + b.high]);
            let along = upper.zip(lower).map(|(a, b)| [a.low + b.low, a.high + b.high]);
            *bounds = stored;
            for [low, high] in [across, along].into_iter().flatten() {
                // 1 / (1 + 2k) and k / (1 + 2k).
                let mixed =
                    Bounds { low: stored.low * 0.8 + low * 0.1, high: stored.high * 0.8 + high * 0.1 };
                *bounds = bounds.union(mixed);
            }
            if let Some(([low, high], [more_low, more_high])) = across.zip(along) {
                // 1 / (1 + 4k) and k / (1 + 4k).
                *bounds = bounds.union(Bounds {
                    low: stored.low * (2.0 / 3.0) + (low + more_low) / 12.0,
                    high: stored.high * (2.0 / 3.0) + (high + more_high) / 12.0,
                });
            }
        }
    }
    bounds
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;

    use super::*;

    fn between(low: f32, high: f32) -> Bounds {
        Bounds { low: Vec4::splat(low), high: Vec4::splat(high) }
    }

    fn base_color(format: TexelFormat) -> Channel {
        Channel { kind: ChannelKind::BaseColor, format, srgb: format != TexelFormat::Rgba32F }
    }

    /// Whatever the weights are, the mean is not greater, and it can be as great.
    #[test]
    fn means_are_as_great_as_weights_allow() {
        let mut random = Random::new(5);
        for _ in 0..2000 {
            let mut parts: Vec<Weighted> = (0..1 + random.below(6))
                .map(|_| {
                    let least = if random.below(2) == 0 { 0.0 } else { random.unit() as f32 };
                    Weighted { value: random.unit() as f32, least, most: least + random.unit() as f32 }
                })
                .collect();
            parts[0].most += 0.1;
            let mean = |weights: &[f32]| {
                let sum: f32 = weights.iter().zip(&parts).map(|(weight, part)| weight * part.value).sum();
                sum / weights.iter().sum::<f32>()
            };
            let mut greatest = 0.0_f32;
            for choice in 0..1_u32 << parts.len() {
                let weights: Vec<f32> = (0..parts.len())
                    .map(|k| if choice >> k & 1 == 1 { parts[k].most } else { parts[k].least })
                    .collect();
                if weights.iter().sum::<f32>() > 0.0 {
                    greatest = greatest.max(mean(&weights));
                }
            }
            let found = greatest_mean(&mut parts.clone());
            assert!((found - greatest).abs() < 1e-5, "{found} {greatest} {parts:?}");
        }
        let open = Weighted { value: f32::INFINITY, least: 0.0, most: 1.0 };
        let known = Weighted { value: 0.5, least: 1.0, most: 1.0 };
        assert_eq!(greatest_mean(&mut [known, open]), f32::INFINITY);
        assert_eq!(greatest_mean(&mut [known, Weighted { value: f32::NEG_INFINITY, ..open }]), 0.5);
    }

    /// Means of colours count alpha; of cut-outs nobody knows how much.
    #[test]
    fn colours_count_by_their_alpha() {
        let part = |value: f32, alpha: f32| {
            let color = Vec3::splat(value).extend(alpha);
            Part { bounds: Bounds { low: color, high: color }, least: 0.5, most: 0.5 }
        };
        let parts = [part(0.2, 0.25), part(0.8, 0.75)];
        let channel = base_color(TexelFormat::Rgba8);
        let mean = StoredValues::new(&channel, false, false).mean(&parts);
        assert!((mean.low - Vec3::splat(0.65).extend(0.5)).abs().max_element() < 1e-4, "{mean:?}");
        assert!((mean.high - Vec3::splat(0.65).extend(0.5)).abs().max_element() < 1e-4, "{mean:?}");
        let cut_out = StoredValues::new(&channel, false, true);
        let mean = cut_out.mean(&parts);
        assert!((mean.low.x - 0.2).abs() < 1e-5 && (mean.high.x - 0.8).abs() < 1e-5, "{mean:?}");
        assert_eq!(cut_out.compared(), 3);
        let channel = Channel { kind: ChannelKind::OcclusionRoughnessMetallic, srgb: false, ..channel };
        let mean = StoredValues::new(&channel, false, false).mean(&parts);
        assert!((mean.low.x - 0.5).abs() < 1e-6 && (mean.high.x - 0.5).abs() < 1e-6, "{mean:?}");
        let optional = Part { least: 0.0, ..part(0.8, 1.0) };
        let mean = StoredValues::new(&channel, false, false).mean(&[part(0.2, 1.0), optional]);
        assert!((mean.low.x - 0.2).abs() < 1e-6 && (mean.high.x - 0.5).abs() < 1e-6, "{mean:?}");
    }

    /// What was fitted lies within the bounds, whatever it was, wherever values are missing, and however far it was fitted.
    #[test]
    fn fitted_values_are_within_their_bounds() {
        let mut random = Random::new(9);
        let [columns, rows] = [16_usize, 12];
        let unknown = between(0.0, 1.0);
        let mut widest = 0.0_f32;
        for round in 0..60 {
            let is_smooth = round % 3 == 0;
            let values: Vec<f32> = (0..columns * rows)
                .map(|i| match is_smooth {
                    true => 0.5 + 0.05 * ((i % columns) as f32 * 0.4).sin(),
                    false => random.unit() as f32,
                })
                .collect();
            let is_valid: Vec<bool> = values.iter().map(|_| is_smooth || random.below(9) > 0).collect();
            let k = [0.0, 1.0 / 12.0, 1.0 / 8.0][round % 2 + usize::from(round % 5 == 0)];
            let fit = |i: usize| {
                let (x, y) = (i % columns, i / columns);
                let at = |inside: bool, j: usize| (inside && is_valid[j]).then(|| values[j]);
                let across = at(x > 0, i.wrapping_sub(1)).zip(at(x + 1 < columns, i + 1));
                let along = at(y > 0, i.wrapping_sub(columns)).zip(at(y + 1 < rows, i + columns));
                let near = [at(x > 0, i.wrapping_sub(1)), at(x + 1 < columns, i + 1)]
                    .into_iter()
                    .chain([at(y > 0, i.wrapping_sub(columns)), at(y + 1 < rows, i + columns)])
                    .flatten()
                    .chain([values[i]]);
                let low = near.clone().fold(f32::INFINITY, f32::min);
                let high = near.fold(f32::NEG_INFINITY, f32::max);
                let pairs = [across, along].into_iter().flatten();
                let curvature: f32 = pairs.map(|(a, b)| a + b - 2.0 * values[i]).sum();
                (values[i] - k * curvature).clamp(low - (low * 0.25).min(1.0 / 32.0), high + 1.0 / 32.0)
            };
            let texels: Vec<FittedTexel> = (0..values.len())
                .map(|i| {
                    let stored = (is_valid[i] && random.below(12) > 0).then(|| {
                        let value = fit(i).clamp(0.0, 1.0);
                        between(value, value)
                    });
                    FittedTexel { stored, may_count: is_valid[i] || random.below(4) == 0 }
                })
                .collect();
            let bounds = unfitted(&texels, columns, [true; 4], unknown);
            for (i, bounds) in bounds.iter().enumerate().filter(|(i, _)| is_valid[*i]) {
                let is_within = bounds.low.x <= values[i] + 1e-5 && bounds.high.x >= values[i] - 1e-5;
                assert!(is_within, "round {round}, texel {i}: {} {bounds:?}", values[i]);
                if is_smooth && texels[i].stored.is_some() {
                    widest = widest.max((bounds.high - bounds.low).x);
                }
            }
        }
        assert!(widest < 0.5, "{widest}");
        // Of what is even and known all around, next to nothing is left open.
        let even = FittedTexel { stored: Some(between(0.5, 0.5)), may_count: true };
        let bounds = unfitted(&[even; 32 * 32], 32, [true; 4], unknown);
        assert!(bounds.iter().all(|bounds| (bounds.high - bounds.low).max_element() < 2e-3));
    }

    /// The bounds of a stored texel hold what was rounded, also where it was clamped.
    #[test]
    fn stored_texels_are_rounded_and_clamped() {
        use fantex_base::srgb::{linear_from_srgb, srgb_from_linear};
        let values = StoredValues::new(&base_color(TexelFormat::Rgba8), true, false);
        for step in 0..=4000 {
            let value = step as f32 / 2000.0;
            let stored = linear_from_srgb((srgb_from_linear(value.min(1.0)) * 255.0).round() / 255.0);
            let bounds = values.of_texel(Vec3::splat(stored).extend(1.0));
            assert!(bounds.low.x <= value && value <= bounds.high.x, "{value} {stored} {bounds:?}");
            assert!(value > 0.99 || bounds.high.x - bounds.low.x < 0.015, "{value} {bounds:?}");
        }
        let transparent = StoredValues::new(&base_color(TexelFormat::Bc1), false, false).of_texel(Vec4::ZERO);
        assert_eq!((transparent.low, transparent.high), (Vec4::ZERO, Vec3::ONE.extend(0.5)));
    }
}
