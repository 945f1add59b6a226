//! Fan surfaces: the texture function under all filters, against closed forms and against the same image by UV.

use std::sync::{Arc, LazyLock};

use fantex_cover::{Cover, Frame, Group, GroupKind, UnfoldedCorners};
use fantex_mesh::{AlphaMode, ImageSource, Material, Mesh, SurfacePoint, TextureRef, WrapMode, interpolate};
use fantex_render::{
    Background, Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Hit, Lights, LookSurface,
    MaterialSample, Picture, RenderOptions, Rendering, Shading, Surface, render,
};
use fantex_store::{
    Asset, AssetWriter, Channel, ChannelKind, CreateOptions, EncodedPage, PageCache, PageId, Quality,
    TexelFormat, TexelSlice, encode, group_pages,
};
use fantex_texture::{ColorSpace, Filter, Image, ImageTexture, Samples};
use glam::{DVec3, Mat3, Vec2, Vec3};
use proptest::prelude::*;

use crate::common::{MemoryTile, MemoryTiles, bake, fan_cover, fan_surface, frontal, ray, sheet, square};

fn options(shading: Shading) -> RenderOptions {
    let background = Background::Transparent;
    RenderOptions { width: 120, height: 80, samples: 1, shading, background, ..RenderOptions::default() }
}

fn rendering(mesh: &Mesh, surface: &dyn Surface, camera: &Camera, options: &RenderOptions) -> Rendering {
    render(mesh, surface, camera, &Lights::default(), options).unwrap()
}

fn channel(kind: ChannelKind) -> Channel {
    Channel { kind, format: TexelFormat::Rgba32F, srgb: false }
}

fn filter(filter: Filter) -> FilterOptions {
    FilterOptions { filter, ..FilterOptions::default() }
}

fn oblique() -> Camera {
    Camera {
        eye: DVec3::new(0.5, -1.6, 0.9),
        target: DVec3::new(0.0, 0.1, 0.0),
        up: DVec3::Z,
        fov_degrees: 45.0,
    }
}

/// Largest difference of any colour channel where both pictures are opaque.
fn largest_difference(a: &Picture, b: &Picture) -> f32 {
    let both = a.rgba.iter().zip(&b.rgba).filter(|(a, b)| a[3] == 1.0 && b[3] == 1.0);
    both.flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).abs())).fold(0.0, f32::max)
}

/// Makes transparent what lies outside the square `|x|, |y| < reach` of the mesh.
fn within(reach: f32, mut picture: Picture, mesh: &Mesh, camera: &Camera) -> Picture {
    let positions = FlatSurface::new(mesh, FlatShading::Unlit, |hit: &Hit| hit.position(mesh));
    let positions = rendering(mesh, &positions, camera, &options(Shading::BaseColor)).picture;
    for (pixel, p) in picture.rgba.iter_mut().zip(&positions.rgba) {
        if p[0].abs().max(p[1].abs()) > reach {
            pixel[3] = 0.0;
        }
    }
    picture
}

/// A smooth colour in space.
fn color(p: Vec3) -> Vec3 {
    let wave = |k: f32| 0.5 + 0.4 * (3.0 * p.x + k).sin() * (2.0 * p.y - k).cos();
    Vec3::new(wave(0.0), wave(1.0), 0.5 + p.z)
}

fn bumpy_sheet() -> Mesh {
    Mesh { materials: vec![Material::default()], ..sheet(5, 0.08, 11) }
}

fn color_tiles(mesh: &Mesh, cover: &Cover) -> MemoryTiles {
    MemoryTiles { levels: vec![bake(mesh, cover, |p, _, _| color(p).extend(1.0).to_array())] }
}

