//! `fantex preview`, and assets as sources for other meshes.

use std::path::Path;

use crate::{COLORED_PLY, fails, json, succeeds, write};

#[test]
fn an_asset_gets_a_preview_and_loses_it() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let (model, asset) = (place("land.ply"), place("land.fan"));
    succeeds(&[&"generate", &"landscape", &"-o", &model, &"--triangles", &"30k"]);
    succeeds(&[&"bake", &model, &"-o", &asset, &"--source", &"solid=landscape", &"--texels", &"500k"]);
    assert!(json(&[&"info", &asset])["preview_bytes"].is_null());
    let before = std::fs::metadata(&asset).unwrap().len();

    #[cfg(target_os = "linux")]
    {
        // A disk without room for more.
        let script =
            format!("ulimit -f {}; exec \"$0\" preview \"$@\" --triangles 2k --texels 20k", before / 1024);
        let mut full = std::process::Command::new("bash");
        full.args(["-c", &script, env!("CARGO_BIN_EXE_fantex")]).arg(&asset);
        let output = full.output().unwrap();
        let errors = crate::stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{errors}");
        assert!(
            errors.contains("land.fan") && errors.trim_end().ends_with("make room, then try again"),
            "{errors}"
        );
        assert_eq!(json(&[&"verify", &asset])["ok"], true);
    }

    let info = json(&[&"preview", &asset, &"--triangles", &"2k", &"--texels", &"20k"]);
    let triangles = info["triangles"].as_u64().unwrap();
    assert!((1500..=2000).contains(&triangles), "{info}");
    assert!(info["texels"].as_u64().unwrap() <= 20_000, "{info}");
    let bytes = info["bytes"].as_u64().unwrap();
    assert!(std::fs::metadata(&asset).unwrap().len() > before);
    assert_eq!(json(&[&"info", &asset])["preview_bytes"].as_u64(), Some(bytes));
    assert_eq!(json(&[&"verify", &asset])["ok"], true);

    // Another takes its place.
    let info = json(&[&"preview", &asset, &"--triangles", &"1k", &"--texels", &"20k"]);
    assert!(info["bytes"].as_u64().unwrap() < bytes, "{info}");
    succeeds(&[&"preview", &asset, &"--remove"]);
    assert!(json(&[&"info", &asset])["preview_bytes"].is_null());
    let said = succeeds(&[&"preview", &asset, &"--remove"]).stdout;
    assert!(String::from_utf8(said).unwrap().contains("no preview"));
    fails(1, &["land.ply is not an asset"], &[&"preview", &model]);
    for remove in [&[][..], &[&"--remove" as &dyn AsRef<std::ffi::OsStr>]] {
        let refused = |words: &[&str], place: &dyn AsRef<std::ffi::OsStr>| {
            fails(1, words, &[&[&"preview" as &dyn AsRef<std::ffi::OsStr>, place], remove].concat());
        };
        refused(&["cannot read", "none.fan"], &place("none.fan"));
        refused(&["https://example.org/a.fan can only be read"], &"https://example.org/a.fan");
    }
    fails(2, &["--remove"], &[&"preview", &asset, &"--remove", &"--triangles", &"1k"]);
}

#[test]
fn previews_of_small_assets_have_a_quarter_of_their_texels_or_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let (model, asset) = (place("land.ply"), place("land.fan"));
    succeeds(&[&"generate", &"landscape", &"-o", &model, &"--triangles", &"20k"]);
    let baked = json(&[&"bake", &model, &"-o", &asset, &"--source", &"solid=wood", &"--texels", &"200k"]);
    let [all, some] = [baked, json(&[&"preview", &asset])].map(|info| info["texels"].as_f64().unwrap());
    assert!((0.2..0.26).contains(&(some / all)), "{some} of {all} texels");

    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let asset = place("colored.fan");
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"64k"]);
    let before = std::fs::read(&asset).unwrap();
    let said = String::from_utf8(succeeds(&[&"preview", &asset]).stdout).unwrap();
    assert!(said.contains("colored.fan: a preview is left out") && said.lines().count() == 1, "{said}");
    assert_eq!(json(&[&"preview", &asset])["texels"], 0);
    assert!(std::fs::read(&asset).unwrap() == before);
    let made = json(&[&"preview", &asset, &"--triangles", &"5k"]);
    assert!((1..=17_000).contains(&made["texels"].as_u64().unwrap()), "{made}");
    let made = json(&[&"preview", &asset, &"--texels", &"100k"]);
    assert!(made["texels"].as_u64().unwrap() > 90_000, "{made}");
}

