//! Where every triangle lies in which picture.

use fantex_bake::Progress;
use fantex_base::{Aabb, Error, Result, counted};
use fantex_mesh::{Mesh, morton};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::charts::{Chart, NONE, charts, continued};
use crate::export::cancelled;
use crate::fullest::fullest;
use crate::layout_progress::LayoutProgress;
use crate::mask::Mask;
use crate::packing::{Masks, Orders, Place, are_few, has_strips, pack};
use crate::slots::Slots;

pub(crate) const NOBODY: u32 = u32::MAX;

/// Texture coordinates of all triangles and the pictures they refer to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layout {
    /// Texture coordinates of each triangle's corners, origin top left, v downwards.
    pub(crate) uv: Vec<[Vec2; 3]>,
    pub(crate) pages: Vec<Page>,
    /// Index into `pages` for every material; none where no triangle has it.
    pub(crate) page_of_material: Vec<Option<usize>>,
    /// Triangles that have no area in the picture: each shows one colour.
    pub(crate) points: usize,
    /// True where coordinates go beyond 0..1 and the pictures repeat.
    pub(crate) repeats: bool,
    /// Charts of an own packing; 0 for the model's coordinates.
    pub(crate) charts: usize,
    /// Texels that an own packing keeps around charts: no foreign texel is read down to the level at which a texel covers
    /// this many. 0 for the model's coordinates.
    pub(crate) padding: u32,
    pub(crate) texels_per_unit: f32,
}

/// One square picture (of every map).
#[derive(Clone, Debug, Default)]
pub(crate) struct Page {
    /// Columns and rows, a power of two.
    pub(crate) side: u32,
    pub(crate) placed: Vec<Placed>,
    /// Blocks are squares of this many texels.
    pub(crate) block: u32,
    /// The chart that each block belongs to or `NOBODY`, row-major; empty where texels belong to whoever is nearest.
    pub(crate) owners: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub(crate) triangle: u32,
    /// Which chart's blocks it may use; 0 where there are no owners.
    pub(crate) chart: u32,
    /// Corners in texels, texel centres at half integers.
    pub(crate) corners: [Vec2; 3],
    /// Of a neighbour of the chart, which continues the surface into the padding and is not seen itself: the triangle of the chart, as an
    /// index into those placed, across whose border it lies. Else `NOBODY`.
    pub(crate) continues: u32,
}

impl Placed {
    /// True for a neighbour of the chart.
    pub(crate) fn is_beyond(&self) -> bool {
        self.continues != NOBODY
    }
}

impl Page {
    /// The chart that a texel belongs to: `NOBODY` in unused blocks, 0 where there are no owners.
    pub(crate) fn owner(&self, x: u32, y: u32) -> u32 {
        if self.owners.is_empty() {
            return 0;
        }
        let blocks = self.side / self.block;
        self.owners[(y / self.block * blocks + x / self.block) as usize]
    }
}

// ---- The own packing: charts in a square picture, as dense as they fit.
//
// The picture is divided into blocks of `b x b` texels, `b` a power of two, and every block belongs to one chart at most. A
// chart gets all blocks within `b / 2` texels of its triangles, and all texels of its blocks are filled with its own colours.
// At the level at which a texel is the mean of a block, a bilinear look-up at a point of the chart reads the blocks whose
// centres are around the point; these hold the chart's colours alone, and so do those of all finer levels. Free blocks beside
// these are the chart's, too: coarser levels read its colours there, not those of unused texels.

#[derive(Clone, Copy, Debug)]
pub(crate) struct AtlasRequest {
    /// Texels per mesh unit of the asset.
    pub(crate) texels_per_unit: f32,
    /// Texels that the picture was asked to have, if it was.
    pub(crate) texels: Option<u64>,
    /// The side, if it is given.
    pub(crate) side: Option<u32>,
    /// The largest side that is taken by itself.
    pub(crate) largest_side: u32,
    /// The padding (a power of two), if it is given.
    pub(crate) padding: Option<u32>,
}

/// The side below which no picture is made by itself.
pub(crate) const MIN_CHOSEN_SIDE: u32 = 64;

/// Levels down to this many columns keep their charts apart, or those up to `MAX_PADDING`.
const MIN_LEVEL_SIDE: u32 = 128;

/// A larger side is taken rather than less padding.
const MIN_PADDING: u32 = 2;

/// Padding beyond this many texels is of no use to any filter.
const MAX_PADDING: u32 = 16;

