//! How faithfully a baked asset reproduces a known function.

use fantex_base::Random;
use fantex_mesh::{Mesh, SurfacePoint};
use fantex_store::{Footprint, PageCache, Sampler};
use fantex_texture::FilterOptions;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Deviation of an asset from a function, over random points of the surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fidelity {
    /// Points looked at.
    pub samples: u64,
    /// Peak signal-to-noise ratio for a peak of 1, in dB.
    pub psnr_db: f64,
    /// Largest deviation.
    pub largest: f32,
    /// Mean number of tiles read per point.
    pub lookups_per_sample: f64,
}

/// Samples the first channel of an asset at level 0 through the texture function, at `samples` area-uniform points, and
/// compares red with `truth` (a function of the position in mesh space).
pub fn fidelity(
    cache: &PageCache,
    samples: u64,
    seed: u64,
    truth: &(dyn Fn(Vec3) -> f32 + Sync),
) -> Fidelity {
    let sampler = Sampler::of_cache(cache, FilterOptions::default());
    let mesh = cache.asset().mesh();
    let points = surface_points(mesh, samples, seed);
    let parts: Vec<(f64, f32, u64)> = points
        .par_chunks(4096)
        .map(|chunk| {
            let (mut squares, mut largest, mut lookups) = (0.0, 0.0f32, 0);
            for &point in chunk {
                let value = sampler.sample_channel(0, point, Footprint::NONE);
                let error = value.x - truth(point.position(mesh));
                squares += f64::from(error) * f64::from(error);
                largest = largest.max(error.abs());
                lookups += sampler.taps(point).len() as u64;
            }
            (squares, largest, lookups)
        })
        .collect();
    let squares: f64 = parts.iter().map(|p| p.0).sum();
    let lookups: u64 = parts.iter().map(|p| p.2).sum();
    Fidelity {
        samples,
        psnr_db: -10.0 * (squares / samples.max(1) as f64).log10(),
        largest: parts.iter().map(|p| p.1).fold(0.0, f32::max),
        lookups_per_sample: lookups as f64 / samples.max(1) as f64,
    }
}

/// Area-uniform points, ascending by triangle.
fn surface_points(mesh: &Mesh, samples: u64, seed: u64) -> Vec<SurfacePoint> {
    let mut ends = Vec::with_capacity(mesh.triangles.len());
    let mut total = 0.0;
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(t).map(Vec3::as_dvec3);
        total += (b - a).cross(c - a).length();
        ends.push(total);
    }
    let mut random = Random::new(seed);
    let mut points: Vec<SurfacePoint> = (0..samples)
        .map(|_| {
            let at = random.unit() * total;
            let triangle = ends.partition_point(|&end| end < at).min(ends.len() - 1);
            let (r, s) = (random.unit().sqrt(), random.unit());
            let lambda = DVec3::new(1.0 - r, r * (1.0 - s), r * s).as_vec3();
            SurfacePoint { triangle: triangle as u32, lambda }
        })
        .collect();
    points.sort_by_key(|p| p.triangle);
    points
}
