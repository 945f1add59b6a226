//! Materials for shaders: records, samplers, textures with their levels.

use std::collections::HashMap;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use fantex_base::Result;
use fantex_mesh::{AlphaMode, Material};
use fantex_scene::FilterOptions;
use fantex_texture::color::{srgb8_from_linear, unorm8};
use fantex_texture::material::{MaterialTextures, TextureLayer};
use fantex_texture::{ColorSpace, Filter, Image, ImageTexture, Samples, Wrap};
use glam::{Vec3, Vec4};
use half::f16;
use rayon::prelude::*;

use crate::Gpu;
use crate::gpu::{FILTERED, SAMPLED, SAMPLER, UNIFORM, texture_type};

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
    ) -> Result<Self> {
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
    let texture = texture_type(FILTERED, wgpu::TextureViewDimension::D2);
    let types = std::iter::once(UNIFORM).chain([texture; LAYERS]).chain([SAMPLER; LAYERS]);
    gpu.bind_layout("material", wgpu::ShaderStages::FRAGMENT, types)
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
    let views = textures.iter().map(wgpu::BindingResource::TextureView);
    let samplers = samplers.iter().map(wgpu::BindingResource::Sampler);
    let resources = std::iter::once(record.as_entire_binding()).chain(views).chain(samplers);
    gpu.bind_group("material", layout, resources)
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
        Filter::Trilinear | Filter::BicubicMipmaps => (FilterMode::Linear, true, 1),
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
    let texture = gpu.texture("no image", [1; 3], 1, wgpu::TextureFormat::Rgba8Unorm, SAMPLED);
    texture.create_view(&Default::default())
}

// Images with their levels as textures.

/// The textures of a model, each image once per way of use.
#[derive(Debug, Default)]
pub(super) struct TexturePool {
    views: HashMap<(*const ImageTexture, bool), wgpu::TextureView>,
    /// Keeps the images alive, so that their addresses are theirs alone.
    images: Vec<Arc<ImageTexture>>,
    /// Of all textures with their levels.
    pub(super) bytes: u64,
}

impl TexturePool {
    /// The texture of an image; where its alpha is the coverage of a texel, colours are multiplied by it, so that filters
    /// weigh them.
    pub(super) fn view(
        &mut self,
        gpu: &Gpu,
        image: &Arc<ImageTexture>,
        is_premultiplied: bool,
    ) -> Result<wgpu::TextureView> {
        let key = (Arc::as_ptr(image), is_premultiplied);
        if let Some(view) = self.views.get(&key) {
            return Ok(view.clone());
        }
        let view = upload(gpu, image, is_premultiplied)?.create_view(&Default::default());
        self.bytes += byte_len(image);
        self.views.insert(key, view.clone());
        self.images.push(Arc::clone(image));
        Ok(view)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Storage {
    Srgb8,
    Linear8,
    /// For images of more than 8 bits.
    Half,
}

impl Storage {
    fn of(image: &Image) -> Self {
        match (&image.samples, image.space) {
            (Samples::U8(_), ColorSpace::Srgb) => Self::Srgb8,
            (Samples::U8(_), ColorSpace::Linear) => Self::Linear8,
            (Samples::U16(_) | Samples::F32(_), _) => Self::Half,
        }
    }

    fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::Srgb8 => wgpu::TextureFormat::Rgba8UnormSrgb,
            Self::Linear8 => wgpu::TextureFormat::Rgba8Unorm,
            Self::Half => wgpu::TextureFormat::Rgba16Float,
        }
    }

    fn texel_bytes(self) -> u32 {
        match self {
            Self::Srgb8 | Self::Linear8 => 4,
            Self::Half => 8,
        }
    }

    /// The bytes of a linear texel.
    fn push(self, [r, g, b, a]: [f32; 4], bytes: &mut Vec<u8>) {
        match self {
            Self::Srgb8 => {
                bytes.extend([srgb8_from_linear(r), srgb8_from_linear(g), srgb8_from_linear(b), unorm8(a)]);
            }
            Self::Linear8 => bytes.extend([r, g, b, a].map(unorm8)),
            Self::Half => {
                let halves = [r, g, b, a].map(|v| f16::from_f32(v.clamp(-65_504.0, 65_504.0)));
                bytes.extend_from_slice(bytemuck::bytes_of(&halves));
            }
        }
    }
}

