//! From a look to textures and materials for one model.
//!
//! ```text
//! TextureTable --texture--> Arc<dyn Texture>   (each once, in any order: the file knows no circles)
//! MaterialTable --material--> LookMaterial     (what is left out comes from the default or from the model's material)
//! ```

mod assets;
mod images;

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_base::{Aabb, Error, Result};
use fantex_mesh::{Mesh, ObjectSpace};
use fantex_texture::combine::{Contours, Field, Layers, RampTexture, TextureUse};
use fantex_texture::coordinates::{
    Coordinates, InPlace, InSpace, NormalAxes, Parameter, Place, TextureCoordinates, TextureMatrix,
};
use fantex_texture::look::{
    Anisotropy, FragmentTexture, LookMaterial, NormalSpace, Opacity, Relief, Slot, TangentSpace,
};
use fantex_texture::{
    ColorRamp, DetailPolygon, Filter, Landscape, NoiseOptions, NoiseTexture, OMap, Placement,
    PolygonsTexture, Recipe, SMap, Shape, ShapeKind, Sines, Solid, SolidTexture, Texture, TriplanarMap,
    TwoPartMapping,
};
use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::data::{
    AnisotropyTable, CoordinatesKind, CoordinatesTable, HeightTable, Input, MaterialBase, MaterialTable,
    NormalMapTable, NormalSpaceName, OMapName, OpacityName, PolygonsTable, SurfaceTable, TextureTable,
    TriplanarTable,
};
use crate::{Key, LookFile, problem};

pub use images::LookImages;
pub(crate) use images::{ImageUse, ModelImages};

/// What textures are made for.
#[derive(Clone, Copy, Debug)]
pub struct ResolveOptions {
    /// Bytes that a tabulation or a volume may take.
    pub memory_bytes: u64,
    /// Added to the seeds of all patterns.
    pub seed: u32,
    /// The filter of images that name none; the look's own (`picture.filter`) where it is left out.
    pub filter: Option<Filter>,
}

impl Default for ResolveOptions {
    /// 1 GiB, seed 0, the look's filter.
    fn default() -> Self {
        Self { memory_bytes: 1 << 30, seed: 0, filter: None }
    }
}

/// Makes the textures and materials of a look for one model.
#[derive(Debug)]
pub struct Resolver<'a> {
    file: &'a LookFile,
    mesh: Option<&'a Mesh>,
    /// Object space.
    bounds: Aabb,
    /// Range of y over which landscapes go from sand to snow.
    altitudes: [f32; 2],
    options: ResolveOptions,
    images: &'a LookImages,
    model_images: ModelImages,
    made: BTreeMap<String, Node>,
}

type Node = Arc<dyn Texture>;

impl<'a> Resolver<'a> {
    /// For a model. Images are shared with all resolvers that have the same `images`.
    pub fn new(file: &'a LookFile, mesh: &'a Mesh, images: &'a LookImages, options: ResolveOptions) -> Self {
        Self::with_bounds(file, Some(mesh), ObjectSpace::of(mesh).bounds(), images, options)
    }

    /// For what has no model, such as the slide of a projector: a cube of edge 1 around the origin.
    pub fn without_model(file: &'a LookFile, images: &'a LookImages, options: ResolveOptions) -> Self {
        let bounds = Aabb { min: Vec3::splat(-0.5), max: Vec3::splat(0.5) };
        Self::with_bounds(file, None, bounds, images, options)
    }

    fn with_bounds(
        file: &'a LookFile,
        mesh: Option<&'a Mesh>,
        bounds: Aabb,
        images: &'a LookImages,
        options: ResolveOptions,
    ) -> Self {
        let (model_images, made) = (ModelImages::new(), BTreeMap::new());
        let altitudes = [bounds.min.y, bounds.max.y];
        Self { file, mesh, bounds, altitudes, options, images, model_images, made }
    }

    /// With the altitudes of what displacement has made of the model.
    pub fn with_altitudes_of(self, displaced: &Mesh) -> Self {
        let bounds = ObjectSpace::of(displaced).aabb(displaced.bounds());
        Self { altitudes: [bounds.min.y, bounds.max.y], ..self }
    }

