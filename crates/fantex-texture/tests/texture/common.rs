//! What the tests share.

use std::sync::Arc;

pub(crate) use fantex_test::data as data_folder;
use fantex_texture::{Filter, Filtering, Image, ImageTexture, ShadingPoint};
use glam::{Vec3, Vec4};

pub(crate) const FILTERS: [Filter; 6] =
    [Filter::Nearest, Filter::Bilinear, Filter::Bicubic, Filter::Trilinear, Filter::Anisotropic, Filter::Ewa];

/// A small generator of test numbers (SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0,1).
    pub(crate) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }
}

impl Random {
    /// In [-1,1) along each axis.
    pub(crate) fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Of length 1.
    pub(crate) fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vector();
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}

/// A point without footprint and texture coordinates, seen along its normal.
pub(crate) fn shading_point(position: Vec3, normal: Vec3) -> ShadingPoint<'static> {
    ShadingPoint {
        position,
        position_steps: [Vec3::ZERO; 2],
        normal,
        normal_steps: [Vec3::ZERO; 2],
        uv: &[],
        vertex_color: Vec4::ONE,
        to_eye: Some(normal),
        time: 0.0,
        filtering: Filtering::Own,
    }
}

/// A float texture whose texel (x, y) is `value(x, y)`.
pub(crate) fn texture(
    width: u32,
    height: u32,
    channels: u8,
    mut value: impl FnMut(u32, u32) -> [f32; 4],
) -> ImageTexture {
    let mut samples = Vec::new();
    for y in 0..height {
        for x in 0..width {
            samples.extend_from_slice(&value(x, y)[..usize::from(channels)]);
        }
    }
    ImageTexture::new(Arc::new(Image::from_linear(width, height, channels, samples)))
}

pub(crate) fn assert_close(got: [f32; 4], expected: [f32; 4], tolerance: f32, what: &str) {
    let error = got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(error <= tolerance, "{what}: got {got:?}, expected {expected:?}");
}
