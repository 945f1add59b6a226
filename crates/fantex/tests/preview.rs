//! Previews look like what they stand for, are read alone, and survive edits; assets are a source for other meshes.

#![cfg(feature = "paint")]
#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use fantex::mesh::generate::icosphere;
use fantex::mesh::{AlphaMode, Material, WriteGeometry, write_model};
use fantex::paint::{ChannelPaint, FillArea, Paint, PaintColor, PaintOptions, Painter, Tool};
use fantex::render::{FanSurface, FilterOptions, Lights, RenderOptions, Shading, render};
use fantex::scene::Camera;
use fantex::store::{
    AssetEditor, AssetHead, ByteSource, ChannelKind, EditOptions, FileSource, PREVIEW, PageCache, PageId,
    VerifyOptions, group_pages, verify_asset,
};
use fantex::stream::read::first_ranges;
use fantex::texture::compare::psnr_db;
use fantex::{Asset, Baker, LongestEdge, Mesh, Preview, PreviewOptions, Source};
use glam::{DVec3, Vec3, Vec4};

const OPTIONS: PreviewOptions = PreviewOptions {
    triangles: 3000,
    texels: Some(60_000),
    keeps_borders: false,
    memory_bytes: 256 << 20,
    strict: false,
};

/// A ball with bumps, 81 920 triangles.
fn bumpy_ball() -> Mesh {
    let mut model = icosphere(6);
    for p in &mut model.positions {
        *p *= 1.0 + 0.08 * (p.x * 5.0).sin() * (p.y * 4.0).cos() + 0.04 * (p.z * 9.0).sin();
    }
    model.materials = vec![Material::default()];
    Mesh::from_model(model, "ball.ply").unwrap()
}

/// Smooth bands of colour.
fn color(p: Vec3) -> Vec4 {
    let wave = |x: f32| 0.5 + 0.4 * (6.0 * x).sin();
    Vec4::new(wave(p.x + p.y), wave(p.y - p.z), wave(p.z), 1.0)
}

fn baked(folder: &Path) -> PathBuf {
    let path = folder.join("ball.fan");
    let source = Source::function(|point| color(point.position));
    Baker::new(&bumpy_ball()).texels(500_000).source(source).write(&path).unwrap();
    path
}

fn picture(asset: &Arc<fantex::store::Asset>, camera: &Camera, shading: Shading) -> fantex::texture::Image {
    let cache = PageCache::new(Arc::clone(asset), 64 << 20);
    let surface = FanSurface::of_asset(&cache, FilterOptions::default());
    let options = RenderOptions { width: 320, height: 240, samples: 4, shading, ..RenderOptions::default() };
    let picture = render(asset.mesh(), &surface, camera, &Lights::default(), &options).unwrap().picture;
    picture.to_srgb_image()
}

/// Counts what is read.
#[derive(Debug)]
struct Counted(FileSource, AtomicU64);

impl ByteSource for Counted {
    fn location(&self) -> &Path {
        self.0.location()
    }

    fn length(&self) -> io::Result<u64> {
        self.0.length()
    }

    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        self.1.fetch_add(bytes.len() as u64, Relaxed);
        self.0.read_at(bytes, offset)
    }
}

