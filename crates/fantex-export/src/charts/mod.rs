//! Cutting the surface into pieces that are laid flat: from the groups of the cover to a few large charts.
//!
//! ```text
//!  groups --every triangle to one--> atoms --join neighbours that face alike--> patches --cut where they overlap--> charts
//! ```
//!
//! A group sees its own triangles well and its neighbours mostly too, so groups are joined as long as one projection serves
//! the union: fewer charts have less border, and border costs padding.

mod atoms;
mod join;
mod normal_set;
mod overlap;

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use glam::{Vec2, Vec3};

pub(crate) use atoms::Edge;

/// A piece of the surface in one orthogonal projection, none of whose triangles overlap.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// Its triangles, ascending.
    pub(crate) triangles: Vec<u32>,
    /// Unit vectors, mesh space: those of growing u and of growing v. (`v_axis x u_axis` faces the surface, since v points
    /// downwards in a picture.)
    axes: [Vec3; 2],
    /// Lower corner of its rectangle in the plane, mesh units.
    low: Vec2,
    /// Sides of its rectangle, mesh units.
    pub(crate) extent: Vec2,
}

impl Chart {
    /// The projection along `direction` (unit) in which the piece's rectangle is smallest, lying on its long side.
    pub(crate) fn new(mesh: &Mesh, triangles: Vec<u32>, direction: Vec3) -> Self {
        let (first, second) = direction.any_orthonormal_pair();
        let points: Vec<Vec2> = triangles
            .iter()
            .flat_map(|&t| mesh.triangle_positions(t as usize))
            .map(|p| Vec2::new(p.dot(first), p.dot(second)))
            .collect();
        let turned = (0..TURNS).map(|turn| {
            let x = Vec2::from_angle(turn as f32 * std::f32::consts::PI / TURNS as f32);
            let y = x.perp();
            let low_high = points.iter().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| {
                let q = Vec2::new(p.dot(x), -p.dot(y));
                (low.min(q), high.max(q))
            });
            (x, low_high.0, low_high.1 - low_high.0)
        });
        let lying = turned.filter(|(_, _, extent)| extent.x >= extent.y);
        let smallest = lying.min_by(|a, b| a.2.element_product().total_cmp(&b.2.element_product()));
        // Of two directions at a right angle, at least one lies.
        let (x, low, extent) = smallest.unwrap_or((Vec2::X, Vec2::ZERO, Vec2::ZERO));
        let y = x.perp();
        Self { triangles, axes: [first * x.x + second * x.y, -(first * y.x + second * y.y)], low, extent }
    }

    /// Plane coordinates of a point, mesh units, not negative for points of the chart.
    pub(crate) fn plane_from_mesh(&self, p_mesh: Vec3) -> Vec2 {
        Vec2::new(p_mesh.dot(self.axes[0]), p_mesh.dot(self.axes[1])) - self.low
    }

    /// Plane coordinates of a triangle's corners.
    pub(crate) fn corners(&self, mesh: &Mesh, triangle: u32) -> [Vec2; 3] {
        mesh.triangle_positions(triangle as usize).map(|p| self.plane_from_mesh(p))
    }

    /// The cosine of the angle between the projection's direction and a triangle's normal.
    pub(crate) fn facing(&self, mesh: &Mesh, triangle: u32) -> f32 {
        facet_normal(mesh, triangle as usize).dot(self.axes[1].cross(self.axes[0]))
    }
}

/// Directions that are tried for a chart's sides, over half a turn. Even, so that right angles are among them.
const TURNS: u32 = 32;

/// All charts of a mesh; every triangle lies in exactly one. The same on any number of threads.
pub(crate) fn charts(mesh: &Mesh, cover: &Cover, texels_per_unit: f32) -> Vec<Chart> {
    let edges = atoms::edges(mesh);
    let atoms = atoms::atoms(mesh, cover, &edges);
    let patches = join::join(mesh, &atoms, &edges, texels_per_unit);
    patches.into_iter().flat_map(|patch| overlap::charts_of(mesh, patch, texels_per_unit)).collect()
}

/// Unit normal of a triangle by its winding.
fn facet_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    facet(mesh, triangle).normalize_or(Vec3::Z)
}

/// The normal of a triangle, as long as twice its area.
fn facet(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle).map(Vec3::as_dvec3);
    (b - a).cross(c - a).as_vec3()
}

/// Twice the area of a triangle, square mesh units.
pub(crate) fn doubled_area(mesh: &Mesh, triangle: usize) -> f32 {
    facet(mesh, triangle).length()
}

/// The root of an element in a union-find forest; shortens paths.
fn root(parents: &mut [u32], mut index: u32) -> u32 {
    while parents[index as usize] != index {
        parents[index as usize] = parents[parents[index as usize] as usize];
        index = parents[index as usize];
    }
    index
}
