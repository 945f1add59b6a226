//! Coverage to texels: a page as it is after the stroke.

use fantex_cover::NOBODY;
use fantex_store::{Asset, PageId};
use glam::Vec4;

use super::encode::replace_blocks;
use super::ink::Ink;
use super::stroke_page::StrokePage;
use super::texel_page::TexelPage;
use crate::PaintError;

/// The bytes of a page in all painted channels: `shown` with the blocks of stale texels replaced, from those before the
/// stroke.
pub(crate) fn composite(
    asset: &Asset,
    map: &TexelPage,
    id: PageId,
    page: &StrokePage,
    shown: Vec<Vec<u8>>,
    ink: &Ink<'_>,
) -> Result<Vec<Vec<u8>>, PaintError> {
    let extent = map.block.extent;
    let mut changed = Vec::with_capacity(ink.paint.channels.len());
    let rect = page.stale.blocks();
    let originals = match page.decoded.get() {
        Some(decoded) => decoded,
        None => {
            let decoded = decode(asset, id, page, ink)?;
            page.decoded.get_or_init(|| decoded)
        }
    };
    let channels = ink.paint.channels.iter().enumerate();
    for (((number, painted), original), mut bytes) in channels.zip(originals).zip(shown) {
        let mut values = original.clone();
        for (x, y) in rect.texels() {
            let texel = (y * extent[0] + x) as usize;
            let coverage = page.covered(texel);
            if coverage > 0.0
                && map.owner[texel] != NOBODY
                && let Some(color) = ink.color(map, page, [x, y], number)
            {
                values[texel] = ink.paint.apply(values[texel], color, coverage);
            }
        }
        let channel = &asset.channels()[painted.channel];
        replace_blocks(channel, extent, &mut bytes, &values, rect, |t| page.covered(t) > 0.0)?;
        changed.push(bytes);
    }
    Ok(changed)
}

/// The texels before the stroke, per painted channel.
fn decode(asset: &Asset, id: PageId, page: &StrokePage, ink: &Ink<'_>) -> Result<Vec<Vec<Vec4>>, PaintError> {
    let channels = ink.paint.channels.iter().zip(&page.originals);
    let decoded = channels.map(|(painted, original)| {
        let texels = asset.decode_page_raw(painted.channel, id, original)?;
        Ok(texels.rgba.into_iter().map(Vec4::from).collect())
    });
    decoded.collect()
}
