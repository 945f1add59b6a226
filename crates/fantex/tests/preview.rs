//! Previews look like what they stand for, are read alone, and survive edits; assets are a source for other meshes.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use fantex::mesh::generate::icosphere;
use fantex::mesh::{Material, WriteGeometry, write_model};
use fantex::render::{FanSurface, FilterOptions, Lights, RenderOptions, Shading, render};
use fantex::scene::Camera;
use fantex::store::{
    AssetEditor, ByteSource, ChannelKind, EditOptions, FileSource, PREVIEW, PageCache, PageId, VerifyOptions,
    verify_asset,
};
use fantex::texture::compare::psnr_db;
use fantex::{Asset, Baker, LongestEdge, Mesh, Preview, PreviewOptions, Source};
use glam::{DVec3, Vec3, Vec4};

const OPTIONS: PreviewOptions =
    PreviewOptions { triangles: 3000, texels: 60_000, keeps_borders: false, memory_bytes: 256 << 20 };

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
