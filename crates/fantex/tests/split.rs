//! A world of sectors shows what the whole asset shows, bit by bit, and its previews fit together.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use fantex::base::random::nth_random;
use fantex::mesh::generate::{LandscapeOptions, cube, grid, icosphere, landscape};
use fantex::mesh::{Edges, Material, Mesh, Model, shading_normals};
use fantex::render::{FanSurface, FilterOptions, Lights, RenderOptions, Shading, Surface, render};
use fantex::scene::{Background, Camera};
use fantex::store::{PageCache, VerifyOptions, WriterLock, verify_asset};
use fantex::texture::compare::psnr_db;
use fantex::texture::{Image, Samples};
use fantex::{
    Asset, Baker, ErrorKind, Footprint, NoProgress, Progress, SectorPreviews, Source, SplitOptions,
    SurfacePoint, World, WorldCoarse, WorldObject, WorldScene, frame_world, split, verify_world,
};
use fantex_test::{ball_on_a_plane, bottle, workspace};
use glam::{DVec3, Vec3, Vec4};

/// A position in the world, to the last bit.
type Place = [u64; 3];

fn places(mesh: &Mesh) -> Vec<Place> {
    let place = |&p: &Vec3| mesh.world_from_mesh.point(p).to_array().map(|x| (x + 0.0).to_bits());
    mesh.positions.iter().map(place).collect()
}

/// Edges of one triangle, as pairs of places.
fn border(mesh: &Mesh) -> BTreeSet<[Place; 2]> {
    let places = places(mesh);
    let edges = Edges::of(&mesh.triangles);
    let borders = edges.iter().filter(|edge| edge.triangle_count() == 1);
    let pair = |[a, b]: [u32; 2]| {
        let mut pair = [places[a as usize], places[b as usize]];
        pair.sort_unstable();
        pair
    };
    borders.map(|edge| pair(edge.vertices())).collect()
}

fn baked(folder: &Path, mesh: Mesh, texels: u64) -> Asset {
    let path = folder.join("whole.fan");
    let color = |p: Vec3| {
        Vec4::new(0.5 + 0.4 * (9.0 * p.x).sin(), 0.5 + 0.4 * (7.0 * p.y).cos(), p.z.abs().min(1.0), 1.0)
    };
    let model = fantex_mesh_of(mesh);
    let baker = Baker::new(&model).texels(texels).longest_edge(fantex::LongestEdge::Texels(0));
    baker.source(Source::function(move |point| color(point.position))).write(&path).unwrap();
    Asset::open(&path).unwrap()
}

/// The mesh as a program would load it.
fn fantex_mesh_of(mesh: Mesh) -> fantex::Mesh {
    let positions = mesh.positions.iter().map(|&p| mesh.world_from_mesh.point(p)).collect();
    let Mesh { triangles, materials, .. } = mesh;
    fantex::Mesh::from_model(Model { positions, triangles, materials, ..Model::default() }, "whole.ply")
        .unwrap()
}

struct Sectors {
    index: PathBuf,
    world: World,
    sectors: Vec<Asset>,
}

fn split_into(whole: &Asset, folder: &Path, options: &SplitOptions) -> Sectors {
    let written = split(whole.shared(), folder, options, &NoProgress).unwrap();
    assert_eq!(written.index, folder.join("whole.fanworld"));
    assert_eq!(World::open(&written.index).unwrap(), written.world);
    let open = |object: &WorldObject| {
        let path = World::asset_place(&written.index, object);
        assert_eq!(std::fs::metadata(&path).unwrap().len(), object.bytes);
        let asset = Asset::open(&path).unwrap();
        assert_eq!(*object, WorldObject::of(object.asset.clone(), &asset).unwrap());
        asset
    };
    let sectors: Vec<Asset> = written.world.objects.iter().map(open).collect();
    Sectors { index: written.index, world: written.world, sectors }
}

/// Corners of a triangle by their places: no other triangle of a mesh has the same.
fn key(mesh: &Mesh, triangle: usize) -> [[u32; 3]; 3] {
    mesh.triangle_positions(triangle).map(|p| p.to_array().map(f32::to_bits))
}

/// Every triangle is in one sector, with the same material and part, and all channels are the same there at any size of footprint.
fn assert_sectors_are_the_whole(whole: &Asset, sectors: &[Asset]) {
    assert_sectors_are_the_whole_and_pass(
        whole,
        sectors,
        &VerifyOptions { texels: true, ..VerifyOptions::default() },
    );
}

