//! The bind groups that all shaders of a frame share, and the formats of its targets.

use std::num::NonZeroU64;

use wgpu::{
    BindingType, BufferBindingType, SamplerBindingType, ShaderStages, TextureSampleType, TextureViewDimension,
};

/// Linear light, premultiplied by the opacity.
pub(crate) const LIGHT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Reversed depth.
pub(crate) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Nearness to the lamp.
pub(crate) const SHADOW_FORMAT: wgpu::TextureFormat = DEPTH_FORMAT;

/// The layouts of group 0.
#[derive(Debug)]
pub struct FrameLayout {
    surfaces: wgpu::BindGroupLayout,
    casters: wgpu::BindGroupLayout,
}

impl FrameLayout {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let layout = |label: &str, entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
        };
        let light = TextureSampleType::Float { filterable: true };
        let surfaces = layout(
            "frame",
            &[
                entry(
                    0,
                    BindingType::Buffer {
                        ty: BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                ),
                entry(1, storage()),
                entry(2, storage()),
                entry(3, texture(TextureSampleType::Depth, TextureViewDimension::D2Array)),
                entry(4, texture(light, TextureViewDimension::Cube)),
                entry(5, texture(light, TextureViewDimension::Cube)),
                entry(6, texture(light, TextureViewDimension::CubeArray)),
                entry(7, texture(light, TextureViewDimension::D2)),
                entry(8, texture(light, TextureViewDimension::D2Array)),
                entry(9, BindingType::Sampler(SamplerBindingType::Filtering)),
            ],
        );
        let casters = layout(
            "caster",
            &[entry(
                0,
                BindingType::Buffer {
                    ty: BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: NonZeroU64::new(64),
                },
            )],
        );
        Self { surfaces, casters }
    }

    /// Of shaders that begin with [`crate::shader::FRAME`].
    pub fn surfaces(&self) -> &wgpu::BindGroupLayout {
        &self.surfaces
    }

    /// Of shaders that begin with [`crate::shader::CASTER`]; one buffer with a dynamic offset.
    pub fn casters(&self) -> &wgpu::BindGroupLayout {
        &self.casters
    }
}

fn entry(binding: u32, ty: BindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry { binding, visibility: ShaderStages::VERTEX_FRAGMENT, ty, count: None }
}

fn storage() -> BindingType {
    BindingType::Buffer {
        ty: BufferBindingType::Storage { read_only: true },
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

fn texture(sample_type: TextureSampleType, view_dimension: TextureViewDimension) -> BindingType {
    BindingType::Texture { sample_type, view_dimension, multisampled: false }
}
