//! Every shipped model loads with the expected number of triangles.

use std::path::{Path, PathBuf};

use fantex_mesh::{LoadOptions, Model, load};

/// The folder of test data: `FANTEX_DATA`, or `../shared/data` beside the workspace.
fn data_folder() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("FANTEX_DATA").map_or_else(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no test data at {} (set FANTEX_DATA)", folder.display());
    None
}

/// Indices in range and attribute arrays of the right length and content, as `Model` promises.
fn assert_consistent(model: &Model, name: &str) {
    let corners = 3 * model.triangles.len();
    assert!(!model.triangles.is_empty(), "{name}");
    assert!(model.triangles.iter().flatten().all(|&v| (v as usize) < model.positions.len()), "{name}");
    let attributes = &model.corners;
    for length in [attributes.normals.len(), attributes.colors.len(), attributes.tangents.len()] {
        assert!(length == 0 || length == corners, "{name}: {length} of {corners}");
    }
    assert!(attributes.uv_sets.iter().all(|set| set.len() == corners), "{name}");
    assert!(attributes.normals.iter().all(|n| n.is_normalized()), "{name}");
    assert!(attributes.tangents.iter().all(|t| t.truncate().is_normalized() && t.w.abs() == 1.0), "{name}");
    assert!(attributes.colors.iter().all(|c| c.is_finite()), "{name}");
    assert!(!model.materials.is_empty(), "{name}");
    let materials = &model.triangle_materials;
    assert!(materials.is_empty() || materials.len() == model.triangles.len(), "{name}");
    assert!(materials.iter().all(|&m| (m as usize) < model.materials.len()), "{name}");
    for material in &model.materials {
        let textures = [
            &material.base_color_texture,
            &material.metallic_roughness_texture,
            &material.normal_texture,
            &material.occlusion_texture,
            &material.emission_texture,
        ];
        for texture in textures.into_iter().flatten() {
            assert!(texture.image < model.images.len(), "{name}");
            assert!(texture.uv_set < attributes.uv_sets.len(), "{name}");
        }
    }
}

/// Triangle counts of `MESHES.tsv` are those of another loader (trimesh).
#[test]
fn all_shipped_models_have_the_known_triangle_counts() {
    let Some(folder) = data_folder() else { return };
    let table = std::fs::read_to_string(folder.join("MESHES.tsv")).unwrap();
    let mut rows = table.lines();
    let columns: Vec<&str> = rows.next().unwrap().split('\t').collect();
    let faces = columns.iter().position(|c| *c == "faces").unwrap();
    let mut wrong = Vec::new();
    let mut count = 0;
    for row in rows {
        let fields: Vec<&str> = row.split('\t').collect();
        let model = load(&folder.join(fields[0]), &LoadOptions::default()).unwrap();
        println!("{}: {:?}", fields[0], model.notes);
        assert_consistent(&model, fields[0]);
        let expected: usize = fields[faces].parse().unwrap();
        if model.triangles.len() != expected {
            wrong.push(format!("{}: {} triangles, not {expected}", fields[0], model.triangles.len()));
        }
        count += 1;
    }
    assert!(count >= 29, "only {count} models");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
