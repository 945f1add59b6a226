//! Environment maps: continuity, conversion, levels, filtered look-ups, diffuse and rough reflection.

use std::sync::Arc;

use fantex_base::ErrorKind;
use fantex_texture::color::srgb_from_linear;
use fantex_texture::environment::{
    ChartPoint, CubeFace, CubeTexture, DirectionSource, EnvironmentForm, EnvironmentLayout, EnvironmentMap,
    EnvironmentProxy, IrradianceHarmonics, PREFILTERED_LEVELS, PrefilteredEnvironment, Sky,
};
use fantex_texture::{Filtering, Image, Samples, ShadingPoint, Texture};
use glam::{Vec2, Vec3, Vec4};

use crate::common::data_folder;

const NO_FOOTPRINT: [Vec3; 2] = [Vec3::ZERO; 2];

fn test_image(name: &str) -> Option<Image> {
    let path = data_folder("images")?.join(name);
    Some(Image::load(path).unwrap_or_else(|error| panic!("{error}")))
}

/// `count` directions spread evenly over the sphere.
fn sphere(count: usize) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |i| {
        let y = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let angle = i as f32 * 2.399_963_2;
        let r = (1.0 - y * y).sqrt();
        Vec3::new(r * angle.sin(), y, r * angle.cos())
    })
}

/// Noise from the bits of a direction: as rough as a map can be.
fn noise(d: Vec3) -> Vec3 {
    let hash = |v: f32| (v * 7919.0 + 13.0).sin() * 43_758.547;
    Vec3::from([d.x + d.z, d.y - d.x, d.z + 2.0 * d.y].map(|v| (hash(v) - hash(v).floor()).clamp(0.0, 1.0)))
}

/// A picture with soft and sharp parts.
fn pattern(d: Vec3) -> Vec3 {
    let checker = if ((d.x * 6.0).floor() + (d.y * 6.0).floor() + (d.z * 6.0).floor()) as i32 & 1 == 0 {
        0.8
    } else {
        0.2
    };
    Vec3::new(checker, 0.5 + 0.5 * d.y, 0.5 + 0.5 * (9.0 * d.x).sin())
}

#[test]
fn look_ups_have_no_seams() {
    let h = 2e-4;
    for form in EnvironmentForm::ALL {
        for side in [1, 2, 3, 8, 21] {
            let map = EnvironmentMap::from_function(form, side, |d, _| noise(d));
            // Between neighbouring texels a value changes by one at most; a mirror ball's texels get thin at its rim.
            let thinnest = match form {
                EnvironmentForm::Sphere | EnvironmentForm::MirrorBall => 100.0,
                _ => 8.0,
            };
            let most = thinnest * side as f32 * h;
            let seams =
                [Vec3::new(1.0, 1.0, 0.3), Vec3::new(-1.0, 0.2, 1.0), Vec3::ONE, Vec3::new(1.0, -1.0, -1.0)];
            let special =
                seams.map(Vec3::normalize).into_iter().chain(Vec3::AXES).chain(Vec3::AXES.map(|a| -a));
            let rim = (0..40).map(|i| Vec3::new((i as f32).cos(), (i as f32).sin(), 0.0));
            let date_line = (0..40).map(|i| Vec3::new(0.0, (i as f32 * 0.1).cos(), (i as f32 * 0.1).sin()));
            // Coarser levels of a sphere are made by rows.
            let levels: &[f32] = if form == EnvironmentForm::Sphere { &[0.0, 1.0, 2.5] } else { &[0.0] };
            for d in special.chain(rim).chain(date_line) {
                for (towards, &level) in sphere(24).flat_map(|d| levels.iter().map(move |level| (d, level))) {
                    let [a, b] = [d - towards * h, d + towards * h].map(|d| map.sample_level(d, level));
                    let jump = (a - b).abs().max_element();
                    assert!(jump <= most.min(0.5), "{form:?} {side} at {d} towards {towards}: {jump}");
                }
            }
        }
    }
}

#[test]
fn constant_maps_are_constant_at_every_level_and_place() {
    for form in EnvironmentForm::ALL {
        let map = EnvironmentMap::from_function(form, 12, |_, _| Vec3::new(0.25, 0.5, 4.0));
        for d in sphere(500) {
            for level in [0.0, 0.7, 2.0, 9.0] {
                let value = map.sample_level(d, level) / Vec3::new(0.25, 0.5, 4.0);
                assert!((value - 1.0).abs().max_element() < 1e-5, "{form:?} {level}: {value}");
            }
            let wide = map.sample(d, [Vec3::X * 0.3, Vec3::Y * 0.02]) / Vec3::new(0.25, 0.5, 4.0);
            assert!((wide - 1.0).abs().max_element() < 1e-5);
        }
    }
}

