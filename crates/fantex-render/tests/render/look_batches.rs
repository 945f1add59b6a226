//! Looks shade many points at once as they shade them one by one.

use std::sync::Arc;

use crate::common::{Random, sheet};
use fantex_mesh::Mesh;
use fantex_render::{Finish, Hit, LookSurface, MaterialSample, Surface};
use fantex_texture::coordinates::ImageLookup;
use fantex_texture::look::{Difference, LightingModel, LookMaterial, Opacity, Relief, Slot};
use fantex_texture::noise::{Fractal, FractalKind, FractalNoise, NoiseFamily};
use fantex_texture::{ColorSpace, Image, ImageTexture, NoiseTexture, Rock, Samples, SolidTexture, Texture};
use glam::Vec3;

/// By how much values may differ: what look-ups of many texels at once differ by.
const TOLERANCE: f32 = 1e-4;

fn slot(texture: impl Texture + 'static) -> Slot {
    Slot::Texture(Arc::new(texture))
}

fn image(seed: u64) -> Slot {
    let mut random = Random::new(seed);
    let samples = Samples::U8((0..64 * 64 * 4).map(|_| (random.unit() * 255.9) as u8).collect());
    let image = Image { width: 64, height: 64, channels: 4, space: ColorSpace::Srgb, samples };
    slot(ImageLookup::new(Arc::new(ImageTexture::new(Arc::new(image)))))
}

fn noise(seed: u32) -> NoiseTexture {
    let octaves = Fractal::octaves(4);
    NoiseTexture::new(FractalNoise::new(NoiseFamily::Perlin, FractalKind::Fbm, octaves, seed), 0.2)
}

fn materials() -> Vec<Arc<LookMaterial>> {
    let plain = LookMaterial::default();
    let images = LookMaterial {
        base_color: image(1),
        roughness: image(2),
        emission: image(3),
        modulate: Some(image(4)),
        opacity: Opacity::Blend,
        ..plain.clone()
    };
    let solid = LookMaterial {
        lighting: LightingModel::BlinnPhong,
        base_color: slot(SolidTexture(Rock::new(1))),
        metallic: slot(noise(1)),
        occlusion: slot(noise(2)),
        ambient: slot(noise(3)),
        specular: image(5),
        shininess: Some(slot(noise(4))),
        reflection: slot(noise(5)),
        light_map: Some(image(6)),
        relief: vec![Relief::Bump {
            texture: Arc::new(noise(6)),
            height: 0.01,
            difference: Difference::Central,
        }],
        ..plain.clone()
    };
    let cut_out =
        LookMaterial { base_color: image(7), opacity: Opacity::Mask { threshold: 0.5 }, ..plain.clone() };
    [plain, images, solid, cut_out].map(Arc::new).into()
}

fn assert_alike(got: &(MaterialSample, Option<Finish<'_>>), alone: &(MaterialSample, Option<Finish<'_>>)) {
    let numbers = |(sample, finish): &(MaterialSample, Option<Finish<'_>>)| {
        let finish = finish.as_ref().unwrap();
        let vectors = [
            sample.base_color,
            sample.normal,
            sample.emission,
            finish.ambient,
            finish.specular,
            finish.reflection,
            finish.light_map.unwrap_or(Vec3::ZERO),
            finish.modulate,
        ];
        let mut numbers = vectors.map(|v| v.to_array()).as_flattened().to_vec();
        numbers.extend([sample.alpha, sample.occlusion, sample.roughness, sample.metallic]);
        numbers.push(finish.shininess.unwrap_or(0.0));
        numbers
    };
    for (index, (a, b)) in numbers(got).iter().zip(numbers(alone)).enumerate() {
        // Of the cut-out's alpha, one of sixteen comparisons may fall differently.
        let tolerance = if index == 24 { 0.07 } else { TOLERANCE };
        assert!((a - b).abs() <= tolerance, "number {index}: {a}, alone {b}");
    }
}

#[test]
fn many_points_are_shaded_like_single_ones() {
    let mut mesh = sheet(12, 0.08, 11);
    let uv = mesh.triangles.as_flattened().iter().map(|&v| mesh.positions[v as usize].truncate());
    mesh.corners.uv_sets = vec![uv.map(|p| p * 2.0 + 0.5).collect()];
    let count = mesh.triangles.len();
    // Runs of several lengths, and single triangles.
    let material = |t: usize| if t < count / 2 { (t / 23 % 4) as u32 } else { (t % 4) as u32 };
    mesh.triangle_materials = (0..count).map(material).collect();
    let mesh = Mesh { materials: vec![fantex_mesh::Material::default(); 4], ..mesh };
    let surface = LookSurface::new(&mesh, materials());
    let mut random = Random::new(3);
    let hits: Vec<Hit> = (0..count)
        .map(|triangle| {
            let weights = Vec3::new(random.unit(), random.unit(), random.unit()) + 0.01;
            let step = |random: &mut Random| {
                let [a, b] = [random.signed() * 0.2, random.signed() * 0.2];
                Vec3::new(a, b, -a - b)
            };
            Hit {
                triangle,
                lambda: weights / weights.element_sum(),
                dlambda_dx: step(&mut random),
                dlambda_dy: step(&mut random),
                front: triangle % 3 != 0,
                to_eye: Vec3::new(0.3, 0.2, 0.93).normalize(),
            }
        })
        .collect();
    for size in [1, 3, 50, 128] {
        for hits in hits.chunks(size) {
            let mut shaded = Vec::new();
            surface.shade_all(hits, &mut shaded);
            assert_eq!(shaded.len(), hits.len());
            for (hit, got) in hits.iter().zip(&shaded) {
                assert_alike(got, &surface.shade(hit));
            }
        }
    }
}
