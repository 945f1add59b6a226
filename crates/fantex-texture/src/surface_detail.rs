//! Surface-detail polygons: coplanar polygons attached to a base polygon (windows on a wall, letters on a sign).
//!
//! Visibility asks only the base polygon, so details cost nothing where it is hidden and never fight with it for depth.
//! Lighting uses the detail: for a look-up the share of each detail in the pixel's footprint is found by exact clipping (E.
//! Catmull, "A hidden-surface algorithm with anti-aliasing", 1978), which is anti-aliasing without a resolution.
//!
//! ```text
//!  polygons --trapezoids--> convex pieces, topmost first --boxes--.
//!  uv, footprint --> parallelogram --carve out each piece that lies in it--> share of each polygon; the rest: base
//! ```
//!
//! A [`SurfaceDetail`] lives in the plane of texture coordinates. As a texture among others it is a [`PolygonsTexture`].

use std::collections::HashSet;

use fantex_base::input::{self, Held};
use fantex_base::{Error, Result, counted};
use glam::{DVec2, UVec2, Vec2, Vec4};

use crate::coordinates::{Coordinates, TextureMatrix};
use crate::look::Slot;
use crate::{Dependence, ShadingPoint, Texture, UvPoint};

/// A polygon on the base.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetailPolygon {
    /// Closed outlines without repetition of the first corner, either way round: the polygon is what lies inside an odd number
    /// of them, so that holes are outlines, too. They must not cross themselves nor each other.
    pub outlines: Vec<Vec<Vec2>>,
    /// What it is made of: an index that only the caller interprets.
    pub material: u32,
    /// Polygons of higher priority cover those of lower; of equal ones the later covers the earlier.
    pub priority: i32,
}

/// A detail's share of a footprint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailWeight {
    /// Index of the polygon, as given to [`SurfaceDetail::new`].
    pub polygon: u32,
    /// Its material.
    pub material: u32,
    /// Visible share of the footprint's area, above 0, at most 1.
    pub weight: f32,
}

/// What is seen within a footprint; all shares add up to one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetailCoverage {
    /// The details, topmost first.
    pub details: Vec<DetailWeight>,
    /// The share in which the base itself is seen.
    pub base: f32,
}

impl DetailCoverage {
    /// The mean of values over the footprint: `of` gives that of a material, or of the base.
    pub fn mean<T>(&self, of: impl Fn(Option<u32>) -> T) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let base = of(None) * self.base;
        self.details.iter().fold(base, |sum, d| sum + of(Some(d.material)) * d.weight)
    }
}

/// Footprints with more small pieces than this in them are quartered: time is linear in the number of pieces then. Pieces that
/// are not small would come back in every quarter.
const MANY_PIECES: usize = 24;
/// Quartering ends here, whatever is left.
const DEEPEST: u32 = 12;
/// Coordinates that are accepted.
const FARTHEST: f32 = 1e6;

/// Bytes of what is made of a corner. A polygon has about as many pieces as corners: each has its owner and its place in a leaf, lists may be
/// twice as long while they grow, and there are as many boxes at most.
const BYTES_PER_CORNER: u64 =
    2 * (size_of::<Piece>() + 4) as u64 + 4 + size_of::<[DVec2; 2]>() as u64 + 2 * size_of::<Node>() as u64;

fn corner_count(polygon: &DetailPolygon) -> usize {
    polygon.outlines.iter().map(Vec::len).sum()
}

/// Polygons attached to a base, ready to be looked up.
#[derive(Clone, Debug, Default)]
pub struct SurfaceDetail {
    /// Convex pieces, those of topmost polygons first.
    pieces: Vec<Piece>,
    owners: Vec<u32>,
    materials: Vec<u32>,
    boxes: BoxTree,
    /// In the budget for input.
    _held: Option<Held>,
}

