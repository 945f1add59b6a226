//! What a page holds: a canvas with an asset in it.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use fantex_gpu::{DrawOptions, Frame, Gpu, Model, Renderer, StreamedModel, max_anisotropy, stream_view};
use fantex_scene::{Camera, CameraRig, Lights, SceneScale, world_bounds};
use fantex_store::Asset;
use fantex_stream::read::{BROWSER_CONNECTIONS, RemoteFile};
use fantex_stream::{ClusterLoader, ClusterLoaderOptions, FrameOptions, open_fetched};
use glam::DVec2;
use wasm_bindgen::prelude::*;
use web_sys::HtmlCanvasElement;

/// Time of a frame that goes into unpacking what has come.
const UNPACKING_SLICE: Duration = Duration::from_millis(6);

/// Longest time that a frame counts for: a page that was hidden goes on where it was.
const MAX_FRAME_SECONDS: f32 = 0.1;

/// Bytes of texels that a frame uploads.
const UPLOAD_BYTES: usize = 2 << 20;

/// Has panics say in the console where they were.
#[wasm_bindgen(start)]
pub fn start() {
    std::panic::set_hook(Box::new(|panic| web_sys::console::error_1(&panic.to_string().into())));
}

/// An asset in a canvas.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Viewer {
    gpu: Gpu,
    surface: wgpu::Surface<'static>,
    configuration: wgpu::SurfaceConfiguration,
    renderer: Renderer,
    streamed: StreamedModel,
    asset: Arc<Asset>,
    rig: CameraRig,
    scale: SceneScale,
    options: DrawOptions,
    /// Milliseconds of the last frame.
    last_frame: Option<f64>,
    /// What is shown is not what would be drawn now.
    is_stale: bool,
}

/// How far streaming is.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Share of the visible tiles that are as sharp as the view asks for, 0 to 1.
    pub share: f64,
    /// Whether nothing is on its way: the picture stays until the view changes.
    pub is_settled: bool,
    /// Bytes of texels uploaded so far.
    pub uploaded_bytes: f64,
    /// Parts that cannot be read; coarser ones stand in for them.
    pub damaged: u32,
}

fn said(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

#[wasm_bindgen]
impl Viewer {
    /// Opens the asset at `url` in a canvas, with texels in at most `pool_bytes` of graphics memory. Nothing is drawn yet.
    ///
    /// # Errors
    /// The browser has no WebGPU or no adapter for it; the asset cannot be read, or is damaged; it exceeds what the device allows.
    pub async fn open(canvas: HtmlCanvasElement, url: String, pool_bytes: f64) -> Result<Viewer, JsError> {
        // Both take their time, and neither needs the other.
        let file = Rc::new(RemoteFile::new(url));
        let opening = Rc::clone(&file);
        let asset =
            async move { open_fetched(opening.url(), async |range| opening.fetch(range).await).await };
        let (gpu, asset) = join(open_gpu(canvas), asset).await;
        let ((gpu, surface, configuration), asset) = (gpu?, Arc::new(asset.map_err(said)?));

        let reader = file.reader(BROWSER_CONNECTIONS);
        let options = ClusterLoaderOptions {
            block_compressed: gpu.has_block_compression(),
            ..ClusterLoaderOptions::default()
        };
        let loader =
            ClusterLoader::without_threads(Arc::clone(&asset), Box::new(reader), &options, UNPACKING_SLICE);
        let streamed =
            StreamedModel::with_pages(&gpu, &asset, asset.clone(), Box::new(loader), pool_bytes as u64);
        let mut streamed = streamed.map_err(said)?;
        let options = DrawOptions::default();
        streamed.streamer.set_max_anisotropy(max_anisotropy(&options.filter));
        let mut viewer = Self {
            renderer: Renderer::new(&gpu, configuration.format),
            scale: SceneScale::of(&world_bounds(asset.mesh())),
            rig: CameraRig::default(),
            gpu,
            surface,
            configuration,
            streamed,
            asset,
            options,
            last_frame: None,
            is_stale: true,
        };
        viewer.reset();
        Ok(viewer)
    }

    /// Shows the whole model, from the front, the right and above.
    pub fn reset(&mut self) {
        let camera = Camera::framing_mesh(self.asset.mesh(), Camera::THREE_QUARTER, self.aspect());
        self.rig = CameraRig::of_camera(&camera);
        self.is_stale = true;
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
        self.is_stale = true;
    }

    /// Shifts the model with the hand; in units of the canvas' height, downwards positive.
    pub fn pan(&mut self, right: f64, down: f64) {
        self.rig.pan(DVec2::new(right, down));
        self.is_stale = true;
    }

    /// Comes closer (`factor` below one) to what is at a position of the canvas, 0 to 1 from its left top, or goes away from it.
    pub fn zoom(&mut self, x: f64, y: f64, factor: f64) {
        let point = self.rig.point_under(DVec2::new(x, y), self.aspect(), None);
        self.rig.zoom_to(point, factor, &self.scale);
        self.is_stale = true;
    }

    /// Lets streaming go on, and draws where something has changed. `now`: milliseconds of any clock. Returns how far it is; while it is not
    /// settled, it is to be called for every frame of the screen.
    ///
    /// # Errors
    /// The device is lost, or refuses something.
    pub fn frame(&mut self, now: f64) -> Result<Progress, JsError> {
        let elapsed = self.last_frame.map_or(0.0, |last| ((now - last) / 1000.0) as f32);
        self.last_frame = Some(now);
        let frame = FrameOptions {
            upload_bytes: UPLOAD_BYTES,
            elapsed_seconds: elapsed.clamp(0.0, MAX_FRAME_SECONDS),
        };
        let (camera, size) = (self.rig.camera(), self.size());
        let view = stream_view(&camera, size, self.streamed.model.space());
        let changes = self.streamed.advance(&self.gpu, Some(&view), frame);
        self.is_stale |= !(changes.uploads.is_empty() && changes.entries.is_empty());
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
        let mut frame =
            Frame { size, camera, lights: &lights, model: &mut self.streamed.model, options: &self.options };
        self.renderer.draw(&self.gpu, &mut encoder, &target, &mut frame).map_err(said)?;
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.queue.present(texture);
        self.is_stale = false;
        Ok(())
    }

    /// How far streaming is.
    pub fn progress(&self) -> Progress {
        let figures = self.streamed.streamer.statistics();
        Progress {
            share: figures.complete_share(),
            is_settled: self.streamed.streamer.is_settled() && !self.is_stale,
            uploaded_bytes: figures.uploaded_bytes as f64,
            damaged: figures.damaged as u32,
        }
    }

    /// Why the first part that cannot be read cannot be, if there is one.
    pub fn damage(&self) -> Option<String> {
        self.streamed.streamer.damaged().next().map(|(_, error)| error.to_string())
    }

    /// Asks once more for what could not be read.
    pub fn retry(&mut self) {
        self.streamed.streamer.retry_damaged();
    }
}

impl Viewer {
    fn size(&self) -> [u32; 2] {
        [self.configuration.width, self.configuration.height]
    }

    fn aspect(&self) -> f64 {
        f64::from(self.configuration.width) / f64::from(self.configuration.height)
    }
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

/// Two futures at a time.
async fn join<A, B>(a: impl Future<Output = A>, b: impl Future<Output = B>) -> (A, B) {
    let (mut a, mut b) = (std::pin::pin!(a), std::pin::pin!(b));
    let (mut from_a, mut from_b) = (None, None);
    std::future::poll_fn(move |context| {
        use std::task::Poll;
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
