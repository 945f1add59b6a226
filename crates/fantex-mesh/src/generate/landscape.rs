//! Landscapes with ridged mountains, terraced cliffs, overhangs, tunnels and natural arches, of any size.
//!
//! ```text
//!  seed --> height map --> density (overhangs, arches, tunnels, walls, floor) --marching tetrahedra--> relaxed surface
//! ```
//!
//! The result is one closed solid: watertight, manifold, consistently oriented, its handles counted.
//!
//! Measured: 60 k triangles take 0.2 s of processor time, 2 M take 2.4 s (development build), shared well by all cores. Of the triangles'
//! smallest angles the median is 45 degrees and one in a hundred is below 26.

use std::f32::consts::{PI, TAU};

use fantex_base::random::folded_seed;
use fantex_base::{Error, Result, counted, input};
use glam::{UVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::tetrahedra::{Lattice, Surface, polygonise, relax, scatter};
use crate::clean::Components;
use crate::{MAX_FAN_TRIANGLES, Material, Model, Topology, VertexCorners, unit_vector};

const FLOOR: f32 = -30.0;
/// Triangles of the trial passes that the lattice's step is estimated from.
const TRIAL_TRIANGLES: [f32; 2] = [2.0e4, 8.0e4];
/// How far the number of triangles may be from the target, relative to it.
const TOLERANCE: f32 = 0.08;
/// Side of the square in which worlds are made, metres; they are scaled when they are done.
const SIZE: f32 = 1000.0;
/// Samples along the height map that tunnels and arches are placed on.
const REFERENCE: f32 = 256.0;
/// Passes until the number of triangles must be near the target.
const MAX_PASSES: u32 = 6;
/// Peak memory per triangle while chunks are stitched together, measured on 300 thousand and on 100 million triangles; the
/// height map takes a tenth of a byte of it.
const BYTES_PER_TRIANGLE: u64 = 64;

/// What landscape to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LandscapeOptions {
    /// Number of triangles aimed at, [`MAX_FAN_TRIANGLES`] at most; at least about a thousand are made. The result lies
    /// within 10 %.
    pub triangles: u64,
    /// Same seed, same landscape; more triangles add detail.
    pub seed: u64,
    /// Side of its square, metres; everything is scaled with it. 1000 gives mountains of some 230 m and tunnels some 30 m
    /// wide.
    pub size: f32,
    /// Tunnels wanted; fewer are made where the mountains hold no more.
    pub tunnels: u32,
    /// Natural arches wanted; fewer are made where the ground offers no place.
    pub arches: u32,
    /// 0 gives triangles as even as they come; up to 1 vertices are moved about along the surface, so that triangles
    /// differ in size and shape.
    pub irregularity: f32,
}

impl Default for LandscapeOptions {
    fn default() -> Self {
        Self { triangles: 500_000, seed: 1, size: SIZE, tunnels: 4, arches: 3, irregularity: 0.0 }
    }
}

/// A closed solid of rock; y is up, lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Landscape {
    /// Vertex positions, metres.
    pub positions: Vec<Vec3>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Number of handles, from the Euler characteristic of the surface.
    pub genus: u64,
    /// Number of pieces: 1, as specks and sealed caverns are left out.
    pub components: u64,
    /// Tunnels that were carved.
    pub tunnels: u32,
    /// Arches that were built.
    pub arches: u32,
}

/// Makes a landscape.
///
/// # Errors
/// More triangles than [`MAX_FAN_TRIANGLES`], or than the memory [allows](input::ReadLimits) that is left.
pub fn landscape(options: &LandscapeOptions) -> Result<Landscape> {
    let triangles = options.triangles;
    if triangles > MAX_FAN_TRIANGLES as u64 {
        return Err(Error::too_large(format!(
            "a landscape of {triangles} triangles is asked for, but at most {MAX_FAN_TRIANGLES} are supported"
        )));
    }
    let what = format_args!("a landscape of {}", counted(triangles, "triangle"));
    let _held = input::reserve(what, BYTES_PER_TRIANGLE * triangles)?;
    let target = (options.triangles as f32).max(1000.0);
    let site = Site::new(options);
    let mut trials: Vec<(f32, f32)> = Vec::new();
    for aim in TRIAL_TRIANGLES.into_iter().filter(|&aim| aim < 0.5 * target) {
        let world = World::new(options.seed, &site, estimate(&trials, aim));
        trials.push((world.lattice.step, world.surface().triangles.len() as f32));
    }
    let mut passes_left = MAX_PASSES;
    loop {
        let world = World::new(options.seed, &site, estimate(&trials, target));
        let surface = world.surface();
        let count = surface.triangles.len() as f32;
        passes_left -= 1;
        if passes_left == 0 || (count / target - 1.0).abs() < TOLERANCE {
            return Ok(world.finish(surface, options));
        }
        trials.push((world.lattice.step, count));
    }
}

