//! Every shipped model loads with the expected number of triangles, and glTF files give what another reader gives.

use std::path::{Path, PathBuf};

use fantex_mesh::{
    AlphaMode, ImageChannel, ImageSource, LoadOptions, Model, TextureRef, WrapMode, WriteGeometry, load,
    write_model,
};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::common::*;

/// Triangle counts of `MESHES.tsv` are those of another loader (trimesh); polygons of n corners count n - 2 there too.
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
        assert_consistent(&model);
        let expected: usize = fields[faces].parse().unwrap();
        if model.triangles.len() != expected {
            wrong.push(format!("{}: {} triangles, not {expected}", fields[0], model.triangles.len()));
        }
        count += 1;
    }
    assert!(count >= 29, "only {count} models");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Bounding boxes of `MESHES.tsv`: node transforms, offsets and byte orders are right.
#[test]
fn all_shipped_models_have_the_known_extent() {
    let Some(folder) = data_folder() else { return };
    let table = std::fs::read_to_string(folder.join("MESHES.tsv")).unwrap();
    for row in table.lines().skip(1) {
        let fields: Vec<&str> = row.split('\t').collect();
        let Some((low, high)) = fields[18].split_once("..") else { panic!("no extent in {row}") };
        let parse = |text: &str| {
            let numbers: Vec<f64> = text.split(' ').map(|x| x.parse().unwrap()).collect();
            DVec3::from_slice(&numbers)
        };
        let (low, high) = (parse(low), parse(high));
        let model = load(&folder.join(fields[0]), &LoadOptions::default()).unwrap();
        let used = || model.triangles.iter().flatten().map(|&v| model.positions[v as usize]);
        let tolerance = 2e-4 * (high - low).length() + 1e-4 * high.abs().max(low.abs()).max_element();
        let found = (used().fold(DVec3::MAX, DVec3::min), used().fold(DVec3::MIN, DVec3::max));
        assert!((found.0 - low).length() < tolerance, "{}: {} for {low}", fields[0], found.0);
        assert!((found.1 - high).length() < tolerance, "{}: {} for {high}", fields[0], found.1);
    }
}

#[test]
fn the_water_bottle_has_all_its_channels() {
    let Some(folder) = data_folder() else { return };
    let model = load(&folder.join("meshes/WaterBottle/WaterBottle.gltf"), &LoadOptions::default()).unwrap();
    let [material] = &model.materials[..] else { panic!("{} materials", model.materials.len()) };
    let image =
        |texture: &Option<fantex_mesh::TextureRef>| match &model.images[texture.as_ref().unwrap().image] {
            ImageSource::File(path) => path.clone(),
            other => panic!("{other:?}"),
        };
    for (texture, name) in [
        (&material.base_color_texture, "baseColor"),
        (&material.metallic_roughness_texture, "occlusionRoughnessMetallic"),
        (&material.normal_texture, "normal"),
        (&material.occlusion_texture, "occlusionRoughnessMetallic"),
        (&material.emission_texture, "emissive"),
    ] {
        let path = image(texture);
        assert!(path.ends_with(format!("WaterBottle_{name}.png")), "{}", path.display());
        assert!(path.is_file());
    }
    assert_eq!(model.corners.tangents.len(), 3 * 4510);
    assert_eq!(model.name, "WaterBottle.gltf");
}

#[test]
fn embedded_images_are_whole() {
    let Some(folder) = data_folder() else { return };
    let model =
        load(&folder.join("landscapes/coast_terrain_satellite.glb"), &LoadOptions::default()).unwrap();
    assert_eq!(model.images.len(), 3);
    for image in &model.images {
        let ImageSource::Embedded { label, bytes } = image else { panic!("{image:?}") };
        assert!(bytes.starts_with(b"\x89PNG") && bytes[bytes.len() - 8..].starts_with(b"IEND"), "{label}");
        assert!(label.contains("coast_terrain_satellite.glb"), "{label}");
    }
}

/// Single-node files against the gltf crate's own accessor readers.
#[test]
fn gltf_attributes_equal_those_of_another_reader() {
    let Some(folder) = data_folder() else { return };
    for name in [
        "meshes/WaterBottle/WaterBottle.gltf",
        "landscapes/Tunnel.glb",
        "landscapes/coast_terrain_satellite.glb",
    ] {
        let path = folder.join(name);
        let ours = load(&path, &LoadOptions::default()).unwrap();
        let theirs = gltf::Gltf::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let bytes = match &theirs.blob {
            Some(blob) => blob.clone(),
            None => std::fs::read(path.with_extension("bin")).unwrap(),
        };
        let primitive = theirs.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(&bytes));
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let normals: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
        let uvs: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
        assert_eq!(ours.triangles.as_flattened(), indices);
        // The bottle's node turns it half round about the vertical axis, so distances are compared, not coordinates.
        for (ours, theirs) in ours.positions.iter().zip(&positions) {
            assert!((ours.length() - Vec3::from(*theirs).as_dvec3().length()).abs() < 1e-5);
        }
        for (corner, &index) in indices.iter().enumerate() {
            assert_eq!(ours.corners.uv_sets[0][corner], Vec2::from(uvs[index as usize]));
            let normal = Vec3::from(normals[index as usize]);
            assert!((ours.corners.normals[corner].y - normal.normalize().y).abs() < 1e-5);
        }
    }
}

// OBJ and MTL.

