//! From values to a page's bytes: only the blocks that changed are encoded, all others keep their bytes, so that painting
//! here never blurs there.

use fantex_store::{Channel, EncodeError, Quality, TexelFormat, TexelSlice, encode};
use fantex_texture::color::{srgb_from_linear, srgb8_from_linear, unorm8};
use glam::Vec4;

use super::rect::Rect;

/// Replaces the blocks of a page that hold a changed texel. `values`: linear RGBA of the whole page, row-major; `changed`:
/// texels that differ, all of them within `rect`.
pub(crate) fn replace_blocks(
    channel: &Channel,
    extent: [u32; 2],
    bytes: &mut [u8],
    values: &[Vec4],
    rect: Rect,
    changed: impl Fn(usize) -> bool,
) -> Result<(), EncodeError> {
    let rect = rect.blocks();
    let texels = rect.texels().map(|(x, y)| values[(y * extent[0] + x) as usize]);
    let encoded = if channel.format == TexelFormat::Rgba32F {
        let texels: Vec<[f32; 4]> = texels.map(|v| stored_float(channel, v)).collect();
        encode(channel.format, Quality::UltraFast, rect.extent(), TexelSlice::F32(&texels))?
    } else {
        let texels: Vec<[u8; 4]> = texels.map(|v| stored_bytes(channel, v)).collect();
        encode(channel.format, Quality::UltraFast, rect.extent(), TexelSlice::U8(&texels))?
    };
    let is_block =
        matches!(channel.format, TexelFormat::Bc1 | TexelFormat::Bc4 | TexelFormat::Bc5 | TexelFormat::Bc7);
    let width = extent[0] as usize;
    let blocks = (rect.low[1]..rect.high[1])
        .step_by(4)
        .flat_map(|y| (rect.low[0]..rect.high[0]).step_by(4).map(move |x| (x as usize, y as usize)));
    for (x, y) in blocks {
        if !(0..16).any(|k| changed((y + k / 4) * width + x + k % 4)) {
            continue;
        }
        let (u, v) = (x - rect.low[0] as usize, y - rect.low[1] as usize);
        let columns = rect.extent()[0] as usize;
        if is_block {
            let size = channel.format.block_bytes();
            let to = (y / 4 * (width / 4) + x / 4) * size;
            let from = (v / 4 * (columns / 4) + u / 4) * size;
            bytes[to..to + size].copy_from_slice(&encoded[from..from + size]);
        } else {
            let size = channel.format.block_bytes() / 16;
            for row in 0..4 {
                let to = ((y + row) * width + x) * size;
                let from = ((v + row) * columns + u) * size;
                bytes[to..to + 4 * size].copy_from_slice(&encoded[from..from + 4 * size]);
            }
        }
    }
    Ok(())
}

fn stored_float(channel: &Channel, value: Vec4) -> [f32; 4] {
    let [r, g, b, a] = value.to_array();
    if channel.srgb {
        [srgb_from_linear(r), srgb_from_linear(g), srgb_from_linear(b), a]
    } else {
        [r, g, b, a]
    }
}

fn stored_bytes(channel: &Channel, value: Vec4) -> [u8; 4] {
    let [r, g, b, a] = value.to_array();
    let color = if channel.srgb { [r, g, b].map(srgb8_from_linear) } else { [r, g, b].map(unorm8) };
    [color[0], color[1], color[2], stored_alpha(channel.format, a)]
}

/// Opaque blocks of BC7 may decode to 254/255; taken as it is, that would cost opaque pages the better profile, and a
/// little of their opacity with every stroke.
fn stored_alpha(format: TexelFormat, alpha: f32) -> u8 {
    match unorm8(alpha) {
        254 if format == TexelFormat::Bc7 => 255,
        alpha => alpha,
    }
}