/// The lattice's step in metres for a number of triangles: `count = a * step^-b` through the last two trials. Rough ground
/// has more area the closer one looks, so `b` is somewhat above two.
fn estimate(trials: &[(f32, f32)], target: f32) -> f32 {
    match trials {
        [] => SIZE * (28.0 / target).sqrt(),
        [(step, count)] => step * libm::powf(count / target, 1.0 / 2.1),
        [.., (s0, c0), (s1, c1)] => {
            let exponent = (libm::logf(c1 / c0) / libm::logf(s0 / s1)).clamp(1.7, 2.6);
            let exponent = if exponent.is_nan() { 2.1 } else { exponent };
            s1 * libm::powf(c1 / target, 1.0 / exponent)
        }
    }
}

struct World {
    density: Density,
    lattice: Lattice,
}

impl World {
    fn new(seed: u64, site: &Site, step: f32) -> Self {
        let cubes = (SIZE / step).round().max(8.0);
        let step = SIZE / cubes;
        let ground = HeightMap::new(seed, step);
        let range = ground.range();
        let blend = (0.6 * step).max(5.0);
        // Tubes thinner than this would be lost between lattice points.
        let least_radius = 1.3 * step;
        let tubes =
            |curves: &[Curve]| curves.iter().map(|curve| Tube::new(curve, least_radius, blend)).collect();
        let (tunnels, arches) = (tubes(&site.tunnels), tubes(&site.arches));
        let height = range.1 + 60.0 - FLOOR;
        // Walls and floor lie half-way between lattice points: they come out exactly flat.
        let origin = Vec3::new(-0.5 * SIZE, FLOOR, -0.5 * SIZE) - 0.5 * step;
        let cubes = UVec3::new(cubes as u32 + 1, (height / step).ceil() as u32 + 1, cubes as u32 + 1);
        let overhangs = Overhangs::new(seed);
        let density = Density { ground, range, tunnels, arches, blend, overhangs };
        Self { density, lattice: Lattice { origin, step, cubes } }
    }

    /// The surface without loose specks and sealed caverns: its largest piece.
    fn surface(&self) -> Surface {
        largest_piece(polygonise(&self.lattice, |p| self.density.at(p)))
    }

    fn finish(self, mut surface: Surface, options: &LandscapeOptions) -> Landscape {
        let corners = VertexCorners::of(&surface.triangles, surface.positions.len());
        relax(&mut surface.positions, &surface.triangles, &corners);
        if options.irregularity > 0.0 {
            let amount = options.irregularity.min(1.0);
            scatter(&mut surface.positions, &surface.triangles, &corners, amount);
        }
        let scale = options.size / SIZE;
        surface.positions.iter_mut().for_each(|p| *p *= scale);
        let topology = Topology::of(&surface.triangles, &corners);
        Landscape {
            positions: surface.positions,
            triangles: surface.triangles,
            genus: topology.genus().unwrap_or(0),
            components: topology.components,
            tunnels: self.density.tunnels.len() as u32,
            arches: self.density.arches.len() as u32,
        }
    }
}

fn largest_piece(surface: Surface) -> Surface {
    let pieces = Components::new(surface.positions.len());
    for &[a, b, c] in &surface.triangles {
        pieces.join(a, b);
        pieces.join(b, c);
    }
    let roots: Vec<u32> = (0..surface.positions.len() as u32).map(|v| pieces.root(v)).collect();
    let mut sizes = vec![0_u32; roots.len()];
    roots.iter().for_each(|&r| sizes[r as usize] += 1);
    let Some(largest) = (0..sizes.len()).rev().max_by_key(|&r| sizes[r]) else { return surface };
    if sizes[largest] as usize == roots.len() {
        return surface;
    }
    let mut target = vec![u32::MAX; roots.len()];
    let mut positions = Vec::with_capacity(sizes[largest] as usize);
    for v in (0..roots.len()).filter(|&v| roots[v] == largest as u32) {
        target[v] = positions.len() as u32;
        positions.push(surface.positions[v]);
    }
    let stays = |t: &[u32; 3]| target[t[0] as usize] != u32::MAX;
    let renumbered = |t: [u32; 3]| t.map(|v| target[v as usize]);
    Surface { positions, triangles: surface.triangles.into_iter().filter(stays).map(renumbered).collect() }
}

