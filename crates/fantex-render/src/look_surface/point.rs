//! From a hit to the point that textures are asked at.

use fantex_mesh::Mesh;
use fantex_texture::material::vertex_color;
use fantex_texture::{Filtering, ShadingPoint, Texture, UvPoint};
use glam::{Vec2, Vec3, Vec4};

use crate::Hit;
use crate::normals::CornerNormals;

/// Most sets of texture coordinates that textures see.
pub(super) const MAX_UV_SETS: usize = 4;

/// What a [`ShadingPoint`] borrows, and the rest of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    position: Vec3,
    position_steps: [Vec3; 2],
    normal: Vec3,
    normal_steps: [Vec3; 2],
    uv: [UvPoint; MAX_UV_SETS],
    uv_sets: usize,
    vertex_color: Vec4,
    to_eye: Vec3,
    time: f32,
}

impl SurfacePoint {
    pub(super) fn new(mesh: &Mesh, normals: &CornerNormals, hit: &Hit, time: f32) -> Self {
        let world_per_mesh = mesh.world_from_mesh.scale as f32;
        let positions = mesh.triangle_positions(hit.triangle).map(|p| p * world_per_mesh);
        let steps = [hit.dlambda_dx, hit.dlambda_dy];
        let (normal, normal_steps) = smooth_normal(mesh, normals, hit);
        let mut uv = [UvPoint::default(); MAX_UV_SETS];
        let sets = &mesh.corners.uv_sets;
        for (point, set) in uv.iter_mut().zip(sets) {
            if let Some(corners) = set.get(3 * hit.triangle..).and_then(|rest| rest.first_chunk::<3>()) {
                let (at, steps) = hit.blend_coordinates(*corners);
                *point = UvPoint { uv: at, steps };
            }
        }
        Self {
            position: hit.blend(positions),
            position_steps: steps.map(|l| positions[0] * l.x + positions[1] * l.y + positions[2] * l.z),
            normal,
            normal_steps,
            uv,
            uv_sets: sets.len().min(MAX_UV_SETS),
            vertex_color: vertex_color(mesh, hit.triangle, hit.lambda),
            to_eye: hit.to_eye,
            time,
        }
    }

    pub(super) fn shading_point(&self) -> ShadingPoint<'_> {
        ShadingPoint {
            position: self.position,
            position_steps: self.position_steps,
            normal: self.normal,
            normal_steps: self.normal_steps,
            uv: &self.uv[..self.uv_sets],
            vertex_color: self.vertex_color,
            to_eye: Some(self.to_eye),
            time: self.time,
            filtering: Filtering::Own,
        }
    }
}

/// The interpolated unit normal on the side that is seen, and its change along the footprint's edges: of `b / |b|` that is
/// `(db - n (n . db)) / |b|`.
fn smooth_normal(mesh: &Mesh, normals: &CornerNormals, hit: &Hit) -> (Vec3, [Vec3; 2]) {
    let side = if hit.front { 1.0 } else { -1.0 };
    let normal = normals.at(mesh, hit) * side;
    let corners = [0, 1, 2].map(|k| normals.all()[3 * hit.triangle + k] * side);
    let length = hit.blend(corners).length().max(1e-3);
    let steps = [hit.dlambda_dx, hit.dlambda_dy].map(|l| {
        let change = corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
        (change - normal * normal.dot(change)) / length
    });
    (normal, steps)
}

/// The value of a texture at the point moved by `offset` along the footprint's edges, over a footprint that is `share` times
/// as wide.
pub(super) fn evaluate_beside(texture: &dyn Texture, at: &ShadingPoint, offset: Vec2, share: f32) -> Vec4 {
    let mut uv = [UvPoint::default(); MAX_UV_SETS];
    for (moved, own) in uv.iter_mut().zip(at.uv) {
        let [x, y] = own.steps;
        *moved = UvPoint { uv: own.uv + x * offset.x + y * offset.y, steps: [x * share, y * share] };
    }
    let [x, y] = at.position_steps;
    let [normal_x, normal_y] = at.normal_steps;
    let normal = at.normal + normal_x * offset.x + normal_y * offset.y;
    texture.evaluate(&ShadingPoint {
        position: at.position + x * offset.x + y * offset.y,
        position_steps: [x * share, y * share],
        normal: normal.normalize_or(at.normal),
        normal_steps: [normal_x * share, normal_y * share],
        uv: &uv[..at.uv.len().min(MAX_UV_SETS)],
        ..*at
    })
}

/// Point `i` of an even spread over the footprint, each coordinate in -0.5..0.5: the additive recurrence on the plastic
/// number (M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
pub(super) fn spread(i: usize) -> Vec2 {
    const STEP: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);
    (STEP * i as f32 + 0.5).fract() - 0.5
}
