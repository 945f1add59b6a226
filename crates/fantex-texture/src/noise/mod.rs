//! Noise: reproducible randomness that is smooth, has a width of its details, and repeats nowhere.
//!
//! Patterns come from an integer hash of the cell and a seed, so that they have no period. Sums take a footprint: the width,
//! in the units of the point, over which the caller averages. What is narrower fades to its mean.

use glam::{Vec3, Vec4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod lanes;
mod perlin3;
mod scattered;

use lanes::{Gradients, Kernel, Octaves, Shape, Simplices, octave_seed};
pub use perlin3::*;
use scattered::{CellularValue, KnownPoints, Scattered};

/// What is left of noise with cells of `frequency` per unit when it is averaged over `footprint`: 1 up to half a cell, 0 from a whole one on.
/// Periods of noise are about two cells long, and texels as wide as the footprint show none that is shorter than two of them.
pub fn band_limit(frequency: f32, footprint: f32) -> f32 {
    1.0 - smoothstep(0.5, 1.0, frequency * footprint)
}

/// 0 below `low`, 1 above `high`, a cubic with level ends between.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

// ---- Random numbers of cells.

/// One round of an integer hash.
fn absorb(hash: u32, coordinate: i32) -> u32 {
    let mixed = (hash ^ coordinate as u32).wrapping_add(0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
    mixed ^ (mixed >> 15)
}

/// Spreads every bit of the hash over the upper bits.
fn finish(hash: u32) -> u32 {
    let mixed = hash.wrapping_mul(0xc2b2_ae35);
    (mixed ^ (mixed >> 16)).wrapping_mul(0x27d4_eb2f)
}

fn cell_hash<const D: usize>(seed: u32, cell: [i32; D]) -> u32 {
    finish(cell.iter().rev().fold(seed, |hash, &coordinate| absorb(hash, coordinate)))
}

/// A hash as a number in [0,1).
fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 / (1 << 24) as f32
}

/// The unit cell of a point and the point's offset inside.
fn cell_and_offset<const D: usize>(p: [f32; D]) -> ([i32; D], [f32; D]) {
    let cell = p.map(|x| {
        let truncated = x as i32;
        truncated.saturating_sub(i32::from(x < truncated as f32))
    });
    (cell, std::array::from_fn(|d| p[d] - cell[d] as f32))
}

/// White noise: a random number between -1 and 1 for every unit cell, mean 0.
pub fn white_noise<const D: usize>(seed: u32, p: [f32; D]) -> f32 {
    2.0 * unit(cell_hash(seed, cell_and_offset(p).0)) - 1.0
}

/// Point `i` of a sequence that is spread over a cube of 64 cells.
fn scattered_point(i: u32) -> [f32; 3] {
    std::array::from_fn(|d| 64.0 * unit(finish(absorb(absorb(0x51ed_270b, i as i32), d as i32))) - 32.0)
}

/// Gradient vectors of 2 dimensions lie at odd multiples of a sixteenth turn, of this length like those of space.
const SIXTEENTHS: [[f32; 2]; 4] = [
    [1.387_039_8, 0.275_899_38],
    [1.175_875_6, 0.785_694_96],
    [0.785_694_96, 1.175_875_6],
    [0.275_899_38, 1.387_039_8],
];

/// One of the gradient vectors of a dimension, picked by the upper bits of a hash: sixteen directions in the plane, the
/// twelve edges of a cube in space (K. Perlin, "Improving noise", 2002), the thirty-two edges of a tesseract in 4D.
fn gradient_vector<const D: usize>(hash: u32) -> [f32; D] {
    let pick = |count: u64| ((u64::from(hash) * count) >> 32) as usize;
    let sign = |bits: usize, bit: usize| if bits >> bit & 1 == 0 { 1.0 } else { -1.0 };
    let mut vector = [0.0; 4];
    match D {
        2 => {
            let bits = pick(16);
            let [x, y] = SIXTEENTHS[bits >> 2];
            (vector[0], vector[1]) = (x * sign(bits, 0), y * sign(bits, 1));
        }
        _ => {
            // One coordinate is zero, the others are one with any sign.
            let signs = D - 1;
            let bits = pick((D as u64) << signs);
            let zero = D - 1 - (bits >> signs);
            let others = (0..D).filter(|&d| d != zero);
            others.enumerate().for_each(|(bit, d)| vector[d] = sign(bits, bit));
        }
    }
    std::array::from_fn(|d| vector[d])
}

// ---- K. Perlin, "Improving noise", 2002, for any number of dimensions: cubic cells with a random gradient at each corner, blended by
// a quintic. The gradient is chosen by an integer hash instead of a permutation table.

/// Smooth noise of 2, 3 or 4 dimensions, between about -1 and 1 with mean 0, and its derivative along each axis. It is 0
/// at every point with integer coordinates.
///
/// Four dimensions have one axis more to vary along, and are scaled so that their range is that of the others.
pub fn gradient_noise<const D: usize>(seed: u32, p: [f32; D]) -> (f32, [f32; D]) {
    const { assert!(2 <= D && D <= 4) };
    let (cell, t) = cell_and_offset(p);
    let fade = t.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let fade_slope = t.map(|t| 30.0 * t * t * (t * (t - 2.0) + 1.0));
    let (mut value, mut gradient) = (0.0, [0.0; D]);
    for corner in 0..1_usize << D {
        let upper = |d: usize| corner >> d & 1 == 1;
        let slope: [f32; D] = gradient_vector(cell_hash::<D>(
            seed,
            std::array::from_fn(|d| cell[d].wrapping_add(i32::from(upper(d)))),
        ));
        let height: f32 = (0..D).map(|d| slope[d] * (t[d] - f32::from(u8::from(upper(d))))).sum();
        let weight = |d: usize| if upper(d) { fade[d] } else { 1.0 - fade[d] };
        let weight_slope = |d: usize| if upper(d) { fade_slope[d] } else { -fade_slope[d] };
        let whole: f32 = (0..D).map(weight).product();
        value += whole * height;
        for (axis, sum) in gradient.iter_mut().enumerate() {
            let others: f32 = (0..D).filter(|&d| d != axis).map(weight).product();
            *sum += whole * slope[axis] + weight_slope(axis) * others * height;
        }
    }
    let scale = if D == 4 { 0.85 } else { 1.0 };
    (scale * value, gradient.map(|g| scale * g))
}

// ---- Simplex noise: K. Perlin, "Noise hardware", 2001, as S. Gustavson explains it in "Simplex noise demystified", 2005.
//
// Space is cut into simplices instead of cubes: D + 1 corners count instead of 2^D, and no direction of the axes shows. Deviations:
// the kernels end at the squared radius 1/2, where neighbouring simplices begin, so that value and derivatives are
// continuous in all dimensions; gradients are chosen by an integer hash.

/// One over the largest value of the sum of kernels, by dimension (searched numerically over all choices of gradients).
const SCALES: [f32; 5] = [0.0, 0.0, 70.29, 76.88, 62.79];

/// Squared radius of the kernels.
const RADIUS2: f32 = 0.5;

/// Smooth noise of 2, 3 or 4 dimensions, between -1 and 1 with mean 0, and its derivative along each axis.
pub fn simplex_noise<const D: usize>(seed: u32, p: [f32; D]) -> (f32, [f32; D]) {
    const { assert!(2 <= D && D <= 4) };
    let root = (D as f32 + 1.0).sqrt();
    let (skew, unskew) = ((root - 1.0) / D as f32, (1.0 - 1.0 / root) / D as f32);

    // The skewed cube that holds the point, and the point relative to the cube's first corner.
    let shift = skew * p.iter().sum::<f32>();
    let (cell, _) = cell_and_offset(p.map(|x| x + shift));
    let back = unskew * cell.iter().map(|&c| c as f32).sum::<f32>();
    let local: [f32; D] = std::array::from_fn(|d| p[d] - (cell[d] as f32 - back));

    // The simplex is walked from the first to the last corner of the cube, along the largest coordinate first.
    let rank: [usize; D] = std::array::from_fn(|d| {
        (0..D).filter(|&e| local[e] > local[d] || (local[e] == local[d] && e < d)).count()
    });
    let (mut value, mut gradient) = (0.0, [0.0; D]);
    for corner in 0..=D {
        let step: [i32; D] = std::array::from_fn(|d| i32::from(rank[d] < corner));
        let offset: [f32; D] = std::array::from_fn(|d| local[d] - step[d] as f32 + corner as f32 * unskew);
        let reach = RADIUS2 - offset.iter().map(|x| x * x).sum::<f32>();
        if reach <= 0.0 {
            continue;
        }
        let slope: [f32; D] =
            gradient_vector(cell_hash::<D>(seed, std::array::from_fn(|d| cell[d].wrapping_add(step[d]))));
        let height: f32 = (0..D).map(|d| slope[d] * offset[d]).sum();
        let (cubed, fourth) = (reach.powi(3), reach.powi(4));
        value += fourth * height;
        for d in 0..D {
            gradient[d] += fourth * slope[d] - 8.0 * cubed * height * offset[d];
        }
    }
    (SCALES[D] * value, gradient.map(|g| SCALES[D] * g))
}

// ---- Cellular noise: S. Worley, "A cellular texture basis function", 1996. One point is scattered in every unit cell; the noise is
// made of the distances to the nearest ones.

/// How distances are measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CellularMetric {
    /// Along the straight line: round cells.
    #[default]
    Euclidean,
    /// The sum over the axes: diamonds.
    Manhattan,
    /// The greatest over the axes: boxes.
    Chebyshev,
}

