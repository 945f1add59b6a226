//! Charts that lie flat side by side with little stretch become one.
//!
//! ```text
//!  charts --relax each--> pieces --cheapest pair--> laid side by side along a common border --> relaxed around it --> one piece
//!                            ^                         | too much stretch, overlaps, too long: they stay apart
//!                            '-------------------------'
//! ```
//!
//! A union moves the smaller piece and a part of the larger one that is about as large, so that all unions together take time in
//! proportion to `n log n`. The cheapest of those that have no piece in common are tried at once. A piece may meet itself along a seam, as
//! a tube does that is rolled out.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicUsize, Ordering};

use fantex_base::UnionFind;
use fantex_cover::Sheet;
use fantex_mesh::Mesh;
use glam::{DVec2, IVec2, Vec2};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use crate::charts::{Chart, NONE, visit_cells};
use crate::extents::{Extents, LENGTHENED};
use crate::layout_progress::LayoutProgress;
use crate::planes::{Fit, Planes};
use crate::plans::{GROWTH_OF_ALL, Plan, Plans};
use crate::slots::Slots;

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

/// One in so many pieces is in a union that is tried at once with others. With more the cheapest no longer go first.
const PIECES_PER_TRIAL: usize = 256;

/// So many more per core may be tried before their turn, while cores wait for the largest union of a batch.
const AHEAD: usize = 16;

/// Cells in which overlaps are looked for, per triangle.
const CELLS_PER_TRIANGLE: f64 = 2.0;

/// Joins charts. `across`: of every half-edge that of the triangle that continues its own, or [`NONE`]. Stays where it is when `progress` is
/// cancelled.
pub(crate) fn unite(
    mesh: &Mesh,
    charts: Vec<Chart>,
    across: &[u32],
    progress: &LayoutProgress<'_>,
) -> Vec<Chart> {
    let mut uniter = Uniter::new(mesh, charts, across);
    uniter.relax_all(ROUNDS[0], progress);
    if !progress.is_cancelled() {
        uniter.straighten();
        uniter.measure_all();
        uniter.run(progress);
        progress.reach(LayoutProgress::UNITED);
    }
    if !progress.is_cancelled() {
        uniter.straighten();
        uniter.relax_all(ROUNDS[2], progress);
    }
    uniter.charts()
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
    extents: Extents,
    /// Side of the square that it may fill together with others, mesh units.
    longest: f32,
    /// Its half-edges beside every neighbour.
    borders: BTreeMap<u32, Vec<u32>>,
    /// The triangles over the middle of every cell.
    cells: FxHashMap<IVec2, u32>,
    /// Neighbours that it could not be joined with, and both areas then.
    refused: BTreeMap<u32, f64>,
    /// When unions with all its neighbours were planned last.
    known_area: f64,
    /// Counts its changes; what was planned before is to be planned anew.
    version: u32,
}

/// Two pieces laid side by side.
struct Union {
    large: u32,
    small: u32,
    fit: Fit,
    /// The triangles that move, and where they lie then.
    region: Vec<u32>,
    flat: Vec<[Vec2; 3]>,
    /// How many more triangles each cell of the larger piece has then.
    cells: Vec<(IVec2, i32)>,
    /// Strain of both beyond what they had apart.
    gained: f64,
    extents: Extents,
}

/// What came of two pieces that had these versions then.
struct Tried {
    versions: [u32; 2],
    union: Option<Union>,
}

/// By their pieces.
type AllTried = FxHashMap<[u32; 2], Tried>;

