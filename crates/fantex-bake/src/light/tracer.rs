//! Light that arrives at a point of the surface, by following paths backwards (J. Kajiya, "The Rendering Equation", 1986).
//!
//! What is estimated is what a white, perfectly diffuse surface there would reflect: irradiance over pi, the mean of the
//! incoming radiance over the hemisphere weighted by the cosine. Lamps are sampled on purpose at every vertex of a path, and so
//! is a sky of high contrast (`sky_table.rs`). Other skies and glowing surfaces are found by the cosine-weighted directions along
//! which paths go on; long paths end by Russian roulette.

use std::f32::consts::PI;

use fantex_base::{Error, Result};
use fantex_mesh::{Mesh, RayHit, SURFACE_OFFSET, SurfacePoint, TriangleBvh, WorldFromMesh, origin_beside};
use fantex_scene::ConeFalloff;
use glam::{DVec3, Vec3};

use crate::LightQuantity;
use crate::light::sky_table::SkyTable;
use crate::light::{LightMapOptions, Reflector, Sky};

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

/// Points keep so far from the sides of their triangle, mesh units. Where two faces meet at 15 degrees, the offset of rays is still in front
/// of both.
const MARGIN: f32 = 4.0 * SURFACE_OFFSET;

/// Directions in which a point is looked at to know whether it is enclosed: their distance from the normal as a sine, and their angle around
/// it in degrees. The first is the one that most often leads into the open.
const PROBES: [[f32; 2]; 9] = [
    [0.0, 0.0],
    [0.6, 0.0],
    [0.6, 120.0],
    [0.6, 240.0],
    [0.97, 36.0],
    [0.97, 108.0],
    [0.97, 180.0],
    [0.97, 252.0],
    [0.97, 324.0],
];

/// Lamps that are all sampled at the first vertex of a path; of more, so many are chosen.
const FEW_LAMPS: usize = 4;

#[derive(Clone, Copy)]
struct Receiver {
    /// Where rays start, mesh space.
    origin: Vec3,
    /// Unit normal.
    normal: Vec3,
}

pub(crate) struct Tracer<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) bvh: TriangleBvh,
    /// Per corner.
    pub(crate) normals: Vec<Vec3>,
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) sky: &'a dyn Sky,
    /// Where the sky is worth looking at on purpose.
    pub(crate) sky_table: Option<SkyTable>,
    pub(crate) reflector: &'a dyn Reflector,
    pub(crate) options: LightMapOptions,
    /// Mesh units.
    pub(crate) occlusion_distance: f32,
}

