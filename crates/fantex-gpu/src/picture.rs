//! Pictures without a window, and the time that frames take.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use fantex_base::Result;
use fantex_scene::Picture;

use crate::gpu::refused;
use crate::{DeviceTimer, Frame, Gpu, Renderer};

/// A texture on its way into main memory.
///
/// ```text
/// new -> record (copies, among a frame's commands) -> submit -> begin -> is_ready ... -> rows
/// ```
#[derive(Debug)]
pub struct Readback {
    buffer: wgpu::Buffer,
    size: wgpu::Extent3d,
    row_bytes: u32,
    /// From one row to the next.
    pitch: u32,
    state: Arc<AtomicU8>,
}

const PENDING: u8 = 0;
const MAPPED: u8 = 1;
const FAILED: u8 = 2;

impl Readback {
    /// Room for a texture without blocks, levels or layers, whose usage includes `COPY_SRC`.
    ///
    /// # Errors
    /// The device allows no buffer that large.
    pub fn new(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Self> {
        let size = wgpu::Extent3d { depth_or_array_layers: 1, ..texture.size() };
        let row_bytes = size.width * texture.format().block_copy_size(None).unwrap_or(4);
        let pitch = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let (bytes, allowed) = (u64::from(pitch) * u64::from(size.height), gpu.limits().max_buffer_size);
        gpu.allow("a picture", bytes, allowed, "bytes of a buffer")?;
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        Ok(Self { buffer, size, row_bytes, pitch, state: Arc::new(AtomicU8::new(PENDING)) })
    }

    /// Records the copy.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) {
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(self.pitch), rows_per_image: None };
        let target = wgpu::TexelCopyBufferInfo { buffer: &self.buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, self.size);
    }

    /// Begins to read, once the commands are submitted. [`Gpu::wait`], or polling the device, brings it about.
    pub fn begin(&self) {
        let state = Arc::clone(&self.state);
        state.store(PENDING, Ordering::Relaxed);
        self.buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            state.store(if result.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
        });
    }

    /// Whether [`Readback::rows`] has something to read, or never will.
    pub fn is_ready(&self) -> bool {
        self.state.load(Ordering::Acquire) != PENDING
    }

    /// Hands the bytes of each row to `row`, from the top; the buffer can be used again then.
    ///
    /// # Errors
    /// The device has not brought them, or is lost.
    pub fn rows(&self, mut row: impl FnMut(&[u8])) -> Result<()> {
        if self.state.load(Ordering::Acquire) != MAPPED {
            return Err(refused(&"a picture could not be read from the graphics memory"));
        }
        let bytes = self.buffer.get_mapped_range(..).map_err(|error| refused(&error))?;
        bytes.chunks_exact(self.pitch as usize).for_each(|bytes| row(&bytes[..self.row_bytes as usize]));
        drop(bytes);
        self.buffer.unmap();
        Ok(())
    }
}

/// Renders pictures into main memory.
#[derive(Debug)]
pub struct PictureRenderer {
    renderer: Renderer,
    target: Option<(wgpu::Texture, Readback)>,
}

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// Renders one picture; for several, a [`PictureRenderer`] is faster. See [`PictureRenderer::render`].
///
/// # Errors
/// As [`PictureRenderer::render`].
pub fn render_to_picture(gpu: &Gpu, frame: &mut Frame<'_>) -> Result<Picture> {
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
    /// As [`Renderer::draw`]; the device has no memory for the picture.
    pub fn render(&mut self, gpu: &Gpu, frame: &mut Frame<'_>) -> Result<Picture> {
        let [width, height] = frame.size;
        if frame.size.contains(&0) {
            return Ok(Picture { width, height, rgba: Vec::new() });
        }
        let (texture, readback) = match self.target.take() {
            Some(target) if [target.0.width(), target.0.height()] == frame.size => self.target.insert(target),
            _ => self.target.insert(target(gpu, frame.size)?),
        };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.renderer.draw(gpu, &mut encoder, &texture.create_view(&Default::default()), frame)?;
        readback.record(&mut encoder, texture);
        gpu.queue.submit([encoder.finish()]);
        readback.begin();
        gpu.wait()?;
        let mut rgba = Vec::with_capacity(width as usize * height as usize);
        readback
            .rows(|row| rgba.extend(row.chunks_exact(16).map(bytemuck::pod_read_unaligned::<[f32; 4]>)))?;
        Ok(Picture { width, height, rgba })
    }
}

fn target(gpu: &Gpu, [width, height]: [u32; 2]) -> Result<(wgpu::Texture, Readback)> {
    let (side, allowed) = (width.max(height), gpu.limits().max_texture_dimension_2d);
    gpu.allow("a picture", side, allowed, "pixels along a side")?;
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
    let texture = gpu.texture("picture", [width, height, 1], 1, FORMAT, usage);
    let readback = Readback::new(gpu, &texture)?;
    Ok((texture, readback))
}

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

/// An offscreen target for frames that are timed.
#[derive(Debug)]
pub struct HiddenScreen {
    renderer: Renderer,
    target: wgpu::TextureView,
    timer: Option<DeviceTimer>,
}

impl HiddenScreen {
    /// A target of bytes, of `size` pixels (at least one).
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let [width, height] = size.map(|n| n.max(1));
        let (format, usage) = (wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureUsages::RENDER_ATTACHMENT);
        let target = gpu.texture("timed frames", [width, height, 1], 1, format, usage);
        let target = target.create_view(&Default::default());
        Self { renderer: Renderer::new(gpu, format), target, timer: DeviceTimer::new(gpu) }
    }

    /// Draws a frame of the screen's size and waits for it. What the device took for the frame's commands by its own clock, where it
    /// has one.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub fn draw(&mut self, gpu: &Gpu, frame: &mut Frame<'_>) -> Result<Option<Duration>> {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        if let Some(timer) = &self.timer {
            timer.begin(&mut encoder);
        }
        self.renderer.draw(gpu, &mut encoder, &self.target, frame)?;
        if let Some(timer) = &self.timer {
            timer.end(&mut encoder);
        }
        gpu.queue.submit([encoder.finish()]);
        match &self.timer {
            Some(timer) => timer.elapsed(gpu).map(Some),
            None => gpu.wait().map(|()| None),
        }
    }
}

/// Draws the same frame `count` times into a target of bytes, waiting for the device after each, and times everything from the
/// recording of commands to the end of their execution. One more frame goes before, in which pipelines are compiled, textures
/// uploaded and shadow maps drawn.
///
/// # Errors
/// As [`Renderer::draw`].
pub fn frame_times(gpu: &Gpu, frame: &mut Frame<'_>, count: usize) -> Result<FrameTimes> {
    let mut screen = HiddenScreen::new(gpu, frame.size);
    screen.draw(gpu, frame)?;
    let timed = |_| {
        let start = Instant::now();
        screen.draw(gpu, frame)?;
        Ok(start.elapsed())
    };
    let all = (0..count).map(timed).collect::<Result<_>>()?;
    Ok(FrameTimes { all })
}
