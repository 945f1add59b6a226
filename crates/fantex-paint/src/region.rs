//! The part of the surface within a distance of a point, measured along the surface.
//!
//! Distances of vertices are found by unfolding triangles one after the other: with the distances of an edge's ends, the
//! source is placed in the plane of the triangle beyond it, and the third vertex is as far as it is there, provided that
//! the line to it passes the edge (M. Novotni and R. Klein, "Computing geodesic distances on triangular meshes", 2002). Edges
//! are crossed in the order of their distance, and again where a shorter way is found.
//!
//! Within a triangle distances are interpolated so that a source in its unfolded plane gives exactly its circles:
//!
//! ```text
//!     D^2(l) = sum l_i d_i^2 - sum l_i l_j L_ij^2          (i < j; L_ij the length of an edge)
//! ```
//!
//! On an edge this depends on the edge's ends only, so the distance is continuous on the surface, on triangles larger than
//! the brush as well as on tiny ones. (It is Stewart's theorem along every line.) Only edges across which
//! triangles continue each other are crossed: the texture function is continuous just there. So paint reaches neither the back of a
//! sheet nor a neighbouring one, unless the way around is short. On request open edges are crossed, too, where another open edge is near
//! and its triangle leads on: the straight line through the gap counts.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap, HashSet};
use std::hash::{BuildHasherDefault, Hasher};

use fantex_cover::TexelTriangle;
use glam::{DVec2, DVec3, Vec2, Vec3};

use crate::{Surface, SurfacePoint};

/// A triangle that is reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionTriangle {
    /// Triangle index.
    pub triangle: u32,
    /// Squared distances of its corners, mesh units.
    corners: [f64; 3],
    /// Squared lengths of its edges 01, 12, 20.
    edges: [f64; 3],
}

/// Texels of triangles that are thinner than this are not bounded: twice the area over the sum of two squared sides.
const MIN_BOUNDED_SHAPE: f64 = 1e-3;

/// Texels of triangles that are smaller than such a part of a radius are not bounded: there are few of them.
const MIN_BOUNDED_SIZE: f64 = 0.25;

/// What squared distances are off by at most, relative to what they are sums of.
const SQUARE_ROUNDING: f64 = 1e-8;

/// What barycentric coordinates, which are single precision, are off by at most, relative to what they are sums of.
const LAMBDA_ROUNDING: f64 = 2e-5;

/// All texels of a tile, as lower and upper corner of a box.
pub(crate) const ALL_TEXELS: [Vec2; 2] = [Vec2::NEG_INFINITY, Vec2::INFINITY];

impl RegionTriangle {
    /// A triangle in a plane; its distances are those from the origin.
    pub(crate) fn in_plane(triangle: u32, corners: [Vec2; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| corner.as_dvec2());
        let edges = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
        Self { triangle, corners: [a, b, c].map(|corner| corner.length_squared()), edges }
    }

    /// Lower and upper corner of a box with all texels at which the [distance](Self::distance) is less than a radius, on the triangle and
    /// beside it; none where there are no such texels. `shown`: the triangle in a tile.
    ///
    /// In the plane of the triangle the squared distance is that from a point, and a constant: the texels are those of an ellipse.
    pub(crate) fn texels_within(&self, radius: f32, shown: &TexelTriangle) -> Option<[Vec2; 2]> {
        let ([a, b, c], [p, opposite, q], radius) = (self.corners, self.edges, f64::from(radius));
        // With coordinates y and z of the second and the third corner it is a + 2 (m y + n z) + p y^2 + 2 r y z + q z^2.
        let r = 0.5 * (p + q - opposite);
        let (m, n) = (0.5 * (b - a - p), 0.5 * (c - a - q));
        let determinant = p * q - r * r;
        let is_bounded = determinant > (MIN_BOUNDED_SHAPE * (p + q)).powi(2)
            && p + q > (MIN_BOUNDED_SIZE * radius).powi(2);
        if !is_bounded {
            return Some(ALL_TEXELS);
        }
        // Where it is least, and how much less it is there than at the first corner.
        let (y, z) = ((r * n - q * m) / determinant, (r * m - p * n) / determinant);
        let fall = -(m * y + n * z);
        let rounding = SQUARE_ROUNDING * (a + b + c + p + q + fall.abs()) + 1e-6 * radius * radius;
        let squared = radius * radius - (a - fall) + rounding;
        if squared < 0.0 {
            return None;
        }
        let [origin, f, g] = shown.corners().map(|corner| corner.as_dvec2());
        let (f, g) = (f - origin, g - origin);
        let longest = f.length().max(g.length()).max(f.distance(g));
        let margin = 1.0 + LAMBDA_ROUNDING * longest.powi(3) / f.perp_dot(g).abs();
        let half = (f * f * q - f * g * (2.0 * r) + g * g * p) * (squared / determinant);
        let half = DVec2::new(half.x.max(0.0).sqrt(), half.y.max(0.0).sqrt()) + margin;
        let middle = origin + f * y + g * z;
        let [low, high] = [middle - half, middle + half].map(|corner| corner.as_vec2());
        let is_finite = squared.is_finite() && low.is_finite() && high.is_finite();
        Some(if is_finite { [low, high] } else { ALL_TEXELS })
    }

