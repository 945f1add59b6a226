//! Charts packed into a picture of any shape: the one that they fill most.
//!
//! Few charts leave much of a square empty: six equal squares take two thirds of one, but all of a rectangle of three by two. So pictures of
//! many widths are filled from above, in coarse blocks first, and the smallest box around the charts is kept.

use fantex_bake::Progress;
use rayon::prelude::*;

use crate::charts::Chart;
use crate::layout::{AtlasRequest, Packed, densest, each_mask, flat_area, padding};
use crate::packing::{Boxed, Masks, Orders, pack_tightly};

/// More charts than this fill a square as well as any other picture.
const MAX_SHAPED: usize = 64;

/// Of boxes that are as large, that is taken whose sides are in the smaller ratio: one in twice the ratio is to be smaller by this share.
const SLENDER: f64 = 0.03;

/// A chart is at most so many times as long as the square that the picture has the texels of.
const MAX_LENGTH: f64 = 4.0;

/// Side of that square in coarse blocks, at most.
const COARSE_SIDE: u32 = 192;

/// The share of it that charts take when shapes are tried.
const COARSE_SHARE: f64 = 0.6;

/// Widths that are tried follow each other in this ratio,
const WIDTH_RATIO: f64 = 1.08;

/// so many of them narrower, and wider, than a square that the blocks of charts fill by [`FILLED_SHARE`].
const WIDTHS: i32 = 9;
const FILLED_SHARE: f64 = 0.75;

/// Widths, the best ones, that are tried in the blocks of the picture, too.
const FINE_WIDTHS: usize = 2;

/// Each order of charts is changed so many times, in coarse blocks and in those of the picture.
const COARSE_CHANGES: usize = 6;
const FINE_CHANGES: usize = 12;

/// Densities that are tried in the blocks of the picture, until they differ by less than this ratio.
const MAX_DENSITIES: usize = 10;
const DENSITY_RATIO: f64 = 1.0005;

/// The charts in a picture of any shape with at most as many texels as a square of this side, or in that square where they are many; none where
/// they do not fit. Any or none once it is cancelled.
pub(crate) fn fullest(
    charts: &[Chart],
    side: u32,
    request: &AtlasRequest,
    progress: &dyn Progress,
) -> Option<Packed> {
    let square = densest(charts, side, request, progress);
    let block = padding(charts, side, request);
    if charts.len() > MAX_SHAPED {
        return square;
    }
    let shapes = shapes(charts, (side / block).min(COARSE_SIDE), progress);
    let fitted =
        shapes.into_iter().take(FINE_WIDTHS).filter_map(|shape| fit(charts, side / block, shape, progress));
    let packed = fitted.map(|Fitted { masks, density, boxed }| Packed {
        blocks: boxed.size,
        block,
        density: (density * f64::from(block)) as f32,
        masks: masks.placed(&boxed.places),
        places: boxed.places,
    });
    packed.chain(square).max_by(|a, b| a.density.total_cmp(&b.density))
}

/// What the charts fill in coarse blocks.
struct Shape {
    /// Columns, mesh units.
    width: f64,
    /// The share of it that is theirs.
    used: f64,
    order: Vec<usize>,
}

