//! Pictures of the GPU against those of the CPU renderer, with the same camera, lights and filters.
//!
//! With one sample per pixel both take it in the pixel's middle, so that even silhouettes agree but for points within 1/256 of
//! a pixel of an edge. What remains: half floats in the GPU's frame (1/2000), its 8-bit weights of texture filters and
//! approximate level of detail, its bytes where the CPU has 16-bit mip levels. So at most 1 pixel in 1000 may differ by more
//! than 8 of 255 steps, and the mean by a tenth of a step; more where a test says why. (Mesa's software Vulkan needs half of
//! that.) Shadows are the same but for the terminator, where the CPU lifts receivers off their facets.

use std::sync::Arc;

use crate::common::{Scene, asset, data, embedded, gpu, loaded, loaded_from};
use fantex_gpu::{Frame, UvModel, frame_times};
use fantex_mesh::{
    AlphaMode, CleanOptions, CornerAttributes, Material, Mesh, Model, TextureRef, WrapMode, clean, generate,
};
use fantex_scene::{
    Background, Camera, Cookie, EnvironmentLight, Falloff, FilterOptions, Lens, Light, LightKind, Lights,
    Projector, Shading, ShadowOptions, SpotLight,
};
use fantex_texture::environment::{EnvironmentMap, PrefilteredEnvironment};
use fantex_texture::{ColorSpace, Filter, Image, ImageTexture, SampleOptions, Samples};
use glam::{DVec3, Mat3, Vec2, Vec3, Vec4};

fn bottle() -> Scene {
    Scene::of(loaded("WaterBottle/WaterBottle.gltf"))
}

fn forest() -> EnvironmentLight {
    let map = EnvironmentMap::load(asset("images/forest.exr")).unwrap();
    EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::new(map))))
}

/// A ball over a floor that is lit from above.
fn ball_on_floor() -> Mesh {
    let ball = generate::uv_sphere(48, 32);
    with_plates(&ball, &[Plate { height: -1.2, x: [-3.0, 3.0], z: [-3.0, 3.0] }])
}

/// A rectangle that faces upwards.
struct Plate {
    height: f64,
    x: [f64; 2],
    z: [f64; 2],
}

/// A model, or an empty one, and plates.
fn with_plates(model: &Model, plates: &[Plate]) -> Mesh {
    let (mut positions, mut triangles) = (model.positions.clone(), model.triangles.clone());
    for &Plate { height, x: [left, right], z: [back, front] } in plates {
        let first = positions.len() as u32;
        let corners = [[left, back], [right, back], [right, front], [left, front]];
        positions.extend(corners.map(|[x, z]| DVec3::new(x, height, z)));
        triangles.extend([[first, first + 2, first + 1], [first, first + 3, first + 2]]);
    }
    let model = Model { positions, triangles, materials: vec![Material::default()], ..Model::default() };
    clean(model, &CleanOptions::default()).unwrap().0
}

/// A floor at depth 4 below a lamp, seen through a slit between a plate at depth 1 and one at depth 3.
fn slit_over_floor() -> Mesh {
    let floor = Plate { height: 0.0, x: [-2.0, 2.0], z: [-2.0, 2.0] };
    let upper = Plate { height: 3.0, x: [-0.4, -0.06], z: [-0.3, 0.3] };
    let lower = Plate { height: 1.0, x: [0.18, 1.2], z: [-0.9, 0.9] };
    with_plates(&Model::default(), &[floor, upper, lower])
}

fn lit_by(kind: LightKind, shadow: Option<ShadowOptions>) -> Lights {
    let lamps = vec![Light { kind, color: Vec3::new(0.9, 0.8, 0.6), shadow }];
    Lights { lamps, ..Lights::default() }
}