fn assert_sectors_are_the_whole_and_pass(whole: &Asset, sectors: &[Asset], verification: &VerifyOptions) {
    let mesh = whole.mesh();
    let mut left: BTreeMap<_, usize> = (0..mesh.triangles.len()).map(|t| (key(mesh, t), t)).collect();
    let reference = whole.sampler(64 << 20);
    let normals = shading_normals(mesh);
    for (number, sector) in (0u64..).zip(sectors) {
        let report = verify_asset(sector.shared(), verification);
        assert!(report.ok, "sector {number}: {:?}", report.texels);
        let part = sector.mesh();
        assert_eq!(part.world_from_mesh, mesh.world_from_mesh);
        assert_eq!(part.materials, mesh.materials);
        let sampler = sector.sampler(64 << 20);
        let own_normals = shading_normals(part);
        for t in 0..part.triangles.len() {
            let of_whole =
                left.remove(&key(part, t)).unwrap_or_else(|| panic!("triangle {t} of {number} is new"));
            assert_eq!(part.material_of(t), mesh.material_of(of_whole));
            assert_eq!(part.parts.of(t), mesh.parts.of(of_whole));
            assert_eq!(own_normals[3 * t..3 * t + 3], normals[3 * of_whole..3 * of_whole + 3]);
            for (&own, &group) in
                sector.cover().corner_groups[t].iter().zip(&whole.cover().corner_groups[of_whole])
            {
                assert_eq!(sector.cover().groups[own as usize], whole.cover().groups[group as usize]);
                assert_eq!(sector.mean(0, own), whole.mean(0, group));
            }
            let random = |i: u64| nth_random(number << 32 | t as u64, i) as u32 as f32 / u32::MAX as f32;
            let (a, b) = (random(0), random(1));
            let lambda = if a + b > 1.0 {
                Vec3::new(1.0 - a, 1.0 - b, a + b - 1.0)
            } else {
                Vec3::new(a, b, 1.0 - a - b)
            };
            let size = [0.0, 0.01, 0.3, 5.0][t % 4];
            let steps = [Vec3::new(size, -size, 0.0), Vec3::new(0.0, size, -size)];
            for channel in 0..whole.channels().len() {
                let at = |triangle: usize| SurfacePoint { triangle: triangle as u32, lambda };
                let footprint = Footprint { lambda_steps: steps };
                let own = sampler.sample_channel(channel, at(t), footprint);
                let expected = reference.sample_channel(channel, at(of_whole), footprint);
                assert_eq!(
                    own.to_array().map(f32::to_bits),
                    expected.to_array().map(f32::to_bits),
                    "{own} {expected}"
                );
            }
        }
    }
    assert!(left.is_empty(), "{} triangles are in no sector", left.len());
}

fn preview_of(sector: &Asset) -> Arc<fantex::store::Asset> {
    let preview = fantex::store::Asset::open_preview(&**sector.source()).unwrap().unwrap();
    assert!(verify_asset(&Arc::new(preview), &VerifyOptions::default()).ok);
    Arc::new(fantex::store::Asset::open_preview(&**sector.source()).unwrap().unwrap())
}

fn bumpy_ball() -> Mesh {
    let mut model = icosphere(5);
    for p in &mut model.positions {
        *p *= 1.0 + 0.08 * (p.x * 5.0).sin() * (p.y * 4.0).cos() + 0.04 * (p.z * 9.0).sin();
        *p = *p * 730.0 + DVec3::new(5.1e5, 3.3e6, 17.0);
    }
    fantex_test::cleaned(model)
}

#[test]
fn all_channels_of_a_model_are_bit_by_bit_those_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.fan");
    let model = fantex::Mesh::load(workspace().join("assets/WaterBottle/WaterBottle.gltf")).unwrap();
    Baker::new(&model).texels(100_000).source(Source::own_materials()).write(&path).unwrap();
    assert_eq!(bottle().triangles.len(), model.triangles.len());
    let whole = Asset::open(&path).unwrap();
    assert!(whole.channels().len() > 3);
    let options = SplitOptions { triangles: 700, previews: None, ..SplitOptions::default() };
    let split = split_into(&whole, &folder.path().join("world"), &options);
    let due = whole.mesh().triangles.len().div_ceil(700);
    assert!(split.sectors.len() > due / 2 && split.sectors.len() <= due, "{} of {due}", split.sectors.len());
    assert!(split.world.objects.iter().all(|object| object.preview.is_none()));
    assert_sectors_are_the_whole(&whole, &split.sectors);
}

/// Where sectors meet at a hard edge, the texture function jumps as it does in the whole, which is no fault.
#[test]
fn sectors_may_meet_at_hard_edges() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.fan");
    let model = fantex::Mesh::from_model(cube(8), "whole.ply").unwrap();
    let baker = || Baker::new(&model).texels(100_000).source(Source::solid("marble")).overwrite(true);
    for (name, baker) in [("whole", baker()), ("cut", baker().hard_edges(60.0))] {
        baker.longest_edge(fantex::LongestEdge::Texels(0)).write(&path).unwrap();
        let whole = Asset::open(&path).unwrap();
        let options = SplitOptions { triangles: 100, previews: None, ..SplitOptions::default() };
        let split = split_into(&whole, &folder.path().join(name), &options);
        for sector in &split.sectors {
            assert_eq!(sector.cover().hard_edges, whole.cover().hard_edges);
        }
        let report = verify_world(&split.index, &VerifyOptions::default(), &NoProgress).unwrap();
        assert!(report.ok && report.largest_jump < 1e-6, "{report:?}");
        // Each of two sectors.
        let borders: usize = split.sectors.iter().map(|sector| border(sector.mesh()).len()).sum();
        let seams = borders as u64 / 2;
        let is_cut = whole.cover().hard_edges.is_some();
        assert!((report.seam_edges < seams) == is_cut, "{name}: {} of {seams}", report.seam_edges);
    }
}

fn preview_angles(split: &Sectors) -> Vec<Option<f32>> {
    split.sectors.iter().map(|sector| preview_of(sector).cover().hard_edges).collect()
}

fn coarse_angles(split: &Sectors, folder: &Path) -> Vec<Option<f32>> {
    let open = |name: &String| Asset::open(folder.join(name)).unwrap();
    split.world.coarse.iter().map(|coarse| open(&coarse.asset).cover().hard_edges).collect()
}

