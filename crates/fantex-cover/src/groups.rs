//! From fans to groups that are laid flat.

use std::collections::BTreeSet;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use arrayvec::ArrayVec;
use fantex_base::Result;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::MAX_EXTENT;
use crate::connect::Connector;
use crate::cost::least_unfolded_cost;
use crate::fan_shape::{FanShape, Layout};
use crate::flatten::{Flat, FlatLimits, Flattener, Laid, Membership};
use crate::islands::{FLAT_COSINE, Islands};
use crate::merge::{Borders, MergeLimits, choose_unions, shared_outline};
use crate::nominal::{Demand, NominalDensity};
use crate::partition::{Cutting, FanSet, Partition, partition};
use crate::surface::Surface;
use crate::unroll::{FlatCorners, Lying, MAX_CORNERS};
use crate::watch::{Watch, time};

/// How groups may grow.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroupLimits {
    pub(crate) delta: f32,
    /// Target tile extent in texels.
    pub(crate) extent_texels: f32,
    /// Smallest cosine between a group's direction and its triangles' normals.
    pub(crate) facing: f32,
}

/// One group while the cover is built.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// The group's fans are `order[start..start + length]`.
    pub(crate) start: u32,
    pub(crate) length: u32,
    pub(crate) flat: Flat,
    pub(crate) layout: Layout,
    /// Where the corners of an unfolded patch lie.
    corners: FlatCorners,
    pub(crate) demand: Demand,
    /// Nominal texels per mesh unit, those of the demand.
    pub(crate) density: f32,
    /// Smallest facing cosine that one of its fans reaches alone.
    pub(crate) steepest_fan: f32,
    /// Length of the longest spoke of its fans, mesh units.
    pub(crate) longest_spoke: f32,
}

impl Patch {
    fn fans<'a>(&self, order: &'a [u32]) -> &'a [u32] {
        &order[self.start as usize..(self.start + self.length) as usize]
    }

    /// Whether it is all of a component that lies in a plane.
    fn is_island(&self, order: &[u32], islands: &Islands) -> bool {
        islands.has(order[self.start as usize], self.length)
    }

    fn laid(self, order: &[u32], density: &NominalDensity<'_>) -> Laid {
        let Flat { frame, min, region, distortion, .. } = self.flat;
        let fan = order[self.start as usize];
        let factor = if density.is_total() {
            distortion.density(region.scaled(Vec2::splat(self.density)), self.density * self.density)
        } else {
            distortion.density_for_nominal() * self.demand.factor_for_own()
        };
        let density = distortion.aspect() * factor * self.density;
        let Self { layout, corners, length, .. } = self;
        Laid { frame, min, region, density, fan, fans: length, layout, corners, folds: false }
    }

    /// See [`cost`](crate::cost).
    pub(crate) fn cost(&self) -> f32 {
        flat_cost(&self.flat, self.density, self.corners.len())
    }

    /// Texels that its surface asks for.
    fn texels(&self) -> f32 {
        self.flat.distortion.area() * self.density * self.density
    }

    /// The density of two patches as one.
    fn density_with(&self, other: &Self) -> f32 {
        let mut demand = self.demand;
        demand.add(&other.demand);
        demand.density().unwrap_or(self.density)
    }
}

/// What a group costs at a density, with so many unfolded corners.
fn flat_cost(flat: &Flat, density: f32, corners: usize) -> f32 {
    flat.distortion.cost(flat.region.scaled(Vec2::splat(density)), density * density, corners)
}

/// The filter margin of both sides, mesh units.
pub(crate) fn pad(density: f32) -> f32 {
    1.0 / density.max(f32::MIN_POSITIVE)
}

/// The groups of a mesh, before tiles are sized.
pub(crate) struct Grouping {
    /// Along a space-filling curve.
    pub(crate) laid: Vec<Laid>,
    /// Group of each fan.
    pub(crate) fan_groups: Vec<u32>,
}

