//! Groups join a neighbour where one tile costs less than two (see [`cost`](crate::cost)).
//!
//! Unions are judged by summaries (a cone that holds both normal cones, the convex outlines of both), which costs about a
//! microsecond each. In every round each group proposes the union that saves most, in parallel; proposals are taken in order
//! of what they save, each group at most once, so the result does not depend on the number of threads. What was
//! joined is laid flat exactly afterwards, and undone where the summary promised too much.

use std::borrow::Cow;
use std::sync::LazyLock;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use arrayvec::ArrayVec;
use fantex_mesh::{Fans, unit_vector};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::cost::{self, Region};
use crate::fan_shape::Layout;
use crate::flatten::Flat;
use crate::groups::{Patch, facing_limit, may_share};
use crate::nominal::Demand;
use crate::rectangle::FourBounds;

/// Neighbours tried per group, by the length of the common border.
const CANDIDATES: usize = 6;

/// When two groups may share a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MergeLimits {
    pub(crate) extent_texels: f32,
    pub(crate) facing: f32,
    /// Rounds of proposals at most.
    pub(crate) rounds: u32,
}

/// What a union is judged by.
#[derive(Clone, Debug)]
struct Summary<'p> {
    cone: WideCone,
    /// Points on the convex outline, mesh space.
    outline: Cow<'p, [Vec3]>,
    /// Mean direction, by area.
    direction: Vec3,
    area: f32,
    demand: Demand,
    /// Nominal texels per mesh unit, those of the demand.
    density: f32,
    /// In nominal texels.
    region: Region,
    /// Error per area.
    error: f32,
    cost: f32,
    fans: u32,
    steepest_fan: f32,
    longest_spoke: f32,
    mergeable: bool,
}

#[derive(Clone, Copy, Debug)]
struct Proposal {
    saved: f32,
    small: u32,
    partner: u32,
    /// Common triangles.
    common: u32,
}

/// For every patch the patch that it joins (itself, for those that stay): a forest of depth one.
pub(crate) fn choose_unions(
    fans: &Fans,
    patches: &[Patch],
    fan_groups: &[AtomicU32],
    borders: &mut Borders,
    limits: &MergeLimits,
) -> Vec<u32> {
    let neighbours = borders.neighbours(fans, fan_groups, patches.len());
    let count = patches.len();
    let mut merger = Merger {
        summaries: patches.par_iter().map(|p| Some(Summary::of(p))).collect(),
        neighbours,
        joined: (0..count as u32).collect(),
        chains: (0..count as u32).map(|g| Chain { next: NONE, last: g }).collect(),
        changed_in: vec![0; count],
        known: vec![Known::new(); count],
        limits: *limits,
    };
    let mut changed = merger.joined.clone();
    let mut proposals: Vec<Proposal> = Vec::new();
    for round in 0..limits.rounds {
        let propose = |borders: &mut Vec<(u32, u32)>, &g: &u32| merger.propose(g, round, borders);
        let asked: Vec<(Option<Proposal>, Known)> = changed.par_iter().map_init(Vec::new, propose).collect();
        for (&g, (proposal, known)) in changed.iter().zip(asked) {
            merger.known[g as usize] = known;
            proposals.extend(proposal);
        }
        if proposals.is_empty() {
            break;
        }
        proposals.par_sort_unstable_by(|a, b| b.saved.total_cmp(&a.saved).then(a.small.cmp(&b.small)));
        let taken = merger.accept(&proposals, round);
        let is_stale = |p: &Proposal| taken[p.small as usize] || taken[p.partner as usize];
        changed = proposals.iter().filter(|p| is_stale(p)).map(|p| merger.joined[p.small as usize]).collect();
        changed.par_sort_unstable();
        changed.dedup();
        proposals.retain(|p| !is_stale(p));
    }
    merger.joined
}

