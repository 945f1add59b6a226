//! An object that mirrors an environment of its own.
//!
//! The extended Phong model: a term `reflectance * C_env(r)` is added to what the lights do, `r` being the mirrored view
//! ray. It is for objects whose environment was captured from where they stand, while the rest of the scene has another.

use fantex_mesh::Mesh;
use fantex_texture::environment::EnvironmentProxy;
use glam::{DVec3, Vec3};

use crate::{Coverage, EnvironmentLight, Finish, Hit, MaterialSample, SmoothPoint, Surface};
use fantex_scene::MirrorView;

/// A mirrored environment.
#[derive(Clone, Debug)]
pub struct ObjectReflection {
    /// What is mirrored.
    pub environment: EnvironmentLight,
    /// Linear RGB: how much of it.
    pub reflectance: Vec3,
    /// Perceptual roughness of the mirror, 0..1.
    pub roughness: f32,
    /// The shape of the surroundings and the place where the environment was taken, world space; without, they are
    /// infinitely far away.
    pub proxy: Option<(EnvironmentProxy, DVec3)>,
}

/// A surface some of whose triangles mirror an environment, in addition to what they show.
pub struct ReflectingSurface<'a> {
    mesh: &'a Mesh,
    surface: &'a dyn Surface,
    reflection: ObjectReflection,
    is_mirror: &'a (dyn Fn(usize) -> bool + Sync),
}

impl<'a> ReflectingSurface<'a> {
    /// Adds a reflection to the triangles for which `is_mirror` is true.
    pub fn new(
        mesh: &'a Mesh,
        surface: &'a dyn Surface,
        reflection: ObjectReflection,
        is_mirror: &'a (dyn Fn(usize) -> bool + Sync),
    ) -> Self {
        Self { mesh, surface, reflection, is_mirror }
    }

    fn mirrored(&self, hit: &Hit, material: &MaterialSample) -> Vec3 {
        let reflection = &self.reflection;
        let view = MirrorView::new(material.normal, material.normal_steps, hit.to_eye);
        let (direction, steps) = match reflection.proxy {
            Some((proxy, center)) => {
                let corners = self.mesh.triangle_positions(hit.triangle);
                let scale = self.mesh.world_from_mesh.scale as f32;
                let along = |l: Vec3| (corners[0] * l.x + corners[1] * l.y + corners[2] * l.z) * scale;
                let position = self.mesh.world_from_mesh.point(hit.position(self.mesh)).as_vec3();
                let position_steps = [along(hit.dlambda_dx), along(hit.dlambda_dy)];
                proxy.corrected_footprint(
                    position,
                    position_steps,
                    view.direction,
                    view.steps,
                    center.as_vec3(),
                )
            }
            None => (view.direction, view.steps),
        };
        reflection.environment.reflected(direction, steps, reflection.roughness) * reflection.reflectance
    }
}

impl ReflectingSurface<'_> {
    fn with_reflection(&self, hit: &Hit, material: MaterialSample) -> MaterialSample {
        if !(self.is_mirror)(hit.triangle) {
            return material;
        }
        let mirrored = self.mirrored(hit, &material);
        MaterialSample { emission: material.emission + mirrored, lookups: material.lookups + 1, ..material }
    }
}

impl Surface for ReflectingSurface<'_> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        self.with_reflection(hit, self.surface.shade_inputs(hit))
    }

    fn shade(&self, hit: &Hit) -> (MaterialSample, Option<Finish<'_>>) {
        let (material, finish) = self.surface.shade(hit);
        (self.with_reflection(hit, material), finish)
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<(MaterialSample, Option<Finish<'s>>)>) {
        let first = out.len();
        self.surface.shade_all(hits, out);
        for (hit, (material, _)) in hits.iter().zip(&mut out[first..]) {
            *material = self.with_reflection(hit, *material);
        }
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        self.surface.alpha(hit)
    }

    fn casts_shadow(&self, triangle: usize) -> bool {
        self.surface.casts_shadow(triangle)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.surface.smooth_point(hit)
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.surface.coverage(triangle)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        self.surface.is_double_sided(triangle)
    }
}
