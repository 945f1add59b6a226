//! PLY, ASCII and binary of both endiannesses (G. Turk, "The PLY Polygon File Format", 1994).
//!
//! The parser is our own because the kept crate (ply-rs-bw) reads every row into a map from property names to tagged
//! values and every list into a vector of its own: 7.2 s for a binary file of 2 million triangles, of which this one takes
//! 0.2 s.
//!
//! ```text
//!  header --> layout of elements --> rows: a binary or an ASCII source of numbers --> vertices, faces --> Model
//! ```
//!
//! Read are vertex positions, normals, colours (`red green blue alpha`, `diffuse_*` or `r g b`: bytes or 0..1, sRGB),
//! texture coordinates (`s t`, `u v`, `texture_u texture_v`), faces with any number of corners, their texture
//! coordinates (`texcoord`) and colours, triangle strips, and `comment TextureFile NAME`. The rest is skipped.

use std::path::PathBuf;

use fantex_base::{Error, Result, counted};
use glam::{DVec3, Mat3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::load::polygon::Triangulator;
use crate::load::{SourceFile, finish, linear_rgba, locate, pad, relative_path};
use crate::{ImageSource, Material, Model, TextureRef, WrapMode};

/// Loads a PLY file.
pub(super) fn load(file: &SourceFile) -> Result<Model> {
    let read = || {
        let header = parse(file.bytes)?;
        let content = read(file, &header)?;
        build(file, &header, content)
    };
    read().map_err(|error| error.in_file(file.path))
}

fn index_out_of_range(face: u64, index: i64, count: usize) -> Error {
    Error::malformed(format!(
        "face {face} refers to vertex {index}, but there are {count} (counting starts at 0)"
    ))
}

fn no_positions() -> Error {
    Error::malformed("it has no element vertex with properties x, y and z")
}

// The header: which elements with which properties, how many of each.

/// How the numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scalar {
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
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value that stands for 1 in colours of this type.
    fn color_unit(self) -> f64 {
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
struct Property {
    /// Lower case.
    name: String,
    scalar: Scalar,
    /// For a list the type of its length.
    list_length: Option<Scalar>,
}

/// A table of the file.
#[derive(Clone, Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    /// The fewest bytes that a row can take.
    fn min_row_bytes(&self, encoding: Encoding) -> u64 {
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
struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// From `comment TextureFile NAME`.
    texture_files: Vec<String>,
    /// Where the data begins.
    data_offset: usize,
    /// Lines of the header.
    line_count: usize,
}

/// A longer line is not a header's.
const MAX_LINE_BYTES: usize = 1 << 16;

fn endless() -> Error {
    Error::malformed("its header has no end (no line end_header, or a line longer than any header's)")
}

/// Reads the header lines up to and with `end_header`.
fn parse(bytes: &[u8]) -> Result<Header> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut texture_files = Vec::new();
    let mut offset = 0;
    for line_number in 1.. {
        let rest = &bytes[offset..];
        let visible = &rest[..rest.len().min(MAX_LINE_BYTES)];
        let Some(end) = visible.iter().position(|&b| b == b'\n' || b == b'\r') else {
            return Err(endless());
        };
        let line = String::from_utf8_lossy(&bytes[offset..offset + end]).into_owned();
        offset += end + line_break_length(&bytes[offset + end..]);
        let wrong = |expected| {
            let found: String = line.chars().take(60).collect();
            let place = format!("header line {line_number}");
            Error::malformed(format!("expected {expected}, found {found:?}")).context(place)
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
    Err(endless())
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

// Streams of numbers: one interface over binary and ASCII data.

/// Why no number came.
#[derive(Debug)]
enum SourceError {
    End,
    /// The line and the word that is not a number.
    NotANumber(usize, String),
}

/// Numbers in the order in which the file stores them.
trait NumberSource {
    /// The next number.
    fn next(&mut self, scalar: Scalar) -> Result<f64, SourceError>;

    /// Skips numbers of one type.
    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), SourceError>;

    /// Bytes not yet read: an upper limit for what may still come.
    fn left(&self) -> u64;
}

/// Binary data; `BIG` for big-endian.
struct Binary<'a, const BIG: bool> {
    rest: &'a [u8],
}

impl<const BIG: bool> Binary<'_, BIG> {
    #[inline]
    fn take<const N: usize>(&mut self) -> Result<[u8; N], SourceError> {
        let (&bytes, rest) = self.rest.split_first_chunk::<N>().ok_or(SourceError::End)?;
        self.rest = rest;
        Ok(bytes)
    }
}

impl<const BIG: bool> NumberSource for Binary<'_, BIG> {
    #[inline]
    fn next(&mut self, scalar: Scalar) -> Result<f64, SourceError> {
        macro_rules! number {
            ($type:ty) => {{
                let bytes = self.take()?;
                f64::from(if BIG { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) })
            }};
        }
        Ok(match scalar {
            Scalar::I8 => number!(i8),
            Scalar::U8 => number!(u8),
            Scalar::I16 => number!(i16),
            Scalar::U16 => number!(u16),
            Scalar::I32 => number!(i32),
            Scalar::U32 => number!(u32),
            Scalar::F32 => number!(f32),
            Scalar::F64 => number!(f64),
        })
    }

    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), SourceError> {
        let bytes = count.checked_mul(scalar.size() as u64).and_then(|n| usize::try_from(n).ok());
        self.rest = bytes.and_then(|n| self.rest.get(n..)).ok_or(SourceError::End)?;
        Ok(())
    }

    fn left(&self) -> u64 {
        self.rest.len() as u64
    }
}

