//! Frames of a fan-textured model beside the same model with an ordinary texture, in one run.
//!
//! ```text
//! cargo run --release -p fantex-bench --example fan_speed -- [MODEL | TRIANGLES] [TEXELS] [TILE] [WIDTHxHEIGHT]
//! ```
//!
//! MODEL is a model file; a number of triangles means a generated landscape. Tiles are BC7, or RGBA8 where the device samples no
//! blocks. Frames are 1280x720 unless told, one sample per pixel; both models take turns. Printed are the best frame by the wall
//! clock, the middle one by the device's own clock, and, on Linux, the ratio of the processor times of all. The ordinary texture
//! is 2048x2048 RGBA8 with hardware mip levels, laid onto the model from above.

use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_bake::{BakeFormat, BakeOptions, NoProgress, Prefilter, Source, SourceChannel, TexelPoint, bake};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_gpu::{
    DrawOptions, Frame, FrameTimes, Gpu, GpuOptions, HiddenScreen, Model, StreamedModel, UvModel, stream_view,
};
use fantex_mesh::{ImageSource, Mesh, TextureRef, WrapMode, clean, generate, load};
use fantex_scene::{Camera, FilterOptions, Lights, Shading};
use fantex_store::{Asset, ChannelKind};
use fantex_texture::{ColorSpace, Filter, Image, Samples};
use glam::{Mat3, Vec2, Vec4};

type Failure = Box<dyn std::error::Error>;

/// Frames that count, of software and of a graphics card.
const ROUNDS: [usize; 2] = [12, 200];
/// Frames before these: pipelines are compiled, and clocks of graphics cards rise.
const WARM_UP: [usize; 2] = [1, 200];

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let model = arguments.next().unwrap_or_else(|| "100000".into());
    let texels = arguments.next().map_or(Ok(4 << 20), |text| text.parse())?;
    let tile = arguments.next().map_or(Ok(CoverOptions::default().tile), |text| text.parse())?;
    let size = arguments.next().map_or(Ok([1280, 720]), |text| size(&text))?;
    let mesh = mesh(&model)?;
    let options = CoverOptions { tile, budget: TexelBudget::Total(texels), ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options)?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("speed.fan");
    let gpu = Gpu::headless(&GpuOptions::default())?;
    println!("{:?}, {}x{}", gpu.info(), size[0], size[1]);
    let format = if gpu.has_block_compression() { BakeFormat::Bc7 } else { BakeFormat::Rgba8 };
    let bake_options = BakeOptions { format, ..BakeOptions::default() };
    bake(&mesh, &cover, &Waves, &path, &bake_options, &NoProgress)?;
    let asset = Arc::new(Asset::open(&path)?);

    println!("{} triangles, {} groups, {texels} texels", mesh.triangles.len(), cover.groups.len());
    let started = Instant::now();
    let mut fan = StreamedModel::open(&gpu, asset, 64 << 20)?;
    println!("model made in {:?}", started.elapsed());
    let mut uv = UvModel::load(&gpu, &with_texture(mesh)?)?;
    let aspect = f64::from(size[0]) / f64::from(size[1]);
    let camera = Camera::framing_mesh(fan.streamer.geometry().mesh(), Camera::THREE_QUARTER, aspect);
    let [rounds, warm_up] = [ROUNDS, WARM_UP].map(|counts| counts[usize::from(!gpu.info().is_software)]);
    let view = stream_view(&camera, size, fan.model.space());
    for (shading, filter) in [
        (Shading::BaseColor, Filter::Trilinear),
        (Shading::BaseColor, Filter::Anisotropic),
        (Shading::MetallicRoughness, Filter::Trilinear),
        (Shading::MetallicRoughness, Filter::Anisotropic),
    ] {
        let filter = FilterOptions { filter, max_anisotropy: 8.0 };
        let is_sharp = fan.wait_until_sharp(&gpu, &view, &filter, Duration::from_secs(60))?;
        let options = DrawOptions { shading, filter, samples: 1, ..DrawOptions::default() };
        let mut screen = HiddenScreen::new(&gpu, size);
        let lights = Lights::behind(&camera);
        let mut times = [Times::none(), Times::none()];
        for round in 0..warm_up + rounds {
            let models: [&mut dyn Model; 2] = [&mut uv, &mut fan.model];
            for (times, model) in times.iter_mut().zip(models) {
                let mut frame = Frame { size, camera: &camera, lights: &lights, model, options: &options };
                times.of(round >= warm_up, || screen.draw(&gpu, &mut frame))?;
            }
        }
        let [uv, fan] = times;
        println!(
            "{shading:?} {:?}: uv {:.3} ms, fans {:.3} ms, ratio {:.2}; by the device's clock {:.3} and {:.3} ms, {:.2}; processor time {:.2}{}",
            filter.filter,
            uv.best_ms(),
            fan.best_ms(),
            fan.best_ms() / uv.best_ms(),
            uv.device_ms(),
            fan.device_ms(),
            fan.device_ms() / uv.device_ms(),
            fan.processor_seconds / uv.processor_seconds,
            if is_sharp { "" } else { ", not all pages resident" },
        );
    }
    Ok(())
}

