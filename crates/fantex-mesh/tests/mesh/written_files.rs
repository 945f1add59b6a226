//! What is written reads back, and nothing half-written is left.

use crate::common;
use std::path::Path;

use fantex_mesh::{LoadOptions, Model, WriteGeometry, load, write_model};
use glam::{DVec3, Vec4};

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

fn write(
    path: &Path,
    sample: &Sample,
    with_colors: bool,
    force: bool,
) -> Result<(), fantex_mesh::WriteError> {
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
    common::assert_mentions(&error, &["a.ply exists already", "--force"]);
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
    common::assert_mentions(&refuse("a.stl", &good), &["a.stl", "use .ply, .obj or .glb"]);
    common::assert_mentions(&refuse("missing/a.ply", &good), &["cannot write", "missing/a.ply"]);
    let mut bad = sample(DVec3::ZERO);
    bad.triangles[5][1] = 400;
    common::assert_mentions(&refuse("a.ply", &bad), &["triangle 5", "position 400", "there are 400"]);
    let mut bad = sample(DVec3::ZERO);
    bad.positions[7].y = f64::NAN;
    common::assert_mentions(&refuse("a.glb", &bad), &["position 7 is not finite"]);
    let mut bad = sample(DVec3::ZERO);
    bad.triangles.clear();
    common::assert_mentions(&refuse("a.glb", &bad), &["a.glb", "no triangles"]);
    let mut bad = sample(DVec3::ZERO);
    bad.colors.pop();
    common::assert_mentions(&refuse("a.obj", &bad), &["399 colours for 400 positions"]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
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
