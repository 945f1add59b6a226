//! Verification compares detail levels: whatever was baked passes, and texels that were changed afterwards do not.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use fantex_bake::{BakeFormat, BakeOptions, Fit, LookSource, Prefilter, Source, SourceChannel, TexelPoint};
use fantex_base::Random;
use fantex_cover::Cover;
use fantex_mesh::{AlphaMode, Material, Mesh, generate};
use fantex_store::{
    Asset, AssetEditor, ChannelKind, EditOptions, PAGE, PageId, Quality, TexelFormat, TexelReport,
    TexelSlice, VerifyOptions, VerifyReport, encode, group_pages, verify, verify_asset,
};
use fantex_test::bottle;
use glam::{Vec2, Vec3, Vec4};

use crate::common::{
    Baked, OfPosition, baked, barycentric_points, cleaned, cover, data_folder, loaded, needles, rectangle,
};

/// What is hard to tell from damage.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Show {
    /// Every texel has values of its own.
    Noise,
    /// One texel of 40 is bright.
    Dots,
    /// Every triangle has a colour of its own, so that edges run along the outlines of tiles.
    Triangles,
    /// Edges of light that 8 bits cannot hold.
    Glare,
}

const SHOWS: [Show; 4] = [Show::Noise, Show::Dots, Show::Triangles, Show::Glare];

struct Hard {
    show: Show,
    prefilter: Prefilter,
    has_alpha: bool,
    has_shares: bool,
}

impl Hard {
    fn of(show: Show) -> Self {
        Self { show, prefilter: Prefilter::Box, has_alpha: false, has_shares: false }
    }

    fn random(&self, point: &TexelPoint) -> Random {
        let triangle = u64::from(point.at.triangle);
        match self.show {
            Show::Triangles | Show::Glare => Random::of_seeds([triangle]),
            Show::Noise | Show::Dots => {
                Random::of_seeds(point.position.to_array().map(|x| u64::from(x.to_bits())))
            }
        }
    }
}

impl Source for Hard {
    fn channels(&self) -> Vec<SourceChannel> {
        let plain = SourceChannel::new;
        vec![
            SourceChannel { has_alpha: self.has_alpha, ..plain(ChannelKind::BaseColor) },
            plain(ChannelKind::Normal),
            plain(ChannelKind::OcclusionRoughnessMetallic),
            plain(ChannelKind::Displacement),
        ]
    }

    fn prefilter(&self) -> Prefilter {
        self.prefilter
    }

    fn has_shares(&self) -> bool {
        self.has_shares
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let mut random = self.random(point);
        let is_bright = random.below(40) == 0;
        let mut number = || match self.show {
            Show::Dots if is_bright => 1.0,
            Show::Dots => 0.05,
            Show::Glare => (3.0 * random.unit()) as f32,
            Show::Noise | Show::Triangles => random.unit() as f32,
        };
        let color = Vec3::new(number(), number(), number());
        values[0] = color.extend(number().min(1.0));
        let bent = Vec3::new(number(), number(), number()).min(Vec3::ONE) - 0.5;
        values[1] = (point.normal + bent).normalize_or(point.normal).extend(0.0);
        values[2] = Vec3::new(number(), number(), number()).min(Vec3::ONE).extend(1.0);
        values[3] = Vec4::splat(number().min(1.0));
    }
}

fn with_texels(path: &Path) -> VerifyReport {
    verify(path, &VerifyOptions { texels: true, ..VerifyOptions::default() }).unwrap()
}

fn texels_of(report: &VerifyReport) -> &TexelReport {
    report.texels.as_ref().unwrap()
}

#[track_caller]
fn assert_passes(what: &str, baked: &Baked) {
    let report = with_texels(&baked.path);
    assert!(report.ok, "{what}: {report:?}");
}

fn options(format: BakeFormat, fit: Fit) -> BakeOptions {
    BakeOptions { format, fit, ..BakeOptions::default() }
}

