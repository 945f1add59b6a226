//! The scene on the GPU: the document's model, pictures of it, and what streaming does between them.
//!
//! ```text
//!  Document --PrepareScene (in the background)--> SceneModel: UvModel | streamed fan model | streamed world
//!  Viewer --draw--> picture in a texture, which egui shows         (one at a time, see `pacing`)
//!         --capture--> picture in main memory, then a PNG file     (never waits)
//! ```

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

pub use atlas_view::AtlasPicture;
pub(crate) use capture::lost_picture;
pub use capture::{Captured, Capturing};
use eframe::wgpu;
pub use fan::FanScene;
use fantex::base::{Error, Result};
use fantex::gpu::{
    DrawOptions, Frame, Gpu, Model, Overlay as DrawnOverlay, Renderer, UvModel, WireframeOptions,
};
use fantex::scene::{Camera, Lights, Shading, ToneMap};
use fantex::stream::FrameOptions;
pub use world::WorldScene;

use crate::display::{Overlay, ShadingView};
use crate::document::{Content, Document};
use crate::figures::StreamFigures;
use crate::pacing::Draw;
use crate::paint::Painting;
use crate::settings::StreamingSettings;
use crate::viewer::Viewer;

mod atlas_view;
mod capture;
mod fan;
mod world;

/// The pace for which the upload budget of a frame is meant.
const QUICK_FRAMES_PER_SECOND: f32 = 60.0;

/// A slow frame takes no more than so many quick ones would.
const MAX_QUICK_FRAMES: f32 = 64.0;

/// Encoded as screens want it: egui takes such texels as they are.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

pub struct SceneView {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    /// A renderer of its own, so that its targets may have another size than those of the window.
    capturer: Option<Renderer>,
    model: Option<SceneModel>,
    picture: Option<Picture>,
    /// What the scene is compared with.
    kept: Option<Picture>,
    captures: Vec<Capturing>,
    /// In the order in which they were asked for.
    awaited: Vec<Awaited>,
    /// Those that could not be drawn, until that is told.
    failed: Vec<Captured>,
    last_stream_seconds: Option<f64>,
}

impl SceneView {
    pub fn new(gpu: Arc<Gpu>) -> Self {
        Self {
            renderer: Renderer::new(&gpu, FORMAT),
            gpu,
            capturer: None,
            model: None,
            picture: None,
            kept: None,
            captures: Vec::new(),
            awaited: Vec::new(),
            failed: Vec::new(),
            last_stream_seconds: None,
        }
    }

    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Shows another document, or none. Pictures for files that still wait are given up: one error for each.
    pub fn set_model(&mut self, model: Option<SceneModel>) -> Vec<Error> {
        self.model = model;
        self.picture = None;
        self.kept = None;
        self.last_stream_seconds = None;
        self.awaited.drain(..).map(|awaited| awaited.capturing.into_left()).collect()
    }

