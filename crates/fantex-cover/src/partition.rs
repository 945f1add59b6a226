//! Top-down partition of the fans into patches that cost as little as possible.
//!
//! A set of fans is cut by a plane in space, between its normals, or between the densities asked for: across the sides of its own
//! rectangle and along the direction in which its normals differ most, at the place where the two parts promise the least
//! [`cost`](crate::cost). Then both parts are cut further, and what they cost in the end decides whether the cut stays: as in a decision tree (L. Breiman and
//! others, "Classification and Regression Trees", 1984), which is grown while there is anything to win and pruned from the leaves. Every cut permutes one
//! array in place; the order of the result follows the cuts and is therefore a space-filling curve over the surface.

use arrayvec::ArrayVec;
use glam::{Mat3, Vec2, Vec3, Vec3A, Vec3Swizzles};
use rayon::prelude::*;

use crate::cost::{self, Region};
use crate::fan_shape::{FanShape, Reach, projection_error};
use crate::groups::may_share;
use crate::nominal::{Demand, NominalDensity};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::surface::{Ring, Surface};
use crate::watch::Watch;

/// The fans of a surface, each with its shape.
#[derive(Clone, Copy)]
pub(crate) struct FanSet<'a> {
    pub(crate) surface: &'a Surface<'a>,
    pub(crate) shapes: &'a [FanShape],
    pub(crate) density: &'a NominalDensity<'a>,
}

impl FanSet<'_> {
    fn item(&self, ring: &mut Ring, fan: u32) -> Item {
        ring.gather(self.surface, fan as usize);
        let FanShape { axis, area, longest_spoke, .. } = self.shapes[fan as usize];
        Item {
            position: ring.center,
            axis,
            longest_spoke,
            reach: Reach::of(&ring.spokes),
            area,
            density: self.density(fan),
            error: projection_error(ring, axis),
            fan,
        }
    }

    /// Nominal texels per mesh unit at a fan.
    pub(crate) fn density(&self, fan: u32) -> f32 {
        self.density.of_fan(self.surface, fan as usize)
    }

    /// Where a fan lies along a cut's direction.
    fn key(&self, cut: &Cut, fan: u32) -> f32 {
        let fan = fan as usize;
        match cut.along {
            Along::Place(direction) => self.surface.fan_center(fan).dot(direction),
            Along::Normal(direction) => self.shapes[fan].axis.dot(direction),
            Along::Density => density_key(self.density.of_fan(self.surface, fan)),
        }
    }
}

/// One fan, as it is cut. Mesh space.
#[derive(Clone, Copy, Debug)]
struct Item {
    position: Vec3,
    /// Mean normal of the fan.
    axis: Vec3,
    longest_spoke: f32,
    /// How far the partial fan reaches from its centre.
    reach: Reach,
    /// A third of the area of the fan's triangles.
    area: f32,
    /// Nominal texels per mesh unit here.
    density: f32,
    /// The fan's error per area, seen along its own direction.
    error: f32,
    fan: u32,
}

/// Items are made for so many fans at a time: they take more memory than all else that is known of fans.
const ITEMS_AT_ONCE: usize = 1 << 20;

/// Larger sets are cut before items are made of them: numbers are sooner brought to their sides than items, and threads begin sooner.
const ITEMS_PER_THREAD: usize = 1 << 17;

/// Sets larger than this are split on two threads.
const MIN_PARALLEL_FANS: usize = 8192;

/// So many fans of a set are looked at, at most.
const MAX_SAMPLES: usize = 2048;

/// Below this ratio of the summed to the absolute normals a set has no direction of its own.
const MIN_COHERENCE: f32 = 0.7;

/// Patches of fewer texels are not cut.
const MIN_TEXELS: f32 = 256.0;

/// A set that costs at most so much per texel is not cut.
const GOOD_COST_PER_TEXEL: f32 = 1.04;

/// Nor, in quick cutting, is one that costs at most so many times what its halves [would cost at least](Set::halves_cost).
const GOOD_COST_OF_HALVES: f32 = 1.02;

