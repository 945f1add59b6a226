//! Assets as files: verified, the same on any number of threads, whole or not there at all.

use crate::common;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::common::{Constant, baked, cleaned, cover, data_folder, loaded, needles, rectangle};
use fantex_bake::{BakeError, BakeFormat, BakeOptions, Fit, NoProgress, Progress, SineSource, bake};
use fantex_cover::{Cover, CoverOptions, GroupKind, TexelBudget, build_cover};
use fantex_mesh::{Mesh, generate};
use fantex_store::limits::MAX_TILE_SIDE;
use fantex_store::{ChannelKind, CreateError, JUMP_BOUND, VerifyOptions, VerifyReport, verify};
use glam::{DVec3, Vec4};

const WAVE: SineSource = SineSource { k: 30.0 };

fn verified(mesh: &Mesh, cover: &Cover, format: BakeFormat) -> VerifyReport {
    let options = BakeOptions { format, ..BakeOptions::default() };
    verify(&baked(mesh, cover, &WAVE, &options).path, &VerifyOptions::default()).unwrap()
}

/// A closed cone whose tip is too steep to be projected.
fn spike() -> Mesh {
    let n = 14;
    let mut positions = vec![DVec3::Y * 20.0, DVec3::ZERO];
    positions.extend((0..n).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(n)).sin_cos();
        DVec3::new(cos, 0.0, -sin)
    }));
    let triangles = (0..n).flat_map(|i| {
        let (a, b) = (2 + i, 2 + (i + 1) % n);
        [[0, a, b], [1, b, a]]
    });
    common::mesh_of(positions, triangles.collect())
}

#[test]
fn baked_assets_are_certified() {
    let mut meshes = vec![
        ("cube", cleaned(generate::cube(2))),
        ("icosphere", cleaned(generate::icosphere(3))),
        ("torus", cleaned(generate::torus(16, 9))),
        ("book", cleaned(generate::book(5))),
        ("spike", spike()),
        ("needles", needles(1e-4)),
    ];
    if let Some(folder) = data_folder() {
        meshes.push(("suzanne", loaded(&folder, "meshes/suzanne.ply")));
        meshes.push(("soup", loaded(&folder, "meshes/broken/soup.stl")));
        meshes.push(("tetrahedra", loaded(&folder, "meshes/broken/joined_tetrahedra.obj")));
    }
    for (name, mesh) in meshes {
        for tile in [0, 64] {
            let cover = cover(&mesh, tile, 30_000);
            for format in [BakeFormat::Bc1, BakeFormat::Float] {
                let report = verified(&mesh, &cover, format);
                assert!(report.ok && report.continuity.largest_jump < JUMP_BOUND, "{name}: {report:?}");
            }
        }
    }
}

#[test]
fn a_tile_of_many_blocks_is_certified() {
    let mesh = rectangle(1.3, 1.0);
    let report = verified(&mesh, &cover(&mesh, 0, 6 << 20), BakeFormat::Rgba8);
    assert!(report.ok, "{report:?}");
    assert!(report.continuity.edges == 1 && report.levels > 8);
}

/// The certificate can fail: one unfolded triangle that lies elsewhere than its neighbours is a crack.
#[test]
fn a_torn_fan_is_not_certified() {
    let mesh = spike();
    let mut cover = cover(&mesh, 0, 30_000);
    assert!(verified(&mesh, &cover, BakeFormat::Float).ok);
    let tip = cover.unfolded.iter().position(|u| {
        let groups = cover.corner_groups[u.corner as usize / 3];
        cover.groups[groups[u.corner as usize % 3] as usize].kind == GroupKind::Unfolded
    });
    let entry = &mut cover.unfolded[tip.unwrap()];
    let triangle = entry.corner / 3;
    entry.uv.iter_mut().for_each(|uv| uv.x = (uv.x + 0.11) % 1.0);
    let report = verified(&mesh, &cover, BakeFormat::Float);
    assert!(!report.ok && report.continuity.largest_jump > JUMP_BOUND, "{report:?}");
    assert!(report.continuity.worst.unwrap().triangles.contains(&triangle));
}

/// A triangle that names another group than its neighbours do breaks two edges; the fan there had no need to be split.
#[test]
fn a_triangle_with_another_group_is_noticed() {
    let mesh = cleaned(generate::icosphere(2));
    let mut cover = cover(&mesh, 0, 100_000);
    let whole = verified(&mesh, &cover, BakeFormat::Float);
    assert!(whole.ok && whole.continuity.exempt_edges == 0);
    cover.corner_groups[17][0] = cover.corner_groups[17][1];
    let report = verified(&mesh, &cover, BakeFormat::Float);
    assert!(!report.ok && report.continuity.needless_splits == 2, "{report:?}");
    assert_eq!(report.continuity.edges + 2, whole.continuity.edges);
}

fn bytes_of(mesh: &Mesh, cover: &Cover, threads: usize, options: &BakeOptions) -> Vec<u8> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| std::fs::read(&baked(mesh, cover, &WAVE, options).path).unwrap())
}

#[test]
fn bytes_depend_neither_on_threads_nor_on_memory() {
    let tiles = cleaned(generate::torus(30, 20));
    let blocks = rectangle(2.0, 1.0);
    for (mesh, cover) in [(&tiles, cover(&tiles, 64, 400_000)), (&blocks, cover(&blocks, 1 << 16, 3_000_000))]
    {
        let options = BakeOptions { format: BakeFormat::Bc1, ..BakeOptions::default() };
        let one = bytes_of(mesh, &cover, 1, &options);
        assert!(one == bytes_of(mesh, &cover, 2, &options));
        assert!(one == bytes_of(mesh, &cover, 4, &options));
        assert!(one == bytes_of(mesh, &cover, 3, &BakeOptions { memory_bytes: 1, ..options }));
    }
}

