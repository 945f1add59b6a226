//! Texels that are right when they are read bilinearly.
//!
//! Values at texel centres, interpolated, are a blurred copy of the function. As in the bake, each texel is moved against its
//! second differences, `c - k (a - 2 c + b)` along both axes with `k = 1/12`: the second-order form of the inverse of the linear
//! spline's autocorrelation (M. Unser, "Splines: A Perfect Fit for Signal and Image Processing", 1999).

use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

use super::Values;
use super::region::{BORDER, Region};
use crate::maps::Map;

const SHARE: f32 = 1.0 / 12.0;

/// How far a fitted texel may lie beyond its neighbours.
const OVERSHOOT: f32 = 1.0 / 32.0;

/// And how far below the least of them, as a share of it, so that shadows do not become black.
const UNDERSHOOT: f32 = 0.25;

/// The values of the inner part of a region, fitted where the texels around lie on the surface, too.
pub(super) fn fitted(values: &[[f32; 4]], region: &Region, map: &Map) -> Values {
    let border = BORDER as usize;
    let stride = region.extent[0] as usize + 2 * border;
    let is_normal = map.kind.channel() == ChannelKind::Normal;
    let mut inner = Vec::with_capacity(region.extent[0] as usize * region.extent[1] as usize);
    for y in border..border + region.extent[1] as usize {
        for x in border..border + region.extent[0] as usize {
            let value = fitted_texel(values, &region.chart_on_surface, y * stride + x, stride);
            inner.push(if is_normal { unit(value) } else { value }.to_array());
        }
    }
    inner
}

fn fitted_texel(values: &[[f32; 4]], charts: &[u32], texel: usize, stride: usize) -> Vec4 {
    let at = |i: usize| Vec4::from_array(values[i]);
    let centre = at(texel);
    let chart = charts[texel];
    let (mut bend, mut low, mut high) = (Vec4::ZERO, centre, centre);
    for step in [1, stride] {
        let around = [texel - step, texel + step];
        if chart != crate::layout::NOBODY && around.iter().all(|&i| charts[i] == chart) {
            let [a, b] = around.map(at);
            bend += a + b - 2.0 * centre;
            low = low.min(a).min(b);
            high = high.max(a).max(b);
        }
    }
    let least = (low - OVERSHOOT).max(low * (1.0 - UNDERSHOOT));
    // Values below zero are none of any map; where they are, they stay.
    (centre - SHARE * bend).clamp(least.min(low), high + OVERSHOOT)
}

/// A texel of a normal map with its normal at unit length.
fn unit(texel: Vec4) -> Vec4 {
    let normal = (texel.truncate() * 2.0 - 1.0).normalize_or(Vec3::Z);
    (normal * 0.5 + 0.5).extend(1.0)
}
