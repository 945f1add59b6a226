//! Light maps: the light that reaches every point of a surface, baked by tracing paths.
//!
//! Fan tiles need no texture coordinates, so a light map is an asset like any other: a cover of low density, and one channel,
//! [`ChannelKind::Light`]. Its values are irradiance over pi, in linear RGB: what a white, perfectly diffuse surface would
//! reflect. Multiplied by the base colour they are the picture of a diffuse surface. They may exceed one.
//!
//! ```text
//!  LightScene -+-> LightMapSource --bake--> asset with channel Light
//!  options ----'          `--> noise(): how far the values are from the truth
//! ```
//!
//! Light is sought where it comes from: in directions by the cosine, in those where a sky of high contrast is bright, and at lamps,
//! of which those that give most are asked most often. No choice changes the mean.
//!
//! Noise is measured, not guessed: every texel is estimated four times, independently, and the spread of the four is the
//! standard error of their mean. A bake then takes out what the errors explain (`denoise.rs`). Nothing depends on threads.
//!
//! Texels are larger than the foot of what stands on them. What lies under it is dark, and nobody sees it: it does not count in the mean of a
//! texel, and a texel that lies there as a whole continues those around it.

mod denoise;
mod sky_table;
mod tracer;

use std::convert::Infallible;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use fantex_base::{Error, Result};
use fantex_mesh::{AlphaMode, Mesh, SurfacePoint, TriangleBvh, shading_normals};
use fantex_store::ChannelKind;
use glam::{DVec3, Vec3, Vec4};

use crate::light::denoise::Estimate;
pub(crate) use crate::light::denoise::{BYTES_PER_TEXEL, NoisyLight, REACH_TEXELS, SmoothLight};
use crate::light::sky_table::{SkyTable, most_reflected};
pub use crate::light::tracer::BakeLight;
use crate::light::tracer::{Lamp, Sequence, Tracer, mixed};
use crate::source::SurfaceColors;
use crate::{LightQuantity, Source, SourceChannel, TexelPoint};

/// Independent estimates of a texel.
const ESTIMATES: u32 = 4;

/// Triangles that are asked for their colour to tell how bright a picture may be.
const COLOR_LOOKS: usize = 4096;

/// Paths of an estimate between two looks at whether the user wants to stop: a fraction of a millisecond.
const PATHS_PER_CHECK: u32 = 64;

/// Points of each estimate that tell whether a part of the texel is enclosed: a sixteenth of it is enough.
const ENCLOSURE_TESTS: u32 = 4;

/// For work that nobody ends early.
pub(crate) fn unwatched() -> Result<(), Infallible> {
    Ok(())
}

/// Light at a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Illumination {
    /// Irradiance over pi, linear RGB; for ambient occlusion the open share in all three.
    pub value: Vec3,
    /// Root mean square over the channels of the standard errors of `value`.
    pub standard_error: f32,
    /// Paths that were traced.
    pub samples: u32,
}

/// The light on a mesh, as a source.
///
/// The mean over the texel is taken ([`Prefilter::Box`](crate::Prefilter)), as far as it lies on the triangle under its centre.
/// [`Fit::Sharp`](crate::Fit::Sharp) sharpens noise along with shadows, by a quarter.
pub struct LightMapSource<'a> {
    tracer: Tracer<'a>,
    meter: NoiseMeter,
}

impl std::fmt::Debug for LightMapSource<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LightMapSource").field("options", &self.tracer.options).finish_non_exhaustive()
    }
}

impl<'a> LightMapSource<'a> {
    /// Prepares the mesh for rays, and looks at the sky about a million times, to know where it is bright. The mesh occludes and lights itself; its normals are those that it is shaded with.
    ///
    /// # Errors
    /// An option or a number of a light is out of its range.
    pub fn new(mesh: &'a Mesh, scene: &LightScene<'a>, options: LightMapOptions) -> Result<Self> {
        options.check()?;
        let lamps = scene.lights.iter().enumerate().map(|(i, light)| Lamp::new(mesh, i, light));
        let lamps = lamps.collect::<Result<Vec<_>>>()?;
        let occlusion_distance = match options.occlusion_distance {
            Some(distance) => (distance / mesh.world_from_mesh.scale) as f32,
            None => f32::INFINITY,
        };
        let sees_light = options.quantity != LightQuantity::AmbientOcclusion;
        let tracer = Tracer {
            mesh,
            bvh: TriangleBvh::new(mesh),
            normals: shading_normals(mesh),
            lamps,
            sky: scene.sky,
            sky_table: if sees_light { SkyTable::new(scene.sky) } else { None },
            reflector: scene.reflector,
            options,
            occlusion_distance,
        };
        Ok(Self { tracer, meter: NoiseMeter::default() })
    }

