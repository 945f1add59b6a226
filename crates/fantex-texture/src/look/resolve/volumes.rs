//! Volumes, tabulations, and images that follow each other.

use std::path::PathBuf;
use std::sync::Arc;

use fantex_look::data::{
    AfterName, ColorSpaceName, FrameImagesTable, RawFormatName, TabulationTable, VolumeTable,
};
use fantex_look::{Key, LookProblem};
use glam::{Mat4, Vec3};

use super::convert::{self, vec3};
use super::{Made, Resolver};
use crate::coordinates::{ImageLookup, InSpace, SpaceMatrix, SpaceMatrixOptions};
use crate::look::Slot;
use crate::{
    ByteOrder, ColorSpace, Depth, Filtering, FrameTexture, FrameWrap, RawLayout, Samples, ShadingPoint,
    Tabulation, Texture, Volume, VolumeFilter, VolumeLookup, VolumeOptions, VolumeTexture, Wrap,
};

type Node = Arc<dyn Texture>;

impl Resolver<'_> {
    pub(super) fn volume(&mut self, table: &VolumeTable, key: &Key) -> Made<Node> {
        let volume = self.read_volume(table, key)?;
        let proportions = volume.extent() * (2.0 / volume.extent().max_element());
        let extent = table.extent.map_or(proportions, |extent| vec3(extent.map(|length| length.0)));
        let options = VolumeOptions { wrap: [convert::wrap(table.wrap); 3], filter: VolumeFilter::Mipmapped };
        let lookup = VolumeLookup { texture: Arc::new(VolumeTexture::new(Arc::new(volume))), options };
        let in_unit = self.in_box(lookup, Vec3::ZERO, extent, key)?;
        Ok(Arc::new(InSpace { input: in_unit, matrix: self.place(&table.place, &key.name("place"))? }))
    }

    fn read_volume(&self, table: &VolumeTable, key: &Key) -> Made<Volume> {
        let memory = self.options.memory_bytes;
        let space = color_space(table.color_space);
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

fn color_space(name: ColorSpaceName) -> ColorSpace {
    match name {
        ColorSpaceName::Srgb => ColorSpace::Srgb,
        ColorSpaceName::Linear => ColorSpace::Linear,
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
