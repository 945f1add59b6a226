//! Nanoseconds of single look-ups: images by filter, means over areas, solids, coordinates; and how long levels and prefiltering
//! take. Many look-ups at once are measured by `fantex_bench::images`.
//!
//! ```text
//! cargo run --release -p fantex-bench --example texture_speed
//! ```

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use fantex_base::{Aabb, Random};
use fantex_texture::coordinates::{Coordinates, Parameter, SpaceMatrix};
use fantex_texture::environment::{EnvironmentForm, EnvironmentMap, PrefilteredEnvironment};
use fantex_texture::{
    ColorSpace, Filter, Filtering, Image, ImageTexture, OMap, Placement, SMap, SOLID_NAMES, SampleOptions,
    Samples, ShadingPoint, ShapeKind, SolidPoint, TriplanarMap, TwoPartMapping, UvPoint, Wrap, solid_by_name,
};
use glam::{Vec2, Vec3, Vec4};

const SIDE: u32 = 2048;
const BOUNDS: Aabb<Vec3> = Aabb { min: Vec3::NEG_ONE, max: Vec3::ONE };

fn main() {
    images();
    solids();
    coordinates();
    let map = EnvironmentMap::from_function(EnvironmentForm::Cube, 512, |d, _| d * 0.5 + 0.5);
    let map = Arc::new(map);
    let seconds = fastest(5, || drop(black_box(PrefilteredEnvironment::new(Arc::clone(&map)))));
    println!("a cube of 512 is prefiltered in {seconds:.2} s");
}

/// Seconds of the fastest run.
fn fastest(runs: u32, mut run: impl FnMut()) -> f64 {
    let seconds = (0..runs).map(|_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    });
    seconds.fold(f64::INFINITY, f64::min)
}

/// Nanoseconds per call along slanted scan lines, as a baker walks through its source.
fn nanoseconds(mut look_up: impl FnMut(Vec2) -> [f32; 4]) -> f64 {
    let (along, down) = (Vec2::new(0.9, 0.3) / SIDE as f32, Vec2::new(-0.3, 0.9) / SIDE as f32);
    let rows = || {
        for row in 0..20 {
            for column in 0..1000 {
                black_box(look_up(along * column as f32 + down * row as f32));
            }
        }
    };
    fastest(60, rows) / 20_000.0 * 1e9
}

fn images() {
    let wrap = [Wrap::Repeat; 2];
    let texels = SIDE * SIDE;
    let bytes = |channels: u32| -> Vec<u8> {
        let mut random = Random::new(1);
        (0..texels * channels).map(|_| random.next_u64() as u8).collect()
    };
    let picture =
        |channels: u8, space, samples| Image { width: SIDE, height: SIDE, channels, space, samples };
    let floats = bytes(3).into_iter().map(f32::from).collect();
    for (name, image) in [
        ("RGB bytes", picture(3, ColorSpace::Srgb, Samples::U8(bytes(3)))),
        ("RGBA bytes", picture(4, ColorSpace::Srgb, Samples::U8(bytes(4)))),
        ("RGB floats", picture(3, ColorSpace::Linear, Samples::F32(floats))),
    ] {
        let image = Arc::new(image);
        let texture = ImageTexture::new(Arc::clone(&image));
        let bytes_per_texel = texture.byte_len() as f64 / f64::from(texels);
        let seconds = fastest(3, || drop(black_box(ImageTexture::new(Arc::clone(&image)))));
        let rate = f64::from(texels) / seconds * 1e-6;
        println!(
            "{name}: {bytes_per_texel:.1} bytes per texel with all levels, made at {rate:.0} M texels/s"
        );
        let time = nanoseconds(|uv| texture.sample_level0_bilinear(uv, wrap));
        println!("  sample_level0_bilinear       {time:7.1} ns");
        for width in [0.4_f32, 1.0, 1.5, 2.0, 4.0, 8.0] {
            let edge = Vec2::from_angle(0.4) * width / SIDE as f32;
            let time = nanoseconds(|uv| texture.sample_area(uv, [edge, edge.perp()], wrap));
            let sampler = texture.area_sampler([edge, edge.perp()], wrap);
            let prepared = nanoseconds(|uv| sampler.sample(uv));
            println!(
                "  sample_area {width:4.1} x {width:3.1} texels {time:7.1} ns, prepared {prepared:7.1} ns"
            );
        }
        for filter in Filter::ALL {
            let edge = Vec2::from_angle(0.4) * 8.0 / SIDE as f32;
            let options = SampleOptions { filter, ..SampleOptions::default() };
            let time = nanoseconds(|uv| texture.sample(uv, [edge, edge.perp() * 0.25], &options));
            println!("  sample {:21} {time:7.1} ns", format!("{filter:?}"));
        }
    }
}

fn solids() {
    let n = Vec3::new(0.4, 0.75, 0.5).normalize();
    for name in SOLID_NAMES {
        let Ok(solid) = solid_by_name(name, BOUNDS, 1) else { continue };
        let time = nanoseconds(|uv| {
            let p = (uv * 2.0 - 1.0).extend(0.3);
            solid.color(&SolidPoint { p, n, footprint: 1.0 / SIDE as f32, time: 0.0 })
        });
        println!("solid {name:27} {time:7.1} ns");
    }
}

fn coordinates() {
    let mut random = Random::new(24);
    let mut direction = || {
        let vector = || Vec3::from([(); 3].map(|()| random.unit() as f32)) * 2.0 - 1.0;
        std::iter::repeat_with(vector).find_map(Vec3::try_normalize).unwrap_or(Vec3::X)
    };
    let points: Vec<_> = (0..1000)
        .map(|_| {
            let normal = direction();
            let (right, down) = normal.any_orthonormal_pair();
            let steps = [right * 0.01, down * 0.01];
            ShadingPoint {
                position: 0.7 * normal,
                position_steps: steps,
                normal,
                normal_steps: steps,
                uv: &[],
                vertex_color: Vec4::ONE,
                eye: Some(normal.into()),
                time: 0.0,
                filtering: Filtering::Own,
            }
        })
        .collect();
    let measure = |name: String, coordinates: Coordinates| {
        let look_up = |point: &UvPoint| point.uv.extend(0.0).extend(point.steps[0].x);
        let run = || {
            black_box(points.iter().map(|at| coordinates.evaluate(at, look_up)).sum::<Vec4>());
        };
        println!("{name:40} {:7.1} ns", fastest(300, run) * 1e6);
    };
    for kind in ShapeKind::ALL {
        let Ok(s_map) = SMap::new(kind.fit(BOUNDS), &Placement::default()) else { continue };
        measure(format!("{kind:?}"), Coordinates::Surface(s_map));
        for o_map in [OMap::Reflection, OMap::ObjectNormal, OMap::default()] {
            measure(format!("{kind:?} {o_map:?}"), Coordinates::TwoPart(TwoPartMapping { s_map, o_map }));
        }
    }
    measure("Triplanar".into(), Coordinates::Triplanar(TriplanarMap::fit(BOUNDS)));
    measure("Projected".into(), Coordinates::Projected(SpaceMatrix::default()));
    measure("Parameter".into(), Coordinates::Parameter(Parameter::default()));
}
