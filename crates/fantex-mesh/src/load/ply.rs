//! PLY, ASCII and binary of both endiannesses (G. Turk, "The PLY Polygon File Format", 1994).
//!
//! ```text
//!  header --> layout of elements --> rows: a binary or an ASCII source of numbers --> vertices, faces --> Model
//! ```
//!
//! Read are vertex positions, normals, colours (`red green blue alpha`, `diffuse_*` or `r g b`: integers, or floats of 0..1 or
//! 0..255; sRGB),
//! texture coordinates (`s t`, `u v`, `texture_u texture_v`), faces with any number of corners, their texture
//! coordinates (`texcoord`) and colours, triangle strips, and `comment TextureFile NAME`. The rest is skipped.

use std::path::PathBuf;

use fantex_base::{Error, Result, counted};
use glam::{DVec3, Mat3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::counts::there_are;
use crate::load::polygon::Triangulator;
use crate::load::{
    SourceFile, Words, are_bytes, broken_colors_note, linear_rgba, locate, pad, parsed_number, relative_path,
    shown,
};
use crate::{ImageSource, Material, Model, TextureRef, WrapMode};

pub(super) fn load(file: &SourceFile) -> Result<Model> {
    let read = || {
        let header = parse(file.bytes)?;
        let content = read(file, &header)?;
        build(file, &header, content)
    };
    read().map_err(|error| error.in_file(file.path))
}

fn index_out_of_range(face: u64, index: f64, count: usize) -> Error {
    let there_are = there_are(count);
    Error::malformed(format!("face {face} refers to vertex {index}, but {there_are} (counting starts at 0)"))
}

fn no_positions() -> Error {
    Error::malformed("it has no element vertex with properties x, y and z")
}

// The header: which elements with which properties, how many of each.

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, PartialEq, Eq)]
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

struct Property {
    /// Lower case.
    name: String,
    scalar: Scalar,
    list_length: Option<Scalar>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    fn min_row_bytes(&self, encoding: Encoding) -> u64 {
        let bytes = |p: &Property| match encoding {
            // A digit and a separator.
            Encoding::Ascii => 2,
            _ => p.list_length.unwrap_or(p.scalar).size() as u64,
        };
        self.properties.iter().map(bytes).sum()
    }
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    texture_files: Vec<String>,
    /// The first line that means nothing, and how many there are.
    unknown: Option<(String, usize)>,
    data_offset: usize,
    line_count: usize,
}

/// A longer line is not a header's.
const MAX_LINE_BYTES: usize = 1 << 16;

fn endless() -> Error {
    Error::malformed("its header has no end (no line end_header, or a line longer than any header's)")
}

fn parse(bytes: &[u8]) -> Result<Header> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut texture_files = Vec::new();
    let mut unknown = None;
    let mut offset = 0;
    for line_number in 1.. {
        let rest = &bytes[offset..];
        let visible = &rest[..rest.len().min(MAX_LINE_BYTES)];
        let Some(end) = visible.iter().position(|&b| b == b'\n' || b == b'\r') else {
            return Err(endless());
        };
        let line = String::from_utf8_lossy(&rest[..end]).into_owned();
        // `\n`, `\r\n`, or `\r` alone (old Macintosh files).
        offset += end + if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
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
                encoding = Some(match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(wrong("format ascii, binary_little_endian or binary_big_endian")),
                });
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
                    unknown,
                    data_offset: offset,
                    line_count: line_number,
                });
            }
            // What makes up the rows must be understood. Other lines are comments, some of which lack the word.
            ["ply" | "format" | "element" | "end_header", ..] => {
                return Err(wrong("format, element, property, comment, obj_info or end_header"));
            }
            _ => {
                let first = || (format!("{line_number}: {}", shown(line.as_bytes())), 0);
                unknown.get_or_insert_with(first).1 += 1;
            }
        }
    }
    Err(endless())
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

#[derive(Debug)]
enum SourceError {
    End,
    /// The line and the word that is not a number.
    NotANumber(usize, String),
}

