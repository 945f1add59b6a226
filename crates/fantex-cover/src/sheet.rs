//! Triangles in the plane, glued along edges: laid one beside the other, and brought as near to their own shapes as their neighbours let
//! them, without turning any over.

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use glam::{DMat2, DVec2, Vec3};

use crate::crossings::{Segment, any_crossing};
use crate::injective::{OverlapFinder, Wedge};

/// Steps of the conjugate gradients in each round of the relaxation.
const STEPS: usize = 24;

/// Share of the first residual at which they end.
const TOLERANCE: f64 = 0.05;

/// A round that lowers the energy by less of itself is the last.
const MIN_GAIN: f64 = 1e-3;

/// How often a step is halved that raises the energy.
const HALVINGS: usize = 12;

/// A triangle that shrinks to less of its area counts as turned over.
const MIN_AREA: f64 = 0.02;

/// The least height of a triangle over its first edge, as a share of its longer sides. Walls of cylinders have some thousandths.
const MIN_SLENDERNESS: f64 = 1e-4;

/// A triangle of a sheet.
struct Piece {
    points: [u32; 3],
    /// Its shape in a plane of its own.
    rest: [DVec2; 3],
    /// The inverse of the edges from its first corner there.
    inverse: DMat2,
    /// What it counts.
    area: f64,
}

/// An edge in a round of the relaxation: an end gets `block` times its difference from the other end. All edges together are the matrix of the
/// quadratic stand-in, as nothing changes where all points move alike.
struct Link {
    ends: [u32; 2],
    /// A symmetric matrix: xx, xy, yy.
    block: [f64; 3],
}

/// A mesh that is laid into the plane, with its buffers for the next one.
#[derive(Default)]
pub struct Sheet {
    pieces: Vec<Piece>,
    /// `(higher point, 3 * piece + corner)`, ascending, of one lower point after the other; the edge leaves that corner.
    edges: Vec<(u32, u32)>,
    /// Of each point where the edges end of which it is the lower one.
    edge_ends: Vec<u32>,
    /// For every such half-edge the one of the triangle beyond, or `BORDER`.
    across: Vec<u32>,
    /// Of each point.
    places: Vec<DVec2>,
    /// Points that stay where they are; empty where none does.
    held: Vec<bool>,
    solver: Solver,
    links: Vec<Link>,
    /// Of every half-edge that of its edge.
    link_of: Vec<u32>,
    /// Where a step takes the points.
    moved: Vec<DVec2>,
    overlaps: OverlapFinder,
    segments: Vec<Segment>,
    wedges: Vec<Wedge>,
}

/// No triangle beyond.
const BORDER: u32 = u32::MAX;

impl Sheet {
    /// Begins a new one.
    pub fn clear(&mut self) {
        self.pieces.clear();
        self.places.clear();
        self.held.clear();
    }

    /// Adds a triangle, counter-clockwise; its area counts by as many of its corners as are told (up to 3). False where it has no area.
    pub fn push(&mut self, [a, b, c]: [Vec3; 3], points: [u32; 3], corners: usize) -> bool {
        let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
        let length = (b - a).length();
        let along = (b - a) / length;
        let x = (c - a).dot(along);
        // Slivers that are nearly segments are taken for somewhat wider ones.
        let y = (c - a - along * x).length().max(MIN_SLENDERNESS * length.max((c - a).length()));
        let rest = [DVec2::ZERO, DVec2::new(length, 0.0), DVec2::new(x, y)];
        let inverse = DMat2::from_cols(rest[1], rest[2]).inverse();
        self.pieces.push(Piece { points, rest, inverse, area: 0.5 * length * y * corners as f64 / 3.0 });
        length > 0.0 && y.is_finite()
    }

    /// Triangles.
    pub fn len(&self) -> usize {
        self.pieces.len()
    }

    /// True without triangles.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Where the points lie; those that are set are taken as they are.
    pub fn places(&mut self) -> &mut Vec<DVec2> {
        &mut self.places
    }

