//! Top-down partition of the fans into patches that cost as little as possible.
//!
//! A set of fans is cut by a plane in space or between its normals: across the sides of its own rectangle and along the
//! direction in which its normals differ most, at the place where the two parts promise the least [`cost`](crate::cost). Then both
//! parts are cut further, and what they cost in the end decides whether the cut stays: as in a decision tree (L. Breiman and
//! others, "Classification and Regression Trees", 1984), which is grown fully and pruned from the leaves. Every cut permutes one
//! array in place; the order of the result follows the cuts and is therefore a space-filling curve over the surface.

use arrayvec::ArrayVec;
use fantex_mesh::Fans;
use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::cone::Cone;
use crate::cost::{self, Region};
use crate::fan_shape::{FanShape, Layout, Reach};
use crate::rectangle::{Rectangle, RectangleFinder};

/// One fan, as the partition sees it. Mesh space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    pub(crate) position: Vec3,
    /// Mean normal of the fan.
    pub(crate) axis: Vec3,
    /// How far the partial fan reaches from its centre.
    pub(crate) reach: Reach,
    /// A third of the area of the fan's triangles.
    pub(crate) area: f32,
    /// Nominal texels per mesh unit here.
    pub(crate) density: f32,
    /// The fan's error per area, seen along its own direction.
    pub(crate) error: f32,
    pub(crate) fan: u32,
}

/// Sets larger than this are split on two threads.
const PARALLEL_FROM: usize = 8192;

/// So many fans of a set are looked at, evenly spaced.
const SAMPLES: usize = 2048;

/// Below this ratio of the summed to the absolute normals a set has no direction of its own.
const COHERENT: f32 = 0.7;

/// Patches of fewer texels are not cut.
const MIN_TEXELS: f32 = 256.0;

/// A set that costs at most so much per texel is not cut.
const GOOD: f32 = 1.04;

/// How sets are cut.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cutting {
    /// Longest side of a patch in texels.
    pub(crate) extent_texels: f32,
    /// A cut stays if its parts cost at most this many times as much as the whole. More than one is worth while, because small patches
    /// can be joined afterwards, and large ones are never cut again.
    pub(crate) tolerance: f32,
    /// Sets without a direction of their own that are longer, in texels, are cut in the middle.
    pub(crate) normals_below: f32,
}

/// What the most lopsided cut costs more than one in the middle.
const LOPSIDED: f32 = 0.04;

/// The length of a set's outline beside that of its rectangle.
const OUTLINE: f32 = 0.9;

/// Places tried per direction of a cut.
const BINS: usize = 16;

/// Permutes the items so that patches are contiguous; returns their lengths in order.
pub(crate) fn partition(items: &mut [Item], cutting: &Cutting) -> Vec<u32> {
    divide(items, cutting, &mut Scratch::default()).1
}

/// Reused buffers.
#[derive(Default)]
struct Scratch {
    rectangles: RectangleFinder,
    points: Vec<Vec3>,
    samples: Vec<Sample>,
}

/// An item along the axes of a set's bins.
#[derive(Clone, Copy)]
struct Sample {
    key: f32,
    area: f32,
    /// Its normal, by area.
    axis: Vec3,
    low: Vec3,
    high: Vec3,
}

/// The patches' cost and lengths.
fn divide(items: &mut [Item], cutting: &Cutting, scratch: &mut Scratch) -> (f32, Vec<u32>) {
    let set = Set::of(items);
    let tile = set.tile(items, cutting.extent_texels, scratch);
    let whole = tile.as_ref().map_or(f32::INFINITY, |tile| tile.cost);
    if items.len() < 2 || whole <= GOOD * set.texels || whole.is_finite() && set.texels < MIN_TEXELS {
        return (whole, vec![items.len() as u32]);
    }
    let cut = set.cut(items, tile.as_ref(), cutting.normals_below, &mut scratch.samples);
    let middle = separate(items, |item| cut.key(item) < cut.threshold);
    let middle = if middle == 0 || middle == items.len() { halve(items, &cut) } else { middle };
    let (left, right) = items.split_at_mut(middle);
    let ((a, mut first), (b, second)) = if left.len() + right.len() >= PARALLEL_FROM {
        let other = || divide(right, cutting, &mut Scratch::default());
        rayon::join(|| divide(left, cutting, scratch), other)
    } else {
        (divide(left, cutting, scratch), divide(right, cutting, scratch))
    };
    if whole * cutting.tolerance <= a + b {
        return (whole, vec![items.len() as u32]);
    }
    first.extend(second);
    (a + b, first)
}

