//! Drawing frames: shadow maps, surfaces, sky, lines, tone map.

use std::collections::HashMap;

use fantex_base::{Error, Result};
use fantex_scene::{Camera, Lights};

use crate::frame::{DEPTH_FORMAT, FrameInputs, FrameState, LIGHT_FORMAT};
use crate::gpu::texture_type;
use crate::shader::{ENVIRONMENT, FRAME, SKY, TONE, compose, module};
use crate::surface_pipeline::pipeline_layout;
use crate::wireframe::Wireframe;
use crate::{Blending, DrawOptions, FrameContext, Gpu, Model, SurfaceKey, SurfacePipeline, View};

/// What to draw.
pub struct Frame<'a> {
    /// Columns and rows of the target; where one is zero, nothing is drawn.
    pub size: [u32; 2],
    /// From where.
    pub camera: &'a Camera,
    /// By which light.
    pub lights: &'a Lights,
    /// What.
    pub model: &'a mut dyn Model,
    /// How.
    pub options: &'a DrawOptions,
}

/// Draws frames into targets of one format. It keeps what the next frame may need again: targets, shadow maps, textures of the
/// surroundings.
#[derive(Debug)]
pub struct Renderer {
    state: FrameState,
    screen: ScreenPipelines,
    targets: Option<Targets>,
    wireframe: Option<Wireframe>,
}

impl Renderer {
    /// For targets of a format. Formats that encode sRGB are given linear light, other formats of bytes are given encoded
    /// values, formats of floats linear light. Alpha is straight.
    pub fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Self {
        Self {
            state: FrameState::new(gpu),
            screen: ScreenPipelines::new(gpu, output),
            targets: None,
            wireframe: None,
        }
    }

    /// Has compiled, before the first frame with a key is drawn, what it needs besides a model.
    pub fn prepare(&mut self, gpu: &Gpu, key: SurfaceKey) {
        self.screen.prepare_sky(gpu, key);
    }

    /// Records the commands that draw a frame over the whole target. They must be submitted before the next frame is drawn:
    /// shadow maps, once drawn, are taken to be there.
    ///
    /// # Errors
    /// The device is lost or cannot draw this; camera or lights have a defect. Commands that were recorded until then are
    /// harmless.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        frame: &mut Frame<'_>,
    ) -> Result<()> {
        gpu.check()?;
        if frame.size.contains(&0) {
            return Ok(());
        }
        frame.check()?;
        let drawn = self.draw_checked(gpu, encoder, target, frame);
        if drawn.is_err() {
            self.state.forget_shadows();
        }
        drawn
    }

    fn draw_checked(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        frame: &mut Frame<'_>,
    ) -> Result<()> {
        let options = frame.options;
        let targets = match self.targets.take() {
            Some(targets) if targets.fit(frame.size, options.samples) => targets,
            _ => Targets::new(gpu, frame.size, options.samples)?,
        };
        let targets = self.targets.insert(targets);
        let view = View::new(frame.camera, frame.size, frame.model.space());
        let inputs = FrameInputs {
            view: &view,
            lights: frame.lights,
            options,
            space: frame.model.space(),
            shadow_revision: frame.model.shadow_revision(),
            encode_srgb: self.screen.must_encode_srgb(),
        };
        let draws_shadows = self.state.update(gpu, encoder, &inputs)?;
        let key = SurfaceKey::new(options, frame.lights);
        frame.model.prepare(gpu, encoder, &FrameContext { view: &view, options, key, draws_shadows })?;
        if let Some(lines) = &options.wireframe {
            Wireframe::update(&mut self.wireframe, gpu, frame.model.space(), lines)?;
        }
        if draws_shadows {
            draw_shadows(&self.state, encoder, &*frame.model);
        }
        self.screen.prepare(gpu, targets, key);
        let Some(group) = self.state.surface_group() else { return Ok(()) };
        let mut pass = targets.begin(encoder);
        pass.set_bind_group(0, group, &[]);
        frame.model.draw_opaque(&mut pass);
        pass.set_bind_group(0, group, &[]);
        self.screen.draw_sky(&mut pass, key);
        frame.model.draw_layered(&mut pass);
        if let (Some(_), Some(wireframe)) = (&options.wireframe, &mut self.wireframe) {
            pass.set_bind_group(0, group, &[]);
            wireframe.draw(gpu, &mut pass, key);
        }
        drop(pass);
        self.screen.draw_tone_mapped(encoder, group, target);
        gpu.check()
    }
}