/// Numbers as words.
struct Ascii<'a> {
    rest: &'a [u8],
    line: usize,
}

impl<'a> Ascii<'a> {
    fn word(&mut self) -> Result<&'a [u8], SourceError> {
        let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or(SourceError::End)?;
        self.line += self.rest[..start].iter().filter(|&&b| b == b'\n').count();
        let text = &self.rest[start..];
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        self.rest = &text[end..];
        Ok(&text[..end])
    }
}

impl NumberSource for Ascii<'_> {
    fn next(&mut self, _: Scalar) -> Result<f64, SourceError> {
        let word = self.word()?;
        let parsed = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
        parsed.ok_or_else(|| {
            let shown = String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
            SourceError::NotANumber(self.line, shown)
        })
    }

    fn skip(&mut self, _: Scalar, count: u64) -> Result<(), SourceError> {
        (0..count).try_for_each(|_| self.word().map(|_| ()))
    }

    fn left(&self) -> u64 {
        // The last number needs no separator after it.
        self.rest.len() as u64 + 1
    }
}

// Reading the rows.

/// The tables that matter, as the file has them; all vertex indices are in range.
#[derive(Default)]
struct Content {
    positions: Vec<DVec3>,
    /// One per position, or empty; likewise the next two.
    normals: Vec<Vec3>,
    /// v upwards, as written.
    uvs: Vec<Vec2>,
    /// sRGB with linear alpha, 0..1.
    colors_srgb: Vec<Vec4>,
    faces: Faces,
    /// `COUNT NAME` of elements that were not used.
    skipped_elements: Vec<String>,
}

/// Polygons with any number of corners.
#[derive(Default)]
struct Faces {
    /// Vertex indices of all faces, one after the other.
    corners: Vec<u32>,
    /// Where each face's corners end in `corners`. Empty as long as all faces are triangles.
    ends: Vec<usize>,
    is_mixed: bool,
    /// One per corner (v upwards), or empty.
    corner_uvs: Vec<Vec2>,
    /// sRGB, one per face, or empty.
    colors_srgb: Vec<Vec4>,
    /// Texture of each face, or empty.
    textures: Vec<i64>,
    /// Faces with fewer than three corners.
    short: u64,
}

impl Faces {
    fn len(&self) -> usize {
        if self.is_mixed { self.ends.len() } else { self.corners.len() / 3 }
    }

    /// The range in `corners` of a face.
    fn range(&self, face: usize) -> std::ops::Range<usize> {
        match self.is_mixed {
            true => face.checked_sub(1).map_or(0, |before| self.ends[before])..self.ends[face],
            false => 3 * face..3 * face + 3,
        }
    }

