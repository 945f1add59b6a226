//! From a point of the coarse mesh to the point of the detailed mesh that it stands for.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use fantex_mesh::{Mesh, RayHit, SURFACE_OFFSET, TriangleBvh, corner_normals, shading_normals};
use glam::{DVec3, Vec3};

use super::{TransferError, TransferReport};

/// Points at which the distance of two meshes is measured, on each of them.
const PROBES: usize = 2048;
/// The cage is larger than the largest distance that was measured.
const CAGE_SLACK: f32 = 1.25;
/// Meshes that coincide still get a cage, mesh units.
const SMALLEST_CAGE: f32 = 1e-4;

/// A point of the detailed mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct Match {
    pub(super) triangle: usize,
    pub(super) lambda: Vec3,
}

/// Rays from one mesh to another.
pub(super) struct Projector<'a> {
    pub(super) coarse: &'a Mesh,
    pub(super) detailed: &'a Mesh,
    pub(super) detailed_normals: Vec<Vec3>,
    bvh: TriangleBvh,
    /// Smooth over creases, so that neighbouring rays do not leave gaps.
    ray_normals: Vec<Vec3>,
    /// From coarse to detailed mesh space: `p * scale + offset`; directions are the same.
    scale: f64,
    offset: DVec3,
    /// Detailed mesh units.
    cage: f32,
    points: AtomicU64,
    missed: AtomicU64,
}

impl<'a> Projector<'a> {
    /// `cage` in world units.
    pub(super) fn new(
        coarse: &'a Mesh,
        detailed: &'a Mesh,
        cage: Option<f64>,
    ) -> Result<Self, TransferError> {
        if let Some(cage) = cage.filter(|c| !(c.is_finite() && *c > 0.0)) {
            return Err(TransferError::Cage { cage });
        }
        let empty =
            [("coarse", coarse), ("detailed", detailed)].into_iter().find(|m| m.1.triangles.is_empty());
        if let Some((which, _)) = empty {
            return Err(TransferError::Empty { which });
        }
        let (from, to) = (&coarse.world_from_mesh, &detailed.world_from_mesh);
        let mut projector = Self {
            coarse,
            detailed,
            detailed_normals: shading_normals(detailed),
            bvh: TriangleBvh::new(detailed),
            ray_normals: corner_normals(coarse, 180.0),
            scale: from.scale / to.scale,
            offset: (from.offset - to.offset) / to.scale,
            cage: 0.0,
            points: AtomicU64::new(0),
            missed: AtomicU64::new(0),
        };
        projector.cage = match cage {
            Some(world) => (world / to.scale) as f32,
            None => (CAGE_SLACK * projector.sampled_distance()).max(SMALLEST_CAGE),
        };
        Ok(projector)
    }

    /// The match of a point of a coarse triangle: along the smooth normal, outwards or inwards, whichever is nearer and faces
    /// the same way; or else the nearest point.
    pub(super) fn find(&self, triangle: usize, lambda: Vec3) -> Match {
        self.points.fetch_add(1, Relaxed);
        let normals: [Vec3; 3] = std::array::from_fn(|k| self.ray_normals[3 * triangle + k]);
        let corners = self.coarse.triangle_positions(triangle);
        let blend = |v: [Vec3; 3]| v[0] * lambda.x + v[1] * lambda.y + v[2] * lambda.z;
        let p = self.in_detailed(blend(corners));
        let normal = blend(normals).try_normalize();
        let by_ray = normal.and_then(|normal| {
            let hits = [(normal, false), (-normal, true)].map(|(direction, front)| {
                // From a little behind, since the surfaces may touch at the point itself.
                let origin = p - direction * SURFACE_OFFSET;
                let faces_alike = |hit: &RayHit| hit.front == front;
                self.bvh.first_hit_where(origin, direction, self.cage + SURFACE_OFFSET, faces_alike)
            });
            hits.into_iter().flatten().min_by(|a, b| a.distance.total_cmp(&b.distance))
        });
        if let Some(hit) = by_ray {
            return Match { triangle: hit.triangle, lambda: hit.lambda };
        }
        self.missed.fetch_add(1, Relaxed);
        match self.bvh.nearest_point(p, f32::INFINITY) {
            Some(nearest) => Match { triangle: nearest.triangle, lambda: nearest.lambda },
            // Only where the point is no number.
            None => Match { triangle: 0, lambda: Vec3::X },
        }
    }

