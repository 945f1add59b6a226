//! What the textures of a look drive.

use std::sync::Arc;

use fantex_mesh::{Mesh, SurfacePoint};
use fantex_render::{
    AmbientLight, Background, Camera, FilterOptions, Finish, Glow, Hit, Light, Lights, LookSurface,
    MaterialSample, Picture, RenderOptions, Shading, Surface, render, render_with_glow,
};
use fantex_texture::combine::CombineMode;
use fantex_texture::coordinates::ImageLookup;
use fantex_texture::look::{
    Anisotropy, ColorUse, Difference, FragmentTexture, LightingModel, LookMaterial, NormalSpace, Opacity,
    Relief, Slot, TangentSpace,
};
use fantex_texture::{
    ColorRamp, ColorSpace, Image, ImageTexture, NoiseOptions, NoiseTexture, RampInterpolation, Rock, Samples,
    ShadingPoint, SolidTexture, Texture,
};
use glam::{Vec3, Vec4};

use crate::common;
use crate::common::{
    Function, Random, UvImage, frontal, image_as_numbers, look, model, ray, sheet, sphere, square, uv,
};

const SIZE: [u32; 2] = [96, 64];

fn options() -> RenderOptions {
    RenderOptions {
        width: SIZE[0],
        height: SIZE[1],
        samples: 1,
        background: Background::Color(Vec3::ZERO),
        ..RenderOptions::default()
    }
}

fn texture(f: impl Fn(&ShadingPoint<'_>) -> Vec4 + Send + Sync + 'static) -> Arc<dyn Texture> {
    Arc::new(Function(f))
}

fn slot(f: impl Fn(&ShadingPoint<'_>) -> Vec4 + Send + Sync + 'static) -> Slot {
    Slot::Texture(texture(f))
}

fn lights(to_light: Vec3) -> Lights {
    let color = Vec3::new(0.9, 0.8, 0.7);
    Lights {
        ambient: AmbientLight::uniform(Vec3::new(0.1, 0.15, 0.2)),
        lamps: vec![Light::directional(to_light, color)],
    }
}

fn phong() -> LookMaterial {
    LookMaterial {
        lighting: LightingModel::BlinnPhong,
        base_color: Slot::color(Vec3::new(0.8, 0.3, 0.1)),
        ambient: Slot::number(0.5),
        specular: Slot::color(Vec3::splat(0.6)),
        shininess: Some(Slot::number(20.0)),
        ..LookMaterial::default()
    }
}

fn picture_of(mesh: &Mesh, material: LookMaterial, lights: &Lights, options: &RenderOptions) -> Picture {
    let surface = LookSurface::new(mesh, look(material));
    render(mesh, &surface, &frontal(2.0, 40.0), lights, options).unwrap().picture
}

fn rgb(picture: &Picture, x: u32, y: u32) -> Vec3 {
    Vec4::from_array(picture.pixel(x, y)).truncate()
}

/// The point of a ball of radius `r` under the middle of a pixel, if any.
fn on_ball(r: f64, x: u32, y: u32) -> Option<Vec3> {
    let way = ray(&frontal(2.0, 40.0), SIZE, f64::from(x) + 0.5, f64::from(y) + 0.5).normalize();
    let b = 2.0 * way.z;
    let under_root = b * b - (4.0 - r * r);
    (under_root > 0.0).then(|| (glam::DVec3::Z * 2.0 + way * (-b - under_root.sqrt())).as_vec3())
}

#[test]
fn blinn_phong_is_its_formula() {
    let to_light = Vec3::new(-0.5, 0.6, 0.8);
    let l = to_light.normalize();
    let ball = sphere(90, 0.6);
    let seen = picture_of(&ball, phong(), &lights(to_light), &options());
    let base = Vec3::new(0.8, 0.3, 0.1);
    let (ambient, color) = (Vec3::new(0.1, 0.15, 0.2), Vec3::new(0.9, 0.8, 0.7));
    let mut compared = 0;
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let Some(p) = on_ball(0.6, x, y) else { continue };
            let n = p.normalize();
            let v = (Vec3::Z * 2.0 - p).normalize();
            if n.dot(v) < 0.2 || n.dot(l).abs() < 0.05 {
                continue;
            }
            let mut expected = base * 0.5 * ambient;
            if n.dot(l) > 0.0 {
                let h = (l + v).normalize();
                expected += (base * n.dot(l) + Vec3::splat(0.6) * n.dot(h).powf(20.0)) * color;
            }
            let shown = rgb(&seen, x, y);
            assert!((shown - expected).length() < 0.03, "{x},{y}: {shown} instead of {expected}");
            compared += 1;
        }
    }
    assert!(compared > 800, "{compared}");
}

