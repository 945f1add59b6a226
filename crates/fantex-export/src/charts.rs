//! Cutting the surface into pieces that are laid flat: from triangles to a few large charts.
//!
//! ```text
//!  triangles --grow--> atoms --join neighbours that face alike--> patches --cut where they overlap--> charts
//!                                                                                                          |
//!           charts <--cut where they overlap-- larger charts <--`unions`: join what lies flat side by side-'
//! ```
//!
//! Pieces are joined as long as one projection serves the union. From there it is stretch that counts, not a direction: fewer charts
//! have less border, and border costs padding.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};
use std::sync::LazyLock;

use fantex_base::UnionFind;
use fantex_cover::{Rectangle, RectangleFinder, SPAN_SLACK, span};
use fantex_mesh::{Edges, Mesh, unit_vector};
use glam::{IVec2, Vec2, Vec2Swizzles, Vec3};
use rayon::prelude::*;

use crate::layout_progress::LayoutProgress;
use crate::overlaps::{for_each_side, without_crossings};
use crate::plans::{GROWTH_OF_ALL, Plan};
use crate::slots::Slots;
use crate::unions::unite;

/// A piece of the surface in the plane, none of whose triangles overlap.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// Ascending.
    pub(crate) triangles: Vec<u32>,
    /// Where their corners lie in its rectangle: mesh units, not negative, v downwards.
    pub(crate) corners: Vec<[Vec2; 3]>,
    /// Sides of its rectangle, mesh units.
    pub(crate) extent: Vec2,
    /// Sides of triangles that no other one has, as the corners; none where these are hardly fewer, or not known.
    pub(crate) border: Vec<[Vec2; 2]>,
}

impl Chart {
    /// Triangles that lie in a plane, v downwards.
    pub(crate) fn new(triangles: Vec<u32>, mut corners: Vec<[Vec2; 3]>) -> Self {
        let points = corners.as_flattened().iter();
        let low = points.clone().copied().reduce(Vec2::min).unwrap_or_default();
        let high = points.copied().reduce(Vec2::max).unwrap_or_default();
        corners.as_flattened_mut().iter_mut().for_each(|p| *p -= low);
        Self { triangles, corners, extent: high - low, border: Vec::new() }
    }

    /// Turned so that its rectangle is smallest and lies on its long side.
    fn lying(mut self, rectangles: &mut RectangleFinder) -> Self {
        let mut points: Vec<Vec3> = self.corners.as_flattened().iter().map(|p| p.extend(0.0)).collect();
        let Rectangle { mut x_axis, size, .. } = rectangles.smallest(&mut points, 0.0);
        if size.x < size.y {
            x_axis = x_axis.perp();
        }
        for p in self.corners.as_flattened_mut() {
            *p = Vec2::new(p.dot(x_axis), p.dot(x_axis.perp()));
        }
        Self::new(self.triangles, self.corners)
    }

    /// Finds its border. It must not change from there on.
    pub(crate) fn find_border(&mut self, across: &[u32], slots: &Slots) {
        let mut border = Vec::new();
        for_each_side(self, across, slots, |index, k, beyond| {
            if beyond.is_none() {
                border.push([self.corners[index][k], self.corners[index][(k + 1) % 3]]);
            }
        });
        if border.len() < self.triangles.len() {
            self.border = border;
        }
    }

    /// Turned so that the square around it is smallest: what is long and narrow lies along the diagonal.
    pub(crate) fn turn_into_square(&mut self) {
        let mut points: Vec<Vec3> = self.corners.as_flattened().iter().map(|p| p.extend(0.0)).collect();
        let mut rectangles = RectangleFinder::default();
        rectangles.smallest(&mut points, 0.0);
        let hull: Vec<Vec2> = rectangles.hull().iter().map(|p| p.truncate()).collect();
        let side = |degrees: f32| {
            let x_axis = unit_vector(degrees.to_radians());
            let length = |axis: Vec2| {
                let along = || hull.iter().map(|p| p.dot(axis));
                along().fold(f32::NEG_INFINITY, f32::max) - along().fold(f32::INFINITY, f32::min)
            };
            length(x_axis).max(length(x_axis.perp()))
        };
        let least = |angles: [f32; 2], steps: u16| {
            let angles =
                (0..=steps).map(|i| angles[0] + (angles[1] - angles[0]) * f32::from(i) / f32::from(steps));
            angles
                .map(|angle| (angle, side(angle)))
                .fold((0.0, side(0.0)), |a, b| if b.1 < a.1 { b } else { a })
        };
        let (mut degrees, mut reach) = (least([0.0, 90.0], 90).0, 1.0);
        while reach > 1e-3 {
            degrees = least([degrees - reach, degrees + reach], 20).0;
            reach /= 10.0;
        }
        if degrees != 0.0 {
            let x_axis = unit_vector(degrees.to_radians());
            let turned =
                |corners: &[Vec2; 3]| corners.map(|p| Vec2::new(p.dot(x_axis), p.dot(x_axis.perp())));
            *self = Self::new(std::mem::take(&mut self.triangles), self.corners.iter().map(turned).collect());
        }
    }

