//! Rays against a mesh, and the point of a mesh nearest to a given one.
//!
//! The hierarchy of boxes, eight to a node (H. Ylitie, T. Karras and S. Laine, "Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs", 2017), comes from the crate `obvhs`. On 1.3 M triangles and random rays it is 1.4 times as
//! fast as the same crate's binary tree, and half its size. It is built on one thread, so that the same mesh
//! always gives the same tree. Triangles are tested by the watertight method of [`intersect`]. Everything is in mesh space.
//!
//! # Rays that start on the surface
//!
//! A point that was interpolated on a triangle lies beside its plane by a few units in the last place. A ray that starts
//! there must not see the triangle it comes from, so its origin is moved by [`SURFACE_OFFSET`] along the geometric normal
//! to the side it shall be on ([`origin_beside`]). Coordinates lie within -1..1, where single precision is exact to 2^-24:
//! the offset is 32 times that, large enough for every point and direction, and far below any detail of a mesh. Triangles
//! are not told apart by their indices, so that a ray from a point on an edge does not see the neighbour, either.

use glam::{DVec2, DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray, RayHit as TreeHit};
use rayon::prelude::*;

use crate::{Mesh, SurfacePoint, interpolate};

/// How far the origin of a ray that starts on the surface is moved off it, mesh units.
pub const SURFACE_OFFSET: f32 = 1.0 / (1 << 19) as f32;

/// Boxes are this much larger than their triangles on every side, so that rounding in the test of a box never loses a
/// triangle for origins up to four units away.
const BOX_MARGIN: f32 = 1.0 / (1 << 19) as f32;

/// The tree sees directions this long. It passes over boxes that end before 1e-4 of the direction's length, which must be
/// less than the rounding of a coordinate.
const TREE_DIRECTION: f32 = 1.0 / (1 << 12) as f32;

/// Where a ray meets a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Where on the surface.
    pub point: SurfacePoint,
    /// From the origin, in units of the direction's length.
    pub distance: f32,
    /// True where the ray meets the front of the triangle, whose corners run counter-clockwise there.
    pub front: bool,
}

/// A tree of boxes around the triangles of a mesh, for rays and nearest points. It keeps its own copy of the positions:
/// about 70 bytes per triangle.
pub struct TriangleBvh {
    tree: CwBvh,
    /// Corners of the triangles, in the tree's order.
    corners: Vec<[Vec3; 3]>,
    triangles: Vec<u32>,
}

impl std::fmt::Debug for TriangleBvh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TriangleBvh").field("triangles", &self.triangles.len()).finish_non_exhaustive()
    }
}

impl TriangleBvh {
    /// Builds the tree of a mesh, on one thread (about two seconds for a million triangles).
    pub fn new(mesh: &Mesh) -> Self {
        let margin = Vec3A::splat(BOX_MARGIN);
        let padded = |t: usize| {
            let [a, b, c] = mesh.triangle_positions(t).map(Vec3A::from);
            Aabb::new(a.min(b).min(c) - margin, a.max(b).max(c) + margin)
        };
        let boxes: Vec<Aabb> =
            (0..mesh.triangles.len()).into_par_iter().with_min_len(1 << 12).map(padded).collect();
        if boxes.is_empty() {
            return Self { tree: CwBvh::default(), corners: Vec::new(), triangles: Vec::new() };
        }
        let mut tree = build(&boxes);
        let triangles = std::mem::take(&mut tree.primitive_indices);
        let corners = triangles.iter().map(|&t| mesh.triangle_positions(t as usize)).collect();
        Self { tree, corners, triangles }
    }