    /// Lets streaming go on, and draws a picture where one is due. Returns whether one was begun.
    ///
    /// # Errors
    /// One of the renderer's.
    pub fn update(&mut self, viewer: &mut Viewer) -> Result<bool> {
        let seconds = viewer.now();
        self.finish_picture(viewer);
        self.gpu.check()?;
        self.keep_picture(viewer);
        let Some(model) = &mut self.model else { return Ok(false) };
        if viewer.scene_pixels.contains(&0) {
            return Ok(false);
        }
        let elapsed = seconds - self.last_stream_seconds.replace(seconds).unwrap_or(seconds);
        // A picture for a file that waits is what is streamed for.
        let (camera, size) = match self.awaited.first() {
            Some(awaited) => (awaited.seen.camera, awaited.size),
            None => (viewer.camera(), viewer.scene_pixels),
        };
        let has_arrived = model.stream(&self.gpu, viewer, (&camera, size), elapsed as f32)?;
        self.capture_awaited(seconds);
        let Some(model) = &mut self.model else { return Ok(false) };
        if let Some(scene) = model.fan() {
            viewer.readout.follow(|group, level, uv| scene.drawn_level(group, level, uv));
        }
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
            Some(picture) if picture.size == size => picture,
            _ => Picture::new(&self.gpu, size),
        };
        let picture = self.picture.insert(picture);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let seen = Seen::of(viewer);
        self.renderer.draw(&self.gpu, &mut encoder, &picture.view, &mut seen.frame(size, model))?;
        self.gpu.queue.submit([encoder.finish()]);
        picture.submitted(&self.gpu);
        Ok(true)
    }

    /// Keeps the picture that is shown, where one is to be compared with.
    fn keep_picture(&mut self, viewer: &mut Viewer) {
        if viewer.kept.is_none() {
            self.kept = None;
        } else if self.kept.is_none() && self.picture.is_some() {
            self.kept = self.picture.take().map(|picture| Picture { is_new: true, ..picture });
            viewer.pacing.lost();
        }
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

    /// The kept picture, likewise.
    pub fn kept(&mut self) -> Option<(&wgpu::TextureView, bool)> {
        self.kept.as_mut().map(Picture::shown)
    }

    /// The atlas as a picture, where there is an atlas.
    pub fn atlas(&mut self, channel: usize, seconds: f64) -> Option<AtlasPicture<'_>> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let picture = self.model.as_mut()?.fan_mut()?.atlas(&self.gpu, &mut encoder, channel, seconds);
        self.gpu.queue.submit([encoder.finish()]);
        picture
    }

    /// Whether [`SceneView::atlas`] would give another picture a little later.
    pub fn is_atlas_stale(&self) -> bool {
        self.model.as_ref().and_then(SceneModel::fan).is_some_and(FanScene::is_atlas_stale)
    }

    /// Begins a picture of `size` pixels for a file, as it is seen now; see [`SceneView::poll_captures`]. Where it shows more
    /// than the screen, what it shows is loaded first.
    ///
    /// # Errors
    /// It is too large or cannot be drawn.
    pub fn capture(&mut self, viewer: &Viewer, size: [u32; 2], path: PathBuf) -> Result<()> {
        let Some(model) = &self.model else {
            let message = "there is nothing to take a picture of: open a model or an asset first";
            return Err(Error::invalid(message));
        };
        let capturing = Capturing::new(&self.gpu, size, path)?;
        let awaited = Awaited { capturing, seen: Seen::of(viewer), size, frames: 0, since: None };
        let is_streamed = model.is_streamed() && viewer.settings.streaming.is_running;
        if size == viewer.scene_pixels || viewer.scene_pixels.contains(&0) || !is_streamed {
            return self.draw_awaited(awaited);
        }
        self.awaited.push(awaited);
        Ok(())
    }

    /// Takes the first picture that waits, once what it shows is there.
    fn capture_awaited(&mut self, seconds: f64) {
        let is_settled = self.is_settled();
        let Some(first) = self.awaited.first_mut() else { return };
        first.frames += 1;
        let since = *first.since.get_or_insert(seconds);
        if (is_settled && first.frames >= AWAITED_FRAMES) || seconds - since > AWAITED_SECONDS {
            let awaited = self.awaited.remove(0);
            let path = awaited.capturing.path().to_owned();
            if let Err(error) = self.draw_awaited(awaited) {
                self.failed.push(Captured { path, image: Err(error) });
            }
        }
    }

    fn draw_awaited(&mut self, awaited: Awaited) -> Result<()> {
        let Awaited { capturing, seen, size, .. } = awaited;
        let Some(model) = &mut self.model else { return Ok(()) };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let renderer = self.capturer.get_or_insert_with(|| Renderer::new(&self.gpu, FORMAT));
        renderer.draw(&self.gpu, &mut encoder, &capturing.view(), &mut seen.frame(size, model))?;
        self.captures.push(capturing.submit(&self.gpu, encoder));
        Ok(())
    }

    /// Pictures that are ready, as soon as they are, and those that could not be drawn.
    pub fn poll_captures(&mut self) -> Vec<Captured> {
        let (ready, pending) = std::mem::take(&mut self.captures).into_iter().partition(Capturing::is_ready);
        self.captures = pending;
        if self.captures.is_empty() {
            // Its targets may be far larger than the window.
            self.capturer = None;
        }
        let ready: Vec<Capturing> = ready;
        self.failed.drain(..).chain(ready.into_iter().map(Capturing::finish)).collect()
    }

    /// Gives up pictures for files that are under way: one error for each.
    pub fn abandon_captures(&mut self) -> Vec<Error> {
        let awaited = self.awaited.drain(..).map(|awaited| awaited.capturing);
        let lost = self.captures.drain(..).chain(awaited).map(Capturing::into_lost);
        self.failed.drain(..).filter_map(|failed| failed.image.err()).chain(lost).collect()
    }

    /// Pictures for files that are under way.
    pub fn captures_due(&self) -> usize {
        self.captures.len() + self.awaited.len() + self.failed.len()
    }

    /// Whether streaming has nothing to do until the view changes: everything that is seen has the level that it can have.
    pub fn is_settled(&self) -> bool {
        self.model.as_ref().is_none_or(SceneModel::is_settled)
    }

    /// Whether something that could not be read will be asked for again, if frames are drawn.
    pub fn will_retry(&self) -> bool {
        self.model.as_ref().is_some_and(SceneModel::will_retry)
    }
}

