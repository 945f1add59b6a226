//! From a screen position back to the point of a triangle.

use fantex_base::vector_level;
use fantex_mesh::{Mesh, SurfacePoint, interpolate};
use fantex_scene::Projection;
use fearless_simd::prelude::*;
use fearless_simd::{Select, Simd, dispatch};
use glam::{DMat3, DVec3, Vec2, Vec3};

use crate::Interpolation;
use crate::vectors::{Vector, add, dot, normalize_or, scaled, splat, sub};

/// A point of the surface that is being shaded, and how it moves with the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point, on its triangle.
    pub at: SurfacePoint,
    /// Change of the barycentric coordinates per pixel to the right and downwards; their sums are zero. Smaller where samples
    /// are shaded on their own.
    pub lambda_steps: [Vec3; 2],
    /// True where the eye sees the front (counter-clockwise) side.
    pub front: bool,
    /// Unit vector from the point to the eye, mesh space.
    pub to_eye: Vec3,
}

impl Hit {
    /// Index of the mesh's triangle.
    pub fn triangle(&self) -> usize {
        self.at.index()
    }

    /// The point, mesh space.
    pub fn position(&self, mesh: &Mesh) -> Vec3 {
        self.at.position(mesh)
    }

    /// The value at the point, of values at the triangle's corners, and its change per pixel to the right and downwards.
    #[inline]
    pub fn interpolate<T>(&self, corners: [T; 3]) -> (T, [T; 2])
    where
        T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let [x, y] = self.lambda_steps;
        (self.at.interpolate(corners), [interpolate(corners, x), interpolate(corners, y)])
    }
}

/// Barycentric coordinates of a triangle as functions of the screen position.
///
/// In screen-homogeneous coordinates, corner `i`'s share of the point under `(x, y)` is proportional to
/// `(h_j x h_k) . (x, y, 1)`: linear functions whose quotient by their sum is perspective-correct, whatever part of
/// the triangle lies behind the eye (M. Olano and T. Greer, "Triangle Scan Conversion using 2D Homogeneous
/// Coordinates", 1997). Their derivatives follow from the quotient rule.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScreenBarycentrics {
    shares: [DVec3; 3],
}

impl ScreenBarycentrics {
    pub(crate) fn new(corners: [DVec3; 3], interpolation: Interpolation) -> Self {
        let in_front = corners.iter().all(|h| h.z > 0.0);
        let [a, b, c] = match interpolation {
            Interpolation::Affine if in_front => corners.map(|h| h / h.z),
            _ => corners,
        };
        Self { shares: [b.cross(c), c.cross(a), a.cross(b)] }
    }

    /// `lambda` and its derivatives along x and y at a position in pixels. Positions slightly outside the triangle
    /// (rounding of the corners to the sub-pixel grid) are moved to its border.
    pub(crate) fn at(&self, position: Vec2) -> [Vec3; 3] {
        let p = position.as_dvec2().extend(1.0);
        let [a, b, c] = self.shares;
        let shares = DVec3::new(a.dot(p), b.dot(p), c.dot(p));
        let sum = shares.element_sum();
        let lambda = shares / sum;
        let slope = |d: DVec3| (d - lambda * d.element_sum()) / sum;
        let (dx, dy) = (slope(DVec3::new(a.x, b.x, c.x)), slope(DVec3::new(a.y, b.y, c.y)));
        if !(lambda.is_finite() && dx.is_finite() && dy.is_finite()) {
            return [Vec3::splat(1.0 / 3.0), Vec3::ZERO, Vec3::ZERO];
        }
        let inside = lambda.clamp(DVec3::ZERO, DVec3::ONE);
        let bounded = |d: DVec3| d.clamp(DVec3::splat(-1e6), DVec3::splat(1e6)).as_vec3();
        [(inside / inside.element_sum()).as_vec3(), bounded(dx), bounded(dy)]
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct HitFinder<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) projection: &'a Projection,
    pub(crate) interpolation: Interpolation,
    /// Distance of neighbouring shading points in pixels: 1, or less where samples are shaded on their own.
    pub(crate) spacing: f32,
}