    /// The largest red, green or blue that surfaces show in this light, about: some of them are asked for their colour, each with all lamps and the
    /// sky in full view. Infinite where lamps may be near.
    pub(crate) fn brightest(&self) -> f32 {
        let Tracer { mesh, lamps, sky, reflector, options, .. } = &self.tracer;
        let light = lamps.iter().map(|lamp| match lamp {
            Lamp::Directional { color, .. } => *color,
            Lamp::Ball { color, .. } if *color == Vec3::ZERO => Vec3::ZERO,
            Lamp::Ball { .. } => Vec3::INFINITY,
        });
        let light = match options.quantity {
            LightQuantity::AmbientOcclusion => Vec3::ONE,
            LightQuantity::Full | LightQuantity::Direct => light.sum::<Vec3>() + most_reflected(*sky),
        };
        if !light.is_finite() {
            return f32::INFINITY;
        }
        let triangles = mesh.triangles.len();
        let shown = (0..triangles).step_by(triangles.div_ceil(COLOR_LOOKS).max(1)).map(|triangle| {
            let at = SurfacePoint { triangle: triangle as u32, lambda: Vec3::splat(1.0 / 3.0) };
            (reflector.albedo(at) * light + reflector.emission(at)).max_element()
        });
        shown.fold(0.0, f32::max)
    }

    /// Light at a point; `lambda_steps` are the sides of the parallelogram around it over which the mean is taken, as changes
    /// of the barycentric coordinates (zero: the point alone). What lies under or inside something where no light comes is left out. It is
    /// not denoised.
    pub fn illumination(&self, at: SurfacePoint, lambda_steps: [Vec3; 2]) -> Illumination {
        let Ok(light) = self.texel_light(at, lambda_steps, unwatched);
        light.light
    }

    /// Light at a texel, for [`NoisyLight`]; its noise is counted. None where the texel is hidden. Ends early with the error of `check`.
    pub(crate) fn estimate<E>(
        &self,
        point: &TexelPoint,
        check: impl Fn() -> Result<(), E>,
    ) -> Result<Option<Estimate>, E> {
        let TexelLight { light, estimates, is_hidden } =
            self.texel_light(point.at, point.lambda_steps, check)?;
        if is_hidden {
            return Ok(None);
        }
        self.meter.add(light.value.element_sum() / 3.0, light.standard_error, light.samples);
        let [a, b, c, d] = estimates;
        // Half as many paths have twice the variance.
        let variance = 2.0 * light.standard_error.powi(2);
        Ok(Some(Estimate { halves: [(a + b) / 2.0, (c + d) / 2.0], variance }))
    }

    /// The light of a texel as it is where nothing is denoised; otherwise as [`estimate`](Self::estimate).
    pub(crate) fn noisy<E>(
        &self,
        point: &TexelPoint,
        check: impl Fn() -> Result<(), E>,
    ) -> Result<Option<Vec3>, E> {
        let estimate = self.estimate(point, check)?;
        Ok(estimate.map(|Estimate { halves: [a, b], .. }| 0.5 * (a + b)))
    }

