//! Assets of looks: toon scales, stretched highlights and baked light, by the GPU, by the CPU renderer, and against the looks
//! themselves.

use std::sync::Arc;

use crate::fan_common::{Baked, Comparison, compare, cpu, gpu};
use fantex_bake::{
    BakeFormat, BakeOptions, LookSource, Source, SourceChannel, SurfacePoint, baked_materials,
};
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_gpu::DrawOptions;
use fantex_mesh::{Mesh, clean, generate};
use fantex_render::LookSurface;
use fantex_scene::{Background, Camera, FilterOptions, Lights, Shading, ShadowOptions};
use fantex_store::ChannelKind;
use fantex_texture::look::{Anisotropy, LookMaterial, Slot};
use fantex_texture::{ColorRamp, Filter, RampInterpolation, ShadingPoint, Texture};
use glam::{Vec3, Vec4};

fn torus() -> Mesh {
    clean(generate::torus(96, 48), &Default::default()).unwrap().0
}

fn cover(mesh: &Mesh) -> Cover {
    let budget = TexelBudget::Total(1 << 20);
    build_cover(mesh, &CoverOptions { tile: 128, budget, ..CoverOptions::default() }).unwrap().0
}

fn options() -> DrawOptions {
    DrawOptions {
        shading: Shading::MetallicRoughness,
        filter: FilterOptions { filter: Filter::Trilinear, max_anisotropy: 8.0 },
        background: Background::Transparent,
        tone_map: None,
        samples: 1,
        ..DrawOptions::default()
    }
}

fn lights() -> Lights {
    Lights::sun(Vec3::new(0.3, 0.8, 0.5))
}

/// The tolerances of `fan.rs`.
fn assert_close(seen: &Comparison, mean: f32, most: f32) {
    assert!(seen.mean < mean, "{}: mean difference {}", seen.name, seen.mean);
    assert!(seen.quantile < most, "{}: 999 of 1000 differ by less than {}", seen.name, seen.quantile);
}

/// A look on a torus, as an asset; compared by both renderers, and with the look itself.
fn assert_looks_the_same(name: &str, material: LookMaterial, format: BakeFormat, [mean, most]: [f32; 2]) {
    let Some(gpu) = gpu() else { return };
    let mut mesh = torus();
    let materials = vec![Arc::new(material)];
    mesh.materials = baked_materials(&materials);
    let source = LookSource::new(&mesh, materials.clone(), 0.0).unwrap();
    let options = BakeOptions { format, ..BakeOptions::default() };
    let baked = Baked::new(&mesh, &cover(&mesh), &source, &options);
    assert_eq!(baked.asset().mesh().materials, mesh.materials, "the asset keeps its materials");
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let (lights, options) = (lights(), self::options());
    let seen = compare(name, &gpu, &baked, &camera, &lights, &options);
    assert_close(&seen, 0.002, 0.02);
    let look = cpu(&mesh, &LookSurface::new(&mesh, materials), &camera, &lights, &options);
    let asset = baked.surface(baked.cache(), &options);
    let asset = cpu(&mesh, &asset, &camera, &lights, &options);
    assert_close(&Comparison::of(&format!("{name} as a look"), &asset, &look), mean, most);
}

fn toon(interpolation: RampInterpolation) -> Arc<ColorRamp> {
    let grey = |v: f32| Vec4::new(v, v, 0.8 * v, 1.0);
    let stops = vec![(-0.2, grey(0.05)), (0.2, grey(0.3)), (0.55, grey(0.6)), (0.85, grey(1.0))];
    Arc::new(ColorRamp::new(stops, interpolation).unwrap())
}

#[test]
fn toon_scales() {
    for interpolation in [RampInterpolation::Constant, RampInterpolation::Linear, RampInterpolation::Smooth] {
        let material = LookMaterial {
            base_color: Slot::color(Vec3::new(0.8, 0.3, 0.2)),
            toon: Some(toon(interpolation)),
            ..LookMaterial::default()
        };
        assert_looks_the_same(&format!("toon {interpolation:?}"), material, BakeFormat::Rgba8, [0.003, 0.02]);
    }
}

/// A direction that turns around the ring, encoded in 0..1.
struct Swirl;

