//! The density of a landscape: positive in rock, negative in air, zero on the surface.

use glam::{Vec2, Vec3};

use super::terrain::HeightMap;
use super::tubes::Tube;
use crate::generate::noise::{Noise, smoothstep};

/// How far overhangs are pushed out at most, metres.
const OVERHANG: f32 = 25.0;
/// Feature size of overhangs, metres: wide and low, as layers of rock weather.
const OVERHANG_SIZE: Vec3 = Vec3::new(46.0, 19.0, 46.0);

/// The solid between floor, walls and ground, with overhangs, tunnels and arches.
pub(super) struct Density {
    /// Half the side of the world's square, metres.
    pub(super) half_size: f32,
    /// Altitude of the floor, metres.
    pub(super) floor: f32,
    /// The ground before anything is pushed out, carved or added.
    pub(super) ground: HeightMap,
    /// Lowest and highest ground, metres.
    pub(super) range: (f32, f32),
    /// Carved out of the rock.
    pub(super) tunnels: Vec<Tube>,
    /// Added to the rock.
    pub(super) arches: Vec<Tube>,
    /// Width over which tubes blend into the rock, metres.
    pub(super) blend: f32,
    /// Where and how overhangs are pushed out.
    pub(super) overhangs: Overhangs,
}

/// The noises of the overhangs.
pub(super) struct Overhangs {
    mask: Noise,
    push: [Noise; 2],
}

impl Overhangs {
    pub(super) fn new(seed: u64) -> Self {
        Self { mask: Noise::new(seed, 30), push: [Noise::new(seed, 31), Noise::new(seed, 32)] }
    }

    /// How far a tube's wall is in or out at a point, metres.
    fn roughness(&self, p: Vec3) -> f32 {
        let q = p * Vec3::new(1.0, 1.7, 1.0);
        2.0 * self.push[0].at3(q / 13.0) + 1.0 * self.push[1].at3(q / 5.5)
    }

    /// Horizontal displacement at a point, metres.
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
    pub(super) fn at(&self, p: Vec3) -> f32 {
        let walls = (self.half_size - p.x.abs()).min(self.half_size - p.z.abs()).min(p.y - self.floor);
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
