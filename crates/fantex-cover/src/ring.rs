//! The geometry of one fan, gathered once for all that is asked of it.

use glam::Vec3;

use crate::surface::Surface;

/// A fan relative to its centre. Keeps its buffers between fans.
#[derive(Default)]
pub(crate) struct Ring {
    /// The centre's position, mesh space.
    pub(crate) center: Vec3,
    /// True where the fan surrounds its centre.
    pub(crate) closed: bool,
    /// From the centre to the ring vertices in the order of the walk. Triangle `i` lies between spokes `i` and `i + 1`; the
    /// last spoke of a closed fan repeats the first.
    pub(crate) spokes: Vec<Vec3>,
    /// Unit normals of the triangles, on the fan's front side.
    pub(crate) normals: Vec<Vec3>,
    /// Sum of the triangles' areas.
    pub(crate) area: f32,
}

impl Ring {
    /// Replaces the contents by a fan of the surface.
    pub(crate) fn gather(&mut self, surface: &Surface<'_>, fan: usize) {
        let corners = surface.fans.corners(fan);
        self.center = surface.fan_center(fan);
        self.closed = surface.fans.is_closed(fan);
        self.spokes.clear();
        self.normals.clear();
        self.area = 0.0;
        for &corner in corners {
            let vertex = surface.mesh.triangles[corner.triangle()][corner.slots()[1]];
            self.spokes.push(surface.mesh.positions[vertex as usize] - self.center);
            let (normal, area) = surface.fan_facet(corner);
            self.normals.push(normal);
            self.area += area;
        }
        let last = match corners.last() {
            Some(&last) if !self.closed => surface.fan_triangle(last)[2] - self.center,
            _ => self.spokes[0],
        };
        self.spokes.push(last);
    }
}
