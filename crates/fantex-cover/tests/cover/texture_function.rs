//! Levels, stored directions, and the taps of the texture function.

use std::collections::BTreeSet;

use fantex_base::Random;
use fantex_cover::{
    Cover, Frame, Group, GroupKind, GroupTriangles, TexelBudget, UnfoldedCorner, UnfoldedCorners,
    build_cover, level_count, level_length, stretch_axes,
};
use fantex_mesh::{Mesh, SurfacePoint};
use glam::{Vec2, Vec3};

use crate::common::{generated, options};

#[test]
fn levels_end_with_the_first_that_is_four_texels_long() {
    for longest in (1..5000).chain([16_384, 65_532, 65_536]) {
        let first = (0..).find(|&level| level_length(longest, level) == 4).unwrap();
        assert_eq!(level_count([4, longest]), first + 1, "{longest}");
    }
}

fn group() -> Group {
    let direction = Vec3::new(0.2, -0.4, 0.8).normalize();
    Group {
        kind: GroupKind::Projected,
        frame: Frame { origin: Vec3::ZERO, direction, x_axis: direction.any_orthonormal_vector() },
        uv_scale: Vec2::ONE,
        uv_offset: Vec2::ZERO,
        extent: [4, 4],
    }
}

#[test]
fn normals_return_from_a_tile_as_they_were() {
    let (group, vertex_normal) = (group(), Vec3::new(-0.3, 0.1, 0.9).normalize());
    for normal in [Vec3::Z, vertex_normal, Vec3::new(-0.6, 0.5, 0.4).normalize()] {
        let stored = group.stored_from_normal(normal, vertex_normal);
        assert!(group.normal_from_stored(stored, vertex_normal).distance(normal) < 1e-6);
        let tangent = group.tangent_from_stored(stored, vertex_normal);
        assert!((tangent + vertex_normal * normal.dot(vertex_normal)).distance(normal) < 1e-6);
        assert!(group.stored_from_tangent(tangent, vertex_normal).distance(stored) < 1e-6);
    }
    assert!(group.stored_from_tangent(Vec3::X * 9.0, Vec3::Z).distance(Vec2::splat(0.5)) < 0.5001);
    // A normal that looks backwards becomes the nearest that does not.
    let along = (Vec3::X - vertex_normal * vertex_normal.x).normalize();
    let stored = group.stored_from_normal((along - vertex_normal * 0.7).normalize(), vertex_normal);
    // Numbers next to a unit circle say little about what is across it.
    assert!(group.normal_from_stored(stored, vertex_normal).distance(along) < 1e-3);
}

#[test]
fn stretches_of_opposite_directions_are_the_same() {
    let (group, vertex_normal) = (group(), Vec3::Z);
    let [x, y] = stretch_axes(vertex_normal);
    let direction = x * 0.6 + y * 0.8;
    for along in [direction, -direction] {
        let stored = group.stored_from_stretch(along, 0.5, vertex_normal);
        let stretch = group.stretch_from_stored(stored, vertex_normal);
        assert!(stretch.distance(Vec2::new(0.6, 0.8).rotate(Vec2::new(0.6, 0.8)) * 0.5) < 1e-6);
    }
}

#[test]
fn every_group_gets_the_triangles_that_name_it_once() {
    let corner_groups = vec![[0, 1, 2], [2, 2, 2], [1, 0, 1], [0, 0, 3]];
    let groups = vec![group(); 4];
    let cover = Cover {
        delta: 0.2,
        density: 1.0,
        is_creased: false,
        hard_edges: None,
        is_paired_by_angle: false,
        corner_groups,
        groups,
        unfolded: UnfoldedCorners::default(),
    };
    let triangles = GroupTriangles::of(&cover);
    let rows = [0, 1, 2, 3].map(|g| triangles.of_group(g));
    assert_eq!(rows, [[0, 2, 3].as_slice(), &[0, 2], &[0, 1], &[3]]);
    assert!(cover.groups_of(0).eq(0..3));
    assert!(cover.groups_of(2).eq([1, 0]));
}

