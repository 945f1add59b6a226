//! Cellular noise at many points at once, see [`lanes`](super::lanes): points of one cell share the scattered points around it.

use arrayvec::ArrayVec;
use fantex_base::vector_level;
use fearless_simd::prelude::*;
use fearless_simd::{Select, dispatch};

use super::lanes::{BLOCK, CellsAndOffsets, Kernel, SIGN, absorb_all, finish_all, load, transpose, units};
use super::{CELLULAR_RINGS, CELLULAR_SLACK, Cellular, CellularMetric};

/// What cellular noise is made of.
#[derive(Clone, Copy)]
pub(super) enum CellularValue {
    Nearest,
    Border,
    Id,
}

/// [`cellular`](super::cellular) in space.
pub(super) struct Scattered {
    pub(super) metric: CellularMetric,
    pub(super) value: CellularValue,
    pub(super) known: KnownPoints,
}

impl Kernel<3> for Scattered {
    #[inline(always)]
    fn value<S: Simd>(&mut self, simd: S, seed: u32, at: [S::f32s; 3]) -> S::f32s {
        let found = scattered(simd, seed, at, self.metric, &mut self.known);
        match self.value {
            CellularValue::Nearest => found.nearest,
            CellularValue::Border => found.second - found.nearest,
            CellularValue::Id => found.id * 2.0 - 1.0,
        }
    }
}

/// [`Cellular`](super::Cellular) of the lanes.
#[derive(Clone, Copy)]
struct Found<S: Simd> {
    nearest: S::f32s,
    second: S::f32s,
    id: S::f32s,
}

impl<S: Simd> Found<S> {
    #[inline(always)]
    fn add(&mut self, distance: S::f32s, id: S::f32s) {
        let is_nearer = distance.simd_lt(self.nearest);
        self.second = is_nearer.select(self.nearest, self.second.min(distance));
        self.nearest = self.nearest.min(distance);
        self.id = is_nearer.select(id, self.id);
    }

    /// Takes over what was found for some lanes.
    #[inline(always)]
    fn take(&mut self, lanes: <S::f32s as SimdBase<S>>::Mask, from: &Self) {
        self.nearest = lanes.select(from.nearest, self.nearest);
        self.second = lanes.select(from.second, self.second);
        self.id = lanes.select(from.id, self.id);
    }
}

/// A cell and those around it.
const NEAR: usize = 27;

/// As many as whole vectors hold.
const NEAR_LANES: usize = 32;

/// Steps from a cell to those around it, by axis; x changes first.
const NEAR_STEPS: [[f32; NEAR_LANES]; 3] = {
    let mut steps = [[0.0; NEAR_LANES]; 3];
    let mut number = 0;
    while number < NEAR_LANES {
        steps[0][number] = (number % 3) as f32 - 1.0;
        steps[1][number] = (number / 3 % 3) as f32 - 1.0;
        steps[2][number] = (number / 9) as f32 - 1.0;
        number += 1;
    }
    steps
};

/// The scattered points of a cell and of those around it: neighbouring places share them.
struct NearPoints {
    seed: u32,
    cell: [u32; 3],
    /// By axis, from the cell's lowest corner.
    at: [[f32; NEAR_LANES]; 3],
    ids: [f32; NEAR_LANES],
}

impl NearPoints {
    /// The points in the lanes of vectors.
    #[inline(always)]
    fn new<S: Simd>(simd: S, seed: u32, cell: [u32; 3]) -> Self {
        let mut near = Self { seed, cell, at: [[0.0; NEAR_LANES]; 3], ids: [0.0; NEAR_LANES] };
        let lanes = S::f32s::LEN;
        for first in (0..NEAR).step_by(lanes) {
            let mut hash = S::u32s::splat(simd, seed);
            for axis in (0..3).rev() {
                let step = load(simd, &NEAR_STEPS[axis], first).to_int::<S::i32s>().bitcast::<S::u32s>();
                hash = absorb_all::<S>(hash, step + cell[axis]);
            }
            let hash = finish_all::<S>(hash);
            for (axis, (steps, near)) in NEAR_STEPS.iter().zip(&mut near.at).enumerate() {
                let at = coordinate(simd, hash, axis) + load(simd, steps, first);
                at.store_slice(&mut near[first..first + lanes]);
            }
            units::<S>(hash).store_slice(&mut near.ids[first..first + lanes]);
        }
        near
    }
}

/// [`NearPoints`] of cells that were met last.
#[derive(Default)]
pub(super) struct KnownPoints {
    cells: ArrayVec<NearPoints, 4>,
    /// Which is forgotten next.
    oldest: usize,
}

