//! A model's materials as functions on its surface, the glTF way.
//!
//! ```text
//! images --load--> MaterialTextures --the caller's filter--> texels --factors, vertex colours--> values
//!                  normals, tangents --TangentFrame-----------------------bend---------------> normal
//! ```
//!
//! Whoever evaluates a material chooses how its images are filtered (for a pixel, for the texel of a bake); what is made
//! of the texels is the same for all and stands here.

mod filtering;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use fantex_mesh::{
    AlphaMode, ImageSource, Material, Mesh, TextureRef, WrapMode, corner_tangents, interpolate,
};
use glam::{Mat3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::{AlphaUse, ColorSpace, Image, ImageTexture, Samples, Wrap};

pub use filtering::*;

/// A material's textures; those whose texture coordinates the mesh lacks are left out.
#[derive(Clone, Debug, Default)]
pub struct MaterialTextures {
    /// sRGB colour, alpha.
    pub base_color: Option<TextureLayer>,
    /// Green = roughness, blue = metallic.
    pub metallic_roughness: Option<TextureLayer>,
    /// Tangent-space normal, 0..1.
    pub normal: Option<TextureLayer>,
    /// Red = occlusion.
    pub occlusion: Option<TextureLayer>,
    /// sRGB colour.
    pub emission: Option<TextureLayer>,
}

/// One use of an image.
#[derive(Clone, Debug)]
pub struct TextureLayer {
    /// Index into the mesh's `uv_sets`.
    pub uv_set: usize,
    /// From the corner's `(u, v, 1)` to the look-up.
    pub uv_transform: Mat3,
    /// Along u and v.
    pub wrap: [Wrap; 2],
    /// True where texels are to appear as squares when magnified.
    pub nearest: bool,
    /// The image with its levels; shared between materials.
    pub texture: Arc<ImageTexture>,
}

impl MaterialTextures {
    /// Those that there are.
    pub fn layers(&self) -> impl Iterator<Item = &TextureLayer> {
        let Self { base_color, metallic_roughness, normal, occlusion, emission } = self;
        [base_color, metallic_roughness, normal, occlusion, emission].into_iter().flatten()
    }
}

impl TextureLayer {
    /// The look-up coordinates at a triangle's corners.
    pub fn corner_uv(&self, mesh: &Mesh, triangle: usize) -> [Vec2; 3] {
        let set = &mesh.corners.uv_sets[self.uv_set];
        [0, 1, 2].map(|k| self.uv_transform.transform_point2(set[3 * triangle + k]))
    }
}

// Decoding of the images that materials use.

/// What distinguishes two ways of decoding an image: colours or data, alpha as coverage or as a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct ImageUse {
    image: usize,
    srgb: bool,
    alpha_is_coverage: bool,
}

type Textures = BTreeMap<ImageUse, Arc<ImageTexture>>;

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
pub fn load_material_textures(mesh: &Mesh) -> fantex_base::Result<Vec<MaterialTextures>> {
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
            let failed = |cause: fantex_base::Error| {
                let material = MaterialLabel::new(index, &mesh.materials[index]);
                cause.context(format!("the {channel} of {material}"))
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

fn decode(source: &ImageSource, image_use: ImageUse) -> Result<ImageTexture, fantex_base::Error> {
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

// From texels, factors and vertex colours to the values of a material (glTF 2.0, section 3.9).
//
// A channel without texture has the texel [`Vec4::ONE`].

/// Linear RGBA; the alpha is what the textures say, whatever the material makes of it. Negative where a filter overshoots.
pub fn base_color(material: &Material, vertex_color: Vec4, texel: Vec4) -> Vec4 {
    material.base_color * vertex_color * texel
}

/// Occlusion (the share of the surroundings' light that arrives), perceptual roughness and metallic, each 0..1.
pub fn occlusion_roughness_metallic(
    material: &Material,
    occlusion_texel: Vec4,
    metallic_roughness_texel: Vec4,
) -> Vec3 {
    let occlusion = 1.0 + material.occlusion_strength * (occlusion_texel.x - 1.0);
    let roughness = material.roughness * metallic_roughness_texel.y;
    let metallic = material.metallic * metallic_roughness_texel.z;
    Vec3::new(occlusion, roughness, metallic).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Linear RGB, may exceed 1. Negative where a filter overshoots.
pub fn emission(material: &Material, texel: Vec4) -> Vec3 {
    material.emission * texel.truncate()
}

/// The interpolated vertex colour, linear RGBA; white where the mesh has none. `lambda` lies inside the triangle.
pub fn vertex_color(mesh: &Mesh, triangle: usize, lambda: Vec3) -> Vec4 {
    let corners = mesh.corners.colors.get(3 * triangle..).and_then(|colors| colors.first_chunk::<3>());
    corners.map_or(Vec4::ONE, |&corners| interpolate(corners, lambda))
}

/// The tangents that normal maps are relative to, one per corner (see [`corner_tangents`]): the mesh's own, or those of the
/// normal maps' coordinates. Empty where no material has a normal map.
///
/// `normals` has a unit normal per corner, `textures` an entry per material.
pub fn normal_map_tangents(mesh: &Mesh, normals: &[Vec3], textures: &[MaterialTextures]) -> Vec<Vec4> {
    if textures.iter().all(|m| m.normal.is_none()) {
        return Vec::new();
    }
    if mesh.corners.tangents.len() == 3 * mesh.triangles.len() {
        return mesh.corners.tangents.clone();
    }
    corner_tangents(mesh, normals, |t| {
        Some(textures.get(mesh.material_of(t))?.normal.as_ref()?.corner_uv(mesh, t))
    })
}

/// The axes of tangent space at a point, mesh space: interpolated and used without normalisation, as in M. Mikkelsen,
/// "Simulation of Wrinkled Surfaces Revisited", 2008.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentFrame {
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
}

impl TangentFrame {
    /// At the point `lambda`, which lies inside `triangle`; `normals` and `tangents` have an entry per corner of the mesh.
    pub fn at(normals: &[Vec3], tangents: &[Vec4], triangle: usize, lambda: Vec3) -> Self {
        let corner = 3 * triangle;
        let normal = interpolate([0, 1, 2].map(|k| normals[corner + k]), lambda);
        let tangent = interpolate([0, 1, 2].map(|k| tangents[corner + k].truncate()), lambda);
        Self { tangent, bitangent: normal.cross(tangent) * tangents[corner].w, normal }
    }

    /// The coordinates of a unit normal relative to the axes, at unit length: `0.5 + 0.5 *` them is the texel that [`bend`]
    /// takes back to it. `None` where the axes lie in a plane.
    ///
    /// [`bend`]: Self::bend
    pub fn relative(&self, normal: Vec3) -> Option<Vec3> {
        let axes = Mat3::from_cols(self.tangent, self.bitangent, self.normal);
        if axes.determinant().abs() < 1e-6 {
            return None;
        }
        (axes.inverse() * normal).try_normalize()
    }

    /// A vector of tangent space (along tangent, bitangent and normal) in mesh space, not normalised.
    pub fn mesh_vector(&self, v_tangent: Vec3) -> Vec3 {
        self.tangent * v_tangent.x + self.bitangent * v_tangent.y + self.normal * v_tangent.z
    }

    /// The unit normal that a normal map's texel (0..1) stands for; `None` where it is no direction.
    pub fn bend(&self, material: &Material, texel: Vec4) -> Option<Vec3> {
        let scale = material.normal_scale;
        let bent = (texel.truncate() * 2.0 - 1.0) * Vec3::new(scale, scale, 1.0);
        self.mesh_vector(bent).try_normalize()
    }
}
