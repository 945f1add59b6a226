//! The mesh as the cover's construction sees it: normals, areas, fans.

use fantex_mesh::{FanCorner, Fans, Mesh};
use glam::Vec3;
use rayon::prelude::*;

/// A mesh with per-triangle geometry and its fans. Lengths are mesh units.
pub(crate) struct Surface<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) fans: Fans,
    /// Unit normal of each triangle, by its winding.
    pub(crate) normals: Vec<Vec3>,
    /// Area of each triangle.
    pub(crate) areas: Vec<f32>,
}

impl<'a> Surface<'a> {
    pub(crate) fn new(mesh: &'a Mesh, fans: Fans) -> Self {
        let (normals, areas) = mesh
            .triangles
            .par_iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
                // Double precision: slivers of long meshes lose all digits of a single-precision cross product.
                let cross = (b - a).cross(c - a);
                let length = cross.length();
                ((cross / length.max(f64::MIN_POSITIVE)).as_vec3(), 0.5 * length as f32)
            })
            .unzip();
        Self { mesh, fans, normals, areas }
    }

    /// The normal of a fan's triangle, on the fan's front side.
    pub(crate) fn fan_normal(&self, corner: FanCorner) -> Vec3 {
        let n = self.normals[corner.triangle()];
        if corner.reversed() { -n } else { n }
    }

    /// Positions of the centre and of the earlier and later ring vertex.
    pub(crate) fn fan_triangle(&self, corner: FanCorner) -> [Vec3; 3] {
        let t = self.mesh.triangle_positions(corner.triangle());
        corner.slots().map(|k| t[k])
    }

    /// The centre vertex' position.
    pub(crate) fn fan_center(&self, fan: usize) -> Vec3 {
        self.fan_triangle(self.fans.corners(fan)[0])[0]
    }
}