struct Merger<'p> {
    /// `None` for groups that have joined another.
    summaries: Vec<Option<Summary<'p>>>,
    /// Of every group as it was at first.
    neighbours: Neighbours,
    /// The group that each group has ended up in.
    joined: Vec<u32>,
    /// The groups that have joined each group.
    chains: Vec<Chain>,
    /// The first round in which each group was as it is.
    changed_in: Vec<u32>,
    /// Of each group.
    known: Vec<Known>,
    limits: MergeLimits,
}

/// Groups that are one, one after the other, as the first of them knows.
#[derive(Clone, Copy)]
struct Chain {
    /// The group after this one, or `NONE`.
    next: u32,
    last: u32,
}

const NONE: u32 = u32::MAX;

/// What unions of a group with others cost, `None` for those that may not be.
type Known = ArrayVec<(Other, Option<f32>), CANDIDATES>;

/// A group, and the round in which the cost of a union with it was found.
#[derive(Clone, Copy)]
struct Other {
    group: u32,
    round: u32,
}

impl Merger<'_> {
    /// The union of a small group with a neighbour that saves most texels, and what unions cost.
    fn propose(&self, small: u32, round: u32, borders: &mut Vec<(u32, u32)>) -> (Option<Proposal>, Known) {
        let (mut best, mut known): (Option<Proposal>, Known) = Default::default();
        let Some(summary) = self.summaries[small as usize].as_ref().filter(|summary| summary.mergeable)
        else {
            return (best, known);
        };
        self.longest_borders(small, borders);
        for &(partner, common) in borders.iter() {
            let Some(other) = self.summaries[partner as usize].as_ref() else { continue };
            let since = self.changed_in[small as usize].max(self.changed_in[partner as usize]);
            let is_it = |(other, _): &&(Other, _)| other.group == partner && other.round >= since;
            let (at, cost) = match self.known[small as usize].iter().find(is_it) {
                Some(&known) => known,
                None => (Other { group: partner, round }, summary.union_cost(other, common, &self.limits)),
            };
            known.push((at, cost));
            let Some(cost) = cost else { continue };
            let saved = summary.cost + other.cost - cost;
            if saved > 0.0 && best.is_none_or(|b| saved > b.saved) {
                best = Some(Proposal { saved, small, partner, common });
            }
        }
        (best, known)
    }

    /// The neighbours of a group with the longest common borders, with the triangles there.
    fn longest_borders(&self, group: u32, borders: &mut Vec<(u32, u32)>) {
        let now = |&(g, triangles): &(u32, u32)| (self.joined[g as usize], triangles);
        borders.clear();
        let mut member = group;
        while member != NONE {
            let around = self.neighbours.of(member as usize).iter().map(now);
            borders.extend(around.filter(|border| border.0 != group));
            member = self.chains[member as usize].next;
        }
        sum_by_name(borders);
        borders.sort_unstable_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        borders.truncate(CANDIDATES);
    }

    /// Takes proposals greedily, each group at most once; tells which groups were taken.
    fn accept(&mut self, proposals: &[Proposal], round: u32) -> Vec<bool> {
        let mut taken = vec![false; self.joined.len()];
        let mut accepted = Vec::new();
        for p in proposals {
            let pair = [p.small as usize, p.partner as usize];
            if !pair.iter().any(|&g| taken[g]) {
                pair.iter().for_each(|&g| taken[g] = true);
                accepted.push(*p);
            }
        }
        let summaries = &self.summaries;
        let unions: Vec<Option<Summary<'_>>> = accepted
            .par_iter()
            .map(|p| {
                let (partner, small) =
                    (summaries[p.partner as usize].as_ref()?, summaries[p.small as usize].as_ref()?);
                partner.union(small, p.common)
            })
            .collect();
        for (&Proposal { small, partner, .. }, union) in accepted.iter().zip(unions) {
            self.summaries[small as usize] = None;
            self.summaries[partner as usize] = union;
            self.changed_in[partner as usize] = round + 1;
            let [of_partner, of_small] = [partner, small].map(|g| self.chains[g as usize].last);
            self.chains[of_partner as usize].next = small;
            self.chains[partner as usize].last = of_small;
            let mut member = small;
            while member != NONE {
                self.joined[member as usize] = partner;
                member = self.chains[member as usize].next;
            }
        }
        taken
    }
}

