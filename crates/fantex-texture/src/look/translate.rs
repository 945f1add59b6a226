//! A model's own materials as tables of a look.

use std::collections::BTreeMap;
use std::path::Path;

use fantex_look::data::{
    AlphaName, Channel, Color, ColorSpaceName, CombineName, CombineTable, CoordinatesKind, CoordinatesTable,
    Factor, ImageTable, Input, LightingName, Look, MaterialName, MaterialTable, MatrixTable, NoKeys,
    NormalMapTable, ObjectTable, OpacityName, TextureName, TextureTable, TextureUse, UvTable, WrapName,
    WrapTable,
};
use fantex_look::{LookError, LookFile};
use fantex_mesh::{AlphaMode, ImageSource, Material, Mesh, TextureRef, WrapMode};
use glam::{Vec3, Vec4};

use super::{LookImages, LookMaterial, ResolveOptions, Resolver};

/// A model's materials as a look.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TranslatedLook {
    /// Textures, materials, and an object that wears them.
    pub look: Look,
    /// For each of the model's materials its name in the look.
    pub materials: Vec<String>,
}

/// A model's own materials, resolved: one for each of the mesh's materials.
///
/// # Errors
///
/// An image of the model cannot be read.
pub fn materials_of_model(
    mesh: &Mesh,
    path: &Path,
    images: &LookImages,
    options: ResolveOptions,
) -> Result<Vec<LookMaterial>, LookError> {
    let TranslatedLook { look, materials } = look_of_model(mesh);
    let file = LookFile::from_look(&look, path)?;
    let mut resolver = Resolver::new(&file, mesh, images, options);
    let base = LookMaterial::default();
    materials.iter().map(|name| resolver.material(name, &base)).collect()
}

/// The look that a model's materials are: textures named after the images, materials named after the model's, and an object
/// that gives each of the model's materials its look. Textures whose texture coordinates the mesh lacks are left out.
pub fn look_of_model(mesh: &Mesh) -> TranslatedLook {
    let mut translation = Translation { mesh, look: Look::default(), names: BTreeMap::new() };
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
    look: Look,
    /// Names of textures that have been made, by what they are.
    names: BTreeMap<String, String>,
}

