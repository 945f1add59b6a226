//! Where a chart that hangs together overlaps itself.
//!
//! All of its triangles lie the same way up, so its border crosses itself where it overlaps, or it overlaps around a point of the border.

use std::cmp::Ordering;
use std::f64::consts::TAU;

use fantex_base::sweep::any_pair_of_boxes;
use glam::{DVec2, Vec2};
use rustc_hash::FxHashMap;

use crate::charts::{Chart, NONE};
use crate::slots::Slots;

/// A side of a triangle on the border of a chart.
#[derive(Clone, Copy)]
struct Side {
    /// Its triangle's index in the chart.
    index: usize,
    ends: [DVec2; 2],
}

impl Side {
    /// Along x and along y.
    fn ranges(&self) -> [(f64, f64); 2] {
        let [a, b] = self.ends;
        [(a.x.min(b.x), a.x.max(b.x)), (a.y.min(b.y), a.y.max(b.y))]
    }

    /// Whether two sides cross, not counting those that end at each other.
    fn crosses(&self, other: &Self) -> bool {
        let straddles = |a: &Self, b: &Self| {
            let along = a.ends[1] - a.ends[0];
            let [p, q] = b.ends.map(|p| along.perp_dot(p - a.ends[0]));
            // Distances from the line, as shares of the side's length.
            p * q < 0.0 && p.abs().min(q.abs()) > ROUNDING * along.length_squared()
        };
        straddles(self, other) && straddles(other, self)
    }
}

/// Sides that reach over each other by less of their length end at each other.
const ROUNDING: f64 = 1e-5;

/// Triangles around a point that overlap by less, radians, lie beside each other: what single precision leaves of the angles of slivers.
const ROUNDING_OF_ANGLES: f64 = 1e-4;

/// Numbers a chart's triangles, and visits their sides: the triangle's index, which of its sides it is, and the index of the triangle beyond that
/// has the same side in the plane, if there is one.
pub(crate) fn for_each_side(
    chart: &Chart,
    across: &[u32],
    slots: &Slots,
    mut visit: impl FnMut(usize, usize, Option<usize>),
) {
    slots.number(&chart.triangles);
    // What is no triangle of the chart has any number.
    let index_of = |t: u32| Some(slots.of(t) as usize).filter(|&i| chart.triangles.get(i) == Some(&t));
    for (index, (triangle, corners)) in chart.iter().enumerate() {
        for (k, half_edge) in (0..3).zip(3 * triangle..) {
            let other = across[half_edge as usize];
            let beyond = if other == NONE { None } else { index_of(other / 3) };
            let ends = [corners[k], corners[(k + 1) % 3]];
            let is_same = |beyond: &usize| {
                let (corners, at) = (chart.corners[*beyond], other as usize % 3);
                [corners[(at + 1) % 3], corners[at]] == ends
            };
            visit(index, k, beyond.filter(is_same));
        }
    }
}

/// Which triangles have no side on the border that crosses another one's, but for the larger one of any two: where a chart that hangs together
/// overlaps itself, its border crosses itself. Numbers the chart's triangles.
pub(crate) fn without_crossings(chart: &Chart, across: &[u32], slots: &Slots) -> Vec<bool> {
    let mut sides = Vec::new();
    for_each_side(chart, across, slots, |index, k, beyond| {
        if beyond.is_none() {
            let corners = chart.corners[index];
            sides.push(Side { index, ends: [corners[k], corners[(k + 1) % 3]].map(Vec2::as_dvec2) });
        }
    });
    sides.sort_by(|a, b| a.ranges()[0].0.total_cmp(&b.ranges()[0].0));
    let mut is_taken = vec![true; chart.triangles.len()];
    any_pair_of_boxes(&sides, Side::ranges, usize::MAX, |one, other| {
        if one.index != other.index && one.crosses(other) {
            is_taken[smaller(chart, one.index, other.index)] = false;
        }
        false
    });
    for [one, other] in overlaps_at_points(chart, &sides) {
        is_taken[smaller(chart, one, other)] = false;
    }
    is_taken
}

/// The smaller of two triangles; of two alike the later one, whichever way around they are asked for. So not all triangles of a chart are
/// the smaller of some two.
fn smaller(chart: &Chart, one: usize, other: usize) -> usize {
    let area = |index: usize| {
        let [a, b, c] = chart.corners[index];
        (b - a).perp_dot(c - a).abs()
    };
    match area(one).total_cmp(&area(other)).then(other.cmp(&one)) {
        Ordering::Less => one,
        Ordering::Equal | Ordering::Greater => other,
    }
}

