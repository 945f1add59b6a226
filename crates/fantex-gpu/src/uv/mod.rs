//! Meshes with texture coordinates and materials of their own, the glTF way.
//!
//! ```text
//!  Mesh, MaterialTextures --Vertices--> buffers    (corners that agree are one vertex)
//!                         --TexturePool, UvMaterial--> one bind group per material
//!  per frame: opaque and cut-out materials one draw each, blended triangles sorted back to front
//! ```

mod materials;
mod vertices;

use std::collections::HashMap;

use fantex_base::{Error, Result};
use fantex_mesh::{AlphaMode, Material, Mesh, OpposedTriangles};
use fantex_scene::FilterOptions;
use fantex_texture::material::{
    LeftOut, MaterialTextures, load_material_textures_with_progress, preserve_coverage,
};
use materials::{TexturePool, UvMaterial, material_layout};
use vertices::{Attributes, MAX_UV_SETS, Vertices, used_uv_sets};

use crate::shader::{CASTER, UV, UV_CASTER, UV_MATERIAL, compose, compose_surface, module};
use crate::surface_pipeline::{Run, SortedTriangle, SortedTriangles, alpha_code};
use crate::{Blending, CasterPipeline, FrameContext, Gpu, Model, ModelSpace, SurfaceKey, SurfacePipeline};

/// A mesh with its own materials on the device.
#[derive(Debug)]
pub struct UvModel {
    space: ModelSpace,
    buffers: Buffers,
    /// What hides everything behind it, then what is cut out.
    solid: Vec<Run>,
    sorted: SortedTriangles,
    runs: Vec<Run>,
    /// Whether any triangles are opposed by others.
    has_opposed: bool,
    materials: Vec<UvMaterial>,
    layout: wgpu::BindGroupLayout,
    filter: FilterOptions,
    pipelines: Pipelines,
    texture_bytes: u64,
    left_out: LeftOut,
    /// Of the current frame.
    key: Option<SurfaceKey>,
}

/// Share of the time of loading that decoding takes.
const DECODED_SHARE: f32 = 0.7;

impl UvModel {
    /// Decodes the images that the materials use and uploads everything, as the CPU renderer's surface does. Images that are missing or broken
    /// are [left out](Self::left_out).
    ///
    /// # Errors
    /// An image takes more memory than there is, or a disk fails; the device cannot take the model.
    pub fn load(gpu: &Gpu, mesh: &Mesh) -> Result<Self> {
        Self::load_with_progress(gpu, mesh, &|_| {})
    }

