//! Materials of a model, as pages see them.

use fantex_mesh::{AlphaMode, Material};
use wasm_bindgen::prelude::*;

/// What a material says where the asset has no channel, and how its surface is drawn.
#[wasm_bindgen(getter_with_clone)]
#[derive(Clone, Debug)]
pub struct FanMaterial {
    /// The model file's name for it, or empty.
    pub name: String,
    /// Linear RGBA.
    pub base_color: Vec<f32>,
    /// Linear RGB, may exceed 1.
    pub emission: Vec<f32>,
    /// 0 to 1.
    pub metallic: f32,
    /// Perceptual, 0 to 1.
    pub roughness: f32,
    /// 0 opaque, 1 cut out, 2 blended.
    pub alpha_mode: u8,
    /// Below it nothing is drawn where it is cut out.
    pub alpha_threshold: f32,
    /// Whether it is visible from behind.
    pub double_sided: bool,
    /// Whether the base colour is the picture.
    pub unlit: bool,
}

impl From<&Material> for FanMaterial {
    fn from(material: &Material) -> Self {
        let (alpha_mode, alpha_threshold) = match material.alpha {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask(threshold) => (1, threshold),
            AlphaMode::Blend => (2, 0.0),
        };
        Self {
            name: material.name.clone(),
            base_color: material.base_color.to_array().to_vec(),
            emission: material.emission.to_array().to_vec(),
            metallic: material.metallic,
            roughness: material.roughness,
            alpha_mode,
            alpha_threshold,
            double_sided: material.double_sided,
            unlit: material.unlit,
        }
    }
}
