//! Fans for other programs: three look-ups in a sheet are the texture function.

use fantex_bake::NoProgress;
use fantex_base::Random;
use fantex_export::{
    ChannelMap, FanFileOptions, FanSheetOptions, FanSheets, ShaderLanguage, export_fans, fan_sheets,
};
use fantex_mesh::{AlphaMode, Material, Parts, SurfacePoint, generate};
use fantex_store::{ChannelKind, Footprint, PageCache, Sampler};
use fantex_texture::FilterOptions;
use glam::{Vec2, Vec3};

use crate::models::{check_glb, gltf_parts};
use crate::support::{Waves, baked, baked_bottle, cleaned};

/// What a shader computes: bilinear look-ups in a picture of 8 bits, blended.
fn shaded(fans: &FanSheets, map: usize, point: SurfacePoint) -> Vec3 {
    let sheet = &fans.sheets[fans.sheet_of_triangle[point.index()] as usize];
    let [width, height] = sheet.size.map(|n| n as usize);
    let components = fans.maps[map].components;
    let texel = |x: f32, y: f32| {
        let place = y as usize * width + x as usize;
        let start = place.min(width * height - 1) * components;
        Vec3::from([0, 1, 2].map(|k| f32::from(sheet.pictures[map][start + k]) / 255.0))
    };
    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
    for slot in 0..3 {
        let others = point.lambda[(slot + 1) % 3].max(point.lambda[(slot + 2) % 3]);
        let weight = (point.lambda[slot] - others + fans.delta).max(0.0);
        let uv = point.interpolate(fans.uv[point.index()][slot]);
        let at = uv * Vec2::new(width as f32, height as f32) - 0.5;
        let (low, share) = (at.floor(), at - at.floor());
        let row = |y: f32| texel(low.x, y) * (1.0 - share.x) + texel(low.x + 1.0, y) * share.x;
        sum += (row(low.y) * (1.0 - share.y) + row(low.y + 1.0) * share.y) * weight;
        weights += weight;
    }
    sum / weights
}

#[test]
fn three_look_ups_are_the_texture_function() {
    let baked = baked_bottle(1 << 16);
    let sampler = Sampler::of_cache(&PageCache::new(baked.asset.clone(), 64 << 20), FilterOptions::default());
    for largest_side in [8192, 320] {
        let options = FanSheetOptions { largest_side, ..FanSheetOptions::default() };
        let fans = fan_sheets(&baked.asset, &options, &NoProgress).unwrap();
        assert_eq!(fans.sheets.len() > 1, largest_side == 320, "{} sheets", fans.sheets.len());
        let map = fans.maps.iter().position(|m| m.map == ChannelMap::OcclusionRoughnessMetallic).unwrap();
        let mut random = Random::new(7);
        let triangles = baked.asset.mesh().triangles.len();
        for _ in 0..4000 {
            let cut: [f32; 2] = [random.unit() as f32, random.unit() as f32];
            let [a, b] = [cut[0].min(cut[1]), cut[0].max(cut[1])];
            let triangle = random.below(triangles as u64) as u32;
            let point = SurfacePoint { triangle, lambda: Vec3::new(a, b - a, 1.0 - b) };
            let truth = sampler
                .sample(ChannelKind::OcclusionRoughnessMetallic, point, Footprint::NONE)
                .unwrap()
                .truncate();
            let seen = shaded(&fans, map, point);
            assert!((seen - truth).abs().max_element() < 3e-3, "{point:?}: {seen} {truth}");
        }
    }
}

