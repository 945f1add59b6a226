//! `fantex plan` and `fantex bake --shard`: a bake in parts, on any machines, in any order.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, Parser as _};
use fantex::addresses::is_address;
use fantex::store::Plan;
use fantex::stream::open_source;
use fantex::{Error, ErrorKind, Result};
use serde::{Deserialize, Serialize};

use crate::commands::bake::{self, BakeInfo, Goal, JobArgs};
use crate::context::Context;
use crate::local_files::with_local_files;
use crate::scene::check_is_no_model_name;
use crate::text::{ShownPath, megabytes};
use crate::{Cli, Command};

/// Which part of how many, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shard {
    pub(crate) number: u32,
    pub(crate) count: u32,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((number, count)) if (1..=count).contains(&number) => Ok(Self { number, count }),
            _ => Err("expected I/N, the number of a part and how many there are: 1/8 to 8/8".into()),
        }
    }
}

/// What a plan tells those who bake its parts.
#[derive(Debug, Serialize, Deserialize)]
struct About {
    /// The command that made the plan.
    arguments: Vec<String>,
    /// The folder that it ran in, where relative paths begin.
    folder: PathBuf,
}

/// Cover a model and plan a bake that several machines do in parts.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex plan world.glb -o world.plan --texels 16G
  fantex bake world.plan --shard 1/3 -o 1.part
  fantex bake world.plan --shard 2/3 -o 2.part
  fantex bake world.plan --shard 3/3 -o 3.part
  fantex merge world.plan 1.part 2.part 3.part -o world.fan

The plan is the asset without its texels; the merged parts are the asset that 'fantex bake' writes in one go, byte for byte, however many \
parts there are. Each part may be baked by any machine of the same kind of processor that sees the model and its pictures under the same paths, in \
any order, and again where it was lost. The plan keeps digests of all that decides the texels, the contents of looks, pictures and photographs among it; a \
machine where something differs names it and bakes nothing (docs/farms.md).")]
#[command(mut_arg("output", |output| output.value_name("PLAN").help("The plan to write")))]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    job: JobArgs,
}

#[derive(Debug, Serialize)]
struct PlanInfo {
    output: ShownPath,
    triangles: u64,
    groups: u64,
    texels: u64,
    bytes: u64,
    channels: Vec<String>,
}

pub(crate) fn run(args: &PlanArgs, context: &Context) -> Result<()> {
    let arguments = std::env::args_os()
        .map(|argument| argument.into_string().map_err(|text| text.display().to_string()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|text| Error::invalid(format!("{text} is not UTF-8, which what a plan notes has to be")))?;
    let folder = std::env::current_dir().map_err(|error| Error::reading(Path::new("."), error))?;
    if folder.to_str().is_none() {
        let folder = folder.display();
        return Err(Error::invalid(format!(
            "the folder {folder} is not UTF-8, which what a plan notes has to be; plan in another one"
        )));
    }
    let about = serde_json::to_vec(&About { arguments, folder })
        .map_err(|error| Error::invalid(error.to_string()))?;
    let info = bake::bake(&args.job, &args.job.output, &Goal::Plan(&about), context.seed, context)?;
    let contents = bake::contents(&info);
    let BakeInfo { output, triangles, groups, texels, bytes, channels, .. } = info;
    context.print(&PlanInfo { output, triangles, groups, texels, bytes, channels }, |info| {
        let plan = info.output.display();
        format!("{plan}: {contents}; bake its parts: fantex bake {plan} --shard 1/N -o 1.part")
    })
}

/// Bakes a part with the arguments of its plan.
pub(crate) fn bake_shard(path: &Path, shard: Shard, output: &Path, context: &Context) -> Result<()> {
    check_is_no_model_name(output, "a part of a bake", "1.part")?;
    context.check_target_of(output, [path])?;
    let plan = open_plan(path)?;
    let damaged = || Error::damaged(format!("{} does not say how it was made; plan anew", path.display()));
    let about: About = serde_json::from_slice(&plan.about).map_err(|_| damaged().with_path(path))?;
    let arguments = with_local_files(about.arguments.iter().map(OsString::from));
    let cli = Cli::try_parse_from(arguments).map_err(|_| damaged().with_path(path))?;
    let Command::Plan(planned) = cli.command else { return Err(damaged().with_path(path)) };
    let place = match is_address(output) {
        true => output.to_owned(),
        false => std::path::absolute(output).map_err(|error| Error::writing(output, error))?,
    };
    std::env::set_current_dir(&about.folder).map_err(|error| {
        let folder = about.folder.display();
        Error::reading(&about.folder, error)
            .context(format!("{} was made in {folder}, where its model is looked for", path.display()))
    })?;
    let goal = Goal::Part(&plan, shard);
    let mut info = bake::bake(&planned.job, &place, &goal, cli.common.seed(), context).map_err(of_files)?;
    info.output = output.into();
    context.print(&info, |info| {
        let Shard { number, count } = shard;
        let (bytes, seconds) = (megabytes(info.bytes), info.seconds.total);
        format!("{}: part {number} of {count}, {bytes} in {seconds:.1} s", info.output.display())
    })
}

/// Reads a plan at a path or an address.
pub(super) fn open_plan(place: &Path) -> Result<Plan> {
    let opened = Plan::open_source(&*open_source(place)?);
    opened.map_err(|error| of_files(error).context("cannot read the plan"))
}

/// The library sees arguments of functions in plans, parts and models that do not fit together; here they are files that were given, and
/// the command line is right.
pub(super) fn of_files(error: Error) -> Error {
    match error.kind() {
        ErrorKind::InvalidArgument => Error::unsupported(error.to_string()),
        _ => error,
    }
}
