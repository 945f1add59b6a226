//! Every shipped model loads with the expected number of triangles, and glTF files give what another reader gives.

use crate::common::{assert_consistent, data_folder};
use fantex_mesh::{ImageSource, LoadOptions, load};
use glam::{DVec3, Vec2, Vec3};

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
