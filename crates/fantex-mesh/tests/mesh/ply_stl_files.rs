//! PLY and STL.

use crate::common::*;
use fantex_mesh::{ImageSource, Model};
use glam::{DVec3, Vec2, Vec3, Vec4};

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
    assert_mentions(&body(&format!("{positions}3 0 1 0.5\n")), &["face 0 refers to vertex"]);
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
