//! The sources that come with fantex, read back through the texture function.

use std::path::Path;
use std::sync::Arc;

use fantex_bake::{
    BakeLight, Fit, LightMapOptions, LightMapSource, LightQuantity, LightScene, LitSource, LookSource,
    MappedImageSource, Reflector, SolidSource, Source, SourceChannel, SourceReflector, TexelPoint,
    VertexColorSource, baked_materials,
};
use fantex_base::ErrorKind;
use fantex_mesh::{
    AlphaMode, ImageSource, Material, Mesh, Model, ObjectSpace, SurfacePoint, TextureRef, WrapMode, generate,
    interpolate, lambda_step,
};
use fantex_store::{ChannelKind, Footprint, PageCache, Sampler};
use fantex_texture::combine::{Factor, TextureUse};
use fantex_texture::coordinates::ImageLookup;
use fantex_texture::look::{
    Anisotropy, Difference, LookMaterial, NormalSpace, Opacity, Relief, Slot, TangentSpace,
};
use fantex_texture::{
    ColorSpace, Filter, FilterOptions, Image, ImageTexture, MappingKind, Marble, NoiseOptions, NoiseTexture,
    Samples, ShadingPoint, SolidTexture, Texture, Wrap,
};
use glam::{DVec3, Mat3, Vec2, Vec3, Vec4};

use crate::common::{OfPosition, baked, barycentric_points, cleaned, cover, float_options, sample};

fn corner_positions(mesh: &Mesh) -> Vec<Vec3> {
    mesh.triangles.iter().flatten().map(|&v| mesh.positions[v as usize]).collect()
}

/// Compares the finest level with a function of triangle and position.
#[track_caller]
fn assert_gives(
    cache: &PageCache,
    channel: usize,
    tolerance: f32,
    expected: impl Fn(usize, Vec3) -> Option<Vec4>,
) {
    let mesh = cache.asset().mesh();
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.triangle_positions(triangle);
        for lambda in barycentric_points(7) {
            if let Some(expected) = expected(triangle, interpolate([a, b, c], lambda)) {
                let value = sample(cache, channel, 0, triangle, lambda);
                let difference = (value - expected).abs().max_element();
                assert!(difference < tolerance, "{value} for {expected}, triangle {triangle} {lambda}");
            }
        }
    }
}

#[test]
fn vertex_colors_are_interpolated() {
    let mut mesh = cleaned(generate::grid(5));
    assert_eq!(VertexColorSource::new(&mesh).unwrap_err().kind(), ErrorKind::InvalidArgument);
    let color = |p: Vec3| Vec4::new(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.z, 0.25, 0.75 + 0.25 * p.x);
    mesh.corners.colors = corner_positions(&mesh).into_iter().map(color).collect();
    let source = VertexColorSource::new(&mesh).unwrap();
    assert!(source.channels()[0].has_alpha);
    let baked = baked(&mesh, &cover(&mesh, 64, 100_000), &source, &float_options(Fit::Sharp));
    // At the border of the mesh the texels beyond it hold the border's colour: a texel's share of the slope.
    assert_gives(&baked.cache, 0, 0.01, |_, p| Some(color(p)));
    assert_gives(&baked.cache, 0, 1e-4, |_, p| (p.abs().max_element() < 0.95).then(|| color(p)));

    mesh.corners.colors.iter_mut().for_each(|c| c.w = 1.0);
    assert!(!VertexColorSource::new(&mesh).unwrap().channels()[0].has_alpha);
    mesh.corners.colors.pop();
    assert!(VertexColorSource::new(&mesh).is_err());
}

/// Where a source gives no numbers there is a hole, at every level no larger than that place.
#[test]
fn values_that_are_no_numbers_do_not_spread() {
    let mesh = cleaned(generate::grid(4));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let hole = |p: Vec3| if p.abs().max_element() < 0.05 { bad } else { 0.5 };
        let source = OfPosition(move |p: Vec3| Vec3::splat(hole(p)).extend(1.0));
        let baked = baked(&mesh, &cover(&mesh, 256, 20_000), &source, &float_options(Fit::Sharp));
        for level in 0..baked.cache.asset().level_count() {
            for triangle in 0..mesh.triangles.len() {
                for lambda in barycentric_points(5) {
                    let p = interpolate(mesh.triangle_positions(triangle), lambda);
                    let value = sample(&baked.cache, 0, level, triangle, lambda).x;
                    let is_far = p.abs().max_element() > 0.6;
                    assert!((0.0..0.6).contains(&value), "{bad}, level {level}, {p}: {value}");
                    assert!(!is_far || (value - 0.5).abs() < 0.02, "{bad}, level {level}, {p}: {value}");
                }
            }
        }
    }
}

