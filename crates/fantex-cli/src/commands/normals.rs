//! `fantex normals`: the normals of a detailed model as a normal map of a coarse one.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use fantex::bake::{NormalMapOptions, NormalSpace, bake_normal_map};
use fantex::texture::ColorSpace;
use fantex::{Error, Result};
use serde::Serialize;

use crate::commands::image::{DEPTHS, FileDepth, depth_of, saved};
use crate::context::Context;
use crate::scene::{ReadArgs, check_picture_name, open_shape, show_notes, size};
use crate::text::{Choices, ShownPath, one_of, positive, whole};

/// Bake the normals of a detailed model into a normal map over the texture coordinates of a coarse one.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex normals coarse.glb scan.ply -o coarse-normals.png --size 2048x2048
  fantex normals coarse.glb scan.ply -o coarse-normals.png --space object --depth 16

Every point of the coarse model looks for the detailed one along its smooth normal, outwards and inwards, not farther than the cage, which is \
measured where it is not given. Tangent space is glTF's: green points to the top of the image. Without texture coordinates there is \
'fantex bake coarse.ply -o coarse.fan --source mesh=scan.ply', which needs none.")]
pub(crate) struct NormalsArgs {
    /// The coarse model, or an asset, with texture coordinates
    coarse: PathBuf,
    /// The detailed model, or an asset, in the same place
    detailed: PathBuf,
    /// The picture to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Columns and rows
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    size: [u32; 2],
    /// What the colours are relative to
    #[arg(long, value_parser = one_of(&SPACES), default_value = "tangent")]
    space: NormalSpace,
    /// The set of texture coordinates
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 0, value_parser = whole::<usize>)]
    uv_set: usize,
    /// Texels by which the edges of charts are continued
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = NormalMapOptions::default().padding, value_parser = whole::<u32>)]
    padding: u32,
    /// Rays along each side of a texel
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = NormalMapOptions::default().samples, value_parser = whole::<u32>)]
    samples: u32,
    /// How far the detailed surface is looked for, world units
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true, value_parser = positive)]
    cage: Option<f64>,
    /// Numbers of the file [default: float for .exr and .hdr, else 8]
    #[arg(long, value_parser = one_of(&DEPTHS))]
    depth: Option<FileDepth>,
    #[command(flatten)]
    read: ReadArgs,
}

const SPACES: Choices<NormalSpace, 2> = [
    ("tangent", "Tangent, bitangent and normal of the coarse model", NormalSpace::Tangent),
    ("object", "The axes of the model", NormalSpace::Object),
];

#[derive(Debug, Serialize)]
struct NormalsInfo {
    output: ShownPath,
    width: u32,
    height: u32,
    cage: f64,
    /// Share of the points that found nothing within the cage and took the nearest point.
    missed_share: f64,
    /// Share of what the coarse model covers in the picture that shows texels of other triangles.
    shared_share: f64,
    seconds: f64,
}

pub(crate) fn run(args: &NormalsArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    context.check_output_of(&args.output, &args.coarse)?;
    context.check_output_of(&args.output, &args.detailed)?;
    check_picture_name(&args.output, false)?;
    let depth = depth_of(args.depth, FileDepth::Eight, &args.output)?;
    let options = NormalMapOptions {
        size: args.size,
        uv_set: args.uv_set,
        space: args.space,
        padding: args.padding,
        samples: args.samples,
        cage: args.cage,
    };
    options.check()?;
    let open = |path| open_shape(path, args.read, context);
    let [coarse, detailed] = [open(&args.coarse)?, open(&args.detailed)?];
    [&coarse, &detailed].into_iter().for_each(|model| show_notes(model, context));
    if coarse.corners.uv_sets.is_empty() {
        let [coarse, detailed] = [&args.coarse, &args.detailed].map(|path| path.display());
        return Err(Error::invalid(format!(
            "{coarse} has no texture coordinates, over which a normal map lies; 'fantex bake {coarse} --source mesh={detailed}' needs none"
        )));
    }
    let (image, report) = bake_normal_map(&coarse, &detailed, &options)?;
    if let Some(note) = report.coordinates_note() {
        context.note(format!("{}: {note}", args.coarse.display()));
    }
    {
        let _deferral = context.defer_interrupt();
        saved(&image, depth, ColorSpace::Linear, &args.output)?;
    }
    let [width, height] = args.size;
    let info = NormalsInfo {
        output: (&args.output).into(),
        width,
        height,
        cage: report.cage,
        missed_share: report.missed as f64 / report.points.max(1) as f64,
        shared_share: report.shared_share,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let missed = match info.missed_share {
            0.0 => String::new(),
            share => format!("; {:.1} % of the points took the nearest point", 100.0 * share),
        };
        format!("{}: {width} x {height} texels{missed}, {:.1} s\n", info.output.display(), info.seconds)
    })
}
