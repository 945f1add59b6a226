//! A scene for both renderers, and how alike their pictures are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::{BakeOptions, NoProgress, Source, bake};
use fantex_base::ErrorKind;
use fantex_cover::Cover;
use fantex_gpu::{
    AtlasViewer, DrawOptions, FanModel, FanModelSource, Frame, Gpu, GpuOptions, Model, Readback, UvModel,
    render_to_picture,
};
use fantex_mesh::{ImageSource, Mesh};
use fantex_render::{FanSurface, LookSurface, RenderOptions, ShadingRate, Surface, render};
use fantex_scene::{Background, Camera, FilterOptions, Lights, Picture, Shading};
use fantex_store::{
    Asset, PageCache, PageId, Sampler, TexelFormat, Tile, TileId, TileSource, TileTexels, decode,
    group_pages, page_extent,
};
use fantex_stream::{
    AtlasFormat, AtlasPlace, FrameChanges, Outline, PageTable, ParcelTexels, ParcelUpload, TableChange,
    TableEntry,
};
pub(crate) use fantex_test::{data, opened as loaded_from};
use fantex_texture::{Filter, Image};
use glam::Vec2;

/// The GPU, or nothing and a line that says so.
pub(crate) fn gpu() -> Option<Gpu> {
    match Gpu::headless(&GpuOptions::default()) {
        Ok(gpu) => Some(gpu),
        Err(error) if error.kind() == ErrorKind::Unavailable => {
            fantex_test::skip(&error.to_string());
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// A file of the repository's assets.
pub(crate) fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets").join(name)
}

pub(crate) fn loaded(name: &str) -> Mesh {
    loaded_from(&asset(name))
}

/// An image as a material refers to it.
pub(crate) fn embedded(image: &Image) -> ImageSource {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("texture.png");
    image.save(&path).unwrap();
    ImageSource::Embedded { label: "a texture".into(), bytes: Arc::from(std::fs::read(path).unwrap()) }
}

/// What both renderers are given.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) mesh: Mesh,
    pub(crate) camera: Camera,
    pub(crate) lights: Lights,
    pub(crate) shading: Shading,
    pub(crate) background: Background,
    pub(crate) filter: FilterOptions,
    pub(crate) exposure: f32,
    pub(crate) samples: u32,
    pub(crate) size: [u32; 2],
}

impl Scene {
    /// A framed mesh under the default lights, one sample per pixel.
    pub(crate) fn of(mesh: Mesh) -> Self {
        let size = [320, 240];
        let camera = Camera::framing_mesh(&mesh, Camera::THREE_QUARTER, 4.0 / 3.0);
        Self {
            mesh,
            camera,
            lights: Lights::default(),
            shading: Shading::MetallicRoughness,
            background: Background::default(),
            filter: FilterOptions { filter: Filter::Trilinear, ..FilterOptions::default() },
            exposure: 1.0,
            samples: 1,
            size,
        }
    }

    pub(crate) fn options(&self) -> DrawOptions {
        DrawOptions {
            shading: self.shading,
            filter: self.filter,
            background: self.background,
            exposure: self.exposure,
            tone_map: None,
            samples: self.samples,
            ..DrawOptions::default()
        }
    }

    pub(crate) fn on_cpu(&self) -> Picture {
        let surface = LookSurface::of_model(&self.mesh, self.filter).unwrap();
        let options = RenderOptions {
            width: self.size[0],
            height: self.size[1],
            samples: self.samples,
            shading: self.shading,
            background: self.background,
            exposure: self.exposure,
            ..RenderOptions::default()
        };
        render(&self.mesh, &surface, &self.camera, &self.lights, &options).unwrap().picture
    }

    pub(crate) fn on_gpu(&self, gpu: &Gpu) -> Picture {
        let mut model = UvModel::load(gpu, &self.mesh).unwrap();
        self.of_model(gpu, &mut model)
    }

    pub(crate) fn of_model(&self, gpu: &Gpu, model: &mut dyn Model) -> Picture {
        let options = self.options();
        let mut frame =
            Frame { size: self.size, camera: &self.camera, lights: &self.lights, model, options: &options };
        render_to_picture(gpu, &mut frame).unwrap()
    }

    /// Both pictures; they are saved beside each other, with their difference, under `target/gpu-pictures`.
    pub(crate) fn compare(&self, gpu: &Gpu, name: &str) -> Difference {
        let (cpu, gpu) = (self.on_cpu(), self.on_gpu(gpu));
        Difference::of(&cpu, &gpu, name)
    }
}

/// How two pictures differ, in steps of 8-bit sRGB (premultiplied) and alpha.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Difference {
    name: String,
    /// Mean over all pixels and channels.
    pub(crate) mean: f64,
    /// Number of pixels by the largest difference of a channel.
    histogram: Vec<u64>,
}

