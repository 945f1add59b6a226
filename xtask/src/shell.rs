//! Running other programs.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[derive(Debug)]
pub(crate) struct Failure(pub(crate) String);

impl Failure {
    pub(crate) fn new(reason: impl Into<String>) -> Self {
        Self(reason.into())
    }
}

pub(crate) fn root() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_owned()
}

/// The folder of the real models: `FANTEX_DATA`, or `../shared/data` beside the workspace.
pub(crate) fn data_folder() -> Option<PathBuf> {
    let beside = || root().join("../shared/data");
    let folder = std::env::var_os("FANTEX_DATA").map_or_else(beside, PathBuf::from);
    folder.canonicalize().ok()
}

/// The cargo that runs this program, in the workspace's folder. It is not told about this package, as the cargo that runs this
/// program tells it: build scripts that watch those variables (`ring`'s) would run again, and what depends on them be compiled anew,
/// at every change between `cargo xtask` and `cargo`.
pub(crate) fn cargo_command(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root());
    for (name, _) in std::env::vars_os() {
        if name.to_str().is_some_and(|name| OF_THIS_PACKAGE.iter().any(|start| name.starts_with(start))) {
            command.env_remove(&name);
        }
    }
    command
}

const OF_THIS_PACKAGE: [&str; 3] = ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_"];

pub(crate) fn cargo(arguments: &[&str]) -> Result<(), Failure> {
    eprintln!("> cargo {}", arguments.join(" "));
    run(&mut cargo_command(arguments))
}

/// Runs a command and shows what it says.
pub(crate) fn run(command: &mut Command) -> Result<(), Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(Failure(format!("'{name}' failed: {status}"))),
        Err(error) => Err(Failure(format!("cannot run '{name}': {error}"))),
    }
}

/// Runs a command beside others, and shows what it says once it has ended.
pub(crate) fn run_beside(command: &mut Command) -> Result<(), Failure> {
    let words: Vec<_> = std::iter::once(command.get_program()).chain(command.get_args()).collect();
    let name = words.join(" ".as_ref()).to_string_lossy().into_owned();
    let output = command.output().map_err(|error| Failure(format!("cannot run {name}: {error}")))?;
    let [said, told] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    eprintln!("> {name}\n{told}{said}");
    match output.status.success() {
        true => Ok(()),
        false => Err(Failure(format!("{name} failed: {}", output.status))),
    }
}

/// Runs a command and returns what it writes to standard output.
pub(crate) fn capture(command: &mut Command) -> Result<String, Failure> {
    let name = format!("{command:?}");
    let output = command.stderr(Stdio::inherit()).output();
    let output = output.map_err(|error| Failure(format!("cannot run {name}: {error}")))?;
    if !output.status.success() {
        return Err(Failure(format!("{name} failed: {}", output.status)));
    }
    String::from_utf8(output.stdout).map_err(|_| Failure(format!("{name} did not write text")))
}

/// True if a command runs and succeeds, whatever it says.
pub(crate) fn succeeds(command: &mut Command) -> bool {
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}
