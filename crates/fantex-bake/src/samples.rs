//! Means of several points of a texel.

use fantex_mesh::SurfacePoint;
use fantex_store::{ChannelKind, Damage};
use glam::{Vec2, Vec3, Vec4};

use crate::{Source, SourceChannel, TexelPoint};

/// Centres of `n * n` cells of a texel, from -0.5 to 0.5 along its sides.
pub(crate) fn cells(n: u32) -> impl Iterator<Item = [f32; 2]> {
    let at = move |i: u32| (i as f32 + 0.5) / n as f32 - 0.5;
    (0..n * n).map(move |i| [at(i % n), at(i / n)])
}

/// Writes the mean of `n * n` points of a texel. `evaluate` writes the values at a place in it, as [`cells`] has them. Colours count in proportion
/// to their coverage.
pub(crate) fn mean_of_cells(
    n: u32,
    point: &TexelPoint,
    channels: &[SourceChannel],
    values: &mut [Vec4],
    mut evaluate: impl FnMut([f32; 2], &mut [Vec4]),
) {
    let share = 1.0 / n as f32;
    let mut sums = vec![Vec4::ZERO; values.len()];
    for cell in cells(n) {
        evaluate(cell, values);
        for ((sum, value), channel) in sums.iter_mut().zip(&*values).zip(channels) {
            *sum += match channel.kind {
                ChannelKind::Anisotropy => doubled_angle(*value, point.normal),
                _ if channel.has_alpha => (value.truncate() * value.w).extend(value.w),
                _ => *value,
            };
        }
    }
    for ((value, sum), channel) in values.iter_mut().zip(sums).zip(channels) {
        let mean = sum * (share * share);
        *value = match channel.kind {
            ChannelKind::Normal => sum.truncate().try_normalize().unwrap_or(point.normal).extend(0.0),
            ChannelKind::Anisotropy => from_doubled_angle(mean, point.normal),
            _ if channel.has_alpha && mean.w > 0.0 => (mean.truncate() / mean.w).extend(mean.w),
            _ => mean,
        };
    }
}

// Directions of stretched highlights are lines: their sign is arbitrary. They are averaged as vectors of twice their angle.

/// A direction (xyz) and its strength, as a vector of twice its angle around the normal, as long as it is strong.
fn doubled_angle(direction: Vec4, normal: Vec3) -> Vec4 {
    let (x, y) = normal.any_orthonormal_pair();
    let along = Vec2::new(direction.truncate().dot(x), direction.truncate().dot(y)).normalize_or_zero();
    (along.rotate(along) * direction.w).extend(0.0).extend(0.0)
}

/// The unit direction of that vector, and its strength.
fn from_doubled_angle(doubled: Vec4, normal: Vec3) -> Vec4 {
    let (x, y) = normal.any_orthonormal_pair();
    let doubled = doubled.truncate().truncate();
    let along = Vec2::from_angle(0.5 * doubled.to_angle());
    (x * along.x + y * along.y).extend(doubled.length())
}

/// Points along each side of a texel whose mean is taken.
const SIDE: u32 = 4;

/// A source of point values as one of means over the texel.
pub(crate) struct TexelMeans<'a> {
    source: &'a dyn Source,
    channels: Vec<SourceChannel>,
}

impl<'a> TexelMeans<'a> {
    pub(crate) fn of(source: &'a dyn Source) -> Self {
        Self { source, channels: source.channels() }
    }
}

impl Source for TexelMeans<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        self.channels.clone()
    }

    fn crosses_creases(&self) -> bool {
        self.source.crosses_creases()
    }

    fn jumps_at_creases(&self) -> bool {
        self.source.jumps_at_creases()
    }

    fn has_shares(&self) -> bool {
        self.source.has_shares()
    }

    fn damage(&self) -> Damage {
        self.source.damage()
    }

    fn has_slow_points(&self) -> bool {
        self.source.has_slow_points()
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let share = 1.0 / SIDE as f32;
        mean_of_cells(SIDE, point, &self.channels, values, |[x, y], values| {
            let there = |steps: [Vec3; 2]| steps[0] * x + steps[1] * y;
            let lambda = point.at.lambda + there(point.lambda_steps);
            let cell = TexelPoint {
                at: SurfacePoint { lambda, ..point.at },
                lambda_steps: point.lambda_steps.map(|step| step * share),
                position: point.position + there(point.position_steps),
                position_steps: point.position_steps.map(|step| step * share),
                ..*point
            };
            self.source.evaluate(&cell, values);
        });
    }
}
