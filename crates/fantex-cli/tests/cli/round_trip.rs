//! The whole path: generate, bake, verify, render, compare; and the keys of the machine output.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{
    COLORED_PLY, CUBE_OBJ, bottle, data, fails, fantex, files, json, run, stderr, succeeds, workspace, write,
};

/// The value must hold all keys; `a.b` is key b within a.
fn assert_keys(value: &Value, keys: &[&str]) {
    for key in keys {
        let found = key.split('.').try_fold(value, |value, part| value.get(part));
        assert!(found.is_some(), "{key} is missing in {value:#}");
    }
}

#[test]
fn info_has_all_keys() {
    let info = json(&[&"info", &bottle()]);
    assert_keys(
        &info,
        &[
            "triangles",
            "vertices",
            "fans",
            "fans_projected",
            "fans_unfolded",
            "fans_split",
            "groups",
            "tiles",
            "texels",
            "density_share",
            "lookups_per_sample",
            "stretch.p1",
            "stretch.median",
            "stretch.p99",
            "seconds.load",
            "seconds.clean",
            "seconds.cover",
            "report",
        ],
    );
    assert_eq!(info["triangles"], 4510);
    assert_eq!(info["vertices"], 2385);
    assert_eq!(info["fans"], 2385);
    // As many as a bake gives it: its textures have a density of their own.
    let texels = info["texels"].as_f64().unwrap();
    assert!((texels / 2.84e6 - 1.0).abs() < 0.02 && info["texels_asked"].is_null(), "{texels}");
    assert!(
        info["report"]
            .as_array()
            .unwrap()
            .iter()
            .any(|line| line.as_str().unwrap().contains("164 vertices welded"))
    );
    let share = info["density_share"].as_f64().unwrap();
    assert!(share > 0.3 && share < 1.0, "{share}");
}

#[test]
fn one_fan_per_tile_gives_as_many_tiles_as_fans() {
    let info = json(&[&"info", &bottle(), &"--tile", &"0", &"--texels", &"1M"]);
    assert_eq!(info["tiles"], info["fans"]);
    let wanted = json(&[&"info", &bottle(), &"--texels", &"1M"])["texels"].as_f64().unwrap();
    assert!((wanted / 1e6 - 1.0).abs() < 0.02, "{wanted}");
}

/// A square whose two triangles have corners of their own, a ten-millionth of its side apart.
const TORN_OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1e-7 0\nv 1.0000001 1 0\nv 0 1 0\nf 1 2 3\nf 4 5 6\n";

#[test]
fn vertices_that_rounding_sets_apart_are_joined_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (model, asset) = (write(folder.path(), "torn.obj", TORN_OBJ), at("torn.fan"));
    let bake = |more: &str| {
        let solid = ["--source=solid=wood", "--texels=4k"];
        stderr(&succeeds(&[&"bake", &model, &"-o", &asset, &"--force", &solid[0], &solid[1], &more]))
    };
    let note = "2 vertices within a millionth of the model's size of another one";
    assert!(bake("--quality=ultra-fast").contains(note));
    assert!(!bake("--weld=1e-6").contains("millionth"));
    let (torn, joined) = (json(&[&"info", &model]), json(&[&"info", &model, &"--weld", &"1e-6"]));
    assert_eq!((&torn["vertices"], &torn["components"]), (&6.into(), &2.into()));
    assert_eq!((&joined["vertices"], &joined["components"]), (&4.into(), &1.into()));
    // A plan keeps it for those who bake its parts.
    let (plan, part, merged) = (at("torn.plan"), at("1.part"), at("merged.fan"));
    let plan_options = ["--source=solid=wood", "--texels=4k", "--weld=1e-6"];
    let [source, texels, weld] = &plan_options;
    succeeds(&[&"plan", &model, &"-o", &plan, source, texels, weld]);
    succeeds(&[&"bake", &plan, &"--shard", &"1/1", &"-o", &part]);
    succeeds(&[&"merge", &plan, &part, &"-o", &merged]);
    assert_eq!(std::fs::read(&merged).unwrap(), std::fs::read(&asset).unwrap());
    fails(2, &["above zero"], &[&"info", &model, &"--weld", &"0"]);
    fails(2, &["--weld"], &[&"info", &asset, weld]);
    let again = at("again.fan");
    let words = ["--weld is for models", "torn.fan"];
    fails(2, &words, &[&"bake", &asset, &"-o", &again, source, texels, weld]);
}

