//! From the tables of a look to textures and materials.
//!
//! ```text
//! TextureTable --texture--> Arc<dyn Texture>   (each once, in any order: the file knows no circles)
//! MaterialTable --material--> LookMaterial     (what is left out comes from the default or from the model's material)
//! ```

mod files;
mod nodes;

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_look::data::{
    AnisotropyTable, Channel as ChannelOfUse, ChannelName, Color, ColorUseName, CombineName, CoordinatesKind,
    CoordinatesTable, DifferenceName, Factor, FilterName, HemisphereLayoutName, Input, LightingName,
    MaterialBase, MaterialTable, MatrixTable, NormalMapTable, NormalSpaceName, OMapName, OpacityName,
    OperationName, PlaceTable, PlaceUnit, RampName, StopTable, SurfaceTable, TextureTable, TriplanarTable,
    WrapName,
};
use fantex_look::{Key, LookError, LookFile, LookProblem};
use fantex_mesh::Mesh;
use glam::{DAffine3, DMat4, DQuat, DVec3, EulerRot, Mat3, Vec2, Vec3, Vec4};

use crate::color::linear_from_srgb;
use crate::combine::{Channel, CombineMode, Operation, ScaleOffset, Swizzle};
use crate::coordinates::{Coordinates, SpaceMatrix, SpaceMatrixOptions, TextureMatrix, TextureMatrixOptions};
use crate::look::{
    Anisotropy, ColorUse, Difference, LightingModel, LookMaterial, NormalSpace, Opacity, Relief, Slot,
};
use crate::{
    Bounds, ColorRamp, ColorRampError, Filter, HemisphereLayout, OMap, Placement, RampInterpolation, SMap,
    Shape, ShapeKind, Texture, TriplanarMap, TwoPartMapping, Wrap,
};

pub use files::LookImages;

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
    bounds: Bounds,
    options: ResolveOptions,
    images: &'a LookImages,
    made: BTreeMap<String, Arc<dyn Texture>>,
}

type Made<T> = Result<T, LookError>;

impl<'a> Resolver<'a> {
    /// For a model. Images are shared with all resolvers that have the same `images`.
    pub fn new(file: &'a LookFile, mesh: &'a Mesh, images: &'a LookImages, options: ResolveOptions) -> Self {
        Self::with_bounds(file, Some(mesh), object_bounds(mesh), images, options)
    }

    /// For what has no model, such as the slide of a projector: a cube of edge 1 around the origin.
    pub fn without_model(file: &'a LookFile, images: &'a LookImages, options: ResolveOptions) -> Self {
        let bounds = Bounds { min: Vec3::splat(-0.5), max: Vec3::splat(0.5) };
        Self::with_bounds(file, None, bounds, images, options)
    }

    fn with_bounds(
        file: &'a LookFile,
        mesh: Option<&'a Mesh>,
        bounds: Bounds,
        images: &'a LookImages,
        options: ResolveOptions,
    ) -> Self {
        Self { file, mesh, bounds, options, images, made: BTreeMap::new() }
    }

    /// The texture of a name.
    ///
    /// # Errors
    ///
    /// There is no such texture, or it cannot be made: a missing image, numbers that make no sense together.
    pub fn texture(&mut self, name: &str) -> Made<Arc<dyn Texture>> {
        if let Some(texture) = self.made.get(name) {
            return Ok(Arc::clone(texture));
        }
        let key = Key::of(["textures", name]);
        let Some(table) = self.file.look().textures.get(name) else {
            let known = self.file.look().textures.keys().cloned().collect();
            let problem =
                LookProblem::Undefined { what: "texture", name: name.to_owned(), nearest: None, known };
            return Err(self.file.error(&Key::default(), problem));
        };
        let texture = self.make(table, &key)?;
        self.made.insert(name.to_owned(), Arc::clone(&texture));
        Ok(texture)
    }

    /// All textures of the look, for their mistakes.
    ///
    /// # Errors
    ///
    /// As [`Resolver::texture`].
    pub fn all_textures(&mut self) -> Made<()> {
        let file = self.file;
        file.look().textures.keys().try_for_each(|name| self.texture(name).map(drop))
    }

