//! How fast images are looked up: one thread, 4096 x 4096 texels of RGBA bytes.
//!
//! Coherent look-ups walk along slanted rows, a footprint at a time, as a picture does; random ones are spread over the
//! image. Both are made one by one (`ImageTexture::sample`) and many at once (`ImageTexture::sample_all`). What a look-up cannot beat when it is random is the time of a random cache line, which is measured in the same run.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use fantex::base::random::nth_random;
use fantex::glam::Vec2;
use fantex::texture::{ColorSpace, Filter, Image, ImageTexture, SampleOptions, Samples, UvPoint};

use crate::{Measured, Row, SEED};

const SIDE: u32 = 4096;
/// Look-ups of one measurement, and measurements; the fastest counts.
const LOOK_UPS: u32 = 20_000;
const MEASUREMENTS: u32 = 60;
/// Look-ups of one call where many are made at once.
const AT_ONCE: usize = 250;

/// The rows of a table: nanoseconds per look-up.
pub(crate) fn rows() -> Measured {
    let seed = SEED;
    let texture = ImageTexture::new(Arc::new(noise(seed)));
    let mut rows = vec![Row::new("random cache line of 128 MB", cache_line(seed), "ns")];
    let wide = footprint(1.5, 1.5);
    let long = footprint(12.0, 1.5);
    let measured = |name: &str, filter, steps, is_random, is_many: bool| {
        let options = SampleOptions { filter, ..SampleOptions::default() };
        let nanoseconds = if is_many {
            fastest_look_ups(seed, is_random, steps, |points, out| texture.sample_all(points, &options, out))
        } else {
            fastest_look_up(seed, is_random, |uv| texture.sample(uv, steps, &options)[0])
        };
        let kind = if is_many { "look-ups, many at once" } else { "look-up" };
        Row::new(format!("{kind}, {name}"), nanoseconds, "ns")
    };
    for (name, filter, steps, is_random, is_many) in [
        ("nearest", Filter::Nearest, wide, false, false),
        ("bilinear", Filter::Bilinear, wide, false, false),
        ("bicubic", Filter::Bicubic, wide, false, false),
        ("trilinear", Filter::Trilinear, wide, false, false),
        ("trilinear, random", Filter::Trilinear, wide, true, false),
        ("anisotropic 8:1", Filter::Anisotropic, long, false, false),
        ("EWA 8:1", Filter::Ewa, long, false, false),
        ("bilinear", Filter::Bilinear, wide, false, true),
        ("bilinear, random", Filter::Bilinear, wide, true, true),
        ("trilinear", Filter::Trilinear, wide, false, true),
        ("trilinear, random", Filter::Trilinear, wide, true, true),
        ("anisotropic 8:1", Filter::Anisotropic, long, false, true),
        ("anisotropic 8:1, random", Filter::Anisotropic, long, true, true),
    ] {
        rows.push(measured(name, filter, steps, is_random, is_many));
    }
    let options = SampleOptions { filter: Filter::Trilinear, ..SampleOptions::default() };
    let scalar = fastest_look_up(seed, false, |uv| texture.sample_by_reference(uv, wide, &options)[0]);
    rows.push(Row::new("look-up, trilinear, scalar reference", scalar, "ns"));
    for texels in [0.4, 1.0, 2.0] {
        let sampler = texture.area_sampler(footprint(texels, texels), options.wrap);
        let nanoseconds = fastest_look_up(seed, false, |uv| sampler.sample(uv)[0]);
        rows.push(Row::new(format!("look-up, mean over {texels} x {texels} texels"), nanoseconds, "ns"));
    }
    Ok(rows)
}

/// The change of uv under a slanted footprint with these axes in texels.
fn footprint(major: f32, minor: f32) -> [Vec2; 2] {
    let axis = Vec2::from_angle(0.4) / SIDE as f32;
    [axis * major, axis.perp() * minor]
}

fn noise(seed: u64) -> Image {
    let texels = (0..u64::from(SIDE) * u64::from(SIDE) / 2).flat_map(|index| {
        // Opaque, as pictures are.
        let [a, b, c, _, d, e, f, _] = nth_random(seed, index).to_le_bytes();
        [a, b, c, 255, d, e, f, 255]
    });
    Image {
        width: SIDE,
        height: SIDE,
        channels: 4,
        space: ColorSpace::Srgb,
        samples: Samples::U8(texels.collect()),
    }
}

/// Nanoseconds of a look-up, the cost of making its coordinates included.
fn fastest_look_up(seed: u64, is_random: bool, look_up: impl Fn(Vec2) -> f32) -> f64 {
    fastest(|measurement| {
        (0..LOOK_UPS).map(|index| look_up(coordinates(seed, is_random, measurement, index))).sum()
    })
}

/// The same where many are made at once.
fn fastest_look_ups(
    seed: u64,
    is_random: bool,
    steps: [Vec2; 2],
    look_up: impl Fn(&[UvPoint], &mut [[f32; 4]]),
) -> f64 {
    let mut points = [UvPoint { uv: Vec2::ZERO, steps }; AT_ONCE];
    let mut colors = [[0.0; 4]; AT_ONCE];
    fastest(|measurement| {
        let mut sum = 0.0;
        for first in (0..LOOK_UPS).step_by(AT_ONCE) {
            for (point, index) in points.iter_mut().zip(first..) {
                point.uv = coordinates(seed, is_random, measurement, index);
            }
            look_up(&points, &mut colors);
            sum += colors.iter().map(|color| color[0]).sum::<f32>();
        }
        sum
    })
}

/// Where look-up `index` of a measurement is.
fn coordinates(seed: u64, is_random: bool, measurement: u32, index: u32) -> Vec2 {
    if is_random {
        let bits = nth_random(seed, u64::from(measurement * LOOK_UPS + index));
        return Vec2::new((bits >> 40) as f32, (bits & 0xff_ffff) as f32) / (1 << 24) as f32;
    }
    let (along, down) = (Vec2::new(1.3, 0.5) / SIDE as f32, Vec2::new(-0.5, 1.3) / SIDE as f32);
    along * (index % 1000) as f32 + down * (measurement * 20 + index / 1000) as f32
}

/// Nanoseconds per access to a random cache line, several being under way at once.
fn cache_line(seed: u64) -> f64 {
    const WORDS: usize = 1 << 24;
    let words: Vec<u64> = (0..WORDS as u64).collect();
    fastest(|measurement| {
        let mut sum = 0.0;
        for index in 0..LOOK_UPS {
            let bits = nth_random(seed, u64::from(measurement * LOOK_UPS + index));
            sum += words[bits as usize % WORDS] as f32;
        }
        sum
    })
}

fn fastest(mut look_ups: impl FnMut(u32) -> f32) -> f64 {
    let times = (0..MEASUREMENTS).map(|measurement| {
        let started = Instant::now();
        black_box(look_ups(measurement));
        started.elapsed().as_secs_f64() * 1e9 / f64::from(LOOK_UPS)
    });
    times.fold(f64::INFINITY, f64::min)
}