    /// With images of the model that have been read already.
    pub(crate) fn with_model_images(self, model_images: ModelImages) -> Self {
        Self { model_images, ..self }
    }

    /// The texture of a name.
    ///
    /// # Errors
    /// There is no such texture, or it cannot be made: a missing image, numbers that make no sense together.
    pub fn texture(&mut self, name: &str) -> Result<Arc<dyn Texture>> {
        if let Some(texture) = self.made.get(name) {
            return Ok(Arc::clone(texture));
        }
        let file = self.file;
        let Some(table) = file.look().textures.get(name) else {
            let known = file.look().textures.keys().map(String::as_str);
            return Err(file.error(&Key::default(), problem::undefined("texture", name, known)));
        };
        let texture = self.make(table, &Key::of(["textures", name]))?;
        self.made.insert(name.to_owned(), Arc::clone(&texture));
        Ok(texture)
    }

    fn make(&mut self, table: &TextureTable, key: &Key) -> Result<Node> {
        use TextureTable as T;
        Ok(match table {
            T::Image(table) => self.image(table, false, key)?,
            T::Volume(table) => self.volume(table, key)?,
            T::Asset(table) => self.asset(table, key)?,
            T::Frames(table) => self.frames(table, key)?,
            T::Table(table) => self.tabulation(table, key)?,
            T::Cube(table) => self.cube(table, key)?,
            T::Color(table) => Arc::new(table.color.0),
            T::Noise(noise) => self.noise(noise, key)?,
            T::Sines(table) => self.sines(table, key)?,
            T::Wood(solid) => self.solid(solid, key)?,
            T::Rings(solid) => self.solid(solid, key)?,
            T::Marble(solid) => self.solid(solid, key)?,
            T::Clouds(solid) => self.solid(solid, key)?,
            T::Granite(solid) => self.solid(solid, key)?,
            T::Checker(solid) => self.solid(solid, key)?,
            T::Brick(solid) => self.solid(solid, key)?,
            T::Rock(solid) => self.solid(solid, key)?,
            T::Landscape(solid) => {
                let [low, high] = self.altitudes.map(|y| solid.place.height(y, self.radius()));
                let half_height = (0.5 * (high - low).abs()).max(1e-6);
                let texture = Landscape { half_height, middle: 0.5 * (low + high), ..solid.texture };
                self.solid(&InPlace { texture, place: solid.place }, key)?
            }
            T::Ramp(node) => {
                let RampTexture { input, channel, ramp } = node;
                self.accept(&key.name("stops"), ramp.check())?;
                let input = self.input(input, &key.name("input"))?;
                Arc::new(RampTexture { input, channel: *channel, ramp: ramp.clone() })
            }
            T::Contours(node) => {
                let contours: Contours = node.with_inputs(|i, name| self.input(i, &key.name(name)))?;
                self.accept(key, contours.check())?;
                Arc::new(contours)
            }
            T::Combine(node) => Arc::new(node.with_inputs(|i, name| self.input(i, &key.name(name)))?),
            T::Layers(node) => {
                let base = self.input(&node.base, &key.name("base"))?;
                let layers = node.layers.iter().enumerate().map(|(index, layer)| {
                    let key = key.name("layers").index(index);
                    layer.with_inputs(|i, name| self.input(i, &key.name(name)))
                });
                let layers = layers.collect::<Result<Vec<_>>>()?;
                Arc::new(Layers { base, layers })
            }
            T::Mix(node) => Arc::new(node.with_inputs(|i, name| self.input(i, &key.name(name)))?),
            T::Math(node) => Arc::new(node.with_inputs(|i, name| self.input(i, &key.name(name)))?),
            T::Remap(node) => {
                let remap = node.with_inputs(|i, name| self.input(i, &key.name(name)))?;
                self.accept(key, remap.check())?;
                Arc::new(remap)
            }
            T::Swizzle(node) => Arc::new(node.with_inputs(|i, name| self.input(i, &key.name(name)))?),
            T::Placed(table) => {
                let input = self.input(&table.texture, &key.name("texture"))?;
                self.in_space(input, &table.place, key)?
            }
            T::Polygons(table) => self.polygons(table, key)?,
            T::Height(table) => self.parameter(self.height(table), &key.name("direction"))?,
            T::Distance(table) => {
                let center = table.center;
                let from_axis = |axis: [f32; 3]| Parameter::AxisDistance { center, direction: axis.into() };
                self.parameter(table.axis.map_or(Parameter::Distance { center }, from_axis), key)?
            }
            T::Slope(table) => self.parameter(Parameter::Slope { up: table.up }, &key.name("up"))?,
            T::Facing(_) => Arc::new(Parameter::Facing),
            T::Time(_) => Arc::new(Parameter::Time),
            T::Normal(_) => Arc::new(Field::Normal),
            T::Uv(table) => Arc::new(Field::Uv { set: table.set as usize }),
            T::Position(_) => {
                let (center, half) = (self.bounds.center(), 0.5 * self.bounds.extent());
                Arc::new(Field::Position { min: center - half, max: center + half })
            }
            T::VertexColor(_) => Arc::new(Field::VertexColor),
        })
    }

