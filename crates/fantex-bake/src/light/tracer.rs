//! Light that arrives at a point of the surface, by following paths backwards (J. Kajiya, "The Rendering Equation", 1986).
//!
//! What is estimated is what a white, perfectly diffuse surface there would reflect: irradiance over pi, the mean of the
//! incoming radiance over the hemisphere weighted by the cosine. Lamps are sampled on purpose at every vertex of a path, and so
//! is a sky of high contrast (`sky_table.rs`). Other skies and glowing surfaces are found by the cosine-weighted directions along
//! which paths go on; long paths end by Russian roulette.

use std::f32::consts::PI;

use fantex_mesh::{Mesh, RayHit, SURFACE_OFFSET, TriangleBvh, origin_beside};
use glam::Vec3;

use super::lamp::Lamp;
use super::sequence::Sequence;
use super::sky_table::SkyTable;
use super::{LightMapOptions, LightQuantity, Reflector, Sky};

/// Vertices of a path before Russian roulette.
const SURE_VERTICES: u32 = 3;

/// Pairs of dimensions: the first is the place within the texel, then come those of each vertex of the path.
const TEXEL: u32 = 0;
const DIRECTION: u32 = 1;
const FATE: u32 = 2;
/// And those of the lamps after it.
const LAMP: u32 = 3;
const PER_VERTEX: u32 = 1 << 16;
const SKY: u32 = PER_VERTEX - 1;

/// Lamps that are all sampled at the first vertex of a path; of more, so many are chosen.
const FEW_LAMPS: usize = 4;

/// Where light is gathered.
#[derive(Clone, Copy)]
pub(super) struct Receiver {
    /// Where rays start, mesh space.
    pub(super) origin: Vec3,
    /// Unit normal.
    pub(super) normal: Vec3,
}

/// The scene in mesh space.
pub(super) struct Tracer<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) bvh: TriangleBvh,
    /// Per corner.
    pub(super) normals: Vec<Vec3>,
    pub(super) lamps: Vec<Lamp>,
    pub(super) sky: &'a dyn Sky,
    /// Where the sky is worth looking at on purpose.
    pub(super) sky_table: Option<SkyTable>,
    pub(super) reflector: &'a dyn Reflector,
    pub(super) options: LightMapOptions,
    /// Mesh units.
    pub(super) occlusion_distance: f32,
}

