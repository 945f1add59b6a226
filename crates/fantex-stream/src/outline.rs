//! Outlines: tiles are rectangles, the regions in them are not, and blocks that nothing reads take no room in the atlas.

use std::ops::Range;

use fantex_store::{Channel, PageId, TexelFormat};

use crate::ParcelLayout;

/// Which blocks of 4x4 texels of a parcel's rectangle are stored: in each band of four rows those from a first one to an end.
/// Look-ups read no others, so what lies beside an outline may be another parcel's.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outline(Option<Box<[[u8; 2]]>>);

/// Bands that have the same span of blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutlineRun {
    /// Bands of four rows of texels.
    pub bands: Range<u32>,
    /// Blocks of each, at least one.
    pub blocks: Range<u32>,
}

impl Outline {
    /// All blocks of a rectangle.
    pub const WHOLE: Self = Self(None);

    /// Of a rectangle of texels (sides multiples of 4, at most 1020), from first block and end of each band; both are equal where the
    /// band is empty.
    pub fn new(extent: [u32; 2], spans: Vec<[u8; 2]>) -> Self {
        debug_assert_eq!(spans.len() as u32, extent[1] / 4);
        debug_assert!(spans.iter().all(|&[first, end]| first <= end && u32::from(end) <= extent[0] / 4));
        let is_whole = spans.iter().all(|span| span.map(u32::from) == [0, extent[0] / 4]);
        Self((!is_whole).then(|| spans.into()))
    }

    /// Of the stored bytes of a parcel's pages, before any decoding; `page` gives them per channel. Blocks of zero bytes in all channels are
    /// not stored; that tells only where a channel is BC7, which has no such block: rectangles without are whole.
    ///
    /// # Errors
    /// Those of `page`.
    pub fn of_stored<B: AsRef<[u8]>, E>(
        layout: &ParcelLayout,
        channels: &[Channel],
        mut page: impl FnMut(usize, PageId) -> Result<B, E>,
    ) -> Result<Self, E> {
        if !channels.iter().any(|channel| channel.format == TexelFormat::Bc7) {
            return Ok(Self::WHOLE);
        }
        let mut spans = vec![[u8::MAX, 0]; layout.extent[1] as usize / 4];
        for slot in &layout.slots {
            let [columns, bands] = slot.extent.map(|n| n as usize / 4);
            let [right, down] = slot.at.map(|n| n as usize / 4);
            for (index, channel) in channels.iter().enumerate() {
                let bytes = page(index, slot.page)?;
                let bytes = bytes.as_ref();
                let band_bytes = (bytes.len() / bands.max(1)).max(1);
                // Of formats without blocks a band is four rows.
                let rows = if channel.format.is_compressed() { 1 } else { 4 };
                for (span, band) in spans[down..].iter_mut().zip(bytes.chunks_exact(band_bytes)) {
                    for row in band.chunks_exact((band_bytes / rows).max(1)) {
                        let column_bytes = (row.len() / columns.max(1)).max(1);
                        let (Some(first), Some(last)) =
                            (row.iter().position(|&byte| byte != 0), row.iter().rposition(|&byte| byte != 0))
                        else {
                            continue;
                        };
                        span[0] = span[0].min((right + first / column_bytes) as u8);
                        span[1] = span[1].max((right + last / column_bytes + 1) as u8);
                    }
                }
            }
        }
        spans.iter_mut().filter(|span| span[1] == 0).for_each(|span| *span = [0, 0]);
        Ok(Self::new(layout.extent, spans))
    }

    /// Whether all blocks are stored.
    pub fn is_whole(&self) -> bool {
        self.0.is_none()
    }

