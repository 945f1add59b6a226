//! Several objects in one picture, and their lamps.

use std::sync::Arc;

use fantex_mesh::{Mesh, SurfacePoint};
use fantex_render::{
    AmbientLight, Background, Camera, Cookie, Falloff, FilterOptions, FlatShading, FlatSurface,
    Interpolation, Lens, Light, LightKind, Lights, LookSurface, Projector, RenderOptions, Scene, SceneObject,
    Shading, ShadowOptions, SpotLight, render,
};
use fantex_texture::look::{LightingModel, LookMaterial, Opacity, Slot};
use fantex_texture::{Image, ImageTexture, SampleOptions, Texture};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, Vec4};

use crate::common;
use crate::common::{
    Function, above, frontal, ground, lit_by, look, matte, on_ground, options, picture, ray, roof, sphere,
    square, triangle_color,
};

#[test]
fn an_ellipsoid_has_its_own_normals() {
    let ball = sphere(48, 0.5);
    let surface = LookSurface::new(&ball, look(LookMaterial { double_sided: false, ..matte() }));
    for mirror in [1.0, -1.0] {
        let stretch = DMat3::from_quat(DQuat::from_rotation_z(0.6))
            * DMat3::from_diagonal(DVec3::new(2.0 * mirror, 0.7, 1.0));
        let place = DAffine3 { matrix3: stretch, translation: DVec3::new(100.0, -20.0, 5.0) };
        let scene = Scene::new(vec![SceneObject::new(&ball, &surface).placed(place)]).unwrap();
        let camera = Camera {
            eye: place.translation + DVec3::Z * 4.0,
            target: place.translation,
            up: DVec3::Y,
            fov_degrees: 40.0,
        };
        let seen = picture(&scene, &camera, &Lights::default(), &options(Shading::Normal));
        let mut compared = 0;
        for y in 0..90 {
            for x in 0..120 {
                // The ray in the ball's own space meets a sphere.
                let inverse = place.inverse();
                let way = inverse.transform_vector3(ray(
                    &camera,
                    [120, 90],
                    f64::from(x) + 0.5,
                    f64::from(y) + 0.5,
                ));
                let eye = inverse.transform_point3(camera.eye);
                let (a, b, c) = (way.length_squared(), eye.dot(way), eye.length_squared() - 0.25);
                let under_root = b * b - a * c;
                if under_root < 0.1 * a * 0.25 {
                    continue;
                }
                let p = eye + way * ((-b - under_root.sqrt()) / a);
                let normal = (stretch.inverse().transpose() * p).normalize().as_vec3();
                let [r, g, b, _] = seen.pixel(x, y);
                let shown = Vec3::new(r, g, b) * 2.0 - 1.0;
                assert!((shown - normal).length() < 0.03, "{mirror} {x},{y}: {shown} instead of {normal}");
                compared += 1;
            }
        }
        assert!(compared > 500, "{compared}");
    }
}

#[test]
fn objects_hide_each_other_and_keep_their_triangles() {
    let (near, far) = (square(), sphere(8, 0.5));
    let [one, two] = [&near, &far].map(|mesh| FlatSurface::new(mesh, FlatShading::Unlit, triangle_color));
    let scene = Scene::new(vec![
        SceneObject::new(&far, &two),
        SceneObject::new(&near, &one).placed(DAffine3::from_translation(DVec3::new(0.3, 0.0, 1.0))),
    ])
    .unwrap();
    assert_eq!(scene.object_of(0), (0, 0));
    assert_eq!(scene.object_of(far.triangles.len() + 1), (1, 1));
    assert!((scene.bounds().max - DVec3::new(0.8, 0.5, 1.0)).length() < 1e-6, "{:?}", scene.bounds());
    let options = RenderOptions { samples: 1, ..options(Shading::BaseColor) };
    let both = picture(&scene, &frontal(3.0, 40.0), &Lights::default(), &options);
    let alone = Scene::new(vec![SceneObject::new(&far, &two)]).unwrap();
    let alone = picture(&alone, &frontal(3.0, 40.0), &Lights::default(), &options);
    // Left of the square the ball is as if it were alone; only pixels at edges may differ.
    let left = (0..90).flat_map(|y| (0..46).map(move |x| (x, y)));
    let differ = left.filter(|&(x, y)| {
        let [a, b] = [&both, &alone].map(|p| Vec4::from_array(p.pixel(x, y)));
        (a - b).length() > 1e-4
    });
    let differ = differ.count();
    assert!(differ < 20, "{differ} pixels");
    let [r, g, b, _] = both.pixel(75, 45);
    let colors = [0, 1].map(|t| {
        triangle_color(&fantex_render::Hit {
            at: SurfacePoint::corner(t, 0),
            lambda_steps: [Vec3::ZERO; 2],
            front: true,
            to_eye: Vec3::Z,
        })
    });
    assert!(colors.iter().any(|c| (*c - Vec3::new(r, g, b)).length() < 1e-5), "the square is in front");
}

