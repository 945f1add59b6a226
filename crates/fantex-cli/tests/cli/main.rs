//! The command line as scripts see it: exit codes, messages, JSON, files.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

mod azure;
mod bad_input;
mod baked_models;
mod documented;
mod export_and_paint;
mod flags;
mod gallery;
mod hostile;
mod looks;
#[cfg(target_os = "linux")]
mod memory;
mod objects;
#[cfg(target_os = "linux")]
mod outputs;
mod photographs;
mod previews;
mod readme;
mod round_trip;
mod serve;
mod stretched;
#[cfg(unix)]
mod unsent;
mod worlds;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fantex_test::{data_folder as data, workspace};
use serde_json::Value;

/// The program, quiet threads, in the workspace's folder.
fn fantex() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fantex"));
    command.current_dir(workspace());
    command
}

/// What cargo has made of an example of this package, beside the program.
#[cfg(target_os = "linux")]
fn example(file: &str) -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_fantex")).with_file_name("examples").join(file)
}

/// The model that comes with the repository.
fn bottle() -> PathBuf {
    workspace().join("assets/WaterBottle/WaterBottle.gltf")
}

/// Runs the program with arguments of any string type.
fn run(arguments: &[&dyn AsRef<OsStr>]) -> Output {
    let output = fantex().args(arguments.iter().map(|a| a.as_ref())).output().unwrap();
    let errors = stderr(&output);
    assert!(!errors.contains("panicked"), "{}: {errors}", shown(arguments));
    output
}

/// Runs the program, which must succeed.
fn succeeds(arguments: &[&dyn AsRef<OsStr>]) -> Output {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(0), "{}: {}", shown(arguments), stderr(&output));
    output
}

/// Runs the program with `--json`, which must succeed, and parses what it prints: what the page on the command line says.
fn json(arguments: &[&dyn AsRef<OsStr>]) -> Value {
    let output = succeeds(&[&[&"--json" as &dyn AsRef<OsStr>][..], arguments].concat());
    let printed = serde_json::from_slice(&output.stdout).expect("one JSON object on standard output");
    let words: Vec<_> = arguments.iter().map(|argument| argument.as_ref().to_string_lossy()).collect();
    documented::check_keys(&words.iter().map(|word| &**word).collect::<Vec<_>>(), &printed);
    printed
}

/// Runs the program, which must fail with an exit code and one sentence that holds some words; returns the sentence.
fn fails(code: i32, words: &[&str], arguments: &[&dyn AsRef<OsStr>]) -> String {
    let output = run(arguments);
    let errors = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{}: {errors}", shown(arguments));
    assert!(output.stdout.is_empty(), "{} printed a result", shown(arguments));
    let sentence = errors.lines().last().unwrap_or_default().to_owned();
    if code == 1 {
        assert!(sentence.starts_with("fantex: "), "{}: {errors}", shown(arguments));
    }
    for word in words {
        assert!(errors.contains(word), "{}: '{word}' is missing in: {errors}", shown(arguments));
    }
    sentence
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Names of the files in a folder, hidden ones too.
fn files(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// A cube without colours.
const CUBE_OBJ: &str = "\
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// A tetrahedron with vertex colours.
const COLORED_PLY: &str = "\
ply\nformat ascii 1.0\nelement vertex 4
property float x\nproperty float y\nproperty float z
property uchar red\nproperty uchar green\nproperty uchar blue
element face 4\nproperty list uchar int vertex_indices\nend_header
0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n0 0 1 255 255 255
3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

/// Writes a file into a folder and returns its path.
fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

fn shown(arguments: &[&dyn AsRef<OsStr>]) -> String {
    let words: Vec<_> = arguments.iter().map(|a| a.as_ref().to_string_lossy()).collect();
    format!("fantex {}", words.join(" "))
}
