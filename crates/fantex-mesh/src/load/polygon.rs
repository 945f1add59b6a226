//! Cutting polygons into triangles.
//!
//! Ear clipping after G. H. Meisters, "Polygons have ears" (1975), on the polygon's projection along its area normal
//! (M. E. Newell's sum over the edges, so that slightly bent polygons work). Unlike the usual triangulation crates it
//! never drops a corner, not even on a straight edge: a neighbour uses that corner too, and a dropped one would tear
//! the surface. So an n-gon always becomes n - 2 triangles in the polygon's orientation; triangles that come out
//! degenerate are the cleaning's business.

use glam::{DVec2, DVec3};

#[derive(Default)]
pub(crate) struct Triangulator {
    projected: Vec<DVec2>,
    /// Corners not yet cut off, a circular list.
    next: Vec<u32>,
    previous: Vec<u32>,
    /// Corners that may lie inside an ear: those that are not strictly convex.
    blockers: Vec<u32>,
    /// Comparisons of ears with blockers that are left.
    comparisons: usize,
}

/// Cuts polygons into triangles: `counts` says how many of the `points`, which index `positions`, each has. The triangles index `points`; `n - 2`
/// of an n-gon, one polygon after the other, in its orientation.
///
/// # Panics
/// Where the counts are not those of the points, or a point is out of range.
pub fn cut_polygons(positions: &[DVec3], counts: &[usize], points: &[usize]) -> Vec<[usize; 3]> {
    assert_eq!(counts.iter().sum::<usize>(), points.len(), "each point belongs to a polygon");
    let mut triangulator = Triangulator::default();
    let (mut triangles, mut outline) = (Vec::new(), Vec::new());
    let mut first = 0;
    for count in counts {
        outline.clear();
        outline.extend(points[first..first + count].iter().map(|&point| positions[point]));
        triangulator.triangulate(&outline, |corners| triangles.push(corners.map(|k| first + k)));
        first += count;
    }
    triangles
}

/// Comparisons for one polygon, beyond which it is cut without looking: enough for outlines of 16 384 corners of which a handful
/// are tried for each cut, and for any of up to 600.
const MAX_COMPARISONS: usize = 1 << 28;

impl Triangulator {
    /// Calls `emit` with corner numbers (`0..corners.len()`) of `corners.len() - 2` triangles.
    pub(crate) fn triangulate(&mut self, corners: &[DVec3], mut emit: impl FnMut([usize; 3])) {
        match corners {
            [] | [_] | [_, _] => {}
            [_, _, _] => emit([0, 1, 2]),
            _ => self.cut(corners, emit),
        }
    }

    fn cut(&mut self, corners: &[DVec3], mut emit: impl FnMut([usize; 3])) {
        self.project(corners);
        let count = corners.len();
        let is_convex =
            (0..count).all(|i| self.turn(self.at((i + count - 1) % count, i, (i + 1) % count)) > 0.0);
        // A polygon that only turns left may still wind around several times, but its turns then exceed a full circle.
        if is_convex && self.winds_once() {
            (2..count).for_each(|i| emit([0, i - 1, i]));
            return;
        }
        self.clip_ears(count, emit);
    }

    /// Projects along the area normal, relative to the first corner to keep precision far from the origin.
    fn project(&mut self, corners: &[DVec3]) {
        let origin = corners[0];
        let edges = corners.iter().zip(corners.iter().cycle().skip(1));
        let normal = edges.map(|(&a, &b)| (a - origin).cross(b - origin)).sum::<DVec3>();
        let normal = normal.try_normalize().unwrap_or(DVec3::Z);
        let (x_axis, y_axis) = normal.any_orthonormal_pair();
        // The pair is right-handed with the normal, so the projection is counter-clockwise.
        self.projected.clear();
        self.projected.extend(corners.iter().map(|&p| {
            let q = p - origin;
            DVec2::new(q.dot(x_axis), q.dot(y_axis))
        }));
    }

    fn at(&self, a: usize, b: usize, c: usize) -> [DVec2; 3] {
        [self.projected[a], self.projected[b], self.projected[c]]
    }

    /// Positive for a left turn, zero for straight on.
    fn turn(&self, [a, b, c]: [DVec2; 3]) -> f64 {
        (b - a).perp_dot(c - b)
    }

    fn winds_once(&self) -> bool {
        let count = self.projected.len();
        let edge = |i: usize| self.projected[(i + 1) % count] - self.projected[i];
        let turns: f64 = (0..count).map(|i| edge(i).angle_to(edge((i + 1) % count))).sum();
        turns < 3.0 * std::f64::consts::PI
    }

    fn clip_ears(&mut self, count: usize, mut emit: impl FnMut([usize; 3])) {
        self.next.clear();
        self.next.extend((0..count as u32).map(|i| (i + 1) % count as u32));
        self.previous.clear();
        self.previous.extend((0..count as u32).map(|i| (i + count as u32 - 1) % count as u32));
        let blockers = (0..count).filter(|&i| self.turn(self.ear(i)) <= 0.0).map(|i| i as u32).collect();
        self.blockers = blockers;
        self.comparisons = MAX_COMPARISONS;
        let mut left = count;
        let mut tip = 0;
        let mut tried = 0;
        while left > 3 {
            // Where no ear is left (the outline crosses itself), anything that keeps the corner count right will do, from then on.
            if tried >= left {
                self.comparisons = 0;
            }
            if self.comparisons > 0 && !self.is_ear(tip) {
                tip = self.next[tip] as usize;
                tried += 1;
                continue;
            }
            let (before, after) = (self.previous[tip] as usize, self.next[tip] as usize);
            emit([before, tip, after]);
            self.next[before] = after as u32;
            self.previous[after] = before as u32;
            self.forget(tip, before, after);
            left -= 1;
            tried = 0;
            // A cut makes new ears at its two ends only, or frees some that these ends blocked. Trying the ends first
            // keeps long winding outlines (spirals) from being searched all around after every cut.
            tip = before;
        }
        emit([self.previous[tip] as usize, tip, self.next[tip] as usize]);
    }

    /// Takes a cut corner, and neighbours that became convex, off the list of blockers.
    fn forget(&mut self, tip: usize, before: usize, after: usize) {
        let turned_convex = [before, after].map(|i| self.turn(self.ear(i)) > 0.0);
        self.blockers.retain(|&b| {
            let b = b as usize;
            !(b == tip || (b == before && turned_convex[0]) || (b == after && turned_convex[1]))
        });
    }

    fn ear(&self, tip: usize) -> [DVec2; 3] {
        self.at(self.previous[tip] as usize, tip, self.next[tip] as usize)
    }

    /// A corner is an ear if it turns left and no other corner lies inside or on the cut.
    fn is_ear(&mut self, tip: usize) -> bool {
        let [a, b, c] = self.ear(tip);
        self.comparisons = self.comparisons.saturating_sub(1);
        if self.turn([a, b, c]) <= 0.0 {
            return false;
        }
        self.comparisons = self.comparisons.saturating_sub(self.blockers.len());
        let own = [self.previous[tip], tip as u32, self.next[tip]];
        !self.blockers.iter().any(|i| {
            let p = self.projected[*i as usize];
            // A corner at the same place as the ear's own (a bridge to a hole) does not block it.
            !own.contains(i)
                && p != a
                && p != b
                && p != c
                && (b - a).perp_dot(p - a) >= 0.0
                && (c - b).perp_dot(p - b) >= 0.0
                && (a - c).perp_dot(p - c) >= 0.0
        })
    }
}
