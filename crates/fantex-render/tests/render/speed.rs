//! How fast a picture of a million triangles is. Run with `--release -- --ignored --nocapture`.

use std::sync::Arc;

use fantex_mesh::{ImageSource, Material, Mesh, TextureRef, WrapMode};
use fantex_render::{
    Background, Camera, Coverage, FanSurface, FilterOptions, Finish, FlatShading, FlatSurface, Hit, Lights,
    LookSurface, MaterialSample, RenderOptions, ShadowOptions, SmoothPoint, Surface, render,
};
use fantex_store::{
    Asset, AssetWriter, Channel, ChannelKind, CreateOptions, EncodedPage, PageCache, TexelFormat, group_pages,
};
use fantex_texture::coordinates::ImageLookup;
use fantex_texture::look::{LookMaterial, Slot};
use fantex_texture::noise::NoiseFamily;
use fantex_texture::{
    ColorSpace, Filter, Image, ImageTexture, NoiseOptions, NoiseTexture, Rock, SampleOptions, Samples,
    SolidTexture, Texture,
};
use glam::{DVec3, Mat3};

use crate::common::fan_cover;
use crate::common::{UvImage, image, look, model};
use crate::common::{frontal, sheet, triangle_color};

fn measure(name: &str, mesh: &Mesh, surface: &dyn Surface, samples: u32) {
    let options = RenderOptions { samples, background: Background::Transparent, ..RenderOptions::default() };
    let seen = render(mesh, surface, &frontal(1.0, 50.0), &Lights::default(), &options).unwrap();
    let seconds = seen.stats.elapsed.as_secs_f64();
    eprintln!("{name}, {samples} samples: {seconds:.3} s, {:?}", seen.stats);
    assert!(seconds < 10.0);
}

#[test]
#[ignore = "measures; run it alone and with optimisation"]
fn a_million_triangles() {
    let mesh = sheet(707, 0.001, 1);
    let surface = FlatSurface::new(&mesh, FlatShading::Faceted, triangle_color);
    for samples in [1, 4, 8] {
        measure("a million triangles", &mesh, &surface, samples);
    }
}

#[test]
#[ignore = "measures; run it alone and with optimisation"]
fn a_million_textured_triangles() {
    const SIDE: u32 = 4096;
    let bytes = (0..SIDE * SIDE).flat_map(|texel| {
        let [a, b, c, _] = texel.wrapping_mul(2_654_435_761).to_le_bytes();
        [a, b, c, 255]
    });
    let space = ColorSpace::Srgb;
    let samples = Samples::U8(bytes.collect());
    let image = Image { width: SIDE, height: SIDE, channels: 4, space, samples };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("texels.png");
    image.save(&path).unwrap();
    let texture = TextureRef {
        image: 0,
        uv_set: 0,
        uv_transform: Mat3::IDENTITY,
        wrap: [WrapMode::Repeat; 2],
        nearest: false,
    };
    let material = Material { base_color_texture: Some(texture), ..Material::default() };
    let mut mesh =
        Mesh { images: vec![ImageSource::File(path)], materials: vec![material], ..sheet(707, 0.001, 1) };
    let uv = mesh.triangles.as_flattened().iter().map(|&v| mesh.positions[v as usize].truncate());
    mesh.corners.uv_sets = vec![uv.map(|p| p * 0.5 + 0.5).collect()];
    let camera = Camera { eye: DVec3::new(0.0, -0.9, 1.1), ..frontal(1.0, 60.0) };
    let lights = Lights::behind(&camera);
    let options = RenderOptions { samples: 1, ..RenderOptions::default() };
    for filter in [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic] {
        let filter_options = FilterOptions { filter, ..FilterOptions::default() };
        let surface = LookSurface::of_model(&mesh, filter_options).unwrap();
        let picture = || render(&mesh, &surface, &camera, &lights, &options).unwrap();
        let fastest = (0..30).map(|_| picture().stats.elapsed).min();
        eprintln!("{filter:?}: {fastest:?}, {:?}", picture().stats);
    }
}

/// A look whose points are shaded one by one.
struct OneByOne<'a>(&'a LookSurface<'a>);

impl Surface for OneByOne<'_> {
    fn shade_inputs(&self, hit: &Hit) -> MaterialSample {
        self.0.shade_inputs(hit)
    }

    fn shade(&self, hit: &Hit) -> (MaterialSample, Option<Finish<'_>>) {
        self.0.shade(hit)
    }

    fn smooth_point(&self, hit: &Hit) -> Option<SmoothPoint> {
        self.0.smooth_point(hit)
    }

    fn coverage(&self, triangle: usize) -> Coverage {
        self.0.coverage(triangle)
    }
}

