//! Environments: as light, as background, mirrored, captured from the scene.

use std::sync::Arc;

use fantex_mesh::{ImageSource, Mesh, TextureRef, WorldFromMesh, WrapMode, interpolate};
use fantex_render::{
    AmbientLight, Background, Camera, CaptureOptions, EnvironmentLight, FilterOptions, FlatShading,
    FlatSurface, Glow, Hit, Lights, LookSurface, MaterialSample, ObjectReflection, Picture,
    ReflectingSurface, RenderOptions, Shaded, Shading, Surface, capture_environment, capture_with,
    cube_cameras, render, render_with_glow,
};
use fantex_texture::environment::{
    CubeFace, EnvironmentForm, EnvironmentMap, EnvironmentProxy, PrefilteredEnvironment,
};
use fantex_texture::{ColorSpace, Image, Samples};
use glam::{DVec3, Mat3, Vec3};

use crate::common::{frontal, ray, sphere, square};

const SIZE: [u32; 2] = [120, 80];

fn options(background: Background) -> RenderOptions {
    RenderOptions { width: SIZE[0], height: SIZE[1], samples: 4, background, ..RenderOptions::default() }
}

fn light(form: EnvironmentForm, side: u32, radiance: impl Fn(Vec3) -> Vec3 + Sync) -> EnvironmentLight {
    let map = EnvironmentMap::from_function(form, side, |d, _| radiance(d));
    EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::new(map))))
}

/// A map that shows its own directions.
fn compass() -> EnvironmentLight {
    light(EnvironmentForm::Cube, 64, |d| d * 0.5 + 0.5)
}

fn direction_of(pixel: [f32; 4]) -> Vec3 {
    Vec3::from_slice(&pixel[..3]) * 2.0 - 1.0
}

/// A smooth ball of one material.
struct Ball<'a> {
    mesh: &'a Mesh,
    roughness: f32,
    metallic: f32,
    unlit: bool,
}

impl Surface for Ball<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let normal = hit.position(self.mesh).normalize();
        let corners = self.mesh.triangle_positions(hit.triangle());
        let along = |l: Vec3| interpolate(corners, l);
        let material = MaterialSample {
            roughness: self.roughness,
            metallic: self.metallic,
            unlit: self.unlit,
            base_color: if self.unlit { Vec3::ZERO } else { Vec3::new(0.9, 0.6, 0.3) },
            normal_steps: hit.lambda_steps.map(along),
            occlusion: 0.8,
            ..MaterialSample::with_normal(normal)
        };
        (material, None)
    }
}

fn worst(a: &Picture, b: &Picture) -> f32 {
    let pixels = a.rgba.iter().zip(&b.rgba);
    pixels.flat_map(|(a, b)| (0..4).map(|c| (a[c] - b[c]).abs())).fold(0.0, f32::max)
}

#[test]
fn an_even_environment_lights_as_an_even_ambient_light() {
    let mesh = sphere(24, 0.8);
    let color = Vec3::new(0.7, 0.5, 0.9);
    let environment = light(EnvironmentForm::Sphere, 32, |_| color);
    for shading in [Shading::MetallicRoughness, Shading::BlinnPhong] {
        for (roughness, metallic) in [(0.0, 1.0), (0.2, 0.0), (0.6, 1.0), (1.0, 0.3)] {
            let ball = Ball { mesh: &mesh, roughness, metallic, unlit: false };
            let [even, mapped] =
                [AmbientLight::uniform(color), AmbientLight::environment(environment.clone())].map(
                    |ambient| {
                        let lights = Lights { ambient, ..Lights::default() };
                        let options =
                            RenderOptions { shading, ..options(Background::Environment { blur: 0.0 }) };
                        render(&mesh, &ball, &frontal(3.0, 40.0), &lights, &options).unwrap().picture
                    },
                );
            let error = worst(&even, &mapped);
            assert!(error < 2e-4, "{shading:?}, roughness {roughness}, metallic {metallic}: {error}");
        }
    }
}

