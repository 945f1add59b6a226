//! Materials whose every property may be a texture: what renderers and bakers evaluate.

mod opacity;
mod relief;

use std::sync::Arc;

use glam::{Mat3, Vec3, Vec4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub(crate) use relief::height_map;
pub use relief::{
    DerivativeTexture, GradientAxes, LookTangents, MIN_RELIEF_STEP, height_change, normal_by_map,
};

use crate::combine::CombineMode;
use crate::{Color, ColorRamp, ShadingPoint, Texture};

/// A property of a material: the same everywhere, or a texture.
#[derive(Clone, Debug)]
pub enum Slot {
    /// Linear RGBA, or a number as red, green and blue.
    Constant(Vec4),
    /// A function of the surface point.
    Texture(Arc<dyn Texture>),
}

impl From<f32> for Slot {
    fn from(value: f32) -> Self {
        Self::number(value)
    }
}

impl From<Color> for Slot {
    fn from(color: Color) -> Self {
        Self::Constant(color.0)
    }
}

impl Slot {
    /// A colour without texture, opaque.
    pub fn color(rgb: Vec3) -> Self {
        Self::Constant(rgb.extend(1.0))
    }

    /// A number without texture.
    pub fn number(value: f32) -> Self {
        Self::color(Vec3::splat(value))
    }

    /// The texture; none for a constant.
    pub fn texture(&self) -> Option<&Arc<dyn Texture>> {
        if let Self::Texture(texture) = self { Some(texture) } else { None }
    }

    /// The value at a point: linear RGBA.
    pub fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        match self {
            Self::Constant(value) => *value,
            Self::Texture(texture) => texture.evaluate(at),
        }
    }

    /// The value of a slot that holds a number: red.
    pub fn evaluate_number(&self, at: &ShadingPoint<'_>) -> f32 {
        self.evaluate(at).x
    }
}

/// How light is reflected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LightingModel {
    /// glTF 2.0 metallic-roughness.
    #[default]
    MetallicRoughness,
    /// Blinn-Phong with ambient: `L = r_a L_a + sum_j (r_d (n.l_j) + r_s (n.h_j)^m) L_j`.
    BlinnPhong,
    /// No light, nor emission: the base colour is the picture.
    Unlit,
}

/// What the base colour does to the lighting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ColorUse {
    /// Scales the diffuse and ambient reflectance before lighting; highlights keep their colour (separate specular).
    #[default]
    APriori,
    /// Multiplies the lit colour of a white material, highlights included.
    Modulate,
    /// Replaces the lit colour: all lighting is removed.
    Replace,
}

/// Opacity.
#[derive(Clone, Debug, Default)]
pub enum Opacity {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Cut-outs: points whose alpha is below the threshold are not there. Coverage is preserved under minification.
    Mask {
        /// Least alpha that is seen, 0..1.
        threshold: f32,
    },
    /// `C_D = a C_A + (1-a) C_S`, back to front.
    Blend,
}

/// Which differences approximate the derivatives of a height texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Difference {
    /// `F(x + d) - F(x)`.
    Forward,
    /// `F(x) - F(x - d)`.
    Backward,
    /// `(F(x + d) - F(x - d)) / 2`.
    #[default]
    Central,
}

/// What bends the shading normal.
#[derive(Clone, Debug)]
pub enum Relief {
    /// Bump mapping (Blinn, "Simulation of wrinkled surfaces", 1978) by the red of a height texture.
    Bump {
        /// Heights.
        texture: Arc<dyn Texture>,
        /// Height of 1, in world units.
        height: f32,
        /// How the derivatives are found.
        difference: Difference,
    },
    /// Bump mapping by a texture that holds the height in red and its derivatives by `u` and `v` in green and blue, each
    /// derivative encoded as `0.5 + 0.5 d / range`.
    Derivatives {
        /// The three numbers.
        texture: Arc<dyn Texture>,
        /// Set of texture coordinates whose `u` and `v` the derivatives belong to.
        uv_set: usize,
        /// Height of 1, in world units.
        height: f32,
        /// Largest derivative that the encoding holds, per unit of `u` or `v`.
        range: f32,
    },
    /// A normal map, `[-1,1]` encoded as `[0,1]`.
    Normal {
        /// Encoded normals.
        texture: Arc<dyn Texture>,
        /// Factor of the tangential part.
        scale: f32,
        /// The frame of the map.
        space: NormalSpace,
    },
}

/// The frame in which a normal map is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NormalSpace {
    /// Tangent, bitangent and normal of texture coordinates.
    Tangent(TangentSpace),
    /// The model's own axes.
    Object,
}

/// The texture coordinates that tangents belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentSpace {
    /// Set of texture coordinates.
    pub uv_set: usize,
    /// From the set's `(u, v, 1)` to the coordinates whose tangents are meant.
    pub uv_transform: Mat3,
    /// Whether it is that of a normal map of the model's own: the mesh's tangents, where it has any, were made for it.
    pub of_model: bool,
}

