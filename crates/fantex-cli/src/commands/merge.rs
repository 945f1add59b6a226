//! `fantex merge`: the parts of a planned bake become one asset.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use fantex::base::are;
use fantex::{Merge, Result};
use serde::Serialize;

use super::plan::{of_files, open_plan};
use crate::context::Context;
use crate::scene::check_asset_name;
use crate::text::{ShownPath, counted, megabytes};

/// Merge the parts of a planned bake into one asset.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex merge world.plan 1.part 2.part 3.part -o world.fan
  fantex merge world.plan *.part --check
  fantex merge s3://farm/world.plan s3://farm/1.part s3://farm/2.part -o s3://farm/world.fan

Parts may come in any order. What is missing, damaged, there twice or of another plan is named, and nothing is written. Where parts and asset lie \
in one object store that copies ranges of objects, it copies most texels itself; then --check alone reads all of them.")]
pub(crate) struct MergeArgs {
    /// The plan, also at an https://, s3://, gs:// or az:// address
    plan: PathBuf,
    /// All its parts, also at addresses
    #[arg(required = true)]
    parts: Vec<PathBuf>,
    /// The asset to write, also at an s3://, gs:// or az:// address
    #[arg(short, long, value_name = "ASSET", required_unless_present = "check")]
    output: Option<PathBuf>,
    /// Only look whether all is there and whole
    #[arg(long, conflicts_with = "output")]
    check: bool,
}

#[derive(Debug, Serialize)]
struct MergeInfo {
    /// None where the parts were only looked at.
    output: Option<ShownPath>,
    parts: u64,
    clusters: u64,
    bytes: u64,
    /// Of these, what an object store has copied.
    copied_bytes: u64,
    seconds: f64,
}

pub(crate) fn run(args: &MergeArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let inputs = || args.parts.iter().chain([&args.plan]).map(PathBuf::as_path);
    if let Some(output) = args.output.as_ref().filter(|output| !inputs().any(|input| input == **output)) {
        check_asset_name(output, "")?;
    }
    let plan = open_plan(&args.plan)?;
    if let Some(output) = &args.output {
        let inputs = inputs();
        context.check_target_of(output, inputs)?;
    }
    let job = Merge { plan: &plan, parts: &args.parts, force: context.force };
    let merged = {
        let _deferral = context.defer_interrupt();
        match &args.output {
            Some(output) => {
                let [reading, copying, sending] =
                    ["merging", "copying", "uploading"].map(|label| context.step(label, "MB"));
                job.write(output, [&reading, &copying, &sending])
            }
            None => job.check(&context.progress_of_bytes("checking")),
        }
        .map_err(of_files)?
    };
    merged.note.iter().for_each(|note| context.note(note));
    let info = MergeInfo {
        output: args.output.as_ref().map(ShownPath::from),
        parts: args.parts.len() as u64,
        clusters: merged.written.clusters as u64,
        bytes: merged.written.bytes,
        copied_bytes: merged.copied_bytes,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let parts = counted(info.parts, "part");
        let Some(output) = &info.output else {
            return format!("{parts} {} there and whole", are(info.parts));
        };
        let copied = match info.copied_bytes {
            0 => String::new(),
            bytes => format!(", {} of it copied by the store", megabytes(bytes)),
        };
        let (output, bytes) = (output.display(), megabytes(info.bytes));
        format!("{output}: {bytes} of {parts} in {:.1} s{copied}", info.seconds)
    })
}
