//! The cleaned mesh that all of fantex works on.

use fantex_base::Aabb;
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::{AlphaMode, ImageSource, Material};

/// The similarity that takes mesh space to world space: `p_world = offset + scale * p_mesh`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldFromMesh {
    /// Centre of the model's bounding box, rounded to an eighth of the scale; world units.
    pub offset: DVec3,
    /// World units per mesh unit, a power of two.
    pub scale: f64,
}

impl WorldFromMesh {
    /// Maps a mesh-space point to world space.
    pub fn point(&self, p_mesh: Vec3) -> DVec3 {
        self.offset + p_mesh.as_dvec3() * self.scale
    }

    /// Maps a world-space point to mesh space.
    pub fn inverse_point(&self, p_world: DVec3) -> Vec3 {
        ((p_world - self.offset) / self.scale).as_vec3()
    }
}

impl Default for WorldFromMesh {
    fn default() -> Self {
        Self { offset: DVec3::ZERO, scale: 1.0 }
    }
}

/// *Object space*, in which textures of space are evaluated: world units and axes, the origin in the middle of the mesh's
/// bounding box. So patterns keep their real size, moving a model does not move it within its pattern, and models far from the
/// world's origin keep their precision. A displaced mesh keeps the space of what was displaced, so that its patterns and its heights
/// stay together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectSpace {
    bounds_mesh: Aabb,
    /// World units per mesh unit.
    scale: f32,
}

impl ObjectSpace {
    /// That of a mesh. Looks at every vertex.
    pub fn of(mesh: &Mesh) -> Self {
        let bounds_mesh = mesh.undisplaced_bounds.unwrap_or_else(|| mesh.bounds());
        Self { bounds_mesh, scale: mesh.world_from_mesh.scale as f32 }
    }

    /// The origin, mesh space.
    pub fn origin_mesh(&self) -> Vec3 {
        0.5 * (self.bounds_mesh.min + self.bounds_mesh.max)
    }

    /// Takes a point from mesh space here.
    #[inline]
    pub fn point(&self, p_mesh: Vec3) -> Vec3 {
        (p_mesh - self.origin_mesh()) * self.scale
    }

    /// Takes a difference of points from mesh space here.
    #[inline]
    pub fn vector(&self, v_mesh: Vec3) -> Vec3 {
        v_mesh * self.scale
    }

    /// The bounding box in whose middle the origin is.
    pub fn bounds(&self) -> Aabb {
        self.aabb(self.bounds_mesh)
    }

    /// Takes a box from mesh space here.
    pub fn aabb(&self, of_mesh: Aabb) -> Aabb {
        Aabb { min: self.point(of_mesh.min), max: self.point(of_mesh.max) }
    }
}

/// A welded, cleaned triangle mesh in mesh space (all coordinates within [-1, 1]).
///
/// Guarantees, which `clean` establishes: indices in range, three distinct vertices and a positive area per triangle, finite positions,
/// no two vertices at the same position, no two triangles with the same vertices in the same cyclic order, every vertex used. Of a mesh
/// in a `.fan` file the store checks indices, distinct vertices and finite numbers when it reads it, and `fantex verify` all else. It need
/// not be manifold, closed, connected or orientable.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, mesh space.
    pub positions: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Attributes per corner.
    pub corners: CornerAttributes,
    /// Material of each triangle, index into `materials`; empty means material 0 everywhere.
    pub triangle_materials: Vec<u32>,
    /// Never empty after cleaning.
    pub materials: Vec<Material>,
    /// Encoded images that the materials refer to.
    pub images: Vec<ImageSource>,
    /// Where a model file names each image, for messages: `line 12 of chair.mtl`; an empty list where that is not known.
    pub image_places: Vec<String>,
    /// What the file calls its parts.
    pub parts: Parts,
    /// Where the mesh lies in the world.
    pub world_from_mesh: WorldFromMesh,
    /// Of a displaced mesh the bounding box, mesh space, of what was displaced. Assets do not keep it.
    pub undisplaced_bounds: Option<Aabb>,
}

