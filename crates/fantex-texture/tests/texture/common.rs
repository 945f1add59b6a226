//! What the tests share.

use std::sync::Arc;

pub(crate) use fantex_test::data as data_folder;
use fantex_texture::{Filtering, Image, ImageTexture, ShadingPoint};
use glam::{Vec3, Vec4};

/// Repeatable numbers, vectors and directions.
pub(crate) struct Random(fantex_base::Random);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(fantex_base::Random::new(seed))
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// In [0,1).
    pub(crate) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

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
        eye: Some(normal.into()),
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
