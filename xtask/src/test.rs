//! All tests.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::{self, ScopedJoinHandle, available_parallelism};

use crate::python::{self, Environment};
use crate::shell::{
    Failure, capture, cargo_command, data_folder, root, run as run_command, run_beside, succeeds,
};
use crate::web;

/// Examples of the library. All of them end by themselves without arguments.
const EXAMPLES: [&str; 6] = [
    "sample_an_asset",
    "bake_a_closure",
    "stream_without_a_gpu",
    "paint_and_undo",
    "unwrap_a_mesh",
    "draw_in_a_host_frame",
];

/// Runs unit, integration and documentation tests, and the examples. `slow` adds tests that are ignored because they take long.
pub(crate) fn run(slow: bool) -> Result<(), Failure> {
    let list = skipped_list()?;
    // What an earlier run has left.
    std::fs::remove_file(&list).unwrap_or_default();
    let threads = format!("--test-threads={}", threads());
    let has_nextest = succeeds(&mut cargo_command(&["nextest", "--version"]));
    let mut arguments = match has_nextest {
        true => vec!["nextest", "run", "--workspace", "--no-fail-fast", &*threads],
        false => vec!["test", "--workspace", "--no-fail-fast", "--lib", "--bins", "--tests", "--", &*threads],
    };
    match (slow, has_nextest) {
        (true, true) => arguments.extend(["--run-ignored", "all"]),
        (true, false) => arguments.push("--include-ignored"),
        (false, _) => {}
    }
    if web::has_target() {
        // Programs that are built from here on have it; the tests in a browser want it.
        prepare_browser();
        web::install_three();
        web::build()?;
    } else {
        eprintln!("no viewer for browsers: {}", web::HOW);
        if let Some(stale) = web::stale() {
            eprintln!("{stale}");
        }
    }
    // What leaves cores idle is done beside the rest: downloads while crates are compiled, doc tests beside the others.
    let result = thread::scope(|scope| {
        let environment = scope.spawn(|| Environment::prepare(&list));
        let graphics = scope.spawn(prepare_graphics);
        // At once: the last crates of one build would be compiled by one core each.
        run_cargo(&["build", "--workspace", "--lib", "--bins", "--tests", "--examples"], &list)?;
        joined(graphics)?;
        let documentation = scope.spawn(|| run_documentation(&list));
        let result = run_cargo(&arguments, &list);
        let documentation = joined(documentation).flatten();
        let examples = run_examples(&list);
        let python = joined(environment).flatten().and_then(|made| match made {
            Some(environment) => python::run(&environment, &list, slow),
            None => Ok(()),
        });
        result.and(documentation).and(examples).and(python)
    });
    eprintln!("{}", summary(&std::fs::read_to_string(&list).unwrap_or_default(), slow));
    result
}

fn run_documentation(list: &Path) -> Result<(), Failure> {
    let arguments = ["test", "--workspace", "--doc", "--quiet"];
    run_beside(&mut test_command(&arguments, list))
}

fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> Result<T, Failure> {
    thread.join().map_err(|_| Failure::new("a thread of this program panicked"))
}

/// How many tests run side by side: many wait for servers, browsers or windows, and others run meanwhile.
pub(crate) fn threads() -> usize {
    let cores = available_parallelism().map_or(1, NonZero::get);
    cores + cores.div_ceil(2)
}

/// Runs the tests of the Python package alone.
pub(crate) fn run_python() -> Result<(), Failure> {
    let list = skipped_list()?;
    match Environment::prepare(&list)? {
        Some(environment) => python::run(&environment, &list, false),
        None => Ok(()),
    }
}

/// Where tests say that they are left out, and why.
fn skipped_list() -> Result<PathBuf, Failure> {
    let folder = target_folder();
    std::fs::create_dir_all(&folder)
        .map_err(|error| Failure(format!("cannot make {}: {error}", folder.display())))?;
    Ok(folder.join("skipped-tests.txt"))
}

/// The attacks of `fantex-bench`, for so many seconds each, with the checks of builds for development.
pub(crate) fn fuzz(seconds: &str, seed: &str) -> Result<(), Failure> {
    let arguments = ["test", "-p", "fantex-bench", "--test", "attack", "--", "--ignored", "--nocapture"];
    let mut command = cargo_command(&arguments);
    run_command(command.env("FANTEX_FUZZ_SECONDS", seconds).env("FANTEX_FUZZ_SEED", seed))
}

/// Libraries, programs and examples of the workspace, with the features that tests have (examples bring those of what only tests
/// use); so nothing is compiled twice.
pub(crate) fn build_all(list: &Path) -> Result<(), Failure> {
    run_cargo(&["build", "--workspace", "--lib", "--bins", "--examples"], list)
}