    /// What a key holds that may be a texture.
    fn input(&mut self, input: &Input, key: &Key) -> Result<Slot> {
        let named = match input {
            Input::Number(number) => return Ok(Slot::number(*number)),
            Input::Color(color) => return Ok(Slot::from(*color)),
            Input::Texture(named) => named,
        };
        let texture = self.texture(&named.texture.0)?;
        if named.is_plain() {
            return Ok(Slot::Texture(texture));
        }
        let TextureUse { channel, factor, offset, .. } = *named;
        let texture_use = TextureUse { texture, channel, factor, offset };
        self.accept(key, texture_use.check())?;
        Ok(Slot::Texture(Arc::new(texture_use)))
    }

    /// What a part of the engine says, at a key.
    fn accept<T, E: std::error::Error + Send + Sync + 'static>(
        &self,
        key: &Key,
        result: Result<T, E>,
    ) -> Result<T> {
        result.map_err(|error| self.file.error(key, problem::refused(error)))
    }

    fn refuse<T>(&self, key: &Key, problem: Error) -> Result<T> {
        Err(self.file.error(key, problem))
    }

    fn filter(&self, filter: Option<Filter>) -> Filter {
        filter.or(self.options.filter).unwrap_or(self.file.look().picture.filter)
    }

    /// Radius of the sphere around the bounding box, world units; 1 for a point.
    fn radius(&self) -> f32 {
        let radius = 0.5 * (self.bounds.max - self.bounds.min).length();
        if radius > 0.0 { radius } else { 1.0 }
    }
}

// ---- Textures of space and numbers of the surface.

