//! What readers make of unusual and contradictory files, and how much memory they take for them.

use std::sync::Arc;

use crate::common::*;
use fantex_base::{ReadLimits, ReadOptions};
use fantex_mesh::{
    AlphaMode, CleanOptions, ImageSource, LoadLimits, LoadOptions, Model, clean, shading_normals,
};
use glam::{Vec2, Vec3, Vec4};

const FACE: &str = "f 1 2 3\n";

/// As OpenSubdiv's shapes do. Where there are some, a number too high is a sign of damage, and refused.
#[test]
fn faces_may_refer_to_attributes_of_which_there_are_none() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/4/7 2/5/8 3/6/9\n";
    let model = load_text("a.obj", text).unwrap();
    assert_eq!(model.triangles, [[0, 1, 2]]);
    assert!(model.corners.uv_sets.is_empty() && model.corners.normals.is_empty());
    assert_mentions(&model.notes.join("\n"), &["texture coordinates, but", "normals, but"]);
    let model = load_text(
        "a.obj",
        &format!("vt 0.5 0\n{}", text.replace("/4/", "/1/").replace("/5/", "/1/").replace("/6/", "/1/")),
    )
    .unwrap();
    assert_eq!(model.corners.uv_sets, [[Vec2::new(0.5, 1.0); 3]]);
    assert!(model.corners.normals.is_empty() && model.notes.len() == 1, "{:?}", model.notes);
}

#[test]
fn numbers_that_are_none_are_read_as_programs_for_windows_write_them() {
    let obj = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1.#IND -1.#QNAN0 -nan(ind)\n{FACE}f 1 2 4\n");
    let positions = "property float x\nproperty float y\nproperty float z\n";
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\n{positions}element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n-1.#IND000 1.#INF 0\n3 0 1 2\n3 0 1 3\n"
    );
    for (name, text) in [("a.obj", obj), ("a.ply", ply)] {
        let model = load_text(name, &text).unwrap();
        assert!(model.positions[3].x.is_nan() && !model.positions[3].is_finite(), "{name}");
        let (mesh, report) = clean(model, &CleanOptions::default()).unwrap();
        assert_eq!((mesh.triangles.len(), report.triangles_non_finite), (1, 1), "{name}");
    }
    assert_mentions(&message("a.obj", b"v 1.#X 0 0\n"), &["expected a number", "1.#X"]);
}

#[test]
fn overexposed_colours_are_no_bytes() {
    let text = format!("v 0 0 0 1.001 0.5 0\nv 1 0 0 1 0.5 0\nv 0 1 0 0 1 0\n{FACE}");
    let model = load_text("a.obj", &text).unwrap();
    let colors = &model.corners.colors;
    assert!((colors[0] - colors[1]).abs().max_element() < 0.01, "{colors:?}");
    assert_eq!((colors[2], model.notes), (Vec4::new(0.0, 1.0, 0.0, 1.0), Vec::<String>::new()));
}

#[test]
fn positions_without_colours_are_white_among_bytes_too() {
    let text = format!("v 0 0 0\nv 1 0 0 255 0 0\nv 0 1 0\nv 0 0 1 0 255 0\n{FACE}f 1 2 4\n");
    let model = load_text("a.obj", &text).unwrap();
    let (red, green) = (Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(0.0, 1.0, 0.0, 1.0));
    assert_eq!(model.corners.colors, [Vec4::ONE, red, Vec4::ONE, Vec4::ONE, red, green]);
    assert!(model.notes.len() == 1 && model.notes[0].contains("0..255"), "{:?}", model.notes);
}

#[test]
fn comments_are_not_continued() {
    let positions = "v 0 0 0\nv 1 0 0\n  # from C:\\models\\\nv 0 1 0\nv 9 9 \\\n9\n";
    let model = load_text("a.obj", &format!("{positions}{FACE}")).unwrap();
    assert_eq!((model.positions.len(), model.triangles), (4, vec![[0, 1, 2]]));
}

