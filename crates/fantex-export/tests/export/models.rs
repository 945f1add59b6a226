//! Models: round trips, and the rules of glTF.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use fantex_bake::{BakeFormat, NoProgress, Progress};
use fantex_base::ErrorKind;
use fantex_export::{
    ChannelMap, Depth, ExportOptions, UnwrapOptions, UvChoice, export_atlas, export_channels, export_model,
    unwrap_mesh, unwrap_triangles,
};
use fantex_mesh::generate::{cube, icosphere, torus};
use fantex_mesh::{AlphaMode, CleanOptions, Mesh};
use fantex_store::ChannelKind;
use fantex_texture::{ColorSpace, Image};
use glam::{DVec3, Vec2, Vec3};
use gltf::Semantic;
use gltf::accessor::{DataType, Dimensions};

use crate::support::{
    Baked, Waves, baked, baked_bottle, bottle, cleaned, data_folder, files, opened, worst_psnr_db,
};

/// Exports as GLB with default options, checks the file, and returns the worst PSNR.
fn round_trip(baked: &Baked) -> f64 {
    let path = baked.path("out.glb");
    let options = ExportOptions { force: true, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    eprintln!("{summary:?}");
    assert!(summary.density_share >= 0.95, "{}", summary.density_share);
    assert_eq!(summary.overlapping_share, 0.0);
    check_glb(&path);
    worst_psnr_db(&baked.asset, &path)
}

/// What the specification asks of the parts that are written here.
pub(crate) fn check_glb(path: &std::path::Path) {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(bytes.len() % 4, 0);
    assert_eq!(u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize, bytes.len());
    // Validates indices, required members, minimum and maximum of positions.
    let (document, buffers) = gltf_parts(path);
    let blob = &buffers[0];
    for view in document.views() {
        assert_eq!(view.offset() % 4, 0);
        assert!(view.offset() + view.length() <= blob.len() && view.length() > 0);
    }
    for accessor in document.accessors() {
        let view = accessor.view().unwrap();
        assert_eq!((view.offset() + accessor.offset()) % accessor.data_type().size(), 0);
        assert!(accessor.offset() + accessor.count() * accessor.size() <= view.length());
    }
    for primitive in document.meshes().flat_map(|m| m.primitives()) {
        let reader = primitive.reader(|_| Some(blob));
        let positions: Vec<Vec3> = reader.read_positions().unwrap().map(Vec3::from).collect();
        let (low, high) = positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
        assert_eq!(Vec3::from(primitive.bounding_box().min), low);
        assert_eq!(Vec3::from(primitive.bounding_box().max), high);
        assert!(low.is_finite() && high.is_finite());
        assert!(reader.read_normals().unwrap().all(|n| (Vec3::from(n).length() - 1.0).abs() < 1e-3));
        assert!(reader.read_tex_coords(0).unwrap().into_f32().flatten().all(f32::is_finite));
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        assert_eq!(indices.len() % 3, 0);
        // A primitive has vertices of its own, and no others.
        let mut used = vec![false; positions.len()];
        indices.iter().for_each(|&i| used[i as usize] = true);
        assert!(used.iter().all(|used| *used));
        let material = primitive.material();
        assert_eq!(material.normal_texture().is_some(), primitive.get(&Semantic::Tangents).is_some());
        for t in reader.read_tangents().into_iter().flatten() {
            assert!((Vec3::new(t[0], t[1], t[2]).length() - 1.0).abs() < 1e-3 && t[3].abs() == 1.0);
        }
        let uv = primitive.get(&Semantic::TexCoords(0)).unwrap();
        assert_eq!((uv.data_type(), uv.dimensions()), (DataType::F32, Dimensions::Vec2));
    }
    for image in document.images() {
        let gltf::image::Source::View { view, mime_type } = image.source() else { panic!("not inside") };
        assert_eq!(mime_type, "image/png");
        let png = &blob[view.offset()..view.offset() + view.length()];
        Image::decode(png, "image", ColorSpace::Srgb).unwrap();
    }
}

/// The parsed and validated document and its buffers.
pub(crate) fn gltf_parts(path: &std::path::Path) -> (gltf::Document, Vec<Vec<u8>>) {
    let gltf = gltf::Gltf::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let blob = gltf.blob.clone().unwrap();
    (gltf.document, vec![blob])
}

#[test]
fn the_bottle_looks_the_same_in_all_its_channels() {
    let baked = baked_bottle(1 << 20);
    let db = round_trip(&baked);
    assert!(db > 40.0, "{db} dB");
}

#[test]
fn the_bunny_looks_the_same() {
    let Some(folder) = data_folder() else { return };
    let mesh = opened(&folder.join("meshes/bunny/stanford_bunny.ply"));
    let baked = baked(&mesh, &Waves::color(40.0), 1 << 20, BakeFormat::Rgba8);
    let db = round_trip(&baked);
    assert!(db > 40.0, "{db} dB");
}

/// A scan's atlas is a few large pieces.
#[test]
fn the_bunny_has_few_charts_and_a_full_atlas() {
    let Some(folder) = data_folder() else { return };
    let mesh = opened(&folder.join("meshes/bunny/stanford_bunny.ply"));
    let baked = baked(&mesh, &Waves::color(40.0), 1 << 20, BakeFormat::Rgba8);
    let options = ExportOptions { padding: Some(4), ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &baked.path("out.glb"), &options, &NoProgress).unwrap();
    assert!(summary.charts < 60, "{} charts", summary.charts);
    assert!(summary.used_share > 0.6, "{} of the atlas", summary.used_share);
    assert_eq!(summary.overlapping_share, 0.0);
}

#[test]
fn all_channels_of_a_sphere_go_round() {
    use ChannelKind::{BaseColor, Emission, Normal, OcclusionRoughnessMetallic};
    let waves = Waves {
        kinds: vec![BaseColor, Normal, OcclusionRoughnessMetallic, Emission],
        brightness: 0.3,
        ..Waves::color(9.0)
    };
    let baked = baked(&cleaned(icosphere(4)), &waves, 1 << 18, BakeFormat::Rgba8);
    let db = round_trip(&baked);
    assert!(db > 40.0, "{db} dB");
}

#[test]
fn bright_light_keeps_its_strength() {
    let waves = Waves {
        kinds: vec![ChannelKind::BaseColor, ChannelKind::Emission],
        brightness: 6.0,
        ..Waves::color(5.0)
    };
    let baked = baked(&cleaned(icosphere(3)), &waves, 1 << 16, BakeFormat::Rgba8);
    let path = baked.path("out.glb");
    export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap();
    let strength = opened(&path).materials[0].emission;
    assert!((strength.x - 5.4).abs() < 0.2, "{strength}");
    assert_eq!(strength.x, strength.z);
    let atlas = export_atlas(&baked.asset, &ExportOptions::default(), &NoProgress).unwrap();
    let scales: Vec<f32> = atlas.pictures.iter().map(|picture| picture.scale).collect();
    assert_eq!(scales, [1.0, strength.x]);
    assert!(worst_psnr_db(&baked.asset, &path) > 35.0);
}

#[test]
fn cut_outs_and_materials_stay_what_they_are() {
    let mut model = cube(2);
    let material = model.materials[0].clone();
    model.materials = vec![
        fantex_mesh::Material { name: "leaf".into(), alpha: AlphaMode::Mask(0.4), ..material.clone() },
        fantex_mesh::Material { alpha: AlphaMode::Blend, double_sided: false, ..material.clone() },
        fantex_mesh::Material { unlit: true, ..material },
    ];
    model.triangle_materials = (0..model.triangles.len() as u32).map(|t| t % 3).collect();
    let waves = Waves { has_alpha: true, ..Waves::color(6.0) };
    let baked = baked(&cleaned(model), &waves, 1 << 17, BakeFormat::Rgba8);
    let db = round_trip(&baked);
    assert!(db > 38.0, "{db} dB");
    let mesh = opened(&baked.path("out.glb"));
    assert_eq!(mesh.materials[0].name, "leaf");
    assert_eq!(mesh.materials[0].alpha, AlphaMode::Mask(0.4));
    assert_eq!(mesh.materials[1].alpha, AlphaMode::Blend);
    assert!(!mesh.materials[1].double_sided && mesh.materials[2].unlit);
}

#[test]
fn a_channel_that_is_missing_leaves_the_factor() {
    let mut model = icosphere(2);
    model.materials[0].roughness = 0.25;
    model.materials[0].metallic = 1.0;
    let baked = baked(&cleaned(model), &Waves::color(4.0), 1 << 14, BakeFormat::Bc7);
    let path = baked.path("out.glb");
    let summary = export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap();
    assert_eq!(summary.maps, [ChannelMap::BaseColor]);
    let material = &opened(&path).materials[0];
    assert_eq!((material.roughness, material.metallic), (0.25, 1.0));
    assert!(material.metallic_roughness_texture.is_none() && material.normal_texture.is_none());
}

#[test]
fn a_single_triangle_fills_its_picture() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y].into_iter().map(|p| p.as_dvec3()).collect();
    let model = fantex_mesh::Model {
        positions,
        triangles: vec![[0, 1, 2]],
        materials: vec![fantex_mesh::Material::default()],
        ..fantex_mesh::Model::default()
    };
    let baked = baked(&cleaned(model), &Waves::color(5.0), 4096, BakeFormat::Rgba8);
    let db = round_trip(&baked);
    assert!(db > 40.0, "{db} dB");
}

