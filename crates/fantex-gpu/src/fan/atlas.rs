//! The atlas in graphics memory: a texture per channel, its page table, uploads, and a picture of it.

use fantex_base::Result;
use fantex_store::{Channel, ChannelKind};
use fantex_stream::drawing::{AtlasGrid, PAGE_ROW_SHIFT, PageWords, UploadRows, upload_rectangles};
use fantex_stream::{AtlasFormat, AtlasShape, FrameChanges, ParcelUpload, TableChange};
use wgpu::util::StagingBelt;

use super::FanModel;
use crate::Gpu;
use crate::gpu::SAMPLED;
use crate::renderer::{color_attachment, screen_pipeline};
use crate::shader::{FAN_ATLAS, module};

pub(crate) const KINDS: usize = 6;

/// The kinds of channel that are drawn, in the order of their bindings.
pub(crate) const DRAWN_KINDS: [ChannelKind; KINDS] = [
    ChannelKind::BaseColor,
    ChannelKind::Normal,
    ChannelKind::OcclusionRoughnessMetallic,
    ChannelKind::Emission,
    ChannelKind::Light,
    ChannelKind::Anisotropy,
];

/// The texture format that decodes a channel's texels, sRGB included.
fn texture_format(format: AtlasFormat, srgb: bool) -> wgpu::TextureFormat {
    use wgpu::TextureFormat as T;
    match (format, srgb) {
        (AtlasFormat::Bc1, false) => T::Bc1RgbaUnorm,
        (AtlasFormat::Bc1, true) => T::Bc1RgbaUnormSrgb,
        (AtlasFormat::Bc4, _) => T::Bc4RUnorm,
        (AtlasFormat::Bc5, _) => T::Bc5RgUnorm,
        (AtlasFormat::Bc7, false) => T::Bc7RgbaUnorm,
        (AtlasFormat::Bc7, true) => T::Bc7RgbaUnormSrgb,
        (AtlasFormat::R8, _) => T::R8Unorm,
        (AtlasFormat::Rg8, _) => T::Rg8Unorm,
        (AtlasFormat::Rgba8, false) => T::Rgba8Unorm,
        (AtlasFormat::Rgba8, true) => T::Rgba8UnormSrgb,
        (AtlasFormat::Rgba16F, _) => T::Rgba16Float,
    }
}

#[derive(Debug)]
pub(crate) struct ChannelAtlas {
    pub(crate) format: AtlasFormat,
    pub(crate) texture: wgpu::Texture,
    pub(crate) view: wgpu::TextureView,
}

impl ChannelAtlas {
    pub(crate) fn new(gpu: &Gpu, grid: AtlasGrid, channel: &Channel, format: AtlasFormat) -> Self {
        let texture = texture(gpu, grid.extent(), texture_format(format, channel.srgb));
        Self { format, view: texture.create_view(&Default::default()), texture }
    }
}

/// What stands for a channel that an asset has not; it is never read.
pub(crate) fn no_channel(gpu: &Gpu) -> wgpu::TextureView {
    texture(gpu, [1, 1], wgpu::TextureFormat::Rgba8Unorm).create_view(&Default::default())
}

fn texture(gpu: &Gpu, [width, height]: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
    gpu.texture("fan atlas", [width, height, 1], 1, format, SAMPLED)
}

/// The grid of a shape, unless the device's textures cannot hold it.
pub(crate) fn checked_grid(gpu: &Gpu, shape: AtlasShape) -> Result<AtlasGrid> {
    let allowed = gpu.limits().max_texture_dimension_2d;
    if AtlasGrid::fitting(shape, allowed) != shape {
        return Err(gpu.too_large("the atlas", shape.side.into(), allowed.into(), "texels per side"));
    }
    Ok(AtlasGrid::new(shape, allowed))
}