    /// Triangles that the polygons will become.
    fn triangle_count(&self) -> usize {
        self.corners.len() - 2 * self.len()
    }

    /// The corners from `first` on become a face; fewer than three are taken back. Says whether it was kept.
    fn end_face(&mut self, first: usize) -> bool {
        let corners = self.corners.len() - first;
        if corners < 3 {
            self.corners.truncate(first);
            self.short += 1;
            return false;
        }
        if corners != 3 && !self.is_mixed {
            self.is_mixed = true;
            self.ends = (3..=first).step_by(3).collect();
        }
        if self.is_mixed {
            self.ends.push(self.corners.len());
        }
        true
    }
}

/// Reads all elements after the header.
fn read(file: &SourceFile, header: &Header) -> Result<Content> {
    let rest = &file.bytes[header.data_offset..];
    match header.encoding {
        Encoding::LittleEndian => read_elements(file, header, Binary::<false> { rest }),
        Encoding::BigEndian => read_elements(file, header, Binary::<true> { rest }),
        Encoding::Ascii => read_elements(file, header, Ascii { rest, line: header.line_count + 1 }),
    }
}

fn read_elements(file: &SourceFile, header: &Header, mut source: impl NumberSource) -> Result<Content> {
    let mut content = Content::default();
    let vertices = header.elements.iter().find(|e| e.name == "vertex").ok_or_else(no_positions)?;
    let vertex_count = vertices.count as usize;
    for element in &header.elements {
        check_count(element, header.encoding, source.left())?;
        let mut rows = Rows { file, vertex_count, element, source: &mut source };
        match element.name.as_str() {
            // A second table of vertices would have nothing that refers to it.
            "vertex" if content.positions.is_empty() => rows.read_vertices(&mut content)?,
            "face" => rows.read_faces(&mut content.faces)?,
            "tristrips" => rows.read_strips(&mut content.faces)?,
            name => {
                rows.skip_all()?;
                content.skipped_elements.push(format!("{} {name}", element.count));
            }
        }
    }
    check_indices(&content)?;
    Ok(content)
}

/// Refuses counts that the rest of the file cannot hold, before anything is allocated for them.
fn check_count(element: &Element, encoding: Encoding, left: u64) -> Result<()> {
    let needed = element.count.saturating_mul(element.min_row_bytes(encoding));
    if needed <= left {
        return Ok(());
    }
    let elements = counted(element.count, "element");
    Err(Error::malformed(format!(
        "its header announces {elements} {:?}, at least {needed} bytes, but only {left} follow; it is truncated or damaged",
        element.name
    )))
}

fn check_indices(content: &Content) -> Result<()> {
    let count = content.positions.len();
    let corners = &content.faces.corners;
    if corners.iter().max().is_none_or(|&highest| (highest as usize) < count) {
        return Ok(());
    }
    let first_bad = |face: &usize| corners[content.faces.range(*face)].iter().find(|&&v| v as usize >= count);
    let face = (0..content.faces.len()).find(|face| first_bad(face).is_some()).unwrap_or_default();
    let index = first_bad(&face).copied().map_or(-1, i64::from);
    Err(index_out_of_range(face as u64, index, count))
}

/// Number of values that a vertex row is sorted into; the last one takes what is not used.
const SLOTS: usize = 13;
const IGNORED: usize = SLOTS - 1;

/// Where a vertex property goes: position 0-2, normal 3-5, texture coordinates 6-7, colour 8-11.
fn vertex_slot(name: &str) -> usize {
    match name {
        "x" => 0,
        "y" => 1,
        "z" => 2,
        "nx" => 3,
        "ny" => 4,
        "nz" => 5,
        "s" | "u" | "texture_u" | "texture_s" | "tex_u" => 6,
        "t" | "v" | "texture_v" | "texture_t" | "tex_v" => 7,
        _ => color_slot(name).map_or(IGNORED, |channel| 8 + channel),
    }
}