/// A unit square in the xy plane with texture coordinates and a texture.
pub(crate) fn textured_square(image: &Image, material: Material) -> Mesh {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let triangles: Vec<[u32; 3]> = vec![[0, 1, 2], [0, 2, 3]];
    let uv = triangles
        .iter()
        .flatten()
        .map(|&v| positions[v as usize].truncate())
        .map(|p| Vec2::new(p.x, 1.0 - p.y));
    let uv_sets = vec![uv.collect()];
    let texture = TextureRef {
        image: 0,
        uv_set: 0,
        uv_transform: Mat3::from_scale(Vec2::splat(3.0)),
        wrap: [WrapMode::Repeat, WrapMode::Mirror],
        nearest: false,
    };
    Mesh {
        positions,
        corners: CornerAttributes { uv_sets, ..CornerAttributes::default() },
        triangles,
        materials: vec![Material { base_color_texture: Some(texture), ..material }],
        images: vec![embedded(image)],
        ..Mesh::default()
    }
}

/// Coloured discs on nothing: RGBA.
pub(crate) fn discs(side: u32) -> Image {
    let texel = |i: u32| {
        let [x, y] = [i % side, i / side].map(|c| (c as f32 + 0.5) / side as f32);
        let wave = |f: f32| 0.5 + 0.5 * (f * 12.6).sin();
        let alpha = (1.5 - 5.0 * ((x - 0.5).hypot(y - 0.5))).clamp(0.0, 1.0);
        [wave(x), wave(y), 0.3, alpha].map(|v| (v * 255.0).round() as u8)
    };
    let samples = Samples::U8((0..side * side).flat_map(texel).collect());
    Image { width: side, height: side, channels: 4, space: ColorSpace::Srgb, samples }
}

#[test]
fn a_textured_model_in_the_sun() {
    let Some(gpu) = gpu() else { return };
    bottle().compare(&gpu, "bottle-sun").assert_below(0.1, 8, 0.001);
}

#[test]
fn a_textured_model_in_an_environment() {
    let Some(gpu) = gpu() else { return };
    let mut scene = bottle();
    scene.lights = Lights::environment(EnvironmentLight { rotation_degrees: 70.0, ..forest() });
    scene.background = Background::Environment { blur: 0.0 };
    scene.exposure = 1.5;
    // The sky box is a cube here and a sphere there, and one trilinear look-up instead of up to 16.
    scene.compare(&gpu, "bottle-forest").assert_below(0.7, 8, 0.01);
    scene.background = Background::Environment { blur: 0.4 };
    scene.compare(&gpu, "bottle-forest-blurred").assert_below(0.2, 8, 0.002);
}

#[test]
fn the_inputs_of_lighting() {
    let Some(gpu) = gpu() else { return };
    for shading in [
        Shading::BlinnPhong,
        Shading::BaseColor,
        Shading::Normal,
        Shading::OcclusionRoughnessMetallic,
        Shading::Emission,
    ] {
        let scene = Scene { shading, ..bottle() };
        scene.compare(&gpu, &format!("bottle-{shading:?}")).assert_below(0.1, 8, 0.001);
    }
}

#[test]
fn filters() {
    let Some(gpu) = gpu() else { return };
    let image = Image::load(asset("images/uv_checker_bw.png")).unwrap();
    for (filter, mean, share) in [
        (Filter::Nearest, 0.1, 0.001),
        (Filter::Bilinear, 0.1, 0.001),
        (Filter::Trilinear, 0.3, 0.002),
        // Devices spread their probes as they like.
        (Filter::Anisotropic, 2.5, 0.12),
    ] {
        let mesh = textured_square(&image, Material { unlit: true, ..Material::default() });
        let mut scene = Scene::of(mesh);
        scene.camera = Camera {
            eye: DVec3::new(0.5, -0.7, 0.35),
            target: DVec3::new(0.5, 0.4, 0.0),
            up: DVec3::Z,
            fov_degrees: 45.0,
        };
        scene.filter = FilterOptions { filter, max_anisotropy: 16.0 };
        scene.compare(&gpu, &format!("filter-{filter:?}")).assert_below(mean, 8, share);
    }
}

