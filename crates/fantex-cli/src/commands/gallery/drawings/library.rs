//! What a program draws with the library alone: the gallery shows this text beside its picture.

use fantex::glam::{Vec3, Vec4};
use fantex::mesh::generate::torus;
use fantex::render::{Camera, FanSurface, FilterOptions, Lights, RenderOptions, render};
use fantex::store::PageCache;
use fantex::texture::Image;
use fantex::{Asset, Baker, Mesh, Result, Source};

/// Bakes a function of the surface and renders the asset.
pub(super) fn draw(folder: &std::path::Path, options: &RenderOptions) -> Result<Image> {
    let mesh = Mesh::from_model(torus(96, 48), "torus")?;
    // Called on many threads, for every texel of every tile; colours are linear.
    let lines = |point: &fantex::bake::TexelPoint| -> Vec4 {
        let wave = 0.5 + 0.5 * (150.0 * point.position.y).sin();
        (Vec3::splat(0.5) + 0.5 * point.normal).lerp(Vec3::ONE, wave).extend(1.0)
    };
    let path = folder.join("torus.fan");
    Baker::new(&mesh).source(Source::function(lines)).texels(500_000).write(&path)?;

    let asset = Asset::open(&path)?;
    let cache = PageCache::new(asset.shared().clone(), 64 << 20);
    let surface = FanSurface::of_asset(&cache, FilterOptions::default());
    let aspect = f64::from(options.width) / f64::from(options.height);
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, aspect);
    Ok(render(&mesh, &surface, &camera, &Lights::behind(&camera), options)?.picture.to_srgb_image())
}
