//! Textures at many points are what they are at single ones.

use std::sync::Arc;

use fantex_texture::combine::{
    Binary, Channel, Clamp, Combine, CombineMode, Factor, Layer, LayerMode, Layers, Mix, Operation, Remap,
    Swizzle, TextureUse,
};
use fantex_texture::coordinates::{Coordinates, ImageLookup, InSpace, NormalAxes, Parameter, SpaceMatrix};
use fantex_texture::look::Slot;
use fantex_texture::noise::{FractalKind, NoiseFamily};
use fantex_texture::{
    Color, ColorSpace, Filter, Filtering, Image, ImageTexture, Marble, NoiseOptions, NoiseTexture, Rock,
    SampleOptions, Samples, ShadingPoint, SolidTexture, Texture, TriplanarMap, UvPoint, Wrap,
};
use glam::{Vec2, Vec3, Vec4};

use crate::common::{Random, shading_point};

/// Images may differ by what look-ups of many texels at once differ by.
const TOLERANCE: f32 = 1e-4;

fn slot(texture: impl Texture + 'static) -> Slot {
    Slot::Texture(Arc::new(texture))
}

fn noise(family: NoiseFamily, fractal: FractalKind) -> NoiseOptions {
    NoiseOptions { family, fractal, octaves: 4, seed: 5, cell: 0.3, ..NoiseOptions::default() }
}

fn image() -> Arc<ImageTexture> {
    let mut random = Random::new(3);
    let samples = Samples::U8((0..64 * 32 * 4).map(|_| random.bits() as u8).collect());
    let image = Image { width: 64, height: 32, channels: 4, space: ColorSpace::Srgb, samples };
    Arc::new(ImageTexture::new(Arc::new(image)))
}

fn lookup(filter: Filter) -> ImageLookup {
    let options = SampleOptions { filter, ..SampleOptions::default() };
    ImageLookup { options, ..ImageLookup::new(image()) }
}

/// One of everything that has a way of its own with many points, and some without.
fn textures() -> Vec<(&'static str, Slot)> {
    let noisy = |options| slot(NoiseTexture::new(options));
    let perlin = || noisy(noise(NoiseFamily::Perlin, FractalKind::Fbm));
    let colors = || slot(lookup(Filter::Trilinear));
    let number = |value| Slot::number(value);
    // Nothing, something and everything.
    let mask = || slot(Remap { input: perlin(), from: [0.4, 0.6], to: [-0.5, 1.5], clamp: false });
    let combined = |mode| Layer {
        mode,
        constant: Color::opaque(0.3, 0.2, 0.9),
        mask: mask(),
        opacity: number(0.7),
        ..Layer::over(colors())
    };
    let layers = vec![
        Layer { mask: mask(), ..Layer::over(colors()) },
        combined(LayerMode::Blend),
        Layer { mask: number(0.0), ..Layer::over(colors()) },
    ];
    let matrix = SpaceMatrix::default();
    let warped = NoiseOptions { warp: 0.4, ..noise(NoiseFamily::Perlin, FractalKind::Ridged) };
    let image: Arc<dyn Texture> = Arc::new(lookup(Filter::Trilinear));
    let inverted = TextureUse { factor: Factor::Number(-1.0), offset: 1.0, ..TextureUse::plain(image) };
    let binary = |operation| slot(Binary { operation, a: perlin(), b: colors() });
    vec![
        ("a constant", Slot::Constant(Vec4::new(0.1, 0.2, 0.3, 0.4))),
        ("an image, bilinear", slot(lookup(Filter::Bilinear))),
        ("an image, trilinear", colors()),
        ("an image, anisotropic", slot(lookup(Filter::Anisotropic))),
        ("an image, EWA", slot(lookup(Filter::Ewa))),
        ("squares", slot(ImageLookup { square_texels: true, ..lookup(Filter::Bilinear) })),
        (
            "three projections",
            slot(ImageLookup {
                coordinates: Coordinates::Triplanar(TriplanarMap {
                    origin: Vec3::ZERO,
                    scale: 0.4,
                    sharpness: 4.0,
                }),
                ..lookup(Filter::Trilinear)
            }),
        ),
        (
            "by distance",
            slot(ImageLookup {
                coordinates: Coordinates::Parameter(Parameter::Distance { center: Vec3::X }),
                ..lookup(Filter::Trilinear)
            }),
        ),
        ("gradient noise", perlin()),
        ("turbulence", noisy(noise(NoiseFamily::Perlin, FractalKind::Turbulence))),
        ("simplices", noisy(noise(NoiseFamily::Simplex, FractalKind::Fbm))),
        ("warped noise", noisy(warped)),
        ("rock", slot(SolidTexture(Rock::new(4)))),
        (
            "marble elsewhere",
            slot(InSpace {
                input: slot(SolidTexture(Marble::new(4))),
                matrix,
                normal_axes: NormalAxes::Object,
            }),
        ),
        ("swizzled", slot(Swizzle::select(colors(), Channel::Green))),
        ("inverted", slot(inverted)),
        ("clamped", slot(Clamp { input: colors(), low: 0.2, high: 0.4 })),
        ("mixed", slot(Mix { a: colors(), b: perlin(), mask: mask() })),
        ("mixed by nothing", slot(Mix { a: colors(), b: perlin(), mask: number(0.0) })),
        ("mixed by everything", slot(Mix { a: colors(), b: perlin(), mask: number(1.0) })),
        ("a sum", binary(Operation::Add)),
        ("a product", binary(Operation::Multiply)),
        ("the larger one", binary(Operation::Maximum)),
        (
            "a decal",
            slot(Combine {
                mode: CombineMode::Decal,
                texture: colors(),
                fragment: perlin(),
                constant: Color::WHITE,
            }),
        ),
        ("layers", slot(Layers { base: perlin(), layers })),
    ]
}

