//! An image on a surface.

use std::sync::Arc;

use glam::{Vec2, Vec4};

use super::{Coordinates, TextureMatrix};
use crate::{Filter, Filtering, ImageTexture, SampleOptions, ShadingPoint, Texture, UvPoint};

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
        } else {
            self.texture.sample_area(uv, steps, self.options.wrap)
        }
    }

    /// Whether no edge of the footprint is longer than a texel.
    fn is_magnified(&self, steps: [Vec2; 2]) -> bool {
        let texels = Vec2::from(self.texture.size().map(|n| n as f32));
        steps.iter().all(|step| (*step * texels).length_squared() <= 1.0)
    }
}

impl Texture for ImageLookup {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.coordinates.evaluate(at, |point| {
            let point = self.matrix.apply(point, at.time);
            Vec4::from_array(match at.filtering {
                Filtering::Own => self.sample(point),
                Filtering::Area => self.sample_area(point),
            })
        })
    }

    fn is_view_dependent(&self) -> bool {
        self.coordinates.is_view_dependent()
    }

    fn is_animated(&self) -> bool {
        self.matrix.is_animated() || self.coordinates.is_animated()
    }
}
