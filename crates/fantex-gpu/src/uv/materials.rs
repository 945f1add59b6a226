//! Materials as shaders want them.

use bytemuck::{Pod, Zeroable};
use fantex_mesh::{AlphaMode, Material};
use fantex_scene::FilterOptions;
use fantex_texture::material::{MaterialTextures, TextureLayer};
use fantex_texture::{Filter, Wrap};
use glam::{Vec3, Vec4};
use wgpu::util::DeviceExt;
use wgpu::{BindingType, SamplerBindingType, ShaderStages, TextureSampleType, TextureViewDimension};

use super::textures::TexturePool;
use crate::{Gpu, GpuError};

/// Textures that a material can have.
const LAYERS: usize = 5;

/// `UvLayer` of `uv_material.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct LayerRecord {
    row_u: Vec3,
    uv_set: u32,
    row_v: Vec3,
    pad: u32,
}

/// `UvMaterial` of `uv_material.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct MaterialRecord {
    base_color: Vec4,
    emission: Vec3,
    metallic: f32,
    roughness: f32,
    normal_scale: f32,
    occlusion_strength: f32,
    alpha_threshold: f32,
    unlit: u32,
    is_premultiplied: u32,
    pad: [u32; 2],
    layers: [LayerRecord; LAYERS],
}

/// A material on the device.
#[derive(Debug)]
pub(super) struct UvMaterial {
    /// Bits of the textures that it has, for `UV_LAYERS`.
    pub(super) layers: u32,
    pub(super) alpha: AlphaMode,
    pub(super) is_double_sided: bool,
    record: wgpu::Buffer,
    textures: [wgpu::TextureView; LAYERS],
    /// Wrap modes and magnification of each texture.
    looks: [([Wrap; 2], bool); LAYERS],
    pub(super) group: wgpu::BindGroup,
}

impl UvMaterial {
    /// Uploads a material; `uv_sets` are the sets that vertices have.
    pub(super) fn new(
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        pool: &mut TexturePool,
        material: &Material,
        textures: &MaterialTextures,
        uv_sets: &[usize],
        filter: &FilterOptions,
    ) -> Result<Self, GpuError> {
        let is_premultiplied = material.alpha != AlphaMode::Opaque;
        let all = by_layer(textures);
        let mut views = Vec::with_capacity(LAYERS);
        for (index, layer) in all.iter().enumerate() {
            views.push(match layer {
                Some(layer) => pool.view(gpu, &layer.texture, index == 0 && is_premultiplied)?,
                None => white(gpu),
            });
        }
        let record = MaterialRecord {
            base_color: material.base_color,
            emission: material.emission,
            metallic: material.metallic,
            roughness: material.roughness,
            normal_scale: material.normal_scale,
            occlusion_strength: material.occlusion_strength,
            alpha_threshold: if let AlphaMode::Mask(threshold) = material.alpha { threshold } else { 0.0 },
            unlit: u32::from(material.unlit),
            is_premultiplied: u32::from(is_premultiplied),
            pad: [0; 2],
            layers: all.map(|layer| layer_record(layer, uv_sets)),
        };
        let record = gpu.buffer("material", bytemuck::bytes_of(&record), wgpu::BufferUsages::UNIFORM);
        let textures: [wgpu::TextureView; LAYERS] = std::array::from_fn(|i| views[i].clone());
        let looks = all.map(|layer| layer.map_or(([Wrap::Clamp; 2], false), |l| (l.wrap, l.nearest)));
        let group = bind(gpu, layout, &record, &textures, &looks, filter);
        let bits = all.iter().zip(0..).map(|(layer, bit)| u32::from(layer.is_some()) << bit).sum();
        let (alpha, is_double_sided) = (material.alpha, material.double_sided);
        Ok(Self { layers: bits, alpha, is_double_sided, record, textures, looks, group })
    }

    /// Has the textures sampled by another filter.
    pub(super) fn set_filter(&mut self, gpu: &Gpu, layout: &wgpu::BindGroupLayout, filter: &FilterOptions) {
        self.group = bind(gpu, layout, &self.record, &self.textures, &self.looks, filter);
    }
}

/// In the order of `LAYER_...` in `uv_material.wgsl`.
fn by_layer(textures: &MaterialTextures) -> [Option<&TextureLayer>; LAYERS] {
    let MaterialTextures { base_color, metallic_roughness, normal, occlusion, emission } = textures;
    [base_color, metallic_roughness, normal, occlusion, emission].map(Option::as_ref)
}