    fn make(&mut self, table: &TextureTable, key: &Key) -> Made<Arc<dyn Texture>> {
        use TextureTable as T;
        match table {
            T::Image(table) => self.image(table, key),
            T::Volume(table) => self.volume(table, key),
            T::Frames(table) => self.frames(table, key),
            T::Table(table) => self.tabulation(table, key),
            T::Cube(table) => self.cube(table, key),
            T::Color(table) => Ok(Arc::new(linear_color(table.color))),
            T::Noise(table) => self.noise(table, key),
            T::Wood(table) => self.wood(table, key),
            T::Marble(table) => self.marble(table, key),
            T::Sines(table) => self.sines(table, key),
            T::Clouds(table) => self.clouds(table, key),
            T::Granite(table) => self.granite(table, key),
            T::Checker(table) => self.checker(table, key),
            T::Brick(table) => self.brick(table, key),
            T::Rock(table) => self.rock(table, key),
            T::Landscape(table) => self.landscape(table, key),
            T::Ramp(table) => self.ramp(table, key),
            T::Contours(table) => self.contours(table, key),
            T::Polygons(table) => self.polygons(table, key),
            T::Combine(table) => self.combine(table, key),
            T::Layers(table) => self.layers(table, key),
            T::Mix(table) => self.mix(table, key),
            T::Math(table) => self.math(table, key),
            T::Remap(table) => self.remap(table, key),
            T::Swizzle(table) => self.swizzle(table, key),
            T::Placed(table) => self.placed(table, key),
            T::Height(table) => self.height(table, key),
            T::Distance(table) => self.distance(table, key),
            T::Slope(table) => self.slope(table, key),
            T::Facing(_) | T::Time(_) | T::Position(_) | T::Normal(_) | T::VertexColor(_) | T::Uv(_) => {
                Ok(self.field(table))
            }
        }
    }

    /// What a key holds that may be a texture.
    fn input(&mut self, input: &Input, key: &Key) -> Made<Slot> {
        let texture_use = match input {
            Input::Number(number) => return Ok(Slot::number(*number as f32)),
            Input::Color(color) => return Ok(Slot::Constant(linear_color(*color))),
            Input::Texture(texture_use) => texture_use,
        };
        let mut slot = Slot::Texture(self.texture(&texture_use.texture.0)?);
        if let Some(channel) = texture_use.channel {
            slot = Slot::Texture(Arc::new(Swizzle::select(slot, self::channel(channel))));
        }
        let scale = self::factor(texture_use.factor);
        let offset = Vec3::splat(texture_use.offset as f32).extend(0.0);
        if scale != Vec4::ONE || offset != Vec4::ZERO {
            let scaled = ScaleOffset { input: slot, scale, offset };
            self.accept(key, scaled.check())?;
            slot = Slot::Texture(Arc::new(scaled));
        }
        Ok(slot)
    }

    /// What a part of the engine says, at a key.
    fn accept<T, E: std::error::Error + Send + Sync + 'static>(
        &self,
        key: &Key,
        result: Result<T, E>,
    ) -> Made<T> {
        result.map_err(|error| self.file.error(key, LookProblem::refused(error)))
    }

    fn refuse<T>(&self, key: &Key, problem: LookProblem) -> Made<T> {
        Err(self.file.error(key, problem))
    }

    /// The filter of images that name none.
    fn filter(&self, name: Option<FilterName>) -> Filter {
        let of_picture = || self.options.filter.unwrap_or(self::filter(self.file.look().picture.filter));
        name.map_or_else(of_picture, self::filter)
    }
}

/// The bounding box of a mesh in object space: world units, the origin in the middle.
fn object_bounds(mesh: &Mesh) -> Bounds {
    let scale = mesh.world_from_mesh.scale as f32;
    let first = mesh.positions.first().copied().unwrap_or(Vec3::ZERO);
    let (min, max) = mesh.positions.iter().fold((first, first), |(min, max), &p| (min.min(p), max.max(p)));
    Bounds { min: min * scale, max: max * scale }
}

// Values of the tables as those of the engine.

/// Linear RGBA of a colour.
pub fn linear_color(color: Color) -> Vec4 {
    match color {
        Color::Srgb([r, g, b, a]) => {
            let light = |byte: u8| linear_from_srgb(f32::from(byte) / 255.0);
            Vec4::new(light(r), light(g), light(b), f32::from(a) / 255.0)
        }
        Color::Linear(numbers) => Vec4::from_array(numbers.map(|n| n as f32)),
    }
}

