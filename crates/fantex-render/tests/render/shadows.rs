//! Shadows and cut-outs.

use crate::common;
use std::sync::Arc;

use crate::common::looks::{Function, ground, look};
use crate::common::staging::{above, lit_by, matte, on_ground, options, picture, roof};
use crate::common::{frontal, sphere, square};
use fantex_mesh::Mesh;
use fantex_render::{
    Background, Camera, Falloff, FilterOptions, Light, LightKind, Lights, LookSurface, MeshSurface, Penumbra,
    RenderOptions, Scene, SceneObject, Shading, ShadowOptions, render,
};
use fantex_texture::look::{LightingModel, LookMaterial, Opacity, Slot};
use glam::{DAffine3, DVec3, Vec3, Vec4};

#[test]
fn shadows_end_where_they_should() {
    let floor = ground();
    let surface = LookSurface::new(&floor, look(matte()));
    let scene = roof(&floor, &floor, &surface, &surface);
    let camera = above(3.0);
    let to_light = Vec3::new(-1.0, 1.0, 0.3);
    let lamp_at = DVec3::new(-2.0, 2.5, 0.6);
    let point = LightKind::Point { position: lamp_at, falloff: Falloff::None };
    for (light, is_point) in
        [(Light::directional(to_light, Vec3::ONE), false), (Light::new(point, Vec3::ONE), true)]
    {
        let lights = |shadow| lit_by(vec![Light { shadow, ..light.clone() }]);
        let options = RenderOptions { samples: 1, ..options(Shading::BlinnPhong) };
        let free = picture(&scene, &camera, &lights(None), &options);
        let seen = picture(&scene, &camera, &lights(Some(ShadowOptions::default())), &options);
        let (mut dark, mut lit) = (0, 0);
        for y in 0..90 {
            for x in 0..120 {
                let Some(p) = on_ground(&camera, [120, 90], x, y) else { continue };
                // Not where the roof itself is seen.
                let at_roof = camera.eye + (p - camera.eye) * ((camera.eye.y - 0.5) / camera.eye.y);
                if at_roof.x.abs().max(at_roof.z.abs()) < 0.52 || p.x.abs().max(p.z.abs()) > 2.9 {
                    continue;
                }
                let way = if is_point { lamp_at - p } else { to_light.as_dvec3() };
                let through = p + way * (0.5 / way.y);
                let border = through.x.abs().max(through.z.abs()) - 0.5;
                let (with, without) = (seen.pixel(x, y)[0], free.pixel(x, y)[0]);
                if border < -0.03 {
                    assert_eq!(with, 0.0, "{x},{y} lies in the shadow");
                    dark += 1;
                } else if border > 0.03 {
                    assert_eq!(with, without, "{x},{y} is lit");
                    lit += 1;
                }
            }
        }
        assert!(dark > 200 && lit > 2000, "{dark} {lit}");
    }
}

#[test]
fn floors_without_shadow_leave_the_map_to_what_stands_on_them() {
    let (floor, ball) = (ground(), sphere(24, 0.1));
    let surface = LookSurface::new(&floor, look(matte()));
    let on_it = LookSurface::new(&ball, look(matte()));
    let below = SceneObject::new(&floor, &surface).placed(DAffine3::from_scale(DVec3::splat(200.0)));
    let above_it = SceneObject::new(&ball, &on_it).placed(DAffine3::from_translation(DVec3::Y * 0.1));
    let camera =
        Camera { eye: DVec3::new(0.0, 1.5, 0.6), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 40.0 };
    let shadow = ShadowOptions { resolution: 256, ..ShadowOptions::default() };
    let to_light = Vec3::new(0.0, 1.0, 1.0);
    let sun = lit_by(vec![Light::directional(to_light, Vec3::ONE).with_shadow(shadow)]);
    let scene = Scene::new(vec![below.without_shadow(), above_it]).unwrap();
    let seen = picture(&scene, &camera, &sun, &RenderOptions { samples: 1, ..options(Shading::BlinnPhong) });
    let (mut dark, mut lit) = (0, 0);
    for y in 0..90 {
        for x in 0..120 {
            let Some(p) = on_ground(&camera, [120, 90], x, y) else { continue };
            let to_line = |way: DVec3| (p - DVec3::Y * 0.1).cross(way.normalize()).length();
            let way = to_light.as_dvec3();
            if to_line(p - camera.eye) < 0.103 {
                continue;
            }
            let light = seen.pixel(x, y)[0];
            match to_line(way) - 0.1 {
                d if d < -0.01 => {
                    assert!(light < 0.01, "{x},{y} lies in the ball's shadow: {light}");
                    dark += 1;
                }
                d if d > 0.01 => {
                    assert!(light > 0.69, "{x},{y} is lit: {light}");
                    lit += 1;
                }
                _ => (),
            }
        }
    }
    assert!(dark > 30 && lit > 5000, "{dark} {lit}");
}