#[test]
fn every_filter_gives_back_a_smooth_colour() {
    let mesh = bumpy_sheet();
    let cover = fan_cover(&mesh, [64, 64]);
    let tiles = color_tiles(&mesh, &cover);
    let truth = FlatSurface::new(&mesh, FlatShading::Unlit, |hit: &Hit| color(hit.position(&mesh)));
    let truth = rendering(&mesh, &truth, &oblique(), &options(Shading::BaseColor)).picture;
    // At the sheet's border texels lie half beside it.
    let truth = within(0.95, truth, &mesh, &oblique());
    for f in Filter::ALL {
        let surface = fan_surface(&mesh, &cover, &[channel(ChannelKind::BaseColor)], &tiles, filter(f));
        let seen = rendering(&mesh, &surface, &oblique(), &options(Shading::BaseColor));
        let difference = largest_difference(&truth, &seen.picture);
        // Half a texel's change for the nearest texel; coarser levels where the sheet is seen from the side.
        assert!(difference < 0.02, "{f:?}: {difference}");
        assert!(seen.stats.lookups >= seen.stats.shaded && seen.stats.lookups < 2 * seen.stats.shaded);
    }
}

#[test]
fn far_away_a_surface_has_its_mean_colour() {
    let mesh = bumpy_sheet();
    let cover = fan_cover(&mesh, [64, 64]);
    let tiles = color_tiles(&mesh, &cover);
    let truth = FlatSurface::new(&mesh, FlatShading::Unlit, |hit: &Hit| color(hit.position(&mesh)));
    let camera = frontal(60.0, 10.0);
    let truth =
        rendering(&mesh, &truth, &camera, &RenderOptions { samples: 64, ..options(Shading::BaseColor) });
    for f in [Filter::Trilinear, Filter::Anisotropic, Filter::Ewa] {
        let surface = fan_surface(&mesh, &cover, &[channel(ChannelKind::BaseColor)], &tiles, filter(f));
        let seen = rendering(
            &mesh,
            &surface,
            &camera,
            &RenderOptions { samples: 16, ..options(Shading::BaseColor) },
        );
        let difference = largest_difference(&truth.picture, &seen.picture);
        assert!(difference < 0.08, "{f:?}: {difference}");
    }
}

#[test]
fn normals_of_different_frames_meet_in_mesh_space() {
    let mut mesh = bumpy_sheet();
    let bent = |p: Vec3| Vec3::new(0.3 * (4.0 * p.x).sin(), -0.2, 1.0).normalize();
    // Vertex normals that are neither the facets' nor the frames'.
    mesh.corners.normals = mesh
        .triangles
        .iter()
        .flatten()
        .map(|&v| Vec3::new(0.1 * (v as f32).sin(), 0.1 * (v as f32).cos(), 1.0).normalize())
        .collect();
    let cover = fan_cover(&mesh, [64, 64]);
    let stored = |p: Vec3, hit: Option<(usize, Vec3)>, frame: &Frame| {
        let Some((t, lambda)) = hit else {
            return [0.5; 4];
        };
        let n = &mesh.corners.normals[3 * t..3 * t + 3];
        let z = interpolate([n[0], n[1], n[2]], lambda).normalize();
        // Rodrigues' rotation about direction x z, written out.
        let axis = frame.direction.cross(z);
        let (sin, cos) = (axis.length(), frame.direction.dot(z));
        let k = axis / sin;
        let x = frame.x_axis * cos + k.cross(frame.x_axis) * sin + k * k.dot(frame.x_axis) * (1.0 - cos);
        let m = bent(p);
        [m.dot(x) * 0.5 + 0.5, m.dot(z.cross(x)) * 0.5 + 0.5, 0.0, 1.0]
    };
    let tiles = MemoryTiles { levels: vec![bake(&mesh, &cover, stored)] };
    let surface =
        fan_surface(&mesh, &cover, &[channel(ChannelKind::Normal)], &tiles, filter(Filter::Bilinear));
    let seen = rendering(&mesh, &surface, &oblique(), &options(Shading::Normal)).picture;
    let truth =
        FlatSurface::new(&mesh, FlatShading::Unlit, |hit: &Hit| bent(hit.position(&mesh)) * 0.5 + 0.5);
    let truth = rendering(&mesh, &truth, &oblique(), &options(Shading::BaseColor)).picture;
    let difference = largest_difference(&within(0.9, truth, &mesh, &oblique()), &seen);
    assert!(difference < 2e-3, "{difference}");
    bent_normals_change_from_pixel_to_pixel(&mesh, &cover, &tiles, bent);
}