fn color_slot(name: &str) -> Option<usize> {
    match name {
        "red" | "diffuse_red" | "r" => Some(0),
        "green" | "diffuse_green" | "g" => Some(1),
        "blue" | "diffuse_blue" | "b" => Some(2),
        "alpha" | "diffuse_alpha" | "a" => Some(3),
        _ => None,
    }
}

/// What a face property holds.
#[derive(Clone, Copy)]
enum FaceColumn {
    Vertices,
    TextureCoordinates,
    TextureNumber,
    Color(usize),
    Ignored,
}

fn face_column(name: &str, is_list: bool) -> FaceColumn {
    match (name, is_list) {
        ("vertex_indices" | "vertex_index", true) => FaceColumn::Vertices,
        ("texcoord", true) => FaceColumn::TextureCoordinates,
        ("texnumber", false) => FaceColumn::TextureNumber,
        (name, false) => color_slot(name).map_or(FaceColumn::Ignored, FaceColumn::Color),
        _ => FaceColumn::Ignored,
    }
}

/// The rows of one element.
struct Rows<'a, S> {
    file: &'a SourceFile<'a>,
    /// Vertices that the header announces.
    vertex_count: usize,
    element: &'a Element,
    source: &'a mut S,
}

impl<S: NumberSource> Rows<'_, S> {
    fn failed(&self, row: u64, error: SourceError) -> Error {
        let Element { name, count, .. } = self.element;
        Error::malformed(match error {
            SourceError::End => {
                format!("the file ends in {name} {row} of {count}; it is truncated or damaged")
            }
            SourceError::NotANumber(line, found) => {
                format!("{name} {row}, line {line}: expected a number, found {found:?}")
            }
        })
    }

    fn skip_all(&mut self) -> Result<()> {
        if self.element.properties.is_empty() {
            return Ok(());
        }
        for row in 0..self.element.count {
            for property in &self.element.properties {
                self.skip(property.scalar, property.list_length).map_err(|e| self.failed(row, e))?;
            }
        }
        Ok(())
    }

    fn skip(&mut self, scalar: Scalar, list_length: Option<Scalar>) -> Result<(), SourceError> {
        let count = match list_length {
            Some(length) => self.source.next(length)? as u64,
            None => 1,
        };
        self.source.skip(scalar, count)
    }

    fn read_vertices(&mut self, content: &mut Content) -> Result<()> {
        let element = self.element;
        let slots: Vec<usize> = element
            .properties
            .iter()
            .map(|p| if p.list_length.is_some() { IGNORED } else { vertex_slot(&p.name) })
            .collect();
        let has = |slot: usize, count: usize| (slot..slot + count).all(|s| slots.contains(&s));
        if !has(0, 3) {
            return Err(no_positions());
        }
        self.file.check_positions(usize::try_from(element.count).unwrap_or(usize::MAX))?;
        let (has_normals, has_uvs, has_colors) = (has(3, 3), has(6, 2), has(8, 3));
        let units = color_units(element, &slots);

        content.positions.reserve(element.count as usize);
        for row in 0..element.count {
            let mut values = [0.0; SLOTS];
            // Without an alpha column colours are opaque.
            values[11] = units[3];
            self.read_vertex(&slots, &mut values).map_err(|e| self.failed(row, e))?;
            let [x, y, z, nx, ny, nz, s, t, r, g, b, a, _] = values;
            content.positions.push(DVec3::new(x, y, z));
            if has_normals {
                content.normals.push(DVec3::new(nx, ny, nz).as_vec3());
            }
            if has_uvs {
                content.uvs.push(Vec2::new(s as f32, t as f32));
            }
            if has_colors {
                content.colors_srgb.push(color([r, g, b, a], units));
            }
        }
        Ok(())
    }

    #[inline]
    fn read_vertex(&mut self, slots: &[usize], values: &mut [f64; SLOTS]) -> Result<(), SourceError> {
        for (property, &slot) in self.element.properties.iter().zip(slots) {
            match property.list_length {
                None => values[slot] = self.source.next(property.scalar)?,
                length => self.skip(property.scalar, length)?,
            }
        }
        Ok(())
    }

    fn read_faces(&mut self, faces: &mut Faces) -> Result<()> {
        let element = self.element;
        let columns: Vec<FaceColumn> =
            element.properties.iter().map(|p| face_column(&p.name, p.list_length.is_some())).collect();
        if !columns.iter().any(|c| matches!(c, FaceColumn::Vertices)) {
            return self.skip_all();
        }
        faces.corners.reserve(3 * element.count as usize);
        for row in 0..element.count {
            self.read_face(row, &columns, faces)?;
        }
        Ok(())
    }

    fn read_face(&mut self, row: u64, columns: &[FaceColumn], faces: &mut Faces) -> Result<()> {
        let (face, first) = (faces.len(), faces.corners.len());
        let mut rgba: Option<Vec4> = None;
        let mut texture = None;
        let mut uvs = None;
        for (property, column) in self.element.properties.iter().zip(columns) {
            let (scalar, length) = (property.scalar, property.list_length);
            match (column, length) {
                (FaceColumn::Vertices, Some(length)) => self.read_corners(row, length, scalar, faces)?,
                (FaceColumn::TextureCoordinates, Some(length)) => {
                    uvs = Some(self.read_uvs(length, scalar).map_err(|e| self.failed(row, e))?);
                }
                (FaceColumn::TextureNumber, None) => {
                    texture = Some(self.source.next(scalar).map_err(|e| self.failed(row, e))? as i64);
                }
                (FaceColumn::Color(channel), None) => {
                    let value = self.source.next(scalar).map_err(|e| self.failed(row, e))?;
                    rgba.get_or_insert(Vec4::ONE)[*channel] = (value / scalar.color_unit()) as f32;
                }
                (_, length) => self.skip(scalar, length).map_err(|e| self.failed(row, e))?,
            }
        }
        if !faces.end_face(first) {
            return Ok(());
        }
        if let Some(rgba) = rgba {
            pad(&mut faces.colors_srgb, face, Vec4::ONE);
            faces.colors_srgb.push(rgba);
        }
        if let Some(texture) = texture {
            pad(&mut faces.textures, face, 0);
            faces.textures.push(texture);
        }
        if let Some(uvs) = uvs.filter(|uvs| uvs.len() == faces.corners.len() - first) {
            pad(&mut faces.corner_uvs, first, Vec2::ZERO);
            faces.corner_uvs.extend(uvs);
        }
        Ok(())
    }

    #[inline]
    fn read_corners(&mut self, face: u64, length: Scalar, scalar: Scalar, faces: &mut Faces) -> Result<()> {
        let corners = self.source.next(length).map_err(|e| self.failed(face, e))? as u64;
        let limit = self.file.limits.max_face_corners;
        if corners > limit as u64 {
            let sentence = format!("face {face} has {corners} corners, more than the limit of {limit}");
            return Err(Error::too_large(sentence));
        }
        for _ in 0..corners {
            let index = self.source.next(scalar).map_err(|e| self.failed(face, e))?;
            let vertex = index as u32;
            if f64::from(vertex) != index {
                return Err(index_out_of_range(face, index as i64, self.vertex_count));
            }
            faces.corners.push(vertex);
        }
        Ok(())
    }

    /// Texture coordinates of a face, a flat list of pairs.
    fn read_uvs(&mut self, length: Scalar, scalar: Scalar) -> Result<Vec<Vec2>, SourceError> {
        let numbers = self.source.next(length)? as u64;
        let mut uvs = Vec::with_capacity(numbers.min(self.source.left()) as usize / 2);
        for _ in 0..numbers / 2 {
            uvs.push(Vec2::new(self.source.next(scalar)? as f32, self.source.next(scalar)? as f32));
        }
        self.source.skip(scalar, numbers % 2)?;
        Ok(uvs)
    }

    /// Each strip is a list of vertices; a negative index ends a strip and begins the next within the same list.
    fn read_strips(&mut self, faces: &mut Faces) -> Result<()> {
        for row in 0..self.element.count {
            for property in &self.element.properties {
                let (scalar, length) = (property.scalar, property.list_length);
                match (face_column(&property.name, length.is_some()), length) {
                    (FaceColumn::Vertices, Some(length)) => self.read_strip(row, length, scalar, faces)?,
                    _ => self.skip(scalar, length).map_err(|e| self.failed(row, e))?,
                }
            }
        }
        Ok(())
    }

    fn read_strip(&mut self, strip: u64, length: Scalar, scalar: Scalar, faces: &mut Faces) -> Result<()> {
        let count = self.source.next(length).map_err(|e| self.failed(strip, e))? as u64;
        let mut window: Vec<u32> = Vec::with_capacity(3);
        let mut is_turned = false;
        for _ in 0..count {
            let index = self.source.next(scalar).map_err(|e| self.failed(strip, e))?;
            if index < 0.0 {
                window.clear();
                is_turned = false;
                continue;
            }
            let vertex = index as u32;
            if f64::from(vertex) != index {
                return Err(index_out_of_range(strip, index as i64, self.vertex_count));
            }
            window.push(vertex);
            if let [a, b, c] = window[..] {
                self.end_strip_triangle(if is_turned { [b, a, c] } else { [a, b, c] }, faces);
                window.remove(0);
                is_turned = !is_turned;
            }
        }
        Ok(())
    }

    /// Strips are stitched together by triangles with a repeated vertex, which mean nothing.
    fn end_strip_triangle(&self, [a, b, c]: [u32; 3], faces: &mut Faces) {
        if a != b && b != c && c != a {
            let first = faces.corners.len();
            faces.corners.extend([a, b, c]);
            faces.end_face(first);
        }
    }
}

