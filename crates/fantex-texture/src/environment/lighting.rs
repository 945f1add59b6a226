//! An environment made ready for lighting: blurred as rough surfaces reflect it.
//!
//! Level `k` of [`PREFILTERED_LEVELS`] holds the environment as a GGX surface of perceptual roughness
//! `k / PREFILTERED_LEVELS` reflects it when seen along its normal (B. Karis, "Real shading in Unreal Engine 4", 2013);
//! level 0 is the environment itself. The result is the same on every run and any number of threads.
//!
//! Error against the sum over all texels (root mean square over 60 directions, relative to that of the values;
//! `tests/texture/environments.rs`): an overcast forest 0.2 to 1.1 %; a beach with the sun in the sky 0.3 to 1.3 %.

use std::f32::consts::PI;
use std::fmt;
use std::sync::Arc;

use glam::Vec3;

use super::EnvironmentMap;
use super::blur::LightTree;
use super::level::Level;

/// Blurred levels beside the environment itself.
pub const PREFILTERED_LEVELS: usize = 8;

/// Roughness of the first blurred level.
const FIRST_ROUGHNESS: f32 = 1.0 / PREFILTERED_LEVELS as f32;

/// An environment and its reflections in rough surfaces.
#[derive(Clone)]
pub struct PrefilteredEnvironment {
    map: Arc<EnvironmentMap>,
    /// Roughness `1 / PREFILTERED_LEVELS` and up; cubes.
    rough: Vec<Level>,
    irradiance: IrradianceHarmonics,
}

impl fmt::Debug for PrefilteredEnvironment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PrefilteredEnvironment({:?})", self.map)
    }
}

impl PrefilteredEnvironment {
    /// Blurs a map of any form, on the current rayon pool.
    pub fn new(map: Arc<EnvironmentMap>) -> Self {
        let irradiance = IrradianceHarmonics::of_map(&map);
        let largest = map.side_as_cube().max(MIN_SIDE);
        let lights = LightTree::new(&map);
        let blurred = |level: usize| {
            let roughness = level as f32 / PREFILTERED_LEVELS as f32;
            lights.reflected(side_of(level).min(largest), roughness * roughness)
        };
        let rough = (1..=PREFILTERED_LEVELS).map(blurred).collect();
        Self { map, rough, irradiance }
    }

    /// The environment as it was given.
    pub fn map(&self) -> &Arc<EnvironmentMap> {
        &self.map
    }

    /// What white diffuse surfaces reflect.
    pub fn irradiance(&self) -> &IrradianceHarmonics {
        &self.irradiance
    }

    /// Light that a surface of a perceptual roughness (0..1) gathers around a mirror direction, linear RGB, divided by the
    /// surface's reflectance. `steps` are the changes of the unit mirror direction along the pixel's edges: they choose the
    /// level of a mirror's look-up, and widen the lobe of a rough surface.
    pub fn reflected(&self, direction: Vec3, steps: [Vec3; 2], roughness: f32) -> Vec3 {
        let roughness = if roughness > 0.0 { roughness.min(1.0) } else { 0.0 };
        if roughness >= FIRST_ROUGHNESS {
            return self.blurred(direction, with_footprint(roughness, steps));
        }
        let sharp = self.sharp(direction, steps, roughness);
        if roughness == 0.0 {
            return sharp;
        }
        let blurred = self.blurred(direction, with_footprint(FIRST_ROUGHNESS, steps));
        sharp.lerp(blurred, roughness / FIRST_ROUGHNESS)
    }

    /// Linear between the levels of a roughness that is at least the first one's.
    fn blurred(&self, direction: Vec3, roughness: f32) -> Vec3 {
        let level = roughness * PREFILTERED_LEVELS as f32;
        let fine = (level as usize).clamp(1, PREFILTERED_LEVELS - 1);
        let of = |level: usize| self.rough[level - 1].look_up(direction);
        of(fine).lerp(of(fine + 1), (level - fine as f32).clamp(0.0, 1.0)).into()
    }

