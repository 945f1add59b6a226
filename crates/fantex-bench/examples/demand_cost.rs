//! Processor time per frame of demand and residency where every fan of a landscape has its own tile.
//!
//! ```text
//! cargo run --release -p fantex-bench --example demand_cost -- [TRIANGLES]
//! ```
//!
//! Prints for a still, a slow, a fast and a jumping camera the least, the lower quartile's and the median frame. Frames differ
//! in how many bounds run out, so the least is not typical; other work on the machine shows in the upper ones.

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use fantex_bench::simulate::{DiskModel, ModelClock, ModelLoader};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::generate::{LandscapeOptions, landscape};
use fantex_mesh::{CleanOptions, clean};
use fantex_stream::{
    AtlasShape, CameraKeyframe, CameraPath, CoveredMesh, FrameOptions, Geometry, Streamer, StreamerOptions,
};
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let triangles = std::env::args().nth(1).map_or(Ok(2_000_000), |a| a.parse())?;
    let land = landscape(&LandscapeOptions { triangles, ..LandscapeOptions::default() });
    let (mesh, _) = clean(land.into(), &CleanOptions::default())?;
    let budget = TexelBudget::Total(64 * mesh.triangles.len() as u64);
    let (cover, _) = build_cover(&mesh, &CoverOptions { budget, tile: 0, ..CoverOptions::default() })?;
    println!("{} triangles, {} groups", mesh.triangles.len(), cover.groups.len());
    let (offset, world_from_mesh) = (mesh.world_from_mesh.offset, mesh.world_from_mesh);
    let geometry: Arc<dyn Geometry> = Arc::new(CoveredMesh { mesh, cover });
    let clock = ModelClock::default();
    let disk = DiskModel { bandwidth: 1e10, queue_depth: 1 << 14, ..DiskModel::default() };
    let loader = ModelLoader::new(geometry.clone(), disk, clock.clone());
    let options = StreamerOptions {
        atlas: AtlasShape { side: 4096, layers: 8 },
        look_ahead_seconds: 0.0,
        ..Default::default()
    };
    let started = Instant::now();
    let mut streamer = Streamer::new(geometry, Box::new(loader), options);
    println!("bounds taken in {:.2?}", started.elapsed());
    let fly = |metres_per_frame: f64| {
        let (from, way) = (DVec3::new(0.0, 150.0, 480.0), DVec3::new(0.0, 0.0, -metres_per_frame * 200.0));
        CameraPath::fly(offset + from, offset + from + way, 200.0 / 60.0)
    };
    let start = fly(0.1).keyframes[0];
    let mut frame = 0u32;
    let mut measure = |name: &str, frames: u32, camera: &dyn Fn(f64) -> Option<CameraKeyframe>| {
        let (mut demand, mut residency) = (Vec::new(), Vec::new());
        let (mut groups, mut blocks) = (0u64, 0u64);
        for i in 0..frames {
            frame += 1;
            clock.set(f64::from(frame) / 60.0);
            let view = camera(f64::from(i) / 60.0).and_then(|c| c.view(&world_from_mesh, [1920, 1080]));
            streamer
                .update(view.as_ref(), FrameOptions { upload_bytes: 16 << 20, ..FrameOptions::default() });
            let figures = streamer.statistics();
            demand.push(figures.times.demand);
            residency.push(figures.times.residency);
            groups += u64::from(figures.work.groups);
            blocks += u64::from(figures.work.uniform_blocks);
        }
        let figures = streamer.statistics();
        println!(
            "{name:22} demand {} us, residency {} us; per frame {} blocks, {} groups; {} visible, bias {}",
            quartiles(demand),
            quartiles(residency),
            blocks / u64::from(frames),
            groups / u64::from(frames),
            figures.visible_groups,
            figures.bias_levels
        );
    };
    measure("warming up", 200, &|_| Some(start));
    measure("still", 200, &|_| Some(start));
    for (name, speed) in [("0.1 m per frame", 0.1), ("0.5 m per frame", 0.5), ("3 m per frame", 3.0)] {
        measure(name, 200, &|seconds| fly(speed).at(seconds));
    }
    let cuts =
        CameraPath::cuts(offset, &[700.0, 400.0, 900.0, 500.0, 300.0, 800.0, 450.0, 650.0], 1.0 / 60.0);
    measure("a cut in every frame", 16, &|seconds| cuts.at(seconds % (8.0 / 60.0)));
    Ok(())
}

/// Least, lower quartile and median in microseconds.
fn quartiles(mut times: Vec<Duration>) -> String {
    times.sort_unstable();
    let micros = |i: usize| times.get(i).map_or(0.0, |t| t.as_secs_f64() * 1e6);
    format!("{:.0}/{:.0}/{:.0}", micros(0), micros(times.len() / 4), micros(times.len() / 2))
}