/// Linear RGB of a colour.
pub fn linear_rgb(color: Color) -> Vec3 {
    linear_color(color).truncate()
}

fn factor(factor: Factor) -> Vec4 {
    match factor {
        Factor::Number(number) => Vec3::splat(number as f32).extend(1.0),
        Factor::Color(color) => linear_color(color),
    }
}

fn vec2(values: [f64; 2]) -> Vec2 {
    Vec2::from_array(values.map(|v| v as f32))
}

fn vec3(values: [f64; 3]) -> Vec3 {
    DVec3::from_array(values).as_vec3()
}

fn channel(channel: ChannelOfUse) -> Channel {
    match channel {
        ChannelOfUse::R => Channel::Red,
        ChannelOfUse::G => Channel::Green,
        ChannelOfUse::B => Channel::Blue,
        ChannelOfUse::A => Channel::Alpha,
    }
}

fn channel_name(name: ChannelName) -> Channel {
    match name {
        ChannelName::R => Channel::Red,
        ChannelName::G => Channel::Green,
        ChannelName::B => Channel::Blue,
        ChannelName::A => Channel::Alpha,
        ChannelName::Luminance => Channel::Luminance,
        ChannelName::Zero => Channel::Zero,
        ChannelName::One => Channel::One,
    }
}

fn filter(name: FilterName) -> Filter {
    match name {
        FilterName::Nearest => Filter::Nearest,
        FilterName::Bilinear => Filter::Bilinear,
        FilterName::Bicubic => Filter::Bicubic,
        FilterName::Trilinear => Filter::Trilinear,
        FilterName::Anisotropic => Filter::Anisotropic,
        FilterName::Ewa => Filter::Ewa,
    }
}

fn wrap(name: WrapName) -> Wrap {
    match name {
        WrapName::Repeat => Wrap::Repeat,
        WrapName::Clamp => Wrap::Clamp,
        WrapName::Mirror => Wrap::Mirror,
        WrapName::Border => Wrap::Border,
    }
}

fn combine_mode(name: CombineName) -> CombineMode {
    match name {
        CombineName::Replace => CombineMode::Replace,
        CombineName::Modulate => CombineMode::Modulate,
        CombineName::Decal => CombineMode::Decal,
        CombineName::Blend => CombineMode::Blend,
    }
}

fn operation(name: OperationName) -> Operation {
    match name {
        OperationName::Add => Operation::Add,
        OperationName::Subtract => Operation::Subtract,
        OperationName::Multiply => Operation::Multiply,
        OperationName::Minimum => Operation::Minimum,
        OperationName::Maximum => Operation::Maximum,
    }
}

fn ramp(stops: &[StopTable], interpolation: RampName) -> Result<ColorRamp, ColorRampError> {
    let stops = stops.iter().map(|stop| (stop.at as f32, linear_color(stop.color))).collect();
    let interpolation = match interpolation {
        RampName::Linear => RampInterpolation::Linear,
        RampName::Smooth => RampInterpolation::Smooth,
        RampName::Constant => RampInterpolation::Constant,
    };
    ColorRamp::new(stops, interpolation)
}

// Coordinates, texture matrices and places.

