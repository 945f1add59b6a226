//! Where a plane cuts the model: the line that symmetry mirrors at.

use fantex_paint::Surface;
use glam::DVec3;

use super::Viewpoint;

/// The line along which a plane orthogonal to an axis cuts a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// The axis and where the plane meets it, world units.
    plane: Option<(usize, f64)>,
    /// Ends in world space.
    pieces: Vec<[DVec3; 2]>,
    seen_from: Option<Viewpoint>,
    seen: Vec<[DVec3; 2]>,
}

/// Pieces that are tested for what lies before them.
const MOST_RAYS: usize = 5000;

impl Section {
    /// Brings the line up to date with a plane; costs something only where that is another one.
    pub fn follow(&mut self, surface: &Surface, axis: usize, offset: f64) {
        if self.plane == Some((axis, offset)) {
            return;
        }
        self.plane = Some((axis, offset));
        let place = surface.mesh().world_from_mesh;
        self.pieces.clear();
        self.seen_from = None;
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
                self.pieces.push([a, b]);
            }
        }
    }

    /// The pieces that are seen, with nothing before them. Costs something only where the view is another one.
    pub fn seen(&mut self, surface: &Surface, view: &Viewpoint) -> &[[DVec3; 2]] {
        if self.seen_from != Some(*view) {
            self.seen_from = Some(*view);
            let eye = view.rig.eye;
            let place = surface.mesh().world_from_mesh;
            let from = place.inverse_point(eye);
            let is_free = |middle: DVec3| {
                let to = place.inverse_point(middle);
                let hit = surface.hit(from, (to - from).normalize_or_zero());
                hit.is_none_or(|hit| {
                    let near = surface.position(hit).as_vec3().distance(from);
                    near > to.distance(from) * (1.0 - 2e-3)
                })
            };
            // A line of a great many pieces is shown with those that are hidden rather than late.
            let is_long = self.pieces.len() > MOST_RAYS;
            let seen = self.pieces.iter().filter(|[a, b]| is_long || is_free(0.5 * (*a + *b)));
            self.seen = seen.copied().collect();
        }
        &self.seen
    }
}
