//! Single pictures, and KTX2 byte by byte.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use fantex_bake::{BakeFormat, NoProgress, Prefilter, Progress, Source, SourceChannel, TexelPoint};
use fantex_base::ErrorKind;
use fantex_export::{ChannelMap, Depth, ExportOptions, UvChoice, export_channels, export_model};
use fantex_mesh::generate::{cube, icosphere};
use fantex_mesh::{Material, Mesh, Model, SurfacePoint};
use fantex_store::{ChannelKind, Footprint, PageCache, Sampler};
use fantex_texture::compare::psnr_db;
use fantex_texture::{ColorSpace, FilterOptions, Image, Samples};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::support::{Baked, Waves, baked, baked_bottle, cleaned, files, opened, worst_psnr_db};

const SIDE: u32 = 128;

fn options() -> ExportOptions<'static> {
    ExportOptions { side: Some(SIDE), ..ExportOptions::default() }
}

fn sphere() -> Baked {
    use ChannelKind::{BaseColor, Displacement, Emission, Light, Normal, OcclusionRoughnessMetallic};
    let kinds = vec![BaseColor, Normal, OcclusionRoughnessMetallic, Emission, Displacement, Light];
    baked(&cleaned(icosphere(3)), &Waves { kinds, ..Waves::color(3.0) }, 1 << 14, BakeFormat::Float)
}

fn export(baked: &Baked, map: ChannelMap, depth: Depth, name: &str) -> Image {
    let path = baked.path(name);
    export_channels(&baked.asset, &[(map, &path)], depth, &options(), &NoProgress).unwrap();
    let space = match map {
        ChannelMap::BaseColor | ChannelMap::Emission | ChannelMap::Light => ColorSpace::Srgb,
        _ => ColorSpace::Linear,
    };
    Image::load_as(&path, space).unwrap()
}

#[test]
fn every_channel_is_the_same_in_every_format() {
    let baked = sphere();
    for map in ChannelMap::ALL {
        let name = |e: &str| format!("{}.{e}", map.name());
        let exact = export(&baked, map, Depth::Eight, &name("exr"));
        let shorts = export(&baked, map, Depth::Sixteen, &format!("16-{}", name("png")));
        let bytes = export(&baked, map, Depth::Eight, &name("png"));
        assert!(matches!(shorts.samples, Samples::U16(_)) && matches!(bytes.samples, Samples::U8(_)));
        // OpenEXR has no grey here.
        assert!(exact.channels == bytes.channels || [bytes.channels, exact.channels] == [1, 3], "{map:?}");
        let [coarse, fine] = [&bytes, &shorts].map(|image| psnr_db(&exact, image).unwrap());
        assert!(coarse > 50.0 && fine > 80.0, "{map:?}: {coarse} and {fine} dB");
        let packed = export(&baked, map, Depth::Eight, &name("ktx2"));
        // Two coordinates of a normal are stored; the third follows.
        let db = if map == ChannelMap::Normal {
            red_psnr_db(&bytes, &packed)
        } else {
            psnr_db(&bytes, &packed).unwrap()
        };
        assert!(db > 38.0, "{map:?} as KTX2: {db} dB");
    }
}

/// PSNR of the first channel of two 8-bit images.
fn red_psnr_db(a: &Image, b: &Image) -> f64 {
    let red = |image: &Image| -> Vec<f64> {
        let Samples::U8(samples) = &image.samples else { panic!("8 bits") };
        samples.chunks(usize::from(image.channels)).map(|t| f64::from(t[0]) / 255.0).collect()
    };
    let squares: f64 = red(a).iter().zip(red(b)).map(|(a, b)| (a - b).powi(2)).sum();
    -10.0 * (squares / f64::from(a.width * a.height)).log10()
}

fn word(bytes: &[u8], offset: usize) -> u32 {
    u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap())
}

fn wide(bytes: &[u8], offset: usize) -> u64 {
    u64::from_le_bytes(bytes[offset..offset + 8].try_into().unwrap())
}

