//! Do any two segments of a region's boundary meet?
//!
//! Usually few of their boxes do, and a sweep over these finds out soonest. Where many do, as in combs, stars and spirals, a sweep keeps the segments
//! in order along its line: two that meet are neighbours just before (M. I. Shamos and D. Hoey, "Geometric Intersection Problems", 1976).

use std::cell::Cell;
use std::cmp::Ordering;

use fantex_base::sweep::any_pair_of_boxes;
use glam::{DVec2, Vec2};

/// A boundary segment, named by its vertices so that neighbours are recognised. The region lies to its left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) vertices: [u32; 2],
    pub(crate) ends: [Vec2; 2],
}

impl Segment {
    pub(crate) fn new(vertices: [u32; 2], ends: [Vec2; 2]) -> Self {
        Self { vertices, ends }
    }

    /// Along x and along y.
    fn ranges(&self) -> [(f32, f32); 2] {
        let [a, b] = self.ends;
        [(a.x.min(b.x), a.x.max(b.x)), (a.y.min(b.y), a.y.max(b.y))]
    }

    /// Whether two segments without a common vertex meet, whose boxes do.
    fn crosses(&self, other: &Segment) -> bool {
        if self.vertices.iter().any(|v| other.vertices.contains(v)) {
            return false;
        }
        let straddles = |s: &Segment, o: &Segment| {
            let line = s.ends.map(Vec2::as_dvec2);
            side(line, o.ends[0].as_dvec2()) * side(line, o.ends[1].as_dvec2()) <= 0.0
        };
        straddles(self, other) && straddles(other, self)
    }

    fn meets(&self, other: &Segment) -> bool {
        let overlap = std::iter::zip(self.ranges(), other.ranges())
            .all(|((low, high), (other_low, other_high))| low <= other_high && other_low <= high);
        overlap && self.crosses(other)
    }
}

/// Positive for points to the left of a line.
fn side([from, to]: [DVec2; 2], p: DVec2) -> f64 {
    (to - from).perp_dot(p - from)
}

/// So many pairs of boxes are looked at for each segment, in the mean, before segments are kept in order: where few meet, boxes are
/// the quicker way.
const PAIRS_PER_SEGMENT: usize = 32;

/// True where two segments without a common vertex meet. Reorders `segments`.
pub(crate) fn any_crossing(segments: &mut [Segment]) -> bool {
    let start = |segment: &Segment| segment.ranges()[0].0;
    segments.sort_unstable_by(|a, b| start(a).total_cmp(&start(b)).then(a.vertices.cmp(&b.vertices)));
    let of_boxes = |max_pairs| any_pair_of_boxes(segments, Segment::ranges, max_pairs, Segment::crosses);
    // The last is for segments that have no order: points, and some that lie along each other.
    of_boxes(PAIRS_PER_SEGMENT * segments.len())
        .or_else(|| Line::new(segments).sweep())
        .or_else(|| of_boxes(usize::MAX))
        .unwrap_or(true)
}

/// The line of the sweep, which goes from left to right, with the segments that it meets from below to above.
struct Line<'a> {
    segments: &'a [Segment],
    /// The ends of each, the left one first; of upright ones the lower one.
    spans: Vec<[DVec2; 2]>,
    /// None is empty.
    blocks: Vec<Vec<u32>>,
    /// Two lie along each other, and have no order.
    is_tied: Cell<bool>,
}

/// Blocks of more segments are halved.
const MAX_BLOCK: usize = 256;

impl<'a> Line<'a> {
    fn new(segments: &'a [Segment]) -> Self {
        let span = |segment: &Segment| {
            let [a, b] = segment.ends.map(Vec2::as_dvec2);
            if by_place(a, b).is_le() { [a, b] } else { [b, a] }
        };
        Self {
            segments,
            spans: segments.iter().map(span).collect(),
            blocks: Vec::new(),
            is_tied: Cell::new(false),
        }
    }

