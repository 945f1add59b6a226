//! Fans for other programs: three look-ups in a sheet are the texture function.

use std::collections::BTreeSet;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

use fantex_bake::{NoProgress, Progress};
use fantex_base::{ErrorKind, Random};
use fantex_cover::{CoverOptions, TexelBudget};
use fantex_export::{
    ChannelMap, Depth, FanFileOptions, FanSheetOptions, FanSheets, ShaderLanguage, SheetPictures,
    export_fans, fan_sheets,
};
use fantex_mesh::{AlphaMode, Material, Parts, SurfacePoint, generate};
use fantex_store::{ChannelKind, Footprint, PageCache, Sampler};
use fantex_texture::color::linear_from_srgb;
use fantex_texture::compare::psnr_db;
use fantex_texture::{ColorSpace, FilterOptions, Image, Samples};
use glam::{Vec2, Vec3, Vec4};

use crate::models::{check_glb, gltf_parts};
use crate::support::{Baked, Waves, baked, baked_bottle, cleaned, covered_and_baked, files};

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
        // Each triangle is in the first sheet that has its tiles.
        let tiles = &baked.asset.cover().corner_groups;
        let mut held = vec![BTreeSet::<u32>::new(); fans.sheets.len()];
        for (own, &sheet) in tiles.iter().zip(&fans.sheet_of_triangle) {
            held[sheet as usize].extend(own);
        }
        for (own, &sheet) in tiles.iter().zip(&fans.sheet_of_triangle) {
            let first = held.iter().position(|held| own.iter().all(|group| held.contains(group)));
            assert_eq!(first, Some(sheet as usize));
        }
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
    // KHR_materials_unlit excludes KHR_materials_emissive_strength.
    assert_eq!((again.emission, again.unlit), (Vec3::new(1.0, 0.5, 0.0), true));
    assert_eq!(lamp.pbr_metallic_roughness().roughness_factor(), 0.25);
    let path = waves.path("fans.usda");
    export_fans(&waves.asset, &path, &options, &NoProgress).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(
        text.contains("def Mesh \"Surface_0_left\"") && text.contains("def Mesh \"Surface_1_right____\"")
    );
    assert!(text.contains("displayName = \"left\"") && text.contains("displayName = \"lamp\""));
    assert_eq!(text.matches("float3[] extent = [(").count(), 2);
    assert!(
        text.contains("\"ND_convert_float_color3\"")
            // The lamp is unlit: it shows its colour.
            && text.contains("inputs:emission_color.connect = </Model/Materials/material_1_sheet_0/color.outputs:out>")
    );
    // The other material is opaque, and this one is cut out at its threshold.
    assert_eq!(text.matches("inputs:opacity.connect").count(), 1);
    assert!(
        text.contains("/opacity_from_0_25.outputs:out>") && text.contains("float inputs:value2 = 0.25"),
        "{text}"
    );
    assert!(text.contains("@@@./fans-fans-base-color.png@@@"));
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

/// Fails where work is shown.
struct Idle;

impl Progress for Idle {
    fn report(&self, done: u64, _: u64) {
        assert_eq!(done, 0, "something was drawn");
    }
}

#[test]
fn files_that_exist_are_refused_before_anything_is_drawn() {
    let mut mesh = cleaned(generate::torus(8, 6));
    let count = mesh.triangles.len();
    mesh.materials = vec![Material::default(); 2];
    mesh.triangle_materials = (0..count).map(|t| u32::from(t >= count / 2)).collect();
    let waves = baked(&mesh, &Waves::color(2.0), 5000, fantex_bake::BakeFormat::Rgba8);
    let shaders = vec![ShaderLanguage::Godot, ShaderLanguage::Glsl];
    for (name, pictures) in [
        ("a.gltf", SheetPictures::PngAndKtx2),
        ("a.glb", SheetPictures::PngAndExr),
        ("a.usda", SheetPictures::PngAndExr),
        ("a.usda", SheetPictures::Exr),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let options = FanFileOptions { pictures, shaders: shaders.clone(), ..FanFileOptions::default() };
        let path = folder.path().join(name);
        let made = export_fans(&waves.asset, &path, &options, &NoProgress).unwrap().files;
        assert!(made.len() > 3, "{made:?}");
        made.iter().for_each(|(file, _)| std::fs::remove_file(file).unwrap());
        for (file, _) in &made {
            std::fs::write(file, "mine").unwrap();
            let refused = export_fans(&waves.asset, &path, &options, &Idle).unwrap_err();
            let words = format!("{} exists already", file.display());
            assert!(refused.to_string().contains(&words), "{refused}: not {words}");
            std::fs::remove_file(file).unwrap();
        }
        assert!(folder.path().read_dir().unwrap().next().is_none());
    }
}