/// What is seen from afar is cut as what is seen from nearby.
#[test]
fn previews_and_coarse_assets_have_the_hard_edges_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.fan");
    let model = fantex::Mesh::from_model(cube(12), "whole.ply").unwrap();
    let baker = Baker::new(&model).texels(5000).source(Source::solid("marble")).hard_edges(60.0);
    baker.longest_edge(fantex::LongestEdge::Texels(0)).write(&path).unwrap();
    let options = SplitOptions { triangles: 100, ..SplitOptions::default() };
    let folder = folder.path().join("world");
    let split = split_into(&Asset::open(&path).unwrap(), &folder, &options);
    for angles in [preview_angles(&split), coarse_angles(&split, &folder)] {
        assert!(!angles.is_empty() && angles.iter().all(|&angle| angle == Some(60.0)), "{angles:?}");
    }
}

#[test]
fn previews_of_a_closed_surface_have_the_borders_of_their_sectors() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), bumpy_ball(), 300_000);
    let options = SplitOptions { triangles: 4000, ..SplitOptions::default() };
    let split = split_into(&whole, &folder.path().join("world"), &options);
    assert!(split.sectors.len() >= 4, "{}", split.sectors.len());
    assert_sectors_are_the_whole(&whole, &split.sectors);
    for (object, sector) in split.world.objects.iter().zip(&split.sectors) {
        let preview = preview_of(sector);
        // Whichever of two neighbours is shown whole or coarse: their edges are the same, so nothing shows through.
        let edges = border(sector.mesh());
        assert!(!edges.is_empty());
        assert_eq!(border(preview.mesh()), edges);
        let known = object.preview.unwrap();
        assert_eq!(known.triangles, preview.mesh().triangles.len() as u64);
        assert!(known.triangles * 4 < object.triangles, "{} of {}", known.triangles, object.triangles);
        // Some 30 world units are a fifth of a texel's length of the preview, and more than the bumps that it leaves out.
        assert!(known.detail > 1.0 && known.detail < 100.0, "{}", known.detail);
        assert_normals_agree_at_borders(sector.mesh(), preview.mesh(), &edges);
    }
}

/// Light does not jump between a sector and the preview of another one.
fn assert_normals_agree_at_borders(fine: &Mesh, coarse: &Mesh, edges: &BTreeSet<[Place; 2]>) {
    let at_border: BTreeSet<Place> = edges.iter().flatten().copied().collect();
    let normals = |mesh: &Mesh| {
        let (places, normals) = (places(mesh), shading_normals(mesh));
        let corners = mesh.triangles.iter().flatten().zip(normals);
        let at_place = corners.map(move |(&vertex, normal)| (places[vertex as usize], normal));
        at_place.filter(|(place, _)| at_border.contains(place)).collect::<BTreeMap<_, _>>()
    };
    let (fine, coarse) = (normals(fine), normals(coarse));
    assert_eq!(fine.len(), coarse.len());
    for (place, normal) in fine {
        assert!(normal.distance(coarse[&place]) < 1e-5, "{normal} {}", coarse[&place]);
    }
}

/// The objects that a coarse asset stands for, ascending.
fn objects_of(world: &World, coarse: &WorldCoarse) -> Vec<usize> {
    let mut objects = Vec::new();
    for part in &coarse.parts {
        match world.coarse.iter().find(|other| other.asset == *part) {
            Some(finer) => objects.extend(objects_of(world, finer)),
            None => objects.push(world.objects.iter().position(|object| object.asset == *part).unwrap()),
        }
    }
    objects.sort_unstable();
    objects
}

/// The sector of each triangle of the whole.
fn sector_of_triangles(whole: &Mesh, sectors: &[Asset]) -> Vec<usize> {
    let mut known = BTreeMap::new();
    for (number, sector) in sectors.iter().enumerate() {
        let mesh = sector.mesh();
        known.extend((0..mesh.triangles.len()).map(|triangle| (key(mesh, triangle), number)));
    }
    (0..whole.triangles.len()).map(|triangle| known[&key(whole, triangle)]).collect()
}

/// Edges of the whole between the sectors that a coarse asset stands for and others.
fn outline_of(whole: &Mesh, sector: &[usize], objects: &[usize]) -> BTreeSet<[Place; 2]> {
    let places = places(whole);
    let edges = Edges::of(&whole.triangles);
    let is_in = |triangle: u32| objects.contains(&sector[triangle as usize]);
    let at_outline = edges.iter().filter(|edge| {
        let inside = edge.triangles().filter(|&(triangle, _)| is_in(triangle)).count();
        inside > 0 && inside < edge.triangle_count()
    });
    let pair = |[a, b]: [u32; 2]| {
        let mut pair = [places[a as usize], places[b as usize]];
        pair.sort_unstable();
        pair
    };
    at_outline.map(|edge| pair(edge.vertices())).collect()
}

fn open_coarse(split: &Sectors, coarse: &WorldCoarse) -> Asset {
    let asset = Asset::open(World::place_of(&split.index, &coarse.asset)).unwrap();
    assert!(verify_asset(asset.shared(), &VerifyOptions::default()).ok, "{}", coarse.asset);
    assert_eq!((asset.mesh().triangles.len() as u64, asset.file_bytes()), (coarse.triangles, coarse.bytes));
    asset
}

