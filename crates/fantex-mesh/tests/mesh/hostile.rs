//! Damaged and hostile files: never a panic, never for long, always one clear sentence.

use crate::common::*;
use fantex_mesh::{LoadLimits, LoadOptions};
use proptest::prelude::*;

/// A small file of each kind that uses much of its format.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let gltf_parts = r#""scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"scale":[-1,2,1],"children":[1]},{"mesh":0,"translation":[5,0,0]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1,"COLOR_0":2},"indices":3,"material":0},{"attributes":{"POSITION":0},"mode":5}]}],"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0,"sampler":0}],"samplers":[{"wrapS":33071}],"images":[{"bufferView":1}],"bufferViews":[{"buffer":0,"byteLength":120},{"buffer":0,"byteOffset":48,"byteLength":8},{"buffer":0,"byteOffset":80,"byteLength":12}],"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","sparse":{"count":1,"indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":0}}},{"bufferView":0,"byteOffset":48,"componentType":5126,"count":4,"type":"VEC2"},{"bufferView":0,"byteOffset":80,"componentType":5121,"normalized":true,"count":4,"type":"VEC4"},{"bufferView":0,"byteOffset":96,"componentType":5123,"count":6,"type":"SCALAR"}]"#;
    let mut buffer = floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.]);
    buffer.extend(floats(&[0., 0., 1., 0., 0., 1., 1., 1.]));
    buffer.extend([0u8; 16]);
    buffer.extend([0u16, 1, 2, 2, 1, 3].into_iter().flat_map(u16::to_le_bytes));
    buffer.resize(120, 0);
    let glb_json =
        format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":120}}],{gltf_parts}}}"#);

    let obj = "mtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 1\nv .5 .5 0 0 0 0\nvt 0 0\nvt 1 0\nvn 0 0 1\nusemtl red\nf 1/1/1 2/2/1 3//1 \\\n 4//1 5\nf -1 -2 -3\nl 1 2\n";
    let ply_header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nelement extra 1\nproperty list int double stuff\nend_header\n"
        )
    };
    let ascii_ply = ply_header("ascii")
        + "0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 0 0 255\n0 1 0 9 9 9\n4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 0\n2 1 2\n";
    let mut binary_ply = ply_header("binary_little_endian").into_bytes();
    for corner in [[0.0f32, 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]] {
        binary_ply.extend(floats(&corner));
        binary_ply.extend([255, 0, 7]);
    }
    binary_ply.push(4);
    binary_ply.extend([0i32, 1, 2, 3].into_iter().flat_map(i32::to_le_bytes));
    binary_ply.push(8);
    binary_ply.extend(floats(&[0., 0., 1., 0., 1., 1., 0., 1.]));
    binary_ply.push(3);
    binary_ply.extend([0i32, 1, 2].into_iter().flat_map(i32::to_le_bytes));
    binary_ply.push(0);
    binary_ply.extend(1i32.to_le_bytes());
    binary_ply.extend(2.0f64.to_le_bytes());

    let ascii_stl = "solid a b\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0\n  endloop\n endfacet\nendsolid a b\n";
    vec![
        ("a.gltf", gltf_with_buffer(gltf_parts, &buffer).into_bytes()),
        ("a.glb", glb(&glb_json, &buffer)),
        ("a.obj", obj.into()),
        ("ascii.ply", ascii_ply.into()),
        ("binary.ply", binary_ply),
        ("ascii.stl", ascii_stl.into()),
        ("binary.stl", binary_stl(2)),
        ("draco.glb", include_bytes!("../data/torus_draco_edgebreaker.glb").to_vec()),
        ("meshopt.glb", include_bytes!("../data/torus_meshopt_khr.glb").to_vec()),
    ]
}

/// Begins with the word solid, as many real files do.
fn binary_stl(facets: u32) -> Vec<u8> {
    let mut bytes = b"solid but binary facet".to_vec();
    bytes.resize(80, 0);
    bytes.extend(facets.to_le_bytes());
    for facet in 0..facets {
        bytes.extend(floats(&[0., 0., 0., facet as f32, 0., 0., 1., 0., 0., 0., 1., 0.]));
        bytes.extend([0, 0]);
    }
    bytes
}

#[test]
fn the_samples_are_sound() {
    for (name, bytes) in samples() {
        let model = load_files(&[(name, &bytes)]).unwrap_or_else(|e| panic!("{e}"));
        assert_consistent(&model);
    }
}

