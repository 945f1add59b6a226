//! Lays groups flat freely, as nearly rigid as it goes: across creases, where no direction sees them.
//!
//! Triangles are hinged into the plane one after the other; where that turns one over, the parts of a union are laid beside each other as each lies by
//! itself; where these overlap, the group's border is laid around a circle and the rest between. From there every triangle is brought as near to its own
//! shape as its neighbours let it, without turning any over. What overlaps itself in the end is refused.

use fantex_base::UnionFind;
use fantex_mesh::FanCorner;
use glam::{DVec2, Vec2, Vec3};

use crate::Frame;
use crate::cost::{Distortion, Region};
use crate::fan_shape::unfold;
use crate::flatten::{Flat, FlatLimits, outline_length, outline_points};
use crate::rectangle::{Rectangle, RectangleFinder};
use crate::sheet::Sheet;
use crate::surface::Surface;

/// For corners `3 * triangle + slot` in a group the places of their triangle's three corners, along the sides of its rectangle.
pub(crate) type FlatCorners = Box<[(u32, [Vec2; 3])]>;

/// Groups of fans with more corners are not laid flat freely.
pub(crate) const MAX_CORNERS: usize = 4096;

/// Normals are stored relative to a frame that turns with the surface, fast where that is nearly the other way round.
const MIN_COSINE: f32 = -0.5;

/// Rounds of the relaxation.
const ROUNDS: usize = 12;

/// What begins spread in a circle is given up after so many rounds if it overlaps itself or costs more than so many times what there is. It
/// would take about ten rounds, thrice as many as what begins beside, and one of seven on a folded ball, one of nine on a sponge would be kept.
const SPREAD_ROUNDS: usize = 4;
const MAX_SPREAD_RATIO: f32 = 1.2;

/// What is tried for points that two parts of a group have at different places.
const SHARES: [f64; 3] = [0.5, 0.0, 1.0];

/// A part of a group, as it lies by itself.
pub(crate) struct Lying<'a> {
    pub(crate) fans: &'a [u32],
    pub(crate) frame: &'a Frame,
    /// As in [`FlatCorners`]; none where it is projected.
    pub(crate) corners: &'a [(u32, [Vec2; 3])],
}

impl Lying<'_> {
    /// Where the corners of one of its triangles lie.
    fn places(&self, surface: &Surface<'_>, triangle: usize) -> Option<[Vec2; 3]> {
        if self.corners.is_empty() {
            let Frame { origin, x_axis, .. } = *self.frame;
            let y_axis = self.frame.y_axis();
            let at = |p: Vec3| Vec2::new((p - origin).dot(x_axis), (p - origin).dot(y_axis));
            return Some(surface.mesh.triangle_positions(triangle).map(at));
        }
        let triangle_of = |corner: &(u32, [Vec2; 3])| corner.0 as usize / 3;
        // A lone fan's are in its own order, others' ascend.
        let found = match self.fans {
            [_] => self.corners.iter().position(|corner| triangle_of(corner) == triangle),
            _ => self.corners.binary_search_by_key(&triangle, triangle_of).ok(),
        };
        found.map(|i| self.corners[i].1)
    }
}

/// A triangle of the group.
struct Part {
    /// One of its corners in the group: all that follows is in the order of [`FanCorner::slots`].
    corner: FanCorner,
    /// Which of its corners are in the group.
    inside: [bool; 3],
}

/// Reused buffers.
#[derive(Default)]
pub(crate) struct Unroller {
    parts: Vec<Part>,
    sets: UnionFind,
    /// Of each `3 * part + slot` its point in the sheet.
    points: Vec<u32>,
    /// The parts.
    sheet: Sheet,
    /// Of each point where a part of the group has it by itself.
    own: Vec<DVec2>,
}

