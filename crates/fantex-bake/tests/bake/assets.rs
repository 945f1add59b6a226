//! Assets as files: verified, the same on any number of threads, whole or not there at all.

use std::f32::consts::TAU;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use fantex_bake::{
    AssetSource, BakeFormat, BakeOptions, Fidelity, Fit, NoProgress, Prefilter, Progress, SineSource, Source,
    TexelPoint, bake, fidelity, plan_bake,
};
use fantex_base::ErrorKind;
use fantex_cover::{Cover, CoverOptions, GroupKind, TexelBudget, build_cover};
use fantex_mesh::{Mesh, SurfacePoint, generate, interpolate, lambda_step};
use fantex_store::limits::MAX_TILE_SIDE;
use fantex_store::{
    ChannelKind, JUMP_BOUND, PageCache, Recipe, TileId, TileSource, TileTexels, VerifyOptions, VerifyReport,
    group_pages, verify,
};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::common;
use crate::common::{
    Constant, OfPosition, baked, barycentric_points, cleaned, cover, data_folder, float_options, loaded,
    mesh_of, needles, rectangle, sample,
};

const WAVE: SineSource = SineSource { k: 30.0 };

fn verified(mesh: &Mesh, cover: &Cover, format: BakeFormat) -> VerifyReport {
    let options = BakeOptions { format, ..BakeOptions::default() };
    let with_texels = VerifyOptions { texels: true, ..VerifyOptions::default() };
    verify(&baked(mesh, cover, &WAVE, &options).path, &with_texels).unwrap()
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
    let mut entries = cover.unfolded.to_vec();
    let entry = &mut entries[tip.unwrap()];
    let triangle = entry.corner / 3;
    entry.uv.iter_mut().for_each(|uv| uv.x = (uv.x + 0.11) % 1.0);
    cover.unfolded = entries.into();
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

/// What lies in the tile of a disc beside it is not stored. Long footprints at its rim reach across.
#[test]
fn a_source_of_an_asset_knows_nothing_beyond_open_borders() {
    let count = 48;
    let rim = (0..count).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
        DVec3::new(cos, 0.0, sin)
    });
    let triangles = (0..count).map(|i| [0, 1 + (i + 1) % count, 1 + i]).collect();
    let mesh = mesh_of([DVec3::ZERO].into_iter().chain(rim).collect(), triangles);
    let white = Constant(vec![(ChannelKind::BaseColor, Vec4::ONE)]);
    let options = BakeOptions { format: BakeFormat::Bc7, ..BakeOptions::default() };
    let asset = baked(&mesh, &cover(&mesh, 512, 40_000), &white, &options);
    let mesh = asset.cache.asset().mesh();
    let source = AssetSource::new(&asset.cache);
    for triangle in 0..mesh.triangles.len() {
        let corners = mesh.triangle_positions(triangle);
        // The disc's middle is the origin of mesh space.
        let length = |corner: usize| corners[corner].length();
        let middle = (0..3).min_by(|&i, &j| length(i).total_cmp(&length(j))).unwrap();
        let [a, b] = [1, 2].map(|k| corners[(middle + k) % 3]);
        let position_steps = [(a + b).normalize() * 0.2, (b - a).normalize() * 0.01];
        let mut lambda = Vec3::splat(0.5);
        lambda[middle] = 0.0;
        let point = TexelPoint {
            at: SurfacePoint { triangle: triangle as u32, lambda },
            lambda_steps: position_steps.map(|step| lambda_step(corners, step)),
            position: interpolate(corners, lambda),
            position_steps,
            normal: Vec3::Y,
        };
        let mut values = [Vec4::ZERO];
        source.evaluate(&point, &mut values);
        assert!(values[0].distance(Vec4::ONE) < 0.02, "triangle {triangle}: {}", values[0]);
    }
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
        assert!(error.is_cancelled(), "{error}");
        assert!(is_empty(folder.path()));
        std::fs::write(&path, "older").unwrap();
        bake(&mesh, &cover, &WAVE, &path, &options, &stop()).unwrap_err();
        assert_eq!(std::fs::read(&path).unwrap(), b"older");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