#[test]
fn indices_count_from_one_or_backwards_and_may_point_forward() {
    let text = "f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4/ -2// 4\n";
    let model = load_text("a.obj", text).unwrap();
    assert_eq!(model.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
}

#[test]
fn small_edges_far_from_the_origin_survive() {
    let text = "v 10000000.001 0 0\nv 10000000.002 0 0\nv 10000000.001 0.001 0\nf 1 2 3\n";
    let model = load_text("a.obj", text).unwrap();
    let [a, b, _] = model.triangles[0].map(|v| model.positions[v as usize]);
    assert!(((b - a).x - 1e-3).abs() < 1e-8);
}

#[test]
fn concave_polygons_are_cut_inside() {
    let text = "v 0 0 0\nv 2 1 0\nv 0 2 0.05\nv 0.5 1 0\nf 1 2 3 4\n";
    let model = load_text("a.obj", text).unwrap();
    assert_eq!(model.triangles.len(), 2);
    for t in &model.triangles {
        let [a, b, c] = t.map(|v| model.positions[v as usize]);
        assert!((b - a).cross(c - a).z > 0.0);
    }
}

#[test]
fn corners_keep_their_own_attributes() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0.25 0.75\nvt 0.5 0\nvn 0 0 2\nvn 0 1 0\nf 1/1/1 2/2/1 3/1/2\nf 2//1 4//1 3//1\nf 2 4 3\n";
    let model = load_text("a.obj", text).unwrap();
    assert_eq!(model.positions.len(), 4);
    assert_eq!(
        model.corners.uv_sets[0][..3],
        [Vec2::new(0.25, 0.25), Vec2::new(0.5, 1.0), Vec2::new(0.25, 0.25)]
    );
    assert_eq!(model.corners.normals[..3], [glam::Vec3::Z, glam::Vec3::Z, glam::Vec3::Y]);
    assert_eq!(model.corners.normals[8], glam::Vec3::Z);
    assert_consistent(&model);
}

#[test]
fn vertex_colours_become_linear() {
    let model = load_text("a.obj", "v 0 0 0 1 0.5 0\nv 1 0 0 0 0 0\nv 0 1 0 nan 0 0\nf 1 2 3\n").unwrap();
    let [first, _, broken] = model.corners.colors[..] else { panic!() };
    assert!((first - Vec4::new(1., 0.214_041, 0., 1.)).length() < 1e-4);
    assert_eq!(broken, Vec4::ONE);
    let model = load_text("a.obj", "v 0 0 0 255 0 0\nv 1 0 0 0 255 0\nv 0 1 0 0 0 255\nf 1 2 3\n").unwrap();
    assert_eq!(model.corners.colors[0], Vec4::new(1., 0., 0., 1.));
    // A fourth number alone is a weight.
    assert!(
        load_text("a.obj", "v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n").unwrap().corners.colors.is_empty()
    );
}

#[test]
fn comments_continuations_line_ends_and_odd_bytes_are_taken() {
    let text = b"\xef\xbb\xbf# caf\xe9\r\nv 0 0 0 # origin\r\n\tv 1 0 0\r\nv 0 \\\r\n 1 0\r\no caf\xe9\r\nf 1 2 \\\r\n3 # face\r\ncurv 1 2\r\nf 1 2 3";
    let model = load_files(&[("a.obj", text)]).unwrap();
    assert_eq!(model.triangles.len(), 2);
    assert!(model.notes[0].contains("line 9: curv"), "{:?}", model.notes);
}

#[test]
fn lines_may_end_with_a_carriage_return_alone() {
    let library = ("m.mtl", &b"newmtl a\rKd 1 0 0\rmap_Kd A.PNG\r"[..]);
    let model = b"mtllib M.mtl\rv 0 0 0\rv 1 0 0\rv 0 1 0\rvt 0 0\rusemtl a\rf 1/1 2/1 \\\r3/1\r";
    let model = load_files(&[("a.obj", model), library, ("a.png", b"x")]).unwrap();
    assert_eq!((model.triangles.len(), model.notes.len()), (1, 0), "{:?}", model.notes);
    let ImageSource::File(path) = &model.images[0] else { panic!() };
    assert!(path.ends_with("a.png"), "{}", path.display());
}

#[test]
fn errors_name_the_line() {
    let refuse = |text: &str| message("a.obj", text.as_bytes());
    assert_mentions(&refuse("v 0 0 0\nv 1 x 0\n"), &["a.obj: line 2:", "number", "\"x\""]);
    assert_mentions(&refuse("v 0 0\n"), &["line 1:", "v needs at least 3 numbers", "has 2"]);
    assert_mentions(&refuse("v 0 0 0\n\nf 1 1 0\n"), &["line 3:", "position 0", "there is 1"]);
    assert_mentions(&refuse("v 0 0 0\nf 1 1 2\nf 1 1 1\n"), &["line 2:", "position 2", "there is 1"]);
    assert_mentions(&refuse("v 0 0 0\nf 1 1 -2\n"), &["line 2:", "position -2"]);
    let uv = "v 0 0 0\nvt 0 0\nf 1/1 1/2 1/1\n";
    assert_mentions(&refuse(uv), &["line 3:", "texture coordinate 2", "there is 1"]);
    assert_mentions(&refuse("v 0 0 0\nvn 0 0 1\nf 1//3 1 1\n"), &["line 3:", "normal 3", "there is 1"]);
    assert_mentions(&refuse("v 0 0 0\nf 1/1/1/1 1 1\n"), &["line 2:", "face corner", "1/1/1/1"]);
    assert_mentions(&refuse("v 0 0 0\nf 4294967296 1 1\n"), &["line 2:", "position 4294967296"]);
    assert_mentions(&refuse("v 0 0 0\nf 99999999999999999999 1 1\n"), &["line 2:", "face corner"]);
    assert_mentions(&refuse("v 0 0 \\\n 0\nv 1 0 0\nf 1 2 a\n"), &["line 4:", "\"a\""]);
}