fn draw_shadows(state: &FrameState, encoder: &mut wgpu::CommandEncoder, model: &dyn Model) {
    for (face, group, offset) in state.shadow_faces() {
        let mut attachment = depth_attachment(&face.target, wgpu::StoreOp::Store);
        if !face.is_first {
            // Others lie beside it.
            attachment.depth_ops = Some(wgpu::Operations { load: wgpu::LoadOp::Load, ..Default::default() });
        }
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow map"),
            depth_stencil_attachment: Some(attachment),
            ..Default::default()
        });
        let [left, top] = face.at;
        pass.set_scissor_rect(left, top, face.resolution, face.resolution);
        let [x, y, side] = [left, top, face.resolution].map(|n| n as f32);
        pass.set_viewport(x, y, side, side, 0.0, 1.0);
        pass.set_bind_group(0, group, &[offset]);
        model.draw_casters(&mut pass);
    }
}

impl Frame<'_> {
    fn check(&self) -> Result<()> {
        if !matches!(self.options.samples, 1 | 4) {
            return Err(Error::invalid(format!(
                "cannot render with {} samples per pixel on the GPU: ask for 1 or 4",
                self.options.samples
            )));
        }
        if let Some(defect) = self.camera.defect() {
            return Err(Error::invalid(format!("cannot render from this camera: {defect}")));
        }
        match self.lights.defect() {
            Some((lamp, defect)) => {
                Err(Error::invalid(format!("cannot render with lamp {lamp} of the scene: {defect}")))
            }
            None => Ok(()),
        }
    }
}

// Passes over the whole picture: the sky behind the model, the tone map at the end.

#[derive(Debug)]
pub(crate) struct ScreenPipelines {
    output: wgpu::TextureFormat,
    sky_module: wgpu::ShaderModule,
    /// By the samples per pixel and whether the surroundings are an environment map.
    skies: HashMap<(u32, bool), wgpu::RenderPipeline>,
    tone: wgpu::RenderPipeline,
    tone_layout: wgpu::BindGroupLayout,
    /// The light that the tone map reads, and its bind group.
    light: Option<(wgpu::TextureView, wgpu::BindGroup)>,
}

impl ScreenPipelines {
    pub(crate) fn new(gpu: &Gpu, output: wgpu::TextureFormat) -> Self {
        let device = &gpu.device;
        let unfiltered = wgpu::TextureSampleType::Float { filterable: false };
        let light = texture_type(unfiltered, wgpu::TextureViewDimension::D2);
        let tone_layout = gpu.bind_layout("tone map", wgpu::ShaderStages::FRAGMENT, [light]);
        let tone_module = module(device, "tone map", &compose(&[FRAME, TONE]));
        let layout = pipeline_layout(gpu, "tone map", gpu.frame_layout().surfaces(), &[&tone_layout]);
        let entries = ["vs_tone", "fs_tone"];
        Self {
            output,
            sky_module: module(device, "sky", &compose(&[FRAME, ENVIRONMENT, SKY])),
            skies: HashMap::new(),
            tone: screen_pipeline(gpu, "tone map", &tone_module, entries, Some(&layout), output),
            tone_layout,
            light: None,
        }
    }

    /// Whether the shader must encode sRGB, because the target's format does not.
    fn must_encode_srgb(&self) -> bool {
        let is_float = matches!(
            self.output,
            wgpu::TextureFormat::Rgba16Float
                | wgpu::TextureFormat::Rgba32Float
                | wgpu::TextureFormat::Rg11b10Ufloat
        );
        !self.output.is_srgb() && !is_float
    }

    fn prepare_sky(&mut self, gpu: &Gpu, key: SurfaceKey) {
        let Self { skies, sky_module, .. } = self;
        skies.entry((key.samples, key.has_environment)).or_insert_with(|| {
            let pipeline = SurfacePipeline {
                label: "sky",
                module: sky_module,
                vertex: "vs_sky",
                fragment: "fs_sky",
                buffers: &[],
                groups: &[],
                constants: &[],
                blending: Blending::Opaque,
                is_double_sided: true,
                topology: wgpu::PrimitiveTopology::TriangleList,
            };
            let constants = [("HAS_ENVIRONMENT", f64::from(u8::from(key.has_environment)))];
            pipeline.build_with(gpu, key.samples, &constants)
        });
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, targets: &Targets, key: SurfaceKey) {
        self.prepare_sky(gpu, key);
        if self.light.as_ref().is_none_or(|(view, _)| *view != targets.light) {
            let light = wgpu::BindingResource::TextureView(&targets.light);
            let group = gpu.bind_group("tone map", &self.tone_layout, [light]);
            self.light = Some((targets.light.clone(), group));
        }
    }

