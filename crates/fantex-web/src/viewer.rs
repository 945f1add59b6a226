//! What a page holds: a canvas with an asset or a world in it.
//!
//! ```text
//!  header --> preview, if there is one --> drawn, while mesh, cover and directory are fetched --> the asset in its place
//!         `-> the asset
//!  index of a world --> its objects and their previews, as the view needs them (fantex_gpu::StreamedWorld)
//! ```
//!
//! While these are fetched, the device is opened, and what the first picture is drawn with is compiled.

use std::cell::RefCell;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::Poll;
use std::time::Duration;

use fantex_base::Aabb;
use fantex_gpu::{
    DrawOptions, FanModel, Frame, Gpu, Model, ModelSpace, Renderer, StreamedModel, StreamedWorld, SurfaceKey,
    WorldOptions, max_anisotropy, stream_view,
};
use fantex_scene::{Camera, CameraRig, Lights, SceneScale};
use fantex_store::{Asset, AssetHead, ChannelKind};
use fantex_stream::read::{
    BROWSER_CONNECTIONS, Fetched, FetchedFile, LaneReader, ReadRequest, ReaderInfo, ReaderKind, RemoteFile,
    spawn, task_reader,
};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, FrameOptions, MAX_INDEX_BYTES, World};
use glam::{DVec2, DVec3};
use wasm_bindgen::prelude::*;
use web_sys::HtmlCanvasElement;

/// Time of a frame that goes into unpacking what has come.
const UNPACKING_SLICE: Duration = Duration::from_millis(6);

/// Longest time that a frame counts for: a page that was hidden goes on where it was.
const MAX_FRAME_SECONDS: f32 = 0.1;

/// Bytes of texels that a frame uploads.
const UPLOAD_BYTES: usize = 2 << 20;

/// Graphics memory for the texels of a preview.
const PREVIEW_POOL_BYTES: u64 = 16 << 20;

/// Memory for the meshes and covers of a world's objects, and for their previews.
const GEOMETRY_BYTES: u64 = 256 << 20;

/// Has panics say in the console where they were.
#[wasm_bindgen(start)]
pub fn start() {
    std::panic::set_hook(Box::new(|panic| web_sys::console::error_1(&panic.to_string().into())));
}

/// An asset or a world in a canvas.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Viewer {
    gpu: Arc<Gpu>,
    surface: wgpu::Surface<'static>,
    configuration: wgpu::SurfaceConfiguration,
    renderer: Renderer,
    shown: Shown,
    /// Where the asset arrives, while its preview is shown.
    coming: Option<Coming>,
    /// Why it does not come.
    failed: Option<fantex_base::Error>,
    file: Rc<RemoteFile>,
    pool_bytes: u64,
    rig: CameraRig,
    /// Nobody has moved the camera: it frames the whole model.
    is_framing: bool,
    scale: SceneScale,
    options: DrawOptions,
    /// Milliseconds of the last frame.
    last_frame: Option<f64>,
    /// What is shown is not what would be drawn now.
    is_stale: bool,
    /// Whether the device has drawn a picture.
    has_picture: Arc<AtomicBool>,
}

/// Where a task leaves an asset, or why there is none.
type Coming = Rc<RefCell<Option<fantex_base::Result<Arc<Asset>>>>>;

/// Fetches an asset beside what else is done.
fn coming(asset: impl Future<Output = fantex_base::Result<Asset>> + 'static) -> Coming {
    let coming = Coming::default();
    let place = Rc::clone(&coming);
    spawn(async move {
        let asset = asset.await;
        *place.borrow_mut() = Some(asset.map(Arc::new));
    });
    coming
}

/// What is on the device.
#[derive(Debug)]
enum Shown {
    Asset(Box<StreamedModel>),
    World(Box<StreamedWorld>),
}

impl Shown {
    fn asset(
        gpu: &Gpu,
        asset: Arc<Asset>,
        reader: LaneReader,
        pool_bytes: u64,
        draw: &DrawOptions,
    ) -> Result<Self, JsError> {
        let options = ClusterLoaderOptions {
            block_compressed: gpu.has_block_compression(),
            ..ClusterLoaderOptions::default()
        };
        let loader =
            ClusterLoader::without_threads(Arc::clone(&asset), Box::new(reader), &options, UNPACKING_SLICE);
        let geometry = asset.clone();
        let streamed = StreamedModel::with_pages(gpu, &asset, geometry, Box::new(loader), pool_bytes);
        let mut streamed = streamed.map_err(said)?;
        streamed.streamer.set_max_anisotropy(max_anisotropy(&draw.filter));
        Ok(Self::Asset(Box::new(streamed)))
    }

