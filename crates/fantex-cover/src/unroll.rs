//! Lays groups flat freely, as nearly rigid as it goes: across creases, where no direction sees them.
//!
//! Triangles are hinged into the plane one after the other; where that turns one over, the group's border is laid around a circle and the rest
//! between. From there every triangle is brought as near to its own shape as its neighbours let it, without turning any over. What overlaps itself
//! in the end is refused.

use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

use fantex_base::UnionFind;
use fantex_mesh::FanCorner;
use glam::{DMat2, DVec2, Vec2, Vec3};

use crate::Frame;
use crate::cost::{Distortion, Region};
use crate::flatten::{Flat, FlatLimits, outline_length, outline_points};
use crate::injective::{OverlapFinder, Segment, Wedge, any_crossing};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::surface::Surface;

/// For corners `3 * triangle + slot` in a group the places of their triangle's three corners, along the sides of its rectangle.
pub(crate) type FlatCorners = Box<[(u32, [Vec2; 3])]>;

/// Groups of fans with more corners are not laid flat freely.
pub(crate) const MAX_CORNERS: usize = 4096;

/// Normals are stored relative to a frame that turns with the surface, fast where that is nearly the other way round.
const MIN_COSINE: f32 = -0.5;

/// Rounds of the relaxation.
const ROUNDS: usize = 12;

/// Steps of the conjugate gradients in each round.
const STEPS: usize = 24;

/// Share of the first residual at which they end.
const TOLERANCE: f64 = 0.05;

/// A round that lowers the energy by less of itself is the last.
const MIN_GAIN: f64 = 1e-3;

/// How often a step is halved that raises the energy.
const HALVINGS: usize = 12;

/// A triangle that shrinks to less of its area counts as turned over.
const MIN_AREA: f64 = 0.02;

/// A triangle of the group.
struct Piece {
    /// One of its corners in the group: all that follows is in the order of [`FanCorner::slots`].
    corner: FanCorner,
    /// Which of its corners are in the group.
    inside: [bool; 3],
    points: [u32; 3],
    /// Its shape in a plane of its own.
    rest: [DVec2; 3],
    /// The inverse of the edges from its first corner there.
    inverse: DMat2,
    /// The area that is in the group.
    area: f64,
}

/// Reused buffers.
#[derive(Default)]
pub(crate) struct Unroller {
    pieces: Vec<Piece>,
    sets: UnionFind,
    /// `(lower point, higher point, 3 * piece + corner)`, ascending; the edge leaves that corner.
    edges: Vec<(u32, u32, u32)>,
    /// For every such half-edge the one of the triangle beyond, or `BORDER`.
    across: Vec<u32>,
    /// Of each point; a point is named by one of the `3 * piece + corner` that it unites.
    places: Vec<DVec2>,
    overlaps: OverlapFinder,
    segments: Vec<Segment>,
    wedges: Vec<Wedge>,
}

/// No triangle beyond.
const BORDER: u32 = u32::MAX;

impl Unroller {
    /// Lays connected fans flat, from the places of a single fan's triangles if given; `None` where that does not succeed.
    pub(crate) fn unroll(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        start: Option<&[[Vec2; 3]]>,
        limits: &FlatLimits,
        rectangles: &mut RectangleFinder,
    ) -> Option<(Flat, FlatCorners)> {
        self.gather(surface, fans)?;
        let direction = self.direction(surface)?;
        self.find_edges()?;
        match start {
            Some(planar) => self.start_with(surface, fans[0], planar),
            None => self.hinge(),
        }
        if !self.is_upright() {
            self.spread_in_circle()?;
            self.is_upright().then_some(())?;
        }
        self.relax();
        self.is_injective().then_some(())?;
        Some(self.enclose(surface, fans[0], direction, limits, rectangles))
    }

    /// The mean normal, from which none differs too much.
    fn direction(&self, surface: &Surface<'_>) -> Option<Vec3> {
        let facets = || self.pieces.iter().map(|piece| surface.fan_facet(piece.corner));
        let direction = facets().map(|(normal, area)| normal * area).sum::<Vec3>().try_normalize()?;
        facets().all(|(normal, _)| normal.dot(direction) >= MIN_COSINE).then_some(direction)
    }