#[test]
fn solids_are_the_same_as_sources_and_in_looks_wherever_the_model_lies() {
    let marble = || Marble::new(3);
    let value = |moved: DVec3| {
        let mut model = generate::torus(16, 10);
        model.positions.iter_mut().for_each(|p| *p += moved);
        let mesh = cleaned(model);
        let texture: Arc<dyn Texture> = Arc::new(SolidTexture(marble()));
        let material = LookMaterial { base_color: Slot::Texture(texture), ..LookMaterial::default() };
        let look = LookSource::new(&mesh, vec![Arc::new(material)], 0.0).unwrap();
        let solid = SolidSource::new(&mesh, Box::new(marble()));
        let lambda = Vec3::new(0.2, 0.3, 0.5);
        let at = |triangle: u32| TexelPoint {
            at: SurfacePoint { triangle, lambda },
            lambda_steps: [Vec3::ZERO; 2],
            position: interpolate(mesh.triangle_positions(triangle as usize), lambda),
            position_steps: [Vec3::X * 1e-3, Vec3::Y * 1e-3],
            normal: Vec3::Z,
        };
        let of = |source: &dyn Source, triangle| {
            let mut values = vec![Vec4::ZERO; source.channels().len()];
            source.evaluate(&at(triangle), &mut values);
            values[0].truncate()
        };
        let values = (0..mesh.triangles.len() as u32).map(|t| [of(&look, t), of(&solid, t)]);
        values.collect::<Vec<_>>()
    };
    let first = value(DVec3::ZERO);
    for moved in [DVec3::new(0.03, -0.2, 0.11), DVec3::splat(7.3)] {
        for (a, b) in first.iter().zip(value(moved)) {
            assert!((b[0] - b[1]).abs().max_element() < 1e-6, "{b:?}");
            assert!((a[0] - b[0]).abs().max_element() < 1e-3, "{a:?} {b:?}");
        }
    }
}

/// Discs on a square lattice, so many along the mesh's edge.
#[derive(Debug)]
struct Discs {
    cells: f32,
    radius: f32,
}

impl Texture for Discs {
    fn evaluate(&self, at: &ShadingPoint<'_>) -> Vec4 {
        let p = Vec2::new(at.position.x, at.position.z) * self.cells / 2.0;
        let distance = (p - p.floor() - 0.5).length();
        let share = std::f32::consts::PI * self.radius * self.radius;
        let is_resolved = at.width() * self.cells / 2.0 < 0.5;
        // What is finer than the footprint is its mean.
        let alpha = if is_resolved { f32::from(u8::from(distance < self.radius)) } else { share };
        Vec4::new(0.2, 0.6, 0.1, alpha)
    }
}

/// Of discs that the mesh's first material cuts out, at every level, in tiles so large.
fn assert_coverage(mut mesh: Mesh, tile: u32) {
    for cells in [12.0, 60.0, 500.0] {
        let texture: Arc<dyn Texture> = Arc::new(Discs { cells, radius: 0.3 });
        let cut_out = LookMaterial {
            base_color: Slot::Texture(texture),
            opacity: Opacity::Mask { threshold: 0.7 },
            ..LookMaterial::default()
        };
        let materials = vec![Arc::new(cut_out), Arc::new(LookMaterial::default())];
        mesh.materials = baked_materials(&materials);
        let AlphaMode::Mask(threshold) = mesh.materials[0].alpha else { panic!() };
        let source = LookSource::new(&mesh, materials, 0.0).unwrap();
        let baked = baked(&mesh, &cover(&mesh, tile, 60_000), &source, &float_options(Fit::Sharp));
        for level in 0..4 {
            let (mut there, mut all) = (0.0, 0.0);
            for triangle in (0..mesh.triangles.len()).filter(|&triangle| mesh.material_of(triangle) == 0) {
                for lambda in barycentric_points(16) {
                    let alpha = sample(&baked.cache, 0, level, triangle, lambda).w;
                    there += f32::from(u8::from(alpha >= threshold));
                    all += 1.0;
                }
            }
            let expected = std::f32::consts::PI * 0.09;
            let covered = there / all;
            assert!((covered - expected).abs() < 0.06, "{cells} cells, level {level}: {covered}");
        }
    }
}

