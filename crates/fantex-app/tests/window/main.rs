//! The viewer in a real window on a virtual display, driven by sessions: what is asked for is shown, whatever is opened, and the
//! program always ends as it should.

#![expect(clippy::unwrap_used, reason = "tests may unwrap, in their helpers too")]

#[cfg(target_os = "linux")]
mod clipboard;
mod display;
#[cfg(target_os = "linux")]
mod mouse;
mod painting;
#[cfg(target_os = "linux")]
mod pen;

use std::path::{Path, PathBuf};
use std::process::Output;

use display::Display;
use fantex::bake::{BakeOptions, NoProgress, SineSource, bake};
use fantex::cover::{CoverOptions, TexelBudget, build_cover};
use fantex::mesh::generate::torus;
use fantex::mesh::{CleanOptions, WriteGeometry, clean, write_model};
use fantex::store::Asset;
use fantex::texture::{Image, Samples};

/// A model without any texture.
fn save_model(folder: &Path) -> PathBuf {
    let path = folder.join("torus.ply");
    let model = torus(64, 32);
    let geometry = WriteGeometry { positions: &model.positions, triangles: &model.triangles, colors: None };
    write_model(&path, &geometry, false).unwrap();
    path
}

fn save_asset(folder: &Path) -> PathBuf {
    save_asset_of(folder, 600_000)
}

fn save_asset_of(folder: &Path, texels: u64) -> PathBuf {
    let path = folder.join("torus.fan");
    let (mesh, _) = clean(torus(64, 32), &CleanOptions::default()).unwrap();
    let options = CoverOptions { budget: TexelBudget::Total(texels), ..CoverOptions::default() };
    let (cover, _) = build_cover(&mesh, &options).unwrap();
    bake(&mesh, &cover, &SineSource { k: 20.0 }, &path, &BakeOptions::default(), &NoProgress).unwrap();
    path
}

/// The asset with a wrong byte in every stored cluster.
fn save_damaged(folder: &Path, whole: &Path) -> PathBuf {
    let asset = Asset::open(whole).unwrap();
    let mut bytes = std::fs::read(whole).unwrap();
    for range in (0..asset.level_count()).flat_map(|level| asset.cluster_ranges(level)) {
        bytes[(range.start + (range.end - range.start) / 2) as usize] ^= 0x55;
    }
    let path = folder.join("damaged.fan");
    std::fs::write(&path, bytes).unwrap();
    path
}

#[track_caller]
fn check_success(output: &Output) {
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {told}", output.status);
    assert!(!told.contains("panicked"), "{told}");
}

/// RGB of a saved picture.
fn picture(path: &Path) -> (u32, u32, Vec<u8>) {
    let image = Image::load(path).unwrap();
    let Samples::U8(samples) = image.samples else { panic!("not a picture of bytes") };
    assert_eq!(image.channels, 3);
    (image.width, image.height, samples)
}

/// Share of the pixels that are not alike in two pictures.
fn difference(folder: &Path, a: &str, b: &str) -> f64 {
    let [(width, height, a), (_, _, b)] = [a, b].map(|name| picture(&folder.join(name)));
    assert_eq!(a.len(), b.len());
    let differs = |(p, q): (&[u8], &[u8])| p.iter().zip(q).any(|(x, y)| x.abs_diff(*y) > 12);
    let count = a.chunks(3).zip(b.chunks(3)).filter(|&pair| differs(pair)).count();
    count as f64 / f64::from(width * height)
}

/// Number of different colours.
fn colors(folder: &Path, name: &str) -> usize {
    let (_, _, samples) = picture(&folder.join(name));
    let mut all: Vec<&[u8]> = samples.chunks(3).collect();
    all.sort_unstable();
    all.dedup();
    all.len()
}

