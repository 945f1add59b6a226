//! Charts that lie flat side by side with little stretch become one.
//!
//! ```text
//!  charts --relax each--> pieces --cheapest pair--> laid side by side along a common border --> relaxed around it --> one piece
//!                            ^                         | too much stretch, overlaps, too long: they stay apart
//!                            '-------------------------'
//! ```
//!
//! A union moves the smaller piece and a part of the larger one that is about as large, so that all unions together take time in
//! proportion to `n log n`. A piece may meet itself along a seam, as a tube does that is rolled out.

use std::collections::{BTreeMap, BinaryHeap, VecDeque};

use fantex_bake::Progress;
use fantex_base::UnionFind;
use fantex_cover::Sheet;
use fantex_mesh::Mesh;
use glam::{DVec2, IVec2, Vec2};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::charts::{Chart, NONE, Plan, doubled_area, visit_cells};

/// Two pieces are joined while they gain less strain than this per area, on the mean of all unions; a stretch of 10 % in both directions is a
/// strain of 0.02.
const MAX_STRAIN: f64 = 0.02;

/// And less than this per area of the smaller one.
const MAX_STRAIN_OF_SMALLER: f64 = 0.06;

/// Borders that fit worse are not tried: root mean square distance, as a share of their length.
const MAX_MISFIT: f64 = 0.1;

/// Pieces whose common border is less of the shorter outline stay apart: what comes out would be hard to pack.
const MIN_SHARE: f64 = 0.23;

/// What a misfit costs beside the share of the outline that is gained.
const MISFIT_COST: f64 = 8.0;

/// A triangle goes over to the other side of a seam if it has less strain per area there.
const MAX_STRAIN_OF_FILL: f64 = 0.1;

/// Two places of a vertex are one within this share of its shorter edge: they come from one point, up to rounding.
const SAME_POINT: f64 = 1e-3;

/// Borders that fit so well are laid on each other as they are: root mean square distance, as a share of their edges.
const EXACT: f64 = 0.02;

/// No union has a triangle with more strain per area: a stretch of 1.7 in one direction.
const WORST_STRAIN: f64 = 0.3;

/// What gains less strain than this per area is not relaxed.
const NO_STRAIN: f64 = 0.002;

/// A union that failed is tried again once a piece has grown by this factor.
const GROWTH: f64 = 1.3;

/// A piece with more strain per area may be better laid anew.
const STRAINED: f64 = 0.01;

/// Rounds of relaxation of every chart, of a union, and in the end.
const ROUNDS: [usize; 3] = [6, 4, 10];

/// Cells in which overlaps are looked for, per triangle.
const CELLS_PER_TRIANGLE: f64 = 2.0;

/// Joins charts. `across`: of every half-edge that of the triangle that continues its own, or [`NONE`]. Stays where it is when `progress` is
/// cancelled.
pub(crate) fn unite(mesh: &Mesh, charts: Vec<Chart>, across: &[u32], progress: &dyn Progress) -> Vec<Chart> {
    let mut uniter = Uniter::new(mesh, charts, across);
    uniter.relax_all(ROUNDS[0]);
    uniter.straighten();
    uniter.measure_all();
    uniter.run(progress);
    uniter.straighten();
    uniter.relax_all(ROUNDS[2]);
    uniter.charts()
}

/// The surface and where it lies.
struct Planes<'a> {
    mesh: &'a Mesh,
    across: &'a [u32],
    /// Half-edges beyond which the same piece goes on without a seam.
    is_glued: Vec<bool>,
    /// Where the corners of each triangle lie in the plane of its piece, counter-clockwise, mesh units.
    flat: Vec<[Vec2; 3]>,
}

#[derive(Default)]
struct Piece {
    triangles: Vec<u32>,
    /// Square mesh units.
    area: f64,
    /// See [`Sheet::strain`]; that before all unions in `first_strain`.
    strain: f64,
    first_strain: f64,
    /// Length of its outline, mesh units.
    outline: f64,
    low: Vec2,
    high: Vec2,
    /// Its half-edges beside every neighbour.
    borders: BTreeMap<u32, Vec<u32>>,
    /// The triangles over the middle of every cell.
    cells: FxHashMap<IVec2, u32>,
    /// Neighbours that it could not be joined with, and both areas then.
    refused: BTreeMap<u32, f64>,
    /// Counts its changes; what was planned before is void.
    version: u32,
}

/// A turn and a shift that bring one piece beside another.
#[derive(Clone, Copy, Debug)]
struct Motion {
    turn: DVec2,
    shift: DVec2,
}

impl Motion {
    fn apply(&self, p: Vec2) -> Vec2 {
        (self.turn.rotate(p.as_dvec2()) + self.shift).as_vec2()
    }
}