    /// Nothing of it is there. `index` is its address.
    fn world(index: &str, world: World, pool_bytes: u64, draw: &DrawOptions) -> Result<Self, JsError> {
        let options = WorldOptions { pool_bytes, geometry_bytes: GEOMETRY_BYTES, filter: draw.filter };
        let world = StreamedWorld::new(Path::new(index), Arc::new(world), options).map_err(said)?;
        Ok(Self::World(Box::new(world)))
    }

    fn model(&mut self) -> &mut dyn Model {
        match self {
            Self::Asset(streamed) => &mut streamed.model,
            Self::World(world) => &mut **world,
        }
    }

    fn space(&self) -> &ModelSpace {
        match self {
            Self::Asset(streamed) => streamed.model.space(),
            Self::World(world) => world.space(),
        }
    }

    /// Its vertices, or the corners of its objects, in the world.
    fn points(&self) -> impl Iterator<Item = DVec3> + Clone + '_ {
        let space = self.space();
        space.points.iter().map(move |&p| space.world_from_mesh.point(p))
    }

    fn scale(&self) -> SceneScale {
        let bounds = Aabb::of_points(self.points());
        SceneScale::of(&if bounds.is_empty() { Aabb { min: DVec3::ZERO, max: DVec3::ZERO } } else { bounds })
    }

    /// Lets streaming go on. Returns whether something has changed that may be seen.
    fn advance(
        &mut self,
        gpu: &Arc<Gpu>,
        camera: &Camera,
        size: [u32; 2],
        frame: FrameOptions,
    ) -> Result<bool, JsError> {
        match self {
            Self::Asset(streamed) => {
                let view = stream_view(camera, size, streamed.model.space());
                let changes = streamed.advance(gpu, Some(&view), frame);
                Ok(!(changes.uploads.is_empty() && changes.entries.is_empty()))
            }
            Self::World(world) => world.advance(gpu, camera, size, frame).map_err(said),
        }
    }
}

/// Reads of an asset in memory.
fn memory_reader(asset: &Asset) -> LaneReader {
    let info = ReaderInfo { kind: ReaderKind::Threads, direct: false, depth: 1 };
    let source = Arc::clone(asset.source());
    task_reader(info, wasm_bindgen_futures::spawn_local, move |request: ReadRequest| {
        let mut bytes = vec![0; request.length];
        let read = source.read_exact_at(&mut bytes, request.offset);
        async move { read.map(|()| bytes) }
    })
}

/// How far streaming is.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// What is shown is the preview.
    pub is_preview: bool,
    /// Share of the visible tiles that are as sharp as the view asks for, 0 to 1.
    pub share: f64,
    /// Whether nothing is on its way: the picture stays until the view changes.
    pub is_settled: bool,
    /// Bytes of texels uploaded so far.
    pub uploaded_bytes: f64,
    /// Parts that cannot be read, or the whole asset; coarser ones or the preview stand in for them.
    pub damaged: u32,
}