/// Counts its points, and wants to stop after ten.
#[derive(Default)]
struct Slow(AtomicU64);

impl Source for Slow {
    fn has_slow_points(&self) -> bool {
        true
    }

    fn evaluate(&self, _: &TexelPoint, values: &mut [Vec4]) {
        self.0.fetch_add(1, Ordering::Relaxed);
        values.fill(Vec4::ONE);
    }
}

impl Progress for Slow {
    fn report(&self, _: u64, _: u64) {}

    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 10
    }
}

#[test]
fn bakes_end_between_points_that_are_slow() {
    let mesh = cleaned(generate::grid(2));
    let cover = cover(&mesh, 1024, 4096);
    assert_eq!(cover.groups.len(), 1);
    let folder = tempfile::tempdir().unwrap();
    let slow = Slow::default();
    let error = bake(&mesh, &cover, &slow, &folder.path().join("a.fan"), &BakeOptions::default(), &slow);
    assert!(error.unwrap_err().is_cancelled());
    // One tile is the work of one thread.
    assert_eq!(slow.0.into_inner(), 10);
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
    assert_eq!(error.kind(), ErrorKind::AlreadyExists, "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    options.force = true;
    let summary = bake(&mesh, &cover, &WAVE, &path, &options, &NoProgress).unwrap();
    assert_eq!(std::fs::metadata(&path).unwrap().len(), summary.bytes);
    assert_eq!(
        (summary.texels, summary.channels),
        (cover.stored_texels(&mesh), vec!["BaseColor".to_owned()])
    );
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
    assert!(error.to_string().starts_with("the cover has 12 triangles, the mesh 48"), "{error}");
    let error = bake(&mesh, &cover, &Constant(Vec::new()), &path, &options, &NoProgress).unwrap_err();
    assert!(error.to_string().contains("no channel"), "{error}");
    let nowhere = folder.path().join("no/such/folder/a.fan");
    let error = bake(&mesh, &cover, &WAVE, &nowhere, &options, &NoProgress).unwrap_err();
    assert!(error.to_string().starts_with("cannot write "), "{error}");
    assert!(is_empty(folder.path()));
}

/// A cover that somebody made may have tiles that the format cannot hold; that is said before anything is baked.
#[test]
fn tiles_longer_than_the_format_allows_are_refused_at_once() {
    let mesh = rectangle(1.0, 1e-4);
    let mut cover = cover(&mesh, 0, 5_000);
    cover.groups[0].extent[0] = MAX_TILE_SIDE + 4;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let error = bake(&mesh, &cover, &WAVE, &path, &BakeOptions::default(), &NoProgress).unwrap_err();
    assert!(error.to_string().starts_with("cannot write "), "{error}");
    assert!(is_empty(folder.path()));
}

/// What a cover may have at most, a file holds: one constant.
#[test]
fn the_longest_tiles_of_covers_fit_into_files() {
    assert_eq!(fantex_cover::MAX_EXTENT, MAX_TILE_SIDE);
    let mesh = rectangle(1.0, 1e-4);
    let covered = |density| {
        let budget = TexelBudget::Density(density);
        build_cover(&mesh, &CoverOptions { budget, tile: 0, ..CoverOptions::default() })
    };
    let longest = |cover: &Cover| cover.groups.iter().flat_map(|group| group.extent).max().unwrap();
    let density = 3e4 * f64::from(MAX_TILE_SIDE) / f64::from(longest(&covered(3e4).unwrap().0));
    covered(1.01 * density).unwrap_err();
    let (cover, _) = covered(0.99 * density).unwrap();
    assert!(longest(&cover) > MAX_TILE_SIDE / 10 * 9);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.plan");
    plan_bake(&mesh, &cover, &WAVE, &path, &BakeOptions::default(), &Recipe::default(), &[]).unwrap();
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

// What was baked is what is read: constants, linear functions, waves, and tiles that are baked in blocks.

const COLOR: Vec4 = Vec4::new(0.25, 0.5, 0.75, 0.625);
const EMISSION: Vec4 = Vec4::new(4.0, 0.03, 1.0, 1.0);

/// A constant comes back from everywhere, at every level: no texel that is read was left without a value.
#[track_caller]
fn assert_constant(name: &str, mesh: &Mesh, cover: &Cover, points: u32) {
    let source = Constant(vec![(ChannelKind::BaseColor, COLOR), (ChannelKind::Emission, EMISSION)]);
    let baked = baked(mesh, cover, &source, &float_options(Fit::Sharp));
    let levels = baked.cache.asset().level_count();
    let points = barycentric_points(points);
    for triangle in 0..mesh.triangles.len() {
        for &lambda in &points {
            for level in 0..levels {
                for (channel, expected) in [COLOR, EMISSION].into_iter().enumerate() {
                    let value = sample(&baked.cache, channel, level, triangle, lambda);
                    assert!(
                        (value - expected).abs().max_element() < 1e-5,
                        "{name}: {value} at triangle {triangle} {lambda}, level {level}"
                    );
                }
            }
        }
    }
    for group in 0..cover.groups.len() as u32 {
        let mean = Vec4::from_array(baked.cache.asset().mean(0, group));
        assert!((mean - COLOR).abs().max_element() < 1e-5, "{name}: mean {mean} of group {group}");
    }
}

/// Blocks that nothing reads are zero bytes in all channels; no others are, in those of BC7.
#[test]
fn only_what_is_read_is_stored() {
    let mesh = cleaned(generate::icosphere(3));
    let cover = cover(&mesh, 256, 300_000);
    let values = [(ChannelKind::BaseColor, Vec4::ONE), (ChannelKind::Displacement, Vec4::splat(0.5))];
    let options = BakeOptions { format: BakeFormat::Bc7, ..BakeOptions::default() };
    let baked = baked(&mesh, &cover, &Constant(values.to_vec()), &options);
    let asset = baked.cache.asset();
    let (mut blocks, mut empty) = (0, 0);
    for page in (0..).zip(&cover.groups).flat_map(|(index, group)| group_pages(index, group)) {
        let [color, height] = [0, 1].map(|channel| asset.read_page_raw(channel, page).unwrap());
        for (color, height) in color.chunks(16).zip(height.chunks(8)) {
            let is_empty = color == [0; 16];
            assert_eq!(is_empty, height == [0; 8], "{page}");
            (blocks, empty) = (blocks + 1, empty + u32::from(is_empty));
        }
    }
    assert!(empty * 20 > blocks && empty * 2 < blocks, "{empty} of {blocks} blocks are empty");
    for triangle in 0..mesh.triangles.len() {
        for lambda in barycentric_points(12) {
            for level in 0..asset.level_count() {
                let value = sample(&baked.cache, 0, level, triangle, lambda);
                assert!(
                    (value - Vec4::ONE).abs().max_element() < 0.01,
                    "{value} at triangle {triangle} {lambda}"
                );
            }
        }
    }
}

#[test]
fn constants_on_known_shapes() {
    let shapes = [
        ("cube", cleaned(generate::cube(3))),
        ("icosphere", cleaned(generate::icosphere(3))),
        ("torus", cleaned(generate::torus(20, 12))),
        ("book", cleaned(generate::book(9))),
        ("triangle", mesh_of(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2]])),
        ("twins", mesh_of(vec![DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2], [0, 2, 1]])),
        (
            "acute",
            mesh_of(
                vec![DVec3::ZERO, DVec3::new(1.0, 0.02, 0.0), DVec3::new(1.0, -0.02, 0.0)],
                vec![[0, 1, 2]],
            ),
        ),
    ];
    for (name, mesh) in shapes {
        for (tile, texels) in [(0, 20_000), (64, 20_000), (256, 300_000)] {
            assert_constant(name, &mesh, &cover(&mesh, tile, texels), 23);
        }
    }
}