#[test]
fn coarse_assets_of_a_closed_surface_have_the_outlines_of_their_runs() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), bumpy_ball(), 200_000);
    let options = SplitOptions { triangles: 400, ..SplitOptions::default() };
    let split = split_into(&whole, &folder.path().join("world"), &options);
    let (sectors, coarse) = (split.sectors.len(), &split.world.coarse);
    assert!(sectors > 32, "{sectors}");
    // Runs of sectors, and one above them.
    assert_eq!(coarse.len(), sectors.div_ceil(16) + 1);
    let sector = sector_of_triangles(whole.mesh(), &split.sectors);
    let mut covered = vec![0; sectors];
    for coarse in coarse {
        let objects = objects_of(&split.world, coarse);
        objects.iter().for_each(|&object| covered[object] += 1);
        let asset = open_coarse(&split, coarse);
        let outline = outline_of(whole.mesh(), &sector, &objects);
        assert_eq!(outline.is_empty(), objects.len() == sectors, "{}", coarse.asset);
        assert_eq!(border(asset.mesh()), outline, "{}", coarse.asset);
        assert_normals_agree_at_borders(whole.mesh(), asset.mesh(), &outline);
        // No more triangles than its parts, and no shorter details.
        let finer = |part: &String| match split.world.objects.iter().find(|object| object.asset == *part) {
            Some(object) => object.preview.map(|preview| (preview.triangles, preview.detail)).unwrap(),
            None => {
                let finer = split.world.coarse.iter().find(|finer| finer.asset == *part).unwrap();
                (finer.triangles, finer.detail)
            }
        };
        assert!(coarse.triangles <= coarse.parts.iter().map(|part| finer(part).0).sum::<u64>());
        assert!(coarse.parts.iter().all(|part| finer(part).1 <= coarse.detail));
    }
    assert!(coarse[coarse.len() - 1].triangles <= 1100, "{:?}", coarse[coarse.len() - 1]);
    // Each sector has two coarse assets above it.
    assert!(covered.iter().all(|&times| times == 2), "{covered:?}");
}

/// A landscape with tunnels and arches, of 40 000 triangles.
fn land() -> Mesh {
    let land = landscape(&LandscapeOptions { triangles: 40_000, ..LandscapeOptions::default() }).unwrap();
    fantex_test::cleaned(Model {
        positions: land.positions.iter().map(|p| p.as_dvec3()).collect(),
        triangles: land.triangles,
        materials: vec![Material::default()],
        ..Model::default()
    })
}

/// A landscape in sectors of 1000 triangles, which their previews keep.
fn split_land(folder: &Path) -> (Asset, Sectors) {
    let whole = baked(folder, land(), 400_000);
    let previews = SectorPreviews { triangles: Some(4000), texels: Some(60_000) };
    let options = SplitOptions { triangles: 1000, previews: Some(previews), ..SplitOptions::default() };
    let split = split_into(&whole, &folder.join("world"), &options);
    assert!(split.world.coarse.len() >= 4, "{}", split.world.coarse.len());
    (whole, split)
}

/// One world for all, as it takes longer to make than to look at.
#[test]
fn a_world_with_coarse_assets_is_framed_rendered_and_verified() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, split) = split_land(folder.path());
    assert_framed_as_the_whole(&whole, &split);
    assert_rendered_without_gaps(&whole, &split);
    assert_verified(&whole, &split);
    assert_framing_needs_assets(&split);
}

/// Faults that are made are found. A coarse asset is gone then.
fn assert_verified(whole: &Asset, split: &Sectors) {
    let verify = || verify_world(&split.index, &VerifyOptions::default(), &NoProgress).unwrap();
    let report = verify();
    let faults: Vec<&String> = report.coarse.iter().flat_map(|coarse| &coarse.faults).collect();
    assert!(report.ok && faults.is_empty(), "{faults:?}");
    assert_eq!(report.coarse.len(), split.world.coarse.len());

    // But for edges at the outline of the whole, runs have their outlines.
    let sector = sector_of_triangles(whole.mesh(), &split.sectors);
    let outer: BTreeSet<Place> = border(whole.mesh()).into_iter().flatten().collect();
    for coarse in &split.world.coarse {
        let own = border(open_coarse(split, coarse).mesh());
        let outline = outline_of(whole.mesh(), &sector, &objects_of(&split.world, coarse));
        let inner = outline.iter().filter(|ends| !ends.iter().any(|end| outer.contains(end)));
        assert_eq!(inner.filter(|ends| !own.contains(*ends)).count(), 0, "{}", coarse.asset);
    }

    // A coarse asset of another run does not fit.
    let place = |number: usize| World::place_of(&split.index, &split.world.coarse[number].asset);
    std::fs::copy(place(1), place(0)).unwrap();
    let report = verify();
    assert!(!report.ok && report.coarse[1].ok);
    let faults = &report.coarse[0].faults;
    assert!(faults.iter().any(|fault| fault.contains("its border lacks")), "{faults:?}");
    assert!(faults.iter().any(|fault| fault.contains("make it anew with 'fantex split'")), "{faults:?}");
    std::fs::remove_file(place(0)).unwrap();
    assert!(verify().coarse[0].faults[0].contains("cannot read"));
}

const SIZE: [u32; 2] = [320, 240];

fn picture(mesh: &Mesh, surface: &dyn Surface, camera: &Camera) -> Image {
    let [width, height] = SIZE;
    let background = Background::Color(Vec3::Z);
    let shading = Shading::BaseColor;
    let options =
        RenderOptions { width, height, samples: 4, shading, background, ..RenderOptions::default() };
    render(mesh, surface, camera, &Lights::default(), &options).unwrap().picture.to_srgb_image()
}