fn said(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

#[wasm_bindgen]
impl Viewer {
    /// Opens the asset or the world at `url` in a canvas, with texels in at most `pool_bytes` of graphics memory. Nothing is drawn yet. Where the
    /// asset has a preview, that is opened, and the asset takes its place in a later [`frame`](Self::frame). Of a world the index is read;
    /// its assets come as they are seen. `answers` is a `Map` of ranges that are on their way already (see [`RemoteFile::with_answers`]).
    ///
    /// # Errors
    /// The browser has no WebGPU or no adapter for it; the asset or the index cannot be read, or is damaged; it exceeds what the device
    /// allows; there is nothing to show in the world.
    pub async fn open(
        canvas: HtmlCanvasElement,
        url: String,
        pool_bytes: f64,
        answers: JsValue,
    ) -> Result<Viewer, JsError> {
        let file = Rc::new(RemoteFile::with_answers(url, answers));
        let options = DrawOptions::default();
        let pool_bytes = pool_bytes as u64;
        let head = Rc::<HeadSlot>::default();
        let starting = async {
            let started = begin(Rc::clone(&file), Rc::clone(&head)).await;
            head.fill(None);
            started
        };
        let opening = async {
            let (gpu, surface, configuration) = open_gpu(canvas).await?;
            let mut renderer = Renderer::new(&gpu, configuration.format);
            let key = SurfaceKey::new(&options, &Lights::default());
            renderer.prepare(&gpu, key);
            if let Some(head) = head.filled().await {
                FanModel::prepare_pipelines(&gpu, &first_kinds(&head), key);
            }
            Ok::<_, JsError>((Arc::new(gpu), surface, configuration, renderer))
        };
        // Both take their time. What has come is looked at first, as the other waits for the head.
        let (started, opened) = join(starting, opening).await;
        let ((gpu, surface, configuration, renderer), started) = (opened?, started.map_err(said)?);
        let (shown, coming) = match started {
            Started::World(world) => (Shown::world(file.url(), world, pool_bytes, &options)?, None),
            Started::Asset { start, preview: Some(preview) } => {
                let coming = coming(start.asset());
                let reader = memory_reader(&preview);
                (Shown::asset(&gpu, Arc::new(preview), reader, PREVIEW_POOL_BYTES, &options)?, Some(coming))
            }
            Started::Asset { start, preview: None } => {
                let asset = Arc::new(start.asset().await.map_err(said)?);
                let reader = file.reader(BROWSER_CONNECTIONS);
                (Shown::asset(&gpu, asset, reader, pool_bytes, &options)?, None)
            }
        };
        let mut viewer = Self {
            renderer,
            scale: shown.scale(),
            rig: CameraRig::default(),
            is_framing: true,
            gpu,
            surface,
            configuration,
            shown,
            coming,
            failed: None,
            file,
            pool_bytes,
            options,
            last_frame: None,
            is_stale: true,
            has_picture: Arc::default(),
        };
        viewer.reset();
        Ok(viewer)
    }

    /// Shows the whole model, from the front, the right and above.
    pub fn reset(&mut self) {
        let camera = Camera::framing_points(self.shown.points(), Camera::THREE_QUARTER, self.aspect());
        self.rig = CameraRig::of_camera(&camera);
        (self.is_framing, self.is_stale) = (true, true);
    }

    /// The canvas has so many pixels now.
    pub fn resize(&mut self, width: u32, height: u32) {
        let most = self.gpu.limits().max_texture_dimension_2d;
        let size = [width, height].map(|n| n.clamp(1, most));
        if size != self.size() {
            [self.configuration.width, self.configuration.height] = size;
            self.surface.configure(&self.gpu.device, &self.configuration);
            self.is_stale = true;
        }
    }

    /// Turns about the pivot; in units of the canvas' height, downwards positive.
    pub fn orbit(&mut self, right: f64, down: f64) {
        self.rig.orbit(DVec2::new(right, down));
        (self.is_framing, self.is_stale) = (false, true);
    }

    /// Shifts the model with the hand; in units of the canvas' height, downwards positive.
    pub fn pan(&mut self, right: f64, down: f64) {
        self.rig.pan(DVec2::new(right, down));
        (self.is_framing, self.is_stale) = (false, true);
    }

    /// Comes closer (`factor` below one) to what is at a position of the canvas, 0 to 1 from its left top, or goes away from it.
    pub fn zoom(&mut self, x: f64, y: f64, factor: f64) {
        let point = self.rig.point_under(DVec2::new(x, y), self.aspect(), None);
        self.rig.zoom_to(point, factor, &self.scale);
        (self.is_framing, self.is_stale) = (false, true);
    }

    /// Lets streaming go on, and draws where something has changed. `now`: milliseconds of any clock. Returns how far it is; while it is not
    /// settled, it is to be called for every frame of the screen.
    ///
    /// # Errors
    /// The device is lost, or refuses something.
    pub fn frame(&mut self, now: f64) -> Result<Progress, JsError> {
        let elapsed = self.last_frame.map_or(0.0, |last| ((now - last) / 1000.0) as f32);
        self.last_frame = Some(now);
        self.take_what_came()?;
        let frame = FrameOptions {
            upload_bytes: UPLOAD_BYTES,
            elapsed_seconds: elapsed.clamp(0.0, MAX_FRAME_SECONDS),
        };
        let (camera, size) = (self.rig.camera(), self.size());
        self.is_stale |= self.shown.advance(&self.gpu, &camera, size, frame)?;
        if self.is_stale {
            self.draw(&camera)?;
        }
        self.gpu.check().map_err(said)?;
        Ok(self.progress())
    }

    fn draw(&mut self, camera: &Camera) -> Result<(), JsError> {
        let texture = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(texture)
            | wgpu::CurrentSurfaceTexture::Suboptimal(texture) => texture,
            // In the next frame, then.
            _ => return Ok(()),
        };
        let target = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let lights = Lights::behind(camera);
        let size = self.size();
        let model = self.shown.model();
        let mut frame = Frame { size, camera, lights: &lights, model, options: &self.options };
        self.renderer.draw(&self.gpu, &mut encoder, &target, &mut frame).map_err(said)?;
        self.gpu.queue.submit([encoder.finish()]);
        if !self.has_picture() {
            let has_picture = Arc::clone(&self.has_picture);
            self.gpu.queue.on_submitted_work_done(move || has_picture.store(true, Ordering::Relaxed));
        }
        self.gpu.queue.present(texture);
        self.is_stale = false;
        Ok(())
    }

    /// Whether the device has drawn a picture: it may be at work on the first one for long after the [`frame`](Self::frame) that asked for it.
    pub fn has_picture(&self) -> bool {
        self.has_picture.load(Ordering::Relaxed)
    }

    /// Whether the device is lost, which the next [`frame`](Self::frame) tells.
    pub fn is_lost(&self) -> bool {
        self.gpu.lost().is_some()
    }

    /// How far streaming is.
    pub fn progress(&self) -> Progress {
        let streamed = match &self.shown {
            Shown::Asset(streamed) => streamed,
            Shown::World(world) => {
                return Progress {
                    is_preview: false,
                    share: world.complete_share(),
                    is_settled: world.is_settled() && !self.is_stale,
                    uploaded_bytes: world.statistics().uploaded[0] as f64,
                    damaged: world.damage().0 as u32,
                };
            }
        };
        let figures = streamed.streamer.statistics();
        let is_coming = self.coming.is_some();
        let is_preview = is_coming || self.failed.is_some();
        Progress {
            is_preview,
            share: if is_preview { 0.0 } else { figures.complete_share() },
            is_settled: !is_coming && streamed.streamer.is_settled() && !self.is_stale,
            uploaded_bytes: figures.uploaded_bytes as f64,
            damaged: figures.damaged as u32 + u32::from(self.failed.is_some()),
        }
    }

    /// Why the first part that cannot be read cannot be, if there is one.
    pub fn damage(&self) -> Option<String> {
        if let Some(error) = &self.failed {
            return Some(error.to_string());
        }
        match &self.shown {
            Shown::Asset(streamed) => streamed.streamer.damaged().next().map(|(_, error)| error.to_string()),
            Shown::World(world) => world.damage().1,
        }
    }

    /// Asks once more for what could not be read.
    pub fn retry(&mut self) {
        if self.failed.take().is_some() {
            let file = Rc::clone(&self.file);
            self.coming = Some(coming(async move { file.start().await?.asset().await }));
        }
        match &mut self.shown {
            Shown::Asset(streamed) => streamed.streamer.retry_damaged(),
            Shown::World(world) => world.retry(),
        }
    }
}

