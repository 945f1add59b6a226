//! Smudging: the brush picks up what is under it, carries some of it along, and lays it down.
//!
//! What is carried is a grid of colours in the flat coordinates of the brush ([`Chart`]). Dab after dab the grid is mixed with what
//! is seen at its new place (the texture function, with all dabs before), and laid down as a function of the surface, so that
//! all tiles get the same. (After the pick-up and put-down buffers of W. Baxter, V. Scheib, M. Lin and D. Manocha, "DAB: interactive
//! haptic painting with 3D virtual brushes", 2001.)

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_cover::{Tap, TexelTriangle};
use fantex_store::{PAGE, PageId, TileId, TileSource, TileTexels};
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::composite::{PaintContext, bilinear, tangent_from_stored, texels_around};
use crate::cover::{Patch, TexelUnder, Touch};
use crate::dab::{Chart, PlacedDab, tangent_axes};
use crate::stroke_page::StrokePage;
use crate::texel_page::TexelPage;
use crate::{Dab, Region, Surface, SurfacePoint};

/// Cells along a side of the grid, at most.
const MAX_CELLS: usize = 48;

/// Cells along a side of the grid, at least.
const MIN_CELLS: usize = 4;

#[derive(Clone, Debug)]
pub(crate) struct SmudgeBuffer {
    /// Where it was, mesh space.
    center: DVec3,
    /// The x axis of its grid.
    axis: DVec3,
    radius: f32,
    cells: Vec<Cell>,
}

/// Colours per painted channel, linear RGBA multiplied by alpha; none where the brush has met no surface yet.
type Cell = Option<Vec<Vec4>>;

pub(crate) type PagesUnder = BTreeMap<PageId, (Arc<TexelPage>, StrokePage)>;

pub(crate) struct SmudgeDab {
    dab: PlacedDab,
    chart: Chart,
    center: DVec3,
    axis: DVec3,
    side: usize,
}

/// The buffer that a dab continues: the one that was nearest, unless it was more than a diameter away. (Symmetric strokes have
/// several.)
pub(crate) fn buffer_of(
    buffers: &mut Vec<SmudgeBuffer>,
    surface: &Surface,
    dab: &Dab,
) -> Option<SmudgeBuffer> {
    let center = surface.position(dab.center);
    let distances = buffers.iter().map(|buffer| buffer.center.distance(center)).enumerate();
    let (nearest, distance) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (distance <= 2.0 * f64::from(dab.radius)).then(|| buffers.swap_remove(nearest))
}

impl SmudgeDab {
    pub(crate) fn new(surface: &Surface, dab: &Dab, buffer: Option<&SmudgeBuffer>) -> Self {
        let texel = 1.0 / surface.cover().density;
        let placed = PlacedDab::new(surface, dab, texel);
        let normal = surface.facet_normal(dab.center.triangle);
        let upright = tangent_axes(normal).0;
        // The grid does not turn on its way, but for what the surface turns.
        let axis = buffer.map_or(upright, |f| (f.axis - normal * normal.dot(f.axis)).normalize_or(upright));
        let chart = Chart::unfold(surface, &placed.region, dab.center, [axis, normal.cross(axis)]);
        let side = ((2.0 * placed.reach() / texel).ceil() as usize).clamp(MIN_CELLS, MAX_CELLS);
        Self { center: surface.position(dab.center), dab: placed, chart, axis, side }
    }

    pub(crate) fn region(&self) -> &Region {
        &self.dab.region
    }

