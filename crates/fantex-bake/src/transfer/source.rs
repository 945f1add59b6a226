//! The detailed mesh as a source for the coarse one.

use fantex_mesh::Mesh;
use fantex_store::ChannelKind;
use glam::{Vec3, Vec4};

use super::projector::{Match, Projector};
use super::{TransferError, TransferReport, cells, check_samples, on_triangle};
use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// How to transfer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransferOptions {
    /// How far the detailed surface is looked for along the normal, world units, positive. Not given: a quarter more than the
    /// largest distance between the meshes at a few thousand points.
    pub cage: Option<f64>,
    /// Rays along each side of a texel, 1 to 64.
    pub samples: u32,
    /// Transfer the shading normal, too.
    pub normals: bool,
}

impl Default for TransferOptions {
    /// Normals, four rays per texel, a measured cage.
    fn default() -> Self {
        Self { cage: None, samples: 2, normals: true }
    }
}

/// What a detailed mesh looks like, as a source for a coarse one: its shading normals, and all channels of any source that
/// is made for the detailed mesh (its textures, vertex colours, a recipe).
pub struct TransferSource<'a> {
    projector: Projector<'a>,
    detail: Option<&'a dyn Source>,
    channels: Vec<SourceChannel>,
    /// Shading normals come as an additional, first channel.
    own_normals: bool,
    samples: u32,
}

impl std::fmt::Debug for TransferSource<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TransferSource").field("channels", &self.channels).finish_non_exhaustive()
    }
}

impl<'a> TransferSource<'a> {
    /// A source for `coarse`. `detail` is a source for `detailed`; if it gives normals, these are taken instead of the
    /// mesh's shading normals.
    ///
    /// # Errors
    ///
    /// An option is out of its range, or a mesh is empty.
    pub fn new(
        coarse: &'a Mesh,
        detailed: &'a Mesh,
        detail: Option<&'a dyn Source>,
        options: &TransferOptions,
    ) -> Result<Self, TransferError> {
        check_samples(options.samples)?;
        let projector = Projector::new(coarse, detailed, options.cage)?;
        let mut channels = detail.map_or_else(Vec::new, Source::channels);
        let own_normals = options.normals && channels.iter().all(|c| c.kind != ChannelKind::Normal);
        if own_normals {
            let normals = SourceChannel { kind: ChannelKind::Normal, has_alpha: false, exceeds_one: false };
            channels.insert(0, normals);
        }
        Ok(Self { projector, detail, channels, own_normals, samples: options.samples })
    }

    /// How well the meshes have fitted so far. It does not depend on the number of threads.
    pub fn report(&self) -> TransferReport {
        self.projector.report()
    }

    /// All channels at one point of the detailed mesh; `steps` are the sides of the area that it stands for, coarse mesh
    /// space.
    fn value_at(&self, at: Match, steps: [Vec3; 2], values: &mut [Vec4]) {
        let (first, rest) = values.split_at_mut(usize::from(self.own_normals));
        if let Some(normal) = first.first_mut() {
            *normal = self.projector.shading_normal(at).extend(0.0);
        }
        let Some(detail) = self.detail else { return };
        let corners = self.projector.detailed.triangle_positions(at.triangle);
        let position_steps = steps.map(|s| s * self.projector.length_in_detailed());
        let point = SurfacePoint {
            triangle: at.triangle,
            lambda: at.lambda,
            lambda_steps: position_steps.map(|s| lambda_step(corners, s)),
            position: corners[0] * at.lambda.x + corners[1] * at.lambda.y + corners[2] * at.lambda.z,
            position_steps,
            normal: self.projector.shading_normal(at),
        };
        detail.evaluate(&point, rest);
    }
}

/// The change of barycentric coordinates along a step, after its projection onto the triangle's plane.
fn lambda_step([a, b, c]: [Vec3; 3], step: Vec3) -> Vec3 {
    let normal = (b - a).cross(c - a);
    let squared = normal.length_squared().max(f32::MIN_POSITIVE);
    let along = |from: Vec3, to: Vec3| normal.cross(to - from).dot(step) / squared;
    Vec3::new(along(b, c), along(c, a), along(a, b))
}

impl Source for TransferSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let share = 1.0 / self.samples as f32;
        let steps = point.position_steps.map(|s| s * share);
        let mut sums = vec![Vec4::ZERO; values.len()];
        for [x, y] in cells(self.samples) {
            let lambda = point.lambda + point.lambda_steps[0] * x + point.lambda_steps[1] * y;
            let at = self.projector.find(point.triangle, on_triangle(lambda));
            self.value_at(at, steps, values);
            for ((sum, value), channel) in sums.iter_mut().zip(&*values).zip(&self.channels) {
                // Colours count in proportion to their coverage.
                let weight = if channel.has_alpha { value.w } else { 1.0 };
                *sum += (value.truncate() * weight).extend(value.w);
            }
        }
        for ((value, sum), channel) in values.iter_mut().zip(sums).zip(&self.channels) {
            let mean = sum * (share * share);
            *value = match channel.kind {
                ChannelKind::Normal => sum.truncate().try_normalize().unwrap_or(point.normal).extend(0.0),
                _ if channel.has_alpha && mean.w > 0.0 => (mean.truncate() / mean.w).extend(mean.w),
                _ => mean,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lambda_steps_undo_position_steps() {
        let corners = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.9, 0.1, -0.2), Vec3::new(0.3, 0.8, 0.1)];
        for lambda in [Vec3::new(0.1, -0.3, 0.2), Vec3::new(-0.5, 0.25, 0.25)] {
            let step = corners[0] * lambda.x + corners[1] * lambda.y + corners[2] * lambda.z;
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            assert!((lambda_step(corners, step + 3.0 * normal) - lambda).length() < 1e-5);
        }
    }
}