/// A share of the wanted density that nobody misses.
const NEARLY: f32 = 0.95;

/// A picture has at most so many times the texels that it was asked to have, if the charts fit: needles would fill any picture with padding.
const MAX_TEXELS_PER_ASKED: f64 = 16.0;

/// Charts are packed in other orders at densities that follow each other in this ratio, while one of the orders fits; then, up to
/// [`MAX_FINE`] charts, in the finer one.
const STEPS: [f32; 2] = [1.01, 1.002];

/// More charts than this hardly fill a picture more by fine steps, and take long.
const MAX_FINE: usize = 64;

/// Such densities at most for each ratio.
const MAX_STEPS: usize = 20;

/// Each of the orders is changed so many times before a density is given up.
const CHANGES: usize = 11;

/// Blocks that take more than this share of a picture hardly find places in it.
const MAX_TAKEN_SHARE: f64 = 0.75;

/// Where blocks have more texels than this for each one of a chart, charts are needles, and consist of padding.
const MAX_TEXELS_PER_TEXEL: f64 = 8.0;

/// A share of a picture that charts fill well.
const FILLED_SHARE: f64 = 0.7;

/// Charts longer than so many sides of a picture that all of them fill well are cut across.
const MAX_LENGTH: f32 = 2.0;

/// Cuts the mesh into charts and packs them into a square picture.
///
/// # Errors
/// There are too many charts for the picture, or it was cancelled.
pub(crate) fn atlas(mesh: &Mesh, request: &AtlasRequest, progress: &dyn Progress) -> Result<Layout> {
    let step = LayoutProgress::new(mesh, request.texels_per_unit, progress);
    let across = continued(mesh);
    let (charts, packed) = packed_charts(mesh, &across, request, true, &step)?;
    let layout = laid_out(mesh, &charts, &across, &packed);
    step.reach(1.0);
    Ok(layout)
}

/// Texture coordinates alone, the number of charts, and the picture that they are shares of: a square, or the rectangle that holds the charts
/// best.
///
/// # Errors
/// There are too many charts for the picture, or it was cancelled.
pub(crate) fn coordinates(
    mesh: &Mesh,
    request: &AtlasRequest,
    is_square: bool,
    progress: &dyn Progress,
) -> Result<(Vec<[Vec2; 3]>, usize, Packed)> {
    let step = LayoutProgress::new(mesh, request.texels_per_unit, progress);
    let (charts, packed) = packed_charts(mesh, &continued(mesh), request, is_square, &step)?;
    let mut uv = vec![[Vec2::ZERO; 3]; mesh.triangles.len()];
    let size = Vec2::from(packed.size().map(|n| n as f32));
    for (i, chart) in charts.iter().enumerate() {
        for (triangle, corners) in chart.iter() {
            uv[triangle as usize] = in_picture(corners, i, &packed).map(|c| c / size);
        }
    }
    step.reach(1.0);
    Ok((uv, charts.len(), packed))
}

fn packed_charts(
    mesh: &Mesh,
    across: &[u32],
    request: &AtlasRequest,
    is_square: bool,
    step: &LayoutProgress<'_>,
) -> Result<(Vec<Chart>, Packed)> {
    let charts = charts(mesh, across, request.texels_per_unit, step);
    let mut charts = cut_across(charts, request);
    if is_square && let [chart] = &mut charts[..] {
        chart.turn_into_square();
    }
    if has_strips(charts.len()) {
        // Among masks of one size, those of neighbours come together.
        charts.sort_by_cached_key(|chart| morton(middle(mesh, chart)));
    }
    let slots = Slots::new(mesh.triangles.len());
    charts.par_iter_mut().for_each(|chart| chart.find_border(across, &slots));
    step.reach(LayoutProgress::CUT);
    let progress = step.progress();
    if progress.is_cancelled() {
        return Err(cancelled());
    }
    let packed = match request.side {
        Some(side) if !is_square => fullest(&charts, side, request, progress),
        Some(side) => densest(&charts, side, request, progress),
        None => smallest(&charts, request, progress),
    };
    if progress.is_cancelled() {
        return Err(cancelled());
    }
    let packed = packed.ok_or_else(|| {
        let (pieces, side) = (counted(charts.len(), "piece"), request.side.unwrap_or(request.largest_side));
        Error::too_large(format!(
            "the surface in {pieces} does not fit a picture of {side} x {side} texels; give a larger --size or a smaller \
             --padding"
        ))
    })?;
    Ok((charts, packed))
}

