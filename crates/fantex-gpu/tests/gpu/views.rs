//! What needs no device: views, shaders, figures.

use std::time::Duration;

use fantex_gpu::{FrameTimes, ModelSpace, View, shader};
use fantex_mesh::{Mesh, WorldFromMesh};
use fantex_scene::{Camera, Projection};
use glam::{DVec2, DVec3, Vec2, Vec3};
use wgpu::naga::front::wgsl;
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};

/// A view and the CPU renderer's projection of the same camera.
fn both() -> (View, Projection, Mesh) {
    let mesh = Mesh {
        positions: vec![Vec3::new(-0.5, 0.3, 0.2), Vec3::new(0.7, -0.4, 0.9), Vec3::new(0.1, 0.9, -0.8)],
        triangles: vec![[0, 1, 2]],
        world_from_mesh: WorldFromMesh { offset: DVec3::new(1e4, -20.0, 3.0), scale: 32.0 },
        ..Mesh::default()
    };
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let size = [300, 200];
    (View::new(&camera, size, &ModelSpace::of_mesh(&mesh)), Projection::new(&camera, size, &mesh), mesh)
}

#[test]
fn points_are_where_the_cpu_renderer_sees_them() {
    let (view, projection, mesh) = both();
    for &p in &mesh.positions {
        let clip = view.clip_from_offset() * (p.as_dvec3() - view.eye).as_vec3().extend(1.0);
        let seen = Vec2::new(clip.x, -clip.y) / clip.w * 0.5 + 0.5;
        let h = projection.project(p);
        let pixel = h.truncate() / h.z;
        assert!((seen.as_dvec2() * DVec2::new(300.0, 200.0) - pixel).length() < 1e-3);
        assert!((f64::from(clip.w) - h.z).abs() < 1e-5);
        assert!(clip.z > 0.0 && clip.z < clip.w, "nearer than the near plane: {clip}");
    }
}

#[test]
fn rays_go_through_their_pixels() {
    let (view, projection, _) = both();
    let [corner, right, down] = view.rays();
    for pixel in [Vec2::ZERO, Vec2::new(150.0, 100.0), Vec2::new(299.5, 10.5)] {
        let direction = (corner + right * pixel.x + down * pixel.y).normalize();
        assert!((direction - projection.direction(pixel).as_vec3()).length() < 1e-5, "{pixel}");
    }
}

#[test]
fn all_modules_are_valid() {
    for (name, source) in shader::all() {
        let module =
            wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&source)));
        let capabilities = Capabilities::CUBE_ARRAY_TEXTURES | Capabilities::SHADER_FLOAT16_IN_FLOAT32;
        let mut validator = Validator::new(ValidationFlags::all(), capabilities);
        validator.validate(&module).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&source)));
    }
}

#[test]
fn the_middle_is_not_the_mean() {
    let times = FrameTimes { all: [9, 1, 2].map(Duration::from_millis).to_vec() };
    assert_eq!((times.minimum(), times.median()), (Duration::from_millis(1), Duration::from_millis(2)));
    assert_eq!(FrameTimes { all: Vec::new() }.median(), Duration::ZERO);
}