/// A box of twelve triangles has eight fans, each of which goes around a corner.
#[test]
fn large_triangles_are_cut_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let asset = folder.path().join("cube.fan");
    let share = |edge: &str| {
        let info = json(&[&"info", &model, &"--texels=1M", &"--longest-edge", &edge]);
        assert_eq!(info["triangles"], 12);
        info["worst_share"].as_f64().unwrap()
    };
    assert!(share("0") < 0.65 && share("64") > 0.8 && share("32") > 0.9);
    for (edge, triangles) in [("0", 12..13), ("64", 500..2000)] {
        let bake: [&dyn AsRef<OsStr>; 10] = [
            &"bake",
            &model,
            &"-o",
            &asset,
            &"--source=solid=wood",
            &"--texels=1M",
            &"--longest-edge",
            &edge,
            &"--force",
            &"--format=bc1",
        ];
        succeeds(&bake);
        assert!(triangles.contains(&json(&[&"info", &asset])["triangles"].as_u64().unwrap()));
        assert_eq!(json(&[&"verify", &asset])["ok"], true);
    }
}

#[test]
fn density_is_per_world_unit() {
    let folder = tempfile::tempdir().unwrap();
    // Two squares of side 10: 200 square units, at 20 texels per unit 80 000 texels and margins.
    let square = "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nv 20 0 0\nv 20 10 0\nf 1 2 3 4\nf 2 5 6 3\n";
    let model = write(folder.path(), "square.obj", square);
    let info = json(&[&"info", &model, &"--density", &"20", &"--tile", &"1000"]);
    let texels = info["texels"].as_f64().unwrap();
    assert!((80_000.0..100_000.0).contains(&texels), "{texels}");
}

#[test]
fn a_landscape_goes_all_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let made =
        json(&[&"generate", &"landscape", &"-o", &path("land.ply"), &"--triangles", &"10k", &"--seed", &"3"]);
    assert_keys(&made, &["triangles", "genus", "components"]);
    let triangles = made["triangles"].as_f64().unwrap();
    assert!((9e3..1.1e4).contains(&triangles), "{triangles}");

    let baked = json(&[
        &"bake",
        &path("land.ply"),
        &"-o",
        &path("land.fan"),
        &"--source",
        &"solid=landscape",
        &"--texels",
        &"1M",
    ]);
    assert_keys(
        &baked,
        &[
            "texels",
            "bytes",
            "seconds.cover",
            "seconds.bake",
            "seconds.encode",
            "seconds.write",
            "peak_memory_bytes",
            "channels",
        ],
    );
    assert_eq!(baked["bytes"].as_u64().unwrap(), std::fs::metadata(path("land.fan")).unwrap().len());

    let verified = json(&[&"verify", &path("land.fan")]);
    assert_eq!(verified["ok"], true);
    assert_eq!(verified["damaged_tiles"], 0);
    assert_keys(
        &verified,
        &["continuity.edges", "continuity.levels", "continuity.samples", "continuity.exempt_edges"],
    );
    assert!(verified["continuity"]["largest_jump"].as_f64().unwrap() < 1e-4);
    assert!(verified["continuity"]["edges"].as_u64().unwrap() > 10_000);

    let info = json(&[&"info", &path("land.fan")]);
    assert_eq!(info["triangles"], made["triangles"]);
    assert_eq!(info["bytes"], baked["bytes"]);

    let rendered = json(&[&"render", &path("land.fan"), &"-o", &path("land.png"), &"--size", &"320x240"]);
    assert_keys(&rendered, &["seconds", "triangles", "lookups"]);
    assert!(rendered["lookups"].as_u64().unwrap() > 10_000);

    // The same seed gives the same file.
    succeeds(&[
        &"generate",
        &"landscape",
        &"-o",
        &path("again.ply"),
        &"--triangles",
        &"10k",
        &"--seed",
        &"3",
    ]);
    assert!(std::fs::read(path("land.ply")).unwrap() == std::fs::read(path("again.ply")).unwrap());
}