#[test]
fn colours_replace_modulate_or_scale_before_the_light() {
    let at = |color_use| {
        let material = LookMaterial { color_use, ..phong() };
        rgb(&picture_of(&square(), material, &lights(Vec3::Z), &options()), 48, 32)
    };
    let base = Vec3::new(0.8, 0.3, 0.1);
    assert!((at(ColorUse::Replace) - base).length() < 1e-5);
    let (ambient, color) = (Vec3::new(0.1, 0.15, 0.2), Vec3::new(0.9, 0.8, 0.7));
    let highlight = 0.6 * color;
    let white = ambient * 0.5 + color + highlight;
    assert!((at(ColorUse::Modulate) - base * white).length() < 1e-3, "{}", at(ColorUse::Modulate));
    assert!((at(ColorUse::APriori) - (base * (ambient * 0.5 + color) + highlight)).length() < 1e-3);
}

#[test]
fn gloss_comes_from_a_texture() {
    let left = |at: &ShadingPoint<'_>| uv(at).x < 0.5;
    let dull_left = LookMaterial {
        specular: slot(move |at| Vec4::splat(if left(at) { 0.0 } else { 0.6 })),
        shininess: Some(slot(move |at| Vec4::splat(if uv(at).y < 0.5 { 200.0 } else { 5.0 }))),
        ..phong()
    };
    let plain = LookMaterial { specular: Slot::number(0.0), ..phong() };
    let lights = lights(Vec3::new(0.1, 0.0, 1.0));
    let (seen, matte) = (
        picture_of(&square(), dull_left, &lights, &options()),
        picture_of(&square(), plain, &lights, &options()),
    );
    assert_eq!(rgb(&seen, 40, 30), rgb(&matte, 40, 30));
    let excess = |x, y| (rgb(&seen, x, y) - rgb(&matte, x, y)).x;
    assert!(excess(52, 31) > 0.5 && excess(52, 34) > 0.5);
    // Away from the highlight the smooth upper half is dark, the rough lower one is not.
    assert!(excess(66, 20) < 0.6 * excess(66, 43), "{} {}", excess(66, 20), excess(66, 43));
}

#[test]
fn light_maps_replace_the_light_and_spots_move_over_it() {
    let spot = |at: &ShadingPoint<'_>| {
        let middle = glam::Vec2::new(0.2 + 0.3 * at.time, 0.5);
        Vec4::splat(if uv(at).distance(middle) < 0.15 { 2.0 } else { 1.0 })
    };
    let material = LookMaterial {
        light_map: Some(slot(|at| Vec4::new(uv(at).x, 0.5, 0.0, 1.0))),
        modulate: Some(slot(spot)),
        specular: Slot::number(0.0),
        ..phong()
    };
    for seconds in [0.0, 1.0, 2.0] {
        let (mesh, material) = (square(), material.clone());
        let surface = LookSurface::new(&mesh, look(material)).at_time(seconds);
        let seen =
            render(&mesh, &surface, &frontal(2.0, 40.0), &lights(Vec3::Z), &options()).unwrap().picture;
        for x in 30..66 {
            let along = (x as f32 + 0.5 - 48.0) / 64.0 * 2.0 * 2.0 * 20f32.to_radians().tan() + 0.5;
            let d = along - (0.2 + 0.3 * seconds);
            if (d.abs() - 0.15).abs() < 0.03 {
                continue;
            }
            let factor = if d.abs() < 0.15 { 2.0 } else { 1.0 };
            let expected = Vec3::new(0.8 * along, 0.15, 0.0) * factor;
            let shown = rgb(&seen, x, 32);
            assert!((shown - expected).length() < 5e-3, "{seconds} s, {x}: {shown} instead of {expected}");
        }
    }
}

