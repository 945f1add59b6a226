//! Building the cover of a mesh.

use std::cell::Cell;
use std::time::Instant;

use fantex_base::{Error, Result, counted, input};
use fantex_mesh::{
    FanCorner, Fans, HardEdges, MAX_FAN_TRIANGLES, Mesh, VertexCorners, check_hard_edges, is_crease,
    shading_normals,
};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::cost::Region;
use crate::fan_shape::{FanShape, Layout};
use crate::fan_tiles::{fan_groups, lay_fans};
use crate::flatten::Laid;
use crate::groups::{GroupLimits, Grouping, expect_groups, group_fans};
use crate::nominal::NominalDensity;
use crate::surface::{Ring, Surface};
use crate::watch::{Watch, time};
use crate::{Cover, CoverStats, Group, GroupKind, MAX_BLOCK_SIDE, UnfoldedCorner};

/// How many texels the surface gets.
#[derive(Clone, Debug, PartialEq)]
pub enum TexelBudget {
    /// So many stored texels at level 0 (see [`Cover::stored_texels`]; reached within a percent unless tiles are at their smallest).
    Total(u64),
    /// Texels per mesh unit of length, everywhere.
    Density(f64),
    /// Texels per mesh unit of length, one value per triangle (e.g. the density of a texture to be replaced).
    PerTriangle(Vec<f32>),
}

/// Options of [`build_cover`].
#[derive(Clone, Debug, PartialEq)]
pub struct CoverOptions {
    /// How many texels the surface gets.
    pub budget: TexelBudget,
    /// Stored texels at most, unless tiles are at their smallest: where densities would take more, all of them shrink alike.
    pub most_texels: Option<u64>,
    /// Longest side of a tile of several fans in texels; of 512 or more, up to eight times as much where surfaces would be torn into many pieces.
    /// 0 gives every fan its own tile.
    pub tile: u32,
    /// Width of the blend band in barycentric coordinates, 0 < delta <= 1/3.
    pub delta: f32,
    /// Groups of several fans keep this cosine between projection direction and every triangle normal.
    pub facing: f32,
    /// End fans at [creases](is_crease), so that no texel mixes both sides: for what jumps there as light does.
    pub cut_creases: bool,
    /// End fans at [hard edges](HardEdges), too, from so many degrees between the normals of their triangles on, 0 to 180: no tile lies across
    /// one, and the texture function may jump there. (Where a single one ends within a smooth part it stays continuous at that end.)
    pub hard_edges: Option<f32>,
}

impl Default for CoverOptions {
    fn default() -> Self {
        Self {
            budget: TexelBudget::Total(4 << 20),
            most_texels: None,
            tile: 1024,
            delta: 1.0 / 16.0,
            facing: 0.25,
            cut_creases: false,
            hard_edges: None,
        }
    }
}

/// What is known of a triangle and its half fan while a mesh is covered, measured on landscapes.
const BYTES_PER_TRIANGLE: u64 = 96;

/// Covers a mesh. Deterministic on any number of threads; linear in the triangles, for each of which it takes some 100 bytes of memory beside
/// the mesh's own.
///
/// # Errors
/// An empty or too large mesh, more triangles than the memory [allows](input::ReadLimits) that is left, or options out of range.
pub fn build_cover(mesh: &Mesh, options: &CoverOptions) -> Result<(Cover, CoverStats)> {
    build_cover_while(mesh, options, &|_| true)
}