/// Numbers in the order in which the file stores them.
trait NumberSource {
    fn next(&mut self, scalar: Scalar) -> Result<f64, SourceError>;

    fn skip(&mut self, scalar: Scalar, count: u64) -> Result<(), SourceError>;

    /// Bytes not yet read: an upper limit for what may still come.
    fn left(&self) -> u64;

    /// Bytes not yet read, without white space at their ends.
    fn trailing(&self) -> u64;
}

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

    fn trailing(&self) -> u64 {
        self.rest.trim_ascii().len() as u64
    }
}

impl NumberSource for Words<'_> {
    fn next(&mut self, _: Scalar) -> Result<f64, SourceError> {
        let word = self.next().ok_or(SourceError::End)?;
        parsed_number(word).ok_or_else(|| SourceError::NotANumber(self.line, shown(word)))
    }

    fn skip(&mut self, _: Scalar, count: u64) -> Result<(), SourceError> {
        (0..count).try_for_each(|_| self.next().map(|_| ()).ok_or(SourceError::End))
    }

    fn left(&self) -> u64 {
        // The last number needs no separator after it.
        self.rest.len() as u64 + 1
    }

    fn trailing(&self) -> u64 {
        self.rest.trim_ascii().len() as u64
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
    skipped_elements: Vec<String>,
    /// Bytes after the last element.
    trailing: u64,
}

#[derive(Default)]
struct Faces {
    corners: Vec<u32>,
    /// Where each face's corners end in `corners`. Empty as long as all faces are triangles.
    ends: Vec<usize>,
    /// One per corner (v upwards); what is missing at the end is zero.
    corner_uvs: Vec<Vec2>,
    /// sRGB, one per face; what is missing at the end is white.
    colors_srgb: Vec<Vec4>,
    /// Texture of each face; what is missing at the end is 0.
    textures: Vec<i64>,
    short: u64,
}

impl Faces {
    fn len(&self) -> usize {
        if self.ends.is_empty() { self.corners.len() / 3 } else { self.ends.len() }
    }

    fn range(&self, face: usize) -> std::ops::Range<usize> {
        match self.ends.is_empty() {
            true => 3 * face..3 * face + 3,
            false => face.checked_sub(1).map_or(0, |before| self.ends[before])..self.ends[face],
        }
    }

    /// The corners from `first` on become a face; fewer than three are taken back. Says whether it was kept.
    fn end_face(&mut self, first: usize) -> bool {
        let corners = self.corners.len() - first;
        if corners < 3 {
            self.corners.truncate(first);
            self.short += 1;
            return false;
        }
        if corners != 3 && self.ends.is_empty() {
            self.ends = (3..=first).step_by(3).collect();
        }
        if corners != 3 || !self.ends.is_empty() {
            self.ends.push(self.corners.len());
        }
        true
    }

    fn triangle_count(&self) -> usize {
        self.corners.len() - 2 * self.len()
    }

    fn triangulated(self, positions: &[DVec3]) -> Self {
        if self.ends.is_empty() {
            return self;
        }
        let mut corners = Vec::with_capacity(3 * self.triangle_count());
        let mut faces = Vec::with_capacity(self.triangle_count());
        let mut triangulator = Triangulator::default();
        let mut outline: Vec<DVec3> = Vec::new();
        for face in 0..self.len() {
            let range = self.range(face);
            let first = range.start;
            outline.clear();
            outline.extend(self.corners[range].iter().map(|&v| positions[v as usize]));
            triangulator.triangulate(&outline, |t| {
                corners.extend(t.map(|k| first + k));
                faces.push(face);
            });
        }
        Self {
            corners: gathered(&self.corners, &corners, 0),
            ends: Vec::new(),
            corner_uvs: gathered(&self.corner_uvs, &corners, Vec2::ZERO),
            colors_srgb: gathered(&self.colors_srgb, &faces, Vec4::ONE),
            textures: gathered(&self.textures, &faces, 0),
            short: self.short,
        }
    }
}

