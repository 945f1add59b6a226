//! `fantex warp`: an image through a map of the plane.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use fantex::base::are;
use fantex::glam::DVec2;
use fantex::texture::warp::{
    AffineMap, BilinearMap, PlaneMap, ProjectiveMap, Spread, warp_forward, warp_inverse,
};
use fantex::texture::{ColorSpace, Filter, Image, ImageTexture, SampleOptions, Wrap};
use fantex::{Error, Result};
use serde::Serialize;

use crate::commands::image::{DEPTHS, FileDepth, WRAPS, depth_of, saved};
use crate::context::Context;
use crate::scene::{FILTERS, check_picture_name, size};
use crate::text::{Choices, ShownPath, one_of};

/// Warp an image: affine, perspective or bilinear, by inverse or forward mapping.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex warp brick.png -o floor.png --map perspective --corners 200,40 440,40 640,360 0,360 --size 640x360
  fantex warp brick.png -o turned.png --map affine --corners 100,0 300,100 0,200 --size 300x300
  fantex warp brick.png -o bent.png --map bilinear --corners 0,0 400,80 300,400 60,300 --size 400x400 --way forward

The corners are pixels of the new picture, x to the right and y downwards, to which the image's corners go: the upper left, the upper right, \
the lower right, the lower left. An affine map takes three: the upper left, the upper right, the lower left. They may lie \
outside of the picture.

Inverse mapping goes through the picture's pixels and looks each one up in the image, filtered over the pixel's pre-image. Forward \
mapping goes through the image's texels and spreads each one over the pixels that it covers (--spread area), or over the four around \
its centre (--spread bilinear), which leaves holes where the map magnifies. What the image does not reach is transparent.")]
pub(crate) struct WarpArgs {
    /// The image
    image: PathBuf,
    /// The picture to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Which map
    #[arg(long, value_parser = one_of(&MAPS))]
    map: Map,
    /// Where the image's corners go, in pixels: four, or three for an affine map
    #[arg(long, value_name = "X,Y X,Y X,Y X,Y", value_parser = corners)]
    corners: Corners,
    /// Width and height of the picture in pixels; those of the image where it is left out
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// In which direction
    #[arg(long, value_parser = one_of(&WAYS), default_value = "inverse")]
    way: Way,
    #[arg(long, value_parser = one_of(&SPREADS), help = "How a texel is spread by forward mapping [default: area]")]
    spread: Option<Spread>,
    #[arg(long, value_parser = one_of(&FILTERS), help = "How the image is filtered by inverse mapping [default: ewa]")]
    filter: Option<Filter>,
    #[arg(
        long,
        value_parser = one_of(&WRAPS),
        help = "What lies outside the image, by inverse affine and perspective mapping [default: border]"
    )]
    wrap: Option<Wrap>,
    /// Numbers of the file [default: float for .exr and .hdr, else 8]
    #[arg(long, value_parser = one_of(&DEPTHS))]
    depth: Option<FileDepth>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Map {
    Affine,
    Perspective,
    Bilinear,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Inverse,
    Forward,
}

const MAPS: Choices<Map, 3> = [
    ("affine", "Parallels stay parallel", Map::Affine),
    ("perspective", "Straight lines stay straight", Map::Perspective),
    ("bilinear", "Lines along the sides stay straight and evenly divided; others bend", Map::Bilinear),
];

const WAYS: Choices<Way, 2> = [
    ("inverse", "Each pixel is looked up in the image", Way::Inverse),
    ("forward", "Each texel is spread over the picture", Way::Forward),
];

const SPREADS: Choices<Spread, 2> = [
    ("area", "Over all pixels that its square covers, by area", Spread::Area),
    ("bilinear", "Over the four pixels around its centre", Spread::Bilinear),
];

/// A pixel, `X,Y`.
fn point(text: &str) -> Option<DVec2> {
    let (x, y) = text.split_once(',')?;
    let point = DVec2::new(x.trim().parse().ok()?, y.trim().parse().ok()?);
    // As the map has it.
    point.as_vec2().is_finite().then_some(point)
}

/// Three or four pixels.
#[derive(Clone, Debug)]
struct Corners(Vec<DVec2>);