impl From<Landscape> for Model {
    fn from(landscape: Landscape) -> Self {
        Self {
            name: "landscape".to_owned(),
            positions: landscape.positions.iter().map(|p| p.as_dvec3()).collect(),
            triangles: landscape.triangles,
            materials: vec![Material { name: "rock".to_owned(), ..Material::default() }],
            ..Self::default()
        }
    }
}

// The density of a landscape: positive in rock, negative in air, zero on the surface.

/// How far overhangs are pushed out at most, metres.
const OVERHANG: f32 = 25.0;
/// Feature size of overhangs, metres: wide and low, as layers of rock weather.
const OVERHANG_SIZE: Vec3 = Vec3::new(46.0, 19.0, 46.0);

/// The solid between floor, walls and ground, with overhangs, tunnels and arches.
struct Density {
    /// The ground before anything is pushed out, carved or added.
    ground: HeightMap,
    range: (f32, f32),
    /// Carved out of the rock.
    tunnels: Vec<Tube>,
    /// Added to the rock.
    arches: Vec<Tube>,
    /// Width over which tubes blend into the rock, metres.
    blend: f32,
    overhangs: Overhangs,
}

struct Overhangs {
    mask: Noise,
    push: [Noise; 2],
}

impl Overhangs {
    fn new(seed: u64) -> Self {
        Self { mask: Noise::new(seed, 30), push: [Noise::new(seed, 31), Noise::new(seed, 32)] }
    }

    /// How far a tube's wall is in or out at a point, metres.
    fn roughness(&self, p: Vec3) -> f32 {
        let q = p * Vec3::new(1.0, 1.7, 1.0);
        2.0 * self.push[0].at3(q / 13.0) + 1.0 * self.push[1].at3(q / 5.5)
    }

    fn displacement(&self, p: Vec3) -> Vec2 {
        let strength = smoothstep(-0.05, 0.3, self.mask.at2(Vec2::new(p.x, p.z) / 170.0));
        if strength == 0.0 {
            return Vec2::ZERO;
        }
        let q = p / OVERHANG_SIZE;
        let [x, z] = self.push.map(|n| n.at3(q) + 0.35 * n.at3(q * 2.3) + 0.1 * n.at3(q * 5.1));
        OVERHANG * strength * Vec2::new(x, z)
    }
}

impl Density {
    /// Density at a point in metres (y up); near the surface about the distance to it in metres.
    fn at(&self, p: Vec3) -> f32 {
        let walls = (0.5 * SIZE - p.x.abs()).min(0.5 * SIZE - p.z.abs()).min(p.y - FLOOR);
        if walls < 0.0 {
            return walls;
        }
        let mut rock = 0.7 * self.ground(p);
        for depth in self.arches.iter().filter_map(|tube| tube.depth(p)) {
            rock = smooth_max(rock, depth + self.overhangs.roughness(p), self.blend);
        }
        for depth in self.tunnels.iter().filter_map(|tube| tube.depth(p)) {
            rock = -smooth_max(-rock, depth + self.overhangs.roughness(p), self.blend);
        }
        rock.min(walls)
    }

    /// Height of the (displaced) ground above a point.
    fn ground(&self, p: Vec3) -> f32 {
        let (low, high) = self.range;
        if p.y < low || p.y > high {
            return (if p.y < low { low } else { high }) - p.y;
        }
        self.ground.at(Vec2::new(p.x, p.z) + self.overhangs.displacement(p)) - p.y
    }
}

/// The maximum with its edge rounded over a width `k` (quadratic, after I. Quilez, "Smooth minimum", 2013).
fn smooth_max(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.max(b) + 0.25 * h * h * k
}

// Tunnels and natural arches: tubes around curves, placed where the ground lets them pierce or span it.