impl Texture for Swirl {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let (sine, cosine) = (3.0 * at.position.z.atan2(at.position.x)).sin_cos();
        Vec4::new(0.5 + 0.5 * cosine, 0.5 + 0.5 * sine, 0.5, 1.0)
    }
}

#[test]
fn stretched_highlights() {
    // Along and, where the strength is negative, across the direction.
    for (strength, format) in
        [(0.9, BakeFormat::Rgba8), (-0.6, BakeFormat::Float), (0.7, BakeFormat::Bc7), (0.0, BakeFormat::Bc7)]
    {
        let material = LookMaterial {
            base_color: Slot::color(Vec3::new(0.9, 0.7, 0.5)),
            metallic: Slot::number(1.0),
            roughness: Slot::number(0.45),
            anisotropy: Some(Anisotropy {
                strength: Slot::number(strength),
                direction: Slot::Texture(Arc::new(Swirl)),
                uv_set: 7,
            }),
            ..LookMaterial::default()
        };
        assert_looks_the_same(&format!("stretched {strength}"), material, format, [0.004, 0.05]);
    }
}

#[test]
fn stretched_highlights_on_toon() {
    let material = LookMaterial {
        toon: Some(toon(RampInterpolation::Constant)),
        roughness: Slot::number(0.4),
        anisotropy: Some(Anisotropy {
            strength: Slot::number(0.8),
            direction: Slot::color(Vec3::new(1.0, 0.5, 0.5)),
            uv_set: 7,
        }),
        ..LookMaterial::default()
    };
    assert_looks_the_same("both", material, BakeFormat::Rgba8, [0.004, 0.05]);
}

/// Base colour and the light that arrives.
struct Lit;

impl Source for Lit {
    fn channels(&self) -> Vec<SourceChannel> {
        let channel = |kind, exceeds_one| SourceChannel { kind, has_alpha: false, exceeds_one };
        vec![channel(ChannelKind::BaseColor, false), channel(ChannelKind::Light, true)]
    }

    fn prefilter(&self) -> fantex_bake::Prefilter {
        fantex_bake::Prefilter::Point
    }

    fn evaluate(&self, point: &SurfacePoint, values: &mut [Vec4]) {
        let p = point.position;
        let wave = |k: Vec3| 0.5 + 0.45 * p.dot(k).sin();
        values[0] = Vec4::new(wave(Vec3::X * 20.0), wave(Vec3::Y * 20.0), 0.5, 1.0);
        values[1] = (Vec3::new(1.5, 1.2, 1.0) * wave(Vec3::splat(9.0))).extend(1.0);
    }
}

#[test]
fn baked_light() {
    let Some(gpu) = gpu() else { return };
    let mesh = torus();
    let baked = Baked::new(&mesh, &cover(&mesh), &Lit, &BakeOptions::default());
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let bright = compare("light", &gpu, &baked, &camera, &lights(), &options());
    assert_close(&bright, 0.002, 0.02);
    // What arrives was computed before, so a lamp adds its highlights alone.
    let surface = baked.surface(baked.cache(), &options());
    let [dark, lit] = [Lights::default(), lights()]
        .map(|lights| cpu(baked.asset().mesh(), &surface, &camera, &lights, &options()));
    let brighter = dark.rgba.iter().zip(&lit.rgba).filter(|(d, l)| l[0] > d[0] + 0.2).count();
    assert!(brighter * 20 < lit.rgba.len(), "{brighter} pixels are far brighter under the lamp");
}

#[test]
fn toon_in_shadow() {
    let Some(gpu) = gpu() else { return };
    let mut mesh = torus();
    let look = LookMaterial { toon: Some(toon(RampInterpolation::Constant)), ..LookMaterial::default() };
    let materials = vec![Arc::new(look)];
    mesh.materials = baked_materials(&materials);
    let source = LookSource::new(&mesh, materials, 0.0).unwrap();
    let baked = Baked::new(&mesh, &cover(&mesh), &source, &BakeOptions::default());
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.5);
    let lights = Lights::sun(Vec3::new(0.9, 0.35, 0.1)).with_shadows(ShadowOptions::default());
    let seen = compare("toon shadow", &gpu, &baked, &camera, &lights, &options());
    // Shadows fall on facets here, and a step of the scale makes much of a little difference.
    assert!(seen.mean < 0.01, "{}", seen.mean);
}
