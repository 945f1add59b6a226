//! Demand of tiles larger than a page: page by page, from the coarsest level down to where it is fine enough.
//!
//! A page's bounds are those of the group's pieces of surface, clipped in tile coordinates to the page and what filters read around
//! it. They are found through grids of the pieces, one per chunk of triangles, when the page is first looked at, and kept within a limit.
//! Grids and bounds are tasks of limited length that threads carry out at once ([`bounding`](super::bounding)).

use std::collections::{BTreeMap, HashMap};

use arrayvec::ArrayVec;
use fantex_cover::{Cover, Group, GroupKind};
use fantex_mesh::{Mesh, interpolate};
use fantex_store::{PAGE, PageId};
use glam::{Vec2, Vec3};

use super::bounds::{Bounds, Gathering, LogDensities, Relief, is_culled};
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

/// Triangles that are put into one grid: a task of a quarter of a millisecond.
const CHUNK_TRIANGLES: usize = 1 << 10;

/// Pieces in a page that are bounded one by one, at most. Where there are more, the bounds of the chunks that reach into the page serve.
const MAX_PIECES: usize = 1 << 13;

/// The time that it takes to put a triangle into a grid, and to bound a piece in a page, in that of a group.
const PLACING_WORK: usize = 3;
const PIECE_WORK: usize = 2;

/// A tile of several pages.
#[derive(Debug)]
pub(crate) struct PagedTile {
    group: u32,
    /// Triangles with a corner in the group, ascending.
    triangles: Vec<u32>,
    /// Of the first chunks of triangles; of all of them when a page's bounds are taken.
    grids: Vec<PieceGrid>,
    /// Of pages, by their indices.
    bounds: HashMap<u32, (Bounds, Relief)>,
}

/// What a tile wants of its pages.
#[derive(Debug, Default)]
pub(crate) struct PagesWanted {
    /// Ascending by index. Where a page is wanted, so are those of the next coarser level over it.
    pub(crate) pages: Vec<PageDemand>,
    /// Pages whose bounds are missing, all of one level; those of coarser ones are known. While there are any, pages may be missing from
    /// the list above, and what was wanted stays wanted.
    pub(crate) unbounded: Vec<u32>,
    /// Number of pages that were looked at.
    pub(crate) looked_at: usize,
}

/// What one thread does for the bounds of a tile's pages.
#[derive(Clone, Copy, Debug)]
pub(crate) enum BoundingTask {
    /// Put a chunk of triangles into a grid.
    Place(usize),
    /// Bound the page of an index.
    Bound(u32),
}

/// What came of a [`BoundingTask`].
#[derive(Debug)]
pub(crate) enum BoundingResult {
    Placed(PieceGrid),
    Bounded(u32, (Bounds, Relief)),
}

impl PagedTile {
    pub(crate) fn new(group: u32, triangles: Vec<u32>) -> Self {
        Self { group, triangles, grids: Vec::new(), bounds: HashMap::new() }
    }