/// How sets are cut.
#[derive(Clone, Copy)]
pub(crate) struct Cutting<'a> {
    /// Longest side of a patch in texels.
    pub(crate) extent_texels: f32,
    /// A cut stays if its parts cost at most this many times as much as the whole. More than one is worth while, because small patches
    /// can be joined afterwards, and large ones are never cut again. One tree of cuts is pruned with each of both.
    pub(crate) tolerances: [f32; 2],
    /// Sets without a direction of their own that are longer, in texels, are cut in the middle.
    pub(crate) normals_below: f32,
    /// Cuts wherever a part might be cheaper: in twice the time, for some hundredths of a decibel on scans.
    pub(crate) is_thorough: bool,
    /// Once it has ended large sets stay whole.
    pub(crate) watch: &'a Watch<'a>,
}

/// Items of a set, evenly spread. (With whole steps, of vertices numbered ring by ring all might be from one side of a tube.)
fn samples<T>(items: &[T]) -> impl Iterator<Item = &T> {
    let count = items.len().min(MAX_SAMPLES) as u64;
    (0..count).map(move |i| &items[(i * items.len() as u64 / count) as usize])
}

/// What the most lopsided cut costs more than one in the middle.
const MAX_LOPSIDED_PENALTY: f32 = 0.04;

/// The length of a set's outline beside that of its rectangle.
const OUTLINE_RATIO: f32 = 0.9;

/// Places tried per direction of a cut.
const BINS: usize = 16;

/// The fans in an order in which patches are contiguous, and the patches' lengths for each tolerance.
pub(crate) type Partition = (Vec<u32>, [Vec<u32>; 2]);

/// Cuts the fans into patches.
pub(crate) fn partition(fans: &FanSet<'_>, cutting: &Cutting<'_>) -> Partition {
    partition_by(fans, cutting, ITEMS_AT_ONCE)
}

fn partition_by(fans: &FanSet<'_>, cutting: &Cutting<'_>, items_at_once: usize) -> Partition {
    let mut order: Vec<u32> = (0..fans.shapes.len() as u32).collect();
    let mut lengths = vec![[0; 2]; order.len()];
    divide_fans(fans, &mut order, &mut lengths, cutting, items_at_once, &mut Scratch::default());
    let of_tolerance = |k: usize| {
        let mut start = 0;
        let next = || {
            let length = lengths.get(start)?[k];
            start += length as usize;
            Some(length)
        };
        std::iter::from_fn(next).collect()
    };
    let lengths = [0, 1].map(of_tolerance);
    (order, lengths)
}

/// Where a patch begins, its length for each tolerance; what stands within it does not count.
type Lengths = [[u32; 2]];

/// What the patches of a set cost together, for each tolerance.
type Costs = [f32; 2];

/// A set as one patch.
fn whole_set(lengths: &mut Lengths, cost: f32) -> Costs {
    lengths[0] = [lengths.len() as u32; 2];
    [cost; 2]
}

/// Reused buffers.
#[derive(Default)]
struct Scratch {
    rectangles: RectangleFinder,
    points: Vec<Vec3>,
    picked: Vec<Item>,
    samples: Vec<Sample>,
}

/// An item along the axes of a set's bins.
#[derive(Clone, Copy)]
struct Sample {
    key: f32,
    area: f32,
    /// Area times weight.
    weighted: f32,
    /// Its normal, by area.
    axis: Vec3A,
    low: Vec3A,
    high: Vec3A,
}

