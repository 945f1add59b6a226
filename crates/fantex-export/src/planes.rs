//! Where the pieces of a surface lie in their planes, and how two of them are laid side by side.

use fantex_base::UnionFind;
use fantex_mesh::Mesh;
use glam::{DVec2, Vec2};
use rustc_hash::FxHashMap;

use crate::charts::{NONE, doubled_area};

/// A triangle goes over to the other side of a seam if it has less strain per area there.
const MAX_STRAIN_OF_FILL: f64 = 0.1;

/// Two places of a vertex are one within this share of its shorter edge: they come from one point, up to rounding.
const SAME_POINT: f64 = 1e-3;

/// The surface and where it lies.
pub(crate) struct Planes<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) across: &'a [u32],
    /// Half-edges beyond which the same piece goes on without a seam.
    pub(crate) is_glued: Vec<bool>,
    /// Where the corners of each triangle lie in the plane of its piece, counter-clockwise, mesh units.
    pub(crate) flat: Vec<[Vec2; 3]>,
}

/// A turn and a shift that bring one piece beside another.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub(crate) turn: DVec2,
    pub(crate) shift: DVec2,
}

impl Motion {
    pub(crate) fn apply(&self, p: Vec2) -> Vec2 {
        (self.turn.rotate(p.as_dvec2()) + self.shift).as_vec2()
    }
}

/// Common half-edges that are laid on each other.
pub(crate) struct Fit {
    pub(crate) motion: Motion,
    /// Of the first piece.
    pub(crate) half_edges: Vec<u32>,
    /// Mesh units.
    pub(crate) length: f64,
    /// Root mean square distance of their ends, mesh units.
    pub(crate) misfit: f64,
}

/// The length of a half-edge, and where one of its ends lies on this and on the other side.
type Pair = (f64, [DVec2; 2]);

fn misfit(pairs: impl IntoIterator<Item = Pair>, motion: &Motion) -> f64 {
    let (mut length, mut sum) = (0.0, 0.0);
    for (weight, [p, q]) in pairs {
        length += weight;
        sum += weight * (motion.turn.rotate(q) + motion.shift).distance_squared(p);
    }
    (sum / length).sqrt()
}

