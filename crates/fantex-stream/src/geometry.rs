//! Where mesh and cover come from.

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use fantex_store::Asset;

/// A covered mesh: an open asset, or one made for a test.
pub trait Geometry: Send + Sync {
    /// The mesh, mesh space.
    fn mesh(&self) -> &Mesh;

    /// Its cover.
    fn cover(&self) -> &Cover;
}

impl Geometry for Asset {
    fn mesh(&self) -> &Mesh {
        self.mesh()
    }

    fn cover(&self) -> &Cover {
        self.cover()
    }
}

/// A covered mesh without texels.
#[derive(Clone, Debug)]
pub struct CoveredMesh {
    /// The mesh.
    pub mesh: Mesh,
    /// Its cover.
    pub cover: Cover,
}

impl Geometry for CoveredMesh {
    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn cover(&self) -> &Cover {
        &self.cover
    }
}
