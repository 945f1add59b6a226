//! Volumes from files: MetaImage and raw numbers.
//!
//! Sizes are checked against the memory limit before anything is allocated, and against the file's length before it is read.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::error::LoadVolumeError;
use super::meta_image::{self, DataFile, Header, MAX_HEADER_BYTES};
use super::{Volume, checked_samples, levels, sample_bytes};
use crate::{ColorSpace, Depth, Image, Samples};

/// The order of a number's bytes in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ByteOrder {
    /// The lowest first.
    #[default]
    Little,
    /// The highest first.
    Big,
}

/// How the numbers of a volume lie in a file: x fastest, then y, then z, channels interleaved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Voxels along x, y and z.
    pub size: [u32; 3],
    /// Numbers per voxel, 1 to 4.
    pub channels: u8,
    /// Width of a number.
    pub depth: Depth,
    /// Order of its bytes.
    pub byte_order: ByteOrder,
    /// Encoding of the colour channels.
    pub space: ColorSpace,
    /// Bytes before the first number.
    pub skip: u64,
}

impl RawLayout {
    /// Bytes of the numbers.
    fn byte_len(&self) -> u64 {
        self.size.iter().map(|&side| u64::from(side)).product::<u64>()
            * u64::from(self.channels)
            * sample_bytes(self.depth)
    }
}

impl Volume {
    /// Reads a MetaImage file: `.mhd` with the numbers in a file beside it, or `.mha` with the numbers at its end. Elements
    /// are `MET_UCHAR`, `MET_USHORT` or `MET_FLOAT`, uncompressed, one to four channels; they are taken as linear.
    ///
    /// # Errors
    ///
    /// A file cannot be read, is damaged or of another kind, or the volume with its levels would take more than
    /// `memory_bytes`.
    pub fn load_meta_image(path: impl AsRef<Path>, memory_bytes: u64) -> Result<Self, LoadVolumeError> {
        let path = path.as_ref();
        let mut start = Vec::new();
        let opened = File::open(path).and_then(|f| f.take(MAX_HEADER_BYTES as u64).read_to_end(&mut start));
        opened.map_err(|source| LoadVolumeError::Read { path: path.to_owned(), source })?;
        let Header { mut layout, spacing, data, is_at_end } = meta_image::parse(&start, path)?;
        let data_path = match &data {
            DataFile::Local(first) => {
                layout.skip = layout.skip.saturating_add(*first);
                path
            }
            DataFile::Beside(beside) => beside,
        };
        Ok(load(data_path, layout, is_at_end, memory_bytes)?.with_spacing(spacing))
    }

    /// Reads images of one size and kind as slices, the first at the lowest z; `space` is what 8- and 16-bit samples mean.
    ///
    /// # Errors
    ///
    /// There is no image, one cannot be read or differs from the first, or the volume with its levels would take more than
    /// `memory_bytes`.
    pub fn load_slices(
        paths: &[impl AsRef<Path>],
        space: ColorSpace,
        memory_bytes: u64,
    ) -> Result<Self, LoadVolumeError> {
        let mut slices: Vec<Image> = Vec::new();
        for (index, path) in paths.iter().enumerate() {
            let slice_error = |source| LoadVolumeError::Slice { index, source };
            let slice = Image::load_as(path, space).map_err(slice_error)?;
            let size = [slice.width, slice.height, u32::try_from(paths.len()).unwrap_or(u32::MAX)];
            let needed = levels::bytes_with_levels(size, slice.channels, slice.samples.depth());
            if needed > memory_bytes {
                let path = path.as_ref().to_owned();
                return Err(LoadVolumeError::Memory { path, needed, limit: memory_bytes });
            }
            slices.push(slice);
        }
        Ok(Self::from_slices(&slices)?)
    }

    /// Reads a file of plain numbers.
    ///
    /// # Errors
    ///
    /// The size is impossible, the file cannot be read or is too short, or the volume with its levels would take more than
    /// `memory_bytes`.
    pub fn load_raw(
        path: impl AsRef<Path>,
        layout: &RawLayout,
        memory_bytes: u64,
    ) -> Result<Self, LoadVolumeError> {
        load(path.as_ref(), *layout, false, memory_bytes)
    }
}

fn load(
    path: &Path,
    layout: RawLayout,
    is_at_end: bool,
    memory_bytes: u64,
) -> Result<Volume, LoadVolumeError> {
    let size_error = |source| LoadVolumeError::Size { path: path.to_owned(), source };
    checked_samples(layout.size, layout.channels).map_err(size_error)?;
    let needed = levels::bytes_with_levels(layout.size, layout.channels, layout.depth);
    if needed > memory_bytes {
        return Err(LoadVolumeError::Memory { path: path.to_owned(), needed, limit: memory_bytes });
    }
    let read_error = |source| LoadVolumeError::Read { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(read_error)?;
    let length = file.metadata().map_err(read_error)?.len();
    let skip = if is_at_end { length.saturating_sub(layout.byte_len()) } else { layout.skip };
    let expected = layout.byte_len().saturating_add(skip);
    if expected > length {
        return Err(LoadVolumeError::Truncated { path: path.to_owned(), expected, got: length });
    }
    file.seek(SeekFrom::Start(skip)).map_err(read_error)?;
    let samples = read_samples(&mut file, &layout).map_err(read_error)?;
    Volume::new(layout.size, layout.channels, layout.space, samples).map_err(size_error)
}

fn read_samples(file: &mut File, layout: &RawLayout) -> io::Result<Samples> {
    let byte_len = layout.byte_len() as usize;
    let is_native = (layout.byte_order == ByteOrder::Little) == cfg!(target_endian = "little");
    Ok(match layout.depth {
        Depth::U8 => {
            let mut values = vec![0_u8; byte_len];
            file.read_exact(&mut values)?;
            Samples::U8(values)
        }
        Depth::U16 => {
            let mut values = vec![0_u16; byte_len / 2];
            file.read_exact(bytemuck::cast_slice_mut(&mut values))?;
            if !is_native {
                values.iter_mut().for_each(|value| *value = value.swap_bytes());
            }
            Samples::U16(values)
        }
        Depth::F32 => {
            let mut values = vec![0.0_f32; byte_len / 4];
            file.read_exact(bytemuck::cast_slice_mut(&mut values))?;
            for value in &mut values {
                if !is_native {
                    *value = f32::from_bits(value.to_bits().swap_bytes());
                }
                // One such number would spread over all coarser levels.
                if !value.is_finite() {
                    *value = 0.0;
                }
            }
            Samples::F32(values)
        }
    })
}
