//! What all loaders do with corner attributes: parts of a model that lack one are filled in, and normals and tangents
//! are made unit vectors, so that whoever uses them need not check.

use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::Model;

/// Appends to an array of corner attributes that may be missing for earlier corners: `fill` stands in there.
pub(crate) fn pad<T: Clone>(values: &mut Vec<T>, corners: usize, fill: T) {
    if values.len() < corners {
        values.resize(corners, fill);
    }
}

/// Brings all attribute arrays to three entries per triangle (or none). Normals that are missing, zero or not finite
/// become the triangle's own normal; such tangents follow the first UV set. Colours become white, coordinates zero.
pub(crate) fn finish(model: &mut Model) {
    let corners = 3 * model.triangles.len();
    let attributes = &mut model.corners;
    pad_if_present(&mut attributes.normals, corners, Vec3::ZERO);
    pad_if_present(&mut attributes.colors, corners, Vec4::ONE);
    pad_if_present(&mut attributes.tangents, corners, Vec4::ZERO);
    attributes.uv_sets.iter_mut().for_each(|set| pad(set, corners, Vec2::ZERO));
    if !model.triangle_materials.is_empty() {
        pad(&mut model.triangle_materials, model.triangles.len(), 0);
    }
    if model.materials.is_empty() {
        model.materials.push(crate::Material::default());
    }
    drop_textures_without_coordinates(model);
    make_normals_unit(model);
    make_tangents_unit(model);
}

/// A texture needs coordinates to be looked up with; one that names a set the model lacks is left out.
fn drop_textures_without_coordinates(model: &mut Model) {
    let sets = model.corners.uv_sets.len();
    for (index, material) in model.materials.iter_mut().enumerate() {
        let textures = [
            &mut material.base_color_texture,
            &mut material.metallic_roughness_texture,
            &mut material.normal_texture,
            &mut material.occlusion_texture,
            &mut material.emission_texture,
        ];
        for texture in textures {
            if let Some(dropped) = texture.take_if(|t| t.uv_set >= sets) {
                let set = dropped.uv_set;
                model.notes.push(format!(
                    "material {index}: a texture was left out, because the model has no texture coordinates {set}"
                ));
            }
        }
    }
}

fn pad_if_present<T: Clone>(values: &mut Vec<T>, corners: usize, fill: T) {
    if !values.is_empty() {
        pad(values, corners, fill);
    }
}

fn make_normals_unit(model: &mut Model) {
    let (positions, triangles) = (&model.positions, &model.triangles);
    model.corners.normals.par_chunks_exact_mut(3).zip(triangles).for_each(|(normals, triangle)| {
        for normal in normals {
            *normal = normal.try_normalize().unwrap_or_else(|| {
                let [a, b, c] = triangle.map(|v| positions[v as usize]);
                (b - a).cross(c - a).try_normalize().map_or(Vec3::Z, |n| n.as_vec3())
            });
        }
    });
}

fn make_tangents_unit(model: &mut Model) {
    let mut tangents = std::mem::take(&mut model.corners.tangents);
    tangents.par_chunks_exact_mut(3).enumerate().for_each(|(triangle, tangents)| {
        for (k, tangent) in tangents.iter_mut().enumerate() {
            let handedness = if tangent.w < 0.0 { -1.0 } else { 1.0 };
            *tangent = match tangent.truncate().try_normalize() {
                Some(unit) => unit.extend(handedness),
                None => tangent_from_uv(model, triangle, k),
            };
        }
    });
    model.corners.tangents = tangents;
}

/// The direction in which u grows, orthogonal to the corner's normal. In glTF the bitangent `w * cross(n, t)` points
/// against v, because v runs downwards and normal maps have +y up.
fn tangent_from_uv(model: &Model, triangle: usize, k: usize) -> Vec4 {
    let corner = 3 * triangle + k;
    let [a, b, c] = model.triangles[triangle].map(|v| model.positions[v as usize]);
    let (e1, e2) = ((b - a).as_vec3(), (c - a).as_vec3());
    let normal = match model.corners.normals.get(corner) {
        Some(&normal) => normal,
        None => e1.cross(e2).try_normalize().unwrap_or(Vec3::Z),
    };
    let [d1, d2] = match model.corners.uv_sets.first() {
        Some(uv) => [1, 2].map(|i| uv[3 * triangle + i] - uv[3 * triangle]),
        None => [Vec2::ZERO; 2],
    };
    let determinant = d1.perp_dot(d2);
    let along_u = (e1 * d2.y - e2 * d1.y) * determinant.signum();
    let against_v = (e1 * d2.x - e2 * d1.x) * determinant.signum();
    let tangent = along_u.reject_from_normalized(normal).try_normalize();
    let tangent = tangent.unwrap_or_else(|| normal.any_orthonormal_vector());
    let handedness = if normal.cross(tangent).dot(against_v) < 0.0 { -1.0 } else { 1.0 };
    tangent.extend(handedness)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A unit square's half seen from +z, u to the right, v downwards.
    fn half_square() -> Model {
        Model {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            corners: crate::CornerAttributes {
                normals: vec![Vec3::ZERO; 3],
                uv_sets: vec![vec![Vec2::new(0., 1.), Vec2::new(1., 1.), Vec2::new(0., 0.)]],
                tangents: vec![Vec4::ZERO],
                ..Default::default()
            },
            ..Default::default()
        }
    }

    #[test]
    fn missing_normals_and_tangents_follow_the_triangle() {
        let mut model = half_square();
        finish(&mut model);
        assert_eq!(model.corners.normals, [Vec3::Z; 3]);
        assert_eq!(model.corners.tangents, [Vec4::new(1., 0., 0., 1.); 3]);
        assert_eq!(model.materials.len(), 1);
    }

    #[test]
    fn mirrored_coordinates_turn_the_handedness() {
        let mut model = half_square();
        for uv in &mut model.corners.uv_sets[0] {
            uv.x = 1.0 - uv.x;
        }
        finish(&mut model);
        assert_eq!(model.corners.tangents, [Vec4::new(-1., 0., 0., -1.); 3]);
    }

    #[test]
    fn degenerate_triangles_get_finite_vectors() {
        let mut model = half_square();
        model.positions = vec![DVec3::splat(f64::NAN); 3];
        finish(&mut model);
        assert!(model.corners.normals.iter().all(|n| n.is_normalized()));
        assert!(model.corners.tangents.iter().all(|t| t.truncate().is_normalized()));
    }
}
