//! The picture measures on cases whose result is known.

use fantex_texture::compare::{FlipOptions, compare, difference_picture, flip, psnr_db, ssim};
use fantex_texture::{ColorSpace, Image, Samples};

use crate::common::Random;

fn picture(width: u32, height: u32, mut texel: impl FnMut(u32, u32) -> [u8; 3]) -> Image {
    let samples = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y));
    Image { width, height, channels: 3, space: ColorSpace::Srgb, samples: Samples::U8(samples.collect()) }
}

fn noisy(amplitude: i32, seed: u64) -> Image {
    let mut random = Random(seed);
    picture(64, 48, |x, y| {
        let noise = (random.unit() * (2 * amplitude + 1) as f32) as i32 - amplitude;
        let value = 100 + (40.0 * (x as f32 * 0.3).sin() + 30.0 * (y as f32 * 0.2).cos()) as i32;
        [(value + noise).clamp(0, 255) as u8; 3]
    })
}

#[test]
fn equal_pictures_are_equal() {
    let image = noisy(20, 1);
    let result = compare(&image, &image).unwrap();
    assert_eq!(result.psnr_db, f64::INFINITY);
    assert!((result.ssim - 1.0).abs() < 1e-6);
    assert!(result.flip < 1e-6);
}

#[test]
fn psnr_of_a_constant_offset() {
    let (a, b) = (picture(9, 7, |_, _| [100; 3]), picture(9, 7, |_, _| [110; 3]));
    let expected = 20.0 * (255.0_f64 / 10.0).log10();
    assert!((psnr_db(&a, &b).unwrap() - expected).abs() < 1e-3);
    let picture = difference_picture(&a, &b, 4.0).unwrap();
    assert_eq!(picture.samples, Samples::U8(vec![40; 9 * 7 * 3]));
}

#[test]
fn ssim_of_constants_is_the_luminance_term() {
    let (a, b) = (picture(32, 32, |_, _| [51; 3]), picture(32, 32, |_, _| [102; 3]));
    let (x, y, c1) = (0.2_f64, 0.4, 1e-4);
    let expected = (2.0 * x * y + c1) / (x * x + y * y + c1);
    assert!((ssim(&a, &b).unwrap() - expected).abs() < 1e-3);
}

#[test]
fn ssim_of_opposite_patterns_is_negative() {
    let mut random = Random(3);
    let pattern: Vec<u8> = (0..40 * 40).map(|_| 128 + (random.unit() * 80.0) as u8).collect();
    let a = picture(40, 40, |x, y| [pattern[(y * 40 + x) as usize]; 3]);
    let b = picture(40, 40, |x, y| [255 - pattern[(y * 40 + x) as usize]; 3]);
    assert!(ssim(&a, &b).unwrap() < -0.5);
}

#[test]
fn flip_of_black_and_white() {
    // Worked out by hand: distance 100^0.7, largest distance 203.3^0.7 (green against blue), knee at 0.4 of it.
    let (a, b) = (picture(40, 30, |_, _| [0; 3]), picture(40, 30, |_, _| [255; 3]));
    let got = flip(&a, &b, FlipOptions::default()).unwrap();
    assert!((got - 0.9674).abs() < 1e-3, "{got}");
    // Green against blue is the largest distance.
    let (a, b) = (picture(40, 30, |_, _| [0, 255, 0]), picture(40, 30, |_, _| [0, 0, 255]));
    let got = flip(&a, &b, FlipOptions::default()).unwrap();
    assert!((got - 1.0).abs() < 1e-3, "{got}");
}

#[test]
fn measures_grow_with_the_noise_and_are_symmetric() {
    let clean = noisy(0, 1);
    let mut last = (f64::INFINITY, 1.0, 0.0);
    for amplitude in [2, 6, 18, 54] {
        let noisy = noisy(amplitude, 2);
        let result = compare(&clean, &noisy).unwrap();
        let mirrored = compare(&noisy, &clean).unwrap();
        assert!((result.flip - mirrored.flip).abs() < 1e-5 && (result.ssim - mirrored.ssim).abs() < 1e-6);
        assert!(result.psnr_db < last.0 && result.ssim < last.1 && result.flip > last.2, "{result:?}");
        last = (result.psnr_db, result.ssim, result.flip);
    }
}

#[test]
fn fine_noise_is_noticed_less_from_afar() {
    let (a, b) = (noisy(0, 1), noisy(30, 2));
    let near = flip(&a, &b, FlipOptions { pixels_per_degree: 20.0 }).unwrap();
    let far = flip(&a, &b, FlipOptions { pixels_per_degree: 200.0 }).unwrap();
    assert!(far < 0.7 * near, "{far} against {near}");
}

#[test]
fn sizes_must_agree_and_may_be_tiny() {
    let (a, b) = (picture(3, 2, |_, _| [1; 3]), picture(2, 3, |_, _| [1; 3]));
    assert!(compare(&a, &b).unwrap_err().to_string().contains("3 x 2 and 2 x 3"));
    let dot = picture(1, 1, |_, _| [9; 3]);
    assert!(compare(&dot, &dot).unwrap().ssim > 0.999);
}
