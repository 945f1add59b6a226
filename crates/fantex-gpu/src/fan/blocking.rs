//! Models of assets that are read by threads, and pictures that wait for them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_base::Result;
use fantex_scene::FilterOptions;
use fantex_store::Asset;
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, FrameOptions, StreamView};

use super::{StreamedModel, max_anisotropy};
use crate::Gpu;

/// Between two looks at what has arrived.
const PAUSE: Duration = Duration::from_millis(1);

impl StreamedModel {
    /// An open asset, read where it was opened, with texels in at most `budget_bytes` of graphics memory.
    ///
    /// # Errors
    /// The file cannot be opened for streaming; the device cannot take the model.
    pub fn open(gpu: &Gpu, asset: Arc<Asset>, budget_bytes: u64) -> Result<Self> {
        let loader = Self::loader(gpu, &asset)?;
        Self::with_pages(gpu, &asset, asset.clone(), Box::new(loader), budget_bytes)
    }

    /// What reads an asset's pages as a device wants them.
    ///
    /// # Errors
    /// The file cannot be opened for streaming.
    pub fn loader(gpu: &Gpu, asset: &Arc<Asset>) -> Result<ClusterLoader> {
        let options =
            ClusterLoaderOptions { block_compressed: gpu.has_block_compression(), ..Default::default() };
        ClusterLoader::open(Arc::clone(asset), &options)
    }

    /// Waits until all that a view needs is resident, or for `patience`; whether it is. For offline pictures; windows call [`StreamedModel::advance`].
    ///
    /// # Errors
    /// The device is lost or refuses an upload.
    pub fn wait_until_sharp(
        &mut self,
        gpu: &Gpu,
        view: &StreamView,
        filter: &FilterOptions,
        patience: Duration,
    ) -> Result<bool> {
        self.streamer.set_max_anisotropy(max_anisotropy(filter));
        let frame = FrameOptions { upload_bytes: 16 << 20, ..FrameOptions::default() };
        let started = Instant::now();
        loop {
            self.advance(gpu, Some(view), frame);
            // Frees the staging buffers that the device is done with.
            gpu.wait()?;
            if self.streamer.is_settled() {
                return Ok(true);
            }
            if started.elapsed() > patience {
                return Ok(false);
            }
            std::thread::sleep(PAUSE);
        }
    }
}
