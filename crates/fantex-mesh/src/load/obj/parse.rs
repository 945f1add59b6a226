//! Reading the lines of an OBJ file.

use std::borrow::Cow;
use std::collections::HashMap;

use glam::{DVec3, Vec2, Vec3};

use super::{ObjProblem, line_end, number, shown, words};
use crate::counted;
use crate::load::{LoadError, SourceFile};

/// Marks a corner without texture coordinate or normal.
pub(super) const NONE: u32 = u32::MAX;

/// Indices of one face corner, from 0.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    pub(super) position: u32,
    /// Or [`NONE`].
    pub(super) uv: u32,
    /// Or [`NONE`].
    pub(super) normal: u32,
}

/// A polygon: a run of corners.
#[derive(Clone, Copy)]
pub(super) struct Face {
    pub(super) first_corner: usize,
    pub(super) corner_count: u32,
    /// Index into [`ObjText::material_names`].
    pub(super) material: u32,
}

/// An OBJ file's content as written; all indices are in range.
#[derive(Default)]
pub(super) struct ObjText {
    pub(super) positions: Vec<DVec3>,
    /// One per position, or empty. As written: sRGB.
    pub(super) colors_srgb: Vec<Vec3>,
    /// v upwards, as written.
    pub(super) uvs: Vec<Vec2>,
    pub(super) normals: Vec<Vec3>,
    pub(super) corners: Vec<Corner>,
    pub(super) faces: Vec<Face>,
    /// Triangles that the faces will become.
    pub(super) triangle_count: usize,
    /// Names after `usemtl`, each once; the first is "" for faces before any.
    pub(super) material_names: Vec<String>,
    /// Names after `mtllib`.
    pub(super) libraries: Vec<String>,
    pub(super) notes: Vec<String>,
}

/// Reads all lines.
pub(super) fn parse(file: &SourceFile) -> Result<ObjText, LoadError> {
    let mut parser = Parser::new(file);
    let mut rest = file.bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(file.bytes);
    let line_end = line_end(rest);
    while !rest.is_empty() {
        let (line, lines) = take_line(&mut rest, line_end);
        parser.read_line(&line).map_err(|problem| parser.located(problem))?;
        parser.line += lines;
        parser.check_limits()?;
    }
    parser.finish()
}