/// Groups the fans of a surface. The watch has heard [what to expect](expect_groups).
pub(crate) fn group_fans(
    surface: &Surface<'_>,
    shapes: &[FanShape],
    density: &NominalDensity<'_>,
    limits: &GroupLimits,
    watch: &Watch<'_>,
) -> Result<Grouping> {
    let is_small = shapes.len() <= SMALL_MESH_FANS;
    let is_flat = is_small || shapes.len() <= MAX_UNROLLED_FLAT_FANS && flat_share(shapes) > MIN_FLAT_SHARE;
    let most = if is_flat { MAX_UNROLLED_FLAT_FANS } else { MAX_UNROLLED_FANS };
    let ways = if shapes.len() > most {
        &WAYS[..1]
    } else if is_flat {
        &WAYS[..]
    } else {
        &WAYS[..2]
    };
    expect_ways(watch, ways.len());
    let fans = FanSet { surface, shapes, density };
    let mut cut: Option<([f32; 2], Partition)> = None;
    let extent_texels = (WIDER * limits.extent_texels).min(MAX_SHARED_LENGTH.max(limits.extent_texels));
    let wide = GroupLimits { extent_texels, ..*limits };
    let mut tried = |number: usize, way: usize, is_wide: bool| {
        let limits = if is_wide { &wide } else { limits };
        let GroupLimits { extent_texels, .. } = *limits;
        let (normals_below, k) = ways[way];
        watch.begin(time::grouped(number) + time::CUT, shapes.len())?;
        let by = [normals_below, extent_texels];
        let (_, partition) = match cut.take().filter(|(other, _)| *other == by) {
            Some(cut) => cut,
            None => {
                let cutting = Cutting {
                    extent_texels,
                    tolerances: TOLERANCES,
                    normals_below,
                    is_thorough: is_small,
                    watch,
                };
                (by, partition(&fans, &cutting))
            }
        };
        let (order, lengths) = &cut.insert((by, partition)).1;
        grouped(fans, limits, (order, &lengths[k]), (number, watch))
    };
    let mut best = tried(0, 0, false)?;
    let is_lossy = best.loss(&Islands::default()) > LOSSY_DB;
    let islands = if is_small || !is_lossy { Islands::default() } else { Islands::of(surface, shapes) };
    let may_gain = is_small || shapes.len() <= most && best.loss(&islands) > LOSSY_DB;
    let mut count = if may_gain { ways.len() } else { 1 };
    expect_ways(watch, count);
    for number in 1..count {
        let next = tried(number, number, false)?;
        best = if next.cost < best.cost { next } else { best };
    }
    let is_torn = limits.extent_texels >= MIN_TORN_EXTENT && best.loss(&islands) > TORN_DB;
    if may_gain && is_torn && extent_texels > limits.extent_texels {
        let next = tried(count, 0, true)?;
        best = if next.loss(&islands) < best.loss(&islands) - LOSSY_DB { next } else { best };
        count += 1;
        expect_ways(watch, count);
    }
    drop(cut);
    let Grouped { mut builder, mut patches, .. } = best;
    let is_tried = if may_gain {
        patches.iter().map(|patch| !patch.is_island(&builder.order, &islands)).collect()
    } else {
        builder.dear(&patches, &islands)
    };
    if is_tried.contains(&true) {
        watch.expect(time::grouped(count) + time::UNROLLING + time::SIZING);
        builder.unroll_unions(&mut patches, &is_tried, may_gain, time::grouped(count))?;
        builder.number_groups(&patches);
    }
    let laid = patches.into_iter().map(|patch| patch.laid(&builder.order, density)).collect();
    let fan_groups = builder.fan_groups.into_iter().map(AtomicU32::into_inner).collect();
    Ok(Grouping { laid, fan_groups })
}

/// Tells how long a cover of so many fans takes at most, most probably.
pub(crate) fn expect_groups(watch: &Watch<'_>, fans: usize) {
    expect_ways(watch, if fans > MAX_UNROLLED_FLAT_FANS { 1 } else { WAYS.len() });
}

/// Several ways are for meshes that are laid flat freely.
fn expect_ways(watch: &Watch<'_>, ways: usize) {
    let unrolling = if ways > 1 { time::UNROLLING } else { 0.0 };
    watch.expect(time::grouped(ways) + unrolling + time::SIZING);
}

/// Meshes of at most so many fans are cut in all ways and laid flat freely.
const SMALL_MESH_FANS: usize = 20_000;

/// Those of at most so many are laid flat freely where the first way loses much: steep places of height fields, noise, fine structures. They gain one to
/// three decibels; scans that lose less would gain a tenth of a decibel in twice the time.
const MAX_UNROLLED_FANS: usize = 200_000;

/// The same of models with flat faces, which are also cut in all ways.
const MAX_UNROLLED_FLAT_FANS: usize = 500_000;

/// Decibels beside as many ideal texels.
const LOSSY_DB: f32 = 2.5;

/// Meshes that lose so many decibels may be torn, as combs are whose teeth are longer than a tile: each is a piece by itself.
const TORN_DB: f32 = 6.0;

/// They are tried with tiles that are longer by this factor.
const WIDER: f32 = 8.0;

/// Tiles shorter than this, in texels, stay so: who asks for small ones loses much, and wants them.
const MIN_TORN_EXTENT: f32 = 512.0;

/// The share of the area around vertices where nothing is bent, above which a model has flat faces.
const MIN_FLAT_SHARE: f32 = 0.25;

/// The share of the area around vertices where nothing is bent.
fn flat_share(shapes: &[FanShape]) -> f32 {
    let (mut flat, mut all) = (0.0, 0.0);
    for shape in shapes {
        let area = f64::from(shape.area);
        all += area;
        flat += if shape.cone.cos > FLAT_COSINE { area } else { 0.0 };
    }
    (flat / all) as f32
}