    /// Which points stay where they are in [`relax`](Self::relax), one for each or none.
    pub fn held(&mut self) -> &mut Vec<bool> {
        &mut self.held
    }

    /// Where the corners of a triangle lie.
    pub fn corners(&self, triangle: usize) -> [DVec2; 3] {
        self.pieces[triangle].points.map(|p| self.places[p as usize])
    }

    /// True where no triangle lies beyond a triangle's edge from corner `k` on.
    pub(crate) fn is_border(&self, triangle: usize, k: usize) -> bool {
        self.across[3 * triangle + k] == BORDER
    }

    /// The most strain per area of a triangle.
    pub fn worst_strain(&self) -> f64 {
        let strain =
            |piece: &Piece| 0.25 * energy(std::slice::from_ref(piece), &self.places) / piece.area - 1.0;
        self.pieces.iter().map(strain).fold(0.0, f64::max)
    }

    /// How far triangles are from their own shapes: area times `(s^2 + t^2 + 1/s^2 + 1/t^2) / 4 - 1` of the stretches `s`, `t`; infinite
    /// where one is turned over.
    pub fn strain(&self) -> f64 {
        let area: f64 = self.pieces.iter().map(|piece| piece.area).sum();
        0.25 * energy(&self.pieces, &self.places) - area
    }

    /// Finds which triangles meet; none where more than two do, or two in the same direction.
    pub fn find_edges(&mut self) -> Option<()> {
        let Self { pieces, edges, edge_ends, across, .. } = self;
        let half_edges = || {
            let points = pieces.iter().flat_map(|&Piece { points: [a, b, c], .. }| [(a, b), (b, c), (c, a)]);
            (0u32..).zip(points).map(|(half_edge, (a, b))| (a.min(b) as usize, (a.max(b), half_edge)))
        };
        let points = pieces.iter().flat_map(|piece| piece.points).max().map_or(0, |last| last as usize + 1);
        // Sorted by counting.
        edge_ends.clear();
        edge_ends.resize(points + 1, 0);
        half_edges().for_each(|(lower, _)| edge_ends[lower + 1] += 1);
        let mut count = 0;
        for end in edge_ends.iter_mut() {
            count += *end;
            *end = count;
        }
        edges.clear();
        edges.resize(3 * pieces.len(), (0, 0));
        // These are beginnings; filling moves each to its end.
        for (lower, edge) in half_edges() {
            edges[edge_ends[lower] as usize] = edge;
            edge_ends[lower] += 1;
        }
        across.clear();
        across.resize(edges.len(), BORDER);
        let begins = |half_edge: u32| pieces[half_edge as usize / 3].points[half_edge as usize % 3];
        let mut first = 0;
        for (lower, &end) in (0..).zip(&edge_ends[..points]) {
            let around = &mut edges[first..end as usize];
            first = end as usize;
            around.sort_unstable();
            for same in around.chunk_by(|a, b| a.0 == b.0) {
                match *same {
                    [(higher, _)] if higher != lower => {}
                    [(_, one), (_, other)] if begins(one) != begins(other) => {
                        across[one as usize] = other;
                        across[other as usize] = one;
                    }
                    _ => return None,
                }
            }
        }
        Some(())
    }