/// Whoever asks for an end once all is drawn has it, too.
#[test]
fn exports_of_fans_end_after_drawing_when_asked_to() {
    /// How often it was asked since all was drawn, once that is.
    struct Ended(AtomicU32);
    impl Progress for Ended {
        fn report(&self, done: u64, total: u64) {
            if done == total && total > 1000 {
                self.0.fetch_max(1, Relaxed);
            }
        }

        fn is_cancelled(&self) -> bool {
            // Drawing asks once after its last report.
            self.0.load(Relaxed) > 0 && self.0.fetch_add(1, Relaxed) > 1
        }
    }
    let mesh = cleaned(generate::torus(8, 6));
    let waves = baked(&mesh, &Waves::color(2.0), 5000, fantex_bake::BakeFormat::Rgba8);
    for name in ["a.gltf", "a.glb", "a.usda"] {
        let folder = tempfile::tempdir().unwrap();
        let (path, ended) = (folder.path().join(name), Ended(AtomicU32::new(0)));
        let error = export_fans(&waves.asset, &path, &FanFileOptions::default(), &ended).unwrap_err();
        assert!(error.is_cancelled(), "{error}");
        assert!(folder.path().read_dir().unwrap().next().is_none());
    }
}

/// What Pixar's reader wants, and what is each part's own.
#[test]
fn usd_has_families_of_subsets_and_names_any_file() {
    let mut mesh = cleaned(generate::torus(8, 6));
    let count = mesh.triangles.len();
    mesh.materials =
        [false, true].map(|double_sided| Material { double_sided, ..Material::default() }).to_vec();
    mesh.triangle_materials = (0..count).map(|t| u32::from(t >= count / 2)).collect();
    mesh.parts =
        Parts { names: vec!["front".into(), "both".into()], of_triangle: mesh.triangle_materials.clone() };
    let waves = baked(&mesh, &Waves::color(2.0), 5000, fantex_bake::BakeFormat::Rgba8);
    let options = FanFileOptions::default();
    export_fans(&waves.asset, &waves.path("a@@@b.usda"), &options, &NoProgress).unwrap();
    let text = std::fs::read_to_string(waves.path("a@@@b.usda")).unwrap();
    let sides = text.lines().filter(|line| line.contains("doubleSided"));
    let sides: Vec<_> = sides.map(|line| line.rsplit(' ').next().unwrap()).collect();
    assert_eq!(sides, ["0", "1"]);
    let family = "uniform token subsetFamily:materialBind:familyType = \"partition\"";
    assert_eq!(text.matches(family).count(), 2);
    assert!(text.contains("@@@./a\\@@@b-fans-base-color.png@@@"));
    let refused = export_fans(&waves.asset, &waves.path("a\nb.usda"), &options, &NoProgress).unwrap_err();
    assert_eq!(refused.kind(), ErrorKind::InvalidArgument);
    assert!(refused.to_string().contains("control character"), "{refused}");
}

#[test]
fn unlit_materials_shine_and_factors_of_opacity_count() {
    let mut mesh = cleaned(generate::torus(8, 6));
    let count = mesh.triangles.len();
    let glass = Material {
        alpha: AlphaMode::Blend,
        base_color: Vec4::new(0.5, 0.5, 1.0, 0.4),
        emission: Vec3::new(3.0, 1.5, 0.0),
        ..Material::default()
    };
    let sign = Material { unlit: true, base_color: Vec4::new(0.25, 0.5, 0.75, 1.0), ..Material::default() };
    mesh.materials = vec![glass, sign];
    mesh.triangle_materials = (0..count).map(|t| u32::from(t >= count / 2)).collect();
    // Without colours of its own.
    let kinds = vec![ChannelKind::OcclusionRoughnessMetallic];
    let source = Waves { kinds, ..Waves::color(2.0) };
    let waves = baked(&mesh, &source, 5000, fantex_bake::BakeFormat::Rgba8);
    export_fans(&waves.asset, &waves.path("a.usda"), &FanFileOptions::default(), &NoProgress).unwrap();
    let text = std::fs::read_to_string(waves.path("a.mtlx")).unwrap();
    let surfaces: Vec<&str> = text.split("<standard_surface").skip(1).collect();
    let [glass, sign] = surfaces[..] else { panic!("{text}") };
    let has = |surface: &str, input: &str, value: &str| {
        let input = format!("<input name=\"{input}\" ");
        surface.lines().any(|line| line.contains(&input) && line.contains(&format!("value=\"{value}\"")))
    };
    assert!(has(glass, "base", "1") && has(glass, "opacity", "0.4, 0.4, 0.4"), "{glass}");
    assert!(
        has(glass, "emission_color", "3, 1.5, 0") && glass.contains("output=\"metallic_out\""),
        "{glass}"
    );
    assert!(has(sign, "base", "0") && has(sign, "specular", "0"), "{sign}");
    assert!(has(sign, "emission_color", "0.25, 0.5, 0.75") && !sign.contains("metal"), "{sign}");
}

