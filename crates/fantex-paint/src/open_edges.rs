//! Edges across which no triangle continues another's, and which of them are near each other.

use glam::{DVec3, Vec3};

use crate::Surface;

/// Cosine between the directions into two triangles from their edges above which one folds back onto the other: 60 degrees.
const MAX_FOLD: f64 = 0.5;

/// Cosine between two edges below which they do not run along each other: where they meet at a corner, nothing leads on.
const MIN_ALONG: f64 = 0.5;

/// Edges of a leaf of the tree.
const LEAF: usize = 4;

/// A tree of boxes over half-edges without an opposite.
#[derive(Debug, Default)]
pub(crate) struct OpenEdges {
    /// The halves of a range, down to leaves, lie in the halves of it.
    edges: Vec<u32>,
    /// In the order of a walk: a node, all below its first half, all below its second half.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// Of `edges`.
    range: [u32; 2],
    /// The node that follows all below this one.
    next: u32,
}

impl OpenEdges {
    /// `opposite`: per half-edge the one on the other side, or `u32::MAX`.
    pub(crate) fn of(surface: &Surface, opposite: &[u32]) -> Self {
        let is_open = |&edge: &u32| opposite[edge as usize] == u32::MAX;
        let mut tree =
            Self { edges: (0..opposite.len() as u32).filter(is_open).collect(), nodes: Vec::new() };
        if !tree.edges.is_empty() {
            tree.split(surface, 0, tree.edges.len());
        }
        tree
    }

    fn split(&mut self, surface: &Surface, from: usize, to: usize) {
        let ends = |edge: u32| ends(surface, edge).map(|p| p.as_vec3());
        let bounds = self.edges[from..to].iter().flat_map(|&edge| ends(edge));
        let [low, high] = bounds.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[l, h], p| [l.min(p), h.max(p)]);
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, range: [from as u32, to as u32], next: 0 });
        if to - from > LEAF {
            let axis = (high - low).max_position();
            let middle = |edge: u32| ends(edge).map(|p| p[axis]).into_iter().sum::<f32>();
            let half = (to - from) / 2;
            self.edges[from..to]
                .select_nth_unstable_by(half, |&a, &b| middle(a).total_cmp(&middle(b)).then(a.cmp(&b)));
            self.split(surface, from, from + half);
            self.split(surface, from + half, to);
        }
        self.nodes[node].next = self.nodes.len() as u32;
    }

    /// Those at most `gap` away from a half-edge whose triangles lead on from its triangle, ascending.
    pub(crate) fn near(&self, surface: &Surface, half_edge: u32, gap: f64) -> Vec<u32> {
        let [a, b] = ends(surface, half_edge);
        let (inwards, along) = (into_triangle(surface, half_edge), (b - a).normalize_or_zero());
        let margin = Vec3::splat(gap as f32 * 1.001 + 1e-6);
        let [low, high] = [a.min(b).as_vec3() - margin, a.max(b).as_vec3() + margin];
        let (mut found, mut at) = (Vec::new(), 0);
        while let Some(node) = self.nodes.get(at) {
            let is_beside = node.low.cmpgt(high).any() || node.high.cmplt(low).any();
            let is_leaf = at + 1 == node.next as usize;
            if !is_beside && is_leaf {
                found.extend(&self.edges[node.range[0] as usize..node.range[1] as usize]);
            }
            at = if is_beside { node.next as usize } else { at + 1 };
        }
        found.retain(|&edge| {
            let [c, d] = ends(surface, edge);
            edge / 3 != half_edge / 3
                && (d - c).normalize_or_zero().dot(along).abs() > MIN_ALONG
                && segment_distance([a, b], [c, d]) <= gap + 1e-6
                && into_triangle(surface, edge).dot(inwards) < MAX_FOLD
        });
        found.sort_unstable();
        found
    }
}

fn ends(surface: &Surface, half_edge: u32) -> [DVec3; 2] {
    let [(_, a), (_, b), _] = surface.turned(half_edge);
    [a, b]
}

/// The unit direction in a triangle's plane from an edge of it, orthogonal to that.
fn into_triangle(surface: &Surface, half_edge: u32) -> DVec3 {
    let [(_, a), (_, b), (_, c)] = surface.turned(half_edge);
    (c - a).reject_from(b - a).normalize_or_zero()
}

/// After C. Ericson, "Real-Time Collision Detection" (2005), 5.1.9.
fn segment_distance([p, q]: [DVec3; 2], [r, s]: [DVec3; 2]) -> f64 {
    let (d, e, w) = (q - p, s - r, p - r);
    let (dd, ee, de, dw, ew) = (d.dot(d), e.dot(e), d.dot(e), d.dot(w), e.dot(w));
    let least = f64::MIN_POSITIVE;
    let cross = dd * ee - de * de;
    let t = if cross > 1e-12 * dd * ee { ((de * ew - dw * ee) / cross).clamp(0.0, 1.0) } else { 0.0 };
    let u = ((de * t + ew) / ee.max(least)).clamp(0.0, 1.0);
    let t = ((de * u - dw) / dd.max(least)).clamp(0.0, 1.0);
    (p + d * t).distance(r + e * u)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_segments_are_those_found_by_trying() {
        let mut random = fantex_base::Random::new(5);
        let mut number = || (random.next_u64() >> 40) as f64 / (1u64 << 24) as f64;
        for _ in 0..200 {
            let mut segment = || [(); 2].map(|()| DVec3::new(number(), number(), number()));
            let (one, two) = (segment(), segment());
            let at = |[a, b]: [DVec3; 2], k: usize| a.lerp(b, k as f64 / 100.0);
            let tried = (0..=100).flat_map(|i| (0..=100).map(move |k| at(one, i).distance(at(two, k))));
            let tried = tried.fold(f64::INFINITY, f64::min);
            let found = segment_distance(one, two);
            assert!(found <= tried + 1e-12 && tried - found < 0.02, "{found} {tried}");
        }
    }
}
