//! Materials of meshes: textures against closed forms, normal maps, alpha, vertex colours.

use std::f32::consts::PI;
use std::sync::Arc;

use fantex_cover::Frame;
use fantex_mesh::{AlphaMode, ImageSource, Material, Mesh, TextureRef, WrapMode};
use fantex_render::{
    Background, Camera, FilterOptions, FlatShading, FlatSurface, Hit, Interpolation, Lights, LookSurface,
    Picture, RenderOptions, Shading, ShadingRate, Surface, render,
};
use fantex_store::{Channel, ChannelKind, TexelFormat};
use fantex_texture::{ColorSpace, Filter, Image, Samples};
use glam::{DVec3, Mat3, Vec2, Vec3, Vec4};

use crate::common;
use crate::common::{
    MemoryTiles, bake, fan_cover, fan_surface, frontal, ray, sheet, sphere, square, triangle_color,
};

fn options(shading: Shading) -> RenderOptions {
    let background = Background::Color(Vec3::ZERO);
    RenderOptions { width: 120, height: 80, samples: 4, shading, background, ..RenderOptions::default() }
}

fn embedded(image: &Image) -> ImageSource {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("texture.png");
    image.save(&path).unwrap();
    ImageSource::Embedded { label: "a texture".into(), bytes: Arc::from(std::fs::read(path).unwrap()) }
}

fn texture() -> TextureRef {
    let wrap = [WrapMode::Clamp; 2];
    TextureRef { image: 0, uv_set: 0, uv_transform: Mat3::IDENTITY, wrap, nearest: false }
}

/// 16-bit RGB from a function of the texel's centre, 0..1.
fn image(size: u32, value: impl Fn(f32, f32) -> [f32; 3]) -> Image {
    let at = |i: u32| (i as f32 + 0.5) / size as f32;
    let samples = (0..size * size)
        .flat_map(|i| value(at(i % size), at(i / size)))
        .map(|v| (v * 65535.0).round() as u16)
        .collect();
    Image {
        width: size,
        height: size,
        channels: 3,
        space: ColorSpace::Linear,
        samples: Samples::U16(samples),
    }
}

fn picture(mesh: &Mesh, camera: &Camera, filter: Filter, options: &RenderOptions) -> Picture {
    let surface = LookSurface::of_model(mesh, FilterOptions { filter, ..FilterOptions::default() }).unwrap();
    render(mesh, &surface, camera, &Lights::default(), options).unwrap().picture
}

fn oblique() -> Camera {
    Camera {
        eye: DVec3::new(0.4, -0.9, 0.5),
        target: DVec3::new(0.0, 0.05, 0.0),
        up: DVec3::Z,
        fov_degrees: 45.0,
    }
}

#[test]
fn a_ramp_on_an_oblique_square_is_where_rays_say() {
    let mut mesh = square();
    mesh.images = vec![embedded(&image(256, |u, v| [1.0, u, v]))];
    mesh.materials[0].metallic = 1.0;
    mesh.materials[0].roughness = 1.0;
    mesh.materials[0].metallic_roughness_texture = Some(texture());
    let options = RenderOptions { samples: 1, ..options(Shading::OcclusionRoughnessMetallic) };
    let camera = oblique();
    for filter in [
        Filter::Nearest,
        Filter::Bilinear,
        Filter::Bicubic,
        Filter::Trilinear,
        Filter::Anisotropic,
        Filter::Ewa,
    ] {
        let seen = picture(&mesh, &camera, filter, &options);
        let (mut compared, mut worst) = (0, 0f64);
        for (x, y) in (0..120).flat_map(|x| (0..80).map(move |y| (x, y))) {
            let direction = ray(&camera, [120, 80], f64::from(x) + 0.5, f64::from(y) + 0.5);
            let p = camera.eye - direction * (camera.eye.z / direction.z);
            let (u, v) = (p.x + 0.5, 0.5 - p.y);
            // Away from the border, where filters meet the clamped edge.
            if [u, v].iter().all(|c| (0.06..0.94).contains(c)) {
                let [_, roughness, metallic, _] = seen.pixel(x, y).map(f64::from);
                worst = worst.max((roughness - u).abs()).max((metallic - v).abs());
                compared += 1;
            }
        }
        assert!(compared > 1500);
        // Half a texel for the nearest texel; perspective bends the mean of a ramp over a pixel a little.
        let tolerance = if filter == Filter::Nearest { 0.0025 } else { 0.0015 };
        assert!(worst < tolerance, "{filter:?}: {worst}");
    }
}

