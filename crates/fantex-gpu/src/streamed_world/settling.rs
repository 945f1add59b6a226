//! Waiting for a world, where a thread may.

use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_base::Result;
use fantex_scene::Camera;
use fantex_stream::FrameOptions;

use super::StreamedWorld;
use crate::Gpu;

/// How long to leave the loaders alone before looking again.
const PAUSE: Duration = Duration::from_millis(1);

impl StreamedWorld {
    /// Waits until all that a view onto `size` pixels needs is there, or for `patience`; whether it is. For offline pictures; windows call
    /// [`advance`](Self::advance).
    ///
    /// # Errors
    /// As [`advance`](Self::advance), or the device is lost.
    pub fn wait_until_settled(
        &mut self,
        gpu: &Arc<Gpu>,
        camera: &Camera,
        size: [u32; 2],
        patience: Duration,
    ) -> Result<bool> {
        let started = Instant::now();
        loop {
            self.advance(gpu, camera, size, FrameOptions::default())?;
            // Frees the staging buffers that the device is done with.
            gpu.wait()?;
            if self.is_settled() {
                return Ok(true);
            }
            if started.elapsed() > patience {
                return Ok(false);
            }
            std::thread::sleep(PAUSE);
        }
    }
}
