//! Wavefront OBJ with MTL ("Object Files (.obj)", Advanced Visualizer manual, appendix B1, Wavefront, about 1992).
//!
//! ```text
//!  text --parse--> ObjText (numbers and faces as written) --build--> Model
//!  MTL  --mtl----> materials, images --------------------------^
//! ```

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use fantex_base::{Error, Place, Result, counted};
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::counts::there_are;
use crate::load::mtl::{Library, load_libraries};
use crate::load::polygon::Triangulator;
use crate::load::{SourceFile, are_bytes, broken_colors_note, linear_rgba, pad, parsed_number, shown};
use crate::{Material, Model, Parts};

pub(super) fn load(file: &SourceFile) -> Result<Model> {
    let text = parse(file)?;
    let library = load_libraries(file, &text.libraries)?;
    build(file, text, library)
}

pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

pub(super) fn number(word: &[u8]) -> Result<f64> {
    parsed_number(word).ok_or_else(|| not_a_number(word))
}

pub(super) fn not_a_number(word: &[u8]) -> Error {
    Error::malformed(format!("expected a number, found {:?}", shown(word)))
}

pub(super) fn too_few_numbers(keyword: &str, needed: usize, found: usize) -> Error {
    let needed = counted(needed, "number");
    Error::malformed(format!("{keyword} needs at least {needed}, but has {found}"))
}

pub(super) fn at_line(error: Error, line: usize, path: &Path) -> Error {
    error.at(Place::Line(line as u64)).in_file(path)
}

/// What ends the lines of a text: a line feed, maybe after a carriage return, or, in files of old systems, which hold no line
/// feed at all, a carriage return.
pub(super) fn line_end(text: &[u8]) -> u8 {
    if text.contains(&b'\n') { b'\n' } else { b'\r' }
}

// Reading the lines of an OBJ file.

/// Marks a position without a colour, which becomes white.
const UNCOLORED: Vec3 = Vec3::NEG_INFINITY;

/// Marks a corner without texture coordinate or normal.
const NONE: u32 = u32::MAX;

/// Indices of one face corner, from 0.
#[derive(Clone, Copy)]
struct Corner {
    position: u32,
    /// Or [`NONE`].
    uv: u32,
    /// Or [`NONE`].
    normal: u32,
}

#[derive(Clone, Copy)]
struct Face {
    first_corner: usize,
    corner_count: u32,
    material: u32,
}

/// An OBJ file's content as written; all indices are in range.
#[derive(Default)]
struct ObjText {
    positions: Vec<DVec3>,
    /// One per position, or empty; what is missing at the end is [`UNCOLORED`]. As written: sRGB.
    colors_srgb: Vec<Vec3>,
    /// v upwards, as written.
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    corners: Vec<Corner>,
    faces: Vec<Face>,
    triangle_count: usize,
    /// Names after `usemtl`, each once; the first is "" for faces before any.
    material_names: Vec<String>,
    libraries: Vec<String>,
    /// After `o` and after `g`.
    objects: Sections,
    groups: Sections,
    notes: Vec<String>,
}

/// Names that hold for the faces that follow.
#[derive(Default)]
struct Sections {
    /// Each once; the first is "" for faces before any.
    names: Vec<String>,
    index_of_name: HashMap<String, u32>,
    /// First face and name, ascending.
    starts: Vec<(usize, u32)>,
}

impl Sections {
    fn start(&mut self, face: usize, name: &[u8]) {
        let name = String::from_utf8_lossy(name).into_owned();
        if self.names.is_empty() {
            self.names.push(String::new());
            self.index_of_name.insert(String::new(), 0);
        }
        let names = &mut self.names;
        let index = *self.index_of_name.entry(name).or_insert_with_key(|name| {
            names.push(name.clone());
            names.len() as u32 - 1
        });
        match self.starts.last_mut() {
            Some(last) if last.0 == face => last.1 = index,
            _ => self.starts.push((face, index)),
        }
    }