#[test]
fn what_changes_an_asset_as_a_whole_changes_its_preview() {
    let folder = tempfile::tempdir().unwrap();
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    let [asset, copy] = ["a.fan", "b.fan"].map(|name| folder.path().join(name));
    succeeds(&[&"bake", &model, &"-o", &asset, &"--texels", &"64k"]);
    succeeds(&[&"paint", &asset, &"--add-channel", &"emission"]);
    succeeds(&[&"preview", &asset, &"--triangles", &"4", &"--texels", &"4k"]);
    succeeds(&[&"paint", &asset, &"--alpha", &"cut-out", &"-o", &copy]);
    succeeds(&[&"paint", &asset, &"--alpha", &"blend"]);
    succeeds(&[&"paint", &asset, &"--remove-channel", &"emission"]);
    for asset in [&asset, &copy] {
        assert!(json(&[&"info", asset])["preview_bytes"].is_u64());
        assert_eq!(json(&[&"verify", asset])["ok"], true);
    }
}

#[test]
fn an_asset_is_baked_onto_another_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let model = write(folder.path(), "colored.ply", COLORED_PLY);
    succeeds(&[&"bake", &model, &"-o", &place("a.fan"), &"--texels", &"64k"]);
    let source = format!("mesh={},cage=0.1", place("a.fan").display());
    let info = json(&[&"bake", &model, &"-o", &place("b.fan"), &"--texels", &"64k", &"--source", &source]);
    assert_eq!(info["channels"], serde_json::json!(["Normal", "BaseColor"]), "{info}");
    let compared =
        json(&[&"compare", &place("a.fan"), &place("b.fan"), &"--views", &"2", &"--size", &"160x120"]);
    // Light jumps at the creases of the first, and not on the second, whose normals have none. Measured 35.5 dB.
    assert!(compared["psnr_db"]["min"].as_f64().unwrap() > 33.0, "{compared}");
}

#[test]
fn a_scan_is_baked_onto_fewer_triangles() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let fine = place("land.ply");
    succeeds(&[&"generate", &"landscape", &"-o", &fine, &"--triangles", &"30k"]);
    let info = json(&[&"simplify", &fine, &"-o", &place("coarse.glb"), &"--triangles", &"3k"]);
    let [before, after] = ["triangles_before", "triangles"].map(|key| info[key].as_u64().unwrap());
    assert!(before > 25_000 && (2500..=3000).contains(&after), "{info}");
    assert_eq!(json(&[&"info", &place("coarse.glb")])["triangles"].as_u64(), Some(after));
    let source = format!("mesh={}", fine.display());
    succeeds(&[
        &"bake",
        &place("coarse.glb"),
        &"-o",
        &place("coarse.fan"),
        &"--source",
        &source,
        &"--texels",
        &"500k",
    ]);
    // The normals of the fine model are nearer to it than those of the coarse one.
    let psnr = |file: &str| {
        let file = place(file);
        json(&[&"compare", &fine, &file, &"--views", &"2", &"--size", &"320x240"])["psnr_db"]["mean"]
            .as_f64()
            .unwrap()
    };
    let [plain, baked] = ["coarse.glb", "coarse.fan"].map(psnr);
    assert!(baked > plain + 1.0, "{baked} dB with normals, {plain} without");
    fails(1, &["exists already"], &[&"simplify", &fine, &"-o", &place("coarse.glb"), &"--triangles", &"3k"]);
    fails(
        2,
        &["coarse.stl names no format", ".ply, .obj or .glb"],
        &[&"simplify", &fine, &"-o", &place("coarse.stl"), &"--triangles", &"3k"],
    );
}

#[test]
fn the_mesh_of_an_asset_is_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let fine = place("land.ply");
    succeeds(&[&"generate", &"landscape", &"-o", &fine, &"--triangles", &"20k"]);
    let scan = place("scan.fan");
    let bake = |model: &Path, out: &str, source: &str, texels: &str| {
        json(&[&"bake", &model, &"-o", &place(out), &"--source", &source, &"--texels", &texels])
    };
    bake(&fine, "scan.fan", "solid=marble", "400k");
    // Coarser, as the model would be.
    let info = json(&[&"simplify", &scan, &"-o", &place("coarse.ply"), &"--triangles", &"2k"]);
    assert!((1500..=2000).contains(&info["triangles"].as_u64().unwrap()), "{info}");
    // Something else on its mesh, and what it holds at another density.
    bake(&scan, "wood.fan", "solid=wood", "50k");
    bake(&scan, "small.fan", &format!("mesh={}", scan.display()), "100k");
    let triangles = |file: &Path| json(&[&"info", &file])["triangles"].as_u64();
    assert_eq!(triangles(&place("small.fan")), triangles(&scan));
    let psnr = |file: &str| {
        let info = json(&[&"compare", &scan, &place(file), &"--views", &"2", &"--size", &"160x120"]);
        info["psnr_db"]["min"].as_f64().unwrap()
    };
    let [same, other] = ["small.fan", "wood.fan"].map(psnr);
    assert!(same > 35.0 && other < 30.0, "{same} and {other} dB");
    fails(1, &["already baked", "--source mesh="], &[&"bake", &scan, &"-o", &place("no.fan")]);
    fails(1, &["scan.fan"], &[&"bake", &scan, &"-o", &scan, &"--source", &"solid=wood", &"--force"]);
}