impl CellularMetric {
    /// The measure of a distance and of one more coordinate: the square of a straight line's length, else the distance.
    fn joined(self, distance: f32, along: f32) -> f32 {
        match self {
            Self::Euclidean => distance + along * along,
            Self::Manhattan => distance + along.abs(),
            Self::Chebyshev => distance.max(along.abs()),
        }
    }

    fn measure<const D: usize>(self, offset: [f32; D]) -> f32 {
        offset.iter().fold(0.0, |distance, &along| self.joined(distance, along))
    }

    /// The distance of a measure.
    fn length(self, measure: f32) -> f32 {
        if self == Self::Euclidean { measure.sqrt() } else { measure }
    }
}

/// What is known about the scattered points near a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cellular {
    /// Distance to the nearest point, in cells.
    pub nearest: f32,
    /// Distance to the second nearest, in cells.
    pub second: f32,
    /// A random number in [0,1) of the nearest point: the same all over its Voronoi cell.
    pub id: f32,
}

/// The nearest scattered points of 2, 3 or 4 dimensions. Exact: cells are searched ring by ring until no farther one can hold a
/// nearer point.
pub fn cellular<const D: usize>(seed: u32, p: [f32; D], metric: CellularMetric) -> Cellular {
    const { assert!(2 <= D && D <= 4) };
    let (cell, offset) = cell_and_offset(p);
    // From the point to the nearest wall of its cell; every metric measures at least that along an axis.
    let margin = offset.iter().fold(0.5_f32, |least, &t| least.min(t).min(1.0 - t));
    let mut found = Cellular { nearest: f32::INFINITY, second: f32::INFINITY, id: 0.0 };
    for ring in 0..=CELLULAR_RINGS {
        if metric.length(found.second) <= ring as f32 - 1.0 + margin {
            break;
        }
        for_each_of_ring::<D>(ring, |step| {
            let gap = |d: usize| match step[d] {
                0 => 0.0,
                1.. => step[d] as f32 - offset[d],
                _ => offset[d] - (step[d] + 1) as f32,
            };
            if metric.measure::<D>(std::array::from_fn(gap)) >= CELLULAR_SLACK * found.second {
                return;
            }
            let hash = cell_hash::<D>(seed, std::array::from_fn(|d| cell[d].wrapping_add(step[d])));
            let to_point =
                std::array::from_fn(|d| step[d] as f32 + unit(finish(absorb(hash, d as i32))) - offset[d]);
            let distance = metric.measure::<D>(to_point);
            if distance < found.nearest {
                found = Cellular { nearest: distance, second: found.nearest, id: unit(hash) };
            } else if distance < found.second {
                found.second = distance;
            }
        });
    }
    Cellular { nearest: metric.length(found.nearest), second: metric.length(found.second), id: found.id }
}