/// Of a cube the twelve edges, and no others; in parts the same bytes.
#[test]
fn hard_edges_are_cut_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let model = write(folder.path(), "cube.obj", CUBE_OBJ);
    let options: [&dyn AsRef<OsStr>; 8] =
        [&"--source", &"solid=marble", &"--texels", &"60k", &"--longest-edge", &"0", &"--hard-edges", &"60"];
    let command = |name: &str, output: &Path| {
        let words: [&dyn AsRef<OsStr>; 4] = [&name, &model, &"-o", &output];
        succeeds(&[&words[..], &options].concat());
    };
    let asset = path("cube.fan");
    command("bake", &asset);
    assert_eq!(json(&[&"info", &asset])["hard_edges"], 60.0);
    let text = |command: &str| String::from_utf8(succeeds(&[&command, &asset]).stdout).unwrap();
    assert!(text("info").contains("cut from 60 degrees on"));
    let continuity = &json(&[&"verify", &asset])["continuity"];
    assert_eq!((&continuity["hard_edges"], &continuity["edges"]), (&12.into(), &6.into()));
    let jump = continuity["largest_hard_jump"].as_f64().unwrap();
    assert!(jump > 0.0 && jump < 0.5, "{jump}");
    let verified = text("verify");
    let line = |label: &str| verified.lines().find(|line| line.contains(label)).unwrap().to_owned();
    assert!(line("hard edges, as asked").ends_with(" 12") && line("largest jump there").contains("no bound"));

    let plan = path("cube.plan");
    command("plan", &plan);
    let parts = [path("1.part"), path("2.part")];
    for (part, shard) in parts.iter().zip(["1/2", "2/2"]) {
        succeeds(&[&"bake", &plan, &"--shard", &shard, &"-o", part]);
    }
    let merged = path("merged.fan");
    succeeds(&[&"merge", &plan, &parts[1], &parts[0], &"-o", &merged]);
    assert!(std::fs::read(merged).unwrap() == std::fs::read(asset).unwrap());
}

#[test]
fn a_landscape_becomes_an_asset_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("land.fan");
    let command: [&dyn AsRef<OsStr>; 7] =
        [&"generate", &"landscape", &"-o", &asset, &"--triangles", &"5k", &"--texels"];
    let baked = json(&[&command[..], &[&"300k", &"--format", &"bc1"]].concat());
    assert_keys(
        &baked,
        &[
            "texels",
            "bytes",
            "seconds.bake",
            "peak_memory_bytes",
            "channels",
            "triangles",
            "genus",
            "components",
        ],
    );
    let texels = baked["texels"].as_u64().unwrap();
    assert!(texels.abs_diff(300_000) < 6_000, "{texels}");
    assert_eq!(json(&[&"verify", &asset])["ok"], true);

    let model = folder.path().join("land.ply");
    let command: [&dyn AsRef<OsStr>; 6] = [&"generate", &"landscape", &"-o", &model, &"--texels", &"1M"];
    fails(2, &["--texels", ".fan"], &command);
    assert_eq!(files(folder.path()), ["land.fan"]);
    // There is none with so few triangles, which is said.
    let coarse = succeeds(&[&"generate", &"landscape", &"-o", &model, &"--triangles", &"10"]);
    let said = crate::stderr(&coarse);
    assert!(said.contains("triangles instead of the 10 asked for"), "{said}");
}

