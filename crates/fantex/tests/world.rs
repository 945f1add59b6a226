//! Worlds on the GPU: what is near is whole, what is far is its preview, and both look like what they stand for.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex::base::ErrorKind;
use fantex::gpu::{
    self, DrawOptions, Frame, Gpu, GpuOptions, Model as _, StreamedModel, render_to_picture, stream_view,
};
use fantex::mesh::generate::{LandscapeOptions, icosphere, landscape};
use fantex::mesh::{Material, Model};
use fantex::scene::{Background, Camera, FilterOptions, Lights, Shading, world_bounds};
use fantex::stream::FrameOptions;
use fantex::texture::compare::psnr_db;
use fantex::texture::{Image, Samples};
use fantex::{
    Asset, Baker, Mesh, NoProgress, Preview, PreviewOptions, Source, SplitOptions, StreamedWorld, World,
    WorldCoarse, WorldObject, WorldOptions, WorldPreview, split,
};
use fantex_test::PATIENCE;
use glam::{DVec3, Vec3, Vec4};

const SIZE: [u32; 2] = [320, 240];

fn gpu() -> Option<Arc<Gpu>> {
    match Gpu::headless(&GpuOptions::default()) {
        Ok(gpu) => Some(Arc::new(gpu)),
        Err(error) if error.kind() == ErrorKind::Unavailable => {
            fantex_test::skip(&error.to_string());
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A ball with bumps and smooth bands of colour, baked, with a preview.
fn ball(folder: &Path, name: &str, center: DVec3, radius: f64) -> WorldObject {
    let mut model = icosphere(5);
    for p in &mut model.positions {
        *p = center + *p * radius * (1.0 + 0.08 * (p.x * 5.0).sin() * (p.y * 4.0).cos());
    }
    model.materials = vec![Material::default()];
    let mesh = Mesh::from_model(model, name).unwrap();
    let color = |p: Vec3| {
        let wave = |x: f32| 0.5 + 0.4 * (6.0 * x).sin();
        Vec4::new(wave(p.x + p.y), wave(p.y - p.z), wave(p.z), 1.0)
    };
    let path = folder.join(name);
    Baker::new(&mesh)
        .texels(200_000)
        .source(Source::function(move |point| color(point.position)))
        .write(&path)
        .unwrap();
    let options = PreviewOptions { triangles: 1500, texels: Some(20_000), ..PreviewOptions::default() };
    let preview = Preview::add_to(&path, &options).unwrap();
    let bounds = world_bounds(&mesh);
    WorldObject {
        asset: name.into(),
        bytes: std::fs::metadata(&path).unwrap().len(),
        triangles: mesh.triangles.len() as u64,
        texels: 200_000,
        low: bounds.min.to_array(),
        high: bounds.max.to_array(),
        preview: Some(WorldPreview {
            triangles: preview.triangles,
            texels: preview.texels,
            detail: 0.05 * radius,
        }),
    }
}

/// A landscape with tunnels and arches, of 40 000 triangles, split into sectors of so many.
fn split_landscape(folder: &Path, sector_triangles: usize) -> (PathBuf, PathBuf) {
    let land = landscape(&LandscapeOptions { triangles: 40_000, ..LandscapeOptions::default() }).unwrap();
    let model = Model {
        positions: land.positions.iter().map(|p| p.as_dvec3()).collect(),
        triangles: land.triangles,
        materials: vec![Material::default()],
        ..Model::default()
    };
    let mesh = Mesh::from_model(model, "land.ply").unwrap();
    let path = folder.join("land.fan");
    let color = |p: Vec3| {
        let wave = |x: f32| 0.5 + 0.4 * (0.05 * x).sin();
        Vec4::new(wave(p.x + p.y), wave(p.y - p.z), wave(p.z), 1.0)
    };
    let source = Source::function(move |point| color(point.position));
    Baker::new(&mesh).texels(1_000_000).source(source).write(&path).unwrap();
    let options = SplitOptions { triangles: sector_triangles, ..SplitOptions::default() };
    let asset = Asset::open(&path).unwrap();
    let split = split(asset.shared(), &folder.join("sectors"), &options, &NoProgress).unwrap();
    (path, split.index)
}

/// A world of two balls, of which the second is smaller and beside the first.
fn two_balls(folder: &Path) -> (PathBuf, World) {
    let objects = vec![
        ball(folder, "large.fan", DVec3::ZERO, 1.0),
        ball(folder, "small.fan", DVec3::new(3.0, 0.4, -0.3), 0.3),
    ];
    let (index, world) = (folder.join("balls.fanworld"), World { objects, ..World::default() });
    world.write(&index).unwrap();
    (index, World::open(folder.join("balls.fanworld")).unwrap())
}

fn camera(target: DVec3, distance: f64) -> Camera {
    let eye = target + DVec3::new(0.3, 0.2, 1.0).normalize() * distance;
    Camera { eye, target, up: DVec3::Y, fov_degrees: 40.0 }
}

fn picture(gpu: &Gpu, model: &mut dyn gpu::Model, camera: &Camera) -> Image {
    let background = Background::Color(Vec3::Z);
    let options =
        DrawOptions { shading: Shading::BaseColor, background, tone_map: None, ..DrawOptions::default() };
    let mut frame = Frame { size: SIZE, camera, lights: &Lights::default(), model, options: &options };
    render_to_picture(gpu, &mut frame).unwrap().to_srgb_image()
}

/// The picture of the asset alone, once it is sharp.
fn alone(gpu: &Gpu, path: &Path, camera: &Camera) -> Image {
    let asset = Asset::open(path).unwrap();
    let mut model = StreamedModel::open(gpu, Arc::clone(asset.shared()), 64 << 20).unwrap();
    let view = stream_view(camera, SIZE, model.model.space());
    assert!(model.wait_until_sharp(gpu, &view, &FilterOptions::default(), PATIENCE).unwrap());
    picture(gpu, &mut model.model, camera)
}

/// Waits until a view has all that it needs, and shows it.
fn settled(gpu: &Arc<Gpu>, world: &mut StreamedWorld, camera: &Camera) -> Image {
    let is_settled = world.wait_until_settled(gpu, camera, SIZE, PATIENCE).unwrap();
    assert!(is_settled, "{:?}", world.statistics());
    picture(gpu, world, camera)
}

fn counts(world: &StreamedWorld) -> [usize; 3] {
    let now = world.statistics();
    [now.whole, now.previews, now.failed.len()]
}

#[test]
fn what_is_near_is_the_asset_itself_and_what_is_far_its_preview() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (index, world) = two_balls(folder.path());
    let centers = [DVec3::ZERO, DVec3::new(3.0, 0.4, -0.3)];
    let mut world = StreamedWorld::new(&index, Arc::new(world), WorldOptions::default()).unwrap();
    // What is beside the picture is a preview, or stays what it was.
    let views = [("large.fan", centers[0], 1.0, [1, 1, 0]), ("small.fan", centers[1], 0.3, [2, 0, 0])];
    for (name, center, radius, expected) in views {
        let near = camera(center, 3.2 * radius);
        let shown = settled(&gpu, &mut world, &near);
        assert_eq!(counts(&world), expected, "{name}");
        let expected = alone(&gpu, &folder.path().join(name), &near);
        let psnr = psnr_db(&shown, &expected).unwrap();
        assert!(psnr > 50.0, "{name}: {psnr} dB");
    }
    let far = camera(DVec3::new(1.5, 0.0, 0.0), 40.0);
    let shown = settled(&gpu, &mut world, &far);
    assert_eq!(counts(&world), [0, 2, 0]);
    // Where there are no previews, everything is whole; from afar nobody sees a difference.
    let without = |object: &WorldObject| WorldObject { preview: None, ..object.clone() };
    let objects = world.world().objects.iter().map(without).collect();
    let whole = World { objects, ..World::default() };
    let mut whole = StreamedWorld::new(&index, Arc::new(whole), WorldOptions::default()).unwrap();
    let expected = settled(&gpu, &mut whole, &far);
    assert_eq!(counts(&whole), [2, 0, 0]);
    let psnr = psnr_db(&shown, &expected).unwrap();
    assert!(psnr > 35.0, "{psnr} dB");
}

#[test]
fn memory_that_suffices_for_previews_only_shows_these() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (index, world) = two_balls(folder.path());
    let options = WorldOptions { geometry_bytes: 3 << 20, ..WorldOptions::default() };
    let mut world = StreamedWorld::new(&index, Arc::new(world), options).unwrap();
    let near = camera(DVec3::ZERO, 3.2);
    let shown = settled(&gpu, &mut world, &near);
    assert_eq!(counts(&world), [0, 2, 0]);
    assert!(world.statistics().geometry_bytes <= 3 << 20);
    let psnr = psnr_db(&shown, &alone(&gpu, &folder.path().join("large.fan"), &near)).unwrap();
    assert!(psnr > 25.0, "{psnr} dB");
    // More memory, and it becomes whole.
    world.set_options(WorldOptions::default());
    settled(&gpu, &mut world, &near);
    assert_eq!(counts(&world), [1, 1, 0]);
}

#[test]
fn an_asset_that_is_gone_is_named_and_the_others_are_shown() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (index, world) = two_balls(folder.path());
    std::fs::remove_file(folder.path().join("small.fan")).unwrap();
    let mut world = StreamedWorld::new(&index, Arc::new(world), WorldOptions::default()).unwrap();
    let near = camera(DVec3::new(1.5, 0.0, 0.0), 4.0);
    settled(&gpu, &mut world, &near);
    let failed = &world.statistics().failed;
    assert!(
        failed.iter().all(|(name, reason)| name == "small.fan" && reason.contains("small.fan")),
        "{failed:?}"
    );
    assert!(!failed.is_empty());
    assert_eq!(world.statistics().whole, 1);
}