/// Whatever mirrors, where no light arrives: and a light of one changes no highlight.
#[test]
fn a_light_map_of_nothing_is_black() {
    let material = |light: f32| LookMaterial {
        lighting: LightingModel::MetallicRoughness,
        light_map: Some(slot(move |_| Vec4::splat(light))),
        roughness: Slot::number(0.3),
        specular: Slot::number(1.0),
        ..phong()
    };
    let ball = sphere(24, 0.6);
    let lights = lights(Vec3::new(0.3, 0.4, 0.9));
    let middle = |light: f32| rgb(&picture_of(&ball, material(light), &lights, &options()), 48, 32);
    assert_eq!(middle(0.0), Vec3::ZERO);
    let [one, two] = [1.0, 2.0].map(middle);
    let diffuse = two - one;
    assert!((one - diffuse).min_element() > 0.01, "{one} {two}: the highlight is gone");
    assert!((middle(0.5) - 0.5 * one).abs().max_element() < 1e-5);
}

/// The modes of the fixed-function pipeline on the lit colour, with the formulas of the lecture.
#[test]
fn textures_are_combined_with_the_lit_colour() {
    let (texel, constant) = (Vec4::new(0.2, 0.6, 1.0, 0.25), Vec4::new(0.9, 0.1, 0.4, 1.0));
    let lights = lights(Vec3::Z);
    let shown = |fragment: Option<FragmentTexture>| {
        let material = LookMaterial { fragment, specular: Slot::number(0.0), ..phong() };
        rgb(&picture_of(&square(), material, &lights, &options()), 48, 32)
    };
    let lit = shown(None);
    assert!(lit.min_element() > 0.05);
    let (t, c, a) = (texel.truncate(), constant.truncate(), texel.w);
    for (mode, expected) in [
        (CombineMode::Replace, t),
        (CombineMode::Modulate, t * lit),
        (CombineMode::Decal, t * a + lit * (1.0 - a)),
        (CombineMode::Blend, lit * (Vec3::ONE - t) + c * t),
    ] {
        let fragment = FragmentTexture { mode, texture: slot(move |_| texel), constant };
        let seen = shown(Some(fragment));
        assert!((seen - expected).abs().max_element() < 1e-4, "{mode:?}: {seen} instead of {expected}");
    }
}

/// Where texels are larger than pixels, the three differences step from texel to texel: they tell apart a forward from a backward one.
#[test]
fn differences_of_bumps_step_a_texel() {
    // One ridge of a texel's width in the middle of nine.
    let heights: Vec<f32> = (0..9).map(|i| if i == 4 { 1.0 } else { 0.0 }).collect();
    let image = Arc::new(ImageTexture::new(Arc::new(Image::from_linear(9, 1, 1, heights))));
    let texture: Arc<dyn Texture> = Arc::new(ImageLookup::new(image));
    let slope_at = |u: f32, difference: Difference| {
        let relief = vec![Relief::Bump { texture: Arc::clone(&texture), height: 0.01, difference }];
        let material = LookMaterial { relief, ..phong() };
        let (mesh, options) = (square(), RenderOptions { shading: Shading::Normal, ..options() });
        let surface = LookSurface::new(&mesh, look(material));
        let picture =
            render(&mesh, &surface, &frontal(2.0, 40.0), &lights(Vec3::Z), &options).unwrap().picture;
        let per_unit = 64.0 / (2.0 * 2.0 * 20f32.to_radians().tan());
        let x = ((u - 0.5) * per_unit + 48.0).floor();
        let normal = rgb(&picture, x as u32, 32) * 2.0 - 1.0;
        // The slope, and the texel in whose middle the pixel's middle lies, fractions included.
        (-normal.x / normal.z, ((x + 0.5 - 48.0) / per_unit + 0.5) * 9.0 - 0.5)
    };
    // A texel is a ninth wide: over it the height changes by 0.01. Between texels the ridge is a tent.
    let steep = 0.09;
    let tent = |t: f32| (1.0 - (t - 4.0).abs()).max(0.0);
    for difference in [Difference::Forward, Difference::Backward, Difference::Central] {
        for texel in [3.0, 4.0, 5.0] {
            let (slope, t) = slope_at((texel + 0.5) / 9.0, difference);
            let expected = steep
                * match difference {
                    Difference::Forward => tent(t + 1.0) - tent(t),
                    Difference::Backward => tent(t) - tent(t - 1.0),
                    Difference::Central => 0.5 * (tent(t + 1.0) - tent(t - 1.0)),
                };
            assert!(
                (slope - expected).abs() < 0.2 * steep,
                "{difference:?} at {texel}: {slope}, not {expected}"
            );
        }
    }
}

