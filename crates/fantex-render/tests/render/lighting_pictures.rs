//! Pictures to look at: what textures drive in lighting, on real models. Run with `-- --ignored`; they go to the folder for
//! temporary files as `lighting-*.png`.

use crate::common;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use crate::common::looks::{Function, UvImage, bars, ground, image, in_front, look, model, standing};
use fantex_mesh::Mesh;
use fantex_render::{
    AmbientLight, Background, Camera, Falloff, Glow, Lens, Light, LightKind, Lights, LookSurface, Penumbra,
    Projector, RenderOptions, Scene, SceneObject, ShadowOptions, Slide, SpotLight, Surface, ToneMap, render,
    render_with_glow,
};
use fantex_texture::look::{
    Anisotropy, ColorUse, Difference, LightingModel, LookMaterial, Opacity, Relief, Slot,
};
use fantex_texture::noise::{Fractal, Noise};
use fantex_texture::{ColorRamp, ImageTexture, RampInterpolation, SampleOptions, ShadingPoint, Texture};
use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};

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
        if name.starts_with("teapot") { DQuat::from_rotation_x(-FRAC_PI_2) } else { DQuat::IDENTITY },
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

/// fBm over the position, band-limited.
fn rough(frequency: f32) -> Arc<dyn Texture> {
    let noise = Noise::new(7);
    Arc::new(Function(move |at: &ShadingPoint<'_>| {
        let height = noise.fbm(at.position * frequency, Fractal::octaves(5), at.width() * frequency);
        Vec4::splat(height)
    }))
}

fn bump(texture: Arc<dyn Texture>, height: f32) -> Vec<Relief> {
    vec![Relief::Bump { texture, height, difference: Difference::Central }]
}

fn glossy() -> LookMaterial {
    LookMaterial {
        lighting: LightingModel::BlinnPhong,
        base_color: Slot::color(Vec3::new(0.5, 0.12, 0.06)),
        specular: Slot::number(0.4),
        shininess: Some(Slot::number(60.0)),
        ..LookMaterial::default()
    }
}

#[test]
#[ignore = "makes pictures to look at"]
fn relief() {
    let lights = Lights::sun(Vec3::new(-0.9, 0.9, 0.8)).with_shadows(ShadowOptions::default());
    let Some(teapot) = model("meshes/teapot.stl") else { return };
    let size = teapot.world_from_mesh.scale as f32;
    let bumpy = |frequency: f32, height: f32| LookMaterial {
        relief: bump(rough(frequency / size), height * size),
        ..glossy()
    };
    on_floor("teapot-plain", &teapot, glossy(), &in_front(5.0), &lights);
    on_floor("teapot-bump", &teapot, bumpy(8.0, 0.02), &in_front(5.0), &lights);
    on_floor("teapot-bump-fine", &teapot, bumpy(100.0, 0.002), &in_front(5.0), &lights);
    on_floor("teapot-bump-far", &teapot, bumpy(100.0, 0.002), &in_front(40.0), &lights);
    let Some(brick) = image("images/brick.png") else { return };
    let floor = ground();
    let bricks: Arc<dyn Texture> = UvImage::new(brick, 10.0);
    let material = LookMaterial {
        base_color: Slot::Texture(Arc::clone(&bricks)),
        relief: bump(bricks, 0.01),
        ..glossy()
    };
    let surface = LookSurface::new(&floor, look(material));
    let place = DAffine3::from_scale(DVec3::splat(12.0));
    let scene = Scene::new(vec![SceneObject::new(&floor, &surface).placed(place)]).unwrap();
    let sun = Lights::sun(Vec3::new(0.3, 0.5, -1.0));
    save("brick-bump", scene.mesh(), &scene, &in_front(4.0), &sun);
}