impl Resolver<'_> {
    fn coordinates(&self, table: &CoordinatesTable, key: &Key) -> Made<Coordinates> {
        let coordinates = match &table.0 {
            CoordinatesKind::Uv(table) => Coordinates::Uv { set: table.set as usize },
            CoordinatesKind::Plane(table) => self.surface(ShapeKind::Plane, table, key)?,
            CoordinatesKind::Box(table) => self.surface(ShapeKind::Box, table, key)?,
            CoordinatesKind::Cylinder(table) => self.surface(ShapeKind::Cylinder, table, key)?,
            CoordinatesKind::Sphere(table) => self.surface(ShapeKind::Sphere, table, key)?,
            CoordinatesKind::Hemispheres(table) => self.surface(ShapeKind::Hemispheres, table, key)?,
            CoordinatesKind::Triplanar(table) => Coordinates::Triplanar(self.triplanar(table)),
        };
        self.accept(key, coordinates.check())?;
        Ok(coordinates)
    }

    fn surface(&self, kind: ShapeKind, table: &SurfaceTable, key: &Key) -> Made<Coordinates> {
        let mut shape = kind.fit(self.bounds);
        if let Shape::Hemispheres(map) = &mut shape {
            map.layout = match table.layout {
                HemisphereLayoutName::Shared => HemisphereLayout::Shared,
                HemisphereLayoutName::SideBySide => HemisphereLayout::SideBySide,
            };
        }
        let placement = Placement {
            pivot: vec3(table.pivot),
            scale: vec3(table.scale.axes()),
            rotation: Placement::rotation_from_degrees(vec3(table.rotate)),
            translation: vec3(table.translate),
        };
        let s_map = self.accept(key, SMap::new(shape, &placement))?;
        let o_map = match table.o_map {
            OMapName::SurfaceNormal => return Ok(Coordinates::Surface(s_map)),
            OMapName::Reflection => OMap::Reflection,
            OMapName::ObjectNormal => OMap::ObjectNormal,
            OMapName::Centroid => OMap::Centroid { center: vec3(table.pivot) },
        };
        Ok(Coordinates::TwoPart(TwoPartMapping { s_map, o_map }))
    }

    fn triplanar(&self, table: &TriplanarTable) -> TriplanarMap {
        let fitted = TriplanarMap::fit(self.bounds);
        let scale = table.size.map_or(fitted.scale, |size| 1.0 / size as f32);
        TriplanarMap { scale, sharpness: table.sharpness as f32, ..fitted }
    }

    fn matrix(&self, table: &MatrixTable, key: &Key) -> Made<TextureMatrix> {
        let [x, y, _] = table.scale.axes();
        let options = TextureMatrixOptions {
            matrix: table.projective.map_or(Mat3::IDENTITY, |rows| {
                Mat3::from_cols_array_2d(&rows.map(|row| row.map(|n| n as f32))).transpose()
            }),
            pivot: vec2(table.pivot),
            scale: vec2([x, y]),
            rotation: table.rotate as f32,
            translation: vec2(table.translate),
            scale_per_second: Vec2::splat(table.grow as f32),
            rotation_per_second: table.spin as f32,
            translation_per_second: vec2(table.shift_per_second),
        };
        self.accept(key, TextureMatrix::new(options))
    }

    /// From the object's space to a pattern's. The pattern is an object of its own, so its motion is the inverse of that
    /// of the coordinates.
    fn place(&self, table: &PlaceTable, key: &Key) -> Made<SpaceMatrix> {
        let unit = match table.unit {
            PlaceUnit::World => 1.0,
            PlaceUnit::Model => f64::from(self.radius()),
        };
        let scale = DVec3::from_array(table.scale.axes()) * unit;
        let [x, y, z] = table.rotate.map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::ZYX, z, y, x);
        let object_from_pattern =
            DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::from_array(table.center));
        let options = SpaceMatrixOptions {
            matrix: DMat4::from(object_from_pattern.inverse()).as_mat4(),
            rotation_per_second: -vec3(table.spin),
            translation_per_second: -vec3(table.shift_per_second),
            ..SpaceMatrixOptions::default()
        };
        self.accept(key, SpaceMatrix::new(options))
    }

    /// Radius of the sphere around the bounding box, world units; 1 for a point.
    fn radius(&self) -> f32 {
        let radius = 0.5 * (self.bounds.max - self.bounds.min).length();
        if radius > 0.0 { radius } else { 1.0 }
    }

    /// Extents of the bounding box, none of them 0.
    fn extent(&self) -> Vec3 {
        self.bounds.extent()
    }
}

// Materials.