#[test]
fn assets_stream_and_overlays_show() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r#"{"wait_loaded":120},{"wait_sharp":120},
        {"screenshot":{"path":"lit.png"}},{"screenshot":{"path":"large.png","size":[1600,900]}},
        {"overlay":"groups"},{"wait_sharp":60},{"screenshot":{"path":"groups.png"}},
        {"overlay":"levels"},{"wait_sharp":60},{"screenshot":{"path":"levels.png"}},
        {"overlay":"none"},{"key":"M"},{"key":"G"},{"tab":"streaming"},{"wait_frames":5},{"wait_sharp":60},
        {"window_screenshot":{"path":"window.png"}},
        {"key":"F1"},{"wait_frames":3},{"window_screenshot":{"path":"help.png"}},"quit""#;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy()], steps));
    let at = folder.path();
    assert!(colors(at, "lit.png") > 60, "the picture is not blank");
    assert!(difference(at, "lit.png", "groups.png") > 0.05);
    assert!(difference(at, "groups.png", "levels.png") > 0.05);
    assert_eq!(picture(&at.join("large.png")).0, 1600);
    assert_eq!(picture(&at.join("window.png")).0, 1000);
    assert!(difference(at, "window.png", "help.png") > 0.1, "the help sheet is shown");
}

#[test]
fn models_without_texture_are_seen_from_all_cameras() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = save_model(folder.path());
    let settings = folder.path().join("settings.json");
    std::fs::write(&settings, "{ this is no JSON").unwrap();
    // By the usual settings, with shadows and several samples.
    let steps = r#"{"expect_message":"set aside"},{"wait_loaded":60},{"key":"Z"},{"wait_sharp":60},"quit""#;
    let arguments = [model.to_string_lossy(), "--settings".into(), settings.to_string_lossy()];
    check_success(&display.run(folder.path(), &arguments.each_ref().map(|a| a.as_ref()), steps));
    let kept = std::fs::read_to_string(&settings).unwrap();
    assert!(kept.contains("torus.ply") && kept.contains("\"has_wireframe\": true"), "{kept}");

    let steps = r#"{"wait_loaded":60},{"wait_sharp":60},{"screenshot":{"path":"a.png"}},
        {"drag":{"x":0.3,"y":0.1}},{"wait_frames":20},{"wait_sharp":60},{"screenshot":{"path":"orbit.png"}},
        {"drag":{"x":0.4,"y":-0.2,"with":["Ctrl"]}},{"wait_frames":20},{"wait_sharp":60},{"screenshot":{"path":"sun.png"}},
        {"key":"2"},{"hold":{"keys":["W"],"frames":12}},{"wait_frames":20},{"wait_sharp":60},{"screenshot":{"path":"fly.png"}},
        {"mode":"walk"},{"wait_frames":20},{"mode":"orbit"},{"view":"front"},{"wait_sharp":60},{"screenshot":{"path":"front.png"}},
        {"key":"Z"},{"wait_sharp":60},{"screenshot":{"path":"wire.png"}},"quit""#;
    check_success(&display.run(folder.path(), &[&model.to_string_lossy()], steps));
    let at = folder.path();
    assert!(colors(at, "a.png") > 100);
    for (before, after) in [
        ("a.png", "orbit.png"),
        ("orbit.png", "sun.png"),
        ("sun.png", "fly.png"),
        ("fly.png", "front.png"),
        ("front.png", "wire.png"),
    ] {
        assert!(difference(at, before, after) > 0.01, "{before} and {after}");
    }
}

