//! Textures of files: images, cubes, volumes, images that follow each other; and tabulations.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use fantex_base::{Aabb, Error, Result, counted};
use fantex_mesh::{ImageSource, Mesh};
use fantex_texture::coordinates::{ImageLookup, InSpace, NormalAxes, SpaceMatrix, TextureMatrix};
use fantex_texture::environment::{
    CubeTexture, DirectionSource, EnvironmentMap, EnvironmentProxy, PrefilteredEnvironment,
};
use fantex_texture::look::Slot;
use fantex_texture::material::read_image;
use fantex_texture::{
    AlphaUse, ByteOrder, ColorSpace, Filter, Filtering, FrameTexture, Image, ImageTexture, RawLayout,
    SampleOptions, Samples, ShadingPoint, Tabulation, Texture, Volume, VolumeFilter, VolumeLookup,
    VolumeOptions, VolumeTexture, Wrap,
};
use glam::{Mat4, Vec3, Vec4};

use super::{Node, Resolver};
use crate::data::{
    CubeTable, DirectionName, FileName, FrameImagesTable, ImageTable, RoomTable, TabulationTable,
    VolumeTable, WrapTable,
};
use crate::{Key, problem};

/// What the numbers of an image are taken for: the look decides, whatever the file claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct ImageUse {
    pub(crate) space: ColorSpace,
    pub(crate) alpha: AlphaUse,
    /// Texels are normals, and brought to unit length.
    pub(crate) is_normals: bool,
}

impl ImageUse {
    fn texture(self, image: Image) -> Arc<ImageTexture> {
        let is_fixed_point = !matches!(image.samples, Samples::F32(_));
        let image = if is_fixed_point { Image { space: self.space, ..image } } else { image };
        let image = if self.is_normals { image.with_unit_normals() } else { image };
        Arc::new(ImageTexture::with_alpha_use(Arc::new(image), self.alpha))
    }
}

/// Images that have been read, so that several models share them, and the surroundings that were asked for last.
#[derive(Debug, Default)]
pub struct LookImages {
    textures: Mutex<HashMap<(PathBuf, ImageUse), Arc<ImageTexture>>>,
    environment: Mutex<Option<(String, Arc<PrefilteredEnvironment>)>>,
}

impl LookImages {
    fn file(&self, path: PathBuf, image_use: ImageUse) -> Result<Arc<ImageTexture>> {
        let key = (path, image_use);
        let files = || self.textures.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(texture) = files().get(&key) {
            return Ok(Arc::clone(texture));
        }
        // Others may read meanwhile.
        let texture = image_use.texture(Image::load_as(&key.0, image_use.space)?);
        Ok(Arc::clone(files().entry(key).or_insert(texture)))
    }

    /// Surroundings ready for lighting. They are made where those that were asked for last have another name; none are kept where none are
    /// made.
    ///
    /// # Errors
    /// Those of making them.
    pub fn environment(
        &self,
        name: String,
        make: impl FnOnce() -> Result<Option<EnvironmentMap>>,
    ) -> Result<Option<Arc<PrefilteredEnvironment>>> {
        let last = || self.environment.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, environment)) = last().as_ref().filter(|(known, _)| *known == name) {
            return Ok(Some(Arc::clone(environment)));
        }
        // Others may read meanwhile.
        let Some(map) = make()? else { return Ok(None) };
        let environment = Arc::new(PrefilteredEnvironment::new(Arc::new(map)));
        *last() = Some((name, Arc::clone(&environment)));
        Ok(Some(environment))
    }

    pub(crate) fn of_model(&self, source: &ImageSource, image_use: ImageUse) -> Result<Arc<ImageTexture>> {
        match source {
            ImageSource::File(path) => self.file(path.clone(), image_use),
            ImageSource::Embedded { .. } | ImageSource::Packed(_) | ImageSource::Bump(_) => {
                Ok(image_use.texture(read_image(source, image_use.space)?))
            }
        }
    }
}

