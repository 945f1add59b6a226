//! Sums of sine waves (Fourier synthesis).

use std::f32::consts::TAU;

use glam::Vec3;

use super::hash::{absorb, finish, unit};

/// A sine wave in space, `amplitude * sin(wave_vector . p + phase + angular_speed * time)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wave {
    /// Direction in which it changes; its length is the angular frequency, radians per unit.
    pub wave_vector: Vec3,
    /// Height of the crests.
    pub amplitude: f32,
    /// Radians at the origin.
    pub phase: f32,
    /// Radians per second.
    pub angular_speed: f32,
}

/// A sum of sine waves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Waves(pub Vec<Wave>);

impl Waves {
    /// `count` waves of random directions whose lengths fall evenly (in octaves) from 1 to `2^-octaves`, with amplitudes in
    /// proportion to `frequency^-falloff`: a cloud-like pattern, rougher for smaller `falloff` (R. Voss, "Random fractal forgeries",
    /// 1985). The amplitudes' squares add up to 1/2, so that values seldom leave -2..2.
    pub fn spectrum(seed: u32, count: u32, octaves: f32, falloff: f32) -> Self {
        let random = |i: u32, purpose: i32| unit(finish(absorb(absorb(seed, i as i32), purpose)));
        let mut waves: Vec<Wave> = (0..count)
            .map(|i| {
                let frequency = (octaves * (i as f32 + random(i, 0)) / count as f32).exp2();
                let (height, turn) = (2.0 * random(i, 1) - 1.0, TAU * random(i, 2));
                let across = (1.0 - height * height).sqrt();
                let direction = Vec3::new(across * turn.cos(), height, across * turn.sin());
                Wave {
                    wave_vector: TAU * frequency * direction,
                    amplitude: frequency.powf(-falloff),
                    phase: TAU * random(i, 3),
                    angular_speed: 0.0,
                }
            })
            .collect();
        let power: f32 = waves.iter().map(|w| w.amplitude * w.amplitude).sum();
        let scale = (0.5 / power).sqrt();
        waves.iter_mut().for_each(|w| w.amplitude *= scale);
        Self(waves)
    }

    /// The mean over the parallelogram around `p` with the edges `steps` (zero for the value at the point). Exact: the mean of a
    /// sine over an edge is its value in the middle times `sin(x)/x` of half the phase along the edge.
    pub fn mean(&self, p: Vec3, steps: [Vec3; 2], time: f32) -> f32 {
        let wave = |w: &Wave| {
            let left: f32 = steps.iter().map(|step| sinc(0.5 * w.wave_vector.dot(*step))).product();
            left * w.amplitude * (w.wave_vector.dot(p) + w.phase + w.angular_speed * time).sin()
        };
        self.0.iter().map(wave).sum()
    }

    /// The derivatives along x, y and z at a point.
    pub fn gradient(&self, p: Vec3, time: f32) -> Vec3 {
        let slope = |w: &Wave| {
            let angle = w.wave_vector.dot(p) + w.phase + w.angular_speed * time;
            w.wave_vector * (w.amplitude * angle.cos())
        };
        self.0.iter().map(slope).sum()
    }
}

/// `sin(x) / x`.
fn sinc(x: f32) -> f32 {
    if x.abs() < 1e-3 { 1.0 - x * x / 6.0 } else { x.sin() / x }
}

#[cfg(test)]
mod tests {
    use super::super::tests_common::points;
    use super::*;

    #[test]
    fn means_over_a_footprint_equal_those_of_many_points() {
        let waves = Waves::spectrum(4, 12, 3.0, 1.0);
        let steps = [Vec3::new(0.1, 0.02, 0.0), Vec3::new(-0.03, 0.05, 0.08)];
        for p in points::<3>(20).map(Vec3::from) {
            let count = 64;
            let mut sum = 0.0;
            for i in 0..count * count {
                let [a, b] = [i % count, i / count].map(|n| (n as f32 + 0.5) / count as f32 - 0.5);
                sum += waves.mean(p + steps[0] * a + steps[1] * b, [Vec3::ZERO; 2], 0.0);
            }
            let mean = sum / (count * count) as f32;
            assert!((mean - waves.mean(p, steps, 0.0)).abs() < 1e-3, "{p}");
        }
    }

    #[test]
    fn gradient_is_the_derivative() {
        let waves = Waves::spectrum(4, 12, 3.0, 1.0);
        for p in points::<3>(100).map(Vec3::from) {
            for axis in Vec3::AXES {
                let at = |shift: f32| waves.mean(p + axis * shift, [Vec3::ZERO; 2], 1.0);
                let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
                assert!((slope - waves.gradient(p, 1.0).dot(axis)).abs() < 0.05);
            }
        }
    }
}
