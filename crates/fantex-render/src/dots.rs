//! Triangles so small that one sample alone may see them.
//!
//! With one sample per pixel, triangles of about a pixel hold one sample at most in their bounding box. Whether it lies in the
//! triangle is decided when the triangle is set up, and what is left of the triangle then is a dot: a third as large as
//! a primitive, and nothing is worked out for it a second time when its tile is drawn.

use crate::fixed::{Edge, FixedPoint};
use crate::primitive::Primitive;
use crate::raster::NearnessPlane;

/// What one sample sees of a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Dot {
    /// Pixel index in the tile, row-major with stride [`TILE`](crate::primitive::TILE).
    pub(crate) pixel: u32,
    /// The mesh's triangle.
    pub(crate) triangle: u32,
    pub(crate) nearness: f32,
}

/// A pixel of the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) tile: u32,
    /// Its index in the tile.
    pub(crate) pixel: u32,
}

/// A dot and the tile that it lies in.
pub(crate) type PlacedDot = (u32, Dot);

impl Place {
    /// What this pixel's sample, which lies at `position`, sees of a primitive.
    pub(crate) fn dot(self, primitive: &Primitive, position: FixedPoint) -> Option<PlacedDot> {
        let [a, b, c] = primitive.corners;
        let [x, y] = position.map(i64::from);
        let [ab, bc, ca] = [Edge::new(a, b), Edge::new(b, c), Edge::new(c, a)].map(|edge| edge.at(x, y));
        // Covered where no sign bit is set.
        (ab | bc | ca >= 0).then(|| {
            let nearness = NearnessPlane::new(primitive).at(position);
            (self.tile, Dot { pixel: self.pixel, triangle: primitive.triangle, nearness })
        })
    }
}

/// Dots by tiles.
#[derive(Debug, Default)]
pub(crate) struct Dots {
    /// Tile `t` owns `dots[starts[t]..starts[t + 1]]`; empty without dots.
    starts: Vec<u32>,
    dots: Vec<Dot>,
}

impl Dots {
    /// Sorts dots into so many tiles.
    pub(crate) fn new(placed: &[PlacedDot], tiles: usize) -> Self {
        if placed.is_empty() {
            return Self::default();
        }
        let mut starts = vec![0; tiles + 1];
        placed.iter().for_each(|(tile, _)| starts[*tile as usize + 1] += 1);
        for tile in 0..tiles {
            starts[tile + 1] += starts[tile];
        }
        let mut next = starts.clone();
        let mut dots = vec![Dot::default(); placed.len()];
        for &(tile, dot) in placed {
            let place = &mut next[tile as usize];
            dots[*place as usize] = dot;
            *place += 1;
        }
        Self { starts, dots }
    }

    /// Those of a tile.
    pub(crate) fn in_tile(&self, tile: usize) -> &[Dot] {
        match self.starts[..] {
            [] => &[],
            _ => &self.dots[self.starts[tile] as usize..self.starts[tile + 1] as usize],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tile_has_its_own_dots_in_order() {
        let dot = |triangle| Dot { pixel: 7, triangle, nearness: 1.0 };
        let placed = [(2, dot(0)), (0, dot(1)), (2, dot(2)), (3, dot(3)), (0, dot(4))];
        let dots = Dots::new(&placed, 5);
        let triangles = |tile| dots.in_tile(tile).iter().map(|d| d.triangle).collect::<Vec<_>>();
        assert_eq!(
            (0..5).map(triangles).collect::<Vec<_>>(),
            [vec![1, 4], vec![], vec![0, 2], vec![3], vec![]]
        );
        assert!(Dots::new(&[], 5).in_tile(4).is_empty());
    }

    #[test]
    fn a_dot_is_seen_where_the_triangle_covers_the_sample() {
        let primitive = Primitive {
            corners: [[100, 100], [300, 100], [100, 300]],
            nearness: [1.0, 2.0, 3.0],
            triangle: 5,
            layered: false,
        };
        let place = Place { tile: 3, pixel: 9 };
        let (tile, dot) = place.dot(&primitive, [200, 150]).unwrap();
        assert_eq!((tile, dot.pixel, dot.triangle), (3, 9, 5));
        assert!((dot.nearness - 2.0).abs() < 1e-6, "{dot:?}");
        assert_eq!(place.dot(&primitive, [250, 260]), None);
    }
}