impl Tracer<'_> {
    /// One sample at a point of a triangle; `lambda_steps` span the texel.
    pub(crate) fn sample(
        &self,
        at: SurfacePoint,
        lambda_steps: [Vec3; 2],
        sequence: &Sequence,
        index: u32,
    ) -> Vec3 {
        let receiver = self.receiver(self.place(at, lambda_steps, sequence, index));
        if self.options.quantity == LightQuantity::AmbientOcclusion {
            let direction = cosine_weighted(receiver.normal, sequence.pair(index, DIRECTION));
            let open = !self.is_shadowed(receiver.origin, direction, self.occlusion_distance);
            return Vec3::splat(f32::from(u8::from(open)));
        }
        self.arriving_light(receiver, sequence, index)
    }

    /// Where in the texel a sample is taken.
    fn place(
        &self,
        at: SurfacePoint,
        lambda_steps: [Vec3; 2],
        sequence: &Sequence,
        index: u32,
    ) -> SurfacePoint {
        let [u, v] = sequence.pair(index, TEXEL);
        let moved = at.lambda + lambda_steps[0] * (u - 0.5) + lambda_steps[1] * (v - 0.5);
        self.inside(SurfacePoint { lambda: moved, ..at }.clamped())
    }

    /// Whether a sample is taken inside or under something, such as on the floor below a box: on all sides there are surfaces, seen from
    /// behind. It does not depend on the directions in which the sample looks.
    pub(crate) fn is_enclosed(
        &self,
        at: SurfacePoint,
        lambda_steps: [Vec3; 2],
        sequence: &Sequence,
        index: u32,
    ) -> bool {
        let Receiver { origin, normal } = self.receiver(self.place(at, lambda_steps, sequence, index));
        let (x, y) = normal.any_orthonormal_pair();
        PROBES.iter().all(|&[sine, degrees]| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let direction = (x * cos + y * sin) * sine + normal * (1.0 - sine * sine).sqrt();
            let accept = |hit: &RayHit| self.reflector.is_solid(hit.point);
            let hit = self.bvh.first_hit_where(origin, direction.normalize(), f32::INFINITY, accept);
            hit.is_some_and(|hit| !hit.front)
        })
    }

    /// A point of a triangle that is not on its sides: there it would lie in the plane of the neighbour, and see past it. It is moved
    /// towards the centre of the inscribed circle.
    fn inside(&self, at: SurfacePoint) -> SurfacePoint {
        let [a, b, c] = self.mesh.triangle_positions(at.index());
        let sides = Vec3::new(b.distance(c), c.distance(a), a.distance(b));
        let perimeter = sides.element_sum();
        let radius = (b - a).cross(c - a).length() / perimeter;
        let share = MARGIN / radius.max(MARGIN);
        SurfacePoint { lambda: at.lambda.lerp(sides / perimeter, share), ..at }
    }

    /// A point of the front of a triangle. Where asked for, it is lifted to the surface that vertex normals suggest:
    /// the mean of its projections onto the tangent planes at those corners above whose planes it does not lie.
    fn receiver(&self, at: SurfacePoint) -> Receiver {
        let corners = self.mesh.triangle_positions(at.index());
        let normals = at.corner_values(&self.normals);
        let position = at.interpolate(corners);
        let face = face_normal(corners);
        let normal = at.smooth_normal(&self.normals).unwrap_or(face);
        let mut origin = position;
        if self.options.smooth_terminator {
            let lift = |k: usize| normals[k] * -(position - corners[k]).dot(normals[k]).min(0.0);
            origin += at.interpolate([0, 1, 2].map(lift));
        }
        Receiver { origin: origin_beside(origin, face, normal), normal }
    }

    fn arriving_light(&self, mut receiver: Receiver, sequence: &Sequence, index: u32) -> Vec3 {
        let reflections = self.options.reflections();
        let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        for vertex in 0..=reflections {
            let pair = |purpose: u32| sequence.pair(index, vertex * PER_VERTEX + purpose);
            sum += throughput * self.lamp_light(receiver, vertex, &pair);
            sum += throughput * self.sky_light(receiver, pair(SKY));
            let direction = cosine_weighted(receiver.normal, pair(DIRECTION));
            let accept = |hit: &RayHit| self.reflector.is_solid(hit.point);
            let Some(hit) = self.bvh.first_hit_where(receiver.origin, direction, f32::INFINITY, accept)
            else {
                let weight = self.weight_of_cosine(receiver.normal, direction);
                return sum + throughput * self.sky.radiance(direction) * weight;
            };
            sum += throughput * self.reflector.emission(hit.point);
            if vertex == reflections {
                break;
            }
            throughput *= self.reflector.albedo(hit.point);
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
        let corners = self.mesh.triangle_positions(hit.point.index());
        let face = face_normal(corners);
        let normal = if hit.front { face } else { -face };
        let position = hit.point.interpolate(corners);
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
        let accept = |hit: &RayHit| self.reflector.is_solid(hit.point);
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

// Lights that are sampled on purpose: from one direction, from a small ball, from a ball behind a cone.

/// A light, in world space. Colours are linear RGB: what a white, perfectly diffuse surface that faces the light reflects (for
/// lights with a position: at a distance of one world unit, falling off with the square of the distance).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BakeLight {
    /// Light from one direction, as from the sun.
    Directional {
        /// From the surface to the light; any length but zero.
        to_light: Vec3,
        /// Not negative.
        color: Vec3,
        /// Half the angle under which the light is seen, 0 to 90 degrees (the sun: 0.27). 0 gives hard shadows.
        radius_degrees: f32,
    },
    /// Light from a ball.
    Point {
        /// Its centre.
        position: DVec3,
        /// Not negative.
        color: Vec3,
        /// Radius, not negative; 0 gives hard shadows.
        radius: f64,
    },
    /// Light from a ball, within a cone.
    Spot {
        /// Its centre.
        position: DVec3,
        /// From the light along the cone's axis; any length but zero.
        axis: Vec3,
        /// Not negative.
        color: Vec3,
        /// Radius, not negative; 0 gives hard shadows.
        radius: f64,
        /// Up to this angle from the axis the light has its full strength, 0 to `outer_degrees`.
        inner_degrees: f32,
        /// From this angle on there is none, above `inner_degrees`, at most 180.
        outer_degrees: f32,
    },
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Lamp {
    Directional { to_light: Vec3, color: Vec3, cos_radius: f32 },
    Ball { position: Vec3, color: Vec3, radius: f32, cone: Option<Cone> },
}

/// What a spot light lets through.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone {
    axis: Vec3,
    falloff: ConeFalloff,
}

impl Cone {
    /// The share of the light that leaves along a unit direction.
    fn share(&self, from_light: Vec3) -> f32 {
        self.falloff.share(self.axis.dot(from_light))
    }
}

/// A direction to a light, and what would arrive along it.
pub(crate) struct LampSample {
    /// Unit vector.
    to_light: Vec3,
    /// Nothing beyond this distance casts a shadow, mesh units.
    pub(crate) distance: f32,
    /// What a white surface reflects, per cosine between its normal and `to_light`.
    pub(crate) color: Vec3,
}

/// A lamp as it is seen from a point.
struct Appearance {
    /// Unit vector to its middle.
    axis: Vec3,
    /// Cosine of half the angle under which it is seen.
    cos_radius: f32,
    /// As in [`LampSample`], the same in all its directions.
    color: Vec3,
}

impl Lamp {
    pub(crate) fn new(mesh: &Mesh, index: usize, light: &BakeLight) -> Result<Self> {
        let checks = Checks { light: index };
        let of_mesh = &mesh.world_from_mesh;
        match *light {
            BakeLight::Directional { to_light, color, radius_degrees } => {
                checks.color(color)?;
                let cos_radius = checks.angle("radius_degrees", radius_degrees, 0.0, 90.0)?.cos();
                Ok(Self::Directional { to_light: checks.direction("to_light", to_light)?, color, cos_radius })
            }
            BakeLight::Point { position, color, radius } => {
                checks.ball(of_mesh, position, color, radius, None)
            }
            BakeLight::Spot { position, axis, color, radius, inner_degrees, outer_degrees } => {
                checks.angle("inner_degrees", inner_degrees, 0.0, outer_degrees)?;
                checks.angle("outer_degrees", outer_degrees, inner_degrees, 180.0)?;
                let axis = checks.direction("axis", axis)?;
                let cone = Cone { axis, falloff: ConeFalloff::new(inner_degrees, outer_degrees) };
                checks.ball(of_mesh, position, color, radius, Some(cone))
            }
        }
    }

    /// A random direction from `point` to the light; `None` where no light goes there.
    pub(crate) fn sample(&self, point: Vec3, random: [f32; 2]) -> Option<LampSample> {
        let Appearance { axis, cos_radius, color } = self.seen_from(point)?;
        let to_light = in_cone(axis, cos_radius, random);
        let distance = match *self {
            Self::Directional { .. } => f32::INFINITY,
            Self::Ball { position, radius, .. } => {
                let to_centre = position - point;
                let along = to_light.dot(to_centre);
                let within = along * along - to_centre.length_squared() + radius * radius;
                (along - within.max(0.0).sqrt()).max(0.0)
            }
        };
        Some(LampSample { to_light, distance, color })
    }

    /// What a surface at `point` reflects at most if nothing is in between, as the mean of the channels. Where it is 0, it
    /// reflects nothing.
    fn most_light(&self, point: Vec3, normal: Vec3) -> f32 {
        self.seen_from(point).map_or(0.0, |seen| {
            let (cos, cos_radius) = (seen.axis.dot(normal).clamp(-1.0, 1.0), seen.cos_radius);
            // The cosine to the nearest direction of the cone.
            let highest = if cos >= cos_radius {
                1.0
            } else {
                cos * cos_radius + ((1.0 - cos * cos) * (1.0 - cos_radius * cos_radius)).max(0.0).sqrt()
            };
            seen.color.element_sum() / 3.0 * highest.max(0.0)
        })
    }

    /// `None` where no light goes.
    fn seen_from(&self, point: Vec3) -> Option<Appearance> {
        match *self {
            Self::Directional { to_light, color, cos_radius } => {
                // Over the directions of the light, the mean cosine to its middle is (1 + cos_radius) / 2.
                Some(Appearance { axis: to_light, cos_radius, color: color * (2.0 / (1.0 + cos_radius)) })
            }
            Self::Ball { position, color, radius, cone } => {
                let to_centre = position - point;
                let squared = to_centre.length_squared();
                if squared < f32::MIN_POSITIVE {
                    return None;
                }
                let axis = to_centre / squared.sqrt();
                let share = cone.map_or(1.0, |c| c.share(-axis));
                if share == 0.0 {
                    return None;
                }
                let r2 = radius * radius;
                if r2 >= squared {
                    // Inside the ball light comes from everywhere.
                    return Some(Appearance { axis, cos_radius: -1.0, color: color * share * (4.0 / r2) });
                }
                // The ball's radiance is color / r2; a uniform direction in its cone has the density 1 / solid angle, and
                // the solid angle divided by pi is 2 (1 - cos) = 2 sin2 / (1 + cos), which tends to r2 / squared.
                let cos_radius = (1.0 - (r2 / squared).min(1.0)).sqrt();
                let color = color * (share * 2.0 / (1.0 + cos_radius) / squared);
                Some(Appearance { axis, cos_radius, color })
            }
        }
    }
}

/// A direction within the cone around `axis`, uniform over its solid angle.
fn in_cone(axis: Vec3, cos_radius: f32, [u, v]: [f32; 2]) -> Vec3 {
    if cos_radius >= 1.0 {
        return axis;
    }
    let cos = 1.0 - u * (1.0 - cos_radius);
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (std::f32::consts::TAU * v).sin_cos();
    let (x, y) = axis.any_orthonormal_pair();
    (x * (sin * cos_phi) + y * (sin * sin_phi) + axis * cos).normalize()
}

struct Checks {
    light: usize,
}

impl Checks {
    fn fail(&self, what: &'static str, value: f64, allowed: &'static str) -> Error {
        Error::invalid(format!("{what} of light {} is {value}, but must be {allowed}", self.light))
    }

    fn color(&self, color: Vec3) -> Result<()> {
        match color.to_array().into_iter().find(|c| !(c.is_finite() && *c >= 0.0)) {
            Some(c) => Err(self.fail("color", c.into(), "finite and not negative")),
            None => Ok(()),
        }
    }

    fn direction(&self, what: &'static str, v: Vec3) -> Result<Vec3> {
        v.try_normalize()
            .ok_or_else(|| self.fail(what, v.length().into(), "a vector of finite, positive length"))
    }

    /// Radians.
    fn angle(&self, what: &'static str, degrees: f32, least: f32, most: f32) -> Result<f32> {
        if (least..=most).contains(&degrees) {
            return Ok(degrees.to_radians());
        }
        let allowed = match what {
            "radius_degrees" => "0 to 90",
            "inner_degrees" => "0 to outer_degrees",
            _ => "inner_degrees to 180",
        };
        Err(self.fail(what, degrees.into(), allowed))
    }

    fn ball(
        &self,
        of_mesh: &WorldFromMesh,
        position: DVec3,
        color: Vec3,
        radius: f64,
        cone: Option<Cone>,
    ) -> Result<Lamp> {
        self.color(color)?;
        if !position.is_finite() {
            return Err(self.fail("position", position.length(), "finite"));
        }
        if !(radius.is_finite() && radius >= 0.0) {
            return Err(self.fail("radius", radius, "finite and not negative"));
        }
        // A mesh unit is `scale` world units, and light falls off with the square of the distance.
        let color = (color.as_dvec3() / (of_mesh.scale * of_mesh.scale)).as_vec3();
        let radius = (radius / of_mesh.scale) as f32;
        Ok(Lamp::Ball { position: of_mesh.inverse_point(position), color, radius, cone })
    }
}

// Points that fill the square evenly: the first two dimensions of Sobol's sequence (I. Sobol, "On the distribution of points
// in a cube and the approximate evaluation of integrals", 1967), randomised.
//
// Every pair of dimensions of an integrand takes the same two dimensions, with the order of the points shuffled and the
// points scrambled (A. Owen, "Randomly permuted (t,m,s)-nets and (t,s)-sequences", 1995) by hashes of the pair's number
// (B. Burley, "Practical Hash-based Owen Scrambling", 2020). So any number of pairs is available, the first 2^m points of
// each are stratified in every way that 2^m cells can be cut, and different pairs are independent.

#[derive(Clone, Copy, Debug)]
pub(crate) struct Sequence {
    seed: u32,
}

impl Sequence {
    pub(crate) fn new(seed: u32) -> Self {
        Self { seed: mixed(seed) }
    }

    /// Point `index` of a pair of dimensions, in 0..1 x 0..1.
    pub(crate) fn pair(&self, index: u32, dimensions: u32) -> [f32; 2] {
        let seed = mixed(self.seed ^ mixed(dimensions.wrapping_add(0x9e37_79b9)));
        // Shuffling: a scrambling of the number itself, so that blocks of 2^m points stay blocks.
        let index = scrambled(index, seed);
        let x = scrambled(index.reverse_bits(), mixed(seed ^ 0x68bc_21eb));
        let y = scrambled(second_dimension(index), mixed(seed ^ 0x02e5_be93));
        [x, y].map(|bits| (bits >> 8) as f32 / (1 << 24) as f32)
    }
}

/// A hash of 32 bits whose every output bit depends on every input bit (C. Wellons, "Prospecting for Hash Functions", 2018).
pub(crate) fn mixed(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}

/// Owen scrambling of a fraction's bits, the highest first: each bit is flipped or not depending on the bits above it. Works
/// on the reversed bits with a hash in which information moves upwards only (S. Laine and T. Karras, "Stratified Sampling
/// for Stochastic Transparency", 2011; constants of N. Vegdahl, "Building a Better LK Hash", 2021).
fn scrambled(fraction: u32, seed: u32) -> u32 {
    let mut x = fraction.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// The second dimension's fraction. Its generator matrix is Pascal's triangle modulo 2, whose entry at row r and column c is
/// one where c has all bits of r: a sum over supersets, done bit by bit of the position.
fn second_dimension(index: u32) -> u32 {
    let mut x = index;
    for (shift, kept) in
        [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0f0f_0f0f), (8, 0x00ff_00ff), (16, 0x0000_ffff)]
    {
        x ^= (x >> shift) & kept;
    }
    x.reverse_bits()
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

    /// Of 2^m points, every cell of every cut of the square into 2^m equal boxes of sides 2^-k holds exactly one.
    #[test]
    fn points_are_stratified_in_every_way() {
        for seed in 0..20 {
            let sequence = Sequence::new(seed);
            for m in [0, 1, 4, 7, 10] {
                // Any aligned block of them.
                for first in [0, 3 << m] {
                    let points: Vec<[f32; 2]> =
                        (0..1 << m).map(|i| sequence.pair(first + i, seed + 5)).collect();
                    for k in 0..=m {
                        let mut held = vec![0; 1 << m];
                        for [x, y] in &points {
                            let column = (x * (1_u32 << k) as f32) as usize;
                            let row = (y * (1_u32 << (m - k)) as f32) as usize;
                            held[(row << k) | column] += 1;
                        }
                        assert!(held.iter().all(|&n| n == 1), "seed {seed}, {m} bits, {k} across");
                    }
                }
            }
        }
    }

    #[test]
    fn pairs_of_dimensions_are_independent() {
        let sequence = Sequence::new(7);
        let n = 1024;
        for (a, b) in [(0, 1), (1, 2), (5, 600)] {
            let mut correlation = [[0.0; 2]; 2];
            for i in 0..n {
                let (p, q) = (sequence.pair(i, a), sequence.pair(i, b));
                for (row, p) in correlation.iter_mut().zip(p) {
                    for (sum, q) in row.iter_mut().zip(q) {
                        *sum += f64::from(p - 0.5) * f64::from(q - 0.5) * 12.0 / f64::from(n);
                    }
                }
            }
            assert!(correlation.as_flattened().iter().all(|c| c.abs() < 0.1), "{correlation:?}");
        }
    }

    #[test]
    fn seeds_give_different_points() {
        let firsts: std::collections::BTreeSet<u32> =
            (0..1000).map(|seed| Sequence::new(seed).pair(0, 0)[0].to_bits()).collect();
        assert!(firsts.len() > 990);
    }
}