/// Whether a pixel shows what is behind everything, a blue that the landscape has not.
fn is_background(image: &Image) -> Vec<bool> {
    let Samples::U8(samples) = &image.samples else { panic!("bytes were expected") };
    samples.chunks_exact(image.channels as usize).map(|p| p[2] > 230 && p[0] < 20 && p[1] < 20).collect()
}

/// Pixels of the background in a picture, at least so many pixels within what another one shows.
fn holes(shown: &Image, expected: &Image, margin: usize) -> usize {
    let [shown, expected] = [shown, expected].map(is_background);
    let [columns, rows] = SIZE.map(|n| n as usize);
    let is_inside = |x: usize, y: usize| {
        let mut around =
            (y - margin..=y + margin).flat_map(|y| (x - margin..=x + margin).map(move |x| (x, y)));
        !around.any(|(x, y)| expected[y * columns + x])
    };
    let pixels = (margin..rows - margin).flat_map(|y| (margin..columns - margin).map(move |x| (x, y)));
    pixels.filter(|&(x, y)| shown[y * columns + x] && is_inside(x, y)).count()
}

fn assert_framed_as_the_whole(whole: &Asset, split: &Sectors) {
    for direction in [Camera::THREE_QUARTER, DVec3::Y, DVec3::new(-1.0, 1.0, 0.2)] {
        let expected = Camera::framing_mesh_with(whole.mesh(), direction, 1.5, DVec3::Y, 50.0);
        let framed = frame_world(&split.index, &split.world, direction, 1.5, 50.0).unwrap();
        let size = (expected.eye - expected.target).length();
        for (a, b) in [(framed.eye, expected.eye), (framed.target, expected.target)] {
            assert!((a - b).length() < 1e-12 * size, "{a} {b}");
        }
        assert_eq!((framed.up, framed.fov_degrees), (expected.up, expected.fov_degrees));
    }
}

/// No asset is left then.
fn assert_framing_needs_assets(split: &Sectors) {
    let places = split.world.objects.iter().map(|object| World::asset_place(&split.index, object));
    places.for_each(|place| std::fs::remove_file(place).unwrap());
    let error = frame_world(&split.index, &split.world, DVec3::Z, 1.5, 50.0).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotFound);
}

/// Of coarse assets, where there is little memory.
fn assert_rendered_without_gaps(whole: &Asset, split: &Sectors) {
    let [low, high] = split.world.bounds().unwrap();
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let from = |direction: DVec3| Camera {
        eye: middle + direction * size,
        target: middle,
        up: DVec3::Y,
        fov_degrees: 40.0,
    };
    let (far, near) = (from(DVec3::new(0.2, 0.9, 0.4)), from(DVec3::new(0.1, 0.25, 0.15)));
    let cache = PageCache::new(Arc::clone(whole.shared()), 64 << 20);
    let surface = FanSurface::of_asset(&cache, FilterOptions::default());
    // As the choice counts them: 256 bytes per triangle and 4 per texel. The last one stands for all.
    let bytes = |coarse: &WorldCoarse| coarse.triangles * 256 + coarse.texels * 4;
    let all: u64 = split.world.coarse.iter().map(bytes).sum();
    let alone = bytes(split.world.coarse.last().unwrap());
    for (camera, budget, least, psnr_least) in
        [(&far, all, 1, 30.0), (&far, alone, 1, 25.0), (&near, all, 2, 25.0), (&near, alone, 1, 20.0)]
    {
        let expected = picture(whole.mesh(), &surface, camera);
        // Meshes get half.
        let scene = WorldScene::open(&split.index, &split.world, camera, SIZE, 2 * budget).unwrap();
        let [wholes, previews, coarse] = scene.counts();
        assert!(wholes == 0 && previews == 0 && coarse >= least, "{wholes} {previews} {coarse}");
        let shown = picture(scene.mesh(), &scene.surface(FilterOptions::default()), camera);
        assert_eq!(holes(&shown, &expected, 10), 0, "{coarse}");
        let psnr = psnr_db(&shown, &expected).unwrap();
        println!("{coarse} coarse assets: {psnr:.1} dB");
        assert!(psnr > psnr_least, "{coarse}: {psnr} dB");
    }
    // With enough memory, it looks like the asset.
    let expected = picture(whole.mesh(), &surface, &near);
    let scene = WorldScene::open(&split.index, &split.world, &near, SIZE, 1 << 30).unwrap();
    assert_eq!(scene.coarse(), 0);
    let shown = picture(scene.mesh(), &scene.surface(FilterOptions::default()), &near);
    let psnr = psnr_db(&shown, &expected).unwrap();
    assert!(psnr > 33.0, "{psnr} dB");
}

#[test]
fn open_borders_of_the_whole_are_simplified_and_those_between_sectors_stay() {
    let folder = tempfile::tempdir().unwrap();
    let mut land = grid(96);
    land.positions.iter_mut().for_each(|p| p.z += 0.05 * (7.0 * p.x).sin() * (5.0 * p.y).cos());
    let whole = baked(folder.path(), fantex_test::cleaned(land), 200_000);
    let previews = SectorPreviews { triangles: Some(50), texels: Some(20_000) };
    let options = SplitOptions { triangles: 3000, previews: Some(previews), ..SplitOptions::default() };
    let split = split_into(&whole, &folder.path().join("world"), &options);
    let outline = border(whole.mesh());
    let mut simplified = 0;
    for sector in &split.sectors {
        let (fine, coarse) = (border(sector.mesh()), border(preview_of(sector).mesh()));
        let inner: BTreeSet<_> = fine.difference(&outline).copied().collect();
        let missing = inner.difference(&coarse).count();
        // The corner of a triangle with two sides at the outline may go.
        assert!(missing <= 2, "{missing} of {}", inner.len());
        simplified += fine.intersection(&outline).count() - coarse.intersection(&outline).count();
    }
    assert!(simplified * 2 > outline.len(), "{simplified} of {}", outline.len());
}

