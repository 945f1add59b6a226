//! The texture function: the way of many points against that of single ones, on random points of random meshes.

use std::path::Path;
use std::sync::Arc;

use fantex_base::{ErrorKind, Random};
use fantex_mesh::{Mesh, SurfacePoint};
use fantex_store::{
    Asset, AssetWriter, Channel, ChannelKind, CreateOptions, EncodedPage, Footprint, PageCache, Sampler,
    TexelFormat, TileId, TileSource, TileTexels, page_extent,
};
use fantex_texture::{Filter, FilterOptions};
use glam::{Vec3, Vec4};

use crate::common::{fan_cover, pages, sheet, tetrahedron};

/// What is promised for values. Bytes in sRGB are rounded to 16 bits before they are interpolated.
const TOLERANCE: f32 = 1e-5;

/// Of normals and stretches, which are made of values whose errors grow where they look sideways.
const DIRECTION_TOLERANCE: f32 = 2e-3;

fn channels() -> Vec<Channel> {
    let channel = |kind, format, srgb| Channel { kind, format, srgb };
    vec![
        channel(ChannelKind::BaseColor, TexelFormat::Rgba8, true),
        channel(ChannelKind::Normal, TexelFormat::Bc5, false),
        channel(ChannelKind::OcclusionRoughnessMetallic, TexelFormat::Rgba8, false),
        channel(ChannelKind::Emission, TexelFormat::Rgba32F, false),
        channel(ChannelKind::Displacement, TexelFormat::R8, false),
        channel(ChannelKind::Light, TexelFormat::Bc7, true),
        channel(ChannelKind::Anisotropy, TexelFormat::Rg8, false),
    ]
}

/// An asset of noise; some tiles have several pages.
fn noise(folder: &Path, mesh: &Mesh, random: &mut Random) -> PageCache {
    let extents = [[4, 4], [320, 24], [64, 64], [8, 128], [36, 28]];
    let cover = fan_cover(mesh, |v| extents[v % extents.len()]);
    let (path, channels) = (folder.join("noise.fan"), channels());
    let options = CreateOptions { force: true, ..CreateOptions::default() };
    let mut writer = AssetWriter::create(&path, &options, mesh, &cover, &channels).unwrap();
    for id in pages(&cover) {
        let extent = page_extent(cover.groups[id.group as usize].level_extent(id.level), id.page);
        let mut texels = |channel: &Channel| -> Vec<u8> {
            let mut byte = || (random.next_u64() >> 56) as u8;
            match channel.format {
                TexelFormat::Rgba32F => (0..extent[0] * extent[1] * 4)
                    .flat_map(|_| (f32::from(byte()) / 255.0).to_le_bytes())
                    .collect(),
                format => (0..format.bytes(extent)).map(|_| byte()).collect(),
            }
        };
        let channels = channels.iter().map(&mut texels).collect();
        writer.write_pages(vec![EncodedPage { id, channels }]).unwrap();
    }
    writer.finish(&vec![[0.4, 0.5, 0.6, 1.0]; channels.len() * cover.groups.len()]).unwrap();
    PageCache::new(Arc::new(Asset::open(&path).unwrap()), 64 << 20)
}

/// Points anywhere, with footprints from far below a texel to far above a tile, long and short ones.
fn random_points(mesh: &Mesh, random: &mut Random, count: usize) -> Vec<(SurfacePoint, Footprint)> {
    let mut unit = || random.unit() as f32;
    let mut point = || {
        let triangle = ((unit() * mesh.triangles.len() as f32) as u32).min(mesh.triangles.len() as u32 - 1);
        let (r, s) = (unit().sqrt(), unit());
        let lambda = Vec3::new(1.0 - r, r * (1.0 - s), r * s);
        let mut step = || {
            let (r, s, scale) = (2.0 * unit() - 1.0, 2.0 * unit() - 1.0, 15.0 * unit() - 12.0);
            Vec3::new(r, s, -r - s) * scale.exp2()
        };
        let lambda_steps = [step(), step()];
        (SurfacePoint { triangle, lambda }, Footprint { lambda_steps })
    };
    (0..count).map(|_| point()).collect()
}

/// Whatever the footprint, a value is a number; a very large one sees the mean.
#[test]
fn footprints_without_bounds_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = tetrahedron();
    let cache = noise(folder.path(), &mesh, &mut Random::new(8));
    let lambda = Vec3::new(0.3, 0.4, 0.3);
    for filter in Filter::ALL {
        let sampler = Sampler::of_cache(&cache, FilterOptions { filter, ..FilterOptions::default() });
        for size in [1e25, f32::MAX, f32::INFINITY, f32::NAN] {
            for other in [0.0, 1.0, size] {
                let lambda_steps = [Vec3::new(size, -size, 0.0), Vec3::new(0.0, other, -other)];
                for triangle in 0..mesh.triangles.len() as u32 {
                    let (point, footprint) = (SurfacePoint { triangle, lambda }, Footprint { lambda_steps });
                    let value = sampler.sample(ChannelKind::BaseColor, point, footprint).unwrap();
                    assert!(value.is_finite(), "{filter:?}, {size} and {other}: {value}");
                    let has_levels = !matches!(filter, Filter::Nearest | Filter::Bilinear | Filter::Bicubic);
                    if size == 1e25 && other == size && has_levels {
                        let error = (value - Vec4::new(0.4, 0.5, 0.6, 1.0)).abs().max_element();
                        assert!(error < 1e-3, "{filter:?}: {value}");
                    }
                }
            }
        }
    }
}