impl SurfaceDetail {
    /// Prepares polygons. Outlines without area are allowed and cover nothing.
    ///
    /// # Errors
    /// An outline with too few corners, a coordinate out of range, outlines that cross, or more corners than memory is left for.
    pub fn new(polygons: &[DetailPolygon]) -> Result<Self> {
        let corners: usize = polygons.iter().map(corner_count).sum();
        let what = format_args!("detail polygons with {corners} corners");
        let held = input::reserve(what, BYTES_PER_CORNER * corners as u64)?;
        let mut order: Vec<usize> = (0..polygons.len()).collect();
        order.sort_by_key(|&p| std::cmp::Reverse((polygons[p].priority, p)));
        let (mut pieces, mut owners) = (Vec::new(), Vec::new());
        for polygon in order {
            let outlines = checked_outlines(polygon, &polygons[polygon])?;
            let own = trapezoids(&outlines).ok_or_else(|| {
                Error::invalid(format!(
                    "the outlines of detail polygon {} cross; cut it into polygons that do not",
                    polygon + 1
                ))
            })?;
            owners.extend(std::iter::repeat_n(polygon as u32, own.len()));
            pieces.extend(own);
        }
        let boxes = BoxTree::new(&pieces);
        let materials = polygons.iter().map(|p| p.material).collect();
        Ok(Self { pieces, owners, materials, boxes, _held: Some(held) })
    }

    /// The shares of details in the parallelogram around `uv` whose sides are `footprint`. Without area it is the point `uv`.
    ///
    /// Time is linear in the number of pieces within the footprint; where many polygons lie over each other and each shows
    /// a little below the last, it grows with the square of their number.
    pub fn coverage(&self, uv: Vec2, footprint: [Vec2; 2]) -> DetailCoverage {
        let centre = uv.as_dvec2();
        let [mut side, other] = footprint.map(Vec2::as_dvec2);
        let full = side.perp_dot(other);
        if !(full.abs() > 1e-24 && full.is_finite() && centre.is_finite()) {
            return self.coverage_of_point(uv);
        }
        if full < 0.0 {
            // Counter-clockwise.
            side = -side;
        }
        let corner = centre - 0.5 * (side + other);
        let mut areas = Vec::new();
        self.add_areas(corner, [side, other], 0, &mut areas);
        areas.sort_unstable_by_key(|a: &(u32, f64)| a.0);
        let mut details: Vec<(u32, f64)> = Vec::new();
        for (piece, area) in areas {
            let polygon = self.owners[piece as usize];
            match details.last_mut().filter(|d| d.0 == polygon) {
                Some(last) => last.1 += area,
                None => details.push((polygon, area)),
            }
        }
        let covered: f64 = details.iter().map(|d| d.1).sum::<f64>() / full.abs();
        let weight = |area: f64| (area / full.abs() / covered.max(1.0)) as f32;
        let details = details.into_iter().map(|(polygon, area)| self.weight(polygon, weight(area)));
        DetailCoverage { details: details.collect(), base: (1.0 - covered).max(0.0) as f32 }
    }