impl TangentSpace {
    /// That of a set of texture coordinates as it is.
    pub fn of_set(uv_set: usize) -> Self {
        Self { uv_set, uv_transform: Mat3::IDENTITY, of_model: false }
    }
}

/// An anisotropic highlight.
#[derive(Clone, Debug)]
pub struct Anisotropy {
    /// -1..1: how far the highlight is stretched along the direction (negative: across it).
    pub strength: Slot,
    /// The direction in the tangent plane: red and green, `[-1,1]` encoded as `[0,1]`, by tangent and bitangent.
    pub direction: Slot,
    /// Set of texture coordinates that gives tangent and bitangent; without that set, the tangent runs around the model's
    /// y axis, as on a lathe.
    pub uv_set: usize,
}

/// A texture that is combined with the lit colour.
#[derive(Clone, Debug)]
pub struct FragmentTexture {
    /// How.
    pub mode: CombineMode,
    /// `T`.
    pub texture: Slot,
    /// `C`, linear RGBA.
    pub constant: Vec4,
}

/// A material, resolved: what the renderer and the baker evaluate.
#[derive(Clone, Debug)]
pub struct LookMaterial {
    /// How light is reflected.
    pub lighting: LightingModel,
    /// What the base colour does to the lighting.
    pub color_use: ColorUse,
    /// Linear RGB, and alpha.
    pub base_color: Slot,
    /// Factor of the base colour's alpha, 0..1.
    pub alpha: Slot,
    /// What alpha means.
    pub opacity: Opacity,
    /// 0..1.
    pub metallic: Slot,
    /// Perceptual roughness, 0..1.
    pub roughness: Slot,
    /// Share of the surroundings' light that arrives, 0..1.
    pub occlusion: Slot,
    /// Blinn-Phong: ambient reflectance `r_a`, a factor of the base colour.
    pub ambient: Slot,
    /// Blinn-Phong: specular reflectance `r_s`, linear RGB. Metallic-roughness: factor of the dielectric's highlight.
    pub specular: Slot,
    /// Blinn-Phong: exponent `m`; without, it follows from the roughness.
    pub shininess: Option<Slot>,
    /// Emitted linear RGB.
    pub emission: Slot,
    /// Extended Phong: share of the mirrored surroundings that is added, linear RGB.
    pub reflection: Slot,
    /// What bends the normal, applied one after the other.
    pub relief: Vec<Relief>,
    /// Light that was computed before (a light map): replaces direct and ambient light of the diffuse part, linear RGB.
    pub light_map: Option<Slot>,
    /// Multiplied onto the lit colour at the end, linear RGB.
    pub modulate: Option<Slot>,
    /// What the lit colour is combined with after that.
    pub fragment: Option<FragmentTexture>,
    /// Toon shading: the diffuse light of each lamp is this colour of its `n.l` instead of `n.l` itself.
    pub toon: Option<Arc<ColorRamp>>,
    /// A highlight that depends on a direction in the surface.
    pub anisotropy: Option<Anisotropy>,
    /// Whether the surface is seen from behind, too.
    pub double_sided: bool,
}

impl Default for LookMaterial {
    /// White, opaque, rough, without highlights' colour.
    fn default() -> Self {
        Self {
            lighting: LightingModel::default(),
            color_use: ColorUse::default(),
            base_color: Slot::color(Vec3::ONE),
            alpha: Slot::number(1.0),
            opacity: Opacity::Opaque,
            metallic: Slot::number(0.0),
            roughness: Slot::number(0.9),
            occlusion: Slot::number(1.0),
            ambient: Slot::number(1.0),
            specular: Slot::number(1.0),
            shininess: None,
            emission: Slot::number(0.0),
            reflection: Slot::number(0.0),
            relief: Vec::new(),
            light_map: None,
            modulate: None,
            fragment: None,
            toon: None,
            anisotropy: None,
            double_sided: true,
        }
    }
}

impl LookMaterial {
    /// All slots and textures, for questions about the whole material.
    pub fn textures(&self) -> impl Iterator<Item = &Arc<dyn Texture>> {
        let slots = [
            Some(&self.base_color),
            Some(&self.alpha),
            Some(&self.metallic),
            Some(&self.roughness),
            Some(&self.occlusion),
            Some(&self.ambient),
            Some(&self.specular),
            self.shininess.as_ref(),
            Some(&self.emission),
            Some(&self.reflection),
            self.light_map.as_ref(),
            self.modulate.as_ref(),
            self.fragment.as_ref().map(|fragment| &fragment.texture),
            self.anisotropy.as_ref().map(|a| &a.strength),
            self.anisotropy.as_ref().map(|a| &a.direction),
        ];
        let of_slots = slots.into_iter().flatten().filter_map(Slot::texture);
        let of_relief = self.relief.iter().map(|relief| match relief {
            Relief::Bump { texture, .. }
            | Relief::Derivatives { texture, .. }
            | Relief::Normal { texture, .. } => texture,
        });
        of_slots.chain(of_relief)
    }
}