const FORMATS: [BakeFormat; 4] = [BakeFormat::Rgba8, BakeFormat::Bc7, BakeFormat::Bc1, BakeFormat::Float];
const FITS: [Fit; 3] = [Fit::Sharp, Fit::Point, Fit::Box];

#[test]
fn whatever_is_baked_passes() {
    let mut meshes = vec![
        ("cube", cleaned(generate::cube(2))),
        ("icosphere", cleaned(generate::icosphere(3))),
        ("torus", cleaned(generate::torus(16, 9))),
        ("book", cleaned(generate::book(5))),
        ("rectangle", rectangle(1.3, 1.0)),
        ("needles", needles(1e-4)),
    ];
    if let Some(folder) = data_folder() {
        meshes.push(("suzanne", loaded(&folder, "meshes/suzanne.ply")));
        meshes.push(("soup", loaded(&folder, "meshes/broken/soup.stl")));
        meshes.push(("tetrahedra", loaded(&folder, "meshes/broken/joined_tetrahedra.obj")));
    }
    let mut number = 0;
    for (name, mesh) in &meshes {
        for tile in [0, 64] {
            let cover = cover(mesh, tile, 20_000);
            for show in SHOWS {
                number += 1;
                let prefilter = if number % 2 == 0 { Prefilter::Point } else { Prefilter::Box };
                let source = Hard { prefilter, ..Hard::of(show) };
                for (format, fit) in
                    [(BakeFormat::Rgba8, Fit::Sharp), (FORMATS[number % 4], FITS[number % 3])]
                {
                    let baked = baked(mesh, &cover, &source, &options(format, fit));
                    assert_passes(&format!("{name}, {tile}, {show:?}, {format:?}, {fit:?}"), &baked);
                }
            }
        }
    }
}

/// Blocks of several colours have texels that the encoder gives up: of many such tiles all pass.
#[test]
fn patchworks_pass_in_compressed_blocks() {
    let mesh = cleaned(generate::torus(24, 12));
    for texels in (40_000..72_000).step_by(2_000) {
        let cover = cover(&mesh, 1024, texels);
        let baked = baked(&mesh, &cover, &Hard::of(Show::Triangles), &options(BakeFormat::Bc7, Fit::Sharp));
        assert_passes(&format!("{texels}"), &baked);
    }
}

/// Alpha that is scaled, and alpha that colours count by.
#[test]
fn cut_outs_and_transparency_pass() {
    for alpha in [AlphaMode::Mask(0.5), AlphaMode::Mask(0.3), AlphaMode::Blend, AlphaMode::Opaque] {
        for mut mesh in [cleaned(generate::icosphere(2)), cleaned(generate::grid(5))] {
            mesh.materials = vec![Material { alpha, ..Material::default() }];
            mesh.triangle_materials = vec![0; mesh.triangles.len()];
            let cover = cover(&mesh, 64, 20_000);
            for (show, has_shares) in SHOWS.into_iter().zip([true, false, true, false]) {
                let source = Hard { has_alpha: true, has_shares, ..Hard::of(show) };
                for format in FORMATS {
                    let baked = baked(&mesh, &cover, &source, &options(format, Fit::Sharp));
                    assert_passes(&format!("{alpha:?}, {show:?}, {format:?}"), &baked);
                }
            }
        }
    }
}

#[test]
fn tiles_of_many_blocks_and_pages_pass() {
    let mesh = rectangle(2.0, 1.1);
    let cover = cover(&mesh, 1 << 16, 3_200_000);
    for (show, format) in [(Show::Triangles, BakeFormat::Rgba8), (Show::Glare, BakeFormat::Bc7)] {
        let baked = baked(&mesh, &cover, &Hard::of(show), &options(format, Fit::Sharp));
        let asset = baked.cache.asset();
        assert!(asset.cover().groups.iter().any(|group| group.extent.iter().all(|&n| n > 1024)));
        assert_passes(&format!("{show:?}"), &baked);
    }
}