    /// The material of each polygon, as given.
    pub fn materials(&self) -> impl Iterator<Item = u32> + '_ {
        self.materials.iter().copied()
    }

    /// The topmost polygon at a point; borders belong to either side.
    pub fn topmost(&self, uv: Vec2) -> Option<u32> {
        let p = uv.as_dvec2();
        let holds =
            |piece: &Piece| (0..4).all(|k| (piece[(k + 1) % 4] - piece[k]).perp_dot(p - piece[k]) >= 0.0);
        let candidates = self.boxes.pieces_in([p, p]);
        let piece = candidates.into_iter().find(|&i| holds(&self.pieces[i as usize]))?;
        Some(self.owners[piece as usize])
    }

    fn coverage_of_point(&self, uv: Vec2) -> DetailCoverage {
        match self.topmost(uv) {
            Some(polygon) => DetailCoverage { details: vec![self.weight(polygon, 1.0)], base: 0.0 },
            None => DetailCoverage { details: Vec::new(), base: 1.0 },
        }
    }

    fn weight(&self, polygon: u32, weight: f32) -> DetailWeight {
        DetailWeight { polygon, material: self.materials[polygon as usize], weight }
    }

    /// Visible areas of pieces within the parallelogram at `corner`, as piece and area, in any order.
    fn add_areas(&self, corner: DVec2, [side, other]: [DVec2; 2], depth: u32, areas: &mut Vec<(u32, f64)>) {
        let parallelogram = [corner, corner + side, corner + side + other, corner + other];
        let box_of_all = bounds(&parallelogram);
        let mut near = self.boxes.pieces_in(box_of_all);
        near.retain(|&i| touch(bounds(&self.pieces[i as usize]), box_of_all));
        let half_box = 0.5 * (box_of_all[1] - box_of_all[0]);
        let is_small = |&&i: &&u32| {
            let [low, high] = bounds(&self.pieces[i as usize]);
            (high - low).cmplt(half_box).all()
        };
        if depth < DEEPEST && near.iter().filter(is_small).count() > MANY_PIECES {
            let (half, other_half) = (0.5 * side, 0.5 * other);
            for start in [DVec2::ZERO, half, other_half, half + other_half] {
                self.add_areas(corner + start, [half, other_half], depth + 1, areas);
            }
            return;
        }
        // Pieces come topmost first; each takes what is left.
        let mut left: Vec<Convex> = vec![parallelogram.to_vec()];
        for index in near {
            let piece = &self.pieces[index as usize];
            let box_of_piece = bounds(piece);
            let mut still_left = Vec::with_capacity(left.len());
            let mut visible = 0.0;
            for convex in left {
                if touch(bounds(&convex), box_of_piece) {
                    visible += area(&carve(convex, piece, &mut still_left));
                } else {
                    still_left.push(convex);
                }
            }
            if visible > 0.0 {
                areas.push((index, visible));
            }
            left = still_left;
            if left.is_empty() {
                return;
            }
        }
    }
}

fn touch(a: [DVec2; 2], b: [DVec2; 2]) -> bool {
    a[0].cmple(b[1]).all() && b[0].cmple(a[1]).all()
}

fn checked_outlines(index: usize, polygon: &DetailPolygon) -> Result<Vec<Vec<DVec2>>> {
    // Sentences count from 1, as keys of looks do.
    let index = index + 1;
    for (outline, corners) in (1..).zip(&polygon.outlines) {
        if corners.len() < 3 {
            let count = counted(corners.len(), "corner");
            return Err(Error::invalid(format!(
                "outline {outline} of detail polygon {index} has {count}, but at least 3 are needed"
            )));
        }
        let bad = corners.iter().position(|c| !(c.is_finite() && c.abs().max_element() <= FARTHEST));
        if let Some(corner) = bad {
            let Vec2 { x, y } = corners[corner];
            return Err(Error::invalid(format!(
                "corner {} of outline {outline} of detail polygon {index} is ({x}, {y}), but must lie within 1e6",
                corner + 1
            )));
        }
    }
    Ok(polygon.outlines.iter().map(|o| o.iter().map(|c| c.as_dvec2()).collect()).collect())
}

// ---- Convex polygons cut by convex pieces, and their areas.

/// Corners of a convex polygon, counter-clockwise.
type Convex = Vec<DVec2>;

/// Twice the area's half: the area, positive.
fn area(convex: &[DVec2]) -> f64 {
    let Some((&first, rest)) = convex.split_first() else { return 0.0 };
    rest.windows(2).map(|pair| 0.5 * (pair[0] - first).perp_dot(pair[1] - first)).sum::<f64>().max(0.0)
}

/// The parts of a convex polygon to the left and to the right of the line from `a` to `b` (I. Sutherland and G. Hodgman,
/// "Reentrant polygon clipping", 1974); either may be empty.
fn split(convex: &[DVec2], a: DVec2, b: DVec2) -> [Convex; 2] {
    let along = b - a;
    let side = |p: DVec2| along.perp_dot(p - a);
    let mut parts = [Vec::with_capacity(convex.len() + 1), Vec::with_capacity(convex.len() + 1)];
    for (i, &p) in convex.iter().enumerate() {
        let q = convex[(i + 1) % convex.len()];
        let (at_p, at_q) = (side(p), side(q));
        if at_p >= 0.0 {
            parts[0].push(p);
        }
        if at_p <= 0.0 {
            parts[1].push(p);
        }
        if at_p * at_q < 0.0 {
            let crossing = p + (q - p) * (at_p / (at_p - at_q));
            parts[0].push(crossing);
            parts[1].push(crossing);
        }
    }
    parts.map(|part| if part.len() < 3 { Vec::new() } else { part })
}