/// Charts in a picture.
pub(crate) struct Packed {
    /// Columns and rows of blocks.
    pub(crate) blocks: [u32; 2],
    /// Texels along each side of a block.
    pub(crate) block: u32,
    /// Texels per mesh unit.
    pub(crate) density: f32,
    pub(crate) places: Vec<Place>,
    /// As they lie in the picture.
    pub(crate) masks: Vec<Mask>,
}

impl Packed {
    /// Columns and rows of texels.
    pub(crate) fn size(&self) -> [u32; 2] {
        self.blocks.map(|blocks| blocks * self.block)
    }
}

/// The padding for charts: what the levels ask for, less where charts would consist of padding mostly.
pub(crate) fn padding(charts: &[Chart], side: u32, request: &AtlasRequest) -> u32 {
    if let Some(padding) = request.padding {
        return padding.min(side / 4).max(1);
    }
    let (texels, density) = (f64::from(side).powi(2), request.texels_per_unit);
    let mut padding = (side / MIN_LEVEL_SIDE).clamp(2, MAX_PADDING).min(side / 4);
    while padding > 1 && charts.len() as f64 * f64::from(3 * padding).powi(2) > 0.25 * texels {
        padding /= 2;
    }
    // Needles have it along their whole length. A larger side, with more of it, has no more room for them.
    let own = charts.iter().map(flat_area).sum::<f64>() * f64::from(density).powi(2);
    let is_too_much = |padding: u32| {
        let taken: f64 = charts.iter().map(|chart| taken_texels(chart, padding, density)).sum();
        taken > MAX_TAKEN_SHARE * texels && taken > MAX_TEXELS_PER_TEXEL * own
    };
    while padding > MIN_PADDING && is_too_much(padding) {
        padding /= 2;
    }
    padding.max(1)
}

/// Charts so long that they alone would dictate the side of the picture are cut across.
fn cut_across(charts: Vec<Chart>, request: &AtlasRequest) -> Vec<Chart> {
    let longest = fitting_length(&charts, request);
    let pieces = |chart: Chart| match chart.extent.max_element() > MAX_LENGTH * longest {
        true => chart.cut_across(longest),
        false => vec![chart],
    };
    charts.into_iter().flat_map(pieces).collect()
}

/// The side of a square that charts and the padding along them fill well, mesh units.
fn fitting_length(charts: &[Chart], request: &AtlasRequest) -> f32 {
    let area = charts.iter().map(flat_area).sum::<f64>();
    let length: f64 = charts.iter().map(|chart| f64::from(chart.extent.max_element())).sum();
    let side = f64::from(request.side.unwrap_or(request.largest_side));
    let fills = side * (FILLED_SHARE / area.max(f64::MIN_POSITIVE)).sqrt();
    let density = match request.side {
        Some(_) => fills,
        None => fills.min(f64::from(request.texels_per_unit)),
    };
    let padding = f64::from(request.padding.unwrap_or(MIN_PADDING)) / density;
    let filled = ((area + padding * length) / FILLED_SHARE).sqrt();
    filled.max(f64::from(MIN_CHOSEN_SIDE) / density) as f32
}

/// Texels of the blocks that a chart's rectangle takes.
fn taken_texels(chart: &Chart, block: u32, density: f32) -> f64 {
    let blocks = (chart.extent * (density / block as f32) + 1.0).ceil().as_dvec2();
    blocks.element_product() * f64::from(block).powi(2)
}

/// The charts in the smallest picture in which they have nearly the wanted density, or in the largest; none where they do not fit.
fn smallest(charts: &[Chart], request: &AtlasRequest, progress: &dyn Progress) -> Option<Packed> {
    // What the surface is to have.
    let wanted = charts.iter().map(flat_area).sum::<f64>() * f64::from(request.texels_per_unit).powi(2);
    let least = wanted.sqrt() * f64::from(NEARLY);
    let least = least.min(f64::from(request.largest_side)) as u32;
    let mut side = least.max(MIN_CHOSEN_SIDE).next_power_of_two().min(request.largest_side);
    // A side that leaves less padding is not taken, unless no larger one may be.
    while side < request.largest_side
        && request.padding.is_none()
        && padding(charts, side, request) < MIN_PADDING
    {
        side *= 2;
    }
    loop {
        let packed = densest(charts, side, request, progress);
        let is_good = |p: &Packed| p.density >= NEARLY * request.texels_per_unit;
        let is_last = side >= request.largest_side || progress.is_cancelled();
        let next = 4.0 * f64::from(side).powi(2);
        let is_enough = request.texels.is_some_and(|texels| next > MAX_TEXELS_PER_ASKED * texels as f64);
        if is_last || packed.is_some() && is_enough || packed.as_ref().is_some_and(is_good) {
            return packed;
        }
        side *= 2;
    }
}