fn run_examples(list: &Path) -> Result<(), Failure> {
    build_all(list)?;
    let target = target_folder();
    EXAMPLES.iter().try_for_each(|example| {
        eprintln!("> {example}");
        run_command(Command::new(target.join("debug/examples").join(example)).current_dir(root()))
    })
}

/// Where cargo builds.
pub(crate) fn target_folder() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from)
}

/// One line on what was left out, by reason.
fn summary(skipped: &str, slow: bool) -> String {
    let mut reasons: Vec<&str> = skipped.lines().collect();
    let count = reasons.len();
    reasons.sort_unstable();
    let mut text = format!("skipped: {count} tests");
    for same in reasons.chunk_by(|a, b| a == b) {
        let separator = if text.contains('(') { "; " } else { " (" };
        text += &format!("{separator}{} x {}", same.len(), same[0]);
    }
    if count > 0 {
        text.push(')');
    }
    if !slow {
        text.push_str("; slow tests run with: cargo xtask test --slow");
    }
    text
}

/// A command of cargo; tests learn where the real models and images are, and where to say what they leave out.
fn test_command(arguments: &[&str], list: &Path) -> Command {
    let mut command = cargo_command(arguments);
    command.env("FANTEX_SKIPPED", list);
    if let Some(data) = data_folder() {
        command.env("FANTEX_DATA", data);
    }
    command
}

/// Runs such a command.
pub(crate) fn run_cargo(arguments: &[&str], list: &Path) -> Result<(), Failure> {
    eprintln!("> cargo {}", arguments.join(" "));
    run_command(&mut test_command(arguments, list))
}

/// Debian's packages: software Vulkan, a virtual display, and the libraries that a window loads at run time.
const PACKAGES: [&str; 9] = [
    "mesa-vulkan-drivers",
    "libvulkan1",
    "xvfb",
    "libx11-6",
    "libx11-xcb1",
    "libxcursor1",
    "libxi6",
    "libxkbcommon0",
    "libxkbcommon-x11-0",
];

const DRIVER_FOLDERS: [&str; 4] = [
    "/usr/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/local/share/vulkan/icd.d",
    "/usr/local/etc/vulkan/icd.d",
];

/// Sees to it that tests of the GPU renderer and of the window can run: installs what is missing where that is possible without
/// asking anybody (as root, where there is `apt-get`), and says what is missing elsewhere.
fn prepare_graphics() {
    if !cfg!(target_os = "linux") || (has_vulkan() && has_display()) {
        return;
    }
    if !installed(&PACKAGES) {
        eprintln!("no Vulkan driver or no virtual display; on Debian install {}", PACKAGES.join(" "));
    }
}

/// Debian's packages: a browser, and what drives it.
const BROWSER: [&str; 2] = ["chromium", "chromium-driver"];

/// The same for tests in a browser.
fn prepare_browser() {
    let is_there = succeeds(Command::new("chromedriver").arg("--version"));
    if cfg!(target_os = "linux") && !is_there && !installed(&BROWSER) {
        eprintln!("no browser for the tests of the page; on Debian install {}", BROWSER.join(" "));
    }
}

/// Installs packages where that is possible without asking anybody.
fn installed(packages: &[&str]) -> bool {
    if !is_root() || !succeeds(Command::new("apt-get").arg("--version")) {
        return false;
    }
    eprintln!("> apt-get install {}", packages.join(" "));
    // The package lists may be old or missing.
    install(packages)
        || run_command(Command::new("apt-get").args(["update", "-qq"])).is_ok() && install(packages)
}

fn install(packages: &[&str]) -> bool {
    let mut command = Command::new("apt-get");
    command.args(["install", "-y", "-qq", "--no-install-recommends"]).args(packages);
    run_command(command.env("DEBIAN_FRONTEND", "noninteractive")).is_ok()
}

fn is_root() -> bool {
    capture(Command::new("id").arg("-u")).is_ok_and(|id| id.trim() == "0")
}

fn has_vulkan() -> bool {
    ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(|name| std::env::var_os(name).is_some())
        || DRIVER_FOLDERS
            .iter()
            .any(|folder| Path::new(folder).read_dir().is_ok_and(|mut files| files.next().is_some()))
}

fn has_display() -> bool {
    succeeds(Command::new("sh").args(["-c", "command -v Xvfb"]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_tests_are_counted_by_reason() {
        assert_eq!(summary("", true), "skipped: 0 tests");
        assert_eq!(summary("no GPU\nno data\nno GPU\n", true), "skipped: 3 tests (2 x no GPU; 1 x no data)");
    }
}