/// The part of `convex` inside `piece` (counter-clockwise); what is left outside goes to `outside`, in convex parts.
fn carve(convex: Convex, piece: &[DVec2; 4], outside: &mut Vec<Convex>) -> Convex {
    let first_part = outside.len();
    let mut inside = convex.clone();
    for k in 0..4 {
        let (a, b) = (piece[k], piece[(k + 1) % 4]);
        if a == b {
            continue;
        }
        let [left, right] = split(&inside, a, b);
        if area(&left) == 0.0 {
            // Nothing is inside: no need to have it in parts.
            outside.truncate(first_part);
            outside.push(convex);
            return Vec::new();
        }
        if area(&right) > 0.0 {
            outside.push(right);
        }
        inside = left;
    }
    inside
}

// ---- Which pieces may lie in a rectangle: a tree of boxes, as large as there are pieces, however they overlap.

fn bounds(points: &[DVec2]) -> [DVec2; 2] {
    points.iter().fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], &p| [low.min(p), high.max(p)])
}

/// Most pieces of a box that is not halved.
const LEAF_PIECES: usize = 4;

/// Boxes around pieces: each before those that it consists of.
#[derive(Clone, Debug, Default)]
struct BoxTree {
    nodes: Vec<Node>,
    /// In the order of the leaves.
    pieces: Vec<u32>,
}

#[derive(Clone, Debug)]
struct Node {
    bounds: [DVec2; 2],
    /// The node after all of this one's parts.
    next: u32,
    /// Of [`BoxTree::pieces`]; none where the box has parts.
    first_piece: u32,
    piece_count: u32,
}

impl BoxTree {
    fn new(pieces: &[Piece]) -> Self {
        let boxes: Vec<[DVec2; 2]> = pieces.iter().map(|piece| bounds(piece)).collect();
        let mut order: Vec<u32> = (0..pieces.len() as u32).collect();
        let mut tree = Self::default();
        if !order.is_empty() {
            tree.add(&boxes, &mut order, 0);
        }
        Self { pieces: order, ..tree }
    }

    /// Adds a node for pieces, the first of which comes after so many.
    fn add(&mut self, boxes: &[[DVec2; 2]], pieces: &mut [u32], first_piece: u32) {
        let boxes_of = || pieces.iter().map(|&piece| boxes[piece as usize]);
        let corners: Vec<DVec2> = boxes_of().flatten().collect();
        let middles: Vec<DVec2> = boxes_of().map(|[low, high]| low + high).collect();
        let [low, high] = bounds(&middles);
        let node = self.nodes.len();
        let is_leaf = pieces.len() <= LEAF_PIECES;
        let piece_count = if is_leaf { pieces.len() as u32 } else { 0 };
        self.nodes.push(Node { bounds: bounds(&corners), next: 0, first_piece, piece_count });
        if !is_leaf {
            drop((corners, middles));
            let axis = usize::from(high.y - low.y > high.x - low.x);
            let middle = |piece: u32| boxes[piece as usize].map(|corner| corner[axis]).iter().sum::<f64>();
            let half = pieces.len() / 2;
            pieces.select_nth_unstable_by(half, |&a, &b| middle(a).total_cmp(&middle(b)).then(a.cmp(&b)));
            let (left, right) = pieces.split_at_mut(half);
            self.add(boxes, left, first_piece);
            self.add(boxes, right, first_piece + half as u32);
        }
        self.nodes[node].next = self.nodes.len() as u32;
    }

