//! Several objects in one picture.
//!
//! ```text
//!  mesh, surface, placement  --.
//!  mesh, surface, placement  --+--> Scene: one mesh for visibility and shadows, a surface that asks the objects' own
//!  mesh, surface, placement  --'
//! ```

use fantex_base::{Aabb, Error, Result};
use fantex_mesh::{Material, Mesh, SurfacePoint, WorldFromMesh};
use fantex_scene::world_bounds;
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

use crate::{AnisotropySample, Coverage, Finish, Hit, MaterialSample, Shaded, SmoothPoint, Surface};

/// One object of a scene.
#[derive(Clone, Copy)]
pub struct SceneObject<'a> {
    /// Its shape.
    pub mesh: &'a Mesh,
    /// Its appearance.
    pub surface: &'a dyn Surface,
    /// Where it stands: any invertible affine map from the world of its own file to the world of the scene. Mirroring keeps
    /// the outside out.
    pub world_from_object: DAffine3,
    /// Whether it casts shadows. A floor need not; see [`Surface::casts_shadow`].
    pub casts_shadow: bool,
}

impl<'a> SceneObject<'a> {
    /// An object where its file has it.
    pub fn new(mesh: &'a Mesh, surface: &'a dyn Surface) -> Self {
        Self { mesh, surface, world_from_object: DAffine3::IDENTITY, casts_shadow: true }
    }

    /// The same object elsewhere; see the field.
    pub fn placed(self, world_from_object: DAffine3) -> Self {
        Self { world_from_object, ..self }
    }

    /// The same object without a shadow; see the field.
    pub fn without_shadow(self) -> Self {
        Self { casts_shadow: false, ..self }
    }
}

impl std::fmt::Debug for SceneObject<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let triangles = self.mesh.triangles.len();
        f.debug_struct("SceneObject").field("triangles", &triangles).finish_non_exhaustive()
    }
}

/// Several objects as one mesh and one surface, for [`render`](crate::render).
///
/// The mesh has the objects' triangles one after the other, in a mesh space that is centred on the scene. A surface that is
/// asked sees its own mesh; directions and normals are carried over both ways, under scales that are not uniform, too.
#[derive(Debug)]
pub struct Scene<'a> {
    mesh: Mesh,
    parts: Vec<Part<'a>>,
}

#[derive(Debug)]
struct Part<'a> {
    object: SceneObject<'a>,
    /// Triangle of the merged mesh that is its first.
    first_triangle: usize,
    /// Takes directions of the object's mesh space to the scene's.
    scene_from_object: Mat3,
    object_from_scene: Mat3,
    /// Takes normals of the object to the scene's: the inverse transpose, with any length.
    scene_normal_from_object: Mat3,
    mirrored: bool,
}

impl<'a> Scene<'a> {
    /// Puts objects together.
    ///
    /// # Errors
    /// A placement flattens its object, or there are more vertices than a mesh can number.
    pub fn new(objects: Vec<SceneObject<'a>>) -> Result<Self> {
        check(&objects)?;
        let world_from_mesh = frame_around(&objects);
        let mut mesh = Mesh { world_from_mesh, materials: vec![Material::default()], ..Mesh::default() };
        let mut parts = Vec::with_capacity(objects.len());
        for object in objects {
            let part = Part::new(object, mesh.triangles.len(), world_from_mesh.scale);
            part.append_to(&mut mesh);
            parts.push(part);
        }
        Ok(Self { mesh, parts })
    }

    /// All triangles, without attributes.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The scene's bounding box, world space.
    pub fn bounds(&self) -> Aabb<DVec3> {
        world_bounds(&self.mesh)
    }

    /// Which object a triangle of the mesh belongs to, and which of the object's triangles it is.
    ///
    /// # Panics
    /// If the mesh has no such triangle.
    pub fn object_of(&self, triangle: usize) -> (usize, usize) {
        let part = self.parts.partition_point(|part| part.first_triangle <= triangle) - 1;
        (part, triangle - self.parts[part].first_triangle)
    }

    fn locate(&self, triangle: usize) -> (&Part<'a>, usize) {
        let (part, own) = self.object_of(triangle);
        (&self.parts[part], own)
    }
}

fn check(objects: &[SceneObject]) -> Result<()> {
    let (mut vertices, mut triangles) = (0, 0);
    for (index, object) in objects.iter().enumerate() {
        let map = object.world_from_object;
        let scale = map.matrix3.x_axis.length() * map.matrix3.y_axis.length() * map.matrix3.z_axis.length();
        let determinant = map.matrix3.determinant().abs();
        if !(map.is_finite() && determinant > 1e-12 * scale && scale > 0.0) {
            return Err(Error::invalid(format!(
                "object {index} cannot be placed: its placement is not finite or flattens it; scale by more than zero"
            )));
        }
        vertices += object.mesh.positions.len() as u64;
        triangles += object.mesh.triangles.len() as u64;
    }
    let count = vertices.max(triangles);
    if count > u64::from(u32::MAX) {
        return Err(Error::too_large(format!(
            "the scene's objects have too many vertices or triangles together: {count}, at most {} are possible",
            u32::MAX
        )));
    }
    Ok(())
}