#[test]
fn alpha_modes() {
    let Some(gpu) = gpu() else { return };
    for alpha in [AlphaMode::Opaque, AlphaMode::Mask(0.5), AlphaMode::Blend] {
        let material = Material { alpha, base_color: Vec4::new(1.0, 0.8, 0.9, 0.9), ..Material::default() };
        let mut scene = Scene::of(textured_square(&discs(64), material));
        // Cards decide sample by sample what is cut out; the CPU gives every pixel its share.
        let is_cut_out = matches!(alpha, AlphaMode::Mask(_));
        scene.samples = if is_cut_out { 4 } else { 1 };
        let (mean, level, share) = if is_cut_out { (0.15, 32, 0.004) } else { (0.1, 8, 0.001) };
        for background in [Background::default(), Background::Transparent] {
            scene.background = background;
            let name = format!("alpha-{alpha:?}-{}", background == Background::Transparent);
            scene.compare(&gpu, &name).assert_below(mean, level, share);
        }
    }
}

#[test]
fn layers_behind_each_other() {
    let Some(gpu) = gpu() else { return };
    let mut model = generate::uv_sphere(24, 16);
    model.materials[0].alpha = AlphaMode::Blend;
    model.materials[0].base_color = Vec4::new(0.9, 0.3, 0.2, 0.5);
    let mesh = clean(model, &CleanOptions::default()).unwrap().0;
    Scene::of(mesh).compare(&gpu, "glass-ball").assert_below(0.1, 8, 0.001);
}

/// A sheet with both of its sides as triangles, bent so that no depth is like another: in front red, behind green.
pub(crate) fn two_sided_sheet() -> Mesh {
    let n = 24;
    let at = |i: u32| f64::from(i) / f64::from(n) * 2.0 - 1.0;
    let mut model = Model { materials: vec![Material::default(); 2], ..Model::default() };
    for (y, x) in (0..=n).flat_map(|y| (0..=n).map(move |x| (y, x))) {
        model.positions.push(DVec3::new(at(x), at(y), 0.3 * (at(x) * 2.0).sin() * at(y)));
    }
    for (y, x) in (0..n).flat_map(|y| (0..n).map(move |x| (y, x))) {
        let [a, b, c, d] = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| y * (n + 1) + x);
        // Now the one side comes first, now the other.
        for [a, b, c] in [[a, b, c], [c, b, d]] {
            let (front, back) = (([a, b, c], 0), ([a, c, b], 1));
            for (triangle, material) in if (x + y) % 2 == 0 { [front, back] } else { [back, front] } {
                model.triangles.push(triangle);
                model.triangle_materials.push(material);
            }
        }
    }
    model.materials[0].base_color = Vec4::new(0.9, 0.05, 0.05, 1.0);
    model.materials[1].base_color = Vec4::new(0.05, 0.7, 0.1, 1.0);
    model.materials.iter_mut().for_each(|material| material.double_sided = true);
    clean(model, &CleanOptions::default()).unwrap().0
}

/// Each side is seen from its front, though both are double-sided and equally near.
#[test]
fn both_sides_of_a_sheet() {
    let Some(gpu) = gpu() else { return };
    for alpha in [AlphaMode::Opaque, AlphaMode::Mask(0.5), AlphaMode::Blend] {
        let mut mesh = two_sided_sheet();
        mesh.materials.iter_mut().for_each(|material| material.alpha = alpha);
        let mut scene = Scene::of(mesh);
        scene.shading = Shading::BaseColor;
        for (z, red) in [(1.0, true), (-1.0, false)] {
            scene.camera = Camera::framing_mesh(&scene.mesh, DVec3::new(0.3, 0.2, z), 4.0 / 3.0);
            scene.compare(&gpu, "sheet").assert_below(0.05, 4, 0.001);
            for picture in [scene.on_cpu(), scene.on_gpu(&gpu)] {
                let coloured = || picture.rgba.iter().filter(|p| (p[0] - p[1]).abs() > 0.2);
                assert!(coloured().count() > 10_000);
                assert!(coloured().all(|p| (p[0] > p[1]) == red), "{alpha:?} from {z}");
            }
        }
    }
}