/// Common half-edges that are laid on each other.
struct Fit {
    motion: Motion,
    /// Of the first piece.
    half_edges: Vec<u32>,
    /// Mesh units.
    length: f64,
    /// Root mean square distance of their ends, mesh units.
    misfit: f64,
}

#[derive(Default)]
struct Buffers {
    sheet: Sheet,
    sets: UnionFind,
    names: Vec<u32>,
    counts: Vec<u32>,
}

struct Uniter<'a> {
    planes: Planes<'a>,
    pieces: Vec<Piece>,
    piece_of: Vec<u32>,
    /// A triangle's index among those that are looked at, or `NONE`.
    slots: Vec<u32>,
    buffers: Buffers,
    /// Side of a cell, mesh units.
    cell: f32,
    /// Pieces are no longer than this, mesh units.
    longest: f32,
}

impl<'a> Uniter<'a> {
    fn new(mesh: &'a Mesh, charts: Vec<Chart>, across: &'a [u32]) -> Self {
        let count = mesh.triangles.len();
        let mut flat = vec![[Vec2::ZERO; 3]; count];
        let mut chart_of = vec![NONE; count];
        for (i, chart) in (0u32..).zip(&charts) {
            for (t, corners) in chart.iter() {
                flat[t as usize] = corners.map(|q| Vec2::new(q.x, -q.y));
                chart_of[t as usize] = i;
            }
        }
        let is_within =
            |(h, &other): (usize, &u32)| other != NONE && chart_of[h / 3] == chart_of[other as usize / 3];
        let is_glued: Vec<bool> = across.iter().enumerate().map(is_within).collect();
        // What does not hang together is several pieces.
        let mut sets = UnionFind::new(count);
        for (h, _) in is_glued.iter().enumerate().filter(|(_, is)| **is) {
            sets.union(h as u32 / 3, across[h] / 3);
        }
        let mut pieces: Vec<Piece> = Vec::with_capacity(charts.len());
        let mut piece_of = vec![NONE; count];
        for t in 0..count as u32 {
            // A set is named by its first triangle.
            let first = sets.find(t);
            if first == t {
                piece_of[t as usize] = pieces.len() as u32;
                pieces.push(Piece::default());
            }
            piece_of[t as usize] = piece_of[first as usize];
            pieces[piece_of[t as usize] as usize].triangles.push(t);
        }
        let area = mesh.area().max(f64::MIN_POSITIVE);
        Self {
            planes: Planes { mesh, across, is_glued, flat },
            pieces,
            piece_of,
            slots: vec![NONE; count],
            buffers: Buffers::default(),
            cell: (area / count.max(1) as f64 / CELLS_PER_TRIANGLE).sqrt() as f32,
            longest: area.sqrt() as f32,
        }
    }

    /// Brings every piece nearer to its own shape; `slots` are those in the pieces.
    fn relax_all(&mut self, rounds: usize) {
        let Self { planes, pieces, slots, .. } = self;
        for piece in pieces.iter() {
            (0..).zip(&piece.triangles).for_each(|(slot, &t)| slots[t as usize] = slot);
        }
        let (planes_ref, slots) = (&*planes, &*slots);
        let relaxed = |buffers: &mut Buffers, piece: &Piece| {
            let flat = |slot: usize| planes_ref.flat[piece.triangles[slot] as usize];
            if piece.triangles.len() < 2 || !buffers.lay(planes_ref, &piece.triangles, slots, flat) {
                return None;
            }
            let before = buffers.sheet.strain();
            if before > STRAINED * piece_area(planes_ref, piece) {
                buffers.hinge_if_better(before);
            }
            buffers.sheet.relax(rounds);
            let relaxed = (buffers.sheet.strain() < before).then(|| buffers.flat())?;
            // What overlaps only now stays as it was.
            let is_good = buffers.sheet.is_injective()
                || !(buffers.lay(planes_ref, &piece.triangles, slots, flat) && buffers.sheet.is_injective());
            is_good.then_some(relaxed)
        };
        let all: Vec<Option<Vec<[Vec2; 3]>>> =
            pieces.par_iter().map_init(Buffers::default, relaxed).collect();
        for (piece, flat) in pieces.iter().zip(all) {
            let moved = flat.into_iter().flat_map(|flat| piece.triangles.iter().zip(flat));
            moved.for_each(|(&t, corners)| planes.flat[t as usize] = corners);
        }
    }