#[test]
fn damage_and_odd_windows_are_survived() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let whole = save_asset(folder.path());
    let damaged = save_damaged(folder.path(), &whole);
    let cut = folder.path().join("cut.fan");
    std::fs::write(&cut, &std::fs::read(&whole).unwrap()[..5000]).unwrap();
    let steps = r#"{"wait_loaded":60},{"wait_sharp":60},{"tab":"streaming"},{"wait_frames":3},
        {"screenshot":{"path":"means.png"}},{"window_screenshot":{"path":"damage.png"}},
        {"open":"cut.fan"},{"wait_loaded":60},{"expect_message":"cut.fan"},
        {"open":"none.glb"},{"wait_loaded":60},{"expect_message":"none.glb"},
        {"open":"torus.fan"},{"wait_loaded":60},{"pool":1},{"resize":[0,0]},{"wait_frames":10},{"resize":[700,500]},
        {"minimize":true},{"wait_frames":10},{"minimize":false},{"wait_frames":10},
        {"resize":[1000,700]},{"wait_frames":10},{"wait_sharp":60},{"screenshot":{"path":"after.png"}},"quit""#;
    check_success(&display.run(folder.path(), &[&damaged.to_string_lossy()], steps));
    assert!(colors(folder.path(), "means.png") > 30, "groups show their mean colours");
    assert!(colors(folder.path(), "after.png") > 60);
}

/// What the command line names and cannot be opened ends the program with one sentence.
#[test]
fn missing_and_broken_files_on_the_command_line_are_failures() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let whole = save_asset(folder.path());
    std::fs::write(folder.path().join("cut.fan"), &std::fs::read(&whole).unwrap()[..5000]).unwrap();
    std::fs::write(folder.path().join("text.obj"), "no model at all").unwrap();
    std::fs::write(folder.path().join("a.txt"), "").unwrap();
    for name in ["none.glb", "none.fan", "cut.fan", "text.obj", "a.txt", "."] {
        for arguments in [&[name][..], &["--paint", name]] {
            let output = display.run(folder.path(), arguments, r#"{"wait_frames":100000}"#);
            let told = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{name}: {told}");
            assert!(told.starts_with("fantex-app: ") && told.lines().count() == 1, "{name}: {told}");
            assert!(name == "." || told.contains(name), "{name}: {told}");
        }
    }
}

/// Share of the pixels that are not alike in two columns' range of two pictures of the window, and of its rows in the middle.
fn difference_between(folder: &Path, a: &str, b: &str, columns: [f64; 2]) -> f64 {
    let [(width, height, a), (_, _, b)] = [a, b].map(|name| picture(&folder.join(name)));
    let within = |n: u32, share: f64| (f64::from(n) * share) as usize;
    let (mut differ, mut count) = (0.0, 0.0);
    for y in within(height, 0.25)..within(height, 0.8) {
        for x in within(width, columns[0])..within(width, columns[1]) {
            let [p, q] = [&a, &b].map(|samples| &samples[3 * (y * width as usize + x)..][..3]);
            differ += f64::from(u8::from(p.iter().zip(q).any(|(x, y)| x.abs_diff(*y) > 12)));
            count += 1.0;
        }
    }
    differ / count
}

/// A stays as it was kept, B is what the scene is now; the line between them is dragged, and A's view comes back.
#[test]
fn a_kept_picture_stays_beside_the_scene() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let picture = |name: &str| {
        format!(r#"{{"wait_frames":5}},{{"wait_sharp":60}},{{"window_screenshot":{{"path":"{name}.png"}}}}"#)
    };
    let steps = [
        // The scene has the whole width.
        r#"{"wait_loaded":120},{"key":"H"},{"wait_frames":5},{"view":"top"}"#,
        &picture("before"),
        r#"{"key":"Y"},{"shading":"normal"}"#,
        &picture("beside"),
        r#"{"drag":{"x":0.3,"y":0.0}}"#,
        &picture("dragged"),
        r#"{"view":"front"}"#,
        &picture("elsewhere"),
        r#"{"key":"Y"},{"view":"top"}"#,
        &picture("alone"),
        r#""quit""#,
    ];
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy()], &steps.join(",")));
    let at = folder.path();
    let [left, right] = [[0.02, 0.45], [0.55, 0.98]];
    assert_eq!(difference_between(at, "before.png", "beside.png", left), 0.0, "A");
    assert!(difference_between(at, "before.png", "beside.png", right) > 0.1, "B");
    assert_eq!(difference_between(at, "alone.png", "beside.png", right), 0.0, "B");
    assert!(difference_between(at, "alone.png", "beside.png", left) > 0.1, "A");
    // The line has moved to the right by 0.3 of the scene's height, and nothing else.
    assert_eq!(difference_between(at, "before.png", "dragged.png", [0.02, 0.64]), 0.0, "A");
    assert_eq!(difference_between(at, "beside.png", "dragged.png", [0.74, 0.98]), 0.0, "B");
    assert_eq!(difference_between(at, "before.png", "elsewhere.png", [0.02, 0.45]), 0.0, "A");
    assert!(difference_between(at, "dragged.png", "elsewhere.png", [0.74, 0.98]) > 0.02, "B");
}

