//! Volumes from files: MetaImage and raw numbers.
//!
//! Sizes are checked against the memory limit before anything is allocated, and against the file's length before it is read.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::{fmt, io};

use glam::Vec3;

use super::{MAX_VOLUME_SIDE, Volume, bytes_with_levels, checked_samples, sample_bytes};
use crate::{ColorSpace, Depth, Image, LoadImageError, Samples};

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
        let Header { mut layout, spacing, data, is_at_end } = parse(&start, path)?;
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
            let needed = bytes_with_levels(size, slice.channels, slice.samples.depth());
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
    let needed = bytes_with_levels(layout.size, layout.channels, layout.depth);
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

// ---- What is wrong with a volume.

/// Sizes that no volume has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VolumeSizeError {
    /// A side or the number of channels is out of range.
    #[error(
        "a volume of {} x {} x {} voxels with {channels} channels is not possible: each side must be 1 to \
         {MAX_VOLUME_SIDE}, the channels 1 to 4",
        .size[0], .size[1], .size[2]
    )]
    Size {
        /// Voxels along x, y and z.
        size: [u32; 3],
        /// Numbers per voxel.
        channels: u8,
    },
    /// The samples do not fit the size.
    #[error(
        "a volume of {} x {} x {} voxels with {channels} channels takes {expected} numbers, not {got}",
        .size[0], .size[1], .size[2]
    )]
    Samples {
        /// Voxels along x, y and z.
        size: [u32; 3],
        /// Numbers per voxel.
        channels: u8,
        /// How many there must be.
        expected: u64,
        /// How many there are.
        got: u64,
    },
    /// There is no image to stack.
    #[error("a volume needs at least one slice")]
    NoSlices,
    /// An image differs from the first.
    #[error("slice {index} of the volume differs from slice 0 in size, channels or depth; all must be equal")]
    UnequalSlices {
        /// Which one, from 0.
        index: usize,
    },
}

/// Why a volume could not be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadVolumeError {
    /// The file could not be read.
    #[error("cannot read volume '{path}': {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The header is no MetaImage header, or one of a variant that is not supported.
    #[error("'{path}', line {line}: {fault}")]
    Header {
        /// The header's file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        fault: HeaderFault,
    },
    /// An image of a stack could not be read.
    #[error("slice {index} of a volume: {source}")]
    Slice {
        /// Which one, from 0.
        index: usize,
        /// What is wrong with it.
        source: LoadImageError,
    },
    /// The images of a stack do not fit together.
    #[error("the slices of a volume do not fit: {0}")]
    Slices(#[from] VolumeSizeError),
    /// The size is impossible.
    #[error("'{path}': {source}")]
    Size {
        /// The file.
        path: PathBuf,
        /// Which rule it breaks.
        source: VolumeSizeError,
    },
    /// The file of numbers is too short.
    #[error("'{path}' ends after {got} bytes; the volume needs {expected}")]
    Truncated {
        /// The file of numbers.
        path: PathBuf,
        /// Bytes needed, with what is skipped.
        expected: u64,
        /// Bytes there are.
        got: u64,
    },
    /// Reading would take too much memory.
    #[error(
        "'{path}' would take {needed} bytes of memory with its levels, {limit} are allowed; raise the limit or scale the volume down"
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes of the voxels and all coarser levels.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
}

/// What is wrong in a header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HeaderFault {
    /// A line is no `Key = value`, or the file is no text.
    NoEntry,
    /// A value that must be something else.
    Value {
        /// The key.
        key: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        got: String,
    },
    /// A key that must be there.
    Missing {
        /// The key.
        key: &'static str,
    },
}

impl fmt::Display for HeaderFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoEntry => f.write_str("a MetaImage header has lines like 'DimSize = 64 64 64'"),
            Self::Value { key, expected, got } => write!(f, "{key} is '{got}'; it must be {expected}"),
            Self::Missing { key } => write!(f, "the header ends without {key}"),
        }
    }
}

// ---- The header of MetaImage files (`.mhd`, `.mha`): lines of `Key = value`, the last of which names the file of the numbers.

/// Longest header that is looked at; real ones have a few hundred bytes.
pub(super) const MAX_HEADER_BYTES: usize = 1 << 16;

/// Where the numbers are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum DataFile {
    /// In the header's own file, from this byte on.
    Local(u64),
    /// In a file beside it.
    Beside(PathBuf),
}

/// What a header says.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    pub(super) layout: RawLayout,
    pub(super) spacing: Vec3,
    pub(super) data: DataFile,
    /// Whether the numbers are the last ones of the file, whatever comes before.
    pub(super) is_at_end: bool,
}

