//! Images, cubes, volumes and frames.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use fantex_look::data::{
    AlphaName, ColorSpaceName, CubeTable, DirectionName, FileName, ImageTable, RoomTable, WrapTable,
};
use fantex_look::{Key, LookProblem};
use fantex_mesh::ImageSource;

use super::convert::{self, vec3};
use super::{Made, Resolver};
use crate::coordinates::ImageLookup;
use crate::environment::{CubeTexture, DirectionSource, EnvironmentMap, EnvironmentProxy};
use crate::{AlphaUse, ColorSpace, Image, ImageTexture, LoadImageError, SampleOptions, Samples, Texture};

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
            wrap: wrap.each().map(convert::wrap),
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