    /// Makes seams shorter: a triangle that hangs on its piece by one edge, or by none, goes over to the other side of a seam where it fits
    /// between two edges.
    fn straighten(&mut self) {
        let Self { planes, pieces, piece_of, .. } = self;
        let mut waiting: VecDeque<u32> = (0..piece_of.len() as u32).collect();
        let mut is_waiting = vec![true; piece_of.len()];
        let mut any = false;
        while let Some(t) = waiting.pop_front() {
            is_waiting[t as usize] = false;
            let Some((piece, corners, kept)) = planes.better_place(t, piece_of) else { continue };
            any = true;
            planes.flat[t as usize] = corners;
            piece_of[t as usize] = piece;
            for (k, half_edge) in (0..3).zip(3 * t..) {
                let other = planes.across[half_edge as usize];
                if other != NONE {
                    planes.is_glued[half_edge as usize] = k != kept;
                    planes.is_glued[other as usize] = k != kept;
                    if !std::mem::replace(&mut is_waiting[other as usize / 3], true) {
                        waiting.push_back(other / 3);
                    }
                }
            }
        }
        if any {
            pieces.iter_mut().for_each(|piece| piece.triangles.clear());
            for (t, &piece) in (0u32..).zip(piece_of.iter()) {
                pieces[piece as usize].triangles.push(t);
            }
        }
    }