    /// Ascending numbers of some pieces, among them all whose boxes touch a box.
    fn pieces_in(&self, bounds: [DVec2; 2]) -> Vec<u32> {
        let (mut found, mut index) = (Vec::new(), 0);
        while let Some(node) = self.nodes.get(index as usize) {
            if touch(node.bounds, bounds) {
                let first = node.first_piece as usize;
                found.extend_from_slice(&self.pieces[first..first + node.piece_count as usize]);
                index += 1;
            } else {
                index = node.next;
            }
        }
        found.sort_unstable();
        found
    }
}

// ---- Surface-detail polygons as a texture.

/// Polygons in the plane of the coordinates, each in a colour or a texture of its own, over what lies below them. Every
/// footprint gets the exact shares of what it covers, so that thin bars neither flicker nor vanish, however far away.
#[derive(Clone, Debug)]
pub struct PolygonsTexture {
    detail: SurfaceDetail,
    /// By the polygons' material.
    colors: Vec<Slot>,
    base: Slot,
    coordinates: Coordinates,
    matrix: TextureMatrix,
    repeats: bool,
}

impl PolygonsTexture {
    /// Polygons (their materials are indices of `colors`) over `base`, looked up by `coordinates` after `matrix`. With
    /// `repeats` they come again in every unit square of the coordinates; they may reach into others.
    ///
    /// # Errors
    /// As [`SurfaceDetail::new`], or repeated polygons reach over too many squares.
    ///
    /// # Panics
    /// Where a polygon's material has no colour.
    pub fn new(
        polygons: &[DetailPolygon],
        colors: Vec<Slot>,
        base: Slot,
        (coordinates, matrix): (Coordinates, TextureMatrix),
        repeats: bool,
    ) -> Result<Self> {
        assert!(polygons.iter().all(|p| (p.material as usize) < colors.len()), "every polygon has a colour");
        let detail = match repeats {
            false => SurfaceDetail::new(polygons)?,
            true => {
                // Mistakes are told by the polygons' own numbers.
                SurfaceDetail::new(polygons)?;
                let _held = input::reserve("copies of detail polygons", bytes_of_neighbours(polygons)?)?;
                SurfaceDetail::new(&with_neighbours(polygons))?
            }
        };
        Ok(Self { detail, colors, base, coordinates, matrix, repeats })
    }

    /// The mean over a footprint; colours count in proportion to their alpha.
    fn mean(&self, at: &ShadingPoint<'_>, UvPoint { uv, steps }: UvPoint) -> Vec4 {
        let (uv, steps) = if self.repeats { in_one_square(uv, steps) } else { (uv, steps) };
        let mean = self.detail.coverage(uv, steps).mean(|material| {
            let color = material.map_or(&self.base, |m| &self.colors[m as usize]).evaluate(at);
            (color.truncate() * color.w).extend(color.w)
        });
        if mean.w > 0.0 { (mean.truncate() / mean.w).extend(mean.w) } else { Vec4::ZERO }
    }
}

impl Texture for PolygonsTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.coordinates.evaluate(at, |point| self.mean(at, self.matrix.apply(point, at.time)))
    }

    fn depends_on(&self, what: Dependence) -> bool {
        let is_moved = what == Dependence::Time && self.matrix.is_animated();
        let of_slots = || self.colors.iter().chain([&self.base]).any(|slot| slot.depends_on(what));
        is_moved || self.coordinates.depends_on(what) || of_slots()
    }
}

/// What footprints around points of the unit square reach, at most half a square beyond it.
const REACH: [f32; 2] = [-0.5, 1.5];

/// Most copies of one polygon that is repeated.
const MAX_COPIES: f32 = 10_000.0;

/// The first shift that brings a polygon within [`REACH`], and the columns and rows of all of them.
fn shifts(polygon: &DetailPolygon) -> (Vec2, [f32; 2]) {
    let corners = || polygon.outlines.iter().flatten().copied();
    let low = corners().reduce(Vec2::min).unwrap_or_default();
    let high = corners().reduce(Vec2::max).unwrap_or_default();
    let first = (REACH[0] - high).ceil();
    (first, ((REACH[1] - low).floor() - first + 1.0).to_array())
}

