//! A sum of three sine waves: the test function for fidelity.

use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// `0.5 + (sin(k x) + sin(k y + 1) + sin(k z + 2)) / 6`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SineSource {
    /// Angular frequency in radians per mesh unit.
    pub k: f32,
}

impl SineSource {
    /// The function's value at a point, mesh space. In double precision: errors of the test function are not to be
    /// counted as errors of the texture.
    pub fn value(&self, p: Vec3) -> f32 {
        let q = p.as_dvec3() * f64::from(self.k);
        (0.5 + (q.x.sin() + (q.y + 1.0).sin() + (q.z + 2.0).sin()) / 6.0) as f32
    }
}

impl Source for SineSource {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        values[0] = Vec3::splat(self.value(point.position)).extend(1.0);
    }
}
