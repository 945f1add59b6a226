//! From a screen position back to the point of a triangle.

mod batch;

use fantex_mesh::Mesh;
use glam::{DVec3, Vec2, Vec3};

use fantex_scene::Projection;

pub(crate) use batch::Seen;

/// A point of the surface that is being shaded, and how it moves with the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the mesh's triangle.
    pub triangle: usize,
    /// Barycentric coordinates: not negative, their sum is one.
    pub lambda: Vec3,
    /// Change of `lambda` per pixel to the right; the sum is zero. Smaller where samples are shaded on their own.
    pub dlambda_dx: Vec3,
    /// Change of `lambda` per pixel downwards; the sum is zero.
    pub dlambda_dy: Vec3,
    /// True where the eye sees the front (counter-clockwise) side.
    pub front: bool,
    /// Unit vector from the point to the eye, mesh space.
    pub to_eye: Vec3,
}

impl Hit {
    /// The point, mesh space.
    pub fn position(&self, mesh: &Mesh) -> Vec3 {
        self.blend(mesh.triangle_positions(self.triangle))
    }

    /// Interpolates values of the triangle's corners.
    pub fn blend<T>(&self, corners: [T; 3]) -> T
    where
        T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
    {
        let [a, b, c] = corners;
        a * self.lambda.x + b * self.lambda.y + c * self.lambda.z
    }

    /// Interpolates coordinates of the triangle's corners; also their change per pixel to the right and downwards.
    pub fn blend_coordinates(&self, [a, b, c]: [Vec2; 3]) -> (Vec2, [Vec2; 2]) {
        let along = |l: Vec3| a * l.x + b * l.y + c * l.z;
        (along(self.lambda), [along(self.dlambda_dx), along(self.dlambda_dy)])
    }
}

/// How attributes are interpolated over the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Perspective-correct: `u(P) = sum(l_i u_i / w_i) / sum(l_i / w_i)` with screen barycentrics `l_i`.
    #[default]
    Perspective,
    /// Linear over the screen, which is wrong and shows break lines along triangle edges. Triangles that reach behind
    /// the eye have no linear interpolation and keep the correct one.
    Affine,
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
    /// For a triangle's screen-homogeneous corners.
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
        let shares = DVec3::from_array(self.shares.map(|s| s.dot(p)));
        let sum = shares.element_sum();
        let lambda = shares / sum;
        let slope = |d: [f64; 3]| {
            let d = DVec3::from_array(d);
            (d - lambda * d.element_sum()) / sum
        };
        let [dx, dy] = [slope(self.shares.map(|s| s.x)), slope(self.shares.map(|s| s.y))];
        if !(lambda.is_finite() && dx.is_finite() && dy.is_finite()) {
            return [Vec3::splat(1.0 / 3.0), Vec3::ZERO, Vec3::ZERO];
        }
        let inside = lambda.clamp(DVec3::ZERO, DVec3::ONE);
        let bounded = |d: DVec3| d.clamp(DVec3::splat(-1e6), DVec3::splat(1e6)).as_vec3();
        [(inside / inside.element_sum()).as_vec3(), bounded(dx), bounded(dy)]
    }
}

/// Finds the points of triangles under screen positions.
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

    /// The hit with these barycentric coordinates and their changes.
    fn hit(&self, triangle: usize, [lambda, dx, dy]: [Vec3; 3]) -> Hit {
        let [a, b, c] = self.mesh.triangle_positions(triangle);
        let normal = (b - a).cross(c - a);
        Hit {
            triangle,
            lambda,
            dlambda_dx: dx * self.spacing,
            dlambda_dy: dy * self.spacing,
            front: normal.dot(self.projection.eye - a) >= 0.0,
            to_eye: (self.projection.eye - (a * lambda.x + b * lambda.y + c * lambda.z))
                .normalize_or(Vec3::Z),
        }
    }
}

#[cfg(test)]
mod tests {
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
        let p = (screen[0] * l.x + screen[1] * l.y + screen[2] * l.z).as_vec2();
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
}
