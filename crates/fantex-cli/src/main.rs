//! The command line of fantex.

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use fantex::base::random::DEFAULT_SEED;
use fantex::signals::fail_writes_at_size_limit;
use fantex::{Error, ErrorKind, Result};

use crate::commands::{
    bake, bench, compare, demo, export, gallery, generate, image, info, merge, normals, notices, paint, plan,
    preview, render, serve, simplify, split, table, upload, verify, view, warp, world,
};
use crate::context::{Context, EXIT_INTERRUPTED, say};
use crate::local_files::with_local_files;
use crate::text::{bytes, whole};

mod context;
mod cover_pictures;
mod local_files;
mod scene;
mod series;
mod server;
mod shipped;
mod sources;
mod text;

/// The commands, one file each.
mod commands {
    pub(crate) mod bake;
    pub(crate) mod bench;
    pub(crate) mod compare;
    pub(crate) mod demo;
    pub(crate) mod export;
    pub(crate) mod gallery;
    pub(crate) mod generate;
    pub(crate) mod image;
    pub(crate) mod info;
    pub(crate) mod merge;
    pub(crate) mod normals;
    pub(crate) mod notices;
    pub(crate) mod paint;
    pub(crate) mod plan;
    pub(crate) mod preview;
    pub(crate) mod render;
    pub(crate) mod serve;
    pub(crate) mod simplify;
    pub(crate) mod split;
    pub(crate) mod table;
    pub(crate) mod upload;
    pub(crate) mod verify;
    pub(crate) mod view;
    pub(crate) mod warp;
    pub(crate) mod world;
}

fn main() -> ExitCode {
    // Copies of worlds have a file per asset until all are there. What is left of a low limit is told where files are opened.
    #[cfg(unix)]
    rlimit::increase_nofile_limit(u64::MAX).unwrap_or_default();
    fail_writes_at_size_limit();
    let arguments = with_local_files(std::env::args_os()).into_iter();
    let cli = Cli::parse_from(warp::join_corners(arguments));
    let context = match Context::new(&cli.common) {
        Ok(context) => context,
        Err(error) => return failed(&error),
    };
    let result = run(&cli.command, &context);
    if result.is_err() {
        context.remove_empty_folders();
    }
    match result {
        Ok(exit_code) => exit_code,
        Err(error) if context.is_interrupted() => {
            match error.remains() {
                Some(remains) => say(format_args!("fantex: interrupted; {remains}")),
                None => say(format_args!("fantex: {}", context.last_line())),
            }
            ExitCode::from(EXIT_INTERRUPTED)
        }
        Err(error) => failed(&error),
    }
}

fn failed(error: &Error) -> ExitCode {
    say(format_args!("fantex: {error}"));
    ExitCode::from(if error.kind() == ErrorKind::InvalidArgument { 2 } else { 1 })
}

/// Seamless textures without UV coordinates: cover a model by parts of its triangle fans, bake, verify, render.
#[derive(Debug, Parser)]
#[command(name = "fantex", version, max_term_width = 110, after_help = EXAMPLE)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub(crate) common: CommonArgs,
    #[command(subcommand)]
    pub(crate) command: Command,
}

const EXAMPLE: &str = "\
Example:
  fantex bake bottle.gltf -o bottle.fan
  fantex verify bottle.fan
  fantex render bottle.fan -o bottle.png

Exit codes: 0 done, 1 failed (bad input, input or output error, check not passed), 2 wrong usage, 130 interrupted.";