#[test]
fn coordinates_far_from_the_origin_keep_their_precision() {
    let mut model = icosphere(3);
    model
        .positions
        .iter_mut()
        .for_each(|p| *p = *p * 10.0 + glam::DVec3::new(651_234.125, 5_123_456.5, 800.25));
    let baked = baked(&cleaned(model), &Waves::color(4.0), 1 << 14, BakeFormat::Rgba8);
    let path = baked.path("out.glb");
    export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap();
    let (own, back) = (baked.asset.mesh(), opened(&path));
    let bounds = |mesh: &Mesh| fantex_render::world_bounds(mesh);
    assert!(bounds(own).min.distance(bounds(&back).min) < 1e-4);
    assert!(worst_psnr_db(&baked.asset, &path) > 40.0);
}

#[test]
fn a_text_file_has_its_parts_beside_it() {
    let baked = baked_bottle(1 << 16);
    let path = baked.path("my bottle.gltf");
    let options = ExportOptions { with_ktx2: true, side: Some(256), ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    let mut expected = vec!["asset.fan".to_owned(), "my bottle.bin".to_owned(), "my bottle.gltf".to_owned()];
    for map in &summary.maps {
        expected.extend(["png", "ktx2"].map(|e| format!("my bottle-{}.{e}", map.name())));
    }
    expected.sort();
    assert_eq!(files(baked.folder.path()), expected);
    assert_eq!(summary.files.len(), expected.len() - 1);
    assert!(worst_psnr_db(&baked.asset, &path) > 25.0);
}

#[test]
fn the_models_own_coordinates_come_back() {
    let mesh = bottle();
    let baked = baked_bottle(1 << 20);
    let path = baked.path("out.glb");
    let options = ExportOptions { uv: fantex_export::UvChoice::OfAsset, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &path, &options, &NoProgress).unwrap();
    eprintln!("{summary:?}");
    check_glb(&path);
    let back = opened(&path);
    assert_eq!(back.corners.uv_sets[0], mesh.corners.uv_sets[0]);
    let db = worst_psnr_db(&baked.asset, &path);
    assert!(db > 38.0, "{db} dB");
}

#[test]
fn broken_models_are_exported_whole() {
    let Some(folder) = data_folder() else { return };
    for name in [
        "bunny_nonmanifold.ply",
        "joined_tetrahedra.obj",
        "multibody.stl",
        "soup.stl",
        "wallhole.obj",
        "two_objects.obj",
    ] {
        let mesh = opened(&folder.join("meshes/broken").join(name));
        let baked = baked(&mesh, &Waves::color(8.0), 1 << 18, BakeFormat::Rgba8);
        let path = baked.path("out.glb");
        let summary = export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap();
        check_glb(&path);
        let db = worst_psnr_db(&baked.asset, &path);
        eprintln!("{name}: {db:.1} dB, {} triangles, {summary:?}", mesh.triangles.len());
        assert!(db > 36.0, "{name}: {db} dB");
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let baked = baked_bottle(1 << 16);
    let export = |threads: usize, name: &str| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let path = baked.path(name);
        pool.install(|| export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress)).unwrap();
        std::fs::read(path).unwrap()
    };
    // The model's name is the file's.
    std::fs::create_dir(baked.path("one")).unwrap();
    assert!(export(1, "one/x.glb") == export(3, "x.glb"));
}