fn corners(text: &str) -> Result<Corners> {
    let corner = |(number, text): (u32, &str)| {
        let sentence = || format!("corner {number} is '{text}', and a pixel such as 120,40 is expected");
        point(text).ok_or_else(|| Error::invalid(sentence()))
    };
    let corners: Vec<DVec2> = (1..).zip(text.split_whitespace()).map(corner).collect::<Result<_>>()?;
    match corners.len() {
        3 | 4 => Ok(Corners(corners)),
        _ => Err(Error::invalid("expected three or four pixels such as 0,0 120,0 0,40")),
    }
}

/// Makes one argument of `--corners` and the pixels after it. As arguments of their own they could not have a hyphen before them, unless options
/// after three of them were taken for the fourth.
pub(crate) fn join_corners(arguments: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut arguments = arguments.peekable();
    let mut joined = Vec::new();
    while let Some(mut argument) = arguments.next() {
        if argument == "--corners" {
            let (mut count, mut separator) = (0, "=");
            while count < 4
                && let Some(corner) = arguments.next_if(|next| is_corner(next, count))
            {
                count += corner.to_string_lossy().split_whitespace().count();
                argument.push(separator);
                argument.push(corner);
                separator = " ";
            }
        }
        joined.push(argument);
    }
    joined
}

/// Whether an argument is meant as a corner that comes after so many: fewer than three never are all, and after three the image may come. So
/// that a wrong one is named, it need not be right.
fn is_corner(argument: &OsStr, count: usize) -> bool {
    let Some(text) = argument.to_str() else { return false };
    let begins_number = |rest: &str| rest.starts_with(|c: char| c.is_ascii_digit() || c == '.');
    let is_option = text.strip_prefix('-').is_some_and(|rest| !begins_number(rest));
    let has_number = || text.split([',', ';']).any(|part| part.trim().parse::<f64>().is_ok());
    !is_option && (count < 3 || point(text).is_some() || has_number() && !Path::new(text).exists())
}

#[derive(Debug, Serialize)]
struct WarpInfo {
    output: ShownPath,
    width: u32,
    height: u32,
    /// Share of the picture that the image covers.
    covered_share: f64,
}

/// In perspective, a rectangle is seen whole as a quadrilateral that is convex; of others a part lies behind the eye.
fn check_is_convex(corners: [DVec2; 4]) -> Result<()> {
    let turn = |k: usize| {
        let [a, b, c] = [k, k + 1, k + 2].map(|k| corners[k % 4]);
        (b - a).perp_dot(c - b)
    };
    let turns = [turn(0), turn(1), turn(2), turn(3)];
    match turns.iter().all(|turn| *turn > 0.0) || turns.iter().all(|turn| *turn < 0.0) {
        true => Ok(()),
        false => Err(Error::invalid(
            "the corners of a perspective map go round a convex quadrilateral: upper left, upper right, lower right, lower left; \
             these cross or have a dent",
        )),
    }
}

/// Options that the direction and the map do not ask for.
fn check_is_used(args: &WarpArgs) -> Result<()> {
    let refused = match args.way {
        Way::Forward if args.filter.is_some() => "--filter belongs to inverse mapping",
        Way::Forward if args.wrap.is_some() => "--wrap belongs to inverse mapping",
        Way::Inverse if args.spread.is_some() => "--spread belongs to forward mapping",
        _ if args.map == Map::Bilinear && args.wrap.is_some() => {
            "--wrap belongs to affine and perspective maps"
        }
        _ => return Ok(()),
    };
    Err(Error::invalid(format!("{refused}; leave it out")))
}

