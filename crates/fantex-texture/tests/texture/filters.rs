//! Properties of the filters.

use std::sync::Arc;

use crate::common::{FILTERS, Random, assert_close, texture};
use fantex_texture::{
    AlphaUse, ColorSpace, Filter, Image, ImageTexture, SampleOptions, Samples, Wrap, color,
};
use glam::Vec2;

const WRAPS: [Wrap; 4] = [Wrap::Clamp, Wrap::Border, Wrap::Repeat, Wrap::Mirror];

fn random_uv(random: &mut Random, range: f32) -> Vec2 {
    Vec2::new(random.unit() - 0.5, random.unit() - 0.5) * 2.0 * range
}

#[test]
fn constants_stay_constant() {
    let color = [0.25, 0.5, 0.125, 1.0];
    let mut random = Random(1);
    for (width, height) in [(1, 1), (7, 1), (5, 9), (64, 33)] {
        let texture = texture(width, height, 3, |_, _| color);
        for _ in 0..200 {
            let uv = random_uv(&mut random, 3.0);
            let scale = 4.0_f32.powf(random.unit() * 6.0 - 5.0);
            let footprint = [random_uv(&mut random, scale), random_uv(&mut random, scale)];
            for filter in FILTERS {
                for wrap in [Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
                    let options = SampleOptions { wrap: [wrap; 2], filter, ..Default::default() };
                    assert_close(texture.sample(uv, footprint, &options), color, 2e-6, "constant");
                    assert_close(texture.sample_area(uv, footprint, [wrap; 2]), color, 2e-6, "constant area");
                }
            }
        }
    }
}

#[test]
fn bilinear_and_bicubic_reproduce_ramps() {
    let (width, height) = (37, 21);
    let ramp = |x: f32, y: f32| [0.1 + 0.02 * x, 0.9 - 0.03 * y, 0.3 + 0.01 * x + 0.01 * y, 1.0];
    let texture = texture(width, height, 3, |x, y| ramp(x as f32 + 0.5, y as f32 + 0.5));
    let mut random = Random(2);
    for _ in 0..1000 {
        let texel = Vec2::new(2.0 + random.unit() * 33.0, 2.0 + random.unit() * 17.0);
        let uv = texel / Vec2::new(width as f32, height as f32);
        for filter in [Filter::Bilinear, Filter::Bicubic, Filter::Trilinear, Filter::Anisotropic] {
            let options = SampleOptions { filter, ..Default::default() };
            let got = texture.sample(uv, [Vec2::ZERO; 2], &options);
            assert_close(got, ramp(texel.x, texel.y), 1e-5, "ramp");
        }
        let edges = [Vec2::new(0.05, 0.01), Vec2::new(-0.01, 0.04)];
        assert_close(texture.sample_area(uv, edges, [Wrap::Mirror; 2]), ramp(texel.x, texel.y), 2e-2, "area");
    }
}

#[test]
fn every_filter_but_ewa_interpolates_texel_centers() {
    let mut random = Random(3);
    let texture = texture(6, 5, 3, |_, _| [random.unit(), random.unit(), random.unit(), 1.0]);
    for y in 0..5 {
        for x in 0..6 {
            let uv = Vec2::new((x as f32 + 0.5) / 6.0, (y as f32 + 0.5) / 5.0);
            for filter in &FILTERS[..5] {
                for wrap in WRAPS {
                    let options = SampleOptions { wrap: [wrap; 2], filter: *filter, ..Default::default() };
                    let got = texture.sample(uv, [Vec2::ZERO; 2], &options);
                    assert_close(got, texture.level(0).linear_texel(x, y), 3e-6, "center");
                }
            }
        }
    }
}

