//! Takes the noise out of estimated light: each texel becomes the mean of the texels of its tile that differ from it by no more
//! than noise (F. Rousselle, C. Knaus and M. Zwicker, "Adaptive Rendering with Non-Local Means Filtering", 2012).
//!
//! ```text
//!  estimates --+-- half A --mean by weights of B--.
//!              |                                   >-- mean: the light; half their distance: its error
//!              `-- half B --mean by weights of A--'
//! ```
//!
//! Weights of one half are independent of the noise of the other, so noise does not choose what it is averaged with. Two texels are
//! alike where the squares around both differ by what their standard errors explain. What has no noise, such as the edge of a hard
//! shadow, stays as it is. Texels that lie apart on the surface, or face other ways, do not count.

use glam::{Vec2, Vec3};

use crate::TexelPoint;

/// Texels that may count lie within a square of so many to each side.
const REACH: i32 = 5;

/// The squares that are compared, texels to each side.
const PATCH: i32 = 1;

/// Result at a texel depends on texels that are at most so far away: [`REACH`], the squares, and the mean of variances.
pub(crate) const REACH_TEXELS: u32 = 8;

const _: () = assert!(REACH + PATCH < REACH_TEXELS as i32);

/// Bytes per texel while a tile is filtered: estimates, comparisons, sums, results.
pub(crate) const BYTES_PER_TEXEL: u64 = 60 + 16 + 2 * size_of::<Plane>() as u64 + 16;

/// Differences count in this many standard deviations. Smaller keeps more detail, and more noise.
const TOLERANCE: f32 = 0.7;

/// Slopes are kept flat as if texels were spread by less than this, squared texels.
const FLATNESS: f32 = 0.25;

/// Differences below this share of the value count little even without noise.
const SMALLEST: f32 = 1e-3;

/// Light at a texel, estimated twice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Estimate {
    /// Independent estimates, linear RGB.
    pub(crate) halves: [Vec3; 2],
    /// Variance of either, mean over the channels.
    pub(crate) variance: f32,
}

/// Estimates of the texels of a tile, or of a part of one, row by row.
pub(crate) struct NoisyLight {
    width: usize,
    height: usize,
    /// 1 where there is an estimate, else 0.
    valid: Vec<f32>,
    halves: [Vec<Vec3>; 2],
    variances: Vec<f32>,
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    /// Longer side of the texel, mesh units.
    sides: Vec<f32>,
}

/// Light without noise.
#[derive(Debug)]
pub(crate) struct SmoothLight {
    pub(crate) values: Vec<Vec3>,
    /// Standard errors that are left, root mean square over the channels. Not what smoothing takes away from real detail.
    pub(crate) errors: Vec<f32>,
}

impl NoisyLight {
    pub(crate) fn new(extent: [u32; 2]) -> Self {
        let [width, height] = extent.map(|n| n as usize);
        let texels = width * height;
        let nothing = vec![Vec3::ZERO; texels];
        Self {
            width,
            height,
            valid: vec![0.0; texels],
            halves: [nothing.clone(), nothing.clone()],
            variances: vec![0.0; texels],
            positions: nothing.clone(),
            normals: nothing,
            sides: vec![0.0; texels],
        }
    }

    pub(crate) fn set(&mut self, texel: usize, estimate: &Estimate, point: &TexelPoint) {
        self.valid[texel] = 1.0;
        for (half, value) in self.halves.iter_mut().zip(estimate.halves) {
            half[texel] = value;
        }
        self.variances[texel] = estimate.variance;
        self.positions[texel] = point.position;
        self.normals[texel] = point.normal;
        let [u, v] = point.position_steps.map(Vec3::length);
        self.sides[texel] = u.max(v);
    }

    /// Values of texels, where there is an estimate.
    pub(crate) fn known(&self, values: Vec<Vec3>) -> Vec<Option<Vec3>> {
        values.into_iter().zip(&self.valid).map(|(value, &valid)| (valid != 0.0).then_some(value)).collect()
    }

