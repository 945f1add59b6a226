//! The own packing: charts in a square picture, as dense as they fit.
//!
//! The picture is divided into blocks of `b x b` texels, `b` a power of two, and every block belongs to one chart at most. A
//! chart gets all blocks within `b / 2` texels of its triangles, and all texels of its blocks are filled with its own colours.
//! At the level at which a texel is the mean of a block, a bilinear look-up at a point of the chart reads the blocks whose
//! centres are around the point; these hold the chart's colours alone, and so do those of all finer levels.

use fantex_bake::Progress;
use fantex_mesh::{Mesh, VertexCorners};
use glam::Vec2;
use rayon::prelude::*;

use super::mask::Mask;
use super::pack::pack;
use super::{Layout, NOBODY, Page, Placed};
use crate::charts::{Chart, charts};
use crate::error::ExportError;

/// What the packing is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AtlasRequest {
    /// Texels per mesh unit of the asset.
    pub(crate) texels_per_unit: f32,
    /// The side, if it is given.
    pub(crate) side: Option<u32>,
    /// The largest side that is taken by itself.
    pub(crate) largest_side: u32,
    /// The padding (a power of two), if it is given.
    pub(crate) padding: Option<u32>,
}

/// The side below which no picture is made by itself.
const SMALLEST_SIDE: u32 = 64;

/// Levels down to this many columns keep their charts apart, or those up to `MOST_PADDING`.
const LEAST_LEVEL_SIDE: u32 = 128;

/// A larger side is taken rather than less padding.
const LEAST_PADDING: u32 = 2;

/// Padding beyond this many texels is of no use to any filter.
const MOST_PADDING: u32 = 16;

/// A share of the wanted density that nobody misses.
const NEARLY: f32 = 0.95;

/// Cuts the mesh into charts and packs them.
///
/// # Errors
///
/// There are too many charts for the picture, or it was cancelled.
pub(crate) fn atlas(
    mesh: &Mesh,
    cover: &fantex_cover::Cover,
    request: &AtlasRequest,
    progress: &dyn Progress,
) -> Result<Layout, ExportError> {
    let charts = charts(mesh, cover, request.texels_per_unit);
    let packed = match request.side {
        Some(side) => densest(mesh, &charts, side, request, progress),
        None => {
            let area: f32 = charts.iter().map(|c| c.extent.element_product()).sum();
            let texels = (0.5 * area).sqrt() * request.texels_per_unit;
            let least = request.largest_side.min(SMALLEST_SIDE);
            let mut side = (texels as u32).max(1).next_power_of_two().clamp(least, request.largest_side);
            loop {
                let packed = densest(mesh, &charts, side, request, progress);
                let is_good = |p: &Packed| {
                    p.density >= NEARLY * request.texels_per_unit
                        && (p.block >= LEAST_PADDING || request.padding.is_some())
                };
                let is_last = side >= request.largest_side || progress.is_cancelled();
                if is_last || packed.as_ref().is_some_and(is_good) {
                    break packed;
                }
                side *= 2;
            }
        }
    };
    if progress.is_cancelled() {
        return Err(ExportError::Cancelled);
    }
    let packed = packed.ok_or(ExportError::TooManyCharts {
        charts: charts.len(),
        side: request.side.unwrap_or(request.largest_side),
    })?;
    Ok(laid_out(mesh, &charts, &packed))
}

/// Charts with their places.
struct Packed {
    side: u32,
    block: u32,
    /// Texels per mesh unit.
    density: f32,
    /// Columns and rows in blocks.
    places: Vec<[u32; 2]>,
    masks: Vec<Mask>,
}

/// The padding for a number of charts: what the levels ask for, less where charts would consist of padding mostly.
fn padding(charts: usize, side: u32, request: &AtlasRequest) -> u32 {
    let mut padding =
        request.padding.unwrap_or((side / LEAST_LEVEL_SIDE).clamp(2, MOST_PADDING)).min(side / 4);
    while request.padding.is_none()
        && padding > 1
        && charts as f64 * f64::from(3 * padding).powi(2) > 0.25 * f64::from(side).powi(2)
    {
        padding /= 2;
    }
    padding.max(1)
}