/// Wrapping a coordinate is the same as sampling an image that is continued by hand.
#[test]
fn wraps_equal_an_image_continued_by_hand() {
    let (width, height) = (5_u32, 4_u32);
    let mut random = Random(4);
    let source: Vec<[f32; 4]> =
        (0..width * height).map(|_| [random.unit(), random.unit(), random.unit(), 1.0]).collect();
    let small = texture(width, height, 4, |x, y| source[(y * width + x) as usize]);
    for wrap in WRAPS {
        let continued = |i: u32, n: u32| {
            let i = i as i64 - 3 * n as i64;
            match wrap {
                Wrap::Clamp => Some(i.clamp(0, n as i64 - 1) as u32),
                Wrap::Border => (0..n as i64).contains(&i).then_some(i as u32),
                Wrap::Repeat => Some(i.rem_euclid(n as i64) as u32),
                Wrap::Mirror => {
                    let period = i.rem_euclid(2 * n as i64);
                    Some(period.min(2 * n as i64 - 1 - period) as u32)
                }
            }
        };
        let large =
            texture(7 * width, 7 * height, 4, |x, y| match (continued(x, width), continued(y, height)) {
                (Some(x), Some(y)) => source[(y * width + x) as usize],
                _ => [0.0; 4],
            });
        for _ in 0..500 {
            let uv = Vec2::splat(0.5) + random_uv(&mut random, 2.4);
            let large_uv = (uv + 3.0) / 7.0;
            for filter in [Filter::Nearest, Filter::Bilinear, Filter::Bicubic, Filter::Ewa] {
                let edges = [Vec2::new(0.2, 0.1), Vec2::new(-0.05, 0.2)];
                let options = SampleOptions { wrap: [wrap; 2], filter, ..Default::default() };
                let got = small.sample(uv, edges, &options);
                let expected = large.sample(large_uv, edges.map(|e| e / 7.0), &options);
                let what = format!("{wrap:?} {filter:?} at {uv}");
                // The nearest texel may flip on the boundary between two.
                let texel = uv * Vec2::new(width as f32, height as f32);
                let on_boundary = (texel - texel.round()).abs().min_element() < 1e-4;
                if filter != Filter::Nearest || !on_boundary {
                    assert_close(got, expected, 1e-3, &what);
                }
            }
        }
    }
}

fn mean(image: &Image) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for y in 0..image.height {
        for x in 0..image.width {
            let texel = image.linear_texel(x, y);
            sum.iter_mut().zip(texel).for_each(|(sum, value)| *sum += f64::from(value));
        }
    }
    sum.map(|sum| sum / f64::from(image.width * image.height))
}

#[test]
fn levels_of_any_size_keep_the_mean() {
    let mut random = Random(5);
    for (width, height) in [(1, 1), (2, 2), (3, 3), (1, 13), (17, 2), (31, 45), (64, 64), (100, 7)] {
        let count = width as usize * height as usize * 3;
        let bytes: Vec<u8> = (0..count).map(|_| random.bits() as u8).collect();
        for (samples, tolerance) in [
            (Samples::U8(bytes.clone()), 5e-5),
            (Samples::U16(bytes.iter().map(|b| u16::from(*b) * 257).collect()), 1e-6),
            (Samples::F32(bytes.iter().map(|b| f32::from(*b)).collect()), 1e-4),
        ] {
            for space in [ColorSpace::Srgb, ColorSpace::Linear] {
                if space == ColorSpace::Srgb && matches!(samples, Samples::F32(_)) {
                    continue;
                }
                let image = Image { width, height, channels: 3, space, samples: samples.clone() };
                let texture = ImageTexture::new(Arc::new(image));
                let expected = mean(texture.level(0));
                for level in 1..texture.level_count() {
                    let got = mean(texture.level(level));
                    for channel in 0..3 {
                        assert!(
                            (got[channel] - expected[channel]).abs() < tolerance,
                            "{width} x {height}, level {level}: {got:?}, expected {expected:?}"
                        );
                    }
                }
                let last = texture.level(texture.level_count() - 1);
                assert_eq!((last.width, last.height), (1, 1));
            }
        }
    }
}

#[test]
fn transparent_texels_do_not_bleed() {
    // Opaque red beside transparent green.
    let image = Image {
        width: 8,
        height: 8,
        channels: 4,
        space: ColorSpace::Srgb,
        samples: Samples::U8(
            (0..64).flat_map(|i| if i % 2 == 0 { [255, 0, 0, 255] } else { [0, 255, 0, 0] }).collect(),
        ),
    };
    let coverage = ImageTexture::new(Arc::new(image.clone()));
    let independent = ImageTexture::with_alpha_use(Arc::new(image), AlphaUse::Independent);
    let uv = Vec2::splat(0.5);
    for filter in [Filter::Trilinear, Filter::Anisotropic, Filter::Ewa] {
        let options = SampleOptions { filter, ..Default::default() };
        let footprint = [Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0)];
        let got = coverage.sample(uv, footprint, &options);
        assert_close(got, [1.0, 0.0, 0.0, 0.5], 1e-4, "coverage");
        let got = independent.sample(uv, footprint, &options);
        assert_close(got, [0.5, 0.5, 0.0, 0.5], 1e-4, "independent");
    }
    // Where all is transparent, the colour is still there.
    let clear = texture(4, 4, 4, |_, _| [0.2, 0.4, 0.6, 0.0]);
    for filter in FILTERS {
        let options = SampleOptions { filter, ..Default::default() };
        let got = clear.sample(uv, [Vec2::new(0.5, 0.0), Vec2::new(0.0, 0.5)], &options);
        assert_close(got, [0.2, 0.4, 0.6, 0.0], 1e-5, "clear");
    }
}