    /// Distance along the surface from the centre, mesh units; also (continued) just beside the triangle.
    #[inline]
    pub fn distance(&self, lambda: Vec3) -> f32 {
        let (y, z) = (f64::from(lambda.y), f64::from(lambda.z));
        let x = 1.0 - y - z;
        let [a, b, c] = self.corners;
        let [ab, bc, ca] = self.edges;
        let squared = x * a + y * b + z * c - (x * y * ab + y * z * bc + z * x * ca);
        squared.max(0.0).sqrt() as f32
    }

    /// Distance of a corner, mesh units.
    pub(crate) fn corner_distance(&self, corner: usize) -> f64 {
        self.corners[corner].sqrt()
    }
}

/// All triangles within a distance of a point along the surface, ascending.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// Ascending by index.
    pub triangles: Vec<RegionTriangle>,
}

/// A shorter way must be shorter by this share: keeps rounding from going round in circles.
const GAIN: f64 = 1.0 - 1e-9;

/// Triangles that a region holds at most: a brush that covers more is cut off rather than freezing the stroke.
const MAX_TRIANGLES: usize = 1 << 22;

/// Triangles around a vertex that are visited at most; more change nothing but the time it takes.
const MAX_VALENCE: usize = 64;

/// Spreads indices over a table by multiplication (D. Knuth, "The Art of Computer Programming", volume 3, 6.4): the tables
/// here hold our own indices, whose order nobody chose to do harm, and are never iterated over unsorted.
#[derive(Default)]
pub(crate) struct IndexHasher(u64);

impl Hasher for IndexHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u32(u32::from(byte)));
    }

    fn write_u32(&mut self, index: u32) {
        self.0 = (self.0 ^ u64::from(index)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    }
}

pub(crate) type IndexHash = BuildHasherDefault<IndexHasher>;

/// An edge on the front, nearest first; ties by its number, so that the order is fixed.
type Front = BinaryHeap<Reverse<(u64, u32)>>;

/// Grows regions; keeps its working memory.
struct Grower<'a> {
    surface: &'a Surface,
    radius: f64,
    /// Widest gap that is crossed, mesh units; negative for none.
    gap: f64,
    distances: HashMap<u32, f64, IndexHash>,
    /// In the order in which they were reached.
    order: Vec<u32>,
    reached: HashSet<u32, IndexHash>,
    front: Front,
}

impl Region {
    /// The region of `radius` mesh units around a point.
    pub fn grow(surface: &Surface, center: SurfacePoint, radius: f32) -> Self {
        Self::grow_across(surface, center, radius, -1.0)
    }

    /// The same, which goes on beyond gaps up to `gap` mesh units wide (0: where open edges touch, as at T-junctions).
    pub fn grow_across(surface: &Surface, center: SurfacePoint, radius: f32, gap: f32) -> Self {
        let mut grower = Grower {
            surface,
            radius: f64::from(radius),
            gap: f64::from(gap),
            distances: HashMap::default(),
            order: Vec::new(),
            reached: HashSet::default(),
            front: Front::new(),
        };
        grower.start(center);
        while !grower.front.is_empty() {
            grower.run();
            grower.close();
        }
        grower.region()
    }

