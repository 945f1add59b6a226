//! Fan surfaces shade many points at once as they shade them one by one.

use std::sync::{Arc, LazyLock};

use crate::common::sheet;
use crate::common::tiles::fan_cover;
use fantex_cover::Cover;
use fantex_mesh::{Material, Mesh};
use fantex_render::{FanSurface, FilterOptions, Hit, MaterialSample, Surface};
use fantex_store::{
    Asset, AssetWriter, Channel, ChannelKind, CreateOptions, EncodedPage, PageCache, PageId, TexelFormat,
    group_pages,
};
use fantex_texture::Filter;
use glam::Vec3;
use proptest::prelude::*;

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
    let triangles = SHEET.0.triangles.len();
    let hit = (0..triangles, lambda, change(), change(), any::<bool>());
    let hit = hit.prop_map(|(triangle, lambda, dlambda_dx, dlambda_dy, front)| Hit {
        triangle,
        lambda,
        dlambda_dx,
        dlambda_dy,
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
        || (a.normal_steps, a.unlit, a.lookups) != (b.normal_steps, b.unlit, b.lookups)
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
