//! Pictures that are thrown onto the surface, as by a slide projector.

use std::sync::Arc;

use fantex_mesh::RayHit;
use glam::{DVec2, DVec3, Mat2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::composite::position_steps;
use crate::stroke_page::StrokePage;
use crate::texel_page::TexelPage;
use crate::{Paint, Picture, Surface, SurfacePoint, Symmetry};

/// Where a picture is projected from. World space.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectionView {
    /// The camera.
    pub eye: [f64; 3],
    /// What it looks at.
    pub target: [f64; 3],
    /// What is upright in the picture.
    #[serde(default = "up")]
    pub up: [f64; 3],
    /// How wide it sees: `{"perspective": DEGREES}` or `{"parallel": HEIGHT}`.
    pub lens: Lens,
    /// Where in the view the picture lies.
    #[serde(default)]
    pub place: PicturePlace,
}

fn up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// Where in a camera's view a picture lies: coordinates are x to the right and y upwards, the origin in the middle, 1 at the
/// upper border.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PicturePlace {
    /// The picture's middle.
    pub center: [f64; 2],
    /// The picture's height, as a share of the view's.
    pub height: f64,
    /// Degrees, counter-clockwise.
    pub angle: f64,
    /// Left and right are changed.
    pub mirrored: bool,
}

impl Default for PicturePlace {
    /// From the lower to the upper border.
    fn default() -> Self {
        Self { center: [0.0; 2], height: 1.0, angle: 0.0, mirrored: false }
    }
}

/// The angle or the height that the view spans.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Lens {
    /// Degrees between the view's lower and upper border, above 0 and below 180.
    Perspective(f64),
    /// World units between them; all rays are parallel.
    Parallel(f64),
}

/// From where the surface is seen. Mesh space.
#[derive(Clone, Debug)]
struct Camera {
    eye: Vec3,
    forward: Vec3,
    is_parallel: bool,
}

/// A picture through a camera. It lies on what the camera sees, and on nothing behind that.
#[derive(Clone, Debug)]
pub struct Projection {
    picture: Arc<Picture>,
    camera: Camera,
    /// Mesh space.
    right: Vec3,
    up: Vec3,
    /// Half the view's height, at distance 1 or (parallel rays) everywhere, mesh units.
    half_height: f32,
    /// From the view to the picture, both with 1 at the upper border: what is added, then by what it is multiplied.
    shift: Vec2,
    turn: Mat2,
}

/// Cosines between the surface's normal and the way to the camera over which the picture fades in: what is seen edge-on would
/// be smeared.
const GRAZING: [f32; 2] = [0.05, 0.2];

/// Points of a texel whose sight is tested, in texels: corners of a square that is turned a little.
const SIGHTS: [[f32; 2]; 4] = [[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]];

impl Projection {
    /// None where the view has no direction, or a lens beyond its range.
    pub fn new(surface: &Surface, view: &ProjectionView, picture: Arc<Picture>) -> Option<Self> {
        let [eye, target, up] = [view.eye, view.target, view.up].map(DVec3::from);
        let forward = (target - eye).try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        let half_height = match view.lens {
            Lens::Perspective(degrees) => (0.5 * degrees.to_radians()).tan(),
            Lens::Parallel(height) => 0.5 * height / surface.mesh().world_from_mesh.scale,
        };
        let in_range = half_height.is_finite() && half_height > 0.0 && half_height < 1e6;
        let PicturePlace { center, height, angle, mirrored } = view.place;
        let is_placed = DVec2::from(center).is_finite() && angle.is_finite() && height > 1e-6 && height < 1e6;
        let flip = Vec2::new(if mirrored { -1.0 } else { 1.0 }, 1.0) / height as f32;
        (in_range && is_placed).then(|| Self {
            picture,
            camera: Camera::new(surface, view, eye, forward),
            right: right.as_vec3(),
            up: right.cross(forward).as_vec3(),
            half_height: half_height as f32,
            shift: -DVec2::from(center).as_vec2(),
            turn: Mat2::from_diagonal(flip) * Mat2::from_angle(-angle.to_radians() as f32),
        })
    }

    /// What the picture shows at a point, straight alpha; none where the point is not seen. `steps`: change of the position
    /// along a texel's sides, mesh units.
    pub(crate) fn at(&self, surface: &Surface, point: SurfacePoint, steps: [Vec3; 2]) -> Option<Vec4> {
        let (value, facing) = self.look(surface, point, steps)?;
        if facing * value.w <= 0.0 {
            return None;
        }
        let alpha = value.w * facing * self.camera.seen_share(surface, point, steps);
        (alpha > 0.0).then(|| (value.truncate() / value.w).extend(alpha))
    }

    /// The picture's colour at a point, opaque, whether the point is seen or not; none beside the picture.
    pub(crate) fn color_at(&self, surface: &Surface, point: SurfacePoint, steps: [Vec3; 2]) -> Option<Vec4> {
        let (value, _) = self.look(surface, point, steps)?;
        (value.w > 0.0).then(|| (value.truncate() / value.w).extend(1.0))
    }