#[test]
fn dissolve_counts_where_transparency_is_given_too() {
    let alpha = |lines: &str| {
        let obj = format!("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\n{FACE}");
        let mtl = format!("newmtl m\nKd 1 1 1\n{lines}");
        let model = load_files(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())]).unwrap();
        let opaque = model.notes.iter().filter(|note| note.contains("taken as opaque")).count();
        (model.materials[0].base_color.w, model.materials[0].alpha, opaque)
    };
    assert_eq!(alpha("d 1.0\nTr 1.0\n"), (1.0, AlphaMode::Opaque, 0));
    assert_eq!(alpha("Tr 1.0\nd 1.0\n"), (1.0, AlphaMode::Opaque, 0));
    assert_eq!(alpha("Tr 0.25\n"), (0.75, AlphaMode::Blend, 0));
    assert_eq!(alpha("Tr 1.0\nd 0.0\n"), (0.0, AlphaMode::Blend, 0));
    // MeshLab writes the opacity after `Tr`.
    assert_eq!(alpha("Tr 1.000000\n"), (1.0, AlphaMode::Opaque, 1));
}

#[test]
fn black_hides_no_map() {
    let of = |lines: &str| {
        let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
        let mtl = format!("newmtl m\n{lines}");
        let model = load_files(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())]).unwrap();
        (model.materials[0].base_color, model.notes.join("\n"))
    };
    for lines in ["Kd 0 0 0\nd 0.5\nmap_Kd a.png\n", "map_Kd a.png\nd 0.5\nKd 0 0 0\n"] {
        let (color, notes) = of(lines);
        assert_eq!(color, Vec3::ONE.extend(0.5));
        assert_mentions(&notes, &["material \"m\"", "Kd is black"]);
    }
    let black = (Vec3::ZERO.extend(1.0), String::new());
    assert_eq!(of("Kd 0 0 0\n"), black);
    assert_eq!(of("Kd 0 0 0\nmap_Pr r.png\n"), black);
}

#[test]
fn colours_without_numbers_are_noted() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nCOLORSelement face 1\nproperty list uchar int vertex_indices\nFACESend_header\n";
    let colors = "property float red\nproperty float green\nproperty float blue\n";
    let header = |vertices: &str, faces: &str| text.replace("COLORS", vertices).replace("FACES", faces);
    let vertices = header(colors, "") + "0 0 0 1 0 0\n1 0 0 nan 0 0\n0 1 0 0 nan 0\n3 0 1 2\n";
    let model = load_text("a.ply", &vertices).unwrap();
    assert_eq!(model.corners.colors, [Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::ONE, Vec4::ONE]);
    assert_eq!(model.notes, ["made 2 vertex colours white that had no numbers"]);
    let faces = header("", colors) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 nan nan nan\n";
    let notes = load_text("a.ply", &faces).unwrap().notes;
    assert_eq!(notes, ["made 1 face colour white that had no numbers"]);
}

#[test]
fn facets_of_stl_have_colours_in_either_convention() {
    let load = |header: &[u8], attributes: &[u16]| {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend((attributes.len() as u32).to_le_bytes());
        for attribute in attributes {
            bytes.extend(floats(&[0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0.]));
            bytes.extend(attribute.to_le_bytes());
        }
        let model = load_files(&[("a.stl", &bytes)]).unwrap();
        let of_facets: Vec<Vec4> = model.corners.colors.iter().step_by(3).copied().collect();
        assert!(of_facets.is_empty() || model.corners.colors.len() == 3 * attributes.len());
        (of_facets, model.notes.join("\n"))
    };
    let (red, blue) = (Vec4::new(1., 0., 0., 1.), Vec4::new(0., 0., 1., 1.));
    let (colors, notes) = load(b"VisCAM", &[0x801f, 0x8000 | 31 << 10, 0]);
    assert_eq!(colors, [blue, red, Vec4::ONE]);
    assert_mentions(&notes, &["as VisCAM writes them"]);
    let magics = b"made by hand COLOR=\0\xff\0\xff,MATERIAL=";
    let (colors, notes) = load(magics, &[0x001f, 31 << 10, 0x8000 | 31]);
    assert_eq!(colors, [red, blue, Vec4::new(0., 1., 0., 1.)]);
    assert_mentions(&notes, &["as Magics writes them"]);
    assert_eq!(load(magics, &[0, 0]).0, [Vec4::new(0., 1., 0., 1.); 2]);
    // No colours: nothing, white alone, numbers of something else.
    assert_eq!(load(b"", &[0, 0]), (vec![], String::new()));
    assert_eq!(load(b"COLOR=\xff\xff\xff\xff", &[0, 0]), (vec![], String::new()));
    assert_eq!(load(b"", &[0xffff, 0]), (vec![], String::new()));
    let (colors, notes) = load(b"", &[0x801f, 7, 0]);
    assert_eq!(colors, []);
    assert_mentions(&notes, &["attributes of 2 facets", "not colours"]);
}