#[test]
fn ktx2_says_what_it_holds() {
    let baked = sphere();
    // Format, type size, descriptor's model and transfer function, bytes of a block, bits of the samples.
    type Expected = (ChannelMap, u32, u32, [u32; 2], u32, &'static [[u32; 2]]);
    let expected: [Expected; 6] = [
        (ChannelMap::BaseColor, 146, 1, [134, 2], 16, &[[0, 128]]),
        (ChannelMap::OcclusionRoughnessMetallic, 145, 1, [134, 1], 16, &[[0, 128]]),
        (ChannelMap::Normal, 141, 1, [132, 1], 16, &[[0, 64], [1, 64]]),
        (ChannelMap::Roughness, 139, 1, [131, 1], 8, &[[0, 64]]),
        (ChannelMap::Displacement, 70, 2, [1, 1], 2, &[[0, 16]]),
        (ChannelMap::Light, 97, 2, [1, 1], 8, &[[0xc0, 16], [0xc1, 16], [0xc2, 16], [0xcf, 16]]),
    ];
    for (map, format, type_size, model, unit_bytes, samples) in expected {
        export(&baked, map, Depth::Eight, "x.ktx2");
        let bytes = std::fs::read(baked.path("x.ktx2")).unwrap();
        assert_eq!(&bytes[..12], b"\xabKTX 20\xbb\r\n\x1a\n");
        let header: Vec<u32> = (0..9).map(|i| word(&bytes, 12 + 4 * i)).collect();
        assert_eq!(header, [format, type_size, SIDE, SIDE, 0, 0, 1, 8, 2], "{map:?}");
        let [dfd, dfd_bytes, pairs, pair_bytes] = [0, 1, 2, 3].map(|i| word(&bytes, 48 + 4 * i) as usize);
        assert_eq!((wide(&bytes, 64), wide(&bytes, 72)), (0, 0));
        assert_eq!((dfd, pairs), (80 + 24 * 8, dfd + dfd_bytes));
        check_descriptor(&bytes[dfd..pairs], model, unit_bytes, samples, type_size == 1);
        assert!(bytes[pairs..pairs + pair_bytes].windows(18).any(|w| w == b"KTXorientation\0rd\0"));
        // From the smallest level to the largest, without gaps, up to the end.
        let mut offset = (pairs + pair_bytes) as u64;
        for level in (0..8u32).rev() {
            let entry = 80 + 24 * level as usize;
            let [at, length, unpacked] = [0, 8, 16].map(|i| wide(&bytes, entry + i));
            assert_eq!(at, offset);
            let side = u64::from(SIDE >> level);
            let units = if type_size == 1 { side.div_ceil(4) } else { side };
            assert_eq!(unpacked, units * units * u64::from(unit_bytes));
            let packed = &bytes[at as usize..(at + length) as usize];
            assert_eq!(zstd::bulk::decompress(packed, unpacked as usize).unwrap().len() as u64, unpacked);
            offset += length;
        }
        assert_eq!(offset, bytes.len() as u64);
        std::fs::remove_file(baked.path("x.ktx2")).unwrap();
    }
}

fn check_descriptor(
    dfd: &[u8],
    [model, transfer]: [u32; 2],
    unit_bytes: u32,
    samples: &[[u32; 2]],
    is_block: bool,
) {
    let block_bytes = 24 + 16 * samples.len() as u32;
    assert_eq!([word(dfd, 0), word(dfd, 4), word(dfd, 8)], [4 + block_bytes, 0, 2 | block_bytes << 16]);
    assert_eq!(word(dfd, 12), model | 1 << 8 | transfer << 16);
    assert_eq!(word(dfd, 16), if is_block { 0x0303 } else { 0 });
    assert_eq!([word(dfd, 20), word(dfd, 24)], [unit_bytes, 0]);
    let mut offset = 0;
    for (i, &[channel, bits]) in samples.iter().enumerate() {
        assert_eq!(word(dfd, 28 + 16 * i), offset | (bits - 1) << 16 | channel << 24);
        offset += bits;
    }
    assert_eq!(offset, 8 * unit_bytes);
}

/// No factor beside them tells how bright it is.
#[test]
fn single_pictures_hold_light_brighter_than_one() {
    let waves = Waves { kinds: vec![ChannelKind::Emission], brightness: 6.0, ..Waves::color(3.0) };
    let baked = baked(&cleaned(icosphere(2)), &waves, 1 << 12, BakeFormat::Float);
    let [exact, packed] =
        ["a.exr", "a.ktx2"].map(|name| export(&baked, ChannelMap::Emission, Depth::Eight, name));
    let (mut brightest, mut worst) = (0.0f32, 0.0f32);
    for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
        let [a, b] = [&exact, &packed].map(|image| Vec4::from(image.linear_texel(x, y)).truncate());
        brightest = brightest.max(a.max_element());
        worst = worst.max((a - b).abs().max_element());
    }
    assert!(brightest > 4.0 && worst < 0.01, "{worst} of {brightest}");
    let cut_off = ["b.png", "b.ktx2"].map(|name| {
        let path = baked.path(name);
        let channels = [(ChannelMap::Emission, &*path)];
        export_channels(&baked.asset, &channels, Depth::Eight, &options(), &NoProgress).unwrap().cut_off.len()
    });
    assert_eq!(cut_off, [1, 0]);
}