pub(crate) type ModelImages = HashMap<(usize, ImageUse), Arc<ImageTexture>>;

impl Resolver<'_> {
    /// `is_normals`: whether a normal map is made of it.
    pub(super) fn image(&mut self, table: &ImageTable, is_normals: bool, key: &Key) -> Result<Node> {
        let image_use = ImageUse { space: table.color_space, alpha: table.alpha, is_normals };
        let mut texture = match (&table.image, table.model_image) {
            (Some(_), Some(_)) => return self.refuse(key, problem::exclusive("image", "model_image")),
            (None, None) => return self.refuse(key, problem::one_needed(&["image", "model_image"])),
            (Some(name), None) => self.image_file(name, image_use, &key.name("image"))?,
            (None, Some(index)) => self.model_image(index, image_use, &key.name("model_image"))?,
        };
        if table.border.0 != Vec4::ZERO {
            texture = Arc::new(texture.with_border(table.border.0.to_array()));
        }
        let options = self.sample_options(table.wrap, table.filter);
        Ok(Arc::new(ImageLookup {
            texture,
            coordinates: self.coordinates(&table.coordinates, &key.name("coordinates"))?,
            matrix: self.accept(&key.name("matrix"), TextureMatrix::new(table.matrix))?,
            options: SampleOptions { max_anisotropy: table.max_anisotropy, ..options },
            square_texels: table.square_texels,
            blur: table.blur,
        }))
    }

    fn sample_options(&self, wrap: WrapTable, filter: Option<Filter>) -> SampleOptions {
        SampleOptions { wrap: wrap.each(), filter: self.filter(filter), ..SampleOptions::default() }
    }

    fn image_file(&self, name: &FileName, image_use: ImageUse, key: &Key) -> Result<Arc<ImageTexture>> {
        self.accept(key, self.images.file(self.file.file(name), image_use))
    }

    fn model_image(&mut self, index: u32, image_use: ImageUse, key: &Key) -> Result<Arc<ImageTexture>> {
        if let Some(texture) = self.model_images.get(&(index as usize, image_use)) {
            return Ok(Arc::clone(texture));
        }
        let Some(Mesh { images, .. }) = self.mesh else {
            let sentence = "this image belongs to a model, and there is none here";
            return self.refuse(key, Error::malformed(sentence));
        };
        let Some(source) = images.get(index as usize) else {
            let count = counted(images.len(), "image");
            let sentence = format!("the model has {count}, so there is no image {index}; the first is 0");
            return self.refuse(key, Error::malformed(sentence));
        };
        let texture = self.accept(key, self.images.of_model(source, image_use))?;
        self.model_images.insert((index as usize, image_use), Arc::clone(&texture));
        Ok(texture)
    }

    pub(super) fn cube(&mut self, table: &CubeTable, key: &Key) -> Result<Node> {
        let map = match (&table.image, &table.faces) {
            (Some(_), Some(_)) => return self.refuse(key, problem::exclusive("image", "faces")),
            (None, None) => return self.refuse(key, problem::one_needed(&["image", "faces"])),
            (Some(name), None) => {
                self.accept(&key.name("image"), EnvironmentMap::load(self.file.file(name)))?
            }
            (None, Some(names)) => {
                let paths = names.each_ref().map(|name| self.file.file(name));
                let map = EnvironmentMap::load_faces(paths.each_ref().map(PathBuf::as_path));
                self.accept(&key.name("faces"), map)?
            }
        };
        let source = match table.direction {
            DirectionName::Reflection => DirectionSource::Reflection,
            DirectionName::Normal => DirectionSource::Normal,
            DirectionName::Position => DirectionSource::Position { center: table.center },
            DirectionName::View => DirectionSource::View,
        };
        let proxy = table.room.as_ref().map(|room| self.room(room, &key.name("room"))).transpose()?;
        Ok(Arc::new(CubeTexture {
            rotation_degrees: table.rotation,
            proxy: proxy.map(|proxy| (proxy, table.center)),
            ..CubeTexture::new(Arc::new(map), source)
        }))
    }

    fn room(&self, table: &RoomTable, key: &Key) -> Result<EnvironmentProxy> {
        match (table.radius, table.min, table.max) {
            (Some(radius), None, None) => Ok(EnvironmentProxy::Ball { center: table.center, radius }),
            (None, Some(min), Some(max)) => {
                Ok(EnvironmentProxy::Box { min: Vec3::from_array(min), max: Vec3::from_array(max) })
            }
            (None, ..) => self.refuse(key, problem::one_needed(&["radius", "min and max"])),
            (Some(_), ..) => self.refuse(key, problem::exclusive("radius", "min and max")),
        }
    }

    pub(super) fn volume(&mut self, table: &VolumeTable, key: &Key) -> Result<Node> {
        let volume = self.read_volume(table, key)?;
        let proportions = volume.extent() * (2.0 / volume.extent().max_element());
        let extent =
            table.extent.map_or(proportions, |extent| Vec3::from_array(extent.map(|length| length.0)));
        let options = VolumeOptions { wrap: [table.wrap; 3], filter: VolumeFilter::Mipmapped };
        let lookup = VolumeLookup { texture: Arc::new(VolumeTexture::new(Arc::new(volume))), options };
        let in_unit = Slot::Texture(self.in_box(lookup, Vec3::ZERO, extent, key)?);
        self.in_space(in_unit, &table.place, key)
    }

    fn read_volume(&self, table: &VolumeTable, key: &Key) -> Result<Volume> {
        let memory = self.options.memory_bytes;
        match (&table.meta_image, &table.raw, table.slices.as_slice()) {
            (Some(name), None, []) => {
                let volume = Volume::load_meta_image(self.file.file(name), memory);
                self.accept(&key.name("meta_image"), volume)
            }
            (None, Some(name), []) => {
                let Some(size) = table.size else {
                    return self.refuse(key, problem::missing_key("size"));
                };
                let layout = RawLayout {
                    size: size.map(|side| side.0),
                    channels: table.channels as u8,
                    depth: table.format,
                    byte_order: ByteOrder::Little,
                    space: ColorSpace::Linear,
                    skip: 0,
                };
                self.accept(&key.name("raw"), Volume::load_raw(self.file.file(name), &layout, memory))
            }
            (None, None, [_, ..]) => {
                let paths: Vec<PathBuf> = table.slices.iter().map(|name| self.file.file(name)).collect();
                self.accept(&key.name("slices"), Volume::load_slices(&paths, table.color_space, memory))
            }
            (None, None, []) => self.refuse(key, problem::one_needed(&["meta_image", "raw", "slices"])),
            (Some(_), Some(_), _) => self.refuse(key, problem::exclusive("meta_image", "raw")),
            (Some(_), ..) => self.refuse(key, problem::exclusive("meta_image", "slices")),
            (_, Some(_), _) => self.refuse(key, problem::exclusive("raw", "slices")),
        }
    }

    /// A texture of the unit cube, over a box of object space.
    fn in_box(&self, texture: impl Texture + 'static, center: Vec3, extent: Vec3, key: &Key) -> Result<Node> {
        let matrix = Mat4::from_translation(Vec3::splat(0.5))
            * Mat4::from_scale(extent.recip())
            * Mat4::from_translation(-center);
        let matrix = self.accept(key, SpaceMatrix::new(matrix))?;
        let input = Slot::Texture(Arc::new(texture));
        Ok(Arc::new(InSpace { input, matrix, normal_axes: NormalAxes::Object }))
    }

    /// The texture's values on a grid over a box.
    pub(super) fn tabulation(&mut self, table: &TabulationTable, key: &Key) -> Result<Node> {
        let input = self.input(&table.texture, &key.name("texture"))?;
        let bounds = Aabb {
            min: table.min.map_or(self.bounds.min, Vec3::from_array),
            max: table.max.map_or(self.bounds.max, Vec3::from_array),
        };
        let (center, extent) = (bounds.center(), bounds.extent());
        let is_given = table.min.is_some() || table.max.is_some();
        let [least, most] = [Vec3::min_element, Vec3::max_element].map(|of| of(bounds.max - bounds.min));
        // Of a model that is a point, no box of its own is asked for.
        if is_given && !(least >= 0.0 && most > 0.0 && most.is_finite()) {
            let message = format!(
                "a box from {} to {} has nothing in it; min must lie below max",
                bounds.min, bounds.max
            );
            return self.refuse(key, Error::invalid(message));
        }
        let voxel = extent.max_element() / table.size as f32;
        let size = extent.to_array().map(|length| ((length / voxel).round() as u32).clamp(2, table.size));
        // Of a smooth table the outermost values lie on the box, so that none is continued within it; one that comes again goes on there
        // with the values of the other side. A flat box is as thick as a value.
        let spread = if table.smooth && matches!(table.wrap, Wrap::Clamp | Wrap::Border) {
            size.map(|n| n as f32 / (n - 1) as f32)
        } else {
            [1.0; 3]
        };
        let extent = extent.max(Vec3::splat(voxel)) * Vec3::from_array(spread);
        let grid = Tabulation { size, samples: 1, memory_bytes: self.options.memory_bytes };
        let texels = grid.texels(|at| {
            let position = center + (Vec3::from_array(at) - 0.5) * extent;
            input.evaluate(&solid_point(position, voxel)).to_array()
        });
        let samples = Samples::F32(self.accept(&key.name("size"), texels)?.into_flattened());
        let volume = self.accept(&key.name("size"), Volume::new(size, 4, ColorSpace::Linear, samples))?;
        let filter = if table.smooth { VolumeFilter::Mipmapped } else { VolumeFilter::Nearest };
        let options = VolumeOptions { wrap: [table.wrap; 3], filter };
        let lookup = VolumeLookup { texture: Arc::new(VolumeTexture::new(Arc::new(volume))), options };
        self.in_box(lookup, center, extent, key)
    }

    pub(super) fn frames(&mut self, table: &FrameImagesTable, key: &Key) -> Result<Node> {
        let coordinates = self.coordinates(&table.coordinates, &key.name("coordinates"))?;
        let matrix = self.accept(&key.name("matrix"), TextureMatrix::new(table.matrix))?;
        let options = self.sample_options(table.wrap, table.filter);
        let image_use = ImageUse { space: table.color_space, alpha: AlphaUse::Coverage, is_normals: false };
        let frames = table.images.iter().enumerate().map(|(index, name)| {
            let texture = self.image_file(name, image_use, &key.name("images").index(index))?;
            let coordinates = coordinates.clone();
            let lookup = ImageLookup { coordinates, matrix, options, ..ImageLookup::new(texture) };
            Ok(Slot::Texture(Arc::new(lookup)))
        });
        let frames = frames.collect::<Result<Vec<Slot>>>()?;
        let texture = FrameTexture::with_rate(frames, table.rate, table.after, table.blend);
        Ok(Arc::new(self.accept(key, texture)?))
    }
}

/// A point of space, as wide as a voxel, that lies on no surface.
fn solid_point(position: Vec3, width: f32) -> ShadingPoint<'static> {
    ShadingPoint {
        position,
        position_steps: [Vec3::X * width, Vec3::Y * width],
        normal: Vec3::Z,
        normal_steps: [Vec3::ZERO; 2],
        uv: &[],
        vertex_color: Vec4::ONE,
        eye: None,
        time: 0.0,
        filtering: Filtering::Area,
    }
}
