//! Directions chosen by the sky's brightness, so that a small sun is found on purpose and not by chance.
//!
//! The sphere of directions is laid out on a square such that equal areas are equal solid angles (P. Clarberg, "Fast Equal-Area
//! Mapping of the (Hemi)Sphere using SIMD", 2008), and cut into cells. Cells are chosen by the brightness in them, places
//! within a cell evenly: first a row, then a column, both by inverting cumulative sums, which keeps points that fill the square
//! evenly even.
//!
//! Directions by the cosine are followed anyway, as paths go on along them, and both kinds are weighed against each other by
//! the balance heuristic (E. Veach and L. Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995).
//! What both find need not be sought twice: of every cell's brightness the mean is left to the cosine (O. Karlík et al.,
//! "MIS Compensation: Optimizing Sampling Techniques in Multiple Importance Sampling", 2019). A sky that is alike everywhere has
//! no table, and costs nothing.

use std::f32::consts::{FRAC_2_PI, FRAC_PI_4, PI};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::light::Sky;

/// Cells along a side: each is 0.4 degrees wide, less than the sun.
const SIDE: usize = 512;
/// Looks into a cell along each of its sides.
const LOOKS: usize = 2;
/// A table is made where brightness varies more than this: mean square over squared mean, less one. A sky that grows
/// linearly from dark at the nadir to bright at the zenith has a third.
const MIN_CONTRAST: f64 = 1.0;

#[derive(Debug)]
pub(crate) struct SkyTable {
    /// Sums of the rows' shares, from 0 to 1.
    rows: Vec<f32>,
    /// For each row sums of its cells' shares in it, from 0 to 1.
    cells: Vec<f32>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct SkySample {
    /// Unit vector.
    pub(crate) direction: Vec3,
    /// Per steradian.
    pub(crate) density: f32,
}

impl SkyTable {
    /// Looks at the sky; `None` where its brightness varies too little for choices to pay.
    pub(crate) fn new(sky: &dyn Sky) -> Option<Self> {
        let brightness: Vec<f64> = (0..SIDE * SIDE)
            .into_par_iter()
            .with_min_len(SIDE)
            .map(|cell| brightness(sky, cell % SIDE, cell / SIDE))
            .collect();
        let count = brightness.len() as f64;
        let mean = brightness.iter().sum::<f64>() / count;
        let mean_square = brightness.iter().map(|b| b * b).sum::<f64>() / count;
        let contrast = mean_square / (mean * mean) - 1.0;
        // Comparisons with NaN, the contrast of darkness, are false.
        let is_worth_it = contrast > MIN_CONTRAST;
        is_worth_it.then(|| Self::of_weights(spread(&brightness).map(|b| (b - mean).max(0.0)).collect()))
    }

    /// By weights of the cells, row by row, that are not all zero.
    fn of_weights(weights: Vec<f64>) -> Self {
        let rows: Vec<f64> = weights.chunks_exact(SIDE).map(|row| row.iter().sum()).collect();
        let cells = weights.chunks_exact(SIDE).flat_map(cumulative).collect();
        Self { rows: cumulative(&rows), cells }
    }

    /// The direction of a point of the unit square.
    pub(crate) fn sample(&self, [u, v]: [f32; 2]) -> SkySample {
        let (row, y) = place(&self.rows, v);
        let (column, x) = place(self.row(row), u);
        let place = Vec2::new(column as f32 + x, row as f32 + y) / SIDE as f32;
        SkySample { direction: direction(place), density: self.density_in(row, column) }
    }

    /// How densely directions are chosen around a unit vector, per steradian.
    pub(crate) fn density(&self, direction: Vec3) -> f32 {
        let cell = (square(direction) * SIDE as f32).as_uvec2().min(glam::UVec2::splat(SIDE as u32 - 1));
        self.density_in(cell.y as usize, cell.x as usize)
    }

    fn row(&self, row: usize) -> &[f32] {
        &self.cells[row * (SIDE + 1)..(row + 1) * (SIDE + 1)]
    }

    fn density_in(&self, row: usize, column: usize) -> f32 {
        let share = |sums: &[f32], index: usize| sums[index + 1] - sums[index];
        let cells_per_steradian = (SIDE * SIDE) as f32 / (4.0 * PI);
        share(&self.rows, row) * share(self.row(row), column) * cells_per_steradian
    }
}

/// A bound of what a white surface reflects of a sky: neither more than its brightest direction, nor than if all of it shone straight ahead.
pub(crate) fn most_reflected(sky: &dyn Sky) -> Vec3 {
    let row = |row: usize| {
        let looks = (0..SIDE).map(|column| {
            let place = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) / SIDE as f32;
            let radiance = sky.radiance(direction(place));
            if radiance.is_finite() { radiance.max(Vec3::ZERO) } else { Vec3::ZERO }
        });
        looks.fold((Vec3::ZERO, Vec3::ZERO), |(most, sum), radiance| (most.max(radiance), sum + radiance))
    };
    // Summed in order: the same on any number of threads.
    let rows: Vec<(Vec3, Vec3)> = (0..SIDE).into_par_iter().map(row).collect();
    let most = rows.iter().fold(Vec3::ZERO, |most, row| most.max(row.0));
    let mean = rows.iter().map(|row| row.1).sum::<Vec3>() / (SIDE * SIDE) as f32;
    most.min(4.0 * mean)
}