#[test]
fn levels_keep_the_light() {
    for (form, sides, most) in [
        (EnvironmentForm::Cube, [64, 48, 37], 5e-3),
        (EnvironmentForm::Sphere, [64, 48, 37], 5e-3),
        // Texels at the rim are in or out as a whole.
        (EnvironmentForm::DualParaboloid, [128, 96, 75], 0.03),
        (EnvironmentForm::MirrorBall, [128, 96, 75], 0.03),
    ] {
        for side in sides {
            let map =
                EnvironmentMap::from_function(form, side, |d, _| pattern(d) * (1.0 + 3.0 * d.x.max(0.0)));
            let first = map.mean(0);
            for level in 1..map.level_count().min(5) {
                let error = (map.mean(level) / first - 1.0).abs().max_element();
                assert!(error < most, "{form:?} of {side}, level {level}: {error}");
            }
        }
    }
}

/// Root mean square difference of two maps, sRGB-encoded and clamped, and its PSNR in decibels.
fn difference(a: &EnvironmentMap, b: &EnvironmentMap) -> (f32, f32) {
    let count = 60_000;
    let encode = |v: Vec3| v.min(Vec3::ONE).to_array().map(srgb_from_linear);
    let sum: f64 = sphere(count)
        .map(|d| {
            let [a, b] = [a, b].map(|map| Vec3::from(encode(map.sample(d, NO_FOOTPRINT))));
            f64::from((a - b).length_squared()) / 3.0
        })
        .sum();
    let rms = (sum / count as f64).sqrt() as f32;
    (rms, -20.0 * rms.log10())
}

/// A form with a side that resolves about as much as a cube of 128.
const LIKE_CUBES_OF_128: [(EnvironmentForm, u32); 4] = [
    (EnvironmentForm::Cube, 128),
    (EnvironmentForm::Sphere, 256),
    (EnvironmentForm::DualParaboloid, 256),
    (EnvironmentForm::MirrorBall, 512),
];

#[test]
fn forms_convert_into_each_other() {
    let Some(image) = test_image("forest.exr") else { return };
    let forest = EnvironmentMap::from_image(&image, EnvironmentLayout::Panorama).unwrap();
    // A picture that all forms resolve, so that the conversions are measured and not the loss of resolution.
    let soft = forest.converted(EnvironmentForm::Cube, 64);
    for (from, from_side) in LIKE_CUBES_OF_128 {
        let source = soft.converted(from, from_side);
        for (to, to_side) in LIKE_CUBES_OF_128 {
            let converted = source.converted(to, to_side);
            let (once, once_db) = difference(&source, &converted);
            let (there_and_back, psnr) = difference(&source, &converted.converted(from, from_side));
            println!(
                "{from:?} to {to:?}: rms {once:.4} ({once_db:.1} dB), and back {there_and_back:.4} ({psnr:.1} dB)"
            );
            let ball = [from, to].contains(&EnvironmentForm::MirrorBall);
            let (most_once, most_back) = if ball { (0.03, 0.04) } else { (0.015, 0.02) };
            assert!(
                once < most_once && there_and_back < most_back,
                "{from:?} to {to:?}: {once} {there_and_back}"
            );
            let light = converted.mean(0) / source.mean(0);
            assert!((light - 1.0).abs().max_element() < 0.01, "{from:?} to {to:?}: light {light}");
        }
    }
}

#[test]
fn conversion_keeps_directions() {
    let source = EnvironmentMap::from_function(EnvironmentForm::Cube, 64, |d, _| d * 0.5 + 0.5);
    for (form, side) in LIKE_CUBES_OF_128 {
        let map = source.converted(form, side);
        for d in sphere(2000).filter(|d| form != EnvironmentForm::MirrorBall || d.z > -0.9) {
            let seen = map.sample(d, NO_FOOTPRINT) * 2.0 - 1.0;
            assert!((seen - d).length() < 0.03, "{form:?}: {d} shows {seen}");
        }
    }
}

#[test]
fn footprints_average() {
    for (form, side) in LIKE_CUBES_OF_128 {
        let map = EnvironmentMap::from_function(form, side, |d, _| pattern(d));
        for d in sphere(40).filter(|d| form != EnvironmentForm::MirrorBall || d.z > -0.7) {
            let (right, down) = d.any_orthonormal_pair();
            let steps = [right * 0.3, down * 0.1];
            let offset = |i: u32| (i as f32 + 0.5) / 32.0 - 0.5;
            let truth = (0..1024_u32)
                .map(|i| map.sample(d + steps[0] * offset(i % 32) + steps[1] * offset(i / 32), NO_FOOTPRINT))
                .sum::<Vec3>()
                / 1024.0;
            let seen = map.sample(d, steps);
            assert!((seen - truth).length() < 0.15, "{form:?} at {d}: {seen}, the mean is {truth}");
        }
    }
}