#[test]
fn toon_shading_has_the_colours_of_its_scale() {
    let steps = [(-1.0, 0.1), (0.2, 0.5), (0.7, 1.0)].map(|(at, grey)| (at, Vec4::splat(grey)));
    let ramp = ColorRamp::new(steps.to_vec(), RampInterpolation::Constant).unwrap();
    let material = LookMaterial {
        toon: Some(Arc::new(ramp)),
        specular: Slot::number(0.0),
        ambient: Slot::number(0.0),
        base_color: Slot::color(Vec3::ONE),
        ..phong()
    };
    let to_light = Vec3::new(0.8, 0.1, 0.6).normalize();
    let seen = picture_of(&sphere(60, 0.6), material, &lights(to_light), &options());
    let mut count = [0; 3];
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let Some(p) = on_ball(0.6, x, y).filter(|_| on_ball(0.58, x, y).is_some()) else { continue };
            let n_l = p.normalize().dot(to_light);
            let light = rgb(&seen, x, y).x / 0.9;
            let step = [0.1, 0.5, 1.0].iter().position(|s| (light - s).abs() < 1e-4);
            // At the borders of the scale, colours are averaged over the pixel.
            if (n_l - 0.2).abs() > 0.1 && (n_l - 0.7).abs() > 0.1 {
                let step = step.unwrap_or_else(|| panic!("{x},{y}: {light} is no colour of the scale"));
                assert_eq!(step, usize::from(n_l > 0.2) + usize::from(n_l > 0.7), "{x},{y}: {n_l}");
                count[step] += 1;
            }
        }
    }
    assert!(count.iter().all(|c| *c > 100), "{count:?}");
}

#[test]
fn anisotropic_highlights_stretch_along_their_direction() {
    // On a flat square, lit and seen from the front: how far the light falls off along u and along v.
    let extent = |lighting, strength: f32, direction: [f32; 2]| {
        let encoded = Vec3::new(direction[0], direction[1], 0.0) * 0.5 + 0.5;
        let material = LookMaterial {
            lighting,
            base_color: Slot::color(Vec3::splat(0.02)),
            roughness: Slot::number(0.35),
            shininess: Some(Slot::number(100.0)),
            anisotropy: Some(Anisotropy {
                strength: Slot::number(strength),
                direction: Slot::color(encoded),
                uv_set: 0,
            }),
            ..phong()
        };
        let seen = picture_of(&square(), material, &lights(Vec3::Z), &options());
        let peak = rgb(&seen, 48, 32).x;
        let at = |x: u32, y: u32| rgb(&seen, x, y).x / peak;
        [at(64, 32), at(48, 16)]
    };
    for lighting in [LightingModel::MetallicRoughness, LightingModel::BlinnPhong] {
        let [even_u, even_v] = extent(lighting, 0.0, [1.0, 0.0]);
        assert!((even_u / even_v - 1.0).abs() < 0.2, "{lighting:?}: {even_u} {even_v}");
        let [u, v] = extent(lighting, 0.8, [1.0, 0.0]);
        assert!(u > 1.2 * even_u && v < 0.8 * even_v, "{lighting:?}: {u} {v}, without {even_u} {even_v}");
        let [u, v] = extent(lighting, 0.8, [0.0, 1.0]);
        assert!(v > 1.2 * even_v && u < 0.8 * even_u, "{lighting:?}: {u} {v} across");
        let [u, v] = extent(lighting, -0.8, [1.0, 0.0]);
        assert!(v > 1.2 * even_v && u < 0.8 * even_u, "{lighting:?}: {u} {v}, negative");
    }
}

