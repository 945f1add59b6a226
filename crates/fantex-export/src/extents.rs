//! How far pieces reach.

use std::sync::LazyLock;

use fantex_mesh::unit_vector;
use glam::Vec2;

/// How far a piece reaches along directions all around, as pieces lie in any way.
#[derive(Clone, Copy)]
pub(crate) struct Extents {
    low: [f32; DIRECTIONS],
    high: [f32; DIRECTIONS],
}

/// Half a turn of directions.
const DIRECTIONS: usize = 16;

/// A piece lies up to half a step between directions off the nearest one: it seems so much longer at most when it grows as wide as it is long.
pub(crate) const LENGTHENED: f32 = 1.1;

impl Default for Extents {
    fn default() -> Self {
        Self { low: [f32::INFINITY; DIRECTIONS], high: [f32::NEG_INFINITY; DIRECTIONS] }
    }
}

impl Extents {
    pub(crate) fn add(&mut self, p: Vec2) {
        static AXES: LazyLock<[Vec2; DIRECTIONS]> = LazyLock::new(|| {
            std::array::from_fn(|i| unit_vector(i as f32 * std::f32::consts::PI / DIRECTIONS as f32))
        });
        for ((low, high), axis) in self.low.iter_mut().zip(&mut self.high).zip(AXES.iter()) {
            let along = p.dot(*axis);
            (*low, *high) = (low.min(along), high.max(along));
        }
    }

    /// The side of the smallest square around the piece, nearly.
    pub(crate) fn length(&self) -> f32 {
        let along = |i: usize| self.high[i] - self.low[i];
        let squares = (0..DIRECTIONS / 2).map(|i| along(i).max(along(i + DIRECTIONS / 2)));
        squares.fold(f32::INFINITY, f32::min)
    }

    /// The longer side of the smallest rectangle around the piece, nearly. (A thin piece lies along the diagonal of its smallest square.)
    pub(crate) fn longer_side(&self) -> f32 {
        let along = |i: usize| self.high[i] - self.low[i];
        let rectangles = (0..DIRECTIONS / 2).map(|i| [along(i), along(i + DIRECTIONS / 2)]);
        let smallest = rectangles.min_by(|[a, b], [c, d]| (a * b).total_cmp(&(c * d)));
        smallest.map_or(0.0, |[a, b]| a.max(b))
    }
}