    /// The same; `progress` is told the share that is done, 0..1, from any thread.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_with_progress(gpu: &Gpu, mesh: &Mesh, progress: &(dyn Fn(f32) + Sync)) -> Result<Self> {
        let decoded = |share: f32| progress(DECODED_SHARE * share);
        let (mut textures, left_out) = load_material_textures_with_progress(mesh, &decoded)?;
        preserve_coverage(&mesh.materials, &mut textures);
        progress(DECODED_SHARE);
        let model = Self::new(gpu, mesh, &textures)?;
        progress(1.0);
        Ok(Self { left_out, ..model })
    }

    /// Images of the model that could not be read.
    pub fn left_out(&self) -> &LeftOut {
        &self.left_out
    }

    /// Uploads a mesh with decoded textures, an entry per material.
    ///
    /// # Errors
    /// The device cannot take the model.
    pub fn new(gpu: &Gpu, mesh: &Mesh, textures: &[MaterialTextures]) -> Result<Self> {
        let uv_sets = used_uv_sets(textures);
        if uv_sets.len() > MAX_UV_SETS {
            return Err(Error::unsupported(format!(
                "the textures use {} sets of texture coordinates, the GPU renderer takes {MAX_UV_SETS}; the CPU renderer takes any \
                 number",
                uv_sets.len()
            )));
        }
        let layout = material_layout(gpu);
        let filter = FilterOptions::default();
        let (default_material, no_textures) = ([Material::default()], [MaterialTextures::default()]);
        let (all_materials, all_textures) = match mesh.materials.len() {
            count if count > 0 && count == textures.len() => (&mesh.materials[..], textures),
            _ => (&default_material[..], &no_textures[..]),
        };
        let mut pool = TexturePool::default();
        let materials = all_materials
            .iter()
            .zip(all_textures)
            .map(|(material, textures)| {
                UvMaterial::new(gpu, &layout, &mut pool, material, textures, &uv_sets, &filter)
            })
            .collect::<Result<Vec<_>>>()?;
        let vertices = Vertices::of_mesh(mesh, textures, &uv_sets);
        let opposed = OpposedTriangles::of(&mesh.triangles);
        let (solid, indices, sorted) = arrange(mesh, &opposed, &vertices, &materials);
        Ok(Self {
            space: ModelSpace::of_mesh(mesh),
            buffers: Buffers::new(gpu, &vertices, &indices, &sorted)?,
            solid,
            sorted,
            runs: Vec::new(),
            has_opposed: !opposed.is_empty(),
            materials,
            layout,
            filter,
            pipelines: Pipelines::new(gpu),
            texture_bytes: pool.bytes,
            left_out: LeftOut::default(),
            key: None,
        })
    }

    /// Bytes of its textures with their levels in graphics memory.
    pub fn texture_bytes(&self) -> u64 {
        self.texture_bytes
    }

    fn draw_surface(&self, pass: &mut wgpu::RenderPass<'_>, part: &Run) {
        let Some(frame) = self.key else { return };
        let key = PipelineKey::new(&self.materials[part.material as usize], part.is_opposed, frame);
        self.draw(pass, part, self.pipelines.surfaces.get(&key));
    }

    fn draw_caster(&self, pass: &mut wgpu::RenderPass<'_>, part: &Run) {
        let key = caster_key(&self.materials[part.material as usize]);
        self.draw(pass, part, self.pipelines.casters.get(&key));
    }

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, part: &Run, pipeline: Option<&wgpu::RenderPipeline>) {
        if let Some(pipeline) = pipeline {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(1, &self.materials[part.material as usize].group, &[]);
            pass.draw_indexed(part.indices.clone(), 0, 0..1);
        }
    }
}

impl Model for UvModel {
    fn space(&self) -> &ModelSpace {
        &self.space
    }

    fn prepare(
        &mut self,
        gpu: &Gpu,
        _encoder: &mut wgpu::CommandEncoder,
        frame: &FrameContext<'_>,
    ) -> Result<()> {
        if self.filter != frame.options.filter {
            self.filter = frame.options.filter;
            let (layout, filter) = (&self.layout, &self.filter);
            self.materials.iter_mut().for_each(|material| material.set_filter(gpu, layout, filter));
        }
        self.key = Some(frame.key);
        for material in &self.materials {
            for is_opposed in [false, true].into_iter().take(1 + usize::from(self.has_opposed)) {
                let key = PipelineKey::new(material, is_opposed, frame.key);
                self.pipelines.make_surface(gpu, &self.layout, &self.buffers, key);
            }
            if frame.draws_shadows {
                self.pipelines.make_caster(gpu, &self.layout, &self.buffers, material);
            }
        }
        if let Some(indices) = &self.buffers.sorted
            && let Some((corners, runs)) = self.sorted.sort(frame.view)
        {
            // Not by the frame's commands: these are dropped where the frame fails, and the order is not found again.
            gpu.queue.write_buffer(indices, 0, bytemuck::cast_slice(&corners));
            self.runs = runs;
        }
        Ok(())
    }

    fn draw_casters(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.buffers.set_vertices(pass);
        pass.set_index_buffer(self.buffers.indices.slice(..), wgpu::IndexFormat::Uint32);
        self.solid.iter().for_each(|part| self.draw_caster(pass, part));
        if let Some(sorted) = &self.buffers.sorted {
            pass.set_index_buffer(sorted.slice(..), wgpu::IndexFormat::Uint32);
            self.runs.iter().for_each(|run| self.draw_caster(pass, run));
        }
    }

    fn draw_opaque(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.buffers.set_vertices(pass);
        pass.set_index_buffer(self.buffers.indices.slice(..), wgpu::IndexFormat::Uint32);
        self.solid.iter().for_each(|part| self.draw_surface(pass, part));
    }

