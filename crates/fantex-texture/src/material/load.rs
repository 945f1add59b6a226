//! Decoding of the images that materials use.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use fantex_mesh::{AlphaMode, ImageSource, Material, Mesh, TextureRef, WrapMode};
use rayon::prelude::*;

use super::{MaterialTextures, TextureLayer};
use crate::{AlphaUse, ColorSpace, Image, ImageTexture, LoadImageError, Samples, Wrap};

/// What distinguishes two ways of decoding an image: colours or data, alpha as coverage or as a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct ImageUse {
    image: usize,
    srgb: bool,
    alpha_is_coverage: bool,
}

type Textures = BTreeMap<ImageUse, Arc<ImageTexture>>;

/// An image that a material wants cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("the {channel} of {material}: {cause}")]
pub struct MaterialImageError {
    /// Which material, as its model file knows it; the first one of those that use the image alike.
    pub material: MaterialLabel,
    /// What the image is for, such as `base colour`.
    pub channel: &'static str,
    /// What is wrong with the image.
    #[source]
    pub cause: Box<LoadImageError>,
}

/// A material in messages: its name and its place in the model file, as far as there are any.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaterialLabel {
    /// Counted from 0.
    pub index: usize,
    /// [`Material::name`].
    pub name: String,
    /// [`Material::place`].
    pub place: String,
}

impl MaterialLabel {
    fn new(index: usize, material: &Material) -> Self {
        Self { index, name: material.name.clone(), place: material.place.clone() }
    }
}

impl fmt::Display for MaterialLabel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.name.as_str(), self.place.as_str()) {
            ("", "") => write!(f, "material {}", self.index),
            ("", place) => f.write_str(place),
            (name, "") => write!(f, "material {name:?}"),
            (name, place) => write!(f, "material {name:?} ({place})"),
        }
    }
}

/// Decodes all images that a mesh's materials use, each once per way of use, in parallel; one entry per material.
///
/// # Errors
///
/// An image that is used cannot be read; where several cannot, the one with the lowest index.
pub fn load_material_textures(mesh: &Mesh) -> Result<Vec<MaterialTextures>, MaterialImageError> {
    // Each with the material and the channel that want it first.
    let mut wanted: BTreeMap<ImageUse, (usize, &'static str)> = BTreeMap::new();
    for (index, material) in mesh.materials.iter().enumerate() {
        for (channel, texture, srgb) in channels(material) {
            if let Some(texture) = texture.filter(|t| t.image < mesh.images.len()) {
                wanted.entry(image_use(material, texture, srgb)).or_insert((index, channel));
            }
        }
    }
    let decoded: Vec<_> = wanted
        .into_par_iter()
        .map(|(image_use, (index, channel))| {
            let decoded = decode(&mesh.images[image_use.image], image_use);
            let failed = |cause| MaterialImageError {
                material: MaterialLabel::new(index, &mesh.materials[index]),
                channel,
                cause: Box::new(cause),
            };
            decoded.map(|texture| (image_use, Arc::new(texture))).map_err(failed)
        })
        .collect();
    // Not collected as one result in parallel: which of several errors that gives is left to chance.
    let textures = decoded.into_iter().collect::<Result<Textures, _>>()?;
    Ok(mesh.materials.iter().map(|m| of_material(mesh, m, &textures)).collect())
}

fn of_material(mesh: &Mesh, material: &Material, textures: &Textures) -> MaterialTextures {
    let [base_color, metallic_roughness, normal, occlusion, emission] =
        channels(material).map(|(_, texture, srgb)| {
            let texture_ref = texture?;
            let texture = textures.get(&image_use(material, texture_ref, srgb))?;
            let set = mesh.corners.uv_sets.get(texture_ref.uv_set)?;
            (set.len() == 3 * mesh.triangles.len()).then(|| TextureLayer {
                uv_set: texture_ref.uv_set,
                uv_transform: texture_ref.uv_transform,
                wrap: texture_ref.wrap.map(wrap),
                nearest: texture_ref.nearest,
                texture: Arc::clone(texture),
            })
        });
    MaterialTextures { base_color, metallic_roughness, normal, occlusion, emission }
}

/// Each channel's name and texture, and whether its colours are sRGB-encoded.
fn channels(material: &Material) -> [(&'static str, Option<&TextureRef>, bool); 5] {
    [
        ("base colour", material.base_color_texture.as_ref(), true),
        ("metallic-roughness texture", material.metallic_roughness_texture.as_ref(), false),
        ("normal map", material.normal_texture.as_ref(), false),
        ("occlusion texture", material.occlusion_texture.as_ref(), false),
        ("emission texture", material.emission_texture.as_ref(), true),
    ]
}

fn image_use(material: &Material, texture: &TextureRef, srgb: bool) -> ImageUse {
    let is_base_color = material.base_color_texture.as_ref() == Some(texture);
    let alpha_is_coverage = is_base_color && material.alpha != AlphaMode::Opaque;
    ImageUse { image: texture.image, srgb, alpha_is_coverage }
}

fn decode(source: &ImageSource, image_use: ImageUse) -> Result<ImageTexture, LoadImageError> {
    let space = if image_use.srgb { ColorSpace::Srgb } else { ColorSpace::Linear };
    let mut image = match source {
        ImageSource::File(path) => Image::load_as(path, space)?,
        ImageSource::Embedded { label, bytes } => Image::decode(bytes, label, space)?,
    };
    if !matches!(image.samples, Samples::F32(_)) {
        // The channel decides, whatever the file claims (glTF 2.0, section 3.8).
        image.space = space;
    }
    let alpha = if image_use.alpha_is_coverage { AlphaUse::Coverage } else { AlphaUse::Independent };
    Ok(ImageTexture::with_alpha_use(Arc::new(image), alpha))
}

fn wrap(mode: WrapMode) -> Wrap {
    match mode {
        WrapMode::Clamp => Wrap::Clamp,
        WrapMode::Repeat => Wrap::Repeat,
        WrapMode::Mirror => Wrap::Mirror,
    }
}