#[test]
fn filters_approach_the_mean_of_many_samples() {
    let mut mesh = square();
    // Checks of a few pixels each, in 512 texels.
    let check = |u: f32, v: f32| if ((u * 24.0) as i32 + (v * 24.0) as i32) % 2 == 0 { 1.0 } else { 0.0 };
    mesh.images = vec![embedded(&image(512, |u, v| [1.0, check(u, v), 0.0]))];
    mesh.materials[0].roughness = 1.0;
    mesh.materials[0].metallic_roughness_texture = Some(texture());
    let options = options(Shading::OcclusionRoughnessMetallic);
    let truth = picture(
        &mesh,
        &oblique(),
        Filter::Bilinear,
        &RenderOptions { samples: 64, shading_rate: ShadingRate::PerSample, ..options.clone() },
    );
    let error = |filter| {
        let seen = picture(&mesh, &oblique(), filter, &options);
        let squares = seen.rgba.iter().zip(&truth.rgba).map(|(a, b)| (a[1] - b[1]).powi(2));
        (squares.sum::<f32>() / seen.rgba.len() as f32).sqrt()
    };
    let [trilinear, anisotropic, ewa] = [Filter::Trilinear, Filter::Anisotropic, Filter::Ewa].map(error);
    assert!(anisotropic < 0.6 * trilinear, "anisotropic {anisotropic}, trilinear {trilinear}");
    assert!(ewa < trilinear, "ewa {ewa}, trilinear {trilinear}");
    assert!(anisotropic < 0.05, "{anisotropic}");
}

#[test]
fn base_colours_are_decoded_once_and_multiplied() {
    let mut mesh = square();
    let grey = Image {
        width: 1,
        height: 1,
        channels: 3,
        space: ColorSpace::Srgb,
        samples: Samples::U8(vec![188, 255, 0]),
    };
    mesh.images = vec![embedded(&grey)];
    mesh.corners.colors = vec![Vec4::new(0.5, 0.5, 0.5, 1.0); 6];
    mesh.materials[0].base_color = Vec4::new(1.0, 0.25, 1.0, 1.0);
    mesh.materials[0].base_color_texture = Some(texture());
    let seen = picture(&mesh, &frontal(1.0, 40.0), Filter::Trilinear, &options(Shading::BaseColor));
    let [r, g, b, a] = seen.pixel(60, 40);
    assert!((r - 0.25).abs() < 2e-3 && (g - 0.125).abs() < 1e-6 && b == 0.0 && a == 1.0, "{r} {g} {b}");
}

#[test]
fn texture_transforms_move_the_image() {
    let mut mesh = square();
    mesh.images = vec![embedded(&image(2, |u, _| [if u < 0.5 { 1.0 } else { 0.0 }, 0.0, 0.0]))];
    let left_half = Mat3::from_scale(Vec2::new(0.5, 1.0));
    let red = |uv_transform, wrap, x| {
        let mut mesh = mesh.clone();
        mesh.materials[0].base_color_texture =
            Some(TextureRef { uv_transform, wrap: [wrap; 2], ..texture() });
        let seen = picture(&mesh, &frontal(1.0, 40.0), Filter::Nearest, &options(Shading::BaseColor));
        seen.pixel(x, 40)[0] > 0.5
    };
    assert_eq!([40, 80].map(|x| red(Mat3::IDENTITY, WrapMode::Clamp, x)), [true, false]);
    assert_eq!([40, 80].map(|x| red(left_half, WrapMode::Clamp, x)), [true, true]);
    let next_copy = Mat3::from_translation(Vec2::X);
    assert_eq!([40, 80].map(|x| red(next_copy, WrapMode::Clamp, x)), [false, false]);
    assert_eq!([40, 80].map(|x| red(next_copy, WrapMode::Repeat, x)), [true, false]);
    assert_eq!([40, 80].map(|x| red(next_copy, WrapMode::Mirror, x)), [false, true]);
}