    /// First block and end of each band of a rectangle of texels, which is that of the outline.
    pub fn spans(&self, extent: [u32; 2]) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..extent[1] as usize / 4).map(move |band| match &self.0 {
            Some(spans) => spans.get(band).map_or([0, 0], |span| span.map(u32::from)),
            None => [0, extent[0] / 4],
        })
    }

    /// Texels of the stored blocks.
    pub fn texels(&self, extent: [u32; 2]) -> u64 {
        match self.0 {
            Some(_) => self.spans(extent).map(|[first, end]| 16 * u64::from(end - first)).sum(),
            None => u64::from(extent[0]) * u64::from(extent[1]),
        }
    }

    /// The rectangles of blocks that it consists of.
    pub fn runs(&self, extent: [u32; 2]) -> Vec<OutlineRun> {
        let mut runs: Vec<OutlineRun> = Vec::new();
        for (band, [first, end]) in (0..).zip(self.spans(extent)).filter(|(_, [first, end])| first < end) {
            match runs.last_mut().filter(|run| run.bands.end == band && run.blocks == (first..end)) {
                Some(run) => run.bands.end += 1,
                None => runs.push(OutlineRun { bands: band..band + 1, blocks: first..end }),
            }
        }
        runs
    }

    /// What lies in a part of the rectangle: a page's outline in its parcel.
    pub fn part(&self, extent: [u32; 2], at: [u32; 2], part: [u32; 2]) -> Self {
        let [left, columns] = [at[0] / 4, part[0] / 4];
        let spans = self.spans(extent).skip(at[1] as usize / 4).take(part[1] as usize / 4).map(|span| {
            let [first, end] = span.map(|n| n.clamp(left, left + columns) - left);
            [first as u8, end as u8]
        });
        Self::new(part, spans.collect())
    }
}

#[cfg(test)]
mod tests {
    use fantex_store::ChannelKind;

    use super::*;
    use crate::Slot;

    fn channel(format: TexelFormat) -> Channel {
        Channel { kind: ChannelKind::BaseColor, format, srgb: false }
    }

    #[test]
    fn bands_span_what_any_channel_stores() {
        let page = |group, at, extent| Slot { page: PageId { group, level: 0, page: [0, 0] }, at, extent };
        let layout =
            ParcelLayout { extent: [20, 8], slots: vec![page(0, [0, 0], [12, 8]), page(1, [12, 0], [8, 4])] };
        let set = |length: usize, places: &[usize]| {
            let mut bytes = vec![0; length];
            places.iter().for_each(|&place| bytes[place] = 1);
            bytes
        };
        // Per channel and page: blocks of the first page are 0, 1, 2 and 3, 4, 5. Bytes of texels (5, 0) and (11, 7).
        let stored = [[set(96, &[16 + 15]), set(32, &[])], [set(96, &[5, 7 * 12 + 11]), set(32, &[])]];
        let outline = |formats: [TexelFormat; 2]| {
            let bytes =
                |index: usize, page: PageId| Ok::<_, ()>(stored[index][page.group as usize].as_slice());
            Outline::of_stored(&layout, &formats.map(channel), bytes).unwrap()
        };
        let found = outline([TexelFormat::Bc7, TexelFormat::R8]);
        assert_eq!(found.spans(layout.extent).collect::<Vec<_>>(), [[1, 2], [2, 3]]);
        assert_eq!(found.texels(layout.extent), 32);
        let run = |band, block| OutlineRun { bands: band..band + 1, blocks: block..block + 1 };
        assert_eq!(found.runs(layout.extent), [run(0, 1), run(1, 2)]);
        assert_eq!(found.part(layout.extent, [4, 4], [8, 4]), Outline::new([8, 4], vec![[1, 2]]));
        assert_eq!(found.part(layout.extent, [4, 0], [4, 4]), Outline::WHOLE);
        assert_eq!(outline([TexelFormat::Bc5, TexelFormat::R8]), Outline::WHOLE, "zeros may be read");
        assert_eq!(Outline::WHOLE.runs([12, 8]), [OutlineRun { bands: 0..2, blocks: 0..3 }]);
    }
}
