//! A model as its file says, before cleaning.

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::{ImageSource, Material};

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
    /// What the loader noticed: skipped points and lines, unsupported optional extensions, ...
    pub notes: Vec<String>,
}
