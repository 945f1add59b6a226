//! A world on the GPU, as the viewer needs it: a [`StreamedWorld`] that follows the settings, with figures for the panels.

use std::sync::Arc;

use fantex::base::Result;
use fantex::gpu::Gpu;
use fantex::scene::Camera;
use fantex::stream::FrameOptions;
use fantex::{StreamedWorld, WorldOptions};

use crate::display::DisplaySettings;
use crate::document::WorldContent;
use crate::figures::{LISTED_DAMAGE, ObjectFigures, StreamFigures};
use crate::settings::StreamingSettings;
use crate::viewer::Viewer;

/// A world, streamed.
#[derive(Debug)]
pub struct WorldScene {
    pub(super) world: StreamedWorld,
    /// How often what could not be read was read again.
    retries: u64,
}

impl WorldScene {
    /// Nothing of it is there.
    pub(super) fn new(content: &WorldContent, settings: StreamingSettings) -> Result<Self> {
        let options = options(settings, &DisplaySettings::default());
        let world = StreamedWorld::new(&content.index, Arc::clone(&content.world), options)?;
        Ok(Self { world, retries: 0 })
    }

    /// Lets objects come and go for a frame. Returns whether something has changed that may be seen.
    pub(super) fn stream(
        &mut self,
        gpu: &Arc<Gpu>,
        viewer: &Viewer,
        (camera, size): (&Camera, [u32; 2]),
        frame: FrameOptions,
    ) -> Result<bool> {
        if !viewer.settings.streaming.is_running {
            return Ok(false);
        }
        self.world.set_options(options(viewer.settings.streaming, &viewer.settings.display));
        if std::mem::replace(&mut self.retries, viewer.retries) != viewer.retries {
            self.world.retry();
        }
        self.world.advance(gpu, camera, size, frame)
    }

    pub(super) fn figures(&self) -> StreamFigures {
        let [pool_bytes, used_bytes] = self.world.texel_bytes();
        let now = self.world.statistics();
        let [uploaded_bytes, uploaded_parcels] = now.uploaded;
        let mut figures = StreamFigures {
            pool_bytes,
            used_bytes,
            uploaded_bytes,
            uploaded_parcels,
            ..StreamFigures::default()
        };
        for streamer in self.world.streamers() {
            figures.bias = figures.bias.max(streamer.bias_levels);
            figures.missing += streamer.missing;
            figures.wanted += streamer.needed.parcels;
            figures.queue += streamer.requested as u64;
            figures.evicted_parcels += streamer.evictions;
            figures.damaged_count += streamer.damaged as u64;
        }
        figures.objects = Some(ObjectFigures {
            whole: now.whole as u64,
            previews: now.previews as u64,
            coarse: now.coarse as u64,
            missing: now.missing as u64,
            triangles: now.triangles,
            geometry_bytes: now.geometry_bytes,
            failed: now.failed.iter().take(LISTED_DAMAGE).cloned().collect(),
        });
        figures
    }

    /// Whether something that could not be read will be asked for again.
    pub(super) fn will_retry(&self) -> bool {
        self.world.will_retry()
    }

    pub(super) fn is_settled(&self) -> bool {
        self.world.is_settled()
    }
}

fn options(streaming: StreamingSettings, display: &DisplaySettings) -> WorldOptions {
    WorldOptions {
        pool_bytes: streaming.pool_bytes(),
        geometry_bytes: streaming.geometry_bytes(),
        filter: display.filter(),
    }
}