    /// Fills in what is known of the pieces.
    fn measure_all(&mut self) {
        let Self { planes, pieces, piece_of, cell, .. } = self;
        let measure = |piece: &mut Piece| {
            (piece.low, piece.high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
            let Some(own) = piece.triangles.first().map(|&t| piece_of[t as usize]) else { return };
            for &t in &piece.triangles {
                let corners = planes.flat[t as usize];
                let (area, strain) = planes.area_and_strain(t, corners);
                piece.area += area;
                piece.strain += strain;
                piece.low = corners.into_iter().fold(piece.low, Vec2::min);
                piece.high = corners.into_iter().fold(piece.high, Vec2::max);
                cells(corners, *cell, |at| *piece.cells.entry(at).or_default() += 1);
                for half_edge in 3 * t..3 * t + 3 {
                    let other = planes.across[half_edge as usize];
                    if other == NONE || piece_of[other as usize / 3] != own {
                        piece.outline += planes.length(half_edge);
                    }
                    if other != NONE && piece_of[other as usize / 3] != own {
                        piece.borders.entry(piece_of[other as usize / 3]).or_default().push(half_edge);
                    }
                }
            }
            piece.first_strain = piece.strain;
        };
        pieces.par_iter_mut().for_each(measure);
        self.slots.fill(NONE);
    }

    /// Makes the cheapest union as long as there is one.
    fn run(&mut self, progress: &dyn Progress) {
        let mut plans = BinaryHeap::new();
        for a in 0..self.pieces.len() as u32 {
            let later = self.pieces[a as usize].borders.range(a + 1..);
            plans.extend(later.filter_map(|(&b, _)| self.plan(a, b)));
        }
        while let Some(plan) = plans.pop().filter(|_| !progress.is_cancelled()) {
            let [a, b] = plan.pieces;
            let versions = [a, b].map(|i| self.pieces[i as usize].version);
            if versions != plan.versions {
                continue;
            }
            let size = |i: u32| self.pieces[i as usize].triangles.len();
            let (large, small) = if size(a) >= size(b) { (a, b) } else { (b, a) };
            if self.try_union(large, small) {
                let neighbours: Vec<u32> = self.pieces[large as usize].borders.keys().copied().collect();
                plans.extend(neighbours.into_iter().filter_map(|n| self.plan(large, n)));
            } else {
                let areas = self.pieces[a as usize].area + self.pieces[b as usize].area;
                self.pieces[a as usize].refused.insert(b, areas);
                self.pieces[b as usize].refused.insert(a, areas);
            }
        }
    }

    /// The union of two neighbours, if it is worth a try.
    fn plan(&self, a: u32, b: u32) -> Option<Plan> {
        let [first, second] = [a, b].map(|i| &self.pieces[i as usize]);
        if first.refused.get(&b).is_some_and(|&areas| first.area + second.area < GROWTH * areas) {
            return None;
        }
        let fit = self.fit(a, b)?;
        let share = fit.length / first.outline.min(second.outline).max(f64::MIN_POSITIVE);
        if share < MIN_SHARE {
            return None;
        }
        let cost = MISFIT_COST * fit.misfit / fit.length + (1.0 - share);
        Some(Plan { cost, pieces: [a, b], versions: [first.version, second.version] })
    }

    /// How the second piece is laid beside the first: along all of their common border if that goes, else along the part of it that gives
    /// the longest seam up.
    fn fit(&self, a: u32, b: u32) -> Option<Fit> {
        let common = self.pieces[a as usize].borders.get(&b)?;
        let is_good = |fit: &Fit| fit.misfit <= MAX_MISFIT * fit.length;
        let all = self.planes.fit(common);
        if is_good(&all) {
            return Some(all);
        }
        let parts = self.planes.connected(common);
        if parts.len() < 2 {
            return None;
        }
        let parts: Vec<Fit> = parts.iter().map(|part| self.planes.fit(part)).filter(is_good).collect();
        let longest = parts.iter().max_by(|a, b| a.length.total_cmp(&b.length))?;
        let motion = longest.motion;
        let together = parts
            .iter()
            .filter(|part| self.planes.misfit(&part.half_edges, &motion) <= MAX_MISFIT * part.length);
        let together =
            self.planes.fit(&together.flat_map(|part| part.half_edges.clone()).collect::<Vec<_>>());
        is_good(&together).then_some(together)
    }

    /// Lays the smaller piece beside the larger one, if that goes.
    fn try_union(&mut self, large: u32, small: u32) -> bool {
        let Some(fit) = self.fit(large, small) else { return false };
        let [of_large, of_small] = [large, small].map(|i| &self.pieces[i as usize]);
        let moved_box = [
            of_small.low,
            Vec2::new(of_small.low.x, of_small.high.y),
            of_small.high,
            Vec2::new(of_small.high.x, of_small.low.y),
        ];
        let moved_box = moved_box.map(|p| fit.motion.apply(p));
        let low = moved_box.into_iter().fold(of_large.low, Vec2::min);
        let high = moved_box.into_iter().fold(of_large.high, Vec2::max);
        let longest = self.longest.max((of_large.high - of_large.low).max_element());
        if (high - low).max_element() > longest {
            return false;
        }
        // What moves: the smaller piece, and of the larger one what is near the border.
        let mut region = of_small.triangles.clone();
        let moved = region.len();
        self.set_glued(&fit.half_edges, true);
        if fit.misfit * fit.half_edges.len() as f64 > EXACT * fit.length {
            self.add_near(&fit.half_edges, 2 * moved + 32, &mut region);
        }
        (0..).zip(&region).for_each(|(slot, &t)| self.slots[t as usize] = slot);
        let done = self.lay_union(large, small, &fit, &region, moved);
        region.iter().for_each(|&t| self.slots[t as usize] = NONE);
        if !done {
            self.set_glued(&fit.half_edges, false);
            return false;
        }
        self.merge(large, small, &fit, [low, high]);
        true
    }

    fn set_glued(&mut self, half_edges: &[u32], is_glued: bool) {
        for &half_edge in half_edges {
            self.planes.is_glued[half_edge as usize] = is_glued;
            self.planes.is_glued[self.planes.across[half_edge as usize] as usize] = is_glued;
        }
    }

    /// Adds the triangles of the first piece that are nearest to a border, up to a number.
    fn add_near(&mut self, half_edges: &[u32], count: usize, region: &mut Vec<u32>) {
        let Self { planes, slots, piece_of, .. } = self;
        let first = region.len();
        let Some(&own) = half_edges.first().map(|&h| &piece_of[h as usize / 3]) else { return };
        let mut queue: VecDeque<u32> = half_edges.iter().map(|h| h / 3).collect();
        while let Some(t) = queue.pop_front() {
            if std::mem::replace(&mut slots[t as usize], 0) != NONE {
                continue;
            }
            region.push(t);
            if region.len() - first >= count.max(half_edges.len()) {
                break;
            }
            for half_edge in 3 * t..3 * t + 3 {
                let other = planes.across[half_edge as usize];
                if planes.is_glued[half_edge as usize] && piece_of[other as usize / 3] == own {
                    queue.push_back(other / 3);
                }
            }
        }
        region[first..].iter().for_each(|&t| slots[t as usize] = NONE);
    }

    /// Lays the triangles of a union that move, the first `moved` of them the smaller piece's. True where it is good; nothing has changed
    /// otherwise.
    fn lay_union(&mut self, large: u32, small: u32, fit: &Fit, region: &[u32], moved: usize) -> bool {
        let Self { planes, pieces, slots, buffers, cell, .. } = self;
        let flat = |slot: usize| {
            let corners = planes.flat[region[slot] as usize];
            if slot < moved { corners.map(|q| fit.motion.apply(q)) } else { corners }
        };
        if !buffers.lay(planes, region, slots, flat) {
            return false;
        }
        buffers.hold(planes, region, slots);
        if !buffers.sheet.is_upright() {
            return false;
        }
        let near = &region[moved..];
        let before: f64 = near.iter().map(|&t| planes.area_and_strain(t, planes.flat[t as usize]).1).sum();
        let [of_large, of_small] = [large, small].map(|i| &pieces[i as usize]);
        let gain = |sheet: &Sheet| sheet.strain() - before - of_small.strain;
        let smaller = of_small.area.min(of_large.area);
        if gain(&buffers.sheet) > NO_STRAIN * smaller {
            buffers.sheet.relax(ROUNDS[1]);
        }
        if buffers.sheet.worst_strain() > WORST_STRAIN {
            return false;
        }
        let gained = gain(&buffers.sheet);
        let unions =
            of_large.strain - of_large.first_strain + of_small.strain - of_small.first_strain + gained;
        let is_good = gained <= MAX_STRAIN_OF_SMALLER * smaller
            && unions <= MAX_STRAIN * (of_large.area + of_small.area);
        if !is_good {
            return false;
        }
        let new = buffers.flat();
        // Exactly what lies in the plane of the larger piece now.
        let taken = &mut pieces[large as usize].cells;
        for &t in near {
            cells(planes.flat[t as usize], *cell, |at| drop_cell(taken, at));
        }
        let mut overlaps = 0;
        for &corners in &new {
            cells(corners, *cell, |at| {
                let count = taken.entry(at).or_default();
                overlaps += u32::from(*count > 0);
                *count += 1;
            });
        }
        if overlaps > 0 {
            new.iter().for_each(|&corners| cells(corners, *cell, |at| drop_cell(taken, at)));
            for &t in near {
                cells(planes.flat[t as usize], *cell, |at| *taken.entry(at).or_default() += 1);
            }
            return false;
        }
        region.iter().zip(new).for_each(|(&t, corners)| planes.flat[t as usize] = corners);
        pieces[large as usize].strain += gained + pieces[small as usize].strain;
        true
    }

    /// Makes two pieces one whose triangles lie as they should.
    fn merge(&mut self, large: u32, small: u32, fit: &Fit, [low, high]: [Vec2; 2]) {
        let gone = std::mem::take(&mut self.pieces[small as usize]);
        self.pieces[small as usize].version = gone.version + 1;
        gone.triangles.iter().for_each(|&t| self.piece_of[t as usize] = large);
        for (&neighbour, half_edges) in &gone.borders {
            if neighbour == large {
                continue;
            }
            let theirs = &mut self.pieces[neighbour as usize];
            let moved = theirs.borders.remove(&small).unwrap_or_default();
            theirs.borders.entry(large).or_default().extend(moved);
            theirs.refused.remove(&small);
            self.pieces[large as usize].borders.entry(neighbour).or_default().extend(half_edges);
        }
        let piece = &mut self.pieces[large as usize];
        piece.borders.remove(&small);
        piece.refused.remove(&small);
        piece.triangles.extend(gone.triangles);
        piece.area += gone.area;
        piece.first_strain += gone.first_strain;
        piece.outline += gone.outline - 2.0 * fit.length;
        (piece.low, piece.high) = (low, high);
        piece.version += 1;
    }

    fn charts(self) -> Vec<Chart> {
        let Self { planes, pieces, .. } = self;
        let chart = |piece: Piece| {
            let mut triangles = piece.triangles;
            triangles.sort_unstable();
            let flat = |&t: &u32| planes.flat[t as usize].map(|q| Vec2::new(q.x, -q.y));
            let corners = triangles.iter().map(flat).collect();
            Chart::new(triangles, corners)
        };
        let left: Vec<Piece> = pieces.into_iter().filter(|piece| !piece.triangles.is_empty()).collect();
        left.into_par_iter().map(chart).collect()
    }
}

impl Planes<'_> {
    fn length(&self, half_edge: u32) -> f64 {
        let corners = self.mesh.triangles[half_edge as usize / 3];
        let [a, b] = [0, 1].map(|i| self.mesh.positions[corners[(half_edge as usize % 3 + i) % 3] as usize]);
        f64::from(a.distance(b))
    }