    fn texel_light<E>(
        &self,
        at: SurfacePoint,
        lambda_steps: [Vec3; 2],
        check: impl Fn() -> Result<(), E>,
    ) -> Result<TexelLight, E> {
        let options = &self.tracer.options;
        let seed = at
            .lambda
            .to_array()
            .iter()
            .fold(mixed(options.seed) ^ at.triangle, |seed, x| mixed(seed ^ x.to_bits()));
        let sequences: Sequences = std::array::from_fn(|i| Sequence::new(seed.wrapping_add(i as u32)));
        let mut sums = [DVec3::ZERO; ESTIMATES as usize];
        let (mut done, mut goal) = (0, options.samples.div_ceil(ESTIMATES));
        let most = options.max_samples.div_ceil(ESTIMATES);
        let is_enclosed =
            |sequence: &Sequence, index: u32| self.tracer.is_enclosed(at, lambda_steps, sequence, index);
        let tested = sequences.iter().flat_map(|sequence| (0..ENCLOSURE_TESTS).map(move |i| (sequence, i)));
        let may_hide = tested.clone().any(|(sequence, index)| is_enclosed(sequence, index));
        // Of texels that may be hidden the light of every sample.
        let mut samples: [Vec<Vec3>; ESTIMATES as usize] = Default::default();
        loop {
            for ((sequence, sum), samples) in sequences.iter().zip(&mut sums).zip(&mut samples) {
                for index in done..goal {
                    let light = self.tracer.sample(at, lambda_steps, sequence, index);
                    *sum += light.as_dvec3();
                    if may_hide {
                        samples.push(light);
                    }
                    if index % PATHS_PER_CHECK == PATHS_PER_CHECK - 1 {
                        check()?;
                    }
                }
            }
            done = goal;
            let (_, standard_error) = mean_and_error(&sums.map(|sum| sum / f64::from(done)));
            let good = options.target_error.is_none_or(|target| standard_error <= target);
            if good || done >= most {
                break;
            }
            goal = (2 * done).min(most);
        }
        let is_dark = may_hide && sums.iter().all(|sum| *sum == DVec3::ZERO);
        let counts = if is_dark && tested.clone().all(|(sequence, index)| is_enclosed(sequence, index)) {
            [0; ESTIMATES as usize]
        } else if may_hide {
            free_samples(&sequences, &samples, is_enclosed, check)?
        } else {
            [done; ESTIMATES as usize]
        };
        Ok(TexelLight::new(sums, counts, done))
    }

    /// Whether bakes take the noise out.
    pub(crate) fn denoises(&self) -> bool {
        self.tracer.options.denoise
    }

    /// Counts what denoising has left.
    pub(crate) fn count_left(&self, light: &SmoothLight) {
        light.errors.iter().for_each(|&error| self.meter.add_left(error));
    }

    /// The noise of all texels so far. It does not depend on the number of threads.
    pub fn noise(&self) -> LightMapNoise {
        self.meter.report()
    }
}

type Sequences = [Sequence; ESTIMATES as usize];

/// How many samples of each estimate are not enclosed; all of them where light reaches enclosed ones, too, through a window or of a lamp.
fn free_samples<E>(
    sequences: &Sequences,
    samples: &[Vec<Vec3>; ESTIMATES as usize],
    is_enclosed: impl Fn(&Sequence, u32) -> bool,
    check: impl Fn() -> Result<(), E>,
) -> Result<[u32; ESTIMATES as usize], E> {
    let mut counts = [0; ESTIMATES as usize];
    for ((sequence, samples), count) in sequences.iter().zip(samples).zip(&mut counts) {
        for (index, &light) in (0..).zip(samples) {
            if !is_enclosed(sequence, index) {
                *count += 1;
            } else if light != Vec3::ZERO {
                return Ok([samples.len() as u32; ESTIMATES as usize]);
            }
            if index % PATHS_PER_CHECK == PATHS_PER_CHECK - 1 {
                check()?;
            }
        }
    }
    Ok(counts)
}

/// Light at a texel, and what it is the mean of.
struct TexelLight {
    light: Illumination,
    estimates: [Vec3; ESTIMATES as usize],
    /// Nothing of the texel can be seen.
    is_hidden: bool,
}

