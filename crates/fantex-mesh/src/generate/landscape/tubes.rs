//! Tunnels and natural arches: tubes around curves, placed where the ground lets them pierce or span it.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::terrain::HeightMap;
use crate::generate::noise::Noise;
use crate::unit_vector;

/// Candidates tried per tube wanted.
const CANDIDATES: u32 = 6000;
/// Air left free where a tunnel ends and below an arch, metres.
const CLEARANCE: f32 = 5.0;
/// Distance of a curve's nodes while it is being laid out, metres.
const NODE: f32 = 5.0;

/// A tube of varying radius around a polyline.
#[derive(Clone, Debug)]
pub(super) struct Tube {
    /// Centre and radius in metres.
    nodes: Vec<(Vec3, f32)>,
    low: Vec3,
    high: Vec3,
}

impl Tube {
    fn new(nodes: Vec<(Vec3, f32)>, reach: f32) -> Self {
        let low = nodes.iter().fold(Vec3::INFINITY, |low, (p, r)| low.min(*p - r - reach));
        let high = nodes.iter().fold(Vec3::NEG_INFINITY, |high, (p, r)| high.max(*p + r + reach));
        Self { nodes, low, high }
    }

    /// Depth below the tube's skin in metres, positive inside; `None` further away than the tube's reach.
    pub(super) fn depth(&self, p: Vec3) -> Option<f32> {
        let is_near = p.cmpge(self.low).all() && p.cmple(self.high).all();
        let depths = self.nodes.windows(2).map(|pair| {
            let ((a, ra), (b, rb)) = (pair[0], pair[1]);
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            ra + (rb - ra) * t - p.distance(a + (b - a) * t)
        });
        is_near.then(|| depths.fold(f32::MIN, f32::max))
    }

    fn middle(&self) -> Vec2 {
        let p = self.nodes[self.nodes.len() / 2].0;
        Vec2::new(p.x, p.z)
    }
}

/// Where tubes may lie.
pub(super) struct Site<'a> {
    /// The ground, at a resolution that does not depend on the lattice's, so that every lattice gets the same tubes.
    pub(super) ground: &'a HeightMap,
    /// Side of the world's square, metres.
    pub(super) size: f32,
    /// Tubes thinner than this (radius, metres) would be lost between lattice points.
    pub(super) least_radius: f32,
    /// How far tubes blend into the rock, metres.
    pub(super) reach: f32,
    /// The world's seed.
    pub(super) seed: u64,
}

impl Site<'_> {
    /// Up to `count` tunnels, each through a mountain from open air to open air, apart from each other.
    pub(super) fn tunnels(&self, count: u32) -> Vec<Tube> {
        let random = Noise::new(self.seed, 20);
        let candidates = (0..CANDIDATES).filter_map(|i| self.tunnel(&random, i));
        self.best(candidates.collect(), count, &[])
    }

    /// Up to `count` arches, each a bridge of rock over lower ground, apart from the `others`.
    pub(super) fn arches(&self, count: u32, others: &[Tube]) -> Vec<Tube> {
        let random = Noise::new(self.seed, 21);
        let candidates = (0..CANDIDATES).filter_map(|i| self.arch(&random, i));
        self.best(candidates.collect(), count, others)
    }

    /// The best candidates that keep their distance from each other and from `others`.
    fn best(&self, mut candidates: Vec<(f32, Tube)>, count: u32, others: &[Tube]) -> Vec<Tube> {
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut chosen: Vec<Tube> = Vec::new();
        for (_, tube) in candidates {
            let is_apart = |other: &Tube| other.middle().distance(tube.middle()) > 0.17 * self.size;
            if (chosen.len() as u32) < count && chosen.iter().chain(others).all(is_apart) {
                chosen.push(tube);
            }
        }
        chosen
    }

    /// A random winding horizontal curve, if it runs from open air through rock into open air.
    fn tunnel(&self, random: &Noise, candidate: u32) -> Option<(f32, Tube)> {
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
        let inside = |(p, _): &(Vec3, f32)| p.abs().max_element() < 0.47 * self.size;
        let rock = nodes.iter().filter(|(p, r)| clearance(*p) < -1.6 * r).count() as f32 * NODE;
        let is_sound = nodes.iter().all(inside) && rock > 2.0 * radius && altitude > radius + 8.0;
        // Long enough to be a tunnel, short enough to see light; mouths low on the mountain's front.
        let score = rock.min(110.0) + 30.0 * number(8) + 0.1 * centre.y;
        is_sound.then(|| (score, self.tube(nodes)))
    }

    /// A random parabola between two feet, if the ground between them is low enough to walk through.
    fn arch(&self, random: &Noise, candidate: u32) -> Option<(f32, Tube)> {
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
        is_sound.then(|| (score, self.tube(nodes)))
    }

    /// The tube, as wide as the lattice needs it to be.
    fn tube(&self, mut nodes: Vec<(Vec3, f32)>) -> Tube {
        nodes.iter_mut().for_each(|(_, radius)| *radius = radius.max(self.least_radius));
        Tube::new(nodes, self.reach)
    }

    /// A point of the square around the middle, `share` of the side to each direction.
    fn place(&self, x: f32, z: f32, share: f32) -> Vec2 {
        (2.0 * Vec2::new(x, z) - 1.0) * share * self.size
    }
}