#[test]
fn vertex_colors_and_single_sides() {
    let Some(gpu) = gpu() else { return };
    let mut mesh = loaded("models/suzanne.ply");
    let color = |p: Vec3| (p * 0.5 + 0.5).extend(1.0);
    mesh.corners.colors =
        mesh.triangles.iter().flatten().map(|&v| color(mesh.positions[v as usize])).collect();
    mesh.materials[0].double_sided = false;
    mesh.materials[0].metallic = 0.4;
    mesh.materials[0].roughness = 0.35;
    let mut scene = Scene::of(mesh);
    scene.compare(&gpu, "suzanne-colors").assert_below(0.05, 4, 0.001);
    // Into the open neck.
    scene.camera = Camera::framing_mesh(&scene.mesh, DVec3::new(0.1, -1.0, -0.3), 4.0 / 3.0);
    scene.compare(&gpu, "suzanne-from-below").assert_below(0.05, 4, 0.001);
}

#[test]
fn conformance_models() {
    let (Some(gpu), Some(folder)) = (gpu(), data("conformance/gltf")) else { return };
    let mut names: Vec<_> =
        std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    for name in names {
        let name = name.to_str().unwrap();
        let files = [format!("{name}.gltf"), format!("{name}.glb")].map(|file| folder.join(name).join(file));
        let Some(path) = files.iter().find(|path| path.exists()) else { continue };
        let mut scene = Scene::of(loaded_from(path));
        scene.camera = Camera::framing_mesh(&scene.mesh, DVec3::new(0.1, 0.1, 1.0), 4.0 / 3.0);
        scene.compare(&gpu, &format!("conformance-{name}")).assert_below(0.15, 8, 0.001);
    }
}

#[test]
fn shadows_of_all_lamps() {
    let Some(gpu) = gpu() else { return };
    let position = DVec3::new(-1.5, 2.5, 1.0);
    let falloff = Falloff::InverseSquare { reference: 2.5, range: Some(12.0) };
    let spot = SpotLight {
        position,
        direction: Vec3::new(0.5, -0.9, -0.35),
        inner_degrees: 20.0,
        outer_degrees: 35.0,
        falloff,
    };
    let lamps = [
        ("sun", LightKind::Directional { to_light: Vec3::new(-0.5, 0.8, 0.4) }),
        ("point", LightKind::Point { position, falloff }),
        ("spot", LightKind::Spot(spot)),
    ];
    let mesh = ball_on_floor();
    for (name, kind) in lamps {
        for (kind_of_border, softness, lamp_radius) in
            [("sharp", 0.0, None), ("even", 0.1, None), ("lamp", 0.0, Some(0.15))]
        {
            let shadow = ShadowOptions { resolution: 512, softness, lamp_radius, ..ShadowOptions::default() };
            let scene = Scene { lights: lit_by(kind.clone(), Some(shadow)), ..Scene::of(mesh.clone()) };
            let difference = scene.compare(&gpu, &format!("shadow-{name}-{kind_of_border}"));
            difference.assert_below(0.05, 8, 0.002);
        }
    }
}

#[test]
fn wide_penumbrae_and_coarse_cubes() {
    let Some(gpu) = gpu() else { return };
    let kind = LightKind::Point { position: DVec3::new(-0.6, 2.5, 0.4), falloff: Falloff::None };
    let mesh = ball_on_floor();
    for (name, resolution, softness, lamp_radius) in
        [("even", 2048, 0.4, None), ("lamp", 1024, 0.0, Some(0.8)), ("coarse", 16, 0.0, None)]
    {
        let shadow = ShadowOptions { resolution, softness, lamp_radius, ..ShadowOptions::default() };
        let scene = Scene { lights: lit_by(kind.clone(), Some(shadow)), ..Scene::of(mesh.clone()) };
        scene.compare(&gpu, &format!("shadow-wide-{name}")).assert_below(0.05, 8, 0.002);
    }
}

