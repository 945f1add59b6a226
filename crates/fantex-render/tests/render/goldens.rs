//! Pictures against goldens.

use std::f32::consts::PI;

use crate::common::tiles::{MemoryTiles, bake, fan_cover};
use crate::common::{frontal, golden, sheet, sphere, square, triangle_color};
use fantex_cover::Frame;
use fantex_mesh::{AlphaMode, Material, Mesh};
use fantex_render::{
    Background, Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Hit, Interpolation, Lights,
    MeshSurface, RenderOptions, Shading, Surface, render,
};
use fantex_store::{Channel, ChannelKind, TexelFormat};
use glam::{DVec3, Vec3, Vec4};

fn options() -> RenderOptions {
    RenderOptions { width: 96, height: 64, ..RenderOptions::default() }
}

fn check(name: &str, mesh: &Mesh, surface: &dyn Surface, camera: &Camera, options: &RenderOptions) {
    let rendering = render(mesh, surface, camera, &Lights::default(), options).unwrap();
    golden::check(name, &rendering.picture);
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
    let surface = MeshSurface::load(&mesh, FilterOptions::default()).unwrap();
    for (name, shading) in [
        ("sphere_pbr", Shading::MetallicRoughness),
        ("sphere_phong", Shading::BlinnPhong),
        ("sphere_normals", Shading::Normal),
    ] {
        let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
        check(name, &mesh, &surface, &camera, &RenderOptions { shading, ..options() });
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
    let surface = MeshSurface::load(&mesh, FilterOptions::default()).unwrap();
    let camera = Camera::framing_mesh(&mesh, DVec3::new(0.2, 0.5, 1.0), 1.5);
    check("layers", &mesh, &surface, &camera, &options());
    let transparent = RenderOptions { background: Background::Transparent, ..options() };
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
        check(name, &mesh, &surface, &camera, &RenderOptions { interpolation, ..options() });
    }
}

#[test]
fn triangles_in_their_own_colours() {
    let mesh = sheet(12, 0.05, 4);
    let surface = FlatSurface::new(&mesh, FlatShading::Faceted, triangle_color);
    check("triangles", &mesh, &surface, &frontal(1.6, 50.0), &options());
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
    let surface = FanSurface::new(&mesh, &cover, &channels, &tiles, FilterOptions::default());
    let camera =
        Camera { eye: DVec3::new(0.6, -1.9, 1.2), target: DVec3::ZERO, up: DVec3::Z, fov_degrees: 50.0 };
    check("fans", &mesh, &surface, &camera, &options());
}
