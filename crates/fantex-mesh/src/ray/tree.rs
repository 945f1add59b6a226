//! Building the tree of boxes.
//!
//! Usually by clustering (D. Meister and J. Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
//! Construction", 2018) and by moving nodes to better places. Where boxes overlap nearly all, as those of thousands of needles
//! around the apex of a cone do, every node costs the same everywhere: clusters grow by one box at a time, into a tree deeper
//! than the traversal can follow (it does not check), and looking for better places visits most of the tree for each node.
//! Such boxes are halved by their centres instead, again and again.

use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;

/// Boxes with more times the surface of the box around them all overlap nearly all.
const MOST_CROWDED: f64 = 256.0;

/// The traversal has room for 32 levels.
const MOST_LEVELS: usize = 30;

/// Boxes of a leaf, at most.
const LEAF_BOXES: u32 = 3;

/// The tree of some boxes; at most [`MOST_LEVELS`] deep for up to 2^28 of them.
pub(super) fn build(boxes: &[Aabb]) -> CwBvh {
    if !are_crowded(boxes) {
        let tree = clustered(boxes);
        if levels(&tree) <= MOST_LEVELS {
            return tree;
        }
    }
    halved(boxes)
}

fn are_crowded(boxes: &[Aabb]) -> bool {
    let whole = boxes.iter().fold(Aabb::empty(), |whole, b| whole.union(b));
    let sum: f64 = boxes.iter().map(|b| f64::from(b.half_area())).sum();
    sum > MOST_CROWDED * f64::from(whole.half_area())
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

/// Levels of nodes.
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
                assert!(levels(&tree) <= MOST_LEVELS);
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
