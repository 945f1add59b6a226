//! From a texel on a mesh to what textures are asked by.

use fantex_mesh::Mesh;
use fantex_texture::material::vertex_color;
use fantex_texture::{Filtering, ShadingPoint, UvPoint};
use glam::{Vec2, Vec3};

use crate::SurfacePoint;

/// Sets of texture coordinates that need no allocation per texel.
const INLINE_SETS: usize = 4;

/// What all points of a mesh have in common.
#[derive(Debug)]
pub(super) struct PointFinder<'a> {
    pub(super) mesh: &'a Mesh,
    /// Unit vectors, per corner.
    pub(super) normals: Vec<Vec3>,
    /// Seconds.
    pub(super) time: f32,
}

impl PointFinder<'_> {
    /// Asks at a texel: object space, averaging over the texel, without an eye.
    pub(super) fn at<R>(&self, point: &SurfacePoint, ask: impl FnOnce(&ShadingPoint<'_>) -> R) -> R {
        let sets = &self.mesh.corners.uv_sets;
        let (mut inline, heap);
        let uv = if sets.len() <= INLINE_SETS {
            inline = [UvPoint::default(); INLINE_SETS];
            inline.iter_mut().zip(sets).for_each(|(uv, set)| *uv = uv_point(set, point));
            &inline[..sets.len()]
        } else {
            heap = sets.iter().map(|set| uv_point(set, point)).collect::<Vec<_>>();
            &heap
        };
        ask(&self.shading_point(point, uv))
    }

    /// As [`PointFinder::at`], at many texels together.
    pub(super) fn at_all<R>(&self, points: &[SurfacePoint], ask: impl FnOnce(&[ShadingPoint<'_>]) -> R) -> R {
        let sets = &self.mesh.corners.uv_sets;
        let uv: Vec<UvPoint> =
            points.iter().flat_map(|point| sets.iter().map(|set| uv_point(set, point))).collect();
        let of = |index: usize| &uv[index * sets.len()..(index + 1) * sets.len()];
        let at: Vec<ShadingPoint<'_>> =
            points.iter().enumerate().map(|(index, point)| self.shading_point(point, of(index))).collect();
        ask(&at)
    }

    fn shading_point<'u>(&self, point: &SurfacePoint, uv: &'u [UvPoint]) -> ShadingPoint<'u> {
        let scale = self.mesh.world_from_mesh.scale as f32;
        // Off the triangle, colours must not be extrapolated.
        let inside = point.lambda.clamp(Vec3::ZERO, Vec3::ONE);
        ShadingPoint {
            position: point.position * scale,
            position_steps: point.position_steps.map(|step| step * scale),
            normal: point.normal,
            normal_steps: self.normal_steps(point),
            uv,
            vertex_color: vertex_color(self.mesh, point.triangle, inside),
            to_eye: None,
            time: self.time,
            filtering: Filtering::Area,
        }
    }

    /// Derivatives of the normalised blend of the corners' normals.
    fn normal_steps(&self, point: &SurfacePoint) -> [Vec3; 2] {
        let corners = [0, 1, 2].map(|k| self.normals[3 * point.triangle + k]);
        let blend = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
        let length = blend(point.lambda).length().max(1e-3);
        point.lambda_steps.map(|step| {
            let change = blend(step) / length;
            change - point.normal * point.normal.dot(change)
        })
    }
}

fn uv_point(set: &[Vec2], point: &SurfacePoint) -> UvPoint {
    let Some(corners) = set.get(3 * point.triangle..3 * point.triangle + 3) else {
        return UvPoint::default();
    };
    let blend = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
    UvPoint { uv: blend(point.lambda), steps: point.lambda_steps.map(blend) }
}
