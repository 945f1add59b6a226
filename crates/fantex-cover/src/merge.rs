//! Small groups join a neighbour where one tile costs fewer texels than two.
//!
//! Unions are judged by summaries (a cone that holds both normal cones, the convex outlines of both), which costs about a
//! microsecond each. In every round each small group proposes its cheapest union, in parallel; proposals are taken in order
//! of the texels they save, each group at most once, so the result does not depend on the number of threads. What was
//! joined is laid flat exactly afterwards, and halved again where the summary promised too much.

use fantex_mesh::Fans;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::cone::Cone;
use crate::extent::side_texels;
use crate::grouping::{Patch, facing_limit};

/// Groups with a tile smaller than this share of the target tile look for a partner.
const SMALL: f32 = 0.6;

/// A union may exceed the target extent by this factor.
const STRETCHED_TARGET: f32 = 1.25;

/// Neighbours tried per group, by the length of the common border.
const CANDIDATES: usize = 6;

const ROUNDS: usize = 12;

/// Rotations tried for the rectangle of a union.
const ROTATIONS: usize = 12;

/// When two groups may share a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MergeLimits {
    pub(crate) extent_texels: f32,
    pub(crate) facing: f32,
}

/// What a union is judged by.
#[derive(Clone, Debug)]
struct Summary {
    cone: Cone,
    /// Points on the convex outline, mesh space.
    outline: Vec<Vec3>,
    texels: f32,
    density: f32,
    fans: u32,
    steepest_fan: f32,
    mergeable: bool,
}

struct Proposal {
    saved_texels: f32,
    small: u32,
    partner: u32,
    union: Summary,
}

/// For every patch the patch that it joins (itself, for those that stay): a forest of depth one.
pub(crate) fn choose_unions(
    fans: &Fans,
    patches: &[Patch],
    fan_groups: &[u32],
    limits: &MergeLimits,
) -> Vec<u32> {
    let mut summaries: Vec<Option<Summary>> = patches.par_iter().map(|p| Some(Summary::of(p))).collect();
    let mut borders = Borders::of(fans, fan_groups);
    let mut joined: Vec<u32> = (0..patches.len() as u32).collect();
    let mut active = joined.clone();
    for _ in 0..ROUNDS {
        let mut proposals: Vec<Proposal> =
            active.par_iter().filter_map(|&g| propose(g, &summaries, &borders, limits)).collect();
        if proposals.is_empty() {
            break;
        }
        proposals.sort_by(|a, b| b.saved_texels.total_cmp(&a.saved_texels).then(a.small.cmp(&b.small)));
        let mut taken = vec![false; patches.len()];
        active.clear();
        for p in proposals {
            active.push(p.small);
            active.push(p.partner);
            let pair = [p.small as usize, p.partner as usize];
            if !pair.iter().any(|&g| taken[g]) {
                pair.iter().for_each(|&g| taken[g] = true);
                joined[pair[0]] = p.partner;
                summaries[pair[0]] = None;
                summaries[pair[1]] = Some(p.union);
            }
        }
        for g in 0..joined.len() {
            joined[g] = joined[joined[g] as usize];
        }
        borders.contract(&joined);
        active.iter_mut().for_each(|g| *g = joined[*g as usize]);
        active.sort_unstable();
        active.dedup();
    }
    joined
}

fn propose(
    small: u32,
    summaries: &[Option<Summary>],
    borders: &Borders,
    limits: &MergeLimits,
) -> Option<Proposal> {
    let summary = summaries[small as usize].as_ref()?;
    let target = limits.extent_texels * limits.extent_texels;
    if summary.texels > SMALL * target || !summary.mergeable {
        return None;
    }
    let mut best: Option<Proposal> = None;
    for &(_, partner) in borders.longest(small) {
        let Some(other) = summaries[partner as usize].as_ref() else { continue };
        let Some(union) = summary.union(other, limits) else { continue };
        let saved_texels = summary.texels + other.texels - union.texels;
        if saved_texels > 0.0 && best.as_ref().is_none_or(|b| saved_texels > b.saved_texels) {
            best = Some(Proposal { saved_texels, small, partner, union });
        }
    }
    best
}

impl Summary {
    fn of(patch: &Patch) -> Self {
        let texels = patch.flat.size * patch.density;
        Self {
            cone: patch.flat.cone,
            outline: patch.flat.outline.clone(),
            texels: tile_texels(texels),
            density: patch.density,
            fans: patch.length,
            steepest_fan: patch.steepest_fan,
            mergeable: patch.flat.unfolded.is_empty(),
        }
    }

    fn union(&self, other: &Summary, limits: &MergeLimits) -> Option<Summary> {
        if !other.mergeable {
            return None;
        }
        let cone = union_of_cones(self.cone, other.cone)?;
        let steepest_fan = self.steepest_fan.min(other.steepest_fan);
        if cone.cos < facing_limit(limits.facing, steepest_fan) {
            return None;
        }
        let fans = self.fans + other.fans;
        let density = (self.density * self.fans as f32 + other.density * other.fans as f32) / fans as f32;
        let (x, y) = cone.axis.any_orthonormal_pair();
        let flat = |p: &Vec3| Vec2::new(p.dot(x), p.dot(y));
        let points: Vec<Vec2> = self.outline.iter().chain(&other.outline).map(flat).collect();
        let size = (0..ROTATIONS)
            .map(|i| {
                bounding_size(
                    &points,
                    Vec2::from_angle(i as f32 * std::f32::consts::FRAC_PI_2 / ROTATIONS as f32),
                )
            })
            .min_by(|a, b| (a.x * a.y).total_cmp(&(b.x * b.y)))?;
        let texels = size * density;
        if texels.max_element() > limits.extent_texels * STRETCHED_TARGET {
            return None;
        }
        let outline = extreme_points(self.outline.iter().chain(&other.outline), &points);
        Some(Summary {
            cone,
            outline,
            texels: tile_texels(texels),
            density,
            fans,
            steepest_fan,
            mergeable: true,
        })
    }
}

