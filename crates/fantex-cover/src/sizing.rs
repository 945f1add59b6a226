//! How large tiles are: as dense as they are asked to be, times the factor that reaches a number of texels.

use std::cell::Cell;

use fantex_base::{Error, Result};
use glam::Vec2;
use rayon::prelude::*;

use crate::cost::Region;
use crate::fan_shape::Layout;
use crate::flatten::Laid;
use crate::groups::Grouping;
use crate::surface::Surface;
use crate::watch::Watch;
use crate::{Cover, CoverOptions, Group, GroupKind, MAX_BLOCK_SIDE, TexelBudget, UnfoldedCorner};

/// A cover with all densities times a factor.
pub(crate) struct SizedCover {
    pub(crate) cover: Cover,
    /// Stored texels.
    pub(crate) texels: u64,
    pub(crate) scale: f32,
}

/// Factors of the densities: one for all groups but the first `raised`, which have a larger one.
#[derive(Clone, Copy, Debug)]
struct Scales {
    scale: f32,
    raised: usize,
    raised_scale: f32,
}

impl Scales {
    fn all(scale: f32) -> Self {
        Self { scale, raised: 0, raised_scale: scale }
    }

    fn of(&self, group: usize) -> f32 {
        if group < self.raised { self.raised_scale } else { self.scale }
    }
}

/// Groups whose tiles are to be sized.
pub(crate) struct Sizing<'a> {
    surface: &'a Surface<'a>,
    grouping: &'a Grouping,
    /// Nominal, in the mean: texels per mesh unit of length.
    density: f32,
    options: &'a CoverOptions,
    watch: &'a Watch<'a>,
    /// The groups of all corners, which are the same whatever the scale; empty where they are to be found.
    corner_groups: Cell<Vec<[u32; 3]>>,
}

impl<'a> Sizing<'a> {
    pub(crate) fn new(
        surface: &'a Surface<'a>,
        grouping: &'a Grouping,
        density: f32,
        options: &'a CoverOptions,
        watch: &'a Watch<'a>,
    ) -> Self {
        Self { surface, grouping, density, options, watch, corner_groups: Cell::default() }
    }

    /// The cover with the texels that the options ask for.
    pub(crate) fn to_budget(&self) -> Result<SizedCover> {
        if let TexelBudget::Total(texels) = self.options.budget {
            return self.to_total(texels);
        }
        let found = self.sized(Scales::all(1.0))?;
        match self.options.most_texels {
            Some(most) if found.texels > most => self.to_total(most),
            _ => Ok(found),
        }
    }

    /// The cover that stores `texels`, within a percent and not more, as far as rounding allows. What a cover stores is known nearly before it is
    /// made, and better once some of its groups are counted.
    fn to_total(&self, texels: u64) -> Result<SizedCover> {
        let laid = &self.grouping.laid;
        let mut scale = scale_to_total(laid, texels);
        if let Some((stored, step)) = self.counted(Scales::all(scale))? {
            let expected: u64 =
                laid.iter().step_by(step).map(|l| expected_texels(l.region.scaled(l.density), scale)).sum();
            let wanted = AIMED_SHARE * texels as f64 * expected as f64 / stored.max(1) as f64;
            scale = scale_to_total(laid, wanted as u64);
        }
        let mut best = self.sized(Scales::all(scale))?;
        let (mut low, mut high) = (0.0, f32::INFINITY);
        let mut reached = best.texels;
        for _ in 1..MAX_TRIALS {
            if reached > texels {
                high = scale
            } else {
                low = scale
            }
            let ratio = texels as f64 / reached.max(1) as f64;
            if (1.0..1.01).contains(&ratio) || high < low * SCALE_TOLERANCE {
                break;
            }
            // Texels grow nearly with the square of the scale.
            let guess = scale * (ratio * AIMED_SHARE).sqrt() as f32;
            scale = if guess > low && guess < high { guess } else { (low * high).sqrt() };
            if !(scale.is_finite() && scale > 0.0) {
                break;
            }
            let found = self.sized(Scales::all(scale))?;
            reached = found.texels;
            let [is_in, was_in] = [reached, best.texels].map(|n| n <= texels);
            if if is_in { !was_in || reached > best.texels } else { !was_in && reached < best.texels } {
                best = found;
            }
        }
        // Where many tiles are alike all of them grow at once; then only some do.
        let (scale, mut counts) = (best.scale, [0, laid.len()]);
        for _ in 0..MAX_TRIALS {
            let middle = (counts[0] + counts[1]) / 2;
            let is_near = best.texels as f64 > 0.99 * texels as f64;
            if best.texels > texels || is_near || !high.is_finite() || middle == counts[0] {
                break;
            }
            let found = self.sized(Scales { scale, raised: middle, raised_scale: high })?;
            counts[usize::from(found.texels > texels)] = middle;
            if found.texels <= texels && found.texels > best.texels {
                best = found;
            }
        }
        Ok(best)
    }