impl TexelLight {
    /// From the sums of light, the numbers of samples that count, and how many there were in each.
    fn new(sums: [DVec3; ESTIMATES as usize], counts: [u32; ESTIMATES as usize], done: u32) -> Self {
        let count: u32 = counts.iter().sum();
        let all = sums.iter().sum::<DVec3>() / f64::from(count.max(1));
        let mut estimates = [all; ESTIMATES as usize];
        for ((estimate, sum), count) in estimates.iter_mut().zip(sums).zip(counts) {
            // An estimate without samples knows no more than the others.
            if count > 0 {
                *estimate = sum / f64::from(count);
            }
        }
        let (value, standard_error) = mean_and_error(&estimates);
        let light = Illumination { value, standard_error, samples: done * ESTIMATES };
        Self { light, estimates: estimates.map(|e| e.as_vec3()), is_hidden: count == 0 }
    }
}

/// Mean of the estimates and its standard error.
fn mean_and_error(estimates: &[DVec3; ESTIMATES as usize]) -> (Vec3, f32) {
    let n = f64::from(ESTIMATES);
    let mean = estimates.iter().sum::<DVec3>() / n;
    let squares: f64 = estimates.iter().map(|e| (*e - mean).length_squared() / 3.0).sum();
    (mean.as_vec3(), (squares / (n * (n - 1.0))).sqrt() as f32)
}

impl Source for LightMapSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let exceeds_one = self.tracer.options.quantity != LightQuantity::AmbientOcclusion;
        vec![SourceChannel { exceeds_one, ..SourceChannel::new(ChannelKind::Light) }]
    }

    fn jumps_at_creases(&self) -> bool {
        true
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let Ok(light) = self.noisy(point, unwatched);
        values[0] = light.unwrap_or_default().extend(1.0);
    }

    fn light_map(&self) -> Option<&LightMapSource<'_>> {
        Some(self)
    }

    fn evaluate_lit(&self, _: &[TexelPoint], light: &[Vec3], values: &mut [Vec4]) {
        values.iter_mut().zip(light).for_each(|(value, light)| *value = light.extend(1.0));
    }
}

// Options of light maps, and what may be wrong with them.

/// How to bake a light map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightMapOptions {
    /// What is computed.
    pub quantity: LightQuantity,
    /// Paths per texel, 4 to 1048576; rounded up to a multiple of 4.
    pub samples: u32,
    /// Where given, texels whose standard error is larger (in units of the value) take more paths, up to `max_samples`.
    /// Positive.
    pub target_error: Option<f32>,
    /// Paths per texel at most where `target_error` is given; not below `samples`, at most 1048576.
    pub max_samples: u32,
    /// Diffuse reflections before light reaches the point, 0 to 64. Only for [`LightQuantity::Full`].
    pub bounces: u32,
    /// Only for [`LightQuantity::AmbientOcclusion`]: surfaces farther away than this do not occlude, world units; all do
    /// where it is not given. Positive.
    pub occlusion_distance: Option<f64>,
    /// Rays start from the smooth surface that vertex normals suggest where it lies above the triangle (J. Hanika,
    /// "Hacking the Shadow Terminator", 2021), so that coarse round objects do not shade themselves triangle by triangle.
    pub smooth_terminator: bool,
    /// Bakes replace texels by the mean of those of their tile that differ by no more than noise.
    pub denoise: bool,
    /// Other seeds give other noise.
    pub seed: u32,
}

impl Default for LightMapOptions {
    /// All light, 256 paths of up to 4 reflections, not adaptive, denoised.
    fn default() -> Self {
        Self {
            quantity: LightQuantity::Full,
            samples: 256,
            target_error: None,
            max_samples: 4096,
            bounces: 4,
            occlusion_distance: None,
            smooth_terminator: true,
            denoise: true,
            seed: 0,
        }
    }
}

const MAX_SAMPLES: u32 = 1 << 20;
const MAX_BOUNCES: u32 = 64;

