//! glTF: hierarchy, primitives, accessors, materials, extensions, and what is refused.

use crate::common::*;
use fantex_base::{ReadLimits, ReadOptions};
use fantex_mesh::{AlphaMode, ImageSource, Material, Model, Parts, WrapMode};
use glam::{DVec3, Vec2, Vec3, Vec4};

/// A right triangle in the xy plane, then its three indices as bytes.
fn triangle_buffer() -> Vec<u8> {
    let mut buffer = floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
    buffer.extend([0, 1, 2, 0]);
    buffer
}

/// A document around one mesh with one position accessor, `rest` added.
fn triangle_gltf(nodes: &str, primitive: &str, rest: &str) -> String {
    gltf_with_buffer(
        &format!(
            r#""nodes":{nodes},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}{primitive}}}]}}],"bufferViews":[{{"buffer":0,"byteLength":40}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":0,"byteOffset":36,"componentType":5121,"count":3,"type":"SCALAR"}}]{rest}"#
        ),
        &triangle_buffer(),
    )
}

fn normal_of(model: &Model, triangle: usize) -> DVec3 {
    let [a, b, c] = model.triangles[triangle].map(|v| model.positions[v as usize]);
    (b - a).cross(c - a)
}

#[test]
fn transforms_of_the_whole_hierarchy_apply_in_double_precision() {
    // Far away and rotated: a quarter turn about z, scaled by 2, below a node 12345678.5 along x.
    let nodes = r#"[{"translation":[12345678.5,0,0],"children":[1]},{"rotation":[0,0,0.70710678118654757,0.70710678118654757],"scale":[2,2,2],"children":[2]},{"matrix":[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0.25,1],"mesh":0}]"#;
    let model = load_text("a.gltf", &triangle_gltf(nodes, "", "")).unwrap();
    let expected = [[12345678.5, 0.0, 0.5], [12345678.5, 2.0, 0.5], [12345676.5, 0.0, 0.5]].map(DVec3::from);
    for (found, expected) in model.positions.iter().zip(expected) {
        assert!((*found - expected).length() < 1e-8, "{found} for {expected}");
    }
}

#[test]
fn mirrors_turn_the_winding_and_keep_the_outside_outside() {
    let mut buffer = triangle_buffer();
    for vector in [[0.0f32, 0., 1.]; 3] {
        buffer.extend(floats(&vector));
    }
    for tangent in [[1.0f32, 0., 0., 1.]; 3] {
        buffer.extend(floats(&tangent));
    }
    let document = |scale: &str| {
        gltf_with_buffer(
            &format!(
                r#""nodes":[{{"mesh":0,"scale":{scale}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TANGENT":2}}}}]}}],"bufferViews":[{{"buffer":0,"byteLength":124}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":0,"byteOffset":40,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":0,"byteOffset":76,"componentType":5126,"count":3,"type":"VEC4"}}]"#
            ),
            &buffer,
        )
    };
    for scale in ["[1,1,1]", "[-1,1,1]", "[1,-3,1]", "[-1,-1,-1]", "[0.5,2,-1]"] {
        let model = load_text("a.gltf", &document(scale)).unwrap();
        let normal = model.corners.normals[0];
        assert!(normal_of(&model, 0).dot(normal.as_dvec3()) > 0.0, "{scale}");
    }
    // The bitangent is w * cross(normal, tangent); the plain one is +y, and a mirror of x leaves it there.
    let model = load_text("a.gltf", &document("[-1,1,1]")).unwrap();
    let (normal, tangent) = (model.corners.normals[0], model.corners.tangents[0]);
    assert_eq!(tangent, Vec4::new(-1., 0., 0., -1.));
    assert_eq!(normal.cross(tangent.truncate()) * tangent.w, Vec3::Y);
}