#[test]
fn bumps_by_position_texture_coordinates_and_normal_map_agree() {
    let ball = with_uv(sphere(60, 0.6));
    let height = |p: Vec3| 0.02 * (12.0 * p.x).sin() * (9.0 * p.y).cos();
    let bump = Relief::Bump {
        texture: texture(move |at| Vec4::splat(height(at.position))),
        height: 1.0,
        difference: Difference::Central,
    };
    // The analytic gradient, as an object-space normal map.
    let map = Relief::Normal {
        texture: texture(move |at| {
            let p = at.position;
            let gradient = 0.02
                * Vec3::new(
                    12.0 * (12.0 * p.x).cos() * (9.0 * p.y).cos(),
                    -9.0 * (12.0 * p.x).sin() * (9.0 * p.y).sin(),
                    0.0,
                );
            let surface_gradient = gradient - at.normal * at.normal.dot(gradient);
            ((at.normal - surface_gradient).normalize() * 0.5 + 0.5).extend(1.0)
        }),
        scale: 1.0,
        space: NormalSpace::Object,
    };
    let options = RenderOptions { shading: Shading::Normal, ..options() };
    let [by_bump, by_map] = [bump, map].map(|relief| {
        let material = LookMaterial { relief: vec![relief], ..phong() };
        picture_of(&ball, material, &lights(Vec3::Z), &options)
    });
    let plain = picture_of(&ball, phong(), &lights(Vec3::Z), &options);
    let (mut compared, mut bent) = (0, 0.0_f32);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            // Not at the silhouette, where the pixel is wider than the bumps.
            if on_ball(0.5, x, y).is_none() {
                continue;
            }
            let off = (rgb(&by_bump, x, y) - rgb(&by_map, x, y)).length();
            assert!(off < 0.03, "{x},{y}: {off}");
            bent = bent.max((rgb(&by_bump, x, y) - rgb(&plain, x, y)).length());
            compared += 1;
        }
    }
    assert!(compared > 500 && bent > 0.1, "{compared}, bent by {bent}");
}

/// Longitude and latitude as texture coordinates.
fn with_uv(mesh: Mesh) -> Mesh {
    let uv = |p: Vec3| {
        let n = p.normalize();
        glam::Vec2::new(n.x.atan2(n.z) / std::f32::consts::TAU + 0.5, 0.5 - n.y.asin() / std::f32::consts::PI)
    };
    let corners = mesh.triangles.iter().flatten().map(|&v| uv(mesh.positions[v as usize])).collect();
    let mut mesh = mesh;
    mesh.corners.uv_sets = vec![corners];
    mesh
}

#[test]
fn tangent_space_normal_maps_are_those_of_the_models() {
    let Some(mesh) = model("meshes/WaterBottle/WaterBottle.gltf") else { return };
    let Some(map) = image_as_numbers("meshes/WaterBottle/WaterBottle_normal.png") else { return };
    let relief = Relief::Normal {
        texture: UvImage::new(map, 1.0),
        scale: 1.0,
        space: NormalSpace::Tangent(TangentSpace::of_set(0)),
    };
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let options = RenderOptions { shading: Shading::Normal, ..options() };
    let picture = |surface: &dyn Surface| {
        render(&mesh, surface, &camera, &Lights::default(), &options).unwrap().picture
    };
    let by_look = picture(&LookSurface::new(&mesh, look(LookMaterial { relief: vec![relief], ..phong() })));
    let by_model = picture(&LookSurface::of_model(&mesh, FilterOptions::default()).unwrap());
    let plain = picture(&LookSurface::new(&mesh, Vec::new()));
    let difference = |a: &Picture, b: &Picture| {
        let off = |i: usize| (Vec4::from_array(a.rgba[i]) - Vec4::from_array(b.rgba[i])).length();
        (0..a.rgba.len()).map(off).sum::<f32>() / a.rgba.len() as f32
    };
    let (off, bent) = (difference(&by_look, &by_model), difference(&plain, &by_model));
    assert!(off < 1e-4 && bent > 20.0 * off, "off by {off}, the map makes {bent}");
}

#[test]
fn far_bumps_dim_and_widen_the_highlight() {
    // Waves much finer than pixels: the same light as a rough surface, not that of a mirror.
    let fine = Relief::Bump {
        texture: texture(|at| {
            let p = at.position * 900.0;
            // Band-limited, as textures are: the wave itself is gone at the pixel's width.
            let fade = (-(900.0 * at.width()).powi(2) / 8.0).exp();
            Vec4::splat(fade * (p.x.sin() + p.y.sin()) * 3e-4)
        }),
        height: 1.0,
        difference: Difference::Central,
    };
    let metal = |relief, roughness| LookMaterial {
        lighting: LightingModel::MetallicRoughness,
        metallic: Slot::number(1.0),
        base_color: Slot::color(Vec3::ONE),
        roughness: Slot::number(roughness),
        relief,
        ..LookMaterial::default()
    };
    let dark = Lights { ambient: AmbientLight::uniform(Vec3::ZERO), ..lights(Vec3::Z) };
    let mean = |material| {
        let seen = picture_of(&square(), material, &dark, &options());
        let lit: f32 = (0..9).map(|i| rgb(&seen, 44 + i, 32).x).sum();
        lit / 9.0
    };
    // The variance of each slope is (900 x 3e-4)^2 / 2.
    let variance = 0.27_f32.powi(2) / 2.0;
    let equal = (0.2_f32.powi(4) + 2.0 * variance).powf(0.25);
    let (smooth, bumpy, rough) =
        (mean(metal(vec![], 0.2)), mean(metal(vec![fine], 0.2)), mean(metal(vec![], equal)));
    assert!(bumpy < 0.3 * smooth, "{bumpy} against {smooth}");
    assert!((bumpy / rough - 1.0).abs() < 0.35, "{bumpy} against {rough}");
}

