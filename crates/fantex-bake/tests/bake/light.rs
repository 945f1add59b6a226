//! Light maps against closed forms: furnaces, sun, lamps, occlusion by a sphere, the edge of a shadow; and their noise.

use std::sync::atomic::{AtomicU32, Ordering};

use fantex_bake::{
    BakeLight, BakeOptions, Fit, Illumination, LightMapOptions, LightMapSource, LightQuantity, LightScene,
    Progress, Reflector, Source, SourceReflector, bake,
};
use fantex_mesh::{Mesh, Model, SurfacePoint, TriangleBvh, generate, interpolate};
use fantex_store::{ChannelKind, VerifyOptions, verify};
use glam::{DMat3, DVec3, Vec3};

use crate::common;
use crate::common::{OfPosition, baked, cleaned, cover, data_folder, float_options, loaded, sample};

fn black(_: Vec3) -> Vec3 {
    Vec3::ZERO
}

fn white(_: Vec3) -> Vec3 {
    Vec3::ONE
}

fn gray(_: SurfacePoint) -> Vec3 {
    Vec3::splat(0.5)
}

/// Everything glows and reflects alike.
struct Furnace {
    albedo: Vec3,
    emission: Vec3,
}

impl Reflector for Furnace {
    fn albedo(&self, _: SurfacePoint) -> Vec3 {
        self.albedo
    }

    fn emission(&self, _: SurfacePoint) -> Vec3 {
        self.emission
    }
}

fn joined(models: &[Model]) -> Model {
    let mut all = Model { name: "joined".into(), ..Model::default() };
    for model in models {
        let first = all.positions.len() as u32;
        all.positions.extend(&model.positions);
        all.triangles.extend(model.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    all
}

fn placed(mut model: Model, scale: f64, offset: DVec3) -> Model {
    model.positions.iter_mut().for_each(|p| *p = *p * scale + offset);
    model
}

fn inside_out(mut model: Model) -> Model {
    model.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    model
}

/// The light at the point of the front that is nearest to a place, world space.
fn point(triangle: usize, lambda: Vec3) -> SurfacePoint {
    SurfacePoint { triangle: triangle as u32, lambda }
}

fn light_at(source: &LightMapSource<'_>, mesh: &Mesh, place: DVec3) -> Illumination {
    let p = mesh.world_from_mesh.inverse_point(place);
    let nearest = TriangleBvh::new(mesh).nearest_point(p, 1e-3).unwrap();
    source.illumination(nearest.point, [Vec3::ZERO; 2])
}

fn direct(samples: u32) -> LightMapOptions {
    LightMapOptions { quantity: LightQuantity::Direct, samples, ..LightMapOptions::default() }
}

/// In a closed room whose walls glow with e and reflect a share a, the light is e (1 + a + a^2 + ...) everywhere.
#[test]
fn a_closed_furnace_has_the_sum_of_the_geometric_series() {
    let furnace = Furnace { albedo: Vec3::new(0.6, 0.8, 0.0), emission: Vec3::new(0.5, 0.25, 1.0) };
    let series = |bounces: i32| {
        let sum = |a: f32| (0..=bounces).map(|k| a.powi(k)).sum::<f32>();
        furnace.emission * furnace.albedo.map(sum)
    };
    for room in [generate::cube(3), generate::icosphere(3)] {
        let mesh = cleaned(inside_out(room));
        let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &furnace };
        for bounces in [0, 1, 3] {
            let options = LightMapOptions { bounces, samples: 16, ..LightMapOptions::default() };
            let source = LightMapSource::new(&mesh, &scene, options).unwrap();
            for triangle in (0..mesh.triangles.len()).step_by(7) {
                let light = source.illumination(point(triangle, Vec3::new(0.2, 0.5, 0.3)), [Vec3::ZERO; 2]);
                let expected = series(bounces as i32);
                assert!((light.value - expected).length() < 1e-5, "{bounces}: {} {expected}", light.value);
                assert!(light.standard_error < 1e-6);
            }
        }
        // Russian roulette takes part, and is right on average.
        let options = LightMapOptions { bounces: 60, samples: 4096, ..LightMapOptions::default() };
        let source = LightMapSource::new(&mesh, &scene, options).unwrap();
        let light = source.illumination(point(5, Vec3::splat(1.0 / 3.0)), [Vec3::ZERO; 2]);
        let (error, noise) = ((light.value - series(60)).length(), light.standard_error);
        assert!(error < 6.0 * noise && noise < 0.02, "{error} +- {noise}");
    }
}

#[test]
fn a_plane_under_the_sun_has_the_cosine() {
    let mesh = cleaned(generate::grid(4));
    for degrees in [0.0_f32, 30.0, 60.0, 80.0] {
        for radius_degrees in [0.0, 5.0, 90.0 - degrees] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let color = Vec3::new(3.0, 2.0, 0.5);
            let to_light = Vec3::new(sin, cos, 0.0) * 7.0;
            let lights = vec![BakeLight::Directional { to_light, color, radius_degrees }];
            let scene = LightScene { lights, sky: &black, reflector: &gray };
            let source = LightMapSource::new(&mesh, &scene, direct(1024)).unwrap();
            // The colour is what a surface reflects that faces the light, however large the light is.
            let expected = color * cos;
            let light = light_at(&source, &mesh, DVec3::new(0.13, 0.0, 0.31));
            let error = (light.value - expected).length();
            assert!(error < 2e-3, "{degrees} {radius_degrees}: {} {expected}", light.value);
        }
    }
}