/// Mirrored surroundings are filtered over the change of the bent normal, on either side.
fn bent_normals_change_from_pixel_to_pixel(
    mesh: &Mesh,
    cover: &Cover,
    tiles: &MemoryTiles,
    bent: impl Fn(Vec3) -> Vec3,
) {
    let mut mirror = mesh.clone();
    mirror.materials[0].roughness = 0.1;
    let channels = [channel(ChannelKind::Normal)];
    let surface = fan_surface(&mirror, cover, &channels, tiles, filter(Filter::Bilinear));
    for triangle in (0..mesh.triangles.len())
        .filter(|&t| mesh.triangle_positions(t).iter().all(|p| p.truncate().abs().max_element() < 0.8))
    {
        let at = SurfacePoint { triangle: triangle as u32, lambda: Vec3::new(0.3, 0.3, 0.4) };
        let lambda_steps = [Vec3::new(0.1, -0.1, 0.0), Vec3::new(-0.05, -0.05, 0.1)];
        for front in [true, false] {
            let hit = Hit { at, lambda_steps, front, to_eye: Vec3::Z };
            let steps = surface.shade(&hit).0.normal_steps;
            let p = hit.position(mesh);
            for (step, lambda) in steps.into_iter().zip(lambda_steps) {
                let moved = Hit { at: SurfacePoint { lambda: at.lambda + lambda, ..at }, ..hit };
                let change = bent(moved.position(mesh)) - bent(p);
                let expected = if front { change } else { -change };
                assert!((step - expected).length() < 6e-3, "{triangle}: {step} instead of {expected}");
            }
        }
    }
}

/// A square with an image by texture coordinates, and the same image as the tile of its only group.
fn twice_the_same(size: u32, texel: impl Fn(u32, u32) -> [f32; 4]) -> (Mesh, Cover, MemoryTiles) {
    let values = (0..size * size).flat_map(|i| texel(i % size, i / size));
    let samples = Samples::U16(values.map(|v| (v * 65535.0).round() as u16).collect());
    let image = Image { width: size, height: size, channels: 4, space: ColorSpace::Linear, samples };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.png");
    image.save(&path).unwrap();
    let bytes = Arc::from(std::fs::read(path).unwrap());

    let mut mesh = square();
    mesh.images = vec![ImageSource::Embedded { label: "image".into(), bytes }];
    let (uv_transform, wrap) = (Mat3::IDENTITY, [WrapMode::Clamp; 2]);
    mesh.materials[0].roughness = 0.0;
    mesh.materials[0].occlusion_texture =
        Some(TextureRef { image: 0, uv_set: 0, uv_transform, wrap, nearest: false });

    // The tile's v axis points upwards, the image's downwards.
    let frame = Frame { origin: Vec3::ZERO, direction: Vec3::Z, x_axis: Vec3::X };
    let (uv_scale, uv_offset) = (Vec2::ONE, Vec2::splat(0.5));
    let group = Group { kind: GroupKind::Projected, frame, uv_scale, uv_offset, extent: [size; 2] };
    let texture = ImageTexture::new(Arc::new(image));
    let level = |level: u32| {
        let image = texture.level(level as usize);
        let rgba = (0..image.width * image.height)
            .map(|i| image.linear_texel(i % image.width, image.height - 1 - i / image.width))
            .collect();
        MemoryTile { extent: [image.width, image.height], rgba }
    };
    let tiles = MemoryTiles { levels: vec![vec![(0..group.level_count()).map(level).collect()]] };
    let corner_groups = vec![[0; 3]; 2];
    let cover = Cover {
        delta: 0.2,
        density: 1.0,
        is_creased: false,
        hard_edges: None,
        is_paired_by_angle: false,
        corner_groups,
        groups: vec![group],
        unfolded: UnfoldedCorners::default(),
    };
    (mesh, cover, tiles)
}

