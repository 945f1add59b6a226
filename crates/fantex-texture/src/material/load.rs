//! Decoding of the images that materials use.

use std::collections::{BTreeMap, BTreeSet};
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

/// Decodes all images that a mesh's materials use, each once per way of use, in parallel; one entry per material.
///
/// # Errors
///
/// An image that is used cannot be read.
pub fn load_material_textures(mesh: &Mesh) -> Result<Vec<MaterialTextures>, LoadImageError> {
    let uses: BTreeSet<ImageUse> = mesh
        .materials
        .iter()
        .flat_map(|m| channels(m).map(|(texture, srgb)| Some(image_use(m, texture?, srgb))))
        .flatten()
        .filter(|u| u.image < mesh.images.len())
        .collect();
    let textures = uses
        .into_par_iter()
        .map(|u| Ok((u, Arc::new(decode(&mesh.images[u.image], u)?))))
        .collect::<Result<Textures, LoadImageError>>()?;
    Ok(mesh.materials.iter().map(|m| of_material(mesh, m, &textures)).collect())
}

fn of_material(mesh: &Mesh, material: &Material, textures: &Textures) -> MaterialTextures {
    let [base_color, metallic_roughness, normal, occlusion, emission] =
        channels(material).map(|(texture, srgb)| {
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

/// The texture of each channel, and whether its colours are sRGB-encoded.
fn channels(material: &Material) -> [(Option<&TextureRef>, bool); 5] {
    [
        (material.base_color_texture.as_ref(), true),
        (material.metallic_roughness_texture.as_ref(), false),
        (material.normal_texture.as_ref(), false),
        (material.occlusion_texture.as_ref(), false),
        (material.emission_texture.as_ref(), true),
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