#[test]
fn lamps_fall_off_with_the_square_in_world_units_and_balls_as_points() {
    // The same scene twice as large has the same light a quarter as strong; a lamp's size does not matter without shadows.
    for scale in [1.0, 2.0] {
        let mesh = cleaned(placed(generate::grid(4), scale, DVec3::new(5.0, -3.0, 100.0)));
        let place = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * scale + DVec3::new(5.0, -3.0, 100.0);
        for radius in [0.0, 0.3] {
            let radius = radius * scale;
            let position = place(0.2, 0.5, 0.1);
            let color = Vec3::new(1.0, 2.0, 3.0);
            let spot = |inner_degrees, outer_degrees| BakeLight::Spot {
                position,
                axis: Vec3::NEG_Y,
                color,
                radius,
                inner_degrees,
                outer_degrees,
            };
            for light in [BakeLight::Point { position, color, radius }, spot(80.0, 90.0)] {
                let scene = LightScene { lights: vec![light], sky: &black, reflector: &gray };
                let source = LightMapSource::new(&mesh, &scene, direct(4096)).unwrap();
                for (x, z) in [(0.2, 0.1), (-0.3, 0.4), (0.7, -0.7)] {
                    let light = light_at(&source, &mesh, place(x, 0.0, z));
                    let distance = place(x, 0.0, z).distance(position);
                    let expected = color * (0.5 * scale / distance.powi(3)) as f32;
                    let error = (light.value - expected).length() / expected.length();
                    assert!(error < 4e-3, "{x} {z}: {} {expected}", light.value);
                }
            }
            let scene = LightScene { lights: vec![spot(10.0, 20.0)], sky: &black, reflector: &gray };
            let source = LightMapSource::new(&mesh, &scene, direct(64)).unwrap();
            assert!(light_at(&source, &mesh, place(0.2, 0.0, 0.1)).value.min_element() > 1.0);
            assert_eq!(light_at(&source, &mesh, place(0.7, 0.0, 0.1)).value, Vec3::ZERO);
        }
    }
}

/// A sphere above a plane covers the share `r^2 h / d^3` of the sky, weighted by the cosine.
#[test]
fn a_sphere_occludes_as_its_form_factor_says() {
    let (radius, height) = (0.25, 0.4);
    let ball = placed(generate::icosphere(6), radius, DVec3::new(0.0, height, 0.0));
    let mesh = cleaned(joined(&[generate::grid(8), ball]));
    let scene = LightScene { lights: Vec::new(), sky: &black, reflector: &gray };
    let options = LightMapOptions {
        quantity: LightQuantity::AmbientOcclusion,
        samples: 8192,
        ..LightMapOptions::default()
    };
    let source = LightMapSource::new(&mesh, &scene, options).unwrap();
    for x in [0.0, 0.1, 0.3, 0.6, 0.9] {
        let expected = 1.0 - radius * radius * height / (x * x + height * height).sqrt().powi(3);
        let light = light_at(&source, &mesh, DVec3::new(x, 0.0, 0.0));
        assert!((f64::from(light.value.x) - expected).abs() < 2e-3, "{x}: {} {expected}", light.value.x);
    }
    // Where only what is near occludes, the ball is far away for all but the point below it.
    let near = LightMapOptions { occlusion_distance: Some(0.2), ..options };
    let source = LightMapSource::new(&mesh, &scene, near).unwrap();
    assert_eq!(light_at(&source, &mesh, DVec3::new(0.6, 0.0, 0.0)).value, Vec3::ONE);
    assert!(light_at(&source, &mesh, DVec3::ZERO).value.x < 0.99);
    // The same through the sky, as light.
    let scene = LightScene { sky: &white, ..scene };
    let source = LightMapSource::new(&mesh, &scene, direct(8192)).unwrap();
    let expected = 1.0 - radius * radius / (height * height);
    assert!((f64::from(light_at(&source, &mesh, DVec3::ZERO).value.y) - expected).abs() < 2e-3);
}

/// A box of height 0.3 whose side is at x = 0.2, under a sun at 45 degrees: the shadow ends at x = 0.5.
fn box_under_the_sun() -> Mesh {
    let block = placed(generate::cube(1), 0.15, DVec3::new(0.05, 0.15 + 1e-4, 0.0));
    cleaned(joined(&[generate::grid(8), block]))
}