    fn sized(&self, scales: Scales) -> Result<SizedCover> {
        let cover = self.assemble(scales)?;
        // Of many groups mostly one size is tried, of few ones two; then the cover is measured.
        self.watch.add_half();
        Ok(SizedCover { texels: cover.stored_texels(self.surface.mesh), cover, scale: scales.scale })
    }

    /// What some groups store, of a number of them ([`Cover::stored_texels_of_some`]). What single fans store is foretold well enough.
    fn counted(&self, scales: Scales) -> Result<Option<(u64, usize)>> {
        if self.options.tile == 0 {
            return Ok(None);
        }
        let cover = self.assemble(scales)?;
        let counted = cover.stored_texels_of_some(self.surface.mesh);
        self.corner_groups.set(cover.corner_groups);
        Ok(counted)
    }

    /// A cover with these densities.
    fn assemble(&self, scales: Scales) -> Result<Cover> {
        self.watch.check()?;
        let Self { surface, grouping, .. } = self;
        let laid = &grouping.laid;
        let longest = laid
            .par_iter()
            .enumerate()
            .map(|(group, l)| (l.region.size * l.density).max_element() * scales.of(group))
            .reduce(|| 0.0, f32::max);
        if longest + 1.0 > MAX_EXTENT as f32 {
            let wanted = f64::from(longest.min(f32::MAX)) + 1.0;
            let readable = |n: f64| if n < 1e9 { format!("{:.0}", n.ceil()) } else { format!("{n:.0e}") };
            let (needed, factor) = (readable(wanted), readable(wanted / f64::from(MAX_EXTENT)));
            return Err(Error::too_large(format!(
                "a tile would need {needed} texels along one side, the limit is {MAX_EXTENT}: lower the density {factor} times (the \
             number of texels by the square of that), or cut the triangles (--longest-edge does so where the surface bends; large flat \
             ones are to be subdivided in the model)"
            )));
        }
        let placed = |(group, laid): (usize, &Laid)| place(laid, scales.of(group));
        let groups: Vec<Group> = laid.par_iter().enumerate().with_min_len(1 << 10).map(placed).collect();
        let mut unfolded: Vec<UnfoldedCorner> = laid
            .par_iter()
            .zip(&groups)
            .filter(|(laid, _)| laid.layout == Layout::Unfolded)
            .flat_map_iter(|(laid, group)| {
                let corners = laid.corners.iter();
                let corners = corners.map(|&(corner, planar)| UnfoldedCorner {
                    corner,
                    uv: planar.map(|p| group.uv_offset + group.uv_scale * p),
                });
                rounded(corners.collect(), group.extent)
            })
            .collect();
        unfolded.par_sort_unstable_by_key(|u| u.corner);
        let unfolded = unfolded.into();
        let mut corner_groups = self.corner_groups.take();
        if corner_groups.is_empty() {
            let groups_of = |t: usize| {
                let [a, b, c] = surface.fans.of_triangle(t);
                let group = |fan: u32| grouping.fan_groups[fan as usize];
                [group(a), group(b), group(c)]
            };
            let triangles = (0..surface.mesh.triangles.len()).into_par_iter().with_min_len(1 << 12);
            corner_groups = triangles.map(groups_of).collect();
        }
        let is_paired_by_angle = surface.fans.has_links_by_angle();
        let (is_creased, hard_edges) = (false, None);
        let (density, delta) = (self.density * scales.scale, self.options.delta);
        Ok(Cover {
            delta,
            density,
            is_creased,
            hard_edges,
            is_paired_by_angle,
            corner_groups,
            groups,
            unfolded,
        })
    }
}

/// Sizes tried for a total, at most, and then numbers of larger tiles; mostly two in all.
const MAX_TRIALS: usize = 8;

/// Aims a little below the total.
const AIMED_SHARE: f64 = 0.996;

/// The factor of all densities with which the tiles store `texels` together, nearly.
fn scale_to_total(laid: &[Laid], texels: u64) -> f32 {
    let regions: Vec<Region> =
        laid.par_iter().with_min_len(1 << 12).map(|l| l.region.scaled(l.density)).collect();
    let (mut low, mut high) = (1.0 / 1024.0, 1024.0f32);
    if texels <= MIN_TILE_TEXELS * regions.len() as u64 {
        // The smallest tiles alone exceed the budget; they are at least used to the full.
        let longest =
            regions.par_iter().with_min_len(1 << 12).map(|r| r.size.max_element()).reduce(|| 0.0, f32::max);
        return (MAX_LENGTH_IN_MIN_TILE / longest).clamp(low, high);
    }
    let total = |scale: f32| -> u64 {
        regions.par_iter().with_min_len(1 << 12).map(|&region| expected_texels(region, scale)).sum()
    };
    // Texels grow nearly with the square of the scale: a few steps by that rule bracket the answer closely.
    let mut scale = 1.0f32;
    for step in 0..16 {
        let reached = total(scale);
        if reached <= texels {
            low = low.max(scale)
        } else {
            high = high.min(scale)
        }
        if high < low * SCALE_TOLERANCE {
            break;
        }
        let guess = scale
            * (texels as f64 / reached as f64).sqrt() as f32
            * if step % 2 == 0 { 1.0005 } else { 0.9995 };
        let middle = 0.5 * (low + high);
        scale = if step < 8 && guess > low && guess < high { guess } else { middle };
    }
    low
}

