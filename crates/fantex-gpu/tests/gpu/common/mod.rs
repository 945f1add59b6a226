//! A scene for both renderers, and how alike their pictures are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use fantex_gpu::{DrawOptions, Frame, Gpu, GpuError, GpuOptions, Model, UvModel, render_to_picture};
use fantex_mesh::{ImageSource, Mesh};
use fantex_render::{MeshSurface, RenderOptions, render};
use fantex_scene::{Background, Camera, FilterOptions, Lights, Picture, Shading};
pub(crate) use fantex_test::{data, opened as loaded_from};
use fantex_texture::{Filter, Image};

/// The GPU, or nothing and a line that says so.
pub(crate) fn gpu() -> Option<Gpu> {
    match Gpu::headless(&GpuOptions::default()) {
        Ok(gpu) => Some(gpu),
        Err(error @ GpuError::NoAdapter { .. }) => {
            eprintln!("SKIPPED: {error}");
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
        let surface = MeshSurface::load(&self.mesh, self.filter).unwrap();
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
        save(name, a.width, a.height, &bytes_a, &bytes_b);
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

fn save(name: &str, width: u32, height: u32, a: &[[u8; 4]], b: &[[u8; 4]]) {
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
