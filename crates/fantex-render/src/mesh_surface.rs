//! A mesh with its own materials: images through texture coordinates, vertex colours, factors.

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_mesh::{AlphaMode, ImageSource, Material, Mesh, TextureRef, WrapMode};
use fantex_texture::{
    AlphaUse, ColorSpace, Filter, Image, ImageTexture, LoadImageError, SampleOptions, Samples, Wrap,
};
use glam::{Mat2, Mat3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::normals::CornerNormals;
use crate::surface::apply_alpha_mode;
use crate::tangents::corner_tangents;
use crate::{Coverage, Hit, MaterialSample, Surface};

/// How textures are filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterOptions {
    /// Reconstruction and anti-aliasing.
    pub filter: Filter,
    /// Longest ratio of the footprint's axes that `Anisotropic` and `Ewa` honour.
    pub max_anisotropy: f32,
}

impl Default for FilterOptions {
    /// Anisotropic, up to 16.
    fn default() -> Self {
        Self { filter: Filter::Anisotropic, max_anisotropy: 16.0 }
    }
}

/// A mesh with its own materials, the glTF way. Textures whose texture coordinates the mesh lacks are left out.
#[derive(Debug)]
pub struct MeshSurface<'a> {
    mesh: &'a Mesh,
    normals: CornerNormals,
    tangents: Vec<Vec4>,
    materials: Vec<Layers<'a>>,
    filter: FilterOptions,
}

/// A material with its images ready for look-ups.
#[derive(Debug)]
struct Layers<'a> {
    material: &'a Material,
    base_color: Option<Layer<'a>>,
    metallic_roughness: Option<Layer<'a>>,
    normal: Option<Layer<'a>>,
    occlusion: Option<Layer<'a>>,
    emission: Option<Layer<'a>>,
}

/// One use of an image.
#[derive(Debug)]
struct Layer<'a> {
    uv_set: &'a [Vec2],
    uv_transform: Mat3,
    wrap: [Wrap; 2],
    nearest: bool,
    texture: Arc<ImageTexture>,
}

/// What distinguishes two ways of decoding an image: colours or data, alpha as coverage or as a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct ImageUse {
    image: usize,
    srgb: bool,
    alpha_is_coverage: bool,
}

type Textures = BTreeMap<ImageUse, Arc<ImageTexture>>;

impl<'a> MeshSurface<'a> {
    /// Decodes the images that the materials use and prepares normals and tangents. Fails where an image that is used
    /// cannot be read.
    pub fn load(mesh: &'a Mesh, filter: FilterOptions) -> Result<Self, LoadImageError> {
        let uses: std::collections::BTreeSet<ImageUse> = mesh
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
        let materials: Vec<_> = mesh.materials.iter().map(|m| Layers::new(mesh, m, &textures)).collect();
        let normals = CornerNormals::of_mesh(mesh);
        let tangents = tangents(mesh, &normals, &materials);
        Ok(Self { mesh, normals, tangents, materials, filter })
    }

    fn layers(&self, triangle: usize) -> Option<&Layers<'a>> {
        self.materials.get(self.mesh.material_of(triangle))
    }

    fn sample(&self, layer: &Option<Layer>, hit: &Hit, lookups: &mut u32) -> Option<Vec4> {
        let layer = layer.as_ref()?;
        *lookups += 1;
        Some(layer.sample(hit, &self.filter))
    }

    /// The unit shading normal on the front side.
    fn normal(&self, layers: &Layers, hit: &Hit, lookups: &mut u32) -> Vec3 {
        let corners = self.normals.corners(self.mesh, hit.triangle);
        let vertex_normal = self.normals.at(self.mesh, hit);
        let Some(texel) = self.sample(&layers.normal, hit, lookups) else {
            return vertex_normal;
        };
        let scale = layers.material.normal_scale;
        let bent = (texel.truncate() * 2.0 - 1.0) * Vec3::new(scale, scale, 1.0);
        // Mikkelsen: normal and tangent are interpolated and used without normalisation.
        let tangents = [0, 1, 2].map(|k| self.tangents[3 * hit.triangle + k]);
        let (n, t) = (hit.blend(corners), hit.blend(tangents.map(Vec4::truncate)));
        let b = n.cross(t) * tangents[0].w;
        (t * bent.x + b * bent.y + n * bent.z).try_normalize().unwrap_or(vertex_normal)
    }

    fn vertex_color(&self, hit: &Hit) -> Vec4 {
        let colors = &self.mesh.corners.colors;
        match colors.get(3 * hit.triangle..3 * hit.triangle + 3) {
            Some(c) => hit.blend([c[0], c[1], c[2]]),
            None => Vec4::ONE,
        }
    }
}