/// Rings of cells beyond the point's own that are searched at most.
const CELLULAR_RINGS: i32 = 4;

/// Cells this many times as far as the second nearest point hold no nearer one, whatever is rounded.
const CELLULAR_SLACK: f32 = 1.0001;

/// [`cellular`] at many points of space: the same values, several times as fast.
///
/// # Panics
/// If the slices differ in length.
pub fn cellular_all(seed: u32, points: &[Vec3], metric: CellularMetric, out: &mut [Cellular]) {
    assert_eq!(points.len(), out.len(), "one value for every point");
    scattered::cellular_at(seed, metric, |i| points[i].to_array(), out);
}

/// The cells whose farthest coordinate is `ring` steps away.
fn for_each_of_ring<const D: usize>(ring: i32, mut visit: impl FnMut([i32; D])) {
    let mut step = [-ring; D];
    loop {
        if step.iter().any(|c| c.abs() == ring) {
            visit(step);
        }
        let Some(next) = step.iter().position(|&c| c < ring) else { return };
        step[..next].fill(-ring);
        step[next] += 1;
    }
}

// ---- Every family of noise by name, and its fractal sums.

/// A family of noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoiseFamily {
    /// Gradients on a cubic lattice, -1 to 1.
    #[default]
    Perlin,
    /// Gradients on simplices, -1 to 1.
    Simplex,
    /// Distance to the nearest scattered point, from 0 to about 1.
    Cellular,
    /// How much farther the second nearest point is than the nearest: 0 along the borders of the Voronoi cells.
    CellularBorders,
    /// A random number for every Voronoi cell, -1 to 1.
    CellularIds,
    /// A random number for every cubic cell, -1 to 1.
    White,
}

