//! Light that is sought where it is bright, against directions by the cosine alone.

use std::time::Instant;

use fantex_mesh::{CleanOptions, Mesh, Model, clean, generate};
use glam::{DVec3, Vec3};

use super::*;

fn gray(_: usize, _: Vec3) -> Vec3 {
    Vec3::splat(0.5)
}

/// A ball above a plane.
fn ball_on_a_plane() -> Mesh {
    let mut ball = generate::icosphere(4);
    ball.positions.iter_mut().for_each(|p| *p = *p * 0.3 + DVec3::new(0.1, 0.4, 0.0));
    let mut model: Model = generate::grid(8);
    let first = model.positions.len() as u32;
    model.positions.extend(&ball.positions);
    model.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + first)));
    clean(model, &CleanOptions::default()).unwrap().0
}

/// A blue sky with a sun that gives `share` of all light.
fn sky_with_sun(radius_degrees: f32, share: f32) -> impl Fn(Vec3) -> Vec3 + Sync {
    let to_sun = Vec3::new(-0.5, 0.7, 0.3).normalize();
    let cos_radius = radius_degrees.to_radians().cos();
    let brightness = share / (1.0 - share) / (0.5 * (1.0 - cos_radius));
    move |d: Vec3| {
        let sky = Vec3::new(0.3, 0.4, 0.6) * (1.0 + 0.5 * d.y);
        sky + if d.dot(to_sun) > cos_radius { Vec3::splat(brightness * 0.4) } else { Vec3::ZERO }
    }
}

/// Sources with and without a table of the sky.
fn both<'a>(mesh: &'a Mesh, sky: &'a dyn Sky, options: LightMapOptions) -> [LightMapSource<'a>; 2] {
    let scene = LightScene { lights: Vec::new(), sky, reflector: &gray };
    let chosen = LightMapSource::new(mesh, &scene, options).unwrap();
    let mut by_cosine = LightMapSource::new(mesh, &scene, options).unwrap();
    by_cosine.tracer.sky_table = None;
    [chosen, by_cosine]
}

const LAMBDA: Vec3 = Vec3::new(0.3, 0.3, 0.4);

#[test]
fn the_mean_is_that_of_directions_by_the_cosine() {
    let mesh = ball_on_a_plane();
    // A sun that the cosine finds often enough to compare with.
    let sky = sky_with_sun(12.0, 0.5);
    for bounces in [0, 2] {
        let options = LightMapOptions { bounces, samples: 4096, ..LightMapOptions::default() };
        let [chosen, by_cosine] = both(&mesh, &sky, options);
        assert!(chosen.tracer.sky_table.is_some());
        let (mut differences, mut variances, mut n) = (DVec3::ZERO, [0.0; 2], 0.0);
        for triangle in (0..mesh.triangles.len()).step_by(97) {
            let a = chosen.illumination(triangle, LAMBDA, [Vec3::ZERO; 2]);
            let b = by_cosine.illumination(triangle, LAMBDA, [Vec3::ZERO; 2]);
            differences += (a.value - b.value).as_dvec3();
            for (sum, light) in variances.iter_mut().zip([a, b]) {
                *sum += f64::from(light.standard_error).powi(2);
            }
            n += 1.0;
        }
        let noise = (variances[0] + variances[1]).sqrt() / n;
        let bias = differences / n;
        eprintln!("{bounces} reflections: difference {bias}, noise {noise}");
        assert!(bias.abs().max_element() < 5.0 * noise + 1e-4, "{bias}, noise {noise}");
        assert!(variances[0] < 0.3 * variances[1], "{variances:?}");
    }
}

/// On a plane the light of a sky with a sun is known.
#[test]
fn the_light_of_a_small_sun_is_exact() {
    let mesh = clean(generate::grid(4), &CleanOptions::default()).unwrap().0;
    let to_sun = Vec3::new(0.6, 0.8, 0.0);
    for radius_degrees in [0.27_f32, 2.0, 20.0] {
        let (sin_radius, cos_radius) = radius_degrees.to_radians().sin_cos();
        let radiance = 2.0 / (sin_radius * sin_radius);
        let sky = |d: Vec3| Vec3::new(if d.dot(to_sun) > cos_radius { radiance } else { 0.0 }, 0.5, 0.0);
        let options =
            LightMapOptions { quantity: LightQuantity::Direct, samples: 4096, ..LightMapOptions::default() };
        let [chosen, _] = both(&mesh, &sky, options);
        assert!(chosen.tracer.sky_table.is_some());
        let light = chosen.illumination(7, LAMBDA, [Vec3::ZERO; 2]);
        // The integral of the cosine over a cap above the horizon is pi sin² times the cosine of its axis.
        let expected = 2.0 * to_sun.y;
        let error = (light.value - Vec3::new(expected, 0.5, 0.0)).abs();
        assert!(error.x < 0.02 * expected && error.y < 0.01, "{radius_degrees}: {} {expected}", light.value);
    }
}