pub(crate) fn run(args: &WarpArgs, context: &Context) -> Result<()> {
    check_is_used(args)?;
    let depth = depth_of(args.depth, FileDepth::Eight, &args.output)?;
    let image = Image::load_as(&args.image, ColorSpace::Srgb)?;
    context.check_output_of(&args.output, &args.image)?;
    check_picture_name(&args.output, true)?;
    let map: Box<dyn PlaneMap> = match (args.map, args.corners.0.as_slice()) {
        (Map::Affine, &[origin, u, v]) => {
            Box::new(AffineMap::from_points([DVec2::ZERO, DVec2::X, DVec2::Y], [origin, u, v])?)
        }
        (Map::Perspective, &[a, b, c, d]) => {
            let map = ProjectiveMap::from_quad([a, b, c, d])?;
            check_is_convex([a, b, c, d])?;
            Box::new(map)
        }
        (Map::Bilinear, &[a, b, c, d]) => Box::new(BilinearMap::from_quad([a, b, c, d])?),
        (map, corners) => {
            let needed = if map == Map::Affine { "three" } else { "four" };
            let (given, are) = (corners.len(), are(corners.len()));
            return Err(Error::invalid(format!("this map takes {needed} corners, and {given} {are} given")));
        }
    };
    let size = args.size.unwrap_or([image.width, image.height]);
    let warped = match args.way {
        Way::Forward => warp_forward(&image, map.as_ref(), size, args.spread.unwrap_or(Spread::Area))?,
        Way::Inverse => {
            let (wrap, filter) = (args.wrap.unwrap_or(Wrap::Border), args.filter.unwrap_or(Filter::Ewa));
            let options = SampleOptions { wrap: [wrap; 2], filter, ..SampleOptions::default() };
            warp_inverse(&ImageTexture::new(Arc::new(image)), map.as_ref(), size, &options)?
        }
    };
    let alphas = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
    let covered: f64 = alphas.map(|(x, y)| f64::from(warped.linear_texel(x, y)[3])).sum();
    saved(&warped, depth, ColorSpace::Srgb, &args.output)?;
    let info = WarpInfo {
        output: (&args.output).into(),
        width: size[0],
        height: size[1],
        covered_share: covered / (f64::from(size[0]) * f64::from(size[1])),
    };
    context.print(&info, |info| {
        let (output, percent) = (info.output.display(), 100.0 * info.covered_share);
        format!("{output}: {} x {} pixels, {percent:.0} % covered\n", info.width, info.height)
    })
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::{Cli, Command};

    /// The corners of a command line, as numbers.
    fn corners_of(line: &str) -> Result<Vec<[f64; 2]>, clap::Error> {
        let arguments = join_corners(line.split(' ').map(OsString::from));
        let Command::Warp(args) = Cli::try_parse_from(arguments)?.command else { panic!("another command") };
        Ok(args.corners.0.iter().map(|corner| corner.to_array()).collect())
    }

    #[test]
    fn what_follows_the_corners_is_none() {
        let three = vec![[100.0, 0.0], [300.0, 100.0], [0.0, 200.0]];
        for line in [
            "fantex warp a.png -o b.png --map affine --corners 100,0 300,100 0,200",
            "fantex warp a.png -o b.png --map affine --corners 100,0 300,100 0,200 --size 300x300",
            "fantex warp a.png -o b.png --map affine --corners 100,0 300,100 0,200 --force",
            "fantex warp -o b.png --map affine --corners 100,0 300,100 0,200 a.png",
        ] {
            assert_eq!(corners_of(line).unwrap(), three, "{line}");
        }
        let four = "fantex warp -o b.png --map bilinear --corners -10,-5 3,-.5 1e2,7 -1,-2 a.png -q";
        assert_eq!(corners_of(four).unwrap(), [[-10.0, -5.0], [3.0, -0.5], [100.0, 7.0], [-1.0, -2.0]]);
    }

    #[test]
    fn wrong_corners_are_refused() {
        let sentence = |corners: &str| {
            let line = format!("fantex warp a.png -o b.png --map affine --corners {corners}");
            corners_of(line.trim()).unwrap_err().to_string()
        };
        assert!(sentence("1,2 3,4").contains("three or four pixels"));
        assert!(sentence("x,y").contains("a pixel such as 120,40"));
        assert!(sentence("").contains("a value is required"));
        assert!(sentence("1,2 3,4 5,6 7,8 9,10").contains("unexpected argument '9,10'"));
        assert!(sentence("1,2 3;4 5,6 7,8").contains("corner 2 is '3;4'"));
        assert!(sentence("1,2 3,4 b.png").contains("corner 3 is 'b.png'"));
        assert!(sentence("1,2 3,4 5,6 7,8o").contains("corner 4 is '7,8o'"));
    }

    #[test]
    fn corners_may_be_one_argument() {
        let arguments = ["--corners", "0,0 1,0 0,1", "a.png"].map(OsString::from);
        assert_eq!(join_corners(arguments.into_iter()), ["--corners=0,0 1,0 0,1", "a.png"]);
    }
}