/// As Blender 2.47 wrote them.
#[test]
fn header_lines_of_ply_without_a_keyword_are_comments() {
    let header = "ply\nformat ascii 1.0\nCreated by Blender3D 247 - www.blender.org, source file: \n";
    let elements = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let model = load_text("a.ply", &format!("{header}{elements}{rows}")).unwrap();
    assert_eq!(model.triangles, [[0, 1, 2]]);
    assert_mentions(&model.notes.join("\n"), &["1 header line", "line 3: Created by Blender3D"]);
}

#[test]
fn faces_may_have_no_texture() {
    let model = |files: &str, numbers: [i32; 3]| {
        let [a, b, c] = numbers;
        let header = "ply\nformat ascii 1.0\n";
        let elements = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 3\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\nend_header\n0 0 0\n1 0 0\n0 1 0\n";
        let face = |number: i32| format!("3 0 1 2 6 0 0 1 0 0 1 {number}\n");
        load_text("a.ply", &format!("{header}{files}{elements}{}{}{}", face(a), face(b), face(c))).unwrap()
    };
    let one = "comment TextureFile one.png\n";
    let textures = |model: &Model| -> Vec<bool> {
        model.materials.iter().map(|material| material.base_color_texture.is_some()).collect()
    };
    let mixed = model(one, [0, -1, 7]);
    assert_eq!((textures(&mixed), &mixed.triangle_materials[..]), (vec![true, false], &[0, 1, 0][..]));
    assert_consistent(&mixed);
    let two = format!("{one}comment TextureFile two.png\n");
    let mixed = model(&two, [1, -1, 0]);
    assert_eq!((textures(&mixed), &mixed.triangle_materials[..]), (vec![true, true, false], &[1, 2, 0][..]));
    assert_eq!(model(one, [0, 0, 0]).triangle_materials, [0u32; 0]);
    // In MeshLab's samples.
    let named = model("comment TextureFile <this>_A.png\n", [0, 0, 0]);
    assert!(matches!(&named.images[0], ImageSource::File(path) if path.ends_with("a_A.png")));
}

// glTF.

/// A document with an accessor of floats, named by its type, for each list of numbers.
fn document(accessors: &[(&str, &[f32])], rest: &str) -> String {
    let (mut buffer, mut views, mut elements) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (shape, numbers)) in accessors.iter().enumerate() {
        let bytes = floats(numbers);
        let (offset, length) = (buffer.len(), bytes.len());
        views.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}}}"#));
        let count = numbers.len() / shape.trim_start_matches("VEC").parse::<usize>().unwrap();
        elements.push(format!(
            r#"{{"bufferView":{index},"componentType":5126,"count":{count},"type":"{shape}"}}"#
        ));
        buffer.extend(bytes);
    }
    let (views, elements) = (views.join(","), elements.join(","));
    gltf_with_buffer(&format!(r#""bufferViews":[{views}],"accessors":[{elements}],{rest}"#), &buffer)
}

/// Two triangles that bend by some 45 degrees at an edge, whose vertices are there twice.
const BENT: [f32; 18] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 0., 0., 1., 1., -0.7, 0., 1., 0.];

