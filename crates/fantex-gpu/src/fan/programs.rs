//! Shaders, layouts and pipelines of fan-textured triangles. All models of a device share them: they are compiled once, when they are first
//! needed or before.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fantex_mesh::Material;
use fantex_stream::drawing::{BorderVertex, PlainVertex};
use fantex_texture::Filter;

use super::atlas::KINDS;
use super::bindings::MATERIAL_BYTES;
use crate::gpu::{FILTERED, SAMPLER, STORAGE, UNIFORM, dynamic_uniform, texture_type};
use crate::shader::{CASTER, FAN, FAN_CASTER, FAN_GEOMETRY, FAN_LOOKUP, compose, compose_surface, module};
use crate::surface_pipeline::alpha_code;
use crate::{Blending, CasterPipeline, Gpu, SurfaceKey, SurfacePipeline};

/// Per item of [`DRAWN_KINDS`](super::atlas::DRAWN_KINDS) whether an asset has such a channel.
pub(crate) type Drawn = [bool; KINDS];

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Shape {
    Plain,
    Border,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Surface {
    /// See [`alpha_code`].
    pub(crate) alpha_mode: u32,
    pub(crate) is_double_sided: bool,
    pub(crate) is_toon: bool,
}

impl Surface {
    pub(crate) fn of(material: &Material) -> Self {
        Self {
            alpha_mode: alpha_code(material.alpha),
            is_double_sided: material.double_sided,
            is_toon: material.toon.is_some(),
        }
    }

    /// The same for triangles that may be opposed by others: these are not seen from behind.
    pub(crate) fn opposed(self, is_opposed: bool) -> Self {
        Self { is_double_sided: self.is_double_sided && !is_opposed, ..self }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Part {
    pub(crate) shape: Shape,
    pub(crate) surface: Surface,
    /// Whether any tile is larger than a page.
    pub(crate) is_paged: bool,
}

/// Pipelines by what they depend on.
type Pipelines<K> = Mutex<HashMap<K, wgpu::RenderPipeline>>;

/// What all fan-textured models of a device share.
#[derive(Debug)]
pub(crate) struct FanPrograms {
    /// Of group 1.
    pub(crate) texture_layout: wgpu::BindGroupLayout,
    /// Of group 2.
    pub(crate) material_layout: wgpu::BindGroupLayout,
    /// Whether a branch in a shader saves what it goes round.
    pub(crate) has_branches: bool,
    surface: wgpu::ShaderModule,
    caster: wgpu::ShaderModule,
    surfaces: Pipelines<(SurfaceKey, Part, Drawn)>,
    /// By shape and alpha mode.
    casters: Pipelines<(Shape, u32, Drawn)>,
}

impl Shape {
    fn layout(self) -> wgpu::VertexBufferLayout<'static> {
        const PLAIN: &[wgpu::VertexAttribute] =
            &wgpu::vertex_attr_array![0 => Float32x3, 1 => Snorm16x2, 2 => Float32x2, 3 => Uint32];
        const BORDER: &[wgpu::VertexAttribute] = &wgpu::vertex_attr_array![
            0 => Float32x3, 1 => Snorm16x2, 2 => Float32x2, 3 => Float32x2, 4 => Float32x2, 5 => Uint32x3
        ];
        let (bytes, attributes) = match self {
            Self::Plain => (size_of::<PlainVertex>(), PLAIN),
            Self::Border => (size_of::<BorderVertex>(), BORDER),
        };
        let step_mode = wgpu::VertexStepMode::Vertex;
        wgpu::VertexBufferLayout { array_stride: bytes as u64, step_mode, attributes }
    }
}

impl FanPrograms {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let texture = |sample_type| texture_type(sample_type, wgpu::TextureViewDimension::D2);
        let words = texture(wgpu::TextureSampleType::Uint);
        let tables = [UNIFORM, STORAGE, words, STORAGE, STORAGE, SAMPLER];
        let types = tables.into_iter().chain([texture(FILTERED); KINDS]);
        let material = [dynamic_uniform(MATERIAL_BYTES)];
        let caster = compose(&[CASTER, FAN_LOOKUP, FAN_GEOMETRY, FAN_CASTER]);
        Self {
            texture_layout: gpu.bind_layout("fan model", wgpu::ShaderStages::VERTEX_FRAGMENT, types),
            material_layout: gpu.bind_layout("fan material", wgpu::ShaderStages::FRAGMENT, material),
            has_branches: !gpu.info().is_software,
            surface: module(&gpu.device, "fan", &compose_surface(&FAN)),
            caster: module(&gpu.device, "fan caster", &caster),
            surfaces: Pipelines::default(),
            casters: Pipelines::default(),
        }
    }

    /// The pipeline of a part in frames with a key.
    pub(crate) fn surface(
        &self,
        gpu: &Gpu,
        frame: SurfaceKey,
        part: Part,
        drawn: Drawn,
    ) -> wgpu::RenderPipeline {
        let Part { shape, surface, is_paged } = part;
        let build = || {
            let mut constants = lookup_constants(drawn, frame.filter, is_paged, self.has_branches);
            constants.push(("FAN_OVERLAY", frame.overlay.code().into()));
            constants.push(("FAN_ALPHA_MODE", surface.alpha_mode.into()));
            constants.push(("FAN_TOON", u8::from(surface.is_toon).into()));
            let (vertex, fragment) = match (shape, surface.alpha_mode) {
                (Shape::Plain, 1) => ("vs_fan_plain", "fs_fan_plain_cut_out"),
                (Shape::Plain, _) => ("vs_fan_plain", "fs_fan_plain"),
                (Shape::Border, 1) => ("vs_fan_border", "fs_fan_border_cut_out"),
                (Shape::Border, _) => ("vs_fan_border", "fs_fan_border"),
            };
            let pipeline = SurfacePipeline {
                label: "fan",
                module: &self.surface,
                vertex,
                fragment,
                buffers: &[Some(shape.layout())],
                groups: &[&self.texture_layout, &self.material_layout],
                constants: &constants,
                blending: if surface.alpha_mode == 2 { Blending::Over } else { Blending::Opaque },
                is_double_sided: surface.is_double_sided,
                topology: wgpu::PrimitiveTopology::TriangleList,
            };
            pipeline.build(gpu, frame)
        };
        locked(&self.surfaces).entry((frame, part, drawn)).or_insert_with(build).clone()
    }

    /// The pipeline of the shadow of a shape with an alpha mode.
    pub(crate) fn caster(
        &self,
        gpu: &Gpu,
        shape: Shape,
        alpha_mode: u32,
        drawn: Drawn,
    ) -> wgpu::RenderPipeline {
        let build = || {
            let mut constants = lookup_constants(drawn, Filter::Trilinear, true, self.has_branches);
            constants.push(("FAN_ALPHA_MODE", alpha_mode.into()));
            let is_solid = alpha_mode == 0;
            let pipeline = CasterPipeline {
                label: "fan caster",
                module: &self.caster,
                vertex: match shape {
                    _ if is_solid => "vs_fan_solid",
                    Shape::Plain => "vs_fan_plain_caster",
                    Shape::Border => "vs_fan_border_caster",
                },
                fragment: (!is_solid).then_some("fs_fan_caster"),
                buffers: &[Some(shape.layout())],
                groups: &[&self.texture_layout, &self.material_layout],
                constants: &constants,
            };
            pipeline.build(gpu)
        };
        locked(&self.casters).entry((shape, alpha_mode, drawn)).or_insert_with(build).clone()
    }
}

fn locked<T>(pipelines: &Mutex<T>) -> MutexGuard<'_, T> {
    pipelines.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Values of the overrides of `fan_lookup.wgsl`.
pub(crate) fn lookup_constants(
    drawn: Drawn,
    filter: Filter,
    is_paged: bool,
    has_branches: bool,
) -> Vec<(&'static str, f64)> {
    const CHANNELS: [&str; KINDS] =
        ["FAN_BASE_COLOR", "FAN_NORMAL", "FAN_MATERIAL", "FAN_EMISSION", "FAN_LIGHT", "FAN_ANISOTROPY"];
    let mut constants: Vec<_> = CHANNELS.into_iter().zip(drawn.map(|has| f64::from(u8::from(has)))).collect();
    constants.push(("FAN_FILTER", shader_filter(filter).into()));
    constants.push(("FAN_PAGED", u8::from(is_paged).into()));
    constants.push(("FAN_BRANCHES", u8::from(has_branches).into()));
    constants
}

/// The filter as the shader's constant `FAN_FILTER` names it. The filters that only the CPU has are replaced by their
/// nearest relatives: bicubic ones by linear ones, the elliptical weighted average by anisotropic probes.
fn shader_filter(filter: Filter) -> u32 {
    match filter {
        Filter::Nearest => 0,
        Filter::Bilinear | Filter::Bicubic => 1,
        Filter::Trilinear | Filter::BicubicMipmaps => 2,
        Filter::Anisotropic | Filter::Ewa => 3,
    }
}

/// Those that a model has needed so far, at hand while it is drawn.
#[derive(Debug, Default)]
pub(crate) struct FanPipelines {
    pub(crate) surfaces: HashMap<(SurfaceKey, Part), wgpu::RenderPipeline>,
    casters: HashMap<(Shape, u32), wgpu::RenderPipeline>,
}

impl FanPipelines {
    pub(crate) fn prepare_surface(&mut self, gpu: &Gpu, frame: SurfaceKey, part: Part, drawn: Drawn) {
        let pipeline = || gpu.fan_programs().surface(gpu, frame, part, drawn);
        self.surfaces.entry((frame, part)).or_insert_with(pipeline);
    }

    pub(crate) fn prepare_caster(&mut self, gpu: &Gpu, Part { shape, surface, .. }: Part, drawn: Drawn) {
        let alpha_mode = surface.alpha_mode;
        let pipeline = || gpu.fan_programs().caster(gpu, shape, alpha_mode, drawn);
        self.casters.entry((shape, alpha_mode)).or_insert_with(pipeline);
    }

    pub(crate) fn caster(&self, part: Part) -> Option<&wgpu::RenderPipeline> {
        self.casters.get(&(part.shape, part.surface.alpha_mode))
    }
}