// On other meshes only small groups that are dear are laid flat freely.

/// Small groups have so many fans at most.
const MAX_SMALL_GROUP_FANS: u32 = 16;

/// Dear ones cost at least so many times their texels: 3 dB are lost.
const DEAR_COST_PER_TEXEL: f32 = 1.25;

/// So much of the whole cost must be lost in small groups that are dear: rough scans, where less is, gain 0.2 dB in a fifth more time.
const MIN_DEAR_LOSS_SHARE: f64 = 0.15;

/// Of groups that are small and dear so many fans are laid flat freely, those first that cost most.
const MAX_DEAR_FANS: usize = 500_000;

/// The groups found in one way, and what they cost.
struct Grouped<'a> {
    cost: f32,
    builder: Builder<'a>,
    patches: Vec<Patch>,
}

impl Grouped<'_> {
    /// Decibels beside as many ideal texels, whose cost is their number (see [`cost`](crate::cost)), without those of islands; 0 where all are.
    fn loss(&self, islands: &Islands) -> f32 {
        let (mut cost, mut texels) = (0.0, 0.0);
        for patch in self.patches.iter().filter(|patch| !patch.is_island(&self.builder.order, islands)) {
            cost += patch.cost();
            texels += patch.texels();
        }
        if texels > 0.0 { 30.0 * libm::log10f(cost / texels) } else { 0.0 }
    }
}

/// How much dearer parts may be that sets are cut into.
const TOLERANCES: [f32; 2] = [1.03, 1.15];

/// Ways to cut: whether long sets are cut between their normals, and with which tolerance. The first is best for nearly all
/// scans, the second for some meshes that are laid flat freely; which is best for a model of flat faces or few large triangles is found by trying
/// (the last one is for rods, pipes and corrugated sheets). Ways that differ by tolerance alone follow each other, as sets are cut once for them.
const WAYS: [(f32, usize); 5] = [(768.0, 0), (768.0, 1), (f32::INFINITY, 0), (f32::INFINITY, 1), (0.0, 0)];

/// `number` of the ways that are tried before this one.
fn grouped<'a>(
    fans: FanSet<'a>,
    limits: &'a GroupLimits,
    (order, lengths): (&[u32], &[u32]),
    (number, watch): (usize, &'a Watch<'a>),
) -> Result<Grouped<'a>> {
    let FanSet { surface, shapes, density } = fans;
    let (begun, count) = (time::grouped(number), shapes.len());
    watch.begin(begun + time::CONNECTED, 0)?;
    let mut connector = Connector::new(fans);
    let (order, lengths) = connector.connect(order, lengths, limits.facing);
    let fan_groups = (0..count).map(|_| AtomicU32::new(0)).collect();
    let apart = surface.fans_across_creases();
    let mut builder = Builder {
        surface,
        shapes,
        density,
        limits,
        connector,
        order,
        fan_groups,
        unused_label: 0,
        refused: BTreeSet::new(),
        apart,
        watch,
    };
    watch.begin(begun + time::FLATTENED, count)?;
    let mut patches = builder.flatten(Pieces::consecutive(lengths));
    builder.number_groups(&patches);
    let (times, rounds) = if count <= SMALL_MESH_FANS { JOINING_SMALL } else { JOINING };
    let merge_limits = MergeLimits { extent_texels: limits.extent_texels, facing: limits.facing, rounds };
    let (mut borders, mut left) = (Borders::default(), time::JOINED - time::FLATTENED);
    for _ in 0..times {
        left *= time::LEFT_PER_ROUND;
        watch.begin(begun + time::JOINED - left, count)?;
        let joined = choose_unions(&surface.fans, &patches, &builder.fan_groups, &mut borders, &merge_limits);
        let before = patches.len();
        patches = builder.join(patches, &joined);
        builder.number_groups(&patches);
        if patches.len() as f32 > 0.995 * before as f32 {
            break;
        }
    }
    watch.begin(time::grouped(number + 1), patches.len())?;
    builder.unfold_lone_fans(&mut patches);
    let cost = patches.iter().map(Patch::cost).sum();
    Ok(Grouped { cost, builder, patches })
}

/// Unions are chosen by summaries, in so many rounds at most, and then laid flat; and that so many times, `(times, rounds)`. Large groups are laid flat
/// whole, however little joins them, so it pays to choose all that joins them before.
const JOINING: (usize, u32) = (2, 32);

/// The same of small meshes. Where all is made of boxes whole unions fail for one of their parts; small ones are laid flat sooner.
const JOINING_SMALL: (usize, u32) = (4, 4);

/// Runs of the order, `(start, length)`.
struct Pieces(Vec<(u32, u32)>);