impl Resolver<'_> {
    /// A texture that keeps the object's normal.
    fn in_space(&self, input: Slot, place: &Place, key: &Key) -> Result<Node> {
        let matrix = self.accept(&key.name("place"), place.matrix(self.radius()))?;
        Ok(Arc::new(InSpace { input, matrix, normal_axes: NormalAxes::Object }))
    }

    fn solid(&self, solid: &InPlace<impl Recipe>, key: &Key) -> Result<Node> {
        self.accept(key, solid.texture.check())?;
        let prepared = solid.texture.prepared(self.options.seed);
        let normal_axes = prepared.normal_axes();
        let matrix = self.accept(&key.name("place"), solid.place.matrix(self.radius()))?;
        let input = Slot::Texture(Arc::new(SolidTexture(prepared)));
        Ok(Arc::new(InSpace { input, matrix, normal_axes }))
    }

    fn noise(&self, noise: &InPlace<NoiseOptions>, key: &Key) -> Result<Node> {
        let seed = self.options.seed.wrapping_add(noise.texture.seed);
        let options = NoiseOptions { seed, ..noise.texture };
        self.accept(key, options.check())?;
        self.in_space(Slot::Texture(Arc::new(NoiseTexture::new(options))), &noise.place, key)
    }

    fn sines(&self, sines: &InPlace<Sines>, key: &Key) -> Result<Node> {
        for (index, wave) in sines.texture.waves.iter().enumerate() {
            let length = wave.direction.length();
            if !(length > 0.0 && length.is_finite()) {
                let sentence = format!(
                    "the length of the direction of a wave is {length}; it must be finite and above 0"
                );
                return self
                    .refuse(&key.name("waves").index(index).name("direction"), Error::malformed(sentence));
            }
        }
        self.in_space(Slot::Texture(Arc::new(sines.texture.clone())), &sines.place, key)
    }

    /// Without an origin, from 0 to 1 over the bounding box along the direction.
    fn height(&self, table: &HeightTable) -> Parameter {
        let direction = table.direction.normalize_or_zero();
        match table.origin {
            Some(origin) => {
                Parameter::Along { origin: Vec3::from_array(origin), direction: direction / table.unit }
            }
            None => {
                let reach = direction.abs().dot(self.bounds.extent());
                Parameter::Along {
                    origin: self.bounds.center() - direction * (0.5 * reach),
                    direction: direction / reach.max(f32::MIN_POSITIVE),
                }
            }
        }
    }

    fn parameter(&self, parameter: Parameter, key: &Key) -> Result<Node> {
        self.accept(key, parameter.check())?;
        Ok(Arc::new(parameter))
    }

    fn polygons(&mut self, table: &PolygonsTable, key: &Key) -> Result<Node> {
        let list = key.name("polygons");
        let polygons = (0..).zip(&table.polygons).map(|(material, polygon)| {
            let outlines = polygon.outlines.iter().map(|o| o.iter().map(|&c| Vec2::from_array(c)).collect());
            DetailPolygon { outlines: outlines.collect(), material, priority: polygon.priority }
        });
        let polygons: Vec<DetailPolygon> = polygons.collect();
        let colors = table.polygons.iter().enumerate();
        let colors = colors.map(|(i, polygon)| self.input(&polygon.color, &list.index(i).name("color")));
        let colors = colors.collect::<Result<Vec<_>>>()?;
        let base = self.input(&table.base, &key.name("base"))?;
        let place = (
            self.coordinates(&table.coordinates, &key.name("coordinates"))?,
            self.accept(&key.name("matrix"), TextureMatrix::new(table.matrix))?,
        );
        let texture = PolygonsTexture::new(&polygons, colors, base, place, table.repeat);
        Ok(Arc::new(self.accept(&list, texture)?))
    }
}

// ---- Coordinates.

impl Resolver<'_> {
    fn coordinates(&mut self, table: &CoordinatesTable, key: &Key) -> Result<Coordinates> {
        let coordinates = match &table.0 {
            CoordinatesKind::Uv(table) => Coordinates::Uv { set: table.set as usize },
            CoordinatesKind::Plane(table) => self.surface(ShapeKind::Plane, table, key)?,
            CoordinatesKind::Box(table) => self.surface(ShapeKind::Box, table, key)?,
            CoordinatesKind::Cylinder(table) => self.surface(ShapeKind::Cylinder, table, key)?,
            CoordinatesKind::Sphere(table) => self.surface(ShapeKind::Sphere, table, key)?,
            CoordinatesKind::Hemispheres(table) => self.surface(ShapeKind::Hemispheres, table, key)?,
            CoordinatesKind::Triplanar(table) => Coordinates::Triplanar(self.triplanar(table)),
            CoordinatesKind::Texture(table) => Coordinates::Textures(TextureCoordinates {
                u: self.input(&table.u, &key.name("u"))?,
                v: self.input(&table.v, &key.name("v"))?,
            }),
        };
        self.accept(key, coordinates.check())?;
        Ok(coordinates)
    }

    fn surface(&self, kind: ShapeKind, table: &SurfaceTable, key: &Key) -> Result<Coordinates> {
        let mut shape = kind.fit(self.bounds);
        if let Shape::Hemispheres(map) = &mut shape {
            map.layout = table.layout;
        }
        let vector = |values: [f64; 3]| DVec3::from_array(values).as_vec3();
        let placement = Placement {
            pivot: vector(table.pivot),
            scale: vector(table.scale.axes()),
            rotation: Placement::rotation_from_degrees(vector(table.rotate)),
            translation: vector(table.translate),
        };
        let s_map = self.accept(key, SMap::new(shape, &placement))?;
        let o_map = match table.o_map {
            OMapName::SurfaceNormal => return Ok(Coordinates::Surface(s_map)),
            OMapName::Reflection => OMap::Reflection,
            OMapName::ObjectNormal => OMap::ObjectNormal,
            OMapName::Centroid => OMap::Centroid { center: placement.pivot },
        };
        Ok(Coordinates::TwoPart(TwoPartMapping { s_map, o_map }))
    }

    fn triplanar(&self, table: &TriplanarTable) -> TriplanarMap {
        let fitted = TriplanarMap::fit(self.bounds);
        let scale = table.size.map_or(fitted.scale, |size| 1.0 / size as f32);
        TriplanarMap { scale, sharpness: table.sharpness as f32, ..fitted }
    }
}