/// A name with spaces comes before several names.
#[test]
fn a_line_may_name_several_material_libraries() {
    let text = "mtllib a.mtl b.mtl gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl green\nf 1 2 3\n";
    let files: [(&str, &[u8]); 3] = [
        ("a.obj", text.as_bytes()),
        ("a.mtl", b"newmtl red\nKd 1 0 0\n"),
        ("b.mtl", b"newmtl green\nKd 0 1 0\n"),
    ];
    let model = load_files(&files).unwrap();
    let colors: Vec<Vec4> = model.materials.iter().map(|material| material.base_color).collect();
    assert_eq!(colors, [Vec4::new(1., 0., 0., 1.), Vec4::new(0., 1., 0., 1.)]);
    assert_mentions(&model.notes.join("\n"), &["the material file gone.mtl cannot be read"]);
    let whole: &[u8] = b"newmtl red\nKd 0 0 1\nnewmtl green\nKd 0 0 1\n";
    let model = load_files(&[files[0], files[1], files[2], ("a.mtl b.mtl gone.mtl", whole)]).unwrap();
    assert!(model.materials.iter().all(|material| material.base_color == Vec4::new(0., 0., 1., 1.)));
    assert_eq!(model.notes.len(), 0, "{:?}", model.notes);
    let model = load_files(&[("a.obj", b"mtllib my lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")]).unwrap();
    assert_mentions(&model.notes.join("\n"), &["the material file my lib.mtl cannot be read"]);
}

const LIBRARY: &str = "newmtl shiny\nKd 1 0.5 0\nKe 0 0 1\nd 0.5\nPr 0.3\nPm 0.8\nmap_Kd -s 2 3 1 -o 0.25 0.5 -clamp on my image.png\nnorm -bm 0.5 n.png\nmap_Ks s.png\n\nnewmtl cut\nmap_Kd tex\\leaf.png\nmap_d tex\\leaf.png\nmap_Ke C:\\work\\glow.png\nmap_Bump bump.png\nNs 0\nmap_Pr rough.png\n";

#[test]
fn material_libraries_are_read() {
    let text = "mtllib my lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl shiny\nf 1/1 2/1 3/1\nusemtl cut\nf 1/1 2/1 3/1\nusemtl none\nf 3 2 1\n";
    let model = load_files(&[("a.obj", text.as_bytes()), ("my lib.mtl", LIBRARY.as_bytes())]).unwrap();
    assert_eq!(model.triangle_materials, [0, 1, 2]);
    let [shiny, cut, none] = &model.materials[..] else { panic!("{} materials", model.materials.len()) };
    assert!((shiny.base_color - Vec4::new(1., 0.214_041, 0., 0.5)).length() < 1e-4);
    assert_eq!((shiny.roughness, shiny.metallic, shiny.alpha), (0.3, 0.8, AlphaMode::Blend));
    assert_eq!((shiny.emission, shiny.normal_scale), (glam::Vec3::Z, 0.5));
    let base = shiny.base_color_texture.as_ref().unwrap();
    assert_eq!(base.wrap, [WrapMode::Clamp; 2]);
    // Written with v upwards: (u, v) -> (2u + 0.25, 3v + 0.5).
    let below = Vec2::new(0.1, 1.0 - 0.2);
    assert!((base.uv_transform.transform_point2(below) - Vec2::new(0.45, 1.0 - 1.1)).length() < 1e-6);
    let name = |image: usize| match &model.images[image] {
        ImageSource::File(path) => path.file_name().unwrap().to_str().unwrap().to_owned(),
        other => panic!("{other:?}"),
    };
    assert_eq!(name(base.image), "my image.png");
    assert_eq!(name(shiny.normal_texture.as_ref().unwrap().image), "n.png");
    assert_eq!(cut.alpha, AlphaMode::Blend);
    assert_eq!(name(cut.base_color_texture.as_ref().unwrap().image), "leaf.png");
    assert_eq!(name(cut.emission_texture.as_ref().unwrap().image), "glow.png");
    assert_eq!(cut.emission, glam::Vec3::ONE);
    // Whether it holds heights shows when it is decoded.
    let bump = &model.images[cut.normal_texture.as_ref().unwrap().image];
    let ImageSource::Bump(bump) = bump else { panic!("{bump:?}") };
    let ImageSource::File(path) = &bump.source else { panic!("{bump:?}") };
    assert!(path.ends_with("bump.png") && bump.wrap == [WrapMode::Repeat; 2], "{bump:?}");
    assert_eq!(name(cut.metallic_roughness_texture.as_ref().unwrap().image), "rough.png");
    assert_eq!((none.name.as_str(), none.base_color), ("none", Vec4::ONE));
    let notes = model.notes.join("\n");
    assert_mentions(
        &notes,
        &[
            "\"shiny\": map_Ks",
            "took the default for 1 material without a definition: none",
            "bump map of material \"cut\"",
        ],
    );
}

#[test]
fn physically_based_properties_are_read_or_noted() {
    let model = |library: &str| {
        let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
        let library = format!("newmtl m\n{library}");
        load_files(&[("a.obj", text.as_bytes()), ("m.mtl", library.as_bytes())]).unwrap()
    };
    // One image for both is glTF's packing, and counts alone.
    let packed = model(
        "Pr 0.5\nPm 0\nPs 0\nPc 0\naniso 0\nmap_Pr -s 2 2 2 orm.png\nmap_Pm -s 2 2 2 orm.png\nmap_Ke -clamp on e.png\n",
    );
    let material = &packed.materials[0];
    assert_eq!((material.roughness, material.metallic, material.emission), (1.0, 1.0, glam::Vec3::ONE));
    assert!(material.metallic_roughness_texture.is_some());
    assert_eq!(material.emission_texture.as_ref().unwrap().wrap, [WrapMode::Clamp; 2]);
    assert_eq!(packed.notes, [""; 0]);
    let noted = model("Ps 1\nPc 0.5\naniso 0.2\n");
    assert_mentions(&noted.notes.join("\n"), &["\"m\": sheen (Ps), clearcoat (Pc), aniso has"]);
}