impl Difference {
    pub(crate) fn of(a: &Picture, b: &Picture, name: &str) -> Self {
        let [bytes_a, bytes_b] = [a, b].map(|picture| {
            let bytes = |p: &[f32; 4]| {
                // The colour of what is hardly there means little.
                let byte = |v: f32| fantex_texture::color::srgb8_from_linear(v * p[3]);
                [byte(p[0]), byte(p[1]), byte(p[2]), fantex_texture::color::unorm8(p[3])]
            };
            picture.rgba.iter().map(bytes).collect::<Vec<[u8; 4]>>()
        });
        let mut histogram = vec![0; 256];
        let mut sum = 0.0;
        for (p, q) in bytes_a.iter().zip(&bytes_b) {
            let steps = [0, 1, 2, 3].map(|c| p[c].abs_diff(q[c]));
            histogram[usize::from(*steps.iter().max().unwrap())] += 1;
            sum += steps.iter().map(|&s| f64::from(s)).sum::<f64>() / 4.0;
        }
        let difference = Self { name: name.into(), mean: sum / bytes_a.len() as f64, histogram };
        save_difference(name, a.width, a.height, &bytes_a, &bytes_b);
        println!("{name}: {}", difference.summary());
        difference
    }

    /// Share of the pixels that differ by more than some steps.
    pub(crate) fn share_above(&self, steps: usize) -> f64 {
        let all: u64 = self.histogram.iter().sum();
        self.histogram[steps + 1..].iter().sum::<u64>() as f64 / all as f64
    }

    pub(crate) fn summary(&self) -> String {
        let share = |steps| format!("{:.3} % above {steps}", 100.0 * self.share_above(steps));
        format!("mean {:.3}, {}, {}, {}, {}", self.mean, share(1), share(2), share(8), share(32))
    }

    /// Panics if the mean is larger than `mean`, or a larger share than `share` differs by more than `steps`.
    #[track_caller]
    pub(crate) fn assert_below(&self, mean: f64, steps: usize, share: f64) {
        let is_alike = self.mean <= mean && self.share_above(steps) <= share;
        assert!(is_alike, "{}: {} (see target/gpu-pictures)", self.name, self.summary());
    }
}

fn save_difference(name: &str, width: u32, height: u32, a: &[[u8; 4]], b: &[[u8; 4]]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/gpu-pictures");
    std::fs::create_dir_all(&folder).unwrap();
    let mut samples = Vec::new();
    for y in 0..height as usize {
        let row = y * width as usize..(y + 1) * width as usize;
        samples.extend(a[row.clone()].iter().chain(&b[row.clone()]).flat_map(|p| [p[0], p[1], p[2]]));
        let amplified =
            |(p, q): (&[u8; 4], &[u8; 4])| [0, 1, 2].map(|c| p[c].abs_diff(q[c]).saturating_mul(16));
        samples.extend(a[row.clone()].iter().zip(&b[row]).flat_map(amplified));
    }
    let image = Image {
        width: 3 * width,
        height,
        channels: 3,
        space: fantex_texture::ColorSpace::Srgb,
        samples: fantex_texture::Samples::U8(samples),
    };
    image.save(folder.join(format!("{name}.png"))).unwrap();
}

// Assets, their pages on the device, and pictures by both renderers.

/// A model of the test data.
pub(crate) fn loaded_data(name: &str) -> Option<Mesh> {
    fantex_test::data(name).map(|path| fantex_test::opened(&path))
}

/// An asset in a folder that lives as long.
pub(crate) struct Baked {
    cache: PageCache,
    /// Without any channel.
    is_bare: bool,
    _folder: tempfile::TempDir,
}