/// Of what [`with_neighbours`] makes.
///
/// # Errors
/// The copies of one polygon would be more than [`MAX_COPIES`].
fn bytes_of_neighbours(polygons: &[DetailPolygon]) -> Result<u64> {
    let mut bytes = 0;
    for (index, polygon) in (1..).zip(polygons) {
        let (_, [columns, rows]) = shifts(polygon);
        if columns * rows > MAX_COPIES {
            return Err(Error::malformed(format!(
                "detail polygon {index} is so long that {columns} x {rows} copies of it would repeat it; one polygon has at most {MAX_COPIES}"
            )));
        }
        let outlines = polygon.outlines.len() * size_of::<Vec<Vec2>>();
        let copy = size_of::<DetailPolygon>() + outlines + corner_count(polygon) * size_of::<Vec2>();
        bytes += columns as u64 * rows as u64 * copy as u64;
    }
    Ok(bytes)
}

/// Each polygon shifted by all integers that bring it within [`REACH`].
fn with_neighbours(polygons: &[DetailPolygon]) -> Vec<DetailPolygon> {
    let shifted = |polygon: &DetailPolygon, shift: Vec2| {
        let outlines = polygon.outlines.iter().map(|outline| outline.iter().map(|&corner| corner + shift));
        DetailPolygon { outlines: outlines.map(Iterator::collect).collect(), ..*polygon }
    };
    let mut all = Vec::new();
    for polygon in polygons {
        let (first, [columns, rows]) = shifts(polygon);
        let shifts = (0..rows as u32).flat_map(|y| (0..columns as u32).map(move |x| UVec2::new(x, y)));
        all.extend(shifts.map(|shift| shifted(polygon, first + shift.as_vec2())));
    }
    all
}

/// The same footprint around a point of the unit square; the whole square for a footprint that is larger.
fn in_one_square(uv: Vec2, steps: [Vec2; 2]) -> (Vec2, [Vec2; 2]) {
    let extent = steps[0].abs() + steps[1].abs();
    // Infinite and NaN count as large.
    if extent.cmple(Vec2::ONE).all() {
        (uv - uv.floor(), steps)
    } else {
        (Vec2::splat(0.5), [Vec2::X, Vec2::Y])
    }
}

// ---- Polygons cut into trapezoids between horizontal lines: any outline, with holes, without a crossing.
//
// Between two neighbouring heights of corners no edge begins, ends or meets another, so the edges there have an order from
// left to right, and the polygon lies between the first and the second, the third and the fourth, ... Trapezoids between the
// same two edges join into one across such lines. (After F. Preparata and M. Shamos, "Computational Geometry", 1985.)

/// A convex piece: corners with increasing angle, the last two or first two may coincide.
type Piece = [DVec2; 4];

/// An edge, upwards.
#[derive(Clone, Copy)]
struct Edge {
    low: DVec2,
    high: DVec2,
}

impl Edge {
    fn x_at(&self, y: f64) -> f64 {
        if y <= self.low.y {
            self.low.x
        } else if y >= self.high.y {
            self.high.x
        } else {
            self.low.x + (self.high.x - self.low.x) * ((y - self.low.y) / (self.high.y - self.low.y))
        }
    }
}

/// A trapezoid that may go on above.
struct Open {
    edges: [usize; 2],
    from: f64,
}