    /// The first triangle on a ray, from either side, nearer than `max_distance` (which may be infinite).
    ///
    /// Distances count in units of the direction's length. There is no hit behind the origin, and none along a direction
    /// that is zero or not finite.
    pub fn first_hit(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> Option<RayHit> {
        self.first_hit_where(origin, direction, max_distance, |_| true)
    }

    /// As [`first_hit`](Self::first_hit), passing through where `accept` refuses the hit (through cut-outs, say). It is
    /// asked for hits in no particular order.
    pub fn first_hit_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        mut accept: impl FnMut(&RayHit) -> bool,
    ) -> Option<RayHit> {
        let ray = PreparedRay::new(origin, direction, max_distance)?;
        let mut nearest = None;
        let mut tree_hit = TreeHit::none();
        self.tree.ray_traverse(ray.in_tree, &mut tree_hit, |in_tree, slot| {
            match self.hit_at(&ray, slot, in_tree.tmax) {
                Some((t, hit)) if accept(&hit) => {
                    nearest = Some(hit);
                    t
                }
                _ => f32::INFINITY,
            }
        });
        nearest
    }

    /// True where a triangle lies on the ray, nearer than `max_distance`.
    pub fn is_occluded(&self, origin: Vec3, direction: Vec3, max_distance: f32) -> bool {
        self.is_occluded_where(origin, direction, max_distance, |_| true)
    }

    /// As [`is_occluded`](Self::is_occluded), passing through where `accept` refuses the hit.
    pub fn is_occluded_where(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        mut accept: impl FnMut(&RayHit) -> bool,
    ) -> bool {
        let Some(ray) = PreparedRay::new(origin, direction, max_distance) else { return false };
        !self.tree.ray_traverse_miss(ray.in_tree, |in_tree, slot| {
            match self.hit_at(&ray, slot, in_tree.tmax) {
                Some((t, hit)) if accept(&hit) => t,
                _ => f32::INFINITY,
            }
        })
    }

    /// The hit on the triangle in a slot of the tree's order, nearer than `nearest`, and its distance as the tree counts.
    #[inline]
    fn hit_at(&self, ray: &PreparedRay, slot: usize, nearest: f32) -> Option<(f32, RayHit)> {
        let crossing = ray.shear.intersect(&self.corners[slot])?;
        let t = crossing.distance * ray.t_per_distance;
        (t < nearest).then(|| {
            let point = SurfacePoint { triangle: self.triangles[slot], lambda: crossing.lambda };
            (t, RayHit { point, distance: crossing.distance, front: crossing.front })
        })
    }
}

struct PreparedRay {
    in_tree: Ray,
    shear: Shear,
    /// The tree's direction is shorter by this power of two.
    t_per_distance: f32,
}

impl PreparedRay {
    fn new(origin: Vec3, direction: Vec3, max_distance: f32) -> Option<Self> {
        let longest = direction.abs().max_element();
        let usable = origin.is_finite() && direction.is_finite() && (1e-30..1e30).contains(&longest);
        if !(usable && max_distance > 0.0) {
            return None;
        }
        let t_per_distance = power_of_two_below(longest) / TREE_DIRECTION;
        // The tree takes a zero of either sign as positive, and its inverse must have the same sign.
        let shortened = direction / t_per_distance + Vec3::ZERO;
        let least = f32::EPSILON * TREE_DIRECTION;
        let inverse = shortened.map(|d| 1.0 / d.abs().max(least).copysign(d));
        let in_tree = Ray {
            origin: origin.into(),
            direction: shortened.into(),
            inv_direction: inverse.into(),
            tmin: 0.0,
            tmax: max_distance * t_per_distance,
        };
        Some(Self { in_tree, shear: Shear::new(origin, direction), t_per_distance })
    }
}

/// The largest power of two that is not above `x` (positive, normal).
fn power_of_two_below(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7f80_0000)
}

/// The origin for rays that start at a point of the surface, on the side that `side` points to: `geometric_normal` is the
/// unit normal of the triangle, either way round.
pub fn origin_beside(position: Vec3, geometric_normal: Vec3, side: Vec3) -> Vec3 {
    position + geometric_normal * SURFACE_OFFSET.copysign(geometric_normal.dot(side))
}

// A ray against a triangle, watertight: a ray through a common edge or corner of triangles meets at least one of them.
//
// S. Woop, C. Benthin and I. Wald, "Watertight Ray/Triangle Intersection", 2013. The ray becomes the z axis by a shear; what
// is left are three edge functions in the plane, and those of a common edge differ in sign only, bit for bit. Where one
// of them rounds to zero, they are evaluated again in double precision, in which products of floats are exact.

