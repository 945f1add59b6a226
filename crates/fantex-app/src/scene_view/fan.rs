//! An asset on the GPU, as the viewer needs it: a [`StreamedModel`] that follows the settings, with figures for the panels and
//! what was painted since.

use std::collections::HashMap;
use std::sync::Arc;

use eframe::wgpu;
use fantex::base::Result;
use fantex::cover::Cover;
use fantex::glam::Vec2;
use fantex::gpu::{FanModel, Gpu, Model as _, StreamedModel, stream_view};
use fantex::mesh::Mesh;
use fantex::scene::Camera;
use fantex::store::{Asset, PageId, cover_level_count};
use fantex::stream::{
    FrameChanges, FrameOptions, Geometry, ParcelLoader, ParcelUpload, Streamer, TableEntry,
};

use crate::figures::{DamagedPart, LISTED_DAMAGE, LevelFigures, StreamFigures};
use crate::paint::{Exchange, PaintLoader};
use crate::scene_view::ShareDone;
use crate::scene_view::atlas_view::{AtlasPicture, AtlasView};
use crate::settings::StreamingSettings;
use crate::viewer::Viewer;

/// Seconds for which another size of the pool must have been asked for before it is made.
const POOL_SECONDS: f32 = 0.4;

/// An asset, streamed.
pub struct FanScene {
    asset: Arc<Asset>,
    streamed: StreamedModel,
    /// Memory for texels that the atlas was made for.
    pool_mib: u32,
    /// How long another size has been asked for.
    pool_wait: f32,
    /// That the streamer was told; 0 for none.
    anisotropy: u32,
    /// Texels per level of the whole cover.
    level_texels: Vec<u64>,
    uploaded_parcels: u64,
    damaged: Vec<DamagedPart>,
    /// How often it was read again.
    retries: u64,
    atlas_view: AtlasView,
    painted: Option<PaintedPages>,
}

impl std::fmt::Debug for FanScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FanScene").field("asset", &self.asset.path()).finish_non_exhaustive()
    }
}

impl FanScene {
    /// Everything but the texels, which come by and by.
    pub(super) fn new(
        gpu: &Gpu,
        asset: Arc<Asset>,
        settings: StreamingSettings,
        exchange: Option<Arc<Exchange>>,
        progress: ShareDone<'_>,
    ) -> Result<Self> {
        let loader = Box::new(StreamedModel::loader(gpu, &asset)?);
        let (geometry, loader): (Arc<dyn Geometry>, Box<dyn ParcelLoader>) = match &exchange {
            None => (asset.clone(), loader),
            Some(exchange) => {
                exchange.set_formats(&FanModel::atlas_formats(gpu, asset.channels()));
                // Older states of what is painted on must not be kept.
                let geometry = PaintedGeometry { mesh: asset.shared_mesh(), cover: asset.shared_cover() };
                (Arc::new(geometry), Box::new(PaintLoader::new(loader, exchange.clone())))
            }
        };
        let bytes = settings.pool_bytes();
        let streamed =
            StreamedModel::with_pages_and_progress(gpu, &asset, geometry, loader, bytes, progress)?;
        Ok(Self {
            level_texels: level_texels(asset.cover()),
            asset,
            streamed,
            pool_mib: settings.pool_mib,
            pool_wait: 0.0,
            anisotropy: 0,
            uploaded_parcels: 0,
            damaged: Vec::new(),
            retries: 0,
            atlas_view: AtlasView::default(),
            painted: exchange.map(|exchange| PaintedPages { exchange, entries: HashMap::new() }),
        })
    }

    pub(super) fn model(&mut self) -> &mut FanModel {
        &mut self.streamed.model
    }

    /// Lets streaming go on for a frame. Returns whether something has changed that may be seen.
    pub(super) fn stream(
        &mut self,
        gpu: &Gpu,
        viewer: &Viewer,
        (camera, size): (&Camera, [u32; 2]),
        frame: FrameOptions,
    ) -> Result<bool> {
        if !viewer.settings.streaming.is_running {
            return Ok(self.upload_painted(gpu));
        }
        self.follow_settings(gpu, viewer, frame.elapsed_seconds)?;
        if std::mem::replace(&mut self.retries, viewer.retries) != viewer.retries {
            self.streamed.streamer.retry_damaged();
        }
        let view = stream_view(camera, size, self.streamed.model.space());
        let was_hidden = self.streamed.model.has_hidden_atlas();
        let changes = self.streamed.advance(gpu, Some(&view), frame);
        let is_new = was_hidden && !self.streamed.model.has_hidden_atlas();
        if let Some(painted) = &mut self.painted {
            painted.follow(&changes);
        }
        let is_painted = self.upload_painted(gpu);
        self.uploaded_parcels += changes.uploads.len() as u64;
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
        if let Some(asset) = painted.exchange.take_asset() {
            self.asset = asset;
        }
        let (changes, stale) = painted.take(&self.streamed.streamer, self.asset.cover());
        if !stale.is_empty() {
            self.streamed.streamer.invalidate(&stale);
        }
        if changes.uploads.is_empty() {
            return false;
        }
        self.streamed.model.update(gpu, &changes);
        self.atlas_view.changed();
        true
    }

