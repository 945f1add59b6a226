//! Replays camera paths against a [`Streamer`] with a modelled disk, without a graphics card.
//!
//! Demand and residency run as they do in the viewer; only reading is modelled, in simulated time. So figures of hits, bytes,
//! evictions and waiting are the same on every machine; those of processor time are measured.

mod model_loader;
mod path;

pub use model_loader::*;
pub use path::*;

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use crate::{CutWatch, FrameOptions, Geometry, Streamer, StreamerOptions};

/// What a path is replayed with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulationOptions {
    /// The streamer.
    pub streamer: StreamerOptions,
    /// The disk.
    pub disk: DiskModel,
    /// Pixels of the picture.
    pub size: [u32; 2],
    /// Frames per second.
    pub frame_rate: f64,
    /// Bytes that may be uploaded per frame.
    pub upload_bytes: usize,
    /// Seconds that the camera stands still at the end of the path.
    pub rest_seconds: f64,
}

impl Default for SimulationOptions {
    /// 1280x720 at 60 frames per second, half a second of rest.
    fn default() -> Self {
        Self {
            streamer: StreamerOptions::default(),
            disk: DiskModel::default(),
            size: [1280, 720],
            frame_rate: 60.0,
            upload_bytes: 4 << 20,
            rest_seconds: 0.5,
        }
    }
}

/// What happened on a path. Its `Display` is one row under [`SimulationReport::HEADING`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimulationReport {
    /// Frames.
    pub frames: u64,
    /// Share of the needed parcels that were resident, mean over the frames.
    pub hit_rate: f64,
    /// Share of the visible tiles that were at their level, mean over the frames.
    pub complete_share: f64,
    /// Share of the frames in which every visible tile was at its level.
    pub complete_frames: f64,
    /// Bytes of texels handed over for upload.
    pub bytes: u64,
    /// Parcels asked for.
    pub requests: u64,
    /// Parcels that left.
    pub evictions: u64,
    /// The greatest share of the atlas in use.
    pub peak_occupancy: f64,
    /// The greatest bias, levels.
    pub peak_bias_levels: f32,
    /// After the beginning and each cut, seconds until the visible tiles were at the levels that the cut asked of them (see
    /// [`CutWatch`]); `None` where the next cut came first.
    pub seconds_to_sharp: Vec<Option<f64>>,
    /// Processor time of demand, per frame, ascending.
    pub demand_times: Vec<Duration>,
    /// Processor time of everything else, per frame, ascending.
    pub residency_times: Vec<Duration>,
    /// Whether nothing was on its way at the end.
    pub is_settled: bool,
}

impl SimulationReport {
    /// Names of the columns.
    pub const HEADING: &'static str = "frames  hits %  sharp %  sharp frames %     MB  requests  evictions  pool %  bias  to sharp ms  demand us p50/max  \
         residency us p50/max";

    /// The longest time to sharp; `None` if some view never was.
    pub fn slowest_to_sharp(&self) -> Option<f64> {
        self.seconds_to_sharp.iter().try_fold(0.0, |longest: f64, &seconds| Some(longest.max(seconds?)))
    }
}

impl fmt::Display for SimulationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let micros = |times: &[Duration]| {
            let at = |i: usize| times.get(i).map_or(0.0, |t| t.as_secs_f64() * 1e6);
            format!("{:.0}/{:.0}", at(times.len() / 2), at(times.len().saturating_sub(1)))
        };
        let sharp = self.slowest_to_sharp().map_or("never".to_owned(), |s| format!("{:.0}", s * 1e3));
        write!(
            f,
            "{:6} {:7.2} {:8.2} {:15.1} {:6.1} {:9} {:10} {:7.1} {:5.2} {:>12} {:>18} {:>21}",
            self.frames,
            100.0 * self.hit_rate,
            100.0 * self.complete_share,
            100.0 * self.complete_frames,
            self.bytes as f64 / 1e6,
            self.requests,
            self.evictions,
            100.0 * self.peak_occupancy,
            self.peak_bias_levels,
            sharp,
            micros(&self.demand_times),
            micros(&self.residency_times),
        )
    }
}

/// Replays a path.
pub fn simulate(
    geometry: Arc<dyn Geometry>,
    path: &CameraPath,
    options: &SimulationOptions,
) -> SimulationReport {
    let clock = ModelClock::default();
    let loader = ModelLoader::new(geometry.clone(), options.disk, clock.clone());
    let mut streamer = Streamer::new(geometry.clone(), Box::new(loader), options.streamer);
    let mut report = SimulationReport::default();
    let mut cuts = path.cuts_seconds().into_iter().peekable();
    let mut waiting: Option<(f64, CutWatch)> = None;
    let frames = ((path.duration_seconds() + options.rest_seconds) * options.frame_rate).ceil() as u64;
    let texel_bytes = options.disk.texel_bytes;
    for frame in 0..=frames {
        let seconds = frame as f64 / options.frame_rate;
        clock.set(seconds);
        while cuts.next_if(|&cut| cut <= seconds).is_some() {
            if waiting.replace((seconds, CutWatch::new())).is_some() {
                report.seconds_to_sharp.push(None);
            }
        }
        let camera = path.at(seconds);
        let view = camera.and_then(|c| c.view(&geometry.mesh().world_from_mesh, options.size));
        let elapsed_seconds = (1.0 / options.frame_rate) as f32;
        let changes = streamer
            .update(view.as_ref(), FrameOptions { upload_bytes: options.upload_bytes, elapsed_seconds });
        let figures = streamer.statistics();
        let texels = |extent: [u32; 2]| f64::from(extent[0]) * f64::from(extent[1]);
        report.bytes +=
            changes.uploads.iter().map(|u| texels(u.texels.extent) * texel_bytes).sum::<f64>() as u64;
        let needed = figures.needed.parcels.max(1);
        report.hit_rate += 1.0 - figures.missing as f64 / needed as f64;
        report.complete_share += figures.complete_share();
        report.complete_frames += f64::from(u8::from(figures.complete_groups == figures.visible_groups));
        report.peak_occupancy = report.peak_occupancy.max(figures.occupancy());
        report.peak_bias_levels = report.peak_bias_levels.max(figures.bias_levels);
        report.demand_times.push(figures.times.demand);
        report.residency_times.push(figures.times.residency + figures.times.prediction);
        if waiting.as_mut().is_some_and(|(_, watch)| watch.update(&streamer))
            && let Some((since, _)) = waiting.take()
        {
            report.seconds_to_sharp.push(Some(seconds - since));
        }
    }
    if waiting.is_some() {
        report.seconds_to_sharp.push(None);
    }
    let figures = streamer.statistics();
    report.frames = frames + 1;
    report.hit_rate /= report.frames as f64;
    report.complete_share /= report.frames as f64;
    report.complete_frames /= report.frames as f64;
    report.requests = figures.requests;
    report.evictions = figures.evictions;
    report.demand_times.sort_unstable();
    report.residency_times.sort_unstable();
    report.is_settled = streamer.is_settled();
    report
}
