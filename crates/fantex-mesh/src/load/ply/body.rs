//! Reading the rows.

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::header::{Element, Encoding, Header, Scalar};
use super::source::{Ascii, Binary, NumberSource, SourceError};
use super::{PlyProblem, located};
use crate::load::builder::pad;
use crate::load::{LoadError, SourceFile};

/// The tables that matter, as the file has them; all vertex indices are in range.
#[derive(Default)]
pub(super) struct Content {
    pub(super) positions: Vec<DVec3>,
    /// One per position, or empty; likewise the next two.
    pub(super) normals: Vec<Vec3>,
    /// v upwards, as written.
    pub(super) uvs: Vec<Vec2>,
    /// sRGB with linear alpha, 0..1.
    pub(super) colors_srgb: Vec<Vec4>,
    pub(super) faces: Faces,
    /// `COUNT NAME` of elements that were not used.
    pub(super) skipped_elements: Vec<String>,
}

/// Polygons with any number of corners.
#[derive(Default)]
pub(super) struct Faces {
    /// Vertex indices of all faces, one after the other.
    pub(super) corners: Vec<u32>,
    /// Where each face's corners end in `corners`. Empty as long as all faces are triangles.
    ends: Vec<usize>,
    is_mixed: bool,
    /// One per corner (v upwards), or empty.
    pub(super) corner_uvs: Vec<Vec2>,
    /// sRGB, one per face, or empty.
    pub(super) colors_srgb: Vec<Vec4>,
    /// Texture of each face, or empty.
    pub(super) textures: Vec<i64>,
    /// Faces with fewer than three corners.
    pub(super) short: u64,
}

impl Faces {
    pub(super) fn len(&self) -> usize {
        if self.is_mixed { self.ends.len() } else { self.corners.len() / 3 }
    }

    /// The range in `corners` of a face.
    pub(super) fn range(&self, face: usize) -> std::ops::Range<usize> {
        match self.is_mixed {
            true => face.checked_sub(1).map_or(0, |before| self.ends[before])..self.ends[face],
            false => 3 * face..3 * face + 3,
        }
    }

    /// Triangles that the polygons will become.
    pub(super) fn triangle_count(&self) -> usize {
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
pub(super) fn read(file: &SourceFile, header: &Header) -> Result<Content, LoadError> {
    let rest = &file.bytes[header.data_offset..];
    match header.encoding {
        Encoding::LittleEndian => read_elements(file, header, Binary::<false> { rest }),
        Encoding::BigEndian => read_elements(file, header, Binary::<true> { rest }),
        Encoding::Ascii => read_elements(file, header, Ascii { rest, line: header.line_count + 1 }),
    }
}

fn read_elements(
    file: &SourceFile,
    header: &Header,
    mut source: impl NumberSource,
) -> Result<Content, LoadError> {
    let mut content = Content::default();
    let vertices = header.elements.iter().find(|e| e.name == "vertex").ok_or(PlyProblem::NoPositions);
    let vertex_count = vertices.map_err(|problem| located(file, problem))?.count as usize;
    for element in &header.elements {
        check_count(element, header.encoding, source.left()).map_err(|problem| located(file, problem))?;
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
    check_indices(file, &content)?;
    Ok(content)
}

/// Refuses counts that the rest of the file cannot hold, before anything is allocated for them.
fn check_count(element: &Element, encoding: Encoding, left: u64) -> Result<(), PlyProblem> {
    let needed = element.count.saturating_mul(element.min_row_bytes(encoding));
    if needed <= left {
        return Ok(());
    }
    Err(PlyProblem::Count { element: element.name.clone(), count: element.count, needed, left })
}

fn check_indices(file: &SourceFile, content: &Content) -> Result<(), LoadError> {
    let count = content.positions.len();
    let corners = &content.faces.corners;
    if corners.iter().max().is_none_or(|&highest| (highest as usize) < count) {
        return Ok(());
    }
    let first_bad = |face: &usize| corners[content.faces.range(*face)].iter().find(|&&v| v as usize >= count);
    let face = (0..content.faces.len()).find(|face| first_bad(face).is_some()).unwrap_or_default();
    let index = first_bad(&face).copied().map_or(-1, i64::from);
    Err(located(file, PlyProblem::Index { face: face as u64, index, count }))
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
    fn failed(&self, row: u64, error: SourceError) -> LoadError {
        let element = self.element.name.clone();
        let problem = match error {
            SourceError::End => PlyProblem::Truncated { element, row, count: self.element.count },
            SourceError::NotANumber(line, found) => PlyProblem::Number { element, row, line, found },
        };
        located(self.file, problem)
    }

    fn skip_all(&mut self) -> Result<(), LoadError> {
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

    fn read_vertices(&mut self, content: &mut Content) -> Result<(), LoadError> {
        let element = self.element;
        let slots: Vec<usize> = element
            .properties
            .iter()
            .map(|p| if p.list_length.is_some() { IGNORED } else { vertex_slot(&p.name) })
            .collect();
        let has = |slot: usize, count: usize| (slot..slot + count).all(|s| slots.contains(&s));
        if !has(0, 3) {
            return Err(located(self.file, PlyProblem::NoPositions));
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

    fn read_faces(&mut self, faces: &mut Faces) -> Result<(), LoadError> {
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

    fn read_face(&mut self, row: u64, columns: &[FaceColumn], faces: &mut Faces) -> Result<(), LoadError> {
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
    fn read_corners(
        &mut self,
        face: u64,
        length: Scalar,
        scalar: Scalar,
        faces: &mut Faces,
    ) -> Result<(), LoadError> {
        let corners = self.source.next(length).map_err(|e| self.failed(face, e))? as u64;
        let limit = self.file.limits.max_face_corners;
        if corners > limit as u64 {
            return Err(located(self.file, PlyProblem::FaceTooLarge { face, corners, limit }));
        }
        for _ in 0..corners {
            let index = self.source.next(scalar).map_err(|e| self.failed(face, e))?;
            let vertex = index as u32;
            if f64::from(vertex) != index {
                let problem = PlyProblem::Index { face, index: index as i64, count: self.vertex_count };
                return Err(located(self.file, problem));
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
    fn read_strips(&mut self, faces: &mut Faces) -> Result<(), LoadError> {
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

    fn read_strip(
        &mut self,
        strip: u64,
        length: Scalar,
        scalar: Scalar,
        faces: &mut Faces,
    ) -> Result<(), LoadError> {
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
                let problem =
                    PlyProblem::Index { face: strip, index: index as i64, count: self.vertex_count };
                return Err(located(self.file, problem));
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