    /// The group's triangles as a mesh of its own, glued along edges that have an end in the group.
    fn gather(&mut self, surface: &Surface<'_>, fans: &[u32]) -> Option<()> {
        let mut corners: Vec<FanCorner> =
            fans.iter().flat_map(|&fan| surface.fans.corners(fan as usize)).copied().collect();
        corners.sort_unstable_by_key(|corner| corner.corner());
        self.pieces.clear();
        for around in corners.chunk_by(|a, b| a.triangle() == b.triangle()) {
            let corner = around[0];
            // Fans that see a triangle from both of its sides cannot share a tile.
            if around.iter().any(|other| other.reversed() != corner.reversed()) {
                return None;
            }
            let inside = corner.slots().map(|slot| around.iter().any(|other| other.slots()[0] == slot));
            let (points, rest, inverse) = ([0; 3], [DVec2::ZERO; 3], DMat2::IDENTITY);
            self.pieces.push(Piece { corner, inside, points, rest, inverse, area: 0.0 });
        }
        let pieces = &self.pieces;
        let piece_of = |corner: FanCorner| {
            pieces.binary_search_by_key(&corner.triangle(), |piece| piece.corner.triangle()).unwrap_or(0)
        };
        self.sets.reset(3 * pieces.len());
        let place = |corner: FanCorner, k: usize| (3 * piece_of(corner) + corner.slots()[k]) as u32;
        for &fan in fans {
            let corners = surface.fans.corners(fan as usize);
            for pair in corners.windows(2) {
                self.sets.union(place(pair[0], 0), place(pair[1], 0));
                self.sets.union(place(pair[0], 2), place(pair[1], 1));
            }
            if surface.fans.is_closed(fan as usize)
                && let [first, .., last] = *corners
            {
                self.sets.union(place(last, 2), place(first, 1));
            }
        }
        for (i, piece) in self.pieces.iter_mut().enumerate() {
            piece.points = piece.corner.slots().map(|slot| self.sets.find((3 * i + slot) as u32));
            let [a, b, c] = surface.fan_triangle(piece.corner).map(|p| p.as_dvec3());
            let length = (b - a).length();
            let along = (b - a) / length;
            let x = (c - a).dot(along);
            // Slivers are taken for somewhat wider ones.
            let y = (c - a - along * x).length().max(0.01 * length.max((c - a).length()));
            piece.rest = [DVec2::ZERO, DVec2::new(length, 0.0), DVec2::new(x, y)];
            if !(length > 0.0 && y.is_finite()) {
                return None;
            }
            piece.inverse = DMat2::from_cols(piece.rest[1], piece.rest[2]).inverse();
            piece.area = 0.5 * length * y * piece.inside.map(f64::from).iter().sum::<f64>() / 3.0;
        }
        Some(())
    }