impl KnownPoints {
    #[inline(always)]
    fn of<S: Simd>(&mut self, simd: S, seed: u32, cell: [u32; 3]) -> &NearPoints {
        let known = self.cells.iter().position(|near| near.seed == seed && near.cell == cell);
        let index = known.unwrap_or(self.oldest);
        if known.is_none() {
            let near = NearPoints::new(simd, seed, cell);
            match self.cells.get_mut(index) {
                Some(forgotten) => *forgotten = near,
                None => self.cells.push(near),
            }
            self.oldest = (index + 1) % self.cells.capacity();
        }
        &self.cells[index]
    }
}

/// [`cellular`](super::cellular) at many points.
pub(super) fn cellular_at(
    seed: u32,
    metric: CellularMetric,
    point: impl Fn(usize) -> [f32; 3],
    out: &mut [Cellular],
) {
    let mut at = [[0.0; BLOCK]; 3];
    let mut known = KnownPoints::default();
    for (first, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
        transpose(&mut at, out.len(), |i| point(first + i));
        dispatch!(vector_level(), simd => cellular_in(simd, seed, metric, &at, &mut known, out));
    }
}

#[inline(always)]
fn cellular_in<S: Simd>(
    simd: S,
    seed: u32,
    metric: CellularMetric,
    at: &[[f32; BLOCK]; 3],
    known: &mut KnownPoints,
    out: &mut [Cellular],
) {
    let lanes = S::f32s::LEN;
    for (first, out) in (0..).step_by(lanes).zip(out.chunks_mut(lanes)) {
        let place = [load(simd, &at[0], first), load(simd, &at[1], first), load(simd, &at[2], first)];
        let Found { nearest, second, id } = scattered(simd, seed, place, metric, known);
        let lanes = nearest.as_slice().iter().zip(second.as_slice()).zip(id.as_slice());
        for (out, ((&nearest, &second), &id)) in out.iter_mut().zip(lanes) {
            *out = Cellular { nearest, second, id };
        }
    }
}

/// Cells of a vector's lanes that are searched one after the other; what lies in more of them is searched lane by lane.
const SHARED_CELLS: usize = 3;

/// The scattered points nearest to the lanes' places. Lanes in one cell look at the same points.
#[inline(always)]
fn scattered<S: Simd>(
    simd: S,
    seed: u32,
    at: [S::f32s; 3],
    metric: CellularMetric,
    known: &mut KnownPoints,
) -> Found<S> {
    let place = CellsAndOffsets::<S, 3>::new(at);
    let none = S::f32s::splat(simd, 0.0);
    let mut found = Found { nearest: none, second: none, id: none };
    let all = u64::MAX >> (u64::BITS as usize - S::f32s::LEN);
    let mut left = all;
    for _ in 0..SHARED_CELLS {
        let (cell, inside) = place.shared(simd, left.trailing_zeros() as usize);
        let lanes = inside.to_bitmask();
        // Where so few share a cell, there are too many of them.
        if left == all && 4 * (lanes.count_ones() as usize) < S::f32s::LEN {
            break;
        }
        found.take(inside, &search(simd, seed, &place, metric, inside, Some(known.of(simd, seed, cell))));
        left &= !lanes;
        if left == 0 {
            break;
        }
    }
    if left != 0 {
        let lanes = SimdMask::from_bitmask(simd, left);
        found.take(lanes, &search(simd, seed, &place, metric, lanes, None));
    }
    Found {
        nearest: lengths::<S>(metric, found.nearest),
        second: lengths::<S>(metric, found.second),
        id: found.id,
    }
}

/// The measures of what is nearest to some lanes' places, ring by ring as in the scalar search. `near`: the points of the cell that these lanes
/// are in, if that is one.
#[inline(always)]
fn search<S: Simd>(
    simd: S,
    seed: u32,
    place: &CellsAndOffsets<S, 3>,
    metric: CellularMetric,
    lanes: <S::f32s as SimdBase<S>>::Mask,
    near: Option<&NearPoints>,
) -> Found<S> {
    let [zero, one] = [S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0)];
    let mut margin = S::f32s::splat(simd, 0.5);
    for t in place.offsets {
        margin = margin.min(t).min(one - t);
    }
    // Nothing is nearer to the other lanes.
    let far = lanes.select(S::f32s::splat(simd, f32::INFINITY), zero);
    let mut found = Found { nearest: far, second: far, id: zero };
    for ring in 0..=CELLULAR_RINGS {
        let reach = margin + (ring as f32 - 1.0);
        let is_open = lengths::<S>(metric, found.second).simd_gt(reach) & lanes;
        if !is_open.any_true() {
            break;
        }
        visit_ring(simd, seed, place, metric, (ring, is_open), near.filter(|_| ring < 2), &mut found);
    }
    found
}