/// A star of acute triangles that stand apart, each alone in its tips.
#[test]
fn constants_on_acute_tips() {
    let n = 9;
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..2 * n).map(|i| {
        let (sin, cos) = (f64::from(i / 2) * 0.69 + f64::from(i % 2) * 0.04).sin_cos();
        DVec3::new(cos, sin, 0.01 * f64::from(i))
    }));
    let mesh = mesh_of(positions, (0..n as u32).map(|i| [0, 1 + 2 * i, 2 + 2 * i]).collect());
    for (tile, texels) in [(0, 5_000), (128, 50_000), (2048, 200_000), (2048, 1_000_000)] {
        assert_constant("star", &mesh, &cover(&mesh, tile, texels), 40);
    }
}

#[test]
fn constants_on_needles() {
    for width in [1e-2, 1e-4, 1e-7] {
        for (tile, texels) in [(0, 3_000), (64, 100_000), (0, 300_000)] {
            let mesh = needles(width);
            assert_constant(&format!("needles {width}"), &mesh, &cover(&mesh, tile, texels), 23);
        }
    }
}

#[test]
fn constants_on_difficult_models() {
    let Some(folder) = data_folder() else { return };
    for (name, points) in [
        ("meshes/broken/chair_model.obj", 5),
        ("meshes/mengerSponge3.glb", 4),
        ("meshes/broken/soup.stl", 12),
        ("meshes/suzanne.ply", 8),
        ("meshes/broken/wallhole.obj", 12),
        ("meshes/teapot.stl", 8),
    ] {
        let mesh = loaded(&folder, name);
        for (tile, texels) in [(0, 300_000), (64, 500_000)] {
            assert_constant(name, &mesh, &cover(&mesh, tile, texels), points);
        }
    }
}