#[test]
fn a_missing_channel_is_named() {
    let baked = baked_bottle(1 << 14);
    let path = baked.path("x.png");
    let error =
        export_channels(&baked.asset, &[(ChannelMap::Light, &path)], Depth::Eight, &options(), &NoProgress)
            .unwrap_err();
    assert_eq!(
        error.to_string(),
        "the asset has no channel for light; it has base-color, orm, normal, emission"
            .replace("base-color, orm, normal, emission", &present(&baked))
    );
    assert!(error.kind() == ErrorKind::NotFound && !path.exists());
}

fn present(baked: &Baked) -> String {
    let name = |kind: ChannelKind| match kind {
        ChannelKind::BaseColor => "base-color",
        ChannelKind::Normal => "normal",
        ChannelKind::OcclusionRoughnessMetallic => "orm",
        ChannelKind::Emission => "emission",
        ChannelKind::Displacement => "displacement",
        ChannelKind::Light => "light",
        ChannelKind::Anisotropy => "anisotropy",
    };
    baked.asset.channels().iter().map(|c| name(c.kind)).collect::<Vec<_>>().join(", ")
}

// ---- Texture coordinates: the model's, also those that do not fit, and what lies at the own ones.

/// A cube each of whose sides fills a repeated picture or the same unit square.
fn with_uv(mut model: Model, scale: f32) -> Mesh {
    let uv = model.triangles.iter().flat_map(|t| {
        let [a, b, c] = t.map(|v| model.positions[v as usize]);
        let normal = (b - a).cross(c - a).abs();
        let flat = |p: DVec3| match normal.max_position() {
            0 => Vec2::new(p.y as f32, p.z as f32),
            1 => Vec2::new(p.x as f32, p.z as f32),
            _ => Vec2::new(p.x as f32, p.y as f32),
        };
        [a, b, c].map(|p| (flat(p) * 0.5 + 0.5) * scale)
    });
    model.corners.uv_sets = vec![uv.collect()];
    cleaned(model)
}

#[test]
fn overlapping_coordinates_are_reported() {
    let baked = baked(&with_uv(cube(2), 1.0), &Waves::color(3.0), 1 << 14, BakeFormat::Rgba8);
    let options = ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &baked.path("x.glb"), &options, &NoProgress).unwrap();
    assert!(summary.overlapping_share > 0.9, "{summary:?}");
}