impl<'p> Summary<'p> {
    fn of(patch: &'p Patch) -> Self {
        let Flat { frame, region, cos, distortion, outline, .. } = &patch.flat;
        let region = region.scaled(Vec2::splat(patch.density));
        let squared = patch.density * patch.density;
        let area = distortion.area();
        let error = distortion.error(Vec2::ONE);
        Self {
            cone: WideCone { axis: frame.direction, half_angle: libm::acosf(cos.clamp(-1.0, 1.0)) },
            outline: shortened(outline, frame.direction),
            direction: frame.direction,
            area,
            demand: patch.demand,
            density: patch.density,
            error: if area > 0.0 { error / area } else { 1.0 },
            cost: cost::cost(error * squared, &region),
            region,
            fans: patch.length,
            steepest_fan: patch.steepest_fan,
            longest_spoke: patch.longest_spoke,
            mergeable: patch.layout == Layout::Projected,
        }
    }

    /// The cost of a union, if it may be.
    fn union_cost(&self, other: &Summary<'p>, common: u32, limits: &MergeLimits) -> Option<f32> {
        if !other.mergeable {
            return None;
        }
        let steepest_fan = self.steepest_fan.min(other.steepest_fan);
        if libm::cosf(self.cone.union_angles(other.cone)?[0]) < facing_limit(limits.facing, steepest_fan) {
            return None;
        }
        let (_, density) = self.union_demand(other);
        let (direction, error) = self.union_error(other, density)?;
        let (texels, squared) = (self.area + other.area, density * density);
        let (texels, error) = (texels * squared, error * squared);
        // The cubes of the costs, which single precision does not hold of small sets.
        let [e, r, apart] = [error, texels, self.cost + other.cost].map(f64::from);
        if e * r * r >= apart * apart * apart {
            return None;
        }
        let size = bounding_size(self.planar_outline(other, direction)) * density;
        let region = self.union_region(other, direction, size, common, density);
        let longest_spoke = self.longest_spoke.max(other.longest_spoke) * density;
        may_share(size, longest_spoke, limits.extent_texels).then(|| cost::cost(error, &region))
    }

    /// What both ask for together, and the density of that.
    fn union_demand(&self, other: &Summary<'p>) -> (Demand, f32) {
        let mut demand = self.demand;
        demand.add(&other.demand);
        // What asks for one density together asks for that.
        let is_one = self.density == other.density;
        let density = if is_one { self.density } else { demand.density().unwrap_or(self.density) };
        (demand, density)
    }

    /// The direction and the error (in mesh units) of a union at a density.
    fn union_error(&self, other: &Summary<'p>, density: f32) -> Option<(Vec3, f32)> {
        let parts = [self, other].map(|part| {
            let ratio = part.density / density;
            let squared = ratio * ratio;
            (part, part.area * squared * squared * squared)
        });
        let facets = parts.map(|(part, weighted)| (part.direction, weighted));
        let mean = facets.iter().map(|&(direction, weighted)| direction * weighted).sum::<Vec3>();
        let direction = cost::direction(facets.into_iter(), mean.try_normalize()?);
        let error = parts
            .iter()
            .map(|(part, weighted)| weighted * part.error * cost::error_at(part.direction.dot(direction)));
        Some((direction, error.sum()))
    }