#[test]
fn the_shadow_of_a_box_ends_where_it_must() {
    let mesh = box_under_the_sun();
    for radius_degrees in [0.0, 3.0] {
        let lights = vec![BakeLight::Directional {
            to_light: Vec3::new(-1.0, 1.0, 0.0),
            color: Vec3::ONE,
            radius_degrees,
        }];
        let scene = LightScene { lights, sky: &black, reflector: &gray };
        let source = LightMapSource::new(&mesh, &scene, direct(256)).unwrap();
        let light = |x: f64| light_at(&source, &mesh, DVec3::new(x, 0.0, 0.02)).value.x;
        let lit = std::f32::consts::FRAC_1_SQRT_2;
        assert!(light(0.3).abs() < 1e-6 && (light(0.7) - lit).abs() < 1e-3);
        // Bisection for half of the light.
        let (mut dark, mut bright) = (0.3, 0.7);
        while bright - dark > 1e-4 {
            let middle = 0.5 * (dark + bright);
            if light(middle) < 0.5 * lit { dark = middle } else { bright = middle }
        }
        // The top is at 0.3001.
        assert!((dark - 0.5001).abs() < if radius_degrees == 0.0 { 3e-4 } else { 4e-3 }, "{dark}");
        if radius_degrees > 0.0 {
            // The penumbra is as wide as the sun seen from the edge.
            let half_width = 0.3 * 2.0 * f64::from(radius_degrees).to_radians();
            assert!(light(0.5 - 0.9 * half_width) < 0.15 * lit);
            assert!(light(0.5 - 0.5 * half_width) > 0.05 * lit);
            assert!(light(0.5 + 0.9 * half_width) > 0.85 * lit);
        }
    }
}

/// Points of the ground beside and below a ball in a sky that varies.
fn errors_and_estimates(samples: u32) -> (f64, f64) {
    let ball = placed(generate::icosphere(4), 0.3, DVec3::new(0.1, 0.4, 0.0));
    let mesh = cleaned(joined(&[generate::grid(8), ball]));
    let sky = |d: Vec3| Vec3::new(1.0 + d.x, 2.0 * d.y, if d.z > 0.3 { 4.0 } else { 0.1 });
    let scene = LightScene { lights: Vec::new(), sky: &sky, reflector: &gray };
    let options = |samples| LightMapOptions { samples, bounces: 2, ..LightMapOptions::default() };
    let truth = LightMapSource::new(&mesh, &scene, options(1 << 14)).unwrap();
    let source = LightMapSource::new(&mesh, &scene, options(samples)).unwrap();
    let (mut squares, mut estimates, mut n) = (0.0, 0.0, 0.0);
    for triangle in 0..128 {
        let lambda = Vec3::new(0.3, 0.3, 0.4);
        let exact = truth.illumination(point(triangle, lambda), [Vec3::ZERO; 2]).value;
        for k in 0..8 {
            // Next to each other in value, but of independent noise.
            let beside = point(triangle, lambda + Vec3::new(1e-6, -1e-6, 0.0) * k as f32);
            let light = source.illumination(beside, [Vec3::ZERO; 2]);
            squares += f64::from((light.value - exact).length_squared() / 3.0);
            estimates += f64::from(light.standard_error).powi(2);
            n += 1.0;
        }
    }
    ((squares / n).sqrt(), (estimates / n).sqrt())
}

#[test]
fn the_noise_that_is_reported_is_the_error_that_is_made() {
    for samples in [16, 64, 256] {
        let (error, estimate) = errors_and_estimates(samples);
        eprintln!("{samples} paths: error {error:.5}, reported {estimate:.5}");
        assert!((0.75..1.33).contains(&(estimate / error)), "{samples}: {error} {estimate}");
    }
    let (few, many) = (errors_and_estimates(16).0, errors_and_estimates(256).0);
    // Independent samples would give 4.
    assert!(few / many > 4.5, "{few} {many}");
}

#[test]
fn adaptive_sampling_reaches_the_error_that_is_asked_for() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder, "meshes/suzanne.ply");
    let scene = LightScene { lights: Vec::new(), sky: &|d: Vec3| Vec3::splat(1.0 + d.y), reflector: &gray };
    let cover = cover(&mesh, 64, 3_000);
    let mut reports = Vec::new();
    for target in [0.02, 0.005] {
        let options = LightMapOptions {
            samples: 16,
            max_samples: 1 << 14,
            target_error: Some(target),
            ..Default::default()
        };
        let source = LightMapSource::new(&mesh, &scene, options).unwrap();
        baked(&mesh, &cover, &source, &float_options(Fit::Point));
        let noise = source.noise();
        eprintln!("{noise:?}");
        assert!(noise.mean_error <= f64::from(target) && noise.error_95 <= 1.2 * f64::from(target));
        assert!(noise.mean_error > 0.2 * f64::from(target), "wasteful: {noise:?}");
        reports.push(noise);
    }
    assert!(reports[1].mean_samples > 3.0 * reports[0].mean_samples);
}

