//! Demand of tiles larger than a page: page by page, from the coarsest level down to where it is fine enough.
//!
//! A page's bounds are those of the group's kites, clipped in tile coordinates to the page and what filters read around it.
//! They are taken when the page is first looked at, through a grid of the kites over the tile, and kept within a limit.

use std::collections::{BTreeMap, HashMap};

use fantex_cover::{Cover, Group};
use fantex_mesh::{Mesh, interpolate};
use fantex_store::PAGE;
use glam::{Vec2, Vec3};

use super::bounds::Relief;
use super::bounds::{Bounds, Gathering, is_culled};
use super::bounds::{Lens, Sight, Slack};
use crate::Geometry;
use crate::shape::{Detail, TileShape, cells};

/// A page that is wanted where no bias is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageDemand {
    /// Index among the tile's pages, as in [`PageTable`](crate::PageTable): finest level first.
    pub index: u32,
    /// What its most demanding point wants; never more than a page asks for that lies over it.
    pub detail: Detail,
}

/// Texels around a page that look-ups in it may read: half a bilinear tap and some probes along a slanted pixel.
const MARGIN_TEXELS: f32 = 8.0;

/// Pages of a tile whose bounds are kept.
const MAX_CACHED_BOUNDS: usize = 1 << 14;

/// A tile of several pages.
#[derive(Debug)]
pub(crate) struct PagedTile {
    group: u32,
    /// Triangles with a corner in the group, ascending.
    triangles: Vec<u32>,
    grid: Option<KiteGrid>,
    bounds: HashMap<u32, (Bounds, Relief)>,
}

impl PagedTile {
    pub(crate) fn new(group: u32, triangles: Vec<u32>) -> Self {
        Self { group, triangles, grid: None, bounds: HashMap::new() }
    }

    /// The wanted pages, ascending by index. Where a page is wanted, so are those of the next coarser level over it.
    pub(crate) fn demand(
        &mut self,
        geometry: &dyn Geometry,
        shape: &TileShape,
        whole: &(Bounds, Relief),
        lens: &Lens,
        slack: Slack,
    ) -> Vec<PageDemand> {
        if self.bounds.len() > MAX_CACHED_BOUNDS {
            self.bounds.clear();
        }
        let count = shape.level_count() as usize;
        let mut levels: Vec<BTreeMap<[u32; 2], Detail>> = vec![BTreeMap::new(); count];
        let mut candidates = vec![[0, 0]];
        for level in (0..count as u32).rev() {
            let mut finer = Vec::new();
            for page in candidates {
                let (bounds, relief) = self.page_bounds(geometry, shape, whole, level, page);
                if let Sight::Hidden(_) = lens.sight(&bounds, slack) {
                    continue;
                }
                let detail = Detail::from_log2(lens.log2_width(&bounds, &relief, slack));
                let wanted = shape.wanted_level(detail);
                if wanted <= level {
                    levels[level as usize].insert(page, detail);
                }
                if wanted < level {
                    finer.extend(cells(shape.overlapping(level, page, level - 1)));
                }
            }
            finer.sort_unstable();
            finer.dedup();
            candidates = finer;
        }
        close_upwards(shape, &mut levels);
        let mut pages: Vec<PageDemand> = (0..)
            .zip(&levels)
            .flat_map(|(level, pages)| {
                pages
                    .iter()
                    .map(move |(&page, &detail)| PageDemand { index: shape.page_index(level, page), detail })
            })
            .collect();
        pages.sort_unstable_by_key(|p| p.index);
        pages
    }

    fn page_bounds(
        &mut self,
        geometry: &dyn Geometry,
        shape: &TileShape,
        whole: &(Bounds, Relief),
        level: u32,
        page: [u32; 2],
    ) -> (Bounds, Relief) {
        let extent = shape.extent(level);
        if extent.iter().all(|&n| n <= PAGE) {
            return *whole;
        }
        let index = shape.page_index(level, page);
        if let Some(bounds) = self.bounds.get(&index) {
            return *bounds;
        }
        let texels = Vec2::from(extent.map(|n| n as f32));
        let origin = Vec2::from(page.map(|n| (n * PAGE) as f32));
        let size = Vec2::from(shape.page_extent(level, page).map(|n| n as f32));
        let rectangle = [(origin - MARGIN_TEXELS) / texels, (origin + size + MARGIN_TEXELS) / texels];
        let grid = self.grid.get_or_insert_with(|| KiteGrid::new(geometry, self.group, &self.triangles));
        let group = &geometry.cover().groups[self.group as usize];
        let bounds = grid.bounds(group, rectangle);
        self.bounds.insert(index, bounds);
        bounds
    }
}