/// The pieces of the inside (points with an odd number of edges to their left); `None` where edges cross.
fn trapezoids(outlines: &[Vec<DVec2>]) -> Option<Vec<Piece>> {
    let edges = edges_of(outlines);
    let mut heights: Vec<f64> = edges.iter().flat_map(|e| [e.low.y, e.high.y]).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    // Edges enter in the order of their lower ends.
    let mut by_start: Vec<usize> = (0..edges.len()).collect();
    by_start.sort_by(|&a, &b| edges[a].low.y.total_cmp(&edges[b].low.y));
    let mut waiting = by_start.into_iter().peekable();
    let (mut active, mut open, mut pieces) = (Vec::new(), Vec::<Open>::new(), Vec::new());
    for slab in heights.windows(2) {
        let [from, to] = [slab[0], slab[1]];
        active.retain(|&e: &usize| edges[e].high.y > from);
        while let Some(edge) = waiting.next_if(|&e| edges[e].low.y <= from) {
            active.push(edge);
        }
        active.sort_by(|&a, &b| {
            let places = |e: usize| [0.5 * (from + to), to].map(|y| edges[e].x_at(y));
            let ([a_middle, a_top], [b_middle, b_top]) = (places(a), places(b));
            a_middle.total_cmp(&b_middle).then(a_top.total_cmp(&b_top)).then(a.cmp(&b))
        });
        if !is_ordered(&edges, &active, from) || !is_ordered(&edges, &active, to) {
            return None;
        }
        let now: Vec<[usize; 2]> = active.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
        let are_now: HashSet<[usize; 2]> = now.iter().copied().collect();
        let were_open: HashSet<[usize; 2]> = open.iter().map(|o| o.edges).collect();
        let (going_on, ended): (Vec<Open>, Vec<Open>) =
            open.into_iter().partition(|o| are_now.contains(&o.edges));
        pieces.extend(ended.iter().map(|o| piece(&edges, o, from)));
        open = going_on;
        let new = now.into_iter().filter(|pair| !were_open.contains(pair));
        open.extend(new.map(|edges| Open { edges, from }));
    }
    let top = heights.last().copied().unwrap_or(0.0);
    pieces.extend(open.iter().map(|o| piece(&edges, o, top)));
    Some(pieces)
}

/// All edges that are not horizontal.
fn edges_of(outlines: &[Vec<DVec2>]) -> Vec<Edge> {
    let sides = outlines.iter().flat_map(|o| (0..o.len()).map(move |i| (o[i], o[(i + 1) % o.len()])));
    sides
        .filter(|(a, b)| a.y != b.y)
        .map(|(a, b)| if a.y < b.y { Edge { low: a, high: b } } else { Edge { low: b, high: a } })
        .collect()
}

/// Whether edges that are ordered within a slab keep their order on its border, up to rounding.
fn is_ordered(edges: &[Edge], order: &[usize], y: f64) -> bool {
    let tolerance = |x: f64| 1e-9 * (1.0 + x.abs());
    order.windows(2).all(|pair| {
        let [a, b] = [pair[0], pair[1]].map(|e| edges[e].x_at(y));
        a <= b + tolerance(a)
    })
}