#[test]
fn models_pass() {
    let bottle = bottle();
    let source = LookSource::of_model(&bottle).unwrap();
    let bottle_cover = cover(&bottle, 256, 150_000);
    for format in [BakeFormat::Bc7, BakeFormat::Rgba8] {
        let baked = baked(&bottle, &bottle_cover, &source, &options(format, Fit::Sharp));
        assert_passes(&format!("bottle, {format:?}"), &baked);
    }
    let Some(folder) = data_folder() else { return };
    for name in [
        "meshes/bunny/stanford_bunny.ply",
        "meshes/broken/chair_model.obj",
        "meshes/mengerSponge3.glb",
        "meshes/broken/wallhole.obj",
        "meshes/teapot.stl",
    ] {
        let mesh = loaded(&folder, name);
        for (tile, show) in [(0, Show::Noise), (64, Show::Triangles), (256, Show::Noise)] {
            let cover = cover(&mesh, tile, 120_000);
            let format = if tile == 64 { BakeFormat::Bc7 } else { BakeFormat::Rgba8 };
            let baked = baked(&mesh, &cover, &Hard::of(show), &options(format, Fit::Sharp));
            assert_passes(&format!("{name}, {tile}"), &baked);
        }
    }
}

// What was changed after the bake.

/// Even, neither dark nor bright.
fn even(p: Vec3) -> Vec4 {
    Vec3::splat(0.6 + 0.05 * (3.0 * p.x).sin()).extend(1.0)
}

fn even_ball(format: BakeFormat) -> (Mesh, Baked) {
    let mesh = cleaned(generate::icosphere(2));
    let cover = cover(&mesh, 64, 60_000);
    let baked = baked(&mesh, &cover, &OfPosition(even), &options(format, Fit::Sharp));
    (mesh, baked)
}

/// Group, and column and row at a level.
type Place = (u32, [u32; 2]);

/// Texels of a level that lie beside the regions of all tiles, and to which a look-up gives so much weight.
fn beside_the_outlines(mesh: &Mesh, cover: &Cover, level: u32, weight: f32) -> Vec<Place> {
    let (mut weights, mut inside) = (BTreeMap::<Place, f32>::new(), BTreeSet::<Place>::new());
    for triangle in 0..mesh.triangles.len() as u32 {
        let tiles = cover.triangle_tiles(mesh, triangle);
        for lambda in barycentric_points(40) {
            for tap in tiles.taps(lambda) {
                let group = &cover.groups[tap.group as usize];
                if level >= group.level_count() {
                    continue;
                }
                let extent = group.level_extent(level);
                let texels = Vec2::new(extent[0] as f32, extent[1] as f32);
                let at = tap.uv * texels;
                let held = at.clamp(Vec2::ZERO, texels - 1.0).as_uvec2();
                inside.insert((tap.group, [held.x, held.y]));
                let at = (at - 0.5).clamp(Vec2::ZERO, texels - 1.0);
                let (first, share) = (at.floor().as_uvec2(), at.fract());
                for [x, y] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
                    let place = [(first.x + x).min(extent[0] - 1), (first.y + y).min(extent[1] - 1)];
                    let along = if x == 0 { 1.0 - share.x } else { share.x };
                    let across = if y == 0 { 1.0 - share.y } else { share.y };
                    let most = weights.entry((tap.group, place)).or_default();
                    *most = most.max(along * across);
                }
            }
        }
    }
    let beside = weights.into_iter().filter(|(place, most)| *most >= weight && !inside.contains(place));
    beside.map(|(place, _)| place).collect()
}

/// A copy of an asset with a page of its first channel changed.
fn changed(baked: &Baked, id: PageId, change: impl FnOnce(&Asset, &mut [u8])) -> VerifyReport {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changed.fan");
    std::fs::copy(&baked.path, &path).unwrap();
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    let asset = Arc::clone(editor.asset());
    let mut page = editor.read_page_raw(0, id).unwrap();
    change(&asset, &mut page);
    editor.replace(id, 0, page).unwrap();
    editor.commit().unwrap();
    drop((editor, asset));
    with_texels(&path)
}

