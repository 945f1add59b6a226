//! Adjacency, surface points, normals and tangents on a few triangles.

use fantex_mesh::generate::{book, cube, icosphere};
use fantex_mesh::*;
use fantex_test::cleaned;
use glam::{DVec3, Vec2, Vec3, Vec4};

#[test]
fn angles_are_those_of_the_library() {
    for step in 0..1000 {
        // Half of it is at most half a turn.
        let angle = step as f32 * 0.006;
        assert!(unit_vector(angle).distance(Vec2::from_angle(angle)) < 2e-7);
        let [a, b] = [0.0, f64::from(angle) / 2.0].map(|t| DVec3::new(t.cos(), t.sin(), 0.0) * (1.0 + t));
        assert!((angle_between(a, b) - f64::from(angle) / 2.0).abs() < 1e-7);
    }
}

fn mesh() -> Mesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() }
}

#[test]
fn corners_and_centroid_are_where_they_should_be() {
    let mesh = mesh();
    for (corner, &position) in mesh.positions.iter().enumerate() {
        assert_eq!(SurfacePoint::corner(0, corner).position(&mesh), position);
    }
    let centroid = SurfacePoint::centroid(0);
    assert!(centroid.position(&mesh).distance(Vec3::new(1.0, 1.0, 0.0) / 3.0) < 1e-7);
    assert_eq!(centroid.facet_normal(&mesh), Vec3::Z);
    assert_eq!(interpolate([1.0, 2.0, 4.0], DVec3::new(0.5, 0.25, 0.25)), 2.0);
}

#[test]
fn points_beside_a_triangle_are_moved_onto_it() {
    let beside = SurfacePoint { triangle: 0, lambda: Vec3::new(0.75, 0.75, -0.5) };
    assert_eq!(beside.clamped().lambda, Vec3::new(0.5, 0.5, 0.0));
    let inside = SurfacePoint::corner(0, 1);
    assert_eq!(inside.clamped(), inside);
    let mesh = mesh();
    assert_eq!(beside.on_triangle(&mesh).lambda, Vec3::new(0.25, 0.75, 0.0));
    assert_eq!(inside.on_triangle(&mesh), inside);
}

/// Clamped coordinates of a point beside a sliver are those of a far one.
#[test]
fn points_beside_a_sliver_are_moved_to_its_nearest_point() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-3, 0.0)];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    // 0.05 above the middle of its upper right side: x = b + c / 2, y = c / 1000.
    let c = 50.5;
    let b = 0.75 - 0.5 * c;
    let beside = SurfacePoint { triangle: 0, lambda: Vec3::new(1.0 - b - c, b, c) };
    let moved = beside.on_triangle(&mesh).position(&mesh);
    assert!(moved.distance(Vec3::new(0.75, 5e-4, 0.0)) < 1e-3, "{moved}");
    assert!(beside.clamped().position(&mesh).x < 0.6);
}

/// A unit square in the xy plane, seen from +z, and its texture coordinates.
fn square(uv: [[f32; 2]; 4]) -> (Mesh, Vec<[Vec2; 3]>) {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    let uv = triangles.iter().map(|t: &[u32; 3]| t.map(|v| Vec2::from(uv[v as usize]))).collect();
    (Mesh { positions, triangles, ..Mesh::default() }, uv)
}

fn tangents_of((mesh, uv): &(Mesh, Vec<[Vec2; 3]>)) -> Vec<Vec4> {
    corner_tangents(mesh, &[Vec3::Z; 6], |t| Some(uv[t]))
}

