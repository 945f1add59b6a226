//! What colour a stroke lays on a texel.

use fantex_store::{AssetEditor, ChannelKind, PAGE, PageCache, PageId};
use glam::{DVec3, Vec2, Vec3, Vec4};

use super::cover::blend;
use super::normals::{stored_from_tangent, tangent_from_picture, tangent_from_stored};
use super::shade::shade;
use super::stroke_page::StrokePage;
use super::texel_page::TexelPage;
use crate::stroke::walk_straight;
use crate::{ChannelPaint, Paint, PaintColor, PaintError, Surface, SurfacePoint, Tool};

/// The colours of a stroke.
pub(crate) struct Ink<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) paint: &'a Paint,
    /// The texture function before the stroke, where the tool asks for it.
    pub(crate) before: Option<&'a PageCache>,
    /// The channel that holds normals, if any.
    pub(crate) normals: Option<usize>,
}

/// Points of a ring around the centre of a blur.
const RING: u32 = 6;

/// Rings at these shares of the radius, with the weight of each point; the centre weighs 1. (A Gaussian with a standard
/// deviation of half the radius.)
const RINGS: [(f64, f32); 2] = [(0.5, 0.607), (1.0, 0.135)];

impl Ink<'_> {
    /// The colour of a channel, by its number among the painted ones, at a texel that shows the surface, given by column and
    /// row; none where there is nothing to lay down.
    pub(crate) fn color(
        &self,
        map: &TexelPage,
        page: &StrokePage,
        [x, y]: [u32; 2],
        number: usize,
    ) -> Option<Vec4> {
        let texel = (y * map.block.extent[0] + x) as usize;
        let painted = &self.paint.channels[number];
        let value = page.color(number, texel).or_else(|| self.at(map, [x, y], painted))?;
        if !self.is_tangent(painted) {
            return Some(value);
        }
        let triangle = &map.triangles[map.owner[texel] as usize];
        let point = nearest_inside(triangle.triangle, map.lambda(triangle, x, y));
        Some(stored_from_tangent(self.surface, map.group, point, value))
    }

    /// True where the colour is the tangent part of a normal: not what a tile stores.
    pub(crate) fn is_tangent(&self, painted: &ChannelPaint) -> bool {
        let is_picture = matches!(painted.color, PaintColor::Image(_) | PaintColor::Projected(_));
        Some(painted.channel) == self.normals && (is_picture || self.paint.tool.reads_surface())
    }

    /// The same for what does not depend on the dabs; of normals that are moved the tangent part (see `normals.rs`).
    pub(crate) fn at(&self, map: &TexelPage, [x, y]: [u32; 2], painted: &ChannelPaint) -> Option<Vec4> {
        let triangle = &map.triangles[map.owner[(y * map.block.extent[0] + x) as usize] as usize];
        let lambda = map.lambda(triangle, x, y);
        match (&self.paint.tool, self.before) {
            (Tool::Blur { radius }, Some(before)) => {
                let point = nearest_inside(triangle.triangle, lambda);
                return Some(self.blurred(before, painted.channel, point, *radius));
            }
            (Tool::Clone { offset, reach }, Some(before)) => {
                let position = blend(self.surface, triangle.triangle, lambda);
                let source = self.surface.nearest(position + *offset, *reach)?;
                return Some(look_up(self.surface, before, painted.channel, source));
            }
            _ => {}
        }
        match &painted.color {
            PaintColor::Constant(color) => Some(*color),
            PaintColor::Texture(texture) => {
                Some(shade(self.surface, triangle, lambda, |point| texture.evaluate(point)))
            }
            PaintColor::Image(_) => None,
            PaintColor::Projected(projection) => {
                let point = nearest_inside(triangle.triangle, lambda);
                let steps = triangle.steps.map(|step| blend(self.surface, triangle.triangle, step));
                let color = match self.paint.stencil {
                    // It says where: sight need not be tested again.
                    Some(_) => projection.color_at(self.surface, point, steps)?,
                    None => projection.at(self.surface, point, steps)?,
                };
                let is_tangent = self.is_tangent(painted);
                Some(if is_tangent { tangent_from_picture(color, projection.axes()) } else { color })
            }
        }
    }

    /// The mean around a point, along the surface.
    fn blurred(&self, before: &PageCache, channel: usize, point: SurfacePoint, radius: f32) -> Vec4 {
        let mut sum = look_up(self.surface, before, channel, point);
        let mut total = 1.0;
        let normal = self.surface.facet_normal(point.triangle);
        let axis = normal.any_orthonormal_vector();
        for (share, weight) in RINGS {
            for k in 0..RING {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(RING)).sin_cos();
                let direction: DVec3 = axis * cos + normal.cross(axis) * sin;
                let tap = walk_straight(self.surface, point, direction, share * f64::from(radius));
                sum += look_up(self.surface, before, channel, tap) * weight;
                total += weight;
            }
        }
        sum / total
    }
}

