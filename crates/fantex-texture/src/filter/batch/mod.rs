//! Many look-ups at once, in the widest vectors that the processor has.
//!
//! ```text
//!  points --place--> levels and positions --read--> pairs of stored texels --decode, interpolate--> linear RGBA
//!            vectors          one by one, no result waits for another             vectors
//! ```
//!
//! A block of look-ups passes each step as a whole. The middle one does nothing but copy bytes, two neighbouring texels by one
//! load, so that the processor has the cache lines of many look-ups under way at once; that is what makes random
//! look-ups four times as fast as one by one. What differs by look-up (level, position, shares) lies in arrays.
//!
//! Steps are those of `inner.rs` and `lod.rs`, without fused multiplications: the results do not depend on the processor. Bytes
//! are decoded to 16 bits, as which the coarser levels are stored. Where texels count alike (`weigh.rs`), neighbours are
//! interpolated in whole numbers. Look-ups at the edges of a level are left to the caller, and so are
//! images that are not stored as one, three or four fixed-point channels.

mod decode;
mod grids;
mod place;
mod texels;
mod weigh;
mod widen;

use std::ops::Range;
use std::sync::LazyLock;

use fearless_simd::{Level, Simd, dispatch, prelude::*};
use glam::Vec2;

use self::decode::{blend, mix};
pub use self::grids::{GRID_LOOK_UPS, GridLookUps, TexelGrid};
use self::place::{Quads, locate};
pub(crate) use self::texels::Levels;
use self::texels::Pairs;
use self::weigh::{mix_texels, store_texels, weigh};
pub(super) use self::{
    decode::{UNIT, load_four, store_rgba},
    texels::eight,
    widen::{Meaning, widen},
};
use crate::{AlphaUse, Wrap};

/// Look-ups of a block: enough that no step waits for the one before, few enough that all arrays stay in the first cache.
pub(crate) const BLOCK: usize = 64;

pub(super) fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

/// Numbers of a block's look-ups.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Block<T>(pub(crate) [T; BLOCK]);

impl<T: Copy> Block<T> {
    fn of(value: T) -> Self {
        Self([value; BLOCK])
    }
}

/// Where a block of trilinear look-ups is.
#[derive(Clone, Debug)]
pub(crate) struct Probes {
    /// Texture coordinates.
    places: Block<[f32; 2]>,
    /// The finer one of two neighbouring levels, and the share of the coarser one.
    fine: Block<u32>,
    share: Block<f32>,
    count: usize,
}

impl Probes {
    /// None yet.
    pub(crate) fn new() -> Self {
        Self { places: Block::of([0.0; 2]), fine: Block::of(0), share: Block::of(0.0), count: 0 }
    }

    /// Up to a block of other points, on the levels of those before: level 0 if there were none.
    pub(crate) fn place(&mut self, points: impl ExactSizeIterator<Item = Vec2>) {
        self.count = points.len();
        for (place, point) in self.places.0.iter_mut().zip(points) {
            *place = point.to_array();
        }
    }

    /// Chooses the levels by footprints: `steps` are the footprints' edges in uv, `size` is that of level 0.
    pub(crate) fn choose_levels(&mut self, steps: &Steps, size: Vec2, last: usize) {
        dispatch!(level(), simd => place::choose_levels(simd, self, steps, size, last as u32));
    }

    /// Adds points of a row on equal levels, `first + step * number`; the block must have room for them.
    pub(crate) fn push_row(&mut self, [first, step]: [Vec2; 2], numbers: Range<u32>, fine: u32, share: f32) {
        let range = self.count..self.count + numbers.len();
        for (place, number) in self.places.0[range.clone()].iter_mut().zip(numbers) {
            *place = (first + step * number as f32).to_array();
        }
        self.fine.0[range.clone()].fill(fine);
        self.share.0[range.clone()].fill(share);
        self.count = range.end;
    }

    /// Probes in the block.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// Forgets all probes.
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Where a probe is.
    pub(crate) fn at(&self, index: usize) -> (Vec2, u32, f32) {
        (Vec2::from_array(self.places.0[index]), self.fine.0[index], self.share.0[index])
    }
}

/// The edges of a block's footprints, in uv: `x` and `y` of the first, then of the second.
#[derive(Clone, Debug)]
pub(crate) struct Steps(Block<[f32; 4]>);

impl Steps {
    /// None yet.
    pub(crate) fn new() -> Self {
        Self(Block::of([0.0; 4]))
    }