/// Sides of a picture that is shown at another scale.
fn scaled(size: [u32; 2], scale: f32, most: u32) -> [u32; 2] {
    size.map(|n| ((n as f32 * scale).round() as u32).clamp(1, most))
}

/// Frames after which it is known what a picture of another size lacks.
const AWAITED_FRAMES: u32 = 3;

/// Seconds after which such a picture is taken with what is there.
const AWAITED_SECONDS: f64 = 30.0;

/// A picture for a file that waits for what it shows.
struct Awaited {
    capturing: Capturing,
    seen: Seen,
    size: [u32; 2],
    frames: u32,
    /// When it became the first one, seconds.
    since: Option<f64>,
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
        let is_streamed = viewer.document.as_ref().is_some_and(Document::is_streamed);
        let options = DrawOptions {
            shading: shading(display.shading),
            filter: display.filter(),
            background: viewer.background(),
            exposure: display.exposure(),
            // Values of channels are shown as they are.
            tone_map: Some(if display.shading == ShadingView::Lit { display.tone } else { ToneMap::Clip }),
            samples: display.samples,
            wireframe: display.has_wireframe.then(WireframeOptions::default),
            overlay: if is_streamed { overlay(display.overlay) } else { DrawnOverlay::None },
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

/// Is told the share of something that is done, 0..1, from any thread.
pub type ShareDone<'a> = &'a (dyn Fn(f32) + Sync);

/// Brings a document to the graphics memory; takes long, so on the thread that opens it.
pub type PrepareScene =
    Arc<dyn Fn(&Document, StreamingSettings, ShareDone<'_>) -> Result<SceneModel> + Send + Sync>;

#[derive(Debug)]
pub enum SceneModel {
    /// A model with its own textures.
    Uv(Box<UvModel>),
    /// An asset, streamed.
    Fan(Box<FanScene>),
    /// Many of them.
    World(Box<WorldScene>),
}

pub fn preparer(gpu: Arc<Gpu>) -> PrepareScene {
    Arc::new(move |document, settings, progress| match &document.content {
        Content::Model(mesh) => {
            Ok(SceneModel::Uv(Box::new(UvModel::load_with_progress(&gpu, mesh, progress)?)))
        }
        Content::Asset(asset) => {
            let exchange = document.exchange.clone();
            let scene = FanScene::new(&gpu, asset.clone(), settings, exchange, progress)?;
            Ok(SceneModel::Fan(Box::new(scene)))
        }
        Content::World(content) => Ok(SceneModel::World(Box::new(WorldScene::new(content, settings)?))),
    })
}

impl SceneModel {
    /// What whoever looks at it should know, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        match self {
            Self::Uv(model) => model.left_out().notes(),
            Self::Fan(_) | Self::World(_) => Vec::new(),
        }
    }

    fn drawn(&mut self) -> &mut dyn Model {
        match self {
            Self::Uv(model) => &mut **model,
            Self::Fan(scene) => scene.model(),
            Self::World(scene) => &mut scene.world,
        }
    }

    fn is_streamed(&self) -> bool {
        !matches!(self, Self::Uv(_))
    }

    /// Lets streaming go on for a frame. Returns whether something has changed that may be seen.
    fn stream(
        &mut self,
        gpu: &Arc<Gpu>,
        viewer: &Viewer,
        seen: (&Camera, [u32; 2]),
        elapsed_seconds: f32,
    ) -> Result<bool> {
        // The budget is meant for quick frames; slow ones take as much per second.
        let frames = (elapsed_seconds * QUICK_FRAMES_PER_SECOND).clamp(1.0, MAX_QUICK_FRAMES);
        let upload_bytes = (viewer.settings.streaming.upload_bytes() as f32 * frames) as usize;
        let frame = FrameOptions { upload_bytes, elapsed_seconds };
        match self {
            Self::Uv(_) => Ok(false),
            Self::Fan(scene) => scene.stream(gpu, viewer, seen, frame),
            Self::World(scene) => scene.stream(gpu, viewer, seen, frame),
        }
    }

    fn figures(&self) -> Option<StreamFigures> {
        match self {
            Self::Uv(_) => None,
            Self::Fan(scene) => Some(scene.figures()),
            Self::World(scene) => Some(scene.figures()),
        }
    }

    /// Whether the picture stays as it is until the view changes.
    fn is_settled(&self) -> bool {
        match self {
            Self::Uv(_) => true,
            Self::Fan(scene) => scene.is_settled(),
            Self::World(scene) => scene.is_settled(),
        }
    }

    fn will_retry(&self) -> bool {
        match self {
            Self::Uv(_) => false,
            Self::Fan(scene) => scene.will_retry(),
            Self::World(scene) => scene.will_retry(),
        }
    }

    fn fan(&self) -> Option<&FanScene> {
        if let Self::Fan(scene) = self { Some(scene) } else { None }
    }

    fn fan_mut(&mut self) -> Option<&mut FanScene> {
        if let Self::Fan(scene) = self { Some(scene) } else { None }
    }
}

/// A texture of the screen's format to draw into.
fn target(gpu: &Gpu, label: &str, [width, height]: [u32; 2], usage: wgpu::TextureUsages) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
        view_formats: &[],
    })
}

