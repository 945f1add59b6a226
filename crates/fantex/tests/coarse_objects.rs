//! Coarse assets of separate objects: what they show is what the objects show, and neighbours fit together.

#![cfg(feature = "http")]
#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::path::{Path, PathBuf};

use fantex::bake::{Source as BakeSource, SourceChannel, TexelPoint};
use fantex::mesh::generate::{grid, icosphere};
use fantex::mesh::{Edges, Material, Mesh, Model, WorldFromMesh};
use fantex::render::{FilterOptions, Lights, RenderOptions, Shading, render};
use fantex::scene::{Background, Camera};
use fantex::store::VerifyOptions;
use fantex::texture::compare::psnr_db;
use fantex::texture::{Image, Samples};
use fantex::{
    Asset, Baker, ChannelKind, Footprint, NoProgress, PreviewOptions, Source, SurfacePoint, World,
    WorldChange, WorldChanged, WorldCoarse, WorldScene, change_world, verify_world,
};
use glam::{DVec3, Vec3, Vec4};

const SIZE: [u32; 2] = [320, 240];

/// Smooth bands of colour in the world, and of some objects another surface than their material has.
struct Look {
    space: WorldFromMesh,
    has_surface: bool,
}

impl BakeSource for Look {
    fn channels(&self) -> Vec<SourceChannel> {
        let surface = SourceChannel::new(ChannelKind::OcclusionRoughnessMetallic);
        let color = SourceChannel::new(ChannelKind::BaseColor);
        if self.has_surface { vec![surface, color] } else { vec![color] }
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let p = self.space.point(point.position).as_vec3();
        let [first, last] = [0, values.len() - 1];
        values[first] = Vec4::new(1.0, 0.3, 0.8, 1.0);
        values[last] = Vec4::new(0.5 + 0.4 * (0.7 * p.x).sin(), 0.5 + 0.4 * (0.6 * p.z).cos(), 0.2, 1.0);
    }
}

/// Bakes a model into a folder.
fn bake(folder: &Path, name: &str, mut model: Model, has_surface: bool, texels: u64) -> PathBuf {
    // Names of materials tell nothing.
    model.materials =
        vec![Material { name: name.into(), metallic: 0.1, roughness: 0.9, ..Material::default() }];
    let mesh = fantex::Mesh::from_model(model, name).unwrap();
    let look = Look { space: mesh.world_from_mesh, has_surface };
    let path = folder.join(name);
    Baker::new(&mesh).texels(texels).source(Source::custom(&look)).overwrite(true).write(&path).unwrap();
    path
}

fn changed(index: &Path, put: &[PathBuf], previews: bool, coarse: Option<usize>) -> WorldChanged {
    let options = |triangles, texels| PreviewOptions {
        triangles,
        texels: Some(texels),
        keeps_borders: true,
        ..PreviewOptions::default()
    };
    let change = WorldChange {
        put,
        remove: &[],
        previews: previews.then(|| options(200, 4000)),
        coarse: coarse.map(|triangles| options(triangles, 40_000)),
    };
    change_world(index, &change, &NoProgress).unwrap()
}

/// Names of coarse assets in a folder.
fn coarse_files(folder: &Path) -> Vec<String> {
    let names = folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| name.contains("-coarse-")).collect();
    names.sort();
    names
}

fn picture(index: &Path, world: &World, camera: &Camera, memory_bytes: u64) -> ([usize; 3], Image) {
    let scene = WorldScene::open(index, world, camera, SIZE, memory_bytes).unwrap();
    let [width, height] = SIZE;
    let (shading, background) = (Shading::BaseColor, Background::Color(Vec3::Z));
    let options =
        RenderOptions { width, height, samples: 4, shading, background, ..RenderOptions::default() };
    let surface = scene.surface(FilterOptions::default());
    let rendered = render(scene.mesh(), &surface, camera, &Lights::default(), &options).unwrap();
    (scene.counts(), rendered.picture.to_srgb_image())
}