impl Viewer {
    /// Shows the asset instead of its preview, once it is there. The camera stays where somebody has put it.
    fn take_what_came(&mut self) -> Result<(), JsError> {
        let Some(asset) = self.coming.as_ref().and_then(|coming| coming.borrow_mut().take()) else {
            return Ok(());
        };
        let asset = match asset {
            Ok(asset) => asset,
            Err(error) => {
                // The preview stays, and it can be tried again.
                (self.coming, self.failed) = (None, Some(error));
                return Ok(());
            }
        };
        let reader = self.file.reader(BROWSER_CONNECTIONS);
        self.shown = Shown::asset(&self.gpu, asset, reader, self.pool_bytes, &self.options)?;
        self.scale = self.shown.scale();
        (self.coming, self.is_stale) = (None, true);
        if self.is_framing {
            self.reset();
        }
        Ok(())
    }

    fn size(&self) -> [u32; 2] {
        [self.configuration.width, self.configuration.height]
    }

    fn aspect(&self) -> f64 {
        f64::from(self.configuration.width) / f64::from(self.configuration.height)
    }
}

/// What a file has turned out to be.
enum Started<F> {
    World(World),
    Asset { start: FetchedFile<F>, preview: Option<Asset> },
}

/// What the first bytes of an asset tell, for whoever waits for it while more is fetched.
#[derive(Debug, Default)]
struct HeadSlot(RefCell<Option<Option<AssetHead>>>);