#[test]
fn affine_interpolation_works_on_scenes() {
    let mesh = square();
    let surface = LookSurface::of_model(&mesh, FilterOptions::default()).unwrap();
    let flat = FlatSurface::new(&mesh, FlatShading::Unlit, |hit| hit.at.lambda);
    let camera =
        Camera { eye: DVec3::new(0.1, -0.75, 0.25), target: DVec3::ZERO, up: DVec3::Z, fov_degrees: 60.0 };
    let away = DAffine3::from_translation(DVec3::X * 5.0);
    let objects = || vec![SceneObject::new(&mesh, &flat), SceneObject::new(&mesh, &surface).placed(away)];
    let scene = Scene::new(objects()).unwrap();
    let mut pictures = Vec::new();
    for interpolation in [Interpolation::Perspective, Interpolation::Affine] {
        let options = RenderOptions { interpolation, ..options(Shading::BaseColor) };
        let alone = render(&mesh, &flat, &camera, &Lights::default(), &options).unwrap().picture;
        let within = picture(&scene, &camera, &Lights::default(), &options);
        let off = alone
            .rgba
            .iter()
            .zip(&within.rgba)
            .filter(|(a, b)| (Vec4::from_array(**a) - Vec4::from_array(**b)).length() > 0.02);
        assert!(off.count() < 80, "only pixels at edges may differ");
        pictures.push(within);
    }
    assert_ne!(pictures[0], pictures[1]);
}

#[test]
fn impossible_scenes_and_lamps_are_refused() {
    let mesh = square();
    let surface = LookSurface::new(&mesh, Vec::new());
    let flattened = SceneObject::new(&mesh, &surface).placed(DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)));
    let error = Scene::new(vec![SceneObject::new(&mesh, &surface), flattened]).unwrap_err();
    assert!(error.to_string().starts_with("object 1 cannot be placed"), "{error}");
    let spot = |inner_degrees, outer_degrees| {
        LightKind::Spot(SpotLight {
            position: DVec3::Y,
            direction: Vec3::NEG_Y,
            inner_degrees,
            outer_degrees,
            falloff: Falloff::None,
        })
    };
    let huge = ShadowOptions { resolution: 1 << 20, ..ShadowOptions::default() };
    for bad in [
        Light::directional(Vec3::ZERO, Vec3::ONE),
        Light::directional(Vec3::Y, Vec3::splat(f32::NAN)),
        Light::new(spot(40.0, 30.0), Vec3::ONE),
        Light::new(spot(10.0, 120.0), Vec3::ONE),
        Light::directional(Vec3::Y, Vec3::ONE).with_shadow(huge),
    ] {
        let lights = lit_by(vec![Light::directional(Vec3::Y, Vec3::ONE), bad]);
        let error =
            render(&mesh, &surface, &frontal(2.0, 40.0), &lights, &options(Shading::BaseColor)).unwrap_err();
        assert!(error.to_string().starts_with("cannot render with lamp 1 "), "{error}");
    }
}

