//! Which crate may use which: downwards only, siblings never name each other.

use serde_json::Value;

use crate::shell::{Failure, capture, cargo_command};

/// The crate that every other one may use.
const BASE: &str = "fantex-base";

/// Every crate of the workspace, and which others of `fantex-...` it may depend on (`*` for all). Test-only dependencies are free: siblings
/// meet in tests. `ARCHITECTURE.md` says what each owns.
const CRATES: &str = "
    fantex-base    |
    fantex-mesh    |
    fantex-texture | mesh
    fantex-cover   | mesh
    fantex-store   | mesh texture cover
    fantex-scene   | mesh texture
    fantex-bake    | mesh texture cover store scene
    fantex-look    | mesh texture store scene
    fantex-stream  | mesh cover store
    fantex-render  | mesh texture cover store scene
    fantex-gpu     | mesh texture cover store scene stream
    fantex-paint   | mesh look texture cover store
    fantex-export  | mesh texture cover store bake
    fantex-photos  | mesh texture store bake
    fantex         | *
    fantex-assets  |
    fantex-bottle  |
    fantex-gallery |
    fantex-web     | scene store stream gpu
    fantex-three   | mesh store stream
    fantex-cli     | fantex assets bottle gallery web
    fantex-app     | fantex assets
    fantex-python  | fantex assets
    fantex-bench   | *
    fantex-test    | mesh
    xtask          |";

/// Names of crates, and what they may depend on.
fn crates() -> impl Iterator<Item = (&'static str, Vec<&'static str>)> {
    CRATES.lines().filter_map(|line| {
        let mut columns = line.split('|');
        Some((columns.next()?.trim(), columns.next()?.split_whitespace().collect()))
    })
}

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
    let Some((_, allowed)) = crates().find(|(known, _)| *known == name) else {
        return vec![format!("{name} is not in the table of crates; add it to xtask/src/crates.rs")];
    };
    let empty = Vec::new();
    let dependencies = package["dependencies"].as_array().unwrap_or(&empty);
    dependencies
        .iter()
        .filter(|dependency| dependency["kind"] != "dev")
        .filter_map(|dependency| dependency["name"].as_str())
        .filter(|used| *used != BASE && crates().any(|(known, _)| known == *used))
        .filter(|used| !allowed.iter().any(|one| *one == "*" || used.trim_start_matches("fantex-") == *one))
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