    /// The orthogonal projection along `direction` (unit).
    pub(crate) fn projected(mesh: &Mesh, triangles: Vec<u32>, direction: Vec3) -> Self {
        let (x, y) = direction.any_orthonormal_pair();
        // `x`, `y` and the direction are a right-handed frame; v points downwards.
        let plane = |p: Vec3| Vec2::new(p.dot(x), -p.dot(y));
        let corners = triangles.iter().map(|&t| mesh.triangle_positions(t as usize).map(plane)).collect();
        Self::new(triangles, corners)
    }

    /// Cut across between its triangles, by halves, until no piece is longer than `length`, as far as triangles are short enough.
    pub(crate) fn cut_across(self, length: f32) -> Vec<Self> {
        let (mut whole, mut cut) = (vec![self], Vec::new());
        let mut rectangles = RectangleFinder::default();
        while let Some(chart) = whole.pop() {
            let longest = chart.extent.max_element();
            let axis = usize::from(chart.extent.y > chart.extent.x);
            let is_first = |corners: &[Vec2; 3]| corners.iter().map(|p| p[axis]).sum::<f32>() < 1.5 * longest;
            let halves = [true, false].map(|first| {
                let (triangles, corners) =
                    chart.iter().filter(|(_, corners)| is_first(corners) == first).unzip();
                Self::new(triangles, corners)
            });
            let is_shorter = |half: &Self| !half.triangles.is_empty() && half.extent[axis] < 0.75 * longest;
            match longest > length && halves.iter().all(is_shorter) {
                true => whole.extend(halves.map(|half| half.lying(&mut rectangles))),
                false => cut.push(chart),
            }
        }
        cut
    }

    /// Its triangles and where their corners lie.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, [Vec2; 3])> {
        self.triangles.iter().copied().zip(self.corners.iter().copied())
    }
}

/// All charts of a mesh; every triangle lies in exactly one, unless `progress` is cancelled. The same on any number of threads. `across` are
/// [`continued`] half-edges.
pub(crate) fn charts(
    mesh: &Mesh,
    across: &[u32],
    texels_per_unit: f32,
    progress: &LayoutProgress<'_>,
) -> Vec<Chart> {
    let edges = edges(mesh, across);
    let facets: Vec<Vec3> = (0..mesh.triangles.len()).into_par_iter().map(|t| facet(mesh, t)).collect();
    let atoms = atoms(&facets, across);
    let patches = join(mesh, &facets, &atoms, &edges, texels_per_unit, progress);
    if progress.is_cancelled() {
        return Vec::new();
    }
    let cutter = Cutter::new(mesh, across, texels_per_unit);
    let projected = patches.into_par_iter().flat_map_iter(|patch| cutter.charts_of(patch));
    let projected = projected.collect();
    progress.reach(LayoutProgress::PROJECTED);
    let united = unite(mesh, projected, across, progress);
    let whole = united.into_par_iter().flat_map_iter(|chart| cutter.cut(chart, true));
    whole.map_init(RectangleFinder::default, |rectangles, chart| chart.lying(rectangles)).collect()
}

/// No half-edge, no triangle.
pub(crate) const NONE: u32 = u32::MAX;

/// Of every half-edge that of the triangle that [continues](fantex_mesh::continued) its own the same way round, or [`NONE`].
pub(crate) fn continued(mesh: &Mesh) -> Vec<u32> {
    let mut across = vec![NONE; 3 * mesh.triangles.len()];
    let begins = |half_edge: u32| mesh.triangles[half_edge as usize / 3][half_edge as usize % 3];
    for edge in Edges::of(&mesh.triangles).iter() {
        for [one, other] in edge.continued() {
            if begins(one) != begins(other) {
                (across[one as usize], across[other as usize]) = (other, one);
            }
        }
    }
    across
}

fn facet_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    facet(mesh, triangle).normalize_or(Vec3::Z)
}