    /// Lays one triangle after the other beside one that lies already.
    pub fn hinge(&mut self, points: usize) {
        let Self { pieces, across, places, .. } = self;
        places.clear();
        places.resize(points, DVec2::NAN);
        let area = |piece: &Piece| piece.rest[1].perp_dot(piece.rest[2]);
        let Some(first) = (0..pieces.len()).max_by(|&a, &b| area(&pieces[a]).total_cmp(&area(&pieces[b])))
        else {
            return;
        };
        for (point, place) in pieces[first].points.into_iter().zip(pieces[first].rest) {
            places[point as usize] = place;
        }
        let mut is_laid = vec![false; pieces.len()];
        is_laid[first] = true;
        let mut queue = VecDeque::from([first]);
        while let Some(from) = queue.pop_front() {
            for k in 0..3 {
                let half_edge = across[3 * from + k];
                if half_edge == BORDER || is_laid[half_edge as usize / 3] {
                    continue;
                }
                let (to, corner) = (half_edge as usize / 3, half_edge as usize % 3);
                is_laid[to] = true;
                queue.push_back(to);
                let piece = &pieces[to];
                let [a, b, c] = [0, 1, 2].map(|i| (corner + i) % 3);
                let third = piece.points[c] as usize;
                if places[third].is_nan() {
                    let [begin, end] = [a, b].map(|i| places[piece.points[i] as usize]);
                    let along = (end - begin).normalize_or(DVec2::X);
                    let (edge, arm) = (piece.rest[b] - piece.rest[a], piece.rest[c] - piece.rest[a]);
                    let edge = edge.normalize();
                    places[third] = begin + along.rotate(DVec2::new(edge.dot(arm), edge.perp_dot(arm)));
                }
            }
        }
        // Points of triangles that are joined at a point only are nowhere; such groups are refused later.
    }

    /// True where all triangles lie the right way up.
    pub fn is_upright(&self) -> bool {
        self.pieces.iter().all(|piece| piece.jacobian(&self.places).determinant() > MIN_AREA)
    }

    /// Lays the border around a circle and every other point in the middle of its neighbours, which turns no triangle over (W. T. Tutte, "How
    /// to draw a graph", 1963). None where the group has holes.
    pub(crate) fn spread_in_circle(&mut self) -> Option<()> {
        let Self { pieces, across, places, solver, .. } = self;
        let ends = |half_edge: usize| {
            let piece = &pieces[half_edge / 3];
            [piece.points[half_edge % 3], piece.points[(half_edge % 3 + 1) % 3]].map(|p| p as usize)
        };
        let mut leaving = vec![usize::MAX; places.len()];
        let (mut borders, mut first) = (0, 0);
        for half_edge in (0..across.len()).filter(|&h| across[h] == BORDER) {
            let slot = &mut leaving[ends(half_edge)[0]];
            if *slot != usize::MAX {
                return None;
            }
            *slot = half_edge;
            (borders, first) = (borders + 1, half_edge);
        }
        let mut is_free = vec![false; places.len()];
        pieces.iter().flat_map(|piece| piece.points).for_each(|p| is_free[p as usize] = true);
        let points = is_free.iter().filter(|&&is| is).count();
        // Points less edges plus triangles are one; every triangle has three edges, of which two share all but those of the border.
        if borders == 0 || 2 * points != pieces.len() + borders + 2 {
            return None;
        }
        let mut around = Vec::with_capacity(borders);
        let (mut half_edge, mut length) = (first, 0.0);
        for _ in 0..borders {
            let [from, to] = ends(half_edge);
            around.push((from, length));
            let piece = &pieces[half_edge / 3];
            length += piece.rest[(half_edge % 3 + 1) % 3].distance(piece.rest[half_edge % 3]);
            half_edge = leaving[to];
            if half_edge == usize::MAX {
                return None;
            }
        }
        if half_edge != first {
            return None;
        }
        let area: f64 = pieces.iter().map(|piece| 0.5 * piece.rest[1].perp_dot(piece.rest[2])).sum();
        let radius = (area / PI).sqrt();
        places.fill(DVec2::ZERO);
        for (point, at) in around {
            let (sin, cos) = libm::sincos(TAU * at / length);
            places[point] = radius * DVec2::new(cos, sin);
            is_free[point] = false;
        }
        let mut degrees = vec![0.0; places.len()];
        pieces.iter().flat_map(|piece| piece.points).for_each(|p| degrees[p as usize] += 2.0);
        // How far a point lies from its neighbours together.
        let laplacian = |values: &[DVec2], image: &mut [DVec2]| {
            for piece in pieces.iter() {
                for k in 0..3 {
                    let [a, b] = [0, 1].map(|i| piece.points[(k + i) % 3] as usize);
                    let difference = values[b] - values[a];
                    image[b] += difference;
                    image[a] -= difference;
                }
            }
            for (image, &is_free) in image.iter_mut().zip(&is_free) {
                *image *= f64::from(is_free);
            }
        };
        let right = solver.begin(places.len());
        laplacian(places, right);
        right.iter_mut().for_each(|r| *r = -*r);
        let found = solver.solve(laplacian, &degrees, 1e-3);
        places.iter_mut().zip(found).for_each(|(place, &step)| *place += step);
        Some(())
    }

