//! `fantex image`: images made fit for use as textures.

use std::path::{Path, PathBuf};

use clap::Args;
use fantex::base::input;
use fantex::texture::look::{DerivativeTexture, Difference};
use fantex::texture::{AlphaUse, ColorSpace, Depth, Image, Wrap};
use fantex::{Error, Result};
use serde::Serialize;

use crate::commands::export::has_extension;
use crate::context::Context;
use crate::scene::{check_picture_name, size};
use crate::text::{Choices, ShownPath, one_of, positive};

/// Prepare an image: sides that are powers of two, other sizes, height with derivatives for bump mapping.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex image photo.jpg -o photo-pot.png --power-of-two
  fantex image photo.jpg -o small.png --size 320x200
  fantex image height.png -o slopes.png --derivatives

A smaller size takes the exact mean over each new texel, a larger one a cubic, both in linear light. --power-of-two takes the nearest power of two along each \
side.

--derivatives writes the height (red) with its derivatives by u (green) and by v (blue, downwards), 0.5 + 0.5 d / range, in 16 bits. The \
range that it prints is the key 'range' of a look's 'derivatives'; 'height' is that of a bump map of the same image.")]
pub(crate) struct ImageArgs {
    /// The image
    image: PathBuf,
    /// The image to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Scale each side to the nearest power of two
    #[arg(long, conflicts_with = "size")]
    power_of_two: bool,
    /// Scale to this width and height
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Height and both derivatives of the image's red
    #[arg(long)]
    derivatives: bool,
    /// Which differences stand for the derivatives
    #[arg(long, value_parser = one_of(&DIFFERENCES), default_value = "central", requires = "derivatives")]
    difference: Difference,
    /// What lies outside the image
    #[arg(long, value_parser = one_of(&WRAPS), default_value = "repeat", requires = "derivatives")]
    wrap: Wrap,
    /// The largest derivative that the code holds; the largest that there is where it is left out
    #[arg(long, value_name = "NUMBER", value_parser = positive, allow_negative_numbers = true, requires = "derivatives")]
    range: Option<f64>,
    /// What the image's numbers mean; heights are linear
    #[arg(long, value_parser = one_of(&SPACES))]
    color_space: Option<ColorSpace>,
    /// Numbers of the file [default: float for .exr and .hdr, 16 for derivatives, else those of the image]
    #[arg(long, value_parser = one_of(&DEPTHS))]
    depth: Option<FileDepth>,
}

/// Numbers of a picture's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileDepth {
    Eight,
    Sixteen,
    Float,
}

impl FileDepth {
    /// The numbers of such a file of pictures in `space`; floating-point numbers are linear.
    fn numbers(self, space: ColorSpace) -> (Depth, ColorSpace) {
        match self {
            Self::Eight => (Depth::U8, space),
            Self::Sixteen => (Depth::U16, space),
            Self::Float => (Depth::F32, ColorSpace::Linear),
        }
    }
}

pub(crate) const DEPTHS: Choices<FileDepth, 3> = [
    ("8", "Eight bits", FileDepth::Eight),
    ("16", "Sixteen bits", FileDepth::Sixteen),
    ("float", "Floating-point numbers, linear (.exr, .hdr)", FileDepth::Float),
];

pub(crate) const SPACES: Choices<ColorSpace, 2> = [
    ("srgb", "Colours as screens show them", ColorSpace::Srgb),
    ("linear", "Numbers as they are", ColorSpace::Linear),
];

pub(crate) const WRAPS: Choices<Wrap, 4> = [
    ("repeat", "The image again", Wrap::Repeat),
    ("mirror", "The image mirrored", Wrap::Mirror),
    ("clamp", "Its outermost texels", Wrap::Clamp),
    ("border", "Nothing", Wrap::Border),
];

const DIFFERENCES: Choices<Difference, 3> = [
    ("forward", "To the next texel", Difference::Forward),
    ("backward", "From the texel before", Difference::Backward),
    ("central", "From the texel before to the next", Difference::Central),
];

