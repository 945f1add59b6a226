//! Pictures without a window.

use std::time::{Duration, Instant};

use fantex_scene::Picture;

use crate::{Frame, Gpu, GpuError, Renderer};

/// Renders pictures into main memory.
#[derive(Debug)]
pub struct PictureRenderer {
    renderer: Renderer,
    target: Option<Target>,
}

/// A texture of floats and the buffer that it is read through.
#[derive(Debug)]
struct Target {
    size: [u32; 2],
    texture: wgpu::Texture,
    buffer: wgpu::Buffer,
    bytes_per_row: u32,
}

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const TEXEL_BYTES: u32 = 16;

/// Renders one picture; for several, a [`PictureRenderer`] is faster. See [`PictureRenderer::render`].
///
/// # Errors
///
/// As [`PictureRenderer::render`].
pub fn render_to_picture(gpu: &Gpu, frame: &mut Frame<'_>) -> Result<Picture, GpuError> {
    PictureRenderer::new(gpu).render(gpu, frame)
}

impl PictureRenderer {
    /// A renderer for pictures of any size.
    pub fn new(gpu: &Gpu) -> Self {
        Self { renderer: Renderer::new(gpu, FORMAT), target: None }
    }

    /// Renders a picture and waits for it: linear light with straight alpha, through the tone map that the options name.
    /// Half floats round it to one part in 2000. A picture without columns or rows is empty.
    ///
    /// # Errors
    ///
    /// As [`Renderer::draw`]; the device has no memory for the picture.
    pub fn render(&mut self, gpu: &Gpu, frame: &mut Frame<'_>) -> Result<Picture, GpuError> {
        let size = frame.size;
        if size.contains(&0) {
            return Ok(Picture { width: size[0], height: size[1], rgba: Vec::new() });
        }
        let target = match self.target.take() {
            Some(target) if target.size == size => target,
            _ => Target::new(gpu, size)?,
        };
        let target = self.target.insert(target);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let view = target.texture.create_view(&Default::default());
        self.renderer.draw(gpu, &mut encoder, &view, frame)?;
        target.copy(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
        target.read(gpu)
    }
}

impl Target {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, GpuError> {
        let [width, height] = size;
        let limits = gpu.limits();
        let side = width.max(height);
        if side > limits.max_texture_dimension_2d {
            let allowed = u64::from(limits.max_texture_dimension_2d);
            return Err(gpu.too_large("a picture", u64::from(side), allowed, "pixels along a side"));
        }
        let bytes_per_row = (width * TEXEL_BYTES).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(bytes_per_row) * u64::from(height);
        if bytes > limits.max_buffer_size {
            return Err(gpu.too_large("a picture", bytes, limits.max_buffer_size, "bytes of a buffer"));
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        Ok(Self { size, texture, buffer, bytes_per_row })
    }

    fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &self.buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(self.bytes_per_row),
                    rows_per_image: None,
                },
            },
            self.texture.size(),
        );
    }

    fn read(&self, gpu: &Gpu) -> Result<Picture, GpuError> {
        let refused = |reason: String| GpuError::Refused { reason };
        let (sender, receiver) = std::sync::mpsc::channel();
        self.buffer.map_async(wgpu::MapMode::Read, .., move |mapped| {
            // The receiver waits below unless an earlier error has made the picture void.
            sender.send(mapped).ok();
        });
        gpu.wait()?;
        let mapped = receiver.recv().map_err(|error| refused(error.to_string()))?;
        mapped.map_err(|error| refused(error.to_string()))?;
        let [width, height] = self.size;
        let bytes = self.buffer.get_mapped_range(..).map_err(|error| refused(error.to_string()))?;
        let rows = bytes.chunks_exact(self.bytes_per_row as usize);
        let texels = |row: &[u8]| -> Vec<[f32; 4]> {
            row[..(width * TEXEL_BYTES) as usize].chunks_exact(16).map(bytemuck::pod_read_unaligned).collect()
        };
        let rgba: Vec<[f32; 4]> = rows.flat_map(texels).collect();
        drop(bytes);
        self.buffer.unmap();
        Ok(Picture { width, height, rgba })
    }
}

// How long frames take.

/// Wall-clock times of frames that were waited for one by one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameTimes {
    /// One per frame, in order.
    pub all: Vec<Duration>,
}

impl FrameTimes {
    /// The shortest; zero without frames.
    pub fn minimum(&self) -> Duration {
        self.all.iter().min().copied().unwrap_or_default()
    }

    /// The middle one; zero without frames.
    pub fn median(&self) -> Duration {
        let mut sorted = self.all.clone();
        sorted.sort_unstable();
        sorted.get(sorted.len() / 2).copied().unwrap_or_default()
    }
}

/// A target that nobody sees, for frames that are timed.
#[derive(Debug)]
pub struct HiddenScreen {
    renderer: Renderer,
    target: wgpu::TextureView,
}

impl HiddenScreen {
    /// A target of bytes, of `size` pixels (at least one).
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let [width, height] = size.map(|n| n.max(1));
        let target = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("timed frames"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let target = target.create_view(&Default::default());
        Self { renderer: Renderer::new(gpu, wgpu::TextureFormat::Rgba8Unorm), target }
    }

    /// Draws a frame of the screen's size and waits for it.
    ///
    /// # Errors
    ///
    /// As [`Renderer::draw`].
    pub fn draw(&mut self, gpu: &Gpu, frame: &mut Frame<'_>) -> Result<(), GpuError> {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.renderer.draw(gpu, &mut encoder, &self.target, frame)?;
        gpu.queue.submit([encoder.finish()]);
        gpu.wait()
    }
}

/// Draws the same frame `count` times into a target of bytes, waiting for the device after each, and times everything from the
/// recording of commands to the end of their execution. One more frame goes before, in which pipelines are compiled, textures
/// uploaded and shadow maps drawn.
///
/// # Errors
///
/// As [`Renderer::draw`].
pub fn frame_times(gpu: &Gpu, frame: &mut Frame<'_>, count: usize) -> Result<FrameTimes, GpuError> {
    let mut screen = HiddenScreen::new(gpu, frame.size);
    screen.draw(gpu, frame)?;
    let timed = |_| {
        let start = Instant::now();
        screen.draw(gpu, frame)?;
        Ok(start.elapsed())
    };
    let all = (0..count).map(timed).collect::<Result<_, GpuError>>()?;
    Ok(FrameTimes { all })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_not_the_mean() {
        let times = FrameTimes { all: [9, 1, 2].map(Duration::from_millis).to_vec() };
        assert_eq!((times.minimum(), times.median()), (Duration::from_millis(1), Duration::from_millis(2)));
        assert_eq!(FrameTimes { all: Vec::new() }.median(), Duration::ZERO);
    }
}