fn layer_record(layer: Option<&TextureLayer>, uv_sets: &[usize]) -> LayerRecord {
    let Some(layer) = layer else {
        return LayerRecord { row_u: Vec3::X, uv_set: 0, row_v: Vec3::Y, pad: 0 };
    };
    let uv_set = uv_sets.iter().position(|&set| set == layer.uv_set).unwrap_or(0) as u32;
    LayerRecord { row_u: layer.uv_transform.row(0), uv_set, row_v: layer.uv_transform.row(1), pad: 0 }
}

/// The layout of group 1.
pub(super) fn material_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry = |binding: usize, ty| wgpu::BindGroupLayoutEntry {
        binding: binding as u32,
        visibility: ShaderStages::FRAGMENT,
        ty,
        count: None,
    };
    let record = BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let texture = BindingType::Texture {
        sample_type: TextureSampleType::Float { filterable: true },
        view_dimension: TextureViewDimension::D2,
        multisampled: false,
    };
    let sampler = BindingType::Sampler(SamplerBindingType::Filtering);
    let mut entries = vec![entry(0, record)];
    entries.extend((0..LAYERS).map(|i| entry(1 + i, texture)));
    entries.extend((0..LAYERS).map(|i| entry(1 + LAYERS + i, sampler)));
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("material"),
        entries: &entries,
    })
}

fn bind(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    record: &wgpu::Buffer,
    textures: &[wgpu::TextureView; LAYERS],
    looks: &[([Wrap; 2], bool); LAYERS],
    filter: &FilterOptions,
) -> wgpu::BindGroup {
    let samplers = looks.map(|(wrap, nearest)| sampler(gpu, wrap, nearest, filter));
    let mut resources = vec![record.as_entire_binding()];
    resources.extend(textures.iter().map(wgpu::BindingResource::TextureView));
    resources.extend(samplers.iter().map(wgpu::BindingResource::Sampler));
    let entries: Vec<_> = resources
        .into_iter()
        .zip(0..)
        .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("material"),
        layout,
        entries: &entries,
    })
}

/// The sampler of a texture. `nearest` asks for square texels where they are magnified, which the device allows only without
/// anisotropy.
fn sampler(gpu: &Gpu, wrap: [Wrap; 2], nearest: bool, options: &FilterOptions) -> wgpu::Sampler {
    use wgpu::{FilterMode, MipmapFilterMode};
    let [address_mode_u, address_mode_v] = wrap.map(|mode| match mode {
        // Models have no border mode.
        Wrap::Clamp | Wrap::Border => wgpu::AddressMode::ClampToEdge,
        Wrap::Repeat => wgpu::AddressMode::Repeat,
        Wrap::Mirror => wgpu::AddressMode::MirrorRepeat,
    });
    let (min_filter, mipmaps, probes) = match options.filter {
        Filter::Nearest => (FilterMode::Nearest, false, 1),
        Filter::Bilinear | Filter::Bicubic => (FilterMode::Linear, false, 1),
        Filter::Trilinear => (FilterMode::Linear, true, 1),
        Filter::Anisotropic | Filter::Ewa => {
            (FilterMode::Linear, true, options.max_anisotropy.clamp(1.0, 16.0) as u16)
        }
    };
    let mag_filter = if nearest { FilterMode::Nearest } else { min_filter };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("material"),
        address_mode_u,
        address_mode_v,
        mag_filter,
        min_filter,
        mipmap_filter: if mipmaps { MipmapFilterMode::Linear } else { MipmapFilterMode::Nearest },
        lod_max_clamp: if mipmaps { 32.0 } else { 0.0 },
        anisotropy_clamp: if mag_filter == FilterMode::Linear { probes } else { 1 },
        ..Default::default()
    })
}

/// A texture for channels without one, which is not sampled.
fn white(gpu: &Gpu) -> wgpu::TextureView {
    let descriptor = wgpu::TextureDescriptor {
        label: Some("no image"),
        size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let order = wgpu::util::TextureDataOrder::LayerMajor;
    let texture = gpu.device.create_texture_with_data(&gpu.queue, &descriptor, order, &[255; 4]);
    texture.create_view(&Default::default())
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::*;
    use crate::shader::layout_check::assert_same_layout;

    #[test]
    fn records_are_laid_out_as_shaders_read_them() {
        macro_rules! fields {
            ($record:ty: $($field:ident),* $(,)?) => {
                &[$((stringify!($field), offset_of!($record, $field))),*]
            };
        }
        let material = fields!(MaterialRecord: base_color, emission, metallic, roughness, normal_scale,
            occlusion_strength, alpha_threshold, unlit, is_premultiplied, layers);
        assert_same_layout("uv", "UvMaterial", size_of::<MaterialRecord>(), material);
        let layer = fields!(LayerRecord: row_u, uv_set, row_v);
        assert_same_layout("uv", "UvLayer", size_of::<LayerRecord>(), layer);
    }
}
