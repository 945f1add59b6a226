//! Streams an asset for a view: which pages are needed, read, and placed in an atlas, frame by frame. What draws from the atlas
//! is up to the host.
//!
//! ```text
//! cargo run -p fantex --example stream_without_a_gpu -- [ASSET]
//! ```

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use fantex::glam::{Mat3, Vec3};
use fantex::mesh::generate::torus;
use fantex::stream::{
    AtlasShape, ClusterLoader, ClusterLoaderOptions, FrameOptions, StreamView, Streamer, StreamerOptions,
};
use fantex::{Asset, Baker, Mesh, Source};

fn main() -> Result<(), Box<dyn Error>> {
    let asset = Asset::open(std::env::args().nth(1).map_or_else(granite_torus, |path| Ok(path.into()))?)?;
    let loader = ClusterLoader::open(asset.shared().clone(), &ClusterLoaderOptions::default())?;
    let atlas = AtlasShape { side: 1024, layers: 1 };
    let options = StreamerOptions { atlas, ..StreamerOptions::default() };
    let mut streamer = Streamer::new(asset.shared().clone(), Box::new(loader), options);

    // From the front, mesh space: the camera looks along -z.
    let view = StreamView::new(Vec3::new(0.0, 0.0, 3.0), Mat3::IDENTITY, 0.6, [1280, 720]);
    let (mut parcels, mut entries, mut frames) = (0, 0, 0);
    while !streamer.is_settled() || frames == 0 {
        let changes = streamer.update(Some(&view), FrameOptions::default());
        // A host copies each upload to its place in the atlas, then writes the entries of the page table.
        parcels += changes.uploads.len();
        entries += changes.entries.len();
        frames += 1;
        std::thread::sleep(Duration::from_millis(1));
    }
    let figures = streamer.statistics();
    println!(
        "sharp after {frames} frames: {parcels} parcels, {entries} entries, {:.0} % of the atlas in use",
        100.0 * figures.occupancy()
    );
    Ok(())
}

/// An asset to try it on.
fn granite_torus() -> Result<PathBuf, Box<dyn Error>> {
    let path = std::env::temp_dir().join("fantex-example-granite.fan");
    let mesh = Mesh::from_model(torus(96, 48), "torus")?;
    Baker::new(&mesh).source(Source::solid("granite")).texels(500_000).overwrite(true).write(&path)?;
    Ok(path)
}