    /// Where a half-edge begins and ends in the plane.
    fn ends(&self, half_edge: u32) -> [DVec2; 2] {
        let corners = &self.flat[half_edge as usize / 3];
        [0, 1].map(|i| corners[(half_edge as usize % 3 + i) % 3].as_dvec2())
    }

    /// The motion that brings what is beyond half-edges as near to them as it goes, by least squares (P. H. Schoenemann, "A Generalized Solution
    /// of the Orthogonal Procrustes Problem", 1966).
    fn fit(&self, half_edges: &[u32]) -> Fit {
        let (mut length, mut here, mut there) = (0.0, DVec2::ZERO, DVec2::ZERO);
        self.pairs(half_edges, |weight, [p, q]| {
            length += weight;
            here += weight * p;
            there += weight * q;
        });
        let [here, there] = [here, there].map(|sum| sum / length);
        let mut turn = DVec2::ZERO;
        self.pairs(half_edges, |weight, [p, q]| {
            let (p, q) = (p - here, q - there);
            turn += weight * DVec2::new(q.dot(p), q.perp_dot(p));
        });
        let turn = turn.normalize_or(DVec2::X);
        let motion = Motion { turn, shift: here - turn.rotate(there) };
        let misfit = self.misfit(half_edges, &motion);
        // Every edge has two ends.
        Fit { motion, half_edges: half_edges.to_vec(), length: 0.5 * length, misfit }
    }

