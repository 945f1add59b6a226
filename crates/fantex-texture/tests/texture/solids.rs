//! Properties of the solids.

use fantex_base::Aabb;
use fantex_texture::{Rings, SOLID_NAMES, Solid, SolidPoint, solid_by_name};
use glam::Vec3;

use crate::common::Random;

const BOUNDS: Aabb = Aabb { min: Vec3::new(-3.0, -2.0, -3.0), max: Vec3::new(3.0, 2.0, 3.0) };

fn random_point(random: &mut Random) -> Vec3 {
    Vec3::new(random.unit() - 0.5, random.unit() - 0.5, random.unit() - 0.5) * 6.0
}

#[test]
fn colors_are_plausible_everywhere() {
    let mut random = Random::new(1);
    for name in SOLID_NAMES {
        let solid = solid_by_name(name, BOUNDS, 1).unwrap();
        for i in 0..3000 {
            let p = random_point(&mut random) * if i % 10 == 0 { 1000.0 } else { 1.0 };
            let n = random_point(&mut random).normalize_or(Vec3::Y);
            let [r, g, b, a] = solid.color(&SolidPoint { p, n, footprint: random.unit().powi(3), time: 0.0 });
            for value in [r, g, b] {
                assert!((0.0..=1.3).contains(&value), "{name} at {p}: {r} {g} {b}");
            }
            assert_eq!(a, 1.0);
        }
    }
    assert!(solid_by_name("cheese", BOUNDS, 1).is_err());
}

/// Scattered points and texels in a row, of any number and with footprints of any width.
#[test]
fn many_points_have_the_colors_of_single_ones() {
    let mut random = Random::new(4);
    for name in SOLID_NAMES {
        let solid = solid_by_name(name, BOUNDS, 1).unwrap();
        for count in [1, 2, 3, 17, 64, 65, 300] {
            let (start, step) = (random_point(&mut random), 0.002 * random_point(&mut random));
            let points: Vec<SolidPoint> = (0..count)
                .map(|i| SolidPoint {
                    p: if count % 2 == 0 { start + step * i as f32 } else { random_point(&mut random) },
                    n: random_point(&mut random).normalize_or(Vec3::Y),
                    footprint: if count > 100 { random.unit().powi(4) } else { step.length() },
                    time: random.unit(),
                })
                .collect();
            let mut colors = vec![[f32::NAN; 4]; count];
            solid.colors(&points, &mut colors);
            for (at, color) in points.iter().zip(&colors) {
                assert_eq!(*color, solid.color(at), "{name}, {count} points, {at:?}");
            }
        }
    }
}

/// A wide footprint must give about the mean of the fine texture inside it, and vary little.
#[test]
fn footprints_fade_details_to_their_mean() {
    let mut random = Random::new(2);
    for name in SOLID_NAMES {
        let solid = solid_by_name(name, BOUNDS, 1).unwrap();
        let mut error = 0.0;
        for _ in 0..30 {
            let (p, n) = (random_point(&mut random), Vec3::Y);
            let footprint = 0.5;
            let mut mean = Vec3::ZERO;
            for _ in 0..600 {
                let offset = random_point(&mut random) / 6.0 * footprint;
                let fine = solid.color(&SolidPoint { p: p + offset, n, footprint: 0.0, time: 0.0 });
                mean += Vec3::from_slice(&fine[..3]) / 600.0;
            }
            let wide = solid.color(&SolidPoint { p, n, footprint, time: 0.0 });
            error += (Vec3::from_slice(&wide[..3]) - mean).abs().max_element() / 30.0;
        }
        assert!(error < 0.08, "{name}: mean error {error}");
    }
}

#[test]
fn seeds_and_scales_matter_as_they_should() {
    for name in SOLID_NAMES {
        let at = SolidPoint { p: Vec3::new(0.7, 0.4, -0.9), n: Vec3::Y, footprint: 0.0, time: 0.0 };
        let one = solid_by_name(name, BOUNDS, 1).unwrap().color(&at);
        let two = solid_by_name(name, BOUNDS, 2).unwrap().color(&at);
        // Checkers and rings have nothing random.
        assert_eq!(one == two, ["checker", "rings"].contains(&name), "{name}");
        // Ten times the model, ten times the pattern.
        let large = Aabb { min: BOUNDS.min * 8.0, max: BOUNDS.max * 8.0 };
        let scaled = SolidPoint { p: at.p * 8.0, ..at };
        let same = solid_by_name(name, large, 1).unwrap().color(&scaled);
        crate::common::assert_close(same, one, 1e-3, name);
    }
}