impl NoiseFamily {
    /// The value of one octave in 2, 3 or 4 dimensions; cells are one unit wide. Only cellular noise has a metric.
    pub fn value<const D: usize>(self, metric: CellularMetric, seed: u32, p: [f32; D]) -> f32 {
        match self {
            Self::Perlin => match *p.as_slice() {
                // The same pattern, by faster code.
                [x, y, z] => Noise::new(seed).value(glam::Vec3::new(x, y, z)),
                _ => gradient_noise(seed, p).0,
            },
            Self::Simplex => simplex_noise(seed, p).0,
            Self::Cellular => cellular(seed, p, metric).nearest,
            Self::CellularBorders => {
                let found = cellular(seed, p, metric);
                found.second - found.nearest
            }
            Self::CellularIds => 2.0 * cellular(seed, p, metric).id - 1.0,
            Self::White => white_noise(seed, p),
        }
    }
}

/// How octaves are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FractalKind {
    /// The first octave alone.
    #[serde(rename = "none")]
    Single,
    /// The sum of the octaves: fractional Brownian motion (B. Mandelbrot and J. van Ness, 1968).
    #[default]
    Fbm,
    /// The sum of their absolute values (K. Perlin, "An image synthesizer", 1985).
    Turbulence,
    /// The sum of crests `(1 - |n|)^2` where octaves pass through 0 (after F. K. Musgrave, "Texturing and modeling", 1994).
    Ridged,
}