#[test]
fn a_part_without_normals_has_those_that_it_has_alone() {
    let other: Vec<f32> = BENT.iter().map(|x| x + 5.0).collect();
    let up = [0.0f32, 0.0, 1.0].repeat(6);
    let accessors = [("VEC3", &BENT[..]), ("VEC3", &other), ("VEC3", &up)];
    let (bare, with_normals) =
        (r#"{"attributes":{"POSITION":0}}"#, r#"{"attributes":{"POSITION":1,"NORMAL":2}}"#);
    let model = |primitives: &str| {
        let rest = format!(r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{primitives}]}}]"#);
        load_text("a.gltf", &document(&accessors, &rest)).unwrap()
    };
    let alone = model(bare);
    assert!(alone.corners.normals.is_empty());
    let expected = shading_normals(&clean(alone, &CleanOptions::default()).unwrap().0);
    assert!(expected[0].dot(expected[1]) < 0.99 && expected[1].dot(expected[3]) > 0.9999, "{expected:?}");
    for (primitives, first) in [(format!("{bare},{with_normals}"), 0), (format!("{with_normals},{bare}"), 6)]
    {
        let mixed = model(&primitives);
        assert_consistent(&mixed);
        let smooth = &mixed.corners.normals[first..first + 6];
        let is_equal = smooth.iter().zip(&expected).all(|(a, b)| a.abs_diff_eq(*b, 1e-6));
        assert!(is_equal, "{primitives}: {smooth:?} for {expected:?}");
        assert_eq!(mixed.corners.normals[6 - first..12 - first], [Vec3::Z; 6]);
    }
}

/// The first part's normal map lies in the second set of coordinates, turned by a quarter.
#[test]
fn a_part_without_tangents_has_those_of_its_normal_map() {
    let plane = [0., 0., 0., 1., 0., 0., 0., 1., 0.];
    let up = [0.0f32, 0.0, 1.0].repeat(3);
    let first = [0.0f32, 1.0, 1.0, 1.0, 0.0, 0.0];
    let second = [0.0f32, 0.0, 0.0, -1.0, 1.0, 0.0];
    let own = [0.0f32, -1.0, 0.0, 1.0].repeat(3);
    let rest = r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"TEXCOORD_1":3},"material":0},{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"TANGENT":4},"material":0}]}],"materials":[{"normalTexture":{"index":0,"texCoord":1}}],"textures":[{"source":0}],"images":[{"uri":"normal.png"}]"#;
    let accessors =
        [("VEC3", &plane[..]), ("VEC3", &up), ("VEC2", &first), ("VEC2", &second), ("VEC4", &own)];
    let model = load_text("a.gltf", &document(&accessors, rest)).unwrap();
    assert_consistent(&model);
    // In the second set, u grows along y; v grows along -x and is the image's down, so the image is not mirrored.
    assert_eq!(model.corners.uv_sets[1][2], Vec2::X);
    assert_eq!(model.corners.tangents[3..], [Vec4::new(0.0, -1.0, 0.0, 1.0); 3]);
    for tangent in &model.corners.tangents[..3] {
        assert!((tangent.truncate() - Vec3::Y).length() < 1e-5, "{tangent}");
    }
}

#[test]
fn compression_may_be_given_under_both_names() {
    let file = include_bytes!("../data/torus_meshopt_khr.glb");
    let length = u32::from_le_bytes(*file[12..].first_chunk().unwrap()) as usize;
    let mut json: serde_json::Value = serde_json::from_slice(&file[20..20 + length]).unwrap();
    let mut doubled = 0;
    for list in ["bufferViews", "buffers"] {
        for item in json[list].as_array_mut().unwrap() {
            if let Some(extensions) = item.get_mut("extensions").and_then(|e| e.as_object_mut()) {
                let khr = extensions["KHR_meshopt_compression"].clone();
                extensions.insert("EXT_meshopt_compression".into(), khr);
                doubled += 1;
            }
        }
    }
    assert!(doubled > 1);
    let model = load_files(&[("a.glb", &glb(&json.to_string(), &file[28 + length..]))]).unwrap();
    assert_eq!(model.triangles, load_files(&[("a.glb", file)]).unwrap().triangles);
}

