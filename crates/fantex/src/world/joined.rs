//! Several meshes as one.

use fantex_mesh::{Mesh, WorldFromMesh};

/// Meshes one after the other, in one mesh space.
#[derive(Debug)]
pub(crate) struct JoinedMesh {
    /// All of them; attributes are left to whoever adds a mesh.
    pub(crate) mesh: Mesh,
    pub(crate) firsts: FirstTriangles,
}

impl JoinedMesh {
    /// Nothing, in a mesh space.
    pub(crate) fn new(world_from_mesh: WorldFromMesh) -> Self {
        Self { mesh: Mesh { world_from_mesh, ..Mesh::default() }, firsts: FirstTriangles::default() }
    }

    /// Adds positions and triangles of a mesh, where they lie in the world.
    pub(crate) fn add(&mut self, mesh: &Mesh) {
        let (from, to) = (mesh.world_from_mesh, self.mesh.world_from_mesh);
        self.firsts.0.push(self.mesh.triangles.len() as u32);
        let vertices = self.mesh.positions.len() as u32;
        let moved = |&p| if from == to { p } else { to.inverse_point(from.point(p)) };
        self.mesh.positions.extend(mesh.positions.iter().map(moved));
        self.mesh.triangles.extend(mesh.triangles.iter().map(|corners| corners.map(|v| v + vertices)));
    }
}

/// The first triangle of each of several meshes that follow each other.
#[derive(Clone, Debug, Default)]
pub(crate) struct FirstTriangles(Vec<u32>);

impl FirstTriangles {
    /// Which of the meshes a triangle of all belongs to, and its number there.
    pub(crate) fn locate(&self, triangle: u32) -> (usize, u32) {
        let mesh = self.0.partition_point(|&first| first <= triangle) - 1;
        (mesh, triangle - self.0[mesh])
    }
}