/// In the open, under a sky that is one everywhere but for a table that someone made, light is one.
#[test]
fn a_furnace_stays_a_furnace_whatever_the_table() {
    let mesh = ball_on_a_plane();
    let white = |_: Vec3| Vec3::ONE;
    let reflector = |_: usize, _: Vec3| Vec3::ONE;
    let scene = LightScene { lights: Vec::new(), sky: &white, reflector: &reflector };
    let options = LightMapOptions { bounces: 40, samples: 1024, ..LightMapOptions::default() };
    let mut source = LightMapSource::new(&mesh, &scene, options).unwrap();
    assert!(source.tracer.sky_table.is_none());
    source.tracer.sky_table = SkyTable::new(&sky_with_sun(5.0, 0.5));
    let (mut sum, mut n) = (0.0, 0.0);
    // The ball, whose paths all end in the sky after a few reflections.
    for triangle in (128..mesh.triangles.len()).step_by(197) {
        let light = source.illumination(triangle, LAMBDA, [Vec3::ZERO; 2]);
        sum += f64::from(light.value.x);
        n += 1.0;
        assert!((light.value.x - 1.0).abs() < 6.0 * light.standard_error + 0.02, "{triangle}: {light:?}");
    }
    assert!((sum / n - 1.0).abs() < 0.01, "{}", sum / n);
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
        LightMapSource::new(&mesh, &scene, options).unwrap().illumination(triangle, LAMBDA, [Vec3::ZERO; 2])
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

/// `cargo test --release -p fantex-bake --lib light -- --ignored --nocapture`
#[test]
#[ignore = "measures, asserts nothing"]
fn noise_at_equal_time() {
    let mesh = ball_on_a_plane();
    let triangles: Vec<usize> = (0..mesh.triangles.len()).step_by(37).collect();
    for (name, radius_degrees, share) in [
        ("sun", 0.27, 0.5),
        ("hazy sun", 2.0, 0.5),
        ("bright clouds", 15.0, 0.5),
        ("hill of light", 40.0, 0.5),
    ] {
        let sky = sky_with_sun(radius_degrees, share);
        let options = |samples| LightMapOptions { bounces: 2, samples, ..LightMapOptions::default() };
        let truth = both(&mesh, &sky, options(1 << 14));
        let truth: Vec<Vec3> =
            triangles.iter().map(|&t| truth[0].illumination(t, LAMBDA, [Vec3::ZERO; 2]).value).collect();
        let sources = both(&mesh, &sky, options(256));
        let mut costs = [f64::INFINITY; 2];
        let mut errors = [0.0; 2];
        for round in 0..5 {
            for (source, (cost, error)) in sources.iter().zip(costs.iter_mut().zip(&mut errors)) {
                let start = Instant::now();
                let mut squares = 0.0;
                for (&triangle, truth) in triangles.iter().zip(&truth) {
                    let beside = LAMBDA + Vec3::new(1e-6, -1e-6, 0.0) * round as f32;
                    let light = source.illumination(triangle, beside, [Vec3::ZERO; 2]);
                    squares += f64::from((light.value - truth).length_squared()) / 3.0;
                }
                *cost = cost.min(start.elapsed().as_secs_f64());
                *error += squares / triangles.len() as f64 / 5.0;
            }
        }
        // The variance falls with the number of paths, so this is the time that the same noise takes.
        let efficiency = (costs[1] * errors[1]) / (costs[0] * errors[0]);
        println!(
            "{name}: error {:.4} in {:.3} s, by the cosine {:.4} in {:.3} s: {efficiency:.1} times less time",
            errors[0].sqrt(),
            costs[0],
            errors[1].sqrt(),
            costs[1]
        );
    }
}