// ---- What goes wrong leaves nothing behind.

#[test]
fn sizes_that_no_picture_has_are_refused() {
    let baked = baked_bottle(1 << 12);
    let path = baked.path("x.glb");
    for (side, padding, sentence) in [
        (Some(1000), None, "a picture cannot have 1000 x 1000 texels; give a power of two from 16 to 32768"),
        (
            Some(65_536),
            None,
            "a picture cannot have 65536 x 65536 texels; give a power of two from 16 to 32768",
        ),
        (None, Some(3), "the padding cannot be 3 texels; give a power of two up to 64"),
    ] {
        let options = ExportOptions { side, padding, ..ExportOptions::default() };
        let error = export_model(&baked.asset, &path, &options, &NoProgress).unwrap_err();
        assert_eq!(error.to_string(), sentence);
    }
    let unknown = export_model(&baked.asset, &baked.path("x.fbx"), &ExportOptions::default(), &NoProgress);
    assert_eq!(unknown.unwrap_err().kind(), ErrorKind::InvalidArgument);
    assert_eq!(files(baked.folder.path()), ["asset.fan"]);
}

#[test]
fn existing_files_stay_unless_forced() {
    let baked = baked_bottle(1 << 12);
    std::fs::write(baked.path("x.bin"), "mine").unwrap();
    let options = ExportOptions { side: Some(64), ..ExportOptions::default() };
    let error = export_model(&baked.asset, &baked.path("x.gltf"), &options, &NoProgress).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::AlreadyExists, "{error}");
    assert_eq!(files(baked.folder.path()), ["asset.fan", "x.bin"]);
    let options = ExportOptions { force: true, ..options };
    export_model(&baked.asset, &baked.path("x.gltf"), &options, &NoProgress).unwrap();
    assert_ne!(std::fs::read(baked.path("x.bin")).unwrap(), b"mine");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let baked = baked_bottle(1 << 12);
    let path = baked.path("nowhere/x.glb");
    let error = export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap_err();
    assert!(error.to_string().starts_with(&format!("cannot write {}: ", path.display())), "{error}");
}