#[test]
fn projectors_land_where_the_inverse_projection_says() {
    let floor = ground();
    let surface = LookSurface::new(&floor, look(matte()));
    let place = DAffine3::from_scale(DVec3::splat(6.0));
    let scene = Scene::new(vec![SceneObject::new(&floor, &surface).placed(place)]).unwrap();
    let (position, target) = (DVec3::new(-0.5, 2.0, 0.7), DVec3::new(0.2, 0.0, -0.1));
    let forward = (target - position).normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let up = right.cross(forward);
    let aspect = 1.5;
    for lens in [Lens::Perspective { fov_degrees: 30.0 }, Lens::Orthographic { height: 1.1 }] {
        let cookie = Cookie::Texture(Arc::new(Function(|at: &fantex_texture::ShadingPoint<'_>| {
            at.uv[0].uv.extend(0.5).extend(1.0)
        })));
        let kind = LightKind::Projector(Projector {
            position,
            target,
            up: DVec3::Y,
            lens,
            aspect,
            cookie,
            falloff: Falloff::None,
        });
        let lights = lit_by(vec![Light::new(kind, Vec3::ONE)]);
        let camera = above(2.5);
        let seen =
            picture(&scene, &camera, &lights, &RenderOptions { samples: 1, ..options(Shading::BlinnPhong) });
        let (mut lit, mut dark) = (0, 0);
        for y in 0..90 {
            for x in 0..120 {
                let Some(p) = on_ground(&camera, [120, 90], x, y) else { continue };
                let d = p - position;
                let (half, to_light) = match lens {
                    Lens::Perspective { fov_degrees } => {
                        ((fov_degrees / 2.0).to_radians().tan() * d.dot(forward), -d.normalize())
                    }
                    Lens::Orthographic { height } => (0.5 * height, -forward),
                };
                let u = 0.5 + 0.5 * d.dot(right) / (half * aspect);
                let v = 0.5 - 0.5 * d.dot(up) / half;
                let border = (u - 0.5).abs().max((v - 0.5).abs()) - 0.5;
                let [r, g, b, _] = seen.pixel(x, y);
                if border < -0.02 {
                    let expected = DVec3::new(u, v, 0.5) * to_light.y;
                    let off = (Vec3::new(r, g, b).as_dvec3() - expected).length();
                    assert!(off < 4e-3, "{lens:?} {x},{y}: {r} {g} {b} instead of {expected}");
                    lit += 1;
                } else if border > 0.02 {
                    assert_eq!([r, g, b], [0.0; 3], "{x},{y}");
                    dark += 1;
                }
            }
        }
        assert!(lit > 500 && dark > 500, "{lens:?}: {lit} lit, {dark} dark");
    }
}

