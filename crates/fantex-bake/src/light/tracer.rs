//! Light that arrives at a point of the surface, by following paths backwards (J. Kajiya, "The Rendering Equation", 1986).
//!
//! What is estimated is what a white, perfectly diffuse surface there would reflect: irradiance over pi, the mean of the
//! incoming radiance over the hemisphere weighted by the cosine. Lamps are sampled on purpose at every vertex of a path, sky and
//! glowing surfaces are found by cosine-weighted directions, and long paths end by Russian roulette.

use fantex_mesh::{Mesh, RayHit, SURFACE_OFFSET, TriangleBvh, origin_beside};
use glam::Vec3;

use super::lamp::Lamp;
use super::sequence::Sequence;
use super::{LightMapOptions, LightQuantity, Reflector, Sky};

/// Vertices of a path before Russian roulette.
const SURE_VERTICES: u32 = 3;

/// Pairs of dimensions: the first is the place within the texel, then come those of each vertex of the path.
const TEXEL: u32 = 0;
const DIRECTION: u32 = 1;
const FATE: u32 = 2;
const LAMP: u32 = 3;
const PER_VERTEX: u32 = 1 << 16;

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
            let direction = cosine_weighted(receiver.normal, pair(DIRECTION));
            let accept = |hit: &RayHit| self.reflector.is_solid(hit.triangle, hit.lambda);
            let Some(hit) = self.bvh.first_hit_where(receiver.origin, direction, f32::INFINITY, accept)
            else {
                return sum + throughput * self.sky.radiance(direction);
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

    /// Reflected light of lamps: of all of them at the first vertex of a path, then of one by chance.
    fn lamp_light(&self, receiver: Receiver, vertex: u32, pair: &impl Fn(u32) -> [f32; 2]) -> Vec3 {
        let count = self.lamps.len();
        let light_of = |lamp: usize| {
            let Some(sample) = self.lamps[lamp].sample(receiver.origin, pair(LAMP + lamp as u32)) else {
                return Vec3::ZERO;
            };
            let cos = receiver.normal.dot(sample.to_light);
            let reaches = sample.distance - 2.0 * SURFACE_OFFSET;
            let dark = cos <= 0.0 || self.is_shadowed(receiver.origin, sample.to_light, reaches);
            if dark { Vec3::ZERO } else { sample.color * cos }
        };
        match (vertex, count) {
            (0, _) | (_, 0 | 1) => (0..count).map(light_of).sum(),
            _ => {
                let chosen = (pair(FATE)[1] * count as f32) as usize;
                light_of(chosen.min(count - 1)) * count as f32
            }
        }
    }

    fn is_shadowed(&self, origin: Vec3, direction: Vec3, distance: f32) -> bool {
        let accept = |hit: &RayHit| self.reflector.is_solid(hit.triangle, hit.lambda);
        self.bvh.is_occluded_where(origin, direction, distance, accept)
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