impl Resolver<'_> {
    /// The material of a name. `base` is the one that the model has at the place, for materials that start from it.
    ///
    /// # Errors
    ///
    /// There is no such material, or one of its textures cannot be made.
    pub fn material(&mut self, name: &str, base: &LookMaterial) -> Made<LookMaterial> {
        let Some(table) = self.file.look().materials.get(name) else {
            let known = self.file.look().materials.keys().cloned().collect();
            let problem =
                LookProblem::Undefined { what: "material", name: name.to_owned(), nearest: None, known };
            return self.refuse(&Key::default(), problem);
        };
        self.material_of(table, &Key::of(["materials", name]), base)
    }

    fn material_of(&mut self, table: &MaterialTable, key: &Key, base: &LookMaterial) -> Made<LookMaterial> {
        let mut material = match table.from {
            MaterialBase::Default => LookMaterial::default(),
            MaterialBase::Model => base.clone(),
        };
        self.slots(table, key, &mut material)?;
        if let Some(lighting) = table.lighting {
            material.lighting = match lighting {
                LightingName::MetallicRoughness => LightingModel::MetallicRoughness,
                LightingName::BlinnPhong => LightingModel::BlinnPhong,
                LightingName::Unlit => LightingModel::Unlit,
            };
        }
        if let Some(color_use) = table.color_use {
            material.color_use = match color_use {
                ColorUseName::APriori => ColorUse::APriori,
                ColorUseName::Modulate => ColorUse::Modulate,
                ColorUseName::Replace => ColorUse::Replace,
            };
        }
        if let Some(opacity) = table.opacity {
            material.opacity = match opacity {
                OpacityName::Opaque => Opacity::Opaque,
                OpacityName::Mask => Opacity::Mask { threshold: table.threshold as f32 },
                OpacityName::Blend => Opacity::Blend,
            };
        }
        if let Some(toon) = &table.toon {
            let ramp = self::ramp(&toon.stops, toon.interpolation);
            material.toon = Some(Arc::new(self.accept(&key.name("toon").name("stops"), ramp)?));
        }
        if let Some(anisotropy) = &table.anisotropy {
            material.anisotropy = Some(self.anisotropy(anisotropy, &key.name("anisotropy"))?);
        }
        material.double_sided = table.double_sided.unwrap_or(material.double_sided);
        self.relief(table, key, &mut material.relief)?;
        Ok(material)
    }

    fn slots(&mut self, table: &MaterialTable, key: &Key, material: &mut LookMaterial) -> Made<()> {
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
        for (name, input, slot) in optional {
            if let Some(input) = input {
                *slot = Some(self.input(input, &key.name(name))?);
            }
        }
        Ok(())
    }

    /// What bends the normal: a normal map replaces the model's, bumps are added to what there is.
    fn relief(&mut self, table: &MaterialTable, key: &Key, relief: &mut Vec<Relief>) -> Made<()> {
        if let Some(map) = &table.normal_map {
            relief.retain(|r| !matches!(r, Relief::Normal { .. }));
            relief.insert(0, self.normal_map(map, &key.name("normal_map"))?);
        }
        if let Some(bump) = &table.bump {
            relief.push(Relief::Bump {
                texture: self.relief_texture(&bump.texture, &key.name("bump"))?,
                height: bump.height as f32,
                difference: match bump.difference {
                    DifferenceName::Forward => Difference::Forward,
                    DifferenceName::Backward => Difference::Backward,
                    DifferenceName::Central => Difference::Central,
                },
            });
        }
        if let Some(derivatives) = &table.derivatives {
            relief.push(Relief::Derivatives {
                texture: self.relief_texture(&derivatives.texture, &key.name("derivatives"))?,
                uv_set: derivatives.set as usize,
                height: derivatives.height as f32,
                range: derivatives.range as f32,
            });
        }
        Ok(())
    }

    fn normal_map(&mut self, table: &NormalMapTable, key: &Key) -> Made<Relief> {
        Ok(Relief::Normal {
            texture: self.relief_texture(&table.texture, key)?,
            scale: table.scale as f32,
            space: match table.space {
                NormalSpaceName::Tangent => NormalSpace::Tangent { uv_set: table.set as usize },
                NormalSpaceName::Object => NormalSpace::Object,
            },
        })
    }

    fn relief_texture(&mut self, input: &Input, key: &Key) -> Made<Arc<dyn Texture>> {
        Ok(match self.input(input, &key.name("texture"))? {
            Slot::Constant(value) => Arc::new(value),
            Slot::Texture(texture) => texture,
        })
    }

    fn anisotropy(&mut self, table: &AnisotropyTable, key: &Key) -> Made<Anisotropy> {
        Ok(Anisotropy {
            strength: self.input(&table.strength, &key.name("strength"))?,
            direction: self.input(&table.direction, &key.name("direction"))?,
            uv_set: table.set as usize,
        })
    }

    /// The height texture of a material's displacement, if it has one: red, times `height`, in world units.
    ///
    /// # Errors
    ///
    /// The texture cannot be made.
    pub fn displacement(&mut self, name: &str) -> Made<Option<Slot>> {
        let file = self.file;
        let table = file.look().materials.get(name).and_then(|m| m.displacement.as_ref());
        let key = Key::of(["materials", name, "displacement", "texture"]);
        table.map(|table| self.input(&table.texture, &key)).transpose()
    }
}
