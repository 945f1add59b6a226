//! An environment made ready for lighting: blurred as rough surfaces reflect it.
//!
//! Level `k` of [`PREFILTERED_LEVELS`] holds the environment as a GGX surface of perceptual roughness
//! `k / PREFILTERED_LEVELS` reflects it when seen along its normal (B. Karis, "Real shading in Unreal Engine 4", 2013);
//! level 0 is the environment itself. Narrow lobes are sampled: directions are drawn by the density of the facets, and each
//! is looked up at the level whose texels have the solid angle that the sample stands for (J. Křivánek and M. Colbert,
//! "Real-time shading with filtered importance sampling", 2008), so that a few dozen suffice. Wide lobes are summed over
//! all texels of a coarse level, which is exact but for that level's resolution. Nothing is drawn at random: the result is
//! the same on every run and any number of threads.
//!
//! Error against the sum over all texels (root mean square over 60 directions, relative to that of the values;
//! `tests/texture/environments.rs`), where the lobe is sampled (roughness 1/8 and 1/4) and where it is summed: an overcast
//! forest 1 % and 0.2 to 1 %; a beach with the sun in the sky, where it matters at which place in its texel the sun is,
//! 10 to 15 % and 1 to 4 %.

use std::f32::consts::{PI, TAU};
use std::fmt;
use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3, Vec3A};
use rayon::prelude::*;

use super::level::Level;
use super::{ChartPoint, EnvironmentForm, EnvironmentMap};

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
        let cube = match map.form() {
            EnvironmentForm::Cube => Arc::clone(&map),
            _ => Arc::new(map.to_cube()),
        };
        let irradiance = IrradianceHarmonics::of_map(&cube);
        let rough = (1..=PREFILTERED_LEVELS).map(|level| blur(&cube, level)).collect();
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

/// A direction of a lobe around `+z`.
struct LobeSample {
    direction: Vec3,
    weight: f32,
    /// The solid angle that it stands for, steradians.
    steradians: f32,
}

struct Recipe {
    side: u32,
    /// Directions per texel; nothing where the lobe is so wide that all texels of a coarse level are summed.
    directions: Option<u32>,
}

impl Recipe {
    fn of(level: usize, base_side: u32) -> Self {
        let (side, directions) = match level {
            1 => (256, Some(48)),
            2 => (64, Some(256)),
            3 | 4 => (32, None),
            _ => (MIN_SIDE, None),
        };
        Self { side: side.min(base_side.max(MIN_SIDE)), directions }
    }
}

/// Coarser grids would show in the interpolation.
const MIN_SIDE: u32 = 16;

/// Most texels along a face of the level that is summed.
const SUMMED_SIDE: u32 = 32;

/// Directions that a GGX surface of slope `alpha`, seen along its normal `+z`, mirrors to the eye, drawn by the density of
/// its facets; weighted by the cosine (Karis 2013).
fn lobe(alpha: f32, count: u32) -> Vec<LobeSample> {
    let a2 = alpha * alpha;
    let sample = |i: u32| {
        let (e0, e1) = ((i as f32 + 0.5) / count as f32, i.reverse_bits() as f32 / 4_294_967_296.0);
        let e1 = e1 + 0.5 / count as f32;
        let cos2 = (1.0 - e1) / (1.0 + (a2 - 1.0) * e1);
        let (cos, sin) = (cos2.sqrt(), (1.0 - cos2).max(0.0).sqrt());
        let h = Vec3::new(sin * (TAU * e0).cos(), sin * (TAU * e0).sin(), cos);
        let direction = h * (2.0 * cos) - Vec3::Z;
        let d = cos2 * (a2 - 1.0) + 1.0;
        // The facets' density times cosine, over four times the cosine to the eye, which is the same.
        let density = a2 / (PI * d * d) / 4.0;
        LobeSample { direction, weight: direction.z, steradians: 1.0 / (count as f32 * density) }
    };
    (0..count).map(sample).filter(|s| s.weight > 0.0).collect()
}

fn blur(cube: &EnvironmentMap, level: usize) -> Level {
    let alpha = (level as f32 / PREFILTERED_LEVELS as f32).powi(2);
    let recipe = Recipe::of(level, cube.chart_size()[0]);
    match recipe.directions {
        Some(count) => {
            let plan = plan(cube, alpha, count);
            for_texels(recipe.side, |normal| gather(cube, normal, &plan))
        }
        None => {
            let lights = LightBundle::of_map(cube);
            for_texels(recipe.side, |normal| sum_all(&lights, normal, alpha * alpha))
        }
    }
}