impl HitFinder<'_> {
    /// The point of `triangle` seen at a position in pixels.
    pub(crate) fn find(&self, triangle: u32, position: Vec2) -> Hit {
        let triangle = triangle as usize;
        let projected = self.mesh.triangle_positions(triangle).map(|p| self.projection.project(p));
        self.hit(triangle, ScreenBarycentrics::new(projected, self.interpolation).at(position))
    }

    fn hit(&self, triangle: usize, [lambda, dx, dy]: [Vec3; 3]) -> Hit {
        let [a, b, c] = self.mesh.triangle_positions(triangle);
        let normal = (b - a).cross(c - a);
        let at = SurfacePoint { triangle: triangle as u32, lambda };
        Hit {
            at,
            lambda_steps: [dx * self.spacing, dy * self.spacing],
            front: normal.dot(self.projection.eye - a) >= 0.0,
            to_eye: (self.projection.eye - at.interpolate([a, b, c])).normalize_or(Vec3::Z),
        }
    }
}

// The points of many triangles at once, in vectors: every step is that of the scalar path in the same order, so that the
// results are equal.

/// Points of a block; a whole number of vectors.
const BLOCK: usize = 16;

pub(crate) type Seen = (u32, Vec2);

struct Question {
    /// Three coordinates of the first corner, of the second, of the third; mesh space.
    corners: [[f32; BLOCK]; 9],
    /// In pixels.
    position: [[f32; BLOCK]; 2],
}

struct Answer {
    /// Barycentric coordinates, their change to the right, and downwards.
    lambda: [[f32; BLOCK]; 9],
    /// Not negative where the eye sees the front.
    side: [f32; BLOCK],
    to_eye: [[f32; BLOCK]; 3],
}

struct View {
    screen_from_view: DMat3,
    eye: DVec3,
    /// The same, rounded.
    rounded_eye: Vec3,
    spacing: f32,
}

impl Answer {
    fn hit(&self, index: usize, triangle: usize) -> Hit {
        let three = |[x, y, z]: [&[f32; BLOCK]; 3]| Vec3::new(x[index], y[index], z[index]);
        let [a, b, c, ax, bx, cx, ay, by, cy] = &self.lambda;
        let [x, y, z] = &self.to_eye;
        Hit {
            at: SurfacePoint { triangle: triangle as u32, lambda: three([a, b, c]) },
            lambda_steps: [three([ax, bx, cx]), three([ay, by, cy])],
            front: self.side[index] >= 0.0,
            to_eye: three([x, y, z]),
        }
    }
}

impl HitFinder<'_> {
    /// [`HitFinder::find`] for many triangles and positions.
    pub(crate) fn find_all(&self, seen: &[Seen], hits: &mut Vec<Hit>) {
        if self.interpolation == Interpolation::Affine {
            hits.extend(seen.iter().map(|&(triangle, position)| self.find(triangle, position)));
            return;
        }
        let (screen_from_view, eye) = self.projection.screen_from_view();
        let view = View { screen_from_view, eye, rounded_eye: self.projection.eye, spacing: self.spacing };
        let mut question = Question { corners: [[1.0; BLOCK]; 9], position: [[0.0; BLOCK]; 2] };
        let mut answer = Answer { lambda: [[0.0; BLOCK]; 9], side: [0.0; BLOCK], to_eye: [[0.0; BLOCK]; 3] };
        for seen in seen.chunks(BLOCK) {
            for (index, &(triangle, position)) in seen.iter().enumerate() {
                let corners = self.mesh.triangle_positions(triangle as usize);
                for (corner, at) in corners.into_iter().enumerate() {
                    question.corners[3 * corner][index] = at.x;
                    question.corners[3 * corner + 1][index] = at.y;
                    question.corners[3 * corner + 2][index] = at.z;
                }
                question.position[0][index] = position.x;
                question.position[1][index] = position.y;
            }
            dispatch!(vector_level(), simd => answer_all(simd, &view, &question, &mut answer));
            let triangles = seen.iter().map(|&(triangle, _)| triangle as usize);
            hits.extend(triangles.enumerate().map(|(index, triangle)| answer.hit(index, triangle)));
        }
    }
}