fn tolerance(kind: ChannelKind) -> f32 {
    match kind {
        ChannelKind::Normal | ChannelKind::Anisotropy => DIRECTION_TOLERANCE,
        _ => TOLERANCE,
    }
}

/// Strength times the direction of a line, as a vector that does not depend on which way the line points.
fn doubled(value: Vec4) -> [f32; 6] {
    let d = value.truncate();
    [d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.y * d.z, d.z * d.x].map(|x| x * value.w)
}

fn difference(kind: ChannelKind, a: Vec4, b: Vec4) -> f32 {
    if kind == ChannelKind::Anisotropy {
        return doubled(a).iter().zip(doubled(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    }
    (a - b).abs().max_element()
}

#[test]
fn many_points_and_single_points_have_the_same_values() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random::new(5);
    for mesh in [sheet(3), tetrahedron()] {
        let cache = noise(folder.path(), &mesh, &mut random);
        for filter in Filter::ALL {
            let sampler = Sampler::of_cache(&cache, FilterOptions { filter, ..FilterOptions::default() });
            let points = random_points(&mesh, &mut random, 700);
            for Channel { kind, .. } in channels() {
                let together = sampler.sample_many(kind, &points).unwrap();
                for (&(point, footprint), many) in points.iter().zip(&together) {
                    let one = sampler.sample(kind, point, footprint).unwrap();
                    let off = difference(kind, one, *many);
                    assert!(off <= tolerance(kind), "{filter:?} {kind}: {one} {many} at {point:?}");
                }
            }
            let at: Vec<_> = points.iter().map(|&(p, f)| sampler.sample_point(p, f)).collect();
            for (at, many) in at.iter().zip(sampler.values_many(&at)) {
                let one = sampler.values(at);
                assert_eq!(one.lookups, many.lookups);
                let of = |values: &fantex_store::SurfaceValues| {
                    let stretch = values.stretch.unwrap();
                    [
                        (ChannelKind::BaseColor, values.base_color),
                        (ChannelKind::Normal, values.normal.extend(1.0)),
                        (ChannelKind::OcclusionRoughnessMetallic, values.occlusion_roughness_metallic),
                        (ChannelKind::Emission, values.emission),
                        (ChannelKind::Light, values.light),
                        (ChannelKind::Anisotropy, stretch.direction.extend(stretch.strength)),
                    ]
                };
                for ((kind, one), (_, many)) in of(&one).into_iter().zip(of(&many)) {
                    assert_eq!(one, sampler.sample(kind, at.point, at.footprint).unwrap(), "{kind}");
                    let off = difference(kind, one, many);
                    assert!(off <= tolerance(kind), "{filter:?} {kind}: {one} {many} at {:?}", at.point);
                }
            }
        }
        assert_eq!(cache.damage().pages, 0);
    }
}

#[test]
fn without_a_footprint_the_finest_level_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random::new(6);
    let mesh = sheet(2);
    let cache = noise(folder.path(), &mesh, &mut random);
    for filter in [Filter::Bilinear, Filter::Trilinear, Filter::Anisotropic] {
        let sampler = Sampler::of_cache(&cache, FilterOptions { filter, ..FilterOptions::default() });
        for (point, _) in random_points(&mesh, &mut random, 200) {
            let mut expected = Vec4::ZERO;
            for tap in sampler.taps(point) {
                expected +=
                    Vec4::from_array(cache.tile(0, TileId { group: tap.group, level: 0 }).bilinear(tap.uv))
                        * tap.weight;
            }
            assert_eq!(sampler.sample(ChannelKind::BaseColor, point, Footprint::NONE).unwrap(), expected);
        }
    }
}

#[test]
fn a_sampler_can_be_kept_and_names_what_is_missing() {
    fn is_kept<T: Send + Sync + Clone + 'static>(_: &T) {}
    let folder = tempfile::tempdir().unwrap();
    let cache = noise(folder.path(), &tetrahedron(), &mut Random::new(7));
    let sampler = Sampler::of_cache(&cache, FilterOptions::default());
    is_kept(&sampler);
    let beyond = SurfacePoint { triangle: 4, lambda: Vec3::X };
    let error = sampler.sample(ChannelKind::BaseColor, beyond, Footprint::NONE).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::InvalidArgument);
    let (mesh, cover) = (cache.asset().shared_mesh(), cache.asset().shared_cover());
    let bare = Sampler::new(mesh, cover, &[], &cache, FilterOptions::default());
    let point = SurfacePoint { triangle: 0, lambda: Vec3::X };
    let error = bare.sample(ChannelKind::Light, point, Footprint::NONE).unwrap_err();
    assert_eq!(
        (error.kind(), error.to_string().as_str()),
        (ErrorKind::NotFound, "there is no light channel")
    );
    let values = bare.values(&bare.sample_point(point, Footprint::NONE));
    assert_eq!((values.base_color, values.stretch, values.lookups), (Vec4::ZERO, None, 0));
    assert_eq!(values.normal, bare.vertex_normal(point));
}