/// A picture of all objects, whole.
fn whole_picture(index: &Path, world: &World, camera: &Camera) -> Image {
    let mut whole = World { coarse: Vec::new(), ..world.clone() };
    whole.objects.iter_mut().for_each(|object| object.preview = None);
    picture(index, &whole, camera, 1 << 30).1
}

/// Memory that shows these coarse assets alone: meshes get half.
fn memory_for(coarse: &[WorldCoarse]) -> u64 {
    2 * coarse.iter().map(|coarse| coarse.triangles * 256 + coarse.texels * 4).sum::<u64>()
}

fn camera(world: &World, direction: DVec3) -> Camera {
    let [low, high] = world.bounds().unwrap();
    let target = 0.5 * (low + high);
    Camera { eye: target + direction * (high - low).length(), target, up: DVec3::Y, fov_degrees: 40.0 }
}

/// Pixels of the blue background.
fn background(image: &Image) -> Vec<bool> {
    let Samples::U8(samples) = &image.samples else { panic!("bytes were expected") };
    samples.chunks_exact(image.channels as usize).map(|p| p[2] > 230 && p[0] < 20 && p[1] < 20).collect()
}

/// A picture of the background alone.
fn blank(image: &Image) -> Image {
    let mut blank = image.clone();
    let Samples::U8(samples) = &mut blank.samples else { panic!("bytes were expected") };
    for p in samples.chunks_exact_mut(image.channels as usize) {
        p[..3].copy_from_slice(&[0, 0, 255]);
    }
    blank
}

#[test]
fn a_town_from_afar_is_one_coarse_asset() {
    let folder = tempfile::tempdir().unwrap();
    let index = folder.path().join("town.fanworld");
    let house = |number: u32, texels: u64| {
        let center = DVec3::new(f64::from(number % 6), 0.0, f64::from(number / 6)) * 3.0 + 1000.5;
        let mut model = icosphere(3);
        model.positions.iter_mut().for_each(|p| *p = center + *p);
        let has_surface = number.is_multiple_of(2);
        bake(folder.path(), &format!("house-{number}.fan"), model, has_surface, texels)
    };
    let houses: Vec<PathBuf> = (0..36).map(|number| house(number, 15_000)).collect();
    let made = changed(&index, &houses, true, Some(1500));
    assert_eq!((made.added, made.previews_made, made.coarse_made), (36, 36, 4));
    assert!(made.notes.is_empty(), "{:?}", made.notes);
    let world = World::open(&index).unwrap();
    let names = [1, 2, 3, 4].map(|number| format!("town-coarse-000{number}.fan"));
    assert!(world.coarse.iter().map(|coarse| &coarse.asset).eq(&names));
    assert_eq!(world.coarse[3].parts, names[..3]);
    assert_eq!(coarse_files(folder.path()), names);
    let report = verify_world(&index, &VerifyOptions::default(), &NoProgress).unwrap();
    assert!(report.ok, "{:?}", report.faults());

    // What only some objects have says of the others what their materials say.
    let coarse = Asset::open(folder.path().join(&names[0])).unwrap();
    let surface = coarse.channel_of_kind(ChannelKind::OcclusionRoughnessMetallic).unwrap();
    let sampler = coarse.sampler(16 << 20);
    let metallic = |triangle: u32| {
        let at = SurfacePoint { triangle, lambda: Vec3::splat(1.0 / 3.0) };
        sampler.sample_channel(surface, at, Footprint::NONE).z
    };
    let found: Vec<f32> = (0..coarse.mesh().triangles.len() as u32).map(metallic).collect();
    let share = |is_it: fn(f32) -> bool| {
        found.iter().filter(|found| is_it(**found)).count() as f32 / found.len() as f32
    };
    let (low, high) = (share(|x| (x - 0.1).abs() < 0.1), share(|x| (x - 0.8).abs() < 0.1));
    assert!(low > 0.25 && high > 0.25, "{low} of the surface is as its material, {high} as it was baked");
    assert_eq!(coarse.mesh().materials.len(), 1, "materials that look alike are one");

    // The picture is that of the objects.
    let far = camera(&world, DVec3::new(0.3, 0.8, 0.9));
    let expected = whole_picture(&index, &world, &far);
    let (counts, shown) = picture(&index, &world, &far, memory_for(&world.coarse[3..]));
    assert_eq!(counts, [0, 0, 1]);
    let psnr = psnr_db(&shown, &expected).unwrap();
    let empty = psnr_db(&blank(&expected), &expected).unwrap();
    println!("{psnr:.1} dB; of an empty picture {empty:.1} dB");
    assert!(psnr > empty + 5.0 && psnr > 20.0, "{psnr} dB, {empty} dB");

    // What has changed takes those that show it with it; then they are made anew, and the old files go.
    house(0, 20_000);
    let less = changed(&index, &houses[..1], false, None);
    assert_eq!((less.updated, less.coarse_removed), (1, 2));
    assert!(less.notes[0].contains("--make-coarse"), "{:?}", less.notes);
    let bare = changed(&index, &[], false, Some(1500));
    assert!(bare.notes[0].contains("1 asset without"), "{:?}", bare.notes);
    let again = changed(&index, &[], true, Some(1500));
    assert_eq!((again.previews_made, again.coarse_made), (1, 4));
    assert_eq!(coarse_files(folder.path()).len(), 4);
    assert!(verify_world(&index, &VerifyOptions::default(), &NoProgress).unwrap().ok);
}

