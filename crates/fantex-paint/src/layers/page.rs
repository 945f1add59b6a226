//! Pages of layers as bytes: half floats, so that neither darkness nor light beyond 1 is lost.

use glam::Vec4;
use half::f16;

/// Bytes of a texel's RGBA.
const TEXEL_BYTES: usize = 8;

/// Values of all channels: `values[channel][texel]`, straight linear RGBA. Channel after channel.
pub(crate) fn encode_values(values: &[Vec<Vec4>]) -> Vec<u8> {
    let halves = values.iter().flatten().flat_map(|v| v.to_array()).map(half_of);
    halves.flat_map(f16::to_le_bytes).collect()
}

/// Inverse of [`encode_values`]; a page of another length is empty: transparent.
pub(crate) fn decode_values(bytes: &[u8], channels: usize, texels: usize) -> Vec<Vec<Vec4>> {
    if bytes.len() != channels * texels * TEXEL_BYTES {
        return vec![vec![Vec4::ZERO; texels]; channels];
    }
    let texel = |b: &[u8]| Vec4::from_array(std::array::from_fn(|k| float_of([b[2 * k], b[2 * k + 1]])));
    bytes
        .chunks_exact(texels * TEXEL_BYTES)
        .map(|c| c.chunks_exact(TEXEL_BYTES).map(texel).collect())
        .collect()
}

/// One number per texel.
pub(crate) fn encode_mask(mask: &[f32]) -> Vec<u8> {
    mask.iter().flat_map(|&x| half_of(x).to_le_bytes()).collect()
}

/// Inverse of [`encode_mask`]; a page of another length is `outside` everywhere.
pub(crate) fn decode_mask(bytes: &[u8], texels: usize, outside: f32) -> Vec<f32> {
    if bytes.len() != 2 * texels {
        return vec![outside; texels];
    }
    bytes.chunks_exact(2).map(|b| float_of([b[0], b[1]])).collect()
}

fn half_of(x: f32) -> f16 {
    let limit = f32::from(f16::MAX);
    f16::from_f32(if x.is_nan() { 0.0 } else { x.clamp(-limit, limit) })
}

fn float_of(bytes: [u8; 2]) -> f32 {
    let x = f16::from_le_bytes(bytes).to_f32();
    if x.is_finite() { x } else { 0.0 }
}