/// From nearby the ground of a landscape has grain at every width of texels down to a hundred-thousandth of its size; from afar that
/// has gone, and left the mean brightness as it is.
#[test]
fn landscapes_have_grain_down_to_the_texel() {
    let bounds = Aabb { min: Vec3::new(-1.0, 0.0, -1.0), max: Vec3::new(1.0, 0.45, 1.0) };
    let solid = solid_by_name("landscape", bounds, 5).unwrap();
    // Along a line, in steps of one footprint.
    let line = |from: Vec3, footprint: f32| -> Vec<f32> {
        let at = |i: usize| {
            let p = from + Vec3::new(0.8, 0.1, 0.6) * footprint * i as f32;
            SolidPoint { p, n: Vec3::Y, footprint, time: 0.0 }
        };
        let points: Vec<SolidPoint> = (0..256).map(at).collect();
        let mut colors = vec![[0.0; 4]; points.len()];
        solid.colors(&points, &mut colors);
        // The same one by one.
        points.iter().zip(&colors).for_each(|(point, color)| assert_eq!(solid.color(point), *color));
        colors.iter().map(|c| c[1]).collect()
    };
    let contrast = |values: &[f32]| {
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32;
        variance.sqrt() / mean
    };
    for from in [Vec3::new(0.21, 0.12, 0.13), Vec3::new(-0.4, 0.2, 0.55)] {
        for footprint in [1e-3, 3e-4, 1e-4, 3e-5, 1.2e-5] {
            let contrast = contrast(&line(from, footprint));
            assert!(contrast > 0.03, "{footprint} at {from}: {contrast}");
        }
        // Means over a hundred texels from nearby are those from afar.
        let near: Vec<f32> =
            (0..40).map(|i| from + Vec3::X * 0.002 * i as f32).flat_map(|p| line(p, 2e-5)).collect();
        let far: Vec<f32> =
            (0..40).map(|i| from + Vec3::X * 0.002 * i as f32).map(|p| line(p, 1.4e-3)[0]).collect();
        let [near, far] = [near, far].map(|v| v.iter().sum::<f32>() / v.len() as f32);
        assert!((near / far - 1.0).abs() < 0.15, "{near} {far}");
    }
}

mod pattern {
    use fantex_texture::{Brick, Checker, Color, Recipe, Solid, SolidPoint};
    use glam::Vec3;

    #[test]
    fn cubes_alternate_and_blur_to_grey() {
        let checker = Checker { even: Color::WHITE, odd: Color::BLACK, cell: 0.5 };
        let at = |p, footprint| {
            checker.color(&SolidPoint { p, n: Vec3::ONE.normalize(), footprint, time: 0.0 })[0]
        };
        assert_eq!(at(Vec3::splat(0.25), 0.0), 1.0);
        assert_eq!(at(Vec3::new(0.75, 0.25, 0.25), 0.0), 0.0);
        assert_eq!(at(Vec3::new(-0.25, -0.25, 0.25), 0.0), 1.0);
        assert!((at(Vec3::splat(0.25), 40.0) - 0.5).abs() < 0.01);
    }

    #[test]
    fn cells_without_size_are_refused() {
        assert!(Checker { cell: 0.0, ..Checker::default() }.check().is_err());
        assert!(Checker { cell: f32::NAN, ..Checker::default() }.check().is_err());
        assert!(Checker::default().check().is_ok());
    }

    #[test]
    fn rows_are_shifted_against_each_other() {
        let wall = Brick::new(1);
        let mortar = |x: f32, y: f32| {
            wall.height(&SolidPoint { p: Vec3::new(x, y, 0.05), n: Vec3::Z, footprint: 0.0, time: 0.0 }) < 0.5
        };
        assert!(mortar(0.295, 0.05) && !mortar(0.295, 0.15), "half a brick on, there is a brick");
        assert!(mortar(0.1, 0.095) && !mortar(0.1, 0.05), "between rows lies mortar");
    }
}

/// The recipe as the textbook has it, written out.
#[test]
fn rings_are_rounded_radii_modulo_the_period() {
    let rings = Rings { unit: 0.02, period: 9, light_units: 5, ..Rings::default() };
    let steps = [
        rings,
        Rings { eccentricity: 2.0, ..rings },
        Rings { eccentricity: 2.0, twist: 3.0, ..rings },
        Rings { eccentricity: 2.0, twist: 3.0, tilt: 20.0, lobes: 7.0, ..rings },
    ];
    let mut light = 0;
    for rings in steps {
        for i in 0..2000 {
            let [x, y, z] =
                [0.7548777, 0.5698403, 0.3819660].map(|step| 2.0 * ((i as f64 * step).fract()) - 1.0);
            let (sin, cos) = rings.tilt.to_radians().sin_cos();
            let [tx, ty, tz] = [x * cos - y * sin, x * sin + y * cos, z];
            let angle = tx.atan2(tz);
            let wave = f64::from(rings.lobes) * angle + f64::from(rings.twist) * ty;
            let radius = (tx * tx + tz * tz).sqrt() / f64::from(rings.unit)
                + f64::from(rings.eccentricity) * wave.sin();
            if (radius.fract() - 0.5).abs() < 1e-3 {
                continue;
            }
            let grain = (radius.round() as i64).rem_euclid(9);
            let p = Vec3::new(x as f32, y as f32, z as f32);
            let color = rings.color(&SolidPoint { p, n: Vec3::Z, footprint: 0.0, time: 0.0 });
            let expected = if grain < 5 { rings.light } else { rings.dark };
            assert_eq!(Vec3::from_slice(&color[..3]), expected.rgb(), "{p} {rings:?}");
            light += usize::from(grain < 5);
        }
    }
    assert!((3800..5000).contains(&light), "{light}");
    // Far away, the mean.
    let far = rings.color(&SolidPoint { p: Vec3::X, n: Vec3::Z, footprint: 50.0, time: 0.0 });
    let mean = rings.dark.rgb().lerp(rings.light.rgb(), 5.0 / 9.0);
    assert!((Vec3::from_slice(&far[..3]) - mean).length() < 0.01, "{far:?}");
}
