//! `fantex simplify`: a model with fewer triangles, to bake the fine one onto.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use fantex::Result;
use fantex::base::{are, were};
use fantex::glam::DVec3;
use fantex::mesh::{WriteGeometry, write_model};
use serde::Serialize;

use crate::context::Context;
use crate::scene::{ReadArgs, check_model_name, open_shape, show_notes};
use crate::text::{Count, ShownPath, counted, grouped};

/// Write a model with the same shape and fewer triangles, to bake the fine one onto.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex simplify scan.ply -o coarse.ply --triangles 20k
  fantex bake coarse.ply -o coarse.fan --source mesh=scan.ply --texels 16M
  fantex simplify scan.fan -o coarse.ply --triangles 20k
  fantex bake coarse.ply -o coarse.fan --source mesh=scan.fan --texels 16M

Edges collapse in the order of the error that this leaves. Where that is not enough, as with many loose pieces, vertices are united in \
the cells of a grid. Positions and triangles are written, no texture coordinates and no materials: 'fantex bake' needs none.")]
pub(crate) struct SimplifyArgs {
    /// A model (.glb .gltf .obj .ply .stl), or an asset (.fan), of which the mesh is taken
    model: PathBuf,
    /// The file to write (.ply .obj .glb)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Triangles, about
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    triangles: Count,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, Serialize)]
struct SimplifyInfo {
    output: ShownPath,
    triangles: u64,
    vertices: u64,
    /// Of the model.
    triangles_before: u64,
    seconds: f64,
}

/// Any shape may keep so many triangles.
const MIN_LEFT: u64 = 64;

pub(crate) fn run(args: &SimplifyArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    check_model_name(&args.output)?;
    context.check_output_of(&args.output, &args.model)?;
    let fine = open_shape(&args.model, args.read, context)?;
    show_notes(&fine, context);
    let coarse = fine.simplified(usize::try_from(args.triangles.0).unwrap_or(usize::MAX))?;
    let positions: Vec<DVec3> = coarse.positions.iter().map(|&p| coarse.world_from_mesh.point(p)).collect();
    let geometry = WriteGeometry { positions: &positions, triangles: &coarse.triangles, colors: None };
    {
        let _deferral = context.defer_interrupt();
        write_model(&args.output, &geometry, context.force)?;
    }
    let (left, asked) = (coarse.triangles.len() as u64, args.triangles.0);
    if left > asked.saturating_add(asked / 10).max(MIN_LEFT) && asked < fine.triangles.len() as u64 {
        let (left, is_left) = (counted(left, "triangle"), are(left));
        let (asked, was_asked) = (grouped(asked), were(asked));
        context.note(format!(
            "{left} {is_left} left where {asked} {was_asked} asked for; this shape cannot be made simpler"
        ));
    }
    let info = SimplifyInfo {
        output: (&args.output).into(),
        triangles: coarse.triangles.len() as u64,
        vertices: coarse.positions.len() as u64,
        triangles_before: fine.triangles.len() as u64,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let (before, after) = (counted(info.triangles_before, "triangle"), grouped(info.triangles));
        format!("{}: {after} of {before}, {:.1} s\n", info.output.display(), info.seconds)
    })
}