#[test]
fn channels_without_a_sheet_are_told() {
    use ChannelKind::{Anisotropy, BaseColor, Displacement};
    let waves = Waves { kinds: vec![BaseColor, Anisotropy, Displacement], ..Waves::color(2.0) };
    let waves = baked(&cleaned(generate::torus(8, 6)), &waves, 5000, fantex_bake::BakeFormat::Rgba8);
    let export = |name: &str| {
        export_fans(&waves.asset, &waves.path(name), &FanFileOptions::default(), &NoProgress).unwrap()
    };
    for name in ["a.glb", "b.usda"] {
        let summary = export(name);
        assert_eq!(
            (summary.maps, summary.left_out),
            (vec![ChannelMap::BaseColor], vec![Anisotropy, Displacement])
        );
    }
}

#[test]
fn materials_refer_to_their_light_map() {
    let waves = Waves { kinds: vec![ChannelKind::BaseColor, ChannelKind::Light], ..Waves::color(2.0) };
    let waves = baked(&cleaned(generate::torus(8, 6)), &waves, 5000, fantex_bake::BakeFormat::Float);
    let path = waves.path("a.gltf");
    export_fans(&waves.asset, &path, &FanFileOptions::default(), &NoProgress).unwrap();
    let model: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let texture = model["materials"][0]["extras"]["fantexLightTexture"].as_u64().unwrap();
    let image = model["textures"][texture as usize]["source"].as_u64().unwrap();
    assert_eq!(model["images"][image as usize]["uri"], "a-fans-light.png");
}

/// All maps of sheets, with light that is brighter than 1.
/// In tiles of at most so many columns and rows.
fn bright(tile: u32) -> Baked {
    use ChannelKind::{BaseColor, Emission, Light, Normal, OcclusionRoughnessMetallic};
    let kinds = vec![BaseColor, OcclusionRoughnessMetallic, Normal, Emission, Light];
    let waves = Waves { kinds, brightness: 6.0, has_alpha: true, ..Waves::color(3.0) };
    let mut mesh = cleaned(generate::torus(16, 10));
    mesh.materials = vec![Material { alpha: AlphaMode::Blend, ..Material::default() }];
    let options = CoverOptions { budget: TexelBudget::Total(20_000), tile, ..CoverOptions::default() };
    covered_and_baked(&mesh, &waves, &options, fantex_bake::BakeFormat::Float)
}

/// The linear, unscaled numbers of a sheet's picture, as fixed-point samples hold them.
fn linear_numbers(fans: &FanSheets, sheet: usize, map: usize) -> Vec<f32> {
    let (about, bytes) = (&fans.maps[map], &fans.sheets[sheet].pictures[map]);
    let number = |i: usize| match about.depth {
        Depth::Sixteen => f32::from(u16::from_be_bytes([bytes[2 * i], bytes[2 * i + 1]])) / 65535.0,
        Depth::Eight if about.is_srgb && i % about.components < 3 => {
            linear_from_srgb(f32::from(bytes[i]) / 255.0) * about.scale
        }
        Depth::Eight => f32::from(bytes[i]) / 255.0,
    };
    (0..bytes.len() / if about.depth == Depth::Eight { 1 } else { 2 }).map(number).collect()
}

