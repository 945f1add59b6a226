//! An asset on the GPU: its fans, the atlas, and the streaming that fills it.

use std::sync::Arc;

use eframe::wgpu;
use fantex_cover::Cover;
use fantex_gpu::{FanModel, Gpu, GpuError, View};
use fantex_store::{Asset, cover_level_count, page_grid};
use fantex_stream::{
    ClusterLoader, ClusterLoaderOptions, FrameOptions, Geometry, LoaderError, PageLoader, StreamView,
    Streamer, StreamerOptions,
};

use super::atlas_view::{AtlasPicture, AtlasView};
use super::painted::{PaintedGeometry, PaintedPages};
use crate::figures::{DamagedPage, LISTED_DAMAGE, LevelFigures, StreamFigures};
use crate::paint::{Exchange, PaintLoader};
use crate::settings::StreamingSettings;
use crate::viewer::Viewer;

/// Seconds for which another size of the pool must have been asked for before it is made.
const POOL_SECONDS: f32 = 0.4;

/// The pace for which the upload budget of a frame is meant.
const QUICK_FRAMES_PER_SECOND: f32 = 60.0;

/// A slow frame takes no more than so many quick ones would.
const MOST_QUICK_FRAMES: f32 = 16.0;

/// An asset, streamed.
pub struct FanScene {
    asset: Arc<Asset>,
    model: FanModel,
    streamer: Streamer,
    /// Memory for texels that the atlas was made for.
    pool_mib: u32,
    /// How long another size has been asked for.
    pool_wait: f32,
    anisotropy: u32,
    /// Pages per level of the whole cover.
    level_pages: Vec<u64>,
    uploaded_pages: u64,
    damaged: Vec<DamagedPage>,
    atlas_view: AtlasView,
    painted: Option<PaintedPages>,
}

impl std::fmt::Debug for FanScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FanScene").field("asset", &self.asset.path()).finish_non_exhaustive()
    }
}

/// An asset cannot be brought to the GPU.
#[derive(Debug, thiserror::Error)]
pub enum FanSceneError {
    /// The device cannot hold it.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Its pages cannot be read.
    #[error(transparent)]
    Loader(#[from] LoaderError),
}

impl FanScene {
    /// Everything but the texels, which come by and by.
    pub(super) fn new(
        gpu: &Gpu,
        asset: Arc<Asset>,
        settings: StreamingSettings,
        exchange: Option<Arc<Exchange>>,
    ) -> Result<Self, FanSceneError> {
        let formats = FanModel::atlas_formats(gpu, asset.channels());
        let atlas = FanModel::atlas_shape(gpu, settings.pool_bytes(), &formats);
        let loading =
            ClusterLoaderOptions { block_compressed: gpu.has_block_compression(), ..Default::default() };
        let loader = ClusterLoader::open(asset.clone(), &loading)?;
        let options = StreamerOptions { atlas, ..StreamerOptions::default() };
        let anisotropy = options.max_anisotropy as u32;
        let loader: Box<dyn PageLoader> = match &exchange {
            None => Box::new(loader),
            Some(exchange) => {
                exchange.set_formats(&formats);
                Box::new(PaintLoader::new(Box::new(loader), exchange.clone()))
            }
        };
        let geometry: Arc<dyn Geometry> = match &exchange {
            None => asset.clone(),
            // Older states of what is painted on must not be kept.
            Some(_) => Arc::new(PaintedGeometry::of(&asset)),
        };
        let streamer = Streamer::new(geometry, loader, options);
        let model = FanModel::of_asset(gpu, &asset, streamer.table(), settings.pool_bytes())?;
        Ok(Self {
            level_pages: level_pages(asset.cover()),
            asset,
            model,
            streamer,
            pool_mib: settings.pool_mib,
            pool_wait: 0.0,
            anisotropy,
            uploaded_pages: 0,
            damaged: Vec::new(),
            atlas_view: AtlasView::default(),
            painted: exchange.map(PaintedPages::new),
        })
    }

    pub(super) fn model(&mut self) -> &mut FanModel {
        &mut self.model
    }

    /// Lets streaming go on for a frame. Returns whether something has changed that may be seen.
    pub(super) fn stream(
        &mut self,
        gpu: &Gpu,
        viewer: &Viewer,
        elapsed_seconds: f32,
    ) -> Result<bool, GpuError> {
        let settings = viewer.settings.streaming;
        let is_new = self.follow_settings(gpu, viewer, elapsed_seconds)?;
        if !settings.is_running {
            return Ok(self.upload_painted(gpu) || is_new);
        }
        let view = View::new(&viewer.camera(), viewer.scene_pixels, fantex_gpu::Model::space(&self.model));
        let view = StreamView::new(view.eye.as_vec3(), view.axes, view.fov_radians, viewer.scene_pixels);
        // The budget is meant for quick frames; slow ones take as much per second.
        let frames = (elapsed_seconds * QUICK_FRAMES_PER_SECOND).clamp(1.0, MOST_QUICK_FRAMES);
        let upload_bytes = (settings.upload_bytes() as f32 * frames) as usize;
        let frame = FrameOptions { upload_bytes, elapsed_seconds };
        let changes = self.streamer.update(Some(&view), frame);
        self.model.update(gpu, &changes);
        if let Some(painted) = &mut self.painted {
            painted.follow(&changes);
        }
        let is_painted = self.upload_painted(gpu);
        self.uploaded_pages += changes.uploads.len() as u64;
        let has_changed = !changes.uploads.is_empty() || !changes.entries.is_empty();
        if has_changed {
            self.atlas_view.changed();
        }
        self.list_damage();
        Ok(is_new || has_changed || is_painted)
    }