    /// Brings the triangles as near to their own shapes as their neighbours let them, and turns none over: least symmetric Dirichlet energy, by a
    /// quadratic stand-in for it in every round (M. Rabinovich and others, "Scalable Locally Injective Mappings", 2017). False where more rounds would go on.
    pub fn relax(&mut self, rounds: usize) -> bool {
        self.find_links();
        let Self { pieces, places, held, solver, links, link_of, moved, .. } = self;
        let least = 4.0 * pieces.iter().map(|piece| piece.area).sum::<f64>();
        let mut energy = energy(pieces, places);
        let mut diagonal = Vec::new();
        for _ in 0..rounds {
            let right = solver.begin(places.len());
            diagonal.clear();
            diagonal.resize(places.len(), 0.0);
            links.iter_mut().for_each(|link| link.block = [0.0; 3]);
            for (piece, of_edges) in pieces.iter().zip(link_of.as_chunks::<3>().0) {
                let jacobian = piece.jacobian(places);
                let weight = weight(jacobian) * piece.area;
                piece.scatter(weight * (rotation(jacobian) - jacobian), right);
                let products = piece.products();
                let trace = 0.5 * (weight.x_axis.x + weight.y_axis.y);
                for (k, point) in piece.points.into_iter().enumerate() {
                    diagonal[point as usize] += trace * (products[k] + products[(k + 2) % 3]);
                }
                for (&link, product) in of_edges.iter().zip(products) {
                    links[link as usize].add(product, weight);
                }
            }
            let hold = |image: &mut [DVec2]| {
                let held = image.iter_mut().zip(held.iter()).filter(|(_, is_held)| **is_held);
                held.for_each(|(image, _)| *image = DVec2::ZERO);
            };
            hold(right);
            let hessian = |values: &[DVec2], image: &mut [DVec2]| {
                links.iter().for_each(|link| link.add_product(values, image));
                hold(image);
            };
            let direction = solver.solve(hessian, &diagonal, TOLERANCE);
            let upright = pieces.iter().map(|piece| piece.upright_for(places, direction)).fold(1.0, f64::min);
            let mut steps = std::iter::successors(Some(upright), |step| Some(0.5 * step)).take(HALVINGS);
            let lower = steps.find_map(|step| {
                moved.clear();
                moved.extend(places.iter().zip(direction).map(|(&place, &way)| place + step * way));
                Some(self::energy(pieces, moved)).filter(|&next| next < energy)
            });
            let Some(next) = lower else { return true };
            std::mem::swap(places, moved);
            let gain = energy - next;
            energy = next;
            if gain < MIN_GAIN * energy || gain < 0.01 * (energy - least) {
                return true;
            }
        }
        false
    }

    /// The edges, each once.
    fn find_links(&mut self) {
        let Self { pieces, across, links, link_of, .. } = self;
        links.clear();
        link_of.clear();
        for (half_edge, &other) in (0u32..).zip(&*across) {
            // Of two half-edges the first is the edge's.
            let link = if other < half_edge { link_of[other as usize] } else { links.len() as u32 };
            link_of.push(link);
            if link as usize == links.len() {
                let points = pieces[half_edge as usize / 3].points;
                let k = half_edge as usize % 3;
                links.push(Link { ends: [points[k], points[(k + 1) % 3]], block: [0.0; 3] });
            }
        }
    }