fn brightness(sky: &dyn Sky, column: usize, row: usize) -> f64 {
    let looks = (0..LOOKS * LOOKS).map(|look| {
        let within = Vec2::new((look % LOOKS) as f32 + 0.5, (look / LOOKS) as f32 + 0.5) / LOOKS as f32;
        let place = (Vec2::new(column as f32, row as f32) + within) / SIDE as f32;
        let brightness = f64::from(sky.radiance(direction(place)).element_sum()) / 3.0;
        if brightness.is_finite() { brightness.max(0.0) } else { 0.0 }
    });
    looks.sum::<f64>() / (LOOKS * LOOKS) as f64
}

/// Brightness of which a part is that of the neighbours. Looks may miss the edge of a sun in a cell; were its density 0, the few
/// paths that find it by chance would be far too bright.
fn spread(brightness: &[f64]) -> impl Iterator<Item = f64> {
    const WEIGHTS: [[f64; 3]; 3] =
        [[0.03125, 0.0625, 0.03125], [0.0625, 0.625, 0.0625], [0.03125, 0.0625, 0.03125]];
    (0..SIDE * SIDE).map(|cell| {
        let around = WEIGHTS.as_flattened().iter().enumerate().map(|(place, weight)| {
            let column = (cell % SIDE + place % 3).checked_sub(1);
            weight * brightness[neighbor(column, (cell / SIDE + place / 3).checked_sub(1))]
        });
        around.sum()
    })
}

/// The cell at a column and row of which one may be just beside the square: opposite halves of each side are one edge.
fn neighbor(column: Option<usize>, row: Option<usize>) -> usize {
    let inside = |place: Option<usize>| place.filter(|&place| place < SIDE);
    let nearest = |place: Option<usize>| place.map_or(0, |place| place.min(SIDE - 1));
    let (mut x, mut y) = (nearest(column), nearest(row));
    if inside(column).is_none() {
        y = SIDE - 1 - y;
    }
    if inside(row).is_none() {
        x = SIDE - 1 - x;
    }
    y * SIDE + x
}

/// Sums of the first 0, 1, 2 ... shares, the last of which is 1. Equal shares where there is no weight.
fn cumulative(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let mut sums = vec![0.0];
    for (index, weight) in weights.iter().enumerate() {
        sum += weight;
        let share = if total > 0.0 { sum / total } else { (index + 1) as f64 / weights.len() as f64 };
        sums.push(share.min(1.0) as f32);
    }
    sums[weights.len()] = 1.0;
    sums
}

/// The share within which a number of 0..1 lies, and where in it.
fn place(sums: &[f32], number: f32) -> (usize, f32) {
    let index = sums.partition_point(|&sum| sum <= number).clamp(1, sums.len() - 1) - 1;
    let (start, end) = (sums[index], sums[index + 1]);
    (index, ((number - start) / (end - start).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0))
}

/// From the unit square to unit vectors: its middle is `+z`, the corners are `-z`.
fn direction(place: Vec2) -> Vec3 {
    let p = 2.0 * place - 1.0;
    let (u, v) = (p.x.abs(), p.y.abs());
    // Squares around the middle become circles of latitude, the diagonal the equator.
    let inside = 1.0 - (u + v);
    let radius = 1.0 - inside.abs();
    let angle = if radius > 0.0 { ((v - u) / radius + 1.0) * FRAC_PI_4 } else { 0.0 };
    let (sin, cos) = angle.sin_cos();
    let z = (1.0 - radius * radius).copysign(inside);
    let across = radius * (2.0 - radius * radius).max(0.0).sqrt();
    Vec3::new((across * cos).copysign(p.x), (across * sin).copysign(p.y), z).normalize()
}

fn square(direction: Vec3) -> Vec2 {
    let Vec3 { x, y, z } = direction;
    let radius = (1.0 - z.abs()).max(0.0).sqrt();
    let turn = y.abs().atan2(x.abs()) * FRAC_2_PI;
    let (u, v) = (radius * (1.0 - turn), radius * turn);
    let (u, v) = if z < 0.0 { (1.0 - v, 1.0 - u) } else { (u, v) };
    (Vec2::new(u.copysign(x), v.copysign(y)) + 1.0) * 0.5
}

