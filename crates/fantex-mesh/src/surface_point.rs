//! Points of a surface, and what varies linearly over a triangle.

use std::ops::{Add, Mul};

use glam::{DVec3, Vec3};

use crate::Mesh;

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

    /// Unit normal of the triangle's front, mesh space: see [`Mesh::facet_normal`].
    pub fn facet_normal(self, mesh: &Mesh) -> Vec3 {
        mesh.facet_normal(self.index()).as_vec3()
    }

    /// A point of the triangle near this one of its plane.
    #[inline]
    pub fn clamped(self) -> Self {
        let inside = self.lambda.max(Vec3::ZERO);
        Self { lambda: inside / inside.element_sum().max(f32::MIN_POSITIVE), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh() -> Mesh {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() }
    }

    #[test]
    fn corners_and_centroid_are_where_they_should_be() {
        let mesh = mesh();
        for (corner, &position) in mesh.positions.iter().enumerate() {
            assert_eq!(SurfacePoint::corner(0, corner).position(&mesh), position);
        }
        let centroid = SurfacePoint::centroid(0);
        assert!(centroid.position(&mesh).distance(Vec3::new(1.0, 1.0, 0.0) / 3.0) < 1e-7);
        assert_eq!(centroid.facet_normal(&mesh), Vec3::Z);
        assert_eq!(interpolate([1.0, 2.0, 4.0], DVec3::new(0.5, 0.25, 0.25)), 2.0);
    }

    #[test]
    fn points_beside_a_triangle_are_moved_onto_it() {
        let beside = SurfacePoint { triangle: 0, lambda: Vec3::new(0.75, 0.75, -0.5) };
        assert_eq!(beside.clamped().lambda, Vec3::new(0.5, 0.5, 0.0));
        let inside = SurfacePoint::corner(0, 1);
        assert_eq!(inside.clamped(), inside);
    }
}