/// Sheets with both sides, fins on them, loose triangles and crossing walls.
fn dirty_mesh(seed: u64) -> Mesh {
    let random = |i: u64| nth_random(seed, i);
    let mut model = grid(24);
    model.positions.iter_mut().for_each(|p| p.z += 0.1 * (9.0 * p.x).sin());
    let front = model.triangles.clone();
    let vertices = model.positions.len() as u64;
    for (i, &[a, b, c]) in (0u64..).zip(&front) {
        if seed.is_multiple_of(2) || random(i) % 3 > 0 {
            model.triangles.push([a, c, b]);
        }
        if random(1000 + i) % 11 == 0 {
            let apex = model.positions.len() as u32;
            let lift = DVec3::new(0.0, 0.01, 0.1 + 0.01 * (random(2000 + i) % 8) as f64);
            model.positions.push(model.positions[a as usize] + lift);
            model.triangles.push([a, b, apex]);
        }
    }
    for i in 0..30 {
        let vertex = |k: u64| (random(10_000 + 3 * i + k) % vertices) as u32;
        model.triangles.push([vertex(0), vertex(1), vertex(2)]);
    }
    fantex_test::cleaned(model)
}

#[test]
fn dirty_meshes_are_split_as_they_are() {
    for seed in 1..=6 {
        let folder = tempfile::tempdir().unwrap();
        let whole = baked(folder.path(), dirty_mesh(seed), 60_000);
        assert!(verify_asset(whole.shared(), &VerifyOptions::default()).ok, "seed {seed}");
        let previews = SectorPreviews { triangles: Some(100), texels: Some(2000) };
        let options = SplitOptions { triangles: 90, previews: Some(previews), ..SplitOptions::default() };
        let split = split_into(&whole, &folder.path().join("world"), &options);
        println!(
            "seed {seed}: {} sectors of {} triangles",
            split.sectors.len(),
            whole.mesh().triangles.len()
        );
        // Where more than two triangles meet a sector cannot know of those beyond it that coarser texels show, too (docs/format.md).
        assert_sectors_are_the_whole_and_pass(&whole, &split.sectors, &VerifyOptions::default());
        split.sectors.iter().for_each(|sector| drop(preview_of(sector)));
        split.world.coarse.iter().for_each(|coarse| drop(open_coarse(&split, coarse)));
        // Edges of more than two triangles that are no two leaves tie their triangles together, but not the whole sheet.
        assert!(split.sectors.len() > 1 || seed % 2 == 1, "seed {seed}");
    }
}

#[test]
fn a_sheet_with_two_sides_is_cut_and_its_sides_stay_together() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = grid(40);
    model.positions.iter_mut().for_each(|p| p.z += 0.5 * (9.0 * p.x).sin() * (8.0 * p.y).cos());
    let back: Vec<_> = model.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    model.triangles.extend(back);
    let whole = baked(folder.path(), fantex_test::cleaned(model), 60_000);
    let options = SplitOptions { triangles: 800, previews: None, ..SplitOptions::default() };
    let split = split_into(&whole, &folder.path().join("world"), &options);
    assert!(
        split.sectors.len() >= 4,
        "{} sectors, {} groups",
        split.sectors.len(),
        whole.cover().groups.len()
    );
    assert_sectors_are_the_whole(&whole, &split.sectors);
    for sector in &split.sectors {
        let opposed = fantex::mesh::OpposedTriangles::of(&sector.mesh().triangles);
        assert!((0..sector.mesh().triangles.len()).all(|t| opposed.contains(t)));
    }
}

#[test]
fn a_small_asset_is_a_world_of_one_sector() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), ball_on_a_plane(), 50_000);
    let split = split_into(&whole, &folder.path().join("a/world"), &SplitOptions::default());
    assert_eq!(split.sectors.len(), 1);
    assert_sectors_are_the_whole(&whole, &split.sectors);
    assert_eq!(split.sectors[0].cover(), whole.cover());
    assert_eq!(split.world.objects[0].asset, "sector-0001.fan");
    preview_of(&split.sectors[0]);
}

/// Names of what is in a folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = folder.read_dir().unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Stops when so many reports have come.
struct Stop(AtomicU64);

impl Progress for Stop {
    fn report(&self, done: u64, total: u64) {
        assert!(done <= total);
        self.0.fetch_sub(1, Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed) == 0
    }
}

/// Removes what is in a folder while others write there.
struct Remover<'a>(&'a Path);

impl Progress for Remover<'_> {
    fn report(&self, _done: u64, _total: u64) {
        for entry in self.0.read_dir().unwrap() {
            std::fs::remove_dir_all(entry.unwrap().path()).unwrap();
        }
    }
}

/// Files are written in a folder that nobody knows, and an error names the place where they would have been.
#[test]
fn a_sector_that_cannot_be_written_is_called_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), bumpy_ball(), 10_000);
    let target = folder.path().join("world");
    let options = SplitOptions { triangles: 100, previews: None, ..SplitOptions::default() };
    let error = split(whole.shared(), &target, &options, &Remover(&target)).unwrap_err();
    let sector = target.join("sector-0001.fan");
    assert!(error.to_string().contains(&sector.display().to_string()), "{error}");
    assert!(!error.to_string().contains(".fantex-"), "{error}");
}