/// A plane: items with a smaller key go left.
#[derive(Clone, Copy)]
struct Cut {
    direction: Vec3,
    by_normal: bool,
    threshold: f32,
}

impl Cut {
    #[inline]
    fn key(&self, item: &Item) -> f32 {
        let v = if self.by_normal { item.axis } else { item.position };
        v.dot(self.direction)
    }
}

/// Stable partition; returns the number of items that went left.
fn separate(items: &mut [Item], left: impl Fn(&Item) -> bool) -> usize {
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

/// Where a plane separates nothing (all keys equal, or rounding), the set is halved by rank.
fn halve(items: &mut [Item], cut: &Cut) -> usize {
    items.sort_by(|a, b| cut.key(a).total_cmp(&cut.key(b)).then(a.fan.cmp(&b.fan)));
    items.len() / 2
}

/// Evenly spaced items of a set.
fn samples(items: &[Item]) -> impl Iterator<Item = &Item> + Clone {
    items.iter().step_by(items.len().div_ceil(SAMPLES))
}

/// Sums over the samples of a set, as if they were all.
struct Set {
    area: f32,
    /// Sum of the normals, by area.
    axis: Vec3,
    /// Texels per mesh unit.
    density: f32,
    texels: f32,
    low: Vec3,
    high: Vec3,
    /// Items per sample.
    times: f32,
}

/// A set as one patch.
struct Tile {
    direction: Vec3,
    /// Along the sides of its rectangle.
    sides: [Vec3; 2],
    cost: f32,
}

impl Set {
    fn of(items: &[Item]) -> Self {
        let (mut area, mut axis, mut density, mut count) = (0.0, Vec3::ZERO, 0.0, 0);
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for item in samples(items) {
            area += item.area;
            axis += item.axis * item.area;
            density += item.density * item.area;
            low = low.min(item.position);
            high = high.max(item.position);
            count += 1;
        }
        let times = items.len() as f32 / count as f32;
        let density = if area > 0.0 { density / area } else { items[0].density };
        let texels = area * times * density * density;
        Self { area: area * times, axis: axis * times, density, texels, low, high, times }
    }

    /// The set as one patch; `None` where it is too long or has no direction.
    fn tile(&self, items: &[Item], extent_texels: f32, scratch: &mut Scratch) -> Option<Tile> {
        let alone = items.len() == 1;
        if !alone && self.axis.length() < COHERENT * self.area {
            return None;
        }
        let facets = samples(items).map(|item| (item.axis, item.area));
        let direction = cost::direction(facets, self.axis.try_normalize().unwrap_or(items[0].axis));
        let (x, y) = direction.any_orthonormal_pair();
        scratch.points.clear();
        scratch.points.extend(samples(items).map(|i| Vec3::new(i.position.dot(x), i.position.dot(y), 0.0)));
        let Rectangle { x_axis, .. } = scratch.rectangles.smallest(&mut scratch.points, 0.0);
        let side = x * x_axis.x + y * x_axis.y;
        let sides = [side, direction.cross(side)];
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for item in samples(items) {
            let p = Vec2::new(item.position.dot(sides[0]), item.position.dot(sides[1]));
            let reach = Vec2::from(sides.map(|side| item.reach.along(side)));
            low = low.min(p - reach);
            high = high.max(p + reach);
        }
        let size = (high - low) * self.density;
        let error =
            samples(items).map(|i| i.area * i.error * cost::error_at(i.axis.dot(direction))).sum::<f32>();
        let squared = self.times * self.density * self.density;
        let (error, area) = (error * squared, self.axis.dot(direction).max(0.0) / self.times * squared);
        let region = Region { size, area, outline: OUTLINE * 2.0 * (size.x + size.y) };
        let fits = alone || size.max_element() <= extent_texels;
        let cost = if fits { cost::cost(error, &region) } else { f32::INFINITY };
        Some(Tile { direction, sides, cost })
    }

    /// The plane whose two sides promise to cost least.
    fn cut(&self, items: &[Item], tile: Option<&Tile>, normals_below: f32, sampled: &mut Vec<Sample>) -> Cut {
        let longest = (self.high - self.low).max_element() * self.density;
        let mut cuts: ArrayVec<Cut, 4> = ArrayVec::new();
        let mut consider =
            |direction: Vec3, by_normal: bool| cuts.push(Cut { direction, by_normal, threshold: 0.0 });
        match tile {
            Some(tile) => {
                tile.sides.iter().for_each(|&side| consider(side, false));
                if tile.cost.is_finite() {
                    consider(self.normals_axis(items), true);
                }
            }
            None if longest < normals_below => {
                Vec3::AXES.iter().for_each(|&side| consider(side, false));
                consider(self.normals_axis(items), true);
            }
            None => {}
        }
        if !cuts.is_empty() {
            let axes = tile.map_or(Vec3::AXES, |t| [t.sides[0], t.sides[1], t.direction]);
            sampled.clear();
            sampled.extend(samples(items).map(|item| Sample::of(item, &axes)));
        }
        let mut best: Option<(f32, Cut)> = None;
        for cut in cuts {
            for (sample, item) in sampled.iter_mut().zip(samples(items)) {
                sample.key = cut.key(item);
            }
            if let Some((cost, threshold)) = self.sweep(sampled)
                && best.is_none_or(|(least, _)| cost < least)
            {
                best = Some((cost, Cut { threshold, ..cut }));
            }
        }
        let widest = || {
            let mut direction = Vec3::ZERO;
            let axis = (self.high - self.low).max_position();
            direction[axis] = 1.0;
            Cut { direction, by_normal: false, threshold: 0.5 * (self.low[axis] + self.high[axis]) }
        };
        best.map_or_else(widest, |(_, cut)| cut)
    }

    /// The best of evenly spaced places of a cut, with what both sides promise to cost.
    fn sweep(&self, sampled: &[Sample]) -> Option<(f32, f32)> {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for sample in sampled {
            low = low.min(sample.key);
            high = high.max(sample.key);
        }
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
        let mut best: Option<(f32, f32)> = None;
        for i in 1..BINS {
            left.merge(&bins[i - 1]);
            if left.area <= 0.0 || right[i].area <= 0.0 {
                continue;
            }
            let lopsided = (2.0 * i as f32 / BINS as f32 - 1.0).abs();
            let cost = (left.cost(self) + right[i].cost(self)) * (1.0 + LOPSIDED * lopsided);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, low + i as f32 / scale));
            }
        }
        best
    }

    /// The direction in which the normals vary most.
    fn normals_axis(&self, items: &[Item]) -> Vec3 {
        let mean = self.axis / self.area.max(f32::MIN_POSITIVE);
        let mut covariance = Mat3::ZERO;
        for item in samples(items) {
            let d = item.axis - mean;
            covariance += Mat3::from_cols(d * d.x, d * d.y, d * d.z) * item.area;
        }
        principal_axis(covariance)
    }
}