    /// Takes the noise out. Ends early with the error of `check`.
    pub(crate) fn smoothed<E>(&self, check: impl Fn() -> Result<(), E>) -> Result<SmoothLight, E> {
        let texels = self.valid.len();
        let variances = self.means(&self.variances);
        let mut means = [vec![Plane::default(); texels], vec![Plane::default(); texels]];
        let mut pairs =
            Pairs { both: vec![0.0; texels], differences: [vec![0.0; texels], vec![0.0; texels]] };
        for dy in -REACH..=REACH {
            for dx in -REACH..=REACH {
                check()?;
                self.compare([dx, dy], &variances, &mut pairs);
                for y in 0..self.height {
                    let columns = self.columns(dx);
                    let Some(row) = self.shifted(y, dy) else { continue };
                    for x in columns {
                        let (p, q) = (y * self.width + x, row * self.width + (x as i32 + dx) as usize);
                        if pairs.both[p] == 0.0 {
                            continue;
                        }
                        let near = self.nearness(p, q, (dx * dx + dy * dy) as f32);
                        if near == 0.0 {
                            continue;
                        }
                        let alike = self.patch(&pairs, x, y).map(|difference| near * falloff(difference));
                        // Each half is averaged by what the other one says.
                        for half in 0..2 {
                            means[half][p].add([dx, dy], self.halves[half][q], alike[1 - half]);
                        }
                    }
                }
            }
        }
        let mut smooth = SmoothLight { values: vec![Vec3::ZERO; texels], errors: vec![0.0; texels] };
        for texel in (0..texels).filter(|&texel| self.valid[texel] != 0.0) {
            let [a, b] = [0, 1].map(|half| means[half][texel].value());
            smooth.values[texel] = 0.5 * (a + b);
            smooth.errors[texel] = 0.5 * ((a - b).length_squared() / 3.0).sqrt();
        }
        Ok(smooth)
    }

    /// The differences of all texels to those at an offset, in units of what noise explains, where both are there.
    fn compare(&self, [dx, dy]: [i32; 2], variances: &[f32], pairs: &mut Pairs) {
        pairs.both.fill(0.0);
        for y in 0..self.height {
            let Some(row) = self.shifted(y, dy) else { continue };
            for x in self.columns(dx) {
                let (p, q) = (y * self.width + x, row * self.width + (x as i32 + dx) as usize);
                let both = self.valid[p] * self.valid[q];
                pairs.both[p] = both;
                let (own, other) = (variances[p], variances[q]);
                let expected = own + own.min(other);
                for (half, differences) in self.halves.iter().zip(&mut pairs.differences) {
                    let (a, b) = (half[p], half[q]);
                    let small = SMALLEST * (a + b).element_sum() / 6.0;
                    let scale = TOLERANCE * TOLERANCE * (own + other) + small * small + f32::MIN_POSITIVE;
                    differences[p] = both * ((a - b).length_squared() / 3.0 - expected) / scale;
                }
            }
        }
    }

    /// The mean difference over the square around a texel, per half.
    fn patch(&self, pairs: &Pairs, x: usize, y: usize) -> [f32; 2] {
        let (mut sums, mut count) = ([0.0; 2], 0.0);
        for i in self.square(x, y, PATCH as usize) {
            count += pairs.both[i];
            sums[0] += pairs.both[i] * pairs.differences[0][i];
            sums[1] += pairs.both[i] * pairs.differences[1][i];
        }
        sums.map(|sum| sum / count)
    }

    /// 0 for texels that are not neighbours on the surface or face other ways, up to 1; `distance` is the square of that in texels.
    fn nearness(&self, p: usize, q: usize, distance: f32) -> f32 {
        let reach = 2.0 * self.sides[p].max(self.sides[q]);
        let is_apart =
            self.positions[p].distance_squared(self.positions[q]) > reach * reach * distance.max(0.01);
        if is_apart && p != q {
            return 0.0;
        }
        let facing = self.normals[p].dot(self.normals[q]).max(0.0);
        let [squared, reach] = [facing * facing, (REACH * REACH) as f32];
        // 0.4 of a radian away it is a quarter; in the corners of the square a third.
        squared.powi(8) / (1.0 + distance / reach)
    }

    /// Means over the squares around all texels.
    fn means(&self, values: &[f32]) -> Vec<f32> {
        let mut means = vec![0.0; values.len()];
        for y in 0..self.height {
            for x in 0..self.width {
                let (mut sum, mut count) = (0.0, 0.0);
                for i in self.square(x, y, 1) {
                    sum += self.valid[i] * values[i];
                    count += self.valid[i];
                }
                means[y * self.width + x] = if count > 0.0 { sum / count } else { 0.0 };
            }
        }
        means
    }

