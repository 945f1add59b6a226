//! Fan surfaces: the texture function under all filters, against closed forms and against the same image by UV.

use std::sync::Arc;

use crate::common::tiles::{MemoryTile, MemoryTiles, bake, fan_cover};
use crate::common::{frontal, sheet, square};
use fantex_cover::{Cover, Frame, Group, GroupKind};
use fantex_mesh::{ImageSource, Material, Mesh, TextureRef, WrapMode};
use fantex_render::{
    Background, Camera, FanSurface, FilterOptions, FlatShading, FlatSurface, Hit, Lights, MeshSurface,
    Picture, RenderOptions, Rendering, Shading, Surface, render,
};
use fantex_store::{
    Asset, AssetWriter, Channel, ChannelKind, CreateOptions, EncodedPage, PageCache, Quality, TexelFormat,
    TexelSlice, encode, group_pages,
};
use fantex_texture::{ColorSpace, Filter, Image, ImageTexture, Samples};
use glam::{DVec3, Mat3, Vec2, Vec3};

const ALL_FILTERS: [Filter; 6] =
    [Filter::Nearest, Filter::Bilinear, Filter::Bicubic, Filter::Trilinear, Filter::Anisotropic, Filter::Ewa];

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
    for f in ALL_FILTERS {
        let surface = FanSurface::new(&mesh, &cover, &[channel(ChannelKind::BaseColor)], &tiles, filter(f));
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
        let surface = FanSurface::new(&mesh, &cover, &[channel(ChannelKind::BaseColor)], &tiles, filter(f));
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
        let z = (n[0] * lambda.x + n[1] * lambda.y + n[2] * lambda.z).normalize();
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
        FanSurface::new(&mesh, &cover, &[channel(ChannelKind::Normal)], &tiles, filter(Filter::Bilinear));
    let seen = rendering(&mesh, &surface, &oblique(), &options(Shading::Normal)).picture;
    let truth =
        FlatSurface::new(&mesh, FlatShading::Unlit, |hit: &Hit| bent(hit.position(&mesh)) * 0.5 + 0.5);
    let truth = rendering(&mesh, &truth, &oblique(), &options(Shading::BaseColor)).picture;
    let difference = largest_difference(&within(0.9, truth, &mesh, &oblique()), &seen);
    assert!(difference < 2e-3, "{difference}");
}

/// A square with an image by texture coordinates, and the same image as the tile of its only group.
fn twice_the_same(size: u32, texel: impl Fn(u32, u32) -> f32) -> (Mesh, Cover, MemoryTiles) {
    let values = (0..size * size).map(|i| texel(i % size, i / size)).flat_map(|v| [v, 0.0, 0.0]);
    let samples = Samples::U16(values.map(|v| (v * 65535.0).round() as u16).collect());
    let image = Image { width: size, height: size, channels: 3, space: ColorSpace::Linear, samples };
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
    let cover = Cover { delta: 0.2, density: 1.0, corner_groups, groups: vec![group], unfolded: Vec::new() };
    (mesh, cover, tiles)
}

#[test]
fn a_tile_is_as_sharp_as_the_image_it_was_made_from() {
    let hash = |x: u32, y: u32| ((x * 7919 + y * 104_729) * 31 % 101) as f32 / 101.0;
    let (mesh, cover, tiles) = twice_the_same(128, |x, y| hash(x / 2, y / 2));
    let cameras = [oblique(), frontal(0.7, 40.0), frontal(4.0, 40.0), frontal(20.0, 40.0)];
    for (c, camera) in cameras.iter().enumerate() {
        for f in ALL_FILTERS {
            let by_uv = MeshSurface::load(&mesh, filter(f)).unwrap();
            let channels = [channel(ChannelKind::OcclusionRoughnessMetallic)];
            let by_fan = FanSurface::new(&mesh, &cover, &channels, &tiles, filter(f));
            let options = options(Shading::OcclusionRoughnessMetallic);
            let [a, b] =
                [&by_uv as &dyn Surface, &by_fan].map(|s| rendering(&mesh, s, camera, &options).picture);
            // Look-ups end at a tile's outermost texel centres, in an image half a texel later.
            let a = within(0.5 - 3.0 / 128.0, a, &mesh, camera);
            let difference = largest_difference(&a, &b);
            // Rounding may take the next entry of the table of the elliptical average's weights.
            assert!(difference < 1e-3, "camera {c}, {f:?}: {difference}");
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
    for f in ALL_FILTERS {
        let stored = FanSurface::of_asset(&cache, filter(f));
        let in_memory = FanSurface::new(&mesh, &cover, &channels, &tiles, filter(f));
        for camera in [oblique(), frontal(30.0, 20.0)] {
            let options = options(Shading::MetallicRoughness);
            let [a, b] =
                [&stored as &dyn Surface, &in_memory].map(|s| rendering(&mesh, s, &camera, &options).picture);
            assert!(largest_difference(&a, &b) < 1e-5, "{f:?}");
        }
    }
    assert_eq!(cache.damage().pages, 0);
}
