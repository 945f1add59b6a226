//! Colours computed from triangle and barycentric coordinates, for pictures that explain.

use fantex_mesh::Mesh;
use glam::Vec3;

use crate::normals::{CornerNormals, face_normal};
use crate::{Hit, MaterialSample, SmoothPoint, Surface};

/// Which normals a [`FlatSurface`] has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FlatShading {
    /// Not lit at all: the colour is the picture.
    #[default]
    Unlit,
    /// Facets.
    Faceted,
    /// The mesh's shading normals.
    Smooth,
}

/// A surface whose linear RGB colour is a function of the hit.
#[derive(Debug)]
pub struct FlatSurface<'a, F> {
    mesh: &'a Mesh,
    normals: Option<CornerNormals>,
    unlit: bool,
    color: F,
}

impl<'a, F: Fn(&Hit) -> Vec3 + Sync> FlatSurface<'a, F> {
    /// Colours `mesh` by `color`.
    pub fn new(mesh: &'a Mesh, shading: FlatShading, color: F) -> Self {
        let normals = (shading == FlatShading::Smooth).then(|| CornerNormals::of_mesh(mesh));
        Self { mesh, normals, unlit: shading == FlatShading::Unlit, color }
    }
}

impl<F: Fn(&Hit) -> Vec3 + Sync> Surface for FlatSurface<'_, F> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        let (normal, normal_steps) = match &self.normals {
            Some(normals) => normals.with_steps(self.mesh, hit),
            None => (face_normal(self.mesh, hit.triangle), [Vec3::ZERO; 2]),
        };
        MaterialSample {
            base_color: (self.color)(hit),
            unlit: self.unlit,
            normal_steps,
            ..MaterialSample::with_normal(if hit.front { normal } else { -normal })
        }
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.normals.as_ref().map(|normals| normals.smooth_point(self.mesh, hit))
    }
}
