//! Surface-detail polygons as a texture.

use glam::{Vec2, Vec4};

use super::{DetailError, DetailPolygon, SurfaceDetail};
use crate::coordinates::{Coordinates, TextureMatrix};
use crate::look::Slot;
use crate::{ShadingPoint, Texture, UvPoint};

/// Polygons in the plane of the coordinates, each in a colour or a texture of its own, over what lies below them. Every
/// footprint gets the exact shares of what it covers, so that thin bars neither flicker nor vanish, however far away.
#[derive(Clone, Debug)]
pub struct PolygonsTexture {
    detail: SurfaceDetail,
    /// By the polygons' material.
    colors: Vec<Slot>,
    base: Slot,
    coordinates: Coordinates,
    matrix: TextureMatrix,
    repeats: bool,
}

impl PolygonsTexture {
    /// Polygons (their materials are indices of `colors`) over `base`, looked up by `coordinates` after `matrix`. With
    /// `repeats` they come again in every unit square of the coordinates; they may reach into the neighbouring ones.
    ///
    /// # Errors
    ///
    /// As [`SurfaceDetail::new`].
    ///
    /// # Panics
    ///
    /// Where a polygon's material has no colour.
    pub fn new(
        polygons: &[DetailPolygon],
        colors: Vec<Slot>,
        base: Slot,
        (coordinates, matrix): (Coordinates, TextureMatrix),
        repeats: bool,
    ) -> Result<Self, DetailError> {
        assert!(polygons.iter().all(|p| (p.material as usize) < colors.len()), "every polygon has a colour");
        let detail = match repeats {
            false => SurfaceDetail::new(polygons)?,
            true => {
                // Mistakes are told by the polygons' own numbers.
                SurfaceDetail::new(polygons)?;
                SurfaceDetail::new(&with_neighbours(polygons))?
            }
        };
        Ok(Self { detail, colors, base, coordinates, matrix, repeats })
    }

    /// The mean over a footprint; colours count in proportion to their alpha.
    fn mean(&self, at: &ShadingPoint<'_>, UvPoint { uv, steps }: UvPoint) -> Vec4 {
        let (uv, steps) = if self.repeats { in_one_square(uv, steps) } else { (uv, steps) };
        let mean = self.detail.coverage(uv, steps).mean(|material| {
            let color = material.map_or(&self.base, |m| &self.colors[m as usize]).evaluate(at);
            (color.truncate() * color.w).extend(color.w)
        });
        if mean.w > 0.0 { (mean.truncate() / mean.w).extend(mean.w) } else { Vec4::ZERO }
    }

    fn slots(&self) -> impl Iterator<Item = &Slot> {
        self.colors.iter().chain([&self.base])
    }
}

impl Texture for PolygonsTexture {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.coordinates.evaluate(at, |point| self.mean(at, self.matrix.apply(point, at.time)))
    }

    fn is_view_dependent(&self) -> bool {
        self.coordinates.is_view_dependent() || self.slots().any(Slot::is_view_dependent)
    }

    fn is_animated(&self) -> bool {
        self.matrix.is_animated() || self.coordinates.is_animated() || self.slots().any(Slot::is_animated)
    }
}

/// Each polygon in the unit square and in the eight around it.
fn with_neighbours(polygons: &[DetailPolygon]) -> Vec<DetailPolygon> {
    let shifts = || (0..9).map(|i| Vec2::new((i % 3) as f32 - 1.0, (i / 3) as f32 - 1.0));
    let shifted = |polygon: &DetailPolygon, shift: Vec2| {
        let outlines = polygon.outlines.iter().map(|outline| outline.iter().map(|&corner| corner + shift));
        DetailPolygon { outlines: outlines.map(Iterator::collect).collect(), ..polygon.clone() }
    };
    polygons.iter().flat_map(|polygon| shifts().map(move |shift| shifted(polygon, shift))).collect()
}

/// The same footprint around a point of the unit square; the whole square for a footprint that is larger.
fn in_one_square(uv: Vec2, steps: [Vec2; 2]) -> (Vec2, [Vec2; 2]) {
    let extent = steps[0].abs() + steps[1].abs();
    // Infinite and NaN count as large.
    if extent.cmple(Vec2::ONE).all() {
        (uv - uv.floor(), steps)
    } else {
        (Vec2::splat(0.5), [Vec2::X, Vec2::Y])
    }
}