    /// A look-up of the map itself with a footprint at least about as wide as the lobe.
    fn sharp(&self, direction: Vec3, steps: [Vec3; 2], roughness: f32) -> Vec3 {
        let lobe = roughness * roughness;
        let widest = steps[0].length_squared().max(steps[1].length_squared());
        if lobe * lobe <= widest {
            return self.map.sample(direction, steps);
        }
        let d = direction.normalize_or(Vec3::NEG_Z);
        let (right, down) = d.any_orthonormal_pair();
        self.map.sample(d, [right * lobe, down * lobe])
    }
}

/// The roughness whose lobe is as wide as that of `roughness` seen through a footprint: squares of slopes add up. A
/// footprint of width `w` in mirror directions has the variance `w² / 12`, half-way vectors turn half as much, and a GGX
/// lobe of slope `a` counts as a Gaussian of variance `a² / 2`.
fn with_footprint(roughness: f32, steps: [Vec3; 2]) -> f32 {
    let width2 = 0.5 * (steps[0].length_squared() + steps[1].length_squared());
    let alpha2 = roughness.powi(4);
    let widened = alpha2 + width2.min(4.0) / 24.0;
    if widened.is_finite() { widened.sqrt().sqrt().min(1.0) } else { roughness }
}

/// Texels along a face of a level. Coarser grids would show in the interpolation.
fn side_of(level: usize) -> u32 {
    match level {
        1 => 128,
        2 => 64,
        3 | 4 => 32,
        _ => MIN_SIDE,
    }
}

/// Texels along a face of the widest lobes' levels, and of all levels of the smallest maps.
const MIN_SIDE: u32 = 16;

// ---- Diffuse light of an environment as nine numbers per colour.
//
// R. Ramamoorthi and P. Hanrahan, "An efficient representation for irradiance environment maps", 2001: the clamped cosine
// is so smooth that, of the spherical harmonics of its convolution with any light, those beyond order 2 hold little: of the
// largest irradiance, 1 % on average and 3 % at worst under an overcast forest, 3 % and 7 % with the sun in the sky
// (`tests/texture/environments.rs`).

/// What white diffuse surfaces reflect under an environment, by their normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IrradianceHarmonics {
    /// Coefficients in the order `1, y, z, x, xy, yz, 3z²-1, xz, x²-y²`, already convolved with the cosine and divided by
    /// pi.
    coefficients: [Vec3; 9],
}

/// Sides above this are not needed: averages enter here only.
const MAX_ROWS: u32 = 128;

impl IrradianceHarmonics {
    /// Projects an environment.
    pub fn of_map(map: &EnvironmentMap) -> Self {
        let last = map.level_count() - 1;
        let level = (0..=last).find(|&level| map.level_size(level)[1] <= MAX_ROWS).unwrap_or(last);
        let sums = map.integrate(level, |direction, steradians, color| {
            let light = color * steradians;
            let mut terms = [Vec3::ZERO; 10];
            basis(direction).iter().zip(&mut terms).for_each(|(value, term)| *term = light * *value);
            terms[9] = Vec3::splat(steradians);
            terms
        });
        // The texels' solid angles are those of their middles; together they are the whole sphere.
        let whole = 4.0 * PI / sums[9].x;
        let mut coefficients = [Vec3::ZERO; 9];
        for (order, coefficient) in coefficients.iter_mut().enumerate() {
            // The cosine's own coefficients, divided by pi: 1, 2/3, 1/4.
            let cosine = if order == 0 {
                1.0
            } else if order < 4 {
                2.0 / 3.0
            } else {
                0.25
            };
            *coefficient = sums[order] * (whole * cosine);
        }
        Self { coefficients }
    }

    /// Irradiance / pi of a surface with a unit normal, linear RGB, at least 0: what it reflects if it is white.
    pub fn diffuse(&self, normal: Vec3) -> Vec3 {
        let terms = self.coefficients.iter().zip(basis(normal));
        terms.fold(Vec3::ZERO, |sum, (coefficient, value)| sum + *coefficient * value).max(Vec3::ZERO)
    }

    /// The nine coefficients; see the field's order above: `diffuse(n)` is their sum weighted by the harmonics of `n`.
    pub fn coefficients(&self) -> [Vec3; 9] {
        self.coefficients
    }
}

/// The real spherical harmonics of orders 0 to 2.
fn basis(Vec3 { x, y, z }: Vec3) -> [f32; 9] {
    [
        0.282_094_8,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * z * z - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (x * x - y * y),
    ]
}