    /// Finds which triangles meet; `None` where more than two do, or two in the same direction.
    fn find_edges(&mut self) -> Option<()> {
        let Self { pieces, edges, across, .. } = self;
        edges.clear();
        for (i, piece) in pieces.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (piece.points[k], piece.points[(k + 1) % 3]);
                edges.push((a.min(b), a.max(b), (3 * i + k) as u32));
            }
        }
        edges.sort_unstable();
        across.clear();
        across.resize(edges.len(), BORDER);
        let begins = |half_edge: u32| pieces[half_edge as usize / 3].points[half_edge as usize % 3];
        for around in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            match *around {
                [(a, b, _)] if a != b => {}
                [(_, _, one), (_, _, other)] if begins(one) != begins(other) => {
                    across[one as usize] = other;
                    across[other as usize] = one;
                }
                _ => return None,
            }
        }
        Some(())
    }

    /// Every point once where the triangles of a single fan have been laid.
    fn start_with(&mut self, surface: &Surface<'_>, fan: u32, planar: &[[Vec2; 3]]) {
        self.places.clear();
        self.places.resize(3 * self.pieces.len(), DVec2::ZERO);
        for (corner, places) in surface.fans.corners(fan as usize).iter().zip(planar) {
            // A fan has one corner in each of its triangles.
            let found = self.pieces.binary_search_by_key(&corner.triangle(), |piece| piece.corner.triangle());
            for (point, place) in found.iter().flat_map(|&i| self.pieces[i].points.into_iter().zip(places)) {
                self.places[point as usize] = place.as_dvec2();
            }
        }
    }

    /// Lays one triangle after the other beside one that lies already.
    fn hinge(&mut self) {
        let Self { pieces, across, places, .. } = self;
        places.clear();
        places.resize(3 * pieces.len(), DVec2::NAN);
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
    fn is_upright(&self) -> bool {
        self.pieces.iter().all(|piece| piece.jacobian(&self.places).determinant() > MIN_AREA)
    }

    /// Lays the border around a circle and every other point in the middle of its neighbours, which turns no triangle over (W. T. Tutte, "How
    /// to draw a graph", 1963). `None` where the group has holes.
    fn spread_in_circle(&mut self) -> Option<()> {
        let Self { pieces, across, places, .. } = self;
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
        let mut right = vec![DVec2::ZERO; places.len()];
        laplacian(places, &mut right);
        right.iter_mut().for_each(|r| *r = -*r);
        let found = solve(laplacian, &right, &degrees, 1e-3);
        places.iter_mut().zip(found).for_each(|(place, step)| *place += step);
        Some(())
    }

    /// Brings the triangles as near to their own shapes as their neighbours let them, and turns none over: least symmetric Dirichlet energy, by a
    /// quadratic stand-in for it in every round (M. Rabinovich and others, "Scalable Locally Injective Mappings", 2017).
    fn relax(&mut self) {
        let Self { pieces, places, .. } = self;
        let least = 4.0 * pieces.iter().map(|piece| piece.area).sum::<f64>();
        let mut energy = energy(pieces, places);
        let mut weights = Vec::with_capacity(pieces.len());
        for _ in 0..ROUNDS {
            let (mut right, mut diagonal) = (vec![DVec2::ZERO; places.len()], vec![0.0; places.len()]);
            weights.clear();
            for piece in pieces.iter() {
                let jacobian = piece.jacobian(places);
                let weight = weight(jacobian) * piece.area;
                piece.scatter(weight * (rotation(jacobian) - jacobian), &mut right);
                let trace = 0.5 * (weight.x_axis.x + weight.y_axis.y);
                let [p, q] = [piece.inverse.row(0), piece.inverse.row(1)];
                for (point, column) in piece.points.into_iter().zip([-(p + q), p, q]) {
                    diagonal[point as usize] += trace * column.length_squared();
                }
                weights.push(weight);
            }
            let hessian = |values: &[DVec2], image: &mut [DVec2]| {
                for (piece, &weight) in pieces.iter().zip(&weights) {
                    piece.scatter(weight * piece.jacobian(values), image);
                }
            };
            let direction = solve(hessian, &right, &diagonal, TOLERANCE);
            let upright =
                pieces.iter().map(|piece| piece.upright_for(places, &direction)).fold(1.0, f64::min);
            let steps = std::iter::successors(Some(upright), |step| Some(0.5 * step)).take(HALVINGS);
            let moved = |step: f64| -> Vec<DVec2> {
                places.iter().zip(&direction).map(|(&place, &way)| place + step * way).collect()
            };
            let tried = steps.map(moved).map(|places| (self::energy(pieces, &places), places));
            let Some((next, moved)) = tried.into_iter().find(|tried| tried.0 < energy) else { return };
            *places = moved;
            let gain = energy - next;
            energy = next;
            if gain < MIN_GAIN * energy || gain < 0.01 * (energy - least) {
                return;
            }
        }
    }

    /// True where no triangle is turned over, no point is wound around more than once and the border does not cross itself: see
    /// [`injective`](crate::injective).
    fn is_injective(&mut self) -> bool {
        let Self { pieces, places, across, segments, wedges, overlaps, .. } = self;
        segments.clear();
        wedges.clear();
        let mut turns = vec![0.0; places.len()];
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
                turns[piece.points[k] as usize] += (at[next] - at[k]).angle_to(at[previous] - at[k]);
                wedges.push(Wedge::new(piece.points[k], flat[k], flat[next], flat[previous]));
                if across[3 * i + k] == BORDER {
                    segments.push(Segment::new([piece.points[k], piece.points[next]], [flat[k], flat[next]]));
                }
            }
        }
        let once = TAU + 1e-3;
        turns.iter().all(|&turn| turn < once)
            && !any_crossing(segments)
            && !overlaps.any_at_vertex(segments, wedges)
    }

    /// The group in its rectangle.
    fn enclose(
        &self,
        surface: &Surface<'_>,
        fan: u32,
        direction: Vec3,
        limits: &FlatLimits,
        rectangles: &mut RectangleFinder,
    ) -> (Flat, FlatCorners) {
        let mut points = Vec::with_capacity(6 * self.pieces.len());
        for piece in &self.pieces {
            let at = piece.points.map(|p| self.places[p as usize].as_vec2());
            outline_points(at, piece.inside, limits.delta, true, |p| points.push(p.extend(0.0)));
        }
        let rectangle = rectangles.smallest(&mut points, limits.pad);
        let Rectangle { min, size, .. } = rectangle;
        let mut distortion = Distortion::default();
        let mut region = Region { size, ..Region::default() };
        let mut corners = Vec::with_capacity(3 * self.pieces.len());
        let mut cos = 1.0f32;
        for (i, piece) in self.pieces.iter().enumerate() {
            let (normal, area) = surface.fan_facet(piece.corner);
            cos = cos.min(normal.dot(direction));
            let at = piece.points.map(|p| rectangle.turned(self.places[p as usize].as_vec2()));
            let [a, b, c] = surface.fan_triangle(piece.corner);
            let share = piece.inside.map(f32::from).iter().sum::<f32>() / 3.0;
            distortion.add_edges([b - a, c - a], [at[1] - at[0], at[2] - at[0]], area * share);
            region.area += (at[1] - at[0]).perp_dot(at[2] - at[0]).abs() * 0.5 * share;
            region.outline += outline_length(at, piece.inside);
            for k in (0..3).filter(|k| self.across[3 * i + k] == BORDER) {
                let ends = f32::from(piece.inside[k]) + f32::from(piece.inside[(k + 1) % 3]);
                region.outline += 0.5 * ends * at[k].distance(at[(k + 1) % 3]);
            }
            let mut by_slot = [Vec2::ZERO; 3];
            let slots = piece.corner.slots();
            for (slot, place) in slots.into_iter().zip(at) {
                by_slot[slot] = place;
            }
            let corner = |slot: usize| (3 * piece.corner.triangle() + slot) as u32;
            corners.extend((0..3).filter(|&k| piece.inside[k]).map(|k| (corner(slots[k]), by_slot)));
        }
        let origin = surface.fan_center(fan as usize);
        let frame = Frame { origin, direction, x_axis: direction.any_orthonormal_vector() };
        (Flat { frame, min, region, cos, distortion, outline: Box::default() }, corners.into())
    }
}

