//! From a model to an asset to a picture: what was baked looks like what it was baked from, and shows no seam.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

use fantex_bake::{BakeFormat, BakeOptions, LookSource, NoProgress, SineSource, Source, bake};
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_mesh::generate::torus;
use fantex_mesh::{CleanOptions, ImageSource, Mesh, TextureRef, WrapMode, clean};
use fantex_render::{
    Background, Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Hit, Lights, LookSurface,
    Picture, RenderOptions, Shading, Surface, render,
};
use fantex_store::{Asset, PageCache, Sampler};
use fantex_texture::{ColorSpace, Filter, Image, Samples};
use glam::{DVec3, Mat3, Vec2, Vec3};

const CACHE_BYTES: usize = 64 << 20;

/// Of the pictures.
const SIZE: [u32; 2] = [480, 360];

fn torus_mesh() -> Mesh {
    clean(torus(64, 32), &CleanOptions::default()).unwrap().0
}

/// The image three times around the torus and once across, for every corner.
fn torus_uv(mesh: &Mesh) -> Vec<Vec2> {
    let angles = |v: u32| {
        let p = mesh.world_from_mesh.point(mesh.positions[v as usize]);
        let around = (-p.z).atan2(p.x);
        let across = p.y.atan2(p.x.hypot(p.z) - 1.0);
        [3.0 * around / TAU, -across / TAU]
    };
    let near = |value: f64, other: f64, period: f64| value - ((value - other) / period).round() * period;
    let corners_of = |triangle: &[u32; 3]| {
        let corners = triangle.map(angles);
        corners
            .map(|[u, v]| Vec2::new(near(u, corners[0][0], 3.0) as f32, near(v, corners[0][1], 1.0) as f32))
    };
    mesh.triangles.iter().flat_map(corners_of).collect()
}

/// Saves an image without seams: a function of the angles of its texels.
fn save_image(path: &Path, color: impl Fn(f64, f64) -> [f64; 3]) -> ImageSource {
    const SIDE: u32 = 128;
    let angle = |i: u32| TAU * (f64::from(i) + 0.5) / f64::from(SIDE);
    let samples = (0..SIDE * SIDE)
        .flat_map(|i| color(angle(i % SIDE), angle(i / SIDE)))
        .map(|c| (c.clamp(0.0, 1.0) * 65535.0).round() as u16)
        .collect();
    let image = Image {
        width: SIDE,
        height: SIDE,
        channels: 3,
        space: ColorSpace::Linear,
        samples: Samples::U16(samples),
    };
    image.save(path).unwrap();
    ImageSource::File(path.into())
}

/// A torus with colours, bumps, occlusion, roughness, metal and factors on all of them.
fn textured_torus(folder: &Path) -> Mesh {
    let mut mesh = torus_mesh();
    mesh.corners.uv_sets = vec![torus_uv(&mesh)];
    let texture = |image| TextureRef {
        image,
        uv_set: 0,
        uv_transform: Mat3::IDENTITY,
        wrap: [WrapMode::Repeat; 2],
        nearest: false,
    };
    mesh.images = vec![
        save_image(&folder.join("color.png"), |u, v| {
            let wave = (2.0 * u).sin() * (3.0 * v + u).cos();
            [0.5 + 0.4 * wave, 0.5 + 0.3 * v.sin(), 0.5 - 0.4 * wave]
        }),
        save_image(&folder.join("normal.png"), |u, v| {
            let slopes = [0.3 * (4.0 * u).sin(), 0.4 * (6.0 * v).cos()];
            let normal = DVec3::new(slopes[0], slopes[1], 1.0).normalize();
            (normal * 0.5 + 0.5).to_array()
        }),
        save_image(&folder.join("surface.png"), |u, v| {
            [0.7 + 0.3 * u.cos(), 0.6 + 0.2 * (u + v).sin(), 0.5 + 0.5 * (2.0 * v).sin()]
        }),
    ];
    let material = &mut mesh.materials[0];
    material.base_color_texture = Some(texture(0));
    material.base_color.y = 0.8;
    material.normal_texture = Some(texture(1));
    material.normal_scale = 0.8;
    material.metallic_roughness_texture = Some(texture(2));
    (material.metallic, material.roughness) = (0.5, 0.9);
    material.occlusion_texture = Some(texture(2));
    material.occlusion_strength = 0.7;
    mesh
}