    /// The texels of a square around one, as far as there are any.
    fn square(&self, x: usize, y: usize, radius: usize) -> impl Iterator<Item = usize> {
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(self.width);
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(self.height);
        let width = self.width;
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    /// Those with a neighbour at an offset.
    fn columns(&self, dx: i32) -> std::ops::Range<usize> {
        let low = (-dx).max(0) as usize;
        let high = (self.width as i32 - dx.max(0)).max(0) as usize;
        low.min(high)..high
    }

    fn shifted(&self, y: usize, dy: i32) -> Option<usize> {
        Some(y.checked_add_signed(dy as isize)?).filter(|&row| row < self.height)
    }
}

/// Texels and those at an offset.
struct Pairs {
    /// 1 where both are there, else 0.
    both: Vec<f32>,
    /// Per half; only where both are there.
    differences: [Vec<f32>; 2],
}

/// Sums for the plane that is nearest to weighted values, by least squares: where light changes steadily, the mean of texels on one
/// side is none of the texel (B. Moon and others, "Adaptive Rendering Based on Weighted Local Regression", 2014).
#[derive(Clone, Copy, Default)]
struct Plane {
    weight: f32,
    first: Vec2,
    /// Of `x x`, `x y`, `y y`.
    second: Vec3,
    values: Vec3,
    values_x: Vec3,
    values_y: Vec3,
}

impl Plane {
    fn add(&mut self, offset: [i32; 2], value: Vec3, weight: f32) {
        let at = Vec2::from_array(offset.map(|n| n as f32));
        self.weight += weight;
        self.first += at * weight;
        self.second += Vec3::new(at.x * at.x, at.x * at.y, at.y * at.y) * weight;
        self.values += value * weight;
        self.values_x += value * (at.x * weight);
        self.values_y += value * (at.y * weight);
    }

    /// The plane's value in the middle. The texel itself has a weight of one.
    fn value(&self) -> Vec3 {
        let scale = self.weight.recip();
        let middle = self.first * scale;
        let mean = self.values * scale;
        let [xx, xy, yy] = [
            self.second.x * scale - middle.x * middle.x + FLATNESS,
            self.second.y * scale - middle.x * middle.y,
            self.second.z * scale - middle.y * middle.y + FLATNESS,
        ];
        let [x, y] = [self.values_x * scale - mean * middle.x, self.values_y * scale - mean * middle.y];
        // Positive, as slopes are kept flat.
        let determinant = xx * yy - xy * xy;
        let slopes = [(x * yy - y * xy) / determinant, (y * xx - x * xy) / determinant];
        mean - slopes[0] * middle.x - slopes[1] * middle.y
    }
}

/// `exp(-x)`, 1 below zero, by a power, so that all machines agree.
fn falloff(x: f32) -> f32 {
    let near = (1.0 - x.max(0.0) / 8.0).max(0.0);
    near.powi(8)
}

#[cfg(test)]
mod tests {
    use fantex_base::random::Random;
    use fantex_mesh::SurfacePoint;

    use super::*;
    use crate::light::unwatched;

    const WIDTH: u32 = 48;
    const HEIGHT: u32 = 40;

    /// A flat sheet with the light `light(x, y)` and noise of a standard deviation, from `origin` on.
    fn sheet(origin: [u32; 2], extent: [u32; 2], noise: f32, light: impl Fn(u32, u32) -> f32) -> NoisyLight {
        let mut noisy = NoisyLight::new(extent);
        for y in 0..extent[1] {
            for x in 0..extent[0] {
                let at = [origin[0] + x, origin[1] + y];
                let mut random = Random::new(u64::from(at[1] * WIDTH + at[0]));
                // Uniform in -1..1 has a variance of a third.
                let mut half = || {
                    let wrong = noise * 3.0_f32.sqrt() * (2.0 * random.unit() as f32 - 1.0);
                    Vec3::splat(light(at[0], at[1]) + wrong)
                };
                let estimate = Estimate { halves: [half(), half()], variance: noise * noise };
                let point = TexelPoint {
                    at: SurfacePoint { triangle: 0, lambda: Vec3::X },
                    lambda_steps: [Vec3::ZERO; 2],
                    position: Vec3::new(at[0] as f32, at[1] as f32, 0.0) * 0.01,
                    position_steps: [Vec3::X * 0.01, Vec3::Y * 0.01],
                    normal: Vec3::Z,
                };
                noisy.set((y * extent[0] + x) as usize, &estimate, &point);
            }
        }
        noisy
    }

    fn whole(noise: f32, light: impl Fn(u32, u32) -> f32) -> NoisyLight {
        sheet([0, 0], [WIDTH, HEIGHT], noise, light)
    }

