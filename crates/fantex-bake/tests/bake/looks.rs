//! Looks as sources: texel by texel, and all texels of a triangle at once.

use std::sync::Arc;

use crate::common::cleaned;
use fantex_bake::{LookSource, Source, SurfacePoint, TriangleFootprint};
use fantex_mesh::{Mesh, generate};
use fantex_texture::coordinates::ImageLookup;
use fantex_texture::look::{Anisotropy, Difference, LookMaterial, NormalSpace, Relief, Slot};
use fantex_texture::noise::{Fractal, FractalKind, FractalNoise, NoiseFamily};
use fantex_texture::{ColorSpace, Image, ImageTexture, Marble, NoiseTexture, Samples, SolidTexture, Texture};
use glam::{Vec2, Vec3, Vec4};

fn image() -> Arc<dyn Texture> {
    let samples =
        Samples::U8((0..64 * 64 * 3u32).map(|i| (i.wrapping_mul(2654435761) >> 24) as u8).collect());
    let image = Image { width: 64, height: 64, channels: 3, space: ColorSpace::Srgb, samples };
    Arc::new(ImageLookup::new(Arc::new(ImageTexture::new(Arc::new(image)))))
}

fn noise() -> Arc<dyn Texture> {
    let noise = FractalNoise::new(NoiseFamily::Perlin, FractalKind::Fbm, Fractal::octaves(4), 5);
    Arc::new(NoiseTexture::new(noise, 0.3))
}

/// Something in every channel: colours of a solid, relief of each kind, roughness, glow, stretched highlights.
fn material() -> LookMaterial {
    let slot = |texture: Arc<dyn Texture>| Slot::Texture(texture);
    let bump = |difference| Relief::Bump { texture: noise(), height: 0.02, difference };
    LookMaterial {
        base_color: slot(Arc::new(SolidTexture(Marble::new(3)))),
        alpha: slot(noise()),
        roughness: slot(image()),
        emission: slot(image()),
        relief: vec![
            bump(Difference::Forward),
            bump(Difference::Central),
            Relief::Derivatives { texture: image(), uv_set: 0, height: 0.01, range: 2.0 },
            Relief::Normal { texture: image(), scale: 0.5, space: NormalSpace::Tangent { uv_set: 0 } },
        ],
        anisotropy: Some(Anisotropy { strength: Slot::number(0.5), direction: slot(image()), uv_set: 0 }),
        ..LookMaterial::default()
    }
}

fn dressed() -> Mesh {
    let mut mesh = cleaned(generate::icosphere(2));
    let corners = mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]);
    mesh.corners.uv_sets = vec![corners.map(|p| 0.5 + 0.5 * Vec2::new(p.x, p.z)).collect()];
    mesh
}

/// Texels of a triangle, some of them off it.
fn texels(mesh: &Mesh, triangle: usize) -> Vec<SurfacePoint> {
    let [a, b, c] = mesh.triangle_positions(triangle);
    let at = |l: Vec3| a * l.x + b * l.y + c * l.z;
    let lambda_steps = [Vec3::new(0.03, -0.02, -0.01), Vec3::new(-0.01, 0.03, -0.02)];
    let point = |i: usize| {
        let lambda = Vec3::splat(1.0 / 3.0)
            + lambda_steps[0] * ((i % 15) as f32 - 7.0)
            + lambda_steps[1] * ((i / 15) as f32 - 5.0);
        SurfacePoint {
            triangle,
            lambda,
            lambda_steps,
            position: at(lambda),
            position_steps: lambda_steps.map(at),
            normal: (b - a).cross(c - a).normalize(),
        }
    };
    (0..150).map(point).collect()
}

/// Images may differ by what their look-ups of many areas differ by, and relief by what that makes of it.
#[test]
fn texels_of_a_triangle_at_once_are_what_they_are_one_by_one() {
    let mesh = dressed();
    let source = LookSource::new(&mesh, vec![Arc::new(material())], 0.0).unwrap();
    let channels = source.channels().len();
    assert_eq!(channels, 5);
    let mut same = 0;
    for triangle in (0..mesh.triangles.len()).step_by(17) {
        let points = texels(&mesh, triangle);
        let footprint = TriangleFootprint { triangle, lambda_steps: points[0].lambda_steps };
        let mut together = vec![Vec4::NAN; points.len() * channels];
        source.on_triangle(&footprint)(&points, &mut together);
        for (point, together) in points.iter().zip(together.chunks(channels)) {
            let mut alone = vec![Vec4::NAN; channels];
            source.evaluate(point, &mut alone);
            for (channel, (together, alone)) in source.channels().iter().zip(together.iter().zip(&alone)) {
                let difference = (*together - *alone).abs().max_element();
                assert!(difference < 1e-4, "{:?}: {together} together, {alone} alone", channel.kind);
                same += u32::from(together == alone);
            }
        }
    }
    assert!(same > 1000, "{same} values are the same");
}