#[test]
fn lists_strips_and_fans_have_one_orientation() {
    let mut buffer = floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.]);
    buffer.extend([0, 1, 3, 2]);
    let document = |mode: u32, indices: &str| {
        gltf_with_buffer(
            &format!(
                r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":{mode}{indices}}},{{"attributes":{{"POSITION":0}},"mode":1}}]}}],"bufferViews":[{{"buffer":0,"byteLength":52}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},{{"bufferView":0,"byteOffset":48,"componentType":5121,"count":4,"type":"SCALAR"}}]"#
            ),
            &buffer,
        )
    };
    for (mode, indices, count) in [(4, "", 1), (5, "", 2), (6, r#","indices":1"#, 2)] {
        let model = load_text("a.gltf", &document(mode, indices)).unwrap();
        assert_eq!(model.triangles.len(), count, "mode {mode}");
        for triangle in 0..count {
            assert_eq!(normal_of(&model, triangle), DVec3::Z, "mode {mode}");
        }
        assert!(
            model.notes.iter().any(|n| n == "skipped 1 primitive of points or lines"),
            "{:?}",
            model.notes
        );
    }
    assert_mentions(
        &message("a.gltf", document(7, "").as_bytes()),
        &["primitive 0 of mesh 0", "unknown mode 7"],
    );
}

#[test]
fn quantised_and_normalised_attributes_are_scaled() {
    let mut buffer: Vec<u8> =
        [0i16, 0, 0, 0, 32767, 0, -32768, 0, 0, 16384, 0, 0].into_iter().flat_map(i16::to_le_bytes).collect();
    buffer.extend([0u8, 255, 51, 255, 0, 102, 0, 255, 255, 255, 255, 0]);
    buffer.extend([0u16, 65535, 13107, 0, 100, 200].into_iter().flat_map(u16::to_le_bytes));
    let document = |normalized: bool| {
        gltf_with_buffer(
            &format!(
                r#""extensionsRequired":["KHR_mesh_quantization"],"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"COLOR_0":1,"TEXCOORD_0":2}}}}]}}],"bufferViews":[{{"buffer":0,"byteLength":24,"byteStride":8}},{{"buffer":0,"byteOffset":24,"byteLength":24}}],"accessors":[{{"bufferView":0,"componentType":5122,"normalized":{normalized},"count":3,"type":"VEC3"}},{{"bufferView":1,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"}},{{"bufferView":1,"byteOffset":12,"componentType":5123,"normalized":{normalized},"count":3,"type":"VEC2"}}]"#
            ),
            &buffer,
        )
    };
    let model = load_text("a.gltf", &document(true)).unwrap();
    assert_eq!(model.positions[1], DVec3::new(1., 0., -1.));
    assert_eq!(model.corners.colors[0], Vec4::new(0., 1., 0.2, 1.));
    assert_eq!(model.corners.uv_sets[0][..2], [Vec2::new(0., 1.), Vec2::new(0.2, 0.)]);
    let model = load_text("a.gltf", &document(false)).unwrap();
    assert_eq!(model.positions[1], DVec3::new(32767., 0., -32768.));
    assert_eq!(model.corners.uv_sets[0][2], Vec2::new(100., 200.));
}

#[test]
fn sparse_accessors_replace_elements_of_a_view_or_of_zeros() {
    let mut buffer = triangle_buffer();
    buffer.extend([1u16, 2].into_iter().flat_map(u16::to_le_bytes));
    buffer.extend(floats(&[5., 6., 7., 8., 9., 10.]));
    let document = |base: &str, count: usize| {
        gltf_with_buffer(
            &format!(
                r#""nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":40,"byteLength":4}},{{"buffer":0,"byteOffset":44,"byteLength":24}}],"accessors":[{{{base}"componentType":5126,"count":{count},"type":"VEC3","sparse":{{"count":2,"indices":{{"bufferView":1,"componentType":5123}},"values":{{"bufferView":2}}}}}}]"#
            ),
            &buffer,
        )
    };
    for base in [r#""bufferView":0,"#, ""] {
        let model = load_text("a.gltf", &document(base, 3)).unwrap();
        assert_eq!(model.positions, [DVec3::ZERO, DVec3::new(5., 6., 7.), DVec3::new(8., 9., 10.)]);
    }
    let text = message("a.gltf", document("", 2).as_bytes());
    assert_mentions(&text, &["accessor 0", "element 2", "has 2"]);
}

