//! What frames of a streamer cost beside what is counted of them: how the costs in `residency/budget.rs` were found.
//!
//! ```text
//! cargo run --release -p fantex-bench --example frame_costs -- TOURS ASSET...
//! ```
//!
//! Flies around, over and through an asset in real time, as `fantex bench stream` does, each time with an empty atlas. Prints for
//! first view, orbit, flight and cuts the processor time of this thread per frame beside the counted one, then the least squares
//! of the times over the counts. Linux only: elsewhere processor time is not known, and all is zero.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_store::Asset;
use fantex_stream::{
    AtlasShape, ClusterLoader, ClusterLoaderOptions, CutWatch, FrameOptions, FrameWork, Streamer,
    StreamerOptions, WORK_COSTS, WORK_KINDS,
};
use fantex_stream::{CameraKeyframe, CameraPath};
use glam::DVec3;

/// When the camera jumped.
struct Cut {
    seconds: f64,
    /// Nanoseconds of the process so far.
    processor: f64,
    frame: usize,
}

/// A frame of a part of the tour.
struct Measured {
    part: usize,
    nanoseconds: f64,
    work: FrameWork,
}

const PARTS: [&str; 4] = ["first view", "orbit", "flight", "cuts"];

/// Graphics memory for texels.
const POOL_BYTES: u64 = 64 << 20;

/// What belongs to the first view.
const FIRST_SECONDS: f64 = 1.0;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let tours: u32 = arguments.next().ok_or("expected how many tours, then assets")?.parse()?;
    let mut frames = Vec::new();
    for path in arguments {
        let asset = Arc::new(Asset::open(Path::new(&path))?);
        for _ in 0..tours {
            fly(&asset, &mut frames)?;
        }
    }
    for (part, name) in PARTS.iter().enumerate() {
        let of_part: Vec<&Measured> = frames.iter().filter(|frame| frame.part == part).collect();
        let percentiles = |of: &dyn Fn(&Measured) -> f64| {
            let mut values: Vec<f64> = of_part.iter().map(|frame| of(frame)).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: f64| {
                let index = (share * values.len().saturating_sub(1) as f64) as usize;
                values.get(index).map_or(0.0, |value| 1e-6 * value)
            };
            format!("{:.2}/{:.2}/{:.2}", at(0.5), at(0.99), at(1.0))
        };
        println!(
            "{name:12} {:4} frames, ms p50/p99/max: taken {}, counted {}",
            of_part.len(),
            percentiles(&|frame| frame.nanoseconds),
            percentiles(&|frame| f64::from(frame.work.nanoseconds())),
        );
    }
    let counts = |i: usize| frames.iter().map(|frame| u64::from(frame.work.counts[i])).sum::<u64>();
    for (i, cost) in fitted(&frames).into_iter().enumerate() {
        println!(
            "{:24} {:9} times, {cost:7.1} ns; counted as {}",
            WORK_COSTS[i].0,
            counts(i),
            WORK_COSTS[i].1
        );
    }
    Ok(())
}

/// One tour: adds its frames, prints when views were sharp.
fn fly(asset: &Arc<Asset>, frames: &mut Vec<Measured>) -> Result<(), Box<dyn Error>> {
    let (path, parts) = tour(asset);
    let loader = ClusterLoader::open(Arc::clone(asset), &ClusterLoaderOptions::default())?;
    let monitor = loader.monitor();
    let atlas = AtlasShape::within(POOL_BYTES, loader.formats());
    let options = StreamerOptions { atlas, ..StreamerOptions::default() };
    let mut streamer = Streamer::new(Arc::clone(asset) as _, Box::new(loader), options);
    let mut cuts = path.cuts_seconds().into_iter().peekable();
    let mut watch: Option<(Cut, CutWatch)> = None;
    let began = Instant::now();
    let mut last = 0.0;
    let mut sharp = Vec::new();
    loop {
        let seconds = began.elapsed().as_secs_f64();
        let Some(camera) = path.at(seconds).filter(|_| seconds < path.duration_seconds()) else {
            break;
        };
        while cuts.next_if(|&cut| cut <= seconds).is_some() {
            let processor = processor_nanoseconds(Of::Process);
            let cut = Cut { seconds, processor, frame: frames.len() };
            if watch.replace((cut, CutWatch::new())).is_some() {
                sharp.push("never".to_owned());
            }
        }
        let view = camera.view(&asset.mesh().world_from_mesh, [1280, 720]);
        let frame = FrameOptions { elapsed_seconds: (seconds - last) as f32, ..FrameOptions::default() };
        last = seconds;
        let before = processor_nanoseconds(Of::Thread);
        let changes = streamer.update(view.as_ref(), frame);
        let nanoseconds = processor_nanoseconds(Of::Thread) - before;
        drop(changes);
        let part = parts.iter().filter(|&&begin| begin <= seconds).count() - 1;
        frames.push(Measured { part, nanoseconds, work: streamer.statistics().frame_work });
        if watch.as_mut().is_some_and(|(_, watch)| watch.update(&streamer))
            && let Some((since, _)) = watch.take()
        {
            let ms = 1e3 * (began.elapsed().as_secs_f64() - since.seconds);
            let own: f64 = frames[since.frame..].iter().map(|frame| 1e-6 * frame.nanoseconds).sum();
            let all = 1e-6 * (processor_nanoseconds(Of::Process) - since.processor);
            sharp.push(format!("{ms:.0} ({}, {own:.0}, {all:.0})", frames.len() - since.frame));
        }
        let next = Duration::from_secs_f64(seconds + 1.0 / 60.0);
        std::thread::sleep(next.saturating_sub(began.elapsed()));
    }
    let (figures, loaded) = (streamer.statistics(), monitor.statistics());
    println!(
        "from a cut to sharp, ms (frames, processor time of this thread, of all): {}; {} parcels asked for, {} came, {:.0} MB read, {:.2} s unpacking",
        sharp.join(", "),
        figures.requests,
        loaded.parcels,
        1e-6 * loaded.bytes_read as f64,
        loaded.unpack_seconds
    );
    Ok(())
}