/// The values at these indices; empty where there are none at all.
fn gathered<T: Copy>(values: &[T], indices: &[usize], missing: T) -> Vec<T> {
    if values.is_empty() {
        return Vec::new();
    }
    indices.iter().map(|&i| values.get(i).copied().unwrap_or(missing)).collect()
}

fn read(file: &SourceFile, header: &Header) -> Result<Content> {
    let rest = &file.bytes[header.data_offset..];
    match header.encoding {
        Encoding::LittleEndian => read_elements(file, header, Binary::<false> { rest }),
        Encoding::BigEndian => read_elements(file, header, Binary::<true> { rest }),
        Encoding::Ascii => read_elements(file, header, Words { rest, line: header.line_count + 1 }),
    }
}

fn read_elements(file: &SourceFile, header: &Header, mut source: impl NumberSource) -> Result<Content> {
    let mut content = Content::default();
    let vertices = header.elements.iter().find(|e| e.name == "vertex").ok_or_else(no_positions)?;
    let vertex_count = vertices.count as usize;
    for element in &header.elements {
        check_count(element, header.encoding, source.left())?;
        let mut rows = Rows { file, vertex_count, element, row: 0, source: &mut source };
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
    content.trailing = source.trailing();
    Ok(content)
}

/// Refuses counts that the rest of the file cannot hold, before anything is allocated for them.
fn check_count(element: &Element, encoding: Encoding, left: u64) -> Result<()> {
    let needed = element.count.saturating_mul(element.min_row_bytes(encoding));
    if needed <= left {
        return Ok(());
    }
    let elements = counted(element.count, "element");
    let (needed, follow) = (counted(needed, "byte"), if left == 1 { "follows" } else { "follow" });
    Err(Error::malformed(format!(
        "its header announces {elements} {:?}, at least {needed}, but only {left} {follow}; it is truncated or damaged",
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
    let index = first_bad(&face).copied().map_or(-1.0, f64::from);
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

#[derive(Clone, Copy, PartialEq, Eq)]
enum FaceColumn {
    /// A list.
    Vertices,
    /// A list.
    TextureCoordinates,
    TextureNumber,
    Color(usize),
    Ignored,
}

fn face_column(property: &Property) -> FaceColumn {
    match (property.name.as_str(), property.list_length.is_some()) {
        ("vertex_indices" | "vertex_index", true) => FaceColumn::Vertices,
        ("texcoord", true) => FaceColumn::TextureCoordinates,
        ("texnumber", false) => FaceColumn::TextureNumber,
        (name, false) => color_slot(name).map_or(FaceColumn::Ignored, FaceColumn::Color),
        _ => FaceColumn::Ignored,
    }
}

struct Rows<'a, S> {
    file: &'a SourceFile<'a>,
    vertex_count: usize,
    element: &'a Element,
    row: u64,
    source: &'a mut S,
}

impl<S: NumberSource> Rows<'_, S> {
    fn failed(&self, error: SourceError) -> Error {
        let (Element { name, count, .. }, row) = (self.element, self.row);
        Error::malformed(match error {
            SourceError::End => {
                format!("the file ends in {name} {row} of {count}; it is truncated or damaged")
            }
            SourceError::NotANumber(line, found) => {
                format!("{name} {row}, line {line}: expected a number, found {found:?}")
            }
        })
    }

    #[inline]
    fn next(&mut self, scalar: Scalar) -> Result<f64> {
        self.source.next(scalar).map_err(|error| self.failed(error))
    }

    #[inline]
    fn length(&mut self, property: &Property) -> Result<u64> {
        property.list_length.map_or(Ok(1), |length| self.next(length).map(|n| n as u64))
    }

    fn skip(&mut self, property: &Property) -> Result<()> {
        let count = self.length(property)?;
        self.source.skip(property.scalar, count).map_err(|error| self.failed(error))
    }

    /// Calls `read` for every row. Rows without properties take no bytes, so their number is not to be believed.
    fn each(&mut self, mut read: impl FnMut(&mut Self) -> Result<()>) -> Result<()> {
        let count = if self.element.properties.is_empty() { 0 } else { self.element.count };
        (0..count).try_for_each(|row| {
            self.row = row;
            self.file.tell(row, self.source.left() as usize);
            read(self)
        })
    }

    fn skip_all(&mut self) -> Result<()> {
        let properties = &self.element.properties;
        self.each(|rows| properties.iter().try_for_each(|property| rows.skip(property)))
    }

    fn read_vertices(&mut self, content: &mut Content) -> Result<()> {
        let element = self.element;
        let slot = |p: &Property| if p.list_length.is_some() { IGNORED } else { vertex_slot(&p.name) };
        let slots: Vec<usize> = element.properties.iter().map(slot).collect();
        let has = |slot: usize, count: usize| (slot..slot + count).all(|s| slots.contains(&s));
        if !has(0, 3) {
            return Err(no_positions());
        }
        self.file.check_positions(usize::try_from(element.count).unwrap_or(usize::MAX))?;
        let (has_normals, has_uvs, has_colors) = (has(3, 3), has(6, 2), has(8, 3));
        // What stands for 1 in each of the four colour columns.
        let units: [f64; 4] = std::array::from_fn(|channel| {
            let column = slots.iter().position(|&slot| slot == 8 + channel);
            column.map_or(1.0, |column| element.properties[column].scalar.color_unit())
        });
        content.positions.reserve(element.count as usize);
        self.each(|rows| {
            let mut values = [0.0; SLOTS];
            // Without an alpha column colours are opaque.
            values[11] = units[3];
            for (property, &slot) in element.properties.iter().zip(&slots) {
                match property.list_length {
                    None => values[slot] = rows.next(property.scalar)?,
                    Some(_) => rows.skip(property)?,
                }
            }
            let [x, y, z, nx, ny, nz, s, t, color @ .., _] = values;
            content.positions.push(DVec3::new(x, y, z));
            if has_normals {
                content.normals.push(DVec3::new(nx, ny, nz).as_vec3());
            }
            if has_uvs {
                content.uvs.push(Vec2::new(s as f32, t as f32));
            }
            if has_colors {
                let color: [f64; 4] = color;
                content.colors_srgb.push(Vec4::from(std::array::from_fn(|k| (color[k] / units[k]) as f32)));
            }
            Ok(())
        })
    }

    fn read_faces(&mut self, faces: &mut Faces) -> Result<()> {
        let columns: Vec<FaceColumn> = self.element.properties.iter().map(face_column).collect();
        if !columns.contains(&FaceColumn::Vertices) {
            return self.skip_all();
        }
        let expected = (self.element.count as usize).min(self.file.limits.max_triangles);
        faces.corners.reserve(expected.saturating_mul(3));
        self.each(|rows| {
            rows.read_face(&columns, faces)?;
            rows.check_triangles(faces)
        })
    }

    /// Ends reading as soon as there are too many triangles: a corner takes more memory than its byte in the file.
    #[inline]
    fn check_triangles(&self, faces: &Faces) -> Result<()> {
        let count = faces.triangle_count();
        match count > self.file.limits.max_triangles {
            true => self.file.check_triangles(count),
            false => Ok(()),
        }
    }

    fn read_face(&mut self, columns: &[FaceColumn], faces: &mut Faces) -> Result<()> {
        let (face, first) = (faces.len(), faces.corners.len());
        let mut rgba: Option<Vec4> = None;
        let mut texture = None;
        let mut uvs = Vec::new();
        for (property, column) in self.element.properties.iter().zip(columns) {
            match column {
                FaceColumn::Vertices => self.read_corners(property, faces)?,
                FaceColumn::TextureCoordinates => uvs = self.read_uvs(property)?,
                FaceColumn::TextureNumber => texture = Some(self.next(property.scalar)? as i64),
                FaceColumn::Color(channel) => {
                    let value = self.next(property.scalar)? / property.scalar.color_unit();
                    rgba.get_or_insert(Vec4::ONE)[*channel] = value as f32;
                }
                FaceColumn::Ignored => self.skip(property)?,
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
        if uvs.len() == faces.corners.len() - first {
            pad(&mut faces.corner_uvs, first, Vec2::ZERO);
            faces.corner_uvs.extend(uvs);
        }
        Ok(())
    }

    #[inline]
    fn read_corners(&mut self, property: &Property, faces: &mut Faces) -> Result<()> {
        let corners = self.length(property)?;
        let limit = self.file.limits.max_face_corners;
        if corners > limit as u64 {
            let face = self.row;
            let sentence = format!("face {face} has {corners} corners, more than the limit of {limit}");
            return Err(Error::too_large(sentence));
        }
        for _ in 0..corners {
            let index = self.next(property.scalar)?;
            faces.corners.push(self.vertex(index)?);
        }
        Ok(())
    }

    /// An index as what it should be, a whole number.
    #[inline]
    fn vertex(&self, index: f64) -> Result<u32> {
        let vertex = index as u32;
        match f64::from(vertex) == index {
            true => Ok(vertex),
            false => Err(index_out_of_range(self.row, index, self.vertex_count)),
        }
    }

    /// Texture coordinates of a face, a flat list of pairs.
    fn read_uvs(&mut self, property: &Property) -> Result<Vec<Vec2>> {
        let numbers = self.length(property)?;
        let most = (self.file.limits.max_face_corners as u64).min(self.source.left());
        let mut uvs = Vec::with_capacity((numbers / 2).min(most) as usize);
        for _ in 0..numbers / 2 {
            uvs.push(Vec2::new(self.next(property.scalar)? as f32, self.next(property.scalar)? as f32));
        }
        self.source.skip(property.scalar, numbers % 2).map_err(|error| self.failed(error))?;
        Ok(uvs)
    }

    /// Each strip is a list of vertices; a negative index ends a strip and begins the next within the same list.
    fn read_strips(&mut self, faces: &mut Faces) -> Result<()> {
        let properties = &self.element.properties;
        self.each(|rows| {
            properties.iter().try_for_each(|property| match face_column(property) {
                FaceColumn::Vertices => rows.read_strip(property, faces),
                _ => rows.skip(property),
            })
        })
    }

    fn read_strip(&mut self, property: &Property, faces: &mut Faces) -> Result<()> {
        let mut window: Vec<u32> = Vec::with_capacity(3);
        let mut is_turned = false;
        for _ in 0..self.length(property)? {
            let index = self.next(property.scalar)?;
            if index < 0.0 {
                window.clear();
                is_turned = false;
                continue;
            }
            window.push(self.vertex(index)?);
            if let [a, b, c] = window[..] {
                // Strips are stitched together by triangles with a repeated vertex, which mean nothing.
                if a != b && b != c && c != a {
                    let first = faces.corners.len();
                    faces.corners.extend(if is_turned { [b, a, c] } else { [a, b, c] });
                    faces.end_face(first);
                    self.check_triangles(faces)?;
                }
                window.remove(0);
                is_turned = !is_turned;
            }
        }
        Ok(())
    }
}

// From a PLY file's tables to a model.

/// Colours of 0..255, of 0..1. Alpha may have either range, or none.
fn bytes_as_shares(colors: &mut [Vec4]) {
    let has_bytes = colors.iter().any(|color| color.w > 1.0);
    for color in colors {
        *color = (color.truncate() / 255.0).extend(if has_bytes { color.w / 255.0 } else { color.w });
    }
}

fn build(file: &SourceFile, header: &Header, mut content: Content) -> Result<Model> {
    file.check_triangles(content.faces.triangle_count())?;
    let mut model = Model::default();
    for (kind, colors) in
        [("vertex colour", &content.colors_srgb), ("face colour", &content.faces.colors_srgb)]
    {
        model.notes.extend(broken_colors_note(kind, colors.iter().map(|color| color.is_finite())));
    }
    let mut faces = content.faces.triangulated(&content.positions);
    let count = faces.len();
    if !content.normals.is_empty() {
        model.corners.normals = faces.corners.iter().map(|&v| content.normals[v as usize]).collect();
    }
    // To the top left origin.
    let flipped = |uv: Vec2| Vec2::new(uv.x, 1.0 - uv.y);
    if !faces.corner_uvs.is_empty() {
        pad(&mut faces.corner_uvs, 3 * count, Vec2::ZERO);
        model.corners.uv_sets = vec![faces.corner_uvs.iter().map(|&uv| flipped(uv)).collect()];
    } else if !content.uvs.is_empty() {
        let uv = |&v: &u32| flipped(content.uvs[v as usize]);
        model.corners.uv_sets = vec![faces.corners.iter().map(uv).collect()];
    }
    for colors in [&mut content.colors_srgb, &mut faces.colors_srgb] {
        if are_bytes(colors.iter().map(|color| color.truncate())) {
            bytes_as_shares(colors);
            model.notes.push("colours are floats of 0..255, and taken as such".to_owned());
        }
    }
    let linear = |color_srgb: &Vec4| linear_rgba(color_srgb.truncate(), color_srgb.w);
    if !content.colors_srgb.is_empty() {
        let colors: Vec<Vec4> = content.colors_srgb.par_iter().map(linear).collect();
        model.corners.colors = faces.corners.iter().map(|&v| colors[v as usize]).collect();
    } else if !faces.colors_srgb.is_empty() {
        pad(&mut faces.colors_srgb, count, Vec4::ONE);
        model.corners.colors = faces.colors_srgb.iter().flat_map(|color| [linear(color); 3]).collect();
    }
    attach_textures(&mut model, file, header, &mut faces)?;
    if faces.short > 0 {
        let short = counted(faces.short, "face");
        model.notes.push(format!("skipped {short} with fewer than three corners"));
    }
    if !content.skipped_elements.is_empty() {
        let list = content.skipped_elements.join(", ");
        model.notes.push(format!("elements that fantex does not use were skipped: {list}"));
    }
    if let Some((first, count)) = &header.unknown {
        let lines = counted(*count, "header line");
        model.notes.push(format!("skipped {lines} with an unknown keyword, the first is line {first}"));
    }
    if content.trailing > 0 {
        let bytes = counted(content.trailing, "byte");
        model.notes.push(format!(
            "ignored {bytes} after the last element: the header announces fewer rows or columns than there are"
        ));
    }
    model.triangles = faces.corners.as_chunks::<3>().0.to_vec();
    model.positions = content.positions;
    Ok(model)
}

/// One material per `TextureFile` comment; faces choose by `texnumber`, where a negative number stands for no texture.
fn attach_textures(model: &mut Model, file: &SourceFile, header: &Header, faces: &mut Faces) -> Result<()> {
    if header.texture_files.is_empty() || model.corners.uv_sets.is_empty() {
        return Ok(());
    }
    // MeshLab's word for the name of the file itself.
    let stem = file.path.file_stem().unwrap_or_default().to_string_lossy();
    let names = header.texture_files.iter().map(|name| name.replace("<this>", &stem));
    for (image, name) in names.enumerate() {
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
        let path = relative_path(&name).unwrap_or_else(|| PathBuf::from(&name));
        model.images.push(ImageSource::File(locate(file.path, &path)?));
    }
    let files = header.texture_files.len();
    let has_plain = faces.textures.iter().any(|&texture| texture < 0);
    if has_plain {
        model.materials.push(Material { place: "a negative texnumber".to_owned(), ..Material::default() });
    }
    if files > 1 || has_plain {
        let count = faces.len();
        pad(&mut faces.textures, count, 0);
        let material =
            |&texture: &i64| usize::try_from(texture).map_or(files, |texture| texture.min(files - 1));
        model.triangle_materials = faces.textures.iter().map(|texture| material(texture) as u32).collect();
    }
    Ok(())
}