#[test]
fn the_bottle_looks_like_its_original() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("bottle.fan");
    let baked = json(&[&"bake", &bottle(), &"-o", &asset]);
    let channels: Vec<_> =
        baked["channels"].as_array().unwrap().iter().map(|c| c.as_str().unwrap()).collect();
    assert_eq!(channels, ["BaseColor", "Normal", "OcclusionRoughnessMetallic", "Emission"]);
    let pictures = folder.path().join("views");
    let compared =
        json(&[&"compare", &bottle(), &asset, &"--views", &"3", &"--size", &"320x240", &"-o", &pictures]);
    assert_keys(&compared, &["psnr_db.mean", "psnr_db.min", "ssim", "flip", "views"]);
    // The background, which is equal in both, counts in the whole pictures alone: with a share s of the pixels, -10 log10(s) dB more.
    assert_keys(&compared, &["model_share", "whole_psnr_db.mean", "whole_psnr_db.min"]);
    for view in compared["per_view"].as_array().unwrap() {
        let number = |key: &str| view[key].as_f64().unwrap();
        let share = number("model_share");
        assert!((0.05..0.95).contains(&share), "{view:#}");
        let gain = number("whole_psnr_db") - number("psnr_db");
        assert!((gain + 10.0 * share.log10()).abs() < 1e-3, "{view:#}");
    }
    assert!(compared["psnr_db"]["mean"].as_f64().unwrap() > 38.0, "{compared:#}");
    assert_eq!(files(&pictures).len(), 9);

    // Equal pictures have no finite ratio.
    let same = json(&[&"compare", &bottle(), &bottle(), &"--views", &"1", &"--size", &"64x64"]);
    assert_eq!(same["psnr_db"]["mean"], Value::Null);
    assert_eq!(same["flip"], 0.0);
}

#[test]
fn views_that_show_nothing_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    // Of three cameras the second one sees a level plate edge-on.
    let properties = "property float x\nproperty float y\nproperty float z
property uchar red\nproperty uchar green\nproperty uchar blue";
    let plate = |name: &str, red: u32| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 4\n{properties}
element face 2\nproperty list uchar int vertex_indices\nend_header
-1 0 -1 {red} 40 40\n1 0 -1 40 {red} 40\n1 0 1 40 40 {red}\n-1 0 1 90 90 90\n3 0 1 2\n3 0 2 3\n"
        );
        write(folder.path(), name, text)
    };
    let [a, b] = [plate("a.ply", 200), plate("b.ply", 180)];
    let arguments: [&dyn AsRef<OsStr>; 7] = [&"compare", &a, &b, &"--views", &"3", &"--size", &"64x48"];
    let compared = json(&arguments);
    let view = |number: usize, key: &str| compared["per_view"][number][key].as_f64();
    assert_eq!((view(1, "psnr_db"), view(1, "model_share")), (None, Some(0.0)));
    for (key, found) in [
        ("psnr_db", &compared["psnr_db"]["mean"]),
        ("whole_psnr_db", &compared["whole_psnr_db"]["mean"]),
        ("ssim", &compared["ssim"]),
        ("flip", &compared["flip"]),
        ("model_share", &compared["model_share"]),
    ] {
        let mean = (view(0, key).unwrap() + view(2, key).unwrap()) / 2.0;
        assert!((found.as_f64().unwrap() - mean).abs() < 1e-9, "{key}: {compared:#}");
    }
    assert_eq!((&compared["views"], &compared["empty_views"]), (&3.into(), &1.into()));
    let said = String::from_utf8(succeeds(&arguments).stdout).unwrap();
    assert!(said.contains("1 of 3 views left out"), "{said}");
    fails(1, &["nothing to compare"], &[&"compare", &a, &b, &"--views", &"1", &"--size", &"64x48"]);
}

#[test]
fn any_number_of_threads_bakes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |threads: &str| {
        let asset = folder.path().join(format!("{threads}.fan"));
        succeeds(&[
            &"bake",
            &bottle(),
            &"-o",
            &asset,
            &"--source",
            &"solid=wood",
            &"--texels",
            &"300k",
            &"--threads",
            &threads,
        ]);
        std::fs::read(asset).unwrap()
    };
    assert!(bake("1") == bake("3"));
}

