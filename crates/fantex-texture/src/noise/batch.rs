//! Gradient noise in 3D at many points at once, in the widest vectors that the processor has.
//!
//! Every step is that of the scalar [`Noise::value`](super::Noise::value) in the same order, without fused
//! multiplications: the values are equal bit by bit for coordinates below 2^31 (a zero may differ in its sign).

use std::sync::LazyLock;

use fearless_simd::{Level, Select, dispatch, prelude::*};
use glam::Vec3;

/// Most octaves that [`octaves`] evaluates.
pub(super) const MOST_OCTAVES: usize = 16;

fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

/// The same, but not wider than eight lanes: few octaves would leave more of them empty.
fn level_of_eight_lanes() -> Level {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = level().as_avx2() {
        return Level::Avx2(avx2);
    }
    level()
}

/// Noise of one seed at all points.
pub(super) fn values(seed: u32, points: &[Vec3], out: &mut [f32]) {
    assert_eq!(points.len(), out.len(), "one value for every point");
    dispatch!(level(), simd => values_in(simd, seed, points, out));
}

/// Points that are brought from `x y z x y z` to `x x y y z z` at a time: enough that the vectors' loads do not wait for
/// the stores.
const BLOCK: usize = 128;

#[inline(always)]
fn values_in<S: Simd>(simd: S, seed: u32, points: &[Vec3], out: &mut [f32]) {
    let lanes = S::f32s::LEN;
    let seeds = S::u32s::splat(simd, seed);
    let mut at = [[0.0_f32; BLOCK]; 3];
    for (points, out) in points.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
        for (index, p) in points.iter().enumerate() {
            (at[0][index], at[1][index], at[2][index]) = (p.x, p.y, p.z);
        }
        let mut first = 0;
        for out in out.chunks_mut(lanes) {
            let value = noise(simd, seeds, load(simd, &at, first));
            if out.len() == lanes {
                value.store_slice(out);
            } else {
                out.copy_from_slice(&value.as_slice()[..out.len()]);
            }
            first += lanes;
        }
    }
}

/// Noise of up to [`MOST_OCTAVES`] seeds, each at its own point: the octaves of a fractal sum.
pub(super) fn octaves(
    seeds: &[u32; MOST_OCTAVES],
    at: &[[f32; MOST_OCTAVES]; 3],
    count: usize,
) -> [f32; MOST_OCTAVES] {
    let mut out = [0.0; MOST_OCTAVES];
    let level = if count <= 8 { level_of_eight_lanes() } else { level() };
    dispatch!(level, simd => octaves_in(simd, seeds, at, count, &mut out));
    out
}

#[inline(always)]
fn octaves_in<S: Simd>(
    simd: S,
    seeds: &[u32; MOST_OCTAVES],
    at: &[[f32; MOST_OCTAVES]; 3],
    count: usize,
    out: &mut [f32; MOST_OCTAVES],
) {
    let lanes = S::f32s::LEN;
    for first in (0..count).step_by(lanes) {
        let range = first..first + lanes;
        let seeds = S::u32s::from_slice(simd, &seeds[range.clone()]);
        noise(simd, seeds, load(simd, at, first)).store_slice(&mut out[range]);
    }
}

#[inline(always)]
fn load<S: Simd, const COUNT: usize>(simd: S, at: &[[f32; COUNT]; 3], first: usize) -> [S::f32s; 3] {
    let end = first + S::f32s::LEN;
    [
        S::f32s::from_slice(simd, &at[0][first..end]),
        S::f32s::from_slice(simd, &at[1][first..end]),
        S::f32s::from_slice(simd, &at[2][first..end]),
    ]
}

// Closures are not compiled for the vectors' instruction set unless they are inlined, which the compiler declines here: so
// each step is a function that must be.