#[test]
fn light_is_baked_into_its_own_channel_on_any_number_of_threads() {
    let Some(folder) = data_folder() else { return };
    let mesh = loaded(&folder, "meshes/spot/spot_triangulated.obj");
    let sun = BakeLight::Directional {
        to_light: Vec3::new(1.0, 2.0, 1.0),
        color: Vec3::splat(2.0),
        radius_degrees: 2.0,
    };
    let scene = LightScene {
        lights: vec![sun],
        sky: &|d: Vec3| Vec3::new(0.2, 0.3, 0.5 + 0.3 * d.y),
        reflector: &gray,
    };
    let cover = cover(&mesh, 64, 20_000);
    let bake_on = |threads: usize| {
        let options = LightMapOptions { samples: 16, bounces: 2, ..LightMapOptions::default() };
        let source = LightMapSource::new(&mesh, &scene, options).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let asset = pool.install(|| baked(&mesh, &cover, &source, &float_options(Fit::Point)));
        (std::fs::read(&asset.path).unwrap(), source.noise(), asset)
    };
    let (bytes, noise, asset) = bake_on(1);
    let (same_bytes, same_noise, _) = bake_on(3);
    assert!(bytes == same_bytes && noise == same_noise);
    assert!(noise.texels >= 15_000 && noise.mean_samples == 16.0 && noise.mean_error < 0.1, "{noise:?}");
    let channels = asset.cache.asset().channels();
    assert_eq!((channels[0].kind, channels[0].srgb), (ChannelKind::Light, false));
    assert!(verify(&asset.path, &VerifyOptions::default()).unwrap().ok);
    // What is read back is the light, as far as texels of this size hold it.
    let options = LightMapOptions { samples: 256, bounces: 2, ..LightMapOptions::default() };
    let source = LightMapSource::new(&mesh, &scene, options).unwrap();
    let (mut squares, mut brightest, mut n) = (0.0, 0.0_f32, 0.0);
    for triangle in (0..mesh.triangles.len()).step_by(23) {
        let lambda = Vec3::new(0.25, 0.35, 0.4);
        let read = sample(&asset.cache, 0, 0, triangle, lambda).truncate();
        let light = source.illumination(point(triangle, lambda), [Vec3::ZERO; 2]).value;
        squares += (read - light).length_squared() / 3.0;
        brightest = brightest.max(read.max_element());
        n += 1.0;
    }
    let rms = (squares / n).sqrt();
    assert!(rms < 0.15 && brightest > 1.5, "{rms} {brightest}");
}

/// A coarse ball has dark triangles at the terminator unless rays start from the smooth surface.
#[test]
fn coarse_balls_do_not_shade_themselves_by_triangles() {
    let mesh = cleaned(generate::icosphere(2));
    let to_light = Vec3::new(0.3, 1.0, 0.2).normalize();
    let lights = vec![BakeLight::Directional { to_light, color: Vec3::ONE, radius_degrees: 0.0 }];
    let scene = LightScene { lights, sky: &black, reflector: &gray };
    let error = |smooth_terminator: bool| {
        let options = LightMapOptions { smooth_terminator, ..direct(4) };
        let source = LightMapSource::new(&mesh, &scene, options).unwrap();
        let mut largest = 0.0_f32;
        for triangle in 0..mesh.triangles.len() {
            for lambda in [Vec3::splat(1.0 / 3.0), Vec3::new(0.7, 0.2, 0.1), Vec3::new(0.1, 0.1, 0.8)] {
                let [a, b, c] = mesh.triangle_positions(triangle);
                let normal = (interpolate([a, b, c], lambda)).normalize();
                let light = source.illumination(point(triangle, lambda), [Vec3::ZERO; 2]).value.x;
                largest = largest.max((light - normal.dot(to_light).max(0.0)).abs());
            }
        }
        largest
    };
    let (faceted, smooth) = (error(false), error(true));
    assert!(faceted > 0.05 && smooth < 0.01, "{faceted} {smooth}");
}

#[test]
fn colours_bleed_and_cut_outs_let_light_through() {
    let mesh = cleaned(joined(&[
        inside_out(generate::cube(2)),
        placed(generate::cube(1), 0.2, DVec3::new(0.0, -0.5, 0.0)),
    ]));
    // The wall at x = -1 is red, the one at x = 1 green, all others white; a lamp hangs in the middle.
    let albedo = |at: SurfacePoint| {
        let x = mesh.triangle_positions(at.index()).iter().map(|p| p.x).sum::<f32>() / 3.0;
        let full = mesh.positions.iter().fold(0.0_f32, |m, p| m.max(p.x));
        if x < -0.99 * full {
            Vec3::new(0.8, 0.05, 0.05)
        } else if x > 0.99 * full {
            Vec3::new(0.05, 0.8, 0.05)
        } else {
            Vec3::splat(0.8)
        }
    };
    let lights =
        vec![BakeLight::Point { position: DVec3::new(0.0, 0.5, 0.0), color: Vec3::ONE, radius: 0.1 }];
    let scene = LightScene { lights: lights.clone(), sky: &black, reflector: &albedo };
    let source = LightMapSource::new(&mesh, &scene, LightMapOptions::default()).unwrap();
    let left = light_at(&source, &mesh, DVec3::new(-0.9, -1.0, 0.3)).value;
    let right = light_at(&source, &mesh, DVec3::new(0.9, -1.0, 0.3)).value;
    assert!(left.x > 1.1 * left.y && right.y > 1.1 * right.x, "{left} {right}");
    assert!((left.x - right.y).abs() < 0.05 && left.z > 0.0);
    // Below the block it is dark, unless the block is cut out.
    struct Hollow(usize);
    impl Reflector for Hollow {
        fn albedo(&self, _: SurfacePoint) -> Vec3 {
            Vec3::ZERO
        }
        fn is_solid(&self, at: SurfacePoint) -> bool {
            at.index() < self.0
        }
    }
    for (solid, lit) in [(usize::MAX, false), (48, true)] {
        let hollow = Hollow(solid);
        let scene = LightScene { lights: lights.clone(), sky: &black, reflector: &hollow };
        let source = LightMapSource::new(&mesh, &scene, direct(64)).unwrap();
        assert_eq!(light_at(&source, &mesh, DVec3::new(0.01, -1.0, 0.02)).value.x > 0.1, lit);
    }
}