#[test]
fn a_tile_is_as_sharp_as_the_image_it_was_made_from() {
    let hash = |x: u32, y: u32| ((x * 7919 + y * 104_729) * 31 % 101) as f32 / 101.0;
    let (mesh, cover, tiles) = twice_the_same(128, |x, y| [hash(x / 2, y / 2), 0.0, 0.0, 1.0]);
    let cameras = [oblique(), frontal(0.7, 40.0), frontal(4.0, 40.0), frontal(20.0, 40.0)];
    for (c, camera) in cameras.iter().enumerate() {
        for f in Filter::ALL {
            let by_uv = LookSurface::of_model(&mesh, filter(f)).unwrap();
            let channels = [channel(ChannelKind::OcclusionRoughnessMetallic)];
            let by_fan = fan_surface(&mesh, &cover, &channels, &tiles, filter(f));
            let options = options(Shading::OcclusionRoughnessMetallic);
            let [a, b] =
                [&by_uv as &dyn Surface, &by_fan].map(|s| rendering(&mesh, s, camera, &options).picture);
            // Look-ups end at a tile's outermost texel centres, in an image half a texel later; cubics of coarse levels see it from afar.
            let margin = if f == Filter::BicubicMipmaps { 16.0 } else { 3.0 };
            let a = within(0.5 - margin / 128.0, a, &mesh, camera);
            let difference = largest_difference(&a, &b);
            // Rounding may take the next entry of the table of the elliptical average's weights.
            assert!(difference < 1e-3, "camera {c}, {f:?}: {difference}");
        }
    }
}

/// A disc that is cut out covers of every pixel what its area covers, seen in one sample per pixel.
#[test]
fn edges_of_cut_outs_are_as_smooth_as_those_of_triangles() {
    const RADIUS: f64 = 0.31;
    let ramp = |x: u32, y: u32| {
        let [x, y] = [x, y].map(|i| (f64::from(i) + 0.5) / 64.0 - 0.5);
        [1.0, 1.0, 1.0, (0.4 + (RADIUS - x.hypot(y)) * 12.0).clamp(0.0, 1.0) as f32]
    };
    let (mut mesh, cover, tiles) = twice_the_same(64, ramp);
    let material = &mut mesh.materials[0];
    material.base_color_texture = material.occlusion_texture.take();
    material.alpha = AlphaMode::Mask(0.4);
    for camera in [frontal(1.0, 40.0), oblique()] {
        let size = [120, 80];
        let is_inside = |x: f64, y: f64| {
            let ray = ray(&camera, size, x, y);
            (camera.eye - ray * (camera.eye.z / ray.z)).truncate().length() < RADIUS
        };
        let share = |pixel: u32| {
            let corner = [pixel % size[0], pixel / size[0]].map(f64::from);
            let part = |i: u32| (f64::from(i) + 0.5) / 16.0;
            let parts = (0..256).filter(|i| is_inside(corner[0] + part(i % 16), corner[1] + part(i / 16)));
            parts.count() as f32 / 256.0
        };
        let truth: Vec<f32> = (0..size[0] * size[1]).map(share).collect();
        assert!(truth.iter().filter(|share| **share > 0.0 && **share < 1.0).count() > 50);
        let by_uv = LookSurface::of_model(&mesh, filter(Filter::Bilinear)).unwrap();
        let by_fan =
            fan_surface(&mesh, &cover, &[channel(ChannelKind::BaseColor)], &tiles, filter(Filter::Bilinear));
        for surface in [&by_uv as &dyn Surface, &by_fan] {
            let seen = rendering(&mesh, surface, &camera, &options(Shading::BaseColor)).picture;
            let differences: Vec<f32> =
                seen.rgba.iter().zip(&truth).map(|(p, share)| (p[3] - share).abs()).collect();
            let largest = differences.iter().copied().fold(0.0, f32::max);
            // A ramp is as wide as the sum of its changes along both sides, where the edge of an area curves off.
            assert!(largest < 0.15, "{largest}");
            assert!(differences.iter().sum::<f32>() < 4.0, "{}", differences.iter().sum::<f32>());
        }
    }
}

