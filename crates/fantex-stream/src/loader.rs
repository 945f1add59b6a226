//! The interface between residency, which decides what is loaded, and loaders, which read; and how pages become a parcel's texels.

use std::borrow::Cow;
use std::sync::Arc;

use fantex_base::Error;
use fantex_store::{Asset, PageId, decode_plain};

use crate::drawing::UploadRows;
use crate::{AtlasFormat, Outline, Parcel, ParcelLayout};

/// Texels of a parcel in the formats of the atlas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParcelTexels {
    /// Columns and rows, multiples of 4.
    pub extent: [u32; 2],
    /// What of it is stored.
    pub outline: Outline,
    /// Per channel of the asset: rows of blocks, or of texels, from v = 0, without padding. What lies between the pages of a
    /// bundle, and beside the outline, is anything.
    pub channels: Vec<Arc<[u8]>>,
}

impl ParcelTexels {
    /// Bytes of all channels.
    pub fn bytes(&self) -> usize {
        self.channels.iter().map(|channel| channel.len()).sum()
    }
}

/// A parcel that has arrived, or never will.
#[derive(Clone, Debug)]
pub struct LoadedParcel {
    /// Which.
    pub parcel: Parcel,
    /// Its texels, or what was wrong. A bundle of which one page cannot be read is an error.
    pub texels: Result<ParcelTexels, Error>,
}

/// Brings parcels from wherever they are, many at a time, in the background. Pages of one cluster are read together.
pub trait ParcelLoader: Send {
    /// Asks for a parcel. The greater `urgency` (any finite number), the earlier it comes. Asking for one that has been asked
    /// for and has not arrived changes its urgency.
    fn request(&mut self, parcel: Parcel, urgency: f32);

    /// [`ParcelLoader::request`] of several parcels, in order.
    fn request_all(&mut self, parcels: &[(Parcel, f32)]) {
        for &(parcel, urgency) in parcels {
            self.request(parcel, urgency);
        }
    }

    /// The parcel is no longer wanted: it does not arrive any more unless it is asked for again. No effect on one that has
    /// not been asked for.
    fn cancel(&mut self, parcel: Parcel);

    /// [`ParcelLoader::cancel`] of several parcels, in order.
    fn cancel_all(&mut self, parcels: &[Parcel]) {
        for &parcel in parcels {
            self.cancel(parcel);
        }
    }

    /// Parcels that have arrived or failed since the last call, the most urgent first, at least one if there is any, no more
    /// than make up `max_bytes`. Does not wait, and may bring nothing now and then although there is something.
    fn poll(&mut self, max_bytes: usize) -> Vec<LoadedParcel>;

    /// Parcels that were asked for and have neither arrived (in [`ParcelLoader::poll`]) nor been cancelled.
    fn pending(&self) -> usize;

    /// Whether parcels come over a network, which may be gone for a while: then those that failed for a reason that may pass are asked for again.
    fn is_remote(&self) -> bool {
        false
    }
}

// From the texels of pages to those of the parcel that they lie in.

/// Puts pages together, the outline being whole. `page` gives a page's bytes in a channel, in the channel's format among `formats`: rows of blocks, or of
/// texels.
///
/// # Errors
/// Those of `page`.
pub fn assemble<'p, E>(
    layout: &ParcelLayout,
    formats: &[AtlasFormat],
    mut page: impl FnMut(usize, PageId) -> Result<Cow<'p, [u8]>, E>,
) -> Result<ParcelTexels, E> {
    let mut channels: Vec<Arc<[u8]>> = Vec::with_capacity(formats.len());
    for (channel, &format) in formats.iter().enumerate() {
        if let [slot] = layout.slots[..] {
            channels.push(Arc::from(page(channel, slot.page)?));
            continue;
        }
        let rows = UploadRows::of(format, layout.extent);
        let mut texels = vec![0; rows.bytes * rows.count];
        for slot in &layout.slots {
            let bytes = page(channel, slot.page)?;
            let [own, before] = [slot.extent, slot.at].map(|n| UploadRows::of(format, n));
            for (row, source) in bytes.chunks_exact(own.bytes.max(1)).enumerate() {
                let start = (before.count + row) * rows.bytes + before.bytes;
                texels[start..start + own.bytes].copy_from_slice(source);
            }
        }
        channels.push(Arc::from(texels));
    }
    Ok(ParcelTexels { extent: layout.extent, outline: Outline::WHOLE, channels })
}