type Taken = FxHashSet<u32>;

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
    slots: Slots,
    /// Side of a cell, mesh units.
    cell: f32,
    /// Unions are no longer than this, or than one of their pieces seems at most, mesh units.
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
        let mut piece_of = Vec::new();
        let mut pieces: Vec<Piece> = Vec::new();
        pieces.resize_with(sets.number(&mut piece_of), Piece::default);
        for (t, &piece) in (0..).zip(&piece_of) {
            pieces[piece as usize].triangles.push(t);
        }
        let area = mesh.area().max(f64::MIN_POSITIVE);
        Self {
            planes: Planes { mesh, across, is_glued, flat },
            pieces,
            piece_of,
            slots: Slots::new(count),
            cell: (area / count.max(1) as f64 / CELLS_PER_TRIANGLE).sqrt() as f32,
            longest: area.sqrt() as f32,
        }
    }

    /// Brings every piece nearer to its own shape, until `progress` is cancelled; `slots` are those in the pieces.
    fn relax_all(&mut self, rounds: usize, progress: &LayoutProgress<'_>) {
        let Self { planes, pieces, slots, .. } = self;
        pieces.iter().for_each(|piece| slots.number(&piece.triangles));
        let (planes_ref, slots) = (&*planes, &*slots);
        let relaxed = |buffers: &mut Buffers, piece: &Piece| {
            let flat = |slot: usize| planes_ref.flat[piece.triangles[slot] as usize];
            if piece.triangles.len() < 2
                || progress.is_cancelled()
                || !buffers.lay(planes_ref, &piece.triangles, &[], slots, flat)
            {
                return None;
            }
            let before = buffers.sheet.strain();
            if before > STRAINED * planes_ref.area(&piece.triangles) {
                buffers.hinge_if_better(before);
            }
            buffers.sheet.relax(rounds);
            let relaxed = (buffers.sheet.strain() < before).then(|| buffers.flat())?;
            // What overlaps only now stays as it was.
            let is_good = buffers.sheet.is_injective()
                || !(buffers.lay(planes_ref, &piece.triangles, &[], slots, flat)
                    && buffers.sheet.is_injective());
            is_good.then_some(relaxed)
        };
        let all: Vec<Option<Vec<[Vec2; 3]>>> =
            pieces.par_iter().map_init(Buffers::default, relaxed).collect();
        for (piece, flat) in pieces.iter().zip(all) {
            let moved = flat.into_iter().flat_map(|flat| piece.triangles.iter().zip(flat));
            moved.for_each(|(&t, corners)| planes.flat[t as usize] = corners);
            slots.clear(&piece.triangles);
        }
    }

    /// Makes seams shorter: a triangle that hangs on its piece by one edge, or by none, goes over to the other side of a seam where it fits
    /// between two edges.
    fn straighten(&mut self) {
        let Self { planes, pieces, piece_of, .. } = self;
        // Few triangles have a better place before one beside them moves.
        let has_better = |t: u32| planes.better_place(t, piece_of).is_some();
        let mut is_worth_a_look: Vec<bool> =
            (0..piece_of.len() as u32).into_par_iter().with_min_len(1 << 12).map(has_better).collect();
        let mut waiting: VecDeque<u32> = (0..piece_of.len() as u32).collect();
        let mut is_waiting = vec![true; piece_of.len()];
        let mut any = false;
        while let Some(t) = waiting.pop_front() {
            is_waiting[t as usize] = false;
            if !is_worth_a_look[t as usize] {
                continue;
            }
            let Some((piece, corners, kept)) = planes.better_place(t, piece_of) else { continue };
            any = true;
            planes.flat[t as usize] = corners;
            piece_of[t as usize] = piece;
            for (k, half_edge) in (0..3).zip(3 * t..) {
                let other = planes.across[half_edge as usize];
                if other != NONE {
                    planes.is_glued[half_edge as usize] = k != kept;
                    planes.is_glued[other as usize] = k != kept;
                    is_worth_a_look[other as usize / 3] = true;
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
        let Self { planes, pieces, piece_of, cell, longest, .. } = self;
        let measure = |piece: &mut Piece| {
            let Some(own) = piece.triangles.first().map(|&t| piece_of[t as usize]) else { return };
            for &t in &piece.triangles {
                let corners = planes.flat[t as usize];
                let (area, strain) = planes.area_and_strain(t, corners);
                piece.area += area;
                piece.strain += strain;
                corners.into_iter().for_each(|p| piece.extents.add(p));
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
            piece.known_area = piece.area;
            piece.longest = longest.max(LENGTHENED * piece.extents.longer_side());
        };
        pieces.par_iter_mut().for_each(measure);
    }

    /// Makes the cheapest unions as long as there are any.
    fn run(&mut self, progress: &LayoutProgress<'_>) {
        let pieces = 0..self.pieces.len() as u32;
        let later = |a: u32| self.pieces[a as usize].borders.range(a + 1..).map(move |(&b, _)| [a, b]);
        let mut plans = Plans::default();
        plans.extend(self.plans(pieces.flat_map(later).collect()));
        let (count, [begin, end]) = (self.pieces.len(), [LayoutProgress::RELAXED, LayoutProgress::UNITED]);
        let mut left = count;
        let mut tried = AllTried::default();
        while !progress.is_cancelled() {
            progress.reach(begin + (end - begin) * (1.0 - left as f64 / count as f64));
            let mut taken = Taken::default();
            let batch = self.cheapest(&mut plans, left.div_ceil(PIECES_PER_TRIAL), &mut taken, true);
            if batch.is_empty() {
                break;
            }
            if !batch.iter().all(|plan| is_tried(plan, &tried)) {
                let ahead = AHEAD * rayon::current_num_threads();
                let later = self.cheapest(&mut plans, ahead, &mut taken, false);
                self.try_all(&batch, &later, &mut tried);
                plans.put_back(later);
            }
            let mut pairs = Vec::new();
            for Plan { pieces: [a, b], .. } in batch {
                plans.forget([a, b]);
                let union = tried.remove(&[a, b]).and_then(|tried| tried.union);
                if let Some(union) = union {
                    left -= 1;
                    let (large, changed) = self.merge(union);
                    pairs.extend(changed.into_iter().map(|n| [large, n]));
                } else {
                    let areas = self.pieces[a as usize].area + self.pieces[b as usize].area;
                    self.pieces[a as usize].refused.insert(b, areas);
                    self.pieces[b as usize].refused.insert(a, areas);
                }
            }
            // Without what has joined another since.
            pairs.retain(|pair| pair.iter().all(|&i| !self.pieces[i as usize].triangles.is_empty()));
            pairs.iter_mut().for_each(|pair| pair.sort_unstable());
            pairs.sort_unstable();
            pairs.dedup();
            plans.extend(self.plans(pairs));
        }
    }

    /// The cheapest plans that have no piece in common, at most `most`, and none of those `taken`. Those of pieces that have changed are
    /// made anew where they are due; ahead of that, which depends on the number of threads, they stay as they are.
    fn cheapest(&self, plans: &mut Plans, most: usize, taken: &mut Taken, are_due: bool) -> Vec<Plan> {
        let (mut batch, mut waiting) = (Vec::new(), Vec::new());
        while batch.len() < most
            && let Some(plan) = plans.pop()
        {
            let [a, b] = plan.pieces;
            let is_known = plan.pieces.map(|i| self.pieces[i as usize].version) == plan.versions;
            if plan.pieces.iter().any(|i| taken.contains(i)) || !(is_known || are_due) {
                waiting.push(plan);
                // Not all plans for a few unions.
                if waiting.len() > 2 * most {
                    break;
                }
            } else if is_known {
                taken.extend(plan.pieces);
                batch.push(plan);
            } else {
                plans.forget(plan.pieces);
                plans.extend(self.plan(a, b));
            }
        }
        plans.put_back(waiting);
        batch
    }

    /// Tries the unions of a batch, and some of `later` as long as a core would wait for another. What comes of a union depends on its two
    /// pieces only, not on when it is tried. No two plans have a piece in common.
    fn try_all(&self, batch: &[Plan], later: &[Plan], tried: &mut AllTried) {
        let due = batch.iter().filter(|plan| !is_tried(plan, tried));
        let mut all: Vec<&Plan> = due.collect();
        let due = all.len();
        all.extend(later.iter().filter(|plan| !is_tried(plan, tried)));
        // How many of those that are due, and of those begun before these ended, are still to be done.
        let (next, due_left, early) = (AtomicUsize::new(0), AtomicUsize::new(due), AtomicUsize::new(0));
        let work = |_| {
            let (mut buffers, mut done) = (Buffers::default(), Vec::new());
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(plan) = all.get(i) else { break };
                let is_early = i >= due && due_left.load(Ordering::Relaxed) > 0;
                if i >= due && !is_early && early.load(Ordering::Relaxed) == 0 {
                    break;
                }
                early.fetch_add(usize::from(is_early), Ordering::Relaxed);
                let union = self.tried(plan.pieces, &mut buffers);
                done.push((plan.pieces, Tried { versions: plan.versions, union }));
                early.fetch_sub(usize::from(is_early), Ordering::Relaxed);
                due_left.fetch_sub(usize::from(i < due), Ordering::Relaxed);
            }
            done
        };
        let workers = (0..rayon::current_num_threads()).into_par_iter().with_max_len(1);
        let done: Vec<([u32; 2], Tried)> = workers.flat_map_iter(work).collect();
        tried.retain(|pieces, tried| pieces.map(|i| self.pieces[i as usize].version) == tried.versions);
        tried.extend(done);
    }

    /// Of pairs of neighbours the unions that are worth a try.
    fn plans(&self, pairs: Vec<[u32; 2]>) -> Vec<Plan> {
        pairs.into_par_iter().filter_map(|[a, b]| self.plan(a, b)).collect()
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

    /// Lays the smaller of two pieces beside the larger one, if that goes.
    fn tried(&self, [a, b]: [u32; 2], buffers: &mut Buffers) -> Option<Union> {
        let size = |i: u32| self.pieces[i as usize].triangles.len();
        let (large, small) = if size(a) >= size(b) { (a, b) } else { (b, a) };
        let fit = self.fit(large, small)?;
        let [of_large, of_small] = [large, small].map(|i| &self.pieces[i as usize]);
        let corners = of_small.triangles.iter().flat_map(|&t| self.planes.flat[t as usize]);
        let mut extents = of_large.extents;
        corners.for_each(|q| extents.add(fit.motion.apply(q)));
        if extents.length() > of_large.longest.max(of_small.longest) {
            return None;
        }
        // What moves: the smaller piece, and of the larger one what is near the border.
        let mut region = of_small.triangles.clone();
        let moved = region.len();
        if fit.misfit * fit.half_edges.len() as f64 > EXACT * fit.length {
            self.add_near(&fit.half_edges, 2 * moved + 32, &mut region);
        }
        self.slots.number(&region);
        let gained = self.lay_union([large, small], &fit, &region, moved, buffers);
        self.slots.clear(&region);
        let gained = gained?;
        let flat = buffers.flat();
        let cells = self.new_cells(large, &region[moved..], &flat)?;
        Some(Union { large, small, fit, region, flat, cells, gained, extents })
    }

    /// Adds the triangles of the first piece that are nearest to a border, up to a number.
    fn add_near(&self, half_edges: &[u32], count: usize, region: &mut Vec<u32>) {
        let Self { planes, slots, piece_of, .. } = self;
        let first = region.len();
        let Some(&own) = half_edges.first().map(|&h| &piece_of[h as usize / 3]) else { return };
        let mut queue: VecDeque<u32> = half_edges.iter().map(|h| h / 3).collect();
        while let Some(t) = queue.pop_front() {
            if slots.has(t) {
                continue;
            }
            slots.set(t, 0);
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
        slots.clear(&region[first..]);
    }

    /// Lays the triangles of a union that move, the first `moved` of them the smaller piece's, in the buffers' sheet. The strain that is gained,
    /// or `None` where it is too much.
    fn lay_union(
        &self,
        [large, small]: [u32; 2],
        fit: &Fit,
        region: &[u32],
        moved: usize,
        buffers: &mut Buffers,
    ) -> Option<f64> {
        let Self { planes, pieces, slots, .. } = self;
        let flat = |slot: usize| {
            let corners = planes.flat[region[slot] as usize];
            if slot < moved { corners.map(|q| fit.motion.apply(q)) } else { corners }
        };
        if !buffers.lay(planes, region, &fit.half_edges, slots, flat) {
            return None;
        }
        buffers.hold(planes, region, &fit.half_edges, slots);
        if !buffers.sheet.is_upright() {
            return None;
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
            return None;
        }
        let gained = gain(&buffers.sheet);
        let unions =
            of_large.strain - of_large.first_strain + of_small.strain - of_small.first_strain + gained;
        let is_good = gained <= MAX_STRAIN_OF_SMALLER * smaller
            && unions <= MAX_STRAIN * (of_large.area + of_small.area);
        is_good.then_some(gained)
    }

    /// How many more triangles every cell of a piece has once those `near` of its own lie elsewhere: `flat` has all that move or come. `None`
    /// where two lie on each other.
    fn new_cells(&self, large: u32, near: &[u32], flat: &[[Vec2; 3]]) -> Option<Vec<(IVec2, i32)>> {
        let taken = &self.pieces[large as usize].cells;
        let mut changes: FxHashMap<IVec2, i32> = FxHashMap::default();
        for &t in near {
            cells(self.planes.flat[t as usize], self.cell, |at| *changes.entry(at).or_default() -= 1);
        }
        let mut overlaps = false;
        for &corners in flat {
            cells(corners, self.cell, |at| {
                let change = changes.entry(at).or_default();
                overlaps |= taken.get(&at).map_or(0, |&count| count as i32) + *change > 0;
                *change += 1;
            });
            if overlaps {
                return None;
            }
        }
        Some(changes.into_iter().collect())
    }

    /// Makes two pieces one. Returns it, and the neighbours to look at anew: those of the other one, and all of them where the piece has
    /// [grown](GROWTH_OF_ALL) since they were.
    fn merge(&mut self, union: Union) -> (u32, Vec<u32>) {
        let Union { large, small, fit, region, flat, cells, gained, extents } = union;
        for &half_edge in &fit.half_edges {
            self.planes.is_glued[half_edge as usize] = true;
            self.planes.is_glued[self.planes.across[half_edge as usize] as usize] = true;
        }
        region.iter().zip(flat).for_each(|(&t, corners)| self.planes.flat[t as usize] = corners);
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
        for (at, change) in cells {
            let count = piece.cells.entry(at).or_default();
            *count = count.saturating_add_signed(change);
            if *count == 0 {
                piece.cells.remove(&at);
            }
        }
        piece.borders.remove(&small);
        piece.refused.remove(&small);
        piece.triangles.extend(gone.triangles);
        piece.area += gone.area;
        piece.strain += gained + gone.strain;
        piece.first_strain += gone.first_strain;
        piece.outline += gone.outline - 2.0 * fit.length;
        piece.extents = extents;
        piece.longest = piece.longest.max(gone.longest);
        piece.version += 1;
        let changed = match piece.area > f64::from(GROWTH_OF_ALL) * piece.known_area {
            true => {
                piece.known_area = piece.area;
                piece.borders.keys().copied().collect()
            }
            false => gone.borders.into_keys().filter(|&n| n != large).collect(),
        };
        (large, changed)
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

impl Buffers {
    /// Makes a sheet of triangles: `slots` are their indices, `flat` tells where they lie; half-edges of `joints` count as glued. Points are put
    /// in the middle of where their triangles want them. False where a triangle would be turned over.
    fn lay(
        &mut self,
        planes: &Planes<'_>,
        triangles: &[u32],
        joints: &[u32],
        slots: &Slots,
        flat: impl Fn(usize) -> [Vec2; 3],
    ) -> bool {
        let Self { sheet, sets, names, counts } = self;
        sets.reset(3 * triangles.len());
        let mut glue = |half_edge: u32| {
            let other = planes.across[half_edge as usize];
            let corners = |h: u32| [h, h / 3 * 3 + (h + 1) % 3].map(|h| 3 * slots.of(h / 3) + h % 3);
            let ([begin, end], [other_begin, other_end]) = (corners(half_edge), corners(other));
            sets.union(begin, other_end);
            sets.union(end, other_begin);
        };
        for half_edge in triangles.iter().flat_map(|&t| 3 * t..3 * t + 3) {
            let other = planes.across[half_edge as usize];
            if planes.is_glued[half_edge as usize] && other > half_edge && slots.has(other / 3) {
                glue(half_edge);
            }
        }
        joints.iter().copied().filter(|&half_edge| slots.has(half_edge / 3)).for_each(glue);
        let count = sets.number(names);
        counts.clear();
        counts.resize(count, 0);
        sheet.clear();
        let mut places = std::mem::take(sheet.places());
        places.resize(count, DVec2::ZERO);
        for (slot, &t) in triangles.iter().enumerate() {
            let points = [0, 1, 2].map(|k| names[3 * slot + k]);
            for (point, corner) in points.into_iter().zip(flat(slot)) {
                counts[point as usize] += 1;
                places[point as usize] += corner.as_dvec2();
            }
            if !sheet.push(planes.mesh.triangle_positions(t as usize), points, 3) {
                return false;
            }
        }
        places.iter_mut().zip(&*counts).for_each(|(place, &count)| *place /= f64::from(count));
        *sheet.places() = places;
        sheet.find_edges().is_some() && sheet.is_upright()
    }

    /// Holds the points where the larger piece goes on with triangles that are not looked at, and puts them where they lie there; `joints` are
    /// its half-edges to the smaller one.
    fn hold(&mut self, planes: &Planes<'_>, triangles: &[u32], joints: &[u32], slots: &Slots) {
        let Self { sheet, names, counts, .. } = self;
        let mut held = std::mem::take(sheet.held());
        held.resize(counts.len(), false);
        let within = triangles.iter().flat_map(|&t| 3 * t..3 * t + 3);
        let within = within.filter(|&half_edge| planes.is_glued[half_edge as usize]);
        let beside = joints.iter().map(|&half_edge| planes.across[half_edge as usize]);
        for half_edge in within.chain(beside) {
            let other = planes.across[half_edge as usize];
            if slots.has(other / 3) {
                continue;
            }
            let (first, k) = (3 * slots.of(half_edge / 3), half_edge % 3);
            let [end, begin] = planes.ends(other);
            for (corner, place) in [(k, begin), ((k + 1) % 3, end)] {
                let point = names[(first + corner) as usize] as usize;
                held[point] = true;
                sheet.places()[point] = place;
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

/// Whether it is known what comes of a union.
fn is_tried(plan: &Plan, tried: &AllTried) -> bool {
    tried.get(&plan.pieces).is_some_and(|tried| tried.versions == plan.versions)
}

/// The cells whose middles lie in a triangle.
fn cells(corners: [Vec2; 3], cell: f32, visit: impl FnMut(IVec2)) {
    visit_cells(corners.map(|q| q / cell), visit);
}

#[cfg(test)]
mod tests {
    use fantex_bake::{NoProgress, Progress};
    use fantex_base::Random;
    use fantex_mesh::{CleanOptions, Model, clean, generate};
    use glam::DVec3;

    use super::*;
    use crate::charts::{charts, continued};
    use crate::overlaps::without_crossings;

    const TEXELS: u64 = 100_000;

    /// The charts of a model, none of which overlaps itself, every triangle once.
    fn charts_of(model: Model) -> (Mesh, Vec<Chart>) {
        let mesh = clean(model, &CleanOptions::default()).unwrap().0;
        let across = continued(&mesh);
        let texels_per_unit = (TEXELS as f64 / mesh.area()).sqrt() as f32;
        let progress = LayoutProgress::new(&mesh, texels_per_unit, &NoProgress);
        let charts = charts(&mesh, &across, texels_per_unit, &progress);
        let mut triangles: Vec<u32> = charts.iter().flat_map(|chart| chart.triangles.clone()).collect();
        triangles.sort_unstable();
        assert!(triangles.into_iter().eq(0..mesh.triangles.len() as u32));
        for chart in &charts {
            let slots = Slots::new(mesh.triangles.len());
            assert!(without_crossings(chart, &across, &slots).iter().all(|&is| is));
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

    /// A tube without ends, of so many triangles around and along it, so high.
    fn tube(around: u32, along: u32, height: f64) -> Model {
        let mut model = Model::default();
        for row in 0..=along {
            for column in 0..around {
                let angle = f64::from(column) / f64::from(around) * std::f64::consts::TAU;
                model.positions.push(DVec3::new(
                    angle.cos(),
                    height * f64::from(row) / f64::from(along),
                    angle.sin(),
                ));
            }
        }
        for row in 0..along {
            for column in 0..around {
                let [a, b] = [column, (column + 1) % around].map(|c| row * around + c);
                let [c, d] = [a, b].map(|v| v + around);
                model.triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
        model
    }

    /// It meets itself along a seam.
    #[test]
    fn a_tube_is_rolled_out() {
        let (mesh, charts) = charts_of(tube(48, 20, 2.0));
        let [longest, shortest] = ratios(&mesh, &charts);
        assert!(longest < 1.02 && shortest > 0.98, "{longest}, {shortest}");
        assert!(charts.len() <= 2, "{} charts", charts.len());
    }

    /// Needles side by side, as cylinders of CAD parts have them, keep their widths. Of thousands the last percents are not relaxed.
    #[test]
    fn walls_of_needles_are_not_stretched() {
        for (around, most) in [(128, 1.02), (500, 1.02), (2000, 1.1)] {
            let (mesh, charts) = charts_of(tube(around, 1, 10.0));
            let [longest, shortest] = ratios(&mesh, &charts);
            assert!(longest < most && shortest > most.recip(), "{around}: {longest}, {shortest}");
            assert!(charts.len() <= 2, "{around}: {} charts", charts.len());
        }
    }

    /// A round plate whose rim has so many flaps, folded down.
    fn plate_with_flaps(count: u32) -> Model {
        let mut model = Model { positions: vec![DVec3::ZERO], ..Model::default() };
        let around = 2 * count;
        let width = std::f64::consts::TAU / f64::from(around);
        for z in [0.0, -width] {
            let rim = |i: u32| DVec3::new((f64::from(i) * width).cos(), (f64::from(i) * width).sin(), z);
            model.positions.extend((0..around).map(rim));
        }
        for i in 0..around {
            let [a, b] = [1 + i, 1 + (i + 1) % around];
            model.triangles.push([0, a, b]);
            if i % 2 == 0 {
                let [c, d] = [a, b].map(|v| v + around);
                model.triangles.extend([[a, c, d], [a, d, b]]);
            }
        }
        model
    }

    /// One piece has thousands of neighbours, all of which join it: the work grows with their number, not with its square.
    #[test]
    fn flaps_join_a_plate() {
        let (mesh, charts) = charts_of(plate_with_flaps(4000));
        let [longest, shortest] = ratios(&mesh, &charts);
        assert!(longest < 1.1 && shortest > 0.9, "{longest}, {shortest}");
        assert_eq!(charts.len(), 1);
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
        let progress = LayoutProgress::new(&mesh, 1.0, &Cancelled);
        assert_eq!(unite(&mesh, charts, &continued(&mesh), &progress).len(), count);
    }
}