#[test]
fn cut_outs_keep_their_coverage_at_every_level() {
    assert_coverage(cleaned(generate::grid(8)), 128);
}

/// A tile that is opaque on one side.
#[test]
fn cut_outs_beside_what_is_opaque_keep_their_coverage() {
    let mut mesh = cleaned(generate::grid(8));
    let is_right = |triangle: usize| {
        let [a, b, c] = mesh.triangle_positions(triangle);
        a.x + b.x + c.x > 0.0
    };
    mesh.triangle_materials = (0..mesh.triangles.len()).map(|t| u32::from(is_right(t))).collect();
    assert_eq!(cover(&mesh, 256, 60_000).groups.len(), 1);
    assert_coverage(mesh, 256);
}

/// Discs on a square lattice, cut out.
fn discs(cells: f32) -> Vec<Arc<LookMaterial>> {
    let cut_out = LookMaterial {
        base_color: Slot::Texture(Arc::new(Discs { cells, radius: 0.3 })),
        opacity: Opacity::Mask { threshold: 0.7 },
        ..LookMaterial::default()
    };
    vec![Arc::new(cut_out)]
}

fn dim_sky(_: Vec3) -> Vec3 {
    Vec3::splat(0.25)
}

/// A source in the same light everywhere.
fn lit<'a>(mesh: &'a Mesh, source: &'a dyn Source, reflector: &'a dyn Reflector) -> LitSource<'a> {
    let scene = LightScene { lights: Vec::new(), sky: &dim_sky, reflector };
    let options =
        LightMapOptions { quantity: LightQuantity::Direct, samples: 4, denoise: false, ..Default::default() };
    LitSource::new(LightMapSource::new(mesh, &scene, options).unwrap(), Some(source))
}

#[test]
fn bright_light_makes_colours_that_exceed_one() {
    let mesh = cleaned(generate::grid(2));
    let grey = OfPosition(|_| Vec4::new(0.6, 0.6, 0.6, 1.0));
    let (reflector, sky) = (SourceReflector::new(&mesh, &grey), |_: Vec3| Vec3::splat(0.5));
    let exceeds_one = |light: BakeLight| {
        let scene = LightScene { lights: vec![light], sky: &sky, reflector: &reflector };
        let options = LightMapOptions { quantity: LightQuantity::Direct, ..Default::default() };
        let light = LightMapSource::new(&mesh, &scene, options).unwrap();
        LitSource::new(light, Some(&grey)).channels()[0].exceeds_one
    };
    let sun = |strength: f32| {
        let color = Vec3::splat(strength);
        exceeds_one(BakeLight::Directional { to_light: Vec3::Y, color, radius_degrees: 0.25 })
    };
    assert!(!sun(1.0) && sun(4.0));
    assert!(exceeds_one(BakeLight::Point { position: DVec3::Y, color: Vec3::splat(0.1), radius: 0.0 }));
}

#[test]
fn cut_outs_let_light_through_below_their_own_threshold() {
    let cut_out = |threshold| Material {
        base_color: Vec4::new(1.0, 1.0, 1.0, 0.3),
        alpha: AlphaMode::Mask(threshold),
        ..Material::default()
    };
    let mesh = two_materials([cut_out(0.4), cut_out(0.2)], Vec::new());
    let source = LookSource::of_model(&mesh).unwrap();
    let reflector = SourceReflector::new(&mesh, &source);
    for triangle in 0..mesh.triangles.len() {
        let at = texels(&mesh, triangle)[75].at;
        assert_eq!(reflector.is_solid(at), is_right(&mesh, triangle));
    }
}

/// Holes are finer than texels: their alpha is a share.
#[test]
fn light_keeps_the_coverage_of_cut_outs() {
    let mut mesh = cleaned(generate::grid(4));
    let materials = discs(500.0);
    mesh.materials = baked_materials(&materials);
    let source = LookSource::new(&mesh, materials, 0.0).unwrap();
    let reflector = |_: SurfacePoint| Vec3::ONE;
    let source = lit(&mesh, &source, &reflector);
    let baked = baked(&mesh, &cover(&mesh, 128, 20_000), &source, &float_options(Fit::Sharp));
    for level in 0..3 {
        let (mut there, mut all) = (0.0, 0.0);
        for triangle in 0..mesh.triangles.len() {
            for lambda in barycentric_points(16) {
                there += f32::from(u8::from(sample(&baked.cache, 0, level, triangle, lambda).w >= 0.5));
                all += 1.0;
            }
        }
        let covered = there / all;
        assert!((covered - std::f32::consts::PI * 0.09).abs() < 0.06, "level {level}: {covered}");
    }
}