/// Fine stripes along all axes, under small footprints: of a panorama, poles show what is seen at other latitudes.
#[test]
fn panoramas_are_sharp_at_their_poles() {
    let stripes =
        |d: Vec3, _: [Vec3; 2]| Vec3::from(d.to_array().map(|along| 0.5 + 0.5 * (150.0 * along).sin()));
    let map = EnvironmentMap::from_function(EnvironmentForm::Sphere, 1024, stripes);
    let beside_poles = [0.0, 0.002, 0.01, 0.03, 0.1].into_iter().flat_map(|polar: f32| {
        let around = (0..8).map(move |i| (i as f32).sin_cos());
        around.flat_map(move |(sin, cos)| {
            [1.0, -1.0].map(|side| Vec3::new(polar.sin() * sin, side * polar.cos(), polar.sin() * cos))
        })
    });
    for (i, d) in beside_poles.chain(sphere(60)).enumerate() {
        let (right, down) = d.any_orthonormal_pair();
        let (sin, cos) = (0.7 * i as f32).sin_cos();
        let [along, across] = [right * cos + down * sin, down * cos - right * sin];
        for [length, width] in [[0.005, 0.005], [0.03, 0.004]] {
            let steps = [along * length, across * width];
            let offset = |i: u32| (i as f32 + 0.5) / 16.0 - 0.5;
            let truth = (0..256_u32)
                .map(|i| map.sample(d + steps[0] * offset(i % 16) + steps[1] * offset(i / 16), NO_FOOTPRINT))
                .sum::<Vec3>()
                / 256.0;
            let seen = map.sample(d, steps);
            let error = (seen - truth).abs().max_element();
            assert!(error < 0.06, "{length} x {width} at {d}: {seen}, the mean is {truth}");
        }
    }
}

#[test]
fn faces_of_pictures_lie_where_the_layout_says() {
    let side = 5;
    let map = EnvironmentMap::from_function(EnvironmentForm::Cube, side, |d, _| d * 0.5 + 0.5);
    for layout in [
        EnvironmentLayout::HorizontalCross,
        EnvironmentLayout::VerticalCross,
        EnvironmentLayout::HorizontalStrip,
        EnvironmentLayout::VerticalStrip,
    ] {
        let image = map.to_image(layout);
        assert_eq!(EnvironmentLayout::of_size(image.width, image.height), Some(layout));
        let again = EnvironmentMap::from_image(&image, layout).unwrap();
        for (chart, y, x) in (0..6).flat_map(|c| (0..5).flat_map(move |y| (0..5).map(move |x| (c, y, x)))) {
            assert_eq!(again.texel(0, chart, x, y), map.texel(0, chart, x, y), "{layout:?} {chart} {x},{y}");
        }
    }
    // Neighbours in a cross are neighbours on the cube: colours run on over the folds.
    let cross = map.unfolded();
    let step = |a: [u32; 2], b: [u32; 2]| {
        let [a, b] = [a, b].map(|[x, y]| Vec3::from_slice(&cross.linear_texel(x, y)[..3]));
        (a - b).length()
    };
    for i in 0..side {
        for (a, b) in [
            ([4, 5 + i], [5, 5 + i]),
            ([9, 5 + i], [10, 5 + i]),
            ([14, 5 + i], [15, 5 + i]),
            ([5 + i, 4], [5 + i, 5]),
            ([5 + i, 9], [5 + i, 10]),
        ] {
            assert!(step(a, b) < 0.2, "{a:?} {b:?}: {}", step(a, b));
        }
    }
    let faces = CubeFace::ALL.map(|face| {
        let color = face.forward() * 0.5 + 0.5;
        Image::from_linear(2, 2, 3, color.to_array().repeat(4))
    });
    let built = EnvironmentMap::from_faces(&faces).unwrap();
    for face in CubeFace::ALL {
        assert_eq!(built.sample(face.forward(), NO_FOOTPRINT), face.forward() * 0.5 + 0.5);
    }
}

#[test]
fn panoramas_balls_and_discs_survive_their_pictures() {
    for (form, layout) in [
        (EnvironmentForm::Sphere, EnvironmentLayout::Panorama),
        (EnvironmentForm::DualParaboloid, EnvironmentLayout::DualParaboloid),
        (EnvironmentForm::MirrorBall, EnvironmentLayout::MirrorBall),
    ] {
        let map = EnvironmentMap::from_function(form, 32, |d, _| pattern(d));
        let again = EnvironmentMap::from_image(&map.to_image(layout), layout).unwrap();
        let (rms, _) = difference(&map, &again);
        assert!(rms < 1e-6, "{form:?}: {rms}");
    }
}