/// The largest density at which the charts fit a side, to about two percent; any or none once it is cancelled.
fn densest(
    mesh: &Mesh,
    charts: &[Chart],
    side: u32,
    request: &AtlasRequest,
    progress: &dyn Progress,
) -> Option<Packed> {
    let block = padding(charts.len(), side, request);
    let at = |density: f32| try_density(mesh, charts, side, block, density, progress);
    let longest = charts.iter().map(|c| c.extent.max_element()).fold(f32::MIN_POSITIVE, f32::max);
    // The longest chart fills the side, or all of them fill the picture; nothing larger can fit.
    let area: f64 = charts.iter().map(|chart| flat_area(mesh, chart)).sum();
    let filled = f64::from(side) / area.max(f64::MIN_POSITIVE).sqrt();
    let mut high = ((side - block) as f32 / longest).min(filled as f32);
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
    for _ in 0..5 {
        let middle = (low * high).sqrt();
        match at(middle) {
            Some(packed) => (low, best) = (middle, Some(packed)),
            None => high = middle,
        }
    }
    best
}

/// The area of a chart's triangles in their plane, square mesh units.
fn flat_area(mesh: &Mesh, chart: &Chart) -> f64 {
    let area = |&t: &u32| {
        let [a, b, c] = chart.corners(mesh, t);
        0.5 * f64::from((b - a).perp_dot(c - a).abs())
    };
    chart.triangles.iter().map(area).sum()
}

fn try_density(
    mesh: &Mesh,
    charts: &[Chart],
    side: u32,
    block: u32,
    density: f32,
    progress: &dyn Progress,
) -> Option<Packed> {
    let blocks = side / block;
    let scale = density / block as f32;
    let mask_of = |chart: &Chart| {
        let extent = (chart.extent * scale + 1.0).ceil().max(Vec2::ONE).as_uvec2();
        let fits = extent.x <= blocks && extent.y <= blocks && !progress.is_cancelled();
        let corners = |&t: &u32| chart.corners(mesh, t).map(|q| q * scale + 0.5);
        fits.then(|| Mask::around(extent.x, extent.y, chart.triangles.iter().map(corners)))
    };
    let masks: Vec<Mask> = charts.par_iter().map(mask_of).collect::<Option<_>>()?;
    let places = pack(&masks, blocks)?;
    Some(Packed { side, block, density, places, masks })
}

/// Corners of a chart's triangles in the picture: half a block away from the chart's own blocks' corner.
fn corners_in_picture(
    mesh: &Mesh,
    chart: &Chart,
    triangle: u32,
    place: [u32; 2],
    packed: &Packed,
) -> [Vec2; 3] {
    let origin = (Vec2::from(place.map(|n| n as f32)) + 0.5) * packed.block as f32;
    chart.corners(mesh, triangle).map(|q| q * packed.density + origin)
}

