//! The tests of the Python package.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::shell::{Failure, data_folder, root, run as run_command, succeeds};
use crate::test::{build_all, target_folder, threads};

/// Packages of an index, and the modules that they bring.
type Packages = &'static [(&'static str, &'static str)];

/// What the tests import.
const NEEDED: Packages =
    &[("pytest", "pytest"), ("numpy", "numpy"), ("trimesh", "trimesh"), ("pillow", "PIL")];

/// What some tests import; those say that they are left out without it.
const OPTIONAL: [(&str, Packages); 6] = [
    ("usd-core and MaterialX", &[("usd-core", "pxr"), ("MaterialX", "MaterialX")]),
    ("moderngl and OpenImageIO", &[("moderngl", "moderngl"), ("openimageio", "OpenImageIO")]),
    ("distributed (Dask)", &[("distributed", "distributed"), ("pyyaml", "yaml")]),
    ("openjd-cli", &[("openjd-cli", "openjd.cli")]),
    ("snakemake", &[("snakemake", "snakemake")]),
    (
        "nbclient and ipykernel",
        &[("nbformat", "nbformat"), ("nbclient", "nbclient"), ("ipykernel", "ipykernel")],
    ),
];

/// What runs tests side by side; without it they run one after another.
const PARALLEL: Packages = &[("pytest-xdist", "xdist")];

/// A virtual environment in the target folder with what the tests import.
pub(crate) struct Environment {
    python: PathBuf,
    is_parallel: bool,
}

impl Environment {
    /// Makes it, where it is not there. Nothing without Python 3.10 or the packages that are needed, and `list` says so.
    pub(crate) fn prepare(list: &Path) -> Result<Option<Self>, Failure> {
        let skipped = |reason| skip(list, reason).map(|()| None);
        let Some(python) = interpreter() else { return skipped("no Python 3.10 or later") };
        let environment = folder().join("environment");
        let own = environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
        if !succeeds(Command::new(&own).arg("--version"))
            && run_command(Command::new(&python).args(["-m", "venv"]).arg(&environment)).is_err()
        {
            return skipped("Python cannot make a virtual environment");
        }
        let sets: Vec<Packages> =
            [NEEDED, PARALLEL].into_iter().chain(OPTIONAL.iter().map(|(_, set)| *set)).collect();
        let there = install(&own, &sets);
        if !there[0] {
            return skipped("no numpy, pytest, trimesh and pillow for Python");
        }
        for ((names, _), _) in OPTIONAL.iter().zip(&there[2..]).filter(|(_, is_there)| !**is_there) {
            skip(list, &format!("no {names} for Python"))?;
        }
        Ok(Some(Self { python: own, is_parallel: there[1] }))
    }
}

/// Installs what of these is missing: at once, or else each by itself. Tells which are there.
fn install(python: &Path, sets: &[Packages]) -> Vec<bool> {
    let imports = |set: &&Packages| {
        let imports: Vec<String> = set.iter().map(|(_, module)| format!("import {module}")).collect();
        succeeds(Command::new(python).arg("-c").arg(imports.join("\n")))
    };
    let mut there: Vec<bool> = sets.iter().map(|set| imports(&set)).collect();
    let names = |set: Packages| set.iter().map(|(package, _)| *package);
    let missing: Vec<&str> =
        sets.iter().zip(&there).filter(|(_, is_there)| !**is_there).flat_map(|(set, _)| names(set)).collect();
    if missing.is_empty() || run_command(pip(python).args(missing)).is_ok() {
        return vec![true; sets.len()];
    }
    for (set, is_there) in sets.iter().zip(&mut there).filter(|(_, is_there)| !**is_there) {
        *is_there = run_command(pip(python).args(names(set))).is_ok();
    }
    there
}

fn pip(python: &Path) -> Command {
    let mut pip = Command::new(python);
    pip.args(["-m", "pip", "--disable-pip-version-check", "install", "--quiet"]);
    pip
}

/// Where the environment and the package are.
fn folder() -> PathBuf {
    target_folder().join("python")
}

/// Runs the tests in an environment. The package is put together from the library that the other tests have built; `slow` builds a
/// wheel instead, in release, and installs it.
pub(crate) fn run(environment: &Environment, list: &Path, slow: bool) -> Result<(), Failure> {
    let own = &environment.python;
    build_all(list)?;
    let source = root().join("crates/fantex-python");
    let mut tests = Command::new(own);
    let package = folder().join("package");
    if slow {
        run_command(pip(own).args(["--force-reinstall", "--no-deps"]).arg(&source))?;
    } else {
        assemble(&source, &package)?;
        tests.env("PYTHONPATH", &package);
    }
    if let Some(data) = data_folder() {
        tests.env("FANTEX_DATA", data);
    }
    tests.env(
        "FANTEX_PROGRAM",
        target_folder().join("debug").join(format!("fantex{}", std::env::consts::EXE_SUFFIX)),
    );
    tests.args(PYTEST).current_dir(&source);
    if environment.is_parallel {
        // Who has nothing left takes tests from others.
        tests.args(["--dist", "worksteal", "-n"]).arg(threads().to_string());
    }
    eprintln!("> python -m pytest");
    let result = run_command(&mut tests);
    // Blender as a module is large, and for one version of Python only.
    let Some(blender) = std::env::var_os("FANTEX_BPY") else {
        skip(list, "no Python with bpy, numpy and pytest for Blender's extension (FANTEX_BPY)")?;
        return result;
    };
    assemble(&source, &package)?;
    let mut tests = Command::new(blender);
    tests.args(PYTEST).env("PYTHONPATH", &package).current_dir(root().join("blender"));
    result.and(run_command(&mut tests))
}

/// Nothing is left in the source.
const PYTEST: [&str; 7] = ["-B", "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider"];

fn interpreter() -> Option<PathBuf> {
    let given = std::env::var_os("FANTEX_PYTHON").map(PathBuf::from);
    let known = ["python3", "python"].map(PathBuf::from);
    let is_new = "import sys; sys.exit(sys.version_info < (3, 10))";
    given.into_iter().chain(known).find(|python| succeeds(Command::new(python).args(["-c", is_new])))
}

fn skip(list: &Path, reason: &str) -> Result<(), Failure> {
    eprintln!("skipped: the tests of the Python package ({reason})");
    let failed = |error| Failure(format!("cannot write {}: {error}", list.display()));
    let mut file = fs::OpenOptions::new().create(true).append(true).open(list).map_err(failed)?;
    writeln!(file, "{reason}").map_err(failed)
}

/// The folder that holds the package: its Python files and the library, as a wheel has them.
fn assemble(source: &Path, folder: &Path) -> Result<(), Failure> {
    let (built, named) = match std::env::consts::OS {
        "windows" => ("_native.dll", "_native.pyd"),
        "macos" => ("lib_native.dylib", "_native.abi3.so"),
        _ => ("lib_native.so", "_native.abi3.so"),
    };
    let package = folder.join("fantex");
    let failed = |error: std::io::Error| Failure(format!("cannot make {}: {error}", package.display()));
    let copy = || {
        fs::create_dir_all(&package)?;
        for file in source.join("python/fantex").read_dir()? {
            let file = file?;
            if file.file_type()?.is_file() {
                fs::copy(file.path(), package.join(file.file_name()))?;
            }
        }
        fs::copy(target_folder().join("debug").join(built), package.join(named))
    };
    copy().map(drop).map_err(failed)
}