    /// A guess: the outlines of both without what they share, but no shorter than a convex region's.
    fn union_region(
        &self,
        other: &Summary<'p>,
        direction: Vec3,
        size: Vec2,
        common: u32,
        density: f32,
    ) -> Region {
        let parts = [self, other].map(|s| (s, s.region.scaled(Vec2::splat(density / s.density))));
        let (fans, texels) = ((self.fans + other.fans) as f32, (self.area + other.area) * density * density);
        let shared = shared_outline(common, texels, fans);
        let area: f32 =
            parts.iter().map(|(s, region)| region.area * s.direction.dot(direction).max(0.0)).sum();
        let convex = 2.0 * (std::f32::consts::PI * area).sqrt();
        let outline: f32 = parts.iter().map(|(_, region)| region.outline).sum();
        Region { size, area, outline: (outline - 2.0 * shared).max(convex) }
    }

    fn union(&self, other: &Summary<'p>, common: u32) -> Option<Summary<'p>> {
        let cone = self.cone.union(other.cone)?;
        let (demand, density) = self.union_demand(other);
        let (direction, error) = self.union_error(other, density)?;
        let planar: Vec<Vec2> = self.planar_outline(other, direction).collect();
        let size = bounding_size(planar.iter().copied()) * density;
        let region = self.union_region(other, direction, size, common, density);
        let spatial: Vec<Vec3> = self.outline.iter().chain(&*other.outline).copied().collect();
        let area = self.area + other.area;
        Some(Summary {
            cone,
            outline: extreme_points(&planar).map(|i| spatial[i]).collect(),
            direction,
            area,
            demand,
            density,
            cost: cost::cost(error * density * density, &region),
            error: error / area.max(f32::MIN_POSITIVE),
            region,
            fans: self.fans + other.fans,
            steepest_fan: self.steepest_fan.min(other.steepest_fan),
            longest_spoke: self.longest_spoke.max(other.longest_spoke),
            mergeable: true,
        })
    }

    fn planar_outline<'a>(
        &'a self,
        other: &'a Summary<'p>,
        direction: Vec3,
    ) -> impl Iterator<Item = Vec2> + use<'a, 'p> {
        let (x, y) = direction.any_orthonormal_pair();
        self.outline.iter().chain(&*other.outline).map(move |p| Vec2::new(p.dot(x), p.dot(y)))
    }
}

/// The length of the outline between patches with so many common triangles, of so many fans: the line through the middles of edges in a mesh of
/// equilateral triangles.
pub(crate) fn shared_outline(common: u32, texels: f32, fans: f32) -> f32 {
    common as f32 * 0.5 * (2.0 / 3.0f32.sqrt() * texels / fans).sqrt()
}

/// The size of the smallest bounding rectangle among eight rotations.
fn bounding_size(points: impl Iterator<Item = Vec2>) -> Vec2 {
    let axis = |i: usize| directions()[i];
    let mut bounds = [0, 4].map(|i| FourBounds::along([axis(i), axis(i + 1), axis(i + 2), axis(i + 3)]));
    for p in points {
        bounds.iter_mut().for_each(|four| four.add(p));
    }
    let mut best = Vec2::INFINITY;
    for [widths, heights] in bounds.map(|four| four.sizes().map(|s| s.to_array())) {
        for size in std::iter::zip(widths, heights).map(Vec2::from) {
            if size.x * size.y < best.x * best.y {
                best = size;
            }
        }
    }
    best
}

/// Directions in which an outline keeps its farthest point, so that outlines do not grow with each union. The first
/// quarter of them are the rotations tried for a rectangle.
const DIRECTIONS: usize = 32;

/// Unit vectors all around.
fn directions() -> &'static [Vec2; DIRECTIONS] {
    static TABLE: LazyLock<[Vec2; DIRECTIONS]> = LazyLock::new(|| {
        std::array::from_fn(|i| unit_vector(i as f32 * std::f32::consts::TAU / DIRECTIONS as f32))
    });
    &TABLE
}

/// An outline is looked at with each neighbour, of which a group may have as many as its outline has points: of longer ones only the farthest are
/// kept.
const MAX_OUTLINE: usize = 4 * DIRECTIONS;