    /// Whether two meet; `None` where rounding has spoilt the order, or there is none.
    fn sweep(mut self) -> Option<bool> {
        if self.spans.iter().any(|[left, right]| left == right) {
            return None;
        }
        // At one place segments begin first: what ends there may meet them.
        let ends = self.spans.iter().zip(0u32..);
        let mut events: Vec<(DVec2, bool, u32)> =
            ends.flat_map(|(&[left, right], s)| [(left, false, s), (right, true, s)]).collect();
        events.sort_unstable_by(|a, b| by_place(a.0, b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for (_, is_end, s) in events {
            let place = self.place(s);
            if self.is_tied.get() {
                return None;
            }
            let pairs = if is_end {
                if self.at(place) != Some(s) {
                    return None;
                }
                self.remove(place);
                [self.below(place).zip(self.at(place)), None]
            } else {
                let around = [self.below(place), self.at(place)];
                self.insert(place, s);
                around.map(|other| other.map(|other| (s, other)))
            };
            if pairs.into_iter().flatten().any(|(a, b)| self.meet(a, b)) {
                return Some(true);
            }
        }
        Some(false)
    }

    fn meet(&self, a: u32, b: u32) -> bool {
        self.segments[a as usize].meets(&self.segments[b as usize])
    }

    /// Whether a segment lies below another one, where the line meets both.
    fn compare(&self, a: u32, b: u32) -> Ordering {
        let [(from, to), (other_from, other_to)] = [a, b].map(|s| self.spans[s as usize].into());
        if by_place(from, other_from).is_lt() {
            return self.compare(b, a).reverse();
        }
        // The later one as the earlier one sees it; above what ends where it begins.
        if from == other_to {
            return Ordering::Greater;
        }
        let of = |p: DVec2| side([other_from, other_to], p);
        let order = |p: DVec2| of(p).partial_cmp(&0.0).unwrap_or(Ordering::Equal);
        let order = order(from).then_with(|| order(to));
        self.is_tied.set(self.is_tied.get() || order.is_eq() && a != b);
        order
    }

    /// Block and index of the first segment that does not lie below one.
    fn place(&self, s: u32) -> (usize, usize) {
        let is_below = |&other: &u32| self.compare(other, s).is_lt();
        let block = self.blocks.partition_point(|block| block.last().is_some_and(is_below));
        (block, self.blocks.get(block).map_or(0, |block| block.partition_point(is_below)))
    }

    /// The segment at a place; none above all.
    fn at(&self, (block, index): (usize, usize)) -> Option<u32> {
        match self.blocks.get(block)?.get(index) {
            Some(&s) => Some(s),
            None => self.blocks.get(block + 1)?.first().copied(),
        }
    }

    /// The segment below a place.
    fn below(&self, (block, index): (usize, usize)) -> Option<u32> {
        match index.checked_sub(1) {
            Some(index) => self.blocks.get(block)?.get(index).copied(),
            None => self.blocks.get(block.checked_sub(1)?)?.last().copied(),
        }
    }

    fn insert(&mut self, (block, index): (usize, usize), s: u32) {
        if block == self.blocks.len() {
            self.blocks.push(Vec::new());
        }
        let full = &mut self.blocks[block];
        full.insert(index, s);
        if full.len() > MAX_BLOCK {
            let upper = full.split_off(MAX_BLOCK / 2);
            self.blocks.insert(block + 1, upper);
        }
    }

    /// Places above move down by one.
    fn remove(&mut self, (block, index): (usize, usize)) {
        self.blocks[block].remove(index);
        if self.blocks[block].is_empty() {
            self.blocks.remove(block);
        }
    }
}

/// From left to right, then from below to above.
fn by_place(a: DVec2, b: DVec2) -> Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y))
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;

    use super::*;

    fn by_pairs(segments: &[Segment]) -> bool {
        segments.iter().enumerate().any(|(i, one)| segments[i + 1..].iter().any(|other| one.meets(other)))
    }

    /// Closed curves through places of a small grid: many corners at one place, many segments along each other, many points.
    #[test]
    fn kept_in_order_the_same_meet() {
        let mut random = Random::new(6);
        let mut counts = [0; 3];
        for round in 0..30_000 {
            let side = 3 + round % 20;
            let (mut segments, mut name) = (Vec::new(), 0);
            for _ in 0..=random.below(2) {
                let count = 3 + random.below(5) as u32;
                let places: Vec<Vec2> = (0..count)
                    .map(|_| Vec2::new(random.below(side) as f32, random.below(side) as f32))
                    .collect();
                for i in 0..count {
                    let next = (i + 1) % count;
                    let ends = [i, next].map(|k| places[k as usize]);
                    segments.push(Segment::new([name + i, name + next], ends));
                }
                name += count;
            }
            let expected = by_pairs(&segments);
            let found = Line::new(&segments).sweep();
            // Rounding does not spoil whole numbers, but lines along each other may.
            assert!(found.is_none_or(|found| found == expected), "{segments:?}");
            counts[2] += usize::from(found.is_none());
            assert_eq!(any_crossing(&mut segments), expected);
            counts[usize::from(expected)] += 1;
        }
        // Many cannot be kept in order: points, and segments along each other.
        assert!(counts[0] > 1_000 && counts[1] > 1_000 && counts[2] < 15_000, "{counts:?}");
    }

    /// A star whose every second corner lies at the rim, and its first segment.
    fn star(points: u32) -> Vec<Segment> {
        let corner = |i: u32| {
            let radius = if i.is_multiple_of(2) { 1.0 } else { 0.2 };
            (DVec2::from_angle(f64::from(i) / f64::from(2 * points) * std::f64::consts::TAU) * radius)
                .as_vec2()
        };
        let count = 2 * points;
        (0..count).map(|i| [i, (i + 1) % count]).map(|pair| Segment::new(pair, pair.map(corner))).collect()
    }

    /// Nearly all boxes of a quarter of a star meet: as pairs they would take minutes.
    #[test]
    fn large_stars_take_no_pairs() {
        let mut segments = star(300_000);
        assert!(!any_crossing(&mut segments));
        // A line across two of its points.
        let across = [Vec2::new(0.9, -1e-5), Vec2::new(0.9, 1e-5)];
        segments.push(Segment::new([1_000_000, 1_000_001], across));
        assert!(any_crossing(&mut segments));
    }
}