#[test]
fn sky_boxes_show_every_pixel_its_direction() {
    let mesh = sphere(8, 1e-3);
    let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |_| Vec3::ZERO);
    let mut lights = Lights::environment(compass());
    let eye = DVec3::new(5.0, 1.0, -2.0);
    for (target, up, fov_degrees) in [
        (DVec3::new(5.0, 1.0, -9.0), DVec3::Y, 60.0),
        // From the ground upwards, at a wide angle.
        (DVec3::new(5.5, 9.0, -1.0), DVec3::Y, 120.0),
        (DVec3::new(5.0, 9.0, -2.01), DVec3::Y, 90.0),
        (DVec3::new(9.0, 2.0, 3.0), DVec3::X, 150.0),
    ] {
        let camera = Camera { eye, target, up, fov_degrees };
        for rotation_degrees in [0.0, 90.0] {
            lights.ambient.environment.as_mut().unwrap().rotation_degrees = rotation_degrees;
            let options = options(Background::Environment { blur: 0.0 });
            let picture = render(&mesh, &surface, &camera, &lights, &options).unwrap().picture;
            assert!(picture.is_opaque());
            for (x, y) in [(60, 40), (0, 0), (119, 79), (3, 60), (100, 11)] {
                let at = ray(&camera, SIZE, f64::from(x) + 0.5, f64::from(y) + 0.5);
                let expected = at.normalize().as_vec3();
                // Turned to the left, a map shows at the left what it had ahead.
                let turned = if rotation_degrees == 0.0 {
                    expected
                } else {
                    Vec3::new(-expected.z, expected.y, expected.x)
                };
                let seen = direction_of(picture.pixel(x, y));
                assert!(
                    (seen - turned).length() < 0.03,
                    "{target} {rotation_degrees} {x},{y}: {seen}, not {turned}"
                );
            }
        }
    }
}

#[test]
fn blurred_and_exposed_sky_boxes() {
    let mesh = sphere(8, 1e-3);
    let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |_| Vec3::ZERO);
    let lights = Lights::environment(light(EnvironmentForm::Cube, 64, |d| {
        Vec3::splat(if d.x > 0.0 { 1.0 } else { 0.0 })
    }));
    let row = |blur, exposure| {
        let options = RenderOptions { exposure, ..options(Background::Environment { blur }) };
        let picture = render(&mesh, &surface, &frontal(3.0, 90.0), &lights, &options).unwrap().picture;
        [10, 50, 70, 110].map(|x| picture.pixel(x, 20)[0])
    };
    assert_eq!(row(0.0, 1.0), [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(row(0.0, 0.5), [0.0, 0.0, 0.5, 0.5]);
    let blurred = row(0.8, 1.0);
    assert!(blurred[1] > 0.2 && blurred[2] < 0.8 && blurred[0] < blurred[1], "{blurred:?}");
}

/// A ball that adds a full mirror image to black.
fn mirror_ball(mesh: &Mesh, camera: &Camera, reflection: ObjectReflection) -> Picture {
    let ball = Ball { mesh, roughness: 1.0, metallic: 0.0, unlit: true };
    let black = Lights { ambient: AmbientLight::uniform(Vec3::ZERO), ..Lights::default() };
    let surface = ReflectingSurface::new(mesh, &ball, reflection, &|_| true);
    render(mesh, &surface, camera, &black, &options(Background::Transparent)).unwrap().picture
}

fn mirror_of(environment: EnvironmentLight) -> ObjectReflection {
    ObjectReflection { environment, reflectance: Vec3::ONE, roughness: 0.0, proxy: None }
}

/// Where a camera's ray meets the ball of radius 1 around the origin, and its mirrored direction.
fn mirrored_at_ball(camera: &Camera, x: u32, y: u32) -> Option<(DVec3, DVec3)> {
    let d = ray(camera, SIZE, f64::from(x) + 0.5, f64::from(y) + 0.5).normalize();
    let along = camera.eye.dot(d);
    let discriminant = along * along - (camera.eye.length_squared() - 1.0);
    // At the silhouette a pixel holds a quarter of the world.
    (discriminant > 0.1).then(|| {
        let p = camera.eye + d * (-along - discriminant.sqrt());
        (p, d - p * (2.0 * d.dot(p)))
    })
}

#[test]
fn mirror_balls_show_the_mirrored_direction() {
    let mesh = sphere(64, 1.0);
    let camera = Camera { eye: DVec3::new(1.0, 1.5, 2.5), ..frontal(1.0, 45.0) };
    let picture = mirror_ball(&mesh, &camera, mirror_of(compass()));
    let mut compared = 0;
    for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
        if let Some((_, expected)) = mirrored_at_ball(&camera, x, y) {
            let seen = direction_of(picture.pixel(x, y));
            assert!((seen - expected.as_vec3()).length() < 0.05, "{x},{y}: {seen}, not {expected}");
            compared += 1;
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn what_is_mirrored_has_no_halo() {
    let mesh = sphere(32, 1.0);
    for unlit in [true, false] {
        let ball = Ball { mesh: &mesh, roughness: 1.0, metallic: 0.0, unlit };
        let surface = ReflectingSurface::new(&mesh, &ball, mirror_of(compass()), &|_| true);
        let (camera, glow) = (frontal(3.0, 60.0), Glow { radius: 0.2, ..Glow::default() });
        let (lights, options) = (Lights::default(), options(Background::Transparent));
        let plain = render(&mesh, &surface, &camera, &lights, &options).unwrap().picture;
        let glowing = render_with_glow(&mesh, &surface, &camera, &lights, &options, &glow).unwrap().picture;
        assert!(plain.pixel(60, 40)[0] > 0.2);
        assert_eq!(plain.pixel(1, 40), [0.0; 4]);
        assert_eq!(worst(&plain, &glowing), 0.0);
        let emitted = RenderOptions { shading: Shading::Emission, ..options };
        let emitted = render(&mesh, &surface, &camera, &lights, &emitted).unwrap().picture;
        assert_eq!(emitted.pixel(60, 40), [0.0, 0.0, 0.0, 1.0]);
    }
}

#[test]
fn spheres_cubes_and_paraboloids_reflect_alike() {
    let mesh = sphere(48, 1.0);
    let camera = Camera { eye: DVec3::new(-0.5, 0.8, 2.8), ..frontal(1.0, 45.0) };
    let soft = |d: Vec3| 0.5 + 0.5 * Vec3::new((5.0 * d.x).sin(), (4.0 * d.y).cos(), (6.0 * d.z).sin());
    let source = EnvironmentMap::from_function(EnvironmentForm::Cube, 128, |d, _| soft(d));
    let picture = |map: EnvironmentMap| {
        let environment = EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::new(map))));
        mirror_ball(&mesh, &camera, mirror_of(environment))
    };
    let cube = picture(source.clone());
    for (form, side, most) in [
        (EnvironmentForm::Sphere, 256, 0.03),
        (EnvironmentForm::DualParaboloid, 256, 0.03),
        // The outermost texel of its disc spans 0.18 radian: around -z detail is lost.
        (EnvironmentForm::MirrorBall, 512, 0.25),
    ] {
        let other = picture(source.converted(form, side));
        let error = worst(&cube, &other);
        println!("mirrored by {form:?} instead of a cube: the largest difference is {error:.4}");
        assert!(error < most, "{form:?}: {error}");
    }
}