/// What a source would bake is what reflects: a red ceiling over a white floor, with a hole where alpha is zero.
#[test]
fn sources_reflect_what_they_would_bake() {
    let ceiling = inside_out(placed(generate::grid(8), 1.0, DVec3::Y));
    let mesh = cleaned(joined(&[generate::grid(8), ceiling]));
    let height = mesh.positions.iter().fold(0.0_f32, |m, p| m.max(p.y));
    let color = move |p: Vec3| {
        if p.y < 0.0 {
            glam::Vec4::ONE
        } else {
            glam::Vec4::new(0.8, 0.0, 0.0, f32::from(p.x < 0.5 * height))
        }
    };
    struct WithAlpha<F>(common::OfPosition<F>);
    impl<F: Fn(Vec3) -> glam::Vec4 + Sync> fantex_bake::Source for WithAlpha<F> {
        fn channels(&self) -> Vec<fantex_bake::SourceChannel> {
            let opaque = self.0.channels();
            opaque.into_iter().map(|c| fantex_bake::SourceChannel { has_alpha: true, ..c }).collect()
        }
        fn prefilter(&self) -> fantex_bake::Prefilter {
            self.0.prefilter()
        }
        fn evaluate(&self, point: &fantex_bake::TexelPoint, values: &mut [glam::Vec4]) {
            self.0.evaluate(point, values);
        }
    }
    let paint = WithAlpha(common::OfPosition(color));
    let reflector = SourceReflector::new(&mesh, &paint);
    let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &reflector };
    let source =
        LightMapSource::new(&mesh, &scene, LightMapOptions { bounces: 1, ..Default::default() }).unwrap();
    let under = light_at(&source, &mesh, DVec3::new(-0.5, 0.0, 0.0)).value;
    let under_the_hole = light_at(&source, &mesh, DVec3::new(0.9, 0.0, 0.0)).value;
    assert!(under.x > 1.1 * under.y && (under.y - under.z).abs() < 1e-5, "{under}");
    assert!(under_the_hole.y > 1.2 * under.y, "{under} {under_the_hole}");
}

#[test]
fn lights_out_of_range_are_refused_by_name() {
    let mesh = cleaned(generate::icosphere(1));
    let sun = |to_light, color, radius_degrees| BakeLight::Directional { to_light, color, radius_degrees };
    let spot = |inner_degrees, outer_degrees| BakeLight::Spot {
        position: DVec3::ONE,
        axis: Vec3::X,
        color: Vec3::ONE,
        radius: 0.0,
        inner_degrees,
        outer_degrees,
    };
    let point = |position, radius| BakeLight::Point { position, color: Vec3::ONE, radius };
    let bad = [
        (sun(Vec3::ZERO, Vec3::ONE, 0.0), "to_light"),
        (sun(Vec3::X, Vec3::NAN, 0.0), "color"),
        (sun(Vec3::X, Vec3::NEG_ONE, 0.0), "color"),
        (sun(Vec3::X, Vec3::ONE, 91.0), "radius_degrees"),
        (point(DVec3::NAN, 0.0), "position"),
        (point(DVec3::ZERO, -1.0), "radius"),
        (point(DVec3::ZERO, f64::INFINITY), "radius"),
        (spot(30.0, 20.0), "inner_degrees"),
        (spot(20.0, 181.0), "outer_degrees"),
    ];
    for (light, what) in bad {
        let lights = vec![sun(Vec3::X, Vec3::ONE, 0.0), light];
        let scene = LightScene { lights, sky: &black, reflector: &gray };
        let error = LightMapSource::new(&mesh, &scene, LightMapOptions::default()).unwrap_err();
        assert!(error.to_string().starts_with(&format!("{what} of light 1 is ")), "{error}");
    }
}