    /// Names that faces have, in their order, and that of each triangle.
    fn parts(self, faces: &[Face]) -> Parts {
        let mut parts = Parts::default();
        if self.names.is_empty() {
            return parts;
        }
        let mut part_of_name = vec![None; self.names.len()];
        let mut starts = self.starts.into_iter().peekable();
        let mut name = 0;
        for (number, face) in faces.iter().enumerate() {
            while let Some((_, started)) = starts.next_if(|&(first, _)| first <= number) {
                name = started;
            }
            let part = *part_of_name[name as usize].get_or_insert_with(|| {
                parts.names.push(self.names[name as usize].clone());
                parts.names.len() as u32 - 1
            });
            let triangles = parts.of_triangle.len() + face.corner_count as usize - 2;
            parts.of_triangle.resize(triangles, part);
        }
        parts
    }
}

fn parse(file: &SourceFile) -> Result<ObjText> {
    let mut parser = Parser::new(file);
    let mut rest = file.bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(file.bytes);
    let line_end = line_end(rest);
    while !rest.is_empty() {
        file.tell(parser.line as u64, rest.len());
        let (line, lines) = take_line(&mut rest, line_end);
        parser.read_line(&line).map_err(|error| at_line(error, parser.line, file.path))?;
        parser.line += lines;
        parser.check_limits()?;
    }
    parser.finish()
}

/// Takes a line off `rest`, joined with those that a backslash at its end continues, unless it is a comment. Also says how many it took.
fn take_line<'a>(rest: &mut &'a [u8], line_end: u8) -> (Cow<'a, [u8]>, usize) {
    let first = take_physical_line(rest, line_end);
    let is_comment = first.trim_ascii_start().starts_with(b"#");
    let Some(start) = first.strip_suffix(b"\\").filter(|_| !is_comment) else {
        return (Cow::Borrowed(first), 1);
    };
    let mut joined = start.to_vec();
    let mut lines = 1;
    while !rest.is_empty() {
        let next = take_physical_line(rest, line_end);
        lines += 1;
        joined.push(b' ');
        match next.strip_suffix(b"\\") {
            Some(start) => joined.extend_from_slice(start),
            None => {
                joined.extend_from_slice(next);
                break;
            }
        }
    }
    (Cow::Owned(joined), lines)
}

fn take_physical_line<'a>(rest: &mut &'a [u8], line_end: u8) -> &'a [u8] {
    let end = rest.iter().position(|&b| b == line_end);
    let line = &rest[..end.unwrap_or(rest.len())];
    *rest = end.map_or(&[], |end| &rest[end + 1..]);
    line.trim_ascii_end()
}

struct Parser<'a> {
    file: &'a SourceFile<'a>,
    text: ObjText,
    /// The line being read, from 1.
    line: usize,
    material: u32,
    material_of_name: HashMap<String, u32>,
    /// Highest position, texture coordinate and normal (counted from 1) that a face refers to, and the line: an index that
    /// points forward is known to be good only at the end of the file.
    highest: [(usize, usize); 3],
    points_and_lines: usize,
    short_faces: usize,
    unknown: usize,
    first_unknown: Option<(usize, String)>,
}

/// What a face corner refers to, in the order in which it is written.
const REFERENTS: [&str; 3] = ["position", "texture coordinate", "normal"];
const POSITION: usize = 0;
const NORMAL: usize = 2;

impl<'a> Parser<'a> {
    fn new(file: &'a SourceFile<'a>) -> Self {
        let text = ObjText { material_names: vec![String::new()], ..ObjText::default() };
        Self {
            file,
            text,
            line: 1,
            material: 0,
            material_of_name: HashMap::from([(String::new(), 0)]),
            highest: [(0, 0); 3],
            points_and_lines: 0,
            short_faces: 0,
            unknown: 0,
            first_unknown: None,
        }
    }