impl LightMapOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// The first option that is out of range.
    pub fn check(&self) -> Result<()> {
        let counts = [("samples", self.samples), ("max_samples", self.max_samples)];
        if let Some((what, count)) = counts.into_iter().find(|c| !(4..=MAX_SAMPLES).contains(&c.1)) {
            return Err(Error::invalid(format!(
                "{what} is {count}, but a texel takes 4 to {MAX_SAMPLES} paths"
            )));
        }
        if self.target_error.is_some() && self.max_samples < self.samples {
            return Err(Error::invalid(format!(
                "max_samples is {}, but must not be below samples, {}",
                self.max_samples, self.samples
            )));
        }
        if self.bounces > MAX_BOUNCES {
            return Err(Error::invalid(format!(
                "bounces is {}, but at most {MAX_BOUNCES} reflections are followed",
                self.bounces
            )));
        }
        let lengths = [
            ("target_error", self.target_error.map(f64::from)),
            ("occlusion_distance", self.occlusion_distance),
        ];
        for (what, value) in lengths {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return Err(Error::invalid(format!("{what} is {value}, but must be a positive number")));
            }
        }
        Ok(())
    }

    pub(crate) fn reflections(&self) -> u32 {
        if self.quantity == LightQuantity::Full { self.bounces } else { 0 }
    }
}

// What lights a surface besides lamps: the sky, and what other surfaces reflect and emit.

/// Radiance from where no surface is. Closures from unit directions (of the world, from the surface outwards) to linear RGB
/// are skies.
pub trait Sky: Sync {
    /// From a unit direction.
    fn radiance(&self, direction: Vec3) -> Vec3;
}

impl<F: Fn(Vec3) -> Vec3 + Sync> Sky for F {
    fn radiance(&self, direction: Vec3) -> Vec3 {
        self(direction)
    }
}

/// What surfaces do with light. Closures from points to the albedo are reflectors that do not glow.
pub trait Reflector: Sync {
    /// Share of the light that is reflected diffusely, linear RGB, 0..1, on both sides.
    fn albedo(&self, at: SurfacePoint) -> Vec3;

    /// Emitted radiance, linear RGB, on both sides.
    fn emission(&self, at: SurfacePoint) -> Vec3 {
        let _ = at;
        Vec3::ZERO
    }

    /// False where light passes through, as in cut-outs.
    fn is_solid(&self, at: SurfacePoint) -> bool {
        let _ = at;
        true
    }
}

impl<F: Fn(SurfacePoint) -> Vec3 + Sync> Reflector for F {
    fn albedo(&self, at: SurfacePoint) -> Vec3 {
        self(at)
    }
}

/// All that lights a mesh.
#[derive(Clone)]
pub struct LightScene<'a> {
    /// Lights, world space.
    pub lights: Vec<BakeLight>,
    /// Light from outside.
    pub sky: &'a dyn Sky,
    /// The mesh's surface.
    pub reflector: &'a dyn Reflector,
}

impl std::fmt::Debug for LightScene<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LightScene").field("lights", &self.lights).finish_non_exhaustive()
    }
}

/// The base colour and emission that a [`Source`] would bake, as a reflector. Alpha below the threshold of a cut-out lets light through, or below a
/// half where it is the share of the surface that is there, or blended.
pub struct SourceReflector<'a> {
    mesh: &'a Mesh,
    colors: SurfaceColors<'a>,
}

impl<'a> SourceReflector<'a> {
    /// `source` is a source for `mesh`; channels other than base colour and emission are ignored. Without a base colour the
    /// surface is white.
    pub fn new(mesh: &'a Mesh, source: &'a dyn Source) -> Self {
        Self { mesh, colors: SurfaceColors::new(source) }
    }

    fn value(&self, channel: usize, at: SurfacePoint) -> Vec4 {
        let [a, b, c] = self.mesh.triangle_positions(at.index());
        let point = TexelPoint {
            at,
            lambda_steps: [Vec3::ZERO; 2],
            position: at.interpolate([a, b, c]),
            position_steps: [Vec3::ZERO; 2],
            normal: (b - a).cross(c - a).normalize_or(Vec3::Z),
        };
        self.colors.values(&point)[channel]
    }
}

impl Reflector for SourceReflector<'_> {
    fn albedo(&self, at: SurfacePoint) -> Vec3 {
        let color = |c| self.value(c, at).truncate().clamp(Vec3::ZERO, Vec3::ONE);
        self.colors.base_color.map_or(Vec3::ONE, color)
    }

    fn emission(&self, at: SurfacePoint) -> Vec3 {
        let color = |c| self.value(c, at).truncate().max(Vec3::ZERO);
        self.colors.emission.map_or(Vec3::ZERO, color)
    }

    fn is_solid(&self, at: SurfacePoint) -> bool {
        let Some(channel) = self.colors.base_color.filter(|_| self.colors.has_alpha) else { return true };
        let threshold = match self.mesh.alpha_mode(at.index()) {
            // A number to be compared with it; not where alpha is the share that is there.
            AlphaMode::Mask(threshold) if !self.colors.has_shares() => threshold,
            _ => 0.5,
        };
        self.value(channel, at).w >= threshold
    }
}