/// What stands for 1 in each of the four colour columns.
fn color_units(element: &Element, slots: &[usize]) -> [f64; 4] {
    std::array::from_fn(|channel| {
        let column = slots.iter().position(|&slot| slot == 8 + channel);
        column.map_or(1.0, |column| element.properties[column].scalar.color_unit())
    })
}

fn color(values: [f64; 4], units: [f64; 4]) -> Vec4 {
    Vec4::from(std::array::from_fn(|channel| (values[channel] / units[channel]) as f32))
}

// From a PLY file's tables to a model.

/// Cuts the polygons and spreads attributes over the corners.
fn build(file: &SourceFile, header: &Header, content: Content) -> Result<Model> {
    file.check_triangles(content.faces.triangle_count())?;
    let cut = Cut::new(&content);
    let mut model = Model::default();
    spread_attributes(&mut model, &content, &cut);
    attach_textures(&mut model, file, header, &content.faces, &cut);
    write_notes(&mut model, &content);
    model.triangles = match cut.corners {
        Some(corners) => {
            corners.chunks_exact(3).map(|c| [0, 1, 2].map(|k| content.faces.corners[c[k] as usize])).collect()
        }
        None => content.faces.corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
    };
    model.positions = content.positions;
    finish(&mut model);
    Ok(model)
}

