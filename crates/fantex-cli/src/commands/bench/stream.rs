//! How well an asset streams: a camera flies a path, pages come from where the asset is.

use std::iter::Peekable;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use fantex::base::json_problem;
use fantex::gpu::{DrawOptions, FanModel, Frame, Gpu, GpuOptions, HiddenScreen};
use fantex::scene::{Camera, Lights, world_bounds};
use fantex::store::Asset;
use fantex::stream::{
    AtlasFormat, AtlasShape, CameraKeyframe, CameraPath, ClusterLoader, ClusterLoaderOptions, CutWatch,
    DiskLoad, FrameChanges, FrameOptions, LoaderStatistics, MAX_PATH_SECONDS, PageTable, Streamer,
    StreamerOptions, loaded_clusters, mean_cluster_bytes, open_asset, plain_reads, queued_reads,
    unpacked_clusters, url_of,
};
use fantex::{Error, Result};
use glam::DVec3;

use super::Row;
use crate::context::{Context, peak_memory_bytes};
use crate::scene::size;
use crate::text::{bytes, megabytes, positive};

/// Fly through an asset: frame times, time until views are sharp, bytes read against bytes needed, the disk beside it.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bench stream world.fan
  fantex bench stream world.fan --pool 16M --path flight.json
  fantex bench stream world.fan --gpu --size 1920x1080

A path is a JSON file as 'fantex view' records it: {\"keys\": [{\"seconds\": 0, \
\"eye\": [0, 2, 5], \"target\": [0, 1, 0], \
\"up\": [0, 1, 0], \"fov_degrees\": 50}, ...]}. Without one the camera circles the model, flies through it \
and jumps around.")]
pub(super) struct StreamArgs {
    /// An asset (.fan) or its URL
    asset: PathBuf,
    /// A recorded camera path (.json)
    #[arg(long, value_name = "PATH")]
    path: Option<PathBuf>,
    /// Graphics memory for texels
    #[arg(long, value_name = "SIZE", allow_negative_numbers = true, default_value = "64M", value_parser = bytes)]
    pool: u64,
    /// Width and height of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: [u32; 2],
    /// Frames per second
    #[arg(long, value_name = "RATE", default_value_t = 60.0, value_parser = positive)]
    rate: f64,
    /// Draw every frame on the graphics card, as fast as it can
    #[arg(long)]
    gpu: bool,
}

/// Seconds of each part of the path that is flown where none is given.
const PART_SECONDS: f64 = 3.0;

/// Seconds that the camera stands still at the end.
const REST_SECONDS: f64 = 1.0;

/// The camera goes no farther than this in one frame, seconds of its path: where frames take longer, the flight does.
const MAX_STEP_SECONDS: f64 = 0.1;

/// A slow frame may upload as much as so many quick ones.
const MAX_QUICK_FRAMES: f64 = 16.0;

pub(super) fn stream(args: &StreamArgs, context: &Context) -> Result<Vec<Row>> {
    let started = Instant::now();
    let asset = Arc::new(open_asset(&args.asset)?);
    let opened = started.elapsed();
    let path = match &args.path {
        Some(path) => read_path(path)?,
        None => tour(&asset),
    };
    let mut rows = vec![Row::new("asset opened", 1e3 * opened.as_secs_f64(), "ms")];
    rows.extend(fly(&asset, &path, args, context, started)?);
    rows.extend(disk_rows(&asset, context)?);
    rows.extend(peak_memory_bytes().map(|bytes| Row::new("peak of main memory", bytes as f64 / 1e6, "MB")));
    Ok(rows)
}

/// Formats of the texels in an atlas.
fn formats(asset: &Asset, block_compressed: bool) -> Vec<AtlasFormat> {
    asset.channels().iter().map(|channel| AtlasFormat::of(channel.format, block_compressed)).collect()
}

fn read_path(path: &Path) -> Result<CameraPath> {
    let text = fantex::base::input::read_text(path)?;
    let parsed: CameraPath = serde_json::from_str(&text).map_err(|error| {
        let problem = json_problem(text.as_bytes(), &error);
        problem.context(format_args!("{} is no camera path", path.display())).with_path(path)
    })?;
    if parsed.keyframes.is_empty() {
        let path = path.display();
        return Err(Error::malformed(format!("{path} holds no keyframes; record at least one")));
    }
    let mut earliest = 0.0;
    for keyframe in &parsed.keyframes {
        if !(earliest..=MAX_PATH_SECONDS).contains(&keyframe.seconds) {
            let (path, seconds) = (path.display(), keyframe.seconds);
            let sentence = format!(
                "{path} has a keyframe at {seconds} s; times must ascend from 0 and end within a day"
            );
            return Err(Error::malformed(sentence));
        }
        earliest = keyframe.seconds;
    }
    Ok(parsed)
}

