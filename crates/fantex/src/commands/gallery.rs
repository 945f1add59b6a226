//! `fantex gallery`: a picture for every technique, and a page.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use crate::context::Context;
use crate::error::CliError;
use crate::gallery::{self, GalleryOptions};
use crate::size::counted;

/// Render one picture for every technique, and a page that explains them.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex gallery -o gallery-pictures
  fantex gallery -o some wood T5 L6

Open index.html in the folder with a browser. Names are those of entries (wood) or of rows of the feature list (T5).")]
pub(crate) struct GalleryArgs {
    /// Entries or rows; all where none is given
    names: Vec<String>,
    /// Folder for the pictures and the page
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Width of all pictures in pixels; as their looks say by default
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=8192))]
    width: Option<u32>,
}

#[derive(Debug, Serialize)]
struct GalleryInfo {
    page: PathBuf,
    pictures: Vec<PathBuf>,
    seconds: f64,
}

/// Runs the command.
pub(crate) fn run(args: &GalleryArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    let pictures = gallery::make(&args.output, &args.names, GalleryOptions { width: args.width }, context)?;
    let info = GalleryInfo {
        page: args.output.join("index.html"),
        pictures,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let pictures = counted(info.pictures.len() as u64, "picture");
        format!("{pictures} in {:.1} s: {}", info.seconds, info.page.display())
    })
}