    /// True where no triangle is turned over, no point is wound around more than once and the border does not cross itself: see
    /// `injective`.
    pub fn is_injective(&mut self) -> bool {
        let Self { pieces, places, across, segments, wedges, overlaps, .. } = self;
        segments.clear();
        wedges.clear();
        // How many triangles around each point lie to the right of it: as often as these are wound around it, where they surround it.
        let mut layers = vec![0; places.len()];
        for (i, piece) in pieces.iter().enumerate() {
            let at = piece.points.map(|p| places[p as usize]);
            let doubled = piece.rest[1].perp_dot(piece.rest[2]);
            let is_upright = (at[1] - at[0]).perp_dot(at[2] - at[0]) > MIN_AREA * doubled;
            if !is_upright {
                return false;
            }
            let flat = at.map(|p| p.as_vec2());
            for k in 0..3 {
                let (next, previous) = ((k + 1) % 3, (k + 2) % 3);
                layers[piece.points[k] as usize] +=
                    u32::from(at[next].y <= at[k].y && at[previous].y > at[k].y);
                wedges.push(Wedge::new(piece.points[k], flat[k], flat[next], flat[previous]));
                if across[3 * i + k] == BORDER {
                    segments.push(Segment::new([piece.points[k], piece.points[next]], [flat[k], flat[next]]));
                }
            }
        }
        layers.iter().all(|&layers| layers <= 1)
            && !any_crossing(segments)
            && !overlaps.any_at_vertex(segments, wedges)
    }
}

impl Link {
    /// Adds a symmetric matrix so many times.
    #[inline]
    fn add(&mut self, times: f64, DMat2 { x_axis, y_axis }: DMat2) {
        let [xx, xy, yy] = &mut self.block;
        *xx += times * x_axis.x;
        *xy += times * x_axis.y;
        *yy += times * y_axis.y;
    }

    /// Adds its part of the matrix times the first argument to the second.
    #[inline]
    fn add_product(&self, values: &[DVec2], image: &mut [DVec2]) {
        let [one, other] = [self.ends[0] as usize, self.ends[1] as usize];
        let [xx, xy, yy] = self.block;
        let DVec2 { x, y } = values[one] - values[other];
        let product = DVec2::new(xx * x + xy * y, xy * x + yy * y);
        image[one] += product;
        image[other] -= product;
    }
}

impl Piece {
    /// For each edge, from the first corner on, how much the places of its ends enter the Jacobian together: minus the product of `-(p + q)`,
    /// `p` and `q`, by which the corners enter it. The two at a corner add up to the square of its own.
    #[inline]
    fn products(&self) -> [f64; 3] {
        let [p, q] = [self.inverse.row(0), self.inverse.row(1)];
        let (pp, pq, qq) = (p.length_squared(), p.dot(q), q.length_squared());
        [pp + pq, -pq, pq + qq]
    }

    /// Of the map from its own plane to where its points lie.
    #[inline]
    fn jacobian(&self, places: &[DVec2]) -> DMat2 {
        let [a, b, c] = self.points.map(|p| places[p as usize]);
        DMat2::from_cols(b - a, c - a) * self.inverse
    }

    /// Adds to its points how a function of the Jacobian changes with their places.
    #[inline(always)]
    fn scatter(&self, by_jacobian: DMat2, places: &mut [DVec2]) {
        let DMat2 { x_axis: b, y_axis: c } = by_jacobian * self.inverse.transpose();
        for (point, change) in self.points.into_iter().zip([-(b + c), b, c]) {
            places[point as usize] += change;
        }
    }

