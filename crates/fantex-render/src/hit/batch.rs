//! The points of many triangles at once, in vectors: every step is that of the scalar path in the same order, so that the
//! results are equal.

use std::sync::LazyLock;

use fearless_simd::{Level, Select, Simd, dispatch, prelude::*};
use glam::{DMat3, Vec2, Vec3};

use super::{Hit, HitFinder, Interpolation};

/// Points of a block; a whole number of vectors.
const BLOCK: usize = 16;

fn level() -> Level {
    static LEVEL: LazyLock<Level> = LazyLock::new(Level::new);
    *LEVEL
}

/// A triangle and the position in pixels where it is seen.
pub(crate) type Seen = (u32, Vec2);

/// What a block asks: coordinates of the corners relative to the eye, and positions in pixels.
struct Question {
    /// Three coordinates of the first corner, of the second, of the third.
    corners: [[f64; BLOCK]; 9],
    position: [[f64; BLOCK]; 2],
}

/// What it learns: barycentric coordinates, their change to the right, and downwards.
struct Answer([[f32; BLOCK]; 9]);

impl HitFinder<'_> {
    /// [`HitFinder::find`] for many triangles and positions.
    pub(crate) fn find_all(&self, seen: &[Seen], hits: &mut Vec<Hit>) {
        if self.interpolation == Interpolation::Affine {
            hits.extend(seen.iter().map(|&(triangle, position)| self.find(triangle, position)));
            return;
        }
        let (screen_from_view, eye) = self.projection.screen_from_view();
        let mut question = Question { corners: [[1.0; BLOCK]; 9], position: [[0.0; BLOCK]; 2] };
        let mut answer = Answer([[0.0; BLOCK]; 9]);
        for seen in seen.chunks(BLOCK) {
            for (index, &(triangle, position)) in seen.iter().enumerate() {
                let corners = self.mesh.triangle_positions(triangle as usize);
                for (corner, at) in corners.into_iter().enumerate() {
                    let relative = at.as_dvec3() - eye;
                    question.corners[3 * corner][index] = relative.x;
                    question.corners[3 * corner + 1][index] = relative.y;
                    question.corners[3 * corner + 2][index] = relative.z;
                }
                question.position[0][index] = f64::from(position.x);
                question.position[1][index] = f64::from(position.y);
            }
            dispatch!(level(), simd => barycentrics(simd, &screen_from_view, &question, &mut answer));
            for (index, &(triangle, _)) in seen.iter().enumerate() {
                let [a, b, c] = [0, 3, 6].map(|first| {
                    let [x, y, z] = [first, first + 1, first + 2].map(|row| answer.0[row][index]);
                    Vec3::new(x, y, z)
                });
                hits.push(self.hit(triangle as usize, [a, b, c]));
            }
        }
    }
}

#[inline(always)]
fn barycentrics<S: Simd>(simd: S, matrix: &DMat3, question: &Question, answer: &mut Answer) {
    let half = S::f64s::LEN;
    for first in (0..BLOCK).step_by(2 * half) {
        let low = at(simd, matrix, question, first);
        let high = at(simd, matrix, question, first + half);
        for row in 0..9 {
            low[row].narrow(high[row]).store_slice(&mut answer.0[row][first..first + 2 * half]);
        }
    }
}

type Vector<F> = [F; 3];

/// As `ScreenBarycentrics::new` and `at`.
#[inline(always)]
fn at<S: Simd>(simd: S, matrix: &DMat3, question: &Question, first: usize) -> [S::f64s; 9] {
    let a = projected(simd, matrix, question, 0, first);
    let b = projected(simd, matrix, question, 3, first);
    let c = projected(simd, matrix, question, 6, first);
    let shares = [cross::<S>(b, c), cross::<S>(c, a), cross::<S>(a, b)];
    let x = load(simd, &question.position[0], first);
    let y = load(simd, &question.position[1], first);
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
fn load<S: Simd>(simd: S, numbers: &[f64; BLOCK], first: usize) -> S::f64s {
    S::f64s::from_slice(simd, &numbers[first..first + S::f64s::LEN])
}

/// Screen-homogeneous coordinates of a corner.
#[inline(always)]
fn projected<S: Simd>(
    simd: S,
    matrix: &DMat3,
    question: &Question,
    corner: usize,
    first: usize,
) -> Vector<S::f64s> {
    let x = load(simd, &question.corners[corner], first);
    let y = load(simd, &question.corners[corner + 1], first);
    let z = load(simd, &question.corners[corner + 2], first);
    let DMat3 { x_axis, y_axis, z_axis } = *matrix;
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
    use fantex_mesh::Mesh;
    use fantex_scene::{Camera, Projection};
    use glam::DVec3;

    use super::*;

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