/// A room from -2 to 2 around a ball of radius 1; the room's triangles come first.
fn room_with_ball() -> (Mesh, usize) {
    let mut mesh =
        Mesh { world_from_mesh: WorldFromMesh { offset: DVec3::ZERO, scale: 1.0 }, ..Mesh::default() };
    for face in CubeFace::ALL {
        let first = mesh.positions.len() as u32;
        for (s, t) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            mesh.positions.push((face.forward() + face.right() * s + face.up() * t) * 2.0);
        }
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    let walls = mesh.triangles.len();
    let ball = sphere(48, 1.0);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(ball.positions);
    mesh.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + first)));
    (mesh, walls)
}

/// The colour of a place on the walls.
fn wall_color(p: Vec3) -> Vec3 {
    p / 4.0 + 0.5
}

#[test]
fn captures_leave_the_object_out_and_show_the_walls() {
    let (mesh, walls) = room_with_ball();
    let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |hit: &Hit| wall_color(hit.position(&mesh)));
    let lights = Lights::default();
    let center = DVec3::new(0.2, -0.1, 0.3);
    let take = |hidden: &(dyn Fn(usize) -> bool + Sync)| {
        let options = CaptureOptions { side: 64, ..CaptureOptions::default() };
        capture_environment(&mesh, &surface, &lights, center, &options, hidden).unwrap()
    };
    let map = take(&|triangle| triangle >= walls);
    let room = EnvironmentProxy::Box { min: Vec3::splat(-2.0), max: Vec3::splat(2.0) };
    for i in 0..500 {
        let angle = i as f32 * 2.4;
        let y = 1.0 - (2.0 * i as f32 + 1.0) / 500.0;
        let d = Vec3::new((1.0 - y * y).sqrt() * angle.cos(), y, (1.0 - y * y).sqrt() * angle.sin());
        let seen = map.sample(d, [Vec3::ZERO; 2]);
        let expected = wall_color(room.corrected(center.as_vec3(), d, Vec3::ZERO));
        assert!((seen - expected).length() < 0.02, "{d}: {seen}, not {expected}");
    }
    // With the object, its inside is seen.
    let inside = take(&|_| false).sample(Vec3::X, [Vec3::ZERO; 2]);
    assert!((inside - map.sample(Vec3::X, [Vec3::ZERO; 2])).length() > 0.1);
}