/// The page of a texel, and the texel within it.
fn page_of((group, [x, y]): Place, level: u32) -> (PageId, [u32; 2]) {
    (PageId { group, level, page: [x / PAGE, y / PAGE] }, [x % PAGE, y % PAGE])
}

/// A black texel beside the surface, where look-ups read it, is found at every level, and named.
#[test]
fn black_texels_beside_the_surface_are_found() {
    let (mesh, baked) = even_ball(BakeFormat::Rgba8);
    let cover = baked.cache.asset().cover();
    assert_passes("as baked", &baked);
    for level in 0..4 {
        let places = beside_the_outlines(&mesh, cover, level, 0.3);
        let (mut found, mut all) = (0, 0);
        for &place in places.iter().step_by((places.len() / 24).max(1)) {
            let (id, [x, y]) = page_of(place, level);
            let report = changed(&baked, id, |asset, page| {
                let columns = asset.page_extent(0, id).unwrap()[0];
                let first = 4 * (y * columns + x) as usize;
                page[first..first + 4].copy_from_slice(&[0, 0, 0, 255]);
            });
            all += 1;
            let texels = texels_of(&report);
            assert!(report.continuity.largest_jump < 1e-4, "edges say nothing of it");
            assert_eq!(report.ok, texels.is_sound());
            if texels.contradictions > 0 {
                found += 1;
                let sentence = &texels.first[0];
                assert!(sentence.starts_with(&format!("base colour of tile {}: ", place.0)), "{sentence}");
                assert!(sentence.contains(&format!(" at level {level}")), "{sentence}");
            }
        }
        assert!(all >= 8, "level {level}: {all} of {} places", places.len());
        // Where fewer are, texels that are not stored leave more open.
        assert!(4 * found >= 3 * all, "level {level}: {found} of {all}");
    }
}

/// Whole blocks are found in compressed channels, too.
#[test]
fn black_blocks_are_found_in_all_formats() {
    for format in [BakeFormat::Rgba8, BakeFormat::Bc7, BakeFormat::Bc1] {
        let (mesh, baked) = even_ball(format);
        let asset = baked.cache.asset();
        assert_passes("as baked", &baked);
        let stored = asset.channels()[0].format;
        let black =
            encode(stored, Quality::UltraFast, [4, 4], TexelSlice::U8(&[[0, 0, 0, 255]; 16])).unwrap();
        let places = beside_the_outlines(&mesh, asset.cover(), 0, 0.3);
        let (mut found, mut all) = (0, 0);
        for &place in places.iter().step_by((places.len() / 24).max(1)) {
            let (id, texel) = page_of(place, 0);
            let report = changed(&baked, id, |asset, page| {
                let columns = asset.page_extent(0, id).unwrap()[0];
                let ranges = stored.block_ranges(columns, texel.map(|n| n / 4 * 4));
                let rows = stored.block_ranges(4, [0, 0]);
                ranges.zip(rows).for_each(|(to, from)| page[to].copy_from_slice(&black[from]));
            });
            all += 1;
            found += usize::from(!report.ok && texels_of(&report).contradictions > 0);
        }
        assert!(4 * found >= 3 * all, "{format:?}: {found} of {all}");
    }
}

/// A block that is read and was forgotten: zero bytes.
#[test]
fn blocks_that_are_read_hold_something() {
    let (mesh, baked) = even_ball(BakeFormat::Bc7);
    let cover = baked.cache.asset().cover();
    for level in 0..3 {
        let places = beside_the_outlines(&mesh, cover, level, 0.05);
        for &place in places.iter().step_by((places.len() / 8).max(1)) {
            let (id, texel) = page_of(place, level);
            let report = changed(&baked, id, |asset, page| {
                let columns = asset.page_extent(0, id).unwrap()[0];
                let ranges = TexelFormat::Bc7.block_ranges(columns, texel.map(|n| n / 4 * 4));
                ranges.for_each(|range| page[range].fill(0));
            });
            let texels = texels_of(&report);
            assert!(!report.ok && texels.empty_blocks == 1, "{place:?}: {texels:?}");
            let is_named = |sentence: &String| {
                sentence.starts_with(&format!("base colour of tile {}: the block from texel ", place.0))
                    && sentence.ends_with(&format!(" on at level {level} is read and holds nothing"))
            };
            assert!(texels.first.iter().any(is_named), "{texels:?}");
        }
    }
}

