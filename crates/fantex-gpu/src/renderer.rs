//! Drawing frames.

use fantex_scene::{Camera, Lights};

use crate::frame::{FrameInputs, FrameState, Targets};
use crate::screen::ScreenPipelines;
use crate::wireframe::Wireframe;
use crate::{DrawOptions, FrameContext, Gpu, GpuError, Model, SurfaceKey, View};

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

    /// Records the commands that draw a frame over the whole target. They must be submitted before the next frame is drawn:
    /// shadow maps, once drawn, are taken to be there.
    ///
    /// # Errors
    ///
    /// The device is lost or cannot draw this; camera or lights have a defect. Commands that were recorded until then are
    /// harmless.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        frame: &mut Frame<'_>,
    ) -> Result<(), GpuError> {
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
    ) -> Result<(), GpuError> {
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
        let key = frame.key();
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

/// Draws all shadow maps.
fn draw_shadows(state: &FrameState, encoder: &mut wgpu::CommandEncoder, model: &dyn Model) {
    for (face, group, offset) in state.shadow_faces() {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow map"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &face.target,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let side = face.resolution as f32;
        pass.set_viewport(0.0, 0.0, side, side, 0.0, 1.0);
        pass.set_bind_group(0, group, &[offset]);
        model.draw_casters(&mut pass);
    }
}

impl Frame<'_> {
    fn check(&self) -> Result<(), GpuError> {
        if !matches!(self.options.samples, 1 | 4) {
            return Err(GpuError::Samples(self.options.samples));
        }
        if let Some(defect) = self.camera.defect() {
            return Err(GpuError::Camera(defect));
        }
        match self.lights.defect() {
            Some((lamp, defect)) => Err(GpuError::Light { lamp, defect }),
            None => Ok(()),
        }
    }

    /// What pipelines depend on.
    fn key(&self) -> SurfaceKey {
        let options = self.options;
        let is_lit = options.shading.is_lit();
        SurfaceKey {
            shading: options.shading,
            overlay: options.overlay,
            filter: options.filter.filter,
            samples: options.samples,
            has_shadows: is_lit && self.lights.lamps.iter().any(|lamp| lamp.shadow.is_some()),
            has_environment: self.lights.ambient.environment.is_some(),
        }
    }
}
