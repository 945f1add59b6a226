//! Models that bring their own pages: a streamer and a model put together.

use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_scene::{Camera, FilterOptions};
use fantex_store::Asset;
use fantex_stream::{
    ClusterLoader, ClusterLoaderOptions, FrameChanges, FrameOptions, Geometry, LoaderError, ParcelLoader,
    StreamView, Streamer, StreamerOptions,
};
use fantex_texture::Filter;

use super::FanModel;
use crate::{Gpu, GpuError, ModelSpace, View};

/// An asset cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StreamedModelError {
    /// Its file cannot be read.
    #[error(transparent)]
    Loader(#[from] LoaderError),
    /// The device cannot take it.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// An asset on the device, whose pages come as views need them.
pub struct StreamedModel {
    /// What is drawn.
    pub model: FanModel,
    /// What decides which pages are resident.
    pub streamer: Streamer,
    /// Seconds for which another atlas has been filled.
    filling_seconds: f32,
}

impl std::fmt::Debug for StreamedModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StreamedModel").field("model", &self.model).finish_non_exhaustive()
    }
}

/// Between two looks at what has arrived.
const PAUSE: Duration = Duration::from_millis(1);

/// Another atlas is shown after so long, whatever it still lacks.
const LONGEST_FILLING_SECONDS: f32 = 3.0;

impl StreamedModel {
    /// An open asset, read where it was opened, with texels in at most `budget_bytes` of graphics memory.
    ///
    /// # Errors
    ///
    /// The file cannot be opened for streaming; the device cannot take the model.
    pub fn open(gpu: &Gpu, asset: Arc<Asset>, budget_bytes: u64) -> Result<Self, StreamedModelError> {
        let loader = Self::loader(gpu, &asset)?;
        Ok(Self::with_pages(gpu, &asset, asset.clone(), Box::new(loader), budget_bytes)?)
    }

    /// What reads an asset's pages as a device wants them.
    ///
    /// # Errors
    ///
    /// The file cannot be opened for streaming.
    pub fn loader(gpu: &Gpu, asset: &Arc<Asset>) -> Result<ClusterLoader, LoaderError> {
        let options =
            ClusterLoaderOptions { block_compressed: gpu.has_block_compression(), ..Default::default() };
        ClusterLoader::open(Arc::clone(asset), &options)
    }

    /// An asset whose pages come from `loader`. Mesh and cover are kept as `geometry`, which is the asset's own or a copy; of
    /// the asset nothing else is.
    ///
    /// # Errors
    ///
    /// The device cannot take the model.
    pub fn with_pages(
        gpu: &Gpu,
        asset: &Asset,
        geometry: Arc<dyn Geometry>,
        loader: Box<dyn ParcelLoader>,
        budget_bytes: u64,
    ) -> Result<Self, GpuError> {
        let atlas = FanModel::atlas_shape(gpu, budget_bytes, &FanModel::atlas_formats(gpu, asset.channels()));
        let options = StreamerOptions { atlas, ..StreamerOptions::default() };
        let streamer = Streamer::new(geometry, loader, options);
        let model = FanModel::of_asset(gpu, asset, streamer.table(), budget_bytes)?;
        Ok(Self { model, streamer, filling_seconds: 0.0 })
    }

    /// Brings to the device what has arrived, and asks for what a view needs; `None` where nothing is seen. Returns what has
    /// changed.
    pub fn advance(&mut self, gpu: &Gpu, view: Option<&StreamView>, frame: FrameOptions) -> FrameChanges {
        let changes = self.streamer.update(view, frame);
        self.model.update(gpu, &changes);
        if self.model.has_hidden_atlas() {
            self.filling_seconds += frame.elapsed_seconds;
            if self.streamer.is_settled() || self.filling_seconds > LONGEST_FILLING_SECONDS {
                self.model.finish_atlas();
            }
        }
        changes
    }

    /// Gives texels another budget, without a pause: the new atlas is filled as pages arrive, and the present one is shown, as
    /// it is, until the new one has what the view needs, for a few seconds at most. For that time there are both.
    ///
    /// # Errors
    ///
    /// The device cannot take the atlas; then everything is as it was.
    pub fn set_budget(&mut self, gpu: &Gpu, budget_bytes: u64) -> Result<(), GpuError> {
        let shape = FanModel::atlas_shape(gpu, budget_bytes, self.model.formats());
        if shape == self.model.shape() {
            return Ok(());
        }
        let geometry = self.streamer.geometry().clone();
        self.model.begin_atlas(gpu, geometry.cover(), self.streamer.table(), shape)?;
        self.streamer.set_atlas(shape);
        self.filling_seconds = 0.0;
        Ok(())
    }

    /// Waits until all that a view needs is resident, or for `patience`; whether it is. For pictures that nobody waits
    /// for; windows call [`StreamedModel::advance`].
    ///
    /// # Errors
    ///
    /// The device is lost or refuses an upload.
    pub fn wait_until_sharp(
        &mut self,
        gpu: &Gpu,
        view: &StreamView,
        filter: &FilterOptions,
        patience: Duration,
    ) -> Result<bool, GpuError> {
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

/// What a filter asks of the demand: the greatest ratio of a pixel's axes that it honours.
pub fn max_anisotropy(filter: &FilterOptions) -> f32 {
    match filter.filter {
        Filter::Anisotropic | Filter::Ewa => filter.max_anisotropy,
        Filter::Nearest | Filter::Bilinear | Filter::Bicubic | Filter::Trilinear => 1.0,
    }
}

/// A camera's view onto `size` pixels of a model, as demand needs to know it.
pub fn stream_view(camera: &Camera, size: [u32; 2], space: &ModelSpace) -> StreamView {
    let view = View::new(camera, size, space);
    StreamView::new(view.eye.as_vec3(), view.axes, view.fov_radians, view.size)
}
