//! Materials, textures, samplers and images.

use glam::{Mat3, Vec2, Vec3, Vec4};

use super::schema;
use super::uri::{Target, resolve};
use super::{BufferProblem, Document, GltfProblem, get};
use crate::{AlphaMode, ImageSource, Material, Model, TextureRef, WrapMode};

/// Loads all materials and images into the model, in the file's order.
pub(super) fn load(document: &Document, model: &mut Model) -> Result<(), GltfProblem> {
    let images = document.root.images.iter().enumerate();
    model.images =
        images.map(|(index, image)| load_image(document, index, image)).collect::<Result<_, _>>()?;
    for (index, material) in document.root.materials.iter().enumerate() {
        let mut reader = MaterialReader { document, index, notes: &mut model.notes };
        model.materials.push(reader.read(material)?);
    }
    Ok(())
}

/// What primitives without a material have.
pub(super) fn default_material() -> Material {
    Material { metallic: 1.0, roughness: 1.0, double_sided: false, ..Material::default() }
}

fn load_image(document: &Document, index: usize, image: &schema::Image) -> Result<ImageSource, GltfProblem> {
    let file_name = document.file.path.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
    let embedded = |bytes: &[u8]| ImageSource::Embedded {
        label: format!("image {index} of {file_name}"),
        bytes: bytes.into(),
    };
    if let Some(view) = image.buffer_view {
        return Ok(embedded(document.buffers.view(view, || format!("image {index}"))?));
    }
    let target = match &image.uri {
        Some(uri) => resolve(uri, document.folder()),
        None => Err(BufferProblem::NoData),
    };
    match target.map_err(|problem| GltfProblem::Image { image: index, problem })? {
        Target::Bytes(bytes) => Ok(embedded(&bytes)),
        Target::File(path) => Ok(ImageSource::File(path)),
    }
}

struct MaterialReader<'a> {
    document: &'a Document<'a>,
    index: usize,
    notes: &'a mut Vec<String>,
}