mod many_lamps {
    use fantex_bake::{BakeLight, Illumination, LightMapOptions, LightMapSource, LightScene};
    use fantex_mesh::SurfacePoint;
    use fantex_test::ball_on_a_plane;
    use glam::{DVec3, Vec3};

    fn gray(_: SurfacePoint) -> Vec3 {
        Vec3::splat(0.5)
    }

    fn in_triangle(triangle: usize) -> SurfacePoint {
        SurfacePoint { triangle: triangle as u32, lambda: Vec3::new(0.3, 0.3, 0.4) }
    }

    /// Many lamps, most of them far away or behind walls, give what each of them gives alone.
    #[test]
    fn chosen_lamps_give_the_light_of_all() {
        let mesh = ball_on_a_plane();
        let black = |_: Vec3| Vec3::ZERO;
        let lamps: Vec<BakeLight> = (0..40)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * 2.4).sin_cos();
                let position = DVec3::new(cos, 0.2 + 0.02 * f64::from(i), sin) * (0.4 + 0.03 * f64::from(i));
                let color = Vec3::new(0.02, 0.03, 0.001 * i as f32);
                BakeLight::Point { position, color, radius: 0.02 * f64::from(i % 3) }
            })
            .collect();
        let light_of = |lights: Vec<BakeLight>, samples: u32, triangle: usize| {
            let scene = LightScene { lights, sky: &black, reflector: &gray };
            let options = LightMapOptions { samples, bounces: 1, ..LightMapOptions::default() };
            LightMapSource::new(&mesh, &scene, options)
                .unwrap()
                .illumination(in_triangle(triangle), [Vec3::ZERO; 2])
        };
        for triangle in [3, 40, 100, 1000, 4000] {
            let together = light_of(lamps.clone(), 4096, triangle);
            let apart: Vec<Illumination> =
                lamps.chunks(4).map(|few| light_of(few.to_vec(), 1024, triangle)).collect();
            let sum: Vec3 = apart.iter().map(|light| light.value).sum();
            let noise = apart.iter().map(|light| light.standard_error.powi(2)).sum::<f32>().sqrt();
            let noise = noise.hypot(together.standard_error);
            let error = (together.value - sum).abs().max_element();
            assert!(error < 6.0 * noise + 1e-4, "{triangle}: {} {sum}, noise {noise}", together.value);
        }
    }
}

/// No texel mixes both sides of a crease: from above, a cube's top is lit to its rim, and its sides are black up to it.
#[test]
fn light_does_not_leak_over_creases() {
    let mesh = cleaned(generate::cube(5));
    let sun = BakeLight::Directional { to_light: Vec3::Y, color: Vec3::ONE, radius_degrees: 0.0 };
    let scene = LightScene { lights: vec![sun], sky: &black, reflector: &gray };
    let source = LightMapSource::new(&mesh, &scene, direct(16)).unwrap();
    let budget = fantex_cover::TexelBudget::Total(20_000);
    for tile in [0, 256] {
        let options = fantex_cover::CoverOptions {
            budget: budget.clone(),
            tile,
            cut_creases: true,
            ..fantex_cover::CoverOptions::default()
        };
        let (cover, _) = fantex_cover::build_cover(&mesh, &options).unwrap();
        let asset = baked(&mesh, &cover, &source, &float_options(Fit::Box));
        let report = verify(&asset.path, &VerifyOptions::default()).unwrap();
        assert!(report.ok, "{report:?}");
        // Twelve edges of five segments each.
        assert_eq!(report.continuity.exempt.crease, 60);
        let points = common::barycentric_points(9);
        for triangle in 0..mesh.triangles.len() {
            let expected = if mesh.facet_normal(triangle).y > 0.5 { 1.0 } else { 0.0 };
            for &lambda in &points {
                for level in 0..2 {
                    let light = sample(&asset.cache, 0, level, triangle, lambda).truncate();
                    let error = (light - Vec3::splat(expected)).abs().max_element();
                    assert!(error < 1e-4, "tile {tile}, triangle {triangle}, {lambda}: {light}");
                }
            }
        }
    }
}

/// Nor does light come in where faces meet: inside a closed box, and inside a wedge of 20 degrees, it is as dark at the edges as elsewhere,
/// however bright it is outside.
#[test]
fn closed_rooms_are_dark_up_to_their_edges() {
    let wedge = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let tips =
            [-1.0, 1.0].map(|z| [DVec3::new(0.0, 0.0, z), DVec3::new(1.0, 0.0, z), DVec3::new(cos, sin, z)]);
        let triangles =
            vec![[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]];
        Model { positions: tips.concat(), triangles, ..Model::default() }
    };
    let dark = |_: SurfacePoint| Vec3::ZERO;
    let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &dark };
    for room in [generate::cube(2), wedge(20.0)] {
        for is_room in [true, false] {
            let mesh = cleaned(if is_room { inside_out(room.clone()) } else { room.clone() });
            let source = LightMapSource::new(&mesh, &scene, direct(64)).unwrap();
            for triangle in 0..mesh.triangles.len() {
                // Corners, and points of and beyond the sides.
                for lambda in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.5, 0.5, 0.0), Vec3::new(0.4, -0.1, 0.7)]
                {
                    let light = source.illumination(point(triangle, lambda), [Vec3::ZERO; 2]).value;
                    assert!(
                        light == if is_room { Vec3::ZERO } else { Vec3::ONE },
                        "{triangle} {lambda}: {light}"
                    );
                }
            }
        }
    }
}

