//! Bind group 0 of all shaders of a frame: camera, lamps, surroundings, shadow maps.

mod environment;
mod lights;

use std::num::NonZeroU64;

use bytemuck::{Pod, Zeroable};
use environment::{EnvironmentTextures, split_sum_texture};
use fantex_base::Result;
use fantex_scene::{AmbientLight, Background, Camera, Light, Lights, ToneMap};
use glam::{DVec3, Mat3, Mat4, Vec3, Vec4};
use lights::{CookieTextures, ShadowFace, ShadowMaps, lamp_records};

use crate::gpu::{FILTERED, SAMPLER, STORAGE, UNIFORM, dynamic_uniform, texture_type};
use crate::{DrawOptions, Gpu, ModelSpace};

// The camera in mesh space.

/// A perspective view of a model, mesh space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Columns and rows of the picture, at least 1.
    pub size: [u32; 2],
    /// The pinhole.
    pub eye: DVec3,
    /// Right, up and backward (towards the viewer) unit vectors as columns.
    pub axes: Mat3,
    /// Vertical opening angle in radians.
    pub fov_radians: f32,
    /// Depth of the near plane.
    pub near: f32,
}

/// Nearer than this share of the farthest point's depth nothing is drawn, so that depth keeps its digits.
const NEAREST_SHARE: f64 = 1e-5;

impl View {
    /// The view of a camera without defect onto `size` pixels.
    pub fn new(camera: &Camera, size: [u32; 2], space: &ModelSpace) -> Self {
        let frame = space.world_from_mesh;
        let eye = (camera.eye - frame.offset) / frame.scale;
        let axes = camera.axes();
        Self {
            size,
            eye,
            axes: axes.as_mat3(),
            fov_radians: camera.fov_degrees.to_radians() as f32,
            near: near_depth(space, eye, -axes.z_axis) as f32,
        }
    }

    /// Pixels per unit of length at depth one, facing the camera.
    pub fn focal_pixels(&self) -> f32 {
        0.5 * self.size[1] as f32 / (0.5 * self.fov_radians).tan()
    }

    /// From offsets from the eye to clip space. Depth is reversed and has no far end: `near / depth`.
    pub fn clip_from_offset(&self) -> Mat4 {
        let [width, height] = self.size.map(|n| n as f32);
        let focal = 1.0 / (0.5 * self.fov_radians).tan();
        let [right, up, backward] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        Mat4::from_cols(
            (right * (focal * height / width)).extend(0.0),
            (up * focal).extend(0.0),
            Vec3::ZERO.extend(self.near),
            (-backward).extend(0.0),
        )
        .transpose()
    }

    /// The (not normalised) direction through the picture's top left corner, and its change per pixel to the right and
    /// downwards.
    pub fn rays(&self) -> [Vec3; 3] {
        let [width, height] = self.size.map(|n| n as f32);
        let [right, up, backward] = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        let pixel = 1.0 / self.focal_pixels();
        let [right, down] = [right * pixel, up * -pixel];
        [-backward - right * (0.5 * width) - down * (0.5 * height), right, down]
    }
}

/// Half of the way to the nearest point that the model's box allows.
fn near_depth(space: &ModelSpace, eye: DVec3, forward: DVec3) -> f64 {
    let [low, high] = space.bounds.map(|p| p.as_dvec3());
    let depths = (0..8).map(|corner| {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        (DVec3::new(pick(0), pick(1), pick(2)) - eye).dot(forward)
    });
    let (nearest, farthest) = depths.fold((f64::INFINITY, 0f64), |(near, far), d| (near.min(d), far.max(d)));
    (nearest * 0.5).max(farthest * NEAREST_SHARE).max(1e-12)
}

// The bind groups that all shaders of a frame share, and the formats of its targets.

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
    pub(crate) fn new(gpu: &Gpu) -> Self {
        use wgpu::TextureViewDimension::{Cube, CubeArray, D2, D2Array};
        let light = |dimension| texture_type(FILTERED, dimension);
        let shadow_maps = texture_type(wgpu::TextureSampleType::Depth, D2Array);
        let types = [
            UNIFORM,
            STORAGE,
            STORAGE,
            shadow_maps,
            light(Cube),
            light(Cube),
            light(CubeArray),
            light(D2),
            light(D2Array),
            SAMPLER,
        ];
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
        Self {
            surfaces: gpu.bind_layout("frame", stages, types),
            casters: gpu.bind_layout("caster", stages, [dynamic_uniform(CASTER_BYTES)]),
        }
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

// Uniforms and storage as shaders lay them out.

/// `Frame` of `frame.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct FrameRecord {
    pub(crate) clip_from_offset: Mat4,
    pub(crate) eye: Vec3,
    pub(crate) exposure: f32,
    pub(crate) eye_rest: Vec3,
    pub(crate) world_per_mesh: f32,
    pub(crate) ray_corner: Vec3,
    pub(crate) width: f32,
    pub(crate) ray_right: Vec3,
    pub(crate) height: f32,
    pub(crate) ray_down: Vec3,
    pub(crate) max_anisotropy: f32,
    pub(crate) background_top: Vec4,
    pub(crate) background_bottom: Vec4,
    pub(crate) ambient_sky: Vec3,
    pub(crate) background_blur: f32,
    pub(crate) ambient_ground: Vec3,
    pub(crate) environment_strength: f32,
    pub(crate) ambient_up: Vec3,
    pub(crate) environment_cosine: f32,
    pub(crate) environment_sine: f32,
    pub(crate) lamp_count: u32,
    pub(crate) overlay: u32,
    pub(crate) tone_map: u32,
    pub(crate) tone_white: f32,
    pub(crate) encode_srgb: u32,
    pub(crate) background_is_light: u32,
    pub(crate) seconds: f32,
    pub(crate) harmonics: [Vec4; 9],
}

