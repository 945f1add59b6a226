//! All that group 0 binds, kept from frame to frame.

use std::num::NonZeroU64;

use bytemuck::Zeroable;
use fantex_scene::{AmbientLight, Background, Light, Lights, ToneMap};
use glam::{Vec3, Vec4};

use super::environment::{EnvironmentTextures, split_sum_texture};
use super::lamps::lamp_records;
use super::records::{FrameRecord, LampRecord, ShadowFaceRecord};
use super::shadow_maps::{ShadowFace, ShadowMaps};
use super::slides::SlideTextures;
use crate::{DrawOptions, Gpu, GpuError, ModelSpace, View};

/// What shaders are given, and where it lies.
#[derive(Debug)]
pub(crate) struct FrameState {
    uniforms: wgpu::Buffer,
    lamps: wgpu::Buffer,
    faces: wgpu::Buffer,
    casters: wgpu::Buffer,
    /// Bytes from one caster's uniforms to the next.
    caster_stride: u64,
    environment: EnvironmentTextures,
    slides: SlideTextures,
    shadows: ShadowMaps,
    split_sum: wgpu::TextureView,
    sampler: wgpu::Sampler,
    groups: Option<[wgpu::BindGroup; 2]>,
}

/// Bytes of the uniforms of one caster: a matrix.
const CASTER_BYTES: u64 = 64;

impl FrameState {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let caster_stride =
            CASTER_BYTES.next_multiple_of(u64::from(gpu.limits().min_uniform_buffer_offset_alignment));
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("smooth"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self {
            uniforms: buffer(gpu, size_of::<FrameRecord>() as u64, wgpu::BufferUsages::UNIFORM),
            lamps: buffer(gpu, size_of::<LampRecord>() as u64, wgpu::BufferUsages::STORAGE),
            faces: buffer(gpu, size_of::<ShadowFaceRecord>() as u64, wgpu::BufferUsages::STORAGE),
            casters: buffer(gpu, caster_stride, wgpu::BufferUsages::UNIFORM),
            caster_stride,
            environment: EnvironmentTextures::none(gpu),
            slides: SlideTextures::none(gpu),
            shadows: ShadowMaps::none(gpu),
            split_sum: split_sum_texture(gpu),
            sampler,
            groups: None,
        }
    }

    /// Brings everything up to date for a frame; whether shadow maps must be drawn.
    pub(crate) fn update(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameInputs<'_>,
    ) -> Result<bool, GpuError> {
        let lamps: &[Light] = if frame.options.shading.is_lit() { &frame.lights.lamps } else { &[] };
        let mut records = lamp_records(lamps, &frame.space.world_from_mesh);
        let shadows = self.shadows.update(gpu, lamps, &records, frame.space, frame.shadow_revision)?;
        for (record, [first, count]) in records.iter_mut().zip(&self.shadows.of_lamps) {
            (record.first_face, record.face_count) = (*first, *count);
        }
        let environment = frame.lights.ambient.environment.as_ref();
        let mut rebind = self.environment.update(gpu, environment) | shadows.moved;
        rebind |= self.slides.update(gpu, lamps, frame.options.seconds);
        let faces: Vec<_> = self.shadows.faces.iter().map(|face| face.record).collect();
        let storage = wgpu::BufferUsages::STORAGE;
        rebind |= make_room(gpu, &mut self.lamps, size_of_val(&records[..]) as u64, storage);
        rebind |= make_room(gpu, &mut self.faces, size_of_val(&faces[..]) as u64, storage);
        let casters = self.caster_stride * self.shadows.faces.len() as u64;
        rebind |= make_room(gpu, &mut self.casters, casters, wgpu::BufferUsages::UNIFORM);
        let uniforms = frame.record(records.len() as u32);
        let mut uploads = Uploads::default();
        uploads.add(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        uploads.add(&self.lamps, 0, bytemuck::cast_slice(&records));
        if shadows.stale {
            uploads.add(&self.faces, 0, bytemuck::cast_slice(&faces));
            for (i, face) in self.shadows.faces.iter().enumerate() {
                let offset = self.caster_stride * i as u64;
                uploads.add(&self.casters, offset, bytemuck::bytes_of(&face.clip_from_mesh));
            }
        }
        uploads.record(gpu, encoder);
        if rebind || self.groups.is_none() {
            self.groups = Some(self.bind(gpu));
        }
        Ok(shadows.stale)
    }

    /// Group 0 of surfaces; nothing before the first update.
    pub(crate) fn surface_group(&self) -> Option<&wgpu::BindGroup> {
        self.groups.as_ref().map(|[surfaces, _]| surfaces)
    }

    /// The shadow maps with group 0 of casters and their offsets into it.
    pub(crate) fn shadow_faces(&self) -> impl Iterator<Item = (&ShadowFace, &wgpu::BindGroup, u32)> {
        let group = self.groups.as_ref().map(|[_, casters]| casters);
        let offset = |i: usize| (self.caster_stride * i as u64) as u32;
        self.shadows.faces.iter().enumerate().filter_map(move |(i, face)| Some((face, group?, offset(i))))
    }

    /// Has shadow maps drawn again in the next frame, because this one came to nothing.
    pub(crate) fn forget_shadows(&mut self) {
        self.shadows.forget();
    }

    fn bind(&self, gpu: &Gpu) -> [wgpu::BindGroup; 2] {
        use wgpu::BindingResource::{Sampler, TextureView};
        let resources = [
            self.uniforms.as_entire_binding(),
            self.lamps.as_entire_binding(),
            self.faces.as_entire_binding(),
            TextureView(&self.shadows.view),
            TextureView(&self.environment.sharp),
            TextureView(&self.environment.first),
            TextureView(&self.environment.rough),
            TextureView(&self.split_sum),
            TextureView(&self.slides.view),
            Sampler(&self.sampler),
        ];
        let entries: Vec<_> = resources
            .into_iter()
            .zip(0..)
            .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let surfaces = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: gpu.frame_layout().surfaces(),
            entries: &entries,
        });
        let casters = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("caster"),
            layout: gpu.frame_layout().casters(),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &self.casters,
                    offset: 0,
                    size: NonZeroU64::new(CASTER_BYTES),
                }),
            }],
        });
        [surfaces, casters]
    }
}