/// Maps of one image each become channels of one image.
#[test]
fn maps_of_single_numbers_are_packed() {
    use ImageChannel::{Alpha, Blue, Green, Luminance, Opacity, Red};
    let model = |library: &str| {
        let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
        let library = format!("newmtl m\n{library}");
        load_files(&[("a.obj", text.as_bytes()), ("m.mtl", library.as_bytes())]).unwrap()
    };
    let name = |source: &ImageSource| match source {
        ImageSource::File(path) => path.file_name().unwrap().to_string_lossy().into_owned(),
        other => panic!("{other:?}"),
    };
    // File and channel of each channel of a texture.
    let packed =
        |model: &Model, texture: &Option<TextureRef>| match &model.images[texture.as_ref().unwrap().image] {
            ImageSource::Packed(packed) => {
                packed.channels.clone().map(|c| c.map(|c| (name(&c.source), c.channel)))
            }
            other => panic!("{other:?}"),
        };
    let of = |file: &str, channel| Some((file.to_owned(), channel));
    let both = model("Pr 0.5\nPm 0.25\nmap_Pr r.png\nmap_Pm -imfchan r m.png\n");
    let material = &both.materials[0];
    assert_eq!((material.roughness, material.metallic), (1.0, 1.0));
    let surface = packed(&both, &material.metallic_roughness_texture);
    assert_eq!(surface, [None, of("r.png", Green), of("m.png", Red), None]);
    // A number without a map stays.
    let rough = model("Pr 0.5\nPm 0.25\nmap_Pr -imfchan l r.png\n");
    let material = &rough.materials[0];
    assert_eq!((material.roughness, material.metallic), (1.0, 0.25));
    let surface = packed(&rough, &material.metallic_roughness_texture);
    assert_eq!(surface, [None, of("r.png", Luminance), None, None]);
    let metal = model("Pr 0.5\nmap_Pm m.png\n");
    let material = &metal.materials[0];
    assert_eq!((material.roughness, material.metallic), (0.5, 1.0));
    assert_eq!(packed(&metal, &material.metallic_roughness_texture), [None, None, of("m.png", Blue), None]);
    // Opacity of another image, of the colour's own red, and without a colour.
    let leaf = model("map_Kd c.png\nmap_d d.png\n");
    let material = &leaf.materials[0];
    assert_eq!(material.alpha, AlphaMode::Blend);
    let color = packed(&leaf, &material.base_color_texture);
    assert_eq!(color, [of("c.png", Red), of("c.png", Green), of("c.png", Blue), of("d.png", Opacity)]);
    let own = model("map_Kd c.png\nmap_d -imfchan r c.png\n");
    assert_eq!(packed(&own, &own.materials[0].base_color_texture)[3], of("c.png", Red));
    let bare = model("Kd 1 0 0\nmap_d -imfchan m d.png\n");
    assert_eq!(packed(&bare, &bare.materials[0].base_color_texture), [None, None, None, of("d.png", Alpha)]);
    for model in [&both, &rough, &metal, &leaf, &own, &bare] {
        assert_eq!(model.notes, [""; 0]);
    }
    // What would lie elsewhere on the surface is left out, and said.
    let apart = model("map_Kd -s 2 2 c.png\nmap_d d.png\nmap_Pr r.png\nmap_Pm -clamp on m.png\n");
    let listed = ["map_d with other options than map_Kd, map_Pm with other options than map_Pr has"];
    assert_mentions(&apart.notes.join("\n"), &listed);
    assert_eq!(apart.materials[0].alpha, AlphaMode::Opaque);
    let rough = apart.materials[0].metallic_roughness_texture.as_ref().unwrap();
    assert_eq!(name(&apart.images[rough.image]), "r.png");
    let brighter = model("map_Kd -mm 0 1 c.png\nmap_Ke -mm 0.25 0.5 e.png\n");
    assert_eq!(brighter.notes.len(), 1);
    assert_mentions(&brighter.notes[0], &["line ", "-mm 0.25 0.5", "left out"]);
}

#[test]
fn a_missing_library_is_a_note_and_a_broken_one_an_error() {
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let model = load_text("a.obj", text).unwrap();
    assert_mentions(
        &model.notes.join("\n"),
        &["material file a.mtl cannot be read", "took the default for 1 material without a definition: m"],
    );
    let broken = |library: &str| {
        load_files(&[("a.obj", text.as_bytes()), ("a.mtl", library.as_bytes())])
            .expect_err("refused")
            .to_string()
    };
    assert_mentions(&broken("newmtl m\nKd 1 red 1\n"), &["a.mtl: line 2:", "\"red\""]);
    assert_mentions(&broken("Kd 1 1 1\n"), &["a.mtl: line 1:", "before the first newmtl"]);
    assert_mentions(&broken("newmtl m\nd\n"), &["a.mtl: line 2:", "d needs"]);
}

#[test]
fn textures_without_coordinates_are_left_out() {
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let model = load_files(&[("a.obj", text.as_bytes()), ("a.mtl", b"newmtl m\nmap_Kd x.png\n")]).unwrap();
    assert!(model.materials[0].base_color_texture.is_none());
    assert_mentions(&model.notes.join("\n"), &["no texture coordinates"]);
}