#[test]
fn files_cut_off_at_any_byte_are_refused_or_sound() {
    for (name, bytes) in samples() {
        for length in 0..bytes.len() {
            match load_files(&[(name, &bytes[..length])]) {
                Ok(model) => assert_consistent(&model),
                Err(error) => assert!(error.to_string().contains(name), "{error}"),
            }
        }
    }
}

/// Formats that state their lengths notice every truncation.
#[test]
fn binary_files_that_are_cut_off_never_load() {
    for (name, bytes) in
        samples().iter().filter(|(name, _)| ["a.glb", "binary.stl", "binary.ply"].contains(name))
    {
        for length in 0..bytes.len() {
            let error = load_files(&[(name, &bytes[..length])]).expect_err("must be refused");
            assert!(error.to_string().contains(name), "{error}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_are_refused_or_sound(
        sample in 0usize..9,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let (name, mut bytes) = samples().swap_remove(sample);
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        // Small limits keep damaged counts from taking the test's memory.
        let limits = LoadLimits { max_triangles: 1 << 16, max_positions: 1 << 16, ..LoadLimits::default() };
        match load_files_with(&[(name, &bytes)], &LoadOptions { limits }) {
            Ok(model) => assert_consistent(&model),
            Err(error) => prop_assert!(error.to_string().contains(name), "{}", error),
        }
    }

    #[test]
    fn flipped_bits_are_refused_or_sound(sample in 0usize..9, place: prop::sample::Index, bit in 0u32..8) {
        let (name, mut bytes) = samples().swap_remove(sample);
        let place = place.index(bytes.len());
        bytes[place] ^= 1 << bit;
        let limits = LoadLimits { max_triangles: 1 << 16, max_positions: 1 << 16, ..LoadLimits::default() };
        if let Ok(model) = load_files_with(&[(name, &bytes)], &LoadOptions { limits }) {
            assert_consistent(&model);
        }
    }

    #[test]
    fn noise_behind_a_known_beginning_is_refused_or_sound(
        beginning in prop::sample::select(vec!["ply\n", "ply\nformat ascii 1.0\n", "glTF", "{", "solid x\nfacet ", "v 0 0 0\nf ", ""]),
        noise in prop::collection::vec(any::<u8>(), 0..300),
        name in prop::sample::select(vec!["a.gltf", "a.glb", "a.obj", "a.ply", "a.stl", "a"]),
    ) {
        let bytes = [beginning.as_bytes(), &noise].concat();
        if let Ok(model) = load_files(&[(name, &bytes)]) {
            assert_consistent(&model);
        }
    }
}

#[test]
fn missing_files_and_folders_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let load = |name: &str| fantex_mesh::load(&folder.path().join(name), &LoadOptions::default());
    let error = load("nothing.glb").unwrap_err().to_string();
    assert_mentions(&error, &["cannot read", "nothing.glb"]);
    std::fs::create_dir(folder.path().join("box.obj")).unwrap();
    assert_mentions(&load("box.obj").unwrap_err().to_string(), &["box.obj is a folder"]);
}

#[test]
fn empty_and_triangle_free_files_are_refused() {
    for name in ["a.gltf", "a.glb", "a.obj", "a.ply", "a.stl", "a"] {
        assert_mentions(&message(name, b""), &["is empty"]);
    }
    assert_mentions(
        &message("a.obj", b"v 0 0 0\nv 1 0 0\nl 1 2\n"),
        &["no triangles", "2 positions", "lines"],
    );
    assert_mentions(&message("a.stl", b"solid a\nendsolid a\n"), &["no triangles"]);
    assert_mentions(&message("a.stl", &binary_stl(0)), &["no triangles"]);
    assert_mentions(&message("a.gltf", br#"{"asset":{"version":"2.0"}}"#), &["no triangles"]);
    let ply = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    assert_mentions(&message("a.ply", ply), &["no triangles", "only 1 position"]);
}

#[test]
fn mislabelled_files_are_read_by_content_or_refused() {
    for (name, bytes) in samples() {
        let format = name.rsplit('.').next().unwrap();
        for other in ["wrong.stl", "wrong.ply", "wrong.glb", "without_extension"] {
            if other.ends_with(format) || (format == "obj" && other != "without_extension") {
                continue;
            }
            let model = load_files(&[(other, &bytes)]).unwrap_or_else(|e| panic!("{name} as {other}: {e}"));
            let is_gltf_pair = format == "gltf" && other.ends_with(".glb");
            let is_noted = model.notes.iter().any(|note| note.contains("its content is"));
            assert_eq!(
                is_noted,
                other.contains('.') && !is_gltf_pair,
                "{name} as {other}: {:?}",
                model.notes
            );
        }
    }
    assert_mentions(&message("a.glb", b"v 0 0 0\n"), &["named like a GLB file", "letters glTF"]);
    assert_mentions(&message("a.gltf", b"v 0 0 0\n"), &["named like a glTF file"]);
    assert_mentions(&message("a.ply", b"solid"), &["named like a PLY file"]);
    assert_mentions(&message("a.obj", b"\x89PNG\r\n\x1a\n"), &["a PNG image, not a model"]);
    assert_mentions(&message("a.obj", b"\x4c\x01\x02\0\0\0"), &["an OBJ file is text"]);
    assert_mentions(&message("a.stl", b"PK\x03\x04"), &["ZIP"]);
    assert_mentions(&message("a.ply", b"<html></html>"), &["XML or HTML"]);
    assert_mentions(&message("a.fbx", b"Kaydara FBX Binary"), &["FBX"]);
    assert_mentions(&message("a.dat", b"hello"), &["no format that fantex knows"]);
}

#[test]
fn absurd_counts_are_refused_before_memory_is_taken() {
    let vertices = |count: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0"
        )
    };
    assert_mentions(
        &message("a.ply", vertices("4294967296").as_bytes()),
        &["announces 4294967296", "vertex", "truncated"],
    );
    assert_mentions(
        &message("a.ply", vertices("18446744073709551615").as_bytes()),
        &["announces", "truncated"],
    );
    assert_mentions(
        &message("a.ply", vertices("99999999999999999999").as_bytes()),
        &["header line 3", "element NAME COUNT"],
    );
    let mut stl = binary_stl(1);
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    stl[0] = b'x';
    assert_mentions(&message("a.stl", &stl), &["announces 4294967295 facets", "truncated"]);
    let accessor = |count: &str| {
        gltf_with_buffer(
            &format!(
                r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"bufferViews":[{{"buffer":0,"byteLength":12}}],"accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":{count}}}]"#
            ),
            &[0; 12],
        )
    };
    for count in ["4294967296", "18446744073709551615"] {
        assert_mentions(
            &message("a.gltf", accessor(count).as_bytes()),
            &["accessor 0", "more than the limit"],
        );
    }
    assert_mentions(
        &message("a.gltf", accessor("1000000").as_bytes()),
        &["accessor 0", "12000000 bytes", "has 12"],
    );
    assert_mentions(&message("a.gltf", accessor("-1").as_bytes()), &["JSON", "line 1"]);
}