/// The normal of a triangle, as long as twice its area.
fn facet(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle).map(Vec3::as_dvec3);
    (b - a).cross(c - a).as_vec3()
}

/// Twice the area of a triangle, square mesh units.
pub(crate) fn doubled_area(mesh: &Mesh, triangle: usize) -> f32 {
    facet(mesh, triangle).length()
}

// ---- The smallest pieces: triangles that hang together and face alike.

/// An edge that two triangles continue each other across.
struct Edge {
    triangles: [u32; 2],
    /// Mesh units.
    length: f32,
}

/// All edges that triangles continue each other across.
fn edges(mesh: &Mesh, across: &[u32]) -> Vec<Edge> {
    let edge = |(half_edge, &other): (usize, &u32)| {
        let (t, k) = (half_edge / 3, half_edge % 3);
        let corners = mesh.triangle_positions(t);
        let triangles = [t as u32, other / 3];
        // Once for its two half-edges.
        (other != NONE && half_edge < other as usize)
            .then(|| Edge { triangles, length: corners[k].distance(corners[(k + 1) % 3]) })
    };
    across.iter().enumerate().filter_map(edge).collect()
}

/// A mesh is divided into about so many atoms, or more where normals differ; one of fewer triangles has an atom for each.
const ATOMS: usize = 1 << 13;

/// The atom of every triangle, numbered from 0 in the order of their first triangles. From the first triangle that has none an atom grows ring
/// by ring over those that its mean normal faces by [`STEEPEST_DEGREES`] at most. `facets`: normals, as long as twice the areas.
fn atoms(facets: &[Vec3], across: &[u32]) -> Vec<u32> {
    let (most, least) = (facets.len() / ATOMS, STEEPEST_DEGREES.to_radians().cos());
    let mut atoms = vec![NONE; facets.len()];
    let (mut count, mut members) = (0, Vec::new());
    for seed in 0..facets.len() {
        if atoms[seed] != NONE {
            continue;
        }
        atoms[seed] = count;
        members.clear();
        members.push(seed as u32);
        let (mut facing, mut next) = (facets[seed], 0);
        while next < members.len() && members.len() < most {
            let first = 3 * members[next] as usize;
            next += 1;
            for other in
                across[first..first + 3].iter().filter(|&&other| other != NONE).map(|other| other / 3)
            {
                let facet = facets[other as usize];
                if atoms[other as usize] == NONE
                    && facing.dot(facet) >= least * facing.length() * facet.length()
                {
                    atoms[other as usize] = count;
                    members.push(other);
                    facing += facet;
                }
            }
        }
        count += 1;
    }
    atoms
}

// ---- Joining neighbouring pieces that one projection can show.

/// Pieces are joined while all but a [`STEEP_SHARE`] of their area is turned away from the common direction by at most this many degrees: a
/// texel then covers at most 1.4 times its length.
const MAX_DEGREES: f32 = 45.0;

/// The share of a piece's area that may be turned away more: on a bumpy surface single triangles would keep pieces small.
const STEEP_SHARE: f32 = 0.03;

/// No triangle is turned away more, degrees: a texel then covers twice its length.
const STEEPEST_DEGREES: f32 = 60.0;

/// Crumbs may be turned away more: they are not worth charts of their own.
const MAX_DEGREES_OF_CRUMBS: f32 = 68.0;

/// Pieces with less area than a square of this many texels are crumbs.
const CRUMB_TEXELS: f32 = 24.0;

/// A connected set of triangles that one direction sees.
#[derive(Clone, Debug)]
struct Patch {
    /// Ascending.
    triangles: Vec<u32>,
    /// Mean normal, unit.
    direction: Vec3,
}

#[derive(Clone, Debug, Default)]
struct Piece {
    normals: NormalSet,
    /// Sum of the normals of its triangles by twice their area.
    facing: Vec3,
    area: f32,
    /// When unions with all its neighbours were planned last.
    known_area: f32,
    perimeter: f32,
    borders: BTreeMap<u32, f32>,
    /// Counts its changes; what was planned before is void.
    version: u32,
}

fn join(
    mesh: &Mesh,
    facets: &[Vec3],
    atoms: &[u32],
    edges: &[Edge],
    texels_per_unit: f32,
    progress: &LayoutProgress<'_>,
) -> Vec<Patch> {
    let mut joiner = Joiner::new(mesh, facets, atoms, edges);
    joiner.run([MAX_DEGREES, STEEPEST_DEGREES], f32::INFINITY, progress);
    joiner.run([MAX_DEGREES_OF_CRUMBS; 2], (CRUMB_TEXELS / texels_per_unit).powi(2), progress);
    joiner.patches(atoms)
}