impl Sample {
    #[inline]
    fn of(item: &Item, axes: &[Vec3; 3]) -> Self {
        let coordinates = |v: Vec3| Vec3::from(axes.map(|axis| v.dot(axis)));
        let (p, reach) = (coordinates(item.position), Vec3::from(axes.map(|axis| item.reach.along(axis))));
        let axis = coordinates(item.axis) * item.area;
        Self { key: 0.0, area: item.area, axis, low: p - reach, high: p + reach }
    }
}

/// What lies between two planes.
#[derive(Clone, Copy)]
struct Bin {
    area: f32,
    axis: Vec3,
    /// Along the sides and the direction of the tile, or along the axes.
    low: Vec3,
    high: Vec3,
}

impl Default for Bin {
    fn default() -> Self {
        Self { area: 0.0, axis: Vec3::ZERO, low: Vec3::INFINITY, high: Vec3::NEG_INFINITY }
    }
}

impl Bin {
    #[inline]
    fn add(&mut self, sample: &Sample) {
        self.area += sample.area;
        self.axis += sample.axis;
        self.low = self.low.min(sample.low);
        self.high = self.high.max(sample.high);
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.area += other.area;
        self.axis += other.axis;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }

    /// An estimate. Normals spread evenly over a cap whose mean has the length `m` have an error of about `m^-5` per area.
    fn cost(&self, set: &Set) -> f32 {
        let length = self.axis.length() / self.area.max(f32::MIN_POSITIVE);
        let mean = length.max(0.05);
        let area = self.area * set.times * set.density * set.density;
        let error = area / (mean * mean * mean * mean * mean);
        // The box as it is seen along the mean normal.
        let size = (self.high - self.low) * set.density;
        let sides = Vec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
        let seen = sides.dot(self.axis.abs()) / self.axis.length().max(f32::MIN_POSITIVE);
        let seen_area = self.axis.length() * set.times * set.density * set.density;
        let side = seen.max(0.0).sqrt();
        cost::cost(error, &Region { size: Vec2::splat(side), area: seen_area, outline: OUTLINE * 4.0 * side })
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

// Splits patches into connected components.
//
// Where normals are rough, cutting by normals leaves patches in many pieces, half of them single fans. Each connected piece
// becomes a patch; fragments go to the neighbour with the longest common border whose direction sees them well,
// before anything is laid flat. That gives fewer groups, more density and less foreshortening than
// when `merge` judges all of them.

/// Pieces of at most so many texels, one block of a tile, look for a neighbour to join. Its rectangle hardly grows for them.
const FRAGMENT_TEXELS: f32 = 16.0;

/// Fragments whose neighbours are fragments, too, may find one in a later round.
const ROUNDS: usize = 3;

/// Place of fans that share no patch with others.
const ALONE: u32 = u32::MAX;

/// The seed of fans that were not visited yet.
const UNSEEN: u32 = u32::MAX;

/// Separates patches into connected pieces, through triangles.
pub(crate) struct Connector<'a> {
    fans: &'a Fans,
    shapes: &'a [FanShape],
    /// Where in the order each fan is; `ALONE` for fans that are not projected. May be out of date for fans that are not
    /// looked at, so a place counts only where the order names the fan.
    places: Vec<u32>,
}

impl<'a> Connector<'a> {
    pub(crate) fn new(fans: &'a Fans, shapes: &'a [FanShape]) -> Self {
        let place = |shape: &FanShape| if shape.layout == Layout::Projected { 0 } else { ALONE };
        Self { fans, shapes, places: shapes.iter().map(place).collect() }
    }

