//! Verification accepts what is whole and finds what is not.

use std::path::{Path, PathBuf};

use fantex_cover::{Cover, GroupKind};
use fantex_mesh::Mesh;
use fantex_store::{
    Asset, AssetEditor, EditOptions, ExemptEdges, JUMP_BOUND, MeshFault, VerifyOptions, VerifyReport, verify,
};
use glam::Vec3;

use crate::common::{block_channels, fan_cover, plain_channels, sheet, tetrahedron, write};

fn mixed_extent(v: usize) -> [u32; 2] {
    [[64, 48], [4, 4], [600, 260], [8, 20], [100, 32]][v % 5]
}

fn written(folder: &Path, mesh: &Mesh, cover: &Cover) -> PathBuf {
    let path = folder.join("a.fan");
    write(&path, mesh, cover, &block_channels(), 50).unwrap();
    path
}

fn verified(mesh: &Mesh, cover: &Cover) -> VerifyReport {
    let folder = tempfile::tempdir().unwrap();
    verify(&written(folder.path(), mesh, cover), &VerifyOptions::default()).unwrap()
}

#[test]
fn a_whole_asset_is_continuous_in_all_formats() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    for mesh in [sheet(4), tetrahedron()] {
        for channels in [block_channels(), plain_channels()] {
            let cover = fan_cover(&mesh, mixed_extent);
            write(&path, &mesh, &cover, &channels, 50).unwrap();
            let report = verify(&path, &VerifyOptions::default()).unwrap();
            assert!(report.ok, "{report:?}");
            assert!(report.continuity.largest_jump < 1e-6, "{report:?}");
            let inner = if mesh.triangles.len() == 4 { 6 } else { 4 * 4 * 3 - 8 };
            assert_eq!(report.continuity.edges, inner);
            assert_eq!(report.continuity.exempt_edges, 0);
            assert!(report.continuity.samples > inner * 5 * 3);
            assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
        }
    }
}

#[test]
fn the_report_depends_neither_on_memory_nor_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = sheet(4);
    let mut cover = fan_cover(&mesh, mixed_extent);
    let mut entries = cover.unfolded.to_vec();
    entries[3].uv[1].x += 0.05;
    cover.unfolded = entries.into();
    let path = written(folder.path(), &mesh, &cover);
    let reports = [(1, 1), (2, 1 << 20), (4, 1 << 28)].map(|(threads, memory_bytes)| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| verify(&path, &VerifyOptions { memory_bytes, texels: true })).unwrap()
    });
    assert!(reports[0] == reports[1] && reports[0] == reports[2], "{reports:?}");
}

#[test]
fn a_crack_in_the_cover_is_found_and_located() {
    let mesh = sheet(4);
    let mut cover = fan_cover(&mesh, |_| [32, 32]);
    // One corner of one triangle of an unfolded fan lies elsewhere than in the neighbouring triangle.
    let entry = cover
        .unfolded
        .iter()
        .position(|u| {
            let v = mesh.triangles[u.corner as usize / 3][u.corner as usize % 3];
            // A vertex in the middle of the sheet, so that all its edges are inner ones.
            v == 11 || v == 17
        })
        .unwrap();
    let mut entries = cover.unfolded.to_vec();
    entries[entry].uv[0].y += 0.1;
    cover.unfolded = entries.into();
    let report = verified(&mesh, &cover);
    assert!(!report.ok);
    assert!(report.continuity.largest_jump > JUMP_BOUND, "{report:?}");
    let worst = report.continuity.worst.unwrap();
    let triangle = cover.unfolded[entry].corner / 3;
    assert!(worst.triangles.contains(&triangle), "{worst:?}");
    assert_eq!(report.damaged_tiles, 0);
}