fn piece(edges: &[Edge], open: &Open, to: f64) -> Piece {
    let [left, right] = open.edges.map(|e| edges[e]);
    let at = |edge: &Edge, y: f64| DVec2::new(edge.x_at(y), y);
    [at(&left, open.from), at(&right, open.from), at(&right, to), at(&left, to)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_carved_out_and_what_is_left_make_the_whole() {
        let square: Convex = vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let mut outside = Vec::new();
        let half = [0.25, 0.75].map(|x| DVec2::new(x, 0.0));
        let piece = [half[0], half[1], half[1] + DVec2::Y * 0.5, half[0] + DVec2::Y * 0.5];
        let inside = carve(square.clone(), &piece, &mut outside);
        assert!((shoelace(&inside) - 0.25).abs() < 1e-12);
        let left: f64 = outside.iter().map(|p| shoelace(p)).sum();
        assert!((left - 0.75).abs() < 1e-12);
        let mut untouched = Vec::new();
        let beside = piece.map(|p| p + DVec2::X * 5.0);
        assert!(carve(square.clone(), &beside, &mut untouched).is_empty());
        assert_eq!(untouched, [square]);
    }

    fn area(pieces: &[Piece]) -> f64 {
        pieces.iter().map(|[a, b, c, d]| 0.5 * (*c - *a).perp_dot(*d - *b)).sum()
    }

    fn ring(n: u32, radius: impl Fn(u32) -> f64) -> Vec<DVec2> {
        let turn = std::f64::consts::TAU / f64::from(n);
        (0..n).map(|i| DVec2::from_angle(f64::from(i) * turn + 0.1) * radius(i)).collect()
    }

    fn shoelace(outline: &[DVec2]) -> f64 {
        (0..outline.len()).map(|i| 0.5 * outline[i].perp_dot(outline[(i + 1) % outline.len()])).sum()
    }

    #[test]
    fn pieces_have_the_polygon_s_area() {
        let star = ring(20, |i| if i % 2 == 0 { 1.0 } else { 0.4 });
        assert!((area(&trapezoids(std::slice::from_ref(&star)).unwrap()) - shoelace(&star)).abs() < 1e-12);
        let hole = ring(7, |_| 0.3);
        let expected = shoelace(&star) - shoelace(&hole);
        assert!((area(&trapezoids(&[star, hole]).unwrap()) - expected).abs() < 1e-12);
        let square = vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        assert_eq!(trapezoids(&[square]).unwrap().len(), 1);
    }

    #[test]
    fn trapezoids_join_where_nothing_happens_between_them() {
        // Corners on the right side cut only their own piece.
        let comb: Vec<DVec2> = (0..50)
            .map(|i| DVec2::new(if i % 2 == 0 { 1.0 } else { 2.0 }, f64::from(i)))
            .chain([DVec2::new(0.0, 49.0), DVec2::ZERO])
            .collect();
        assert!(trapezoids(&[comb]).unwrap().len() <= 50);
    }

    /// Teeth of different lengths, each with slabs of its own.
    #[test]
    fn long_combs_are_cut_exactly() {
        let teeth = 1000;
        let at = |i: i32, y: f64| DVec2::new(f64::from(i) / f64::from(2 * teeth), y);
        let tooth = |i: i32| {
            let share = |k: i32| f64::from(k % teeth) / f64::from(teeth);
            [at(2 * i, 0.9 + 0.09 * share(i)), at(2 * i + 1, 0.1 + 0.1 * share(37 * i))]
        };
        let end = [DVec2::new(1.0, 0.99), DVec2::X, DVec2::ZERO];
        let comb: Vec<DVec2> = (0..teeth).flat_map(tooth).chain(end).collect();
        let pieces = trapezoids(std::slice::from_ref(&comb)).unwrap();
        assert!(pieces.len() <= comb.len(), "{}", pieces.len());
        assert!((area(&pieces) + shoelace(&comb)).abs() < 1e-9);
    }

    /// Nearly equal squares, of which every box touches all others.
    #[test]
    fn boxes_of_pieces_that_overlap_are_few_and_all_found() {
        let square = |low: DVec2, side: f64| {
            [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|corner| low + side * corner)
        };
        let number = |i: u32, k: u32| f64::from(i.wrapping_mul(k) >> 8) / f64::from(1 << 24);
        let random = |i: u32| DVec2::new(number(i, 0x9e37_79b9), number(i, 0x85eb_ca6b));
        let equal: Vec<Piece> = (0..70_000).map(|i| square(random(i) * 1e-3, 1.0)).collect();
        let mixed: Vec<Piece> = (1..3000).map(|i| square(random(i), 1.0 / f64::from(i))).collect();
        for pieces in [&equal[..], &mixed[..], &mixed[..1], &[]] {
            let tree = BoxTree::new(pieces);
            assert!(tree.nodes.len() <= pieces.len().max(1) && tree.pieces.len() == pieces.len());
            for low in (0..20).map(|i| 1.5 * random(i + 7)) {
                let asked = [low, low + 0.01];
                let touches = |&i: &u32| touch(bounds(&pieces[i as usize]), asked);
                let mut found = tree.pieces_in(asked);
                assert!(found.is_sorted());
                found.retain(touches);
                let expected: Vec<u32> = (0..pieces.len() as u32).filter(touches).collect();
                assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn crossings_are_found() {
        let bow = vec![DVec2::ZERO, DVec2::ONE, DVec2::X, DVec2::Y];
        assert!(trapezoids(&[bow]).is_none());
        let star =
            (0..5).map(|i| DVec2::from_angle(f64::from(2 * i) * std::f64::consts::TAU / 5.0)).collect();
        assert!(trapezoids(&[star]).is_none());
    }
}
