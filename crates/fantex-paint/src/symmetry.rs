//! Symmetric strokes: copies on the other sides of the model.
//!
//! Copy number `k` of a stroke is the stroke moved by `M`, a reflection or a rotation: its places, and with them all directions, those
//! of stamps, of jitter and of the offset that a clone copies from. Copy 0 is the stroke itself.

use std::ops::RangeInclusive;

use fantex_base::{Error, Result};
use glam::{DVec3, Vec3};

use crate::dab::tangent_axes;
use crate::stroke_check::check_axis;
use crate::{Sample, Surface, SurfacePoint};

/// Where a stroke is repeated. Axes (0 x, 1 y, 2 z) pass the origin of the file's coordinates, unless moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Symmetry {
    /// Nowhere.
    #[default]
    None,
    /// On the other side of a plane.
    Mirror {
        /// Axis that the plane is orthogonal to.
        axis: usize,
        /// Where it meets the axis, world units.
        #[serde(default)]
        offset: f64,
    },
    /// Around an axis.
    Radial {
        /// The axis.
        axis: usize,
        /// A point that it passes, world units.
        #[serde(default)]
        center: [f64; 3],
        /// Number of copies, the stroke itself included: one of [`COPIES`](Self::COPIES).
        count: u32,
    },
}

/// The samples of a copy that follow each other without a gap.
pub(crate) struct CopiedRun {
    /// Number of the copy.
    pub(crate) copy: u32,
    pub(crate) samples: Vec<Sample>,
}

impl Symmetry {
    /// How many copies radial symmetry may have, the stroke itself included.
    pub const COPIES: RangeInclusive<u32> = 1..=256;

    /// Refuses an axis that is none, and numbers of copies that are not made.
    pub(crate) fn check(&self) -> Result<()> {
        match *self {
            Self::None => Ok(()),
            Self::Mirror { axis, .. } => check_axis("symmetry.mirror.axis", axis),
            Self::Radial { axis, count, .. } => {
                check_axis("symmetry.radial.axis", axis)?;
                if Self::COPIES.contains(&count) {
                    return Ok(());
                }
                let (low, high) = Self::COPIES.into_inner();
                let sentence = format!("`symmetry.radial.count` is {count}, but must be {low} to {high}");
                Err(Error::invalid(sentence))
            }
        }
    }

    /// All copies of a stroke, itself first. A copy's samples that find no surface within `reach` mesh units split it.
    pub(crate) fn copies(&self, surface: &Surface, samples: &[Sample], reach: f32) -> Vec<CopiedRun> {
        let mut copies = vec![CopiedRun { copy: 0, samples: samples.to_vec() }];
        for copy in 1..self.count() {
            let moved = samples.iter().map(|sample| self.moved(surface, sample, copy, reach));
            let moved: Vec<Option<Sample>> = moved.collect();
            let runs = moved.split(Option::is_none).filter(|run| !run.is_empty());
            copies
                .extend(runs.map(|run| CopiedRun { copy, samples: run.iter().copied().flatten().collect() }));
        }
        copies
    }

    /// Where the copies of a point are, itself first; none where there is no surface within `reach` mesh units.
    pub fn places(&self, surface: &Surface, point: SurfacePoint, reach: f32) -> Vec<Option<SurfacePoint>> {
        let sample = Sample::at(point);
        let moved = (1..self.count()).map(|k| Some(self.moved(surface, &sample, k, reach)?.point));
        std::iter::once(Some(point)).chain(moved).collect()
    }

    /// Number of copies, the stroke itself included.
    pub(crate) fn count(&self) -> u32 {
        match self {
            Self::None => 1,
            Self::Mirror { .. } => 2,
            Self::Radial { count, .. } => (*count).clamp(*Self::COPIES.start(), *Self::COPIES.end()),
        }
    }

    /// A sample where the copy number `k` has it; its tilt stays that of the stroke itself.
    pub(crate) fn moved(&self, surface: &Surface, sample: &Sample, k: u32, reach: f32) -> Option<Sample> {
        let world_from_mesh = surface.mesh().world_from_mesh;
        let mesh_position: Vec3 = surface.position(sample.point).as_vec3();
        let moved = self.moved_position(world_from_mesh.point(mesh_position), k);
        let point = surface.nearest(world_from_mesh.inverse_point(moved), reach)?;
        Some(Sample { point, ..*sample })
    }

    /// A direction as the copy number `k` has it, world or mesh space.
    pub(crate) fn moved_direction(&self, direction: DVec3, k: u32) -> DVec3 {
        let around_origin = match *self {
            Self::None => Self::None,
            Self::Mirror { axis, .. } => Self::Mirror { axis, offset: 0.0 },
            Self::Radial { axis, count, .. } => Self::Radial { axis, center: [0.0; 3], count },
        };
        around_origin.moved_position(direction, k)
    }

    /// A direction in the tangent plane of a place of copy number `k`: that of the stroke itself, which depends on the `normal` there,
    /// moved. `normal`: at the place of the copy.
    pub(crate) fn moved_tangent(&self, normal: DVec3, k: u32, tangent: impl FnOnce(DVec3) -> DVec3) -> DVec3 {
        if k == 0 {
            return tangent(normal);
        }
        let back = match *self {
            Self::Radial { count, .. } => count - k % count.max(1),
            _ => k,
        };
        self.moved_direction(tangent(self.moved_direction(normal, back)), k)
    }

    /// Whether copy number `k` is a mirror image.
    pub(crate) fn is_mirrored(&self, k: u32) -> bool {
        k > 0 && matches!(self, Self::Mirror { .. })
    }

    /// The angle (radians, in the axes of its place) of a picture that copy number `k` has moved: where its right points, or, where it
    /// is mirrored, its left. `right`: where the picture's right points after the move; `normal`: at the place of the copy.
    pub(crate) fn moved_angle(&self, right: DVec3, normal: DVec3, k: u32) -> f32 {
        let right = if self.is_mirrored(k) { -right } else { right };
        let (x, y) = tangent_axes(normal);
        right.dot(y).atan2(right.dot(x)) as f32
    }

    /// A place as the copy number `k` has it, world space.
    pub(crate) fn moved_position(&self, mut p: DVec3, k: u32) -> DVec3 {
        match *self {
            _ if k == 0 => {}
            Self::None => {}
            Self::Mirror { axis, offset } => p[axis.min(2)] = 2.0 * offset - p[axis.min(2)],
            Self::Radial { axis, center, count } => {
                let (axis, center) = (axis.min(2), DVec3::from(center));
                let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
                let q = p - center;
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(count)).sin_cos();
                p[i] = center[i] + cos * q[i] - sin * q[j];
                p[j] = center[j] + sin * q[i] + cos * q[j];
            }
        }
        p
    }
}