#[cfg(test)]
mod tests {
    use crate::light::tracer::Sequence;

    use super::*;

    /// A dim sky with a sun of this radius, in radians.
    fn sunny(radius: f32) -> impl Fn(Vec3) -> Vec3 + Sync {
        let to_sun = Vec3::new(0.3, 0.8, -0.4).normalize();
        move |d: Vec3| if d.dot(to_sun) > radius.cos() { Vec3::splat(2e4) } else { Vec3::splat(0.3) }
    }

    #[test]
    fn squares_and_directions_are_inverse() {
        for row in 0..64 {
            for column in 0..64 {
                let place = (Vec2::new(column as f32, row as f32) + 0.37) / 64.0;
                let back = square(direction(place));
                assert!(direction(place).is_normalized() && (back - place).length() < 1e-4, "{place} {back}");
            }
        }
        for axis in Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]) {
            assert!((direction(square(axis)) - axis).length() < 1e-3, "{axis}");
        }
    }

    /// Even points of the square are even on the sphere: the mean is the middle, the mean square of each coordinate a third.
    #[test]
    fn equal_areas_are_equal_solid_angles() {
        let (mut mean, mut square, count) = (Vec3::ZERO, Vec3::ZERO, 256 * 256);
        for i in 0..count {
            let place = (Vec2::new((i % 256) as f32, (i / 256) as f32) + 0.5) / 256.0;
            let d = direction(place);
            (mean, square) = (mean + d / count as f32, square + d * d / count as f32);
        }
        assert!(mean.length() < 1e-4 && (square - 1.0 / 3.0).length() < 1e-4, "{mean} {square}");
    }

    #[test]
    fn neighbors_touch_across_the_edges_of_the_square() {
        let middle = |cell: usize| {
            let place = Vec2::new((cell % SIDE) as f32 + 0.5, (cell / SIDE) as f32 + 0.5);
            direction(place / SIDE as f32)
        };
        let width = (4.0 * PI).sqrt() / SIDE as f32;
        for k in (0..SIDE).step_by(7) {
            for (column, row) in [(k, 0), (k, SIDE - 1), (0, k), (SIDE - 1, k)] {
                let own = middle(row * SIDE + column);
                for place in 0..9 {
                    let [x, y] = [column + place % 3, row + place / 3].map(|n| n.checked_sub(1));
                    let distance = (middle(neighbor(x, y)) - own).length();
                    assert!(distance < 3.0 * width, "{column} {row}, {place}: {distance}");
                }
            }
        }
    }

    #[test]
    fn densities_are_those_of_the_samples_and_add_up_to_one() {
        let table = SkyTable::new(&sunny(0.05)).unwrap();
        let total: f64 =
            (0..SIDE * SIDE).map(|cell| f64::from(table.density_in(cell / SIDE, cell % SIDE))).sum::<f64>()
                * (4.0 * std::f64::consts::PI)
                / (SIDE * SIDE) as f64;
        assert!((total - 1.0).abs() < 1e-3, "{total}");
        let (sequence, mut equal) = (Sequence::new(3), 0);
        for index in 0..1024 {
            let sample = table.sample(sequence.pair(index, 0));
            assert!(sample.density > 0.0 && sample.direction.is_normalized());
            equal += u32::from(table.density(sample.direction) == sample.density);
        }
        // Rounding moves a few of them over the border of their cell.
        assert!(equal > 1000, "{equal}");
    }

    #[test]
    fn the_sun_is_found() {
        // As large as the real one.
        let sky = sunny(0.0047);
        let table = SkyTable::new(&sky).unwrap();
        let sequence = Sequence::new(4);
        let hits = (0..1024).filter(|&i| sky(table.sample(sequence.pair(i, 0)).direction).x > 1.0).count();
        assert!(hits > 250, "{hits}");
    }

    #[test]
    fn tables_do_not_depend_on_the_number_of_threads() {
        let sky = sunny(0.05);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let table = pool.install(|| SkyTable::new(&sky)).unwrap();
            let bits = |sums: &[f32]| sums.iter().map(|sum| sum.to_bits()).collect::<Vec<_>>();
            (bits(&table.rows), bits(&table.cells))
        };
        let one = on(1);
        assert!(one == on(2) && one == on(7));
    }

    #[test]
    fn even_skies_and_darkness_have_no_table() {
        let skies: [&dyn Sky; 4] =
            [&|_: Vec3| Vec3::ZERO, &|_: Vec3| Vec3::ONE, &|d: Vec3| Vec3::splat(1.0 + d.y), &|_: Vec3| {
                Vec3::NAN
            }];
        assert!(skies.into_iter().all(|sky| SkyTable::new(sky).is_none()));
    }
}