    fn draw_layered(&self, pass: &mut wgpu::RenderPass<'_>) {
        let Some(sorted) = &self.buffers.sorted else { return };
        self.buffers.set_vertices(pass);
        pass.set_index_buffer(sorted.slice(..), wgpu::IndexFormat::Uint32);
        self.runs.iter().for_each(|run| self.draw_surface(pass, run));
    }
}

/// Solid parts with their indices, one after the other, and the triangles that are blended.
fn arrange(
    mesh: &Mesh,
    opposed: &OpposedTriangles,
    vertices: &Vertices,
    materials: &[UvMaterial],
) -> (Vec<Run>, Vec<[u32; 3]>, SortedTriangles) {
    // Per material those that are not opposed by others and those that are.
    let mut of_material: Vec<[Vec<[u32; 3]>; 2]> = vec![Default::default(); materials.len()];
    let mut blended = Vec::new();
    for (t, &corners) in vertices.triangles.iter().enumerate() {
        let (material, is_opposed) = (mesh.material_of(t).min(materials.len() - 1), opposed.contains(t));
        if materials[material].alpha == AlphaMode::Blend {
            let [a, b, c] = mesh.triangle_positions(t);
            let centre = (a + b + c) / 3.0;
            blended.push(SortedTriangle { centre, corners, material: material as u32, is_opposed });
        } else {
            of_material[material][usize::from(is_opposed)].push(corners);
        }
    }
    let mut order: Vec<usize> = (0..materials.len()).collect();
    order.sort_by_key(|&m| {
        (alpha_code(materials[m].alpha), materials[m].is_double_sided, materials[m].layers)
    });
    let (mut parts, mut indices) = (Vec::new(), Vec::new());
    for material in order {
        for (triangles, is_opposed) in of_material[material].iter().zip([false, true]) {
            let first = 3 * indices.len() as u32;
            indices.extend(triangles);
            let last = 3 * indices.len() as u32;
            if first < last {
                parts.push(Run { material: material as u32, is_opposed, indices: first..last });
            }
        }
    }
    (parts, indices, SortedTriangles::new(blended))
}

// Pipelines of meshes with their own materials, made when they are first needed.

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct PipelineKey {
    frame: SurfaceKey,
    layers: u32,
    alpha: u32,
    is_double_sided: bool,
}

/// Pipelines, made when they are first needed.
#[derive(Debug)]
struct Pipelines {
    surface_module: wgpu::ShaderModule,
    caster_module: wgpu::ShaderModule,
    surfaces: HashMap<PipelineKey, wgpu::RenderPipeline>,
    /// By [`caster_key`].
    casters: HashMap<(u32, u32), wgpu::RenderPipeline>,
}

impl PipelineKey {
    /// `is_opposed`: for triangles that are not seen from behind, whatever the material says.
    fn new(material: &UvMaterial, is_opposed: bool, frame: SurfaceKey) -> Self {
        Self {
            frame,
            layers: material.layers,
            alpha: alpha_code(material.alpha),
            is_double_sided: material.is_double_sided && !is_opposed,
        }
    }
}

impl Pipelines {
    fn new(gpu: &Gpu) -> Self {
        Self {
            surface_module: module(&gpu.device, "mesh", &compose_surface(&[UV_MATERIAL, UV])),
            caster_module: module(&gpu.device, "mesh shadow", &compose(&[CASTER, UV_MATERIAL, UV_CASTER])),
            surfaces: HashMap::new(),
            casters: HashMap::new(),
        }
    }