struct Joiner {
    pieces: Vec<Piece>,
    parents: Vec<u32>,
}

impl Joiner {
    fn new(mesh: &Mesh, facets: &[Vec3], atoms: &[u32], edges: &[Edge]) -> Self {
        let count = atoms.iter().max().map_or(0, |&last| last as usize + 1);
        let mut pieces = vec![Piece::default(); count];
        for (t, (&atom, &normal)) in atoms.iter().zip(facets).enumerate() {
            let piece = &mut pieces[atom as usize];
            piece.facing += normal;
            piece.area += 0.5 * normal.length();
            piece.normals.insert(normal);
            let [a, b, c] = mesh.triangle_positions(t);
            piece.perimeter += a.distance(b) + b.distance(c) + c.distance(a);
        }
        for edge in edges {
            let [a, b] = edge.triangles.map(|t| atoms[t as usize]);
            if a == b {
                pieces[a as usize].perimeter -= 2.0 * edge.length;
            } else {
                *pieces[a as usize].borders.entry(b).or_default() += edge.length;
                *pieces[b as usize].borders.entry(a).or_default() += edge.length;
            }
        }
        Self { pieces, parents: (0..count as u32).collect() }
    }

    /// Makes the cheapest union as long as there is one in which no normal is farther from the mean than the angles (most normals, all
    /// normals) and one of the two pieces is not larger than `largest_area`; until `progress` is cancelled.
    fn run(&mut self, degrees: [f32; 2], largest_area: f32, progress: &LayoutProgress<'_>) {
        let limits = (degrees.map(|angle| angle.to_radians().cos()), largest_area);
        let mut plans = BinaryHeap::new();
        for a in 0..self.pieces.len() as u32 {
            if self.parents[a as usize] == a {
                let later = self.pieces[a as usize].borders.range(a + 1..);
                plans.extend(later.filter_map(|(&b, _)| self.plan(a, b, limits)));
            }
        }
        while let Some(Plan { pieces: [a, b], versions, .. }) = plans.pop()
            && !progress.is_cancelled()
        {
            if [a, b].iter().any(|&i| self.parents[i as usize] != i) {
                continue;
            }
            if [a, b].map(|i| self.pieces[i as usize].version) != versions {
                // Made before one of them grew.
                plans.extend(self.plan(a, b, limits));
                continue;
            }
            let (joined, changed) = self.unite([a, b]);
            plans.extend(changed.into_iter().filter_map(|b| self.plan(joined, b, limits)));
        }
    }

    /// The union of two neighbours, if it is allowed: flat ones with a long common border first.
    fn plan(&self, a: u32, b: u32, ([most, all], largest_area): ([f32; 2], f32)) -> Option<Plan> {
        let [first, second] = [&self.pieces[a as usize], &self.pieces[b as usize]];
        if first.area.min(second.area) > largest_area {
            return None;
        }
        let direction = (first.facing + second.facing).try_normalize()?;
        let cosine = first.normals.facing(&second.normals, direction, [most, all])?;
        let border = first.borders.get(&b).copied().unwrap_or(0.0);
        let share = border / first.perimeter.min(second.perimeter).max(f32::MIN_POSITIVE);
        let cost = 2.0 * (1.0 - cosine) + (1.0 - share);
        Some(Plan { cost: f64::from(cost), pieces: [a, b], versions: [first.version, second.version] })
    }

    /// Joins two pieces into that with more neighbours. Returns it, and the neighbours to look at anew: those of the other one, and all of
    /// them where the piece has [grown](GROWTH_OF_ALL) since they were.
    fn unite(&mut self, [a, b]: [u32; 2]) -> (u32, Vec<u32>) {
        let neighbours = |i: u32| self.pieces[i as usize].borders.len();
        let (kept, gone) = if neighbours(a) >= neighbours(b) { (a, b) } else { (b, a) };
        let lost = std::mem::take(&mut self.pieces[gone as usize]);
        self.parents[gone as usize] = kept;
        for (&neighbour, &length) in &lost.borders {
            let theirs = &mut self.pieces[neighbour as usize].borders;
            theirs.remove(&gone);
            if neighbour != kept {
                *theirs.entry(kept).or_default() += length;
                *self.pieces[kept as usize].borders.entry(neighbour).or_default() += length;
            }
        }
        let piece = &mut self.pieces[kept as usize];
        let border = lost.borders.get(&kept).copied().unwrap_or(0.0);
        piece.normals = piece.normals.union(&lost.normals);
        piece.facing += lost.facing;
        piece.area += lost.area;
        piece.perimeter += lost.perimeter - 2.0 * border;
        piece.version += 1;
        let changed = match piece.area > GROWTH_OF_ALL * piece.known_area {
            true => {
                piece.known_area = piece.area;
                piece.borders.keys().copied().collect()
            }
            false => lost.borders.into_keys().filter(|&n| n != kept).collect(),
        };
        (kept, changed)
    }