#[test]
fn cookies_are_filtered_and_move_with_time() {
    let floor = ground();
    let surface = LookSurface::new(&floor, look(matte()));
    let place = DAffine3::from_scale(DVec3::splat(6.0));
    let scene = Scene::new(vec![SceneObject::new(&floor, &surface).placed(place)]).unwrap();
    let lit_by_cookie = |cookie| {
        lit_by(vec![Light::new(
            LightKind::Projector(Projector {
                position: DVec3::Y * 2.0,
                target: DVec3::ZERO,
                up: DVec3::NEG_Z,
                lens: Lens::Orthographic { height: 4.0 },
                aspect: 1.0,
                cookie,
                falloff: Falloff::None,
            }),
            Vec3::ONE,
        )])
    };
    let camera = above(2.5);
    let seen = |cookie, seconds| {
        let options = RenderOptions { samples: 1, time: seconds, ..options(Shading::BlinnPhong) };
        picture(&scene, &camera, &lit_by_cookie(cookie), &options)
    };
    // Checks far smaller than pixels are grey.
    let checks: Vec<_> = (0..1024 * 1024).map(|i| [((i ^ (i >> 10)) & 1) as f32; 4]).collect();
    let image = Image::from_linear_rgb(1024, 1024, &checks);
    let image = Arc::new(ImageTexture::new(Arc::new(image)));
    let grey = seen(Cookie::Image { image, options: SampleOptions::default() }, 0.0);
    for (x, y) in [(60, 45), (40, 30), (80, 60)] {
        assert!((grey.pixel(x, y)[0] - 0.5).abs() < 0.02, "{x},{y}: {}", grey.pixel(x, y)[0]);
    }
    // A spot that moves to the right.
    let spot = Function(|at: &fantex_texture::ShadingPoint<'_>| {
        let middle = 0.4 + 0.2 * at.time;
        Vec4::splat(if (at.uv[0].uv.x - middle).abs() < 0.06 { 1.0 } else { 0.0 }).with_w(1.0)
    });
    let spot: Arc<dyn Texture> = Arc::new(spot);
    let brightest = |seconds| {
        let seen = seen(Cookie::Texture(Arc::clone(&spot)), seconds);
        (0..120).filter(|&x| seen.pixel(x, 45)[0] > 0.5).sum::<u32>() as f32
            / (0..120).filter(|&x| seen.pixel(x, 45)[0] > 0.5).count() as f32
    };
    assert!(brightest(1.0) > brightest(0.0) + 15.0, "{} {}", brightest(0.0), brightest(1.0));
}

#[test]
fn spots_light_their_cone() {
    let floor = ground();
    let surface = LookSurface::new(&floor, look(matte()));
    let place = DAffine3::from_scale(DVec3::splat(6.0));
    let scene = Scene::new(vec![SceneObject::new(&floor, &surface).placed(place)]).unwrap();
    let spot = SpotLight {
        position: DVec3::Y * 2.0,
        direction: Vec3::NEG_Y,
        inner_degrees: 15.0,
        outer_degrees: 20.0,
        falloff: Falloff::InverseSquare { reference: 2.0, range: None },
    };
    let camera = above(2.5);
    for shadow in [None, Some(ShadowOptions { resolution: 512, ..ShadowOptions::default() })] {
        let light = Light { shadow, ..Light::new(LightKind::Spot(spot), Vec3::ONE) };
        let seen = picture(&scene, &camera, &lit_by(vec![light]), &options(Shading::BlinnPhong));
        for y in 0..90 {
            for x in 0..120 {
                let Some(p) = on_ground(&camera, [120, 90], x, y) else { continue };
                let angle = (p.length() / 2.0).atan().to_degrees();
                let light = seen.pixel(x, y)[0];
                if angle < 14.5 {
                    let cosine = angle.to_radians().cos();
                    // The cosine of incidence times the square of the distance's.
                    assert!((f64::from(light) - cosine.powi(3)).abs() < 5e-3, "{x},{y} at {angle}: {light}");
                } else if angle > 20.5 {
                    assert_eq!(light, 0.0, "{x},{y} at {angle}");
                }
            }
        }
    }
}

