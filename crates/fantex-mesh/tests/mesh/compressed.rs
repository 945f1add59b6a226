//! Compressed glTF, as other programs wrote it (`tests/data/README.md`), against the formulas of the model.

use std::collections::HashSet;
use std::f64::consts::TAU;

use crate::common::*;
use fantex_mesh::Model;
use glam::{DVec3, Vec4};

const SIDE: usize = 16;

/// Every triangle is there once, and every corner has the torus's position, normal and colour for its texture coordinates, within
/// what quantization leaves.
#[track_caller]
fn assert_torus(model: &Model, [position_error, normal_error]: [f64; 2]) {
    assert_consistent(model);
    assert_eq!((model.positions.len(), model.triangles.len()), ((SIDE + 1) * (SIDE + 1), 2 * SIDE * SIDE));
    let mut seen = HashSet::new();
    for (t, triangle) in model.triangles.iter().enumerate() {
        let mut nodes = [[0; 2]; 3];
        for k in 0..3 {
            let corner = 3 * t + k;
            // glTF's own transform of coordinates counts.
            let transform = model.materials[0].base_color_texture.as_ref().unwrap().uv_transform;
            let uv = transform.transform_point2(model.corners.uv_sets[0][corner]).as_dvec2();
            nodes[k] = (uv * SIDE as f64).round().as_ivec2().to_array();
            let uv = glam::DVec2::new(nodes[k][0].into(), nodes[k][1].into()) / SIDE as f64 - uv;
            assert!(uv.length() < 1e-3, "{uv}");
            let [u, v] = nodes[k].map(|i| f64::from(i) / SIDE as f64);
            let ((sin_a, cos_a), (sin_b, cos_b)) = ((TAU * u).sin_cos(), (TAU * v).sin_cos());
            let normal = DVec3::new(cos_b * cos_a, cos_b * sin_a, sin_b);
            let position = DVec3::new(cos_a, sin_a, 0.0) + 0.4 * normal;
            let found = model.positions[triangle[k] as usize];
            assert!((found - position).length() < position_error, "{found} for {position}");
            let found = model.corners.normals[corner].as_dvec3();
            assert!((found - normal).length() < normal_error, "{found} for {normal}");
            let color = glam::DVec4::new(u, v, 1.0 - u, 1.0 - v / 2.0).as_vec4();
            let found = model.corners.colors[corner];
            assert!((found - color).abs().cmple(Vec4::splat(0.012)).all(), "{found} for {color}");
        }
        let [a, b, c] = nodes.map(|[i, j]| glam::IVec2::new(i, j));
        assert_eq!((b - a).perp_dot(c - a), 1, "half a square, turned as all others");
        nodes.sort_unstable();
        assert!(seen.insert(nodes), "{nodes:?} twice");
    }
}

#[test]
fn meshopt_is_decompressed() {
    let old = include_bytes!("../data/torus_meshopt_ext.glb");
    assert_torus(&load_files(&[("ext.glb", old)]).unwrap(), [1e-4, 1e-3]);
    let new = include_bytes!("../data/torus_meshopt_khr.glb");
    assert_torus(&load_files(&[("khr.glb", new)]).unwrap(), [2e-3, 2e-2]);
}

#[test]
fn draco_is_decompressed() {
    let files: [&[u8]; 2] = [
        include_bytes!("../data/torus_draco_edgebreaker.glb"),
        include_bytes!("../data/torus_draco_sequential.glb"),
    ];
    for bytes in files {
        assert_torus(&load_files(&[("draco.glb", bytes)]).unwrap(), [2e-4, 1e-2]);
    }
}

#[test]
fn damaged_draco_is_refused_with_its_place() {
    let sound = include_bytes!("../data/torus_draco_edgebreaker.glb");
    let mut bytes = sound.to_vec();
    let at = sound.windows(5).position(|w| w == b"DRACO").unwrap();
    bytes[at] = b'B';
    assert_mentions(&message("a.glb", &bytes), &["primitive 0 of mesh 0", "Draco"]);
    // Few bytes may stand for very many points; the limits hold for what is decompressed.
    let limits = fantex_mesh::LoadLimits { max_triangles: 500, ..Default::default() };
    let error =
        load_files_with(&[("a.glb", sound)], &fantex_mesh::LoadOptions { limits }).unwrap_err().to_string();
    assert_mentions(&error, &["primitive 0 of mesh 0", "Draco", "512 faces", "500"]);
}

#[test]
fn damaged_meshopt_is_refused_with_its_place() {
    let sound = include_bytes!("../data/torus_meshopt_ext.glb");
    let text = String::from_utf8_lossy(sound);
    let refuse = |from: &str, to: &str| {
        assert!(text.contains(from));
        let at = sound.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let mut bytes = sound.to_vec();
        bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
        message("a.glb", &bytes)
    };
    assert_mentions(&refuse("ATTRIBUTES", "ATTRIBUTED"), &["buffer view 1", "ATTRIBUTED", "unknown"]);
    assert_mentions(
        &refuse(r#""count":289"#, r#""count":288"#),
        &["buffer view 1", "288 elements of 8 bytes"],
    );
    let mut bytes = sound.to_vec();
    let end = bytes.len();
    bytes[end - 4] ^= 1;
    bytes[end - 300] ^= 255;
    assert_mentions(&message("a.glb", &bytes), &["buffer view"]);
}

#[test]
fn textures_take_what_is_there_of_their_images() {
    let texture = |rest: &str| {
        let parts = format!(
            r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],"bufferViews":[{{"buffer":0,"byteLength":60}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":0,"byteOffset":36,"componentType":5126,"count":3,"type":"VEC2"}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],"images":[{{"uri":"data:;base64,AA=="}},{{"uri":"data:;base64,AQ=="}}],"extensionsUsed":["KHR_texture_basisu"],"textures":[{{{rest}}}]"#
        );
        let buffer = floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.]);
        let model = load_text("a.gltf", &gltf_with_buffer(&parts, &buffer)).unwrap();
        assert_eq!(model.notes, [""; 0]);
        model.materials[0].base_color_texture.as_ref().unwrap().image
    };
    assert_eq!(texture(r#""extensions":{"KHR_texture_basisu":{"source":1}}"#), 1);
    assert_eq!(texture(r#""source":0,"extensions":{"KHR_texture_basisu":{"source":1}}"#), 0);
}