#[test]
fn a_ball_casts_no_shadow_on_its_lit_side() {
    let ball = sphere(40, 0.8);
    let surface = MeshSurface::load(&ball, FilterOptions::default()).unwrap();
    let camera = frontal(3.0, 40.0);
    for penumbra in [Penumbra::Sharp, Penumbra::Even(0.02), Penumbra::Lamp(0.05)] {
        for resolution in [256, 1024] {
            let shadow = ShadowOptions { penumbra, resolution, ..ShadowOptions::default() };
            let lights = |shadow| {
                lit_by(vec![Light { shadow, ..Light::directional(Vec3::new(-0.6, 0.5, 0.4), Vec3::ONE) }])
            };
            let render = |lights| {
                render(&ball, &surface, &camera, &lights, &options(Shading::MetallicRoughness))
                    .unwrap()
                    .picture
            };
            let (free, seen) = (render(lights(None)), render(lights(Some(shadow))));
            let to_light = Vec3::new(-0.6, 0.5, 0.4).normalize();
            let mut lost: f32 = 0.0;
            for (a, b) in free.rgba.iter().zip(&seen.rgba) {
                // Dimmed by more than the last few degrees before the terminator would explain.
                lost = lost.max(a[0] - b[0]);
            }
            assert!(
                lost < 0.12,
                "{penumbra:?} at {resolution}: dimmed by {lost} somewhere, light {to_light}"
            );
            let dimmed = free.rgba.iter().zip(&seen.rgba).filter(|(a, b)| a[0] - b[0] > 0.02).count();
            assert!(dimmed < 300, "{penumbra:?} at {resolution}: {dimmed} pixels");
        }
    }
}

#[test]
fn a_lamp_in_a_room_lights_all_walls() {
    // Across the edges of the six maps.
    let room = sphere(24, 1.0);
    let inside_out = Mesh { triangles: room.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(), ..room };
    let surface = LookSurface::new(&inside_out, look(matte()));
    let camera =
        Camera { eye: DVec3::ZERO, target: DVec3::new(1.0, 0.9, 1.0), up: DVec3::Y, fov_degrees: 120.0 };
    let kind = LightKind::Point { position: DVec3::new(0.1, 0.05, -0.1), falloff: Falloff::None };
    let lights = |shadow| lit_by(vec![Light { shadow, ..Light::new(kind.clone(), Vec3::ONE) }]);
    let shadow = ShadowOptions { resolution: 256, ..ShadowOptions::default() };
    let render = |lights| {
        render(&inside_out, &surface, &camera, &lights, &options(Shading::BlinnPhong)).unwrap().picture
    };
    let (free, seen) = (render(lights(None)), render(lights(Some(shadow))));
    let dimmed = free.rgba.iter().zip(&seen.rgba).filter(|(a, b)| a[0] - b[0] > 0.01).count();
    assert!(free.rgba.iter().all(|p| p[0] > 0.5));
    assert_eq!(dimmed, 0);
}