#[test]
fn pictures() {
    let (floor, ball) = (ground(), sphere(32, 0.5));
    let plain = || LookMaterial { base_color: Slot::color(Vec3::splat(0.7)), ..LookMaterial::default() };
    let [below, on_it] = [&floor, &ball].map(|mesh| LookSurface::new(mesh, look(plain())));
    let scene = Scene::new(vec![
        SceneObject::new(&floor, &below).placed(DAffine3::from_scale(DVec3::splat(4.0))),
        SceneObject::new(&ball, &on_it).placed(DAffine3::from_translation(DVec3::Y * 0.5)),
    ])
    .unwrap();
    let camera = Camera {
        eye: DVec3::new(1.2, 1.6, 2.6),
        target: DVec3::new(0.1, 0.3, 0.0),
        up: DVec3::Y,
        fov_degrees: 35.0,
    };
    let options = RenderOptions { width: 96, height: 64, ..RenderOptions::default() };
    let sun = |lamp_radius| {
        let shadow = ShadowOptions { resolution: 512, lamp_radius, ..ShadowOptions::default() };
        Lights::sun(Vec3::new(-0.9, 0.8, 0.4)).with_shadows(shadow)
    };
    common::check_golden("scene_sharp_shadow", &picture(&scene, &camera, &sun(None), &options));
    common::check_golden("scene_soft_shadow", &picture(&scene, &camera, &sun(Some(0.15)), &options));
    let stripes = Function(|at: &fantex_texture::ShadingPoint<'_>| {
        let wave = (at.uv[0].uv * 25.0).to_array().map(|c| 0.5 + 0.5 * c.sin());
        Vec4::new(wave[0], wave[1], 0.3, 1.0)
    });
    let projector = LightKind::Projector(Projector {
        position: DVec3::new(-0.8, 1.8, 2.0),
        target: DVec3::Y * 0.3,
        up: DVec3::Y,
        lens: Lens::Perspective { fov_degrees: 40.0 },
        aspect: 1.5,
        cookie: Cookie::Texture(Arc::new(stripes)),
        falloff: Falloff::None,
    });
    let shadow = ShadowOptions { resolution: 512, ..ShadowOptions::default() };
    let lights = Lights {
        ambient: AmbientLight::uniform(Vec3::splat(0.1)),
        lamps: vec![Light::new(projector, Vec3::ONE).with_shadow(shadow)],
    };
    common::check_golden("scene_projector", &picture(&scene, &camera, &lights, &options));
}