/// A texture to draw into and to show.
#[derive(Debug)]
struct Picture {
    size: [u32; 2],
    view: wgpu::TextureView,
    is_new: bool,
    /// Nanoseconds from submission to completion; zero while unknown.
    took: Arc<AtomicU64>,
}

impl Picture {
    fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let texture = target(gpu, "scene", size, wgpu::TextureUsages::TEXTURE_BINDING);
        let view = texture.create_view(&Default::default());
        Self { size, view, is_new: true, took: Arc::default() }
    }

    /// The view, and whether it is shown for the first time.
    fn shown(&mut self) -> (&wgpu::TextureView, bool) {
        let is_new = std::mem::take(&mut self.is_new);
        (&self.view, is_new)
    }

    /// What draws it was submitted just now: the time starts.
    fn submitted(&mut self, gpu: &Gpu) {
        let started = Instant::now();
        let took = Arc::new(AtomicU64::new(0));
        self.took = took.clone();
        gpu.queue.on_submitted_work_done(move || {
            took.store((started.elapsed().as_nanos() as u64).max(1), Relaxed);
        });
    }

    /// How long it took, once, as soon as it is known.
    fn take_seconds(&mut self) -> Option<f64> {
        match self.took.swap(0, Relaxed) {
            0 => None,
            nanoseconds => Some(nanoseconds as f64 * 1e-9),
        }
    }
}