/// Bakes and opens an asset.
fn asset(folder: &Path, mesh: &Mesh, cover: &Cover, source: &dyn Source, format: BakeFormat) -> PageCache {
    let path = folder.join(format!("{format:?}.fan"));
    let options = BakeOptions { format, ..BakeOptions::default() };
    bake(mesh, cover, source, &path, &options, &NoProgress).unwrap();
    PageCache::new(Arc::new(Asset::open(&path).unwrap()), CACHE_BYTES)
}

fn picture(mesh: &Mesh, surface: &dyn Surface, camera: &Camera, shading: Shading, samples: u32) -> Picture {
    let options = RenderOptions {
        width: SIZE[0],
        height: SIZE[1],
        samples,
        shading,
        background: Background::Transparent,
        ..RenderOptions::default()
    };
    render(mesh, surface, camera, &Lights::default(), &options).unwrap().picture
}

/// PSNR in dB of linear values, cut off at the white of the screen, over the pixels that the model covers.
fn psnr_db(a: &Picture, b: &Picture) -> f64 {
    let covered = || a.rgba.iter().zip(&b.rgba).filter(|(a, _)| a[3] == 1.0);
    let squares: f64 =
        covered().flat_map(|(a, b)| (0..3).map(|c| f64::from(a[c].min(1.0) - b[c].min(1.0)).powi(2))).sum();
    assert!(covered().count() > 10_000, "the model is in the picture");
    -10.0 * (squares / (3 * covered().count()) as f64).log10()
}

/// The least PSNR over some views of the asset against the model.
fn least_psnr_db(mesh: &Mesh, cache: &PageCache, filter: FilterOptions, shading: Shading) -> f64 {
    let model = LookSurface::of_model(mesh, filter).unwrap();
    let baked = FanSurface::of_asset(cache, filter);
    Camera::orbit(mesh, 2, 4.0 / 3.0)
        .iter()
        .map(|camera| {
            let [a, b] = [&model as &dyn Surface, &baked].map(|s| picture(mesh, s, camera, shading, 2));
            psnr_db(&a, &b)
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn an_asset_looks_like_the_model_it_was_baked_from() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = textured_torus(folder.path());
    let source = LookSource::of_model(&mesh).unwrap();
    let budget = TexelBudget::PerTriangle(source.density());
    let (cover, _) = build_cover(&mesh, &CoverOptions { budget, ..CoverOptions::default() }).unwrap();
    let [float, blocks] = [BakeFormat::Float, BakeFormat::Bc7]
        .map(|format| asset(folder.path(), &mesh, &cover, &source, format));
    // With floats, what is left is resampling; with blocks, their quantisation comes on top. Filters whose footprints are
    // round in texels differ more, since the texels of an image are stretched on the surface and those of tiles are not.
    let least_db =
        [(Filter::Anisotropic, 60.0, 44.0), (Filter::Trilinear, 53.0, 44.0), (Filter::Ewa, 48.0, 43.0)];
    let inputs = [Shading::BaseColor, Shading::Normal, Shading::OcclusionRoughnessMetallic];
    let lit = [Shading::BlinnPhong, Shading::MetallicRoughness];
    for (filter, float_db, blocks_db) in least_db {
        // Lighting has no part in how textures are filtered.
        let lit = if filter == Filter::Anisotropic { &lit[..] } else { &[] };
        let options = FilterOptions { filter, ..FilterOptions::default() };
        for &shading in inputs.iter().chain(lit) {
            for (name, cache, expected) in [("floats", &float, float_db), ("blocks", &blocks, blocks_db)] {
                let db = least_psnr_db(&mesh, cache, options, shading);
                assert!(db > expected, "{filter:?}, {shading:?}, {name}: {db:.1} dB");
            }
        }
    }
}

/// A camera close to the torus' outer side.
fn close_up() -> Camera {
    Camera {
        eye: DVec3::new(1.9, 0.5, 0.4),
        target: DVec3::new(1.35, 0.1, 0.0),
        up: DVec3::Y,
        fov_degrees: 10.0,
    }
}

#[test]
fn a_close_up_across_group_borders_shows_no_seam() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = torus_mesh();
    let budget = TexelBudget::Total(1 << 18);
    let (cover, _) =
        build_cover(&mesh, &CoverOptions { budget, tile: 32, ..CoverOptions::default() }).unwrap();
    let source = SineSource { k: TAU as f32 * cover.density / TEXELS_PER_WAVE };
    let view = CloseUp::new(&mesh, &cover);
    assert!(view.crossings > 1000, "only {} pixels at borders of groups", view.crossings);
    for (format, largest_error, largest_jump) in
        [(BakeFormat::Float, 0.01, 1e-4), (BakeFormat::Bc7, 0.03, 2e-3)]
    {
        let cache = asset(folder.path(), &mesh, &cover, &source, format);
        let seen = view.seen(&FanSurface::of_asset(&cache, BILINEAR));
        let error = view.largest_error(&seen, &source);
        assert!(error < largest_error, "{format:?}: off by {error}");
        let jump = view.largest_jump(&seen, &source);
        assert!(jump < largest_jump, "{format:?}: jumps by {jump} more than the function");

        // The measure sees what blending hides.
        let unblended = Cover { delta: 1e-6, ..cover.clone() };
        let (mesh, channels) = (cache.asset().shared_mesh(), cache.asset().channels());
        let sampler = Sampler::new(mesh, Arc::new(unblended), channels, cache.clone(), BILINEAR);
        let seen = view.seen(&FanSurface::new(sampler));
        let seam = view.largest_jump(&seen, &source);
        assert!(seam > 2.0 * largest_jump, "{format:?}: without blending, seams of only {seam}");
    }
}

const TEXELS_PER_WAVE: f32 = 16.0;
const BILINEAR: FilterOptions = FilterOptions { filter: Filter::Bilinear, max_anisotropy: 1.0 };

/// A view of a mesh so close that a texel covers many pixels.
struct CloseUp<'a> {
    mesh: &'a Mesh,
    camera: Camera,
    /// The point under each pixel, where there is one.
    points: Vec<Option<Vec3>>,
    /// Neighbouring pixels whose points belong to different groups.
    crossings: usize,
}

