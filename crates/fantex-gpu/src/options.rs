//! How to draw a frame.

use fantex_scene::{Background, FilterOptions, Shading, ToneMap};
use glam::Vec3;

/// How to draw a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawOptions {
    /// Lighting model.
    pub shading: Shading,
    /// How textures are filtered. `Bicubic` is drawn as `Bilinear`, `Ewa` as `Anisotropic`.
    pub filter: FilterOptions,
    /// What is seen where no surface is. Of these, exposure affects environments only.
    pub background: Background,
    /// Factor of the light that reaches the eye.
    pub exposure: f32,
    /// How light is brought into the range of a screen; `None` leaves it as it is, for targets of floats.
    pub tone_map: Option<ToneMap>,
    /// Samples per pixel, 1 or 4. Materials are evaluated once per pixel and triangle.
    pub samples: u32,
    /// Lines along all edges.
    pub wireframe: Option<WireframeOptions>,
    /// Colours that explain instead of the material's.
    pub overlay: Overlay,
    /// Seconds since the start of an animation, for what lamps project.
    pub seconds: f32,
}

impl Default for DrawOptions {
    /// As the CPU renderer's, with 4 samples.
    fn default() -> Self {
        Self {
            shading: Shading::default(),
            filter: FilterOptions::default(),
            background: Background::default(),
            exposure: 1.0,
            tone_map: Some(ToneMap::default()),
            samples: 4,
            wireframe: None,
            overlay: Overlay::default(),
            seconds: 0.0,
        }
    }
}

/// Lines along all edges of the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WireframeOptions {
    /// Linear RGB.
    pub color: Vec3,
    /// 0..1.
    pub opacity: f32,
}

impl Default for WireframeOptions {
    /// Thin black.
    fn default() -> Self {
        Self { color: Vec3::ZERO, opacity: 0.6 }
    }
}

/// Colours that explain what a fan-textured surface is made of. Models without fans show themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Overlay {
    /// None: the material.
    #[default]
    None,
    /// A colour per group of fans.
    Groups,
    /// A colour per partial fan.
    Fans,
    /// A colour per detail level that is shown.
    Levels,
    /// Whether the wanted level is resident, or how much coarser what is shown is.
    Residency,
    /// Where partial fans overlap and are blended.
    BlendBands,
}

impl Overlay {
    /// The number that shaders know it by, 0 for none.
    pub fn code(self) -> u32 {
        self as u32
    }
}