/// The triangles that the polygons were cut into.
struct Cut {
    /// For every triangle corner its index into [`Faces::corners`]; None where they are the same.
    corners: Option<Vec<u32>>,
    /// For every triangle its face; None where they are the same.
    faces: Option<Vec<u32>>,
}

impl Cut {
    fn new(content: &Content) -> Self {
        let faces = &content.faces;
        if faces.triangle_count() == faces.len() {
            return Self { corners: None, faces: None };
        }
        let mut corners = Vec::with_capacity(3 * faces.triangle_count());
        let mut of_triangle = Vec::with_capacity(faces.triangle_count());
        let mut triangulator = Triangulator::default();
        let mut outline: Vec<DVec3> = Vec::new();
        for face in 0..faces.len() {
            let range = faces.range(face);
            let first = range.start;
            outline.clear();
            outline.extend(faces.corners[range].iter().map(|&v| content.positions[v as usize]));
            triangulator.triangulate(&outline, |t| {
                corners.extend(t.map(|k| (first + k) as u32));
                of_triangle.push(face as u32);
            });
        }
        Self { corners: Some(corners), faces: Some(of_triangle) }
    }

    /// Values of an array that goes with [`Faces::corners`], for every triangle corner.
    fn per_corner<T: Copy>(&self, of_face_corner: impl Fn(usize) -> T, corner_count: usize) -> Vec<T> {
        match &self.corners {
            Some(corners) => corners.iter().map(|&c| of_face_corner(c as usize)).collect(),
            None => (0..corner_count).map(of_face_corner).collect(),
        }
    }