    /// The entry of a triangle.
    pub fn get(&self, triangle: u32) -> Option<&RegionTriangle> {
        let found = self.triangles.binary_search_by_key(&triangle, |t| t.triangle);
        found.ok().map(|i| &self.triangles[i])
    }
}

impl Grower<'_> {
    fn start(&mut self, center: SurfacePoint) {
        let position = self.surface.position(center);
        let vertices = self.surface.mesh().triangles[center.triangle as usize];
        for (vertex, corner) in vertices.into_iter().zip(self.surface.corners(center.triangle)) {
            self.distances.insert(vertex, corner.distance(position));
        }
        self.reached.insert(center.triangle);
        self.order.push(center.triangle);
        (0..3).for_each(|k| self.push(3 * center.triangle + k));
    }

    fn run(&mut self) {
        while let Some(Reverse((_, half_edge))) = self.front.pop() {
            let Some(other) = self.surface.opposite(half_edge) else {
                self.cross_gap(half_edge);
                continue;
            };
            let triangle = other / 3;
            let is_new = self.reached.insert(triangle);
            if is_new {
                self.order.push(triangle);
            }
            if self.reached.len() >= MAX_TRIANGLES {
                self.front.clear();
                return;
            }
            let is_nearer = self.reach(other);
            if is_nearer {
                self.push_around(3 * triangle + (other + 2) % 3);
            } else if is_new {
                (0..3).filter(|k| 3 * triangle + k != other).for_each(|k| self.push(3 * triangle + k));
            }
        }
    }

    /// Distances that were shortened last may bring further edges within reach.
    fn close(&mut self) {
        if self.reached.len() >= MAX_TRIANGLES {
            return;
        }
        let outward: Vec<u32> = self
            .order
            .iter()
            .flat_map(|t| (0..3).map(move |k| 3 * t + k))
            .filter(|&edge| self.surface.opposite(edge).is_some_and(|o| !self.reached.contains(&(o / 3))))
            .collect();
        outward.into_iter().for_each(|edge| self.push(edge));
    }

    /// The distance of the vertex opposite to a half-edge, through that edge. True where it is a shorter one.
    fn reach(&mut self, half_edge: u32) -> bool {
        let [a, b, c] = self.surface.turned(half_edge);
        let (Some(&da), Some(&db)) = (self.distances.get(&a.0), self.distances.get(&b.0)) else {
            return false;
        };
        let found = unfolded(da, db, [a.1, b.1, c.1]);
        let known = self.distances.entry(c.0).or_insert(f64::INFINITY);
        let is_nearer = found < *known * GAIN;
        if is_nearer {
            *known = found;
        }
        is_nearer
    }

    /// Goes on beyond an open edge, to the triangles at open edges near it.
    fn cross_gap(&mut self, half_edge: u32) {
        if self.gap < 0.0 {
            return;
        }
        let [a, b, _] = self.surface.turned(half_edge);
        let (Some(&da), Some(&db)) = (self.distances.get(&a.0), self.distances.get(&b.0)) else { return };
        for other in self.surface.open_edges_near(half_edge, self.gap) {
            let (triangle, [e, f, _]) = (other / 3, self.surface.turned(other));
            let known = [e, f].map(|(v, _)| self.distances.get(&v).copied().unwrap_or(f64::INFINITY));
            let found = [e, f].map(|(_, p)| unfolded(da, db, [a.1, b.1, p]));
            let nearest = nearest_on_edge(found[0].min(known[0]), found[1].min(known[1]), e.1.distance(f.1));
            if nearest >= self.radius || self.reached.len() >= MAX_TRIANGLES {
                continue;
            }
            if self.reached.insert(triangle) {
                self.order.push(triangle);
                (0..3).filter(|k| 3 * triangle + k != other).for_each(|k| self.push(3 * triangle + k));
            }
            for ((corner, (vertex, _)), (found, known)) in [other, 3 * triangle + (other + 1) % 3]
                .into_iter()
                .zip([e, f])
                .zip(found.into_iter().zip(known))
            {
                if found < known * GAIN {
                    self.distances.insert(vertex, found);
                    self.push_around(corner);
                }
            }
            if self.reach(other) {
                self.push_around(3 * triangle + (other + 2) % 3);
            }
        }
    }

    /// A vertex has come nearer, and with it all edges there: pushes them, seen from the reached triangles around it. `corner`
    /// is `3 * triangle + k` for one of these.
    fn push_around(&mut self, corner: u32) {
        let vertex = self.surface.mesh().triangles[corner as usize / 3][corner as usize % 3];
        self.push(corner);
        self.push(3 * (corner / 3) + (corner + 2) % 3);
        // Both ways around, in case there is a boundary.
        for first in [corner, 3 * (corner / 3) + (corner + 2) % 3] {
            let mut edge = first;
            for _ in 0..MAX_VALENCE {
                let Some(other) = self.surface.opposite(edge) else { break };
                let triangle = other / 3;
                if triangle == corner / 3 || !self.reached.contains(&triangle) {
                    break;
                }
                // The triangle's two edges at the vertex: the one that was crossed, and the one to go on through.
                let vertices = self.surface.mesh().triangles[triangle as usize];
                let Some(k) = vertices.iter().position(|&v| v == vertex) else { break };
                let at_vertex = [3 * triangle + k as u32, 3 * triangle + (k as u32 + 2) % 3];
                at_vertex.into_iter().for_each(|edge| self.push(edge));
                edge = if at_vertex[0] == other { at_vertex[1] } else { at_vertex[0] };
            }
        }
    }

    /// Puts a half-edge of a reached triangle on the front if the brush reaches it.
    fn push(&mut self, half_edge: u32) {
        let [a, b, _] = self.surface.turned(half_edge);
        let (Some(&da), Some(&db)) = (self.distances.get(&a.0), self.distances.get(&b.0)) else { return };
        let nearest = nearest_on_edge(da, db, a.1.distance(b.1));
        if nearest < self.radius {
            // Non-negative floats are ordered as their bits.
            self.front.push(Reverse((nearest.to_bits(), half_edge)));
        }
    }

    fn region(mut self) -> Region {
        self.order.sort_unstable();
        let entry = |&triangle: &u32| {
            let vertices = self.surface.mesh().triangles[triangle as usize];
            let [a, b, c] = self.surface.corners(triangle);
            RegionTriangle {
                triangle,
                corners: vertices.map(|v| self.distances.get(&v).map_or(f64::MAX.sqrt() / 4.0, |d| d * d)),
                edges: [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)],
            }
        };
        Region { triangles: self.order.iter().map(entry).collect() }
    }
}

/// Where the source lies in the plane of an edge from (0, 0) to (length, 0), at or below it.
fn virtual_source(da: f64, db: f64, length: f64) -> DVec2 {
    let x = (da * da - db * db + length * length) / (2.0 * length);
    DVec2::new(x, -(da * da - x * x).max(0.0).sqrt())
}

fn nearest_on_edge(da: f64, db: f64, length: f64) -> f64 {
    let source = virtual_source(da, db, length);
    (source.x.clamp(0.0, length) - source.x).hypot(source.y)
}

/// Distance of `c` through the edge `ab`.
fn unfolded(da: f64, db: f64, [a, b, c]: [DVec3; 3]) -> f64 {
    let length = a.distance(b);
    let source = virtual_source(da, db, length);
    let along = (c - a).dot(b - a) / length;
    let height = ((c - a).length_squared() - along * along).max(0.0).sqrt();
    let vertical = height - source.y;
    let crossing =
        if vertical > 0.0 { source.x + (along - source.x) * (-source.y / vertical) } else { along };
    if (0.0..=length).contains(&crossing) {
        (along - source.x).hypot(vertical)
    } else {
        (da + a.distance(c)).min(db + b.distance(c))
    }
}