    /// Takes over another size of the pool once it is no longer being changed, and another filter.
    fn follow_settings(&mut self, gpu: &Gpu, viewer: &Viewer, elapsed_seconds: f32) -> Result<()> {
        let anisotropy = viewer.settings.display.anisotropy;
        if anisotropy != self.anisotropy {
            self.anisotropy = anisotropy;
            self.streamed.streamer.set_max_anisotropy(anisotropy as f32);
        }
        let settings = viewer.settings.streaming;
        if settings.pool_mib == self.pool_mib {
            self.pool_wait = 0.0;
            return Ok(());
        }
        self.pool_wait += elapsed_seconds.clamp(0.001, 0.1);
        if self.pool_wait < POOL_SECONDS {
            return Ok(());
        }
        self.pool_mib = settings.pool_mib;
        self.pool_wait = 0.0;
        self.streamed.set_budget(gpu, settings.pool_bytes())?;
        self.atlas_view.changed();
        Ok(())
    }

    fn list_damage(&mut self) {
        let count = self.streamed.streamer.statistics().damaged;
        if count.min(LISTED_DAMAGE) != self.damaged.len() {
            let listed = self.streamed.streamer.damaged().take(LISTED_DAMAGE);
            self.damaged = listed
                .map(|(parcel, error)| DamagedPart { part: parcel.to_string(), reason: error.to_string() })
                .collect();
        }
    }

    pub(super) fn figures(&self) -> StreamFigures {
        let now = self.streamed.streamer.statistics();
        let shape = self.streamed.model.shape();
        let pool_bytes = self.streamed.model.texel_bytes();
        let bytes_per_texel = pool_bytes as f64 / shape.texels().max(1) as f64;
        let levels = self.level_texels.iter().zip(&now.resident_texels_by_level);
        StreamFigures {
            levels: levels.map(|(&texels, &resident)| LevelFigures { resident, texels }).collect(),
            pool_bytes,
            used_bytes: (now.resident.texels as f64 * bytes_per_texel) as u64,
            atlas: [shape.side, shape.side, shape.layers],
            bias: now.bias_levels,
            missing: now.missing,
            wanted: now.needed.parcels,
            queue: now.requested as u64,
            uploaded_bytes: now.uploaded_bytes,
            uploaded_parcels: self.uploaded_parcels,
            evicted_parcels: now.evictions,
            damaged: self.damaged.clone(),
            damaged_count: now.damaged as u64,
            objects: None,
        }
    }

    /// The finest level from `level` on that a group has at a place of its tile, 0..1 along the sides; none where that is its mean.
    pub(super) fn drawn_level(&self, group: u32, level: u32, uv: Vec2) -> Option<u32> {
        self.streamed.streamer.drawn_level(group, level, uv)
    }

    /// Whether something that could not be read will be asked for again.
    pub(super) fn will_retry(&self) -> bool {
        self.streamed.streamer.statistics().recoverable > 0
    }

    /// Whether the picture stays as it is until the view changes.
    pub(super) fn is_settled(&self) -> bool {
        self.streamed.streamer.is_settled()
            && !self.streamed.model.has_hidden_atlas()
            && self.pool_wait == 0.0
            && self.painted.as_ref().is_none_or(|painted| painted.exchange.is_empty())
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
        // The last model may have had more channels.
        let channel = channel.min(self.asset.channels().len().saturating_sub(1));
        self.atlas_view.update(gpu, encoder, &self.streamed.model, channel, seconds);
        self.atlas_view.picture()
    }
}

/// Texels per detail level, the finest first.
fn level_texels(cover: &Cover) -> Vec<u64> {
    let mut texels = vec![0; cover_level_count(cover) as usize];
    for group in &cover.groups {
        for level in 0..group.level_count() {
            let [columns, rows] = group.level_extent(level);
            texels[level as usize] += u64::from(columns) * u64::from(rows);
        }
    }
    texels
}

/// Mesh and cover of an asset whose texels change.
struct PaintedGeometry {
    mesh: Arc<Mesh>,
    cover: Arc<Cover>,
}

impl Geometry for PaintedGeometry {
    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn cover(&self) -> &Cover {
        &self.cover
    }
}

/// Knows where resident pages lie, and brings what was painted there.
#[derive(Debug)]
struct PaintedPages {
    exchange: Arc<Exchange>,
    /// Entries of the page table that are not absent.
    entries: HashMap<u32, TableEntry>,
}

impl PaintedPages {
    /// Takes over what the streamer has done.
    fn follow(&mut self, changes: &FrameChanges) {
        for change in &changes.entries {
            if change.entry == TableEntry::ABSENT {
                self.entries.remove(&change.index);
            } else {
                self.entries.insert(change.index, change.entry);
            }
        }
    }

    /// What was painted since the last call: uploads of resident pages, and pages whose texels have to be asked for.
    fn take(&mut self, streamer: &Streamer, cover: &Cover) -> (FrameChanges, Vec<PageId>) {
        let (fresh, mut stale) = self.exchange.take_fresh();
        let mut changes = FrameChanges::default();
        for (page, mut texels) in fresh {
            let entry = self.entries.get(&streamer.table().index(cover, page));
            match entry.and_then(|entry| entry.place()) {
                Some(place) => {
                    texels.outline = streamer.outline(page);
                    changes.uploads.push(ParcelUpload { parcel: page.into(), place, texels });
                }
                // It may be on its way, as it was.
                None => stale.push(page),
            }
        }
        (changes, stale)
    }
}