    /// Root mean square distance of the ends of half-edges from those beyond, after a motion.
    fn misfit(&self, half_edges: &[u32], motion: &Motion) -> f64 {
        let (mut length, mut sum) = (0.0, 0.0);
        self.pairs(half_edges, |weight, [p, q]| {
            length += weight;
            sum += weight * (motion.turn.rotate(q) + motion.shift).distance_squared(p);
        });
        (sum / length).sqrt()
    }

    /// Lengths of half-edges and where their ends lie, on this and on the other side.
    fn pairs(&self, half_edges: &[u32], mut visit: impl FnMut(f64, [DVec2; 2])) {
        for &half_edge in half_edges {
            let weight = self.length(half_edge);
            let ([a, b], [d, c]) = (self.ends(half_edge), self.ends(self.across[half_edge as usize]));
            visit(weight, [a, c]);
            visit(weight, [b, d]);
        }
    }

    /// Half-edges in parts that share vertices.
    fn connected(&self, half_edges: &[u32]) -> Vec<Vec<u32>> {
        let mut sets = UnionFind::new(half_edges.len());
        let mut seen: FxHashMap<u32, u32> = FxHashMap::default();
        for (i, &half_edge) in (0u32..).zip(half_edges) {
            let corners = self.mesh.triangles[half_edge as usize / 3];
            for vertex in [0, 1].map(|k| corners[(half_edge as usize % 3 + k) % 3]) {
                sets.union(i, *seen.entry(vertex).or_insert(i));
            }
        }
        let mut parts: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (i, &half_edge) in (0u32..).zip(half_edges) {
            parts.entry(sets.find(i)).or_default().push(half_edge);
        }
        parts.into_values().collect()
    }

    /// A piece between two edges of which a triangle fits, where it lies there, and which of its edges becomes a seam instead of these two.
    fn better_place(&self, t: u32, piece_of: &[u32]) -> Option<(u32, [Vec2; 3], usize)> {
        let half_edges = [3 * t, 3 * t + 1, 3 * t + 2].map(|h| h as usize);
        let is_seam = |k: usize| self.across[half_edges[k]] != NONE && !self.is_glued[half_edges[k]];
        // The two edges meet at the corner opposite of the third, `kept`.
        (0..3).find_map(|kept| {
            let [first, second] = [(kept + 1) % 3, (kept + 2) % 3];
            if !(is_seam(first) && is_seam(second)) {
                return None;
            }
            let [one, other] = [first, second].map(|k| self.across[half_edges[k]]);
            let piece = piece_of[one as usize / 3];
            if piece != piece_of[other as usize / 3] {
                return None;
            }
            let ([top, begin], [end, again]) = (self.ends(one), self.ends(other));
            let [a, b] = [begin, end].map(|p| p.distance(top));
            if top.distance(again) > SAME_POINT * a.min(b) {
                return None;
            }
            let mut corners = [Vec2::ZERO; 3];
            corners[first] = begin.as_vec2();
            corners[second] = top.as_vec2();
            corners[kept] = end.as_vec2();
            let upright = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]) > 0.0;
            let (area, strain) = self.area_and_strain(t, corners);
            (upright && strain <= MAX_STRAIN_OF_FILL * area).then_some((piece, corners, kept))
        })
    }

    /// The area of a triangle, and what it counts in [`Sheet::strain`] where its corners lie.
    fn area_and_strain(&self, triangle: u32, corners: [Vec2; 3]) -> (f64, f64) {
        let [a, b, c] = self.mesh.triangle_positions(triangle as usize).map(|p| p.as_dvec3());
        let [p, q, r] = corners.map(Vec2::as_dvec2);
        let (u, v, s, t) = (b - a, c - a, q - p, r - p);
        let doubled = u.cross(v).length();
        let flat = s.perp_dot(t);
        // Sum of the squared stretches.
        let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
        let squared = (s.length_squared() * vv - 2.0 * s.dot(t) * uv + t.length_squared() * uu)
            / (doubled * doubled).max(f64::MIN_POSITIVE);
        let determinant = flat / doubled.max(f64::MIN_POSITIVE);
        let strain = 0.25 * squared * (1.0 + determinant.powi(-2)) - 1.0;
        (0.5 * doubled, 0.5 * doubled * strain.max(0.0))
    }
}

