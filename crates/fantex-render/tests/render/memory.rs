//! What counts against the memory that is allowed.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use fantex_base::{ErrorKind, ReadLimits, ReadOptions};
use fantex_mesh::Mesh;
use fantex_render::{
    CaptureOptions, Falloff, FlatShading, FlatSurface, Hit, Light, LightKind, Lights, RenderOptions, Shaded,
    Shading, ShadowOptions, Surface, capture_environment, render,
};
use glam::{DVec3, Vec3};

use crate::common::{frontal, ground, lit_by, options, sheet};

/// So many bytes for what is done within.
fn limits(memory_bytes: u64) -> ReadLimits {
    ReadLimits::new(ReadOptions { memory_bytes, ..ReadOptions::default() })
}

fn shadowed(kind: LightKind, resolution: u32) -> Light {
    let shadow = ShadowOptions { resolution, ..ShadowOptions::default() };
    Light::new(kind, Vec3::ONE).with_shadow(shadow)
}

fn lamp(resolution: u32) -> Light {
    shadowed(LightKind::Point { position: DVec3::Y, falloff: Falloff::None }, resolution)
}

fn sun(resolution: u32) -> Light {
    shadowed(LightKind::Directional { to_light: Vec3::Y }, resolution)
}

#[test]
fn shadow_maps_count_while_they_live() {
    let floor = ground();
    let surface = FlatSurface::new(&floor, FlatShading::Faceted, |_: &Hit| Vec3::ONE);
    let (camera, small) =
        (frontal(2.0, 40.0), RenderOptions { width: 16, height: 16, ..options(Shading::default()) });
    let picture = |lamps: Vec<Light>, memory: u64| {
        let limits = limits(memory);
        let made = limits.run(|| render(&floor, &surface, &camera, &lit_by(lamps), &small).map(drop));
        assert_eq!(limits.memory_left(), memory, "what was counted is given back");
        made.map_err(|error| {
            assert_eq!(error.kind(), ErrorKind::TooLarge);
            error.to_string()
        })
    };
    let error = picture(vec![sun(64), lamp(512)], 4 << 20).unwrap_err();
    let expected = "the shadow of lamp 1 of the scene (6 maps of 512 x 512 texels) would take 6 MiB of memory, 3 MiB are left";
    assert!(error.contains(expected), "{error}");
    assert_eq!(picture(vec![lamp(512)], 7 << 20), Ok(()));
    // Of several lamps together.
    let error = picture(vec![lamp(512), lamp(512)], 7 << 20).unwrap_err();
    assert!(error.contains("lamp 1 of the scene"), "{error}");
    assert_eq!(picture(vec![lamp(512), lamp(512)], 14 << 20), Ok(()));
    // Pictures without light need none.
    let unlit = RenderOptions { shading: Shading::BaseColor, ..small.clone() };
    let lights = lit_by(vec![lamp(8192)]);
    assert!(limits(4 << 20).run(|| render(&floor, &surface, &camera, &lights, &unlit)).is_ok());
}

#[test]
fn meshes_are_drawn_within_the_memory() {
    let mesh = sheet(200, 0.01, 3);
    let surface = FlatSurface::new(&mesh, FlatShading::Faceted, |_: &Hit| Vec3::ONE);
    let picture = |memory: u64| {
        let small = RenderOptions { width: 16, height: 16, ..RenderOptions::default() };
        let camera = frontal(2.0, 40.0);
        limits(memory).run(|| render(&mesh, &surface, &camera, &Lights::default(), &small).map(drop))
    };
    let error = picture(4 << 20).unwrap_err().to_string();
    assert!(error.contains("a picture of 80000 triangles would take 5 MiB"), "{error}");
    assert!(picture(5 << 20).is_ok());
}

/// White, and counts how often it is asked whether a triangle casts shadows.
struct Counting<'a> {
    mesh: &'a Mesh,
    asked: AtomicUsize,
}

impl Surface for Counting<'_> {
    fn shade(&self, hit: &Hit) -> Shaded<'_> {
        let normal = hit.position(self.mesh).normalize();
        (fantex_render::MaterialSample::with_normal(normal), None)
    }

    fn casts_shadow(&self, _: usize) -> bool {
        self.asked.fetch_add(1, Relaxed);
        true
    }
}

#[test]
fn captures_count_and_draw_their_shadows_once() {
    let mesh = sheet(20, 0.01, 3);
    let surface = Counting { mesh: &mesh, asked: AtomicUsize::new(0) };
    let lights = lit_by(vec![sun(64)]);
    let capture = |side: u32, memory: u64| {
        let taken = CaptureOptions { side, samples: 1, ..CaptureOptions::default() };
        let hidden = |_: usize| false;
        limits(memory)
            .run(|| capture_environment(&mesh, &surface, &lights, DVec3::Z * 0.5, &taken, &hidden).map(drop))
    };
    let error = capture(256, 8 << 20).unwrap_err().to_string();
    assert!(error.contains("an environment of 6 faces of 256 x 256 texels would take 12 MiB"), "{error}");
    surface.asked.store(0, Relaxed);
    assert!(capture(64, 8 << 20).is_ok());
    // When the map is fitted to what casts shadows, and when it is drawn.
    assert_eq!(surface.asked.load(Relaxed), 2 * mesh.triangles.len());
}
