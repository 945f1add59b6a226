//! Blended triangles, the farthest first.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::View;

/// The blended triangles of a mesh and their order for one eye.
///
/// They are sorted by the depth of their centres, anew whenever the camera has moved: fine for panes and leaves, but a million
/// blended triangles take longer than a frame should. Triangles that intersect, or overlap in a cycle, have no right order.
#[derive(Debug)]
pub(crate) struct SortedTriangles {
    triangles: Vec<SortedTriangle>,
    /// Indices into `triangles`, the farthest first.
    order: Vec<u32>,
    /// What the order is for.
    seen: Option<(DVec3, Vec3)>,
}

/// A blended triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SortedTriangle {
    pub(crate) centre: Vec3,
    pub(crate) corners: [u32; 3],
    pub(crate) material: u32,
    /// It is not seen from behind.
    pub(crate) has_twin: bool,
}

/// Triangles of one material that follow each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub(crate) material: u32,
    /// Whether they have twins, and so are not seen from behind.
    pub(crate) has_twins: bool,
    /// Of the sorted indices.
    pub(crate) indices: std::ops::Range<u32>,
}

impl SortedTriangles {
    pub(crate) fn new(triangles: Vec<SortedTriangle>) -> Self {
        let order = (0..triangles.len() as u32).collect();
        Self { triangles, order, seen: None }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Number of corners.
    pub(crate) fn index_count(&self) -> usize {
        3 * self.triangles.len()
    }

    /// Sorts for a view; the corners in drawing order and their runs, or nothing where the order is already that.
    pub(crate) fn sort(&mut self, view: &View) -> Option<(Vec<[u32; 3]>, Vec<Run>)> {
        let backward = view.axes.z_axis;
        if self.is_empty() || self.seen == Some((view.eye, backward)) {
            return None;
        }
        self.seen = Some((view.eye, backward));
        let nearness: Vec<f32> = self.triangles.iter().map(|t| t.centre.dot(backward)).collect();
        // Of equally near ones, the mesh's later triangle lies on top.
        self.order.par_sort_unstable_by(|&a, &b| {
            nearness[a as usize].total_cmp(&nearness[b as usize]).then_with(|| a.cmp(&b))
        });
        let sorted = self.order.iter().map(|&i| self.triangles[i as usize]);
        let mut runs: Vec<Run> = Vec::new();
        for (triangle, first) in sorted.clone().zip((0u32..).step_by(3)) {
            match runs.last_mut() {
                Some(run) if run.material == triangle.material && run.has_twins == triangle.has_twin => {
                    run.indices.end = first + 3;
                }
                _ => runs.push(Run {
                    material: triangle.material,
                    has_twins: triangle.has_twin,
                    indices: first..first + 3,
                }),
            }
        }
        Some((sorted.map(|t| t.corners).collect(), runs))
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;

    #[test]
    fn the_farthest_comes_first() {
        let triangle = |z: f32, material| SortedTriangle {
            centre: Vec3::Z * z,
            corners: [material; 3],
            material,
            has_twin: false,
        };
        let mut sorted = SortedTriangles::new(vec![triangle(0.5, 1), triangle(-0.5, 1), triangle(0.0, 2)]);
        let mut view =
            View { size: [8, 8], eye: DVec3::Z * 3.0, axes: Mat3::IDENTITY, fov_radians: 1.0, near: 0.1 };
        let (corners, runs) = sorted.sort(&view).unwrap();
        assert_eq!(corners, [[1; 3], [2; 3], [1; 3]]);
        assert_eq!(runs.len(), 3);
        assert_eq!(sorted.sort(&view), None, "nothing has moved");
        view.axes.z_axis = Vec3::NEG_Z;
        let (corners, runs) = sorted.sort(&view).unwrap();
        assert_eq!(corners.len(), 3);
        assert_eq!(runs[0], Run { material: 1, has_twins: false, indices: 0..3 });
    }
}
