//! Pictures that are thrown onto the surface, as by a slide projector.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::{Picture, Surface, SurfacePoint};

/// Where a picture is projected from. World space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectionView {
    /// The camera.
    pub eye: DVec3,
    /// What it looks at.
    pub target: DVec3,
    /// What is upright in the picture.
    pub up: DVec3,
    /// How wide it sees.
    pub lens: Lens,
}

/// The angle or the height that the picture spans.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Lens {
    /// Degrees between the picture's lower and upper border, above 0 and below 180.
    Perspective(f64),
    /// World units between them; all rays are parallel.
    Parallel(f64),
}

/// A picture through a camera. It lies on what the camera sees, and on nothing behind that.
#[derive(Clone, Debug)]
pub struct Projection {
    picture: Arc<Picture>,
    /// Mesh space.
    eye: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    /// Half the picture's height, at distance 1 or (parallel rays) everywhere, mesh units.
    half_height: f32,
    is_parallel: bool,
}

/// Cosines between the surface's normal and the way to the camera over which the picture fades in: what is seen edge-on would
/// be smeared.
const GRAZING: [f32; 2] = [0.05, 0.2];

/// Points of a texel whose sight is tested, in texels: corners of a square that is turned a little.
const SIGHTS: [[f32; 2]; 4] = [[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]];

impl Projection {
    /// None where the view has no direction, or a lens beyond its range.
    pub fn new(surface: &Surface, view: &ProjectionView, picture: Arc<Picture>) -> Option<Self> {
        let world_from_mesh = surface.mesh().world_from_mesh;
        let forward = (view.target - view.eye).try_normalize()?;
        let right = forward.cross(view.up).try_normalize()?;
        let (half_height, is_parallel) = match view.lens {
            Lens::Perspective(degrees) => ((0.5 * degrees.to_radians()).tan(), false),
            Lens::Parallel(height) => (0.5 * height / world_from_mesh.scale, true),
        };
        let in_range = half_height.is_finite() && half_height > 0.0 && half_height < 1e6;
        in_range.then(|| Self {
            picture,
            eye: world_from_mesh.inverse_point(view.eye),
            right: right.as_vec3(),
            up: right.cross(forward).as_vec3(),
            forward: forward.as_vec3(),
            half_height: half_height as f32,
            is_parallel,
        })
    }

    /// What the picture shows at a point, straight alpha; none where the point is not seen. `steps`: change of the position
    /// along a texel's sides, mesh units.
    pub(crate) fn at(&self, surface: &Surface, point: SurfacePoint, steps: [Vec3; 2]) -> Option<Vec4> {
        let position = surface.position(point).as_vec3();
        let (place, unit) = self.place(position)?;
        let to_eye = self.to_eye(position);
        let cosine = surface.facet_normal(point.triangle).as_vec3().dot(to_eye).abs();
        let s = ((cosine - GRAZING[0]) / (GRAZING[1] - GRAZING[0])).clamp(0.0, 1.0);
        let facing = s * s * (3.0 - 2.0 * s);
        let width = (0.5 * (steps[0].length_squared() + steps[1].length_squared())).sqrt();
        let value = self.picture.at(place, width * cosine.max(0.2) * unit);
        if facing * value.w <= 0.0 {
            return None;
        }
        let seen = SIGHTS
            .iter()
            .filter(|[a, b]| self.is_seen(surface, position + steps[0] * *a + steps[1] * *b, width));
        let alpha = value.w * facing * seen.count() as f32 / SIGHTS.len() as f32;
        (alpha > 0.0).then(|| (value.truncate() / value.w).extend(alpha))
    }

    /// A position in the coordinates of the picture, and these per mesh unit there.
    fn place(&self, position: Vec3) -> Option<(Vec2, f32)> {
        let q = position - self.eye;
        let depth = if self.is_parallel { 1.0 } else { q.dot(self.forward) };
        if depth <= 0.0 || q.dot(self.forward) <= 0.0 {
            return None;
        }
        let [columns, rows] = self.picture.extent().map(|n| n as f32);
        let unit = rows / columns.max(rows) / (depth * self.half_height);
        let place = Vec2::new(q.dot(self.right), q.dot(self.up)) * unit;
        (place.abs().max_element() <= 1.1).then_some((place, unit))
    }

    fn to_eye(&self, position: Vec3) -> Vec3 {
        if self.is_parallel { -self.forward } else { (self.eye - position).normalize_or(-self.forward) }
    }

    /// True where nothing lies between the camera and a point, but for what is nearer to the point than two texels.
    fn is_seen(&self, surface: &Surface, position: Vec3, texel: f32) -> bool {
        let to_eye = self.to_eye(position);
        // Parallel rays come from as far as the camera is.
        let distance = (self.eye - position).dot(to_eye);
        let origin = position + to_eye * distance;
        let hit = surface.bvh().first_hit(origin, -to_eye, distance);
        hit.is_none_or(|hit| distance - hit.distance <= 2.0 * texel + 1e-5 * distance)
    }
}