/// `Lamp` of `frame.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct LampRecord {
    pub(crate) kind: u32,
    pub(crate) first_face: u32,
    pub(crate) face_count: u32,
    pub(crate) cookie: u32,
    pub(crate) color: Vec3,
    pub(crate) inverse_reference: f32,
    pub(crate) position: Vec3,
    pub(crate) inverse_range: f32,
    pub(crate) direction: Vec3,
    pub(crate) cosine_outer: f32,
    pub(crate) inverse_cosine_range: f32,
    pub(crate) pad: [f32; 3],
    pub(crate) cookie_from_mesh: Mat4,
}

/// `ShadowFace` of `frame.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct ShadowFaceRecord {
    pub(crate) map_from_mesh: Mat4,
    pub(crate) right: Vec3,
    pub(crate) half_width: f32,
    pub(crate) up: Vec3,
    pub(crate) half_height: f32,
    pub(crate) forward: Vec3,
    pub(crate) far: f32,
    pub(crate) origin: Vec3,
    pub(crate) near: f32,
    pub(crate) resolution: f32,
    pub(crate) layer: u32,
    pub(crate) bias: f32,
    pub(crate) normal_offset: f32,
    pub(crate) penumbra: u32,
    pub(crate) penumbra_width: f32,
    pub(crate) at: [u32; 2],
}

/// `Lines` of `lines.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct LinesRecord {
    pub(crate) color: Vec4,
}

// All that group 0 binds, kept from frame to frame.

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
    cookies: CookieTextures,
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
            cookies: CookieTextures::none(gpu),
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
    ) -> Result<bool> {
        let lamps: &[Light] = if frame.options.shading.is_lit() { &frame.lights.lamps } else { &[] };
        let mut records = lamp_records(lamps, &frame.space.world_from_mesh);
        let shadows = self.shadows.update(gpu, lamps, &records, frame.space, frame.shadow_revision)?;
        for (record, [first, count]) in records.iter_mut().zip(&self.shadows.of_lamps) {
            (record.first_face, record.face_count) = (*first, *count);
        }
        let environment = frame.lights.ambient.environment.as_ref();
        let mut rebind = self.environment.update(gpu, environment) | shadows.moved;
        rebind |= self.cookies.update(gpu, lamps, frame.options.seconds)?;
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
        self.shadows.drawn = None;
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
            TextureView(&self.cookies.view),
            Sampler(&self.sampler),
        ];
        let surfaces = gpu.bind_group("frame", gpu.frame_layout().surfaces(), resources);
        let matrix =
            wgpu::BufferBinding { buffer: &self.casters, offset: 0, size: NonZeroU64::new(CASTER_BYTES) };
        let casters =
            gpu.bind_group("caster", gpu.frame_layout().casters(), [wgpu::BindingResource::Buffer(matrix)]);
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
            Some(ToneMap::Reinhard) => (1, ToneMap::WHITE),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shader::layout_check::{assert_same_layout, fields};

    #[test]
    fn records_are_laid_out_as_shaders_read_them() {
        assert_same_layout(
            "uv",
            "Frame",
            size_of::<FrameRecord>(),
            fields!(FrameRecord: clip_from_offset, eye, exposure, eye_rest, world_per_mesh, ray_corner, width,
                ray_right, height, ray_down, max_anisotropy, background_top, background_bottom, ambient_sky,
                background_blur, ambient_ground, environment_strength, ambient_up, environment_cosine,
                environment_sine, lamp_count, overlay, tone_map, tone_white, encode_srgb, background_is_light,
                seconds, harmonics),
        );
        assert_same_layout(
            "uv",
            "Lamp",
            size_of::<LampRecord>(),
            fields!(LampRecord: kind, first_face, face_count, cookie, color, inverse_reference, position,
                inverse_range, direction, cosine_outer, inverse_cosine_range, cookie_from_mesh),
        );
        assert_same_layout(
            "uv",
            "ShadowFace",
            size_of::<ShadowFaceRecord>(),
            fields!(ShadowFaceRecord: map_from_mesh, right, half_width, up, half_height, forward, far, origin,
                near, resolution, layer, bias, normal_offset, penumbra, penumbra_width, at),
        );
        assert_same_layout("lines", "Lines", size_of::<LinesRecord>(), fields!(LinesRecord: color));
    }
}
