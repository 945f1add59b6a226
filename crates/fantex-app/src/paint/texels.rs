//! Stored bytes of pages to what the atlas takes.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_paint::Painter;
use fantex_store::{PageError, PageId, decode_plain, page_extent};
use fantex_stream::{AtlasFormat, Parcel, ParcelTexels, assemble};

/// The parcel as the painter has it.
pub(super) fn parcel_texels(
    painter: &Painter,
    parcel: Parcel,
    formats: &[AtlasFormat],
) -> Result<ParcelTexels, PageError> {
    let layout = parcel.layout(painter.editor().asset().cover());
    assemble(&layout, formats, |channel, page| {
        channel_texels(painter, page, channel, formats[channel], None).map(Cow::Owned)
    })
}

/// The page as the painter has it; `shown` has the bytes of channels that look different for the moment.
pub(super) fn page_texels(
    painter: &Painter,
    page: PageId,
    formats: &[AtlasFormat],
    shown: &BTreeMap<usize, Vec<u8>>,
) -> Result<ParcelTexels, PageError> {
    let extent = extent(painter, page)?;
    let channels = formats.iter().enumerate().map(|(channel, &format)| {
        Ok(Arc::from(channel_texels(painter, page, channel, format, shown.get(&channel))?))
    });
    Ok(ParcelTexels { extent, channels: channels.collect::<Result<_, PageError>>()? })
}

fn extent(painter: &Painter, page: PageId) -> Result<[u32; 2], PageError> {
    let asset = painter.editor().asset();
    let group =
        asset.cover().groups.get(page.group as usize).ok_or_else(|| no_such_page(painter, 0, page))?;
    Ok(page_extent(group.level_extent(page.level), page.page))
}

/// A page in one channel; `shown`: its stored bytes where it looks different for the moment.
fn channel_texels(
    painter: &Painter,
    page: PageId,
    index: usize,
    format: AtlasFormat,
    shown: Option<&Vec<u8>>,
) -> Result<Vec<u8>, PageError> {
    let editor = painter.editor();
    let channel = &editor.asset().channels()[index];
    let stored = match shown {
        Some(bytes) => bytes.clone(),
        None => editor.read_page_raw(index, page)?,
    };
    if format == AtlasFormat::of(channel.format, true) && format != AtlasFormat::Rgba16F {
        return Ok(stored);
    }
    let plain = decode_plain(channel.format, channel.srgb, extent(painter, page)?, &stored);
    plain.map_err(|_| no_such_page(painter, index, page))
}

fn no_such_page(painter: &Painter, channel: usize, page: PageId) -> PageError {
    PageError::NoSuchPage { path: painter.editor().asset().path().to_owned(), channel, page }
}
