//! Displacement: `P' = P + h n`, as real geometry.
//!
//! The mesh is cut finer where that is needed ([`Refinement`]) and every vertex is moved along a normal that all triangles
//! around it share, by a height that they share, too: the mean of what the height function says at each of their corners. So
//! a surface without cracks stays without cracks, whatever the function does at texture seams and creases. The idea of
//! displacing a finely cut surface is that of R. Cook, "Shade Trees", 1984.

mod options;
mod tessellation;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

pub use self::options::{DisplaceError, DisplaceOptions, Refinement};

use self::tessellation::{Corner, Piece, Tessellation, Vertex, height_at};
use crate::{
    CleanOptions, CleanReport, CornerAttributes, Mesh, Model, VertexCorners, angle_between, clean,
    corner_normals, shading_normals,
};

/// A point whose height is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplacePoint {
    /// Triangle of the mesh before it was cut. At vertices and on edges every triangle that lies there is asked.
    pub triangle: usize,
    /// Barycentric coordinates on it, 0..1.
    pub lambda: Vec3,
    /// Before the displacement, mesh space.
    pub position: Vec3,
    /// Unit normal along which it will be displaced.
    pub normal: Vec3,
}

/// What was done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DisplaceReport {
    /// How often edges were cut.
    pub rounds: u32,
    /// What had to be cleaned (triangles that collapsed, vertices that met), and the topology of the result.
    pub clean: CleanReport,
}

/// Cuts a mesh finer and moves its vertices along their normals by `height`, mesh units.
///
/// Attributes are interpolated over each original triangle; normals are computed anew and tangents dropped. Time and memory
/// are linear in the result's triangles, except that each round of cutting looks at all of them. The result does not depend
/// on the number of threads.
///
/// # Errors
///
/// An option out of range, more triangles than allowed, a height that is no number, or nothing left.
pub fn displace(
    mesh: &Mesh,
    options: &DisplaceOptions,
    height: impl Fn(&DisplacePoint) -> f32 + Sync,
) -> Result<(Mesh, DisplaceReport), DisplaceError> {
    options.check()?;
    let vertices = displaced_vertices(mesh, &height)?;
    let mut tessellation = Tessellation { vertices, pieces: whole_triangles(mesh), height: &height };
    let mut rounds = 0;
    while tessellation.refine(&options.refinement, options.max_triangles)? > 0 {
        rounds += 1;
    }
    let model = model_of(mesh, tessellation.vertices, tessellation.pieces);
    let (mut displaced, clean) = clean(model, &CleanOptions::default())?;
    displaced.corners.normals = corner_normals(&displaced, options.crease_degrees);
    Ok((displaced, DisplaceReport { rounds, clean }))
}

/// The mesh's own vertices: their normal is the mean of the shading normals at their corners, weighted by angle.
fn displaced_vertices(
    mesh: &Mesh,
    height: &(impl Fn(&DisplacePoint) -> f32 + Sync),
) -> Result<Vec<Vertex>, DisplaceError> {
    let normals = shading_normals(mesh);
    let corners = VertexCorners::of(&mesh.triangles, mesh.positions.len());
    let of_vertex = |v: usize| {
        let row = corners.at(v);
        let weighted = |&corner: &u32| {
            let positions = mesh.triangle_positions(corner as usize / 3).map(|p| p.as_dvec3());
            let at = |k: u32| positions[((corner + k) % 3) as usize];
            normals[corner as usize].as_dvec3() * angle_between(at(1) - at(0), at(2) - at(0))
        };
        let sum: DVec3 = row.iter().map(weighted).sum();
        let first = || row.first().map_or(Vec3::Z, |&corner| normals[corner as usize]);
        let normal = sum.try_normalize().map_or_else(first, |n| n.as_vec3());
        let position = mesh.positions[v];
        let mut heights = 0.0;
        for &corner in row {
            let lambda = Vec3::AXES[corner as usize % 3];
            heights += height_at(height, corner / 3, lambda, position, normal)?;
        }
        Ok(Vertex { position, normal, height: (heights / row.len().max(1) as f64) as f32 })
    };
    (0..corners.len()).into_par_iter().with_min_len(1 << 10).map(of_vertex).collect()
}

fn whole_triangles(mesh: &Mesh) -> Vec<Piece> {
    let piece = |(triangle, vertices): (u32, &[u32; 3])| Piece {
        triangle,
        corners: [0, 1, 2].map(|k| Corner { vertex: vertices[k], lambda: Vec3::AXES[k] }),
    };
    (0..).zip(&mesh.triangles).map(piece).collect()
}

/// The pieces with the attributes of the triangles that they were cut from, in world space.
fn model_of(mesh: &Mesh, vertices: Vec<Vertex>, pieces: Vec<Piece>) -> Model {
    let of = &mesh.corners;
    let corners = CornerAttributes {
        normals: Vec::new(),
        uv_sets: of.uv_sets.iter().map(|set| interpolated(set, &pieces)).collect(),
        colors: interpolated(&of.colors, &pieces),
        tangents: Vec::new(),
    };
    let material = |piece: &Piece| mesh.triangle_materials[piece.triangle as usize];
    let triangle_materials = match mesh.triangle_materials.is_empty() {
        true => Vec::new(),
        false => pieces.iter().map(material).collect(),
    };
    Model {
        name: "the displaced mesh".to_owned(),
        positions: vertices.iter().map(|v| mesh.world_from_mesh.point(v.displaced())).collect(),
        triangles: pieces.iter().map(|piece| piece.corners.map(|c| c.vertex)).collect(),
        corners,
        triangle_materials,
        materials: mesh.materials.clone(),
        images: mesh.images.clone(),
        notes: Vec::new(),
    }
}

/// Values at the pieces' corners; empty where there are none.
fn interpolated<T>(values: &[T], pieces: &[Piece]) -> Vec<T>
where
    T: Copy + Send + Sync + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>,
{
    if values.is_empty() {
        return Vec::new();
    }
    let of_piece = |piece: &Piece| {
        let first = 3 * piece.triangle as usize;
        let [a, b, c] = [0, 1, 2].map(|k| values[first + k]);
        piece.corners.map(|corner| a * corner.lambda.x + b * corner.lambda.y + c * corner.lambda.z)
    };
    pieces.par_iter().with_min_len(1 << 12).flat_map_iter(of_piece).collect()
}
