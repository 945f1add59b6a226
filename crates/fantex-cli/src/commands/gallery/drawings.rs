//! Pictures that no look can make: of fans and covers, of maps between images, of surroundings unfolded, of baked light, of streaming.

mod library;
mod steps;
mod streaming;

use fantex::scene::world_bounds;
use fantex::{Error, Result};
use std::sync::Arc;

use fantex::bake::{
    BakeLight, BakeOptions, LightMapOptions, LightMapSource, LightQuantity, LightScene, LookSource,
    Reflector, Sky, Source, SourceReflector, bake,
};
use fantex::base::files::{TemporaryFolder, scratch_folder};
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::mesh::{Mesh, SurfacePoint};
use fantex::render::{
    Camera, FilterOptions, FlatShading, FlatSurface, Lights, RenderOptions, Shading, render,
};
use fantex::store::{Asset, Footprint, PageCache, Sampler};
use fantex::texture::environment::{EnvironmentForm, EnvironmentLayout, EnvironmentMap};
use fantex::texture::warp::{
    AffineMap, BilinearMap, PlaneMap, ProjectiveMap, Spread, warp_forward, warp_inverse,
};
use fantex::texture::{AlphaUse, ColorSpace, Depth, Image, ImageTexture, SampleOptions, Wrap};
use glam::{DVec2, DVec3, Vec3};

use super::Gallery;
use crate::cover_pictures::{cover_pictures, group_colors};
use crate::scene::open_model;

/// Captions and pictures.
pub(super) type Pictures = Result<Vec<(String, Image)>>;

/// What draws an entry's pictures.
pub(super) fn by_name(name: &str) -> Option<fn(&Gallery<'_>) -> Pictures> {
    match name {
        "steps" => Some(steps::steps),
        "cover" => Some(cover),
        "pyramid" => Some(pyramid),
        "gouraud" => Some(gouraud),
        "warps" => Some(warps),
        "environments" => Some(environments),
        "light-map" => Some(light_map),
        "evaluation" => Some(evaluation),
        "arrival" => Some(streaming::arrival),
        "levels" => Some(streaming::levels),
        "reads" => Some(streaming::reads),
        "pools" => Some(streaming::pools),
        "library" => Some(library_picture),
        _ => None,
    }
}

/// The program that drew an entry's pictures, where that is what it shows.
pub(super) fn code_of(name: &str) -> Option<&'static str> {
    (name == "library").then_some(include_str!("drawings/library.rs"))
}