/// Many cards beside each other, a tile for each, from so far that a card is a few pixels or less.
#[test]
fn cut_outs_are_as_dense_from_afar() {
    const CARDS: u32 = 20;
    let mut model = Model::default();
    for card in 0..CARDS * CARDS {
        let first = model.positions.len() as u32;
        let corner = DVec3::new(f64::from(card % CARDS), 0.0, f64::from(card / CARDS));
        let corners = [DVec3::ZERO, DVec3::Z, DVec3::new(1.0, 0.0, 1.0), DVec3::X];
        model.positions.extend(corners.map(|offset| corner * 1.25 + offset));
        model.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|v| v + first)));
    }
    let mut mesh = cleaned(model);
    let card = (1.0 / mesh.world_from_mesh.scale) as f32;
    let materials = discs(100.0);
    mesh.materials = baked_materials(&materials);
    let source = LookSource::new(&mesh, materials, 0.0).unwrap();
    let baked = baked(&mesh, &cover(&mesh, 64, 100_000), &source, &float_options(Fit::Sharp));
    let filter = FilterOptions { filter: Filter::Trilinear, ..FilterOptions::default() };
    let sampler = Sampler::of_cache(&baked.cache, filter);
    for pixels in [16.0, 4.0, 2.0, 1.2, 0.9, 0.5, 0.1] {
        let (mut there, mut all) = (0.0, 0.0);
        for triangle in 0..mesh.triangles.len() {
            let corners = mesh.triangle_positions(triangle);
            let lambda_steps = [Vec3::X, Vec3::Z].map(|side| lambda_step(corners, side * (card / pixels)));
            for lambda in barycentric_points(9) {
                let at = SurfacePoint { triangle: triangle as u32, lambda };
                let value = sampler.sample_channel(0, at, Footprint { lambda_steps });
                there += f32::from(u8::from(value.w >= 0.5));
                all += 1.0;
                let color = value.truncate();
                assert!(color.distance(Vec3::new(0.2, 0.6, 0.1)) < 0.01, "{pixels} pixels: {color}");
            }
        }
        let covered = there / all;
        eprintln!("{pixels} pixels: {covered}");
        assert!((covered - std::f32::consts::PI * 0.09).abs() < 0.07, "{pixels} pixels: {covered}");
    }
}

/// Materials that are opaque have no holes, also beside others that have.
#[test]
fn opaque_materials_ignore_alpha_beside_cut_outs() {
    let opaque = Material { base_color: Vec4::new(0.7, 0.2, 0.3, 0.0), ..Material::default() };
    let cut_out = Material { alpha: AlphaMode::Mask(0.5), ..opaque.clone() };
    let mesh = two_materials([cut_out, opaque], Vec::new());
    let look = |opacity| {
        let (base_color, alpha) = (Slot::Constant(Vec4::new(0.7, 0.2, 0.3, 1.0)), Slot::number(0.0));
        Arc::new(LookMaterial { base_color, alpha, opacity, ..LookMaterial::default() })
    };
    let looks = vec![look(Opacity::Mask { threshold: 0.5 }), look(Opacity::Opaque)];
    let looks = LookSource::new(&mesh, looks, 0.0).unwrap();
    for source in [LookSource::of_model(&mesh).unwrap(), looks] {
        let reflector = SourceReflector::new(&mesh, &source);
        for triangle in 0..mesh.triangles.len() {
            let point = texels(&mesh, triangle)[75];
            let mut values = vec![Vec4::NAN; source.channels().len()];
            source.evaluate(&point, &mut values);
            let is_there = is_right(&mesh, triangle);
            assert_eq!(values[0], Vec4::new(0.7, 0.2, 0.3, f32::from(u8::from(is_there))));
            assert_eq!(reflector.is_solid(point.at), is_there);
        }
    }
}

