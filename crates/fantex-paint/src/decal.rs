//! Pictures at a place of the surface: stickers, texts.

use std::sync::Arc;

use fantex_cover::TexelTriangle;
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::dab::{Chart, tangent_axes};
use crate::tile_paint::{Ink, Patch, TexelPage, TexelUnder, tangent_from_picture};
use crate::{PaintColor, Picture, Region, Surface, SurfacePoint, Symmetry};

/// A picture that lies on the surface around a point and follows it.
#[derive(Clone, Debug)]
pub struct Decal {
    /// Its middle.
    pub center: SurfacePoint,
    /// Length of its longer side, mesh units along the surface.
    pub size: f32,
    /// Radians, counter-clockwise on the surface; 0 is upright.
    pub angle: f32,
    /// Its alpha says where it covers. Colours are those of the channels.
    pub shape: Arc<Picture>,
    /// Left and right are changed, of the shape and of colours that are pictures.
    pub mirrored: bool,
}

impl Decal {
    /// The decal and its copies on the other sides of the model, turned as symmetry turns them. Mirror images are mirrored,
    /// unless they are to be `readable`. Copies that find no surface within half the decal's size are left out.
    pub fn copies(&self, surface: &Surface, symmetry: &Symmetry, readable: bool) -> Vec<Self> {
        let places = symmetry.places(surface, self.center, 0.5 * self.size);
        let [right, _] = turned_axes(surface, self.center, self.angle);
        let copies = (0u32..).zip(places).filter_map(|(k, place)| {
            let center = place?;
            if k == 0 {
                return Some(self.clone());
            }
            let is_image = symmetry.mirrors();
            // A mirrored picture's right points to the left.
            let right = symmetry.moved_direction(right, k) * if is_image { -1.0 } else { 1.0 };
            let (x, y) = tangent_axes(surface.outer_normal(center.triangle));
            let angle = right.dot(y).atan2(right.dot(x)) as f32;
            Some(Self { center, angle, mirrored: self.mirrored != (is_image && !readable), ..self.clone() })
        });
        copies.collect()
    }
}

/// Where a picture's right and upright direction point around a point, mesh space.
fn turned_axes(surface: &Surface, point: SurfacePoint, angle: f32) -> [DVec3; 2] {
    let (x, y) = tangent_axes(surface.outer_normal(point.triangle));
    let (sin, cos) = f64::from(angle).sin_cos();
    [x * cos + y * sin, y * cos - x * sin]
}

/// A decal with the part of the surface that it covers.
pub(crate) struct PlacedDecal<'a> {
    surface: &'a Surface,
    region: Region,
    chart: Chart,
    shape: &'a Picture,
    /// Coordinates of the picture per mesh unit, to the right and upwards.
    scale: Vec2,
    ink: &'a Ink<'a>,
}

impl<'a> PlacedDecal<'a> {
    pub(crate) fn new(surface: &'a Surface, decal: &'a Decal, ink: &'a Ink<'a>) -> Self {
        let half = (0.5 * decal.size).max(0.5 / surface.cover().density);
        let [columns, rows] = decal.shape.extent().map(|n| n as f32);
        let longer = columns.max(rows);
        // Half the diagonal, and a texel for the border.
        let reach = half * (columns / longer).hypot(rows / longer) + 1.5 / surface.cover().density;
        let region = Region::grow(surface, decal.center, reach * 1.05);
        let axes = turned_axes(surface, decal.center, decal.angle);
        let chart = Chart::unfold(surface, &region, decal.center, axes);
        let scale = Vec2::new(if decal.mirrored { -1.0 } else { 1.0 }, 1.0) / half;
        Self { surface, region, chart, shape: &decal.shape, scale, ink }
    }

    /// Where the picture's right and upright direction point on a triangle, mesh space.
    fn axes(&self, triangle: &TexelTriangle, index: usize) -> [Vec3; 2] {
        let Some([a, b, c]) = self.chart.triangle(index) else { return [Vec3::ZERO; 2] };
        let [p, q, r] = self.surface.mesh().triangle_positions(triangle.triangle as usize);
        let area = (b - a).perp_dot(c - a);
        let right = ((q - p) * (c - a).y - (r - p) * (b - a).y) / area;
        let up = ((r - p) * (b - a).x - (q - p) * (c - a).x) / area;
        [right * self.scale.x, up].map(|axis| axis.normalize_or_zero())
    }

    /// Side of a texel in coordinates of the picture.
    fn texel_width(&self, triangle: &TexelTriangle, index: usize) -> f32 {
        let Some([a, b, c]) = self.chart.triangle(index) else { return 0.0 };
        let step = |l: Vec3| (a * l.x + b * l.y + c * l.z).length_squared();
        (0.5 * (step(triangle.steps[0]) + step(triangle.steps[1]))).sqrt() * self.scale.y
    }
}

impl Patch for PlacedDecal<'_> {
    fn region(&self) -> &Region {
        &self.region
    }

    fn at(&self, map: &TexelPage, under: &TexelUnder<'_>, colors: &mut [Vec4]) -> f32 {
        let Some(place) = self.chart.at(under.index, under.lambda) else { return 0.0 };
        let (place, width) = (place * self.scale, self.texel_width(under.triangle, under.index));
        let covered = self.shape.alpha(place, width);
        if covered <= 0.0 {
            return 0.0;
        }
        for (color, painted) in colors.iter_mut().zip(&self.ink.paint.channels) {
            *color = match &painted.color {
                PaintColor::Image(picture) if self.ink.is_tangent(painted) => {
                    tangent_from_picture(picture.color(place, width), self.axes(under.triangle, under.index))
                }
                PaintColor::Image(picture) => picture.color(place, width),
                _ => {
                    let straight = self.ink.at(map, under.place, painted).unwrap_or(Vec4::ZERO);
                    (straight.truncate() * straight.w).extend(straight.w)
                }
            };
        }
        covered
    }
}
