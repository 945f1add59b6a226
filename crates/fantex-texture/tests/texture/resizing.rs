//! Images of another size.

use fantex_texture::{AlphaUse, ColorSpace, Depth, Image, Samples};

use crate::common::{Random, assert_close};

fn noise(width: u32, height: u32, channels: u8) -> Image {
    let mut random = Random(7);
    let count = width * height * u32::from(channels);
    Image::from_linear(width, height, channels, (0..count).map(|_| random.unit()).collect())
}

/// The mean over a rectangle of square texels, by hand.
fn mean(image: &Image, x: [f64; 2], y: [f64; 2]) -> f64 {
    let overlap = |texel: u32, [from, to]: [f64; 2]| {
        (to.min(f64::from(texel + 1)) - from.max(f64::from(texel))).max(0.0)
    };
    let mut sum = 0.0;
    for row in 0..image.height {
        for column in 0..image.width {
            let value = f64::from(image.linear_texel(column, row)[0]);
            sum += value * overlap(column, x) * overlap(row, y);
        }
    }
    sum / ((x[1] - x[0]) * (y[1] - y[0]))
}

#[test]
fn smaller_texels_are_exact_means() {
    let image = noise(23, 17, 3);
    for (width, height) in [(22, 16), (10, 17), (7, 3), (1, 1), (23, 5)] {
        let small = image.resized(width, height, AlphaUse::Independent);
        assert_eq!((small.width, small.height, small.channels), (width, height, 3));
        for y in 0..height {
            for x in 0..width {
                let [columns, rows] = [(x, 23.0, width), (y, 17.0, height)]
                    .map(|(i, old, new)| [i, i + 1].map(|i| f64::from(i) * old / f64::from(new)));
                let truth = mean(&image, columns, rows);
                let got = f64::from(small.linear_texel(x, y)[0]);
                assert!((got - truth).abs() < 1e-5, "{width} x {height}, {x},{y}: {got} against {truth}");
            }
        }
    }
}

#[test]
fn larger_images_continue_ramps() {
    let ramp = |x: f32, y: f32| [0.1 + 0.02 * x, 0.8 - 0.03 * y, 0.3 + 0.001 * x * x, 1.0];
    let texels: Vec<[f32; 4]> =
        (0..16 * 12).map(|i| ramp((i % 16) as f32 + 0.5, (i / 16) as f32 + 0.5)).collect();
    let large = Image::from_linear_rgb(16, 12, &texels).resized(40, 31, AlphaUse::Coverage);
    for y in 6..25 {
        for x in 6..34 {
            let expected = ramp((x as f32 + 0.5) * 16.0 / 40.0, (y as f32 + 0.5) * 12.0 / 31.0);
            // A cubic of Catmull and Rom reproduces parabolas sampled at points.
            assert_close(large.linear_texel(x, y), expected, 2e-5, "ramp");
        }
    }
    // One axis up, the other down.
    let mixed = Image::from_linear_rgb(16, 12, &texels).resized(32, 6, AlphaUse::Coverage);
    assert_close(mixed.linear_texel(12, 3), ramp(6.25, 7.0), 1e-3, "mixed");
}

#[test]
fn light_is_averaged_and_transparent_texels_do_not_bleed() {
    let grey = Image {
        width: 2,
        height: 1,
        channels: 1,
        space: ColorSpace::Srgb,
        samples: Samples::U8(vec![0, 255]),
    };
    assert_eq!(grey.resized(1, 1, AlphaUse::Coverage).samples, Samples::U8(vec![188]));
    let edge = Image { channels: 4, samples: Samples::U8(vec![255, 0, 0, 255, 0, 255, 0, 0]), ..grey };
    assert_eq!(edge.resized(1, 1, AlphaUse::Coverage).samples, Samples::U8(vec![255, 0, 0, 128]));
    assert_eq!(edge.resized(1, 1, AlphaUse::Independent).samples, Samples::U8(vec![188, 188, 0, 128]));
}

#[test]
fn powers_of_two_keep_kind_and_content() {
    for channels in 1..=4 {
        let image = noise(11, 6, channels).converted(Depth::U16, ColorSpace::Srgb);
        let power = image.to_power_of_two(AlphaUse::Independent);
        assert_eq!((power.width, power.height, power.channels), (8, 8, channels));
        assert_eq!((power.samples.depth(), power.space), (Depth::U16, ColorSpace::Srgb));
    }
    let image = noise(8, 4, 3);
    assert_eq!(image.to_power_of_two(AlphaUse::Coverage), image);
}
