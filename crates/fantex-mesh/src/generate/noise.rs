//! Gradient noise over hashed integer lattices: no tables, so any part of a world can be computed alone.
//!
//! After K. Perlin, "Improving Noise" (2002), with the permutation table replaced by an integer hash.

use glam::{Vec2, Vec3};

/// A seeded source of noise. Different streams of one seed are independent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    key: u32,
}

impl Noise {
    /// The noise of a seed and a stream number.
    pub(super) fn new(seed: u64, stream: u32) -> Self {
        let folded = (seed ^ (seed >> 32)) as u32;
        Self { key: mix(folded ^ mix(stream.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995)) }
    }

    /// Smooth noise in the plane, about -0.7..0.7, zero at integer points, feature size one.
    pub(super) fn at2(&self, p: Vec2) -> f32 {
        let cell = p.floor();
        let f = p - cell;
        let (x, y) = (cell.x as i32, cell.y as i32);
        let corner = |dx: i32, dy: i32| {
            let h = self.hash(x.wrapping_add(dx), y.wrapping_add(dy), 0);
            gradient2(h).dot(f - Vec2::new(dx as f32, dy as f32))
        };
        let u = fade2(f);
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
    pub(super) fn fbm2(&self, mut p: Vec2, octaves: u32) -> f32 {
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
pub(super) fn turned(p: Vec2) -> Vec2 {
    spun(p) + Vec2::new(17.3, -9.1)
}

/// The linear part of [`turned`].
pub(super) fn spun(v: Vec2) -> Vec2 {
    Vec2::new(0.8 * v.x - 0.6 * v.y, 0.6 * v.x + 0.8 * v.y)
}

/// Smooth step from 0 at `low` to 1 at `high`.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Linear interpolation.
pub(super) fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

fn fade2(f: Vec2) -> Vec2 {
    f * f * f * (f * (f * 6.0 - 15.0) + 10.0)
}

/// One of 16 unit directions.
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