struct Shear {
    origin: Vec3,
    /// The axis along which the direction is longest comes last.
    axes: [usize; 3],
    shear: Vec3,
}

struct Crossing {
    lambda: Vec3,
    distance: f32,
    front: bool,
}

impl Shear {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        let z = direction.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            // Keeps the winding of triangles.
            std::mem::swap(&mut x, &mut y);
        }
        let inverse = 1.0 / direction[z];
        let shear = Vec3::new(direction[x] * inverse, direction[y] * inverse, inverse);
        Self { origin, axes: [x, y, z], shear }
    }

    /// Where the ray crosses a triangle in front of its origin.
    #[inline]
    fn intersect(&self, corners: &[Vec3; 3]) -> Option<Crossing> {
        let [x, y, z] = self.axes;
        let relative = corners.map(|corner| corner - self.origin);
        let [a, b, c] =
            relative.map(|p| glam::Vec2::new(p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z]));
        let mut edges = Vec3::new(c.perp_dot(b), a.perp_dot(c), b.perp_dot(a));
        if edges.cmpeq(Vec3::ZERO).any() {
            let [a, b, c] = [a, b, c].map(|p| p.as_dvec2());
            let exact = |p: DVec2, q: DVec2| p.perp_dot(q) as f32;
            edges = Vec3::new(exact(c, b), exact(a, c), exact(b, a));
        }
        if edges.min_element() < 0.0 && edges.max_element() > 0.0 {
            return None;
        }
        let sum = edges.element_sum();
        if sum == 0.0 {
            // The ray runs within the triangle's plane; its neighbours are met.
            return None;
        }
        let heights = Vec3::from(relative.map(|p| p[z])) * self.shear.z;
        let lambda = edges / sum;
        let distance = lambda.dot(heights);
        // The order of the corners, seen along the ray, is clockwise where the front looks at the origin.
        (distance >= 0.0).then_some(Crossing { lambda, distance, front: sum > 0.0 })
    }
}

// The point of a mesh nearest to a given one: the tree of boxes, nearest box first.

/// A point of a mesh, and how far it is from the one that was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// Where on the surface.
    pub point: SurfacePoint,
    /// The same in mesh space.
    pub position: Vec3,
    /// Mesh units.
    pub distance: f32,
}

impl TriangleBvh {
    /// The point of the mesh nearest to `p`, within `max_distance` (which may be infinite): goes down the tree, nearest box
    /// first, dropping boxes that lie farther away than what was found.
    pub fn nearest_point(&self, p: Vec3, max_distance: f32) -> Option<NearestPoint> {
        self.nearest_point_where(p, max_distance, |_| true)
    }

    /// The same on the triangles that `accept` picks by their corners.
    pub fn nearest_point_where(
        &self,
        p: Vec3,
        max_distance: f32,
        accept: impl Fn([Vec3; 3]) -> bool,
    ) -> Option<NearestPoint> {
        if self.tree.nodes.is_empty() || !p.is_finite() || max_distance.is_nan() || max_distance < 0.0 {
            return None;
        }
        let exact = p.as_dvec3();
        let mut best = Best { bound: f64::from(max_distance).powi(2), found: None };
        // Squared distances of boxes; these are a little larger than their triangles, so nothing is lost to rounding.
        let mut waiting: Vec<(f32, u32)> = vec![(0.0, 0)];
        while let Some((distance, node)) = waiting.pop() {
            if f64::from(distance) > best.bound {
                continue;
            }
            let node = &self.tree.nodes[node as usize];
            let first_waiting = waiting.len();
            for child in (0..8).filter(|&child| !node.is_child_empty(child)) {
                let aabb = node.child_aabb(child);
                let p = Vec3A::from(p);
                let distance = (p - p.clamp(aabb.min, aabb.max)).length_squared();
                if f64::from(distance) > best.bound {
                    continue;
                }
                if node.is_leaf(child) {
                    let (first, count) = node.child_primitives(child);
                    for (slot, triangle) in
                        self.corners.iter().enumerate().skip(first as usize).take(count as usize)
                    {
                        if accept(*triangle) {
                            best.try_triangle(exact, slot, triangle.map(|c| c.as_dvec3()));
                        }
                    }
                } else {
                    waiting.push((distance, node.child_node_index(child)));
                }
            }
            waiting[first_waiting..].sort_by(|a, b| b.0.total_cmp(&a.0));
        }
        let (slot, lambda, position) = best.found?;
        Some(NearestPoint {
            point: SurfacePoint { triangle: self.triangles[slot], lambda: lambda.as_vec3() },
            position: position.as_vec3(),
            distance: best.bound.sqrt() as f32,
        })
    }
}