#[test]
fn emission_may_exceed_one_where_factors_or_constants_do() {
    let mesh = dressed();
    let use_of = |factor: f32| -> Slot {
        let factor = Factor::Number(factor);
        Slot::Texture(Arc::new(TextureUse { factor, ..TextureUse::plain(image()) }))
    };
    let exceeds_one = |emissions: Vec<Slot>| {
        let look = |emission| Arc::new(LookMaterial { emission, ..LookMaterial::default() });
        let source = LookSource::new(&mesh, emissions.into_iter().map(look).collect(), 0.0).unwrap();
        let emits = |channels: Vec<SourceChannel>| channels.last().unwrap().exceeds_one;
        let reflector = |_: SurfacePoint| Vec3::ONE;
        let of_lit = emits(lit(&mesh, &source, &reflector).channels());
        assert_eq!(source.channels()[1].kind, ChannelKind::Emission);
        assert_eq!(of_lit, emits(source.channels()));
        of_lit
    };
    assert!(exceeds_one(vec![use_of(4.0)]));
    assert!(exceeds_one(vec![use_of(0.5), Slot::number(4.0)]));
    assert!(!exceeds_one(vec![use_of(1.0), Slot::number(0.5)]));
    assert!(!exceeds_one(vec![use_of(0.25), Slot::Texture(image())]));
}

#[test]
fn constant_images_are_constant_through_every_mapping() {
    let mesh = cleaned(generate::torus(16, 10));
    let cover = cover(&mesh, 64, 30_000);
    for kind in MappingKind::ALL {
        let image = Image::from_linear_rgba(8, 8, &[[0.2, 0.4, 0.6, 0.8]; 64]);
        let texture = ImageTexture::new(Arc::new(image));
        let mapping = kind.fit(ObjectSpace::of(&mesh).bounds());
        let source = MappedImageSource::new(&mesh, texture, mapping, [Wrap::Repeat; 2]);
        let baked = baked(&mesh, &cover, &source, &float_options(Fit::Sharp));
        assert_gives(&baked.cache, 0, 1e-4, |_, _| Some(Vec4::new(0.2, 0.4, 0.6, 0.8)));
    }
}

/// The image of a ramp, seen through the planar mapping, rises steadily along one axis of the model.
#[test]
fn a_planar_image_lies_on_the_model() {
    let mesh = cleaned(generate::grid(4));
    let ramp: Vec<[f32; 4]> = (0..64 * 64).map(|i| [((i % 64) as f32 + 0.5) / 64.0; 4]).collect();
    let texture = ImageTexture::new(Arc::new(Image::from_linear_rgb(64, 64, &ramp)));
    let mapping = MappingKind::Planar.fit(ObjectSpace::of(&mesh).bounds());
    let source = MappedImageSource::new(&mesh, texture, mapping, [Wrap::Clamp; 2]);
    assert!(!source.channels()[0].has_alpha);
    let baked = baked(&mesh, &cover(&mesh, 0, 200_000), &source, &float_options(Fit::Point));
    let value = |p: Vec3| {
        let triangle = (0..mesh.triangles.len())
            .find_map(|t| {
                let [a, b, c] = mesh.triangle_positions(t);
                let area = (b - a).cross(c - a).y;
                let l =
                    Vec3::new((b - p).cross(c - p).y, (c - p).cross(a - p).y, (a - p).cross(b - p).y) / area;
                (l.min_element() >= -1e-6).then_some((t, l))
            })
            .unwrap();
        sample(&baked.cache, 0, 0, triangle.0, triangle.1).x
    };
    let along = |axis: Vec3| [-0.8f32, -0.3, 0.1, 0.7].map(|s| value(axis * s + Vec3::new(0.01, 0.0, 0.02)));
    let (x, z) = (along(Vec3::X), along(Vec3::Z));
    let expected = [-0.8f32, -0.3, 0.1, 0.7].map(|s| 0.5 + 0.5 * s);
    let near = |found: [f32; 4], sign: f32| {
        found.iter().zip(expected).all(|(f, e)| (f - (0.5 + sign * (e - 0.5))).abs() < 0.02)
    };
    let flat = |found: [f32; 4]| found.iter().all(|f| (f - found[0]).abs() < 0.02);
    let runs = |rising: [f32; 4], level: [f32; 4]| (near(rising, 1.0) || near(rising, -1.0)) && flat(level);
    assert!(runs(x, z) || runs(z, x), "{x:?} {z:?}");
}

fn image_file(folder: &Path, name: &str, texels: &[[f32; 4]]) -> ImageSource {
    let side = texels.len().isqrt() as u32;
    let path = folder.join(name);
    Image::from_linear_rgba(side, side, texels)
        .converted(fantex_texture::Depth::U8, fantex_texture::ColorSpace::Linear)
        .save(&path)
        .unwrap();
    ImageSource::File(path)
}

