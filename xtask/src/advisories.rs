//! Known faults of dependencies, by a copy of RustSec's advisory database.

use std::fs;
use std::path::Path;

use semver::{Version, VersionReq};
use toml::{Table, Value};

use crate::shell::{Failure, root};

/// Names the folder of the database.
const FOLDER: &str = "FANTEX_ADVISORIES";

/// Compares `Cargo.lock` with the database: faults fail, crates that nobody maintains are listed. Without a database it says so.
pub(crate) fn check() -> Result<(), Failure> {
    let Some(folder) = std::env::var_os(FOLDER) else {
        eprintln!(
            "> advisories: SKIPPED, no database. git clone https://github.com/rustsec/advisory-db and set {FOLDER} to its folder"
        );
        return Ok(());
    };
    let crates = Path::new(&folder).join("crates");
    if !crates.is_dir() {
        return Err(Failure(format!(
            "{FOLDER} names {}, which has no folder crates",
            Path::new(&folder).display()
        )));
    }
    let lock = table(&read(&root().join("Cargo.lock"))?, "Cargo.lock")?;
    let packages = lock.get("package").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let (mut count, mut faults) = (0, Vec::new());
    for package in
        packages.iter().filter_map(Value::as_table).filter(|package| package.contains_key("source"))
    {
        let text = |key: &str| package.get(key).and_then(Value::as_str).unwrap_or_default();
        let (name, version) = (text("name"), text("version"));
        let Ok(entries) = crates.join(name).read_dir() else { continue };
        let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
        paths.sort();
        for path in paths {
            count += 1;
            let advisory = advisory(&read(&path)?, &path.display().to_string())?;
            if !is_affected(&advisory, version)? {
                continue;
            }
            let id = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
            let kind = advisory["advisory"].get("informational").and_then(Value::as_str);
            match kind {
                Some(kind @ ("unmaintained" | "notice")) => eprintln!("{name} {version}: {kind} ({id})"),
                _ => faults.push(format!("{name} {version} ({id})")),
            }
        }
    }
    eprintln!(
        "> advisories: {} packages, {count} advisories about them, {} apply",
        packages.len(),
        faults.len()
    );
    if faults.is_empty() { Ok(()) } else { Err(Failure(format!("known faults: {}", faults.join(", ")))) }
}

fn read(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path).map_err(|e| Failure(format!("cannot read {}: {e}", path.display())))
}

fn table(text: &str, name: &str) -> Result<Table, Failure> {
    text.parse().map_err(|e| Failure(format!("{name}: {e}")))
}

/// The TOML with which an advisory begins.
fn advisory(text: &str, name: &str) -> Result<Table, Failure> {
    let parts: Vec<&str> = text.splitn(3, "```").collect();
    let toml = parts.get(1).and_then(|part| part.strip_prefix("toml"));
    let table = table(toml.ok_or_else(|| Failure(format!("{name} does not begin with TOML")))?, name)?;
    match table.contains_key("advisory") {
        true => Ok(table),
        false => Err(Failure(format!("{name} has no table advisory"))),
    }
}

/// Whether a version is neither patched nor unaffected, and the advisory stands.
fn is_affected(advisory: &Table, version: &str) -> Result<bool, Failure> {
    let failed = |e: semver::Error| Failure(format!("version {version}: {e}"));
    let version = Version::parse(version).map_err(failed)?;
    let versions = advisory.get("versions");
    let mut safe = false;
    for key in ["patched", "unaffected"] {
        let list = versions.and_then(|versions| versions.get(key)).and_then(Value::as_array);
        for requirement in list.into_iter().flatten().filter_map(Value::as_str) {
            safe |= VersionReq::parse(requirement).map_err(failed)?.matches(&version);
        }
    }
    Ok(!safe && advisory["advisory"].get("withdrawn").is_none())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patched_and_unaffected_versions_are_told_apart() {
        let text = "```toml\n[advisory]\nid = \"R\"\n[versions]\npatched = [\">= 1.2.3\", \">= 0.9.5, < 0.10.0\"]\nunaffected = [\"< 0.5\"]\n```\n# Title\n";
        let advisory = advisory(text, "R.md").unwrap();
        let affected = ["0.4.9", "0.5.0", "0.9.5", "0.10.0", "1.2.2", "1.2.3"]
            .map(|version| is_affected(&advisory, version).unwrap());
        assert_eq!(affected, [false, true, false, true, true, false]);
        let withdrawn = super::advisory(&text.replace("id", "withdrawn = 2024-01-01\nid"), "R.md").unwrap();
        assert!(!is_affected(&withdrawn, "1.0.0").unwrap());
        assert!(super::advisory("# no table", "R.md").is_err());
    }
}