    /// Reorders each of the patches, which lie one after the other in `order` from `start` on, by connected pieces; returns
    /// the pieces' lengths.
    pub(crate) fn separate(&mut self, order: &mut [u32], start: usize, lengths: &[u32]) -> Vec<u32> {
        let end = start + lengths.iter().sum::<u32>() as usize;
        self.note_places(&order[start..end], start);
        let seeds = self.seeds(order, start, lengths);
        let (sorted, lengths) = sorted_by_seed(&order[start..end], &seeds, start as u32);
        order[start..end].copy_from_slice(&sorted);
        lengths
    }

    /// All fans by connected pieces of the patches, which lie one after the other in `items`, with the pieces' lengths.
    /// Fragments went to a neighbour whose direction their triangles' normals face with a cosine of at least `facing`.
    pub(crate) fn connect(&mut self, items: &[Item], lengths: &[u32], facing: f32) -> (Vec<u32>, Vec<u32>) {
        let order: Vec<u32> = items.iter().map(|i| i.fan).collect();
        self.note_places(&order, 0);
        let mut seeds = self.seeds(&order, 0, lengths);
        self.absorb(items, &mut seeds, facing);
        sorted_by_seed(&order, &seeds, 0)
    }

    fn note_places(&mut self, order: &[u32], start: usize) {
        for (place, &fan) in (start as u32..).zip(order) {
            let noted = &mut self.places[fan as usize];
            if *noted != ALONE {
                *noted = place;
            }
        }
    }

    /// For every fan of the patches the place of the first fan of its connected piece.
    fn seeds(&self, order: &[u32], start: usize, lengths: &[u32]) -> Vec<u32> {
        let mut seeds = vec![UNSEEN; lengths.iter().sum::<u32>() as usize];
        let mut patches = Vec::with_capacity(lengths.len());
        let (mut rest, mut first) = (seeds.as_mut_slice(), start as u32);
        for &length in lengths {
            let (patch, tail) = rest.split_at_mut(length as usize);
            patches.push((first, patch));
            (rest, first) = (tail, first + length);
        }
        patches.into_par_iter().for_each_init(Vec::new, |stack, (first, seeds)| {
            for i in 0..seeds.len() {
                if seeds[i] == UNSEEN {
                    self.flood(order, first, first + i as u32, seeds, stack);
                }
            }
        });
        seeds
    }

    /// Marks the piece of the fan at place `seed` in a patch that begins at place `first`.
    fn flood(&self, order: &[u32], first: u32, seed: u32, seeds: &mut [u32], stack: &mut Vec<u32>) {
        seeds[(seed - first) as usize] = seed;
        if self.places[order[seed as usize] as usize] == ALONE {
            return;
        }
        stack.push(seed);
        while let Some(at) = stack.pop() {
            self.for_neighbours(order[at as usize], |fan, place| {
                let index = place.wrapping_sub(first) as usize;
                if index < seeds.len() && seeds[index] == UNSEEN && order[place as usize] == fan {
                    seeds[index] = seed;
                    stack.push(place);
                }
            });
        }
    }