impl Baked {
    pub(crate) fn new(mesh: &Mesh, cover: &Cover, source: &dyn Source, options: &BakeOptions) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.fan");
        bake(mesh, cover, source, &path, options, &NoProgress).unwrap();
        let cache = PageCache::new(Arc::new(Asset::open(&path).unwrap()), 1 << 28);
        Self { cache, is_bare: false, _folder: folder }
    }

    /// As if the asset had no channels (which the format does not allow).
    pub(crate) fn without_channels(mesh: &Mesh, cover: &Cover) -> Self {
        struct Nothing;
        impl Source for Nothing {
            fn channels(&self) -> Vec<fantex_bake::SourceChannel> {
                let kind = fantex_store::ChannelKind::Displacement;
                vec![fantex_bake::SourceChannel { kind, has_alpha: false, exceeds_one: false }]
            }
            fn prefilter(&self) -> fantex_bake::Prefilter {
                fantex_bake::Prefilter::Point
            }
            fn evaluate(&self, _: &fantex_bake::TexelPoint, _: &mut [glam::Vec4]) {}
        }
        Self { is_bare: true, ..Self::new(mesh, cover, &Nothing, &BakeOptions::default()) }
    }

    pub(crate) fn asset(&self) -> &Arc<Asset> {
        self.cache.asset()
    }

    pub(crate) fn channels(&self) -> &[fantex_store::Channel] {
        if self.is_bare { &[] } else { self.asset().channels() }
    }

    pub(crate) fn cache(&self) -> &PageCache {
        &self.cache
    }

    pub(crate) fn surface<S: TileSource>(&self, tiles: S, options: &DrawOptions) -> FanSurface<S> {
        let asset = self.asset();
        let (mesh, cover) = (asset.shared_mesh(), asset.shared_cover());
        FanSurface::new(Sampler::new(mesh, cover, self.channels(), tiles, options.filter))
    }
}

/// Which pages are resident; a page only where the coarser pages beneath it are, too.
pub(crate) struct Residents {
    /// Whether a page may be resident.
    allowed: Box<dyn Fn(PageId) -> bool>,
    /// A level that cannot be read.
    hole: Option<u32>,
}

impl Residents {
    pub(crate) fn all() -> Self {
        Self { allowed: Box::new(|_| true), hole: None }
    }

    /// Nothing finer than a level.
    pub(crate) fn of_level(level: u32) -> Self {
        Self { allowed: Box::new(move |page| page.level >= level), hole: None }
    }

    /// Three quarters of what is possible.
    pub(crate) fn random(seed: u64) -> Self {
        let hash = move |page: PageId| {
            let mixed = [page.group, page.level, page.page[0], page.page[1]]
                .iter()
                .fold(seed.wrapping_add(1), |h, &v| {
                    (h ^ u64::from(v)).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(23)
                });
            mixed >> 40 & 3 != 0
        };
        Self { allowed: Box::new(hash), hole: None }
    }

    /// Everything but a level: finer pages come without it.
    pub(crate) fn without_level(level: u32) -> Self {
        Self { hole: Some(level), ..Self::all() }
    }

    fn has(&self, cover: &Cover, page: PageId) -> bool {
        self.hole != Some(page.level) && self.is_possible(cover, page)
    }

    fn is_possible(&self, cover: &Cover, page: PageId) -> bool {
        let group = &cover.groups[page.group as usize];
        (self.allowed)(page)
            && (page.level + 1 == group.level_count() || {
                let coarser = coarser_pages(cover, page);
                coarser.into_iter().all(|page| self.is_possible(cover, page))
            })
    }
}

/// The pages of the next level that cover a page.
fn coarser_pages(cover: &Cover, page: PageId) -> Vec<PageId> {
    let group = &cover.groups[page.group as usize];
    let (fine, coarse) = (group.level_extent(page.level), group.level_extent(page.level + 1));
    let range = |axis: usize| {
        let scale = f64::from(coarse[axis]) / f64::from(fine[axis]);
        let first = f64::from(page.page[axis] * 256) * scale;
        let end = f64::from((page.page[axis] * 256 + 256).min(fine[axis])) * scale;
        let last = ((end.ceil() as u32).max(1) - 1).min(coarse[axis] - 1);
        (first as u32).min(coarse[axis] - 1) / 256..=last / 256
    };
    let [columns, rows] = [range(0), range(1)];
    rows.flat_map(|y| columns.clone().map(move |x| (x, y)))
        .map(|(x, y)| PageId { group: page.group, level: page.level + 1, page: [x, y] })
        .collect()
}