/// As [`divide`], the same patches, with items for at most `items_at_once` fans at a time.
fn divide_fans(
    fans: &FanSet<'_>,
    order: &mut [u32],
    lengths: &mut Lengths,
    cutting: &Cutting<'_>,
    items_at_once: usize,
    scratch: &mut Scratch,
) -> Costs {
    if cutting.watch.has_ended() {
        return whole_set(lengths, 0.0);
    }
    if order.len() <= items_at_once.min(ITEMS_PER_THREAD) {
        let item = |ring: &mut Ring, &fan: &u32| fans.item(ring, fan);
        let mut items: Vec<Item> =
            order.par_iter().with_min_len(1024).map_init(Ring::default, item).collect();
        let costs = divide(&mut items, lengths, cutting, scratch);
        order.iter_mut().zip(&items).for_each(|(fan, item)| *fan = item.fan);
        return costs;
    }
    let mut ring = Ring::default();
    let picked: Vec<Item> = samples(order).map(|&fan| fans.item(&mut ring, fan)).collect();
    let (whole, cut) = cut_of(&picked, order.len(), cutting, scratch);
    let Some(cut) = cut else { return uncut(lengths, whole, cutting) };
    let key = |fan: u32| fans.key(&cut, fan);
    let is_left = |&fan: &u32| key(fan) < cut.threshold;
    let is_left: Vec<bool> = order.par_iter().with_min_len(4096).map(is_left).collect();
    let mut is_left = is_left.into_iter();
    let middle = separate(order, |_| is_left.next().unwrap_or(false));
    let middle = match middle == 0 || middle == order.len() {
        true => halve(order, |&fan| (key(fan), fan)),
        false => middle,
    };
    let (left, right) = order.split_at_mut(middle);
    let (left_lengths, right_lengths) = lengths.split_at_mut(middle);
    let (first, second) = if left.len() + right.len() <= items_at_once {
        let other = || {
            let scratch = &mut Scratch::default();
            divide_fans(fans, right, right_lengths, cutting, items_at_once, scratch)
        };
        rayon::join(|| divide_fans(fans, left, left_lengths, cutting, items_at_once, scratch), other)
    } else {
        (
            divide_fans(fans, left, left_lengths, cutting, items_at_once, scratch),
            divide_fans(fans, right, right_lengths, cutting, items_at_once, scratch),
        )
    };
    cheaper(whole, first, second, lengths, cutting)
}

/// Finds the patches' costs and lengths.
fn divide(items: &mut [Item], lengths: &mut Lengths, cutting: &Cutting<'_>, scratch: &mut Scratch) -> Costs {
    if items.len() >= MIN_PARALLEL_FANS && cutting.watch.has_ended() {
        return whole_set(lengths, 0.0);
    }
    let mut picked = std::mem::take(&mut scratch.picked);
    let sampled = if items.len() > MAX_SAMPLES {
        picked.clear();
        picked.extend(samples(items));
        picked.as_slice()
    } else {
        &*items
    };
    let (whole, cut) = cut_of(sampled, items.len(), cutting, scratch);
    scratch.picked = picked;
    let Some(cut) = cut else { return uncut(lengths, whole, cutting) };
    let key = |item: &Item| cut.key(item);
    let middle = separate(items, |item| key(item) < cut.threshold);
    let middle = match middle == 0 || middle == items.len() {
        true => halve(items, |item| (key(item), item.fan)),
        false => middle,
    };
    let is_large = items.len() >= MIN_PARALLEL_FANS;
    let (left, right) = items.split_at_mut(middle);
    let (left_lengths, right_lengths) = lengths.split_at_mut(middle);
    let (first, second) = if is_large {
        let other = || divide(right, right_lengths, cutting, &mut Scratch::default());
        rayon::join(|| divide(left, left_lengths, cutting, scratch), other)
    } else {
        (divide(left, left_lengths, cutting, scratch), divide(right, right_lengths, cutting, scratch))
    };
    cheaper(whole, first, second, lengths, cutting)
}

/// A set that is not cut.
fn uncut(lengths: &mut Lengths, cost: f32, cutting: &Cutting<'_>) -> Costs {
    cutting.watch.add(lengths.len());
    whole_set(lengths, cost)
}

/// What a set of `count` items, of which some were picked, costs as one patch; and where it is cut, if it is.
fn cut_of(picked: &[Item], count: usize, cutting: &Cutting<'_>, scratch: &mut Scratch) -> (f32, Option<Cut>) {
    let set = Set::of(picked, count);
    let tile = set.tile(picked, cutting.extent_texels, scratch);
    let whole = tile.as_ref().map_or(f32::INFINITY, |tile| tile.cost);
    let is_good = || {
        whole <= GOOD_COST_PER_TEXEL * set.texels
            || !cutting.is_thorough && whole <= GOOD_COST_OF_HALVES * set.halves_cost(picked)
    };
    if count < 2 || whole.is_finite() && (set.texels < MIN_TEXELS || is_good()) {
        return (whole, None);
    }
    (whole, Some(set.cut(picked, tile.as_ref(), cutting.normals_below, &mut scratch.samples)))
}