    /// The picture at a point, multiplied by its alpha, and how far the surface there faces the camera, 0..1; none beside the
    /// picture.
    fn look(&self, surface: &Surface, point: SurfacePoint, steps: [Vec3; 2]) -> Option<(Vec4, f32)> {
        let position = surface.position(point).as_vec3();
        let (place, unit) = self.place(position)?;
        let to_eye = self.camera.to_eye(position);
        if !surface.is_seen_from(point.triangle, to_eye) {
            return None;
        }
        // The smooth surface's, so that the picture's border does not follow the facets.
        let cosine = surface.normal(point).dot(to_eye).abs();
        let s = ((cosine - GRAZING[0]) / (GRAZING[1] - GRAZING[0])).clamp(0.0, 1.0);
        let value = self.picture.at(place, width_of(steps) * cosine.max(0.2) * unit);
        Some((value, s * s * (3.0 - 2.0 * s)))
    }

    /// The triangles that may lie in the picture, ascending: those of which some corner does not lie beside it.
    pub fn triangles(&self, surface: &Surface) -> Vec<u32> {
        let mesh = surface.mesh();
        let may_show = |triangle: &u32| {
            let sides = mesh.triangle_positions(*triangle as usize).map(|p| self.sides(p));
            // Beyond one side with all corners, or behind the camera.
            let [a, b, c] = sides;
            a & b & c == 0
        };
        (0..mesh.triangles.len() as u32).into_par_iter().filter(may_show).collect()
    }

    /// Beyond which sides of the picture a position lies: a bit for each.
    fn sides(&self, position: Vec3) -> u8 {
        let q = position - self.camera.eye;
        let depth = q.dot(self.camera.forward);
        let scale = if self.camera.is_parallel { self.half_height } else { depth.abs() * self.half_height };
        if depth <= 0.0 {
            return 16;
        }
        let p = self.turn * (Vec2::new(q.dot(self.right), q.dot(self.up)) / scale + self.shift);
        let [columns, rows] = self.picture.extent().map(|n| n as f32);
        let half = Vec2::new(columns / rows, 1.0) * 1.05;
        u8::from(p.x < -half.x)
            | u8::from(p.x > half.x) << 1
            | u8::from(p.y < -half.y) << 2
            | u8::from(p.y > half.y) << 3
    }

    /// Where the picture's right and upright direction point, mesh space.
    pub(crate) fn axes(&self) -> [Vec3; 2] {
        let axis = |picture: Vec2| {
            // The turn is a rotation (and a reflection) times a scale: its transpose goes back, but for the length.
            let view = self.turn.transpose() * picture;
            (self.right * view.x + self.up * view.y).normalize_or_zero()
        };
        [Vec2::X, Vec2::Y].map(axis)
    }

    /// A position in the coordinates of the picture, and these per mesh unit there.
    fn place(&self, position: Vec3) -> Option<(Vec2, f32)> {
        let Camera { eye, forward, is_parallel } = self.camera;
        let q = position - eye;
        let depth = if is_parallel { 1.0 } else { q.dot(forward) };
        if depth <= 0.0 || q.dot(forward) <= 0.0 {
            return None;
        }
        let [columns, rows] = self.picture.extent().map(|n| n as f32);
        let view = Vec2::new(q.dot(self.right), q.dot(self.up)) / (depth * self.half_height);
        let longer = rows / columns.max(rows);
        let place = self.turn * (view + self.shift) * longer;
        // The turn's rows have the same length.
        let unit = longer * self.turn.y_axis.length() / (depth * self.half_height);
        (place.abs().max_element() <= 1.1).then_some((place, unit))
    }
}

impl Camera {
    /// `eye` and `forward`: world space.
    fn new(surface: &Surface, view: &ProjectionView, eye: DVec3, forward: DVec3) -> Self {
        let eye = surface.mesh().world_from_mesh.inverse_point(eye);
        Self { eye, forward: forward.as_vec3(), is_parallel: matches!(view.lens, Lens::Parallel(_)) }
    }

    fn to_eye(&self, position: Vec3) -> Vec3 {
        if self.is_parallel { -self.forward } else { (self.eye - position).normalize_or(-self.forward) }
    }

    /// Share of a texel that is not hidden. Two rays tell mostly; where they do not agree, all do.
    fn seen_share(&self, surface: &Surface, point: SurfacePoint, steps: [Vec3; 2]) -> f32 {
        let (position, width) = (surface.position(point).as_vec3(), width_of(steps));
        let is_seen = |[a, b]: [f32; 2]| {
            self.is_seen(surface, point.triangle, position + steps[0] * a + steps[1] * b, width)
        };
        let [first, second, third, fourth] = SIGHTS;
        let count = match [first, third].map(is_seen) {
            [true, true] => 4,
            [false, false] => 0,
            _ => 1 + [second, fourth].into_iter().filter(|&sight| is_seen(sight)).count(),
        };
        count as f32 / SIGHTS.len() as f32
    }

