//! From an OBJ file's lines to a model.

use glam::{DVec3, Vec2, Vec4};
use rayon::prelude::*;

use super::mtl::Library;
use super::parse::{Corner, NONE, ObjText};
use crate::load::polygon::Triangulator;
use crate::load::{LoadError, SourceFile, builder, srgb};
use crate::{Material, Model, counted};

/// Cuts the polygons and spreads attributes over the corners.
pub(super) fn build(file: &SourceFile, mut text: ObjText, library: Library) -> Result<Model, LoadError> {
    file.check_triangles(text.triangle_count)?;
    let (corners, triangle_materials) = cut_polygons(&text);
    let mut model = Model { notes: std::mem::take(&mut text.notes), ..Model::default() };
    spread_attributes(&mut model, &text, &corners);
    model.triangles =
        corners.chunks_exact(3).map(|c| [c[0].position, c[1].position, c[2].position]).collect();
    model.positions = text.positions;
    assign_materials(&mut model, &text.material_names, triangle_materials, library);
    builder::finish(&mut model);
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

/// Linear colours per position. Files whose colours exceed 1 hold bytes in decimal.
fn linear_colors(text: &ObjText, notes: &mut Vec<String>) -> Vec<Vec4> {
    let broken = text.colors_srgb.iter().filter(|c| !c.is_finite()).count();
    if broken > 0 {
        notes.push(format!("made {} white that had no numbers", counted(broken, "vertex colour")));
    }
    let is_bytes = text.colors_srgb.iter().any(|c| c.is_finite() && c.max_element() > 1.0);
    if is_bytes {
        notes.push("vertex colours exceed 1 and were read as 0..255".to_owned());
    }
    let scale = if is_bytes { 1.0 / 255.0 } else { 1.0 };
    text.colors_srgb.par_iter().map(|&c| srgb::linear_rgba(c * scale, 1.0)).collect()
}

/// Replaces material names by indices; a name without a definition becomes a default material of that name.
fn assign_materials(model: &mut Model, names: &[String], of_triangle: Vec<u32>, library: Library) {
    model.notes.extend(library.notes);
    model.images = library.images;
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