impl Unroller {
    /// Lays connected fans flat, from where the parts lie that they come in, if any are given; `None` where that does not succeed, or most
    /// probably costs too much: `ratio` is the cost, with so many corners, to that of what there is.
    pub(crate) fn unroll(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        lying: &[Lying<'_>],
        limits: &FlatLimits,
        rectangles: &mut RectangleFinder,
        ratio: impl Fn(&Flat, usize) -> f32,
    ) -> Option<(Flat, FlatCorners)> {
        self.find_parts(surface, fans)?;
        let direction = self.direction(surface)?;
        let points = self.glue(surface, fans)?;
        self.sheet.find_edges()?;
        let is_spread = self.start(surface, fans, lying, points)?;
        let mut rounds = ROUNDS;
        if is_spread && !self.sheet.relax(SPREAD_ROUNDS) {
            self.sheet.is_injective().then_some(())?;
            let (flat, corners) = self.enclose(surface, fans[0], direction, limits, rectangles);
            (ratio(&flat, corners.len()) <= MAX_SPREAD_RATIO).then_some(())?;
            rounds -= SPREAD_ROUNDS;
        }
        self.sheet.relax(rounds);
        self.sheet.is_injective().then_some(())?;
        Some(self.enclose(surface, fans[0], direction, limits, rectangles))
    }

    /// The mean normal, from which none differs too much.
    fn direction(&self, surface: &Surface<'_>) -> Option<Vec3> {
        let facets = || self.parts.iter().map(|part| surface.fan_facet(part.corner));
        let direction = facets().map(|(normal, area)| normal * area).sum::<Vec3>().try_normalize()?;
        facets().all(|(normal, _)| normal.dot(direction) >= MIN_COSINE).then_some(direction)
    }

    /// Finds the group's triangles.
    fn find_parts(&mut self, surface: &Surface<'_>, fans: &[u32]) -> Option<()> {
        let mut corners: Vec<FanCorner> =
            fans.iter().flat_map(|&fan| surface.fans.corners(fan as usize)).copied().collect();
        corners.sort_unstable_by_key(|corner| corner.corner());
        self.parts.clear();
        for around in corners.chunk_by(|a, b| a.triangle() == b.triangle()) {
            let corner = around[0];
            // Fans that see a triangle from both of its sides cannot share a tile.
            if around.iter().any(|other| other.reversed() != corner.reversed()) {
                return None;
            }
            let inside = corner.slots().map(|slot| around.iter().any(|other| other.slots()[0] == slot));
            self.parts.push(Part { corner, inside });
        }
        Some(())
    }

    /// The group's triangles as a mesh of its own, glued along edges that have an end in the group. Returns the number of its points.
    fn glue(&mut self, surface: &Surface<'_>, fans: &[u32]) -> Option<usize> {
        self.sheet.clear();
        let parts = &self.parts;
        let part_of = |corner: FanCorner| {
            parts.binary_search_by_key(&corner.triangle(), |part| part.corner.triangle()).unwrap_or(0)
        };
        self.sets.reset(3 * parts.len());
        let places = |corner: FanCorner| {
            let part = part_of(corner);
            corner.slots().map(|slot| (3 * part + slot) as u32)
        };
        for &fan in fans {
            let Some((&first, rest)) = surface.fans.corners(fan as usize).split_first() else { continue };
            let first = places(first);
            let mut last = first;
            for &corner in rest {
                let next = places(corner);
                self.sets.union(last[0], next[0]);
                self.sets.union(last[2], next[1]);
                last = next;
            }
            if surface.fans.is_closed(fan as usize) && !rest.is_empty() {
                self.sets.union(last[2], first[1]);
            }
        }
        // Numbered without gaps: the relaxation goes over all points again and again.
        let count = self.sets.number(&mut self.points);
        for (i, part) in self.parts.iter().enumerate() {
            let points = part.corner.slots().map(|slot| self.points[3 * i + slot]);
            let corners = part.inside.iter().filter(|is| **is).count();
            self.sheet.push(surface.fan_triangle(part.corner), points, corners).then_some(())?;
        }
        Some(count)
    }

    /// Places all points so that no triangle is turned over. True where they are only spread in a circle.
    fn start(
        &mut self,
        surface: &Surface<'_>,
        fans: &[u32],
        lying: &[Lying<'_>],
        points: usize,
    ) -> Option<bool> {
        match *fans {
            [fan] => self.start_with(surface, fan, &unfold(surface, fan as usize)?, points),
            _ => self.sheet.hinge(points),
        }
        let mut shares = SHARES.into_iter();
        if self.sheet.is_upright() || shares.any(|share| self.start_beside(surface, lying, share, points)) {
            return Some(false);
        }
        self.sheet.spread_in_circle()?;
        self.sheet.is_upright().then_some(true)
    }

    /// Every point where the parts of the group have it, each part turned and moved to where it fits best to those before; points of several
    /// of them between, with a share of the way to the later one. False where no two points would do, or where that overlaps itself.
    fn start_beside(
        &mut self,
        surface: &Surface<'_>,
        lying: &[Lying<'_>],
        share: f64,
        points: usize,
    ) -> bool {
        let Self { parts, points: numbers, sheet, own, .. } = self;
        let places = sheet.places();
        places.clear();
        places.resize(points, DVec2::NAN);
        for (i, lying) in lying.iter().enumerate() {
            own.clear();
            own.resize(points, DVec2::NAN);
            for corner in lying.fans.iter().flat_map(|&fan| surface.fans.corners(fan as usize)) {
                let triangle = corner.triangle();
                let part = parts.binary_search_by_key(&triangle, |part| part.corner.triangle());
                let (Ok(part), Some(at)) = (part, lying.places(surface, triangle)) else { return false };
                for (slot, at) in at.into_iter().enumerate() {
                    own[numbers[3 * part + slot] as usize] = at.as_dvec2();
                }
            }
            let common =
                || std::iter::zip(&*places, &*own).filter(|(to, from)| !to.is_nan() && !from.is_nan());
            let count = common().count();
            if i > 0 && count < 2 {
                return false;
            }
            let scale = 1.0 / count.max(1) as f64;
            let [to, from] =
                [0, 1].map(|k| common().map(|pair| [*pair.0, *pair.1][k]).sum::<DVec2>() * scale);
            let turn = common().map(|(a, b)| {
                let (a, b) = (*a - to, *b - from);
                DVec2::new(b.dot(a), b.perp_dot(a))
            });
            let turn = turn.sum::<DVec2>().normalize_or(DVec2::X);
            for (place, own) in places.iter_mut().zip(&*own).filter(|(_, own)| !own.is_nan()) {
                let own = to + turn.rotate(*own - from);
                *place = if place.is_nan() { own } else { place.lerp(own, share) };
            }
        }
        sheet.is_injective()
    }

    /// Every point once where the triangles of a single fan have been laid.
    fn start_with(&mut self, surface: &Surface<'_>, fan: u32, planar: &[[Vec2; 3]], points: usize) {
        let places = self.sheet.places();
        places.clear();
        places.resize(points, DVec2::ZERO);
        for (corner, planar) in surface.fans.corners(fan as usize).iter().zip(planar) {
            // A fan has one corner in each of its triangles.
            let found = self.parts.binary_search_by_key(&corner.triangle(), |part| part.corner.triangle());
            let Ok(found) = found else { continue };
            for (slot, place) in self.parts[found].corner.slots().into_iter().zip(planar) {
                places[self.points[3 * found + slot] as usize] = place.as_dvec2();
            }
        }
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
        let mut points = Vec::with_capacity(6 * self.parts.len());
        for (i, part) in self.parts.iter().enumerate() {
            let at = self.sheet.corners(i).map(|p| p.as_vec2());
            outline_points(at, part.inside, limits.delta, true, |p| points.push(p.extend(0.0)));
        }
        let rectangle = rectangles.smallest(&mut points, limits.pad);
        let Rectangle { min, size, .. } = rectangle;
        let mut distortion = Distortion::default();
        let mut region = Region { size, ..Region::default() };
        let mut corners = Vec::with_capacity(3 * self.parts.len());
        let mut cos = 1.0f32;
        for (i, part) in self.parts.iter().enumerate() {
            let (normal, area) = surface.fan_facet(part.corner);
            cos = cos.min(normal.dot(direction));
            let at = self.sheet.corners(i).map(|p| rectangle.turned(p.as_vec2()));
            let [a, b, c] = surface.fan_triangle(part.corner);
            let share = part.inside.map(f32::from).iter().sum::<f32>() / 3.0;
            distortion.add_edges([b - a, c - a], [at[1] - at[0], at[2] - at[0]], area * share);
            region.area += (at[1] - at[0]).perp_dot(at[2] - at[0]).abs() * 0.5 * share;
            region.outline += outline_length(at, part.inside);
            for k in (0..3).filter(|k| self.sheet.is_border(i, *k)) {
                let ends = f32::from(part.inside[k]) + f32::from(part.inside[(k + 1) % 3]);
                region.outline += 0.5 * ends * at[k].distance(at[(k + 1) % 3]);
            }
            let mut by_slot = [Vec2::ZERO; 3];
            let slots = part.corner.slots();
            for (slot, place) in slots.into_iter().zip(at) {
                by_slot[slot] = place;
            }
            let corner = |slot: usize| (3 * part.corner.triangle() + slot) as u32;
            corners.extend((0..3).filter(|&k| part.inside[k]).map(|k| (corner(slots[k]), by_slot)));
        }
        let origin = surface.fan_center(fan as usize);
        let frame = Frame { origin, direction, x_axis: direction.any_orthonormal_vector() };
        (Flat { frame, min, region, cos, distortion, outline: Box::default() }, corners.into())
    }
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
        Unroller::default().unroll(surface, fans, &[], &LIMITS, &mut RectangleFinder::default(), |_, _| 0.0)
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

    /// Laid from where its parts lie, a union succeeds as often as from a circle, and ends no worse.
    #[test]
    fn unions_begin_where_their_parts_lie() {
        let mut random = Random::new(3);
        let mut model = generate::icosphere(3);
        for p in &mut model.positions {
            *p *= 1.0 + 0.4 * (random.unit() - 0.5);
        }
        let mesh = cleaned(model);
        let surface = surface(&mesh);
        let mut unroller = Unroller::default();
        let mut unroll = |fans: &[u32], lying: &[Lying<'_>]| {
            unroller.unroll(&surface, fans, lying, &LIMITS, &mut RectangleFinder::default(), |_, _| 0.0)
        };
        let (mut found, mut errors) = ([0; 2], [0.0; 2]);
        for seed in 0..surface.fans.len() {
            let ring = |&corner: &FanCorner| surface.fans.of_triangle(corner.triangle())[corner.slots()[1]];
            let fans: Vec<u32> =
                surface.fans.corners(seed).iter().map(ring).take(4).chain([seed as u32]).collect();
            let parts = [&fans[..2], &fans[2..]];
            let [Some(one), Some(other)] = parts.map(|fans| unroll(fans, &[])) else { continue };
            let lying: Vec<Lying<'_>> = std::iter::zip(parts, [&one, &other])
                .map(|(fans, (flat, corners))| Lying { fans, frame: &flat.frame, corners })
                .collect();
            let unions = [unroll(&fans, &[]), unroll(&fans, &lying)];
            let error = |(flat, _): &(Flat, FlatCorners)| flat.distortion.error(Vec2::ONE);
            let is_both = unions.iter().all(Option::is_some);
            for (k, union) in unions.iter().enumerate() {
                found[k] += usize::from(union.is_some());
                errors[k] += if is_both { union.as_ref().map_or(0.0, error) } else { 0.0 };
            }
        }
        assert!(found[1] >= found[0] && found[0] > surface.fans.len() / 2, "{found:?}");
        assert!(errors[1] <= errors[0], "{errors:?}");
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
}
