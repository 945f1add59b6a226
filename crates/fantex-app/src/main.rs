//! The viewer as a program. `fantex view` starts it.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    fantex::signals::fail_writes_at_size_limit();
    fantex_app::shell::run(fantex_app::shell::Arguments::parse())
}