#[test]
fn taps_are_the_weighted_tiles_of_the_corners() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let groups = vec![group(); 3];
    let corner_groups = vec![[2, 0, 1]];
    let cover = Cover {
        delta: 0.25,
        density: 1.0,
        is_creased: false,
        hard_edges: None,
        is_paired_by_angle: false,
        corner_groups,
        groups,
        unfolded: UnfoldedCorners::default(),
    };
    for lambda in [Vec3::X, Vec3::splat(1.0 / 3.0), Vec3::new(0.1, 0.4, 0.5)] {
        let point = SurfacePoint { triangle: 0, lambda };
        assert!(cover.taps(&mesh, point).eq(cover.triangle_tiles(&mesh, 0).taps(lambda)));
        let weights = cover.weights(0, lambda);
        assert!(cover.taps(&mesh, point).map(|tap| (tap.slot, tap.weight)).eq(weights.iter()));
        for tap in cover.taps(&mesh, point) {
            assert_eq!(tap.corners, cover.tile_corners(&mesh, 0, tap.slot));
            assert_eq!(tap.group, cover.corner_groups[0][tap.slot]);
            let group = &cover.groups[tap.group as usize];
            assert!(tap.uv.distance(group.tile_from_mesh(point.position(&mesh))) < 1e-6);
            assert_eq!(tap.steps([Vec3::X, Vec3::Y]), [tap.corners[0], tap.corners[1]]);
        }
    }
}

/// Beside blocks that the look-ups at a hundred thousand points show to be kept.
#[test]
fn stored_texels_are_those_near_look_ups() {
    for (name, mesh) in generated() {
        for (tile, total) in [(0, 20_000), (1024, 20_000), (1024, 2_000)] {
            let (cover, stats) = build_cover(&mesh, &options(tile, TexelBudget::Total(total))).unwrap();
            let mut blocks = BTreeSet::new();
            let mut random = Random::new(3);
            for _ in 0..100_000 {
                let [x, y] = [random.unit() as f32, random.unit() as f32];
                let [x, y] = if x + y > 1.0 { [1.0 - x, 1.0 - y] } else { [x, y] };
                let triangle = random.below(mesh.triangles.len() as u64) as u32;
                let point = SurfacePoint { triangle, lambda: Vec3::new(x, y, 1.0 - x - y) };
                for tap in cover.taps(&mesh, point) {
                    let extent = cover.groups[tap.group as usize].extent;
                    let at = tap.uv * Vec2::new(extent[0] as f32, extent[1] as f32);
                    let block = |x: f32, n: u32| ((x.max(0.0) / 4.0) as u32).min(n / 4 - 1);
                    let near = 0.5 + 1.0 / 16.0;
                    for (dx, dy) in [(-near, -near), (near, -near), (-near, near), (near, near)] {
                        blocks.insert((tap.group, block(at.x + dx, extent[0]), block(at.y + dy, extent[1])));
                    }
                }
            }
            let stored = cover.stored_blocks(&mesh);
            assert!(
                blocks.iter().all(|&(group, column, row)| stored.contains(group, [column, row])),
                "{name}"
            );
            let seen = 16 * blocks.len() as u64;
            assert_eq!(stats.texels, cover.stored_texels(&mesh), "{name}");
            assert!(
                seen <= stats.texels && seen as f64 > 0.97 * stats.texels as f64,
                "{name}: {seen} of {}",
                stats.texels
            );
        }
    }
}

/// Corners are found by bits and counts as a search finds them.
#[test]
fn unfolded_corners_are_found_by_corner() {
    let mut random = Random::new(5);
    for share in [0.0, 0.01, 0.3, 1.0] {
        let corners: Vec<u32> = (0..3000).filter(|_| random.unit() < share).collect();
        let entry = |&corner: &u32| UnfoldedCorner { corner, uv: [Vec2::splat(corner as f32); 3] };
        let unfolded: UnfoldedCorners = corners.iter().map(entry).collect();
        assert!(unfolded.iter().map(|entry| entry.corner).eq(corners.iter().copied()));
        for corner in (0..3100).chain([u32::MAX]) {
            let expected = corners.binary_search(&corner).ok().map(|i| &unfolded[i]);
            assert_eq!(unfolded.find(corner), expected, "{corner} of {}", corners.len());
        }
    }
}
