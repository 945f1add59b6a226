//! `fantex preview`: what viewers far away show first.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use fantex::addresses::is_object;
use fantex::{ErrorKind, Preview, PreviewOptions, Progress, Result};
use serde::Serialize;

use crate::context::Context;
use crate::scene::{check_is_asset_file, report_damage};
use crate::text::{Count, ShownPath, counted, megabytes};

/// Give an asset a preview: a small asset inside it, which viewers far away show until the rest is there.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex preview scan.fan
  fantex preview world.fan --triangles 20k --texels 1M
  fantex preview scan.fan --remove

A preview is a coarse mesh with the look and the normals of the fine one, in some hundred kilobytes: a viewer in a browser shows it \
after a fraction of a second, whatever the size of the asset, and exchanges it for the asset itself as soon as that is there. \
'fantex export --web' gives one to large assets. A small asset whose mesh can hardly be simplified gets one only if --triangles or --texels \
is given. What is painted later is not in it; call the command again.")]
pub(crate) struct PreviewArgs {
    /// The asset, which is changed in place; one at an s3://, gs:// or az:// address is fetched, changed here, and put back whole
    asset: PathBuf,
    /// Triangles of the coarse mesh, about; 5k by default
    #[arg(long, value_name = "N", allow_negative_numbers = true, conflicts_with = "remove")]
    triangles: Option<Count>,
    /// Stored texels of the finest level; by default 100k, or a quarter of the asset's where that is less
    #[arg(long, value_name = "N", allow_negative_numbers = true, conflicts_with = "remove")]
    texels: Option<Count>,
    /// Leave open borders as they are, so that previews of assets that meet there fit together; there may be more triangles for it
    #[arg(long, conflicts_with = "remove")]
    keep_borders: bool,
    /// Take the preview out
    #[arg(long)]
    remove: bool,
}

#[derive(Debug, Serialize)]
struct PreviewInfo {
    asset: ShownPath,
    /// Of the preview; 0 where none is made.
    triangles: u64,
    texels: u64,
    bytes: u64,
    seconds: f64,
}

pub(crate) fn run(args: &PreviewArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let mut info =
        PreviewInfo { asset: (&args.asset).into(), triangles: 0, texels: 0, bytes: 0, seconds: 0.0 };
    check_is_asset_file(&args.asset)?;
    // A file keeps its state when the program ends; of an object, a copy would be left.
    let _deferral = is_object(&args.asset).then(|| context.defer_interrupt());
    let [fetching, sending] = &context.transfers();
    let transfers: [&dyn Progress; 2] = [fetching, sending];
    if args.remove {
        let was_there = Preview::remove_at(&args.asset, transfers)?;
        info.seconds = started.elapsed().as_secs_f64();
        return context.print(&info, |info| match was_there {
            true => format!("{}: the preview is gone\n", info.asset.display()),
            false => format!("{}: there was no preview\n", info.asset.display()),
        });
    }
    let defaults = PreviewOptions::default();
    let options = PreviewOptions {
        triangles: args.triangles.map_or(defaults.triangles, |n| n.0 as usize),
        texels: args.texels.map(|n| n.0),
        keeps_borders: args.keep_borders,
        memory_bytes: context.memory_bytes,
        strict: context.strict,
    };
    let is_size_given = args.triangles.is_some() || args.texels.is_some();
    let added = match is_size_given {
        true => Preview::add_at(&args.asset, &options, transfers).map(Some),
        false => Preview::add_at_if_smaller(&args.asset, &options, transfers),
    };
    let added = added.map_err(|error| match error.kind() {
        ErrorKind::Damaged => error.in_file(&args.asset),
        _ => error,
    })?;
    let Some(preview) = added else {
        info.seconds = started.elapsed().as_secs_f64();
        return context.print(&info, |info| {
            format!(
                "{}: a preview is left out, as its mesh can hardly be simplified; --triangles or --texels gives one of that size\n",
                info.asset.display()
            )
        });
    };
    report_damage(&args.asset, &preview.damage, context)?;
    (info.triangles, info.texels, info.bytes) =
        (preview.triangles, preview.texels, preview.bytes.len() as u64);
    info.seconds = started.elapsed().as_secs_f64();
    context.print(&info, |info| {
        format!(
            "{}: a preview of {} and {}, {}, {:.1} s\n",
            info.asset.display(),
            counted(info.triangles, "triangle"),
            counted(info.texels, "texel"),
            megabytes(info.bytes),
            info.seconds
        )
    })
}
