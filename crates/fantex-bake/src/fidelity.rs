//! How faithfully a baked asset reproduces a known function.

use fantex_mesh::Mesh;
use fantex_store::PageCache;
use glam::{Vec3, Vec4};
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
    let mesh = cache.asset().mesh();
    let points = surface_points(mesh, samples, seed);
    let parts: Vec<(f64, f32, u64)> = points
        .par_chunks(4096)
        .map(|chunk| {
            let (mut squares, mut largest, mut lookups) = (0.0, 0.0f32, 0);
            for &(triangle, lambda) in chunk {
                let [a, b, c] = mesh.triangle_positions(triangle as usize);
                let (value, count) = sample_finest(cache, 0, triangle as usize, lambda);
                let error = value.x - truth(a * lambda.x + b * lambda.y + c * lambda.z);
                squares += f64::from(error) * f64::from(error);
                largest = largest.max(error.abs());
                lookups += count;
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

/// The texture function with all tiles at level 0; and the number of tiles read.
pub fn sample_finest(cache: &PageCache, channel: usize, triangle: usize, lambda: Vec3) -> (Vec4, u64) {
    let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
    let weights = cover.weights(triangle, lambda);
    let mut sum = Vec4::ZERO;
    for (slot, weight) in weights.iter() {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * lambda.x + b * lambda.y + c * lambda.z;
        let group = cover.corner_groups[triangle][slot];
        sum += weight * Vec4::from_array(cache.bilinear(channel, group, 0, uv));
    }
    (sum, weights.len() as u64)
}

/// Area-uniform points as triangle and barycentric coordinates, ascending by triangle.
fn surface_points(mesh: &Mesh, samples: u64, seed: u64) -> Vec<(u32, Vec3)> {
    let mut ends = Vec::with_capacity(mesh.triangles.len());
    let mut total = 0.0;
    for t in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(t).map(Vec3::as_dvec3);
        total += (b - a).cross(c - a).length();
        ends.push(total);
    }
    let mut random = SplitMix(seed);
    let mut points: Vec<(u32, Vec3)> = (0..samples)
        .map(|_| {
            let at = random.unit() * total;
            let triangle = ends.partition_point(|&end| end < at).min(ends.len() - 1);
            let (r, s) = (random.unit().sqrt(), random.unit());
            (triangle as u32, glam::DVec3::new(1.0 - r, r * (1.0 - s), r * s).as_vec3())
        })
        .collect();
    points.sort_by_key(|p| p.0);
    points
}

/// Sebastiano Vigna's SplitMix64 (2015).
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}
