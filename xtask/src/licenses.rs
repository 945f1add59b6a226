//! Licences of what the programs are made of: that they are allowed, and the notices to be shipped with binaries.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::shell::{self, Failure, capture, cargo_command, root, succeeds};

/// The crates whose programs are shipped.
const PROGRAMS: [&str; 3] = ["fantex-cli", "fantex-app", "fantex-python"];

/// What programs carry and print.
const NOTICES: &str = "assets/NOTICES.txt";

/// Beginnings of the names of files with licences and notices.
const NAMES: [&str; 6] = ["license", "licence", "copying", "notice", "unlicense", "ofl"];

/// Files with licences of what is shipped but is no crate.
const OWN: [&str; 4] = ["LICENSE-MIT", "LICENSE-APACHE", "assets/LICENSES.md", "assets/LICENSE-VTKData.txt"];

/// Checks every dependency's licence against `deny.toml`; by `cargo deny`, sources too, where it is installed.
pub(crate) fn check() -> Result<(), Failure> {
    eprintln!("> licences of dependencies");
    let (allowed, packages) = (allowed()?, packages()?);
    let refused: Vec<String> = packages
        .iter()
        .filter(|package| !is_allowed(&package.license, &allowed))
        .map(|package| format!("{} {} ({})", package.name, package.version, package.license))
        .collect();
    if !refused.is_empty() {
        return Err(Failure(format!("licences that deny.toml does not allow: {}", refused.join(", "))));
    }
    if fs::read_to_string(root().join(NOTICES)).unwrap_or_default() != notices(&packages)? {
        return Err(Failure(format!(
            "{NOTICES} is not that of Cargo.lock; write it anew: cargo xtask notices"
        )));
    }
    if succeeds(&mut cargo_command(&["deny", "--version"])) {
        return shell::cargo(&["deny", "check", "licenses", "bans", "sources"]);
    }
    eprintln!("cargo deny is not installed: sources and duplicates are not checked");
    Ok(())
}

/// Writes the notices that programs carry.
pub(crate) fn write_notices() -> Result<(), Failure> {
    let text = notices(&packages()?)?;
    fs::write(root().join(NOTICES), text).map_err(|e| Failure(format!("cannot write {NOTICES}: {e}")))
}

/// The notices of all crates in the programs, each text once.
fn notices(packages: &[Package]) -> Result<String, Failure> {
    let mut crates_of_text: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut without = Vec::new();
    for package in packages {
        let name = format!("{} {} ({})", package.name, package.version, package.license);
        let texts = texts_below(Path::new(&package.folder), 2);
        if texts.is_empty() {
            without.push(name.clone());
        }
        texts.into_iter().for_each(|text| {
            crates_of_text.entry(text).or_default().insert(name.clone());
        });
    }
    let mut notices = "Licences of what fantex is made of\n".to_owned();
    for own in OWN {
        let text =
            fs::read_to_string(root().join(own)).map_err(|e| Failure(format!("cannot read {own}: {e}")))?;
        section(&mut notices, "fantex, its models, images and volumes", &text);
    }
    for (text, crates) in &crates_of_text {
        section(&mut notices, &crates.iter().cloned().collect::<Vec<_>>().join("\n"), text);
    }
    if !without.is_empty() {
        section(
            &mut notices,
            &without.join("\n"),
            "under the licence named; their packages hold no text of it",
        );
    }
    Ok(notices)
}

fn section(notices: &mut String, heading: &str, text: &str) {
    // Writing to a string does not fail.
    writeln!(notices, "\n{}\n{heading}\n\n{}", "=".repeat(80), text.trim()).unwrap_or_default();
}