/// The largest density at which the charts fit a side: to half a percent by size, to one percent in other orders where they are few. Any or
/// none once it is cancelled.
pub(crate) fn densest(
    charts: &[Chart],
    side: u32,
    request: &AtlasRequest,
    progress: &dyn Progress,
) -> Option<Packed> {
    let block = padding(charts, side, request);
    let masks_at = |density: f32| masks(charts, side / block, density / block as f32, progress);
    let packed = |density: f32, masks: Masks, places: Vec<Place>| {
        let masks = masks.placed(&places);
        Packed { blocks: [side / block; 2], block, density, places, masks }
    };
    let at = |density: f32| {
        let masks = masks_at(density)?;
        let places = pack(&masks, &mut Orders::by_size(&masks), 0, progress)?;
        Some(packed(density, masks, places))
    };
    let longest = charts.iter().map(|c| c.extent.max_element()).fold(f32::MIN_POSITIVE, f32::max);
    // The longest chart fills the side, or all of them fill the picture; nothing larger can fit.
    let area: f64 = charts.iter().map(flat_area).sum();
    let filled = f64::from(side) / area.max(f64::MIN_POSITIVE).sqrt();
    let mut high = ((side - block) as f32 / longest).min(filled as f32);
    // Nothing is in the way of a single one. Rounding is.
    if charts.len() == 1
        && let Some(packed) = at(high * (1.0 - 1e-6))
    {
        return Some(packed);
    }
    let mut best = None;
    let mut low = high;
    for _ in 0..40 {
        low *= 0.75;
        best = at(low);
        if best.is_some() {
            break;
        }
        high = low;
    }
    best.as_ref()?;
    for _ in 0..6 {
        let middle = (low * high).sqrt();
        match at(middle) {
            Some(packed) => (low, best) = (middle, Some(packed)),
            None => high = middle,
        }
    }
    // Other orders than by size are denser yet.
    let mut orders = None;
    let steps = if are_few(charts.len(), [side / block; 2]) { MAX_STEPS } else { 0 };
    let ratios = if charts.len() <= MAX_FINE { &STEPS[..] } else { &STEPS[..1] };
    for step in ratios {
        for _ in 0..steps {
            let density = low * step;
            let Some(masks) = masks_at(density) else { break };
            let orders = orders.get_or_insert_with(|| Orders::by_size(&masks));
            let Some(places) = pack(&masks, orders, CHANGES, progress) else { break };
            (low, best) = (density, Some(packed(density, masks, places)));
        }
    }
    best
}

/// The middle of the box around a chart's triangles in space.
fn middle(mesh: &Mesh, chart: &Chart) -> Vec3 {
    let positions = chart.triangles.iter().flat_map(|&triangle| mesh.triangle_positions(triangle as usize));
    Aabb::of_points(positions).center()
}

/// The area of a chart's triangles in their plane, square mesh units.
pub(crate) fn flat_area(chart: &Chart) -> f64 {
    chart.corners.iter().map(|[a, b, c]| 0.5 * f64::from((*b - *a).perp_dot(*c - *a).abs())).sum()
}

/// The blocks of charts, so many to a mesh unit, for a square of so many a side; none where one is larger, or once it is cancelled.
fn masks(charts: &[Chart], side: u32, blocks_per_unit: f32, progress: &dyn Progress) -> Option<Masks> {
    Some(Masks::new(each_mask(charts, side, blocks_per_unit, progress)?, [side; 2]))
}

/// The blocks of each chart; none where one is longer than so many, or once it is cancelled.
pub(crate) fn each_mask(
    charts: &[Chart],
    longest: u32,
    blocks_per_unit: f32,
    progress: &dyn Progress,
) -> Option<Vec<Mask>> {
    let mask_of = |chart: &Chart| {
        let extent = (chart.extent * blocks_per_unit + 1.0).ceil().max(Vec2::ONE).as_uvec2();
        let fits = extent.max_element() <= longest && !progress.is_cancelled();
        let place = |q: Vec2| q * blocks_per_unit + 0.5;
        let mask = || match chart.border.is_empty() {
            true => Mask::around(extent.x, extent.y, chart.corners.iter().map(|corners| corners.map(place))),
            false => Mask::within(extent.x, extent.y, chart.border.iter().map(|ends| ends.map(place))),
        };
        fits.then(mask)
    };
    charts.par_iter().map(mask_of).collect()
}