#[test]
fn sectors_are_the_whole_and_fit_together_with_previews() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (path, index) = split_landscape(folder.path(), 4000);
    let world = World::open(&index).unwrap();
    let [low, high] = world.bounds().unwrap();
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let above = Camera {
        eye: middle + DVec3::new(0.2, 0.9, 0.4) * size,
        target: middle,
        up: DVec3::Y,
        fov_degrees: 40.0,
    };
    let expected = alone(&gpu, &path, &above);
    let without = |object: &WorldObject| WorldObject { preview: None, ..object.clone() };
    let objects = world.objects.iter().map(without).collect();
    let whole = World { objects, ..World::default() };
    let mut whole = StreamedWorld::new(&index, Arc::new(whole), WorldOptions::default()).unwrap();
    let shown = settled(&gpu, &mut whole, &above);
    assert_eq!(counts(&whole), [world.objects.len(), 0, 0]);
    let psnr = psnr_db(&shown, &expected).unwrap();
    assert!(psnr > 55.0, "whole: {psnr} dB");
    // Memory for half of the sectors: previews stand beside them, and nothing is seen through.
    let sizes = world.objects.iter().map(|object| object.triangles * 640 + (1 << 20));
    let options = WorldOptions { geometry_bytes: sizes.sum::<u64>() / 2, ..WorldOptions::default() };
    let near = Camera { eye: middle + DVec3::new(0.1, 0.25, 0.15) * size, ..above };
    let expected = alone(&gpu, &path, &near);
    let mut mixed = StreamedWorld::new(&index, Arc::new(world), options).unwrap();
    let shown = settled(&gpu, &mut mixed, &near);
    let [whole, previews, failed] = counts(&mixed);
    assert!(whole >= 2 && previews >= 2 && failed == 0, "{whole} {previews} {failed}");
    let psnr = psnr_db(&shown, &expected).unwrap();
    assert!(psnr > 25.0, "mixed: {psnr} dB");
    let [shown, expected] = [&shown, &expected].map(is_background);
    let [columns, rows] = SIZE.map(|n| n as usize);
    let holes = (1..rows - 1).flat_map(|y| (1..columns - 1).map(move |x| y * columns + x)).filter(|&at| {
        let around = [at, at - 1, at + 1, at - columns, at + columns];
        shown[at] && !around.iter().any(|&at| expected[at])
    });
    assert_eq!(holes.count(), 0);
}