/// A set as one patch, or its two parts as they were cut further.
fn cheaper(whole: f32, first: Costs, second: Costs, lengths: &mut Lengths, cutting: &Cutting<'_>) -> Costs {
    let mut costs = [0, 1].map(|k| first[k] + second[k]);
    let count = lengths.len() as u32;
    for (k, cost) in costs.iter_mut().enumerate() {
        if whole * cutting.tolerances[k] <= *cost {
            lengths[0][k] = count;
            *cost = whole;
        }
    }
    costs
}

/// Items with a smaller key go left.
#[derive(Clone, Copy)]
struct Cut {
    along: Along,
    threshold: f32,
}

/// What sets are cut along.
#[derive(Clone, Copy)]
enum Along {
    /// A direction in space.
    Place(Vec3),
    /// A direction between normals.
    Normal(Vec3),
    /// The densities asked for.
    Density,
}

impl Cut {
    #[inline]
    fn key(&self, item: &Item) -> f32 {
        match self.along {
            Along::Place(direction) => item.position.dot(direction),
            Along::Normal(direction) => item.axis.dot(direction),
            Along::Density => density_key(item.density),
        }
    }
}

fn density_key(density: f32) -> f32 {
    libm::log2f(density.max(f32::MIN_POSITIVE))
}

/// Stable partition, which asks in order; returns the number of items that went left.
fn separate<T: Copy>(items: &mut [T], mut left: impl FnMut(&T) -> bool) -> usize {
    let mut right = Vec::with_capacity(items.len() / 2 + 1);
    let mut end = 0;
    for i in 0..items.len() {
        if left(&items[i]) {
            items[end] = items[i];
            end += 1;
        } else {
            right.push(items[i]);
        }
    }
    items[end..].copy_from_slice(&right);
    end
}

/// Where a plane separates nothing (all keys equal, or rounding), the set is halved by rank, by keys and fans.
fn halve<T>(items: &mut [T], key: impl Fn(&T) -> (f32, u32)) -> usize {
    items.sort_by(|a, b| {
        let ((a, fan_a), (b, fan_b)) = (key(a), key(b));
        a.total_cmp(&b).then(fan_a.cmp(&fan_b))
    });
    items.len() / 2
}

/// Sums over the samples of a set, as if they were all.
struct Set {
    area: f32,
    /// Sum of the normals, by area.
    axis: Vec3,
    /// Texels per mesh unit.
    density: f32,
    /// The least and the most density asked for.
    densities: [f32; 2],
    /// Texels asked for.
    texels: f32,
    low: Vec3,
    high: Vec3,
    count: usize,
    /// Items per sample.
    times: f32,
}

/// Sets whose densities differ by less are not cut between them.
const UNEVEN_DENSITY_RATIO: f32 = 1.25;

/// A set as one patch.
struct Tile {
    /// Along the sides of its rectangle.
    sides: [Vec3; 2],
    cost: f32,
}

impl Set {
    /// Of `count` items, of which some were picked.
    fn of(picked: &[Item], count: usize) -> Self {
        let (mut area, mut axis, mut demand) = (0.0, Vec3::ZERO, Demand::default());
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut densities = [f32::INFINITY, 0.0];
        for item in picked {
            area += item.area;
            axis += item.axis * item.area;
            demand.add(&Demand::of(item.area, item.density));
            densities = [densities[0].min(item.density), densities[1].max(item.density)];
            low = low.min(item.position);
            high = high.max(item.position);
        }
        let times = count as f32 / picked.len() as f32;
        let is_even = densities[0] == densities[1];
        let density = if is_even { densities[0] } else { demand.density().unwrap_or(picked[0].density) };
        let texels = demand.texels() * times;
        Self { area: area * times, axis: axis * times, density, densities, texels, low, high, count, times }
    }

    /// The error per area of what asks for a density, relative to that of what asks for the set's.
    #[inline]
    fn weight(&self, density: f32) -> f32 {
        let squared = (density / self.density) * (density / self.density);
        if squared.is_finite() { squared * squared * squared } else { 1.0 }
    }

