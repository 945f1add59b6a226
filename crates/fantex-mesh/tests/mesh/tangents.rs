//! Tangents against the reference implementation of MikkTSpace.

use crate::common::data_folder;
use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use fantex_mesh::{CleanOptions, LoadOptions, Mesh, clean, corner_tangents, load, shading_normals};
use glam::{Vec2, Vec3, Vec4};

struct Reference<'a> {
    mesh: &'a Mesh,
    normals: &'a [Vec3],
    uv: &'a [Vec2],
    tangents: Vec<Option<Vec4>>,
}

impl Geometry for Reference<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.triangle_positions(face)[corner].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.normals[3 * face + corner].to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        // Its v points upwards.
        let uv = self.uv[3 * face + corner];
        [uv.x, 1.0 - uv.y]
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        self.tangents[3 * face + corner] = tangent.map(|t| Vec4::from(t.tangent_encoded()));
    }
}

#[test]
fn tangents_are_those_of_mikktspace() {
    let Some(folder) = data_folder() else { return };
    for name in ["WaterBottle/WaterBottle.gltf", "spot/spot_triangulated.obj", "suzanne.ply"] {
        let model = load(&folder.join("meshes").join(name), &LoadOptions::default()).unwrap();
        let mesh = clean(model, &CleanOptions::default()).unwrap().0;
        let normals = shading_normals(&mesh);
        let uv = &mesh.corners.uv_sets[0];
        let tangents = corner_tangents(&mesh, &normals, |t| Some([0, 1, 2].map(|k| uv[3 * t + k])));
        let empty = vec![None; tangents.len()];
        let mut reference = Reference { mesh: &mesh, normals: &normals, uv, tangents: empty };
        generate_tangents(&mut reference).unwrap();
        let (mut compared, mut different, mut flipped) = (0, 0, 0);
        for (own, theirs) in tangents.iter().zip(&reference.tangents) {
            let Some(theirs) = theirs else { continue };
            compared += 1;
            flipped += u32::from(own.w != theirs.w);
            different += u32::from(own.truncate().angle_between(theirs.truncate()).to_degrees() > 0.1);
        }
        eprintln!(
            "{name}: {compared} corners, {different} differ by more than 0.1 degrees, {flipped} in handedness"
        );
        assert!(compared > tangents.len() as u32 / 2, "{name}");
        // Corners where triangles touch in the vertex alone, or without area in the image, are joined differently.
        assert!(different * 1000 <= compared && flipped == 0, "{name}");
    }
}