impl Pieces {
    fn consecutive(lengths: Vec<u32>) -> Self {
        let mut start = 0;
        let pieces = lengths.into_iter().map(|length| {
            start += length;
            (start - length, length)
        });
        Self(pieces.collect())
    }
}

/// The state while patches are laid flat, halved and joined. Every patch is a run of `order`.
struct Builder<'a> {
    surface: &'a Surface<'a>,
    shapes: &'a [FanShape],
    density: &'a NominalDensity<'a>,
    limits: &'a GroupLimits,
    connector: Connector<'a>,
    /// All fans.
    order: Vec<u32>,
    /// A label per fan; equal in one patch, different in different patches. Threads write those of their own patches.
    fan_groups: Vec<AtomicU32>,
    /// Labels from here on are not in use.
    unused_label: u32,
    /// Unions that were undone: of each member the first fan and the number of its fans, which name it as patches only grow.
    refused: BTreeSet<Vec<(u32, u32)>>,
    /// Pairs of fans that must not share a tile, both ways around, ascending.
    apart: Vec<(u32, u32)>,
    watch: &'a Watch<'a>,
}

impl Builder<'_> {
    /// Lays every piece flat, halving those that cannot share a projection until all can. Ascending by start.
    fn flatten(&mut self, pieces: Pieces) -> Vec<Patch> {
        let mut patches: Vec<Patch> = Vec::new();
        let mut pending = pieces.0;
        while !pending.is_empty() {
            let first_label = self.unused_label;
            pending.par_iter().enumerate().with_min_len(1 << 8).for_each(|(i, &(start, length))| {
                self.label(&self.order[start as usize..(start + length) as usize], first_label + i as u32);
            });
            let flats: Vec<Option<Patch>> = pending
                .par_iter()
                .enumerate()
                .map_init(Flattener::default, |flattener, (i, &(start, length))| {
                    let flat = self.flatten_piece(start, length, first_label + i as u32, flattener)?;
                    self.watch.add(length as usize);
                    Some(flat)
                })
                .collect();
            self.unused_label += pending.len() as u32;
            let rejected: Vec<(u32, u32)> = flats
                .iter()
                .zip(&pending)
                .filter(|(flat, _)| flat.is_none())
                .map(|(_, &piece)| piece)
                .collect();
            if patches.is_empty() {
                // Collected in place.
                patches = flats.into_iter().flatten().collect();
            } else {
                patches.extend(flats.into_iter().flatten());
            }
            pending = rejected.into_iter().flat_map(|piece| self.halve(piece)).collect();
        }
        patches.sort_unstable_by_key(|p| p.start);
        patches
    }

    fn flatten_piece(&self, start: u32, length: u32, group: u32, flattener: &mut Flattener) -> Option<Patch> {
        let fans = &self.order[start as usize..(start + length) as usize];
        let (mut demand, mut steepest_fan, mut longest_spoke) = (Demand::default(), 1.0f32, 0.0f32);
        for &fan in fans {
            let shape = &self.shapes[fan as usize];
            demand.add(&Demand::of(shape.area, self.density.of_fan(self.surface, fan as usize)));
            steepest_fan = steepest_fan.min(shape.cone.cos);
            longest_spoke = longest_spoke.max(shape.longest_spoke);
        }
        let first = fans[0] as usize;
        let density = demand.density().unwrap_or_else(|| self.density.of_fan(self.surface, first));
        if self.must_part(fans, |fan| self.fan_groups[fan as usize].load(Relaxed) == group) {
            return None;
        }
        let membership = Membership { fan_groups: &self.fan_groups, group };
        let limits = FlatLimits {
            delta: self.limits.delta,
            pad: pad(density),
            facing: facing_limit(self.limits.facing, steepest_fan),
        };
        let shape = &self.shapes[first];
        let (flat, corners) = if shape.layout == Layout::Unfolded {
            flattener.unfold(self.surface, fans[0], shape.cone, &limits)?
        } else if fans.len() == 1 {
            (flattener.project_fan(self.surface, first, shape.cone, &limits), FlatCorners::default())
        } else {
            (flattener.project(self.surface, fans, membership, &limits)?, FlatCorners::default())
        };
        let layout = shape.layout;
        Some(Patch { start, length, flat, layout, corners, demand, density, steepest_fan, longest_spoke })
    }

    /// True where two of the fans must not share a tile.
    fn must_part(&self, fans: &[u32], is_member: impl Fn(u32) -> bool) -> bool {
        let parts = |&fan: &u32| {
            let from = self.apart.partition_point(|pair| pair.0 < fan);
            let mut others = self.apart[from..].iter().take_while(|pair| pair.0 == fan);
            others.any(|pair| is_member(pair.1))
        };
        !self.apart.is_empty() && fans.iter().any(parts)
    }

    /// Cuts a piece in two, and each half into connected components.
    fn halve(&mut self, (start, length): (u32, u32)) -> Vec<(u32, u32)> {
        let fans = &mut self.order[start as usize..(start + length) as usize];
        let halves = halve_by_length(self.surface, fans);
        let parts = self.connector.separate(&mut self.order, start as usize, &halves);
        Pieces::consecutive(parts).0.into_iter().map(|(at, n)| (start + at, n)).collect()
    }

    fn label(&self, fans: &[u32], label: u32) {
        fans.iter().for_each(|&fan| self.fan_groups[fan as usize].store(label, Relaxed));
    }

    /// Makes `fan_groups` agree with the order of the patches.
    fn number_groups(&mut self, patches: &[Patch]) {
        patches.par_iter().enumerate().with_min_len(1 << 8).for_each(|(group, patch)| {
            self.label(patch.fans(&self.order), group as u32);
        });
        self.unused_label = patches.len() as u32;
    }

    /// Brings the fans of joined patches together and lays the unions flat; those that cannot be, or cost more than their members, are
    /// undone. `joined` names each patch's union by one of its members.
    fn join(&mut self, patches: Vec<Patch>, joined: &[u32]) -> Vec<Patch> {
        let mut members: Vec<(u32, u32)> = joined.iter().copied().zip(0..).collect();
        members.par_sort_unstable();
        let mut unions: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        unions.par_sort_unstable_by_key(|union| union[0].1);
        let length =
            |union: &&[(u32, u32)]| -> u32 { union.iter().map(|&(_, p)| patches[p as usize].length).sum() };
        let runs = Pieces::consecutive(unions.iter().map(length).collect()).0;
        let mut order = vec![0; self.order.len()];
        let mut rest = order.as_mut_slice();
        let mut places = Vec::with_capacity(unions.len());
        for (&union, &(_, length)) in unions.iter().zip(&runs) {
            let (place, tail) = rest.split_at_mut(length as usize);
            places.push((union, place));
            rest = tail;
        }
        places.into_par_iter().with_min_len(1 << 8).for_each(|(union, place)| {
            let mut at = 0;
            for &(_, p) in union {
                let fans = patches[p as usize].fans(&self.order);
                place[at..at + fans.len()].copy_from_slice(fans);
                at += fans.len();
            }
        });
        let name = |&(_, p): &(u32, u32)| {
            let Patch { start, length, .. } = patches[p as usize];
            (self.order[start as usize], length)
        };
        let named = |union: &&[(u32, u32)]| -> Vec<(u32, u32)> {
            if union.len() < 2 { Vec::new() } else { union.iter().map(name).collect() }
        };
        let names: Vec<_> = unions.par_iter().with_min_len(1 << 8).map(named).collect();
        self.order = order;
        let first_label = self.unused_label;
        self.unused_label += runs.len() as u32;
        let laid: Vec<Option<Patch>> = (0..runs.len())
            .into_par_iter()
            .map_init(Flattener::default, |flattener, i| {
                let (start, length) = runs[i];
                self.watch.add(length as usize);
                if unions[i].len() < 2 || self.refused.contains(&names[i]) {
                    return None;
                }
                let label = first_label + i as u32;
                self.label(&self.order[start as usize..(start + length) as usize], label);
                let union = self.flatten_piece(start, length, label, flattener)?;
                let apart: f32 = unions[i].iter().map(|&(_, p)| patches[p as usize].cost()).sum();
                (union.cost() < apart).then_some(union)
            })
            .collect();
        let mut kept = Vec::with_capacity(patches.len());
        let mut patches: Vec<Option<Patch>> = patches.into_iter().map(Some).collect();
        for (((union, name), laid), &(mut start, _)) in unions.iter().zip(names).zip(laid).zip(&runs) {
            match laid {
                Some(patch) => kept.push(patch),
                None => {
                    if union.len() > 1 {
                        self.refused.insert(name);
                    }
                    for patch in union.iter().filter_map(|&(_, p)| patches[p as usize].take()) {
                        let length = patch.length;
                        kept.push(Patch { start, ..patch });
                        start += length;
                    }
                }
            }
        }
        kept
    }

    /// Unfolds fans that are alone in their group where that costs less than projecting them.
    fn unfold_lone_fans(&self, patches: &mut [Patch]) {
        patches.par_iter_mut().filter(|p| p.length == 1 && p.layout == Layout::Projected).for_each_init(
            Flattener::default,
            |flattener, patch| {
                let fan = patch.fans(&self.order)[0];
                let limits = self.free_limits(patch.density);
                let cone = self.shapes[fan as usize].cone;
                let Some((flat, corners)) = flattener.unfold(self.surface, fan, cone, &limits) else {
                    return;
                };
                let unfolded = Patch { flat, corners, layout: Layout::Unfolded, ..patch.clone() };
                if unfolded.cost() < patch.cost() {
                    *patch = unfolded;
                }
            },
        );
    }

    fn free_limits(&self, density: f32) -> FlatLimits {
        FlatLimits { delta: self.limits.delta, pad: pad(density), facing: 0.0 }
    }

    /// Which patches are small and dear, where much is lost in them.
    fn dear(&self, patches: &[Patch], islands: &Islands) -> Vec<bool> {
        let is_dear = |patch: &Patch| {
            patch.length <= MAX_SMALL_GROUP_FANS
                && patch.cost() >= DEAR_COST_PER_TEXEL * patch.texels()
                && !patch.is_island(&self.order, islands)
        };
        let lost_per_fan = |patch: &Patch| (patch.cost() - patch.texels()) / patch.length as f32;
        let numbered = patches.par_iter().zip(0..patches.len()).with_min_len(1 << 10);
        let mut dear: Vec<(f32, usize)> =
            numbered.filter(|(patch, _)| is_dear(patch)).map(|(patch, p)| (lost_per_fan(patch), p)).collect();
        dear.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut is_tried = vec![false; patches.len()];
        let (mut fans, mut lost) = (0, 0.0);
        for (lost_per_fan, p) in dear {
            let length = patches[p].length;
            fans += length as usize;
            if fans > MAX_DEAR_FANS {
                break;
            }
            is_tried[p] = true;
            lost += f64::from(lost_per_fan) * f64::from(length);
        }
        let cost: f64 = patches.iter().map(|patch| f64::from(patch.cost())).sum();
        if lost < MIN_DEAR_LOSS_SHARE * cost {
            is_tried.fill(false);
        }
        is_tried
    }

    /// Lays unions of neighbours flat freely where that costs less, of the patches that are tried. `is_thorough`: also those that only pay if they
    /// fill a square. `begun`: the time before.
    fn unroll_unions(
        &mut self,
        patches: &mut Vec<Patch>,
        is_tried: &[bool],
        is_thorough: bool,
        begun: f32,
    ) -> Result<()> {
        self.number_groups(patches);
        let all = Borders::default().neighbours(&self.surface.fans, &self.fan_groups, patches.len());
        let tried = |(p, &is_own): (usize, &bool)| {
            let around = all.of(p).iter().copied();
            around.filter(|&(other, _)| is_own && is_tried[other as usize]).collect()
        };
        let neighbours = is_tried.iter().enumerate().map(tried).collect();
        let mut unrolling = Unrolling {
            fans: patches.iter().map(|patch| patch.fans(&self.order).to_vec()).collect(),
            patches: std::mem::take(patches).into_iter().map(Some).collect(),
            neighbours,
            is_thorough,
            builder: self,
        };
        unrolling.run(is_tried, begun)?;
        let Unrolling { patches: unions, fans, .. } = unrolling;
        let mut order = Vec::with_capacity(self.order.len());
        for (patch, fans) in unions.into_iter().zip(fans) {
            if let Some(patch) = patch {
                patches.push(Patch { start: order.len() as u32, ..patch });
                order.extend(fans);
            }
        }
        self.order = order;
        Ok(())
    }
}

