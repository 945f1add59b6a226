//! Points of the surface that the survey asks every photograph about: all vertices, and points spread evenly over the area.

use fantex_mesh::{Mesh, corner_normals};
use glam::Vec3;

use crate::view::Spot;

/// Points that are spread over the area.
const SPREAD: usize = 1 << 15;

/// The points: vertices first, then the spread points.
#[derive(Debug)]
pub(crate) struct Probes {
    pub(crate) spots: Vec<Spot>,
    /// The triangle of every spread point.
    pub(crate) triangles: Vec<u32>,
}

impl Probes {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let normals = vertex_normals(mesh);
        let vertices = mesh.positions.iter().zip(&normals);
        let mut spots: Vec<Spot> =
            vertices.map(|(&position, &normal)| Spot { position, normal, face: None }).collect();
        let mut triangles = Vec::with_capacity(SPREAD);
        for (triangle, lambda) in spread_points(mesh, SPREAD) {
            let blend = |v: [Vec3; 3]| v[0] * lambda.x + v[1] * lambda.y + v[2] * lambda.z;
            let corners = mesh.triangles[triangle].map(|v| normals[v as usize]);
            spots.push(Spot {
                position: blend(mesh.triangle_positions(triangle)),
                normal: blend(corners).normalize_or_zero(),
                face: Some(face_normal(mesh, triangle)),
            });
            triangles.push(triangle as u32);
        }
        Self { spots, triangles }
    }

    /// How many of them are vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.spots.len() - self.triangles.len()
    }
}

/// The unit normal of a triangle.
pub(crate) fn face_normal(mesh: &Mesh, triangle: usize) -> Vec3 {
    let [a, b, c] = mesh.triangle_positions(triangle);
    (b - a).cross(c - a).normalize_or_zero()
}

/// One unit normal per vertex.
fn vertex_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; mesh.positions.len()];
    let corners = corner_normals(mesh, 180.0);
    for (triangle, corners) in mesh.triangles.iter().zip(corners.chunks(3)) {
        triangle.iter().zip(corners).for_each(|(&v, &normal)| sums[v as usize] += normal);
    }
    sums.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// Points that are spread evenly over the area: one in each of `count` equal parts of the surface, in the order of the triangles.
/// Where in a triangle they lie follows M. Roberts' sequence ("The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
fn spread_points(mesh: &Mesh, count: usize) -> impl Iterator<Item = (usize, Vec3)> {
    let mut sum = 0.0;
    let areas: Vec<f64> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
            sum += (b - a).cross(c - a).length();
            sum
        })
        .collect();
    let mut triangle = 0;
    let points = if areas.is_empty() { 0 } else { count };
    (0..points).map(move |i| {
        let at = sum * (i as f64 + 0.5) / count as f64;
        while areas[triangle] < at && triangle + 1 < areas.len() {
            triangle += 1;
        }
        let [u, v] =
            [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (i as f64 * step).fract() as f32);
        // The unit square folded onto a triangle.
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        (triangle, Vec3::new(1.0 - u - v, u, v))
    })
}

#[cfg(test)]
mod tests {
    use fantex_mesh::{CleanOptions, clean, generate};

    use super::*;

    #[test]
    fn points_are_spread_by_area_and_lie_on_their_triangles() {
        let (mesh, _) = clean(generate::icosphere(2), &CleanOptions::default()).unwrap();
        let probes = Probes::new(&mesh);
        assert_eq!(probes.vertices(), mesh.positions.len());
        assert_eq!(probes.triangles.len(), SPREAD);
        let total = mesh.area();
        let mut counts = vec![0_u32; mesh.triangles.len()];
        for (&t, spot) in probes.triangles.iter().zip(&probes.spots[probes.vertices()..]) {
            counts[t as usize] += 1;
            let [a, b, c] = mesh.triangle_positions(t as usize);
            assert!((b - a).cross(c - a).normalize().dot(spot.position - a).abs() < 1e-5);
        }
        for (t, &count) in counts.iter().enumerate() {
            let [a, b, c] = mesh.triangle_positions(t).map(|p| p.as_dvec3());
            let expected = 0.5 * (b - a).cross(c - a).length() / total * SPREAD as f64;
            assert!((f64::from(count) - expected).abs() <= 1.01, "{t}: {count} of {expected}");
        }
        // Normals of a sphere are its directions.
        for spot in &probes.spots {
            assert!(spot.position.normalize().dot(spot.normal) > 0.99);
        }
    }
}