impl Translation<'_> {
    fn material(&mut self, material: &Material) -> MaterialTable {
        let opacity = match material.alpha {
            AlphaMode::Opaque => None,
            AlphaMode::Mask(_) => Some(OpacityName::Mask),
            AlphaMode::Blend => Some(OpacityName::Blend),
        };
        let surface = self.usable(&material.metallic_roughness_texture);
        let mut table = MaterialTable {
            lighting: material.unlit.then_some(LightingName::Unlit),
            base_color: Some(self.base_color(material)),
            opacity,
            metallic: Some(self.number(surface, Channel::B, material.metallic, 0.0)),
            roughness: Some(self.number(surface, Channel::G, material.roughness, 0.0)),
            double_sided: Some(material.double_sided),
            ..MaterialTable::default()
        };
        if let AlphaMode::Mask(threshold) = material.alpha {
            table.threshold = shortest(threshold);
        }
        if let Some(texture) = self.usable(&material.occlusion_texture) {
            let strength = material.occlusion_strength;
            table.occlusion = Some(self.number(Some(texture), Channel::R, strength, 1.0 - strength));
        }
        if material.emission != Vec3::ZERO {
            table.emission = Some(self.emission(material));
        }
        if let Some(texture) = self.usable(&material.normal_texture) {
            table.normal_map = Some(NormalMapTable {
                texture: Input::Texture(self.texture(
                    texture,
                    ColorSpaceName::Linear,
                    AlphaName::Independent,
                )),
                scale: shortest(material.normal_scale),
                set: texture.uv_set as u32,
                ..NormalMapTable::default()
            });
        }
        table
    }

    /// A texture that the mesh has the image and the coordinates for.
    fn usable<'t>(&self, texture: &'t Option<TextureRef>) -> Option<&'t TextureRef> {
        let corners = 3 * self.mesh.triangles.len();
        let has_set = |set: usize| self.mesh.corners.uv_sets.get(set).is_some_and(|s| s.len() == corners);
        texture.as_ref().filter(|t| has_set(t.uv_set) && t.image < self.mesh.images.len())
    }

    /// Factor, texture and vertex colours.
    fn base_color(&mut self, material: &Material) -> Input {
        let factor = material.base_color;
        let alpha = match material.alpha {
            AlphaMode::Opaque => AlphaName::Independent,
            AlphaMode::Mask(_) | AlphaMode::Blend => AlphaName::Coverage,
        };
        let texture = self.usable(&material.base_color_texture);
        let mut color = match texture {
            None => Input::Color(color(factor)),
            Some(texture) => {
                let texture_use = self.texture(texture, ColorSpaceName::Srgb, alpha);
                Input::Texture(TextureUse { factor: factor_of(factor), ..texture_use })
            }
        };
        if !self.mesh.corners.colors.is_empty() {
            let vertex_colors = TextureTable::VertexColor(NoKeys::default());
            let fragment = Input::texture(self.define("vertex colours", "vertex_colors", vertex_colors));
            let mode = CombineName::Modulate;
            let combined = CombineTable { mode, texture: color, fragment, ..CombineTable::default() };
            let what = format!("{combined:?}");
            let name =
                texture.map_or("tinted".to_owned(), |t| format!("{}_tinted", self.image_name(t.image)));
            color = Input::texture(self.define(&what, &name, TextureTable::Combine(combined)));
        }
        color
    }

    fn emission(&mut self, material: &Material) -> Input {
        match self.usable(&material.emission_texture) {
            None => Input::Color(color(material.emission.extend(1.0))),
            Some(texture) => {
                let texture_use = self.texture(texture, ColorSpaceName::Srgb, AlphaName::Independent);
                let factor = factor_of(material.emission.extend(1.0));
                Input::Texture(TextureUse { factor, ..texture_use })
            }
        }
    }

    /// `factor * channel + offset`, or their sum without a texture.
    fn number(&mut self, texture: Option<&TextureRef>, channel: Channel, factor: f32, offset: f32) -> Input {
        let Some(texture) = texture else { return Input::Number(shortest(factor + offset)) };
        let texture_use = self.texture(texture, ColorSpaceName::Linear, AlphaName::Independent);
        Input::Texture(TextureUse {
            channel: Some(channel),
            factor: Factor::Number(shortest(factor)),
            offset: shortest(offset),
            ..texture_use
        })
    }

    fn texture(&mut self, texture: &TextureRef, color_space: ColorSpaceName, alpha: AlphaName) -> TextureUse {
        let rows = texture.uv_transform.transpose().to_cols_array_2d();
        let is_identity = texture.uv_transform == glam::Mat3::IDENTITY;
        let matrix = MatrixTable {
            projective: (!is_identity).then(|| rows.map(|row| row.map(shortest))),
            ..MatrixTable::default()
        };
        let wraps = texture.wrap.map(|wrap| match wrap {
            WrapMode::Clamp => WrapName::Clamp,
            WrapMode::Repeat => WrapName::Repeat,
            WrapMode::Mirror => WrapName::Mirror,
        });
        let table = ImageTable {
            model_image: Some(texture.image as u32),
            color_space,
            alpha,
            coordinates: CoordinatesTable(CoordinatesKind::Uv(UvTable { set: texture.uv_set as u32 })),
            matrix,
            wrap: if wraps[0] == wraps[1] { WrapTable::Both(wraps[0]) } else { WrapTable::Each(wraps) },
            square_texels: texture.nearest,
            ..ImageTable::default()
        };
        let what = format!("{table:?}");
        let name = self.image_name(texture.image);
        TextureUse::plain(TextureName(self.define(&what, &name, TextureTable::Image(table))).0)
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

/// The shortest decimal number that is this one in single precision.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

fn color(rgba: Vec4) -> Color {
    Color::Linear(rgba.to_array().map(shortest))
}

fn factor_of(rgba: Vec4) -> Factor {
    let [r, g, b, a] = rgba.to_array();
    if r == g && g == b && a == 1.0 { Factor::Number(shortest(r)) } else { Factor::Color(color(rgba)) }
}