    /// Picks up what is under the dab, over what the buffer has carried here.
    pub(crate) fn picked_up(
        &self,
        buffer: Option<SmudgeBuffer>,
        strength: f32,
        context: &PaintContext<'_>,
        pages: &PagesUnder,
    ) -> SmudgeBuffer {
        let reach = self.dab.reach();
        let carried = buffer.as_ref().map_or(0.0, |f| {
            let way = f.center.distance(self.center) as f32;
            strength.clamp(0.0, 1.0).powf(way / reach)
        });
        // A brush of another size carries its grid along as it is.
        let side = buffer.as_ref().map_or(self.side, |f| f.cells.len().isqrt());
        let points = self.points(side);
        let cells = points.into_par_iter().enumerate().map(|(cell, point)| {
            let old = buffer.as_ref().and_then(|f| f.cells[cell].clone());
            let Some(point) = point else { return old };
            let seen: Vec<Vec4> =
                (0..context.paint.channels.len()).map(|k| current(context, pages, k, point)).collect();
            Some(match old {
                Some(old) => old.iter().zip(&seen).map(|(old, seen)| seen.lerp(*old, carried)).collect(),
                None => seen,
            })
        });
        SmudgeBuffer { center: self.center, axis: self.axis, radius: reach, cells: cells.collect() }
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

/// Barycentric coordinates of a point in a flat triangle; none outside, nor in one without an area.
fn barycentric([a, b, c]: [Vec2; 3], p: Vec2) -> Option<Vec3> {
    let area = (b - a).perp_dot(c - a);
    let y = (p - a).perp_dot(c - a) / area;
    let z = (b - a).perp_dot(p - a) / area;
    let lambda = Vec3::new(1.0 - y - z, y, z);
    (area != 0.0 && lambda.is_finite() && lambda.min_element() >= -1e-5).then(|| {
        let inside = lambda.max(Vec3::ZERO);
        inside / inside.element_sum()
    })
}

/// What is seen at a point with the stroke so far: linear RGBA, multiplied by alpha. `number`: of the painted channel.
fn current(context: &PaintContext<'_>, pages: &PagesUnder, number: usize, point: SurfacePoint) -> Vec4 {
    let Some(before) = context.before else { return Vec4::ZERO };
    let painted = &context.paint.channels[number];
    let is_tangent = context.is_tangent(painted);
    let cover = context.surface.cover();
    let look_up = |tap: Tap| {
        let tile = before.tile(painted.channel, TileId { group: tap.group, level: 0 });
        let texel = |[x, y]: [u32; 2]| {
            let stored = Vec4::from_array(tile.texel(x, y));
            let original = if is_tangent {
                tangent_from_stored(context.surface, tap.group, point, stored)
            } else {
                stored
            };
            let id = PageId { group: tap.group, level: 0, page: [x / PAGE, y / PAGE] };
            let seen = pages.get(&id).map_or(original, |(map, page)| {
                let texel = map.texel([x % PAGE, y % PAGE]);
                match page.color(number, texel) {
                    Some(color) if page.covered(texel) > 0.0 => {
                        painted.keep(original, context.paint.apply(original, color, page.covered(texel)))
                    }
                    _ => original,
                }
            });
            (seen.truncate() * seen.w).extend(seen.w)
        };
        let (places, f) = texels_around(cover.groups[tap.group as usize].extent, tap.uv);
        tap.weight * bilinear(places.map(texel), f)
    };
    cover.taps(context.surface.mesh(), point).map(look_up).sum()
}

pub(crate) struct LaidDown<'a> {
    pub(crate) dab: &'a SmudgeDab,
    pub(crate) buffer: &'a SmudgeBuffer,
    pub(crate) surface: &'a Surface,
}

impl Touch for LaidDown<'_> {
    fn region(&self) -> &Region {
        self.dab.region()
    }

    fn texels(&self, index: usize, shown: &TexelTriangle) -> Option<[Vec2; 2]> {
        self.dab.dab.texels(index, shown)
    }
}

impl Patch for LaidDown<'_> {
    fn at(&self, _: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32 {
        let lambda = under.point.lambda;
        let Some(place) = self.dab.chart.at(under.index, lambda) else { return 0.0 };
        let position = under.point.position(self.surface.mesh());
        let entry = &self.dab.region().triangles[under.index];
        let covered = self.dab.dab.coverage(entry, lambda, position);
        if covered > 0.0 && self.buffer.at(place, colors) { covered } else { 0.0 }
    }
}

impl SmudgeBuffer {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_in_triangles_that_have_an_area() {
        let [a, b, c] = [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0)].map(|(x, y)| Vec2::new(x, y));
        assert_eq!(barycentric([a, b, c], Vec2::new(0.5, 1.0)), Some(Vec3::new(0.25, 0.25, 0.5)));
        assert_eq!(barycentric([a, b, c], Vec2::new(1.5, 1.0)), None);
        // Needles, whatever two corners coincide, and points beside them, on them and at their ends.
        for corners in [[a, a, c], [a, c, a], [c, a, a], [a, a, a], [a, b, 2.0 * b]] {
            let places = [(0.0, 1.0), (0.5, 1.0), (-0.5, 1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 2.0)];
            for at in places.map(|(x, y)| Vec2::new(x, y)) {
                assert_eq!(barycentric(corners, at), None, "{corners:?} {at}");
            }
        }
    }
}