#[test]
fn balls_mirror_the_room_they_stand_in() {
    let (mesh, walls) = room_with_ball();
    let surface = FlatSurface::new(&mesh, FlatShading::Unlit, |hit: &Hit| wall_color(hit.position(&mesh)));
    let capture = CaptureOptions { side: 128, ..CaptureOptions::default() };
    let is_ball = |triangle: usize| triangle >= walls;
    let map =
        capture_environment(&mesh, &surface, &Lights::default(), DVec3::ZERO, &capture, &is_ball).unwrap();
    let environment = EnvironmentLight::new(Arc::new(PrefilteredEnvironment::new(Arc::new(map))));
    let room = EnvironmentProxy::Box { min: Vec3::splat(-2.0), max: Vec3::splat(2.0) };
    let camera = Camera { eye: DVec3::new(0.3, 0.4, 1.9), ..frontal(1.0, 70.0) };
    let ball = sphere(64, 1.0);
    // Against rays that are traced: far walls are wrong, walls where they are are right.
    let error = |proxy| {
        let picture =
            mirror_ball(&ball, &camera, ObjectReflection { proxy, ..mirror_of(environment.clone()) });
        let (mut sum, mut count) = (0.0, 0.0);
        for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
            if let Some((p, d)) = mirrored_at_ball(&camera, x, y) {
                let truth = wall_color(room.corrected(p.as_vec3(), d.as_vec3(), Vec3::ZERO));
                sum += (Vec3::from_slice(&picture.pixel(x, y)[..3]) - truth).length();
                count += 1.0;
            }
        }
        assert!(count > 1000.0, "{count}");
        sum / count
    };
    let (far, near) = (error(None), error(Some((room, DVec3::ZERO))));
    println!("mean error of the mirrored room: infinitely far {far:.4}, with its box {near:.4}");
    assert!(near < 0.01 && far > 8.0 * near, "{far} {near}");
}

#[test]
fn bent_normals_mirror_what_they_face() {
    let tilt = Vec3::new(0.3, 0.2, 1.0).normalize();
    let normals = Image {
        width: 1,
        height: 1,
        channels: 3,
        space: ColorSpace::Linear,
        samples: Samples::U16((tilt * 0.5 + 0.5).to_array().map(|v| (v * 65535.0).round() as u16).to_vec()),
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("normals.png");
    normals.save(&path).unwrap();
    let mut mesh = square();
    mesh.images = vec![ImageSource::Embedded {
        label: "normals".into(),
        bytes: Arc::from(std::fs::read(path).unwrap()),
    }];
    mesh.materials[0].metallic = 1.0;
    mesh.materials[0].roughness = 0.0;
    mesh.materials[0].normal_texture = Some(TextureRef {
        image: 0,
        uv_set: 0,
        uv_transform: Mat3::IDENTITY,
        wrap: [WrapMode::Clamp; 2],
        nearest: false,
    });
    let surface = LookSurface::of_model(&mesh, FilterOptions::default()).unwrap();
    let camera = frontal(2.0, 20.0);
    let lights = Lights::environment(compass());
    let picture =
        render(&mesh, &surface, &camera, &lights, &options(Background::Transparent)).unwrap().picture;
    let v = Vec3::Z;
    let expected = tilt * (2.0 * tilt.dot(v)) - v;
    let seen = direction_of(picture.pixel(60, 40));
    assert!((seen - expected).length() < 0.03, "{seen}, not {expected}");
}

#[test]
fn small_mirrors_average_what_they_mirror() {
    // A ball of a few pixels mirrors almost the whole fine checker in each: the mean, not noise.
    let checker = |d: Vec3| {
        let odd = [d.x, d.y, d.z].map(|c| (c * 24.0).floor() as i32).iter().sum::<i32>() & 1;
        Vec3::splat(odd as f32)
    };
    let mesh = sphere(48, 1.0);
    let environment = light(EnvironmentForm::Cube, 256, checker);
    let picture = mirror_ball(&mesh, &frontal(60.0, 45.0), mirror_of(environment));
    let values: Vec<f32> =
        (59..61).flat_map(|x| (39..41).map(move |y| (x, y))).map(|(x, y)| picture.pixel(x, y)[0]).collect();
    assert!(values.iter().all(|v| (v - 0.5).abs() < 0.1), "{values:?}");
}

#[test]
fn captures_need_square_pictures() {
    let small = Picture { width: 3, height: 2, rgba: vec![[0.0; 4]; 6] };
    let error = capture_with(DVec3::ZERO, 3, |_| Ok(small.clone())).unwrap_err();
    assert!(error.to_string().contains("3x3 pixels, not 3x2"), "{error}");
    assert!(cube_cameras(DVec3::ONE).iter().all(|camera| camera.eye == DVec3::ONE));
}