#[test]
fn sheets_in_openexr_hold_the_same_light() {
    let baked = bright(64);
    // Several sheets.
    let sheets = FanSheetOptions { largest_side: 160, ..FanSheetOptions::default() };
    let fans = fan_sheets(&baked.asset, &sheets, &NoProgress).unwrap();
    assert!(fans.sheets.len() > 1 && fans.maps.len() == 5, "{} sheets", fans.sheets.len());
    let options = FanFileOptions { sheets, pictures: SheetPictures::Exr, ..FanFileOptions::default() };
    export_fans(&baked.asset, &baked.path("fans.usda"), &options, &NoProgress).unwrap();
    assert!(files(baked.folder.path()).iter().all(|name| !name.ends_with(".png")));
    for (index, sheet) in fans.sheets.iter().enumerate() {
        for (map, about) in fans.maps.iter().enumerate() {
            let name = format!("fans-fans-{}-{}.exr", about.map.name(), index + 1);
            let image = Image::load_as(baked.path(&name), ColorSpace::Linear).unwrap();
            assert_eq!([image.width, image.height], sheet.size);
            assert_eq!(usize::from(image.channels), about.components, "{name}");
            let Samples::F32(numbers) = &image.samples else { panic!("{name} holds no floats") };
            let tolerance = match about.map {
                // Those of 8 bits hold no more than 1.
                ChannelMap::Light | ChannelMap::BaseColor | ChannelMap::OcclusionRoughnessMetallic => 5e-3,
                ChannelMap::Emission => 6.0 * 5e-3,
                _ => 3e-4,
            };
            for (exact, rounded) in numbers.iter().zip(linear_numbers(&fans, index, map)) {
                assert!((exact - rounded).abs() < tolerance, "{name}: {exact} {rounded}");
            }
        }
    }
    let texts = ["fans.usda", "fans.mtlx"].map(|name| std::fs::read_to_string(baked.path(name)).unwrap());
    for text in texts {
        assert!(text.contains("fans-fans-emission-2.exr") && !text.contains(".png"));
        assert!(text.contains("\"lin_rec709\"") && !text.contains("srgb_texture"));
    }
    // glTF knows no OpenEXR: beside it, or not at all.
    let refused = export_fans(&baked.asset, &baked.path("no.glb"), &options, &NoProgress).unwrap_err();
    assert!(refused.to_string().contains("png+exr"), "{refused}");
    let options = FanFileOptions { pictures: SheetPictures::PngAndExr, ..options };
    let summary = export_fans(&baked.asset, &baked.path("both.glb"), &options, &NoProgress).unwrap();
    assert_eq!(summary.files.len(), 1 + fans.maps.len() * fans.sheets.len());
}

#[test]
fn sheets_in_ktx2_have_all_levels() {
    let baked = bright(CoverOptions::default().tile);
    let mut is_square = [true; 2];
    for (gutter, is_square) in [4, 16].into_iter().zip(&mut is_square) {
        let sheets = FanSheetOptions { gutter, ..FanSheetOptions::default() };
        let fans = fan_sheets(&baked.asset, &sheets, &NoProgress).unwrap();
        let size = fans.sheets[0].size;
        // So that texels as wide as the gutter end with the sheet.
        assert!(size.iter().all(|length| length % gutter == 0), "{size:?}");
        *is_square = size[0] == size[1];
        let options = FanFileOptions { sheets, pictures: SheetPictures::PngAndKtx2, ..Default::default() };
        let name = format!("gutter{gutter}");
        export_fans(&baked.asset, &baked.path(&format!("{name}.glb")), &options, &NoProgress).unwrap();
        for (map, about) in fans.maps.iter().enumerate() {
            let path = baked.path(&format!("{name}-fans-{}.ktx2", about.map.name()));
            let bytes = std::fs::read(&path).unwrap();
            let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
            let format = match (about.map, about.is_srgb) {
                (ChannelMap::Light | ChannelMap::Normal, _) => 97,
                (_, true) => 146,
                (_, false) => 145,
            };
            assert_eq!([word(12), word(20), word(24)], [format, size[0], size[1]], "{path:?}");
            assert_eq!(word(40), size[0].max(size[1]).ilog2() + 1);
            let space = if about.is_srgb { ColorSpace::Srgb } else { ColorSpace::Linear };
            let packed = Image::load_as(&path, space).unwrap();
            let expected = linear_numbers(&fans, 0, map);
            let rgba = expected.chunks_exact(about.components).flat_map(|texel| {
                let alpha = texel.get(3).copied().unwrap_or(1.0);
                let color = Vec3::new(texel[0], texel[1], texel[2]) / about.scale;
                // Means of normals, as texels have that nothing reads, are made unit vectors.
                let unit = (color * 2.0 - 1.0).normalize_or(Vec3::Z) * 0.5 + 0.5;
                let [r, g, b] = if about.map == ChannelMap::Normal { unit } else { color }.to_array();
                [r, g, b, alpha]
            });
            let expected = Image::from_linear(size[0], size[1], 4, rgba.collect());
            let db = psnr_db(&packed, &expected).unwrap();
            println!("{:?}, gutter {gutter}: {db:.1} dB", about.map);
            assert!(db > 38.0, "{:?}: {db} dB", about.map);
        }
    }
    assert!(is_square.contains(&false), "rows and columns are told apart");
}