    /// Fills what no surface has covered. Group 0 is bound.
    fn draw_sky(&self, pass: &mut wgpu::RenderPass<'_>, key: SurfaceKey) {
        if let Some(sky) = self.skies.get(&(key.samples, key.has_environment)) {
            pass.set_pipeline(sky);
            pass.draw(0..3, 0..1);
        }
    }

    /// Brings the light of the targets of the last [`ScreenPipelines::prepare`] to a target; `group` is group 0.
    fn draw_tone_mapped(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        group: &wgpu::BindGroup,
        target: &wgpu::TextureView,
    ) {
        let Some((_, light)) = &self.light else { return };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("tone map"),
            color_attachments: &[Some(color_attachment(target, wgpu::Color::TRANSPARENT))],
            ..Default::default()
        });
        pass.set_pipeline(&self.tone);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, light, &[]);
        pass.draw(0..3, 0..1);
    }
}

/// A pipeline of triangles over a whole target, without depth. Without a layout that of the shader.
pub(crate) fn screen_pipeline(
    gpu: &Gpu,
    label: &str,
    module: &wgpu::ShaderModule,
    [vertex, fragment]: [&str; 2],
    layout: Option<&wgpu::PipelineLayout>,
    output: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(label),
        layout,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets: &[Some(output.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// A target that is cleared first.
pub(crate) fn color_attachment(
    view: &wgpu::TextureView,
    clear: wgpu::Color,
) -> wgpu::RenderPassColorAttachment<'_> {
    let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(clear), store: wgpu::StoreOp::Store };
    wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops }
}

/// Depth that begins at the far end.
fn depth_attachment(
    view: &wgpu::TextureView,
    store: wgpu::StoreOp,
) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    let depth_ops = Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store });
    wgpu::RenderPassDepthStencilAttachment { view, depth_ops, stencil_ops: None }
}

// The textures that a frame is drawn into before it is tone mapped.

#[derive(Debug)]
pub(crate) struct Targets {
    size: [u32; 2],
    samples: u32,
    /// Several samples per pixel, where there are.
    many: Option<wgpu::TextureView>,
    /// One sample per pixel.
    pub(crate) light: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Targets {
    /// For pictures of a size with sides of at least one pixel.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2], samples: u32) -> Result<Self> {
        let allowed = gpu.limits().max_texture_dimension_2d;
        gpu.allow("a picture", size[0].max(size[1]), allowed, "pixels along a side")?;
        let texture = |label: &str, format, samples: u32, usage| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let none = wgpu::TextureUsages::empty();
        Ok(Self {
            size,
            samples,
            many: (samples > 1).then(|| texture("samples", LIGHT_FORMAT, samples, none)),
            light: texture("light", LIGHT_FORMAT, 1, wgpu::TextureUsages::TEXTURE_BINDING),
            depth: texture("depth", DEPTH_FORMAT, samples, none),
        })
    }

    /// Whether they are those of pictures of this kind.
    pub(crate) fn fit(&self, size: [u32; 2], samples: u32) -> bool {
        self.size == size && self.samples == samples
    }

    pub(crate) fn begin<'e>(&self, encoder: &'e mut wgpu::CommandEncoder) -> wgpu::RenderPass<'e> {
        let (view, resolve_target, store) = match &self.many {
            Some(many) => (many, Some(&self.light), wgpu::StoreOp::Discard),
            None => (&self.light, None, wgpu::StoreOp::Store),
        };
        let mut light = color_attachment(view, wgpu::Color::TRANSPARENT);
        (light.resolve_target, light.ops.store) = (resolve_target, store);
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("frame"),
            color_attachments: &[Some(light)],
            depth_stencil_attachment: Some(depth_attachment(&self.depth, wgpu::StoreOp::Discard)),
            ..Default::default()
        })
    }
}