/// The same picture before and after, from where the camera was left, with what was chosen.
#[test]
fn a_lost_device_is_replaced() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let model = save_model(folder.path());
    let steps = r#"{"wait_loaded":120},{"drag":{"x":0.3,"y":0.1}},{"overlay":"groups"},{"wait_frames":20},
        {"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        "lose_device",{"wait_loaded":120},{"wait_sharp":120},{"expect_message":"device was lost"},
        {"screenshot":{"path":"after.png"}},{"window_screenshot":{"path":"window.png"}},
        {"open":"torus.ply"},{"wait_loaded":60},{"wait_sharp":60},{"screenshot":{"path":"model.png"}},
        "lose_device",{"wait_loaded":60},{"wait_sharp":60},{"screenshot":{"path":"again.png"}},"quit""#;
    assert_eq!(model.file_name().unwrap(), "torus.ply");
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy()], steps));
    let at = folder.path();
    assert!(colors(at, "before.png") > 60, "the picture is not blank");
    assert_eq!(difference(at, "before.png", "after.png"), 0.0);
    assert!(colors(at, "window.png") > 60, "the window shows it, too");
    assert!(colors(at, "model.png") > 60);
    assert_eq!(difference(at, "model.png", "again.png"), 0.0);
}

/// What was painted and is in no file yet is still there, and can be undone.
#[test]
fn painting_goes_on_with_another_device() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r##"{"wait_loaded":120},{"wait_frames":3},{"view":"top"},{"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        {"color":"#ff2000"},{"brush":{"size":60,"hardness":0.9,"flow":1.0,"smoothing":0.0}},
        {"stroke":{"points":[[0.5,0.75],[0.6,0.78]]}},{"wait_painted":60},{"wait_sharp":60},
        {"screenshot":{"path":"painted.png"}},
        "lose_device",{"wait_loaded":120},{"wait_frames":5},{"wait_sharp":120},
        {"expect_painting":{"steps":1}},{"screenshot":{"path":"after.png"}},
        {"key":"Ctrl+Z"},{"wait_painted":60},{"wait_sharp":60},{"screenshot":{"path":"undone.png"}},"quit""##;
    let path = asset.to_string_lossy().into_owned();
    check_success(&display.run(folder.path(), &[&path, "--paint"], steps));
    let at = folder.path();
    assert!(difference(at, "before.png", "painted.png") > 0.003, "the stroke is seen");
    assert_eq!(difference(at, "painted.png", "after.png"), 0.0);
    assert_eq!(difference(at, "before.png", "undone.png"), 0.0);
}

/// Pages of another pool come while the picture of the one before is shown.
#[test]
fn another_pool_size_leaves_the_picture() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset(folder.path());
    let steps = r#"{"wait_loaded":120},{"wait_sharp":120},{"screenshot":{"path":"before.png"}},
        {"pool":96},{"wait_frames":60},{"wait_sharp":60},{"screenshot":{"path":"more.png"}},
        {"pool":32},{"wait_frames":60},{"wait_sharp":60},{"screenshot":{"path":"less.png"}},"quit""#;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy()], steps));
    let at = folder.path();
    assert_eq!(difference(at, "before.png", "more.png"), 0.0);
    assert_eq!(difference(at, "before.png", "less.png"), 0.0);
}