impl Mesh {
    /// Lies in another mesh space from now on, at the same place in the world; positions are rounded to it.
    pub fn move_to(&mut self, world_from_mesh: WorldFromMesh) {
        let from = std::mem::replace(&mut self.world_from_mesh, world_from_mesh);
        if from != world_from_mesh {
            self.positions.iter_mut().for_each(|p| *p = world_from_mesh.inverse_point(from.point(*p)));
            self.undisplaced_bounds = None;
        }
    }

    /// Bytes of memory that vertices, triangles and what belongs to them take, without materials and images.
    pub fn byte_len(&self) -> u64 {
        let CornerAttributes { normals, uv_sets, colors, tangents } = &self.corners;
        let uv_sets: usize = uv_sets.iter().map(|set| size_of_val(&set[..])).sum();
        let corners =
            size_of_val(&normals[..]) + uv_sets + size_of_val(&colors[..]) + size_of_val(&tangents[..]);
        let numbers = size_of_val(&self.triangle_materials[..]) + size_of_val(&self.parts.of_triangle[..]);
        (size_of_val(&self.positions[..]) + size_of_val(&self.triangles[..]) + corners + numbers) as u64
    }

    /// The bounding box of all vertices, mesh space; of no vertices the origin.
    pub fn bounds(&self) -> Aabb {
        let Some(&first) = self.positions.first() else { return Aabb { min: Vec3::ZERO, max: Vec3::ZERO } };
        let join = |(min, max): (Vec3, Vec3), &p: &Vec3| (min.min(p), max.max(p));
        let (min, max) = self.positions.iter().fold((first, first), join);
        Aabb { min, max }
    }

    /// The three positions of a triangle.
    #[inline]
    pub fn triangle_positions(&self, triangle: usize) -> [Vec3; 3] {
        let [a, b, c] = self.triangles[triangle];
        let at = |vertex: u32| self.positions[vertex as usize];
        [at(a), at(b), at(c)]
    }

    /// The mesh of some of the triangles, in the order given, with the vertices that they use, in their order: in the same mesh space, with
    /// the same materials, images and names of parts. Also returns which vertex of this mesh each of its vertices is.
    #[must_use]
    pub fn subset(&self, triangles: &[u32]) -> (Self, Vec<u32>) {
        let of_whole = |&t: &u32| self.triangles[t as usize];
        let mut vertices: Vec<u32> = triangles.iter().flat_map(of_whole).collect();
        vertices.par_sort_unstable();
        vertices.dedup();
        let number = |vertex: u32| vertices.partition_point(|&other| other < vertex) as u32;
        let corners = &self.corners;
        let subset = Self {
            positions: vertices.iter().map(|&v| self.positions[v as usize]).collect(),
            triangles: triangles.iter().map(|t| of_whole(t).map(number)).collect(),
            corners: CornerAttributes {
                normals: corners_of(&corners.normals, triangles),
                uv_sets: corners.uv_sets.iter().map(|set| corners_of(set, triangles)).collect(),
                colors: corners_of(&corners.colors, triangles),
                tangents: corners_of(&corners.tangents, triangles),
            },
            triangle_materials: match self.triangle_materials.is_empty() {
                true => Vec::new(),
                false => triangles.iter().map(|&t| self.triangle_materials[t as usize]).collect(),
            },
            materials: self.materials.clone(),
            images: self.images.clone(),
            image_places: self.image_places.clone(),
            parts: self.parts.of_sources(triangles.iter().copied()),
            world_from_mesh: self.world_from_mesh,
            undisplaced_bounds: self.undisplaced_bounds,
        };
        (subset, vertices)
    }