#[test]
fn factors_of_textures_that_are_not_baked_do_not_cover_the_source() {
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("wood.fan");
    let material = |source: &str| {
        succeeds(&[&"bake", &bottle(), &"-o", &asset, &"--source", &source, &"--texels", &"20k", &"--force"]);
        fantex::store::Asset::open(&asset).unwrap().mesh().materials[0].clone()
    };
    // The bottle's factors scale textures: white light, all metal.
    assert_eq!((material("uv").emission.x, material("uv").metallic), (1.0, 1.0));
    let material = material("solid=wood");
    assert_eq!((material.emission.x, material.metallic, material.roughness), (0.0, 0.0, 0.9));
}

#[test]
fn every_source_bakes_and_passes() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let image = workspace().join("assets/WaterBottle/WaterBottle_emissive.png");
    let mut sources = vec!["vertex".to_owned()];
    sources.extend(["wood", "marble", "rock", "landscape"].map(|name| format!("solid={name}")));
    sources.extend(
        ["planar", "box", "cylinder", "sphere", "triplanar"]
            .map(|mapping| format!("image={},mapping={mapping}", image.display())),
    );
    let asset = folder.path().join("out.fan");
    let formats = ["bc7", "bc1", "rgba8", "float"];
    for (source, format) in sources.iter().zip(formats.iter().cycle()) {
        let arguments: [&dyn AsRef<OsStr>; 11] = [
            &"bake",
            &model,
            &"-o",
            &asset,
            &"--source",
            source,
            &"--texels",
            &"16k",
            &"--format",
            format,
            &"--force",
        ];
        succeeds(&arguments);
        let verified = json(&[&"verify", &asset]);
        assert_eq!(verified["ok"], true, "{source} as {format}: {verified:#}");
    }
}

#[test]
fn pictures_of_the_cover_are_drawn_for_models_and_assets() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("colored.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"16k"]);
    let pictures = folder.path().join("pictures/");
    let info = json(&[&"info", &model, &"--texels", &"16k", &"--picture", &pictures]);
    assert_eq!(info["pictures"].as_array().unwrap().len(), 3);
    json(&[&"info", &asset, &"--picture", &folder.path().join("pictures/asset")]);
    assert_eq!(
        files(&pictures),
        [
            "asset-cover.png",
            "asset-directions.png",
            "asset-tiles.png",
            "cover.png",
            "directions.png",
            "tiles.png"
        ]
    );
}

#[test]
fn fidelity_is_measured() {
    let figures = json(&[&"bench", &"fidelity", &bottle(), &"--texels", &"1M", &"--wavelength", &"16"]);
    assert_keys(&figures, &["psnr_db", "density_share", "lookups_per_sample", "texels"]);
    assert!(figures["psnr_db"].as_f64().unwrap() > 40.0, "{figures:#}");
    // Point samples of the same function are worse.
    let point = json(&[&"bench", &"fidelity", &bottle(), &"--texels", &"1M", &"--fit", &"point"]);
    assert!(point["psnr_db"].as_f64().unwrap() < figures["psnr_db"].as_f64().unwrap() - 3.0);
}

#[test]
fn messages_and_results_do_not_mix() {
    let noisy = succeeds(&[&"info", &bottle(), &"--json"]);
    serde_json::from_slice::<Value>(&noisy.stdout).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("out.png");
    let quiet = succeeds(&[&"render", &bottle(), &"-o", &picture, &"--size", &"32x32", &"--quiet"]);
    assert!(quiet.stderr.is_empty());
}

