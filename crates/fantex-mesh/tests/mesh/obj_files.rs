//! OBJ and MTL.

use crate::common::*;
use fantex_mesh::{AlphaMode, ImageSource, WrapMode};
use glam::{DVec3, Vec2, Vec4};

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
    assert_mentions(&refuse("v 0 0 0\nv 1 x 0\n"), &["a.obj, line 2:", "number", "\"x\""]);
    assert_mentions(&refuse("v 0 0\n"), &["line 1:", "v needs at least 3 numbers", "has 2"]);
    assert_mentions(&refuse("v 0 0 0\n\nf 1 1 0\n"), &["line 3:", "position 0", "there are 1"]);
    assert_mentions(&refuse("v 0 0 0\nf 1 1 2\nf 1 1 1\n"), &["line 2:", "position 2", "there are 1"]);
    assert_mentions(&refuse("v 0 0 0\nf 1 1 -2\n"), &["line 2:", "position -2"]);
    assert_mentions(&refuse("v 0 0 0\nf 1/1 1/1 1/1\n"), &["line 2:", "texture coordinate 1", "there are 0"]);
    assert_mentions(&refuse("v 0 0 0\nf 1//3 1 1\n"), &["line 2:", "normal 3"]);
    assert_mentions(&refuse("v 0 0 0\nf 1/1/1/1 1 1\n"), &["line 2:", "face corner", "1/1/1/1"]);
    assert_mentions(&refuse("v 0 0 0\nf 4294967296 1 1\n"), &["line 2:", "position 4294967296"]);
    assert_mentions(&refuse("v 0 0 0\nf 99999999999999999999 1 1\n"), &["line 2:", "face corner"]);
    assert_mentions(&refuse("v 0 0 \\\n 0\nv 1 0 0\nf 1 2 a\n"), &["line 4:", "\"a\""]);
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
    assert_eq!(name(cut.normal_texture.as_ref().unwrap().image), "bump.png");
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
    assert_mentions(&broken("newmtl m\nKd 1 red 1\n"), &["a.mtl, line 2:", "\"red\""]);
    assert_mentions(&broken("Kd 1 1 1\n"), &["a.mtl, line 1:", "before the first newmtl"]);
    assert_mentions(&broken("newmtl m\nd\n"), &["a.mtl, line 2:", "d needs"]);
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
