//! Textured stamps, made by the program: pictures of chalk, bristles, sponges and the like, from noise.

use std::path::{Path, PathBuf};

use fantex::glam::{Vec2, Vec3};
use fantex::texture::Image;
use fantex::texture::noise::{CellularMetric, NoiseFamily, cellular, smoothstep, white_noise};

/// Texels along a stamp's side.
const SIDE: u32 = 128;

/// What the path of a stamp that is made begins with; a name of [`STAMPS`] follows.
const MADE: &str = "made:";

/// Coverage 0..1 at a place, -1..1 along both sides.
type Shape = fn(Vec2) -> f32;

/// Names and shapes.
const STAMPS: [(&str, Shape); 12] = [
    ("chalk", |p| disc(p, 0.9, 0.15) * smoothstep(0.42, 0.6, grain(p * 9.0, 1) + 0.12)),
    ("charcoal", |p| {
        disc(p, 0.95, 0.3) * smoothstep(0.45, 0.75, grain(Vec2::new(p.x * 4.0, p.y * 16.0), 2) + 0.1)
    }),
    ("pastel", |p| disc(p, 0.9, 0.5) * (0.35 + 0.65 * smoothstep(0.4, 0.65, grain(p * 14.0, 3)))),
    ("bristles", |p| {
        let strand = white_noise(4, [(p.x * 22.0).floor(), 0.0]) * 0.5 + 0.5;
        let width = 1.0 - (2.0 * (p.x * 22.0).fract() - 1.0).abs();
        disc(p, 0.95, 0.2) * smoothstep(0.35, 0.6, strand) * smoothstep(0.1, 0.7, width)
    }),
    ("dry brush", |p| {
        disc(p, 0.95, 0.1) * smoothstep(0.5, 0.62, grain(Vec2::new(p.x * 18.0, p.y * 1.6), 5) + 0.04)
    }),
    ("sponge", |p| disc(p, 0.95, 0.35) * smoothstep(0.25, 0.5, cells(p * 5.0, 6))),
    ("spatter", |p| {
        let near = cellular(7, [p.x * 4.5, p.y * 4.5, 0.3], CellularMetric::default());
        disc(p, 0.95, 0.3) * (1.0 - smoothstep(0.05, 0.12, near.nearest - 0.26 * (near.id - 0.35)))
    }),
    ("grunge", |p| disc(p, 1.0, 0.6) * smoothstep(0.48, 0.58, grain(p * 3.5, 8))),
    ("scratches", |p| {
        let line = |k: u32| {
            let random = |n: u32| white_noise(9 + n, [k as f32, 0.0]);
            let (sin, cos) = (0.4 * random(0)).sin_cos();
            let across = (p.x * cos + p.y * sin - 0.9 * random(1)).abs();
            let along = (p.y * cos - p.x * sin - 0.5 * random(2)).abs();
            (1.0 - smoothstep(0.004, 0.02, across)) * (1.0 - smoothstep(0.25, 0.6, along))
        };
        disc(p, 1.0, 0.2) * (0..18).map(line).fold(0.0, f32::max)
    }),
    ("smoke", |p| disc(p, 1.0, 1.0) * smoothstep(0.3, 0.8, grain(p * 2.2, 10))),
    ("cracks", |p| {
        let bent = p + 0.12 * Vec2::new(grain(p * 3.0, 11) - 0.5, grain(p * 3.0, 12) - 0.5);
        let near = cellular(13, [bent.x * 3.0, bent.y * 3.0, 0.5], CellularMetric::default());
        disc(p, 0.95, 0.3) * (1.0 - smoothstep(0.02, 0.07, near.second - near.nearest))
    }),
    ("canvas", |p| {
        let [x, y] = [p.x, p.y].map(|t| (t * 40.0).sin().abs());
        disc(p, 0.9, 0.25) * smoothstep(0.35, 0.9, x.max(y) * (0.75 + 0.5 * (grain(p * 6.0, 14) - 0.5)))
    }),
];

/// Full within, fading towards the radius over a share of it.
fn disc(p: Vec2, radius: f32, soft: f32) -> f32 {
    1.0 - smoothstep(radius * (1.0 - soft), radius, p.length())
}

/// Fractal noise around 0.5.
fn grain(p: Vec2, seed: u32) -> f32 {
    let at = Vec3::new(p.x, p.y, 0.37);
    let noise = |octave: u32| {
        let scale = 2.03f32.powi(octave as i32);
        NoiseFamily::Perlin.value(CellularMetric::default(), seed + 31 * octave, (at * scale).to_array())
            * 0.5f32.powi(octave as i32)
    };
    0.5 + 0.5 * (0..4).map(noise).sum::<f32>()
}

/// Distance to the nearest of scattered points.
fn cells(p: Vec2, seed: u32) -> f32 {
    cellular(seed, [p.x, p.y, 0.3], CellularMetric::default()).nearest
}

/// The path by which a brush names a stamp that is made.
pub(super) fn made(name: &str) -> PathBuf {
    PathBuf::from(format!("{MADE}{name}"))
}

/// The picture that a brush's path names, if it is one that is made.
pub(super) fn made_stamp(path: &Path) -> Option<Image> {
    let name = path.to_str()?.strip_prefix(MADE)?;
    let (_, shape) = STAMPS.iter().find(|(known, _)| *known == name)?;
    let texel = |i: u32| {
        let [x, y] = [i % SIDE, i / SIDE].map(|n| (n as f32 + 0.5) / (0.5 * SIDE as f32) - 1.0);
        [1.0, 1.0, 1.0, shape(Vec2::new(x, y)).clamp(0.0, 1.0)]
    };
    let texels: Vec<[f32; 4]> = (0..SIDE * SIDE).map(texel).collect();
    Some(Image::from_linear_rgba(SIDE, SIDE, &texels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_all_different_end_before_their_sides_and_have_texture() {
        let pictures: Vec<Vec<f32>> = STAMPS
            .iter()
            .map(|(name, _)| {
                let image = made_stamp(&made(name)).unwrap();
                let alpha = |i: u32| image.linear_texel(i % SIDE, i / SIDE)[3];
                (0..SIDE * SIDE).map(alpha).collect()
            })
            .collect();
        for ((name, _), picture) in STAMPS.iter().zip(&pictures) {
            let mean = picture.iter().sum::<f32>() / picture.len() as f32;
            let spread = picture.iter().map(|a| (a - mean).powi(2)).sum::<f32>() / picture.len() as f32;
            assert!((0.02..0.7).contains(&mean) && spread > 0.005, "{name}: {mean} {spread}");
            assert!((0..SIDE as usize).all(|x| picture[x] < 0.1), "{name}");
        }
        for (k, picture) in pictures.iter().enumerate() {
            assert!(pictures[..k].iter().all(|other| other != picture));
        }
        assert!(made_stamp(Path::new("made:nothing")).is_none());
    }
}