/// Adds the pages over each page that are missing, and hands its detail up.
fn close_upwards(shape: &TileShape, levels: &mut [BTreeMap<[u32; 2], Detail>]) {
    for level in 0..levels.len().saturating_sub(1) {
        let (finer, coarser) = levels.split_at_mut(level + 1);
        for (&page, &detail) in &finer[level] {
            for above in cells(shape.overlapping(level as u32, page, level as u32 + 1)) {
                let entry = coarser[0].entry(above).or_insert(detail);
                *entry = (*entry).min(detail);
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct PlacedKite {
    kite: Kite,
    normal: Vec3,
    densities: Densities,
    is_culled: bool,
}

/// The kites of a group by the cells of a grid over its tile.
#[derive(Debug)]
struct KiteGrid {
    kites: Vec<PlacedKite>,
    side: u32,
    /// Per cell, rows from v = 0, the kites whose box touches it.
    cells: Vec<Vec<u32>>,
}

impl KiteGrid {
    fn new(geometry: &dyn Geometry, group: u32, triangles: &[u32]) -> Self {
        let mut kites = Vec::new();
        for &t in triangles {
            for facet in facets(geometry.mesh(), geometry.cover(), t as usize) {
                if facet.group == group {
                    let densities = densities(geometry.mesh(), geometry.cover(), t as usize, group);
                    kites.extend(facet.kites.into_iter().flatten().map(|kite| PlacedKite {
                        kite,
                        normal: facet.normal,
                        densities,
                        is_culled: is_culled(geometry.mesh(), t as usize),
                    }));
                }
            }
        }
        let side = ((kites.len() as f32).sqrt() as u32).clamp(1, 64);
        let mut grid = Self { kites, side, cells: vec![Vec::new(); (side * side) as usize] };
        for i in 0..grid.kites.len() {
            let uv = grid.kites[i].kite.uv;
            let box_of = [
                uv.into_iter().fold(Vec2::INFINITY, Vec2::min),
                uv.into_iter().fold(Vec2::NEG_INFINITY, Vec2::max),
            ];
            for [x, y] in cells(grid.cells_under(box_of)) {
                grid.cells[(y * side + x) as usize].push(i as u32);
            }
        }
        grid
    }

    /// First and last cell that a rectangle touches.
    fn cells_under(&self, rectangle: [Vec2; 2]) -> [[u32; 2]; 2] {
        rectangle.map(|uv| {
            let cell = (uv * self.side as f32).clamp(Vec2::ZERO, Vec2::splat(self.side as f32 - 1.0));
            [cell.x as u32, cell.y as u32]
        })
    }

    fn bounds(&self, group: &Group, rectangle: [Vec2; 2]) -> (Bounds, Relief) {
        let mut found: Vec<u32> = cells(self.cells_under(rectangle))
            .flat_map(|[x, y]| &self.cells[(y * self.side + x) as usize])
            .copied()
            .collect();
        found.sort_unstable();
        found.dedup();
        let mut gathering = Gathering::EMPTY;
        let mut kept: Vec<(Vec3, u32)> = Vec::new();
        for i in found {
            let placed = &self.kites[i as usize];
            let polygon = clip(&placed.kite, rectangle);
            if !polygon.is_empty() {
                gathering.add_facet(placed.normal, placed.densities, placed.is_culled);
            }
            for (_, p) in polygon {
                gathering.add_point(p);
                kept.push((p, i));
            }
        }
        if kept.is_empty() {
            return (Bounds::NOTHING, Relief::UNKNOWN);
        }
        let mut bounds = gathering.begin();
        for &(p, i) in &kept {
            bounds.widen_to_point(p);
            bounds.widen_to_normal(self.kites[i as usize].normal);
        }
        let planes = kept.iter().map(|&(p, i)| (self.kites[i as usize].normal, p));
        (bounds, Relief::new(group, bounds.sphere.center, bounds.cone.is_culled, planes))
    }
}

/// The part of a kite inside a rectangle of the tile (Sutherland and Hodgman, "Reentrant polygon clipping", 1974).
fn clip(kite: &Kite, [low, high]: [Vec2; 2]) -> Vec<(Vec2, Vec3)> {
    let mut polygon: Vec<(Vec2, Vec3)> = kite.uv.into_iter().zip(kite.points).collect();
    for (normal, limit) in
        [(Vec2::X, low.x), (Vec2::NEG_X, -high.x), (Vec2::Y, low.y), (Vec2::NEG_Y, -high.y)]
    {
        let height = |uv: Vec2| normal.dot(uv) - limit;
        let mut clipped = Vec::with_capacity(polygon.len() + 1);
        for i in 0..polygon.len() {
            let ((uv_a, a), (uv_b, b)) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            let (height_a, height_b) = (height(uv_a), height(uv_b));
            if height_a >= 0.0 {
                clipped.push((uv_a, a));
            }
            if (height_a >= 0.0) != (height_b >= 0.0) {
                let t = height_a / (height_a - height_b);
                clipped.push((uv_a.lerp(uv_b, t), a.lerp(b, t)));
            }
        }
        polygon = clipped;
    }
    polygon
}

// The parts of triangles that a group is looked up on.
//
// ```text
//        corner            The weight of corner i is positive where lambda_i > max(lambda_j, lambda_k) - delta: a kite.
//         /\               Its far corner lies a little beyond the triangle's centre, the side ones beyond the middles
//        /  \              of the edges.
//   side <  > side
//      / `./' \
//     /   far  \
//    '----------'
// ```

/// Where a kite's corners lie: barycentric coordinates, from the corner's own around.
fn kite(slot: usize, delta: f32) -> [Vec3; 4] {
    let (near, far) = (0.5 * (1.0 - delta), 0.5 * (1.0 + delta));
    let inner = (1.0 - 2.0 * delta) / 3.0;
    let turned = |[own, next, previous]: [f32; 3]| {
        let mut lambda = [0.0; 3];
        lambda[slot] = own;
        lambda[(slot + 1) % 3] = next;
        lambda[(slot + 2) % 3] = previous;
        Vec3::from_array(lambda)
    };
    let rest = 0.5 * (1.0 - inner);
    [[1.0, 0.0, 0.0], [near, far, 0.0], [inner, rest, rest], [near, 0.0, far]].map(turned)
}

/// One kite, in space and in its tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kite {
    /// Corners, mesh space.
    pub(crate) points: [Vec3; 4],
    /// The same in tile coordinates.
    pub(crate) uv: [Vec2; 4],
}

/// What a group sees of one triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    pub(crate) group: u32,
    /// Unit normal.
    pub(crate) normal: Vec3,
    /// One per corner of the triangle that belongs to the group.
    pub(crate) kites: [Option<Kite>; 3],
}

/// Texels of level 0 per mesh unit along the directions on a triangle that have fewest and most of them: the singular values
/// of the map from its plane to texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Densities {
    pub(crate) least: f32,
    pub(crate) most: f32,
}

/// Those of a triangle in one of its corners' groups.
pub(crate) fn densities(mesh: &Mesh, cover: &Cover, triangle: usize, group: u32) -> Densities {
    let extent = Vec2::from(cover.groups[group as usize].extent.map(|n| n as f32));
    // One projection serves all corners of a projected group; an unfolded fan has one corner in a triangle.
    let slot = cover.corner_groups[triangle].iter().position(|&g| g == group).unwrap_or(0);
    map_densities(mesh.triangle_positions(triangle), cover.tile_corners(mesh, triangle, slot), extent)
}

/// Points whose hull is what the group of the given corners sees of a triangle, and how many.
pub(crate) fn piece_points(corners: [Vec3; 3], is_in: [bool; 3], delta: f32) -> ([Vec3; 12], usize) {
    let (mut points, mut count) = ([Vec3::ZERO; 12], 0);
    if is_in == [true; 3] {
        points[..3].copy_from_slice(&corners);
        return (points, 3);
    }
    for slot in (0..3).filter(|&slot| is_in[slot]) {
        for lambda in kite(slot, delta) {
            points[count] = interpolate(corners, lambda);
            count += 1;
        }
    }
    (points, count)
}

/// The facets of a triangle, one per group it is looked up in.
fn facets(mesh: &Mesh, cover: &Cover, triangle: usize) -> impl Iterator<Item = Facet> {
    let positions = mesh.triangle_positions(triangle);
    let groups = cover.corner_groups[triangle];
    let [a, b, c] = positions;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let first_slot = move |slot: usize| groups.iter().position(|&g| g == groups[slot]) == Some(slot);
    (0..3).filter(move |&slot| first_slot(slot)).map(move |slot| {
        let mut facet = Facet { group: groups[slot], normal, kites: [None; 3] };
        for other in (slot..3).filter(|&s| groups[s] == groups[slot]) {
            let uv = cover.tile_corners(mesh, triangle, other);
            let lambdas = kite(other, cover.delta);
            let points = lambdas.map(|lambda| interpolate(positions, lambda));
            facet.kites[other] = Some(Kite { points, uv: lambdas.map(|lambda| interpolate(uv, lambda)) });
        }
        facet
    })
}

fn map_densities([a, b, c]: [Vec3; 3], uv: [Vec2; 3], extent: Vec2) -> Densities {
    let x_axis = (b - a).normalize_or_zero();
    let (bx, cx) = ((b - a).dot(x_axis), (c - a).dot(x_axis));
    let cy = ((c - a) - x_axis * cx).length();
    let (to_b, to_c) = ((uv[1] - uv[0]) * extent, (uv[2] - uv[0]) * extent);
    let along_x = to_b / bx;
    let along_y = (to_c - along_x * cx) / cy;
    let (sum, area) = (along_x.length_squared() + along_y.length_squared(), along_x.perp_dot(along_y).abs());
    let most = (0.5 * (sum + (sum * sum - 4.0 * area * area).max(0.0).sqrt())).sqrt();
    // Where the map folds a line onto a point every level is too coarse; nothing finer than this would be seen.
    Densities { least: (area / most).max(1e-3 * most), most }
}