/// Boxes of several widths, those that charts fill most first.
fn shapes(charts: &[Chart], side: u32, progress: &dyn Progress) -> Vec<Shape> {
    let density = density(charts, side, COARSE_SHARE);
    let Some(masks) = masks_of(charts, side, density, progress) else { return Vec::new() };
    let square = (masks.count() as f64 / FILLED_SHARE).sqrt();
    let mut widths: Vec<u32> =
        (-WIDTHS..=WIDTHS).map(|i| (square * WIDTH_RATIO.powi(i)).round().max(1.0) as u32).collect();
    // Those of the largest chart.
    widths.extend(masks.largest());
    widths.sort_unstable();
    widths.dedup();
    let pack = |&columns: &u32| {
        let size = [columns, most_rows(&masks, columns)];
        pack_tightly(&masks, size, Orders::by_size(&masks), COARSE_CHANGES, progress)
    };
    let mut boxes: Vec<Boxed> = widths.par_iter().filter_map(pack).collect();
    let cost = |boxed: &Boxed| {
        let [columns, rows] = boxed.size.map(f64::from);
        columns * rows * (1.0 + SLENDER * (columns / rows).log2().abs())
    };
    boxes.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
    boxes.dedup_by_key(|boxed| boxed.size);
    let area = area_of(charts) * density.powi(2);
    let shape = |boxed: Boxed| Shape {
        width: f64::from(boxed.size[0]) / density,
        used: area / boxed.area() as f64,
        order: boxed.order,
    };
    boxes.into_iter().map(shape).collect()
}

/// Rows in which so many columns surely hold the masks, if any.
fn most_rows(masks: &Masks, columns: u32) -> u32 {
    let [width, height] = masks.largest();
    (8 * masks.count() / u64::from(columns)).min(u32::MAX.into()) as u32 + width.max(height)
}

/// Charts as they lie in a picture.
struct Fitted {
    masks: Masks,
    /// Blocks per mesh unit.
    density: f64,
    boxed: Boxed,
}

/// The charts in a picture of about that width, which grows with their density, as dense as they are in the blocks of a square of this side.
fn fit(charts: &[Chart], side: u32, shape: Shape, progress: &dyn Progress) -> Option<Fitted> {
    let blocks = u64::from(side).pow(2);
    let mut density = density(charts, side, shape.used);
    let (mut width, mut order) = (shape.width, shape.order);
    let (mut best, mut too_dense): (Option<Fitted>, f64) = (None, f64::INFINITY);
    for number in 0..MAX_DENSITIES {
        // The longest chart ends it, too.
        let Some(masks) = masks_of(charts, side, density, progress) else { break };
        // Charts end within blocks.
        let columns = (width * density).ceil() as u32 + 2;
        let (orders, changes) = match number {
            0 => (Orders::by_size(&masks).and(order.clone()), FINE_CHANGES),
            _ => (Orders::only(order.clone()), 0),
        };
        let size = [columns, most_rows(&masks, columns)];
        let Some(boxed) = pack_tightly(&masks, size, orders, changes, progress) else { break };
        let ratio = (blocks as f64 / boxed.area() as f64).sqrt();
        if boxed.area() <= blocks {
            (width, order) = (f64::from(boxed.size[0]) / density, boxed.order.clone());
            best = Some(Fitted { masks, density, boxed });
        } else {
            too_dense = density;
        }
        let sparse = best.as_ref().map_or(0.0, |best| best.density);
        if too_dense < sparse * DENSITY_RATIO || best.is_some() && (1.0..DENSITY_RATIO).contains(&ratio) {
            break;
        }
        density *= ratio;
        if density <= sparse || density >= too_dense {
            density = (sparse * too_dense).sqrt();
        }
    }
    best
}

fn area_of(charts: &[Chart]) -> f64 {
    charts.iter().map(flat_area).sum::<f64>().max(f64::MIN_POSITIVE)
}

/// Blocks per mesh unit at which charts take this share of a square, or less where one is too long.
fn density(charts: &[Chart], side: u32, share: f64) -> f64 {
    let longest = charts.iter().map(|chart| chart.extent.max_element()).fold(f32::MIN_POSITIVE, f32::max);
    let longest = MAX_LENGTH * f64::from(side) / f64::from(longest);
    (f64::from(side) * (share / area_of(charts)).sqrt()).min(longest)
}

fn masks_of(charts: &[Chart], side: u32, density: f64, progress: &dyn Progress) -> Option<Masks> {
    let longest = (MAX_LENGTH * f64::from(side)).ceil() as u32 + 2;
    each_mask(charts, longest, density as f32, progress).map(Masks::few)
}