// How noisy a light map is: standard errors of all its texels, summed so that the order does not matter.

/// The noise of the texels that a light map's source has computed so far. Errors are standard errors, in units of the values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightMapNoise {
    /// Texels computed; where tiles overlap, points of the surface count more than once.
    pub texels: u64,
    /// Mean number of paths per texel.
    pub mean_samples: f64,
    /// Mean of the values, over texels and channels.
    pub mean_value: f64,
    /// Mean of the standard errors.
    pub mean_error: f64,
    /// 95 % of the standard errors are not above this (to a quarter of an octave).
    pub error_95: f64,
    /// The largest standard error (to a quarter of an octave).
    pub largest_error: f64,
    /// Mean of the standard errors that denoising has left; `mean_error` where nothing was denoised.
    pub mean_error_left: f64,
}

/// Sums are whole multiples of this.
const UNIT: f64 = 1.0 / (1 << 24) as f64;
/// What a single texel adds is at most this.
const FIXED_POINT_LIMIT: f64 = (1 << 14) as f64;
/// Buckets of a quarter of an octave.
const BUCKETS: usize = 160;
/// Upper end of the first bucket.
const FIRST: f64 = UNIT;

fn units(x: f32) -> u64 {
    (f64::from(x).clamp(0.0, FIXED_POINT_LIMIT) / UNIT).round() as u64
}

/// Gathers errors from many threads; whole numbers, so that the sums do not depend on the order.
#[derive(Debug)]
struct NoiseMeter {
    texels: AtomicU64,
    samples: AtomicU64,
    values: AtomicU64,
    errors: AtomicU64,
    /// How many texels are denoised, and the sum of their errors.
    denoised: AtomicU64,
    errors_left: AtomicU64,
    buckets: Vec<AtomicU64>,
}

impl Default for NoiseMeter {
    fn default() -> Self {
        let zero = || AtomicU64::new(0);
        let buckets = (0..BUCKETS).map(|_| zero()).collect();
        Self {
            texels: zero(),
            samples: zero(),
            values: zero(),
            errors: zero(),
            denoised: zero(),
            errors_left: zero(),
            buckets,
        }
    }
}

impl NoiseMeter {
    pub(crate) fn add(&self, value: f32, error: f32, samples: u32) {
        self.texels.fetch_add(1, Relaxed);
        self.samples.fetch_add(samples.into(), Relaxed);
        self.values.fetch_add(units(value), Relaxed);
        self.errors.fetch_add(units(error), Relaxed);
        self.buckets[bucket(error.into())].fetch_add(1, Relaxed);
    }

    pub(crate) fn add_left(&self, error: f32) {
        self.denoised.fetch_add(1, Relaxed);
        self.errors_left.fetch_add(units(error), Relaxed);
    }

    pub(crate) fn report(&self) -> LightMapNoise {
        let texels = self.texels.load(Relaxed);
        let mean = |sum: &AtomicU64| sum.load(Relaxed) as f64 / texels.max(1) as f64;
        let counts: Vec<u64> = self.buckets.iter().map(|b| b.load(Relaxed)).collect();
        let mut below = 0;
        let error_95 = counts.iter().position(|count| {
            below += count;
            below * 20 >= texels * 19
        });
        let largest = counts.iter().rposition(|&count| count > 0);
        let denoised = self.denoised.load(Relaxed);
        let (sum, count) = match denoised {
            0 => (&self.errors, texels),
            _ => (&self.errors_left, denoised),
        };
        LightMapNoise {
            texels,
            mean_samples: mean(&self.samples),
            mean_value: mean(&self.values) * UNIT,
            mean_error: mean(&self.errors) * UNIT,
            error_95: error_95.filter(|_| texels > 0).map_or(0.0, upper_end),
            largest_error: largest.map_or(0.0, upper_end),
            mean_error_left: sum.load(Relaxed) as f64 / count.max(1) as f64 * UNIT,
        }
    }
}