/// Blockers at several depths within one search: their mean depth is that of depths, not of what the map stores.
#[test]
fn penumbrae_behind_blockers_at_different_heights() {
    let Some(gpu) = gpu() else { return };
    let position = DVec3::new(0.0, 4.0, 0.0);
    let spot = SpotLight {
        position,
        direction: Vec3::NEG_Y,
        inner_degrees: 30.0,
        outer_degrees: 40.0,
        falloff: Falloff::None,
    };
    let lamps = [
        ("point", LightKind::Point { position, falloff: Falloff::None }),
        ("spot", LightKind::Spot(spot)),
        ("sun", LightKind::Directional { to_light: Vec3::new(-0.05, 1.0, 0.0) }),
    ];
    let mesh = slit_over_floor();
    for (name, kind) in lamps {
        let shadow = ShadowOptions { resolution: 1024, lamp_radius: Some(0.4), ..ShadowOptions::default() };
        let camera = Camera::framing_mesh(&mesh, DVec3::new(-0.4, 0.7, 1.0), 4.0 / 3.0);
        let scene = Scene { camera, lights: lit_by(kind, Some(shadow)), ..Scene::of(mesh.clone()) };
        scene.compare(&gpu, &format!("shadow-slit-{name}")).assert_below(0.05, 8, 0.002);
    }
}

#[test]
fn shadows_on_curved_models() {
    let Some(gpu) = gpu() else { return };
    let shadow = ShadowOptions { resolution: 1024, ..ShadowOptions::default() };
    for (samples, share) in [(1, 0.001), (4, 0.002)] {
        let lights = Lights::sun(Vec3::new(-0.6, 0.9, 0.5)).with_shadows(shadow);
        let scene = Scene { samples, lights, ..Scene::of(loaded("models/spot.obj")) };
        scene.compare(&gpu, &format!("spot-shadow-{samples}")).assert_below(0.2, 8, share);
    }
}

#[test]
fn projectors() {
    let Some(gpu) = gpu() else { return };
    let image = Arc::new(ImageTexture::new(Arc::new(Image::load(asset("images/brick.png")).unwrap())));
    let above = [DVec3::new(-1.0, 3.0, 1.5), DVec3::new(0.3, -1.0, 0.0)];
    // What lies behind a lamp casts no shadow.
    let below_the_ball = [DVec3::new(0.6, -0.9, 0.6), DVec3::new(0.9, -1.2, 0.9)];
    for (name, lens, [position, target]) in [
        ("perspective", Lens::Perspective { fov_degrees: 50.0 }, above),
        ("orthographic", Lens::Orthographic { height: 2.5 }, above),
        ("orthographic-below", Lens::Orthographic { height: 2.5 }, below_the_ball),
    ] {
        let projector = Projector {
            position,
            target,
            up: DVec3::Y,
            lens,
            aspect: 1.3,
            cookie: Cookie::Image { image: Arc::clone(&image), options: SampleOptions::default() },
            falloff: Falloff::None,
        };
        let lights = lit_by(LightKind::Projector(projector), Some(ShadowOptions::default()));
        let scene = Scene { lights, ..Scene::of(ball_on_floor()) };
        scene.compare(&gpu, &format!("projector-{name}")).assert_below(0.1, 8, 0.002);
    }
}

#[test]
fn four_samples() {
    let Some(gpu) = gpu() else { return };
    // The samples lie elsewhere in the pixel, so edges differ by what they cover.
    let scene = Scene { samples: 4, ..bottle() };
    scene.compare(&gpu, "bottle-four-samples").assert_below(0.15, 24, 0.002);
}

#[test]
fn frames_are_timed() {
    let Some(gpu) = gpu() else { return };
    let scene = bottle();
    let mut model = UvModel::load(&gpu, &scene.mesh).unwrap();
    let options = scene.options();
    let (camera, lights) = (&scene.camera, &scene.lights);
    let mut frame = Frame { size: [1280, 720], camera, lights, model: &mut model, options: &options };
    let times = frame_times(&gpu, &mut frame, 5).unwrap();
    assert_eq!(times.all.len(), 5);
    assert!(!times.minimum().is_zero() && times.minimum() <= times.median());
    println!("{}: {:?} per frame, median {:?}", gpu.info().name, times.minimum(), times.median());
}
