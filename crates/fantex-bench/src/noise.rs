//! How fast procedural functions are, on one thread.

use std::hint::black_box;
use std::time::Instant;

use ::noise::NoiseFn;
use fantex::base::Aabb;
use fantex::glam::Vec3;
use fantex::texture::noise::{Fractal, Noise};
use fantex::texture::{SOLID_NAMES, SolidPoint, solid_by_name};

use crate::{Measured, Row};

/// Points of one repetition: few enough to stay in the nearest cache.
const POINTS: usize = 1 << 12;
/// Repetitions, of which the fastest counts. Peers are measured in turns with what stands beside them.
const REPETITIONS: usize = 200;

/// Gradient noise at many points and at single ones, fractal sums, and all solids.
pub(crate) fn rows() -> Measured {
    let points: Vec<Vec3> = (0..POINTS)
        .map(|i| Vec3::new((i % 64) as f32 * 0.037, (i / 64) as f32 * 0.037, 0.3 + i as f32 * 1e-4))
        .collect();
    let (own, peer) = (Noise::new(1), ::noise::Perlin::new(1));
    let peer_value = |p: Vec3| peer.get(p.as_dvec3().to_array()) as f32;
    let mut out = vec![0.0; POINTS];
    let mut best = [f64::INFINITY; 5];
    for _ in 0..REPETITIONS {
        let seconds = [
            timed(&points, &mut out, |points, out| own.values(points, out)),
            timed(&points, &mut out, |points, out| each(points, out, |p| own.value(p))),
            timed(&points, &mut out, |points, out| each(points, out, peer_value)),
            timed(&points, &mut out, |points, out| {
                each(points, out, |p| own.fbm(p, Fractal::octaves(5), 0.0));
            }),
            timed(&points, &mut out, |points, out| {
                each(points, out, |p| {
                    (0..5).map(|octave| peer_value(p * 2.03_f32.powi(octave)) * 0.5_f32.powi(octave)).sum()
                });
            }),
        ];
        best.iter_mut().zip(seconds).for_each(|(best, seconds)| *best = best.min(seconds));
    }
    let [many, single, peer_single, sum, peer_sum] = best.map(|seconds| POINTS as f64 / seconds / 1e6);
    let row = |name: &str, value| Row::new(name, value, "M samples/s");
    let mut rows = vec![
        row("gradient noise 3D, many points", many).beside(Some(peer_single)),
        row("gradient noise 3D, one by one", single).beside(Some(peer_single)),
        row("fBm 3D, 5 octaves", sum).beside(Some(peer_sum)),
    ];
    // Scattered points, and texels as bakes ask for them: rows of neighbours.
    for (spacing, name) in [(0.037, "scattered"), (1e-3, "texels")] {
        for solid in SOLID_NAMES {
            rows.push(row(&format!("solid {solid}, {name}"), solid_rate(solid, spacing)?));
        }
    }
    Ok(rows)
}

/// Millions of colours per second, with footprints of a thousandth.
fn solid_rate(name: &str, spacing: f32) -> Result<f64, Box<dyn std::error::Error>> {
    let solid = solid_by_name(name, Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE }, 1)?;
    let n = Vec3::new(0.4, 0.75, 0.5).normalize();
    let point = |i: usize| {
        let p = spacing * Vec3::new((i % 64) as f32, (i / 64) as f32, 0.003 * i as f32);
        SolidPoint { p: p + 0.3, n, footprint: 1e-3, time: 0.0 }
    };
    let points: Vec<SolidPoint> = (0..POINTS).map(point).collect();
    let mut colors = vec![[0.0; 4]; POINTS];
    let seconds = (0..REPETITIONS / 10).map(|_| {
        let started = Instant::now();
        solid.colors(black_box(&points), black_box(&mut colors));
        started.elapsed().as_secs_f64()
    });
    Ok(POINTS as f64 / seconds.fold(f64::INFINITY, f64::min) / 1e6)
}

fn each(points: &[Vec3], out: &mut [f32], value: impl Fn(Vec3) -> f32) {
    points.iter().zip(out).for_each(|(&p, out)| *out = value(p));
}

/// Seconds of one run.
fn timed(points: &[Vec3], out: &mut [f32], work: impl Fn(&[Vec3], &mut [f32])) -> f64 {
    let started = Instant::now();
    work(black_box(points), out);
    black_box(out);
    started.elapsed().as_secs_f64()
}