/// As [`build_cover`], but ends soon once it is not wanted any more. `goes_on` is asked that often, from all threads, and told what share of
/// the time has gone, about, from 0 to 1: threads may tell theirs in any order.
///
/// # Errors
/// As [`build_cover`]; it is not wanted any more ([`Error::is_cancelled`]).
pub fn build_cover_while(
    mesh: &Mesh,
    options: &CoverOptions,
    goes_on: &(dyn Fn(f32) -> bool + Sync),
) -> Result<(Cover, CoverStats)> {
    check(mesh, options)?;
    let watch = Watch::new(goes_on);
    let triangles = mesh.triangles.len() as u64;
    let what = format_args!("a mesh of {} and its cover", counted(triangles, "triangle"));
    let _held = input::reserve(what, mesh.byte_len() + BYTES_PER_TRIANGLE * triangles)?;
    let started = Instant::now();
    watch.begin(time::ANGLES, 0)?;
    let vertex_corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let fans = Fans::by_angle(mesh, &vertex_corners);
    drop(vertex_corners);
    let (fans, creases) = cut_at_creases(mesh, fans, options);
    let mut surface = Surface::new(mesh, fans);
    surface.creases = creases;
    let count = surface.fans.len();
    let density = NominalDensity::new(&surface, options);
    let mut stats = CoverStats::default();
    let grouping = if options.tile == 0 {
        watch.expect(time::ANGLES + time::LAYING + time::SIZING);
        watch.begin(time::ANGLES + time::LAYING, count)?;
        let laid = lay_fans(&surface, &density, options.delta, &watch);
        stats.fans.folding = laid.iter().filter(|laid| laid.folds).count() as u64;
        stats.seconds_fans = started.elapsed().as_secs_f64();
        Grouping { fan_groups: fan_groups(&surface.fans, &laid), laid }
    } else {
        expect_groups(&watch, count);
        watch.begin(time::SHAPED, count)?;
        let shapes = shape_fans(&surface, &watch);
        stats.fans.folding = shapes.iter().filter(|shape| shape.folds).count() as u64;
        stats.seconds_fans = started.elapsed().as_secs_f64();
        let limits =
            GroupLimits { delta: options.delta, extent_texels: options.tile as f32, facing: options.facing };
        group_fans(&surface, &shapes, &density, &limits, &watch)?
    };
    stats.fans.total = surface.fans.len() as u64;
    let unfolded = grouping.laid.iter().filter(|laid| laid.layout == Layout::Unfolded);
    stats.fans.unfolded = unfolded.map(|laid| u64::from(laid.fans)).sum();
    stats.fans.projected = stats.fans.total - stats.fans.unfolded;
    let mean = density.mean(&surface);
    watch.begin_last()?;
    // Whatever the scale, corners have the same groups.
    let known_corner_groups = Cell::new(Vec::new());
    let assembled = |scales| {
        watch.check()?;
        let corner_groups = known_corner_groups.take();
        assemble(&surface, &grouping, corner_groups, scales, (mean * scales.scale, options.delta))
    };
    let sized = |scales: Scales| {
        let cover = assembled(scales)?;
        // Of many groups mostly one size is tried, of few ones two; then the cover is measured.
        watch.add_half();
        Ok(Sized { texels: cover.stored_texels(mesh), cover, scale: scales.scale })
    };
    // What single fans store is foretold well enough.
    let counted = |scales: Scales| match options.tile {
        0 => Ok(None),
        _ => {
            let cover = assembled(scales)?;
            let counted = cover.stored_texels_of_some(mesh);
            known_corner_groups.set(cover.corner_groups);
            Ok(counted)
        }
    };
    let Sized { mut cover, texels, scale } = match options.budget {
        TexelBudget::Total(texels) => sized_to_total(&grouping.laid, texels, counted, sized)?,
        _ => {
            let found = sized(Scales::all(1.0))?;
            match options.most_texels {
                Some(most) if found.texels > most => sized_to_total(&grouping.laid, most, counted, sized)?,
                _ => found,
            }
        }
    };
    (cover.is_creased, cover.hard_edges) = (options.cut_creases, options.hard_edges);
    stats.seconds_groups = started.elapsed().as_secs_f64() - stats.seconds_fans;
    stats.measure(&surface, &cover, texels, |t| density.of_triangle(t) * scale);
    watch.end()?;
    Ok((cover, stats))
}

