//! Textures of files: images, cubes, volumes, frames; and tabulations.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use fantex_look::data::{
    AfterName, AlphaName, ColorSpaceName, CubeTable, DirectionName, FileName, FrameImagesTable, ImageTable,
    RawFormatName, RoomTable, TabulationTable, VolumeTable, WrapTable,
};
use fantex_look::{Key, LookProblem};
use fantex_mesh::ImageSource;
use glam::{Mat4, Vec3};

use super::{Made, Resolver, vec3};
use crate::coordinates::{ImageLookup, InSpace, SpaceMatrix, SpaceMatrixOptions};
use crate::environment::{CubeTexture, DirectionSource, EnvironmentMap, EnvironmentProxy};
use crate::look::Slot;
use crate::{
    AlphaUse, ByteOrder, ColorSpace, Depth, Filtering, FrameTexture, FrameWrap, Image, ImageTexture,
    LoadImageError, RawLayout, SampleOptions, Samples, ShadingPoint, Tabulation, Texture, Volume,
    VolumeFilter, VolumeLookup, VolumeOptions, VolumeTexture, Wrap,
};

// Images, cubes, volumes and frames.

/// What distinguishes two ways of reading a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct FileUse {
    path: PathBuf,
    is_srgb: bool,
    alpha_is_coverage: bool,
}

/// Images that have been read, so that several models share them.
#[derive(Debug, Default)]
pub struct LookImages {
    files: Mutex<BTreeMap<FileUse, Arc<ImageTexture>>>,
}

impl LookImages {
    fn file(&self, file: FileUse) -> Result<Arc<ImageTexture>, LoadImageError> {
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(texture) = files.get(&file) {
            return Ok(Arc::clone(texture));
        }
        let space = color_space(file.is_srgb);
        let image = with_space(Image::load_as(&file.path, space)?, space);
        let texture =
            Arc::new(ImageTexture::with_alpha_use(Arc::new(image), alpha_use(file.alpha_is_coverage)));
        files.insert(file, Arc::clone(&texture));
        Ok(texture)
    }
}

fn color_space(is_srgb: bool) -> ColorSpace {
    if is_srgb { ColorSpace::Srgb } else { ColorSpace::Linear }
}

fn alpha_use(is_coverage: bool) -> AlphaUse {
    if is_coverage { AlphaUse::Coverage } else { AlphaUse::Independent }
}

/// The look decides what fixed-point numbers mean, whatever the file claims.
fn with_space(image: Image, space: ColorSpace) -> Image {
    if matches!(image.samples, Samples::F32(_)) { image } else { Image { space, ..image } }
}

