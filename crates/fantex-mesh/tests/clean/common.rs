//! What every cleaned mesh must satisfy, and short ways to build models.

use std::collections::HashSet;

use fantex_mesh::{CleanError, CleanOptions, CleanReport, Mesh, Model, clean};
use glam::DVec3;

/// A model without attributes.
pub(crate) fn soup(
    positions: impl IntoIterator<Item = [f64; 3]>,
    triangles: impl Into<Vec<[u32; 3]>>,
) -> Model {
    Model {
        name: "test".to_owned(),
        positions: positions.into_iter().map(DVec3::from).collect(),
        triangles: triangles.into(),
        ..Model::default()
    }
}

/// Cleans with the default options and checks what [`Mesh`] promises.
pub(crate) fn cleaned(model: Model) -> (Mesh, CleanReport) {
    let (mesh, report) = try_clean(model).unwrap_or_else(|error| panic!("{error}"));
    check(&mesh, &report);
    (mesh, report)
}

/// Cleans with the default options.
pub(crate) fn try_clean(model: Model) -> Result<(Mesh, CleanReport), CleanError> {
    clean(model, &CleanOptions::default())
}

/// Panics unless the mesh keeps the promises of [`Mesh`] and the report adds up.
pub(crate) fn check(mesh: &Mesh, report: &CleanReport) {
    assert!(mesh.positions.iter().all(|p| p.is_finite() && p.abs().max_element() <= 1.0));
    let places: HashSet<_> = mesh.positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect();
    assert_eq!(places.len(), mesh.positions.len(), "two vertices at the same position");
    assert!(mesh.positions.iter().flat_map(|p| p.to_array()).all(|x| x != 0.0 || x.is_sign_positive()));
    let used: HashSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    assert_eq!(used.len(), mesh.positions.len(), "unused vertices");
    assert!(used.iter().all(|&v| (v as usize) < mesh.positions.len()));
    let mut cycles = HashSet::new();
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
        assert!((b - a).cross(c - a).length_squared() > 0.0, "triangle {t} has no area");
        let mut turned = *triangle;
        while turned[0] > turned[1] || turned[0] > turned[2] {
            turned.rotate_left(1);
        }
        assert!(cycles.insert(turned), "triangle {t} is a duplicate");
    }
    assert!(!mesh.materials.is_empty() && !mesh.triangles.is_empty());
    let sets = mesh.corners.uv_sets.iter().map(Vec::len);
    let lengths = sets.chain([mesh.corners.normals.len(), mesh.corners.colors.len()]);
    assert!(lengths.into_iter().all(|n| n == 0 || n == 3 * mesh.triangles.len()));
    let dropped = report.triangles_non_finite + report.triangles_degenerate + report.triangles_duplicate;
    assert_eq!(report.triangles_in - dropped, mesh.triangles.len() as u64);
    let gone = report.vertices_welded + report.vertices_isolated;
    assert_eq!(report.vertices_in - gone, mesh.positions.len() as u64);
    assert_eq!(report.topology.vertices, mesh.positions.len() as u64);
    assert_eq!(report.topology.triangles, mesh.triangles.len() as u64);
}
