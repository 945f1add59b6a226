//! Points of a surface, and what varies linearly over a triangle.

use std::ops::{Add, Mul};

use glam::{DVec3, Vec3};

use crate::Mesh;
use crate::ray::nearest_of_triangle;

/// Barycentric coordinates: [`Vec3`] or [`DVec3`].
pub trait Barycentric: Copy {
    /// Type of a coordinate.
    type Scalar;

    /// The coordinates of the three corners.
    fn coordinates(self) -> [Self::Scalar; 3];
}

impl Barycentric for Vec3 {
    type Scalar = f32;

    #[inline]
    fn coordinates(self) -> [f32; 3] {
        self.to_array()
    }
}

impl Barycentric for DVec3 {
    type Scalar = f64;

    #[inline]
    fn coordinates(self) -> [f64; 3] {
        self.to_array()
    }
}

/// The value at a point of a triangle, of values at its corners: `a * l.x + b * l.y + c * l.z`, in this order, without fused
/// multiplications.
///
/// A change of barycentric coordinates gives the change of the value.
#[inline(always)]
pub fn interpolate<T, L>(corners: [T; 3], lambda: L) -> T
where
    L: Barycentric,
    T: Add<Output = T> + Mul<L::Scalar, Output = T>,
{
    let ([a, b, c], [x, y, z]) = (corners, lambda.coordinates());
    a * x + b * y + c * z
}

/// The change of barycentric coordinates along a step in space, after its projection onto the triangle's plane.
pub fn lambda_step([a, b, c]: [Vec3; 3], step: Vec3) -> Vec3 {
    let normal = (b - a).cross(c - a);
    let squared = normal.length_squared().max(f32::MIN_POSITIVE);
    let along = |from: Vec3, to: Vec3| normal.cross(to - from).dot(step) / squared;
    Vec3::new(along(b, c), along(c, a), along(a, b))
}

/// A point of a mesh's surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePoint {
    /// Triangle index.
    pub triangle: u32,
    /// Barycentric coordinates, of sum one. Not negative on the triangle; the plane goes on beyond it.
    pub lambda: Vec3,
}

impl SurfacePoint {
    /// Corner 0, 1 or 2 of a triangle.
    pub fn corner(triangle: u32, corner: usize) -> Self {
        Self { triangle, lambda: Vec3::AXES[corner] }
    }

    /// The middle of a triangle.
    pub fn centroid(triangle: u32) -> Self {
        Self { triangle, lambda: Vec3::splat(1.0 / 3.0) }
    }

    /// Index of the triangle, for slices.
    #[inline]
    pub fn index(self) -> usize {
        self.triangle as usize
    }

    /// Where it is, mesh space.
    #[inline]
    pub fn position(self, mesh: &Mesh) -> Vec3 {
        self.interpolate(mesh.triangle_positions(self.index()))
    }

    /// The value here, of values at the triangle's corners: see [`interpolate`].
    #[inline]
    pub fn interpolate<T>(self, corners: [T; 3]) -> T
    where
        T: Add<Output = T> + Mul<f32, Output = T>,
    {
        interpolate(corners, self.lambda)
    }

    /// The entries of the triangle's corners in a list with one per corner of the mesh.
    #[inline]
    pub fn corner_values<T: Copy>(self, list: &[T]) -> [T; 3] {
        let first = 3 * self.index();
        [list[first], list[first + 1], list[first + 2]]
    }

    /// The unit normal here, of unit normals at all corners such as [`shading_normals`](crate::shading_normals) gives; `None` where
    /// they cancel out.
    #[inline]
    pub fn smooth_normal(self, normals: &[Vec3]) -> Option<Vec3> {
        self.interpolate(self.corner_values(normals)).try_normalize()
    }

    /// Unit normal of the triangle's front, mesh space: see [`Mesh::facet_normal`].
    pub fn facet_normal(self, mesh: &Mesh) -> Vec3 {
        mesh.facet_normal(self.index()).as_vec3()
    }

    /// The point of the triangle that is nearest to this one of its plane.
    pub fn on_triangle(self, mesh: &Mesh) -> Self {
        if self.lambda.min_element() >= 0.0 {
            return self.clamped();
        }
        let corners = mesh.triangle_positions(self.index()).map(|p| p.as_dvec3());
        let (lambda, _) = nearest_of_triangle(interpolate(corners, self.lambda.as_dvec3()), corners);
        if lambda.is_finite() { Self { lambda: lambda.as_vec3(), ..self } } else { self.clamped() }
    }

    /// A point of the triangle near this one of its plane: as near as [`on_triangle`](Self::on_triangle) is where the triangle's sides do not
    /// differ much.
    #[inline]
    pub fn clamped(self) -> Self {
        let inside = self.lambda.max(Vec3::ZERO);
        Self { lambda: inside / inside.element_sum().max(f32::MIN_POSITIVE), ..self }
    }
}
