//! Volumes from files: MetaImage and raw numbers.
//!
//! Sizes are checked against the memory limit before anything is allocated, and against the file's length before it is read.

use std::fs::File;
use std::io;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use fantex_base::{Error, Place, Result, counted, input};
use glam::Vec3;

use super::{Volume, bytes_with_levels, checked_samples, sample_bytes};
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
    /// A file cannot be read, is damaged or of another kind, or the volume with its levels would take more than
    /// `memory_bytes`.
    pub fn load_meta_image(path: impl AsRef<Path>, memory_bytes: u64) -> Result<Self> {
        let path = path.as_ref();
        let mut start = Vec::new();
        let opened = input::open(path).and_then(|f| f.take(MAX_HEADER_BYTES as u64).read_to_end(&mut start));
        opened.map_err(|source| Error::reading(path, source))?;
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
    /// There is no image, one cannot be read or differs from the first, or the volume with its levels would take more than
    /// `memory_bytes`.
    pub fn load_slices(paths: &[impl AsRef<Path>], space: ColorSpace, memory_bytes: u64) -> Result<Self> {
        let mut slices: Vec<Image> = Vec::new();
        for (index, path) in paths.iter().enumerate() {
            let slice = Image::load_as(path, space)
                .map_err(|error| error.context(format!("slice {index} of a volume")))?;
            let size = [slice.width, slice.height, u32::try_from(paths.len()).unwrap_or(u32::MAX)];
            let needed = bytes_with_levels(size, slice.channels, slice.samples.depth());
            check_memory(path.as_ref(), needed, memory_bytes)?;
            slices.push(slice);
        }
        Self::from_slices(&slices).map_err(|error| error.context("the slices of a volume do not fit"))
    }

    /// Reads a file of plain numbers.
    ///
    /// # Errors
    /// The size is impossible, the file cannot be read or is too short, or the volume with its levels would take more than
    /// `memory_bytes`.
    pub fn load_raw(path: impl AsRef<Path>, layout: &RawLayout, memory_bytes: u64) -> Result<Self> {
        load(path.as_ref(), *layout, false, memory_bytes)
    }
}

fn load(path: &Path, layout: RawLayout, is_at_end: bool, memory_bytes: u64) -> Result<Volume> {
    checked_samples(layout.size, layout.channels).map_err(|error| error.in_file(path))?;
    let needed = bytes_with_levels(layout.size, layout.channels, layout.depth);
    check_memory(path, needed, memory_bytes)?;
    let read_error = |source| Error::reading(path, source);
    let mut file = input::open(path).map_err(read_error)?;
    let length = file.metadata().map_err(read_error)?.len();
    let skip = if is_at_end { length.saturating_sub(layout.byte_len()) } else { layout.skip };
    let expected = layout.byte_len().saturating_add(skip);
    if expected > length {
        let length = counted(length, "byte");
        let message = format!("'{}' ends after {length}; the volume needs {expected}", path.display());
        return Err(Error::malformed(message).with_path(path));
    }
    file.seek(SeekFrom::Start(skip)).map_err(read_error)?;
    let samples = read_samples(&mut file, &layout).map_err(read_error)?;
    Volume::new(layout.size, layout.channels, layout.space, samples).map_err(|error| error.in_file(path))
}

fn check_memory(path: &Path, needed: u64, limit: u64) -> Result<()> {
    let limit = limit.min(input::memory_left());
    if needed <= limit {
        return Ok(());
    }
    let what = format!("'{}' with its levels", path.display());
    Err(input::too_large(what, needed, limit).with_path(path))
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

// ---- The header of MetaImage files (`.mhd`, `.mha`): lines of `Key = value`, the last of which names the file of the numbers.

/// Longest header that is looked at; real ones have a few hundred bytes.
pub(super) const MAX_HEADER_BYTES: usize = 1 << 16;

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
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Header> {
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
        let fail = |error: Error| error.at(Place::Line(index as u64 + 1)).in_file(path);
        start += line.len() + 1;
        let text = std::str::from_utf8(line).map_err(|_| fail(no_entry()))?.trim();
        if text.is_empty() {
            continue;
        }
        let (key, value) = text.split_once('=').ok_or_else(|| fail(no_entry()))?;
        let (key, value) = (key.trim(), value.trim());
        has_size |= key == "DimSize";
        has_type |= key == "ElementType";
        if key == "ElementDataFile" {
            let missing =
                [("DimSize", has_size), ("ElementType", has_type)].into_iter().find(|(_, has)| !has);
            if let Some((key, _)) = missing {
                return Err(fail(missing_key(key)));
            }
            header.data = data_file(value, start as u64, path).map_err(fail)?;
            return Ok(header);
        }
        header.read(key, value).map_err(fail)?;
    }
    let line = bytes.iter().filter(|&&byte| byte == b'\n').count() as u64 + 1;
    Err(missing_key("ElementDataFile").at(Place::Line(line)).in_file(path))
}

fn no_entry() -> Error {
    Error::malformed("a MetaImage header has lines like 'DimSize = 64 64 64'")
}

fn missing_key(key: &str) -> Error {
    Error::malformed(format!("the header ends without {key}"))
}

fn wrong_value(key: &str, expected: &str, got: &str) -> Error {
    Error::malformed(format!("{key} is '{got}'; it must be {expected}"))
}

impl Header {
    /// Takes in an entry; those that say nothing about the numbers are passed over.
    fn read(&mut self, key: &str, value: &str) -> Result<()> {
        let wrong = |key, expected| wrong_value(key, expected, value);
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

fn data_file(value: &str, start: u64, path: &Path) -> Result<DataFile> {
    const EXPECTED: &str = "LOCAL or the name of one file with all numbers";
    if value == "LOCAL" {
        return Ok(DataFile::Local(start));
    }
    // A list of files follows, or a pattern of names.
    if value.is_empty() || value.starts_with("LIST") || value.contains('%') {
        return Err(wrong_value("ElementDataFile", EXPECTED, value));
    }
    input::check_inside(path, Path::new(value))?;
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
