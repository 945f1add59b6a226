//! What tests of several subjects share.

use std::path::Path;

use fantex_base::Result;
use fantex_mesh::{LoadOptions, Model, load, load_bytes};

pub(crate) use fantex_test::data_folder;

/// The projective plane of six vertices: half of an icosahedron.
pub(crate) const PROJECTIVE_PLANE: [[u32; 3]; 10] = [
    [0, 1, 2],
    [0, 2, 3],
    [0, 3, 4],
    [0, 4, 5],
    [0, 5, 1],
    [1, 2, 4],
    [2, 3, 5],
    [3, 4, 1],
    [4, 5, 2],
    [5, 1, 3],
];

/// Loads the first file, with the others beside it (in a temporary folder; a single file needs none).
pub(crate) fn load_files(files: &[(&str, &[u8])]) -> Result<Model> {
    load_files_with(files, &LoadOptions::default())
}

pub(crate) fn load_files_with(files: &[(&str, &[u8])], options: &LoadOptions) -> Result<Model> {
    if let [(name, bytes)] = files {
        return load_bytes(Path::new(name), bytes, options);
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    load(&folder.path().join(files[0].0), options)
}

pub(crate) fn load_text(name: &str, text: &str) -> Result<Model> {
    load_files(&[(name, text.as_bytes())])
}

/// The message of the error that loading must end with: one line that names the file.
pub(crate) fn message(name: &str, bytes: &[u8]) -> String {
    let error = load_files(&[(name, bytes)]).expect_err("must be refused");
    let message = error.to_string();
    assert!(message.contains(name), "does not name the file: {message}");
    assert!(!message.contains('\n'), "more than one line: {message}");
    message
}

/// Asserts that a message names all of these.
#[track_caller]
pub(crate) fn assert_mentions(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "lacks {part:?}: {message}");
    }
}

/// Indices in range and attribute arrays of the right length and content, as `Model` promises.
#[track_caller]
pub(crate) fn assert_consistent(model: &Model) {
    let corners = 3 * model.triangles.len();
    assert!(!model.triangles.is_empty());
    assert!(model.triangles.iter().flatten().all(|&v| (v as usize) < model.positions.len()));
    let attributes = &model.corners;
    for length in [attributes.normals.len(), attributes.colors.len(), attributes.tangents.len()] {
        assert!(length == 0 || length == corners, "{length} of {corners}");
    }
    assert!(attributes.uv_sets.iter().all(|set| set.len() == corners));
    assert!(attributes.normals.iter().all(|n| n.is_normalized()));
    assert!(attributes.tangents.iter().all(|t| t.truncate().is_normalized() && t.w.abs() == 1.0));
    assert!(!model.materials.is_empty());
    let materials = &model.triangle_materials;
    assert!(materials.is_empty() || materials.len() == model.triangles.len());
    assert!(materials.iter().all(|&m| (m as usize) < model.materials.len()));
    for material in &model.materials {
        let textures = [
            &material.base_color_texture,
            &material.metallic_roughness_texture,
            &material.normal_texture,
            &material.occlusion_texture,
            &material.emission_texture,
        ];
        for texture in textures.into_iter().flatten() {
            assert!(texture.image < model.images.len());
            assert!(texture.uv_set < attributes.uv_sets.len());
        }
    }
}

/// A glTF document with one buffer as a data URI.
pub(crate) fn gltf_with_buffer(json: &str, buffer: &[u8]) -> String {
    use base64::Engine as _;
    let data = base64::engine::general_purpose::STANDARD.encode(buffer);
    let uri = format!(
        r#""buffers":[{{"byteLength":{},"uri":"data:application/octet-stream;base64,{data}"}}]"#,
        buffer.len()
    );
    format!(r#"{{"asset":{{"version":"2.0"}},{uri},{json}}}"#)
}

/// A GLB container around JSON and binary data.
pub(crate) fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    out
}

/// Little-endian bytes of floats.
pub(crate) fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}
