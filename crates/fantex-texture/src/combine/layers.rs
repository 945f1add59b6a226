//! Textures on top of each other.

use glam::Vec4;

use super::{CombineMode, mix};
use crate::look::Slot;
use crate::{ShadingPoint, Texture};

/// What a layer does to what lies below.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LayerMode {
    /// It covers by its alpha (the operator "over" of Porter and Duff, "Compositing digital images", 1984).
    #[default]
    Over,
    /// An environment mode, what lies below being the fragment.
    Combine {
        /// Which one.
        mode: CombineMode,
        /// `C`, linear RGBA.
        constant: Vec4,
    },
}

/// One of several textures.
#[derive(Clone, Debug)]
pub struct Layer {
    /// The colours.
    pub texture: Slot,
    /// What it does to what lies below.
    pub mode: LayerMode,
    /// Where it does so: red, 0..1.
    pub mask: Slot,
    /// How much it does so: red, 0..1; a factor of the mask.
    pub opacity: Slot,
}

impl Layer {
    /// A texture over everything below.
    pub fn over(texture: Slot) -> Self {
        Self { texture, mode: LayerMode::Over, mask: Slot::number(1.0), opacity: Slot::number(1.0) }
    }

    /// What becomes of the colour below.
    fn evaluate(&self, below: Vec4, at: &ShadingPoint<'_>) -> Vec4 {
        let share = (self.mask.evaluate_number(at) * self.opacity.evaluate_number(at)).clamp(0.0, 1.0);
        if share == 0.0 { below } else { self.cover(below, self.texture.evaluate(at), share) }
    }

    /// What becomes of the colours below.
    fn evaluate_all(&self, below: &mut [Vec4], at: &[ShadingPoint<'_>]) {
        let mut values = vec![Vec4::ZERO; at.len()];
        self.mask.evaluate_all(at, &mut values);
        let masks: Vec<f32> = values.iter().map(|value| value.x).collect();
        self.opacity.evaluate_all(at, &mut values);
        let share = |(mask, opacity): (f32, &Vec4)| (mask * opacity.x).clamp(0.0, 1.0);
        let shares: Vec<f32> = masks.into_iter().zip(&values).map(share).collect();
        if shares.iter().all(|&share| share == 0.0) {
            return;
        }
        self.texture.evaluate_all(at, &mut values);
        for ((below, texel), share) in below.iter_mut().zip(values).zip(shares) {
            if share != 0.0 {
                *below = self.cover(*below, texel, share);
            }
        }
    }

    fn cover(&self, below: Vec4, texel: Vec4, share: f32) -> Vec4 {
        match self.mode {
            LayerMode::Over => over(texel.truncate().extend(texel.w * share), below),
            LayerMode::Combine { mode, constant } => mix(below, mode.apply(texel, below, constant), share),
        }
    }

    fn slots(&self) -> [&Slot; 3] {
        [&self.texture, &self.mask, &self.opacity]
    }
}

/// Porter and Duff's "over", for straight alpha.
fn over(above: Vec4, below: Vec4) -> Vec4 {
    let seen = below.w * (1.0 - above.w);
    let alpha = above.w + seen;
    if alpha <= 0.0 {
        return below;
    }
    ((above * above.w + below * seen) / alpha).truncate().extend(alpha)
}

/// Several textures, the first one at the bottom.
#[derive(Clone, Debug)]
pub struct Layers {
    /// What lies below all layers.
    pub base: Slot,
    /// From the lowest to the highest.
    pub layers: Vec<Layer>,
}

impl Texture for Layers {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        self.layers.iter().fold(self.base.evaluate(at), |below, layer| layer.evaluate(below, at))
    }

    fn evaluate_all(&self, at: &[ShadingPoint<'_>], values: &mut [Vec4]) {
        self.base.evaluate_all(at, values);
        self.layers.iter().for_each(|layer| layer.evaluate_all(values, at));
    }

    fn is_view_dependent(&self) -> bool {
        let above = self.layers.iter().flat_map(Layer::slots).any(Texture::is_view_dependent);
        self.base.is_view_dependent() || above
    }

    fn is_animated(&self) -> bool {
        let above = self.layers.iter().flat_map(Layer::slots).any(Texture::is_animated);
        self.base.is_animated() || above
    }
}