#[test]
fn nothing_is_left_of_a_world_that_is_not_finished() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), bumpy_ball(), 100_000);
    let target = folder.path().join("world");
    let options = SplitOptions { triangles: 4000, ..SplitOptions::default() };
    let error = split(whole.shared(), &target, &options, &Stop(AtomicU64::new(2))).unwrap_err();
    assert!(error.is_cancelled());
    assert!(!target.exists());

    // Neither is anything written over, unless that is wanted.
    std::fs::create_dir(&target).unwrap();
    std::fs::write(target.join("notes.txt"), "mine").unwrap();
    let error = split(whole.shared(), &target, &options, &NoProgress).unwrap_err();
    assert!(error.to_string().contains("is not empty"), "{error}");
    assert_eq!(names(&target), ["notes.txt"]);
    let forced = SplitOptions { force: true, ..options.clone() };
    let many = split(whole.shared(), &target, &forced, &NoProgress).unwrap().world.objects.len();
    let fewer = SplitOptions { triangles: 12_000, ..forced.clone() };
    let few = split(whole.shared(), &target, &fewer, &NoProgress).unwrap().world.objects.len();
    assert!(few < many);
    // Its files lie beside those of the world whose place it takes, until that goes.
    let mut expected: Vec<String> = (1..=few).map(|number| format!("sector-{number:04}-2.fan")).collect();
    expected.insert(0, "notes.txt".into());
    expected.push("whole.fanworld".into());
    assert_eq!(names(&target), expected);
    // A world stays as it is until the next one is there.
    split(whole.shared(), &target, &forced, &Stop(AtomicU64::new(2))).unwrap_err();
    assert_eq!(names(&target), expected);
    let report = fantex::verify_world(&target.join("whole.fanworld"), &VerifyOptions::default(), &NoProgress);
    assert!(report.unwrap().ok);
    let none = SplitOptions { triangles: 0, ..forced };
    assert_eq!(
        split(whole.shared(), &target, &none, &NoProgress).unwrap_err().kind(),
        ErrorKind::InvalidArgument
    );
}

#[test]
fn a_world_is_replaced_at_once_or_stays() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), bumpy_ball(), 100_000);
    let target = folder.path().join("world");
    let options = SplitOptions { triangles: 12_000, previews: None, force: true, ..SplitOptions::default() };
    let first = split(whole.shared(), &target, &options, &NoProgress).unwrap();
    let sectors = first.world.objects.len();
    let passes = || verify_world(&first.index, &VerifyOptions::default(), &NoProgress).unwrap().ok;
    let sector = |number: usize, generation: &str| format!("sector-{number:04}{generation}.fan");
    let of = |generation: &str| (1..=sectors).map(|number| sector(number, generation)).collect::<Vec<_>>();
    let asset_names =
        || names(&target).into_iter().filter(|name| name.starts_with("sector-")).collect::<Vec<_>>();
    assert_eq!(asset_names(), of(""));

    // An index that cannot be replaced: a folder has its name.
    let aside = folder.path().join("aside");
    std::fs::rename(&first.index, &aside).unwrap();
    std::fs::create_dir_all(first.index.join("a")).unwrap();
    split(whole.shared(), &target, &options, &NoProgress).unwrap_err();
    assert_eq!(asset_names(), of(""));
    std::fs::remove_dir_all(&first.index).unwrap();
    std::fs::rename(&aside, &first.index).unwrap();
    assert!(passes());

    // Nor is one that somebody else is changing.
    let lock = WriterLock::acquire(&first.index).unwrap();
    let error = split(whole.shared(), &target, &options, &NoProgress).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Conflict);
    drop(lock);
    assert!(passes() && asset_names() == of(""));

    // Nor is one on whose sector somebody paints.
    let lock = WriterLock::acquire(&target.join(sector(1, ""))).unwrap();
    let error = split(whole.shared(), &target, &options, &NoProgress).unwrap_err();
    assert!(error.kind() == ErrorKind::Conflict && error.to_string().contains(&sector(1, "")), "{error}");
    drop(lock);
    assert!(passes() && asset_names() == of(""));

    // What another world in the folder names stays; what belongs to none goes, such as a crash leaves; what cannot go is named.
    let other = target.join("other.fanworld");
    let objects = vec![first.world.objects[0].clone()];
    World { objects, ..World::default() }.write(&other).unwrap();
    std::fs::copy(target.join(sector(1, "")), target.join(sector(77, "-5"))).unwrap();
    // What has such a name and is no asset stays, too.
    std::fs::write(target.join("coarse-0078-5.fan"), "mine").unwrap();
    std::fs::create_dir(target.join(sector(9999, ""))).unwrap();
    let second = split(whole.shared(), &target, &options, &NoProgress).unwrap();
    assert_eq!(second.world.objects[0].asset, sector(1, "-2"));
    let [note] = &second.notes[..] else { panic!("{:?}", second.notes) };
    assert!(note.contains("sector-9999.fan") && !note.contains("sector-0001"), "{note}");
    std::fs::remove_dir(target.join(sector(9999, ""))).unwrap();
    let mut expected = of("-2");
    expected.push(sector(1, ""));
    expected.sort();
    assert_eq!(asset_names(), expected);
    assert_eq!(std::fs::read(target.join("coarse-0078-5.fan")).unwrap(), b"mine");
    assert!(passes() && World::open(&first.index).unwrap() == second.world);
    assert!(verify_world(&other, &VerifyOptions::default(), &NoProgress).unwrap().ok);

    // Which files belong to an index that cannot be read is not known.
    std::fs::write(&other, "old").unwrap();
    let error = split(whole.shared(), &target, &options, &NoProgress).unwrap_err().to_string();
    assert!(error.contains("belong to another world") && error.contains("other.fanworld"), "{error}");
    std::fs::remove_file(other).unwrap();
    let third = split(whole.shared(), &target, &options, &NoProgress).unwrap();
    assert_eq!(third.world.objects[0].asset, sector(1, "-3"));
    assert_eq!(asset_names(), of("-3"));
    assert!(passes());
}