#[test]
fn blended_layers_let_the_back_through() {
    let glass = LookMaterial {
        lighting: LightingModel::Unlit,
        base_color: Slot::color(Vec3::new(1.0, 0.0, 0.0)),
        alpha: slot(|at| Vec4::splat(uv(at).x)),
        opacity: Opacity::Blend,
        ..LookMaterial::default()
    };
    let options = RenderOptions { background: Background::Color(Vec3::new(0.0, 0.0, 1.0)), ..options() };
    let seen = picture_of(&square(), glass, &lights(Vec3::Z), &options);
    for x in 30..66 {
        let shown = rgb(&seen, x, 32);
        assert!((shown.x + shown.z - 1.0).abs() < 1e-5, "C = a A + (1 - a) S: {shown}");
    }
    assert!(rgb(&seen, 60, 32).x > rgb(&seen, 36, 32).x + 0.4);
}

#[test]
fn unlit_materials_show_their_base_color_alone() {
    let color = Vec3::new(0.2, 0.4, 0.6);
    let sign = LookMaterial {
        lighting: LightingModel::Unlit,
        base_color: Slot::color(color),
        emission: Slot::number(0.5),
        ..LookMaterial::default()
    };
    for shading in [Shading::MetallicRoughness, Shading::BlinnPhong] {
        let seen =
            picture_of(&square(), sign.clone(), &lights(Vec3::Z), &RenderOptions { shading, ..options() });
        assert!(rgb(&seen, 48, 32).abs_diff_eq(color, 1e-6), "{shading:?}");
    }
}

#[test]
fn emissive_textures_glow_beyond_their_outline() {
    let lamp = LookMaterial {
        emission: slot(|at| {
            Vec4::splat(if uv(at).distance(glam::Vec2::splat(0.5)) < 0.2 { 3.0 } else { 0.0 })
        }),
        base_color: Slot::number(0.02),
        ..LookMaterial::default()
    };
    let (mesh, glow) = (square(), Glow { radius: 0.1, ..Glow::default() });
    let surface = LookSurface::new(&mesh, look(lamp));
    let camera = frontal(2.0, 40.0);
    let dark = Lights { ambient: AmbientLight::uniform(Vec3::ZERO), lamps: Vec::new() };
    let plain = render(&mesh, &surface, &camera, &dark, &options()).unwrap().picture;
    let seen = render_with_glow(&mesh, &surface, &camera, &dark, &options(), &glow).unwrap().picture;
    assert_eq!(rgb(&plain, 66, 32), Vec3::ZERO);
    assert!(rgb(&seen, 60, 32).x > 0.1 && rgb(&seen, 85, 32).x < 0.5 * rgb(&seen, 60, 32).x);
    let sum = |p: &Picture| p.rgba.iter().map(|p| p[0]).sum::<f32>();
    let scattered = sum(&seen) / sum(&plain) - 1.0;
    assert!((scattered / glow.strength - 1.0).abs() < 0.1, "{scattered}");
}

#[test]
fn pictures() {
    let ball = with_uv(sphere(40, 0.7));
    let options = RenderOptions { samples: 8, background: Background::default(), ..options() };
    let sun = lights(Vec3::new(-0.5, 0.6, 0.8));
    let waves = Relief::Bump {
        texture: texture(|at| Vec4::splat((at.position * 20.0).to_array().map(f32::sin).iter().sum())),
        height: 0.015,
        difference: Difference::Central,
    };
    let ramp = [(-1.0, 0.15), (0.1, 0.5), (0.6, 1.0)].map(|(at, grey)| (at, Vec4::splat(grey)));
    let ramp = Arc::new(ColorRamp::new(ramp.to_vec(), RampInterpolation::Constant).unwrap());
    let brushed = Anisotropy {
        strength: Slot::number(0.9),
        direction: Slot::color(Vec3::new(1.0, 0.5, 0.5)),
        uv_set: 0,
    };
    let metal = LookMaterial {
        lighting: LightingModel::MetallicRoughness,
        metallic: Slot::number(1.0),
        roughness: Slot::number(0.4),
        anisotropy: Some(brushed),
        ..phong()
    };
    for (name, material) in [
        ("look_bump", LookMaterial { relief: vec![waves], ..phong() }),
        ("look_toon", LookMaterial { toon: Some(ramp), ..phong() }),
        ("look_anisotropic", metal),
    ] {
        common::check_golden(name, &picture_of(&ball, material, &sun, &options));
    }
}