/// A mesh space around all objects: centred, scaled by a power of two.
fn frame_around(objects: &[SceneObject]) -> WorldFromMesh {
    let bounds = Aabb::of_points(objects.iter().flat_map(world_positions));
    let reach = (bounds.size() * 0.5).max_element();
    if !reach.is_finite() {
        return WorldFromMesh::default();
    }
    let scale = if reach > 0.0 { reach.log2().ceil().exp2() } else { 1.0 };
    WorldFromMesh { offset: bounds.center(), scale }
}

fn world_positions(object: &SceneObject) -> impl Iterator<Item = DVec3> {
    let (mesh, map) = (object.mesh, object.world_from_object);
    mesh.positions.iter().map(move |&p| map.transform_point3(mesh.world_from_mesh.point(p)))
}

impl<'a> Part<'a> {
    fn new(object: SceneObject<'a>, first_triangle: usize, scene_scale: f64) -> Self {
        let linear = object.world_from_object.matrix3 * (object.mesh.world_from_mesh.scale / scene_scale);
        let inverse: DMat3 = linear.inverse();
        let mirrored = linear.determinant() < 0.0;
        Self {
            object,
            first_triangle,
            scene_from_object: linear.as_mat3(),
            object_from_scene: inverse.as_mat3(),
            scene_normal_from_object: inverse.transpose().as_mat3(),
            mirrored,
        }
    }

    fn append_to(&self, mesh: &mut Mesh) {
        let (own, map) = (self.object.mesh, self.object.world_from_object);
        let first_vertex = mesh.positions.len() as u32;
        let frame = mesh.world_from_mesh;
        mesh.positions.par_extend(
            own.positions
                .par_iter()
                .map(|&p| frame.inverse_point(map.transform_point3(own.world_from_mesh.point(p)))),
        );
        mesh.triangles.par_extend(own.triangles.par_iter().map(|t| {
            let [a, b, c] = t.map(|v| v + first_vertex);
            if self.mirrored { [a, c, b] } else { [a, b, c] }
        }));
    }

    /// The hit as the object's own surface knows it.
    fn own_hit(&self, triangle: usize, hit: &Hit) -> Hit {
        let own = |l: Vec3| if self.mirrored { Vec3::new(l.x, l.z, l.y) } else { l };
        Hit {
            at: SurfacePoint { triangle: triangle as u32, lambda: own(hit.at.lambda) },
            lambda_steps: hit.lambda_steps.map(own),
            front: hit.front,
            to_eye: (self.object_from_scene * hit.to_eye).normalize_or(hit.to_eye),
        }
    }

    /// The scene's unit normal of an object's.
    fn normal(&self, own: Vec3) -> Vec3 {
        (self.scene_normal_from_object * own).normalize_or(own)
    }

    /// What the object's own surface says, as the scene knows it.
    fn shaded<'s>(&self, (material, finish): Shaded<'s>) -> Shaded<'s> {
        let turned = |a: AnisotropySample| AnisotropySample {
            direction: (self.scene_from_object * a.direction).normalize_or(a.direction),
            ..a
        };
        let finish = finish.map(|f| Finish { anisotropy: f.anisotropy.map(turned), ..f });
        (self.material(material), finish)
    }

    fn material(&self, own: MaterialSample) -> MaterialSample {
        let normal = self.normal(own.normal);
        // The derivative of a normalised vector.
        let length = (self.scene_normal_from_object * own.normal).length().max(f32::MIN_POSITIVE);
        let normal_steps = own.normal_steps.map(|step| {
            let change = self.scene_normal_from_object * step / length;
            change - normal * normal.dot(change)
        });
        MaterialSample { normal, normal_steps, ..own }
    }
}

impl Surface for Scene<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let (part, own) = self.locate(hit.triangle());
        part.shaded(part.object.surface.shade(&part.own_hit(own, hit)))
    }

    fn shade_all<'s>(&'s self, hits: &[Hit], out: &mut Vec<Shaded<'s>>) {
        let (mut own_hits, mut shaded) = (Vec::with_capacity(hits.len()), Vec::with_capacity(hits.len()));
        let of_one_object =
            |a: &Hit, b: &Hit| self.object_of(a.triangle()).0 == self.object_of(b.triangle()).0;
        for run in hits.chunk_by(of_one_object) {
            let (part, _) = self.locate(run[0].triangle());
            own_hits.clear();
            own_hits.extend(run.iter().map(|hit| part.own_hit(hit.triangle() - part.first_triangle, hit)));
            part.object.surface.shade_all(&own_hits, &mut shaded);
            out.extend(shaded.drain(..).map(|own| part.shaded(own)));
        }
    }

    fn alpha(&self, hit: &Hit) -> f32 {
        let (part, own) = self.locate(hit.triangle());
        part.object.surface.alpha(&part.own_hit(own, hit))
    }

    fn casts_shadow(&self, triangle: usize) -> bool {
        let (part, own) = self.locate(triangle);
        part.object.casts_shadow && part.object.surface.casts_shadow(own)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        let (part, own) = self.locate(hit.triangle());
        let smooth = part.object.surface.smooth_point(&part.own_hit(own, hit))?;
        let offset = part.scene_from_object * smooth.offset;
        Some(SmoothPoint { offset, normal: part.normal(smooth.normal) })
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        let (part, own) = self.locate(triangle);
        part.object.surface.coverage(own)
    }

    fn is_double_sided(&self, triangle: usize) -> bool {
        let (part, own) = self.locate(triangle);
        part.object.surface.is_double_sided(own)
    }
}
