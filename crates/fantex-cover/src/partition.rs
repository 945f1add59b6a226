//! Top-down partition of the fans into patches of about one tile's extent and coherent normals.
//!
//! Like a surface-area kd-tree builder, but planes are chosen for tiles: where normals agree, a set is cut across its longer
//! side in its own projection plane, at a multiple of the target extent, so that patches come out as nearly square cells that
//! fill their bounding rectangles. Where normals disagree, a set much larger than a tile is cut in space, a small one between
//! its two bundles of normals. Every cut permutes one array in place; the order of the result follows the cuts and is
//! therefore a space-filling curve over the surface.

use fantex_mesh::{Fans, unit_vector};
use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::cone::Cone;
use crate::fan_shape::{FanShape, Layout};

/// One fan, as the partition sees it. Mesh space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Item {
    pub(crate) position: Vec3,
    /// Best direction of the fan.
    pub(crate) axis: Vec3,
    /// A third of the area of the fan's triangles.
    pub(crate) area: f32,
    /// Nominal texels per mesh unit here.
    pub(crate) density: f32,
    pub(crate) fan: u32,
}

/// When a set of fans is a patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PatchLimits {
    /// Longest side in texels.
    pub(crate) extent_texels: f32,
    /// Smallest cosine between the patch's direction and a fan's.
    pub(crate) facing: f32,
}

/// Sets larger than this are split on two threads.
const PARALLEL_FROM: usize = 8192;

/// A set longer than this many tiles is cut in space, whatever its normals.
const SPATIAL_CUT_FROM: f32 = 3.0;

/// Below this ratio of the summed to the absolute normals a set has no plane of its own.
const COHERENT: f32 = 0.75;

/// Permutes the items so that patches are contiguous; returns their lengths in order.
pub(crate) fn partition(items: &mut [Item], limits: &PatchLimits) -> Vec<u32> {
    let Some(cut) = Summary::of(items).cut(items, limits) else {
        return vec![items.len() as u32];
    };
    let middle = separate(items, |item| cut.key(item) < cut.threshold);
    let middle = if middle == 0 || middle == items.len() { halve(items, &cut) } else { middle };
    let (left, right) = items.split_at_mut(middle);
    let (mut first, second) = if left.len() + right.len() >= PARALLEL_FROM {
        rayon::join(|| partition(left, limits), || partition(right, limits))
    } else {
        (partition(left, limits), partition(right, limits))
    };
    first.extend(second);
    first
}

/// A plane: items with a smaller key go left.
struct Cut {
    direction: Vec3,
    by_normal: bool,
    threshold: f32,
}

impl Cut {
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

/// Moments of a set of items.
#[derive(Clone, Copy, Default)]
struct Summary {
    area: f32,
    axis: Vec3,
    density: f32,
    position: Vec3,
    largest: f32,
    low: Vec3,
    high: Vec3,
}

impl Summary {
    fn of(items: &[Item]) -> Self {
        let mut s = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, ..Self::default() };
        // Partial sums of fixed length keep single precision accurate, and the same on any number of threads.
        for chunk in items.chunks(512) {
            let mut c = Self::default();
            for item in chunk {
                c.area += item.area;
                c.axis += item.axis * item.area;
                c.density += item.density * item.area;
                c.position += item.position;
                s.low = s.low.min(item.position);
                s.high = s.high.max(item.position);
                s.largest = s.largest.max(item.area);
            }
            s.area += c.area;
            s.axis += c.axis;
            s.density += c.density;
            s.position += c.position;
        }
        s.position /= items.len() as f32;
        s
    }

    /// The plane to cut at, or `None` for a patch.
    fn cut(&self, items: &[Item], limits: &PatchLimits) -> Option<Cut> {
        if items.len() < 2 {
            return None;
        }
        let density = self.density / self.area.max(f32::MIN_POSITIVE);
        let target = limits.extent_texels / density.max(f32::MIN_POSITIVE);
        let size = self.high - self.low;
        if size.max_element() > 2.0 * SPATIAL_CUT_FROM * target && items.len() > 256 {
            return Some(self.cut_box(size));
        }
        let coherent = self.axis.length() > COHERENT * self.area;
        let direction = self.axis.normalize_or_zero();
        if coherent {
            let facing = items.iter().map(|i| i.axis.dot(direction)).fold(f32::INFINITY, f32::min);
            let (long_axis, side) = self.long_side(items, direction);
            // Partial fans reach beyond their centres by about half an edge.
            let reach = 1.15 * (self.area / items.len() as f32).sqrt();
            let length = side.1 - side.0 + reach;
            if length > target && (facing >= limits.facing || length > SPATIAL_CUT_FROM * target) {
                let cells = (length / target).ceil();
                let threshold = side.0 + (side.1 - side.0) * (cells * 0.5).floor() / cells;
                return Some(Cut { direction: long_axis, by_normal: false, threshold });
            }
            if facing >= limits.facing {
                return None;
            }
        } else if size.max_element() > SPATIAL_CUT_FROM * target {
            return Some(self.cut_box(size));
        }
        Some(self.cut_normals(items))
    }

    /// Across the longest side of the bounding box, at the centroid.
    fn cut_box(&self, size: Vec3) -> Cut {
        let axis = size.max_position();
        let mut direction = Vec3::ZERO;
        direction[axis] = 1.0;
        Cut { direction, by_normal: false, threshold: self.position[axis] }
    }

    /// The principal axis of the positions in the plane orthogonal to `direction`, or the perpendicular one if the set is
    /// longer along it, with the range of the positions.
    fn long_side(&self, items: &[Item], direction: Vec3) -> (Vec3, (f32, f32)) {
        let (x_axis, y_axis) = direction.any_orthonormal_pair();
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for item in items {
            let p = item.position - self.position;
            let (x, y) = (p.dot(x_axis), p.dot(y_axis));
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
        let turn = unit_vector(0.5 * libm::atan2f(2.0 * xy, xx - yy));
        let u = x_axis * turn.x + y_axis * turn.y;
        let v = direction.cross(u);
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for item in items {
            for (k, axis) in [u, v].into_iter().enumerate() {
                let x = item.position.dot(axis);
                low[k] = low[k].min(x);
                high[k] = high[k].max(x);
            }
        }
        let k = usize::from(high[1] - low[1] > high[0] - low[0]);
        ([u, v][k], (low[k], high[k]))
    }

    /// Between the two bundles of normals: across the direction of greatest variance.
    fn cut_normals(&self, items: &[Item]) -> Cut {
        let mean = self.axis / self.area.max(f32::MIN_POSITIVE);
        let mut covariance = Mat3::ZERO;
        for item in items {
            let d = item.axis - mean;
            covariance += Mat3::from_cols(d * d.x, d * d.y, d * d.z) * item.area;
        }
        let direction = principal_axis(covariance);
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for item in items {
            let x = item.axis.dot(direction);
            low = low.min(x);
            high = high.max(x);
        }
        Cut { direction, by_normal: true, threshold: 0.5 * (low + high) }
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
