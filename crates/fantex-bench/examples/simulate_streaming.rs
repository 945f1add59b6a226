//! Replays camera paths against the streamer and a modelled disk, without a graphics card, and prints a table: over a generated
//! landscape, or over an asset (along a recorded path), with its parcels as whole rectangles and by their outlines. ANISOTROPY is the filter's, 1 for trilinear look-ups.
//!
//! ```text
//! cargo run --release -p fantex-bench --example simulate_streaming -- ASSET [POOL_SIDE] [PATH.json]
//! cargo run --release -p fantex-bench --example simulate_streaming -- [TRIANGLES] [TEXELS] [TILE] [POOL_SIDE] [FIRST_PATH] [ANISOTROPY]
//! ```

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use fantex_bench::simulate::{
    DiskModel, SimulationOptions, SimulationReport, outlines_of, simulate, simulate_with,
};
use fantex_cover::{CoverOptions, TexelBudget, build_cover};
use fantex_mesh::generate::{LandscapeOptions, landscape};
use fantex_mesh::{CleanOptions, clean};
use fantex_stream::{
    AtlasFormat, AtlasShape, CameraPath, CoveredMesh, Geometry, StreamerOptions, open_asset,
};
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some(asset) = arguments.first().filter(|text| text.parse::<u64>().is_err()) {
        return over_asset(asset, &arguments[1..]);
    }
    let mut numbers = arguments.iter().map(|a| a.parse::<u64>());
    let mut next = |default: u64| numbers.next().unwrap_or(Ok(default));
    let (triangles, texels, tile, side) = (next(200_000)?, next(1 << 28)?, next(128)?, next(4096)?);
    let (first, max_anisotropy) = (next(0)? as usize, next(16)? as f32);
    let started = Instant::now();
    let land = landscape(&LandscapeOptions { triangles, ..LandscapeOptions::default() })?;
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

fn over_asset(path: &str, arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let asset = open_asset(path.as_ref())?;
    let side = arguments.first().map_or(Ok(2048), |text| text.parse())?;
    let flight = match arguments.get(1) {
        Some(recorded) => serde_json::from_str(&std::fs::read_to_string(recorded)?)?,
        None => {
            let center = asset.mesh().world_from_mesh.offset;
            CameraPath::orbit(center, 2.0 * asset.mesh().world_from_mesh.scale, 0.0, 6.0)
        }
    };
    let block_bytes: usize =
        asset.channels().iter().map(|channel| AtlasFormat::of(channel.format, true).block_bytes()).sum();
    let options = SimulationOptions {
        streamer: StreamerOptions { atlas: AtlasShape { side, layers: 1 }, ..StreamerOptions::default() },
        disk: DiskModel { texel_bytes: block_bytes as f64 / 16.0, ..DiskModel::default() },
        rest_seconds: 1.0,
        ..SimulationOptions::default()
    };
    println!("{:12}{}", "", SimulationReport::HEADING);
    let (outlines, asset) = (outlines_of(&asset)?, Arc::new(asset));
    println!("{:12}{}", "rectangles", simulate(asset.clone(), &flight, &options));
    println!("{:12}{}", "outlines", simulate_with(asset, &flight, &options, outlines));
    Ok(())
}