/// Places in a chart's rectangle as they are in the picture: half a block away from the chart's own blocks' corner.
fn in_picture(corners: [Vec2; 3], index: usize, packed: &Packed) -> [Vec2; 3] {
    let (block, place, mask) = (packed.block as f32, packed.places[index], &packed.masks[index]);
    let [width, height] = [mask.width, mask.height].map(|blocks| blocks as f32 * block);
    let origin = Vec2::from(place.at.map(|n| n as f32)) * block;
    corners.map(|q| {
        let Vec2 { x, y } = q * packed.density + 0.5 * block;
        origin
            + match place.turn {
                0 => Vec2::new(x, y),
                1 => Vec2::new(width - y, x),
                2 => Vec2::new(width - x, height - y),
                _ => Vec2::new(y, height - x),
            }
    })
}

fn laid_out(mesh: &Mesh, charts: &[Chart], across: &[u32], packed: &Packed) -> Layout {
    let (side, [columns, rows]) = (packed.size()[0], packed.blocks);
    let mut owners = vec![NOBODY; columns as usize * rows as usize];
    for (i, (mask, place)) in (0u32..).zip(packed.masks.iter().zip(&packed.places)) {
        let [left, top] = place.at;
        mask.blocks().for_each(|[x, y]| owners[((top + y) * columns + left + x) as usize] = i);
    }
    grow(&mut owners, columns as usize);
    let mut uv = vec![[Vec2::ZERO; 3]; mesh.triangles.len()];
    let mut chart_of = vec![NOBODY; mesh.triangles.len()];
    let mut placed = Vec::with_capacity(mesh.triangles.len());
    let mut starts = Vec::with_capacity(charts.len());
    for (i, chart) in (0u32..).zip(charts) {
        starts.push(placed.len() as u32);
        for (triangle, corners) in chart.iter() {
            let corners = in_picture(corners, i as usize, packed);
            uv[triangle as usize] = corners.map(|c| c / side as f32);
            chart_of[triangle as usize] = i;
            placed.push(Placed { triangle, chart: i, corners, continues: NOBODY });
        }
    }
    let beyond = charts.par_iter().enumerate().flat_map_iter(|(i, chart)| {
        let start = starts[i];
        let beyond = neighbours(mesh, chart, i as u32, &chart_of, across);
        beyond.into_iter().map(move |Neighbour { triangle, corners, member }| Placed {
            triangle,
            chart: i as u32,
            corners: in_picture(corners, i, packed),
            continues: start + member,
        })
    });
    placed.extend(beyond.collect::<Vec<_>>());
    let page = Page { side, placed, block: packed.block, owners };
    Layout {
        pages: vec![page],
        page_of_material: vec![Some(0); mesh.materials.len()],
        points: uv.iter().filter(|[a, b, c]| (*b - *a).perp_dot(*c - *a) == 0.0).count(),
        uv,
        repeats: false,
        charts: charts.len(),
        padding: packed.block,
        texels_per_unit: packed.density,
    }
}

/// Gives each free block to the owner of one beside it, in a square of so many columns.
fn grow(owners: &mut [u32], columns: usize) {
    // As they were.
    let (mut above, mut row) = (vec![NOBODY; columns], Vec::new());
    for first in (0..owners.len()).step_by(columns) {
        row.clear();
        row.extend_from_slice(&owners[first..first + columns]);
        let (here, below) = owners[first..].split_at_mut(columns);
        let below = below.get(..columns).unwrap_or(&[]);
        for (x, owner) in here.iter_mut().enumerate().filter(|(_, owner)| **owner == NOBODY) {
            let [left, right] = [x.wrapping_sub(1), x + 1];
            let sides = [(&above[..], x), (&row, left), (&row, right), (below, x)];
            let corners = [(&above[..], left), (&above, right), (below, left), (below, right)];
            let mut around = sides.into_iter().chain(corners).filter_map(|(row, x)| row.get(x).copied());
            *owner = around.find(|&other| other != NOBODY).unwrap_or(NOBODY);
        }
        std::mem::swap(&mut above, &mut row);
    }
}

