//! The tests of the Python package.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::shell::{Failure, data_folder, root, run as run_command, succeeds};
use crate::test::{run_cargo, target_folder};

/// What the tests import.
const PACKAGES: [(&str, &str); 4] =
    [("pytest", "pytest"), ("numpy", "numpy"), ("trimesh", "trimesh"), ("pillow", "PIL")];

/// Runs the tests with a virtual environment in the target folder. Without Python 3.10 or the packages they are left out, and `list`
/// says so. The package is put together from the library that the other tests have built; `slow` builds a wheel instead, in release,
/// and installs it.
pub(crate) fn run(list: &Path, slow: bool) -> Result<(), Failure> {
    let Some(python) = interpreter() else { return skip(list, "no Python 3.10 or later") };
    let folder = target_folder().join("python");
    let environment = folder.join("environment");
    let own = environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    if !succeeds(Command::new(&own).arg("--version"))
        && run_command(Command::new(&python).args(["-m", "venv"]).arg(&environment)).is_err()
    {
        return skip(list, "Python cannot make a virtual environment");
    }
    let pip = || {
        let mut pip = Command::new(&own);
        pip.args(["-m", "pip", "--disable-pip-version-check", "install", "--quiet"]);
        pip
    };
    let imports: Vec<String> = PACKAGES.iter().map(|(_, module)| format!("import {module}")).collect();
    if !succeeds(Command::new(&own).arg("-c").arg(imports.join("\n")))
        && run_command(pip().args(PACKAGES.iter().map(|(package, _)| package))).is_err()
    {
        return skip(list, "no numpy, pytest, trimesh and pillow for Python");
    }
    let source = root().join("crates/fantex-python");
    let mut tests = Command::new(&own);
    if slow {
        run_command(pip().args(["--force-reinstall", "--no-deps"]).arg(&source))?;
    } else {
        let package = assemble(&source, &folder.join("package"), list)?;
        tests.env("PYTHONPATH", package);
    }
    if let Some(data) = data_folder() {
        tests.env("FANTEX_DATA", data);
    }
    // Nothing is left in the source.
    tests.args(["-B", "-m", "pytest", "-q", "-p", "no:cacheprovider"]).current_dir(&source);
    eprintln!("> python -m pytest");
    run_command(&mut tests)
}

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
fn assemble(source: &Path, folder: &Path, list: &Path) -> Result<PathBuf, Failure> {
    run_cargo(&["build", "--workspace", "--lib"], list)?;
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
    copy().map_err(failed)?;
    Ok(folder.to_owned())
}
