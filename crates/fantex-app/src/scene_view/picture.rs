//! The texture that the window shows, and how long drawing it took.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use eframe::wgpu;
use fantex_gpu::Gpu;

use super::FORMAT;

/// A texture to draw into and to show.
#[derive(Debug)]
pub(super) struct Picture {
    size: [u32; 2],
    view: wgpu::TextureView,
    is_new: bool,
    /// Nanoseconds from submission to completion; zero while unknown.
    took: Arc<AtomicU64>,
}

impl Picture {
    pub(super) fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("scene"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        Self { size, view, is_new: true, took: Arc::default() }
    }

    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    pub(super) fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// The view, and whether it is shown for the first time.
    pub(super) fn shown(&mut self) -> (&wgpu::TextureView, bool) {
        let is_new = std::mem::take(&mut self.is_new);
        (&self.view, is_new)
    }

    /// What draws it was submitted just now: the time starts.
    pub(super) fn submitted(&mut self, gpu: &Gpu) {
        let started = Instant::now();
        let took = Arc::new(AtomicU64::new(0));
        self.took = took.clone();
        gpu.queue.on_submitted_work_done(move || {
            took.store((started.elapsed().as_nanos() as u64).max(1), Relaxed);
        });
    }

    /// How long it took, once, as soon as it is known.
    pub(super) fn take_seconds(&mut self) -> Option<f64> {
        match self.took.swap(0, Relaxed) {
            0 => None,
            nanoseconds => Some(nanoseconds as f64 * 1e-9),
        }
    }
}