#[test]
fn an_asset_looks_like_the_tiles_that_were_written() {
    let mesh = bumpy_sheet();
    let cover = fan_cover(&mesh, [36, 28]);
    let tiles = color_tiles(&mesh, &cover);
    let channels = [channel(ChannelKind::BaseColor)];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.fan");
    let mut writer = AssetWriter::create(&path, &CreateOptions::default(), &mesh, &cover, &channels).unwrap();
    for (g, group) in cover.groups.iter().enumerate() {
        let page = |id: fantex_store::PageId| {
            let tile = &tiles.levels[0][g][id.level as usize];
            let bytes =
                encode(TexelFormat::Rgba32F, Quality::UltraFast, tile.extent, TexelSlice::F32(&tile.rgba))
                    .unwrap();
            EncodedPage { id, channels: vec![bytes] }
        };
        writer.write_pages(group_pages(g as u32, group).map(page).collect()).unwrap();
    }
    let means: Vec<_> = tiles.levels[0].iter().map(|levels| levels[0].mean()).collect();
    writer.finish(&means).unwrap();

    let cache = PageCache::new(Arc::new(Asset::open(&path).unwrap()), 1 << 20);
    for f in Filter::ALL {
        let stored = FanSurface::of_asset(&cache, filter(f));
        let in_memory = fan_surface(&mesh, &cover, &channels, &tiles, filter(f));
        for camera in [oblique(), frontal(30.0, 20.0)] {
            let options = options(Shading::MetallicRoughness);
            let [a, b] =
                [&stored as &dyn Surface, &in_memory].map(|s| rendering(&mesh, s, &camera, &options).picture);
            assert!(largest_difference(&a, &b) < 1e-5, "{f:?}");
        }
    }
    assert_eq!(cache.damage().pages, 0);
}

// Fan surfaces shade many points at once as they shade them one by one.

const FILTERS: [Filter; 5] =
    [Filter::Nearest, Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic, Filter::Ewa];

/// By how much values may differ: bytes in sRGB are rounded to 16 bits before they are interpolated. Normals are made of values
/// whose errors grow where they look sideways.
const TOLERANCE: f32 = 3e-5;
const NORMAL_TOLERANCE: f32 = 2e-3;

/// An asset of noise in all forms of texels: bytes in sRGB, linear bytes, blocks of two channels, floats; some tiles of
/// several pages.
fn noise(mesh: &Mesh, cover: &Cover) -> PageCache {
    let channel = |kind, format, srgb| Channel { kind, format, srgb };
    let channels = [
        channel(ChannelKind::BaseColor, TexelFormat::Rgba8, true),
        channel(ChannelKind::Normal, TexelFormat::Bc5, false),
        channel(ChannelKind::OcclusionRoughnessMetallic, TexelFormat::Rgba8, false),
        channel(ChannelKind::Emission, TexelFormat::Rgba32F, false),
        channel(ChannelKind::Light, TexelFormat::Rgba8, true),
        channel(ChannelKind::Anisotropy, TexelFormat::Rg8, false),
    ];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.fan");
    let mut writer = AssetWriter::create(&path, &CreateOptions::default(), mesh, cover, &channels).unwrap();
    let mut state = 1_u32;
    let mut byte = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    for (g, group) in (0u32..).zip(&cover.groups) {
        let mut page = |id: PageId| {
            let extent = fantex_store::page_extent(group.level_extent(id.level), id.page);
            let texels = (extent[0] * extent[1]) as usize;
            let mut bytes = |count: usize| (0..count).map(|_| byte()).collect::<Vec<u8>>();
            let (color, normal, surface) = (bytes(4 * texels), bytes(texels), bytes(4 * texels));
            let glow = bytes(4 * texels).iter().flat_map(|&b| (f32::from(b) / 255.0).to_le_bytes()).collect();
            let (light, stretch) = (bytes(4 * texels), bytes(2 * texels));
            EncodedPage { id, channels: vec![color, normal, surface, glow, light, stretch] }
        };
        let pages = group_pages(g, group).map(&mut page).collect();
        writer.write_pages(pages).unwrap();
    }
    writer.finish(&vec![[0.4, 0.5, 0.6, 1.0]; channels.len() * cover.groups.len()]).unwrap();
    // The file stays open when its name is gone.
    PageCache::new(Arc::new(Asset::open(&path).unwrap()), 64 << 20)
}

