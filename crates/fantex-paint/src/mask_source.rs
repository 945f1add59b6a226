//! Masks that the shape of the model makes: edges, hollows, height, slope, noise.
//!
//! A source is kept as it is written and evaluated where its layer is shown, so that it fits every density and mesh. What looks
//! around (edges and hollows) is measured by rays at points of a lattice in each triangle, and interpolated between.

use std::collections::BTreeMap;
use std::f32::consts::{PI, TAU};

use fantex_mesh::{SurfacePoint, interpolate};
use fantex_texture::noise::{Fractal, FractalKind, FractalNoise, NoiseFamily, smoothstep};
use glam::{DVec3, Quat, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::Surface;

/// What a mask is made from. The mask rises smoothly from 0 where the measure is `from` to 1 where it is `to`; where `from` is the
/// larger one, it falls.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskSource {
    /// The measure.
    pub by: MaskMeasure,
    /// Where the mask is 0, in the measure's unit.
    pub from: f32,
    /// Where it is 1.
    pub to: f32,
}

/// A measure of the surface, 0..1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MaskMeasure {
    /// 0.5 where the surface is flat, more on edges that stick out, less in hollows.
    Curvature {
        /// How far it looks around, in diagonals of the model's box.
        radius: f32,
    },
    /// The share of directions, by their cosine, in which something is near: 0 in the open.
    Occlusion {
        /// What is farther away does not count, in diagonals of the model's box.
        radius: f32,
    },
    /// How far a place is from another, in diagonals of the model's box.
    Distance {
        /// World units.
        to: [f64; 3],
    },
    /// Along the model's box.
    Height {
        /// 0 x, 1 y, 2 z.
        axis: usize,
    },
    /// The angle between the normal and an axis: 0 where it faces along it, 0.5 at right angles, 1 where it faces away.
    Slope {
        /// 0 x, 1 y, 2 z.
        axis: usize,
    },
    /// Fractal noise around 0.5.
    Noise {
        /// Width of its largest patches, in diagonals of the model's box.
        scale: f32,
        /// Another one is another pattern.
        seed: u32,
    },
}

impl MaskMeasure {
    /// A source by it with usual bounds.
    pub fn source(self) -> MaskSource {
        let [from, to] = match self {
            Self::Curvature { .. } => [0.53, 0.62],
            Self::Occlusion { .. } => [0.1, 0.6],
            Self::Distance { .. } => [0.3, 0.1],
            Self::Height { .. } => [0.0, 1.0],
            Self::Slope { .. } => [0.4, 0.25],
            Self::Noise { .. } => [0.45, 0.55],
        };
        MaskSource { by: self, from, to }
    }
}

impl MaskSource {
    /// The mask where the measure has a value.
    pub fn mask(&self, measure: f32) -> f32 {
        let mask = match self.from <= self.to {
            true => smoothstep(self.from, self.to.max(self.from + 1e-6), measure),
            false => 1.0 - smoothstep(self.to, self.from, measure),
        };
        // Numbers that are none hide.
        mask.max(0.0)
    }
}

/// A measure, ready to be asked at points.
#[derive(Clone, Debug)]
pub(crate) enum Measured {
    Lattices(Lattices),
    /// From a place, and the diagonal of the box, mesh units.
    Distance(DVec3, f64),
    /// Axis, lower end and length of the box, mesh units.
    Height(usize, f32, f32),
    Slope(usize),
    /// With its frequency.
    Noise(FractalNoise, f32),
}

impl Measured {
    pub(crate) fn new(surface: &Surface, by: MaskMeasure) -> Self {
        let diagonal = surface.space().bounds().extent().length();
        let bounds = surface.mesh().bounds();
        let mesh_diagonal = bounds.extent().length();
        match by {
            MaskMeasure::Curvature { radius } => Self::Lattices(Lattices::measure(
                surface,
                radius.max(1e-3) * mesh_diagonal,
                |at, normal, radius, count| {
                    let [out, within] =
                        [normal, -normal].map(|side| hidden(surface, at, side, radius, count, |_| 1.0));
                    0.5 + 0.5 * (within - out)
                },
            )),
            MaskMeasure::Occlusion { radius } => Self::Lattices(Lattices::measure(
                surface,
                radius.max(1e-3) * mesh_diagonal,
                |at, normal, radius, count| hidden(surface, at, normal, radius, count, |cosine| cosine),
            )),
            MaskMeasure::Distance { to } => {
                let to = surface.mesh().world_from_mesh.inverse_point(DVec3::from(to)).as_dvec3();
                Self::Distance(to, f64::from(mesh_diagonal).max(f64::MIN_POSITIVE))
            }
            MaskMeasure::Height { axis } => {
                let axis = axis.min(2);
                Self::Height(axis, bounds.min[axis], bounds.extent()[axis].max(f32::MIN_POSITIVE))
            }
            MaskMeasure::Slope { axis } => Self::Slope(axis.min(2)),
            MaskMeasure::Noise { scale, seed } => {
                let octaves = Fractal::octaves(5);
                let noise = FractalNoise::new(NoiseFamily::Perlin, FractalKind::Fbm, octaves, seed);
                Self::Noise(noise, 1.0 / (scale.max(1e-4) * diagonal.max(f32::MIN_POSITIVE)))
            }
        }
    }

