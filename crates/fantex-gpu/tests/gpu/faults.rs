//! What happens when something is wrong: with the device, the target, the camera, the lights, the model.

use crate::common;
use crate::common::{Scene, gpu, loaded};
use fantex_base::{Error, ErrorKind};
use fantex_gpu::{DrawOptions, Frame, Gpu, GpuOptions, PictureRenderer, UvModel, render_to_picture};
use fantex_mesh::{CleanOptions, Mesh, clean, generate};
use fantex_scene::{Camera, Light, Lights, Shading, ShadowOptions};
use fantex_texture::material::MaterialTextures;
use glam::{DVec3, Vec3};

fn ball() -> Mesh {
    clean(generate::uv_sphere(16, 8), &CleanOptions::default()).unwrap().0
}

/// The error of a frame that is changed before it is drawn.
fn error_of(gpu: &Gpu, change: impl FnOnce(&mut Scene)) -> Error {
    let mut scene = Scene { size: [32, 32], ..Scene::of(ball()) };
    change(&mut scene);
    let mut model = UvModel::load(gpu, &scene.mesh).unwrap();
    let options = scene.options();
    let (camera, lights) = (&scene.camera, &scene.lights);
    render_to_picture(
        gpu,
        &mut Frame { size: scene.size, camera, lights, model: &mut model, options: &options },
    )
    .unwrap_err()
}

#[test]
fn a_lost_device_is_an_error_and_a_new_one_works() {
    let Some(gpu) = gpu() else { return };
    let scene = Scene { size: [32, 24], ..Scene::of(ball()) };
    let before = scene.on_gpu(&gpu);
    gpu.device.destroy();
    gpu.wait().ok();
    let options = scene.options();
    let mut model = match UvModel::load(&gpu, &scene.mesh) {
        Ok(model) => model,
        Err(error) => panic!("making a model only records commands: {error}"),
    };
    let (camera, lights) = (&scene.camera, &scene.lights);
    let mut frame = Frame { size: scene.size, camera, lights, model: &mut model, options: &options };
    let error = render_to_picture(&gpu, &mut frame).unwrap_err();
    assert!(error.kind() == ErrorKind::Unavailable && gpu.lost().is_some(), "{error}");
    let again = common::gpu().unwrap();
    assert_eq!(scene.on_gpu(&again), before);
}

#[test]
fn software_can_be_asked_for() {
    match Gpu::headless(&GpuOptions { software: true }) {
        Ok(gpu) => {
            assert!(gpu.info().is_software && !gpu.has_block_compression(), "{:?}", gpu.info());
        }
        Err(error) => {
            assert_eq!(error.kind(), ErrorKind::Unavailable, "{error}");
            assert!(error.to_string().contains("`fantex render` without --gpu"), "{error}");
            fantex_test::skip(&error.to_string());
        }
    }
}

#[test]
fn textures_count_their_bytes() {
    let Some(gpu) = gpu() else { return };
    let bottle = UvModel::load(&gpu, &loaded("WaterBottle/WaterBottle.gltf")).unwrap();
    // Four images of 2048 x 2048 and their levels; occlusion and roughness share one.
    let texels: u64 = (0..12).map(|level| 1 << (2 * (11 - level))).sum();
    assert_eq!(bottle.texture_bytes(), 4 * 4 * texels);
    assert_eq!(UvModel::load(&gpu, &ball()).unwrap().texture_bytes(), 0);
}

#[test]
fn targets_without_pixels_are_no_error() {
    let Some(gpu) = gpu() else { return };
    for size in [[0, 0], [0, 24], [32, 0]] {
        let scene = Scene { size, ..Scene::of(ball()) };
        assert!(scene.on_gpu(&gpu).rgba.is_empty());
    }
}

#[test]
fn one_renderer_draws_any_size_model_and_lights() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = PictureRenderer::new(&gpu);
    let mut models =
        [ball(), loaded("models/suzanne.ply")].map(|mesh| (UvModel::load(&gpu, &mesh).unwrap(), mesh));
    let sizes = [[64, 48], [1, 1], [48, 64], [64, 48]];
    for (i, size) in sizes.into_iter().enumerate() {
        let (model, mesh) = &mut models[i % 2];
        let mut scene = Scene { size, ..Scene::of(mesh.clone()) };
        scene.lights.lamps.extend((1..i).map(|k| Light::directional(Vec3::X * k as f32, Vec3::splat(0.2))));
        if i >= 2 {
            scene.lights =
                scene.lights.with_shadows(ShadowOptions { resolution: 64 << i, ..Default::default() });
        }
        let options = scene.options();
        let (camera, lights) = (&scene.camera, &scene.lights);
        let mut frame = Frame { size, camera, lights, model, options: &options };
        let kept = renderer.render(&gpu, &mut frame).unwrap();
        assert_eq!(kept, scene.on_gpu(&gpu), "picture {i} does not depend on those before it");
    }
}