struct Best {
    /// Squared distance, at first the largest allowed.
    bound: f64,
    /// Slot in the tree's order, barycentric coordinates, position.
    found: Option<(usize, DVec3, DVec3)>,
}

impl Best {
    fn try_triangle(&mut self, p: DVec3, slot: usize, corners: [DVec3; 3]) {
        let (lambda, position) = nearest_of_triangle(p, corners);
        let squared = position.distance_squared(p);
        if squared < self.bound || (self.found.is_none() && squared <= self.bound) {
            self.bound = squared;
            self.found = Some((slot, lambda, position));
        }
    }
}

/// Barycentric coordinates and position of the point of a triangle nearest to `p`: the Voronoi regions of corners, edges
/// and face in turn (C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
pub(crate) fn nearest_of_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> (DVec3, DVec3) {
    let (ab, ac) = (b - a, c - a);
    let (ap, bp, cp) = (p - a, p - b, p - c);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    let lambda = if d1 <= 0.0 && d2 <= 0.0 {
        DVec3::X
    } else if d3 >= 0.0 && d4 <= d3 {
        DVec3::Y
    } else if d6 >= 0.0 && d5 <= d6 {
        DVec3::Z
    } else {
        let opposite = DVec3::new(d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
        if opposite.z <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            let t = d1 / (d1 - d3);
            DVec3::new(1.0 - t, t, 0.0)
        } else if opposite.y <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            let t = d2 / (d2 - d6);
            DVec3::new(1.0 - t, 0.0, t)
        } else if opposite.x <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            DVec3::new(0.0, 1.0 - t, t)
        } else {
            opposite / opposite.element_sum()
        }
    };
    (lambda, interpolate([a, b, c], lambda))
}

// Building the tree of boxes.
//
// Usually by clustering (D. Meister and J. Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
// Construction", 2018) and by moving nodes to better places. Where boxes overlap nearly all, as those of thousands of needles
// around the apex of a cone do, every node costs the same everywhere: clusters grow by one box at a time, into a tree deeper
// than the traversal can follow (it does not check), and looking for better places visits most of the tree for each node.
// Such boxes are halved by their centres instead, again and again.

/// Boxes with more times the surface of the box around them all overlap nearly all.
const MAX_CROWDING: f64 = 256.0;

/// The traversal has room for 32 levels.
const MAX_LEVELS: usize = 30;

const LEAF_BOXES: u32 = 3;

/// The tree of some boxes; at most [`MAX_LEVELS`] deep for up to 2^28 of them.
fn build(boxes: &[Aabb]) -> CwBvh {
    if !are_crowded(boxes) {
        let tree = clustered(boxes);
        if levels(&tree) <= MAX_LEVELS {
            return tree;
        }
    }
    halved(boxes)
}

fn are_crowded(boxes: &[Aabb]) -> bool {
    let whole = boxes.iter().fold(Aabb::empty(), |whole, b| whole.union(b));
    let sum: f64 = boxes.iter().map(|b| f64::from(b.half_area())).sum();
    sum > MAX_CROWDING * f64::from(whole.half_area())
}

fn clustered(boxes: &[Aabb]) -> CwBvh {
    let params = BvhBuildParams::medium_build();
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        params.sort_precision,
        params.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut tree, params.reinsertion_batch_ratio, None);
    bvh2_to_cwbvh(&tree, LEAF_BOXES, true, false)
}