/// Vertices at edges of a single triangle, world units.
/// Whatever is called like coarse assets: what this index or another one names stays, and names stay as they are.
#[test]
fn only_own_coarse_assets_are_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let index = folder.path().join("t.fanworld");
    let ball = || icosphere(2);
    let first = bake(folder.path(), "t-coarse-0001.fan", ball(), false, 20_000);
    let second = bake(folder.path(), "b.fan", ball(), false, 20_000);
    changed(&index, &[first.clone(), second], true, Some(100));
    let made = |index: &Path| World::open(index).unwrap().coarse[0].asset.clone();
    let backup = folder.path().join("backup.fanworld");
    std::fs::copy(&index, &backup).unwrap();
    let text = std::fs::read_to_string(&index).unwrap().replace("\"b.fan\"", "\"./b.fan\"");
    std::fs::write(&index, text).unwrap();
    changed(&index, &[], true, Some(100));
    assert!(first.exists() && folder.path().join(made(&backup)).exists());
    assert!(folder.path().join(made(&index)).exists() && made(&index) != made(&backup));
    assert_eq!(World::open(&index).unwrap().objects.len(), 2);
    for index in [&index, &backup] {
        assert!(verify_world(index, &VerifyOptions::default(), &NoProgress).unwrap().ok);
    }
    std::fs::remove_file(&backup).unwrap();
    changed(&index, &[], false, Some(100));
    assert_eq!(coarse_files(folder.path()), [made(&index), "t-coarse-0001.fan".to_owned()]);
}

#[test]
fn previews_of_small_assets_are_smaller_than_these() {
    let folder = tempfile::tempdir().unwrap();
    let index = folder.path().join("t.fanworld");
    let path = bake(folder.path(), "house.fan", icosphere(3), false, 60_000);
    let bytes = std::fs::metadata(&path).unwrap().len();
    let change = WorldChange {
        put: std::slice::from_ref(&path),
        previews: Some(PreviewOptions::default()),
        ..WorldChange::default()
    };
    assert_eq!(change_world(&index, &change, &NoProgress).unwrap().previews_made, 1);
    let with_preview = std::fs::metadata(&path).unwrap().len();
    assert!(with_preview < 2 * bytes, "{bytes} {with_preview}");
    let texels = World::open(&index).unwrap().objects[0].preview.unwrap().texels;
    assert!(texels < 20_000, "{texels}");
}

fn border(mesh: &Mesh) -> Vec<DVec3> {
    let edges = Edges::of(&mesh.triangles);
    let borders = edges.iter().filter(|edge| edge.triangle_count() == 1);
    let mut vertices: Vec<u32> = borders.flat_map(|edge| edge.vertices()).collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices.into_iter().map(|v| mesh.world_from_mesh.point(mesh.positions[v as usize])).collect()
}