/// Small uploads of a frame through one buffer, ordered with its commands.
#[derive(Debug, Default)]
struct Uploads<'a> {
    bytes: Vec<u8>,
    /// Offset here, target, offset there, number of bytes.
    copies: Vec<(u64, &'a wgpu::Buffer, u64, u64)>,
}

impl<'a> Uploads<'a> {
    fn add(&mut self, target: &'a wgpu::Buffer, offset: u64, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.copies.push((self.bytes.len() as u64, target, offset, bytes.len() as u64));
            self.bytes.extend_from_slice(bytes);
        }
    }

    fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) {
        let staged = gpu.buffer("frame", &self.bytes, wgpu::BufferUsages::COPY_SRC);
        for &(from, target, to, size) in &self.copies {
            encoder.copy_buffer_to_buffer(&staged, from, target, to, size);
        }
    }
}

/// What a frame is made of, as far as the shaders of all models want to know it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameInputs<'a> {
    pub(crate) view: &'a View,
    pub(crate) lights: &'a Lights,
    pub(crate) options: &'a DrawOptions,
    pub(crate) space: &'a ModelSpace,
    pub(crate) shadow_revision: u64,
    /// Whether the target leaves it to the shader to encode sRGB.
    pub(crate) encode_srgb: bool,
}

impl FrameInputs<'_> {
    fn record(&self, lamp_count: u32) -> FrameRecord {
        let Self { view, lights, options, space, .. } = self;
        let eye = view.eye.as_vec3();
        let [ray_corner, ray_right, ray_down] = view.rays();
        let [width, height] = view.size.map(|n| n as f32);
        let (tone_map, tone_white) = match options.tone_map {
            Some(ToneMap::Clip) => (0, 1.0),
            Some(ToneMap::Reinhard { white }) => (1, white),
            Some(ToneMap::Filmic) => (2, 1.0),
            None => (3, 1.0),
        };
        let mut record = FrameRecord {
            clip_from_offset: view.clip_from_offset(),
            eye,
            exposure: options.exposure,
            eye_rest: (view.eye - eye.as_dvec3()).as_vec3(),
            world_per_mesh: space.world_from_mesh.scale as f32,
            ray_corner,
            width,
            ray_right,
            height,
            ray_down,
            max_anisotropy: options.filter.max_anisotropy,
            lamp_count,
            overlay: options.overlay.code(),
            tone_map,
            tone_white,
            encode_srgb: u32::from(self.encode_srgb),
            seconds: options.seconds,
            ..FrameRecord::zeroed()
        };
        set_background(&mut record, &options.background);
        set_ambient(&mut record, &lights.ambient);
        record
    }
}

fn set_background(record: &mut FrameRecord, background: &Background) {
    let (top, bottom) = match *background {
        Background::Transparent => (Vec4::ZERO, Vec4::ZERO),
        Background::Color(color) => (color.extend(1.0), color.extend(1.0)),
        Background::Gradient { top, bottom } => (top.extend(1.0), bottom.extend(1.0)),
        Background::Environment { blur } => {
            record.background_is_light = 1;
            record.background_blur = blur;
            (Vec4::W, Vec4::W)
        }
    };
    (record.background_top, record.background_bottom) = (top, bottom);
}

fn set_ambient(record: &mut FrameRecord, ambient: &AmbientLight) {
    (record.ambient_sky, record.ambient_ground, record.ambient_up) =
        (ambient.sky, ambient.ground, ambient.up);
    if let Some(environment) = &ambient.environment {
        let turn = -environment.rotation_degrees.to_radians();
        (record.environment_sine, record.environment_cosine) = turn.sin_cos();
        record.environment_strength = environment.strength;
        let coefficients = environment.map.irradiance().coefficients();
        record.harmonics = coefficients.map(|c: Vec3| c.extend(0.0));
    }
}

fn buffer(gpu: &Gpu, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("frame"),
        size,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Replaces a buffer that is too small; whether it was.
fn make_room(gpu: &Gpu, buffer: &mut wgpu::Buffer, bytes: u64, usage: wgpu::BufferUsages) -> bool {
    let is_small = buffer.size() < bytes;
    if is_small {
        *buffer = self::buffer(gpu, bytes.next_power_of_two(), usage);
    }
    is_small
}