#[test]
fn another_model_gives_its_colours_and_its_shape() {
    let folder = tempfile::tempdir().unwrap();
    // A coarse cube takes over the corners' colours of a finer, slightly larger one.
    let coarse = write(folder.path(), "coarse.obj", crate::CUBE_OBJ);
    let mut fine = String::new();
    let corners = [-1.02_f32, 1.02];
    for z in corners {
        for y in corners {
            for x in corners {
                let channel = |v: f32| if v > 0.0 { 255 } else { 0 };
                fine += &format!("{x} {y} {z} {} {} {}\n", channel(x), channel(y), channel(z));
            }
        }
    }
    let header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 6\nproperty list uchar int vertex_indices\n\
        end_header\n";
    let faces = "4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n";
    let fine = write(folder.path(), "fine.ply", format!("{header}{fine}{faces}"));
    let asset = folder.path().join("coarse.fan");
    let source = format!("mesh={}", fine.display());
    let info = json(&[&"bake", &coarse, &"-o", &asset, &"--source", &source, &"--texels", &"60k"]);
    assert_eq!(info["source"], source);
    let channels: Vec<&str> =
        info["channels"].as_array().unwrap().iter().map(|c| c.as_str().unwrap()).collect();
    assert_eq!(channels, ["Normal", "BaseColor"]);
    assert_eq!(json(&[&"verify", &asset])["ok"], true);
    // The same pictures as of the finer model itself, but for its size.
    let compared = json(&[&"compare", &fine, &asset, &"--views", &"2", &"--size", &"160x120"]);
    assert!(compared["psnr_db"]["mean"].as_f64().unwrap() > 22.5, "{compared:#}");
    // A cage that is too short is told.
    let source = format!("mesh={},cage=0.001", fine.display());
    let output =
        succeeds(&[&"bake", &coarse, &"-o", &asset, &"--force", &"--source", &source, &"--texels", &"10k"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("found nothing within the cage of 0.0010"));
    fails(2, &["length above 0"], &[&"bake", &coarse, &"-o", &asset, &"--source", &"mesh=a.ply,cage=0"]);
    fails(
        1,
        &["cannot read", "missing.ply"],
        &[&"bake", &coarse, &"-o", &asset, &"--force", &"--source", &"mesh=missing.ply"],
    );
}

/// Files in `meshes/` that must be refused, with a word of the reason.
const REFUSED: [(&str, &str); 0] = [];

#[test]
fn every_model_is_described_or_refused_with_a_reason() {
    let Some(data) = data() else { return };
    let mut count = 0;
    for path in models(&data.join("meshes")).into_iter().chain(models(&data.join("landscapes"))) {
        // Covered as they are; bakes cut them at bends.
        let output = run(&[&"info", &path, &"--json", &"--texels", &"1M", &"--longest-edge", &"0"]);
        let errors = stderr(&output);
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        match REFUSED.iter().find(|(refused, _)| *refused == name) {
            Some((_, reason)) => {
                assert_eq!(output.status.code(), Some(1), "{name}: {errors}");
                assert!(errors.contains(reason) && errors.lines().count() == 1, "{name}: {errors}");
            }
            None => {
                assert_eq!(output.status.code(), Some(0), "{name}: {errors}");
                let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
                let count = |key: &str| info[key].as_u64().unwrap();
                assert!(count("triangles") > 0, "{name}");
                let laid_flat = count("fans_projected") + count("fans_unfolded");
                assert!(laid_flat + 2 * count("fans_split") >= count("fans"), "{name}: {info:#}");
            }
        }
        count += 1;
    }
    assert!(count >= 20, "only {count} models in {}", data.display());
}

#[test]
fn every_model_bakes_without_a_jump() {
    let Some(data) = data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = folder.path().join("out.fan");
    for path in models(&data.join("meshes")) {
        succeeds(&[
            &"bake",
            &path,
            &"-o",
            &asset,
            &"--source",
            &"solid=marble",
            &"--texels",
            &"300k",
            &"--force",
            &"--quiet",
        ]);
        let verified = json(&[&"verify", &asset]);
        assert_eq!(verified["ok"], true, "{}: {verified:#}", path.display());
    }
}

/// All model files below a folder, sorted.
fn models(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if path.is_dir() {
            found.extend(models(&path));
        } else if matches!(extension.as_deref(), Some("gltf" | "glb" | "obj" | "ply" | "stl")) {
            found.push(path);
        }
    }
    found
}

