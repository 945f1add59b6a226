//! The guarantees of a clean mesh that are too costly to check at every opening.

use fantex_mesh::Mesh;
use rayon::prelude::*;

/// A guarantee of [`Mesh`] that does not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshFault {
    /// Coordinates beyond [-1, 1].
    #[error("vertex {0} lies outside of the cube [-1, 1]^3")]
    OutsideCube(u32),
    /// No triangle uses a vertex.
    #[error("vertex {0} belongs to no triangle")]
    UnusedVertex(u32),
    /// Two vertices at one position.
    #[error("vertices {0} and {1} lie at the same position")]
    CoincidentVertices(u32, u32),
    /// Two triangles with the same vertices in the same cyclic order.
    #[error("triangles {0} and {1} are the same")]
    SameTriangle(u32, u32),
    /// A triangle without area.
    #[error("triangle {0} has no area")]
    NoArea(u32),
}

/// At most one fault of each kind.
pub(super) fn find(mesh: &Mesh) -> Vec<MeshFault> {
    [outside_cube(mesh), unused_vertex(mesh), coincident_vertices(mesh), same_triangle(mesh), no_area(mesh)]
        .into_iter()
        .flatten()
        .collect()
}

fn outside_cube(mesh: &Mesh) -> Option<MeshFault> {
    let vertex = mesh.positions.iter().position(|p| p.abs().max_element() > 1.0)?;
    Some(MeshFault::OutsideCube(vertex as u32))
}

fn unused_vertex(mesh: &Mesh) -> Option<MeshFault> {
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    used.iter().position(|used| !used).map(|v| MeshFault::UnusedVertex(v as u32))
}

fn coincident_vertices(mesh: &Mesh) -> Option<MeshFault> {
    // Adding zero makes -0 and 0 the same.
    let keys = mesh.positions.iter().map(|p| p.to_array().map(|x| (x + 0.0).to_bits()));
    first_pair(keys).map(|[a, b]| MeshFault::CoincidentVertices(a, b))
}

fn same_triangle(mesh: &Mesh) -> Option<MeshFault> {
    let keys = mesh.triangles.iter().map(|&[a, b, c]| {
        if a < b && a < c {
            [a, b, c]
        } else if b < c {
            [b, c, a]
        } else {
            [c, a, b]
        }
    });
    first_pair(keys).map(|[a, b]| MeshFault::SameTriangle(a, b))
}

/// Indices of the first two equal keys (in the order of the keys).
fn first_pair(keys: impl Iterator<Item = [u32; 3]>) -> Option<[u32; 2]> {
    let mut sorted: Vec<([u32; 3], u32)> = keys.zip(0..).collect();
    sorted.par_sort_unstable();
    sorted.windows(2).find(|pair| pair[0].0 == pair[1].0).map(|pair| [pair[0].1, pair[1].1])
}

fn no_area(mesh: &Mesh) -> Option<MeshFault> {
    let flat = |t: &usize| {
        let [a, b, c] = mesh.triangle_positions(*t).map(|p| p.as_dvec3());
        (b - a).cross(c - a) == glam::DVec3::ZERO
    };
    (0..mesh.triangles.len()).find(flat).map(|t| MeshFault::NoArea(t as u32))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn square() -> Mesh {
        Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn each_fault_is_found() {
        assert_eq!(find(&square()), []);
        let faults = |change: fn(&mut Mesh)| {
            let mut mesh = square();
            change(&mut mesh);
            find(&mesh)
        };
        assert_eq!(faults(|m| m.positions[1].x = 1.5), [MeshFault::OutsideCube(1)]);
        assert_eq!(faults(|m| m.positions.push(Vec3::Z)), [MeshFault::UnusedVertex(4)]);
        assert_eq!(
            faults(|m| {
                m.positions.push(-0.0 * Vec3::ONE);
                m.triangles.push([4, 3, 1]);
            }),
            [MeshFault::CoincidentVertices(0, 4)]
        );
        assert_eq!(faults(|m| m.triangles.push([2, 0, 1])), [MeshFault::SameTriangle(0, 2)]);
        assert_eq!(faults(|m| m.triangles.push([2, 1, 0])), []);
        assert_eq!(faults(|m| m.positions[1] = Vec3::splat(0.5)), [MeshFault::NoArea(0)]);
    }
}
