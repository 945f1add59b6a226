//! Pages and page-table entries on their way into graphics memory.
//!
//! Texels are written into mapped staging buffers, rows at multiples of 256 bytes, and copied into the atlas by the frame's
//! own commands. The staging buffers come back when the frame is done and are used again, so that a steady stream
//! allocates nothing.

use fantex_stream::{AtlasFormat, FrameChanges, PageUpload, TableChange};
use wgpu::util::StagingBelt;

use super::atlas::ChannelAtlas;
use super::grid::AtlasGrid;

/// Bytes of a staging buffer: sixteen pages of 256x256 RGBA texels.
const STAGING_BYTES: u64 = 4 << 20;

/// The staging buffers.
#[derive(Debug)]
pub(crate) struct Uploader {
    belt: StagingBelt,
    grid: AtlasGrid,
}

impl Uploader {
    pub(crate) fn new(device: &wgpu::Device, grid: AtlasGrid) -> Self {
        Self { belt: StagingBelt::new(device.clone(), STAGING_BYTES), grid }
    }

    /// Records the changes of a frame: first texels, then entries. `atlases` has an entry per channel of the asset; texels
    /// of channels without an atlas are passed over.
    pub(crate) fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        changes: &FrameChanges,
        atlases: &[Option<ChannelAtlas>],
        table: &wgpu::Buffer,
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

    /// One copy: a page of a channel.
    fn texels(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        upload: &PageUpload,
        atlas: &ChannelAtlas,
        texels: &[u8],
    ) {
        let rows = Rows::new(atlas.format, upload.texels.extent);
        debug_assert_eq!(texels.len(), rows.bytes * rows.count, "{}", upload.page);
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

    /// One copy per run of neighbouring entries.
    fn entries(&mut self, encoder: &mut wgpu::CommandEncoder, entries: &[TableChange], table: &wgpu::Buffer) {
        let Some(size) = wgpu::BufferSize::new(4 * entries.len() as u64) else { return };
        let slice = self.belt.allocate(size, ALIGNMENT);
        let words: Vec<u32> = entries.iter().map(|change| self.grid.word(change.entry)).collect();
        if let Ok(mut mapped) = slice.get_mapped_range_mut() {
            mapped.copy_from_slice(bytemuck::cast_slice(&words));
        }
        let mut offset = slice.offset();
        for run in entries.chunk_by(|a, b| a.index + 1 == b.index) {
            let bytes = 4 * run.len() as u64;
            encoder.copy_buffer_to_buffer(slice.buffer(), offset, table, 4 * u64::from(run[0].index), bytes);
            offset += bytes;
        }
    }
}

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