fn shortened(outline: &[Vec3], direction: Vec3) -> Cow<'_, [Vec3]> {
    if outline.len() <= MAX_OUTLINE {
        return outline.into();
    }
    let (x, y) = direction.any_orthonormal_pair();
    let planar: Vec<Vec2> = outline.iter().map(|p| Vec2::new(p.dot(x), p.dot(y))).collect();
    extreme_points(&planar).map(|i| outline[i]).collect()
}

/// Indices of the points that lie farthest in any of the directions, ascending; of equally far ones the first.
fn extreme_points(points: &[Vec2]) -> impl Iterator<Item = usize> + use<> {
    let mut kept = [0; DIRECTIONS];
    for (four, kept) in directions().as_chunks::<4>().0.iter().zip(kept.as_chunks_mut::<4>().0) {
        let (x, y) = (Vec4::from(four.map(|d| d.x)), Vec4::from(four.map(|d| d.y)));
        let mut most = Vec4::NEG_INFINITY;
        for (i, p) in points.iter().enumerate() {
            let along = x * p.x + y * p.y;
            let is_more = along.cmpgt(most);
            if is_more.any() {
                (0..4).filter(|&k| is_more.test(k)).for_each(|k| kept[k] = i);
                most = Vec4::select(is_more, along, most);
            }
        }
    }
    kept.sort_unstable();
    let mut last = usize::MAX;
    kept.into_iter().filter(move |&i| std::mem::replace(&mut last, i) != i)
}

/// A cone by its angle, which unions are computed with.
#[derive(Clone, Copy, Debug)]
struct WideCone {
    /// Unit axis.
    axis: Vec3,
    /// In radians, at most half a turn.
    half_angle: f32,
}

impl WideCone {
    /// The half angle of the narrowest cone that holds two cones, and the angle between their axes; `None` where it is wider than a hemisphere.
    fn union_angles(self, other: Self) -> Option<[f32; 2]> {
        let between = libm::acosf(self.axis.dot(other.axis).clamp(-1.0, 1.0));
        let wider = self.half_angle.max(other.half_angle);
        let narrower = self.half_angle.min(other.half_angle);
        if between < 1e-6 || between + narrower <= wider {
            return Some([wider, between]);
        }
        let half_angle = 0.5 * (self.half_angle + other.half_angle + between);
        (half_angle < std::f32::consts::FRAC_PI_2).then_some([half_angle, between])
    }

    /// The narrowest cone that holds two cones; `None` where it is wider than a hemisphere.
    fn union(self, other: Self) -> Option<Self> {
        let [half_angle, between] = self.union_angles(other)?;
        let wider = if self.half_angle >= other.half_angle { self } else { other };
        if half_angle <= wider.half_angle {
            return Some(wider);
        }
        // The axis lies on the arc between the two, `turn` away from the first.
        let turn = half_angle - self.half_angle;
        let axis = self.axis * libm::sinf(between - turn) + other.axis * libm::sinf(turn);
        Some(Self { axis: axis.try_normalize()?, half_angle })
    }
}

/// Makes entries with the same name (the first number) one that has the sum of their counts (the second), ascending by name. By sorting: a
/// group may have very many neighbours.
pub(crate) fn sum_by_name(counts: &mut Vec<(u32, u32)>) {
    counts.sort_unstable();
    counts.dedup_by(|next, kept| {
        let is_same = next.0 == kept.0;
        kept.1 += if is_same { next.1 } else { 0 };
        is_same
    });
}

/// The triangles between groups that only grow: once it is known which they are, no others need be looked at.
#[derive(Default)]
pub(crate) struct Borders(Option<Vec<u32>>);