/// Wants to stop after some reports.
struct StopAfter(AtomicU64);

impl Progress for StopAfter {
    fn report(&self, done: u64, total: u64) {
        assert!(done <= total);
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).unwrap_or_default();
    }

    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).unwrap().next().is_none()
}

#[test]
fn a_cancelled_bake_leaves_nothing_and_keeps_what_was_there() {
    let mesh = cleaned(generate::icosphere(4));
    let cover = cover(&mesh, 32, 500_000);
    let options = BakeOptions { memory_bytes: 1, force: true, ..BakeOptions::default() };
    for reports in [0, 1, 40] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        let stop = || StopAfter(AtomicU64::new(reports));
        let error = bake(&mesh, &cover, &WAVE, &path, &options, &stop()).unwrap_err();
        assert!(matches!(error, BakeError::Cancelled), "{error}");
        assert!(is_empty(folder.path()));
        std::fs::write(&path, "older").unwrap();
        bake(&mesh, &cover, &WAVE, &path, &options, &stop()).unwrap_err();
        assert_eq!(std::fs::read(&path).unwrap(), b"older");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

#[test]
fn nothing_is_overwritten_unless_forced() {
    let mesh = cleaned(generate::cube(1));
    let cover = cover(&mesh, 0, 5_000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    std::fs::write(&path, "precious").unwrap();
    let mut options = BakeOptions { format: BakeFormat::Rgba8, ..BakeOptions::default() };
    let error = bake(&mesh, &cover, &WAVE, &path, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, BakeError::Create(CreateError::Exists(_))), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    options.force = true;
    let summary = bake(&mesh, &cover, &WAVE, &path, &options, &NoProgress).unwrap();
    assert_eq!(std::fs::metadata(&path).unwrap().len(), summary.bytes);
    assert_eq!((summary.texels, summary.channels), (cover.texels(), vec!["BaseColor".to_owned()]));
    assert!(verify(&path, &VerifyOptions::default()).unwrap().ok);
}

#[test]
fn wrong_covers_sources_and_places_are_refused() {
    let (mesh, other) = (cleaned(generate::cube(1)), cleaned(generate::cube(2)));
    let cover = cover(&mesh, 0, 5_000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let options = BakeOptions::default();
    let error = bake(&other, &cover, &WAVE, &path, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, BakeError::CoverOfAnotherMesh { cover: 12, mesh: 48 }), "{error}");
    let error = bake(&mesh, &cover, &Constant(Vec::new()), &path, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, BakeError::NoChannels), "{error}");
    let nowhere = folder.path().join("no/such/folder/a.fan");
    let error = bake(&mesh, &cover, &WAVE, &nowhere, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, BakeError::Create(CreateError::Io { .. })), "{error}");
    assert!(is_empty(folder.path()));
}

/// A cover may ask for tiles that the format cannot hold; that is said before anything is baked.
#[test]
fn tiles_longer_than_the_format_allows_are_refused_at_once() {
    let mesh = rectangle(1.0, 1e-4);
    let budget = TexelBudget::Density(80_000.0);
    let (cover, _) =
        build_cover(&mesh, &CoverOptions { budget, tile: 0, ..CoverOptions::default() }).unwrap();
    assert!(cover.groups.iter().flat_map(|g| g.extent).any(|n| n > MAX_TILE_SIDE));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let error = bake(&mesh, &cover, &WAVE, &path, &BakeOptions::default(), &NoProgress).unwrap_err();
    assert!(matches!(error, BakeError::Create(CreateError::Content { .. })), "{error}");
    assert!(is_empty(folder.path()));
}

/// Progress ends at the total, in every format and with every fit.
#[test]
fn all_formats_and_fits_bake_all_channels() {
    struct Last(AtomicU64);
    impl Progress for Last {
        fn report(&self, done: u64, _: u64) {
            self.0.fetch_max(done, Ordering::Relaxed);
        }
    }
    let mesh = cleaned(generate::icosphere(2));
    let cover = cover(&mesh, 64, 20_000);
    let kinds =
        [ChannelKind::BaseColor, ChannelKind::Normal, ChannelKind::Emission, ChannelKind::Displacement];
    let source = Constant(kinds.map(|kind| (kind, Vec4::new(0.0, 0.0, 1.0, 1.0))).to_vec());
    for format in [BakeFormat::Bc7, BakeFormat::Bc1, BakeFormat::Rgba8, BakeFormat::Float] {
        for fit in [Fit::Sharp, Fit::Point, Fit::Box] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.fan");
            let last = Last(AtomicU64::new(0));
            let options = BakeOptions { format, fit, ..BakeOptions::default() };
            let summary = bake(&mesh, &cover, &source, &path, &options, &last).unwrap();
            assert_eq!(last.0.into_inner(), cover.texels());
            assert_eq!(summary.channels.len(), 4);
            assert!(summary.texel_bytes < summary.bytes);
            let report = verify(&path, &VerifyOptions::default()).unwrap();
            assert!(report.ok, "{format:?} {fit:?}: {report:?}");
        }
    }
}
