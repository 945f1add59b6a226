//! Speed of look-ups: `cargo test --release -p fantex-texture --test texture speed -- --ignored --nocapture`.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use crate::common::{FILTERS, Random};
use fantex_base::Aabb;
use fantex_texture::{
    ColorSpace, Filter, Image, ImageTexture, SOLID_NAMES, SampleOptions, Samples, SolidPoint, UvPoint, Wrap,
    solid_by_name,
};
use glam::{Vec2, Vec3};

const SIDE: u32 = 2048;

fn picture(channels: u8, samples: Samples) -> ImageTexture {
    let space = if matches!(samples, Samples::F32(_)) { ColorSpace::Linear } else { ColorSpace::Srgb };
    ImageTexture::new(Arc::new(Image { width: SIDE, height: SIDE, channels, space, samples }))
}

fn bytes(count: u32) -> Vec<u8> {
    let mut random = Random(1);
    (0..count).map(|_| random.bits() as u8).collect()
}

/// Nanoseconds per call along slanted scan lines, as a baker walks through its source.
fn nanoseconds(mut look_up: impl FnMut(Vec2) -> [f32; 4]) -> f64 {
    let (along, down) = (Vec2::new(0.9, 0.3) / SIDE as f32, Vec2::new(-0.3, 0.9) / SIDE as f32);
    let best = (0..60).map(|_| {
        let start = Instant::now();
        for row in 0..20 {
            for column in 0..1000 {
                black_box(look_up(along * column as f32 + down * row as f32));
            }
        }
        start.elapsed().as_secs_f64() / 20_000.0 * 1e9
    });
    best.fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "measures, asserts nothing"]
fn speed() {
    let wrap = [Wrap::Repeat; 2];
    let count = SIDE * SIDE;
    let textures = [
        ("RGB bytes", picture(3, Samples::U8(bytes(count * 3)))),
        ("RGBA bytes", picture(4, Samples::U8(bytes(count * 4)))),
        ("RGB floats", picture(3, Samples::F32(bytes(count * 3).into_iter().map(f32::from).collect()))),
    ];
    for (name, texture) in &textures {
        println!(
            "{name}: {:.1} bytes per texel with all levels",
            texture.byte_len() as f64 / f64::from(count)
        );
        let time = nanoseconds(|uv| texture.sample_level0_bilinear(uv, wrap));
        println!("  sample_level0_bilinear       {time:7.1} ns");
        for texels in [0.4_f32, 1.0, 1.5, 2.0, 4.0, 8.0] {
            let edge = Vec2::from_angle(0.4) * texels / SIDE as f32;
            let time = nanoseconds(|uv| texture.sample_area(uv, [edge, edge.perp()], wrap));
            let sampler = texture.area_sampler([edge, edge.perp()], wrap);
            let prepared = nanoseconds(|uv| sampler.sample(uv));
            println!(
                "  sample_area {texels:4.1} x {texels:3.1} texels {time:7.1} ns, prepared {prepared:7.1} ns"
            );
        }
        for filter in FILTERS {
            let edge = Vec2::from_angle(0.4) * 8.0 / SIDE as f32;
            let footprint = [edge, edge.perp() * 0.25];
            let options = SampleOptions { filter, ..Default::default() };
            let time = nanoseconds(|uv| texture.sample(uv, footprint, &options));
            println!("  sample {:21} {time:7.1} ns", format!("{filter:?}"));
        }
    }
    for name in SOLID_NAMES {
        let bounds = Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE };
        let solid = solid_by_name(name, bounds, 1).unwrap();
        let n = Vec3::new(0.4, 0.75, 0.5).normalize();
        let time = nanoseconds(|uv| {
            solid.color(&SolidPoint {
                p: (uv * 2.0 - 1.0).extend(0.3),
                n,
                footprint: 1.0 / SIDE as f32,
                time: 0.0,
            })
        });
        println!("solid {name:27} {time:7.1} ns");
    }
    let base = textures[0].1.level(0).clone();
    let start = Instant::now();
    black_box(ImageTexture::new(Arc::new(base)));
    println!(
        "levels of RGB bytes: {:.0} M texels/s",
        f64::from(count) / start.elapsed().as_secs_f64() * 1e-6
    );
}

/// The look-ups of `fantex bench sample` that are made many at once. `LOOK_UP` names one of them, so that a profile shows
/// nothing else.
#[test]
#[ignore = "measures, asserts nothing"]
fn speed_of_many_look_ups() {
    const SIDE: u32 = 4096;
    const AT_ONCE: usize = 250;
    let mut random = Random(1);
    let mut texels = bytes(SIDE * SIDE * 4);
    texels.iter_mut().skip(3).step_by(4).for_each(|alpha| *alpha = 255);
    let samples = Samples::U8(texels);
    let image = Image { width: SIDE, height: SIDE, channels: 4, space: ColorSpace::Srgb, samples };
    let texture = ImageTexture::new(Arc::new(image));
    let axis = Vec2::from_angle(0.4) / SIDE as f32;
    let [wide, long] = [1.5, 12.0].map(|major| [axis * major, axis.perp() * 1.5]);
    let only = std::env::var("LOOK_UP").ok();
    for (name, filter, steps, is_random) in [
        ("bilinear", Filter::Bilinear, wide, false),
        ("trilinear", Filter::Trilinear, wide, false),
        ("trilinear, random", Filter::Trilinear, wide, true),
        ("anisotropic 8:1", Filter::Anisotropic, long, false),
    ] {
        if only.as_ref().is_some_and(|only| only != name) {
            continue;
        }
        let options = SampleOptions { filter, ..SampleOptions::default() };
        let mut points = [UvPoint { uv: Vec2::ZERO, steps }; AT_ONCE];
        let mut colors = [[0.0; 4]; AT_ONCE];
        let (along, down) = (Vec2::new(1.3, 0.5) / SIDE as f32, Vec2::new(-0.5, 1.3) / SIDE as f32);
        let mut fastest = f64::INFINITY;
        for measurement in 0..10_000 {
            let mut seconds = 0.0;
            for first in (0..1000).step_by(AT_ONCE) {
                for (point, index) in points.iter_mut().zip(first..) {
                    point.uv = if is_random {
                        Vec2::new(random.unit(), random.unit())
                    } else {
                        along * index as f32 + down * (measurement % 3000) as f32
                    };
                }
                let start = Instant::now();
                texture.sample_all(black_box(&points), &options, &mut colors);
                seconds += start.elapsed().as_secs_f64();
                black_box(&colors);
            }
            fastest = fastest.min(seconds / 1000.0 * 1e9);
        }
        println!("{name:20} {fastest:7.2} ns");
    }
}