/// A page's texels of a channel in an atlas format.
fn texels(asset: &Asset, channel: usize, page: PageId, format: AtlasFormat) -> Arc<[u8]> {
    let stored = asset.channels()[channel].format;
    let raw = asset.read_page_raw(channel, page).unwrap();
    let is_same = matches!(stored, TexelFormat::R8 | TexelFormat::Rg8 | TexelFormat::Rgba8);
    if format.is_compressed() || is_same {
        return raw.into();
    }
    let group = &asset.cover().groups[page.group as usize];
    let extent = page_extent(group.level_extent(page.level), page.page);
    let values = decode(stored, extent, &raw).unwrap();
    let byte = |v: f32| (v * 255.0).round() as u8;
    match format {
        AtlasFormat::R8 => values.iter().map(|v| byte(v[0])).collect(),
        AtlasFormat::Rg8 => values.iter().flat_map(|v| [byte(v[0]), byte(v[1])]).collect(),
        AtlasFormat::Rgba8 => values.iter().flat_map(|v| v.map(byte)).collect(),
        AtlasFormat::Rgba16F => {
            values.iter().flatten().flat_map(|&v| half::f16::from_f32(v).to_le_bytes()).collect()
        }
        _ => unreachable!("compressed"),
    }
}

/// Brings pages to the device, packed shelf by shelf, in two updates.
pub(crate) fn upload(
    gpu: &Gpu,
    model: &mut FanModel,
    asset: &Asset,
    table: &PageTable,
    residents: &Residents,
) {
    let cover = asset.cover();
    let pages = (0..cover.groups.len()).flat_map(|g| group_pages(g as u32, &cover.groups[g]));
    let extent =
        |page: &PageId| page_extent(cover.groups[page.group as usize].level_extent(page.level), page.page);
    let mut pages: Vec<PageId> = pages.filter(|&page| residents.has(cover, page)).collect();
    pages.sort_by_key(|page| std::cmp::Reverse(extent(page)[1]));
    let side = model.shape().side;
    let (mut layer, mut at, mut height) = (0, [0, 0], 0);
    let mut changes = FrameChanges::default();
    for page in pages {
        let [columns, rows] = extent(&page);
        if at[0] + columns > side {
            (at, height) = ([0, at[1] + height], 0);
        }
        if at[1] + rows > side {
            (layer, at, height) = (layer + 1, [0, 0], 0);
        }
        assert!(layer < model.shape().layers, "the atlas is too small for the test");
        let place = AtlasPlace { layer: layer as u16, x: at[0] as u16, y: at[1] as u16 };
        (at[0], height) = (at[0] + columns, height.max(rows));
        let formats = model.formats().iter().enumerate();
        let channels = formats.map(|(channel, &format)| texels(asset, channel, page, format)).collect();
        let texels = ParcelTexels { extent: [columns, rows], outline: Outline::WHOLE, channels };
        changes.uploads.push(ParcelUpload { parcel: page.into(), place, texels });
        changes.entries.push(TableChange { index: table.index(cover, page), entry: TableEntry::at(place) });
    }
    changes.entries.sort_by_key(|change| change.index);
    let later = FrameChanges {
        uploads: changes.uploads.split_off(changes.uploads.len() / 2),
        entries: std::mem::take(&mut changes.entries),
    };
    model.update(gpu, &changes);
    model.update(gpu, &later);
}

/// Columns and rows of all pictures.
pub(crate) const SIZE: [u32; 2] = [480, 320];

/// The GPU's picture.
pub(crate) fn rendered(
    gpu: &Gpu,
    baked: &Baked,
    residents: &Residents,
    camera: &Camera,
    lights: &Lights,
    options: &DrawOptions,
) -> Picture {
    let asset = baked.asset();
    let table = PageTable::new(asset.cover());
    let formats = FanModel::atlas_formats(gpu, baked.channels());
    let mut model = model(gpu, baked, &table, &formats);
    upload(gpu, &mut model, asset, &table, residents);
    draw(gpu, &mut model, camera, lights, options)
}