/// Patches that are laid flat freely and joined across creases, where no projection sees both sides.
struct Unrolling<'b> {
    builder: &'b Builder<'b>,
    /// `None` for those that have joined another.
    patches: Vec<Option<Patch>>,
    /// The fans of each.
    fans: Vec<Vec<u32>>,
    /// For every patch `(neighbour, common triangles)`. Those with which it cannot be joined are taken out, and those that are not tried.
    neighbours: Vec<Vec<(u32, u32)>>,
    is_thorough: bool,
}

/// Rounds of joining unrolled patches; in each a patch joins one other at most.
const UNROLLED_ROUNDS: usize = 32;

/// What unrolling must at least save.
const MIN_UNROLLING_GAIN: f32 = 0.02;

impl Unrolling<'_> {
    fn run(&mut self, is_tried: &[bool], begun: f32) -> Result<()> {
        let watch = self.builder.watch;
        watch.begin(begun + time::UNROLLED_ALONE, self.patches.len())?;
        let alone: Vec<Option<Patch>> = (0..self.patches.len() as u32)
            .into_par_iter()
            .map_init(Flattener::default, |flattener, p| {
                watch.add(1);
                if is_tried[p as usize] && self.may_gain(p) { self.unrolled(&[p], flattener) } else { None }
            })
            .collect();
        for (patch, alone) in self.patches.iter_mut().zip(alone).filter(|(_, alone)| alone.is_some()) {
            *patch = alone;
        }
        let mut proposals: Vec<Proposal> = Vec::new();
        let mut left = time::UNROLLING - time::UNROLLED_ALONE;
        for _ in 0..UNROLLED_ROUNDS {
            left *= time::LEFT_PER_ROUND;
            // Where all that is tried is too dear, the next best is tried.
            let Some(new) = self.propose(&proposals, begun + time::UNROLLING - left)? else { break };
            proposals.extend(new);
            proposals.par_sort_unstable_by(|a, b| b.saved.total_cmp(&a.saved).then(a.pair.cmp(&b.pair)));
            let mut taken = vec![false; self.patches.len()];
            let mut waiting = Vec::new();
            for proposal in proposals {
                let pair = proposal.pair.map(|p| p as usize);
                if pair.iter().any(|&p| taken[p]) {
                    waiting.push(proposal);
                } else {
                    pair.iter().for_each(|&p| taken[p] = true);
                    self.join(pair, proposal.union);
                }
            }
            waiting.retain(|proposal| !proposal.pair.iter().any(|&p| taken[p as usize]));
            proposals = waiting;
        }
        watch.check()
    }

    /// The unions that patches without one among `waiting` would choose; those that turn out too dear are not tried again. `until`: when that is
    /// done. `None` where nothing is left to try.
    fn propose(&mut self, waiting: &[Proposal], until: f32) -> Result<Option<Vec<Proposal>>> {
        let mut waits = vec![false; self.patches.len()];
        waiting.iter().flat_map(|proposal| proposal.pair).for_each(|p| waits[p as usize] = true);
        let patches = (0..waits.len() as u32).into_par_iter().filter(|&p| !waits[p as usize]);
        let mut pairs: Vec<[u32; 2]> = patches.filter_map(|p| self.best_pair(p)).collect();
        pairs.par_sort_unstable();
        pairs.dedup();
        if pairs.is_empty() && waiting.is_empty() {
            return Ok(None);
        }
        let watch = self.builder.watch;
        watch.begin(until, pairs.len())?;
        let tried = pairs.par_iter().map_init(Flattener::default, |flattener, &pair| {
            watch.add(1);
            let union = self.unrolled(&pair, flattener)?;
            let apart: f32 =
                pair.iter().filter_map(|&p| self.patches[p as usize].as_ref()).map(Patch::cost).sum();
            Some(Proposal { saved: apart - union.cost(), pair, union })
        });
        let tried: Vec<Option<Proposal>> = tried.collect();
        for (&[a, b], _) in pairs.iter().zip(&tried).filter(|(_, tried)| tried.is_none()) {
            self.neighbours[a as usize].retain(|n| n.0 != b);
            self.neighbours[b as usize].retain(|n| n.0 != a);
        }
        Ok(Some(tried.into_iter().flatten().collect()))
    }

    /// A patch and the neighbour with which it promises to save most, lower first.
    fn best_pair(&self, p: u32) -> Option<[u32; 2]> {
        let patch = self.patches[p as usize].as_ref()?;
        let mut best: Option<(f32, u32)> = None;
        for &(other, common) in &self.neighbours[p as usize] {
            let Some(neighbour) = &self.patches[other as usize] else { continue };
            let saved = patch.cost() + neighbour.cost() - self.promised_cost(patch, neighbour, common);
            if saved > 0.0 && best.is_none_or(|(most, _)| saved > most) {
                best = Some((saved, other));
            }
        }
        best.map(|(_, other)| [p.min(other), p.max(other)])
    }

    /// The least that two patches can cost as one: in blocks or, if all is tried, in a square without gaps, which small ones come near to.
    /// (A rough scan of 1 M triangles with 4 M texels would lose 0.3 dB less by squares, in half as much time again.)
    fn promised_cost(&self, a: &Patch, b: &Patch, common: u32) -> f32 {
        let density = a.density_with(b);
        let texels = (a.flat.distortion.area() + b.flat.distortion.area()) * density * density;
        let outline_of = |p: &Patch| p.flat.region.scaled(p.flat.distortion.aspect() * density).outline;
        let shared = shared_outline(common, texels, (a.length + b.length) as f32);
        let outline = outline_of(a) + outline_of(b) - 2.0 * shared;
        least_unfolded_cost(texels, outline, corner_count(a) + corner_count(b), self.is_thorough)
    }

    /// Whether a patch may cost less when it is unrolled by itself.
    fn may_gain(&self, p: u32) -> bool {
        let fans = &self.builder.surface.fans;
        let corners = self.fans[p as usize].iter().map(|&fan| fans.corners(fan as usize).len()).sum();
        self.patches[p as usize].as_ref().is_some_and(|patch| {
            least_unfolded_cost(patch.texels(), 0.0, corners, self.is_thorough)
                < (1.0 - MIN_UNROLLING_GAIN) * patch.cost()
        })
    }

    /// Patches laid flat freely as one, if that costs less. This takes long enough for a look at the watch.
    fn unrolled(&self, parts: &[u32], flattener: &mut Flattener) -> Option<Patch> {
        let builder = self.builder;
        if builder.watch.has_ended() {
            return None;
        }
        let patches = || parts.iter().filter_map(|&p| self.patches[p as usize].as_ref());
        let fans: Vec<u32> = parts.iter().flat_map(|&p| &self.fans[p as usize]).copied().collect();
        let corners: usize = fans.iter().map(|&fan| builder.surface.fans.corners(fan as usize).len()).sum();
        if corners > MAX_CORNERS || builder.must_part(&fans, |fan| fans.contains(&fan)) {
            return None;
        }
        let mut demand = Demand::default();
        patches().for_each(|p| demand.add(&p.demand));
        let first = patches().next()?;
        let density = demand.density().unwrap_or(first.density);
        let lying = |&p: &u32| {
            let Patch { flat, corners, .. } = self.patches[p as usize].as_ref()?;
            Some(Lying { fans: &self.fans[p as usize], frame: &flat.frame, corners })
        };
        let lying: ArrayVec<Lying<'_>, 2> = parts.iter().filter_map(lying).collect();
        let limits = builder.free_limits(density);
        let apart: f32 = patches().map(Patch::cost).sum();
        let ratio = |flat: &Flat, corners: usize| flat_cost(flat, density, corners) / apart;
        let (flat, corners) = flattener.unroll(builder.surface, &fans, &lying, &limits, ratio)?;
        let steepest_fan = patches().map(|p| p.steepest_fan).fold(1.0, f32::min);
        let longest_spoke = patches().map(|p| p.longest_spoke).fold(0.0, f32::max);
        let (length, layout) = (fans.len() as u32, Layout::Unfolded);
        let start = first.start;
        let union =
            Patch { start, length, flat, layout, corners, demand, density, steepest_fan, longest_spoke };
        let size = union.flat.region.size * density;
        let fits = may_share(size, longest_spoke * density, builder.limits.extent_texels);
        (fits && union.cost() < (1.0 - MIN_UNROLLING_GAIN) * apart).then_some(union)
    }

    fn join(&mut self, [a, b]: [usize; 2], union: Patch) {
        let fans = std::mem::take(&mut self.fans[b]);
        self.fans[a].extend(fans);
        self.patches[a] = Some(union);
        self.patches[b] = None;
        for (other, triangles) in std::mem::take(&mut self.neighbours[b]) {
            let around = &mut self.neighbours[other as usize];
            around.retain(|n| n.0 != b as u32);
            if other as usize == a {
                continue;
            }
            for (at, name) in [(other as usize, a as u32), (a, other)] {
                match self.neighbours[at].iter_mut().find(|n| n.0 == name) {
                    Some(n) => n.1 += triangles,
                    None => self.neighbours[at].push((name, triangles)),
                }
            }
        }
    }
}