#[test]
fn normal_maps_bend_to_the_right_and_to_the_top_of_the_image() {
    let mut mesh = square();
    let normal_at = |mesh: &Mesh, rgb: [f32; 3], eye: f64| {
        let mut mesh = mesh.clone();
        mesh.images = vec![embedded(&image(1, |_, _| rgb))];
        mesh.materials[0].normal_texture = Some(texture());
        let seen = picture(&mesh, &frontal(eye, 40.0), Filter::Trilinear, &options(Shading::Normal));
        Vec3::from_slice(&seen.pixel(60, 40)[..3]) * 2.0 - 1.0
    };
    let near = |a: Vec3, b: Vec3| (a - b.normalize()).length() < 1e-3;
    assert!(near(normal_at(&mesh, [0.5, 0.5, 1.0], 1.0), Vec3::Z));
    assert!(near(normal_at(&mesh, [0.8, 0.5, 0.9], 1.0), Vec3::new(0.6, 0.0, 0.8)));
    assert!(near(normal_at(&mesh, [0.5, 0.8, 0.9], 1.0), Vec3::new(0.0, 0.6, 0.8)));
    // From behind, the normal is turned as a whole.
    assert!(near(normal_at(&mesh, [0.8, 0.5, 0.9], -1.0), -Vec3::new(0.6, 0.0, 0.8)));
    // An image that is mirrored on the surface: its right is the surface's left, its top stays on top.
    mesh.corners.uv_sets[0].iter_mut().for_each(|uv| uv.x = 1.0 - uv.x);
    assert!(near(normal_at(&mesh, [0.8, 0.5, 0.9], 1.0), Vec3::new(-0.6, 0.0, 0.8)));
    assert!(near(normal_at(&mesh, [0.5, 0.8, 0.9], 1.0), Vec3::new(0.0, 0.6, 0.8)));
    // The mesh's own tangents go before derived ones.
    mesh.corners.tangents = vec![Vec4::new(0.0, 1.0, 0.0, 1.0); 6];
    assert!(near(normal_at(&mesh, [0.8, 0.5, 0.9], 1.0), Vec3::new(0.0, 0.6, 0.8)));
}

/// Squares at several depths, each with its colour and opacity, in any order.
fn stack(layers: &[(f32, Vec4, AlphaMode)]) -> Mesh {
    let mut mesh = Mesh::default();
    for (i, &(z, base_color, alpha)) in layers.iter().enumerate() {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(square().positions.iter().map(|p| *p + Vec3::Z * z));
        mesh.triangles.extend(square().triangles.iter().map(|t| t.map(|v| v + first)));
        mesh.triangle_materials.extend([i as u32; 2]);
        mesh.materials.push(Material { base_color, alpha, ..Material::default() });
    }
    mesh
}

fn middle(mesh: &Mesh, background: Background) -> [f32; 4] {
    let options = RenderOptions { background, ..options(Shading::BaseColor) };
    picture(mesh, &frontal(1.0, 40.0), Filter::Trilinear, &options).pixel(60, 40)
}

#[test]
fn layers_blend_back_to_front_in_any_order() {
    let red = (0.1, Vec4::new(1.0, 0.0, 0.0, 0.5), AlphaMode::Blend);
    let green = (0.0, Vec4::new(0.0, 1.0, 0.0, 0.25), AlphaMode::Blend);
    let blue = (-0.1, Vec4::new(0.0, 0.0, 1.0, 1.0), AlphaMode::Opaque);
    for layers in [[red, green, blue], [blue, green, red], [green, red, blue], [green, blue, red]] {
        let seen = middle(&stack(&layers), Background::Color(Vec3::ONE));
        assert_eq!(seen, [0.5, 0.125, 0.375, 1.0]);
    }
    let hidden = stack(&[(0.2, Vec4::ONE, AlphaMode::Opaque), red]);
    assert_eq!(middle(&hidden, Background::Transparent), [1.0; 4]);
    assert_eq!(middle(&stack(&[red]), Background::Transparent), [1.0, 0.0, 0.0, 0.5]);
}