    /// True where nothing lies between the camera and a point of a triangle, but for what is nearer to the point than two texels
    /// and turned to the camera with the same side: behind the front of a thin plate its back is hidden.
    fn is_seen(&self, surface: &Surface, triangle: u32, position: Vec3, texel: f32) -> bool {
        let to_eye = self.to_eye(position);
        // Parallel rays come from as far as the camera is.
        let distance = (self.eye - position).dot(to_eye);
        let origin = position + to_eye * distance;
        let is_front = |triangle| surface.facet_normal(triangle).dot(to_eye.as_dvec3()) >= 0.0;
        let is_known = |hit: &RayHit| surface.is_seen_from(hit.point.triangle, to_eye);
        let hit = surface.bvh().first_hit_where(origin, -to_eye, distance, is_known);
        hit.is_none_or(|hit| {
            distance - hit.distance <= 2.0 * texel + 1e-5 * distance
                && is_front(hit.point.triangle) == is_front(triangle)
        })
    }
}

// Only what is seen.

/// What a camera sees, and faces by an angle at most. Symmetric strokes have a camera for each copy.
#[derive(Clone, Debug)]
pub struct Sight {
    cameras: Vec<Camera>,
    /// Cosines between the surface's normal and the way to the camera over which paint fades in.
    fade: [f32; 2],
}

/// Share of the largest angle at which paint begins to fade.
const SIGHT_FADE: f32 = 0.85;

impl Sight {
    /// `max_degrees`: between the surface's normal and the way to the camera, above 0 up to 90. None where that is out of range, or
    /// the view has no direction.
    pub fn new(
        surface: &Surface,
        view: &ProjectionView,
        max_degrees: f32,
        symmetry: &Symmetry,
    ) -> Option<Self> {
        let [eye, target] = [view.eye, view.target].map(DVec3::from);
        let forward = (target - eye).try_normalize().filter(|_| eye.is_finite())?;
        let moved = |k| match k {
            0 => [eye, forward],
            k => [symmetry.moved_position(eye, k), symmetry.moved_direction(forward, k)],
        };
        let camera = |k| {
            let [eye, forward] = moved(k);
            Camera::new(surface, view, eye, forward)
        };
        let cosine = |share: f32| (share * max_degrees).to_radians().cos();
        (max_degrees > 0.0 && max_degrees <= 90.0).then(|| Self {
            cameras: (0..symmetry.count()).map(camera).collect(),
            fade: [cosine(1.0), cosine(SIGHT_FADE)],
        })
    }

    /// What of a texel's paint stays, 0..1. `steps`: as for [`Projection::at`].
    fn passes(&self, surface: &Surface, point: SurfacePoint, steps: [Vec3; 2]) -> f32 {
        let [low, high] = self.fade;
        let (position, normal) = (surface.position(point).as_vec3(), surface.normal(point));
        let of_camera = |camera: &Camera| {
            let to_eye = camera.to_eye(position);
            let s = ((normal.dot(to_eye).abs() - low) / (high - low)).clamp(0.0, 1.0);
            if s <= 0.0 || !surface.is_seen_from(point.triangle, to_eye) {
                return 0.0;
            }
            s * s * (3.0 - 2.0 * s) * camera.seen_share(surface, point, steps)
        };
        self.cameras.iter().map(of_camera).fold(0.0, f32::max)
    }
}

/// Length of a texel's sides.
fn width_of(steps: [Vec3; 2]) -> f32 {
    (0.5 * (steps[0].length_squared() + steps[1].length_squared())).sqrt()
}

// Stencils and sight: what a stroke is laid on through.
//
// How much they let through is asked once per texel and stroke, when the texel is first covered: sight costs rays.

/// Brings what a page's stroke is laid on through, if there is something, up to date with its coverage.
pub(crate) fn see_through(surface: &Surface, map: &TexelPage, paint: &Paint, page: &mut StrokePage) {
    let (stencil, sight) = (paint.stencil.as_deref(), paint.sight.as_deref());
    if (stencil.is_none() && sight.is_none()) || page.stale.is_empty() {
        return;
    }
    if page.stencil.is_empty() {
        page.stencil = vec![f32::NAN; page.coverage.len()];
    }
    let (rect, coverage) = (page.stale, &page.coverage);
    let rows = page.stencil.par_chunks_mut(map.block.extent[0] as usize).zip(0..map.block.extent[1]);
    let rows = rows.skip(rect.low[1] as usize).take((rect.high[1] - rect.low[1]) as usize);
    rows.for_each(|(row, y)| {
        for x in rect.low[0]..rect.high[0] {
            let (texel, passes) = (map.texel([x, y]), &mut row[x as usize]);
            if coverage[texel] > 0.0 && passes.is_nan() && map.is_valid(texel) {
                let steps = position_steps(surface, map.triangle([x, y]));
                let point = map.point([x, y]).clamped();
                let through = stencil
                    .map_or(1.0, |stencil| stencil.at(surface, point, steps).map_or(0.0, |color| color.w));
                let seen = sight.filter(|_| through > 0.0).map_or(1.0, |s| s.passes(surface, point, steps));
                *passes = through * seen;
            }
        }
    });
}
