//! A model's own materials as tables of a look.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;

use fantex_base::Result;
use fantex_mesh::{AlphaMode, ImageSource, Material, Mesh, TextureRef};
use fantex_texture::combine::{Channel, Combine, CombineMode, Factor, TextureUse};
use fantex_texture::coordinates::{Projective, TextureMatrixOptions};
use fantex_texture::look::{LightingModel, LookMaterial};
use fantex_texture::material::{self, LeftOut, read_used_images};
use fantex_texture::{Color, ColorSpace, Stop, Wrap};
use glam::{Vec3, Vec4};

use crate::data::{
    CoordinatesKind, CoordinatesTable, ImageTable, Input, Look, MaterialName, MaterialTable, NoKeys,
    NormalMapTable, ObjectTable, OpacityName, TextureName, TextureTable, ToonTable, UvTable, WrapTable,
};
use crate::resolve::{ImageUse, ModelImages};
use crate::{LookFile, LookImages, ResolveOptions, Resolver};

/// A model's materials as a look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TranslatedLook {
    /// Textures, materials, and an object that has them.
    pub look: Look,
    /// For each of the model's materials its name in the look.
    pub materials: Vec<String>,
}

/// A model's own materials, resolved: one for each of the mesh's materials, and which images are [left out](LeftOut). Images are decoded in
/// parallel, each once per way of use.
///
/// # Errors
/// As [`read_used_images`].
pub fn materials_of_model(
    mesh: &Mesh,
    path: &Path,
    images: &LookImages,
    options: ResolveOptions,
) -> Result<(Vec<LookMaterial>, LeftOut)> {
    let (model_images, lacking, left_out) = load_images(mesh, images)?;
    let TranslatedLook { look, materials } = translated(mesh, lacking);
    let file = LookFile::of_look(look, path);
    let mut resolver = Resolver::new(&file, mesh, images, options).with_model_images(model_images);
    let base = LookMaterial::default();
    let materials = materials.iter().map(|name| resolver.material(name, &base));
    Ok((materials.collect::<Result<_>>()?, left_out))
}

/// The images that are read, and the uses of those that are left out.
fn load_images(
    mesh: &Mesh,
    images: &LookImages,
) -> Result<(ModelImages, HashSet<material::ImageUse>, LeftOut)> {
    let normals: BTreeSet<usize> =
        mesh.materials.iter().filter_map(|m| Some(m.normal_texture.as_ref()?.image)).collect();
    let kept = |used: material::ImageUse| {
        let is_normals = used.space == ColorSpace::Linear && normals.contains(&used.image);
        ImageUse { space: used.space, alpha: used.alpha, is_normals }
    };
    let read = |source: &ImageSource, used| images.of_model(source, kept(used));
    let (loaded, left_out) = read_used_images(mesh, |texture| has_set(mesh, texture), read)?;
    let (mut model_images, mut lacking) = (ModelImages::new(), HashSet::new());
    for (used, texture) in loaded {
        if let Some(texture) = texture {
            model_images.insert((used.image, kept(used)), texture);
        } else {
            lacking.insert(used);
        }
    }
    Ok((model_images, lacking, left_out))
}

fn has_set(mesh: &Mesh, texture: &TextureRef) -> bool {
    let set = mesh.corners.uv_sets.get(texture.uv_set);
    set.is_some_and(|set| set.len() == 3 * mesh.triangles.len())
}

/// The look that a model's materials are: textures named after the images, materials named after the model's, and an object
/// that gives each of the model's materials its look. Textures whose texture coordinates the mesh lacks are left out.
pub fn look_of_model(mesh: &Mesh) -> TranslatedLook {
    translated(mesh, HashSet::new())
}

/// The same without the images that are `lacking`.
fn translated(mesh: &Mesh, lacking: HashSet<material::ImageUse>) -> TranslatedLook {
    let mut translation = Translation { mesh, lacking, look: Look::default(), names: BTreeMap::new() };
    let mut object = ObjectTable::default();
    let mut materials = Vec::new();
    for (index, material) in mesh.materials.iter().enumerate() {
        let name = unused_name(&material.name, &translation.look.materials);
        materials.push(name.clone());
        let table = translation.material(material);
        translation.look.materials.insert(name.clone(), table);
        if mesh.materials.len() == 1 {
            object.material = Some(MaterialName(name));
        } else if !material.name.is_empty() && !object.materials.contains_key(&material.name) {
            object.materials.insert(material.name.clone(), MaterialName(name));
        } else {
            object.materials.insert(format!("#{index}"), MaterialName(name));
        }
    }
    translation.look.object.push(object);
    TranslatedLook { look: translation.look, materials }
}