#[test]
fn not_a_number_is_left_to_cleaning() {
    let model = load_text("a.obj", "v nan 0 0\nv 1 inf 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert!(model.positions[0].x.is_nan() && model.positions[1].y.is_infinite());
    assert_eq!(model.positions[2], DVec3::Y);
}

// PLY and STL.

const VERTEX: &str = "property float x\nproperty float y\nproperty float z\n";

fn ascii_ply(vertices: &str, rest: &str) -> String {
    format!("ply\nformat ascii 1.0\nelement vertex 4\n{VERTEX}{vertices}{rest}")
}

const FACES: &str = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";

/// A quad as doubles, normals, bytes colours and coordinates in one order of bytes.
fn binary_ply(is_big: bool) -> Vec<u8> {
    let name = if is_big { "big" } else { "little" };
    let mut bytes = format!("ply\r\nformat binary_{name}_endian 1.0\r\nobj_info x\r\nelement vertex 4\r\nproperty double x\r\nproperty double y\r\nproperty double z\r\nproperty short nx\r\nproperty short ny\r\nproperty short nz\r\nproperty list uchar short skipped\r\nproperty uchar red\r\nproperty uchar green\r\nproperty uchar blue\r\nproperty uchar alpha\r\nproperty float s\r\nproperty float t\r\nelement face 1\r\nproperty uint flags\r\nproperty list ushort uint vertex_index\r\nend_header\r\n").into_bytes();
    macro_rules! put {
        ($x:expr) => {
            bytes.extend(if is_big { $x.to_be_bytes().to_vec() } else { $x.to_le_bytes().to_vec() })
        };
    }
    for (x, y) in [(0.0f64, 0.0f64), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        put!((x + 1e7));
        put!(y);
        put!(0.5f64);
        put!(0i16);
        put!(0i16);
        put!(7i16);
        bytes.push(2);
        put!(1i16);
        put!(2i16);
        bytes.extend([255, 188, 0, 51]);
        put!((x as f32));
        put!((y as f32));
    }
    put!(9u32);
    put!(4u16);
    for index in 0..4u32 {
        put!(index);
    }
    bytes
}

#[test]
fn both_byte_orders_give_the_same() {
    let [little, big]: [Model; 2] =
        [false, true].map(|big| load_files(&[("a.ply", &binary_ply(big))]).unwrap());
    assert_eq!(little, big);
    assert_eq!(little.triangles.len(), 2);
    assert_eq!(little.positions[1], DVec3::new(1e7 + 1.0, 0.0, 0.5));
    assert_eq!(little.corners.normals, [Vec3::Z; 6]);
    assert_eq!(little.corners.uv_sets[0][0], Vec2::new(0., 1.));
    let color = little.corners.colors[0];
    assert!((color - Vec4::new(1., 0.5, 0., 0.2)).length() < 5e-3, "{color}");
}

#[test]
fn what_follows_the_last_element_is_told() {
    let text = ascii_ply("", FACES) + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n";
    for (file, told) in [
        ([&binary_ply(false)[..], b"\r\n"].concat(), None),
        ([&binary_ply(true)[..], b"\nabc\n"].concat(), Some("3 bytes")),
        (text.clone().into_bytes(), None),
        ((text + "3 0 2 3\n").into_bytes(), Some("7 bytes")),
    ] {
        let notes = load_files(&[("a.ply", &file)]).unwrap().notes.join("\n");
        match told {
            Some(told) => assert_mentions(&notes, &["after the last element", told]),
            None => assert_eq!(notes, ""),
        }
    }
}

#[test]
fn float_colours_are_fractions_and_coordinate_names_vary() {
    for names in [["u", "v"], ["texture_u", "texture_v"], ["s", "t"]] {
        let [u, v] = names;
        let vertices = format!(
            "property float red\nproperty float green\nproperty float blue\nproperty float {u}\nproperty float {v}\n"
        );
        let rows = "0 0 0 1 0.5 0 0.25 0.75\n1 0 0 1 1 1 0 0\n1 1 0 1 1 1 0 0\n0 1 0 1 1 1 0 0\n3 0 1 2\n";
        let model = load_text("a.ply", &(ascii_ply(&vertices, FACES) + rows)).unwrap();
        assert!((model.corners.colors[0] - Vec4::new(1., 0.214_041, 0., 1.)).length() < 1e-4);
        assert_eq!(model.corners.uv_sets[0][0], Vec2::new(0.25, 0.25), "{u}");
    }
}

#[test]
fn colours_may_be_floats_of_bytes() {
    let vertices = "property float red\nproperty float green\nproperty float blue\n";
    let colors = |rows: [&str; 4]| {
        let places = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
        let rows: String = places.iter().zip(rows).map(|(at, color)| format!("{at} {color}\n")).collect();
        let model = load_text("a.ply", &(ascii_ply(vertices, FACES) + &rows + "3 0 1 2\n")).unwrap();
        (model.corners.colors, model.notes)
    };
    let (bytes, notes) = colors(["255 127.5 0", "0 0 51", "9 9 9", "0 0 0"]);
    let (shares, no_notes) = colors(["1 0.5 0", "0 0 0.2", "0.0352941 0.0352941 0.0352941", "0 0 0"]);
    assert!(bytes.iter().zip(&shares).all(|(a, b)| (a - b).length() < 1e-5), "{bytes:?} {shares:?}");
    assert!(notes.len() == 1 && notes[0].contains("0..255") && no_notes.is_empty(), "{notes:?}");
}

#[test]
fn faces_may_carry_coordinates_colours_and_textures() {
    let faces = "comment TextureFile one.png\ncomment TextureFile the other.png\nelement face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let rows = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 0 0 1 0 1 1 1 255 0 0\n4 0 1 2 3 8 .5 .5 1 0 1 1 0 1 0 0 0 255\n";
    let model = load_text("a.ply", &(ascii_ply("", faces) + rows)).unwrap();
    assert_eq!(model.triangle_materials, [1, 0, 0]);
    assert_eq!(
        model.corners.colors[..4],
        [[1., 0., 0., 1.], [1., 0., 0., 1.], [1., 0., 0., 1.], [0., 0., 1., 1.]].map(Vec4::from)
    );
    assert_eq!(model.corners.uv_sets[0][3], Vec2::new(0.5, 0.5));
    assert!(matches!(&model.images[1], ImageSource::File(path) if path.ends_with("the other.png")));
    assert_consistent(&model);
}

#[test]
fn strips_alternate_and_restart() {
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n9 0 1 2 3 -1 2 0 1 1\n";
    let model = load_text("a.ply", &(ascii_ply("", strips) + rows)).unwrap();
    assert_eq!(model.triangles, [[0, 1, 2], [2, 1, 3], [2, 0, 1]]);
}

#[test]
fn faces_may_come_before_vertices() {
    let text = format!(
        "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 3\n{VERTEX}end_header\n3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n"
    );
    assert_eq!(load_text("a.ply", &text).unwrap().triangles, [[0, 1, 2]]);
}

#[test]
fn wrong_ply_files_are_refused_with_the_place() {
    let refuse = |text: &str| message("a.ply", text.as_bytes());
    let body = |rows: &str| refuse(&(ascii_ply("", FACES) + rows));
    let positions = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    assert_mentions(&body(&format!("{positions}3 0 1 4\n")), &["face 0 refers to vertex 4, but there are 4"]);
    assert_mentions(&body(&format!("{positions}3 0 1 -1\n")), &["face 0 refers to vertex -1"]);
    assert_mentions(&body(&format!("{positions}3 0 1 0.5\n")), &["face 0 refers to vertex 0.5,"]);
    assert_mentions(
        &body(&format!("{positions}3 0 1 4294967296\n")),
        &["face 0 refers to vertex 4294967296"],
    );
    assert_mentions(&body(&format!("{positions}3 0 1")), &["ends in face 0 of 1"]);
    assert_mentions(&body(&format!("{positions}99999 0 1 2\n")), &["face 0 has 99999 corners"]);
    assert_mentions(&body("0 0 0\n1 zero 0\n1 1 0\n0 1 0\n3 0 1 2\n"), &["vertex 1, line 11", "\"zero\""]);
    assert_mentions(&refuse("ply\nformat ascii 1.0\n"), &["no end"]);
    assert_mentions(&refuse("ply\nformat binary 1.0\n"), &["header line 2", "binary_little_endian"]);
    assert_mentions(
        &refuse("ply\nformat ascii 1.0\nproperty float x\n"),
        &["header line 3", "element before"],
    );
    assert_mentions(
        &refuse("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n"),
        &["header line 4", "property TYPE NAME"],
    );
    assert_mentions(&refuse("ply\nelement vertex 1\nend_header\n"), &["header line 3", "format line"]);
    assert_mentions(
        &refuse("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"),
        &["x, y and z"],
    );
    assert_mentions(&refuse("ply\nformat ascii 1.0\nend_header\n"), &["x, y and z"]);
}

/// Elements without properties take no bytes, so their count says nothing about time or memory either.
#[test]
fn empty_rows_cost_nothing() {
    let text = format!(
        "ply\nformat ascii 1.0\nelement nothing 18446744073709551615\nelement vertex 3\n{VERTEX}{FACES}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    );
    assert_eq!(load_text("a.ply", &text).unwrap().triangles.len(), 1);
}

#[test]
fn ascii_stl_takes_several_solids_and_odd_normals() {
    let facet = |x: u32| {
        format!(
            "FACET NORMAL nan -nan(ind) 0\nOUTER LOOP\nVERTEX {x} 0 0\nVERTEX 1 0 0\nVERTEX 0 1e0 0\nENDLOOP\nENDFACET\n"
        )
    };
    let text = format!(
        "\n  Solid first one\n{}endsolid first one\nsolid\n{}{}endsolid\n",
        facet(0),
        facet(2),
        facet(3)
    );
    let model = load_text("a.stl", &text).unwrap();
    assert_eq!((model.triangles.len(), model.positions.len()), (3, 9));
    assert_eq!(model.positions[3], DVec3::new(2., 0., 0.));
    assert!(model.corners.normals.is_empty());
    // Lines of old systems.
    let old = load_text("a.stl", &text.replace('\n', "\r")).unwrap();
    assert_eq!(old.positions, model.positions);
    let marked = load_text("a.stl", &format!("\u{feff}{text}")).unwrap();
    assert_eq!(marked.positions, model.positions);
}

#[test]
fn wrong_stl_files_are_refused_with_the_place() {
    let refuse = |text: &str| message("a.stl", text.as_bytes());
    let facet = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n";
    assert_mentions(&refuse(&format!("{facet}endloop\n")), &["line 6", "expected vertex", "\"endloop\""]);
    assert_mentions(&refuse(&format!("{facet}vertex 0 one 0\n")), &["line 6", "coordinate", "\"one\""]);
    assert_mentions(
        &refuse(&format!("{facet}vertex 0 1 0\nvertex 0 1 0\n")),
        &["line 7", "after three vertices"],
    );
    assert_mentions(&refuse(facet), &["line 6", "the end of the file"]);
    assert_mentions(&refuse("nothing of the kind"), &["neither ASCII STL", "19 bytes"]);
    let mut binary = vec![0; 84 + 50];
    binary[80] = 2;
    assert_mentions(&message("a.stl", &binary), &["announces 2 facets", "184 bytes", "has 134"]);
    binary[80] = 1;
    binary.extend([1, 2, 3]);
    let model = load_files(&[("a.stl", &binary)]).unwrap();
    assert!(model.notes[0].contains("3 bytes after"), "{:?}", model.notes);
}

// What is written reads back, and nothing half-written is left.

struct Sample {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    colors: Vec<Vec4>,
}

fn sample(offset: DVec3) -> Sample {
    let grid = 20u32;
    let position = |i: u32| {
        DVec3::new(f64::from(i % grid) * 1e-3, f64::from(i / grid) * 1e-3, f64::from(i * i % 7) * 1e-4)
    };
    let cell = |i: u32| [[i, i + 1, i + grid], [i + 1, i + grid + 1, i + grid]];
    Sample {
        positions: (0..grid * grid).map(|i| offset + position(i)).collect(),
        triangles: (0..grid * (grid - 1)).filter(|i| i % grid != grid - 1).flat_map(cell).collect(),
        colors: (0..grid * grid).map(|i| Vec4::new(i as f32 / 400.0, 0.25, (i % 2) as f32, 1.0)).collect(),
    }
}

fn write(path: &Path, sample: &Sample, with_colors: bool, force: bool) -> Result<(), fantex_base::Error> {
    let colors = with_colors.then_some(&sample.colors[..]);
    write_model(
        path,
        &WriteGeometry { positions: &sample.positions, triangles: &sample.triangles, colors },
        force,
    )
}

fn assert_same(model: &Model, sample: &Sample, with_colors: bool, tolerance: f64) {
    assert_eq!(model.triangles, sample.triangles);
    for (found, expected) in model.positions.iter().zip(&sample.positions) {
        assert!((*found - *expected).length() <= tolerance, "{found} for {expected}");
    }
    assert_eq!(model.corners.colors.is_empty(), !with_colors);
    for (corner, color) in model.corners.colors.iter().enumerate() {
        let expected = sample.colors[sample.triangles[corner / 3][corner % 3] as usize];
        // PLY keeps 8 bits of sRGB: half a step is at most 0.5/255 times the steepest slope of the curve's inverse, 2.3.
        assert!((*color - expected).abs().max_element() < 0.5 / 255.0 * 2.3 + 1e-5, "{color} for {expected}");
    }
}

#[test]
fn all_formats_read_back() {
    let folder = tempfile::tempdir().unwrap();
    for offset in [DVec3::ZERO, DVec3::new(1e7, -3e6, 0.1)] {
        let sample = sample(offset);
        // GLB stores single precision relative to the centre; the sum with the far offset rounds once more.
        for (name, tolerance) in [("a.ply", 0.0), ("a.obj", 0.0), ("a.glb", 1e-8)] {
            for with_colors in [false, true] {
                let path = folder.path().join(name);
                write(&path, &sample, with_colors, true).unwrap();
                let model = load(&path, &LoadOptions::default()).unwrap();
                assert_same(&model, &sample, with_colors, tolerance);
            }
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "temporary files are left");
}

#[test]
fn written_glb_is_valid_for_a_strict_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    write(&path, &sample(DVec3::splat(1e6)), true, false).unwrap();
    let read = gltf::Gltf::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let blob = read.blob.clone().unwrap();
    let primitive = read.meshes().next().unwrap().primitives().next().unwrap();
    let reader = primitive.reader(|_| Some(&blob));
    assert_eq!(reader.read_positions().unwrap().count(), 400);
    assert_eq!(reader.read_colors(0).unwrap().into_rgba_f32().count(), 400);
    assert_eq!(reader.read_indices().unwrap().into_u32().max(), Some(399));
    let bounds = primitive.bounding_box();
    let positions = || reader.read_positions().unwrap();
    for axis in 0..3 {
        assert_eq!(positions().map(|p| p[axis]).fold(f32::MAX, f32::min), bounds.min[axis]);
        assert_eq!(positions().map(|p| p[axis]).fold(f32::MIN, f32::max), bounds.max[axis]);
    }
}

#[test]
fn existing_files_are_kept_without_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, "precious").unwrap();
    let sample = sample(DVec3::ZERO);
    let error = write(&path, &sample, false, false).unwrap_err().to_string();
    assert_mentions(&error, &["a.ply exists already", "--force"]);
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    write(&path, &sample, false, true).unwrap();
    assert!(std::fs::read(&path).unwrap().starts_with(b"ply"));
}

