//! Pictures to look at: what textures drive in lighting, on real models. Run with `-- --ignored`; they go to the folder for
//! temporary files as `lighting-*.png`.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod common;

use std::sync::Arc;

use common::looks::{UvImage, bars, ground, image, in_front, look, model, standing};
use fantex_mesh::Mesh;
use fantex_render::{
    AmbientLight, Camera, Falloff, Lens, Light, LightKind, Lights, LookSurface, Penumbra, Projector,
    RenderOptions, Scene, SceneObject, ShadowOptions, Slide, SpotLight, Surface, render,
};
use fantex_texture::look::{LookMaterial, Opacity, Slot};
use fantex_texture::{ImageTexture, SampleOptions};
use glam::{DAffine3, DQuat, DVec3, Vec3};

fn save(name: &str, mesh: &Mesh, surface: &dyn Surface, camera: &Camera, lights: &Lights) {
    let options = RenderOptions { width: 720, height: 480, ..RenderOptions::default() };
    let rendering = render(mesh, surface, camera, lights, &options).unwrap();
    eprintln!("{name}: {:?}", rendering.stats.elapsed);
    let path = std::env::temp_dir().join(format!("lighting-{name}.png"));
    rendering.picture.to_srgb_image().save(&path).unwrap();
}

/// A model on a floor.
fn on_floor(name: &str, mesh: &Mesh, material: LookMaterial, camera: &Camera, lights: &Lights) {
    let (floor, turn) = (
        ground(),
        if name.starts_with("teapot") { DQuat::from_rotation_x(-1.5708) } else { DQuat::IDENTITY },
    );
    let plain = LookMaterial { base_color: Slot::color(Vec3::splat(0.6)), ..LookMaterial::default() };
    let below = LookSurface::new(&floor, look(plain));
    let surface = LookSurface::new(mesh, look(material));
    let scene = Scene::new(vec![
        SceneObject::new(&floor, &below).placed(DAffine3::from_scale(DVec3::splat(8.0))),
        SceneObject::new(mesh, &surface).placed(standing(mesh, turn)),
    ])
    .unwrap();
    save(name, scene.mesh(), &scene, camera, lights);
}

fn lamp(kind: LightKind, color: f32, shadow: ShadowOptions) -> Lights {
    Lights {
        ambient: AmbientLight::uniform(Vec3::splat(0.15)),
        lamps: vec![Light::new(kind, Vec3::splat(color)).with_shadow(shadow)],
    }
}

#[test]
#[ignore = "makes pictures to look at"]
fn shadows() {
    let sun = || Lights::sun(Vec3::new(-0.9, 0.9, 0.5));
    let plain = LookMaterial::default;
    for (name, file) in [
        ("bunny", "meshes/bunny/stanford_bunny.ply"),
        ("suzanne", "meshes/suzanne.ply"),
        ("spot", "meshes/spot/spot_triangulated.obj"),
        ("teapot", "meshes/teapot.stl"),
    ] {
        let Some(mesh) = model(file) else { continue };
        let sharp = sun().with_shadows(ShadowOptions::default());
        on_floor(&format!("{name}-sun"), &mesh, plain(), &in_front(6.0), &sharp);
        let soft = ShadowOptions { penumbra: Penumbra::Lamp(0.1), ..ShadowOptions::default() };
        on_floor(&format!("{name}-soft"), &mesh, plain(), &in_front(6.0), &sun().with_shadows(soft));
        let low = Lights::sun(Vec3::new(-0.9, 0.15, 0.3)).with_shadows(ShadowOptions::default());
        on_floor(&format!("{name}-low"), &mesh, plain(), &in_front(6.0), &low);
    }
}

#[test]
#[ignore = "makes pictures to look at"]
fn lamps() {
    let Some(mesh) = model("meshes/suzanne.ply") else { return };
    let falloff = Falloff::InverseSquare { reference: 2.5, range: None };
    let position = DVec3::new(-1.5, 2.0, 1.8);
    let point = lamp(LightKind::Point { position, falloff }, 0.9, ShadowOptions::default());
    on_floor("suzanne-point", &mesh, LookMaterial::default(), &in_front(6.0), &point);
    let direction = (DVec3::Y * 0.8 - position).as_vec3();
    let spot = SpotLight { position, direction, inner_degrees: 18.0, outer_degrees: 24.0, falloff };
    let spot = lamp(LightKind::Spot(spot), 0.9, ShadowOptions::default());
    on_floor("suzanne-spot", &mesh, LookMaterial::default(), &in_front(6.0), &spot);
    let (Some(slide), Some(bunny)) = (image("images/kodim03.png"), model("meshes/bunny/stanford_bunny.ply"))
    else {
        return;
    };
    let projector = Projector {
        position: DVec3::new(-1.0, 2.2, 3.5),
        target: DVec3::new(0.0, 0.8, 0.0),
        up: DVec3::Y,
        lens: Lens::Perspective { fov_degrees: 32.0 },
        aspect: 1.5,
        slide: Slide::Image {
            image: Arc::new(ImageTexture::new(Arc::new(slide))),
            options: SampleOptions::default(),
        },
        falloff: Falloff::None,
    };
    let lights = lamp(LightKind::Projector(projector), 1.0, ShadowOptions::default());
    on_floor("bunny-projector", &bunny, LookMaterial::default(), &in_front(6.0), &lights);
}

#[test]
#[ignore = "makes pictures to look at"]
fn fence() {
    let (floor, panel) = (ground(), common::square());
    let plain = LookMaterial { base_color: Slot::color(Vec3::splat(0.6)), ..LookMaterial::default() };
    let below = LookSurface::new(&floor, look(plain));
    let cut_out = LookMaterial {
        base_color: Slot::Texture(UvImage::new(bars(256, 32, 8), 2.0)),
        opacity: Opacity::Mask { threshold: 0.5 },
        ..LookMaterial::default()
    };
    let surface = LookSurface::new(&panel, look(cut_out));
    let mut objects = vec![SceneObject::new(&floor, &below).placed(DAffine3::from_scale(DVec3::splat(40.0)))];
    for i in 0..10 {
        let at = DVec3::new(1.5 * f64::from(i) - 2.0, 1.0, 1.0 - 2.0 * f64::from(i));
        let size = DVec3::splat(2.0);
        let place = DAffine3::from_scale_rotation_translation(size, DQuat::from_rotation_y(0.3), at);
        objects.push(SceneObject::new(&panel, &surface).placed(place));
    }
    let scene = Scene::new(objects).unwrap();
    let shadow = ShadowOptions { resolution: 4096, ..ShadowOptions::default() };
    let lights = Lights::sun(Vec3::new(-0.6, 0.9, 0.5)).with_shadows(shadow);
    save("fence", scene.mesh(), &scene, &in_front(7.0), &lights);
}
