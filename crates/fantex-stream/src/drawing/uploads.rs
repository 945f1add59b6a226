//! Parcels on their way into the atlas: which rectangles are copied, and the rows of texels or blocks that they consist of.

use crate::{AtlasFormat, OutlineRun, ParcelTexels};

/// A rectangle of a parcel's texels in one channel.
#[derive(Clone, Copy, Debug)]
pub struct UploadRectangle<'t> {
    /// First texel, from the parcel's own, multiples of 4.
    pub offset: [u32; 2],
    /// Columns and rows in texels, multiples of 4.
    pub size: [u32; 2],
    texels: &'t [u8],
    /// Of the whole parcel.
    all: UploadRows,
    before: UploadRows,
    own: UploadRows,
}

impl<'t> UploadRectangle<'t> {
    /// The rows: of blocks where the format is compressed, else of texels.
    pub fn rows(&self) -> impl Iterator<Item = &'t [u8]> + use<'t> {
        let (first, length) = (self.before.bytes, self.own.bytes);
        let rows =
            self.texels.chunks_exact(self.all.bytes.max(1)).skip(self.before.count).take(self.own.count);
        rows.map(move |row| &row[first..first + length])
    }

    /// Number and length of the rows.
    pub fn layout(&self) -> UploadRows {
        self.own
    }
}

/// The stored rectangles of a parcel in a channel: one for a parcel whose outline is whole. `format` is that channel's.
pub fn upload_rectangles(
    texels: &ParcelTexels,
    channel: usize,
    format: AtlasFormat,
) -> impl Iterator<Item = UploadRectangle<'_>> {
    let extent = texels.extent;
    let all = UploadRows::of(format, extent);
    let bytes = &*texels.channels[channel];
    debug_assert_eq!(bytes.len(), all.bytes * all.count);
    texels.outline.runs(extent).into_iter().map(move |OutlineRun { bands, blocks }| {
        let offset = [&blocks, &bands].map(|run| 4 * run.start);
        let size = [&blocks, &bands].map(|run| 4 * run.len() as u32);
        let [before, own] = [offset, size].map(|texels| UploadRows::of(format, texels));
        UploadRectangle { offset, size, texels: bytes, all, before, own }
    })
}

/// Rows of a rectangle: of blocks, or of texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UploadRows {
    /// Rows.
    pub count: usize,
    /// Bytes of each.
    pub bytes: usize,
}

impl UploadRows {
    /// Those of a rectangle of so many columns and rows of texels.
    pub fn of(format: AtlasFormat, [columns, rows]: [u32; 2]) -> Self {
        let (columns, rows) = (columns as usize, rows as usize);
        if format.is_compressed() {
            Self { count: rows / 4, bytes: columns / 4 * format.block_bytes() }
        } else {
            Self { count: rows, bytes: columns * format.block_bytes() / 16 }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::Outline;

    #[test]
    fn rectangles_hold_the_stored_blocks() {
        // Two bands of three blocks, of which (1, 0), (1, 1) and (2, 1) are stored; every byte names its block or texel.
        let blocks: Vec<u8> = (0..6).flat_map(|block| [block; 8]).collect();
        let singles: Vec<u8> = (0..96).collect();
        let texels = ParcelTexels {
            extent: [12, 8],
            outline: Outline::new([12, 8], vec![[1, 2], [1, 3]]),
            channels: vec![Arc::from(blocks), Arc::from(singles)],
        };
        let compressed: Vec<_> = upload_rectangles(&texels, 0, AtlasFormat::Bc1).collect();
        let found: Vec<_> =
            compressed.iter().map(|r| (r.offset, r.size, r.rows().collect::<Vec<_>>())).collect();
        assert_eq!(found[0], ([4, 0], [4, 4], vec![&[1; 8][..]]));
        let pair = [[4; 8], [5; 8]].concat();
        assert_eq!(found[1], ([4, 4], [8, 4], vec![&pair[..]]));
        let plain: Vec<_> = upload_rectangles(&texels, 1, AtlasFormat::R8).collect();
        let rows: Vec<Vec<u8>> = plain[0].rows().map(<[u8]>::to_vec).collect();
        assert_eq!(rows, [[4, 5, 6, 7], [16, 17, 18, 19], [28, 29, 30, 31], [40, 41, 42, 43]]);
        assert_eq!(plain[1].layout(), UploadRows { count: 4, bytes: 8 });
    }
}