impl<'a> CloseUp<'a> {
    fn new(mesh: &'a Mesh, cover: &Cover) -> Self {
        let camera = close_up();
        let flat = |color: &(dyn Fn(&Hit) -> Vec3 + Sync)| {
            let surface = FlatSurface::new(mesh, FlatShading::Unlit, color);
            picture(mesh, &surface, &camera, Shading::BaseColor, 1).rgba
        };
        let points = flat(&|hit| hit.position(mesh));
        let groups = flat(&|hit| {
            let nearest = hit.at.lambda.max_position();
            Vec3::splat(cover.corner_groups[hit.triangle()][nearest] as f32)
        });
        let points = points.iter().map(|c| (c[3] == 1.0).then(|| Vec3::from_slice(c))).collect();
        let crossings = neighbours().filter(|&(a, b)| groups[a] != groups[b]).count();
        Self { mesh, camera, points, crossings }
    }

    fn seen(&self, surface: &dyn Surface) -> Vec<f32> {
        let picture = picture(self.mesh, surface, &self.camera, Shading::BaseColor, 1);
        picture.rgba.iter().map(|c| c[0]).collect()
    }

    fn largest_error(&self, seen: &[f32], source: &SineSource) -> f32 {
        let errors =
            self.points.iter().zip(seen).filter_map(|(&p, value)| Some((value - source.value(p?)).abs()));
        errors.fold(0.0, f32::max)
    }

    /// By how much neighbouring pixels differ more than the steepest slope of the function lets them.
    fn largest_jump(&self, seen: &[f32], source: &SineSource) -> f32 {
        // The gradient of a sum of three sines over six.
        let steepest = source.k * 3f32.sqrt() / 6.0;
        let jump = |(a, b): (usize, usize)| {
            let distance = self.points[a]?.distance(self.points[b]?);
            Some((seen[a] - seen[b]).abs() - steepest * distance)
        };
        neighbours().filter_map(jump).fold(0.0, f32::max)
    }
}

/// Indices of pixels side by side and one above the other.
fn neighbours() -> impl Iterator<Item = (usize, usize)> {
    let [width, height] = SIZE.map(|n| n as usize);
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y))).flat_map(move |(x, y)| {
        let here = y * width + x;
        let right = (x + 1 < width).then_some((here, here + 1));
        let below = (y + 1 < height).then_some((here, here + width));
        right.into_iter().chain(below)
    })
}