    /// The measure at a point; `footprint` is a texel's width, mesh units.
    pub(crate) fn at(&self, surface: &Surface, point: SurfacePoint, footprint: f32) -> f32 {
        match self {
            Self::Lattices(lattices) => lattices.at(point),
            Self::Distance(to, diagonal) => {
                ((surface.position(point) - *to).length() / diagonal).clamp(0.0, 1.0) as f32
            }
            Self::Height(axis, low, length) => {
                ((surface.position(point).as_vec3()[*axis] - low) / length).clamp(0.0, 1.0)
            }
            Self::Slope(axis) => outer(surface, point)[*axis].clamp(-1.0, 1.0).acos() / PI,
            Self::Noise(noise, frequency) => {
                let space = surface.space();
                let at = space.point(surface.position(point).as_vec3()) * *frequency;
                let footprint = space.vector(Vec3::X * footprint).x * frequency;
                (0.5 + 0.5 * noise.value(at.to_array(), footprint)).clamp(0.0, 1.0)
            }
        }
    }
}

/// The unit normal of the smooth surface, on its outer side.
fn outer(surface: &Surface, point: SurfacePoint) -> Vec3 {
    let (normal, facet) = (surface.normal(point), surface.outer_normal(point.triangle).as_vec3());
    if surface.facet_normal(point.triangle).as_vec3().dot(facet) < 0.0 { -normal } else { normal }
}

/// The weighted share of the directions on a side in which something lies within `radius`; what is near counts more.
fn hidden(
    surface: &Surface,
    at: Vec3,
    side: Vec3,
    radius: f32,
    count: u32,
    weight: impl Fn(f32) -> f32,
) -> f32 {
    let turn = Quat::from_rotation_arc(Vec3::Z, side);
    let origin = at + side * (1e-3 * radius);
    let (mut sum, mut total) = (0.0, 0.0);
    for k in 0..count {
        // Even in area: a Fibonacci spiral on the half sphere.
        let cosine = (k as f32 + 0.5) / count as f32;
        let (sin, cos) = (TAU * (k as f32 * 0.618_034).fract()).sin_cos();
        let flat = (1.0 - cosine * cosine).sqrt();
        let direction = turn * Vec3::new(flat * cos, flat * sin, cosine);
        let hit = surface.bvh().first_hit(origin, direction, radius);
        let near = hit.map_or(0.0, |hit| 1.0 - (hit.distance / radius).min(1.0) * 0.5);
        sum += near * weight(cosine);
        total += weight(cosine);
    }
    sum / total
}

// Values at lattice points of triangles.

/// Points at which something is measured, about.
const MAX_POINTS: usize = 200_000;

/// Rays from all points, about, and from each.
const MAX_RAYS: usize = 8_000_000;
const RAYS: [usize; 2] = [12, 64];

/// Parts of a triangle's side at most.
const MAX_PARTS: u32 = 64;

/// Values at a triangle's points `[i, j, n - i - j] / n`, per triangle.
#[derive(Clone, Debug)]
pub(crate) struct Lattices {
    /// Where a triangle's values begin, and its `n`.
    triangles: Vec<(u32, u32)>,
    values: Vec<f32>,
}