    /// What is wanted from a view, as far as bounds are known; `last` is what was wanted before.
    pub(crate) fn wanted(
        &self,
        shape: &TileShape,
        whole: &(Bounds, Relief),
        (lens, slack): (&Lens, Slack),
        last: &[PageDemand],
    ) -> PagesWanted {
        let count = shape.level_count() as usize;
        let mut levels: Vec<BTreeMap<[u32; 2], Detail>> = vec![BTreeMap::new(); count];
        let mut candidates = vec![[0, 0]];
        let (mut looked_at, mut unbounded) = (0, Vec::new());
        for level in (0..count as u32).rev() {
            let mut finer = Vec::new();
            let is_coarsest_unbounded = unbounded.is_empty();
            for page in candidates {
                let Some((bounds, relief)) = self.known_bounds(shape, whole, (level, page)) else {
                    if is_coarsest_unbounded {
                        unbounded.push(shape.page_index(level, page));
                    }
                    continue;
                };
                looked_at += 1;
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
        if !unbounded.is_empty() {
            for &PageDemand { index, detail } in last {
                let page = shape.page(self.group, index);
                levels[page.level as usize].entry(page.page).or_insert(detail);
            }
        }
        close_upwards(shape, &mut levels);
        let mut pages: Vec<PageDemand> = (0..)
            .zip(&levels)
            .flat_map(|(level, pages)| {
                pages
                    .iter()
                    .map(move |(&page, &detail)| PageDemand { index: shape.page_index(level, page), detail })
            })
            .filter(|page| page.index < shape.own_pages())
            .collect();
        pages.sort_unstable_by_key(|p| p.index);
        PagesWanted { pages, unbounded, looked_at }
    }

    fn known_bounds(
        &self,
        shape: &TileShape,
        whole: &(Bounds, Relief),
        (level, page): (u32, [u32; 2]),
    ) -> Option<(Bounds, Relief)> {
        if shape.extent(level).iter().all(|&n| n <= PAGE) {
            return Some(*whole);
        }
        self.bounds.get(&shape.page_index(level, page)).copied()
    }

    /// Drops all bounds if there are too many.
    pub(crate) fn trim(&mut self) {
        if self.bounds.len() > MAX_CACHED_BOUNDS {
            self.bounds.clear();
        }
    }

    /// What is to be done next for the bounds of these pages, and the work of each task: all grids first, then page by page.
    pub(crate) fn tasks<'a>(
        &'a self,
        shape: &'a TileShape,
        unbounded: &'a [u32],
    ) -> impl Iterator<Item = (BoundingTask, usize)> + 'a {
        let chunks = self.triangles.len().div_ceil(CHUNK_TRIANGLES);
        let pages: &[u32] = if self.grids.len() < chunks { &[] } else { unbounded };
        let places = (self.grids.len()..chunks)
            .map(move |chunk| (BoundingTask::Place(chunk), PLACING_WORK * self.chunk(chunk).len()));
        let bounds = pages.iter().map(move |&index| {
            let pieces = self.piece_count(self.rectangle(shape, index));
            let work = if pieces > MAX_PIECES { chunks } else { PIECE_WORK * pieces };
            (BoundingTask::Bound(index), work.max(1))
        });
        places.chain(bounds)
    }

    /// Does what a task says. [`keep`](Self::keep) takes what comes of it, that of grids in their order.
    pub(crate) fn carry_out(
        &self,
        geometry: &dyn Geometry,
        shape: &TileShape,
        task: BoundingTask,
    ) -> BoundingResult {
        match task {
            BoundingTask::Place(chunk) => {
                BoundingResult::Placed(PieceGrid::new(geometry, self.group, self.chunk(chunk)))
            }
            BoundingTask::Bound(index) => {
                let group = &geometry.cover().groups[self.group as usize];
                BoundingResult::Bounded(index, self.bounds_in(group, self.rectangle(shape, index)))
            }
        }
    }

    pub(crate) fn keep(&mut self, result: BoundingResult) {
        match result {
            BoundingResult::Placed(grid) => self.grids.push(grid),
            BoundingResult::Bounded(index, bounds) => {
                self.bounds.insert(index, bounds);
            }
        }
    }

    fn chunk(&self, index: usize) -> &[u32] {
        let begin = index * CHUNK_TRIANGLES;
        &self.triangles[begin..self.triangles.len().min(begin + CHUNK_TRIANGLES)]
    }

    /// Lower and upper corner of what look-ups in a page read, in tile coordinates.
    fn rectangle(&self, shape: &TileShape, index: u32) -> [Vec2; 2] {
        let PageId { level, page, .. } = shape.page(self.group, index);
        let texels = Vec2::from(shape.extent(level).map(|n| n as f32));
        let origin = Vec2::from(page.map(|n| (n * PAGE) as f32));
        let size = Vec2::from(shape.page_extent(level, page).map(|n| n as f32));
        [(origin - MARGIN_TEXELS) / texels, (origin + size + MARGIN_TEXELS) / texels]
    }

    /// How many pieces, about, may lie in a rectangle of the tile.
    fn piece_count(&self, rectangle: [Vec2; 2]) -> usize {
        self.grids.iter().map(|grid| grid.count_in(rectangle)).sum()
    }