    /// The pieces, in the order of their first triangles.
    fn patches(self, atoms: &[u32]) -> Vec<Patch> {
        let mut numbers = vec![usize::MAX; self.pieces.len()];
        let mut patches: Vec<Patch> = Vec::new();
        for (t, &atom) in atoms.iter().enumerate() {
            let mut piece = atom as usize;
            while self.parents[piece] as usize != piece {
                piece = self.parents[piece] as usize;
            }
            if numbers[piece] == usize::MAX {
                numbers[piece] = patches.len();
                let direction = self.pieces[piece].facing.normalize_or(Vec3::Z);
                patches.push(Patch { triangles: Vec::new(), direction });
            }
            patches[numbers[piece]].triangles.push(t as u32);
        }
        patches
    }
}

// ---- Sets of directions, coarse and of constant size.

/// Cells along a side of the octahedral map (Q. Meyer et al., "On Floating-Point Normal Vectors", 2010): a cell is within 8 degrees of its middle.
const CELLS: usize = 32;

/// How much of a piece's area has normals in which cell of the sphere: what one projection can show is decided by these, and they are
/// joined without looking at triangles again.
#[derive(Clone, Debug, Default)]
struct NormalSet {
    /// Cell and area, ascending by cell.
    cells: Vec<(u16, f32)>,
}

impl NormalSet {
    /// Adds a normal, as long as its triangle's area.
    fn insert(&mut self, normal: Vec3) {
        let n = normal / normal.abs().element_sum().max(f32::MIN_POSITIVE);
        let mut p = n.truncate();
        if n.z < 0.0 {
            p = folded(p);
        }
        let cell = |c: f32| ((c * 0.5 + 0.5) * CELLS as f32).clamp(0.0, CELLS as f32 - 1.0) as usize;
        let index = (cell(p.y) * CELLS + cell(p.x)) as u16;
        match self.cells.binary_search_by_key(&index, |cell| cell.0) {
            Ok(found) => self.cells[found].1 += normal.length(),
            Err(place) => self.cells.insert(place, (index, normal.length())),
        }
    }

    fn union(&self, other: &Self) -> Self {
        let mut cells = Vec::with_capacity(self.cells.len() + other.cells.len());
        let (mut one, mut two) = (&self.cells[..], &other.cells[..]);
        while let ([a, one_rest @ ..], [b, two_rest @ ..]) = (one, two) {
            cells.push(match a.0.cmp(&b.0) {
                Ordering::Less => *a,
                Ordering::Equal => (a.0, a.1 + b.1),
                Ordering::Greater => *b,
            });
            (one, two) = (if a.0 <= b.0 { one_rest } else { one }, if b.0 <= a.0 { two_rest } else { two });
        }
        cells.extend(one.iter().chain(two));
        Self { cells }
    }

    /// The cosine between a unit direction and the middles of the cells that all but a [`STEEP_SHARE`] of the area of both sets exceeds;
    /// none where that is below `most`, or any is below `all`.
    fn facing(&self, other: &Self, direction: Vec3, [most, all]: [f32; 2]) -> Option<f32> {
        let both = || self.cells.iter().chain(&other.cells);
        let cosine = |cell: u16| direction.dot(middle(cell));
        let (mut area, mut steep) = (0.0, 0.0);
        for &(cell, share) in both() {
            let cosine = cosine(cell);
            if cosine < all {
                return None;
            }
            area += share;
            steep += if cosine < most { share } else { 0.0 };
        }
        // Most pairs end here. Those that rounding decides do not.
        if steep > SURELY * STEEP_SHARE * area {
            return None;
        }
        let mut cosines: Vec<(f32, f32)> = both().map(|&(cell, area)| (cosine(cell), area)).collect();
        cosines.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut rest = STEEP_SHARE * cosines.iter().map(|cosine| cosine.1).sum::<f32>();
        let steep = cosines.iter().find(|cosine| {
            rest -= cosine.1;
            rest < 0.0
        });
        steep.or(cosines.last()).map(|cosine| cosine.0).filter(|&cosine| cosine >= most)
    }
}