impl FractalKind {
    fn shape(self) -> Shape {
        match self {
            Self::Single | Self::Fbm => Shape::Plain,
            Self::Turbulence => Shape::Absolute,
            Self::Ridged => Shape::Crest(1.0),
        }
    }
}

/// A fractal sum of noise that knows its mean, and so can be averaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FractalNoise {
    family: NoiseFamily,
    metric: CellularMetric,
    kind: FractalKind,
    octaves: Fractal,
    seed: u32,
    /// Mean of one shaped octave, measured.
    octave_mean: f32,
}

impl FractalNoise {
    /// Octaves of a family, cellular ones with the usual metric. The mean of an octave is measured at 16 384 points of space.
    pub fn new(family: NoiseFamily, kind: FractalKind, octaves: Fractal, seed: u32) -> Self {
        Self::with_metric(family, CellularMetric::default(), kind, octaves, seed)
    }

    /// As [`FractalNoise::new`], with a metric for cellular noise.
    pub fn with_metric(
        family: NoiseFamily,
        metric: CellularMetric,
        kind: FractalKind,
        octaves: Fractal,
        seed: u32,
    ) -> Self {
        let octaves = if kind == FractalKind::Single { Fractal { octaves: 1, ..octaves } } else { octaves };
        const COUNT: u32 = 1 << 14;
        let octave = |i| f64::from(kind.shape().of(family.value(metric, seed, scattered_point(i))));
        let sum: f64 = (0..COUNT).map(octave).sum();
        let octave_mean = (sum / f64::from(COUNT)) as f32;
        Self { family, metric, kind, octaves, seed, octave_mean }
    }

    /// The mean over all of space.
    pub fn mean(&self) -> f32 {
        let Fractal { octaves, gain, .. } = self.octaves;
        self.octave_mean * (0..octaves).map(|i| gain.powi(i as i32)).sum::<f32>()
    }

    /// The sum at a point of 2, 3 or 4 dimensions, averaged over a footprint of this width (in the units of the point): octaves
    /// whose cells approach it fade to their mean.
    pub fn value<const D: usize>(&self, p: [f32; D], footprint: f32) -> f32 {
        let (mut sum, mut frequency, mut amplitude) = (0.0, 1.0, 1.0);
        for octave in 0..self.octaves.octaves {
            let left = band_limit(frequency, footprint);
            let mut value = self.octave_mean;
            if left > 0.0 {
                // Each octave has a pattern and an origin of its own.
                let seed = octave_seed(self.seed, octave);
                let at = p.map(|x| x * frequency + 17.31 * octave as f32);
                value += left
                    * (self.kind.shape().of(self.family.value(self.metric, seed, at)) - self.octave_mean);
            }
            sum += amplitude * value;
            frequency *= self.octaves.lacunarity;
            amplitude *= self.octaves.gain;
        }
        sum
    }

