//! Tests of the crate `fantex-paint` from outside.

#![allow(clippy::unwrap_used, reason = "a step that fails fails the test")]

mod added;
mod cut_outs;
mod due_levels;
mod groups;
mod lasting;
mod layers;
mod opacity;
mod painting;
mod regions;
mod relief;
mod removed;
mod symmetry;
mod texels;
mod tips;
mod tools;
mod values;
mod views;
mod work;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use fantex_bake::{
    BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, TexelPoint as BakedPoint, bake,
};
use fantex_cover::{Cover, CoverOptions, TexelBudget, build_cover};
use fantex_mesh::{Mesh, generate};
use fantex_paint::{
    BlendMode, Brush, ChannelPaint, Paint, PaintColor, PaintOptions, Painter, Sample, Size, Stroke,
    StrokeFile, Surface, Symmetry, Tool, dabs_of, replay,
};
use fantex_store::{
    Asset, ChannelKind, PageCache, PageId, TileId, TileSource, TileTexels, VerifyOptions, group_pages, verify,
};
use glam::{DVec3, Vec3, Vec4};

pub(crate) use fantex_test::{cleaned, data_folder, loaded, mesh_of};

// Meshes, baked assets and strokes.

/// A closed plate of 2 x 2, so thick: `n` by `n` squares above and below.
pub(crate) fn plate(n: u32, thickness: f64) -> Mesh {
    let side = n + 1;
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    let sheet = |y: f64| (0..side * side).map(move |i| DVec3::new(at(i % side), y, at(i / side)));
    let positions: Vec<DVec3> = sheet(0.5 * thickness).chain(sheet(-0.5 * thickness)).collect();
    let top = |x: u32, z: u32| z * side + x;
    let bottom = |x: u32, z: u32| side * side + z * side + x;
    let mut triangles = Vec::new();
    for z in 0..n {
        for x in 0..n {
            let [a, b, c, d] = [top(x, z), top(x + 1, z), top(x, z + 1), top(x + 1, z + 1)];
            triangles.extend([[a, c, b], [b, c, d]]);
            let [a, b, c, d] = [bottom(x, z), bottom(x + 1, z), bottom(x, z + 1), bottom(x + 1, z + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    for i in 0..n {
        for (u, v) in [((i, 0), (i + 1, 0)), ((i + 1, n), (i, n)), ((0, i + 1), (0, i)), ((n, i), (n, i + 1))]
        {
            let [a, b] = [top(u.0, u.1), top(v.0, v.1)];
            let [c, d] = [bottom(u.0, u.1), bottom(v.0, v.1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    mesh_of(positions, triangles)
}

pub(crate) fn cover(mesh: &Mesh, tile: u32, texels: u64) -> Cover {
    let budget = TexelBudget::Total(texels);
    build_cover(mesh, &CoverOptions { tile, budget, ..CoverOptions::default() }).unwrap().0
}

/// Base colour and roughness.
struct Plain;

impl Source for Plain {
    fn channels(&self) -> Vec<SourceChannel> {
        [ChannelKind::BaseColor, ChannelKind::OcclusionRoughnessMetallic]
            .map(|kind| SourceChannel { kind, has_alpha: false, exceeds_one: false })
            .to_vec()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &BakedPoint, values: &mut [Vec4]) {
        let wave = (point.position * 9.0).to_array().map(|x| 0.25 + 0.2 * x.sin());
        values[0] = Vec3::from(wave).extend(1.0);
        values[1] = Vec4::new(1.0, 0.5, 0.0, 1.0);
    }
}

/// An asset in a folder that lives as long.
pub(crate) struct Baked {
    pub(crate) path: PathBuf,
    pub(crate) folder: tempfile::TempDir,
}

impl Baked {
    pub(crate) fn new(mesh: &Mesh, cover: &Cover, format: BakeFormat) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        let options = BakeOptions { format, ..BakeOptions::default() };
        bake(mesh, cover, &Plain, &path, &options, &NoProgress).unwrap();
        Self { path, folder }
    }

    pub(crate) fn painter(&self) -> Painter {
        Painter::open(&self.path, &PaintOptions::default()).unwrap()
    }

    pub(crate) fn cache(&self) -> PageCache {
        PageCache::new(Arc::new(Asset::open(&self.path).unwrap()), 1 << 28)
    }
}

/// Red, and smoother, together.
pub(crate) fn red(opacity: f32) -> Paint {
    let color = |channel, color| ChannelPaint::new(channel, PaintColor::Constant(color));
    Paint {
        tool: Tool::Paint(BlendMode::Normal),
        opacity,
        channels: vec![color(0, Vec4::new(0.9, 0.05, 0.05, 1.0)), color(1, Vec4::new(1.0, 0.1, 1.0, 1.0))],
        stencil: None,
        sight: None,
    }
}

/// A soft stroke along mesh-space positions.
pub(crate) fn stroke(surface: &Surface, texels: f32, positions: &[Vec3]) -> Stroke {
    let sample = |p: &Vec3| Sample::at(surface.nearest(*p, f32::INFINITY).unwrap());
    Stroke {
        brush: Brush { size: Size::Texels(texels), hardness: 0.2, ..Brush::default() },
        stamp: None,
        samples: positions.iter().map(sample).collect(),
        line: false,
        symmetry: Symmetry::None,
    }
}

pub(crate) fn paint_stroke(painter: &mut Painter, paint: Paint, stroke: &Stroke) {
    let surface = Arc::clone(painter.surface());
    painter.begin("test", paint).unwrap();
    painter.dab(&dabs_of(&surface, stroke)).unwrap();
    painter.end().unwrap();
}

/// Pages with their bytes, and means.
pub(crate) type Contents = (Vec<(PageId, Vec<u8>)>, Vec<[f32; 4]>);

/// All pages' bytes, in all channels, as the painter sees them, and all means.
pub(crate) fn contents(painter: &Painter) -> Contents {
    let editor = painter.editor();
    let (cover, channels) = (editor.asset().cover(), editor.asset().channels().len());
    let mut pages = Vec::new();
    let mut means = Vec::new();
    for (g, group) in (0u32..).zip(&cover.groups) {
        for id in group_pages(g, group) {
            pages.extend((0..channels).map(|channel| (id, editor.read_page_raw(channel, id).unwrap())));
        }
        means.extend((0..channels).map(|channel| editor.mean(channel, g)));
    }
    (pages, means)
}

/// The texture function of a channel with all tiles at one level (or their last), and each tile's own value.
pub(crate) fn sample(
    cache: &PageCache,
    channel: usize,
    level: u32,
    triangle: usize,
    lambda: Vec3,
) -> (Vec4, Vec<Vec4>) {
    let (mesh, cover) = (cache.asset().mesh(), cache.asset().cover());
    let mut sum = Vec4::ZERO;
    let mut parts = Vec::new();
    for (slot, weight) in cover.weights(triangle, lambda).iter() {
        let [a, b, c] = cover.tile_corners(mesh, triangle, slot);
        let uv = a * lambda.x + b * lambda.y + c * lambda.z;
        let group = cover.corner_groups[triangle][slot];
        let part = Vec4::from_array(cache.tile(channel, TileId { group, level }).bilinear(uv));
        sum += weight * part;
        parts.push(part);
    }
    (sum, parts)
}

/// A ball of 5120 triangles.
pub(crate) fn ball(texels: u64, format: BakeFormat) -> Baked {
    let mesh = cleaned(generate::icosphere(4));
    Baked::new(&mesh, &cover(&mesh, 64, texels), format)
}

/// A ball of 20480 triangles.
pub(crate) fn fine_ball(texels: u64) -> Baked {
    let mesh = cleaned(generate::icosphere(5));
    Baked::new(&mesh, &cover(&mesh, 64, texels), BakeFormat::Bc7)
}

/// The strokes of a stroke file.
pub(crate) fn strokes(text: &str) -> StrokeFile {
    serde_json::from_str(&format!(r#"{{ "version": 1, "strokes": [{text}] }}"#)).unwrap()
}

/// Paints the strokes of a stroke file and commits them.
pub(crate) fn run(baked: &Baked, text: &str) -> Painter {
    let mut painter = baked.painter();
    replay(&mut painter, &strokes(text), baked.folder.path()).unwrap();
    painter.commit().unwrap();
    painter
}

/// The base colour at the point of the surface nearest to a position.
pub(crate) fn color_at(cache: &PageCache, painter: &Painter, at: Vec3) -> Vec4 {
    let point = painter.surface().nearest(at, f32::INFINITY).unwrap();
    sample(cache, 0, 0, point.triangle as usize, point.lambda).0
}

// Work in slices that is interrupted.

/// With so little memory that changes and steps go to the file in parts.
pub(crate) fn open(baked: &Baked) -> Painter {
    Painter::open(&baked.path, &PaintOptions { memory_bytes: 2 << 20, history: true }).unwrap()
}

/// Slices, of which none is the last.
pub(crate) fn slices(painter: &mut Painter, count: usize) {
    (0..count).for_each(|_| assert!(!painter.work_on(Instant::now()).unwrap(), "there is more to do"));
}

/// As a crash leaves it: what came after the last commit is gone.
pub(crate) fn crash(painter: Painter, baked: &Baked) -> Painter {
    drop(painter);
    assert!(verify(&baked.path, &VerifyOptions::default()).unwrap().ok);
    open(baked)
}

/// A stroke on the base, so that there are layers over something painted.
pub(crate) fn start(baked: &Baked) -> (Painter, Contents) {
    let mut painter = open(baked);
    let line = stroke(painter.surface(), 40.0, &[Vec3::X, Vec3::new(0.5, 0.5, 0.7), Vec3::Z]);
    paint_stroke(&mut painter, red(0.9), &line);
    painter.commit().unwrap();
    let before = contents(&painter);
    (painter, before)
}