impl MaterialReader<'_> {
    fn read(&mut self, source: &schema::Material) -> Result<Material, GltfProblem> {
        let pbr = self.metallic_roughness(source);
        let strength =
            source.extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength).unwrap_or(1.0);
        let normal_scale = source.normal_texture.as_ref().and_then(|t| t.scale);
        let occlusion_strength = source.occlusion_texture.as_ref().and_then(|t| t.strength);
        Ok(Material {
            name: source.name.clone(),
            place: format!("material {}", self.index),
            base_color: pbr.base_color_factor.map_or(Vec4::ONE, Vec4::from),
            base_color_texture: self.texture(pbr.base_color_texture.as_ref())?,
            metallic: pbr.metallic_factor.unwrap_or(1.0),
            roughness: pbr.roughness_factor.unwrap_or(1.0),
            metallic_roughness_texture: self.texture(pbr.metallic_roughness_texture.as_ref())?,
            normal_texture: self.texture(source.normal_texture.as_ref())?,
            normal_scale: normal_scale.unwrap_or(1.0),
            occlusion_texture: self.texture(source.occlusion_texture.as_ref())?,
            occlusion_strength: occlusion_strength.unwrap_or(1.0),
            emission: Vec3::from(source.emissive_factor) * strength,
            emission_texture: self.texture(source.emissive_texture.as_ref())?,
            alpha: self.alpha(source),
            double_sided: source.double_sided,
            unlit: source.extensions.unlit.is_some(),
            toon: None,
        })
    }

    /// The material's metallic-roughness; where it has none, what there is of its specular-glossiness, in which scans and
    /// purchased models were written before metallic-roughness was common.
    fn metallic_roughness(&mut self, source: &schema::Material) -> schema::MetallicRoughness {
        let own = source.pbr_metallic_roughness.clone();
        let Some(glossy) = source.extensions.specular_glossiness.as_ref().filter(|_| own.is_none()) else {
            return own.unwrap_or_default();
        };
        self.notes.push(format!(
            "material {}: of its specular-glossiness the diffuse colour and the glossiness factor were read",
            self.index
        ));
        schema::MetallicRoughness {
            base_color_factor: glossy.diffuse_factor,
            base_color_texture: glossy.diffuse_texture.clone(),
            metallic_factor: Some(0.0),
            roughness_factor: Some((1.0 - glossy.glossiness_factor.unwrap_or(1.0)).clamp(0.0, 1.0)),
            metallic_roughness_texture: None,
        }
    }

    fn alpha(&mut self, source: &schema::Material) -> AlphaMode {
        match source.alpha_mode.as_deref() {
            None | Some("OPAQUE") => AlphaMode::Opaque,
            Some("MASK") => AlphaMode::Mask(source.alpha_cutoff.unwrap_or(0.5)),
            Some("BLEND") => AlphaMode::Blend,
            Some(other) => {
                self.notes
                    .push(format!("material {}: the unknown alpha mode {other:?} became OPAQUE", self.index));
                AlphaMode::Opaque
            }
        }
    }

    fn texture(&mut self, info: Option<&schema::TextureInfo>) -> Result<Option<TextureRef>, GltfProblem> {
        let Some(info) = info else { return Ok(None) };
        let root = self.document.root;
        let from = || format!("material {}", self.index);
        let texture = get(&root.textures, info.index, "texture", from)?;
        let from = || format!("texture {}", info.index);
        let source = texture.source.or(texture.extensions.webp.as_ref().and_then(|e| e.source));
        let Some(image) = source else {
            let (material, texture) = (self.index, info.index);
            self.notes.push(format!(
                "material {material}: texture {texture} has no image that fantex reads and was left out"
            ));
            return Ok(None);
        };
        get(&root.images, image, "image", from)?;
        let sampler = texture.sampler.map(|s| get(&root.samplers, s, "sampler", from)).transpose()?;
        let transform = info.extensions.transform.as_ref();
        Ok(Some(TextureRef {
            image,
            uv_set: transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord),
            uv_transform: transform.map_or(Mat3::IDENTITY, uv_transform),
            wrap: sampler.map_or([WrapMode::Repeat; 2], |s| [s.wrap_s, s.wrap_t].map(wrap_mode)),
            nearest: sampler.is_some_and(|s| s.mag_filter == Some(9728)),
        }))
    }
}

/// From the numbers that glTF inherited from OpenGL; what is unknown repeats.
fn wrap_mode(code: Option<u64>) -> WrapMode {
    match code {
        Some(33071) => WrapMode::Clamp,
        Some(33648) => WrapMode::Mirror,
        _ => WrapMode::Repeat,
    }
}

/// Scale first, then a rotation that is counter-clockwise to the eye (v runs downwards), then the offset.
fn uv_transform(transform: &schema::TextureTransform) -> Mat3 {
    let (sin, cos) = transform.rotation.sin_cos();
    let rotation = Mat3::from_cols(Vec3::new(cos, -sin, 0.0), Vec3::new(sin, cos, 0.0), Vec3::Z);
    let scale = transform.scale.map_or(Vec2::ONE, Vec2::from);
    Mat3::from_translation(Vec2::from(transform.offset)) * rotation * Mat3::from_scale(scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the extension's own text: offset (0, 1), a quarter turn and scale one half choose the lower left
    /// quadrant of the image.
    #[test]
    fn a_quarter_turn_chooses_the_lower_left_quadrant() {
        let transform = schema::TextureTransform {
            offset: [0.0, 1.0],
            rotation: std::f32::consts::FRAC_PI_2,
            scale: Some([0.5, 0.5]),
            tex_coord: None,
        };
        let matrix = uv_transform(&transform);
        let centre = matrix.transform_point2(Vec2::splat(0.5));
        assert!((centre - Vec2::new(0.25, 0.75)).length() < 1e-6, "{centre}");
        for corner in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE] {
            let p = matrix.transform_point2(corner);
            assert!((-1e-6..=0.5 + 1e-6).contains(&p.x) && (0.5 - 1e-6..=1.0 + 1e-6).contains(&p.y), "{p}");
        }
    }
}