#[test]
fn gray_spreads_and_alpha_defaults_to_one() {
    for (channels, expected) in [
        (1, [0.25, 0.25, 0.25, 1.0]),
        (2, [0.25, 0.25, 0.25, 0.5]),
        (3, [0.25, 0.5, 0.75, 1.0]),
        (4, [0.25, 0.5, 0.75, 0.5]),
    ] {
        let texel = if channels == 2 { [0.25, 0.5, 0.0, 0.0] } else { [0.25, 0.5, 0.75, 0.5] };
        let texture = texture(3, 3, channels, |_, _| texel);
        for filter in FILTERS {
            let options = SampleOptions { filter, ..Default::default() };
            let footprint = [Vec2::new(0.7, 0.0), Vec2::new(0.0, 0.7)];
            assert_close(texture.sample(Vec2::ONE, footprint, &options), expected, 1e-5, "channels");
        }
    }
}

#[test]
fn srgb_is_averaged_in_linear_light() {
    let image = Image {
        width: 2,
        height: 1,
        channels: 1,
        space: ColorSpace::Srgb,
        samples: Samples::U8(vec![0, 255]),
    };
    let texture = ImageTexture::new(Arc::new(image));
    let got = texture.sample_level0_bilinear(Vec2::splat(0.5), [Wrap::Clamp; 2]);
    assert_eq!(got, [0.5, 0.5, 0.5, 1.0]);
    assert_eq!(color::srgb8_from_linear(texture.level(1).linear_texel(0, 0)[0]), 188);
}

/// A smooth, periodic, detailed picture.
fn waves(size: u32) -> ImageTexture {
    texture(size, size, 3, |x, y| {
        let (s, t) = ((x as f32 + 0.5) / size as f32, (y as f32 + 0.5) / size as f32);
        let wave = |a: f32, b: f32| 0.5 + 0.5 * (std::f32::consts::TAU * (a * s + b * t)).sin();
        [wave(5.0, 3.0), wave(-8.0, 2.0) * wave(1.0, 9.0), wave(13.0, -11.0), 1.0]
    })
}

/// The pixel's Gaussian by brute force on the bilinear reconstruction.
fn supersampled_gaussian(texture: &ImageTexture, uv: Vec2, footprint: [Vec2; 2]) -> [f32; 4] {
    const SIDE: i32 = 96;
    let (mut sum, mut total) = ([0.0; 4], 0.0);
    for j in -SIDE..=SIDE {
        for i in -SIDE..=SIDE {
            let (x, y) = (i as f32 / SIDE as f32, j as f32 / SIDE as f32);
            let squared_radius = x * x + y * y;
            if squared_radius < 1.0 {
                let weight = (-2.0 * squared_radius).exp() - (-2.0_f32).exp();
                let texel = texture
                    .sample_level0_bilinear(uv + footprint[0] * x + footprint[1] * y, [Wrap::Repeat; 2]);
                sum.iter_mut().zip(texel).for_each(|(sum, value)| *sum += weight * value);
                total += weight;
            }
        }
    }
    sum.map(|sum| sum / total)
}

#[test]
fn ewa_approaches_the_supersampled_truth() {
    let texture = waves(256);
    let mut random = Random(6);
    let options = SampleOptions { filter: Filter::Ewa, ..Default::default() };
    for _ in 0..40 {
        let uv = random_uv(&mut random, 1.0);
        let direction = Vec2::from_angle(random.unit() * 6.3);
        let minor = (2.0 + 10.0 * random.unit()) / 256.0;
        let major = minor * (1.0 + 7.0 * random.unit());
        let footprint = [direction * major, direction.perp() * minor];
        let truth = supersampled_gaussian(&texture, uv, footprint);
        assert_close(texture.sample(uv, footprint, &options), truth, 0.025, "ewa");
    }
}