    /// How many times a direction its points can go, nearly, before it is turned over.
    fn upright_for(&self, places: &[DVec2], direction: &[DVec2]) -> f64 {
        let edges = |of: &[DVec2]| {
            let [a, b, c] = self.points.map(|p| of[p as usize]);
            [b - a, c - a]
        };
        let ([p, q], [u, v]) = (edges(places), edges(direction));
        // p x q + t (p x v + u x q) + t^2 u x v.
        let (c, b, a) = (p.perp_dot(q), p.perp_dot(v) + u.perp_dot(q), u.perp_dot(v));
        let discriminant = b * b - 4.0 * a * c;
        if discriminant < 0.0 {
            return f64::INFINITY;
        }
        let half = -0.5 * (b + discriminant.sqrt().copysign(b));
        let first = [half / a, c / half].into_iter().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
        0.9 * first
    }
}

/// The symmetric Dirichlet energy of all pieces, four times their area where all keep their shapes (J. Smith and S. Schaefer, "Bijective
/// Parameterization with Free Boundaries", 2015).
fn energy(pieces: &[Piece], places: &[DVec2]) -> f64 {
    let of = |piece: &Piece| {
        let jacobian = piece.jacobian(places);
        let determinant = jacobian.determinant();
        let squared = jacobian.x_axis.length_squared() + jacobian.y_axis.length_squared();
        let is_upright = determinant > 0.0;
        if is_upright { piece.area * squared * (1.0 + determinant.powi(-2)) } else { f64::INFINITY }
    };
    pieces.iter().map(of).sum()
}

/// The rotation nearest to an upright map.
fn rotation(DMat2 { x_axis, y_axis }: DMat2) -> DMat2 {
    let x = DVec2::new(x_axis.x + y_axis.y, x_axis.y - y_axis.x).normalize_or(DVec2::X);
    DMat2::from_cols(x, x.perp())
}

/// The symmetric matrix by which the distance from the nearest rotation is to be weighed, so that it grows as the energy does: along the axes of
/// the map's stretches `s`, `1 + 1/s + 1/s^2 + 1/s^3`.
fn weight(jacobian: DMat2) -> DMat2 {
    let outer = jacobian * jacobian.transpose();
    let (x, y) = (outer.x_axis, outer.y_axis);
    let (mean, half) = (0.5 * (x.x + y.y), (0.25 * (x.x - y.y).powi(2) + x.y * x.y).sqrt());
    let [large, small] = [mean + half, (mean - half).max(1e-12)];
    let [of_large, of_small] = [large, small].map(|squared| {
        let inverse = squared.sqrt().recip();
        1.0 + inverse * (1.0 + inverse * (1.0 + inverse))
    });
    // A function of `J J^T` with these two values is linear in it.
    let slope = if half > 1e-9 * mean { (of_large - of_small) / (large - small) } else { 0.0 };
    DMat2::from_diagonal(DVec2::splat(of_large - slope * large)) + slope * outer
}

/// Conjugate gradients with the matrix's diagonal as a preconditioner.
#[derive(Default)]
struct Solver {
    found: Vec<DVec2>,
    /// At first the right side.
    residual: Vec<DVec2>,
    image: Vec<DVec2>,
    direction: Vec<DVec2>,
    inverse: Vec<f64>,
}

impl Solver {
    /// The right side of so many equations, all zero, to be filled in.
    fn begin(&mut self, count: usize) -> &mut [DVec2] {
        self.residual.clear();
        self.residual.resize(count, DVec2::ZERO);
        &mut self.residual
    }