fn texture(image: usize, uv_set: usize) -> Option<TextureRef> {
    let wrap = [WrapMode::Clamp; 2];
    Some(TextureRef { image, uv_set, uv_transform: Mat3::IDENTITY, wrap, nearest: false })
}

/// A flat grid with texture coordinates 0..1 over it; material 1 for every triangle on the right.
fn two_materials(materials: [Material; 2], images: Vec<ImageSource>) -> Mesh {
    let mut mesh = cleaned(generate::grid(4));
    let uv = corner_positions(&mesh).iter().map(|p| 0.5 + 0.5 * Vec2::new(p.x, p.z)).collect();
    mesh.corners.uv_sets = vec![uv];
    mesh.triangle_materials = (0..mesh.triangles.len()).map(|t| u32::from(is_right(&mesh, t))).collect();
    mesh.materials = materials.to_vec();
    mesh.images = images;
    mesh
}

fn is_right(mesh: &Mesh, triangle: usize) -> bool {
    mesh.triangle_positions(triangle).iter().map(|p| p.x).sum::<f32>() > 0.0
}

/// The expected value of points that lie well inside one of the two materials.
fn by_side(left: Vec4, right: Vec4) -> impl Fn(usize, Vec3) -> Option<Vec4> {
    move |_, p| (p.x.abs() > 0.1).then_some(if p.x < 0.0 { left } else { right })
}

#[test]
fn two_materials_keep_to_their_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![
        image_file(folder.path(), "white.png", &[[1.0, 1.0, 1.0, 0.2]; 4]),
        image_file(folder.path(), "surface.png", &[[0.4, 0.6, 0.2, 1.0]; 16]),
    ];
    let left = Material {
        base_color: Vec4::new(0.1, 0.5, 0.9, 1.0),
        base_color_texture: texture(0, 0),
        metallic: 1.0,
        roughness: 1.0,
        metallic_roughness_texture: texture(1, 0),
        occlusion_texture: texture(1, 0),
        occlusion_strength: 0.5,
        alpha: AlphaMode::Mask(0.5),
        ..Material::default()
    };
    let right = Material {
        base_color: Vec4::new(0.7, 0.2, 0.3, 0.5),
        roughness: 0.25,
        emission: Vec3::new(6.0, 0.0, 2.0),
        ..Material::default()
    };
    let mesh = two_materials([left, right], images);
    let source = LookSource::of_model(&mesh).unwrap();
    assert!(source.has_textures());
    let kinds: Vec<ChannelKind> = source.channels().iter().map(|c| c.kind).collect();
    use ChannelKind::{BaseColor, Emission, OcclusionRoughnessMetallic};
    assert_eq!(kinds, [BaseColor, OcclusionRoughnessMetallic, Emission]);
    assert!(source.channels()[0].has_alpha && !source.channels()[1].has_alpha);
    let density = source.density();
    assert!(density.len() == mesh.triangles.len() && density.iter().all(|&d| d > 0.0 && d.is_finite()));

    let baked = baked(&mesh, &cover(&mesh, 64, 60_000), &source, &float_options(Fit::Sharp));
    let at_white = Vec4::new(0.1, 0.5, 0.9, 0.2);
    assert_gives(&baked.cache, 0, 0.01, by_side(at_white, Vec4::new(0.7, 0.2, 0.3, 1.0)));
    assert_gives(
        &baked.cache,
        1,
        0.01,
        by_side(Vec4::new(0.7, 0.6, 0.2, 1.0), Vec4::new(1.0, 0.25, 0.0, 1.0)),
    );
    assert_gives(&baked.cache, 2, 0.01, by_side(Vec4::W, Vec4::new(6.0, 0.0, 2.0, 1.0)));
}

#[test]
fn opaque_materials_have_no_alpha_and_alike_ones_no_extra_channels() {
    let mesh = two_materials([Material::default(), Material::default()], Vec::new());
    let source = LookSource::of_model(&mesh).unwrap();
    assert!(!source.has_textures());
    let channels = source.channels();
    assert!(channels.len() == 1 && !channels[0].has_alpha);
    assert!(source.density().iter().all(|&d| d > 0.0));
    let baked = baked(&mesh, &cover(&mesh, 64, 10_000), &source, &float_options(Fit::Sharp));
    assert_gives(&baked.cache, 0, 1e-5, |_, _| Some(Vec4::ONE));
}

