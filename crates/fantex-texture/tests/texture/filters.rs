//! Properties of the filters.

use std::sync::Arc;

use fantex_texture::{
    AREAS_AT_ONCE, AlphaUse, ColorSpace, Depth, Filter, Image, ImageTexture, SampleOptions, Samples, UvPoint,
    Wrap, color,
};
use glam::Vec2;

use crate::common::{Random, assert_close, texture};

const WRAPS: [Wrap; 4] = [Wrap::Clamp, Wrap::Border, Wrap::Repeat, Wrap::Mirror];

fn random_uv(random: &mut Random, range: f32) -> Vec2 {
    Vec2::new(random.unit() - 0.5, random.unit() - 0.5) * 2.0 * range
}

#[test]
fn constants_stay_constant() {
    let color = [0.25, 0.5, 0.125, 1.0];
    let mut random = Random::new(1);
    for (width, height) in [(1, 1), (7, 1), (5, 9), (64, 33)] {
        let texture = texture(width, height, 3, |_, _| color);
        for _ in 0..200 {
            let uv = random_uv(&mut random, 3.0);
            let scale = 4.0_f32.powf(random.unit() * 6.0 - 5.0);
            let footprint = [random_uv(&mut random, scale), random_uv(&mut random, scale)];
            for filter in Filter::ALL {
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
    let mut random = Random::new(2);
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
fn bicubic_mipmaps_are_bicubic_values_of_two_levels() {
    let fine = texture(64, 32, 4, {
        let mut random = Random::new(3);
        let texels: Vec<[f32; 4]> = (0..64 * 32).map(|_| std::array::from_fn(|_| random.unit())).collect();
        move |x, y| texels[(y * 64 + x) as usize]
    });
    let levels: Vec<ImageTexture> =
        (0..fine.level_count()).map(|level| ImageTexture::new(Arc::new(fine.level(level).clone()))).collect();
    let mut random = Random::new(4);
    for _ in 0..500 {
        let uv = random_uv(&mut random, 2.0);
        let width = 4.0 * random.unit();
        // Squares of `width` texels, turned.
        let (sin, cos) = (6.0 * random.unit()).sin_cos();
        let steps =
            [Vec2::new(cos, sin), Vec2::new(-sin, cos)].map(|step| step * width / Vec2::new(64.0, 32.0));
        let got =
            fine.sample(uv, steps, &SampleOptions { filter: Filter::BicubicMipmaps, ..Default::default() });
        let level = width.max(1.0).log2();
        let cubic = SampleOptions { filter: Filter::Bicubic, ..Default::default() };
        let at = |level: f32| levels[level as usize].sample(uv, [Vec2::ZERO; 2], &cubic);
        let (near, far) = (at(level.floor()), at(level.floor() + 1.0));
        let share = level.fract();
        // Colours are weighted by alpha before they are blended.
        let alpha = near[3] + (far[3] - near[3]) * share;
        assert!((got[3] - alpha).abs() < 1e-4, "alpha {} for {alpha}", got[3]);
        for channel in 0..3 {
            let weighted = near[channel] * near[3] * (1.0 - share) + far[channel] * far[3] * share;
            assert!((got[channel] * got[3] - weighted).abs() < 1e-4, "at {uv}, width {width}");
        }
    }
}

#[test]
fn every_filter_but_ewa_interpolates_texel_centers() {
    let mut random = Random::new(3);
    let texture = texture(6, 5, 3, |_, _| [random.unit(), random.unit(), random.unit(), 1.0]);
    for y in 0..5 {
        for x in 0..6 {
            let uv = Vec2::new((x as f32 + 0.5) / 6.0, (y as f32 + 0.5) / 5.0);
            for filter in &Filter::ALL[..6] {
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
    let mut random = Random::new(4);
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
    let mut random = Random::new(5);
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
    for filter in Filter::ALL {
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
        for filter in Filter::ALL {
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
    let mut random = Random::new(6);
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
    let mut random = Random::new(7);
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
    let mut random = Random::new(8);
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
    let mut random = Random::new(9);
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
            for filter in Filter::ALL {
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

// ---- Fast paths equal the reference; borders have their colour.

/// What a fast path may differ by from the reference, of texels in [0,1].
const MAX_ERROR: f32 = 1e-4;

fn noise(width: u32, height: u32, channels: u8, depth: Depth, space: ColorSpace) -> Image {
    let mut random = Random::new(u64::from(channels));
    let count = width as usize * height as usize * usize::from(channels);
    let samples = match depth {
        Depth::U8 => Samples::U8((0..count).map(|_| random.bits() as u8).collect()),
        Depth::U16 => Samples::U16((0..count).map(|_| random.bits() as u16).collect()),
        Depth::F32 => Samples::F32((0..count).map(|_| random.unit()).collect()),
    };
    Image { width, height, channels, space, samples }
}

#[test]
fn fast_paths_equal_the_reference() {
    let mut random = Random::new(1);
    let mut largest = [0.0_f32; 3];
    for (depth, space) in [
        (Depth::U8, ColorSpace::Srgb),
        (Depth::U8, ColorSpace::Linear),
        (Depth::U16, ColorSpace::Srgb),
        (Depth::F32, ColorSpace::Linear),
    ] {
        for channels in 1..=4 {
            for (width, height) in [(1, 1), (1, 7), (2, 2), (64, 48), (257, 130)] {
                let image = Arc::new(noise(width, height, channels, depth, space));
                for alpha in [AlphaUse::Coverage, AlphaUse::Independent] {
                    let texture = ImageTexture::with_alpha_use(Arc::clone(&image), alpha);
                    for _ in 0..150 {
                        let uv = Vec2::new(random.unit(), random.unit()) * 4.0 - 1.5;
                        let major = 2.0_f32.powf(random.unit() * 9.0 - 2.0) / width.max(height) as f32;
                        let axis = Vec2::from_angle(random.unit() * 6.3) * major;
                        let footprint = [axis, axis.perp() * random.unit()];
                        let wrap = [WRAPS[random.bits() as usize % 4], WRAPS[random.bits() as usize % 4]];
                        for (index, filter) in
                            [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic].into_iter().enumerate()
                        {
                            let options = SampleOptions { wrap, filter, max_anisotropy: 16.0 };
                            let got = texture.sample(uv, footprint, &options);
                            let wanted = texture.sample_by_reference(uv, footprint, &options);
                            for (got, wanted) in got.into_iter().zip(wanted) {
                                largest[index] = largest[index].max((got - wanted).abs());
                            }
                        }
                    }
                }
            }
        }
    }
    eprintln!("largest difference to the reference: bilinear, trilinear, anisotropic {largest:?}");
    assert!(largest.iter().all(|&error| error < MAX_ERROR), "{largest:?}");
}

/// Points in and around the image, with footprints from a fraction of a texel to the whole image.
fn points(random: &mut Random, count: usize, side: u32) -> Vec<UvPoint> {
    let point = |random: &mut Random| {
        let major = 2.0_f32.powf(random.unit() * 9.0 - 2.0) / side as f32;
        let axis = Vec2::from_angle(random.unit() * 6.3) * major;
        let uv = Vec2::new(random.unit(), random.unit()) * 4.0 - 1.5;
        UvPoint { uv, steps: [axis, axis.perp() * random.unit()] }
    };
    (0..count).map(|_| point(random)).collect()
}

#[test]
fn many_look_ups_at_once_equal_the_reference() {
    let mut random = Random::new(5);
    let mut largest = [0.0_f32; 3];
    for (depth, space) in [
        (Depth::U8, ColorSpace::Srgb),
        (Depth::U8, ColorSpace::Linear),
        (Depth::U16, ColorSpace::Srgb),
        (Depth::U16, ColorSpace::Linear),
        (Depth::F32, ColorSpace::Linear),
    ] {
        for channels in 1..=4 {
            for (width, height) in [(1, 1), (1, 7), (2, 2), (3, 500), (64, 48), (257, 130)] {
                let image = Arc::new(noise(width, height, channels, depth, space));
                for alpha in [AlphaUse::Coverage, AlphaUse::Independent] {
                    let texture = ImageTexture::with_alpha_use(Arc::clone(&image), alpha);
                    // Blocks that are full, and that are not.
                    let points = points(&mut random, 64 + 37, width.max(height));
                    let mut got = vec![[f32::NAN; 4]; points.len()];
                    let wrap = [WRAPS[random.bits() as usize % 4], WRAPS[random.bits() as usize % 4]];
                    for (index, filter) in
                        [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic].into_iter().enumerate()
                    {
                        let options = SampleOptions { wrap, filter, max_anisotropy: 16.0 };
                        texture.sample_all(&points, &options, &mut got);
                        for (point, got) in points.iter().zip(&got) {
                            let wanted = texture.sample_by_reference(point.uv, point.steps, &options);
                            for (got, wanted) in got.iter().zip(wanted) {
                                let error = (got - wanted).abs();
                                assert!(error < MAX_ERROR, "{filter:?}, {wrap:?}, {point:?}: off by {error}");
                                largest[index] = largest[index].max(error);
                            }
                        }
                    }
                }
            }
        }
    }
    eprintln!("largest difference to the reference: bilinear, trilinear, anisotropic {largest:?}");
}

#[test]
fn it_does_not_matter_which_look_ups_are_made_together() {
    let texture = ImageTexture::new(Arc::new(noise(200, 100, 4, Depth::U8, ColorSpace::Srgb)));
    let points = points(&mut Random::new(6), 300, 200);
    for filter in Filter::ALL {
        let options = SampleOptions { filter, ..SampleOptions::default() };
        let mut together = vec![[0.0; 4]; points.len()];
        texture.sample_all(&points, &options, &mut together);
        for size in [4, 17, 100] {
            let mut apart = vec![[0.0; 4]; points.len()];
            for (points, out) in points.chunks(size).zip(apart.chunks_mut(size)) {
                texture.sample_all(points, &options, out);
            }
            assert_eq!(apart, together, "{filter:?}, {size} at once");
        }
    }
}

#[test]
fn many_look_ups_of_no_numbers_give_what_single_ones_give() {
    let texture = ImageTexture::new(Arc::new(noise(32, 32, 3, Depth::U8, ColorSpace::Srgb)));
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -f32::MAX, 0.0];
    let points: Vec<UvPoint> = odd
        .iter()
        .flat_map(|&a| odd.iter().map(move |&b| Vec2::new(a, b)))
        .flat_map(|v| {
            let inside = Vec2::splat(0.4);
            [UvPoint { uv: v, steps: [Vec2::splat(0.01); 2] }, UvPoint { uv: inside, steps: [v, inside] }]
        })
        .collect();
    for filter in [Filter::Bilinear, Filter::Trilinear] {
        let options = SampleOptions { filter, ..SampleOptions::default() };
        let mut got = vec![[0.0; 4]; points.len()];
        texture.sample_all(&points, &options, &mut got);
        for (point, got) in points.iter().zip(got) {
            let wanted = texture.sample(point.uv, point.steps, &options);
            let is_same = |(a, b): (&f32, f32)| (a - b).abs() < MAX_ERROR || a.is_nan() && b.is_nan();
            assert!(got.iter().zip(wanted).all(is_same), "{filter:?} {point:?}: {got:?}, {wanted:?}");
        }
    }
}

#[test]
fn many_means_at_once_equal_single_ones() {
    let mut random = Random::new(8);
    let mut largest = 0.0_f32;
    for (depth, space) in
        [(Depth::U8, ColorSpace::Srgb), (Depth::U8, ColorSpace::Linear), (Depth::U16, ColorSpace::Srgb)]
    {
        for channels in 1..=4 {
            for (width, height) in [(1, 1), (3, 3), (2, 40), (64, 48), (257, 130)] {
                let image = Arc::new(noise(width, height, channels, depth, space));
                for alpha in [AlphaUse::Coverage, AlphaUse::Independent] {
                    let texture = ImageTexture::with_alpha_use(Arc::clone(&image), alpha);
                    for texels in [0.1, 0.7, 1.0, 1.4, 2.0, 5.0] {
                        let axis = Vec2::from_angle(random.unit() * 6.3) * texels;
                        let size = Vec2::new(width as f32, height as f32);
                        let edges = [axis / size, axis.perp() * (0.5 + random.unit()) / size];
                        let wrap = [WRAPS[random.bits() as usize % 4], WRAPS[random.bits() as usize % 4]];
                        let sampler = texture.area_sampler(edges, wrap);
                        let count = 1 + random.bits() as usize % AREAS_AT_ONCE;
                        let point = |_| Vec2::new(random.unit(), random.unit()) * 4.0 - 1.5;
                        let points: Vec<Vec2> = (0..count).map(point).collect();
                        let mut got = vec![[f32::NAN; 4]; count];
                        sampler.sample_areas(&sampler.areas(&points), &mut got);
                        for (&point, got) in points.iter().zip(&got) {
                            for (got, wanted) in got.iter().zip(sampler.sample(point)) {
                                largest = largest.max((got - wanted).abs());
                            }
                        }
                    }
                }
            }
        }
    }
    eprintln!("largest difference of means: {largest}");
    assert!(largest < 1e-5);
}

#[test]
fn large_images_are_looked_up_precisely() {
    // A ramp over 8192 columns: the value tells where the look-up was.
    let samples = (0..8192 * 4).map(|i| (i % 8192) as f32).collect();
    let ramp = ImageTexture::new(Arc::new(Image::from_linear(8192, 4, 1, samples)));
    let mut random = Random::new(2);
    for _ in 0..2000 {
        let x = 1.0 + random.unit() * 8189.0;
        let uv = Vec2::new((x + 0.5) / 8192.0, 0.5);
        for filter in [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic] {
            let options = SampleOptions { wrap: [Wrap::Clamp; 2], filter, ..SampleOptions::default() };
            let got = ramp.sample(uv, [Vec2::X * 0.5 / 8192.0, Vec2::Y * 0.1], &options)[0];
            assert!((got - x).abs() < 2e-3, "{filter:?} at {x}: {got}");
        }
    }
}

/// A border's colour is what an image would give that is continued with that colour.
#[test]
fn borders_have_their_color() {
    let (width, height) = (6_u32, 5_u32);
    let mut random = Random::new(3);
    for (channels, border) in
        [(3, [0.9, 0.2, 0.4, 1.0]), (3, [0.0; 4]), (4, [0.1, 0.8, 0.3, 0.6]), (4, [0.3, 0.2, 0.1, 0.0])]
    {
        let source: Vec<[f32; 4]> = (0..width * height)
            .map(|_| {
                let alpha = if channels == 4 { random.unit() } else { 1.0 };
                [random.unit(), random.unit(), random.unit(), alpha]
            })
            .collect();
        let small =
            texture(width, height, channels, |x, y| source[(y * width + x) as usize]).with_border(border);
        let large = texture(5 * width, 5 * height, 4, |x, y| {
            let inside = (2 * width..3 * width).contains(&x) && (2 * height..3 * height).contains(&y);
            if inside { source[((y - 2 * height) * width + x - 2 * width) as usize] } else { border }
        });
        for _ in 0..400 {
            let uv = Vec2::new(random.unit(), random.unit()) * 2.6 - 0.8;
            let edges = [Vec2::new(0.2, 0.1), Vec2::new(-0.05, 0.2)];
            let large_edges = edges.map(|edge| edge / 5.0);
            let large_uv = (uv + 2.0) / 5.0;
            for filter in [Filter::Bilinear, Filter::Bicubic] {
                let options = |wrap| SampleOptions { wrap: [wrap; 2], filter, ..SampleOptions::default() };
                let got = small.sample(uv, edges, &options(Wrap::Border));
                let wanted = large.sample(large_uv, large_edges, &options(Wrap::Clamp));
                assert_same(got, wanted, &format!("{filter:?} at {uv}"));
            }
            let got = small.sample_area(uv, edges, [Wrap::Border; 2]);
            let wanted = large.sample_area(large_uv, large_edges, [Wrap::Clamp; 2]);
            assert_same(got, wanted, &format!("area at {uv}"));
        }
        // Far outside, all filters see nothing else.
        for filter in Filter::ALL {
            let options = SampleOptions { wrap: [Wrap::Border; 2], filter, ..SampleOptions::default() };
            let got = small.sample(Vec2::new(-3.0, 4.0), [Vec2::X * 0.3, Vec2::Y * 0.3], &options);
            assert_same(got, border, &format!("{filter:?} outside"));
        }
    }
}

/// Colours with their alpha: those of nearly transparent values mean nothing.
fn assert_same(got: [f32; 4], wanted: [f32; 4], what: &str) {
    let weight = wanted[3].max(0.0);
    for channel in 0..4 {
        let factor = if channel == 3 { 1.0 } else { weight };
        let error = (got[channel] - wanted[channel]).abs() * factor;
        assert!(error < 2e-3, "{what}: got {got:?}, expected {wanted:?}");
    }
}

#[test]
fn opaque_images_need_no_weights() {
    let mut image = noise(32, 16, 4, Depth::U8, ColorSpace::Srgb);
    if let Samples::U8(values) = &mut image.samples {
        values.iter_mut().skip(3).step_by(4).for_each(|alpha| *alpha = 255);
    }
    let rgb = match &image.samples {
        Samples::U8(values) => values.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
        _ => Vec::new(),
    };
    let opaque = ImageTexture::new(Arc::new(Image { channels: 3, samples: Samples::U8(rgb), ..image }));
    let with_alpha = ImageTexture::new(Arc::new(image));
    let mut random = Random::new(4);
    for _ in 0..200 {
        let uv = Vec2::new(random.unit(), random.unit());
        let footprint = [Vec2::X * random.unit(), Vec2::Y * random.unit()];
        for filter in Filter::ALL {
            let options = SampleOptions { filter, ..SampleOptions::default() };
            let [a, b] = [&opaque, &with_alpha].map(|texture| texture.sample(uv, footprint, &options));
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{filter:?}: {a:?}, {b:?}");
        }
    }
}

// ---- A plane of checks to the horizon.

const SIDE: u32 = 256;
/// Row of the horizon; the first row looked at is the first whose filter does not reach above it.
const HORIZON: u32 = 64;
/// Focal length in pixels.
const FOCAL: f32 = 256.0;
/// Coordinates per unit of length, one being the height of the eye: two texels per pixel at the lower edge.
const UV_PER_UNIT: f32 = 0.4;

/// Where the ray through a point of the picture meets the plane, with its derivatives per pixel.
fn on_plane(x: f32, y: f32) -> (Vec2, [Vec2; 2]) {
    let depth = FOCAL / (y - HORIZON as f32);
    let across = (x - 0.5 * SIDE as f32) / FOCAL;
    let along_y = Vec2::new(across, 1.0) * (-depth * depth / FOCAL);
    let scaled = |v: Vec2| v * UV_PER_UNIT;
    (scaled(Vec2::new(across, 1.0) * depth), [scaled(Vec2::X * depth / FOCAL), scaled(along_y)])
}

/// Squares of 64 texels, eight steps of grey apart from black and white.
fn checks() -> ImageTexture {
    let texels = (0..1024 * 1024_u32).map(|i| if (i / 64 + i / (1024 * 64)) % 2 == 0 { 8 } else { 247 });
    let samples = Samples::U8(texels.collect());
    let image = Image { width: 1024, height: 1024, channels: 1, space: ColorSpace::Linear, samples };
    ImageTexture::new(Arc::new(image))
}

/// The pixel by the Gaussian that `Ewa` stands for, and the mean over its square, by jittered samples of the bilinear reconstruction
/// (`n * n` for the Gaussian).
fn supersampled(texture: &ImageTexture, x: f32, y: f32, n: u32, random: &mut Random) -> [f32; 2] {
    let (mut sums, mut totals) = ([0.0; 2], [0.0; 2]);
    for cell in 0..n * n {
        let [a, b] = [cell % n, cell / n].map(|k| 2.0 * (k as f32 + random.unit()) / n as f32 - 1.0);
        let squared_radius = a * a + b * b;
        let gaussian =
            if squared_radius < 1.0 { (-2.0 * squared_radius).exp() - (-2.0_f32).exp() } else { 0.0 };
        let square = if a.abs().max(b.abs()) < 0.5 { 1.0 } else { 0.0 };
        if gaussian == 0.0 && square == 0.0 {
            continue;
        }
        let (uv, _) = on_plane(x + a, y + b);
        let value = texture.sample_level0_bilinear(uv, [Wrap::Repeat; 2])[0];
        for (k, weight) in [gaussian, square].into_iter().enumerate() {
            sums[k] += weight * value;
            totals[k] += weight;
        }
    }
    [0, 1].map(|k| sums[k] / totals[k])
}

/// `Ewa` shows pixels that overlap as Gaussians, `Anisotropic` means over the squares of pixels: sharper, with more moire.
#[test]
fn filters_show_the_truth_up_to_the_horizon() {
    let texture = checks();
    let mut random = Random::new(1);
    let mut squares = [[0.0_f64; 2]; Filter::ALL.len()];
    let mut count = 0;
    for row in HORIZON + 1..SIDE {
        for column in 0..SIDE {
            let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
            let (uv, footprint) = on_plane(x, y);
            // At least 256 samples within the filter; more where a pixel sees many squares.
            let n = if footprint[1].length() > 0.2 { 64 } else { 24 };
            let truth = supersampled(&texture, x, y, n, &mut random);
            for (filter, squares) in Filter::ALL.into_iter().zip(&mut squares) {
                let options = SampleOptions { filter, max_anisotropy: 64.0, ..SampleOptions::default() };
                let got = texture.sample(uv, footprint, &options)[0];
                for (sum, truth) in squares.iter_mut().zip(truth) {
                    *sum += f64::from(got - truth).powi(2);
                }
            }
            count += 1;
        }
    }
    let rms = squares.map(|sums| sums.map(|sum| 255.0 * (sum / f64::from(count)).sqrt()));
    for (filter, [gaussian, square]) in Filter::ALL.into_iter().zip(rms) {
        eprintln!(
            "plane to the horizon, {filter:?}: {gaussian:.2} / 255 rms of Gaussians, {square:.2} of squares"
        );
    }
    let [nearest, bilinear, bicubic, bicubic_mipmaps, trilinear, anisotropic, ewa] =
        rms.map(|[gaussian, _]| gaussian);
    assert!(ewa < 1.5, "EWA is off by {ewa} / 255");
    assert!(ewa < anisotropic && anisotropic < trilinear, "{rms:?}");
    assert!(anisotropic < nearest && anisotropic < bilinear, "{rms:?}");
    assert!(bicubic_mipmaps < 1.2 * trilinear && bicubic_mipmaps < 0.5 * bicubic, "{rms:?}");
    let [.., [_, anisotropic], [_, ewa]] = rms;
    assert!(anisotropic < 3.0 && anisotropic < ewa, "{rms:?}");
}

#[test]
fn a_block_of_look_ups_is_a_whole_number_of_vectors() {
    assert_eq!(fantex_texture::filter::GRID_LOOK_UPS % 16, 0);
}

mod footprint {
    use fantex_texture::filter::FootprintAxes;
    use glam::Vec2;

    #[test]
    fn axes_of_a_rotated_rectangle() {
        let (sin, cos) = 0.7_f32.sin_cos();
        let long = Vec2::new(cos, sin);
        let axes = FootprintAxes::new(long.perp() * 2.0, long * 5.0);
        assert!((axes.major - 5.0).abs() < 1e-5 && (axes.minor - 2.0).abs() < 1e-5);
        assert!(axes.direction.perp_dot(long).abs() < 1e-5);
    }

    #[test]
    fn either_axis_alone_is_the_same() {
        for (dx, dy) in [((3.0, 1.0), (-2.0, 0.5)), ((0.0, 0.0), (1.0, 7.0)), ((1e4, 2.0), (1e-3, 1e4))] {
            let (dx, dy) = (Vec2::from(dx), Vec2::from(dy));
            let (squared, axes) = (FootprintAxes::squared_major(dx, dy), FootprintAxes::new(dx, dy));
            assert!((squared.sqrt() - axes.major).abs() < 1e-6 * axes.major);
            for anisotropy in [0.5, 1.0, 3.0, 64.0, 1e3] {
                let alone = FootprintAxes::squared_limited_minor(dx, dy, anisotropy).sqrt();
                assert!((alone - axes.limited_minor(anisotropy)).abs() < 1e-6 * axes.major, "{anisotropy}");
            }
        }
    }

    #[test]
    fn axes_of_nothing_and_of_a_line() {
        let point = FootprintAxes::new(Vec2::ZERO, Vec2::ZERO);
        assert_eq!((point.major, point.minor), (0.0, 0.0));
        let line = FootprintAxes::new(Vec2::new(3.0, 4.0), Vec2::ZERO);
        assert!((line.major - 5.0).abs() < 1e-5 && line.minor == 0.0);
        assert!((line.limited_minor(10.0) - 0.5).abs() < 1e-6);
    }
}

mod mipmap {
    use fantex_texture::filter::halved_level;

    #[test]
    fn odd_rows_end_with_what_lies_beyond() {
        let sum = |four: [u32; 4]| four.into_iter().sum();
        let texels = [1, 2, 3, 10, 20, 30, 100, 200, 300];
        assert_eq!(halved_level(3, &texels, 1000, sum), [33, 2033, 2300, 3300]);
    }
}