    fn make_surface(
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
                    fragment: if key.alpha == 1 { "fs_uv_cut_out" } else { "fs_uv" },
                    buffers,
                    groups: &[layout],
                    constants: &[("UV_LAYERS", f64::from(key.layers)), ("ALPHA_MODE", f64::from(key.alpha))],
                    blending: if key.alpha == 2 { Blending::Over } else { Blending::Opaque },
                    is_double_sided: key.is_double_sided,
                    topology: wgpu::PrimitiveTopology::TriangleList,
                };
                pipeline.build(gpu, key.frame)
            })
        });
    }

    fn make_caster(
        &mut self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        buffers: &Buffers,
        material: &UvMaterial,
    ) {
        let Self { caster_module, casters, .. } = self;
        let (layers, alpha) = caster_key(material);
        casters.entry((layers, alpha)).or_insert_with(|| {
            let constants = [("UV_LAYERS", f64::from(layers)), ("ALPHA_MODE", f64::from(alpha))];
            let is_solid = alpha == 0;
            buffers.with_layout(|buffers| {
                let pipeline = CasterPipeline {
                    label: "mesh shadow",
                    module: caster_module,
                    vertex: if is_solid { "vs_uv_solid" } else { "vs_uv_caster" },
                    fragment: (!is_solid).then_some("fs_uv_caster"),
                    buffers,
                    groups: &[layout],
                    constants: if is_solid { &[] } else { &constants },
                };
                pipeline.build(gpu)
            })
        });
    }
}

/// Layers and alpha mode, on which shadows depend; no layers where a material is opaque.
fn caster_key(material: &UvMaterial) -> (u32, u32) {
    match alpha_code(material.alpha) {
        0 => (0, 0),
        alpha => (material.layers, alpha),
    }
}

#[derive(Debug)]
struct Buffers {
    positions: wgpu::Buffer,
    attributes: wgpu::Buffer,
    uv: Option<wgpu::Buffer>,
    uv_pairs: usize,
    /// Of what is not blended.
    indices: wgpu::Buffer,
    /// Of what is blended, in drawing order, if there is any.
    sorted: Option<wgpu::Buffer>,
}

impl Buffers {
    /// Uploads vertices and the indices of what is not blended.
    fn new(gpu: &Gpu, vertices: &Vertices, indices: &[[u32; 3]], sorted: &SortedTriangles) -> Result<Self> {
        let allowed = gpu.limits().max_buffer_size;
        let buffer = |label: &str, contents: &[u8], usage| {
            gpu.allow("the mesh", contents.len() as u64, allowed, "bytes of a buffer")?;
            Ok(gpu.buffer(label, contents, usage))
        };
        let vertex = wgpu::BufferUsages::VERTEX;
        let has_uv = vertices.uv_pairs > 0;
        let uv = has_uv.then(|| buffer("texture coordinates", bytemuck::cast_slice(&vertices.uv), vertex));
        Ok(Self {
            positions: buffer("positions", bytemuck::cast_slice(&vertices.positions), vertex)?,
            attributes: buffer("attributes", bytemuck::cast_slice(&vertices.attributes), vertex)?,
            uv: uv.transpose()?,
            uv_pairs: vertices.uv_pairs,
            indices: buffer("triangles", bytemuck::cast_slice(indices), wgpu::BufferUsages::INDEX)?,
            sorted: sorted.index_buffer(gpu),
        })
    }

    fn set_vertices(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_vertex_buffer(0, self.positions.slice(..));
        pass.set_vertex_buffer(1, self.attributes.slice(..));
        pass.set_vertex_buffer(2, self.uv.as_ref().unwrap_or(&self.attributes).slice(..));
    }

    /// Calls `with` with the layout of the vertex buffers. Without a second pair of texture coordinates the first is read
    /// twice, and without any the attributes stand in for them: no texture asks.
    fn with_layout<R>(&self, with: impl FnOnce(&[Option<wgpu::VertexBufferLayout<'_>>]) -> R) -> R {
        use wgpu::VertexFormat::Float32x4;
        let buffer = |array_stride: usize, attributes| wgpu::VertexBufferLayout {
            array_stride: array_stride as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes,
        };
        let position = wgpu::vertex_attr_array![0 => Float32x3];
        let attributes = wgpu::vertex_attr_array![1 => Snorm16x4, 2 => Snorm16x4, 5 => Unorm16x4];
        let (stride, second) = match self.uv_pairs {
            0 => (size_of::<Attributes>(), 0),
            1 => (16, 0),
            _ => (32, 16),
        };
        let uv = [(3, 0), (4, second)].map(|(shader_location, offset)| wgpu::VertexAttribute {
            format: Float32x4,
            offset,
            shader_location,
        });
        with(&[
            Some(buffer(12, &position)),
            Some(buffer(size_of::<Attributes>(), &attributes)),
            Some(buffer(stride, &uv)),
        ])
    }
}