#[test]
fn anisotropic_is_nearer_to_the_truth_than_trilinear() {
    let texture = waves(256);
    let mut random = Random(7);
    let (mut trilinear_error, mut anisotropic_error) = (0.0, 0.0);
    for _ in 0..60 {
        let uv = random_uv(&mut random, 1.0);
        let direction = Vec2::from_angle(random.unit() * 6.3);
        let footprint = [direction * 12.0 / 256.0, direction.perp() * 1.5 / 256.0];
        let truth = supersampled_gaussian(&texture, uv, footprint);
        let error = |filter| {
            let got = texture.sample(uv, footprint, &SampleOptions { filter, ..Default::default() });
            got.iter().zip(truth).map(|(a, b)| (a - b).powi(2)).sum::<f32>()
        };
        trilinear_error += error(Filter::Trilinear);
        anisotropic_error += error(Filter::Anisotropic);
    }
    assert!(anisotropic_error < 0.5 * trilinear_error, "{anisotropic_error} against {trilinear_error}");
}

#[test]
fn area_equals_brute_force() {
    let mut random = Random(8);
    let noise = texture(40, 30, 3, |_, _| [random.unit(), random.unit(), random.unit(), 1.0]);
    let size = Vec2::new(40.0, 30.0);
    let mut squares = [0.0_f64; 5];
    for (class, texels) in [0.25_f32, 0.7, 1.0, 2.5, 6.0].into_iter().enumerate() {
        for _ in 0..60 {
            let uv = random_uv(&mut random, 1.0);
            let edge = Vec2::from_angle(random.unit() * 6.3) * texels;
            let edges = [edge / size, edge.perp() * (0.7 + 0.3 * random.unit()) / size];
            let truth = brute_force_area(&noise, uv, edges);
            let got = noise.sample_area(uv, edges, [Wrap::Repeat; 2]);
            for channel in 0..3 {
                squares[class] += f64::from(got[channel] - truth[channel]).powi(2);
            }
        }
    }
    // White noise is the worst case; its standard deviation is 0.29.
    let rms = squares.map(|sum| (sum / 180.0).sqrt());
    eprintln!("rms error of sample_area on white noise: {rms:.4?}");
    assert!(rms.iter().all(|&rms| rms < 0.012), "{rms:?}");
}

fn brute_force_area(texture: &ImageTexture, uv: Vec2, edges: [Vec2; 2]) -> [f32; 4] {
    const SIDE: u32 = 64;
    let mut sum = [0.0; 4];
    for j in 0..SIDE {
        for i in 0..SIDE {
            let at = |k: u32| (k as f32 + 0.5) / SIDE as f32 - 0.5;
            let texel =
                texture.sample_level0_bilinear(uv + edges[0] * at(i) + edges[1] * at(j), [Wrap::Repeat; 2]);
            sum.iter_mut().zip(texel).for_each(|(sum, value)| *sum += value);
        }
    }
    sum.map(|sum| sum / (SIDE * SIDE) as f32)
}

#[test]
fn coarse_area_stays_near_the_truth() {
    let texture = waves(512);
    let mut random = Random(9);
    for _ in 0..20 {
        let uv = random_uv(&mut random, 1.0);
        let edge = Vec2::from_angle(random.unit() * 6.3) * (10.0 + 60.0 * random.unit()) / 512.0;
        let edges = [edge, edge.perp()];
        let truth = brute_force_area(&texture, uv, edges);
        assert_close(texture.sample_area(uv, edges, [Wrap::Repeat; 2]), truth, 0.015, "coarse area");
    }
}

#[test]
fn absurd_arguments_are_survived() {
    let texture = texture(5, 3, 4, |x, y| [x as f32, y as f32, 0.5, 0.5]);
    let absurd = [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, f32::MIN, 1e12, 0.0, 1e-38];
    for u in absurd {
        for v in absurd {
            for filter in FILTERS {
                for wrap in WRAPS {
                    let options = SampleOptions { wrap: [wrap; 2], filter, max_anisotropy: u };
                    let uv = Vec2::new(u, v);
                    texture.sample(uv, [Vec2::ZERO; 2], &options);
                    texture.sample(Vec2::ZERO, [uv, Vec2::ZERO], &options);
                    texture.sample(Vec2::ZERO, [uv, uv.perp()], &options);
                    texture.sample_area(uv, [Vec2::ZERO; 2], options.wrap);
                    texture.sample_area(Vec2::ZERO, [Vec2::ZERO, uv], options.wrap);
                    texture.sample_area_nearest(uv, [uv, Vec2::ZERO], options.wrap);
                }
            }
        }
    }
}