/// The numbers of a file: those that are asked for, else floats where its format holds nothing else, else `otherwise`.
///
/// # Errors
/// The file's format does not have those that are asked for.
pub(crate) fn depth_of(asked: Option<FileDepth>, otherwise: FileDepth, path: &Path) -> Result<FileDepth> {
    let is_any = |extensions: &[&str]| extensions.iter().any(|extension| has_extension(path, extension));
    let holds_floats = is_any(&["exr", "hdr"]);
    let sentence = match asked {
        None if holds_floats => return Ok(FileDepth::Float),
        None => return Ok(otherwise),
        Some(FileDepth::Sixteen | FileDepth::Float) if is_any(&["jpg", "jpeg", "webp"]) => {
            "holds eight bits per number; leave --depth out, or write a .png"
        }
        Some(FileDepth::Float) if is_any(&["png"]) => {
            "holds no floating-point numbers; write an .exr or .hdr, or give --depth 16"
        }
        Some(FileDepth::Eight | FileDepth::Sixteen) if holds_floats => {
            "holds floating-point numbers; leave --depth out, or write a .png"
        }
        Some(depth) => return Ok(depth),
    };
    Err(Error::invalid(format!("{} {sentence}", path.display())))
}

/// Writes an image.
pub(crate) fn saved(image: &Image, depth: FileDepth, space: ColorSpace, path: &Path) -> Result<()> {
    let (depth, space) = depth.numbers(space);
    image.converted(depth, space).save(path)
}

/// The power of two nearest in ratio: 1000 becomes 1024, 720 becomes 512, 725 becomes 1024.
fn nearest_power_of_two(n: u32) -> u32 {
    let lower = 1_u64 << n.max(1).ilog2();
    let power = if u64::from(n) * u64::from(n) < 2 * lower * lower { lower } else { 2 * lower };
    u32::try_from(power).unwrap_or(1 << 31)
}

#[derive(Debug, Serialize)]
struct ImageInfo {
    output: ShownPath,
    width: u32,
    height: u32,
    /// Of derivatives: the largest that the code holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<f32>,
}

pub(crate) fn run(args: &ImageArgs, context: &Context) -> Result<()> {
    if !args.power_of_two && args.size.is_none() && !args.derivatives {
        return Err(Error::invalid("say what to do: --power-of-two, --size WxH or --derivatives"));
    }
    // Refused before the image is read.
    depth_of(args.depth, FileDepth::Eight, &args.output)?;
    let default_space = if args.derivatives { ColorSpace::Linear } else { ColorSpace::Srgb };
    let space = args.color_space.unwrap_or(default_space);
    let image = Image::load_as(&args.image, space)?;
    let space = if image.samples.depth() == Depth::F32 { ColorSpace::Linear } else { space };
    let image = Image { space, ..image };
    context.check_output_of(&args.output, &args.image)?;
    check_picture_name(&args.output, image.has_alpha())?;
    let own = match image.samples.depth() {
        Depth::U8 => FileDepth::Eight,
        Depth::U16 => FileDepth::Sixteen,
        Depth::F32 => FileDepth::Float,
    };
    let otherwise = if args.derivatives { FileDepth::Sixteen } else { own };
    let depth = depth_of(args.depth, otherwise, &args.output)?;
    let to_power = args.power_of_two.then(|| [image.width, image.height].map(nearest_power_of_two));
    let scaled = match args.size.or(to_power) {
        Some([width, height]) => {
            // Columns are scaled first, as four floats; then rows, as floats.
            let texels = u64::from(width) * (4 * u64::from(image.height) + 4 * u64::from(height));
            let what = format!("scaling to {width} x {height} texels");
            let _held = input::reserve(what, texels.saturating_mul(size_of::<f32>() as u64))?;
            // Rounded once, to the numbers of the file; heights not at all, as their differences are small.
            let depth = if args.derivatives { FileDepth::Float } else { depth };
            let (depth, space) = depth.numbers(space);
            image.resized_as([width, height], AlphaUse::Coverage, depth, space)
        }
        None => image,
    };
    let mut info =
        ImageInfo { output: (&args.output).into(), width: scaled.width, height: scaled.height, range: None };
    if args.derivatives {
        let range = args.range.map(|range| range as f32);
        let texture = DerivativeTexture::new(&scaled, args.difference, [args.wrap; 2], range)?;
        info.range = Some(texture.range);
        saved(&texture.image, depth, ColorSpace::Linear, &args.output)?;
    } else {
        saved(&scaled, depth, space, &args.output)?;
    }
    context.print(&info, |info| {
        let range = info.range.map_or(String::new(), |range| format!(", derivatives up to {range}"));
        format!("{}: {} x {} texels{range}\n", info.output.display(), info.width, info.height)
    })
}