// Looks shade many points at once as they shade them one by one.

/// By how much values may differ: what look-ups of many texels at once differ by.
const TOLERANCE: f32 = 1e-4;

fn textured(texture: impl Texture + 'static) -> Slot {
    Slot::Texture(Arc::new(texture))
}

fn image(seed: u64) -> Slot {
    let mut random = Random::new(seed);
    let samples = Samples::U8((0..64 * 64 * 4).map(|_| (random.unit() * 255.9) as u8).collect());
    let image = Image { width: 64, height: 64, channels: 4, space: ColorSpace::Srgb, samples };
    textured(ImageLookup::new(Arc::new(ImageTexture::new(Arc::new(image)))))
}

fn noise(seed: u32) -> NoiseTexture {
    NoiseTexture::new(NoiseOptions { octaves: 4, seed, cell: 0.2, ..NoiseOptions::default() })
}

fn materials() -> Vec<Arc<LookMaterial>> {
    let plain = LookMaterial::default();
    let images = LookMaterial {
        base_color: image(1),
        roughness: image(2),
        emission: image(3),
        modulate: Some(image(4)),
        opacity: Opacity::Blend,
        ..plain.clone()
    };
    let solid = LookMaterial {
        lighting: LightingModel::BlinnPhong,
        base_color: textured(SolidTexture(Rock::new(1))),
        metallic: textured(noise(1)),
        occlusion: textured(noise(2)),
        ambient: textured(noise(3)),
        specular: image(5),
        shininess: Some(textured(noise(4))),
        reflection: textured(noise(5)),
        light_map: Some(image(6)),
        relief: vec![Relief::Bump {
            texture: Arc::new(noise(6)),
            height: 0.01,
            difference: Difference::Central,
        }],
        ..plain.clone()
    };
    let cut_out =
        LookMaterial { base_color: image(7), opacity: Opacity::Mask { threshold: 0.5 }, ..plain.clone() };
    [plain, images, solid, cut_out].map(Arc::new).into()
}

fn assert_alike(got: &(MaterialSample, Option<Finish<'_>>), alone: &(MaterialSample, Option<Finish<'_>>)) {
    let numbers = |(sample, finish): &(MaterialSample, Option<Finish<'_>>)| {
        let finish = finish.as_ref().unwrap();
        let vectors = [
            sample.base_color,
            sample.normal,
            sample.emission,
            finish.ambient,
            finish.specular,
            finish.reflection,
            finish.light_map.unwrap_or(Vec3::ZERO),
            finish.modulate,
        ];
        let mut numbers = vectors.map(|v| v.to_array()).as_flattened().to_vec();
        numbers.extend([sample.alpha, sample.occlusion, sample.roughness, sample.metallic]);
        numbers.push(finish.shininess.unwrap_or(0.0));
        numbers
    };
    for (index, (a, b)) in numbers(got).iter().zip(numbers(alone)).enumerate() {
        // Of the cut-out's alpha, one of sixteen comparisons may fall differently.
        let tolerance = if index == 24 { 0.07 } else { TOLERANCE };
        assert!((a - b).abs() <= tolerance, "number {index}: {a}, alone {b}");
    }
}

#[test]
fn textures_see_all_sets_of_texture_coordinates() {
    let mut mesh = sheet(2, 0.0, 1);
    let corners = 3 * mesh.triangles.len();
    mesh.corners.uv_sets = (0..8).map(|set| vec![glam::Vec2::splat(set as f32 / 8.0); corners]).collect();
    let lambda = Vec3::splat(1.0 / 3.0);
    let hit = Hit {
        at: SurfacePoint { triangle: 0, lambda },
        lambda_steps: [Vec3::ZERO; 2],
        front: true,
        to_eye: Vec3::Z,
    };
    for set in 0..8 {
        let base_color = slot(move |at| Vec4::splat(at.uv[set].uv.x));
        let material = LookMaterial { base_color, ..LookMaterial::default() };
        let surface = LookSurface::new(&mesh, look(material));
        let color = surface.shade(&hit).0.base_color;
        assert!((color - set as f32 / 8.0).abs().max_element() < 1e-6, "set {set}: {color}");
    }
}

