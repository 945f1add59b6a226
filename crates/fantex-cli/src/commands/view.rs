//! `fantex view`: starts the viewer, a program of its own beside this one.

use std::env::consts::EXE_SUFFIX;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use clap::Args;

use fantex::{Error, Result};

use crate::context::Context;

const VIEWER: &str = "fantex-app";

/// Show a model, an asset, a world or a look in a window.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  fantex view bunny.fan
  fantex view bottle.glb --size 1920x1080
  fantex view https://example.org/landscape.fan
  fantex view town.fanworld
  fantex view oak.toml --on chair.glb

FILE and everything after it go to the viewer, and so do --memory, --threads and --allow-outside before it; 'fantex view -- --help' \
lists the viewer's options.")]
pub(crate) struct ViewArgs {
    /// A model (.glb .gltf .obj .ply .stl), an asset (.fan) or a world (.fanworld), both also at an https://, s3://, gs:// or az:// address, or
    /// a look (.toml), and options of the viewer
    #[arg(value_name = "FILE", trailing_var_arg = true, allow_hyphen_values = true)]
    pub(crate) arguments: Vec<OsString>,
}

/// Less is refused by the viewer.
const MIN_MEMORY: u64 = 16 << 20;

pub(crate) fn run(args: &ViewArgs, context: &Context) -> Result<ExitCode> {
    start(&args.arguments, context.memory_asked, context)
}

/// Starts the viewer, with what the flags of every command say to it, and waits until its window is closed.
pub(crate) fn start(
    arguments: &[OsString],
    memory_bytes: Option<u64>,
    context: &Context,
) -> Result<ExitCode> {
    if let Some(flag) = context.flag_not_for_windows() {
        return Err(Error::invalid(format!("{flag} has no meaning for a window; leave it out")));
    }
    let beside = std::env::current_exe().ok().and_then(|this| this.parent().map(Path::to_owned));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let viewer = find(beside.as_deref(), &path).ok_or_else(|| {
        Error::unavailable(
            "the viewer fantex-app is neither beside this program nor on the search path; build it with 'cargo build --release -p \
             fantex-app'",
        )
    })?;
    let mut command = Command::new(&viewer);
    command.args(common_flags(memory_bytes, context.allow_outside));
    command.envs(context.threads_asked.map(|threads| ("RAYON_NUM_THREADS", threads.to_string())));
    let status = command.args(arguments).status().map_err(|error| {
        Error::unavailable(format!("cannot start the viewer {}: {error}", viewer.display()))
    })?;
    match status.code().map(u8::try_from) {
        // Of a failure the viewer has said itself what was wrong.
        Some(Ok(code @ 0..=2)) => Ok(ExitCode::from(code)),
        _ => Err(Error::unavailable(format!("the viewer ended unexpectedly ({status})"))),
    }
}

/// Flags of every command that the viewer has, too.
fn common_flags(memory_bytes: Option<u64>, allow_outside: bool) -> Vec<String> {
    let memory = memory_bytes.map(|bytes| format!("--memory={}", bytes.max(MIN_MEMORY)));
    memory.into_iter().chain(allow_outside.then(|| "--allow-outside".into())).collect()
}

/// The viewer beside this program, else on the search path.
fn find(beside: Option<&Path>, path: &std::ffi::OsStr) -> Option<PathBuf> {
    let name = format!("{VIEWER}{EXE_SUFFIX}");
    let folders = beside.map(Path::to_owned).into_iter().chain(std::env::split_paths(path));
    folders.map(|folder| folder.join(&name)).find(|candidate| candidate.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_viewer_beside_the_program_comes_first() {
        let (beside, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let name = format!("{VIEWER}{EXE_SUFFIX}");
        let path = elsewhere.path().as_os_str();
        assert_eq!(find(Some(beside.path()), path), None);
        std::fs::write(elsewhere.path().join(&name), "").unwrap();
        assert_eq!(find(Some(beside.path()), path), Some(elsewhere.path().join(&name)));
        std::fs::write(beside.path().join(&name), "").unwrap();
        assert_eq!(find(Some(beside.path()), path), Some(beside.path().join(&name)));
    }

    #[test]
    fn everything_goes_to_the_viewer() {
        use clap::Parser;

        let line = ["fantex", "view", "--memory", "1M", "a.fan", "--size", "800x600", "--allow-outside"];
        let cli = crate::Cli::parse_from(line);
        let crate::Command::View(args) = cli.command else { panic!("another command") };
        assert_eq!(args.arguments, ["a.fan", "--size", "800x600", "--allow-outside"]);
        let flags = common_flags(cli.common.memory, cli.common.allow_outside);
        assert_eq!(flags, [format!("--memory={MIN_MEMORY}")]);
        assert_eq!(common_flags(None, true), ["--allow-outside"]);
    }
}