/// A bake in parts, from another folder, is what one process writes.
#[test]
fn parts_of_a_plan_are_merged() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (model, seed, texels) = (bottle(), "--seed=7", "--texels=100k");
    succeeds(&[&seed, &"bake", &model, &"-o", &at("whole.fan"), &texels]);
    let info = json(&[&seed, &"plan", &model, &"-o", &at("bottle.plan"), &texels]);
    assert_keys(&info, &["output", "triangles", "groups", "texels", "bytes", "channels"]);
    let part = |number: u32| {
        let (shard, path) = (format!("{number}/3"), at(&format!("{number}.part")));
        json(&[&"--threads", &"1", &"bake", &at("bottle.plan"), &"--shard", &shard, &"-o", &path]);
        path
    };
    let parts = [3, 1, 2].map(part);
    let [c, a, b] = [&parts[0], &parts[1], &parts[2]];
    let plan = at("bottle.plan");
    // What is told is the path that was given.
    let mut here = fantex();
    here.current_dir(folder.path()).args(["bake", "bottle.plan", "--shard=2/3", "-o", "b.part", "--json"]);
    let told: Value = serde_json::from_slice(&here.output().unwrap().stdout).unwrap();
    assert_eq!(told["output"], "b.part");
    assert!(std::fs::read(at("b.part")).unwrap() == std::fs::read(b).unwrap());
    let checked = json(&[&"merge", &plan, a, b, c, &"--check"]);
    assert_eq!((checked["parts"].as_u64(), checked["output"].is_null()), (Some(3), true));
    let merged = at("merged.fan");
    fails(1, &["is missing (shard 2/3)"], &[&"merge", &plan, a, c, &"-o", &merged]);
    json(&[&"merge", &plan, c, a, b, &"-o", &merged]);
    assert!(std::fs::read(&merged).unwrap() == std::fs::read(at("whole.fan")).unwrap());
    fails(1, &["exists"], &[&"merge", &plan, c, a, b, &"-o", &merged]);
    fails(2, &["expected I/N"], &[&"bake", &plan, &"--shard", &"4/3", &"-o", &at("x")]);
    fails(2, &["cannot be used with"], &[&"bake", &plan, &"--shard=1/3", &"--texels=9", &"-o", &at("x")]);
    fails(1, &["is a plan, which has no texels"], &[&"render", &plan, &"-o", &at("x.png")]);
    fails(1, &["is a plan, which has no texels"], &[&"bake", &plan, &"-o", &at("x")]);
    fails(1, &["1.part is a part of a planned bake"], &[&"info", &at("1.part")]);
    fails(1, &["is an asset, and no plan"], &[&"bake", &merged, &"--shard=1/3", &"-o", &at("x")]);
    fails(1, &["is a part of a planned bake", "the plan first"], &[&"merge", a, b, c, &"--check"]);
    fails(1, &["have the same tiles"], &[&"merge", &plan, a, a, b, c, &"--check"]);
    let other = at("other.plan");
    json(&[&"plan", &model, &"-o", &other, &"--texels=50k"]);
    fails(1, &["belongs to another plan"], &[&"merge", &other, a, b, c, &"-o", &at("x")]);
    let changed = write(folder.path(), "colored.ply", COLORED_PLY);
    json(&[&"plan", &changed, &"-o", &at("colored.plan"), &"--texels=4k"]);
    write(folder.path(), "colored.ply", COLORED_PLY.replace("0 1 0 0 0 255", "0 3 0 0 0 255"));
    fails(1, &["plan anew"], &[&"bake", &at("colored.plan"), &"--shard=1/1", &"-o", &at("x")]);
    fails(1, &["is no part of a bake"], &[&"merge", &plan, &merged, &"--check"]);
}

