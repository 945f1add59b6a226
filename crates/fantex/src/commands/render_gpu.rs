//! `fantex render --gpu`: the same picture, drawn by the graphics card.

use std::time::{Duration, Instant};

use fantex::gpu::{
    DrawOptions, Frame, Gpu, GpuOptions, Model, StreamedModel, UvModel, render_to_picture, stream_view,
};
use fantex::render::{Camera, Lights, Picture, RenderOptions};
use fantex::scene::FilterOptions;

use crate::context::Context;
use crate::error::CliError;
use crate::scene::Scene;

/// The longest that tiles are waited for.
const PATIENCE: Duration = Duration::from_secs(600);

/// What was drawn, and on what.
pub(super) struct GpuRendering {
    pub(super) picture: Picture,
    /// The adapter's name.
    pub(super) adapter: String,
    /// Drawing and reading back, without loading.
    pub(super) elapsed: Duration,
}

/// Draws a model with its own textures, or an asset through an atlas of at most `pool_bytes`.
pub(super) fn render(
    scene: &Scene,
    camera: &Camera,
    lights: &Lights,
    options: &RenderOptions,
    filter: FilterOptions,
    pool_bytes: u64,
    context: &Context,
) -> Result<GpuRendering, CliError> {
    let gpu = Gpu::headless(&GpuOptions::default())?;
    let size = [options.width, options.height];
    let draw = DrawOptions {
        shading: options.shading,
        filter,
        background: options.background,
        exposure: options.exposure,
        // Whoever saves the picture brings it into its range.
        tone_map: None,
        samples: options.samples,
        ..DrawOptions::default()
    };
    let picture_of = |model: &mut dyn Model| {
        let started = Instant::now();
        let mut frame = Frame { size, camera, lights, model, options: &draw };
        let picture = render_to_picture(&gpu, &mut frame)?;
        let adapter = gpu.info().name.clone();
        Ok(GpuRendering { picture, adapter, elapsed: started.elapsed() })
    };
    let Some(asset) = scene.asset() else {
        return picture_of(&mut UvModel::load(&gpu, scene.mesh())?);
    };
    let mut streamed = StreamedModel::open(&gpu, asset.clone(), pool_bytes)?;
    let view = stream_view(camera, size, streamed.model.space());
    let is_sharp = streamed.wait_until_sharp(&gpu, &view, &filter, PATIENCE)?;
    let figures = streamed.streamer.statistics();
    if figures.bias_levels > 0.0 {
        context.note(format!(
            "the view does not fit into the pool: tiles are up to {:.1} levels coarser than they should be; give it more \
             memory by --pool",
            figures.bias_levels
        ));
    } else if !is_sharp {
        context.note(format!("tiles were still missing after {} s", PATIENCE.as_secs()));
    }
    for (parcel, error) in streamed.streamer.damaged().take(4) {
        context.note(format!("{parcel} cannot be read, a coarser level takes its place: {error}"));
    }
    picture_of(&mut streamed.model)
}