#[test]
fn files_are_recognised_by_their_proportions() {
    let folder = tempfile::tempdir().unwrap();
    let save = |name: &str, width: u32, height: u32| {
        let path = folder.path().join(name);
        let count = (width * height * 3) as usize;
        Image::from_linear(width, height, 3, vec![0.5; count]).save(&path).unwrap();
        path
    };
    let form_of = |path| EnvironmentMap::load(path).map(|map| map.form());
    assert_eq!(form_of(save("a.hdr", 16, 8)).unwrap(), EnvironmentForm::Sphere);
    assert_eq!(form_of(save("b.exr", 16, 12)).unwrap(), EnvironmentForm::Cube);
    assert_eq!(form_of(save("c.png", 4, 24)).unwrap(), EnvironmentForm::Cube);
    let odd = form_of(save("d.png", 10, 9)).unwrap_err();
    assert!(odd.to_string().contains("10 x 9") && odd.to_string().contains("2:1"), "{odd}");
    let square = form_of(save("i.png", 9, 9)).unwrap_err();
    assert!(square.to_string().contains("layout = \"mirror_ball\""), "{square}");
    let missing = form_of(folder.path().join("none.hdr")).unwrap_err();
    assert_eq!(missing.kind(), ErrorKind::NotFound, "{missing}");
    assert!(missing.to_string().contains("none.hdr"));
    let ball = EnvironmentMap::load_as(save("e.png", 9, 9), EnvironmentLayout::MirrorBall).unwrap();
    assert_eq!(ball.form(), EnvironmentForm::MirrorBall);
    let wrong = EnvironmentMap::load_as(save("f.png", 9, 8), EnvironmentLayout::MirrorBall).unwrap_err();
    assert!(wrong.to_string().ends_with("its layout needs 1 : 1"), "{wrong}");
    let [square, small] = [save("g.png", 4, 4), save("h.png", 3, 4)];
    let mut faces = [square.as_path(); 6];
    assert_eq!(EnvironmentMap::load_faces(faces).unwrap().chart_size(), [4, 4]);
    faces[3] = &small;
    let error = EnvironmentMap::load_faces(faces).unwrap_err();
    assert!(error.to_string().contains("h.png"), "{error}");
}

#[test]
fn impossible_light_is_made_possible() {
    let samples = vec![f32::NAN, f32::INFINITY, -1.0, 0.5, f32::NEG_INFINITY, 2.0];
    let image = Image::from_linear(2, 1, 3, samples);
    let map = EnvironmentMap::from_image(&image, EnvironmentLayout::Panorama).unwrap();
    assert_eq!(map.texel(0, 0, 0, 0), Vec3::new(0.0, 65_504.0, 0.0));
    assert_eq!(map.texel(0, 0, 1, 0), Vec3::new(0.5, 0.0, 2.0));
}

#[test]
fn the_strip_of_a_real_place_has_its_sky_above() {
    let Some(image) = test_image("Ryfjallet_cubemap.png") else { return };
    let map = EnvironmentMap::from_image(&image, EnvironmentLayout::VerticalStrip).unwrap();
    assert_eq!(map.chart_size(), [256, 256]);
    let mean = |face: CubeFace| map.sample_level(face.forward(), 8.0).element_sum();
    assert!(
        mean(CubeFace::Up) > 1.5 * mean(CubeFace::Down),
        "{} {}",
        mean(CubeFace::Up),
        mean(CubeFace::Down)
    );
    // Where faces meet, the photograph goes on: across an edge it changes no more than inside a face.
    let (mut across, mut within) = (0.0, 0.0);
    for d in (0..400).map(|i| i as f32 / 200.0 - 1.0) {
        for (edge, over) in [
            (Vec3::new(1.0, d, -1.0), Vec3::X),
            (Vec3::new(d, 1.0, -1.0), Vec3::Y),
            (Vec3::new(-1.0, d, 1.0), Vec3::X),
        ] {
            let texel = over / 128.0;
            let at = |d: Vec3| map.sample(d, NO_FOOTPRINT);
            across += (at(edge + texel) - at(edge - texel)).length();
            within += (at(edge - texel * 5.0) - at(edge - texel * 7.0)).length();
        }
    }
    assert!(across < 2.0 * within, "across {across}, within {within}");
}

/// Irradiance / pi, by a sum over all texels.
fn irradiance_by_brute_force(map: &EnvironmentMap, level: usize, normal: Vec3) -> Vec3 {
    let form = map.form();
    let [width, height] = map.level_size(level);
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for chart in 0..form.charts() {
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) / Vec2::new(width as f32, height as f32);
            let cosine = form.direction(ChartPoint { chart, uv }).dot(normal).max(0.0);
            let weight = cosine * form.steradians_per_uv(uv);
            sum += map.texel(level, chart, x, y) * weight;
            weights += weight;
        }
    }
    sum / weights
}