    fn read_line(&mut self, line: &[u8]) -> Result<()> {
        let line = line.trim_ascii_start();
        let keyword = &line[..line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len())];
        let arguments = line[keyword.len()..].trim_ascii();
        match keyword {
            b"v" => self.read_position(arguments),
            b"vt" => self.read_uv(arguments),
            b"vn" => self.read_normal(arguments),
            b"f" | b"fo" => self.read_face(arguments),
            b"usemtl" => {
                self.use_material(arguments);
                Ok(())
            }
            b"mtllib" => {
                self.text.libraries.push(String::from_utf8_lossy(arguments).into_owned());
                Ok(())
            }
            b"l" | b"p" => {
                self.points_and_lines += 1;
                Ok(())
            }
            b"o" | b"g" => {
                let faces = self.text.faces.len();
                let sections = if keyword == b"o" { &mut self.text.objects } else { &mut self.text.groups };
                sections.start(faces, arguments);
                Ok(())
            }
            // Smoothing groups: corners carry their own normals.
            b"s" | b"" => Ok(()),
            _ if keyword[0] == b'#' => Ok(()),
            _ => {
                self.unknown += 1;
                let line = self.line;
                self.first_unknown.get_or_insert_with(|| (line, shown(keyword)));
                Ok(())
            }
        }
    }

    /// `v x y z`, `v x y z w`, `v x y z r g b`, `v x y z r g b a` (alpha is not kept).
    fn read_position(&mut self, arguments: &[u8]) -> Result<()> {
        let mut numbers = [0.0; 7];
        let count = read_numbers("v", 3, arguments, &mut numbers)?;
        let [x, y, z, r, g, b, _] = numbers;
        self.text.positions.push(DVec3::new(x, y, z));
        if count >= 6 {
            let before = self.text.positions.len() - 1;
            pad(&mut self.text.colors_srgb, before, UNCOLORED);
            self.text.colors_srgb.push(DVec3::new(r, g, b).as_vec3());
        }
        Ok(())
    }

    fn read_uv(&mut self, arguments: &[u8]) -> Result<()> {
        let mut numbers = [0.0; 2];
        read_numbers("vt", 1, arguments, &mut numbers)?;
        self.text.uvs.push(Vec2::from(numbers.map(|x| x as f32)));
        Ok(())
    }

    fn read_normal(&mut self, arguments: &[u8]) -> Result<()> {
        let mut numbers = [0.0; 3];
        read_numbers("vn", 3, arguments, &mut numbers)?;
        self.text.normals.push(Vec3::from(numbers.map(|x| x as f32)));
        Ok(())
    }

    fn use_material(&mut self, name: &[u8]) {
        let name = String::from_utf8_lossy(name).into_owned();
        let names = &mut self.text.material_names;
        self.material = *self.material_of_name.entry(name).or_insert_with_key(|name| {
            names.push(name.clone());
            names.len() as u32 - 1
        });
    }

    fn read_face(&mut self, arguments: &[u8]) -> Result<()> {
        let first_corner = self.text.corners.len();
        let limit = self.file.limits.max_face_corners;
        for word in words(arguments).take_while(|word| word[0] != b'#') {
            let corner = self.read_corner(word)?;
            self.text.corners.push(corner);
            // At once: a line may be as long as the file.
            let corners = self.text.corners.len() - first_corner;
            if corners > limit {
                return Err(Error::too_large(format!(
                    "the face has at least {corners} corners, more than the limit of {limit}"
                )));
            }
        }
        let corners = self.text.corners.len() - first_corner;
        if corners < 3 {
            self.short_faces += 1;
            self.text.corners.truncate(first_corner);
            return Ok(());
        }
        self.text.faces.push(Face { first_corner, corner_count: corners as u32, material: self.material });
        self.text.triangle_count += corners - 2;
        Ok(())
    }

    /// `p`, `p/t`, `p//n`, `p/t/n`, each index from 1 or negative; empty parts are missing parts.
    fn read_corner(&mut self, word: &[u8]) -> Result<Corner> {
        let malformed = || {
            let found = shown(word);
            Error::malformed(format!("expected a face corner like 1, 1/2, 1//3 or 1/2/3, found {found:?}"))
        };
        let mut indices = [NONE; 3];
        let mut parts = word.split(|&b| b == b'/');
        for (referent, index) in indices.iter_mut().enumerate() {
            if let Some(part) = parts.next().filter(|part| !part.is_empty()) {
                let written = integer(part).ok_or_else(malformed)?;
                *index = self.resolve(referent, written)?;
            }
        }
        let [position, uv, normal] = indices;
        if position == NONE || parts.next().is_some() {
            return Err(malformed());
        }
        Ok(Corner { position, uv, normal })
    }

    /// Index from 0 of what a face refers to. Whether a positive index is in range shows at the end of the file.
    fn resolve(&mut self, referent: usize, written: i64) -> Result<u32> {
        let counts = self.counts();
        let count = counts[referent];
        let out_of_range = || index_out_of_range(REFERENTS[referent], written, count);
        let from_one = if written < 0 { count as i64 + 1 + written } else { written };
        // Position counts are limited to less than 2^32, so nothing beyond can be defined later either.
        if from_one < 1 || from_one >= i64::from(NONE) {
            return Err(out_of_range());
        }
        let highest = &mut self.highest[referent];
        if from_one as usize > highest.0 {
            *highest = (from_one as usize, self.line);
        }
        Ok((from_one - 1) as u32)
    }

    /// How many positions, texture coordinates and normals are defined so far.
    fn counts(&self) -> [usize; 3] {
        [self.text.positions.len(), self.text.uvs.len(), self.text.normals.len()]
    }

    fn check_limits(&self) -> Result<()> {
        self.file.check_positions(self.counts().into_iter().max().unwrap_or(0))?;
        self.file.check_triangles(self.text.triangle_count)
    }

    fn finish(mut self) -> Result<ObjText> {
        let counts = self.counts();
        for (referent, what) in REFERENTS.into_iter().enumerate() {
            let (count, (index, line)) = (counts[referent], self.highest[referent]);
            if index > count && (count > 0 || referent == POSITION) {
                let error = index_out_of_range(what, index as i64, count);
                return Err(at_line(error, line, self.file.path));
            }
            if index > count {
                self.leave_out(referent);
            }
        }
        self.write_notes();
        Ok(self.text)
    }

    /// Takes back references to what the file has none of: some programs write their numbers all the same.
    fn leave_out(&mut self, referent: usize) {
        for corner in &mut self.text.corners {
            *if referent == NORMAL { &mut corner.normal } else { &mut corner.uv } = NONE;
        }
        let what = REFERENTS[referent];
        self.text.notes.push(format!("faces refer to {what}s, but there are none, and were read without"));
    }

    fn write_notes(&mut self) {
        let notes = &mut self.text.notes;
        if self.points_and_lines > 0 {
            notes.push(format!("skipped {} of points or lines", counted(self.points_and_lines, "element")));
        }
        if self.short_faces > 0 {
            notes
                .push(format!("skipped {} with fewer than three corners", counted(self.short_faces, "face")));
        }
        if let Some((line, keyword)) = &self.first_unknown {
            let lines = counted(self.unknown, "line");
            notes.push(format!(
                "skipped {lines} with an unknown keyword, the first is line {line}: {keyword}"
            ));
        }
    }
}