const CANDIDATES: u32 = 6000;
/// Air left free where a tunnel ends and below an arch, metres.
const CLEARANCE: f32 = 5.0;
/// Distance of a curve's nodes while it is being laid out, metres.
const NODE: f32 = 5.0;

/// The middle of a tube.
#[derive(Clone, Debug)]
struct Curve {
    /// Centre and radius in metres.
    nodes: Vec<(Vec3, f32)>,
}

impl Curve {
    fn middle(&self) -> Vec2 {
        let p = self.nodes[self.nodes.len() / 2].0;
        Vec2::new(p.x, p.z)
    }
}

#[derive(Clone, Debug)]
struct Tube {
    /// Centre and radius in metres.
    nodes: Vec<(Vec3, f32)>,
    low: Vec3,
    high: Vec3,
}

impl Tube {
    /// Around a curve, at least so thick. `reach` is how far it blends into the rock. All in metres.
    fn new(curve: &Curve, least_radius: f32, reach: f32) -> Self {
        let thick = |&(p, radius): &(Vec3, f32)| (p, radius.max(least_radius));
        let nodes: Vec<(Vec3, f32)> = curve.nodes.iter().map(thick).collect();
        let low = nodes.iter().fold(Vec3::INFINITY, |low, (p, r)| low.min(*p - r - reach));
        let high = nodes.iter().fold(Vec3::NEG_INFINITY, |high, (p, r)| high.max(*p + r + reach));
        Self { nodes, low, high }
    }

    /// Depth below the tube's skin in metres, positive inside; `None` further away than the tube's reach.
    fn depth(&self, p: Vec3) -> Option<f32> {
        let is_near = p.cmpge(self.low).all() && p.cmple(self.high).all();
        let depths = self.nodes.windows(2).map(|pair| {
            let ((a, ra), (b, rb)) = (pair[0], pair[1]);
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            ra + (rb - ra) * t - p.distance(a + (b - a) * t)
        });
        is_near.then(|| depths.fold(f32::MIN, f32::max))
    }
}

/// Where tubes are: the same for lattices of any step.
struct Site {
    /// The ground, at a resolution that does not depend on the lattice's.
    ground: HeightMap,
    /// Each through a mountain from open air to open air.
    tunnels: Vec<Curve>,
    /// Each a bridge of rock over lower ground.
    arches: Vec<Curve>,
}

impl Site {
    fn new(options: &LandscapeOptions) -> Self {
        let ground = HeightMap::new(options.seed, SIZE / REFERENCE);
        let mut site = Self { ground, tunnels: Vec::new(), arches: Vec::new() };
        let random = Noise::new(options.seed, 20);
        site.tunnels = site.best(options.tunnels, |candidate| site.tunnel(&random, candidate));
        let random = Noise::new(options.seed, 21);
        site.arches = site.best(options.arches, |candidate| site.arch(&random, candidate));
        site
    }

    /// Up to `count` of the best candidates that keep their distance from each other and from tunnels that there are.
    fn best(&self, count: u32, candidate: impl Fn(u32) -> Option<(f32, Curve)>) -> Vec<Curve> {
        if count == 0 {
            return Vec::new();
        }
        let mut candidates: Vec<(f32, Curve)> = (0..CANDIDATES).filter_map(candidate).collect();
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut chosen: Vec<Curve> = Vec::new();
        for (_, curve) in candidates {
            let is_apart = |other: &Curve| other.middle().distance(curve.middle()) > 0.17 * SIZE;
            if (chosen.len() as u32) < count && chosen.iter().chain(&self.tunnels).all(is_apart) {
                chosen.push(curve);
            }
        }
        chosen
    }

