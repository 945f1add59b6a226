//! What a walker stands on and bumps into.

use std::sync::Arc;

use fantex_mesh::{Mesh, TriangleBvh};
use fantex_store::Asset;
use glam::DVec3;

/// Where a ray meets the scene. World space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundHit {
    /// World units along the ray.
    pub distance: f64,
    /// Unit normal of the surface, towards where the ray comes from.
    pub normal: DVec3,
}

/// A scene that can be asked for the first thing on a ray.
pub trait Ground {
    /// The first surface, from either side, at most `reach` world units along a unit direction. World space.
    fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit>;
}

/// A mesh and the tree of its triangles.
#[derive(Debug)]
pub struct MeshGround {
    owner: MeshOwner,
    tree: TriangleBvh,
}

#[derive(Debug)]
enum MeshOwner {
    Model(Arc<Mesh>),
    Asset(Arc<Asset>),
}

impl MeshOwner {
    fn mesh(&self) -> &Mesh {
        match self {
            Self::Model(mesh) => mesh,
            Self::Asset(asset) => asset.mesh(),
        }
    }
}

impl MeshGround {
    /// Builds the tree of a model: two seconds for a million triangles, so in the background.
    pub fn of_model(mesh: Arc<Mesh>) -> Self {
        Self::new(MeshOwner::Model(mesh))
    }

    /// As [`MeshGround::of_model`], of an asset.
    pub fn of_asset(asset: Arc<Asset>) -> Self {
        Self::new(MeshOwner::Asset(asset))
    }

    fn new(owner: MeshOwner) -> Self {
        Self { tree: TriangleBvh::new(owner.mesh()), owner }
    }
}

impl Ground for MeshGround {
    fn first(&self, origin: DVec3, direction: DVec3, reach: f64) -> Option<GroundHit> {
        let mesh = self.owner.mesh();
        let place = mesh.world_from_mesh;
        // Axes of both spaces agree; lengths differ by the scale.
        let hit = self.tree.first_hit(
            place.inverse_point(origin),
            direction.as_vec3(),
            (reach / place.scale) as f32,
        )?;
        let [a, b, c] = mesh.triangle_positions(hit.triangle).map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a).normalize_or(-direction);
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        Some(GroundHit { distance: f64::from(hit.distance) * place.scale, normal })
    }
}

#[cfg(test)]
mod tests {
    use fantex_mesh::generate::torus;
    use fantex_mesh::{CleanOptions, clean};

    use super::*;

    #[test]
    fn hits_are_in_world_units() {
        let mut model = torus(48, 24);
        for p in &mut model.positions {
            *p = *p * 100.0 + DVec3::new(5000.0, -300.0, 20.0);
        }
        let (mesh, _) = clean(model, &CleanOptions::default()).unwrap();
        let ground = MeshGround::of_model(Arc::new(mesh));
        // On the circle in the middle of the tube, whose radius is the torus' smaller one.
        let above = DVec3::new(5100.0, 0.0, 20.0);
        let hit = ground.first(above, DVec3::NEG_Y, 1e4).unwrap();
        let tube = 300.0 - hit.distance;
        assert!((20.0..60.0).contains(&tube), "{hit:?}");
        assert!(hit.normal.y > 0.9);
        assert_eq!(ground.first(above, DVec3::NEG_Y, 100.0), None, "beyond the reach");
    }
}