/// Bilinear look-ups keep linear functions, and so does the fit.
#[test]
fn linear_functions_come_back_from_a_plane() {
    let linear = |p: Vec3| Vec4::new(0.5 + 0.3 * p.x - 0.2 * p.z, 0.5 + 0.4 * p.z, 0.2 - 0.1 * p.x, 1.0);
    let mesh = cleaned(generate::grid(6));
    for tile in [0, 64, 256] {
        for fit in [Fit::Sharp, Fit::Point] {
            let baked = baked(&mesh, &cover(&mesh, tile, 100_000), &OfPosition(linear), &float_options(fit));
            for triangle in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.triangle_positions(triangle);
                for lambda in barycentric_points(9) {
                    let value = sample(&baked.cache, 0, 0, triangle, lambda);
                    let expected = linear(interpolate([a, b, c], lambda));
                    assert!(
                        (value - expected).abs().max_element() < 2e-5,
                        "{value} for {expected}, tile {tile}"
                    );
                }
            }
        }
    }
}

/// Stripes finer than a texel: values of their points or, over a texel, their means.
struct Stripes {
    prefilter: Prefilter,
    per_unit: f32,
}

impl Source for Stripes {
    fn prefilter(&self) -> Prefilter {
        self.prefilter
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let across = point.position_steps.iter().map(|step| step.x.abs()).sum::<f32>();
        let blur = if self.prefilter == Prefilter::Box { (self.per_unit * across).min(1.0) } else { 0.0 };
        let stripe = f32::from(u8::from((point.position.x * self.per_unit).rem_euclid(1.0) < 0.5));
        values[0] = Vec4::splat(stripe * (1.0 - blur) + 0.5 * blur).with_w(1.0);
    }
}