/// Around the model, close over it, and jumps between far and near.
fn tour(asset: &Asset) -> CameraPath {
    let bounds = world_bounds(asset.mesh());
    let center = bounds.center();
    let radius = 0.5 * (bounds.max - bounds.min).length();
    let along = DVec3::new(0.7, 0.0, 0.7) * radius;
    let above = DVec3::Y * (bounds.max.y - center.y + 0.05 * radius);
    let parts = [
        CameraPath::orbit(center, 1.2 * radius, 0.6 * radius, PART_SECONDS),
        CameraPath::fly(center - along + above, center + along + above, PART_SECONDS),
        CameraPath::cuts(center, &[2.0, 0.8, 1.2, 0.6, 1.0].map(|d| d * radius), 0.4 * PART_SECONDS),
    ];
    let mut tour = CameraPath::default();
    for part in parts {
        let begin = tour.duration_seconds();
        let shifted = part.keyframes.into_iter().enumerate().map(|(i, keyframe)| CameraKeyframe {
            seconds: begin + keyframe.seconds,
            is_cut: keyframe.is_cut || i == 0,
            ..keyframe
        });
        tour.keyframes.extend(shifted);
    }
    tour
}

/// What a flight in real time came to.
#[derive(Debug, Default)]
struct Flight {
    update_times: Vec<Duration>,
    frame_times: Vec<Duration>,
    /// By the clock of the graphics card, where it has one.
    device_times: Vec<Duration>,
    /// From the program's start to the end of the first frame.
    first_frame: Option<Duration>,
    seconds_to_sharp: Vec<f64>,
    never_sharp: u64,
    /// From a cut to the first frame that lacks nothing, whatever the camera has come to need since.
    seconds_to_complete: Vec<f64>,
    complete_share: f64,
    peak_occupancy: f64,
    peak_bias: f32,
    hit_rate: f64,
    frames: u64,
}

/// Flies in real time, as long as frames are not too slow for that ([`MAX_STEP_SECONDS`]). Unless pictures are drawn, what is measured is deciding, reading, unpacking and handing over.
fn fly(
    asset: &Arc<Asset>,
    path: &CameraPath,
    args: &StreamArgs,
    context: &Context,
    program_started: Instant,
) -> Result<Vec<Row>> {
    let gpu = if args.gpu { Some(Gpu::headless(&GpuOptions::default())?) } else { None };
    let block_compressed = gpu.as_ref().is_none_or(Gpu::has_block_compression);
    let formats = formats(asset, block_compressed);
    let atlas = match &gpu {
        Some(gpu) => FanModel::atlas_shape(gpu, args.pool, &formats),
        None => AtlasShape::within(args.pool, &formats),
    };
    let loader = ClusterLoader::open(
        Arc::clone(asset),
        &ClusterLoaderOptions { block_compressed, ..ClusterLoaderOptions::default() },
    )?;
    let monitor = loader.monitor();
    context.note(format!("{}: {}", args.asset.display(), loader.reader_info()));
    let options = StreamerOptions { atlas, ..StreamerOptions::default() };
    let mut streamer = Streamer::new(Arc::clone(asset) as _, Box::new(loader), options);
    let mut screen = match gpu {
        Some(gpu) => Some(Screen::new(gpu, asset, streamer.table(), args)?),
        None => None,
    };
    let mut flight = Flight::default();
    let mut cuts = Cuts::of(path);
    let end = path.duration_seconds() + REST_SECONDS;
    let began = Instant::now();
    let mut last = began;
    let mut path_seconds = 0.0;
    while path_seconds <= end {
        let started = Instant::now();
        let elapsed = (started - last).as_secs_f64().max(1e-6);
        last = started;
        let step = elapsed.min(MAX_STEP_SECONDS);
        path_seconds += step;
        cuts.pass(path_seconds, (started - began).as_secs_f64(), &mut flight);
        let Some(camera) = path.at(path_seconds) else { break };
        let view = camera.view(&asset.mesh().world_from_mesh, args.size);
        let budget = FrameOptions::default();
        let quick_frames = (elapsed * args.rate).clamp(1.0, MAX_QUICK_FRAMES);
        let frame = FrameOptions {
            upload_bytes: (budget.upload_bytes as f64 * quick_frames) as usize,
            elapsed_seconds: step as f32,
        };
        let changes = streamer.update(view.as_ref(), frame);
        flight.update_times.push(started.elapsed());
        flight.count(&streamer);
        cuts.update(&streamer, began.elapsed().as_secs_f64(), &mut flight);
        match &mut screen {
            Some(screen) => {
                flight.device_times.extend(screen.draw(&camera, &changes)?);
                flight.first_frame.get_or_insert_with(|| program_started.elapsed());
                flight.frame_times.push(started.elapsed());
            }
            None => {
                flight.first_frame.get_or_insert_with(|| program_started.elapsed());
                let rest = Duration::from_secs_f64(1.0 / args.rate).saturating_sub(started.elapsed());
                std::thread::sleep(rest);
            }
        }
    }
    flight.never_sharp += u64::from(cuts.watch.is_some());
    Ok(flight.rows(&monitor.statistics()))
}