/// The tour of `fantex bench stream`, and when its parts begin.
fn tour(asset: &Asset) -> (CameraPath, Vec<f64>) {
    let positions = || asset.mesh().positions.iter().map(|p| asset.mesh().world_from_mesh.point(*p));
    let min = positions().fold(DVec3::INFINITY, DVec3::min);
    let max = positions().fold(DVec3::NEG_INFINITY, DVec3::max);
    let (center, radius) = (0.5 * (min + max), 0.5 * (max - min).length());
    let along = DVec3::new(0.7, 0.0, 0.7) * radius;
    let above = DVec3::Y * (max.y - center.y + 0.05 * radius);
    let parts = [
        CameraPath::orbit(center, 1.2 * radius, 0.6 * radius, 3.0),
        CameraPath::fly(center - along + above, center + along + above, 3.0),
        CameraPath::cuts(center, &[2.0, 0.8, 1.2, 0.6, 1.0].map(|d| d * radius), 1.2),
    ];
    let (mut tour, mut begins) = (CameraPath::default(), vec![0.0, FIRST_SECONDS]);
    for part in parts {
        let begin = tour.duration_seconds();
        if begin > 0.0 {
            begins.push(begin);
        }
        tour.keyframes.extend(part.keyframes.into_iter().enumerate().map(|(i, keyframe)| CameraKeyframe {
            seconds: begin + keyframe.seconds,
            is_cut: keyframe.is_cut || i == 0,
            ..keyframe
        }));
    }
    (tour, begins)
}

/// Whose processor time.
enum Of {
    Thread,
    Process,
}

#[cfg(target_os = "linux")]
#[allow(unsafe_code, reason = "the processor time of a thread is known to the system only")]
fn processor_nanoseconds(of: Of) -> f64 {
    let clock = match of {
        Of::Thread => libc::CLOCK_THREAD_CPUTIME_ID,
        Of::Process => libc::CLOCK_PROCESS_CPUTIME_ID,
    };
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call writes to nothing but `time`, which outlives it.
    unsafe { libc::clock_gettime(clock, &raw mut time) };
    1e9 * time.tv_sec as f64 + time.tv_nsec as f64
}

#[cfg(not(target_os = "linux"))]
fn processor_nanoseconds(_: Of) -> f64 {
    0.0
}

/// The costs, none below zero, that lie closest to the times of all frames, by coordinate descent.
fn fitted(frames: &[Measured]) -> [f64; WORK_KINDS] {
    // A frame that does nothing takes time, too.
    let mut fixed = 0.0;
    let mut costs = [0.0; WORK_KINDS];
    let mut rests: Vec<f64> = frames.iter().map(|frame| frame.nanoseconds).collect();
    for _ in 0..2000 {
        let mean = rests.iter().sum::<f64>() / rests.len().max(1) as f64;
        fixed += mean;
        rests.iter_mut().for_each(|rest| *rest -= mean);
        for (i, cost) in costs.iter_mut().enumerate() {
            let counts = || frames.iter().map(|frame| f64::from(frame.work.counts[i]));
            let squares: f64 = counts().map(|n| n * n).sum();
            let product: f64 = counts().zip(&rests).map(|(n, rest)| n * rest).sum();
            let change = (product / squares.max(1.0)).max(-*cost);
            *cost += change;
            rests.iter_mut().zip(counts()).for_each(|(rest, n)| *rest -= n * change);
        }
    }
    let error = (rests.iter().map(|rest| rest * rest).sum::<f64>() / rests.len().max(1) as f64).sqrt();
    println!("a frame takes {:.3} ms and what follows, to within {:.2} ms", 1e-6 * fixed, 1e-6 * error);
    costs
}