impl Tracer<'_> {
    /// One sample at a point of a triangle; `lambda_steps` span the texel.
    pub(super) fn sample(
        &self,
        triangle: usize,
        lambda: Vec3,
        lambda_steps: [Vec3; 2],
        sequence: &Sequence,
        index: u32,
    ) -> Vec3 {
        let [u, v] = sequence.pair(index, TEXEL);
        let moved = lambda + lambda_steps[0] * (u - 0.5) + lambda_steps[1] * (v - 0.5);
        let receiver = self.receiver(triangle, on_triangle(moved));
        if self.options.quantity == LightQuantity::AmbientOcclusion {
            let direction = cosine_weighted(receiver.normal, sequence.pair(index, DIRECTION));
            let open = !self.is_shadowed(receiver.origin, direction, self.occlusion_distance);
            return Vec3::splat(f32::from(u8::from(open)));
        }
        self.arriving_light(receiver, sequence, index)
    }

    /// A point of the front of a triangle. Where asked for, it is lifted to the surface that vertex normals suggest:
    /// the mean of its projections onto the tangent planes at those corners above whose planes it does not lie.
    fn receiver(&self, triangle: usize, lambda: Vec3) -> Receiver {
        let corners = self.mesh.triangle_positions(triangle);
        let normals = [0, 1, 2].map(|k| self.normals[3 * triangle + k]);
        let blend = |v: [Vec3; 3]| v[0] * lambda.x + v[1] * lambda.y + v[2] * lambda.z;
        let position = blend(corners);
        let face = face_normal(corners);
        let normal = blend(normals).try_normalize().unwrap_or(face);
        let mut origin = position;
        if self.options.smooth_terminator {
            let lift = |k: usize| normals[k] * -(position - corners[k]).dot(normals[k]).min(0.0);
            origin += blend([0, 1, 2].map(lift));
        }
        Receiver { origin: origin_beside(origin, face, normal), normal }
    }

    /// A path that starts at `receiver`.
    fn arriving_light(&self, mut receiver: Receiver, sequence: &Sequence, index: u32) -> Vec3 {
        let reflections = self.options.reflections();
        let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        for vertex in 0..=reflections {
            let pair = |purpose: u32| sequence.pair(index, vertex * PER_VERTEX + purpose);
            sum += throughput * self.lamp_light(receiver, vertex, &pair);
            sum += throughput * self.sky_light(receiver, pair(SKY));
            let direction = cosine_weighted(receiver.normal, pair(DIRECTION));
            let accept = |hit: &RayHit| self.reflector.is_solid(hit.triangle, hit.lambda);
            let Some(hit) = self.bvh.first_hit_where(receiver.origin, direction, f32::INFINITY, accept)
            else {
                let weight = self.weight_of_cosine(receiver.normal, direction);
                return sum + throughput * self.sky.radiance(direction) * weight;
            };
            sum += throughput * self.reflector.emission(hit.triangle, hit.lambda);
            if vertex == reflections {
                break;
            }
            throughput *= self.reflector.albedo(hit.triangle, hit.lambda);
            let survival = if vertex < SURE_VERTICES { 1.0 } else { throughput.max_element().min(1.0) };
            if throughput == Vec3::ZERO || pair(FATE)[0] >= survival {
                break;
            }
            throughput /= survival;
            receiver = self.reflecting_point(&hit, direction);
        }
        sum
    }

    /// Where a ray met the surface, on the side that it came from.
    fn reflecting_point(&self, hit: &RayHit, direction: Vec3) -> Receiver {
        let corners = self.mesh.triangle_positions(hit.triangle);
        let face = face_normal(corners);
        let normal = if hit.front { face } else { -face };
        let position = corners[0] * hit.lambda.x + corners[1] * hit.lambda.y + corners[2] * hit.lambda.z;
        Receiver { origin: origin_beside(position, face, -direction), normal }
    }

    /// Reflected light of the sky from a direction that was chosen by its brightness, weighed against directions by the cosine.
    fn sky_light(&self, receiver: Receiver, random: [f32; 2]) -> Vec3 {
        let Some(table) = &self.sky_table else { return Vec3::ZERO };
        let sample = table.sample(random);
        let by_cosine = receiver.normal.dot(sample.direction) / PI;
        if by_cosine <= 0.0 || self.is_shadowed(receiver.origin, sample.direction, f32::INFINITY) {
            return Vec3::ZERO;
        }
        // Radiance times cosine over pi and density, times the density's share in the sum of both densities.
        self.sky.radiance(sample.direction) * (by_cosine / (sample.density + by_cosine))
    }

    /// The weight of a direction that was chosen by the cosine, and leads to the sky.
    fn weight_of_cosine(&self, normal: Vec3, direction: Vec3) -> f32 {
        let density = self.sky_table.as_ref().map_or(0.0, |table| table.density(direction));
        if density == 0.0 {
            return 1.0;
        }
        let by_cosine = normal.dot(direction).max(0.0) / PI;
        by_cosine / (density + by_cosine)
    }

    /// Reflected light of lamps: of a few of them at the first vertex of a path, then of one.
    fn lamp_light(&self, receiver: Receiver, vertex: u32, pair: &impl Fn(u32) -> [f32; 2]) -> Vec3 {
        let light_of = |lamp: usize, purpose: usize| {
            let Some(sample) = self.lamps[lamp].sample(receiver.origin, pair(LAMP + purpose as u32)) else {
                return Vec3::ZERO;
            };
            let cos = receiver.normal.dot(sample.to_light);
            let reaches = sample.distance - 2.0 * SURFACE_OFFSET;
            let dark = cos <= 0.0 || self.is_shadowed(receiver.origin, sample.to_light, reaches);
            if dark { Vec3::ZERO } else { sample.color * cos }
        };
        let choices = if vertex == 0 { FEW_LAMPS } else { 1 };
        if self.lamps.len() <= choices {
            return (0..self.lamps.len()).map(|lamp| light_of(lamp, lamp)).sum();
        }
        let most_light = |lamp: &Lamp| lamp.most_light(receiver.origin, receiver.normal);
        let chosen = Choices::new(self.lamps.iter().map(most_light), choices, pair(FATE)[1]);
        chosen.enumerate().map(|(number, (lamp, factor))| light_of(lamp, number) * factor).sum()
    }

    fn is_shadowed(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        let accept = |hit: &RayHit| self.reflector.is_solid(hit.triangle, hit.lambda);
        self.bvh.is_occluded_where(origin, direction, distance, accept)
    }
}