    /// The set as one patch; `None` where it is too long or has no direction.
    fn tile(&self, picked: &[Item], extent_texels: f32, scratch: &mut Scratch) -> Option<Tile> {
        let alone = self.count == 1;
        if !alone && self.axis.length() < MIN_COHERENCE * self.area {
            return None;
        }
        let facets = picked.iter().map(|item| (item.axis, item.area));
        let direction = cost::direction(facets, self.axis.try_normalize().unwrap_or(picked[0].axis));
        let (x, y) = direction.any_orthonormal_pair();
        scratch.points.clear();
        scratch.points.extend(picked.iter().map(|i| Vec3::new(i.position.dot(x), i.position.dot(y), 0.0)));
        let Rectangle { x_axis, .. } = scratch.rectangles.smallest(&mut scratch.points, 0.0);
        let side = x * x_axis.x + y * x_axis.y;
        let sides = [side, direction.cross(side)];
        self.sample(picked, &Axes::new([sides[0], sides[1], direction]), &mut scratch.samples);
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let mut error = 0.0;
        for (sample, item) in scratch.samples.iter().zip(picked) {
            low = low.min(sample.low);
            high = high.max(sample.high);
            error += sample.weighted * item.error * cost::error_at(item.axis.dot(direction));
        }
        let size = Vec3::from(high - low).truncate() * self.density;
        let squared = self.times * self.density * self.density;
        let (error, area) = (error * squared, self.axis.dot(direction).max(0.0) / self.times * squared);
        let region = Region { size, area, outline: OUTLINE_RATIO * 2.0 * (size.x + size.y) };
        let longest_spoke = picked.iter().map(|item| item.longest_spoke).fold(0.0, f32::max);
        let fits = alone || may_share(size, longest_spoke * self.density, extent_texels);
        let cost = if fits { cost::cost(error, &region) } else { f32::INFINITY };
        Some(Tile { sides, cost })
    }

    /// What the two halves of the set would cost together if they were discs, and each fan were seen from its own direction.
    fn halves_cost(&self, picked: &[Item]) -> f32 {
        let squared = self.density * self.density;
        let error: f32 = picked.iter().map(|i| i.area * i.error * self.weight(i.density)).sum();
        let (error, area) = (0.5 * error * self.times * squared, 0.5 * self.axis.length() * squared);
        2.0 * cost::cost(error, &Region::disc(area))
    }

    /// The items along axes.
    fn sample(&self, picked: &[Item], axes: &Axes, samples: &mut Vec<Sample>) {
        samples.clear();
        samples.extend(picked.iter().map(|item| Sample::of(item, self.weight(item.density), axes)));
    }

    /// The plane whose two sides promise to cost least. What was picked is among the samples if there is a tile.
    fn cut(
        &self,
        picked: &[Item],
        tile: Option<&Tile>,
        normals_below: f32,
        sampled: &mut Vec<Sample>,
    ) -> Cut {
        let longest = (self.high - self.low).max_element() * self.density;
        let mut cuts: ArrayVec<Along, 5> = ArrayVec::new();
        match tile {
            Some(tile) => {
                cuts.extend(tile.sides.map(Along::Place));
                if tile.cost.is_finite() {
                    cuts.push(Along::Normal(self.normals_axis(picked)));
                }
            }
            None if longest < normals_below => {
                cuts.extend(Vec3::AXES.map(Along::Place));
                cuts.push(Along::Normal(self.normals_axis(picked)));
            }
            None => {}
        }
        if !cuts.is_empty() && self.densities[1] > UNEVEN_DENSITY_RATIO * self.densities[0] {
            cuts.push(Along::Density);
        }
        if tile.is_none() && !cuts.is_empty() {
            self.sample(picked, &Axes::new(Vec3::AXES), sampled);
        }
        let mut best: Option<(f32, Cut)> = None;
        for along in cuts {
            let mut cut = Cut { along, threshold: 0.0 };
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for (sample, item) in sampled.iter_mut().zip(picked) {
                sample.key = cut.key(item);
                low = low.min(sample.key);
                high = high.max(sample.key);
            }
            if let Some((cost, threshold)) = self.sweep(sampled, [low, high])
                && best.is_none_or(|(least, _)| cost < least)
            {
                cut.threshold = threshold;
                best = Some((cost, cut));
            }
        }
        let widest = || {
            let axis = (self.high - self.low).max_position();
            let threshold = 0.5 * (self.low[axis] + self.high[axis]);
            Cut { along: Along::Place(Vec3::AXES[axis]), threshold }
        };
        best.map_or_else(widest, |(_, cut)| cut)
    }