/// The cuts of a path, and what the view lacks since the last one.
struct Cuts {
    /// Those that are to come, seconds of the path.
    coming: Peekable<std::vec::IntoIter<f64>>,
    /// When the last one was, seconds of the flight, until the view is sharp.
    watch: Option<(f64, CutWatch)>,
    /// The same until a frame lacks nothing.
    incomplete_since: Option<f64>,
}

impl Cuts {
    fn of(path: &CameraPath) -> Self {
        Self { coming: path.cuts_seconds().into_iter().peekable(), watch: None, incomplete_since: None }
    }

    /// Notes the cuts up to `path_seconds`; the flight has lasted `seconds`.
    fn pass(&mut self, path_seconds: f64, seconds: f64, flight: &mut Flight) {
        while self.coming.next_if(|&cut| cut <= path_seconds).is_some() {
            flight.never_sharp += u64::from(self.watch.replace((seconds, CutWatch::new())).is_some());
            self.incomplete_since = Some(seconds);
        }
    }

    /// Notes, once a frame is decided, how long the view has taken to be sharp and complete.
    fn update(&mut self, streamer: &Streamer, seconds: f64, flight: &mut Flight) {
        if self.watch.as_mut().is_some_and(|(_, watch)| watch.update(streamer))
            && let Some((since, _)) = self.watch.take()
        {
            flight.seconds_to_sharp.push(seconds - since);
        }
        let figures = streamer.statistics();
        if figures.complete_groups == figures.visible_groups
            && let Some(since) = self.incomplete_since.take()
        {
            flight.seconds_to_complete.push(seconds - since);
        }
    }
}

/// An off-screen target.
struct Screen {
    gpu: Gpu,
    hidden: HiddenScreen,
    model: FanModel,
    size: [u32; 2],
    lights: Lights,
}

impl Screen {
    fn new(gpu: Gpu, asset: &Asset, pages: &PageTable, args: &StreamArgs) -> Result<Self> {
        let size = args.size;
        let model = FanModel::of_asset(&gpu, asset, asset, pages, args.pool)?;
        Ok(Self { hidden: HiddenScreen::new(&gpu, size), gpu, model, size, lights: Lights::default() })
    }

    fn draw(&mut self, camera: &CameraKeyframe, changes: &FrameChanges) -> Result<Option<Duration>> {
        self.model.update(&self.gpu, changes);
        let camera = Camera {
            eye: camera.eye.into(),
            target: camera.target.into(),
            up: camera.up.into(),
            fov_degrees: camera.fov_degrees,
        };
        let options = DrawOptions { samples: 1, ..DrawOptions::default() };
        let model = &mut self.model;
        let mut frame =
            Frame { size: self.size, camera: &camera, lights: &self.lights, model, options: &options };
        self.hidden.draw(&self.gpu, &mut frame)
    }
}

impl Flight {
    fn count(&mut self, streamer: &Streamer) {
        let figures = streamer.statistics();
        self.frames += 1;
        self.hit_rate += 1.0 - figures.missing as f64 / figures.needed.parcels.max(1) as f64;
        self.complete_share += figures.complete_share();
        self.peak_occupancy = self.peak_occupancy.max(figures.occupancy());
        self.peak_bias = self.peak_bias.max(figures.bias_levels);
    }

