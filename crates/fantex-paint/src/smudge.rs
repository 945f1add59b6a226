//! Smudging: the brush picks up what is under it, carries some of it along, and lays it down.
//!
//! What is carried is a grid of colours in the flat coordinates of the brush ([`Chart`]). Dab after dab the grid is mixed with what
//! is seen at its new place (the texture function, with all dabs before), and laid down as a function of the surface, so that
//! all tiles get the same. (After the pick-up and put-down buffers of W. Baxter, V. Scheib, M. Lin and D. Manocha, "DAB: interactive
//! haptic painting with 3D virtual brushes", 2001.)

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_store::{PAGE, PageCache, PageId};
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::composite::{Ink, tangent_from_stored};
use crate::cover::{Patch, TexelUnder};
use crate::dab::{Chart, PlacedDab, tangent_axes};
use crate::stroke_page::StrokePage;
use crate::texel_page::TexelPage;
use crate::{Dab, Region, Surface, SurfacePoint};

/// Cells along a side of the grid, at most.
const MAX_CELLS: usize = 48;

/// Cells along a side of the grid, at least.
const MIN_CELLS: usize = 4;

/// What a brush carries.
#[derive(Clone, Debug)]
pub(crate) struct Finger {
    /// Where it was, mesh space.
    center: DVec3,
    /// The x axis of its grid.
    axis: DVec3,
    radius: f32,
    cells: Vec<Cell>,
}

/// Colours per painted channel, linear RGBA multiplied by alpha; none where the brush has met no surface yet.
type Cell = Option<Vec<Vec4>>;

/// The pages under a dab.
pub(crate) type PagesUnder = BTreeMap<PageId, (Arc<TexelPage>, StrokePage)>;

/// One dab of a smudge.
pub(crate) struct SmudgeDab {
    dab: PlacedDab,
    chart: Chart,
    center: DVec3,
    axis: DVec3,
    side: usize,
}

/// The finger that a dab continues: the one that was nearest, unless it was more than a diameter away. (Symmetric strokes have
/// several.)
pub(crate) fn finger_of(fingers: &mut Vec<Finger>, surface: &Surface, dab: &Dab) -> Option<Finger> {
    let center = surface.position(dab.center);
    let distances = fingers.iter().map(|finger| finger.center.distance(center)).enumerate();
    let (nearest, distance) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (distance <= 2.0 * f64::from(dab.radius)).then(|| fingers.swap_remove(nearest))
}

impl SmudgeDab {
    pub(crate) fn new(surface: &Surface, dab: &Dab, finger: Option<&Finger>) -> Self {
        let texel = 1.0 / surface.cover().density;
        let placed = PlacedDab::new(surface, dab, texel);
        let normal = surface.facet_normal(dab.center.triangle);
        let upright = tangent_axes(normal).0;
        // The grid does not turn on its way, but for what the surface turns.
        let axis = finger.map_or(upright, |f| (f.axis - normal * normal.dot(f.axis)).normalize_or(upright));
        let chart = Chart::unfold(surface, &placed.region, dab.center, [axis, normal.cross(axis)]);
        let side = ((2.0 * placed.reach() / texel).ceil() as usize).clamp(MIN_CELLS, MAX_CELLS);
        Self { center: surface.position(dab.center), dab: placed, chart, axis, side }
    }

    pub(crate) fn region(&self) -> &Region {
        &self.dab.region
    }

    /// Picks up what is under the dab, over what the finger has carried here.
    pub(crate) fn picked_up(
        &self,
        finger: Option<Finger>,
        strength: f32,
        ink: &Ink<'_>,
        pages: &PagesUnder,
    ) -> Finger {
        let reach = self.dab.reach();
        let carried = finger.as_ref().map_or(0.0, |f| {
            let way = f.center.distance(self.center) as f32;
            strength.clamp(0.0, 1.0).powf(way / reach)
        });
        // A brush of another size carries its grid along as it is.
        let side = finger.as_ref().map_or(self.side, |f| f.cells.len().isqrt());
        let points = self.points(side);
        let cells = points.into_par_iter().enumerate().map(|(cell, point)| {
            let old = finger.as_ref().and_then(|f| f.cells[cell].clone());
            let Some(point) = point else { return old };
            let seen: Vec<Vec4> =
                (0..ink.paint.channels.len()).map(|k| current(ink, pages, k, point)).collect();
            Some(match old {
                Some(old) => old.iter().zip(&seen).map(|(old, seen)| seen.lerp(*old, carried)).collect(),
                None => seen,
            })
        });
        Finger { center: self.center, axis: self.axis, radius: reach, cells: cells.collect() }
    }

    /// The surface under each cell.
    fn points(&self, side: usize) -> Vec<Option<SurfacePoint>> {
        let mut points = vec![None; side * side];
        // Cell c spans c..c+1 of `side` over the diameter.
        let scale = 0.5 * side as f32 / self.dab.reach();
        let middle = 0.5 * side as f32;
        let last = side as f32 - 1.0;
        for (index, entry) in self.region().triangles.iter().enumerate() {
            let Some(corners) = self.chart.triangle(index) else { continue };
            let [a, b, c] = corners.map(|p| p * scale + middle);
            let low = a.min(b).min(c) - 0.5;
            let high = a.max(b).max(c) - 0.5;
            if high.min_element() < 0.0 || low.max_element() > last {
                continue;
            }
            let [from, to] =
                [low.ceil(), high.floor()].map(|p| p.clamp(Vec2::ZERO, Vec2::splat(last)).as_uvec2());
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let point = &mut points[y as usize * side + x as usize];
                    let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                    if point.is_none()
                        && let Some(lambda) = barycentric([a, b, c], at)
                    {
                        *point = Some(SurfacePoint { triangle: entry.triangle, lambda });
                    }
                }
            }
        }
        points
    }
}