#[test]
fn coarse_assets_stand_in_for_their_parts() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (path, index) = split_landscape(folder.path(), 1000);
    let world = World::open(&index).unwrap();
    let [low, high] = world.bounds().unwrap();
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let above = Camera {
        eye: middle + DVec3::new(0.1, 0.4, 0.2) * size,
        target: middle,
        up: DVec3::Y,
        fov_degrees: 40.0,
    };
    let expected = alone(&gpu, &path, &above);
    // As the choice counts them: 256 bytes per triangle and 4 per texel.
    let bytes = |coarse: &WorldCoarse| coarse.triangles * 256 + coarse.texels * 4;
    let coarse_bytes: u64 = world.coarse.iter().map(bytes).sum();
    let little = WorldOptions { geometry_bytes: coarse_bytes, ..WorldOptions::default() };
    let parts = world.coarse.len() - 1;
    let mut world = StreamedWorld::new(&index, Arc::new(world), little).unwrap();
    let shown = settled(&gpu, &mut world, &above);
    let statistics = world.statistics();
    assert_eq!((counts(&world), statistics.coarse), ([0, 0, 0], parts));
    assert!(statistics.geometry_bytes <= coarse_bytes, "{}", statistics.geometry_bytes);
    let psnr = psnr_db(&shown, &expected).unwrap();
    assert!(psnr > 20.0, "coarse: {psnr} dB");
    // With more memory the parts come; until all of one are there, their coarse asset is drawn.
    world.set_options(WorldOptions::default());
    for _ in 0..3 {
        world.advance(&gpu, &above, SIZE, FrameOptions::default()).unwrap();
        assert!(world.statistics().coarse > 0, "{:?}", world.statistics());
    }
    let shown = settled(&gpu, &mut world, &above);
    let [whole, previews, failed] = counts(&world);
    assert!(whole + previews > 16 && failed == 0, "{whole} {previews} {failed}");
    let psnr = psnr_db(&shown, &expected).unwrap();
    assert!(psnr > 30.0, "{psnr} dB");
    // And back: the coarse assets are still there.
    world.set_options(little);
    world.advance(&gpu, &above, SIZE, FrameOptions::default()).unwrap();
    assert_eq!((counts(&world), world.statistics().coarse), ([0, 0, 0], parts));
}

/// Whether a pixel shows what is behind everything, a blue that the landscape has not.
fn is_background(image: &Image) -> Vec<bool> {
    let Samples::U8(samples) = &image.samples else { panic!("bytes were expected") };
    samples.chunks_exact(image.channels as usize).map(|p| p[2] > 230 && p[0] < 20 && p[1] < 20).collect()
}
