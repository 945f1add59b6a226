//! Pictures that no look can make: of covers, of maps between images, of surroundings unfolded, of baked light.

use fantex::Result;
use fantex::scene::world_bounds;
use std::sync::Arc;

use fantex::bake::{
    BakeLight, BakeOptions, LightMapOptions, LightMapSource, LightQuantity, LightScene, LookSource,
    Reflector, Sky, Source, SourceReflector, bake,
};
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::mesh::{Mesh, SurfacePoint};
use fantex::render::{
    Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Lights, LookSurface, RenderOptions, Shading,
    Surface, render,
};
use fantex::store::{Asset, Footprint, PageCache, Sampler};
use fantex::texture::environment::{EnvironmentForm, EnvironmentLayout, EnvironmentMap};
use fantex::texture::warp::{
    AffineMap, BilinearMap, PlaneMap, ProjectiveMap, Spread, warp_forward, warp_inverse,
};
use fantex::texture::{ColorSpace, Depth, Image, ImageTexture, SampleOptions, Wrap};
use glam::{DVec2, DVec3, Vec3};

use super::Gallery;
use crate::context::Context;
use crate::cover_pictures::cover_pictures;
use crate::scene::open_model;

pub(super) type Drawn = Result<Vec<(String, Image)>>;

/// What draws an entry's pictures.
pub(super) fn by_name(name: &str) -> Option<fn(&Gallery<'_>) -> Drawn> {
    match name {
        "cover" => Some(cover),
        "seamless" => Some(seamless),
        "warps" => Some(warps),
        "environments" => Some(environments),
        "light-map" => Some(light_map),
        _ => None,
    }
}

impl Gallery<'_> {
    fn options(&self, [width, height]: [u32; 2]) -> RenderOptions {
        let [width, height] = match self.width {
            Some(w) => [w, w * height / width],
            None => [width, height],
        };
        RenderOptions { width, height: height.max(1), ..RenderOptions::default() }
    }

    /// A picture no wider than wanted.
    fn reduced(&self, image: Image) -> Result<Image> {
        let Some(width) = self.width.filter(|&w| w < image.width) else { return Ok(image) };
        let size = [width, (width * image.height / image.width).max(1)];
        let [w, h] = size.map(f64::from);
        let corners = [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(w, h), DVec2::new(0.0, h)];
        let map = BilinearMap::from_quad(corners)?;
        let texture = ImageTexture::new(Arc::new(image));
        Ok(warp_inverse(&texture, &map, size, &SampleOptions::default())?
            .converted(Depth::U8, ColorSpace::Srgb))
    }
}

/// The three figures that explain a cover.
fn cover(gallery: &Gallery<'_>) -> Drawn {
    let mesh = open_model(&gallery.shipped.file("assets/models/spot.obj"))?;
    let options =
        CoverOptions { budget: TexelBudget::Total(1_000_000), tile: 128, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options)?;
    let pictures = cover_pictures(&mesh, &cover, &gallery.options([960, 720]))?;
    let captions = ["the cover", "the directions of projection", "the packed texture"];
    let drawn = captions.into_iter().zip(pictures);
    drawn
        .map(|(caption, picture)| Ok((caption.to_owned(), gallery.reduced(picture.to_srgb_image())?)))
        .collect()
}

/// A model with its texture coordinates, and baked into fan tiles.
fn seamless(gallery: &Gallery<'_>) -> Drawn {
    let mesh = open_model(&gallery.shipped.file("assets/WaterBottle/WaterBottle.gltf"))?;
    let (cover, _) = build_cover(
        &mesh,
        &CoverOptions { budget: TexelBudget::Total(2_000_000), ..CoverOptions::default() },
    )?;
    let options = gallery.options([480, 480]);
    let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 1.0);
    let lights = Lights::behind(&camera);
    let picture = |surface: &dyn Surface| -> Result<Image> {
        Ok(render(&mesh, surface, &camera, &lights, &options)?.picture.to_srgb_image())
    };
    let cache = baked(&mesh, &cover, &LookSource::of_model(&mesh)?, gallery)?;
    Ok(vec![
        (
            "texture coordinates".to_owned(),
            picture(&LookSurface::of_model(&mesh, FilterOptions::default())?)?,
        ),
        ("fan tiles".to_owned(), picture(&FanSurface::of_asset(&cache.cache, FilterOptions::default()))?),
    ])
}

struct Baked {
    cache: PageCache,
    _folder: tempfile::TempDir,
}

fn baked(
    mesh: &Mesh,
    cover: &fantex::cover::Cover,
    source: &dyn Source,
    gallery: &Gallery<'_>,
) -> Result<Baked> {
    let folder = Context::temporary_folder()?;
    let path = folder.path().join("drawing.fan");
    bake(mesh, cover, source, &path, &BakeOptions::default(), &gallery.context.progress("baking"))?;
    let cache = PageCache::new(Arc::new(Asset::open(&path)?), gallery.context.memory_bytes as usize);
    Ok(Baked { cache, _folder: folder })
}