    /// Brings what was painted since the last frame to the atlas, where its pages are resident.
    fn upload_painted(&mut self, gpu: &Gpu) -> bool {
        let Some(painted) = &mut self.painted else { return false };
        if let Some(asset) = painted.take_asset() {
            self.asset = asset;
        }
        let (changes, stale) = painted.take(self.streamer.table(), self.asset.cover());
        if !stale.is_empty() {
            self.streamer.invalidate(&stale);
        }
        if changes.uploads.is_empty() {
            return false;
        }
        self.model.update(gpu, &changes);
        self.atlas_view.changed();
        true
    }

    /// Takes over another size of the pool once it is no longer being changed, and another filter.
    fn follow_settings(
        &mut self,
        gpu: &Gpu,
        viewer: &Viewer,
        elapsed_seconds: f32,
    ) -> Result<bool, GpuError> {
        let anisotropy = viewer.settings.display.anisotropy;
        if anisotropy != self.anisotropy {
            self.anisotropy = anisotropy;
            self.streamer.set_max_anisotropy(anisotropy as f32);
        }
        let settings = viewer.settings.streaming;
        if settings.pool_mib == self.pool_mib {
            self.pool_wait = 0.0;
            return Ok(false);
        }
        self.pool_wait += elapsed_seconds.clamp(0.001, 0.1);
        if self.pool_wait < POOL_SECONDS {
            return Ok(false);
        }
        self.pool_mib = settings.pool_mib;
        self.pool_wait = 0.0;
        self.model = FanModel::of_asset(gpu, &self.asset, self.streamer.table(), settings.pool_bytes())?;
        self.streamer.set_atlas(self.model.shape());
        self.atlas_view = AtlasView::default();
        Ok(true)
    }

    fn list_damage(&mut self) {
        let count = self.streamer.statistics().damaged_pages;
        if count.min(LISTED_DAMAGE) != self.damaged.len() {
            let listed = self.streamer.damaged().take(LISTED_DAMAGE);
            self.damaged = listed
                .map(|(page, error)| DamagedPage { page: page.to_string(), reason: error.to_string() })
                .collect();
        }
    }

    pub(super) fn figures(&self) -> StreamFigures {
        let now = self.streamer.statistics();
        let shape = self.model.shape();
        let pool_bytes = self.model.texel_bytes();
        let bytes_per_texel = pool_bytes as f64 / shape.texels().max(1) as f64;
        let levels = self.level_pages.iter().zip(&now.resident_by_level);
        StreamFigures {
            levels: levels.map(|(&pages, now)| LevelFigures { resident: now.pages, pages }).collect(),
            pool_bytes,
            used_bytes: (now.resident.texels as f64 * bytes_per_texel) as u64,
            atlas: [shape.side, shape.side, shape.layers],
            bias: now.bias_levels,
            missing: now.missing_pages,
            wanted: now.needed.pages,
            queue: now.requested_pages as u64,
            uploaded_bytes: now.uploaded_bytes,
            uploaded_pages: self.uploaded_pages,
            evicted_pages: now.evictions,
            damaged: self.damaged.clone(),
            damaged_count: now.damaged_pages as u64,
        }
    }

    /// Whether the picture stays as it is until the view changes.
    pub(super) fn is_settled(&self) -> bool {
        self.streamer.is_settled()
            && self.pool_wait == 0.0
            && self.painted.as_ref().is_none_or(PaintedPages::is_settled)
    }

    /// Whether the atlas has changed since its picture was made.
    pub(super) fn is_atlas_stale(&self) -> bool {
        self.atlas_view.is_stale()
    }

    pub(super) fn atlas(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        channel: usize,
        seconds: f64,
    ) -> Option<AtlasPicture<'_>> {
        let channels = self.asset.channels();
        let is_srgb = channels.get(channel).is_some_and(|channel| channel.srgb);
        let texture = self.model.atlas_texture(channel)?;
        self.atlas_view.update(gpu, encoder, texture, is_srgb, channel, seconds);
        self.atlas_view.picture()
    }
}

/// Pages per detail level, the finest first.
fn level_pages(cover: &Cover) -> Vec<u64> {
    let mut pages = vec![0; cover_level_count(cover) as usize];
    for group in &cover.groups {
        for level in 0..group.level_count() {
            let [columns, rows] = page_grid(group.level_extent(level));
            pages[level as usize] += u64::from(columns) * u64::from(rows);
        }
    }
    pages
}
