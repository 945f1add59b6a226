//! `fantex paint`: strokes onto an asset.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use fantex::paint::{PaintOptions, Painter, StrokeFile, replay};
use serde::Serialize;

use super::view;
use crate::context::Context;
use crate::error::CliError;
use crate::input::open_asset;
use crate::size::{grouped, megabytes};

/// Paint on a model or an asset, in a window or by a file of strokes.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex paint statue.fan
  fantex paint bottle.glb
  fantex paint statue.fan --replay strokes.json -o painted.fan

Without --replay a window is opened. A model becomes an asset beside it first (bottle.fan), which is painted on; what is
painted is saved all the time, and every step can be undone.

With --replay strokes are applied without a window. Without -o the asset itself is changed, safely: it holds either all strokes or none. Every stroke can be undone.
Strokes are given by positions in the model's coordinates, so that a file fits any asset of the model.")]
pub(crate) struct PaintArgs {
    /// An asset (.fan); without --replay also a model (.glb .gltf .obj .ply .stl)
    asset: PathBuf,
    /// Strokes (.json) to apply
    #[arg(long, value_name = "STROKES")]
    replay: Option<PathBuf>,
    /// The asset to write; without it the given one is changed
    #[arg(short, long, value_name = "ASSET", requires = "replay")]
    output: Option<PathBuf>,
    /// Keep nothing that undoes the strokes
    #[arg(long, requires = "replay")]
    no_history: bool,
}

#[derive(Debug, Serialize)]
struct PaintInfo {
    output: PathBuf,
    strokes: usize,
    dabs: usize,
    pages: usize,
    missed_samples: usize,
    generation: u64,
    bytes: u64,
    seconds: f64,
}

/// Runs the command.
pub(crate) fn run(args: &PaintArgs, context: &Context) -> Result<(), CliError> {
    let started = Instant::now();
    let Some(strokes) = &args.replay else {
        return view::start(&["--paint".into(), args.asset.clone().into()]);
    };
    // Opening says what is wrong with files of other kinds.
    drop(open_asset(&args.asset)?);
    let file = StrokeFile::load(strokes)?;
    let folder = strokes.parent().unwrap_or(Path::new("."));
    let mut info = match &args.output {
        None => paint(&args.asset, &file, folder, args, context)?,
        Some(output) => {
            context.check_output(output)?;
            let copy = copy_beside(&args.asset, output)?;
            let info = paint(&copy, &file, folder, args, context)?;
            let renamed = if context.force { copy.persist(output) } else { copy.persist_noclobber(output) };
            renamed.map_err(|e| match e.error.kind() {
                io::ErrorKind::AlreadyExists => CliError::Exists { path: output.clone() },
                _ => CliError::Write { path: output.clone(), source: e.error },
            })?;
            PaintInfo { output: output.clone(), ..info }
        }
    };
    info.seconds = started.elapsed().as_secs_f64();
    context.print(&info, |info| {
        format!(
            "{}: {} strokes, {} dabs, {}, {:.1} s",
            info.output.display(),
            grouped(info.strokes as u64),
            grouped(info.dabs as u64),
            megabytes(info.bytes),
            info.seconds
        )
    })
}

fn paint(
    asset: &Path,
    file: &StrokeFile,
    folder: &Path,
    args: &PaintArgs,
    context: &Context,
) -> Result<PaintInfo, CliError> {
    let options = PaintOptions { memory_bytes: context.memory_bytes as usize, history: !args.no_history };
    let mut painter = Painter::open(asset, &options)?;
    let summary = replay(&mut painter, file, folder)?;
    let _deferral = context.defer_interrupt();
    let committed = painter.commit()?;
    Ok(PaintInfo {
        output: asset.to_owned(),
        strokes: summary.strokes,
        dabs: summary.dabs,
        pages: summary.pages,
        missed_samples: summary.missed_samples,
        generation: committed.generation,
        bytes: committed.file_bytes,
        seconds: 0.0,
    })
}

/// A copy in the folder of the output, which goes away unless it is renamed.
fn copy_beside(asset: &Path, output: &Path) -> Result<tempfile::TempPath, CliError> {
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let write = |source| CliError::Write { path: output.to_owned(), source };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".fantex-").suffix(".tmp");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut copy = builder.tempfile_in(folder).map_err(write)?;
    let mut from =
        std::fs::File::open(asset).map_err(|source| CliError::Read { path: asset.to_owned(), source })?;
    io::copy(&mut from, copy.as_file_mut()).map_err(write)?;
    Ok(copy.into_temp_path())
}