fn for_texels(side: u32, color: impl Fn(Vec3) -> Vec3A + Sync) -> Level {
    let color = &color;
    let inner: Vec<Vec3A> = (0..6 * side)
        .into_par_iter()
        .flat_map_iter(|row| {
            let (chart, y) = ((row / side) as usize, row % side);
            (0..side).map(move |x| {
                let uv = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / side as f32;
                color(EnvironmentForm::Cube.direction(ChartPoint { chart, uv }))
            })
        })
        .collect();
    Level::new(EnvironmentForm::Cube, [side; 2], &inner)
}

/// A lobe's direction with the level of the map to look it up in.
struct PlannedSample {
    direction: Vec3,
    weight: f32,
    level: usize,
}

fn plan(cube: &EnvironmentMap, alpha: f32, count: u32) -> Vec<PlannedSample> {
    // Texels of a cube differ in size by a factor of five; the mean is good enough to choose a level.
    let base_side = cube.chart_size()[0] as f32;
    let texel = 4.0 * PI / (6.0 * base_side * base_side);
    let samples = lobe(alpha, count);
    let total: f32 = samples.iter().map(|s| s.weight).sum();
    let planned = |s: &LobeSample| {
        let level = (0.5 * (s.steradians / texel).log2()).max(0.0).round() as usize;
        PlannedSample { direction: s.direction, weight: s.weight / total, level }
    };
    samples.iter().map(planned).collect()
}

fn gather(cube: &EnvironmentMap, normal: Vec3, plan: &[PlannedSample]) -> Vec3A {
    let (x, y) = normal.any_orthonormal_pair();
    let world_from_lobe = Mat3::from_cols(x, y, normal);
    plan.iter().fold(Vec3A::ZERO, |sum, s| {
        sum + cube.level(s.level).look_up(world_from_lobe * s.direction) * s.weight
    })
}

/// Texels that are summed side by side.
const LANES: usize = 8;

#[derive(Clone, Copy)]
struct LightBundle {
    direction: [[f32; LANES]; 3],
    steradians: [f32; LANES],
    color: [[f32; LANES]; 3],
}

impl LightBundle {
    /// All texels of the first level that is coarse enough.
    fn of_map(cube: &EnvironmentMap) -> Vec<Self> {
        let last = cube.level_count() - 1;
        let index = (0..=last).find(|&l| cube.level_size(l)[0] <= SUMMED_SIDE).unwrap_or(last);
        let level = cube.level(index);
        let side = level.size[0] as i32;
        let mut texels = Vec::with_capacity((6 * side * side) as usize);
        for (chart, y, x) in
            (0..6).flat_map(|c| (0..side).flat_map(move |y| (0..side).map(move |x| (c, y, x))))
        {
            let direction = level.form.direction(ChartPoint { chart, uv: level.texel_uv(x, y) });
            let steradians = level.form.texel_steradians(level.size, x, y);
            texels.push((direction, steradians, Vec3::from(level.texel(chart, x, y))));
        }
        let nothing =
            Self { direction: [[0.0; LANES]; 3], steradians: [0.0; LANES], color: [[0.0; LANES]; 3] };
        let bundle = |texels: &[(Vec3, f32, Vec3)]| {
            let mut bundle = nothing;
            for (lane, (direction, steradians, color)) in texels.iter().enumerate() {
                (0..3).for_each(|axis| bundle.direction[axis][lane] = direction[axis]);
                (0..3).for_each(|channel| bundle.color[channel][lane] = color[channel]);
                bundle.steradians[lane] = *steradians;
            }
            bundle
        };
        texels.chunks(LANES).map(bundle).collect()
    }
}

/// The mean of all light, weighted by the facets' density and the cosine; `a2` is the squared slope.
fn sum_all(lights: &[LightBundle], normal: Vec3, a2: f32) -> Vec3A {
    let mut sums = [[0.0; LANES]; 4];
    for light in lights {
        let [x, y, z] = &light.direction;
        let mut weights = [0.0; LANES];
        for lane in 0..LANES {
            let cosine = x[lane] * normal.x + y[lane] * normal.y + z[lane] * normal.z;
            // The half vector's squared cosine is (1 + cosine) / 2.
            let d = (0.5 + 0.5 * cosine) * (a2 - 1.0) + 1.0;
            weights[lane] = cosine.max(0.0) * light.steradians[lane] / (d * d);
        }
        for lane in 0..LANES {
            (0..3).for_each(|channel| sums[channel][lane] += weights[lane] * light.color[channel][lane]);
            sums[3][lane] += weights[lane];
        }
    }
    let [r, g, b, weight] = sums.map(|lanes| lanes.iter().sum::<f32>());
    Vec3A::new(r, g, b) / weight
}

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