#[test]
fn crossing_layers_are_ordered_pixel_by_pixel() {
    let half = |color: Vec3| (0.0, color.extend(0.5), AlphaMode::Blend);
    let mut mesh = stack(&[half(Vec3::X), half(Vec3::Y)]);
    // Turned about the vertical axis, one to the left and one to the right: an X seen from above.
    let tilt = |(i, p): (usize, &mut Vec3)| p.z = if i < 4 { p.x } else { -p.x } * 0.5;
    mesh.positions.iter_mut().enumerate().for_each(tilt);
    let options = RenderOptions { background: Background::Color(Vec3::ZERO), ..options(Shading::BaseColor) };
    let seen = picture(&mesh, &frontal(1.5, 40.0), Filter::Trilinear, &options);
    let red_in_front = [0.5, 0.25, 0.0, 1.0];
    let green_in_front = [0.25, 0.5, 0.0, 1.0];
    assert_eq!((seen.pixel(50, 40), seen.pixel(70, 40)), (green_in_front, red_in_front));
}

#[test]
fn cut_outs_are_all_or_nothing_and_opaque_ignores_alpha() {
    let with_alpha = |a: f32, mode| {
        middle(&stack(&[(0.0, Vec4::new(1.0, 1.0, 1.0, a), mode)]), Background::Transparent)[3]
    };
    assert_eq!(with_alpha(0.3, AlphaMode::Mask(0.5)), 0.0);
    assert_eq!(with_alpha(0.5, AlphaMode::Mask(0.5)), 1.0);
    assert_eq!(with_alpha(0.1, AlphaMode::Opaque), 1.0);
}

#[test]
fn a_missing_image_is_left_out_and_named() {
    let mut mesh = square();
    mesh.images = vec![ImageSource::File("no/such/picture.png".into())];
    mesh.materials[0].base_color = Vec4::new(0.5, 0.25, 0.125, 1.0);
    mesh.materials[0].base_color_texture = Some(texture());
    mesh.materials[0].normal_texture = Some(texture());
    mesh.materials[0].emission = Vec3::ONE;
    mesh.materials[0].emission_texture = Some(texture());
    let surface = LookSurface::of_model(&mesh, FilterOptions::default()).unwrap();
    let notes = surface.left_out().notes();
    assert!(notes[0].contains("picture.png"), "{notes:?}");
    assert!(notes[0].ends_with("put the file there, or correct its name in the model"), "{notes:?}");
    let seen = |shading| {
        let picture = picture(&mesh, &frontal(1.5, 40.0), Filter::Trilinear, &options(shading));
        picture.pixel(picture.width / 2, picture.height / 2)
    };
    assert_eq!(seen(Shading::BaseColor), [0.5, 0.25, 0.125, 1.0]);
    assert_eq!(seen(Shading::Emission), [0.0, 0.0, 0.0, 1.0]);
}

// Pictures against goldens.

fn golden_options() -> RenderOptions {
    RenderOptions { width: 96, height: 64, ..RenderOptions::default() }
}

fn check(name: &str, mesh: &Mesh, surface: &dyn Surface, camera: &Camera, options: &RenderOptions) {
    let rendering = render(mesh, surface, camera, &Lights::default(), options).unwrap();
    common::check_golden(name, &rendering.picture);
}

/// A red dielectric above, gold below, on a smooth sphere.
fn painted_sphere() -> Mesh {
    let mut mesh = sphere(24, 0.8);
    let is_upper = |t: usize| mesh.triangle_positions(t).iter().map(|p| p.y).sum::<f32>() > 0.0;
    mesh.triangle_materials = (0..mesh.triangles.len()).map(|t| u32::from(!is_upper(t))).collect();
    mesh.materials = vec![
        Material { base_color: Vec4::new(0.7, 0.05, 0.04, 1.0), roughness: 0.35, ..Material::default() },
        Material {
            base_color: Vec4::new(0.9, 0.6, 0.2, 1.0),
            roughness: 0.4,
            metallic: 1.0,
            ..Material::default()
        },
    ];
    mesh
}

#[test]
fn spheres() {
    let mesh = painted_sphere();
    let surface = LookSurface::of_model(&mesh, FilterOptions::default()).unwrap();
    for (name, shading) in [
        ("sphere_pbr", Shading::MetallicRoughness),
        ("sphere_phong", Shading::BlinnPhong),
        ("sphere_normals", Shading::Normal),
    ] {
        let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
        check(name, &mesh, &surface, &camera, &RenderOptions { shading, ..golden_options() });
    }
}