    /// The best of evenly spaced places of a cut, with what both sides promise to cost. The keys lie between `low` and `high`.
    fn sweep(&self, sampled: &[Sample], [low, high]: [f32; 2]) -> Option<(f32, f32)> {
        let scale = BINS as f32 / (high - low);
        if !scale.is_finite() {
            return None;
        }
        let mut bins = [Bin::default(); BINS];
        for sample in sampled {
            bins[(((sample.key - low) * scale) as usize).min(BINS - 1)].add(sample);
        }
        let mut right = [Bin::default(); BINS];
        let mut sum = Bin::default();
        for i in (1..BINS).rev() {
            sum.merge(&bins[i]);
            right[i] = sum;
        }
        let mut left = Bin::default();
        let mut costs = [[0.0; BINS]; 2];
        let mut has_both = [false; BINS];
        for i in 1..BINS {
            left.merge(&bins[i - 1]);
            let is_lone = left.area <= 0.0 || right[i].area <= 0.0;
            has_both[i] = !is_lone;
            if has_both[i] {
                (costs[0][i], costs[1][i]) = (left.cubed_cost(self), right[i].cubed_cost(self));
            }
        }
        costs.iter_mut().for_each(cost::take_cube_roots);
        let mut best: Option<(f32, f32)> = None;
        for i in (1..BINS).filter(|&i| has_both[i]) {
            let lopsided = (2.0 * i as f32 / BINS as f32 - 1.0).abs();
            let cost = (costs[0][i] + costs[1][i]) * (1.0 + MAX_LOPSIDED_PENALTY * lopsided);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, low + i as f32 / scale));
            }
        }
        best
    }

    /// The direction in which the normals vary most.
    fn normals_axis(&self, picked: &[Item]) -> Vec3 {
        let mean = self.axis / self.area.max(f32::MIN_POSITIVE);
        let mut covariance = Mat3::ZERO;
        for item in picked {
            let d = item.axis - mean;
            covariance += Mat3::from_cols(d * d.x, d * d.y, d * d.z) * item.area;
        }
        principal_axis(covariance)
    }
}

/// Three axes, for coordinates along all of them at once.
struct Axes {
    /// The x, y and z of the axes.
    rows: [Vec3A; 3],
    /// The same for [reaches](Reach::along_three).
    squares: [[Vec3A; 3]; 2],
}

impl Axes {
    fn new(axes: [Vec3; 3]) -> Self {
        let rows_of = |v: [Vec3; 3]| [0, 1, 2].map(|k| Vec3A::new(v[0][k], v[1][k], v[2][k]));
        let squares = [axes.map(|axis| axis * axis), axes.map(|axis| axis.yzx() * axis.zxy())];
        Self { rows: rows_of(axes), squares: squares.map(rows_of) }
    }

    #[inline]
    fn along(&self, v: Vec3) -> Vec3A {
        self.rows[0] * v.x + self.rows[1] * v.y + self.rows[2] * v.z
    }
}

impl Sample {
    #[inline]
    fn of(item: &Item, weight: f32, axes: &Axes) -> Self {
        let p = axes.along(item.position);
        let reach = item.reach.along_three(&axes.squares);
        let axis = axes.along(item.axis) * item.area;
        let weighted = item.area * weight;
        Self { key: 0.0, area: item.area, weighted, axis, low: p - reach, high: p + reach }
    }
}

/// What lies between two planes.
#[derive(Clone, Copy)]
struct Bin {
    area: f32,
    /// Area times weight.
    weighted: f32,
    axis: Vec3A,
    /// Along the sides and the direction of the tile, or along the axes.
    low: Vec3A,
    high: Vec3A,
}

