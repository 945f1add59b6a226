//! Where a plane cuts the model: the line that symmetry mirrors at.

use fantex_paint::Surface;
use glam::DVec3;

use super::Viewpoint;

/// The line along which a plane orthogonal to an axis cuts a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// The axis and where the plane meets it, world units.
    plane: Option<(usize, f64)>,
    /// Ends in world space, and the unit normal of their triangle.
    pieces: Vec<([DVec3; 2], DVec3)>,
}

impl Section {
    /// Brings the line up to date with a plane; costs something only where that is another one.
    pub fn follow(&mut self, surface: &Surface, axis: usize, offset: f64) {
        if self.plane == Some((axis, offset)) {
            return;
        }
        self.plane = Some((axis, offset));
        let place = surface.mesh().world_from_mesh;
        self.pieces.clear();
        for triangle in 0..surface.mesh().triangles.len() {
            let corners = surface.mesh().triangle_positions(triangle).map(|p| place.point(p));
            let heights = corners.map(|corner| corner[axis.min(2)] - offset);
            let crossing = |k: usize| {
                let (a, b) = (k, (k + 1) % 3);
                let is_crossed = (heights[a] >= 0.0) != (heights[b] >= 0.0);
                is_crossed.then(|| corners[a].lerp(corners[b], heights[a] / (heights[a] - heights[b])))
            };
            let mut ends = (0..3).filter_map(crossing);
            if let (Some(a), Some(b)) = (ends.next(), ends.next()) {
                self.pieces.push(([a, b], surface.facet_normal(triangle as u32)));
            }
        }
    }

    /// The pieces on triangles that are turned towards the viewer.
    pub fn facing(&self, view: &Viewpoint) -> impl Iterator<Item = [DVec3; 2]> {
        let eye = view.rig.eye;
        let pieces = self.pieces.iter();
        pieces.filter(move |(ends, normal)| (eye - ends[0]).dot(*normal) > 0.0).map(|(ends, _)| *ends)
    }
}