/// Halves the boxes along the axis on which their centres are spread farthest.
fn halved(boxes: &[Aabb]) -> CwBvh {
    let center = |i: u32, axis: usize| boxes[i as usize].min[axis] + boxes[i as usize].max[axis];
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let leaf = |order: &[u32], first: usize| {
        let around = order.iter().fold(Aabb::empty(), |around, &i| around.union(&boxes[i as usize]));
        Bvh2Node::new(around, order.len() as u32, first as u32)
    };
    let mut nodes = vec![leaf(&order, 0)];
    let mut waiting = vec![(0, 0..boxes.len())];
    while let Some((node, range)) = waiting.pop() {
        // The wide tree gathers several boxes in a leaf by itself.
        if range.len() <= 1 {
            continue;
        }
        let part = &mut order[range.clone()];
        let spread = |axis: usize| {
            let (low, high) = part.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &i| {
                (low.min(center(i, axis)), high.max(center(i, axis)))
            });
            high - low
        };
        let spreads = [0, 1, 2].map(spread);
        let axis = (0..3).max_by(|&a, &b| spreads[a].total_cmp(&spreads[b])).unwrap_or(0);
        let half = part.len() / 2;
        part.select_nth_unstable_by(half, |&a, &b| {
            center(a, axis).total_cmp(&center(b, axis)).then(a.cmp(&b))
        });
        let middle = range.start + half;
        let first_child = nodes.len();
        for side in [range.start..middle, middle..range.end] {
            waiting.push((nodes.len(), side.clone()));
            nodes.push(leaf(&order[side.clone()], side.start));
        }
        (nodes[node].prim_count, nodes[node].first_index) = (0, first_child as u32);
    }
    let tree =
        Bvh2 { nodes, primitive_indices: order, children_are_ordered_after_parents: true, ..Bvh2::default() };
    bvh2_to_cwbvh(&tree, LEAF_BOXES, true, false)
}

fn levels(tree: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut waiting: Vec<(usize, usize)> = (0..tree.nodes.len().min(1)).map(|root| (root, 1)).collect();
    while let Some((node, level)) = waiting.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[node];
        let inner = (0..8).filter(|&child| !node.is_child_empty(child) && !node.is_leaf(child));
        waiting.extend(inner.map(|child| (node.child_node_index(child) as usize, level + 1)));
    }
    deepest
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3A};

    use super::*;

    /// The boxes of needles around the apex of a disc.
    fn needles(count: u32) -> Vec<Aabb> {
        let rim = |i: u32| Vec2::from_angle(i as f32 / count as f32 * std::f32::consts::TAU).extend(0.0);
        let needle = |i: u32| {
            let [a, b] = [i, i + 1].map(|i| Vec3A::from(rim(i)));
            Aabb::new(a.min(b).min(Vec3A::ZERO) - 1e-6, a.max(b).max(Vec3A::ZERO) + 1e-6)
        };
        (0..count).map(needle).collect()
    }

    #[test]
    fn both_ways_give_whole_trees_of_few_levels() {
        for count in [1, 2, 3, 4, 5, 9, 100, 5_000] {
            let boxes = needles(count);
            for tree in [halved(&boxes), build(&boxes)] {
                assert!(levels(&tree) <= MAX_LEVELS);
                tree.validate(&boxes, false);
            }
        }
        let many = needles(50_000);
        assert!(are_crowded(&many));
        let tree = build(&many);
        assert!(levels(&tree) <= 16, "{}", levels(&tree));
        tree.validate(&many, false);
    }

    #[test]
    fn ordinary_boxes_are_clustered() {
        let at = |i: u32| Vec3A::new((i % 50) as f32, (i / 50 % 50) as f32, (i / 2500) as f32);
        let boxes: Vec<Aabb> = (0..20_000).map(|i| Aabb::new(at(i), at(i) + 1.2)).collect();
        assert!(!are_crowded(&boxes));
        let tree = build(&boxes);
        assert!(levels(&tree) <= 12, "{}", levels(&tree));
        tree.validate(&boxes, false);
    }
}