/// Flags of every command.
#[derive(Args, Debug)]
#[command(next_help_heading = "Options of every command")]
pub(crate) struct CommonArgs {
    /// Print the result as one JSON object on standard output
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// No progress and no notes on standard error, only errors
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
    /// Number of threads; all processors by default
    #[arg(long, global = true, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Memory for all that is read whole (images, volumes, tables, models) and for texels in caches and under way, e.g. 512M
    /// or 4G; up to 192 MiB are used beside it [default: 4G, of which texels take 1G]
    #[arg(long, global = true, value_name = "SIZE", allow_negative_numbers = true, value_parser = bytes)]
    pub(crate) memory: Option<u64>,
    /// Let models, looks in assets and stroke files name files outside their folders
    #[arg(long, global = true)]
    pub(crate) allow_outside: bool,
    /// Fail where coarser texels stand in for damaged ones, or a model is shown without images that cannot be read
    #[arg(long, global = true)]
    pub(crate) strict: bool,
    /// Overwrite existing files, except assets that another program is editing
    #[arg(long, global = true)]
    pub(crate) force: bool,
    /// Seed of everything random [default: 1]
    #[arg(long, global = true, value_name = "N", allow_negative_numbers = true, value_parser = whole::<u64>)]
    seed: Option<u64>,
}

impl CommonArgs {
    /// The seed that was asked for, or the default.
    pub(crate) fn seed(&self) -> u64 {
        self.seed.unwrap_or(DEFAULT_SEED)
    }
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Info(info::InfoArgs),
    Bake(bake::BakeArgs),
    Plan(plan::PlanArgs),
    Merge(merge::MergeArgs),
    Verify(verify::VerifyArgs),
    Render(render::RenderArgs),
    Compare(compare::CompareArgs),
    Export(export::ExportArgs),
    Gallery(gallery::GalleryArgs),
    Generate(generate::GenerateArgs),
    Image(image::ImageArgs),
    Normals(normals::NormalsArgs),
    Table(table::TableArgs),
    Warp(warp::WarpArgs),
    Paint(paint::PaintArgs),
    Bench(bench::BenchArgs),
    Demo(demo::DemoArgs),
    View(view::ViewArgs),
    Preview(preview::PreviewArgs),
    Serve(serve::ServeArgs),
    Simplify(simplify::SimplifyArgs),
    Split(split::SplitArgs),
    Upload(upload::UploadArgs),
    World(world::WorldArgs),
    Notices(notices::NoticesArgs),
}

fn run(command: &Command, context: &Context) -> Result<ExitCode> {
    match command {
        Command::Paint(args) => return paint::run(args, context),
        Command::View(args) => return view::run(args, context),
        Command::Info(args) => info::run(args, context),
        Command::Bake(args) => bake::run(args, context),
        Command::Plan(args) => plan::run(args, context),
        Command::Merge(args) => merge::run(args, context),
        Command::Verify(args) => verify::run(args, context),
        Command::Render(args) => render::run(args, context),
        Command::Compare(args) => compare::run(args, context),
        Command::Export(args) => export::run(args, context),
        Command::Gallery(args) => gallery::run(args, context),
        Command::Generate(args) => generate::run(args, context),
        Command::Image(args) => image::run(args, context),
        Command::Normals(args) => normals::run(args, context),
        Command::Table(args) => table::run(args, context),
        Command::Warp(args) => warp::run(args, context),
        Command::Bench(args) => bench::run(args, context),
        Command::Demo(args) => demo::run(args, context),
        Command::Preview(args) => preview::run(args, context),
        Command::Serve(args) => serve::run(args, context),
        Command::Simplify(args) => simplify::run(args, context),
        Command::Split(args) => split::run(args, context),
        Command::Upload(args) => upload::run(args, context),
        Command::World(args) => world::run(args, context),
        Command::Notices(_) => notices::run(context),
    }?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_shows_an_example() {
        for command in Cli::command().get_subcommands().filter(|c| c.get_name() != "help") {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains("Example"), "{} has no example", command.get_name());
        }
    }

    /// Terminals differ in width.
    #[test]
    fn no_sentence_of_the_help_is_broken_by_hand() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines: Vec<&str> = help.lines().collect();
            for pair in lines.windows(2) {
                let goes_on =
                    !pair[0].is_empty() && !pair[0].starts_with(' ') && !pair[0].ends_with(['.', ':']);
                let is_text = !pair[1].is_empty() && !pair[1].starts_with(' ');
                assert!(!(goes_on && is_text), "{}: {}", command.get_name(), pair[0]);
            }
        }
    }
}
