//! Pipelines of fan-textured triangles, made when they are first needed.

use std::collections::HashMap;

use fantex_mesh::Material;

use super::bindings::FanBindings;
use super::model::alpha_code;
use super::tables::shader_filter;
use crate::shader::{
    CASTER, FAN, FAN_CASTER, FAN_FINISH, FAN_GEOMETRY, FAN_LOOKUP, compose, compose_surface, module,
};
use crate::{CasterPipeline, Coat, Gpu, SurfaceKey, SurfacePipeline};

/// The two kinds of triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Shape {
    Plain,
    Border,
}

/// What a material asks of pipelines.
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

    /// The same for triangles that may have twins: these are not seen from behind.
    pub(crate) fn with_twins(self, has_twins: bool) -> Self {
        Self { is_double_sided: self.is_double_sided && !has_twins, ..self }
    }
}

/// What is drawn with one pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Part {
    pub(crate) shape: Shape,
    pub(crate) surface: Surface,
    /// Whether any tile is larger than a page.
    pub(crate) is_paged: bool,
}

/// All pipelines that were needed so far.
#[derive(Debug)]
pub(crate) struct FanPipelines {
    surface: wgpu::ShaderModule,
    caster: wgpu::ShaderModule,
    surfaces: HashMap<(SurfaceKey, Part), wgpu::RenderPipeline>,
    /// By shape and alpha mode.
    casters: HashMap<(Shape, u32), wgpu::RenderPipeline>,
}

const PLAIN_VERTEX: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: size_of::<super::geometry::PlainVertex>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Snorm16x2, 2 => Float32x2, 3 => Uint32],
};

const BORDER_VERTEX: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: size_of::<super::geometry::BorderVertex>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Snorm16x2, 2 => Float32x2, 3 => Float32x2, 4 => Float32x2, 5 => Uint32x3
    ],
};

impl Shape {
    fn layout(self) -> wgpu::VertexBufferLayout<'static> {
        match self {
            Self::Plain => PLAIN_VERTEX,
            Self::Border => BORDER_VERTEX,
        }
    }
}

impl FanPipelines {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let surface = compose_surface(&[FAN_LOOKUP, FAN_GEOMETRY, FAN_FINISH, FAN]);
        let caster = compose(&[CASTER, FAN_LOOKUP, FAN_GEOMETRY, FAN_CASTER]);
        Self {
            surface: module(device, "fan", &surface),
            caster: module(device, "fan caster", &caster),
            surfaces: HashMap::new(),
            casters: HashMap::new(),
        }
    }

    pub(crate) fn prepare_surface(
        &mut self,
        gpu: &Gpu,
        bindings: &FanBindings,
        material: &wgpu::BindGroupLayout,
        frame: SurfaceKey,
        part: Part,
    ) {
        let Part { shape, surface, is_paged } = part;
        self.surfaces.entry((frame, part)).or_insert_with(|| {
            let mut constants = bindings.channel_constants().to_vec();
            constants.push(("FAN_FILTER", shader_filter(frame.filter).into()));
            constants.push(("FAN_PAGED", u8::from(is_paged).into()));
            constants.push(("FAN_OVERLAY", frame.overlay.code().into()));
            constants.push(("FAN_ALPHA_MODE", surface.alpha_mode.into()));
            constants.push(("FAN_TOON", u8::from(surface.is_toon).into()));
            let (vertex, fragment) = match shape {
                Shape::Plain => ("vs_fan_plain", "fs_fan_plain"),
                Shape::Border => ("vs_fan_border", "fs_fan_border"),
            };
            let pipeline = SurfacePipeline {
                label: "fan",
                module: &self.surface,
                vertex,
                fragment,
                buffers: &[Some(shape.layout())],
                groups: &[&bindings.layout, material],
                constants: &constants,
                coat: if surface.alpha_mode == 2 { Coat::Layered } else { Coat::Opaque },
                is_double_sided: surface.is_double_sided,
                topology: wgpu::PrimitiveTopology::TriangleList,
            };
            pipeline.build(gpu, frame)
        });
    }

    pub(crate) fn surface(&self, frame: SurfaceKey, part: Part) -> Option<&wgpu::RenderPipeline> {
        self.surfaces.get(&(frame, part))
    }

    pub(crate) fn prepare_caster(
        &mut self,
        gpu: &Gpu,
        bindings: &FanBindings,
        material: &wgpu::BindGroupLayout,
        shape: Shape,
        surface: Surface,
    ) {
        self.casters.entry((shape, surface.alpha_mode)).or_insert_with(|| {
            let mut constants = bindings.channel_constants().to_vec();
            constants.push(("FAN_FILTER", shader_filter(fantex_texture::Filter::Trilinear).into()));
            constants.push(("FAN_ALPHA_MODE", surface.alpha_mode.into()));
            let is_solid = surface.alpha_mode == 0;
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
                groups: &[&bindings.layout, material],
                constants: &constants,
            };
            pipeline.build(gpu)
        });
    }

    pub(crate) fn caster(&self, shape: Shape, surface: Surface) -> Option<&wgpu::RenderPipeline> {
        self.casters.get(&(shape, surface.alpha_mode))
    }
}
