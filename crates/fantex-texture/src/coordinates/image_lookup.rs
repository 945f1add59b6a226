//! An image on a surface.

use std::sync::Arc;

use glam::{Vec2, Vec4};

use super::{Coordinates, TextureMatrix};
use crate::{
    AREAS_AT_ONCE, Dependence, Filter, Filtering, ImageTexture, SampleOptions, ShadingPoint, Texture, UvPoint,
};

/// An image, looked up by any coordinates.
#[derive(Clone, Debug)]
pub struct ImageLookup {
    /// The image.
    pub texture: Arc<ImageTexture>,
    /// Where it is looked up.
    pub coordinates: Coordinates,
    /// The map of the coordinates before that.
    pub matrix: TextureMatrix,
    /// Wrap modes and filter.
    pub options: SampleOptions,
    /// Whether texels are seen as squares as long as they are larger than the footprint, whatever the filter. (The filter
    /// [`Filter::Nearest`] shows squares at any size, and aliases.)
    pub square_texels: bool,
    /// Width over which it is blurred besides, as a share of the image: the footprint grows by it, square for square. Not negative.
    pub blur: f32,
}

impl ImageLookup {
    /// The image by the model's first texture coordinates, with the default filter.
    pub fn new(texture: Arc<ImageTexture>) -> Self {
        Self {
            texture,
            coordinates: Coordinates::default(),
            matrix: TextureMatrix::default(),
            options: SampleOptions::default(),
            square_texels: false,
            blur: 0.0,
        }
    }

    fn place(&self, point: &UvPoint, time: f32) -> UvPoint {
        let UvPoint { uv, steps } = self.matrix.apply(point, time);
        let steps = steps.map(shortened);
        UvPoint { uv, steps: if self.blur > 0.0 { blurred(steps, self.blur) } else { steps } }
    }

    /// Whether every point takes one look-up of smooth texels.
    fn is_plain(&self) -> bool {
        !matches!(self.coordinates, Coordinates::Triplanar(_)) && !self.square_texels
    }

    /// Means over parallelograms. Those of a triangle's texels are alike, and prepared once for all.
    fn sample_areas(&self, places: &[UvPoint], values: &mut [Vec4]) {
        let same = |a: &UvPoint, b: &UvPoint| a.steps == b.steps;
        let mut rest = values;
        for alike in places.chunk_by(same).flat_map(|alike| alike.chunks(AREAS_AT_ONCE)) {
            let (values, after) = rest.split_at_mut(alike.len());
            rest = after;
            if alike.len() < FEW {
                let value = |place: &UvPoint| Vec4::from_array(self.sample_area(*place));
                alike.iter().zip(values).for_each(|(place, out)| *out = value(place));
                continue;
            }
            let sampler = self.texture.area_sampler(alike[0].steps, self.options.wrap);
            let mut points = [Vec2::ZERO; AREAS_AT_ONCE];
            points.iter_mut().zip(alike).for_each(|(point, place)| *point = place.uv);
            let areas = sampler.areas(&points[..alike.len()]);
            sampler.sample_areas(&areas, bytemuck::cast_slice_mut(values));
        }
    }

    fn sample(&self, UvPoint { uv, steps }: UvPoint) -> [f32; 4] {
        if self.square_texels && self.is_magnified(steps) {
            let nearest = SampleOptions { filter: Filter::Nearest, ..self.options };
            return self.texture.sample(uv, steps, &nearest);
        }
        self.texture.sample(uv, steps, &self.options)
    }

    fn sample_area(&self, UvPoint { uv, steps }: UvPoint) -> [f32; 4] {
        if self.square_texels || self.options.filter == Filter::Nearest {
            self.texture.sample_area_nearest(uv, steps, self.options.wrap)
        } else if self.is_bicubic() && self.is_magnified(steps) {
            self.texture.sample_area_bicubic(uv, steps, self.options.wrap)
        } else {
            self.texture.sample_area(uv, steps, self.options.wrap)
        }
    }

    fn is_bicubic(&self) -> bool {
        matches!(self.options.filter, Filter::Bicubic | Filter::BicubicMipmaps)
    }

    /// Whether no edge of the footprint is longer than a texel.
    fn is_magnified(&self, steps: [Vec2; 2]) -> bool {
        let texels = Vec2::from(self.texture.size().map(|n| n as f32));
        steps.iter().all(|step| (*step * texels).length_squared() <= 1.0)
    }
}

/// Fewer means over like parallelograms than this are not worth preparing.
const FEW: usize = 4;

/// Edges of a footprint, in images, that are longer are cut: they occur near poles and horizons, show the mean of the whole
/// image anyway, and would cost the exact mean many subsamples.
const MAX_STEP: f32 = 32.0;

/// The axes of the ellipse whose squares are those of the edges' plus that of a circle of a diameter.
fn blurred([a, b]: [Vec2; 2], diameter: f32) -> [Vec2; 2] {
    let round = diameter * diameter;
    let (xx, yy) = (a.x * a.x + b.x * b.x + round, a.y * a.y + b.y * b.y + round);
    let xy = a.x * a.y + b.x * b.y;
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let apart = half.hypot(xy);
    let axis = Vec2::from_angle(0.5 * xy.atan2(half));
    [axis * (mean + apart).sqrt(), axis.perp() * (mean - apart).max(round).sqrt()]
}

fn shortened(step: Vec2) -> Vec2 {
    // Infinite and NaN count as long.
    let largest = step.abs().max_element();
    if step.is_nan() || largest.is_infinite() {
        Vec2::splat(MAX_STEP)
    } else if largest > MAX_STEP {
        step / largest * MAX_STEP
    } else {
        step
    }
}

impl Texture for ImageLookup {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.coordinates.evaluate(at, |point| {
            let point = self.place(point, at.time);
            Vec4::from_array(match at.filtering {
                Filtering::Own => self.sample(point),
                Filtering::Area => self.sample_area(point),
            })
        })
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        let own = at.iter().filter(|at| at.filtering == Filtering::Own).count();
        let is_area = own == 0 && self.options.filter != Filter::Nearest && !self.is_bicubic();
        if !self.is_plain() || !(own == at.len() || is_area) {
            at.iter().zip(values).for_each(|(at, value)| *value = self.evaluate(at));
            return;
        }
        let place = |at: &ShadingPoint<'_>| {
            let mut place = UvPoint::default();
            self.coordinates.evaluate(at, |point| {
                place = self.place(point, at.time);
                Vec4::ZERO
            });
            place
        };
        let places: Vec<UvPoint> = at.iter().map(place).collect();
        match is_area {
            true => self.sample_areas(&places, values),
            false => self.texture.sample_all(&places, &self.options, bytemuck::cast_slice_mut(values)),
        }
    }

    fn edges_per_texel(&self, at: &ShadingPoint<'_>) -> Option<[f32; 2]> {
        let texels = Vec2::from(self.texture.size().map(|n| n as f32));
        let mut longest = [0.0_f32; 2];
        self.coordinates.evaluate(at, |point| {
            let steps = self.place(point, at.time).steps;
            longest = std::array::from_fn(|edge| longest[edge].max((steps[edge] * texels).length()));
            Vec4::ZERO
        });
        Some(longest.map(|length| 1.0 / length.max(1e-6)))
    }

    fn depends_on(&self, what: Dependence) -> bool {
        what == Dependence::Time && self.matrix.is_animated() || self.coordinates.depends_on(what)
    }
}