#[test]
fn harmonics_hold_the_diffuse_light_of_a_forest() {
    for (name, most) in [("forest.exr", 0.06), ("spiaggia_di_mondello_1k.hdr", 0.09)] {
        let Some(image) = test_image(name) else { return };
        let map = EnvironmentMap::from_image(&image, EnvironmentLayout::Panorama).unwrap();
        let harmonics = IrradianceHarmonics::of_map(&map);
        let level = (0..map.level_count()).find(|&l| map.level_size(l)[1] <= 128).unwrap();
        let (mut worst, mut sum, mut largest) = (0.0_f32, 0.0, 0.0_f32);
        let normals: Vec<Vec3> = sphere(100).collect();
        for &n in &normals {
            let truth = irradiance_by_brute_force(&map, level, n);
            let error = (harmonics.diffuse(n) - truth).abs().element_sum();
            worst = worst.max(error);
            sum += error;
            largest = largest.max(truth.element_sum());
        }
        let (average, worst) = (sum / normals.len() as f32 / largest, worst / largest);
        println!(
            "{name}: error of the diffuse light relative to the largest: average {average:.4}, worst {worst:.4}"
        );
        assert!(average < 0.5 * most && worst < most, "{name}: {average} {worst}");
    }
}

#[test]
fn mirrors_show_the_map_itself() {
    let map = Arc::new(EnvironmentMap::from_function(EnvironmentForm::DualParaboloid, 64, |d, _| pattern(d)));
    let environment = PrefilteredEnvironment::new(Arc::clone(&map));
    for d in sphere(300) {
        let steps = [Vec3::X * 0.02, Vec3::Y * 0.03];
        assert_eq!(environment.reflected(d, NO_FOOTPRINT, 0.0), map.sample(d, NO_FOOTPRINT));
        assert_eq!(environment.reflected(d, steps, 0.0), map.sample(d, steps));
    }
}

#[test]
fn even_surroundings_are_reflected_evenly() {
    for (form, side) in EnvironmentForm::ALL.into_iter().flat_map(|form| [1, 2, 64].map(|side| (form, side)))
    {
        let map = EnvironmentMap::from_function(form, side, |_, _| Vec3::splat(0.7));
        let environment = PrefilteredEnvironment::new(Arc::new(map));
        for d in sphere(50).chain(Vec3::AXES).chain(Vec3::AXES.map(|axis| -axis)) {
            for roughness in [0.0, 0.03, 0.125, 0.3, 0.77, 1.0, 7.0, f32::NAN] {
                let value = environment.reflected(d, [Vec3::X * 0.1; 2], roughness);
                let error = (value - 0.7).abs().max_element();
                assert!(error < 1e-4, "{form:?} of {side}, {roughness}: {value}");
            }
        }
    }
}

#[test]
fn the_number_of_threads_makes_no_difference() {
    let on_threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
        pool.install(|| {
            let map = EnvironmentMap::from_function(EnvironmentForm::Sphere, 96, |d, _| noise(d));
            let environment = PrefilteredEnvironment::new(Arc::new(map));
            let rough = sphere(100).map(|d| environment.reflected(d, NO_FOOTPRINT, d.y.abs()).to_array());
            (rough.collect::<Vec<_>>(), environment.irradiance().coefficients())
        })
    };
    assert_eq!(on_threads(1), on_threads(3));
}

#[test]
fn impossible_directions_give_numbers() {
    let directions = [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::NEG_Z, Vec3::NEG_Y, Vec3::splat(1e-30)];
    for form in EnvironmentForm::ALL {
        let map = Arc::new(EnvironmentMap::from_function(form, 8, |d, _| pattern(d)));
        let environment = PrefilteredEnvironment::new(Arc::clone(&map));
        for d in directions {
            for steps in directions.map(|step| [step, Vec3::X]) {
                for roughness in [0.0, 0.05, 0.5] {
                    let value = environment.reflected(d, steps, roughness);
                    let possible = d.is_finite() && steps[0].is_finite();
                    assert!(value.is_finite() || !possible, "{form:?} {d} {steps:?} {roughness}: {value}");
                }
            }
        }
    }
}

/// What a GGX surface seen along its normal gathers, weighted by the cosine: a sum over all texels.
fn rough_by_brute_force(map: &EnvironmentMap, level: usize, normal: Vec3, roughness: f32) -> Vec3 {
    let a2 = roughness.powi(4);
    let form = map.form();
    let [width, height] = map.level_size(level);
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for chart in 0..form.charts() {
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let uv = (Vec2::new(x as f32, y as f32) + 0.5) / Vec2::new(width as f32, height as f32);
            let l = form.direction(ChartPoint { chart, uv });
            let cosine = l.dot(normal).max(0.0);
            let cos_half2 = 0.5 * (1.0 + l.dot(normal));
            let d = cos_half2 * (a2 - 1.0) + 1.0;
            let weight = cosine * a2 / (d * d) * form.steradians_per_uv(uv);
            sum += map.texel(level, chart, x, y) * weight;
            weights += weight;
        }
    }
    sum / weights
}