#[test]
fn a_cancelled_export_leaves_nothing() {
    /// Stops after the first rows of the picture.
    struct Impatient(AtomicBool);
    impl Progress for Impatient {
        fn report(&self, done: u64, total: u64) {
            self.0.fetch_or(done > 0 && total == 1 << 20, Ordering::Relaxed);
        }

        fn is_cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed)
        }
    }
    let baked = baked_bottle(1 << 16);
    let watch = Impatient(AtomicBool::new(false));
    let options = ExportOptions { side: Some(1024), with_ktx2: true, ..ExportOptions::default() };
    let error = export_model(&baked.asset, &baked.path("x.gltf"), &options, &watch).unwrap_err();
    assert!(error.is_cancelled());
    assert_eq!(files(baked.folder.path()), ["asset.fan"]);
}

/// One step for the layout, one for the pictures, and nobody waits long for the next report.
#[test]
fn all_of_an_export_is_told() {
    #[derive(Default)]
    struct Heard(Mutex<Vec<(u64, u64)>>);
    impl Progress for Heard {
        fn report(&self, done: u64, total: u64) {
            self.0.lock().unwrap().push((done, total));
        }
    }
    let baked = baked_bottle(1 << 14);
    let heard = Heard::default();
    let options = ExportOptions { side: Some(512), ..ExportOptions::default() };
    export_model(&baked.asset, &baked.path("x.glb"), &options, &heard).unwrap();
    let heard = heard.0.into_inner().unwrap();
    let begins: Vec<usize> = (0..heard.len()).filter(|&i| heard[i].0 == 0).collect();
    let [layout, pictures] = *<&[usize; 2]>::try_from(&*begins).unwrap();
    assert_eq!(layout, 0);
    assert!(pictures > 20, "{pictures} reports of the layout");
    for step in [&heard[..pictures], &heard[pictures..]] {
        let total = step[0].1;
        assert!(step.iter().all(|report| report.1 == total));
        assert!(step.is_sorted() && step[step.len() - 1].0 == total, "{step:?}");
    }
    assert_eq!(heard[pictures].1, 512 * 512);
}