/// The kernel: see the scalar version for the meaning of each step.
#[inline(always)]
fn noise<S: Simd>(simd: S, seed: S::u32s, [x, y, z]: [S::f32s; 3]) -> S::f32s {
    let (cell_x, x) = cell_and_offset::<S>(x);
    let (cell_y, y) = cell_and_offset::<S>(y);
    let (cell_z, z) = cell_and_offset::<S>(z);
    let share = [fade::<S>(x), fade::<S>(y)];
    let low = plane(simd, absorb::<S>(seed, cell_z), [cell_x, cell_y], [x, y, z], share);
    let high = plane(simd, absorb::<S>(seed, cell_z + 1), [cell_x, cell_y], [x, y, z - 1.0], share);
    mix::<S>(low, high, fade::<S>(z))
}

/// The four corners of equal z.
#[inline(always)]
fn plane<S: Simd>(
    simd: S,
    hash: S::u32s,
    [cell_x, cell_y]: [S::u32s; 2],
    [x, y, z]: [S::f32s; 3],
    share: [S::f32s; 2],
) -> S::f32s {
    let low = edge(simd, absorb::<S>(hash, cell_y), cell_x, [x, y, z], share[0]);
    let high = edge(simd, absorb::<S>(hash, cell_y + 1), cell_x, [x, y - 1.0, z], share[0]);
    mix::<S>(low, high, share[1])
}

/// The two corners of equal y and z.
#[inline(always)]
fn edge<S: Simd>(
    simd: S,
    hash: S::u32s,
    cell_x: S::u32s,
    [x, y, z]: [S::f32s; 3],
    share: S::f32s,
) -> S::f32s {
    let low = height(simd, absorb::<S>(hash, cell_x), [x, y, z]);
    let high = height(simd, absorb::<S>(hash, cell_x + 1), [x - 1.0, y, z]);
    mix::<S>(low, high, share)
}

#[inline(always)]
fn cell_and_offset<S: Simd>(x: S::f32s) -> (S::u32s, S::f32s) {
    let floor = x.floor();
    (floor.to_int::<S::i32s>().bitcast::<S::u32s>(), x - floor)
}

#[inline(always)]
fn fade<S: Simd>(t: S::f32s) -> S::f32s {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[inline(always)]
fn mix<S: Simd>(low: S::f32s, high: S::f32s, share: S::f32s) -> S::f32s {
    low + share * (high - low)
}

#[inline(always)]
fn absorb<S: Simd>(hash: S::u32s, coordinate: S::u32s) -> S::u32s {
    let mixed = ((hash ^ coordinate) + 0x9e37_79b9) * 0x85eb_ca6b;
    mixed ^ (mixed >> 15)
}

/// The product of a corner's gradient, chosen by its hash, and the offset `d` from the corner.
#[inline(always)]
fn height<S: Simd>(simd: S, hash: S::u32s, d: [S::f32s; 3]) -> S::f32s {
    let mixed = hash * 0xc2b2_ae35;
    let hash = (mixed ^ (mixed >> 16)) * 0x27d4_eb2f;
    // The upper four bits of floor(3/4 hash) are floor(12 hash / 2^32), the gradient's number. Halves and quarters are rounded
    // down; together they miss 1 where the lowest two bits are set.
    let half = hash >> 1;
    let number = half + (hash >> 2) + (hash & half & 1);
    // Gradients 0..4 lie in the plane of x and y, 4..8 of x and z, the others of y and z; two bits are the signs.
    let first = number.simd_lt(S::u32s::splat(simd, 8 << 28)).select(d[0], d[1]);
    let second = number.simd_lt(S::u32s::splat(simd, 4 << 28)).select(d[1], d[2]);
    let first = (first.bitcast::<S::u32s>() ^ ((number << 3) & SIGN)).bitcast::<S::f32s>();
    let second = (second.bitcast::<S::u32s>() ^ ((number << 2) & SIGN)).bitcast::<S::f32s>();
    first + second
}

/// The bit of a float that is its sign.
const SIGN: u32 = 1 << 31;