impl Surface for MeshSurface<'_> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        let Some(layers) = self.layers(hit.triangle) else {
            let normal = self.normals.at(self.mesh, hit);
            return MaterialSample::with_normal(if hit.front { normal } else { -normal });
        };
        let material = layers.material;
        let mut lookups = 0;
        let mut sample = |layer| self.sample(layer, hit, &mut lookups).unwrap_or(Vec4::ONE);
        let base = material.base_color * self.vertex_color(hit) * sample(&layers.base_color);
        let metallic_roughness = sample(&layers.metallic_roughness);
        let occlusion = sample(&layers.occlusion).x;
        let emission = material.emission * sample(&layers.emission).truncate();
        let normal = self.normal(layers, hit, &mut lookups);
        MaterialSample {
            // Bicubic filters overshoot.
            base_color: base.truncate().max(Vec3::ZERO),
            alpha: apply_alpha_mode(material.alpha, base.w),
            normal: if hit.front { normal } else { -normal },
            occlusion: (1.0 + material.occlusion_strength * (occlusion - 1.0)).clamp(0.0, 1.0),
            roughness: (material.roughness * metallic_roughness.y).clamp(0.0, 1.0),
            metallic: (material.metallic * metallic_roughness.z).clamp(0.0, 1.0),
            emission: emission.max(Vec3::ZERO),
            unlit: material.unlit,
            lookups,
        }
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.layers(triangle).map_or(Coverage::Opaque, |l| Coverage::of(l.material))
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.layers(triangle).is_none_or(|l| l.material.double_sided)
    }
}

impl<'a> Layers<'a> {
    fn new(mesh: &'a Mesh, material: &'a Material, textures: &Textures) -> Self {
        let [base_color, metallic_roughness, normal, occlusion, emission] =
            channels(material).map(|(texture, srgb)| {
                let texture_ref = texture?;
                let texture = textures.get(&image_use(material, texture_ref, srgb))?;
                Some(Layer {
                    uv_set: mesh.corners.uv_sets.get(texture_ref.uv_set).filter(|set| !set.is_empty())?,
                    uv_transform: texture_ref.uv_transform,
                    wrap: texture_ref.wrap.map(wrap),
                    nearest: texture_ref.nearest,
                    texture: Arc::clone(texture),
                })
            });
        Self { material, base_color, metallic_roughness, normal, occlusion, emission }
    }
}

impl Layer<'_> {
    /// The image's coordinates at a triangle's corners.
    fn corner_uv(&self, triangle: usize) -> [Vec2; 3] {
        [0, 1, 2].map(|k| self.uv_transform.transform_point2(self.uv_set[3 * triangle + k]))
    }

    fn sample(&self, hit: &Hit, filter: &FilterOptions) -> Vec4 {
        let (uv, footprint) = hit.blend_coordinates(self.corner_uv(hit.triangle));
        let size = self.texture.size().map(|n| n as f32);
        let texels = Mat2::from_diagonal(Vec2::from(size));
        let magnified = footprint.iter().all(|d| (texels * *d).length_squared() <= 1.0);
        let options = SampleOptions {
            wrap: self.wrap,
            filter: if self.nearest && magnified { Filter::Nearest } else { filter.filter },
            max_anisotropy: filter.max_anisotropy,
        };
        Vec4::from_array(self.texture.sample(uv, footprint, &options))
    }
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

/// The mesh's own tangents, or those of the normal maps' coordinates; empty where nothing needs them.
fn tangents(mesh: &Mesh, normals: &CornerNormals, materials: &[Layers]) -> Vec<Vec4> {
    if materials.iter().all(|m| m.normal.is_none()) {
        return Vec::new();
    }
    if mesh.corners.tangents.len() == 3 * mesh.triangles.len() {
        return mesh.corners.tangents.clone();
    }
    corner_tangents(mesh, normals, |t| {
        Some(materials.get(mesh.material_of(t))?.normal.as_ref()?.corner_uv(t))
    })
}
