//! The parts of triangles that a group is looked up on.
//!
//! ```text
//!        corner            The weight of corner i is positive where lambda_i > max(lambda_j, lambda_k) - delta: a kite.
//!         /\               Its far corner lies a little beyond the triangle's centre, the side ones beyond the middles
//!        /  \              of the edges.
//!   side <  > side
//!      / `./' \
//!     /   far  \
//!    '----------'
//! ```

use fantex_cover::Cover;
use fantex_mesh::Mesh;
use glam::{Vec2, Vec3};

/// Where a kite's corners lie: barycentric coordinates, from the corner's own around.
fn kite(slot: usize, delta: f32) -> [Vec3; 4] {
    let (near, far) = (0.5 * (1.0 - delta), 0.5 * (1.0 + delta));
    let inner = (1.0 - 2.0 * delta) / 3.0;
    let turned = |[own, next, previous]: [f32; 3]| {
        let mut lambda = [0.0; 3];
        lambda[slot] = own;
        lambda[(slot + 1) % 3] = next;
        lambda[(slot + 2) % 3] = previous;
        Vec3::from_array(lambda)
    };
    let rest = 0.5 * (1.0 - inner);
    [[1.0, 0.0, 0.0], [near, far, 0.0], [inner, rest, rest], [near, 0.0, far]].map(turned)
}

/// One kite, in space and in its tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kite {
    /// Corners, mesh space.
    pub(crate) points: [Vec3; 4],
    /// The same in tile coordinates.
    pub(crate) uv: [Vec2; 4],
}

/// What a group sees of one triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    pub(crate) group: u32,
    /// Unit normal.
    pub(crate) normal: Vec3,
    /// One per corner of the triangle that belongs to the group.
    pub(crate) kites: [Option<Kite>; 3],
}

/// Texels of level 0 per mesh unit along the directions on a triangle that have fewest and most of them: the singular values
/// of the map from its plane to texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Densities {
    pub(crate) least: f32,
    pub(crate) most: f32,
}

/// Those of a triangle in one of its corners' groups.
pub(crate) fn densities(mesh: &Mesh, cover: &Cover, triangle: usize, group: u32) -> Densities {
    let extent = Vec2::from(cover.groups[group as usize].extent.map(|n| n as f32));
    // One projection serves all corners of a projected group; an unfolded fan has one corner in a triangle.
    let slot = cover.corner_groups[triangle].iter().position(|&g| g == group).unwrap_or(0);
    map_densities(mesh.triangle_positions(triangle), cover.tile_corners(mesh, triangle, slot), extent)
}

/// Points whose hull is what the group of the given corners sees of a triangle, and how many.
pub(crate) fn piece_points(corners: [Vec3; 3], is_in: [bool; 3], delta: f32) -> ([Vec3; 12], usize) {
    let (mut points, mut count) = ([Vec3::ZERO; 12], 0);
    if is_in == [true; 3] {
        points[..3].copy_from_slice(&corners);
        return (points, 3);
    }
    let [a, b, c] = corners;
    for slot in (0..3).filter(|&slot| is_in[slot]) {
        for lambda in kite(slot, delta) {
            points[count] = a * lambda.x + b * lambda.y + c * lambda.z;
            count += 1;
        }
    }
    (points, count)
}

/// The facets of a triangle, one per group it is looked up in.
pub(crate) fn facets(mesh: &Mesh, cover: &Cover, triangle: usize) -> impl Iterator<Item = Facet> {
    let positions = mesh.triangle_positions(triangle);
    let groups = cover.corner_groups[triangle];
    let [a, b, c] = positions;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let first_slot = move |slot: usize| groups.iter().position(|&g| g == groups[slot]) == Some(slot);
    (0..3).filter(move |&slot| first_slot(slot)).map(move |slot| {
        let mut facet = Facet { group: groups[slot], normal, kites: [None; 3] };
        for other in (slot..3).filter(|&s| groups[s] == groups[slot]) {
            let uv = cover.tile_corners(mesh, triangle, other);
            let at = |lambda: Vec3| {
                let [x, y, z] = lambda.to_array();
                (a * x + b * y + c * z, uv[0] * x + uv[1] * y + uv[2] * z)
            };
            let corners = kite(other, cover.delta).map(at);
            facet.kites[other] = Some(Kite { points: corners.map(|c| c.0), uv: corners.map(|c| c.1) });
        }
        facet
    })
}

fn map_densities([a, b, c]: [Vec3; 3], uv: [Vec2; 3], extent: Vec2) -> Densities {
    let x_axis = (b - a).normalize_or_zero();
    let (bx, cx) = ((b - a).dot(x_axis), (c - a).dot(x_axis));
    let cy = ((c - a) - x_axis * cx).length();
    let (to_b, to_c) = ((uv[1] - uv[0]) * extent, (uv[2] - uv[0]) * extent);
    let along_x = to_b / bx;
    let along_y = (to_c - along_x * cx) / cy;
    let (sum, area) = (along_x.length_squared() + along_y.length_squared(), along_x.perp_dot(along_y).abs());
    let most = (0.5 * (sum + (sum * sum - 4.0 * area * area).max(0.0).sqrt())).sqrt();
    // Where the map folds a line onto a point every level is too coarse; nothing finer than this would be seen.
    Densities { least: (area / most).max(1e-3 * most), most }
}
