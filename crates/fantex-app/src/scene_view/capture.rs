//! Pictures of the scene on their way from the graphics memory to a file.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use eframe::wgpu;
use fantex_gpu::{Gpu, GpuError};
use fantex_texture::{ColorSpace, Image, Samples, SaveImageError};

use super::FORMAT;

const TEXEL_BYTES: u32 = 4;

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The renderer.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Nothing is open.
    #[error("there is nothing to take a picture of: open a model or an asset first")]
    NothingOpen,
    /// No side may be zero or longer than the device can.
    #[error("a picture of {}x{} pixels cannot be taken; its sides must have 1 to {most} pixels", size[0], size[1])]
    Size {
        /// What was asked for.
        size: [u32; 2],
        /// What the device can.
        most: u32,
    },
    /// What was drawn could not be read back.
    #[error("the picture for {} could not be read from the graphics memory", path.display())]
    Lost {
        /// Where it was to go.
        path: PathBuf,
    },
    /// The file.
    #[error(transparent)]
    Save(#[from] SaveImageError),
}

/// A picture that is being drawn and copied.
#[derive(Debug)]
pub struct Capturing {
    path: PathBuf,
    size: [u32; 2],
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    buffer: wgpu::Buffer,
    bytes_per_row: u32,
    state: Arc<AtomicU8>,
}

const PENDING: u8 = 0;
const MAPPED: u8 = 1;
const LOST: u8 = 2;

/// A picture in main memory.
#[derive(Debug)]
pub struct Captured {
    /// Where it is to go.
    pub path: PathBuf,
    /// The picture.
    pub image: Result<Image, CaptureError>,
}

impl Capturing {
    /// Somewhere to draw.
    pub(super) fn target(gpu: &Gpu, size: [u32; 2], path: PathBuf) -> Result<Self, CaptureError> {
        let limits = gpu.limits();
        let bytes_per_row = size[0].saturating_mul(TEXEL_BYTES);
        let bytes_per_row = bytes_per_row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(bytes_per_row) * u64::from(size[1]);
        let most = limits.max_texture_dimension_2d;
        if size.contains(&0) || size.iter().any(|&n| n > most) || bytes > limits.max_buffer_size {
            return Err(CaptureError::Size { size, most });
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture for a file"),
            size: extent(size),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture for a file"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let view = texture.create_view(&Default::default());
        let state = Arc::new(AtomicU8::new(PENDING));
        Ok(Self { path, size, texture, view, buffer, bytes_per_row, state })
    }

    pub(super) fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Submits what draws the picture, and its way into main memory.
    pub(super) fn submit(self, gpu: &Gpu, mut encoder: wgpu::CommandEncoder) -> Self {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(self.bytes_per_row),
            rows_per_image: None,
        };
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &self.buffer, layout },
            extent(self.size),
        );
        gpu.queue.submit([encoder.finish()]);
        let state = self.state.clone();
        self.buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            state.store(if result.is_ok() { MAPPED } else { LOST }, Relaxed);
        });
        self
    }

    /// Whether [`Capturing::finish`] has something to read, or never will.
    pub(super) fn is_ready(&self) -> bool {
        self.state.load(Relaxed) != PENDING
    }

    /// What is told where the device is gone.
    pub(super) fn into_lost(self) -> CaptureError {
        CaptureError::Lost { path: self.path }
    }

    /// The picture, without alpha.
    pub(super) fn finish(self) -> Captured {
        let image = match self.state.load(Relaxed) {
            MAPPED => self.read(),
            _ => Err(CaptureError::Lost { path: self.path.clone() }),
        };
        Captured { path: self.path, image }
    }

    fn read(&self) -> Result<Image, CaptureError> {
        let lost = || CaptureError::Lost { path: self.path.clone() };
        let bytes = self.buffer.get_mapped_range(..).map_err(|_| lost())?;
        let [width, height] = self.size;
        let used = (width * TEXEL_BYTES) as usize;
        let rows = bytes.chunks(self.bytes_per_row as usize).flat_map(|row| row[..used].chunks_exact(4));
        let samples = Samples::U8(rows.flat_map(|texel| [texel[0], texel[1], texel[2]]).collect());
        Ok(Image { width, height, channels: 3, space: ColorSpace::Srgb, samples })
    }
}

fn extent(size: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 }
}