fn laid_out(mesh: &Mesh, charts: &[Chart], packed: &Packed) -> Layout {
    let blocks = packed.side / packed.block;
    let mut owners = vec![NOBODY; blocks as usize * blocks as usize];
    for (i, (mask, place)) in (0u32..).zip(packed.masks.iter().zip(&packed.places)) {
        mask.blocks().for_each(|[x, y]| owners[((place[1] + y) * blocks + place[0] + x) as usize] = i);
    }
    let mut uv = vec![[Vec2::ZERO; 3]; mesh.triangles.len()];
    let mut chart_of = vec![NOBODY; mesh.triangles.len()];
    let mut placed = Vec::with_capacity(mesh.triangles.len());
    for (i, (chart, &place)) in (0u32..).zip(charts.iter().zip(&packed.places)) {
        for &triangle in &chart.triangles {
            let corners = corners_in_picture(mesh, chart, triangle, place, packed);
            uv[triangle as usize] = corners.map(|c| c / packed.side as f32);
            chart_of[triangle as usize] = i;
            placed.push(Placed { triangle, chart: i, corners, is_beyond: false });
        }
    }
    let around = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let beyond = charts.par_iter().enumerate().flat_map_iter(|(i, chart)| {
        let beyond = neighbours(mesh, chart, i as u32, &chart_of, &around);
        beyond.into_iter().map(move |triangle| Placed {
            triangle,
            chart: i as u32,
            corners: corners_in_picture(mesh, chart, triangle, packed.places[i], packed),
            is_beyond: true,
        })
    });
    placed.extend(beyond.collect::<Vec<_>>());
    let page = Page { side: packed.side, placed, block: packed.block, owners };
    Layout {
        uv,
        pages: vec![page],
        page_of_material: vec![Some(0); mesh.materials.len()],
        repeats: false,
        charts: charts.len(),
        padding: packed.block,
        texels_per_unit: packed.density,
    }
}

/// Neighbours of a chart worse seen than this are no continuation of it.
const LEAST_FACING: f32 = 0.2;

/// At a vertex of more triangles, those that share nothing but the vertex with a chart are no neighbours: tips of a hundred
/// needles around the apex of a cone would take more work than they show.
const MOST_AROUND: usize = 64;

/// Triangles of other charts that touch a chart and that its projection sees, ascending.
fn neighbours(mesh: &Mesh, chart: &Chart, index: u32, chart_of: &[u32], around: &VertexCorners) -> Vec<u32> {
    let mut vertices: Vec<u32> = chart.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let shares_edge = |t: u32| {
        let is_shared = |v: &&u32| vertices.binary_search(v).is_ok();
        mesh.triangles[t as usize].iter().filter(is_shared).count() > 1
    };
    let mut beyond = Vec::new();
    for &v in &vertices {
        let touching = around.at(v as usize);
        let of_others = touching.iter().map(|&corner| corner / 3).filter(|&t| chart_of[t as usize] != index);
        beyond.extend(of_others.filter(|&t| touching.len() <= MOST_AROUND || shares_edge(t)));
    }
    beyond.sort_unstable();
    beyond.dedup();
    beyond.retain(|&t| chart.facing(mesh, t) >= LEAST_FACING);
    beyond
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use glam::Vec3;

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
        let charts: Vec<Chart> = (0..count).map(|t| Chart::new(&mesh, vec![t], Vec3::Z)).collect();
        let request = AtlasRequest { texels_per_unit: 10.0, side: None, largest_side: 1024, padding: None };
        let asked = Asked::default();
        let packed = densest(&mesh, &charts, 1024, &request, &asked).unwrap();
        assert!(packed.density > 10.0, "{}", packed.density);
        let tries = asked.0.into_inner() as f32 / count as f32;
        assert!(tries <= 12.0, "{tries} densities were tried");
    }

    /// Half of a disc of many narrow triangles: the other half touches it at the centre, but two triangles continue it.
    #[test]
    fn of_the_many_triangles_around_a_vertex_those_beside_the_chart_continue_it() {
        let count = 20_000;
        let rim = |i: u32| Vec2::from_angle(i as f32 / count as f32 * std::f32::consts::TAU).extend(0.0);
        let mut mesh = Mesh { positions: vec![Vec3::ZERO], ..Mesh::default() };
        mesh.positions.extend((0..count).map(rim));
        mesh.triangles.extend((0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]));
        let chart = Chart::new(&mesh, (0..count / 2).collect(), Vec3::Z);
        let chart_of: Vec<u32> = (0..count).map(|i| u32::from(i >= count / 2)).collect();
        let around = VertexCorners::of(&mesh.triangles, mesh.positions.len());
        assert_eq!(neighbours(&mesh, &chart, 0, &chart_of, &around), [count / 2, count - 1]);
    }
}
