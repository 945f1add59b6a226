//! A model's materials as functions on its surface, the glTF way.
//!
//! ```text
//! images --load--> MaterialTextures --the caller's filter--> texels --factors, vertex colours--> values
//!                  normals, tangents --TangentFrame-----------------------bend---------------> normal
//! ```
//!
//! Whoever evaluates a material chooses how its images are filtered (for a pixel, for the texel of a bake); what is made
//! of the texels is the same for all and stands here.

mod bump;
mod filtering;
mod packed;
mod reading;

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use fantex_base::Result;
use fantex_mesh::{
    AlphaMode, ImageSource, Material, Mesh, TextureRef, WrapMode, corner_tangents, interpolate,
};
use glam::{Mat3, Vec2, Vec3, Vec4};

use crate::{AlphaUse, ColorSpace, Image, ImageTexture, Wrap};

pub use filtering::*;
pub use packed::read_image;
pub use reading::{LeftOut, UsedImages, read_used_images};

use reading::used_images;

/// One `T` for each channel of a material that may have an image.
#[derive(Clone, Debug, Default)]
pub struct ImageSlots<T> {
    /// sRGB colour, alpha.
    pub base_color: T,
    /// Green = roughness, blue = metallic.
    pub metallic_roughness: T,
    /// Tangent-space normal, 0..1.
    pub normal: T,
    /// Red = occlusion.
    pub occlusion: T,
    /// sRGB colour.
    pub emission: T,
}

/// A material's textures; those whose texture coordinates the mesh lacks are left out.
pub type MaterialTextures = ImageSlots<Option<TextureLayer>>;

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

impl<T> ImageSlots<T> {
    /// What `of` makes of each.
    pub fn map<U>(self, mut of: impl FnMut(T) -> U) -> ImageSlots<U> {
        ImageSlots {
            base_color: of(self.base_color),
            metallic_roughness: of(self.metallic_roughness),
            normal: of(self.normal),
            occlusion: of(self.occlusion),
            emission: of(self.emission),
        }
    }

    /// References to all.
    pub fn each_ref(&self) -> ImageSlots<&T> {
        let Self { base_color, metallic_roughness, normal, occlusion, emission } = self;
        ImageSlots { base_color, metallic_roughness, normal, occlusion, emission }
    }

    /// All of them, in the order of the fields.
    pub(crate) fn into_array(self) -> [T; 5] {
        [self.base_color, self.metallic_roughness, self.normal, self.occlusion, self.emission]
    }
}

impl<T> ImageSlots<Option<T>> {
    /// Those that there are.
    pub fn layers(&self) -> impl Iterator<Item = &T> {
        self.each_ref().into_array().into_iter().flatten()
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

/// An image as a channel of a material uses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImageUse {
    /// Index in the mesh.
    pub image: usize,
    /// What the channel's numbers mean.
    pub space: ColorSpace,
    /// Coverage for the base colour of a material that looks at its alpha.
    pub alpha: AlphaUse,
}

impl ImageUse {
    /// How a channel of this colour space uses its texture.
    pub fn of(material: &Material, texture: &TextureRef, space: ColorSpace) -> Self {
        let is_base_color = material.base_color_texture.as_ref() == Some(texture);
        let is_coverage = is_base_color && material.alpha != AlphaMode::Opaque;
        let alpha = if is_coverage { AlphaUse::Coverage } else { AlphaUse::Independent };
        Self { image: texture.image, space, alpha }
    }
}

/// Decodes all images that a mesh's materials use: an entry per material, and which images are [left out](LeftOut). A texture whose image
/// is left out is none; what glows by one is dark.
///
/// # Errors
/// As [`read_used_images`].
pub fn load_material_textures(mesh: &Mesh) -> Result<(Vec<MaterialTextures>, LeftOut)> {
    load_material_textures_with_progress(mesh, &|_| {})
}

/// The same; `progress` is told the share that is done, 0..1, from any thread.
///
/// # Errors
/// As [`read_used_images`].
pub fn load_material_textures_with_progress(
    mesh: &Mesh,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<(Vec<MaterialTextures>, LeftOut)> {
    let (all, done) = (used_images(mesh, |_| true).len(), AtomicUsize::new(0));
    let decode = |source: &ImageSource, used| {
        let texture = Arc::new(decode(source, used)?);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress((done as f32 / all.max(1) as f32).min(1.0));
        Ok(texture)
    };
    let (textures, left_out) = read_used_images(mesh, |_| true, decode)?;
    let textures: HashMap<_, _> = textures.into_iter().collect();
    let black = Arc::new(ImageTexture::new(Arc::new(Image::from_linear_rgb(1, 1, &[[0.0; 4]]))));
    let of_material = |material| {
        channels(material).map(|(channel, texture, space)| {
            let texture_ref: &TextureRef = texture?;
            let texture = textures.get(&ImageUse::of(material, texture_ref, space))?;
            let set = mesh.corners.uv_sets.get(texture_ref.uv_set)?;
            let (texture, uv_transform) = match texture {
                Some(texture) => (texture, texture_ref.uv_transform),
                // One texel everywhere, which asks for no density.
                None if channel == EMISSION => (&black, Mat3::from_cols(Vec3::ZERO, Vec3::ZERO, Vec3::Z)),
                None => return None,
            };
            (set.len() == 3 * mesh.triangles.len()).then(|| TextureLayer {
                uv_set: texture_ref.uv_set,
                uv_transform,
                wrap: texture_ref.wrap.map(Wrap::from),
                nearest: texture_ref.nearest,
                texture: Arc::clone(texture),
            })
        })
    };
    Ok((mesh.materials.iter().map(of_material).collect(), left_out))
}

/// What emission textures are called in messages.
const EMISSION: &str = "emission texture";

fn channels(material: &Material) -> ImageSlots<(&'static str, Option<&TextureRef>, ColorSpace)> {
    use ColorSpace::{Linear, Srgb};
    ImageSlots {
        base_color: ("base colour", material.base_color_texture.as_ref(), Srgb),
        metallic_roughness: (
            "metallic-roughness texture",
            material.metallic_roughness_texture.as_ref(),
            Linear,
        ),
        normal: ("normal map", material.normal_texture.as_ref(), Linear),
        occlusion: ("occlusion texture", material.occlusion_texture.as_ref(), Linear),
        emission: (EMISSION, material.emission_texture.as_ref(), Srgb),
    }
}

fn decode(source: &ImageSource, ImageUse { space, alpha, .. }: ImageUse) -> Result<ImageTexture> {
    let image = read_image(source, space)?;
    Ok(ImageTexture::with_alpha_use(Arc::new(image), alpha))
}

impl From<WrapMode> for Wrap {
    fn from(mode: WrapMode) -> Self {
        match mode {
            WrapMode::Clamp => Self::Clamp,
            WrapMode::Repeat => Self::Repeat,
            WrapMode::Mirror => Self::Mirror,
        }
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
    if let Some(own) = own_tangents(mesh) {
        return own.to_vec();
    }
    corner_tangents(mesh, normals, |t| {
        Some(textures.get(mesh.material_of(t))?.normal.as_ref()?.corner_uv(mesh, t))
    })
}

/// The mesh's own tangents, where every corner has one.
pub(crate) fn own_tangents(mesh: &Mesh) -> Option<&[Vec4]> {
    let tangents = &mesh.corners.tangents[..];
    (tangents.len() == 3 * mesh.triangles.len()).then_some(tangents)
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
