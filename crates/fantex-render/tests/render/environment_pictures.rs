//! Pictures of environments to look at: `cargo test -p fantex-render --test render environment_pictures -- --ignored` writes them
//! into `target/environment-pictures`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::common::sphere;
use fantex_mesh::Mesh;
use fantex_render::{
    AmbientLight, Background, Camera, CaptureOptions, EnvironmentLight, FlatShading, FlatSurface, Hit,
    Lights, MaterialSample, ObjectReflection, Picture, ReflectingSurface, RenderOptions, Surface,
    capture_environment, render,
};
use fantex_test::{data, opened};
use fantex_texture::environment::{
    EnvironmentForm, EnvironmentLayout, EnvironmentMap, PrefilteredEnvironment, Sky,
};
use glam::{DVec3, Vec3};

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/environment-pictures");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Metal of one roughness, with waves in the normal if asked for.
struct Metal<'a> {
    mesh: &'a Mesh,
    normals: Vec<Vec3>,
    roughness: f32,
    waves: f32,
}

impl<'a> Metal<'a> {
    fn new(mesh: &'a Mesh, roughness: f32, waves: f32) -> Self {
        Self { mesh, normals: fantex_mesh::shading_normals(mesh), roughness, waves }
    }
}

impl Surface for Metal<'_> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        let corners = [0, 1, 2].map(|k| self.normals[3 * hit.triangle + k]);
        let along = |l: Vec3| corners[0] * l.x + corners[1] * l.y + corners[2] * l.z;
        let positions = self.mesh.triangle_positions(hit.triangle);
        let normal = |l: Vec3| {
            let p = positions[0] * l.x + positions[1] * l.y + positions[2] * l.z;
            let waves = Vec3::new((p.y * 25.0).sin(), (p.z * 25.0).sin(), (p.x * 25.0).sin());
            (along(l) + waves * self.waves).normalize_or(Vec3::Z)
        };
        let bent = normal(hit.lambda);
        MaterialSample {
            base_color: Vec3::new(0.95, 0.93, 0.9),
            roughness: self.roughness,
            metallic: 1.0,
            normal_steps: [hit.dlambda_dx, hit.dlambda_dy].map(|d| normal(hit.lambda + d) - bent),
            ..MaterialSample::with_normal(bent)
        }
    }
}

fn photograph(
    mesh: &Mesh,
    surface: &dyn Surface,
    light: &EnvironmentLight,
    camera: &Camera,
    blur: f32,
) -> Picture {
    let background = Background::Environment { blur };
    let options = RenderOptions { width: 360, height: 300, background, ..RenderOptions::default() };
    render(mesh, surface, camera, &Lights::environment(light.clone()), &options).unwrap().picture
}

fn save(picture: &Picture, name: &str) {
    picture.to_srgb_image().save(folder().join(name)).unwrap();
}

#[test]
#[ignore = "writes pictures to look at"]
fn metals_in_environments() {
    let Some(bunny) = data("meshes/bunny/stanford_bunny.ply") else { return };
    let mesh = opened(&bunny);
    let camera = Camera::framing_mesh(&mesh, DVec3::new(0.3, 0.1, 1.0), 1.2);
    for name in ["forest.exr", "spiaggia_di_mondello_1k.hdr"] {
        let Some(path) = data(&format!("images/{name}")) else { return };
        let map = Arc::new(EnvironmentMap::load(path).unwrap());
        let stem = name.split('.').next().unwrap();
        map.unfolded().save(folder().join(format!("{stem}_unfolded.png"))).unwrap();
        let light = EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::clone(&map))));
        for step in 0..5 {
            let metal = Metal::new(&mesh, step as f32 / 4.0, 0.0);
            save(&photograph(&mesh, &metal, &light, &camera, 0.0), &format!("{stem}_bunny_{step}.png"));
        }
        let ball = sphere(64, 1.0);
        let near =
            Camera { eye: DVec3::new(0.0, 0.3, 3.4), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 40.0 };
        for (kind, waves) in [("smooth", 0.0), ("waves", 0.12)] {
            let metal = Metal::new(&ball, 0.05, waves);
            save(&photograph(&ball, &metal, &light, &near, 0.3), &format!("{stem}_ball_{kind}.png"));
        }
        for (form, side) in [(EnvironmentForm::DualParaboloid, 256), (EnvironmentForm::MirrorBall, 384)] {
            let converted = map.converted(form, side);
            let layout = match form {
                EnvironmentForm::DualParaboloid => EnvironmentLayout::DualParaboloid,
                _ => EnvironmentLayout::MirrorBall,
            };
            converted.to_image(layout).save(folder().join(format!("{stem}_{form:?}.png"))).unwrap();
            let light = EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::new(converted))));
            let metal = Metal::new(&ball, 0.0, 0.0);
            save(&photograph(&ball, &metal, &light, &near, 0.0), &format!("{stem}_by_{form:?}.png"));
        }
    }
}