#[test]
fn failed_sessions_say_why() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = display.run(folder.path(), &[], r#"{"expect_message":"good morning"}"#);
    assert_eq!(output.status.code(), Some(1));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("step 1") && told.contains("good morning"), "{told}");
    let output = display.run(folder.path(), &[], r#"{"screenshot":{"path":"none.png"}}"#);
    assert_eq!(output.status.code(), Some(1));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("nothing to take a picture of"), "{told}");
    let output = display.run(folder.path(), &[], r#"{"leap":1}"#);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("leap"));
}

/// What a picture of another shape shows beside the screen is loaded before it is taken.
#[test]
fn pictures_of_another_shape_are_sharp() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let asset = save_asset_of(folder.path(), 6_000_000);
    let steps = r#"{"wait_loaded":120},{"resize":[600,700]},{"wait_frames":5},{"camera":{"eye":[0,0.9,0.9],"target":[0,0,1]}},{"wait_sharp":120},
        {"screenshot":{"path":"cold.png","size":[1600,300]}},
        {"camera":{"eye":[0,0.9,0.9],"target":[0.8,0,0.9]}},{"wait_sharp":120},{"camera":{"eye":[0,0.9,0.9],"target":[1.5,0,0.9]}},{"wait_sharp":120},
        {"camera":{"eye":[0,0.9,0.9],"target":[-0.8,0,0.9]}},{"wait_sharp":120},{"camera":{"eye":[0,0.9,0.9],"target":[-1.5,0,0.9]}},{"wait_sharp":120},
        {"camera":{"eye":[0,0.9,0.9],"target":[0,0,1]}},{"wait_sharp":120},{"screenshot":{"path":"warm.png","size":[1600,300]}},"quit""#;
    check_success(&display.run(folder.path(), &[&asset.to_string_lossy()], steps));
    assert!(colors(folder.path(), "cold.png") > 60);
    let differs = difference(folder.path(), "cold.png", "warm.png");
    assert!(differs < 0.002, "{differs}");
}

/// A look is shown, follows its file, and says what is wrong with it.
#[test]
fn looks_are_live() {
    let Some(display) = Display::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let look = r##"[textures.stone]
kind = "marble"
place = { scale = 0.5 }

[materials.torus]
base_color = "stone"
roughness = 0.3
"##;
    std::fs::write(at.join("look.toml"), look).unwrap();
    std::fs::write(at.join("rough.toml"), look.replace("scale = 0.5", "scale = 0.1")).unwrap();
    std::fs::write(at.join("wrong.toml"), look.replace("roughness = 0.3", "roughnes = 0.3")).unwrap();
    let model = save_model(at);
    let steps = r#"{"wait_frames":5},{"wait_sharp":120},{"window_screenshot":{"path":"first.png"}},{"screenshot":{"path":"scene.png"}},
        {"look_number":["textures.stone.place.scale",0.15]},{"wait_sharp":120},{"window_screenshot":{"path":"number.png"}},
        {"look_number":["textures.stone.place.scale",0.5]},{"copy":{"from":"rough.toml","to":"look.toml"}},{"wait_frames":60},{"wait_sharp":120},{"window_screenshot":{"path":"file.png"}},
        {"copy":{"from":"wrong.toml","to":"look.toml"}},{"wait_frames":60},{"window_screenshot":{"path":"wrong.png"}},
        {"drag":{"x":0.2,"y":0.0}},{"copy":{"from":"rough.toml","to":"look.toml"}},{"wait_frames":60},{"wait_sharp":120},{"window_screenshot":{"path":"turned.png"}},"quit""#;
    check_success(&display.run(at, &["look.toml", "--on", &model.to_string_lossy()], steps));
    assert!(colors(at, "scene.png") > 60);
    for (a, b, least) in [
        ("first.png", "number.png", 0.02),
        ("number.png", "file.png", 0.002),
        ("file.png", "wrong.png", 0.005),
        ("wrong.png", "turned.png", 0.02),
    ] {
        assert!(difference(at, a, b) > least, "{a} {b}: {}", difference(at, a, b));
    }
}