#[test]
#[ignore = "measures; run it alone and with optimisation"]
fn looks_on_a_million_triangles() {
    let mut mesh = sheet(707, 0.001, 1);
    let uv = mesh.triangles.as_flattened().iter().map(|&v| mesh.positions[v as usize].truncate());
    mesh.corners.uv_sets = vec![uv.map(|p| p * 0.5 + 0.5).collect()];
    let mesh = Mesh { materials: vec![Material::default()], ..mesh };
    let bytes = (0..2048_u32 * 2048).flat_map(|i| i.wrapping_mul(2_654_435_761).to_le_bytes()[..3].to_vec());
    let samples = Samples::U8(bytes.collect());
    let image = Image { width: 2048, height: 2048, channels: 3, space: ColorSpace::Srgb, samples };
    let image = Arc::new(ImageTexture::new(Arc::new(image)));
    let lookup = |filter| {
        let options = SampleOptions { filter, ..SampleOptions::default() };
        ImageLookup { options, ..ImageLookup::new(Arc::clone(&image)) }
    };
    let noise = |family| {
        let cell = 0.2;
        NoiseTexture::new(NoiseOptions { family, octaves: 6, seed: 1, cell, ..NoiseOptions::default() })
    };
    let textures: [(&str, Arc<dyn Texture>); 5] = [
        ("an image, trilinear", Arc::new(lookup(Filter::Trilinear))),
        ("an image, anisotropic", Arc::new(lookup(Filter::Anisotropic))),
        ("gradient noise", Arc::new(noise(NoiseFamily::Perlin))),
        ("simplex noise, no fast path", Arc::new(noise(NoiseFamily::Simplex))),
        ("rock", Arc::new(SolidTexture(Rock::new(1)))),
    ];
    let camera = Camera { eye: DVec3::new(0.0, -0.9, 1.1), ..frontal(1.0, 60.0) };
    let lights = Lights::behind(&camera);
    let options = RenderOptions { samples: 1, ..RenderOptions::default() };
    for (name, texture) in textures {
        let material = LookMaterial { base_color: Slot::Texture(texture), ..LookMaterial::default() };
        let surface = LookSurface::new(&mesh, look(material));
        let (mut together, mut alone) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..12 {
            let seconds = |surface: &dyn Surface| {
                render(&mesh, surface, &camera, &lights, &options).unwrap().stats.elapsed.as_secs_f64()
            };
            together = together.min(seconds(&surface));
            alone = alone.min(seconds(&OneByOne(&surface)));
        }
        eprintln!("{name}: {:.0} ms, point by point {:.0} ms", together * 1e3, alone * 1e3);
    }
}

#[test]
#[ignore = "measures; run it alone and with optimisation"]
fn an_asset() {
    let mesh = Mesh { materials: vec![Material::default()], ..sheet(40, 0.01, 1) };
    let cover = fan_cover(&mesh, [64, 64]);
    let channel = |kind| Channel { kind, format: TexelFormat::Rgba8, srgb: false };
    let channels = [channel(ChannelKind::BaseColor), channel(ChannelKind::OcclusionRoughnessMetallic)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.fan");
    let mut writer = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels).unwrap();
    for (g, group) in cover.groups.iter().enumerate() {
        let bytes = |level| group.level_extent(level).iter().product::<u32>() as usize * 4;
        let pages = group_pages(g as u32, group);
        let pages = pages.map(|id| EncodedPage { id, channels: vec![vec![100; bytes(id.level)]; 2] });
        writer.write_pages(pages.collect()).unwrap();
    }
    writer.finish(&vec![[0.4; 4]; 2 * cover.groups.len()]).unwrap();
    let cache = PageCache::new(Arc::new(Asset::open(&path).unwrap()), 512 << 20);
    for filter in [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic] {
        let surface = FanSurface::of_asset(&cache, FilterOptions { filter, ..FilterOptions::default() });
        measure(&format!("{filter:?}, cold"), &mesh, &surface, 4);
        measure(&format!("{filter:?}, warm"), &mesh, &surface, 4);
    }
}

#[test]
#[ignore = "measures; run it alone and with optimisation"]
fn the_bottle() {
    let Some(mesh) = model("meshes/WaterBottle/WaterBottle.gltf") else { return };
    let Some(color) = image("meshes/WaterBottle/WaterBottle_baseColor.png") else { return };
    let own = LookSurface::of_model(&mesh, FilterOptions::default()).unwrap();
    let material =
        LookMaterial { base_color: Slot::Texture(UvImage::new(color, 1.0)), ..LookMaterial::default() };
    let look = LookSurface::new(&mesh, look(material));
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 16.0 / 9.0);
    let lights = Lights::behind(&camera);
    let shadowed = lights.clone().with_shadows(ShadowOptions::default());
    for (name, surface, lights) in [
        ("the model's materials", &own as &dyn Surface, &lights),
        ("with shadows", &own, &shadowed),
        ("a look with one image", &look, &lights),
    ] {
        let picture = || render(&mesh, surface, &camera, lights, &RenderOptions::default()).unwrap();
        let fastest = (0..20).map(|_| picture().stats.elapsed).min();
        eprintln!("{name}: {fastest:?}, {:?}", picture().stats);
    }
}