#[test]
fn needless_splits_are_faults_and_non_manifold_edges_exempt() {
    let mesh = sheet(2);
    let mut cover = fan_cover(&mesh, |_| [16, 16]);
    // The middle vertex' fan is split: triangle 0 gets a group of its own there.
    let slot = mesh.triangles[0].iter().position(|&v| v == 4).unwrap();
    cover.groups.push(cover.groups[4]);
    assert_eq!(cover.groups[4].kind, GroupKind::Projected);
    cover.corner_groups[0][slot] = cover.groups.len() as u32 - 1;
    let report = verified(&mesh, &cover);
    // Both edges of triangle 0 at the middle vertex; the flat fan there had no need to be split.
    assert!(!report.ok, "{report:?}");
    assert_eq!((report.continuity.needless_splits, report.continuity.exempt_edges), (2, 0));

    // Every fan of a tetrahedron pressed flat can be unfolded: all edges are compared.
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.6, 0.6, 0.0)];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let flat = Mesh { positions, triangles, ..tetrahedron() };
    let options = fantex_cover::CoverOptions { tile: 0, ..fantex_cover::CoverOptions::default() };
    let (cover, stats) = fantex_cover::build_cover(&flat, &options).unwrap();
    assert_eq!(stats.fans.unfolded, 4);
    let report = verified(&flat, &cover);
    assert!(report.ok, "{report:?}");
    assert_eq!((report.continuity.edges, report.continuity.exempt_edges), (6, 0));

    let mut mesh = tetrahedron();
    mesh.positions.push(Vec3::new(0.5, -0.5, 0.9));
    mesh.triangles.push([0, 1, 4]);
    let report = verified(&mesh, &fan_cover(&mesh, |_| [16, 16]));
    assert_eq!(report.continuity.exempt, ExemptEdges { non_manifold: 1, ..ExemptEdges::default() });
    assert_eq!((report.continuity.edges, report.continuity.boundary_edges), (5, 2));
}

/// A sheet with its other side: on both of them the texture goes on across all inner edges, where four triangles meet, and ends at the
/// rim.
#[test]
fn both_sides_of_a_leaf_are_compared() {
    let mut mesh = sheet(3);
    let inner = verified(&mesh, &covered(&mesh)).continuity.edges;
    let rim = verified(&mesh, &covered(&mesh)).continuity.boundary_edges;
    let backs: Vec<[u32; 3]> = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    mesh.triangles.extend(backs);
    (mesh.corners, mesh.triangle_materials, mesh.parts) = Default::default();
    let report = verified(&mesh, &covered(&mesh));
    assert!(report.ok, "{report:?}");
    assert_eq!((report.continuity.edges, report.continuity.boundary_edges), (2 * inner, 0));
    assert_eq!(report.continuity.exempt, ExemptEdges { rim, ..ExemptEdges::default() });
}

fn covered(mesh: &Mesh) -> fantex_cover::Cover {
    let budget = fantex_cover::TexelBudget::Total(1 << 12);
    let options = fantex_cover::CoverOptions { budget, ..fantex_cover::CoverOptions::default() };
    fantex_cover::build_cover(mesh, &options).unwrap().0
}

#[test]
fn faults_of_the_mesh_are_reported() {
    let mut mesh = tetrahedron();
    mesh.triangles.push([1, 2, 0]);
    let report = verified(&mesh, &fan_cover(&mesh, |_| [16, 16]));
    assert!(!report.ok);
    assert_eq!(report.mesh_faults, [MeshFault::SameTriangle(0, 4)]);
}

#[test]
fn damage_is_counted_and_does_not_break_continuity() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = sheet(4);
    let cover = fan_cover(&mesh, mixed_extent);
    let path = written(folder.path(), &mesh, &cover);
    let ranges = Asset::open(&path).unwrap().cluster_ranges(0);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[ranges[1].start as usize + 9] ^= 1;
    bytes[4096 + 20] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let report = verify(&path, &VerifyOptions::default()).unwrap();
    assert!(!report.ok);
    assert!(report.damaged_tiles > 0, "{report:?}");
    assert_eq!(report.first_damage.len(), 1);
    assert_eq!(report.damaged_headers, 1);
    assert!(report.continuity.largest_jump < JUMP_BOUND, "{report:?}");
}

#[test]
fn attachments_that_cannot_be_read_are_counted_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = tetrahedron();
    let path = written(folder.path(), &mesh, &fan_cover(&mesh, |_| [16, 16]));
    let contents = b"too short to be packed";
    {
        let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
        editor.attach("note", contents.to_vec()).unwrap();
        editor.commit().unwrap();
    }
    let mut bytes = std::fs::read(&path).unwrap();
    let place = bytes.windows(contents.len()).position(|window| window == contents).unwrap();
    bytes[place] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let report = verify(&path, &VerifyOptions::default()).unwrap();
    assert_eq!((report.ok, report.damaged_attachments, report.damaged_tiles), (false, 1, 0));
    assert_eq!(report.first_damage.len(), 1);
    assert!(report.first_damage[0].starts_with("attachment \"note\""), "{report:?}");
}
