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
    let width = extent[0] as usize;
    for [x, y] in blocks_of(rect) {
        if (0..16).any(|k| changed((y + k / 4) * width + x + k % 4)) {
            let from = BlockAt { bytes: &encoded, columns: rect.extent()[0] as usize };
            let low = rect.low.map(|n| n as usize);
            copy_block(channel.format, &from, [x - low[0], y - low[1]], bytes, width, [x, y]);
        }
    }
    Ok(())
}

/// Copies the blocks of a rectangle from one page to another of the same extent.
pub(crate) fn copy_blocks(channel: &Channel, extent: [u32; 2], from: &[u8], to: &mut [u8], rect: Rect) {
    let width = extent[0] as usize;
    let from = BlockAt { bytes: from, columns: width };
    for place in blocks_of(rect.blocks()) {
        copy_block(channel.format, &from, place, to, width, place);
    }
}

/// First texels of the blocks of a rectangle of whole blocks.
fn blocks_of(rect: Rect) -> impl Iterator<Item = [usize; 2]> {
    let columns = move || (rect.low[0]..rect.high[0]).step_by(4);
    let rows = (rect.low[1]..rect.high[1]).step_by(4);
    rows.flat_map(move |y| columns().map(move |x| [x as usize, y as usize]))
}

/// Texels to copy from, so many in a row.
struct BlockAt<'a> {
    bytes: &'a [u8],
    columns: usize,
}

/// Copies one block of 4 x 4 texels.
fn copy_block(
    format: TexelFormat,
    from: &BlockAt<'_>,
    [u, v]: [usize; 2],
    to: &mut [u8],
    width: usize,
    [x, y]: [usize; 2],
) {
    if matches!(format, TexelFormat::Bc1 | TexelFormat::Bc4 | TexelFormat::Bc5 | TexelFormat::Bc7) {
        let size = format.block_bytes();
        let target = (y / 4 * (width / 4) + x / 4) * size;
        let source = (v / 4 * (from.columns / 4) + u / 4) * size;
        to[target..target + size].copy_from_slice(&from.bytes[source..source + size]);
    } else {
        let size = format.block_bytes() / 16;
        for row in 0..4 {
            let target = ((y + row) * width + x) * size;
            let source = ((v + row) * from.columns + u) * size;
            to[target..target + 4 * size].copy_from_slice(&from.bytes[source..source + 4 * size]);
        }
    }
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