#[test]
fn wrong_geometry_and_places_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let refuse =
        |name: &str, sample: &Sample| write(&path(name), sample, true, false).unwrap_err().to_string();
    let good = sample(DVec3::ZERO);
    assert_mentions(&refuse("a.stl", &good), &["a.stl", "use .ply, .obj or .glb"]);
    assert_mentions(&refuse("missing/a.ply", &good), &["cannot write", "missing/a.ply"]);
    let mut bad = sample(DVec3::ZERO);
    bad.triangles[5][1] = 400;
    assert_mentions(&refuse("a.ply", &bad), &["triangle 5", "position 400", "there are 400"]);
    let mut bad = sample(DVec3::ZERO);
    bad.positions[7].y = f64::NAN;
    assert_mentions(&refuse("a.glb", &bad), &["position 7 is not finite"]);
    let mut bad = sample(DVec3::ZERO);
    bad.triangles.clear();
    assert_mentions(&refuse("a.glb", &bad), &["a.glb", "no triangles"]);
    let mut bad = sample(DVec3::ZERO);
    bad.colors.pop();
    assert_mentions(&refuse("a.obj", &bad), &["399 colours for 400 positions"]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Beyond single precision, and so large that differences overflow double precision.
#[test]
fn what_single_precision_does_not_hold_is_no_glb() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for extent in [1e40, 2.0 * f64::MAX.sqrt(), f64::MAX] {
        let mut huge = sample(DVec3::ZERO);
        (huge.positions[3].x, huge.positions[5].x) = (-extent, extent);
        let error = write(&path("a.glb"), &huge, false, true).unwrap_err().to_string();
        assert_mentions(&error, &["a.glb", "position", "single precision", "use .ply"]);
        assert!(!path("a.glb").exists());
        for name in ["a.ply", "a.obj"] {
            write(&path(name), &huge, false, true).unwrap();
            let model = load(&path(name), &LoadOptions::default()).unwrap();
            assert_same(&model, &huge, false, 0.0);
        }
    }
    // The largest that fits, and what only fits relative to the middle.
    for offset in [0.0, 1e39] {
        let mut large = sample(DVec3::new(offset, 0.0, 0.0));
        large.positions[3].x += 1e38;
        write(&path("a.glb"), &large, false, true).unwrap();
        let model = load(&path("a.glb"), &LoadOptions::default()).unwrap();
        assert_same(&model, &large, false, 1e32);
    }
}

