//! Where the picture is taken from.

use fantex_base::Aabb;
use fantex_mesh::{Mesh, WorldFromMesh};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// The bounding box of a mesh, world space; a point at the origin for a mesh without vertices.
pub fn world_bounds(mesh: &Mesh) -> Aabb<DVec3> {
    let bounds = Aabb::of_points(mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p)));
    if bounds.is_empty() { Aabb { min: DVec3::ZERO, max: DVec3::ZERO } } else { bounds }
}

/// A pinhole camera, **world space** (the model file's coordinates). There is no far plane; the near plane is chosen by
/// the renderer from the distance to the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The pinhole.
    pub eye: DVec3,
    /// A point in the middle of the picture, not the eye.
    pub target: DVec3,
    /// Points upwards in the picture; need not be orthogonal to the line of sight.
    pub up: DVec3,
    /// Vertical opening angle in degrees, between 0 and 180.
    pub fov_degrees: f64,
}

/// Share of the picture that a framed model fills.
const FRAMING_FILL: f64 = 0.92;

/// What a camera can show whole.
pub trait Framed {
    /// The largest value over all points, world space, of each of some functions; minus infinity without points. Each takes its largest value
    /// over a box at a corner, if all of the box lies before the eye.
    fn maxima<const N: usize>(&mut self, functions: impl Fn(DVec3) -> [f64; N]) -> [f64; N];
}

/// Points, each of which is asked.
struct Points<I>(I);

impl<I: Iterator<Item = DVec3> + Clone> Framed for Points<I> {
    fn maxima<const N: usize>(&mut self, functions: impl Fn(DVec3) -> [f64; N]) -> [f64; N] {
        maxima_of(self.0.clone(), functions)
    }
}

/// [`Framed::maxima`] of points.
pub fn maxima_of<const N: usize>(
    points: impl Iterator<Item = DVec3>,
    functions: impl Fn(DVec3) -> [f64; N],
) -> [f64; N] {
    let larger = |a: [f64; N], b: [f64; N]| std::array::from_fn(|i| a[i].max(b[i]));
    points.map(functions).fold([f64::NEG_INFINITY; N], larger)
}

impl Camera {
    /// Opening angle of framed pictures: long enough a lens to show proportions as they are.
    pub const FRAMING_FOV_DEGREES: f64 = 35.0;

    /// Direction from the model to the camera of a three-quarter view: from the front (+z), the right and above.
    pub const THREE_QUARTER: DVec3 = DVec3::new(0.62, 0.45, 1.0);

    /// A camera that looks at a mesh from `direction` (from the mesh to the camera) and shows it whole and as large as
    /// possible. `aspect` is width / height.
    pub fn framing_mesh(mesh: &Mesh, direction: DVec3, aspect: f64) -> Self {
        Self::framing_mesh_with(mesh, direction, aspect, DVec3::Y, Self::FRAMING_FOV_DEGREES)
    }

