//! Materials as models describe them (glTF metallic-roughness, the common denominator of the formats).

use std::path::PathBuf;
use std::sync::Arc;

use glam::{Mat3, Vec3, Vec4};

/// Where the encoded bytes of an image come from. Decoding is the texture crate's business.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageSource {
    /// A file beside the model; resolved against the model's folder, not yet opened.
    File(PathBuf),
    /// Bytes embedded in the model (buffer view or data URI).
    Embedded {
        /// What to call it in messages, e.g. `image 3 of bottle.glb`.
        label: String,
        /// The encoded image (PNG, JPEG, ...), whole.
        bytes: Arc<[u8]>,
    },
    /// Channels of several images, where a format names a file for each.
    Packed(Box<PackedImage>),
    /// A normal map, or the heights of one.
    Bump(Box<BumpImage>),
}

/// An image put together of channels of others; as wide and as high as the largest, to which the others are scaled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedImage {
    /// Red, green, blue and alpha; one everywhere where there is none.
    pub channels: [Option<PackedChannel>; 4],
}

/// A channel of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedChannel {
    /// The image; none that is packed itself.
    pub source: ImageSource,
    /// What of it.
    pub channel: ImageChannel,
}

/// What may be a normal map or a map of heights: the latter is grey everywhere. Heights become normals.
#[derive(Clone, Debug, PartialEq)]
pub struct BumpImage {
    /// The image; none that is packed itself.
    pub source: ImageSource,
    /// How heights go on beyond the edges, along u and v.
    pub wrap: [WrapMode; 2],
}

/// What of an image stands for a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ImageChannel {
    /// Red, or grey.
    Red,
    /// Green, or grey.
    Green,
    /// Blue, or grey.
    Blue,
    /// Alpha; one where the image has none.
    Alpha,
    /// Grey, or `0.2126 R + 0.7152 G + 0.0722 B`.
    Luminance,
    /// Alpha where the image is not opaque everywhere, else luminance.
    Opacity,
}

/// How texture coordinates outside 0..1 are folded back, as glTF names it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum WrapMode {
    /// Coordinates are clamped to the edge texel.
    Clamp,
    /// The image repeats (glTF's default).
    #[default]
    Repeat,
    /// The image repeats, every other copy mirrored.
    Mirror,
}

/// A use of an image by a material channel.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into the model's images.
    pub image: usize,
    /// Index into [`CornerAttributes::uv_sets`](crate::CornerAttributes::uv_sets).
    pub uv_set: usize,
    /// Maps the corner's `(u, v, 1)` to the coordinates of the look-up (KHR_texture_transform); identity by default.
    /// Coordinates have their origin at the **top left** of the image, v downwards, as in glTF; loaders of formats
    /// with a lower left origin (OBJ, PLY) convert the corner coordinates (`v := 1 - v`) when they load.
    pub uv_transform: Mat3,
    /// Wrap along u and v.
    pub wrap: [WrapMode; 2],
    /// True where the file asks for nearest-neighbour magnification.
    pub nearest: bool,
}

/// What alpha means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Cut out below the threshold (0..1).
    Mask(f32),
    /// Blended back to front.
    Blend,
}

impl AlphaMode {
    /// The highest threshold that opaque texels of assets pass: they stay a step of 8 bits below 1 where blocks are compressed, and look-ups
    /// that blend them round.
    const MAX_THRESHOLD_OF_ASSETS: f32 = 252.5 / 255.0;

    /// As assets have it: what is opaque passes a threshold of up to 1 there, too. (It passes no higher one, anywhere.)
    #[must_use]
    pub fn of_asset(self) -> Self {
        match self {
            Self::Mask(threshold) if threshold <= 1.0 => {
                Self::Mask(threshold.min(Self::MAX_THRESHOLD_OF_ASSETS))
            }
            _ => self,
        }
    }
}

/// A metallic-roughness material. Factors multiply textures; colours are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The file's name for it, or empty.
    pub name: String,
    /// Where a model file defines it, for messages: `material 3`, `line 12 of chair.mtl`; empty for materials from elsewhere.
    pub place: String,
    /// Linear RGBA, 0..1.
    pub base_color: Vec4,
    /// sRGB colour, linear alpha.
    pub base_color_texture: Option<TextureRef>,
    /// 0..1.
    pub metallic: f32,
    /// Perceptual roughness, 0..1.
    pub roughness: f32,
    /// Linear; green = roughness, blue = metallic.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Linear; tangent space, +y up (glTF convention).
    pub normal_texture: Option<TextureRef>,
    /// Multiplies x and y of the decoded normal.
    pub normal_scale: f32,
    /// Linear; red = occlusion.
    pub occlusion_texture: Option<TextureRef>,
    /// 0..1; `1 + strength * (occlusion - 1)`.
    pub occlusion_strength: f32,
    /// Linear RGB, may exceed 1 (KHR_materials_emissive_strength).
    pub emission: Vec3,
    /// sRGB.
    pub emission_texture: Option<TextureRef>,
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Visible from behind (with the normal turned).
    pub double_sided: bool,
    /// KHR_materials_unlit: the base colour is the picture.
    pub unlit: bool,
    /// Colours of the diffuse light; without, it is proportional to the cosine. No model file has one; looks do.
    pub toon: Option<ToonScale>,
}

/// Toon shading: the diffuse light of a lamp is a colour of its `n.l` (the cosine between normal and light) instead of that
/// cosine itself.
#[derive(Clone, Debug, PartialEq)]
pub struct ToonScale {
    /// `n.l`, -1..1, ascending, and the linear RGB there; 1 to [`ToonScale::MAX_STOPS`]. Two at one place make a jump.
    pub stops: Vec<(f32, Vec3)>,
    /// Between the stops. Beyond the ends the end's colour holds.
    pub interpolation: ToonInterpolation,
}

/// How colours change between the stops of a [`ToonScale`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToonInterpolation {
    /// Proportionally, in linear light.
    #[default]
    Linear,
    /// By a cubic that is level at the stops.
    Smooth,
    /// Not at all: the colour of the last stop holds up to the next.
    Constant,
}

impl ToonScale {
    /// Most stops, so that a scale fits into what shaders read at once.
    pub const MAX_STOPS: usize = 32;
}

impl Default for Material {
    /// A white, rough dielectric that is visible from both sides.
    fn default() -> Self {
        Self {
            name: String::new(),
            place: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 0.0,
            roughness: 0.9,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            occlusion_texture: None,
            occlusion_strength: 1.0,
            emission: Vec3::ZERO,
            emission_texture: None,
            alpha: AlphaMode::Opaque,
            double_sided: true,
            unlit: false,
            toon: None,
        }
    }
}