/// A parcel's texels in these formats of the atlas, from the bytes of its pages as they are stored.
///
/// # Errors
/// Those of `stored_page`.
pub(crate) fn stored_texels<'p>(
    asset: &Asset,
    formats: &[AtlasFormat],
    parcel: Parcel,
    stored_page: impl Fn(usize, PageId) -> Result<&'p [u8], Error>,
) -> Result<ParcelTexels, Error> {
    let layout = parcel.layout(asset.cover());
    let outline = Outline::of_stored(&layout, asset.channels(), &stored_page)?;
    let texels = assemble(&layout, formats, |index, page| {
        let (channel, format) = (&asset.channels()[index], formats[index]);
        let stored = stored_page(index, page)?;
        if format == AtlasFormat::of(channel.format, true) && format != AtlasFormat::Rgba16F {
            return Ok(Cow::Borrowed(stored));
        }
        let extent = asset.page_extent(index, page)?;
        let plain = decode_plain(channel.format, channel.srgb, extent, stored);
        // The page's bytes are as many as its extent asks for, so this error does not happen.
        let no_such_page = |_| asset.no_such_page(index, page);
        Ok(Cow::Owned(plain.map_err(no_such_page)?))
    })?;
    Ok(ParcelTexels { outline, ..texels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Slot;
    use crate::parcel::slots;

    #[test]
    fn pages_lie_where_the_layout_says() {
        let extents = [[4, 4], [8, 4], [8, 8], [4, 12], [12, 4]];
        let layout = ParcelLayout::new(slots(0, 1, 5, |group| Some((1, extents[group as usize]))));
        assert_eq!(layout.slots.len(), 5);
        for format in [AtlasFormat::R8, AtlasFormat::Rgba16F, AtlasFormat::Bc1, AtlasFormat::Bc7] {
            let blocks = |slot: &Slot| (slot.extent[0] * slot.extent[1] / 16) as usize;
            // Every byte tells its page and its place in it.
            let value = |group: u32, i: usize| (50 * group as usize + i % 49) as u8;
            let assembled = assemble(&layout, &[format], |_, page| {
                let slot = layout.slots.iter().find(|slot| slot.page == page).unwrap();
                let bytes = blocks(slot) * format.block_bytes();
                Ok::<_, ()>(Cow::Owned((0..bytes).map(|i| value(page.group, i)).collect()))
            });
            let texels = assembled.unwrap();
            // The cell is what copies move: a block, or a texel.
            let (cell, cell_bytes) = if format.is_compressed() {
                (4, format.block_bytes())
            } else {
                (1, format.block_bytes() / 16)
            };
            let columns = (layout.extent[0] / cell) as usize;
            let mut used = 0;
            for slot in &layout.slots {
                let [width, height] = slot.extent.map(|n| (n / cell) as usize);
                let [x, y] = slot.at.map(|n| (n / cell) as usize);
                for (row, column, byte) in (0..height)
                    .flat_map(|r| (0..width).flat_map(move |c| (0..cell_bytes).map(move |b| (r, c, b))))
                {
                    let found = texels.channels[0][((y + row) * columns + x + column) * cell_bytes + byte];
                    let expected = value(slot.page.group, (row * width + column) * cell_bytes + byte);
                    assert_eq!(found, expected, "{format:?} {slot:?}");
                    used += 1;
                }
            }
            assert_eq!(used, layout.slots.iter().map(blocks).sum::<usize>() * format.block_bytes());
            assert_eq!(
                texels.channels[0].len(),
                (layout.extent[0] * layout.extent[1] / 16) as usize * format.block_bytes()
            );
        }
    }
}