/// The texts of licences in a folder, and so many folders deep (fonts have theirs beside them).
fn texts_below(folder: &Path, depth: u32) -> Vec<String> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    let mut texts = Vec::new();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if path.is_dir() && depth > 0 && (name.contains("font") || name.contains("license")) {
            texts.extend(texts_below(&path, depth - 1));
        } else if NAMES
            .iter()
            .any(|start| name.starts_with(start) || name.ends_with(&format!("-{start}.txt")))
        {
            texts.extend(fs::read_to_string(&path).ok().map(|text| text.replace("\r\n", "\n")));
        }
    }
    texts
}

struct Package {
    name: String,
    version: String,
    license: String,
    folder: String,
}

/// All packages of others that are linked into the programs, on any system.
fn packages() -> Result<Vec<Package>, Failure> {
    let text =
        capture(&mut cargo_command(&["metadata", "--format-version", "1", "--locked", "--all-features"]))?;
    let metadata: Value =
        serde_json::from_str(&text).map_err(|e| Failure(format!("cargo's metadata: {e}")))?;
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let nodes: BTreeMap<String, Value> =
        list(&metadata["resolve"]["nodes"]).into_iter().map(|node| (word(&node["id"]), node)).collect();
    let packages = list(&metadata["packages"]);
    let mut open: Vec<String> = packages
        .iter()
        .filter(|package| PROGRAMS.contains(&package["name"].as_str().unwrap_or_default()))
        .map(|package| word(&package["id"]))
        .collect();
    let mut linked = BTreeSet::new();
    while let Some(id) = open.pop() {
        let dependencies = nodes.get(&id).map(|node| list(&node["deps"])).unwrap_or_default();
        if !linked.insert(id) {
            continue;
        }
        // Those of tests and build scripts are not linked.
        let is_linked =
            |dependency: &Value| list(&dependency["dep_kinds"]).iter().any(|k| k["kind"].is_null());
        open.extend(dependencies.iter().filter(|d| is_linked(d)).map(|d| word(&d["pkg"])));
    }
    let of_others = packages.iter().filter(|p| linked.contains(&word(&p["id"])) && !p["source"].is_null());
    Ok(of_others
        .map(|package| Package {
            name: word(&package["name"]),
            version: word(&package["version"]),
            license: word(&package["license"]),
            folder: Path::new(&word(&package["manifest_path"]))
                .parent()
                .unwrap_or(Path::new(""))
                .display()
                .to_string(),
        })
        .collect())
}

/// The licences that `deny.toml` lists under `allow`.
fn allowed() -> Result<BTreeSet<String>, Failure> {
    let text = fs::read_to_string(root().join("deny.toml"))
        .map_err(|e| Failure(format!("cannot read deny.toml: {e}")))?;
    let list =
        text.split_once("allow = [").and_then(|(_, rest)| rest.split_once(']')).map_or("", |(list, _)| list);
    Ok(list.split('"').skip(1).step_by(2).map(str::to_owned).collect())
}

/// Whether one of the alternatives of an expression in disjunctive form asks for allowed licences only.
fn is_allowed(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let plain = expression.replace(['(', ')'], "").replace('/', " OR ");
    // Parentheses stand around alternatives only: every part of a conjunction needs one.
    match expression.contains(") AND ") || expression.contains(" AND (") {
        true => plain.split(" AND ").all(|part| part.split(" OR ").any(|one| allowed.contains(one.trim()))),
        false => plain.split(" OR ").any(|part| part.split(" AND ").all(|one| allowed.contains(one.trim()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_alternative_must_be_allowed_as_a_whole() {
        let allowed: BTreeSet<String> = ["MIT", "Apache-2.0", "Unicode-3.0"].map(str::to_owned).into();
        for good in
            ["MIT", "MIT OR GPL-3.0", "GPL-2.0/MIT", "(MIT OR GPL-3.0) AND Unicode-3.0", "MIT AND Apache-2.0"]
        {
            assert!(is_allowed(good, &allowed), "{good}");
        }
        for bad in ["", "GPL-3.0", "MIT AND GPL-3.0", "(MIT OR Apache-2.0) AND GPL-3.0"] {
            assert!(!is_allowed(bad, &allowed), "{bad}");
        }
    }
}