#[test]
fn damaged_texels_are_not_copied() {
    let folder = tempfile::tempdir().unwrap();
    let whole = baked(folder.path(), ball_on_a_plane(), 50_000);
    let path: PathBuf = whole.path().into();
    let mut bytes = std::fs::read(&path).unwrap();
    let cluster = whole.cluster_range(whole.clusters().next().unwrap());
    bytes[cluster.start as usize + 20] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let whole = Asset::open(&path).unwrap();
    let target = folder.path().join("world");
    let error = split(whole.shared(), &target, &SplitOptions::default(), &NoProgress).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Damaged);
    assert!(error.to_string().contains("whole.fan"), "{error}");
    assert!(!target.exists());
}

/// A Sierpinski tetrahedron of `4^level` tetrahedra that meet at their corners: nothing of it can be simplified. Within -1..1, moved by `offset`.
fn sponge(level: u32, offset: DVec3) -> Model {
    let size = 1i64 << level;
    let mut tetrahedra =
        vec![[[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]].map(|c| c.map(|x| x * size))];
    for _ in 0..level {
        let smaller = |corners: [[i64; 3]; 4]| {
            corners.map(|own| corners.map(|other| [0, 1, 2].map(|k| (own[k] + other[k]) / 2)))
        };
        tetrahedra = tetrahedra.into_iter().flat_map(smaller).collect();
    }
    let (mut numbers, mut positions, mut triangles) = (BTreeMap::new(), Vec::new(), Vec::new());
    for corners in tetrahedra {
        let [a, b, c, d] = corners.map(|corner| {
            *numbers.entry(corner).or_insert_with(|| {
                positions.push(DVec3::from(corner.map(|x| x as f64 / size as f64)) + offset);
                positions.len() as u32 - 1
            })
        });
        triangles.extend([[a, b, c], [a, d, b], [a, c, d], [b, d, c]]);
    }
    Model { positions, triangles, materials: vec![Material::default()], ..Model::default() }
}

#[test]
fn what_cannot_be_simplified_gets_no_previews() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = fantex_test::cleaned(sponge(6, DVec3::ZERO));
    assert_eq!(mesh.triangles.len(), 16_384);
    let whole = baked(folder.path(), mesh, 300_000);
    let target = folder.path().join("world");
    let options = SplitOptions { triangles: 8200, ..SplitOptions::default() };
    let written = split(whole.shared(), &target, &options, &NoProgress).unwrap();
    assert_eq!(written.world.objects.len(), 2);
    assert!(written.world.objects.iter().all(|object| object.preview.is_none()));
    assert_eq!(written.notes.len(), 1);
    assert!(written.notes[0].contains("of 2 of 2 sectors"), "{}", written.notes[0]);
    assert!(verify_world(&written.index, &VerifyOptions::default(), &NoProgress).unwrap().ok);

    // What is asked for is made.
    let previews = Some(SectorPreviews { triangles: Some(8200), texels: None });
    let options = SplitOptions { previews, force: true, ..options };
    let written = split(whole.shared(), &target, &options, &NoProgress).unwrap();
    assert!(written.world.objects.iter().all(|object| object.preview.is_some()));
    assert!(written.notes.is_empty(), "{:?}", written.notes);
}

#[test]
fn beside_what_cannot_be_simplified_there_are_coarse_assets() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = sponge(6, DVec3::new(0.0, 3.0, 0.0));
    let first = model.positions.len() as u32;
    let land = icosphere(5);
    model.positions.extend(&land.positions);
    model.triangles.extend(land.triangles.iter().map(|corners| corners.map(|vertex| vertex + first)));
    let whole = baked(folder.path(), fantex_test::cleaned(model), 400_000);
    let target = folder.path().join("world");
    let options = SplitOptions { triangles: 500, ..SplitOptions::default() };
    let written = split(whole.shared(), &target, &options, &NoProgress).unwrap();
    let World { objects, coarse } = &written.world;
    assert!(objects.iter().all(|object| object.preview.is_some()), "small previews are made");
    let part_of_any = |asset: &String| coarse.iter().any(|coarse| coarse.parts.contains(asset));
    let roots = objects.iter().filter(|object| !part_of_any(&object.asset)).count();
    assert!(!coarse.is_empty() && roots > 0, "{} coarse assets, {roots} roots", coarse.len());
    assert_eq!(written.notes.len(), 1);
    assert!(written.notes[0].contains("coarse asset"), "{}", written.notes[0]);
    let names = names(&target);
    let files = names.iter().filter(|name| name.starts_with("coarse-")).count();
    assert_eq!(files, coarse.len());
    let report = verify_world(&written.index, &VerifyOptions::default(), &NoProgress).unwrap();
    let faults: Vec<&String> = report.coarse.iter().flat_map(|coarse| &coarse.faults).collect();
    assert!(report.ok, "{faults:?}");
}