#[test]
fn a_preview_looks_like_the_asset_and_is_read_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = baked(folder.path());
    let asset = Arc::clone(Asset::open(&path).unwrap().shared());
    let preview = Preview::add_to(&path, &OPTIONS).unwrap();
    assert!(preview.triangles <= 3000 && preview.triangles > 2500, "{}", preview.triangles);
    assert!(preview.texels <= 60_000, "{}", preview.texels);
    let bytes = preview.bytes.len() as u64;

    let counted = Counted(FileSource::open(&path).unwrap(), AtomicU64::new(0));
    let small = Arc::new(fantex::store::Asset::open_preview(&counted).unwrap().unwrap());
    let read = counted.1.into_inner();
    assert!(read < bytes + 16_384, "{read} bytes read, {bytes} of them the preview");
    assert!(read * 2 < asset.head_bytes(), "{read} of {}", asset.head_bytes());
    // Pages fetch the first bytes, the list of attachments and the preview.
    let ranges = first_ranges(&FileSource::open(&path).unwrap()).unwrap();
    let sizes: Vec<u64> = ranges.iter().map(|range| range.end - range.start).collect();
    let is_preview = |size: u64| size > bytes / 2 && size < bytes + 16_384;
    assert!(sizes.len() == 3 && is_preview(sizes[2]), "{sizes:?}, a preview of {bytes}");
    let head = AssetHead::read(&FileSource::open(&path).unwrap()).unwrap();
    assert!(head.has_attachments && head.channels == asset.channels());
    assert!(verify_asset(&small, &VerifyOptions::default()).ok);
    let camera = &Camera::orbit(asset.mesh(), 1, 4.0 / 3.0)[0];
    for (shading, least) in [(Shading::BaseColor, 34.0), (Shading::BlinnPhong, 32.0)] {
        let [shown, expected] = [&small, &asset].map(|asset| picture(asset, camera, shading));
        let decibels = psnr_db(&expected, &shown).unwrap();
        println!("{shading:?}: {decibels:.1} dB");
        assert!(decibels > least, "{shading:?}: {decibels} dB");
    }

    // It is the same when it is made again, stays through edits, and can be taken out.
    assert_eq!(Preview::of(&asset, &OPTIONS).unwrap().bytes, {
        let mut bytes = vec![0; small.source().length().unwrap() as usize];
        small.source().read_exact_at(&mut bytes, 0).unwrap();
        bytes
    });
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    let page = PageId { group: 0, level: 0, page: [0, 0] };
    let texels = editor.read_page_raw(0, page).unwrap();
    editor.replace(page, 0, texels.iter().rev().copied().collect()).unwrap();
    editor.commit().unwrap();
    drop(editor);
    assert!(Asset::open(&path).unwrap().attachment(PREVIEW).unwrap().is_some());
    assert!(Preview::remove_from(&path).unwrap());
    assert!(!Preview::remove_from(&path).unwrap());
    let source = FileSource::open(&path).unwrap();
    assert!(fantex::store::Asset::open_preview(&source).unwrap().is_none());
}

#[test]
fn a_damaged_preview_keeps_nobody_from_the_asset() {
    let folder = tempfile::tempdir().unwrap();
    let path = baked(folder.path());
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    editor.attach(PREVIEW, b"no asset".to_vec()).unwrap();
    editor.commit().unwrap();
    drop(editor);
    let source = FileSource::open(&path).unwrap();
    let error = fantex::store::Asset::open_preview(&source).unwrap_err().to_string();
    assert!(error.contains("the preview of") && error.contains("ball.fan"), "{error}");
    Asset::open(&path).unwrap();
}

/// The preview of an asset, with the bytes of its pages in each channel.
fn preview_pages(path: &Path) -> Option<Vec<(ChannelKind, Vec<Vec<u8>>)>> {
    let preview =
        fantex::store::Asset::open_preview(&FileSource::open(path).unwrap()).unwrap().map(Arc::new)?;
    assert!(verify_asset(&preview, &VerifyOptions::default()).ok);
    let pages = |channel: usize| -> Vec<Vec<u8>> {
        let groups = (0u32..).zip(&preview.cover().groups);
        let ids = groups.flat_map(|(index, group)| group_pages(index, group));
        ids.map(|id| preview.read_page_raw(channel, id).unwrap()).collect()
    };
    let channels = preview.channels().iter().enumerate();
    Some(channels.map(|(index, channel)| (channel.kind, pages(index))).collect())
}

/// What is removed from an asset is removed from its preview, at once; all else stays, byte for byte.
#[test]
fn previews_lose_the_channels_that_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let path = baked(folder.path());
    let open = || Painter::open(&path, &PaintOptions::default()).unwrap();
    let added = [ChannelKind::Emission, ChannelKind::Displacement, ChannelKind::Normal];
    open().add_channels(&added[..2]).unwrap();
    let options = PreviewOptions { triangles: 1000, texels: Some(20_000), ..OPTIONS };
    Preview::add_to(&path, &options).unwrap();
    let mut painter = open();
    painter.add_channels(&added[2..]).unwrap();
    drop(painter);
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    editor.attach("note", b"kept".to_vec()).unwrap();
    editor.commit().unwrap();
    drop(editor);
    let before = preview_pages(&path).unwrap();
    let kinds: Vec<ChannelKind> = before.iter().map(|(kind, _)| *kind).collect();
    assert!(added.iter().chain(&[ChannelKind::BaseColor]).all(|kind| kinds.contains(kind)), "{kinds:?}");
    let mut left = before;
    for removed in [&added[..1], &added[1..], &[ChannelKind::BaseColor]] {
        if removed.contains(&ChannelKind::BaseColor) {
            // The preview is older than this channel, and has none of it.
            open().add_channels(&[ChannelKind::OcclusionRoughnessMetallic]).unwrap();
        }
        open().remove_channels(removed).unwrap();
        left.retain(|(kind, _)| !removed.contains(kind));
        let found = preview_pages(&path);
        assert_eq!(found.is_none(), left.is_empty(), "{removed:?}");
        assert!(found.unwrap_or_default() == left, "{removed:?}");
        let asset = fantex::store::Asset::open(&path).unwrap();
        assert_eq!(asset.attachment("note").unwrap().unwrap(), b"kept");
        assert!(asset.channels().iter().all(|channel| !removed.contains(&channel.kind)));
    }
    assert!(left.is_empty());
}

