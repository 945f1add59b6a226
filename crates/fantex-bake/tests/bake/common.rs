//! Meshes, sources and short ways to baked assets.

use std::path::PathBuf;
use std::sync::Arc;

use fantex_bake::{
    BakeFormat, BakeOptions, Fit, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake,
};
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{Mesh, interpolate};
use fantex_store::{Asset, ChannelKind, PageCache, TileId, TileSource, TileTexels};
pub(crate) use fantex_test::cleaned;
pub(crate) use fantex_test::data_folder;
pub(crate) use fantex_test::loaded;
pub(crate) use fantex_test::mesh_of;
use glam::{DVec3, Vec3, Vec4};

/// A flat rectangle of two triangles.
pub(crate) fn rectangle(width: f64, height: f64) -> Mesh {
    let corner = |x: f64, y: f64| DVec3::new(x * width, 0.0, y * height);
    let positions = vec![corner(0.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0), corner(1.0, 0.0)];
    mesh_of(positions, vec![[0, 1, 2], [0, 2, 3]])
}

/// A fan of needles: as long as they are, only `width` apart.
pub(crate) fn needles(width: f64) -> Mesh {
    let mut positions = vec![DVec3::ZERO];
    positions.extend((0..12).map(|i| DVec3::new(1.0, f64::from(i) * width, 0.1 * f64::from(i % 3))));
    mesh_of(positions, (1..12u32).map(|i| [0, i, i + 1]).collect())
}

pub(crate) fn cover(mesh: &Mesh, tile: u32, texels: u64) -> Cover {
    let budget = TexelBudget::Total(texels);
    build_cover(mesh, &CoverOptions { tile, budget, ..CoverOptions::default() }).unwrap().0
}

pub(crate) fn float_options(fit: Fit) -> BakeOptions {
    BakeOptions { fit, format: BakeFormat::Float, ..BakeOptions::default() }
}

/// An asset in a folder that lives as long.
pub(crate) struct Baked {
    pub(crate) cache: PageCache,
    pub(crate) path: PathBuf,
    _folder: tempfile::TempDir,
}

pub(crate) fn baked(mesh: &Mesh, cover: &Cover, source: &dyn Source, options: &BakeOptions) -> Baked {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fan");
    bake(mesh, cover, source, &path, options, &NoProgress).unwrap();
    let cache = PageCache::new(Arc::new(Asset::open(&path).unwrap()), 1 << 28);
    Baked { cache, path, _folder: folder }
}

/// The texture function with all tiles at one level (or their last).
pub(crate) fn sample(cache: &PageCache, channel: usize, level: u32, triangle: usize, lambda: Vec3) -> Vec4 {
    let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
    let mut sum = Vec4::ZERO;
    for (slot, weight) in cover.weights(triangle, lambda).iter() {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = interpolate([a, b, c], lambda);
        let group = cover.corner_groups[triangle][slot];
        sum += weight * Vec4::from_array(cache.tile(channel, TileId { group, level }).bilinear(uv));
    }
    sum
}

/// Barycentric coordinates on a triangular grid, corners and edges included, and some close to the corners.
pub(crate) fn barycentric_points(n: u32) -> Vec<Vec3> {
    let grid = (0..=n)
        .flat_map(|i| (0..=n - i).map(move |j| Vec3::new(i as f32, j as f32, (n - i - j) as f32) / n as f32));
    let near = [0.001f32, 0.004, 0.009, 0.02, 0.11].into_iter().flat_map(|s| {
        [0, 1, 2].map(|k| {
            let mut lambda = Vec3::splat(0.5 * s);
            lambda[k] = 1.0 - s;
            lambda
        })
    });
    grid.chain(near).collect()
}

/// The same values everywhere.
pub(crate) struct Constant(pub(crate) Vec<(ChannelKind, Vec4)>);

impl Source for Constant {
    fn channels(&self) -> Vec<SourceChannel> {
        self.0.iter().map(|&(kind, _)| SourceChannel { kind, has_alpha: true, exceeds_one: false }).collect()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Box
    }

    fn evaluate(&self, _: &TexelPoint, values: &mut [Vec4]) {
        values.iter_mut().zip(&self.0).for_each(|(value, channel)| *value = channel.1);
    }
}

/// A function of the position, mesh space.
pub(crate) struct OfPosition<F>(pub(crate) F);

impl<F: Fn(Vec3) -> Vec4 + Sync> Source for OfPosition<F> {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        values[0] = (self.0)(point.position);
    }
}