/// A texture whose coordinates are not there counts as none: white, the factor alone.
#[test]
fn missing_coordinates_and_images_give_the_factor() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![image_file(folder.path(), "black.png", &[[0.0, 0.0, 0.0, 1.0]; 4])];
    let color = Vec4::new(0.5, 0.25, 0.75, 1.0);
    for reference in [texture(0, 5), texture(9, 0)] {
        let material = Material {
            base_color: color,
            base_color_texture: reference.clone(),
            normal_texture: reference.clone(),
            emission_texture: reference,
            ..Material::default()
        };
        let mesh = two_materials([material.clone(), material], images.clone());
        let source = LookSource::of_model(&mesh).unwrap();
        assert!(!source.has_textures() && source.channels().len() == 1);
        let baked = baked(&mesh, &cover(&mesh, 64, 10_000), &source, &float_options(Fit::Sharp));
        assert_gives(&baked.cache, 0, 1e-5, |_, _| Some(color));
    }
    let gone = ImageSource::File(folder.path().join("gone.png"));
    let material = Material { base_color_texture: texture(0, 0), ..Material::default() };
    let mesh = two_materials([material.clone(), material], vec![gone]);
    let source = LookSource::of_model(&mesh).unwrap();
    assert!(!source.has_textures() && source.channels().len() == 1);
    assert!(source.left_out().notes()[0].contains("gone.png"), "{:?}", source.left_out());
}

/// What glows by an image that is missing is dark, and asks for no texels.
#[test]
fn emission_without_its_image_is_dark() {
    let folder = tempfile::tempdir().unwrap();
    let gone = ImageSource::File(folder.path().join("gone.png"));
    let material = Material { emission: Vec3::ONE, emission_texture: texture(0, 0), ..Material::default() };
    let mesh = two_materials([Material::default(), material], vec![gone]);
    let source = LookSource::of_model(&mesh).unwrap();
    assert_eq!(source.left_out().count(), 1);
    let emission = source.channels().iter().position(|c| c.kind == ChannelKind::Emission).unwrap();
    let baked = baked(&mesh, &cover(&mesh, 64, 10_000), &source, &float_options(Fit::Sharp));
    let dark = Vec3::ZERO.extend(1.0);
    assert_gives(&baked.cache, emission, 1e-5, |_, _| Some(dark));
    let plain = two_materials([Material::default(), Material::default()], Vec::new());
    assert_eq!(source.density(), LookSource::of_model(&plain).unwrap().density());
}

/// An emission texture over a factor of zero is black, and a normal map that is flat gives the vertex normal.
#[test]
fn dark_emission_and_flat_normals() {
    let folder = tempfile::tempdir().unwrap();
    let half = 128.0 / 255.0;
    let images = vec![
        image_file(folder.path(), "glow.png", &[[1.0; 4]; 4]),
        image_file(folder.path(), "flat.png", &[[half, half, 1.0, 1.0]; 4]),
    ];
    let material = Material {
        emission: Vec3::ZERO,
        emission_texture: texture(0, 0),
        normal_texture: texture(1, 0),
        ..Material::default()
    };
    let mesh = two_materials([material.clone(), material], images);
    let source = LookSource::of_model(&mesh).unwrap();
    let kinds: Vec<ChannelKind> = source.channels().iter().map(|c| c.kind).collect();
    assert_eq!(kinds, [ChannelKind::BaseColor, ChannelKind::Normal, ChannelKind::Emission]);
    let baked = baked(&mesh, &cover(&mesh, 64, 10_000), &source, &float_options(Fit::Sharp));
    assert_gives(&baked.cache, 2, 1e-5, |_, _| Some(Vec4::W));
    // x and y of the normal in the tile's own frame.
    for triangle in 0..mesh.triangles.len() {
        let value = sample(&baked.cache, 1, 0, triangle, Vec3::splat(1.0 / 3.0));
        assert!((value.truncate().truncate() - 0.5).abs().max_element() < 0.01, "{value}");
    }
}

/// A needle with a whole image on it, as poles of spheres have where rounding keeps their vertices apart, says nothing about how dense
/// the others are.
#[test]
fn needles_do_not_ask_for_texels() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![image_file(folder.path(), "grey.png", &[[0.5; 4]; 64 * 64])];
    let material = Material { base_color_texture: texture(0, 0), ..Material::default() };
    let mut mesh = two_materials([material.clone(), material], images);
    let usual = LookSource::of_model(&mesh).unwrap().density();
    let count = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-7, 0.0)]);
    mesh.triangles.push([count, count + 1, count + 2]);
    mesh.triangle_materials.push(0);
    mesh.corners.uv_sets[0].extend([Vec2::ZERO, Vec2::X, Vec2::ONE]);
    let densities = LookSource::of_model(&mesh).unwrap().density();
    let mean = usual[0];
    assert!(densities.iter().all(|d| (d / mean - 1.0).abs() < 0.01), "{densities:?} instead of {mean}");
}

