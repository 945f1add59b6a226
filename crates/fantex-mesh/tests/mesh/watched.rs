//! How far reading and cleaning are.

use std::cell::RefCell;
use std::fmt::Write as _;

use fantex_mesh::{CleanOptions, LoadOptions, clean_watched, load, load_watched};

/// One triangle between many positions.
const POSITIONS: usize = 150_000;

fn obj() -> String {
    let mut text = String::new();
    (0..POSITIONS).for_each(|i| writeln!(text, "v {i} {} 0", i % 2).unwrap());
    text + "f 1 2 3\n"
}

fn ply() -> String {
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex {POSITIONS}\nproperty float x\nproperty float y\nproperty float z\n"
    );
    let mut text = head + "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    (0..POSITIONS).for_each(|i| writeln!(text, "{i} {} 0", i % 2).unwrap());
    text + "3 0 1 2\n"
}

/// Binary.
fn stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((POSITIONS as u32).to_le_bytes());
    (0..POSITIONS).for_each(|i| {
        let corners = [[i as f32, 0.0, 0.0], [i as f32 + 1.0, 0.0, 0.0], [i as f32, 1.0, 0.0]];
        bytes.extend([0; 12]);
        bytes.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([0; 2]);
    });
    bytes
}

#[test]
fn bytes_are_told_as_they_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("a.obj", obj().into_bytes()), ("a.ply", ply().into_bytes()), ("a.stl", stl())] {
        let path = folder.path().join(name);
        std::fs::write(&path, &content).unwrap();
        let told = RefCell::new(Vec::new());
        let watch = |done, total| {
            assert_eq!(total, content.len() as u64, "{name}");
            told.borrow_mut().push(done);
        };
        let model = load_watched(&path, &LoadOptions::default(), &watch).unwrap();
        assert_eq!(model, load(&path, &LoadOptions::default()).unwrap(), "{name}");
        let told = told.into_inner();
        assert!(told.is_sorted() && told.len() >= 4, "{name}: {told:?}");
        assert_eq!([told[0], told[told.len() - 1]], [0, content.len() as u64], "{name}");
        let between = told.iter().filter(|&&done| done > 1000 && done + 1000 < content.len() as u64).count();
        assert!(between >= 2, "{name}: {told:?}");
        let shares = RefCell::new(Vec::new());
        clean_watched(model, &CleanOptions::default(), &|share| shares.borrow_mut().push(share)).unwrap();
        let shares = shares.into_inner();
        assert!(shares.is_sorted() && shares.len() > 3, "{shares:?}");
        assert_eq!([shares[0], shares[shares.len() - 1]], [0.0, 1.0]);
    }
}
