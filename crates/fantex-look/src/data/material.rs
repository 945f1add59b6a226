//! Materials.

use fantex_base::parameters;
use fantex_texture::combine::CombineMode;
use fantex_texture::look::{ColorUse, Difference, LightingModel};
use fantex_texture::{Color, RampInterpolation, Stop};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Input;

parameters! {
    /// A material: every property may be a texture. What is left out has the default or, with `from = "model"`, comes from the
    /// model.
    pub struct MaterialTable {
        /// What the material starts from.
        pub from: MaterialBase = MaterialBase::Default,
        /// How light is reflected; metallic_roughness where it is left out.
        pub lighting: Option<LightingModel> = None,
        /// What the base colour does to the lighting; a_priori where it is left out.
        pub color_use: Option<ColorUse> = None,
        /// Colour; a texture's alpha counts as opacity; 1 where it is left out.
        pub base_color: Option<Input> = None,
        /// Factor of the alpha, 0 to 1; 1 where it is left out.
        pub alpha: Option<Input> = None,
        /// What alpha means; opaque where it is left out.
        pub opacity: Option<OpacityName> = None,
        /// Least alpha that is seen in cut-outs; where it is left out that of the model's cut-out with `from = "model"`, else 0.5.
        #[schemars(range(min = 0, max = 1))]
        pub threshold: Option<f32> = None,
        /// 0 (dielectric) to 1 (metal); 0 where it is left out.
        pub metallic: Option<Input> = None,
        /// Perceptual roughness, 0 to 1; 0.9 where it is left out.
        pub roughness: Option<Input> = None,
        /// Share of the surroundings' light that arrives, 0 to 1; 1 where it is left out.
        pub occlusion: Option<Input> = None,
        /// Ambient reflectance (Blinn-Phong), a factor of the base colour; 1 where it is left out.
        pub ambient: Option<Input> = None,
        /// Specular reflectance (Blinn-Phong with `shininess`), else factor of the dielectric's highlight; 1 where it is left out.
        pub specular: Option<Input> = None,
        /// Exponent of the highlight (Blinn-Phong); from the roughness where it is left out.
        pub shininess: Option<Input> = None,
        /// Emitted light, which unlit materials have none of; 0 where it is left out.
        pub emission: Option<Input> = None,
        /// Share of the mirrored surroundings that is added (Blinn-Phong); 0 where it is left out.
        pub reflection: Option<Input> = None,
        /// Bumps by a height texture.
        pub bump: Option<BumpTable> = None,
        /// Bumps by a texture of height and derivatives.
        pub derivatives: Option<DerivativesTable> = None,
        /// Normals from a texture.
        pub normal_map: Option<NormalMapTable> = None,
        /// Real geometry from a height texture.
        pub displacement: Option<DisplacementTable> = None,
        /// Light that was computed before: replaces direct and ambient light, and where it is below 1, dims what is mirrored.
        pub light_map: Option<Input> = None,
        /// Multiplied onto the lit colour; emission is added to that.
        pub modulate: Option<Input> = None,
        /// Another texture that the lit colour, with its emission, is combined with in the end.
        pub fragment: Option<FragmentTable> = None,
        /// Colours of the diffuse light instead of its cosine.
        pub toon: Option<ToonTable> = None,
        /// A highlight that depends on a direction in the surface.
        pub anisotropy: Option<AnisotropyTable> = None,
        /// Whether it is seen from behind; true where it is left out.
        pub double_sided: Option<bool> = None,
    }

    /// A texture `T` on the lit fragment `F`, by a mode of the fixed-function pipeline. The opacity stays the material's.
    #[schemars(extend("required" = ["mode", "texture"]))]
    pub struct FragmentTable {
        /// The mode.
        pub mode: CombineMode = CombineMode::Modulate,
        /// `T`.
        pub texture: Input = Input::Number(1.0),
        /// `C`, for `blend`.
        pub constant: Color = Color::WHITE,
    }

    /// Bump mapping.
    #[schemars(extend("required" = ["texture", "height"]))]
    pub struct BumpTable {
        /// Heights.
        pub texture: Input = Input::Number(0.0),
        /// Height of 1, in world units.
        pub height: f32 = 0.0,
        /// Which differences stand for the derivatives.
        pub difference: Difference = Difference::Central,
    }

    /// Bump mapping by a texture of height (red) and its derivatives (green, blue: `0.5 + 0.5 d / range`).
    #[schemars(extend("required" = ["texture", "height"]))]
    pub struct DerivativesTable {
        /// The three numbers.
        pub texture: Input = Input::Number(0.0),
        /// Height of 1, in world units.
        pub height: f32 = 0.0,
        /// Largest derivative that the encoding holds.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub range: f32 = 1.0,
        /// Texture coordinates whose u and v the derivatives belong to.
        #[schemars(range(max = 7))]
        pub set: u32 = 0,
    }

    /// A normal map.
    #[schemars(extend("required" = ["texture"]))]
    pub struct NormalMapTable {
        /// Encoded normals; an image with `color_space = "linear"`.
        pub texture: Input = Input::Number(0.0),
        /// Factor of the tangential part.
        pub scale: f32 = 1.0,
        /// The frame in which the map is written.
        pub space: NormalSpaceName = NormalSpaceName::Tangent,
        /// Texture coordinates that the tangents belong to.
        #[schemars(range(max = 7))]
        pub set: u32 = 0,
    }

    /// Displacement mapping: triangles are divided and moved along the normal.
    #[schemars(extend("required" = ["texture", "height"]))]
    pub struct DisplacementTable {
        /// Heights.
        pub texture: Input = Input::Number(0.0),
        /// Height of 1, in world units.
        pub height: f64 = 0.0,
        /// The height texture's value that leaves the surface where it is.
        pub middle: f32 = 0.0,
        /// Longest edge after dividing, in world units; a hundredth of the model's size where it is left out.
        #[schemars(extend("exclusiveMinimum" = 0))]
        pub edge: Option<f64> = None,
        /// Triangles at most.
        #[schemars(range(min = 1, max = 1_000_000_000))]
        pub max_triangles: u64 = 4_000_000,
    }

    /// A colour scale of the cosine between normal and light.
    #[schemars(extend("required" = ["stops"]))]
    pub struct ToonTable {
        /// Colours in ascending order of the cosine, 0 to 1.
        #[schemars(length(min = 1, max = 1024))]
        pub stops: Vec<Stop> = Vec::new(),
        /// How colours change between the stops.
        pub interpolation: RampInterpolation = RampInterpolation::Constant,
    }

    /// An anisotropic highlight.
    #[schemars(extend("required" = ["strength"]))]
    pub struct AnisotropyTable {
        /// -1 to 1: how far the highlight is stretched along the direction.
        pub strength: Input = Input::Number(0.0),
        /// Direction in the tangent plane: red and green, -1 to 1 encoded as 0 to 1.
        pub direction: Input = Input::Color(Color::opaque(1.0, 0.5, 0.5)),
        /// Texture coordinates that give tangent and bitangent.
        #[schemars(range(max = 7))]
        pub set: u32 = 0,
    }
}

/// What a material starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaterialBase {
    /// White, opaque, rough.
    Default,
    /// The material that the model has there.
    Model,
}

/// What alpha means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpacityName {
    /// Nothing: all of the surface is there.
    Opaque,
    /// Cut-outs: below the threshold nothing is there.
    Mask,
    /// Blended back to front.
    Blend,
}

/// The frame of a normal map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NormalSpaceName {
    /// Tangent, bitangent and normal.
    Tangent,
    /// The model's own axes.
    Object,
}