/// Takes a line off `rest`, joined with those that a backslash at its end continues. Also says how many it took.
fn take_line<'a>(rest: &mut &'a [u8], line_end: u8) -> (Cow<'a, [u8]>, usize) {
    let first = take_physical_line(rest, line_end);
    let Some(start) = first.strip_suffix(b"\\") else {
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

/// An index that points forward: known to be good only at the end of the file.
#[derive(Clone, Copy, Default)]
struct Highest {
    index: usize,
    line: usize,
}

struct Parser<'a> {
    file: &'a SourceFile<'a>,
    text: ObjText,
    /// The line being read, from 1.
    line: usize,
    material: u32,
    material_of_name: HashMap<String, u32>,
    /// Highest position, texture coordinate and normal (counted from 1) that a face refers to.
    highest: [Highest; 3],
    points_and_lines: usize,
    short_faces: usize,
    unknown: usize,
    first_unknown: Option<(usize, String)>,
}

/// What a face corner refers to, in the order in which it is written.
const REFERENTS: [&str; 3] = ["position", "texture coordinate", "normal"];

impl<'a> Parser<'a> {
    fn new(file: &'a SourceFile<'a>) -> Self {
        let text = ObjText { material_names: vec![String::new()], ..ObjText::default() };
        Self {
            file,
            text,
            line: 1,
            material: 0,
            material_of_name: HashMap::from([(String::new(), 0)]),
            highest: [Highest::default(); 3],
            points_and_lines: 0,
            short_faces: 0,
            unknown: 0,
            first_unknown: None,
        }
    }

    fn located(&self, problem: ObjProblem) -> LoadError {
        LoadError::Obj { path: self.file.path.into(), line: self.line, problem }
    }

    fn read_line(&mut self, line: &[u8]) -> Result<(), ObjProblem> {
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
            // Names and smoothing groups: corners carry their own normals, and parts are told apart by material only.
            b"o" | b"g" | b"s" | b"" => Ok(()),
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
    fn read_position(&mut self, arguments: &[u8]) -> Result<(), ObjProblem> {
        let mut numbers = [0.0; 7];
        let count = read_numbers("v", 3, arguments, &mut numbers)?;
        let [x, y, z, r, g, b, _] = numbers;
        self.text.positions.push(DVec3::new(x, y, z));
        if count >= 6 {
            let before = self.text.positions.len() - 1;
            crate::load::builder::pad(&mut self.text.colors_srgb, before, Vec3::ONE);
            self.text.colors_srgb.push(DVec3::new(r, g, b).as_vec3());
        }
        Ok(())
    }

    fn read_uv(&mut self, arguments: &[u8]) -> Result<(), ObjProblem> {
        let mut numbers = [0.0; 2];
        read_numbers("vt", 1, arguments, &mut numbers)?;
        self.text.uvs.push(Vec2::from(numbers.map(|x| x as f32)));
        Ok(())
    }

    fn read_normal(&mut self, arguments: &[u8]) -> Result<(), ObjProblem> {
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

    fn read_face(&mut self, arguments: &[u8]) -> Result<(), ObjProblem> {
        let first_corner = self.text.corners.len();
        for word in words(arguments).take_while(|word| word[0] != b'#') {
            let corner = self.read_corner(word)?;
            self.text.corners.push(corner);
        }
        let corners = self.text.corners.len() - first_corner;
        if corners < 3 {
            self.short_faces += 1;
            self.text.corners.truncate(first_corner);
            return Ok(());
        }
        let limit = self.file.limits.max_face_corners;
        if corners > limit {
            return Err(ObjProblem::FaceTooLarge { corners, limit });
        }
        self.text.faces.push(Face { first_corner, corner_count: corners as u32, material: self.material });
        self.text.triangle_count += corners - 2;
        Ok(())
    }

    /// `p`, `p/t`, `p//n`, `p/t/n`, each index from 1 or negative; empty parts are missing parts.
    fn read_corner(&mut self, word: &[u8]) -> Result<Corner, ObjProblem> {
        let malformed = || ObjProblem::Corner { found: shown(word) };
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
    fn resolve(&mut self, referent: usize, written: i64) -> Result<u32, ObjProblem> {
        let counts = self.counts();
        let count = counts[referent];
        let out_of_range = || ObjProblem::Index { what: REFERENTS[referent], index: written, count };
        let from_one = if written < 0 { count as i64 + 1 + written } else { written };
        // Position counts are limited to less than 2^32, so nothing beyond can be defined later either.
        if from_one < 1 || from_one >= i64::from(NONE) {
            return Err(out_of_range());
        }
        let highest = &mut self.highest[referent];
        if from_one as usize > highest.index {
            *highest = Highest { index: from_one as usize, line: self.line };
        }
        Ok((from_one - 1) as u32)
    }

    /// How many positions, texture coordinates and normals are defined so far.
    fn counts(&self) -> [usize; 3] {
        [self.text.positions.len(), self.text.uvs.len(), self.text.normals.len()]
    }

    fn check_limits(&self) -> Result<(), LoadError> {
        self.file.check_positions(self.counts().into_iter().max().unwrap_or(0))?;
        self.file.check_triangles(self.text.triangle_count)
    }

    fn finish(mut self) -> Result<ObjText, LoadError> {
        for ((count, highest), what) in self.counts().into_iter().zip(self.highest).zip(REFERENTS) {
            if highest.index > count {
                let problem = ObjProblem::Index { what, index: highest.index as i64, count };
                return Err(LoadError::Obj { path: self.file.path.into(), line: highest.line, problem });
            }
        }
        self.write_notes();
        Ok(self.text)
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

/// Reads up to `numbers.len()` numbers and says how many there were; anything after a `#` is a comment.
fn read_numbers(
    keyword: &'static str,
    needed: usize,
    arguments: &[u8],
    numbers: &mut [f64],
) -> Result<usize, ObjProblem> {
    let mut found = 0;
    for (slot, word) in numbers.iter_mut().zip(words(arguments).take_while(|word| word[0] != b'#')) {
        *slot = number(word)?;
        found += 1;
    }
    if found < needed {
        return Err(ObjProblem::TooFewNumbers { keyword, needed, found });
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
