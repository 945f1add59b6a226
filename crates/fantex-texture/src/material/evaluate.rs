//! From texels, factors and vertex colours to the values of a material (glTF 2.0, section 3.9).
//!
//! A channel without texture has the texel [`Vec4::ONE`].

use fantex_mesh::{Material, Mesh, corner_tangents};
use glam::{Mat3, Vec3, Vec4};

use super::MaterialTextures;

/// Linear RGBA; the alpha is what the textures say, whatever the material makes of it. Negative where a filter overshoots.
pub fn base_color(material: &Material, vertex_color: Vec4, texel: Vec4) -> Vec4 {
    material.base_color * vertex_color * texel
}

/// Occlusion (the share of the surroundings' light that arrives), perceptual roughness and metallic, each 0..1.
pub fn occlusion_roughness_metallic(
    material: &Material,
    occlusion_texel: Vec4,
    metallic_roughness_texel: Vec4,
) -> Vec3 {
    let occlusion = 1.0 + material.occlusion_strength * (occlusion_texel.x - 1.0);
    let roughness = material.roughness * metallic_roughness_texel.y;
    let metallic = material.metallic * metallic_roughness_texel.z;
    Vec3::new(occlusion, roughness, metallic).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Linear RGB, may exceed 1. Negative where a filter overshoots.
pub fn emission(material: &Material, texel: Vec4) -> Vec3 {
    material.emission * texel.truncate()
}

/// The interpolated vertex colour, linear RGBA; white where the mesh has none. `lambda` lies inside the triangle.
pub fn vertex_color(mesh: &Mesh, triangle: usize, lambda: Vec3) -> Vec4 {
    match mesh.corners.colors.get(3 * triangle..3 * triangle + 3) {
        Some(c) => c[0] * lambda.x + c[1] * lambda.y + c[2] * lambda.z,
        None => Vec4::ONE,
    }
}

/// The tangents that normal maps are relative to, one per corner (see [`corner_tangents`]): the mesh's own, or those of the
/// normal maps' coordinates. Empty where no material has a normal map.
///
/// `normals` has a unit normal per corner, `textures` an entry per material.
pub fn normal_map_tangents(mesh: &Mesh, normals: &[Vec3], textures: &[MaterialTextures]) -> Vec<Vec4> {
    if textures.iter().all(|m| m.normal.is_none()) {
        return Vec::new();
    }
    if mesh.corners.tangents.len() == 3 * mesh.triangles.len() {
        return mesh.corners.tangents.clone();
    }
    corner_tangents(mesh, normals, |t| {
        Some(textures.get(mesh.material_of(t))?.normal.as_ref()?.corner_uv(mesh, t))
    })
}

/// The axes of tangent space at a point, mesh space: interpolated and used without normalisation, as in M. Mikkelsen,
/// "Simulation of Wrinkled Surfaces Revisited", 2008.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentFrame {
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
}

impl TangentFrame {
    /// At the point `lambda`, which lies inside `triangle`; `normals` and `tangents` have an entry per corner of the mesh.
    pub fn at(normals: &[Vec3], tangents: &[Vec4], triangle: usize, lambda: Vec3) -> Self {
        let corner = 3 * triangle;
        let blend = |v: [Vec3; 3]| v[0] * lambda.x + v[1] * lambda.y + v[2] * lambda.z;
        let normal = blend([0, 1, 2].map(|k| normals[corner + k]));
        let tangent = blend([0, 1, 2].map(|k| tangents[corner + k].truncate()));
        Self { tangent, bitangent: normal.cross(tangent) * tangents[corner].w, normal }
    }

    /// The coordinates of a unit normal relative to the axes, at unit length: `0.5 + 0.5 *` them is the texel that [`bend`]
    /// takes back to it. `None` where the axes lie in a plane.
    ///
    /// [`bend`]: Self::bend
    pub fn relative(&self, normal: Vec3) -> Option<Vec3> {
        let axes = Mat3::from_cols(self.tangent, self.bitangent, self.normal);
        if axes.determinant().abs() < 1e-6 {
            return None;
        }
        (axes.inverse() * normal).try_normalize()
    }

    /// A vector of tangent space (along tangent, bitangent and normal) in mesh space, not normalised.
    pub fn mesh_vector(&self, v_tangent: Vec3) -> Vec3 {
        self.tangent * v_tangent.x + self.bitangent * v_tangent.y + self.normal * v_tangent.z
    }

    /// The unit normal that a normal map's texel (0..1) stands for; `None` where it is no direction.
    pub fn bend(&self, material: &Material, texel: Vec4) -> Option<Vec3> {
        let scale = material.normal_scale;
        let bent = (texel.truncate() * 2.0 - 1.0) * Vec3::new(scale, scale, 1.0);
        self.mesh_vector(bent).try_normalize()
    }
}