    /// A random winding horizontal curve, if it runs from open air through rock into open air.
    fn tunnel(&self, random: &Noise, candidate: u32) -> Option<(f32, Curve)> {
        let number = |i| random.uniform(16 * candidate + i);
        let centre = self.place(number(0), number(1), 0.36);
        let radius = 13.0 + 6.0 * number(2);
        let top = self.ground.at(centre);
        let altitude = top - radius * (2.4 + 3.0 * number(3));
        let heading = TAU * number(4);
        let winding = 10.0 + 12.0 * number(5);
        let (climb, phase) = (0.16 * (number(6) - 0.5), TAU * number(7));
        let curve = |s: f32| {
            let ahead = unit_vector(heading);
            let p = centre
                + ahead * s
                + ahead.perp() * winding * (libm::sinf(s / 38.0 + phase) - libm::sinf(phase));
            Vec3::new(p.x, altitude + climb * s, p.y)
        };
        let clearance = |p: Vec3| p.y - self.ground.at(Vec2::new(p.x, p.z));
        let exit = |sign: f32| {
            (4..40).map(|n| sign * NODE * n as f32).find(|&s| clearance(curve(s)) > radius + CLEARANCE)
        };
        let (start, end) = (exit(-1.0)? - 2.0 * NODE, exit(1.0)? + 2.0 * NODE);
        let nodes: Vec<(Vec3, f32)> = (0..=((end - start) / NODE) as u32)
            .map(|n| curve(start + NODE * n as f32))
            .map(|p| (p, radius * (1.0 + 0.22 * random.at3(p / 21.0))))
            .collect();
        let inside = |(p, _): &(Vec3, f32)| p.abs().max_element() < 0.47 * SIZE;
        let rock = nodes.iter().filter(|(p, r)| clearance(*p) < -1.6 * r).count() as f32 * NODE;
        let is_sound = nodes.iter().all(inside) && rock > 2.0 * radius && altitude > radius + 8.0;
        // Long enough to be a tunnel, short enough to see light; mouths low on the mountain's front.
        let score = rock.min(110.0) + 30.0 * number(8) + 0.1 * centre.y;
        is_sound.then_some((score, Curve { nodes }))
    }

    /// A random parabola between two feet, if the ground between them is low enough to walk through.
    fn arch(&self, random: &Noise, candidate: u32) -> Option<(f32, Curve)> {
        let number = |i| random.uniform(16 * candidate + i);
        let centre = self.place(number(0), number(1), 0.38);
        let half_span = 30.0 + 50.0 * number(2);
        let radius = 8.0 + 4.0 * number(3);
        let across = unit_vector(PI * number(4)) * (half_span + radius);
        let feet = [centre - across, centre + across];
        let heights = feet.map(|p| self.ground.at(p));
        let rise = 5.0 + 25.0 * number(5);
        let curve = |t: f32| {
            let p = feet[0] + (feet[1] - feet[0]) * t;
            let chord = heights[0] + (heights[1] - heights[0]) * t - 2.2 * radius;
            let wobble = 2.5 * random.at2(p / 17.0);
            Vec3::new(p.x, chord + 4.0 * t * (1.0 - t) * (rise + 2.2 * radius) + wobble, p.y)
        };
        let steps = (2.6 * half_span / NODE) as u32;
        let nodes: Vec<(Vec3, f32)> = (0..=steps)
            .map(|n| n as f32 / steps as f32)
            .map(|t| (curve(t), t))
            .map(|(p, t)| (p, radius * (0.8 + 6.0 * (t - 0.5).powi(2)) * (1.0 + 0.25 * random.at3(p / 13.0))))
            .collect();
        // Clear height below the rock along the middle half, open sky above the apex.
        let clear = |(p, r): &(Vec3, f32)| p.y - r - self.ground.at(Vec2::new(p.x, p.z));
        let middle = &nodes[nodes.len() / 3..nodes.len() - nodes.len() / 3];
        let height = middle.iter().map(clear).fold(f32::MAX, f32::min);
        let slant = (heights[0] - heights[1]).abs();
        let is_sound = height > 1.2 * radius + CLEARANCE && slant < 0.5 * half_span;
        let score =
            1.5 * height.min(50.0) - 0.5 * slant - 0.25 * half_span + 10.0 * number(6) + 0.06 * centre.y;
        is_sound.then_some((score, Curve { nodes }))
    }

    /// A point of the square around the middle, `share` of the side to each direction.
    fn place(&self, x: f32, z: f32, share: f32) -> Vec2 {
        (2.0 * Vec2::new(x, z) - 1.0) * share * SIZE
    }
}

// The ground of a landscape as a height map: ridged mountains, terraced cliffs, a canyon.

/// Nominal height of the highest peaks above sea level, metres.
const PEAK_HEIGHT: f32 = 230.0;
/// Depth of the canyon's bed below its rim, metres.
const CANYON_DEPTH: f32 = 85.0;

/// Ground heights on a square lattice, looked up bilinearly.
struct HeightMap {
    /// Position of the first sample, metres (x and z).
    origin: Vec2,
    step: f32,
    side: usize,
    /// Heights in metres, rows along x.
    heights: Vec<f32>,
}