/// An image through maps of the plane.
fn warps(gallery: &Gallery<'_>) -> Drawn {
    let photo = Image::load(gallery.shipped.file("assets/images/rocket.jpg"))?;
    let texture = ImageTexture::new(Arc::new(photo.clone()));
    let options = gallery.options([400, 320]);
    let size = [options.width, options.height];
    let [w, h] = size.map(f64::from);
    let at = |x: f64, y: f64| DVec2::new(x * w, y * h);
    let affine = AffineMap::from_points(
        [DVec2::ZERO, DVec2::X, DVec2::Y],
        [at(0.2, 0.1), at(0.95, 0.25), at(0.05, 0.8)],
    )?;
    let corners = [at(0.25, 0.15), at(0.75, 0.08), at(0.97, 0.92), at(0.05, 0.8)];
    let maps: [(&str, Box<dyn PlaneMap>); 3] = [
        ("affine", Box::new(affine)),
        ("perspective", Box::new(ProjectiveMap::from_quad(corners)?)),
        ("bilinear", Box::new(BilinearMap::from_quad(corners)?)),
    ];
    let sample = SampleOptions { wrap: [Wrap::Border; 2], ..SampleOptions::default() };
    let mut drawn = Vec::new();
    for (name, map) in &maps {
        let inverse = warp_inverse(&texture, map.as_ref(), size, &sample)?;
        drawn.push((format!("{name}, by the inverse"), inverse.converted(Depth::U8, ColorSpace::Srgb)));
    }
    let forward = warp_forward(&photo, maps[1].1.as_ref(), size, Spread::Area)?;
    drawn.push((
        "perspective, texels spread forward".to_owned(),
        forward.converted(Depth::U8, ColorSpace::Srgb),
    ));
    Ok(drawn)
}

/// Surroundings in several forms.
fn environments(gallery: &Gallery<'_>) -> Drawn {
    let map = EnvironmentMap::load(gallery.shipped.file("assets/images/forest.exr"))?;
    let side = gallery.width.unwrap_or(640) / 4;
    let forms = [
        ("latitude and longitude", EnvironmentForm::Sphere, EnvironmentLayout::Panorama, 2 * side),
        ("the cube, unfolded", EnvironmentForm::Cube, EnvironmentLayout::HorizontalCross, side),
        ("two paraboloids", EnvironmentForm::DualParaboloid, EnvironmentLayout::DualParaboloid, 2 * side),
    ];
    let draw = |(caption, form, layout, side): (&str, _, _, _)| {
        let image = map.converted(form, side).to_image(layout);
        Ok((caption.to_owned(), gallery.reduced(image.converted(Depth::U8, ColorSpace::Srgb))?))
    };
    forms.into_iter().map(draw).collect()
}

/// Light in a box with coloured walls, under a lamp: baked, then shown by the baked light alone and with the walls' colours.
fn light_map(gallery: &Gallery<'_>) -> Drawn {
    let mesh = open_model(&gallery.shipped.file("assets/models/CornellBox.glb"))?;
    let budget = TexelBudget::Total(50_000);
    let options = CoverOptions { budget, cut_creases: true, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options)?;
    let colors = LookSource::of_model(&mesh)?;
    let colors = SourceReflector::new(&mesh, &colors);
    // The lamp of the model is replaced by one that is sampled on purpose.
    let reflector = |at: SurfacePoint| colors.albedo(at);
    let bounds = world_bounds(&mesh);
    let size = bounds.max - bounds.min;
    let position = bounds.center() + DVec3::new(0.0, 0.38 * size.y, 0.0);
    let strength = (0.55 * size.y).powi(2) as f32;
    let lamp =
        BakeLight::Point { position, color: Vec3::new(1.0, 0.85, 0.6) * strength, radius: 0.1 * size.x };
    let night = |_: Vec3| Vec3::ZERO;
    let day = |_: Vec3| Vec3::ONE;
    let camera = Camera {
        eye: bounds.center() + DVec3::new(0.0, 0.0, 1.75 * size.z),
        target: bounds.center(),
        up: DVec3::Y,
        fov_degrees: 40.0,
    };
    let options = gallery.options([400, 400]);
    let kinds = [
        ("direct light", LightQuantity::Direct, false),
        ("ambient occlusion", LightQuantity::AmbientOcclusion, false),
        ("direct and reflected light", LightQuantity::Full, false),
        ("times the texture", LightQuantity::Full, true),
    ];
    let mut drawn = Vec::new();
    for (caption, quantity, is_colored) in kinds {
        let is_open = quantity == LightQuantity::AmbientOcclusion;
        let lights = if is_open { Vec::new() } else { vec![lamp] };
        let sky: &dyn Sky = if is_open { &day } else { &night };
        let scene = LightScene { lights, sky, reflector: &reflector };
        let light_options = LightMapOptions { quantity, samples: 512, ..LightMapOptions::default() };
        let source = LightMapSource::new(&mesh, &scene, light_options)?;
        let asset = baked(&mesh, &cover, &source, gallery)?;
        let sampler = Sampler::of_cache(&asset.cache, FilterOptions::default());
        let surface = FlatSurface::new(&mesh, FlatShading::Smooth, |hit| {
            let light = sampler.sample_channel(0, hit.at, Footprint::NONE);
            let color = if is_colored { reflector(hit.at) } else { Vec3::ONE };
            light.truncate() * color
        });
        let options = RenderOptions { shading: Shading::BaseColor, ..options.clone() };
        let picture = render(&mesh, &surface, &camera, &Lights::behind(&camera), &options)?.picture;
        drawn.push((caption.to_owned(), picture.to_srgb_image()));
    }
    Ok(drawn)
}