#[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, which keeps arrays in registers")]
#[inline(always)]
fn answer_all<S: Simd>(simd: S, view: &View, question: &Question, answer: &mut Answer) {
    let lanes = S::f32s::LEN;
    for first in (0..BLOCK).step_by(lanes) {
        let corners = [
            load_corner(simd, question, 0, first),
            load_corner(simd, question, 3, first),
            load_corner(simd, question, 6, first),
        ];
        let lambda = barycentrics(simd, view, corners, question, first);
        for row in 0..9 {
            let number = if row < 3 { lambda[row] } else { lambda[row] * view.spacing };
            number.store_slice(&mut answer.lambda[row][first..first + lanes]);
        }
        let (side, to_eye) = seen_from(simd, view, corners, [lambda[0], lambda[1], lambda[2]]);
        side.store_slice(&mut answer.side[first..first + lanes]);
        for axis in 0..3 {
            to_eye[axis].store_slice(&mut answer.to_eye[axis][first..first + lanes]);
        }
    }
}

/// As `HitFinder::hit`: what has the sign of the side, and the way to the eye.
#[inline(always)]
fn seen_from<S: Simd>(
    simd: S,
    view: &View,
    [a, b, c]: [Vector<S::f32s>; 3],
    lambda: [S::f32s; 3],
) -> (S::f32s, Vector<S::f32s>) {
    let eye = splat(simd, view.rounded_eye);
    let (u, v) = (sub::<S>(b, a), sub::<S>(c, a));
    let normal = [u[1] * v[2] - v[1] * u[2], u[2] * v[0] - v[2] * u[0], u[0] * v[1] - v[0] * u[1]];
    let side = dot::<S>(normal, sub::<S>(eye, a));
    let ab = add::<S>(scaled::<S>(a, lambda[0]), scaled::<S>(b, lambda[1]));
    let point = add::<S>(ab, scaled::<S>(c, lambda[2]));
    (side, normalize_or(simd, sub::<S>(eye, point), splat(simd, Vec3::Z)))
}

#[inline(always)]
fn load_corner<S: Simd>(simd: S, question: &Question, corner: usize, first: usize) -> Vector<S::f32s> {
    [
        load(simd, &question.corners[corner], first),
        load(simd, &question.corners[corner + 1], first),
        load(simd, &question.corners[corner + 2], first),
    ]
}

#[inline(always)]
fn barycentrics<S: Simd>(
    simd: S,
    view: &View,
    [a, b, c]: [Vector<S::f32s>; 3],
    question: &Question,
    first: usize,
) -> [S::f32s; 9] {
    let (low_x, high_x) = load(simd, &question.position[0], first).widen();
    let (low_y, high_y) = load(simd, &question.position[1], first).widen();
    let (low_a, high_a) = projected(simd, view, a);
    let (low_b, high_b) = projected(simd, view, b);
    let (low_c, high_c) = projected(simd, view, c);
    let low = at(simd, [low_a, low_b, low_c], low_x, low_y);
    let high = at(simd, [high_a, high_b, high_c], high_x, high_y);
    let mut narrowed = [S::f32s::splat(simd, 0.0); 9];
    for row in 0..9 {
        narrowed[row] = low[row].narrow(high[row]);
    }
    narrowed
}

