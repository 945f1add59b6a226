//! All tests.

use std::process::Command;

use crate::graphics;
use crate::shell::{self, Failure, cargo_command, root, succeeds};

/// Runs unit, integration and documentation tests. `slow` adds those that are ignored because they take long.
pub(crate) fn run(slow: bool) -> Result<(), Failure> {
    let has_nextest = succeeds(&mut cargo_command(&["nextest", "--version"]));
    let mut arguments = match has_nextest {
        true => vec!["nextest", "run", "--workspace", "--no-fail-fast"],
        false => vec!["test", "--workspace", "--no-fail-fast", "--lib", "--bins", "--tests"],
    };
    match (slow, has_nextest) {
        (true, true) => arguments.extend(["--run-ignored", "all"]),
        (true, false) => arguments.extend(["--", "--include-ignored"]),
        (false, _) => {}
    }
    let mut skipped = Vec::new();
    graphics::prepare(&mut skipped);
    if !slow {
        skipped.push("slow tests (run them with: cargo xtask test --slow)".to_owned());
    }
    let result = run_with_data(&arguments, &mut skipped);
    let documentation = run_with_data(&["test", "--workspace", "--doc", "--quiet"], &mut Vec::new());
    skipped.iter().for_each(|what| eprintln!("SKIPPED: {what}"));
    result.and(documentation)
}

/// Runs cargo; tests learn from `FANTEX_DATA` where the real models and images are.
fn run_with_data(arguments: &[&str], skipped: &mut Vec<String>) -> Result<(), Failure> {
    eprintln!("> cargo {}", arguments.join(" "));
    let mut command: Command = cargo_command(arguments);
    if std::env::var_os("FANTEX_DATA").is_none() {
        let data = root().join("../shared/data");
        match data.canonicalize() {
            Ok(data) => {
                command.env("FANTEX_DATA", data);
            }
            Err(_) => skipped.push(
                "tests on real models and images: set FANTEX_DATA to the folder that holds them".to_owned(),
            ),
        }
    }
    shell::run(&mut command)
}