fn mesh(model: &str) -> Result<Mesh, Failure> {
    let model = match model.parse() {
        Ok(triangles) => {
            let options = generate::LandscapeOptions { triangles, ..Default::default() };
            let land = generate::landscape(&options)?;
            fantex_mesh::Model {
                positions: land.positions.iter().map(|p| p.as_dvec3()).collect(),
                triangles: land.triangles,
                materials: vec![Default::default()],
                ..Default::default()
            }
        }
        Err(_) => load(model.as_ref(), &Default::default())?,
    };
    Ok(clean(model, &Default::default())?.0)
}

fn size(text: &str) -> Result<[u32; 2], Failure> {
    let (width, height) = text.split_once('x').ok_or("expected WIDTHxHEIGHT")?;
    Ok([width.parse()?, height.parse()?])
}

/// Stripes in all directions.
struct Waves;

impl Source for Waves {
    fn channels(&self) -> Vec<SourceChannel> {
        vec![SourceChannel { kind: ChannelKind::BaseColor, has_alpha: false, exceeds_one: false }]
    }

    fn prefilter(&self) -> Prefilter {
        Prefilter::Point
    }

    fn evaluate(&self, point: &TexelPoint, values: &mut [Vec4]) {
        let wave = (point.position * 90.0).map(f32::sin) * 0.4 + 0.5;
        values[0] = wave.extend(1.0);
    }
}

/// The mesh with coordinates from above and a texture of stripes.
fn with_texture(mut mesh: Mesh) -> Result<Mesh, Failure> {
    let of_vertex = |&v: &u32| {
        let p = mesh.positions[v as usize];
        Vec2::new(p.x + 0.3 * p.y, p.z - 0.3 * p.y) * 0.5 + 0.5
    };
    mesh.corners.uv_sets = vec![mesh.triangles.iter().flatten().map(of_vertex).collect()];
    let side = 2048;
    let texel = |i: u32| {
        let (x, y) = (i % side, i / side);
        [x * 7, y * 5, (x + y) * 3].map(|v| (v % 256) as u8)
    };
    let samples = Samples::U8((0..side * side).flat_map(texel).collect());
    let image = Image { width: side, height: side, channels: 3, space: ColorSpace::Srgb, samples };
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("texture.png");
    image.save(&path)?;
    let bytes = std::fs::read(&path)?.into();
    mesh.images = vec![ImageSource::Embedded { label: "stripes".into(), bytes }];
    for material in &mut mesh.materials {
        material.base_color_texture = Some(TextureRef {
            image: 0,
            uv_set: 0,
            uv_transform: Mat3::IDENTITY,
            wrap: [WrapMode::Repeat; 2],
            nearest: false,
        });
    }
    Ok(mesh)
}

#[derive(Debug)]
struct Times {
    best: Option<Duration>,
    processor_seconds: f64,
    /// By the device's clock.
    device: FrameTimes,
}

impl Times {
    fn none() -> Self {
        Self { best: None, processor_seconds: 0.0, device: FrameTimes { all: Vec::new() } }
    }

    /// Draws a frame, and times it if it counts.
    fn of(
        &mut self,
        counts: bool,
        draw: impl FnOnce() -> fantex_base::Result<Option<Duration>>,
    ) -> fantex_base::Result<()> {
        let (started, processor) = (Instant::now(), processor_seconds());
        let device = draw()?;
        if counts {
            let elapsed = started.elapsed();
            self.best = Some(self.best.map_or(elapsed, |best| best.min(elapsed)));
            self.processor_seconds += processor_seconds() - processor;
            self.device.all.extend(device);
        }
        Ok(())
    }

    /// The middle frame; zero where the device has no clock.
    fn device_ms(&self) -> f64 {
        self.device.median().as_secs_f64() * 1e3
    }

    fn best_ms(&self) -> f64 {
        self.best.unwrap_or_default().as_secs_f64() * 1e3
    }
}

/// Of all threads since the program's start, in steps of a hundredth; 0 where the system does not tell.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks: f64 = fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum();
    ticks / 100.0
}