/// Reads the entries of `bytes`, the beginning of the file at `path`.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Header, LoadVolumeError> {
    let mut header = Header {
        layout: RawLayout {
            size: [0; 3],
            channels: 1,
            depth: Depth::U8,
            byte_order: ByteOrder::Little,
            space: ColorSpace::Linear,
            skip: 0,
        },
        spacing: Vec3::ONE,
        data: DataFile::Local(0),
        is_at_end: false,
    };
    let (mut has_size, mut has_type) = (false, false);
    let mut start = 0;
    for (index, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let fail = |fault| LoadVolumeError::Header { path: path.to_owned(), line: index + 1, fault };
        start += line.len() + 1;
        let text = std::str::from_utf8(line).map_err(|_| fail(HeaderFault::NoEntry))?.trim();
        if text.is_empty() {
            continue;
        }
        let (key, value) = text.split_once('=').ok_or_else(|| fail(HeaderFault::NoEntry))?;
        let (key, value) = (key.trim(), value.trim());
        has_size |= key == "DimSize";
        has_type |= key == "ElementType";
        if key == "ElementDataFile" {
            let missing =
                [("DimSize", has_size), ("ElementType", has_type)].into_iter().find(|(_, has)| !has);
            if let Some((key, _)) = missing {
                return Err(fail(HeaderFault::Missing { key }));
            }
            header.data = data_file(value, start as u64, path).map_err(fail)?;
            return Ok(header);
        }
        header.read(key, value).map_err(fail)?;
    }
    let line = bytes.iter().filter(|&&byte| byte == b'\n').count() + 1;
    let fault = HeaderFault::Missing { key: "ElementDataFile" };
    Err(LoadVolumeError::Header { path: path.to_owned(), line, fault })
}

impl Header {
    /// Takes in an entry; those that say nothing about the numbers are passed over.
    fn read(&mut self, key: &str, value: &str) -> Result<(), HeaderFault> {
        let wrong = |key, expected| HeaderFault::Value { key, expected, got: value.to_owned() };
        match key {
            "NDims" if value != "3" => Err(wrong("NDims", "3")),
            "DimSize" => {
                let sizes = numbers(value).ok_or_else(|| wrong("DimSize", "three whole numbers above 0"))?;
                self.layout.size = sizes;
                Ok(())
            }
            "ElementSpacing" | "ElementSize" => {
                let spacing =
                    numbers(value).map(Vec3::from_array).filter(|s| s.is_finite() && s.min_element() > 0.0);
                self.spacing = spacing.ok_or_else(|| wrong("ElementSpacing", "three numbers above 0"))?;
                Ok(())
            }
            "ElementNumberOfChannels" => {
                let channels = value.parse().ok().filter(|count| (1..=4).contains(count));
                self.layout.channels = channels.ok_or_else(|| wrong("ElementNumberOfChannels", "1 to 4"))?;
                Ok(())
            }
            "ElementType" => {
                self.layout.depth = match value {
                    "MET_UCHAR" => Depth::U8,
                    "MET_USHORT" => Depth::U16,
                    "MET_FLOAT" => Depth::F32,
                    _ => return Err(wrong("ElementType", "MET_UCHAR, MET_USHORT or MET_FLOAT")),
                };
                Ok(())
            }
            "ElementByteOrderMSB" | "BinaryDataByteOrderMSB" => {
                let is_big = truth(value).ok_or_else(|| wrong("ElementByteOrderMSB", "True or False"))?;
                self.layout.byte_order = if is_big { ByteOrder::Big } else { ByteOrder::Little };
                Ok(())
            }
            "BinaryData" if truth(value) != Some(true) => Err(wrong("BinaryData", "True")),
            "CompressedData" if truth(value) != Some(false) => {
                Err(wrong("CompressedData", "False; unpack the file first"))
            }
            "HeaderSize" => {
                let skip = value.parse::<i64>().ok().filter(|&skip| skip >= -1);
                let skip = skip.ok_or_else(|| wrong("HeaderSize", "-1 or a number of bytes"))?;
                self.is_at_end = skip == -1;
                self.layout.skip = skip.max(0) as u64;
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

fn data_file(value: &str, start: u64, path: &Path) -> Result<DataFile, HeaderFault> {
    const EXPECTED: &str = "LOCAL or the name of one file with all numbers";
    if value == "LOCAL" {
        return Ok(DataFile::Local(start));
    }
    // A list of files follows, or a pattern of names.
    if value.is_empty() || value.starts_with("LIST") || value.contains('%') {
        return Err(HeaderFault::Value { key: "ElementDataFile", expected: EXPECTED, got: value.to_owned() });
    }
    Ok(DataFile::Beside(path.parent().unwrap_or(Path::new("")).join(value)))
}

fn truth(value: &str) -> Option<bool> {
    match value.to_ascii_lowercase().as_str() {
        "true" | "1" => Some(true),
        "false" | "0" => Some(false),
        _ => None,
    }
}

/// Exactly three numbers.
fn numbers<T: std::str::FromStr + Copy>(value: &str) -> Option<[T; 3]> {
    let parsed: Option<Vec<T>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
    parsed?.try_into().ok()
}
