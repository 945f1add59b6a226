//! Textures on the surface: from a texel to what textures are asked by.

use fantex_cover::TexelTriangle;
use fantex_texture::material::vertex_color;
use fantex_texture::{Filtering, ShadingPoint, UvPoint};
use glam::{Vec2, Vec3};

use super::cover::blend;
use crate::Surface;

/// Asks a texture at a texel, given by its triangle and barycentric coordinates: in object space, averaging over the texel,
/// without an eye, at time 0.
pub(crate) fn shade<R>(
    surface: &Surface,
    triangle: &TexelTriangle,
    lambda: Vec3,
    ask: impl FnOnce(&ShadingPoint<'_>) -> R,
) -> R {
    let (mesh, index) = (surface.mesh(), triangle.triangle as usize);
    let scale = mesh.world_from_mesh.scale as f32;
    let position = |lambda: Vec3| blend(surface, triangle.triangle, lambda) * scale;
    let corners = [0, 1, 2].map(|k| surface.normals()[3 * index + k]);
    let blended = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
    let facet = || surface.facet_normal(triangle.triangle).as_vec3();
    let normal = blended(lambda).try_normalize().unwrap_or_else(facet);
    let length = blended(lambda).length().max(1e-3);
    let normal_steps = triangle.steps.map(|step| {
        let change = blended(step) / length;
        change - normal * normal.dot(change)
    });
    let uv_point = |set: &Vec<Vec2>| {
        let Some(corners) = set.get(3 * index..3 * index + 3) else { return UvPoint::default() };
        let blend = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
        UvPoint { uv: blend(lambda), steps: triangle.steps.map(blend) }
    };
    let uv: Vec<UvPoint> = mesh.corners.uv_sets.iter().map(uv_point).collect();
    ask(&ShadingPoint {
        position: position(lambda),
        position_steps: triangle.steps.map(position),
        normal,
        normal_steps,
        uv: &uv,
        // Off the triangle, colours must not be extrapolated.
        vertex_color: vertex_color(mesh, index, lambda.clamp(Vec3::ZERO, Vec3::ONE)),
        to_eye: None,
        time: 0.0,
        filtering: Filtering::Area,
    })
}