/// The middle of the box, and half its side: it stands a little in the floor, turned against its texels.
const BLOCK: (DVec3, f64) = (DVec3::new(0.02, 0.29, 0.05), 0.3);

/// A floor with a box on it, and from the box' space to the world.
fn block_on_a_floor() -> (Mesh, impl Fn(DVec3) -> DVec3) {
    let (center, half) = BLOCK;
    let to_world = move |p: DVec3| DMat3::from_rotation_y(0.3) * p * half + center;
    let mut block = generate::cube(1);
    block.positions.iter_mut().for_each(|p| *p = to_world(*p));
    (cleaned(joined(&[generate::grid(6), block])), to_world)
}

/// Floor texels that lie half under a box have the light of the half that is seen, at coarser levels, too.
#[test]
fn floors_are_not_dark_at_the_foot_of_a_box() {
    let (mesh, to_world) = block_on_a_floor();
    let (center, half) = BLOCK;
    let bvh = TriangleBvh::new(&mesh);
    let on_floor = |place: DVec3| {
        let place = mesh.world_from_mesh.inverse_point(place.with_y(0.0));
        bvh.nearest_point(place, 1e-3).unwrap().point
    };
    let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &gray };
    let quantity = LightQuantity::AmbientOcclusion;
    let options = LightMapOptions { quantity, samples: 1024, ..LightMapOptions::default() };
    let exact = LightMapOptions { samples: 4096, ..options };
    let exact = LightMapSource::new(&mesh, &scene, exact).unwrap();
    let sides = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z];
    let mut places = Vec::new();
    for side in sides {
        let along = DVec3::new(side.z, 0.0, side.x);
        for i in -6..=6 {
            places.extend([0.01, 0.025].map(|distance| {
                on_floor(to_world(side * (1.0 + distance / half) + along * (0.15 * f64::from(i))))
            }));
        }
    }
    for denoise in [false, true] {
        let source = LightMapSource::new(&mesh, &scene, LightMapOptions { denoise, ..options }).unwrap();
        let asset = baked(&mesh, &cover(&mesh, 64, 3000), &source, &float_options(Fit::Box));
        let report = verify(&asset.path, &VerifyOptions { texels: true, ..VerifyOptions::default() });
        let report = report.unwrap();
        assert!(report.ok, "what lies under the box is at all levels: {report:?}");
        for &place in &places {
            let expected = exact.illumination(place, [Vec3::ZERO; 2]).value.x;
            assert!(expected > 0.45, "{place:?}: {expected}");
            for level in 0..3 {
                let light = sample(&asset.cache, 0, level, place.index(), place.lambda).x;
                assert!(light > expected - 0.12, "{place:?}, level {level}: {light}, not {expected}");
            }
        }
    }
    // A lamp in the box lights the floor there.
    let lamp = BakeLight::Point { position: center.with_y(half), color: Vec3::splat(0.09), radius: 0.0 };
    let scene = LightScene { lights: vec![lamp], sky: &black, reflector: &gray };
    let source = LightMapSource::new(&mesh, &scene, direct(64)).unwrap();
    let asset = baked(&mesh, &cover(&mesh, 64, 3000), &source, &float_options(Fit::Box));
    let below = on_floor(center);
    let light = sample(&asset.cache, 0, 0, below.index(), below.lambda).x;
    assert!((light - 1.0).abs() < 0.1, "{light}");
}

/// Root mean square difference of two bakes over the surface.
fn difference(a: &common::Baked, b: &common::Baked, mesh: &Mesh) -> f64 {
    let (mut squares, mut sum) = (0.0, 0.0);
    for triangle in 0..mesh.triangles.len() {
        let [p, q, r] = mesh.triangle_positions(triangle);
        let area = f64::from((q - p).cross(r - p).length());
        for lambda in common::barycentric_points(4) {
            let [a, b] = [a, b].map(|asset| sample(&asset.cache, 0, 0, triangle, lambda).truncate());
            squares += area * f64::from((a - b).length_squared() / 3.0);
            sum += area;
        }
    }
    (squares / sum).sqrt()
}