/// A triangle beside a chart.
struct Neighbour {
    triangle: u32,
    /// Folded into the chart's plane.
    corners: [Vec2; 3],
    /// The chart's triangle, as an index into its own, across whose edge it lies.
    member: u32,
}

/// Triangles of other charts that touch a chart, and where they lie beside it when they are folded into its plane: those across its
/// border, and those across an edge of these that ends at the chart.
fn neighbours(mesh: &Mesh, chart: &Chart, index: u32, chart_of: &[u32], across: &[u32]) -> Vec<Neighbour> {
    let is_outside = |half_edge: u32| half_edge != NONE && chart_of[half_edge as usize / 3] != index;
    let mut beyond = Vec::new();
    for (member, (triangle, corners)) in (0..).zip(chart.iter()) {
        for k in (0..3).filter(|k| is_outside(across[3 * triangle as usize + k])) {
            let half_edge = across[3 * triangle as usize + k];
            let first = folded(mesh, half_edge, [corners[(k + 1) % 3], corners[k]]);
            beyond.push(Neighbour { triangle: half_edge / 3, corners: first, member });
            for step in [1, 2] {
                let from = (half_edge as usize % 3 + step) % 3;
                let next = across[half_edge as usize / 3 * 3 + from];
                if is_outside(next) {
                    let corners = folded(mesh, next, [first[(from + 1) % 3], first[from]]);
                    beyond.push(Neighbour { triangle: next / 3, corners, member });
                }
            }
        }
    }
    beyond
}

