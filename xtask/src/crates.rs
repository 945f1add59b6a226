//! Which crate may use which: downwards only, siblings never name each other.

use serde_json::Value;

use crate::shell::{Failure, capture, cargo_command};

/// The crate that every other one may use.
const BASE: &str = "fantex-base";

/// Every crate of the workspace: what it owns, and which others of `fantex-...` it may depend on (`*` for all). Test-only
/// dependencies are free: siblings meet in tests.
const CRATES: &str = "
    fantex-base    | errors, random numbers, boxes, the sRGB curve: what no crate owns |
    fantex-mesh    | loading, cleaning, fans, normals and tangents, rays, generators, writing |
    fantex-texture | images, filters, mappings, environments, noise, solids, comparison of pictures | mesh
    fantex-cover   | partial fans, groups, tile maps, the texture function's weights | mesh
    fantex-store   | the .fan file, block codecs, page cache, sampler, commits, verification | mesh texture cover
    fantex-scene   | cameras, lights, surroundings, tone mapping: what renderers are given | mesh texture
    fantex-bake    | sources to tiles, light maps, transfer between meshes | mesh texture cover store scene
    fantex-look    | looks: files, JSON schema, checks with lines, textures and materials made of them | mesh texture store scene
    fantex-stream  | asynchronous reading, demand, residency, the index of a world | mesh cover store
    fantex-render  | the CPU renderer, the reference | mesh texture cover store scene
    fantex-gpu     | the GPU renderer on wgpu | mesh texture cover store scene stream
    fantex-paint   | brushes, strokes, layers, history, replay | mesh look texture cover store
    fantex-export  | UV atlases, glTF with textures, single pictures | mesh texture cover store bake
    fantex-photos  | photographs with cameras as a source | mesh texture store bake
    fantex         | the front door of the library | *
    fantex-assets  | the models and images of the gallery |
    fantex-bottle  | the model of the demo |
    fantex-gallery | the looks of the gallery |
    fantex-web     | the viewer for browsers, and the files of its page | scene store stream gpu
    fantex-three   | the core of the npm package for three.js | mesh store stream
    fantex-cli     | the command line | fantex assets bottle gallery web
    fantex-app     | the window: viewer and painter | fantex assets
    fantex-python  | the Python package | fantex assets
    fantex-bench   | benchmarks, simulators and faulty disks; not shipped | *
    fantex-test    | test data and meshes for tests of several crates; not shipped | mesh
    xtask          | development chores; not shipped |";

/// Names of crates, and what they may depend on.
fn crates() -> impl Iterator<Item = (&'static str, Vec<&'static str>)> {
    CRATES.lines().filter_map(|line| {
        let mut columns = line.split('|');
        Some((columns.next()?.trim(), columns.nth(1)?.split_whitespace().collect()))
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