    /// Values of an array that goes with the faces, for every triangle.
    fn per_triangle<T>(&self, of_face: impl Fn(usize) -> T, face_count: usize) -> Vec<T> {
        match &self.faces {
            Some(faces) => faces.iter().map(|&f| of_face(f as usize)).collect(),
            None => (0..face_count).map(of_face).collect(),
        }
    }
}

fn spread_attributes(model: &mut Model, content: &Content, cut: &Cut) {
    let faces = &content.faces;
    let count = faces.corners.len();
    let vertex = |corner: usize| faces.corners[corner] as usize;
    if !content.normals.is_empty() {
        model.corners.normals = cut.per_corner(|c| content.normals[vertex(c)], count);
    }
    if !faces.corner_uvs.is_empty() {
        let uv = |c| flipped(faces.corner_uvs.get(c).copied().unwrap_or_default());
        model.corners.uv_sets = vec![cut.per_corner(uv, count)];
    } else if !content.uvs.is_empty() {
        model.corners.uv_sets = vec![cut.per_corner(|c| flipped(content.uvs[vertex(c)]), count)];
    }
    if !content.colors_srgb.is_empty() {
        let colors: Vec<Vec4> = content.colors_srgb.par_iter().map(|&c| linear(c)).collect();
        model.corners.colors = cut.per_corner(|c| colors[vertex(c)], count);
    } else if !faces.colors_srgb.is_empty() {
        let of_face = |face| linear(faces.colors_srgb.get(face).copied().unwrap_or(Vec4::ONE));
        let of_triangle = cut.per_triangle(of_face, faces.len());
        model.corners.colors = of_triangle.into_iter().flat_map(|color| [color; 3]).collect();
    }
}

/// To the top left origin.
fn flipped(uv: Vec2) -> Vec2 {
    Vec2::new(uv.x, 1.0 - uv.y)
}

fn linear(color_srgb: Vec4) -> Vec4 {
    linear_rgba(color_srgb.truncate(), color_srgb.w)
}

/// One material per `TextureFile` comment; faces choose by `texnumber`.
fn attach_textures(model: &mut Model, file: &SourceFile, header: &Header, faces: &Faces, cut: &Cut) {
    if header.texture_files.is_empty() || model.corners.uv_sets.is_empty() {
        return;
    }
    for (image, name) in header.texture_files.iter().enumerate() {
        let texture = TextureRef {
            image,
            uv_set: 0,
            uv_transform: Mat3::IDENTITY,
            wrap: [WrapMode::Repeat; 2],
            nearest: false,
        };
        let material = Material {
            name: name.clone(),
            place: "a TextureFile comment".to_owned(),
            base_color_texture: Some(texture),
            ..Material::default()
        };
        model.materials.push(material);
        let path = relative_path(name).unwrap_or_else(|| PathBuf::from(name));
        model.images.push(ImageSource::File(locate(file.folder(), &path)));
    }
    if header.texture_files.len() > 1 {
        let last = header.texture_files.len() as i64 - 1;
        let of_face = |face| faces.textures.get(face).copied().unwrap_or(0).clamp(0, last) as u32;
        model.triangle_materials = cut.per_triangle(of_face, faces.len());
    }
}

fn write_notes(model: &mut Model, content: &Content) {
    if content.faces.short > 0 {
        model
            .notes
            .push(format!("skipped {} with fewer than three corners", counted(content.faces.short, "face")));
    }
    if !content.skipped_elements.is_empty() {
        model.notes.push(format!(
            "elements that fantex does not use were skipped: {}",
            content.skipped_elements.join(", ")
        ));
    }
}
