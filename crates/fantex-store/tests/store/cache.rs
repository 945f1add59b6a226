//! Look-ups through the page cache.

use std::path::Path;
use std::sync::Arc;

use fantex_store::{Asset, PAGE, PageCache, PageId, TileId, TileSource, TileTexels, page_grid};
use glam::Vec2;

use crate::common::{block_channels, fan_cover, plain_channels, sheet, write};

/// A whole tile level, assembled from its pages.
fn whole_level(asset: &Asset, channel: usize, group: u32, level: u32) -> ([u32; 2], Vec<[f32; 4]>) {
    let extent = asset.cover().groups[group as usize].level_extent(level);
    let mut texels = vec![[0.0; 4]; (extent[0] * extent[1]) as usize];
    let [columns, rows] = page_grid(extent);
    for page in (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])) {
        let stored = asset.read_page(channel, PageId { group, level, page }).unwrap();
        for (i, texel) in stored.rgba.iter().enumerate() {
            let (x, y) = (i as u32 % stored.extent[0], i as u32 / stored.extent[0]);
            texels[((page[1] * PAGE + y) * extent[0] + page[0] * PAGE + x) as usize] = *texel;
        }
    }
    (extent, texels)
}

/// The definition of a bilinear look-up, in double precision.
fn reference(extent: [u32; 2], texels: &[[f32; 4]], uv: Vec2) -> [f64; 4] {
    let at = |u: f32, n: u32| (f64::from(u) * f64::from(n)).clamp(0.5, f64::from(n) - 0.5) - 0.5;
    let (x, y) = (at(uv.x, extent[0]), at(uv.y, extent[1]));
    let texel = |i: f64, j: f64| {
        let (i, j) = ((i as u32).min(extent[0] - 1), (j as u32).min(extent[1] - 1));
        texels[(j * extent[0] + i) as usize].map(f64::from)
    };
    let (i, j, fx, fy) = (x.floor(), y.floor(), x.fract(), y.fract());
    let [a, b, c, d] = [texel(i, j), texel(i + 1.0, j), texel(i, j + 1.0), texel(i + 1.0, j + 1.0)];
    std::array::from_fn(|k| {
        (1.0 - fy) * ((1.0 - fx) * a[k] + fx * b[k]) + fy * ((1.0 - fx) * c[k] + fx * d[k])
    })
}

fn sample_asset(path: &Path, channels: &[fantex_store::Channel]) -> Arc<Asset> {
    let mesh = sheet(1);
    let cover = fan_cover(&mesh, |v| [[600, 260], [64, 48], [4, 4], [12, 516]][v % 4]);
    write(path, &mesh, &cover, channels, 9).unwrap();
    Arc::new(Asset::open(path).unwrap())
}

#[test]
fn bilinear_follows_its_definition_across_page_borders() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    for channels in [block_channels(), plain_channels()] {
        let asset = sample_asset(&path, &channels);
        // A budget that nothing fits into still works.
        for budget in [64 << 20, 1] {
            let cache = PageCache::new(Arc::clone(&asset), budget);
            for group in 0..4 {
                let last = asset.cover().groups[group as usize].level_count() - 1;
                for level in [0, 1, last, 99] {
                    for channel in 0..channels.len() {
                        let (extent, texels) = whole_level(&asset, channel, group, level.min(last));
                        let tile = cache.tile(channel, TileId { group, level });
                        assert_eq!((tile.extent(), tile.level()), (extent, level.min(last)));
                        for i in 0..200 {
                            let uv = Vec2::new((i as f32 * 0.618).fract(), (i as f32 * 0.755).fract());
                            let uv = if i < 20 { uv * 3.0 - 1.0 } else { uv };
                            let (got, due) = (tile.bilinear(uv), reference(extent, &texels, uv));
                            for k in 0..4 {
                                // 600 columns in single precision place a point to about 600 * 2^-24 texels.
                                assert!((f64::from(got[k]) - due[k]).abs() < 1e-4, "{got:?} {due:?}");
                            }
                        }
                        let corner = texels[texels.len() - 1];
                        assert_eq!(tile.texel(u32::MAX, u32::MAX), corner);
                        assert_eq!(tile.bilinear(Vec2::splat(7.0)), corner);
                    }
                }
            }
            assert_eq!(cache.damage(), Default::default());
        }
    }
}

#[test]
fn coordinates_that_are_no_numbers_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let asset = sample_asset(&folder.path().join("a.fan"), &block_channels());
    let cache = PageCache::new(asset, 1 << 20);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN] {
        for group in 0..4 {
            let value = cache.tile(0, TileId { group, level: 0 }).bilinear(Vec2::new(bad, 0.5));
            assert!(value.iter().all(|x| x.is_finite()));
        }
    }
}

/// Flips a bit in each of the clusters that hold level 0, i.e. in the greatest part of the file.
#[test]
fn damaged_tiles_give_way_to_coarser_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    let channels = block_channels();
    let asset = sample_asset(&path, &channels);
    let coarse = [0, 1, 3].map(|group| (group, whole_level(&asset, 0, group, 1)));
    let clusters = asset.cluster_ranges(0);
    drop(asset);
    let mut bytes = std::fs::read(&path).unwrap();
    for range in &clusters {
        bytes[(range.start + range.end) as usize / 2] ^= 4;
    }
    std::fs::write(&path, bytes).unwrap();
    let asset = Arc::new(Asset::open(&path).unwrap());
    let cache = PageCache::new(Arc::clone(&asset), 1 << 24);
    for (group, (extent, texels)) in &coarse {
        let uv = Vec2::new(0.41, 0.63);
        let (got, due) =
            (cache.tile(0, TileId { group: *group, level: 0 }).bilinear(uv), reference(*extent, texels, uv));
        assert!((0..4).all(|k| (f64::from(got[k]) - due[k]).abs() < 1e-4), "{got:?} {due:?}");
    }
    // A single level and nothing coarser: the mean.
    assert_eq!(cache.tile(0, TileId { group: 2, level: 0 }).bilinear(Vec2::splat(0.5)), asset.mean(0, 2));
    let damage = cache.damage();
    assert_eq!(damage.pages, 4);
    assert!(damage.first[0].2.contains("checksum"), "{damage:?}");
}

#[test]
fn threads_share_a_cache() {
    let folder = tempfile::tempdir().unwrap();
    let asset = sample_asset(&folder.path().join("a.fan"), &block_channels());
    let expected = whole_level(&asset, 0, 0, 0);
    let cache = PageCache::new(asset, 1 << 18);
    let tile = cache.tile(0, TileId { group: 0, level: 0 });
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (tile, cache, expected) = (&tile, &cache, &expected);
            scope.spawn(move || {
                for i in 0..2000 {
                    let uv =
                        Vec2::new((i as f32 * 0.377 + thread as f32).fract(), (i as f32 * 0.511).fract());
                    let due = reference(expected.0, &expected.1, uv);
                    for got in [tile.bilinear(uv), cache.tile(0, TileId { group: 0, level: 0 }).bilinear(uv)]
                    {
                        assert!((0..4).all(|k| (f64::from(got[k]) - due[k]).abs() < 1e-4));
                    }
                }
            });
        }
    });
}