#[test]
fn previews_without_the_channel_stay_and_so_do_damaged_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = baked(folder.path());
    Preview::add_to(&path, &PreviewOptions { triangles: 1000, texels: Some(20_000), ..OPTIONS }).unwrap();
    let preview = || fantex::store::Asset::open(&path).unwrap().attachment(PREVIEW).unwrap().unwrap();
    let before = preview();
    let change = || {
        let mut painter = Painter::open(&path, &PaintOptions::default()).unwrap();
        painter.add_channels(&[ChannelKind::Emission]).unwrap();
        painter.remove_channels(&[ChannelKind::Emission]).unwrap();
    };
    change();
    assert!(preview() == before);
    let mut editor = AssetEditor::open(&path, &EditOptions::default()).unwrap();
    editor.attach(PREVIEW, b"no asset".to_vec()).unwrap();
    editor.commit().unwrap();
    drop(editor);
    change();
    assert_eq!(preview(), b"no asset");
}

/// The preview of the asset at a path, as it is now.
fn preview_of(path: &Path) -> fantex::store::Asset {
    fantex::store::Asset::open_preview(&FileSource::open(path).unwrap()).unwrap().unwrap()
}

/// Seen from afar, through its preview, a cut-out is a cut-out.
#[test]
fn previews_take_alpha_as_the_asset_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = baked(folder.path());
    Preview::add_to(&path, &PreviewOptions { triangles: 1000, texels: Some(20_000), ..OPTIONS }).unwrap();
    let before = preview_pages(&path).unwrap();
    for alpha in [AlphaMode::Mask(0.5), AlphaMode::Blend, AlphaMode::Opaque] {
        Painter::open(&path, &PaintOptions::default()).unwrap().set_alpha_mode(alpha).unwrap();
        for asset in [preview_of(&path), fantex::store::Asset::open(&path).unwrap()] {
            let materials = &asset.mesh().materials;
            assert!(!materials.is_empty() && materials.iter().all(|material| material.alpha == alpha));
        }
        assert!(preview_pages(&path).unwrap() == before, "{alpha:?}");
    }
}

/// Replaces the preview by one that opens, but has texels that cannot be read.
fn damage_preview(path: &Path) {
    let bytes = fantex::store::Asset::open(path).unwrap().attachment(PREVIEW).unwrap().unwrap();
    let copy = path.with_file_name("damaged.fan");
    let damaged = (0..bytes.len()).rev().step_by(101).find_map(|at| {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0xff;
        std::fs::write(&copy, &damaged).unwrap();
        let asset = Arc::new(fantex::store::Asset::open(&copy).ok()?);
        (!verify_asset(&asset, &VerifyOptions::default()).ok).then_some(damaged)
    });
    let mut editor = AssetEditor::open(path, &EditOptions::default()).unwrap();
    editor.attach(PREVIEW, damaged.unwrap()).unwrap();
    editor.commit().unwrap();
}