/// Models of many materials would have too many files open.
#[test]
fn pictures_of_a_page_are_begun_when_it_is_made() {
    /// Texels made, and files that were there then.
    struct Counts(PathBuf, Mutex<Vec<(u64, usize)>>);
    impl Progress for Counts {
        fn report(&self, done: u64, _: u64) {
            self.1.lock().unwrap().push((done, files(&self.0).len()));
        }
    }
    let mut mesh = with_uv(cube(2), 1.0);
    mesh.materials = vec![Material::default(); 2];
    mesh.triangle_materials = (0..mesh.triangles.len()).map(|t| t as u32 % 2).collect();
    let baked = baked(&mesh, &Waves::color(3.0), 1 << 12, BakeFormat::Rgba8);
    let counts = Counts(baked.folder.path().into(), Mutex::default());
    let options =
        ExportOptions { uv: UvChoice::OfAsset, side: Some(64), with_ktx2: true, ..ExportOptions::default() };
    export_model(&baked.asset, &baked.path("x.gltf"), &options, &counts).unwrap();
    // Beside the asset there are two for each page; the model comes last.
    assert_eq!(counts.1.into_inner().unwrap(), [(0, 1), (64 * 64, 3), (2 * 64 * 64, 5)]);
}

#[test]
fn coordinates_beyond_one_repeat() {
    let mut model = cube(2);
    model.triangles.truncate(8);
    // One side, moved by three pictures: nothing overlaps.
    let mut mesh = with_uv(model, 0.9);
    mesh.corners.uv_sets[0].iter_mut().for_each(|uv| *uv += Vec2::new(2.3, -1.0));
    let baked = baked(&mesh, &Waves::color(3.0), 1 << 16, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let options = ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    assert!(summary.overlapping_share < 0.02, "{summary:?}");
    let db = worst_psnr_db(&baked.asset, &path);
    assert!(db > 38.0, "{db} dB");
}

/// The sides of a cube in colours of their own.
struct Sides;

impl Source for Sides {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let axis = point.position.abs().max_position();
        let mut color = Vec3::splat(0.5);
        color[axis] += 0.4 * point.position[axis].signum();
        values[0] = color.extend(1.0);
    }
}

