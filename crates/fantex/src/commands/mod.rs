//! The commands, one file each.

pub(crate) mod bake;
pub(crate) mod bench;
pub(crate) mod compare;
pub(crate) mod demo;
pub(crate) mod export;
pub(crate) mod gallery;
pub(crate) mod generate;
pub(crate) mod info;
mod look;
pub(crate) mod paint;
mod photographs;
pub(crate) mod render;
mod render_gpu;
mod render_look;
pub(crate) mod verify;
pub(crate) mod view;

use crate::cli::Command;
use crate::context::Context;
use crate::error::CliError;

/// Runs a command.
pub(crate) fn run(command: &Command, context: &Context) -> Result<(), CliError> {
    match command {
        Command::Info(args) => info::run(args, context),
        Command::Bake(args) => bake::run(args, context),
        Command::Verify(args) => verify::run(args, context),
        Command::Render(args) => render::run(args, context),
        Command::Compare(args) => compare::run(args, context),
        Command::Export(args) => export::run(args, context),
        Command::Gallery(args) => gallery::run(args, context),
        Command::Generate(args) => generate::run(args, context),
        Command::Paint(args) => paint::run(args, context),
        Command::Bench(args) => bench::run(args, context),
        Command::Demo(args) => demo::run(args, context),
        Command::View(args) => view::run(args),
    }
}
