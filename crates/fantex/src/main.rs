//! The command line of fantex.

mod animation;
mod cli;
mod commands;
mod context;
mod error;
mod gallery;
mod input;
mod interrupt;
mod memory;
mod overdraft;
mod pictures;
mod progress;
mod scene;
mod size;
mod sources;
mod surroundings;
mod table;

use std::process::ExitCode;

use clap::Parser;

use crate::cli::Cli;
use crate::context::Context;
use crate::error::CliError;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = Context::new(&cli.common).and_then(|context| commands::run(&cli.command, &context));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(CliError::OutputClosed) => ExitCode::SUCCESS,
        Err(error @ CliError::ViewerFailed { .. }) => ExitCode::from(error.exit_code()),
        Err(error) => {
            eprintln!("fantex: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