impl Lattices {
    /// Measures by position, outer normal, radius and number of rays.
    fn measure(surface: &Surface, radius: f32, measure: impl Fn(Vec3, Vec3, f32, u32) -> f32 + Sync) -> Self {
        let mesh = surface.mesh();
        let sides: Vec<f32> = (0..mesh.triangles.len())
            .map(|t| {
                let [a, b, c] = mesh.triangle_positions(t);
                a.distance(b).max(b.distance(c)).max(c.distance(a))
            })
            .collect();
        let step = lattice_step(&sides, radius);
        // Corners of neighbours with the same normal are measured once.
        let mut known: BTreeMap<(u32, [u32; 3]), u32> = BTreeMap::new();
        let (mut places, mut slots, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for (t, &side) in (0u32..).zip(&sides) {
            let n = parts(side, step);
            triangles.push((slots.len() as u32, n));
            for j in 0..=n {
                for i in 0..=n - j {
                    let lambda = Vec3::new(i as f32, j as f32, (n - i - j) as f32) / n as f32;
                    let corner = (0..3).find(|&k| lambda[k] == 1.0);
                    // A little inside, so that rays start on this triangle's side of an edge.
                    let inside = lambda.lerp(Vec3::splat(1.0 / 3.0), 0.02 / n as f32);
                    let place = SurfacePoint { triangle: t, lambda: inside };
                    let mut new = || {
                        places.push(place);
                        places.len() as u32 - 1
                    };
                    slots.push(match corner {
                        None => new(),
                        Some(k) => {
                            let normal = surface.normals().of_triangle(t)[k].to_array().map(f32::to_bits);
                            let key = (mesh.triangles[t as usize][k], normal);
                            *known.entry(key).or_insert_with(new)
                        }
                    });
                }
            }
        }
        let count = (MAX_RAYS / places.len().max(1)).clamp(RAYS[0], RAYS[1]) as u32;
        let measured = places
            .par_iter()
            .map(|&place| measure(surface.position(place).as_vec3(), outer(surface, place), radius, count));
        let measured: Vec<f32> = measured.collect();
        Self { triangles, values: slots.into_iter().map(|slot| measured[slot as usize]).collect() }
    }

    fn at(&self, point: SurfacePoint) -> f32 {
        let (start, n) = self.triangles[point.triangle as usize];
        let lambda = point.lambda.max(Vec3::ZERO) / point.lambda.max(Vec3::ZERO).element_sum();
        let value = |i: u32, j: u32| {
            let row = j * (n + 1) - j * j.saturating_sub(1) / 2;
            self.values[(start + row + i) as usize]
        };
        let [x, y] = [lambda.x, lambda.y].map(|l| l * n as f32);
        let j = (y as u32).min(n - 1);
        let i = (x as u32).min(n - 1 - j);
        let [x, y] = [x - i as f32, y - j as f32];
        if x + y <= 1.0 || i + j + 2 > n {
            let [a, b, c] = [value(i, j), value(i + 1, j), value(i, j + 1)];
            interpolate([a, b, c], Vec3::new(1.0 - x - y, x, y))
        } else {
            let [a, b, c] = [value(i + 1, j + 1), value(i, j + 1), value(i + 1, j)];
            interpolate([a, b, c], Vec3::new(x + y - 1.0, 1.0 - x, 1.0 - y))
        }
    }
}

/// How far apart the points are, about, on triangles whose longest sides are given: near enough for a radius, unless there are too many.
fn lattice_step(sides: &[f32], radius: f32) -> f32 {
    let mut step = 0.4 * radius;
    if !step.is_normal() {
        // What underflows does not grow: each triangle has its corners.
        return f32::INFINITY;
    }
    let points = |step: f32| sides.iter().map(|&side| points_of(parts(side, step))).sum::<usize>();
    while points(step) > MAX_POINTS.max(3 * sides.len()) {
        step *= 1.3;
    }
    step
}

/// Parts of a side.
fn parts(side: f32, step: f32) -> u32 {
    ((side / step).ceil().min(MAX_PARTS as f32) as u32).max(1)
}

fn points_of(parts: u32) -> usize {
    ((parts + 1) * (parts + 2) / 2) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattices_give_linear_values_back() {
        let f = |l: Vec3| 0.3 + 0.5 * l.x - 0.2 * l.y;
        for n in [1, 2, 5] {
            let values = (0..=n).flat_map(|j| (0..=n - j).map(move |i| [i, j]));
            let values = values.map(|[i, j]| f(Vec3::new(i as f32, j as f32, 0.0) / n as f32));
            let lattices = Lattices { triangles: vec![(0, n)], values: values.collect() };
            for k in 0..=20 {
                for m in 0..=20 - k {
                    let lambda = Vec3::new(k as f32, m as f32, (20 - k - m) as f32) / 20.0;
                    let found = lattices.at(SurfacePoint { triangle: 0, lambda });
                    assert!((found - f(lambda)).abs() < 1e-5, "{n} {lambda} {found}");
                }
            }
        }
    }

    /// Sides of a mesh that is as small as numbers get, and smaller.
    #[test]
    fn lattices_of_tiny_triangles_have_their_corners() {
        let sides = vec![1e-44; 100_000];
        for radius in [0.0, f32::from_bits(1), 1e-44, 1e-39, f32::NAN] {
            let step = lattice_step(&sides, radius);
            assert!(sides.iter().all(|&side| parts(side, step) == 1), "{radius:e}");
        }
        // Others are divided, as finely as there is room for.
        let [few, many] = [10, 100_000].map(|count| lattice_step(&vec![1.0; count], 0.25));
        assert_eq!((few, parts(1.0, few)), (0.1, 10));
        assert!(many > few && parts(1.0, many) == 1, "{many}");
    }

    #[test]
    fn masks_rise_or_fall_between_their_bounds() {
        let rising = MaskSource { from: 0.2, to: 0.6, ..MaskMeasure::Height { axis: 1 }.source() };
        let is = |mask: &MaskSource, expected: [f32; 5]| {
            let found = [0.1, 0.2, 0.4, 0.6, 0.9].map(|x| mask.mask(x));
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-6), "{found:?}");
        };
        is(&rising, [0.0, 0.0, 0.5, 1.0, 1.0]);
        let falling = MaskSource { from: 0.6, to: 0.2, ..rising };
        is(&falling, [1.0, 1.0, 0.5, 0.0, 0.0]);
        let hard = MaskSource { from: 0.5, to: 0.5, ..rising };
        assert_eq!([0.4, 0.6].map(|x| hard.mask(x)), [0.0, 1.0]);
    }
}
