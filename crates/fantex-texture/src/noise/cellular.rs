//! Cellular noise: S. Worley, "A cellular texture basis function", 1996. One point is scattered in every unit cell; the noise is
//! made of the distances to the nearest ones.

use super::hash::{absorb, cell_and_offset, cell_hash, finish, unit};

/// How distances are measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    fn distance<const D: usize>(self, offset: [f32; D]) -> f32 {
        let magnitudes = offset.map(f32::abs);
        match self {
            Self::Euclidean => magnitudes.iter().map(|x| x * x).sum::<f32>().sqrt(),
            Self::Manhattan => magnitudes.iter().sum(),
            Self::Chebyshev => magnitudes.iter().fold(0.0, |most, &x| most.max(x)),
        }
    }
}

/// What is known about the scattered points near a place.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    for ring in 0.. {
        if found.second <= ring as f32 - 1.0 + margin || ring > 4 {
            break;
        }
        for_each_of_ring::<D>(ring, |step| {
            let hash = cell_hash::<D>(seed, std::array::from_fn(|d| cell[d].wrapping_add(step[d])));
            let to_point =
                std::array::from_fn(|d| step[d] as f32 + unit(finish(absorb(hash, d as i32))) - offset[d]);
            let distance = metric.distance::<D>(to_point);
            if distance < found.nearest {
                found = Cellular { nearest: distance, second: found.nearest, id: unit(hash) };
            } else if distance < found.second {
                found.second = distance;
            }
        });
    }
    found
}

/// The cells whose farthest coordinate is `ring` steps away.
fn for_each_of_ring<const D: usize>(ring: i32, mut visit: impl FnMut([i32; D])) {
    let side = 2 * ring + 1;
    for index in 0..side.pow(D as u32) {
        let mut rest = index;
        let step: [i32; D] = std::array::from_fn(|_| {
            let coordinate = rest % side - ring;
            rest /= side;
            coordinate
        });
        if step.iter().any(|c| c.abs() == ring) {
            visit(step);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests_common::points;
    use super::*;

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
                distances.push(metric.distance(to_point));
            });
        }
        distances.sort_by(f32::total_cmp);
        [distances[0], distances[1]]
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

    #[test]
    fn distances_are_ordered_and_change_gently() {
        for p in points::<4>(300) {
            let here = cellular(1, p, CellularMetric::Euclidean);
            let there = cellular(1, [p[0] + 1e-3, p[1], p[2], p[3]], CellularMetric::Euclidean);
            assert!(here.nearest <= here.second && here.nearest < 2.0);
            assert!((here.nearest - there.nearest).abs() < 1.1e-3);
        }
    }
}
