//! The model's own texture coordinates.

use std::collections::HashMap;

use fantex_mesh::Mesh;
use glam::Vec2;
use rayon::prelude::*;

use super::{Layout, Page, Placed};
use crate::error::ExportError;

/// Pictures that a triangle's coordinates may reach over.
const MOST_REPEATS: i32 = 64;

/// The texture coordinates that the asset kept of its model.
pub(crate) fn uv_of_asset(mesh: &Mesh) -> Result<Vec<[Vec2; 3]>, ExportError> {
    let uv = mesh.corners.uv_sets.first().filter(|uv| uv.len() == 3 * mesh.triangles.len());
    uv.map(|uv| uv.as_chunks().0.to_vec()).ok_or(ExportError::NoUv)
}

/// The texture coordinates of a model with the same triangles, in whatever order.
///
/// # Errors
///
/// The model has none, or a triangle of the asset is not one of its triangles.
pub(crate) fn uv_of_model(mesh: &Mesh, model: &Mesh) -> Result<Vec<[Vec2; 3]>, ExportError> {
    let uv = uv_of_asset(model).map_err(|_| ExportError::NoUvInModel)?;
    // Both are rounded to the same grid, so that equal points are equal whatever their mesh space is.
    let scale = mesh.world_from_mesh.scale.abs() * MATCH_SHARE;
    let key = |mesh: &Mesh, t: usize| {
        let points = mesh.triangles[t].map(|v| {
            let world = mesh.world_from_mesh.point(mesh.positions[v as usize]);
            (world / scale).round().to_array().map(|x| x as i64)
        });
        let first = (0..3).min_by_key(|&k| points[k]).unwrap_or(0);
        ([points[first], points[(first + 1) % 3], points[(first + 2) % 3]], first)
    };
    let mut by_key = HashMap::with_capacity(model.triangles.len());
    for t in 0..model.triangles.len() {
        let (points, first) = key(model, t);
        by_key.entry(points).or_insert((t, first));
    }
    let found = |t: usize| {
        let (points, first) = key(mesh, t);
        let &(other, other_first) = by_key.get(&points).ok_or(ExportError::OtherModel { triangle: t })?;
        Ok([0, 1, 2].map(|k| uv[other][(k + 3 - first + other_first) % 3]))
    };
    // Collected as they are: a parallel collection into one `Result` names any of the errors, not the first.
    let all: Vec<Result<_, _>> = (0..mesh.triangles.len()).into_par_iter().map(found).collect();
    all.into_iter().collect()
}

/// Positions closer than this share of the model's half size count as equal.
const MATCH_SHARE: f64 = 1e-5;

/// Lays the triangles out by given coordinates: a picture for every material, since materials may use the same coordinates.
///
/// # Errors
///
/// Coordinates that are not finite, or reach over too many pictures.
pub(crate) fn model_uv(
    mesh: &Mesh,
    uv: Vec<[Vec2; 3]>,
    texels_per_unit: f32,
    side: Option<u32>,
    largest_side: u32,
) -> Result<Layout, ExportError> {
    let mut by_material: Vec<Vec<u32>> = vec![Vec::new(); mesh.materials.len().max(1)];
    (0..mesh.triangles.len()).for_each(|t| by_material[mesh.material_of(t)].push(t as u32));
    let mut layout = Layout { page_of_material: vec![None; by_material.len()], ..Layout::default() };
    let (mut texels, mut area) = (0.0, 0.0);
    for (material, triangles) in by_material.iter().enumerate().filter(|(_, t)| !t.is_empty()) {
        let size =
            |area_of: &dyn Fn(usize) -> f32| -> f32 { triangles.iter().map(|&t| area_of(t as usize)).sum() };
        let uv_area = size(&|t| 0.5 * (uv[t][1] - uv[t][0]).perp_dot(uv[t][2] - uv[t][0]).abs());
        let mesh_area = size(&|t| 0.5 * crate::charts::doubled_area(mesh, t));
        let wanted = texels_per_unit * (mesh_area / uv_area.max(1e-12)).sqrt();
        let side = side.unwrap_or_else(|| {
            // A few percent are not worth four times the texels.
            let wanted = (wanted * 0.9).clamp(64.0, largest_side as f32).ceil() as u32;
            wanted.next_power_of_two().min(largest_side)
        });
        texels += uv_area * (side as f32).powi(2);
        area += mesh_area;
        let mut page = Page { side, block: side, ..Page::default() };
        for &t in triangles {
            layout.repeats |= place(t, uv[t as usize], &mut page)?;
        }
        layout.page_of_material[material] = Some(layout.pages.len());
        layout.pages.push(page);
    }
    layout.texels_per_unit = (texels / area.max(f32::MIN_POSITIVE)).sqrt();
    layout.uv = uv;
    Ok(layout)
}

/// Puts a triangle into a picture as often as its repetitions meet it. True where it goes beyond 0..1.
fn place(triangle: u32, uv: [Vec2; 3], page: &mut Page) -> Result<bool, ExportError> {
    let (low, high) = (uv[0].min(uv[1]).min(uv[2]), uv[0].max(uv[1]).max(uv[2]));
    let range =
        || ExportError::UvRange { triangle: triangle as usize, low: low.to_array(), high: high.to_array() };
    if !(low.is_finite() && high.is_finite() && low.abs().max(high.abs()).max_element() < 1e6) {
        return Err(range());
    }
    let first = low.floor().as_ivec2();
    let last = (high.ceil().as_ivec2() - 1).max(first);
    let count = last - first + 1;
    if count.x.max(count.y) > MOST_REPEATS {
        return Err(range());
    }
    for y in first.y..=last.y {
        for x in first.x..=last.x {
            let shift = Vec2::new(x as f32, y as f32);
            let corners = uv.map(|c| (c - shift) * page.side as f32);
            page.placed.push(Placed { triangle, chart: 0, corners, is_beyond: false });
        }
    }
    Ok(first != glam::IVec2::ZERO || last != glam::IVec2::ZERO)
}