#[test]
fn packing_can_be_cancelled() {
    struct Stopped;
    impl Progress for Stopped {
        fn report(&self, _: u64, _: u64) {
            panic!("nothing was to be written");
        }

        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let baked = baked_bottle(1 << 14);
    for side in [None, Some(512)] {
        let options = ExportOptions { side, ..ExportOptions::default() };
        let error = export_model(&baked.asset, &baked.path("x.glb"), &options, &Stopped).unwrap_err();
        assert!(error.is_cancelled(), "{error}");
    }
    assert_eq!(files(baked.folder.path()), ["asset.fan"]);
}

#[test]
fn a_picture_that_must_be_whole_in_memory_says_so() {
    let baked = baked_bottle(1 << 12);
    let path = baked.path("x.exr");
    let options = ExportOptions { side: Some(4096), memory_bytes: 64 << 20, ..ExportOptions::default() };
    let error =
        export_channels(&baked.asset, &[(ChannelMap::BaseColor, &path)], Depth::Eight, &options, &NoProgress)
            .unwrap_err();
    assert!(error.kind() == ErrorKind::TooLarge && error.to_string().contains("needs"), "{error}");
    assert!(!path.exists());
}

#[test]
fn every_corner_lies_in_the_picture_and_no_triangle_is_flat() {
    let mesh = cleaned(torus(32, 16));
    let unwrapped =
        unwrap_mesh(&mesh, &UnwrapOptions { side: 256, padding: Some(2), is_square: true }).unwrap();
    assert_eq!(unwrapped.uv.len(), mesh.triangles.len());
    assert!(unwrapped.charts > 1 && unwrapped.charts < 40, "{} charts", unwrapped.charts);
    for corners in &unwrapped.uv {
        assert!(corners.iter().all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all()));
        assert!((corners[1] - corners[0]).perp_dot(corners[2] - corners[0]).abs() > 1e-7);
    }
}

#[test]
fn a_loose_triangle_that_repeats_another_has_its_coordinates() {
    let once = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let positions: Vec<DVec3> = [once, once, once.map(|p| p + DVec3::Z)].concat();
    // The second lies where the first does, with its corners in another order.
    let triangles = [[0, 1, 2], [4, 5, 3], [6, 7, 8]];
    let options = UnwrapOptions { side: 64, ..UnwrapOptions::default() };
    let (mesh, unwrapped) =
        unwrap_triangles(&positions, &triangles, &CleanOptions::default(), &options, &NoProgress).unwrap();
    let uv = |t: usize, k: usize| mesh.uv[mesh.triangles[t][k] as usize];
    assert_eq!(unwrapped.charts, 2);
    assert!((0..3).all(|k| uv(1, k) == uv(0, (k + 1) % 3)));
    assert!((0..3).all(|k| uv(2, k) != uv(0, k)));
}

#[test]
fn without_any_area_options_count_all_the_same() {
    let unwrap = |side: u32| {
        unwrap_triangles(
            &[DVec3::ZERO; 3],
            &[[0, 1, 2]],
            &CleanOptions::default(),
            &UnwrapOptions { side, ..UnwrapOptions::default() },
            &NoProgress,
        )
    };
    assert_eq!(unwrap(64).unwrap().1.size, [64; 2]);
    assert!(unwrap(1000).unwrap_err().to_string().contains("1000 x 1000"));
}

/// Pictures by the model's own coordinates may be as small as those of a packing.
#[test]
fn pictures_by_the_models_coordinates_may_be_small() {
    let baked = baked_bottle(1 << 12);
    let options = ExportOptions { uv: UvChoice::OfAsset, largest_side: 16, ..ExportOptions::default() };
    let summary = export_model(&baked.asset, &baked.path("x.glb"), &options, &NoProgress).unwrap();
    assert!(summary.sizes.iter().all(|&size| size == [16, 16]), "{:?}", summary.sizes);
}

