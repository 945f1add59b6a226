//! What colour a stroke lays on a texel.

use fantex_store::PageCache;
use fantex_texture::{Filtering, ShadingPoint};
use glam::{DVec3, Vec3, Vec4};

use super::cover::blend;
use super::texel_page::TexelPage;
use crate::stroke::walk_straight;
use crate::{ChannelPaint, Paint, PaintColor, Surface, SurfacePoint, Tool};

/// The colours of a stroke.
pub(crate) struct Ink<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) paint: &'a Paint,
    /// The texture function before the stroke, where the tool asks for it.
    pub(crate) before: Option<&'a PageCache>,
}

/// Points of a ring around the centre of a blur.
const RING: u32 = 6;

/// Rings at these shares of the radius, with the weight of each point; the centre weighs 1. (A Gaussian with a standard
/// deviation of half the radius.)
const RINGS: [(f64, f32); 2] = [(0.5, 0.607), (1.0, 0.135)];

impl Ink<'_> {
    /// The colour at a texel that shows the surface, given by column and row; none where there is nothing to copy.
    pub(crate) fn at(&self, map: &TexelPage, [x, y]: [u32; 2], painted: &ChannelPaint) -> Option<Vec4> {
        let triangle = &map.triangles[map.owner[(y * map.block.extent[0] + x) as usize] as usize];
        let lambda = map.lambda(triangle, x, y);
        let position = |lambda: Vec3| blend(self.surface, triangle.triangle, lambda);
        match (&self.paint.tool, self.before) {
            (Tool::Blur { radius }, Some(before)) => {
                let point = nearest_inside(triangle.triangle, lambda);
                Some(self.blurred(before, painted.channel, point, *radius))
            }
            (Tool::Clone { offset, reach }, Some(before)) => {
                let source = self.surface.nearest(position(lambda) + *offset, *reach)?;
                Some(look_up(self.surface, before, painted.channel, source))
            }
            _ => Some(match &painted.color {
                PaintColor::Constant(color) => *color,
                PaintColor::Texture(texture) => {
                    let object_from_mesh = self.surface.mesh().world_from_mesh.scale as f32;
                    let point = |lambda: Vec3| position(lambda) * object_from_mesh;
                    texture.evaluate(&ShadingPoint {
                        position: point(lambda),
                        position_steps: triangle.steps.map(point),
                        normal: self.surface.facet_normal(triangle.triangle).as_vec3(),
                        normal_steps: [Vec3::ZERO; 2],
                        uv: &[],
                        vertex_color: Vec4::ONE,
                        to_eye: None,
                        time: 0.0,
                        filtering: Filtering::Area,
                    })
                }
            }),
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
fn nearest_inside(triangle: u32, lambda: Vec3) -> SurfacePoint {
    let inside = lambda.max(Vec3::ZERO);
    SurfacePoint { triangle, lambda: inside / inside.element_sum() }
}

/// The texture function at level 0; **linear** RGBA.
pub(crate) fn look_up(surface: &Surface, cache: &PageCache, channel: usize, point: SurfacePoint) -> Vec4 {
    let (mesh, cover) = (surface.mesh(), surface.cover());
    let triangle = point.triangle as usize;
    let mut sum = Vec4::ZERO;
    for (slot, weight) in cover.weights(triangle, point.lambda).iter() {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * point.lambda.x + b * point.lambda.y + c * point.lambda.z;
        let group = cover.corner_groups[triangle][slot];
        sum += weight * Vec4::from_array(cache.bilinear(channel, group, 0, uv));
    }
    sum
}