#[test]
fn limits_are_kept() {
    let limited = |limits| LoadOptions { limits };
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
    let refuse = |limits| {
        load_files_with(&[("a.obj", text.as_bytes())], &limited(limits))
            .expect_err("must be refused")
            .to_string()
    };
    let defaults = LoadLimits::default();
    assert_mentions(&refuse(LoadLimits { max_triangles: 1, ..defaults }), &["2 triangles", "limit of 1"]);
    assert_mentions(&refuse(LoadLimits { max_positions: 3, ..defaults }), &["4 positions", "limit of 3"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, text).unwrap();
    let limits = LoadLimits { max_file_bytes: 10, ..defaults };
    let error = fantex_mesh::load(&path, &limited(limits)).unwrap_err().to_string();
    assert_mentions(&error, &["a.obj has", "bytes", "limit of 10"]);
    assert_mentions(
        &refuse(LoadLimits { max_face_corners: 3, ..defaults }),
        &["line 5", "4 corners", "limit of 3"],
    );
}

/// Triangles are counted while they are read: what follows, here no number, is not looked at.
#[test]
fn ply_files_are_read_no_farther_than_the_limit() {
    let header =
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
    let vertices = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    let faces = "element face 3\nproperty list uchar int vertex_indices\nend_header\n";
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let limits = LoadLimits { max_triangles: 2, ..LoadLimits::default() };
    for (kind, rows) in [(faces, "3 0 1 2\n4 0 1 2 3\n3 0 1 x\n"), (strips, "7 0 1 2 3 0 1 x\n")] {
        let text = format!("{header}{kind}{vertices}{rows}");
        let error = load_files_with(&[("a.ply", text.as_bytes())], &LoadOptions { limits });
        assert_mentions(&error.expect_err("must be refused").to_string(), &["3 triangles", "limit of 2"]);
    }
}

/// A polygon whose outline winds in a spiral, at the limit of corners: the worst case for cutting.
#[test]
fn a_huge_concave_polygon_is_cut() {
    use std::fmt::Write as _;
    let count = LoadLimits::default().max_face_corners;
    let mut text = String::new();
    let point = |i: usize, inset: f64| {
        let turn = i as f64 / (count / 2) as f64 * 40.0 * std::f64::consts::TAU;
        let radius = 1.0 + turn / std::f64::consts::TAU - inset;
        (radius * turn.cos(), radius * turn.sin())
    };
    for i in 0..count / 2 {
        let (x, y) = point(i, 0.0);
        writeln!(text, "v {x} {y} 0").unwrap();
    }
    for i in (0..count / 2).rev() {
        let (x, y) = point(i, 0.4);
        writeln!(text, "v {x} {y} 0").unwrap();
    }
    text.push('f');
    (1..=count).for_each(|i| write!(text, " {i}").unwrap());
    let model = load_text("spiral.obj", &text).unwrap();
    assert_eq!(model.triangles.len(), count - 2);
}

/// Names are looked up, not searched for.
#[test]
fn very_many_materials_are_looked_up() {
    use std::fmt::Write as _;
    let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned();
    for material in 0..200_000 {
        writeln!(text, "usemtl {material}\nf 1 2 3").unwrap();
    }
    let model = load_text("a.obj", &text).unwrap();
    assert_eq!(model.materials.len(), 200_000);
}

/// So are images made of channels of others, here each of a material's own, and twice.
#[test]
fn packed_images_are_looked_up() {
    use std::fmt::Write as _;
    let (mut text, mut library) = ("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned(), String::new());
    let count = 3_000;
    for material in 0..2 * count {
        writeln!(text, "usemtl {material}\nf 1 2 3").unwrap();
        writeln!(library, "newmtl {material}\nmap_Kd c.png\nmap_d {}.png", material % count).unwrap();
    }
    let model = load_files(&[("a.obj", text.as_bytes()), ("a.mtl", library.as_bytes())]).unwrap();
    assert_eq!(model.materials.len(), 2 * count);
    // The colours, opacities, and both together.
    assert_eq!(model.images.len(), 1 + 2 * count);
}

#[test]
fn zeroed_accessors_and_second_vertex_tables_claim_no_memory_and_do_not_confuse() {
    let document = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"componentType":5126,"type":"VEC3","count":100000000}]}"#;
    assert_mentions(&message("a.gltf", document.as_bytes()), &["accessor 0", "100000000 elements", "limit"]);
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 3\n{xyz}property float nx\nproperty float ny\nproperty float nz\nelement vertex 3\n{xyz}element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n9 9 9\n9 9 9\n9 9 9\n3 0 1 2\n"
    );
    let model = load_text("a.ply", &text).unwrap();
    assert_eq!(model.positions.len(), 3);
    assert_mentions(&model.notes.join("\n"), &["skipped: 3 vertex"]);
    let text = format!("ply\ncomment {}\nformat ascii 1.0\n", "x".repeat(1 << 17));
    assert_mentions(&message("a.ply", text.as_bytes()), &["header has no end"]);
}

/// What the files of all buffers hold together is limited.
#[test]
fn buffers_are_limited_together() {
    let names = ["0.bin", "1.bin", "2.bin", "3.bin", "4.bin", "5.bin"];
    let buffers = names.map(|name| format!(r#"{{"byteLength":1,"uri":"{name}"}}"#)).join(",");
    let text = format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffers}]}}"#);
    let limits = LoadLimits { max_file_bytes: 5000, ..LoadLimits::default() };
    let mut files = vec![("a.gltf", text.as_bytes())];
    files.extend(names.map(|name| (name, &[0; 1000][..])));
    let error = load_files_with(&files, &LoadOptions { limits }).expect_err("must be refused").to_string();
    assert_mentions(&error, &["a.gltf: buffer 5", "more than 5000 bytes"]);
}