#[test]
fn fits_by_point_and_by_box_are_what_they_are_called_for_all_sources() {
    let mesh = cleaned(generate::grid(2));
    let cover = cover(&mesh, 64, 10_000);
    let at = |fit, prefilter| {
        let texel_side = (mesh.area() / cover.texels() as f64).sqrt();
        let stripes = Stripes { prefilter, per_unit: (2.3 / texel_side) as f32 };
        let baked = baked(&mesh, &cover, &stripes, &float_options(fit));
        flat_texels(&cover, 0, 37)
            .into_iter()
            .map(|(at, _)| texel(&baked.cache, 0, 0, at).x)
            .collect::<Vec<_>>()
    };
    for prefilter in [Prefilter::Point, Prefilter::Box] {
        let points = at(Fit::Point, prefilter);
        assert!(
            points.iter().any(|x| *x < 0.2) && points.iter().any(|x| *x > 0.8),
            "{prefilter:?}: {points:?}"
        );
        let off = at(Fit::Box, prefilter).iter().map(|x| (x - 0.5).abs()).sum::<f32>() / points.len() as f32;
        assert!(off < 0.26, "{prefilter:?}: {off}");
    }
}

fn wave_fidelity(mesh: &Mesh, cover: &Cover, wavelength: f64, fit: Fit) -> Fidelity {
    let texel = (mesh.area() / cover.texels() as f64).sqrt();
    let source = SineSource { k: TAU / (wavelength * texel) as f32 };
    let baked = baked(mesh, cover, &source, &float_options(fit));
    fidelity(&baked.cache, 60_000, 7, &|p| source.value(p))
}

#[test]
fn the_sharp_fit_beats_point_samples_by_decibels() {
    let mut meshes =
        vec![("icosphere", cleaned(generate::icosphere(5))), ("torus", cleaned(generate::torus(96, 48)))];
    if let Some(folder) = data_folder() {
        meshes.push(("bunny", loaded(&folder, "meshes/bunny/stanford_bunny.ply")));
    }
    for (name, mesh) in meshes {
        let cover = cover(&mesh, 128, 1_400_000);
        let [sharp, point] = [Fit::Sharp, Fit::Point].map(|fit| wave_fidelity(&mesh, &cover, 16.0, fit));
        eprintln!("{name}: sharp {:.1} dB, point {:.1} dB", sharp.psnr_db, point.psnr_db);
        assert!(sharp.psnr_db > 55.0, "{name}: {sharp:?}");
        assert!(sharp.psnr_db > point.psnr_db + 6.0, "{name}: {sharp:?} {point:?}");
    }
}

/// The texels of a flat tile that lie on the surface, with their position.
fn flat_texels(cover: &Cover, group: usize, step: usize) -> Vec<([u32; 2], Vec3)> {
    let shape = &cover.groups[group];
    let extent = Vec2::new(shape.extent[0] as f32, shape.extent[1] as f32);
    (0..shape.extent[1])
        .flat_map(|y| (0..shape.extent[0]).map(move |x| [x, y]))
        .filter(|[x, y]| {
            // All of the texels around the borders between blocks, some of the others.
            let near = |c: u32| c % 1024 < 20 || c % 1024 > 1004;
            near(*x) || near(*y) || (x + 7 * y).is_multiple_of(step as u32)
        })
        .map(|[x, y]| {
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) / extent;
            let q = (uv - shape.uv_offset) / shape.uv_scale;
            ([x, y], shape.frame.origin + shape.frame.x_axis * q.x + shape.frame.y_axis() * q.y)
        })
        .collect()
}

fn texel(cache: &PageCache, group: usize, level: u32, [x, y]: [u32; 2]) -> Vec4 {
    Vec4::from_array(cache.tile(0, TileId { group: group as u32, level }).texel(x, y))
}

