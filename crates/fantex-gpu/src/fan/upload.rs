//! Parcels and page-table entries on their way into graphics memory.
//!
//! Texels are written into mapped staging buffers, rows at multiples of 256 bytes, and copied into the atlas by the frame's
//! own commands. The staging buffers come back when the frame is done and are used again, so that a steady stream
//! allocates nothing.

use fantex_stream::{AtlasFormat, FrameChanges, ParcelUpload, TableChange};
use wgpu::util::StagingBelt;

use super::atlas::ChannelAtlas;
use super::grid::AtlasGrid;
use super::page_words::{PageWords, ROW_SHIFT};

/// Bytes of a staging buffer: sixteen pages of 256x256 RGBA texels.
const STAGING_BYTES: u64 = 4 << 20;

/// The staging buffers.
#[derive(Debug)]
pub(crate) struct Uploader {
    belt: StagingBelt,
    grid: AtlasGrid,
    words: PageWords,
}

impl Uploader {
    pub(crate) fn new(device: &wgpu::Device, grid: AtlasGrid, words: PageWords) -> Self {
        Self { belt: StagingBelt::new(device.clone(), STAGING_BYTES), grid, words }
    }

    /// Records the changes of a frame: first texels, then entries. `atlases` has an entry per channel of the asset; texels
    /// of channels without an atlas are passed over.
    pub(crate) fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        changes: &FrameChanges,
        atlases: &[Option<ChannelAtlas>],
        table: &wgpu::Texture,
    ) {
        if changes.uploads.is_empty() && changes.entries.is_empty() {
            return;
        }
        for upload in &changes.uploads {
            for (atlas, texels) in atlases.iter().zip(&upload.texels.channels) {
                if let Some(atlas) = atlas {
                    self.texels(encoder, upload, atlas, texels);
                }
            }
        }
        self.entries(encoder, &changes.entries, table);
        self.belt.finish_and_recall_on_submit(encoder);
    }

    /// One copy: a parcel of a channel.
    fn texels(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        upload: &ParcelUpload,
        atlas: &ChannelAtlas,
        texels: &[u8],
    ) {
        let rows = Rows::new(atlas.format, upload.texels.extent);
        debug_assert_eq!(texels.len(), rows.bytes * rows.count, "{}", upload.parcel);
        let Some(size) = wgpu::BufferSize::new((rows.pitch * rows.count) as u64) else { return };
        let slice = self.belt.allocate(size, ALIGNMENT);
        // A belt's slice is mapped; were it not, the page would be missing from the picture, no more.
        if let Ok(mut mapped) = slice.get_mapped_range_mut() {
            for (row, bytes) in texels.chunks_exact(rows.bytes).enumerate() {
                let start = row * rows.pitch;
                mapped.slice(start..start + rows.bytes).copy_from_slice(bytes);
            }
        }
        let [x, y] = self.grid.texel(upload.place);
        let [width, height] = upload.texels.extent;
        encoder.copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer: slice.buffer(),
                layout: wgpu::TexelCopyBufferLayout {
                    offset: slice.offset(),
                    bytes_per_row: Some(rows.pitch as u32),
                    rows_per_image: None,
                },
            },
            wgpu::TexelCopyTextureInfo {
                texture: &atlas.texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x, y, z: 0 },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }

    /// One copy per run of neighbouring words.
    fn entries(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        entries: &[TableChange],
        table: &wgpu::Texture,
    ) {
        let runs = self.words.change(entries, self.grid);
        let count: usize = runs.iter().map(|run| run.len()).sum();
        let Some(size) = wgpu::BufferSize::new((count * WORD_BYTES) as u64) else { return };
        let slice = self.belt.allocate(size, ALIGNMENT);
        let Ok(mut mapped) = slice.get_mapped_range_mut() else { return };
        let mut filled = 0;
        for run in runs {
            let words = bytemuck::cast_slice(self.words.words(run.clone()));
            mapped.slice(filled..filled + words.len()).copy_from_slice(words);
            let columns = (1 << ROW_SHIFT) - 1;
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo {
                    buffer: slice.buffer(),
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: slice.offset() + filled as u64,
                        bytes_per_row: None,
                        rows_per_image: None,
                    },
                },
                wgpu::TexelCopyTextureInfo {
                    texture: table,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: run.start & columns, y: run.start >> ROW_SHIFT, z: 0 },
                    aspect: wgpu::TextureAspect::All,
                },
                wgpu::Extent3d { width: run.len() as u32, height: 1, depth_or_array_layers: 1 },
            );
            filled += words.len();
        }
    }
}

/// Bytes of a page's word.
const WORD_BYTES: usize = size_of::<u32>();

/// Satisfies every format's block and the copies' own rule.
const ALIGNMENT: wgpu::BufferSize = match wgpu::BufferSize::new(256) {
    Some(alignment) => alignment,
    None => wgpu::BufferSize::MIN,
};

/// Rows of a page in a buffer: of texels, or of blocks.
struct Rows {
    count: usize,
    /// Bytes that mean something.
    bytes: usize,
    /// From one row to the next.
    pitch: usize,
}

impl Rows {
    fn new(format: AtlasFormat, [columns, rows]: [u32; 2]) -> Self {
        let blocks = columns as usize / 4;
        let (count, bytes) = if format.is_compressed() {
            (rows as usize / 4, blocks * format.block_bytes())
        } else {
            (rows as usize, blocks * format.block_bytes() / 4)
        };
        Self { count, bytes, pitch: bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize) }
    }
}