impl Planes<'_> {
    pub(crate) fn length(&self, half_edge: u32) -> f64 {
        let corners = self.mesh.triangles[half_edge as usize / 3];
        let [a, b] = [0, 1].map(|i| self.mesh.positions[corners[(half_edge as usize % 3 + i) % 3] as usize]);
        f64::from(a.distance(b))
    }

    /// Area of triangles on the surface.
    pub(crate) fn area(&self, triangles: &[u32]) -> f64 {
        triangles.iter().map(|&t| 0.5 * f64::from(doubled_area(self.mesh, t as usize))).sum()
    }

    /// Where a half-edge begins and ends in the plane.
    pub(crate) fn ends(&self, half_edge: u32) -> [DVec2; 2] {
        let corners = &self.flat[half_edge as usize / 3];
        [0, 1].map(|i| corners[(half_edge as usize % 3 + i) % 3].as_dvec2())
    }

    /// The motion that brings what is beyond half-edges as near to them as it goes, by least squares (P. H. Schoenemann, "A Generalized Solution
    /// of the Orthogonal Procrustes Problem", 1966).
    pub(crate) fn fit(&self, half_edges: &[u32]) -> Fit {
        let pairs: Vec<Pair> = self.pairs(half_edges).collect();
        let (mut length, mut here, mut there) = (0.0, DVec2::ZERO, DVec2::ZERO);
        for &(weight, [p, q]) in &pairs {
            length += weight;
            here += weight * p;
            there += weight * q;
        }
        let [here, there] = [here, there].map(|sum| sum / length);
        let mut turn = DVec2::ZERO;
        for &(weight, [p, q]) in &pairs {
            let (p, q) = (p - here, q - there);
            turn += weight * DVec2::new(q.dot(p), q.perp_dot(p));
        }
        let turn = turn.normalize_or(DVec2::X);
        let motion = Motion { turn, shift: here - turn.rotate(there) };
        let misfit = misfit(pairs, &motion);
        // Every edge has two ends.
        Fit { motion, half_edges: half_edges.to_vec(), length: 0.5 * length, misfit }
    }

    /// Root mean square distance of the ends of half-edges from those beyond, after a motion.
    pub(crate) fn misfit(&self, half_edges: &[u32], motion: &Motion) -> f64 {
        misfit(self.pairs(half_edges), motion)
    }

    fn pairs(&self, half_edges: &[u32]) -> impl Iterator<Item = Pair> {
        half_edges.iter().flat_map(|&half_edge| {
            let weight = self.length(half_edge);
            let ([a, b], [d, c]) = (self.ends(half_edge), self.ends(self.across[half_edge as usize]));
            [(weight, [a, c]), (weight, [b, d])]
        })
    }

    /// Half-edges in parts that share vertices.
    pub(crate) fn connected(&self, half_edges: &[u32]) -> Vec<Vec<u32>> {
        let mut sets = UnionFind::new(half_edges.len());
        let mut seen: FxHashMap<u32, u32> = FxHashMap::default();
        for (i, &half_edge) in (0u32..).zip(half_edges) {
            let corners = self.mesh.triangles[half_edge as usize / 3];
            for vertex in [0, 1].map(|k| corners[(half_edge as usize % 3 + k) % 3]) {
                sets.union(i, *seen.entry(vertex).or_insert(i));
            }
        }
        let mut part_of = Vec::new();
        let mut parts = vec![Vec::new(); sets.number(&mut part_of)];
        part_of.iter().zip(half_edges).for_each(|(&part, &half_edge)| parts[part as usize].push(half_edge));
        parts
    }

    /// A piece between two edges of which a triangle fits, where it lies there, and which of its edges becomes a seam instead of these two.
    pub(crate) fn better_place(&self, t: u32, piece_of: &[u32]) -> Option<(u32, [Vec2; 3], usize)> {
        let half_edges = [3 * t, 3 * t + 1, 3 * t + 2].map(|h| h as usize);
        let is_seam = |k: usize| self.across[half_edges[k]] != NONE && !self.is_glued[half_edges[k]];
        // The two edges meet at the corner opposite of the third, `kept`.
        (0..3).find_map(|kept| {
            let [first, second] = [(kept + 1) % 3, (kept + 2) % 3];
            if !(is_seam(first) && is_seam(second)) {
                return None;
            }
            let [one, other] = [first, second].map(|k| self.across[half_edges[k]]);
            let piece = piece_of[one as usize / 3];
            if piece != piece_of[other as usize / 3] {
                return None;
            }
            let ([top, begin], [end, again]) = (self.ends(one), self.ends(other));
            let [a, b] = [begin, end].map(|p| p.distance(top));
            if top.distance(again) > SAME_POINT * a.min(b) {
                return None;
            }
            let mut corners = [Vec2::ZERO; 3];
            corners[first] = begin.as_vec2();
            corners[second] = top.as_vec2();
            corners[kept] = end.as_vec2();
            let upright = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]) > 0.0;
            let (area, strain) = self.area_and_strain(t, corners);
            (upright && strain <= MAX_STRAIN_OF_FILL * area).then_some((piece, corners, kept))
        })
    }

    /// The area of a triangle, and what it counts in [`Sheet::strain`] where its corners lie.
    pub(crate) fn area_and_strain(&self, triangle: u32, corners: [Vec2; 3]) -> (f64, f64) {
        let [a, b, c] = self.mesh.triangle_positions(triangle as usize).map(|p| p.as_dvec3());
        let [p, q, r] = corners.map(Vec2::as_dvec2);
        let (u, v, s, t) = (b - a, c - a, q - p, r - p);
        let doubled = u.cross(v).length();
        let flat = s.perp_dot(t);
        // Sum of the squared stretches.
        let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
        let squared = (s.length_squared() * vv - 2.0 * s.dot(t) * uv + t.length_squared() * uu)
            / (doubled * doubled).max(f64::MIN_POSITIVE);
        let determinant = flat / doubled.max(f64::MIN_POSITIVE);
        let strain = 0.25 * squared * (1.0 + determinant.powi(-2)) - 1.0;
        (0.5 * doubled, 0.5 * doubled * strain.max(0.0))
    }
}
