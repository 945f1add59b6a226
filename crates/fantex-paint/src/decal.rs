//! Pictures at a place of the surface: stickers, texts.

use std::sync::Arc;

use fantex_cover::TexelTriangle;
use glam::{Vec3, Vec4};

use crate::dab::{Chart, tangent_axes};
use crate::tile_paint::{Ink, Patch, TexelPage, TexelUnder};
use crate::{PaintColor, Picture, Region, Surface, SurfacePoint};

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
}

/// A decal with the part of the surface that it covers.
pub(crate) struct PlacedDecal<'a> {
    region: Region,
    chart: Chart,
    shape: &'a Picture,
    /// Coordinates of the picture per mesh unit.
    scale: f32,
    ink: &'a Ink<'a>,
}

impl<'a> PlacedDecal<'a> {
    pub(crate) fn new(surface: &Surface, decal: &'a Decal, ink: &'a Ink<'a>) -> Self {
        let half = (0.5 * decal.size).max(0.5 / surface.cover().density);
        let [columns, rows] = decal.shape.extent().map(|n| n as f32);
        let longer = columns.max(rows);
        // Half the diagonal, and a texel for the border.
        let reach = half * (columns / longer).hypot(rows / longer) + 1.5 / surface.cover().density;
        let region = Region::grow(surface, decal.center, reach * 1.05);
        let (x, y) = tangent_axes(surface.facet_normal(decal.center.triangle));
        let (sin, cos) = f64::from(decal.angle).sin_cos();
        let chart = Chart::unfold(surface, &region, decal.center, [x * cos + y * sin, y * cos - x * sin]);
        Self { region, chart, shape: &decal.shape, scale: 1.0 / half, ink }
    }

    /// Side of a texel in coordinates of the picture.
    fn texel_width(&self, triangle: &TexelTriangle, index: usize) -> f32 {
        let Some([a, b, c]) = self.chart.triangle(index) else { return 0.0 };
        let step = |l: Vec3| (a * l.x + b * l.y + c * l.z).length_squared();
        (0.5 * (step(triangle.steps[0]) + step(triangle.steps[1]))).sqrt() * self.scale
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