#[inline(always)]
fn visit_ring<S: Simd>(
    simd: S,
    seed: u32,
    place: &CellsAndOffsets<S, 3>,
    metric: CellularMetric,
    (ring, is_open): (i32, <S::f32s as SimdBase<S>>::Mask),
    near: Option<&NearPoints>,
    found: &mut Found<S>,
) {
    let (zero, far) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, f32::INFINITY));
    let [x, y, z] = place.offsets;
    for number_z in 0..=2 * ring {
        let step_z = outwards(number_z);
        let gap_z = joined::<S>(metric, zero, gap(simd, z, step_z));
        if !is_near::<S>(gap_z, found) {
            continue;
        }
        let of_z = absorb_all::<S>(S::u32s::splat(simd, seed), place.cells[2] + step_z as u32);
        for number_y in 0..=2 * ring {
            let step_y = outwards(number_y);
            let gap_yz = joined::<S>(metric, gap_z, gap(simd, y, step_y));
            if !is_near::<S>(gap_yz, found) {
                continue;
            }
            let of_yz = absorb_all::<S>(of_z, place.cells[1] + step_y as u32);
            let is_on_ring = step_z.abs().max(step_y.abs()) == ring;
            // Within the ring's square only the ends of a row.
            let first = if is_on_ring || ring == 0 { 0 } else { 2 * ring - 1 };
            for number_x in first..=2 * ring {
                let step_x = outwards(number_x);
                // In the nearest ring a look is nearly as dear as a cell.
                if ring > 1 && !is_near::<S>(joined::<S>(metric, gap_yz, gap(simd, x, step_x)), found) {
                    continue;
                }
                let steps = [step_x, step_y, step_z];
                let mut at = [zero; 3];
                let id;
                if let Some(near) = near {
                    let number = (13 + step_x + 3 * step_y + 9 * step_z) as usize;
                    for (at, near) in at.iter_mut().zip(&near.at) {
                        *at = S::f32s::splat(simd, near[number]);
                    }
                    id = S::f32s::splat(simd, near.ids[number]);
                } else {
                    let hash = finish_all::<S>(absorb_all::<S>(of_yz, place.cells[0] + step_x as u32));
                    for axis in 0..3 {
                        at[axis] = coordinate(simd, hash, axis) + steps[axis] as f32;
                    }
                    id = units::<S>(hash);
                }
                let mut distance = zero;
                for (at, offset) in at.into_iter().zip(place.offsets) {
                    distance = joined::<S>(metric, distance, at - offset);
                }
                found.add(is_open.select(distance, far), id);
            }
        }
    }
}

/// Where the points of cells with these hashes lie in them, along an axis.
#[inline(always)]
fn coordinate<S: Simd>(simd: S, hash: S::u32s, axis: usize) -> S::f32s {
    units::<S>(finish_all::<S>(absorb_all::<S>(hash, S::u32s::splat(simd, axis as u32))))
}

/// 0, -1, 1, -2, 2, ...: points that are found first spare the search of cells farther away.
#[inline(always)]
fn outwards(number: i32) -> i32 {
    if number % 2 == 0 { number / 2 } else { -(number + 1) / 2 }
}

/// From the lanes' places to the cell so many steps away along an axis.
#[inline(always)]
fn gap<S: Simd>(simd: S, offset: S::f32s, step: i32) -> S::f32s {
    match step {
        0 => S::f32s::splat(simd, 0.0),
        1.. => S::f32s::splat(simd, step as f32) - offset,
        _ => offset - (step + 1) as f32,
    }
}

/// Whether a cell this far away may hold a point that is nearer than the second nearest of a lane.
#[inline(always)]
fn is_near<S: Simd>(gap: S::f32s, found: &Found<S>) -> bool {
    gap.simd_lt(found.second * CELLULAR_SLACK).any_true()
}

/// [`CellularMetric::joined`] in lanes.
#[inline(always)]
fn joined<S: Simd>(metric: CellularMetric, distance: S::f32s, along: S::f32s) -> S::f32s {
    let absolute = (along.bitcast::<S::u32s>() & !SIGN).bitcast::<S::f32s>();
    match metric {
        CellularMetric::Euclidean => distance + along * along,
        CellularMetric::Manhattan => distance + absolute,
        CellularMetric::Chebyshev => distance.max(absolute),
    }
}

#[inline(always)]
fn lengths<S: Simd>(metric: CellularMetric, distance: S::f32s) -> S::f32s {
    match metric {
        CellularMetric::Euclidean => distance.sqrt(),
        _ => distance,
    }
}