/// A texel just off its triangle stands for the point beside it.
pub(crate) fn nearest_inside(triangle: u32, lambda: Vec3) -> SurfacePoint {
    let inside = lambda.max(Vec3::ZERO);
    SurfacePoint { triangle, lambda: inside / inside.element_sum() }
}

/// The texture function at level 0; **linear** RGBA; of normals the tangent part.
pub(crate) fn look_up(surface: &Surface, cache: &PageCache, channel: usize, point: SurfacePoint) -> Vec4 {
    let tiles = tiles_under(surface, point);
    if cache.asset().channels()[channel].kind == ChannelKind::Normal {
        let values = tiles.map(|(group, uv, weight)| {
            let stored = Vec4::from_array(cache.bilinear(channel, group, 0, uv));
            weight * tangent_from_stored(surface, group, point, stored)
        });
        return values.sum();
    }
    let values =
        tiles.map(|(group, uv, weight)| weight * Vec4::from_array(cache.bilinear(channel, group, 0, uv)));
    values.sum()
}

/// The stored value with all changes that are not yet committed. Decodes the pages anew: for single points.
pub(crate) fn look_up_now(
    surface: &Surface,
    editor: &AssetEditor,
    channel: usize,
    point: SurfacePoint,
) -> Result<Vec4, PaintError> {
    let mut sum = Vec4::ZERO;
    for (group, uv, weight) in tiles_under(surface, point) {
        let extent = surface.cover().groups[group as usize].extent;
        let last = Vec2::new(extent[0] as f32, extent[1] as f32) - 1.0;
        let at = (uv * (last + 1.0) - 0.5).clamp(Vec2::ZERO, last);
        let (corner, f) = (at.floor().as_uvec2(), at.fract());
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let share = (if dx == 0 { 1.0 - f.x } else { f.x }) * (if dy == 0 { 1.0 - f.y } else { f.y });
            if share > 0.0 {
                let [x, y] = [corner.x + dx, corner.y + dy];
                let page = [x / PAGE, y / PAGE];
                let texels = editor.read_page(channel, PageId { group, level: 0, page })?;
                let texel = (y % PAGE * texels.extent[0] + x % PAGE) as usize;
                sum += Vec4::from_array(texels.rgba[texel]) * (share * weight);
            }
        }
    }
    Ok(sum)
}

/// The tiles that the texture function reads at a point: group, tile coordinates, weight.
fn tiles_under(surface: &Surface, point: SurfacePoint) -> impl Iterator<Item = (u32, Vec2, f32)> + '_ {
    let (mesh, cover) = (surface.mesh(), surface.cover());
    let triangle = point.triangle as usize;
    let weights = cover.weights(triangle, point.lambda);
    let mut slots = [(0, 0.0); 3];
    slots.iter_mut().zip(weights.iter()).for_each(|(slot, weighted)| *slot = weighted);
    slots.into_iter().take(weights.len()).map(move |(slot, weight)| {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * point.lambda.x + b * point.lambda.y + c * point.lambda.z;
        (cover.corner_groups[triangle][slot], uv, weight)
    })
}