#[cfg(unix)]
#[test]
fn written_files_have_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (ours, plain) = (folder.path().join("a.ply"), folder.path().join("b"));
    write(&ours, &sample(DVec3::ZERO), false, false).unwrap();
    std::fs::write(&plain, "").unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&ours), mode(&plain));
}

/// Where a material library in a folder says that its image is.
fn image_of(folder: &Path, written: &str) -> Option<PathBuf> {
    std::fs::write(folder.join("a.mtl"), format!("newmtl m\nmap_Kd {written}\n")).unwrap();
    let obj = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
    std::fs::write(folder.join("a.obj"), obj).unwrap();
    let model = load(&folder.join("a.obj"), &LoadOptions::default()).unwrap();
    model.images.into_iter().next().map(|image| match image {
        ImageSource::File(path) => path,
        other => panic!("{other:?}"),
    })
}

#[test]
fn names_are_found_whatever_their_case() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("textures")).unwrap();
    for name in ["textures/oak.png", "textures/\u{e4}.png"] {
        std::fs::write(at(name), b"x").unwrap();
    }
    // Compared as files, because systems that do not tell cases apart find the name as it was written.
    let is_at = |name: &str, expected: &str| {
        let found = image_of(folder.path(), name).unwrap().canonicalize().unwrap();
        assert_eq!(found, at(expected).canonicalize().unwrap(), "{name}");
    };
    is_at("textures/oak.png", "textures/oak.png");
    is_at("Textures/Oak.PNG", "textures/oak.png");
    is_at("./Textures/\u{c4}.PNG", "textures/\u{e4}.png");
    is_at("textures/../Textures/oak.png", "textures/oak.png");
    // What is not there keeps its name for the message.
    assert_eq!(image_of(folder.path(), "Textures/ash.png"), Some(at("Textures/ash.png")));
}

