//! Meshes, baked assets, pictures.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_bake::{
    BakeFormat, BakeOptions, LookSource, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake,
};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::Mesh;
use fantex_render::{Camera, FanSurface, FilterOptions, Lights, LookSurface, RenderOptions, Surface, render};
use fantex_store::{Asset, ChannelKind, PageCache};
pub(crate) use fantex_test::{bottle, cleaned, data_folder, opened};
use fantex_texture::Image;
use fantex_texture::compare::psnr_db;
use glam::Vec4;
use tempfile::TempDir;

/// A smooth function of the position, in some channels.
pub(crate) struct Waves {
    pub(crate) kinds: Vec<ChannelKind>,
    /// Radians per mesh unit.
    pub(crate) frequency: f32,
    pub(crate) has_alpha: bool,
    /// Emitted light is as bright as this.
    pub(crate) brightness: f32,
}

impl Waves {
    pub(crate) fn color(frequency: f32) -> Self {
        Self { kinds: vec![ChannelKind::BaseColor], frequency, has_alpha: false, brightness: 1.0 }
    }
}

impl Source for Waves {
    fn channels(&self) -> Vec<SourceChannel> {
        let channel = |&kind: &ChannelKind| SourceChannel {
            kind,
            has_alpha: self.has_alpha && kind == ChannelKind::BaseColor,
            exceeds_one: kind == ChannelKind::Emission && self.brightness > 1.0,
        };
        self.kinds.iter().map(channel).collect()
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let p = point.position * self.frequency;
        let wave = |x: f32| 0.5 + 0.4 * x.sin();
        for (kind, value) in self.kinds.iter().zip(values) {
            *value = match kind {
                ChannelKind::Normal => (point.normal
                    + 0.3 * glam::Vec3::new(p.y.sin(), p.z.sin(), p.x.sin()))
                .normalize()
                .extend(0.0),
                ChannelKind::BaseColor => {
                    let alpha = if self.has_alpha { wave(p.x + p.y) } else { 1.0 };
                    Vec4::new(wave(p.x), wave(p.y + 1.0), wave(p.z + 2.0), alpha)
                }
                ChannelKind::Emission => (Vec4::new(wave(p.z), wave(p.x), 0.0, 1.0)) * self.brightness,
                _ => Vec4::new(wave(p.y), wave(p.z), wave(p.x), 1.0),
            };
        }
    }
}

/// A baked asset in a folder of its own.
pub(crate) struct Baked {
    pub(crate) folder: TempDir,
    pub(crate) asset: Arc<Asset>,
}

impl Baked {
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

pub(crate) fn baked(mesh: &Mesh, source: &dyn Source, texels: u64, format: BakeFormat) -> Baked {
    let options = CoverOptions { budget: TexelBudget::Total(texels), ..CoverOptions::default() };
    covered_and_baked(mesh, source, &options, format)
}

pub(crate) fn covered_and_baked(
    mesh: &Mesh,
    source: &dyn Source,
    options: &CoverOptions,
    format: BakeFormat,
) -> Baked {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("asset.fan");
    let (cover, _) = build_cover(mesh, options).unwrap();
    bake(mesh, &cover, source, &path, &BakeOptions { format, ..BakeOptions::default() }, &NoProgress)
        .unwrap();
    let asset = Arc::new(Asset::open(&path).unwrap());
    Baked { folder, asset }
}

pub(crate) fn baked_bottle(texels: u64) -> Baked {
    let mesh = bottle();
    baked(&mesh, &LookSource::of_model(&mesh).unwrap(), texels, BakeFormat::Rgba8)
}

fn picture(mesh: &Mesh, surface: &dyn Surface, camera: &Camera) -> Image {
    let options = RenderOptions { width: 320, height: 240, samples: 4, ..RenderOptions::default() };
    render(mesh, surface, camera, &Lights::behind(camera), &options).unwrap().picture.to_linear_image()
}

/// The worst likeness of an exported model to its asset over five cameras, in dB.
pub(crate) fn worst_psnr_db(asset: &Arc<Asset>, model: &Path) -> f64 {
    let model = opened(model);
    let filter = FilterOptions::default();
    let model_surface = LookSurface::of_model(&model, filter).unwrap();
    let cache = PageCache::new(Arc::clone(asset), 256 << 20);
    let asset_surface = FanSurface::of_asset(&cache, filter);
    Camera::orbit(asset.mesh(), 5, 4.0 / 3.0)
        .iter()
        .map(|camera| {
            let reference = picture(asset.mesh(), &asset_surface, camera);
            psnr_db(&reference, &picture(&model, &model_surface, camera)).unwrap()
        })
        .fold(f64::INFINITY, f64::min)
}

/// Names of the files in a folder, hidden ones too.
pub(crate) fn files(folder: &Path) -> Vec<String> {
    let names =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}