/// The error names the asset, which stays as it is: channels, levels and history.
#[test]
fn a_preview_that_cannot_be_changed_keeps_the_asset_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = baked(folder.path());
    let open = || Painter::open(&path, &PaintOptions::default()).unwrap();
    let pages = |painter: &Painter| -> Vec<Vec<u8>> {
        let editor = painter.editor();
        let groups = (0u32..).zip(&editor.asset().cover().groups);
        let ids = groups.flat_map(|(index, group)| group_pages(index, group));
        ids.map(|id| editor.read_page_raw(0, id).unwrap()).collect()
    };
    let mut painter = open();
    painter.add_channels(&[ChannelKind::Emission]).unwrap();
    let channels = vec![ChannelPaint::new(0, PaintColor::Constant(Vec4::ONE))];
    let tool = Tool::Opacity { to: 0.0 };
    painter.begin("holes", Paint { tool, opacity: 1.0, channels, stencil: None, sight: None }).unwrap();
    let triangles = painter.surface().mesh().triangles.len() as u32;
    painter.fill(FillArea::Triangles((0..triangles).step_by(2).collect())).unwrap();
    painter.commit().unwrap();
    drop(painter);
    Preview::add_to(&path, &PreviewOptions { triangles: 1000, texels: Some(20_000), ..OPTIONS }).unwrap();
    damage_preview(&path);
    let mut painter = open();
    let before = pages(&painter);
    let error = painter.remove_channels(&[ChannelKind::Emission]).unwrap_err();
    let sentence = error.to_string();
    assert!(sentence.contains("the preview of") && sentence.contains("ball.fan"), "{sentence}");
    assert_eq!(error.path(), Some(path.as_path()));
    drop(painter);
    let mut painter = open();
    assert!(pages(&painter) == before);
    assert_eq!(painter.history().done().len(), 1);
    let asset = painter.editor().asset();
    assert!(asset.channel_of_kind(ChannelKind::Emission).is_some());
    // What copies its texels as they are goes well, and without it all does.
    painter.set_alpha_mode(AlphaMode::Mask(0.5)).unwrap();
    assert_eq!(painter.history().done().len(), 2);
    drop(painter);
    assert!(Preview::remove_from(&path).unwrap());
    painter = open();
    painter.remove_channels(&[ChannelKind::Emission]).unwrap();
    assert!(painter.editor().asset().channel_of_kind(ChannelKind::Emission).is_none());
    assert!(pages(&painter) != before);
}

/// What jumps there would be smeared otherwise.
#[test]
fn the_mesh_of_an_asset_keeps_its_hard_edges() {
    let folder = tempfile::tempdir().unwrap();
    let [path, again] = ["a.fan", "b.fan"].map(|name| folder.path().join(name));
    let positions = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    let mesh = Mesh::from_triangles(&positions, &[[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]).unwrap();
    let solid = || Source::solid("marble");
    Baker::new(&mesh).texels(5000).source(solid()).hard_edges(60.0).write(&path).unwrap();
    let mesh = Mesh::open(&path).unwrap();
    for (source, asked, expected) in [(Source::mesh(&path), None, 60.0), (solid(), Some(150.0), 150.0)] {
        let baker = Baker::new(&mesh).texels(9000).source(source).overwrite(true);
        asked.into_iter().fold(baker, Baker::hard_edges).write(&again).unwrap();
        assert_eq!(Asset::open(&again).unwrap().cover().hard_edges, Some(expected));
    }
}

#[test]
fn an_asset_is_a_source_for_another_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let fine = baked(folder.path());
    let coarse = bumpy_ball().simplified(4000).unwrap();
    let positions: Vec<DVec3> = coarse.positions.iter().map(|&p| coarse.world_from_mesh.point(p)).collect();
    let geometry = WriteGeometry { positions: &positions, triangles: &coarse.triangles, colors: None };
    let model = folder.path().join("coarse.ply");
    write_model(&model, &geometry, false).unwrap();
    let path = folder.path().join("coarse.fan");
    let mesh = Mesh::load(&model).unwrap();
    let baker = Baker::new(&mesh).texels(300_000).longest_edge(LongestEdge::Texels(0));
    baker.source(Source::mesh(&fine)).write(&path).unwrap();
    let [coarse, fine] = [&path, &fine].map(|path| Asset::open(path).unwrap());
    assert!(coarse.channel_of_kind(ChannelKind::Normal).is_some());
    let camera = &Camera::orbit(fine.mesh(), 1, 4.0 / 3.0)[0];
    for (shading, least) in [(Shading::BaseColor, 36.0), (Shading::BlinnPhong, 34.0)] {
        let [shown, expected] = [&coarse, &fine].map(|asset| picture(asset.shared(), camera, shading));
        let decibels = psnr_db(&expected, &shown).unwrap();
        println!("{shading:?}: {decibels:.1} dB");
        assert!(decibels > least, "{shading:?}: {decibels} dB");
    }
}