    /// As [`Camera::framing_mesh`], with `up` upwards in the picture and another opening angle.
    pub fn framing_mesh_with(
        mesh: &Mesh,
        direction: DVec3,
        aspect: f64,
        up: DVec3,
        fov_degrees: f64,
    ) -> Self {
        let points = mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p));
        Self::framing(&mut Points(points), direction, aspect, up, fov_degrees)
    }

    /// As [`Camera::framing_mesh`], for points.
    pub fn framing_points(
        points: impl Iterator<Item = DVec3> + Clone,
        direction: DVec3,
        aspect: f64,
    ) -> Self {
        Self::framing(&mut Points(points), direction, aspect, DVec3::Y, Self::FRAMING_FOV_DEGREES)
    }

    /// As [`Camera::framing_mesh_with`], for whatever tells where its outermost points are.
    ///
    /// The camera's frustum, looking along `-direction`, touches the points from two sides or all.
    ///
    /// In a frame with z along `direction`, a point is left of the right frustum plane of an eye at `e` if
    /// `x - e.x <= t (e.z - z)`. Each of the four planes thus asks for the largest `+-x + t z` (or y); the two
    /// opposite ones together give the eye's distance and its centre.
    pub fn framing(
        shape: &mut impl Framed,
        direction: DVec3,
        aspect: f64,
        up: DVec3,
        fov_degrees: f64,
    ) -> Self {
        let direction = direction.try_normalize().unwrap_or(DVec3::Z);
        let world_from_view = view_axes(direction, up.normalize_or(DVec3::Y));
        let view_from_world = world_from_view.transpose();
        let half = (fov_degrees.to_radians() * 0.5).tan() * FRAMING_FILL;
        let tangents = DVec2::new(half * aspect, half);
        let [right, top, left, bottom] = shape.maxima(|p| {
            let p = view_from_world * p;
            let (high, low) = (p.truncate() + tangents * p.z, -p.truncate() + tangents * p.z);
            [high.x, high.y, low.x, low.y]
        });
        let (high, low) = (DVec2::new(right, top), DVec2::new(left, bottom));
        let [x, y, front, min_x, min_y, min_z] = shape.maxima(|p| {
            let p = view_from_world * p;
            [p.x, p.y, p.z, -p.x, -p.y, -p.z]
        });
        let (min, max) = (-DVec3::new(min_x, min_y, min_z), DVec3::new(x, y, front));
        let (eye, middle_z) = if front.is_finite() {
            let distances = (high + low) / (2.0 * tangents);
            let eye_z = distances.max_element().max(front + smallest_gap(min, max));
            let middle_z = 0.5 * (min.z + front);
            // Between these all points are within the frustum.
            let sides = [high - tangents * eye_z, tangents * eye_z - low];
            let eye = ((high - low) * 0.5).extend(eye_z);
            (centred_eye(shape, view_from_world, eye, middle_z, sides), middle_z)
        } else {
            (DVec3::Z * 3.0, 0.0)
        };
        Self {
            eye: world_from_view * eye,
            target: world_from_view * eye.with_z(middle_z),
            up: world_from_view.y_axis,
            fov_degrees,
        }
    }

    /// `count` cameras spread evenly around the mesh, each framing it: a spiral of equal-area steps over the sphere
    /// (the Fibonacci lattice; Á. González, "Measurement of Areas on a Sphere Using Fibonacci and Latitude-Longitude
    /// Lattices", 2010), kept off the poles.
    pub fn orbit(mesh: &Mesh, count: usize, aspect: f64) -> Vec<Self> {
        let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        (0..count)
            .map(|i| {
                let y = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
                let radius = (1.0 - y * y).sqrt();
                let angle = golden_angle * i as f64 + 0.5;
                let direction = DVec3::new(radius * angle.sin(), y * 0.95, radius * angle.cos());
                Self::framing_mesh(mesh, direction, aspect)
            })
            .collect()
    }

    /// Right, up and backward (towards the viewer) unit vectors of the world, as columns.
    pub fn axes(&self) -> DMat3 {
        let backward = (self.eye - self.target).normalize_or(DVec3::Z);
        view_axes(backward, self.up.normalize_or(DVec3::Y))
    }

    /// Why the camera cannot take a picture, or nothing.
    pub fn defect(&self) -> Option<&'static str> {
        // An angle that is none leaves the eye of a framing camera nowhere.
        if !(self.fov_degrees > 0.0 && self.fov_degrees < 180.0) {
            Some("its opening angle is not between 0 and 180 degrees")
        } else if !(self.eye.is_finite() && self.target.is_finite() && self.up.is_finite()) {
            Some("its eye, target or up vector is not finite")
        } else if self.eye == self.target {
            Some("its eye and target are the same point")
        } else if self.up == DVec3::ZERO {
            Some("its up vector is zero")
        } else {
            None
        }
    }
}

/// What is kept between the eye and a box: a thousandth of its size, wherever it lies, but more than rounding takes away
/// there, which is 16 steps of double precision. A single point has no size, and any distance shows it.
fn smallest_gap(min: DVec3, max: DVec3) -> f64 {
    let magnitude = min.abs().max(max.abs()).max_element();
    let size = (max - min).max_element();
    let gap = if size > 0.0 { size * 1e-3 } else { 1e-3 };
    gap.max(magnitude * 16.0 * f64::EPSILON)
}