/// A model without any page.
pub(crate) fn model(gpu: &Gpu, baked: &Baked, pages: &PageTable, formats: &[AtlasFormat]) -> FanModel {
    let asset = baked.asset();
    let shape = FanModel::atlas_shape(gpu, 128 << 20, formats);
    let channels = baked.channels();
    let source = FanModelSource { mesh: asset.mesh(), cover: asset.cover(), channels, formats, pages, shape };
    FanModel::new(gpu, &source, |channel, group| asset.mean(channel, group)).unwrap()
}

/// The GPU's picture of a model.
pub(crate) fn draw(
    gpu: &Gpu,
    model: &mut FanModel,
    camera: &Camera,
    lights: &Lights,
    options: &DrawOptions,
) -> Picture {
    render_to_picture(gpu, &mut Frame { size: SIZE, camera, lights, model, options }).unwrap()
}

/// The CPU's picture of a surface.
pub(crate) fn cpu(
    mesh: &Mesh,
    surface: &dyn Surface,
    camera: &Camera,
    lights: &Lights,
    options: &DrawOptions,
) -> Picture {
    let options = RenderOptions {
        width: SIZE[0],
        height: SIZE[1],
        samples: 1,
        shading: options.shading,
        background: options.background,
        shading_rate: ShadingRate::PerPixel,
        ..RenderOptions::default()
    };
    render(mesh, surface, camera, lights, &options).unwrap().picture
}

/// The same picture by both renderers.
pub(crate) fn compare(
    name: &str,
    gpu: &Gpu,
    baked: &Baked,
    camera: &Camera,
    lights: &Lights,
    options: &DrawOptions,
) -> Comparison {
    let seen = rendered(gpu, baked, &Residents::all(), camera, lights, options);
    let surface = baked.surface(&baked.cache, options);
    let expected = cpu(baked.asset().mesh(), &surface, camera, lights, options);
    Comparison::of(name, &seen, &expected)
}

/// Tiles in which a coarser level stands in for some, and the mean beyond the last.
struct StandIns<'a, F> {
    cache: &'a PageCache,
    /// The level that is shown for one that is asked for.
    shown: F,
}

enum TileOrMean {
    Tile(Tile),
    Mean([f32; 4]),
}

impl<F: Fn(u32) -> u32 + Sync> TileSource for StandIns<'_, F> {
    type Tile = TileOrMean;

    fn tile(&self, channel: usize, id: TileId) -> TileOrMean {
        let asset = self.cache.asset();
        let level = (self.shown)(id.level);
        if level < asset.cover().groups[id.group as usize].level_count() {
            TileOrMean::Tile(self.cache.tile(channel, TileId { level, ..id }))
        } else {
            TileOrMean::Mean(asset.mean(channel, id.group))
        }
    }

    fn mean(&self, channel: usize, group: u32) -> [f32; 4] {
        self.cache.asset().mean(channel, group)
    }
}

impl TileTexels for TileOrMean {
    fn extent(&self) -> [u32; 2] {
        match self {
            Self::Tile(tile) => Tile::extent(tile),
            Self::Mean(_) => [1, 1],
        }
    }

    fn bilinear(&self, uv: Vec2) -> [f32; 4] {
        match self {
            Self::Tile(tile) => Tile::bilinear(tile, uv),
            Self::Mean(mean) => *mean,
        }
    }

    fn texel(&self, x: u32, y: u32) -> [f32; 4] {
        match self {
            Self::Tile(tile) => Tile::texel(tile, x, y),
            Self::Mean(mean) => *mean,
        }
    }
}

/// The CPU's picture with a coarser level `shown` for each that is asked for.
pub(crate) fn cpu_with_stand_ins(
    baked: &Baked,
    shown: impl Fn(u32) -> u32 + Sync,
    camera: &Camera,
    options: &DrawOptions,
) -> Picture {
    let surface = baked.surface(StandIns { cache: &baked.cache, shown }, options);
    cpu(baked.asset().mesh(), &surface, camera, &Lights::default(), options)
}