/// Read by a reader that is not ours.
#[test]
fn files_keep_parts_and_materials() {
    let mut mesh = cleaned(generate::torus(16, 10));
    let count = mesh.triangles.len();
    let lamp = Material {
        name: "lamp".into(),
        emission: Vec3::new(3.0, 1.5, 0.0),
        unlit: true,
        roughness: 0.25,
        alpha: AlphaMode::Mask(0.25),
        ..Material::default()
    };
    mesh.materials = vec![Material::default(), lamp];
    mesh.triangle_materials = (0..count).map(|t| u32::from(t % 3 == 0)).collect();
    mesh.parts = Parts {
        names: vec!["left".into(), "right <&>".into()],
        of_triangle: (0..count).map(|t| u32::from(t >= count / 2)).collect(),
    };
    let waves = baked(&mesh, &Waves::color(2.0), 20_000, fantex_bake::BakeFormat::Rgba8);
    let path = waves.path("fans.glb");
    let options = FanFileOptions::default();
    let summary = export_fans(&waves.asset, &path, &options, &NoProgress).unwrap();
    check_glb(&path);
    let (document, buffers) = gltf_parts(&path);
    assert_eq!((document.meshes().count(), document.images().count()), (2, 1));
    let mut vertices = 0;
    for (mesh, (name, triangles)) in
        document.meshes().zip([("left", count / 2), ("right <&>", count - count / 2)])
    {
        assert_eq!(mesh.name(), Some(name));
        let mut found = 0;
        for primitive in mesh.primitives() {
            let reader = primitive.reader(|_| Some(&buffers[0]));
            let own = reader.read_positions().unwrap().count();
            let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            // Each primitive has vertices of its own, and reads all of them.
            assert_eq!(indices.iter().max().map(|&last| last as usize + 1), Some(own));
            assert!((0..4).all(|set| reader.read_tex_coords(set).unwrap().into_f32().count() == own));
            (vertices, found) = (vertices + own, found + indices.len() / 3);
        }
        assert_eq!(found, triangles);
    }
    assert_eq!(vertices, summary.vertices);
    let lamp = document.materials().find(|m| m.name() == Some("lamp")).unwrap();
    assert_eq!(lamp.emissive_factor(), [1.0, 0.5, 0.0]);
    assert!(lamp.alpha_cutoff() == Some(0.25) && lamp.normal_texture().is_none());
    let again = fantex_mesh::load(&path, &Default::default()).unwrap();
    let again = again.materials.iter().find(|m| m.name == "lamp").unwrap();
    assert_eq!((again.emission, again.unlit), (Vec3::new(3.0, 1.5, 0.0), true));
    assert_eq!(lamp.pbr_metallic_roughness().roughness_factor(), 0.25);
    let path = waves.path("fans.usda");
    export_fans(&waves.asset, &path, &options, &NoProgress).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(
        text.contains("def Mesh \"Surface_0_left\"") && text.contains("def Mesh \"Surface_1_right____\"")
    );
    assert!(
        text.contains("\"ND_convert_float_color3\"")
            && text.contains("color3f inputs:emission_color = (3, 1.5, 0)")
    );
    // A shader for each material, with what is its own.
    let path = waves.path("shaded.gltf");
    let shaders = vec![ShaderLanguage::Godot, ShaderLanguage::Glsl];
    let summary =
        export_fans(&waves.asset, &path, &FanFileOptions { shaders, ..options.clone() }, &NoProgress)
            .unwrap();
    let names: Vec<_> = summary.files.iter().map(|(path, _)| path.file_name().unwrap()).collect();
    let expected = [
        "shaded-fans-base-color.png",
        "shaded.bin",
        "shaded.gltf",
        "shaded-material-1.gdshader",
        "shaded-material-2.gdshader",
    ];
    assert_eq!(names, [&expected[..], &["shaded.glsl"]].concat());
    let text = |name: &str| std::fs::read_to_string(waves.path(name)).unwrap();
    let [plain, lamp] = ["shaded-material-1.gdshader", "shaded-material-2.gdshader"].map(text);
    assert!(!plain.contains("ALPHA") && !plain.contains("unshaded"), "{plain}");
    let own = [
        "cull_disabled, unshaded",
        "SCISSOR_THRESHOLD = 0.25",
        "EMISSION = vec3(3.0, 1.5, 0.0)",
        "ROUGHNESS = 0.25",
    ];
    assert!(own.iter().all(|words| lamp.contains(words)), "{lamp}");
    assert!(text("shaded.glsl").contains("FAN_DELTA = 0.0625;") && lamp.contains(text("shaded.glsl").trim()));
    // One picture may be in memory, not all; and none that is too large.
    let sheets = FanSheetOptions { memory_bytes: 40_000, ..options.sheets };
    let tight = FanFileOptions { sheets, ..options };
    let refused = export_fans(&waves.asset, &waves.path("no.glb"), &tight, &NoProgress).unwrap_err();
    assert!(refused.to_string().contains("give more --memory"), "{refused}");
}