/// As `ScreenBarycentrics::new` and `at`, of screen-homogeneous corners.
#[inline(always)]
fn at<S: Simd>(simd: S, [a, b, c]: [Vector<S::f64s>; 3], x: S::f64s, y: S::f64s) -> [S::f64s; 9] {
    let shares = [cross::<S>(b, c), cross::<S>(c, a), cross::<S>(a, b)];
    let values =
        [share_at::<S>(shares[0], x, y), share_at::<S>(shares[1], x, y), share_at::<S>(shares[2], x, y)];
    let sum = element_sum::<S>(values);
    let lambda = [values[0] / sum, values[1] / sum, values[2] / sum];
    let dx = slope::<S>([shares[0][0], shares[1][0], shares[2][0]], lambda, sum);
    let dy = slope::<S>([shares[0][1], shares[1][1], shares[2][1]], lambda, sum);
    let is_finite = are_finite::<S>(lambda) & are_finite::<S>(dx) & are_finite::<S>(dy);
    let inside = [
        bounded(simd, lambda[0], 0.0, 1.0),
        bounded(simd, lambda[1], 0.0, 1.0),
        bounded(simd, lambda[2], 0.0, 1.0),
    ];
    let total = element_sum::<S>(inside);
    let middle = S::f64s::splat(simd, f64::from(1.0_f32 / 3.0));
    let zero = S::f64s::splat(simd, 0.0);
    let mut result = [zero; 9];
    for i in 0..3 {
        result[i] = is_finite.select(inside[i] / total, middle);
        result[3 + i] = is_finite.select(bounded(simd, dx[i], -1e6, 1e6), zero);
        result[6 + i] = is_finite.select(bounded(simd, dy[i], -1e6, 1e6), zero);
    }
    result
}

#[inline(always)]
fn load<S: Simd>(simd: S, numbers: &[f32; BLOCK], first: usize) -> S::f32s {
    S::f32s::from_slice(simd, &numbers[first..first + S::f32s::LEN])
}

/// Screen-homogeneous coordinates of a corner: those of the lower half of points, and of the upper half.
#[inline(always)]
fn projected<S: Simd>(simd: S, view: &View, corner: Vector<S::f32s>) -> (Vector<S::f64s>, Vector<S::f64s>) {
    let ((low_x, high_x), (low_y, high_y), (low_z, high_z)) =
        (corner[0].widen(), corner[1].widen(), corner[2].widen());
    (projected_half(simd, view, [low_x, low_y, low_z]), projected_half(simd, view, [high_x, high_y, high_z]))
}

#[inline(always)]
fn projected_half<S: Simd>(_simd: S, view: &View, corner: Vector<S::f64s>) -> Vector<S::f64s> {
    let (x, y, z) = (corner[0] - view.eye.x, corner[1] - view.eye.y, corner[2] - view.eye.z);
    let DMat3 { x_axis, y_axis, z_axis } = view.screen_from_view;
    [
        x * x_axis.x + y * y_axis.x + z * z_axis.x,
        x * x_axis.y + y * y_axis.y + z * z_axis.y,
        x * x_axis.z + y * y_axis.z + z * z_axis.z,
    ]
}