/// The fans, cut at the creases and hard edges that the options name; and of every edge that was cut the corners of both triangles at its
/// ends, `[[own, own], [other, other]]`.
fn cut_at_creases(mesh: &Mesh, fans: Fans, options: &CoverOptions) -> (Fans, Vec<[[u32; 2]; 2]>) {
    let normals = options.cut_creases.then(|| shading_normals(mesh));
    let hard = options.hard_edges.map(|degrees| HardEdges::of(mesh, degrees));
    let is_cut = |before: FanCorner, after: FanCorner| {
        let is_crease =
            |normals: &Vec<Vec3>| is_crease(normals, before.corner() as usize, after.corner() as usize);
        let is_hard = |hard: &HardEdges<'_>| {
            let triangle = mesh.triangles[before.triangle()];
            let [center, _, ring] = before.slots().map(|k| triangle[k]);
            hard.is_hard([before, after].map(|corner| corner.triangle() as u32), [center, ring])
        };
        normals.as_ref().is_some_and(is_crease) || hard.as_ref().is_some_and(is_hard)
    };
    let mut creases = Vec::new();
    if normals.is_none() && hard.is_none() {
        return (fans, creases);
    }
    for fan in 0..fans.len() {
        let corners = fans.corners(fan);
        let count = corners.len() - usize::from(!fans.is_closed(fan));
        for (i, &before) in corners.iter().enumerate().take(count) {
            let after = corners[(i + 1) % corners.len()];
            if is_cut(before, after) {
                let ends = |corner: FanCorner, ring: usize| {
                    [corner.corner(), (3 * corner.triangle() + corner.slots()[ring]) as u32]
                };
                creases.push([ends(before, 2), ends(after, 1)]);
            }
        }
    }
    let fans = if creases.is_empty() { fans } else { fans.cut(is_cut) };
    (fans, creases)
}

fn check(mesh: &Mesh, options: &CoverOptions) -> Result<()> {
    let triangles = mesh.triangles.len();
    if triangles == 0 {
        return Err(Error::invalid("the mesh has no triangles; a cover needs at least one"));
    }
    if triangles > MAX_FAN_TRIANGLES {
        return Err(Error::too_large(format!(
            "the mesh has {triangles} triangles; a cover handles at most {MAX_FAN_TRIANGLES}"
        )));
    }
    if !(options.delta > 0.0 && options.delta <= 1.0 / 3.0) {
        let given = options.delta;
        return Err(Error::invalid(format!(
            "the blend band must be wider than 0 and at most 1/3, got {given}"
        )));
    }
    options.hard_edges.map_or(Ok(()), check_hard_edges)?;
    options.budget.check(triangles)
}

impl TexelBudget {
    /// Refuses what no surface of so many triangles can have.
    ///
    /// # Errors
    /// Texels or densities that are not positive and finite, or not one for each triangle.
    pub fn check(&self, triangles: usize) -> Result<()> {
        // Densities are kept in single precision, where 1e-60 is zero and 1e60 infinite.
        let positive = |given: f64| {
            let kept = given as f32;
            match kept.is_finite() && kept > 0.0 {
                true => Ok(()),
                false => {
                    Err(Error::invalid(format!("the texel budget must be positive and finite, got {given}")))
                }
            }
        };
        match self {
            Self::Total(n) => positive(*n as f64),
            Self::Density(d) => positive(*d),
            Self::PerTriangle(field) if field.len() != triangles => Err(Error::invalid(format!(
                "the density field has {} values, expected one for each of the {triangles} triangles",
                field.len()
            ))),
            Self::PerTriangle(field) => field.iter().try_for_each(|&d| positive(f64::from(d))),
        }
    }
}

/// Counts of fans by how they were laid flat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FanCounts {
    /// All fans of the mesh.
    pub total: u64,
    /// Laid flat by projection.
    pub projected: u64,
    /// Unfolded about their centres, or unrolled with others across creases.
    pub unfolded: u64,
    /// Fans that no direction sees wholly from the front.
    pub folding: u64,
}

