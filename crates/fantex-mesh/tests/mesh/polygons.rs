//! Polygons are cut into triangles that have their area.

use glam::DVec3;

use crate::common::*;

/// The triangles that a PLY file's only face becomes.
fn cut(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let count = corners.len();
    let rows: String = corners.iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
    let face: String = (0..count).map(|i| format!(" {i}")).collect();
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty double x\nproperty double y\nproperty double z\n\
         element face 1\nproperty list int int vertex_indices\nend_header\n{rows}{count}{face}\n"
    );
    let model = load_text("a.ply", &text).unwrap();
    model.triangles.iter().map(|t| t.map(|v| v as usize)).collect()
}

fn area_normal(corners: &[DVec3], t: [usize; 3]) -> DVec3 {
    let [a, b, c] = t.map(|i| corners[i]);
    (b - a).cross(c - a) * 0.5
}

/// Every triangle has the outline's orientation, and together they have its area: so nothing overlaps.
fn assert_exact(corners: &[DVec3]) {
    let triangles = cut(corners);
    assert_eq!(triangles.len(), corners.len() - 2);
    let total: DVec3 = (1..corners.len() - 1).map(|i| area_normal(corners, [0, i, i + 1])).sum();
    let normal = total.normalize();
    let mut area = 0.0;
    for &t in &triangles {
        let a = area_normal(corners, t).dot(normal);
        assert!(a >= -1e-12 * total.length(), "triangle {t:?} is turned over");
        area += a.abs();
    }
    assert!((area - total.length()).abs() < 1e-9 * total.length(), "{area} of {}", total.length());
}

fn star(points: usize, offset: DVec3) -> Vec<DVec3> {
    (0..2 * points)
        .map(|i| {
            let angle = std::f64::consts::PI * i as f64 / points as f64;
            let radius = if i % 2 == 0 { 1.0 } else { 0.3 };
            offset + radius * DVec3::new(angle.cos(), 0.4 * angle.sin(), angle.sin())
        })
        .collect()
}

#[test]
fn concave_outlines_are_cut_exactly() {
    let arrow = [[0., 0., 0.], [2., 1., 0.], [0., 2., 0.], [0.5, 1., 0.]].map(DVec3::from);
    for turned in 0..4 {
        let mut corners = arrow;
        corners.rotate_left(turned);
        assert_exact(&corners);
        corners.reverse();
        assert_exact(&corners);
    }
    assert_exact(&star(5, DVec3::ZERO));
    assert_exact(&star(40, DVec3::splat(1e7)));
}

#[test]
fn corners_on_straight_edges_are_kept() {
    let square = [[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [2., 2., 0.], [1., 2., 0.], [0., 2., 0.]];
    let corners = square.map(DVec3::from);
    assert_exact(&corners);
    let used: Vec<usize> = cut(&corners).into_iter().flatten().collect();
    assert!((0..6).all(|i| used.contains(&i)));
}

#[test]
fn hopeless_outlines_still_give_the_right_count() {
    assert_eq!(cut(&[DVec3::ZERO; 7]).len(), 5);
    assert_eq!(cut(&[DVec3::NAN; 6]).len(), 4);
    let bow = [[0., 0., 0.], [1., 1., 0.], [1., 0., 0.], [0., 1., 0.]].map(DVec3::from);
    assert_eq!(cut(&bow).len(), 2);
    let pentagram = std::array::from_fn::<_, 5, _>(|i| {
        let angle = 4.0 * std::f64::consts::PI * i as f64 / 5.0;
        DVec3::new(angle.cos(), angle.sin(), 0.0)
    });
    assert_eq!(cut(&pentagram).len(), 3);
}