    fn rms(values: impl Iterator<Item = f32>) -> f32 {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x * x, n + 1.0));
        (sum / count as f32).sqrt()
    }

    /// Errors of all texels.
    fn errors<'a>(
        smooth: &'a SmoothLight,
        light: impl Fn(u32, u32) -> f32 + 'a,
    ) -> impl Iterator<Item = f32> + 'a {
        (0..).zip(&smooth.values).map(move |(texel, value)| value.x - light(texel % WIDTH, texel / WIDTH))
    }

    #[test]
    fn noise_goes_edges_and_slopes_stay() {
        let step = |x: u32, _| if x < 20 { 0.2 } else { 0.8 };
        let slope = |x: u32, y: u32| 0.1 + 0.01 * x as f32 + 0.005 * y as f32;
        for (name, light) in [("step", &step as &dyn Fn(u32, u32) -> f32), ("slope", &slope)] {
            let smooth = whole(0.05, light).smoothed(unwatched).unwrap();
            // The mean of both halves has an error of 0.035.
            let error = rms(errors(&smooth, light));
            let told = rms(smooth.errors.iter().copied());
            assert!(error < 0.014, "{name}: {error}");
            assert!((0.5..2.0).contains(&(told / error)), "{name}: {told} {error}");
            let bias: f32 = errors(&smooth, light).sum::<f32>() / (WIDTH * HEIGHT) as f32;
            assert!(bias.abs() < 0.003, "{name}: {bias}");
        }
        let beside = whole(0.05, step).smoothed(unwatched).unwrap();
        let row: Vec<f32> = beside.values[..WIDTH as usize].iter().map(|v| v.x).collect();
        assert!((row[19] - 0.2).abs() < 0.06 && (row[20] - 0.8).abs() < 0.06, "{row:?}");
    }

    /// Units of light do not matter.
    #[test]
    fn dim_light_is_as_bright_light() {
        let step = |x: u32, _| if x < 20 { 0.2 } else { 0.8 };
        let dim = 2.0_f32.powi(-20);
        let bright = whole(0.05, step).smoothed(unwatched).unwrap();
        let faint = whole(0.05 * dim, |x, y| dim * step(x, y)).smoothed(unwatched).unwrap();
        for (bright, faint) in bright.values.iter().zip(&faint.values) {
            assert!((faint.x / dim - bright.x).abs() < 1e-5, "{faint} {bright}");
        }
    }

    #[test]
    fn what_has_no_noise_stays() {
        let checker = |x: u32, y: u32| if (x / 3 + y / 3).is_multiple_of(2) { 0.1 } else { 0.9 };
        let smooth = whole(0.0, checker).smoothed(unwatched).unwrap();
        assert!(errors(&smooth, checker).all(|error| error.abs() < 1e-6));
        assert!(smooth.errors.iter().all(|&error| error == 0.0));
    }

    /// Light of a side does not come from a side that faces another way, nor from across a gap.
    #[test]
    fn sides_and_parts_do_not_mix() {
        let dim = |x: u32, _| if x < 24 { 0.3 } else { 0.34 };
        for is_gap in [false, true] {
            let mut noisy = whole(0.1, dim);
            for texel in (0..noisy.valid.len()).filter(|texel| texel % WIDTH as usize >= 24) {
                if is_gap {
                    noisy.positions[texel] += Vec3::Z;
                } else {
                    noisy.normals[texel] = Vec3::X;
                }
            }
            let smooth = noisy.smoothed(unwatched).unwrap();
            let mut alone = whole(0.1, |_, _| 0.3);
            let left = |texel: &usize| texel % (WIDTH as usize) < 24;
            (0..alone.valid.len()).filter(|texel| !left(texel)).for_each(|texel| alone.valid[texel] = 0.0);
            let alone = alone.smoothed(unwatched).unwrap();
            // Only the variances are shared.
            let difference = (0..noisy.valid.len()).filter(left).map(|texel| {
                let [a, b] = [&smooth, &alone].map(|light| light.values[texel].x);
                (a - b).abs()
            });
            assert!(difference.fold(0.0, f32::max) < 0.02, "{is_gap}");
        }
    }

    /// A part with a margin gives what the whole gives.
    #[test]
    fn parts_agree_with_the_whole() {
        let light = |x: u32, y: u32| ((x * 7 + y * 3) % 13) as f32 * 0.05;
        let all = whole(0.08, light).smoothed(unwatched).unwrap();
        let (low, high) = ([10, 6], [40, 33]);
        let part = sheet(low, [high[0] - low[0], high[1] - low[1]], 0.08, light).smoothed(unwatched).unwrap();
        for y in low[1] + REACH_TEXELS..high[1] - REACH_TEXELS {
            for x in low[0] + REACH_TEXELS..high[0] - REACH_TEXELS {
                let own = part.values[((y - low[1]) * (high[0] - low[0]) + x - low[0]) as usize];
                assert_eq!(own, all.values[(y * WIDTH + x) as usize], "{x} {y}");
            }
        }
    }
}