/// How each fan is laid flat by itself.
pub(crate) fn shape_fans(surface: &Surface<'_>, watch: &Watch<'_>) -> Vec<FanShape> {
    let shape = |ring: &mut Ring, fan: usize| {
        if fan.is_multiple_of(1024) {
            watch.add(1024);
        }
        ring.gather(surface, fan);
        FanShape::of(ring, surface, fan)
    };
    (0..surface.fans.len()).into_par_iter().with_min_len(1024).map_init(Ring::default, shape).collect()
}

/// Tile extents for regions of a size in nominal texels.
fn extent(texels: Vec2, scale: f32) -> [u32; 2] {
    (texels * scale).to_array().map(side_texels)
}

/// A cover with all densities times a factor.
struct Sized {
    cover: Cover,
    /// Stored texels.
    texels: u64,
    scale: f32,
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

/// The cover that stores `texels`, within a percent and not more, as far as rounding allows. `sized` makes covers; what they store is
/// known nearly before, and better by what `counted` [finds](Cover::stored_texels_of_some) of some groups.
fn sized_to_total(
    laid: &[Laid],
    texels: u64,
    counted: impl Fn(Scales) -> Result<Option<(u64, usize)>>,
    sized: impl Fn(Scales) -> Result<Sized>,
) -> Result<Sized> {
    let mut scale = scale_to_total(laid, texels);
    if let Some((stored, step)) = counted(Scales::all(scale))? {
        let expected: u64 =
            laid.iter().step_by(step).map(|l| expected_texels(l.region.scaled(l.density), scale)).sum();
        let wanted = AIMED_SHARE * texels as f64 * expected as f64 / stored.max(1) as f64;
        scale = scale_to_total(laid, wanted as u64);
    }
    let mut best = sized(Scales::all(scale))?;
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
        let found = sized(Scales::all(scale))?;
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
        let found = sized(Scales { scale, raised: middle, raised_scale: high })?;
        counts[usize::from(found.texels > texels)] = middle;
        if found.texels <= texels && found.texels > best.texels {
            best = found;
        }
    }
    Ok(best)
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

/// A cover with the groups of corners, which are found if none are given.
fn assemble(
    surface: &Surface<'_>,
    grouping: &Grouping,
    mut corner_groups: Vec<[u32; 3]>,
    scales: Scales,
    (density, delta): (f32, f32),
) -> Result<Cover> {
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
            "a tile would need {needed} texels along one side, the limit is {MAX_EXTENT}: ask for a density that is {factor} times \
             lower, for as many fewer texels along each side, or cut the triangles (--longest-edge does so where the surface bends; large \
             flat ones are to be subdivided in the model)"
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
    Ok(Cover { delta, density, is_creased, hard_edges, is_paired_by_angle, corner_groups, groups, unfolded })
}

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

/// Texels of the smallest tile.
const MIN_TILE_TEXELS: u64 = 4 * 4;

/// The longest region in texels, rounded down a little, that gets a side of 4 texels.
const MAX_LENGTH_IN_MIN_TILE: f32 = 0.99999 * 3.0 / (1.0 - TOLERATED_LOSS);

/// Sides longer than this are multiples of 32.
const LONG_SIDE: f32 = MAX_BLOCK_SIDE as f32;

/// Texels along a side whose region is `length` texels long: the region plus half a texel of filter margin at both ends,
/// rounded to a multiple of 4. The tile map is then scaled so that the region fills the tile, whichever way the rounding
/// went, so no texel is left over; the density of the side follows by at most the tolerated loss or the gain.
pub(crate) fn side_texels(length: f32) -> u32 {
    let wanted = length + 1.0;
    if wanted > LONG_SIDE {
        // Three levels halve exactly, so that long tiles can be baked in pieces.
        return 32 * ((wanted / 32.0).round() as u32).min(MAX_EXTENT / 32);
    }
    let blocks = (wanted * 0.25) as u32;
    let down = (4 * blocks) as f32;
    let good = blocks >= 1 && down - 1.0 >= (1.0 - TOLERATED_LOSS) * length;
    let side = if good || down == wanted { 4 * blocks } else { 4 * blocks + 4 };
    side.clamp(4, MAX_EXTENT)
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