impl HeightMap {
    /// Samples the ground of a seed with about `step` metres distance.
    fn new(seed: u64, step: f32) -> Self {
        let side = (SIZE / step).ceil() as usize + 3;
        let origin = Vec2::splat(-0.5 * step * (side - 1) as f32);
        let ground = Ground::new(seed, step);
        let heights = (0..side * side)
            .into_par_iter()
            .with_min_len(1 << 10)
            .map(|i| ground.height(origin + step * Vec2::new((i % side) as f32, (i / side) as f32)))
            .collect();
        Self { origin, step, side, heights }
    }

    /// Height at a point (x, z); points outside the map take the height of its border.
    fn at(&self, p: Vec2) -> f32 {
        let q = ((p - self.origin) / self.step).clamp(Vec2::ZERO, Vec2::splat((self.side - 1) as f32 - 1e-3));
        let (x, y) = (q.x as usize, q.y as usize);
        let (fx, fy) = (q.x - x as f32, q.y - y as f32);
        let row = |y: usize| {
            let i = y * self.side + x;
            lerp(self.heights[i], self.heights[i + 1], fx)
        };
        lerp(row(y), row(y + 1), fy)
    }

    fn range(&self) -> (f32, f32) {
        self.heights.iter().fold((f32::MAX, f32::MIN), |(low, high), &h| (low.min(h), high.max(h)))
    }
}

struct Ground {
    /// Octaves of the mountains, as many as the lattice can hold.
    octaves: u32,
    warp: [Noise; 2],
    ridges: Noise,
    massif: Noise,
    hills: Noise,
    cliffs: Noise,
    canyon: Noise,
}

impl Ground {
    fn new(seed: u64, step: f32) -> Self {
        let noise = |stream| Noise::new(seed, stream);
        // Ridges of the first octave are about a fifth of the world apart; those of the last span about two samples.
        let octaves = ((SIZE / 6.4 / step).log2().ceil().max(3.0) as u32).min(10);
        Self {
            octaves,
            warp: [noise(1), noise(2)],
            ridges: noise(3),
            massif: noise(4),
            hills: noise(5),
            cliffs: noise(6),
            canyon: noise(7),
        }
    }

    fn height(&self, p: Vec2) -> f32 {
        let q = p / SIZE;
        let bend = Vec2::new(self.warp[0].fbm2(q * 3.0, 3), self.warp[1].fbm2(q * 3.0, 3));
        let warped = q + 0.07 * bend;
        let massif = self.massif(q, warped);
        let mountains = self.ridged(warped * 3.2) * massif;
        let hills = 0.24 + 0.10 * self.hills.fbm2(warped * 5.0, self.octaves.min(5));
        let raw = PEAK_HEIGHT * (hills + mountains);
        let carved = self.carve_canyon(q, raw);
        self.terrace(q, carved)
    }

    /// How much of a mountain stands here, 0..1: higher towards the back (-z), lower towards the front.
    fn massif(&self, q: Vec2, warped: Vec2) -> f32 {
        let along = 0.55 - 0.75 * q.y - 0.35 * q.x.abs();
        smoothstep(0.05, 0.95, along + 0.8 * self.massif.fbm2(warped * 2.2, 3))
    }

    /// Ridged multifractal, about 0..1: sharp crests, detail grows with height (F. K. Musgrave, in D. Ebert et al.,
    /// "Texturing and Modeling", 1994). Every octave is displaced along the slopes of the coarser ones, which draws the
    /// crests out into spurs with gullies between them (G. de Carpentier, "Scape: procedural extensions", 2011).
    fn ridged(&self, mut p: Vec2) -> f32 {
        const PROBE: f32 = 0.05;
        let (mut sum, mut weight, mut amplitude, mut drift) = (0.0, 1.0, 0.5, Vec2::ZERO);
        for _ in 0..self.octaves {
            let crest = |p: Vec2| {
                let crest = 1.0 - (1.6 * self.ridges.at2(p)).abs();
                crest * crest
            };
            let at = p + drift;
            let signal = crest(at);
            let slope = Vec2::new(crest(at + PROBE * Vec2::X), crest(at + PROBE * Vec2::Y)) - signal;
            sum += amplitude * signal * weight;
            weight = (1.5 * signal * weight).clamp(0.14, 1.0);
            // In units of the next octave, whose lattice is turned and twice as fine.
            drift = spun(drift - 0.11 * slope / PROBE * weight) * 2.0;
            amplitude *= 0.5;
            p = turned(p) * 2.0;
        }
        sum * 1.12
    }