/// Some of many lamps, each as often as its share in the sum of what they give at most, with what its light is to be
/// multiplied by. Choices are made at equal steps through that sum.
struct Choices<I> {
    /// Lamps that are not yet passed.
    rest: std::iter::Enumerate<I>,
    /// The last one that was passed, what it gives at most, and the sum up to its end.
    lamp: usize,
    most: f32,
    sum: f32,
    /// Where the next choice is made, and the way to the one after it.
    next: f32,
    step: f32,
    count: usize,
}

impl<I: Iterator<Item = f32> + Clone> Choices<I> {
    /// `random` is in 0..1.
    fn new(most_light: I, count: usize, random: f32) -> Self {
        let step = most_light.clone().sum::<f32>() / count as f32;
        let count = if step > 0.0 { count } else { 0 };
        let rest = most_light.enumerate();
        Self { rest, lamp: 0, most: 0.0, sum: 0.0, next: random * step, step, count }
    }
}

impl<I: Iterator<Item = f32>> Iterator for Choices<I> {
    type Item = (usize, f32);

    fn next(&mut self) -> Option<(usize, f32)> {
        self.count = self.count.checked_sub(1)?;
        while self.next >= self.sum {
            (self.lamp, self.most) = self.rest.next()?;
            self.sum += self.most;
        }
        self.next += self.step;
        Some((self.lamp, self.step / self.most))
    }
}

/// Barycentric coordinates beside the triangle, moved onto it.
fn on_triangle(lambda: Vec3) -> Vec3 {
    let inside = lambda.max(Vec3::ZERO);
    inside / inside.element_sum()
}

/// Unit normal of the front.
fn face_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    (b - a).cross(c - a).normalize_or(glam::DVec3::Z).as_vec3()
}

/// A direction whose density is its cosine to the normal over pi: the disc, by concentric squares (P. Shirley and K. Chiu,
/// "A Low Distortion Map between Disk and Square", 1997), lifted to the hemisphere.
fn cosine_weighted(normal: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let (radius, angle) = if a.abs() > b.abs() {
        (a, std::f32::consts::FRAC_PI_4 * (b / a))
    } else if b != 0.0 {
        (b, std::f32::consts::FRAC_PI_2 - std::f32::consts::FRAC_PI_4 * (a / b))
    } else {
        (0.0, 0.0)
    };
    let (sin, cos) = angle.sin_cos();
    let (x, y) = normal.any_orthonormal_pair();
    let height = (1.0 - radius * radius).max(0.0).sqrt();
    (x * (radius * cos) + y * (radius * sin) + normal * height).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over all random numbers, the weighted number of choices of every lamp that gives light is one.
    #[test]
    fn lamps_are_chosen_by_their_share() {
        let most = [0.5_f32, 0.0, 3.0, 0.01, 1.5, 0.0];
        for count in [1, 4] {
            let (mut sums, mut numbers, n) = ([0.0_f64; 6], [0; 6], 20_000);
            for i in 0..n {
                let random = (i as f32 + 0.5) / n as f32;
                let chosen: Vec<_> = Choices::new(most.into_iter(), count, random).collect();
                assert_eq!(chosen.len(), count);
                for (lamp, factor) in chosen {
                    sums[lamp] += f64::from(factor) / f64::from(n);
                    numbers[lamp] += 1;
                }
            }
            for lamp in 0..most.len() {
                let expected = f64::from(u8::from(most[lamp] > 0.0));
                assert!((sums[lamp] - expected).abs() < 0.02, "{count} of {most:?}: {sums:?}");
            }
            assert!(numbers[2] > 5 * numbers[0] && numbers[0] > 20 * numbers[3], "{numbers:?}");
        }
        assert_eq!(Choices::new([0.0; 6].into_iter(), 4, 0.3).count(), 0);
    }

    /// The mean of a cosine-weighted direction is two thirds of the normal; the mean square of its height is a half.
    #[test]
    fn directions_have_the_moments_of_the_cosine() {
        let sequence = Sequence::new(1);
        for normal in [Vec3::Z, Vec3::NEG_Z, Vec3::new(1.0, -2.0, 0.5).normalize()] {
            let n = 4096;
            let (mut mean, mut square) = (Vec3::ZERO, 0.0);
            for i in 0..n {
                let direction = cosine_weighted(normal, sequence.pair(i, 0));
                assert!(direction.is_normalized() && direction.dot(normal) >= -1e-6);
                mean += direction / n as f32;
                square += direction.dot(normal).powi(2) / n as f32;
            }
            assert!((mean - normal * (2.0 / 3.0)).length() < 1e-3, "{mean}");
            assert!((square - 0.5).abs() < 1e-3, "{square}");
        }
    }
}
