//! `fantex generate`: procedural models, and photographs of models.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, Subcommand};
use fantex::mesh::generate::{LandscapeOptions, landscape};
use fantex::mesh::{CleanOptions, Model, WriteGeometry, clean, write_model};
use glam::Vec3;
use serde::Serialize;

use crate::commands::bake::{self, BakeJob, EncodingArgs};
use crate::commands::info::{CoverArgs, DEFAULT_BUDGET};
use crate::commands::photographs::{self, PhotographsArgs};
use crate::context::Context;
use crate::error::CliError;
use crate::size::{Count, counted, positive, share};
use crate::sources::solid_source;

/// Generate a procedural model, or photographs of a model.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex generate landscape -o cave.ply --triangles 500k --seed 7
  fantex generate photographs bottle.gltf -o shoot --count 24")]
pub(crate) struct GenerateArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    Landscape(LandscapeArgs),
    Photographs(PhotographsArgs),
}

/// A closed landscape with mountains, cliffs, overhangs, tunnels and arches; y is up, units are metres.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex generate landscape -o cave.ply --triangles 500k --seed 7
  fantex generate landscape -o world.fan --triangles 1M --texels 16G --format bc1 --memory 512M

An asset (.fan) is baked at once from the solid 'landscape': sand, grass, rock and snow by altitude and slope.")]
struct LandscapeArgs {
    /// The model to write: .ply, .obj or .glb; or an asset: .fan
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Triangles aimed at; the result lies within a tenth of it
    #[arg(long, value_name = "N", default_value = "500k")]
    triangles: Count,
    /// Side of the square in metres
    #[arg(long, value_name = "METRES", default_value_t = f64::from(LandscapeOptions::default().size), value_parser = positive, allow_negative_numbers = true)]
    size: f64,
    /// Tunnels wanted
    #[arg(long, value_name = "N", default_value_t = LandscapeOptions::default().tunnels)]
    tunnels: u32,
    /// Natural arches wanted
    #[arg(long, value_name = "N", default_value_t = LandscapeOptions::default().arches)]
    arches: u32,
    /// How far triangles are from regular, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    irregularity: f64,
    #[command(flatten, next_help_heading = "Assets only")]
    cover: CoverArgs,
    #[command(flatten, next_help_heading = "Assets only")]
    encoding: EncodingArgs,
}

impl LandscapeArgs {
    fn writes_asset(&self) -> bool {
        self.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("fan"))
    }
}

#[derive(Debug, Serialize)]
struct LandscapeInfo {
    output: PathBuf,
    triangles: u64,
    vertices: u64,
    genus: u64,
    components: u64,
    tunnels: u32,
    arches: u32,
    seed: u64,
    seconds: f64,
}

/// Runs the command.
pub(crate) fn run(args: &GenerateArgs, context: &Context) -> Result<(), CliError> {
    match &args.what {
        What::Landscape(args) => run_landscape(args, context),
        What::Photographs(args) => photographs::run(args, context),
    }
}

fn run_landscape(args: &LandscapeArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    context.check_output(&args.output)?;
    let made = landscape(&LandscapeOptions {
        triangles: args.triangles.0,
        seed: context.seed,
        size: args.size as f32,
        tunnels: args.tunnels,
        arches: args.arches,
        irregularity: args.irregularity as f32,
    });
    if args.writes_asset() {
        return bake_landscape(args, made.into(), started, context);
    }
    if !args.cover.is_default() {
        return Err(CliError::TexelsOfModel { path: args.output.clone() });
    }
    let positions: Vec<_> = made.positions.iter().copied().map(Vec3::as_dvec3).collect();
    {
        let _deferral = context.defer_interrupt();
        let geometry = WriteGeometry { positions: &positions, triangles: &made.triangles, colors: None };
        write_model(&args.output, &geometry, context.force)?;
    }
    let info = LandscapeInfo {
        output: args.output.clone(),
        triangles: made.triangles.len() as u64,
        vertices: made.positions.len() as u64,
        genus: made.genus,
        components: made.components,
        tunnels: made.tunnels,
        arches: made.arches,
        seed: context.seed,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        format!(
            "{}: {}, genus {} ({}, {}), {:.1} s",
            info.output.display(),
            counted(info.triangles, "triangle"),
            info.genus,
            counted(u64::from(info.tunnels), "tunnel"),
            counted(u64::from(info.arches), "arch"),
            info.seconds
        )
    })
}

fn bake_landscape(
    args: &LandscapeArgs,
    model: Model,
    started: Instant,
    context: &Context,
) -> Result<(), CliError> {
    let (mesh, _) = clean(model, &CleanOptions::default())?;
    let source = solid_source("landscape", &mesh, context.seed)?;
    let job = BakeJob {
        mesh: &mesh,
        budget: args.cover.budget(&mesh).unwrap_or(DEFAULT_BUDGET),
        cover: &args.cover,
        encoding: &args.encoding,
        output: &args.output,
        source_name: "solid=landscape".to_owned(),
        started,
        load_seconds: started.elapsed().as_secs_f64(),
        memory_bytes: context.memory_bytes,
    };
    let info = job.run(&source, context)?;
    context.print(&info, bake::text)
}
