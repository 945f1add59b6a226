//! The scene on the GPU: the document's model, pictures of it, and what streaming does between them.
//!
//! ```text
//!  Document --PrepareScene (in the background)--> SceneModel: UvModel | streamed fan model
//!  Viewer --draw--> picture in a texture, which egui shows         (one at a time, see `pacing`)
//!         --capture--> picture in main memory, then a PNG file     (never waits)
//! ```

mod atlas_view;
mod capture;
mod fan;
mod model;
mod painted;
mod picture;

use std::path::PathBuf;
use std::sync::Arc;

use fantex_gpu::{DrawOptions, Frame, Gpu, GpuError, Overlay as DrawnOverlay, Renderer, WireframeOptions};
use fantex_scene::{Camera, Lights, Shading};

use crate::display::{Overlay, ShadingView};
use crate::figures::StreamFigures;
use crate::pacing::Draw;
use crate::paint::Painting;
use crate::viewer::Viewer;
use eframe::wgpu;

pub use atlas_view::AtlasPicture;
pub use capture::{CaptureError, Captured, Capturing};
pub use fan::FanScene;
pub use model::{PrepareScene, SceneModel, preparer};
use picture::Picture;

/// Encoded as screens want it: egui takes such texels as they are.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Draws the viewer's document.
pub struct SceneView {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    /// A renderer of its own, so that its targets may have another size than those of the window.
    capturer: Option<Renderer>,
    model: Option<SceneModel>,
    picture: Option<Picture>,
    captures: Vec<Capturing>,
    last_stream_seconds: Option<f64>,
}

impl SceneView {
    /// Draws with a GPU.
    pub fn new(gpu: Arc<Gpu>) -> Self {
        Self {
            renderer: Renderer::new(&gpu, FORMAT),
            gpu,
            capturer: None,
            model: None,
            picture: None,
            captures: Vec::new(),
            last_stream_seconds: None,
        }
    }

    /// The GPU.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Shows another document, or none.
    pub fn set_model(&mut self, model: Option<SceneModel>) {
        self.model = model;
        self.picture = None;
        self.last_stream_seconds = None;
    }

    /// Lets streaming go on, and draws a picture where one is due. Returns whether one was begun.
    ///
    /// # Errors
    ///
    /// One of the renderer's.
    pub fn update(&mut self, viewer: &mut Viewer, seconds: f64) -> Result<bool, GpuError> {
        self.finish_picture(viewer);
        self.gpu.check()?;
        let Some(model) = &mut self.model else { return Ok(false) };
        if viewer.scene_pixels.contains(&0) {
            return Ok(false);
        }
        let elapsed = seconds - self.last_stream_seconds.replace(seconds).unwrap_or(seconds);
        let has_arrived = model.stream(&self.gpu, viewer, elapsed as f32)?;
        if has_arrived {
            // A stroke wants quick pictures, as a camera that moves.
            match viewer.painting.as_ref().is_some_and(Painting::is_drawing) {
                true => viewer.pacing.moved(seconds),
                false => viewer.pacing.changed(),
            }
        }
        if let Some(figures) = model.figures() {
            viewer.graphs.stream(seconds, &figures);
            viewer.figures = figures;
        } else {
            viewer.figures = StreamFigures::default();
        }
        let Draw::Scaled(scale) = viewer.pacing.next(seconds, viewer.settings.display.is_adaptive) else {
            return Ok(false);
        };
        let size = scaled(viewer.scene_pixels, scale, self.gpu.limits().max_texture_dimension_2d);
        let picture = match self.picture.take() {
            Some(picture) if picture.size() == size => picture,
            _ => Picture::new(&self.gpu, size),
        };
        let picture = self.picture.insert(picture);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let seen = Seen::of(viewer);
        self.renderer.draw(&self.gpu, &mut encoder, picture.view(), &mut seen.frame(size, model))?;
        self.gpu.queue.submit([encoder.finish()]);
        picture.submitted(&self.gpu);
        Ok(true)
    }

    fn finish_picture(&mut self, viewer: &mut Viewer) {
        // Its callbacks are run here; that it may time out means nothing when it does not wait.
        self.gpu.device.poll(wgpu::PollType::Poll).ok();
        if let Some(took) = self.picture.as_mut().and_then(Picture::take_seconds) {
            viewer.pacing.drawn(took);
            viewer.graphs.picture(took);
        }
    }

    /// Forgets a picture that an error has cut short.
    pub fn abandon_picture(&mut self, viewer: &mut Viewer) {
        self.picture = None;
        viewer.pacing.lost();
    }

    /// The texture that shows the scene, and whether it is another one than at the last call.
    pub fn shown(&mut self) -> Option<(&wgpu::TextureView, bool)> {
        self.picture.as_mut().map(Picture::shown)
    }