/// Barycentric coordinates of a point in a flat triangle; none outside.
fn barycentric([a, b, c]: [Vec2; 3], p: Vec2) -> Option<Vec3> {
    let area = (b - a).perp_dot(c - a);
    let y = (p - a).perp_dot(c - a) / area;
    let z = (b - a).perp_dot(p - a) / area;
    let lambda = Vec3::new(1.0 - y - z, y, z);
    (lambda.min_element() >= -1e-5).then(|| {
        let inside = lambda.max(Vec3::ZERO);
        inside / inside.element_sum()
    })
}

/// What is seen at a point with the stroke so far: linear RGBA, multiplied by alpha. `number`: of the painted channel.
fn current(ink: &Ink<'_>, pages: &PagesUnder, number: usize, point: SurfacePoint) -> Vec4 {
    let (mesh, cover) = (ink.surface.mesh(), ink.surface.cover());
    let Some(before) = ink.before else { return Vec4::ZERO };
    let triangle = point.triangle as usize;
    let mut sum = Vec4::ZERO;
    for (slot, weight) in cover.weights(triangle, point.lambda).iter() {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * point.lambda.x + b * point.lambda.y + c * point.lambda.z;
        let group = cover.corner_groups[triangle][slot];
        sum += weight * current_in_tile(ink, before, pages, number, (group, uv), point);
    }
    sum
}

fn current_in_tile(
    ink: &Ink<'_>,
    before: &PageCache,
    pages: &PagesUnder,
    number: usize,
    (group, uv): (u32, Vec2),
    point: SurfacePoint,
) -> Vec4 {
    let extent = ink.surface.cover().groups[group as usize].extent;
    let tile = before.tile(ink.paint.channels[number].channel, group, 0);
    let last = Vec2::new(extent[0] as f32, extent[1] as f32) - 1.0;
    let at = (uv * (last + 1.0) - 0.5).clamp(Vec2::ZERO, last);
    let (corner, f) = (at.floor(), at.fract());
    let texel = |dx: u32, dy: u32| {
        let x = (corner.x as u32 + dx).min(extent[0] - 1);
        let y = (corner.y as u32 + dy).min(extent[1] - 1);
        let stored = Vec4::from_array(tile.texel(x, y));
        let is_tangent = ink.is_tangent(&ink.paint.channels[number]);
        let original =
            if is_tangent { tangent_from_stored(ink.surface, group, point, stored) } else { stored };
        let id = PageId { group, level: 0, page: [x / PAGE, y / PAGE] };
        let seen = pages.get(&id).map_or(original, |(map, page)| {
            let texel = (y % PAGE * map.block.extent[0] + x % PAGE) as usize;
            match page.color(number, texel) {
                Some(color) if page.covered(texel) > 0.0 => {
                    ink.paint.apply(original, color, page.covered(texel))
                }
                _ => original,
            }
        });
        (seen.truncate() * seen.w).extend(seen.w)
    };
    let upper = texel(0, 0).lerp(texel(1, 0), f.x);
    upper.lerp(texel(0, 1).lerp(texel(1, 1), f.x), f.y)
}

/// What a finger lays down where its dab is.
pub(crate) struct LaidDown<'a> {
    pub(crate) dab: &'a SmudgeDab,
    pub(crate) finger: &'a Finger,
    pub(crate) surface: &'a Surface,
}

impl Patch for LaidDown<'_> {
    fn region(&self) -> &Region {
        self.dab.region()
    }

    fn at(&self, _: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32 {
        let Some(place) = self.dab.chart.at(under.index, under.lambda) else { return 0.0 };
        let position = crate::cover::blend(self.surface, under.triangle.triangle, under.lambda);
        let entry = &self.dab.region().triangles[under.index];
        let covered = self.dab.dab.coverage(entry, under.lambda, position);
        if covered > 0.0 && self.finger.at(place, colors) { covered } else { 0.0 }
    }
}

impl Finger {
    /// The carried colours at a place of the brush, mesh units from its middle; false where there are none.
    fn at(&self, place: Vec2, colors: &mut [Vec4]) -> bool {
        let side = self.cells.len().isqrt();
        let at = place * (0.5 * side as f32 / self.radius) + 0.5 * side as f32 - 0.5;
        let at = at.clamp(Vec2::ZERO, Vec2::splat(side as f32 - 1.0));
        let (corner, f) = (at.floor().as_uvec2(), at.fract());
        let mut total = 0.0;
        colors.fill(Vec4::ZERO);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let weight = (if dx == 0 { 1.0 - f.x } else { f.x }) * (if dy == 0 { 1.0 - f.y } else { f.y });
            let x = (corner.x as usize + dx).min(side - 1);
            let y = (corner.y as usize + dy).min(side - 1);
            if let Some(cell) = &self.cells[y * side + x] {
                total += weight;
                colors.iter_mut().zip(cell).for_each(|(sum, color)| *sum += *color * weight);
            }
        }
        if total <= 0.0 {
            return false;
        }
        colors.iter_mut().for_each(|sum| *sum /= total);
        true
    }
}