/// Texels of one triangle: parallelograms alike, one at a time and many at once.
#[test]
fn means_over_like_texels_are_what_single_ones_are() {
    let mut random = Random::new(5);
    for (texels, wrap) in [(0.7, Wrap::Repeat), (1.4, Wrap::Clamp), (30.0, Wrap::Mirror)] {
        let steps = [Vec2::new(1.0, 0.2), Vec2::new(-0.1, 0.8)].map(|step| step * texels / 64.0);
        let uv: Vec<UvPoint> = (0..150)
            .map(|_| UvPoint { uv: Vec2::new(random.unit(), random.unit()) * 3.0 - 1.0, steps })
            .collect();
        let points: Vec<ShadingPoint<'_>> = uv
            .iter()
            .map(|uv| ShadingPoint {
                uv: std::slice::from_ref(uv),
                filtering: Filtering::Area,
                ..shading_point(Vec3::ZERO, Vec3::Z)
            })
            .collect();
        for filter in [Filter::Trilinear, Filter::Nearest] {
            let texture = ImageLookup {
                options: SampleOptions { filter, wrap: [wrap; 2], ..SampleOptions::default() },
                ..lookup(filter)
            };
            let mut values = vec![Vec4::NAN; points.len()];
            texture.evaluate_all(&points, &mut values);
            for (point, value) in points.iter().zip(values) {
                let difference = (value - texture.evaluate(point)).abs().max_element();
                assert!(difference <= 1e-5, "{filter:?}, {texels} texels: {difference}");
            }
        }
    }
}

#[test]
fn many_points_are_what_single_ones_are() {
    let mut random = Random::new(9);
    let count = 150;
    let uv: Vec<UvPoint> = (0..count)
        .map(|_| {
            let axis = Vec2::from_angle(random.unit() * 6.3) * 2.0_f32.powf(random.unit() * 6.0 - 8.0);
            let uv = Vec2::new(random.unit(), random.unit()) * 3.0 - 1.0;
            UvPoint { uv, steps: [axis, axis.perp() * random.unit()] }
        })
        .collect();
    for filtering in [Filtering::Own, Filtering::Area] {
        let points: Vec<ShadingPoint<'_>> = uv
            .iter()
            .map(|uv| {
                let width = 0.02 * random.unit();
                ShadingPoint {
                    position_steps: [random.vector() * width, random.vector() * width],
                    uv: std::slice::from_ref(uv),
                    vertex_color: random.vector().abs().extend(0.5),
                    filtering,
                    ..shading_point(random.vector() * 3.0, random.direction())
                }
            })
            .collect();
        for (name, texture) in textures() {
            let mut values = vec![Vec4::NAN; count];
            texture.evaluate_all(&points, &mut values);
            for (point, value) in points.iter().zip(values) {
                let single = texture.evaluate(point);
                let difference = (value - single).abs().max_element();
                assert!(difference <= TOLERANCE, "{name}, {filtering:?}: {value}, alone {single}");
            }
        }
    }
}
