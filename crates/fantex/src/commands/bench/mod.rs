//! `fantex bench`: figures of fidelity and speed.

mod fidelity;
mod lookup;
mod noise;
mod paint;
mod speed;
mod stream;
mod terrain;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde::Serialize;

use crate::commands::bake::FitArg;
use crate::context::Context;
use crate::error::CliError;
use crate::size::Count;
use crate::table::columns;

/// Measure fidelity and speed.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bench fidelity bunny.ply --texels 5.59M --wavelength 16
  fantex bench cover --triangles 2M --json")]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Fidelity(FidelityArgs),
    /// Speed of covering, from welding to tile extents: grouped, and with one fan per tile
    Cover(ModelArgs),
    /// Speed of baking: uncompressed and BC7
    Bake(ModelArgs),
    /// Speed of single look-ups through the texture function, beside plain image look-ups, and of images by filter
    Sample(ModelArgs),
    /// Speed of rendering an asset, beside the model itself, and of a million triangles, beside a software rasteriser
    Render(ModelArgs),
    /// Speed of gradient noise and of solids on one thread, beside the crate `noise`
    Noise,
    /// Speed of the block encoders
    Encode,
    Stream(stream::StreamArgs),
    Paint(paint::PaintBenchArgs),
}

/// Bake a sum of sine waves into float tiles and compare it with the function at 400 000 points of the surface.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex bench fidelity bunny.ply --texels 5.59M --wavelength 16")]
struct FidelityArgs {
    /// A model (.glb .gltf .obj .ply .stl)
    model: PathBuf,
    /// Texels in all
    #[arg(long, value_name = "N", default_value = "4M")]
    texels: Count,
    /// Wavelength in texels of the ideal density
    #[arg(long, value_name = "W", default_value_t = 16.0)]
    wavelength: f64,
    /// Target extent of a tile in texels; 0 gives every fan its own tile
    #[arg(long, value_name = "N")]
    tile: Option<u32>,
    /// How texels are found from the function
    #[arg(long, value_enum, default_value_t)]
    fit: FitArg,
}

/// What is measured on.
#[derive(Args, Debug)]
struct ModelArgs {
    /// A model; a generated landscape by default
    model: Option<PathBuf>,
    /// Triangles of the generated landscape
    #[arg(long, value_name = "N", default_value = "200k")]
    triangles: Count,
    /// Texels in all
    #[arg(long, value_name = "N", default_value = "16M")]
    texels: Count,
}

/// One measured figure.
#[derive(Clone, Debug, Serialize)]
struct Row {
    name: String,
    value: f64,
    unit: &'static str,
    /// The same measured for the usual way of doing it, where there is one.
    peer: Option<f64>,
    /// `value / peer`.
    ratio: Option<f64>,
}

impl Row {
    fn new(name: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self { name: name.into(), value, unit, peer: None, ratio: None }
    }

    fn beside(self, peer: f64) -> Self {
        Self { peer: Some(peer), ratio: Some(self.value / peer), ..self }
    }
}

#[derive(Debug, Serialize)]
struct Rows {
    rows: Vec<Row>,
}

/// Runs the command.
pub(crate) fn run(args: &BenchArgs, context: &Context) -> Result<(), CliError> {
    let rows = match &args.what {
        What::Fidelity(args) => return fidelity::run(args, context),
        What::Cover(args) => speed::cover(args, context)?,
        What::Bake(args) => speed::bake(args, context)?,
        What::Sample(args) => {
            let mut rows = speed::sample(args, context)?;
            rows.extend(lookup::rows(context.seed));
            rows
        }
        What::Render(args) => speed::render(args, context)?,
        What::Noise => noise::run()?,
        What::Encode => speed::encode(context)?,
        What::Stream(args) => stream::stream(args, context)?,
        What::Paint(args) => paint::paint(args, context)?,
    };
    context.print(&Rows { rows }, |result| text(&result.rows))
}

fn text(rows: &[Row]) -> String {
    let number = |value: f64| match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.2}"),
        v => format!("{v:.4}"),
    };
    let optional = |value: Option<f64>| value.map_or(String::new(), number);
    let mut cells = vec![["", "value", "unit", "peer", "ratio"].map(str::to_owned).to_vec()];
    cells.extend(rows.iter().map(|row| {
        let unit = row.unit.to_owned();
        vec![row.name.clone(), number(row.value), unit, optional(row.peer), optional(row.ratio)]
    }));
    columns(&cells)
}
