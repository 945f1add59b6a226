//! Flat coordinates around a point of the surface, for pictures that lie on it.
//!
//! Triangles are unfolded into the tangent plane of the centre one after the other, each over the edge through which it is
//! reached first, and every vertex is moved to its distance along the surface: a discrete exponential map as in R. Schmidt, C.
//! Grimm and B. Wyvill, "Interactive decal compositing with discrete exponential maps" (2006), by unfolded edges instead of
//! rotated frames. Exact where the surface can be rolled out. Coordinates belong to vertices and are linear within
//! triangles, so they are continuous across the edges of the region, and the same in every tile.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::region::{IndexHash, Region};
use crate::{Surface, SurfacePoint};

/// Coordinates of a region's triangles, mesh units from the centre.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// Per triangle of the region its corners' places; none where the map is torn.
    corners: Vec<Option<[Vec2; 3]>>,
}

/// A triangle whose sides are stretched by more than this lies on a tear.
const MOST_STRETCH: f32 = 3.0;

/// Grows a chart.
struct Unfolder<'a> {
    surface: &'a Surface,
    places: HashMap<u32, DVec2, IndexHash>,
    /// Edges nearest first; ties by number, so that the order is fixed.
    front: BinaryHeap<Reverse<(u64, u32)>>,
}

impl Chart {
    /// The chart of a region that was grown around `center`. `axes`: orthonormal, in the plane of the centre's triangle.
    pub(crate) fn unfold(surface: &Surface, region: &Region, center: SurfacePoint, axes: [DVec3; 2]) -> Self {
        let mut unfolder = Unfolder { surface, places: HashMap::default(), front: BinaryHeap::new() };
        unfolder.start(center, axes);
        while let Some(Reverse((_, half_edge))) = unfolder.front.pop() {
            unfolder.cross(half_edge, region);
        }
        let corners = region.triangles.iter().map(|entry| unfolder.corners(entry.triangle));
        Self { corners: corners.collect() }
    }

    /// Where a point of the region's triangle number `index` lies.
    #[inline]
    pub(crate) fn at(&self, index: usize, lambda: Vec3) -> Option<Vec2> {
        self.corners[index].map(|[a, b, c]| a * lambda.x + b * lambda.y + c * lambda.z)
    }

    /// Corners of the region's triangle number `index`.
    pub(crate) fn triangle(&self, index: usize) -> Option<[Vec2; 3]> {
        self.corners[index]
    }
}

impl Unfolder<'_> {
    fn start(&mut self, center: SurfacePoint, [x, y]: [DVec3; 2]) {
        let origin = self.surface.position(center);
        let vertices = self.surface.mesh().triangles[center.triangle as usize];
        for (vertex, corner) in vertices.into_iter().zip(self.surface.corners(center.triangle)) {
            let q = corner - origin;
            self.places.insert(vertex, DVec2::new(q.dot(x), q.dot(y)));
        }
        (0..3).for_each(|k| self.push(3 * center.triangle + k));
    }

    fn push(&mut self, half_edge: u32) {
        let [a, b, _] = self.vertices(half_edge);
        if let (Some(a), Some(b)) = (self.places.get(&a), self.places.get(&b)) {
            let nearest = segment_distance(*a, *b);
            self.front.push(Reverse((nearest.to_bits(), half_edge)));
        }
    }

    /// Unfolds the triangle beyond an edge, if its third vertex has no place yet.
    fn cross(&mut self, half_edge: u32, region: &Region) {
        let Some(other) = self.surface.opposite(half_edge) else { return };
        let Some(entry) = region.get(other / 3) else { return };
        let [a, b, apex] = self.vertices(other);
        let [_, _, behind] = self.vertices(half_edge);
        if self.places.contains_key(&apex) {
            return;
        }
        let Some([pa, pb, pc]) = self.places_of([a, b, behind]) else { return };
        let [qa, qb, qc] = self.positions(other);
        let length = qa.distance(qb);
        let Some(along_axis) = (pb - pa).try_normalize().filter(|_| length > 0.0) else { return };
        let along = (qc - qa).dot(qb - qa) / length;
        let height = ((qc - qa).length_squared() - along * along).max(0.0).sqrt();
        let side = along_axis.perp().dot(pc - pa);
        let up = if side > 0.0 { -along_axis.perp() } else { along_axis.perp() };
        let place = 0.5 * (pa + pb) + along_axis * (along - 0.5 * length) + up * height;
        let distance = entry.corner_distance((other as usize + 2) % 3);
        let scale = distance / place.length();
        let place = if scale.is_finite() && (0.3..3.0).contains(&scale) { place * scale } else { place };
        self.places.insert(apex, place);
        let triangle = other / 3;
        (0..3).map(|k| 3 * triangle + k).filter(|edge| *edge != other).for_each(|edge| self.push(edge));
    }

    fn places_of(&self, vertices: [u32; 3]) -> Option<[DVec2; 3]> {
        let [a, b, c] = vertices.map(|v| self.places.get(&v).copied());
        Some([a?, b?, c?])
    }

    /// Vertices of a triangle: the half-edge's start and end, and the corner opposite to it.
    fn vertices(&self, half_edge: u32) -> [u32; 3] {
        let vertices = self.surface.mesh().triangles[half_edge as usize / 3];
        [0, 1, 2].map(|i| vertices[(half_edge as usize + i) % 3])
    }

    fn positions(&self, half_edge: u32) -> [DVec3; 3] {
        let corners = self.surface.corners(half_edge / 3);
        [0, 1, 2].map(|i| corners[(half_edge as usize + i) % 3])
    }

    fn corners(&self, triangle: u32) -> Option<[Vec2; 3]> {
        let vertices = self.surface.mesh().triangles[triangle as usize];
        let places = self.places_of(vertices)?.map(|p| p.as_vec2());
        let corners = self.surface.corners(triangle).map(|p| p.as_vec3());
        let is_whole = (0..3).all(|k| {
            let flat = places[k].distance(places[(k + 1) % 3]);
            flat <= MOST_STRETCH * corners[k].distance(corners[(k + 1) % 3]).max(1e-9)
        });
        is_whole.then_some(places)
    }
}

/// Distance of the origin from a segment.
fn segment_distance(a: DVec2, b: DVec2) -> f64 {
    let edge = b - a;
    let t = (-a.dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (a + edge * t).length()
}
