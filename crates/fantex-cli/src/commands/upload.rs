//! `fantex upload`: a finished file goes to an object store.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use fantex::{Result, Upload};
use serde::Serialize;

use crate::context::Context;
use crate::text::{ShownPath, counted, megabytes};

/// Send a finished file, or a world with its assets, to an object store.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex upload land.fan -o s3://scans/land.fan
  fantex upload land/land.fanworld -o s3://scans/land/land.fanworld

The object is there as a whole or not at all, and nothing is overwritten without --force. Of a world that 'fantex split' has made the index is sent with \
the assets beside it, and takes the place of one that is there at once. What other commands have finished and could not send they keep, \
and say how this one sends it. See docs/farms.md.")]
pub(crate) struct UploadArgs {
    /// An asset (.fan), a plan, a part, or the index of a world (.fanworld)
    file: PathBuf,
    /// The object, at an s3://, gs:// or az:// address
    #[arg(short, long, value_name = "ADDRESS")]
    output: PathBuf,
}

#[derive(Debug, Serialize)]
struct UploadInfo {
    output: ShownPath,
    /// More than one of a world.
    objects: u64,
    bytes: u64,
    notes: Vec<String>,
    seconds: f64,
}

pub(crate) fn run(args: &UploadArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let upload = Upload { file: &args.file, place: &args.output, force: context.force };
    let sent = {
        let _deferral = context.defer_interrupt();
        upload.run(&context.step("uploading", "MB"))?
    };
    sent.notes.iter().for_each(|note| context.note(note));
    let info = UploadInfo {
        output: (&args.output).into(),
        objects: sent.objects,
        bytes: sent.bytes,
        notes: sent.notes,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let (output, objects) = (info.output.display(), counted(info.objects, "object"));
        format!("{output}: {objects}, {} in {:.1} s", megabytes(info.bytes), info.seconds)
    })
}
