//! The viewer as a program. `fantex view` starts it.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    fantex_app::shell::run(fantex_app::shell::Arguments::parse())
}