#[test]
fn pictures_that_cannot_be_drawn_say_why() {
    let Some(gpu) = gpu() else { return };
    let side = gpu.limits().max_texture_dimension_2d + 1;
    let large = error_of(&gpu, |scene| scene.size = [side, 1]);
    assert_eq!(large.kind(), ErrorKind::TooLarge, "{large}");
    let odd = error_of(&gpu, |scene| scene.samples = 3);
    assert!(odd.to_string().contains("3 samples per pixel"), "{odd}");
    let blind = error_of(&gpu, |scene| scene.camera.eye = DVec3::splat(f64::NAN));
    assert!(blind.to_string().contains("cannot render from this camera"), "{blind}");
    let dark = error_of(&gpu, |scene| {
        scene.lights.lamps.push(Light::directional(Vec3::ZERO, Vec3::ONE));
    });
    assert!(dark.to_string().contains("lamp 1 of the scene"), "{dark}");
    assert!([odd, blind, dark].iter().all(|error| error.kind() == ErrorKind::InvalidArgument));
}

#[test]
fn odd_meshes_are_drawn() {
    let Some(gpu) = gpu() else { return };
    let mut empty = Scene { size: [16, 16], ..Scene::of(Mesh::default()) };
    empty.lights = Lights::default().with_shadows(ShadowOptions::default());
    assert_eq!(empty.on_gpu(&gpu).rgba.len(), 256);
    // No material at all.
    let mut bare = Scene { size: [16, 16], ..Scene::of(ball()) };
    bare.mesh.materials.clear();
    assert_eq!(bare.on_gpu(&gpu).rgba.len(), 256);
    // From inside, and from far away.
    let mut scene = Scene { size: [16, 16], shading: Shading::BaseColor, ..Scene::of(ball()) };
    for eye in [DVec3::new(0.1, 0.0, 0.0), DVec3::Z * 1e6] {
        scene.camera = Camera { eye, target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 40.0 };
        let picture = scene.on_gpu(&gpu);
        assert!(picture.rgba.iter().flatten().all(|v| v.is_finite()));
    }
}

#[test]
fn too_many_sets_of_coordinates_are_refused() {
    let Some(gpu) = gpu() else { return };
    let mesh = loaded("WaterBottle/WaterBottle.gltf");
    let (textures, _) = fantex_texture::material::load_material_textures(&mesh).unwrap();
    let many: Vec<MaterialTextures> = (0..5)
        .map(|uv_set| {
            let mut textures = textures[0].clone();
            textures.base_color.as_mut().unwrap().uv_set = uv_set;
            textures
        })
        .collect();
    let error = UvModel::new(&gpu, &mesh, &many).unwrap_err();
    assert!(error.to_string().contains("5 sets of texture coordinates"), "{error}");
}

#[test]
fn loading_textures_tells_how_far_it_is() {
    let Some(gpu) = gpu() else { return };
    let mesh = loaded("WaterBottle/WaterBottle.gltf");
    let told = std::sync::Mutex::new(Vec::new());
    UvModel::load_with_progress(&gpu, &mesh, &|share| told.lock().unwrap().push(share)).unwrap();
    let mut told = told.into_inner().unwrap();
    assert_eq!(told.last(), Some(&1.0));
    // Threads tell theirs in any order.
    told.sort_by(f32::total_cmp);
    assert!(told.len() > 4 && told[0] > 0.0 && told[0] < 0.3, "{told:?}");
}

#[test]
fn lines_are_drawn_over_the_model() {
    let Some(gpu) = gpu() else { return };
    let scene = Scene { size: [64, 64], shading: Shading::BaseColor, ..Scene::of(ball()) };
    let mut model = UvModel::load(&gpu, &scene.mesh).unwrap();
    let draw = |options: &DrawOptions, model: &mut UvModel| {
        let (camera, lights) = (&scene.camera, &scene.lights);
        render_to_picture(&gpu, &mut Frame { size: scene.size, camera, lights, model, options }).unwrap()
    };
    let plain = draw(&scene.options(), &mut model);
    let lines = fantex_gpu::WireframeOptions { color: Vec3::X, opacity: 1.0 };
    let lined = draw(&DrawOptions { wireframe: Some(lines), ..scene.options() }, &mut model);
    let red = |p: &fantex_scene::Picture| p.rgba.iter().filter(|p| p[0] == 1.0 && p[1] == 0.0).count();
    assert_eq!(red(&plain), 0);
    assert!((200..2500).contains(&red(&lined)), "{} pixels of lines", red(&lined));
}