#[test]
fn rough_levels_equal_brute_force() {
    for (name, most) in [("forest.exr", 0.02), ("spiaggia_di_mondello_1k.hdr", 0.04)] {
        let Some(image) = test_image(name) else { return };
        let map = Arc::new(EnvironmentMap::from_image(&image, EnvironmentLayout::Panorama).unwrap());
        let start = std::time::Instant::now();
        let environment = PrefilteredEnvironment::new(Arc::clone(&map));
        println!("{name}: prefiltered in {:.2} s", start.elapsed().as_secs_f32());
        for level in [1, 2, 3, 4, 6, 8] {
            let roughness = level as f32 / PREFILTERED_LEVELS as f32;
            let (mut square, mut truth_square) = (0.0, 0.0);
            for d in sphere(60) {
                let truth = rough_by_brute_force(&map, usize::from(level > 1), d, roughness);
                square += (environment.reflected(d, NO_FOOTPRINT, roughness) - truth).length_squared();
                truth_square += truth.length_squared();
            }
            let error = (square / truth_square).sqrt();
            println!("{name}: roughness {roughness}: relative rms error {error:.4}");
            assert!(error < most, "{name}: roughness {roughness}: {error}");
        }
    }
}

#[test]
fn a_sky_can_be_seen_as_a_panorama() {
    let sky = Sky { has_sun: true, ..Sky::default() }.to_map(64).unwrap();
    let image = sky.to_image(EnvironmentLayout::Panorama);
    assert_eq!([image.width, image.height], [256, 128]);
    assert!(matches!(image.samples, Samples::F32(_)));
    let [above, below] = [10, 120].map(|y| image.linear_texel(128, y));
    assert!(above[2] > above[0] && above[2] > below[2], "{above:?} {below:?}");
}

#[test]
fn cube_textures_look_in_the_direction_they_are_told() {
    let map = Arc::new(EnvironmentMap::from_function(EnvironmentForm::Cube, 64, |d, _| d * 0.5 + 0.5));
    let normal = Vec3::new(0.2, 0.9, 0.4).normalize();
    let to_eye = Vec3::new(-0.3, 0.5, 0.8).normalize();
    let point = ShadingPoint {
        position: Vec3::new(1.0, 2.0, 2.0),
        position_steps: [Vec3::ZERO; 2],
        normal,
        normal_steps: [Vec3::ZERO; 2],
        uv: &[],
        vertex_color: Vec4::ONE,
        eye: Some(to_eye.into()),
        time: 0.0,
        filtering: Filtering::Own,
    };
    let shown = |texture: &CubeTexture, point: &ShadingPoint<'_>| {
        let value = texture.evaluate(point);
        assert_eq!(value.w, 1.0);
        (value.truncate() * 2.0 - 1.0).normalize()
    };
    let near = |a: Vec3, b: Vec3| assert!((a - b.normalize()).length() < 0.01, "{a}, not {b}");
    let texture = |source| CubeTexture::new(Arc::clone(&map), source);
    let mirrored = normal * (2.0 * normal.dot(to_eye)) - to_eye;
    near(shown(&texture(DirectionSource::Reflection), &point), mirrored);
    near(shown(&texture(DirectionSource::Normal), &point), normal);
    near(shown(&texture(DirectionSource::View), &point), -to_eye);
    let center = Vec3::new(0.0, 2.0, 1.0);
    near(shown(&texture(DirectionSource::Position { center }), &point), Vec3::new(1.0, 0.0, 1.0));
    // A bake has no eye.
    let baked = ShadingPoint { eye: None, ..point };
    near(shown(&texture(DirectionSource::Reflection), &baked), normal);
    assert!(texture(DirectionSource::Reflection).is_view_dependent());
    assert!(!texture(DirectionSource::Normal).is_view_dependent());
    // Turned to the left by a right angle, what was on the right (+x) is ahead (-z).
    let turned = CubeTexture { rotation_degrees: 90.0, ..texture(DirectionSource::Normal) };
    near(shown(&turned, &ShadingPoint { normal: Vec3::NEG_Z, ..point }), Vec3::X);
    // In a room, what is seen depends on the place.
    let room = EnvironmentProxy::Box { min: Vec3::splat(-4.0), max: Vec3::splat(4.0) };
    let inside = CubeTexture { proxy: Some((room, Vec3::ZERO)), ..texture(DirectionSource::View) };
    let upwards = ShadingPoint { eye: Some(Vec3::NEG_Y.into()), ..point };
    near(shown(&inside, &upwards), Vec3::new(1.0, 4.0, 2.0));
    // Over a footprint that holds half the sphere, the mean.
    let wide = ShadingPoint { normal_steps: [Vec3::X * 2.0, Vec3::Z * 2.0], normal: Vec3::Y, ..point };
    let mean = texture(DirectionSource::Normal).evaluate(&wide).truncate();
    assert!((mean.x - 0.5).abs() < 0.1 && (mean.z - 0.5).abs() < 0.1, "{mean}");
}

