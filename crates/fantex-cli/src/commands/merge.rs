//! `fantex merge`: the parts of a planned bake become one asset.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use fantex::store::{ByteSource, CreateOptions, PartRun, Plan, WriteSummary, merge_sources, merge_with_gaps};
use fantex::stream::{Assembled, SharedRun, open_source};
use fantex::{Error, Result};
use serde::Serialize;

use super::plan::{of_files, open_plan};
use crate::addresses::{Target, watched};
use crate::context::Context;
use crate::text::{counted, megabytes};

/// Merge the parts of a planned bake into one asset.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex merge world.plan 1.part 2.part 3.part -o world.fan
  fantex merge world.plan *.part --check
  fantex merge s3://farm/world.plan s3://farm/1.part s3://farm/2.part -o s3://farm/world.fan

Parts may come in any order. What is missing, damaged, there twice or of another plan is named, and nothing is written. Where parts and asset lie
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
    output: Option<PathBuf>,
    parts: u64,
    clusters: u64,
    bytes: u64,
    /// Of these, what an object store has copied.
    copied_bytes: u64,
    seconds: f64,
}

pub(crate) fn run(args: &MergeArgs, context: &Context) -> Result<()> {
    let started = Instant::now();
    let plan = open_plan(&args.plan)?;
    if let Some(output) = &args.output {
        let inputs = args.parts.iter().chain([&args.plan]).map(PathBuf::as_path);
        context.check_target_of(output, inputs)?;
    }
    let options = CreateOptions { force: context.force, ..CreateOptions::default() };
    let job = Job { plan: &plan, parts: &args.parts, options, context };
    let (written, copied_bytes) = {
        let _deferral = context.defer_interrupt();
        match args.output.as_deref().map(Target::new).transpose()? {
            Some(target) => job.write(target)?,
            None => (job.merge(None)?, 0),
        }
    };
    let info = MergeInfo {
        output: args.output.clone(),
        parts: args.parts.len() as u64,
        clusters: written.clusters as u64,
        bytes: written.bytes,
        copied_bytes,
        seconds: started.elapsed().as_secs_f64(),
    };
    context.print(&info, |info| {
        let parts = counted(info.parts, "part");
        let Some(output) = &info.output else { return format!("{parts} are all there and whole") };
        let copied = match info.copied_bytes {
            0 => String::new(),
            bytes => format!(", {} of it copied by the store", megabytes(bytes)),
        };
        let (output, bytes) = (output.display(), megabytes(info.bytes));
        format!("{output}: {bytes} of {parts} in {:.1} s{copied}", info.seconds)
    })
}

/// A merge.
struct Job<'a> {
    plan: &'a Plan,
    parts: &'a [PathBuf],
    options: CreateOptions,
    context: &'a Context,
}

impl Job<'_> {
    /// Writes the asset. Gives how many of its bytes a store has copied, too.
    fn write(&self, target: Target<'_>) -> Result<(WriteSummary, u64)> {
        if let Some(made) = self.merge_in_store(&target)? {
            return Ok(made);
        }
        let written = self.merge(Some(target.file()))?;
        target.finish(&self.context.replace(), self.context)?;
        Ok((written, 0))
    }

    /// Reads all parts, and writes a file unless they are only looked at.
    fn merge(&self, output: Option<&Path>) -> Result<WriteSummary> {
        let parts = self.parts.iter().map(|part| open_source(part)).collect::<Result<Vec<_>>>()?;
        let label = if output.is_some() { "merging" } else { "checking" };
        let bar = self.context.progress_of_bytes(label);
        let output = output.map(|path| (path, &self.options));
        let watch = |done, total| watched(&bar, done, total);
        merge_sources(self.plan, &parts, output, &watch).map_err(of_files)
    }

    /// Has the store of parts and asset copy the texels. None where they do not lie in one, or it copies nothing.
    fn merge_in_store(&self, target: &Target<'_>) -> Result<Option<(WriteSummary, u64)>> {
        let Some(object) = target.object() else { return Ok(None) };
        let sources: Option<Vec<_>> = self.parts.iter().map(|part| object.source_to_copy(part)).collect();
        let Some(sources) = sources else { return Ok(None) };
        let parts: Vec<_> = sources.iter().map(|source| Arc::clone(source) as Arc<dyn ByteSource>).collect();
        let file = target.file();
        let (written, gaps) = {
            let bar = self.context.progress_of_bytes("merging");
            let watch = |done, total| watched(&bar, done, total);
            merge_with_gaps(self.plan, &parts, file, &self.options, &watch).map_err(of_files)?
        };
        let shared = |PartRun { part, offset, range }| {
            let source = Arc::clone(&sources[part]);
            SharedRun { source, offset, range }
        };
        let runs: Vec<_> = gaps.into_iter().map(shared).collect();
        let assembled = {
            let bar = self.context.progress_of_bytes("copying");
            let watch = |done, total| watched(&bar, done, total);
            object.assemble(file, &runs, &self.context.replace(), &watch)?
        };
        match assembled {
            Assembled::Done(copied) => return Ok(Some((written, copied))),
            Assembled::NotCopied(None) => {}
            Assembled::NotCopied(Some(why)) => self.context.note(format!(
                "{}: the store copies no ranges of objects ({why}), so all bytes go through this machine",
                object.location().display()
            )),
        }
        std::fs::remove_file(file).map_err(|error| Error::writing(file, error))?;
        Ok(None)
    }
}