#[test]
fn an_upright_image_has_its_bitangent_upwards() {
    let upright = square([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    for t in tangents_of(&upright) {
        assert!((t.truncate() - Vec3::X).length() < 1e-6);
        assert!((Vec3::Z.cross(t.truncate()) * t.w - Vec3::Y).length() < 1e-6);
    }
}

#[test]
fn a_mirrored_image_keeps_its_bitangent_and_turns_its_tangent() {
    let mirrored = square([[1.0, 1.0], [0.0, 1.0], [0.0, 0.0], [1.0, 0.0]]);
    for t in tangents_of(&mirrored) {
        assert!((t.truncate() - Vec3::NEG_X).length() < 1e-6);
        assert!((Vec3::Z.cross(t.truncate()) * t.w - Vec3::Y).length() < 1e-6);
    }
}

/// Files spell a normal `0 0 1` and `-0 0 1`; MikkTSpace compares numbers, too.
#[test]
fn both_zeros_of_normals_and_coordinates_share_a_tangent() {
    // The two triangles stretch the image in different directions.
    let (mesh, uv) = square([[0.0, 0.0], [1.0, 0.2], [0.7, 0.6], [0.1, 0.8]]);
    let tangents = |normals: &[Vec3; 6], uv: &[[Vec2; 3]]| corner_tangents(&mesh, normals, |t| Some(uv[t]));
    let plain = tangents(&[Vec3::Z; 6], &uv);
    assert_eq!((plain[0], plain[2]), (plain[3], plain[4]), "the corners that the triangles share");
    assert_ne!(plain[1], plain[0]);
    let mut normals = [Vec3::Z; 6];
    (normals[0].x, normals[4].y) = (-0.0, -0.0);
    assert_eq!(tangents(&normals, &uv), plain);
    let mut signed = uv.clone();
    signed[1][0] = Vec2::splat(-0.0);
    assert_eq!(tangents(&[Vec3::Z; 6], &signed), plain);
}

#[test]
fn degenerate_coordinates_give_some_tangent() {
    for t in tangents_of(&square([[0.5, 0.5]; 4])) {
        assert!((t.truncate().length() - 1.0).abs() < 1e-6 && t.z.abs() < 1e-6);
    }
}

#[test]
fn a_sphere_is_smooth_and_its_normals_point_away_from_the_centre() {
    let mesh = cleaned(icosphere(3));
    let normals = corner_normals(&mesh, 60.0);
    for (corner, normal) in normals.iter().enumerate() {
        let p = mesh.positions[mesh.triangles[corner / 3][corner % 3] as usize];
        assert!(normal.dot(p.normalize()) > 0.999, "corner {corner}");
    }
}

#[test]
fn own_normals_go_first_and_unusable_ones_are_replaced_by_the_facets() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let mut mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    mesh.corners.normals = vec![Vec3::ZERO, Vec3::NAN, Vec3::X];
    assert_eq!(shading_normals(&mesh), [Vec3::Z, Vec3::Z, Vec3::X]);
}

#[test]
fn a_cube_keeps_its_creases_and_loses_them_on_request() {
    let mesh = cleaned(cube(2));
    let sharp = corner_normals(&mesh, 30.0);
    assert!(sharp.iter().all(|n| n.abs().max_element() > 0.9999));
    let smooth = corner_normals(&mesh, 180.0);
    let of_vertex = |v: u32| {
        let corners = mesh.triangles.iter().flatten().zip(&smooth);
        corners.filter(move |(c, _)| **c == v).map(|(_, n)| *n).collect::<Vec<_>>()
    };
    assert!(of_vertex(0).windows(2).all(|pair| pair[0].distance(pair[1]) < 1e-6));
}

#[test]
fn pages_of_a_book_and_separate_fans_do_not_mix() {
    let mesh = cleaned(book(7));
    let faces: Vec<DVec3> = (0..7).map(|t| mesh.facet_normal(t)).collect();
    for (corner, normal) in corner_normals(&mesh, 40.0).iter().enumerate() {
        assert!(normal.as_dvec3().distance(faces[corner / 3]) < 1e-6);
    }
}

#[test]
fn rows_hold_every_corner_once_in_ascending_order() {
    let triangles = [[0, 1, 2], [2, 1, 3], [5, 3, 1]];
    let adjacency = VertexCorners::of(&triangles, 7);
    let rows: Vec<&[u32]> = (0..adjacency.len()).map(|v| adjacency.at(v)).collect();
    let expected: [&[u32]; 7] = [&[0], &[1, 4, 8], &[2, 3], &[5, 7], &[], &[6], &[]];
    assert_eq!(rows, expected);
}

#[test]
fn a_hub_of_a_hundred_thousand_triangles_stays_sorted() {
    let triangles: Vec<[u32; 3]> = (0..100_000).map(|i| [0, i + 1, i + 2]).collect();
    let adjacency = VertexCorners::of(&triangles, 100_002);
    assert!(adjacency.at(0).iter().enumerate().all(|(i, &c)| c == 3 * i as u32));
}

#[test]
fn no_triangles_give_empty_rows() {
    assert!(VertexCorners::of(&[], 0).is_empty());
    assert_eq!(VertexCorners::of(&[], 2).at(1), &[] as &[u32]);
}

#[test]
fn edges_come_in_order_with_what_continues_across_them() {
    // Two triangles side by side, wound alike, and the back of the second.
    let triangles = [[0, 1, 2], [2, 1, 3], [3, 1, 2]];
    let edges = Edges::of(&triangles);
    let found: Vec<_> =
        edges.iter().map(|e| (e.vertices(), e.triangle_count(), e.continued().to_vec())).collect();
    let expected = [
        ([0, 1], 1, vec![]),
        ([0, 2], 1, vec![]),
        // The first goes on with the second; the back has an end.
        ([1, 2], 3, vec![[1, 3]]),
        ([1, 3], 2, vec![]),
        ([2, 3], 2, vec![]),
    ];
    assert_eq!(found, expected);
}

#[test]
fn where_too_many_meet_nothing_continues() {
    let fan: Vec<[u32; 3]> = (2..1002).map(|v| if v % 2 == 0 { [0, 1, v] } else { [1, 0, v] }).collect();
    let edges = Edges::of(&fan);
    let middle = edges.iter().next().unwrap();
    assert_eq!((middle.vertices(), middle.triangle_count()), ([0, 1], 1000));
    assert!(middle.continued().is_empty());
}

/// Triangles at one edge along z from vertex 0 to vertex 1, by the degrees at which they stand and whether they run forward.
fn by_angle(around: &[(f32, bool)]) -> Vec<[usize; 2]> {
    let mut positions = vec![Vec3::ZERO, Vec3::Z];
    let mut sides = Vec::new();
    for &(degrees, is_forward) in around {
        sides.push(EdgeSide { opposite: positions.len() as u32, is_forward });
        positions.push(Vec2::from_angle(degrees.to_radians()).extend(0.3));
    }
    let found = continued_by_angle(&sides, [0, 1], &positions);
    // Seen from the other end all is the same.
    let turned: Vec<EdgeSide> =
        sides.iter().map(|side| EdgeSide { is_forward: !side.is_forward, ..*side }).collect();
    assert_eq!(found, continued_by_angle(&turned, [1, 0], &positions));
    found.to_vec()
}

#[test]
fn at_edges_of_several_triangles_angles_tell_what_continues() {
    // A forward triangle's front is to the left, where angles grow: two boxes that touch.
    assert_eq!(by_angle(&[(90.0, true), (0.0, false), (180.0, false), (270.0, true)]), [[0, 2], [1, 3]]);
    assert_eq!(by_angle(&[(90.0, false), (0.0, true), (180.0, true), (270.0, false)]), [[0, 1], [2, 3]]);
    // Six: three boxes.
    let three: Vec<(f32, bool)> = (0..6).map(|i| (60.0 * i as f32 + 7.0, i % 2 == 0)).collect();
    assert_eq!(by_angle(&three), [[0, 1], [2, 3], [4, 5]]);
    // Two sheets that cross.
    assert_eq!(by_angle(&[(10.0, true), (100.0, true), (190.0, false), (280.0, false)]), [[0, 2], [1, 3]]);
    // Too bent, lying on each other, an odd number, all in one direction: nothing is clear.
    assert!(by_angle(&[(0.0, true), (20.0, true), (40.0, false), (60.0, false)]).is_empty());
    assert!(by_angle(&[(0.0, true), (0.0, false), (90.0, true), (180.0, false)]).is_empty());
    assert!(by_angle(&[(0.0, true), (90.0, false), (180.0, true)]).is_empty());
    assert!(by_angle(&[(0.0, true), (90.0, true), (180.0, true), (270.0, true)]).is_empty());
}

fn pairs(sides: &[(u32, bool)]) -> Vec<[usize; 2]> {
    let sides: Vec<EdgeSide> =
        sides.iter().map(|&(opposite, is_forward)| EdgeSide { opposite, is_forward }).collect();
    continued(&sides).to_vec()
}

#[test]
fn two_triangles_continue_each_other_however_they_are_wound() {
    assert_eq!(pairs(&[(2, true), (3, false)]), [[0, 1]]);
    assert_eq!(pairs(&[(2, true), (3, true)]), [[0, 1]]);
    assert_eq!(pairs(&[(2, true)]), [[0; 2]; 0]);
}

#[test]
fn twins_do_not_continue_each_other() {
    assert_eq!(pairs(&[(2, true), (2, false)]), [[0; 2]; 0]);
}

#[test]
fn both_sides_of_a_leaf_go_on() {
    assert_eq!(pairs(&[(2, true), (2, false), (3, true), (3, false)]), [[0, 3], [1, 2]]);
    // One side has an end here.
    assert_eq!(pairs(&[(2, true), (2, false), (3, true)]), [[1, 2]]);
}

#[test]
fn where_it_is_not_clear_nothing_goes_on() {
    assert_eq!(pairs(&[(2, true), (3, false), (4, true)]), [[0; 2]; 0]);
    // Two blocks that touch along an edge.
    assert_eq!(pairs(&[(2, true), (3, false), (4, true), (5, false)]), [[0; 2]; 0]);
    // Three leaves in one stem.
    let leaves: Vec<(u32, bool)> = (2..5).flat_map(|v| [(v, true), (v, false)]).collect();
    assert_eq!(pairs(&leaves), [[0; 2]; 0]);
    let many: Vec<(u32, bool)> = (2..90_000).map(|v| (v, v % 2 == 0)).collect();
    assert_eq!(pairs(&many), [[0; 2]; 0]);
}

#[test]
fn both_of_a_pair_are_opposed_and_nothing_else() {
    let triangles = [[5, 3, 9], [0, 1, 2], [9, 3, 5], [1, 2, 3], [3, 9, 5], [2, 1, 7]];
    // The fifth is the first once more.
    let found = OpposedTriangles::of(&triangles);
    let all: Vec<bool> = (0..triangles.len()).map(|t| found.contains(t)).collect();
    assert_eq!(all, [true, false, true, false, true, false]);
    assert!(!found.contains(99));
    // Copies in the same order do not oppose each other.
    assert!(OpposedTriangles::of(&[[0, 1, 2], [1, 2, 0], [2, 3, 4]]).is_empty());
    assert_eq!(OpposedTriangles::of(&[]), OpposedTriangles::default());
}

#[test]
fn every_pair_of_orders_is_told_apart() {
    let orders = [[4, 6, 8], [6, 8, 4], [8, 4, 6], [4, 8, 6], [8, 6, 4], [6, 4, 8]];
    for (i, a) in orders.into_iter().enumerate() {
        for (j, b) in orders.into_iter().enumerate() {
            assert_eq!(OpposedTriangles::of(&[a, b]).contains(1), (i < 3) != (j < 3), "{a:?} {b:?}");
        }
    }
}