#[inline(always)]
fn cross<S: Simd>(a: Vector<S::f64s>, b: Vector<S::f64s>) -> Vector<S::f64s> {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

#[inline(always)]
fn share_at<S: Simd>(share: Vector<S::f64s>, x: S::f64s, y: S::f64s) -> S::f64s {
    share[0] * x + share[1] * y + share[2]
}

#[inline(always)]
fn element_sum<S: Simd>(v: Vector<S::f64s>) -> S::f64s {
    v[0] + v[1] + v[2]
}

#[inline(always)]
fn slope<S: Simd>(d: Vector<S::f64s>, lambda: Vector<S::f64s>, sum: S::f64s) -> Vector<S::f64s> {
    let total = element_sum::<S>(d);
    [(d[0] - lambda[0] * total) / sum, (d[1] - lambda[1] * total) / sum, (d[2] - lambda[2] * total) / sum]
}

#[inline(always)]
fn are_finite<S: Simd>(v: Vector<S::f64s>) -> S::mask64s {
    // Infinities and NaN give NaN, which is not equal to itself.
    let zero = v[0] * 0.0 + v[1] * 0.0 + v[2] * 0.0;
    zero.simd_eq(zero)
}

#[inline(always)]
fn bounded<S: Simd>(simd: S, x: S::f64s, low: f64, high: f64) -> S::f64s {
    x.max(S::f64s::splat(simd, low)).min(S::f64s::splat(simd, high))
}

#[cfg(test)]
mod tests {
    use fantex_scene::Camera;

    use super::*;

    /// Corners with different depths, in pixels times depth.
    const CORNERS: [DVec3; 3] =
        [DVec3::new(10.0, 20.0, 1.0), DVec3::new(900.0, 120.0, 3.0), DVec3::new(300.0, 1200.0, 4.0)];

    #[test]
    fn corners_have_their_own_coordinates() {
        let b = ScreenBarycentrics::new(CORNERS, Interpolation::Perspective);
        for (i, h) in CORNERS.iter().enumerate() {
            let [lambda, ..] = b.at((h.truncate() / h.z).as_vec2());
            assert!((lambda - Vec3::AXES[i]).length() < 1e-5, "{lambda}");
        }
    }

    #[test]
    fn interpolation_follows_the_formula() {
        let screen = CORNERS.map(|h| h.truncate() / h.z);
        let l = DVec3::new(0.2, 0.5, 0.3);
        let p = interpolate(screen, l).as_vec2();
        let over_w = l / DVec3::from_array(CORNERS.map(|h| h.z));
        let expected = (over_w / over_w.element_sum()).as_vec3();
        let [correct, ..] = ScreenBarycentrics::new(CORNERS, Interpolation::Perspective).at(p);
        let [affine, ..] = ScreenBarycentrics::new(CORNERS, Interpolation::Affine).at(p);
        assert!((correct - expected).length() < 1e-6, "{correct} against {expected}");
        assert!((affine - l.as_vec3()).length() < 1e-6, "{affine}");
    }

    #[test]
    fn derivatives_are_the_limits_of_differences() {
        let b = ScreenBarycentrics::new(CORNERS, Interpolation::Perspective);
        let p = Vec2::new(120.0, 110.0);
        let step = 0.5;
        let [_, dx, dy] = b.at(p);
        let difference = |d: Vec2| (b.at(p + d)[0] - b.at(p - d)[0]) / (2.0 * step);
        assert!((difference(Vec2::X * step) - dx).length() < 1e-5);
        assert!((difference(Vec2::Y * step) - dy).length() < 1e-5);
    }

    #[test]
    fn edge_on_triangles_give_numbers() {
        let h = DVec3::new(5.0, 5.0, 1.0);
        for corners in [[h, h, h], [h, h * 2.0, h * 3.0], [DVec3::ZERO, h, DVec3::X]] {
            let values = ScreenBarycentrics::new(corners, Interpolation::Perspective).at(Vec2::new(5.0, 5.0));
            assert!(values.iter().all(|v| v.is_finite()), "{values:?}");
        }
    }

    #[test]
    fn vectors_and_single_triangles_give_equal_hits() {
        let mut state = 1_u32;
        let mut unit = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut mesh = Mesh::default();
        for triangle in 0..1000_u32 {
            let middle = Vec3::new(unit(), unit(), unit()) * 2.0 - 1.0;
            let size = if triangle % 3 == 0 { 1.0 } else { 1e-3 };
            mesh.positions.extend((0..3).map(|_| middle + Vec3::new(unit(), unit(), unit()) * size));
            mesh.triangles.push([0, 1, 2].map(|corner| 3 * triangle + corner));
        }
        // One without area.
        mesh.triangles.push([0, 0, 1]);
        let camera =
            Camera { eye: DVec3::new(0.3, 0.2, 1.1), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 60.0 };
        let projection = Projection::new(&camera, [640, 360], &mesh);
        let finder = HitFinder {
            mesh: &mesh,
            projection: &projection,
            interpolation: Interpolation::Perspective,
            spacing: 0.5,
        };
        let seen: Vec<Seen> = (0..mesh.triangles.len() as u32)
            .map(|triangle| (triangle, Vec2::new(unit() * 640.0, unit() * 360.0)))
            .collect();
        let mut hits = Vec::new();
        finder.find_all(&seen, &mut hits);
        assert_eq!(hits.len(), seen.len());
        for (hit, &(triangle, position)) in hits.iter().zip(&seen) {
            assert_eq!(*hit, finder.find(triangle, position), "{triangle} at {position}");
        }
    }
}
