//! From the tables of a look to textures and materials.
//!
//! ```text
//! TextureTable --texture--> Arc<dyn Texture>   (each once, in any order: the file knows no circles)
//! MaterialTable --material--> LookMaterial     (what is left out comes from the default or from the model's material)
//! ```

mod combined;
mod convert;
mod coordinates;
mod images;
mod material;
mod polygons;
mod procedural;
mod volumes;

use std::collections::BTreeMap;
use std::sync::Arc;

use fantex_look::data::{FilterName, Input, TextureTable};
use fantex_look::{Key, LookError, LookFile, LookProblem};
use fantex_mesh::Mesh;
use glam::{Vec3, Vec4};

use crate::combine::{ScaleOffset, Swizzle};
use crate::look::Slot;
use crate::{Bounds, Filter, Texture};

pub use convert::{linear_color, linear_rgb};
pub use images::LookImages;

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
            slot = Slot::Texture(Arc::new(Swizzle::select(slot, convert::channel(channel))));
        }
        let scale = convert::factor(texture_use.factor);
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
        let of_picture = || self.options.filter.unwrap_or(convert::filter(self.file.look().picture.filter));
        name.map_or_else(of_picture, convert::filter)
    }
}

/// The bounding box of a mesh in object space: world units, the origin in the middle.
fn object_bounds(mesh: &Mesh) -> Bounds {
    let scale = mesh.world_from_mesh.scale as f32;
    let first = mesh.positions.first().copied().unwrap_or(Vec3::ZERO);
    let (min, max) = mesh.positions.iter().fold((first, first), |(min, max), &p| (min.min(p), max.max(p)));
    Bounds { min: min * scale, max: max * scale }
}