/// Every side of a cube points into its own colour of a palette of eight.
#[test]
fn triangles_that_point_into_a_palette_show_their_colour() {
    let mut mesh = with_uv(cube(2), 1.0);
    let points = (0..mesh.triangles.len()).flat_map(|t| {
        let normal = mesh.triangle_positions(t).iter().sum::<Vec3>();
        let axis = normal.abs().max_position();
        let color = 2 * axis + usize::from(normal[axis] > 0.0);
        [Vec2::new((color as f32 + 0.5) / 8.0, 0.5); 3]
    });
    let points = points.collect();
    mesh.corners.uv_sets = vec![points];
    let baked = baked(&mesh, &Sides, 1 << 14, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let options = ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    assert_eq!((summary.points, &summary.sizes[..]), (mesh.triangles.len(), &[[64, 64]][..]));
    let db = worst_psnr_db(&baked.asset, &path);
    // The asset's sides flow into each other near edges, the palette's do not.
    assert!(db > 22.0, "{db} dB");
}

/// The eighths of space in colours of their own.
struct Octants;

impl Source for Octants {
    fn channels(&self) -> Vec<SourceChannel> {
        Sides.channels()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = (0.5 + 0.4 * point.position.signum()).extend(1.0);
    }
}

/// Neighbours in one tile have different colours, of which each triangle's point or line in the coordinates shows its own.
#[test]
fn triangles_without_area_in_the_coordinates_show_their_own_colour() {
    for height in [0.0, 0.5] {
        let mut mesh = with_uv(cube(2), 1.0);
        let corners = (0..mesh.triangles.len()).flat_map(|t| {
            let middle = mesh.triangle_positions(t).iter().sum::<Vec3>();
            let bits = (middle.cmpgt(Vec3::ZERO)).bitmask();
            let at = |v: f32| Vec2::new((bits as f32 + 0.5) / 8.0, v);
            [at(0.25), at(0.25 + height), at(0.25 + 0.3 * height)]
        });
        let corners = corners.collect();
        mesh.corners.uv_sets = vec![corners];
        let baked = baked(&mesh, &Octants, 1 << 14, BakeFormat::Rgba8);
        let path = baked.path("x.png");
        let options = ExportOptions { uv: UvChoice::OfAsset, side: Some(64), ..ExportOptions::default() };
        let channels = [(ChannelMap::BaseColor, path.as_path())];
        export_channels(&baked.asset, &channels, Depth::Eight, &options, &NoProgress).unwrap();
        let image = Image::load_as(&path, ColorSpace::Srgb).unwrap();
        for bits in 0..8 {
            let expected =
                Vec3::from_array([0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { 0.9 } else { 0.1 }));
            // Not at the ends of a line, which neighbours share.
            for row in [16.0 + 24.0 * height, 16.0 + 32.0 * height] {
                let seen = Vec4::from_array(image.linear_texel(8 * bits + 4, row as u32)).truncate();
                assert!((seen - expected).abs().max_element() < 0.05, "{height}: {seen} {expected}");
            }
        }
    }
}

#[test]
fn another_models_coordinates_are_taken_where_its_triangles_are_the_same() {
    let bare = cleaned(cube(3));
    let baked = baked(&bare, &Waves::color(3.0), 1 << 14, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let refused = export_model(
        &baked.asset,
        &path,
        &ExportOptions { uv: UvChoice::OfAsset, ..ExportOptions::default() },
        &NoProgress,
    );
    assert!(refused.unwrap_err().to_string().starts_with("the asset holds no texture coordinates"));
    // The same cube, its triangles in another order and turned.
    let mut other = cube(3);
    other.triangles.reverse();
    other.triangles.iter_mut().for_each(|t| t.rotate_left(1));
    let other = with_uv(other, 1.0);
    let options = ExportOptions { uv: UvChoice::OfModel(&other), ..ExportOptions::default() };
    export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    let expected = with_uv(cube(3), 1.0);
    assert_eq!(opened(&path).corners.uv_sets[0], expected.corners.uv_sets[0]);
    let wrong = with_uv(icosphere(1), 1.0);
    let options = ExportOptions { uv: UvChoice::OfModel(&wrong), force: true, ..ExportOptions::default() };
    let refused = export_model(&baked.asset, &path, &options, &NoProgress);
    assert!(refused.unwrap_err().to_string().starts_with("triangle 0 of the asset is none of the model's"));
}

/// Samples of the surface through the exported picture against the asset's texture function: no renderer between, no
/// coarser levels, the same density, and detail near what the density holds.
#[test]
fn pictures_hold_the_texture_function_at_equal_density() {
    let mesh = cleaned(icosphere(4));
    let texels = 190_000u64;
    let density = (texels as f64 / mesh.area()).sqrt() as f32;
    for (wavelength, least_db) in [(16.0, 50.0), (8.0, 38.0)] {
        let baked = baked(
            &mesh,
            &Waves::color(std::f32::consts::TAU * density / wavelength),
            texels,
            BakeFormat::Float,
        );
        let (model, picture) = (baked.path("x.glb"), baked.path("x.exr"));
        let options = ExportOptions { side: Some(512), padding: Some(4), ..ExportOptions::default() };
        let summary = export_model(&baked.asset, &model, &options, &NoProgress).unwrap();
        assert!((0.8..1.1).contains(&summary.density_share), "{summary:?}");
        export_channels(
            &baked.asset,
            &[(ChannelMap::BaseColor, &picture)],
            Depth::Eight,
            &options,
            &NoProgress,
        )
        .unwrap();
        let image = Image::load_as(&picture, ColorSpace::Linear).unwrap();
        let Samples::F32(samples) = &image.samples else { panic!("floats") };
        let texel = |x: u32, y: u32| samples[3 * (y.min(511) * 512 + x.min(511)) as usize];
        let back = opened(&model);
        let cache = PageCache::new(Arc::clone(&baked.asset), 64 << 20);
        let sampler = Sampler::of_cache(&cache, FilterOptions::default());
        let (mut squares, mut count) = (0.0, 0.0);
        for t in 0..mesh.triangles.len() {
            assert!(back.triangle_positions(t)[0].distance(mesh.triangle_positions(t)[0]) < 1e-6);
            for lambda in [[0.8, 0.1, 0.1], [0.05, 0.9, 0.05], [0.02, 0.49, 0.49], [0.33, 0.33, 0.34]] {
                let lambda = Vec3::from(lambda);
                let uv = &back.corners.uv_sets[0][3 * t..3 * t + 3];
                let at = (uv[0] * lambda.x + uv[1] * lambda.y + uv[2] * lambda.z) * 512.0 - 0.5;
                let (x, y, f) = (at.x as u32, at.y as u32, at.fract());
                let row = |y| texel(x, y) * (1.0 - f.x) + texel(x + 1, y) * f.x;
                let read = row(y) * (1.0 - f.y) + row(y + 1) * f.y;
                let truth =
                    sampler.sample_channel(0, SurfacePoint { triangle: t as u32, lambda }, Footprint::NONE).x;
                squares += f64::from(read - truth).powi(2);
                count += 1.0;
            }
        }
        let db = -10.0 * (squares / count).log10();
        eprintln!(
            "wavelength of {wavelength} texels, {:.2} of the density: {db:.1} dB",
            summary.density_share
        );
        assert!(db > least_db, "{db} dB at a wavelength of {wavelength} texels");
    }
}

// ---- What detail levels of other programs read beside the pieces.

/// Level `l` of a grey picture as the mean of 2 x 2 texels, again and again.
fn halved(texels: &[f32], side: usize) -> Vec<f32> {
    let at = |x: usize, y: usize| texels[y * side + x];
    let mean = |i: usize| {
        let (x, y) = (2 * (i % (side / 2)), 2 * (i / (side / 2)));
        0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
    };
    (0..side * side / 4).map(mean).collect()
}

fn bilinear(texels: &[f32], side: usize, uv: Vec2) -> f32 {
    let p = (uv * side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(side as f32 - 1.0));
    let (x, y) = (p.x as usize, p.y as usize);
    let at = |x: usize, y: usize| texels[y.min(side - 1) * side + x.min(side - 1)];
    let (fx, fy) = (p.x.fract(), p.y.fract());
    let row = |y| at(x, y) * (1.0 - fx) + at(x + 1, y) * fx;
    row(y) * (1.0 - fy) + row(y + 1) * fy
}

/// The sphere whose pieces are numbered: every corner's piece, by connected texture coordinates.
fn pieces(mesh: &fantex_mesh::Mesh) -> Vec<u32> {
    let uv = &mesh.corners.uv_sets[0];
    let mut parents: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    fn root(parents: &mut [u32], mut i: u32) -> u32 {
        while parents[i as usize] != i {
            i = parents[i as usize];
        }
        i
    }
    let mut seen = std::collections::BTreeMap::new();
    for (corner, uv) in uv.iter().enumerate() {
        let t = corner as u32 / 3;
        let first = *seen.entry([uv.x.to_bits(), uv.y.to_bits()]).or_insert(t);
        let (a, b) = (root(&mut parents, first), root(&mut parents, t));
        parents[a.max(b) as usize] = a.min(b);
    }
    (0..parents.len() as u32).map(|t| root(&mut parents, t)).collect()
}

#[test]
fn no_foreign_texel_is_read_down_to_the_level_that_is_promised() {
    let mut balls = icosphere(3);
    let other = icosphere(3);
    let first = balls.positions.len() as u32;
    balls.positions.extend(other.positions.iter().map(|p| *p + DVec3::X * 3.0));
    balls.triangles.extend(other.triangles.iter().map(|corners| corners.map(|vertex| vertex + first)));
    let baked = baked(&cleaned(balls), &Waves::color(2.0), 1 << 18, BakeFormat::Rgba8);
    let path = baked.path("x.glb");
    let options = ExportOptions { side: Some(1024), padding: Some(16), ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    assert!(summary.charts > 3 && summary.padding == 16, "{summary:?}");
    let mesh = opened(&path);
    let pieces = pieces(&mesh);
    let side = 1024usize;
    let uv = &mesh.corners.uv_sets[0];
    let mut numbers: Vec<u32> = pieces.clone();
    numbers.sort_unstable();
    numbers.dedup();
    assert_eq!(numbers.len(), summary.charts);
    let owner = nearest_pieces(&mesh, &pieces, side);
    for &piece in &numbers {
        let mut level: Vec<f32> = owner.iter().map(|&o| f32::from(u8::from(o == piece))).collect();
        let mut level_side = side;
        for _ in 0..5 {
            for (t, _) in pieces.iter().enumerate().filter(|(_, p)| **p == piece) {
                for k in 0..3 {
                    let (a, b) = (uv[3 * t + k], uv[3 * t + (k + 1) % 3]);
                    for share in [0.0, 0.3, 0.6] {
                        let read = bilinear(&level, level_side, a.lerp(b, share));
                        assert!(read > 0.999, "piece {piece} reads {read} at {level_side} columns");
                    }
                }
            }
            level = halved(&level, level_side);
            level_side /= 2;
        }
    }
}

/// For every texel the piece whose block of 16 x 16 texels it lies in: that of any of its texels within 8 of a triangle, less
/// 0.005 for rounding, of which a look-up reads less than a thousandth.
fn nearest_pieces(mesh: &fantex_mesh::Mesh, pieces: &[u32], side: usize) -> Vec<u32> {
    let uv = &mesh.corners.uv_sets[0];
    let blocks = side / 16;
    let mut owner = vec![u32::MAX; blocks * blocks];
    for (t, &piece) in pieces.iter().enumerate() {
        // Points of the triangle, closer together than a texel, and what lies half a block around them.
        let corners = [0, 1, 2].map(|k| uv[3 * t + k] * side as f32);
        let steps = 96;
        for i in 0..=steps {
            for j in 0..=(steps - i) {
                let (s, r) = (i as f32 / steps as f32, j as f32 / steps as f32);
                let p = corners[0] * (1.0 - s - r) + corners[1] * s + corners[2] * r;
                for d in [[-7.995, -7.995], [7.995, -7.995], [-7.995, 7.995], [7.995, 7.995]] {
                    let block = ((p + Vec2::from(d)) / 16.0).floor().as_uvec2();
                    let owner = &mut owner[block.y as usize * blocks + block.x as usize];
                    assert!(*owner == u32::MAX || *owner == piece, "two pieces claim a block");
                    *owner = piece;
                }
            }
        }
    }
    (0..side * side).map(|i| owner[i / side / 16 * blocks + i % side / 16]).collect()
}

#[test]
fn borders_keep_their_colours_at_every_level_that_is_promised() {
    let mesh = cleaned(icosphere(3));
    let baked = baked(&mesh, &Waves::color(2.0), 1 << 18, BakeFormat::Float);
    let (model, picture) = (baked.path("x.glb"), baked.path("x.exr"));
    let side = 1024usize;
    let options = ExportOptions { side: Some(side as u32), padding: Some(16), ..ExportOptions::default() };
    export_model(&baked.asset, &model, &options, &NoProgress).unwrap();
    export_channels(&baked.asset, &[(ChannelMap::BaseColor, &picture)], Depth::Eight, &options, &NoProgress)
        .unwrap();
    let image = Image::load_as(&picture, ColorSpace::Linear).unwrap();
    let Samples::F32(samples) = &image.samples else { panic!("floats") };
    let mut level: Vec<f32> = samples.as_chunks::<3>().0.iter().map(|t| t[0]).collect();
    // Nothing is left empty.
    assert!(level.iter().all(|&red| red > 0.05));
    let uv = &opened(&model).corners.uv_sets[0];
    let cache = PageCache::new(Arc::clone(&baked.asset), 64 << 20);
    let sampler = Sampler::of_cache(&cache, FilterOptions::default());
    let mut level_side = side;
    // The colours go from 0.1 to 0.9 and change by 0.8 per mesh unit, over which there are about 150 texels: a texel of the
    // last level is a tenth of a unit long. A foreign or an empty texel would be off by several tenths.
    for tolerance in [0.004, 0.008, 0.016, 0.035, 0.07] {
        for t in 0..mesh.triangles.len() {
            for (k, lambda) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
                let truth =
                    sampler.sample_channel(0, SurfacePoint { triangle: t as u32, lambda }, Footprint::NONE).x;
                let off = (bilinear(&level, level_side, uv[3 * t + k]) - truth).abs();
                assert!(
                    off < tolerance,
                    "corner {k} of triangle {t} at {level_side} columns is off by {off}"
                );
            }
        }
        level = halved(&level, level_side);
        level_side /= 2;
    }
}