impl Piece {
    /// Of the map from its own plane to where its points lie.
    fn jacobian(&self, places: &[DVec2]) -> DMat2 {
        let [a, b, c] = self.points.map(|p| places[p as usize]);
        DMat2::from_cols(b - a, c - a) * self.inverse
    }

    /// Adds to its points how a function of the Jacobian changes with their places.
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

/// Conjugate gradients with the matrix's diagonal as a preconditioner. `add_product` adds the matrix times its first argument to its second.
fn solve(
    add_product: impl Fn(&[DVec2], &mut [DVec2]),
    right: &[DVec2],
    diagonal: &[f64],
    tolerance: f64,
) -> Vec<DVec2> {
    let n = right.len();
    let (mut found, mut residual, mut image) = (vec![DVec2::ZERO; n], right.to_vec(), vec![DVec2::ZERO; n]);
    let inverse: Vec<f64> = diagonal.iter().map(|&d| if d > 0.0 { 1.0 / d } else { 0.0 }).collect();
    let dot =
        |residual: &[DVec2]| residual.iter().zip(&inverse).map(|(r, i)| i * r.length_squared()).sum::<f64>();
    let mut direction: Vec<DVec2> = residual.iter().zip(&inverse).map(|(r, i)| r * *i).collect();
    let mut left = dot(&residual);
    let enough = tolerance * tolerance * left;
    for _ in 0..STEPS {
        image.fill(DVec2::ZERO);
        add_product(&direction, &mut image);
        let steepness: f64 = direction.iter().zip(&image).map(|(d, i)| d.dot(*i)).sum();
        if !(steepness > 0.0 && left > enough) {
            break;
        }
        let step = left / steepness;
        for i in 0..n {
            found[i] += step * direction[i];
            residual[i] -= step * image[i];
        }
        let next = dot(&residual);
        let keep = next / left;
        left = next;
        for i in 0..n {
            direction[i] = residual[i] * inverse[i] + keep * direction[i];
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use fantex_base::Random;
    use fantex_mesh::{CleanOptions, Fans, Mesh, VertexCorners, clean, generate};

    use super::*;

    fn surface(mesh: &Mesh) -> Surface<'_> {
        let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
        Surface::new(mesh, Fans::of(&mesh.triangles, &corners))
    }

    fn cleaned(model: fantex_mesh::Model) -> Mesh {
        clean(model, &CleanOptions::default()).unwrap().0
    }

    const LIMITS: FlatLimits = FlatLimits { delta: 0.0625, pad: 0.0, facing: 0.0 };

    fn unrolled(surface: &Surface<'_>, fans: &[u32]) -> Option<(Flat, FlatCorners)> {
        Unroller::default().unroll(surface, fans, None, &LIMITS, &mut RectangleFinder::default())
    }

    /// The triangles of a group, each once.
    fn flat_triangles(corners: &FlatCorners) -> Vec<(usize, [Vec2; 3])> {
        let mut triangles: Vec<_> =
            corners.iter().map(|&(corner, flat)| (corner as usize / 3, flat)).collect();
        triangles.dedup();
        triangles
    }

    /// Fans along an edge of a cube see two sides, which lie flat as they are.
    #[test]
    fn a_crease_is_unrolled_without_stretching() {
        let mesh = cleaned(generate::cube(6));
        let surface = surface(&mesh);
        let (low, high) = (mesh.bounds().min, mesh.bounds().max);
        let is_inside = |x: f32, axis: usize| x > low[axis] + 0.3 && x < high[axis] - 0.3;
        let near_edge = |p: Vec3| p.x > high.x - 0.4 && p.y > high.y - 0.4 && is_inside(p.z, 2);
        let fans: Vec<u32> = (0..surface.fans.len() as u32)
            .filter(|&fan| near_edge(surface.fan_center(fan as usize)))
            .collect();
        let (flat, corners) = unrolled(&surface, &fans).unwrap();
        assert!(fans.len() > 4 && flat.cos > 0.7, "{} fans, {}", fans.len(), flat.cos);
        for (t, planar) in flat_triangles(&corners) {
            let spatial = mesh.triangle_positions(t);
            for k in 0..3 {
                let [a, b] = [k, (k + 1) % 3].map(|i| (spatial[i], planar[i]));
                let lengths = [a.0.distance(b.0), a.1.distance(b.1)];
                assert!((lengths[0] - lengths[1]).abs() < 1e-3 * lengths[0], "{lengths:?}");
            }
        }
        assert!((flat.distortion.error(Vec2::ONE) / flat.distortion.area() - 1.0).abs() < 1e-2);
    }

    /// Groups of crumpled fans come out upright and lie in one layer, or are refused.
    #[test]
    fn what_is_unrolled_lies_in_one_layer() {
        let mut random = Random::new(17);
        let mut model = generate::icosphere(3);
        for p in &mut model.positions {
            *p *= 1.0 + 0.5 * (random.unit() - 0.5);
        }
        let mesh = cleaned(model);
        let surface = surface(&mesh);
        let mut found = 0;
        for seed in 0..surface.fans.len() {
            let mut fans = vec![seed as u32];
            for &corner in surface.fans.corners(seed) {
                fans.push(surface.fans.of_triangle(corner.triangle())[corner.slots()[1]]);
            }
            fans.truncate(2 + random.below(6) as usize);
            let Some((flat, corners)) = unrolled(&surface, &fans) else { continue };
            found += 1;
            let triangles = flat_triangles(&corners);
            let is_in = |[a, b, c]: [Vec2; 3], p: Vec2| {
                let sides = [(a, b), (b, c), (c, a)];
                sides.iter().all(|&(from, to)| (to - from).perp_dot(p - from) > 1e-5)
            };
            assert!(triangles.iter().all(|(_, [a, b, c])| (*b - *a).perp_dot(*c - *a) > 0.0));
            for _ in 0..200 {
                let unit = Vec2::new(random.unit() as f32, random.unit() as f32);
                let p = flat.min + flat.region.size * unit;
                let layers = triangles.iter().filter(|(_, corners)| is_in(*corners, p)).count();
                assert!(layers <= 1, "fans {fans:?}: {layers} layers at {p}");
            }
        }
        assert!(found > surface.fans.len() / 2, "{found} of {}", surface.fans.len());
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