    /// `add_product` adds the matrix times its first argument to its second.
    fn solve(
        &mut self,
        add_product: impl Fn(&[DVec2], &mut [DVec2]),
        diagonal: &[f64],
        tolerance: f64,
    ) -> &[DVec2] {
        let Self { found, residual, image, direction, inverse } = self;
        let n = residual.len();
        for zeros in [&mut *found, &mut *image] {
            zeros.clear();
            zeros.resize(n, DVec2::ZERO);
        }
        inverse.clear();
        inverse.extend(diagonal.iter().map(|&d| if d > 0.0 { 1.0 / d } else { 0.0 }));
        let dot = |residual: &[DVec2], inverse: &[f64]| {
            residual.iter().zip(inverse).map(|(r, i)| i * r.length_squared()).sum::<f64>()
        };
        direction.clear();
        direction.extend(residual.iter().zip(&*inverse).map(|(r, i)| r * *i));
        let mut left = dot(residual, inverse);
        let enough = tolerance * tolerance * left;
        for _ in 0..STEPS {
            image.fill(DVec2::ZERO);
            add_product(direction, image);
            let steepness: f64 = direction.iter().zip(&*image).map(|(d, i)| d.dot(*i)).sum();
            if !(steepness > 0.0 && left > enough) {
                break;
            }
            let step = left / steepness;
            for i in 0..n {
                found[i] += step * direction[i];
                residual[i] -= step * image[i];
            }
            let next = dot(residual, inverse);
            let keep = next / left;
            left = next;
            for i in 0..n {
                direction[i] = residual[i] * inverse[i] + keep * direction[i];
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;
    use glam::DVec3;

    use super::*;

    /// Edges give the same matrix as triangles do, one by one.
    #[test]
    fn edges_multiply_as_triangles_do() {
        let mut random = Random::new(6);
        for _ in 0..50 {
            let mut place = || DVec3::from_array([0; 3].map(|_| random.unit())).as_vec3();
            let mut sheet = Sheet::default();
            let corners: Vec<Vec3> = (0..4).map(|_| place()).collect();
            for points in [[0, 1, 2], [2, 1, 3]] {
                assert!(sheet.push(points.map(|p| corners[p]), points.map(|p| p as u32), 3));
            }
            sheet.find_edges().unwrap();
            sheet.find_links();
            assert_eq!(sheet.links.len(), 5);
            let values: Vec<DVec2> = (0..4).map(|_| place().as_dvec3().truncate()).collect();
            let (mut by_triangles, mut by_edges) = ([DVec2::ZERO; 4], [DVec2::ZERO; 4]);
            for (i, piece) in sheet.pieces.iter().enumerate() {
                let [a, b, c] = place().as_dvec3().to_array();
                let weight = DMat2::from_cols_array(&[a, b, b, c]);
                piece.scatter(weight * piece.jacobian(&values), &mut by_triangles);
                for (k, product) in piece.products().into_iter().enumerate() {
                    sheet.links[sheet.link_of[3 * i + k] as usize].add(product, weight);
                }
            }
            sheet.links.iter().for_each(|link| link.add_product(&values, &mut by_edges));
            let scale = by_triangles.iter().map(|p| p.length()).fold(1.0, f64::max);
            for (one, other) in by_triangles.into_iter().zip(by_edges) {
                assert!(one.distance(other) < 1e-9 * scale, "{one} and {other}");
            }
        }
    }

    /// The stand-in's gradient is the energy's, by differences.
    #[test]
    fn weights_make_the_gradient_of_the_energy() {
        let mut random = Random::new(5);
        for _ in 0..50 {
            let mut number = || 2.0 * random.unit() - 1.0;
            let jacobian =
                DMat2::from_cols(DVec2::new(1.5 + number(), number()), DVec2::new(number(), 1.5 + number()));
            if jacobian.determinant() < 0.2 {
                continue;
            }
            let energy = |m: DMat2| {
                let squared = m.x_axis.length_squared() + m.y_axis.length_squared();
                squared * (1.0 + m.determinant().powi(-2))
            };
            let gradient = weight(jacobian) * (jacobian - rotation(jacobian)) * 2.0;
            for (axis, slot) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let changed = |by: f64| {
                    let mut m = jacobian;
                    m.col_mut(axis)[slot] += by;
                    energy(m)
                };
                let wanted = (changed(1e-5) - changed(-1e-5)) / 2e-5;
                let got = gradient.col(axis)[slot];
                assert!((got - wanted).abs() < 1e-4 * (1.0 + wanted.abs()), "{got} for {wanted}");
            }
        }
    }
}
