//! Small groups join a neighbour where one tile costs fewer texels than two.
//!
//! In every round each small group proposes its cheapest union, in parallel; proposals are taken in order of the texels they
//! save, each group at most once. So the result does not depend on the number of threads.

use rayon::prelude::*;

use crate::extent::side_texels;
use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Flat, Flattener, Membership};
use crate::grouping::{GroupLimits, Grouping, Patch, texel_pad};
use crate::surface::Surface;

/// Groups with a tile smaller than this share of the target tile look for a partner.
const SMALL: f32 = 0.5;

/// A union may exceed the target extent by this factor.
const STRETCHED_TARGET: f32 = 1.25;

/// Neighbours tried per group, by the length of the common border.
const CANDIDATES: usize = 3;

const ROUNDS: usize = 6;

struct Proposal {
    saved_texels: f32,
    small: u32,
    partner: u32,
    patch: Patch,
}

/// Merges small groups of a grouping.
pub(crate) fn merge_small(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    grouping: Grouping,
    limits: &GroupLimits,
) -> Grouping {
    let Grouping { order, patches, mut fan_groups } = grouping;
    let mut members: Vec<Vec<u32>> = patches.iter().map(|p| p.fans(&order).to_vec()).collect();
    let mut patches: Vec<Option<Patch>> = patches.into_iter().map(Some).collect();
    let mut active: Vec<u32> = (0..patches.len() as u32).collect();
    for _ in 0..ROUNDS {
        let merger = Merger { surface, shapes, limits, fan_groups: &fan_groups, members: &members, patches: &patches };
        let mut proposals: Vec<Proposal> =
            active.par_iter().map_init(Default::default, |scratch, &g| merger.propose(g, scratch)).flatten().collect();
        proposals.sort_by(|a, b| b.saved_texels.total_cmp(&a.saved_texels).then(a.small.cmp(&b.small)));
        active.clear();
        let mut taken = vec![false; patches.len()];
        for p in proposals {
            let pair = [p.small as usize, p.partner as usize];
            if pair.iter().any(|&g| taken[g]) {
                active.push(p.small);
                continue;
            }
            pair.iter().for_each(|&g| taken[g] = true);
            let moved = std::mem::take(&mut members[pair[0]]);
            moved.iter().for_each(|&fan| fan_groups[fan as usize] = p.partner);
            members[pair[1]].extend(moved);
            patches[pair[0]] = None;
            patches[pair[1]] = Some(p.patch);
            active.push(p.partner);
        }
        if active.is_empty() {
            break;
        }
        active.sort_unstable();
        active.dedup();
        active.retain(|&g| patches[g as usize].is_some());
    }
    collect(order.len(), members, patches, fan_groups)
}

fn collect(
    fan_count: usize,
    members: Vec<Vec<u32>>,
    patches: Vec<Option<Patch>>,
    fan_groups: Vec<u32>,
) -> Grouping {
    let mut order = Vec::with_capacity(fan_count);
    let mut kept = Vec::with_capacity(patches.len());
    for (fans, patch) in members.into_iter().zip(patches) {
        if let Some(patch) = patch {
            kept.push(Patch { start: order.len() as u32, length: fans.len() as u32, ..patch });
            order.extend(fans);
        }
    }
    let mut grouping = Grouping { order, patches: kept, fan_groups };
    grouping.number_groups();
    grouping
}

#[derive(Default)]
struct Scratch {
    flattener: Flattener,
    neighbours: Vec<u32>,
    union: Vec<u32>,
}

struct Merger<'a> {
    surface: &'a Surface<'a>,
    shapes: &'a [FanShape],
    limits: &'a GroupLimits,
    fan_groups: &'a [u32],
    members: &'a [Vec<u32>],
    patches: &'a [Option<Patch>],
}

impl Merger<'_> {
    fn propose(&self, small: u32, scratch: &mut Scratch) -> Option<Proposal> {
        let patch = self.patches[small as usize].as_ref()?;
        let target = self.limits.extent_texels * self.limits.extent_texels;
        let fans = &self.members[small as usize];
        if cost(&patch.flat, patch.density) > SMALL * target || self.is_unfolded(fans) {
            return None;
        }
        let mut best: Option<Proposal> = None;
        for partner in self.neighbours(small, &mut scratch.neighbours) {
            let Some(other) = self.patches[partner as usize].as_ref() else { continue };
            let Some(union) = self.union(small, partner, scratch) else { continue };
            let saved_texels =
                cost(&patch.flat, patch.density) + cost(&other.flat, other.density) - cost(&union.flat, union.density);
            if saved_texels > 0.0 && best.as_ref().is_none_or(|b| saved_texels > b.saved_texels) {
                best = Some(Proposal { saved_texels, small, partner, patch: union });
            }
        }
        best
    }

    fn is_unfolded(&self, fans: &[u32]) -> bool {
        fans.first().is_some_and(|&f| self.shapes[f as usize].layout == Layout::Unfolded)
    }

    /// The groups with the longest common borders, longest first.
    fn neighbours(&self, group: u32, found: &mut Vec<u32>) -> Vec<u32> {
        found.clear();
        for &fan in &self.members[group as usize] {
            for corner in self.surface.fans.corners(fan as usize) {
                let groups =
                    self.surface.fans.of_triangle(corner.triangle()).map(|f| self.fan_groups[f as usize]);
                found.extend(groups.into_iter().filter(|&g| g != group));
            }
        }
        found.sort_unstable();
        let mut counted: Vec<(usize, u32)> = found.chunk_by(|a, b| a == b).map(|run| (run.len(), run[0])).collect();
        counted.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        counted.into_iter().take(CANDIDATES).map(|(_, g)| g).collect()
    }

    fn union(&self, small: u32, partner: u32, scratch: &mut Scratch) -> Option<Patch> {
        let [a, b] = [small, partner].map(|g| &self.members[g as usize]);
        let (pa, pb) = (self.patches[small as usize].as_ref()?, self.patches[partner as usize].as_ref()?);
        if self.is_unfolded(b) || pa.flat.frame.direction.dot(pb.flat.frame.direction) < self.limits.facing {
            return None;
        }
        let density = (pa.density * a.len() as f32 + pb.density * b.len() as f32) / (a.len() + b.len()) as f32;
        scratch.union.clear();
        scratch.union.extend_from_slice(b);
        scratch.union.extend_from_slice(a);
        let membership = Membership {
            fan_groups: self.fan_groups,
            groups: [small, partner],
            delta: self.limits.delta,
            pad: texel_pad(density),
            facing: self.limits.facing,
        };
        let flat = scratch.flattener.project(self.surface, &scratch.union, &membership).ok()?;
        let fits = flat.size.max_element() * density <= self.limits.extent_texels * STRETCHED_TARGET;
        fits.then_some(Patch { start: 0, length: 0, flat, density })
    }
}

/// Texels of a group's tile.
fn cost(flat: &Flat, density: f32) -> f32 {
    (side_texels(flat.size.x * density) * side_texels(flat.size.y * density)) as f32
}