#[test]
fn triangles_are_unwrapped_as_they_come() {
    let model = torus(16, 8);
    let mut triangles = model.triangles.clone();
    // Without area, repeated, repeated in another order of corners; positions that are no numbers.
    triangles.extend([
        [1, 1, 2],
        triangles[5],
        [triangles[6][1], triangles[6][2], triangles[6][0]],
        [0, 1, 128],
    ]);
    let mut positions = model.positions.clone();
    positions.push(DVec3::NAN);
    let options = UnwrapOptions { side: 16, ..UnwrapOptions::default() };
    let (mesh, unwrapped) =
        unwrap_triangles(&positions, &triangles, &CleanOptions::default(), &options, &NoProgress).unwrap();
    assert!(unwrapped.size[0] >= 16 && unwrapped.charts > 1);
    assert_eq!(mesh.triangles.len(), triangles.len());
    let corner = |t: usize, k: usize| {
        let vertex = mesh.triangles[t][k] as usize;
        assert_eq!(mesh.vertices[vertex], triangles[t][k]);
        mesh.uv[vertex]
    };
    let laid: Vec<[Vec2; 3]> = (0..triangles.len()).map(|t| [0, 1, 2].map(|k| corner(t, k))).collect();
    let [flat, same, turned, unusable] = laid[256..] else { panic!("{} triangles", laid.len()) };
    assert!(flat[0] == flat[1] && flat[1] == flat[2] && unusable[0] == unusable[2]);
    assert_eq!(same, laid[5]);
    assert_eq!(turned, [laid[6][1], laid[6][2], laid[6][0]]);
    let error = unwrap_triangles(&positions, &[[0, 1, 999]], &CleanOptions::default(), &options, &NoProgress)
        .unwrap_err();
    assert!(error.to_string().contains("triangle 0 has the vertices [0, 1, 999]"), "{error}");
}

#[test]
fn an_atlas_in_memory_is_the_one_in_files() {
    let baked = baked_bottle(1 << 14);
    let options = ExportOptions { side: Some(128), ..ExportOptions::default() };
    let atlas = export_atlas(&baked.asset, &options, &NoProgress).unwrap();
    export_model(&baked.asset, &baked.path("out.gltf"), &options, &NoProgress).unwrap();
    assert!(atlas.pictures.len() >= 3);
    for picture in &atlas.pictures {
        let file = Image::load(baked.path(&format!("out-{}.png", picture.map.name()))).unwrap();
        let fantex_texture::Samples::U8(samples) = file.samples else { panic!("{}", picture.map.name()) };
        assert!(samples == picture.samples, "{}", picture.map.name());
    }
    assert_eq!(atlas.mesh.triangles.len(), baked.asset.mesh().triangles.len());
}

/// Parts come out as nodes with their names and triangles, those without triangles do not; another reader finds them.
#[test]
fn parts_keep_their_names() {
    let mesh = cleaned(icosphere(2));
    let of_triangle: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| [0, 2, 3][t as usize % 3]).collect();
    let names = ["left leg", "empty", "", "B\u{e4}r"].map(String::from).to_vec();
    let parts = fantex_mesh::Parts { names, of_triangle };
    let mesh = Mesh {
        parts,
        materials: vec![Default::default(); 3],
        triangle_materials: (0..mesh.triangles.len() as u32).map(|t| 2 * (t / 3 % 2)).collect(),
        ..mesh
    };
    let baked = baked(&mesh, &Waves::color(9.0), 1 << 14, BakeFormat::Rgba8);
    let path = baked.path("out.glb");
    export_model(&baked.asset, &path, &ExportOptions::default(), &NoProgress).unwrap();
    check_glb(&path);
    let (document, buffers) = gltf_parts(&path);
    assert_eq!(document.materials().count(), 2);
    let of_node = |node: gltf::Node| {
        let mesh = node.mesh().unwrap();
        assert_eq!(mesh.name(), node.name());
        let count =
            |p: gltf::Primitive| p.reader(|_| Some(&buffers[0])).read_indices().unwrap().into_u32().count();
        (node.name().unwrap().to_owned(), mesh.primitives().map(count).sum::<usize>() / 3)
    };
    let found: Vec<_> = document.default_scene().unwrap().nodes().map(of_node).collect();
    let expected = [("left leg", 107), ("out", 107), ("B\u{e4}r", 106)];
    assert!(found.iter().map(|(name, count)| (name.as_str(), *count)).eq(expected), "{found:?}");
    let again = fantex_mesh::load(&path, &Default::default()).unwrap();
    assert_eq!(again.parts.names, ["left leg", "out", "B\u{e4}r"]);
}