/// How many corners an unfolded patch has, or would have, nearly.
fn corner_count(patch: &Patch) -> usize {
    patch.corners.len().max(MEAN_SPOKES * patch.length as usize)
}

/// Triangles around a vertex, nearly.
const MEAN_SPOKES: usize = 6;

/// A union of two patches.
struct Proposal {
    saved: f32,
    pair: [u32; 2],
    union: Patch,
}

/// Whether several fans may share a tile of this size, if the longest of their spokes has so many texels. The limit holds for a tile's sides. But
/// a long fan's tile is longer by itself, and those beside it fit in as well: such a tile may be as long, and have as many texels as a square
/// one at the limit.
pub(crate) fn may_share(size: Vec2, longest_spoke: f32, extent_texels: f32) -> bool {
    let longest = size.max_element();
    let is_as_long = longest <= (MAX_LENGTH_PER_SPOKE * longest_spoke).min(MAX_SHARED_LENGTH)
        && size.x * size.y <= extent_texels * extent_texels;
    longest <= extent_texels || is_as_long
}

/// Tiles of several long fans are longer than these by this factor at most: regions stand out a little.
const MAX_LENGTH_PER_SPOKE: f32 = 1.05;

/// And no longer than this, texels: half of the longest side, as densities of tiles differ.
const MAX_SHARED_LENGTH: f32 = (MAX_EXTENT / 2) as f32;

/// The facing cosine that a group must keep: the one asked for, or somewhat less than what its steepest fan reaches alone.
/// Without the latter no two corners of a box could share a tile.
pub(crate) fn facing_limit(asked: f32, steepest_fan: f32) -> f32 {
    asked.min(0.8 * steepest_fan)
}

/// Cuts a patch that turned out invalid into two by rank along its longest extent; returns the halves' lengths.
fn halve_by_length(surface: &Surface<'_>, fans: &mut [u32]) -> [u32; 2] {
    let center = |fan: u32| surface.fan_center(fan as usize);
    let (low, high) = fans
        .iter()
        .map(|&fan| center(fan))
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let axis = (high - low).max_position();
    fans.sort_by(|&a, &b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b)));
    let middle = fans.len() / 2;
    [middle as u32, (fans.len() - middle) as u32]
}