#[test]
fn cut_outs_cast_the_shadow_of_what_is_there() {
    let floor = ground();
    let below = LookSurface::new(&floor, look(matte()));
    // Left half open, right half closed.
    let half = Function(|at: &fantex_texture::ShadingPoint<'_>| {
        Vec4::new(1.0, 1.0, 1.0, if at.uv[0].uv.x > 0.5 { 1.0 } else { 0.0 })
    });
    let cut = LookMaterial {
        base_color: Slot::Texture(Arc::new(half)),
        opacity: Opacity::Mask { threshold: 0.5 },
        ..matte()
    };
    let above_it = LookSurface::new(&floor, look(cut));
    let scene = roof(&floor, &floor, &below, &above_it);
    let camera =
        Camera { eye: DVec3::new(0.0, 3.0, 2.5), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 40.0 };
    let sun = Light::directional(Vec3::new(0.0, 1.0, 3.0), Vec3::ONE).with_shadow(ShadowOptions::default());
    let seen = picture(&scene, &camera, &lit_by(vec![sun]), &options(Shading::BlinnPhong));
    let light_at = |p: DVec3| {
        let q = p - camera.eye;
        let forward = (camera.target - camera.eye).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        let up = right.cross(forward);
        let focal = 45.0 / 20f64.to_radians().tan();
        let x = 60.0 + q.dot(right) / q.dot(forward) * focal;
        let y = 45.0 - q.dot(up) / q.dot(forward) * focal;
        seen.pixel(x as u32, y as u32)[0]
    };
    // Light comes from +z: the shadow of the roof's middle falls one and a half units towards -z.
    assert!(light_at(DVec3::new(0.25, 0.0, -1.5)) < 0.01);
    assert!(light_at(DVec3::new(-0.25, 0.0, -1.5)) > 0.25);
}

#[test]
fn far_fences_cover_as_much_as_near_ones() {
    let panel = square();
    let fence = common::looks::UvImage::new(common::looks::bars(128, 16, 4), 4.0);
    let cut = LookMaterial {
        base_color: Slot::Texture(fence),
        opacity: Opacity::Mask { threshold: 0.5 },
        lighting: LightingModel::Unlit,
        ..LookMaterial::default()
    };
    let surface = LookSurface::new(&panel, look(cut));
    let covered = |distance: f64| {
        let options = RenderOptions { background: Background::Transparent, ..options(Shading::BaseColor) };
        let fov = 2.0 * (0.4 / distance).atan().to_degrees();
        let side = (90.0 * 2.0 / distance) as u32;
        let options = RenderOptions { width: side, height: side, ..options };
        let seen =
            render(&panel, &surface, &frontal(distance, fov), &Lights::default(), &options).unwrap().picture;
        seen.rgba.iter().map(|p| p[3]).sum::<f32>() / seen.rgba.len() as f32
    };
    let truth = 1.0 - (12.0_f32 / 16.0).powi(2);
    for distance in [0.5, 2.0, 4.0, 9.0, 13.0, 16.0] {
        let seen = covered(distance);
        assert!((seen / truth - 1.0).abs() < 0.06, "from {distance}: {seen} instead of {truth}");
    }
}

#[test]
fn wide_pixels_see_filtered_shadows() {
    // A grille of bars, far below the picture's resolution, dims the floor by its coverage.
    let floor = ground();
    let below = LookSurface::new(&floor, look(matte()));
    let grille = LookMaterial {
        base_color: Slot::Texture(common::looks::UvImage::new(common::looks::bars(128, 16, 4), 4.0)),
        opacity: Opacity::Mask { threshold: 0.5 },
        ..matte()
    };
    let above_it = LookSurface::new(&floor, look(grille));
    let scene = roof(&floor, &floor, &below, &above_it);
    let camera =
        Camera { eye: DVec3::new(0.0, 30.0, 40.0), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 6.0 };
    let sun = Light::directional(Vec3::new(0.0, 0.5, 2.0), Vec3::ONE)
        .with_shadow(ShadowOptions { resolution: 4096, ..ShadowOptions::default() });
    let seen = picture(&scene, &camera, &lit_by(vec![sun]), &options(Shading::BlinnPhong));
    let full = seen.rgba.iter().map(|p| p[0]).fold(0.0, f32::max);
    // In the middle of the shadow, two units behind the roof's middle.
    let q = DVec3::new(0.0, 0.0, -2.0) - camera.eye;
    let forward = (camera.target - camera.eye).normalize();
    let up = DVec3::X.cross(forward);
    let y = 45.0 - q.dot(up) / q.dot(forward) * 45.0 / 3f64.to_radians().tan();
    let mean = (0..9).map(|i| seen.pixel(56 + i, y as u32)[0]).sum::<f32>() / 9.0;
    let open = (12.0_f32 / 16.0).powi(2);
    assert!((mean / full - open).abs() < 0.08, "{} instead of {open}", mean / full);
}