// Parcels and page-table entries on their way into graphics memory.
//
// Texels are written into mapped staging buffers, rows at multiples of 256 bytes, and copied into the atlas by the frame's
// own commands. The staging buffers come back when the frame is done and are used again, so that a steady stream
// allocates nothing.

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
        for upload in &changes.uploads {
            for (channel, atlas) in atlases.iter().enumerate() {
                if let Some(atlas) = atlas {
                    self.texels(encoder, upload, atlas, channel);
                }
            }
        }
        self.entries(encoder, &changes.entries, table);
        self.belt.finish_and_recall_on_submit(encoder);
    }

    /// A parcel of a channel: one copy per run of its outline, which is one for a whole rectangle.
    fn texels(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        upload: &ParcelUpload,
        atlas: &ChannelAtlas,
        channel: usize,
    ) {
        let [x, y] = self.grid.texel(upload.place);
        for rectangle in upload_rectangles(&upload.texels, channel, atlas.format) {
            let UploadRows { count, bytes } = rectangle.layout();
            let pitch = bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
            let Some(staged) = wgpu::BufferSize::new((pitch * count) as u64) else { continue };
            let slice = self.belt.allocate(staged, ALIGNMENT);
            // A belt's slice is always mapped; otherwise only these blocks would be missing.
            if let Ok(mut mapped) = slice.get_mapped_range_mut() {
                for (row, source) in rectangle.rows().enumerate() {
                    mapped.slice(row * pitch..row * pitch + bytes).copy_from_slice(source);
                }
            }
            let (offset, bytes_per_row) = (slice.offset(), Some(pitch as u32));
            let layout = wgpu::TexelCopyBufferLayout { offset, bytes_per_row, rows_per_image: None };
            let ([right, down], [width, height]) = (rectangle.offset, rectangle.size);
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo { buffer: slice.buffer(), layout },
                place_in(&atlas.texture, [x + right, y + down]),
                wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            );
        }
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
            let words = bytemuck::cast_slice(&self.words.words()[run.start as usize..run.end as usize]);
            mapped.slice(filled..filled + words.len()).copy_from_slice(words);
            let columns = (1 << PAGE_ROW_SHIFT) - 1;
            let offset = slice.offset() + filled as u64;
            let layout = wgpu::TexelCopyBufferLayout { offset, bytes_per_row: None, rows_per_image: None };
            encoder.copy_buffer_to_texture(
                wgpu::TexelCopyBufferInfo { buffer: slice.buffer(), layout },
                place_in(table, [run.start & columns, run.start >> PAGE_ROW_SHIFT]),
                wgpu::Extent3d { width: run.len() as u32, height: 1, depth_or_array_layers: 1 },
            );
            filled += words.len();
        }
    }
}

fn place_in(texture: &wgpu::Texture, [x, y]: [u32; 2]) -> wgpu::TexelCopyTextureInfo<'_> {
    wgpu::TexelCopyTextureInfo { origin: wgpu::Origin3d { x, y, z: 0 }, ..texture.as_image_copy() }
}

const WORD_BYTES: usize = size_of::<u32>();

/// Satisfies every format's block and the copies' own rule.
const ALIGNMENT: wgpu::BufferSize = match wgpu::BufferSize::new(256) {
    Some(alignment) => alignment,
    None => wgpu::BufferSize::MIN,
};

// The live atlas: what is in graphics memory, as a picture.

/// Draws atlases into targets of one format that does not encode sRGB itself.
#[derive(Debug)]
pub struct AtlasViewer {
    pipeline: wgpu::RenderPipeline,
}

impl AtlasViewer {
    /// For targets of a format.
    pub fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Self {
        let module = module(&gpu.device, "live atlas", FAN_ATLAS);
        let entries = ["vs_fan_atlas", "fs_fan_atlas"];
        Self { pipeline: screen_pipeline(gpu, "live atlas", &module, entries, None, output) }
    }

    /// Fills a target with the whole atlas of one of the asset's channels, each pixel the mean of up to four of the texels that it
    /// covers. Places that pages have left show what was there until others come. Nothing is drawn where the channel is not, and
    /// `false` is returned.
    pub fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        model: &FanModel,
        channel: usize,
    ) -> bool {
        let Some(atlas) = model.atlas_texture(channel) else { return false };
        let about = [u32::from(atlas.format().components()), u32::from(atlas.format().is_srgb()), 0, 0];
        let about = gpu.buffer("live atlas", bytemuck::bytes_of(&about), wgpu::BufferUsages::UNIFORM);
        let source = atlas.create_view(&Default::default());
        let resources = [wgpu::BindingResource::TextureView(&source), about.as_entire_binding()];
        let group = gpu.bind_group("live atlas", &self.pipeline.get_bind_group_layout(0), resources);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("live atlas"),
            color_attachments: &[Some(color_attachment(target, wgpu::Color::BLACK))],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        true
    }
}
