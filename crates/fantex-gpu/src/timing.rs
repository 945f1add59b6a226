//! How long frames take.

use std::time::{Duration, Instant};

use crate::{Frame, Gpu, GpuError, Renderer};

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