    /// Bounds of what lies in a rectangle of the tile.
    fn bounds_in(&self, group: &Group, rectangle: [Vec2; 2]) -> (Bounds, Relief) {
        if self.piece_count(rectangle) > MAX_PIECES {
            let chunks = self.grids.iter().filter(|grid| grid.meets(rectangle));
            let chunks: Vec<Bounds> = chunks.map(|grid| grid.bounds).collect();
            return (Bounds::around(&chunks), Relief::UNKNOWN);
        }
        let mut gathering = Gathering::EMPTY;
        let (mut points, mut planes) = (Vec::new(), Vec::new());
        for grid in &self.grids {
            grid.for_each_in(rectangle, |piece| {
                let polygon = clip(piece, rectangle);
                let Some(&(_, first)) = polygon.first() else { return };
                gathering.add_normals(piece.normal, piece.densities, piece.is_culled);
                planes.push((piece.normal, first));
                points.extend(polygon.iter().map(|&(_, p)| p));
            });
        }
        if planes.is_empty() {
            return (Bounds::NOTHING, Relief::UNKNOWN);
        }
        let bounds = gathering.finish(&points, planes.iter().map(|&(normal, _)| normal));
        let relief = Relief::new(group, bounds.sphere.center, bounds.cone.is_culled, planes.iter().copied());
        (bounds, relief)
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

/// A flat piece of surface in its tile: a triangle, or a kite of one.
#[derive(Clone, Debug)]
struct Piece {
    /// In tile coordinates and in mesh space.
    corners: ArrayVec<(Vec2, Vec3), 4>,
    /// Unit.
    normal: Vec3,
    densities: LogDensities,
    is_culled: bool,
}

impl Piece {
    /// Lower and upper corner of its box in the tile.
    fn box_of(&self) -> [Vec2; 2] {
        let uv = || self.corners.iter().map(|&(uv, _)| uv);
        [uv().fold(Vec2::INFINITY, Vec2::min), uv().fold(Vec2::NEG_INFINITY, Vec2::max)]
    }
}

/// Pieces of a group by the cells of a grid over the part of the tile in which they lie.
#[derive(Debug)]
pub(crate) struct PieceGrid {
    pieces: Vec<Piece>,
    /// Around all pieces, mesh space.
    bounds: Bounds,
    /// Lower and upper corner in the tile.
    area: [Vec2; 2],
    /// Cells along each side.
    side: u32,
    /// Per cell, rows from the lower corner, where its pieces begin in `members`; then where the last one's end.
    firsts: Vec<u32>,
    /// Pieces whose box touches a cell, ascending.
    members: Vec<u32>,
    /// Per piece the first column and row that its box touches.
    first_cells: Vec<[u8; 2]>,
}

impl PieceGrid {
    fn new(geometry: &dyn Geometry, group: u32, triangles: &[u32]) -> Self {
        let mut pieces = Vec::with_capacity(triangles.len());
        for &triangle in triangles {
            add_pieces(&mut pieces, geometry, triangle as usize, group);
        }
        let mut gathering = Gathering::EMPTY;
        let mut area = [Vec2::INFINITY, Vec2::NEG_INFINITY];
        for piece in &pieces {
            gathering.add_normals(piece.normal, piece.densities, piece.is_culled);
            let [low, high] = piece.box_of();
            area = [area[0].min(low), area[1].max(high)];
        }
        let points: Vec<Vec3> = pieces.iter().flat_map(|piece| &piece.corners).map(|&(_, p)| p).collect();
        let bounds = gathering.finish(&points, pieces.iter().map(|piece| piece.normal));
        let side = (pieces.len() as f32).sqrt().clamp(1.0, 64.0) as u32;
        let (firsts, members, first_cells) = (Vec::new(), Vec::new(), Vec::new());
        let mut grid = Self { pieces, bounds, area, side, firsts, members, first_cells };
        grid.sort_into_cells();
        grid
    }

    /// Counts what lies in each cell, then puts it there.
    fn sort_into_cells(&mut self) {
        let ranges: Vec<_> = self.pieces.iter().map(|piece| self.cells_under(piece.box_of())).collect();
        let side = self.side;
        let cells_of = |&range: &[[u32; 2]; 2]| cells(range).map(move |[x, y]| y * side + x);
        let mut firsts = vec![0; (side * side) as usize + 1];
        for cell in ranges.iter().flat_map(cells_of) {
            firsts[cell as usize + 1] += 1;
        }
        for cell in 1..firsts.len() {
            firsts[cell] += firsts[cell - 1];
        }
        let mut members = vec![0; firsts[firsts.len() - 1] as usize];
        let mut next = firsts.clone();
        for (i, range) in (0..).zip(&ranges) {
            for cell in cells_of(range) {
                let place = &mut next[cell as usize];
                members[*place as usize] = i;
                *place += 1;
            }
        }
        self.first_cells = ranges.iter().map(|&[first, _]| first.map(|n| n as u8)).collect();
        (self.firsts, self.members) = (firsts, members);
    }

    /// Whether the part of the tile in which the pieces lie meets a rectangle.
    fn meets(&self, [low, high]: [Vec2; 2]) -> bool {
        self.area[0].cmple(high).all() && low.cmple(self.area[1]).all()
    }

    /// First and last cell that a rectangle touches; those at the border where it does not.
    fn cells_under(&self, rectangle: [Vec2; 2]) -> [[u32; 2]; 2] {
        let scale = self.side as f32 / (self.area[1] - self.area[0]).max(Vec2::splat(f32::EPSILON));
        rectangle.map(|uv| {
            let cell = (uv - self.area[0]) * scale;
            let cell = cell.clamp(Vec2::ZERO, Vec2::splat(self.side as f32 - 1.0));
            [cell.x as u32, cell.y as u32]
        })
    }

    /// About how many pieces [`for_each_in`](Self::for_each_in) visits: members of cells, by the mean number of cells of a piece.
    fn count_in(&self, rectangle: [Vec2; 2]) -> usize {
        if self.members.is_empty() || !self.meets(rectangle) {
            return 0;
        }
        let [[left, bottom], [right, top]] = self.cells_under(rectangle);
        let members_in_row = |y: u32| {
            let row = (y * self.side) as usize;
            u64::from(self.firsts[row + right as usize + 1] - self.firsts[row + left as usize])
        };
        let members: u64 = (bottom..=top).map(members_in_row).sum();
        (members * self.pieces.len() as u64).div_ceil(self.members.len() as u64) as usize
    }

    /// Visits the pieces whose box touches a cell that a rectangle touches, each once.
    fn for_each_in(&self, rectangle: [Vec2; 2], mut visit: impl FnMut(&Piece)) {
        if !self.meets(rectangle) {
            return;
        }
        let range = self.cells_under(rectangle);
        for [x, y] in cells(range) {
            let cell = (y * self.side + x) as usize;
            for &i in &self.members[self.firsts[cell] as usize..self.firsts[cell + 1] as usize] {
                // Of the cells that both touch, the first one counts.
                let [first_x, first_y] = self.first_cells[i as usize].map(u32::from);
                if [x, y] == [first_x.max(range[0][0]), first_y.max(range[0][1])] {
                    visit(&self.pieces[i as usize]);
                }
            }
        }
    }
}

/// The corners of a clipped piece. A line that cuts `n` sides of a polygon adds `n / 2` corners: from 4, by four lines, 19 at most.
type Polygon = ArrayVec<(Vec2, Vec3), 19>;

/// The part of a piece inside a rectangle of the tile (Sutherland and Hodgman, "Reentrant polygon clipping", 1974).
fn clip(piece: &Piece, [low, high]: [Vec2; 2]) -> Polygon {
    let mut polygon: Polygon = piece.corners.iter().copied().collect();
    for (normal, limit) in
        [(Vec2::X, low.x), (Vec2::NEG_X, -high.x), (Vec2::Y, low.y), (Vec2::NEG_Y, -high.y)]
    {
        let height = |uv: Vec2| normal.dot(uv) - limit;
        if polygon.iter().all(|&(uv, _)| height(uv) >= 0.0) {
            continue;
        }
        let mut clipped = Polygon::new();
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

/// What a group sees of a triangle: all of it, or kites.
fn add_pieces(pieces: &mut Vec<Piece>, geometry: &dyn Geometry, triangle: usize, group: u32) {
    let (mesh, cover) = (geometry.mesh(), geometry.cover());
    let corners = mesh.triangle_positions(triangle);
    let slots: ArrayVec<usize, 3> =
        (0..3).filter(|&slot| cover.corner_groups[triangle][slot] == group).collect();
    let Some(&first) = slots.first() else { return };
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    // One map serves all corners of a projected group; an unfolded one places a triangle once per corner.
    let tile = &cover.groups[group as usize];
    let uv = |slot| cover.tile_corners(mesh, triangle, slot);
    let in_tile = uv(first);
    let is_one_map = tile.kind == GroupKind::Projected || slots.iter().all(|&slot| uv(slot) == in_tile);
    let extent = Vec2::from(tile.extent.map(|n| n as f32));
    let densities = LogDensities::from(map_densities(corners, in_tile, extent));
    let is_culled = is_culled(mesh, triangle);
    let mut add = |corners| pieces.push(Piece { corners, normal, densities, is_culled });
    if slots.len() == 3 && is_one_map {
        add(in_tile.into_iter().zip(corners).collect());
        return;
    }
    for slot in slots {
        let in_tile = if is_one_map { in_tile } else { uv(slot) };
        let at = |lambda| (interpolate(in_tile, lambda), interpolate(corners, lambda));
        add(kite(slot, cover.delta).map(at).into());
    }
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
