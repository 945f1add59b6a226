//! Normals and tangents of triangles that have none, in a model whose other triangles have some.
//!
//! They are worked out as if those triangles were a model of their own, so that a part looks the same whatever else is in its file.

use fantex_base::{Result, counted, input};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::{POSITION_BYTES, TRIANGLE_BYTES};
use crate::{
    CleanOptions, CornerOrigins, Mesh, Model, TextureRef, clean_traced, corner_tangents, shading_normals,
};

/// Gives triangles without any normal those that a mesh without normals is [shaded](shading_normals) with.
pub(super) fn smooth_missing_normals(model: &mut Model) -> Result<()> {
    let missing = lacking(&model.corners.normals, |normal: &Vec3| normal.try_normalize().is_none());
    let Some(apart) = Apart::of(model, missing, "normals")? else { return Ok(()) };
    for (corner, normal) in shading_normals(&apart.mesh).into_iter().enumerate() {
        model.corners.normals[apart.corner(corner)] = normal;
    }
    Ok(())
}

/// Gives triangles that have a normal map and no tangents those of the normal map's coordinates.
pub(super) fn fill_missing_tangents(model: &mut Model) -> Result<()> {
    let is_none = |tangent: &Vec4| tangent.truncate().try_normalize().is_none();
    let mut missing = lacking(&model.corners.tangents, is_none);
    missing.retain(|&triangle| normal_texture(model, triangle).is_some());
    let Some(apart) = Apart::of(model, missing, "tangents")? else { return Ok(()) };
    let corners = 0..3 * apart.mesh.triangles.len();
    let normals: Vec<Vec3> = match model.corners.normals.is_empty() {
        true => shading_normals(&apart.mesh),
        false => corners.map(|corner| model.corners.normals[apart.corner(corner)]).collect(),
    };
    let uv_of = |t: usize| -> Option<[Vec2; 3]> {
        let texture = normal_texture(model, apart.triangle(t))?;
        let set = model.corners.uv_sets.get(texture.uv_set)?;
        Some([0, 1, 2].map(|k| texture.uv_transform.transform_point2(set[apart.corner(3 * t + k)])))
    };
    let tangents = corner_tangents(&apart.mesh, &normals, uv_of);
    for (corner, tangent) in tangents.into_iter().enumerate() {
        model.corners.tangents[apart.corner(corner)] = tangent;
    }
    Ok(())
}

fn normal_texture(model: &Model, triangle: u32) -> Option<&TextureRef> {
    let material = model.triangle_materials.get(triangle as usize).copied().unwrap_or(0);
    model.materials.get(material as usize)?.normal_texture.as_ref()
}

/// The triangles none of whose three corners has a value.
fn lacking<T: Sync>(values: &[T], is_none: impl Fn(&T) -> bool + Sync) -> Vec<u32> {
    let triangles = values.par_chunks_exact(3).enumerate().with_min_len(1 << 12);
    let lacking = triangles.filter(|(_, corners)| corners.iter().all(&is_none));
    lacking.map(|(triangle, _)| triangle as u32).collect()
}

/// Some triangles of a model as a mesh.
struct Apart {
    mesh: Mesh,
    origins: CornerOrigins,
    /// Those of the model that were given to cleaning.
    triangles: Vec<u32>,
}

impl Apart {
    /// Nothing where there are no triangles, or no mesh can be made of them.
    fn of(model: &Model, triangles: Vec<u32>, lacked: &str) -> Result<Option<Self>> {
        if triangles.is_empty() {
            return Ok(None);
        }
        let positions = model.positions.len().min(3 * triangles.len()) as u64;
        let bytes = triangles.len() as u64 * TRIANGLE_BYTES + positions * POSITION_BYTES;
        let count = counted(triangles.len(), "triangle");
        let _held = input::reserve(format_args!("{count} without {lacked}"), bytes)?;
        let mut apart = Model::default();
        let mut renumbered = vec![u32::MAX; model.positions.len()];
        for &triangle in &triangles {
            let renumber = |vertex: u32| {
                let new = &mut renumbered[vertex as usize];
                if *new == u32::MAX {
                    *new = apart.positions.len() as u32;
                    apart.positions.push(model.positions[vertex as usize]);
                }
                *new
            };
            apart.triangles.push(model.triangles[triangle as usize].map(renumber));
        }
        let cleaned = clean_traced(apart, &CleanOptions::default()).ok();
        Ok(cleaned.map(|(mesh, _, origins)| Self { mesh, origins, triangles }))
    }

    /// The model's triangle that a triangle of the mesh is.
    fn triangle(&self, triangle: usize) -> u32 {
        self.triangles[self.origins.triangle(triangle)]
    }

    /// The model's corner that a corner of the mesh is.
    fn corner(&self, corner: usize) -> usize {
        let triangle = corner / 3;
        3 * self.triangle(triangle) as usize + self.origins.corner(triangle, corner % 3)
    }
}
