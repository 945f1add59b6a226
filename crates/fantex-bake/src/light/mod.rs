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
//! standard error of their mean. Texels do not depend on threads, nor on each other.

mod lamp;
mod noise;
mod options;
mod scene;
mod sequence;
mod sky_table;
mod tracer;

#[cfg(test)]
mod tests;

use fantex_mesh::{Mesh, TriangleBvh, shading_normals};
use fantex_store::ChannelKind;
use glam::{DVec3, Vec3, Vec4};

pub use self::lamp::BakeLight;
pub use self::noise::LightMapNoise;
pub use self::options::{LightMapError, LightMapOptions, LightQuantity};
pub use self::scene::{LightScene, Reflector, Sky, SourceReflector};

use self::lamp::Lamp;
use self::noise::NoiseMeter;
use self::sequence::{Sequence, mixed};
use self::sky_table::SkyTable;
use self::tracer::Tracer;
use crate::{Prefilter, Source, SourceChannel, SurfacePoint};

/// Independent estimates of a texel.
const ESTIMATES: u32 = 4;

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
/// The mean over the texel is taken ([`Prefilter::Box`]), as far as it lies on the triangle under its centre.
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
    ///
    /// An option or a number of a light is out of its range.
    pub fn new(
        mesh: &'a Mesh,
        scene: &LightScene<'a>,
        options: LightMapOptions,
    ) -> Result<Self, LightMapError> {
        options.check()?;
        let lamps = scene.lights.iter().enumerate().map(|(i, light)| Lamp::new(mesh, i, light));
        let lamps = lamps.collect::<Result<Vec<_>, _>>()?;
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

    /// Light at a point; `lambda_steps` are the sides of the parallelogram around it over which the mean is taken, as changes
    /// of the barycentric coordinates (zero: the point alone).
    pub fn illumination(&self, triangle: usize, lambda: Vec3, lambda_steps: [Vec3; 2]) -> Illumination {
        let options = &self.tracer.options;
        let seed = lambda
            .to_array()
            .iter()
            .fold(mixed(options.seed) ^ triangle as u32, |seed, x| mixed(seed ^ x.to_bits()));
        let sequences: [Sequence; ESTIMATES as usize] =
            std::array::from_fn(|i| Sequence::new(seed.wrapping_add(i as u32)));
        let mut sums = [DVec3::ZERO; ESTIMATES as usize];
        let (mut done, mut goal) = (0, options.samples.div_ceil(ESTIMATES));
        let most = options.max_samples.div_ceil(ESTIMATES);
        loop {
            for (sequence, sum) in sequences.iter().zip(&mut sums) {
                for index in done..goal {
                    let light = self.tracer.sample(triangle, lambda, lambda_steps, sequence, index);
                    *sum += light.as_dvec3();
                }
            }
            done = goal;
            let (value, standard_error) = mean_and_error(&sums, done);
            let good = options.target_error.is_none_or(|target| standard_error <= target);
            if good || done >= most {
                return Illumination { value, standard_error, samples: done * ESTIMATES };
            }
            goal = (2 * done).min(most);
        }
    }

    /// The noise of all texels so far. It does not depend on the number of threads.
    pub fn noise(&self) -> LightMapNoise {
        self.meter.report()
    }
}

/// Mean of the estimates and its standard error, from sums of `count` samples each.
fn mean_and_error(sums: &[DVec3; ESTIMATES as usize], count: u32) -> (Vec3, f32) {
    let n = f64::from(ESTIMATES);
    let estimates = sums.map(|sum| sum / f64::from(count));
    let mean = estimates.iter().sum::<DVec3>() / n;
    let squares: f64 = estimates.iter().map(|e| (e - mean).length_squared() / 3.0).sum();
    (mean.as_vec3(), (squares / (n * (n - 1.0))).sqrt() as f32)
}

impl Source for LightMapSource<'_> {
    fn channels(&self) -> Vec<SourceChannel> {
        let exceeds_one = self.tracer.options.quantity != LightQuantity::AmbientOcclusion;
        vec![SourceChannel { kind: ChannelKind::Light, has_alpha: false, exceeds_one }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let light = self.illumination(point.triangle, point.lambda, point.lambda_steps);
        self.meter.add(light.value.element_sum() / 3.0, light.standard_error, light.samples);
        values[0] = light.value.extend(1.0);
    }
}