// Memory.

/// Loads with a budget of its own.
fn load_within(memory_bytes: u64, files: &[(&str, &[u8])]) -> fantex_base::Result<Model> {
    let options = ReadOptions { memory_bytes, ..ReadOptions::default() };
    ReadLimits::new(options).run(|| load_files(files))
}

const TRIANGLE: &str = r#""nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}]"#;

#[test]
fn images_share_the_bytes_of_a_place() {
    let views =
        r#"{"buffer":0,"byteLength":36},{"buffer":0,"byteLength":4000},{"buffer":0,"byteLength":4000}"#;
    let images = vec![r#"{"bufferView":1},{"bufferView":2}"#; 200].join(",");
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":4000}}],"bufferViews":[{views}],"images":[{images}],{TRIANGLE}}}"#
    );
    let file = glb(&json, &[0; 4000]);
    let model = load_within(1 << 16, &[("a.glb", &file)]).unwrap();
    assert_eq!(model.images.len(), 400);
    let bytes: Vec<&Arc<[u8]>> = model
        .images
        .iter()
        .map(|image| match image {
            ImageSource::Embedded { bytes, .. } => bytes,
            other => panic!("{other:?}"),
        })
        .collect();
    assert!(bytes.iter().all(|image| Arc::ptr_eq(image, bytes[0])));
    assert_mentions(&load_within(3000, &[("a.glb", &file)]).unwrap_err().to_string(), &["a.glb", "image 0"]);
}

#[test]
fn buffers_share_a_file_and_count_while_they_are_there() {
    let json = |name: &dyn Fn(usize) -> String| {
        let buffer = |index: usize| format!(r#"{{"uri":"{}","byteLength":4000}}"#, name(index));
        let buffers = (0..4).map(buffer).collect::<Vec<_>>().join(",");
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffers}],"bufferViews":[{{"buffer":0,"byteLength":36}}],{TRIANGLE}}}"#
        )
    };
    let data = [0; 4000];
    let one = json(&|_| "0.bin".to_owned());
    let files: [(&str, &[u8]); 2] = [("a.gltf", one.as_bytes()), ("0.bin", &data)];
    load_within(6000, &files).unwrap();
    let limits = LoadLimits { max_file_bytes: 6000, ..LoadLimits::default() };
    load_files_with(&files, &LoadOptions { limits }).unwrap();

    let four = json(&|index| format!("{index}.bin"));
    let files: [(&str, &[u8]); 5] =
        [("a.gltf", four.as_bytes()), ("0.bin", &data), ("1.bin", &data), ("2.bin", &data), ("3.bin", &data)];
    load_within(20_000, &files).unwrap();
    let message = load_within(12_000, &files).unwrap_err().to_string();
    assert_mentions(&message, &["buffer 2", "2.bin", "memory"]);
}

#[test]
fn skins_count_against_the_memory() {
    let count = 1 << 18;
    let accessors = [(5126, "VEC3"), (5121, "VEC4"), (5126, "VEC4")]
        .map(|(kind, shape)| format!(r#"{{"componentType":{kind},"count":{count},"type":"{shape}"}}"#))
        .join(",");
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0,"skin":0}}],"skins":[{{"joints":[0]}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}},"indices":3}}]}}],"accessors":[{accessors},{{"componentType":5125,"count":3,"type":"SCALAR"}}]}}"#
    );
    let files: [(&str, &[u8]); 1] = [("a.gltf", json.as_bytes())];
    load_within(64 << 20, &files).unwrap();
    let message = load_within(16 << 20, &files).unwrap_err().to_string();
    assert_mentions(&message, &["primitive 0 of mesh 0", "memory"]);
}
