//! Bind group 2 of fan shaders: what a material says where an asset has no channel.

use std::num::NonZeroU64;

use bytemuck::{Pod, Zeroable};
use fantex_mesh::{AlphaMode, Material, ToonInterpolation, ToonScale};

use crate::{Gpu, GpuError};

/// A material as `fan_geometry.wgsl` reads it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct MaterialRecord {
    base_color: [f32; 4],
    emission: [f32; 3],
    metallic: f32,
    roughness: f32,
    alpha_threshold: f32,
    unlit: u32,
    /// 0 for none.
    toon_stops: u32,
    /// 0 linear, 1 smooth, 2 constant.
    toon_interpolation: u32,
    pad: [u32; 3],
    /// Linear RGB and the place.
    toon: [[f32; 4]; ToonScale::MOST_STOPS],
}

impl MaterialRecord {
    pub(crate) fn new(material: &Material) -> Self {
        let alpha_threshold = if let AlphaMode::Mask(threshold) = material.alpha { threshold } else { 0.0 };
        let mut toon = [[0.0; 4]; ToonScale::MOST_STOPS];
        let stops = material.toon.iter().flat_map(|scale| &scale.stops);
        for (place, &(at, color)) in toon.iter_mut().zip(stops) {
            *place = color.extend(at).to_array();
        }
        let scale = material.toon.as_ref();
        Self {
            base_color: material.base_color.to_array(),
            emission: material.emission.to_array(),
            metallic: material.metallic,
            roughness: material.roughness,
            alpha_threshold,
            unlit: material.unlit.into(),
            toon_stops: scale.map_or(0, |scale| scale.stops.len().min(ToonScale::MOST_STOPS) as u32),
            toon_interpolation: match scale.map(|scale| scale.interpolation) {
                None | Some(ToonInterpolation::Linear) => 0,
                Some(ToonInterpolation::Smooth) => 1,
                Some(ToonInterpolation::Constant) => 2,
            },
            pad: [0; 3],
            toon,
        }
    }
}

/// All materials of a model, one of them bound at a time.
#[derive(Debug)]
pub(crate) struct FanMaterials {
    pub(crate) layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    /// Bytes from one material to the next.
    stride: u32,
}

impl FanMaterials {
    pub(crate) fn new(gpu: &Gpu, materials: &[Material]) -> Result<Self, GpuError> {
        let (device, limits) = (&gpu.device, gpu.limits());
        let stride =
            size_of::<MaterialRecord>().next_multiple_of(limits.min_uniform_buffer_offset_alignment as usize);
        let (bytes, allowed) =
            ((stride * materials.len()) as u64, limits.max_buffer_size.min(u32::MAX.into()));
        if bytes > allowed {
            return Err(gpu.too_large("the materials of a model", bytes, allowed, "bytes"));
        }
        let mut contents = vec![0; stride * materials.len()];
        for (place, material) in contents.chunks_exact_mut(stride).zip(materials) {
            place[..size_of::<MaterialRecord>()]
                .copy_from_slice(bytemuck::bytes_of(&MaterialRecord::new(material)));
        }
        let buffer = gpu.buffer("fan materials", &contents, wgpu::BufferUsages::UNIFORM);
        let size = NonZeroU64::new(size_of::<MaterialRecord>() as u64);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("fan material"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: size,
                },
                count: None,
            }],
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("fan material"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &buffer,
                    offset: 0,
                    size,
                }),
            }],
        });
        Ok(Self { layout, group, stride: stride as u32 })
    }

    /// Binds a material to group 2.
    pub(crate) fn bind(&self, pass: &mut wgpu::RenderPass<'_>, material: u32) {
        pass.set_bind_group(2, &self.group, &[material * self.stride]);
    }
}