#[test]
#[ignore = "makes pictures to look at"]
fn highlights() {
    let Some(mesh) = model("meshes/spot/spot_triangulated.obj") else { return };
    let lights = Lights::sun(Vec3::new(0.2, 0.9, 0.9)).with_shadows(ShadowOptions::default());
    let brushed = |direction: Vec3| {
        Some(Anisotropy { strength: Slot::number(0.9), direction: Slot::color(direction), uv_set: 0 })
    };
    let metal = LookMaterial {
        base_color: Slot::color(Vec3::new(0.9, 0.7, 0.4)),
        metallic: Slot::number(1.0),
        roughness: Slot::number(0.4),
        ..LookMaterial::default()
    };
    let Some(teapot) = model("meshes/teapot.stl") else { return };
    on_floor("teapot-isotropic", &teapot, metal.clone(), &in_front(5.0), &lights);
    let along = LookMaterial { anisotropy: brushed(Vec3::new(1.0, 0.5, 0.5)), ..metal.clone() };
    on_floor("teapot-along", &teapot, along, &in_front(5.0), &lights);
    let across = LookMaterial { anisotropy: brushed(Vec3::new(0.5, 1.0, 0.5)), ..metal };
    on_floor("teapot-across", &teapot, across, &in_front(5.0), &lights);
    let ward = LookMaterial { anisotropy: brushed(Vec3::new(0.5, 1.0, 0.5)), ..glossy() };
    on_floor("teapot-ward", &teapot, ward, &in_front(5.0), &lights);
    let Some(hide) = image("meshes/spot/spot_texture.png") else { return };
    let hide = UvImage::new(hide, 1.0);
    for (name, color_use) in
        [("apriori", ColorUse::APriori), ("modulate", ColorUse::Modulate), ("replace", ColorUse::Replace)]
    {
        let material = LookMaterial { base_color: Slot::Texture(hide.clone()), color_use, ..glossy() };
        on_floor(&format!("spot-{name}"), &mesh, material, &seen_from_behind(), &lights);
    }
    let image = hide.clone();
    let gloss = Function(move |at: &ShadingPoint<'_>| Vec4::splat(image.evaluate(at).x.powi(3)));
    let material = LookMaterial {
        base_color: Slot::Texture(hide.clone()),
        specular: Slot::Texture(Arc::new(gloss)),
        ..glossy()
    };
    on_floor("spot-gloss", &mesh, material, &seen_from_behind(), &lights);
    let ramp = [(-1.0, 0.25), (0.05, 0.6), (0.5, 1.0)].map(|(at, grey)| (at, Vec4::splat(grey)));
    let ramp = ColorRamp::new(ramp.to_vec(), RampInterpolation::Constant).unwrap();
    let toon = LookMaterial { base_color: Slot::Texture(hide), toon: Some(Arc::new(ramp)), ..glossy() };
    on_floor("spot-toon", &mesh, toon, &seen_from_behind(), &lights);
}

/// The side that spot faces.
fn seen_from_behind() -> Camera {
    let camera = in_front(5.0);
    let away = camera.eye - camera.target;
    Camera { eye: camera.target + DVec3::new(-away.x, away.y, -away.z), ..camera }
}

#[test]
#[ignore = "makes pictures to look at"]
fn glow() {
    let Some(mesh) = model("meshes/bunny/stanford_bunny.ply") else { return };
    let size = mesh.world_from_mesh.scale as f32;
    let noise = Noise::new(3);
    let veins = Function(move |at: &ShadingPoint<'_>| {
        let height = noise.fbm(at.position * (3.0 / size), Fractal::octaves(3), 0.0);
        let glow = (1.0 - height.abs() * 14.0).max(0.0);
        Vec4::new(3.0, 0.9, 0.2, 1.0) * glow
    });
    let lava = LookMaterial {
        emission: Slot::Texture(Arc::new(veins)),
        base_color: Slot::color(Vec3::splat(0.05)),
        ..LookMaterial::default()
    };
    let surface = LookSurface::new(&mesh, look(lava));
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let options = RenderOptions {
        width: 720,
        height: 480,
        background: Background::Color(Vec3::splat(0.01)),
        ..RenderOptions::default()
    };
    let lights = Lights::behind(&camera);
    for (name, tone_map) in [
        ("glow-clip", ToneMap::Clip),
        ("glow-filmic", ToneMap::Filmic),
        ("glow-reinhard", ToneMap::Reinhard { white: 4.0 }),
    ] {
        let seen = render_with_glow(&mesh, &surface, &camera, &lights, &options, &Glow::default()).unwrap();
        let path = std::env::temp_dir().join(format!("lighting-{name}.png"));
        seen.picture.tone_mapped(tone_map).to_srgb_image().save(&path).unwrap();
    }
}

#[test]
#[ignore = "makes pictures to look at"]
fn landscapes() {
    let hills = |p: Vec3| {
        let noise = Noise::new(5);
        0.25 * noise.fbm(p * 2.0, Fractal::octaves(6), 0.0)
    };
    let flat = common::sheet(300, 0.0, 3);
    let positions =
        flat.positions.iter().map(|p| Vec3::new(p.x, hills(Vec3::new(p.x, 0.0, p.y)), -p.y)).collect();
    let mesh = Mesh { positions, ..flat };
    let surface = LookSurface::new(&mesh, Vec::new());
    let camera = Camera {
        eye: DVec3::new(0.9, 0.7, 1.4),
        target: DVec3::new(0.0, 0.0, 0.1),
        up: DVec3::Y,
        fov_degrees: 45.0,
    };
    for (name, to_light) in [("high", Vec3::new(-0.6, 0.9, -0.3)), ("low", Vec3::new(-0.9, 0.25, -0.3))] {
        let lights = Lights::sun(to_light).with_shadows(ShadowOptions::default());
        save(&format!("landscape-{name}"), &mesh, &surface, &camera, &lights);
    }
}