#[test]
fn tiles_of_a_terrain_fit_together_from_afar() {
    const NEAR: f64 = 1e-4;
    let folder = tempfile::tempdir().unwrap();
    let index = folder.path().join("land.fanworld");
    let tile = |number: u32| {
        let corner = DVec3::new(f64::from(number % 4), 0.0, f64::from(number / 4)) * 2.0;
        let mut model = grid(12);
        for p in &mut model.positions {
            *p += corner;
            p.y = 0.3 * (1.3 * p.x).sin() * (1.1 * p.z).cos();
            *p = *p * 7.3 + DVec3::new(1000.1, 0.0, -500.7);
        }
        bake(folder.path(), &format!("tile-{number}.fan"), model, false, 8000)
    };
    let tiles: Vec<PathBuf> = (0..20).map(tile).collect();
    let made = changed(&index, &tiles, true, Some(300));
    assert_eq!((made.coarse_made, made.notes.len()), (3, 0), "{:?}", made.notes);
    let world = World::open(&index).unwrap();
    let report = verify_world(&index, &VerifyOptions::default(), &NoProgress).unwrap();
    assert!(report.ok, "{:?}", report.faults());
    // An index may say anything.
    let mut wrong = world.clone();
    wrong.coarse.iter_mut().for_each(|coarse| coarse.texels = u64::MAX);
    let other = folder.path().join("wrong.fanworld");
    wrong.write(&other).unwrap();
    let report = verify_world(&other, &VerifyOptions::default(), &NoProgress).unwrap();
    assert!(!report.ok && !report.coarse[0].ok, "{:?}", report.faults());

    // Where tiles of both runs meet, both coarse assets have the vertex.
    let [first, second] = [0, 1].map(|run| {
        let parts = &world.coarse[run].parts;
        let of_tiles =
            parts.iter().flat_map(|name| border(Asset::open(folder.path().join(name)).unwrap().mesh()));
        let coarse = Asset::open(folder.path().join(&world.coarse[run].asset)).unwrap();
        (of_tiles.collect::<Vec<DVec3>>(), border(coarse.mesh()))
    });
    let has = |points: &[DVec3], p: &DVec3| points.iter().any(|q| q.distance(*p) < NEAR);
    let shared: Vec<&DVec3> = first.0.iter().filter(|p| has(&second.0, p)).collect();
    assert!(shared.len() > 12, "{} vertices meet", shared.len());
    for p in shared {
        assert!(has(&first.1, p) && has(&second.1, p), "{p}");
    }
    // Borders between tiles of one run are none of its coarse asset.
    assert!(first.1.len() < first.0.len() / 2, "{} of {}", first.1.len(), first.0.len());

    let above = camera(&world, DVec3::new(0.05, 0.7, 0.1));
    let expected = whole_picture(&index, &world, &above);
    let mut runs = world.clone();
    runs.coarse.pop();
    let (counts, shown) = picture(&index, &runs, &above, memory_for(&runs.coarse));
    assert_eq!(counts, [0, 0, 2]);
    // No background shows within the terrain.
    let [shown_background, expected_background] = [&shown, &expected].map(background);
    let [columns, rows] = SIZE.map(|n| n as usize);
    let is_inside = |x: usize, y: usize| {
        let around = |n: usize, end: usize| n.saturating_sub(6)..(n + 7).min(end);
        around(y, rows).all(|y| around(x, columns).all(|x| !expected_background[y * columns + x]))
    };
    let pixels = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let inside: Vec<_> = pixels.filter(|&(x, y)| is_inside(x, y)).collect();
    assert!(inside.len() > 5000, "{} pixels", inside.len());
    let holes = inside.iter().filter(|(x, y)| shown_background[y * columns + x]).count();
    assert_eq!(holes, 0);
    let psnr = psnr_db(&shown, &expected).unwrap();
    println!("{psnr:.1} dB");
    assert!(psnr > 20.0, "{psnr} dB");
}
