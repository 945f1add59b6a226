//! Uniforms and storage as shaders lay them out.

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Vec3, Vec4};

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
    pub(crate) slide: u32,
    pub(crate) color: Vec3,
    pub(crate) inverse_reference: f32,
    pub(crate) position: Vec3,
    pub(crate) inverse_range: f32,
    pub(crate) direction: Vec3,
    pub(crate) cosine_outer: f32,
    pub(crate) inverse_cosine_range: f32,
    pub(crate) pad: [f32; 3],
    pub(crate) slide_from_mesh: Mat4,
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
    pub(crate) pad: [f32; 2],
}

/// `Lines` of `lines.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct LinesRecord {
    pub(crate) color: Vec4,
}

#[cfg(test)]
mod tests {
    use std::mem::{offset_of, size_of};

    use super::*;
    use crate::shader::layout_check::assert_same_layout;

    macro_rules! fields {
        ($record:ty: $($field:ident),* $(,)?) => {
            &[$((stringify!($field), offset_of!($record, $field))),*]
        };
    }

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
            fields!(LampRecord: kind, first_face, face_count, slide, color, inverse_reference, position,
                inverse_range, direction, cosine_outer, inverse_cosine_range, slide_from_mesh),
        );
        assert_same_layout(
            "uv",
            "ShadowFace",
            size_of::<ShadowFaceRecord>(),
            fields!(ShadowFaceRecord: map_from_mesh, right, half_width, up, half_height, forward, far, origin,
                near, resolution, layer, bias, normal_offset, penumbra, penumbra_width),
        );
        assert_same_layout("lines", "Lines", size_of::<LinesRecord>(), fields!(LinesRecord: color));
    }
}
