//! Bakes a function of the surface: latitude lines whose colour follows the normal.
//!
//! ```text
//! cargo run -p fantex --example bake_a_closure -- [MODEL] [ASSET]
//! ```

use std::error::Error;

use fantex::glam::{Vec3, Vec4};
use fantex::mesh::generate::icosphere;
use fantex::store::{VerifyOptions, verify};
use fantex::{BakeFormat, Baker, Mesh, Source};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mesh = match arguments.next() {
        Some(path) => Mesh::load(path)?,
        None => Mesh::from_model(icosphere(5), "sphere")?,
    };
    let asset = arguments
        .next()
        .unwrap_or_else(|| std::env::temp_dir().join("fantex-example-closure.fan").display().to_string());

    // Called on many threads, for every texel of every tile; colours are linear.
    let lines = |point: &fantex::bake::TexelPoint| -> Vec4 {
        let wave = 0.5 + 0.5 * (40.0 * point.position.y).sin();
        (Vec3::splat(0.5) + 0.5 * point.normal).lerp(Vec3::ONE, wave).extend(1.0)
    };
    let baked = Baker::new(&mesh)
        .source(Source::function(lines))
        .texels(500_000)
        .format(BakeFormat::Rgba8)
        .overwrite(true)
        .write(&asset)?;
    println!("{asset}: {} texels in {} tiles", baked.summary.texels, baked.cover.groups);

    let report = verify(asset.as_ref(), &VerifyOptions::default())?;
    println!("largest jump across an edge: {:e}", report.continuity.largest_jump);
    Ok(())
}