impl Borders {
    /// For every group its neighbours. Groups that were one are so still.
    pub(crate) fn neighbours(
        &mut self,
        fans: &Fans,
        fan_groups: &[AtomicU32],
        group_count: usize,
    ) -> Neighbours {
        let groups_of = |t: u32| {
            let group = |fan: u32| fan_groups[fan as usize].load(Relaxed);
            let [a, b, c] = fans.of_triangle(t as usize);
            [group(a), group(b), group(c)]
        };
        let is_between = |t: &u32| {
            let [a, b, c] = groups_of(*t);
            a != b || b != c
        };
        let triangles: Vec<u32> = match &self.0 {
            Some(known) => known.par_iter().with_min_len(1 << 12).copied().filter(is_between).collect(),
            None => {
                let all = (0..fans.triangle_count() as u32).into_par_iter();
                all.with_min_len(1 << 12).filter(is_between).collect()
            }
        };
        let mut pairs: Vec<u64> = triangles
            .par_iter()
            .with_min_len(1 << 12)
            .flat_map_iter(|&t| {
                let [a, b, c] = groups_of(t);
                // With two groups in a triangle only one of the three pairs is kept.
                let pairs = [(a, b, a != b), (b, c, b != c && c != a), (c, a, c != a && a != b && b != c)];
                let pairs = pairs.into_iter().filter(|pair| pair.2);
                pairs.map(|(x, y, _)| u64::from(x.min(y)) << 32 | u64::from(x.max(y)))
            })
            .collect();
        pairs.par_sort_unstable();
        self.0 = Some(triangles);
        Neighbours::of_pairs(&pairs, group_count)
    }
}

/// For every group its neighbours with the number of common triangles, ascending.
pub(crate) struct Neighbours {
    /// Where the row of a group ends.
    ends: Vec<u32>,
    rows: Vec<(u32, u32)>,
}

impl Neighbours {
    /// Ascending pairs of groups, the lower in the upper half of a number, one for each triangle.
    fn of_pairs(pairs: &[u64], group_count: usize) -> Self {
        let runs = || {
            pairs
                .chunk_by(|a, b| a == b)
                .map(|run| ((run[0] >> 32) as usize, run[0] as u32 as usize, run.len()))
        };
        let mut ends = vec![0_u32; group_count];
        for (a, b, _) in runs() {
            ends[a] += 1;
            ends[b] += 1;
        }
        let mut count = 0;
        for end in &mut ends {
            count += std::mem::replace(end, count);
        }
        // These are starts; filling moves each to its end.
        let mut rows = vec![(0, 0); count as usize];
        for (a, b, triangles) in runs() {
            for (own, other) in [(a, b), (b, a)] {
                rows[ends[own] as usize] = (other as u32, triangles as u32);
                ends[own] += 1;
            }
        }
        Self { ends, rows }
    }

    pub(crate) fn of(&self, group: usize) -> &[(u32, u32)] {
        let start = group.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.rows[start as usize..self.ends[group] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn counts_of_one_name_are_summed() {
        let mut counts = vec![(7, 1), (2, 5), (7, 3), (0, 1), (2, 1), (7, 1)];
        sum_by_name(&mut counts);
        assert_eq!(counts, [(0, 1), (2, 6), (7, 5)]);
    }

    proptest! {
        #[test]
        fn a_union_of_cones_holds_both(z in -1f32..1.0, angle in 0f32..6.3, half_a in 0f32..0.7, half_b in 0f32..0.7, turn in 0f32..6.3) {
            let r = (1.0 - z * z).sqrt();
            let a = WideCone { axis: Vec3::Z, half_angle: half_a };
            let b = WideCone { axis: Vec3::new(r * angle.cos(), r * angle.sin(), z), half_angle: half_b };
            if let Some(union) = a.union(b) {
                for (cone, half) in [(a, half_a), (b, half_b)] {
                    let (x, y) = cone.axis.any_orthonormal_pair();
                    let rim = cone.axis * half.cos() + (x * turn.cos() + y * turn.sin()) * half.sin();
                    prop_assert!(rim.dot(union.axis) >= union.half_angle.cos() - 2e-3);
                }
            }
        }
    }
}
