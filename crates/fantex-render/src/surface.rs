//! What a surface tells the renderer about its points.

use fantex_mesh::{AlphaMode, Material};
use glam::Vec3;

use crate::Hit;

/// Whether what lies behind a triangle may show through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coverage {
    /// Hides everything behind it; [`MaterialSample::alpha`] is ignored.
    #[default]
    Opaque,
    /// Cut-outs and transparency: composited back to front with [`MaterialSample::alpha`].
    Layered,
}

impl Coverage {
    /// What a material asks for.
    pub fn of(material: &Material) -> Self {
        if material.alpha == AlphaMode::Opaque { Self::Opaque } else { Self::Layered }
    }
}

/// Opacity as a material means it.
pub(crate) fn apply_alpha_mode(mode: AlphaMode, alpha: f32) -> f32 {
    match mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask(threshold) => f32::from(u8::from(alpha >= threshold)),
        AlphaMode::Blend => alpha.clamp(0.0, 1.0),
    }
}

/// The material at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialSample {
    /// Linear RGB.
    pub base_color: Vec3,
    /// Opacity, 0..1, the cut-out threshold already applied.
    pub alpha: f32,
    /// Unit shading normal on the side that the eye sees, mesh space (whose directions are the world's).
    pub normal: Vec3,
    /// Change of `normal` along the pixel's edges; zero where it is not known. It is the footprint of mirrored
    /// surroundings.
    pub normal_steps: [Vec3; 2],
    /// Share of the surroundings' light that reaches the point, 0..1.
    pub occlusion: f32,
    /// Perceptual roughness, 0..1.
    pub roughness: f32,
    /// 0..1.
    pub metallic: f32,
    /// Emitted linear RGB.
    pub emission: Vec3,
    /// True where the base colour is the picture, without light.
    pub unlit: bool,
    /// Filtered look-ups (of one image, or of one channel in one group's tile) that it took.
    pub lookups: u32,
}

impl MaterialSample {
    /// A white, opaque, rough dielectric.
    pub fn with_normal(normal: Vec3) -> Self {
        Self {
            base_color: Vec3::ONE,
            alpha: 1.0,
            normal,
            normal_steps: [Vec3::ZERO; 2],
            occlusion: 1.0,
            roughness: 0.9,
            metallic: 0.0,
            emission: Vec3::ZERO,
            unlit: false,
            lookups: 0,
        }
    }
}

/// The appearance of a mesh.
pub trait Surface: Sync {
    /// The material at a point.
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample;

    /// Whether a triangle hides what lies behind it.
    fn coverage(&self, triangle: usize) -> Coverage {
        let _ = triangle;
        Coverage::Opaque
    }

    /// Whether a triangle is seen from behind.
    fn is_double_sided(&self, triangle: usize) -> bool {
        let _ = triangle;
        true
    }
}
