//! Development chores: `cargo xtask lint | test | python | web | fuzz | notices | bench | demo | schema | goldens | compare-binaries`.

mod advisories;
mod bench;
mod compare_binaries;
mod crates;
mod goldens;
mod licenses;
mod lint;
mod python;
mod shell;
mod test;
mod web;

use std::process::ExitCode;

use shell::Failure;

const USAGE: &str = "\
usage: cargo xtask CHORE

  lint                       formatting, clippy, direction of the crates, sizes of files, documentation, packages
  test [--slow]              all tests and examples; --slow adds those that are ignored because they take long
  python                     the part of these that tests the Python package
  web                        builds the viewer for browsers; programs that are built afterwards have it
  fuzz [SECONDS] [SEED]      attacks every reader with damaged files, each for so long (600); says the seed of what it finds
  notices                    writes the licences of all that is in the programs to assets/NOTICES.txt, which they print
  bench                      figures of fidelity and speed, beside peers where they are installed; writes target/bench.json
  demo                       the tour of the README
  schema                     writes docs/look.schema.json and the tables of docs/look.md
  goldens [PROGRAM]          draws the gallery's small pictures anew; look at what changed before you commit it
  compare-binaries OLD NEW [--only NAME]
                             runs two builds of the command line on every model (or those whose name contains NAME, or landscape,
                             photographs, gallery) and compares all they write";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match words[..] {
        ["lint"] => lint::run(),
        ["test"] => test::run(false),
        ["test", "--slow"] => test::run(true),
        ["python"] => test::run_python(),
        ["web"] => web::build(),
        ["web-scripts"] => web::write_scripts(),
        ["bench"] => bench::run(),
        ["schema"] => shell::cargo(&["run", "-p", "fantex-look", "--example", "write_reference"]),
        ["goldens"] => goldens::run(None),
        ["goldens", program] => goldens::run(Some(program)),
        ["compare-binaries", old, new] => compare_binaries::run(old, new, ""),
        ["compare-binaries", old, new, "--only", name] => compare_binaries::run(old, new, name),
        ["notices"] => licenses::write_notices(),
        ["fuzz"] => test::fuzz("600", "1"),
        ["fuzz", seconds] => test::fuzz(seconds, "1"),
        ["fuzz", seconds, seed] => test::fuzz(seconds, seed),
        ["demo", ref rest @ ..] => shell::cargo(&[&["run", "--release", "--", "demo"], rest].concat()),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(reason)) => {
            eprintln!("xtask: {reason}");
            ExitCode::FAILURE
        }
    }
}