    /// [`FractalNoise::value`] at many points of space, each with its footprint: the same values, several times as fast.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn values(&self, points: &[Vec3], footprints: &[f32], out: &mut [f32]) {
        assert_eq!(points.len(), out.len(), "one value for every point");
        let at = |i: usize| points[i].to_array();
        let scattered = |value| Scattered { metric: self.metric, value, known: KnownPoints::default() };
        match self.family {
            NoiseFamily::Perlin => Gradients::with(|known| self.sums(known, at, footprints, out)),
            NoiseFamily::Simplex => self.sums(&mut Simplices, at, footprints, out),
            NoiseFamily::Cellular => self.sums(&mut scattered(CellularValue::Nearest), at, footprints, out),
            NoiseFamily::CellularBorders => {
                self.sums(&mut scattered(CellularValue::Border), at, footprints, out);
            }
            NoiseFamily::CellularIds => self.sums(&mut scattered(CellularValue::Id), at, footprints, out),
            NoiseFamily::White => self.sums_one_by_one(at, footprints, out),
        }
    }

    /// The same in four dimensions; simplex noise is fast.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn values_4d(&self, points: &[Vec4], footprints: &[f32], out: &mut [f32]) {
        assert_eq!(points.len(), out.len(), "one value for every point");
        let at = |i: usize| points[i].to_array();
        match self.family {
            NoiseFamily::Simplex => self.sums(&mut Simplices, at, footprints, out),
            _ => self.sums_one_by_one(at, footprints, out),
        }
    }

    fn sums<const D: usize>(
        &self,
        kernel: &mut impl Kernel<D>,
        at: impl Fn(usize) -> [f32; D],
        footprints: &[f32],
        out: &mut [f32],
    ) {
        assert_eq!(footprints.len(), out.len(), "one footprint for every point");
        let origin = |octave| Some([17.31 * octave as f32; D]);
        let (mean, shape) = (self.octave_mean, self.kind.shape());
        Octaves { seed: self.seed, fractal: self.octaves, mean, shape, origin }.sums(
            kernel,
            at,
            |i| footprints[i],
            out,
        );
    }

    fn sums_one_by_one<const D: usize>(
        &self,
        at: impl Fn(usize) -> [f32; D],
        footprints: &[f32],
        out: &mut [f32],
    ) {
        assert_eq!(footprints.len(), out.len(), "one footprint for every point");
        for (i, (&footprint, out)) in footprints.iter().zip(out).enumerate() {
            *out = self.value(at(i), footprint);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points spread evenly over a large cube around the origin: an additive recurrence.
    fn points<const D: usize>(count: u32) -> impl Iterator<Item = [f32; D]> {
        const STEPS: [f64; 4] = [0.856_674_9, 0.733_891_9, 0.628_706_7, 0.538_597_3];
        (0..count).map(|i| {
            std::array::from_fn(|d| (((f64::from(i) + 0.5) * STEPS[d]).fract() * 96.0 - 48.0) as f32)
        })
    }

    /// All points within four cells.
    fn brute_force<const D: usize>(seed: u32, p: [f32; D], metric: CellularMetric) -> [f32; 2] {
        let (cell, offset) = cell_and_offset(p);
        let mut distances = Vec::new();
        for ring in 0..=4 {
            for_each_of_ring::<D>(ring, |step| {
                let hash = cell_hash::<D>(seed, std::array::from_fn(|d| cell[d] + step[d]));
                let to_point: [f32; D] = std::array::from_fn(|d| {
                    step[d] as f32 + unit(finish(absorb(hash, d as i32))) - offset[d]
                });
                distances.push(metric.length(metric.measure(to_point)));
            });
        }
        distances.sort_by(f32::total_cmp);
        [distances[0], distances[1]]
    }

    #[test]
    fn gradients_point_to_all_sides() {
        check_gradients::<2>(16);
        check_gradients::<3>(12);
        check_gradients::<4>(32);
    }

    fn check_gradients<const D: usize>(count: usize) {
        let mut seen: Vec<[i32; D]> =
            (0..4096_u32).map(|i| gradient_vector::<D>(i << 20).map(|x| (x * 1e4).round() as i32)).collect();
        let sum = seen.iter().fold([0; D], |sum, v| std::array::from_fn(|d| sum[d] + v[d]));
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), count, "in {D} dimensions");
        assert!(sum.iter().all(|s| s.abs() < 400_000), "they point to all sides alike: {sum:?}");
    }

    #[test]
    fn the_nearest_points_are_found() {
        for metric in [CellularMetric::Euclidean, CellularMetric::Manhattan, CellularMetric::Chebyshev] {
            for p in points::<2>(500) {
                let found = cellular(9, p, metric);
                assert_eq!([found.nearest, found.second], brute_force(9, p, metric), "{metric:?} {p:?}");
            }
            for p in points::<3>(60) {
                let found = cellular(9, p, metric);
                assert_eq!([found.nearest, found.second], brute_force(9, p, metric), "{metric:?} {p:?}");
            }
        }
    }
}