/// Moves an eye (looking along -z) sideways until the points' picture has equal margins on opposite sides: where the
/// points touch the frustum on both sides they have, elsewhere the depth of the points shifts it a little. It stays between `sides`.
fn centred_eye(
    shape: &mut impl Framed,
    view_from_world: DMat3,
    mut eye: DVec3,
    middle_z: f64,
    sides: [DVec2; 2],
) -> DVec3 {
    for _ in 0..3 {
        let [x, y, min_x, min_y] = shape.maxima(|p| {
            let p = view_from_world * p;
            let seen = (p - eye).truncate() / (eye.z - p.z);
            [seen.x, seen.y, -seen.x, -seen.y]
        });
        let moved = eye.truncate() + (DVec2::new(x, y) - DVec2::new(min_x, min_y)) * 0.5 * (eye.z - middle_z);
        eye = moved.max(sides[0]).min(sides[1]).extend(eye.z);
    }
    eye
}

/// Right, up and backward axes (as columns) of a camera that looks along `-backward`.
pub(crate) fn view_axes(backward: DVec3, up: DVec3) -> DMat3 {
    let right = up.cross(backward).try_normalize().unwrap_or_else(|| {
        let side = if backward.y.abs() > 0.9 { DVec3::X } else { DVec3::Y.cross(backward) };
        (side - backward * side.dot(backward)).normalize_or(DVec3::X)
    });
    DMat3::from_cols(right, backward.cross(right), backward)
}

/// The projection of mesh space onto the screen.
///
/// Screen-homogeneous coordinates `(x w, y w, w)`: `x` and `y` in pixels from the picture's top left corner, `w` the
/// depth along the line of sight in mesh units.
#[derive(Clone, Debug)]
pub struct Projection {
    /// The pinhole, mesh space.
    pub eye: Vec3,
    screen_from_view: DMat3,
    view_from_screen: DMat3,
    eye_exact: DVec3,
    /// Depth of the near plane, mesh units.
    pub near: f64,
}

impl Projection {
    /// The projection of a camera without [`Camera::defect`] onto `size` pixels.
    pub fn new(camera: &Camera, size: [u32; 2], mesh: &Mesh) -> Self {
        let WorldFromMesh { offset, scale } = mesh.world_from_mesh;
        let eye_exact = (camera.eye - offset) / scale;
        let axes = camera.axes();
        let backward = axes.z_axis;
        let [width, height] = size.map(f64::from);
        let focal = 0.5 * height / (camera.fov_degrees.to_radians() * 0.5).tan();
        let rows = DMat3::from_cols(
            axes.x_axis * focal - backward * (0.5 * width),
            axes.y_axis * -focal - backward * (0.5 * height),
            -backward,
        );
        Self {
            eye: eye_exact.as_vec3(),
            eye_exact,
            screen_from_view: rows.transpose(),
            view_from_screen: rows.transpose().inverse(),
            near: near_depth(mesh, eye_exact, -backward),
        }
    }

    /// The unit direction, mesh space (and world), from the eye through a position in pixels.
    pub fn direction(&self, position: Vec2) -> DVec3 {
        (self.view_from_screen * position.as_dvec2().extend(1.0)).normalize()
    }

    /// What [`Projection::project`] does: the matrix, after the eye has been subtracted (mesh space).
    pub fn screen_from_view(&self) -> (DMat3, DVec3) {
        (self.screen_from_view, self.eye_exact)
    }

    /// Screen-homogeneous coordinates of a mesh-space point.
    pub fn project(&self, p_mesh: Vec3) -> DVec3 {
        self.screen_from_view * (p_mesh.as_dvec3() - self.eye_exact)
    }
}

/// The near plane: as far away as the mesh allows, but never so close that depth loses its digits.
fn near_depth(mesh: &Mesh, eye: DVec3, forward: DVec3) -> f64 {
    let both = |(near, far): (f64, f64), (n, f): (f64, f64)| (near.min(n), far.max(f));
    let none = (f64::INFINITY, 0f64);
    let of_some = |positions: &[Vec3]| {
        let depths = positions.iter().map(|p| (p.as_dvec3() - eye).dot(forward));
        depths.fold(none, |range, d| both(range, (d, d)))
    };
    let (nearest, farthest) = mesh.positions.par_chunks(1 << 14).map(of_some).reduce(|| none, both);
    (nearest * 0.5).max(farthest * 1e-5).max(1e-12)
}