// ---- Materials.

/// What a table makes of the opacity of the material that it starts from.
fn opacity(table: &MaterialTable, base: Opacity) -> Opacity {
    let base_threshold = match base {
        Opacity::Mask { threshold } => Some(threshold),
        Opacity::Opaque | Opacity::Blend => None,
    };
    let threshold = table.threshold.or(base_threshold).unwrap_or(DEFAULT_THRESHOLD);
    match (table.opacity, base) {
        (Some(OpacityName::Opaque), _) | (None, Opacity::Opaque) => Opacity::Opaque,
        (Some(OpacityName::Mask), _) | (None, Opacity::Mask { .. }) => Opacity::Mask { threshold },
        (Some(OpacityName::Blend), _) | (None, Opacity::Blend) => Opacity::Blend,
    }
}

/// Least alpha that is seen in cut-outs that name none.
const DEFAULT_THRESHOLD: f32 = 0.5;

impl Resolver<'_> {
    /// The material of a name. `base` is the one that the model has at the place, for materials that start from it.
    ///
    /// # Errors
    /// There is no such material, or one of its textures cannot be made.
    pub fn material(&mut self, name: &str, base: &LookMaterial) -> Result<LookMaterial> {
        let file = self.file;
        let Some(table) = file.look().materials.get(name) else {
            let known = file.look().materials.keys().map(String::as_str);
            return self.refuse(&Key::default(), problem::undefined("material", name, known));
        };
        let key = &Key::of(["materials", name]);
        let mut material = match table.from {
            MaterialBase::Default => LookMaterial::default(),
            MaterialBase::Model => base.clone(),
        };
        self.slots(table, key, &mut material)?;
        material.lighting = table.lighting.unwrap_or(material.lighting);
        material.color_use = table.color_use.unwrap_or(material.color_use);
        material.opacity = opacity(table, material.opacity);
        if let Some(toon) = &table.toon {
            let ramp = ColorRamp { stops: toon.stops.clone(), interpolation: toon.interpolation };
            self.accept(&key.name("toon").name("stops"), ramp.check())?;
            material.toon = Some(Arc::new(ramp));
        }
        if let Some(anisotropy) = &table.anisotropy {
            material.anisotropy = Some(self.anisotropy(anisotropy, &key.name("anisotropy"))?);
        }
        material.double_sided = table.double_sided.unwrap_or(material.double_sided);
        self.relief(table, key, &mut material.relief)?;
        Ok(material)
    }

    fn slots(&mut self, table: &MaterialTable, key: &Key, material: &mut LookMaterial) -> Result<()> {
        let slots: [(&str, &Option<Input>, &mut Slot); 9] = [
            ("base_color", &table.base_color, &mut material.base_color),
            ("alpha", &table.alpha, &mut material.alpha),
            ("metallic", &table.metallic, &mut material.metallic),
            ("roughness", &table.roughness, &mut material.roughness),
            ("occlusion", &table.occlusion, &mut material.occlusion),
            ("ambient", &table.ambient, &mut material.ambient),
            ("specular", &table.specular, &mut material.specular),
            ("emission", &table.emission, &mut material.emission),
            ("reflection", &table.reflection, &mut material.reflection),
        ];
        for (name, input, slot) in slots {
            if let Some(input) = input {
                *slot = self.input(input, &key.name(name))?;
            }
        }
        let optional: [(&str, &Option<Input>, &mut Option<Slot>); 3] = [
            ("shininess", &table.shininess, &mut material.shininess),
            ("light_map", &table.light_map, &mut material.light_map),
            ("modulate", &table.modulate, &mut material.modulate),
        ];
        if let Some(table) = &table.fragment {
            let texture = self.input(&table.texture, &key.name("fragment").name("texture"))?;
            material.fragment =
                Some(FragmentTexture { mode: table.mode, texture, constant: table.constant.0 });
        }
        for (name, input, slot) in optional {
            if let Some(input) = input {
                *slot = Some(self.input(input, &key.name(name))?);
            }
        }
        Ok(())
    }

    /// What bends the normal: a normal map replaces the model's, bumps are added to what there is.
    fn relief(&mut self, table: &MaterialTable, key: &Key, relief: &mut Vec<Relief>) -> Result<()> {
        if let Some(map) = &table.normal_map {
            relief.retain(|r| !matches!(r, Relief::Normal { .. }));
            relief.insert(0, self.normal_map(map, &key.name("normal_map"))?);
        }
        if let Some(bump) = &table.bump {
            relief.push(Relief::Bump {
                texture: self.node(&bump.texture, &key.name("bump"))?,
                height: bump.height,
                difference: bump.difference,
            });
        }
        if let Some(derivatives) = &table.derivatives {
            relief.push(Relief::Derivatives {
                texture: self.node(&derivatives.texture, &key.name("derivatives"))?,
                uv_set: derivatives.set as usize,
                height: derivatives.height,
                range: derivatives.range,
            });
        }
        Ok(())
    }

    fn normal_map(&mut self, table: &NormalMapTable, key: &Key) -> Result<Relief> {
        Ok(Relief::Normal {
            texture: self.normals(&table.texture, key)?,
            scale: table.scale,
            space: match table.space {
                NormalSpaceName::Tangent => NormalSpace::Tangent(self.tangent_space(table)),
                NormalSpaceName::Object => NormalSpace::Object,
            },
        })
    }

    /// The texture of a normal map.
    fn normals(&mut self, input: &Input, key: &Key) -> Result<Node> {
        let file = self.file;
        if let Input::Texture(named) = input
            && named.is_plain()
            && let Some(TextureTable::Image(table)) = file.look().textures.get(&named.texture.0)
        {
            return self.image(table, true, &Key::of(["textures", &named.texture.0]));
        }
        self.node(input, key)
    }

    /// That of a set of texture coordinates; where the map is an image of the model, of the coordinates as the model transforms them.
    fn tangent_space(&self, table: &NormalMapTable) -> TangentSpace {
        let of_set = TangentSpace::of_set(table.set as usize);
        let Input::Texture(named) = &table.texture else { return of_set };
        match self.file.look().textures.get(&named.texture.0) {
            Some(TextureTable::Image(image)) if image.model_image.is_some() => TangentSpace {
                uv_transform: image.matrix.matrix.map_or(Mat3::IDENTITY, |map| map.0),
                of_model: true,
                ..of_set
            },
            _ => of_set,
        }
    }

    /// The texture of a key `texture`.
    fn node(&mut self, input: &Input, key: &Key) -> Result<Node> {
        Ok(match self.input(input, &key.name("texture"))? {
            Slot::Constant(value) => Arc::new(value),
            Slot::Texture(texture) => texture,
        })
    }

    fn anisotropy(&mut self, table: &AnisotropyTable, key: &Key) -> Result<Anisotropy> {
        Ok(Anisotropy {
            strength: self.input(&table.strength, &key.name("strength"))?,
            direction: self.input(&table.direction, &key.name("direction"))?,
            uv_set: table.set as usize,
        })
    }

    /// The height texture of a material's displacement, if it has one: red, times `height`, in world units.
    ///
    /// # Errors
    /// The texture cannot be made.
    pub fn displacement(&mut self, name: &str) -> Result<Option<Slot>> {
        let file = self.file;
        let table = file.look().materials.get(name).and_then(|m| m.displacement.as_ref());
        let key = Key::of(["materials", name, "displacement", "texture"]);
        table.map(|table| self.input(&table.texture, &key)).transpose()
    }
}