    /// Unit shading normal of the detailed mesh; directions are the same in both mesh spaces.
    pub(super) fn shading_normal(&self, at: Match) -> Vec3 {
        let [a, b, c] = [0, 1, 2].map(|k| self.detailed_normals[3 * at.triangle + k]);
        (a * at.lambda.x + b * at.lambda.y + c * at.lambda.z).try_normalize().unwrap_or(a)
    }

    /// A point of coarse mesh space in detailed mesh space.
    fn in_detailed(&self, p: Vec3) -> Vec3 {
        (p.as_dvec3() * self.scale + self.offset).as_vec3()
    }

    /// A length of coarse mesh space in detailed mesh space.
    pub(super) fn length_in_detailed(&self) -> f32 {
        self.scale as f32
    }

    pub(super) fn report(&self) -> TransferReport {
        TransferReport {
            cage: f64::from(self.cage) * self.detailed.world_from_mesh.scale,
            points: self.points.load(Relaxed),
            missed: self.missed.load(Relaxed),
        }
    }

    /// The largest distance, in detailed mesh units, of a point of either mesh to the other, over points spread evenly.
    fn sampled_distance(&self) -> f32 {
        let to_detailed = spread_points(self.coarse).into_iter().filter_map(|p| {
            let nearest = self.bvh.nearest_point(self.in_detailed(p), f32::INFINITY)?;
            Some(nearest.distance)
        });
        let coarse_bvh = TriangleBvh::new(self.coarse);
        let to_coarse = spread_points(self.detailed).into_iter().filter_map(|p| {
            let p = ((p.as_dvec3() - self.offset) / self.scale).as_vec3();
            let nearest = coarse_bvh.nearest_point(p, f32::INFINITY)?;
            Some(nearest.distance * self.length_in_detailed())
        });
        to_detailed.chain(to_coarse).fold(0.0, f32::max)
    }
}

/// `PROBES` points of a mesh, as many per area everywhere (M. Roberts, "The Unreasonable Effectiveness of Quasirandom
/// Sequences", 2018, within triangles).
fn spread_points(mesh: &Mesh) -> Vec<Vec3> {
    let step = mesh.area() / PROBES as f64;
    let mut points = Vec::with_capacity(PROBES);
    // Area up to the next point.
    let mut left = 0.5 * step;
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(triangle);
        let mut area = 0.5 * f64::from((b - a).cross(c - a).length());
        while area >= left && points.len() < PROBES {
            area -= left;
            left = step;
            let n = points.len() as f64;
            let (mut u, mut v) = ((n * 0.754_877_666_2).fract() as f32, (n * 0.569_840_291_0).fract() as f32);
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            points.push(a + (b - a) * u + (c - a) * v);
        }
        left -= area;
    }
    points
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, clean, generate};

    use super::*;

    #[test]
    fn probes_cover_the_surface_evenly() {
        let (mesh, _) = clean(generate::icosphere(3), &CleanOptions::default()).unwrap();
        let points = spread_points(&mesh);
        assert!(points.len().abs_diff(PROBES) <= 1);
        let mean = points.iter().sum::<Vec3>() / points.len() as f32;
        assert!(mean.length() < 0.03, "{mean}");
        assert!(points.iter().all(|p| (0.98..1.001).contains(&p.length())));
    }

    #[test]
    fn the_cage_follows_from_the_distance_of_the_meshes() {
        let sphere = |radius: f64| {
            let mut model = generate::icosphere(4);
            model.positions.iter_mut().for_each(|p| *p = *p * radius + DVec3::new(3.0, 0.0, 9.0));
            clean(model, &CleanOptions::default()).unwrap().0
        };
        let (inner, outer) = (sphere(2.0), sphere(2.3));
        for (coarse, detailed) in [(&inner, &outer), (&outer, &inner)] {
            let cage = Projector::new(coarse, detailed, None).unwrap().report().cage;
            assert!((cage / 0.3 / f64::from(CAGE_SLACK) - 1.0).abs() < 0.05, "{cage}");
        }
        let cage = Projector::new(&inner, &inner, None).unwrap().report().cage;
        assert!(cage > 0.0 && cage < 1e-3);
    }
}