mod form {
    use fantex_texture::environment::{ChartPoint, CubeFace, EnvironmentForm, mirrored, mirrored_steps};
    use glam::{Vec2, Vec3};
    use proptest::prelude::*;

    fn unit_vectors() -> impl Strategy<Value = Vec3> {
        (-1.0..1.0_f32, -1.0..1.0_f32, -1.0..1.0_f32)
            .prop_map(|(x, y, z)| Vec3::new(x, y, z))
            .prop_filter("too short", |v| v.length() > 0.1)
            .prop_map(Vec3::normalize)
    }

    proptest! {
        #[test]
        fn directions_survive_location(d in unit_vectors(), scale in 0.01..100.0_f32) {
            for form in EnvironmentForm::ALL {
                let at = form.locate(d * scale);
                prop_assert!(at.chart < form.charts());
                prop_assert!(form.is_inside(at.uv * 0.9999 + 0.00005), "{form:?} {at:?}");
                prop_assert!((form.direction(at) - d).length() < 2e-3, "{form:?} {d} {}", form.direction(at));
            }
        }

        #[test]
        fn steps_are_the_limits_of_differences(d in unit_vectors(), towards in unit_vectors()) {
            let h = 2e-3;
            let step = (towards - d * d.dot(towards)).normalize_or(Vec3::X) * h;
            for form in EnvironmentForm::ALL {
                let [a, b] = [d - step * 0.5, d + step * 0.5].map(|d| form.locate(d));
                let mut seen = b.uv - a.uv;
                // Beside a pole, the rim or a seam a difference is no derivative.
                let singular = match form {
                    EnvironmentForm::Sphere => d.y.abs() > 0.98 || seen.x.abs() > 0.5,
                    EnvironmentForm::MirrorBall => d.z < -0.95,
                    _ => a.chart != b.chart,
                };
                if !singular {
                    seen /= h;
                    let stated = form.uv_step(d, step) / h;
                    prop_assert!((stated - seen).length() < 0.01 * (1.0 + seen.length()), "{form:?} {d}: {stated} {seen}");
                }
            }
        }
    }

    #[test]
    fn solid_angles_cover_the_sphere() {
        for form in EnvironmentForm::ALL {
            let n = 512;
            let mut sum = 0.0_f64;
            for y in 0..n {
                for x in 0..n {
                    let uv = (Vec2::new(x as f32, y as f32) + 0.5) / n as f32;
                    if form.is_inside(uv) {
                        sum += f64::from(form.steradians_per_uv(uv));
                    }
                }
            }
            let total = sum / f64::from(n * n) * form.charts() as f64;
            assert!((total / (4.0 * std::f64::consts::PI) - 1.0).abs() < 2e-3, "{form:?}: {total}");
        }
    }

    #[test]
    fn the_middle_of_a_picture_is_ahead() {
        for form in [EnvironmentForm::Sphere, EnvironmentForm::DualParaboloid] {
            let ahead = form.direction(ChartPoint { chart: 0, uv: Vec2::splat(0.5) });
            assert!((ahead - Vec3::NEG_Z).length() < 1e-6, "{form:?}: {ahead}");
            let right = form.direction(ChartPoint { chart: 0, uv: Vec2::new(0.6, 0.5) });
            assert!(right.x > 0.1, "{form:?}: {right}");
        }
    }

    #[test]
    fn pictures_are_seen_from_inside_without_mirroring() {
        for face in CubeFace::ALL {
            let axes = glam::Mat3::from_cols(face.right(), face.up(), -face.forward());
            assert!((axes.determinant() - 1.0).abs() < 1e-6, "{face:?} is a right-handed camera");
        }
        assert_eq!(CubeFace::Front.right(), Vec3::X);
    }

    #[test]
    fn steps_of_mirrored_directions_are_the_limits_of_differences() {
        let n = Vec3::new(0.2, 0.9, 0.1).normalize();
        let v = Vec3::new(-0.5, 0.6, 0.4).normalize();
        let (dn, dv) = (Vec3::new(1e-3, 0.0, -5e-4), Vec3::new(0.0, 4e-4, 1e-3));
        let seen = mirrored(n + dn * 0.5, v + dv * 0.5) - mirrored(n - dn * 0.5, v - dv * 0.5);
        let [stated, _] = mirrored_steps(n, [dn, dn], v, [dv, dv]);
        assert!((stated - seen).length() < 1e-5, "{stated} {seen}");
        assert!((mirrored(n, v).dot(n) - v.dot(n)).abs() < 1e-6);
    }
}