    /// The fans around a fan's ring, with their places.
    #[inline]
    fn for_neighbours(&self, fan: u32, mut visit: impl FnMut(u32, u32)) {
        let corners = self.fans.corners(fan as usize);
        let mut visit = |fan: u32| visit(fan, self.places[fan as usize]);
        for corner in corners {
            visit(self.fans.of_triangle(corner.triangle())[corner.slots()[1]]);
        }
        if !self.fans.is_closed(fan as usize)
            && let Some(last) = corners.last()
        {
            visit(self.fans.of_triangle(last.triangle())[last.slots()[2]]);
        }
    }

    /// Gives every fragment that finds one the seed of a larger piece.
    fn absorb(&self, items: &[Item], seeds: &mut [u32], facing: f32) {
        let mut pieces = vec![Piece::default(); items.len()];
        for (item, &seed) in items.iter().zip(seeds.iter()) {
            pieces[seed as usize].add(item);
        }
        let mut members: Vec<(u32, u32)> =
            seeds.iter().copied().zip(0..).filter(|&(seed, _)| pieces[seed as usize].is_fragment()).collect();
        members.par_sort_unstable();
        let mut fragments: Vec<&[(u32, u32)]> = members.chunk_by(|a, b| a.0 == b.0).collect();
        for _ in 0..ROUNDS {
            let targets: Vec<Option<u32>> = fragments
                .par_iter()
                .with_min_len(64)
                .map_init(Vec::new, |borders, fragment| {
                    self.longest_borders(items, seeds, &pieces, fragment, borders);
                    borders.iter().map(|b| b.1).find(|&seed| {
                        self.sees(pieces[seed as usize].axis.normalize_or_zero(), items, fragment, facing)
                    })
                })
                .collect();
            let mut targets = targets.into_iter();
            fragments.retain(|fragment| {
                let target = targets.next().flatten();
                for &(_, at) in target.iter().flat_map(|_| fragment.iter()) {
                    seeds[at as usize] = target.unwrap_or(UNSEEN);
                }
                target.is_none()
            });
        }
    }

    /// The pieces around a fragment that are none themselves, as `(length of the common border, seed)`, the longest first.
    fn longest_borders(
        &self,
        items: &[Item],
        seeds: &[u32],
        pieces: &[Piece],
        fragment: &[(u32, u32)],
        borders: &mut Vec<(u32, u32)>,
    ) {
        borders.clear();
        for &(_, at) in fragment {
            self.for_neighbours(items[at as usize].fan, |_, place| {
                if place == ALONE || pieces[seeds[place as usize] as usize].is_fragment() {
                    return;
                }
                let seed = seeds[place as usize];
                match borders.iter_mut().find(|b| b.1 == seed) {
                    Some(border) => border.0 += 1,
                    None => borders.push((1, seed)),
                }
            });
        }
        borders.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    }

    /// True where every triangle around a fragment's fans faces a direction well enough.
    fn sees(&self, direction: Vec3, items: &[Item], fragment: &[(u32, u32)], facing: f32) -> bool {
        fragment.iter().all(|&(_, at)| {
            let fan = items[at as usize].fan as usize;
            self.places[fan] != ALONE && farthest_cosine(self.shapes[fan].cone, direction) >= facing
        })
    }
}

/// Sums over the items of a connected piece.
#[derive(Clone, Copy, Default)]
struct Piece {
    axis: Vec3,
    texels: f32,
}

impl Piece {
    fn add(&mut self, item: &Item) {
        self.axis += item.axis * item.area;
        self.texels += item.area * item.density * item.density;
    }

    fn is_fragment(&self) -> bool {
        self.texels <= FRAGMENT_TEXELS
    }
}

/// The cosine between a direction and the member of a cone that lies farthest from it.
fn farthest_cosine(Cone { axis, cos }: Cone, direction: Vec3) -> f32 {
    let between = axis.dot(direction);
    let sines = ((1.0 - between * between).max(0.0) * (1.0 - cos * cos).max(0.0)).sqrt();
    between * cos - sines
}

/// Fans stable-sorted by seed, and the number of fans of each seed, ascending. Seeds count from `first`.
fn sorted_by_seed(fans: &[u32], seeds: &[u32], first: u32) -> (Vec<u32>, Vec<u32>) {
    let mut ends = vec![0_u32; fans.len()];
    for &seed in seeds {
        ends[(seed - first) as usize] += 1;
    }
    let lengths: Vec<u32> = ends.iter().copied().filter(|&n| n > 0).collect();
    let mut sum = 0;
    for end in &mut ends {
        sum += std::mem::replace(end, sum);
    }
    let mut sorted = vec![0; fans.len()];
    for (&fan, &seed) in fans.iter().zip(seeds) {
        let end = &mut ends[(seed - first) as usize];
        sorted[*end as usize] = fan;
        *end += 1;
    }
    (sorted, lengths)
}
