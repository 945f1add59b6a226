//! Pipelines of meshes with their own materials, made when they are first needed.

use std::collections::HashMap;

use fantex_mesh::AlphaMode;

use super::buffers::Buffers;
use super::materials::UvMaterial;
use crate::shader::{CASTER, UV, UV_CASTER, UV_MATERIAL, compose, compose_surface, module};
use crate::{CasterPipeline, Coat, Gpu, SurfaceKey, SurfacePipeline};

/// What a surface pipeline of this model depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct PipelineKey {
    frame: SurfaceKey,
    layers: u32,
    alpha: u8,
    is_double_sided: bool,
}

/// Pipelines, made when they are first needed.
#[derive(Debug)]
pub(super) struct Pipelines {
    surface_module: wgpu::ShaderModule,
    caster_module: wgpu::ShaderModule,
    surfaces: HashMap<PipelineKey, wgpu::RenderPipeline>,
    solid_caster: Option<wgpu::RenderPipeline>,
    /// By layers and alpha mode.
    casters: HashMap<(u32, u8), wgpu::RenderPipeline>,
}

impl PipelineKey {
    /// `has_twins`: for triangles that are not seen from behind, whatever the material says.
    pub(super) fn new(material: &UvMaterial, has_twins: bool, frame: SurfaceKey) -> Self {
        Self {
            frame,
            layers: material.layers,
            alpha: alpha_code(material.alpha),
            is_double_sided: material.is_double_sided && !has_twins,
        }
    }
}

impl Pipelines {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self {
            surface_module: module(&gpu.device, "mesh", &compose_surface(&[UV_MATERIAL, UV])),
            caster_module: module(&gpu.device, "mesh shadow", &compose(&[CASTER, UV_MATERIAL, UV_CASTER])),
            surfaces: HashMap::new(),
            solid_caster: None,
            casters: HashMap::new(),
        }
    }

    /// The pipeline that draws a surface, if it was made.
    pub(super) fn surface(&self, key: PipelineKey) -> Option<&wgpu::RenderPipeline> {
        self.surfaces.get(&key)
    }

    /// The pipeline that draws a material's shadow, if it was made.
    pub(super) fn caster(&self, material: &UvMaterial) -> Option<&wgpu::RenderPipeline> {
        match material.alpha {
            AlphaMode::Opaque => self.solid_caster.as_ref(),
            AlphaMode::Mask(_) | AlphaMode::Blend => {
                self.casters.get(&(material.layers, alpha_code(material.alpha)))
            }
        }
    }

    /// Compiles the pipeline of a surface, if it was not.
    pub(super) fn make_surface(
        &mut self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        buffers: &Buffers,
        key: PipelineKey,
    ) {
        let Self { surface_module, surfaces, .. } = self;
        surfaces.entry(key).or_insert_with(|| {
            buffers.with_layout(|buffers| {
                let pipeline = SurfacePipeline {
                    label: "mesh",
                    module: surface_module,
                    vertex: "vs_uv",
                    fragment: "fs_uv",
                    buffers,
                    groups: &[layout],
                    constants: &[("UV_LAYERS", f64::from(key.layers)), ("ALPHA_MODE", f64::from(key.alpha))],
                    coat: if key.alpha == 2 { Coat::Layered } else { Coat::Opaque },
                    is_double_sided: key.is_double_sided,
                    topology: wgpu::PrimitiveTopology::TriangleList,
                };
                pipeline.build(gpu, key.frame)
            })
        });
    }

    /// Compiles the pipeline of a material's shadow, if it was not.
    pub(super) fn make_caster(
        &mut self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        buffers: &Buffers,
        material: &UvMaterial,
    ) {
        let Self { caster_module, solid_caster, casters, .. } = self;
        let build = |vertex, fragment, constants: &[(&str, f64)]| {
            buffers.with_layout(|buffers| {
                let pipeline = CasterPipeline {
                    label: "mesh shadow",
                    module: caster_module,
                    vertex,
                    fragment,
                    buffers,
                    groups: &[layout],
                    constants,
                };
                pipeline.build(gpu)
            })
        };
        let alpha = alpha_code(material.alpha);
        if material.alpha == AlphaMode::Opaque {
            solid_caster.get_or_insert_with(|| build("vs_uv_solid", None, &[]));
        } else {
            casters.entry((material.layers, alpha)).or_insert_with(|| {
                let constants = [("UV_LAYERS", f64::from(material.layers)), ("ALPHA_MODE", f64::from(alpha))];
                build("vs_uv_caster", Some("fs_uv_caster"), &constants)
            });
        }
    }
}

/// `ALPHA_MODE` of `uv_material.wgsl`.
pub(super) fn alpha_code(alpha: AlphaMode) -> u8 {
    match alpha {
        AlphaMode::Opaque => 0,
        AlphaMode::Mask(_) => 1,
        AlphaMode::Blend => 2,
    }
}
