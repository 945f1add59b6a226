//! A plane of checks to the horizon.

use std::sync::Arc;

use fantex_texture::{ColorSpace, Image, ImageTexture, SampleOptions, Samples, Wrap};
use glam::Vec2;

use crate::common::{FILTERS, Random};

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

/// The pixel's Gaussian by `n * n` jittered samples of the bilinear reconstruction.
fn supersampled(texture: &ImageTexture, x: f32, y: f32, n: u32, random: &mut Random) -> f32 {
    let (mut sum, mut total) = (0.0, 0.0);
    for cell in 0..n * n {
        let [a, b] = [cell % n, cell / n].map(|k| 2.0 * (k as f32 + random.unit()) / n as f32 - 1.0);
        let squared_radius = a * a + b * b;
        if squared_radius < 1.0 {
            let weight = (-2.0 * squared_radius).exp() - (-2.0_f32).exp();
            let (uv, _) = on_plane(x + a, y + b);
            sum += weight * texture.sample_level0_bilinear(uv, [Wrap::Repeat; 2])[0];
            total += weight;
        }
    }
    sum / total
}

#[test]
fn ewa_is_the_truth_up_to_the_horizon() {
    let texture = checks();
    let mut random = Random(1);
    let mut squares = [0.0_f64; FILTERS.len()];
    let mut count = 0;
    for row in HORIZON + 1..SIDE {
        for column in 0..SIDE {
            let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
            let (uv, footprint) = on_plane(x, y);
            // At least 256 samples within the filter; more where a pixel sees many squares.
            let n = if footprint[1].length() > 0.2 { 64 } else { 24 };
            let truth = supersampled(&texture, x, y, n, &mut random);
            for (filter, squares) in FILTERS.into_iter().zip(&mut squares) {
                let options = SampleOptions { filter, max_anisotropy: 64.0, ..SampleOptions::default() };
                let got = texture.sample(uv, footprint, &options)[0];
                *squares += f64::from(got - truth).powi(2);
            }
            count += 1;
        }
    }
    let rms = squares.map(|sum| 255.0 * (sum / f64::from(count)).sqrt());
    for (filter, rms) in FILTERS.into_iter().zip(rms) {
        eprintln!("plane to the horizon, {filter:?}: {rms:.2} / 255 rms");
    }
    let [nearest, bilinear, _, trilinear, anisotropic, ewa] = rms;
    assert!(ewa < 1.5, "EWA is off by {ewa} / 255");
    assert!(ewa < anisotropic && anisotropic < trilinear, "{rms:?}");
    assert!(anisotropic < nearest && anisotropic < bilinear, "{rms:?}");
}
