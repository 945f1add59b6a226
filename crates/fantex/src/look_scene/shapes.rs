//! Simple shapes with texture coordinates.

use std::f64::consts::{PI, TAU};

use fantex_look::data::{ShapeName, ShapeTable};
use fantex_mesh::{CornerAttributes, Material, Model};
use glam::{DVec2, DVec3, Vec3};

/// A point of a shape and its outward normal, by texture coordinates.
type Patch<'a> = &'a dyn Fn(DVec2) -> (DVec3, DVec3);

/// The shape as a model: texture coordinates with their origin at the top left, smooth normals.
pub(super) fn model_of(table: &ShapeTable) -> Model {
    let mut shape = Builder::default();
    let size = DVec3::from_array(table.size.map(|length| length.0));
    let (radius, half) = (table.radius, 0.5 * table.height);
    let round = table.segments.unwrap_or(64).max(3);
    let flat = table.segments.unwrap_or(1);
    match table.kind {
        ShapeName::Plane => shape.patch([flat; 2], &|uv| {
            (DVec3::new((uv.x - 0.5) * size.x, 0.0, (uv.y - 0.5) * size.z), DVec3::Y)
        }),
        ShapeName::Box => {
            for (right, down) in BOX_FACES {
                let out = down.cross(right);
                shape.patch([flat; 2], &|uv| {
                    let on_cube = out + right * (2.0 * uv.x - 1.0) + down * (2.0 * uv.y - 1.0);
                    (on_cube * 0.5 * size, out)
                });
            }
        }
        ShapeName::Sphere => shape.patch([round, (round / 2).max(2)], &|uv| {
            let (out, up) = sin_cos(PI * uv.y);
            let normal = (around(uv.x) * out).with_y(up);
            (normal * radius, normal)
        }),
        ShapeName::Cylinder => {
            shape.patch([round, flat], &|uv| {
                let normal = around(uv.x);
                (normal * radius + DVec3::Y * (half - table.height * uv.y), normal)
            });
            for side in [1.0, -1.0] {
                shape.patch([round, 1], &|uv| {
                    let rim = around(if side > 0.0 { uv.x } else { 1.0 - uv.x });
                    (rim * (radius * uv.y) + DVec3::Y * (side * half), DVec3::Y * side)
                });
            }
        }
        ShapeName::Torus => shape.patch([round, (round / 2).max(3)], &|uv| {
            let (out, (sin, cos)) = (around(uv.x), sin_cos(TAU * uv.y));
            let normal = out * cos - DVec3::Y * sin;
            (out * radius + normal * table.tube, normal)
        }),
    }
    shape.into_model()
}

/// Right and down of each face's image, seen from outside.
const BOX_FACES: [(DVec3, DVec3); 6] = [
    (DVec3::NEG_Z, DVec3::NEG_Y),
    (DVec3::Z, DVec3::NEG_Y),
    (DVec3::X, DVec3::Z),
    (DVec3::X, DVec3::NEG_Z),
    (DVec3::X, DVec3::NEG_Y),
    (DVec3::NEG_X, DVec3::NEG_Y),
];

/// The unit vector to the point of the equator with this `u`: the seam is at the back (-z), `u` grows to the right.
fn around(u: f64) -> DVec3 {
    let (sin, cos) = sin_cos(TAU * (u - 0.5));
    DVec3::new(sin, 0.0, cos)
}

/// Sine and cosine that are exactly 0 where only rounding keeps them from it, so that both sides of a seam and all points of a
/// pole are at one place.
fn sin_cos(angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    let exact = |x: f64| if x.abs() < 1e-15 { 0.0 } else { x };
    (exact(sin), exact(cos))
}

#[derive(Default)]
struct Builder {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    corners: CornerAttributes,
}

impl Builder {
    /// A grid of quadrilaterals; `u` grows to the right and `v` downwards, seen from outside. Quadrilaterals that have
    /// shrunk to a point on one side become triangles when the model is cleaned.
    fn patch(&mut self, [columns, rows]: [u32; 2], patch: Patch<'_>) {
        if self.corners.uv_sets.is_empty() {
            self.corners.uv_sets.push(Vec::new());
        }
        let first = self.positions.len() as u32;
        let stride = columns + 1;
        let coordinates = |index: u32| {
            let (column, row) = (index % stride, index / stride);
            DVec2::new(f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows))
        };
        for index in 0..stride * (rows + 1) {
            self.positions.push(patch(coordinates(index)).0);
        }
        for row in 0..rows {
            for column in 0..columns {
                let a = row * stride + column;
                for triangle in [[a, a + stride, a + 1], [a + 1, a + stride, a + stride + 1]] {
                    self.triangles.push(triangle.map(|index| first + index));
                    for index in triangle {
                        let uv = coordinates(index);
                        let normal: Vec3 = patch(uv).1.as_vec3();
                        self.corners.uv_sets[0].push(uv.as_vec2());
                        self.corners.normals.push(normal);
                    }
                }
            }
        }
    }

    fn into_model(self) -> Model {
        Model {
            name: "shape".into(),
            positions: self.positions,
            triangles: self.triangles,
            corners: self.corners,
            materials: vec![Material::default()],
            ..Model::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use fantex_look::data::PositiveLength;
    use fantex_mesh::{CleanOptions, clean};

    use super::*;

    #[test]
    fn shapes_are_closed_and_face_outwards() {
        for kind in [ShapeName::Box, ShapeName::Sphere, ShapeName::Cylinder, ShapeName::Torus] {
            let size = [PositiveLength(1.0), PositiveLength(2.0), PositiveLength(3.0)];
            let table = ShapeTable { kind, size, ..ShapeTable::default() };
            let (mesh, report) = clean(model_of(&table), &CleanOptions::default()).unwrap();
            assert_eq!(report.topology.edges_boundary, 0, "{kind:?}");
            let volume: f32 = (0..mesh.triangles.len())
                .map(|t| {
                    let [a, b, c] = mesh.triangle_positions(t);
                    a.dot(b.cross(c)) / 6.0
                })
                .sum();
            assert!(volume > 0.0, "{kind:?} is inside out");
        }
    }

    #[test]
    fn planes_face_upwards() {
        let table = ShapeTable { kind: ShapeName::Plane, segments: Some(4), ..ShapeTable::default() };
        let model = model_of(&table);
        assert_eq!(model.triangles.len(), 32);
        let [a, b, c] = model.triangles[0].map(|i| model.positions[i as usize]);
        assert!((b - a).cross(c - a).y > 0.0);
    }
}