/// Sums that differ by this factor do so beyond rounding.
const SURELY: f32 = 1.001;

/// The lower half of the octahedron is folded outwards.
fn folded(p: Vec2) -> Vec2 {
    (1.0 - p.yx().abs()) * Vec2::ONE.copysign(p)
}

/// The direction in the middle of a cell.
fn middle(cell: u16) -> Vec3 {
    static MIDDLES: LazyLock<Vec<Vec3>> = LazyLock::new(|| {
        let coordinate = |cell: usize| (cell as f32 + 0.5) / CELLS as f32 * 2.0 - 1.0;
        let middle = |index: usize| {
            let p = Vec2::new(coordinate(index % CELLS), coordinate(index / CELLS));
            let z = 1.0 - p.x.abs() - p.y.abs();
            let p = if z < 0.0 { folded(p) } else { p };
            p.extend(z).normalize_or(Vec3::Z)
        };
        (0..CELLS * CELLS).map(middle).collect()
    });
    MIDDLES[usize::from(cell)]
}

// ---- Cutting patches whose projection overlaps itself.

/// Triangles that the common direction sees worse than this get charts of their own.
const MIN_FACING_OF_CHART: f32 = 0.2;

/// Cells along the longer side of a patch in which overlaps are looked for, at most.
const MAX_CELLS: f32 = 4096.0;

/// How much a triangle is shrunk before its cells are taken, so that neighbours never meet: share of a cell.
const SHRINK: f32 = 1e-3;

fn is_all(is_taken: &[bool]) -> bool {
    is_taken.iter().all(|&is| is)
}

/// Cuts charts into some that do not overlap themselves.
struct Cutter<'a> {
    mesh: &'a Mesh,
    across: &'a [u32],
    texels_per_unit: f32,
    /// In the charts, of which each triangle is in one.
    slots: Slots,
}

impl<'a> Cutter<'a> {
    fn new(mesh: &'a Mesh, across: &'a [u32], texels_per_unit: f32) -> Self {
        Self { mesh, across, texels_per_unit, slots: Slots::new(mesh.triangles.len()) }
    }

    fn charts_of(&self, patch: Patch) -> Vec<Chart> {
        let normal = |t: u32| facet_normal(self.mesh, t as usize);
        let is_seen = |t: &u32| normal(*t).dot(patch.direction) >= MIN_FACING_OF_CHART;
        let (seen, hidden): (Vec<u32>, Vec<u32>) = patch.triangles.into_iter().partition(is_seen);
        let mut charts = Vec::new();
        if !seen.is_empty() {
            charts = self.cut(Chart::projected(self.mesh, seen, patch.direction), false);
        }
        charts.extend(hidden.into_iter().map(|t| Chart::projected(self.mesh, vec![t], normal(t))));
        charts
    }

    /// Cuts a chart into some that hang together and do not overlap themselves. `is_whole` where it hangs together.
    fn cut(&self, chart: Chart, is_whole: bool) -> Vec<Chart> {
        let mut charts = Vec::new();
        let mut waiting = if is_whole { vec![chart] } else { self.connected(chart) };
        while let Some(chart) = waiting.pop() {
            let is_taken = self.first_part(&chart);
            if is_all(&is_taken) {
                charts.push(chart);
                continue;
            }
            for which in [false, true] {
                let part = chart.iter().zip(&is_taken).filter(|(_, is)| **is == which);
                let (triangles, corners) = part.map(|(triangle, _)| triangle).unzip();
                waiting.extend(self.connected(Chart::new(triangles, corners)));
            }
        }
        charts
    }

    /// The parts of a chart that hang together: only of such a one its border tells whether it overlaps itself.
    fn connected(&self, chart: Chart) -> Vec<Chart> {
        let mut sets = UnionFind::new(chart.triangles.len());
        for_each_side(&chart, self.across, &self.slots, |index, _, beyond| {
            if let Some(beyond) = beyond {
                sets.union(index as u32, beyond as u32);
            }
        });
        let mut part_of = Vec::new();
        let count = sets.number(&mut part_of);
        if count < 2 {
            return vec![chart];
        }
        let mut parts = vec![(Vec::new(), Vec::new()); count];
        for (&part, (triangle, corners)) in part_of.iter().zip(chart.iter()) {
            let (triangles, places) = &mut parts[part as usize];
            triangles.push(triangle);
            places.push(corners);
        }
        parts.into_iter().map(|(triangles, corners)| Chart::new(triangles, corners)).collect()
    }

