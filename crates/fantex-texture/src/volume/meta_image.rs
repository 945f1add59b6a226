//! The header of MetaImage files (`.mhd`, `.mha`): lines of `Key = value`, the last of which names the file of the numbers.

use std::path::{Path, PathBuf};

use glam::Vec3;

use super::error::{HeaderFault, LoadVolumeError};
use super::file::{ByteOrder, RawLayout};
use crate::{ColorSpace, Depth};

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