    /// The atlas as a picture, where there is an atlas.
    pub fn atlas(&mut self, channel: usize, seconds: f64) -> Option<AtlasPicture<'_>> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let picture = self.model.as_mut()?.atlas(&self.gpu, &mut encoder, channel, seconds);
        self.gpu.queue.submit([encoder.finish()]);
        picture
    }

    /// Whether [`SceneView::atlas`] would give another picture a little later.
    pub fn is_atlas_stale(&self) -> bool {
        self.model.as_ref().is_some_and(SceneModel::is_atlas_stale)
    }

    /// Begins a picture of `size` pixels for a file; see [`SceneView::poll_captures`].
    ///
    /// # Errors
    ///
    /// [`CaptureError`], where it is too large or cannot be drawn.
    pub fn capture(&mut self, viewer: &Viewer, size: [u32; 2], path: PathBuf) -> Result<(), CaptureError> {
        let Some(model) = &mut self.model else { return Err(CaptureError::NothingOpen) };
        let capturing = Capturing::target(&self.gpu, size, path)?;
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let renderer = self.capturer.get_or_insert_with(|| Renderer::new(&self.gpu, FORMAT));
        let seen = Seen::of(viewer);
        renderer.draw(&self.gpu, &mut encoder, capturing.view(), &mut seen.frame(size, model))?;
        self.captures.push(capturing.submit(&self.gpu, encoder));
        Ok(())
    }

    /// Pictures that are ready, as soon as they are.
    pub fn poll_captures(&mut self) -> Vec<Captured> {
        let (ready, pending) = std::mem::take(&mut self.captures).into_iter().partition(Capturing::is_ready);
        self.captures = pending;
        if self.captures.is_empty() {
            // Its targets may be far larger than the window.
            self.capturer = None;
        }
        let ready: Vec<Capturing> = ready;
        ready.into_iter().map(Capturing::finish).collect()
    }

    /// Gives up pictures for files that are under way: one error for each.
    pub fn abandon_captures(&mut self) -> Vec<CaptureError> {
        self.captures.drain(..).map(Capturing::into_lost).collect()
    }

    /// Pictures for files that are under way.
    pub fn captures_due(&self) -> usize {
        self.captures.len()
    }

    /// Whether streaming has nothing to do until the view changes: everything that is seen has the level that it can have.
    pub fn is_settled(&self) -> bool {
        self.model.as_ref().is_none_or(SceneModel::is_settled)
    }
}

/// Sides of a picture that is shown at another scale.
fn scaled(size: [u32; 2], scale: f32, most: u32) -> [u32; 2] {
    size.map(|n| ((n as f32 * scale).round() as u32).clamp(1, most))
}

/// What a picture shows, besides the model.
struct Seen {
    camera: Camera,
    lights: Lights,
    options: DrawOptions,
}

impl Seen {
    fn of(viewer: &Viewer) -> Self {
        let display = &viewer.settings.display;
        let is_asset = viewer.document.as_ref().is_some_and(|document| document.asset().is_some());
        let options = DrawOptions {
            shading: shading(display.shading),
            filter: display.filter(),
            background: viewer.background(),
            exposure: display.exposure(),
            tone_map: Some(display.tone.tone_map()),
            samples: display.samples,
            wireframe: display.has_wireframe.then(WireframeOptions::default),
            overlay: if is_asset { overlay(display.overlay) } else { DrawnOverlay::None },
            seconds: 0.0,
        };
        Self { camera: viewer.camera(), lights: viewer.lights(), options }
    }

    fn frame<'a>(&'a self, size: [u32; 2], model: &'a mut SceneModel) -> Frame<'a> {
        Frame {
            size,
            camera: &self.camera,
            lights: &self.lights,
            model: model.drawn(),
            options: &self.options,
        }
    }
}

fn shading(view: ShadingView) -> Shading {
    match view {
        ShadingView::Lit => Shading::MetallicRoughness,
        ShadingView::BaseColor => Shading::BaseColor,
        ShadingView::Normal => Shading::Normal,
        ShadingView::OcclusionRoughnessMetallic => Shading::OcclusionRoughnessMetallic,
        ShadingView::Emission => Shading::Emission,
    }
}

fn overlay(overlay: Overlay) -> DrawnOverlay {
    match overlay {
        Overlay::None => DrawnOverlay::None,
        Overlay::Fans => DrawnOverlay::Fans,
        Overlay::Groups => DrawnOverlay::Groups,
        Overlay::Levels => DrawnOverlay::Levels,
        Overlay::Residency => DrawnOverlay::Residency,
        Overlay::BlendBands => DrawnOverlay::BlendBands,
    }
}