    /// Which triangles of a chart that hangs together come into its first part, all of them where it does not overlap itself.
    fn first_part(&self, chart: &Chart) -> Vec<bool> {
        let uncrossed = without_crossings(chart, self.across, &self.slots);
        if is_all(&uncrossed) {
            return uncrossed;
        }
        // Much of it first, where it overlaps widely.
        let in_cells = without_overlap(self.mesh, chart, self.texels_per_unit);
        if is_all(&in_cells) { uncrossed } else { in_cells }
    }
}

/// Which triangles share no cell; taken in the order in which they hang together, so that what is left over hangs together as well.
fn without_overlap(mesh: &Mesh, chart: &Chart, texels_per_unit: f32) -> Vec<bool> {
    let longest = chart.extent.max_element();
    let cells_per_unit = texels_per_unit.min(MAX_CELLS / longest.max(f32::MIN_POSITIVE));
    let width = (chart.extent.x * cells_per_unit) as usize + 2;
    let height = (chart.extent.y * cells_per_unit) as usize + 2;
    let mut is_taken = vec![0u64; (width * height).div_ceil(64)];
    let mut accepted = vec![false; chart.triangles.len()];
    let mut cells = Vec::new();
    for i in connected_order(mesh, &chart.triangles) {
        cells.clear();
        let corners = chart.corners[i as usize].map(|q| q * cells_per_unit);
        visit_cells(corners, |cell| cells.push(cell.y as usize * width + cell.x as usize));
        if cells.iter().all(|&c| is_taken[c / 64] >> (c % 64) & 1 == 0) {
            cells.iter().for_each(|&c| is_taken[c / 64] |= 1 << (c % 64));
            accepted[i as usize] = true;
        }
    }
    accepted
}

/// The indices of triangles, each after one that it shares a vertex with, as far as they hang together.
fn connected_order(mesh: &Mesh, triangles: &[u32]) -> Vec<u32> {
    // Vertices, and the corners at each; in one number, which is sorted faster than a pair.
    let vertices = triangles.iter().flat_map(|&t| mesh.triangles[t as usize]);
    let mut around: Vec<u64> =
        (0u64..).zip(vertices).map(|(corner, v)| u64::from(v) << 32 | corner).collect();
    around.sort_unstable();
    let corner_of = |entry: u64| entry as u32 as usize;
    // Of every corner where its vertex' corners begin.
    let mut first_of = vec![0u32; around.len()];
    let mut first = 0;
    for at_vertex in around.chunk_by(|a, b| a >> 32 == b >> 32) {
        at_vertex.iter().for_each(|&entry| first_of[corner_of(entry)] = first);
        first += at_vertex.len() as u32;
    }
    let mut is_done = vec![false; around.len()];
    let mut order = Vec::with_capacity(triangles.len());
    let mut is_seen = vec![false; triangles.len()];
    for start in 0..triangles.len() {
        if std::mem::replace(&mut is_seen[start], true) {
            continue;
        }
        let mut next = order.len();
        order.push(start as u32);
        while next < order.len() {
            let corner = 3 * order[next] as usize;
            next += 1;
            for first in first_of[corner..corner + 3].iter().map(|&first| first as usize) {
                // A vertex' triangles are needed once.
                if std::mem::replace(&mut is_done[first], true) {
                    continue;
                }
                let vertex = around[first] >> 32;
                for &entry in around[first..].iter().take_while(|&entry| entry >> 32 == vertex) {
                    let i = corner_of(entry) / 3;
                    if !std::mem::replace(&mut is_seen[i], true) {
                        order.push(i as u32);
                    }
                }
            }
        }
    }
    order
}

/// So many cells of a row are looked at faster than it is found out which of them a triangle reaches.
pub(crate) const NARROW: u32 = 6;

