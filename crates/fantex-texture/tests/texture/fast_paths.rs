//! Fast paths equal the reference; borders have their colour.

use std::sync::Arc;

use fantex_texture::{
    AREAS_AT_ONCE, AlphaUse, ColorSpace, Depth, Filter, Image, ImageTexture, SampleOptions, Samples, UvPoint,
    Wrap,
};
use glam::Vec2;

use crate::common::{FILTERS, Random, texture};

const WRAPS: [Wrap; 4] = [Wrap::Clamp, Wrap::Border, Wrap::Repeat, Wrap::Mirror];

/// What a fast path may differ by from the reference, of texels in [0,1].
const TOLERANCE: f32 = 1e-4;

fn noise(width: u32, height: u32, channels: u8, depth: Depth, space: ColorSpace) -> Image {
    let mut random = Random(u64::from(channels));
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
    let mut random = Random(1);
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
    assert!(largest.iter().all(|&error| error < TOLERANCE), "{largest:?}");
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
    let mut random = Random(5);
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
                                assert!(error < TOLERANCE, "{filter:?}, {wrap:?}, {point:?}: off by {error}");
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
    let points = points(&mut Random(6), 300, 200);
    for filter in FILTERS {
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
            let is_same = |(a, b): (&f32, f32)| (a - b).abs() < TOLERANCE || a.is_nan() && b.is_nan();
            assert!(got.iter().zip(wanted).all(is_same), "{filter:?} {point:?}: {got:?}, {wanted:?}");
        }
    }
}

#[test]
fn many_means_at_once_equal_single_ones() {
    let mut random = Random(8);
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
    let mut random = Random(2);
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
    let mut random = Random(3);
    for (channels, border) in
        [(3, [0.9, 0.2, 0.4, 1.0]), (4, [0.1, 0.8, 0.3, 0.6]), (4, [0.3, 0.2, 0.1, 0.0])]
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
        for filter in FILTERS {
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
    let mut random = Random(4);
    for _ in 0..200 {
        let uv = Vec2::new(random.unit(), random.unit());
        let footprint = [Vec2::X * random.unit(), Vec2::Y * random.unit()];
        for filter in FILTERS {
            let options = SampleOptions { filter, ..SampleOptions::default() };
            let [a, b] = [&opaque, &with_alpha].map(|texture| texture.sample(uv, footprint, &options));
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6), "{filter:?}: {a:?}, {b:?}");
        }
    }
}