/// The bucket of an error: the first for all that is below its end.
fn bucket(error: f64) -> usize {
    if error <= FIRST {
        return 0;
    }
    ((4.0 * (error / FIRST).log2()).ceil() as usize).min(BUCKETS - 1)
}

fn upper_end(bucket: usize) -> f64 {
    if bucket == 0 { 0.0 } else { FIRST * (bucket as f64 / 4.0).exp2() }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{Mesh, generate};
    use fantex_test::{ball_on_a_plane, cleaned};
    use glam::Vec3;

    use super::*;

    fn gray(_: SurfacePoint) -> Vec3 {
        Vec3::splat(0.5)
    }

    /// A blue sky with a sun that gives `share` of all light.
    fn sky_with_sun(radius_degrees: f32, share: f32) -> impl Fn(Vec3) -> Vec3 + Sync {
        let to_sun = Vec3::new(-0.5, 0.7, 0.3).normalize();
        let cos_radius = radius_degrees.to_radians().cos();
        let brightness = share / (1.0 - share) / (0.5 * (1.0 - cos_radius));
        move |d: Vec3| {
            let sky = Vec3::new(0.3, 0.4, 0.6) * (1.0 + 0.5 * d.y);
            sky + if d.dot(to_sun) > cos_radius { Vec3::splat(brightness * 0.4) } else { Vec3::ZERO }
        }
    }

    /// Sources with and without a table of the sky.
    fn both<'a>(mesh: &'a Mesh, sky: &'a dyn Sky, options: LightMapOptions) -> [LightMapSource<'a>; 2] {
        let scene = LightScene { lights: Vec::new(), sky, reflector: &gray };
        let chosen = LightMapSource::new(mesh, &scene, options).unwrap();
        let mut by_cosine = LightMapSource::new(mesh, &scene, options).unwrap();
        by_cosine.tracer.sky_table = None;
        [chosen, by_cosine]
    }

    fn in_triangle(triangle: usize) -> SurfacePoint {
        SurfacePoint { triangle: triangle as u32, lambda: Vec3::new(0.3, 0.3, 0.4) }
    }

    #[test]
    fn every_range_is_checked() {
        let good = LightMapOptions::default();
        assert!(good.check().is_ok());
        let bad = [
            LightMapOptions { samples: 3, ..good },
            LightMapOptions { samples: MAX_SAMPLES + 1, max_samples: MAX_SAMPLES, ..good },
            LightMapOptions { target_error: Some(0.1), max_samples: 8, ..good },
            LightMapOptions { target_error: Some(0.0), ..good },
            LightMapOptions { target_error: Some(f32::NAN), ..good },
            LightMapOptions { bounces: 65, ..good },
            LightMapOptions { occlusion_distance: Some(-1.0), ..good },
            LightMapOptions { occlusion_distance: Some(f64::INFINITY), ..good },
        ];
        for options in bad {
            assert!(options.check().is_err(), "{options:?}");
        }
    }

    #[test]
    fn means_and_percentiles_are_those_of_the_errors() {
        let meter = NoiseMeter::default();
        assert_eq!(meter.report(), LightMapNoise::default());
        for i in 1..=1000_u32 {
            meter.add(2.0, i as f32 / 1000.0, 64 + i % 2);
        }
        let report = meter.report();
        assert_eq!(report.texels, 1000);
        assert!((report.mean_samples - 64.5).abs() < 1e-9 && (report.mean_value - 2.0).abs() < 1e-6);
        assert!((report.mean_error - 0.5005).abs() < 1e-4);
        assert!((0.95..0.95 * 1.19).contains(&report.error_95), "{}", report.error_95);
        assert!((1.0..1.2).contains(&report.largest_error), "{}", report.largest_error);
    }

    #[test]
    fn what_is_exact_has_no_error() {
        let meter = NoiseMeter::default();
        meter.add(1.0, 0.0, 4);
        assert_eq!((meter.report().error_95, meter.report().largest_error), (0.0, 0.0));
    }

    #[test]
    fn the_mean_is_that_of_directions_by_the_cosine() {
        let mesh = ball_on_a_plane();
        // A sun that the cosine finds often enough to compare with.
        let sky = sky_with_sun(12.0, 0.5);
        for bounces in [0, 2] {
            let options = LightMapOptions { bounces, samples: 4096, ..LightMapOptions::default() };
            let [chosen, by_cosine] = both(&mesh, &sky, options);
            assert!(chosen.tracer.sky_table.is_some());
            let (mut differences, mut variances, mut n) = (DVec3::ZERO, [0.0; 2], 0.0);
            for triangle in (0..mesh.triangles.len()).step_by(97) {
                let a = chosen.illumination(in_triangle(triangle), [Vec3::ZERO; 2]);
                let b = by_cosine.illumination(in_triangle(triangle), [Vec3::ZERO; 2]);
                differences += (a.value - b.value).as_dvec3();
                for (sum, light) in variances.iter_mut().zip([a, b]) {
                    *sum += f64::from(light.standard_error).powi(2);
                }
                n += 1.0;
            }
            let noise = (variances[0] + variances[1]).sqrt() / n;
            let bias = differences / n;
            eprintln!("{bounces} reflections: difference {bias}, noise {noise}");
            assert!(bias.abs().max_element() < 5.0 * noise + 1e-4, "{bias}, noise {noise}");
            assert!(variances[0] < 0.3 * variances[1], "{variances:?}");
        }
    }

    /// On a plane the light of a sky with a sun is known.
    #[test]
    fn the_light_of_a_small_sun_is_exact() {
        let mesh = cleaned(generate::grid(4));
        let to_sun = Vec3::new(0.6, 0.8, 0.0);
        for radius_degrees in [0.27_f32, 2.0, 20.0] {
            let (sin_radius, cos_radius) = radius_degrees.to_radians().sin_cos();
            let radiance = 2.0 / (sin_radius * sin_radius);
            let sky = |d: Vec3| Vec3::new(if d.dot(to_sun) > cos_radius { radiance } else { 0.0 }, 0.5, 0.0);
            let options = LightMapOptions {
                quantity: LightQuantity::Direct,
                samples: 4096,
                ..LightMapOptions::default()
            };
            let [chosen, _] = both(&mesh, &sky, options);
            assert!(chosen.tracer.sky_table.is_some());
            let light = chosen.illumination(in_triangle(7), [Vec3::ZERO; 2]);
            // The integral of the cosine over a cap above the horizon is pi sin² times the cosine of its axis.
            let expected = 2.0 * to_sun.y;
            let error = (light.value - Vec3::new(expected, 0.5, 0.0)).abs();
            assert!(
                error.x < 0.02 * expected && error.y < 0.01,
                "{radius_degrees}: {} {expected}",
                light.value
            );
        }
    }

    /// In the open, under a sky that is one everywhere but for a table that someone made, light is one.
    #[test]
    fn a_furnace_stays_a_furnace_whatever_the_table() {
        let mesh = ball_on_a_plane();
        let white = |_: Vec3| Vec3::ONE;
        let reflector = |_: SurfacePoint| Vec3::ONE;
        let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &reflector };
        let options = LightMapOptions { bounces: 40, samples: 1024, ..LightMapOptions::default() };
        let mut source = LightMapSource::new(&mesh, &scene, options).unwrap();
        assert!(source.tracer.sky_table.is_none());
        source.tracer.sky_table = SkyTable::new(&sky_with_sun(5.0, 0.5));
        let (mut sum, mut n) = (0.0, 0.0);
        // The ball, whose paths all end in the sky after a few reflections.
        for triangle in (128..mesh.triangles.len()).step_by(197) {
            let light = source.illumination(in_triangle(triangle), [Vec3::ZERO; 2]);
            sum += f64::from(light.value.x);
            n += 1.0;
            assert!((light.value.x - 1.0).abs() < 6.0 * light.standard_error + 0.02, "{triangle}: {light:?}");
        }
        assert!((sum / n - 1.0).abs() < 0.01, "{}", sum / n);
    }
}