    /// A winding canyon with steep walls from left to right.
    fn carve_canyon(&self, q: Vec2, height: f32) -> f32 {
        let course = 0.16 + 0.16 * self.canyon.fbm2(Vec2::new(2.3 * q.x, 0.5), 2);
        let rough = 0.010 * self.canyon.fbm2(q * 16.0, self.octaves.min(4));
        let distance = (q.y - course).abs() + rough;
        let bed = 0.04 * PEAK_HEIGHT + 0.15 * (height - 0.24 * PEAK_HEIGHT).max(0.0);
        let depth = (1.0 - smoothstep(0.016, 0.044, distance)) * CANYON_DEPTH;
        lerp(height, (height - depth).max(bed.min(height)), smoothstep(0.0, 0.08, depth / CANYON_DEPTH))
    }

    /// Steps of varying height, in patches: flat ledges above steep cliffs.
    fn terrace(&self, q: Vec2, height: f32) -> f32 {
        let strength = smoothstep(-0.1, 0.25, self.cliffs.fbm2(q * 3.1, 3));
        let step = 30.0 + 14.0 * self.cliffs.at2(q * 1.7 + 40.0);
        let coarse = terraced(height + 4.0 * self.cliffs.fbm2(q * 9.0, 2), step, 0.36);
        let fine = terraced(coarse, step / 4.3, 0.25);
        lerp(height, fine, 0.9 * strength)
    }
}

/// Moves a height towards the middle of steps; `softness` (0..0.5) is half the share of a step that stays flat.
fn terraced(height: f32, step: f32, softness: f32) -> f32 {
    let (level, within) = ((height / step).floor(), (height / step).fract());
    let within = if within < 0.0 { within + 1.0 } else { within };
    step * (level + lerp(within, smoothstep(softness, 1.0 - softness, within), 0.92))
}

// Gradient noise over hashed integer lattices: no tables, so any part of a world can be computed alone.
//
// After K. Perlin, "Improving Noise" (2002), with the permutation table replaced by an integer hash.

/// A seeded source of noise. Different streams of one seed are independent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    key: u32,
}

impl Noise {
    pub(super) fn new(seed: u64, stream: u32) -> Self {
        Self { key: mix(folded_seed(seed) ^ mix(stream.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995)) }
    }

    /// Smooth noise in the plane, about -0.7..0.7, zero at integer points, feature size one.
    fn at2(&self, p: Vec2) -> f32 {
        let cell = p.floor();
        let f = p - cell;
        let (x, y) = (cell.x as i32, cell.y as i32);
        let corner = |dx: i32, dy: i32| {
            let h = self.hash(x.wrapping_add(dx), y.wrapping_add(dy), 0);
            gradient2(h).dot(f - Vec2::new(dx as f32, dy as f32))
        };
        let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
        let (low, high) = (lerp(corner(0, 0), corner(1, 0), u.x), lerp(corner(0, 1), corner(1, 1), u.x));
        lerp(low, high, u.y)
    }

    /// Smooth noise in space, about -0.9..0.9, zero at integer points, feature size one.
    pub(super) fn at3(&self, p: Vec3) -> f32 {
        let cell = p.floor();
        let f = p - cell;
        let (x, y, z) = (cell.x as i32, cell.y as i32, cell.z as i32);
        let corner = |dx: i32, dy: i32, dz: i32| {
            let h = self.hash(x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz));
            gradient3(h, f - Vec3::new(dx as f32, dy as f32, dz as f32))
        };
        let u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
        let row = |dy, dz| lerp(corner(0, dy, dz), corner(1, dy, dz), u.x);
        lerp(lerp(row(0, 0), row(1, 0), u.y), lerp(row(0, 1), row(1, 1), u.y), u.z)
    }

    /// Sum of `octaves` of plane noise, each half as large and half as high.
    fn fbm2(&self, mut p: Vec2, octaves: u32) -> f32 {
        let (mut sum, mut amplitude) = (0.0, 1.0);
        for _ in 0..octaves {
            sum += amplitude * self.at2(p);
            p = turned(p) * 2.0;
            amplitude *= 0.5;
        }
        sum
    }

    /// The `index`-th random number of this source, uniform in 0..1.
    pub(super) fn uniform(&self, index: u32) -> f32 {
        (self.hash(index as i32, 0x68bc, -77) >> 8) as f32 / (1 << 24) as f32
    }

    fn hash(&self, x: i32, y: i32, z: i32) -> u32 {
        let h = (x as u32).wrapping_mul(0x8da6_b343) ^ (y as u32).wrapping_mul(0xd816_3841);
        mix(h ^ (z as u32).wrapping_mul(0xcb1a_b31f) ^ self.key)
    }
}

