//! Stored bytes of a page to what the atlas takes.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_paint::Painter;
use fantex_store::{PageError, PageId, decode_plain, page_extent};
use fantex_stream::{AtlasFormat, PageTexels};

/// The page as the painter has it; `shown` has the bytes of channels that look different for the moment.
pub(super) fn page_texels(
    painter: &Painter,
    page: PageId,
    formats: &[AtlasFormat],
    shown: &BTreeMap<usize, Vec<u8>>,
) -> Result<PageTexels, PageError> {
    let editor = painter.editor();
    let asset = editor.asset();
    let no_such_page = |channel| PageError::NoSuchPage { path: asset.path().to_owned(), channel, page };
    let group = asset.cover().groups.get(page.group as usize).ok_or_else(|| no_such_page(0))?;
    let extent = page_extent(group.level_extent(page.level), page.page);
    let channels = asset.channels().iter().zip(formats).enumerate();
    let channels = channels.map(|(index, (channel, &format))| {
        let stored = match shown.get(&index) {
            Some(bytes) => bytes.clone(),
            None => editor.read_page_raw(index, page)?,
        };
        if format == AtlasFormat::of(channel.format, true) && format != AtlasFormat::Rgba16F {
            return Ok(Arc::from(stored));
        }
        let plain = decode_plain(channel.format, channel.srgb, extent, &stored);
        Ok(Arc::from(plain.map_err(|_| no_such_page(index))?))
    });
    Ok(PageTexels { extent, channels: channels.collect::<Result<_, PageError>>()? })
}