/// Blocks that nobody reads may hold anything.
#[test]
fn blocks_that_are_not_read_may_hold_anything() {
    for format in [BakeFormat::Bc7, BakeFormat::Bc1, BakeFormat::Rgba8] {
        let (_, baked) = even_ball(format);
        let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
        let asset = Arc::clone(editor.asset());
        let stored = asset.channels()[0].format;
        let white = encode(stored, Quality::UltraFast, [4, 4], TexelSlice::U8(&[[250, 0, 250, 255]; 16]));
        let white = white.unwrap();
        let mut count = 0;
        for id in (0..).zip(&asset.cover().groups).flat_map(|(number, group)| group_pages(number, group)) {
            let mut page = editor.read_page_raw(0, id).unwrap();
            let [columns, rows] = asset.page_extent(0, id).unwrap();
            let blocks = (0..rows).step_by(4).flat_map(|y| (0..columns).step_by(4).map(move |x| [x, y]));
            for block in blocks {
                let ranges = || stored.block_ranges(columns, block);
                // Nothing that is read is black.
                let is_unread = match stored.is_compressed() {
                    true => ranges().all(|range| page[range].iter().all(|&byte| byte == 0)),
                    false => ranges().all(|range| page[range].chunks(4).all(|texel| texel[..3] == [0; 3])),
                };
                if is_unread {
                    count += 1;
                    let rows = stored.block_ranges(4, [0, 0]);
                    ranges().zip(rows).for_each(|(to, from)| page[to].copy_from_slice(&white[from]));
                }
            }
            editor.replace(id, 0, page).unwrap();
        }
        editor.commit().unwrap();
        drop((editor, asset));
        assert!(count > 50, "{count}");
        assert_passes(&format!("{format:?}"), &baked);
    }
}

/// The report is the same on any number of threads and in any memory.
#[test]
fn reports_do_not_depend_on_threads() {
    let mesh = cleaned(generate::icosphere(3));
    let baked = baked(&mesh, &cover(&mesh, 64, 60_000), &Hard::of(Show::Noise), &BakeOptions::default());
    // One level is white.
    let asset = baked.cache.asset();
    let mut editor = AssetEditor::open(&baked.path, &EditOptions::default()).unwrap();
    for (group, _) in (0..).zip(&asset.cover().groups).filter(|(_, shape)| shape.level_count() > 1) {
        let id = PageId { group, level: 1, page: [0, 0] };
        let page = editor.read_page_raw(2, id).unwrap();
        let block = encode(
            asset.channels()[2].format,
            Quality::UltraFast,
            [4, 4],
            TexelSlice::U8(&[[255, 255, 255, 255]; 16]),
        )
        .unwrap();
        editor.replace(id, 2, block.repeat(page.len() / block.len())).unwrap();
    }
    editor.commit().unwrap();
    drop(editor);
    let reports = [(1, 1 << 20), (2, 1 << 22), (4, 1 << 28)].map(|(threads, memory_bytes)| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let asset = Arc::new(Asset::open(&baked.path).unwrap());
        pool.install(|| verify_asset(&asset, &VerifyOptions { memory_bytes, texels: true }))
    });
    assert!(reports[0] == reports[1] && reports[0] == reports[2]);
    let texels = texels_of(&reports[0]);
    assert!(!reports[0].ok && texels.contradictions > 100 && texels.first.len() == 16, "{texels:?}");
}