impl Gallery<'_> {
    /// The baked mountain, made when it is first asked for.
    fn terrain(&self) -> Result<&Baked> {
        if self.terrain.get().is_none() {
            let folder = scratch_folder()?;
            let path = folder.path().join("terrain.fan");
            streaming::bake_terrain(self, &path)?;
            let cache = PageCache::new(Arc::new(Asset::open(&path)?), self.context.memory_bytes as usize);
            return Ok(self.terrain.get_or_init(|| Baked { cache, _folder: folder }));
        }
        self.terrain.get().ok_or_else(|| Error::invalid("no terrain"))
    }

    fn options(&self, [width, height]: [u32; 2]) -> RenderOptions {
        let [width, height] = match self.width {
            Some(w) => [w, w * height / width],
            None => [width, height],
        };
        RenderOptions { width, height: height.max(1), ..RenderOptions::default() }
    }

    /// A picture no wider than wanted.
    pub(super) fn reduced(&self, image: Image) -> Result<Image> {
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
fn cover(gallery: &Gallery<'_>) -> Pictures {
    let mesh = open_model(&gallery.shipped.file("assets/models/spot.obj"), gallery.context)?;
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

pub(super) struct Baked {
    cache: PageCache,
    _folder: TemporaryFolder,
}

fn baked(
    mesh: &Mesh,
    cover: &fantex::cover::Cover,
    source: &dyn Source,
    gallery: &Gallery<'_>,
) -> Result<Baked> {
    let folder = scratch_folder()?;
    let path = folder.path().join("drawing.fan");
    bake(mesh, cover, source, &path, &BakeOptions::default(), &gallery.context.progress("baking"))?;
    let cache = PageCache::new(Arc::new(Asset::open(&path)?), gallery.context.memory_bytes as usize);
    Ok(Baked { cache, _folder: folder })
}

/// An image through maps of the plane.
fn warps(gallery: &Gallery<'_>) -> Pictures {
    let photo = Image::load(gallery.shipped.file("assets/images/uv_checker_bw.png"))?;
    let texture = ImageTexture::new(Arc::new(photo.clone()));
    let options = gallery.options([960, 768]);
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

/// An image and its levels, each half as long as the one before.
fn pyramid(gallery: &Gallery<'_>) -> Pictures {
    let photo = Image::load(gallery.shipped.file("assets/images/coffee.jpg"))?;
    let mut level = photo.resized(512, 342, AlphaUse::Coverage);
    let mut levels = vec![level.clone()];
    while level.width.max(level.height) > 1 {
        level = level.resized((level.width / 2).max(1), (level.height / 2).max(1), AlphaUse::Coverage);
        levels.push(level.clone());
    }
    let gap = 8;
    let width = levels.iter().map(|level| level.width + gap).sum::<u32>() + gap;
    let height = levels[0].height + 2 * gap;
    let mut texels = vec![[0.9, 0.9, 0.9, 1.0]; (width * height) as usize];
    let mut left = gap;
    for level in &levels {
        for (x, y) in (0..level.height).flat_map(|y| (0..level.width).map(move |x| (x, y))) {
            texels[((gap + y) * width + left + x) as usize] = level.linear_texel(x, y);
        }
        left += level.width + gap;
    }
    let picture = Image::from_linear_rgb(width, height, &texels).converted(Depth::U8, ColorSpace::Srgb);
    Ok(vec![("512 x 342 texels down to one".to_owned(), gallery.reduced(picture)?)])
}

/// Light of the vertices, interpolated, beside light of the pixels.
fn gouraud(gallery: &Gallery<'_>) -> Pictures {
    let mesh = fantex::Mesh::from_model(fantex::mesh::generate::icosphere(2), "ball")?;
    let options = RenderOptions { shading: Shading::BaseColor, ..gallery.options([960, 720]) };
    let aspect = f64::from(options.width) / f64::from(options.height);
    let camera = Camera::framing_mesh(&mesh, DVec3::Z, aspect);
    let to_light = Vec3::new(-0.35, 0.45, 0.8).normalize();
    let half = (to_light + Vec3::Z).normalize();
    let light = |normal: Vec3| {
        let color = Vec3::new(0.7, 0.2, 0.1) * (0.15 + normal.dot(to_light).max(0.0));
        color + Vec3::splat(0.8 * normal.dot(half).max(0.0).powi(60))
    };
    let picture = |color: &(dyn Fn(SurfacePoint) -> Vec3 + Sync)| -> Result<Image> {
        let surface = FlatSurface::new(&mesh, FlatShading::Smooth, |hit| color(hit.at));
        Ok(render(&mesh, &surface, &camera, &Lights::behind(&camera), &options)?.picture.to_srgb_image())
    };
    let corners = |at: SurfacePoint| mesh.triangle_positions(at.index()).map(Vec3::normalize);
    Ok(vec![
        (
            "per vertex, interpolated (Gouraud)".to_owned(),
            picture(&|at| at.interpolate(corners(at).map(light)))?,
        ),
        ("per pixel".to_owned(), picture(&|at| light(at.interpolate(corners(at)).normalize()))?),
    ])
}

/// How a point's value is found: its place in its triangle, the tiles that answer there, their blend.
fn evaluation(gallery: &Gallery<'_>) -> Pictures {
    let mesh = open_model(&gallery.shipped.file("assets/models/suzanne.ply"), gallery.context)?;
    let options = CoverOptions { budget: TexelBudget::Total(100_000), tile: 0, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options)?;
    let colors = group_colors(&cover);
    let options = gallery.options([960, 720]);
    let aspect = f64::from(options.width) / f64::from(options.height);
    let camera =
        Camera { fov_degrees: 9.0, ..Camera::framing_mesh(&mesh, DVec3::new(0.2, 0.15, 1.0), aspect) };
    let picture = |color: &(dyn Fn(SurfacePoint) -> Vec3 + Sync)| -> Result<Image> {
        let surface = FlatSurface::new(&mesh, FlatShading::Smooth, |hit| color(hit.at));
        Ok(render(&mesh, &surface, &camera, &Lights::behind(&camera), &options)?.picture.to_srgb_image())
    };
    let taps = |at: SurfacePoint| cover.taps(&mesh, at);
    let steps = [Vec3::new(0.1, 0.2, 0.5), Vec3::new(0.8, 0.6, 0.1), Vec3::new(0.8, 0.1, 0.1)];
    Ok(vec![
        ("barycentric coordinates as red, green and blue".to_owned(), picture(&|at| at.lambda)?),
        (
            "how many tiles are read: one (blue), two (yellow), three (red)".to_owned(),
            picture(&|at| steps[taps(at).len().clamp(1, 3) - 1])?,
        ),
        (
            "the weighted sum of the tiles".to_owned(),
            picture(&|at| taps(at).map(|tap| colors[tap.group as usize] * tap.weight).sum())?,
        ),
    ])
}

/// What the program in `library.rs` draws.
fn library_picture(gallery: &Gallery<'_>) -> Pictures {
    let folder = scratch_folder()?;
    let picture = library::draw(folder.path(), &gallery.options([960, 720]))?;
    Ok(vec![("a function of the surface, baked and rendered".to_owned(), picture)])
}

/// Surroundings in several forms.
fn environments(gallery: &Gallery<'_>) -> Pictures {
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
fn light_map(gallery: &Gallery<'_>) -> Pictures {
    let mesh = open_model(&gallery.shipped.file("assets/models/CornellBox.glb"), gallery.context)?;
    let budget = TexelBudget::Total(16_000);
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
    let options = gallery.options([960, 960]);
    let kinds: [(_, &[_]); 3] = [
        (LightQuantity::Direct, &[("direct light", false)]),
        (LightQuantity::AmbientOcclusion, &[("ambient occlusion", false)]),
        (
            LightQuantity::Full,
            &[("direct and reflected light: the light map", false), ("light map times texture", true)],
        ),
    ];
    let mut drawn = Vec::new();
    for (quantity, pictures) in kinds {
        let is_open = quantity == LightQuantity::AmbientOcclusion;
        let lights = if is_open { Vec::new() } else { vec![lamp] };
        let sky: &dyn Sky = if is_open { &day } else { &night };
        let scene = LightScene { lights, sky, reflector: &reflector };
        let light_options = LightMapOptions { quantity, samples: 256, ..LightMapOptions::default() };
        let source = LightMapSource::new(&mesh, &scene, light_options)?;
        let asset = baked(&mesh, &cover, &source, gallery)?;
        let sampler = Sampler::of_cache(&asset.cache, FilterOptions::default());
        for &(caption, is_colored) in pictures {
            let surface = FlatSurface::new(&mesh, FlatShading::Smooth, |hit| {
                let light = sampler.sample_channel(0, hit.at, Footprint::NONE);
                let color = if is_colored { reflector(hit.at) } else { Vec3::ONE };
                light.truncate() * color
            });
            let options = RenderOptions { shading: Shading::BaseColor, ..options.clone() };
            let picture = render(&mesh, &surface, &camera, &Lights::behind(&camera), &options)?.picture;
            drawn.push((caption.to_owned(), picture.to_srgb_image()));
        }
    }
    Ok(drawn)
}
