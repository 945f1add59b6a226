//! Which crate may use which: downwards only, siblings never name each other.

use serde_json::Value;

use crate::shell::{Failure, capture, cargo_command};

/// The crate that every other one may use.
const BASE: &str = "fantex-base";

/// Every crate of the workspace with those that it may depend on. Test-only dependencies are free: siblings meet in tests.
const ALLOWED: &[(&str, &[&str])] = &[
    (BASE, &[]),
    ("fantex-mesh", &[]),
    ("fantex-look", &[]),
    ("fantex-texture", &["fantex-mesh", "fantex-look"]),
    ("fantex-cover", &["fantex-mesh"]),
    ("fantex-store", &["fantex-mesh", "fantex-texture", "fantex-cover"]),
    ("fantex-bake", &["fantex-mesh", "fantex-texture", "fantex-cover", "fantex-store"]),
    ("fantex-scene", &["fantex-mesh", "fantex-texture"]),
    ("fantex-stream", &["fantex-mesh", "fantex-cover", "fantex-store"]),
    ("fantex-render", &["fantex-mesh", "fantex-texture", "fantex-cover", "fantex-store", "fantex-scene"]),
    ("fantex-paint", &["fantex-mesh", "fantex-look", "fantex-texture", "fantex-cover", "fantex-store"]),
    ("fantex-export", &["fantex-mesh", "fantex-texture", "fantex-cover", "fantex-store", "fantex-bake"]),
    ("fantex-photos", &["fantex-mesh", "fantex-texture", "fantex-store", "fantex-bake"]),
    (
        "fantex-gpu",
        &["fantex-mesh", "fantex-texture", "fantex-cover", "fantex-store", "fantex-scene", "fantex-stream"],
    ),
    (
        "fantex",
        &[
            "fantex-mesh",
            "fantex-look",
            "fantex-texture",
            "fantex-cover",
            "fantex-store",
            "fantex-bake",
            "fantex-scene",
            "fantex-stream",
            "fantex-render",
            "fantex-gpu",
            "fantex-paint",
            "fantex-photos",
            "fantex-export",
        ],
    ),
    ("fantex-cli", &["fantex"]),
    (
        "fantex-app",
        &[
            "fantex",
            "fantex-mesh",
            "fantex-texture",
            "fantex-cover",
            "fantex-store",
            "fantex-bake",
            "fantex-scene",
            "fantex-stream",
            "fantex-gpu",
            "fantex-paint",
        ],
    ),
    // Never shipped: may use everything.
    (
        "fantex-bench",
        &["fantex-mesh", "fantex-cover", "fantex-store", "fantex-stream", "fantex-gpu", "fantex"],
    ),
    // Only tests use it.
    ("fantex-test", &["fantex-mesh"]),
    ("xtask", &[]),
];

/// Compares the workspace with the table.
pub(crate) fn check_directions() -> Result<(), Failure> {
    eprintln!("> direction of the crates");
    let text = capture(&mut cargo_command(&["metadata", "--format-version", "1", "--no-deps"]))?;
    let metadata: Value =
        serde_json::from_str(&text).map_err(|e| Failure(format!("cannot read cargo's metadata: {e}")))?;
    let packages = metadata["packages"].as_array().ok_or_else(|| Failure::new("cargo names no packages"))?;
    let wrong: Vec<String> = packages.iter().flat_map(wrong_dependencies).collect();
    if wrong.is_empty() { Ok(()) } else { Err(Failure(wrong.join("; "))) }
}

fn wrong_dependencies(package: &Value) -> Vec<String> {
    let name = package["name"].as_str().unwrap_or_default();
    let Some((_, allowed)) = ALLOWED.iter().find(|(known, _)| *known == name) else {
        return vec![format!("{name} is not in the table of crates; add it to xtask/src/crates.rs")];
    };
    let empty = Vec::new();
    let dependencies = package["dependencies"].as_array().unwrap_or(&empty);
    dependencies
        .iter()
        .filter(|dependency| dependency["kind"] != "dev")
        .filter_map(|dependency| dependency["name"].as_str())
        .filter(|used| {
            *used != BASE && ALLOWED.iter().any(|(known, _)| known == used) && !allowed.contains(used)
        })
        .map(|used| format!("{name} must not depend on {used}"))
        .collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn package(name: &str, dependency: &str, kind: Value) -> Value {
        json!({ "name": name, "dependencies": [{ "name": dependency, "kind": kind }] })
    }

    #[test]
    fn upwards_and_sideways_is_wrong() {
        assert_eq!(
            wrong_dependencies(&package("fantex-render", "fantex-bake", Value::Null)),
            ["fantex-render must not depend on fantex-bake"]
        );
        assert_eq!(wrong_dependencies(&package("fantex-mesh", "fantex-cover", Value::Null)).len(), 1);
        assert_eq!(wrong_dependencies(&package("fantex-new", "glam", Value::Null)).len(), 1);
    }

    #[test]
    fn downwards_foreign_and_tests_are_right() {
        assert!(wrong_dependencies(&package("fantex-bake", "fantex-mesh", Value::Null)).is_empty());
        assert!(wrong_dependencies(&package("fantex-mesh", "glam", Value::Null)).is_empty());
        assert!(wrong_dependencies(&package("fantex-render", "fantex-bake", json!("dev"))).is_empty());
    }
}