/// Models coloured by a palette show a point of it on each triangle, but for rounding errors, and their colours meet at edges.
#[test]
fn points_of_a_palette_are_as_dense_as_borders_between_them_need() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![image_file(folder.path(), "grey.png", &[[0.5; 4]; 64 * 64])];
    let material = Material { base_color_texture: texture(0, 0), ..Material::default() };
    let usual = two_materials([material.clone(), material], images);
    let texels = |mesh: &Mesh| {
        let densities = LookSource::of_model(mesh).unwrap().density();
        let of = |(t, &density): (usize, &f32)| f64::from(density).powi(2) * mesh.triangle_area(t);
        densities.iter().enumerate().map(of).sum::<f64>()
    };
    assert!(texels(&usual) < 1e5, "{}", texels(&usual));
    for scale in [1e-6, 1e-3] {
        let mut mesh = usual.clone();
        mesh.corners.uv_sets[0].iter_mut().for_each(|uv| *uv = Vec2::splat(0.3) + scale * *uv);
        assert!((texels(&mesh) / 262_144.0 - 1.0).abs() < 0.01, "{}", texels(&mesh));
    }
}

#[test]
fn images_that_cannot_be_read_are_named_with_what_wants_them() {
    let folder = tempfile::tempdir().unwrap();
    let images = vec![
        image_file(folder.path(), "there.png", &[[0.5; 4]; 4]),
        ImageSource::File(folder.path().join("gone.png")),
    ];
    let named = Material {
        name: "wood".into(),
        place: "line 3 of a.mtl".into(),
        base_color_texture: texture(0, 0),
        normal_texture: texture(1, 0),
        ..Material::default()
    };
    let message = |materials: [Material; 2]| {
        let mesh = two_materials(materials, images.clone());
        let error = LookSource::of_model(&mesh).unwrap().left_out().check().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NotFound);
        assert_eq!(error.path(), Some(folder.path().join("gone.png").as_path()));
        error.to_string()
    };
    let text = message([Material::default(), named.clone()]);
    assert!(text.starts_with("the normal map of material \"wood\" (line 3 of a.mtl): cannot read"), "{text}");
    assert!(text.contains("gone.png") && text.ends_with("or correct its name in the model"), "{text}");
    let nameless = Material { name: String::new(), place: String::new(), ..named };
    let text = message([Material::default(), nameless]);
    assert!(text.starts_with("the normal map of material 1: "), "{text}");
}

// Looks as sources: texel by texel, and all texels of a triangle at once.

fn image() -> Arc<dyn Texture> {
    let samples =
        Samples::U8((0..64 * 64 * 3u32).map(|i| (i.wrapping_mul(2654435761) >> 24) as u8).collect());
    let image = Image { width: 64, height: 64, channels: 3, space: ColorSpace::Srgb, samples };
    Arc::new(ImageLookup::new(Arc::new(ImageTexture::new(Arc::new(image)))))
}

fn noise() -> Arc<dyn Texture> {
    Arc::new(NoiseTexture::new(NoiseOptions { octaves: 4, seed: 5, cell: 0.3, ..NoiseOptions::default() }))
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
            Relief::Normal {
                texture: image(),
                scale: 0.5,
                space: NormalSpace::Tangent(TangentSpace::of_set(0)),
            },
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
fn texels(mesh: &Mesh, triangle: usize) -> Vec<TexelPoint> {
    let [a, b, c] = mesh.triangle_positions(triangle);
    let at = |l: Vec3| interpolate([a, b, c], l);
    let lambda_steps = [Vec3::new(0.03, -0.02, -0.01), Vec3::new(-0.01, 0.03, -0.02)];
    let point = |i: usize| {
        let lambda = Vec3::splat(1.0 / 3.0)
            + lambda_steps[0] * ((i % 15) as f32 - 7.0)
            + lambda_steps[1] * ((i / 15) as f32 - 5.0);
        TexelPoint {
            at: SurfacePoint { triangle: triangle as u32, lambda },
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
        let mut together = vec![Vec4::NAN; points.len() * channels];
        source.evaluate_all(&points, &mut together);
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