mod lighting {
    use fantex_texture::environment::{EnvironmentForm, EnvironmentMap, IrradianceHarmonics};
    use glam::Vec3;

    fn of(light: impl Fn(Vec3) -> f32 + Sync) -> IrradianceHarmonics {
        let map = EnvironmentMap::from_function(EnvironmentForm::Cube, 64, |d, _| Vec3::splat(light(d)));
        IrradianceHarmonics::of_map(&map)
    }

    #[test]
    fn constant_light_is_reflected_as_it_is() {
        let harmonics = of(|_| 0.75);
        for n in [Vec3::X, Vec3::NEG_Y, Vec3::ONE.normalize()] {
            assert!((harmonics.diffuse(n) - 0.75).abs().max_element() < 1e-4, "{}", harmonics.diffuse(n));
        }
    }

    #[test]
    fn linear_light_is_reflected_at_two_thirds() {
        // Light 1 + d.y: the irradiance is pi (1 + 2/3 n.y).
        let harmonics = of(|d| 1.0 + d.y);
        for n in [Vec3::Y, Vec3::X, Vec3::NEG_Y] {
            let expected = 1.0 + 2.0 / 3.0 * n.y;
            assert!((harmonics.diffuse(n).x - expected).abs() < 1e-3, "{} {expected}", harmonics.diffuse(n));
        }
    }
}

mod map {
    use fantex_texture::environment::EnvironmentProxy;
    use glam::Vec3;

    #[test]
    fn walls_are_seen_where_they_are() {
        let walls = EnvironmentProxy::Box { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
        let ball = EnvironmentProxy::Ball { center: Vec3::ZERO, radius: 1.0 };
        // From the centre nothing changes.
        let d = Vec3::new(0.3, -0.4, 0.5).normalize();
        for proxy in [walls, ball] {
            assert!(proxy.corrected(Vec3::ZERO, d, Vec3::ZERO).normalize().distance(d) < 1e-6);
        }
        let beside = Vec3::new(0.5, 0.0, 0.0);
        assert_eq!(walls.corrected(beside, Vec3::Z, Vec3::ZERO), Vec3::new(0.5, 0.0, 1.0));
        let met = ball.corrected(beside, Vec3::Z, Vec3::ZERO);
        assert!((met.length() - 1.0).abs() < 1e-6 && met.x == 0.5, "{met}");
        // Outside, and without a direction.
        assert_eq!(walls.corrected(Vec3::X * 2.0, d, Vec3::ZERO), d);
        assert_eq!(ball.corrected(Vec3::X * 2.0, d, Vec3::ZERO), d);
        assert_eq!(walls.corrected(beside, Vec3::ZERO, Vec3::ZERO), Vec3::ZERO);
    }
}

mod sky {
    use fantex_texture::environment::{MAX_TURBIDITY, Sky};
    use glam::Vec3;

    #[test]
    fn the_disc_keeps_the_suns_light() {
        let dark = Sky { to_sun: Vec3::new(0.3, 0.8, -0.5), ..Sky::default() };
        let expected = dark.sun_color() * 0.25;
        for side in [32, 200, 700] {
            let bright = Sky { has_sun: true, ..dark }.to_map(side).unwrap();
            let added = bright.mean(0) - dark.to_map(side).unwrap().mean(0);
            let ratio = added / expected;
            assert!((ratio - 1.0).abs().max_element() < 0.05, "{side}: {ratio}");
        }
    }

    #[test]
    fn parameters_are_checked() {
        let sky = Sky::default();
        let refused = |sky: Sky| sky.to_map(4).unwrap_err().to_string();
        assert!(refused(Sky { to_sun: Vec3::ZERO, ..sky }).starts_with("the direction to the sun"));
        assert!(refused(Sky { turbidity: f32::NAN, ..sky }).starts_with("a turbidity of NaN"));
        assert!(refused(Sky { ground: Vec3::NEG_ONE.into(), ..sky }).starts_with("the ground's reflectance"));
        for to_sun in [Vec3::Y, Vec3::NEG_Y, Vec3::X, Vec3::new(1.0, -0.1, 0.0)] {
            for turbidity in [2.0, MAX_TURBIDITY] {
                let map = Sky { to_sun, turbidity, has_sun: true, ..sky }.to_map(16).unwrap();
                assert!(map.mean(0).is_finite() && map.mean(0).min_element() > 0.0);
            }
        }
    }
}