    /// Unit normal of a triangle's front, from which its corners run counter-clockwise; zero for one without area, which no
    /// cleaned mesh has.
    pub fn facet_normal(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.triangle_positions(triangle).map(|p| p.as_dvec3());
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Index into `materials` for a triangle.
    #[inline]
    pub fn material_of(&self, triangle: usize) -> usize {
        self.triangle_materials.get(triangle).copied().unwrap_or(0) as usize
    }

    /// What alpha means on a triangle.
    pub fn alpha_mode(&self, triangle: usize) -> AlphaMode {
        self.materials.get(self.material_of(triangle)).map(|material| material.alpha).unwrap_or_default()
    }

    /// Lets all materials take alpha so; a mesh without any gets a plain one. False where they do already.
    pub fn set_alpha_mode(&mut self, alpha: AlphaMode) -> bool {
        if self.materials.is_empty() {
            self.materials.push(Material::default());
        }
        let is_changed = self.materials.iter().any(|material| material.alpha != alpha);
        self.materials.iter_mut().for_each(|material| material.alpha = alpha);
        is_changed
    }

    /// Surface area in square mesh units, summed in double precision.
    pub fn area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| self.triangle_area(t)).sum()
    }

    /// Area of a triangle, square mesh units.
    pub fn triangle_area(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.triangle_positions(triangle).map(|p| p.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    }
}

/// The values of some triangles' corners, of those of all; none where there are none.
pub fn corners_of<T: Copy>(values: &[T], triangles: &[u32]) -> Vec<T> {
    match values.is_empty() {
        true => Vec::new(),
        false => triangles.iter().flat_map(|&t| [0, 1, 2].map(|k| values[3 * t as usize + k])).collect(),
    }
}

/// Parts of a model by name: nodes of glTF, objects of OBJ (groups where it has no objects).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// Names as written, maybe empty or the same; none where the file tells no parts apart.
    pub names: Vec<String>,
    /// Part of each triangle, index into `names`; empty means part 0 everywhere.
    pub of_triangle: Vec<u32>,
}

impl Parts {
    /// Index into `names` for a triangle; 0 where there are no names.
    #[inline]
    pub fn of(&self, triangle: usize) -> usize {
        self.of_triangle.get(triangle).copied().unwrap_or(0) as usize
    }

    /// Those of triangles that were made from triangles `sources` of this model.
    #[must_use]
    pub(crate) fn of_sources(&self, sources: impl Iterator<Item = u32>) -> Self {
        let of_triangle = match self.of_triangle.is_empty() {
            true => Vec::new(),
            false => sources.map(|source| self.of_triangle[source as usize]).collect(),
        };
        Self { names: self.names.clone(), of_triangle }
    }

    /// Leaves out what says nothing: the list of a single part, the name of one that has none.
    pub(crate) fn simplify(&mut self) {
        if self.names.len() <= 1 {
            self.of_triangle.clear();
            self.names.retain(|name| !name.is_empty());
        }
    }
}

// A model as its file says, before cleaning.

/// Attributes per corner. Corner `3 * t + k` is corner `k` of triangle `t`. Every non-empty array has three entries
/// per triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CornerAttributes {
    /// Unit normals, or empty where the file has none.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one array per set (origin top left, v downwards); empty where the file has none.
    pub uv_sets: Vec<Vec<Vec2>>,
    /// Linear RGBA, or empty where the file has none.
    pub colors: Vec<Vec4>,
    /// Unit tangents with handedness in w (glTF), or empty where the file has none.
    pub tangents: Vec<Vec4>,
}

/// A triangle soup with attributes, as loaded: world space, nothing welded, nothing dropped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The file's name without folder, for messages.
    pub name: String,
    /// World-space positions (node transforms applied). May hold NaN; cleaning deals with it.
    pub positions: Vec<DVec3>,
    /// Indices into `positions`; loaders guarantee that they are in range.
    pub triangles: Vec<[u32; 3]>,
    /// Attributes per corner.
    pub corners: CornerAttributes,
    /// Material of each triangle, index into `materials`; empty means material 0 everywhere.
    pub triangle_materials: Vec<u32>,
    /// Never empty.
    pub materials: Vec<Material>,
    /// Encoded images that the materials refer to.
    pub images: Vec<ImageSource>,
    /// Where a model file names each image, for messages: `line 12 of chair.mtl`; an empty list where that is not known.
    pub image_places: Vec<String>,
    /// What the file calls its parts.
    pub parts: Parts,
    /// What the loader noticed: skipped points and lines, unsupported optional extensions, ...
    pub notes: Vec<String>,
}