/// Turns a point so that the lattices of successive octaves do not line up (angle of the 3-4-5 triangle).
fn turned(p: Vec2) -> Vec2 {
    spun(p) + Vec2::new(17.3, -9.1)
}

/// The linear part of [`turned`].
fn spun(v: Vec2) -> Vec2 {
    Vec2::new(0.8 * v.x - 0.6 * v.y, 0.6 * v.x + 0.8 * v.y)
}

fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

fn gradient2(h: u32) -> Vec2 {
    const DIRECTIONS: [[f32; 2]; 4] =
        [[1.0, 0.0], [0.923_879_5, 0.382_683_43], [0.707_106_77, 0.707_106_77], [0.382_683_43, 0.923_879_5]];
    let [x, y] = DIRECTIONS[(h & 3) as usize];
    match (h >> 2) & 3 {
        0 => Vec2::new(x, y),
        1 => Vec2::new(-y, x),
        2 => Vec2::new(-x, -y),
        _ => Vec2::new(y, -x),
    }
}

/// Dot product with one of the 12 edge directions of a cube.
fn gradient3(h: u32, f: Vec3) -> f32 {
    let (a, b) = match (h >> 2) % 3 {
        0 => (f.x, f.y),
        1 => (f.y, f.z),
        _ => (f.z, f.x),
    };
    (if h & 1 == 0 { a } else { -a }) + (if h & 2 == 0 { b } else { -b })
}

/// A full-avalanche integer hash (constants by C. Wellons, "Prospecting for Hash Functions", 2018).
fn mix(mut h: u32) -> u32 {
    h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
    h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small(seed: u64) -> LandscapeOptions {
        LandscapeOptions { triangles: 40_000, seed, ..LandscapeOptions::default() }
    }

    #[test]
    fn tunnels_and_arches_are_built_and_add_handles() {
        let world = |options: &LandscapeOptions| World::new(options.seed, &Site::new(options), 6.0);
        let with = world(&small(1));
        let without = world(&LandscapeOptions { tunnels: 0, arches: 0, ..small(1) });
        assert!(with.density.tunnels.len() >= 2 && !with.density.arches.is_empty());
        let genus = |world: World| {
            let surface = world.surface();
            world.finish(surface, &small(1)).genus
        };
        let tubes = (with.density.tunnels.len() + with.density.arches.len()) as u64;
        let (with, without) = (genus(with), genus(without));
        assert!(with >= without + tubes / 2, "{without} handles, {with} with {tubes} tubes");
    }

    #[test]
    fn noise_is_bounded_continuous_and_has_no_mean() {
        let noise = Noise::new(7, 1);
        let mut sum = 0.0_f64;
        for i in 0..100_000_u32 {
            let p =
                Vec3::new(noise.uniform(3 * i), noise.uniform(3 * i + 1), noise.uniform(3 * i + 2)) * 50.0;
            let (n, near) = (noise.at3(p), noise.at3(p + Vec3::splat(1e-3)));
            assert!(n.abs() < 1.1 && (n - near).abs() < 0.01);
            let flat = noise.at2(Vec2::new(p.x, p.y));
            assert!(flat.abs() < 0.8 && (flat - noise.at2(Vec2::new(p.x, p.y + 1e-3))).abs() < 0.01);
            sum += f64::from(n + flat);
        }
        assert!((sum / 100_000.0).abs() < 0.02);
    }

    #[test]
    fn seeds_and_streams_differ() {
        let p = Vec3::new(0.3, 0.4, 0.7);
        let values = [Noise::new(1, 0), Noise::new(1, 1), Noise::new(2, 0)].map(|n| n.at3(p));
        assert!(values[0] != values[1] && values[0] != values[2]);
    }
}