impl Buffers {
    /// Makes a sheet of triangles: `slots` are their indices, `flat` tells where they lie; points are put in the middle of where their
    /// triangles want them. False where a triangle would be turned over.
    fn lay(
        &mut self,
        planes: &Planes<'_>,
        triangles: &[u32],
        slots: &[u32],
        flat: impl Fn(usize) -> [Vec2; 3],
    ) -> bool {
        let Self { sheet, sets, names, counts } = self;
        sets.reset(3 * triangles.len());
        for (slot, &t) in (0u32..).zip(triangles) {
            for (k, half_edge) in (0u32..3).zip(3 * t..) {
                let other = planes.across[half_edge as usize];
                if planes.is_glued[half_edge as usize]
                    && other > half_edge
                    && slots[other as usize / 3] != NONE
                {
                    let (base, k_other) = (3 * slots[other as usize / 3], other % 3);
                    sets.union(3 * slot + k, base + (k_other + 1) % 3);
                    sets.union(3 * slot + (k + 1) % 3, base + k_other);
                }
            }
        }
        names.clear();
        counts.clear();
        sheet.clear();
        let mut places = std::mem::take(sheet.places());
        for (slot, &t) in triangles.iter().enumerate() {
            let corners = flat(slot);
            let points = [0, 1, 2].map(|k| {
                let corner = (3 * slot + k) as u32;
                let root = sets.find(corner);
                // A set is named by its first corner.
                let name = if root == corner { counts.len() as u32 } else { names[root as usize] };
                names.push(name);
                if root == corner {
                    counts.push(0);
                    places.push(DVec2::ZERO);
                }
                counts[name as usize] += 1;
                places[name as usize] += corners[k].as_dvec2();
                name
            });
            if !sheet.push(planes.mesh.triangle_positions(t as usize), points, 3) {
                return false;
            }
        }
        places.iter_mut().zip(&*counts).for_each(|(place, &count)| *place /= f64::from(count));
        *sheet.places() = places;
        sheet.find_edges().is_some() && sheet.is_upright()
    }

    /// Holds the points where the larger piece goes on with triangles that are not looked at, and puts them where they lie there.
    fn hold(&mut self, planes: &Planes<'_>, triangles: &[u32], slots: &[u32]) {
        let Self { sheet, names, counts, .. } = self;
        let mut held = std::mem::take(sheet.held());
        held.resize(counts.len(), false);
        for (slot, &t) in triangles.iter().enumerate() {
            for (k, half_edge) in (0..3).zip(3 * t..) {
                let other = planes.across[half_edge as usize];
                if planes.is_glued[half_edge as usize] && slots[other as usize / 3] == NONE {
                    let [end, begin] = planes.ends(other);
                    for (corner, place) in [(k, begin), ((k + 1) % 3, end)] {
                        let point = names[3 * slot + corner] as usize;
                        held[point] = true;
                        sheet.places()[point] = place;
                    }
                }
            }
        }
        *sheet.held() = held;
    }

    /// Starts from triangles laid one beside the other, as it is exact across the creases of a box, where that has less strain.
    fn hinge_if_better(&mut self, strain: f64) {
        let before = self.sheet.places().clone();
        self.sheet.hinge(before.len());
        if !(self.sheet.is_upright() && self.sheet.strain() < strain) {
            *self.sheet.places() = before;
        }
    }

    fn flat(&self) -> Vec<[Vec2; 3]> {
        (0..self.sheet.len()).map(|i| self.sheet.corners(i).map(|p| p.as_vec2())).collect()
    }
}

fn piece_area(planes: &Planes<'_>, piece: &Piece) -> f64 {
    piece.triangles.iter().map(|&t| 0.5 * f64::from(doubled_area(planes.mesh, t as usize))).sum()
}

/// The cells whose middles lie in a triangle.
fn cells(corners: [Vec2; 3], cell: f32, visit: impl FnMut(IVec2)) {
    visit_cells(corners.map(|q| q / cell), visit);
}