    /// Up to a block of others.
    pub(crate) fn place(&mut self, footprints: impl Iterator<Item = [Vec2; 2]>) {
        for (numbers, [dx, dy]) in self.0.0.iter_mut().zip(footprints) {
            *numbers = [dx.x, dx.y, dy.x, dy.y];
        }
    }
}

/// Results of a block: linear RGBA, straight alpha.
pub(crate) type Colors = Block<[f32; 4]>;

impl Colors {
    /// Black.
    pub(crate) fn black() -> Self {
        Self::of([0.0; 4])
    }
}

/// What the steps hand on, kept from block to block.
pub(crate) struct Workspace {
    /// In the finer and in the coarser level of every probe.
    quads: [Quads; 2],
    pairs: [Pairs; 2],
}

impl Workspace {
    /// Not yet used.
    pub(crate) fn new() -> Self {
        Self { quads: [Quads::new(), Quads::new()], pairs: [Pairs::new(), Pairs::new()] }
    }
}

/// What is the same for all look-ups of a call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LookUp<'a> {
    pub(crate) levels: &'a Levels<'a>,
    pub(crate) wrap: [Wrap; 2],
    pub(crate) alpha: AlphaUse,
}

impl LookUp<'_> {
    /// Interpolates in and between levels at all probes, alpha still a weight. Returns the set of those (a bit each) that must
    /// be looked up otherwise.
    pub(crate) fn sums(&self, probes: &Probes, workspace: &mut Workspace, out: &mut Colors) -> u64 {
        dispatch!(level(), simd => sums_of_channels(simd, self, probes, workspace, out))
    }
}

#[inline(always)]
fn sums_of_channels<S: Simd>(
    simd: S,
    look_up: &LookUp<'_>,
    probes: &Probes,
    workspace: &mut Workspace,
    out: &mut Colors,
) -> u64 {
    match look_up.levels.channels() {
        1 => sums::<S, 1>(simd, look_up, probes, workspace, out),
        3 => sums::<S, 3>(simd, look_up, probes, workspace, out),
        _ => sums::<S, 4>(simd, look_up, probes, workspace, out),
    }
}

#[inline(always)]
fn sums<S: Simd, const C: usize>(
    simd: S,
    look_up: &LookUp<'_>,
    probes: &Probes,
    workspace: &mut Workspace,
    out: &mut Colors,
) -> u64 {
    let (levels, count) = (look_up.levels, probes.count);
    if count == 0 {
        return 0;
    }
    let Workspace { quads: [fine, coarse], pairs: [fine_pairs, coarse_pairs] } = workspace;
    let is_weighted = C == 4 && look_up.alpha == AlphaUse::Coverage;
    locate(simd, probes, look_up.wrap, levels, 0, fine);
    let missed = fine_pairs.read::<S, C>(simd, levels, fine, count, !is_weighted);
    // Magnified, nothing is seen of coarser levels.
    if probes.share.0[..count].iter().all(|&share| share == 0.0) {
        for first in (0..count).step_by(S::f32s::LEN) {
            if is_weighted {
                store_rgba::<S, C>(simd, blend::<S, C>(simd, fine, fine_pairs, true, first), out, first);
            } else {
                let value = weigh::<S, C>(simd, fine, fine_pairs, levels.meaning(), first);
                store_texels::<S, C>(simd, value, out, first);
            }
        }
        return missed;
    }
    locate(simd, probes, look_up.wrap, levels, 1, coarse);
    let missed = missed | coarse_pairs.read::<S, C>(simd, levels, coarse, count, !is_weighted);
    for first in (0..count).step_by(S::f32s::LEN) {
        let share = S::f32s::from_slice(simd, &probes.share.0[first..first + S::f32s::LEN]);
        if is_weighted {
            let from = blend::<S, C>(simd, fine, fine_pairs, true, first);
            let to = blend::<S, C>(simd, coarse, coarse_pairs, true, first);
            store_rgba::<S, C>(simd, mix::<S, C>(from, to, share), out, first);
        } else {
            let from = weigh::<S, C>(simd, fine, fine_pairs, levels.meaning(), first);
            let to = weigh::<S, C>(simd, coarse, coarse_pairs, levels.meaning(), first);
            store_texels::<S, C>(simd, mix_texels::<S>(from, to, share), out, first);
        }
    }
    missed
}
