//! The colour of an asset at a point of the world, and along a line over its surface.
//!
//! ```text
//! cargo run -p fantex --example sample_an_asset -- [ASSET]
//! ```

use std::error::Error;
use std::path::PathBuf;

use fantex::mesh::generate::torus;
use fantex::{Asset, Baker, ChannelKind, Footprint, Mesh, Source};

fn main() -> Result<(), Box<dyn Error>> {
    let path = match std::env::args().nth(1) {
        Some(path) => PathBuf::from(path),
        None => marble_torus()?,
    };
    let asset = Asset::open(&path)?;
    let sampler = asset.sampler(64 << 20);
    let point = asset.nearest_point([0.1, 0.2, 0.3]).ok_or("no point of the world")?;
    let rgba = sampler.sample(ChannelKind::BaseColor, point, Footprint::NONE)?;
    println!("{}: {rgba:.3} at the point nearest to (0.1, 0.2, 0.3)", path.display());

    let line = (0..8).filter_map(|i| asset.nearest_point([1.0, 0.25 * f64::from(i) - 1.0, 0.0]));
    let points: Vec<_> = line.map(|point| (point, Footprint::NONE)).collect();
    for ((point, _), rgba) in points.iter().zip(sampler.sample_many(ChannelKind::BaseColor, &points)?) {
        let place = asset.mesh().world_from_mesh.point(point.position(asset.mesh()));
        println!("{rgba:.3} at {place:.2}");
    }
    Ok(())
}

/// An asset to try it on.
fn marble_torus() -> Result<PathBuf, Box<dyn Error>> {
    let path = std::env::temp_dir().join("fantex-example-marble.fan");
    let mesh = Mesh::from_model(torus(48, 24), "torus")?;
    Baker::new(&mesh).source(Source::solid("marble")).texels(100_000).overwrite(true).write(&path)?;
    Ok(path)
}
