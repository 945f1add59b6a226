//! The header: which elements with which properties, how many of each.

use super::PlyProblem;

/// How the numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes in a binary file.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value that stands for 1 in colours of this type.
    pub(super) fn color_unit(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            // Colours in wide integers are bytes that were not worth a type of their own.
            Self::I32 | Self::U32 => 255.0,
            Self::F32 | Self::F64 => 1.0,
        }
    }
}

/// A column of an element.
#[derive(Clone, Debug)]
pub(super) struct Property {
    /// Lower case.
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// For a list the type of its length.
    pub(super) list_length: Option<Scalar>,
}

/// A table of the file.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The fewest bytes that a row can take.
    pub(super) fn min_row_bytes(&self, encoding: Encoding) -> u64 {
        let bytes = |p: &Property| match encoding {
            // A digit and a separator.
            Encoding::Ascii => 2,
            _ => p.list_length.unwrap_or(p.scalar).size() as u64,
        };
        self.properties.iter().map(bytes).sum()
    }
}

/// A parsed header.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// From `comment TextureFile NAME`.
    pub(super) texture_files: Vec<String>,
    /// Where the data begins.
    pub(super) data_offset: usize,
    /// Lines of the header.
    pub(super) line_count: usize,
}

/// A longer line is not a header's.
const MAX_LINE_BYTES: usize = 1 << 16;

/// Reads the header lines up to and with `end_header`.
pub(super) fn parse(bytes: &[u8]) -> Result<Header, PlyProblem> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut texture_files = Vec::new();
    let mut offset = 0;
    for line_number in 1.. {
        let rest = &bytes[offset..];
        let visible = &rest[..rest.len().min(MAX_LINE_BYTES)];
        let Some(end) = visible.iter().position(|&b| b == b'\n' || b == b'\r') else {
            return Err(PlyProblem::HeaderEnd);
        };
        let line = String::from_utf8_lossy(&bytes[offset..offset + end]).into_owned();
        offset += end + line_break_length(&bytes[offset + end..]);
        let wrong = |expected| PlyProblem::Header {
            line: line_number,
            expected,
            found: line.chars().take(60).collect(),
        };
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if line_number == 1 => {}
            [] | ["obj_info", ..] => {}
            ["comment", "TextureFile", ..] => {
                let name = line.split_once("TextureFile").map_or("", |(_, name)| name.trim());
                texture_files.extend((!name.is_empty()).then(|| name.to_owned()));
            }
            ["comment", ..] => {}
            ["format", name, _version] => {
                encoding = Some(
                    encoding_from_name(name)
                        .ok_or_else(|| wrong("format ascii, binary_little_endian or binary_big_endian"))?,
                );
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong("element NAME COUNT"))?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref definition @ ..] => {
                let property = parse_property(definition)
                    .ok_or_else(|| wrong("property TYPE NAME or property list TYPE TYPE NAME"))?;
                let element = elements.last_mut().ok_or_else(|| wrong("an element before its properties"))?;
                element.properties.push(property);
            }
            ["end_header"] => {
                let encoding = encoding.ok_or_else(|| wrong("a format line before end_header"))?;
                return Ok(Header {
                    encoding,
                    elements,
                    texture_files,
                    data_offset: offset,
                    line_count: line_number,
                });
            }
            _ => return Err(wrong("format, element, property, comment, obj_info or end_header")),
        }
    }
    Err(PlyProblem::HeaderEnd)
}

/// `\n`, `\r\n`, or `\r` alone (old Macintosh files).
fn line_break_length(bytes: &[u8]) -> usize {
    if bytes.starts_with(b"\r\n") { 2 } else { 1 }
}

fn encoding_from_name(name: &str) -> Option<Encoding> {
    match name {
        "ascii" => Some(Encoding::Ascii),
        "binary_little_endian" => Some(Encoding::LittleEndian),
        "binary_big_endian" => Some(Encoding::BigEndian),
        _ => None,
    }
}

fn parse_property(definition: &[&str]) -> Option<Property> {
    let (scalar, list_length, name) = match *definition {
        ["list", length, item, name] => (item, Some(length), name),
        [scalar, name] => (scalar, None, name),
        _ => return None,
    };
    let list_length = match list_length {
        // A length must be whole.
        Some(name) => Some(Scalar::from_name(name).filter(|s| !matches!(s, Scalar::F32 | Scalar::F64))?),
        None => None,
    };
    Some(Property { name: name.to_ascii_lowercase(), scalar: Scalar::from_name(scalar)?, list_length })
}