fn index_out_of_range(what: &str, index: i64, count: usize) -> Error {
    let there_are = there_are(count);
    Error::malformed(format!(
        "the face refers to {what} {index}, but {there_are} (counting starts at 1, or at -1 backwards)"
    ))
}

/// Reads up to `numbers.len()` numbers and says how many there were; anything after a `#` is a comment.
fn read_numbers(keyword: &str, needed: usize, arguments: &[u8], numbers: &mut [f64]) -> Result<usize> {
    let mut found = 0;
    for (slot, word) in numbers.iter_mut().zip(words(arguments).take_while(|word| word[0] != b'#')) {
        *slot = number(word)?;
        found += 1;
    }
    if found < needed {
        return Err(too_few_numbers(keyword, needed, found));
    }
    Ok(found)
}

/// A decimal integer that fits; plain loops, because faces are most of a large file.
fn integer(word: &[u8]) -> Option<i64> {
    let (digits, sign) = match word {
        [b'-', digits @ ..] => (digits, -1),
        [b'+', digits @ ..] => (digits, 1),
        digits => (digits, 1),
    };
    if digits.is_empty() || digits.len() > 18 {
        return None;
    }
    let value = digits
        .iter()
        .try_fold(0i64, |value, b| b.is_ascii_digit().then(|| value * 10 + i64::from(b - b'0')))?;
    Some(sign * value)
}

// From an OBJ file's lines to a model.

fn build(file: &SourceFile, mut text: ObjText, library: Library) -> Result<Model> {
    file.check_triangles(text.triangle_count)?;
    let (corners, triangle_materials) = cut_polygons(&text);
    let mut model = Model { notes: std::mem::take(&mut text.notes), ..Model::default() };
    spread_attributes(&mut model, &text, &corners);
    model.triangles =
        corners.chunks_exact(3).map(|c| [c[0].position, c[1].position, c[2].position]).collect();
    model.positions = text.positions;
    let sections = if text.objects.names.is_empty() { text.groups } else { text.objects };
    model.parts = sections.parts(&text.faces);
    assign_materials(&mut model, &text.material_names, triangle_materials, library);
    Ok(model)
}

