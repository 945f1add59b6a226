//! `fantex table`: a texture becomes a file of numbers.

use std::path::PathBuf;

use clap::Args;
use fantex::glam::{DVec3, Vec4};
use fantex::look::LookFile;
use fantex::texture::{ColorSpace, Image};
use fantex::{Error, LookTable, Result, look_texture};
use serde::Serialize;

use crate::commands::image::{DEPTHS, FileDepth, SPACES, depth_of, saved};
use crate::context::Context;
use crate::scene::{check_picture_name, finite, size, vector};
use crate::series::Series;
use crate::text::{ShownPath, one_of};

/// Tabulate a texture of a look: any function, over any domain, at any density, as an image.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex table marble.toml -o marble.png --size 1024x1024
  fantex table noise.toml --texture veins -o slice.exr --depth float --from -2,1,0 --to 2,-1,0 --size 2048x1024
  fantex table ramp.toml --texture scale -o scale.png --size 256x1
  fantex table clouds.toml -o slices --size 128x128 --slices 128 --from -1,1,-1 --to 1,-1,1

The domain is a rectangle of object space: columns go from the x of --from to that of --to, rows from y to y, slices from z to z. Texture \
coordinates go from 0 to 1 over it, so that images are seen whole. It is the front of a cube of edge 1 where it is left out: -0.5,0.5,0 to \
0.5,-0.5,0, the first row on top. A texel is the texture's mean over it; --samples takes more means of smaller parts. In an .exr, colours \
are multiplied by alpha, as that format has them.

With --slices the output is a folder of pictures, slice-0001.png and so on, the lowest z first where z grows: what 'slices' of a look's \
'volume' reads.")]
pub(crate) struct TableArgs {
    /// The look (.toml)
    look: PathBuf,
    /// The picture to write, or the folder for --slices
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The texture's name; the only one where it is left out
    #[arg(long, value_name = "NAME")]
    texture: Option<String>,
    /// Columns and rows
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = size)]
    size: [u32; 2],
    /// Pictures along z
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=16_384))]
    slices: Option<u32>,
    /// Upper left corner of the domain
    #[arg(long, value_name = "X,Y,Z", default_value = "-0.5,0.5,0", value_parser = vector, allow_hyphen_values = true)]
    from: DVec3,
    /// Lower right corner of the domain
    #[arg(long, value_name = "X,Y,Z", default_value = "0.5,-0.5,0", value_parser = vector, allow_hyphen_values = true)]
    to: DVec3,
    /// Samples per texel along each axis
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    samples: u32,
    /// Seconds since the start of an animation
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value_t = 0.0, value_parser = finite)]
    time: f32,
    /// Numbers of the file [default: float for .exr and .hdr, else 8]
    #[arg(long, value_parser = one_of(&DEPTHS))]
    depth: Option<FileDepth>,
    /// How they are written: colours as sRGB, heights and other numbers linear [default: srgb; floating-point numbers are linear]
    #[arg(long, value_parser = one_of(&SPACES))]
    color_space: Option<ColorSpace>,
}

#[derive(Debug, Serialize)]
struct TableInfo {
    output: ShownPath,
    texture: String,
    width: u32,
    height: u32,
    slices: u32,
    /// Smallest and largest linear red, green, blue and alpha.
    min: [f32; 4],
    max: [f32; 4],
}

pub(crate) fn run(args: &TableArgs, context: &Context) -> Result<()> {
    let depth = depth_of(args.depth, FileDepth::Eight, &args.output)?;
    if depth == FileDepth::Float && args.color_space == Some(ColorSpace::Srgb) {
        return Err(Error::invalid("floating-point numbers are always linear; leave --color-space srgb out"));
    }
    let file = LookFile::read(&args.look)?;
    let (name, texture) = look_texture(&file, args.texture.as_deref(), context.resolve_options())?;
    let [width, height] = args.size;
    let slices = args.slices.unwrap_or(1);
    let slice_series = |count: u32| Series::all_or_none(context, &args.output, "slice", u64::from(count));
    let mut series = args.slices.map(slice_series);
    if series.is_some() {
        context.make_folder(&args.output)?;
    }
    let paths: Vec<PathBuf> = match args.slices {
        None => vec![args.output.clone()],
        Some(count) => {
            let extension = if depth == FileDepth::Float { "exr" } else { "png" };
            (1..=count).map(|i| args.output.join(format!("slice-{i:04}.{extension}"))).collect()
        }
    };
    if ![args.from, args.to].iter().all(|corner| corner.as_vec3().is_finite()) {
        return Err(Error::invalid("--from and --to must lie within 3e38, where textures are evaluated"));
    }
    paths.iter().try_for_each(|path| context.check_output_of(path, &args.look))?;
    if args.slices.is_none() {
        check_picture_name(&args.output, false)?;
    }
    let (mut min, mut max) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
    let table = LookTable {
        size: [width, height, slices],
        from: args.from,
        to: args.to,
        samples: args.samples,
        time: args.time,
        memory_bytes: context.memory_bytes,
    };
    for (slice, path) in (0..).zip(&paths) {
        context.check_interrupt()?;
        let texels = table.slice(texture.as_ref(), slice)?;
        for texel in &texels {
            (min, max) = (min.min(Vec4::from_array(*texel)), max.max(Vec4::from_array(*texel)));
        }
        let is_opaque = texels.iter().all(|texel| texel[3] == 1.0);
        let image = match is_opaque {
            true => Image::from_linear_rgb(width, height, &texels),
            false => Image::from_linear_rgba(width, height, &texels),
        };
        let save = || saved(&image, depth, args.color_space.unwrap_or(ColorSpace::Srgb), path);
        series.as_mut().map_or_else(save, |series| series.write(path, save))?;
    }
    if let Some(series) = series {
        series.finish();
    }
    let info = TableInfo {
        output: (&args.output).into(),
        texture: name,
        width,
        height,
        slices,
        min: min.to_array(),
        max: max.to_array(),
    };
    context.print(&info, |info| table_text(info, args.slices.is_some()))
}

fn table_text(info: &TableInfo, has_slices: bool) -> String {
    let slices = if has_slices { format!(" x {}", info.slices) } else { String::new() };
    let ([r0, g0, b0, a0], [r1, g1, b1, a1]) = (info.min, info.max);
    format!(
        "{}: {} x {}{slices} texels of {}; red {r0:.3} to {r1:.3}, green {g0:.3} to {g1:.3}, blue {b0:.3} to {b1:.3}, alpha {a0:.3} \
         to {a1:.3}\n",
        info.output.display(),
        info.width,
        info.height,
        info.texture
    )
}