#[test]
fn materials_carry_all_channels_transforms_and_samplers() {
    let texture = |extra: &str| format!(r#"{{"index":0{extra}}}"#);
    let transform = r#","texCoord":0,"extensions":{"KHR_texture_transform":{"offset":[0.5,0],"scale":[2,3],"texCoord":1}}"#;
    let rest = format!(
        r#","extensionsRequired":["KHR_texture_transform","KHR_materials_unlit"],"materials":[{{"name":"m","alphaMode":"MASK","alphaCutoff":0.25,"doubleSided":true,"emissiveFactor":[1,0.5,0],"pbrMetallicRoughness":{{"baseColorFactor":[0.1,0.2,0.3,0.4],"metallicFactor":0.6,"roughnessFactor":0.7,"baseColorTexture":{},"metallicRoughnessTexture":{}}},"normalTexture":{},"occlusionTexture":{},"emissiveTexture":{},"extensions":{{"KHR_materials_unlit":{{}},"KHR_materials_emissive_strength":{{"emissiveStrength":4}}}}}}],"textures":[{{"source":1,"sampler":0}}],"samplers":[{{"wrapS":33071,"wrapT":33648,"magFilter":9728}}],"images":[{{"uri":"data:image/png;base64,iVBORw=="}},{{"uri":"my%20textures/a%23b.png"}}]"#,
        texture(transform),
        texture(""),
        texture(r#","scale":0.5"#),
        texture(r#","strength":0.75"#),
        texture(""),
    );
    let text = triangle_gltf(r#"[{"mesh":0}]"#, r#","material":0"#, &rest)
        .replace(r#"{"POSITION":0}"#, r#"{"POSITION":0,"TEXCOORD_0":2,"TEXCOORD_1":2}"#);
    let text = text.replace(
        r#""type":"SCALAR"}"#,
        r#""type":"SCALAR"},{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}"#,
    );
    let model = load_text("a.gltf", &text).unwrap();
    assert_eq!(model.corners.uv_sets.len(), 2);
    let m = &model.materials[0];
    assert_eq!((m.name.as_str(), m.alpha, m.double_sided, m.unlit), ("m", AlphaMode::Mask(0.25), true, true));
    assert_eq!((m.base_color, m.metallic, m.roughness), (Vec4::new(0.1, 0.2, 0.3, 0.4), 0.6, 0.7));
    assert_eq!((m.emission, m.normal_scale, m.occlusion_strength), (Vec3::new(4., 2., 0.), 0.5, 0.75));
    let base = m.base_color_texture.as_ref().unwrap();
    assert_eq!((base.image, base.uv_set, base.nearest), (1, 1, true));
    assert_eq!(base.wrap, [WrapMode::Clamp, WrapMode::Mirror]);
    assert_eq!(base.uv_transform.transform_point2(Vec2::ONE), Vec2::new(2.5, 3.0));
    for texture in
        [&m.metallic_roughness_texture, &m.normal_texture, &m.occlusion_texture, &m.emission_texture]
    {
        assert_eq!(texture.as_ref().unwrap().uv_set, 0);
    }
    let ImageSource::Embedded { label, bytes } = &model.images[0] else { panic!() };
    assert_eq!((label.as_str(), &bytes[..]), ("image 0 of a.gltf", &b"\x89PNG"[..]));
    let ImageSource::File(path) = &model.images[1] else { panic!() };
    assert!(path.ends_with("my textures/a#b.png"), "{}", path.display());
}

#[test]
fn primitives_without_material_get_the_default_one() {
    let model = load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, "", "")).unwrap();
    let expected = Material { metallic: 1.0, roughness: 1.0, double_sided: false, ..Material::default() };
    assert_eq!(model.materials, [expected]);
    assert!(model.triangle_materials.is_empty());
    let rest = r#","materials":[{"name":"unused"}]"#;
    let model = load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, "", rest)).unwrap();
    assert_eq!((model.materials.len(), &model.triangle_materials[..]), (2, &[1][..]));
}

#[test]
fn external_buffers_are_found_by_decoded_relative_paths() {
    let text = triangle_gltf(r#"[{"mesh":0}]"#, r#","indices":1"#, "");
    let start = text.find("data:").unwrap();
    let end = start + text[start..].find('"').unwrap();
    let with_uri = |uri: &str| [&text[..start], uri, &text[end..]].concat();
    let files = |uri: &str| {
        let text = with_uri(uri);
        load_files(&[
            ("a.gltf", text.as_bytes()),
            ("my data/b+ü.bin", &triangle_buffer()),
            ("short.bin", b"abc"),
        ])
    };
    assert_eq!(files("my%20data/b+%C3%BC.bin").unwrap().triangles, [[0, 1, 2]]);
    let refused = |uri: &str| files(uri).expect_err("must be refused").to_string();
    assert_mentions(&refused("my%20data"), &["buffer 0", "cannot read", "not a regular file"]);
    assert_mentions(&refused("missing.bin"), &["buffer 0", "cannot read", "missing.bin"]);
    assert_mentions(&refused("short.bin"), &["buffer 0", "should have 40 bytes", "are 3"]);
    for uri in ["http://example.com/a.bin", "/etc/hostname", "file:///a.bin", "C:/a.bin", "%2Fetc/hostname"] {
        assert_mentions(&refused(uri), &["buffer 0", "is not relative"]);
    }
    assert_mentions(&refused("data:application/octet-stream;base64,@@@"), &["buffer 0", "not base64"]);
    assert_mentions(&refused("data:nothing"), &["buffer 0", "no comma"]);
    // Base64 as a query string would have it.
    let (head, data) = text[start..end].split_once(',').unwrap();
    let escaped = data.replace('A', "%41").replace('/', "%2F").replace('=', "%3D");
    assert_ne!(data, escaped);
    assert_eq!(files(&format!("{head},{escaped}")).unwrap().triangles, [[0, 1, 2]]);
    assert_eq!(files(&format!("{},{data}", head.to_uppercase())).unwrap().triangles, [[0, 1, 2]]);
}

#[test]
fn materials_that_no_triangle_has_are_not_spoken_of() {
    let notes = |material: u32| {
        let rest = r#","materials":[{"normalTexture":{"index":0}},{}],"textures":[{"source":0}],"images":[{"uri":"a.png"}]"#;
        let primitive = format!(r#","material":{material}"#);
        load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, &primitive, rest)).unwrap().notes
    };
    assert_mentions(&notes(0).join("\n"), &["material 0: a texture was left out"]);
    assert_eq!(notes(1), Vec::<String>::new());
}

#[test]
fn required_extensions_that_cannot_be_read_are_named() {
    let rest = r#","extensionsRequired":["KHR_texture_transform","KHR_strange","EXT_unheard_of"]"#;
    let text = message("a.gltf", triangle_gltf(r#"[{"mesh":0}]"#, "", rest).as_bytes());
    assert_mentions(&text, &["requires KHR_strange, EXT_unheard_of,", "export it without"]);
    let rest = r#","extensionsRequired":["KHR_materials_clearcoat"]"#;
    let model = load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, "", rest)).unwrap();
    assert!(model.notes[0].contains("KHR_materials_clearcoat"), "{:?}", model.notes);
    let rest = r#","extensionsUsed":["KHR_materials_unlit","KHR_materials_sheen","KHR_lights_punctual"]"#;
    let model = load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, "", rest)).unwrap();
    assert_eq!(model.notes, ["extensions that fantex does not read were ignored: KHR_materials_sheen"]);
    let cloth = |name: &str| format!(r#"{{"name":"{name}","extensions":{{"KHR_materials_sheen":{{}}}}}}"#);
    let with = |names: &[&str]| {
        let materials: Vec<_> = names.iter().map(|name| cloth(name)).collect();
        let rest = format!("{rest},\"materials\":[{{}},{}]", materials.join(","));
        load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, "", &rest)).unwrap().notes.remove(0)
    };
    assert!(with(&["seat"]).ends_with(r#"KHR_materials_sheen (of material "seat")"#));
    assert!(with(&["a", "b", "c", "d", "e"]).ends_with(r#"(of materials "a", "b", "c" and 2 more)"#));
}

#[test]
fn what_is_there_without_compression_is_taken() {
    let primitive = r#","extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{}}}"#;
    let with_fallback = triangle_gltf(r#"[{"mesh":0}]"#, primitive, "");
    assert_eq!(load_text("a.gltf", &with_fallback).unwrap().triangles.len(), 1);
    let view = r#""accessors":[{"bufferView":0,"#;
    let without = with_fallback.replacen(view, r#""accessors":[{"#, 1);
    let text = message("a.gltf", without.as_bytes());
    assert_mentions(&text, &["primitive 0 of mesh 0", "Draco"]);
}

#[test]
fn specular_glossiness_stands_in_for_metallic_roughness() {
    let material = |pbr: &str| {
        let glossy = r#""KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0.5,0.25,1,0.5],"glossinessFactor":0.75}"#;
        let rest = format!(r#","materials":[{{{pbr}"extensions":{{{glossy}}}}}]"#);
        let text = triangle_gltf(r#"[{"mesh":0}]"#, r#","material":0"#, &rest);
        let model = load_text("a.gltf", &text).unwrap();
        (model.materials[0].clone(), model.notes.len())
    };
    let (m, notes) = material("");
    assert_eq!(
        (m.base_color, m.metallic, m.roughness, notes),
        (Vec4::new(0.5, 0.25, 1.0, 0.5), 0.0, 0.25, 1)
    );
    // What was written for us goes first.
    let (m, notes) = material(r#""pbrMetallicRoughness":{"roughnessFactor":0.6},"#);
    assert_eq!((m.base_color, m.metallic, m.roughness, notes), (Vec4::ONE, 1.0, 0.6, 0));
}

#[test]
fn wrong_references_are_named() {
    let plain = |nodes: &str, primitive: &str, rest: &str| {
        message("a.gltf", triangle_gltf(nodes, primitive, rest).as_bytes())
    };
    let node = r#"[{"mesh":0}]"#;
    assert_mentions(&plain(r#"[{"mesh":4}]"#, "", ""), &["node 0 refers to mesh 4, but there is 1"]);
    assert_mentions(&plain(r#"[{"mesh":4294967296}]"#, "", ""), &["node 0 refers to mesh 4294967296"]);
    assert_mentions(&plain(r#"[{"children":[9]}]"#, "", ""), &["node 9", "but there is 1"]);
    assert_mentions(&plain(node, r#","material":2"#, ""), &["primitive 0 of mesh 0 refers to material 2"]);
    assert_mentions(&plain(node, r#","indices":7"#, ""), &["primitive 0 of mesh 0 refers to accessor 7"]);
    assert_mentions(
        &plain(node, r#","indices":0"#, ""),
        &["accessor 0", "VEC3 floats", "indices needs single"],
    );
    assert_mentions(&plain(node, "", r#","scene":3"#), &["scene 3"]);
    let cycle = r#"[{"children":[1]},{"children":[2],"mesh":0},{"children":[1]}]"#;
    assert_mentions(&plain(cycle, "", r#","scenes":[{"nodes":[0]}]"#), &["node 1 is reached twice"]);
    let text = triangle_gltf(node, r#","indices":1"#, "");
    let vertex = text
        .replace(r#""byteOffset":36"#, r#""byteOffset":3"#)
        .replace(r#""count":3,"type":"SCALAR""#, r#""count":36,"type":"SCALAR""#);
    assert_mentions(&message("a.gltf", vertex.as_bytes()), &["primitive 0 of mesh 0 refers to vertex 128"]);
    let view = text.replace(r#""byteLength":40}]"#, r#""byteLength":41}]"#);
    assert_mentions(
        &message("a.gltf", view.as_bytes()),
        &["buffer view 0 covers bytes 0 to 41 of buffer 0, which has 40"],
    );
    let count = text
        .replace(r#"{"POSITION":0}"#, r#"{"POSITION":0,"NORMAL":1}"#)
        .replace(r#""count":3,"type":"SCALAR""#, r#""count":2,"type":"SCALAR""#);
    assert_mentions(&message("a.gltf", count.as_bytes()), &["3 positions, but 2 values of NORMAL"]);
    let version = text.replace(r#""version":"2.0""#, r#""version":"1.0""#);
    assert_mentions(&message("a.gltf", version.as_bytes()), &["version \"1.0\"", "2.0"]);
    // Whose lists are objects.
    let version = r#"{"accessors":{"a":{"count":3}},"asset":{"version":"1.0"}}"#;
    assert_mentions(&message("a.gltf", version.as_bytes()), &["version \"1.0\"", "convert it"]);
    assert_mentions(&message("a.gltf", b"{\"asset\":"), &["JSON", "line 1"]);
    assert_mentions(&message("a.glb", b"glTF\x01\0\0\0\x0c\0\0\0"), &["container of version 1"]);
}

/// Two instances of a triangle below a node that is itself moved; `attributes` and `accessors` go into the file.
fn instanced_gltf(attributes: &str, accessors: &str, rest: &str) -> String {
    let mut buffer = triangle_buffer();
    buffer.extend(floats(&[1., 0., 0., 0., 5., 0.]));
    // A half turn about z in normalised bytes, and none.
    buffer.extend([0i8, 0, 127, 0, 0, 0, 0, 127].map(|b| b as u8));
    buffer.extend(floats(&[1., 1., 1., -2., 1., 1.]));
    gltf_with_buffer(
        &format!(
            r#""extensionsRequired":["EXT_mesh_gpu_instancing"],"nodes":[{{"mesh":0,"translation":[100,0,0],"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{{attributes}}}}}}}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}},{{"attributes":{{"POSITION":0}},"mode":1}}]}}],"bufferViews":[{{"buffer":0,"byteLength":{}}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":0,"byteOffset":40,"componentType":5126,"count":2,"type":"VEC3"}},{{"bufferView":0,"byteOffset":64,"componentType":5120,"normalized":true,"count":2,"type":"VEC4"}},{{"bufferView":0,"byteOffset":72,"componentType":5126,"count":2,"type":"VEC3"}}{accessors}]{rest}"#,
            buffer.len()
        ),
        &buffer,
    )
}

#[test]
fn every_instance_is_loaded_scaled_turned_and_moved_below_its_node() {
    let attributes = r#""TRANSLATION":1,"ROTATION":2,"SCALE":3,"_ID":77"#;
    let model = load_text("a.gltf", &instanced_gltf(attributes, "", "")).unwrap();
    assert_consistent(&model);
    let expected = [
        [101.0, 0.0, 0.0],
        [100.0, 0.0, 0.0],
        [101.0, -1.0, 0.0],
        [100.0, 5.0, 0.0],
        [98.0, 5.0, 0.0],
        [100.0, 6.0, 0.0],
    ];
    for (found, expected) in model.positions.iter().zip(expected.map(DVec3::from)) {
        assert!((*found - expected).length() < 1e-6, "{found} for {expected}");
    }
    // The second is mirrored, and both look along z.
    assert_eq!(model.triangles.len(), 2);
    assert!((0..2).all(|t| normal_of(&model, t).z > 0.0));
    // What is to be said of a mesh is said once.
    assert_eq!(model.notes, ["skipped 1 primitive of points or lines"]);

    let model = load_text("a.gltf", &instanced_gltf(r#""SCALE":3"#, "", "")).unwrap();
    assert_eq!(model.positions[4], DVec3::new(98.0, 0.0, 0.0));
    let model = load_text("a.gltf", &instanced_gltf("", "", "")).unwrap();
    assert_eq!(model.triangles.len(), 1);
}

#[test]
fn instances_that_make_no_sense_are_refused() {
    let refuse = |attributes: &str, accessors: &str| {
        message("a.gltf", instanced_gltf(attributes, accessors, "").as_bytes())
    };
    assert_mentions(
        &refuse(r#""TRANSLATION":9"#, ""),
        &["TRANSLATION of the instances of node 0 refers to accessor 9"],
    );
    assert_mentions(&refuse(r#""TRANSLATION":2"#, ""), &["accessor 2", "TRANSLATION needs three floats"]);
    assert_mentions(
        &refuse(r#""TRANSLATION":0,"SCALE":3"#, ""),
        &["node 0 has 3 values of TRANSLATION for its instances, but 2 of SCALE"],
    );
    // A few letters must not ask for any amount of memory.
    let zeros = r#",{"componentType":5126,"count":4000000000000,"type":"VEC3"}"#;
    assert_mentions(&refuse(r#""TRANSLATION":4"#, zeros), &["triangles", "limit"]);
    let million = zeros.replace("4000000000000", "1000000");
    let of = |mebibytes: u64| {
        ReadLimits::new(ReadOptions { memory_bytes: mebibytes << 20, ..ReadOptions::default() })
    };
    let message = of(200).run(|| refuse(r#""TRANSLATION":4"#, &million));
    assert_mentions(&message, &["1000000 instances of node 0"]);
    // Those of a mesh without triangles take no place.
    let empty = instanced_gltf(r#""TRANSLATION":4"#, &million, "")
        .replace(r#""nodes":[{"mesh":0,"#, r#""nodes":[{"mesh":0},{"mesh":1,"#)
        .replace(r#"]}],"bufferViews""#, r#"]},{"primitives":[]}],"bufferViews""#);
    assert_eq!(of(16).run(|| load_text("a.gltf", &empty)).unwrap().triangles.len(), 1);
}

/// A 16-fold nested chain of nodes is fine, and so is one of a hundred thousand: nothing recurses.
#[test]
fn deep_hierarchies_do_not_overflow_the_stack() {
    let depth = 100_000;
    let mut nodes: Vec<String> = (1..depth).map(|child| format!(r#"{{"children":[{child}]}}"#)).collect();
    nodes.push(r#"{"mesh":0}"#.to_owned());
    let model = load_text("a.gltf", &triangle_gltf(&format!("[{}]", nodes.join(",")), "", "")).unwrap();
    assert_eq!(model.triangles.len(), 1);
}

#[test]
fn non_finite_positions_are_left_to_cleaning() {
    let buffer = floats(&[f32::NAN, 0., 0., f32::INFINITY, 0., 0., 0., 1., 0., 0.]);
    let text = triangle_gltf(r#"[{"mesh":0,"scale":[0,0,0]}]"#, "", "");
    let start = text.find("base64,").unwrap() + 7;
    let end = start + text[start..].find('"').unwrap();
    use base64::Engine as _;
    let data = base64::engine::general_purpose::STANDARD.encode(buffer);
    let model = load_text("a.gltf", &[&text[..start], &data, &text[end..]].concat()).unwrap();
    assert_consistent(&model);
    assert!(model.positions[0].x.is_nan());
}

#[test]
fn nodes_give_their_names_to_parts() {
    let nodes = r#"[{"name":"left","mesh":0},{"mesh":0,"translation":[2,0,0]},{"name":"empty"}]"#;
    let named = triangle_gltf(nodes, "", "").replace(r#"[{"primitives""#, r#"[{"name":"leg","primitives""#);
    let model = load_text("a.gltf", &named).unwrap();
    assert_eq!((model.parts.names, model.parts.of_triangle), (vec!["left".into(), "leg".into()], vec![0, 1]));
    let single = load_text("a.gltf", &triangle_gltf(r#"[{"name":"left","mesh":0}]"#, "", "")).unwrap();
    assert_eq!((single.parts.names, single.parts.of_triangle), (vec!["left".into()], vec![]));
    let unnamed = load_text("a.gltf", &triangle_gltf(r#"[{"mesh":0}]"#, "", "")).unwrap();
    assert_eq!(unnamed.parts, Parts::default());
}

/// A triangle with a morph target and a skin of two joints, the second a quarter turn about z at (1, 0, 0), where it was bound unturned.
fn posed_gltf(nodes: &str, weights: &str) -> String {
    let mut buffer = floats(&[2., 0., 0., 2., 0., 0., 0., 3., 0.]);
    buffer.extend(floats(&[0., 0., 1., 0., 0., 2., 0., 0., 3.]));
    // Joints: the first; both; the second (twice, in two parts).
    buffer.extend([0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1, 0]);
    buffer.extend(floats(&[1., 0., 0., 0., 0.5, 0.5, 0., 0., 0.25, 0., 0.75, 0.]));
    let matrix = |x: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, 0., 0., 1.];
    buffer.extend(floats(&matrix(0.)));
    buffer.extend(floats(&matrix(-1.)));
    let accessor = |offset: usize, kind: u32, count: u32, shape: &str| {
        format!(
            r#"{{"bufferView":0,"byteOffset":{offset},"componentType":{kind},"count":{count},"type":"{shape}"}}"#
        )
    };
    let accessors = [
        (0, 5126, 3, "VEC3"),
        (36, 5126, 3, "VEC3"),
        (72, 5121, 3, "VEC4"),
        (84, 5126, 3, "VEC4"),
        (132, 5126, 2, "MAT4"),
    ]
    .map(|(offset, kind, count, shape)| accessor(offset, kind, count, shape))
    .join(",");
    let json = format!(
        r#""nodes":[{nodes},{{"name":"a"}},{{"name":"b","translation":[1,0,0],"rotation":[0,0,0.70710678118654757,0.70710678118654757]}}],
        "meshes":[{{"weights":[{weights}],"primitives":[{{"attributes":{{"POSITION":0,"JOINTS_0":2,"WEIGHTS_0":3}},"targets":[{{"POSITION":1}}]}}]}}],
        "skins":[{{"joints":[1,2],"inverseBindMatrices":4}}],"bufferViews":[{{"buffer":0,"byteLength":260}}],"accessors":[{accessors}]"#
    );
    gltf_with_buffer(&json, &buffer)
}

fn assert_positions(text: &str, expected: [[f64; 3]; 3]) {
    let model = load_text("a.gltf", text).unwrap();
    assert_eq!(model.notes, Vec::<String>::new());
    for (found, expected) in model.positions.iter().zip(expected.map(DVec3::from)) {
        assert!((*found - expected).length() < 1e-6, "{found} for {expected}");
    }
}

#[test]
fn morph_targets_are_shown_by_their_weights() {
    let plain = r#"{"mesh":0,"translation":[10,0,0]}"#;
    assert_positions(&posed_gltf(plain, "0.5"), [[12., 0., 0.5], [12., 0., 1.], [10., 3., 1.5]]);
    let own = r#"{"mesh":0,"weights":[-2]}"#;
    assert_positions(&posed_gltf(own, "0.5"), [[2., 0., -2.], [2., 0., -4.], [0., 3., -6.]]);
    assert_positions(&posed_gltf(r#"{"mesh":0}"#, ""), [[2., 0., 0.], [2., 0., 0.], [0., 3., 0.]]);

    // Colours and texture coordinates, too; colours end between 0 and 1.
    let text = posed_gltf(r#"{"mesh":0}"#, "0.5")
        .replace(r#""JOINTS_0":2,"WEIGHTS_0":3"#, r#""COLOR_0":3,"TEXCOORD_0":5"#)
        .replace(r#"[{"POSITION":1}]"#, r#"[{"COLOR_0":1,"TEXCOORD_0":6}]"#)
        .replace(
            r#""MAT4"}]"#,
            r#""MAT4"},{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"},{"bufferView":0,"byteOffset":84,"componentType":5126,"count":3,"type":"VEC2"}]"#,
        );
    let model = load_text("a.gltf", &text).unwrap();
    let expected = [Vec4::new(1., 0., 0.5, 0.), Vec4::new(0.5, 0.5, 1., 0.), Vec4::new(0.25, 0., 1., 0.)];
    assert_eq!(model.corners.colors, expected);
    let expected = [Vec2::new(2.5, 0.), Vec2::new(0., 2.), Vec2::new(0.25, 0.25)];
    assert_eq!(model.corners.uv_sets, [expected]);
}

/// A point at (2, 0, 0) is, seen from the second joint, at (1, 0, 0), which the quarter turn takes to (0, 1, 0), in the world (1, 1, 0);
/// (0, 3, 0) comes to (-2, -1, 0). The node's own place has no say.
#[test]
fn skins_are_shown_as_their_joints_stand() {
    let skinned = r#"{"mesh":0,"skin":0,"translation":[10,0,0]}"#;
    assert_positions(&posed_gltf(skinned, ""), [[2., 0., 0.], [1.5, 0.5, 0.], [-2., -1., 0.]]);
    // Both at once: targets first.
    assert_positions(&posed_gltf(skinned, "1"), [[2., 0., 1.], [1.5, 0.5, 2.], [-2., -1., 3.]]);
    let refused =
        |text: String, mentions: &[&str]| assert_mentions(&message("a.gltf", text.as_bytes()), mentions);
    let text = posed_gltf(skinned, "");
    refused(
        text.replace(r#""joints":[1,2]"#, r#""joints":[1]"#),
        &["primitive 0 of mesh 0", "joint 1", "1 joint"],
    );
    refused(
        text.replace(r#""joints":[1,2]"#, r#""joints":[1,2,1]"#),
        &["skin 0", "3 joints", "2 inverseBindMatrices"],
    );
    refused(text.replace(r#""joints":[1,2]"#, r#""joints":[1,7]"#), &["skin 0", "node 7"]);
    refused(text.replace(r#""skin":0"#, r#""skin":3"#), &["node 0", "skin 3"]);
    let elsewhere =
        text.replace(r#""nodes":[{"mesh""#, r#""scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh""#);
    let model = load_text("a.gltf", &elsewhere).unwrap();
    assert!(model.notes[0].contains("joints are not in the scene"), "{:?}", model.notes);
    assert_eq!(model.positions[0], DVec3::new(12.0, 0.0, 0.0));
}