/// A checkered floor with four pillars around a ball; the ball's triangles come last.
fn courtyard() -> (Mesh, usize) {
    let mut mesh = Mesh::default();
    let mut quad = |corners: [Vec3; 4]| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    };
    let at = Vec3::new;
    quad([at(-6.0, -1.0, 6.0), at(6.0, -1.0, 6.0), at(6.0, -1.0, -6.0), at(-6.0, -1.0, -6.0)]);
    for (x, z) in [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)] {
        let corner = |i: usize| {
            let (dx, dz) = [(-0.4, 0.4), (0.4, 0.4), (0.4, -0.4), (-0.4, -0.4)][i % 4];
            Vec3::new(x + dx, 0.0, z + dz)
        };
        for side in 0..4 {
            let [a, b] = [corner(side), corner(side + 1)];
            quad([a.with_y(-1.0), b.with_y(-1.0), b.with_y(1.5), a.with_y(1.5)]);
        }
        quad([0, 1, 2, 3].map(|i| corner(i).with_y(1.5)));
    }
    let walls = mesh.triangles.len();
    let ball = sphere(64, 1.0);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(ball.positions);
    mesh.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + first)));
    (mesh, walls)
}

#[test]
#[ignore = "writes pictures to look at"]
fn a_ball_mirrors_its_courtyard() {
    let (mesh, walls) = courtyard();
    let color = |hit: &Hit| {
        let p = hit.position(&mesh);
        match hit.triangle {
            0 | 1 => Vec3::splat(if (p.x.floor() + p.z.floor()) as i32 & 1 == 0 { 0.7 } else { 0.1 }),
            t if t < walls => {
                [Vec3::X, Vec3::Y, Vec3::new(0.1, 0.2, 1.0), Vec3::new(1.0, 0.8, 0.1)][(t - 2) / 10]
            }
            _ => Vec3::splat(0.02),
        }
    };
    let faceted = FlatSurface::new(&mesh, FlatShading::Faceted, color);
    let smooth = FlatSurface::new(&mesh, FlatShading::Smooth, color);
    let sky = Sky::default();
    let map = Arc::new(PrefilteredEnvironment::new(Arc::new(sky.to_map(256).unwrap())));
    let mut lights = Lights::sun(sky.to_sun);
    lights.ambient = AmbientLight::environment(EnvironmentLight::new(map));
    let background = Background::Environment { blur: 0.0 };
    let capture = CaptureOptions { background, ..CaptureOptions::default() };
    let is_ball = |triangle: usize| triangle >= walls;
    let seen = capture_environment(&mesh, &faceted, &lights, DVec3::ZERO, &capture, &is_ball).unwrap();
    seen.unfolded().save(folder().join("courtyard_unfolded.png")).unwrap();
    let reflection = ObjectReflection {
        environment: EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::new(seen)))),
        reflectance: Vec3::splat(0.9),
        roughness: 0.0,
        proxy: None,
    };
    let surface = ReflectingSurface::new(&mesh, &smooth, reflection, &is_ball);
    let camera =
        Camera { eye: DVec3::new(0.5, 1.6, 5.5), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 45.0 };
    let options = RenderOptions { width: 480, height: 360, background, ..RenderOptions::default() };
    save(&render(&mesh, &surface, &camera, &lights, &options).unwrap().picture, "courtyard.png");
}

#[test]
#[ignore = "writes pictures to look at"]
fn computed_skies() {
    for (name, to_sun, turbidity) in [
        ("noon", Vec3::new(-0.3, 1.0, -0.3), 2.5),
        ("evening", Vec3::new(0.3, 0.08, -1.0), 4.0),
        ("haze", Vec3::new(0.5, 0.5, -1.0), 8.0),
    ] {
        let sky = Sky { to_sun, turbidity, has_sun: true, ..Sky::default() }.to_map(128).unwrap();
        let image = sky.to_image(EnvironmentLayout::Panorama);
        image.save(folder().join(format!("sky_{name}.png"))).unwrap();
    }
}