/// The corners of all triangles, and each triangle's entry in the list of material names.
fn cut_polygons(text: &ObjText) -> (Vec<Corner>, Vec<u32>) {
    let mut corners = Vec::with_capacity(3 * text.triangle_count);
    let mut materials = Vec::with_capacity(text.triangle_count);
    let mut triangulator = Triangulator::default();
    let mut outline: Vec<DVec3> = Vec::new();
    for face in &text.faces {
        let polygon = &text.corners[face.first_corner..][..face.corner_count as usize];
        materials.resize(materials.len() + polygon.len() - 2, face.material);
        if polygon.len() == 3 {
            corners.extend_from_slice(polygon);
            continue;
        }
        outline.clear();
        outline.extend(polygon.iter().map(|c| text.positions[c.position as usize]));
        triangulator.triangulate(&outline, |t| corners.extend(t.map(|i| polygon[i])));
    }
    (corners, materials)
}

fn spread_attributes(model: &mut Model, text: &ObjText, corners: &[Corner]) {
    if corners.iter().any(|c| c.normal != NONE) {
        let normal = |c: &Corner| text.normals.get(c.normal as usize).copied().unwrap_or_default();
        model.corners.normals = corners.iter().map(normal).collect();
    }
    if corners.iter().any(|c| c.uv != NONE) {
        let uv =
            |c: &Corner| text.uvs.get(c.uv as usize).map_or(Vec2::ZERO, |uv| Vec2::new(uv.x, 1.0 - uv.y));
        model.corners.uv_sets = vec![corners.iter().map(uv).collect()];
    }
    if !text.colors_srgb.is_empty() {
        let colors = linear_colors(text, &mut model.notes);
        let color = |c: &Corner| colors.get(c.position as usize).copied().unwrap_or(Vec4::ONE);
        model.corners.colors = corners.iter().map(color).collect();
    }
}

/// Linear colours per position. Some files hold bytes in decimal.
fn linear_colors(text: &ObjText, notes: &mut Vec<String>) -> Vec<Vec4> {
    let are_numbers = text.colors_srgb.iter().map(|&c| c.is_finite() || c == UNCOLORED);
    notes.extend(broken_colors_note("vertex colour", are_numbers));
    let is_bytes = are_bytes(text.colors_srgb.iter().copied());
    if is_bytes {
        notes.push("vertex colours are numbers of 0..255, and taken as such".to_owned());
    }
    let scale = if is_bytes { 1.0 / 255.0 } else { 1.0 };
    let linear = |&c: &Vec3| if c == UNCOLORED { Vec4::ONE } else { linear_rgba(c * scale, 1.0) };
    text.colors_srgb.par_iter().map(linear).collect()
}

/// Replaces material names by indices; a name without a definition becomes a default material of that name.
fn assign_materials(model: &mut Model, names: &[String], of_triangle: Vec<u32>, library: Library) {
    model.notes.extend(library.notes);
    model.images = library.images;
    model.image_places = library.image_places;
    let mut index_of_name = vec![None; names.len()];
    model.triangle_materials = of_triangle;
    let mut undefined = Vec::new();
    for entry in &mut model.triangle_materials {
        let name = *entry as usize;
        *entry = *index_of_name[name].get_or_insert_with(|| {
            let defined = library.of_name.get(&names[name]).map(|&m| &library.materials[m]);
            if defined.is_none() && !names[name].is_empty() {
                undefined.push(names[name].as_str());
            }
            model.materials.push(defined.cloned().unwrap_or_else(|| named_default(&names[name])));
            (model.materials.len() - 1) as u32
        });
    }
    if !undefined.is_empty() {
        let (count, list) = (undefined.len(), undefined[..undefined.len().min(5)].join(", "));
        let rest = if count > 5 { ", ..." } else { "" };
        let materials = counted(count, "material");
        model.notes.push(format!("took the default for {materials} without a definition: {list}{rest}"));
    }
    if model.materials.len() <= 1 {
        model.triangle_materials.clear();
    }
}

fn named_default(name: &str) -> Material {
    Material { name: name.to_owned(), ..Material::default() }
}