struct Translation<'a> {
    mesh: &'a Mesh,
    lacking: HashSet<material::ImageUse>,
    look: Look,
    /// Names of textures that have been made, by what they are.
    names: BTreeMap<String, String>,
}

impl Translation<'_> {
    /// A texture that the mesh has the image and the coordinates for.
    fn usable<'t>(
        &self,
        material: &Material,
        texture: &'t Option<TextureRef>,
        space: ColorSpace,
    ) -> Option<&'t TextureRef> {
        let is_there = |t: &&TextureRef| has_set(self.mesh, t) && t.image < self.mesh.images.len();
        texture.as_ref().filter(is_there).filter(|t| !self.is_lacking(material, t, space))
    }

    fn is_lacking(&self, material: &Material, texture: &TextureRef, space: ColorSpace) -> bool {
        self.lacking.contains(&material::ImageUse::of(material, texture, space))
    }

    fn material(&mut self, material: &Material) -> MaterialTable {
        let opacity = match material.alpha {
            AlphaMode::Opaque => None,
            AlphaMode::Mask(_) => Some(OpacityName::Mask),
            AlphaMode::Blend => Some(OpacityName::Blend),
        };
        let surface = self.usable(material, &material.metallic_roughness_texture, ColorSpace::Linear);
        let mut table = MaterialTable {
            lighting: material.unlit.then_some(LightingModel::Unlit),
            base_color: Some(self.base_color(material)),
            opacity,
            metallic: Some(self.number(material, surface, Channel::Blue, material.metallic, 0.0)),
            roughness: Some(self.number(material, surface, Channel::Green, material.roughness, 0.0)),
            double_sided: Some(material.double_sided),
            ..MaterialTable::default()
        };
        if let AlphaMode::Mask(threshold) = material.alpha {
            table.threshold = Some(threshold);
        }
        if let Some(texture) = self.usable(material, &material.occlusion_texture, ColorSpace::Linear) {
            let strength = material.occlusion_strength;
            table.occlusion =
                Some(self.number(material, Some(texture), Channel::Red, strength, 1.0 - strength));
        }
        if material.emission != Vec3::ZERO {
            table.emission = Some(self.emission(material));
        }
        if let Some(texture) = self.usable(material, &material.normal_texture, ColorSpace::Linear) {
            table.normal_map = Some(NormalMapTable {
                texture: Input::Texture(self.texture(material, texture, ColorSpace::Linear)),
                scale: material.normal_scale,
                set: texture.uv_set as u32,
                ..NormalMapTable::default()
            });
        }
        table.toon = material.toon.as_ref().map(|scale| ToonTable {
            stops: scale.stops.iter().map(|&(at, color)| Stop { at, color: color.into() }).collect(),
            interpolation: scale.interpolation.into(),
        });
        table
    }

    /// `factor * vertex colour * texel`, multiplied in this order.
    fn base_color(&mut self, material: &Material) -> Input {
        let factor = factor_of(material.base_color);
        let texture = self.usable(material, &material.base_color_texture, ColorSpace::Srgb);
        let has_vertex_colors = !self.mesh.corners.colors.is_empty();
        match (texture, has_vertex_colors) {
            (None, false) => Input::Color(Color(material.base_color)),
            (None, true) => self.vertex_colors(factor),
            (Some(texture), false) => {
                let texture_use = self.texture(material, texture, ColorSpace::Srgb);
                Input::Texture(TextureUse { factor, ..texture_use })
            }
            (Some(texture), true) => {
                let name = format!("{}_tinted", self.image_name(texture.image));
                let combined = Combine {
                    mode: CombineMode::Modulate,
                    texture: Input::Texture(self.texture(material, texture, ColorSpace::Srgb)),
                    fragment: self.vertex_colors(factor),
                    ..Combine::default()
                };
                let what = format!("{combined:?}");
                Input::texture(self.define(&what, &name, TextureTable::Combine(combined)))
            }
        }
    }

    fn vertex_colors(&mut self, factor: Factor) -> Input {
        let vertex_colors = TextureTable::VertexColor(NoKeys::default());
        let name = self.define("vertex colours", "vertex_colors", vertex_colors);
        Input::Texture(TextureUse { factor, ..TextureUse::plain(TextureName(name)) })
    }

    fn emission(&mut self, material: &Material) -> Input {
        let is_lacking = |texture| self.is_lacking(material, texture, ColorSpace::Srgb);
        match self.usable(material, &material.emission_texture, ColorSpace::Srgb) {
            // Light that is to come from some places only comes from none.
            None if material.emission_texture.as_ref().is_some_and(is_lacking) => {
                Input::Color(Vec3::ZERO.into())
            }
            None => Input::Color(material.emission.into()),
            Some(texture) => {
                let texture_use = self.texture(material, texture, ColorSpace::Srgb);
                let factor = factor_of(material.emission.extend(1.0));
                Input::Texture(TextureUse { factor, ..texture_use })
            }
        }
    }

    /// `factor * channel + offset`, or their sum without a texture.
    fn number(
        &mut self,
        material: &Material,
        texture: Option<&TextureRef>,
        channel: Channel,
        factor: f32,
        offset: f32,
    ) -> Input {
        let Some(texture) = texture else { return Input::Number(factor + offset) };
        let texture_use = self.texture(material, texture, ColorSpace::Linear);
        Input::Texture(TextureUse {
            channel: Some(channel),
            factor: Factor::Number(factor),
            offset,
            ..texture_use
        })
    }

    fn texture(
        &mut self,
        material: &Material,
        texture: &TextureRef,
        color_space: ColorSpace,
    ) -> TextureUse<TextureName> {
        let is_identity = texture.uv_transform == glam::Mat3::IDENTITY;
        let matrix = TextureMatrixOptions {
            matrix: (!is_identity).then_some(Projective(texture.uv_transform)),
            ..TextureMatrixOptions::default()
        };
        let wraps = texture.wrap.map(Wrap::from);
        let table = ImageTable {
            model_image: Some(texture.image as u32),
            color_space,
            alpha: material::ImageUse::of(material, texture, color_space).alpha,
            coordinates: CoordinatesTable(CoordinatesKind::Uv(UvTable { set: texture.uv_set as u32 })),
            matrix,
            wrap: if wraps[0] == wraps[1] { WrapTable::Both(wraps[0]) } else { WrapTable::Each(wraps) },
            square_texels: texture.nearest,
            ..ImageTable::default()
        };
        let what = format!("{table:?}");
        let name = self.image_name(texture.image);
        TextureUse::plain(TextureName(self.define(&what, &name, TextureTable::Image(table))))
    }

    /// The name of a texture that is `what`; defines it the first time.
    fn define(&mut self, what: &str, wanted: &str, table: TextureTable) -> String {
        if let Some(name) = self.names.get(what) {
            return name.clone();
        }
        let name = unused_name(wanted, &self.look.textures);
        self.look.textures.insert(name.clone(), table);
        self.names.insert(what.to_owned(), name.clone());
        name
    }

    fn image_name(&self, image: usize) -> String {
        let file = match self.mesh.images.get(image) {
            Some(ImageSource::File(path)) => path.as_path(),
            _ => Path::new(""),
        };
        file.file_stem().map_or_else(|| format!("image{image}"), |stem| stem.to_string_lossy().into_owned())
    }
}

/// `wanted`, as a name may be written, with a number where it is taken.
fn unused_name<T>(wanted: &str, taken: &BTreeMap<String, T>) -> String {
    let mut name: String =
        wanted.chars().map(|c| if c.is_alphanumeric() || c == '-' { c } else { '_' }).collect();
    if name.is_empty() {
        name.push_str("material");
    }
    let mut candidate = name.clone();
    let mut number = 2;
    while taken.contains_key(&candidate) {
        candidate = format!("{name}_{number}");
        number += 1;
    }
    candidate
}

fn factor_of(rgba: Vec4) -> Factor {
    let [r, g, b, a] = rgba.to_array();
    if r == g && g == b && a == 1.0 { Factor::Number(r) } else { Factor::Color(Color(rgba)) }
}