/// Where the corners of a half-edge's triangle lie when its ends lie at `begin` and `end` and it is laid to the side of the half-edge on which
/// charts have it.
fn folded(mesh: &Mesh, half_edge: u32, [begin, end]: [Vec2; 2]) -> [Vec2; 3] {
    let positions = mesh.triangle_positions(half_edge as usize / 3);
    let at = |k: usize| (half_edge as usize % 3 + k) % 3;
    let [a, b, c] = [0, 1, 2].map(|k| positions[at(k)]);
    let along = b - a;
    let share = (c - a).dot(along) / along.length_squared();
    let height = (c - a - share * along).length() / along.length();
    let mut corners = [begin; 3];
    corners[at(1)] = end;
    // v points downwards.
    corners[at(2)] = begin + share * (end - begin) - height * (end - begin).perp();
    corners
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;
    use std::sync::atomic::Ordering::Relaxed;

    use fantex_base::Random;

    use super::*;

    /// Counts how often it is asked whether to stop: once per chart and density.
    #[derive(Default)]
    struct Asked(AtomicUsize);

    impl Progress for Asked {
        fn report(&self, _done: u64, _total: u64) {}

        fn is_cancelled(&self) -> bool {
            self.0.fetch_add(1, Relaxed);
            false
        }
    }

    /// Thousands of loose triangles are packed in few tries: densities at which they could not fill the picture even without
    /// borders are not tried. (One chart's blocks at such a density are as many as the whole picture's.)
    #[test]
    fn many_small_charts_are_packed_quickly() {
        let mut mesh = Mesh::default();
        let count = 4_000;
        for i in 0..count {
            let at = Vec3::new(3.0 * i as f32, 0.0, 0.0);
            mesh.positions.extend([at, at + Vec3::X, at + Vec3::Y]);
            mesh.triangles.push([0, 1, 2].map(|k| 3 * i + k));
        }
        let charts: Vec<Chart> = (0..count).map(|t| Chart::projected(&mesh, vec![t], Vec3::Z)).collect();
        let request = AtlasRequest {
            texels_per_unit: 10.0,
            texels: None,
            side: None,
            largest_side: 1024,
            padding: None,
        };
        let asked = Asked::default();
        let packed = densest(&charts, 1024, &request, &asked).unwrap();
        assert!(packed.density > 10.0, "{}", packed.density);
        let tries = asked.0.into_inner() as f32 / count as f32;
        assert!(tries <= 12.0, "{tries} densities were tried");
    }

    /// Levels of the picture mix the colours of pieces from one place, in whatever order the model has them.
    #[test]
    fn many_small_charts_lie_beside_their_neighbours() {
        let mut random = Random::new(4);
        let mut places: Vec<Vec2> =
            (0..64 * 64).map(|i| Vec2::new((i % 64) as f32, (i / 64) as f32)).collect();
        (1..places.len()).rev().for_each(|i| places.swap(i, random.below(1 + i as u64) as usize));
        let mut mesh = Mesh::default();
        for (i, place) in (0..).zip(&places) {
            let at = (0.03 * (*place - 32.0)).extend(0.0);
            mesh.positions.extend([at, at + 0.02 * Vec3::X, at + 0.02 * Vec3::Y]);
            mesh.triangles.push([0, 1, 2].map(|k| 3 * i + k));
        }
        let request = AtlasRequest {
            texels_per_unit: 500.0,
            texels: None,
            side: Some(1024),
            largest_side: 1024,
            padding: None,
        };
        let layout = atlas(&mesh, &request, &Asked::default()).unwrap();
        let mut squares = std::collections::BTreeMap::<[u32; 2], Vec<Vec2>>::new();
        for (uv, place) in layout.uv.iter().zip(&places) {
            squares.entry((uv[0] * 16.0).as_uvec2().to_array()).or_default().push(*place);
        }
        let variance = |members: &Vec<Vec2>| {
            let (count, middle) = (members.len() as f32, members.iter().sum::<Vec2>() / members.len() as f32);
            members.iter().map(|place| place.distance_squared(middle)).sum::<f32>() / count
        };
        let is_close = |members: &&Vec<Vec2>| variance(members) < 0.05 * variance(&places);
        let close = squares.values().filter(is_close).count();
        // Not the largest ones, of which there are up to a thousand.
        assert!(3 * close > squares.len(), "{close} of {}", squares.len());
    }

    #[test]
    fn free_blocks_go_to_who_is_beside_them() {
        const N: u32 = NOBODY;
        let mut owners =
            [[N, N, N, N, N], [7, N, N, N, N], [N, N, N, N, N], [N, N, N, N, 3], [N, N, N, N, N]];
        grow(owners.as_flattened_mut(), 5);
        let expected = [[7, 7, N, N, N], [7, 7, N, N, N], [7, 7, N, 3, 3], [N, N, N, 3, 3], [N, N, N, 3, 3]];
        assert_eq!(owners, expected);
    }

    /// Needles take padding along their whole length: it does not grow with the picture, which would be nearly empty.
    #[test]
    fn thousands_of_needles_take_a_picture_of_moderate_size() {
        let mut mesh = Mesh::default();
        let count = 4_000;
        for i in 0..count {
            let at = Vec3::new(3.0 * i as f32, 0.0, 0.0);
            mesh.positions.extend([at, at + Vec3::X, at + 1e-4 * Vec3::Y]);
            mesh.triangles.push([0, 1, 2].map(|k| 3 * i + k));
        }
        let charts: Vec<Chart> = (0..count).map(|t| Chart::projected(&mesh, vec![t], Vec3::Z)).collect();
        let request = AtlasRequest {
            texels_per_unit: 150.0,
            texels: None,
            side: None,
            largest_side: 8192,
            padding: None,
        };
        let packed = smallest(&charts, &request, &Asked::default()).unwrap();
        assert_eq!((packed.size(), packed.block), ([2048; 2], 2));
        assert!(packed.density >= NEARLY * 150.0, "{}", packed.density);
        // Squares of as many texels keep theirs.
        let square = |i: u32| {
            let at = Vec3::new(3.0 * i as f32, 0.0, 0.0);
            [at, at + Vec3::X, at + Vec3::Y]
        };
        let mut mesh = Mesh { positions: (0..100).flat_map(square).collect(), ..Mesh::default() };
        mesh.triangles.extend((0..100).map(|i| [0, 1, 2].map(|k| 3 * i + k)));
        let charts: Vec<Chart> = (0..100).map(|t| Chart::projected(&mesh, vec![t], Vec3::Z)).collect();
        assert_eq!(padding(&charts, 2048, &request), 16);
    }

    /// A long strip beside a disc is cut across: the picture has no more texels than the two need.
    #[test]
    fn one_long_piece_does_not_dictate_the_side() {
        let mut mesh = Mesh::default();
        let columns = 600;
        for i in 0..=columns {
            let x = 2.0 * i as f32 / columns as f32 - 1.0;
            mesh.positions.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1e-3, 0.0)]);
        }
        mesh.triangles
            .extend((0..columns).map(|i| 2 * i).flat_map(|i| [[i, i + 2, i + 3], [i, i + 3, i + 1]]));
        let first = mesh.positions.len() as u32;
        mesh.positions.push(Vec3::new(0.0, -0.5, 0.0));
        let rim = |i: u32| Vec2::from_angle(i as f32 / 60.0 * std::f32::consts::TAU).extend(0.0);
        mesh.positions.extend((0..60).map(|i| Vec3::new(0.0, -0.5, 0.0) + 0.1 * rim(i)));
        mesh.triangles.extend((0..60).map(|i| [first, first + 1 + i, first + 1 + (i + 1) % 60]));
        let request = AtlasRequest {
            texels_per_unit: 1000.0,
            texels: None,
            side: None,
            largest_side: 8192,
            padding: None,
        };
        let layout = atlas(&mesh, &request, &Asked::default()).unwrap();
        assert!(layout.pages[0].side <= 512, "{}", layout.pages[0].side);
        assert!(layout.texels_per_unit >= NEARLY * 1000.0 && layout.charts > 4, "{}", layout.charts);
        // A given side holds more of it.
        let layout = atlas(&mesh, &AtlasRequest { side: Some(256), ..request }, &Asked::default()).unwrap();
        assert!(layout.texels_per_unit > 256.0, "{}", layout.texels_per_unit);
        // The two triangles of a square are as long as it is.
        let charts = [vec![0, 1, 2, 3], vec![0]].map(|triangles| Chart::projected(&mesh, triangles, Vec3::Z));
        let counts = charts.map(|chart| chart.cut_across(1e-9).len());
        assert!(counts[0] > 1 && counts[1] == 1, "{counts:?}");
    }

    /// Half of a disc of many narrow triangles: the other half touches it at the centre, but two triangles continue it.
    #[test]
    fn of_the_many_triangles_around_a_vertex_those_beside_the_chart_continue_it() {
        let count = 20_000;
        let rim = |i: u32| Vec2::from_angle(i as f32 / count as f32 * std::f32::consts::TAU).extend(0.0);
        let mut mesh = Mesh { positions: vec![Vec3::ZERO], ..Mesh::default() };
        mesh.positions.extend((0..count).map(rim));
        mesh.triangles.extend((0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]));
        let chart = Chart::projected(&mesh, (0..count / 2).collect(), Vec3::Z);
        let chart_of: Vec<u32> = (0..count).map(|i| u32::from(i >= count / 2)).collect();
        let beyond = neighbours(&mesh, &chart, 0, &chart_of, &continued(&mesh));
        let mut triangles: Vec<u32> = beyond.iter().map(|neighbour| neighbour.triangle).collect();
        triangles.sort_unstable();
        assert_eq!(triangles, [count / 2, count / 2 + 1, count - 2, count - 1]);
        // The disc is flat: they lie around its centre, where the chart has none.
        let centre = chart.corners[0][0];
        for Neighbour { triangle: t, corners: [at, first, second], member } in beyond {
            assert!(member == 0 || member == count / 2 - 1, "{member}");
            assert!(
                at.distance(centre) < 1e-3 && (first.distance(centre) - 1.0).abs() < 1e-3,
                "{t}: {at}, {first}"
            );
            let others = chart.corners.iter().map(|corners| corners[1].midpoint(corners[2]));
            let nearest = others.map(|p| p.distance(first.midpoint(second))).fold(f32::INFINITY, f32::min);
            assert!(nearest > 0.5 * first.distance(second), "{t} lies over the chart");
        }
    }

    #[test]
    fn turned_pieces_lie_where_their_blocks_are() {
        let positions = vec![Vec3::ZERO, Vec3::new(0.9, 0.0, 0.0), Vec3::new(0.0, 0.3, 0.0)];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let chart = Chart::projected(&mesh, vec![0], Vec3::Z);
        let (block, density) = (4, 60.0);
        let extent = (chart.extent * density / 4.0 + 1.0).ceil().as_uvec2();
        let corners = chart.corners[0].map(|q| q * density / 4.0 + 0.5);
        let mask = Mask::around(extent.x, extent.y, std::iter::once(corners));
        for turn in 0..4 {
            let places = vec![Place { at: [3, 5], turn }];
            let packed =
                Packed { blocks: [128 / block; 2], block, density, places, masks: vec![mask.turned(turn)] };
            let corners = in_picture(chart.corners[0], 0, &packed);
            let [a, b, c] = corners;
            // Neither mirrored nor scaled.
            assert!(((b - a).perp_dot(c - a).abs() - 0.27 * density * density).abs() < 0.1);
            for k in 0..=30 {
                let p = a.lerp(b, k as f32 / 30.0).lerp(c, 0.3) / block as f32;
                let cell = p.floor().as_uvec2();
                assert!(packed.masks[0].contains(cell.x - 3, cell.y - 5), "turn {turn}: {p}");
            }
        }
    }
}