/// Parts are baked of what was planned, and merged with no others: the texels of an asset have one source.
#[test]
fn parts_of_other_looks_and_sources_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let (texels, plan, out) = ("--texels=4k", at("a.plan"), at("out.fan"));
    let bake = |shard: &str, part: &str| succeeds(&[&"bake", &plan, &"--shard", &shard, &"-o", &at(part)]);
    // The same tiles and channels of another source.
    succeeds(&[&"plan", &model, &"--source=solid=wood", &texels, &"-o", &plan]);
    bake("1/2", "1.part");
    succeeds(&[&"plan", &model, &"--source=solid=marble", &texels, &"-o", &plan, &"--force"]);
    bake("2/2", "2.part");
    fails(
        1,
        &["1.part belongs to another plan"],
        &[&"merge", &plan, &at("1.part"), &at("2.part"), &"-o", &out],
    );
    // What is planned again is the same plan.
    succeeds(&[&"--threads=1", &"plan", &model, &"--source=solid=wood", &texels, &"-o", &plan, &"--force"]);
    bake("2/2", "second.part");
    succeeds(&[&"merge", &plan, &at("1.part"), &at("second.part"), &"-o", &out]);
    // A look, and a picture that it names.
    let picture = |name: &str| {
        std::fs::copy(workspace().join("assets/images").join(name), at("a.png")).unwrap();
    };
    let look = |roughness: f32| {
        let text = format!(
            "[textures.grass]\nkind = \"image\"\nimage = \"a.png\"\ncoordinates = \"box\"\n\
             [materials.lawn]\nbase_color = \"grass\"\nroughness = {roughness}\n"
        );
        write(folder.path(), "a.toml", text)
    };
    picture("grass.png");
    let look_path = look(0.5);
    succeeds(&[&"plan", &model, &"--look", &look_path, &texels, &"-o", &plan, &"--force"]);
    bake("1/2", "look.part");
    let refused = |words: &str| {
        fails(1, &[words, "plan anew"], &[&"bake", &plan, &"--shard=2/2", &"-o", &at("x.part")]);
        assert!(!at("x.part").exists());
    };
    look(0.25);
    refused("a.toml is not what");
    look(0.5);
    picture("gravel.png");
    refused("a.png is not what");
    picture("grass.png");
    bake("2/2", "rest.part");
}

/// Programs hear of damage that keeps an asset from being opened, too.
#[test]
fn what_cannot_be_opened_is_not_verified() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = folder.path().join("a.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"20k"]);
    let bytes = std::fs::read(&asset).unwrap();
    std::fs::write(&asset, &bytes[..bytes.len() / 2]).unwrap();
    let output = run(&[&"verify", &"--json", &asset]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["ok"], false);
    assert!(
        said["damaged_tiles"].is_null() && said["damage"][0].as_str().unwrap().contains("a.fan"),
        "{said}"
    );
}

#[test]
fn a_shape_that_keeps_its_triangles_is_told() {
    let folder = tempfile::tempdir().unwrap();
    // A fine ball on a plane that is ten million times as wide.
    let mut model = fantex::mesh::generate::uv_sphere(40, 20);
    let mut text = String::new();
    for p in &mut model.positions {
        text += &format!("v {:.12} {:.12} {:.12}\n", 1e-4 * p.x, 1e-4 * p.y, 1e-4 * p.z);
    }
    let count = model.positions.len();
    text += "v -1000 -1 -1000\nv 1000 -1 -1000\nv 1000 -1 1000\nv -1000 -1 1000\n";
    for [a, b, c] in &model.triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    text += &format!("f {} {} {} {}\n", count + 4, count + 3, count + 2, count + 1);
    let path = write(folder.path(), "mixed.obj", text);
    let coarse = folder.path().join("coarse.obj");
    let told = stderr(&succeeds(&[&"simplify", &path, &"-o", &coarse, &"--triangles", &"100"]));
    assert!(told.contains("triangles are left where 100 were asked for"), "{told}");
    let told = stderr(&succeeds(&[&"simplify", &path, &"-o", &coarse, &"--triangles", &"2k", &"--force"]));
    assert!(!told.contains("asked for"), "{told}");
}