static SHEET: LazyLock<(Mesh, PageCache)> = LazyLock::new(|| {
    let mesh = Mesh { materials: vec![Material::default()], ..sheet(5, 0.08, 11) };
    let mut cover = fan_cover(&mesh, [36, 28]);
    for (group, extent) in cover.groups.iter_mut().zip([[4, 4], [320, 24], [64, 64], [8, 128]].iter().cycle())
    {
        group.extent = *extent;
    }
    let cache = noise(&mesh, &cover);
    (mesh, cache)
});

/// Points anywhere on the sheet, with footprints from far below a texel to far above a tile, long and short ones.
fn hits() -> impl Strategy<Value = Vec<Hit>> {
    let lambda = (0.0f32..1.0, 0.0f32..1.0).prop_map(|(r, s)| {
        let (r, s) = if r + s < 1.0 { (r, s) } else { (1.0 - r, 1.0 - s) };
        Vec3::new(r, s, 1.0 - r - s)
    });
    let change = || {
        (-1.0f32..1.0, -1.0f32..1.0, -12.0f32..3.0)
            .prop_map(|(r, s, scale)| Vec3::new(r, s, -r - s) * scale.exp2())
    };
    let triangles = SHEET.0.triangles.len() as u32;
    let hit = (0..triangles, lambda, change(), change(), any::<bool>());
    let hit = hit.prop_map(|(triangle, lambda, dx, dy, front)| Hit {
        at: SurfacePoint { triangle, lambda },
        lambda_steps: [dx, dy],
        front,
        to_eye: Vec3::Z,
    });
    prop::collection::vec(hit, 1..300)
}

fn differ(a: &MaterialSample, b: &MaterialSample) -> bool {
    let colors = [(a.base_color, b.base_color), (a.emission, b.emission)];
    let numbers = [
        (a.occlusion, b.occlusion),
        (a.roughness, b.roughness),
        (a.metallic, b.metallic),
        (a.alpha, b.alpha),
    ];
    colors.iter().any(|(a, b)| (a - b).abs().max_element() > TOLERANCE)
        || numbers.iter().any(|(a, b)| (a - b).abs() > TOLERANCE)
        || (a.normal - b.normal).abs().max_element() > NORMAL_TOLERANCE
        || (0..2).any(|k| (a.normal_steps[k] - b.normal_steps[k]).abs().max_element() > NORMAL_TOLERANCE)
        || (a.unlit, a.lookups) != (b.unlit, b.lookups)
}

proptest! {
    #[test]
    fn many_points_and_single_points_are_shaded_alike(hits in hits(), filter in 0..FILTERS.len()) {
        let filter = FilterOptions { filter: FILTERS[filter], ..FilterOptions::default() };
        let surface = FanSurface::of_asset(&SHEET.1, filter);
        let mut together = Vec::new();
        surface.shade_all(&hits, &mut together);
        prop_assert_eq!(together.len(), hits.len());
        for (hit, (material, finish)) in hits.iter().zip(&together) {
            let (alone, alone_finish) = surface.shade(hit);
            prop_assert!(!differ(material, &alone), "{:?}: {material:?} {alone:?} {hit:?}", filter.filter);
            let (finish, alone_finish) = (finish.as_ref().unwrap(), alone_finish.unwrap());
            let lights = [finish, &alone_finish].map(|finish| finish.light_map.unwrap());
            prop_assert!((lights[0] - lights[1]).abs().max_element() < TOLERANCE, "{lights:?}");
            // As vectors of doubled angles, in which a weak stretch may have any direction.
            let stretches = [finish, &alone_finish].map(|finish| {
                let stretch = finish.anisotropy.unwrap();
                (stretch.direction, stretch.strength)
            });
            let [(a, strength), (b, other)] = stretches;
            let apart = strength.max(other) * (1.0 - a.dot(b).abs()).max(0.0).sqrt();
            prop_assert!((strength - other).abs() < TOLERANCE && apart < NORMAL_TOLERANCE, "{stretches:?}");
        }
        prop_assert_eq!(SHEET.1.damage().pages, 0);
    }
}