impl Resolver<'_> {
    pub(super) fn image(&mut self, table: &ImageTable, key: &Key) -> Made<Arc<dyn Texture>> {
        let is_srgb = table.color_space == ColorSpaceName::Srgb;
        let alpha_is_coverage = table.alpha == AlphaName::Coverage;
        let texture = match (&table.image, table.model_image) {
            (Some(_), Some(_)) => return self.refuse(key, LookProblem::Exclusive("image", "model_image")),
            (None, None) => {
                let keys = vec!["image".to_owned(), "model_image".to_owned()];
                return self.refuse(key, LookProblem::OneNeeded(keys));
            }
            (Some(name), None) => self.image_file(name, is_srgb, alpha_is_coverage, &key.name("image"))?,
            (None, Some(index)) => {
                self.model_image(index, is_srgb, alpha_is_coverage, &key.name("model_image"))?
            }
        };
        let border = super::linear_color(table.border);
        let texture = if border == glam::Vec4::ZERO {
            texture
        } else {
            Arc::new(texture.with_border(border.to_array()))
        };
        let lookup = ImageLookup {
            texture,
            coordinates: self.coordinates(&table.coordinates, &key.name("coordinates"))?,
            matrix: self.matrix(&table.matrix, &key.name("matrix"))?,
            options: SampleOptions {
                max_anisotropy: table.max_anisotropy as f32,
                ..self.sample_options(table.wrap, table.filter)
            },
            square_texels: table.square_texels,
        };
        Ok(Arc::new(lookup))
    }

    pub(super) fn sample_options(
        &self,
        wrap: WrapTable,
        filter: Option<fantex_look::data::FilterName>,
    ) -> SampleOptions {
        SampleOptions {
            wrap: wrap.each().map(super::wrap),
            filter: self.filter(filter),
            ..SampleOptions::default()
        }
    }

    pub(super) fn image_file(
        &self,
        name: &FileName,
        is_srgb: bool,
        alpha_is_coverage: bool,
        key: &Key,
    ) -> Made<Arc<ImageTexture>> {
        let file = FileUse { path: self.file.file(name), is_srgb, alpha_is_coverage };
        self.accept(key, self.images.file(file))
    }

    fn model_image(
        &self,
        index: u32,
        is_srgb: bool,
        alpha_is_coverage: bool,
        key: &Key,
    ) -> Made<Arc<ImageTexture>> {
        let Some(mesh) = self.mesh else { return self.refuse(key, LookProblem::NoModel("this image")) };
        let count = mesh.images.len();
        match mesh.images.get(index as usize) {
            None => self.refuse(key, LookProblem::ModelImage { index, count }),
            Some(ImageSource::File(path)) => {
                let file = FileUse { path: path.clone(), is_srgb, alpha_is_coverage };
                self.accept(key, self.images.file(file))
            }
            Some(ImageSource::Embedded { label, bytes }) => {
                let space = color_space(is_srgb);
                let image = self.accept(key, Image::decode(bytes, label, space))?;
                let image = Arc::new(with_space(image, space));
                Ok(Arc::new(ImageTexture::with_alpha_use(image, alpha_use(alpha_is_coverage))))
            }
        }
    }

    pub(super) fn cube(&mut self, table: &CubeTable, key: &Key) -> Made<Arc<dyn Texture>> {
        let map = match (&table.image, &table.faces) {
            (Some(_), Some(_)) => return self.refuse(key, LookProblem::Exclusive("image", "faces")),
            (None, None) => {
                let keys = vec!["image".to_owned(), "faces".to_owned()];
                return self.refuse(key, LookProblem::OneNeeded(keys));
            }
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
            DirectionName::Position => DirectionSource::Position { center: vec3(table.center) },
            DirectionName::View => DirectionSource::View,
        };
        let rotation_degrees = table.rotation as f32;
        let proxy = table.room.as_ref().map(|room| self.room(room, &key.name("room"))).transpose()?;
        let proxy = proxy.map(|proxy| (proxy, vec3(table.center)));
        Ok(Arc::new(CubeTexture { rotation_degrees, proxy, ..CubeTexture::new(Arc::new(map), source) }))
    }

    fn room(&self, table: &RoomTable, key: &Key) -> Made<EnvironmentProxy> {
        match (table.radius, table.min, table.max) {
            (Some(radius), None, None) => {
                Ok(EnvironmentProxy::Ball { center: vec3(table.center), radius: radius as f32 })
            }
            (None, Some(min), Some(max)) => Ok(EnvironmentProxy::Box { min: vec3(min), max: vec3(max) }),
            (None, ..) => {
                self.refuse(key, LookProblem::OneNeeded(vec!["radius".into(), "min and max".into()]))
            }
            (Some(_), ..) => self.refuse(key, LookProblem::Exclusive("radius", "min and max")),
        }
    }
}

// Volumes, tabulations, and images that follow each other.

type Node = Arc<dyn Texture>;