#[cfg(unix)]
#[test]
fn links_find_files_beside_them_or_where_they_lead() {
    let [there, here] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    std::fs::write(there.path().join("oak.png"), b"x").unwrap();
    image_of(there.path(), "oak.png");
    let link = here.path().join("link.obj");
    std::os::unix::fs::symlink(there.path().join("a.obj"), &link).unwrap();
    let images = || load(&link, &LoadOptions::default()).unwrap().images;
    let image_in = |folder: &Path| match &images()[..] {
        [ImageSource::File(path)] => {
            path.canonicalize().unwrap() == folder.canonicalize().unwrap().join("oak.png")
        }
        other => panic!("{other:?}"),
    };
    assert!(image_in(there.path()));
    for name in ["a.mtl", "oak.png"] {
        std::fs::copy(there.path().join(name), here.path().join(name)).unwrap();
    }
    assert!(image_in(here.path()));
}

#[test]
fn paths_into_another_computer_become_names() {
    let folder = tempfile::tempdir().unwrap();
    for (written, expected) in [
        ("C:\\work\\a b.png", "a b.png"),
        ("/home/someone/a.png", "a.png"),
        ("tex\\a.png", "tex/a.png"),
        ("\"a.png\"", "a.png"),
    ] {
        assert_eq!(image_of(folder.path(), written), Some(folder.path().join(expected)));
    }
    assert_eq!(image_of(folder.path(), " "), None);
}

/// Objects, or groups where there are none; a name that comes again is the same part; squares are two triangles.
#[test]
fn objects_and_groups_are_parts() {
    let corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let parts = |faces: &str| {
        let model = load_text("a.obj", &format!("{corners}{faces}")).unwrap();
        let names: Vec<String> = model.parts.names.iter().map(|name| name.replace('\u{fffd}', "?")).collect();
        (names.join("|"), model.parts.of_triangle)
    };
    let objects =
        "f 1 2 3\no none\no two words \ng inner\nf 1 2 3 4\no last\nf 1 3 4\no two words\nf 2 3 4\n";
    assert_eq!(parts(objects), ("|two words|last".into(), vec![0, 1, 1, 2, 1]));
    assert_eq!(parts("g a b\nf 1 2 3\ng c\nf 1 3 4\n"), ("a b|c".into(), vec![0, 1]));
    assert_eq!(parts("o only\nf 1 2 3 4\n"), ("only".into(), vec![]));
    assert_eq!(parts("f 1 2 3 4\n"), (String::new(), vec![]));
}
