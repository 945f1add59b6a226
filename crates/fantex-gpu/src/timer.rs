//! How long the device takes for commands, by its own clock.

use std::time::Duration;

use fantex_base::Result;

use crate::Gpu;
use crate::gpu::refused;

/// Two readings of the device's clock, around commands of one encoder.
///
/// ```text
/// begin (encoder) -> commands -> end (encoder) -> submit -> elapsed
/// ```
#[derive(Debug)]
pub struct DeviceTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
    nanoseconds_per_tick: f64,
}

/// Bytes of two readings.
const BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

impl DeviceTimer {
    /// A timer, or nothing where the device has no clock for commands.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS) {
            return None;
        }
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timer"),
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let buffer = |usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timer"),
                size: BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        Some(Self {
            queries,
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
            nanoseconds_per_tick: f64::from(gpu.queue.get_timestamp_period()),
        })
    }

    /// Starts, before the commands that are timed.
    pub fn begin(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.queries, 0);
    }

    /// Stops, when the commands so far are done.
    pub fn end(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.write_timestamp(&self.queries, 1);
        encoder.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, BYTES);
    }

    /// What the submitted commands took. Waits for them.
    ///
    /// # Errors
    /// The device is lost.
    pub fn elapsed(&self, gpu: &Gpu) -> Result<Duration> {
        self.readable.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait()?;
        let bytes = self.readable.get_mapped_range(..).map_err(|error| refused(&error))?;
        let [begin, end] = bytemuck::pod_read_unaligned::<[u64; 2]>(&bytes);
        drop(bytes);
        self.readable.unmap();
        let nanoseconds = end.saturating_sub(begin) as f64 * self.nanoseconds_per_tick;
        Ok(Duration::from_nanos(nanoseconds as u64))
    }
}
