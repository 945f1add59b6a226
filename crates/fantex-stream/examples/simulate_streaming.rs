//! Replays camera paths over a landscape against the streamer, without a graphics card, and prints a table. ANISOTROPY is the
//! filter's, 1 for trilinear look-ups.
//!
//! ```text
//! cargo run --release -p fantex-stream --example simulate_streaming -- [TRIANGLES] [TEXELS] [TILE] [POOL_SIDE] [FIRST_PATH] [ANISOTROPY]
//! ```

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::generate::{LandscapeOptions, landscape};
use fantex_mesh::{CleanOptions, clean};
use fantex_stream::simulate::{CameraPath, DiskModel, SimulationOptions, SimulationReport, simulate};
use fantex_stream::{AtlasShape, CoveredMesh, Geometry, StreamerOptions};
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let mut numbers = std::env::args().skip(1).map(|a| a.parse::<u64>());
    let mut next = |default: u64| numbers.next().unwrap_or(Ok(default));
    let (triangles, texels, tile, side) = (next(200_000)?, next(1 << 28)?, next(128)?, next(4096)?);
    let (first, max_anisotropy) = (next(0)? as usize, next(16)? as f32);
    let started = Instant::now();
    let land = landscape(&LandscapeOptions { triangles, ..LandscapeOptions::default() });
    let (mesh, _) = clean(land.into(), &CleanOptions::default())?;
    let options =
        CoverOptions { budget: TexelBudget::Total(texels), tile: tile as u32, ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options)?;
    println!(
        "{} triangles, {} groups, {:.1} M texels, made in {:.1?}",
        mesh.triangles.len(),
        cover.groups.len(),
        cover.texels() as f64 / 1e6,
        started.elapsed()
    );
    let center = mesh.world_from_mesh.offset;
    let geometry: Arc<dyn Geometry> = Arc::new(CoveredMesh { mesh, cover });
    let atlas = AtlasShape { side: side as u32, layers: 1 };
    let paths = [
        (
            "still",
            CameraPath { keyframes: CameraPath::orbit(center, 700.0, 300.0, 1.0).keyframes[..1].to_vec() },
        ),
        ("orbit, slow", CameraPath::orbit(center, 700.0, 300.0, 60.0)),
        ("orbit, fast", CameraPath::orbit(center, 700.0, 300.0, 6.0)),
        (
            "flight, 30 m/s",
            CameraPath::fly(DVec3::new(0.0, 200.0, 450.0), DVec3::new(0.0, 200.0, 150.0), 10.0),
        ),
        (
            "flight, 300 m/s",
            CameraPath::fly(DVec3::new(0.0, 200.0, 450.0), DVec3::new(0.0, 200.0, -450.0), 3.0),
        ),
        ("cuts", CameraPath::cuts(center, &[900.0, 300.0, 600.0, 1200.0, 250.0], 2.0)),
        ("random walk", CameraPath::random_walk(center, 500.0, 1, 10.0)),
    ];
    println!("{:16}{}", "", SimulationReport::HEADING);
    for (name, path) in paths.iter().skip(first) {
        let options = SimulationOptions {
            streamer: StreamerOptions { atlas, max_anisotropy, ..StreamerOptions::default() },
            disk: DiskModel::default(),
            rest_seconds: 1.0,
            ..SimulationOptions::default()
        };
        println!("{name:16}{}", simulate(geometry.clone(), path, &options));
    }
    Ok(())
}