/// Visits the cells whose middles lie inside a triangle (in cells), not on its border.
pub(crate) fn visit_cells(corners: [Vec2; 3], mut visit: impl FnMut(IVec2)) {
    let [a, b, c] = corners;
    let area = (b - a).perp_dot(c - a);
    // No number where cells have no size.
    if area.is_nan() || area.abs() < 1e-9 {
        return;
    }
    let sides =
        [[b, c], [c, a], [a, b]].map(|[from, to]| (from, (to - from).normalize_or_zero() * area.signum()));
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let (first, last) = ((low - 0.5).ceil().as_ivec2(), (high - 0.5).floor().as_ivec2());
    let is_narrow = last.x < first.x.saturating_add(NARROW as i32);
    for y in first.y..=last.y {
        let row = y as f32 + 0.5;
        let (mut from, mut to) = (first.x, last.x);
        if !is_narrow {
            let Some([left, right]) = span(corners.map(|p| p.to_array()), row - SPAN_SLACK, row + SPAN_SLACK)
            else {
                continue;
            };
            (from, to) = (from.max((left - 1.5).floor() as i32), to.min((right + 0.5).ceil() as i32));
        }
        for x in from..=to {
            let p = Vec2::new(x as f32 + 0.5, row);
            if sides.iter().all(|(from, along)| along.perp_dot(p - *from) > SHRINK) {
                visit(IVec2::new(x, y));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_knows_its_normals_to_a_few_degrees() {
        for i in 0..1000 {
            let angle = i as f32;
            let z = (i as f32 / 500.0) - 1.0;
            let r = (1.0 - z * z).max(0.0).sqrt();
            let normal = Vec3::new(r * angle.cos(), r * angle.sin(), z);
            let mut set = NormalSet::default();
            set.insert(normal);
            let off = set.facing(&set, normal, [-1.0; 2]).unwrap().acos().to_degrees();
            assert!(off < 8.0, "{normal}: {off} degrees");
        }
    }

    /// A strip that winds one and a half times around the z axis, slowly rising: it overlaps itself seen from above.
    fn helix() -> Mesh {
        let steps = 48;
        let mut mesh = Mesh::default();
        for i in 0..=steps {
            let angle = i as f32 / 32.0 * std::f32::consts::TAU;
            let z = i as f32 * 0.005;
            for radius in [0.4, 0.9] {
                mesh.positions.push(Vec3::new(radius * angle.cos(), radius * angle.sin(), z));
            }
        }
        for i in 0..steps {
            mesh.triangles.extend([[2 * i, 2 * i + 1, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 2]]);
        }
        mesh
    }

    #[test]
    fn a_winding_strip_is_cut_where_it_comes_round() {
        let mesh = helix();
        let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let patch = Patch { triangles: all.clone(), direction: Vec3::Z };
        let charts = Cutter::new(&mesh, &continued(&mesh), 200.0).charts_of(patch);
        assert_eq!(charts.len(), 2);
        let mut triangles: Vec<u32> = charts.iter().flat_map(|c| c.triangles.clone()).collect();
        triangles.sort_unstable();
        assert_eq!(triangles, all);
    }

    /// Triangles alike that overlap by less than a cell are cut apart, and cutting ends.
    #[test]
    fn triangles_alike_that_cross_get_charts_of_their_own() {
        let triangle = |x: f32, y: f32| [[x, y], [x + 1.0, y + 2.0], [x + 2.0, y]].map(Vec2::from);
        let mesh = Mesh { triangles: vec![[0, 1, 2], [3, 4, 5]], ..Mesh::default() };
        let chart = Chart::new(vec![0, 1], vec![triangle(0.0, 0.0), triangle(0.5, 1.75)]);
        let charts = Cutter::new(&mesh, &continued(&mesh), 0.01).cut(chart, true);
        let triangles: Vec<_> = charts.into_iter().map(|chart| chart.triangles).collect();
        assert_eq!(triangles, [[0], [1]]);
    }

    /// A triangle inside another one crosses no border, and may be smaller than any cell.
    #[test]
    fn triangles_inside_others_get_charts_of_their_own() {
        let triangle = |x: f32, size: f32| [[x, x], [x + size, x + 2.0 * size], [x + 2.0 * size, x]];
        let corners =
            [triangle(0.0, 1.0), triangle(0.8, 0.1)].map(|corners| corners.map(Vec2::from)).to_vec();
        let mesh = Mesh { triangles: vec![[0, 1, 2], [3, 4, 5]], ..Mesh::default() };
        let across = continued(&mesh);
        let charts = Cutter::new(&mesh, &across, 0.01).cut(Chart::new(vec![0, 1], corners), false);
        let mut triangles: Vec<_> = charts.into_iter().map(|chart| chart.triangles).collect();
        triangles.sort_unstable();
        assert_eq!(triangles, [[0], [1]]);
    }

    #[test]
    fn neighbours_share_no_cell() {
        let mut count = vec![0; 100];
        for corners in [[[0.0, 0.0], [9.3, 0.0], [9.3, 9.3]], [[0.0, 0.0], [9.3, 9.3], [0.0, 9.3]]] {
            visit_cells(corners.map(Vec2::from), |c| count[(c.y * 10 + c.x) as usize] += 1);
        }
        assert!(count.iter().all(|&n| n <= 1));
        assert!(count.iter().sum::<i32>() > 70);
    }
}
