//! From a PLY file's tables to a model.

use std::path::PathBuf;

use glam::{DVec3, Mat3, Vec2, Vec4};
use rayon::prelude::*;

use super::body::{Content, Faces};
use super::header::Header;
use crate::load::polygon::Triangulator;
use crate::load::{LoadError, SourceFile, builder, locate, relative_path, srgb};
use crate::{ImageSource, Material, Model, TextureRef, WrapMode, counted};

/// Cuts the polygons and spreads attributes over the corners.
pub(super) fn build(file: &SourceFile, header: &Header, content: Content) -> Result<Model, LoadError> {
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
    builder::finish(&mut model);
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
    srgb::linear_rgba(color_srgb.truncate(), color_srgb.w)
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