/// Texels that a tile stores, nearly, for a region in nominal texels.
fn expected_texels(region: Region, scale: f32) -> u64 {
    let [w, h] = extent(region.size, scale).map(u64::from);
    (w * h).min(region.scaled(Vec2::splat(scale)).block_texels() as u64)
}

/// Relative tolerance of the search for the scale.
const SCALE_TOLERANCE: f32 = 1.0005;

/// The corners of an unfolded group in [whole steps](UnfoldedCorner::steps), which pack well, unless that turns a triangle over or makes it a line.
fn rounded(mut corners: Vec<UnfoldedCorner>, extent: [u32; 2]) -> Vec<UnfoldedCorner> {
    let steps = UnfoldedCorner::steps(extent);
    let whole = |uv: [Vec2; 3]| uv.map(|uv| (uv * steps).round() / steps);
    let is_upright = |[a, b, c]: [Vec2; 3]| (b - a).perp_dot(c - a) > 0.0;
    if corners.iter().all(|corner| is_upright(whole(corner.uv)) || !is_upright(corner.uv)) {
        corners.iter_mut().for_each(|corner| corner.uv = whole(corner.uv));
    }
    corners
}

/// The tile map that takes the group's rectangle to the tile, half a texel inside.
fn place(laid: &Laid, scale: f32) -> Group {
    let extent = extent(laid.region.size * laid.density, scale);
    let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
    // A rectangle thinner than the nominal density can tell (a point, a line) is not blown up to the tile's size.
    let thinnest = 0.5 / (laid.density * scale);
    let uv_scale = (texels - 1.0) / texels / laid.region.size.max(thinnest);
    let middle = laid.min + 0.5 * laid.region.size;
    let uv_offset = Vec2::splat(0.5) - uv_scale * middle;
    let kind = match laid.layout {
        Layout::Unfolded => GroupKind::Unfolded,
        Layout::Projected => GroupKind::Projected,
    };
    Group { kind, frame: laid.frame, uv_scale, uv_offset, extent }
}

// Tile extents: how many texels a rectangle gets.

/// Longest side of a tile in texels, in memory and in files.
pub const MAX_EXTENT: u32 = 1 << 16;

/// Rounding a side down to a multiple of 4 may cost at most this share of the nominal density.
const TOLERATED_LOSS: f32 = 0.06;

/// Shortest side of a tile in texels.
pub const MIN_EXTENT: u32 = 4;

/// Texels of the smallest tile.
const MIN_TILE_TEXELS: u64 = (MIN_EXTENT * MIN_EXTENT) as u64;

/// The longest region in texels, rounded down a little, that gets a side of 4 texels.
const MAX_LENGTH_IN_MIN_TILE: f32 = 0.99999 * 3.0 / (1.0 - TOLERATED_LOSS);

/// Sides longer than this are multiples of 32.
const LONG_SIDE: f32 = MAX_BLOCK_SIDE as f32;

/// Tile extents for regions of a size in nominal texels.
fn extent(texels: Vec2, scale: f32) -> [u32; 2] {
    (texels * scale).to_array().map(side_texels)
}

/// Texels along a side whose region is `length` texels long: the region plus half a texel of filter margin at both ends,
/// rounded to a multiple of 4. The tile map is then scaled so that the region fills the tile, whichever way the rounding
/// went, so no texel is left over; the density of the side follows by at most the tolerated loss or the gain.
fn side_texels(length: f32) -> u32 {
    let wanted = length + 1.0;
    if wanted > LONG_SIDE {
        // Three levels halve exactly, so that long tiles can be baked in pieces.
        return 32 * ((wanted / 32.0).round() as u32).min(MAX_EXTENT / 32);
    }
    let blocks = (wanted * 0.25) as u32;
    let down = (4 * blocks) as f32;
    let good = blocks >= 1 && down - 1.0 >= (1.0 - TOLERATED_LOSS) * length;
    let side = if good || down == wanted { 4 * blocks } else { 4 * blocks + 4 };
    side.clamp(MIN_EXTENT, MAX_EXTENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_are_multiples_of_four_that_hold_the_region() {
        assert_eq!(side_texels(0.0), 4);
        assert_eq!(side_texels(3.0), 4);
        assert_eq!(side_texels(3.2), 8);
        assert_eq!([1.0, 1.0001].map(|f| side_texels(f * MAX_LENGTH_IN_MIN_TILE)), [4, 8]);
        assert_eq!(side_texels(64.0), 64);
        assert_eq!(side_texels(127.9), 128);
        for i in 0..10_000 {
            let length = i as f32 * 0.037;
            let side = side_texels(length);
            assert!(
                side.is_multiple_of(4)
                    && (side - 1) as f32 >= (1.0 - TOLERATED_LOSS) * length
                    && side as f32 <= length + 5.0
            );
        }
    }
}