#[test]
fn layers() {
    let mut mesh = Mesh::default();
    let colors =
        [Vec4::new(1.0, 0.1, 0.1, 0.5), Vec4::new(0.1, 0.8, 0.1, 0.5), Vec4::new(0.1, 0.2, 1.0, 1.0)];
    for (i, base_color) in colors.into_iter().enumerate() {
        let angle = PI / 3.0 * i as f32;
        let turned = |p: &Vec3| Vec3::new(p.x * angle.cos(), p.y, p.x * angle.sin()) * 1.5;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(square().positions.iter().map(turned));
        mesh.triangles.extend(square().triangles.iter().map(|t| t.map(|v| v + first)));
        mesh.triangle_materials.extend([i as u32; 2]);
        let alpha = if i < 2 { AlphaMode::Blend } else { AlphaMode::Opaque };
        mesh.materials.push(Material { base_color, alpha, ..Material::default() });
    }
    let surface = LookSurface::of_model(&mesh, FilterOptions::default()).unwrap();
    let camera = Camera::framing_mesh(&mesh, DVec3::new(0.2, 0.5, 1.0), 1.5);
    check("layers", &mesh, &surface, &camera, &golden_options());
    let transparent = RenderOptions { background: Background::Transparent, ..golden_options() };
    check("layers_transparent", &mesh, &surface, &camera, &transparent);
}

#[test]
fn perspective_and_its_break_lines() {
    let mesh = square();
    let checks = |hit: &Hit| {
        let p = hit.position(&mesh) * 8.0 + 100.0;
        Vec3::splat(if (p.x as i32 + p.y as i32) % 2 == 0 { 0.8 } else { 0.1 })
    };
    let surface = FlatSurface::new(&mesh, FlatShading::Unlit, checks);
    let camera =
        Camera { eye: DVec3::new(0.1, -0.75, 0.25), target: DVec3::ZERO, up: DVec3::Z, fov_degrees: 60.0 };
    for (name, interpolation) in
        [("perspective", Interpolation::Perspective), ("affine", Interpolation::Affine)]
    {
        check(name, &mesh, &surface, &camera, &RenderOptions { interpolation, ..golden_options() });
    }
}

#[test]
fn triangles_in_their_own_colours() {
    let mesh = sheet(12, 0.05, 4);
    let surface = FlatSurface::new(&mesh, FlatShading::Faceted, triangle_color);
    check("triangles", &mesh, &surface, &frontal(1.6, 50.0), &golden_options());
}

#[test]
fn fans() {
    let mesh = Mesh { materials: vec![Material::default()], ..sheet(4, 0.1, 8) };
    let cover = fan_cover(&mesh, [48, 48]);
    let rings = |p: Vec3, _: Option<(usize, Vec3)>, _: &Frame| {
        let wave = 0.5 + 0.5 * (p.truncate().length() * 20.0).sin();
        Vec3::new(0.8, 0.5 * wave + 0.2, 0.2).extend(1.0).to_array()
    };
    // The same dent in every tile: shows the tiles' frames and their blending.
    let dent = |p: Vec3, _: Option<(usize, Vec3)>, frame: &Frame| {
        let q = p - frame.origin;
        let bend = |axis: Vec3| 0.5 + 0.4 * (q.dot(axis) * 25.0).sin() * (-20.0 * q.length_squared()).exp();
        [bend(frame.x_axis), bend(frame.y_axis()), 0.0, 1.0]
    };
    let tiles = MemoryTiles { levels: vec![bake(&mesh, &cover, rings), bake(&mesh, &cover, dent)] };
    let channel = |kind| Channel { kind, format: TexelFormat::Rgba32F, srgb: false };
    let channels = [channel(ChannelKind::BaseColor), channel(ChannelKind::Normal)];
    let surface = fan_surface(&mesh, &cover, &channels, &tiles, FilterOptions::default());
    let camera =
        Camera { eye: DVec3::new(0.6, -1.9, 1.2), target: DVec3::ZERO, up: DVec3::Z, fov_degrees: 50.0 };
    check("fans", &mesh, &surface, &camera, &golden_options());
}
