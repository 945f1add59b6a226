//! Symmetric strokes: copies of every sample on the other sides of the model.

use glam::{DVec3, Vec3};

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
        /// Number of copies, the stroke itself included.
        count: u32,
    },
}

/// Most copies of a stroke.
const MAX_COPIES: u32 = 256;

impl Symmetry {
    /// All copies of a stroke, itself first. A copy's samples that find no surface within `reach` mesh units split it.
    pub(crate) fn copies(&self, surface: &Surface, samples: &[Sample], reach: f32) -> Vec<Vec<Sample>> {
        let mut copies = vec![samples.to_vec()];
        for k in 1..self.count() {
            let mut run = Vec::new();
            for sample in samples {
                match self.moved(surface, sample, k, reach) {
                    Some(moved) => run.push(moved),
                    None if run.is_empty() => {}
                    None => copies.push(std::mem::take(&mut run)),
                }
            }
            if !run.is_empty() {
                copies.push(run);
            }
        }
        copies
    }

    /// Where the copies of a point are, itself first; none where there is no surface within `reach` mesh units.
    pub fn places(&self, surface: &Surface, point: SurfacePoint, reach: f32) -> Vec<Option<SurfacePoint>> {
        let sample = Sample::at(point);
        let moved = (1..self.count()).map(|k| Some(self.moved(surface, &sample, k, reach)?.point));
        std::iter::once(Some(point)).chain(moved).collect()
    }

    pub(super) fn count(&self) -> u32 {
        match self {
            Self::None => 1,
            Self::Mirror { .. } => 2,
            Self::Radial { count, .. } => (*count).clamp(1, MAX_COPIES),
        }
    }

    pub(super) fn moved(&self, surface: &Surface, sample: &Sample, k: u32, reach: f32) -> Option<Sample> {
        let world_from_mesh = surface.mesh().world_from_mesh;
        let mesh_position: Vec3 = surface.position(sample.point).as_vec3();
        let moved = self.moved_position(world_from_mesh.point(mesh_position), k);
        let point = surface.nearest(world_from_mesh.inverse_point(moved), reach)?;
        Some(Sample { point, ..*sample })
    }

    /// A direction as the copy number `k` has it, world or mesh space.
    pub(crate) fn moved_direction(&self, direction: DVec3, k: u32) -> DVec3 {
        self.moved_position(direction, k) - self.moved_position(DVec3::ZERO, k)
    }

    /// Whether copies are mirror images.
    pub(crate) fn mirrors(&self) -> bool {
        matches!(self, Self::Mirror { .. })
    }

    fn moved_position(&self, mut p: DVec3, k: u32) -> DVec3 {
        match *self {
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