/// How two pictures differ.
#[derive(Debug)]
pub(crate) struct Comparison {
    pub(crate) name: String,
    /// Of all channels where both pictures show the surface and so do all neighbours.
    pub(crate) mean: f32,
    /// 999 of 1000 differ by less.
    pub(crate) quantile: f32,
}

impl Comparison {
    pub(crate) fn of(name: &str, seen: &Picture, expected: &Picture) -> Self {
        save(&format!("{name} gpu"), seen);
        save(&format!("{name} cpu"), expected);
        let shows = |p: &Picture, x: u32, y: u32| p.pixel(x, y)[3] == 1.0;
        let mut differences = Vec::new();
        let (mut only_one, mut both) = (0, 0);
        for y in 1..SIZE[1] - 1 {
            for x in 1..SIZE[0] - 1 {
                let (a, b) = (seen.pixel(x, y), expected.pixel(x, y));
                only_one += u32::from(shows(seen, x, y) != shows(expected, x, y));
                let around = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (x, y)));
                if around.into_iter().all(|(x, y)| shows(seen, x, y) && shows(expected, x, y)) {
                    both += 1;
                    differences.extend([0, 1, 2].map(|c| (a[c] - b[c]).abs()));
                }
            }
        }
        assert!(both > 5000, "{name}: the pictures show {both} common pixels");
        assert!(only_one * 100 < both, "{name}: {only_one} pixels are covered in one picture only");
        assert!(differences.iter().all(|d| d.is_finite()), "{name}: not a number");
        differences.sort_by(f32::total_cmp);
        let mean = differences.iter().sum::<f32>() / differences.len() as f32;
        let quantile = differences[differences.len() - 1 - differences.len() / 1000];
        let largest = differences[differences.len() - 1];
        eprintln!("{name}: mean difference {mean:.5}, 999 of 1000 below {quantile:.4}, largest {largest:.3}");
        Self { name: name.to_owned(), mean, quantile }
    }
}

/// The largest difference of neighbouring pixels that show the surface.
pub(crate) fn largest_step(picture: &Picture) -> f32 {
    let mut largest = 0f32;
    for y in 0..SIZE[1] - 1 {
        for x in 0..SIZE[0] - 1 {
            let here = picture.pixel(x, y);
            for there in [picture.pixel(x + 1, y), picture.pixel(x, y + 1)] {
                if here[3] == 1.0 && there[3] == 1.0 {
                    largest = [0, 1, 2].iter().map(|&c| (here[c] - there[c]).abs()).fold(largest, f32::max);
                }
            }
        }
    }
    largest
}

/// Keeps a picture where FANTEX_PICTURES names a folder.
pub(crate) fn save(name: &str, picture: &Picture) {
    if let Some(folder) = std::env::var_os("FANTEX_PICTURES") {
        let path = PathBuf::from(folder).join(format!("{}.png", name.replace(' ', "-")));
        picture.to_srgb_image().save(&path).unwrap();
    }
}

/// The live atlas of a channel, 256x256.
pub(crate) fn live_atlas(gpu: &Gpu, model: &FanModel, channel: usize) -> Picture {
    const SIDE: u32 = 256;
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let target = target(gpu, [SIDE; 2], format);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let view = target.create_view(&Default::default());
    assert!(AtlasViewer::new(gpu, format).draw(gpu, &mut encoder, &view, model, channel));
    let bytes = read_back(gpu, encoder, &target);
    let unit = |&[r, g, b, a]: &[u8; 4]| [r, g, b, a].map(|v| f32::from(v) / 255.0);
    Picture { width: SIDE, height: SIDE, rgba: bytes.as_chunks::<4>().0.iter().map(unit).collect() }
}

/// A texture to draw into.
pub(crate) fn target(gpu: &Gpu, [width, height]: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// Submits commands and waits for what they draw into a texture.
pub(crate) fn read_back(gpu: &Gpu, mut encoder: wgpu::CommandEncoder, texture: &wgpu::Texture) -> Vec<u8> {
    let readback = Readback::new(gpu, texture).unwrap();
    readback.record(&mut encoder, texture);
    gpu.queue.submit([encoder.finish()]);
    readback.begin();
    gpu.wait().unwrap();
    let mut bytes = Vec::new();
    readback.rows(|row| bytes.extend_from_slice(row)).unwrap();
    bytes
}