/// Under a sky with a soft sun, denoised bakes are nearer to one of many paths, and tell what is left.
#[test]
fn bakes_take_the_noise_out() {
    let mesh = fantex_test::ball_on_a_plane();
    let to_light = Vec3::new(-1.0, 1.6, 0.3);
    let sun = BakeLight::Directional { to_light, color: Vec3::ONE, radius_degrees: 8.0 };
    let sky = |d: Vec3| Vec3::new(0.2, 0.3, 0.5 + 0.3 * d.y);
    let scene = LightScene { lights: vec![sun], sky: &sky, reflector: &gray };
    let options = fantex_cover::CoverOptions {
        budget: fantex_cover::TexelBudget::Total(6_000),
        cut_creases: true,
        ..fantex_cover::CoverOptions::default()
    };
    let (cover, _) = fantex_cover::build_cover(&mesh, &options).unwrap();
    let bake_with = |samples: u32, denoise: bool, seed: u32| {
        let options = LightMapOptions { samples, bounces: 2, denoise, seed, ..LightMapOptions::default() };
        let source = LightMapSource::new(&mesh, &scene, options).unwrap();
        let asset = baked(&mesh, &cover, &source, &float_options(Fit::Point));
        (asset, source.noise())
    };
    let (truth, _) = bake_with(256, false, 9);
    let [(noisy, before), (smooth, after)] = [false, true].map(|denoise| bake_with(16, denoise, 1));
    let [noisy, smooth] = [noisy, smooth].map(|asset| difference(&asset, &truth, &mesh));
    eprintln!(
        "errors {noisy:.5} {smooth:.5}, reported {:.5} {:.5}",
        before.mean_error, after.mean_error_left
    );
    assert!(smooth < 0.67 * noisy, "{smooth} {noisy}");
    assert_eq!(before.mean_error_left, before.mean_error);
    assert_eq!((after.mean_error, after.texels), (before.mean_error, before.texels));
    assert!(after.mean_error_left < 0.33 * before.mean_error, "{after:?}");
}

/// Denoised light of tiles that are baked in blocks: in the sun, all texels of a level strip have the cosine.
#[test]
fn long_tiles_are_denoised() {
    let mut strip = generate::grid(1);
    strip.positions.iter_mut().for_each(|p| p.x *= 200.0);
    let mesh = cleaned(strip);
    let options = fantex_cover::CoverOptions {
        budget: fantex_cover::TexelBudget::Total(9_000),
        ..fantex_cover::CoverOptions::default()
    };
    let (cover, _) = fantex_cover::build_cover(&mesh, &options).unwrap();
    let longest = cover.groups.iter().flat_map(|group| group.extent).max();
    assert!(longest > Some(fantex_cover::MAX_BLOCK_SIDE), "{longest:?}");
    let to_light = Vec3::new(0.8, 0.6, 0.0);
    let sun = BakeLight::Directional { to_light, color: Vec3::ONE, radius_degrees: 0.0 };
    let scene = LightScene { lights: vec![sun], sky: &black, reflector: &gray };
    let source = LightMapSource::new(&mesh, &scene, direct(4)).unwrap();
    let asset = baked(&mesh, &cover, &source, &float_options(Fit::Point));
    for (triangle, level) in (0..mesh.triangles.len()).flat_map(|t| (0..4).map(move |level| (t, level))) {
        for lambda in common::barycentric_points(8) {
            let light = sample(&asset.cache, 0, level, triangle, lambda).truncate();
            assert!((light - 0.6).abs().max_element() < 1e-4, "level {level}, {lambda}: {light}");
        }
    }
}

// A bake that is no longer wanted.

/// Wants to stop from the `n`-th question on.
struct StopAt {
    n: u32,
    asked: AtomicU32,
}

impl StopAt {
    fn new(n: u32) -> Self {
        Self { n, asked: AtomicU32::new(0) }
    }
}

impl Progress for StopAt {
    fn report(&self, _: u64, _: u64) {}

    fn is_cancelled(&self) -> bool {
        self.asked.fetch_add(1, Ordering::Relaxed) + 1 >= self.n
    }
}

/// Within a tile, within its light and within a texel of many paths.
#[test]
fn bakes_end_where_they_are_cancelled() {
    let mesh = cleaned(generate::grid(1));
    let cover = cover(&mesh, 1024, 16 * 16);
    assert_eq!(cover.groups.len(), 1);
    let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &gray };
    let light = |denoise| {
        let options = LightMapOptions { denoise, ..direct(1024) };
        LightMapSource::new(&mesh, &scene, options).unwrap()
    };
    let (smooth, noisy) = (light(true), light(false));
    let plain = OfPosition(|p: Vec3| p.extend(1.0));
    let sources: [(&dyn Source, u32); 3] = [(&smooth, 3000), (&noisy, 3000), (&plain, 3)];
    for (number, (source, least)) in sources.into_iter().enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        let bake = |stop: &StopAt| bake(&mesh, &cover, source, &path, &BakeOptions::default(), stop);
        let never = StopAt::new(u32::MAX);
        bake(&never).unwrap();
        std::fs::remove_file(&path).unwrap();
        let all = never.asked.into_inner();
        assert!(all > least, "source {number}: {all} questions");
        for n in [1, 2, all / 3, all / 2, all - all / 40, all - 1] {
            let stop = StopAt::new(n);
            let error = bake(&stop).unwrap_err();
            assert!(error.is_cancelled(), "{error}");
            assert_eq!(stop.asked.into_inner(), n, "source {number} of {all} questions");
            assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none());
        }
    }
}
