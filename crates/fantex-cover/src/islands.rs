//! Components of a surface that lie in a plane: leaves of trees, loose triangles.
//!
//! Where one of them is a single group, other cuts do not make that cheaper, and nothing joins it. Small tiles lose much, but that of theirs is no
//! reason to lay anything flat freely.

use fantex_base::UnionFind;

use crate::fan_shape::FanShape;
use crate::surface::Surface;

/// Cosine of the widest cone of normals around a vertex where nothing is bent.
pub(crate) const FLAT_COSINE: f32 = 0.999_998;

/// For every fan the number of fans in its component where that is such an island, else 0. Empty where nobody has looked: then none is known.
#[derive(Default)]
pub(crate) struct Islands(Vec<u32>);

impl Islands {
    pub(crate) fn of(surface: &Surface<'_>, shapes: &[FanShape]) -> Self {
        let mut components = UnionFind::new(shapes.len());
        for corner in (0..3 * surface.mesh.triangles.len()).step_by(3) {
            let [a, b, c] = [0, 1, 2].map(|slot| surface.fans.of_corner(corner + slot));
            components.union(a, b);
            components.union(a, c);
        }
        let of: Vec<usize> = (0..shapes.len() as u32).map(|fan| components.find(fan) as usize).collect();
        let mut fans = vec![0; shapes.len()];
        of.iter().for_each(|&component| fans[component] += 1);
        for (shape, &component) in shapes.iter().zip(&of) {
            // Both sides of a leaf are alike.
            let cosine = shape.axis.dot(shapes[component].axis).abs();
            if cosine.min(shape.cone.cos) <= FLAT_COSINE {
                fans[component] = 0;
            }
        }
        Self(of.into_iter().map(|component| fans[component]).collect())
    }

    /// Whether `count` fans of one group, such as this one, are a whole island.
    pub(crate) fn has(&self, fan: u32, count: u32) -> bool {
        self.0.get(fan as usize) == Some(&count)
    }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, Fans, Model, VertexCorners, clean, generate};
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::watch::Watch;

    #[test]
    fn islands_are_flat_whole_components() {
        // A cube, a flat sheet of 25 vertices in a slanting plane, two triangles that meet at an angle, and one alone.
        let mut all = Model::default();
        let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), 0.7);
        let add = |all: &mut Model, positions: &[DVec3], triangles: &[[u32; 3]], x: f64| {
            let first = all.positions.len() as u32;
            all.positions.extend(positions.iter().map(|&p| turn * p + DVec3::X * x));
            all.triangles.extend(triangles.iter().map(|t| t.map(|v| v + first)));
        };
        let (cube, sheet) = (generate::cube(1), generate::grid(4));
        add(&mut all, &cube.positions, &cube.triangles, 0.0);
        add(&mut all, &sheet.positions, &sheet.triangles, 5.0);
        let bent = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.1)];
        add(&mut all, &bent, &[[0, 1, 2], [1, 3, 2]], 9.0);
        add(&mut all, &bent[..3], &[[0, 1, 2]], 12.0);
        let (mesh, _) = clean(all, &CleanOptions::default()).unwrap();
        let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
        let surface = Surface::new(&mesh, Fans::by_angle(&mesh, &corners));
        let shapes = crate::build::shape_fans(&surface, &Watch::new(&|_| true));
        let islands = Islands::of(&surface, &shapes);
        let mut known: Vec<u32> = islands.0.clone();
        known.sort_unstable();
        assert_eq!(known, [vec![0; 8 + 4], vec![3; 3], vec![25; 25]].concat());
        let alone = islands.0.iter().position(|&count| count == 3).unwrap() as u32;
        assert!(islands.has(alone, 3) && !islands.has(alone, 2));
        assert!(!Islands::default().has(alone, 3));
    }
}
