//! Fans for other programs: three look-ups in a sheet are the texture function.

use fantex_bake::NoProgress;
use fantex_base::Random;
use fantex_export::{ChannelMap, FanSheetOptions, FanSheets, fan_sheets};
use fantex_mesh::SurfacePoint;
use fantex_store::{ChannelKind, Footprint, PageCache, Sampler};
use fantex_texture::FilterOptions;
use glam::{Vec2, Vec3};

use crate::support::baked_bottle;

/// What a shader computes: bilinear look-ups in a picture of 8 bits, blended.
fn shaded(fans: &FanSheets, map: usize, point: SurfacePoint) -> Vec3 {
    let sheet = &fans.sheets[fans.sheet_of_triangle[point.index()] as usize];
    let [width, height] = sheet.size.map(|n| n as usize);
    let components = fans.maps[map].components;
    let texel = |x: f32, y: f32| {
        let place = y as usize * width + x as usize;
        let start = place.min(width * height - 1) * components;
        Vec3::from([0, 1, 2].map(|k| f32::from(sheet.pictures[map][start + k]) / 255.0))
    };
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for slot in 0..3 {
        let others = point.lambda[(slot + 1) % 3].max(point.lambda[(slot + 2) % 3]);
        let weight = (point.lambda[slot] - others + fans.delta).max(0.0);
        let uv = point.interpolate(fans.uv[point.index()][slot]);
        let at = uv * Vec2::new(width as f32, height as f32) - 0.5;
        let (low, share) = (at.floor(), at - at.floor());
        let row = |y: f32| texel(low.x, y) * (1.0 - share.x) + texel(low.x + 1.0, y) * share.x;
        sum += (row(low.y) * (1.0 - share.y) + row(low.y + 1.0) * share.y) * weight;
        weights += weight;
    }
    sum / weights
}

#[test]
fn three_look_ups_are_the_texture_function() {
    let baked = baked_bottle(1 << 16);
    let sampler = Sampler::of_cache(&PageCache::new(baked.asset.clone(), 64 << 20), FilterOptions::default());
    for largest_side in [8192, 320] {
        let options = FanSheetOptions { largest_side, ..FanSheetOptions::default() };
        let fans = fan_sheets(&baked.asset, &options, &NoProgress).unwrap();
        assert_eq!(fans.sheets.len() > 1, largest_side == 320, "{} sheets", fans.sheets.len());
        let map = fans.maps.iter().position(|m| m.map == ChannelMap::OcclusionRoughnessMetallic).unwrap();
        let mut random = Random::new(7);
        let triangles = baked.asset.mesh().triangles.len();
        for _ in 0..4000 {
            let cut: [f32; 2] = [random.unit() as f32, random.unit() as f32];
            let [a, b] = [cut[0].min(cut[1]), cut[0].max(cut[1])];
            let triangle = random.below(triangles as u64) as u32;
            let point = SurfacePoint { triangle, lambda: Vec3::new(a, b - a, 1.0 - b) };
            let truth = sampler
                .sample(ChannelKind::OcclusionRoughnessMetallic, point, Footprint::NONE)
                .unwrap()
                .truncate();
            let seen = shaded(&fans, map, point);
            assert!((seen - truth).abs().max_element() < 3e-3, "{point:?}: {seen} {truth}");
        }
    }
}