    fn rows(mut self, loader: &LoaderStatistics) -> Vec<Row> {
        let mut rows = Vec::new();
        let first_frame = self.first_frame.unwrap_or_default();
        rows.push(Row::new("from the start to the first frame", 1e3 * first_frame.as_secs_f64(), "ms"));
        rows.push(Row::new("frames", self.frames as f64, ""));
        percentiles(&mut rows, "frame", &mut self.frame_times);
        percentiles(&mut rows, "drawing, by the card's clock", &mut self.device_times);
        percentiles(&mut rows, "deciding, per frame", &mut self.update_times);
        rows.push(Row::new(
            "parcels resident when needed",
            100.0 * self.hit_rate / self.frames.max(1) as f64,
            "%",
        ));
        let complete = 100.0 * self.complete_share / self.frames.max(1) as f64;
        rows.push(Row::new("visible tiles at their level", complete, "%"));
        sharpness(&mut rows, &self.seconds_to_sharp, self.never_sharp);
        let complete = self.seconds_to_complete.iter().copied().fold(0.0, f64::max);
        rows.push(Row::new("from a cut to a frame that lacks nothing, longest", 1e3 * complete, "ms"));
        rows.push(Row::new("pool in use, at most", 100.0 * self.peak_occupancy, "%"));
        rows.push(Row::new("level bias, at most", f64::from(self.peak_bias), "levels"));
        let megabytes = |bytes: u64| bytes as f64 / 1e6;
        let needed = megabytes(loader.bytes_needed);
        rows.push(
            Row::new("read, beside what was needed", megabytes(loader.bytes_read), "MB").beside(needed),
        );
        rows.push(Row::new("reads", loader.reads as f64, ""));
        rows.push(Row::new("parcels that failed", loader.parcels_failed as f64, ""));
        rows
    }
}

fn percentiles(rows: &mut Vec<Row>, name: &str, times: &mut [Duration]) {
    times.sort_unstable();
    let Some(last) = times.len().checked_sub(1) else { return };
    for (label, index) in [("median", last / 2), ("p99", last * 99 / 100), ("longest", last)] {
        rows.push(Row::new(format!("{name}, {label}"), 1e3 * times[index].as_secs_f64(), "ms"));
    }
}

fn sharpness(rows: &mut Vec<Row>, seconds: &[f64], never: u64) {
    let mut sorted = seconds.to_vec();
    sorted.sort_by(f64::total_cmp);
    if let (Some(median), Some(longest)) = (sorted.get(sorted.len() / 2), sorted.last()) {
        rows.push(Row::new("from a cut to sharp, median", 1e3 * median, "ms"));
        rows.push(Row::new("from a cut to sharp, longest", 1e3 * longest, "ms"));
    }
    rows.push(Row::new("cuts that came before the view was sharp", never as f64, ""));
}

/// What the loader gets out of the disk, beside a plain loop of reads of the same size. None for URLs.
fn disk_rows(asset: &Arc<Asset>, context: &Context) -> Result<Vec<Row>> {
    if url_of(asset.path()).is_some() {
        return Ok(Vec::new());
    }
    let load = DiskLoad::default();
    let read_error = |error| Error::reading(asset.path(), error);
    let plain = plain_reads(asset.path(), mean_cluster_bytes(asset), &load).map_err(read_error)?;
    let queued = queued_reads(asset, &load).map_err(read_error)?;
    let unpacked = unpacked_clusters(asset, &load).map_err(read_error)?;
    let disk = plain.megabytes_per_second();
    let mut rows = vec![
        Row::new("plain loop of direct reads", plain.reads_per_second(), "reads/s"),
        Row::new("clusters read, beside the plain loop", queued.megabytes_per_second(), "MB/s").beside(disk),
    ];
    let options = ClusterLoaderOptions::default();
    let cache_bytes = options.stored_cache_bytes.max(options.cache_bytes) as u64;
    if asset.file_bytes() <= cache_bytes {
        context.note(format!(
            "{}: the loader keeps all of these {} in memory ({} fit), so what it gets out of the disk cannot be measured; take a larger asset",
            asset.path().display(),
            megabytes(asset.file_bytes()),
            megabytes(cache_bytes)
        ));
    } else {
        let (loaded, counts) = loaded_clusters(asset, &options, &load)?;
        let delivered = counts.unpacked_bytes as f64 / loaded.seconds.max(1e-9) / 1e6;
        let rate = loaded.megabytes_per_second();
        rows.push(Row::new("clusters read and unpacked, beside the plain loop", rate, "MB/s").beside(disk));
        rows.push(
            Row::new("texels delivered by these, beside the plain loop", delivered, "MB/s").beside(disk),
        );
    }
    rows.push(Row::new("clusters unpacked from memory", unpacked.megabytes_per_second(), "MB/s"));
    Ok(rows)
}