fn tile_texels(size: Vec2) -> f32 {
    side_texels(size.x) as f32 * side_texels(size.y) as f32
}

fn bounding_size(points: &[Vec2], x_axis: Vec2) -> Vec2 {
    let (mut min, mut max) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for p in points {
        let q = Vec2::new(p.dot(x_axis), x_axis.perp_dot(*p));
        min = min.min(q);
        max = max.max(q);
    }
    max - min
}

/// Directions in which an outline keeps its farthest point, so that outlines do not grow with each union.
const DIRECTIONS: usize = 24;

/// The spatial points whose planar images lie farthest in any of `DIRECTIONS` directions.
fn extreme_points<'a>(spatial: impl Iterator<Item = &'a Vec3> + Clone, planar: &[Vec2]) -> Vec<Vec3> {
    let mut kept: Vec<usize> = (0..DIRECTIONS)
        .map(|i| {
            let d = Vec2::from_angle(i as f32 * std::f32::consts::TAU / DIRECTIONS as f32);
            let mut best = (0, f32::NEG_INFINITY);
            for (j, p) in planar.iter().enumerate() {
                let x = p.dot(d);
                if x > best.1 {
                    best = (j, x);
                }
            }
            best.0
        })
        .collect();
    kept.sort_unstable();
    kept.dedup();
    let all: Vec<Vec3> = spatial.copied().collect();
    kept.into_iter().map(|j| all[j]).collect()
}

/// The narrowest cone that holds two cones; `None` where it is wider than a hemisphere.
fn union_of_cones(a: Cone, b: Cone) -> Option<Cone> {
    let [half_a, half_b] = [a, b].map(|c| c.cos.clamp(-1.0, 1.0).acos());
    let between = a.axis.angle_between(b.axis);
    if between + half_b <= half_a {
        return Some(a);
    }
    if between + half_a <= half_b {
        return Some(b);
    }
    let half = 0.5 * (half_a + half_b + between);
    if half >= std::f32::consts::FRAC_PI_2 || between < 1e-6 {
        return (between < 1e-6).then_some(if half_a > half_b { a } else { b });
    }
    // The axis lies on the arc from a to b, half - half_a away from a.
    let t = (half - half_a) / between;
    let axis = (a.axis * ((1.0 - t) * between).sin() + b.axis * (t * between).sin()).try_normalize()?;
    Some(Cone { axis, cos: half.cos() })
}

/// Which groups touch, and in how many triangles.
struct Borders {
    /// `(group, neighbour, triangles)`, both directions, ascending.
    pairs: Vec<(u32, u32, u32)>,
    /// For every group its longest borders, `(triangles, neighbour)`.
    longest: Vec<Vec<(u32, u32)>>,
}

impl Borders {
    fn of(fans: &Fans, fan_groups: &[u32]) -> Self {
        let triangles = fans.triangle_count();
        let mut pairs: Vec<(u32, u32, u32)> = (0..triangles)
            .into_par_iter()
            .with_min_len(1 << 12)
            .flat_map_iter(|t| {
                let [a, b, c] = fans.of_triangle(t).map(|f| fan_groups[f as usize]);
                [(a, b), (b, c), (c, a)].into_iter().filter(|(x, y)| x != y)
            })
            .flat_map_iter(|(x, y)| [(x, y, 1), (y, x, 1)])
            .collect();
        pairs.par_sort_unstable();
        let mut borders = Self { pairs, longest: Vec::new() };
        let groups = fan_groups.iter().max().map_or(0, |&g| g as usize + 1);
        borders.aggregate(groups);
        borders
    }

    /// Renames groups after unions.
    fn contract(&mut self, joined: &[u32]) {
        for pair in &mut self.pairs {
            (pair.0, pair.1) = (joined[pair.0 as usize], joined[pair.1 as usize]);
        }
        self.pairs.retain(|p| p.0 != p.1);
        self.pairs.par_sort_unstable();
        self.aggregate(joined.len());
    }

    fn aggregate(&mut self, groups: usize) {
        self.pairs = self
            .pairs
            .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
            .map(|run| (run[0].0, run[0].1, run.iter().map(|r| r.2).sum()))
            .collect();
        self.longest = vec![Vec::new(); groups];
        for run in self.pairs.chunk_by(|a, b| a.0 == b.0) {
            let mut borders: Vec<(u32, u32)> = run.iter().map(|r| (r.2, r.1)).collect();
            borders.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
            borders.truncate(CANDIDATES);
            self.longest[run[0].0 as usize] = borders;
        }
    }

    fn longest(&self, group: u32) -> &[(u32, u32)] {
        &self.longest[group as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_union_of_cones_holds_both(z in -1f32..1.0, angle in 0f32..6.3, half_a in 0f32..0.7, half_b in 0f32..0.7, turn in 0f32..6.3) {
            let r = (1.0 - z * z).sqrt();
            let a = Cone { axis: Vec3::Z, cos: half_a.cos() };
            let b = Cone { axis: Vec3::new(r * angle.cos(), r * angle.sin(), z), cos: half_b.cos() };
            if let Some(union) = union_of_cones(a, b) {
                for (cone, half) in [(a, half_a), (b, half_b)] {
                    let (x, y) = cone.axis.any_orthonormal_pair();
                    let rim = cone.axis * half.cos() + (x * turn.cos() + y * turn.sin()) * half.sin();
                    prop_assert!(rim.dot(union.axis) >= union.cos - 2e-3);
                }
            }
        }
    }
}