impl Resolver<'_> {
    pub(super) fn volume(&mut self, table: &VolumeTable, key: &Key) -> Made<Node> {
        let volume = self.read_volume(table, key)?;
        let proportions = volume.extent() * (2.0 / volume.extent().max_element());
        let extent = table.extent.map_or(proportions, |extent| vec3(extent.map(|length| length.0)));
        let options = VolumeOptions { wrap: [super::wrap(table.wrap); 3], filter: VolumeFilter::Mipmapped };
        let lookup = VolumeLookup { texture: Arc::new(VolumeTexture::new(Arc::new(volume))), options };
        let in_unit = self.in_box(lookup, Vec3::ZERO, extent, key)?;
        Ok(Arc::new(InSpace { input: in_unit, matrix: self.place(&table.place, &key.name("place"))? }))
    }

    fn read_volume(&self, table: &VolumeTable, key: &Key) -> Made<Volume> {
        let memory = self.options.memory_bytes;
        let space = color_space(table.color_space == ColorSpaceName::Srgb);
        match (&table.meta_image, &table.raw, table.slices.as_slice()) {
            (Some(name), None, []) => {
                let volume = Volume::load_meta_image(self.file.file(name), memory);
                self.accept(&key.name("meta_image"), volume)
            }
            (None, Some(name), []) => {
                let Some(size) = table.size else {
                    return self.refuse(key, LookProblem::MissingKey("size".into()));
                };
                let layout = RawLayout {
                    size: size.map(|side| side.0),
                    channels: table.channels as u8,
                    depth: match table.format {
                        RawFormatName::U8 => Depth::U8,
                        RawFormatName::U16 => Depth::U16,
                        RawFormatName::F32 => Depth::F32,
                    },
                    byte_order: ByteOrder::Little,
                    space: ColorSpace::Linear,
                    skip: 0,
                };
                self.accept(&key.name("raw"), Volume::load_raw(self.file.file(name), &layout, memory))
            }
            (None, None, [_, ..]) => {
                let paths: Vec<PathBuf> = table.slices.iter().map(|name| self.file.file(name)).collect();
                self.accept(&key.name("slices"), Volume::load_slices(&paths, space, memory))
            }
            (None, None, []) => {
                let keys = ["meta_image", "raw", "slices"].map(str::to_owned).to_vec();
                self.refuse(key, LookProblem::OneNeeded(keys))
            }
            (Some(_), Some(_), _) => self.refuse(key, LookProblem::Exclusive("meta_image", "raw")),
            (Some(_), ..) => self.refuse(key, LookProblem::Exclusive("meta_image", "slices")),
            (_, Some(_), _) => self.refuse(key, LookProblem::Exclusive("raw", "slices")),
        }
    }

    /// A texture of the unit cube, over a box of object space.
    fn in_box(&self, texture: impl Texture + 'static, center: Vec3, extent: Vec3, key: &Key) -> Made<Slot> {
        let matrix = Mat4::from_translation(Vec3::splat(0.5))
            * Mat4::from_scale(extent.recip())
            * Mat4::from_translation(-center);
        let options = SpaceMatrixOptions { matrix, ..SpaceMatrixOptions::default() };
        let matrix = self.accept(key, SpaceMatrix::new(options))?;
        Ok(Slot::Texture(Arc::new(InSpace { input: Slot::Texture(Arc::new(texture)), matrix })))
    }

    /// The texture's values on a grid over the model's bounding box.
    pub(super) fn tabulation(&mut self, table: &TabulationTable, key: &Key) -> Made<Node> {
        let input = self.input(&table.texture, &key.name("texture"))?;
        let (center, extent) = (self.bounds.center(), self.extent());
        let voxel = extent.max_element() / table.size as f32;
        let size = extent.to_array().map(|length| ((length / voxel).round() as u32).clamp(2, table.size));
        let grid = Tabulation { size, samples: 1, memory_bytes: self.options.memory_bytes };
        let texels = grid.texels(|at| {
            let position = center + (Vec3::from_array(at) - 0.5) * extent;
            input.evaluate(&solid_point(position, voxel)).to_array()
        });
        let samples = Samples::F32(self.accept(&key.name("size"), texels)?.as_flattened().to_vec());
        let volume = self.accept(&key.name("size"), Volume::new(size, 4, ColorSpace::Linear, samples))?;
        let filter = if table.smooth { VolumeFilter::Mipmapped } else { VolumeFilter::Nearest };
        let options = VolumeOptions { wrap: [Wrap::Clamp; 3], filter };
        let lookup = VolumeLookup { texture: Arc::new(VolumeTexture::new(Arc::new(volume))), options };
        Ok(match self.in_box(lookup, center, extent, key)? {
            Slot::Texture(texture) => texture,
            Slot::Constant(value) => Arc::new(value),
        })
    }

    pub(super) fn frames(&mut self, table: &FrameImagesTable, key: &Key) -> Made<Node> {
        let coordinates = self.coordinates(&table.coordinates, &key.name("coordinates"))?;
        let matrix = self.matrix(&table.matrix, &key.name("matrix"))?;
        let options = self.sample_options(table.wrap, table.filter);
        let is_srgb = table.color_space == ColorSpaceName::Srgb;
        let frames = table.images.iter().enumerate().map(|(index, name)| {
            let texture = self.image_file(name, is_srgb, true, &key.name("images").index(index))?;
            let (coordinates, square_texels) = (coordinates.clone(), false);
            let lookup = ImageLookup { texture, coordinates, matrix, options, square_texels };
            Ok(Slot::Texture(Arc::new(lookup)))
        });
        let frames = frames.collect::<Made<Vec<Slot>>>()?;
        let wrap = match table.after {
            AfterName::Repeat => FrameWrap::Repeat,
            AfterName::Hold => FrameWrap::Hold,
            AfterName::Mirror => FrameWrap::Mirror,
        };
        let texture = FrameTexture::with_rate(frames, table.rate as f32, wrap, table.blend);
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
        vertex_color: glam::Vec4::ONE,
        to_eye: None,
        time: 0.0,
        filtering: Filtering::Area,
    }
}