/// Triangles with a corner at the same point of the border that overlap there, in pairs: their sides end at each other and do not cross.
fn overlaps_at_points(chart: &Chart, sides: &[Side]) -> Vec<[usize; 2]> {
    let key = |p: Vec2| p.to_array().map(f32::to_bits);
    let mut names: FxHashMap<[u32; 2], u32> = FxHashMap::default();
    let mut points: Vec<BorderPoint> = Vec::new();
    for (is_begin, end) in sides.iter().flat_map(|side| [true, false].into_iter().zip(side.ends)) {
        let name = *names.entry(key(end.as_vec2())).or_insert(points.len() as u32);
        if name as usize == points.len() {
            points.push(BorderPoint::default());
        }
        points[name as usize].sides += u32::from(is_begin);
    }
    let wedge = |index: usize, k: usize| {
        let [at, next, previous] = [0, 1, 2].map(|i| chart.corners[index][(k + i) % 3].as_dvec2());
        // v points downwards: the triangle lies clockwise of its first side.
        [previous - at, next - at]
    };
    let mut at_border = Vec::new();
    for (index, corners) in chart.corners.iter().enumerate() {
        for (k, corner) in corners.iter().enumerate() {
            let Some(&name) = names.get(&key(*corner)) else { continue };
            points[name as usize].add(wedge(index, k));
            at_border.push((name, index, k));
        }
    }
    // Point, direction where the triangle begins there, how far it reaches around, and its index.
    let mut wedges: Vec<(u32, f64, f64, usize)> = at_border
        .into_iter()
        .filter(|&(name, ..)| points[name as usize].may_overlap())
        .map(|(name, index, k)| {
            let [from, to] = wedge(index, k);
            (name, libm::atan2(from.y, from.x), from.angle_to(to), index)
        })
        .collect();
    wedges.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut overlaps = Vec::new();
    for around in wedges.chunk_by(|a, b| a.0 == b.0).filter(|around| around.len() > 1) {
        for (i, &(_, from, span, index)) in around.iter().enumerate() {
            let (_, next, _, other) = around[(i + 1) % around.len()];
            let gap = if i + 1 < around.len() { next - from } else { next + TAU - from };
            if index != other && span > gap + ROUNDING_OF_ANGLES {
                overlaps.push([index, other]);
            }
        }
    }
    overlaps
}

/// What tells at most points, without their angles, that triangles lie beside each other: those around a point at which one side of the border
/// begins are a single chain, each glued to the next, and do not overlap if they do not go all around together.
#[derive(Clone, Copy, Default)]
struct BorderPoint {
    /// Those that begin there.
    sides: u32,
    /// The triangles go around it by less than so many right angles.
    right_angles: u32,
    /// Some triangle is so narrow there that rounding may have turned it over.
    is_unsure: bool,
}

/// Sine of an angle that rounding does not turn over.
const SURE_SINE: f64 = 1e-2;

impl BorderPoint {
    /// Adds a triangle, given by where its sides go from the point.
    fn add(&mut self, [from, to]: [DVec2; 2]) {
        self.right_angles += if from.dot(to) > 0.0 { 1 } else { 2 };
        let sine = from.perp_dot(to);
        self.is_unsure |= !(sine > 0.0
            && sine * sine > SURE_SINE * SURE_SINE * from.length_squared() * to.length_squared());
    }

    fn may_overlap(&self) -> bool {
        self.sides != 1 || self.right_angles > 4 || self.is_unsure
    }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::Mesh;

    use super::*;
    use crate::charts::continued;

    /// A fan of triangles around a point, all of the given angle in the plane.
    fn fan(count: u32, degrees: f32) -> (Mesh, Chart) {
        let triangles: Vec<[u32; 3]> = (0..count).map(|i| [0, 1 + i, 2 + i]).collect();
        let mesh = Mesh { triangles, ..Mesh::default() };
        let rim = |i: u32| Vec2::from_angle(-(degrees * i as f32).to_radians());
        let corners = (0..count).map(|i| [Vec2::ZERO, rim(i), rim(i + 1)]).collect();
        (mesh, Chart::new((0..count).collect(), corners))
    }

    #[test]
    fn fans_that_go_around_once_are_left_whole_and_others_are_not() {
        for (count, degrees, is_whole) in
            [(4, 80.0, true), (6, 60.0, true), (6, 65.0, false), (3, 150.0, false)]
        {
            let (mesh, chart) = fan(count, degrees);
            let is_taken = without_crossings(&chart, &continued(&mesh), &Slots::new(mesh.triangles.len()));
            assert_eq!(is_taken.iter().all(|&is| is), is_whole, "{count} of {degrees} degrees: {is_taken:?}");
        }
    }

    /// The tip of a triangle over the side of its like: seen from left to right, each of the two crosses the other first.
    #[test]
    fn one_of_two_alike_that_cross_is_taken() {
        let triangle = |x: f32, y: f32| [[x, y], [x + 1.0, y + 2.0], [x + 2.0, y]].map(Vec2::from);
        let mesh = Mesh { triangles: vec![[0, 1, 2], [3, 4, 5]], ..Mesh::default() };
        let chart = Chart::new(vec![0, 1], vec![triangle(0.0, 0.0), triangle(0.5, 1.75)]);
        assert_eq!(
            without_crossings(&chart, &continued(&mesh), &Slots::new(mesh.triangles.len())),
            [true, false]
        );
    }

    /// Two squares of two triangles each, the second moved by this much to the right of the first one's left side.
    #[test]
    fn borders_that_cross_are_found_and_those_that_touch_are_not() {
        for (shift, is_whole) in [(1.0, true), (1.5, true), (0.9999, false), (0.5, false)] {
            let square = |x: f32, y: f32| {
                let p = |i: f32, j: f32| Vec2::new(x + i, y + j);
                [[p(0., 0.), p(1., 1.), p(1., 0.)], [p(0., 0.), p(0., 1.), p(1., 1.)]]
            };
            let triangles = vec![[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]];
            let mesh = Mesh { triangles, ..Mesh::default() };
            let chart = Chart::new((0..4).collect(), [square(0., 0.), square(shift, 0.3)].concat());
            let is_taken = without_crossings(&chart, &continued(&mesh), &Slots::new(mesh.triangles.len()));
            assert_eq!(is_taken.iter().all(|&is| is), is_whole, "moved by {shift}: {is_taken:?}");
        }
    }
}