#[test]
fn many_points_are_shaded_like_single_ones() {
    let mut mesh = sheet(12, 0.08, 11);
    let uv = mesh.triangles.as_flattened().iter().map(|&v| mesh.positions[v as usize].truncate());
    mesh.corners.uv_sets = vec![uv.map(|p| p * 2.0 + 0.5).collect()];
    let count = mesh.triangles.len();
    // Runs of several lengths, and single triangles.
    let material = |t: usize| if t < count / 2 { (t / 23 % 4) as u32 } else { (t % 4) as u32 };
    mesh.triangle_materials = (0..count).map(material).collect();
    let mesh = Mesh { materials: vec![fantex_mesh::Material::default(); 4], ..mesh };
    let surface = LookSurface::new(&mesh, materials());
    let mut random = Random::new(3);
    let hits: Vec<Hit> = (0..count as u32)
        .map(|triangle| {
            let weights = Vec3::new(random.unit(), random.unit(), random.unit()) + 0.01;
            let step = |random: &mut Random| {
                let [a, b] = [random.signed() * 0.2, random.signed() * 0.2];
                Vec3::new(a, b, -a - b)
            };
            Hit {
                at: SurfacePoint { triangle, lambda: weights / weights.element_sum() },
                lambda_steps: [step(&mut random), step(&mut random)],
                front: triangle % 3 != 0,
                to_eye: Vec3::new(0.3, 0.2, 0.93).normalize(),
            }
        })
        .collect();
    for size in [1, 3, 50, 128] {
        for hits in hits.chunks(size) {
            let mut shaded = Vec::new();
            surface.shade_all(hits, &mut shaded);
            assert_eq!(shaded.len(), hits.len());
            for (hit, got) in hits.iter().zip(&shaded) {
                assert_alike(got, &surface.shade(hit));
            }
        }
    }
}

/// The colour that a material shows at a point of its front or back, with the normal that it is lit by.
fn seen_at(mesh: &Mesh, material: &LookMaterial, at: SurfacePoint, front: bool) -> (Vec3, Vec3) {
    let surface = LookSurface::new(mesh, look(material.clone()));
    let lambda_steps = [Vec3::new(0.01, -0.01, 0.0), Vec3::new(0.0, 0.01, -0.01)];
    let sample = surface.shade(&Hit { at, lambda_steps, front, to_eye: Vec3::Y }).0;
    (sample.base_color, sample.normal)
}

#[test]
fn both_sides_show_what_a_bake_holds() {
    let normal = |at: &ShadingPoint<'_>| (at.normal * 0.5 + 0.5).extend(1.0);
    let material = LookMaterial { base_color: slot(normal), ..LookMaterial::default() };
    let ball = sphere(20, 0.6);
    for triangle in (0..ball.triangles.len() as u32).step_by(7) {
        let at = SurfacePoint { triangle, lambda: Vec3::new(0.2, 0.3, 0.5) };
        let [front, back] = [true, false].map(|front| seen_at(&ball, &material, at, front));
        assert_eq!(front.0, back.0);
        assert_eq!(front.1, -back.1);
        assert!((front.0 * 2.0 - 1.0 - front.1).length() < 1e-6);
    }
}

#[test]
fn object_space_has_its_origin_in_the_middle_of_the_bounding_box() {
    let position = |at: &ShadingPoint<'_>| (at.position + 10.0).extend(1.0);
    let material = LookMaterial { base_color: slot(position), ..LookMaterial::default() };
    // A corner of the square, moved, as rounding of the mesh's origin leaves it.
    let mut mesh = square();
    let moved = Vec3::new(0.06, 0.04, -0.02);
    mesh.positions.iter_mut().for_each(|p| *p += moved);
    mesh.world_from_mesh.scale = 4.0;
    mesh.world_from_mesh.offset = glam::DVec3::new(100.0, 0.0, 0.0);
    let at = SurfacePoint { triangle: 0, lambda: Vec3::Y };
    let (seen, _) = seen_at(&mesh, &material, at, true);
    assert!((seen - Vec3::new(12.0, 8.0, 10.0)).abs().max_element() < 1e-5, "{seen}");
}