/// Tiles longer than a block give what direct evaluation gives: no border between blocks, at no level.
#[track_caller]
fn assert_blocks_are_seamless(mesh: &Mesh, texels: u64) -> Vec<[u32; 2]> {
    let cover = cover(mesh, 1 << 16, texels);
    let wave = SineSource { k: 40.0 };
    let value = OfPosition(|p| Vec4::splat(wave.value(p)));
    let point = baked(mesh, &cover, &value, &float_options(Fit::Point)).cache;
    let sharp = baked(mesh, &cover, &value, &float_options(Fit::Sharp)).cache;
    for (group, shape) in cover.groups.iter().enumerate() {
        let inner = |c: [u32; 2], n: [u32; 2]| (0..2).all(|k| c[k] > 0 && c[k] + 1 < n[k]);
        for (at, p) in flat_texels(&cover, group, 101) {
            let expected = wave.value(p);
            assert!((texel(&point, group, 0, at).x - expected).abs() < 1e-4, "{at:?} of {:?}", shape.extent);
            if inner(at, shape.extent) {
                let [x, y] = at;
                let around = [[x - 1, y], [x + 1, y], [x, y - 1], [x, y + 1]];
                let sum: f32 = around.into_iter().map(|n| texel(&point, group, 0, n).x).sum();
                let center = texel(&point, group, 0, at).x;
                let fitted = center - (sum - 4.0 * center) / 12.0;
                assert!(
                    (texel(&sharp, group, 0, at).x - fitted).abs() < 1e-5,
                    "{at:?} of {:?}",
                    shape.extent
                );
            }
        }
        for level in 1..shape.level_count() {
            let (fine, coarse) = (shape.level_extent(level - 1), shape.level_extent(level));
            let mean_of = |x: u32, y: u32| {
                let (mut sum, mut area) = (0.0, 0.0);
                let range = |k: usize, c: u32| {
                    let ratio = f64::from(fine[k]) / f64::from(coarse[k]);
                    (f64::from(c) * ratio, f64::from(c + 1) * ratio)
                };
                let ((x0, x1), (y0, y1)) = (range(0, x), range(1, y));
                let weight = |i: u32, low: f64, high: f64| {
                    (high.min(f64::from(i) + 1.0) - low.max(f64::from(i))).max(0.0)
                };
                for j in y0 as u32..(y1.ceil() as u32).min(fine[1]) {
                    for i in x0 as u32..(x1.ceil() as u32).min(fine[0]) {
                        let w = weight(i, x0, x1) * weight(j, y0, y1);
                        sum += w * f64::from(texel(&point, group, level - 1, [i, j]).x);
                        area += w;
                    }
                }
                sum / area
            };
            let stride = (coarse[0] * coarse[1] / 3000 + 1) as usize;
            let all = (0..coarse[1]).flat_map(|y| (0..coarse[0]).map(move |x| (x, y)));
            for (x, y) in all.step_by(stride) {
                let found = f64::from(texel(&point, group, level, [x, y]).x);
                assert!((found - mean_of(x, y)).abs() < 1e-5, "level {level} of {:?}, {x} {y}", shape.extent);
            }
        }
    }
    cover.groups.iter().map(|g| g.extent).collect()
}

#[test]
fn large_tiles_have_no_borders_between_blocks() {
    let extents = assert_blocks_are_seamless(&rectangle(2.0, 1.1), 3_200_000);
    assert!(extents.len() == 1 && extents[0].into_iter().all(|n| n > 1024), "{extents:?}");
}

#[test]
fn long_tiles_are_cut_along_their_length_only() {
    for (height, texels) in [(0.1, 600_000), (0.4, 2_000_000)] {
        let extents = assert_blocks_are_seamless(&rectangle(1.0, height), texels);
        let [longer, shorter] =
            [extents[0].into_iter().max().unwrap(), extents[0].into_iter().min().unwrap()];
        assert!(extents.len() == 1 && longer > 2048 && shorter <= 1024, "{extents:?}");
    }
}

/// A large tile with holes and slopes in it: constants and waves through the texture function.
#[test]
fn a_coarse_cube_under_a_large_texture() {
    let mesh = cleaned(generate::cube(1));
    let cover = cover(&mesh, 0, 16 << 20);
    assert!(
        cover.groups.iter().any(|g| g.extent.into_iter().all(|n| n > 1024)),
        "{:?}",
        cover.groups[0].extent
    );
    assert_constant("cube", &mesh, &cover, 60);
}
