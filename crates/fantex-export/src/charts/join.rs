//! Joining neighbouring pieces that one projection can show.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

use fantex_mesh::Mesh;
use glam::Vec3;

use super::normal_set::NormalSet;
use super::{Edge, facet, root};

/// Pieces are joined while no triangle is turned away from the common direction by more than this, degrees: a texel then
/// covers at most 1.4 times its length.
const WIDEST_DEGREES: f32 = 45.0;

/// Crumbs may be turned away more: they are not worth charts of their own.
const WIDEST_DEGREES_OF_CRUMBS: f32 = 68.0;

/// Pieces with less area than a square of this many texels are crumbs.
const CRUMB_TEXELS: f32 = 24.0;

/// A connected set of triangles that one direction sees.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// Ascending.
    pub(super) triangles: Vec<u32>,
    /// Mean normal, unit.
    pub(super) direction: Vec3,
}

/// A piece while pieces are joined.
#[derive(Clone, Debug, Default)]
struct Piece {
    normals: NormalSet,
    /// Sum of the normals of its triangles by twice their area.
    facing: Vec3,
    area: f32,
    perimeter: f32,
    /// Length of the border with each neighbour.
    borders: BTreeMap<u32, f32>,
    /// Counts its changes; what was planned before is void.
    version: u32,
}

/// A union that may be made. Ordered so that the heap gives the cheapest first.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plan {
    cost: f32,
    pieces: [u32; 2],
    versions: [u32; 2],
}

impl Eq for Plan {}

impl Ord for Plan {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then_with(|| other.pieces.cmp(&self.pieces))
    }
}

impl PartialOrd for Plan {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Joins atoms (given by triangle) into patches.
pub(super) fn join(mesh: &Mesh, atoms: &[u32], edges: &[Edge], texels_per_unit: f32) -> Vec<Patch> {
    let mut joiner = Joiner::new(mesh, atoms, edges);
    joiner.run(WIDEST_DEGREES, f32::INFINITY);
    joiner.run(WIDEST_DEGREES_OF_CRUMBS, (CRUMB_TEXELS / texels_per_unit).powi(2));
    joiner.patches(atoms)
}

struct Joiner {
    pieces: Vec<Piece>,
    parents: Vec<u32>,
}

impl Joiner {
    fn new(mesh: &Mesh, atoms: &[u32], edges: &[Edge]) -> Self {
        let count = atoms.iter().max().map_or(0, |&last| last as usize + 1);
        let mut pieces = vec![Piece::default(); count];
        for (t, &atom) in atoms.iter().enumerate() {
            let piece = &mut pieces[atom as usize];
            let normal = facet(mesh, t);
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

    /// Makes the cheapest union as long as there is one in which no normal is farther than `widest_degrees` from the
    /// mean and one of the two pieces is not larger than `largest_area`.
    fn run(&mut self, widest_degrees: f32, largest_area: f32) {
        let limits = (widest_degrees.to_radians().cos(), largest_area);
        let mut plans = BinaryHeap::new();
        for a in 0..self.pieces.len() as u32 {
            if self.parents[a as usize] == a {
                let later = self.pieces[a as usize].borders.range(a + 1..);
                plans.extend(later.filter_map(|(&b, _)| self.plan(a, b, limits)));
            }
        }
        while let Some(plan) = plans.pop() {
            let is_current = |k: usize| {
                let index = plan.pieces[k] as usize;
                self.parents[index] == plan.pieces[k] && self.pieces[index].version == plan.versions[k]
            };
            if is_current(0) && is_current(1) {
                let joined = self.unite(plan.pieces);
                let neighbours = self.pieces[joined as usize].borders.keys();
                plans.extend(neighbours.filter_map(|&b| self.plan(joined, b, limits)));
            }
        }
    }

    /// The union of two neighbours, if it is allowed: flat ones with a long common border first.
    fn plan(&self, a: u32, b: u32, (least_cosine, largest_area): (f32, f32)) -> Option<Plan> {
        let [first, second] = [&self.pieces[a as usize], &self.pieces[b as usize]];
        if first.area.min(second.area) > largest_area {
            return None;
        }
        let direction = (first.facing + second.facing).try_normalize()?;
        let cosine = first.normals.least_cosine(direction).min(second.normals.least_cosine(direction));
        if cosine < least_cosine {
            return None;
        }
        let border = first.borders.get(&b).copied().unwrap_or(0.0);
        let share = border / first.perimeter.min(second.perimeter).max(f32::MIN_POSITIVE);
        let cost = 2.0 * (1.0 - cosine) + (1.0 - share);
        Some(Plan { cost, pieces: [a, b], versions: [first.version, second.version] })
    }

    /// Joins two pieces into that with more neighbours, and returns it.
    fn unite(&mut self, [a, b]: [u32; 2]) -> u32 {
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
        kept
    }

    /// The pieces, in the order of their first triangles.
    fn patches(mut self, atoms: &[u32]) -> Vec<Patch> {
        let mut numbers = vec![usize::MAX; self.pieces.len()];
        let mut patches: Vec<Patch> = Vec::new();
        for (t, &atom) in atoms.iter().enumerate() {
            let piece = root(&mut self.parents, atom) as usize;
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