// Shadows and cut-outs.

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
fn what_lies_behind_a_projector_casts_no_shadow() {
    let floor = ground();
    let surface = LookSurface::new(&floor, look(matte()));
    let scene = roof(&floor, &floor, &surface, &surface);
    // Under the roof.
    let camera =
        Camera { eye: DVec3::new(0.0, 0.3, 3.0), target: DVec3::ZERO, up: DVec3::Y, fov_degrees: 20.0 };
    let white = Cookie::Texture(Arc::new(Function(|_: &fantex_texture::ShadingPoint<'_>| Vec4::ONE)));
    for lens in [Lens::Perspective { fov_degrees: 60.0 }, Lens::Orthographic { height: 2.0 }] {
        let light = |height: f64, shadow: Option<ShadowOptions>| {
            let kind = LightKind::Projector(Projector {
                position: DVec3::Y * height,
                target: DVec3::ZERO,
                up: DVec3::NEG_Z,
                lens,
                aspect: 1.0,
                cookie: white.clone(),
                falloff: Falloff::None,
            });
            let lights = lit_by(vec![Light { shadow, ..Light::new(kind, Vec3::ONE) }]);
            let options = RenderOptions { samples: 1, ..options(Shading::BlinnPhong) };
            picture(&scene, &camera, &lights, &options).pixel(60, 45)[0]
        };
        let shadow = Some(ShadowOptions::default());
        assert!(light(0.4, None) > 0.1, "{lens:?}");
        assert_eq!(light(0.4, shadow), light(0.4, None), "{lens:?}");
        assert_eq!(light(0.6, shadow), 0.0, "{lens:?}");
    }
}

#[test]
fn wide_penumbrae_are_even_ramps() {
    let (floor, square) = (ground(), ground());
    let (below, plate) = (LookSurface::new(&floor, look(matte())), LookSurface::new(&square, look(matte())));
    let scene = roof(&floor, &square, &below, &plate);
    // Beside the plate, onto the border of its shadow, so near that a pixel is a fortieth of it.
    let edge = 0.5 * 2.0 / 1.5;
    let camera = Camera {
        eye: DVec3::new(2.0, 4.0, 0.1),
        target: DVec3::new(edge, 0.0, 0.1),
        up: DVec3::Y,
        fov_degrees: 6.0,
    };
    let kind = LightKind::Point { position: DVec3::Y * 2.0, falloff: Falloff::None };
    let options = RenderOptions { samples: 1, ..options(Shading::BlinnPhong) };
    let lights = |shadow| lit_by(vec![Light { shadow, ..Light::new(kind.clone(), Vec3::ONE) }]);
    let free = picture(&scene, &camera, &lights(None), &options);
    for (softness, lamp_radius, half_width) in [(0.1, None, 0.1), (0.2, None, 0.2), (0.0, Some(0.3), 0.1)] {
        let shadow = ShadowOptions { softness, lamp_radius, resolution: 2048, ..ShadowOptions::default() };
        let seen = picture(&scene, &camera, &lights(Some(shadow)), &options);
        let arriving = |x: u32, y: u32| seen.pixel(x, y)[0] / free.pixel(x, y)[0];
        let mut in_between = 0;
        for y in 1..90 {
            for x in 0..120 {
                let Some(p) = on_ground(&camera, [120, 90], x, y) else { continue };
                let expected = (0.5 + 0.5 * (p.x - edge) / half_width).clamp(0.0, 1.0) as f32;
                let share = arriving(x, y);
                let name = format!("{:?} at {x},{y}", shadow.penumbra());
                assert!((share - expected).abs() < 0.03, "{name}: {share} instead of {expected}");
                in_between += u32::from(share > 0.1 && share < 0.9);
                // The border runs along the pixels' rows.
                let beside = share - arriving(x.max(1) - 1, y);
                assert!(beside.abs() < 0.012, "{name}: differs by {beside} from the pixel beside it");
            }
        }
        assert!(in_between > 2000, "{in_between}");
    }
}

#[test]
fn shadows_have_no_gap_where_the_six_maps_of_a_lamp_meet() {
    let floor = ground();
    let surface = LookSurface::new(&floor, look(matte()));
    let object = |height: f64, scale: f64| {
        let place = DAffine3::from_translation(DVec3::Y * height) * DAffine3::from_scale(DVec3::splat(scale));
        SceneObject::new(&floor, &surface).placed(place)
    };
    // All of the floor lies in the plate's shadow; the maps meet one unit from the middle.
    let scene = Scene::new(vec![object(0.0, 6.0), object(0.5, 4.0)]).unwrap();
    let camera = Camera {
        eye: DVec3::new(0.2, 0.45, 1.9),
        target: DVec3::new(0.0, 0.0, 0.6),
        up: DVec3::Y,
        fov_degrees: 80.0,
    };
    let kind = LightKind::Point { position: DVec3::Y, falloff: Falloff::None };
    for (resolution, normal_offset) in [(16, 1.5), (64, 1.5), (64, 6.0), (256, 6.0)] {
        let shadow = ShadowOptions { resolution, normal_offset, ..ShadowOptions::default() };
        let lamp = Light::new(kind.clone(), Vec3::ONE).with_shadow(shadow);
        let seen = picture(&scene, &camera, &lit_by(vec![lamp]), &options(Shading::BlinnPhong));
        let mut compared = 0;
        for (x, y) in (0..120).flat_map(|x| (0..90).map(move |y| (x, y))) {
            let Some(p) = on_ground(&camera, [120, 90], x, y) else { continue };
            if p.x.abs().max(p.z.abs()) < 1.5 {
                let light = seen.pixel(x, y)[0];
                assert!(light < 0.01, "{resolution}, {normal_offset}: {light} at {p}");
                compared += 1;
            }
        }
        assert!(compared > 2000, "{compared}");
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
    let surface = LookSurface::of_model(&ball, FilterOptions::default()).unwrap();
    let camera = frontal(3.0, 40.0);
    for (softness, lamp_radius) in [(0.0, None), (0.02, None), (0.0, Some(0.05))] {
        for resolution in [256, 1024] {
            let shadow = ShadowOptions { softness, lamp_radius, resolution, ..ShadowOptions::default() };
            let penumbra = shadow.penumbra();
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
    let fence = common::UvImage::new(common::bars(128, 16, 4), 4.0);
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
        base_color: Slot::Texture(common::UvImage::new(common::bars(128, 16, 4), 4.0)),
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
