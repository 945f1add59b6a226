//! Tangents per corner, for normal maps in tangent space.
//!
//! Our own rather than the crate `bevy_mikktspace`: that one joins corners where triangles touch in a vertex alone, so up to one tangent
//! in a thousand differs, and everything that was baked or exported with ours would change. A test compares the two.

use std::cmp::Ordering;

use glam::{Vec2, Vec3, Vec4};

use crate::Mesh;

/// Tangents of a mesh, one per corner: the direction of growing u, and in `w` the side of the bitangent
/// `w * (normal x tangent)`, which points to the top of the image.
///
/// Follows the definition of M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008: facet tangents are
/// projected onto the plane of the corner's normal and averaged, weighted by angle, over the corners that share
/// position, normal, texture coordinates and handedness. Facets without area in the image have a say only where there
/// are no others.
///
/// `normals` has a unit normal per corner; `uv_of` gives the coordinates at a triangle's corners (origin top left), or
/// `None` for triangles that need no tangents, which get an arbitrary one.
pub fn corner_tangents(
    mesh: &Mesh,
    normals: &[Vec3],
    uv_of: impl Fn(usize) -> Option<[Vec2; 3]>,
) -> Vec<Vec4> {
    let mut corners = Vec::new();
    for t in 0..mesh.triangles.len() {
        if let Some(uv) = uv_of(t) {
            corners.extend(triangle_corners(mesh, normals, t, uv));
        }
    }
    // Stable, so that sums are formed in the order of the mesh.
    corners.sort_by(Corner::order);
    let mut tangents = vec![Vec4::X; 3 * mesh.triangles.len()];
    for shared in corners.chunk_by(|a, b| a.order(b) == Ordering::Equal) {
        let mean = |has_area: bool| {
            let those = shared.iter().filter(|c| c.has_area == has_area);
            those.map(|c| c.weighted_tangent).sum::<Vec3>().try_normalize()
        };
        let first = &shared[0];
        let tangent = mean(true).or_else(|| mean(false));
        let tangent = tangent.unwrap_or_else(|| first.normal.any_orthonormal_vector());
        for corner in shared {
            tangents[corner.index] = tangent.extend(first.handedness);
        }
    }
    tangents
}

struct Corner {
    index: usize,
    vertex: u32,
    uv: Vec2,
    normal: Vec3,
    handedness: f32,
    /// Whether the facet has an area in the image.
    has_area: bool,
    weighted_tangent: Vec3,
}

impl Corner {
    /// Equal for corners that share a tangent.
    fn order(&self, other: &Self) -> Ordering {
        // Both zeros are one number.
        let key =
            |c: &Self| [c.uv.x, c.uv.y, c.normal.x, c.normal.y, c.normal.z, c.handedness].map(|x| x + 0.0);
        let by_attributes = || {
            let pairs = key(self).into_iter().zip(key(other));
            pairs.map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
        };
        self.vertex.cmp(&other.vertex).then_with(by_attributes)
    }
}

fn triangle_corners(mesh: &Mesh, normals: &[Vec3], t: usize, uv: [Vec2; 3]) -> [Corner; 3] {
    let positions = mesh.triangle_positions(t);
    let Facet { tangent, handedness, has_area } = Facet::of(positions, uv);
    [0, 1, 2].map(|k| {
        let normal = normals[3 * t + k];
        let projected = (tangent - normal * normal.dot(tangent)).normalize_or_zero();
        Corner {
            index: 3 * t + k,
            vertex: mesh.triangles[t][k],
            uv: uv[k],
            normal,
            handedness,
            has_area,
            weighted_tangent: projected * corner_angle(positions, k, normal),
        }
    })
}

/// Angle in radians at a corner, as it appears in the plane of the corner's normal.
fn corner_angle(p: [Vec3; 3], k: usize, normal: Vec3) -> f32 {
    let [a, b] = [1, 2].map(|next| {
        let side = p[(k + next) % 3] - p[k];
        side - normal * normal.dot(side)
    });
    libm::atan2f(a.cross(b).length(), a.dot(b))
}

struct Facet {
    /// The direction in which u grows, or zero.
    tangent: Vec3,
    /// +1 where the image, whose v points downwards, is not mirrored.
    handedness: f32,
    /// Whether it has an area in the image. Where it has none but v changes, the tangent is the direction in which v does not.
    has_area: bool,
}

impl Facet {
    fn of([a, b, c]: [Vec3; 3], [ta, tb, tc]: [Vec2; 3]) -> Self {
        let (e1, e2) = (b - a, c - a);
        let (d1, d2) = (tb - ta, tc - ta);
        let doubled_area = d1.perp_dot(d2);
        let along_u = (e1 * d2.y - e2 * d1.y) * doubled_area.signum();
        Self {
            tangent: along_u.normalize_or_zero(),
            handedness: if doubled_area > 0.0 { -1.0 } else { 1.0 },
            has_area: doubled_area != 0.0,
        }
    }
}
