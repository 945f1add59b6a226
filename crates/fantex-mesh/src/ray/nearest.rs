//! The point of a mesh nearest to a given one: the tree of boxes, nearest box first.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::cwbvh::CwBvh;

/// A point of a mesh, and how far it is from the one that was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// Triangle index.
    pub triangle: usize,
    /// Barycentric coordinates, not negative, of sum one.
    pub lambda: Vec3,
    /// The point, mesh space.
    pub position: Vec3,
    /// Mesh units.
    pub distance: f32,
}

/// Goes down the tree, nearest box first, dropping boxes that lie farther away than what was found.
pub(super) fn nearest_point(
    tree: &CwBvh,
    corners: &[[Vec3; 3]],
    triangles: &[u32],
    p: Vec3,
    max_distance: f32,
) -> Option<NearestPoint> {
    if tree.nodes.is_empty() || !p.is_finite() || max_distance.is_nan() || max_distance < 0.0 {
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
        let node = &tree.nodes[node as usize];
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
                for (slot, triangle) in corners.iter().enumerate().skip(first as usize).take(count as usize) {
                    best.try_triangle(exact, slot, triangle.map(|c| c.as_dvec3()));
                }
            } else {
                waiting.push((distance, node.child_node_index(child)));
            }
        }
        waiting[first_waiting..].sort_by(|a, b| b.0.total_cmp(&a.0));
    }
    let (slot, lambda, position) = best.found?;
    Some(NearestPoint {
        triangle: triangles[slot] as usize,
        lambda: lambda.as_vec3(),
        position: position.as_vec3(),
        distance: best.bound.sqrt() as f32,
    })
}

/// The nearest point so far.
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
fn nearest_of_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> (DVec3, DVec3) {
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
    (lambda, a * lambda.x + b * lambda.y + c * lambda.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smallest of many distances to a fine grid of points on the triangle bounds the nearest from above.
    #[test]
    fn no_other_point_of_the_triangle_is_nearer() {
        let triangle = [DVec3::new(0.1, -0.3, 0.2), DVec3::new(0.9, 0.2, -0.4), DVec3::new(-0.2, 0.7, 0.5)];
        let n = 60;
        for i in 0..500_u32 {
            let coordinate = |k: u32| f64::from((i * 7919 + k * 104_729) % 1000) / 250.0 - 2.0;
            let p = DVec3::new(coordinate(1), coordinate(2), coordinate(3));
            let (lambda, position) = nearest_of_triangle(p, triangle);
            assert!(lambda.min_element() >= 0.0 && (lambda.element_sum() - 1.0).abs() < 1e-12);
            let sampled = (0..=n)
                .flat_map(|i| (0..=n - i).map(move |j| (i, j, n - i - j)))
                .map(|(i, j, k)| {
                    let l = DVec3::new(f64::from(i), f64::from(j), f64::from(k)) / f64::from(n);
                    p.distance(triangle[0] * l.x + triangle[1] * l.y + triangle[2] * l.z)
                })
                .fold(f64::INFINITY, f64::min);
            let nearest = p.distance(position);
            assert!(nearest <= sampled + 1e-12 && sampled - nearest < 0.03, "{nearest} {sampled}");
        }
    }
}