impl Default for Bin {
    fn default() -> Self {
        let (low, high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        Self { area: 0.0, weighted: 0.0, axis: Vec3A::ZERO, low, high }
    }
}

impl Bin {
    /// See [`Demand::density`].
    fn density(&self, set: &Set) -> f32 {
        if set.densities[0] == set.densities[1] {
            return set.density;
        }
        set.density * libm::cbrtf(self.weighted / self.area.max(f32::MIN_POSITIVE)).sqrt()
    }

    #[inline]
    fn add(&mut self, sample: &Sample) {
        self.area += sample.area;
        self.weighted += sample.weighted;
        self.axis += sample.axis;
        self.low = self.low.min(sample.low);
        self.high = self.high.max(sample.high);
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.area += other.area;
        self.weighted += other.weighted;
        self.axis += other.axis;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }

    /// An estimate of the cost's third power. Normals spread evenly over a cap whose mean has the length `m` have an error of about `m^-5`
    /// per area.
    fn cubed_cost(&self, set: &Set) -> f32 {
        let axis = Vec3::from(self.axis);
        let length = axis.length() / self.area.max(f32::MIN_POSITIVE);
        let mean = length.max(0.05);
        let density = self.density(set);
        let area = self.area * set.times * density * density;
        let error = area / (mean * mean * mean * mean * mean);
        // The box as it is seen along the mean normal.
        let size = Vec3::from(self.high - self.low) * density;
        let sides = Vec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
        let seen = sides.dot(axis.abs()) / axis.length().max(f32::MIN_POSITIVE);
        let seen_area = axis.length() * set.times * density * density;
        let side = seen.max(0.0).sqrt();
        let region = Region { size: Vec2::splat(side), area: seen_area, outline: OUTLINE_RATIO * 4.0 * side };
        cost::cubed_cost(error, &region, 0)
    }
}

/// The eigenvector of the largest eigenvalue of a symmetric positive matrix, by repeated squaring.
fn principal_axis(m: Mat3) -> Vec3 {
    let mut power = m;
    for _ in 0..6 {
        let scale = power.to_cols_array().iter().fold(0.0f32, |a, x| a.max(x.abs()));
        if scale <= 0.0 || !scale.is_finite() {
            return Vec3::X;
        }
        power *= 1.0 / scale;
        power *= power;
    }
    let columns = [power.x_axis, power.y_axis, power.z_axis];
    let longest = columns.into_iter().fold(Vec3::ZERO, |a, c| if c.length() > a.length() { c } else { a });
    longest.try_normalize().unwrap_or(Vec3::X)
}

#[cfg(test)]
mod tests {
    use fantex_mesh::generate::{LandscapeOptions, landscape};
    use fantex_mesh::{CleanOptions, Fans, VertexCorners, clean};

    use super::*;
    use crate::{CoverOptions, TexelBudget};

    #[test]
    fn patches_are_the_same_however_many_items_are_made_at_once() {
        let options = LandscapeOptions { triangles: 20_000, ..LandscapeOptions::default() };
        let (mesh, _) = clean(landscape(&options).unwrap().into(), &CleanOptions::default()).unwrap();
        let vertex_corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
        let surface = Surface::new(&mesh, Fans::by_angle(&mesh, &vertex_corners));
        let watch = &Watch::new(&|_| true);
        let shapes = crate::build::shape_fans(&surface, watch);
        // Long sets are cut without regard to their normals, short ones with it.
        for texels in [20_000, 4_000_000] {
            let options = CoverOptions { budget: TexelBudget::Total(texels), ..CoverOptions::default() };
            let density = NominalDensity::new(&surface, &options);
            let fans = FanSet { surface: &surface, shapes: &shapes, density: &density };
            let tolerances = [1.03, 1.15];
            let is_thorough = texels == 20_000;
            let cutting =
                Cutting { extent_texels: 512.0, tolerances, normals_below: 768.0, is_thorough, watch };
            let at_once = partition_by(&fans, &cutting, usize::MAX);
            let counts = at_once.1.each_ref().map(Vec::len);
            assert!(counts[1] > counts[0] && counts[0] > 8, "{counts:?} patches");
            for items in [3000, 40, 1] {
                assert!(partition_by(&fans, &cutting, items) == at_once, "{items} items, {texels} texels");
            }
        }
    }
}