/// Bytes of an image with its levels on the device.
fn byte_len(image: &ImageTexture) -> u64 {
    let texel_bytes = u64::from(Storage::of(image.level(0)).texel_bytes());
    let texels = |level| u64::from(image.level(level).width) * u64::from(image.level(level).height);
    (0..image.level_count()).map(texels).sum::<u64>() * texel_bytes
}

fn upload(gpu: &Gpu, image: &ImageTexture, is_premultiplied: bool) -> Result<wgpu::Texture> {
    let [width, height] = image.size();
    let allowed = gpu.limits().max_texture_dimension_2d;
    gpu.allow("a texture", width.max(height), allowed, "texels along a side")?;
    let storage = Storage::of(image.level(0));
    let levels = image.level_count() as u32;
    let texture = gpu.texture("image", [width, height, 1], levels, storage.format(), SAMPLED);
    for level in 0..image.level_count() {
        let texels = image.level(level);
        let bytes = encode(texels, storage, is_premultiplied && texels.has_alpha());
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level as u32, ..texture.as_image_copy() },
            &bytes,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(texels.width * storage.texel_bytes()),
                rows_per_image: None,
            },
            wgpu::Extent3d { width: texels.width, height: texels.height, depth_or_array_layers: 1 },
        );
    }
    Ok(texture)
}

/// The rows of an image, row by row without gaps.
fn encode(image: &Image, storage: Storage, is_premultiplied: bool) -> Vec<u8> {
    if let (Samples::U8(samples), false) = (&image.samples, is_premultiplied) {
        match image.channels {
            4 => return samples.clone(),
            3 => {
                let (rgb, _) = samples.as_chunks::<3>();
                return rgb.par_iter().flat_map_iter(|&[r, g, b]| [r, g, b, 255]).collect();
            }
            _ => {}
        }
    }
    let row = |y: u32| {
        let mut bytes = Vec::with_capacity((image.width * storage.texel_bytes()) as usize);
        for x in 0..image.width {
            let [r, g, b, a] = image.linear_texel(x, y);
            let weight = if is_premultiplied { a } else { 1.0 };
            storage.push([r * weight, g * weight, b * weight, a], &mut bytes);
        }
        bytes
    };
    (0..image.height).into_par_iter().flat_map_iter(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shader::layout_check::{assert_same_layout, fields};

    #[test]
    fn records_are_laid_out_as_shaders_read_them() {
        let material = fields!(MaterialRecord: base_color, emission, metallic, roughness, normal_scale,
            occlusion_strength, alpha_threshold, unlit, is_premultiplied, layers);
        assert_same_layout("uv", "UvMaterial", size_of::<MaterialRecord>(), material);
        let layer = fields!(LayerRecord: row_u, uv_set, row_v);
        assert_same_layout("uv", "UvLayer", size_of::<LayerRecord>(), layer);
    }

    #[test]
    fn texels_keep_their_values() {
        let image = |channels, samples| Image {
            width: 1,
            height: 1,
            channels,
            space: ColorSpace::Srgb,
            samples: Samples::U8(samples),
        };
        let plain = |channels, samples| encode(&image(channels, samples), Storage::Srgb8, false);
        assert_eq!(plain(4, vec![1, 2, 3, 4]), [1, 2, 3, 4]);
        assert_eq!(plain(3, vec![1, 2, 3]), [1, 2, 3, 255]);
        assert_eq!(plain(1, vec![77]), [77, 77, 77, 255]);
        assert_eq!(plain(2, vec![77, 9]), [77, 77, 77, 9]);
    }

    #[test]
    fn coverage_weighs_the_light_not_the_bytes() {
        let image = Image {
            width: 1,
            height: 1,
            channels: 4,
            space: ColorSpace::Srgb,
            samples: Samples::U8(vec![255, 188, 0, 128]),
        };
        // 128 of 255 is a little more than a half: of white 188 in sRGB, of 188 (a half) 138.
        assert_eq!(encode(&image, Storage::Srgb8, true), [188, 138, 0, 128]);
    }
}