impl HeadSlot {
    /// The head, or that there is none, unless one of these is known.
    fn fill(&self, head: Option<AssetHead>) {
        self.0.borrow_mut().get_or_insert(head);
    }

    /// Waits until it is filled, for a task that goes on whenever something has been fetched.
    async fn filled(&self) -> Option<AssetHead> {
        std::future::poll_fn(|_| match &*self.0.borrow() {
            Some(head) => Poll::Ready(head.clone()),
            None => Poll::Pending,
        })
        .await
    }
}

/// The kinds of channels of what is probably shown first: previews have normals of their own.
fn first_kinds(head: &AssetHead) -> Vec<ChannelKind> {
    let kinds = head.channels.iter().map(|channel| channel.kind);
    kinds.chain(head.has_attachments.then_some(ChannelKind::Normal)).collect()
}

/// Fetches the index of a world, or the start of an asset and its preview.
async fn begin(
    file: Rc<RemoteFile>,
    head: Rc<HeadSlot>,
) -> fantex_base::Result<Started<impl AsyncFn(Range<u64>) -> io::Result<Fetched>>> {
    let place = PathBuf::from(file.url());
    if World::is_named(&place) {
        let bytes = file.fetch_whole(MAX_INDEX_BYTES).await?;
        return Ok(Started::World(World::parse(&place, &bytes)?));
    }
    let start = file.start().await?;
    head.fill(start.head());
    let preview = start.preview().await?;
    Ok(Started::Asset { start, preview })
}

/// A device, and the canvas as its screen.
async fn open_gpu(
    canvas: HtmlCanvasElement,
) -> Result<(Gpu, wgpu::Surface<'static>, wgpu::SurfaceConfiguration), JsError> {
    let (width, height) = (canvas.width().max(1), canvas.height().max(1));
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::BROWSER_WEBGPU,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let surface = instance.create_surface(wgpu::SurfaceTarget::Canvas(canvas)).map_err(said)?;
    let request = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        compatible_surface: Some(&surface),
        ..wgpu::RequestAdapterOptions::default()
    };
    let adapter = instance.request_adapter(&request).await.map_err(|_| {
        JsError::new("this browser has WebGPU, but no graphics device for it: update the driver, or try another browser")
    })?;
    let opened = adapter.request_device(&Gpu::wanted_device_descriptor(&adapter)).await;
    let (device, queue) =
        opened.map_err(|error| JsError::new(&format!("the graphics device cannot be opened: {error}")))?;
    let gpu = Gpu::from_parts(&adapter, device, queue);
    gpu.record_errors();
    let configuration = surface
        .get_default_config(&adapter, width, height)
        .ok_or_else(|| JsError::new("the graphics device cannot draw into a page"))?;
    surface.configure(&gpu.device, &configuration);
    Ok((gpu, surface, configuration))
}

/// Two futures at a time, the first of which goes on first.
async fn join<A, B>(a: impl Future<Output = A>, b: impl Future<Output = B>) -> (A, B) {
    let (mut a, mut b) = (std::pin::pin!(a), std::pin::pin!(b));
    let (mut from_a, mut from_b) = (None, None);
    std::future::poll_fn(move |context| {
        if from_a.is_none()
            && let Poll::Ready(value) = a.as_mut().poll(context)
        {
            from_a = Some(value);
        }
        if from_b.is_none()
            && let Poll::Ready(value) = b.as_mut().poll(context)
        {
            from_b = Some(value);
        }
        match (from_a.take(), from_b.take()) {
            (Some(a), Some(b)) => Poll::Ready((a, b)),
            (a, b) => {
                (from_a, from_b) = (a, b);
                Poll::Pending
            }
        }
    })
    .await
}