fn drop_cell(cells: &mut FxHashMap<IVec2, u32>, at: IVec2) {
    if let Some(count) = cells.get_mut(&at) {
        *count -= 1;
        if *count == 0 {
            cells.remove(&at);
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_bake::NoProgress;
    use fantex_base::Random;
    use fantex_cover::{CoverOptions, TexelBudget, build_cover};
    use fantex_mesh::{CleanOptions, Model, clean, generate};
    use glam::DVec3;

    use super::*;
    use crate::charts::{charts, continued};
    use crate::overlaps::without_crossings;

    const TEXELS: u64 = 100_000;

    /// The charts of a model, none of which overlaps itself, every triangle once.
    fn charts_of(model: Model) -> (Mesh, Vec<Chart>) {
        let mesh = clean(model, &CleanOptions::default()).unwrap().0;
        let options = CoverOptions { budget: TexelBudget::Total(TEXELS), ..CoverOptions::default() };
        let cover = build_cover(&mesh, &options).unwrap().0;
        let across = continued(&mesh);
        let texels_per_unit = (TEXELS as f64 / mesh.area()).sqrt() as f32;
        let charts = charts(&mesh, &cover, &across, texels_per_unit, &NoProgress);
        let mut triangles: Vec<u32> = charts.iter().flat_map(|chart| chart.triangles.clone()).collect();
        triangles.sort_unstable();
        assert!(triangles.into_iter().eq(0..mesh.triangles.len() as u32));
        for chart in &charts {
            assert!(without_crossings(chart, &across).iter().all(|&is| is));
            // v points downwards.
            assert!(chart.corners.iter().all(|[a, b, c]| (*b - *a).perp_dot(*c - *a) < 0.0));
        }
        (mesh, charts)
    }

    /// The longest and the shortest ratio of a triangle's side in its chart to that on the surface.
    fn ratios(mesh: &Mesh, charts: &[Chart]) -> [f32; 2] {
        let sides = charts.iter().flat_map(Chart::iter).flat_map(|(t, flat)| {
            let spatial = mesh.triangle_positions(t as usize);
            [0, 1, 2].map(|k| {
                let next = (k + 1) % 3;
                flat[k].distance(flat[next]) / spatial[k].distance(spatial[next])
            })
        });
        sides.fold([0.0, f32::INFINITY], |[longest, shortest], ratio| {
            [longest.max(ratio), shortest.min(ratio)]
        })
    }

    /// Sides are laid flat as they are; crumbs around a corner are stretched a little where they stay in one piece.
    #[test]
    fn boxes_come_in_few_charts_with_little_stretch() {
        for (cells, most) in [(1, 1.01), (8, 1.3)] {
            let (mesh, charts) = charts_of(generate::cube(cells));
            let [longest, shortest] = ratios(&mesh, &charts);
            assert!(longest < most && shortest > most.recip(), "{longest}, {shortest}");
            assert!(charts.len() <= 6, "{} charts, more than sides", charts.len());
        }
    }

    /// A tube without ends meets itself along a seam.
    #[test]
    fn a_tube_is_rolled_out() {
        let (around, along) = (48, 20);
        let mut model = Model::default();
        for row in 0..=along {
            for column in 0..around {
                let angle = f64::from(column) / f64::from(around) * std::f64::consts::TAU;
                model.positions.push(DVec3::new(angle.cos(), 0.1 * f64::from(row), angle.sin()));
            }
        }
        for row in 0..along {
            for column in 0..around {
                let [a, b] = [column, (column + 1) % around].map(|c| row * around + c);
                let [c, d] = [a, b].map(|v| v + around);
                model.triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
        let (mesh, charts) = charts_of(model);
        let [longest, shortest] = ratios(&mesh, &charts);
        assert!(longest < 1.02 && shortest > 0.98, "{longest}, {shortest}");
        assert!(charts.len() <= 2, "{} charts", charts.len());
    }

    /// Crumpled balls in many shapes: nothing overlaps, nothing is lost, and little is stretched.
    #[test]
    fn crumpled_balls_lie_flat() {
        let mut random = Random::new(11);
        for round in 0..6 {
            let mut model = generate::icosphere(4);
            let roughness = 0.02 * f64::from(round);
            for p in &mut model.positions {
                *p *= 1.0 + roughness * (random.unit() - 0.5) + 0.2 * (5.0 * p.x).sin() * (4.0 * p.y).cos();
            }
            let (mesh, charts) = charts_of(model);
            let area: f64 = charts
                .iter()
                .flat_map(|chart| &chart.corners)
                .map(|[a, b, c]| 0.5 * f64::from((*b - *a).perp_dot(*c - *a).abs()))
                .sum();
            assert!((area / mesh.area() - 1.0).abs() < 0.03, "{area} of {}", mesh.area());
            assert!(charts.len() < mesh.triangles.len() / 20, "{} charts at {roughness}", charts.len());
        }
    }

    /// Nobody waits for unions after Ctrl-C.
    #[test]
    fn no_union_is_made_once_it_is_cancelled() {
        struct Cancelled;
        impl Progress for Cancelled {
            fn report(&self, _done: u64, _total: u64) {}

            fn is_cancelled(&self) -> bool {
                true
            }
        }
        let mesh = clean(generate::cube(4), &CleanOptions::default()).unwrap().0;
        let alone = |t: u32| {
            let [a, b, c] = mesh.triangle_positions(t as usize);
            Chart::projected(&mesh, vec![t], (b - a).cross(c - a).normalize())
        };
        let charts: Vec<Chart> = (0..mesh.triangles.len() as u32).map(alone).collect();
        let count = charts.len();
        assert_eq!(unite(&mesh, charts, &continued(&mesh), &Cancelled).len(), count);
    }
}
